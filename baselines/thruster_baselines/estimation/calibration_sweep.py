"""Active calibration: each thruster is fired alone after launch, and what it does is measured.

The schedule fires every thruster for one pulse of u seconds, in an order that leaves the body slow. All
firings are solved for together by generalised least squares,

    Z_k = a_i u (1 + s_k) + v_k - v_(k-1),

with the thrust's scatter s_k and the sensors' errors v, which gives the columns a_i, their covariance, and a
chi-squared statistic against what was believed. The source announces such a test (Yang 2003, section 5.2.1).
One firing cannot tell a scattered thrust from a weak one: docs/derivations/calibration_sweep.md.

Left out: the feed coupling, the turn of the attitude within a pulse, free motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.estimation.noise import PhysicalNoise
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["CalibrationSweep", "SweepEstimate"]

_REWEIGHTINGS = 2  # the scatter's covariance needs the columns that are sought


@dataclass(frozen=True, slots=True)
class SweepEstimate:
    """What a sweep says of the thrusters.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2.
        covariance: (m n, m n), of its entries, columns stacked.
        statistic: (n,), squared deviation from what was believed, weighed by the inverse covariance: of a
            thruster that is as believed, chi-squared with m degrees of freedom.
    """

    effectiveness: FloatArray
    covariance: FloatArray
    statistic: FloatArray

    @property
    def deviation(self) -> FloatArray:
        """(m, n): standard deviation of each entry, m/s^2 then rad/s^2."""
        m, n = self.effectiveness.shape
        deviation: FloatArray = np.sqrt(np.diag(self.covariance)).reshape(n, m).T
        return deviation


class CalibrationSweep:
    """A schedule of single firings, and the estimate that follows from what they give.

    Args:
        spacecraft: Description or name: what is believed on the ground, its sensors and scatter.
        pulse: Length of each firing, s.
        repetitions: How often each thruster is fired.

    Attributes:
        order: (firings,), which thruster fires, numbered from 1.
        on_times: (firings, n), s: the schedule, one row for each firing.

    Raises:
        ValueError: A pulse that is not positive or longer than the control period, no repetition.

    >>> sweep = CalibrationSweep("orion", pulse=1.0)
    >>> sweep.on_times.shape, sorted(sweep.order.tolist()) == list(range(1, 13))
    ((12, 12), True)
    >>> true = 1.02 * load("orion").effectiveness()
    >>> estimate = sweep.estimate(sweep.on_times @ true.T)
    >>> bool(abs(estimate.effectiveness - true).max() < 1e-12)
    True
    """

    def __init__(self, spacecraft: Spacecraft | str, pulse: float, repetitions: int = 1) -> None:
        if isinstance(spacecraft, str):
            spacecraft = load(spacecraft)
        if not 0.0 < pulse <= spacecraft.control_period:
            raise ValueError(
                f"pulse is {pulse}; a number of s above 0 and up to the control period, "
                f"{spacecraft.control_period:g}, would be right"
            )
        if repetitions < 1:
            raise ValueError(f"repetitions is {repetitions}; one or more would be right")
        self._noise = PhysicalNoise(spacecraft)
        self._believed = spacecraft.effectiveness()
        self.order = np.tile(_slow_order(self._believed), repetitions)
        self.on_times: FloatArray = np.zeros((self.order.size, self._believed.shape[1]))
        self.on_times[np.arange(self.order.size), self.order - 1] = pulse

    def estimate(self, rate_changes: ArrayLike) -> SweepEstimate:
        """The effectiveness that fits the measured rate changes best.

        Args:
            rate_changes: (firings, m), m/s then rad/s, in the order of the schedule, measured from just
                before each firing to just before the next; free motion taken off.

        Raises:
            ValueError: A wrong shape; a measurement that is not finite.
        """
        measured = np.array(rate_changes, dtype=np.float64)
        firings, n = self.on_times.shape
        m = self._believed.shape[0]
        if measured.shape != (firings, m):
            raise ValueError(
                f"rate_changes has the shape {measured.shape}; ({firings}, {m}), one row for each firing, "
                "would be right"
            )
        finite = np.isfinite(measured).all(axis=1)
        if not finite.all():
            at = int(np.argmin(finite))
            raise ValueError(
                f"rate_changes of firing {at + 1} (thruster {self.order[at]}) is {measured[at].tolist()}; "
                "finite numbers would be right"
            )
        design = np.kron(self.on_times, np.eye(m))  # (firings m, n m), columns of the effectiveness stacked
        columns = self._believed.T.ravel()
        for _ in range(_REWEIGHTINGS):
            weighed = np.linalg.solve(self._errors(columns.reshape(n, m)), design)
            covariance = np.linalg.inv(design.T @ weighed)
            columns = covariance @ (weighed.T @ measured.ravel())
        blocks = covariance.reshape(n, m, n, m)[np.arange(n), :, np.arange(n)]
        off = columns.reshape(n, m) - self._believed.T
        statistic = np.einsum("nk,nk->n", off, np.linalg.solve(blocks, off[..., np.newaxis])[..., 0])
        return SweepEstimate(columns.reshape(n, m).T.copy(), covariance, statistic)

    def _errors(self, columns: FloatArray) -> FloatArray:
        """(firings m, firings m): covariance of all rate changes if the thrusters are (n, m)."""
        firings, m = self.order.size, self._believed.shape[0]
        shared = np.eye(firings) - 0.5 * (np.eye(firings, k=1) + np.eye(firings, k=-1))
        errors: FloatArray = np.kron(shared, np.diag(self._noise.sensors)).astype(np.float64)
        for k, i in enumerate(self.order - 1):
            astray = self._noise.scatter[i] * self.on_times[k, i] * columns[i]
            block = slice(k * m, (k + 1) * m)
            errors[block, block] += np.outer(astray, astray)
        return errors


def _slow_order(effectiveness: FloatArray) -> IntArray:
    """(n,), numbers from 1: each next firing is the one that leaves the body slowest, in turning first."""
    largest = np.abs(effectiveness).max(axis=1)
    scaled = effectiveness / np.where(largest > 0.0, largest, 1.0)[:, np.newaxis]
    left, total, order = list(range(effectiveness.shape[1])), np.zeros(effectiveness.shape[0]), []
    while left:
        after = total + scaled[:, left].T
        turning, moving = np.square(after[:, 3:]).sum(axis=1), np.square(after).sum(axis=1)
        chosen = left.pop(int(np.lexsort((moving, turning.round(6)))[0]))
        order.append(chosen + 1)
        total += scaled[:, chosen]
    return np.array(order, np.int64)
