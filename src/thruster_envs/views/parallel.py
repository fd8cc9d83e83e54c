"""A world's craft as the agents of a PettingZoo ``ParallelEnv``."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from thruster_envs.tasks import FormationKeeping
from thruster_envs.views.scenes import RENDER_MODES, Camera
from thruster_envs.views.single import checked_render_mode, make_task
from thruster_envs.views.spaces import action_space, observation_space
from thruster_envs.views.worlds import Step, Worlds, checked_seed

Observation = NDArray[np.float32]
_ONE = np.zeros(1, np.int64)


class FormationParallelEnv(ParallelEnv[str, Observation, Observation]):  # type: ignore[misc]  # PettingZoo publishes no types
    """PAGE"""

    metadata: ClassVar[dict[str, Any]] = {
        "name": "formation_keeping_v0",
        "render_modes": list(RENDER_MODES),
        "is_parallelizable": True,
        "render_fps": 20,
    }

    def __init__(
        self, *, max_cycles: int | None = None, render_mode: str | None = None, **configuration: Any
    ) -> None:
        self.task = make_task(FormationKeeping, configuration, {})
        self.max_cycles = max_cycles if max_cycles is not None else self.task.max_episode_steps
        self.render_mode = checked_render_mode(render_mode)
        self.worlds = Worlds(self.task, 1, max_episode_steps=self.max_cycles)
        self.possible_agents = list(self.task.agents)
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_space(self.task) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space(self.task) for agent in self.possible_agents}
        box = self.observation_spaces[self.possible_agents[0]]
        self.state_space = spaces.Box(
            np.tile(box.low, len(self.possible_agents)),
            np.tile(box.high, len(self.possible_agents)),
            dtype=np.float32,
        )
        self._generator = np.random.default_rng()
        self._camera = Camera(self.worlds, 0, "FormationKeeping")

    def observation_space(self, agent: str) -> spaces.Box:
        """The same object at every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """The same object at every call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode with every agent; ``options={"faults": ...}`` gives it faults of its own."""
        if seed is not None or not self.worlds.seeded:
            fresh = checked_seed(seed) if seed is not None else int(self._generator.integers(2**63))
            self.worlds.seed(_ONE, [fresh])
        self.worlds.reset(_ONE, options)
        self.agents = list(self.possible_agents)
        self._watch(begins=True)
        return self._by_agent(self.worlds.observe()[0]), self._infos(None)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Let one control period pass; all agents end together."""
        if not self.agents:
            raise ValueError("the episode is over or has not begun; call reset() before step()")
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(
                f"no action for {', '.join(missing)}; one for each of {', '.join(self.agents)} would be right"
            )
        self.worlds.max_episode_steps = self.max_cycles
        step = self.worlds.step(np.stack([np.asarray(actions[agent]) for agent in self.agents])[np.newaxis])
        self._watch(begins=False)
        agents = self.agents
        rewards = {agent: float(step.rewards[0, k]) for k, agent in enumerate(agents)}
        terminations = {agent: bool(step.terminated[0]) for agent in agents}
        truncations = {agent: bool(step.truncated[0]) for agent in agents}
        observations, infos = self._by_agent(step.observations[0]), self._infos(step)
        if step.done[0]:
            self.agents = []
        return observations, rewards, terminations, truncations, infos

    def _by_agent(self, rows: Observation) -> dict[str, Observation]:
        return {agent: rows[k].copy() for k, agent in enumerate(self.agents)}

    def _infos(self, step: Step | None) -> dict[str, dict[str, Any]]:
        info = self.worlds.info(step)
        return {
            agent: {
                "reward_terms": {name: float(values[0, k]) for name, values in info["reward_terms"].items()},
                "cost": float(info["cost"][0, k]),
                "fault": {name: values[0, k].copy() for name, values in info["fault"].items()},
                "fuel": float(info["fuel"][0, k]),
                "score": float(info["score"][0, k]),
                "success": bool(info["success"][0, k]),
            }
            for k, agent in enumerate(self.agents)
        }

    def state(self) -> Observation:
        """The observations of all agents, one after another."""
        return np.ravel(self.worlds.observe()[0])

    def _watch(self, *, begins: bool) -> None:
        if self.render_mode is not None:
            if begins:
                self._camera.begin()
            else:
                self._camera.follow()
            if self.render_mode == "human":
                self._camera.show()

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the formation now, in the mode ``rgb_array``."""
        if self.render_mode == "rgb_array":
            return self._camera.frame()
        if self.render_mode == "human":
            self._camera.show()
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        self._camera.close()
