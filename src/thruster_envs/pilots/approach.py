"""The scripted pilot of an approach along the V-bar: guidance, two feedback laws, a map without a solver.

Models a reference that moves along-track towards the target, at a constant speed and then braked to the speed
of contact with a limited deceleration; a proportional-derivative law with feed-forward of the reference and
of Hill's acceleration for the translation, one for the attitude; and an allocation by the pseudo-inverse to
which the same open rate is added for all thrusters, an idle one or as much as it takes that none is negative,
if what all of them do together is nothing; else nothing is added, and negative ones stay shut. Knows nothing
of faults. Leaves out the delay of the modulator, which is short against the loops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics.access import attitude_error, opener, rate_error
from thruster_envs.physics.attitude import conjugate, quaternion_product, rotate
from thruster_envs.physics.orbits import hill_acceleration
from thruster_envs.spacecraft import Spacecraft

FloatArray = NDArray[np.float64]

#: Attitude of an approach, body-from-LVLH: x to the target along-track, y against the orbit's normal, z to
#: the planet.
FACING = (0.5, 0.5, 0.5, -0.5)


@dataclass(frozen=True, kw_only=True)
class ApproachSettings:
    """How the approach is flown.

    Attributes:
        speed: Along-track, m/s.
        contact_speed: At the target, m/s.
        braking: Deceleration in between, m/s^2.
        translation: Natural frequency of the position loop, rad/s.
        rotation: Natural frequency of the attitude loop, rad/s.
        damping: Of both.
        idle: Open rate of a thruster that is not needed.
    """

    speed: float = 0.1
    contact_speed: float = 0.05
    braking: float = 2e-3
    translation: float = 0.2
    rotation: float = 0.5
    damping: float = 0.9
    idle: float = 0.1


class Law(NamedTuple):
    """The law in numbers.

    Attributes:
        distance: At the start, m.
        speed: m/s.
        contact_speed: m/s.
        braking: m/s^2.
        translation: Natural frequency, rad/s.
        rotation: Natural frequency, rad/s.
        damping: Of both.
        idle: Open rate of a thruster that is not needed.
        cancels: 1 if all thrusters together do nothing, else 0.
        mass: kg.
        mean_motion: rad/s.
    """

    distance: float
    speed: float
    contact_speed: float
    braking: float
    translation: float
    rotation: float
    damping: float
    idle: float
    cancels: float
    mass: float
    mean_motion: float


#: Opens the law of an :class:`ApproachPilot` in a kernel.
open_law = opener(Law)


@dataclass(frozen=True)
class ApproachPilot:
    """The law and the map for one vehicle.

    Attributes:
        inverse: (n, 6), open rates per N and per N m: minimum norm.
        inertia: (3, 3), kg m^2.
        law: As :class:`Law` names them.
    """

    inverse: FloatArray
    inertia: FloatArray
    law: FloatArray

    @classmethod
    def of(
        cls, vehicle: Spacecraft, distance: float, settings: ApproachSettings | None = None
    ) -> ApproachPilot:
        """The pilot of a vehicle that starts ``distance`` m behind the target."""
        flown = ApproachSettings() if settings is None else settings
        wrenches = vehicle.wrenches()
        size = np.maximum(np.abs(wrenches).sum(axis=1), np.finfo(np.float64).tiny)
        together = np.abs(wrenches.sum(axis=1)) / size
        law = Law(
            distance=distance,
            speed=flown.speed,
            contact_speed=flown.contact_speed,
            braking=flown.braking,
            translation=flown.translation,
            rotation=flown.rotation,
            damping=flown.damping,
            idle=flown.idle,
            cancels=1.0 if together.max() < 1e-9 else 0.0,
            mass=vehicle.mass,
            mean_motion=vehicle.mean_motion,
        )
        inverse = np.asarray(np.linalg.pinv(wrenches), np.float64)
        return cls(inverse, np.array(vehicle.inertia), np.array(law))

    def __call__(
        self, time: ArrayLike, position: ArrayLike, velocity: ArrayLike, attitude: ArrayLike, rate: ArrayLike
    ) -> FloatArray:
        """Open rates (worlds, n), 0..1, from what navigation says at ``time`` s from the start.

        Args:
            time: (worlds,), s, of the measurements.
            position: (worlds, 3), m, LVLH.
            velocity: (worlds, 3), m/s, LVLH.
            attitude: (worlds, 4), body-from-LVLH.
            rate: (worlds, 3), rad/s, body axes.
        """
        times, sights = _sights(time, position, velocity, attitude, rate)
        duties = np.empty((sights.shape[0], self.inverse.shape[0]))
        _steer(times, sights, self.inverse, self.inertia, self.law, duties)
        return duties

    def wrench(
        self, time: ArrayLike, position: ArrayLike, velocity: ArrayLike, attitude: ArrayLike, rate: ArrayLike
    ) -> FloatArray:
        """(worlds, 6) force and torque that it wants, N and N m, body axes; for who maps it otherwise.

        Arguments as in a call.
        """
        times, sights = _sights(time, position, velocity, attitude, rate)
        wrenches = np.empty((sights.shape[0], 6))
        _want(times, sights, self.inertia, self.law, wrenches)
        return wrenches

    def reference(self, time: float) -> tuple[float, float, float]:
        """Along-track position, velocity and acceleration of the reference, m, m/s, m/s^2.

        >>> from thruster_envs.spacecraft import load
        >>> pilot = ApproachPilot.of(load("msr_chaser"), 20.0)
        >>> tuple(round(x, 6) + 0.0 for x in pilot.reference(206.25))
        (0.0, 0.05, 0.0)
        """
        y, v, a = _reference_at(float(time), self.law)
        return float(y), float(v), float(a)


@kernel
def _reference_at(t, numbers):
    return approach_reference(t, open_law(numbers))


@njit
def approach_reference(t, law):
    """Along-track position, velocity and acceleration of the reference ``t`` seconds after the start."""
    speed, contact, braking = law.speed, law.contact_speed, law.braking
    braking_time = (speed - contact) / braking
    braking_distance = 0.5 * (speed + contact) * braking_time
    begins = (law.distance - braking_distance) / speed
    if t < begins:
        return -law.distance + speed * t, speed, 0.0
    since = t - begins
    if since < braking_time:
        return (
            -braking_distance + speed * since - 0.5 * braking * since * since,
            speed - braking * since,
            -braking,
        )
    return contact * (since - braking_time), contact, 0.0


def _sights(
    time: ArrayLike, position: ArrayLike, velocity: ArrayLike, attitude: ArrayLike, rate: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Times (worlds,) and what is seen then (worlds, 13)."""
    parts = [np.atleast_2d(np.asarray(one, np.float64)) for one in (position, velocity, attitude, rate)]
    sights = np.concatenate(parts, axis=1)
    return np.ascontiguousarray(np.broadcast_to(np.asarray(time, np.float64), sights.shape[:1])), sights


