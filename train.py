"""Train PPO on the thruster-mapping task and compare it with everything that it has to beat, in one table.

An agent answers commanded rate changes of a spacecraft whose thrusters may have failed. On `beliefs` it
says how healthy it believes each thruster to be, and a linear program allocates with that; on `duties` it
fires the thrusters itself. Leaves runs/<time>-<name>/.
"""

from __future__ import annotations

import os
import signal

PROGRAM = "train.py"
if __name__ == "__main__" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # Until `run_command`, while the libraries load, Ctrl-C ends the program with one line and no exception.
    signal.signal(
        signal.SIGINT, lambda *_: (os.write(2, f"\n{PROGRAM}: interrupted\n".encode()), os._exit(130))
    )

import contextlib
import dataclasses
import io
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from thruster_envs.extras import extra

with extra("agents", PROGRAM):
    import torch
    import tyro
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thruster_agents.commands import (
    check_file,
    check_folder,
    check_memory,
    check_space,
    complain,
    reason,
    run_command,
)
from thruster_agents.environments import FORMS, TASK, Form
from thruster_agents.evaluation import FAULTS, SCENARIOS, Method, Row, classical_methods, compare, play
from thruster_agents.evaluation.methods import Learned, try_methods
from thruster_agents.pictures import draw_comparison, draw_learning_curve
from thruster_agents.ppo import Trained, needed_bytes, train
from thruster_agents.ppo.checkpoint import Point
from thruster_agents.report import as_markdown, as_table
from thruster_agents.run_folders import (
    Configuration,
    RunFolder,
    check_spacecraft,
    check_task,
    new_run,
    read_configuration,
    versions,
    write_record,
)
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import Spacecraft, catalogue, load

#: Space for tables, pictures and logs, bytes.
_SPACE = 5_000_000


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return run_command(PROGRAM, lambda: _run(arguments))


def _run(arguments: list[str] | None) -> int:
    with contextlib.ExitStack() as held:
        try:
            chosen = options(arguments)
            chosen.check()
            configuration, spacecraft, run = (begin if chosen.resume is None else resume)(chosen, held)
        except ValueError as error:
            complain(PROGRAM, str(error))
            return 2
        print(f"run folder {run.path}", flush=True)
        again = ["--resume", str(run.path)]
        if configuration.results is not None:
            again += ["--results", configuration.results]
        to_go_on = f"to go on: python train.py {shlex.join(again)}"
        try:
            learn_and_compare(configuration, spacecraft, run, Console())
        except KeyboardInterrupt:
            complain(PROGRAM, f"interrupted; {to_go_on}")
            return 130
        except OSError as error:
            complain(PROGRAM, f"{reason(error)}; {to_go_on}")
            return 1
        except ValueError as error:  # a checkpoint of other settings, or a training that diverges
            complain(PROGRAM, str(error))
            return 1
    return 0


