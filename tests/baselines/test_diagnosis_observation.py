"""A detector beside the policy: what it says stands behind the observation, in both forms and all modes."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from thruster_baselines.control import DiagnosisObservation, VectorDiagnosisObservation
from thruster_baselines.detection.residuals import CorrelationDetector, FusionDetector
from thruster_baselines.mapping import LPMapper
from thruster_envs.spacecraft import load
from thruster_envs.testing import check_vector_env
from thruster_envs.views import HoldAction, MapperAction, VectorHoldAction, VectorMapperAction

MARS = "thruster_envs/MarsRendezvous-v1"
OPEN = [{"thruster": 3, "kind": "stuck_on", "onset": 50.03}]


def correlation(vehicles=1, threshold=0.0205):
    return CorrelationDetector("msr_chaser", threshold, vehicles=vehicles)


def single(detector=None, **settings):
    return DiagnosisObservation(gym.make(MARS, **settings), detector or correlation())


def batch(worlds, detector=None, **settings):
    return VectorDiagnosisObservation(
        gym.make_vec(MARS, num_envs=worlds, vectorization_mode="vector_entry_point", **settings),
        detector or correlation(worlds),
    )


def pilot_actions(env):
    """Of the environment's own pilot, as float32."""
    worlds = env.unwrapped.worlds
    actions = worlds.task.pilot_actions(worlds.state)[:, 0].astype(np.float32)
    return actions if isinstance(env, VectorDiagnosisObservation) else actions[0]


def test_an_open_valve_is_seen_in_the_observation_by_name_and_in_time():
    env = single(faults=OPEN)
    observation, _ = env.reset(seed=1)
    assert observation.shape == (36 + 2 + 8 + 3,)
    np.testing.assert_array_equal(observation[36:], 0.0)
    alarm = name = np.inf
    for k in range(1, 531):
        observation, *_ = env.step(pilot_actions(env))
        if observation[37] and np.isinf(alarm):
            alarm = 0.1 * k
            assert observation[36] >= 1.0
            assert np.linalg.norm(observation[46:49]) == pytest.approx(observation[36], rel=1e-6)
        if observation[38:46].any() and np.isinf(name):
            name = 0.1 * k
    assert 50.03 < alarm < 51.4
    assert alarm + 0.9 - 1e-9 <= name < 53.0
    np.testing.assert_array_equal(observation[38:46], [0, 0, 1, 0, 0, 0, 0, 0])


def test_without_a_residual_there_are_three_numbers_less():
    env = single(FusionDetector("msr_chaser", 20.0))
    assert env.reset(seed=0)[0].shape == (36 + 2 + 8,)


@pytest.mark.parametrize("delay", [1, 3])
def test_the_batch_says_what_single_environments_say(delay):
    settings = {"faults": OPEN, "navigation_delay": delay}
    many = batch(2, **settings)
    ones = [single(**settings) for _ in range(2)]
    seen, _ = many.reset(seed=5)
    alone = np.stack([one.reset(seed=5 + i)[0] for i, one in enumerate(ones)])
    np.testing.assert_array_equal(seen, alone)
    for _ in range(520):
        actions = pilot_actions(many)
        seen, *_ = many.step(actions)
        alone = np.stack([one.step(action)[0] for one, action in zip(ones, actions, strict=True)])
        np.testing.assert_array_equal(seen, alone)
    assert seen[:, 37].all()


def test_what_is_saved_goes_on_as_before():
    many = batch(3, faults=OPEN, navigation_delay=2)
    many.reset(seed=0)
    for _ in range(505):
        many.step(pilot_actions(many))
    saved = many.save_state()
    went = [many.step(pilot_actions(many))[0] for _ in range(30)]
    other = batch(3, faults=OPEN, navigation_delay=2)
    other.reset(seed=9)
    other.restore_state(saved)
    for expected in went:
        np.testing.assert_array_equal(other.step(pilot_actions(other))[0], expected)
    assert went[-1][:, 37].all()
    assert not went[0][:, 37].any()
    with pytest.raises(ValueError, match=r"the saved residual has the shape None; \(3, 3\) would be right"):
        other.restore_state({k: v for k, v in saved.items() if k != "detector/residual"})


def test_the_spare_branch_begins_without_an_alarm():
    env = single(faults=OPEN, inhibit=True)
    env.reset(seed=2)
    for _ in range(530):
        observation, *_ = env.step(pilot_actions(env))
    assert observation[-12]
    action = pilot_actions(env)
    action[16] = 1.0
    observation, *_ = env.step(action)
    assert not observation[-13:-3].any()  # its residual has yet to settle


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_new_episode_begins_with_a_detector_that_has_seen_nothing(mode):
    many = batch(2, faults=OPEN, distance=5.0, autoreset_mode=mode, max_episode_steps=520)
    many.reset(seed=3)
    before = None
    for k in range(1, 523):
        actions = np.full((2, 8), -0.8, np.float32) if k < 490 else np.full((2, 8), 1.0, np.float32)
        seen, _, terminated, truncated, infos = many.step(actions)
        if mode == AutoresetMode.DISABLED and (terminated | truncated).any():
            seen, _ = many.reset(options={"reset_mask": terminated | truncated})
        if (many.unwrapped.worlds.steps == 0).any():
            if "final_obs" in infos:
                assert infos["final_obs"][0][48] != before[12]  # one more sample has been seen
            np.testing.assert_array_equal(seen[many.unwrapped.worlds.steps == 0, 36:], 0.0)
            break
        before = seen[0, 36:]
    else:
        pytest.fail("no episode ended")
    many.step(actions)


