"""Making a PettingZoo parallel environment, flying it, and keeping what it returned.

A flight goes on over the ends of episodes: when no agent is left, `reset()` without a seed begins the next
one. Actions come from spaces of the flight's own, for every possible agent in every step, so that they do not
depend on who is still there; an `"action_mask"` in an agent's observation or info is obeyed.
"""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import gymnasium as gym

from thruster_envs.testing.comparison import Difference, first_difference, snapshot

PARTS = ("observations", "rewards", "terminations", "truncations", "infos")


class AnyParallelEnv(Protocol):
    """What the checks use of `pettingzoo.ParallelEnv`."""

    possible_agents: list[Any]
    agents: list[Any]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode: observations and infos by agent."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """Go one step: observations, rewards, terminations, truncations and infos by agent."""

    def observation_space(self, agent: Any) -> gym.Space[Any]:
        """Space of an agent's observations."""

    def action_space(self, agent: Any) -> gym.Space[Any]:
        """Space of an agent's actions."""

    def close(self) -> None:
        """Release what the environment holds."""


@dataclass(frozen=True, kw_only=True)
class ParallelSubject:
    """A parallel environment under check: how to make it, how long and with which seed it is flown."""

    name: str
    make_env: Callable[[], AnyParallelEnv]
    steps: int
    seed: int

    @property
    def other_seed(self) -> int:
        """A seed far from `seed`."""
        return self.seed + 1_000_003

    @contextmanager
    def env(self) -> Iterator[AnyParallelEnv]:
        """Make a fresh environment and close it afterwards."""
        env = self.make_env()
        try:
            yield env
        finally:
            env.close()


def parallel_subject(
    make_env: str | Callable[..., AnyParallelEnv], steps: int, seed: int, kwargs: Mapping[str, Any]
) -> ParallelSubject:
    """Find out how the environment is made, from a PettingZoo id or from a class or function."""
    if isinstance(make_env, str):
        pettingzoo = importlib.import_module("pettingzoo")
        spec = pettingzoo.spec("parallel", make_env)
        return ParallelSubject(
            name=make_env,
            make_env=partial(pettingzoo.make, "parallel", spec, **kwargs),
            steps=steps,
            seed=seed,
        )
    if not callable(make_env):
        raise TypeError(
            f"make_env is {make_env!r}; pass an id, or a class or function that makes a fresh parallel "
            "environment"
        )
    name = getattr(make_env, "__name__", type(make_env).__name__)
    return ParallelSubject(name=name, make_env=partial(make_env, **kwargs), steps=steps, seed=seed)


@dataclass(frozen=True)
class ParallelMoment:
    """What one call returned (by name, then by agent), copied, and the agents before and after it."""

    where: str
    parts: dict[str, Any]
    agents_before: tuple[Any, ...]
    agents: tuple[Any, ...]

    @property
    def is_reset(self) -> bool:
        """Whether the call was a reset."""
        return "rewards" not in self.parts


