"""Stable-Baselines3 sees last observations and time limits as they are; its targets are right by value."""

import copy

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from tests.views.cases import FAULTS, IDS, constant, faults_of, has_options
from thruster_baselines.mapping import LPMapper
from thruster_envs.faults import Fault
from thruster_envs.views import SB3VecEnv, SharedPolicyVecEnv, VectorHoldAction, VectorMapperAction

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
    actions = actions.reshape((*actions.shape[:2], *model.action_space.shape))
    rewards = bootstrapped(model, actions, step, STEPS)
    assert endings["truncated"] >= 4
    np.testing.assert_allclose(buffer.rewards, rewards, rtol=1e-6, atol=1e-6)  # both float32
    with torch.no_grad():
        last = model.policy.predict_values(torch.as_tensor(model._last_obs)).numpy()[:, 0]
    expected = returns_by_hand(model, rewards, dones, last)
    np.testing.assert_allclose(buffer.returns, expected, rtol=1e-4, atol=1e-4)  # float32 sums of 60 terms


def test_an_ending_of_its_own_is_not_taken_for_a_time_limit():
    env = SB3VecEnv(gym.make_vec("thruster_envs/OrionRendezvous-v1", num_envs=8, max_episode_steps=400))
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
    told = {key: infos[1].pop(key) for key in ("terminal_observation", "TimeLimit.truncated")}
    assert data_equivalence(infos[1], info, exact=True)
    assert set(told) == {"terminal_observation", "TimeLimit.truncated"}
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


class Still:
    """A model as ``evaluate_policy`` wants one, that does nothing."""

    def predict(self, observation, **_):
        return np.full((len(observation), 12), -1.0, np.float32), None


def test_evaluation_reads_success_and_everything_else_at_the_end_of_an_episode():
    env = VecMonitor(
        SB3VecEnv(gym.make_vec(
            "thruster_envs/FormationKeeping-v1", num_envs=3, max_episode_steps=2, keep_out=1e-3,
            slot_tolerance=50.0, faults=[],
        )),
        info_keywords=("is_success", "reward_terms", "state"),
    )  # fmt: skip
    env.seed(0)
    evaluation = EvalCallback(env)
    _, lengths = evaluate_policy(
        Still(), env, n_eval_episodes=6, return_episode_rewards=True,
        callback=evaluation._log_success_callback,
    )  # fmt: skip
    assert lengths == [2] * 6
    assert evaluation._is_success_buffer == [True] * 6


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


# ---- Wrappers that are there already -----------------------------------------------------------------------

FORMATION = "thruster_envs/FormationKeeping-v1"


def formation(mode, *wrappers, worlds=3, limit=4, **kwargs):
    env = gym.make_vec(
        FORMATION, num_envs=worlds, max_episode_steps=limit, autoreset_mode=mode, faults=FAULTS, **kwargs
    )
    for wrapper in wrappers:
        env = wrapper(env)
    return env


def flown(env, steps=12):
    """What an SB3 environment gives under the same actions, the last observations among it."""
    generator, space = np.random.default_rng(0), env.action_space.shape
    env.seed(3)
    seen = [env.reset()]
    for _ in range(steps):
        actions = generator.uniform(-1.0, -0.5, (env.num_envs, *space)).astype(np.float32)
        observations, rewards, dones, infos = env.step(actions)
        seen += [observations, rewards, dones]
        seen += [info["terminal_observation"] for info in infos if "terminal_observation" in info]
    return seen


def test_statistics_of_episodes_are_right_or_refused():
    with pytest.raises(ValueError, match=r'RecordEpisodeStatistics.* make the environment with .*"SameStep"'):
        SB3VecEnv(formation("NextStep", wrappers.RecordEpisodeStatistics))
    env = SB3VecEnv(formation("SameStep", wrappers.RecordEpisodeStatistics))
    env.seed(0)
    env.reset()
    returns = np.zeros(3)
    for step in range(1, 13):
        _, rewards, dones, infos = env.step(np.full((3, 12), -0.9, np.float32))
        returns += rewards
        assert dones.all() == (step % 4 == 0)
        if dones.all():
            assert [info["episode"]["l"] for info in infos] == [4, 4, 4]
            np.testing.assert_allclose([info["episode"]["r"] for info in infos], returns, rtol=1e-5)
            returns[:] = 0.0


def twice(env):
    return wrappers.TransformReward(env, lambda rewards: 2.0 * rewards)


INDIFFERENT = {
    "nothing": (),
    "rewards": (twice, lambda env: wrappers.ClipReward(env, -0.5, 0.5)),
    "actions": (
        lambda env: wrappers.RescaleAction(env, np.float32(-2.0), np.float32(2.0)),
        wrappers.ClipAction,
    ),
    "mapper": (lambda env: VectorMapperAction(env, LPMapper("orion", threads=1)), twice),
    "hold": (lambda env: VectorHoldAction(env, 2), twice),
}


