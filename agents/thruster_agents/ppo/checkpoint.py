"""Everything that the rest of a training run depends on, in one file, written whole or not at all.

Taken between two rollouts: parameters and optimiser, the counters of PPO, the random generators of torch,
NumPy and Python, the worlds with the policy's last belief in each, the last observation, and the curve so
far.
"""

from __future__ import annotations

import os
import random
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

__all__ = ["Point", "read_checkpoint", "restore", "write_checkpoint"]


@dataclass(frozen=True)
class Point:
    """A point of the validation curve.

    Attributes:
        steps: Environment steps so far.
        score: Mean score, with faults, acting without exploration.
    """

    steps: int
    score: float


def write_checkpoint(path: Path, model: PPO, env: Any, curve: Sequence[Point], seconds: float) -> None:
    """Write a checkpoint beside the file and put it in its place, so that no moment leaves half a file.

    Args:
        path: Of the file.
        model: PPO, between two rollouts.
        env: What has `save_state`: the vector environment, or `VectorBeliefAction` around it.
        curve: So far.
        seconds: Of training, so far.
    """
    saved = {
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "counters": {"num_timesteps": model.num_timesteps, "_n_updates": model._n_updates},
        "last_observation": torch.from_numpy(np.asarray(model._last_obs)),
        "last_starts": torch.from_numpy(np.asarray(model._last_episode_starts)),
        "torch": torch.get_rng_state(),
        "numpy": _plain(np.random.get_state()),  # noqa: NPY002  # SB3 draws from NumPy's global generator
        "python": random.getstate(),
        "worlds": {name: _tensor(array) for name, array in env.save_state().items()},
        "curve": [astuple(point) for point in curve],
        "seconds": seconds,
    }
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("wb") as file:
        torch.save(saved, file)
        file.flush()
        os.fsync(file.fileno())
    os.replace(unfinished, path)


def read_checkpoint(path: Path) -> Mapping[str, Any] | None:
    """The checkpoint, if there is one."""
    return torch.load(path, weights_only=True) if path.exists() else None


def restore(saved: Mapping[str, Any], model: PPO, env: Any) -> tuple[list[Point], float]:
    """Put a model and its worlds, made with the same settings, where the checkpoint was taken.

    Returns:
        The curve so far, and the seconds of training so far.
    """
    model.policy.load_state_dict(saved["policy"])
    model.policy.optimizer.load_state_dict(saved["optimizer"])
    for name, value in saved["counters"].items():
        setattr(model, name, value)
    model._last_obs = saved["last_observation"].numpy()
    model._last_episode_starts = saved["last_starts"].numpy()
    env.restore_state({name: _array(kept) for name, kept in saved["worlds"].items()})
    torch.set_rng_state(saved["torch"])
    generator, keys, *rest = saved["numpy"]
    np.random.set_state((generator, np.array(keys, np.uint32), *rest))  # noqa: NPY002  # as above
    random.setstate(saved["python"])
    return [Point(*point) for point in saved["curve"]], saved["seconds"]


def _plain(state: Any) -> tuple[Any, ...]:
    """NumPy's generator state as plain values, which torch loads without running code."""
    name, keys, position, has_gauss, cached = state
    return name, [int(key) for key in keys], int(position), int(has_gauss), float(cached)


def _tensor(array: np.ndarray) -> tuple[str, tuple[int, ...], torch.Tensor]:
    """Type, shape and bytes: torch has no tensor for every type of NumPy."""
    array = np.asarray(array)
    return array.dtype.str, array.shape, torch.frombuffer(bytearray(array.tobytes()), dtype=torch.uint8)


def _array(kept: tuple[str, tuple[int, ...], torch.Tensor]) -> np.ndarray:
    kind, shape, content = kept
    return np.frombuffer(content.numpy().tobytes(), np.dtype(kind)).reshape(shape).copy()
