"""What the craft knows of its own motion: a Kalman filter over position, velocity, attitude and rate.

Each period brings a noisy measurement of all four. Between measurements the filter predicts:
Hill-Clohessy-Wiltshire motion, constant rate, and what the commanded on-times should have given, feed
coupling included. The uncertainty of that comes from the firing-to-firing scatter, thruster by thruster, so
that a rate that came out wrong also corrects the velocity. Attitude is kept as a quaternion, and its error
as a small rotation vector (multiplicative filter).

Left out: gyroscopic coupling (rates are small), faults. A thruster that does not do what was commanded
surprises the filter; when a measurement is farther off than one in a million should be, the filter starts
anew from it.
"""

from __future__ import annotations

import numpy as np

from thruster_baselines.control.quaternions import attitude_error, product, rotation_matrix, turned
from thruster_baselines.guidance.hcw import transition_matrix
from thruster_baselines.mapping.coupling import delivered_on_times
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["RelativeNavigation"]

_SURPRISE = 53.0  # chi-squared with 12 degrees of freedom exceeds this once in a million
_FLOOR = (1e-4, 1e-6, 1e-5, 1e-6)  # what the model leaves out in one period, one sigma: m, m/s, rad, rad/s


class RelativeNavigation:
    """Estimates the relative state of a craft from measurements and commands, one period after the other.

    Args:
        spacecraft: Its sensors, scatter, coupling, control period and mean motion.
        effectiveness: (6, n), believed instead of the spacecraft's own, m/s^2 then rad/s^2.

    Attributes:
        position: (3,), m, LVLH.
        velocity: (3,), m/s, LVLH.
        attitude: (4,), body-from-LVLH.
        rate: (3,), rad/s, inertial, body axes.
        covariance: (12, 12), of the errors of position, velocity, attitude (rotation vector, rad) and rate.
        surprises: How often a measurement did not fit and the filter started anew.
    """

    def __init__(self, spacecraft: Spacecraft, effectiveness: FloatArray | None = None) -> None:
        self.effectiveness = spacecraft.effectiveness() if effectiveness is None else effectiveness
        self._period = spacecraft.control_period
        self._coupling = spacecraft.feed.coupling
        mean_motion = spacecraft.circular_mean_motion("the navigation filter")
        self._orbit_rate = np.array([0.0, 0.0, mean_motion])
        self._scatter = np.array([thruster.scatter for thruster in spacecraft.thrusters]) / np.sqrt(3.0)
        sensors = spacecraft.sensors
        sigmas = np.repeat([sensors.position, sensors.velocity, sensors.attitude, sensors.rate], 3)
        floor = np.repeat(_FLOOR, 3)
        self._measurement_covariance = np.diag(np.maximum(sigmas, floor) ** 2)
        self._model_covariance = np.diag(floor**2)
        self._transition = np.eye(12)
        self._transition[:6, :6] = transition_matrix(mean_motion, self._period)
        self._transition[6:9, 9:] = self._period * np.eye(3)
        self.forget()

    def forget(self) -> None:
        """Know nothing: the next measurement is the estimate."""
        self.position: FloatArray = np.zeros(3)
        self.velocity: FloatArray = np.zeros(3)
        self.attitude: FloatArray = np.array([1.0, 0.0, 0.0, 0.0])
        self.rate: FloatArray = np.zeros(3)
        self.covariance: FloatArray = np.zeros((12, 12))
        self.surprises = 0
        self._started = False

    @property
    def relative_rate(self) -> FloatArray:
        """(3,), rad/s: body rate against LVLH, body axes."""
        relative: FloatArray = self.rate - rotation_matrix(self.attitude) @ self._orbit_rate
        return relative

    @property
    def attitude_error(self) -> FloatArray:
        """(3,), rad: rotation vector by which the body has turned away from LVLH, body axes."""
        return attitude_error(self.attitude)

    def update(
        self,
        on_times: FloatArray,
        position: FloatArray,
        velocity: FloatArray,
        attitude: FloatArray,
        rate: FloatArray,
    ) -> None:
        """Take in the measurement at the end of a period in which `on_times` (n,), s, were commanded.

        Args:
            on_times: Ignored before the first measurement.
            position: (3,), m, LVLH.
            velocity: (3,), m/s, LVLH.
            attitude: (4,), body-from-LVLH.
            rate: (3,), rad/s, inertial, body axes.
        """
        if self._started:
            self.predict(on_times)
            # small rotation from the predicted to the measured attitude, body axes
            error = product(attitude, self.attitude * [1.0, -1.0, -1.0, -1.0])
            innovation = np.concatenate(
                [position - self.position, velocity - self.velocity, attitude_error(error), rate - self.rate]
            )
            total = self.covariance + self._measurement_covariance
            gain = np.linalg.solve(total, self.covariance).T
            if innovation @ np.linalg.solve(total, innovation) <= _SURPRISE:
                correction = gain @ innovation
                self.position = self.position + correction[:3]
                self.velocity = self.velocity + correction[3:6]
                self.attitude = turned(self.attitude, correction[6:9])
                self.rate = self.rate + correction[9:]
                rest = np.eye(12) - gain  # Joseph's form, which is positive for any gain
                self.covariance = _symmetric(
                    rest @ self.covariance @ rest.T + gain @ self._measurement_covariance @ gain.T
                )
                return
            self.surprises += 1
        self.position, self.velocity = position.copy(), velocity.copy()
        self.attitude, self.rate = attitude / np.linalg.norm(attitude), rate.copy()
        self.covariance = self._measurement_covariance.copy()
        self._started = True

    def predict(self, on_times: FloatArray) -> None:
        """Move the estimate on by one period in which `on_times` (n,), s, were commanded, unmeasured."""
        if not self._started:
            return
        firing = delivered_on_times(on_times, self._coupling)
        rotation = self.effectiveness[3:]
        longest = float(firing.max())
        # The body turns while it fires; its mean attitude comes after half of that time.
        turn = self.relative_rate * (longest / 2.0) + rotation @ firing * (longest / 6.0)
        from_body = rotation_matrix(turned(self.attitude, turn)).T
        push = self.effectiveness[:3] @ firing  # m/s, body axes
        translation = from_body @ self.effectiveness[:3]
        coasting = self._period - 0.5 * on_times  # pulses come first: their rate acts for so long
        effect = np.concatenate([translation * coasting, translation, rotation * coasting, rotation])
        change = effect @ firing

        transition = self._transition.copy()
        transition[3:6, 6:9] = _misdirected(from_body, push, np.eye(3))
        transition[:3, 6:9] = transition[3:6, 6:9] * (self._period - 0.5 * longest)
        spread = effect * (firing * self._scatter)
        astray = _misdirected(from_body, push, spread[9:] * (longest / 6.0))
        spread[3:6] += astray
        spread[:3] += astray * (self._period - 0.5 * longest)

        moved = transition[:6, :6] @ np.concatenate([self.position, self.velocity]) + change[:6]
        self.attitude = turned(self.attitude, self.relative_rate * self._period + change[6:9])
        self.position, self.velocity, self.rate = moved[:3], moved[3:], self.rate + change[9:]
        self.covariance = _symmetric(
            transition @ self.covariance @ transition.T + spread @ spread.T + self._model_covariance
        )


def _symmetric(covariance: FloatArray) -> FloatArray:
    """Without what round-off has made of a symmetric matrix."""
    symmetric: FloatArray = 0.5 * (covariance + covariance.T)
    return symmetric


def _misdirected(from_body: FloatArray, push: FloatArray, angles: FloatArray) -> FloatArray:
    """Velocity (3, k) in LVLH that a push (3,) in body axes adds if the body is turned by `angles` (3, k)."""
    x, y, z = push
    astray: FloatArray = from_body @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]) @ angles
    return astray
