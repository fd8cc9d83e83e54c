"""Work in shares, in as many threads as can be had.

Kernels release the interpreter lock, so threads pay where a share takes longer than handing it over. A forked
process starts threads of its own at its first call, since those of its parent do not exist in it; and a fork
waits for what another thread is compiling, since the child could never compile anything otherwise.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path

from numba.core.compiler_lock import global_compiler_lock


def run_shared(work: Callable[[int, int], object], shares: Sequence[tuple[int, int]]) -> None:
    """Call ``work(first, last)`` once for every share, in at most as many threads as there are shares.

    This thread works too and takes each share that no other has begun, so that nothing waits for a thread
    that is busy elsewhere or cannot be started (a limit on threads, an interpreter about to exit). What
    ``work`` raises is raised here, after all threads have stopped working.
    """
    left = deque(shares)

    def take() -> None:
        while True:
            try:
                share = left.popleft()
            except IndexError:
                return
            work(*share)

    helpers: list[Future[None]] = []
    with suppress(RuntimeError):  # no thread can be started; whoever was submitted comes to nothing
        for _ in shares[1:]:
            helpers.append(_pool(len(shares) - 1).submit(take))
    try:
        take()
    finally:
        for helper in helpers:
            if not helper.cancel():
                helper.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="thruster_envs")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )


@cache
def physical_cores() -> int:
    """Cores that this process may run on, each counted once however many threads of hardware it has.

    Where the system does not say, every processor counts as a core.
    """
    processors = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    return len({_core(processor) for processor in processors})


def _core(processor: int) -> str:
    """What names the core of a processor: the list of those that share it, or its own number."""
    siblings = Path(f"/sys/devices/system/cpu/cpu{processor}/topology/thread_siblings_list")
    try:
        return siblings.read_text(encoding="ascii").strip() or str(processor)
    except OSError:
        return str(processor)
