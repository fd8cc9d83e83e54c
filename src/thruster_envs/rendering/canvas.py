"""A drawing surface in pixels of the finished picture, antialiased by drawing larger and scaling down.

Shapes are drawn at ``factor`` times the size on a software surface; text is set afterwards, in the font that
pygame carries. Neither needs a display. This module imports pygame: nothing outside this package may import
it, and :mod:`thruster_envs.rendering.renderer` only late.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt
import pygame

Color = tuple[int, int, int]
Point = Sequence[float] | npt.NDArray[np.float64]
Points = Sequence[Point] | npt.NDArray[np.float64]
Key = TypeVar("Key")
Value = TypeVar("Value")
Align = Literal["left", "centre", "right"]

BACKGROUND: Color = (8, 11, 19)
PANEL: Color = (14, 19, 31)
PANEL_EDGE: Color = (31, 40, 60)
WELL: Color = (22, 29, 45)
GRID: Color = (29, 37, 56)
AXIS: Color = (58, 70, 98)
TEXT: Color = (229, 235, 245)
MUTED: Color = (132, 146, 172)
COMMANDED: Color = (87, 102, 137)
COMMANDED_EDGE: Color = (150, 164, 194)
DELIVERED: Color = (84, 196, 245)
FAILED: Color = (255, 82, 96)
FAILED_DARK: Color = (92, 27, 39)
TARGET: Color = (255, 209, 102)
CRAFT: tuple[Color, ...] = (
    (84, 196, 245),
    (255, 171, 74),
    (178, 140, 255),
    (98, 214, 146),
    (255, 138, 198),
    (52, 211, 194),
    (196, 222, 96),
    (120, 148, 255),
)

KEPT_TEXTS = 512
TEXT_FACTOR = 4


def blend(first: Color, second: Color, share: float) -> Color:
    """The colour ``share`` of the way from the first to the second.

    >>> blend((0, 0, 0), (200, 100, 50), 0.5)
    (100, 50, 25)
    """
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(first, second, strict=True))
    return red, green, blue


class Canvas:
    """Draws shapes and text; :meth:`finish` gives the surface.

    Coordinates are pixels of the finished picture; line widths are multiples of ``stroke`` of them.
    """

    def __init__(self, width: int, height: int, *, stroke: float = 1.0) -> None:
        # Above some 2.5 million pixels the picture is fine enough without, and the memory is not worth it.
        self.factor = 2 if width * height <= 2_500_000 else 1
        self.width = width
        self.height = height
        self.stroke = stroke * self.factor
        self.surface = pygame.Surface((width * self.factor, height * self.factor), depth=32)
        self.scratch = pygame.Surface(self.surface.get_size(), depth=32)
        self._finished = pygame.Surface((width, height), depth=32)
        self._texts: list[tuple[pygame.Surface, tuple[int, int]]] = []
        self._fonts: dict[int, pygame.font.Font] = {}
        self._widths: dict[tuple[str, int], int] = {}
        self._rendered: dict[tuple[str, int, Color], pygame.Surface] = {}

    # Shapes.

    def scaled(self, points: Points) -> list[list[float]]:
        """``points`` in pixels of the surface, as pygame wants them."""
        values: list[list[float]] = (np.asarray(points, dtype=np.float64) * self.factor).tolist()
        return values

    def rectangle(
        self, color: Color, box: tuple[float, float, float, float], *, radius: float = 0.0, width: float = 0.0
    ) -> None:
        """A box (left, top, width, height), filled unless it has a line width."""
        left, top, across, down = box
        corners = [round(value * self.factor) for value in (left, top, left + across, top + down)]
        area = pygame.Rect(corners[0], corners[1], corners[2] - corners[0], corners[3] - corners[1])
        line = max(1, round(width * self.stroke)) if width else 0
        pygame.draw.rect(self.surface, color, area, line, border_radius=round(radius * self.factor))

    def frame(self, color: Color, box: tuple[float, float, float, float], *, radius: float) -> None:
        """The edge of a panel with round corners; what stood in the corners outside it is covered."""
        left, top, across, down = (round(value) for value in box)
        reach = math.ceil(radius)
        for column in (left, left + across - reach):
            for row in (top, top + down - reach):
                corner = pygame.Rect(*(value * self.factor for value in (column, row, reach, reach)))
                self.surface.set_clip(corner)
                thick = radius * self.factor
                middle = (
                    (column + reach if column == left else column) * self.factor,
                    (row + reach if row == top else row) * self.factor,
                )
                pygame.draw.circle(self.surface, BACKGROUND, middle, thick * 1.6, round(thick * 0.6))
        self.surface.set_clip(None)
        self.rectangle(color, box, radius=radius, width=1.0)

    def circle(self, color: Color, centre: Point, radius: float, *, width: float = 0.0) -> None:
        """A disc, or a ring if it has a line width."""
        line = max(1, round(width * self.stroke)) if width else 0
        middle = (centre[0] * self.factor, centre[1] * self.factor)
        pygame.draw.circle(self.surface, color, middle, max(1.0, radius * self.factor), line)

    def line(self, color: Color, start: Point, end: Point, *, width: float = 1.0) -> None:
        """A straight line, antialiased on top of the scaling."""
        factor = self.factor
        first, second = (start[0] * factor, start[1] * factor), (end[0] * factor, end[1] * factor)
        pygame.draw.aaline(self.surface, color, first, second, max(1, round(width * self.stroke)))

    def rule(self, color: Color, start: tuple[float, float], end: tuple[float, float]) -> None:
        """A line along or across, one pixel thick, on whole pixels."""
        left, top = round(min(start[0], end[0])), round(min(start[1], end[1]))
        across, down = round(abs(end[0] - start[0])) or 1, round(abs(end[1] - start[1])) or 1
        self.surface.fill(color, [value * self.factor for value in (left, top, across, down)])

    def lines(self, color: Color, points: Points, *, width: float = 1.0) -> None:
        """A line through at least two points."""
        if len(points) >= 2:
            pygame.draw.lines(
                self.surface, color, False, self.scaled(points), max(1, round(width * self.stroke))
            )

    def polygon(self, color: Color, points: Points) -> None:
        """A filled polygon."""
        pygame.draw.polygon(self.surface, color, self.scaled(points))

    def clip(self, box: tuple[float, float, float, float] | None) -> None:
        """Keep what follows inside a box, or end that."""
        self.surface.set_clip(
            None if box is None else pygame.Rect(*(round(value * self.factor) for value in box))
        )

    # Text.

    def text_width(self, text: str, size: int) -> int:
        """Width of ``text`` in pixels."""
        width = self._widths.get((text, size))
        if width is None:
            width = round(self._font(size).size(_printable(text))[0] / TEXT_FACTOR)
            _keep(self._widths, (text, size), width)
        return width

    def line_height(self, size: int) -> int:
        """Height of a line of text in pixels."""
        return round(self._font(size).get_height() / TEXT_FACTOR)

    def fitted(self, text: str, size: int, width: float) -> str:
        """``text``, cut short with an ellipsis if wider than ``width``; empty if not even that fits."""
        if self.text_width(text, size) <= width:
            return text
        for length in range(len(text) - 1, 0, -1):
            shortened = text[:length].rstrip() + "…"
            if self.text_width(shortened, size) <= width:
                return shortened
        return ""

    def text(self, color: Color, text: str, at: Point, size: int, *, align: Align = "centre") -> None:
        """A line of text whose capitals are centred in height on ``at``; it comes to lie above all shapes."""
        if not text:
            return
        capitals = 0.5 * size  # their height, as a share of the size that pygame's font is asked for
        base_line = self._font(size).get_ascent() / TEXT_FACTOR
        rendered = self._render(_printable(text), size, color)
        shift = {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * rendered.get_width()
        self._texts.append((rendered, (round(at[0] - shift), round(at[1] + capitals / 2 - base_line))))

    def upright_text(self, color: Color, text: str, at: Point, size: int) -> None:
        """A line of text that reads upwards, centred on ``at``."""
        rendered = pygame.transform.rotate(self._render(_printable(text), size, color), 90.0)
        self._texts.append(
            (rendered, (round(at[0] - rendered.get_width() / 2), round(at[1] - rendered.get_height() / 2)))
        )

    # The picture.

    def start(self, background: pygame.Surface | None) -> None:
        """Begin a picture on ``background`` (as :meth:`shapes` gave it) or on nothing."""
        self._texts.clear()
        if background is None:
            self.surface.fill(BACKGROUND)
        else:
            self.surface.blit(background, (0, 0))

    def shapes(self) -> pygame.Surface:
        """A copy of the shapes drawn so far."""
        return self.surface.copy()

    def finish(self) -> pygame.Surface:
        """The picture, at its size, text included; overwritten by the next one."""
        if self.factor == 1:
            self._finished.blit(self.surface, (0, 0))
        else:
            pygame.transform.smoothscale(self.surface, (self.width, self.height), self._finished)
        self._finished.blits(self._texts, False)
        return self._finished

    def _font(self, size: int) -> pygame.font.Font:
        font = self._fonts.get(size)
        if font is None or not _lives(font):
            pygame.font.init()
            font = self._fonts[size] = pygame.font.Font(None, size * TEXT_FACTOR)
        return font

    def _render(self, text: str, size: int, color: Color) -> pygame.Surface:
        key = (text, size, color)
        rendered = self._rendered.get(key)
        if rendered is None:
            # Scaled down like the shapes: at its own size the letters would stand unevenly, on whole pixels.
            large = self._font(size).render(text, True, color)
            rendered = pygame.transform.smoothscale(
                large, (self.text_width(text, size), self.line_height(size))
            )
            _keep(self._rendered, key, rendered)
        return rendered


def _keep(kept: dict[Key, Value], key: Key, value: Value) -> None:
    """Remember a value; the oldest is forgotten when there are many."""
    kept[key] = value
    if len(kept) > KEPT_TEXTS:
        del kept[next(iter(kept))]


def _lives(font: pygame.font.Font) -> bool:
    """Whether nobody has quit pygame, or its fonts, since the font was made."""
    try:
        font.get_height()
    except pygame.error:
        return False
    return True


def _printable(text: str) -> str:
    """Without the control characters, which a font cannot set."""
    return "".join(character if character.isprintable() else " " for character in text)
