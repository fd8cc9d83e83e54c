"""A tiny environment in three forms, right in every respect that the checkers look at.

A point drifts on a line: it is pushed by two thrusters and by noise, loses when it leaves the bounds, and
runs out of time. It exists as a single environment, as a native vector environment and as a parallel
environment of two agents.
"""

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

BOUND = 2.0
OBSERVATIONS = Box(-8.0, 8.0, (2,), np.float32)
ACTIONS = Box(-1.0, 1.0, (2,), np.float32)


def pushed(position, action, noise):
    """Where the point is after a step; position, noise: (...,), action: (..., 2)."""
    action = action.astype(np.float64)
    return position + 0.5 * (action[..., 0] + action[..., 1]) + 0.3 * noise


class Drift(gym.Env):
    """The single environment."""

    observation_space, action_space = OBSERVATIONS, ACTIONS

    def __init__(self, max_episode_steps=8):
        self.max_episode_steps = max_episode_steps

    def observation(self):
        return np.array([self.position, self.clock / 8.0], dtype=np.float32)

    def info(self):
        return {"effort": self.effort, "terms": {"miss": self.position * self.position, "clock": self.clock}}

    def reward(self):
        return -abs(self.position)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position, self.clock, self.effort = self.np_random.uniform(-1.0, 1.0), 0, 0.0
        return self.observation(), self.info()

    def step(self, action):
        self.position = pushed(self.position, action, self.np_random.normal())
        self.clock += 1
        self.effort += float(abs(action[0]))
        terminated = bool(abs(self.position) > BOUND)
        truncated = self.clock >= self.max_episode_steps
        return self.observation(), float(self.reward()), terminated, truncated, self.info()


class DriftVector(VectorEnv):
    """The native vector environment: one generator for each copy, arrays that belong to the caller."""

    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP, max_episode_steps=8):
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.max_episode_steps = max_episode_steps
        self.single_observation_space, self.single_action_space = OBSERVATIONS, ACTIONS
        self.observation_space = batch_space(OBSERVATIONS, num_envs)
        self.action_space = batch_space(ACTIONS, num_envs)
        self.generators = [np_random(None)[0] for _ in range(num_envs)]
        self.position, self.effort = np.zeros(num_envs), np.zeros(num_envs)
        self.clock = np.zeros(num_envs, dtype=np.int64)
        self.over = np.zeros(num_envs, dtype=np.bool_)

    # what the broken ones replace

    def accept(self, actions):
        if actions.shape != self.action_space.shape:
            raise ValueError(f"actions have shape {actions.shape}, not {self.action_space.shape}")
        return actions

    def accept_mask(self, mask):
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"the mask is {mask!r}, not a boolean array of shape ({self.num_envs},)")
        if not mask.any():
            raise ValueError("the mask has no True")
        return mask

    def seed_copies(self, seed, mask):
        if seed is None:
            return
        seeds = seed if isinstance(seed, list) else [seed + copy for copy in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} copies")
        for copy in np.flatnonzero(mask):
            self.generators[copy] = np_random(seeds[copy])[0]

    def begin(self, copy):
        self.position[copy] = self.generators[copy].uniform(-1.0, 1.0)
        self.clock[copy], self.effort[copy] = 0, 0.0

    def begin_by_itself(self, copy):
        self.begin(copy)

    def noise(self, moving):
        return np.array(
            [
                generator.normal() if moves else 0.0
                for generator, moves in zip(self.generators, moving, strict=True)
            ]
        )

    def observations(self):
        return np.stack([self.position, self.clock / 8.0], axis=-1).astype(np.float32)

    def rewards(self, actions):
        return -np.abs(self.position)

    def infos(self):
        every = np.ones(self.num_envs, dtype=np.bool_)
        return {
            "effort": self.effort.copy(),
            "_effort": every.copy(),
            "terms": {
                "miss": self.position * self.position,
                "_miss": every.copy(),
                "clock": self.clock.copy(),
                "_clock": every.copy(),
            },
            "_terms": every,
        }

    def final(self, done):
        return {
            "final_obs": self.observations(),
            "_final_obs": done.copy(),
            "final_info": self.infos(),
            "_final_info": done.copy(),
        }

    # the two calls

    def reset(self, *, seed=None, options=None):
        every = np.ones(self.num_envs, dtype=np.bool_)
        mask = self.accept_mask(options["reset_mask"]) if options and "reset_mask" in options else every
        self.seed_copies(seed, mask)
        for copy in np.flatnonzero(mask):
            self.begin(copy)
        self.over = self.over & ~mask
        return self.observations(), self.infos()

    def step(self, actions):
        actions = self.accept(actions)
        begins = self.over & (self.autoreset_mode is AutoresetMode.NEXT_STEP)
        moved = pushed(self.position, actions, self.noise(~begins))
        self.position = np.where(begins, self.position, moved)
        self.clock = np.where(begins, self.clock, self.clock + 1)
        self.effort = np.where(begins, self.effort, self.effort + np.abs(actions[:, 0]))
        for copy in np.flatnonzero(begins):
            self.begin_by_itself(copy)
        rewards = np.where(begins, 0.0, self.rewards(actions))
        terminations = ~begins & (np.abs(self.position) > BOUND)
        truncations = ~begins & (self.clock >= self.max_episode_steps)
        self.over = terminations | truncations
        final = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self.over.any():
            final = self.final(self.over)
            for copy in np.flatnonzero(self.over):
                self.begin_by_itself(copy)
        return self.observations(), rewards, terminations, truncations, {**self.infos(), **final}


class DriftParallel:
    """The parallel environment: two points with one generator; the episode ends when either is lost."""

    metadata = {"name": "drift_v0", "is_parallelizable": True, "render_modes": []}  # noqa: RUF012 - PettingZoo's form

    def __init__(self, max_cycles=8):
        self.max_cycles = max_cycles
        self.possible_agents = ["left", "right"]
        self.agents = []
        self.generator = np_random(None)[0]
        self.spaces = dict.fromkeys(self.possible_agents, (OBSERVATIONS, ACTIONS))

    def observation_space(self, agent):
        return self.spaces[agent][0]

    def action_space(self, agent):
        return self.spaces[agent][1]

    # what the broken ones replace

    def seed(self, seed):
        if seed is not None:
            self.generator = np_random(seed)[0]

    def noise(self):
        return self.generator.normal()

    def observations(self):
        return {
            agent: np.array([position, self.clock / 8.0], dtype=np.float32)
            for agent, position in self.positions.items()
        }

    def rewards(self):
        return {agent: -abs(position) for agent, position in self.positions.items()}

    def infos(self):
        return {agent: {"miss": position * position} for agent, position in self.positions.items()}

    def ended(self):
        lost = any(abs(position) > BOUND for position in self.positions.values())
        late = self.clock >= self.max_cycles
        return dict.fromkeys(self.agents, lost), dict.fromkeys(self.agents, late)

    # the calls

    def reset(self, seed=None, options=None):
        self.seed(seed)
        self.agents = self.possible_agents[:]
        self.clock = 0
        self.positions = {agent: self.generator.uniform(-1.0, 1.0) for agent in self.agents}
        return self.observations(), self.infos()

    def step(self, actions):
        for agent in self.agents:
            self.positions[agent] = float(pushed(self.positions[agent], actions[agent], self.noise()))
        self.clock += 1
        terminations, truncations = self.ended()
        if any(terminations.values()) or any(truncations.values()):
            self.agents = []
        return self.observations(), self.rewards(), terminations, truncations, self.infos()

    def close(self):
        pass
