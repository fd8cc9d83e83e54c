"""Fig. 8: what methods I and II cost in time, in units of one linear program (E12)."""

from __future__ import annotations

import time

import numpy as np

from reproductions.figures import BLUE, GREEN, INK, ORANGE, Figure, bars, panels, reference_line, ticks
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.coupling_study import CONDITIONS, METHODS, commands

TIMED = ("method I", "method II", "exact")
_BATCH = 2000
_REPETITIONS = 101


def relative_times(condition: str, repetitions: int) -> dict[str, np.ndarray]:
    """Time of each method over that of the plain linear program: batches of commands, in turns."""
    asked = commands(condition, _BATCH)
    mappers = {name: METHODS[name]() for name in ("no compensation", *TIMED)}
    for mapper in mappers.values():
        mapper(asked)
    ratios: dict[str, list[float]] = {name: [] for name in TIMED}
    for _ in range(repetitions):
        seconds = {}
        for name, mapper in mappers.items():
            start = time.perf_counter()
            mapper(asked)
            seconds[name] = time.perf_counter() - start
        for name in TIMED:
            ratios[name].append(seconds[name] / seconds["no compensation"])
    return {name: np.array(values) for name, values in ratios.items()}


@reproduces(
    "E12",
    lines="Fig. 8, L599, L604",
    reported="four iterations on average, five times the time of one linear program; up to nine times",
    criterion="at most five times for method II, at most nine for method I",
    alone=True,
)
def times(effort: Effort) -> Finding:
    """Time of methods I and II over that of one linear program."""
    repetitions = min(_REPETITIONS, effort.repetitions)
    found = {condition: relative_times(condition, repetitions) for condition in CONDITIONS}
    median = {(c, m): float(np.median(found[c][m])) for c in CONDITIONS for m in TIMED}
    rows = tuple((c, *(f"{median[c, m]:.2f}" for m in TIMED)) for c in CONDITIONS)
    largest = max(median[c, m] for c in CONDITIONS for m in ("method I", "method II"))
    return Finding(
        ours=f"methods I and II take {min(median.values()):.1f} to {largest:.1f} times one linear program "
        f"({_range(median, 'method II')} for II); the exact compensation {_range(median, 'exact')}",
        checks={
            "method II takes at most the source's 5 times": all(
                median[c, "method II"] <= 5.0 for c in CONDITIONS
            ),
            "method I takes at most the source's worst, 9 times": all(
                median[c, "method I"] <= 9.0 for c in CONDITIONS
            ),
        },
        data={f"{c}, {m}": found[c][m] for c in CONDITIONS for m in TIMED},
        correction="each round here goes on from the last basis, so that the rounds after the first cost a "
        f"fraction of one: method II takes {_range(median, 'method II')} times the time, not five",
        note=f"Medians of {repetitions} turns of {_BATCH:,} commands each, on one thread; ratios within a "
        "turn.",
        tables=(Table("Time over that of one linear program", ("condition", *TIMED), rows),),
        figure=lambda: _draw(median),
    )


def _range(median: dict[tuple[str, str], float], method: str) -> str:
    values = [value for (_, name), value in median.items() if name == method]
    return f"{min(values):.1f} to {max(values):.1f}"


def _draw(median: dict[tuple[str, str], float]) -> Figure:
    figure, (axis,) = panels(height=3.6)
    values = {method: [median[condition, method] for condition in CONDITIONS] for method in TIMED}
    bars(axis, values, (ORANGE, BLUE, GREEN), width=0.81)
    for those in axis.containers:
        axis.bar_label(those, fmt="%.1f", padding=2, fontsize=9)
    reference_line(axis, 5.0, "the source's average, 5", linewidth=1.2)
    axis.axhline(1.0, color=INK, linewidth=0.8)
    ticks(axis, [f"{condition} commanded" for condition in CONDITIONS])
    axis.set(ylim=(0.0, 6.0), ylabel="time over that of one linear program")
    axis.set(title="Making up for the loss costs less than the source's five linear programs")
    axis.legend(loc="upper left", ncols=3)
    return figure