def test_a_second_episode_is_diagnosed_as_in_a_new_environment():
    """What was told in the first one is forgotten, however late the sights are."""
    settings = {"faults": [OPEN[0] | {"onset": 3.03}], "navigation_delay": 3}
    actions = np.random.default_rng(1).uniform(-1.0, -0.2, (60, 8)).astype(np.float32)

    def flown(env, seed):
        return np.array([env.reset(seed=seed)[0]] + [env.step(action)[0] for action in actions])

    used = single(FusionDetector("msr_chaser", 20.0), **settings)
    flown(used, 7)
    again = flown(used, 8)
    np.testing.assert_array_equal(again, flown(single(FusionDetector("msr_chaser", 20.0), **settings), 8))
    assert again[-1, 37]


@pytest.mark.parametrize("mode", AutoresetMode)
def test_later_episodes_of_a_batch_are_those_of_single_environments(mode):
    settings = {"faults": [OPEN[0] | {"onset": 3.03}], "navigation_delay": 2, "max_episode_steps": 60}
    many = batch(2, FusionDetector("msr_chaser", 20.0, vehicles=2), autoreset_mode=mode, **settings)
    many.reset(seed=5)
    ones = [single(FusionDetector("msr_chaser", 20.0), **settings) for _ in range(2)]
    for i, one in enumerate(ones):
        one.reset(seed=5 + i)
    rng = np.random.default_rng(2)
    for k in range(1, 150):
        actions = rng.uniform(-1.0, -0.2, (2, 8)).astype(np.float32)
        seen, _, _, truncated, _ = many.step(actions)
        over = k % 61 == 0 if mode == AutoresetMode.NEXT_STEP else k % 60 == 0
        if over:
            seen = (
                many.reset(options={"reset_mask": truncated})[0] if mode == AutoresetMode.DISABLED else seen
            )
            alone = [one.reset()[0] for one in ones]
        else:
            alone = [one.step(action)[0] for one, action in zip(ones, actions, strict=True)]
        np.testing.assert_array_equal(seen, alone)
    assert many.unwrapped.worlds.steps.max() < 60  # so that there were resets


@pytest.mark.filterwarnings("ignore:.*has a wrapper applied:UserWarning")  # the wrapper is what is checked
def test_checkers_find_nothing_wrong_with_either_form():
    check_env(single(), skip_render_check=True)
    report = check_vector_env(
        lambda num_envs, **settings: batch(num_envs, faults=OPEN, max_episode_steps=15, **settings),
        lambda: single(faults=OPEN, max_episode_steps=15),
        steps=50,
    )
    assert not report.failures


def test_a_mapper_and_a_hold_stand_where_they_can():
    mapper = LPMapper(load("msr_chaser"))
    held = HoldAction(DiagnosisObservation(MapperAction(gym.make(MARS), mapper), correlation()), 10)
    held.reset(seed=0)
    assert held.step(np.zeros(6, np.float32))[0].shape == (49,)
    many = VectorDiagnosisObservation(
        VectorMapperAction(gym.make_vec(MARS, num_envs=2, vectorization_mode="vector_entry_point"), mapper),
        correlation(2),
    )
    many.reset(seed=0)
    assert many.step(np.zeros((2, 6), np.float32))[0].shape == (2, 49)
    beneath = VectorHoldAction(gym.make_vec(MARS, num_envs=2, vectorization_mode="vector_entry_point"), 10)
    hidden = VectorDiagnosisObservation(beneath, correlation(2))
    hidden.reset(seed=0)
    with pytest.raises(RuntimeError, match="control periods went by unseen by the detector; HoldAction"):
        hidden.step(np.zeros((2, 8), np.float32))


def test_who_cannot_feed_a_detector_is_told_so():
    with pytest.raises(TypeError, match="OrionRendezvousEnv shows no navigation to a detector; Mars"):
        DiagnosisObservation(gym.make("thruster_envs/OrionRendezvous-v1"), correlation())
    with pytest.raises(ValueError, match="navigation_delay is 0, so that"):
        single(navigation_delay=0)
    with pytest.raises(ValueError, match="the detector watches 3 vehicles; 1 would be right"):
        single(correlation(3))
    with pytest.raises(ValueError, match="the detector is for 12 thrusters; 8 would be right"):
        single(CorrelationDetector("orion", 1.0, design="undelayed"))
