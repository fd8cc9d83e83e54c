"""Train PPO on the thruster-mapping task and compare it with everything that it has to beat, in one table.

An agent answers commanded rate changes of a spacecraft whose thrusters may have failed. On `beliefs` it
says how healthy it believes each thruster to be, and a linear program allocates with that; on `duties` it
fires the thrusters itself. Leaves runs/<time>-<name>/.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thruster_agents.environments import FORMS, TASK, Form
from thruster_agents.evaluation import FAULTS, SCENARIOS, Method, Row, classical_methods, compare, play
from thruster_agents.evaluation.methods import Learned
from thruster_agents.pictures import draw_comparison, draw_learning_curve
from thruster_agents.ppo import Settings, Trained, train
from thruster_agents.ppo.checkpoint import Point
from thruster_agents.report import as_markdown, as_table
from thruster_agents.run_folders import RunFolder, new_run, versions
from thruster_envs.configuration import from_mapping, require
from thruster_envs.seeds import TEST, VALIDATION, first_training_seed
from thruster_envs.spacecraft import Spacecraft, load


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """Train PPO on ThrusterMapping-v0, evaluate it beside classical mappers, print one table."""

    spacecraft: str = "orion"
    """Name in the catalogue, or path of a TOML file."""
    seed: int = 0
    """Of networks and training worlds."""
    seeds: int = 1
    """How many policies of each form to train, with seeds from `seed` on; the table is over all of them."""
    belief_steps: int = 600_000
    """Environment steps of PPO on beliefs; 0 leaves the row out."""
    duty_steps: int = 500_000
    """Environment steps of PPO on duties; 0 leaves the row out."""
    worlds: int = 256
    """Environments side by side; a rollout is one episode of 32 commands in each."""
    learning_rate: float = 5e-3
    """Of PPO on beliefs at the start; falls linearly to 0."""
    duty_learning_rate: float = 5e-3
    """Of PPO on duties at the start; falls linearly to 0."""
    minibatch: int = 1024
    """Samples to a gradient step."""
    epochs: int = 6
    """Passes over each rollout, beliefs."""
    duty_epochs: int = 10
    """Passes over each rollout, duties."""
    discount: float = 0.5
    """Discount per command, beliefs: commands are independent of each other, only a diagnosis lasts."""
    duty_discount: float = 0.0
    """Discount per command, duties: nothing that a policy without a belief does now lasts."""
    trace: float = 0.9
    """Decay of the advantage estimate (lambda of GAE)."""
    exploration: float = 0.37
    """Standard deviation of actions at the start, beliefs; wide, because the LP answers a belief in jumps."""
    duty_exploration: float = 0.5
    """Standard deviation of actions at the start, duties."""
    validate_every: int = 5
    """Rollouts between points of the learning curve."""
    validation_worlds: int = 128
    """Episodes to a point of the learning curve."""
    test_worlds: int = 1000
    """Episodes to a cell of the table."""
    checkpoint_every: int = 10
    """Rollouts between checkpoints."""
    threads: int = 1
    """Threads of torch. Another number may give other last digits."""
    name: str = "mapping"
    """End of the run folder's name."""
    runs: str = "runs"
    """Where run folders are made."""
    results: str | None = None
    """Also write the table to this Markdown file, with the command that makes it."""
    resume: str | None = None
    """Folder of an interrupted run to go on with, in its own configuration; other options are not taken."""

    def check(self) -> None:
        """Raise ValueError, one line, for a value that cannot be."""
        for name in (
            "seeds",
            "worlds",
            "minibatch",
            "epochs",
            "duty_epochs",
            "validate_every",
            "checkpoint_every",
            "threads",
        ):
            require(getattr(self, name) >= 1, name, getattr(self, name), "1 or more")
        for name in ("seed", "belief_steps", "duty_steps"):
            require(getattr(self, name) >= 0, name, getattr(self, name), "0 or more")
        for name in ("learning_rate", "duty_learning_rate", "exploration", "duty_exploration"):
            require(
                0.0 < getattr(self, name) < 10.0, name, getattr(self, name), "a number above 0 and below 10"
            )
        for name in ("discount", "duty_discount", "trace"):
            require(0.0 <= getattr(self, name) <= 1.0, name, getattr(self, name), "a number from 0 to 1")
        for name, seeds in (("test_worlds", TEST), ("validation_worlds", VALIDATION)):
            require(
                1 <= getattr(self, name) <= len(seeds) // 2,
                name,
                getattr(self, name),
                f"1 to {len(seeds) // 2}",
            )
        require(
            self.belief_steps + self.duty_steps > 0,
            "belief_steps",
            0,
            "a number above 0 here or in duty_steps",
        )
        require(
            self.name.replace("-", "").replace("_", "").isalnum(),
            "name",
            self.name,
            "letters, digits, - and _",
        )
        first_training_seed(self.seed + self.seeds - 1, self.worlds)

    def settings(self, form: Form, seed: int, spacecraft: Spacecraft) -> Settings:
        """Of one training."""
        beliefs = form == "beliefs"
        return Settings(
            spacecraft=spacecraft,
            form=form,
            seed=seed,
            steps=self.belief_steps if beliefs else self.duty_steps,
            worlds=self.worlds,
            learning_rate=self.learning_rate if beliefs else self.duty_learning_rate,
            minibatch=self.minibatch,
            epochs=self.epochs if beliefs else self.duty_epochs,
            discount=self.discount if beliefs else self.duty_discount,
            trace=self.trace,
            exploration=self.exploration if beliefs else self.duty_exploration,
            checkpoint_every=self.checkpoint_every,
            validate_every=self.validate_every,
            validation_worlds=self.validation_worlds,
        )


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    console = Console()
    try:
        chosen = tyro.cli(Configuration, prog="train.py", args=arguments, description=Configuration.__doc__)
        configuration, run = begin(chosen)
        spacecraft = load(configuration.spacecraft)
    except ValueError as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2
    console.print(f"run folder {run.path}", highlight=False)
    try:
        learn_and_compare(configuration, spacecraft, run, console)
    except KeyboardInterrupt:
        console.print(f"interrupted; to go on: python train.py --resume {run.path}", highlight=False)
        return 130
    return 0


