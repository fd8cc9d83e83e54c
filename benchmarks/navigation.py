"""How fast the detectors are that are fed by navigation: one sample of one vehicle, and of many at once.

Residual, decision and isolation, on healthy approaches of `MarsRendezvous-v1`. Isolation begins with an alarm
and ends with a name, so every detector is measured twice: in quiet, and with alarms that stand and name
nobody, where it isolates in every sample. Not measured: construction, calibration, the flights themselves.

``python -m benchmarks.navigation`` runs this section alone.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.environments import profile
from benchmarks.report import AtLeast, AtMost, Row, Section, markdown_table, number, section_as_text
from benchmarks.timing import QUICK, Calls, Effort, Timing, Work, clock_cost, race, race_calls
from thruster_baselines.detection.approach_flights import fly
from thruster_baselines.detection.residuals import (
    BaseNavigationDetector,
    CorrelationDetector,
    FusionDetector,
    NavigationFlights,
    SignatureDetector,
)
from thruster_baselines.mapping.simplex import PARALLEL_FROM
from thruster_envs.spacecraft import load

Samples: TypeAlias = list[tuple[NDArray[np.float64], ...]]
"""Open rates, position, attitude and rate of every vehicle, by sample."""

CHASER = load("msr_chaser")
VEHICLES = 4096
ONE_THREAD_VEHICLES = PARALLEL_FROM // 2
"""So few that no second thread is started."""

FLIGHTS, BATCH_SAMPLES = 64, 32
"""How many flights there are, and of how many samples the pieces are that a batch is given."""

SINGLE_LIMIT = AtMost(20.0)
BATCH_TARGET = AtLeast(2_000_000)

QUIET, ALARMED = "no alarm", "all in alarm"
STATES = {QUIET: math.inf, ALARMED: 0.0}
"""What a detector does, and the threshold with which it does so; it has no time to settle."""

UNSURE = 2**62
"""Samples in a row that a name takes: it never comes."""

DETECTORS: dict[str, Callable[..., BaseNavigationDetector]] = {
    "CorrelationDetector": CorrelationDetector,
    "SignatureDetector": SignatureDetector,
    "FusionDetector": FusionDetector,
}

CLOCK = "CLOCK"
ABOUT = f"""\
Healthy flights of `MarsRendezvous-v1` under its own pilot. A sample is one call of `update` with all checks:
open rates, position, attitude and rate in, diagnosis out. *{QUIET.capitalize()}* is what a detector does
nearly always: residual and decision. *{ALARMED.capitalize()}*, and nobody named, is the worst case, the whole
of residual, decision and isolation: every vehicle correlates or compares signatures in every sample. After an
alarm `FusionDetector` keeps no more samples than it needs, so that it takes no longer then. The detectors are
as they come, but for the threshold, the settling time and the confirmations that bring this about.

