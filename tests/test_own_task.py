"""A task of one's own is one file: from the README's, written outside of the package, come all the views."""

import importlib
import json
import pickle
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.own_task import write_own_task
from thruster_envs.faults import FaultDistribution
from thruster_envs.observations import Reader
from thruster_envs.registration import ENVIRONMENTS, make_parallel, register
from thruster_envs.rollout import fly
from thruster_envs.tasks import OrionRendezvous, Task
from thruster_envs.tasks.access import step_numbers
from thruster_envs.testing import check_parallel_env, check_vector_env
from thruster_envs.views import get_state, set_state

ID = "mine/Detumble-v0"
#: A task of several craft, and one that does not say which of them a view of one agent has.
TEAM = '''
from dataclasses import dataclass
from thruster_envs.tasks import FormationKeeping


@dataclass(frozen=True, kw_only=True)
class Pair(FormationKeeping):
    """Two craft that keep their slots."""

    craft: int = 2


@dataclass(frozen=True, kw_only=True)
class Crowd(FormationKeeping):
    """Nobody in particular."""

    one_agent = {}
'''


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """The module of the example, which registers its task."""
    folder = tmp_path_factory.mktemp("own")
    write_own_task(folder)
    (folder / "team_of_mine.py").write_text(TEAM)
    sys.path.insert(0, str(folder))
    try:
        yield importlib.import_module("detumble")
    finally:
        sys.path.remove(str(folder))
        for name in ("detumble", "team_of_mine"):
            sys.modules.pop(name, None)
        for identifier in [one for one in gym.registry if one.startswith("mine/")]:
            del gym.registry[identifier]


@pytest.fixture(scope="module")
def team(own):
    return importlib.import_module("team_of_mine")


def test_gymnasium_and_the_checker_of_batches_find_nothing_wrong(own):
    env = gym.make(ID)
    assert type(env.unwrapped).__name__ == "DetumbleEnv"
    assert type(env.unwrapped).__doc__ == own.Detumble.__doc__
    check_env(env.unwrapped, skip_render_check=True)
    check_vector_env(ID)


def test_a_craft_that_fires_against_its_rate_stops(own):
    """Its score is what the true rate says, and reading the observation suffices to steer by."""
    env = gym.make(ID)
    task = env.unwrapped.task
    inverse, inertia = np.linalg.pinv(task.vehicle.wrenches()), np.array(task.vehicle.inertia)
    read = Reader.of(ID)
    observation, info = env.reset(seed=1)
    before = info["score"]
    over = False
    while not over:
        rate = read(observation).rate
        duties = inverse @ np.r_[np.zeros(3), -inertia @ rate / task.vehicle.control_period]
        duties = (duties - min(0.0, duties.min())).clip(0.0, 1.0)
        observation, reward, terminated, over, info = env.step((2.0 * duties - 1.0).astype(np.float32))
        assert not terminated
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
    assert before < 0.5
    assert info["score"] > 0.9
    assert info["success"]


def test_a_world_of_a_batch_is_the_single_environment(own):
    envs = gym.make_vec(ID, num_envs=35, faults=FaultDistribution(probability=0.5))
    env = gym.make(ID, faults=FaultDistribution(probability=0.5))
    observations, _ = envs.reset(seed=5)
    observation, _ = env.reset(seed=5 + 34)
    for _ in range(6):
        actions = envs.action_space.sample()
        np.testing.assert_array_equal(observations[34], observation)
        observations = envs.step(actions)[0]
        observation = env.step(actions[34])[0]


def test_what_is_drawn_in_a_step_depends_on_seed_episode_and_period_alone(own):
    """In any batch, as often as it is asked for; uniform and independent from one to the next."""
    one, many = gym.make_vec(ID, num_envs=1).unwrapped, gym.make_vec(ID, num_envs=400).unwrapped
    one.reset(seed=7 + 3)
    many.reset(seed=7)
    drawn = []
    for _ in range(10):
        numbers = step_numbers(many.worlds.fleet, 9)
        np.testing.assert_array_equal(step_numbers(one.worlds.fleet, 9)[0], numbers[3])
        np.testing.assert_array_equal(step_numbers(many.worlds.fleet, 3), numbers[..., :3])
        drawn.append(numbers)
        for envs in (one, many):
            envs.step(np.full((envs.num_envs, 12), -1.0))
    flat = np.array(drawn)[:, :, 0]  # (steps, worlds, 9)
    assert len(np.unique(flat)) == flat.size
    assert abs(flat.mean() - 0.5) < 4.0 / np.sqrt(12.0 * flat.size)
    assert abs(flat.var() - 1.0 / 12.0) < 4.0 * np.sqrt(1.0 / 180.0 / flat.size)
    ahead = np.corrcoef(flat[:-1].ravel(), flat[1:].ravel())[0, 1]
    assert abs(ahead) < 4.0 / np.sqrt(flat[1:].size)
    many.reset()
    assert not np.isin(step_numbers(many.worlds.fleet, 9), flat).any()  # of the next episode


def test_a_gust_turns_a_craft_that_nothing_else_turns(own):
    quiet, gusty = (gym.make(ID, rate=1e-12, gust=gust) for gust in (0.0, 1e-3))
    for env, least, most in ((quiet, 0.0, 1e-9), (gusty, 1e-4, 3e-3)):
        _, before = env.reset(seed=1)
        info = env.step(np.full(12, -1.0))[4]
        assert least <= np.linalg.norm(info["state"]["rate"] - before["state"]["rate"]) <= most


