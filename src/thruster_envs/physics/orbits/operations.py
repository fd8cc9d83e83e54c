"""What is asked of an orbit, whatever its kind: one function each, and one class for each kind.

A function of an orbit stands for that of the same name in the class that belongs to the orbit's type; which
one is chosen when a kernel is compiled. A new kind of orbit is one class here and one line of the table.
"""

import math
from collections.abc import Callable
from typing import Any

from numba.extending import overload

from thruster_envs.helpers import njit
from thruster_envs.physics.attitude import conjugate, follow_orbit, quaternion_product
from thruster_envs.physics.orbits.elements import since_perigee
from thruster_envs.physics.orbits.kinds import Circular, Ellipse, Elliptic, Hill, LinearElliptic, Oblate
from thruster_envs.physics.orbits.motion import (
    elliptic_acceleration,
    frame_motion,
    hill_acceleration,
    linear_acceleration,
    oblate_acceleration,
    oblate_attitude,
    oblate_motion,
    oblate_step,
    turn_frame,
    two_body_acceleration,
)
from thruster_envs.physics.orbits.transition import free_motion


def chosen_by_kind(function: Any, of_kind: Callable[[type], Any]) -> None:
    """Let Numba compile, for a function of an orbit, the one that belongs to the type of the orbit."""

    def choose(orbit, *_arguments):  # Numba calls it with the types of all
        return of_kind(orbit.instance_class)

    overload(function, jit_options={"forceinline": True}, strict=False)(choose)


def _by_kind(function: Any) -> Any:
    chosen_by_kind(function, lambda kind: getattr(_OF_KIND[kind], function.__name__))
    return function


@_by_kind
def step_frames(orbit, reference, h):
    """Motion of LVLH at the start, middle and end of a sub-step of ``h`` seconds from a reference.

    Three times None on a circular orbit, else each has the reference that belongs to it.
    """
    return _OF_KIND[type(orbit)].step_frames(orbit, reference, h)


@_by_kind
def follow_frame(orbit, before, after, h, q):
    """Attitude against LVLH after ``h`` seconds at rest in inertial space, between two motions of LVLH.

    Exactly the same attitude if there are none.
    """
    return _OF_KIND[type(orbit)].follow_frame(orbit, before, after, h, q)


@_by_kind
def free_acceleration(orbit, motion, r, v):
    """Free relative acceleration, m/s^2."""
    return _OF_KIND[type(orbit)].free_acceleration(orbit, motion, r, v)


@_by_kind
def frame_rate(orbit, reference):
    """Rate at which LVLH turns, rad/s, in its own axes; it never turns about its y."""
    return _OF_KIND[type(orbit)].frame_rate(orbit, reference)


@_by_kind
def read_reference(orbit, rows, first, w):
    """The reference of craft ``w`` out of an array (rows, craft), from row ``first`` on; None without one."""
    return _OF_KIND[type(orbit)].read_reference(orbit, rows, first, w)


@_by_kind
def write_reference(orbit, rows, first, w, reference):
    """Write the reference of craft ``w`` there."""
    return _OF_KIND[type(orbit)].write_reference(orbit, rows, first, w, reference)


@_by_kind
def reference_of(orbit, motion):
    """The reference that belongs to a motion of LVLH; None on a circular orbit."""
    return _OF_KIND[type(orbit)].reference_of(orbit, motion)


@_by_kind
def reference_after(orbit, reference, duration, steps):
    """The reference ``duration`` seconds later, which may be negative, in so many integration steps."""
    return _OF_KIND[type(orbit)].reference_after(orbit, reference, duration, steps)


@_by_kind
def free_velocity(orbit, reference, drift, duration, steps, r, v):
    """Velocity, m/s, after free motion for ``duration`` seconds until LVLH stands at a reference.

    Args:
        orbit: By the linear equations, with J2 without linearisation.
        reference: At the end.
        drift: Lower half of the transition matrix, row by row, for circular orbits.
        duration: s.
        steps: Integration steps, where there are some.
        r: Position at the start, m.
        v: Velocity then, m/s.
    """
    return _OF_KIND[type(orbit)].free_velocity(orbit, reference, drift, duration, steps, r, v)


@_by_kind
def osculating(orbit, reference):
    """The :class:`Ellipse` on which LVLH moves; None for a circular orbit.

    Its angle is the true anomaly, but with J2 the argument of latitude.
    """
    return _OF_KIND[type(orbit)].osculating(orbit, reference)


@_by_kind
def reference_at(orbit, elements, anomaly):
    """The reference of a craft when LVLH stands at a true anomaly, rad."""
    return _OF_KIND[type(orbit)].reference_at(orbit, elements, anomaly)


