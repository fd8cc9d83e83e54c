"""The picture beside the report: bars of ours and of peers with the targets, on log scales."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import Row, Section, number

MEANINGS = {
    "steps/s": "environment steps per second",
    "µs": "µs for one command or update (less is better)",
    "LP/s": "linear programs per second",
    "updates/s": "vehicle-updates per second",
    "samples/s": "samples of a vehicle per second",
    "craft-steps/s": "control periods of a craft per second",
    "pulses/s": "pulses per second",
    "plain solves": "time in plain linear programs (less is better)",
    "times the LP's": "thruster-seconds over the linear program's",
}
OURS, OTHERS, TARGET = "#1f6f8b", "#b7bdc2", "#c0392b"


def draw(sections: Sequence[Section], path: Path) -> bool:
    """Write the figure; False if there is nothing to show."""
    panels = [
        (section.title, unit, [row for row in section.rows if row.charted and row.value and row.unit == unit])
        for section in sections
        for unit in dict.fromkeys(row.unit for row in section.rows if row.charted and row.value)
    ]
    if not panels:
        return False
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    heights = [len(rows) + 2.2 for _, _, rows in panels]
    figure, axes = plt.subplots(
        len(panels), 1, figsize=(10.0, 0.3 * sum(heights) + 0.6), height_ratios=heights, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis, (title, unit, rows) in zip(axes[:, 0], panels, strict=True):
        _bars(axis, f"{title}: {MEANINGS.get(unit, unit)}", rows)
        values = [row.value or 1.0 for _, other, rows in panels if other == unit for row in rows]
        axis.set_xlim(0.4 * min(values), 6.0 * max(values))
    axes[-1, 0].set_xlabel("blue: this package; grey: others; red: target")
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return True


def _bars(axis: Any, title: str, rows: Sequence[Row]) -> None:
    """One panel; a gap stands before every row of ours that others are compared with."""
    places: list[float] = []
    place = -1.0
    for row in rows:
        place += 1.6 if row.own and place >= 0.0 and title.startswith("Peers") else 1.0
        places.append(place)
    for place, row in zip(places, rows, strict=True):
        reach = value = row.value or 0.0
        axis.barh(place, value, color=OURS if row.own else OTHERS, height=0.75)
        if row.target is not None:
            axis.plot([row.target.value] * 2, [place - 0.45, place + 0.45], color=TARGET, linewidth=2.5)
            reach = max(value, row.target.value)
        axis.annotate(
            number(value), (reach, place), xytext=(6, 0), textcoords="offset points", va="center", fontsize=8
        )
    axis.set_yticks(places, [row.name.replace("`", "") for row in rows], fontsize=8)
    axis.set_ylim(places[-1] + 0.6, -0.6)
    axis.set_xscale("log")
    axis.set_title(title, loc="left", fontsize=10, fontweight="bold")
    axis.grid(axis="x", alpha=0.3)
    axis.set_axisbelow(True)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
