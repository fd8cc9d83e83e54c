"""The generalised likelihood ratio test: whose lost or extra firing explains the residual best.

With the column a_i of the effectiveness, the residual e of one interval and its covariance Y, thruster i has
lost or added nu_i seconds of firing (Yang 2003, eqs. 67-71; eq. 83 prints S_i without the inverse):

    chi_i = a_i' Y^-1 e,   S_i = a_i' Y^-1 a_i,   nu_i = chi_i / S_i,   l_i = chi_i^2 / S_i.

The thruster with the largest l_i is isolated if that exceeds the threshold: by default what healthy vehicles
exceed at a stated rate, interval by interval (`healthy_limits`). The source's noise and its threshold of
5.5e-5, which belongs to Orion and to 1 s, are the preset `GLRDetector.yang2003`. The default knows of errors
of zero mean only: with `PhysicalNoise` a bias of one standard deviation of Orion's sensors gives 0.04 %
alarms and one of three 5.7 % (0.1 % and 19 % where nothing fires); with the source's noise neither gives any.
l_i does not see the sign of nu_i, so that thrusters of like force and opposite torque (1 and 10 of Orion) are
hardly told apart; `sign_gate` helps.

Left out: faults that show over several intervals only (`WindowedGLR`), several new faults at once, faults
that turn a thrust.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.calibration import chi_squared_threshold
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.healthy_limits import FALSE_ALARMS, HealthyLimits, LimitedDetector
from thruster_baselines.detection.interval import Interval, Scores, whiten
from thruster_baselines.detection.settings import SOURCE_MEASUREMENT_NOISE, FilterSettings
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["SOURCE_THRESHOLD", "GLRDetector"]

SOURCE_THRESHOLD = 5.5e-5
"""What the source selected for Orion with R = 10 and intervals of 1 s (Yang 2003, section 6.4.2)."""


_ORION_REACH = 0.30675315809295267
"""What the strongest thruster of Orion does to the rates in a control period, m/s and rad/s in one number."""


class GLRDetector(LimitedDetector):
    """Blames, interval by interval, the thruster whose lost or extra firing is the likeliest.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: Of l, dimensionless; by default what healthy vehicles exceed at the rate `false_alarms`.
            With `PhysicalNoise` that is a quantile of chi-squared, and with the noise as one number it grows
            with what fired (`limit`).
        false_alarms: Rate per interval, if no threshold is given.
        sign_gate: Do not suspect a thruster of firing less than it was told if it was told nothing, nor of
            firing more if it was told to fire for the whole interval.
        settings: Of the filter and of the feed; see `FilterSettings`. The noise of a description is its own,
            `PhysicalNoise`, by default; the source's is the preset `yang2003`.

    Attributes:
        limit: (vehicles,), what l had to exceed in the last interval.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right. No threshold where
            none follows: a filter that learns by axis, or, in `update`, an effectiveness matrix.

    >>> detector = GLRDetector("orion", coupling=0.0)
    >>> on_times = np.zeros(12)
    >>> on_times[[0, 5, 9, 11]] = 1.0
    >>> gave_nothing = on_times * (np.arange(12) != 0)
    >>> diagnosis = detector.update(on_times, detector.filter.effectiveness[0] @ gave_nothing, duration=1.0)
    >>> diagnosis.thruster, diagnosis.shortfall[0, 0].round(9)
    (array([1]), np.float64(1.0))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float | None = None,
        *,
        false_alarms: float = FALSE_ALARMS,
        sign_gate: bool = False,
        **settings: Unpack[FilterSettings],
    ) -> None:
        self.sign_gate = sign_gate
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        if isinstance(spacecraft, Spacecraft):
            settings.setdefault("noise", PhysicalNoise(spacecraft))
        noise = settings.get("noise", SOURCE_MEASUREMENT_NOISE)
        if threshold is None and isinstance(noise, PhysicalNoise):
            threshold = chi_squared_threshold(false_alarms, tests=noise.effectiveness.shape[1])
        super().__init__(
            spacecraft, threshold, _least(spacecraft, noise), false_alarms=false_alarms, **settings
        )  # fmt: skip

    @classmethod
    def yang2003(
        cls,
        spacecraft: Spacecraft | str | Path | ArrayLike = "orion",
        threshold: float | None = None,
        **arguments: Any,
    ) -> Self:
        """The test of the source: R = 10 on all axes, Q = 0.01 and, unless another is given, its threshold.

        Without a threshold it grows with what fired from the source's 5.5e-5 for Orion on (`limit`), and in
        proportion for other vehicles.

        Args:
            spacecraft: As of the class.
            threshold: Of l, dimensionless; `SOURCE_THRESHOLD` is the source's for intervals of 1 s.
            arguments: Of the class.
        """
        return cls(spacecraft, threshold, **({"noise": SOURCE_MEASUREMENT_NOISE} | arguments))

    @classmethod
    def _closed_form(cls, spacecraft: Spacecraft, rate: float, /, **_: Any) -> float | None:
        """Chi-squared, once for each thruster."""
        return chi_squared_threshold(rate, tests=spacecraft.number_of_thrusters)

    def _diagnose(self, interval: Interval) -> Verdict:
        scores = Scores.of(interval)
        in_threads(partial(_ratios, tuple(interval), self.sign_gate, tuple(scores)), len(scores.statistic))
        return self._answer(scores, self._limits_of(interval))

    def _healthy_limit(self, healthy: HealthyLimits, interval: Interval) -> FloatArray:
        return healthy.of_ratio(
            interval.on_times, interval.covariance, interval.effectiveness, interval.valid, self.threshold,
            self._unmodelled,
        )  # fmt: skip


def _least(spacecraft: Spacecraft | ArrayLike, noise: PhysicalNoise | ArrayLike) -> float:
    """The source's threshold, as much smaller or larger as what a thruster does in a control period."""
    if not isinstance(spacecraft, Spacecraft) or isinstance(noise, PhysicalNoise):
        return 0.0
    if not np.array_equal(noise, SOURCE_MEASUREMENT_NOISE):
        return 0.0
    reach = spacecraft.control_period * np.linalg.norm(spacecraft.effectiveness(), axis=0).max()
    return float(SOURCE_THRESHOLD * (reach / _ORION_REACH) ** 2)


@kernel(nogil=True)
def _ratios(interval: Interval, sign_gate: bool, scores: Scores, first: int, last: int) -> None:
    interval = Interval(*interval)
    commanded, duration, effectiveness = interval.commanded, interval.duration, interval.effectiveness
    statistic, blamed, ratio, shortfall = scores
    m, n = effectiveness.shape[1:]
    root, e, a = np.empty((m, m)), np.empty(m), np.empty((m, n))
    chi, size = np.empty(n), np.empty(n)
    for v in range(first, last):
        if not interval.valid[v]:
            continue
        whiten(interval.covariance[v], interval.residual[v], effectiveness[v], root, e, a)
        for i in range(n):
            chi[i] = size[i] = 0.0
        for k in range(m):
            for i in range(n):
                chi[i] += a[k, i] * e[k]
                size[i] += a[k, i] * a[k, i]
        for i in range(n):
            if interval.excluded[v, i] or size[i] == 0.0:
                continue
            seconds = chi[i] / size[i]
            shortfall[v, i] = -seconds
            if sign_gate and (
                (seconds < 0.0 and commanded[v, i] == 0.0) or (seconds > 0.0 and commanded[v, i] >= duration)
            ):
                continue
            ratio[v, i] = chi[i] * seconds
            if ratio[v, i] > statistic[v]:
                statistic[v] = ratio[v, i]
                blamed[v] = i + 1
