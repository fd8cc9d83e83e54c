"""How fast detection is: one vehicle's filter and test, batches of vehicles, every detector, and filterpy.

One update from Python and batches on as many threads as there are processors, in every exact form of the
filter's covariance; then the other detectors, and the same filter written with filterpy. Not measured:
construction, calibration of thresholds, and the first updates of each.

``python -m benchmarks.detection`` runs this section alone.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.environments import profile
from benchmarks.report import AtLeast, AtMost, Row, Section, markdown_table, number, section_as_text, version
from benchmarks.timing import QUICK, Calls, Effort, Timing, Work, clock_cost, race, race_calls
from thruster_baselines.detection import (
    CUSUMDetector,
    EstimatorThreshold,
    FilterBank,
    Firings,
    GenericChiSquared,
    GLRDetector,
    ResponseTest,
    SetChiSquared,
    SingleChiSquared,
    WindowedGLR,
    healthy_firings,
)
from thruster_baselines.detection.glr import SOURCE_THRESHOLD
from thruster_baselines.detection.settings import SOURCE_MEASUREMENT_NOISE, SOURCE_PROCESS_NOISE
from thruster_baselines.estimation import EffectivenessFilter, PhysicalNoise
from thruster_baselines.mapping.simplex import PARALLEL_FROM
from thruster_envs.spacecraft import load

Array: TypeAlias = NDArray[np.float64]
Update: TypeAlias = Callable[[Array, Array, float], object]
"""Takes on-times, rate changes and the duration of an interval."""

ORION = load("orion")
UPDATES = 2048
"""Different firings that one vehicle is given."""

OPEN = 6
"""Thrusters that each firing opens: no more are needed for six axes."""

DURATION = 1.0
"""Of an interval, s."""

SINGLE_LIMIT = AtMost(50.0)
FILTERPY_TARGET = AtLeast(100.0)
THREADED_BATCH = 4096
LARGE_BATCH = 65_536
ONE_THREAD_BATCH = PARALLEL_FROM // 2
"""So few that no second thread is started."""

CLOCK = "CLOCK"


@dataclass(frozen=True)
class Noise:
    """A choice of how large errors are, which decides on the form of the filter.

    Attributes:
        words: For a reader.
        arguments: Of a detector.
        batches: Sizes that are measured beside that of one thread.
        target: Vehicle-updates a second, of all of them.
    """

    words: str
    arguments: dict[str, Any]
    batches: tuple[int, ...]
    target: AtLeast | None = None


FORMS = {
    "shared": Noise("R a multiple of the identity", {}, (THREADED_BATCH, LARGE_BATCH), AtLeast(1e6)),
    "by_axis": Noise(
        "R diagonal", {"noise": SOURCE_MEASUREMENT_NOISE * np.repeat([1.0, 0.1], 3)},
        (THREADED_BATCH, LARGE_BATCH), AtLeast(2e5),
    ),
    "full": Noise(
        "R full", {"noise": PhysicalNoise(ORION), "process_noise": SOURCE_PROCESS_NOISE},
        (THREADED_BATCH // 4,),
    ),
    "known": Noise("nothing learned", {"noise": PhysicalNoise(ORION)}, (THREADED_BATCH, LARGE_BATCH)),
}  # fmt: skip
"""Form of the filter to the noise that leads to it."""

LEARNING_BANK = "FilterBank, learning"

OTHERS: dict[str, Callable[[int], Any]] = {
    "EstimatorThreshold": lambda count: EstimatorThreshold(ORION, vehicles=count),
    "GenericChiSquared": lambda count: GenericChiSquared(ORION, 30.0, **_physical(count)),
    "SingleChiSquared": lambda count: SingleChiSquared(ORION, 30.0, **_physical(count)),
    "SetChiSquared": lambda count: SetChiSquared(ORION, 30.0, **_physical(count)),
    "WindowedGLR": lambda count: WindowedGLR(ORION, 30.0, **_physical(count)),
    "CUSUMDetector": lambda count: CUSUMDetector(ORION, 30.0, **_physical(count)),
    "FilterBank": lambda count: FilterBank(ORION, 30.0, **_physical(count)),
    LEARNING_BANK: lambda count: FilterBank(ORION, 30.0, vehicles=count),
    "ResponseTest": lambda count: ResponseTest(ORION, 30.0, count),
}
"""Name to a maker of a detector for that many vehicles; what is above the threshold takes no longer."""

OTHERS_BATCH = 1024

ABOUT = f"""\
Orion, intervals of {DURATION:g} s in which {OPEN} of the twelve thrusters fire, with the loss of the shared
feed and the scatter of the thrusts. An update is the public call with all checks: on-times and measured rate
change in, diagnosis out. *Filter and GLR* is `GLRDetector(...).update`, which brings the filter of all 72
entries of the effectiveness up to date and tests all thrusters. The noise decides on the form in which the
filter carries its covariance: one 12x12 matrix where R, Q and the first covariance are multiples of the
identity (the source's R = {SOURCE_MEASUREMENT_NOISE:g} and Q = {SOURCE_PROCESS_NOISE:g}), one for each axis
where they are diagonal, 72x72 where R is full (`PhysicalNoise`, which is another for every firing, with the
source's Q), and none where nothing is learned (`PhysicalNoise` as it comes).

Of one vehicle, each of {UPDATES:,} updates is timed by itself, by `time.perf_counter_ns`, whose own {CLOCK}
ns are in the figure. A batch is one call for that many vehicles, each with its own firing; from
{PARALLEL_FROM} vehicles on the filter and the likelihood ratio have as many threads as there are processors,
so that {ONE_THREAD_BATCH} vehicles show what one thread does. The other detectors have `PhysicalNoise` and
learn nothing; the threshold on the estimate, which has to learn, and the bank named so have the source's R
and Q. `ResponseTest` has no filter.

*filterpy* runs the same filter, a `KalmanFilter` of 72 states for one vehicle, `predict()` and `update()`,
without a test; its measurement matrices are made beforehand. It takes the same time whatever R is. Two
comparisons with it have the target: the throughput of a batch, and that of one call after the other."""


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    effort = effort.brief()
    peer = importlib.import_module("filterpy.kalman") if importlib.util.find_spec("filterpy") else None
    firings = orion_firings(24 if effort.quick else UPDATES)
    singles, single_rows = _singles(effort, firings, peer)
    batch_rows = []
    for form, noise in FORMS.items():
        batch_rows += _batches(effort, form, noise, firings, peer)
    other_rows, table = _others(effort, firings)
    rows = [*single_rows, *batch_rows, *_against_filterpy(effort, singles, firings, peer), *other_rows]
    about = ABOUT.replace(CLOCK, number(1e9 * clock_cost()))
    return Section("Detection", about, rows, f"{_table(singles)}\n\n{table}")


def orion_firings(count: int, seed: int = 0) -> Firings:
    """Firings of a sound Orion, and what it measures."""
    return healthy_firings(ORION, count, seed=seed, open_thrusters=OPEN, duration=DURATION)


def glr(form: str, vehicles: int = 1) -> GLRDetector:
    """Filter and likelihood ratio, with the noise that leads to that form."""
    return GLRDetector.yang2003(ORION, SOURCE_THRESHOLD, vehicles=vehicles, **FORMS[form].arguments)


def _physical(count: int) -> dict[str, Any]:
    return {"noise": PhysicalNoise(ORION), "vehicles": count}


# One vehicle ----------------------------------------------------------------------------------------------


def _singles(effort: Effort, firings: Firings, peer: ModuleType | None) -> tuple[dict[str, Calls], list[Row]]:
    """Times of one update, of our forms with and without a test and of filterpy; rows of those with one."""
    works: dict[str, Work] = {form: _one_by_one(glr(form).update, firings) for form in FORMS}
    works |= {f"{form}, filter alone": _filter_alone(form, firings) for form in FORMS}
    if peer is not None:
        works["filterpy"] = one_by_one_with_filterpy(filterpy_filter(peer), firings)
    calls = race_calls(works, effort)
    rows = [
        Row(
            f"one vehicle: filter and GLR, {noise.words}", 1e6 * calls[form].median, "µs", SINGLE_LIMIT,
            note=f"form `{form}`; 99th percentile {_micro(calls[form].percentile(99.0))} µs", charted=True,
            explain=lambda form=form: _explain_single(effort, form, firings),
        )
        for form, noise in FORMS.items()
    ]  # fmt: skip
    return calls, rows


def _one_by_one(update: Update, firings: Firings) -> Work:
    return update, [
        (on_times, rate_change, firings.duration)
        for on_times, rate_change in zip(firings.on_times, firings.rate_change, strict=True)
    ]


def _filter_alone(form: str, firings: Firings) -> Work:
    """Updates of the filter without a test, checked; with an R of its own where it is another each time."""
    estimator, noise = glr(form).filter, FORMS[form].arguments.get("noise")

    def update(on_times: Array, rate_change: Array, _: float) -> object:
        own = noise(on_times)[np.newaxis] if isinstance(noise, PhysicalNoise) else None
        return estimator.update(on_times, rate_change, measurement_noise=own)

    return _one_by_one(update, firings)


def filterpy_filter(peer: ModuleType) -> Any:
    """The filter of 72 states with the source's noise, columns of the effectiveness stacked."""
    nominal = ORION.effectiveness()
    m, n = nominal.shape
    other = peer.KalmanFilter(dim_x=m * n, dim_z=m)
    other.x = nominal.T.reshape(m * n, 1).copy()
    other.F = np.eye(m * n)
    other.P = SOURCE_PROCESS_NOISE * np.eye(m * n)
    other.Q = SOURCE_PROCESS_NOISE * np.eye(m * n)
    other.R = SOURCE_MEASUREMENT_NOISE * np.eye(m)
    return other


def one_by_one_with_filterpy(other: Any, firings: Firings) -> Work:
    """The same updates for filterpy's filter."""
    axes = np.eye(firings.rate_change.shape[1])

    def update(rate_change: Array, measurement_matrix: Array) -> None:
        other.predict()
        other.update(rate_change, H=measurement_matrix)

    return update, [
        (rate_change[:, np.newaxis], np.kron(on_times, axes))
        for on_times, rate_change in zip(firings.on_times, firings.rate_change, strict=True)
    ]


def _table(singles: dict[str, Calls]) -> str:
    """One update in all forms, in µs, beside filterpy's."""
    lines = []
    for name, calls in singles.items():
        gain = "" if "filterpy" not in singles else number(calls.times_faster_than(singles["filterpy"]))
        what = name if name == "filterpy" or "alone" in name else f"{name}, filter and GLR"
        lines.append((what, _micro(calls.median), _micro(calls.percentile(99.0)), gain))
    headings = ("form", "median", "99th percentile", "times as fast as filterpy")
    return "### One update of one vehicle (µs)\n\n" + markdown_table(headings, lines)


def _micro(seconds: float) -> str:
    return number(1e6 * seconds)


def _explain_single(effort: Effort, form: str, firings: Firings) -> str:
    return _explain_calls(effort, glr(form).update, firings)


def _explain_calls(effort: Effort, update: Update, firings: Firings) -> str:
    return profile(_endless(_one_by_one(update, firings)), 50 if effort.quick else 5_000)


def _endless(calls: Work) -> Callable[[], None]:
    """One call after the other, and after the last the first again."""
    function, arguments = calls
    pending = cycle(arguments)

    def work() -> None:
        function(*next(pending))

    return work


# Batches --------------------------------------------------------------------------------------------------


def _batches(effort: Effort, form: str, noise: Noise, firings: Firings, peer: ModuleType | None) -> list[Row]:
    few, *many = (48, 64) if effort.quick else (ONE_THREAD_BATCH, *noise.batches)
    works = {str(few): batch_work(form, few)}
    if peer is not None:
        works["filterpy"] = _endless(one_by_one_with_filterpy(filterpy_filter(peer), firings))
    alone = race(works, effort)
    times = race({**works, **{str(count): batch_work(form, count) for count in many}}, effort, threaded=True)
    rows = [
        Row(
            f"batch of {few:,}: filter and GLR, {noise.words}", alone[str(few)].per_second(few), "updates/s",
            ratio="; ".join(_over_filterpy(alone, few)), note=f"form `{form}`, one thread",
        )
    ]  # fmt: skip
    for count in many:
        timing = times[str(count)]
        gain = timing.times_faster_than(times[str(few)], own=count, others=few)
        rows.append(
            Row(
                f"batch of {count:,}: filter and GLR, {noise.words}", timing.per_second(count), "updates/s",
                noise.target,
                ratio="; ".join([f"{gain:.2f} times that of {few:,}", *_over_filterpy(times, count)]),
                note=f"form `{form}`, as many threads as processors", charted=True,
                explain=lambda count=count: _explain_batch(form, count),
            )
        )  # fmt: skip
    return rows


def _over_filterpy(times: dict[str, Timing], count: int) -> list[str]:
    """How many times filterpy's throughput that of a batch is, if it was raced with it."""
    if "filterpy" not in times:
        return []
    return [f"{number(times[str(count)].times_faster_than(times['filterpy'], own=count))} times filterpy's"]


def batch_work(form: str, count: int) -> Callable[[], None]:
    """One update of that many vehicles, with other firings in turn."""
    return _in_turn(glr(form, count).update, count)


def _in_turn(update: Update, count: int) -> Callable[[], None]:
    pending = cycle([orion_firings(count, seed) for seed in range(2)])

    def work() -> None:
        firings = next(pending)
        update(firings.on_times, firings.rate_change, firings.duration)

    return work


def _explain_batch(form: str, count: int) -> str:
    return profile(batch_work(form, count), max(4, 100_000 // count))


# filterpy -------------------------------------------------------------------------------------------------


def _against_filterpy(
    effort: Effort, singles: dict[str, Calls], firings: Firings, peer: ModuleType | None
) -> list[Row]:
    """Our throughput over that of filterpy's filter, where R is a multiple of the identity."""
    size = 64 if effort.quick else THREADED_BATCH
    alone = 48 if effort.quick else ONE_THREAD_BATCH
    unit = "times filterpy's"
    names = (
        f"throughput, batch of {size:,} against one by one",
        f"throughput, batch of {alone:,} without a test on one thread against one by one",
        "throughput, one by one against one by one",
        "throughput, one by one without a test against one by one",
    )
    if peer is None:
        missing = "not installed (extra `bench`)"
        return [
            Row("filterpy: one vehicle, filter alone", None, "µs", note=missing, own=False),
            *[Row(name, None, unit, note=missing) for name in names],
        ]
    other = _endless(one_by_one_with_filterpy(filterpy_filter(peer), firings))
    threaded = race({"batch": batch_work("shared", size), "filterpy": other}, effort, threaded=True)
    times = race({"filter alone": _filter_batch(alone), "filterpy": other}, effort)
    theirs = singles["filterpy"]
    return [
        Row(
            "filterpy: one vehicle, filter alone", 1e6 * theirs.median, "µs",
            note=f"filterpy {version('filterpy')}", charted=True, own=False,
        ),
        Row(
            names[0], threaded["batch"].times_faster_than(threaded["filterpy"], own=size), unit,
            FILTERPY_TARGET,
            note="filter and GLR against the filter alone; as many threads as processors against one",
            explain=lambda: _explain_batch("shared", size),
        ),
        Row(
            names[1], times["filter alone"].times_faster_than(times["filterpy"], own=alone), unit,
            note="filter against filter, one thread against one",
        ),
        Row(
            names[2], singles["shared"].times_faster_than(theirs), unit, FILTERPY_TARGET,
            note="filter and GLR against the filter alone",
            explain=lambda: _explain_against(effort, times, alone, singles, firings),
        ),
        Row(
            names[3], singles["shared, filter alone"].times_faster_than(theirs), unit,
            note="filter against filter, both called from Python for every interval",
        ),
    ]  # fmt: skip


def _filter_batch(count: int) -> Callable[[], None]:
    own = EffectivenessFilter(ORION, SOURCE_PROCESS_NOISE, SOURCE_MEASUREMENT_NOISE, vehicles=count)
    return _in_turn(lambda on_times, rate_change, _: own.update(on_times, rate_change), count)


def _explain_against(
    effort: Effort, times: dict[str, Timing], count: int, singles: dict[str, Calls], firings: Firings
) -> str:
    """What the target would leave for a call from Python, and what such a call takes."""
    lines = [
        ("a hundredth of filterpy's update", _micro(singles["filterpy"].median / FILTERPY_TARGET.value)),
        ("our filter in a batch on one thread, a vehicle", _micro(times["filter alone"].seconds / count)),
        ("our filter, called for one vehicle", _micro(singles["shared, filter alone"].median)),
        ("filter and GLR, called for one vehicle", _micro(singles["shared"].median)),
    ]
    table, spent = markdown_table(("what", "µs"), lines), _explain_single(effort, "shared", firings)
    return f"{table}\n\nWhat a call adds is the way from Python into the kernels, and the checks:\n\n{spent}"


# Other detectors ------------------------------------------------------------------------------------------


def _others(effort: Effort, firings: Firings) -> tuple[list[Row], str]:
    count = 64 if effort.quick else OTHERS_BATCH
    makers = {"GLRDetector": lambda vehicles: glr("known", vehicles), **OTHERS}
    alone = {name: _one_by_one(_update_of(make(1)), firings) for name, make in makers.items()}
    calls = race_calls(alone, effort)
    together = {name: _in_turn(_update_of(make(count)), count) for name, make in makers.items()}
    batches = race(together, effort, threaded=True)
    rows = [
        Row(
            f"one vehicle: {name}", 1e6 * calls[name].median, "µs", SINGLE_LIMIT,
            ratio=f"{number(calls['GLRDetector'].times_faster_than(calls[name]))} times `GLRDetector`'s time",
            note=f"{_micro(batches[name].seconds / count)} µs a vehicle in a batch of {count:,}",
            explain=lambda make=make: _explain_calls(effort, _update_of(make(1)), firings),
        )
        for name, make in OTHERS.items()
    ]  # fmt: skip
    lines = [
        (
            name,
            _micro(calls[name].median),
            _micro(calls[name].percentile(99.0)),
            _micro(batches[name].seconds / count),
            number(batches[name].per_second(count)),
        )
        for name in makers
    ]
    headings = ("detector", "one vehicle", "99th percentile", f"a vehicle of {count:,}", "updates/s")
    return rows, "### One update of every detector (µs)\n\n" + markdown_table(headings, lines)


def _update_of(detector: Any) -> Update:
    """Its update; of one without a clock, without the duration."""
    if isinstance(detector, ResponseTest):
        nominal = ORION.effectiveness().T
        return lambda on_times, rate_change, _: detector.update(on_times, rate_change - on_times @ nominal)
    return detector.update  # type: ignore[no-any-return]  # of any detector


def main(arguments: Sequence[str] = ()) -> None:
    """Measure and print this section."""
    print(section_as_text(measure(QUICK if "--quick" in arguments else Effort())))


if __name__ == "__main__":
    main(sys.argv[1:])