def test_gymnasium_registers_it_from_outside_by_its_path(own):
    single, vector = (f"thruster_envs.views.{form}:detumble/Detumble" for form in ("single", "vector"))
    gym.register(
        "mine/Outside-v0", single, vector_entry_point=vector, max_episode_steps=7, kwargs={"gust": 0.0}
    )
    env, envs = gym.make("mine/Outside-v0"), gym.make_vec("mine/Outside-v0", num_envs=2)
    assert env.unwrapped.task == envs.unwrapped.task == own.Detumble(gust=0.0)
    np.testing.assert_array_equal(env.reset(seed=3)[0], envs.reset(seed=3)[0][0])
    assert env.spec.max_episode_steps == 7


def test_it_is_drawn_flown_copied_and_made_again_from_json(own):
    env = gym.make(ID, render_mode="rgb_array", rate=0.1)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.std() > 5.0
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.task == env.unwrapped.task
    copied = pickle.loads(pickle.dumps(env.unwrapped))
    state = get_state(env)
    action = env.action_space.sample()
    np.testing.assert_array_equal(copied.step(action)[0], env.step(action)[0])
    set_state(env, state)
    np.testing.assert_array_equal(env.step(action)[0], copied.worlds.observe()[0, 0])
    recording = fly(ID, "random", seeds=range(3))
    assert recording.lengths.tolist() == [40, 40, 40]
    assert recording.metadata["environment"] == ID
    json.dumps(recording.metadata)


def test_settings_and_the_time_limit_may_be_given_with_the_id(own):
    register("mine/Fast-v0", own.Detumble, max_episode_steps=7, rate=0.2)
    register("mine/Fast-v0", own.Detumble, max_episode_steps=6, rate=0.2)  # once more, as a notebook would
    env = gym.make("mine/Fast-v0")
    assert (env.unwrapped.task.rate, env.spec.max_episode_steps) == (0.2, 6)
    envs = gym.make_vec("mine/Fast-v0", num_envs=2, rate=0.3)
    assert envs.unwrapped.task.rate == 0.3
    envs.reset(seed=0)
    cut = [envs.step(envs.action_space.sample())[3].all() for _ in range(6)]
    assert cut == [False] * 5 + [True]


def test_a_task_that_is_defined_anew_takes_the_place_of_the_former(own, monkeypatch):
    """As a cell of a notebook that is run again."""
    former = own.Detumble
    again = type("Detumble", (former,), {"__module__": "detumble", "max_episode_steps": 5})
    assert gym.make(ID).unwrapped.task_type is former
    monkeypatch.setattr(own, "Detumble", again)
    register("mine/Anew-v0", again)
    env = gym.make("mine/Anew-v0")
    assert env.unwrapped.task_type is again
    assert env.spec.max_episode_steps == 5


def test_a_task_of_several_craft_has_all_three_views(team):
    register("mine/Pair-v0", team.Pair, radius=40.0)
    assert gym.make("mine/Pair-v0").unwrapped.task.agents == ("craft_1",)
    env = make_parallel("mine/Pair-v0", max_cycles=9)
    assert env.possible_agents == ["craft_1", "craft_2"]
    assert env.task.radius == 40.0
    assert env.max_cycles == 9
    check_parallel_env(lambda: make_parallel("mine/Pair-v0"))
    pettingzoo = pytest.importorskip("pettingzoo")
    if hasattr(pettingzoo, "make"):
        made = pettingzoo.make("parallel", "mine/Pair-v0")
        assert made.unwrapped.possible_agents == ["craft_1", "craft_2"]


def test_the_table_of_the_suite_has_no_rows_of_others(own):
    assert all(identifier.startswith("thruster_envs/") for identifier in ENVIRONMENTS)
    for identifier, row in ENVIRONMENTS.items():
        views = [row.single, row.vector, *([] if row.parallel is None else [row.parallel])]
        for view in views:
            module, _, name = view.partition(":")
            task_type = getattr(importlib.import_module(module), name).task_type
            assert task_type.max_episode_steps == row.max_episode_steps, identifier


def test_bad_input_is_one_clear_line(own, team):
    class Inner(own.Detumble):
        pass

    cases = (
        ((ID, Inner), {}, TypeError, "task must be a subclass of Task at the top level of a module"),
        ((ID, dict), {}, TypeError, "task must be a subclass of Task"),
        (("CartPole-v1", own.Detumble), {}, ValueError, "identifier must be new, got 'CartPole-v1'"),
        ((ID, own.Detumble), {"rat": 1.0}, TypeError, "unexpected keyword argument 'rat'"),
        (
            (ID, own.Detumble),
            {"max_episode_steps": 0},
            ValueError,
            "max_episode_steps must be at least 1 and",
        ),
        (("mine/Crowd-v0", team.Crowd), {}, ValueError, "one_agent of Crowd must leave one agent"),
    )
    for arguments, settings, error, says in cases:
        with pytest.raises(error, match=says):
            register(*arguments, **settings)
    with pytest.raises(ValueError, match=r"identifier must be one of .*FormationKeeping-v1.*, got 'mine/D"):
        make_parallel(ID)
    single = importlib.import_module("thruster_envs.views.single")
    with pytest.raises(AttributeError, match="names no task"):
        getattr(single, "nowhere/Nothing")
    with pytest.raises(AttributeError, match="must be a subclass of Task, got <class"):
        getattr(single, "pathlib/Path")


def test_a_registration_that_is_refused_changes_nothing():
    for identifier, limit in (("mine/no good", None), ("mine/Odd-v0", 2.5), ("mine/Odd-v0", "x"), (5, None)):
        with pytest.raises((ValueError, TypeError), match="must be"):
            register(identifier, OrionRendezvous, max_episode_steps=limit)
        assert identifier not in gym.registry
    with pytest.raises(TypeError, match="must be a subclass of Task"):
        register("mine/Odd-v0", Task)
