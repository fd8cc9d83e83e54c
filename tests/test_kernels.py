"""Compiled kernels that are kept on disk: never older than their sources, never in the way."""

import inspect
import os
import pkgutil
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

import thruster_baselines
import thruster_envs
from thruster_envs.kernels import kernel_folder, source_hash, sources_of

HELPER = """
from numba import njit
FACTOR = {factor}

@njit
def helper(x):
    return FACTOR * x
"""
KERNEL = """
from thruster_envs.kernels import kernel
{imported}

@kernel
def double(x):
    return helper(x) + 1
"""


def python(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own that looks for packages in a folder first."""
    path = f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    given = os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"} | environment
    return subprocess.run(
        [sys.executable, "-c", code], env=given, capture_output=True, text=True, timeout=1500, check=True
    )


IMPORTS = [
    "from toy.helpers import (  # a comment (with brackets)\n    helper,\n)",
    "from helpers import helper",
    "from .helpers import helper",
    "from . import helpers\nhelper = helpers.helper",
    "import toy.helpers\nhelper = toy.helpers.helper",
]


def toy(folder: Path, factor: int = 2) -> None:
    """A user's package: kernels, and what is compiled into them in another module, in one of two places."""
    (folder / "toy").mkdir(exist_ok=True)
    (folder / "toy" / "__init__.py").write_text("")
    for place in (folder, folder / "toy"):
        (place / "helpers.py").write_text(HELPER.format(factor=factor))
    for number, imported in enumerate(IMPORTS):
        (folder / "toy" / f"kernels{number}.py").write_text(KERNEL.format(imported=imported))


CALL = "from toy.kernels0 import double; print(double(10))"
CALLS = "; ".join(CALL.replace("kernels0", f"kernels{number}") for number in range(len(IMPORTS)))


def test_a_change_of_what_is_compiled_into_a_kernel_counts(tmp_path):
    cache = {"THRUSTER_ENVS_CACHE_DIR": str(tmp_path / "cache")}
    toy(tmp_path)
    assert python(CALLS, tmp_path, **cache).stdout == "21\n" * len(IMPORTS)
    kept = list((tmp_path / "cache").rglob("*.nbc"))
    toy(tmp_path, factor=3)
    assert python(CALLS, tmp_path, **cache).stdout == "31\n" * len(IMPORTS)
    toy(tmp_path)
    written = [file.stat().st_mtime_ns for file in kept]
    assert python(CALLS, tmp_path, **cache).stdout == "21\n" * len(IMPORTS)
    assert [file.stat().st_mtime_ns for file in kept] == written  # read, not compiled anew


MOTION = """
import numpy as np
from thruster_envs.physics import rows as at
from thruster_envs.pilots.attitude import relative_motion
data = np.zeros((1, at.RATE + 3, 2))
data[0, at.ATTITUDE : at.ATTITUDE + 4] = [[0.6, 0.0], [0.8, 0.8], [0.0, 0.6], [0.0, 0.0]]
print(relative_motion(data, at.ATTITUDE, 0, 1, 2))
"""


def test_a_change_of_a_module_of_ours_counts(tmp_path):
    """As a `git pull` would: only `physics/attitude.py` is another; the kernel is in `pilots/attitude.py`."""
    shutil.copytree(Path(thruster_envs.__file__).parent, tmp_path / "thruster_envs")
    cache = {"THRUSTER_ENVS_CACHE_DIR": str(tmp_path / "cache")}
    before = python(MOTION, tmp_path, **cache).stdout
    assert python(MOTION, tmp_path, **cache).stdout == before
    attitude = tmp_path / "thruster_envs" / "physics" / "attitude.py"
    source = attitude.read_text()
    changed = source.replace("a[0] * b[0] - a[1] * b[1]", "a[0] * b[0] + a[1] * b[1]")
    assert changed != source
    attitude.write_text(changed)
    with_warm_cache = python(MOTION, tmp_path, **cache).stdout
    fresh = python(MOTION, tmp_path, THRUSTER_ENVS_CACHE_DIR=str(tmp_path / "fresh")).stdout
    assert with_warm_cache == fresh != before


def modules() -> list[str]:
    """All modules of the environments and the baselines."""
    return [
        module.name
        for package in (thruster_envs, thruster_baselines)
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not module.name.endswith(("_v0", "_v1"))
    ]


def compiled_into(module_name: str) -> set[str]:
    """Names of the modules whose compiled functions those of a module call, directly or not."""
    found: set[str] = set()
    waiting = [one for one in vars(import_module(module_name)).values() if isinstance(one, CPUDispatcher)]
    waiting = [one for one in waiting if one.py_func.__module__ == module_name]
    seen = set(map(id, waiting))
    while waiting:
        function = waiting.pop().py_func
        found.add(function.__module__)
        for name in function.__code__.co_names:
            value = function.__globals__.get(name)
            if isinstance(value, CPUDispatcher) and id(value) not in seen:
                seen.add(id(value))
                waiting.append(value)
            elif inspect.ismodule(value) and value.__name__.startswith("thruster_"):
                found.add(value.__name__)
    return found


def test_the_hash_sees_every_source_that_is_compiled_into_a_kernel():
    known = {name: sources_of(name) for name in modules()}
    seen = {name: compiled_into(name) for name in known}
    assert sum(map(bool, seen.values())) > 40
    for name, into in seen.items():
        missed = [one for one in into if not known[name].get(one)]
        assert not missed, f"{name} has functions of {missed} in it"
    assert known["thruster_envs.tasks.orion_rendezvous"].keys() >= {
        "thruster_envs.physics.attitude",
        "thruster_envs.random",
        "thruster_envs.faults.encoding",
    }


def test_every_function_with_a_cache_has_this_one():
    """Numba's own would watch a kernel's own file alone."""
    for name in modules():
        for one in vars(import_module(name)).values():
            if isinstance(one, CPUDispatcher):
                assert type(one._cache).__name__ in ("_KernelCache", "NullCache"), one


@pytest.mark.parametrize(
    ("folder", "followed"), [("site-packages", False), ("dist-packages", False), ("mine", True)]
)
def test_what_is_installed_in_any_environment_is_not_followed(monkeypatch, tmp_path, folder, followed):
    package, kernels = f"beside_{folder[:4]}", f"using_{folder[:4]}"
    (tmp_path / folder).mkdir()
    (tmp_path / folder / f"{package}.py").write_text("FACTOR = 2\n")
    (tmp_path / f"{kernels}.py").write_text(f"import {package}\n")
    monkeypatch.syspath_prepend(tmp_path / folder)
    monkeypatch.syspath_prepend(tmp_path)
    assert (package in sources_of(kernels)) is followed


def test_numbas_version_is_part_of_the_hash(monkeypatch):
    before = source_hash("thruster_envs.random")
    source_hash.cache_clear()
    monkeypatch.setattr("numba.__version__", "0.0.0")
    assert source_hash("thruster_envs.random") != before
    source_hash.cache_clear()


UNSET = {"THRUSTER_ENVS_CACHE_DIR": "", "NUMBA_CACHE_DIR": ""}


@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        ({"THRUSTER_ENVS_CACHE_DIR": "/proc/no/such/place"}, "/proc/no/such/place"),
        (UNSET | {"NUMBA_CACHE_DIR": "/dev/null/below"}, "/dev/null/below"),
        (UNSET | {"HOME": "/proc/1/nobody"}, "/proc/1/nobody"),
        (UNSET | {"XDG_CACHE_HOME": "relative"}, "no home folder"),
    ],
)
def test_without_a_place_kernels_are_compiled_anew_with_one_line(tmp_path, environment, reason):
    toy(tmp_path)
    done = python(CALL + "; print(double(10.0))", tmp_path, **environment)
    assert done.stdout == "21\n21.0\n"
    (line,) = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert reason in line
    assert "THRUSTER_ENVS_CACHE_DIR" in line


