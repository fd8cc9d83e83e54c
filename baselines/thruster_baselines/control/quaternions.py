"""The few quaternion operations that guidance software needs, on NumPy arrays.

Scalar-first unit quaternions, Hamilton product. An attitude is body-from-reference: `v_body = q (x) v (x)
q*`, so that a body which turned by a small angle vector `a` (body axes) away from the reference has q = (1,
-a / 2).
"""

from __future__ import annotations

import numpy as np

from thruster_envs.protocols import FloatArray

__all__ = ["attitude_error", "product", "rotation_matrix", "turned"]


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product of two quaternions (4,)."""
    w, x, y, z = a
    result: FloatArray = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]) @ b
    return result


def rotation_matrix(attitude: FloatArray) -> FloatArray:
    """(3, 3): turns components in the reference frame into components in the body."""
    w, x, y, z = attitude
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def attitude_error(attitude: FloatArray) -> FloatArray:
    """(3,), rad: the rotation vector by which the body has turned away from the reference, body axes."""
    vector = -attitude[1:] if attitude[0] >= 0.0 else attitude[1:]
    half_sine = float(np.linalg.norm(vector))
    if half_sine < 1e-12:
        return 2.0 * vector
    error: FloatArray = vector * (2.0 * np.arctan2(half_sine, abs(float(attitude[0]))) / half_sine)
    return error


def turned(attitude: FloatArray, angle: FloatArray) -> FloatArray:
    """The attitude after the body turns further by a rotation vector (3,), rad, body axes."""
    size = float(np.linalg.norm(angle))
    half = 0.5 * size
    shape = 0.5 * np.sinc(half / np.pi)  # sin(size / 2) / size
    after = product(np.concatenate([[np.cos(half)], -shape * angle]), attitude)
    unit: FloatArray = after / np.linalg.norm(after)
    return unit
