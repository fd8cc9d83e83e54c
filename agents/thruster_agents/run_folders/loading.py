"""A trained policy, back from its run folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3 import PPO

from thruster_agents.environments import FORMS, TASK, Form, make_plain, on_form
from thruster_agents.run_folders.folder import RunFolder, latest_run
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.spacecraft import load as load_spacecraft

__all__ = ["Policy", "load"]


@dataclass(frozen=True)
class Policy:
    """A trained policy and what it was trained for.

    Attributes:
        model: The SB3 model.
        form: What its actions are: `beliefs` or `duties`.
        spacecraft: That it was trained on.
    """

    model: PPO
    form: Form
    spacecraft: Spacecraft

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions for a batch of observations of :meth:`make_vec`, without exploration."""
        actions, _ = self.model.predict(observations, deterministic=True)
        return actions

    def make_vec(
        self, num_envs: int, *, faults: Any = None, autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP
    ) -> VectorEnv[Any, Any, Any]:
        """Worlds in which the policy can act."""
        plain = make_plain(self.spacecraft, num_envs, faults=faults, autoreset_mode=autoreset_mode)
        return on_form(plain, self.form, self.spacecraft)


def load(
    task_id: str,
    method: str = "beliefs",
    *,
    run: str | Path | None = None,
    seed: int | None = None,
    runs: str | Path = "runs",
) -> Policy:
    """A policy that `train.py` has trained. Run folders hold pickled parts: load only runs that you trust.

    Args:
        task_id: `thruster_envs/ThrusterMapping-v0`, the only task with trained policies so far.
        method: `beliefs` or `duties`.
        run: Folder of the run; by default the newest finished one in `runs`.
        seed: Of the training; by default the first of the run.
        runs: Where runs are looked for.

    Raises:
        ValueError: Another task or method, or a run that has no such policy.
    """
    if task_id != TASK:
        raise ValueError(f"task_id is {task_id!r}; {TASK!r} would be right")
    form = next((one for one in FORMS if one == method), None)
    if form is None:
        raise ValueError(f"method is {method!r}; {' or '.join(map(repr, FORMS))} would be right")
    folder = RunFolder(Path(run)) if run is not None else latest_run(Path(runs))
    config = folder.read("config.json")
    path = folder.policy(form, config["seed"] if seed is None else seed) / "model.zip"
    if not path.is_file():
        raise ValueError(
            f"{path} does not exist; a run that was trained with this method and seed would be right"
        )
    return Policy(PPO.load(path, device="cpu"), form, load_spacecraft(config["spacecraft"]))
