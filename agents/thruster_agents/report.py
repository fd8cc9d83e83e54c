"""The table for the terminal and for a results page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from thruster_agents.evaluation.methods import FALSE_ALARM_RATE
from thruster_agents.evaluation.play import Scenario
from thruster_agents.evaluation.table import Cell, Row, interquartile_mean
from thruster_agents.files import write_whole

__all__ = ["as_markdown", "as_table"]


def as_table(rows: Sequence[Row], scenarios: Sequence[Scenario], episodes: int, policies: int = 1) -> Table:
    """For the terminal: in each cell the mean score, the share of the way, and below them the interval."""
    table = Table(
        title="ThrusterMapping-v0 on held-out seeds: score, % of the way to the oracle",
        caption=_caption(episodes, policies),
        caption_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("method", no_wrap=True)
    table.add_column("sees", no_wrap=True)
    for scenario in scenarios:
        table.add_column(scenario.title, justify="right", no_wrap=True)
    for row in rows:
        cells = (row.cells[scenario.name] for scenario in scenarios)
        shown = (
            f"{one.score:.3f} {100.0 * one.way:5.1f}\n[dim]{one.low:.3f}-{one.high:.3f}[/dim]"
            for one in cells
        )
        table.add_row(row.title, row.sees, *shown, style="bold" if row.key.startswith("ppo") else None)
    return table


def as_markdown(
    path: Path, rows: Sequence[Row], scenarios: Sequence[Scenario], episodes: int, policies: int, command: str
) -> None:
    """Write the results page.

    Args:
        path: Of the file.
        rows: Of the table.
        scenarios: Its columns.
        episodes: To a cell, for each policy.
        policies: Trained for each learned row.
        command: That makes the page.
    """
    head = ["method", "sees", *(f"{scenario.title} | way" for scenario in scenarios)]
    lines = [
        "# Thruster mapping: learned and classical, on the same episodes",
        "",
        f"Written by `{command}`; nothing here is typed by hand.",
        "",
        f"| {' | '.join(head)} |",
        "|---|---|" + "---:|---:|" * len(scenarios),
    ]
    for row in rows:
        cells = [row.cells[scenario.name] for scenario in scenarios]
        shown = (f"{one.score:.4f} ({_interval(one)}) | {100.0 * one.way:.1f} %" for one in cells)
        lines.append(f"| {row.title} | {row.sees} | {' | '.join(shown)} |")
    lines += ["", _caption(episodes, policies)]
    if policies > 1:
        lines += ["", "## Over policies", "", *_over_policies(rows, scenarios)]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path.resolve(), "\n".join([*lines, ""]).encode())  # of a link, what it points to


def _over_policies(rows: Sequence[Row], scenarios: Sequence[Scenario]) -> list[str]:
    """A table of each learned row over the policies that were trained with different seeds."""
    lines = [
        "Mean score of each policy over the same episodes: interquartile mean over policies with its 95 % "
        "bootstrap interval, then the worst and the best policy.",
        "",
        f"| method | {' | '.join(scenario.title for scenario in scenarios)} |",
        "|---|" + "---:|" * len(scenarios),
    ]
    for row in (row for row in rows if row.key.startswith("ppo")):
        shown = []
        for scenario in scenarios:
            scores = row.cells[scenario.name].policies
            middle, low, high = interquartile_mean(scores)
            shown.append(f"{middle:.4f} ({low:.4f}–{high:.4f}), {min(scores):.4f} to {max(scores):.4f}")
        lines.append(f"| {row.title} | {' | '.join(shown)} |")
    return lines


def _interval(cell: Cell) -> str:
    return f"{cell.low:.3f}–{cell.high:.3f}"


def _caption(episodes: int, policies: int) -> str:
    trained = (
        f" Learned rows are over {policies} policies, trained with different seeds." if policies > 1 else ""
    )
    return (
        f"Mean score over {episodes} episodes, share of the way from doing nothing to the oracle, and the "
        f"95 % bootstrap interval of the score.{trained} The response test's threshold is the one that "
        f"{100.0 * FALSE_ALARM_RATE:g} % of healthy validation episodes exceed."
    )
