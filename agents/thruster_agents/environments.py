"""The environments that agents train and are judged in: the mapping task on beliefs or on duties.

The action form `beliefs` puts the LP mapper between policy and thrusters; `duties` is the task as it is.
"""

from __future__ import annotations

from typing import Any, Literal

import gymnasium as gym
from gymnasium.vector import AutoresetMode, VectorEnv

import thruster_envs
from thruster_baselines.mapping import LPMapper
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.views import VectorBeliefAction

__all__ = ["FORMS", "TASK", "Form", "make_plain", "on_form"]

Form = Literal["beliefs", "duties"]
FORMS: tuple[Form, ...] = ("beliefs", "duties")
TASK = next(one for one in gym.registry if one == f"{thruster_envs.__name__}/ThrusterMapping-v0")


def make_plain(
    spacecraft: Spacecraft, worlds: int, *, faults: Any = None, autoreset_mode: AutoresetMode
) -> VectorEnv[Any, Any, Any]:
    """The task as it is: the action is the duty of each thruster.

    Args:
        spacecraft: What flies.
        worlds: How many.
        faults: As the task takes them: None for its default distribution, an empty list for none.
        autoreset_mode: What happens at the end of an episode.
    """
    env: VectorEnv[Any, Any, Any] = gym.make_vec(
        TASK,
        num_envs=worlds,
        spacecraft=spacecraft,
        faults=faults,
        autoreset_mode=autoreset_mode,
        threads=1,
    )
    return env


def on_form(env: VectorEnv[Any, Any, Any], form: Form, spacecraft: Spacecraft) -> VectorEnv[Any, Any, Any]:
    """The environment with the actions of a form."""
    return VectorBeliefAction(env, LPMapper(spacecraft, threads=1)) if form == "beliefs" else env
