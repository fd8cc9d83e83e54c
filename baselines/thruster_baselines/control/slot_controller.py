"""A law without memory that holds a place, or goes to one that is near, on observations of a task.

Modelled: a proportional-derivative law on relative position, velocity, attitude and rate, and the linear
program, which maps the rate change to on-times. It is what a newcomer writes first, for
`FormationKeeping-v1`, or for `OrionRendezvous-v1` from a few metres. Left out: plans, filters, faults, and
the turn from LVLH to body axes, which is small where the attitude is kept.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.detection.environment_flights import reader_with
from thruster_baselines.mapping import LPMapper
from thruster_envs.configuration import require

__all__ = ["SlotController"]


class SlotController:
    """Actions (worlds, n) from observations (worlds, size); any number of worlds.

    Args:
        environment: That is flown; its action is the duty of each thruster.
        frequencies: Natural frequencies in translation and rotation, rad/s; both axes are critically damped.

    Raises:
        ValueError: An environment that does not show what is needed, or frequencies that are not positive.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FormationKeeping-v1")
    >>> observation, _ = env.reset(seed=0)
    >>> SlotController(env)(observation[np.newaxis]).shape
    (1, 12)
    """

    def __init__(self, environment: Any, frequencies: tuple[float, float] = (0.02, 0.03)) -> None:
        for name, frequency in zip(("translation", "rotation"), frequencies, strict=True):
            require(0.0 < frequency < 1.0, f"frequency of {name}", frequency, "a number of rad/s from 0 to 1")
        self._read = reader_with(environment, "position", "velocity", "attitude_error", "rate_error")
        vehicle = environment.unwrapped.task.vehicle
        self._period, self._mapper = vehicle.control_period, LPMapper(vehicle, threads=1)
        self._frequencies = np.repeat(frequencies, 3)

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Actions (worlds, n), -1 to 1, for observations (worlds, size)."""
        reading = self._read(observations)
        error = np.concatenate([reading.position, reading.attitude_error], axis=1)
        rate = np.concatenate([reading.velocity, reading.rate_error], axis=1)
        a = self._frequencies
        command = -self._period * (a**2 * error + 2.0 * a * rate)
        on_times = np.asarray(self._mapper(command).on_times)
        return np.asarray(2.0 * np.clip(on_times / self._period, 0.0, 1.0) - 1.0, np.float32)
