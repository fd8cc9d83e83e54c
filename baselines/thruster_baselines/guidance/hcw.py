"""Relative motion about a circular orbit in closed form: the Hill-Clohessy-Wiltshire equations.

    x'' = 2 n y' + 3 n^2 x + f_x,    y'' = -2 n x' + f_y,    z'' = -n^2 z + f_z

in LVLH (x radial, y along-track, z cross-track), with the mean motion n and a specific force f that is
constant over the time in question. Exact under that assumption; left out is everything that is not in these
equations: eccentricity, drag, oblateness, and separations that are not small against the orbit's radius.

Source: Clohessy and Wiltshire 1960; Yang 2003, eqs. 65-66.
"""

from __future__ import annotations

import numpy as np

from thruster_envs.physics.orbits import angle_minus_sine, transition_matrix
from thruster_envs.protocols import FloatArray

__all__ = ["force_response", "transition_matrix"]


def force_response(mean_motion: float, duration: float) -> FloatArray:
    """What a constant specific force of 1 m/s^2 on each axis adds to the state in `duration`.

    Args:
        mean_motion: rad/s.
        duration: s.

    Returns:
        (6, 3): m then m/s, per m/s^2, LVLH.
    """
    n, angle = mean_motion, mean_motion * duration
    s = np.sin(angle)
    v = 2.0 * np.sin(0.5 * angle) ** 2
    d = angle_minus_sine(angle)
    along_position = 4.0 * v / n**2 - 1.5 * duration**2
    return np.array(
        [
            [v / n**2, 2.0 * d / n**2, 0.0],
            [-2.0 * d / n**2, along_position, 0.0],
            [0.0, 0.0, v / n**2],
            [s / n, 2.0 * v / n, 0.0],
            [-2.0 * v / n, (s - 3.0 * d) / n, 0.0],
            [0.0, 0.0, s / n],
        ]
    )
