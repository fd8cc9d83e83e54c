"""The classical team of `formation_attitude_v1`: every craft flies by the law of the source.

Models the quaternion error vector command law of Valdes 2008 (eqs. 3.20, 3.27): a torque against rate and
error quaternion, a dead band, and one pulse about each axis where the torque lies outside of it. It acts on
observations, which are noisy and relative to the leader; the same object serves any number of craft in any
number of worlds, each by itself. Gains follow from the spacecraft (eqs. 3.19, 3.29). Knows nothing of faults,
and does not balance the fuel. Leaves out memory of any kind.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.observations import Reader
from thruster_envs.pilots import AttitudePilot
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["QuaternionTeam"]


class QuaternionTeam:
    """Actions of `formation_attitude_v1` or `FormationAttitude-v1` from its observations.

    Args:
        spacecraft: What flies, as the flight software believes it to be.
        action: As the environment has it: `pulses`, or `duties`.
        largest_angle: Error that the whole torque of an axis balances, rad.
        rate_factor: The rate gain in units of the least that is stable for that angle.
        dead_band: A torque below this part of the whole one, as a divisor, is not asked for.

    Attributes:
        rate_gain: (3,), N m s.
        angle_gain: (3,), N m.
        threshold: (3,), N m, of the dead band.

    Raises:
        ValueError: A spacecraft that cannot be turned both ways about an axis, or an unknown action.

    >>> from thruster_envs.spacecraft import load
    >>> team = QuaternionTeam(load("ppt_cubesat"))
    >>> ahead, still = [0.9, 0.4, 0.0, 0.0], [0.0, 0.0, 0.0]  # turned less than it should be about x
    >>> team([*ahead, 0.0, 0.0, 0.0, *still]).tolist()
    [1, 0, 0]
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        *,
        action: Literal["pulses", "duties"] = "pulses",
        largest_angle: float = math.radians(1.0),
        rate_factor: float = 100.0,
        dead_band: float = 2.0,
    ) -> None:
        if action not in ("pulses", "duties"):
            raise ValueError(f"action is {action!r}; 'pulses' or 'duties' would be right")
        self._pilot = AttitudePilot.of(
            spacecraft, largest_angle=largest_angle, rate_factor=rate_factor, dead_band=dead_band
        )
        gains = self._pilot.gains
        self._number, self._action = spacecraft.number_of_thrusters, action
        self.rate_gain: FloatArray = gains.rate
        self.angle_gain: FloatArray = gains.angle
        self.threshold: FloatArray = gains.dead_band
        self._read = Reader.of("thruster_envs/FormationAttitude-v1", spacecraft=spacecraft, action=action)

    def torque(self, observations: ArrayLike) -> FloatArray:
        """(..., 3), N m: what the law asks for, dead band aside; observations are (..., k)."""
        reading = self._read(observations)
        return self._pilot.torque(-2.0 * reading.attitude[..., 1:], reading.rate)

    def __call__(self, observations: ArrayLike) -> NDArray[Any]:
        """Actions for observations (..., k): (..., 3) options, or (..., n) shares of a pulse, -1 to 1."""
        torque = self.torque(observations)
        outside = np.abs(torque) >= self.threshold
        if self._action == "pulses":
            return np.where(outside, np.where(torque > 0.0, 1, 2), 0)
        duties = np.full((*torque.shape[:-1], self._number), -1.0, np.float32)
        for axis in range(3):
            for side, sign in enumerate((1.0, -1.0)):
                fires = outside[..., axis] & (sign * torque[..., axis] > 0.0)
                duties[..., self._pilot.gains.thrusters[axis, side]][fires] = 1.0
        return duties
