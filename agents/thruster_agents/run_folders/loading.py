"""A trained policy, back from its run folder."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3 import PPO

from thruster_agents.environments import FORMS, TASK, Form, make_plain, on_form
from thruster_agents.ppo import load_policy
from thruster_agents.ppo.checkpoint import POLICY
from thruster_agents.run_folders.configuration import Configuration, read_configuration
from thruster_agents.run_folders.folder import RunFolder, latest_run
from thruster_agents.run_folders.record import check_task
from thruster_envs.spacecraft import Spacecraft

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
    """A policy that `train.py` has trained, for the spacecraft that it was trained on.

    It is made from the options, the description and the weights in the run folder, which hold no code: a
    folder from anywhere can be loaded.

    Args:
        task_id: `thruster_envs/ThrusterMapping-v0`, the only task with trained policies so far.
        method: `beliefs` or `duties`.
        run: Folder of the run; by default the one in `runs` that was finished last.
        seed: Of the training; by default the first of the run.
        runs: Where runs are looked for.

    Raises:
        ValueError: Another task or method, or a run that has no such policy or is damaged.
    """
    if task_id != TASK:
        raise ValueError(f"task_id is {task_id!r}; {TASK!r} would be right")
    form = next((one for one in FORMS if one == method), None)
    if form is None:
        raise ValueError(f"method is {method!r}; {' or '.join(map(repr, FORMS))} would be right")
    folder = RunFolder(Path(run)) if run is not None else latest_run(Path(runs))
    configuration, spacecraft = read_configuration(folder), folder.spacecraft()
    check_task(folder, spacecraft)
    seed = configuration.seed if seed is None else operator.index(seed)
    policy = folder.policy(form, seed)
    if not (policy / POLICY).is_file():
        raise ValueError(f"{policy / POLICY} does not exist; {_reason(policy, form, seed, configuration)}")
    model = load_policy(configuration.settings(form, seed, spacecraft), policy)
    return Policy(model, form, spacecraft)


def _reason(policy: Path, form: Form, seed: int, configuration: Configuration) -> str:
    if (policy / "model.zip").exists():
        return "model.zip is of an earlier version and is not opened, as it could run code; train again"
    seeds = range(configuration.seed, configuration.seed + configuration.seeds)
    if seed not in seeds:
        return f"the run has the seeds {seeds.start} to {seeds[-1]}"
    if configuration.settings(form, seed, None).steps == 0:
        return f"the run trained nothing on {form}"
    return "the training is not over; go on with train.py --resume"
