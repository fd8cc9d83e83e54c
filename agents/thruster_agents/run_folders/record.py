"""What a run depends on besides its options: the spacecraft and the task, kept in its folder and compared."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from gymnasium.vector import AutoresetMode

from thruster_agents.environments import TASK, make_plain
from thruster_agents.files import as_json, first_difference
from thruster_agents.run_folders.folder import RunFolder
from thruster_envs.configuration import to_mapping
from thruster_envs.seeds import TEST, TRAIN, VALIDATION
from thruster_envs.spacecraft import Spacecraft, catalogue, load, save

__all__ = ["check_spacecraft", "check_task", "write_record"]


def write_record(run: RunFolder, spacecraft: Spacecraft) -> None:
    """Keep the spacecraft and the task."""
    save(spacecraft, run.file("spacecraft.toml"))
    run.write("task.json", task_record(spacecraft))


def task_record(spacecraft: Spacecraft) -> dict[str, Any]:
    """The task's id, settings and faults, and which seeds are for what."""
    env = make_plain(spacecraft, 1, autoreset_mode=AutoresetMode.SAME_STEP)
    task: Any = env.unwrapped.task
    env.close()
    fields = (one.name for one in dataclasses.fields(task) if one.init)
    settings = {name: getattr(task, name) for name in fields if name not in ("spacecraft", "faults")}
    seeds = {"train": TRAIN, "validation": VALIDATION, "test": TEST}
    record: dict[str, Any] = as_json(
        {
            "id": TASK,
            "settings": settings,
            "faults": to_mapping(task.fault_source()),
            "seeds": {name: (one.start, one.stop) for name, one in seeds.items()},
        }
    )
    return record


def check_task(run: RunFolder, spacecraft: Spacecraft) -> None:
    """Check that the task is as it was when the run began.

    Raises:
        ValueError: One field that is not, or a spacecraft that the task refuses.
    """
    found = first_difference(run.read("task.json"), task_record(spacecraft))
    if found is not None:
        name, then, now = found
        raise ValueError(
            f"{run.file('task.json')}: {name} was {then!r} when the run began and is {now!r} in this "
            "version; train again"
        )


def check_spacecraft(run: RunFolder, source: str) -> Spacecraft:
    """The spacecraft of a run, and whether what it was made from still says the same.

    Args:
        run: Its folder.
        source: Name or path that the run began with; a file that is gone is not compared.

    Raises:
        ValueError: One field that is another now, or a file that is damaged.
    """
    kept = run.spacecraft()
    if source not in catalogue() and not Path(source).exists():
        return kept
    found = first_difference(kept.to_dict(), load(source).to_dict())
    if found is not None:
        name, then, now = found
        raise ValueError(
            f"{source}: {name} is {now!r}, and was {then!r} when the run began; put it back (it is kept in "
            f"{run.file('spacecraft.toml')}) or train anew"
        )
    return kept
