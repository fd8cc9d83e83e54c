"""Flights of `OrionRendezvous-v1` with any mapper in the loop, flown to be judged.

The rendezvous controller commands rate changes, a mapper allocates them through `VectorMapperAction`, and the
environment flies them with scatter, sensor noise and the coupling loss of the feed. Where a flight ended is
taken from the true state, not from measurements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.control import RendezvousCommandPolicy, RendezvousController, RendezvousSettings
from thruster_envs import rollout
from thruster_envs.protocols import FloatArray, Mapper
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.views import VectorMapperAction

ENVIRONMENT = "thruster_envs/OrionRendezvous-v1"
POSITION_TOLERANCE: float = gym.make(ENVIRONMENT).unwrapped.task.position_tolerance  # type: ignore[attr-defined]
"""Of the terminal box, m."""

Make = Callable[[Spacecraft], Mapper]
"""Makes the mapper of a spacecraft."""

_TOGETHER = 25  # flights side by side in one vector environment


@dataclass(frozen=True)
class Flights:
    """How flights ended, one entry for each."""

    success: NDArray[np.bool_]  # whether the craft was in the terminal box when the time was up
    lost: NDArray[np.bool_]  # whether it went out of bounds on the way
    miss: FloatArray  # distance from the target at the end, or where it was lost, m
    speed: FloatArray  # there, m/s
    firing_time: FloatArray  # thruster-seconds of open valve
    commanded: FloatArray  # sum of the absolute translational rate changes that the controller asked for, m/s


def fly(
    spacecraft: Spacecraft,
    make: Make,
    seeds: Sequence[int],
    settings: RendezvousSettings | None = None,
    orbits: float = 0.5,
) -> Flights:
    """Fly one healthy episode of `OrionRendezvous-v1` for each seed, with a controller for each."""
    parts = [
        _fly_together(spacecraft, make(spacecraft), seeds[first : first + _TOGETHER], settings, orbits)
        for first in range(0, len(seeds), _TOGETHER)
    ]
    return Flights(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Flights)))


def _fly_together(
    spacecraft: Spacecraft,
    mapper: Mapper,
    seeds: Sequence[int],
    settings: RendezvousSettings | None,
    orbits: float,
) -> Flights:
    env = gym.make_vec(ENVIRONMENT, num_envs=len(seeds), threads=1, spacecraft=spacecraft, orbits=orbits)
    steps = env.unwrapped.task.steps  # type: ignore[attr-defined]
    policies = [
        RendezvousCommandPolicy(RendezvousController(spacecraft, steps, settings=settings)) for _ in seeds
    ]
    flown = rollout.fly(
        VectorMapperAction(env, mapper), policies, seeds,
        record=("action", "position", "velocity", "fuel", "success"),
    )  # fmt: skip
    env.close()
    authority = spacecraft.authority()[:3]
    commanded = [np.cumsum(np.abs(one.action[:, :3] * authority).sum(axis=1))[-1] for one in flown]
    return Flights(
        success=flown.final("success"),
        lost=flown.lengths < steps,
        miss=np.linalg.norm(flown.final("position"), axis=1),
        speed=np.linalg.norm(flown.final("velocity"), axis=1),
        firing_time=flown.final("fuel"),
        commanded=np.array(commanded),
    )
