"""What is published has what its own tests read, and asks for no more than it needs."""

import os
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


INCLUDED = [
    path.removeprefix("/") for path in PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
]
#: What hatchling adds by itself.
BY_ITSELF = ["README.md", "LICENSE", "pyproject.toml", ".gitignore"]

in_a_clone = pytest.mark.skipif(
    not (ROOT / ".git").exists(), reason="this is no clone: what is here is the source distribution itself"
)


def git(*arguments):
    """The lines that git answers about this clone."""
    run = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


@in_a_clone
def test_the_source_distribution_has_all_that_a_clone_has():
    assert {path.partition("/")[0] for path in git("ls-files")} == {*INCLUDED, *BY_ITSELF}
    assert (
        git("ls-files", "--cached", "--ignored", "--exclude-standard") == []
    )  # hatchling would leave them out


def test_what_the_source_distribution_is_made_of_is_here():
    assert [path for path in (*INCLUDED, *BY_ITSELF) if not (ROOT / path).exists()] == []


@in_a_clone
@pytest.mark.nightly
def test_what_is_built_is_all_of_it_and_passes_its_own_tests(tmp_path):
    git("checkout-index", "--all", f"--prefix={tmp_path}/clone/")
    venv.create(tmp_path / "venv", with_pip=True)
    python = str(tmp_path / "venv" / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "hatchling"], check=True)  # from the network
    built = [python, "-m", "hatchling", "build", "--directory", str(tmp_path)]
    subprocess.run(built, cwd=tmp_path / "clone", check=True)

    (path,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        archive.extractall(tmp_path, filter="data")
    unpacked = tmp_path / path.name.removesuffix(".tar.gz")
    found = {str(one.relative_to(unpacked)) for one in unpacked.rglob("*") if one.is_file()}
    assert found == {*git("ls-files"), "PKG-INFO"}
    quick = ["tests/test_packaging.py", "tests/test_readme.py", "tests/spacecraft"]
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "not examples", *quick],
        cwd=unpacked,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(("src", "baselines", "agents"))},
        check=True,
    )

    (path,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(path) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    packages = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert names == {
        one.removeprefix(package.rpartition("/")[0] + "/")
        for package in packages
        for one in git("ls-files", package)
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
