"""Pictures of runs: how the policies learned, and how all methods compare."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thruster_agents.evaluation.play import Scenario
from thruster_agents.evaluation.table import Row
from thruster_agents.files import write_whole
from thruster_agents.ppo.checkpoint import Point

__all__ = ["Bars", "draw_comparison", "draw_learning_curve", "draw_scores"]

_LEARNED, _OTHER, _ORACLE = "#1f6fb4", "#9aa5b1", "#3c4650"


def draw_learning_curve(
    path: Path, curves: Mapping[str, Sequence[Sequence[Point]]], lines: Mapping[str, float]
) -> None:
    """Validation score over environment steps, a panel for each action form.

    Args:
        path: Of the PNG.
        curves: For each action form, the curves of its seeds.
        lines: Scores to draw across, by their label, the best first.
    """
    figure = Figure(figsize=(5.6 * len(curves) + 0.8, 4.4), layout="constrained")
    panels = figure.subplots(1, len(curves), squeeze=False)[0]
    for panel, (form, seeds) in zip(panels, curves.items(), strict=True):
        for curve in seeds:
            panel.plot(
                [point.steps / 1000 for point in curve],
                [point.score for point in curve],
                color=_LEARNED,
                linewidth=2.2 if len(seeds) == 1 else 1.2,
            )
        lowest = min(point.score for curve in seeds for point in curve)
        highest = max(lines.values(), default=lowest)
        reach = max(highest - lowest, 1e-3)
        shown = {label: score for label, score in lines.items() if score > lowest - 0.15 * reach}
        heights = _apart(list(shown.values()), 0.055 * 1.3 * reach)
        for height, (label, score) in zip(heights, shown.items(), strict=True):
            panel.axhline(score, color=_OTHER, linewidth=1.0, zorder=0)
            panel.annotate(
                label,
                (1.01, height),
                xycoords=("axes fraction", "data"),
                va="center",
                fontsize=8.5,
                color=_ORACLE,
                annotation_clip=False,
            )
        panel.set(
            xlabel="environment steps, thousands",
            title=f"PPO on {form}",
            xlim=(0.0, None),
            ylim=(max(lowest - 0.15 * reach, 0.0), highest + 0.15 * reach),
        )
        _clean(panel)
    panels[0].set_ylabel("mean score with faults, validation seeds")
    _save(figure, path)


def _apart(heights: Sequence[float], distance: float) -> list[float]:
    """Heights for labels, falling, each at least that far below the one before."""
    placed: list[float] = []
    for height in heights:
        placed.append(height if not placed else min(height, placed[-1] - distance))
    return placed


def draw_comparison(path: Path, rows: Sequence[Row], scenarios: Sequence[Scenario]) -> None:
    """Share of the way to the oracle, a panel for each scenario, with the interval of the score."""
    figure = Figure(figsize=(3.4 * len(scenarios) + 2.2, 0.42 * len(rows) + 1.5), layout="constrained")
    panels = figure.subplots(1, len(scenarios), sharey=True, squeeze=False)[0]
    places = range(len(rows))
    for panel, scenario in zip(panels, scenarios, strict=True):
        top = next(row for row in rows if row.key == "oracle").cells[scenario.name].score or 1.0
        for place, row in zip(places, rows, strict=True):
            cell = row.cells[scenario.name]
            colour = _LEARNED if row.key.startswith("ppo") else _ORACLE if row.key == "oracle" else _OTHER
            panel.barh(place, cell.way, color=colour, height=0.68)
            below, above = (cell.score - cell.low) / top, (cell.high - cell.score) / top
            panel.errorbar(
                cell.way, place, xerr=[[below], [above]], color="black", linewidth=1.0, capsize=2.0
            )
            panel.annotate(
                f"{100.0 * cell.way:.1f}",
                (max(cell.way + above, 0.0), place),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=9,
            )
        panel.set(title=scenario.title, xlim=(0.0, 1.22), xlabel="share of the way to the oracle, %")
        panel.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100"])
        _clean(panel, across=True)
    panels[0].set_yticks(list(places), [row.title for row in rows])
    panels[0].invert_yaxis()
    _save(figure, path)


class Bars(NamedTuple):
    """A panel of :func:`draw_scores`.

    Attributes:
        title: Of the panel.
        methods: Names, from the top.
        scores: By scenario, for each method the mean score and both ends of its interval.
        learnt: Which methods were learnt.
    """

    title: str
    methods: Sequence[str]
    scores: Mapping[str, Sequence[tuple[float, float, float]]]
    learnt: Sequence[bool]


def draw_scores(path: Path, panels: Sequence[Bars]) -> None:
    """Mean scores with their intervals, a panel for each task; a paler bar for each further scenario."""
    columns = min(2, len(panels))
    lines = -(-len(panels) // columns)
    figure = Figure(figsize=(6.4 * columns, 2.5 * lines + 0.6), layout="constrained")
    every = figure.subplots(lines, columns, squeeze=False).flatten()
    for axes, panel in zip(every, panels, strict=False):
        height = 0.8 / len(panel.scores)
        for number, (scenario, cells) in enumerate(panel.scores.items()):
            for place, (mean, low, high) in enumerate(cells):
                where = place + (number - 0.5 * (len(panel.scores) - 1)) * height
                colour = _LEARNED if panel.learnt[place] else _OTHER
                axes.barh(where, mean, color=colour, height=height, alpha=1.0 / (1.0 + number))
                axes.errorbar(
                    mean, where, xerr=[[mean - low], [high - mean]], color="black", linewidth=1.0, capsize=2.0
                )
                axes.annotate(
                    f"{mean:.2f} {scenario}", (high, where), xytext=(4, 0), textcoords="offset points",
                    va="center", fontsize=7.5,
                )  # fmt: skip
        axes.set(title=panel.title, xlim=(0.0, 1.3), xlabel="mean score, test seeds")
        axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0])
        axes.set_yticks(range(len(panel.methods)), list(panel.methods))
        axes.invert_yaxis()
        _clean(axes, across=True)
    for axes in every[len(panels) :]:
        axes.set_visible(False)
    _save(figure, path)


def _clean(axes: Axes, across: bool = False) -> None:
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(axis="x" if across else "y", color="#e3e7eb", linewidth=0.8)
    axes.set_axisbelow(True)


def _save(figure: Figure, path: Path) -> None:
    picture = io.BytesIO()
    figure.savefig(
        picture, format="png", dpi=150
    )  # a bare Figure draws with Agg: no display, no global state
    write_whole(path, picture.getvalue())
