"""What the tests of the views share: every registered id, faults of every kind, and infos by path."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

import thruster_envs  # noqa: F401  # registers the environments
from thruster_envs.faults import DISCHARGE_KINDS, FaultDistribution
from thruster_envs.registration import ENVIRONMENTS

IDS = tuple(ENVIRONMENTS)

#: Several faults of any kind and profile, beginning and ending within the first two minutes.
FAULTS = FaultDistribution(
    probability=0.9,
    count=(1, 3),
    onset=(0.0, 60.0),
    duration=(10.0, 100.0),
    profiles=("step", "ramp", "sine", "intermittent"),
)


def kinds_of(identifier: str) -> tuple[str, ...]:
    """The kinds of fault that a task takes."""
    task = gym.make(identifier).unwrapped
    discharges = task.task.vehicle.discharge is not None
    return tuple(kind for kind in task.worlds.fleet.kinds if discharges or kind not in DISCHARGE_KINDS)


def faults_of(identifier: str) -> FaultDistribution:
    """Several faults of any profile and of any kind that a task takes, as in ``FAULTS``."""
    return replace(FAULTS, kinds=kinds_of(identifier))


def thrusters_of(identifier: str) -> int:
    """How many thrusters a craft of a task has."""
    return gym.make(identifier).unwrapped.task.vehicle.number_of_thrusters


def craft_of(identifier: str) -> int:
    """Number, from 1, of the craft that the agent flies."""
    return gym.make(identifier).unwrapped.task.first_commanded + 1


def entries(info: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Every entry of an info, nested ones with the path as their name."""
    for key, value in info.items():
        if isinstance(value, dict):
            yield from entries(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value


def world_of(info: dict[str, Any], world: int) -> dict[str, Any]:
    """What a vector environment's info says of one world, by path, masks and final entries left out."""
    kept = {key: value for key, value in info.items() if not key.startswith("final")}
    return {
        path: np.asarray(value[world])
        for path, value in entries(kept)
        if not any(part.startswith("_") for part in path.split("."))
    }


def equal(first: dict[str, Any], second: dict[str, Any]) -> bool:
    """Whether two infos by path are the same, to the last bit."""
    return first.keys() == second.keys() and all(np.array_equal(first[key], second[key]) for key in first)


def actions_of(identifier: str, world: int, steps: int) -> np.ndarray:
    """(steps, n) actions of one world: bursts of firing between pauses, so that some episodes last.

    Where there are options to choose, those of a pause are the first ones.
    """
    generator, space = np.random.default_rng(1000 + world), space_of(identifier)
    if has_options(space):
        most = space.n if isinstance(space, gym.spaces.Discrete) else space.nvec
        actions, pause = generator.integers(0, most, (steps, *space.shape)), 0
    else:
        actions, pause = generator.uniform(-1.0, 1.0, (steps, *space.shape)).astype(np.float32), -1.0
    actions[generator.random(actions.shape) < 0.5 + 0.5 * (world % 2)] = pause
    return actions


def has_options(space: gym.Space[Any]) -> bool:
    """Whether an action is options to choose, not duties."""
    return isinstance(space, gym.spaces.Discrete | gym.spaces.MultiDiscrete)


def space_of(identifier: str) -> gym.Space[Any]:
    """Space of one action."""
    return gym.make(identifier).action_space


def constant(identifier: str, duty: float) -> np.ndarray:
    """One action: this duty for every thruster, -1..1; where there are options, the first of each."""
    space = space_of(identifier)
    if has_options(space):
        return np.zeros(space.shape, np.int64)
    return np.full(space.shape, duty, np.float32)


def single(identifier: str, **kwargs: Any) -> gym.Env[Any, Any]:
    return gym.make(identifier, **kwargs)
