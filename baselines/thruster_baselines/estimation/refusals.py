"""Why a measurement is not used: it is missing, late, no number, or such as thrusters cannot have given.

A rate change is out of range on an axis if it is larger than all thrusters of the vehicle together could give
in the interval, at the upper end of their scatter, and eight standard deviations of the sensors besides. Of
several reasons the first in the order of `REFUSALS` is the one that counts.

Left out: measurements that are wrong but possible. They look like faults of thrusters, and a filter of the
sensors is what tells them apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = [
    "LATE", "MISSING", "NOT_A_NUMBER", "ON_TIME", "OUT_OF_RANGE", "REFUSALS", "TAKEN", "Limits",
    "first_bad_axis",
]  # fmt: skip

REFUSALS: tuple[str, ...] = ("missing", "late", "not a number", "out of range")
"""Reasons for which a measurement is refused, in the order of their codes, from 0. `late` is all that
belongs to another moment than the one that is asked about."""

MISSING, LATE, NOT_A_NUMBER, OUT_OF_RANGE = range(len(REFUSALS))

TAKEN = -1
"""Stands for no reason."""

ON_TIME = 0.01
"""By what share of an interval the time tag of a measurement may be off the interval's end."""

_SIGMAS = 8.0
"""How many standard deviations of the sensors a measurement may lie beyond what thrusters can give."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest rate changes that can be.

    Attributes:
        rate: (m,), by the thrusters, for each second of an interval, m/s^2 then rad/s^2.
        error: (m,), by the sensors, m/s then rad/s; infinite where anything can be.
    """

    rate: FloatArray
    error: FloatArray

    @classmethod
    def of(cls, spacecraft: Spacecraft) -> Limits:
        """Those of a spacecraft.

        >>> from thruster_envs.spacecraft import load
        >>> limits = Limits.of(load("orion"))
        >>> (limits.rate[0] / load("orion").authority(1.0)[0]).round(2), limits.error[0].round(6)
        (np.float64(2.2), np.float64(0.005657))
        """
        scatter = np.array([one.scatter for one in spacecraft.thrusters])
        sensors = np.repeat([spacecraft.sensors.velocity, spacecraft.sensors.rate], 3)
        return cls(np.abs(spacecraft.effectiveness()) @ (1.0 + scatter), _SIGMAS * math.sqrt(2.0) * sensors)

    @classmethod
    def none(cls, axes: int) -> Limits:
        """Of a vehicle of which nothing is known but its axes: anything finite can be."""
        return cls(np.zeros(axes), np.full(axes, np.inf))

    def check(self, rate_change: FloatArray, duration: float) -> tuple[int, int]:
        """Why to refuse a rate change (m,) of an interval of `duration` s, or `TAKEN`; and on which axis."""
        reason, axis = first_bad_axis(rate_change, duration, self.rate, self.error)
        return int(reason), int(axis)

    def line(self, axis: int, value: float, duration: float) -> str:
        """One line about what stands on an axis (from 0) of a refused rate change."""
        name, unit = _AXES[axis] if self.rate.size == len(_AXES) else (f"axis {axis + 1}", "its unit")
        if not math.isfinite(value):
            return f"{name}, is {value}; a finite number of {unit} would be right"
        largest = float(self.rate[axis] * duration + self.error[axis])
        return f"{name}, is {value:.4g}; -{largest:.4g} to {largest:.4g} {unit} would be right"


_AXES = tuple(
    (f"{kind} {axis}", unit) for kind, unit in (("velocity", "m/s"), ("rate", "rad/s")) for axis in "xyz"
)


@kernel
def first_bad_axis(
    rate_change: FloatArray, duration: float, largest_rate: FloatArray, largest_error: FloatArray
) -> tuple[int, int]:
    """Code of the reason to refuse a rate change (m,), or `TAKEN`; and the axis, from 0, where it shows."""
    for k in range(rate_change.size):
        if not abs(rate_change[k]) < np.inf:
            return NOT_A_NUMBER, k
    for k in range(rate_change.size):
        error = largest_error[k]
        if error < np.inf and abs(rate_change[k]) > largest_rate[k] * duration + error:
            return OUT_OF_RANGE, k
    return TAKEN, 0
