"""One line to the user when a kernel is compiled on a machine, since that takes some seconds."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

from numba.core import event


class _Announcer(event.Listener):
    """Says once per process that compilation has begun."""

    said = False

    def on_start(self, event: Any) -> None:
        dispatcher = event.data["dispatcher"]
        if not self.said and dispatcher.py_func.__module__.startswith("thruster_"):
            self.said = True
            sys.stderr.write(
                "thruster-envs: compiling its kernels for this machine (some seconds, once; "
                "later runs load them)\n"
            )
            sys.stderr.flush()

    def on_end(self, event: Any) -> None:
        """Nothing to say."""


@cache
def announce_compilation() -> None:
    """Listen for compilations of this project's kernels from now on; calling it again does nothing."""
    event.register("numba:compile", _Announcer())
