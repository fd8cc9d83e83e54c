"""The crude map: fire what points that way.

The source compares its linear program with the map that SPHERES flew, "open the thrusters that point along
the wanted motion", without giving its formula (Yang 2003, section 2.2.6, Table 3). Here every thruster that
helps fires for as long as would fit the command best if it acted alone, shared among the thrusters that
help on the same axis:

    u_i = max(0, a_i . T) / (a_i . a_i) / N_i,

with each axis in units of its largest effectiveness. A thruster counts towards the axis of the command that
it helps most, and N_i is the number of thrusters that count towards the same one. Nothing is done about
what thrusters do on the other axes.
"""

from __future__ import annotations

import numpy as np

from thruster_baselines.mapping.base import ClosedFormMapper
from thruster_envs.protocols import FloatArray

__all__ = ["CrudeMapper"]


class CrudeMapper(ClosedFormMapper):
    """Fires every thruster that points along the command, with no regard to what else it does.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.

    >>> CrudeMapper([[1.0, 1.0, -1.0]], max_on_time=5.0)([2.0]).on_times
    array([1., 1., 0.])
    """

    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        largest = np.abs(effectiveness).max(axis=-1)
        scale = np.where(largest > 0.0, largest, 1.0)
        effect = effectiveness / scale[..., np.newaxis]
        squared = np.square(effect).sum(axis=-2)
        return scale, effect, np.where(squared > 0.0, squared, 1.0)

    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        scale, effect, squared = prepared
        help_per_axis = effect * (command / scale)[..., np.newaxis]
        help_in_all = np.maximum(help_per_axis.sum(axis=-2), 0.0)
        axis = np.argmax(help_per_axis, axis=-2)
        same_axis = axis[..., :, np.newaxis] == axis[..., np.newaxis, :]
        sharing = (same_axis & (help_in_all > 0.0)[..., np.newaxis, :]).sum(axis=-1)
        on_times: FloatArray = help_in_all / squared / np.maximum(sharing, 1)
        return on_times
