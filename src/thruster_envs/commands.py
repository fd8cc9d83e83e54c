"""The command ``thruster-envs``.

``thruster-envs describe`` says what a spacecraft can do; ``thruster-envs warmup`` compiles the kernels before
anyone waits for them. They are compiled by use: every environment is made, reset and stepped, once as a
single environment, once as a batch and, where it has one and PettingZoo is installed, as a parallel
environment. What is compiled is kept as :mod:`thruster_envs.kernels` says.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple, Self

import gymnasium as gym
import numpy as np
from numba.core import event

from thruster_envs import kernels
from thruster_envs.configuration import nearest, suggestion
from thruster_envs.registration import ENVIRONMENTS, register_all
from thruster_envs.spacecraft import catalogue, describe

PROGRAM = "thruster-envs"
#: Worlds of the batches by which kernels for batches are compiled: there are some for small ones.
_WORLDS = {"batch of 8": 8, "large batch": 33}
_STEPS = 2


class Use(NamedTuple):
    """One use of an environment, which compiles what it needs."""

    identifier: str
    form: str
    spacecraft: str | None

    def __str__(self) -> str:
        name = self.identifier.removeprefix("thruster_envs/")
        return f"{name}, {self.form}" + ("" if self.spacecraft is None else f", {self.spacecraft}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns:
        The status: 0, 1 where kernels cannot be kept, 2 for wrong arguments, 130 after Ctrl-C.
    """
    parser = argparse.ArgumentParser(PROGRAM, description="Commands of thruster-envs.")
    commands = parser.add_subparsers(dest="command", required=True)
    warm = commands.add_parser(
        "warmup",
        help="compile the kernels of environments now",
        description="Compile the kernels of environments now and keep them, so that no first step waits.",
    )
    warm.add_argument(
        "environments", nargs="*", metavar="ID",
        help="which, as OrionRendezvous-v1 or thruster_envs/OrionRendezvous-v1; all by default",
    )  # fmt: skip
    warm.add_argument(
        "--spacecraft", nargs="+", metavar="NAME",
        help="for which vehicles: names in the catalogue or TOML files; by default each environment's own, "
        "and where no ID is given the whole catalogue",
    )  # fmt: skip
    summary = commands.add_parser(
        "describe",
        help="say what a spacecraft can do",
        description="Authority per axis, what is lost without each thruster, shortest pulses, pairs alike.",
    )
    summary.add_argument("spacecraft", metavar="NAME_OR_FILE", help="a name in the catalogue or a TOML file")
    given = parser.parse_args(arguments)
    try:
        if given.command == "describe":
            sys.stdout.write(f"{describe(given.spacecraft)}\n")
            return 0
        identifiers = [_identifier(name) for name in given.environments]
        return _warm_up(identifiers or list(ENVIRONMENTS), _vehicles(given.spacecraft, bool(identifiers)))
    except ValueError as error:
        _say(f"{PROGRAM} {given.command}: {error}")
        return 2
    except KeyboardInterrupt:
        _say(f"\n{PROGRAM} warmup: interrupted; what was compiled is kept")
        return 130


def _identifier(name: str) -> str:
    full = name if "/" in name else f"thruster_envs/{name}"
    if full not in ENVIRONMENTS:
        known = [one.removeprefix("thruster_envs/") for one in ENVIRONMENTS]
        raise ValueError(
            f"ID must be that of an environment, got {name!r}; "
            f"{suggestion(name.removeprefix('thruster_envs/'), known)}"
        )
    return full


def _vehicles(names: Sequence[str] | None, chosen: bool) -> list[str | None]:
    """For which vehicles each environment is used; None is its own."""
    if names is None:
        return [None] if chosen else [None, *catalogue()]
    for name in names:
        if name not in catalogue() and not os.path.exists(name):
            near = nearest(name, catalogue())
            raise ValueError(
                f"--spacecraft must be a name in the catalogue ({', '.join(catalogue())}) or a file, "
                f"got {name!r}" + ("" if near is None else f"; did you mean {near!r}?")
            )
    return list(names)


