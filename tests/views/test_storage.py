"""Reaction wheels and control-moment gyros in environments: actions, observations, info, refusals."""

import gymnasium as gym
import numpy as np
import pytest

from thruster_baselines.mapping import LPMapper
from thruster_envs import formation_keeping_v1
from thruster_envs.faults import KINDS, FaultDistribution
from thruster_envs.spacecraft import load
from thruster_envs.views import MapperAction

WHEEL = {"name": "x", "axis": (1, 0, 0), "inertia": 2e-3, "max_torque": 5e-3, "max_speed": 500.0,
         "initial_speed": 50.0}  # fmt: skip
GYRO = {"name": "a", "gimbal_axis": (0, 0, 1), "spin_axis": (1, 0, 0), "momentum": 0.02,
        "max_gimbal_rate": 0.1}  # fmt: skip
#: The form of the inertia is that of `tests.physics.test_storage`, and so is the compiled kernel.
ORION = load("orion").replace(inertia=((0.575, 0.0, 0.0), (0.0, 0.582, 0.01), (0.0, 0.01, 0.534)))
EQUIPPED = ORION.replace(reaction_wheels=[WHEEL], control_moment_gyros=[GYRO])


def test_one_number_for_each_follows_the_duties_and_the_observation():
    """A wheel gains ``u t / I`` and what the body turns the other way; a gimbal turns at its rate."""
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=EQUIPPED)
    plain = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=ORION)
    observation, info = env.reset(seed=3)
    alone, _ = plain.reset(seed=3)
    assert env.action_space.shape == (14,)
    assert np.array_equal(observation[:-3], alone)
    assert observation[-3:].tolist() == pytest.approx([0.1, 1.0, 0.0])
    assert info["storage"]["wheel_speed"] == pytest.approx([50.0])
    action = -np.ones(14, np.float32)
    action[12:] = 1.0, -2.0
    observation, _, _, _, info = env.step(action)
    gained = info["storage"]["wheel_speed"][0] - 50.0
    assert gained == pytest.approx(5e-3 * 5.0 / 2e-3 + 5e-3 * 5.0 / (0.575 - 2e-3), rel=0.02)
    assert info["storage"]["gimbal_angle"] == pytest.approx([-0.5], rel=1e-12)
    assert observation[-2:].tolist() == pytest.approx([np.cos(0.5), -np.sin(0.5)])
    assert env.observation_space.contains(observation)


def test_a_number_that_is_not_finite_names_the_wheel():
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=EQUIPPED, disable_env_checker=True)
    env.reset(seed=3)
    action = np.zeros(14)
    action[12] = np.nan
    with pytest.raises(ValueError, match=r"wheel 1 must be a number from -1 to 1, got nan"):
        env.unwrapped.worlds.step(action[np.newaxis, np.newaxis])


def test_parallel_agents_have_wheels_of_their_own():
    env = formation_keeping_v1.parallel_env(spacecraft=EQUIPPED)
    env.reset(seed=1)
    actions = {agent: -np.ones(14, np.float32) for agent in env.agents}
    actions[env.agents[0]][12] = 1.0
    observations, _, _, _, infos = env.step(actions)
    speeds = [infos[agent]["storage"]["wheel_speed"][0] for agent in env.agents]
    assert speeds[0] > 60.0 > max(speeds[1:])
    assert all(env.observation_space(agent).contains(observations[agent]) for agent in env.agents)


@pytest.mark.nightly
def test_mars_rendezvous_takes_them():
    chaser = load("msr_chaser").replace(reaction_wheels=[WHEEL], control_moment_gyros=[GYRO])
    env = gym.make("thruster_envs/MarsRendezvous-v1", spacecraft=chaser)
    env.reset(seed=3)
    observation, _, _, _, info = env.step(np.append(-np.ones(env.action_space.shape[0] - 2), [1.0, 1.0]))
    assert info["storage"]["gimbal_angle"] == pytest.approx([0.01])
    assert env.observation_space.contains(observation)


@pytest.mark.parametrize("task", ["ThrusterMapping-v0", "FaultDiagnosis-v1", "ActiveDiagnosis-v1"])
def test_a_task_without_them_refuses_in_one_line(task):
    name = task.partition("-")[0]
    with pytest.raises(ValueError, match=rf"no reaction wheels and no control-moment gyros for {name}, got"):
        gym.make(f"thruster_envs/{task}", spacecraft=EQUIPPED)


def test_mappers_refuse_them_in_one_line():
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=EQUIPPED)
    with pytest.raises(ValueError, match="an action through a mapper, got 'orion' with 2 of them"):
        MapperAction(env, LPMapper(EQUIPPED, max_on_time=5.0))


def test_distributions_draw_faults_of_wheels_and_gyros_where_there_are_any():
    law = FaultDistribution(probability=1.0, kinds=("loss", "wheel_stuck", "gimbal_lock"))
    envs = gym.make_vec("thruster_envs/OrionRendezvous-v1", num_envs=64, spacecraft=EQUIPPED, faults=law)
    _, infos = envs.reset(seed=1)
    kinds = infos["fault"]["kind"][:, 0]
    assert set(kinds) == {1 + KINDS.index(kind) for kind in law.kinds}
    stored = kinds != 1 + KINDS.index("loss")
    assert (infos["fault"]["thruster"][stored, 0] == 1).all()  # it has one of each
    assert infos["fault"]["active"][:, 0].all()
    with pytest.raises(ValueError, match="kind 'wheel_stuck' has no meaning here"):
        gym.make("thruster_envs/OrionRendezvous-v1", faults=law).reset(seed=1)


def test_a_fault_of_a_wheel_stands_in_info_by_its_own_number():
    faults = [{"actuator": 1, "kind": "wheel_stuck", "onset": 2.0}]
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=EQUIPPED, faults=faults)
    _, info = env.reset(seed=3)
    assert (info["fault"]["thruster"][0], info["fault"]["active"][0]) == (1, False)
    _, _, _, _, info = env.step(-np.ones(14, np.float32))
    assert info["fault"]["active"][0]