Of one vehicle, each sample of a flight is timed by itself, by `time.perf_counter_ns`, whose own {CLOCK} ns
are in the figure. A batch is {VEHICLES:,} vehicles, on as many threads as there are processors;
{ONE_THREAD_VEHICLES} vehicles show what one thread does. Each vehicle has another {BATCH_SAMPLES} samples of
{FLIGHTS} flights; after the last follows the first again. What is wrong with a named thruster is asked once
in a flight; `identify` has its own row."""


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    effort = effort.brief()
    flights = fly(range(8 if effort.quick else FLIGHTS))
    many = 2 * ONE_THREAD_VEHICLES if effort.quick else VEHICLES
    one, together = samples_of(flights), samples_of(flights, many, BATCH_SAMPLES)
    if effort.quick:
        one = one[:BATCH_SAMPLES]
    calls = _singles(effort, one)
    batches = {state: _batches(effort, state, together) for state in STATES}
    rows = [
        *[_single_row(effort, name, state, timed, one) for (name, state), timed in calls.items()],
        _identification(effort, one),
        *[_batch_row(name, state, times, together) for state, times in batches.items() for name in DETECTORS],
    ]
    about = ABOUT.replace(CLOCK, number(1e9 * clock_cost()))
    return Section("Detection from navigation", about, rows, _table(calls, batches, many))


def samples_of(flights: NavigationFlights, vehicles: int = 1, count: int | None = None) -> Samples:
    """What so many vehicles give a detector in so many samples; by default in all of the flight.

    Vehicles beyond the number of flights have later pieces of the same flights.
    """
    total, length = flights.open_rates.shape[:2]
    count = length if count is None else count
    which, turn = np.arange(vehicles) % total, np.arange(vehicles) // total
    begin = turn * (length - count) // max(int(turn[-1]), 1)
    given = (flights.open_rates, flights.position, flights.attitude, flights.rate)
    return [tuple(np.ascontiguousarray(values[which, begin + k]) for values in given) for k in range(count)]


def detector(name: str, state: str, vehicles: int = 1) -> BaseNavigationDetector:
    """One that is in that state from the second sample on."""
    return DETECTORS[name](CHASER, STATES[state], settle=0.0, confirmations=UNSURE, vehicles=vehicles)


# One vehicle ----------------------------------------------------------------------------------------------


def _singles(effort: Effort, samples: Samples) -> dict[tuple[str, str], Calls]:
    """Times of single samples, by detector and by what it does."""
    works: dict[str, Work] = {}
    keys = [(name, state) for name in DETECTORS for state in STATES]
    for name, state in keys:
        works[f"{name}, {state}"] = (detector(name, state).update, samples)
    calls = race_calls(works, effort)
    return {(name, state): calls[f"{name}, {state}"] for name, state in keys}


def _single_row(effort: Effort, name: str, state: str, calls: Calls, samples: Samples) -> Row:
    def explain() -> str:
        return profile(_endless(detector(name, state), samples), 50 if effort.quick else 5_000)

    return Row(
        f"one vehicle: {name}, {state}", 1e6 * calls.median, "µs", SINGLE_LIMIT,
        note=f"99th percentile {number(1e6 * calls.percentile(99.0))} µs", charted=True, explain=explain,
    )  # fmt: skip


def _identification(effort: Effort, samples: Samples) -> Row:
    """One call of `identify`, with all that is kept of a flight."""
    fusion = FusionDetector(CHASER, math.inf)
    for sample in samples:
        fusion.update(*sample)
    time = race({"identify": lambda: fusion.identify([1])}, effort)["identify"]
    return Row(
        "one vehicle: FusionDetector.identify", 1e6 * time.seconds, "µs",
        note="of a named thruster, not of every sample",
    )  # fmt: skip


def _endless(detector: BaseNavigationDetector, samples: Samples) -> Callable[[], None]:
    """One sample after the other, and after the last the first again."""
    pending = cycle(samples)

    def work() -> None:
        detector.update(*next(pending))

    return work


# Batches --------------------------------------------------------------------------------------------------


def _batches(effort: Effort, state: str, samples: Samples) -> dict[tuple[str, int], Timing]:
    """Times of a sample of many vehicles, and of so few that one thread does them."""
    many = len(samples[0][0])
    few = [tuple(one[:ONE_THREAD_VEHICLES] for one in sample) for sample in samples]
    keys = [(name, count) for name in DETECTORS for count in (ONE_THREAD_VEHICLES, many)]
    works = {
        f"{name}, {state}, {count:,}": _endless(
            detector(name, state, count), few if count == ONE_THREAD_VEHICLES else samples
        )
        for name, count in keys
    }
    times = race(works, effort, threaded=True)
    return {(name, count): times[f"{name}, {state}, {count:,}"] for name, count in keys}


def _batch_row(name: str, state: str, times: dict[tuple[str, int], Timing], samples: Samples) -> Row:
    many = len(samples[0][0])
    timing, alone = times[name, many], times[name, ONE_THREAD_VEHICLES]
    gain = timing.times_faster_than(alone, own=many, others=ONE_THREAD_VEHICLES)
    return Row(
        f"batch of {many:,}: {name}, {state}", timing.per_second(many), "samples/s", BATCH_TARGET,
        ratio=f"{gain:.2f} times that of {ONE_THREAD_VEHICLES}", charted=True,
        explain=lambda: profile(_endless(detector(name, state, many), samples), max(4, 200_000 // many)),
    )  # fmt: skip


def _table(
    calls: dict[tuple[str, str], Calls], batches: dict[str, dict[tuple[str, int], Timing]], many: int
) -> str:
    lines = [
        (
            name,
            state,
            number(1e6 * one.median),
            number(1e6 * one.percentile(99.0)),
            number(1e6 / ONE_THREAD_VEHICLES * batches[state][name, ONE_THREAD_VEHICLES].seconds),
            number(1e6 / many * batches[state][name, many].seconds),
        )
        for (name, state), one in calls.items()
    ]
    headings: tuple[str, ...] = (
        "detector", "state", "one vehicle", "99th percentile", f"a vehicle of {ONE_THREAD_VEHICLES}",
        f"a vehicle of {many:,}",
    )  # fmt: skip
    return "### One sample of every detector (µs)\n\n" + markdown_table(headings, lines)


def main(arguments: Sequence[str] = ()) -> None:
    """Measure and print this section."""
    print(section_as_text(measure(QUICK if "--quick" in arguments else Effort())))


if __name__ == "__main__":
    main(sys.argv[1:])
