"""Measured samples over time beside the curve that was expected, in the box of the path.

Models: one plot for each curve, one above the other, on a common axis of time; what does not fit is left out.
"""

from __future__ import annotations

import numpy as np

from thruster_envs.rendering.axes import draw_axes, plot_boxes
from thruster_envs.rendering.canvas import COMMANDED_EDGE, DELIVERED, MUTED, WELL, Canvas
from thruster_envs.rendering.layout import Layout
from thruster_envs.rendering.scene import Curve
from thruster_envs.rendering.ticks import round_limits


class CurvesView:
    """Draws curves into the box of the path."""

    def __init__(self, canvas: Canvas, layout: Layout) -> None:
        self._canvas = canvas
        self._layout = layout
        self._boxes = plot_boxes(canvas, layout, "−00000")

    def draw(self, curves: tuple[Curve, ...]) -> None:
        """Axes, the expected curve as a line, the measured samples as dots."""
        canvas, small = self._canvas, self._layout.small_size
        shown = list(zip(curves, self._boxes, strict=False))
        for number, (curve, box) in enumerate(shown):
            left, top, width, height = box
            canvas.rectangle(WELL, box, radius=3.0)
            values = np.concatenate((curve.expected, curve.measured))
            low, high = float(values.min()), float(values.max())
            horizontal = round_limits(float(curve.time[0]), float(curve.time[-1]), width / (4.2 * small))
            vertical = round_limits(
                low, high if high - low > 1e-9 else low + 1.0, max(2.0, height / (1.9 * small))
            )
            below = curve.time_label if number == len(shown) - 1 else ""
            draw_axes(canvas, self._layout, box, horizontal, vertical, curve.label, below)
            across = left + width * (curve.time - horizontal[0]) / (horizontal[1] - horizontal[0])
            down = height / (vertical[1] - vertical[0])
            canvas.lines(
                COMMANDED_EDGE, np.stack((across, top + down * (vertical[1] - curve.expected)), 1), width=1.5
            )
            for column, value in zip(across.tolist(), curve.measured.tolist(), strict=True):
                canvas.circle(DELIVERED, (column, top + down * (vertical[1] - value)), 0.12 * small)

    def draw_legend(self, right: float, row: float, room: float) -> None:
        """What the line and the dots are, right-aligned, if it fits."""
        canvas, size = self._canvas, self._layout.small_size
        mark = 0.26 * size
        names = ("expected", "measured")
        widths = [canvas.text_width(name, size) + 6.5 * mark for name in names]
        if sum(widths) > room:
            return
        column = right - sum(widths) + 3.0 * mark
        canvas.line(COMMANDED_EDGE, (column - mark, row), (column + mark, row), width=1.5)
        canvas.text(MUTED, names[0], (column + 2.2 * mark, row), size, align="left")
        column += widths[0]
        canvas.circle(DELIVERED, (column, row), 0.6 * mark)
        canvas.text(MUTED, names[1], (column + 2.2 * mark, row), size, align="left")
