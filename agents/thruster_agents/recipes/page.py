"""The results of recipes: a table for the terminal, and a page with its picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from thruster_agents.files import write_whole
from thruster_agents.pictures import Bars, draw_scores
from thruster_agents.recipes.comparison import MEASURES, SCENARIOS, Row, rows_of
from thruster_agents.recipes.recipes import Recipe

__all__ = ["Result", "table", "write_page"]


@dataclass(frozen=True)
class Result:
    """What came of a recipe.

    Attributes:
        recipe: As it was learnt.
        yardsticks: What it has to beat, as `fly_yardsticks` gives it.
        seeds: For each policy what it flew (`flown`), the processor minutes (`minutes`), its `curve`.
    """

    recipe: Recipe
    yardsticks: Any
    seeds: Sequence[dict[str, Any]]

    @cached_property
    def rows(self) -> list[Row]:
        """The table, row by row."""
        return rows_of(self.recipe, self.yardsticks, [one["flown"] for one in self.seeds])

    @property
    def minutes(self) -> float:
        """Processor minutes of a training, mean over seeds."""
        return float(np.mean([one["minutes"] for one in self.seeds]))

    def verdict(self, scenario: str) -> str:
        """Whether the interval of the score lies above those of nothing and of random actions, in a word."""
        cells = {row.key: row.cells[scenario]["score"] for row in self.rows}
        if cells["nothing"][0] == 1.0:
            return "-"
        return "yes" if cells["ppo"][1] > max(cells["nothing"][2], cells["random"][2]) else "**no**"


def table(result: Result) -> Table:
    """For the terminal, means alone."""
    shown = Table(title=_title(result), box=SIMPLE_HEAD, title_justify="left")
    shown.add_column("method", no_wrap=True)
    for heading in _headings():
        shown.add_column(heading, justify="right")
    for row in result.rows:
        shown.add_row(
            row.title,
            *(one.partition(" ")[0] for one in _values(row)),
            style="bold" if row.key == "ppo" else None,
        )
    return shown


def write_page(path: Path, results: Sequence[Result], episodes: int, command: str) -> None:
    """Write the page, and the picture of the same name beside it.

    Args:
        path: Of the page, `.md`.
        results: In their order.
        episodes: Of each policy in each scenario.
        command: That writes it.
    """
    picture = path.with_suffix(".png")
    path.parent.mkdir(parents=True, exist_ok=True)
    panels = [
        Bars(
            result.recipe.key,
            [row.title for row in result.rows],
            {one.title: [row.cells[one.name]["score"] for row in result.rows] for one in SCENARIOS},
            [row.key == "ppo" for row in result.rows],
        )
        for result in results
    ]
    draw_scores(picture, panels)
    write_whole(path.resolve(), _page(results, episodes, command, picture.name).encode())


def _page(results: Sequence[Result], episodes: int, command: str, picture: str) -> str:
    lines = [
        "# A learner's first hour: PPO by recipe",
        "",
        f"Written by `{command}`; nothing here is typed by hand.",
        "",
        "Each recipe learns a variant of a task, by PPO of Stable-Baselines3 on the native batch with one "
        f"thread. All methods fly the same {episodes} test episodes, which no training has seen, without "
        "faults and with those of the task: its own distribution, or, where it has none, one fault from the "
        "beginning in every second episode. Means, with 95 % bootstrap intervals over episodes, and for PPO "
        "over policies too. Random actions are drawn as the learner's are; a classical method acts in every "
        "control period on what is observed. *Learnt* means that the interval of PPO's score lies above "
        "those of doing nothing and of random actions; - stands where to do nothing is all that is right.",
        "",
        f"![Scores of every method]({picture})",
        "",
        "| recipe | what the variant changes | steps | processor minutes | seeds | learnt, healthy | "
        "learnt, with faults |",
        "|---|---|---:|---:|---:|---|---|",
    ]
    for result in results:
        learnt = (result.verdict(one.name) for one in SCENARIOS)
        lines.append(
            f"| {result.recipe.key} | {result.recipe.variant.changes} | {result.recipe.steps:,} | "
            f"{result.minutes:.1f} | {len(result.seeds)} | {' | '.join(learnt)} |"
        )
    for result in results:
        lines += ["", f"## {result.recipe.variant.task}, {result.recipe.variant.name}", ""]
        lines += [f"| method | {' | '.join(_headings())} |", "|---|" + "---:|" * len(_headings())]
        for row in result.rows:
            lines.append(f"| {row.title} | {' | '.join(_values(row))} |")
        scores = [[np.mean(one["flown"][s.name]["score"]) for one in result.seeds] for s in SCENARIOS]
        spread = (
            f"{s.title} {min(of):.3f} to {max(of):.3f}" for s, of in zip(SCENARIOS, scores, strict=True)
        )
        lines += ["", f"Mean score of the worst and the best policy: {', '.join(spread)}."]
    return "\n".join([*lines, ""])


def _title(result: Result) -> str:
    seeds = len(result.seeds)
    return (
        f"{result.recipe.key}: {result.recipe.steps:,} steps, {result.minutes:.1f} processor minutes, "
        f"{seeds} seed{'s' if seeds > 1 else ''}"
    )


def _headings() -> list[str]:
    return [f"{measure}, {one.title}" for one in SCENARIOS for measure in MEASURES]


def _values(row: Row) -> list[str]:
    shown = []
    for one in SCENARIOS:
        for measure in MEASURES:
            mean, low, high = row.cells[one.name][measure]
            digits = 2 if measure == "return" else 3
            shown.append(f"{mean:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})")
    return shown
