"""How long single calls take, on what processor. Speed beside peers is for the benchmarks to say."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from thruster_envs.protocols import FloatArray

__all__ = ["call_times", "processor"]


def call_times(function: Callable[[Any], object], arguments: Iterable[Any]) -> FloatArray:
    """Seconds of a call with each argument, after one call that is not timed and may compile."""
    taken = []
    for number, argument in enumerate(arguments):
        if number == 0:
            function(argument)
        start = time.perf_counter()
        function(argument)
        taken.append(time.perf_counter() - start)
    return np.array(taken)


def processor() -> str:
    """Its name, where the system tells it."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text(encoding="utf-8").splitlines() if facts.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown processor"
