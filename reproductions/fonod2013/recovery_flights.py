"""Flights of `MarsRendezvous-v1` with one fault each, by pilots that know more or less of it.

The kind goes by the flight's number in turn; thruster, size and onset are drawn from the flight's seed, so
that all pilots meet the same. Pilots fly by the same law and recover by the same rules. The oracle knows of
the fault from the first decision after it began; the best stack diagnoses by the likelihood ratio of force
and torque, excites its valves, and identifies the fault when that is clear (`UNPROBED`: without excitation,
and at once); the source's method alarms by the norm of the residual and isolates by cross-correlation; the
unprotected one recovers from nothing; `AT_ONCE` knows no more, and flies on branch B from the start. How a
flight ended is the environment's own evaluation, by the true state. One fault in a flight, MSR-A only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np

import thruster_envs  # noqa: F401 - registers the environments
from reproductions.cells import proportion
from thruster_baselines.control import ApproachController, ChaserPilot, ProbeSettings
from thruster_baselines.detection.residuals import (
    BaseNavigationDetector,
    CorrelationDetector,
    FusionDetector,
    margin_threshold,
)
from thruster_envs import rollout
from thruster_envs.faults import KINDS, FaultDistribution
from thruster_envs.spacecraft import load

ENVIRONMENT = "thruster_envs/MarsRendezvous-v1"
ONSET = (0.0, 190.0)
SETTLE = 2.0
"""How long after a start the best stack does not alarm but learns its velocity, s."""
AHEAD = 6.0
"""By how much the likelihood of the thruster it names is ahead of the next; chosen on validation seeds."""

KINDS_OF_FAULT: dict[str, tuple[str, tuple[float, float]]] = {
    "open": ("stuck_on", (1.0, 1.0)),
    "closed": ("stuck_off", (1.0, 1.0)),
    "stuck at": ("stuck_on", (0.2, 0.9)),
    "loss": ("loss", (0.3, 0.9)),
    "leak": ("leak", (0.1, 0.5)),
    "slow": ("slow_opening", (0.1, 0.5)),
    "late": ("late_opening", (0.05, 0.5)),
}
"""Each with its name among the environment's faults and the range of its size: shares, s."""

UNPROBED = "best stack, not probing"
AT_ONCE = "branch B at once"
MARGINS = {"best stack": 1.5, UNPROBED: 1.5, "source's method": 1.3}
"""Of thresholds over the largest statistic of healthy flights: of a squared length, and of a length."""

PILOTS = ("oracle", "best stack", "source's method", "unprotected")
ENDS = ("captured", "retreated", "out of time", "missed or lost")


@dataclass(frozen=True)
class Flight:
    """How a flight went."""

    pilot: str  # who flew
    seed: int  # of the episode
    kind: str  # of the fault, one of `KINDS_OF_FAULT`; `healthy` for none
    thruster: int  # that failed, from 1; 0 for none
    severity: float  # of the fault
    onset: float  # first decision at which it was active, s; infinite if it never was
    end: str  # one of `ENDS`
    duration: float  # s
    alarm: float  # when the first alarm came, s; infinite without
    name: float  # when a thruster was first named, s; infinite without
    named: int  # that thruster, from 1; 0 for none
    said: str  # what was said to be wrong with it
    said_at: float  # when, s; infinite if it was not
    statistic: float  # the detector's largest, up to the first alarm
    fuel: float  # thruster-seconds of open valve

    @property
    def detection(self) -> float:
        """From the onset to the alarm, s; negative for one before, no number without a fault."""
        return self.alarm - self.onset if np.isfinite(self.onset) else float("nan")


def calibrate(seeds: Sequence[int]) -> dict[str, float]:
    """Thresholds by pilot: a margin over the largest statistic of healthy flights."""
    return {
        pilot: margin_threshold([one.statistic for one in fly_healthy(pilot, seeds, {pilot: np.inf})], margin)
        for pilot, margin in MARGINS.items()
    }


def saved(flights: Sequence[Flight]) -> str:
    """The share that was captured or has retreated."""
    return proportion(sum(map(is_saved, flights)), len(flights))


def isolated(flights: Sequence[Flight]) -> int:
    """In how many the thruster that failed is the first that was isolated."""
    return sum(one.named == one.thruster for one in flights)


def endings(by_pilot: Mapping[str, Sequence[Flight]]) -> dict[str, Callable[..., str]]:
    """Columns of a table of pilots: how often their flights ended in each way."""
    return {
        end: (lambda pilot, *_, end=end: str(sum(one.end == end for one in by_pilot[pilot]))) for end in ENDS
    }


def fly_healthy(pilot: str, seeds: Sequence[int], thresholds: dict[str, float]) -> list[Flight]:
    """Flights in which nothing fails."""
    return _batch(pilot, "healthy", seeds, thresholds)