def learn_and_compare(
    configuration: Configuration, spacecraft: Spacecraft, run: RunFolder, console: Console
) -> list[Row]:
    """Train, fly every method on the test seeds, and leave table, metrics and pictures."""
    torch.set_num_threads(configuration.threads)
    forms = [form for form in FORMS if configuration.settings(form, 0, spacecraft).steps > 0]
    seeds = range(configuration.seed, configuration.seed + configuration.seeds)
    trained: dict[Form, list[Trained]] = {form: [] for form in forms}
    with progress_bar(console) as progress:
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
    console.print(as_table(rows, SCENARIOS, configuration.test_worlds, configuration.seeds))
    spent = ", ".join(f"{seconds[form]:.0f} s on {form}" for form in forms)
    console.print(f"trained {spent}; pictures, metrics and models in {run.path}", highlight=False)
    if configuration.results is not None:
        as_markdown(
            Path(configuration.results),
            rows,
            SCENARIOS,
            configuration.test_worlds,
            configuration.seeds,
            command(configuration),
        )
    return rows


def begin(chosen: Configuration) -> tuple[Configuration, RunFolder]:
    """A new run folder with its configuration, or that of the run to go on with."""
    chosen.check()
    if chosen.resume is None:
        load(chosen.spacecraft)
        run = new_run(Path(chosen.runs), chosen.name)
        run.write("config.json", dataclasses.asdict(chosen))
        run.write("versions.json", versions())
        return chosen, run
    run = RunFolder(Path(chosen.resume))
    stored = from_mapping(Configuration, run.read("config.json"), str(run.file("config.json")))
    for one in dataclasses.fields(Configuration):
        given, default = getattr(chosen, one.name), one.default
        if one.name != "resume" and given != default and given != getattr(stored, one.name):
            option = f"--{one.name.replace('_', '-')}"
            raise ValueError(
                f"{option} is {given} with --resume; a run goes on as it was begun: leave {option} out"
            )
    then, now = run.read("versions.json"), versions()
    changed = [name for name in now if now[name] != then.get(name)]
    if changed:
        print(
            f"train.py: other versions than the run began with ({', '.join(changed)}); the result may differ",
            file=sys.stderr,
        )
    return stored, run


def command(configuration: Configuration) -> str:
    """The command that makes a run, with the options that are not the defaults."""
    given = (
        f" --{one.name.replace('_', '-')} {getattr(configuration, one.name)}"
        for one in dataclasses.fields(Configuration)
        if getattr(configuration, one.name) != one.default
    )
    return "python train.py" + "".join(given)


@contextmanager
def progress_bar(console: Console) -> Iterator[Progress]:
    """What is shown while policies train."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[score]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield progress


if __name__ == "__main__":
    sys.exit(main())
