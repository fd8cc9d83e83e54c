"""Every setting of every task with values out of reach: finite through some steps, or refused in one line."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from tests.tasks.test_every_vehicle import assert_finite
from thruster_envs.physics.body import MOST_SUBSTEPS
from thruster_envs.registration import ENVIRONMENTS
from thruster_envs.spacecraft import load
from thruster_envs.tasks import FormationAttitude, OrionRendezvous, PulseDiagnosis

VALUES: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, 0, -1, 1e-300, 1e-12, 1e12, 1e300, 2**31, 10**400, "x", None, True, (), {},
    (math.nan,) * 3, (math.inf,) * 3, (1e300,) * 3, (1e12, -1e12), (0.0,) * 3, 1j, object(),
)  # fmt: skip
#: Tested elsewhere: vehicles and faults are no numbers.
OTHERS = ("spacecraft", "faults")


def settings_of(identifier: str) -> list[str]:
    """The fields of a task that a user may give."""
    task = gym.make(identifier, disable_env_checker=True).unwrapped.task
    return [one.name for one in dataclasses.fields(task) if one.init and one.name not in OTHERS]


@pytest.mark.parametrize("identifier", ENVIRONMENTS)
def test_a_setting_out_of_reach_is_finite_through_three_steps_or_refused_in_one_line(identifier):
    names = settings_of(identifier)
    for name in names:
        for value in VALUES:
            case = f"{name}={value!r}"
            if name == "nonlinear" and value is True:
                continue  # tested elsewhere: it would compile another kernel
            try:
                env: Any = gym.make(identifier, disable_env_checker=True, **{name: value}).unwrapped
            except ValueError as refusal:
                assert "\n" not in str(refusal), case  # noqa: PT017  # most values are refused, some are right
                assert any(one in str(refusal) for one in names), case  # noqa: PT017
                continue
            env.action_space.seed(2)
            observation, info = env.reset(seed=1)
            for step in range(4):
                assert observation in env.observation_space, case
                assert_finite(info, case)
                if step < 3:
                    observation, reward, _, _, info = env.step(env.action_space.sample())
                    assert_finite(reward, case)


@pytest.mark.parametrize("max_substep", [1e-300, 0.0, -1.0, math.inf, 61.0])
def test_a_substep_shorter_than_can_be_flown_is_refused_with_its_limits(max_substep):
    shortest = load("orion").control_period / MOST_SUBSTEPS
    with pytest.raises(ValueError, match=rf"^max_substep must be from {shortest:.3g} s .* to 60 s"):
        OrionRendezvous(max_substep=max_substep)
    assert OrionRendezvous(max_substep=shortest).max_substep == shortest


def test_a_task_built_directly_refuses_what_its_environment_refuses():
    for wrong in ({"range_limit": "far"}, {"rate_limit": None}, {"start": 3.0}, {"observe_fault": "no"}):
        (name,) = wrong
        with pytest.raises(ValueError, match=name):
            OrionRendezvous(**wrong)
    with pytest.raises(ValueError, match="sample_spacing"):
        PulseDiagnosis(sample_spacing=math.inf)
    with pytest.raises(ValueError, match="bias_torque"):
        FormationAttitude(bias_torque=(1e300, 0.0, 0.0))


def test_a_craft_that_a_torque_turns_faster_than_can_be_followed_is_lost_and_stays_finite():
    env: Any = gym.make("thruster_envs/FormationAttitude-v1", bias_torque=(1e9, 0.0, 0.0)).unwrapped
    env.reset(seed=1)
    observation, reward, terminated, _, info = env.step(np.zeros(3, np.int64))
    assert terminated
    assert not info["success"]
    assert_finite({"observation": observation, "reward": reward, "info": info}, "step")
