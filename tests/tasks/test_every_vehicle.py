"""Every vehicle in every task that takes one: finite through twenty steps, or refused in one line."""

from __future__ import annotations

import functools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from tests.tasks.vehicles import vehicles
from thruster_baselines.control import DiagnosisObservation
from thruster_baselines.detection.residuals import CorrelationDetector
from thruster_baselines.mapping import LPMapper, NonNegativeLeastSquaresMapper, PseudoInverseMapper
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.registration import ENVIRONMENTS
from thruster_envs.views import BeliefAction, MapperAction

VEHICLES = vehicles()
PARALLEL = {"formation_keeping_v1": formation_keeping_v1, "formation_attitude_v1": formation_attitude_v1}
STEPS = 20


def assert_finite(value: Any, where: str) -> None:
    """Every number of a value, and of what it contains."""
    if isinstance(value, dict):
        for key, one in value.items():
            assert_finite(one, f"{where}[{key!r}]")
    else:
        assert np.isfinite(value).all(), f"{where} is {value}"


@functools.cache
def flown(identifier: str, name: str) -> str | None:
    """Fly random and then full actions; None, or the line with which the vehicle is refused."""
    try:
        env: Any = gym.make(identifier, spacecraft=VEHICLES[name], disable_env_checker=True).unwrapped
    except ValueError as refusal:
        return str(refusal)
    env.action_space.seed(5)
    observation, info = env.reset(seed=4)
    full = isinstance(env.action_space, gym.spaces.Box)
    for step in range(STEPS + 1):
        assert observation in env.observation_space
        assert_finite(info, f"info of step {step}")
        if step < STEPS:
            action = env.action_space.high if full and step > STEPS // 2 else env.action_space.sample()
            observation, reward, _, _, info = env.step(action)
            assert_finite(reward, "reward")
    return None


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("identifier", ENVIRONMENTS)
def test_a_vehicle_is_finite_through_twenty_steps_or_refused_in_one_line(identifier, name):
    refusal = flown(identifier, name)
    assert refusal is None or "\n" not in refusal


@pytest.mark.parametrize(
    ("identifier", "base"),
    [(one, "orion") for one in ENVIRONMENTS if one.split("/")[1].split("-")[0] in (
        "ThrusterMapping", "OrionRendezvous", "FormationKeeping", "FaultDiagnosis", "ActiveDiagnosis"
    )]
    + [("thruster_envs/MarsRendezvous-v1", "msr_chaser"), ("thruster_envs/PulseDiagnosis-v0", "ppt_cubesat")],
)  # fmt: skip
def test_a_vehicle_is_not_refused_for_an_axis_that_nothing_turns_or_pushes(identifier, base):
    for name in VEHICLES:
        if name.startswith(base):
            assert flown(identifier, name) is None


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("module", PARALLEL)
def test_a_vehicle_is_finite_in_a_formation_or_refused_in_one_line(module, name):
    single = module.title().replace("_", "").replace("V1", "-v1")
    if flown(f"thruster_envs/{single}", name) is not None:
        with pytest.raises(ValueError, match=r"^[^\n]*$"):
            PARALLEL[module].parallel_env(spacecraft=VEHICLES[name])
        return
    env = PARALLEL[module].parallel_env(spacecraft=VEHICLES[name])
    observations, infos = env.reset(seed=4)
    for agent in env.agents:
        env.action_space(agent).seed(5)
    for _ in range(STEPS):
        for agent in env.agents:
            assert observations[agent] in env.observation_space(agent)
            assert_finite(infos[agent], f"info of {agent}")
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        observations, rewards, _, _, infos = env.step(actions)
        assert_finite(rewards, "rewards")
        if not env.agents:
            break


@pytest.mark.filterwarnings("ignore::thruster_baselines.mapping.model.LostDirectionsWarning")
@pytest.mark.parametrize("mapper_type", [LPMapper, PseudoInverseMapper, NonNegativeLeastSquaresMapper])
@pytest.mark.parametrize("name", [one for one in VEHICLES if not one.startswith("spheres")])
def test_mappers_between_policy_and_any_vehicle_give_finite_steps(name, mapper_type):
    """Rate changes on every axis, with authority or without; beliefs that thrusters are dead or well."""
    vehicle = VEHICLES[name]
    mapper = mapper_type(vehicle, vehicle.control_period)
    for wrap in (MapperAction, BeliefAction):
        env: Any = wrap(
            gym.make("thruster_envs/ThrusterMapping-v0", spacecraft=vehicle, disable_env_checker=True), mapper
        )
        env.action_space.seed(5)
        env.reset(seed=4)
        for step in range(6):
            action = env.action_space.low if step % 2 else env.action_space.sample()
            observation, reward, _, _, info = env.step(action)
            assert observation in env.observation_space
            assert_finite({"reward": reward, "info": info}, f"step {step}")


@pytest.mark.parametrize("name", [one for one in VEHICLES if one.startswith("msr_chaser")])
def test_the_pilot_of_an_approach_and_a_detector_beside_it_are_finite_on_any_vehicle(name):
    vehicle = VEHICLES[name]
    detector = CorrelationDetector(vehicle, 0.02, vehicles=1)
    env: Any = DiagnosisObservation(gym.make("thruster_envs/MarsRendezvous-v1", spacecraft=vehicle), detector)
    env.reset(seed=4)
    worlds = env.unwrapped.worlds
    for step in range(STEPS):
        action = worlds.task.pilot_actions(worlds.state)[0, 0].astype(np.float32)
        assert action in env.action_space
        observation, reward, _, _, info = env.step(action)
        assert observation in env.observation_space
        assert_finite({"reward": reward, "info": info}, f"step {step}")
