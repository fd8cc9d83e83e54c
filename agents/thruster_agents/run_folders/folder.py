"""A run folder and its files.

```
runs/<time>-<name>/
    config.json  versions.json  metrics.json
    <form>-<seed>/checkpoint.pt, model.zip
    tensorboard/<form>-<seed>/
    learning_curve.png  comparison.png
```
"""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

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
        unfinished = self.file(f"{name}.unfinished")
        unfinished.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        os.replace(unfinished, self.file(name))

    def read(self, name: str) -> dict[str, Any]:
        """A JSON file.

        Raises:
            ValueError: No such file, or not JSON.
        """
        path = self.file(name)
        if not path.is_file():
            raise ValueError(
                f"{self.path} has no {name}; the folder of a run, as train.py leaves it, would be right"
            )
        try:
            content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except json.JSONDecodeError as error:
            raise ValueError(f"{path} is not JSON ({error})") from None
        return content


def new_run(parent: Path, name: str) -> RunFolder:
    """Make the folder `<time>-<name>`; a second one in the same second gets a number."""
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{name}"
    for suffix in ("", *(f"-{k}" for k in range(2, 100))):
        path = parent / f"{stem}{suffix}"
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            continue
        return RunFolder(path)
    raise ValueError(f"{parent / stem} and 98 more exist already; another name would be right")


def latest_run(parent: Path) -> RunFolder:
    """The newest folder that has a finished run.

    Raises:
        ValueError: There is none.
    """
    finished = sorted(path.parent for path in parent.glob("*/metrics.json"))
    if not finished:
        raise ValueError(f"{parent} has no finished run; run train.py first, or name the folder of a run")
    return RunFolder(finished[-1])


def versions() -> dict[str, str]:
    """Of Python, the machine and the packages that results depend on."""
    found = {"python": sys.version.split()[0], "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
