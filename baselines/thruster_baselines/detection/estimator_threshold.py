"""A threshold on the estimate: a thruster that seems to have lost more than a share of its thrust is blamed.

The statistic of a thruster is the share that the filter's estimate of its column has lost against what is
believed of it, measured along that column with each axis in units of the strongest thruster on it; the source
blames below 80 % or 60 % of nominal (Yang 2003, section 5.2.1).

Two tuning knobs: the threshold on the lost share, and how fast the filter follows, the ratio of its process
noise to its measurement noise. With the source's 0.01 to 10 a dead thruster fired alone for a second at a
time is found after 21 firings, and healthy ones hardly move; a faster filter is noisier.

Left out: more thrust than expected, and thrust without command, which a shortfall of this kind never shows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.calibration import rate_per_interval
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.healthy_limits import FALSE_ALARMS, HealthyLimits, LimitedDetector
from thruster_baselines.detection.interval import Interval, Scores
from thruster_baselines.detection.settings import FilterSettings
from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["SOURCE_LOST_SHARE", "EstimatorThreshold"]

SOURCE_LOST_SHARE = 0.2
"""Below 80 % of nominal the source blames a thruster (Yang 2003, section 5.2.1)."""


class EstimatorThreshold(LimitedDetector):
    """Blames a thruster whose estimated effectiveness has fallen too far.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of the lost share: 0.2 blames below 80 % of what is believed. By default 0.2, or what
            healthy vehicles exceed at the rate `false_alarms` (`limit`) where that is more.
        false_alarms: Rate per interval, if no threshold is given.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        limit: (vehicles,), what the largest lost share had to exceed in the last interval.

    Raises:
        ValueError: A value that cannot be, or a filter that never learns. No threshold where none follows: a
            filter that is not of the form `shared`, or, in `update`, an effectiveness matrix.

    >>> detector = EstimatorThreshold("orion", coupling=0.0)
    >>> one = np.eye(12)[2]
    >>> firings = 1
    >>> while not detector.update(one, np.zeros(6), duration=1.0).detected[0]:
    ...     firings += 1
    >>> firings
    21
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float | None = None,
        *,
        false_alarms: float = FALSE_ALARMS,
        **settings: Unpack[FilterSettings],
    ) -> None:
        super().__init__(spacecraft, threshold, SOURCE_LOST_SHARE, false_alarms=false_alarms, **settings)
        if self.filter.form == "known":
            raise ValueError(
                "process_noise and initial_covariance are 0, so that the estimate never moves; a positive "
                "variance would be right"
            )

    @classmethod
    def for_vehicle(
        cls,
        spacecraft: Spacecraft | str | Path,
        false_alarms: float = FALSE_ALARMS,
        duration: float | None = None,
        **arguments: Any,
    ) -> Self:
        """See `BaseDetector.for_vehicle`: the limit follows from interval to interval, as by default."""
        craft = load(spacecraft) if isinstance(spacecraft, str | Path) else spacecraft
        period = craft.control_period
        rate = rate_per_interval(false_alarms, period if duration is None else duration, period)
        return cls(craft, false_alarms=rate, **arguments)

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        _lost_shares(self.filter.effectiveness, self._believed, tuple(interval), tuple(scores))
        return self._answer(scores, self._limits_of(interval))

    def _healthy_limit(self, healthy: HealthyLimits, interval: Interval) -> FloatArray:
        largest = np.abs(self._believed).max(axis=2)
        scale = np.zeros((*largest.shape, largest.shape[1]))
        axes = np.arange(largest.shape[1])
        scale[:, axes, axes] = np.where(largest > 0.0, largest**2, 1.0)
        return healthy.of_lost_share(
            interval.on_times, scale, self._believed, interval.valid, self._unmodelled
        )


@kernel(nogil=True)
def _lost_shares(estimate: FloatArray, believed: FloatArray, interval: Interval, scores: Scores) -> None:
    interval = Interval(*interval)
    statistic, blamed, lost, shortfall = scores
    m, n = estimate.shape[1:]
    weight = np.empty(m)
    for v in range(estimate.shape[0]):
        if not interval.valid[v]:
            continue
        for k in range(m):
            largest = 0.0
            for i in range(n):
                largest = max(largest, abs(believed[v, k, i]))
            weight[k] = 1.0 / largest**2 if largest > 0.0 else 0.0
        for i in range(n):
            if interval.excluded[v, i]:
                continue
            along, square = 0.0, 0.0
            for k in range(m):
                along += weight[k] * believed[v, k, i] * (believed[v, k, i] - estimate[v, k, i])
                square += weight[k] * believed[v, k, i] ** 2
            lost[v, i] = max(along / square, 0.0)
            shortfall[v, i] = lost[v, i] * interval.on_times[v, i]
            if lost[v, i] > statistic[v]:
                statistic[v] = lost[v, i]
                blamed[v] = i + 1