def test_a_damaged_file_is_compiled_anew(tmp_path):
    cache = {"THRUSTER_ENVS_CACHE_DIR": str(tmp_path / "cache")}
    toy(tmp_path)
    python(CALLS, tmp_path, **cache)
    files = sorted((tmp_path / "cache").rglob("*.nbc"))
    whole = [file.read_bytes() for file in files]
    damages = [
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: bytes(100),
        lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:],
        lambda data: data[::-1],
    ]
    for file, data, damage in zip(files, whole, damages, strict=True):
        file.write_bytes(damage(data))
    assert python(CALLS, tmp_path, **cache).stdout == "21\n" * len(IMPORTS)
    assert all(file.stat().st_size > len(data) // 2 for file, data in zip(files, whole, strict=True))


def test_signatures_compiled_at_the_same_time_stay_apart(tmp_path):
    """Each has a file of its own name; Numba's own cache may give two the same."""
    toy(tmp_path)
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path),
        "THRUSTER_ENVS_CACHE_DIR": str(tmp_path / "cache"),
    }
    code = "from toy.kernels0 import double; print(double({}))"
    running = [
        subprocess.Popen([sys.executable, "-c", code.format(call)], env=environment)
        for call in ("10", "10.0", "1j")
    ]
    assert [one.wait() for one in running] == [0, 0, 0]
    assert len(list((tmp_path / "cache").rglob("*.nbc"))) == 3
    kept = python("from toy.kernels0 import double; print(*map(double, (10, 10.0, 1j)))", tmp_path,
                  THRUSTER_ENVS_CACHE_DIR=str(tmp_path / "cache"))  # fmt: skip
    assert (kept.stdout, kept.stderr) == ("21 21.0 (1+2j)\n", "")


EVERY_ID = """
from numba.core import event
class Listener(event.Listener):
    compiled = []
    def on_start(self, event):
        self.compiled.append(event.data["dispatcher"].py_func.__qualname__)
    def on_end(self, event):
        pass
event.register("numba:compile", Listener())
import gymnasium as gym, thruster_envs
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.registration import ENVIRONMENTS
for id in ENVIRONMENTS:
    env = gym.make(id)
    envs = gym.make_vec(id, num_envs=33, vectorization_mode="vector_entry_point")
    for one in (env, envs):
        one.reset(seed=0)
        one.step(one.action_space.sample())
for module in (formation_attitude_v1, formation_keeping_v1):
    env = module.parallel_env()
    env.reset(seed=0)
    env.step({agent: env.action_space(agent).sample() for agent in env.agents})
print(Listener.compiled)
"""


def test_with_kept_kernels_nothing_is_compiled_and_nothing_said(tmp_path):
    python(EVERY_ID, tmp_path)
    warm = python(EVERY_ID, tmp_path)
    assert (warm.stdout, warm.stderr) == ("[]\n", "")


def test_the_folder_is_that_of_the_variable_or_of_the_user(monkeypatch, tmp_path):
    for name in ("THRUSTER_ENVS_CACHE_DIR", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert kernel_folder() == tmp_path / "thruster-envs"
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/numba")
    assert kernel_folder() == Path("/numba")
    monkeypatch.setenv("THRUSTER_ENVS_CACHE_DIR", "/ours")
    assert kernel_folder() == Path("/ours")
