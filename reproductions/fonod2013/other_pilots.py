"""Pilots of the Mars chaser that fly by the environment's law with something changed, from observations.

What a test of commands makes of a fault depends on who gives the commands. `law` is the law with other
numbers; `fixed_bias` and `minimum_fuel` map its wrench to open rates in other ways; `stopping` brings the
approach to a standstill. They take the position as it is measured, without the filter of the environment's
own pilot. None knows of a fault.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.control import ApproachController, ApproachSettings
from thruster_baselines.control.quaternions import rotation_matrix
from thruster_baselines.detection.approach_flights import Pilot
from thruster_baselines.detection.environment_flights import Policy
from thruster_baselines.mapping import LPMapper
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft


def law(settings: ApproachSettings | None = None) -> Pilot:
    """Who lifts all open rates together until none is negative, and by the idle rate at least."""
    return lambda spacecraft, steps: ApproachController(spacecraft, steps, settings=settings)


def fixed_bias(bias: float, settings: ApproachSettings | None = None) -> Pilot:
    """Who lifts all open rates by the same amount whatever they are, and clips what is not possible."""

    def pilot(spacecraft: Spacecraft, steps: int) -> Policy:
        controller = ApproachController(spacecraft, steps, settings=settings)

        def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
            return _actions(controller.wrench(observations) @ controller.inverse.T + bias)

        return act

    return pilot


def minimum_fuel(settings: ApproachSettings | None = None) -> Pilot:
    """Who opens thrusters for the least time in all, so that some are not opened at all.

    All combinations of thrusters that give nothing together are free for that: all eight, and four of them
    against the other four.
    """

    def pilot(spacecraft: Spacecraft, steps: int) -> Policy:
        controller = ApproachController(spacecraft, steps, settings=settings)
        mapper, period = LPMapper(spacecraft), spacecraft.control_period
        per_wrench = np.zeros((6, 6))  # what a wrench over a period changes, m/s and rad/s
        per_wrench[:3, :3] = np.eye(3) * period / spacecraft.mass
        per_wrench[3:, 3:] = np.linalg.inv(np.array(spacecraft.inertia)) * period

        def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
            return _actions(mapper(controller.wrench(observations) @ per_wrench.T).on_times / period)

        return act

    return pilot


def stopping(
    time: float, braking: float, settings: ApproachSettings | None = None, *, own_filter: bool = False
) -> Pilot:
    """Who comes to a standstill before the target.

    Args:
        time: When the reference begins to brake, s.
        braking: Its deceleration, m/s^2; infinite for one that stops at once.
        settings: How to fly until then.
        own_filter: Whether position and velocity are those of an alpha-beta filter that takes the thrust to
            come as soon as it is asked for, and all of it. The environment's knows of the nominal delay.
    """

    def pilot(spacecraft: Spacecraft, steps: int) -> Policy:
        controller = ApproachController(spacecraft, steps, settings=settings)
        speed, period = controller.settings.speed, spacecraft.control_period
        lasts = 0.0 if math.isinf(braking) else speed / braking
        held = _Filter(controller) if own_filter else None

        def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
            rows = np.asarray(observations, np.float64)
            age = controller.navigation_delay
            now = period * np.maximum(controller.elapsed(rows) - age, 0.0)
            reference = _reference(now, time, lasts, speed, controller.distance)
            if held is not None:
                rows = held.filtered(rows)
            wrench = controller.wrench(rows, reference)
            if held is not None:
                held.expect(rows, wrench)
            return _actions(controller.open_rates(wrench))

        return act

    return pilot


class _Filter:
    """Of position and velocity, for observations that come one after the other."""

    alpha, beta = 0.3, 0.05

    def __init__(self, controller: ApproachController) -> None:
        self._controller, self._period = controller, controller.spacecraft.control_period
        self._position: FloatArray | None = None
        self._velocity: FloatArray = np.zeros((1, 3))
        self._change: FloatArray = np.zeros((1, 3))

    def filtered(self, rows: FloatArray) -> FloatArray:
        """Observations (rows, m) with the filter's position and velocity."""
        seen, period, reader = self._controller.position(rows), self._period, self._controller.reader
        if self._position is None:
            self._position, self._velocity = seen, self._controller.reader(rows).velocity
        else:
            ahead = self._position + period * (self._velocity + 0.5 * self._change)
            missed = seen - ahead
            self._position = ahead + self.alpha * missed
            self._velocity = self._velocity + self._change + self.beta / period * missed
        filtered = rows.copy()
        filtered[:, reader.columns("position")] = self._position / reader.scale("position")
        near, bound = self._position / reader.scale("near_position"), reader.field("near_position").bound
        filtered[:, reader.columns("near_position")] = np.clip(near, -bound, bound)
        filtered[:, reader.columns("velocity")] = self._velocity * (1.0 / reader.scale("velocity"))
        return filtered

    def expect(self, rows: FloatArray, wrench: FloatArray) -> None:
        """Take the velocity to change at once as this wrench (rows, 6) in body axes would change it."""
        attitude, _ = self._controller.attitude(rows)
        body = wrench[:, :3] * self._period / self._controller.spacecraft.mass
        turned = [rotation_matrix(q).T @ one for q, one in zip(attitude, body, strict=True)]
        self._change = np.array(turned)


def _reference(
    now: FloatArray, time: float, lasts: float, speed: float, distance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Along-track position, velocity and acceleration at times (...), m, m/s, m/s^2."""
    braked = np.clip(now - time, 0.0, lasts)
    change = speed / lasts if lasts > 0.0 else 0.0
    along = -distance + speed * np.minimum(now, time + lasts) - 0.5 * change * braked**2
    standing = now >= time + lasts
    velocity = np.where(standing, 0.0, speed - change * braked)
    return along, velocity, np.where((now >= time) & ~standing, -change, 0.0)


def _actions(open_rates: FloatArray) -> NDArray[np.float32]:
    return (2.0 * np.clip(open_rates, 0.0, 1.0) - 1.0).astype(np.float32)
