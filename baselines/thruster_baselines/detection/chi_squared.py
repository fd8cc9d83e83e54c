"""Chi-squared tests of the residual: of all axes together, of each alone, and of the axes of each thruster.

With the residual e and its covariance Y when nothing is wrong (Yang 2003, eqs. 62-66):

- generic: e' Y^-1 e, of m degrees of freedom: something is wrong.
- single: e_k^2 / Y_kk for each axis: the axes on which something is wrong.
- set: the sum of these over the axes of a thruster; isolates it only if no other acts on just the same axes
  (on Orion four thrusters always do).

`calibration.chi_squared_threshold` has thresholds where Y is the true covariance (`PhysicalNoise`). Left out:
which way the residual points inside a set of axes, which is what the likelihood ratio uses.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.calibration import chi_squared_threshold
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.interval import Interval, Scores, whiten
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["GenericChiSquared", "SetChiSquared", "SingleChiSquared"]


class GenericChiSquared(BaseDetector):
    """Says that something is wrong where the residual as a whole is too large; names nobody.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of the statistic, dimensionless.
        settings: Of the filter and of the feed; see `FilterSettings`.
    """

    @classmethod
    def _closed_form(cls, spacecraft: Spacecraft, rate: float, /, **_: Any) -> float | None:
        """Chi-squared of as many degrees of freedom as there are axes."""
        return chi_squared_threshold(rate, degrees=len(spacecraft.effectiveness()))

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        _generic(tuple(interval), scores.statistic)
        return self._answer(scores)


class SingleChiSquared(BaseDetector):
    """Says on which axes something is wrong, and who it is if one thruster alone acts on all of them.

    A thruster's suspicion is the largest statistic among its axes, or zero if it does not act on an axis on
    which something is wrong.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of the largest statistic of an axis, dimensionless.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        axes: (vehicles, m), the statistic of each axis in the last interval.

    >>> four = np.array([[5, -3, -2, 0], [0, 2, 4, -6], [1, 0.5, -2, 0], [3.5, 2, -5, 0], [0, 0, -3, 4],
    ...     [0, 2, 0, -1]])  # Yang 2003, Table 1
    >>> detector = SingleChiSquared(four, threshold=9.0, noise=1.0)
    >>> diagnosis = detector.update(np.zeros(4), [0.0, 0.0, 0.0, 0.0, 4.0, 0.0], duration=1.0)
    >>> np.flatnonzero(diagnosis.suspicion[0]) + 1  # thrusters 3 and 4 act on the fifth axis
    array([3, 4])
    """

    axes: FloatArray

    @classmethod
    def _closed_form(cls, spacecraft: Spacecraft, rate: float, /, **_: Any) -> float | None:
        """Chi-squared, once for each axis."""
        return chi_squared_threshold(rate, tests=len(spacecraft.effectiveness()))

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        self.axes = _squares(interval)
        _single(self.axes, self._believed, interval.excluded, self.threshold, tuple(scores))
        return self._answer(scores)


class SetChiSquared(BaseDetector):
    """Sums up the axes of each thruster, and names one where its set of axes is its own.

    The statistic of a larger set is never below that of a smaller one inside of it. So of all sets outside
    of which nothing exceeds the threshold the smallest is the one to blame, and its thruster is named if it
    is the only one with that many axes.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of the largest statistic of a set, dimensionless.
        settings: Of the filter and of the feed; see `FilterSettings`.

    >>> four = np.array([[5, -3, -2, 0], [0, 2, 4, -6], [1, 0.5, -2, 0], [3.5, 2, -5, 0], [0, 0, -3, 4],
    ...     [0, 2, 0, -1]])  # Yang 2003, Table 1
    >>> detector = SetChiSquared(four, threshold=9.0, noise=1.0)
    >>> detector.update([0, 0, 0, 2], [0, 0, 0, 0, 0, 0], duration=2.0).thruster
    array([4])
    """

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        _set(_squares(interval), self._believed, interval.excluded, self.threshold, tuple(scores))
        return self._answer(scores)


def _squares(interval: Interval) -> FloatArray:
    """(vehicles, m): the square of each axis of the residual over its variance."""
    variance = np.diagonal(interval.covariance, axis1=1, axis2=2)
    squares: FloatArray = np.square(interval.residual) / variance
    return squares


@kernel(nogil=True)
def _generic(interval: Interval, statistic: FloatArray) -> None:
    interval = Interval(*interval)
    m = interval.residual.shape[1]
    root, e, a, none = np.empty((m, m)), np.empty(m), np.empty((m, 0)), np.empty((m, 0))
    for v in range(statistic.size):
        if interval.valid[v]:
            whiten(interval.covariance[v], interval.residual[v], none, root, e, a)
            for k in range(m):
                statistic[v] += e[k] * e[k]


@kernel(nogil=True)
def _single(
    squares: FloatArray, effectiveness: FloatArray, dead: BoolArray, threshold: float, scores: Scores
) -> None:
    statistic, blamed, suspicion, _ = scores
    m, n = effectiveness.shape[1:]
    for v in range(squares.shape[0]):
        for k in range(m):
            statistic[v] = max(statistic[v], squares[v, k])
        wrong = statistic[v] > threshold
        suspects = 0
        for i in range(n):
            if dead[v, i]:
                continue
            fits, largest = True, 0.0
            for k in range(m):
                if effectiveness[v, k, i] != 0.0:
                    largest = max(largest, squares[v, k])
                elif squares[v, k] > threshold:
                    fits = False
            if fits:
                suspicion[v, i] = largest
                if largest > threshold:
                    suspects += 1
                    blamed[v] = i + 1
        if suspects != 1 or not wrong:
            blamed[v] = 0


@kernel(nogil=True)
def _set(
    squares: FloatArray, effectiveness: FloatArray, dead: BoolArray, threshold: float, scores: Scores
) -> None:
    statistic, blamed, suspicion, _ = scores
    m, n = effectiveness.shape[1:]
    for v in range(squares.shape[0]):
        smallest, sharing = m + 1, 0
        for i in range(n):
            if dead[v, i]:
                continue
            axes, outside = 0, 0.0
            for k in range(m):
                if effectiveness[v, k, i] != 0.0:
                    axes += 1
                    suspicion[v, i] += squares[v, k]
                else:
                    outside += squares[v, k]
            statistic[v] = max(statistic[v], suspicion[v, i])
            if suspicion[v, i] > threshold and outside <= threshold:
                if axes < smallest:
                    smallest, sharing = axes, 1
                    blamed[v] = i + 1
                elif axes == smallest:
                    sharing += 1
        if sharing != 1:
            blamed[v] = 0
