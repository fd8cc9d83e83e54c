"""What detectors say of batches of approaches with a fault each: times, names, and how they are shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from reproductions import cells
from reproductions.cells import finite
from reproductions.figures import BLUE, INK, ORANGE, Figure, dots, panels, ranges, shared_legend
from reproductions.record import Effort, Table
from thruster_baselines.detection.approach_flights import fly
from thruster_baselines.detection.residuals import (
    BaseNavigationDetector,
    CorrelationDetector,
    NavigationFlights,
    NormThreshold,
    margin_threshold,
    watch,
)
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.seeds import TEST, VALIDATION

VEHICLE = "msr_chaser"
OPEN = ("stuck_on", 1.0)
Make = Callable[[float, int], BaseNavigationDetector]
"""Makes a detector for a threshold and a number of vehicles."""

HEAD = ("flights", "false alarms", "detection, s: median, most", "isolation, s: median, most", "named right")


@dataclass(frozen=True)
class Isolation:
    """What a detector said of faulty flights."""

    detection: FloatArray  # (flights,), s from the onset; negative for an alarm before it, infinite without
    isolation: FloatArray  # (flights,), s from the onset to a name; infinite without
    named: IntArray  # (flights,), from 1; 0 for none
    thruster: IntArray  # (flights,), the one that failed, from 1

    @property
    def right(self) -> BoolArray:
        """(flights,), whether the thruster that failed is named."""
        return np.asarray(self.named == self.thruster)

    @property
    def share(self) -> float:
        """Of the flights in which the right thruster is named."""
        return float(self.right.mean())

    @cached_property
    def interval(self) -> tuple[float, float]:
        """Of 95 % about `share`."""
        return clopper_pearson(int(self.right.sum()), self.right.size)

    @property
    def cells(self) -> tuple[str, ...]:
        """For `HEAD`."""
        early = str(int((self.detection < 0.0).sum()))
        named = cells.proportion(self.right.sum(), self.right.size)
        return (str(self.right.size), early, _times(self.detection), _times(self.isolation), named)


def norm(limit: float, count: int) -> BaseNavigationDetector:
    """The source's alarm, for calibration."""
    return NormThreshold(VEHICLE, limit, vehicles=count)


def correlation(**settings: Any) -> Make:
    """The source's isolation in a reading of it."""
    return lambda limit, count: CorrelationDetector(VEHICLE, limit, vehicles=count, **settings)


def calibrated(effort: Effort, make: Make = norm, margin: float = 1.3, **settings: Any) -> float:
    """A margin over the largest statistic of healthy flights of validation seeds."""
    count = effort.flights
    healthy = fly(VALIDATION[:count], **settings)
    return margin_threshold(watch(make(np.inf, count), healthy).statistic, margin)


def faulty(
    effort: Effort, kind: str = OPEN[0], severity: float = OPEN[1], **settings: Any
) -> list[NavigationFlights]:
    """One batch of test seeds for each thruster, in which it fails in this way."""
    count = effort.flights
    return [fly(TEST[count * i : count * (i + 1)], i + 1, kind, severity, **settings) for i in range(8)]


def watched(batches: Sequence[NavigationFlights], make: Make, limit: float) -> Isolation:
    """Let a detector with this threshold see all batches."""
    seen = [watch(make(limit, one.onset.size), one) for one in batches]
    said = (
        np.concatenate([getattr(one, what) for one in seen])
        for what in ("detection", "isolation", "thruster")
    )
    return Isolation(*said, np.concatenate([one.thruster for one in batches]))


def percentages(values: Sequence[float]) -> str:
    """Shares as per cent in a line."""
    return ", ".join(f"{100.0 * one:.1f} %" for one in values)


def by_threshold(
    title: str, what: str, seen: Mapping[str, Isolation], limits: Mapping[str, float], **more: Any
) -> Table:
    """A line for each case, with its threshold in m; more columns are functions of name and what was seen."""
    columns = {what: "{0}", "threshold": lambda name, _: f"{1e3 * limits[name]:.1f} mm"}
    said = {head: (lambda _, one, k=k: one.cells[k]) for k, head in enumerate(HEAD)}
    return Table.of(title, seen, columns | said | more)


def draw_isolations(cases: Mapping[str, Isolation]) -> Figure:
    """Times from least to most with their median, and shares with their intervals; a line for each case."""
    figure, (times, shares) = panels(2, height=1.5 + 0.28 * len(cases))
    for place, one in enumerate(cases.values()):
        for values, colour, at in (
            (one.detection, BLUE, place - 0.12),
            (one.isolation, ORANGE, place + 0.12),
        ):
            known = np.sort(values[np.isfinite(values)])
            if known.size:
                ranges(times, at, known[0], known[-1], colour, flat=True, alpha=0.6)
            if 2 * known.size > values.size:
                # A name that is mostly wrong is drawn hollow.
                face = "white" if colour == ORANGE and one.share < 0.5 else colour
                dots(
                    times,
                    at,
                    np.sort(values)[values.size // 2],
                    colour,
                    flat=True,
                    markersize=5.0,
                    markerfacecolor=face,
                )
        ranges(shares, place, *(100.0 * end for end in one.interval), INK, flat=True)
        dots(shares, place, 100.0 * one.share, INK, flat=True, markersize=5.0)
    for panel in (times, shares):
        panel.set_yticks(
            range(len(cases)), list(cases) if panel is times else [""] * len(cases), fontsize=8.5
        )
        panel.set_ylim(len(cases) - 0.4, -0.6)
        panel.tick_params(axis="y", length=0.0)
    times.plot([], [], "o-", color=BLUE, label="detection")
    times.plot([], [], "o-", color=ORANGE, label="isolation (hollow: mostly wrong)")
    times.set(xlim=(min(0.0, times.get_xlim()[0]), None), xlabel="from onset, s: range and median")
    shares.set(xlim=(-3.0, 103.0), xlabel="named right, %, with 95 % interval")
    shared_legend(figure, times, ncols=2)
    return figure


def _times(values: FloatArray) -> str:
    ordered = np.sort(values)
    return ", ".join(finite(one, ".2f") for one in (ordered[ordered.size // 2], ordered[-1]))
