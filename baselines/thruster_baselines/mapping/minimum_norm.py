"""The minimum-norm-and-shift map: what many flight programs and simulators do in place of a linear program.

The minimum-norm on-times are of either sign. Firing thrusters in a proportion that cancels (`A w = 0`, all
w positive) changes nothing but fuel, so just enough of it is added to bring the most negative on-time to
zero; what is then too long is cut off. The result tracks every command that no bound stops, for more fuel
than the linear program needs and with most thrusters open. It is clipped, not scaled: beyond the authority
the direction of the answer turns.

The cancelling proportion is the projection of equal firing on the null space of the effectiveness: all ones
for a craft whose thrusters cancel in equal measure, such as Orion or SPHERES when healthy. Where a thruster
has none (a dead one, or the twin that lost its opponent) it is left as it is.
"""

from __future__ import annotations

import numpy as np

from thruster_baselines.mapping.base import ClosedFormMapper
from thruster_baselines.mapping.model import matrix_times_vector
from thruster_baselines.mapping.pseudo_inverse import minimum_norm_inverse
from thruster_envs.protocols import FloatArray

__all__ = ["MinimumNormShiftMapper"]

_NEGLIGIBLE = 1e-9  # shares of the cancelling proportion below this are round-off


class MinimumNormShiftMapper(ClosedFormMapper):
    """Minimum-norm on-times, shifted along the null space until none is negative, then clipped.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.

    >>> mapper = MinimumNormShiftMapper([[1.0, -1.0]], max_on_time=5.0)
    >>> mapper([2.0]).on_times.round(12)
    array([2., 0.])
    """

    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        inverse = minimum_norm_inverse(effectiveness)
        return inverse, _cancelling_proportion(effectiveness, inverse)

    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        inverse, cancelling = prepared
        balanced = matrix_times_vector(inverse, command)
        usable = cancelling > 0.0
        needed = np.where(usable, -balanced / np.where(usable, cancelling, 1.0), 0.0)
        shift = np.maximum(needed.max(axis=-1, keepdims=True), 0.0)
        on_times: FloatArray = balanced + shift * cancelling
        return on_times


def _cancelling_proportion(effectiveness: FloatArray, inverse: FloatArray) -> FloatArray:
    """On-times (..., n) without effect, nearest to equal ones; zero for a thruster that has no partner."""
    proportion = 1.0 - matrix_times_vector(inverse, effectiveness.sum(axis=-1))
    acting = np.abs(effectiveness).max(axis=-2) > 0.0
    return np.where(acting & (proportion > _NEGLIGIBLE), proportion, 0.0)
