"""Two plots one above the other in the box of the path, and their axes.

This module imports pygame by way of the canvas: only the picture's views may import it.
"""

from __future__ import annotations

from thruster_envs.rendering.canvas import AXIS, GRID, MUTED, Canvas
from thruster_envs.rendering.layout import Box, Layout
from thruster_envs.rendering.ticks import tick_label, tick_values

Limits = tuple[float, float, float]
"""Lower end, upper end, step."""

LEAST_HEIGHT = 64.0  # pixels that a plot needs; two stand one above the other where there is room


def plot_boxes(canvas: Canvas, layout: Layout, longest: str) -> tuple[Box, ...]:
    """The boxes of two plots, the upper one first, or of one where there is no room for two.

    ``longest`` is the longest label of their vertical axes.
    """
    left, top, width, height = layout.path
    small = layout.small_size
    caption = layout.text_size + 12.0 * layout.scale
    gutter = canvas.text_width(longest, small) + 10.0 + 0.8 * small
    right = left + width - max(10.0, 16.0 * layout.scale)
    bottom = top + height - 2.2 * small
    gap = max(8.0, 14.0 * layout.scale)
    area_top = top + caption + 0.2 * small
    room = bottom - area_top
    across = right - left - gutter
    down = (room - gap) / 2
    if down < LEAST_HEIGHT:
        return ((left + gutter, area_top, across, room),)
    return (
        (left + gutter, area_top, across, down),
        (left + gutter, area_top + down + gap, across, down),
    )


def draw_axes(
    canvas: Canvas, layout: Layout, box: Box, horizontal: Limits, vertical: Limits, label: str, below: str
) -> None:
    """Grid and labels of a plot; ``below`` names its horizontal axis, empty where another plot has it."""
    left, top, width, height = box
    size = layout.small_size
    for value in tick_values(*horizontal):
        column = left + width * (value - horizontal[0]) / (horizontal[1] - horizontal[0])
        canvas.rule(AXIS if value == 0.0 else GRID, (column, top), (column, top + height))
        if below:
            text = tick_label(value, horizontal[2])
            half = canvas.text_width(text, size) / 2
            at = min(column, layout.path[0] + layout.path[2] - half - 5)
            canvas.text(MUTED, text, (at, top + height + 0.7 * size), size)
    step = vertical[2]
    for value in tick_values(*vertical):
        row = top + height * (vertical[1] - value) / (vertical[1] - vertical[0])
        canvas.rule(AXIS if value == 0.0 else GRID, (left, row), (left + width, row))
        canvas.text(MUTED, tick_label(value, step), (left - 5, row), size, align="right")
    canvas.upright_text(MUTED, label, (layout.path[0] + 0.75 * size, top + height / 2), size)
    if below:
        canvas.text(MUTED, below, (left + width / 2, top + height + 1.6 * size), size)