def _warm_up(identifiers: Sequence[str], vehicles: Sequence[str | None]) -> int:
    folder = kernels.kernel_folder()
    if folder is None or not _can_be_written(folder):
        where = "there is no home folder" if folder is None else f"{folder} cannot be written"
        _say(f"{PROGRAM} warmup: kernels cannot be kept: {where}; THRUSTER_ENVS_CACHE_DIR may name a folder")
        return 1
    register_all()
    uses = [
        Use(identifier, form, vehicle)
        for identifier in identifiers
        for vehicle in vehicles
        for form in _forms(identifier)
    ]
    start = time.perf_counter()
    kernels._Announcer.said = True  # the bar says more
    with _Compilations() as compiled:
        for number, use in enumerate(uses):
            _show(number, len(uses), str(use), compiled.count)
            _use(use, optional=use.spacecraft is not None and len(identifiers) > 1)
        _show(len(uses), len(uses), "done", compiled.count)
    if sys.stderr.isatty():
        _say("")
    taken = f"{time.perf_counter() - start:.0f} s"
    if compiled.count == 0:
        _say(f"nothing was to be compiled ({taken}); kernels are kept in {folder}")
    else:
        _say(f"{compiled.count} kernels compiled in {taken}; they are kept in {folder}")
    return 0


class _Compilations(event.Listener):
    """Counts the kernels of this package that are compiled while it is entered."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        event.register("numba:compile", self)  # type: ignore[no-untyped-call]  # Numba publishes no types
        return self

    def __exit__(self, *_: object) -> None:
        event.unregister("numba:compile", self)  # type: ignore[no-untyped-call]

    def on_start(self, event: Any) -> None:
        """Count what is kept by itself: helpers are compiled into kernels, and again at their next use."""
        self.count += isinstance(event.data["dispatcher"]._cache, kernels._KernelCache)

    def on_end(self, event: Any) -> None:
        """Nothing to do."""


def _forms(identifier: str) -> Iterator[str]:
    yield from ("single", *_WORLDS)
    if identifier in _PARALLEL and find_spec("pettingzoo") is not None:
        yield "parallel"


#: Id to the module of its PettingZoo form.
_PARALLEL = {
    "thruster_envs/FormationKeeping-v1": "thruster_envs.formation_keeping_v1",
    "thruster_envs/FormationAttitude-v1": "thruster_envs.formation_attitude_v1",
}


def _use(use: Use, *, optional: bool) -> None:
    """Make an environment and step it; where it is optional, one that refuses its vehicle is left out."""
    configuration: dict[str, Any] = {} if use.spacecraft is None else {"spacecraft": use.spacecraft}
    try:
        env = _made(use, configuration)
    except ValueError:
        if optional:
            return
        raise
    env.reset(seed=0)
    for _ in range(_STEPS):
        if use.form == "parallel":
            env.step({agent: _middle(env.action_space(agent)) for agent in env.agents})
        else:
            env.step(_middle(env.action_space))
    env.close()


def _made(use: Use, configuration: dict[str, Any]) -> Any:
    if use.form == "parallel":
        from importlib import import_module

        return import_module(_PARALLEL[use.identifier]).parallel_env(**configuration)
    if use.form in _WORLDS:
        return gym.make_vec(use.identifier, num_envs=_WORLDS[use.form], **configuration)
    return gym.make(use.identifier, **configuration)


def _middle(space: gym.Space[Any]) -> Any:
    """An action that any space has."""
    return np.zeros(space.shape or (), space.dtype)


def _show(done: int, total: int, what: str, compiled: int) -> None:
    """A bar on a terminal, a line elsewhere."""
    width = 24
    bar = "#" * (width * done // total)
    line = f"[{bar:<{width}}] {done}/{total} {what} ({compiled} kernels compiled)"
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{line[:110]:<110}")
    elif done < total:
        sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _can_be_written(folder: Any) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
