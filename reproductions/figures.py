"""The common look of figures, and what many of them draw: lines with bands, bars, ranges, dots, matrices.

A figure is 1000 pixels wide, readable at that size, and safe for the colour-blind. Panels are Matplotlib's
axes: a helper draws one thing on one of them, and `axes.set(xlabel=..., title=...)` says the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BLUE", "GREEN", "INK", "ORANGE", "PURPLE", "RED", "Figure", "annotate", "band", "bars", "dots", "grid",
    "look", "matrix", "octaves", "panels", "ranges", "reference_line", "save", "shared_legend", "thin",
    "ticks",
]  # fmt: skip

# Okabe and Ito's colours, told apart with any kind of colour vision.
BLUE, ORANGE, GREEN, RED, PURPLE = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7"
INK = "#3c4650"
"""For what is not data: a reported value, a bound, a label."""

SMALL = 8.5
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
        "axes.titlelocation": "left",
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


def save(figure: Figure, path: Path) -> None:
    """Write a PNG. A bare `Figure` draws with Agg: no display, no global state."""
    figure.savefig(path, dpi=_DOTS_PER_INCH, metadata={"Software": None})


def grid(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, NDArray[Any]]:
    """A figure with rows and columns of panels; height in inches of 125 pixels, options of `subplots`."""
    figure = Figure(figsize=(8.0, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def panels(count: int = 1, height: float = 4.0, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels side by side."""
    figure, axes = grid(1, count, height, **options)
    return figure, list(axes[0])


def shared_legend(figure: Figure, axes: Axes, title: str = "", **options: Any) -> None:
    """The legend of one panel below all, and a title above all."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", **{"fontsize": SMALL} | options)
    if title:
        figure.suptitle(title, x=0.01, ha="left")


def annotate(
    axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float] = (0, 0), **options: Any
) -> None:
    """Text beside a point, so many points of type away from it."""
    axes.annotate(text, at, offset, textcoords="offset points", **options)


def reference_line(axes: Axes, value: float, text: str = "", *, at: float = 0.99, **line: Any) -> None:
    """A horizontal line with what it stands for above it, at a share of the width."""
    axes.axhline(value, **{"color": INK, "linewidth": 1.0, "linestyle": "--"} | line)
    side = "right" if at > 0.5 else "left"
    annotate(axes, text, (at, value), (0, 3), xycoords=("axes fraction", "data"), ha=side, fontsize=SMALL)


def band(axes: Axes, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, alpha: float = 0.2) -> None:
    """The interval about a line."""
    axes.fill_between(np.asarray(x), low, high, color=colour, alpha=alpha, linewidth=0.0)


def ticks(axes: Axes, names: Sequence[str], *, of_y: bool = False, **options: Any) -> None:
    """Name the places 0, 1, 2, ... of an axis, without lines of the grid; those of y count downwards."""
    (axes.set_yticks if of_y else axes.set_xticks)(range(len(names)), list(names), **options)
    axes.grid(axis="y" if of_y else "x", visible=False)
    if of_y and not axes.yaxis_inverted():
        axes.invert_yaxis()


def bars(
    axes: Axes,
    values: Mapping[str, ArrayLike],
    colours: Sequence[str],
    *,
    flat: bool = False,
    width: float = 0.8,
    base: Mapping[str, ArrayLike] | None = None,
    **options: Any,
) -> NDArray[np.float64]:
    """Groups of bars, side by side, at the places 0, 1, 2, ...: an entry of `values` for each bar of a group.

    Args:
        axes: The panel.
        values: By what the legend calls them, (groups,); NaN for no bar.
        colours: One for each entry.
        flat: Bars lie, and groups go along y.
        width: Of a group.
        base: Where bars begin; by default at 0.
        options: Of `bar` or `barh`.

    Returns:
        (entries, groups), the places of the bars.
    """
    count = len(values)
    groups = np.arange(np.size(next(iter(values.values()))), dtype=np.float64)
    places = groups + width / count * (np.arange(count)[:, np.newaxis] - 0.5 * (count - 1))
    draw, start = (axes.barh, "left") if flat else (axes.bar, "bottom")
    for place, (name, those), colour in zip(places, values.items(), colours, strict=True):
        begin = {start: base[name]} if base else {}
        draw(place, those, 0.9 * width / count, color=colour, label=name, **begin | options)
    return places


def ranges(
    axes: Axes, at: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, flat: bool = False, **line: Any
) -> None:
    """A line from low to high at each place; along x if flat."""
    (axes.hlines if flat else axes.vlines)(at, low, high, **{"color": colour, "linewidth": 2.0} | line)


def dots(
    axes: Axes,
    at: float,
    values: ArrayLike,
    colour: str,
    spread: float = 0.0,
    flat: bool = False,
    **mark: Any,
) -> None:
    """A dot for each value, at one place and spread about it; along x if flat."""
    along = np.ravel(values)
    across = at + np.linspace(-spread, spread, along.size) if along.size > 1 else np.array([at])
    mark = {"color": colour, "markersize": 3.5} | mark
    axes.plot(*((along, across) if flat else (across, along)), "o", **mark)


def matrix(axes: Axes, values: NDArray[np.float64], rows: Sequence[str], columns: Sequence[str]) -> Any:
    """Shares (rows, columns) as colours and, in %, as numbers; grey where there is none. The image."""
    image = axes.imshow(100.0 * values, origin="lower", aspect="auto", vmin=0.0, vmax=100.0, cmap="cividis")
    axes.set_facecolor("#e3e7eb")
    axes.set_xticks(range(len(columns)), list(columns))
    axes.set_yticks(range(len(rows)), list(rows))
    axes.tick_params(labelsize=SMALL)
    axes.grid(visible=False)
    for (row, column), share in np.ndenumerate(values):
        if not np.isnan(share):
            axes.text(
                column, row, f"{100.0 * share:.0f}", ha="center", va="center", fontsize=6.5,
                color="white" if share < 0.6 else "black",
            )  # fmt: skip
    return image


def thin(
    axes: Axes, x: ArrayLike, lines: ArrayLike, colour: str, label: str | None = None, **line: Any
) -> None:
    """Lines (lines, points) of the same kind, such as of training runs; one of them stands in the legend."""
    for number, one in enumerate(np.asarray(lines)):
        axes.plot(x, one, label=None if number else label, **{"color": colour, "linewidth": 0.8} | line)


def octaves(axes: Axes, at: Sequence[float]) -> None:
    """Multiples of a setting along x, by factors of two, and y by factors of ten."""
    axes.set_xscale("log", base=2)
    axes.set_xticks(list(at), [f"{one:g}" for one in at])
    axes.minorticks_off()
    axes.set_yscale("log")
