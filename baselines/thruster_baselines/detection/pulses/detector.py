"""Detectors of plasma thrusters behind the one contract: by waveforms of pulses, and by how many there are.

Both look at `Telemetry.pulses`: for each pair of opposite thrusters, which of the two fired in the period.
`WaveformDetector` takes any measure of a single pulse (the residual against a nominal discharge, the
likelihood ratio of a fit, the prediction error of a network) and isolates the thruster with the largest;
`PulseCountDetector` gathers the counts of `PulseCountCUSUM` period by period.

Left out: what the thrust is (`PulseEstimate`), and causes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.checks import mask_of
from thruster_baselines.detection.contract import Telemetry, Verdict
from thruster_baselines.detection.pulses.counts import PulseCountCUSUM
from thruster_baselines.detection.pulses.fit import PulseFit
from thruster_baselines.detection.pulses.residual import PulseResidual
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["PulseCountDetector", "WaveformDetector", "firings_of"]

Measure: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""Statistic (pulses,) of waveforms (pulses, samples) in V and A."""


def firings_of(pulses: ArrayLike) -> tuple[BoolArray, IntArray]:
    """Which pairs fired (vehicles, pairs), and which thruster of each, from 0.

    Args:
        pulses: (vehicles, pairs): 1 for the first thruster of a pair, -1 for the second, 0 for none.

    >>> firings_of([[1, 0, -1]])[1]
    array([[0, 2, 5]])
    """
    record = np.asarray(pulses)
    if record.ndim != 2:
        raise ValueError(f"pulses must have the shape (vehicles, pairs), got {record.shape}")
    return record != 0, 2 * np.arange(record.shape[1]) + (record < 0)


class _PulseDetector:
    """Clock, latched alarm and isolated thruster of each vehicle.

    Args:
        threshold: Alarm threshold on the test statistic.
        pairs: Pairs of opposite thrusters.
        vehicles: Number of vehicles monitored.

    Attributes:
        threshold: May be changed at any time.
        time: (vehicles,), s since the last reset.

    Raises:
        ValueError: A threshold below 0.
    """

    def __init__(self, threshold: float, pairs: int, vehicles: int) -> None:
        if not threshold >= 0.0:
            raise ValueError(f"threshold must be 0 or more, got {threshold}")
        self.threshold, self._pairs = float(threshold), pairs
        self.time: FloatArray = np.zeros(vehicles)

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Restart, in the vehicles of a mask (vehicles,) or in all of them."""
        mask = mask_of(vehicles, self.time.size)
        self.time[mask] = 0.0
        self._restart(mask)

    def _restart(self, mask: BoolArray) -> None:
        """Drop the evidence of the vehicles of a mask (vehicles,)."""

    def _verdict(self, telemetry: Telemetry, scores: FloatArray, told_apart: BoolArray) -> Verdict:
        """Of scores (vehicles, n); `told_apart` (vehicles,) where the largest names its thruster."""
        self.time += telemetry.duration
        statistic = scores.max(axis=1)
        detected = statistic > self.threshold
        thruster = np.where(detected & told_apart, scores.argmax(axis=1) + 1, 0)
        return Verdict(detected, thruster, statistic, self.time.copy(), scores, np.zeros_like(scores))


class WaveformDetector(_PulseDetector):
    """Alarms in a period with a pulse whose statistic is above the threshold.

    Args:
        measure: Statistic (pulses,) of waveforms (pulses, samples): `PulseResidual.residual`, say.
        threshold: Alarm threshold on it.
        pairs: Pairs of opposite thrusters.
        vehicles: Number of vehicles monitored.

    Raises:
        ValueError: A threshold below 0.
    """

    def __init__(self, measure: Measure, threshold: float, *, pairs: int = 3, vehicles: int = 1) -> None:
        super().__init__(threshold, pairs, vehicles)
        self.measure = measure

    @classmethod
    def of_residual(cls, residual: PulseResidual, vehicles: int = 1) -> WaveformDetector:
        """By the residual of the current, at its own threshold."""
        return cls(residual.residual, residual.threshold, vehicles=vehicles)

    @classmethod
    def of_fit(cls, fit: PulseFit, threshold: float, vehicles: int = 1) -> WaveformDetector:
        """By the likelihood ratio of a fit; of healthy pulses it is chi-squared of two degrees of freedom."""
        return cls(lambda voltage, current: fit(voltage, current).statistic, threshold, vehicles=vehicles)

    def update(self, telemetry: Telemetry, /) -> Verdict:
        """Take in one control period.

        Raises:
            ValueError: Telemetry without pulses, voltage or current; waveforms that do not belong to them.
        """
        fired, thruster = firings_of(telemetry.need("pulses"))
        scores = np.zeros((fired.shape[0], 2 * self._pairs))
        if fired.any():
            voltage, current = (np.asarray(telemetry.need(name)) for name in ("voltage", "current"))
            rows, axes = np.nonzero(fired)
            scores[rows, thruster[rows, axes]] = self.measure(voltage[rows, axes], current[rows, axes])
        return self._verdict(telemetry, scores, np.ones(len(scores), np.bool_))


class PulseCountDetector(_PulseDetector):
    """Alarms when a thruster of a pair has had to fire more often than it should.

    The record alone does not say whether that one is weak or its opposite strong: the one that fires more is
    isolated, as a weak one is the commoner fault.

    Args:
        rule: Mean, slack and threshold of each pair, and where counting begins.
        threshold: Alarm threshold on the largest sum, in units of the thresholds of the rule.
        vehicles: Number of vehicles monitored.

    Attributes:
        sums: (vehicles, pairs, 2): too many pulses of the first, of the second thruster.

    Raises:
        ValueError: A threshold below 0.
    """

    def __init__(self, rule: PulseCountCUSUM, threshold: float = 1.0, *, vehicles: int = 1) -> None:
        super().__init__(threshold, rule.mean.size, vehicles)
        self.rule = rule
        self.sums: FloatArray = np.zeros((vehicles, rule.mean.size, 2))
        self._periods: IntArray = np.zeros(vehicles, np.int64)

    def _restart(self, mask: BoolArray) -> None:
        self.sums[mask], self._periods[mask] = 0.0, 0

    def update(self, telemetry: Telemetry, /) -> Verdict:
        """Take in one control period.

        Raises:
            ValueError: Telemetry without pulses.
        """
        record = np.asarray(telemetry.need("pulses"), np.float64)
        beyond = record - self.rule.mean
        steps = np.stack((beyond, -beyond), axis=-1) - self.rule.slack[:, np.newaxis]
        counted = (self._periods >= self.rule.begin)[:, np.newaxis, np.newaxis]
        self.sums = np.where(counted, np.maximum(self.sums + steps, 0.0), self.sums)
        self._periods += 1
        scores = (self.sums / self.rule.threshold[:, np.newaxis]).reshape(len(record), -1)
        return self._verdict(telemetry, scores, np.ones(len(scores), np.bool_))
