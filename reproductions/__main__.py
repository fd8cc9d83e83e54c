"""`python -m reproductions list | run <id> ... | run all`: recompute results of the sources."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from reproductions.record import FULL, QUICK
from reproductions.registry import chosen, find_all
from reproductions.results import read
from reproductions.running import is_current, run
from thruster_agents.commands import run_command
from thruster_envs.text_files import printable

PROGRAM = "python -m reproductions"
RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results"


def main(arguments: list[str]) -> int:
    """Run the command: 1 if a reproduction broke off with an error, 2 for a bad call, 130 if stopped."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    listing = commands.add_parser("list", help="ids, titles and the verdicts that are on record")
    running = commands.add_parser("run", help="recompute and write the results")
    running.add_argument("ids", nargs="+", metavar="id", help="such as E07, or all")
    running.add_argument("--resume", action="store_true", help="leave out what is recorded and current")
    running.add_argument("--processes", type=int, default=1, help="how many run at the same time")
    running.add_argument("--quick", action="store_true", help="few samples; only show that everything runs")
    for command in (listing, running):
        command.add_argument("--output", type=Path, help="folder of the results; docs/results by default")
    options = parser.parse_args(arguments)
    if options.command == "list":
        try:
            show_list(options.output or RESULTS)
        except ValueError as damaged:
            print(damaged, file=sys.stderr)
            return 2
        return 0
    if options.processes < 1:
        parser.error(f"--processes is {options.processes}; one or more would be right")
    folder = options.output or (None if options.quick else RESULTS)
    try:
        wanted = chosen(options.ids, find_all())
        if folder is not None:  # before any work is done, which could not be written otherwise
            check_folder(folder)
    except ValueError as problem:
        print(problem, file=sys.stderr)
        return 2
    return run(wanted, QUICK if options.quick else FULL, folder, options.resume, options.processes)


def check_folder(folder: Path) -> None:
    """Make the folder of the results.

    Raises:
        ValueError: A folder that cannot be made or written in, or that has results that cannot be read.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(f"{printable(folder)}: cannot be written in: {error.strerror or error}") from None
    read(folder)


def show_list(folder: Path) -> None:
    """Print every reproduction with the verdict on record, and whether it is current."""
    recorded = read(folder)
    for one in find_all().values():
        entry = recorded.get(one.id)
        state = "not run yet" if entry is None else entry["verdict"]
        if entry is not None and not is_current(one, FULL, entry):
            state += " (by other settings or older code)"
        print(f"{one.id:6} {one.source:12} {one.title}: {state}")


if __name__ == "__main__":
    sys.exit(run_command(PROGRAM, lambda: main(sys.argv[1:])))
