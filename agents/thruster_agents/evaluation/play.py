"""Episodes of a method on given seeds: the same commands and faults for every method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from thruster_agents.environments import make_plain
from thruster_envs.spacecraft import Spacecraft

__all__ = ["DEAD", "FAULTS", "HEALTHY", "SCENARIOS", "Method", "Play", "Scenario", "play"]


@dataclass(frozen=True)
class Scenario:
    """What faults the worlds have.

    Attributes:
        name: Key in files.
        title: For people.
        faults: As the task takes them.
    """

    name: str
    title: str
    faults: Any


HEALTHY = Scenario("healthy", "healthy", [])
FAULTS = Scenario("faults", "faults drawn by the task", None)
DEAD = Scenario("dead", "one thruster dead", {"probability": 1.0, "kinds": ["stuck_off"]})
SCENARIOS = (HEALTHY, FAULTS, DEAD)


class Method(Protocol):
    """Something that commands thrusters in a batch of worlds."""

    key: str
    title: str
    sees: str

    def begin(self, env: VectorEnv[Any, Any, Any], seed: int) -> VectorEnv[Any, Any, Any]:
        """Get ready for new episodes in these worlds; returns the environment to act in, wrapped if need be."""
        ...

    def act(self, observations: NDArray[np.float32]) -> NDArray[Any]:
        """Actions (worlds, n) in [-1, 1]."""
        ...


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
    env = method.begin(plain, seeds.start)
    observations, _ = env.reset(seed=seeds.start)
    rewards, over = [], np.zeros(len(seeds), np.bool_)
    while not over.all():
        observations, reward, terminated, truncated, info = env.step(method.act(observations))
        rewards.append(reward)
        over = terminated | truncated
    env.close()
    return Play(info["score"].copy(), np.array(rewards))
