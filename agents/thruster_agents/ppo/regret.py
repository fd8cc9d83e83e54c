"""The training reward: the task's reward plus what the command would have cost a healthy vehicle at least.

What is added depends on the command alone and on nothing that the policy does: a baseline. It takes the
luck of an easy or a hard command out of the reward, so that what is left is regret: 0 for a healthy vehicle
mapped perfectly. Scores are never computed from it.
"""

from __future__ import annotations

from typing import Any

from gymnasium.vector import VectorEnv, VectorWrapper

from thruster_envs.protocols import Mapper

__all__ = ["RegretReward"]


class RegretReward(VectorWrapper):
    """Adds a mapper's own objective for the command to the reward, and scales the sum.

    Args:
        env: `ThrusterMapping-v0` as a vector environment, wrapped or not.
        mapper: A mapper whose cost is the task's objective: the LP with its default weights.
        scale: What the sum is multiplied by.
    """

    any_autoreset_mode = True

    def __init__(self, env: VectorEnv[Any, Any, Any], mapper: Mapper, scale: float = 10.0) -> None:
        super().__init__(env)
        self._state = env.unwrapped.worlds.state
        self._mapper, self._factor = mapper, scale
        self._unit = self._state.model.scale

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of all worlds."""
        least = self._mapper(self._state.command).cost / self._unit
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        return observations, self._factor * (rewards + least), terminated, truncated, infos
