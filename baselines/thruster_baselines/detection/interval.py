"""One interval as a detector sees it, what a test fills in, and residuals in white coordinates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["Interval", "Scores", "is_diagonal", "whiten"]


class Interval(NamedTuple):
    """One interval, as a detector sees it after the checks.

    Kernels are called with a plain tuple of it, which takes half as long to enter one.

    Attributes:
        commanded: (vehicles, n), s, for which valves are open: as they were told, where valves follow.
        on_times: (vehicles, n), s, effective: the loss of the shared feed taken off.
        rate_change: (vehicles, m), m/s then rad/s, of a vehicle of nominal mass that does not turn meanwhile;
            may be anything where it is not valid.
        duration: s.
        valid: (vehicles,), where there is a measurement that counts.
        effectiveness: (vehicles, m, n), believed before this measurement, m/s^2 then rad/s^2.
        residual: (vehicles, m), measured minus expected; zero where not valid.
        covariance: (vehicles, m, m), of the residual if nothing is wrong.
        excluded: (vehicles, n), thrusters that are believed dead and not suspected.
    """

    commanded: FloatArray
    on_times: FloatArray
    rate_change: FloatArray
    duration: float
    valid: BoolArray
    effectiveness: FloatArray
    residual: FloatArray
    covariance: FloatArray
    excluded: BoolArray


class Scores(NamedTuple):
    """What a test fills in for each vehicle; zeros to begin with.

    Attributes:
        statistic: (vehicles,), test statistic that is compared with the threshold.
        thruster: (vehicles,), the likeliest one, from 1; 0 where the method cannot tell.
        suspicion: (vehicles, n), test statistic of each thruster.
        shortfall: (vehicles, n), s, on-time deficit of each if it is the faulty one.
    """

    statistic: FloatArray
    thruster: IntArray
    suspicion: FloatArray
    shortfall: FloatArray

    @classmethod
    def of(cls, interval: Interval) -> Scores:
        """Zeros for the vehicles and thrusters of an interval."""
        shape = interval.on_times.shape
        return cls(np.zeros(shape[0]), np.zeros(shape[0], np.int64), np.zeros(shape), np.zeros(shape))


@njit(error_model="numpy", inline="always")
def is_diagonal(covariance: FloatArray) -> bool:
    """Whether a symmetric (m, m) has nothing off its diagonal."""
    for k in range(covariance.shape[0]):
        for other in range(k):
            if covariance[k, other] != 0.0:
                return False
    return True


@njit(error_model="numpy")
def whiten(
    covariance: FloatArray,
    residual: FloatArray,
    effectiveness: FloatArray,
    root: FloatArray,
    white_residual: FloatArray,
    white_effectiveness: FloatArray,
) -> None:
    """Residual (m,) and columns (m, n) in coordinates in which the covariance (m, m) is the identity.

    They are L^-1 e and L^-1 A with the Cholesky factor L, so that products of them are those with Y^-1.

    Args:
        covariance: (m, m), positive definite.
        residual: (m,).
        effectiveness: (m, n).
        root: (m, m), written: L.
        white_residual: (m,), written.
        white_effectiveness: (m, n), written.
    """
    m, n = effectiveness.shape
    if is_diagonal(covariance):
        for k in range(m):
            scale = 1.0 / math.sqrt(covariance[k, k])
            for other in range(k):
                root[k, other] = 0.0
            root[k, k] = math.sqrt(covariance[k, k])
            white_residual[k] = residual[k] * scale
            for i in range(n):
                white_effectiveness[k, i] = effectiveness[k, i] * scale
        return
    for k in range(m):
        for other in range(k + 1):
            total = covariance[k, other]
            for s in range(other):
                total -= root[k, s] * root[other, s]
            root[k, other] = math.sqrt(total) if k == other else total / root[other, other]
    for k in range(m):
        scale = 1.0 / root[k, k]
        white_residual[k] = residual[k]
        for i in range(n):
            white_effectiveness[k, i] = effectiveness[k, i]
        for s in range(k):
            factor = root[k, s]
            white_residual[k] -= factor * white_residual[s]
            for i in range(n):
                white_effectiveness[k, i] -= factor * white_effectiveness[s, i]
        white_residual[k] *= scale
        for i in range(n):
            white_effectiveness[k, i] *= scale
