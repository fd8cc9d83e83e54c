"""Learn tasks by their recipes, and compare: `python -m thruster_agents.learn`.

Seeds are learnt in turn over the recipes: the first seed of all, then the second of all. What is done is
kept, one file for each seed, so that the same command goes on where it was stopped; a seed that was
interrupted begins anew.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thruster_agents.commands import check_file, check_folder, complain, run_command
from thruster_agents.files import as_json, first_difference, locked, read_json, write_json
from thruster_agents.recipes.comparison import SCENARIOS, fly_policy, fly_yardsticks
from thruster_agents.recipes.learning import learn, write
from thruster_agents.recipes.page import Result, table, write_page
from thruster_agents.recipes.recipes import RECIPES, Recipe, recipe_of

PROGRAM = "python -m thruster_agents.learn"
_DONE, _YARDSTICKS = "result.json", "yardsticks.json"


@dataclass(frozen=True)
class Options:
    """Learn tasks by their recipes, and compare what was learnt with what it has to beat.

    Attributes:
        recipes: Which, by key (`OrionRendezvous-near`) or by the id of the task; all if none is named.
        seeds: How many policies are learnt by each recipe, with seeds from 0 on.
        episodes: Test episodes of each policy in each scenario.
        folder: Where policies and results are kept.
        results: Markdown page to write; the picture is written beside it.
        learn: Whether to learn; without, what has been learnt so far is shown.
    """

    recipes: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    seeds: int = 10
    episodes: int = 100
    folder: str = "runs/first-hour"
    results: str | None = None
    learn: bool = True

    def check(self) -> list[Recipe]:
        """The recipes that are meant.

        Raises:
            ValueError: A value that cannot be; one line.
        """
        for name, most in (("seeds", 1000), ("episodes", 100_000)):
            if not 1 <= getattr(self, name) <= most:
                raise ValueError(f"{name} must be from 1 to {most}, got {getattr(self, name)}")
        check_folder("folder", Path(self.folder))
        if self.results is not None:
            check_file("results", Path(self.results))
        return [recipe_of(key) for key in dict.fromkeys(self.recipes)] or list(RECIPES)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return run_command(PROGRAM, lambda: _run(arguments))


def _run(arguments: list[str] | None) -> int:
    options = tyro.cli(Options, prog=PROGRAM, args=arguments)
    try:
        recipes = options.check()
        folder = Path(options.folder)
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            results = learn_all(recipes, options, folder)
    except ValueError as error:
        complain(PROGRAM, str(error))
        return 2
    console = Console()
    if not results:
        complain(PROGRAM, f"nothing has been learnt in {folder} yet")
        return 2
    for result in results:
        console.print(table(result))
    if options.results is not None:
        write_page(Path(options.results), results, options.episodes, command(options))
    return 0


def command(options: Options) -> str:
    """The command that writes the page."""
    given = [
        f"--{one.name} {getattr(options, one.name)}"
        for one in dataclasses.fields(options)
        if one.name not in ("recipes", "learn") and getattr(options, one.name) != one.default
    ]
    return " ".join([PROGRAM, *options.recipes, *given])


def learn_all(recipes: Sequence[Recipe], options: Options, folder: Path) -> list[Result]:
    """Learn what is not learnt yet, and read what is.

    Raises:
        ValueError: A file of another recipe, or a damaged one.
    """
    torch.set_num_threads(1)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[score]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    found: dict[str, list[dict[str, Any]]] = {recipe.key: [] for recipe in recipes}
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        for seed in range(options.seeds):
            for recipe in recipes:
                if options.learn or (folder / recipe.key / f"seed-{seed}" / _DONE).exists():
                    found[recipe.key].append(_seed(recipe, seed, options.episodes, folder, progress))
        return [
            Result(recipe, _yardsticks(recipe, options.episodes, folder), found[recipe.key])
            for recipe in recipes
            if found[recipe.key]
        ]


def _seed(recipe: Recipe, seed: int, episodes: int, folder: Path, progress: Progress) -> dict[str, Any]:
    """What came of a seed; it is learnt if that has not been done."""
    place = folder / recipe.key / f"seed-{seed}"
    made = {"recipe": dataclasses.asdict(recipe), "episodes": episodes}
    if (place / _DONE).exists():
        return _read(place / _DONE, made)
    bar = progress.add_task(f"{recipe.key}, seed {seed}", total=recipe.steps, score="")

    def report(steps: int, score: float | None) -> None:
        shown = "" if score is None else f"score {score:.3f}"
        progress.update(bar, completed=min(steps, recipe.steps), score=shown)

    learnt = learn(recipe, seed, report)
    flown = fly_policy(recipe, lambda seen: learnt.model.predict(seen, deterministic=True)[0], episodes)
    place.mkdir(parents=True, exist_ok=True)
    write(place, recipe, learnt.model)
    scores = ", ".join(f"{np.mean(flown[one.name]['score']):.3f} {one.title}" for one in SCENARIOS)
    told = f"{recipe.key}, seed {seed}: score {scores}; {learnt.minutes:.2f} processor minutes"
    progress.console.print(told, highlight=False)
    write_json(
        place / _DONE, as_json(made | {"flown": flown, "minutes": learnt.minutes, "curve": learnt.curve})
    )
    return _read(place / _DONE, made)


def _yardsticks(recipe: Recipe, episodes: int, folder: Path) -> Any:
    path = folder / recipe.key / _YARDSTICKS
    made = {"variant": dataclasses.asdict(recipe.variant), "episodes": episodes}
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, as_json(made | {"flown": fly_yardsticks(recipe, episodes)}))
    return _read(path, made)["flown"]


def _read(path: Path, made: Mapping[str, Any]) -> dict[str, Any]:
    """A file of a result, which has to be of the same making.

    Raises:
        ValueError: Another recipe or other episodes, or a damaged file; one line.
    """
    content = read_json(path)
    different = first_difference({name: content.get(name) for name in made}, as_json(made))
    if different is not None:
        name, then, now = different
        raise ValueError(
            f"{path} was made with {name} {then!r}, got {now!r}; remove it or take another folder"
        )
    return content


if __name__ == "__main__":
    sys.exit(main())
