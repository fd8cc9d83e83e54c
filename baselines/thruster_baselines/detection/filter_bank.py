"""A bank of filters: one for each thing that may be wrong, and how probable each of them is by now.

Beside the healthy filter there are three for each thruster: off, weak by a stated share, open all the time.
With the residual e_j and its covariance Y_j, the weights follow (Magill 1965; never below a floor)

    log w_j <- log w_j - (e_j' Y_j^-1 e_j + log det Y_j) / 2.

The statistic is the log-odds of any fault against none, counted from the least that the floor allows.
`mixture` gives mean and covariance of what the thrusters do (Bar-Shalom, Li and Kirubarajan 2001).

Left out: several faults at once, shares between those of the hypotheses (the nearest wins), the coupling of a
thruster that opens in part.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.interval import Interval, Scores, whiten
from thruster_baselines.detection.settings import FilterSettings
from thruster_baselines.estimation import Innovation
from thruster_baselines.mapping.coupling import convert
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FilterBank"]

KINDS = ("off", "weak", "on")
"""What a hypothesis says of its thruster; hypothesis 0 is no fault, 1 + 3 i + kind is of thruster index i."""


class FilterBank(BaseDetector):
    """Blames the thruster of which some fault is the most probable.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of the log-odds of a fault against none, above their least.
        weak_share: What share of its thrust a weak thruster gives, between 0 and 1.
        floor: What no weight falls below, and with which each fault begins.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        log_weights: (vehicles, 1 + 3 n): no fault, then off, weak and on of each thruster.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> from thruster_baselines.estimation import PhysicalNoise
    >>> detector = FilterBank("orion", threshold=5.0, noise=PhysicalNoise("orion"), coupling=0.0)
    >>> gave = np.full(12, 0.1) * (np.arange(12) != 4)
    >>> for _ in range(4):
    ...     diagnosis = detector.update(np.full(12, 0.1), detector.filter.effectiveness[0] @ gave, 1.0)
    >>> diagnosis.thruster, detector.kind
    (array([5]), ['off'])
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float,
        *,
        weak_share: float = 0.5,
        floor: float = 1e-9,
        **settings: Unpack[FilterSettings],
    ) -> None:
        if not 0.0 < weak_share < 1.0:
            raise ValueError(f"weak_share is {weak_share}; between 0 and 1 would be right")
        if not 0.0 < floor < 1.0:
            raise ValueError(f"floor is {floor}; between 0 and 1 would be right")
        self.weak_share, self._floor, self._log_floor = weak_share, floor, float(np.log(floor))
        super().__init__(spacecraft, threshold, **settings)
        hypotheses = self.log_weights.shape[1]
        if not floor < 1.0 / hypotheses:
            raise ValueError(
                f"floor is {floor}; below 1 / {hypotheses}, as there are so many hypotheses, would be right"
            )

    @classmethod
    def _closed_form(cls, _: Spacecraft, rate: float, /, **__: Any) -> float | None:
        """The mean of likelihood ratios that never fall below one exceeds e^h in e^-h of all intervals."""
        return -math.log(rate)

    def _begin(self, mask: BoolArray) -> None:
        super()._begin(mask)
        count, _, n = self._believed.shape
        each = len(KINDS) * n
        if mask.all():
            self._bank = self._filter_of(vehicles=count * each)
        else:
            self._bank.reset(np.repeat(mask, each))

    def _replace(self, mask: BoolArray, thruster: int, columns: FloatArray) -> None:
        super()._replace(mask, thruster, columns)
        each = len(KINDS) * self._believed.shape[2]
        self._bank.replace_column(np.repeat(mask, each), thruster, np.repeat(columns, each, axis=0))

    def _forget(self, mask: BoolArray) -> None:
        count, _, n = self._believed.shape
        if mask.all():
            self.log_weights: FloatArray = np.empty((count, 1 + len(KINDS) * n))
        alive = np.repeat(~self._dead[mask], len(KINDS), axis=1)
        self.log_weights[mask, 1:] = np.where(alive, self._log_floor, -np.inf)
        self.log_weights[mask, 0] = np.log(np.maximum(1.0 - self._floor * alive.sum(axis=1), self._floor))

    @property
    def probability(self) -> FloatArray:
        """(vehicles, 1 + 3 n): no fault, then off, weak and on of each thruster."""
        return np.exp(self.log_weights)

    @property
    def kind(self) -> list[str]:
        """What is the most probable of each vehicle: none, off, weak or on."""
        best = self.log_weights.argmax(axis=1)
        return [KINDS[(h - 1) % len(KINDS)] if h > 0 else "none" for h in best.tolist()]

    def _kinds(self, detected: BoolArray) -> tuple[str, ...]:
        names = {"none": "", "off": "stuck_off", "weak": "loss", "on": "stuck_on"}
        pairs = zip(self.kind, detected.tolist(), strict=True)
        return tuple([names[kind] if one else "" for kind, one in pairs])

    def mixture(self, vehicle: int = 0) -> tuple[FloatArray, FloatArray]:
        """What the thrusters of a vehicle give for each second of command.

        A thruster that is off or stuck open gives nothing for a command, a weak one its share.

        Args:
            vehicle: Its index, from 0.

        Returns:
            The mean (m, n), m/s^2 then rad/s^2, and the covariance (m n, m n) of its columns stacked.
        """
        m, n = self._nominal.shape
        each = len(KINDS) * n
        weights = self.probability[vehicle]
        means, within = np.empty((1 + each, m * n)), np.zeros((m * n, m * n))
        for h in range(1 + each):
            at = vehicle * each + h - 1
            estimate = self.filter.effectiveness[vehicle] if h == 0 else self._bank.effectiveness[at]
            scale = np.ones(n)
            if h > 0:
                scale[(h - 1) // len(KINDS)] = self.weak_share if (h - 1) % len(KINDS) == 1 else 0.0
            means[h] = (estimate * scale).T.reshape(-1)
            covariance = self.filter.covariance_of(vehicle) if h == 0 else self._bank.covariance_of(at)
            by_entry = np.repeat(scale, m)
            within += weights[h] * covariance * np.outer(by_entry, by_entry)
        mean = weights @ means
        spread = means - mean
        return mean.reshape(n, m).T, within + (spread.T * weights) @ spread

    def _diagnose(self, interval: Interval) -> Verdict:
        count, n = interval.on_times.shape
        each = len(KINDS) * n
        delivered = np.empty((count, each, n))
        _hypothetical(
            interval.commanded, interval.on_times, interval.duration, self._shares, self.weak_share, delivered
        )
        rows = delivered.reshape(count * each, n)
        noise = None if self._noise is None else self._noise.of_rows(rows)
        if noise is not None and self._unmodelled is not None:
            noise += np.repeat(self._unmodelled, each, axis=0)
        innovation = self._bank.advance(
            rows, np.repeat(interval.rate_change, each, axis=0), np.repeat(interval.valid, each), noise
        )
        scores = Scores.of(interval)
        _weigh(
            tuple(interval), tuple(innovation), self.weak_share, self._log_floor, self.log_weights,
            tuple(scores),
        )  # fmt: skip
        return self._answer(scores)


@kernel(nogil=True)
def _hypothetical(
    commanded: FloatArray,
    effective: FloatArray,
    duration: float,
    shares: FloatArray,
    weak: float,
    delivered: FloatArray,
) -> None:
    """Effective on-times (vehicles, 3 n, n) under each hypothesis."""
    n = commanded.shape[1]
    order = np.empty(n, np.int64)
    for v in range(commanded.shape[0]):
        told = commanded[v].copy()
        for i in range(n):
            own = told[i]
            told[i] = 0.0
            convert(told, shares, order, True, delivered[v, 3 * i])
            told[i] = duration
            convert(told, shares, order, True, delivered[v, 3 * i + 2])
            told[i] = own
            for other in range(n):
                delivered[v, 3 * i + 1, other] = effective[v, other]
            delivered[v, 3 * i + 1, i] *= weak


@kernel(nogil=True)
def _weigh(
    interval: Interval,
    bank: Innovation,
    weak: float,
    floor: float,
    log_weights: FloatArray,
    scores: Scores,
) -> None:
    interval, bank = Interval(*interval), Innovation(*bank)
    on_times, duration = interval.on_times, interval.duration
    statistic, blamed, suspicion, shortfall = scores
    m, n = interval.residual.shape[1], on_times.shape[1]
    root, e, a, none = np.empty((m, m)), np.empty(m), np.empty((m, 0)), np.empty((m, 0))
    for v in range(on_times.shape[0]):
        if not interval.valid[v]:
            continue
        weights = log_weights[v]
        for h in range(1 + 3 * n):
            if h == 0:
                whiten(interval.covariance[v], interval.residual[v], none, root, e, a)
            else:
                at = v * 3 * n + h - 1
                whiten(bank.covariance[at], bank.residual[at], none, root, e, a)
            for k in range(m):
                weights[h] -= 0.5 * e[k] * e[k] + np.log(root[k, k])
        _normalise(weights)
        for h in range(weights.size):
            if weights[h] > -np.inf:
                weights[h] = max(weights[h], floor)
        _normalise(weights)
        alive = 0
        for i in range(n):
            alive += weights[1 + 3 * i] > -np.inf
        sound = weights[0] - np.log(1.0 - 3.0 * alive * np.exp(floor))  # against where it comes to rest
        any_fault, most = 0.0, 0.0
        for i in range(n):
            own = 0.0
            for kind in range(3):
                own += np.exp(weights[1 + 3 * i + kind])
            if own == 0.0:
                continue
            any_fault += own
            suspicion[v, i] = max(np.log(own / 3.0) - floor - sound, 0.0)
            spare = on_times[v, i] - duration
            expected = np.exp(weights[1 + 3 * i]) * on_times[v, i]
            expected += np.exp(weights[2 + 3 * i]) * (1.0 - weak) * on_times[v, i]
            expected += np.exp(weights[3 + 3 * i]) * spare
            shortfall[v, i] = expected / own
            if own > most:
                most = own
                blamed[v] = i + 1
        if any_fault > 0.0:
            statistic[v] = max(np.log(any_fault / (3.0 * alive)) - floor - sound, 0.0)


@njit(error_model="numpy")
def _normalise(log_weights: FloatArray) -> None:
    """Make the weights sum to one."""
    largest = -np.inf
    for h in range(log_weights.size):
        largest = max(largest, log_weights[h])
    total = 0.0
    for h in range(log_weights.size):
        total += np.exp(log_weights[h] - largest)
    shift = largest + np.log(total)
    for h in range(log_weights.size):
        log_weights[h] -= shift
