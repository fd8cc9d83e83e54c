"""Cumulative sums: evidence for a fault of a design size q, gathered until it is enough (Page 1954).

For each thruster, and for missing thrust and thrust without command, with the signature f of a fault of size
one, c_k = f' Y^-1 e and s_k = f' Y^-1 f of interval k:

    g_k = max(0, g_(k-1) + q c_k - q^2 s_k / 2).

The thruster is isolated whose fitted share explains the most since its sum last was zero. Knobs: the
threshold, whose mean time between false alarms grows about as its exponential, and the design sizes, by
default the smallest that a `FaultDistribution` draws; a fault below half of one is hardly ever found.

Left out: how far the fault is from its design size when to alarm is decided (`WindowedGLR` fits it).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.interval import Interval, Scores
from thruster_baselines.detection.settings import FilterSettings
from thruster_baselines.detection.windowed_glr import LOSS, evidence
from thruster_envs.faults.distribution import DEFAULT_SEVERITY
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["CUSUMDetector"]


class CUSUMDetector(BaseDetector):
    """Alarms when enough evidence has gathered, and blames the thruster that explains it best.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of the gathered log-likelihood ratio, dimensionless.
        design_loss: Share of its thrust that a thruster has lost if it is faulty, above 0 and up to 1.
        design_excess: Share of full thrust that comes without command if it is faulty, above 0 and up to 1.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        sums: (vehicles, 2, n): the evidence for a loss, and for thrust without command.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> from thruster_baselines.estimation import PhysicalNoise
    >>> detector = CUSUMDetector("orion", threshold=10.0, noise=PhysicalNoise("orion"), coupling=0.0)
    >>> told, gave = np.full(12, 0.05), np.full(12, 0.05)
    >>> gave[6] *= 0.3
    >>> alarms = [detector.update(told, detector.filter.effectiveness[0] @ gave, 1.0) for _ in range(9)]
    >>> [int(alarm.thruster[0]) for alarm in alarms]
    [0, 0, 0, 0, 7, 7, 7, 7, 7]
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float,
        *,
        design_loss: float = DEFAULT_SEVERITY["loss"][0],
        design_excess: float = DEFAULT_SEVERITY["leak"][0],
        **settings: Unpack[FilterSettings],
    ) -> None:
        for name, size in (("design_loss", design_loss), ("design_excess", design_excess)):
            if not 0.0 < size <= 1.0:
                raise ValueError(f"{name} is {size}; a share above 0 and up to 1 would be right")
        self._design = np.array([design_loss, design_excess])
        super().__init__(spacecraft, threshold, **settings)

    @classmethod
    def _closed_form(cls, spacecraft: Spacecraft, rate: float, /, **_: Any) -> float | None:
        """From zero a sum reaches h with a chance of exp(-h); there are two of each thruster."""
        return math.log(2.0 * spacecraft.number_of_thrusters / rate)

    def _forget(self, mask: BoolArray) -> None:
        if mask.all():
            count, _, n = self._believed.shape
            self.sums: FloatArray = np.zeros((count, 2, n))
            self._runs: FloatArray = np.zeros((count, 4, n))
            return
        self.sums[mask] = 0.0
        self._runs[mask] = 0.0

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        _gather(tuple(interval), self._design, self.sums, self._runs, tuple(scores))
        return self._answer(scores)


@kernel(nogil=True)
def _gather(
    interval: Interval, design: FloatArray, sums: FloatArray, runs: FloatArray, scores: Scores
) -> None:
    interval = Interval(*interval)
    on_times, duration = interval.on_times, interval.duration
    statistic, blamed, suspicion, shortfall = scores
    m, n = interval.effectiveness.shape[1:]
    root, e, a, row = np.empty((m, m)), np.empty(m), np.empty((m, n)), np.empty((4, n))
    for v in range(statistic.size):
        if not interval.valid[v]:
            continue
        evidence(interval, v, root, e, a, row)
        best = 0.0
        for kind in range(2):
            q = design[kind]
            for i in range(n):
                if interval.excluded[v, i]:
                    continue
                step = q * row[2 * kind, i] - 0.5 * q * q * row[2 * kind + 1, i]
                gathered = max(0.0, sums[v, kind, i] + step)
                sums[v, kind, i] = gathered
                if gathered == 0.0:
                    runs[v, 2 * kind, i] = runs[v, 2 * kind + 1, i] = 0.0
                    continue
                runs[v, 2 * kind, i] += row[2 * kind, i]
                runs[v, 2 * kind + 1, i] += row[2 * kind + 1, i]
                c, s = runs[v, 2 * kind, i], runs[v, 2 * kind + 1, i]
                share = min(c / s, 1.0)  # c is positive wherever the sum is
                explained = share * (2.0 * c - share * s)
                if gathered > suspicion[v, i]:
                    suspicion[v, i] = gathered
                    shortfall[v, i] = share * (on_times[v, i] if kind == LOSS else on_times[v, i] - duration)
                statistic[v] = max(statistic[v], gathered)
                if explained > best:
                    best, blamed[v] = explained, i + 1
