"""Stable-Baselines3 sees last observations and time limits as they are; its targets are right by value."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from tests.views.cases import FAULTS, IDS, constant, faults_of, has_options
from thruster_envs.views import SB3VecEnv, SharedPolicyVecEnv

GAMMA, STEPS, LIMIT = 0.9, 60, 12


def bootstrapped(model, env_actions, twin, steps):
    """Rewards that PPO ought to have stored: with the value of the last observation after a time limit.

    ``twin`` gives (rewards, terminated, truncated, last observations) for an action.
    """
    rewards = []
    for step in range(steps):
        reward, terminated, truncated, last = twin(env_actions[step])
        reward = reward.astype(np.float32)
        for world in np.flatnonzero(truncated & ~terminated):
            with torch.no_grad():
                value = model.policy.predict_values(torch.as_tensor(last[world][None]))
            reward[world] += GAMMA * float(value[0, 0])
        rewards.append(reward)
    return np.array(rewards)


def collect(env):
    """A model after one rollout, from which it has not yet learnt."""
    torch.manual_seed(0)
    model = PPO(
        "MlpPolicy", env, n_steps=STEPS, batch_size=STEPS, n_epochs=1, gamma=GAMMA, gae_lambda=1.0,
        seed=5, device="cpu",
    )  # fmt: skip
    model.train = lambda: None
    model.learn(STEPS * env.num_envs)
    return model


def returns_by_hand(model, rewards, dones, last_value):
    """Discounted returns (GAE with lambda 1, plus value): reward and what follows in the episode."""
    following, returns = last_value, np.zeros_like(rewards, np.float64)
    for step in reversed(range(len(rewards))):
        following = np.where(dones[step], 0.0, following)
        returns[step] = following = rewards[step] + GAMMA * following
    return returns


@pytest.mark.parametrize("identifier", IDS)
def test_targets_of_ppo_bootstrap_over_time_limits_and_not_over_endings(identifier):
    make = lambda mode: gym.make_vec(  # noqa: E731  # two like environments
        identifier, num_envs=4, faults=faults_of(identifier), max_episode_steps=LIMIT, autoreset_mode=mode
    )
    model = collect(SB3VecEnv(make("NextStep")))
    buffer, twin = model.rollout_buffer, make("SameStep")
    twin.reset(seed=[5, 6, 7, 8])
    dones, endings = [], {"terminated": 0, "truncated": 0}

    def step(action):
        observations, rewards, terminated, truncated, infos = twin.step(action)
        done = terminated | truncated
        dones.append(done)
        endings["terminated"] += np.count_nonzero(terminated)
        endings["truncated"] += np.count_nonzero(truncated & ~terminated)
        return rewards, terminated, truncated, infos["final_obs"] if done.any() else observations

    options = has_options(model.action_space)
    actions = buffer.actions if options else np.clip(buffer.actions, -1.0, 1.0)
    rewards = bootstrapped(model, actions, step, STEPS)
    assert endings["truncated"] >= 4
    np.testing.assert_allclose(buffer.rewards, rewards, rtol=1e-6, atol=1e-6)  # both float32
    with torch.no_grad():
        last = model.policy.predict_values(torch.as_tensor(model._last_obs)).numpy()[:, 0]
    expected = returns_by_hand(model, rewards, dones, last)
    np.testing.assert_allclose(buffer.returns, expected, rtol=1e-4, atol=1e-4)  # float32 sums of 60 terms


def test_an_ending_of_its_own_is_not_taken_for_a_time_limit():
    env = SB3VecEnv(gym.make_vec("thruster_envs/OrionRendezvous-v0", num_envs=8, max_episode_steps=400))
    env.seed(0)
    env.reset()
    spin = np.full((8, 12), -1.0, np.float32)
    spin[:, :4] = 1.0
    ended = 0
    for _ in range(100):
        _, _, dones, infos = env.step(spin)
        for world in np.flatnonzero(dones):
            ended += 1
            assert infos[world]["TimeLimit.truncated"] is False
            assert infos[world]["success"] is False
    assert ended


@pytest.mark.parametrize("identifier", IDS)
def test_infos_carry_the_last_observation_and_the_score(identifier):
    vector = gym.make_vec(identifier, num_envs=3, faults=faults_of(identifier), max_episode_steps=5)
    env, alone = SB3VecEnv(vector), gym.make(identifier, faults=faults_of(identifier), max_episode_steps=5)
    assert vector.unwrapped.autoreset_mode == AutoresetMode.SAME_STEP
    env.seed(20)
    assert np.array_equal(env.reset()[1], alone.reset(seed=21)[0])
    for step in range(1, 6):
        action = np.stack(3 * [constant(identifier, -0.95)])
        observations, rewards, dones, infos = env.step(action)
        observation, reward, _, _, info = alone.step(action[1])
        assert rewards[1] == np.float32(reward)
        if step < 5:
            assert infos == [{}, {}, {}]
            assert np.array_equal(observations[1], observation)
    assert dones.all()
    assert np.array_equal(infos[1]["terminal_observation"], observation)
    assert infos[1]["TimeLimit.truncated"] is True
    assert {key: infos[1][key] for key in ("score", "success", "cost", "fuel")} == {
        key: info[key] for key in ("score", "success", "cost", "fuel")
    }
    assert np.array_equal(observations[1], alone.reset()[0])


def test_vec_monitor_reports_scores():
    env = VecMonitor(
        SB3VecEnv(gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=4)),
        info_keywords=("score", "success"),
    )
    env.reset()
    for _ in range(32):
        _, _, dones, infos = env.step(np.zeros((4, 12), np.float32))
    assert dones.all()
    for info in infos:
        assert info["episode"]["l"] == 32
        assert 0.0 <= info["episode"]["score"] <= 1.0


def test_an_unlike_environment_must_reset_in_the_same_step():
    with pytest.raises(ValueError, match="SAME_STEP"):
        SB3VecEnv(gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync"))
    theirs = gym.make_vec(
        "CartPole-v1", num_envs=2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": "SameStep"}
    )
    env = SB3VecEnv(theirs)
    env.seed(0)
    assert env.reset().shape == (2, 4)
    ended = False
    for _ in range(60):
        _, _, dones, infos = env.step(np.ones(2, np.int64))
        ended |= bool(dones.any())
        assert all("terminal_observation" in infos[i] for i in np.flatnonzero(dones))
    assert ended


def test_pictures_and_attributes_come_through():
    env = SB3VecEnv(gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=2, render_mode="rgb_array"))
    env.reset()
    assert [image.ndim for image in env.get_images()] == [3, 3]
    assert env.get_attr("render_mode") == ["rgb_array", "rgb_array"]
    assert env.env_is_wrapped(VecMonitor) == [False, False]
    with pytest.raises(AttributeError, match="faults"):
        env.set_attr("faults", [])
    env.close()


# ---- Formations under one policy ---------------------------------------------------------------------------


def test_the_shared_policy_bootstraps_over_time_limits_by_value():
    make = lambda: SharedPolicyVecEnv(2, max_episode_steps=LIMIT, craft=2, faults=FAULTS)  # noqa: E731
    model = collect(make())
    buffer, twin = model.rollout_buffer, make()
    twin.seed(5)
    twin.reset()
    actions = np.clip(buffer.actions, -1.0, 1.0)
    dones, cut = [], 0

    def step(action):
        nonlocal cut
        worlds = twin.worlds
        lived = worlds.step(action.reshape(2, 2, 12))
        over = np.flatnonzero(lived.done)
        if over.size:
            worlds.reset(over)
        dones.append(np.repeat(lived.done, 2))
        cut += np.count_nonzero(lived.truncated & ~lived.terminated)
        flags = np.repeat(lived.terminated, 2), np.repeat(lived.truncated, 2)
        return lived.rewards.reshape(-1), *flags, lived.observations.reshape(4, -1)

    rewards = bootstrapped(model, actions, step, STEPS)
    assert cut >= 2
    np.testing.assert_allclose(buffer.rewards, rewards, rtol=1e-6, atol=1e-6)
    with torch.no_grad():
        last = model.policy.predict_values(torch.as_tensor(model._last_obs)).numpy()[:, 0]
    np.testing.assert_allclose(
        buffer.returns, returns_by_hand(model, rewards, dones, last), rtol=1e-4, atol=1e-4
    )


def test_all_craft_of_a_formation_end_together_each_with_its_own_last_observation():
    env = SharedPolicyVecEnv(3, max_episode_steps=4)
    env.seed(0)
    first = env.reset()
    assert first.shape == (9, env.observation_space.shape[0])
    for _ in range(4):
        observations, _, dones, infos = env.step(np.full((9, 12), -0.9, np.float32))
    assert dones.all()
    assert all(info["TimeLimit.truncated"] is True for info in infos)
    last = np.stack([info["terminal_observation"] for info in infos])
    assert len(np.unique(last, axis=0)) == 9
    assert not np.array_equal(last, observations)


def test_ppo_learns_on_every_task_without_a_complaint():
    for identifier in IDS:
        env = VecMonitor(
            SB3VecEnv(
                gym.make_vec(identifier, num_envs=8, max_episode_steps=20, faults=faults_of(identifier))
            )
        )
        PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1, seed=0, device="cpu").learn(512)
