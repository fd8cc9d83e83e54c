"""How long things take: repetitions in turns, medians, ratios by round.

Time is that of the wall clock, which is what a user waits for. The processor time of the calling thread
is kept beside it: on one thread the two are equal on a quiet machine, and :func:`share_of_core` says how
quiet it was. On a machine that others use, work on one thread can be timed by the processor's clock.

What takes microseconds and varies from call to call is timed call by call (:func:`race_calls`), always by
the wall's clock: asking the processor's takes longer than the call. :func:`clock_cost` is in every one of
these figures; other programs show in the slowest calls only.
"""

from __future__ import annotations

import dataclasses
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Effort:
    """How much trouble to take.

    Attributes:
        repetitions: Of every figure.
        seconds: That one repetition should last at least.
        quick: Whether this only shows that everything runs.
        processor_time: Whether work on one thread is timed by the processor's clock, not by the wall's.
    """

    repetitions: int = 7
    seconds: float = 0.4
    quick: bool = False
    processor_time: bool = False

    def brief(self) -> Effort:
        """The same with short repetitions, for works of which there are many and that take milliseconds."""
        return dataclasses.replace(self, seconds=min(self.seconds, BRIEF))


BRIEF = 0.06
"""Seconds that a repetition lasts in :meth:`Effort.brief`."""

QUICK = Effort(repetitions=2, seconds=0.001, quick=True)


@dataclass(frozen=True)
class Timing:
    """Repetitions of one piece of work.

    Attributes:
        rounds: Seconds per call in each round.
    """

    rounds: tuple[float, ...]

    @property
    def seconds(self) -> float:
        """Median time of one call, s."""
        return statistics.median(self.rounds)

    def per_second(self, amount: float) -> float:
        """How much is done in a second if one call does ``amount``."""
        return amount / self.seconds

    def times_faster_than(self, other: Timing, own: float = 1.0, others: float = 1.0) -> float:
        """Median over the rounds of own speed over the other's, where a call does ``own`` and ``others``."""
        pairs = zip(self.rounds, other.rounds, strict=True)
        return statistics.median(own * theirs / (others * mine) for mine, theirs in pairs)


@dataclass(frozen=True)
class Calls:
    """Repetitions of a row of calls, each call timed by itself.

    Attributes:
        rounds: (repetitions, calls), s.
    """

    rounds: NDArray[np.float64]

    @property
    def median(self) -> float:
        """Of a call, s: the median over the rounds of the median of each."""
        return self.percentile(50.0)

    def percentile(self, share: float) -> float:
        """What ``share`` per cent of the calls stay below, s: the median over the rounds."""
        return float(np.median(np.percentile(self.rounds, share, axis=1)))

    def times_faster_than(self, other: Calls) -> float:
        """Median over the rounds of the other's median over this one's."""
        return float(np.median(np.median(other.rounds, axis=1) / np.median(self.rounds, axis=1)))


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
    announce(", ".join(works), effort)
    calls = {name: _calls_for(work, effort.seconds) for name, work in works.items()}
    rounds: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(effort.repetitions):
        for name, work in works.items():
            wall_start, processor_start = time.perf_counter(), time.thread_time()
            for _ in range(calls[name]):
                work()
            processor, wall = time.thread_time() - processor_start, time.perf_counter() - wall_start
            if not threaded:
                _shares.append(processor / wall)
            by_processor = effort.processor_time and not threaded
            rounds[name].append((processor if by_processor else wall) / calls[name])
    return {name: Timing(tuple(times)) for name, times in rounds.items()}


Work: TypeAlias = tuple[Callable[..., object], Sequence[tuple[Any, ...]]]
"""A function, and the arguments of one call after the other."""

WARM_UP = 8
"""Calls before the first that counts, at most; of few calls, a sixteenth."""


def race_calls(
    works: Mapping[str, Work], effort: Effort, *, repetitions: int | None = None
) -> dict[str, Calls]:
    """Time every call of several functions by itself, in turns: all calls of one, then all of the next.

    Args:
        works: Name to a function and the arguments of its calls.
        effort: Repetitions.
        repetitions: In place of those of the effort, for calls that are slow or many.
    """
    announce(", ".join(works), effort)
    for function, calls in works.values():
        for arguments in calls[: min(WARM_UP, 1 + len(calls) // 16)]:
            function(*arguments)
    rounds: dict[str, list[NDArray[np.float64]]] = {name: [] for name in works}
    for _ in range(min(repetitions or effort.repetitions, effort.repetitions)):
        for name, (function, calls) in works.items():
            rounds[name].append(_each(function, calls))
    return {name: Calls(np.array(times)) for name, times in rounds.items()}


def clock_cost() -> float:
    """How much of a call's time is the clock's own, s: the median of 10,000 calls of nothing."""
    read = time.perf_counter_ns
    return 1e-9 * statistics.median(-(read() - read()) for _ in range(10_000))


def _each(function: Callable[..., object], calls: Sequence[tuple[Any, ...]]) -> NDArray[np.float64]:
    """Seconds that each call takes."""
    taken = np.empty(len(calls), np.int64)
    read = time.perf_counter_ns
    for k, arguments in enumerate(calls):
        start = read()
        function(*arguments)
        taken[k] = read() - start
    return taken / 1e9


def announce(what: str, effort: Effort) -> None:
    """Say on the terminal what is being measured now."""
    if not effort.quick:
        print(f"  {what}", file=sys.stderr, flush=True)


def _calls_for(work: Callable[[], object], seconds: float) -> int:
    """How many calls last that long; the first call, which may compile something, does not count."""
    work()
    calls = 1
    while True:
        start = time.perf_counter()
        for _ in range(calls):
            work()
        elapsed = time.perf_counter() - start
        if elapsed >= 0.7 * seconds:
            return calls
        calls = max(2 * calls, int(0.8 * calls * seconds / max(elapsed, 1e-9)))