def fly(
    pilot: str,
    seeds: Sequence[int],
    thresholds: dict[str, float],
    *,
    spare_branch: bool = True,
    either_branch: bool = False,
) -> list[Flight]:
    """One flight per seed, with the kinds of fault in turn; in the order of the seeds.

    With a redundant branch or without; its thrusters fail too, and as often, if either branch may.
    """
    branches = {"spare_branch": spare_branch, "either_branch": either_branch}
    flights: list[Flight] = []
    for number, kind in enumerate(KINDS_OF_FAULT):
        if len(seeds) > number:
            flights += _batch(pilot, kind, seeds[number :: len(KINDS_OF_FAULT)], thresholds, **branches)
    return sorted(flights, key=lambda one: one.seed)


def is_saved(flight: Flight) -> bool:
    """Whether it was captured or has retreated."""
    return flight.end in ("captured", "retreated")


def is_affected(flight: Flight) -> bool:
    """Whether the fault began before the flight was over, or an alarm came before it."""
    return bool(np.isfinite(flight.onset) or np.isfinite(flight.alarm))


def of_kind(flights: Iterable[Flight], kind: str) -> list[Flight]:
    """Those that were affected by a kind of fault."""
    return [one for one in flights if one.kind == kind]


def _detector(pilot: str, thresholds: dict[str, float], vehicles: int) -> BaseNavigationDetector | None:
    if pilot in ("best stack", UNPROBED):
        return FusionDetector(
            "msr_chaser", min(thresholds[pilot], 1e12), margin=AHEAD, settle=SETTLE, vehicles=vehicles
        )
    if pilot == "source's method":
        # Its observer, started at rest, needs the settling time that it comes with.
        return CorrelationDetector("msr_chaser", min(thresholds[pilot], 1e12), vehicles=vehicles)
    return None


def _batch(
    pilot: str, kind: str, seeds: Sequence[int], thresholds: dict[str, float],
    spare_branch: bool = True, either_branch: bool = False,
) -> list[Flight]:  # fmt: skip
    count = len(seeds)
    spacecraft = replace(load("msr_chaser"), spare_branch=spare_branch)
    faults = None
    if kind != "healthy":
        name, severity = KINDS_OF_FAULT[kind]
        both = tuple(range(1, 2 * spacecraft.number_of_thrusters + 1))
        faults = FaultDistribution(
            probability=1.0, kinds=(name,), severity={name: severity}, onset=ONSET, onset_grid=0.1,
            thrusters=both if either_branch else None,
        )  # fmt: skip
    envs: Any = gym.make_vec(
        ENVIRONMENT, num_envs=count, vectorization_mode="vector_entry_point", spacecraft=spacecraft,
        inhibit=True, faults=faults,
    )  # fmt: skip
    steps = envs.unwrapped.task.steps
    protected = ChaserPilot(
        spacecraft, steps, _detector(pilot, thresholds, count), vehicles=count,
        probe=ProbeSettings() if pilot == "best stack" else None,
    )  # fmt: skip
    plain = ApproachController(spacecraft, steps)
    onset, largest = np.full(count, np.inf), np.zeros(count)
    known, over = np.zeros((2, count), np.bool_)
    flights: list[Flight | None] = [None] * count
    actions = np.full(envs.action_space.shape, -1.0, np.float32)

    def watch(moment: rollout.Moment) -> None:
        """Note what ends and what begins to fail; the oracle hears of that."""
        time, fault = round(moment.step * spacecraft.control_period, 6), moment.infos["fault"]
        for world in np.flatnonzero(~moment.running & ~over):
            flights[world] = Flight(
                pilot, seeds[world], kind, int(fault["thruster"][world, 0]),
                float(fault["severity"][world, 0]), float(onset[world]), _end(moment.infos, int(world)), time,
                float(protected.alarm_time[world]), float(protected.name_time[world]),
                int(protected.named[world]), str(protected.kind[world]), float(protected.kind_time[world]),
                float(largest[world]), float(moment.infos["fuel"][world]),
            )  # fmt: skip
        over[:] = ~moment.running
        active = fault["active"][:, 0] & ~over
        onset[active] = np.minimum(onset[active], time)
        if pilot == "oracle":
            for world in np.flatnonzero(active & ~known):
                known[world] = True
                failed = KINDS[int(fault["kind"][world, 0]) - 1]
                thruster, severity = int(fault["thruster"][world, 0]), float(fault["severity"][world, 0])
                protected.tell(int(world), thruster, failed, severity)

    def act(observations: Any) -> Any:
        if pilot not in ("unprotected", AT_ONCE):
            found = protected(observations)
            untouched = ~over & ~protected.branch
            largest[untouched] = np.maximum(largest, protected.statistic)[untouched]
            return found
        actions[:, : spacecraft.number_of_thrusters] = plain(observations)
        if pilot == AT_ONCE:
            actions[:, -1] = 1.0
        return actions

    rollout.fly(envs, act, seeds, record=("reward",), callback=watch)
    envs.close()
    return [one for one in flights if one is not None]


def _end(info: dict[str, Any], world: int) -> str:
    """How an episode that has just ended did so."""
    approach = info["approach"]
    ways = (info["success"], approach["retreated"], approach["safe"])
    return next((end for end, so in zip(ENDS, ways, strict=False) if so[world]), ENDS[-1])
