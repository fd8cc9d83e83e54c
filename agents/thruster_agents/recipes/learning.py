"""Learning by a recipe: one seed, one policy, with the processor time that it took."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.utils import LinearSchedule

from thruster_agents.ppo.checkpoint import POLICY, read_policy, restore_policy, write_policy
from thruster_agents.recipes.recipes import PPOSettings, Recipe
from thruster_envs.seeds import first_training_seed
from thruster_envs.views import SB3VecEnv

__all__ = ["Learnt", "Scales", "learn", "load", "write"]


class Learnt(NamedTuple):
    """What a training leaves.

    Attributes:
        model: The policy.
        minutes: Processor time.
        curve: Steps so far, and the mean score of the episodes that ended since the rollout before.
    """

    model: PPO
    minutes: float
    curve: list[tuple[int, float]]


class Scales(BaseFeaturesExtractor):
    """``tanh(scale * x)`` of every entry, for each scale, so that far and near are both seen."""

    def __init__(self, observation_space: gym.spaces.Box, scales: tuple[float, ...]) -> None:
        super().__init__(observation_space, len(scales) * observation_space.shape[0])
        self.scales = scales

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """(rows, entries) to (rows, scales times entries)."""
        return torch.cat([torch.tanh(scale * observations) for scale in self.scales], dim=1)


def learn(recipe: Recipe, seed: int, progress: Callable[[int, float | None], None] | None = None) -> Learnt:
    """Train a policy.

    On one machine, with one thread of torch, the same recipe and seed give the same policy.

    Args:
        recipe: What is learnt, and how.
        seed: Of the network and of the worlds, which no other seed shares.
        progress: Called after each rollout with the steps so far and the mean score of the episodes that
            ended.
    """
    begun = time.process_time()
    worlds = _worlds(recipe, recipe.ppo.worlds)
    worlds.seed(first_training_seed(seed, recipe.ppo.worlds))
    torch.manual_seed(seed)
    np.random.seed(seed)  # noqa: NPY002  # SB3 shuffles with NumPy's global generator
    model, teller = _model(recipe.ppo, worlds), _Teller(progress)
    model.learn(recipe.steps, callback=teller)
    worlds.close()
    return Learnt(model, (time.process_time() - begun) / 60.0, teller.curve)


def write(folder: Path, recipe: Recipe, model: PPO) -> None:
    """Write the weights of a policy, with the recipe that they were learnt by."""
    write_policy(folder, recipe, model)


def load(folder: Path, recipe: Recipe) -> PPO:
    """The policy that `write` left; nothing is unpickled.

    Raises:
        ValueError: No such file, a damaged one, or one of another recipe; one line.
    """
    weights = read_policy(folder, recipe)
    worlds = _worlds(recipe, 1)
    with torch.random.fork_rng(devices=[]):
        model = _model(recipe.ppo, worlds)
    worlds.close()
    restore_policy(folder / POLICY, weights, model)
    return model


def _worlds(recipe: Recipe, number: int) -> SB3VecEnv:
    return SB3VecEnv(recipe.variant.make_vec(number, autoreset_mode=AutoresetMode.SAME_STEP, threads=1))


def _model(ppo: PPOSettings, worlds: SB3VecEnv) -> PPO:
    options: dict[str, Any] = {
        "net_arch": [ppo.width, ppo.width],
        "features_extractor_class": Scales,
        "features_extractor_kwargs": {"scales": ppo.scales},
    }
    if isinstance(worlds.action_space, gym.spaces.Box):
        options["log_std_init"] = float(np.log(ppo.exploration))
    model = PPO(
        "MlpPolicy",
        worlds,
        n_steps=ppo.rollout,
        batch_size=min(ppo.minibatch, ppo.rollout * worlds.num_envs),
        n_epochs=ppo.epochs,
        learning_rate=LinearSchedule(ppo.learning_rate, 0.0, 1.0),
        gamma=ppo.discount,
        gae_lambda=ppo.trace,
        clip_range=ppo.clip,
        ent_coef=ppo.entropy,
        policy_kwargs=options,
        device="cpu",
    )
    model.set_logger(configure(None, []))
    return model


class _Teller(BaseCallback):
    """Keeps the curve and reports progress."""

    def __init__(self, progress: Callable[[int, float | None], None] | None) -> None:
        super().__init__()
        self.progress, self.curve, self._scores = progress, [], []

    def _on_step(self) -> bool:
        self._scores.extend(float(info["score"]) for info in self.locals["infos"] if "score" in info)
        return True

    def _on_rollout_end(self) -> None:
        if self._scores:
            self.curve.append((self.num_timesteps, float(np.mean(self._scores))))
            self._scores = []
        if self.progress is not None:
            self.progress(self.num_timesteps, self.curve[-1][1] if self.curve else None)
