"""What a section of the benchmarks gives: rows with targets, tables and profiles; as text and as Markdown.

A section's function returns a :class:`Section`. Nothing here measures anything.
"""

from __future__ import annotations

import datetime
import importlib.metadata
import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class AtLeast:
    """A target for what should be large.

    Attributes:
        value: The target.
        bound: What is still acceptable; None if nothing below the target is.
    """

    value: float
    bound: float | None = None

    def verdict(self, value: float) -> str:
        """One word on a measured value."""
        if value >= self.value:
            return "met"
        return "acceptable" if self.bound is not None and value >= self.bound else "missed"

    def __str__(self) -> str:
        bound = f" (acceptable: {number(self.bound)})" if self.bound is not None else ""
        return f"≥ {number(self.value)}{bound}"


@dataclass(frozen=True)
class AtMost:
    """A target for what should be small.

    Attributes:
        value: The target.
    """

    value: float

    def verdict(self, value: float) -> str:
        """One word on a measured value."""
        return "met" if value <= self.value else "missed"

    def __str__(self) -> str:
        return f"≤ {number(self.value)}"


@dataclass(frozen=True)
class Row:
    """One measured figure.

    Attributes:
        name: What was measured.
        value: The median; None if it could not be measured (the note says why).
        unit: Of the value.
        target: What it should be.
        ratio: How it compares with something of the same run, in words.
        note: What a reader has to know.
        explain: Shows where the time goes, as Markdown; called if the target is missed.
        charted: Whether the figure shows it.
        own: Whether it is of this package, not of a peer.
    """

    name: str
    value: float | None
    unit: str
    target: AtLeast | AtMost | None = None
    ratio: str = ""
    note: str = ""
    explain: Callable[[], str] | None = field(default=None, compare=False)
    charted: bool = False
    own: bool = True

    @property
    def verdict(self) -> str:
        """``met``, ``acceptable``, ``missed``, or nothing without a target or a value."""
        if self.target is None or self.value is None:
            return ""
        return self.target.verdict(self.value)

    def cells(self) -> tuple[str, ...]:
        """The row in words."""
        value = number(self.value) if self.value is not None else "–"
        target = str(self.target) if self.target is not None else ""
        return (self.name, value, self.unit, target, self.verdict, self.ratio, self.note)


@dataclass(frozen=True)
class Section:
    """What one part of the benchmarks found.

    Attributes:
        title: Its heading.
        about: What is measured and how, in Markdown.
        rows: The figures.
        appendix: Further Markdown, below the table.
    """

    title: str
    about: str
    rows: Sequence[Row]
    appendix: str = ""


HEADINGS = ("what", "median", "unit", "target", "verdict", "compared in this run", "note")


def number(value: float) -> str:
    """A figure with three significant digits or all of its whole ones, thousands apart.

    >>> number(1234567.8), number(61.234), number(0.01234), number(1.2e-10)
    ('1,230,000', '61.2', '0.0123', '1.2e-10')
    """
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    if abs(value) < 1e-4:
        return f"{value:.1e}".replace("e-0", "e-")
    digits = 2 - math.floor(math.log10(abs(value)))
    return f"{round(value, digits):,.{max(0, digits)}f}"


def markdown_table(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; columns that are empty throughout are left out."""
    kept = [k for k in range(len(headings)) if any(line[k] for line in lines)]
    shown = [[headings[k] for k in kept], ["---"] * len(kept), *([line[k] for k in kept] for line in lines)]
    return "\n".join("| " + " | ".join(line) + " |" for line in shown)


def plain_table(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """The same for a terminal."""
    kept = [k for k in range(len(headings)) if any(line[k] for line in lines)]
    shown = [[headings[k] for k in kept], *([line[k] for k in kept] for line in lines)]
    widths = [max(len(line[k]) for line in shown) for k in range(len(kept))]
    numeric = [headings[k] == "median" for k in kept]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(line, widths, numeric, strict=True)
        ).rstrip()
        for line in shown
    )


def section_as_text(section: Section) -> str:
    """A section for a terminal: heading and table, notes left to the written report."""
    lines = [row.cells()[:-1] for row in section.rows]
    return f"\n{section.title}\n{'=' * len(section.title)}\n{plain_table(HEADINGS[:-1], lines)}\n"


def section_as_markdown(section: Section) -> str:
    """A section of the written report, with a profile for every target that was missed."""
    parts = [
        f"## {section.title}",
        section.about,
        markdown_table(HEADINGS, [row.cells() for row in section.rows]),
    ]
    if section.appendix:
        parts.append(section.appendix)
    for row in section.rows:
        if row.verdict in ("missed", "acceptable") and row.explain is not None:
            parts += [f"### Where the time goes: {row.name}", row.explain()]
    return "\n\n".join(parts)


def report(
    sections: Sequence[Section],
    picture: str | None,
    share_of_core: float | None,
    *,
    processor_time: bool = False,
) -> str:
    """The whole of ``speed.md``.

    Args:
        sections: In their order.
        picture: File name of the figure beside it, if there is one.
        share_of_core: Share of a core that this process had while it measured on one thread.
        processor_time: Whether work on one thread was timed by the processor's clock.
    """
    missed = [row for section in sections for row in section.rows if row.verdict == "missed"]
    judged = [row for section in sections for row in section.rows if row.verdict]
    summary = f"{len(judged) - len(missed)} of {len(judged)} targets are reached." + (
        " Missed: " + "; ".join(row.name for row in missed) + "." if missed else ""
    )
    parts = [
        "# Speed",
        "Written by `make bench`; not edited by hand. Every figure is the median of at least five "
        "repetitions, taken in turns with what it is compared with; where calls are timed one by one, the "
        "section says of how many. Compilation and construction are left out.",
        summary,
        machine_facts(share_of_core, processor_time),
    ]
    if picture is not None:
        parts.append(f"![Speed of environments, mappers and detectors, and of their peers]({picture})")
    parts += [section_as_markdown(section) for section in sections]
    return "\n\n".join(parts) + "\n"


def machine_facts(share_of_core: float | None, processor_time: bool) -> str:
    """On what the figures were measured, as a table in Markdown."""
    facts = [
        ("date", datetime.datetime.now(datetime.UTC).date().isoformat()),
        ("processor", f"{_processor()}, {os.cpu_count()} cores visible"),
        ("system", f"{platform.system()} {platform.machine()}"),
        ("Python", platform.python_version()),
        ("libraries", ", ".join(f"{name} {version(name)}" for name in LIBRARIES if version(name))),
    ]
    clock = "the processor's, which stands still while others run" if processor_time else "the wall's"
    facts.append(("clock of single-threaded runs", clock))
    if share_of_core is not None:
        busy = "" if share_of_core > 0.95 else " (other programs were running, so wall times are too long)"
        facts.append(("share of a core that they had", f"{share_of_core:.0%}{busy}"))
    return markdown_table(("fact", "value"), facts)


LIBRARIES = (
    "thruster-envs", "numpy", "numba", "gymnasium", "stable-baselines3", "torch", "vmas", "bsk", "scipy",
    "highspy", "swiglpk", "daqp", "clarabel", "filterpy", "pettingzoo", "supersuit",
)  # fmt: skip


def version(distribution: str) -> str:
    """Version of an installed distribution; empty if it is not installed."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _processor() -> str:
    facts = Path("/proc/cpuinfo")
    if facts.exists():
        for line in facts.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown processor"
