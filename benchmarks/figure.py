"""The picture beside the report: steps per second of environments and peers, with targets, on a log scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.report import Row, Section, number

OURS, OTHERS, TARGET = "#1f6f8b", "#b7bdc2", "#c0392b"


def draw(sections: Sequence[Section], path: Path) -> bool:
    """Write the figure; False if there is nothing to show."""
    panels = [(section.title, _charted(section.rows)) for section in sections]
    panels = [(title, rows) for title, rows in panels if rows]
    if not panels:
        return False
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    heights = [len(rows) + 1.2 for _, rows in panels]
    figure, axes = plt.subplots(
        len(panels), 1, figsize=(10.0, 0.36 * sum(heights) + 0.9), height_ratios=heights, squeeze=False,
        sharex=True, layout="constrained",
    )  # fmt: skip
    for axis, (title, rows) in zip(axes[:, 0], panels, strict=True):
        _bars(axis, title, rows)
    axes[-1, 0].set_xlabel("environment steps per second (red: target)")
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return True


def _charted(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.charted and row.value is not None]


def _bars(axis: object, title: str, rows: Sequence[Row]) -> None:
    places = range(len(rows))
    values = [row.value or 0.0 for row in rows]
    axis.barh(places, values, color=[OURS if row.own else OTHERS for row in rows], height=0.7)
    for place, row, value in zip(places, rows, values, strict=True):
        reach = value
        if row.target is not None:
            axis.plot([row.target.value] * 2, [place - 0.42, place + 0.42], color=TARGET, linewidth=2.0)
            reach = max(value, row.target.value)
        axis.annotate(
            number(value), (reach, place), xytext=(6, 0), textcoords="offset points", va="center", fontsize=8
        )
    axis.set_yticks(places, [row.name.replace("`", "") for row in rows], fontsize=8)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_title(title, loc="left", fontsize=10, fontweight="bold")
    axis.margins(x=0.12)
    axis.grid(axis="x", alpha=0.3)
    axis.set_axisbelow(True)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
