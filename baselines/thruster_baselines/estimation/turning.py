"""What the turning of a body within an interval does to the rate change that is measured of its thrust.

A measured rate change is in the body's axes at the start of the interval. Thrust turns with the body, so that
to first order thruster i pushes along a_i + phi_i x a_i, with phi_i the mean angle turned while it is open;
that is taken off (`thrust_turn`). What is left has no model and gets a covariance: the second order, the
error of the attitude measured at the start, the orbit's own turning, and gyroscopic torque at other rates
than the mean of both ends. Rates are taken to change in proportion to time while any thruster is open.

Left out: turning by disturbances.
"""

from __future__ import annotations

import numpy as np

from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ThrustTurning"]

_SHARE = 0.2  # of the turn by the thrust itself, by which its course in time is not known
_SIGMAS = 2.0  # a bias counts as so many times its size, since it does not average out


class ThrustTurning:
    """Takes the turning of thrust off measured rate changes, and says how well that is known.

    Args:
        spacecraft: Its effectiveness, attitude sensor, inertia, orbit and opening delays.
    """

    def __init__(self, spacecraft: Spacecraft) -> None:
        self._push: FloatArray = spacecraft.effectiveness()[:3]
        self._attitude = spacecraft.sensors.attitude
        self._orbit = spacecraft.reference_orbit.fastest_rate
        self._delay = np.array([one.opening_delay for one in spacecraft.thrusters])
        a, b, c = np.linalg.eigvalsh(np.array(spacecraft.inertia))
        self._gyroscopy = float(max((c - b) / a, (c - a) / b, (b - a) / c))

    def __call__(
        self, open_times: FloatArray, on_times: FloatArray, turning: FloatArray, duration: float
    ) -> tuple[FloatArray, FloatArray]:
        """The rate change (vehicles, 3) to take off, m/s, and the covariance (vehicles, 6, 6) of the rest.

        Args:
            open_times: (vehicles, n), s, for which valves are open.
            on_times: (vehicles, n), s, effective.
            turning: (vehicles, 2, 3), rad/s, body axes: rate against LVLH at the start and at the end.
            duration: s.
        """
        before, change = turning[:, 0], turning[:, 1] - turning[:, 0]
        longest = np.maximum((open_times + self._delay).max(axis=1), 1e-9)[:, np.newaxis]
        middle = (0.5 * open_times + self._delay)[..., np.newaxis]
        square = (open_times**2 / 6.0)[..., np.newaxis]
        angle = before[:, np.newaxis] * middle + change[:, np.newaxis] * square / longest[..., np.newaxis]
        pushes = on_times[..., np.newaxis] * self._push.T  # (vehicles, n, 3)
        off: FloatArray = np.cross(angle, pushes).sum(axis=1)
        speed, jump = np.linalg.norm(before, axis=1), np.linalg.norm(change, axis=1)
        by_thrust = 0.5 * jump * longest[:, 0]
        unknown = (
            self._attitude**2
            + np.square(_SIGMAS * self._orbit * duration)
            + np.square(_SIGMAS * 0.5 * (speed * longest[:, 0] + by_thrust) ** 2)
        )
        covariance = np.zeros((len(open_times), 6, 6))
        net = pushes.sum(axis=1)
        all_ways = np.linalg.norm(pushes, axis=2).sum(axis=1)
        covariance[:, :3, :3] = unknown[:, np.newaxis, np.newaxis] * (
            np.square(net).sum(axis=1)[:, np.newaxis, np.newaxis] * np.eye(3)
            - net[:, :, np.newaxis] * net[:, np.newaxis, :]
        ) + np.square(_SIGMAS * _SHARE * by_thrust * all_ways)[:, np.newaxis, np.newaxis] * np.eye(3)
        spin = speed + np.linalg.norm(turning[:, 1], axis=1) + 2.0 * self._orbit
        gyroscopic = 0.5 * self._gyroscopy * duration * jump * spin
        axes = np.arange(3, 6)
        covariance[:, axes, axes] = np.square(gyroscopic)[:, np.newaxis]
        return off, covariance
