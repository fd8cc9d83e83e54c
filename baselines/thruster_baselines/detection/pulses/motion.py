"""What the motion of a craft says of the thrust of its thrusters: least squares over a mission.

Opposite thrusters turn the craft about its principal axes. For each axis the measured rate w_k, less the
gyroscopic torque and the gravity gradient by the measured attitude, is

    I w_k = c + d k + J (s+ n+_k - s- n-_k) + errors,

with a start c, a constant torque d, the nominal impulse J, so many pulses n of either thruster until then,
and the shares s of nominal thrust, found by least squares with standard deviations. `misfit` compares causes
that the waveforms do not tell apart (`fit`).

Left out: thrusters that turn the craft about several axes, or an inertia with products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from thruster_envs.physics.attitude import conjugate, quaternion_product
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["MotionFit", "ThrustShares", "absolute_motion"]

_product: Callable[[Any, Any], tuple[FloatArray, ...]] = quaternion_product.py_func
_conjugate: Callable[[Any], tuple[FloatArray, ...]] = conjugate.py_func


@dataclass(frozen=True, slots=True)
class ThrustShares:
    """What each thruster gave, on average over the pulses of a mission.

    Attributes:
        share: (missions, n): of the nominal thrust; 1 where a thruster did not fire.
        deviation: (missions, n): standard deviation of its error; infinite where it did not fire.
    """

    share: FloatArray
    deviation: FloatArray


class MotionFit:
    """Fits the thrust of each thruster to the motion of a craft.

    Args:
        spacecraft: Description, with pairs of opposite thrusters about its principal axes: 1 and 2 about +x
            and -x, and so on.
        rate_error: Standard deviation of a measured rate, rad/s.

    Raises:
        ValueError: Thrusters or an inertia of another kind; an error that is not positive.
    """

    def __init__(self, spacecraft: Spacecraft, rate_error: float) -> None:
        if not rate_error > 0.0:
            raise ValueError(f"rate_error is {rate_error}; a positive number of rad/s would be right")
        if spacecraft.discharge is None:
            raise ValueError(
                f"{spacecraft.name} has no discharge; a craft with pulsed thrusters would be right"
            )
        acceleration = spacecraft.effectiveness()[3:]
        sizes = np.diag(acceleration[:, ::2])
        opposite = np.kron(np.diag(sizes), [1.0, -1.0])
        if acceleration.shape != opposite.shape or not np.allclose(acceleration, opposite, rtol=1e-9):
            raise ValueError(
                f"the thrusters of {spacecraft.name} are not opposite pairs about the axes of its body; such "
                "pairs, 1 and 2 about +x and -x and so on, would be right"
            )
        self._kick = spacecraft.discharge.firing_time * sizes  # rad/s, of one nominal pulse
        self._inertia = np.diag(spacecraft.inertia)
        self._mean_motion = spacecraft.circular_mean_motion("the fit of thrusts to motion")
        self._gradient = 3.0 * self._mean_motion**2
        self._period = spacecraft.control_period
        self._error = rate_error

    def __call__(self, attitude: FloatArray, rate: FloatArray, pulses: FloatArray) -> ThrustShares:
        """Fit each thruster's share of its nominal thrust.

        Args:
            attitude: (missions, periods + 1, 4), body-from-inertial, as measured before the pulses of each
                period and after the last; the frame is that of the orbit at the start.
            rate: (missions, periods + 1, 3), rad/s, likewise.
            pulses: (missions, periods, 3): 1, -1 or 0 about each axis.

        Raises:
            ValueError: Shapes that do not fit together.
        """
        seen = self._in_pulses(attitude, rate, pulses)
        columns = _counted(np.stack((np.maximum(pulses, 0.0), np.minimum(pulses, 0.0)), axis=-1))
        share, deviation = np.ones((len(seen), 3, 2)), np.full((len(seen), 3, 2), np.inf)
        for axis in range(3):
            for mission in range(len(seen)):
                fired = columns[mission, -1, axis] != 0.0
                design = np.concatenate((_drift(seen.shape[1]), columns[mission, :, axis, fired].T), axis=1)
                inverse = np.linalg.inv(design.T @ design)
                found = inverse @ design.T @ seen[mission, :, axis]
                share[mission, axis, fired] = found[2:]
                error = self._error / self._kick[axis]
                deviation[mission, axis, fired] = error * np.sqrt(np.diag(inverse)[2:])
        return ThrustShares(share.reshape(len(seen), 6), deviation.reshape(len(seen), 6))

    def misfit(
        self, attitude: FloatArray, rate: FloatArray, pulses: FloatArray, share: FloatArray
    ) -> FloatArray:
        """(missions, axes): squared errors of the motion, in variances, if pulses gave stated shares.

        Start and constant torque are fitted. Of two causes the one with the smaller misfit is more likely, by
        half of the difference in the logarithm.

        Args:
            attitude: As for a fit.
            rate: As for a fit.
            pulses: As for a fit.
            share: (missions, periods, 3): of the nominal thrust, of the pulse about each axis in each period.

        Raises:
            ValueError: Shapes that do not fit together.
        """
        seen = self._in_pulses(attitude, rate, pulses)
        left = seen - _counted(np.asarray(pulses) * share)
        basis = np.linalg.qr(_drift(seen.shape[1]))[0]
        left = left - np.einsum("kb,lb,mla->mka", basis, basis, left, optimize=True)
        return np.asarray((left**2).sum(axis=1) * (self._kick / self._error) ** 2)

    def width_changed(
        self,
        attitude: FloatArray,
        rate: FloatArray,
        pulses: FloatArray,
        fired: tuple[IntArray, IntArray],
        by_mass: FloatArray,
        by_width: FloatArray,
    ) -> BoolArray:
        """(n,): for each thruster, whether the motion of a mission speaks for width rather than for mass.

        One thruster is asked about at a time; the others are taken to have lost mass.

        Args:
            attitude: (periods + 1, 4), as for a fit, of one mission.
            rate: (periods + 1, 3), rad/s.
            pulses: (periods, 3).
            fired: Period and thruster, both from 0, of each firing.
            by_mass: (firings,): share of the nominal thrust if the mass has changed.
            by_width: (firings,): the same if the width has.
        """
        periods, thrusters = fired
        assumed = np.ones((1, *pulses.shape))
        assumed[0, periods, thrusters // 2] = by_mass
        motion = attitude[np.newaxis], rate[np.newaxis], pulses[np.newaxis]
        mass = self.misfit(*motion, assumed)[0]
        answer = np.zeros(6, dtype=np.bool_)
        for thruster in np.unique(thrusters):
            own = thrusters == thruster
            other = assumed.copy()
            other[0, periods[own], thruster // 2] = by_width[own]
            answer[thruster] = self.misfit(*motion, other)[0, thruster // 2] < mass[thruster // 2]
        return answer

    def _in_pulses(self, attitude: FloatArray, rate: FloatArray, pulses: FloatArray) -> FloatArray:
        """(missions, periods + 1, 3): rates in nominal pulses, less what the craft does by itself."""
        missions, periods = np.shape(pulses)[:2]
        for name, array, width in (("attitude", attitude, 4), ("rate", rate, 3)):
            if array.shape != (missions, periods + 1, width):
                raise ValueError(
                    f"{name} has the shape {array.shape}; {(missions, periods + 1, width)} would be right"
                )
        angle = self._mean_motion * self._period * np.arange(periods + 1)
        vertical = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
        down = _rotated(attitude, vertical)
        torque = self._gradient * np.cross(down, self._inertia * down)
        torque -= np.cross(rate, self._inertia * rate)
        change = self._period * (torque / self._inertia)
        natural = _counted(0.5 * (change[:, 1:] + change[:, :-1]))
        return np.asarray((rate - natural) / self._kick)


def absolute_motion(
    attitude: FloatArray, rate: FloatArray, leader_attitude: FloatArray, leader_rate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Attitude and rate of a follower in the inertial frame, from those relative to a leader.

    Args:
        attitude: (..., 4), follower-from-leader, scalar first.
        rate: (..., 3), rad/s, less that of the leader, in axes of the follower.
        leader_attitude: (..., 4), leader-from-inertial.
        leader_rate: (..., 3), rad/s, in axes of the leader.

    Returns:
        (..., 4) and (..., 3).
    """
    whole = _product(np.moveaxis(attitude, -1, 0), np.moveaxis(leader_attitude, -1, 0))
    return np.stack(whole, axis=-1), rate + _rotated(attitude, leader_rate)


def _rotated(attitude: FloatArray, vector: FloatArray) -> FloatArray:
    """(..., 3): components in the body of vectors in the reference frame."""
    q = np.moveaxis(attitude, -1, 0)
    v = (np.zeros_like(vector[..., 0]), *np.moveaxis(vector, -1, 0))
    return np.stack(_product(_product(q, v), _conjugate(q))[1:], axis=-1)


def _counted(steps: FloatArray) -> FloatArray:
    """(missions, periods + 1, ...): the sum of what came before each moment."""
    total = np.zeros((steps.shape[0], steps.shape[1] + 1, *steps.shape[2:]))
    np.cumsum(steps, axis=1, out=total[:, 1:])
    return total


def _drift(moments: int) -> FloatArray:
    """(moments, 2): a start and a constant torque."""
    return np.stack((np.ones(moments), np.linspace(0.0, 1.0, moments)), axis=-1)