class ParallelFlight:
    """A parallel environment being flown, one call after the other.

    Args:
        env: The environment.
        seed: Seed of the actions.
        keep: What is done with a return value before it is kept; by default it is copied.
    """

    def __init__(self, env: AnyParallelEnv, seed: int, keep: Callable[[Any], Any] = snapshot) -> None:
        self.env = env
        self.steps = 0
        self._keep = keep
        self._seed = seed
        self._last: dict[str, Any] = {}
        self._spaces: dict[Any, gym.Space[Any]] = {}

    def reset(self, seed: int | None = None) -> ParallelMoment:
        """Reset; with a seed, the actions begin anew as well."""
        before = tuple(getattr(self.env, "agents", ()))
        returned = self.env.reset(seed=seed)
        if seed is not None:
            self.steps = 0
            self.begin_actions()
        where = "reset" if seed is not None else f"reset() after step {self.steps}"
        return self._moment(where, ("observations", "infos"), returned, before)

    def begin_actions(self) -> None:
        """Begin the sequence of actions anew."""
        self._spaces = {agent: deepcopy(self.env.action_space(agent)) for agent in self.env.possible_agents}
        for number, space in enumerate(self._spaces.values()):
            space.seed(self._seed + number)

    def actions(self) -> dict[Any, Any]:
        """Draw the next actions, for the agents that are there."""
        drawn = {agent: space.sample(self._mask(agent)) for agent, space in self._spaces.items()}
        return {agent: drawn[agent] for agent in self.env.agents}

    def step(self, actions: dict[Any, Any]) -> ParallelMoment:
        """Step with these actions, the very objects."""
        before = tuple(self.env.agents)
        returned = self.env.step(actions)
        self.steps += 1
        return self._moment(f"step {self.steps}", PARTS, returned, before)

    def go_on(self) -> Iterator[ParallelMoment]:
        """Step once with the next actions; when nobody is left, begin the next episode too."""
        yield self.step(self.actions())
        if not self.env.agents:
            yield self.reset()

    def fly(self, steps: int, seed: int) -> Iterator[ParallelMoment]:
        """Reset with a seed and go a number of steps."""
        yield self.reset(seed)
        for _ in range(steps):
            yield from self.go_on()

    def _moment(
        self, where: str, names: tuple[str, ...], returned: Any, before: tuple[Any, ...]
    ) -> ParallelMoment:
        self._last = dict(zip(names, returned, strict=True))
        parts = {name: self._keep(part) for name, part in self._last.items()}
        return ParallelMoment(where, parts, before, tuple(self.env.agents))

    def _mask(self, agent: Any) -> Any:
        for name in ("observations", "infos"):
            of_agent = self._last.get(name, {}).get(agent)
            if isinstance(of_agent, Mapping) and "action_mask" in of_agent:
                return of_agent["action_mask"]
        return None


def record(make_env: Callable[[], AnyParallelEnv], steps: int, seed: int) -> list[ParallelMoment]:
    """Fly a fresh environment from a seeded reset and give all that it returned."""
    env = make_env()
    try:
        return list(ParallelFlight(env, seed).fly(steps, seed))
    finally:
        env.close()


def record_in_another_process(subject: ParallelSubject) -> list[ParallelMoment]:
    """Do what `record` does in a fresh Python, with another hash seed (hence another order of sets).

    Raises:
        ValueError: `make_env` cannot be sent to another process.
        RuntimeError: The other process failed.
    """
    task = task_for_another_process(subject)
    with tempfile.TemporaryDirectory() as folder:
        task_file, result_file = Path(folder, "task"), Path(folder, "result")
        task_file.write_bytes(pickle.dumps((sys.path, task)))
        hash_seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
        done = subprocess.run(
            [sys.executable, "-c", _IN_THE_OTHER_PROCESS, str(task_file), str(result_file)],
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:]
            raise RuntimeError(f"flying {subject.name} in another process failed: {' '.join(last)}")
        moments: list[ParallelMoment] = pickle.loads(result_file.read_bytes())
    return moments


def task_for_another_process(subject: ParallelSubject) -> bytes:
    """Write down what another process is to fly.

    Raises:
        ValueError: `make_env` cannot be sent to another process.
    """
    try:
        return pickle.dumps((subject.make_env, subject.steps, subject.seed))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(
            f"make_env of {subject.name} cannot be sent to another process ({error}); "
            "pass an id or a function that stands at the top of a module"
        ) from error


def moment_difference(moment: ParallelMoment, right: ParallelMoment) -> Difference | None:
    """Find the first difference between what two calls returned, and between the agents that they left."""
    return first_difference(
        {"agents": moment.agents, **moment.parts}, {"agents": right.agents, **right.parts}, "returned"
    )


_IN_THE_OTHER_PROCESS = """
import pickle, sys
from pathlib import Path
sys.path[:], task = pickle.loads(Path(sys.argv[1]).read_bytes())
from thruster_envs.testing.parallel.flights import record
make_env, steps, seed = pickle.loads(task)
Path(sys.argv[2]).write_bytes(pickle.dumps(record(make_env, steps, seed)))
"""
