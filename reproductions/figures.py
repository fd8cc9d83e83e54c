"""The common look of figures: 1000 pixels wide, readable at that size, and safe for the colour-blind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

__all__ = ["BLUE", "GREEN", "INK", "ORANGE", "PURPLE", "RED", "look", "panels", "save"]

# Okabe and Ito's colours, told apart with any kind of colour vision.
BLUE, ORANGE, GREEN, RED, PURPLE = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7"
INK = "#3c4650"
"""For what is not data: a reported value, a bound, a label."""

_DOTS_PER_INCH = 125


@contextmanager
def look() -> Iterator[None]:
    """Draw in the common look while this is open; the command opens it around every figure."""
    settings = {
        "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREEN, RED, PURPLE]),
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.edgecolor": INK,
        "axes.labelcolor": INK,
        "axes.titlecolor": INK,
        "axes.titlesize": 10.5,
        "axes.axisbelow": True,
        "axes.grid": True,
        "grid.color": "#e3e7eb",
        "grid.linewidth": 0.8,
        "xtick.color": INK,
        "ytick.color": INK,
        "text.color": INK,
        "font.size": 10.0,
        "legend.frameon": False,
    }
    with mpl.rc_context(settings):
        yield


def panels(count: int = 1, height: float = 4.0) -> tuple[Figure, list[Axes]]:
    """A figure of 1000 pixels with so many panels side by side; height in inches of 125 pixels."""
    figure = Figure(figsize=(8.0, height), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False)[0])


def save(figure: Figure, path: Path) -> None:
    """Write a PNG. A bare `Figure` draws with Agg: no display, no global state."""
    figure.savefig(path, dpi=_DOTS_PER_INCH, metadata={"Software": None})
