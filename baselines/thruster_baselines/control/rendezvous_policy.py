"""The rendezvous controller as a policy: from an observation of `OrionRendezvous-v0` to an action.

The environment's documentation gives the meaning and the unit of every entry of its observation; this
module turns the first thirteen back into measurements. The rest (last duties, measured and expected rate
changes) is not used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.control.quaternions import rotation_matrix
from thruster_baselines.control.rendezvous import RendezvousController

__all__ = ["RendezvousPolicy"]

_POSITION, _VELOCITY, _ANGLE, _RATE = 300.0, 0.5, 0.5, 0.05  # what 1 stands for: m, m/s, rad, rad/s


class RendezvousPolicy:
    """Acts on observations of `OrionRendezvous-v0`, one after the other.

    The first observation of an episode (all of the time still to go) resets it.

    Args:
        controller: Made for the environment's spacecraft and number of steps.
    """

    def __init__(self, controller: RendezvousController) -> None:
        self.controller = controller

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Action (n,), -1 to 1, for an observation of one environment."""
        seen = np.asarray(observation, dtype=np.float64)
        spacecraft = self.controller.spacecraft
        step = round((1.0 - seen[12]) * self.controller.steps)
        if step == 0:
            self.controller.reset()
        # The observed attitude error is minus twice the vector part of the quaternion.
        vector = -0.5 * _ANGLE * seen[6:9]
        attitude = np.concatenate([[np.sqrt(max(0.0, 1.0 - float(vector @ vector)))], vector])
        orbit_rate = rotation_matrix(attitude) @ [0.0, 0.0, spacecraft.mean_motion]
        duties = self.controller(
            step * spacecraft.control_period,
            _POSITION * seen[:3],
            _VELOCITY * seen[3:6],
            attitude,
            _RATE * seen[9:12] + orbit_rate,
        )
        return (2.0 * duties - 1.0).astype(np.float32)
