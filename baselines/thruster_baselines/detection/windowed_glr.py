"""The generalised likelihood ratio over a window: whose lasting fault began when, and how large it is.

A fault of thruster i from interval j on adds q f_ti to the residual e_t: f_ti = -u_ti a_i for a loss, (T_t -
u_ti) a_i for thrust without command. With c = sum over t >= j of f' Y_t^-1 e_t and s the same sum of f'
Y_t^-1 f, q = c / s cut to 0 to 1, twice the log-likelihood against no fault is 2 q c - q^2 s; the largest
over thrusters, kinds and onsets is the statistic. A longer window finds smaller faults, and takes longer to
forget the time before an onset.

Exact where the filter does not learn (the default with `PhysicalNoise`). Left out: that consecutive rate
changes share a velocity measurement.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.calibration import chi_squared_threshold
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.interval import Interval, Scores, whiten
from thruster_baselines.detection.settings import FilterSettings
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["EXCESS", "LOSS", "WindowedGLR", "evidence"]

LOSS, EXCESS = 0, 1

_WINDOW = 10


class WindowedGLR(BaseDetector):
    """Blames the thruster whose lasting fault, begun within the window, is the likeliest.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of twice the log-likelihood ratio, dimensionless.
        window: How many of the last measured intervals are looked back on.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        onset: (vehicles,), s since the reset: the likeliest beginning of the fault of the thruster that is
            the most suspicious in the last interval; meaningless where the statistic is zero.
        excess: (vehicles,), whether that fault is thrust without command; otherwise it is a loss.
        share: (vehicles,), its likeliest size, 0 to 1.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> from thruster_baselines.estimation import PhysicalNoise
    >>> detector = WindowedGLR("orion", threshold=30.0, noise=PhysicalNoise("orion"), coupling=0.0)
    >>> for interval in range(8):
    ...     weak = np.full(12, 0.1)
    ...     weak[2] *= 0.2 if interval >= 3 else 1.0
    ...     diagnosis = detector.update(np.full(12, 0.1), detector.filter.effectiveness[0] @ weak, 1.0)
    >>> diagnosis.thruster, detector.onset, detector.share.round(3), detector.excess
    (array([3]), array([3.]), array([0.8]), array([False]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float,
        window: int = _WINDOW,
        **settings: Unpack[FilterSettings],
    ) -> None:
        if window < 1:
            raise ValueError(f"window is {window}; one interval or more would be right")
        self.window = window
        super().__init__(spacecraft, threshold, **settings)

    @classmethod
    def _closed_form(
        cls, spacecraft: Spacecraft, rate: float, /, window: int = _WINDOW, **_: Any
    ) -> float | None:
        """Chi-squared, once for each thruster and onset, of which half are losses and half are gains."""
        return chi_squared_threshold(rate, tests=spacecraft.number_of_thrusters * window)

    def _forget(self, mask: BoolArray) -> None:
        if mask.all():
            count, _, n = self._believed.shape
            self._sums: FloatArray = np.zeros((count, self.window, 4, n))
            self._starts: FloatArray = np.zeros((count, self.window))
            self._filled: IntArray = np.zeros((count, 2), np.int64)  # how many there are, where the next goes
            self.onset: FloatArray = np.zeros(count)
            self.share: FloatArray = np.zeros(count)
            self.excess: BoolArray = np.zeros(count, np.bool_)
            return
        self._filled[mask] = 0
        self.onset[mask], self.share[mask], self.excess[mask] = 0.0, 0.0, False

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        memory = self._sums, self._starts, self._filled, self.onset, self.share, self.excess
        _over_the_window(tuple(interval), self.time, memory, tuple(scores))
        return self._answer(scores)

    def _kinds(self, detected: BoolArray) -> tuple[str, ...]:
        found = zip(detected.tolist(), self.excess.tolist(), self.share.tolist(), strict=True)
        return tuple(
            [
                ("stuck_on" if excess else "stuck_off" if share == 1.0 else "loss") if one else ""
                for one, excess, share in found
            ]
        )


class _Window(NamedTuple):
    """Sums (vehicles, window, 4, n), starts, how many are filled, and of the likeliest fault what it is."""

    sums: FloatArray
    starts: FloatArray
    filled: IntArray
    onset: FloatArray
    share: FloatArray
    excess: BoolArray


@njit(error_model="numpy")
def evidence(
    interval: Interval, v: int, root: FloatArray, e: FloatArray, a: FloatArray, row: FloatArray
) -> None:
    """What one interval says of a fault of size one of each thruster of vehicle v: c and s of both kinds.

    Args:
        interval: Of all vehicles.
        v: Index of the vehicle.
        root: (m, m), scratch.
        e: (m,), scratch.
        a: (m, n), scratch.
        row: (4, n), written: c and s of a loss, c and s of thrust without command.
    """
    effectiveness, on_times, duration = interval.effectiveness[v], interval.on_times[v], interval.duration
    m, n = effectiveness.shape
    whiten(interval.covariance[v], interval.residual[v], effectiveness, root, e, a)
    for i in range(n):
        row[0, i] = row[1, i] = 0.0
    for k in range(m):
        for i in range(n):
            row[0, i] += a[k, i] * e[k]
            row[1, i] += a[k, i] * a[k, i]
    for i in range(n):
        along, square = row[0, i], row[1, i]
        spare = max(duration - on_times[i], 0.0)
        row[0, i] = -on_times[i] * along
        row[1, i] = on_times[i] ** 2 * square
        row[2, i] = spare * along
        row[3, i] = spare**2 * square


@kernel(nogil=True)
def _over_the_window(interval: Interval, time: FloatArray, memory: _Window, scores: Scores) -> None:
    interval = Interval(*interval)
    on_times, duration = interval.on_times, interval.duration
    sums, starts, filled, onset, share, excess = memory
    statistic, blamed, ratio, shortfall = scores
    m, n = interval.effectiveness.shape[1:]
    window = sums.shape[1]
    root, e, a, total = np.empty((m, m)), np.empty(m), np.empty((m, n)), np.empty((4, n))
    for v in range(statistic.size):
        if not interval.valid[v]:
            continue
        slot = filled[v, 1]
        evidence(interval, v, root, e, a, sums[v, slot])
        starts[v, slot] = time[v] - duration
        filled[v, 0] = min(filled[v, 0] + 1, window)
        filled[v, 1] = (slot + 1) % window
        for r in range(4):
            for i in range(n):
                total[r, i] = 0.0
        for back in range(filled[v, 0]):
            past = (slot - back) % window
            for r in range(4):
                for i in range(n):
                    total[r, i] += sums[v, past, r, i]
            for kind in range(2):
                for i in range(n):
                    c, s = total[2 * kind, i], total[2 * kind + 1, i]
                    if c <= 0.0 or interval.excluded[v, i]:
                        continue
                    q = min(c / s, 1.0)
                    found = q * (2.0 * c - q * s)
                    if found <= ratio[v, i]:
                        continue
                    ratio[v, i] = found
                    shortfall[v, i] = q * (on_times[v, i] if kind == LOSS else on_times[v, i] - duration)
                    if found > statistic[v]:
                        statistic[v], blamed[v] = found, i + 1
                        onset[v], share[v], excess[v] = starts[v, past], q, kind == EXCESS
