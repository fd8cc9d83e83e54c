"""Flights of `OrionRendezvous-v1` with faults, flown by pilots that know more or less of them.

All pilots plan with the same planner and allocate with the same mapper. The oracle knows which thruster
fails, and how, at the first decision after it did; the classical pilot finds out by itself; the blind one
finds out nothing, but plans anew from where the craft is; the open-loop one follows the plan of the start;
the last one does nothing. Where a flight ended is taken from the true state.
"""

from __future__ import annotations

import os
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
from thruster_envs.faults import KINDS, Fault, FaultDistribution
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


class Pilot:
    """Acts on an observation; most hear nothing of faults, and decide nothing of thrusters."""

    log: Sequence[Decision] = ()

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Action (n,), -1 to 1."""
        raise NotImplementedError

    def tell(self, truth: Mapping[str, Any]) -> None:
        """Hear `info["fault"]` of this moment, before acting."""


class Classical(Pilot):
    """Diagnoses by itself."""

    def __init__(self, spacecraft: Spacecraft, steps: int, **settings: Any) -> None:
        self._pilot = ClassicalPilot(spacecraft, steps, **settings)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """As it decides."""
        return self._pilot(observation)

    @property
    def log(self) -> Sequence[Decision]:  # type: ignore[override]
        """What it decided so far."""
        return self._pilot.log


class Blind(Classical):
    """The same, but without diagnosis."""

    def __init__(self, spacecraft: Spacecraft, steps: int) -> None:
        super().__init__(spacecraft, steps, diagnosis=None)


class Oracle(Blind):
    """Knows each fault from the first decision after its onset."""

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


@dataclass(frozen=True)
class DeadThrusterFlights:
    """How flights of one pilot with a dead thruster ended."""

    success: FloatArray  # (flights,), whether the craft was in the terminal box when the time was up
    lost: FloatArray  # (flights,), whether it went out of bounds before
    miss: FloatArray  # (flights,), distance from the target at the end, or where it was lost, m
    firing_time: FloatArray  # (flights,), thruster-seconds of open valve; a dead one does not open
    spent: FloatArray  # (flights, steps + 1), firing time up to each step; constant after a loss


def fly_all(
    seeds: Sequence[int],
    orbits: float = 0.5,
    pilots: Sequence[str] = tuple(PILOTS),
    period: float | None = None,
) -> list[Flight]:
    """Fly each seed with each pilot, one after the other, as `fly` does."""
    return _shared(
        fly, [(pilot, seed) for seed in seeds for pilot in pilots], len(pilots), len(seeds), orbits, period
    )


def fly_healthy(
    seeds: Sequence[int], orbits: float = 0.5, period: float | None = None
) -> list[HealthyFlight]:
    """Fly each seed with the classical pilot and no fault."""
    return _shared(_fly_healthy, [(seed,) for seed in seeds], 1, len(seeds), orbits, period)


def _shared(
    one: Callable[..., Any],
    jobs: list[tuple[Any, ...]],
    chunk: int,
    seeds: int,
    orbits: float,
    period: float | None,
) -> list[Any]:
    """Do jobs; many seeds are shared among the processors."""
    job = partial(one, orbits=orbits, period=period)
    if seeds <= _FEW:
        return [job(*arguments) for arguments in jobs]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(job, *zip(*jobs, strict=True), chunksize=chunk))


def _fly_healthy(seed: int, orbits: float, period: float | None) -> HealthyFlight:
    env = _environment(orbits, period)
    pilot = ClassicalPilot(env.unwrapped.task.vehicle, env.unwrapped.task.steps)
    flown = rollout.fly(env, pilot, seed, record=("success", "fuel"))
    return HealthyFlight(
        seed, bool(flown.success[-1]), float(flown.fuel[-1]), pilot.detector.threshold,
        np.array(pilot.statistics), sum(one.what == "named" for one in pilot.log),
    )  # fmt: skip


def _environment(orbits: float, period: float | None = None) -> Any:
    spacecraft = load("orion")
    if period is not None:
        spacecraft = replace(spacecraft, control_period=period)
    return gym.make(ENVIRONMENT, orbits=orbits, spacecraft=spacecraft, disable_env_checker=True)


def _flown(env: Any, pilot: str, seed: int, faults: Any) -> tuple[Any, Pilot]:
    """The recording of an episode, and the pilot that has flown it, who hears of faults before acting."""
    flies = PILOTS[pilot](env.unwrapped.task.vehicle, env.unwrapped.task.steps)

    def tell(moment: rollout.Moment) -> None:
        if moment.running.any():
            flies.tell(moment.infos["fault"])

    return rollout.fly(env, flies, seed, options={"faults": faults}, callback=tell), flies


def fly(pilot: str, seed: int, orbits: float = 0.5, period: float | None = None) -> Flight:
    """Fly one episode with a fault in the first third of the flight: dead, half thrust, or stuck open.

    Args:
        pilot: One of `PILOTS`.
        seed: Of the episode; which thruster fails, how and when is drawn from it too.
        orbits: Time for the rendezvous.
        period: Of control, s; Orion's by default.
    """
    env = _environment(orbits, period)
    task = env.unwrapped.task
    duration = task.steps * task.vehicle.control_period
    half = {"loss": (_HALF, _HALF)}
    faults = FaultDistribution(probability=1.0, kinds=FAULT_KINDS, severity=half, onset=(0.0, duration / 3.0))
    flown, flies = _flown(env, pilot, seed, faults)
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
        decisions=tuple(one for one in flies.log if one.thruster > 0),
    )


def fly_with_dead_thruster(
    pilot: str, seeds: Sequence[int], thruster: int, onset: float, orbits: float = 0.5
) -> DeadThrusterFlights:
    """Fly an episode for each seed in which a thruster, from 1, is dead from some time on, s."""
    env = _environment(orbits)
    steps = env.unwrapped.task.steps
    success, lost, miss = np.zeros((3, len(seeds)))
    spent = np.zeros((len(seeds), steps + 1))
    for flight, seed in enumerate(seeds):
        flown, _ = _flown(env, pilot, seed, (Fault(thruster, "stuck_off", onset=onset),))
        length = int(flown.lengths[0])
        spent[flight, 1 : length + 1], spent[flight, length:] = flown.fuel[1:], flown.fuel[-1]
        success[flight], lost[flight] = flown.success[-1], length < steps
        miss[flight] = float(np.linalg.norm(flown.position[-1]))
    env.close()
    return DeadThrusterFlights(success, lost, miss, spent[:, -1], spent)
