"""The rendezvous controller as a policy: from an observation of `OrionRendezvous-v0` to an action.

The environment's documentation gives the meaning and the unit of every entry of its observation; this
module turns the first thirteen back into measurements. `RendezvousPolicy` allocates by itself and acts on the
environment; `RendezvousCommandPolicy` commands rate changes and acts on the environment within
`thruster_envs.views.MapperAction`, whose mapper allocates. That one also reads the last duties, to know what
was fired. The rest (measured and expected rate changes) is not used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.control.quaternions import rotation_matrix
from thruster_baselines.control.rendezvous import RendezvousController
from thruster_envs.protocols import FloatArray

__all__ = ["RendezvousCommandPolicy", "RendezvousPolicy"]

_POSITION, _VELOCITY, _ANGLE, _RATE = 300.0, 0.5, 0.5, 0.05  # what 1 stands for: m, m/s, rad, rad/s
_LAST_DUTIES = 13  # the first entry of theirs


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
        duties = self.controller(*_measurements(self.controller, observation))
        return (2.0 * duties - 1.0).astype(np.float32)


class RendezvousCommandPolicy:
    """Acts on observations of `OrionRendezvous-v0` within `MapperAction`: commands, and lets others allocate.

    The first observation of an episode resets it.

    Args:
        controller: Made for the environment's spacecraft and number of steps; its own mapper is not used.
    """

    def __init__(self, controller: RendezvousController) -> None:
        self.controller = controller
        self._authority = controller.spacecraft.authority()

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Action (6,), the commanded rate change in shares of the authority per axis, clipped to -1 to 1."""
        spacecraft = self.controller.spacecraft
        measurements = _measurements(self.controller, observation)
        last_duties = np.asarray(observation, dtype=np.float64)[_LAST_DUTIES:][: len(spacecraft.thrusters)]
        command = self.controller.command(*measurements, on_times=last_duties * spacecraft.control_period)
        return np.clip(command / self._authority, -1.0, 1.0).astype(np.float32)


def _measurements(
    controller: RendezvousController, observation: ArrayLike
) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, position, velocity, attitude and rate as the controller wants them; it is reset at a start."""
    seen = np.asarray(observation, dtype=np.float64)
    spacecraft = controller.spacecraft
    step = round((1.0 - seen[12]) * controller.steps)
    if step == 0:
        controller.reset()
    # The observed attitude error is minus twice the vector part of the quaternion.
    vector = -0.5 * _ANGLE * seen[6:9]
    attitude = np.concatenate([[np.sqrt(max(0.0, 1.0 - float(vector @ vector)))], vector])
    orbit_rate = rotation_matrix(attitude) @ [0.0, 0.0, spacecraft.mean_motion]
    return (
        step * spacecraft.control_period,
        _POSITION * seen[:3],
        _VELOCITY * seen[3:6],
        attitude,
        _RATE * seen[9:12] + orbit_rate,
    )
