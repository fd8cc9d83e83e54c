"""Robustness: ten healthy hours without a false alarm, and what a lower threshold would buy, for all faults.

The source says that faults are found despite delays, noise and disturbances, and gives no rate. Thresholds
are margins over healthy flights of validation seeds; flights of test seeds show the alarms. The figure lowers
each threshold in steps, and sets median delays of detection and right isolation against the rate of flights
with a false alarm, for seven kinds of fault; a delay that fewer than half of the flights have is "never" and
is not drawn. Left out: the retuning of a detector for each threshold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from reproductions.cells import finite, median, proportion
from reproductions.figures import BLUE, GREEN, INK, ORANGE, PURPLE, RED, Figure, annotate, grid
from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.isolation_study import OPEN, VEHICLE, Isolation, Make, correlation, watched
from reproductions.record import Effort, Finding, Table
from thruster_baselines.detection.approach_flights import HEALTHY_DURATION, fly
from thruster_baselines.detection.flights import joined
from thruster_baselines.detection.residuals import FusionDetector, SignatureDetector, margin_threshold, watch
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.seeds import TEST, VALIDATION

SETTLE = 40.0
HEALTHY_PER_EFFORT = 3  # ten hours after settling
KINDS = {
    "open": OPEN,
    "closed": ("stuck_off", 1.0),
    "stuck at 0.5": ("stuck_on", 0.5),
    "loss of 50 %": ("loss", 0.5),
    "leak of 0.3": ("leak", 0.3),
    "slow by 0.3 s": ("slow_opening", 0.3),
    "late by 0.05 s": ("late_opening", 0.05),
}
SHARES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Of the threshold in use."""


@dataclass(frozen=True)
class Contender:
    """A detector, its margin over healthy flights, and how its lines are drawn."""

    make: Make
    margin: float
    colour: str
    width: float
    mark: str


def _ratio(use_rate: bool) -> Make:
    return lambda limit, count: FusionDetector(
        VEHICLE, limit, settle=SETTLE, use_rate=use_rate, vehicles=count
    )


def _signature(limit: float, count: int) -> SignatureDetector:
    return SignatureDetector(VEHICLE, limit, vehicles=count)


# Lines that lie on each other show: the wider one comes first.
CONTENDERS = {
    "Padé": Contender(correlation(), 1.3, BLUE, 5.0, "o"),
    "observer": Contender(correlation(design="observer"), 1.3, ORANGE, 5.0, "s"),
    "undelayed": Contender(correlation(design="undelayed"), 1.3, PURPLE, 1.5, "x"),
    "signature": Contender(_signature, 1.3, RED, 1.5, "."),
    "force alone": Contender(_ratio(use_rate=False), 1.5, INK, 1.5, "v"),
    "fusion": Contender(_ratio(use_rate=True), 1.5, GREEN, 1.5, "^"),
}
IN_METRES = ("Padé", "observer", "undelayed", "signature")


@dataclass(frozen=True)
class Point:
    """A detector at one threshold: false alarms an hour, median delays in s, infinite for never."""

    rate: float
    detection: float
    isolation: float


