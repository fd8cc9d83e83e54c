"""The whole picture: header, craft, path or rate change or curves, duty bars.

This module imports pygame: only :mod:`thruster_envs.rendering.renderer` may import it, and late.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pygame

from thruster_envs.rendering.bars_view import DutyBars, RateBars, draw_legend
from thruster_envs.rendering.canvas import FAILED, MUTED, PANEL, PANEL_EDGE, TEXT, Canvas
from thruster_envs.rendering.craft_view import CraftView
from thruster_envs.rendering.curves_view import CurvesView
from thruster_envs.rendering.layout import Box, arrange
from thruster_envs.rendering.model import build_model
from thruster_envs.rendering.path_view import PathView
from thruster_envs.rendering.scene import Scene

if TYPE_CHECKING:
    from thruster_envs.spacecraft import Spacecraft


class Picture:
    """Draws scenes at one size; keeps what does not change from one to the next."""

    def __init__(self, width: int, height: int) -> None:
        self._layout = arrange(width, height)
        self._canvas = Canvas(width, height, stroke=max(1.0, self._layout.scale))
        self._path_view = PathView(self._canvas, self._layout)
        self._rate_bars = RateBars(self._canvas, self._layout)
        self._curves_view = CurvesView(self._canvas, self._layout)
        self._duty_bars = DutyBars(self._canvas, self._layout)
        self._backgrounds: dict[bool, pygame.Surface] = {}
        self._spacecraft: Spacecraft | None = None
        self._craft_view: CraftView | None = None

    def draw(self, scene: Scene) -> pygame.Surface:
        """The picture of ``scene``; the surface is overwritten by the next call."""
        layout, canvas = self._layout, self._canvas
        craft_view = self._view_of(scene.spacecraft)
        shows_path = not (scene.bars or scene.curves)
        canvas.start(self._background(craft_view, path=shows_path))
        self._draw_header(scene)
        first = scene.craft[0]
        alarms = (("failed", first.faulty), ("shut", first.shut))
        self._caption(
            layout.craft,
            first.name or scene.spacecraft.name,
            "; ".join(
                f"{what}: {', '.join(str(index + 1) for index in np.flatnonzero(which))}"
                for what, which in alarms
                if which.any()
            ),
        )
        craft_view.draw(first)
        if scene.bars:
            self._caption(layout.path, "rate change, share of authority")
            self._rate_bars.draw(scene.bars)
        elif scene.curves:
            self._curves_view.draw_legend(*self._caption(layout.path, scene.curves_name))
            self._curves_view.draw(scene.curves)
        else:
            right, row, room = self._caption(layout.path, "path")
            self._path_view.draw_legend(scene.craft, scene.corridor, right, row, room)
            self._path_view.draw(scene.craft, scene.corridor)
        right, row, room = self._caption(layout.duties, "duty in this period")
        draw_legend(canvas, layout, right, row, room)
        self._duty_bars.draw(scene.craft)
        return canvas.finish()

    def _background(self, craft_view: CraftView, *, path: bool) -> pygame.Surface:
        background = self._backgrounds.get(path)
        if background is None:
            layout, canvas = self._layout, self._canvas
            canvas.start(None)
            for box in (layout.craft, layout.path, layout.duties):
                canvas.rectangle(PANEL, box, radius=8.0 * layout.scale)
            craft_view.draw_static()
            for box in (layout.craft, layout.path, layout.duties):
                canvas.frame(PANEL_EDGE, box, radius=8.0 * layout.scale)
            if path:
                self._path_view.draw_static()
            background = self._backgrounds[path] = canvas.shapes()
        return background

    def _view_of(self, spacecraft: Spacecraft) -> CraftView:
        if self._craft_view is None or self._spacecraft is not spacecraft:
            self._craft_view = CraftView(self._canvas, build_model(spacecraft), self._layout)
            self._spacecraft = spacecraft
            self._backgrounds.clear()  # they show its planet
        return self._craft_view

    def _draw_header(self, scene: Scene) -> None:
        layout, canvas = self._layout, self._canvas
        left, top, width, height = layout.header
        period = float(scene.spacecraft.control_period)
        decimals = next((k for k in range(2) if (10**k * period).is_integer()), 2)
        time = f"{scene.time:.{decimals}f} s"
        label_size, value_size = layout.small_size, layout.value_size
        label_row, value_row = top + 0.26 * height, top + 0.70 * height
        gap = 20.0 * max(0.7, layout.scale)
        title_width = min(canvas.text_width(scene.title, layout.title_size), 0.45 * width)
        right = left + width
        columns = []
        room = width - title_width - gap
        for label, value in (("time", time), *scene.readouts):
            across = max(canvas.text_width(label, label_size), canvas.text_width(value, value_size)) + gap
            if across > room:
                break
            columns.append((label, value, across))
            room -= across
        for label, value, across in reversed(columns):
            canvas.text(MUTED, label, (right, label_row), label_size, align="right")
            canvas.text(TEXT, value, (right, value_row), value_size, align="right")
            right -= across
        title = canvas.fitted(scene.title, layout.title_size, right - left)
        canvas.text(TEXT, title, (left + 2, top + 0.5 * height), layout.title_size, align="left")

    def _caption(self, box: Box, text: str, alarm: str = "") -> tuple[float, float, float]:
        """Head a panel; gives where the rest of its line ends, its height, and how much room it has."""
        layout, canvas = self._layout, self._canvas
        left, top, width, _ = box
        inset = max(8.0, 12.0 * layout.scale)
        row = top + 7.0 * layout.scale + 0.5 * layout.text_size
        right = left + width - inset
        if alarm:
            alarm = canvas.fitted(alarm, layout.text_size, 0.6 * width)
            canvas.text(FAILED, alarm, (right, row), layout.text_size, align="right")
            right -= canvas.text_width(alarm, layout.text_size) + inset
        text = canvas.fitted(text, layout.text_size, right - left - inset)
        canvas.text(MUTED, text, (left + inset, row), layout.text_size, align="left")
        return right, row, right - left - 2 * inset - canvas.text_width(text, layout.text_size)
