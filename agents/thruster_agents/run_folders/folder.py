"""A run folder and its files.

```
runs/<time>-<name>/
    config.json  spacecraft.toml  task.json  versions.json  metrics.json
    <form>-<seed>/checkpoint-<steps>.safetensors (the last two), policy.safetensors
    tensorboard/<form>-<seed>/
    learning_curve.png  comparison.png  lock
```

`config.json` has the options of the command, `spacecraft.toml` the whole description of what flies, and
`task.json` what else the results depend on: a run is resumed and loaded from these alone.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from thruster_agents.files import locked, read_json, remove_unfinished, write_json
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.spacecraft import load as load_spacecraft

__all__ = ["RunFolder", "latest_run", "new_run", "versions"]

_PACKAGES = ("thruster-envs", "numpy", "numba", "gymnasium", "torch", "stable-baselines3", "scipy", "highspy")


@dataclass(frozen=True)
class RunFolder:
    """Where the files of a run stand.

    Attributes:
        path: The folder.
    """

    path: Path

    def policy(self, form: str, seed: int) -> Path:
        """Folder of one trained policy."""
        return self.path / f"{form}-{seed}"

    def tensorboard(self, form: str, seed: int) -> Path:
        """Folder of its TensorBoard log."""
        return self.path / "tensorboard" / f"{form}-{seed}"

    def file(self, name: str) -> Path:
        """A file of the run."""
        return self.path / name

    def write(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file, whole or not at all."""
        write_json(self.file(name), content)

    def read(self, name: str) -> dict[str, Any]:
        """A JSON file.

        Raises:
            ValueError: The folder is none of a run, or the file is missing or damaged; see `read_json`.
        """
        if not self.file("config.json").exists():
            raise ValueError(f"{self.path} has no config.json; the folder of a run is needed")
        return read_json(self.file(name))

    def spacecraft(self) -> Spacecraft:
        """What flies, as it was when the run began.

        Raises:
            ValueError: No such file, or no description of a spacecraft.
        """
        path = self.file("spacecraft.toml")
        if not path.is_file():
            raise ValueError(
                f"{path} does not exist: the run is damaged, or of an earlier version, which kept no "
                "description of its spacecraft; train again"
            )
        return load_spacecraft(path)

    def locked(self) -> AbstractContextManager[None]:
        """Use the folder alone; see `locked` in `thruster_agents.files`."""
        return locked(self.path)

    def clean(self) -> None:
        """Remove half-written files of processes that were killed."""
        for folder in (self.path, *(one for one in self.path.iterdir() if one.is_dir())):
            remove_unfinished(folder)


def new_run(parent: Path, name: str) -> RunFolder:
    """Make the folder `<time>-<name>`; a second one in the same second gets a number.

    Raises:
        ValueError: It cannot be made; one line says why.
    """
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{name}"
    for suffix in ("", *(f"-{k}" for k in range(2, 100))):
        path = parent / f"{stem}{suffix}"
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            if not parent.is_dir():
                raise ValueError(f"runs must be a folder, got {parent}, which is a file") from None
            continue
        except OSError as error:
            raise ValueError(f"no folder can be made in runs {parent} ({error.strerror})") from None
        return RunFolder(path)
    raise ValueError(f"{parent / stem} and 98 more exist already; choose another name")


def latest_run(parent: Path) -> RunFolder:
    """The run that was finished last: the one with the newest `metrics.json`.

    Raises:
        ValueError: There is none.
    """
    finished = {path.parent: path.stat().st_mtime_ns for path in parent.glob("*/metrics.json")}
    if not finished:
        raise ValueError(f"{parent} has no finished run; run train.py first, or name the folder of a run")
    return RunFolder(max(finished, key=lambda path: (finished[path], path.name)))


def versions() -> dict[str, str]:
    """Of Python, the machine and the packages that results depend on."""
    found = {"python": sys.version.split()[0], "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
