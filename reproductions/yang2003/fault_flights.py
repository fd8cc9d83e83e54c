"""Flights of `OrionRendezvous-v0` with one random fault each, flown by pilots that know more or less of it.

One thruster fails in the first third of the flight: it is dead, gives half of its thrust, or stays open;
which one, how and when is drawn from the seed of the flight. All pilots plan with the same planner and
allocate with the same mapper; they differ in what they know:

- the oracle is told which thruster fails, and how, at the first decision after it did;
- the classical pilot finds out by itself;
- the blind one finds out nothing, but plans anew from where the craft is;
- the open-loop one follows the plan of the start without looking;
- the last one does nothing.

Where a flight ended is taken from the true state. Flights in which nothing fails (`fly_healthy`) show what
the classical pilot takes for a fault.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import thruster_envs  # noqa: F401 - registers the environments
from reproductions.yang2003.rendezvous_flights import ENVIRONMENT
from thruster_baselines.control.classical_pilot import ClassicalPilot, Decision
from thruster_baselines.control.fault_allocation import FaultAllocation, ThrusterBelief
from thruster_baselines.control.observed import ObservationReader
from thruster_baselines.control.quaternions import attitude_error
from thruster_baselines.control.rendezvous import RendezvousSettings
from thruster_baselines.guidance import RendezvousPlanner
from thruster_envs import rollout
from thruster_envs.faults import KINDS, FaultDistribution
from thruster_envs.physics.health import effect_of
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

FAULT_KINDS = ("stuck_off", "loss", "stuck_on")
_HALF = 0.5
_FEW = 10  # up to so many flights are flown in this process


@dataclass(frozen=True)
class Flight:
    """How a flight went."""

    pilot: str  # who flew
    seed: int  # of the episode
    kind: str  # of the fault, as `thruster_envs.faults.KINDS` has it
    thruster: int  # that failed, from 1
    onset: float  # when it did, s; the first decision after it
    success: bool  # whether the craft was in the terminal box when the time was up
    lost: bool  # whether it went out of bounds on the way
    miss: float  # distance from the target at the end, or where it was lost, m
    speed: float  # there, m/s
    angle: float  # between body and LVLH, there, rad
    rate: float  # of the body, inertial, there, rad/s
    firing_time: float  # thruster-seconds of open valve
    decisions: tuple[Decision, ...]  # what a pilot that diagnoses decided of thrusters


@dataclass(frozen=True)
class HealthyFlight:
    """How the classical pilot flew with nothing failing."""

    seed: int  # of the episode
    success: bool  # whether the craft was in the terminal box when the time was up
    firing_time: float  # thruster-seconds of open valve
    threshold: float  # of the likelihood ratio
    statistics: FloatArray  # (intervals,), the likelihood ratio
    names: int  # how often it named a thruster


class Pilot(ABC):
    """Acts on what it sees."""

    @abstractmethod
    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Action (n,), -1 to 1."""

    def tell(self, truth: Mapping[str, Any]) -> None:  # noqa: B027 - most are told nothing
        """Hear `info["fault"]` of this moment, before acting."""

    @property
    def log(self) -> Sequence[Decision]:
        """What it decided so far."""
        return ()


class Classical(Pilot):
    """Diagnoses by itself."""

    def __init__(self, spacecraft: Spacecraft, steps: int) -> None:
        self._pilot = ClassicalPilot(spacecraft, steps)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """As it decides."""
        return self._pilot(observation)

    @property
    def log(self) -> Sequence[Decision]:
        """What it decided so far."""
        return self._pilot.log


class Blind(Classical):
    """The same, but without diagnosis."""

    def __init__(self, spacecraft: Spacecraft, steps: int) -> None:
        self._pilot = ClassicalPilot(spacecraft, steps, diagnosis=None)


class Oracle(Blind):
    """Told of each fault at the first decision after its onset."""

    def tell(self, truth: Mapping[str, Any]) -> None:
        """Believe what is true."""
        known = self._pilot.belief
        belief = ThrusterBelief.healthy(known.share.size)
        for slot in np.flatnonzero(truth["active"]):
            effect = effect_of(KINDS[int(truth["kind"][slot]) - 1], float(truth["severity"][slot]))
            stuck_on = effect.floor > 0.0
            share = effect.floor if stuck_on else effect.slope * effect.gain
            belief = belief.changed(int(truth["thruster"][slot]), share=share, stuck_on=stuck_on)
        if (belief.share != known.share).any() or (belief.stuck_on != known.stuck_on).any():
            self._pilot.tell(belief)


