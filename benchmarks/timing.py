"""How long things take: repetitions in turns, medians, ratios by round.

Time is that of the wall clock, which is what a user waits for. The processor time of the calling thread is kept
beside it: on one thread the two are equal on a quiet machine, and :func:`share_of_core` says how quiet it was.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """How much trouble to take.

    Attributes:
        repetitions: Of every figure.
        seconds: That one repetition should last at least.
        quick: Whether this only shows that everything runs.
    """

    repetitions: int = 7
    seconds: float = 0.4
    quick: bool = False


QUICK = Effort(repetitions=2, seconds=0.001, quick=True)


@dataclass(frozen=True)
class Timing:
    """Repetitions of one piece of work.

    Attributes:
        wall: Seconds per call in each round.
        processor: Processor seconds of the calling thread per call in each round.
    """

    wall: tuple[float, ...]
    processor: tuple[float, ...]

    @property
    def seconds(self) -> float:
        """Median time of one call, s."""
        return statistics.median(self.wall)

    def per_second(self, amount: float) -> float:
        """How much is done in a second if one call does ``amount``."""
        return amount / self.seconds

    def times_faster_than(self, other: Timing, own: float = 1.0, others: float = 1.0) -> float:
        """Median over the rounds of own speed over the other's, where a call does ``own`` and ``others``."""
        pairs = zip(self.wall, other.wall, strict=True)
        return statistics.median(own * theirs / (others * mine) for mine, theirs in pairs)


_shares: list[float] = []


def share_of_core() -> float | None:
    """Median share of a core that the single-threaded repetitions so far had; None before the first one."""
    return statistics.median(_shares) if _shares else None


def race(
    works: Mapping[str, Callable[[], object]], effort: Effort, *, threaded: bool = False
) -> dict[str, Timing]:
    """Time several pieces of work in turns, one repetition of each after the other.

    Args:
        works: Name to a function without arguments.
        effort: Repetitions, and how long each one lasts: a short work is called many times in it.
        threaded: Whether any of it works in other threads or processes.

    Returns:
        Name to timing.
    """
    calls = {name: _calls_for(work, effort.seconds) for name, work in works.items()}
    wall: dict[str, list[float]] = {name: [] for name in works}
    processor: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(effort.repetitions):
        for name, work in works.items():
            wall_start, processor_start = time.perf_counter(), time.thread_time()
            for _ in range(calls[name]):
                work()
            processor[name].append((time.thread_time() - processor_start) / calls[name])
            wall[name].append((time.perf_counter() - wall_start) / calls[name])
            if not threaded:
                _shares.append(processor[name][-1] / wall[name][-1])
    return {name: Timing(tuple(wall[name]), tuple(processor[name])) for name in works}


def _calls_for(work: Callable[[], object], seconds: float) -> int:
    """How many calls last that long; the first call, which may compile something, does not count."""
    work()
    calls = 1
    while True:
        start = time.perf_counter()
        for _ in range(calls):
            work()
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            return calls
        calls = (
            max(2 * calls, int(1.1 * calls * seconds / max(elapsed, 1e-9)))
            if elapsed < 0.5 * seconds
            else calls + 1
        )
        calls = min(calls, 1_000_000)
