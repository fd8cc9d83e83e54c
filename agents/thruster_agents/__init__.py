"""Learned methods for spacecraft whose thrusters fail: policies, training, comparison with classical ones.

Importing this package loads neither torch nor Stable-Baselines3; `load` does when it is called. They have to
be installed, with all else of the extra `agents`.
"""

from __future__ import annotations

from typing import Any

from thruster_envs.extras import require

require("agents", "thruster_agents")

__all__ = ["load"]


def load(task_id: str, method: str = "beliefs", **where: Any) -> Any:
    """A policy that `train.py` has trained; see :func:`thruster_agents.run_folders.load`."""
    from thruster_agents.run_folders.loading import load as load_from_run

    return load_from_run(task_id, method, **where)
