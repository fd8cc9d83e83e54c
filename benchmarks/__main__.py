"""``python -m benchmarks [section ...]``: measure, print tables, write the report after a complete run."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import sys
import time
from pathlib import Path

from benchmarks.figure import draw
from benchmarks.report import Section, report, section_as_text
from benchmarks.timing import QUICK, Effort, share_of_core
from thruster_agents.commands import check_file, check_folder, run_command

PROGRAM = "python -m benchmarks"
#: Each is a module of this package whose ``measure(effort)`` gives a section.
SECTIONS = (
    "environments",
    "cartpole",
    "peers",
    "learning",
    "mapping",
    "detection",
    "navigation",
    "formation",
)
RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results"


def run(names: list[str], effort: Effort) -> list[Section]:
    """Measure some sections, and print each as soon as it is there."""
    found = []
    for name in names:
        print(f"{name}: measuring", flush=True)
        start = time.perf_counter()
        section = importlib.import_module(f"benchmarks.{name}").measure(effort)
        print(f"{name}: {time.perf_counter() - start:.0f} s")
        print(section_as_text(section), flush=True)
        found.append(section)
    return found


def write(sections: list[Section], folder: Path, effort: Effort) -> Path:
    """Write ``speed.md`` and ``speed.png``; profiles of missed targets are taken now."""
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / "speed.png"
    drawn = picture.name if draw(sections, picture) else None
    text = report(sections, drawn, share_of_core(), processor_time=effort.processor_time)
    path = folder / "speed.md"
    path.write_text(text, encoding="utf-8")
    return path


def main(arguments: list[str]) -> int:
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description=__doc__)
    parser.add_argument(
        "sections", nargs="*", metavar="section", help=f"of {', '.join(SECTIONS)}; default: all"
    )
    parser.add_argument("--quick", action="store_true", help="only show that everything runs")
    parser.add_argument(
        "--processor-time", action="store_true",
        help="time work on one thread by the processor's clock, on a machine that others use",
    )  # fmt: skip
    parser.add_argument(
        "--output", type=Path, help="folder for speed.md and speed.png; a complete run writes docs/results"
    )
    options = parser.parse_args(arguments)
    unknown = [name for name in options.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"there is no section {unknown[0]!r}; one of {', '.join(SECTIONS)} would be right")
    effort = dataclasses.replace(QUICK if options.quick else Effort(), processor_time=options.processor_time)
    folder = options.output
    if folder is None and not options.sections and not options.quick:
        folder = RESULTS
    if folder is not None:
        try:
            check_folder("--output", folder)
            for name in ("speed.md", "speed.png"):
                check_file("--output", folder / name)
        except ValueError as problem:
            parser.error(str(problem))
    sections = run(options.sections or list(SECTIONS), effort)
    if folder is not None:
        print(f"Written: {write(sections, folder, effort)}")
    return 0


if __name__ == "__main__":
    sys.exit(run_command(PROGRAM, lambda: main(sys.argv[1:])))