@pytest.mark.parametrize("name", INDIFFERENT)
def test_wrappers_that_take_any_mode_give_the_same_in_every_mode_they_were_made_in(name):
    first, *others = (flown(SB3VecEnv(formation(mode, *INDIFFERENT[name]))) for mode in AutoresetMode)
    for other in others:
        assert len(first) == len(other)
        assert all(np.array_equal(one, two) for one, two in zip(first, other, strict=True))


class Doubled(gym.vector.VectorWrapper):
    """Doubles observations, but not the last ones of an episode."""

    def reset(self, **kwargs):
        observations, infos = self.env.reset(**kwargs)
        return 2.0 * observations, infos

    def step(self, actions):
        observations, *others = self.env.step(actions)
        return 2.0 * observations, *others


class DoubledInPlace(gym.vector.VectorWrapper):
    def step(self, actions):
        result = self.env.step(actions)
        result[0][...] *= 2.0
        return result


class DoubledOnTheWay(Doubled):
    """First observations stay as they are, so those of the step in which all episodes end do too."""

    def reset(self, **kwargs):
        return self.env.reset(**kwargs)

    def step(self, actions):
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        running = ~(terminated | truncated)[:, np.newaxis]
        return np.where(running, 2.0 * observations, observations), rewards, terminated, truncated, infos


class DoubledToTheEnd(Doubled):
    def step(self, actions):
        *others, infos = super().step(actions)
        if "final_obs" in infos:
            infos["final_obs"] = 2.0 * infos["final_obs"]
        return *others, infos


class Copied(Doubled):
    def step(self, actions):
        *others, infos = super().step(actions)
        return *others, copy.deepcopy(infos)


class Counted(gym.vector.VectorWrapper):
    steps = 0

    def step(self, actions):
        self.steps += 1
        return self.env.step(actions)


WRONG = [Doubled, DoubledInPlace, DoubledOnTheWay, Copied]


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("inside", [(), (DoubledToTheEnd,), (Counted,), (wrappers.NormalizeReward,)])
@pytest.mark.parametrize("outside", [(), (DoubledToTheEnd,), (wrappers.RecordEpisodeStatistics,)])
def test_a_wrapper_that_leaves_last_observations_as_they_are_is_noticed(wrong, inside, outside):
    with pytest.raises(ValueError, match=f"{wrong.__name__} changes observations, but not those at the end"):
        flown(SB3VecEnv(formation("SameStep", *inside, wrong, *outside)), 4)


def test_terminal_observations_are_what_ones_own_wrapper_makes_of_them():
    plain = flown(SB3VecEnv(formation("SameStep")))
    env = formation("SameStep", Counted, DoubledToTheEnd, wrappers.RecordEpisodeStatistics)
    doubled = flown(SB3VecEnv(env))
    for one, two in zip(plain, doubled, strict=True):
        observed = one.dtype == np.float32 and one.shape[-1] > 3
        assert np.array_equal(2.0 * one if observed else one, two)
    with pytest.raises(ValueError, match=r"Doubled.* was not made for the autoreset mode"):
        SB3VecEnv(formation("NextStep", DoubledToTheEnd))
    wrapped = formation("NextStep", wrappers.NormalizeReward)
    wrapped.unwrapped.set_autoreset_mode("SameStep")
    with pytest.raises(ValueError, match="NormalizeReward was not made for"):
        SB3VecEnv(wrapped)


@pytest.mark.parametrize(
    "wrapper",
    [
        wrappers.FlattenObservation,
        wrappers.NormalizeObservation,
        lambda env: wrappers.DtypeObservation(env, np.float32),
        lambda env: wrappers.TransformObservation(env, lambda observations: 2.0 * observations),
    ],
)
def test_gymnasiums_wrappers_for_observations_are_refused_with_what_to_do(wrapper):
    with pytest.raises(ValueError, match=r"does not work in the autoreset mode SAME_STEP.*VecNormalize"):
        SB3VecEnv(formation("NextStep", wrapper))


def test_a_change_of_the_mode_ends_the_episodes_that_run():
    env = formation("NextStep")
    env.reset(seed=0)
    env.step(np.zeros((3, 12)))
    env.set_autoreset_mode("Disabled")
    with pytest.raises(gym.error.ResetNeeded, match=r"call reset\(\) before step\(\)"):
        env.step(np.zeros((3, 12)))
    with pytest.raises(ValueError, match="reset all of them first"):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    env.reset()
    env.step(np.zeros((3, 12)))


# ---- Success -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("monitored", [False, True])
def test_a_success_rate_is_logged(monitored, tmp_path):
    env = SB3VecEnv(gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=4, max_episode_steps=8))
    model = PPO("MlpPolicy", VecMonitor(env) if monitored else env, n_steps=16, batch_size=64, device="cpu")
    model.set_logger(configure(str(tmp_path), ["csv"]))
    model.learn(64)
    assert len(model.ep_success_buffer) == 8
    model.logger.close()
    assert "rollout/success_rate" in (tmp_path / "progress.csv").read_text().splitlines()[0]


