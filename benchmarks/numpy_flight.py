"""One control period of a batch of Orions in plain NumPy: what the compiled kernels are compared with.

Models what the kernels model for a whole vehicle: pulses that end at different times, the period cut at
each end, feed coupling, firing scatter, Hill's equations and a rigid body by RK4, a fourth-order Magnus
step for the attitude, sensors with noise, the measured and the expected rate change. Written as one writes
NumPy: arrays over the batch, a loop over the pieces of the period and their sub-steps.

Leaves out what the kernels do besides: faults, delays and ramps of valves, minimum pulses, runs, mass
depletion, streams of randomness per world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thruster_envs.physics.orbits import transition_matrix
from thruster_envs.spacecraft import Spacecraft

Array = NDArray[np.float64]


@dataclass
class Motion:
    """State of a batch.

    Attributes:
        position: (worlds, 3) m, LVLH.
        velocity: (worlds, 3) m/s.
        attitude: (worlds, 4), body-from-LVLH, scalar first.
        rate: (worlds, 3) rad/s, inertial, body axes.
    """

    position: Array
    velocity: Array
    attitude: Array
    rate: Array

    @classmethod
    def at_rest(cls, worlds: int) -> Motion:
        """At the origin, aligned with LVLH."""
        attitude = np.tile([1.0, 0.0, 0.0, 0.0], (worlds, 1))
        return cls(np.zeros((worlds, 3)), np.zeros((worlds, 3)), attitude, np.zeros((worlds, 3)))


class NumpyFlight:
    """A batch of healthy craft.

    Args:
        spacecraft: Without valve dynamics, minimum pulse or consumption of propellant, as Orion.
        worlds: How many.
        max_substep: Longest integration sub-step, s.

    Attributes:
        motion: True state.
        measured: As the sensors saw it last.
        impulse: (worlds, 6) of the last period, N s and N m s.
        delivered: (worlds, n) on-times of the last period, s.
        measured_change: (worlds, 6) rate change of the last period, m/s and rad/s.
        expected_change: (worlds, 6), the same as the nominal vehicle would give.
    """

    def __init__(self, spacecraft: Spacecraft, worlds: int, max_substep: float = 1.0) -> None:
        self.spacecraft, self.worlds, self.max_substep = spacecraft, worlds, max_substep
        self.inertia = np.array(spacecraft.inertia)
        self.inverse = np.linalg.inv(self.inertia)
        self.wrenches, self.effectiveness = spacecraft.wrenches(), spacecraft.effectiveness()
        self.scatter = np.array([thruster.scatter for thruster in spacecraft.thrusters])
        self.drift = transition_matrix(spacecraft.mean_motion, spacecraft.control_period)[3:]
        self.motion, self.measured = Motion.at_rest(worlds), Motion.at_rest(worlds)
        self.impulse = np.zeros((worlds, 6))
        self.delivered = np.zeros((worlds, spacecraft.number_of_thrusters))
        self.measured_change, self.expected_change = np.zeros((worlds, 6)), np.zeros((worlds, 6))

    def step(self, duties: Array, rng: np.random.Generator) -> None:
        """Fly one period with scatter and noise drawn from ``rng``; duties (worlds, n) in 0..1."""
        self.fly(duties, rng.uniform(-1.0, 1.0, duties.shape), rng.standard_normal((self.worlds, 12)))

    def fly(self, duties: Array, scatter: Array, noise: Array) -> None:
        """Fly one period.

        Args:
            duties: (worlds, n) in 0..1.
            scatter: (worlds, n) in -1..1, shares of the half-width.
            noise: (worlds, 12), in standard deviations: position, velocity, attitude, rate.
        """
        period, coupling = self.spacecraft.control_period, self.spacecraft.feed.coupling
        durations = duties * period
        strength = 1.0 + self.scatter * scatter
        ends = np.sort(durations, axis=1)
        ends = np.concatenate([ends, np.full((self.worlds, 1), period)], axis=1)
        self.impulse, self.delivered = np.zeros_like(self.impulse), np.zeros_like(self.delivered)
        before = np.zeros(self.worlds)
        for k in range(ends.shape[1]):
            length = ends[:, k] - before
            is_open = (before + 0.5 * length)[:, np.newaxis] < durations
            others = is_open.sum(axis=1, keepdims=True) - is_open
            thrust = strength * is_open * np.maximum(0.0, 1.0 - coupling * others)
            wrench = thrust @ self.wrenches.T
            self.impulse += length[:, np.newaxis] * wrench
            self.delivered += length[:, np.newaxis] * thrust
            self._move(wrench, length)
            before = ends[:, k]
        self.motion.attitude /= np.linalg.norm(self.motion.attitude, axis=1, keepdims=True)
        self._look(durations, noise)

    def _move(self, wrench: Array, length: Array) -> None:
        """Integrate a piece of constant body wrench, in equal sub-steps of each world."""
        parts = np.ceil(length / self.max_substep)
        for part in range(int(parts.max())):
            self._substep(wrench, np.where(part < parts, length / np.maximum(parts, 1.0), 0.0)[:, np.newaxis])

    def _substep(self, wrench: Array, h: Array) -> None:
        motion, mean_motion = self.motion, self.spacecraft.mean_motion
        force, torque = wrench[:, :3] / self.spacecraft.mass, wrench[:, 3:]
        rate = motion.rate
        k1 = self._angular_acceleration(rate, torque)
        k2 = self._angular_acceleration(rate + 0.5 * h * k1, torque)
        k3 = self._angular_acceleration(rate + 0.5 * h * k2, torque)
        k4 = self._angular_acceleration(rate + h * k3, torque)
        end = rate + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        slope = self._angular_acceleration(end, torque)
        quarter = 0.84375 * rate + 0.15625 * end + h * (0.140625 * k1 - 0.046875 * slope)
        middle = 0.5 * (rate + end) + h * (0.125 * k1 - 0.125 * slope)
        attitude = motion.attitude
        half_way = _follow_orbit(turn(attitude, rate, quarter, middle, 0.5 * h), mean_motion, 0.5 * h)
        motion.attitude = _follow_orbit(turn(attitude, rate, middle, end, h), mean_motion, h)
        motion.rate = end
        f0, fm, f1 = (_rotate_back(q, force) for q in (attitude, half_way, motion.attitude))
        r, v = motion.position, motion.velocity
        a1 = _hill(r, v, mean_motion) + f0
        v2 = v + 0.5 * h * a1
        a2 = _hill(r + 0.5 * h * v, v2, mean_motion) + fm
        v3 = v + 0.5 * h * a2
        a3 = _hill(r + 0.5 * h * v2, v3, mean_motion) + fm
        v4 = v + h * a3
        a4 = _hill(r + h * v3, v4, mean_motion) + f1
        motion.position = r + h / 6 * (v + 2 * (v2 + v3) + v4)
        motion.velocity = v + h / 6 * (a1 + 2 * (a2 + a3) + a4)

    def _angular_acceleration(self, rate: Array, torque: Array) -> Array:
        return (torque - cross(rate, rate @ self.inertia)) @ self.inverse

    def _look(self, durations: Array, noise: Array) -> None:
        """Measure, and form the measured and the expected rate change."""
        sensors, truth, old = self.spacecraft.sensors, self.motion, self.measured
        tilt = exponential(0.5 * sensors.attitude * noise[:, 6:9])
        new = Motion(
            truth.position + sensors.position * noise[:, 0:3],
            truth.velocity + sensors.velocity * noise[:, 3:6],
            product(tilt, truth.attitude),
            truth.rate + sensors.rate * noise[:, 9:12],
        )
        free = np.concatenate([old.position, old.velocity], axis=1) @ self.drift.T
        mean = 0.5 * (old.rate + new.rate)
        turn = self.spacecraft.control_period * self._angular_acceleration(mean, np.zeros(3))
        self.measured_change = np.concatenate(
            [rotate(old.attitude, new.velocity - free), new.rate - old.rate - turn], axis=1
        )
        together = (
            np.minimum(durations[:, :, np.newaxis], durations[:, np.newaxis, :]).sum(axis=2) - durations
        )
        effective = np.maximum(0.0, durations - self.spacecraft.feed.coupling * together)
        self.expected_change = effective @ self.effectiveness.T
        self.measured = new


def _hill(r: Array, v: Array, n: float) -> Array:
    return np.stack([2 * n * v[:, 1] + 3 * n * n * r[:, 0], -2 * n * v[:, 0], -n * n * r[:, 2]], axis=1)


def cross(a: Array, b: Array) -> Array:
    """As ``np.cross``, several times faster for short arrays."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def product(a: Array, b: Array) -> Array:
    """Hamilton products of scalar-first quaternions, (worlds, 4)."""
    scalar = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + cross(a[:, 1:], b[:, 1:])
    return np.concatenate([scalar, vector], axis=1)


