"""Relative translation about a circular orbit: Hill-Clohessy-Wiltshire and full two-body motion.

Frame: LVLH, x radial (outward), y along-track, z cross-track, origin on a circular orbit of mean motion
``n``; positions in m, specific forces in m/s^2. Leaves out J2, drag, solar pressure and eccentric reference
orbits.

Sources: Clohessy and Wiltshire 1960; Yang 2003, section 6.1; Alfriend et al. 2010, "Spacecraft Formation
Flying", eqs. 4.14-4.16.
"""

import math

import numpy as np
from numba import njit

from thruster_envs.spacecraft.description import EARTH_MU


def orbit_radius(mean_motion: float, mu: float = EARTH_MU) -> float:
    """Radius in m of the circular orbit with that mean motion in rad/s."""
    return float((mu / mean_motion**2) ** (1.0 / 3.0))


def transition_matrix(mean_motion: float, time: float) -> np.ndarray:
    """State transition matrix (6, 6) of the Hill-Clohessy-Wiltshire equations over ``time`` seconds."""
    n, t = mean_motion, time
    s, c = math.sin(n * t), math.cos(n * t)
    return np.array(
        [
            [4 - 3 * c, 0, 0, s / n, 2 * (1 - c) / n, 0],
            [6 * (s - n * t), 1, 0, -2 * (1 - c) / n, 4 * s / n - 3 * t, 0],
            [0, 0, c, 0, 0, s / n],
            [3 * n * s, 0, 0, c, 2 * s, 0],
            [-6 * n * (1 - c), 0, 0, -2 * s, 4 * c - 3, 0],
            [0, 0, -n * s, 0, 0, c],
        ]
    )


@njit(forceinline=True)
def hill_acceleration(r, v, n):
    """Free relative acceleration (m/s^2) by the Hill-Clohessy-Wiltshire equations."""
    return (2.0 * n * v[1] + 3.0 * n * n * r[0], -2.0 * n * v[0], -n * n * r[2])


@njit(forceinline=True)
def two_body_acceleration(r, v, n, radius):
    """Free relative acceleration (m/s^2) of two-body motion about a circular orbit of that radius (m).

    Without cancellation: with ``1 + e`` the squared distance to the planet over ``radius**2``, the factor
    ``1 - (1 + e)**(-3/2)`` is formed from ``e`` itself.
    """
    e = (2.0 * r[0] + (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / radius) / radius
    s = (1.0 + e) ** 0.5
    cube = s * s * s
    g = e / (1.0 + s) * (s * s + s + 1.0) / cube
    nn = n * n
    return (
        2.0 * n * v[1] + nn * (radius + r[0]) * g,
        -2.0 * n * v[0] + nn * r[1] * g,
        nn * r[2] * (g - 1.0),
    )


@njit(forceinline=True)
def free_acceleration(r, v, n, radius):
    """Free relative acceleration: by Hill's equations when ``radius`` is None, else two-body.

    Which of the two is decided when the kernel is compiled.
    """
    if radius is None:
        return hill_acceleration(r, v, n)
    return two_body_acceleration(r, v, n, radius)


@njit(forceinline=True)
def translation_step(r, v, f0, fm, f1, n, radius, h):
    """Position and velocity after one RK4 step.

    The specific force of the thrust is given at the start, the middle and the end of the step, in LVLH.
    """
    a1 = _sum(free_acceleration(r, v, n, radius), f0)
    v2 = _along(v, 0.5 * h, a1)
    a2 = _sum(free_acceleration(_along(r, 0.5 * h, v), v2, n, radius), fm)
    v3 = _along(v, 0.5 * h, a2)
    a3 = _sum(free_acceleration(_along(r, 0.5 * h, v2), v3, n, radius), fm)
    v4 = _along(v, h, a3)
    a4 = _sum(free_acceleration(_along(r, h, v3), v4, n, radius), f1)
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
