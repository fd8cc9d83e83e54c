"""The renderer: scenes in, arrays of pixels or a window out.

Models: nothing; it draws what a :class:`~thruster_envs.rendering.scene.Scene` holds. ``frame`` draws in
memory and needs neither a display nor a video driver; only ``show`` opens a window, in a process of its own.
What others do with pygame in this process, quitting it included, changes neither. pygame-ce (the extra
``render``) is imported when a renderer is made.
"""

from __future__ import annotations

import os
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from thruster_envs.extras import extra
from thruster_envs.rendering.layout import SMALLEST
from thruster_envs.rendering.scene import Scene
from thruster_envs.rendering.window import Window

if TYPE_CHECKING:
    from thruster_envs.rendering.picture import Picture


class Renderer:
    """Draws scenes at one size.

    A copy, by ``copy`` or ``pickle``, has no window until it shows something.

    Arguments:
        width, height: size of the picture in pixels, at least 320 x 240.
        frames_per_second: the pace that ``show`` keeps; ``frame`` never waits.

    Raises:
        ImportError: if pygame-ce is not installed.
        ValueError: if the picture is too small.
    """

    def __init__(self, width: int = 960, height: int = 540, *, frames_per_second: float = 30.0) -> None:
        if width < SMALLEST[0] or height < SMALLEST[1]:
            raise ValueError(
                f"a picture of {width} x {height} pixels is too small, it needs {SMALLEST[0]} x {SMALLEST[1]}"
            )
        self.width = width
        self.height = height
        self._frames_per_second = frames_per_second
        self._picture: Picture = _picture(width, height)
        self._window: Window | None = None
        self._window_closed = False
        self._next_frame = 0.0  # s, of time.perf_counter

    def __reduce__(self) -> tuple[Any, ...]:
        """Pictures in the making and windows stay where they are."""
        make = partial(Renderer, self.width, self.height, frames_per_second=self._frames_per_second)
        return make, ()

    def frame(self, scene: Scene) -> npt.NDArray[np.uint8]:
        """(height, width, 3) red, green and blue of ``scene``, 0..255; an array of its own for every call."""
        import pygame.surfarray

        pixels = pygame.surfarray.pixels3d(self._picture.draw(scene))  # (width, height, 3), a view
        frame = np.empty((self.height, self.width, 3), dtype=np.uint8)
        for channel in range(3):  # several times faster than to copy the transposed array at once
            frame[..., channel] = pixels[..., channel].T
        return frame

    def show(self, scene: Scene) -> bool:
        """Show ``scene`` in a window, opened by the first call and kept in pace with ``frames_per_second``.

        Returns:
            Whether the window is open: ``False`` once the user has closed it; nothing more is drawn then.

        Raises:
            RuntimeError: if there is no display to open it on.
        """
        if self._window_closed:
            return False
        if self._window is None or not self._window.ours:
            self._window = Window(self.width, self.height, scene.title)
        if not self._window.show(self.frame(scene)):
            self.close()
            self._window_closed = True
            return False
        now = time.perf_counter()
        time.sleep(max(0.0, self._next_frame - now))
        self._next_frame = max(now, self._next_frame) + 1.0 / self._frames_per_second
        return True

    def close(self) -> None:
        """Close the window, if there is one. Frames can still be drawn."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _picture(width: int, height: int) -> Picture:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    with extra("render", "rendering"):
        import pygame
    if not getattr(pygame, "IS_CE", False):
        raise ImportError(
            f"rendering needs pygame-ce, but pygame {pygame.version.ver} is installed: "
            'pip uninstall pygame, then pip install "thruster-envs[render]"'
        )
    from thruster_envs.rendering.picture import Picture

    return Picture(width, height)
