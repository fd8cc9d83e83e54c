"""What is known about motion without forces, or under a constant one: closed forms and conserved quantities.

Modelled: relative translation by the Hill-Clohessy-Wiltshire equations (Clohessy and Wiltshire 1960),
torque-free rotation of an axisymmetric body (Euler), and what a coasting craft conserves. Conventions as in
`reference_flight`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

EARTH_GRAVITATIONAL_PARAMETER = 3.986004418e14
"""m^3/s^2."""


def orbit_radius(mean_motion: float) -> float:
    """Radius (m) of the circular orbit with a mean motion (rad/s): Kepler's third law."""
    return float(np.cbrt(EARTH_GRAVITATIONAL_PARAMETER / mean_motion**2))


def hcw_transition(mean_motion: float, time: float) -> Array:
    """State transition matrix (6, 6) of the Hill-Clohessy-Wiltshire equations after a time (s).

    Rows and columns: position in m, then velocity in m/s. Free drift for a mean motion of 0.
    """
    n, t = mean_motion, time
    if n == 0.0:
        return np.block([[np.eye(3), t * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    s, c = math.sin(n * t), math.cos(n * t)
    versine = 2.0 * math.sin(0.5 * n * t) ** 2  # 1 - c
    return np.array(
        [
            [4.0 - 3.0 * c, 0.0, 0.0, s / n, 2.0 * versine / n, 0.0],
            [6.0 * (s - n * t), 1.0, 0.0, -2.0 * versine / n, (4.0 * s - 3.0 * n * t) / n, 0.0],
            [0.0, 0.0, c, 0.0, 0.0, s / n],
            [3.0 * n * s, 0.0, 0.0, c, 2.0 * s, 0.0],
            [-6.0 * n * versine, 0.0, 0.0, -2.0 * s, 4.0 * c - 3.0, 0.0],
            [0.0, 0.0, -n * s, 0.0, 0.0, c],
        ]
    )


def hcw_constant_acceleration(mean_motion: float, time: float) -> Array:
    """What a constant acceleration in LVLH (m/s^2) adds to position and velocity within a time (s): (6, 3).

    The integral of the velocity columns of `hcw_transition`.
    """
    n, t = mean_motion, time
    if n == 0.0:
        return np.vstack([0.5 * t * t * np.eye(3), t * np.eye(3)])
    s = math.sin(n * t)
    versine = 2.0 * math.sin(0.5 * n * t) ** 2
    lag = n * t - s
    return np.array(
        [
            [versine / n**2, 2.0 * lag / n**2, 0.0],
            [-2.0 * lag / n**2, 4.0 * versine / n**2 - 1.5 * t * t, 0.0],
            [0.0, 0.0, versine / n**2],
            [s / n, 2.0 * versine / n, 0.0],
            [-2.0 * versine / n, 4.0 * s / n - 3.0 * t, 0.0],
            [0.0, 0.0, s / n],
        ]
    )


def torque_free_axisymmetric(
    transverse_inertia: float,
    axial_inertia: float,
    attitude: ArrayLike,
    rate: ArrayLike,
    time: float,
    mean_motion: float = 0.0,
) -> tuple[Array, Array]:
    """Attitude (4,) and rate (3,) of a body without torque after a time (s).

    Its inertia is diag(transverse, transverse, axial), kg m^2.

    The body cones about its angular momentum H at |H| / transverse and spins back about its z axis at
    `(axial - transverse) / transverse * rate_z`; in body axes the transverse rate turns at that same spin
    (Euler's regular precession).
    """
    attitude, rate = np.array(attitude, dtype=float), np.array(rate, dtype=float)
    spin = (axial_inertia - transverse_inertia) / transverse_inertia * rate[2]
    momentum_body = np.array([transverse_inertia, transverse_inertia, axial_inertia]) * rate
    cone_rate = (
        rotate(conjugate(attitude), momentum_body) / transverse_inertia
    )  # inertial axes (= LVLH at t = 0)
    coned = product(rotation_quaternion(cone_rate * time), conjugate(attitude))
    inertial_from_body = product(coned, rotation_quaternion([0.0, 0.0, -spin * time]))
    body_from_lvlh = product(conjugate(inertial_from_body), inertial_from_lvlh(mean_motion, time))
    s, c = math.sin(spin * time), math.cos(spin * time)
    return body_from_lvlh, np.array([c * rate[0] - s * rate[1], s * rate[0] + c * rate[1], rate[2]])


def angular_momentum(
    inertia: ArrayLike, attitude: ArrayLike, rate: ArrayLike, time: float, mean_motion: float
) -> Array:
    """Angular momentum about the centre of mass in inertial axes, (3,) N m s, at a time (s) of the flight."""
    momentum_lvlh = rotate(conjugate(attitude), np.array(inertia) @ np.array(rate, dtype=float))
    return rotate(inertial_from_lvlh(mean_motion, time), momentum_lvlh)


def rotational_energy(inertia: ArrayLike, rate: ArrayLike) -> float:
    """Kinetic energy of rotation, J."""
    rate = np.array(rate, dtype=float)
    return float(0.5 * rate @ np.array(inertia) @ rate)


def relative_energy(position: ArrayLike, velocity: ArrayLike, mean_motion: float) -> float:
    """What a coasting craft keeps, J/kg: Jacobi's constant of the exact relative motion, 0 at the origin.

    `|v|^2 / 2 - n^2 ((R + x)^2 + y^2) / 2 - mu / r + 3 n^2 R^2 / 2`, written without its cancelling terms.
    """
    x, y, z = np.array(position, dtype=float)
    velocity = np.array(velocity, dtype=float)
    n, radius = mean_motion, orbit_radius(mean_motion)
    excess = (2.0 * radius * x + x * x + y * y + z * z) / radius**2
    nearness = math.expm1(-0.5 * math.log1p(excess))  # R / r - 1
    return float(
        0.5 * velocity @ velocity - n * n * (0.5 * (2.0 * radius * x + x * x + y * y) + radius**2 * nearness)
    )


def inertial_state(
    position: ArrayLike, velocity: ArrayLike, mean_motion: float, time: float
) -> tuple[Array, Array]:
    """Position (m) and velocity (m/s) in inertial axes from the centre of the Earth, from those in LVLH."""
    from_centre = np.array(position, dtype=float) + np.array([orbit_radius(mean_motion), 0.0, 0.0])
    turning = cross(np.array([0.0, 0.0, mean_motion]), from_centre)
    turn = inertial_from_lvlh(mean_motion, time)
    return rotate(turn, from_centre), rotate(turn, np.array(velocity, dtype=float) + turning)


def inertial_from_lvlh(mean_motion: float, time: float) -> Array:
    """Quaternion (4,) with `v_inertial = q v_lvlh q*`: LVLH has turned by n t about +z."""
    return rotation_quaternion([0.0, 0.0, mean_motion * time])


def rotation_quaternion(rotation_vector: ArrayLike) -> Array:
    """Quaternion (4,) that turns vectors by |rotation vector| (rad) about its direction: `v' = q v q*`."""
    rotation_vector = np.array(rotation_vector, dtype=float)
    angle = float(np.linalg.norm(rotation_vector))
    half_sinc = 0.5 * np.sinc(0.5 * angle / math.pi)
    return np.concatenate([[math.cos(0.5 * angle)], half_sinc * rotation_vector])


def rotation_angle(first: ArrayLike, second: ArrayLike) -> float:
    """Angle (rad) between two attitudes, accurate for small ones and blind to the sign of a quaternion."""
    difference = product(first, conjugate(second))
    return 2.0 * math.atan2(float(np.linalg.norm(difference[1:])), abs(float(difference[0])))


def rotation_matrix(quaternion: ArrayLike) -> Array:
    """Matrix (3, 3) with `matrix @ v = q v q* / |q|^2`: body-from-LVLH for an attitude."""
    w, x, y, z = np.array(quaternion, dtype=float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def rotate(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """`q v q*` of a unit quaternion (4,) and a vector (3,)."""
    pure = np.concatenate([[0.0], np.array(vector, dtype=float)])
    return product(product(quaternion, pure), conjugate(quaternion))[1:]


def product(left: ArrayLike, right: ArrayLike) -> Array:
    """Hamilton product of two quaternions (4,), scalar first."""
    (a, b, c, d), (e, f, g, h) = np.array(left, dtype=float), np.array(right, dtype=float)
    return np.array(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    )


def conjugate(quaternion: ArrayLike) -> Array:
    """Conjugate of a quaternion (4,)."""
    return np.array(quaternion, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def cross(left: Array, right: Array) -> Array:
    """Cross product of two vectors, (3,) each, or of two rows of vectors, (3, n) each."""
    (a, b, c), (d, e, f) = left, right
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])
