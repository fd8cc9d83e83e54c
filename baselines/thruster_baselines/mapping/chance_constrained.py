"""The mapper for thrusters whose effectiveness is Gaussian: each axis holds its miss with a probability.

With entries independent from thruster to thruster, of standard deviations sigma,

    worst_miss_k = |b_k - a_k x| + z sqrt(sum_j sigma_kj^2 x_j^2)

is exceeded with no more than the stated probability; the cone program is that of `ConicRobustMapper` (Yang
2003, section 3.4, names the chance constraint and leaves it). Exact for an axis that is met on average,
conservative where the mean miss is large; with `joint` all axes hold together (Bonferroni).

Left out: errors that are tied between thrusters, and that a thrust cannot be negative.
"""

from __future__ import annotations

from pathlib import Path
from statistics import NormalDist

from numpy.typing import ArrayLike

from thruster_baselines.mapping.robust_conic import ConicRobustMapper
from thruster_baselines.mapping.uncertainty import stated_spread
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ChanceConstrainedMapper"]


class ChanceConstrainedMapper(ConicRobustMapper):
    """Fires so that what each axis misses by, with a stated probability, is least bad.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2; the mean.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of `worst_miss`.
        standard_deviation: (n,) or one number, shares of the mean effectiveness, which an effectiveness that
            comes with a call has too; or (m, n), m/s^2 then rad/s^2.
        probability: With which an axis stays within its `worst_miss`.
        joint: All axes together stay within with that probability, not each by itself.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Attributes:
        probability: As stated.
        quantile: z above: how many standard deviations the miss of an axis is given.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> mapper = ChanceConstrainedMapper([[1.0]], max_on_time=5.0, standard_deviation=0.1, probability=0.95)
    >>> mapper([2.0]).worst_miss.round(4)
    array([0.392])
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        *,
        standard_deviation: ArrayLike,
        probability: float = 0.95,
        joint: bool = False,
        fuel_may_win: bool = False,
    ) -> None:
        if not 0.0 < probability < 1.0:
            raise ValueError(f"probability is {probability}; a number between 0 and 1 would be right")
        super().__init__(
            spacecraft, max_on_time, fuel_cost, slack_cost, spread=0.0, fuel_may_win=fuel_may_win
        )
        m, n = self._model.effectiveness.shape
        failure = (1.0 - probability) / (m if joint else 1)
        self.probability = probability
        self.quantile = -NormalDist().inv_cdf(0.5 * failure)
        self._spread = self.quantile * stated_spread(standard_deviation, m, n, "standard_deviation")
