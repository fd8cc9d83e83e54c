"""The renderer: scenes in, arrays of pixels or a window out.

Models: nothing; it draws what a :class:`~thruster_envs.rendering.scene.Scene` holds. ``frame`` draws in
memory and needs neither a display nor a video driver; only ``show`` opens a window. pygame-ce (the extra
``render``) is imported when a renderer is made.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from thruster_envs.extras import extra
from thruster_envs.rendering.layout import SMALLEST
from thruster_envs.rendering.scene import Scene

if TYPE_CHECKING:
    import pygame

    from thruster_envs.rendering.picture import Picture


class Renderer:
    """Draws scenes at one size.

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
        self._window: pygame.Surface | None = None
        self._clock: pygame.time.Clock | None = None
        self._window_closed = False

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
        """
        import pygame

        if self._window_closed:
            return False
        if self._window is None:
            pygame.display.init()
            pygame.display.set_caption(scene.title)
            self._window = pygame.display.set_mode((self.width, self.height))
            self._clock = pygame.time.Clock()
        self._window.blit(self._picture.draw(scene), (0, 0))
        pygame.display.flip()
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
            self._window_closed = True
            return False
        if self._clock is not None:
            self._clock.tick(self._frames_per_second)
        return True

    def close(self) -> None:
        """Close the window, if there is one. Frames can still be drawn."""
        if self._window is not None:
            import pygame

            pygame.display.quit()
            self._window = None
            self._clock = None


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
