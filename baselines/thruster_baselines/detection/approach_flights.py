"""Approaches of `MarsRendezvous-v1` for navigation detectors: many side by side, with one fault each or none.

Nobody acts on a diagnosis. What is kept is what navigation measures at each sample and what the valves are
commanded for the period that begins with it, both as observations have them: a sample is seen
`navigation_delay` periods later, so delays count from the measurement, not from its arrival. Commands shorter
than the minimum on-time count as none, since the valves stay shut. By default the environment's own pilot
flies, whose law needs the state of its filter; any other pilot flies by observations.

Left out: flights that end early, and measurements at the end of an observation's range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.control import ApproachController
from thruster_baselines.detection.environment_flights import Policy
from thruster_baselines.detection.flights import faults_of, truth_of
from thruster_baselines.detection.residuals import NavigationFlights
from thruster_envs import rollout
from thruster_envs.faults import FaultDistribution
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FAULTY_DURATION", "HEALTHY_DURATION", "NO_ERRORS", "ONSET", "Pilot", "fly"]

ONSET = (60.0, 60.09)
"""When faults begin, s: off the sample grid."""
FAULTY_DURATION, HEALTHY_DURATION = 80.0, 160.0
"""s."""

NO_ERRORS = dict.fromkeys(("mass_error", "inertia_error", "thrust_error", "centre_of_mass_error"), 0.0)
"""Settings of an environment whose chaser is what the description says."""

Pilot: TypeAlias = Callable[[Spacecraft, int], Policy]
"""Makes the policy that flies, for a spacecraft and the number of periods of an episode."""


def fly(
    seeds: Sequence[int],
    thruster: int = 0,
    kind: str = "none",
    severity: float = 0.0,
    pilot: Pilot | None = None,
    **settings: Any,
) -> NavigationFlights:
    """One flight for each seed, in which one thruster fails in one way, at a time drawn from `ONSET`.

    Args:
        seeds: Seeds of the episodes.
        thruster: Thruster that fails, from 1; 0 for healthy flights.
        kind: Kind of the fault.
        severity: Severity of the fault.
        pilot: Pilot that flies; by default the environment's own.
        settings: Settings of the environment.

    Raises:
        RuntimeError: A flight ended before it had all samples.
    """
    count, healthy = len(seeds), thruster == 0
    faults = FaultDistribution(probability=0.0)
    if not healthy:
        faults = FaultDistribution(
            probability=1.0, kinds=(kind,), severity={kind: (severity, severity)}, onset=ONSET,
            thrusters=(thruster,),
        )  # fmt: skip
    envs: Any = gym.make_vec(
        "thruster_envs/MarsRendezvous-v1", num_envs=count, vectorization_mode="vector_entry_point",
        faults=faults, **settings,
    )  # fmt: skip
    task, worlds = envs.unwrapped.task, envs.unwrapped.worlds
    vehicle, late = task.vehicle, task.navigation_delay
    period, n = vehicle.control_period, vehicle.number_of_thrusters
    minimum = np.array([one.minimum_pulse for one in vehicle.thrusters]) / period
    reader = ApproachController(vehicle, task.steps, distance=task.distance)
    samples = round((HEALTHY_DURATION if healthy else FAULTY_DURATION) / period)

    def own_pilot(_observations: Any) -> Any:
        return task.pilot_actions(worlds.state)[:, 0].astype(np.float32)

    flown = rollout.fly(
        envs, own_pilot if pilot is None else pilot(vehicle, task.steps), seeds, steps=samples + late,
        record=("observation", "terminated"),
    )  # fmt: skip
    envs.close()
    if flown.terminated.any():
        raise RuntimeError(
            f"flights must have {samples + late} samples, got one that ended after {flown.lengths.min()}"
        )
    seen = flown.padded("observation")
    rows = seen[:, late : late + samples].astype(np.float64).reshape(-1, seen.shape[-1])
    attitude, rate = reader.attitude(rows)
    rates = reader.open_rates_told(seen[:, 1 : 1 + samples].reshape(rows.shape))
    commanded = np.where(rates < minimum, 0.0, rates).astype(np.float64)
    values = (commanded, reader.position(rows), attitude, rate)
    open_rates, position, attitude, rate = (one.reshape(count, samples, -1) for one in values)
    return NavigationFlights(
        open_rates, position, attitude, rate, period,
        **truth_of(faults_of(faults, n, seeds, not healthy)),
    )  # fmt: skip
