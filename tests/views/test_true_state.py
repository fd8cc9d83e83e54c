"""``info["state"]``: how a craft truly moves, in every form of every task whose craft fly."""

import gymnasium as gym
import numpy as np
import pytest

from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.physics import rows as at
from thruster_envs.registration import ENVIRONMENTS
from thruster_envs.spacecraft import load

PLACES = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 10), "rate": slice(10, 13)}
STILL = {"thruster_envs/ThrusterMapping-v0", "thruster_envs/PulseDiagnosis-v0"}


def true_of(env, name):
    """(worlds, craft, ...): what the physics holds now of the commanded craft."""
    task, part = env.unwrapped.task, PLACES[name]
    rows = env.unwrapped.worlds.fleet.read(at.POSITION, 13)[..., part]
    return rows[:, task.first_commanded : task.first_commanded + len(task.agents)]


def names_of(identifier):
    turns = "FormationAttitude" in identifier
    return {"attitude", "rate"} if turns else set(PLACES)


@pytest.mark.parametrize("identifier", sorted(set(ENVIRONMENTS) - STILL))
def test_it_is_what_the_physics_holds_in_single_and_vector_environments(identifier):
    env, envs = gym.make(identifier, disable_env_checker=True), gym.make_vec(identifier, num_envs=3)
    alone, first = env.reset(seed=6), envs.reset(seed=5)
    for step in range(3):
        (info, infos) = (alone[-1], first[-1])
        assert set(info["state"]) == names_of(identifier)
        for name, value in info["state"].items():
            np.testing.assert_array_equal(value, true_of(env, name)[0, 0])
            np.testing.assert_array_equal(infos["state"][name], true_of(envs, name)[:, 0])
            np.testing.assert_array_equal(infos["state"][name][1], value)  # seeds 5 + 1 and 6
        kept = {name: value.copy() for name, value in info["state"].items()}
        action = np.zeros(env.action_space.shape, env.action_space.dtype)
        alone, first = env.step(action), envs.step(np.stack([action] * 3))
        for name, value in kept.items():
            np.testing.assert_array_equal(info["state"][name], value, err_msg=f"{name} of step {step}")


@pytest.mark.parametrize("identifier", sorted(STILL))
def test_a_task_in_which_nothing_moves_has_none(identifier):
    assert "state" not in gym.make(identifier, disable_env_checker=True).reset(seed=0)[1]


def test_flat_information_has_it_under_paths():
    env = gym.make("thruster_envs/OrionRendezvous-v1", flat_info=True)
    _, info = env.reset(seed=0)
    np.testing.assert_array_equal(info["state/position"], true_of(env, "position")[0, 0])
    assert {f"state/{name}" for name in PLACES} <= set(info)


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_each_agent_has_that_of_its_own_craft(module):
    env = module.parallel_env(craft=3)
    _, infos = env.reset(seed=2)
    for number, agent in enumerate(env.agents):
        for name, value in infos[agent]["state"].items():
            np.testing.assert_array_equal(value, true_of(env, name)[0, number])
    turns = module is formation_attitude_v1
    assert set(infos[env.agents[0]]["state"]) == names_of(
        "FormationAttitude" if turns else "FormationKeeping"
    )


def test_at_the_end_of_an_episode_it_is_that_of_the_end_and_not_of_the_next_start():
    quiet = load("orion").replace(sensors={})
    envs = gym.make_vec(
        "thruster_envs/OrionRendezvous-v1", num_envs=2, spacecraft=quiet, range_limit=300.5,
        autoreset_mode="SameStep",
    )  # fmt: skip
    envs.reset(seed=0)
    away = -np.ones((2, 12), np.float32)
    away[0, :4] = 1.0
    for _ in range(300):
        _, _, over, _, infos = envs.step(away)
        if over.any():
            break
    world = int(np.argmax(over))
    assert np.linalg.norm(infos["final_info"]["state"]["position"][world]) > 300.5
    assert np.linalg.norm(infos["state"]["position"][world]) < 300.5