def rotate(q: Array, v: Array) -> Array:
    """Components in the body of reference vectors, (worlds, 3)."""
    t = cross(q[:, 1:], v)
    return v + 2.0 * cross(q[:, 1:], t + q[:, :1] * v)


def _rotate_back(q: Array, v: Array) -> Array:
    return rotate(q * np.array([1.0, -1.0, -1.0, -1.0]), v)


def exponential(vector: Array) -> Array:
    """Rotations by twice the length of vectors, (worlds, 4)."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.concatenate([np.cos(length), np.sinc(length / np.pi) * vector], axis=1)


def turn(q: Array, rate_0: Array, rate_m: Array, rate_1: Array, h: Array) -> Array:
    """Fourth-order Magnus step of the attitude in inertial space."""
    twist = cross(rate_0, rate_1)
    step = exponential(-h / 12 * (rate_0 + 4.0 * rate_m + rate_1) - h * h / 24 * twist)
    return product(step, q)


def _follow_orbit(q: Array, mean_motion: float, h: Array) -> Array:
    """LVLH turns away under the craft about its own z."""
    half = 0.5 * mean_motion * h
    c, s = np.cos(half), np.sin(half)
    w, x, y, z = (q[:, k : k + 1] for k in range(4))
    return np.concatenate([c * w - s * z, c * x + s * y, c * y - s * x, c * z + s * w], axis=1)
