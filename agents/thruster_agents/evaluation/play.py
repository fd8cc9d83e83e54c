"""Episodes of a method on given seeds: the same commands and faults for every method."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from thruster_agents.environments import make_plain
from thruster_envs.rollout import fly
from thruster_envs.spacecraft import Spacecraft

__all__ = ["DEAD", "FAULTS", "HEALTHY", "SCENARIOS", "Method", "Play", "Scenario", "play"]


@dataclass(frozen=True)
class Scenario:
    """What faults the worlds have.

    Attributes:
        name: Key in files.
        title: For people, short.
        faults: As the task takes them: an empty list for none, None for its default distribution.
    """

    name: str
    title: str
    faults: Any


HEALTHY = Scenario("healthy", "healthy", [])
FAULTS = Scenario("faults", "faults drawn", None)
DEAD = Scenario("dead", "one dead", {"probability": 1.0, "kinds": ["stuck_off"]})
SCENARIOS = (HEALTHY, FAULTS, DEAD)


class Method(ABC):
    """Something that commands thrusters in a batch of worlds.

    Attributes:
        key: In files.
        title: For people.
        sees: What it is allowed to see, in a word.
    """

    key: str
    title: str
    sees: str

    @abstractmethod
    def begin(self, env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        """Get ready for new episodes in these worlds; returns the environment to act in."""

    @abstractmethod
    def act(self, observations: NDArray[np.float32]) -> NDArray[Any]:
        """Actions (worlds, n) in [-1, 1]."""


@dataclass(frozen=True)
class Play:
    """What came of it.

    Attributes:
        scores: (episodes,), 0..1.
        rewards: (commands, episodes), minus the objective, in the task's unit.
    """

    scores: NDArray[np.float64]
    rewards: NDArray[np.float64]


def play(method: Method, scenario: Scenario, seeds: range, spacecraft: Spacecraft) -> Play:
    """One episode on each seed.

    Args:
        method: Who commands.
        scenario: Which faults.
        seeds: Consecutive.
        spacecraft: What flies.
    """
    plain = make_plain(spacecraft, len(seeds), faults=scenario.faults, autoreset_mode=AutoresetMode.DISABLED)
    env = method.begin(plain)
    flown = fly(env, method.act, seeds, record=("reward", "score"))
    env.close()
    return Play(flown.final("score"), np.ascontiguousarray(flown.padded("reward").T))
