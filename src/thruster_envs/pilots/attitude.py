"""The leader and follower law of a formation that turns by pulses: at most one per axis and control period.

The torque asked for is ``T = -K_d w - 2 K_p q``, with the vector part of the error quaternion and the rate
error (Valdes 2008, eqs. 3.20 and 3.27); on each axis where it exceeds a dead band (eq. 3.30) one thruster
fires once, by its sign. A follower takes attitude and rate relative to the leader, the first craft, which
holds the attitude of the reference frame by the same law. Gains follow from the spacecraft (eqs. 3.19, 3.29):
``K_p`` lets the torque of an axis balance an error of ``LARGEST_ANGLE``; ``K_d`` is the least that the source
allows times ``RATE_FACTOR``, which is where its table of gains lies. Knows nothing of faults.

Sign: quaternions here are body-from-reference; the source's are their conjugates, so that its error has the
opposite vector part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import attitude_error, place
from thruster_envs.physics.attitude import conjugate, quaternion_product, rotate
from thruster_envs.spacecraft import Spacecraft

#: Error that the whole torque of an axis balances, rad; the rate gain in units of the least allowed; share of
#: the torque of an axis below which nothing fires, as its inverse.
LARGEST_ANGLE, RATE_FACTOR, DEAD_BAND = math.radians(1.0), 100.0, 2.0
#: A thruster turns about an axis if at least this share of its torque lies along it.
_ALONG = 0.9


class Gains(NamedTuple):
    """The law in numbers, as the kernels take it.

    Attributes:
        rate: (3,), ``K_d``, N m s.
        angle: (3,), ``K_p``, N m.
        dead_band: (3,), N m.
        thrusters: (3, 2), index of the thruster that turns about each axis, forwards and backwards.
    """

    rate: NDArray[np.float64]
    angle: NDArray[np.float64]
    dead_band: NDArray[np.float64]
    thrusters: NDArray[np.int64]


@dataclass(frozen=True)
class AttitudePilot:
    """The law for one vehicle."""

    gains: Gains

    @classmethod
    def of(
        cls,
        vehicle: Spacecraft,
        *,
        largest_angle: float = LARGEST_ANGLE,
        rate_factor: float = RATE_FACTOR,
        dead_band: float = DEAD_BAND,
    ) -> AttitudePilot:
        """The pilot of a vehicle.

        Args:
            vehicle: As the flight software believes it to be.
            largest_angle: Error that the whole torque of an axis balances, rad.
            rate_factor: The rate gain in units of the least that is stable for that angle.
            dead_band: A torque below this part of the whole one, as a divisor, is not asked for.

        Raises:
            ValueError: An axis about which no thruster turns it one way.
        """
        torques = vehicle.wrenches()[3:]
        thrusters = np.zeros((3, 2), np.int64)
        for axis in range(3):
            for side, sign in enumerate((1.0, -1.0)):
                along = sign * torques[axis]
                along = np.where(along >= _ALONG * np.linalg.norm(torques, axis=0), along, 0.0)
                thrusters[axis, side] = np.argmax(along)
                if not along.max() > 0.0:
                    raise ValueError(
                        f"no thruster of {vehicle.name!r} turns it about {'+-'[side]}{'xyz'[axis]}; "
                        "one for each way about each axis would be right"
                    )
        axes = np.arange(3)
        torque = np.minimum(torques[axes, thrusters[:, 0]], -torques[axes, thrusters[:, 1]])
        fastest = np.sqrt(2.0 * torque * largest_angle / np.diag(np.array(vehicle.inertia)))
        return cls(
            Gains(rate_factor * torque / fastest, torque / largest_angle, torque / dead_band, thrusters)
        )

    def torque(self, angle: ArrayLike, rate: ArrayLike) -> NDArray[np.float64]:
        """Torque that the law asks for, (..., 3), N m, dead band aside.

        Args:
            angle: (..., 3), rad: minus twice the vector part of the error quaternion.
            rate: (..., 3), rad/s, body axes.
        """
        law: Any = _torque.py_func  # the kernels' arithmetic on arrays
        error, spin = np.asarray(angle, np.float64), np.asarray(rate, np.float64)
        return np.asarray(law(error, spin, self.gains.angle, self.gains.rate))

    def fly(
        self, data: NDArray[np.float64], targets: NDArray[np.float64], first: int, craft: int, worlds: int
    ) -> None:
        """Write duties for the craft from number ``first`` (from 0) on of every world.

        Args:
            data: The fleet's array.
            targets: (worlds, craft, 4), attitude that each craft should have, from the leader's body; the
                leader's from the reference frame.
            first: First craft that the pilot flies.
            craft: Craft in a world.
            worlds: Worlds.
        """
        hold_attitudes(data, targets, first, craft, 0, worlds, self.gains)


@kernel(nogil=True)
def hold_attitudes(data, targets, first, last, first_world, last_world, gains):
    """Write the duties that the law asks for, for the craft from ``first`` to ``last`` (exclusive)."""
    craft, lanes = targets.shape[1], data.shape[2]
    for world in range(first_world, last_world):
        for c in range(first, last):
            q, rate = relative_motion(data, at.MEASURED + 6, world, c, craft)
            target = targets[world, c]
            error = error_quaternion(q, (target[0], target[1], target[2], target[3]))
            b, w = place(world, c, craft, lanes)
            command_pulses(data, b, w, wanted_pulses(error, rate, gains), gains.thrusters)


@kernel(forceinline=True)
def relative_motion(data, row, world, c, craft):
    """Attitude and rate of a craft from the leader's body, the leader's from the reference frame.

    The four rows from ``row`` on hold attitudes and the next three rates, true or measured. A follower
    measures where it is from the leader with one sensor of its own, so that its errors alone come in. The
    rate is in body axes of the craft, rad/s.
    """
    lanes = data.shape[2]
    b, w = place(world, c, craft, lanes)
    q = (data[b, row, w], data[b, row + 1, w], data[b, row + 2, w], data[b, row + 3, w])
    rate = (data[b, row + 4, w], data[b, row + 5, w], data[b, row + 6, w])
    if c == 0:
        return q, rate
    b, w = place(world, 0, craft, lanes)
    leader = (data[b, at.ATTITUDE, w], data[b, at.ATTITUDE + 1, w], data[b, at.ATTITUDE + 2, w],
              data[b, at.ATTITUDE + 3, w])  # fmt: skip
    q = quaternion_product(q, conjugate(leader))
    leaders = rotate(q, (data[b, at.RATE, w], data[b, at.RATE + 1, w], data[b, at.RATE + 2, w]))
    return q, (rate[0] - leaders[0], rate[1] - leaders[1], rate[2] - leaders[2])


@njit(forceinline=True)
def turned(cosines, sines):
    """Attitude after turns by yaw about z, then pitch about y, then roll about x.

    Of half of roll, pitch and yaw, in this order, the cosines and sines are given.
    """
    return quaternion_product(
        (cosines[0], -sines[0], 0.0, 0.0),
        quaternion_product((cosines[1], 0.0, -sines[1], 0.0), (cosines[2], 0.0, 0.0, -sines[2])),
    )


@njit(forceinline=True)
def error_quaternion(q, target):
    """Attitude from where it should be, the shorter way round."""
    e = quaternion_product(q, conjugate(target))
    sign = 1.0 if e[0] >= 0.0 else -1.0
    return (sign * e[0], sign * e[1], sign * e[2], sign * e[3])


@njit(forceinline=True)
def wanted_pulses(error, rate, gains):
    """Pulses about the three axes, each -1, 0 or 1, that the law asks for."""
    angle = attitude_error(error)
    return (
        _wanted(angle[0], rate[0], 0, gains),
        _wanted(angle[1], rate[1], 1, gains),
        _wanted(angle[2], rate[2], 2, gains),
    )


@njit(forceinline=True)
def _torque(angle, rate, angle_gain, rate_gain):
    """``T = -K_p a - K_d w``, with the angle a = 2 q of a small error."""
    return -angle_gain * angle - rate_gain * rate


@njit(forceinline=True)
def _wanted(angle, rate, axis, gains):
    torque = _torque(angle, rate, gains.angle[axis], gains.rate[axis])
    if abs(torque) < gains.dead_band[axis]:
        return 0
    return 1 if torque > 0.0 else -1


@njit(forceinline=True)
def command_pulses(data, b, w, pulses, thrusters):
    """Ask the thrusters that turn a craft about the three axes for these pulses."""
    for axis in range(3):
        forwards, backwards = at.DUTIES + thrusters[axis, 0], at.DUTIES + thrusters[axis, 1]
        data[b, forwards, w] = 1.0 if pulses[axis] > 0 else 0.0
        data[b, backwards, w] = 1.0 if pulses[axis] < 0 else 0.0
