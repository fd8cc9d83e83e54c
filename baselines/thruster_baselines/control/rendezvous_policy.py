"""The rendezvous controller as a policy: from an observation of `OrionRendezvous-v1` to an action.

`RendezvousPolicy` allocates by itself and acts on the
environment; `RendezvousCommandPolicy` commands rate changes and acts on the environment within
`thruster_envs.views.MapperAction`, whose mapper allocates. That one also reads the last duties, to know what
was fired. The rest (measured and expected rate changes) is not used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.control.quaternions import rotation_matrix
from thruster_baselines.control.rendezvous import RendezvousController
from thruster_envs.observations import Reader, Reading
from thruster_envs.protocols import FloatArray

__all__ = ["RendezvousCommandPolicy", "RendezvousPolicy"]

_ENVIRONMENT = "thruster_envs/OrionRendezvous-v1"


class RendezvousPolicy:
    """Acts on observations of `OrionRendezvous-v1`, one after the other.

    The first observation of an episode (all of the time still to go) resets it.

    Args:
        controller: Made for the environment's spacecraft and number of steps.
    """

    def __init__(self, controller: RendezvousController) -> None:
        self.controller = controller
        self._read = Reader.of(_ENVIRONMENT, spacecraft=controller.spacecraft)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Action (n,), -1 to 1, for an observation of one environment."""
        duties = self.controller(*_measurements(self.controller, self._read(observation)))
        return (2.0 * duties - 1.0).astype(np.float32)


class RendezvousCommandPolicy:
    """Acts on observations of `OrionRendezvous-v1` within `MapperAction`: commands, and lets others allocate.

    The first observation of an episode resets it.

    Args:
        controller: Made for the environment's spacecraft and number of steps; its own mapper is not used.
    """

    def __init__(self, controller: RendezvousController) -> None:
        self.controller = controller
        self._authority = controller.spacecraft.authority()
        self._read = Reader.of(_ENVIRONMENT, spacecraft=controller.spacecraft)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Action (6,), the commanded rate change in shares of the authority per axis, clipped to -1 to 1."""
        period, reading = self.controller.spacecraft.control_period, self._read(observation)
        measurements = _measurements(self.controller, reading)
        command = self.controller.command(*measurements, on_times=reading.duties * period)
        return np.clip(command / self._authority, -1.0, 1.0).astype(np.float32)


def _measurements(
    controller: RendezvousController, reading: Reading
) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, position, velocity, attitude and rate as the controller wants them; it is reset at a start."""
    spacecraft = controller.spacecraft
    step = round((1.0 - reading.entries("time_to_go")[0]) * controller.steps)
    if step == 0:
        controller.reset()
    # The observed attitude error is minus twice the vector part of the quaternion.
    vector = -0.5 * reading.attitude_error
    attitude = np.concatenate([[np.sqrt(max(0.0, 1.0 - float(vector @ vector)))], vector])
    orbit_rate = rotation_matrix(attitude) @ [0.0, 0.0, spacecraft.mean_motion]
    return (
        step * spacecraft.control_period,
        reading.position,
        reading.velocity,
        attitude,
        reading.rate_error + orbit_rate,
    )
