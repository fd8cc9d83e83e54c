"""One control period of a batch of formations in plain NumPy: what the compiled task is compared with.

Models what ``formation_attitude_v1`` models for healthy craft without scatter: the leader and the followers
that nobody commands fly by the law, pulses turn the craft, gravity gradient and a constant torque act, and
sensors look; then the terms of the reward, and observations. Written as one writes NumPy: arrays over worlds
and craft.

Leaves out what the compiled task does besides: faults, mass, episodes and their resets, the measured and the
expected rate change, infos, streams of randomness per world.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.numpy_flight import cross, exponential, product, rotate, turn
from thruster_envs.pilots.attitude import AttitudePilot
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.tasks import FormationAttitude

Array = NDArray[np.float64]


class NumpyFormation:
    """A batch of healthy formations.

    Args:
        task: Its configuration, with the followers from the first on commanded, by pulses.
        targets: (worlds, craft, 4), attitude that each craft should have from the leader; the leader's own
            from the frame it starts in.

    Attributes:
        attitude: (worlds, craft, 4), body-from-reference, scalar first.
        rate: (worlds, craft, 3), rad/s.
        measured_attitude: As the sensors saw it last.
        measured_rate: The same.
        terms: (worlds, commanded, 4), reward of the last period: pointing, balance, pulses, lost.
    """

    def __init__(self, task: FormationAttitude, targets: Array) -> None:
        self.task, self.targets = task, targets
        self.vehicle: Spacecraft = task.vehicle
        self.gains = AttitudePilot.of(self.vehicle).gains
        self.inertia = np.array(self.vehicle.inertia)
        self.inverse = np.linalg.inv(self.inertia)
        discharge = self.vehicle.discharge
        assert discharge is not None
        self.firing_time = discharge.firing_time
        self.kicks = self.firing_time * self.vehicle.wrenches()[3:].T @ self.inverse
        self.worlds, self.craft = targets.shape[:2]
        shape = (self.worlds, self.craft)
        self.attitude, self.rate = np.tile([1.0, 0.0, 0.0, 0.0], (*shape, 1)), np.zeros((*shape, 3))
        self.measured_attitude, self.measured_rate = self.attitude.copy(), self.rate.copy()
        self.asked = np.zeros((*shape, self.vehicle.number_of_thrusters))
        self.fired, self.steps = np.zeros(shape), 0
        self.terms = np.zeros((self.worlds, len(task.agents), 4))

    def step(self, options: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.float32]:
        """Fly one period with sensor noise drawn from ``rng``; as :meth:`fly`."""
        return self.fly(options, rng.standard_normal((self.worlds, self.craft, 6)))

    def fly(self, options: NDArray[np.int64], noise: Array) -> NDArray[np.float32]:
        """Fly one period.

        Args:
            options: (worlds, commanded, 3): 0 for no pulse about the axis, 1 forwards, 2 backwards.
            noise: (worlds, craft, 6), in standard deviations: attitude, rate.

        Returns:
            (worlds, commanded, 21), what the commanded craft observe.
        """
        error, rate = self._errors(self.measured_attitude, self.measured_rate)
        torque = 2.0 * self.gains.angle * error[..., 1:] - self.gains.rate * rate
        pulses = np.where(np.abs(torque) < self.gains.dead_band, 0.0, np.sign(torque))
        commanded = slice(1, 1 + options.shape[1])
        pulses[:, commanded] = np.where(options == 2, -1, options)
        self.asked[..., self.gains.thrusters[:, 0]] = pulses > 0.0
        self.asked[..., self.gains.thrusters[:, 1]] = pulses < 0.0
        self.rate = self.rate + self.asked @ self.kicks
        self._move()
        sensors, both = self.vehicle.sensors, (-1, 4)
        tilt = exponential(0.5 * sensors.attitude * noise[..., :3].reshape(-1, 3))
        self.measured_attitude = product(tilt, self.attitude.reshape(both)).reshape(self.attitude.shape)
        self.measured_rate = self.rate + sensors.rate * noise[..., 3:]
        self._judge(commanded)
        return self._observe(commanded)

    def _move(self) -> None:
        """One step of a period: RK4 for the rate, fourth-order Magnus for the attitude."""
        h, mean_motion = self.vehicle.control_period, self.vehicle.mean_motion
        q, rate = self.attitude.reshape(-1, 4), self.rate.reshape(-1, 3)
        angles = mean_motion * h * (self.steps + np.array([0.0, 0.5, 1.0]))
        verticals = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
        torque_0 = self._torque(q, verticals[0])
        k1 = self._acceleration(rate, torque_0)
        half, whole = (
            product(exponential(-0.5 * part * (rate + 0.5 * part * k1)), q) for part in (0.5 * h, h)
        )
        torque_m, torque_1 = self._torque(half, verticals[1]), self._torque(whole, verticals[2])
        k2 = self._acceleration(rate + 0.5 * h * k1, torque_m)
        k3 = self._acceleration(rate + 0.5 * h * k2, torque_m)
        k4 = self._acceleration(rate + h * k3, torque_1)
        end = rate + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        middle = 0.5 * (rate + end) + 0.125 * h * (k1 - self._acceleration(end, torque_1))
        q = turn(q, rate, middle, end, np.array(h))
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        self.attitude, self.rate = q.reshape(self.attitude.shape), end.reshape(self.rate.shape)
        self.steps += 1

    def _torque(self, q: Array, vertical: Array) -> Array:
        if not self.task.gravity_gradient:
            return np.tile(self.task.bias_torque, (len(q), 1))
        seen = rotate(q, np.broadcast_to(vertical, (len(q), 3)))
        gradient = 3.0 * self.vehicle.mean_motion**2 * cross(seen, seen @ self.inertia)
        return np.asarray(self.task.bias_torque + gradient)

    def _acceleration(self, rate: Array, torque: Array) -> Array:
        return (torque - cross(rate, rate @ self.inertia)) @ self.inverse

    def _errors(self, attitude: Array, rate: Array) -> tuple[Array, Array]:
        """Attitudes from the targets, scalar not negative; rates from the leader's, whose own stay."""
        q, w = attitude.copy(), rate.copy()
        for c in range(1, self.craft):
            q[:, c] = product(attitude[:, c], _conjugate(self.attitude[:, 0]))
            w[:, c] -= rotate(q[:, c], self.rate[:, 0])
        error = product(q.reshape(-1, 4), _conjugate(self.targets.reshape(-1, 4))).reshape(q.shape)
        return np.where(error[..., :1] < 0.0, -error, error), w

    def _judge(self, commanded: slice) -> None:
        pulses = self.asked.sum(axis=-1)
        self.fired += pulses
        mean = self.fired.mean(axis=1, keepdims=True)
        error, _ = self._errors(self.attitude, self.rate)
        angle = 2.0 * np.arctan2(np.linalg.norm(error[..., 1:], axis=-1), error[..., 0])
        excess = np.clip(self.fired / np.where(mean > 0.0, mean, np.inf) - 1.0, 0.0, 1.0)
        task, worth = self.task, 7.0 / 3000
        pointing = worth * (1.0 - 0.5 * (angle / np.pi + angle / (angle + 0.05)))
        balance = worth * task.balance_price * (1.0 - excess)
        saved = worth * task.pulse_price * (1.0 - np.minimum(pulses / 3.0, 1.0))
        over = (np.linalg.norm(self.rate, axis=-1) > task.rate_limit).any(axis=1, keepdims=True)
        lost = np.broadcast_to(np.where(over, -task.most_worth, 0.0), angle.shape)
        self.terms = np.stack([pointing, balance, saved, lost], axis=-1)[:, commanded]

    def _observe(self, commanded: slice) -> NDArray[np.float32]:
        error, rate = self._errors(self.measured_attitude, self.measured_rate)
        mean = self.fired.mean(axis=1, keepdims=True)
        surplus = np.where(mean > 0.0, self.fired / np.where(mean > 0.0, mean, 1.0) - 1.0, 0.0)
        seen = (
            error.clip(-1.0, 1.0),
            (-2.0 * error[..., 1:] / 0.05).clip(-1.0, 1.0),
            (rate / 1e-3).clip(-5.0, 5.0),
            self.targets,
            self.asked,
            surplus[..., np.newaxis].clip(-5.0, 5.0),
        )
        return np.concatenate(seen, axis=-1)[:, commanded].astype(np.float32)


def _conjugate(q: Array) -> Array:
    return q * np.array([1.0, -1.0, -1.0, -1.0])
