"""Bars of commanded against delivered: duties and thrust of every thruster, rate change of every axis.

A wide dim bar is what was commanded, the narrow bright one on it is what was delivered; red stands for a
failed thruster, a cross for a closed isolation valve.
"""

from __future__ import annotations

from thruster_envs.rendering.canvas import (
    AXIS,
    COMMANDED,
    COMMANDED_EDGE,
    DELIVERED,
    FAILED,
    FAILED_DARK,
    GRID,
    MUTED,
    PANEL,
    TEXT,
    WELL,
    Canvas,
    Color,
    blend,
)
from thruster_envs.rendering.layout import Layout
from thruster_envs.rendering.path_view import craft_color
from thruster_envs.rendering.scene import CraftScene
from thruster_envs.rendering.ticks import round_step, tick_label, tick_values

WIDEST_BAR = 30.0  # pixels at scale 1
LEAST_PITCH = 5.0  # pixels from bar to bar
LEGEND: tuple[tuple[Color, str], ...] = (
    (COMMANDED, "commanded"),
    (DELIVERED, "delivered"),
    (FAILED, "failed"),
)


def draw_legend(canvas: Canvas, layout: Layout, right: float, row: float, room: float) -> None:
    """Swatches for commanded, delivered and failed, right-aligned, if they fit."""
    size = layout.small_size
    swatch = 0.53 * size
    widths = [canvas.text_width(name, size) + 3.2 * swatch for _, name in LEGEND]
    if sum(widths) > room:
        return
    column = right - sum(widths) + 1.6 * swatch
    for (color, name), width in zip(LEGEND, widths, strict=True):
        canvas.rectangle(color, (column - swatch / 2, row - swatch / 2, swatch, swatch), radius=0.2 * swatch)
        canvas.text(MUTED, name, (column + 1.1 * swatch, row), size, align="left")
        column += width


class DutyBars:
    """Draws the duty of every thruster of every craft into its box of the layout."""

    def __init__(self, canvas: Canvas, layout: Layout) -> None:
        self._canvas = canvas
        self._layout = layout
        left, top, width, height = layout.duties
        size = layout.small_size
        caption = layout.text_size + 14.0 * layout.scale
        self._gutter = canvas.text_width("100 %", size) + 12.0
        self._left = left + self._gutter
        self._right = left + width - max(8.0, 12.0 * layout.scale)
        self._top = top + caption + 2.0
        self._bottom = top + height - 1.35 * size

    def draw(self, crafts: tuple[CraftScene, ...]) -> None:
        """One bar per thruster, numbered from 1, in a group per craft."""
        canvas, size = self._canvas, self._layout.small_size
        height = self._bottom - self._top
        for share in (0.0, 0.5, 1.0):
            row = self._bottom - share * height
            canvas.rule(AXIS if share == 0.0 else GRID, (self._left, row), (self._right, row))
        for share, text in ((0.0, "0"), (1.0, "100 %")):
            canvas.text(MUTED, text, (self._left - 6, self._bottom - share * height), size, align="right")
        gap = 18.0 * self._layout.scale
        shown = len(crafts)
        thrusters = len(crafts[0].duties)
        available = self._right - self._left
        while shown > 1 and (available - gap * (shown - 1)) / (shown * thrusters) < LEAST_PITCH:
            shown -= 1
        pitch = (available - gap * (shown - 1)) / max(1, shown * thrusters)
        for number, craft in enumerate(crafts[:shown]):
            start = self._left + number * (thrusters * pitch + gap)
            if len(crafts) > 1:
                canvas.rectangle(craft_color(number), (start, self._bottom + 1.5, thrusters * pitch, 2.0))
            self._draw_group(craft, start, pitch)

    def _draw_group(self, craft: CraftScene, start: float, pitch: float) -> None:
        canvas, layout = self._canvas, self._layout
        height = self._bottom - self._top
        wide = min(0.72 * pitch, WIDEST_BAR * max(1.0, layout.scale))
        narrow = max(1.0, 0.5 * wide)
        size = layout.small_size
        roomy = canvas.text_width(str(len(craft.duties)), size) + 3 <= pitch
        free_from = start - pitch
        for index, (duty, thrust) in enumerate(
            zip(craft.duties.clip(0, 1), craft.thrust.clip(0, 1), strict=True)
        ):
            failed = bool(craft.faulty[index])
            middle = start + (index + 0.5) * pitch
            canvas.rectangle(
                blend(WELL, FAILED_DARK, 0.35) if failed else WELL,
                (middle - wide / 2, self._top, wide, height),
            )
            commanded, delivered = float(duty) * height, float(thrust) * height
            if commanded > 0.5:
                canvas.rectangle(
                    FAILED_DARK if failed else COMMANDED,
                    (middle - wide / 2, self._bottom - commanded, wide, commanded),
                )
                canvas.rectangle(
                    FAILED if failed else COMMANDED_EDGE,
                    (middle - wide / 2, self._bottom - commanded, wide, 1.5),
                )
            if delivered > 0.5:
                canvas.rectangle(
                    FAILED if failed else DELIVERED,
                    (middle - narrow / 2, self._bottom - delivered, narrow, delivered),
                )
            if craft.shut[index]:
                for low, high in ((self._top, self._bottom), (self._bottom, self._top)):
                    canvas.line(COMMANDED_EDGE, (middle - wide / 2, low), (middle + wide / 2, high))
            text = str(index + 1)
            half = canvas.text_width(text, size) / 2
            row = self._bottom + 0.78 * size
            if failed and middle - half > free_from:
                canvas.rectangle(
                    FAILED, (middle - half - 4, row - 0.42 * size, 2 * half + 8, 0.84 * size), radius=4.0
                )
                canvas.text(PANEL, text, (middle, row), size)
                free_from = middle + half + 6
            elif roomy:
                canvas.text(TEXT if thrust > 0 or duty > 0 else MUTED, text, (middle, row), size)


