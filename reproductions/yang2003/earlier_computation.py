"""Figures of an earlier computation of this project, with a planner of its own, to set ours beside.

It was made from the source before the library, with SciPy's HiGHS: the same equations and the same periods,
rate changes planned and mapped by other code. It says nothing of the source; where it agrees, two programs
do. With damaged thrusters it fires up to 3 % less and takes a little more delta-v, which has a high price in
the plans here.
"""

from __future__ import annotations

from collections.abc import Mapping

from reproductions.record import Table


def beside_earlier(figures: Mapping[str, tuple[float, float]]) -> Table:
    """A table of figures, ours and the earlier ones, by name."""
    return Table(
        "Beside an earlier computation of this project by other code",
        ("", "ours", "earlier", "difference, %"),
        tuple(
            (name, f"{ours:.5g}", f"{earlier:.5g}", f"{100.0 * (ours / earlier - 1.0):.1f}")
            for name, (ours, earlier) in figures.items()
        ),
    )
