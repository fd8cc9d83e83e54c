"""The robust mapper for thrusters whose errors cannot all be at their worst for an axis at once.

The row a_k of the effectiveness lies in an ellipsoid, a_k + P_k v with |v| <= 1, so that the worst miss of
axis k is |a_k x - b_k| + |P_k^T x|: a second-order cone program (Yang 2003, section 3.3, which leaves it as
future work), solved by Clarabel one command after the other, to about seven digits. Less conservative than
`RobustEffectivenessMapper`, some hundred times as slow. A status of 1 says that round-off stopped it early;
its on-times keep the bounds.

Exact for each axis with an ellipsoid of its own; conservative for what adds up over axes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import SolverMapper
from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.uncertainty import RobustAllocation, spread_at, stated_spread
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ConicRobustMapper"]

_TOLERANCE = 1e-10  # what Clarabel is asked for in gap and residuals, of a problem scaled to order one
_ACCEPTED = 1e-7  # what counts as the optimum where round-off lets it get no further


class ConicRobustMapper(SolverMapper):
    """Fires so that the worst that thrusters with ellipsoidal errors can make of it is least bad.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2; the nominal one.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of worst miss.
        spread: The half axes of each row's ellipsoid along the thrusters: (m, n) in units of the
            effectiveness; or (n,) or one number, shares of it, which an effectiveness that comes with a call
            has too.
        factors: (m, n, r), in place of `spread`: P_k of each axis, for ellipsoids that stand askew.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Raises:
        ValueError: A value that cannot be; neither `spread` nor `factors`, or both.

    >>> answer = ConicRobustMapper([[1.0, 1.0]], max_on_time=5.0, spread=0.1)([4.0])  # shared: errors average
    >>> answer.on_times.round(6), answer.worst_miss.round(6)
    (array([2., 2.]), array([0.282843]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        *,
        spread: ArrayLike | None = None,
        factors: ArrayLike | None = None,
        fuel_may_win: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, fuel_may_win=fuel_may_win)
        m, n = self._model.effectiveness.shape
        self._spread = np.zeros(n)
        self._factors: FloatArray | None = None
        if spread is not None and factors is None:
            self._spread = stated_spread(spread, m, n, "spread")
        elif factors is not None and spread is None:
            self._factors = _checked_factors(factors, m, n)
        else:
            raise ValueError(
                f"spread and factors are both {'missing' if spread is None else 'given'}; one of them would "
                "be right"
            )

    def _allocate(self, command: FloatArray, model: Model) -> RobustAllocation:
        answer = super()._allocate(command, model)
        worst_miss = np.abs(answer.slack) + self._lengths(model.effectiveness, answer.on_times)
        cost = answer.on_times @ self._fuel_cost + worst_miss @ self._slack_cost
        return RobustAllocation(
            answer.on_times, answer.slack, np.asarray(cost), answer.status, worst_miss=worst_miss
        )

    def _lengths(self, effectiveness: FloatArray, on_times: FloatArray) -> FloatArray:
        """|P_k^T x| for each axis, (..., m), in command units."""
        if self._factors is not None:
            parts = np.einsum("knr,...n->...kr", self._factors, on_times)
        else:
            parts = spread_at(effectiveness, self._spread) * on_times[..., np.newaxis, :]
        lengths: FloatArray = np.sqrt(np.square(parts).sum(axis=-1))
        return lengths

    def _ellipsoids(self, effectiveness: FloatArray) -> list[FloatArray]:
        """P_k^T of each axis, (r, n), without rows of zeros."""
        if self._factors is not None:
            ellipsoids = [factor.T for factor in self._factors]
        else:
            ellipsoids = [np.diag(row) for row in spread_at(effectiveness, self._spread)]
        return [ellipsoid[np.any(ellipsoid != 0.0, axis=1)] for ellipsoid in ellipsoids]

    def _solve(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, float, int]:
        # In units in which the rows of the effectiveness, the command and the dearest cost are of order one.
        largest = np.abs(effectiveness).max(axis=1)
        row = 1.0 / np.where(largest > 0.0, largest, 1.0)
        unit = float((row * np.abs(command)).max())  # s
        if unit == 0.0:
            return np.zeros_like(max_on_time), 0.0, 0
        on_times, status = _solve_cones(
            row * command / unit,
            row[:, np.newaxis] * effectiveness,
            [row[k] * ellipsoid for k, ellipsoid in enumerate(self._ellipsoids(effectiveness))],
            max_on_time / unit,
            self._fuel_cost,
            self._slack_cost / row,
        )
        return on_times * unit, np.nan, status  # `_allocate` works out the cost


def _checked_factors(given: ArrayLike, axes: int, thrusters: int) -> FloatArray:
    factors = np.array(given, dtype=np.float64)
    if factors.ndim != 3 or factors.shape[:2] != (axes, thrusters):
        raise ValueError(f"factors has the shape {factors.shape}; ({axes}, {thrusters}, r) would be right")
    finite = np.isfinite(factors)
    if not finite.all():
        axis, thruster, column = (int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(
            f"factors of thruster {thruster + 1} on axis {axis} is {factors[axis, thruster, column]} in "
            f"column {column}; a finite number would be right"
        )
    return factors


def _solve_cones(
    command: FloatArray,
    effectiveness: FloatArray,
    ellipsoids: list[FloatArray],
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
) -> tuple[FloatArray, int]:
    """Minimise `c x + K (s + t)` with |A x - b| <= s, |P_k^T x| <= t_k, 0 <= x <= U; x and status.

    Which bounds an on-time stands at is read off the multipliers, so that it stands there exactly.
    """
    with extra("baselines", "ConicRobustMapper"):
        import clarabel  # only here: the linear programs need no conic solver
        from scipy import sparse

    m, n = effectiveness.shape
    bounded = np.flatnonzero(np.isfinite(max_on_time))
    no_t, eye_s, eye_x = np.zeros((m, m)), np.eye(m), np.eye(n)
    wide = np.zeros((n, 2 * m))
    blocks = [
        np.hstack([effectiveness, -eye_s, no_t]),
        np.hstack([-effectiveness, -eye_s, no_t]),
        np.hstack([-eye_x, wide]),
        np.hstack([eye_x, wide])[bounded],
    ]
    limits = [command, -command, np.zeros(n), max_on_time[bounded]]
    cones = [clarabel.NonnegativeConeT(2 * m + n + bounded.size)]
    for k, ellipsoid in enumerate(ellipsoids):
        block = np.zeros((1 + len(ellipsoid), n + 2 * m))
        block[0, n + m + k] = -1.0
        block[1:, :n] = -ellipsoid
        blocks.append(block)
        limits.append(np.zeros(len(block)))
        cones.append(clarabel.SecondOrderConeT(len(block)))
    cost = np.concatenate([fuel_cost, slack_cost, slack_cost])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = settings.reduced_tol_feas = _ACCEPTED
    answer = clarabel.DefaultSolver(
        sparse.csc_matrix((cost.size, cost.size)),
        cost / max(cost.max(), np.finfo(np.float64).tiny),
        sparse.csc_matrix(np.vstack(blocks)),
        np.concatenate(limits),
        cones,
        settings,
    ).solve()
    on_times = np.array(answer.x)[:n]
    if not np.isfinite(on_times).all():
        raise RuntimeError(
            f"Clarabel stopped with {answer.status} and no on-times; effectiveness, spread, bounds and costs "
            "within 8 orders of magnitude of each other would be right"
        )
    multipliers = np.array(answer.z)
    on_times[bounded] = np.where(
        multipliers[2 * m + n : 2 * m + n + bounded.size] > max_on_time[bounded] - on_times[bounded],
        max_on_time[bounded],
        on_times[bounded],
    )
    on_times = np.where(multipliers[2 * m : 2 * m + n] > on_times, 0.0, on_times)
    optimal = answer.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return on_times, int(not optimal)
