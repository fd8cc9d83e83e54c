"""Approaches of `MarsRendezvous-v0` for detectors to look at: many at once, with one fault each or none.

The environment's own pilot flies, which knows of no fault, and nobody acts on a diagnosis. What is kept is
what navigation measures at each sample and what the valves are told for the period that begins with
it, so delays count from the measurement, not from its arrival one period later. Numbers are of MSR-A,
ours: the source withholds those of its vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.detection.residuals import NavigationFlights
from thruster_envs.faults import FaultDistribution
from thruster_envs.faults.encoding import FIELD_ONSET

__all__ = ["HEALTHY_DURATION", "ONSET", "STRUCK_DURATION", "fly"]

ONSET = (60.0, 60.09)
"""When faults begin, s: off the sample grid."""
STRUCK_DURATION, HEALTHY_DURATION = 80.0, 160.0
"""s."""

_OPEN_RATES = 16  # their first column in an observation


def fly(
    seeds: Sequence[int], thruster: int = 0, kind: str = "none", severity: float = 0.0, **settings: Any
) -> NavigationFlights:
    """One flight per seed, in which this thruster, from 1, fails in this way; healthy ones with 0."""
    count, healthy = len(seeds), thruster == 0
    faults = None
    if not healthy:
        faults = FaultDistribution(
            probability=1.0, kinds=(kind,), severity={kind: (severity, severity)}, onset=ONSET,
            thrusters=(thruster,),
        )  # fmt: skip
    envs: Any = gym.make_vec(
        "thruster_envs/MarsRendezvous-v0", num_envs=count, vectorization_mode="vector_entry_point",
        faults=faults, **settings,
    )  # fmt: skip
    envs.reset(seed=list(seeds))
    worlds = envs.unwrapped.worlds
    period, n = worlds.task.vehicle.control_period, worlds.task.vehicle.number_of_thrusters
    onset = np.full(count, np.inf) if healthy else worlds.state.fleet.fault_rows()[:, 0, 0, FIELD_ONSET]
    samples = round((HEALTHY_DURATION if healthy else STRUCK_DURATION) / period)
    sights, told = np.empty((count, samples, 13)), np.empty((count, samples, n))
    for k in range(samples):
        sights[:, k] = worlds.state.sights[:, -1, :13]
        actions = worlds.task.pilot_actions(worlds.state)[:, 0].astype(np.float32)
        observations, _, terminated, _, _ = envs.step(actions)
        if terminated.any():
            raise RuntimeError(f"a flight ended after {k} samples; {samples} would be right")
        told[:, k] = np.clip(observations[:, _OPEN_RATES : _OPEN_RATES + n], 0.0, 1.0)
    envs.close()
    return NavigationFlights(
        told, sights[..., :3], sights[..., 6:10], sights[..., 10:13], period,
        np.full(count, thruster), (kind,) * count, np.full(count, severity), onset,
    )  # fmt: skip
