"""What is recorded is what was flown, in whatever view and mode, and it comes back from files bit for bit."""

from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import FAULTS, IDS, craft_of, entries, faults_of
from thruster_baselines.mapping import LPMapper
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.physics import rows as at
from thruster_envs.recordings import Channel
from thruster_envs.rollout import Interrupted, Moment, Recording, concatenate, fly
from thruster_envs.spacecraft import load
from thruster_envs.views import VectorHoldAction, VectorMapperAction, fork

ORION, MAPPING = "thruster_envs/OrionRendezvous-v1", "thruster_envs/ThrusterMapping-v0"
DIAGNOSIS = "thruster_envs/FaultDiagnosis-v1"


def assert_same(one: Recording, other: Recording) -> None:
    assert one.channels == other.channels
    assert one.seeds == other.seeds
    assert one.lengths.tolist() == other.lengths.tolist()
    for name, array in one.arrays.items():
        assert array.dtype == other[name].dtype
        assert array.tobytes() == other[name].tobytes(), name


@pytest.mark.parametrize("identifier", IDS)
def test_an_episode_is_what_a_loop_by_hand_sees(identifier):
    recording = fly(identifier, seeds=7, steps=9, options={"faults": faults_of(identifier)})
    env = gym.make(identifier)
    env.action_space.seed(7)
    observation, info = env.reset(seed=7, options={"faults": faults_of(identifier)})
    worlds, k = env.unwrapped.worlds, 0
    n, own = worlds.task.vehicle.number_of_thrusters, craft_of(identifier) - 1
    while True:
        assert np.array_equal(recording.observation[k], observation)
        assert recording.time[k] == k * worlds.task.vehicle.control_period
        for name, value in entries(info):
            name = name.replace(".", "/")
            if name.startswith("state/"):  # of the commanded craft, where a recording has all of them
                assert np.array_equal(np.atleast_2d(recording[name[6:]][k])[own], value), name
            elif name != "is_success" and not name.startswith(("reward_terms", "cost")):
                there = recording[name]
                per = recording.channels[name].per
                assert np.array_equal(there[0] if per == "episode" else there[k], value), name
        if worlds.task.flies:
            truth = worlds.fleet.read(at.POSITION, 13)[0]
            split = np.split(truth, [3, 6, 10], axis=-1)
            for name, true in zip(("position", "velocity", "attitude", "rate"), split, strict=True):
                assert np.array_equal(np.atleast_2d(recording[name][k]), true)
        if k == len(recording.reward):
            break
        action = env.action_space.sample()
        observation, reward, terminated, _, info = env.step(action)
        assert np.array_equal(recording.action[k], action)
        assert recording.reward[k] == reward == sum(info["reward_terms"].values())
        assert recording.cost[k] == info["cost"]
        assert {name: one[k] for name, one in recording.reward_terms.items()} == info["reward_terms"]
        if "duty" in recording.channels:
            duties = worlds.fleet.read(worlds.fleet.rows.duties, 2 * n)[0]
            assert np.array_equal(np.atleast_2d(recording.duty[k]), duties[:, :n])
            assert np.array_equal(np.atleast_2d(recording.delivered[k]), duties[:, n:])
            if worlds.task.choices is None and worlds.task.first_commanded == 0:
                assert np.allclose(np.atleast_2d(recording.duty[k])[own], 0.5 * action[:n] + 0.5)
        k += 1
        assert recording.terminated[k - 1] == terminated
    assert recording.lengths.tolist() == [k]


