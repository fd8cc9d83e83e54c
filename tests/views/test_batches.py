"""World i of a batch seeded s lives through what a single environment seeded s + i does, to the last bit."""

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import IDS, actions_of, entries, equal, faults_of, world_of

STEPS, LIMIT, SEED = 500, 40, 2**40 + 7


def live_alone(identifier, world):
    """What a single environment returns, step by step, with a reset after every ending."""
    env = gym.make(identifier, faults=faults_of(identifier), max_episode_steps=LIMIT)
    observation, info = env.reset(seed=SEED + world)
    yield observation, None, False, False, dict(entries(info)), None, None
    for action in actions_of(identifier, world, STEPS):
        observation, reward, terminated, truncated, info = env.step(action)
        final, final_info = None, None
        if terminated or truncated:
            final, final_info = observation, dict(entries(info))
            observation, info = env.reset()
        yield observation, reward, terminated, truncated, dict(entries(info)), final, final_info


@pytest.mark.parametrize("identifier", IDS)
@pytest.mark.parametrize(("worlds", "threads"), [(1, 1), (7, 1), (7, 2), (1024, 1), (1024, 2)])
def test_a_world_of_a_batch_is_a_single_environment(identifier, worlds, threads):
    watched = range(worlds) if worlds < 10 else (0, 1, 31, 32, 511, 512, 1023)
    env = gym.make_vec(
        identifier,
        num_envs=worlds,
        faults=faults_of(identifier),
        max_episode_steps=LIMIT,
        autoreset_mode="SameStep",
        threads=threads,
    )
    actions = np.stack([actions_of(identifier, world, STEPS) for world in range(worlds)], axis=1)
    alone = {world: live_alone(identifier, world) for world in watched}
    observations, infos = env.reset(seed=SEED)
    for world in watched:
        observation, *_, info, _, _ = next(alone[world])
        assert np.array_equal(observation, observations[world])
        assert equal(world_of(infos, world), info)
    episodes = 0
    for step in range(STEPS):
        observations, rewards, terminated, truncated, infos = env.step(actions[step])
        for world in watched:
            observation, reward, ends, is_cut, info, final, final_info = next(alone[world])
            assert (rewards[world], terminated[world], truncated[world]) == (reward, ends, is_cut), step
            assert np.array_equal(observations[world], observation), step
            assert equal(world_of(infos, world), info), step
            if final is not None:
                episodes += 1
                assert infos["_final_obs"][world]
                assert infos["_final_info"][world]
                assert np.array_equal(infos["final_obs"][world], final), step
                assert equal(world_of(infos["final_info"], world), final_info), step
    assert episodes >= 12 * len(list(watched))


@pytest.mark.parametrize("identifier", IDS)
def test_next_step_autoreset_gives_the_same_episodes(identifier):
    same = gym.make_vec(
        identifier,
        num_envs=3,
        faults=faults_of(identifier),
        max_episode_steps=LIMIT,
        autoreset_mode="SameStep",
    )
    later = gym.make_vec(identifier, num_envs=3, faults=faults_of(identifier), max_episode_steps=LIMIT)
    lived = {name: [[] for _ in range(3)] for name in ("same", "later")}
    for name, env in (("same", same), ("later", later)):
        env.reset(seed=SEED)
        used, resetting = [0, 0, 0], np.zeros(3, bool)
        actions = [actions_of(identifier, world, 200) for world in range(3)]
        while min(used) < 100:
            chosen = np.stack([actions[world][used[world]] for world in range(3)])
            observations, rewards, terminated, truncated, infos = env.step(chosen)
            done = terminated | truncated
            for world in range(3):
                if resetting[world]:
                    assert rewards[world] == 0.0
                    assert not done[world]
                    continue
                used[world] += 1
                last = infos["final_obs"][world] if name == "same" and done[world] else observations[world]
                lived[name][world].append(
                    (last.tobytes(), rewards[world], terminated[world], truncated[world])
                )
            resetting = done if name == "later" else np.zeros(3, bool)
    for world in range(3):
        assert lived["same"][world][:100] == lived["later"][world][:100]


@pytest.mark.parametrize("identifier", IDS)
def test_a_saved_batch_goes_on_as_it_would_have(identifier):
    env = gym.make_vec(identifier, num_envs=7, faults=faults_of(identifier), max_episode_steps=LIMIT)
    other = gym.make_vec(identifier, num_envs=7, faults=faults_of(identifier), max_episode_steps=LIMIT)
    actions = np.stack([actions_of(identifier, world, 120) for world in range(7)], axis=1)
    env.reset(seed=SEED)
    for step in range(45):
        env.step(actions[step])
    saved = env.unwrapped.save_state()
    other.reset(seed=1)
    other.unwrapped.restore_state(saved)
    for step in range(45, 120):
        one, two = env.step(actions[step]), other.step(actions[step])
        for a, b in zip(one[:4], two[:4], strict=True):
            assert np.array_equal(a, b)
        assert equal(dict(entries(one[4])), dict(entries(two[4])))


def test_a_state_of_other_worlds_is_refused():
    identifier = "thruster_envs/MarsRendezvous-v1"
    saved = gym.make_vec(identifier, num_envs=3).unwrapped.save_state()
    with pytest.raises(ValueError, match=r"the saved .* has the shape .*; .* would be right"):
        gym.make_vec(identifier, num_envs=2).unwrapped.restore_state(saved)
    del saved["seeded"]
    with pytest.raises(ValueError, match=r"the saved seeded has the shape None; \(\) would be right"):
        gym.make_vec(identifier, num_envs=3).unwrapped.restore_state(saved)
