"""Fig. 14 and 15: detections over false alarms of five detectors (E23, E24), and what was made of it (E28).

A rate is a share of windows of 20 intervals; the ratio is the rate of windows with an alarm after the fault
to that before it. Each threshold is calibrated on other flights to alarm in 2 % of healthy windows at the
source's noise. Where there is no false alarm at all the ratio is shown with the upper end of the interval of
their rate, as a bound from below.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from reproductions.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    RED,
    Figure,
    octaves,
    panels,
    shared_legend,
)
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.detection_study import (
    DETECTORS,
    Conditions,
    alarm_rate,
    calibrated,
    flights_of,
    record,
)
from thruster_baselines.detection.evaluate import Rate
from thruster_baselines.detection.settings import SOURCE_MEASUREMENT_NOISE, SOURCE_PROCESS_NOISE

ERRORS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
SCATTERS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
THRESHOLDS = (0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0)  # of the calibrated one
FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of R / Q
GLR, ESTIMATE = "likelihood ratio", "estimate below threshold"
COLOURS = dict(zip(DETECTORS, (PURPLE, GREEN, ORANGE, RED, BLUE), strict=True))
MARKERS = dict(zip(DETECTORS, "sv^Do", strict=True))
SEED = 2


@dataclass(frozen=True)
class Point:
    """A detector under one condition."""

    detected: Rate  # windows with an alarm after the onset
    false: Rate  # windows with an alarm before

    @property
    def ratio(self) -> float:
        """Or its bound from below where there is no false alarm."""
        return self.detected.value / (self.false.value or self.false.high)

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the ratio, by the intervals of both rates."""
        return self.detected.low / self.false.high, self.detected.high / max(self.false.low, 1e-9)

    @property
    def text(self) -> str:
        """The ratio for a table."""
        return f"{self.ratio:.3g}" if self.false.successes else f"> {self.ratio:.3g}"


Curves = dict[str, list[Point]]


def _sweep(conditions: Sequence[Conditions], flights: int) -> Curves:
    thresholds = calibrated(flights)
    records = [record(one, flights, SEED) for one in conditions]
    return {
        name: [_point(one.statistic[name], thresholds[name]) for one in records] for name in DETECTORS
    }  # fmt: skip


def _over_thresholds(flights: int) -> Curves:
    thresholds, flown = calibrated(flights), record(Conditions(), flights, SEED)
    return {
        name: [_point(flown.statistic[name], factor * thresholds[name]) for factor in THRESHOLDS]
        for name in DETECTORS
    }


def _point(statistic: np.ndarray, threshold: float) -> Point:
    return Point(alarm_rate(statistic, threshold, True), alarm_rate(statistic, threshold, False))


def _falls(points: Sequence[Point]) -> bool:
    """Never up beyond the intervals from one point to the next, and down beyond them over all."""
    steps = all(after.bounds[0] <= before.bounds[1] for before, after in itertools.pairwise(points))
    return steps and points[-1].bounds[1] < points[0].bounds[0]


def _rises(points: Sequence[Point]) -> bool:
    return _falls(points[::-1])


def _leads(curves: Curves) -> bool:
    """No other test of the innovations is above the likelihood ratio beyond the intervals, anywhere."""
    return all(
        point.bounds[0] <= mine.bounds[1]
        for name in DETECTORS
        if name != ESTIMATE
        for point, mine in zip(curves[name], curves[GLR], strict=True)
    )


