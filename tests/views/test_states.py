"""An environment that is set to a state goes on as the one it was taken from, to the last bit."""

import io

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics
from gymnasium.wrappers import vector as vector_wrappers

from tests.views.cases import IDS, actions_of, entries, equal, faults_of
from thruster_baselines.mapping import CarryingMapper, LPMapper
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.spacecraft import load
from thruster_envs.views import (
    BeliefAction,
    HoldAction,
    MapperAction,
    SB3VecEnv,
    SharedPolicyVecEnv,
    VectorBeliefAction,
    fork,
    get_state,
    set_state,
)

MAPPING, ORION = "thruster_envs/ThrusterMapping-v0", "thruster_envs/OrionRendezvous-v1"
LIMIT, BEFORE, AFTER = 7, 10, 12


def through_a_file(state):
    """What is left of a state after ``np.savez``, read without pickle."""
    file = io.BytesIO()
    np.savez(file, **state)
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def same(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    return np.array_equal(np.asarray(one), np.asarray(other))


def all_the_same(first, second):
    return len(first) == len(second) and all(same(a, b) for a, b in zip(first, second, strict=True))


def lives_of(env, actions):
    """Everything that steps give; a single environment is reset where its episode ends, without a seed."""
    lived = []
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        lived += [observation, reward, terminated, truncated, dict(entries(info))]
        if np.ndim(terminated) == 0 and (terminated or truncated):
            observation, info = env.reset()
            lived += [observation, dict(entries(info))]
    return lived


@pytest.mark.parametrize("identifier", IDS)
def test_a_single_environment_goes_on_from_a_state(identifier):
    def made():
        return gym.make(identifier, faults=faults_of(identifier), max_episode_steps=LIMIT)

    env, other, actions = made(), made(), actions_of(identifier, 0, BEFORE + AFTER)
    env.reset(seed=5)
    lives_of(env, actions[:BEFORE])
    state, branch = get_state(env), fork(env)
    expected = lives_of(env, actions[BEFORE:])
    set_state(other, through_a_file(state))
    assert all_the_same(lives_of(other, actions[BEFORE:]), expected)
    assert all_the_same(lives_of(branch, actions[BEFORE:]), expected)
    assert same(get_state(other), get_state(env))
    set_state(env, state)  # and back
    assert all_the_same(lives_of(env, actions[BEFORE:]), expected)
    assert other.unwrapped.np_random_seed == 5
    assert other.unwrapped.np_random.integers(2**62) == env.unwrapped.np_random.integers(2**62)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("identifier", IDS)
def test_a_batch_goes_on_from_a_state_in_each_mode(identifier, mode):
    def made(threads):
        return gym.make_vec(
            identifier, num_envs=7, faults=faults_of(identifier), max_episode_steps=LIMIT,
            autoreset_mode=mode, threads=threads,
        )  # fmt: skip

    env, other = made(1), made(2)
    actions = np.stack([actions_of(identifier, world, BEFORE + AFTER) for world in range(7)], axis=1)
    env.reset(seed=[3, 1, 4, 1, 5, 9, 2])
    for step in range(BEFORE):
        *_, terminated, truncated, _ = env.step(actions[step])
        if mode == "Disabled" and (terminated | truncated).any():
            env.reset(options={"reset_mask": terminated | truncated})
    if mode == "NextStep":
        env.reset(seed=[3, 1, 4, 1, 5, 9, 2])
        lives_of(env, actions[:LIMIT])
        assert env.unwrapped.pending_resets.any()
    state, branch = get_state(env), fork(env)
    expected = lives_of(env, actions[BEFORE:])
    set_state(other, through_a_file(state))
    assert all_the_same(lives_of(other, actions[BEFORE:]), expected)
    assert all_the_same(lives_of(branch, actions[BEFORE:]), expected)
    assert other.unwrapped.np_random_seed == (3, 1, 4, 1, 5, 9, 2)


@pytest.mark.parametrize("make", [formation_keeping_v1.parallel_env, formation_attitude_v1.parallel_env])
def test_agents_go_on_from_a_state(make):
    env, other = make(max_cycles=LIMIT), make(max_cycles=LIMIT)
    rng = np.random.default_rng(0)
    spaces = {agent: env.action_space(agent) for agent in env.possible_agents}
    for space in spaces.values():
        space.seed(int(rng.integers(100)))
    actions = [{agent: space.sample() for agent, space in spaces.items()} for _ in range(2 * LIMIT)]
    env.reset(seed=3)
    for k in range(4):
        env.step(actions[k])
    state, branch = env.get_state(), env.fork()

    def live(env):
        lived = []
        for action in actions[4:LIMIT]:
            lived += env.step(action)
        assert not env.agents
        over = env.get_state()
        with pytest.raises(ValueError, match="the episode is over"):
            env.step(actions[0])
        lived += env.reset()
        for action in actions[:LIMIT]:
            lived += env.step(action)
        return lived, over

    expected, over = live(env)
    other.set_state(through_a_file(state))
    assert all_the_same(live(other)[0], expected)
    assert all_the_same(live(branch)[0], expected)
    other.set_state(over)
    assert not other.agents


def test_a_state_from_before_the_first_reset_waits_for_it():
    for make in (lambda: gym.make(ORION), lambda: gym.make_vec(ORION, num_envs=2)):
        env, other = make(), make()
        other.reset(seed=1)
        set_state(other, get_state(env))
        with pytest.raises(gym.error.ResetNeeded):
            other.unwrapped.step(np.zeros(other.action_space.shape))
        assert np.array_equal(env.reset()[0], other.reset()[0])  # the seed that neither has been given


def test_a_batch_whose_mode_was_changed_waits_for_a_reset_there_too():
    env, other = (gym.make_vec(ORION, num_envs=2, autoreset_mode=mode) for mode in ("NextStep", "SameStep"))
    env.reset(seed=0)
    env.set_autoreset_mode("SameStep")
    other.reset(seed=0)
    set_state(other, get_state(env))
    with pytest.raises(gym.error.ResetNeeded):
        other.step(np.zeros((2, 12)))


ORION_CRAFT = load("orion")


@pytest.mark.parametrize(
    "wrap",
    [
        lambda: RecordEpisodeStatistics(gym.make(ORION, max_episode_steps=LIMIT)),
        lambda: HoldAction(gym.make(ORION, max_episode_steps=LIMIT), 2),
        lambda: MapperAction(
            gym.make(ORION, max_episode_steps=LIMIT),
            CarryingMapper(LPMapper(ORION_CRAFT, max_on_time=ORION_CRAFT.control_period)),
        ),
        lambda: BeliefAction(gym.make(MAPPING, max_episode_steps=LIMIT), LPMapper(ORION_CRAFT)),
        lambda: VectorBeliefAction(
            gym.make_vec(MAPPING, num_envs=3, max_episode_steps=LIMIT), LPMapper(ORION_CRAFT)
        ),
        lambda: vector_wrappers.RecordEpisodeStatistics(
            gym.make_vec(MAPPING, num_envs=3, max_episode_steps=LIMIT)
        ),
    ],
)
def test_what_wrappers_remember_is_in_the_state(wrap):
    env, other = wrap(), wrap()
    env.action_space.seed(0)
    actions = [0.2 * env.action_space.sample() for _ in range(3 * LIMIT)]
    env.reset(seed=0)

    def live(env, actions):
        lived = lives_of(env, actions)
        for one in lived:
            if isinstance(one, dict):
                one.pop("episode.t", None), one.pop("episode._t", None)  # by the clock
        return lived

    live(env, actions[:5])
    state = get_state(env)
    expected = live(env, actions[5:])
    set_state(other, through_a_file(state))
    assert all_the_same(live(other, actions[5:]), expected)


def test_rows_of_stable_baselines_go_on_from_a_state():
    for make in (
        lambda: SB3VecEnv(gym.make_vec(MAPPING, num_envs=4, max_episode_steps=LIMIT)),
        lambda: SharedPolicyVecEnv(2, max_episode_steps=LIMIT),
    ):
        env, other = make(), make()
        env.seed(0)
        env.reset()
        rng = np.random.default_rng(0)
        actions = rng.uniform(-1.0, 1.0, (3 * LIMIT, env.num_envs, *env.action_space.shape))
        for action in actions[:5]:
            env.step(action)
        state = get_state(env)
        other.reset()
        set_state(other, state)
        for action in actions[5:]:
            assert all_the_same(env.step(action)[:3], other.step(action)[:3])


def test_a_state_of_something_else_is_refused_in_one_line_and_changes_nothing():
    env = gym.make(ORION)
    env.reset(seed=0)
    before, state = get_state(env), get_state(env)
    heavier = ORION_CRAFT.replace(mass=2.0 * ORION_CRAFT.mass)
    refused = [
        (get_state(gym.make("thruster_envs/MarsRendezvous-v1")), "environment = 'OrionRendezvousEnv'"),
        (get_state(gym.make(ORION, spacecraft=heavier)), r"with spacecraft\.mass = "),
        (get_state(gym.make(ORION, orbits=1.0)), r"with orbits = 0\.5, got orbits = 1\.0"),
        (get_state(gym.make_vec(ORION, num_envs=1)), "environment = 'OrionRendezvousEnv'"),
        ({**state, "steps": np.zeros(2, np.int64)}, r"state\['steps'\] must have the shape \(1,\)"),
        ({**state, "steps": np.zeros(1)}, r"state\['steps'\] must have .* type int64, got .* float64"),
        ({name: one for name, one in state.items() if name != "keys"}, "must have the entry 'keys'"),
        ({**state, "stepz": np.zeros(1)}, "'stepz', which nothing here remembers; did you mean 'steps'"),
        ({**state, "generator": state["generator"][:-3]}, "damaged"),
        ({**state, "environment": np.zeros(3, np.uint8)}, "damaged"),
        ({}, "must be what get_state"),
        (None, "must be what get_state"),
    ]
    for wrong, message in refused:
        with pytest.raises(ValueError, match=message) as error:
            set_state(env, wrong)
        assert "\n" not in str(error.value)
    assert same(get_state(env), before)
    two = gym.make_vec(ORION, num_envs=2)
    with pytest.raises(ValueError, match="with worlds = 2, got worlds = 3"):
        set_state(two, get_state(gym.make_vec(ORION, num_envs=3)))
    with pytest.raises(ValueError, match="autoreset_mode = 'NextStep', got autoreset_mode = 'Disabled'"):
        set_state(two, get_state(gym.make_vec(ORION, num_envs=2, autoreset_mode="Disabled")))


def test_other_faults_are_taken():
    env, other = gym.make(ORION, faults=[{"thruster": 3, "kind": "leak"}]), gym.make(ORION)
    env.reset(seed=0)
    set_state(other, get_state(env))
    assert other.step(np.zeros(12))[-1]["fault"]["thruster"][0] == 3
    assert other.reset()[1]["fault"]["thruster"][0] == 0  # the next episode has its own


def test_a_wrapper_that_nobody_knows_is_named():
    env = FrameStackObservation(gym.make(ORION), 2)
    env.reset(seed=0)
    with pytest.raises(TypeError, match=r"what FrameStackObservation remembers .* env\.unwrapped"):
        get_state(env)
    other = fork(env)
    assert all_the_same(env.step(np.zeros(12)), other.step(np.zeros(12)))
    with pytest.raises(TypeError, match="must be an environment of thruster_envs"):
        get_state(gym.make("CartPole-v1"))
    assert equal(get_state(env.unwrapped), env.unwrapped.get_state())