@reproduces(
    "MSR-10",
    lines="L321, L334",
    reported="faults are found and isolated despite delays, noise and disturbances; no rate",
    criterion="no false alarm of the source's method in ten healthy hours with all effects on, and every "
    "open valve named right",
)
def robustness(effort: Effort) -> Finding:
    """Robustness to delays, noise and disturbances; delay against false alarms."""
    count, each = effort.flights, max(effort.flights // 2, 1)
    validation, healthy = fly(VALIDATION[:count]), fly(TEST[: HEALTHY_PER_EFFORT * count])
    flights = healthy.onset.size
    hours = flights * (HEALTHY_DURATION - SETTLE) / 3600.0
    thresholds, largest = {}, {}
    for name, one in CONTENDERS.items():
        thresholds[name] = margin_threshold(watch(one.make(np.inf, count), validation).statistic, one.margin)
        largest[name] = watch(one.make(np.inf, flights), healthy).statistic.max(axis=1)
    false = {name: int((largest[name] >= thresholds[name]).sum()) for name in CONTENDERS}
    curves: dict[tuple[str, str], list[Point]] = {}
    at_own: dict[tuple[str, str], Isolation] = {}
    first = HEALTHY_PER_EFFORT * count
    for kind, how in KINDS.items():
        flights_with_it = [
            joined([fly(TEST[first + each * i : first + each * (i + 1)], i + 1, *how) for i in range(8)])
        ]
        for name, one in CONTENDERS.items():
            points = []
            for share in SHARES:
                limit = share * thresholds[name]
                seen = watched(flights_with_it, one.make, limit)
                rate = float((largest[name] >= limit).sum()) / hours
                points.append(Point(rate, *_medians(seen)))
            curves[kind, name], at_own[kind, name] = points, seen
    printed = at_own["open", "Padé"]
    named = np.mean([at_own[kind, "force alone"].named > 0 for kind in KINDS])
    in_json = {
        f"{name}, {kind}": [
            [x if np.isfinite(x) else None for x in (one.rate, one.detection, one.isolation)]
            for one in points
        ]
        for (kind, name), points in curves.items()
    }
    return Finding(
        ours=f"false alarms in {hours:.1f} h: {', '.join(f'{k} {v}' for k, v in false.items())}",
        checks={
            f"no false alarm of the source's method in {hours:.1f} healthy hours": false["Padé"] == 0,
            "and it names every open valve right, under the same effects": printed.share == 1.0,
        },
        note=f"{flights} healthy flights, {8 * each} of each fault, as many of each thruster. Padé, observer "
        "and undelayed isolate by the source's correlation, which is right for valves that are too far "
        "open. Signature alarms as Padé does, and looks for open valves and losses only. The fusion is "
        "the likelihood ratio of force and torque. That of the force alone stands beside it, and names "
        f"somebody in {100.0 * named:.1f} % of flights: by it the excess of one thruster is the loss of "
        "the other at the opposite corner (Remark 4 of the source). A slow valve delivers later what it "
        "is told and in the mean as much, and nobody probes here, which would show it (mars-recovery); "
        "an opening late by 0.05 s swallows the pulses of an idle thruster whole.",
        data={
            "hours": hours,
            "thresholds": thresholds,
            "false_alarms": false,
            "named_right": {f"{name}, {kind}": one.share for (kind, name), one in at_own.items()},
            "curves": in_json,
        },
        tables=(_healthy_table(thresholds, false, flights, hours), _fault_table(at_own)),
        figure=partial(_draw, curves),
    )


def _medians(seen: Isolation) -> tuple[float, float]:
    """Of detection and right isolation over flights without an earlier alarm, s; infinite for never."""
    fair = seen.detection >= 0.0
    right = np.where(seen.right, seen.isolation, np.inf)
    return median(seen.detection[fair]), median(right[fair])


def _healthy_table(thresholds: dict[str, float], false: dict[str, int], flights: int, hours: float) -> Table:
    def hourly(name: str, _: float) -> str:
        low, high = (flights * one / hours for one in clopper_pearson(false[name], flights))
        return f"{false[name] / hours:.2f} ({low:.2f} to {high:.2f})"

    return Table.of(
        "Healthy flights of test seeds",
        thresholds,
        {
            "detector": "{0}",
            "threshold": lambda name, limit: f"{1e3 * limit:.1f} mm" if name in IN_METRES else f"{limit:.1f}",
            "flights with an alarm": lambda name, _: str(false[name]),
            "an hour, with 95 % interval": hourly,
        },
    )


def _fault_table(at_own: dict[tuple[str, str], Isolation]) -> Table:
    def part(of: Callable[[Isolation], Any]) -> Callable[..., str]:
        return lambda _, __, seen: proportion(of(seen).sum(), seen.right.size)

    return Table.of(
        "Every kind of fault, each detector at its threshold",
        [(*names, seen) for names, seen in at_own.items()],
        {
            "fault": "{0}",
            "detector": "{1}",
            "alarms before it": lambda _, __, seen: str((seen.detection < 0.0).sum()),
            "detected, with 95 % interval": part(
                lambda seen: (seen.detection >= 0.0) & np.isfinite(seen.detection)
            ),
            "median detection, s": lambda _, __, seen: finite(_medians(seen)[0], ".2f"),
            "named right": part(lambda seen: seen.right),
            "named wrong": part(lambda seen: (seen.named > 0) & ~seen.right),
            "median isolation, right names, s": lambda _, __, seen: finite(_medians(seen)[1], ".2f"),
        },
    )


def _draw(curves: dict[tuple[str, str], list[Point]]) -> Figure:
    figure, axes = grid(4, 4, 10.0, sharex=True, sharey=True)
    for number, kind in enumerate(KINDS):
        column, block = number % 4, 2 * (number // 4)
        axes[block, column].set_title(kind)
        for panel, what in ((axes[block, column], "detection"), (axes[block + 1, column], "isolation")):
            never = [name for name in CONTENDERS if not _line(panel, curves[kind, name], name, what)]
            if never:
                corner = {"xycoords": "axes fraction", "fontsize": 7.5, "va": "top", "color": INK}
                annotate(panel, "never: " + ",\n".join(never), (0.04, 0.96), **corner)
            if column == 0:
                panel.set_ylabel(f"{what}, s")
    for panel in axes[2:, 3]:
        panel.set_axis_off()
    for panel in (*axes[3, :3], axes[1, 3]):
        panel.set_xlabel("false alarms an hour", fontsize=8.5)
        panel.tick_params(axis="x", labelbottom=True)
    first = axes[0, 0]
    first.set_xscale("symlog", linthresh=0.1)
    first.set_xticks([0.0, 0.1, 1.0, 10.0], ["0", "0.1", "1", "10"])
    first.set_yscale("log")
    first.set_yticks([0.1, 0.3, 1.0, 3.0, 10.0], ["0.1", "0.3", "1", "3", "10"])
    first.set(xlim=(-0.03, 60.0), ylim=(0.05, 30.0))
    axes[2, 3].legend(*first.get_legend_handles_labels(), loc="upper left", fontsize=9.0)
    return figure


def _line(panel: Axes, points: list[Point], name: str, what: str) -> bool:
    """Draw what is known of a detector; False if that is nothing."""
    drawn, wide = CONTENDERS[name], CONTENDERS[name].width > 2.0
    rates, times = (np.array([getattr(one, part) for one in points]) for part in ("rate", what))
    known = np.isfinite(times)
    panel.plot(
        rates[known], times[known], drawn.mark, linestyle="-", color=drawn.colour, linewidth=drawn.width,
        markersize=7.0 if wide else 4.5, alpha=0.45 if wide else 1.0, label=name,
    )  # fmt: skip
    return bool(known.any())
