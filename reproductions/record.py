"""What a reproduction is, and what comes of running one.

A `Reproduction` says where a result stands in its source, what was reported, and what has to hold for it to
count as reproduced; its `run` recomputes it and gives a `Finding`. The verdict follows from the finding's
checks. Nobody writes it down.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeAlias

from matplotlib.figure import Figure

__all__ = [
    "FULL", "QUICK", "Effort", "Finding", "Reproduction", "Study", "Table", "Verdict", "reproduces",
]  # fmt: skip


class Verdict(StrEnum):
    """What came of an attempt to recompute a result."""

    REPRODUCED = "reproduced"
    WITH_A_CORRECTION = "reproduced with a correction"
    NOT_REPRODUCIBLE = "not reproducible"
    NOT_REPRODUCED = "not reproduced"
    BEYOND_THE_SOURCE = "beyond the source"


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much a run may cost.

    Attributes:
        samples: Random commands or problems of a study.
        repetitions: Timed calls.
        flights: Episodes flown.
    """

    samples: int = 10_000
    repetitions: int = 2_000
    flights: int = 100


FULL = Effort()
QUICK = Effort(samples=20, repetitions=5, flights=1)
"""Shows that a reproduction runs; says nothing about its result."""


@dataclass(frozen=True)
class Table:
    """Lines of text under headings.

    Attributes:
        title: What it shows.
        head: One heading per column.
        rows: One text per column; any iterable is made a tuple.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, title: str, items: Any, columns: Mapping[str, str | Callable[..., str]]) -> Table:
        """A table with a row for each item.

        Args:
            title: What it shows.
            items: What rows are of; of a mapping, its keys with their values.
            columns: What stands under each heading: a text with the parts of an item in braces, or a function
                of them.

        >>> Table.of("", {"a": 1.5}, {"": "{0}", "size": "{1:.2f}", "twice": lambda _, x: f"{2 * x:g}"}).rows
        (('a', '1.50', '3'),)
        """
        parts = [
            item if isinstance(item, tuple) else (item,)
            for item in (items.items() if isinstance(items, Mapping) else items)
        ]
        return cls(
            title,
            tuple(columns),
            tuple(
                tuple(cell.format(*one) if isinstance(cell, str) else cell(*one) for cell in columns.values())
                for one in parts
            ),
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "head", tuple(self.head))
        object.__setattr__(self, "rows", tuple(map(tuple, self.rows)))
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.head):
                raise ValueError(
                    f"row {number} of {self.title!r} has {len(row)} cells; {len(self.head)} would be right"
                )


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was recomputed.

    Attributes:
        ours: The figures to set beside what was reported, in a line.
        checks: The parts of the criterion, each with whether it holds (NumPy's truth too); one or more.
        correction: What of the source has to be put right before its result comes out; empty for nothing.
        not_reproducible: Why a reported figure cannot be had, whatever is computed; empty if it can.
        beyond_source: The source reports nothing to compare with.
        note: What a reader should know besides.
        data: The figures, as what JSON knows (NumPy's numbers and arrays are turned into it).
        tables: Shown below the note.
        figure: Draws it.
    """

    ours: str
    checks: Mapping[str, bool]
    data: Mapping[str, Any]
    correction: str = ""
    not_reproducible: str = ""
    beyond_source: bool = False
    note: str = ""
    tables: tuple[Table, ...] = ()
    figure: Callable[[], Figure] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not self.checks:
            raise ValueError("checks is empty; one part of the criterion or more would be right")
        if self.correction and self.not_reproducible:
            raise ValueError("correction and not_reproducible are both given; one of them would be right")

    @property
    def verdict(self) -> Verdict:
        """A check that fails outweighs the rest."""
        if not all(self.checks.values()):
            return Verdict.NOT_REPRODUCED
        if self.beyond_source:
            return Verdict.BEYOND_THE_SOURCE
        if self.not_reproducible:
            return Verdict.NOT_REPRODUCIBLE
        return Verdict.WITH_A_CORRECTION if self.correction else Verdict.REPRODUCED

    @property
    def reason(self) -> str:
        """What goes with the verdict: the checks that fail, why it cannot be had, or what was corrected."""
        failed = "; ".join(part for part, holds in self.checks.items() if not holds)
        return failed or self.not_reproducible or self.correction


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """A result of a source, and how it is recomputed.

    Attributes:
        id: Unique over all sources, such as E07.
        title: What it is.
        source: Such as Yang 2003.
        lines: Where it stands there; L numbers are lines of the text that this project worked from.
        reported: What the source says, in a line.
        criterion: What has to hold for it to count as reproduced.
        run: Recomputes it; a function of a module, which another process can find.
        alone: It times something, and is run when nothing else runs.
    """

    id: str
    title: str
    source: str
    lines: str
    reported: str
    criterion: str
    run: Callable[[Effort], Finding]
    alone: bool = False


Study: TypeAlias = Callable[[Effort], Finding]


def reproduces(id: str, **of_the_source: Any) -> Callable[[Study], Study]:  # noqa: A002 - what the id is called
    """Make a study the reproduction of a result; the study's docstring is the title, without its full stop.

    Args:
        id: Unique over all sources, such as E07.
        of_the_source: `source`, `lines`, `reported`, `criterion` and `alone` of `Reproduction`.
    """

    def decorate(study: Study) -> Study:
        title = (study.__doc__ or "").removesuffix(".")
        study.reproduction = Reproduction(id=id, title=title, run=study, **of_the_source)  # type: ignore[attr-defined]  # a function takes any attribute
        return study

    return decorate