@reproduces(
    "E23",
    lines="Fig. 14, L1182-1194",
    reported="falls as noise grows; the likelihood ratio as good as any other or nearly; the threshold "
    "on the estimate matches it (values not readable)",
    criterion="the ratio falls with both noises; the likelihood ratio is at the top or tied",
)
def against_noise(effort: Effort) -> Finding:
    """Detections over false alarms against noise."""
    flights = flights_of(effort)
    errors = _sweep([Conditions(error=one) for one in ERRORS], flights)
    scatters = _sweep([Conditions(scatter=one) for one in SCATTERS], flights)
    loud = {name: (errors[name][-1].ratio, scatters[name][-1].ratio) for name in DETECTORS}
    others = [name for name in DETECTORS if name not in (GLR, ESTIMATE)]
    here = ERRORS.index(1.0)
    sweeps = (
        Sweep("Measurement errors, as multiples of 0.5 mm/s and 0.5 mrad/s", ERRORS, errors,
              "measurement errors, multiple of the source's"),
        Sweep("Scatter of the firings, as multiples of 10 %", SCATTERS, scatters,
              "scatter of firings, multiple of the source's"),
    )  # fmt: skip
    return Finding(
        ours=f"at the source's noise {errors[GLR][here].text} for the likelihood ratio and "
        f"{errors[ESTIMATE][here].text} for the estimate; at four times the measurement errors "
        f"{loud[GLR][0]:.1f}, {loud[ESTIMATE][0]:.1f}, and {max(loud[name][0] for name in others):.1f} for "
        f"the best chi-squared test; at twice the scatter {loud[GLR][1]:.1f}, {loud[ESTIMATE][1]:.1f}, "
        f"{max(loud[name][1] for name in others):.1f}",
        checks={
            "the ratio falls with measurement noise": all(_falls(one) for one in errors.values()),
            "the ratio falls with firing noise": all(_falls(one) for one in scatters.values()),
            "no chi-squared test is above the likelihood ratio beyond the intervals": (
                _leads(errors) and _leads(scatters)
            ),
            "at the source's noise the estimate is tied with the likelihood ratio": _overlap(
                errors[ESTIMATE][here], errors[GLR][here]
            ),
            "with the most measurement noise the estimate is below it, with the most scatter above": (
                errors[ESTIMATE][-1].bounds[1] < errors[GLR][-1].bounds[0]
                and scatters[ESTIMATE][-1].bounds[0] > scatters[GLR][-1].bounds[1]
            ),
        },
        data={"errors": _plain(errors), "scatters": _plain(scatters)},
        correction="among the tests of the innovations the likelihood ratio is at the top or tied, "
        "everywhere; the threshold on the estimate matches it at the source's noise only, loses to it when "
        "measurements get worse and beats it when firings scatter more",
        note=f"{flights:,} flights a point; one thruster keeps a quarter of its thrust. With twice the "
        "scatter the tests of single innovations alarm in almost every healthy window at a threshold that "
        "was right before; the filter behind the estimate averages it out.",
        tables=tuple(map(_table, sweeps)),
        figure=lambda: _draw("Detections over false alarms fall with noise", *sweeps),
    )  # fmt: skip


