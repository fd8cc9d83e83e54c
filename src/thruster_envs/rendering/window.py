"""A window in a process of its own, which shows the pictures that it is sent.

pygame has one display in a process: whoever else quits it takes every window along, a second window takes the
first one's place, and events of one program are read by another. In a process of its own none of that
happens, and a window answers its user while the program thinks.
"""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt

_PROGRAM = Path(__file__).with_name("window_process.py")
_PATIENCE = 5.0
"""Seconds that a window may take to close before it is ended."""


class Window:
    """A window of a fixed size; it closes with :meth:`close`, when forgotten, and when the program ends.

    Arguments:
        width, height: in pixels.
        title: what stands above it; a character that cannot stand there becomes a question mark.

    Raises:
        RuntimeError: if there is no display to open it on.
    """

    def __init__(self, width: int, height: int, title: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(_PROGRAM), str(width), str(height), _plain(title)],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for the program
        )
        self._owner = os.getpid()
        self.close = weakref.finalize(self, _end, self._process, self._owner)
        assert self._process.stdout is not None  # a pipe
        answer = self._process.stdout.readline().decode()
        if answer != "\n":
            self.close()
            raise RuntimeError(
                f"no window can be opened ({answer.strip() or 'its process ended'}); render_mode 'rgb_array' "
                "needs no display"
            )

    @property
    def ours(self) -> bool:
        """Whether this process opened it, and not the one of which this is a fork."""
        return os.getpid() == self._owner

    def show(self, picture: npt.NDArray[np.uint8]) -> bool:
        """Show a picture (height, width, 3); False if the user has closed the window."""
        assert self._process.stdin is not None  # a pipe
        rest = memoryview(picture.tobytes())
        try:
            while rest:
                rest = rest[self._process.stdin.write(rest) :]
        except OSError:  # nobody reads any more
            return False
        return self._process.poll() is None


def _plain(title: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in title)


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    """Close a window, unless it is that of the process of which this is a fork."""
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None  # as it was asked for
        with suppress(OSError):
            pipe.close()
    if os.getpid() != owner:
        process.returncode = 0  # not ours to wait for
        return
    process.terminate()
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