@njit(forceinline=True)
def open_ellipse(numbers):
    """The :class:`Ellipse` of an array (7,)."""
    return Ellipse(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6])


@njit(forceinline=True)
def translation_step(r, v, f0, fm, f1, orbit, frames, h):
    """Position and velocity after one RK4 step.

    The specific force of the thrust is given at the start, the middle and the end of the step, in LVLH;
    ``frames`` are those of :func:`step_frames`.
    """
    start, middle, end = frames
    a1 = _sum(free_acceleration(orbit, start, r, v), f0)
    v2 = _along(v, 0.5 * h, a1)
    a2 = _sum(free_acceleration(orbit, middle, _along(r, 0.5 * h, v), v2), fm)
    v3 = _along(v, 0.5 * h, a2)
    a3 = _sum(free_acceleration(orbit, middle, _along(r, 0.5 * h, v2), v3), fm)
    v4 = _along(v, h, a3)
    a4 = _sum(free_acceleration(orbit, end, _along(r, h, v3), v4), f1)
    return (
        _along(r, 1 / 6 * h, _weighted(v, v2, v3, v4)),
        _along(v, 1 / 6 * h, _weighted(a1, a2, a3, a4)),
    )


@njit(forceinline=True)
def _along(a, s, b):
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@njit(forceinline=True)
def _sum(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@njit(forceinline=True)
def _weighted(a, b, c, d):
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0],
        a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2],
    )


class _Steady:
    """LVLH turns at one rate: there is no reference."""

    @staticmethod
    def step_frames(orbit, reference, h):
        return (None, None, None)

    @staticmethod
    def follow_frame(orbit, before, after, h, q):
        return follow_orbit(q, orbit.mean_motion, h)

    @staticmethod
    def frame_rate(orbit, reference):
        return (0.0, 0.0, orbit.mean_motion)

    @staticmethod
    def reference_at(orbit, elements, anomaly):
        return None

    @staticmethod
    def read_reference(orbit, rows, first, w):
        return None

    @staticmethod
    def write_reference(orbit, rows, first, w, reference):
        return None

    @staticmethod
    def reference_of(orbit, motion):
        return None

    @staticmethod
    def reference_after(orbit, reference, duration, steps):
        return None

    @staticmethod
    def free_velocity(orbit, reference, drift, duration, steps, r, v):
        k, x, y, z, a, b, c = drift, r[0], r[1], r[2], v[0], v[1], v[2]
        return (
            k[0] * x + k[1] * y + k[2] * z
            + k[3] * a + k[4] * b + k[5] * c,
            k[6] * x + k[7] * y + k[8] * z
            + k[9] * a + k[10] * b + k[11] * c,
            k[12] * x + k[13] * y + k[14] * z
            + k[15] * a + k[16] * b + k[17] * c,
        )  # fmt: skip

    @staticmethod
    def osculating(orbit, reference):
        return None


class _Hill(_Steady):
    @staticmethod
    def free_acceleration(orbit, motion, r, v):
        return hill_acceleration(r, v, orbit.mean_motion)


class _Circular(_Steady):
    @staticmethod
    def free_acceleration(orbit, motion, r, v):
        return two_body_acceleration(r, v, orbit.mean_motion, orbit.radius)


class _OnEllipse:
    """The reference is the time since perigee, s."""

    @staticmethod
    def step_frames(orbit, reference, h):
        return (
            frame_motion(orbit, reference),
            frame_motion(orbit, reference + 0.5 * h),
            frame_motion(orbit, reference + h),
        )

    @staticmethod
    def follow_frame(orbit, before, after, h, q):
        c = before.cosine * after.cosine + before.sine * after.sine
        s = before.cosine * after.sine - before.sine * after.cosine
        # past apogee the half of the anomaly has gone from pi / 2 to - pi / 2
        s = s if c >= 0.0 else -s
        c = abs(c) if h != 0.0 else 1.0
        return turn_frame(q, c, s)

    @staticmethod
    def frame_rate(orbit, reference):
        return (0.0, 0.0, frame_motion(orbit, reference).rate)

    @staticmethod
    def reference_at(orbit, elements, anomaly):
        return since_perigee(orbit.mean_motion, elements.eccentricity, anomaly)

    @staticmethod
    def read_reference(orbit, rows, first, w):
        return rows[first, w]

    @staticmethod
    def write_reference(orbit, rows, first, w, reference):
        rows[first, w] = reference

    @staticmethod
    def reference_of(orbit, motion):
        return motion.reference

    @staticmethod
    def reference_after(orbit, reference, duration, steps):
        return reference + duration

    @staticmethod
    def free_velocity(orbit, reference, drift, duration, steps, r, v):
        before, after = frame_motion(orbit, reference - duration), frame_motion(orbit, reference)
        _, moved = free_motion(orbit.eccentricity, before, after, duration, r, v)
        return moved

    @staticmethod
    def osculating(orbit, reference):
        motion = frame_motion(orbit, reference)
        anomaly = 2.0 * math.atan2(motion.sine, motion.cosine)
        n, a, e = orbit.mean_motion, orbit.semi_major_axis, orbit.eccentricity
        return Ellipse(n, a, e, orbit.breadth, reference, anomaly, anomaly)


