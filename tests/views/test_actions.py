"""A mapper between policy and thrusters: the same in the single environment and in the batch."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from tests.views.cases import FAULTS
from thruster_baselines.mapping import LPMapper, PseudoInverseMapper
from thruster_envs.spacecraft import load
from thruster_envs.testing import check_vector_env
from thruster_envs.views import BeliefAction, MapperAction, SB3VecEnv, VectorBeliefAction, VectorMapperAction

MAPPING = "thruster_envs/ThrusterMapping-v0"


@pytest.fixture(scope="module")
def mapper():
    return LPMapper(load("orion"))


def believing(mapper, **kwargs):
    return BeliefAction(gym.make(MAPPING, **kwargs), mapper)


def test_believing_in_every_thruster_is_the_linear_program_that_knows_of_no_fault(mapper):
    env = believing(mapper, faults=FAULTS)
    plain = gym.make(MAPPING, faults=FAULTS)
    env.reset(seed=0)
    plain.reset(seed=0)
    for _ in range(32):
        command = plain.unwrapped.worlds.state.command[0]
        on_times = mapper(command).on_times
        observation, reward, *_ = env.step(np.ones(12, np.float32))
        beneath, expected, *_ = plain.step(2.0 * on_times / 5.0 - 1.0)
        assert reward == expected
        assert np.array_equal(observation[:-12], beneath)
        assert (observation[-12:] == 1.0).all()


def test_a_thruster_believed_dead_is_not_fired(mapper):
    env = believing(mapper, faults=[])
    env.reset(seed=0)
    belief = np.ones(12, np.float32)
    belief[4] = -1.0
    for _ in range(32):
        observation, *_ = env.step(belief)
        duties = observation[6:18]
        assert duties[4] == 0.0
        assert observation[-12 + 4] == 0.0


def test_knowing_the_fault_is_worth_something(mapper):
    scores = {}
    for name, value in (("blind", 1.0), ("knowing", -1.0)):
        env, total = believing(mapper, faults=[{"thruster": 3, "kind": "stuck_off"}]), 0.0
        belief = np.ones(12, np.float32)
        belief[2] = value
        for seed in range(20):
            env.reset(seed=seed)
            for _ in range(32):
                *_, info = env.step(belief)
            total += info["score"]
        scores[name] = total / 20
    assert scores["knowing"] > scores["blind"] + 0.05


@pytest.mark.filterwarnings("ignore:.*has a wrapper applied:UserWarning")  # the wrapper is what is checked
def test_checkers_find_nothing_wrong_with_the_wrapped_environments(mapper):
    check_env(believing(mapper, faults=FAULTS), skip_render_check=True)
    check_env(MapperAction(gym.make("thruster_envs/OrionRendezvous-v0"), mapper), skip_render_check=True)
    check_env_for_sb3(believing(mapper, faults=FAULTS))


def test_the_vector_form_is_the_single_form_in_every_autoreset_mode(mapper):
    def vector(num_envs, autoreset_mode):
        beneath = gym.make_vec(
            MAPPING, num_envs=num_envs, faults=FAULTS, max_episode_steps=15, autoreset_mode=autoreset_mode
        )
        return VectorBeliefAction(beneath, mapper)

    report = check_vector_env(
        vector, lambda: believing(mapper, faults=FAULTS, max_episode_steps=15), steps=50
    )
    assert not report.failures


def test_the_vector_form_of_mapper_action_is_the_single_form(mapper):
    identifier = "thruster_envs/OrionRendezvous-v0"

    def vector(num_envs, autoreset_mode):
        beneath = gym.make_vec(
            identifier, num_envs=num_envs, faults=FAULTS, max_episode_steps=15, autoreset_mode=autoreset_mode
        )
        return VectorMapperAction(beneath, mapper)

    def single():
        return MapperAction(gym.make(identifier, faults=FAULTS, max_episode_steps=15), mapper)

    assert not check_vector_env(vector, single, steps=50).failures


def test_a_commanded_rate_change_is_delivered_by_a_healthy_linear_vehicle(mapper):
    env = MapperAction(gym.make(MAPPING, faults=[]), mapper)
    env.reset(seed=0)
    share = np.array([0.3, -0.2, 0.1, 0.1, -0.1, 0.2], np.float32)
    observation, *_ = env.step(share)
    expected = observation[24:30]
    assert expected == pytest.approx(share, abs=1e-6)


def test_the_wrapped_batch_goes_into_stable_baselines(mapper):
    beneath = gym.make_vec(MAPPING, num_envs=4, faults=FAULTS, max_episode_steps=5)
    env = SB3VecEnv(VectorBeliefAction(beneath, mapper))
    env.seed(0)
    first = env.reset()
    assert first.shape == (4, 66)
    belief = np.zeros((4, 12), np.float32)
    for _ in range(5):
        observations, _, dones, infos = env.step(belief)
    assert dones.all()
    assert (observations[:, -12:] == 1.0).all()  # a new episode begins without suspicion
    for info in infos:
        assert info["terminal_observation"].shape == (66,)
        assert (info["terminal_observation"][-12:] == 0.5).all()


def test_wrappers_refuse_what_they_cannot_do(mapper):
    with pytest.raises(ValueError, match="commands no rate change"):
        BeliefAction(gym.make("thruster_envs/OrionRendezvous-v0"), mapper)
    with pytest.raises(TypeError, match="no thrusters"):
        MapperAction(gym.make("CartPole-v1"), mapper)
    with pytest.raises(ValueError, match=r"\(6, 11\)"):
        BeliefAction(gym.make(MAPPING), PseudoInverseMapper(np.ones((6, 11)), 5.0))
    env = believing(mapper)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="nan"):
        env.step(np.full(12, np.nan))
    with pytest.raises(ValueError, match=r"shape \(6,\)"):
        env.step(np.zeros(6))
