"""What is published has what its own tests read, and asks for no more than it needs."""

import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_source_distribution_has_all_that_a_clone_has():
    if not (ROOT / ".git").exists():
        pytest.skip("this is no clone: what is here is the source distribution itself")
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    included = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    by_itself = {"README.md", "LICENSE", "pyproject.toml", ".gitignore"}  # hatchling adds these
    assert {path.partition("/")[0] for path in tracked.splitlines()} == by_itself | {
        path.removeprefix("/") for path in included
    }


def test_the_floors_are_those_that_make_floors_installs():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    optional = PROJECT["project"]["optional-dependencies"]
    for requirement in [*PROJECT["project"]["dependencies"], *optional["multi-agent"]]:
        name, _, version = requirement.partition(">=")
        if name in ("gymnasium", "pettingzoo"):
            assert f'"{name}=={version}.*"' in makefile


def test_stable_baselines_comes_without_the_rest():
    assert {one.partition(">=")[0] for one in PROJECT["project"]["optional-dependencies"]["sb3"]} == {
        "stable-baselines3",
        "torch",
    }