class OpenLoop(Pilot):
    """Plans once, from the first measurement, and does what the plan says."""

    def __init__(self, spacecraft: Spacecraft, steps: int) -> None:
        settings = RendezvousSettings()
        longest = settings.planned_share * spacecraft.control_period
        self._planner = RendezvousPlanner(
            spacecraft, longest, max_total_on_time=settings.planned_thrusters * longest
        )
        self._allocation = FaultAllocation(spacecraft)
        self._reader = ObservationReader(spacecraft, steps)
        self._steps, self._changes = steps, np.zeros((0, 6))

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The next step of the plan."""
        measured = self._reader.read(observation)
        if self._reader.step == 0 and measured is not None:
            start = np.concatenate([measured.position, measured.velocity])
            self._changes = self._planner(start, self._steps).rate_changes
        healthy = ThrusterBelief.healthy(self._allocation.nominal.shape[1])
        on_times = self._allocation(self._changes[self._reader.step], healthy)
        return (2.0 * on_times / self._allocation.spacecraft.control_period - 1.0).astype(np.float32)


class NoFiring(Pilot):
    """Commands nothing."""

    def __init__(self, spacecraft: Spacecraft, _steps: int) -> None:
        self._action = np.full(spacecraft.number_of_thrusters, -1.0, np.float32)

    def __call__(self, _observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """All valves shut."""
        return self._action


PILOTS: dict[str, Callable[[Spacecraft, int], Pilot]] = {
    "oracle": Oracle,
    "classical": Classical,
    "blind": Blind,
    "open loop": OpenLoop,
    "does nothing": NoFiring,
}


def fly_all(
    seeds: Sequence[int],
    orbits: float = 0.5,
    pilots: Sequence[str] = tuple(PILOTS),
    period: float | None = None,
) -> list[Flight]:
    """Fly each seed with each pilot; many are shared among the processors.

    Args:
        seeds: Of the episodes.
        orbits: Time for the rendezvous.
        pilots: Of `PILOTS`.
        period: Of control, s; Orion's by default.
    """
    jobs = [(pilot, seed) for seed in seeds for pilot in pilots]
    fly_one = partial(_fly_job, orbits=orbits, period=period)
    if len(seeds) <= _FEW:
        return [fly_one(job) for job in jobs]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(fly_one, jobs, chunksize=len(pilots)))


def fly_healthy(
    seeds: Sequence[int], orbits: float = 0.5, period: float | None = None
) -> list[HealthyFlight]:
    """Fly each seed with the classical pilot and no fault; many are shared among the processors.

    Args:
        seeds: Of the episodes.
        orbits: Time for the rendezvous.
        period: Of control, s; Orion's by default.
    """
    fly_one = partial(_fly_healthy, orbits=orbits, period=period)
    if len(seeds) <= _FEW:
        return [fly_one(seed) for seed in seeds]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(fly_one, seeds))


def _fly_healthy(seed: int, orbits: float, period: float | None) -> HealthyFlight:
    env = _environment(orbits, period)
    task = env.unwrapped.task
    pilot = ClassicalPilot(task.vehicle, task.steps)
    flown = rollout.fly(env, pilot, seed, record=("success", "fuel"))
    return HealthyFlight(
        seed=seed,
        success=bool(flown.success[-1]),
        firing_time=float(flown.fuel[-1]),
        threshold=pilot.detector.threshold,
        statistics=np.array(pilot.statistics),
        names=sum(one.what == "named" for one in pilot.log),
    )


def _environment(orbits: float, period: float | None) -> Any:
    spacecraft = load("orion")
    if period is not None:
        spacecraft = replace(spacecraft, control_period=period)
    return gym.make(ENVIRONMENT, orbits=orbits, spacecraft=spacecraft, disable_env_checker=True)


def _fly_job(job: tuple[str, int], orbits: float, period: float | None) -> Flight:
    return fly(*job, orbits=orbits, period=period)


def fly(pilot: str, seed: int, orbits: float = 0.5, period: float | None = None) -> Flight:
    """Fly one episode.

    Args:
        pilot: One of `PILOTS`.
        seed: Of the episode; the fault is drawn from it too.
        orbits: Time for the rendezvous.
        period: Of control, s; Orion's by default.
    """
    env = _environment(orbits, period)
    task = env.unwrapped.task
    duration = task.steps * task.vehicle.control_period
    faults = FaultDistribution(
        probability=1.0,
        kinds=FAULT_KINDS,
        severity={"loss": (_HALF, _HALF)},
        onset=(0.0, duration / 3.0),
    )
    flown_by = PILOTS[pilot](task.vehicle, task.steps)
    flown = rollout.fly(env, flown_by, seed, options={"faults": faults}, callback=told(flown_by))
    active = np.flatnonzero(flown.fault["active"][:-1].any(axis=1))
    slot = int(np.argmax(flown.fault["thruster"][0] > 0))
    return Flight(
        pilot=pilot,
        seed=seed,
        kind=KINDS[int(flown.fault["kind"][0, slot]) - 1],
        thruster=int(flown.fault["thruster"][0, slot]),
        onset=float(active[0] * task.vehicle.control_period) if active.size else duration,
        success=bool(flown.success[-1]),
        lost=bool(flown.lengths[0] < task.steps),
        miss=float(np.linalg.norm(flown.position[-1])),
        speed=float(np.linalg.norm(flown.velocity[-1])),
        angle=float(np.linalg.norm(attitude_error(flown["attitude"][-1]))),
        rate=float(np.linalg.norm(flown.rate[-1])),
        firing_time=float(flown.fuel[-1]),
        decisions=tuple(one for one in flown_by.log if one.thruster > 0),
    )


def told(pilot: Pilot) -> Callable[[rollout.Moment], None]:
    """What tells a pilot of the faults of each moment before it acts."""

    def tell(moment: rollout.Moment) -> None:
        if moment.running.any():
            pilot.tell(moment.infos["fault"])

    return tell
