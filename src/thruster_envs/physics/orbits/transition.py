"""Free relative motion by the linear equations: the only transition matrix of the package."""

import math

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.physics.orbits.kinds import ellipse_of
from thruster_envs.physics.orbits.motion import frame_motion
from thruster_envs.spacecraft.orbit import Orbit


def transition_matrix(orbit: Orbit | float, duration: float, time: float = 0.0) -> NDArray[np.float64]:
    """How a free state (position, velocity) moves on by the linear equations, (6, 6), m and m/s, LVLH.

    ``state(time + duration) = transition_matrix @ state(time)``. J2 is left out.

    Args:
        orbit: The orbit, or the mean motion of a circular one, rad/s.
        duration: s; may be negative.
        time: At which it begins, s of the episode's clock; it matters on an elliptic orbit.

    >>> transition_matrix(0.001, 0.0).tolist() == np.eye(6).tolist()
    True
    """
    if not isinstance(orbit, Orbit):
        return np.array(_hill_transition(orbit, duration))
    if orbit.is_circular:
        return np.array(_hill_transition(orbit.mean_motion, duration))
    kind, start = ellipse_of(orbit), orbit.start + time
    before, after = (frame_motion.py_func(kind, one) for one in (start, start + duration))
    state = np.eye(6)
    r, v = free_motion.py_func(kind.eccentricity, before, after, duration, state[:3], state[3:])
    return np.array([*r, *v])


def _hill_transition(n, t):
    """State transition matrix of the Hill-Clohessy-Wiltshire equations over ``t`` seconds, six rows.

    Without cancellation, however short the time.
    """
    angle = n * t
    s, c, half = math.sin(angle), math.cos(angle), math.sin(0.5 * angle)
    v = 2.0 * half * half  # 1 - cos
    d = angle_minus_sine(angle)
    return (
        (1.0 + 3.0 * v, 0.0, 0.0, s / n, 2.0 * v / n, 0.0),
        (-6.0 * d, 1.0, 0.0, -2.0 * v / n, (s - 3.0 * d) / n, 0.0),
        (0.0, 0.0, c, 0.0, 0.0, s / n),
        (3.0 * n * s, 0.0, 0.0, c, 2.0 * s, 0.0),
        (-6.0 * n * v, 0.0, 0.0, -2.0 * s, 1.0 - 4.0 * v, 0.0),
        (0.0, 0.0, -n * s, 0.0, 0.0, c),
    )


def angle_minus_sine(angle: float) -> float:
    """``angle - sin(angle)`` without loss of digits at small angles, rad."""
    if abs(angle) > 0.5:
        return angle - math.sin(angle)
    square = angle * angle
    series = 1.0
    for k in (19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0):
        series = 1.0 - square / (k * (k - 1.0)) * series
    return angle * square / 6.0 * series


@njit
def free_motion(e, before, after, duration, r, v):
    """Position (m) and velocity (m/s) after free motion by the linear equations about an elliptic orbit.

    The transition matrix of Yamanaka and Ankersen 2002, eqs. 82-86, applied to a state, between two motions
    of LVLH on an orbit of eccentricity ``e``, ``duration`` seconds apart. Their axes are ours in another
    order: along-track, minus cross-track, minus radial.
    """
    c0, s0, p0, k = _anomaly(e, before)
    c1, s1, p1, _ = _anomaly(e, after)
    # Scaled positions, and their rates of change with the true anomaly.
    x, y, z = p0 * r[1], p0 * r[2], -p0 * r[0]
    scale, bend = 1.0 / (k * p0), e * s0
    dx, dy, dz = scale * v[1] - bend * r[1], scale * v[2] - bend * r[2], bend * r[0] - scale * v[0]
    # In the plane: the pseudo-initial values, with s = p0 s0 and c = p0 c0 written out.
    q0 = 1.0 + p0
    a = x + (3.0 * e * s0 * (1.0 + 1.0 / p0) * z - e * s0 * q0 * dx + (2.0 - e * p0 * c0) * dz) / (
        1.0 - e * e
    )
    b = (-3.0 * s0 * (1.0 + e * e / p0) * z + s0 * q0 * dx + (p0 * c0 - 2.0 * e) * dz) / (1.0 - e * e)
    d = (-3.0 * (c0 + e) * z + (c0 * q0 + e) * dx - p0 * s0 * dz) / (1.0 - e * e)
    f = ((3.0 * p0 + e * e - 1.0) * z - p0 * p0 * dx + e * p0 * s0 * dz) / (1.0 - e * e)
    s, c, j, q1 = p1 * s1, p1 * c1, k * duration, 1.0 + p1
    along, down = (
        a - c1 * q1 * b + s1 * q1 * d + 3.0 * p1 * p1 * j * f,
        s * b + c * d + (2.0 - 3.0 * e * s * j) * f,
    )
    along_rate = 2.0 * s * b + (2.0 * c - e) * d + 3.0 * (1.0 - 2.0 * e * s * j) * f
    ds, dc = c1 + e * (c1 * c1 - s1 * s1), -(s1 + 2.0 * e * s1 * c1)
    down_rate = ds * b + dc * d - 3.0 * e * (ds * j + s1 / p1) * f
    # Across it: a turn by the difference of the anomalies.
    cosine, sine = c1 * c0 + s1 * s0, s1 * c0 - c1 * s0
    across, across_rate = cosine * y + sine * dy, cosine * dy - sine * y
    inverse, back, bend = 1.0 / p1, k * p1, k * e * s1
    return (
        (-inverse * down, inverse * along, inverse * across),
        (
            -bend * down - back * down_rate,
            bend * along + back * along_rate,
            bend * across + back * across_rate,
        ),
    )


@njit(forceinline=True)
def _anomaly(e, motion):
    """Cosine and sine of the true anomaly, ``1 + e cos``, and ``h / p**2``, 1/s."""
    c = 1.0 - 2.0 * motion.sine * motion.sine
    p = 1.0 + e * c
    return c, 2.0 * motion.sine * motion.cosine, p, motion.rate / (p * p)