@reproduces(
    "E24",
    lines="Fig. 15, L1192",
    reported="a higher threshold gives a higher ratio and fewer detections; a higher R/Q a higher ratio",
    criterion="these trends, for all five detectors",
)
def against_settings(effort: Effort) -> Finding:
    """Detections over false alarms against threshold and R/Q."""
    flights = flights_of(effort)
    levels = _over_thresholds(flights)
    by_r = _sweep([Conditions(measurement_noise=SOURCE_MEASUREMENT_NOISE * one) for one in FACTORS], flights)
    by_q = _sweep([Conditions(process_noise=SOURCE_PROCESS_NOISE / one) for one in FACTORS], flights)
    tests = [name for name in DETECTORS if name != ESTIMATE]
    fewer = all(
        all(a.detected.value >= b.detected.value for a, b in itertools.pairwise(one))
        and one[-1].detected.high < one[0].detected.low
        for one in levels.values()
    )
    sweeps = (
        Sweep(
            "Threshold, as multiples of the calibrated one",
            THRESHOLDS,
            levels,
            "threshold, multiple of calibrated",
        ),
        Sweep("R/Q by R, as multiples of 1000", FACTORS, by_r, "R/Q by R, multiple of 1000"),
        Sweep("R/Q by Q, as multiples of 1000", FACTORS, by_q, "R/Q by Q, multiple of 1000"),
    )
    detected = Table(
        "Windows with an alarm after the fault, by the multiple of the threshold",
        ("detector", *(f"{one:g}" for one in THRESHOLDS)),
        [(name, *(f"{one.detected.value:.1%}" for one in points)) for name, points in levels.items()],
    )
    return Finding(
        ours=f"from the calibrated threshold to eight times it the likelihood ratio's detections go from "
        f"{levels[GLR][THRESHOLDS.index(1.0)].detected.value:.1%} to {levels[GLR][-1].detected.value:.1%}; "
        f"R times 16 takes its ratio from {by_r[GLR][0].text} to {by_r[GLR][-1].text}, Q over 16 from "
        f"{by_q[GLR][0].text} to {by_q[GLR][-1].text}",
        checks={
            "a higher threshold gives a higher ratio": all(_rises(one[:4]) for one in levels.values()),
            "and fewer detections": fewer,
            "R/Q raised by R gives a higher ratio": all(_rises(one) for one in by_r.values()),
            "R/Q raised by Q gives the estimate a higher ratio": _rises(by_q[ESTIMATE]),
            "and the innovation tests a lower one": all(_falls(by_q[name]) for name in tests),
        },
        data={"thresholds": _plain(levels), "by R": _plain(by_r), "by Q": _plain(by_q)},
        correction="R/Q has to be raised by R: every statistic of the innovations is divided by Y, which is "
        "R and a little, so that a larger R works as a higher threshold; the same R/Q with a smaller Q makes "
        "Y smaller and gives the tests more false alarms at the same threshold",
        note=f"{flights:,} flights a point. Up to 1.4 times the threshold the rise of the ratio is beyond "
        "the intervals; above, no false alarm is left and the ratio is a bound.",
        tables=(*map(_table, sweeps), detected),
        figure=lambda: _draw("A higher threshold, or a larger R, buys fewer false alarms", *sweeps),
    )  # fmt: skip


def _overlap(one: Point, other: Point) -> bool:
    return one.bounds[0] <= other.bounds[1] and other.bounds[0] <= one.bounds[1]


def _plain(curves: Curves) -> dict[str, list[dict[str, tuple[float, float, float]]]]:
    def triple(rate: Rate) -> tuple[float, float, float]:
        return rate.value, rate.low, rate.high

    return {
        name: [{"detected": triple(one.detected), "false alarms": triple(one.false)} for one in points]
        for name, points in curves.items()
    }


class Sweep(NamedTuple):
    """Curves over a setting."""

    title: str
    at: Sequence[float]
    curves: Any
    label: str  # of the setting in a figure


def _table(sweep: Sweep) -> Table:
    return Table(
        f"Detections over false alarms. {sweep.title}",
        ("detector", *(f"{one:g}" for one in sweep.at)),
        [(name, *(point.text for point in points)) for name, points in sweep.curves.items()],
    )


def _draw(title: str, *sweeps: Sweep) -> Figure:
    figure, axes = panels(len(sweeps), height=4.6)
    for axis, sweep in zip(axes, sweeps, strict=True):
        for k, (name, points) in enumerate(sweep.curves.items()):
            places = np.array(sweep.at) * (1.0 + 0.015 * (k - 2))  # side by side
            ratio = np.array([one.ratio for one in points])
            low, high = np.array([one.bounds for one in points]).T
            none = np.array([one.false.successes == 0 for one in points])
            low, high = np.where(none, ratio, low), np.where(none, ratio, high)
            ratio = np.where([one.detected.successes > 0 for one in points], ratio, np.nan)
            look = {"color": COLOURS[name], "elinewidth": 0.8, "marker": MARKERS[name], "markersize": 4.5}
            axis.errorbar(places, ratio, (ratio - low, high - ratio), linewidth=1.2, label=name, **look)
            above = {"color": COLOURS[name], "linestyle": "none", "markersize": 5}
            axis.plot(places[none], 1.25 * ratio[none], marker=6, **above)
        octaves(axis, sweep.at)
        axis.axhline(1.0, color=INK, linewidth=0.8, linestyle=":")
        axis.set(xlabel=sweep.label, ylim=(0.8, 4000.0))
    axes[0].set_ylabel("detections over false alarms")
    shared_legend(figure, axes[0], title, ncols=3, fontsize=9)
    return figure
