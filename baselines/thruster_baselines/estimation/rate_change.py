"""What thrusters have changed, from two measurements of the motion: the free motion taken off.

The difference of two velocity measurements also holds what the craft would have done without firing. At 300 m
above the target the tide alone pulls with 1.1 mm/s^2, more than a velocity error of 0.5 mm/s in each second
(the source takes the plain difference). It is predicted from the first measurement by the
Hill-Clohessy-Wiltshire equations, and the turning of the body by its gyroscopic torque at the mean rate; what
is left, in body axes at the first measurement, is the rate change that `EffectivenessFilter` and detectors
want. The environments' own measured rate change is made in the same way.

Left out: that the body turns while it fires, perturbations of the orbit, and what a force does to the free
motion within the interval (second order in its length).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.guidance.hcw import transition_matrix
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["thrust_rate_change"]


def thrust_rate_change(
    spacecraft: Spacecraft,
    before: ArrayLike,
    after: ArrayLike,
    duration: float,
    *,
    time: float | None = None,
) -> FloatArray:
    """Rate change (..., 6) that firing gave in an interval, m/s then rad/s, body axes.

    Args:
        spacecraft: Its inertia and the mean motion of its orbit.
        before: (..., 13): position, m, velocity, m/s, LVLH; attitude, body-from-LVLH, scalar first; inertial
            rate, rad/s, body axes.
        after: The same at the end of the interval; its position and attitude are not used.
        duration: Of the interval, s.
        time: When it begins, s of the episode's clock; an elliptic orbit needs it.

    Raises:
        ValueError: Other shapes, a duration that is not positive, an elliptic orbit without a time.
    """
    first, last = np.asarray(before, dtype=np.float64), np.asarray(after, dtype=np.float64)
    if first.shape[-1:] != (13,) or last.shape != first.shape:
        raise ValueError(
            f"before and after have the shapes {first.shape} and {last.shape}; both (..., 13) would be right"
        )
    if not 0.0 < duration < np.inf:
        raise ValueError(f"duration is {duration}; a positive number of s would be right")
    if time is None:
        spacecraft.circular_mean_motion("thrust_rate_change without a time")
    moved = transition_matrix(spacecraft.reference_orbit, duration, time or 0.0)
    drift = first[..., :6] @ moved[3:].T
    pushed, scalar, vector = last[..., 3:6] - drift, first[..., 6:7], first[..., 7:10]
    crossed = 2.0 * np.cross(vector, pushed)
    translation = pushed + scalar * crossed + np.cross(vector, crossed)  # q (x) v (x) q*: into the body
    inertia = np.array(spacecraft.inertia)
    mean = 0.5 * (first[..., 10:] + last[..., 10:])
    free = -np.cross(mean, mean @ inertia.T) @ np.linalg.inv(inertia).T
    rotation = last[..., 10:] - first[..., 10:] - duration * free
    return np.concatenate([translation, rotation], axis=-1)
