"""Reaction wheels and control-moment gyros of a batch: their part of actions, observations and info.

Whatever the task, one number for each follows the duties in an agent's action, and what is measured of them
follows all else in its observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_envs.physics.fleet import Fleet
from thruster_envs.tasks import Task

FloatArray = NDArray[np.float64]


class Storage:
    """What stores momentum in the craft that the agents of a task command."""

    def __init__(self, fleet: Fleet, task: Task) -> None:
        self.fleet, self.task = fleet, task
        self.wheels, self.gyros = len(task.vehicle.reaction_wheels), len(task.vehicle.control_moment_gyros)
        self.craft = slice(task.first_commanded, task.first_commanded + len(task.agents))
        self.max_speeds = np.array([one.max_speed for one in task.vehicle.reaction_wheels])
        self.bounds = np.concatenate([np.full(field.size, field.bound) for field in task.storage_fields])

    def commanded(self, actions: FloatArray, shape: tuple[int, int, int]) -> FloatArray:
        """Command wheels and gimbals by the last numbers of actions; returns the numbers before them.

        Args:
            actions: (worlds, agents, n + wheels + gyros), -1..1; what lies outside is clipped.
            shape: (worlds, agents, n).

        Raises:
            ValueError: Another shape, or a number that is not finite.
        """
        n, rows = shape[2], self.fleet.rows
        right = (*shape[:2], n + self.wheels + self.gyros)
        if actions.shape != right:
            raise ValueError(f"the action has the shape {actions.shape}; {right} would be right")
        stored = actions[..., n:]
        if not np.isfinite(stored).all():
            world, agent, entry = np.argwhere(~np.isfinite(stored))[0]
            what = "wheel" if entry < self.wheels else "gyro"
            number = entry + 1 if entry < self.wheels else entry + 1 - self.wheels
            raise ValueError(
                f"the action of world {world}, {self.task.agents[agent]}, {what} {number} must be a number "
                f"from -1 to 1, got {stored[world, agent, entry]}"
            )
        every = np.zeros((shape[0], self.fleet.craft, self.wheels + self.gyros))
        every[:, self.craft] = stored.clip(-1.0, 1.0)
        if self.wheels:
            self.fleet.write(rows.wheel_torques, every[..., : self.wheels])
        if self.gyros:
            self.fleet.write(rows.gimbal_rates, every[..., self.wheels :])
        return np.ascontiguousarray(actions[..., :n])

    def observed(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Observations (worlds, agents, size) with what is measured of wheels and gyros behind them."""
        speeds, angles = self._read(measured=True)
        seen = np.concatenate([speeds / self.max_speeds, np.cos(angles), np.sin(angles)], axis=-1)
        return np.concatenate([observations, seen.clip(-self.bounds, self.bounds)], axis=-1, dtype=np.float32)

    def report(self) -> dict[str, dict[str, Any]]:
        """What ``info`` shows: true speeds, rad/s, and gimbal angles, rad, (worlds, agents, number)."""
        speeds, angles = self._read(measured=False)
        return {"storage": {"wheel_speed": speeds, "gimbal_angle": angles}}

    def _read(self, *, measured: bool) -> tuple[FloatArray, FloatArray]:
        rows, none = self.fleet.rows, np.zeros((self.fleet.worlds, len(self.task.agents), 0))
        speeds = rows.measured_speeds if measured else rows.wheel_speeds
        angles = rows.measured_angles if measured else rows.gimbal_angles
        return (
            self.fleet.read(speeds, self.wheels)[:, self.craft] if self.wheels else none,
            self.fleet.read(angles, self.gyros)[:, self.craft] if self.gyros else none,
        )
