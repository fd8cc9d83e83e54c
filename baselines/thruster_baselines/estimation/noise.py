"""How large the error of a measured rate change is, by what is known of sensors and thrusters.

A rate change is the difference of two measured velocities, so each axis has twice the variance of its sensor.
Thrusters scatter uniformly from firing to firing by a share s_i, which has the variance s_i^2 / 3 and moves
the rate change along the thruster's column a_i of the effectiveness by its on-time u_i:

    R = 2 diag(sigma_velocity^2 x 3, sigma_rate^2 x 3) + sum over i of (s_i u_i)^2 / 3 a_i a_i'.

The source has R = 10 on all axes instead (Yang 2003, chapter 6), which adds m/s to rad/s and is far above
what its sensors give; only with the physical R are statistics of healthy thrusters chi-squared.

Left out: that two consecutive rate changes share a velocity, which correlates their errors by up to -1/2; the
error of the free motion that is taken off.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["LEAST_SCATTER", "PhysicalNoise"]

LEAST_SCATTER = 0.002
"""Standard deviation of a thrust from firing to firing, as a share: no thrust is known better."""


class PhysicalNoise:
    """The covariance of a measured rate change, which depends on what fired.

    Args:
        spacecraft: Description, name or path. A sensor without error counts as one with a millionth of what
            the thrusters do in a second or a control period on its axis, about the rounding of an observation
            in single precision; a thruster that does not scatter, as one that does by `LEAST_SCATTER`.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2.
        scatter: (n,), standard deviation of the thrust from firing to firing, as a share of it.
        sensors: (m,), variance of a rate change without firing, (m/s)^2 then (rad/s)^2.

    >>> noise = PhysicalNoise("orion")
    >>> noise(np.zeros(12)).diagonal().tolist()
    [5e-07, 5e-07, 5e-07, 5e-07, 5e-07, 5e-07]
    """

    def __init__(self, spacecraft: Spacecraft | str | Path) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        self.effectiveness: FloatArray = spacecraft.effectiveness()
        scatter = np.array([one.scatter for one in spacecraft.thrusters]) / np.sqrt(3.0)
        self.scatter: FloatArray = np.maximum(scatter, LEAST_SCATTER)
        sensors = np.repeat([spacecraft.sensors.velocity, spacecraft.sensors.rate], 3)
        per_second = np.abs(self.effectiveness).sum(axis=1)
        least = 1e-6 * max(spacecraft.control_period, 1.0)
        least = least * np.where(per_second > 0.0, per_second, per_second.max())
        self.sensors: FloatArray = 2.0 * np.square(np.maximum(sensors, least))

    def __call__(self, on_times: ArrayLike) -> FloatArray:
        """Covariances (..., m, m) for effective on-times (..., n), s.

        Raises:
            ValueError: On-times of another number of thrusters.
        """
        times = np.array(on_times, dtype=np.float64, order="C")
        m, n = self.effectiveness.shape
        if times.ndim == 0 or times.shape[-1] != n:
            raise ValueError(f"on_times has the shape {times.shape}; (..., {n}) would be right")
        rows = times.reshape(-1, n)
        return self.of_rows(rows).reshape(*times.shape[:-1], m, m)

    def of_rows(self, on_times: FloatArray) -> FloatArray:
        """As a call, for contiguous (rows, n) that the caller has checked."""
        answer = np.empty((on_times.shape[0], self.sensors.size, self.sensors.size))
        _covariances(on_times, self.effectiveness, self.scatter, self.sensors, answer)
        return answer


@kernel(nogil=True)
def _covariances(
    times: FloatArray, effectiveness: FloatArray, scatter: FloatArray, sensors: FloatArray, answer: FloatArray
) -> None:
    m, n = effectiveness.shape
    for v in range(times.shape[0]):
        for k in range(m):
            for other in range(k + 1):
                answer[v, k, other] = sensors[k] if k == other else 0.0
        for i in range(n):
            variance = (scatter[i] * times[v, i]) ** 2
            if variance > 0.0:
                for k in range(m):
                    for other in range(k + 1):
                        answer[v, k, other] += variance * effectiveness[k, i] * effectiveness[other, i]
        for k in range(m):
            for other in range(k):
                answer[v, other, k] = answer[v, k, other]
