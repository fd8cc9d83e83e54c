"""Training of one policy: worlds, PPO, a curve on validation seeds, checkpoints.

A training run is a function of its settings: on one machine, with one number of torch threads, the same
settings give the same bits, interrupted or not.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import LinearSchedule

from thruster_agents.environments import Form, make_plain, on_form
from thruster_agents.evaluation.methods import Learned
from thruster_agents.evaluation.play import FAULTS, play
from thruster_agents.policies import DiagnosisPolicy
from thruster_agents.ppo.checkpoint import Point, read_checkpoint, restore, write_checkpoint
from thruster_agents.ppo.regret import RegretReward
from thruster_baselines.mapping import LPMapper
from thruster_envs.seeds import VALIDATION, first_training_seed
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.views import SB3VecEnv

__all__ = ["Settings", "Trained", "train"]

#: Commands of an episode; a rollout is one episode of every world.
EPISODE = 32


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a training run depends on.

    Attributes:
        spacecraft: What flies.
        form: What an action is.
        seed: Of the network and of the worlds.
        steps: Environment steps, over all worlds; rounded up to whole rollouts.
        worlds: Environments side by side.
        learning_rate: At the start; it falls linearly to 0.
        minibatch: Samples to a gradient step.
        epochs: Passes over a rollout.
        discount: Per command.
        trace: Decay of the advantage estimate (lambda).
        exploration: Standard deviation of actions at the start.
        checkpoint_every: Rollouts between checkpoints.
        validate_every: Rollouts between points of the curve.
        validation_worlds: Episodes to a point of the curve.
    """

    spacecraft: Spacecraft
    form: Form
    seed: int
    steps: int
    worlds: int
    learning_rate: float
    minibatch: int
    epochs: int
    discount: float
    trace: float
    exploration: float
    checkpoint_every: int
    validate_every: int
    validation_worlds: int

    @property
    def rollouts(self) -> int:
        """Whole rollouts."""
        return math.ceil(self.steps / (EPISODE * self.worlds))


@dataclass(frozen=True)
class Trained:
    """What a training run leaves.

    Attributes:
        model: The policy, with its optimiser.
        curve: Points of the validation curve.
        seconds: Wall-clock time of the training, interruptions not counted.
    """

    model: PPO
    curve: tuple[Point, ...]
    seconds: float


def train(
    settings: Settings,
    folder: Path,
    *,
    tensorboard: Path | None = None,
    progress: Callable[[int, Point | None], None] | None = None,
) -> Trained:
    """Train a policy, or go on with what lies in the folder.

    Args:
        settings: The same as before, where there is something to go on with.
        folder: Takes `checkpoint.pt`, and at the end `model.zip`.
        tensorboard: Folder of the TensorBoard log; None for no log.
        progress: Called after each rollout with the steps so far and the last point of the curve.
    """
    folder.mkdir(parents=True, exist_ok=True)
    env = make_plain(settings.spacecraft, settings.worlds, autoreset_mode=AutoresetMode.SAME_STEP)
    acting = on_form(env, settings.form, settings.spacecraft)
    rewarded = RegretReward(acting, LPMapper(settings.spacecraft, threads=1))
    worlds = SB3VecEnv(rewarded)
    worlds.seed(first_training_seed(settings.seed, settings.worlds))
    model = _new_model(settings, worlds)
    if tensorboard is not None:
        model.set_logger(configure(str(tensorboard), ["tensorboard"]))
    else:
        model.set_logger(configure(None, []))
    clerk = _Clerk(settings, folder / "checkpoint.pt", acting, progress)
    saved = read_checkpoint(clerk.path)
    if saved is not None:
        worlds.reset()
        clerk.curve, clerk.seconds = restore(saved, model, acting)
    total = settings.rollouts * EPISODE * settings.worlds
    remaining = total - model.num_timesteps
    if remaining > 0:
        model.learn(remaining, callback=clerk, reset_num_timesteps=saved is None)
        clerk.finish()
    model.save(folder / "model.zip")
    model.logger.close()
    worlds.close()
    return Trained(model, tuple(clerk.curve), clerk.seconds)


def _new_model(settings: Settings, worlds: SB3VecEnv) -> PPO:
    beliefs = settings.form == "beliefs"
    policy: Any = DiagnosisPolicy if beliefs else "MlpPolicy"
    options: dict[str, Any] = {"log_std_init": math.log(settings.exploration)}
    if not beliefs:
        options["net_arch"] = {"pi": [128, 128], "vf": [128, 128]}
    # SB3's own seeding would also seed the worlds, whose seeds are set apart.
    torch.manual_seed(settings.seed)
    np.random.seed(settings.seed)  # noqa: NPY002  # SB3 shuffles with NumPy's global generator
    model = PPO(
        policy,
        worlds,
        n_steps=EPISODE,
        batch_size=min(settings.minibatch, EPISODE * settings.worlds),
        n_epochs=settings.epochs,
        learning_rate=LinearSchedule(settings.learning_rate, 0.0, 1.0),
        gamma=settings.discount,
        gae_lambda=settings.trace,
        policy_kwargs=options,
        device="cpu",
    )
    if not beliefs:
        with torch.no_grad():
            model.policy.action_net.bias.fill_(-1.0)
    return model


class _Clerk(BaseCallback):
    """Keeps the curve, reports progress and writes checkpoints, all between rollouts."""

    def __init__(
        self,
        settings: Settings,
        path: Path,
        acting: Any,
        progress: Callable[[int, Point | None], None] | None,
    ) -> None:
        super().__init__()
        self.settings, self.path, self.acting, self.progress = settings, path, acting, progress
        self.curve: list[Point] = []
        self.seconds = 0.0
        self._begun = time.perf_counter()
        self._scores: list[float] = []

    def _on_training_start(self) -> None:
        self._begun = time.perf_counter()

    def _on_step(self) -> bool:
        self._scores.extend(info["score"] for info in self.locals["infos"] if "score" in info)
        return True

    def _on_rollout_start(self) -> None:
        self._between()

    def _on_rollout_end(self) -> None:
        if self._scores:
            self.logger.record("rollout/score", float(np.mean(self._scores)))
            self._scores.clear()

    def finish(self) -> None:
        """The last point and the last checkpoint."""
        self._between(last=True)

    def _between(self, last: bool = False) -> None:
        steps = self.model.num_timesteps
        rollout = steps // (EPISODE * self.settings.worlds)
        new = not self.curve or self.curve[-1].steps < steps
        if new and (last or rollout % self.settings.validate_every == 0):
            self.curve.append(self._validate(steps))
            self.logger.record("validation/score", self.curve[-1].score)
            self.logger.dump(steps)
        if last or (rollout > 0 and rollout % self.settings.checkpoint_every == 0):
            now = time.perf_counter()
            self.seconds, self._begun = self.seconds + now - self._begun, now
            write_checkpoint(self.path, self.model, self.acting, self.curve, self.seconds)
        if self.progress is not None:
            self.progress(steps, self.curve[-1] if self.curve else None)

    def _validate(self, steps: int) -> Point:
        seeds = VALIDATION[: self.settings.validation_worlds]
        learned = Learned(self.model, self.settings.form, "")
        return Point(steps, float(play(learned, FAULTS, seeds, self.settings.spacecraft).scores.mean()))
