"""The clipped pseudo-inverse: the textbook mapper that does not know that a thruster cannot pull.

On-times are the least-squares solution of A u = T of smallest norm, and what of it is negative or too long
is cut off. With thrusters that only push, half of the solution is usually lost. Kept as the floor of
comparisons; the minimum-norm-and-shift map mends it.
"""

from __future__ import annotations

import numpy as np

from thruster_baselines.mapping.base import ClosedFormMapper
from thruster_baselines.mapping.model import matrix_times_vector
from thruster_envs.protocols import FloatArray

__all__ = ["PseudoInverseMapper", "axis_weights", "minimum_norm_inverse"]


class PseudoInverseMapper(ClosedFormMapper):
    """Minimum-norm on-times, clipped to what thrusters can do.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.

    >>> mapper = PseudoInverseMapper([[1.0, -1.0]], max_on_time=5.0)
    >>> mapper([2.0]).on_times
    array([1., 0.])
    """

    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        return (minimum_norm_inverse(effectiveness),)

    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        (inverse,) = prepared
        return matrix_times_vector(inverse, command)


def minimum_norm_inverse(effectiveness: FloatArray) -> FloatArray:
    """The matrix (..., n, m) from a command to its least-squares on-times of smallest norm, of either sign.

    Axes are weighed by their largest effectiveness, so that m and rad can be added where not all can be met.

    Args:
        effectiveness: (..., m, n), m/s^2 then rad/s^2.
    """
    weight = axis_weights(effectiveness)
    inverse = np.linalg.pinv(effectiveness * weight[..., np.newaxis]) * weight[..., np.newaxis, :]
    acting = np.abs(effectiveness).max(axis=-2) > 0.0  # no round-off for a thruster that does nothing
    return np.where(acting[..., np.newaxis], inverse, 0.0)


def axis_weights(effectiveness: FloatArray) -> FloatArray:
    """One over the largest effectiveness on each axis, (..., m); zero for an axis on which nothing acts.

    They turn a rate change into s of the axis's strongest thruster, so that m and rad can be added.

    Args:
        effectiveness: (..., m, n), m/s^2 then rad/s^2.
    """
    largest = np.abs(effectiveness).max(axis=-1)
    return np.where(largest > 0.0, 1.0 / np.where(largest > 0.0, largest, 1.0), 0.0)
