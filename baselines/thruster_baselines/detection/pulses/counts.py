"""Cumulative sums of pulse counts: does one thruster of a pair have to fire more than it should?

While an attitude is held, the mean of the pulses u_k of a pair of opposite thrusters (1, -1 or 0 a period) is
that of healthy missions. A weak thruster fires more often, a strong one less (Valdes 2008, section 5.5):

    g_k = max(0, g_(k-1) +- (u_k - mean) - slack),

and an alarm above the threshold (Page 1954). The record alone does not say whether the thruster that fires
more is weak, or its opposite strong. Left out: the turn to the attitude; what the gyroscopes say (`motion`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.calibration import threshold_for_rate
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["CountDiagnosis", "PulseCountCUSUM"]


@dataclass(frozen=True, slots=True)
class CountDiagnosis:
    """What the sums say of each mission.

    Attributes:
        flagged: (missions, pairs): whether a sum exceeded its threshold.
        more: (missions, pairs): 1 if the positive thruster of the pair fires more than it should, -1 if the
            negative one does, by the larger sum; 0 where nothing is flagged.
        first: (missions, pairs): control period, from 0, of the first alarm; -1 for none.
        largest: (missions, pairs): sum, over its threshold.
    """

    flagged: BoolArray
    more: IntArray
    first: IntArray
    largest: FloatArray


class PulseCountCUSUM:
    """Sums of the pulse counts of each pair, from a period on in which the attitude is held.

    Args:
        mean: (pairs,): pulses a period of a healthy craft, signed.
        slack: (pairs,): that is taken off in each period: half of the smallest change that has to be found.
        threshold: (pairs,), pulses.
        begin: First period that counts, from 0.

    Raises:
        ValueError: A slack below zero, a threshold that is not positive, a beginning below zero.
    """

    def __init__(self, mean: ArrayLike, slack: ArrayLike, threshold: ArrayLike, begin: int) -> None:
        self.mean, self.slack, self.threshold = (
            np.asarray(one, dtype=np.float64) for one in (mean, slack, threshold)
        )
        if not (self.slack >= 0.0).all():
            raise ValueError(f"slack is {self.slack}; zero or more would be right")
        if not (self.threshold > 0.0).all():
            raise ValueError(f"threshold is {self.threshold}; a positive number of pulses would be right")
        if begin < 0:
            raise ValueError(f"begin is {begin}; a period from 0 would be right")
        self.begin = begin

    @classmethod
    def calibrated(
        cls, pulses: ArrayLike, begin: int, false_alarms: float, change: ArrayLike, confidence: float = 0.95
    ) -> PulseCountCUSUM:
        """With the mean of healthy missions, and a threshold at a stated rate of false alarms.

        Args:
            pulses: (missions, periods, pairs) of healthy missions: 1, -1 or 0.
            begin: First period that counts, from 0.
            false_alarms: Share of healthy missions in which a pair alarms, above 0 and below 1.
            change: Smallest change of the mean that has to be found, pulses a period.
            confidence: That the true share is not above it.

        Raises:
            ValueError: Too few missions for the rate, or what the constructor refuses.
        """
        held = np.asarray(pulses)[:, begin:]
        mean = held.mean(axis=(0, 1))
        slack = 0.5 * np.broadcast_to(np.asarray(change, dtype=np.float64), mean.shape)
        largest = cls(mean, slack, np.ones(mean.size), begin).sums(pulses).max(axis=(1, 3))
        found = [threshold_for_rate(one, false_alarms, confidence).threshold for one in largest.T]
        return cls(mean, slack, found, begin)

    def sums(self, pulses: ArrayLike) -> FloatArray:
        """(missions, counted periods, pairs, 2): too many of the positive, of the negative thruster's pulses.

        Args:
            pulses: (missions, periods, pairs): 1, -1 or 0.

        Raises:
            ValueError: Another shape.
        """
        record = np.asarray(pulses, dtype=np.float64)
        if record.ndim != 3 or record.shape[2] != self.mean.size:
            raise ValueError(
                f"pulses has the shape {record.shape}; (missions, periods, {self.mean.size}) would be right"
            )
        beyond = record[:, self.begin :] - self.mean
        steps = np.stack((beyond, -beyond), axis=-1) - self.slack[:, np.newaxis]
        total = np.cumsum(steps, axis=1)
        lowest = np.minimum(np.minimum.accumulate(total, axis=1), 0.0)
        return np.asarray(total - lowest)

    def __call__(self, pulses: ArrayLike) -> CountDiagnosis:
        """What the record of each mission says; `pulses` as of `sums`."""
        sums = self.sums(pulses)
        over = sums / self.threshold[:, np.newaxis]
        alarms = np.any(over > 1.0, axis=-1)
        flagged = np.asarray(np.any(alarms, axis=1))
        largest = over.max(axis=1)
        more = np.where(largest[..., 0] >= largest[..., 1], 1, -1)
        return CountDiagnosis(
            flagged=flagged,
            more=np.where(flagged, more, 0),
            first=np.where(flagged, self.begin + np.argmax(alarms, axis=1), -1),
            largest=largest.max(axis=-1),
        )