def options(arguments: list[str] | None) -> Configuration:
    """What the command line says; a line of it that cannot be read is one line of error."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(Configuration, prog=PROGRAM, args=arguments, description=Configuration.__doc__)
    except SystemExit as ended:
        if ended.code in (0, None):
            raise
    shown = said.getvalue().encode("ascii", errors="ignore").decode().replace("|", " ")  # without the frame
    line = " ".join(shown.split())
    for heading in ("Unrecognized options ", "Value error ", "Missing argument ", "Parsing error "):
        line = line.removeprefix(heading)
    line = line.partition(" Argument helptext:")[0].partition(" For full helptext")[0]
    raise ValueError(f"{line} (see {PROGRAM} --help)")


def learn_and_compare(
    configuration: Configuration, spacecraft: Spacecraft, run: RunFolder, console: Console
) -> list[Row]:
    """Train, fly every method on the test seeds, leave table, metrics and pictures, and print the table."""
    torch.set_num_threads(configuration.threads)
    forms = forms_of(configuration, spacecraft)
    seeds = range(configuration.seed, configuration.seed + configuration.seeds)
    trained: dict[Form, list[Trained]] = {form: [] for form in forms}
    with progress_bar() as progress:
        for form in forms:
            for seed in seeds:
                settings = configuration.settings(form, seed, spacecraft)
                total = settings.rollouts * settings.worlds * 32
                label = f"PPO on {form}" + (f", seed {seed}" if len(seeds) > 1 else "")
                task = progress.add_task(label, total=total, score="")

                def report(steps: int, point: Point | None, task: Any = task) -> None:
                    score = f"score {point.score:.3f}" if point else ""
                    progress.update(task, completed=steps, score=score)

                trained[form].append(
                    train(
                        settings,
                        run.policy(form, seed),
                        tensorboard=run.tensorboard(form, seed),
                        progress=report,
                        tell=lambda line: complain(PROGRAM, line),
                    )
                )
    seconds = {form: sum(one.seconds for one in several) for form, several in trained.items()}

    classical = classical_methods(spacecraft)
    learned = [[Learned(one.model, form, f"PPO on {form}") for one in trained[form]] for form in forms]
    methods: list[list[Method]] = [[classical[0]], *learned, *([one] for one in classical[1:])]
    rows = compare(methods, TEST[: configuration.test_worlds], spacecraft)
    validation = VALIDATION[: configuration.validation_worlds]
    lines = {one.title: play(one, FAULTS, validation, spacecraft).scores.mean() for one in classical[:4]}

    run.write(
        "metrics.json",
        {
            "task": TASK,
            "rows": [row.to_dict() for row in rows],
            "curves": {
                f: [[dataclasses.astuple(p) for p in one.curve] for one in s] for f, s in trained.items()
            },
        },
    )
    run.write("timing.json", {"training_seconds": seconds})
    curves = {form: [one.curve for one in several] for form, several in trained.items()}
    draw_learning_curve(run.file("learning_curve.png"), curves, lines)
    draw_comparison(run.file("comparison.png"), rows, SCENARIOS)
    if configuration.results is not None:
        as_markdown(
            Path(configuration.results),
            rows,
            SCENARIOS,
            configuration.test_worlds,
            configuration.seeds,
            command(configuration),
        )
    console.print(as_table(rows, SCENARIOS, configuration.test_worlds, configuration.seeds))
    spent = ", ".join(f"{seconds[form]:.0f} s on {form}" for form in forms)
    console.print(f"trained {spent}; pictures, metrics and models in {run.path}", highlight=False)
    return rows


def begin(chosen: Configuration, held: contextlib.ExitStack) -> tuple[Configuration, Spacecraft, RunFolder]:
    """A new run: everything that could fail later is tried, then its folder is made.

    Args:
        chosen: The options.
        held: Takes the lock of the folder.

    Raises:
        ValueError: Something that cannot be; one line says what.
    """
    spacecraft = load(chosen.spacecraft)
    parent = Path(chosen.runs)
    check_folder("runs", parent)
    try_run(chosen, spacecraft, parent)
    run = new_run(parent, chosen.name)
    held.enter_context(run.locked())
    source = chosen.spacecraft
    stored = dataclasses.asdict(chosen) | {
        "spacecraft": source if source in catalogue() else os.path.abspath(source)
    }
    write_record(run, spacecraft)
    run.write("versions.json", versions())
    run.write("config.json", stored)
    return chosen, spacecraft, run


def resume(chosen: Configuration, held: contextlib.ExitStack) -> tuple[Configuration, Spacecraft, RunFolder]:
    """A run to go on with, as it was begun; only where results go is what this command says.

    Args:
        chosen: The options.
        held: Takes the lock of the folder.

    Raises:
        ValueError: A folder that is none of a run, damaged, or in use; options, a spacecraft or a task other
            than the run began with; one line says what.
    """
    run = RunFolder(Path(chosen.resume or ""))
    stored = read_configuration(run)
    held.enter_context(run.locked())
    run.clean()
    free = ("resume", "results")
    given = dataclasses.replace(
        chosen,
        spacecraft=chosen.spacecraft
        if chosen.spacecraft in catalogue()
        else os.path.abspath(chosen.spacecraft),
    )
    for one in dataclasses.fields(Configuration):
        value = getattr(given, one.name)
        if one.name not in free and value not in (one.default, getattr(stored, one.name)):
            option = f"--{one.name.replace('_', '-')}"
            raise ValueError(
                f"{option} is {value} with --resume; a run goes on as it was begun: leave {option} out"
            )
    spacecraft = check_spacecraft(run, stored.spacecraft)
    check_task(run, spacecraft)
    configuration = dataclasses.replace(stored, results=chosen.results, resume=None)
    try_run(configuration, spacecraft, run.path)
    if stored.results is not None and chosen.results is None:
        complain(
            PROGRAM, f"no table is written; to write it where the run began to: --results {stored.results}"
        )
    tell_versions(run)
    return configuration, spacecraft, run


def tell_versions(run: RunFolder) -> None:
    """Say which versions are others than those that the run began with."""
    try:
        then = run.read("versions.json")
    except ValueError as error:
        complain(PROGRAM, f"{error}; versions are not compared")
        return
    now = versions()
    changed = [name for name in now if now[name] != then.get(name)]
    if changed:
        complain(
            PROGRAM, f"other versions than the run began with ({', '.join(changed)}); the result may differ"
        )


def try_run(configuration: Configuration, spacecraft: Spacecraft, folder: Path) -> None:
    """Try what could fail in the middle of a run, or at its end.

    Raises:
        ValueError: More threads or memory than there are, a spacecraft that the task refuses or that makes
            numbers which are not finite, no place for the results.
    """
    processors = os.cpu_count() or 1
    if configuration.threads > 4 * processors:
        raise ValueError(
            f"threads must be at most {4 * processors}, four for each processor, got {configuration.threads}"
        )
    if configuration.results is not None:
        check_file("results", Path(configuration.results))
        check_space("results", Path(configuration.results), _SPACE)
    forms = forms_of(configuration, spacecraft)
    try:
        try_methods(spacecraft, forms)
    except ValueError as error:
        raise ValueError(f"spacecraft {configuration.spacecraft}: {error}") from None
    needed = [needed_bytes(configuration.settings(form, 0, spacecraft)) for form in forms]
    check_memory("worlds", configuration.worlds, max(one.memory for one in needed))
    for name in ("test_worlds", "validation_worlds"):
        episodes = getattr(configuration, name)
        check_memory(name, episodes, episodes * max(one.world for one in needed))
    check_space("runs", folder, _SPACE + configuration.seeds * sum(one.disk for one in needed))


def forms_of(configuration: Configuration, spacecraft: Spacecraft) -> list[Form]:
    """The forms that are trained."""
    return [form for form in FORMS if configuration.settings(form, 0, spacecraft).steps > 0]


def command(configuration: Configuration) -> str:
    """The command that makes a run, with the options that are not the defaults."""
    given = (
        f" --{one.name.replace('_', '-')} {shlex.quote(str(getattr(configuration, one.name)))}"
        for one in dataclasses.fields(Configuration)
        if getattr(configuration, one.name) != one.default
    )
    return "python train.py" + "".join(given)


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """What a terminal shows while policies train."""
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[score]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield progress


if __name__ == "__main__":
    sys.exit(main())
