"""Where things stand in a picture: boxes as (left, top, width, height) in pixels, and text sizes."""

from __future__ import annotations

from dataclasses import dataclass

Box = tuple[float, float, float, float]

SMALLEST = (320, 240)
DESIGN = (960, 540)  # the size that the margins below are for


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The boxes of a picture."""

    scale: float
    """Size of margins and lines, 1 at 960 x 540."""
    header: Box
    craft: Box
    path: Box
    duties: Box
    title_size: int
    """Text sizes in pixels."""
    value_size: int
    text_size: int
    small_size: int


def arrange(width: int, height: int) -> Layout:
    """Place header, craft, path and duty bars; craft and path one above the other if the picture is upright.

    >>> arrange(960, 540).header
    (12.0, 10.0, 936.0, 44.0)
    """
    scale = max(0.5, min(width / DESIGN[0], height / DESIGN[1]))
    upright = height > 1.15 * width
    if upright:
        scale = max(0.5, min(width / 600.0, height / 900.0))
    margin = 12.0 * scale
    gap = 10.0 * scale
    text_size = max(14, round(17 * scale))
    header_height = max(26.0, 44.0 * scale)
    header = (margin, gap, width - 2 * margin, header_height)
    duties_height = max(62.0, min(118.0 * scale, 0.24 * height))
    duties = (margin, height - margin - duties_height, width - 2 * margin, duties_height)
    top = header[1] + header_height + 0.6 * gap
    main_height = duties[1] - gap - top
    main_width = width - 2 * margin
    if upright:
        craft_height = (main_height - gap) * 0.52
        craft = (margin, top, main_width, craft_height)
        path = (margin, top + craft_height + gap, main_width, main_height - craft_height - gap)
    else:
        craft_width = (main_width - gap) * 0.46
        craft = (margin, top, craft_width, main_height)
        path = (margin + craft_width + gap, top, main_width - craft_width - gap, main_height)
    return Layout(
        scale=scale,
        header=header,
        craft=craft,
        path=path,
        duties=duties,
        title_size=max(20, round(27 * scale)),
        value_size=max(17, round(21 * scale)),
        text_size=text_size,
        small_size=max(13, round(15 * scale)),
    )
