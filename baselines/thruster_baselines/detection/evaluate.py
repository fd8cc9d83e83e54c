"""The evaluation protocol of detectors: how soon, how surely, how often wrongly, and whom they isolate.

The threshold is calibrated to a false-alarm rate on healthy flights of the validation seeds; all that is
reported comes from flights of the test seeds. A vehicle that alarms without a fault is reset and flies on.
Measured are the delay from the onset to the end of the interval of the first alarm after it (a missed fault
is infinitely late), missed faults, false alarms per hour, isolation with a confusion matrix, identification
where a method is given, the time of an update, and the curve of delay against false alarms, without resets
and without flights that alarm before the onset. Rates come with Clopper-Pearson intervals.

Left out: flights in which several thrusters fail.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from thruster_baselines.detection.calibration import (
    FLOWN_TOGETHER,
    Calibration,
    statistics_of,
    threshold_for_rate,
)
from thruster_baselines.detection.contract import AnyDetector, reader_of
from thruster_baselines.detection.flights import FlightSource, RecordedFlights
from thruster_baselines.detection.identification import (
    Identification,
    ModelComparison,
    least_squares_severity,
)
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.extras import extra
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.seeds import TEST, VALIDATION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["CurvePoint", "Evaluation", "Identifier", "Rate", "by_model_comparison", "evaluate", "table"]

Identifier: TypeAlias = Callable[[Any, IntArray], Identification]
"""Says how the named thrusters (vehicles,), from 1 and 0 for none, fail, right after an update."""

_TIMED_UPDATES = 300
"""Updates of a single vehicle that are timed."""


@dataclass(frozen=True, slots=True)
class Rate:
    """A rate and its exact interval.

    Attributes:
        value: Successes over trials; NaN without trials.
        low: Lower end of the Clopper-Pearson interval.
        high: Upper end.
        successes: How often it happened.
        trials: Of how many times.
    """

    value: float
    low: float
    high: float
    successes: int
    trials: int

    @classmethod
    def of(cls, successes: int, trials: int, confidence: float) -> Rate:
        """The rate of so many successes."""
        if trials == 0:
            return cls(math.nan, 0.0, 1.0, 0, 0)
        low, high = clopper_pearson(successes, trials, confidence)
        return cls(successes / trials, low, high, successes, trials)


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """What one threshold gives on the test flights.

    Attributes:
        threshold: Set on the validation flights.
        stated: False alarms per interval that it was calibrated to.
        false_alarms_per_hour: By healthy flights with an alarm.
        median_delay: s, over the faulty flights without an alarm before the onset; infinite if half of them
            are missed.
        delay_90: s, what nine of ten of them do not exceed.
        missed: Share of those flights.
    """

    threshold: float
    stated: float
    false_alarms_per_hour: float
    median_delay: float
    delay_90: float
    missed: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What the yardstick says of one detector. Times in s.

    Attributes:
        name: Of the detector.
        calibration: The threshold and how it was found.
        median_delay: Over all faulty flights; infinite if half are missed.
        delay_90: The delay that nine of ten do not exceed.
        missed: Of the faulty flights.
        false_alarms: Of the healthy intervals.
        false_alarms_per_hour: The same per hour of flight: value, lower and upper end.
        hours_between_false_alarms: Its inverse: value, lower and upper end; infinite without an alarm.
        isolated: Of the detected, how many are named rightly.
        confusion: (n + 1, n + 2) flights. Row 0: healthy, row i: thruster i fails. Column 0: no alarm, column
            i: thruster i named, last column: an alarm that names nobody.
        identified: Of the rightly named, how many kinds are right; None without a method for it.
        severity_error: Median of the absolute error of the severity where the kind is right, and is neither
            all off nor all on; None without such flights.
        by_kind: For each kind of fault its missed rate and median delay.
        curve: Delay against false alarms.
        update_time: Median of an update of a single vehicle.
        update_time_in_batch: Per vehicle.
        flights: Faulty ones, and as many healthy ones.
        intervals: In each.
        duration: Of an interval.
    """

    name: str
    calibration: Calibration
    median_delay: float
    delay_90: float
    missed: Rate
    false_alarms: Rate
    false_alarms_per_hour: tuple[float, float, float]
    hours_between_false_alarms: tuple[float, float, float]
    isolated: Rate
    confusion: tuple[tuple[int, ...], ...]
    identified: Rate | None
    severity_error: float | None
    by_kind: dict[str, tuple[Rate, float]]
    curve: tuple[CurvePoint, ...]
    update_time: float
    update_time_in_batch: float
    flights: int
    intervals: int
    duration: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values; what is infinite or no number becomes None, as JSON has neither."""
        plain: dict[str, Any] = _plain(dataclasses.asdict(self))
        return plain

    def to_json(self) -> str:
        """All of it as JSON."""
        return json.dumps(self.to_dict(), indent=2)

    def to_markdown(self) -> str:
        """The row of this detector, with the head of the table, and its confusion matrix."""
        n = len(self.confusion) - 1
        names = [str(i) for i in range(1, n + 1)]
        lines = [
            table([self]),
            "",
            "Rows: the thruster that fails; columns: the one that is named.",
            "",
            "| | no alarm | " + " | ".join(names) + " | nobody |",
            "|" + "---|" * (n + 3),
        ]
        for name, row in zip(["healthy", *names], self.confusion, strict=True):
            lines.append(f"| {name} | " + " | ".join(str(one) for one in row) + " |")
        return "\n".join(lines)

    def figure(self, path: str | Path) -> None:
        """Draw the curve of delay against false alarms and the confusion matrix into a file."""
        with extra("agents", "a figure of an evaluation"):
            from matplotlib.backends.backend_agg import FigureCanvasAgg  # only here: needs the agents' extra
            from matplotlib.figure import Figure

        figure = Figure(figsize=(11.0, 4.5), layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        alarms = [one.false_alarms_per_hour for one in self.curve]
        for label, delays in (
            ("median", [one.median_delay for one in self.curve]),
            ("90 %", [one.delay_90 for one in self.curve]),
        ):
            left.plot(alarms, delays, marker="o", label=label)  # what is infinite is not drawn
        left.set_ylim(bottom=0.0)
        left.legend()
        once = 3600.0 / (self.false_alarms.trials * self.duration)  # the rate of a single alarm
        left.set_xscale("symlog", linthresh=once)
        left.set_xlim(left=0.0)
        left.set_xlabel("false alarms per hour")
        left.set_ylabel("detection delay (s)")
        left.set_title(self.name)
        left.grid(visible=True, alpha=0.3)
        self.draw_confusion(right)
        figure.savefig(path, dpi=120)

    def draw_confusion(self, axes: Axes) -> None:
        """Draw who is taken for whom, in percent of the flights of each row, into axes of matplotlib."""
        counts = np.array(self.confusion, dtype=np.float64)
        shares = 100.0 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
        for row, column in zip(*np.nonzero(counts), strict=True):
            share = shares[row, column]
            axes.annotate(
                f"{share:.0f}" if share >= 0.95 else f"{share:.1f}", (column, row), ha="center", va="center",
                fontsize=8.0, color="white" if share > 60.0 else "black",
            )  # fmt: skip
        names = [str(i) for i in range(1, counts.shape[0])]
        axes.set_xticks(range(counts.shape[1]), ["no\nalarm", *names, "no\nname"])
        axes.set_yticks(range(counts.shape[0]), ["healthy", *names])
        axes.set_xlabel("named")
        axes.set_ylabel("fails")
        axes.grid(visible=False)


def table(evaluations: Sequence[Evaluation]) -> str:
    """A Markdown table, one row for each detector; intervals in brackets."""
    head = [
        "detector", "threshold", "median delay (s)", "90 % delay (s)", "missed", "false alarms per hour",
        "mean time between (h)", "named rightly", "kind right", "severity error", "update (µs)",
        "in batch (µs)",
    ]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for one in evaluations:
        cells = [
            one.name,
            f"{one.calibration.threshold:.4g}",
            _seconds(one.median_delay),
            _seconds(one.delay_90),
            _share(one.missed),
            _three(one.false_alarms_per_hour),
            _three(one.hours_between_false_alarms),
            _share(one.isolated),
            "" if one.identified is None else _share(one.identified),
            "" if one.severity_error is None else f"{one.severity_error:.3f}",
            f"{1e6 * one.update_time:.1f}",
            f"{1e6 * one.update_time_in_batch:.2f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def by_model_comparison(comparison: ModelComparison) -> Identifier:
    """Identification by comparing models, for detectors that keep their last interval (`BaseDetector`).

    The size of a loss or of a leak is that of least squares, which is not held to the levels of the models.
    """

    def identify(detector: AnyDetector, thruster: IntArray) -> Identification:
        last = getattr(detector, "last", None)
        if last is None:
            raise ValueError(
                f"{type(detector).__name__} keeps no interval in `last`; a detector built on BaseDetector, "
                "or an identifier of its own, would be right"
            )
        answer, size = comparison(last, thruster), least_squares_severity(last, thruster)
        kinds = np.array(answer.kind)
        severity = np.where(
            kinds == "loss", size.loss, np.where(kinds == "leak", size.opening, answer.severity)
        )
        return dataclasses.replace(answer, severity=severity)

    return identify


def evaluate(
    make: Callable[[int], AnyDetector],
    source: FlightSource,
    *,
    name: str,
    false_alarms: float,
    validation: Sequence[int] = VALIDATION[:2000],
    test: Sequence[int] = TEST[:2000],
    confidence: float = 0.95,
    identify: Identifier | None = None,
    rates: Sequence[float] = tuple(np.logspace(-1.0, -4.0, 13).tolist()),
    patience: float = 0.0,
) -> Evaluation:
    """Measure one detector.

    Args:
        make: Builds a detector for so many vehicles.
        source: Of flights; see `RandomFlights`.
        name: Of the detector, for people.
        false_alarms: Rate per interval that the threshold is calibrated to.
        validation: Seeds of the flights on which thresholds are set.
        test: Seeds of the flights that are reported on.
        confidence: Of the calibration and of all intervals.
        identify: Says how a named thruster fails; see `by_model_comparison`.
        rates: Of the curve, per interval; those that the validation flights cannot show are left out.
        patience: For how long after the alarm a detector may wait before it names a thruster, s.

    Raises:
        ValueError: Seeds that stand in both sets; too few validation flights for the rate.
    """
    both = set(validation) & set(test)
    if both:
        raise ValueError(
            f"seed {min(both)} is in validation and in test; disjoint sets, as in thruster_envs.seeds, would "
            "be right"
        )
    validated = statistics_of(make, source(validation, False))
    calibration = threshold_for_rate(validated, false_alarms, confidence)
    healthy, faulty = source(test, False), source(test, True)
    duration, intervals = healthy.duration, healthy.on_times.shape[1]

    fault_free = _fly(make, healthy, calibration.threshold, None, patience)
    flown = _fly(make, faulty, calibration.threshold, identify, patience)
    affected = faulty.onset < intervals * duration
    delays = np.where(flown.found, flown.end - faulty.onset, np.inf)[affected]
    missed = int((~flown.found[affected]).sum())
    right = affected & flown.found & (flown.named == faulty.thruster)
    rate = Rate.of(fault_free.false_alarms, healthy.on_times.shape[0] * intervals, confidence)
    per_hour = (rate.value * 3600.0 / duration, rate.low * 3600.0 / duration, rate.high * 3600.0 / duration)
    identified, severity_error = None, None
    if identify is not None:
        truth = [_family(kind, size) for kind, size in zip(faulty.kind, faulty.severity, strict=True)]
        fits = right & np.array([one == other for one, other in zip(flown.kind, truth, strict=True)])
        identified = Rate.of(int(fits.sum()), int(right.sum()), confidence)
        sized = fits & np.array([one not in ("stuck_off", "stuck_on") for one in truth])
        if sized.any():
            severity_error = float(np.median(np.abs(flown.severity - faulty.severity)[sized]))
    return Evaluation(
        name=name,
        calibration=calibration,
        median_delay=_quantile(delays, 0.5),
        delay_90=_quantile(delays, 0.9),
        missed=Rate.of(missed, int(affected.sum()), confidence),
        false_alarms=rate,
        false_alarms_per_hour=per_hour,
        hours_between_false_alarms=(_inverse(per_hour[0]), _inverse(per_hour[2]), _inverse(per_hour[1])),
        isolated=Rate.of(int(right.sum()), int(affected.sum()) - missed, confidence),
        confusion=_confusion(healthy, fault_free, faulty, flown, affected),
        identified=identified,
        severity_error=severity_error,
        by_kind=_by_kind(faulty, flown, affected, confidence),
        curve=_curve(make, validated, healthy, faulty, rates, confidence),
        update_time=_time_alone(make, healthy),
        update_time_in_batch=fault_free.seconds / (healthy.on_times.shape[0] * intervals),
        flights=int(affected.sum()),
        intervals=intervals,
        duration=duration,
    )


class _Flown:
    """What a detector did on some flights.

    Attributes:
        found: (flights,), whether there was an alarm that counts: the first one after the onset, or the first
            at all in a healthy flight.
        end: (flights,), s: the end of its interval.
        named: (flights,), from 1; 0 for nobody.
        kind: Of each flight, what was identified.
        severity: (flights,).
        false_alarms: Before the onset, all flights together.
        seconds: Of computing time in updates.
    """

    def __init__(self, count: int) -> None:
        self.found = np.zeros(count, np.bool_)
        self.end = np.full(count, np.inf)
        self.named = np.zeros(count, np.int64)
        self.kind = ["none"] * count
        self.severity = np.zeros(count)
        self.false_alarms = 0
        self.seconds = 0.0


def _fly(
    make: Callable[[int], AnyDetector],
    flights: RecordedFlights,
    threshold: float,
    identify: Identifier | None,
    patience: float,
) -> _Flown:
    """Fly them with resets after false alarms."""
    count, intervals = flights.on_times.shape[:2]
    flown = _Flown(count)
    for first in range(0, count, FLOWN_TOGETHER):
        part = slice(first, min(first + FLOWN_TOGETHER, count))
        detector = make(part.stop - part.start)
        detector.threshold = threshold
        detector.reset()
        read = reader_of(detector)
        healthy = np.isinf(flights.onset[part])
        waiting = np.zeros(part.stop - part.start, np.bool_)
        for t in range(intervals):
            telemetry = flights.telemetry(part, t)
            begin = time.perf_counter()
            diagnosis = read(telemetry)
            flown.seconds += time.perf_counter() - begin
            end = flights.first_answer + t * flights.duration
            early = diagnosis.detected & (end <= flights.onset[part])
            flown.false_alarms += int(early.sum())
            counts = diagnosis.detected & ~flown.found[part] & (healthy | ~early)
            if counts.any():
                flown.found[part] |= counts
                flown.end[part][counts] = end
                waiting |= counts
            if waiting.any():
                named = waiting & ((diagnosis.thruster > 0) | (end - flown.end[part] >= patience))
                waiting &= ~named
                flown.named[part][named] = diagnosis.thruster[named]
                if identify is not None and named.any():
                    answer = identify(detector, np.where(named, diagnosis.thruster, 0))
                    flown.severity[part][named] = answer.severity[named]
                    for at in np.flatnonzero(named):
                        flown.kind[first + at] = answer.kind[at]
            if early.any():
                detector.reset(early)
    return flown


def _curve(
    make: Callable[[int], AnyDetector],
    validated: FloatArray,
    healthy: RecordedFlights,
    faulty: RecordedFlights,
    rates: Sequence[float],
    confidence: float,
) -> tuple[CurvePoint, ...]:
    fault_free, faulted = statistics_of(make, healthy), statistics_of(make, faulty)
    intervals, duration = fault_free.shape[1], healthy.duration
    ends = healthy.first_answer + np.arange(intervals) * duration
    affected = faulty.onset < intervals * duration
    before = ends <= faulty.onset[:, np.newaxis]
    points = []
    for rate in rates:
        try:
            threshold = threshold_for_rate(validated, rate, confidence).threshold
        except ValueError:  # rarer than the validation flights can show
            continue
        alarms = faulted > threshold
        counted = affected & ~(alarms & before).any(axis=1)
        found = alarms[counted].any(axis=1)
        delays = np.where(found, ends[alarms[counted].argmax(axis=1)] - faulty.onset[counted], np.inf)
        with_alarm = (fault_free > threshold).any(axis=1).mean()
        per_interval = -math.expm1(math.log1p(-with_alarm) / intervals) if with_alarm < 1.0 else 1.0
        points.append(
            CurvePoint(
                threshold=threshold,
                stated=float(rate),
                false_alarms_per_hour=per_interval * 3600.0 / duration,
                median_delay=_quantile(delays, 0.5),
                delay_90=_quantile(delays, 0.9),
                missed=1.0 - float(found.mean()) if found.size else math.nan,
            )
        )
    return tuple(points)


def _confusion(
    healthy: RecordedFlights, fault_free: _Flown, faulty: RecordedFlights, flown: _Flown, affected: BoolArray
) -> tuple[tuple[int, ...], ...]:
    n = healthy.on_times.shape[2]
    matrix = np.zeros((n + 1, n + 2), np.int64)
    for truth, result in ((healthy.thruster, fault_free), (np.where(affected, faulty.thruster, -1), flown)):
        named = np.where(result.found, np.where(result.named > 0, result.named, n + 1), 0)
        np.add.at(matrix, (truth[truth >= 0], named[truth >= 0]), 1)
    return tuple(tuple(int(one) for one in row) for row in matrix)


def _by_kind(
    faulty: RecordedFlights, flown: _Flown, affected: BoolArray, confidence: float
) -> dict[str, tuple[Rate, float]]:
    kinds = np.array(faulty.kind)
    answer = {}
    for kind in sorted(set(faulty.kind)):
        own = affected & (kinds == kind)
        if own.any():
            found = flown.found[own]
            delays = np.where(found, flown.end[own] - faulty.onset[own], np.inf)
            answer[kind] = (
                Rate.of(int((~found).sum()), int(own.sum()), confidence), _quantile(delays, 0.5)
            )  # fmt: skip
    return answer


def _time_alone(make: Callable[[int], AnyDetector], flights: RecordedFlights) -> float:
    """Median of an update of a single vehicle, s."""
    read = reader_of(make(1))
    taken = []
    for update in range(_TIMED_UPDATES):
        flight, t = divmod(update, flights.on_times.shape[1])
        flight %= flights.on_times.shape[0]
        telemetry = flights.telemetry(slice(flight, flight + 1), t)
        begin = time.perf_counter()
        read(telemetry)
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def _family(kind: str, size: float) -> str:
    """The kind that a fault looks like: what is all lost is off, what is lost in part is a loss."""
    if kind in ("stuck_off", "loss", "intermittent"):
        return "stuck_off" if size == 1.0 else "loss"
    if kind == "leak" and size == 1.0:
        return "stuck_on"
    return kind


def _quantile(values: FloatArray, share: float) -> float:
    """The smallest value that this share of the values does not exceed; it may be infinite."""
    if values.size == 0:
        return math.nan
    return float(np.sort(values)[max(math.ceil(share * values.size) - 1, 0)])


def _inverse(rate: float) -> float:
    return 1.0 / rate if rate > 0.0 else math.inf


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _seconds(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "missed"


def _share(rate: Rate) -> str:
    if rate.trials == 0:
        return ""
    return f"{100.0 * rate.value:.1f} % ({100.0 * rate.low:.1f} to {100.0 * rate.high:.1f})"


def _three(values: tuple[float, float, float]) -> str:
    return f"{values[0]:.3g} ({values[1]:.3g} to {values[2]:.3g})"
