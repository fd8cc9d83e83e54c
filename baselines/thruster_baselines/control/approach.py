"""The law of an approach along the V-bar, from observations of `MarsRendezvous-v1` to open rates or a wrench.

Modelled: a reference that comes along-track at a constant speed and brakes to the speed of contact with a
limited deceleration; proportional-derivative laws for position and attitude with feed-forward of the
reference and of Hill's acceleration; an allocation by the pseudo-inverse that raises all open rates together
(Fonod et al. 2013 leave law and allocation open; gains and idle rate are those of MSR-A, ours). It is the law
of the environment's own scripted pilot, here on plain NumPy and without its filter of the position, and in
two halves: who knows of a closed valve maps the wrench otherwise.

Left out: faults, the delay of the modulator, a reference that waits; who retreats gives `wrench` another
reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.control.quaternions import product, rotation_matrix
from thruster_envs.observations import Reader
from thruster_envs.pilots import FACING, ApproachSettings
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ApproachController", "ApproachSettings"]

#: Turns LVLH components into those of the approach: x to the target, y against the normal, z to the planet.
AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
#: Turns an attitude against that of the approach (rows, 4) into one from LVLH.
_FROM_LVLH = np.array([product(unit, np.array(FACING)) for unit in np.eye(4)])


class ApproachController:
    """Acts on observations of `MarsRendezvous-v1`, of one environment or of a batch; it remembers nothing.

    Args:
        spacecraft: As the flight software believes it.
        steps: Control periods of an episode: `task.steps` of the unwrapped environment.
        distance: At the start, m, as the environment has it.
        navigation_delay: Age of an observation, periods, as the environment has it.
        settings: How to fly.

    Attributes:
        reader: Of the observations.
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        steps: int,
        *,
        distance: float = 20.0,
        navigation_delay: int = 1,
        settings: ApproachSettings | None = None,
    ) -> None:
        spacecraft.circular_mean_motion("the approach controller")
        self.spacecraft, self.steps, self.distance = spacecraft, steps, distance
        self.navigation_delay = navigation_delay
        self.reader = Reader.of("thruster_envs/MarsRendezvous-v1", spacecraft=spacecraft, distance=distance)
        self.settings = ApproachSettings() if settings is None else settings
        self.inverse: FloatArray = np.asarray(np.linalg.pinv(spacecraft.wrenches()), np.float64)
        self._inertia = np.array(spacecraft.inertia)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Actions (..., n), -1 to 1, for observations (..., m); valves and branch are left alone."""
        return (2.0 * self.open_rates(self.wrench(observation)) - 1.0).astype(np.float32)

    def open_rates(self, wrench: ArrayLike) -> FloatArray:
        """(..., n) open rates, 0 to 1, that give a wrench (..., 6) if all thrusters together give none."""
        rates: FloatArray = np.asarray(wrench, np.float64) @ self.inverse.T
        shift = np.maximum(self.settings.idle, -rates.min(axis=-1, keepdims=True))
        return np.asarray(np.clip(rates + shift, 0.0, 1.0))

    def wrench(
        self, observation: ArrayLike, reference: tuple[FloatArray, FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """(..., 6) force and torque to ask for, N and N m, body axes.

        Args:
            observation: (..., m).
            reference: Along-track position, velocity and acceleration (rows,) to follow, m, m/s, m/s^2; by
                default those of the approach at the time of the observation.
        """
        seen = np.asarray(observation, np.float64)
        rows = seen.reshape(-1, seen.shape[-1])
        wanted = self.acceleration(rows, reference)
        return self.wrench_for(rows, wanted).reshape(*seen.shape[:-1], 6)

    def acceleration(
        self, rows: FloatArray, reference: tuple[FloatArray, FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """(rows, 3) to ask for, m/s^2, LVLH; arguments as of `wrench`, for observations (rows, m)."""
        law, n = self.settings, self.spacecraft.mean_motion
        a = law.translation
        position, velocity = self.position(rows), self.reader(rows).velocity
        if reference is None:
            age = self.navigation_delay
            period = self.spacecraft.control_period
            reference = self.reference(period * np.maximum(self.elapsed(rows) - age, 0.0))
        along, speed, acceleration = reference
        wanted: FloatArray = -a * a * position - 2.0 * law.damping * a * velocity
        wanted[:, 1] += a * a * along + 2.0 * law.damping * a * speed + acceleration
        wanted[:, 0] -= 2.0 * n * velocity[:, 1] + 3.0 * n * n * position[:, 0]
        wanted[:, 1] += 2.0 * n * velocity[:, 0]
        wanted[:, 2] += n * n * position[:, 2]
        return wanted

    def wrench_for(self, rows: FloatArray, acceleration: FloatArray) -> FloatArray:
        """(rows, 6), N and N m, body axes: for an acceleration (rows, 3), LVLH, and the attitude law."""
        law, z = self.settings, self.settings.rotation
        reading = self.reader(rows)
        angle, spin = reading.attitude_error, reading.rate_error
        result = np.empty((rows.shape[0], 6))
        for row in range(rows.shape[0]):
            # The observed attitude error is minus twice the vector part of the quaternion.
            vector = -0.5 * angle[row]
            turned = np.concatenate([[np.sqrt(max(0.0, 1.0 - float(vector @ vector)))], vector])
            result[row, :3] = self.spacecraft.mass * (rotation_matrix(turned) @ (AXES @ acceleration[row]))
        result[:, 3:] = -(z * z * angle + 2.0 * law.damping * z * spin) @ self._inertia
        return result

    def position(self, rows: FloatArray) -> FloatArray:
        """(rows, 3) measured relative position, m, LVLH, of observations (rows, m)."""
        reading = self.reader(rows)
        return np.where(reading.within("near_position"), reading.near_position, reading.position)

    def attitude(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured attitude (rows, 4), body from LVLH, and inertial body rate (rows, 3), rad/s, body axes.

        Of observations (rows, m) whose attitude and rate are not at the end of their range.
        """
        reading = self.reader(rows)
        vector = -0.5 * reading.attitude_error
        scalar = np.sqrt(np.maximum(0.0, 1.0 - (vector**2).sum(axis=1, keepdims=True)))
        # Added term by term: a product of matrices would round a row by how many rows there are.
        q: FloatArray = (np.hstack([scalar, vector])[:, :, np.newaxis] * _FROM_LVLH).sum(axis=1)
        w, x, y, z = q.T
        normal = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
        return q, reading.rate_error + self.spacecraft.mean_motion * normal

    def open_rates_told(self, rows: FloatArray) -> FloatArray:
        """(rows, n) commanded for the last period, 0 to 1, of observations (rows, m)."""
        return np.asarray(np.clip(self.reader(rows).duties, 0.0, 1.0))

    def elapsed(self, rows: FloatArray) -> FloatArray:
        """(rows,) control periods since the start of the episode, of observations (rows, m)."""
        left = self.reader(rows).entries("time_to_go")[:, 0]
        return np.asarray(np.round((1.0 - left) * self.steps), np.float64)

    def reference(self, time: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Along-track position, velocity and acceleration of the reference at times (...), m, m/s, m/s^2."""
        law, t = self.settings, np.asarray(time, np.float64)
        duration = (law.speed - law.contact_speed) / law.braking
        length = 0.5 * (law.speed + law.contact_speed) * duration
        since = t - (self.distance - length) / law.speed
        braked = np.clip(since, 0.0, duration)
        speed = law.speed - law.braking * braked
        coasted = np.where(
            since > duration, law.contact_speed * (since - duration), np.minimum(since, 0.0) * law.speed
        )
        position = -length + coasted + law.speed * braked - 0.5 * law.braking * braked**2
        return position, speed, np.where((since >= 0.0) & (since < duration), -law.braking, 0.0)
