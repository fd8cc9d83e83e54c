"""The path in the LVLH frame: along-track across, radial above and cross-track below, in m.

Models: positions and targets of every craft, on axes that follow the data in round steps.
Leaves out: equal scales; the vertical scale is finer than the horizontal one where there is little to see
(but at most ``FINEST`` times, so that noise does not fill the panel).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from thruster_envs.rendering.axes import draw_axes, plot_boxes
from thruster_envs.rendering.canvas import (
    COMMANDED_EDGE,
    CRAFT,
    FAILED,
    TARGET,
    TEXT,
    WELL,
    Canvas,
    Color,
    blend,
)
from thruster_envs.rendering.layout import Box, Layout
from thruster_envs.rendering.scene import CraftScene
from thruster_envs.rendering.ticks import round_limits

FloatArray = npt.NDArray[np.float64]

FINEST = 5.0  # the most that the vertical scale is finer than the horizontal one
SMALLEST_SPAN = 0.5  # m
FADING_PIECES = 6
CORRIDOR: Color = blend(WELL, COMMANDED_EDGE, 0.6)
OLDEST_SHARE = 0.35  # brightness of the oldest part of the path


class PathView:
    """Draws the path of every craft into its box of the layout."""

    def __init__(self, canvas: Canvas, layout: Layout) -> None:
        self._canvas = canvas
        self._layout = layout
        labels = ("radial, m", "cross-track, m")
        self._plots: tuple[tuple[int, str, Box], ...] = tuple(
            zip((0, 2), labels, plot_boxes(canvas, layout, "−0000"), strict=False)
        )

    def draw_static(self) -> None:
        """What does not change: the wells of the plots."""
        for _, _, box in self._plots:
            self._canvas.rectangle(WELL, box, radius=3.0)

    def draw(self, crafts: tuple[CraftScene, ...], corridor: FloatArray) -> None:
        """Axes, as much of the corridor (k, 2) as they show, paths, targets and craft."""
        points = np.vstack([np.vstack([craft.path, craft.position, craft.target]) for craft in crafts])
        _, _, across, down = self._plots[0][2]
        intervals = max(2.0, across / (4.2 * self._layout.small_size))
        low, high = _widened(points[:, 1], SMALLEST_SPAN)
        horizontal = round_limits(low, high, intervals)
        span = (horizontal[1] - horizontal[0]) * down / across / FINEST
        for number, (axis, label, box) in enumerate(self._plots):
            low, high = _widened(points[:, axis], max(span, SMALLEST_SPAN))
            vertical = round_limits(low, high, max(2.0, box[3] / (1.9 * self._layout.small_size)))
            below = "along-track, m" if number == len(self._plots) - 1 else ""
            draw_axes(self._canvas, self._layout, box, horizontal, vertical, label, below)
            self._draw_craft(crafts, corridor, axis, box, horizontal, vertical)

    def _draw_craft(
        self,
        crafts: tuple[CraftScene, ...],
        corridor: FloatArray,
        axis: int,
        box: Box,
        horizontal: tuple[float, float, float],
        vertical: tuple[float, float, float],
    ) -> None:
        left, top, width, height = box
        scale = np.array([width / (horizontal[1] - horizontal[0]), -height / (vertical[1] - vertical[0])])
        offset = np.array([left, top]) - scale * np.array([horizontal[0], vertical[1]])
        canvas, size = self._canvas, max(0.75, self._layout.scale)
        if len(corridor) > 1:
            canvas.clip(box)
            for side in (-1.0, 1.0):
                canvas.lines(CORRIDOR, offset + scale * corridor * [1.0, side])
            canvas.clip(None)
        for number, craft in enumerate(crafts):
            self._draw_path(craft_color(number), offset + scale * craft.path[:, [1, axis]])
        for number, craft in enumerate(crafts):
            color = TARGET if len(crafts) == 1 else craft_color(number)
            column, row = offset + scale * craft.target[[1, axis]]
            canvas.circle(color, (column, row), 6.0 * size, width=1.0)
            for right, down in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                canvas.line(
                    color,
                    (column + 4.0 * size * right, row + 4.0 * size * down),
                    (column + 9.0 * size * right, row + 9.0 * size * down),
                )
        for number, craft in enumerate(crafts):
            place = offset + scale * craft.position[[1, axis]]
            color = craft_color(number)
            canvas.circle(WELL, place, 5.5 * size)
            canvas.circle(color, place, 4.0 * size)

    def _draw_path(self, color: Color, pixels: FloatArray) -> None:
        if len(pixels) == 0:
            return
        # Points closer than a pixel are not seen apart; the last one always stays.
        cells = np.floor(pixels)
        kept = np.append((cells[1:] != cells[:-1]).any(axis=1), True)
        pixels = pixels[kept]
        cuts = np.linspace(0, len(pixels) - 1, FADING_PIECES + 1).round().astype(int).tolist()
        for piece, (first, last) in enumerate(pairwise(cuts)):
            share = OLDEST_SHARE + (1.0 - OLDEST_SHARE) * (piece + 1) / FADING_PIECES
            self._canvas.lines(blend(WELL, color, share), pixels[first : last + 1], width=1.5)

    def draw_legend(
        self, crafts: tuple[CraftScene, ...], corridor: FloatArray, right: float, row: float, room: float
    ) -> None:
        """Names of the craft beside their colours, right-aligned; their numbers if that is too long."""
        canvas, size = self._canvas, self._layout.small_size
        several = len(crafts) > 1
        entries = [
            (craft_color(number), craft.name or f"craft {number + 1}", several and bool(craft.faulty.any()))
            for number, craft in enumerate(crafts)
        ]
        if not several:
            entries.append((TARGET, "target", False))
        if len(corridor) > 1:
            entries.append((CORRIDOR, "corridor", False))
        dot = 0.26 * size
        if sum(canvas.text_width(name, size) + 6.5 * dot for _, name, _ in entries) > room:
            entries = [
                (color, str(number) if several else name, failed)
                for number, (color, name, failed) in enumerate(entries, start=1)
            ]
        widths = [canvas.text_width(name, size) + 6.5 * dot for _, name, _ in entries]
        while entries and sum(widths) > room:
            entries.pop()
            widths.pop()
        column = right - sum(widths) + 3.0 * dot
        for (color, name, failed), width in zip(entries, widths, strict=True):
            canvas.circle(color, (column, row), dot, width=1.0 if color == TARGET else 0.0)
            canvas.text(FAILED if failed else TEXT, name, (column + 2.2 * dot, row), size, align="left")
            column += width


def craft_color(number: int) -> Color:
    """The colour of a craft, counted from 0."""
    return CRAFT[number % len(CRAFT)]


def _widened(values: FloatArray, least: float) -> tuple[float, float]:
    """The range of ``values``, widened about its middle to at least ``least``."""
    low, high = float(values.min()), float(values.max())
    missing = max(0.0, least - (high - low))
    return low - missing / 2, high + missing / 2
