"""The pilot of a craft that keeps its slot: a feedback law and a map without a solver.

Models a proportional-derivative law on measured position, velocity, attitude and rate errors, and an
allocation that needs no solver: the pseudo-inverse gives on-times of both signs, and a multiple of the
vehicle's null vector (on-times that cancel) is added until none is negative. Knows nothing of faults. Leaves
out fuel optimality and guidance: it holds a place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import attitude_error, place, rate_error, turning_of_frame
from thruster_envs.physics.attitude import rotate
from thruster_envs.spacecraft import Spacecraft

#: Natural frequencies of the feedback, rad/s, and its damping. On Orion a metre of error is gone within three
#: minutes; twice as fast would cost twice the fuel, most of it to follow the sensor noise.
TRANSLATION_FREQUENCY, ROTATION_FREQUENCY, DAMPING = 0.02, 0.03, 1.0


@dataclass(frozen=True)
class SlotPilot:
    """The map and the gains for one vehicle.

    Attributes:
        inverse: (n, 6), s per m/s and per rad/s: minimum-norm on-times.
        null: (n,), non-negative on-times that together do nothing, largest 1; zeros where the vehicle has
            none.
        period: s.
        frequencies: (2,), natural frequencies of the feedback in translation and rotation, rad/s.
    """

    inverse: NDArray[np.float64]
    null: NDArray[np.float64]
    period: float
    frequencies: tuple[float, float] = (TRANSLATION_FREQUENCY, ROTATION_FREQUENCY)

    @classmethod
    def of(cls, vehicle: Spacecraft) -> SlotPilot:
        """The pilot of a vehicle."""
        effectiveness = vehicle.effectiveness()
        scale = np.maximum(np.abs(effectiveness).max(axis=1, keepdims=True), np.finfo(np.float64).tiny)
        together = (effectiveness / scale).sum(axis=1)
        null = (
            np.ones(effectiveness.shape[1])
            if np.abs(together).max() < 1e-9
            else np.zeros(effectiveness.shape[1])
        )
        inverse = np.asarray(np.linalg.pinv(effectiveness), np.float64)
        return cls(inverse, null, vehicle.control_period)

    def fly(
        self, data: NDArray[np.float64], slots: NDArray[np.float64], first: int, craft: int, worlds: int
    ) -> None:
        """Write duties for the craft from number ``first`` (from 0) on of every world.

        Args:
            data: The fleet's array.
            slots: (worlds, craft, 6), where each craft should be: m and m/s, LVLH.
            first: First craft that the pilot flies.
            craft: Craft in a world.
            worlds: Worlds.
        """
        _hold_slots(
            data, slots, first, craft, worlds, self.inverse, self.null, self.period, self.frequencies,
        )  # fmt: skip


@kernel
def _hold_slots(data, slots, first, craft, worlds, inverse, null, period, frequencies):
    n, lanes, m = inverse.shape[0], data.shape[2], at.MEASURED
    duties = np.empty(n)
    for world in range(worlds):
        for c in range(first, craft):
            b, w = place(world, c, craft, lanes)
            q = (data[b, m + 6, w], data[b, m + 7, w], data[b, m + 8, w], data[b, m + 9, w])
            rate = (data[b, m + 10, w], data[b, m + 11, w], data[b, m + 12, w])
            angle, spin = attitude_error(q), rate_error(q, rate, turning_of_frame(data, b, w))
            a, z = frequencies
            change = np.empty(6)
            wanted = rotate(
                q,
                (
                    _pull(
                        data[b, m, w] - slots[world, c, 0], data[b, m + 3, w] - slots[world, c, 3], a, period
                    ),
                    _pull(
                        data[b, m + 1, w] - slots[world, c, 1],
                        data[b, m + 4, w] - slots[world, c, 4],
                        a,
                        period,
                    ),
                    _pull(
                        data[b, m + 2, w] - slots[world, c, 2],
                        data[b, m + 5, w] - slots[world, c, 5],
                        a,
                        period,
                    ),
                ),
            )
            for k in range(3):
                change[k] = wanted[k]
                change[3 + k] = _pull(angle[k], spin[k], z, period)
            shift = 0.0
            for i in range(n):
                on_time = 0.0
                for k in range(6):
                    on_time += inverse[i, k] * change[k]
                duties[i] = on_time / period
                if null[i] > 0.0:
                    shift = max(shift, -duties[i] / null[i])
            for i in range(n):
                data[b, at.DUTIES + i, w] = min(max(duties[i] + shift * null[i], 0.0), 1.0)


@njit(forceinline=True)
def _pull(error, speed, frequency, period):
    """Rate change over one period that a damped spring asks for."""
    return -(frequency * frequency * error + 2.0 * DAMPING * frequency * speed) * period
