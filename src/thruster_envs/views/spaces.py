"""The spaces of a task's agents."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from thruster_envs.tasks import Task


def observation_space(task: Task) -> spaces.Box[np.float32]:
    """Box of one agent's observation, float32, finite, bounds field by field."""
    fields = task.observation_fields
    low = np.concatenate([np.full(field.size, field.low) for field in fields])
    high = np.concatenate([np.full(field.size, field.bound) for field in fields])
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def action_space(task: Task) -> spaces.Space[Any]:
    """MultiDiscrete where the task has choices, Discrete if one; else Box [-1, 1] per actuator, float32."""
    if task.choices is not None and len(task.choices) == 1:
        return spaces.Discrete(task.choices[0])
    if task.choices is not None:
        return spaces.MultiDiscrete(list(task.choices))
    return spaces.Box(-1.0, 1.0, (task.action_size + task.storage_size,), dtype=np.float32)
