"""Everything that the rest of a training depends on, in one file, and the weights that are left at its end.

A checkpoint is taken between two rollouts: parameters and optimiser, the counters of PPO, the random
generators of torch, NumPy and Python, the worlds with the policy's last belief in each, the last observation,
and the curve so far. Each has a name of its own, and the last two are kept: where the newest one is damaged,
the one before it serves. All files hold the settings that they were made with, and nothing that is run when
it is read (`thruster_agents.checkpoints`).
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from thruster_agents.checkpoints import check_like, read_tree, write_tree
from thruster_agents.files import as_json, first_difference

__all__ = [
    "POLICY",
    "Point",
    "read_checkpoint",
    "read_policy",
    "restore",
    "restore_policy",
    "write_checkpoint",
    "write_policy",
]

#: The file of a policy whose training is over.
POLICY = "policy.safetensors"
_KEPT = 2


@dataclass(frozen=True)
class Point:
    """A point of the validation curve.

    Attributes:
        steps: Environment steps so far.
        score: Mean score, with faults, acting without exploration.
    """

    steps: int
    score: float


def write_checkpoint(
    folder: Path, settings: Any, model: PPO, env: Any, curve: Sequence[Point], seconds: float
) -> None:
    """Write a checkpoint and remove all but the last two.

    Args:
        folder: Of the policy.
        settings: Of the training, a dataclass.
        model: PPO, between two rollouts.
        env: What has `save_state`: the vector environment, or `VectorBeliefAction` around it.
        curve: So far.
        seconds: Of training, so far.
    """
    name, keys, position, has_gauss, cached = np.random.get_state()  # noqa: NPY002  # SB3 draws from it
    saved = {
        "settings": as_json(asdict(settings)),
        "policy": dict(model.policy.state_dict()),
        "optimizer": model.policy.optimizer.state_dict()["state"],
        "counters": {"num_timesteps": model.num_timesteps, "_n_updates": model._n_updates},
        "last_observation": np.asarray(model._last_obs),
        "last_starts": np.asarray(model._last_episode_starts),
        "torch": torch.get_rng_state(),
        "numpy": [name, np.asarray(keys), int(position), int(has_gauss), float(cached)],
        "python": random.getstate(),
        "worlds": {key: np.asarray(array) for key, array in env.save_state().items()},
        "curve": [astuple(point) for point in curve],
        "seconds": seconds,
    }
    write_tree(folder / f"checkpoint-{model.num_timesteps:012d}.safetensors", saved)
    for old in _checkpoints(folder)[_KEPT:]:
        old.unlink(missing_ok=True)


def read_checkpoint(
    folder: Path, settings: Any, tell: Callable[[str], None]
) -> tuple[Path, Mapping[str, Any]] | None:
    """The last whole checkpoint, if there is one.

    Args:
        folder: Of the policy.
        settings: Of the training.
        tell: Called with one line for each checkpoint that is damaged.

    Raises:
        ValueError: One that was made with other settings; the line names the field.
    """
    paths = _checkpoints(folder)
    for number, path in enumerate(paths, start=1):
        try:
            saved = read_tree(path)
        except ValueError as error:
            others = paths[number].name if number < len(paths) else "the beginning"
            tell(f"{error}; going on from {others}")
            continue
        _check_settings(path, saved, settings)
        return path, saved
    return None


def restore(path: Path, saved: Mapping[str, Any], model: PPO, env: Any) -> tuple[list[Point], float]:
    """Put a model and its worlds, made with the same settings, where the checkpoint was taken.

    Args:
        path: Of the checkpoint, for messages.
        saved: What it holds.
        model: Made with the same settings.
        env: As for `write_checkpoint`, after a reset.

    Returns:
        The curve so far, and the seconds of training so far.

    Raises:
        ValueError: Something else than `write_checkpoint` writes; one line.
    """
    _check(path, saved, model, env)
    restore_policy(path, saved["policy"], model)
    optimizer = model.policy.optimizer
    optimizer.load_state_dict(optimizer.state_dict() | {"state": saved["optimizer"]})
    for name, value in saved["counters"].items():
        setattr(model, name, value)
    model._last_obs = saved["last_observation"]
    model._last_episode_starts = saved["last_starts"]
    env.restore_state(saved["worlds"])
    try:
        torch.set_rng_state(saved["torch"])
        np.random.set_state(tuple(saved["numpy"]))  # noqa: NPY002  # as above
        random.setstate(saved["python"])
    except (RuntimeError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: the state of a random generator is none ({str(error).splitlines()[0]})"
        ) from None
    return [Point(*point) for point in saved["curve"]], saved["seconds"]


def write_policy(folder: Path, settings: Any, model: PPO) -> None:
    """Write the weights of a policy whose training is over."""
    content = {"settings": as_json(asdict(settings)), "policy": dict(model.policy.state_dict())}
    write_tree(folder / POLICY, content)


def read_policy(folder: Path, settings: Any) -> Mapping[str, torch.Tensor]:
    """The weights that `write_policy` left.

    Raises:
        ValueError: No such file, a damaged one, or one that was made with other settings; one line.
    """
    path = folder / POLICY
    saved = read_tree(path)
    _check_settings(path, saved, settings)
    weights: Mapping[str, torch.Tensor] = saved.get("policy")
    return weights


def restore_policy(path: Path, weights: Mapping[str, torch.Tensor], model: PPO) -> None:
    """Put weights into a model that was made with the same settings.

    Raises:
        ValueError: Other names or shapes, or numbers that are not finite.
    """
    check_like(weights, dict(model.policy.state_dict()), f"{path}: policy")
    for name, value in weights.items():
        if not bool(torch.isfinite(value).all()):
            raise ValueError(f"{path}: policy: {name} has a number that is not finite")
    model.policy.load_state_dict(weights)


def _checkpoints(folder: Path) -> list[Path]:
    """The newest first."""
    return sorted(folder.glob("checkpoint-*.safetensors"), reverse=True)


def _check_settings(path: Path, saved: Any, settings: Any) -> None:
    if not isinstance(saved, Mapping) or not isinstance(saved.get("settings"), Mapping):
        raise ValueError(f"{path} is not a file of a training")
    found = first_difference(saved["settings"], as_json(asdict(settings)))
    if found is not None:
        name, then, now = found
        raise ValueError(
            f"{path}: made with {name} = {then!r}, now it is {now!r}; use the same, or train anew"
        )


def _check(path: Path, saved: Mapping[str, Any], model: PPO, env: Any) -> None:
    """Check the form of all that `restore` takes but the weights."""
    generator = np.random.get_state()  # noqa: NPY002  # as above
    steps = saved["counters"].get("num_timesteps") if isinstance(saved.get("counters"), Mapping) else None
    points, python = saved.get("curve"), saved.get("python")
    gauss = python[2] if isinstance(python, tuple) and len(python) == 3 else None
    form = {
        "settings": saved["settings"],
        "policy": dict(model.policy.state_dict()),
        "optimizer": _like_optimizer(saved.get("optimizer"), model.policy.optimizer),
        "counters": {"num_timesteps": 0, "_n_updates": 0},
        "last_observation": np.asarray(model.env.reset()),
        "last_starts": np.zeros(model.n_envs, np.bool_),
        "torch": torch.get_rng_state(),
        "numpy": [generator[0], np.asarray(generator[1]), 0, 0, 0.0],
        "python": (3, random.getstate()[1], gauss if isinstance(gauss, float) else None),
        "worlds": {key: np.asarray(array) for key, array in env.save_state().items()},
        "curve": [(0, 0.0)] * (len(points) if isinstance(points, list) else 0),
        "seconds": 0.0,
    }
    check_like(saved, form, str(path))
    if steps not in range(0, 2**62, model.n_steps * model.n_envs) or not 0 <= saved["numpy"][2] <= 624:
        raise ValueError(f"{path}: counters are out of range")


def _like_optimizer(found: Any, optimizer: torch.optim.Optimizer) -> dict[int, dict[str, torch.Tensor]]:
    """What Adam keeps of each parameter that has been stepped."""
    parameters = [one.detach() for group in optimizer.param_groups for one in group["params"]]
    stepped = found.keys() & set(range(len(parameters))) if isinstance(found, Mapping) else set()
    step = torch.tensor(0.0)
    return {k: {"step": step, "exp_avg": parameters[k], "exp_avg_sq": parameters[k]} for k in sorted(stepped)}