@kernel(nogil=True)
def _steer(times, sights, inverse, inertia, numbers, duties):
    """Write duties (worlds, n) from sights (worlds, 13)."""
    law = open_law(numbers)
    for world in range(duties.shape[0]):
        steer_one(times[world], sights[world], inverse, inertia, law, duties[world])


@kernel(nogil=True)
def _want(times, sights, inertia, numbers, wrenches):
    """Write wrenches (worlds, 6) from sights (worlds, 13)."""
    law = open_law(numbers)
    for world in range(wrenches.shape[0]):
        wrench = _wanted(times[world], sights[world], inertia, law)
        for k in range(6):
            wrenches[world, k] = wrench[k]


@njit
def _wanted(time, sight, inertia, law):
    """Force and torque wanted for one craft, N and N m, body axes, from its sight (13,)."""
    a, z, mean_motion = law.translation, law.rotation, law.mean_motion
    y, speed, braking = approach_reference(time, law)
    r = (sight[0], sight[1], sight[2])
    v = (sight[3], sight[4], sight[5])
    q = (sight[6], sight[7], sight[8], sight[9])
    free = hill_acceleration(r, v, mean_motion)
    damp = 2.0 * law.damping
    force = rotate(
        q,
        (
            law.mass * (-a * a * r[0] - damp * a * v[0] - free[0]),
            law.mass * (-a * a * (r[1] - y) - damp * a * (v[1] - speed) + braking - free[1]),
            law.mass * (-a * a * r[2] - damp * a * v[2] - free[2]),
        ),
    )
    angle = attitude_error(quaternion_product(q, conjugate(FACING)))
    spin = rate_error(q, (sight[10], sight[11], sight[12]), (0.0, 0.0, mean_motion))
    tx = -z * z * angle[0] - damp * z * spin[0]
    ty = -z * z * angle[1] - damp * z * spin[1]
    tz = -z * z * angle[2] - damp * z * spin[2]
    return (
        force[0], force[1], force[2],
        inertia[0, 0] * tx + inertia[0, 1] * ty + inertia[0, 2] * tz,
        inertia[1, 0] * tx + inertia[1, 1] * ty + inertia[1, 2] * tz,
        inertia[2, 0] * tx + inertia[2, 1] * ty + inertia[2, 2] * tz,
    )  # fmt: skip


@njit
def steer_one(time, sight, inverse, inertia, law, duties):
    """Open rates of one craft from its position, velocity, attitude and rate (13,)."""
    wrench = _wanted(time, sight, inertia, law)
    n, lowest = duties.shape[0], math.inf
    for i in range(n):
        duties[i] = 0.0
        for k in range(6):
            duties[i] += inverse[i, k] * wrench[k]
        lowest = min(lowest, duties[i])
    shift = law.cancels * max(law.idle, -lowest)
    for i in range(n):
        duties[i] = min(max(duties[i] + shift, 0.0), 1.0)
