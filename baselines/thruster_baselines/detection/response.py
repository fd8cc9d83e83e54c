"""A response test: after each firing, ask which one thruster's under-delivery explains best what came.

Models one thruster at a time that delivers only a share of its thrust, and independent sensor noise of
known size. For each thruster that fired, the share it must have lost to explain the difference between
measured and expected rate change is a least-squares fit; the statistic is by how much that fit lowers the
noise-weighted square of the difference. The best thruster is blamed when its statistic exceeds a threshold.

Left out: several thrusters failing at once, thrust without command, evidence gathered over several firings,
recovery of a thruster that nobody fires any more.
"""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.detection.calibration import threshold_for
from thruster_baselines.detection.checks import mask_of
from thruster_baselines.detection.contract import Telemetry, Verdict, check_alone
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ResponseTest", "threshold_for"]


class ResponseTest:
    """Believed health of each thruster in a batch of vehicles, revised after every firing.

    Args:
        spacecraft: Description of the nominal vehicle: its effectiveness, and the noise of its velocity and
            rate sensors.
        threshold: Of the statistic, dimensionless; see :func:`threshold_for`.
        vehicles: How many vehicles are watched.

    Attributes:
        health: (vehicles, n), believed share 0..1 of its thrust that each thruster delivers.
        statistic: (vehicles,), of the last firing: the drop in noise-weighted squared difference, 0 without
            a firing.

    Raises:
        ValueError: A threshold below 0 or NaN; fewer than one vehicle.

    >>> from thruster_envs.spacecraft import load
    >>> orion = load("orion")
    >>> test = ResponseTest(orion, threshold=20.0)
    >>> fired = np.full((1, 12), 4.0)
    >>> test.update(fired, -orion.effectiveness()[:, 2] * 4.0).argmin()  # thruster 3 gave nothing
    np.int64(2)
    """

    def __init__(self, spacecraft: Spacecraft, threshold: float, vehicles: int = 1) -> None:
        if not threshold >= 0.0:
            raise ValueError(f"threshold is {threshold}; a number of 0 or more would be right")
        if vehicles < 1:
            raise ValueError(f"vehicles is {vehicles}; one or more would be right")
        sensors = spacecraft.sensors
        noise = np.sqrt(2.0) * np.repeat([sensors.velocity, sensors.rate], 3)
        smallest = 1e-3 * np.where(spacecraft.authority() > 0.0, spacecraft.authority(), 1.0)
        self._whitened = spacecraft.effectiveness() / np.maximum(noise, smallest)[:, np.newaxis]
        self._noise = np.maximum(noise, smallest)
        self._square = np.square(self._whitened).sum(axis=0)
        self._nominal = spacecraft.effectiveness()
        self.threshold = float(threshold)
        self.reset(vehicles)

    def reset(self, vehicles: int | ArrayLike | None = None) -> None:
        """Restart with that many vehicles, all believed healthy; or those of a mask (vehicles,), or all."""
        if isinstance(vehicles, int):
            self.health: FloatArray = np.ones((vehicles, self._square.size))
            self.statistic: FloatArray = np.zeros(vehicles)
            self.time: FloatArray = np.zeros(vehicles)
            return
        mask = mask_of(vehicles, self.time.size)
        self.health[mask], self.statistic[mask], self.time[mask] = 1.0, 0.0, 0.0

    @property
    def belief(self) -> ActuatorBelief:
        """What is believed of the thrusters, (vehicles, n)."""
        return ActuatorBelief.of_shares(self.health)

    @overload
    def update(self, on_times: Telemetry, /) -> Verdict: ...

    @overload
    def update(self, on_times: ArrayLike, difference: ArrayLike) -> FloatArray: ...

    def update(
        self, on_times: Telemetry | ArrayLike, difference: ArrayLike | None = None
    ) -> Verdict | FloatArray:
        """Revise the belief after one firing.

        Args:
            on_times: `Telemetry` with on-times, measured and (the nominal vehicle's by default) expected rate
                change, or (vehicles, n), s: what each thruster was told.
            difference: (vehicles, 6): measured minus expected rate change, m/s and rad/s, body axes;
                expected of the nominal vehicle.

        Returns:
            (vehicles, n), the believed health, where arrays are given. Where the test finds nobody to blame,
            it is what it was before.

        Raises:
            TypeError: A difference beside telemetry, or none without it.
        """
        if isinstance(on_times, Telemetry):
            check_alone(difference=difference)
            return self._diagnose(on_times)
        if difference is None:
            raise TypeError("update must have telemetry, or on_times and difference")
        told = np.atleast_2d(np.asarray(on_times, dtype=np.float64))
        missing = -np.atleast_2d(np.asarray(difference, dtype=np.float64)) / self._noise
        along = missing @ self._whitened
        effect = self._square * told
        lost = np.clip(along / np.where(effect > 0.0, effect, np.inf), 0.0, 1.0)
        drop = lost * told * (2.0 * along - lost * effect)
        blamed, everyone = drop.argmax(axis=1), np.arange(drop.shape[0])
        self.statistic = drop[everyone, blamed]
        found = self.statistic > self.threshold
        self.health[found] = 1.0
        self.health[everyone[found], blamed[found]] = 1.0 - lost[everyone[found], blamed[found]]
        return self.health

    def _diagnose(self, seen: Telemetry) -> Verdict:
        told = np.asarray(seen.need("on_times"), dtype=np.float64)
        given = seen.expected_change
        expected = told @ self._nominal.T if given is None else np.asarray(given, dtype=np.float64)
        difference = np.asarray(seen.need("rate_change"), dtype=np.float64) - expected
        there = mask_of(seen.valid, len(told)) & np.isfinite(difference).all(axis=1)
        health = self.update(np.where(there[:, np.newaxis], told, 0.0), np.nan_to_num(difference)).copy()
        self.time += seen.duration
        detected = self.statistic > self.threshold
        lost = np.where(detected[:, np.newaxis], 1.0 - health, 0.0)
        suspicion = np.where(lost > 0.0, self.statistic[:, np.newaxis], 0.0)
        kind = np.where(lost.max(axis=1) == 1.0, "stuck_off", "loss")
        return Verdict(
            detected, np.where(detected, lost.argmax(axis=1) + 1, 0), self.statistic, self.time.copy(),
            suspicion, lost * told, tuple(np.where(detected, kind, "").tolist()),
        )  # fmt: skip
