"""A mapper between policy and thrusters: the same in the single environment and in the batch."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from tests.views.cases import FAULTS
from thruster_baselines.mapping import (
    CarryingMapper,
    LPMapper,
    MinimumPulseMapper,
    PseudoInverseMapper,
    SchmittTriggerMapper,
    TruncatingMapper,
    minimum_pulses,
)
from thruster_envs.spacecraft import load
from thruster_envs.testing import check_vector_env
from thruster_envs.views import (
    BeliefAction,
    HoldAction,
    MapperAction,
    SB3VecEnv,
    VectorBeliefAction,
    VectorHoldAction,
    VectorMapperAction,
)

MAPPING = "thruster_envs/ThrusterMapping-v0"
RENDEZVOUS = "thruster_envs/OrionRendezvous-v1"
FORMATION = "thruster_envs/FormationAttitude-v1"
SPHERES = load("spheres")


def carrying(worlds=None):
    return CarryingMapper(TruncatingMapper(LPMapper(SPHERES), minimum_pulses(SPHERES)), worlds)


def pulsing(worlds=None):
    return CarryingMapper(MinimumPulseMapper(SPHERES, slack_cost=60.0), worlds, limit=0.5)


def triggered(worlds=None):
    return SchmittTriggerMapper(LPMapper(SPHERES), minimum_pulses(SPHERES), open_at=0.02, worlds=worlds)


REMEMBERING = [carrying, pulsing, triggered]


def small_shares(*shape, seed=0):
    """Actions that ask most thrusters of SPHERES for less than a pulse."""
    return np.random.default_rng(seed).uniform(-0.003, 0.005, (*shape, 6)).astype(np.float32)


def remembering(mapper, **kwargs):
    return MapperAction(gym.make(RENDEZVOUS, spacecraft="spheres", **kwargs), mapper)


def remembering_batch(mapper, num_envs, **kwargs):
    beneath = gym.make_vec(RENDEZVOUS, num_envs=num_envs, spacecraft="spheres", **kwargs)
    return VectorMapperAction(beneath, mapper)


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
    check_env(MapperAction(gym.make("thruster_envs/OrionRendezvous-v1"), mapper), skip_render_check=True)
    check_env_for_sb3(believing(mapper, faults=FAULTS))


def test_what_an_environment_takes_beside_duties_stands_behind_the_rate_change():
    """On the Mars chaser: a wrench, eight isolation valves and the branch, in both forms."""
    chaser, single, many = "thruster_envs/MarsRendezvous-v1", [], []
    env = MapperAction(gym.make(chaser, inhibit=True), LPMapper(load("msr_chaser")))
    envs = VectorMapperAction(gym.make_vec(chaser, num_envs=2, inhibit=True), LPMapper(load("msr_chaser")))
    assert env.action_space.shape == envs.single_action_space.shape == (6 + 8 + 1,)
    env.reset(seed=5)
    envs.reset(seed=5)
    action = np.array([0.5, 0, 0, 0, 0.3, 0, -1, -1, 1, -1, -1, -1, -1, -1, -1], np.float32)
    for _ in range(4):
        single.append(env.step(action)[0])
        many.append(envs.step(np.stack([action, action]))[0])
    np.testing.assert_array_equal(single, np.array(many)[:, 0])
    np.testing.assert_array_equal(single[-1][36:45], [0, 0, 1, 0, 0, 0, 0, 0, 0])
    duties = single[-1][16:24].astype(float)
    change = load("msr_chaser").effectiveness() @ (0.1 * duties)
    authority = load("msr_chaser").authority()
    np.testing.assert_allclose(change / authority, [0.5, 0, 0, 0, 0.3, 0], atol=1e-6)


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
    identifier = "thruster_envs/OrionRendezvous-v1"

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
        BeliefAction(gym.make("thruster_envs/OrionRendezvous-v1"), mapper)
    with pytest.raises(ValueError, match="FaultDiagnosisEnv is not the duty of each thruster"):
        MapperAction(gym.make("thruster_envs/FaultDiagnosis-v1"), mapper)
    with pytest.raises(TypeError, match="no thrusters"):
        MapperAction(gym.make("CartPole-v1"), mapper)
    with pytest.raises(ValueError, match=r"\(6, 11\)"):
        BeliefAction(gym.make(MAPPING), PseudoInverseMapper(np.eye(6, 11), 5.0))
    env = believing(mapper)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="nan"):
        env.step(np.full(12, np.nan))
    with pytest.raises(ValueError, match=r"shape \(6,\)"):
        env.step(np.zeros(6))


# Mappers with a memory


@pytest.mark.parametrize("build", REMEMBERING)
def test_with_a_memory_too_the_vector_form_is_the_single_form(build):
    def vector(num_envs, autoreset_mode):
        return remembering_batch(
            build(num_envs), num_envs, faults=FAULTS, max_episode_steps=9, autoreset_mode=autoreset_mode
        )

    def single():
        return remembering(build(), faults=FAULTS, max_episode_steps=9)

    assert not check_vector_env(vector, single, steps=40).failures


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_exactly_the_worlds_that_begin_an_episode_owe_nothing(mode):
    worlds, steps, length = 4, 40, 9
    env = remembering_batch(carrying(worlds), worlds, max_episode_steps=length, autoreset_mode=mode)
    alone = [carrying() for _ in range(worlds)]
    shares = small_shares(steps, worlds)
    commands = shares.astype(np.float64) * SPHERES.authority()
    _, infos = env.reset(seed=0)
    assert (infos["remainder"] == 0.0).all()
    assert infos["_remainder"].all()
    over, ended = np.zeros(worlds, np.bool_), 0
    for step in range(steps):
        if mode == AutoresetMode.DISABLED and over.any():
            begin = over
        elif step in (2, 5):  # so that the worlds' episodes do not end together
            begin = np.arange(worlds) == step // 2
        else:
            begin = np.zeros(worlds, np.bool_)
        if begin.any():
            _, infos = env.reset(options={"reset_mask": begin.copy()})
            for world in np.flatnonzero(begin):
                alone[world].forget()
            over = over & ~begin
            assert (infos["remainder"] == np.stack([one.remainder for one in alone])).all()
        _, _, terminated, truncated, infos = env.step(shares[step])
        done = terminated | truncated
        ended += done.sum()
        for world in range(worlds):
            if mode == AutoresetMode.NEXT_STEP and over[world]:
                alone[world].forget()  # its action does not count
            else:
                alone[world](commands[step, world])
        owed = np.stack([one.remainder for one in alone])
        if mode == AutoresetMode.SAME_STEP and done.any():
            final = infos["final_info"]
            assert (final["_remainder"] == done).all()
            assert (final["remainder"] == np.where(done[:, np.newaxis], owed, 0.0)).all()
            assert (final["remainder"][done] != 0.0).any(axis=1).all()
            owed[done] = 0.0
            for world in np.flatnonzero(done):
                alone[world].forget()
        assert (infos["remainder"] == owed).all()
        assert infos["_remainder"].all()
        over = done
    assert ended > 2 * worlds


@pytest.mark.parametrize("build", REMEMBERING)
def test_the_remainder_is_what_was_commanded_minus_what_the_duties_give(build):
    env = remembering(build(), faults=FAULTS)
    owed = []
    for seed in range(2):
        _, info = env.reset(seed=seed)
        assert (info["remainder"] == 0.0).all()
        commanded, delivered = np.zeros(6), np.zeros(6)
        for share in small_shares(60, seed=seed):
            observation, *_, info = env.step(share)
            commanded += share.astype(np.float64) * SPHERES.authority()
            on_times = observation[13:25].astype(np.float64) * SPHERES.control_period
            delivered += SPHERES.effectiveness() @ on_times  # what the mapper believes, whatever has failed
            unit = SPHERES.authority() / SPHERES.control_period
            np.testing.assert_allclose((info["remainder"] - commanded + delivered) / unit, 0.0, atol=1e-6)
            owed.append(info["remainder"])
        assert delivered.any()
    assert len(np.unique(owed, axis=0)) > 100  # and no later step writes into an info


def test_a_pulse_that_is_just_long_enough_opens_its_valve():
    # Shortest pulses that come back from the action space too short by round-off, and so on the safe side.
    period, candidates = SPHERES.control_period, np.linspace(0.0031, 0.0497, 4001)
    back = (0.5 * (2.0 * (candidates / period) - 1.0) + 0.5) * period
    minimum = candidates[back < candidates][:: (back < candidates).sum() // 12][:12]
    assert minimum.size == 12
    craft = SPHERES.replace(
        thrusters=tuple(
            replace(thruster, minimum_pulse=float(pulse))
            for thruster, pulse in zip(SPHERES.thrusters, minimum, strict=True)
        )
    )
    mapper = MinimumPulseMapper(craft)
    env = MapperAction(gym.make(RENDEZVOUS, spacecraft=craft), mapper)
    env.reset(seed=0)
    expected, just_long_enough = 0.0, 0
    for share in small_shares(100):
        on_times = mapper(share.astype(np.float64) * craft.authority()).on_times
        just_long_enough += (on_times == minimum).sum()
        expected += on_times.sum()
        *_, info = env.step(share)
        assert info["fuel"] == pytest.approx(expected, rel=1e-9)
    assert just_long_enough > 100


@pytest.mark.parametrize("build", REMEMBERING)
def test_a_saved_state_has_the_memory_of_the_mapper(build):
    env = remembering_batch(build(3), 3, faults=FAULTS, max_episode_steps=9)
    shares = small_shares(30, 3)

    def fly(first, last):
        steps = [env.step(share) for share in shares[first:last]]
        return [step[0] for step in steps], [step[4]["remainder"] for step in steps]

    env.reset(seed=0)
    fly(0, 5)
    saved = env.save_state()
    first = fly(5, 30)
    env.restore_state(saved)
    again = fly(5, 30)
    for one, other in zip(first[0] + first[1], again[0] + again[1], strict=True):
        assert np.array_equal(one, other)
    assert all(array.flags.owndata for array in saved.values())


def test_a_mapper_without_a_memory_is_saved_too_and_tells_nothing(mapper):
    env = VectorMapperAction(gym.make_vec(RENDEZVOUS, num_envs=2, faults=FAULTS), mapper)
    _, infos = env.reset(seed=0)
    assert "remainder" not in infos
    saved = env.save_state()
    shares = np.random.default_rng(0).uniform(-0.3, 0.3, (5, 2, 6))
    first = [env.step(share)[0] for share in shares]
    env.restore_state(saved)
    assert all(np.array_equal(env.step(share)[0], one) for share, one in zip(shares, first, strict=True))
    _, info = MapperAction(gym.make(RENDEZVOUS), mapper).reset(seed=0)
    assert "remainder" not in info


def test_a_batch_with_a_memory_goes_into_stable_baselines():
    env = SB3VecEnv(remembering_batch(carrying(3), 3, max_episode_steps=5))
    env.seed(0)
    env.reset()
    for step, share in enumerate(small_shares(10, 3)):
        _, _, dones, _ = env.step(share)
        assert dones.all() == (step % 5 == 4)
        assert (env.latest_info()["remainder"] != 0.0).any() != dones.all()


def test_a_memory_for_other_worlds_is_refused(mapper):
    with pytest.raises(ValueError, match=r"remainder has the shape \(6,\); \(3, 6\) would be right"):
        remembering_batch(carrying(), 3)
    with pytest.raises(ValueError, match=r"remainder has the shape \(3, 6\); \(6,\) or \(1, 6\) would be"):
        remembering(carrying(3))
    with pytest.raises(ValueError, match="every command here stands for itself"):
        believing(CarryingMapper(mapper))
    one = remembering(carrying(1))
    one.reset(seed=0)
    *_, info = one.step(small_shares())
    assert info["remainder"].shape == (6,)
    assert info["remainder"].any()


# Actions that are held


@pytest.mark.parametrize(
    ("identifier", "options"),
    [
        (MAPPING, {"faults": FAULTS, "max_episode_steps": 10}),
        (FORMATION, {"max_episode_steps": 30, "rate_soft_limit": 1e-4, "rate_limit": 3e-4}),
        (FORMATION, {"max_episode_steps": 21, "action": "duties", "retarget_interval": 5}),
    ],
)
def test_held_too_the_vector_form_is_the_single_form(identifier, options):
    """Four periods a step; time limits and spinning craft end episodes within a hold."""

    def vector(num_envs, autoreset_mode):
        beneath = gym.make_vec(identifier, num_envs=num_envs, autoreset_mode=autoreset_mode, **options)
        return VectorHoldAction(beneath, 4)

    assert not check_vector_env(
        vector, lambda: HoldAction(gym.make(identifier, **options), 4), steps=30
    ).failures


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_a_held_action_gives_the_sum_of_its_periods_until_the_episode_ends(mode):
    """Worlds that spin too fast end in some period of the hold; each then says what it said there."""
    worlds, periods = 6, 5
    options = {"rate_soft_limit": 1e-5, "rate_limit": 2.5e-4}
    held = VectorHoldAction(gym.make_vec(FORMATION, num_envs=worlds, autoreset_mode=mode, **options), periods)
    alone = [gym.make(FORMATION, **options) for _ in range(worlds)]
    held.reset(seed=3)
    for world, env in enumerate(alone):
        env.reset(seed=3 + world)
    rng = np.random.default_rng(0)
    over, ended, early = np.zeros(worlds, np.bool_), 0, 0
    for _ in range(40):
        if mode == AutoresetMode.DISABLED and over.any():
            held.reset(options={"reset_mask": over.copy()})
            for world in np.flatnonzero(over):
                alone[world].reset()
            over[:] = False
        actions = rng.integers(0, 3, (worlds, 3))
        observations, rewards, terminated, _, infos = held.step(actions)
        for world, env in enumerate(alone):
            if over[world]:  # NEXT_STEP: the action does not count
                observation, _ = env.reset()
                assert np.array_equal(observations[world], observation)
                assert rewards[world] == infos["cost"][world] == 0.0
                assert not terminated[world]
                continue
            total, cost = 0.0, 0.0
            for period in range(periods):
                observation, reward, end, _, info = env.step(actions[world])
                total, cost = total + reward, cost + info["cost"]
                if end:
                    ended, early = ended + 1, early + (period < periods - 1)
                    break
            same = mode == AutoresetMode.SAME_STEP and end
            told, seen = (infos["final_info"], infos["final_obs"]) if same else (infos, observations)
            assert terminated[world] == end
            assert rewards[world] == pytest.approx(total, rel=1e-12)
            assert np.array_equal(seen[world], observation)
            assert told["cost"][world] == pytest.approx(cost, rel=1e-12)
            terms = sum(told["reward_terms"][name][world] for name in info["reward_terms"])
            assert terms == pytest.approx(total, rel=1e-12)
            assert told["fuel"][world] == info["fuel"]
            assert told["attitude"]["error"][world] == info["attitude"]["error"]
            if same:
                first, _ = env.reset()
                assert np.array_equal(observations[world], first)
        over = terminated & (mode != AutoresetMode.SAME_STEP)
    assert early > 5
    assert ended > early


def test_held_actions_move_a_craft_where_actions_drawn_anew_cancel():
    """The reason to hold: a random walk of pulses gets as far as the square root of the hold."""
    turned = []
    for periods in (1, 10):
        env = VectorHoldAction(gym.make_vec(FORMATION, num_envs=64, faults=[]), periods)
        env.reset(seed=1)
        rng = np.random.default_rng(2)
        for _ in range(200 // periods):
            observations, *_ = env.step(rng.integers(0, 3, (64, 3)))
        turned.append(np.sqrt(np.square(observations[:, 7:10]).mean()))
    assert turned[1] / turned[0] == pytest.approx(np.sqrt(10.0), rel=0.25)


@pytest.mark.filterwarnings("ignore:.*has a wrapper applied:UserWarning")  # the wrapper is what is checked
def test_held_environments_pass_the_checkers_go_into_stable_baselines_and_under_a_mapper(mapper):
    check_env(HoldAction(gym.make(FORMATION), 10), skip_render_check=True)
    check_env_for_sb3(HoldAction(gym.make(FORMATION), 10))
    rows = SB3VecEnv(VectorHoldAction(gym.make_vec(FORMATION, num_envs=3, max_episode_steps=25), 10))
    rows.reset()
    for _ in range(3):
        _, _, done, infos = rows.step(np.zeros((3, 3), np.int64))
    assert done.all()
    assert all(info["TimeLimit.truncated"] for info in infos)
    single = MapperAction(HoldAction(gym.make(RENDEZVOUS), 2), mapper)
    many = VectorMapperAction(VectorHoldAction(gym.make_vec(RENDEZVOUS, num_envs=2), 2), mapper)
    single.reset(seed=4)
    many.reset(seed=4)
    action = np.full(6, 0.1, np.float32)
    np.testing.assert_array_equal(single.step(action)[0], many.step(np.stack([action, action]))[0][0])


def test_what_cannot_be_held_is_refused_in_one_line(mapper):
    with pytest.raises(TypeError, match="CartPoleEnv has no control periods"):
        HoldAction(gym.make("CartPole-v1"), 2)
    with pytest.raises(TypeError, match="env is a VectorMapperAction; a vector environment"):
        VectorHoldAction(VectorMapperAction(gym.make_vec(RENDEZVOUS, num_envs=2), mapper), 2)
    for periods in (0, 2.5, True):
        with pytest.raises(ValueError, match=f"periods is {periods}; a whole number from 1"):
            HoldAction(gym.make(FORMATION), periods)
        with pytest.raises(ValueError, match=f"periods is {periods}; a whole number from 1"):
            VectorHoldAction(gym.make_vec(FORMATION, num_envs=2), periods)