def test_evaluations_log_a_success_rate(tmp_path):
    make = lambda: Monitor(gym.make("thruster_envs/FormationKeeping-v1", max_episode_steps=6))  # noqa: E731
    worlds = SB3VecEnv(gym.make_vec("thruster_envs/FormationKeeping-v1", num_envs=2, max_episode_steps=6))
    for env in (DummyVecEnv([make]), VecMonitor(worlds)):
        model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu")
        callback = EvalCallback(env, n_eval_episodes=4, eval_freq=4, log_path=str(tmp_path), verbose=0)
        model.learn(8, callback=callback)
        assert len(callback._is_success_buffer) == 4
        assert np.load(tmp_path / "evaluations.npz")["successes"].shape[1] == 4


# ---- Options and calls for some rows -----------------------------------------------------------------------


def thrusters(env):
    return env.latest_info()["fault"]["thruster"][..., 0].tolist()


def failing(*thrusters, craft=1):
    return {"faults": [{"thruster": thruster, "kind": "stuck_off", "craft": craft} for thruster in thrusters]}


def test_every_world_has_the_options_of_its_own():
    env = SB3VecEnv(formation("NextStep"))
    env.set_options([failing(1), failing(2), failing(3)])
    env.reset()
    assert thrusters(env) == [1, 2, 3]
    env = SB3VecEnv(gym.make_vec(FORMATION, num_envs=3, faults=failing(7)["faults"]))
    for options, expected in (
        ([{}, failing(2), {}], [7, 2, 7]),
        ([None, failing(2), {"faults": []}], [7, 2, 0]),
        ([{"faults": None}, {"faults": Fault(5, "leak")}, {"faults": Fault(6, "leak")}], [0, 5, 6]),
        (failing(4), [4, 4, 4]),
        (None, [7, 7, 7]),
    ):
        env.set_options(options)
        env.reset()
        assert thrusters(env) == expected
    env.reset()
    assert thrusters(env) == [7, 7, 7]
    for options, message in (
        ([{}], "must have 3 entries, one for each row, got 1"),
        ("faults", "must be a dict, or a list"),
        ([1, 2, 3], "must be a dict, or a list"),
    ):
        with pytest.raises(ValueError, match=message):
            env.set_options(options)
    env.set_options([{"a": 1}, {}, {}])
    with pytest.raises(ValueError, match="differ from row to row"):
        env.reset()


def test_every_formation_has_the_options_of_its_first_row():
    env = SharedPolicyVecEnv(2, craft=2, faults=failing(7, craft=2)["faults"])
    for options, expected in (
        ([failing(3), {}, {}, {}], [[3, 0], [0, 7]]),
        ([{}, {}, failing(4, craft=2), failing(4, craft=2)], [[0, 7], [0, 4]]),
        (failing(5), [[5, 0], [5, 0]]),
    ):
        env.set_options(options)
        env.reset()
        assert thrusters(env) == expected
    env.set_options([failing(1), failing(2), {}, {}])
    with pytest.raises(ValueError, match="the options of row 1 are not those of its world's first row, 0"):
        env.reset()


def test_a_method_acts_on_the_rows_it_is_given_or_refuses():
    env = SB3VecEnv(formation("NextStep", limit=50))
    alone = gym.make(FORMATION, faults=FAULTS)
    env.seed(0)
    env.reset()
    action = np.full((3, 12), -0.9, np.float32)
    env.step(action)
    ((observation, info),) = env.env_method("reset", indices=[0], seed=11, options=failing(4))
    assert np.array_equal(observation, alone.reset(seed=11, options=failing(4))[0])
    assert info["fault"]["thruster"][0] == 4
    assert env.get_attr("worlds", 0)[0].steps.tolist() == [0, 1, 1]
    assert [row[0].shape for row in env.env_method("reset")] == 3 * [observation.shape]
    assert env.get_attr("worlds")[0].steps.tolist() == [0, 0, 0]
    with pytest.raises(ValueError, match="save_state acts on all 3 rows at once"):
        env.env_method("save_state", indices=[1])
    with pytest.raises(IndexError, match="indices must be from 0 to 2, got 3"):
        env.get_attr("worlds", 3)
    shared = SharedPolicyVecEnv(2, craft=2)
    shared.reset()
    shared.step(np.full((4, 12), -0.9, np.float32))
    assert len(shared.env_method("reset", indices=[2, 3])) == 2
    assert shared.worlds.steps.tolist() == [1, 0]
    with pytest.raises(ValueError, match="rows of one world are reset together"):
        shared.env_method("reset", indices=[2])


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
    told = env.latest_info()
    for row, info in enumerate(infos):
        assert info["reward_terms"]["fuel"] == told["reward_terms"]["fuel"][divmod(row, 3)]
        assert np.array_equal(info["state"]["position"], told["state"]["position"][divmod(row, 3)])
        assert type(info["is_success"]) is bool
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
