"""Training of one policy: worlds, PPO, a curve on validation seeds, checkpoints.

A training run is a function of its settings: on one machine, with one number of torch threads, the same
settings give the same bits, interrupted or not.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

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
from thruster_agents.files import locked
from thruster_agents.policies import DiagnosisPolicy
from thruster_agents.ppo.checkpoint import (
    POLICY,
    Point,
    read_checkpoint,
    read_policy,
    restore,
    restore_policy,
    write_checkpoint,
    write_policy,
)
from thruster_agents.ppo.regret import RegretReward
from thruster_baselines.mapping import LPMapper
from thruster_envs.seeds import VALIDATION, first_training_seed
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.views import SB3VecEnv

__all__ = ["Settings", "Trained", "load_policy", "needed_bytes", "train"]

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
    tell: Callable[[str], None] = warnings.warn,
) -> Trained:
    """Train a policy, or go on with what lies in the folder.

    Args:
        settings: The same as before, where there is something to go on with.
        folder: Takes the checkpoints, and at the end `policy.safetensors`.
        tensorboard: Folder of the TensorBoard log; None for no log.
        progress: Called after each rollout with the steps so far and the last point of the curve.
        tell: Called with one line for each checkpoint that is damaged.

    Raises:
        ValueError: A checkpoint of other settings, a folder that another process uses, or a training whose
            parameters are no longer finite.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        return _train(settings, folder, tensorboard, progress, tell)


def _train(
    settings: Settings,
    folder: Path,
    tensorboard: Path | None,
    progress: Callable[[int, Point | None], None] | None,
    tell: Callable[[str], None],
) -> Trained:
    found = read_checkpoint(folder, settings, tell)
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
    clerk = _Clerk(settings, folder, acting, progress)
    if found is not None:
        clerk.curve, clerk.seconds = restore(*found, model, acting)
    total = settings.rollouts * EPISODE * settings.worlds
    remaining = total - model.num_timesteps
    if remaining > 0:
        try:
            model.learn(remaining, callback=clerk, reset_num_timesteps=found is None)
            clerk.finish()
        except ValueError:  # torch refuses a distribution, or the worlds an action, that is not finite
            if _is_finite(model):
                raise
            raise ValueError(
                f"the training on {settings.form} diverged after {model.num_timesteps} steps: parameters are "
                "no longer finite; choose a smaller learning rate"
            ) from None
    write_policy(folder, settings, model)
    model.logger.close()
    worlds.close()
    return Trained(model, tuple(clerk.curve), clerk.seconds)


def load_policy(settings: Settings, folder: Path) -> PPO:
    """The model whose training with these settings is over, from its weights alone; nothing is unpickled.

    Raises:
        ValueError: No such file, a damaged one, or one of other settings; one line.
    """
    weights = read_policy(folder, settings)
    env = on_form(
        make_plain(settings.spacecraft, 1, autoreset_mode=AutoresetMode.SAME_STEP),
        settings.form,
        settings.spacecraft,
    )
    model = PPO(env=None, _init_setup_model=False, **_options(settings))
    model.observation_space, model.action_space = env.single_observation_space, env.single_action_space
    env.close()
    model.n_envs = settings.worlds
    with torch.random.fork_rng(devices=[]):
        model._setup_model()
    restore_policy(folder / POLICY, weights, model)
    return model


class Needed(NamedTuple):
    """Estimates of what a training needs, bytes: memory in all and for each world, space for its files."""

    memory: int
    world: int
    disk: int


def needed_bytes(settings: Settings) -> Needed:
    """What a training needs."""
    worlds = make_plain(settings.spacecraft, 2, autoreset_mode=AutoresetMode.SAME_STEP)
    env = on_form(worlds, settings.form, settings.spacecraft)
    env.reset(seed=0)
    world = sum(np.asarray(one).nbytes for one in worlds.save_state().values()) // 2
    row = 4 * (env.single_observation_space.shape[0] + env.single_action_space.shape[0] + 5)
    env.close()
    memory = settings.worlds * (2 * EPISODE * row + 3 * world)
    parameters = 4 * 50_000
    return Needed(memory, world, 3 * (settings.worlds * (world + row) + 3 * parameters) + parameters)


def _new_model(settings: Settings, worlds: SB3VecEnv) -> PPO:
    # SB3's own seeding would also seed the worlds, whose seeds are set apart.
    torch.manual_seed(settings.seed)
    np.random.seed(settings.seed)  # noqa: NPY002  # SB3 shuffles with NumPy's global generator
    model = PPO(env=worlds, **_options(settings))
    if settings.form == "duties":
        with torch.no_grad():
            model.policy.action_net.bias.fill_(-1.0)
    return model


def _is_finite(model: PPO) -> bool:
    return all(bool(torch.isfinite(one).all()) for one in model.policy.parameters())


def _options(settings: Settings) -> dict[str, Any]:
    """What PPO is made with, but for its environment."""
    beliefs = settings.form == "beliefs"
    options: dict[str, Any] = {"log_std_init": math.log(settings.exploration)}
    if not beliefs:
        options["net_arch"] = {"pi": [128, 128], "vf": [128, 128]}
    return {
        "policy": DiagnosisPolicy if beliefs else "MlpPolicy",
        "n_steps": EPISODE,
        "batch_size": min(settings.minibatch, EPISODE * settings.worlds),
        "n_epochs": settings.epochs,
        "learning_rate": LinearSchedule(settings.learning_rate, 0.0, 1.0),
        "gamma": settings.discount,
        "gae_lambda": settings.trace,
        "policy_kwargs": options,
        "device": "cpu",
    }


class _Clerk(BaseCallback):
    """Keeps the curve, reports progress and writes checkpoints, all between rollouts."""

    def __init__(
        self,
        settings: Settings,
        folder: Path,
        acting: Any,
        progress: Callable[[int, Point | None], None] | None,
    ) -> None:
        super().__init__()
        self.settings, self.folder, self.acting, self.progress = settings, folder, acting, progress
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
        if not _is_finite(self.model):
            raise ValueError("parameters are not finite")
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
            write_checkpoint(self.folder, self.settings, self.model, self.acting, self.curve, self.seconds)
        if self.progress is not None:
            self.progress(steps, self.curve[-1] if self.curve else None)

    def _validate(self, steps: int) -> Point:
        seeds = VALIDATION[: self.settings.validation_worlds]
        learned = Learned(self.model, self.settings.form, "")
        return Point(steps, float(play(learned, FAULTS, seeds, self.settings.spacecraft).scores.mean()))
