"""Running reproductions one after the other or side by side, and writing each as soon as it is there."""

from __future__ import annotations

import multiprocessing
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path

from reproductions.record import Effort, Reproduction
from reproductions.registry import fingerprint
from reproductions.results import Entry, entry_of, merge, read

__all__ = ["is_current", "run"]


def is_current(reproduction: Reproduction, effort: Effort, entry: Entry) -> bool:
    """Whether an entry is of these settings and of the code as it is."""
    return bool(entry["fingerprint"] == fingerprint(reproduction, effort))


def run(
    wanted: list[Reproduction], effort: Effort, folder: Path | None, resume: bool = False, processes: int = 1
) -> int:
    """Run reproductions; each is written as soon as it is finished.

    Args:
        wanted: Those to run.
        effort: What each may cost.
        folder: Of the results; None to write nothing.
        resume: Leave out those whose entries are current.
        processes: How many run at the same time; those that time something run alone, after the others.

    Returns:
        0, or 1 if one broke off with an error, or 130 if the user stopped the run.
    """
    recorded = read(folder) if resume and folder is not None else {}
    todo = [one for one in wanted if one.id not in recorded or not is_current(one, effort, recorded[one.id])]
    if len(todo) < len(wanted):
        print(f"{len(wanted) - len(todo)} of {len(wanted)} are recorded already")
    start, failures = time.perf_counter(), 0
    try:
        for number, (one, entry) in enumerate(_finished(todo, effort, folder, processes), start=1):
            where = f"[{number}/{len(todo)}, {time.perf_counter() - start:.0f} s] {one.id} {one.title}"
            if isinstance(entry, str):
                failures += 1
                print(f"{where}: broke off\n{entry}", flush=True)
                continue
            if folder is not None:
                merge([entry], folder)
            print(f"{where}: {entry['verdict']}\n    {entry['ours']}", flush=True)
            if entry["reason"]:
                print(f"    {entry['reason']}", flush=True)
    except KeyboardInterrupt:
        print("Stopped; what was finished is written, and --resume goes on from there.")
        return 130
    if folder is not None:
        merge([], folder)
        print(f"Written: {folder / 'reproductions.md'}")
    return 1 if failures else 0


def _finished(
    todo: list[Reproduction], effort: Effort, folder: Path | None, processes: int
) -> Iterator[tuple[Reproduction, Entry | str]]:
    """Each reproduction with its entry, or with the text of its error, in the order in which they finish."""
    together = [one for one in todo if not one.alone] if processes > 1 else []
    if together:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, context) as pool:
            futures: dict[Future[Entry | str], Reproduction] = {
                pool.submit(_entry_or_error, one, effort, folder): one for one in together
            }
            try:
                for future in as_completed(futures):
                    yield futures[future], future.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    for one in todo:
        if one not in together:
            print(f"{one.id} {one.title} ...", flush=True)
            yield one, _entry_or_error(one, effort, folder)


def _entry_or_error(one: Reproduction, effort: Effort, folder: Path | None) -> Entry | str:
    try:
        return entry_of(one, effort, folder)
    except Exception:  # one that breaks off must not take the others with it
        return traceback.format_exc()