class RateBars:
    """Draws commanded against delivered rate change per axis into the box of the path."""

    def __init__(self, canvas: Canvas, layout: Layout) -> None:
        self._canvas = canvas
        self._layout = layout

    def draw(self, bars: tuple[tuple[str, float, float], ...]) -> None:
        """One row per axis about a common zero, the numbers beside it."""
        canvas, layout = self._canvas, self._layout
        size, small = layout.text_size, layout.small_size
        left, top, width, height = layout.path
        inset = max(8.0, 14.0 * layout.scale)
        labels = [canvas.fitted(label, size, 0.3 * width) for label, _, _ in bars]
        gutter = max(canvas.text_width(label, size) for label in labels) + inset + 8.0
        number_width = max(canvas.text_width(text, small) for text in ("commanded", "delivered")) + 10.0
        numbers = 2 * number_width if width > 5 * number_width else 0.0
        first, last = left + gutter, left + width - inset - numbers
        caption = layout.text_size + 12.0 * layout.scale
        heading = 1.5 * small if numbers else 0.4 * small
        area_top, area_bottom = top + caption + heading, top + height - 1.7 * small
        largest = max(1.0, *(max(abs(commanded), abs(delivered)) for _, commanded, delivered in bars))
        step = round_step(2.0 * largest, 4.0 if last - first > 200 else 2.0)
        zero, reach = (first + last) / 2, (last - first) / 2 / largest
        for value in tick_values(-largest, largest, step):
            column = zero + reach * value
            canvas.rule(AXIS if value == 0.0 else GRID, (column, area_top), (column, area_bottom))
            canvas.text(MUTED, tick_label(value, step), (column, area_bottom + 0.85 * small), small)
        if numbers:
            for place, text in ((1, "commanded"), (2, "delivered")):
                at = (last + place * number_width, area_top - 0.75 * small)
                canvas.text(MUTED, text, at, small, align="right")
        pitch = (area_bottom - area_top) / len(bars)
        wide = min(0.62 * pitch, 26.0 * layout.scale)
        narrow = max(2.0, 0.46 * wide)
        for number, ((_, commanded, delivered), label) in enumerate(zip(bars, labels, strict=True)):
            row = area_top + (number + 0.5) * pitch
            canvas.text(TEXT, label, (first - 8.0, row), size, align="right")
            canvas.rectangle(WELL, (first, row - wide / 2, last - first, wide), radius=2.0)
            self._bar(COMMANDED, zero, zero + reach * commanded, row, wide)
            if commanded:
                edge = zero + reach * commanded
                canvas.line(COMMANDED_EDGE, (edge, row - wide / 2), (edge, row + wide / 2), width=1.5)
            self._bar(DELIVERED, zero, zero + reach * delivered, row, narrow)
            canvas.rule(AXIS, (zero, row - wide / 2 - 2), (zero, row + wide / 2 + 2))
            if numbers:
                for place, value, color in ((1, commanded, MUTED), (2, delivered, DELIVERED)):
                    at = (last + place * number_width, row)
                    canvas.text(color, tick_label(value, 0.01), at, size, align="right")

    def _bar(self, color: Color, start: float, end: float, row: float, thickness: float) -> None:
        low, high = min(start, end), max(start, end)
        if high - low > 0.25:
            self._canvas.rectangle(color, (low, row - thickness / 2, high - low, thickness))