@pytest.mark.parametrize("identifier", IDS)
def test_a_batch_records_what_single_environments_do(identifier):
    settings = {"steps": 25, "faults": faults_of(identifier)}
    together = fly(identifier, seeds=range(3, 6), **settings)
    alone = [fly(identifier, seeds=seed, **settings) for seed in range(3, 6)]
    assert_same(together, concatenate(alone))
    assert_same(together[1], alone[1])
    assert_same(fly(identifier, "idle", [3], **settings), fly(identifier, "idle", 3, **settings))
    assert_same(fly(identifier, seeds=range(3, 6), together=2, **settings), together)
    assert_same(fly(gym.make(identifier, faults=settings["faults"]), seeds=[3, 4, 5], steps=25), together)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_the_end_of_an_episode_is_recorded_in_each_mode(mode):
    seeds = range(6)
    expected = fly(ORION, seeds=seeds, steps=40, faults=FAULTS)
    assert len(set(expected.lengths.tolist())) > 2  # some are lost early
    env = gym.make_vec(ORION, num_envs=3, faults=FAULTS, autoreset_mode=mode)
    assert_same(fly(env, seeds=seeds, steps=40), expected)
    ended = expected.lengths < 40
    assert np.array_equal(expected.final("terminated"), ended)
    assert np.array_equal(np.linalg.norm(expected.final("rate"), axis=1) > 0.95, ended)


def test_a_flight_may_go_on_past_its_end():
    short = fly(ORION, seeds=range(6), steps=40, faults=FAULTS)
    whole = fly(ORION, seeds=range(6), steps=40, faults=FAULTS, past_end=True)
    assert whole.lengths.tolist() == [40] * 6
    for some, all_of_it in zip(short, whole, strict=True):
        assert np.array_equal(all_of_it.position[: len(some.position)], some.position)
        assert np.argmax(all_of_it.terminated) + 1 == some.lengths[0] or some.lengths[0] == 40


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_held_action_is_recorded_as_one_step(mode):
    env = VectorHoldAction(gym.make_vec(ORION, num_envs=3, faults=FAULTS, autoreset_mode=mode), 4)
    held = fly(env, "random", seeds=0, steps=10)
    for flight in held:
        steps = np.diff(flight.time)
        assert (steps[:-1] == 20.0).all()
        assert steps[-1] in (5.0, 10.0, 15.0, 20.0)
        long = np.repeat(flight.action, 4, axis=0)[: round(flight.time[-1] / 5.0)]
        alone = fly(ORION, Played(long), flight.seeds[0], steps=len(long), faults=FAULTS)
        assert np.array_equal(alone.final("position"), flight.final("position"))
        assert np.isclose(alone.returns, flight.returns)


class Played:
    """Actions that are known beforehand."""

    def __init__(self, actions):
        self.actions = actions

    def reset(self):
        self.left = iter(self.actions)

    def __call__(self, observation):
        return next(self.left)


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_agents_are_an_axis(module):
    env = module.parallel_env(max_cycles=6)
    recording = fly(env, seeds=[1, 2])
    agents = len(env.possible_agents)
    assert recording.reward.shape[1:] == (agents,)
    assert recording.observation.shape[1] == agents
    assert recording.channels["reward"].labels == (tuple(env.possible_agents),)
    assert recording.channels["position"].labels[0] == ("1", "2", "3")
    with pytest.raises(ValueError, match="policy by agent must have one for each of"):
        fly(env, {"nobody": np.zeros}, 0)
    idle = fly(env, "idle", 3)
    doing_nothing = {
        agent: (lambda seen, action=action: action)
        for agent, action in zip(env.possible_agents, idle.action[0], strict=True)
    }
    assert_same(fly(env, doing_nothing, 3), idle)
    assert idle.metadata["environment"] == module.__name__.removeprefix("thruster_envs.")


class Belief(NamedTuple):
    share: np.ndarray
    stuck: np.ndarray


class Believer:
    """Fires nothing, and believes the number of the step."""

    def reset(self):
        self.calls = 0

    def __call__(self, observations):
        self.calls += 1
        self.belief = Belief(np.full((len(observations), 2), self.calls), np.zeros(len(observations), bool))
        return np.full((len(observations), 12), -1.0)


