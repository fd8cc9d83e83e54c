"""Fig. 10: the integer program's time beside that of the iterations (E15)."""

from __future__ import annotations

import time

import numpy as np

from reproductions.figures import BLUE, INK, ORANGE, PURPLE, Figure, bars, panels, ticks
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.coupling_study import CONDITIONS, METHODS, commands

TIMED = ("no compensation", "method I", "method II", "integer program")
COMMANDS = 200  # of the integer program


def seconds_each(method: str, condition: str, count: int) -> np.ndarray:
    """Seconds of each command by itself, through the public call."""
    mapper, asked = METHODS[method](), commands(condition, count)
    mapper(asked[0])
    found = np.empty(count)
    for i, command in enumerate(asked):
        start = time.perf_counter()
        mapper(command)
        found[i] = time.perf_counter() - start
    return found


@reproduces(
    "E15",
    lines="Fig. 10, L606-611",
    reported="at most 20 % faster than the iterations with rotation or translation alone, much faster on six "
    "axes (values not readable)",
    criterion="times on the same commands; the ordering is not expected to hold with solvers of today",
    alone=True,
)
def times(effort: Effort) -> Finding:
    """Time of the integer program beside methods I and II."""
    found = {
        (m, c): seconds_each(m, c, min(COMMANDS if m == "integer program" else 2000, effort.repetitions))
        for m in TIMED for c in CONDITIONS
    }  # fmt: skip
    median = {key: float(np.median(values)) for key, values in found.items()}
    ratio = {c: median["integer program", c] / median["method II", c] for c in CONDITIONS}
    rows = tuple((c, *(f"{1e6 * median[m, c]:,.0f}" for m in TIMED), f"{ratio[c]:,.0f}") for c in CONDITIONS)
    return Finding(
        ours=f"the integer program takes {1e3 * median['integer program', 'six axes']:.0f} ms for a command, "
        f"{min(ratio.values()):,.0f} to {max(ratio.values()):,.0f} times what method II takes",
        checks={"solvers of today: the integer program is the slower one": min(ratio.values()) > 1.0},
        data={f"{c}, {m}": np.quantile(found[m, c], [0.1, 0.5, 0.9, 0.99]) for m, c in found},
        not_reproducible="the advantage was that of one solver of 2003 over a Matlab program; by HiGHS the "
        "integer program is slower by orders of magnitude than compiled iterations",
        note=f"Median time of one command through the public call; {COMMANDS} commands for the integer "
        "program, 2,000 for the others.",
        tables=(Table("Median time, microseconds", ("condition", *TIMED, "integer program over II"), rows),),
        figure=lambda: _draw(median),
    )  # fmt: skip


def _draw(median: dict[tuple[str, str], float]) -> Figure:
    figure, (axis,) = panels(height=3.4)
    values = {method: [1e6 * median[method, condition] for condition in CONDITIONS] for method in TIMED}
    bars(axis, values, (INK, ORANGE, BLUE, PURPLE))
    for those, of_method in zip(axis.containers, values.values(), strict=True):
        axis.bar_label(those, labels=[*map(_duration, of_method)], padding=2, fontsize=8.5)
    ticks(axis, [f"{condition} commanded" for condition in CONDITIONS])
    axis.set(yscale="log", ylim=(1.0, 3e6), ylabel="time of one command, µs")
    axis.set(title="The integer program is not the faster way")
    axis.legend(loc="upper left", ncols=4, fontsize=9)
    return figure


def _duration(microseconds: float) -> str:
    return f"{microseconds / 1000:.0f} ms" if microseconds > 1000 else f"{microseconds:.0f} µs"