class _LinearElliptic(_OnEllipse):
    @staticmethod
    def free_acceleration(orbit, motion, r, v):
        return linear_acceleration(r, v, motion)


class _Elliptic(_OnEllipse):
    @staticmethod
    def free_acceleration(orbit, motion, r, v):
        return elliptic_acceleration(r, v, motion)


class _Oblate:
    """The reference is six numbers, as :class:`.Oblate` has them."""

    @staticmethod
    def step_frames(orbit, reference, h):
        middle = oblate_step(orbit, reference, 0.5 * h)
        end = oblate_step(orbit, middle, 0.5 * h)
        return (oblate_motion(orbit, reference), oblate_motion(orbit, middle), oblate_motion(orbit, end))

    @staticmethod
    def follow_frame(orbit, before, after, h, q):
        start, end = oblate_attitude(before.reference), oblate_attitude(after.reference)
        turned = quaternion_product(start, conjugate(end))
        return quaternion_product(q, turned if h != 0.0 else (1.0, 0.0, 0.0, 0.0))

    @staticmethod
    def free_acceleration(orbit, motion, r, v):
        return oblate_acceleration(r, v, motion, orbit.mu, orbit.strength)

    @staticmethod
    def frame_rate(orbit, reference):
        motion = oblate_motion(orbit, reference)
        return (motion.rate_x, 0.0, motion.rate_z)

    @staticmethod
    def reference_at(orbit, elements, anomaly):
        e = elements.eccentricity
        p = elements.semi_major_axis * (1.0 - e * e)
        momentum = (elements.gravitational_parameter * p) ** 0.5
        return (
            p / (1.0 + e * math.cos(anomaly)),
            elements.gravitational_parameter / momentum * e * math.sin(anomaly),
            momentum,
            elements.raan,
            elements.inclination,
            elements.argument_of_perigee + anomaly,
        )

    @staticmethod
    def read_reference(orbit, rows, first, w):
        return (
            rows[first, w], rows[first + 1, w], rows[first + 2, w], rows[first + 3, w], rows[first + 4, w],
            rows[first + 5, w],
        )  # fmt: skip

    @staticmethod
    def write_reference(orbit, rows, first, w, reference):
        rows[first, w], rows[first + 1, w], rows[first + 2, w] = reference[0], reference[1], reference[2]
        rows[first + 3, w], rows[first + 4, w], rows[first + 5, w] = reference[3], reference[4], reference[5]

    @staticmethod
    def reference_of(orbit, motion):
        return motion.reference

    @staticmethod
    def reference_after(orbit, reference, duration, steps):
        h = 0.5 * duration / steps
        for _ in range(2 * steps):
            reference = oblate_step(orbit, reference, h)
        return reference

    @staticmethod
    def free_velocity(orbit, reference, drift, duration, steps, r, v):
        h, nothing = duration / steps, (0.0, 0.0, 0.0)
        place = reference_after(orbit, reference, -duration, steps)
        for _ in range(steps):
            frames = step_frames(orbit, place, h)
            r, v = translation_step(r, v, nothing, nothing, nothing, orbit, frames, h)
            place = frames[2].reference
        return v

    @staticmethod
    def osculating(orbit, reference):
        radius, climb, momentum, _, _, latitude = reference
        p = momentum * momentum / orbit.mu
        ec, es = p / radius - 1.0, momentum * climb / orbit.mu
        e = math.hypot(ec, es)
        a = p / (1.0 - e * e)
        n, anomaly = math.sqrt(orbit.mu / a) / a, math.atan2(es, ec)
        breadth = math.sqrt(1.0 - e * e)
        return Ellipse(n, a, e, breadth, since_perigee(n, e, anomaly), anomaly, latitude)


_OF_KIND: dict[type, Any] = {
    Hill: _Hill, Circular: _Circular, LinearElliptic: _LinearElliptic, Elliptic: _Elliptic, Oblate: _Oblate,
}  # fmt: skip