def test_a_belief_is_recorded_with_the_decision():
    recording = fly(ORION, Believer(), seeds=[0, 1], steps=3)
    assert recording[1].belief["share"].tolist() == [[1, 1], [2, 2], [3, 3]]
    assert recording.channels["belief/stuck"] == Channel("step")
    policy = Believer()
    policy.reset()
    with pytest.raises(ValueError, match=r"belief must have a row for each of 2 worlds, got \(3,\)"):
        fly(ORION, with_belief(np.zeros(3)), seeds=[0, 1], steps=1)
    assert fly(ORION, with_belief(np.zeros(3)), seeds=0, steps=1).belief.shape == (1, 3)


def with_belief(belief):
    def act(observation):
        return np.full((*observation.shape[:-1], 12), -1.0)

    act.belief = belief
    return act


class Remembering:
    """As Stable-Baselines3 has it: a state that goes from call to call."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        state = 0 if state is None else state + 1
        return np.full((len(observation), 12), -1.0 if deterministic else 0.1 * state), state


def test_a_model_with_predict_flies():
    shut = fly(ORION, Remembering(), seeds=[0, 1], steps=3)
    assert (shut.action == -1.0).all()
    opened = fly(ORION, Remembering(), seeds=[0, 1], steps=3, deterministic=False)
    assert np.allclose(opened[1].action[:, 0], [0.0, 0.1, 0.2])
    assert shut.metadata["policy"].endswith(":Remembering")


def test_a_policy_for_each_episode_sees_its_world_alone():
    known = fly(ORION, seeds=[0, 1, 2], steps=30, faults=FAULTS)
    env = gym.make_vec(ORION, num_envs=3, faults=FAULTS)
    for where in (env, gym.make(ORION, faults=FAULTS)):
        policies = [Played(flight.action) for flight in known]  # raises StopIteration if asked too often
        assert_same(fly(where, policies, [0, 1, 2], steps=30), known)
    with pytest.raises(ValueError, match="one entry for each of 3 episodes, got 2"):
        fly(env, policies[:2], [0, 1, 2])


def test_a_callback_sees_each_moment_and_can_end_it():
    moments: list[Moment] = []

    def watch(moment):
        moments.append(moment)
        return moment.step < 4

    recording = fly(ORION, "idle", seeds=0, callback=watch)
    assert recording.lengths.tolist() == [4]
    assert [moment.step for moment in moments] == [0, 1, 2, 3, 4]
    assert np.array_equal([moment.observations for moment in moments], recording.observation)
    assert moments[2].infos["fuel"] == recording.fuel[2]


def test_a_policy_may_try_out_forks_of_what_it_flies():
    env = gym.make(ORION)

    def curious(observation):
        fork(env).step(np.ones(12))
        return np.full(12, -1.0)

    assert_same(
        fly(env, curious, 0, steps=5, record=["position"]),
        fly(ORION, "idle", 0, steps=5, record=["position"]),
    )


def test_ctrl_c_leaves_what_was_flown():
    env = gym.make_vec(ORION, num_envs=2)

    def impatient(observations):
        impatient.calls += 1
        if impatient.calls == 8:
            raise KeyboardInterrupt
        return np.full((2, 12), -1.0)

    impatient.calls = 0
    with pytest.raises(Interrupted) as stop:
        fly(env, impatient, [0, 1, 2, 3], steps=5)
    partly = stop.value.recording
    assert partly.lengths.tolist() == [5, 5, 2, 2]
    assert partly[3].metadata["interrupted"]
    assert "interrupted" not in partly[0].metadata
    assert isinstance(stop.value, KeyboardInterrupt)
    assert env.unwrapped.worlds.watcher is None


def test_only_what_is_asked_for_is_kept():
    recording = fly(MAPPING, seeds=[0, 1], record=["reward_terms", "score"])
    assert set(recording.channels) == {"reward_terms/miss", "reward_terms/fuel", "score"}
    with pytest.raises(ValueError, match="'scor', which is not recorded here; did you mean 'score'"):
        fly(MAPPING, seeds=[0, 1], record=["scor"])


def test_wrappers_are_recorded_as_they_are():
    craft = load("orion")
    env = VectorMapperAction(gym.make_vec(ORION, num_envs=2), LPMapper(craft))
    recording = fly(env, seeds=0, steps=4)
    assert recording.action.shape == (8, 6)
    assert recording.duty.shape == (8, 12)
    with pytest.raises(ValueError, match="'idle' does not know"):
        fly(env, "idle", 0)
    flat = fly(gym.make_vec(ORION, num_envs=2, flat_info=True), seeds=0, steps=4)
    assert_same(flat, fly(gym.make_vec(ORION, num_envs=2), seeds=0, steps=4))


def test_wheels_and_gyros_are_recorded_and_idle_without_a_command():
    craft = load("orion").to_dict()
    wheel = {"inertia": 0.05, "max_torque": 0.1, "max_speed": 500.0, "initial_speed": 100.0}
    craft["reaction_wheels"] = [
        wheel | {"name": "a", "axis": (1.0, 0.0, 0.0)},
        wheel | {"name": "b", "axis": (0.0, 1.0, 0.0)},
    ]
    recording = fly(ORION, "idle", seeds=[0, 1], steps=3, spacecraft=craft)
    assert recording.action.shape == (6, 14)
    assert (recording.action[:, 12:] == 0.0).all()
    assert (recording.wheel_torque == 0.0).all()
    assert recording[1].wheel_speed.shape == (4, 2)
    assert np.allclose(recording.wheel_speed, 100.0, rtol=0.05)
    assert recording.channels["wheel_speed"].unit == "rad/s"


def test_metadata_say_how_it_was_made():
    recording = fly(DIAGNOSIS, "idle", seeds=5, steps=2, faults=[{"thruster": 3, "kind": "leak"}])
    assert recording.metadata["environment"] == DIAGNOSIS
    assert recording.metadata["policy"] == "idle"
    assert recording.metadata["faults"][0]["thruster"] == 3
    assert recording.metadata["configuration"]["spacecraft"]["name"] == "orion"
    spec = gym.envs.registration.EnvSpec.from_json(recording.metadata["spec"])
    assert_same(fly(gym.make(spec), "idle", 5, steps=2), recording)
    assert recording.seeds == (5,)
    unseeded = fly(ORION, steps=3)
    assert_same(fly(ORION, seeds=unseeded.seeds[0], steps=3), unseeded)


def test_what_cannot_be_flown_is_refused_in_one_line():
    env = gym.make_vec(ORION, num_envs=2)
    refused = [
        (lambda: fly("CartPole-v1", seeds=0), "must be an environment of thruster_envs"),
        (lambda: fly(gym.make("CartPole-v1"), seeds=0), "must be an id or an environment of thruster_envs"),
        (lambda: fly(3), "must be an id or an environment"),
        (lambda: fly(env, seeds=[0, 1, 2]), "one for each of the 2 worlds, or several times as many, got 3"),
        (lambda: fly(env, seeds=[]), "seeds must have at least one"),
        (lambda: fly(env, seeds=[0, -1]), "seed must be a whole number"),
        (lambda: fly(env, seeds="01"), "seeds must be whole numbers"),
        (lambda: fly(env, "wild", seeds=0), "policy must be None, 'random', 'idle'"),
        (lambda: fly(env, 3, seeds=0), "policy must be None"),
        (lambda: fly(env, seeds=0, orbits=1.0), "orbits can only be given with an id"),
        (lambda: fly(env, seeds=0, steps=0), "steps"),
        (lambda: fly(env, seeds=0, past_end=True), "steps must be given to fly past the end"),
        (lambda: fly(env, seeds=0, steps=2, past_end=True), "past_end needs .* in the mode DISABLED"),
    ]
    for call, message in refused:
        with pytest.raises(ValueError, match=message) as error:
            call()
        assert "\n" not in str(error.value)
