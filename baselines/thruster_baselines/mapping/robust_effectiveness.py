"""The robust linear program for thrusters that do more or less than they should.

Each entry of the effectiveness lies within M - R and M + R. The objective, `fuel_cost @ on_times + slack_cost
@ worst_miss` (Yang 2003, eqs. 30-35), is that of the plain program for M with the fuel costs c_j + sum_k K_k
R_kj, since the worst miss of axis k is |M_k x - b_k| + R_k x. With `largest_miss` the dearest worst miss
counts instead of their sum (HiGHS, one command after the other).

Exact for each axis alone, conservative for what adds up over axes: a thruster that is too strong is so on all
of them. Where all err by the same share, the plain program may already be the robust one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import CompiledMapper, raise_unless_optimal
from thruster_baselines.mapping.model import Model, matrix_times_vector
from thruster_baselines.mapping.simplex import solve_batch
from thruster_baselines.mapping.uncertainty import RobustAllocation, spread_at, stated_spread
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["RobustEffectivenessMapper"]


class RobustEffectivenessMapper(CompiledMapper):
    """Fires so that the worst that inexact thrusters can make of it is least bad.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2; the nominal one.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of worst miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        relative: (n,) or one number: the largest error of each thruster as a share of its nominal
            effectiveness, up or down. An effectiveness that comes with a call has the same shares.
        lower: (m, n), m/s^2 then rad/s^2, the least that each entry may be; by default the nominal one. An
            effectiveness that comes with a call keeps the distances from nominal.
        upper: (m, n), the most that each entry may be; by default the nominal one.
        largest_miss: Let the dearest worst miss count, in place of the sum over axes.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Raises:
        ValueError: A value that cannot be; neither `relative` nor `lower` or `upper`, or both.

    >>> mapper = RobustEffectivenessMapper([[1.0, 1.0], [-1.0, 1.0]], max_on_time=5.0, relative=0.1)
    >>> answer = mapper([3.0, 1.0])
    >>> answer.on_times, answer.worst_miss.round(12)
    (array([1., 2.]), array([0.3, 0.3]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
        *,
        relative: ArrayLike | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        largest_miss: bool = False,
        fuel_may_win: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, threads, fuel_may_win=fuel_may_win)
        nominal = self._model.effectiveness
        axes, thrusters = nominal.shape
        if (relative is None) == (lower is None and upper is None):
            raise ValueError(
                "relative and lower or upper are both given; one of them would be right"
                if relative is not None
                else "relative is missing, and so are lower and upper; one of them would be right"
            )
        if relative is not None:
            if np.ndim(relative) > 1:
                raise ValueError(
                    f"relative has the shape {np.shape(relative)}; one number or ({thrusters},) "
                    "would be right"
                )
            self._shift = np.zeros_like(nominal)
            self._spread = stated_spread(relative, axes, thrusters, "relative")
        else:
            least = _limit(lower, nominal, "lower", -1.0)
            most = _limit(upper, nominal, "upper", 1.0)
            self._shift = 0.5 * (most - nominal) - 0.5 * (nominal - least)
            self._spread = 0.5 * (most - least)
        self._largest_miss = largest_miss

    def _allocate(self, command: FloatArray, model: Model) -> RobustAllocation:
        answer = super()._allocate(command, model)
        middle, spread = self._middle_and_spread(model.effectiveness)
        miss = np.abs(command - matrix_times_vector(middle, answer.on_times))
        return RobustAllocation(
            on_times=answer.on_times,
            slack=command - matrix_times_vector(model.effectiveness, answer.on_times),
            cost=answer.cost,
            status=answer.status,
            worst_miss=miss + matrix_times_vector(spread, answer.on_times),
        )

    def _run(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        middle, spread = self._middle_and_spread(effectiveness)
        if self._largest_miss:
            return self._run_largest_miss(command, middle, spread, max_on_time)
        fuel_cost = self._fuel_cost + np.einsum("k,...kj->...j", self._slack_cost, spread)
        answer = solve_batch(command, middle, max_on_time, fuel_cost, self._slack_cost, self._threads)
        raise_unless_optimal(command, answer[3])
        return answer

    def _middle_and_spread(self, effectiveness: FloatArray) -> tuple[FloatArray, FloatArray]:
        """M and R (..., m, n) of a nominal effectiveness (..., m, n)."""
        return effectiveness + self._shift, spread_at(effectiveness, self._spread)

    def _run_largest_miss(
        self, command: FloatArray, middle: FloatArray, spread: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        batch, m = command.shape
        n = middle.shape[2]
        middle = np.broadcast_to(middle, (batch, m, n))
        spread = np.broadcast_to(spread, (batch, m, n))
        max_on_time = np.broadcast_to(max_on_time, (batch, n))
        on_times = np.empty((batch, n))
        for i in range(batch):
            on_times[i] = _least_largest_miss(
                command[i], middle[i], spread[i], max_on_time[i], self._fuel_cost, self._slack_cost
            )
        slack = command - matrix_times_vector(middle, on_times)
        worst_miss = np.abs(slack) + matrix_times_vector(spread, on_times)
        cost = on_times @ self._fuel_cost + (worst_miss * self._slack_cost).max(axis=1)
        return on_times, slack, cost, np.zeros((batch, 1), np.int64)


def _limit(given: ArrayLike | None, nominal: FloatArray, name: str, side: float) -> FloatArray:
    """The least (side -1) or the most (side 1) that the entries of an effectiveness may be, (m, n)."""
    if given is None:
        return nominal
    limit = np.array(given, dtype=np.float64)
    if limit.shape != nominal.shape:
        raise ValueError(f"{name} has the shape {limit.shape}; {nominal.shape} would be right")
    valid = np.isfinite(limit) & (side * (limit - nominal) >= 0.0)
    if not valid.all():
        axis, thruster = (int(i) for i in np.argwhere(~valid)[0])
        raise ValueError(
            f"{name} of thruster {thruster + 1} on axis {axis} is {limit[axis, thruster]}; "
            f"a finite number, {'at most' if side < 0.0 else 'at least'} the effectiveness "
            f"{nominal[axis, thruster]:g}, would be right"
        )
    return limit


def _least_largest_miss(
    command: FloatArray,
    middle: FloatArray,
    spread: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
) -> FloatArray:
    """On-times (n,) that minimise `fuel_cost @ x + max_k K_k (|M_k x - b_k| + R_k x)`.

    Rows are priced and scaled so that entries are of order one, and the command so that it is one: HiGHS
    allows fixed errors.
    """
    with extra("baselines", "RobustEffectivenessMapper"):
        from scipy.optimize import linprog  # only here: the other programs need no SciPy

    largest = (slack_cost[:, np.newaxis] * (np.abs(middle) + spread)).max()
    magnitude = (slack_cost * np.abs(command)).max()
    if largest == 0.0 or magnitude == 0.0:
        return np.zeros_like(max_on_time)
    unit = magnitude / largest  # s
    price = slack_cost[:, np.newaxis] / largest
    demand = slack_cost * command / magnitude
    one = np.ones((command.size, 1))
    answer = linprog(
        np.append(fuel_cost / largest, 1.0),
        A_ub=np.block([[price * (middle + spread), -one], [price * (spread - middle), -one]]),
        b_ub=np.concatenate([demand, -demand]),
        bounds=[(0.0, bound / unit) for bound in max_on_time] + [(0.0, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if answer.status != 0:
        raise RuntimeError(
            f"HiGHS did not reach the optimum for the command {command.tolist()}: {answer.message}; "
            "effectiveness, bounds and costs within 12 orders of magnitude of each other would be right"
        )
    on_times: FloatArray = np.clip(answer.x[:-1] * unit, 0.0, max_on_time)
    return on_times
