"""The mixed-integer program of the source: all that fire lose as if they fired together all the time.

With N thrusters used in a period, each is taken to give the share g(N) of its thrust for all of its on-time
(Yang 2003, section 2.4.3):

    A U g(N) + s = T,    U_i <= bound_i use_i,    N = sum_i use_i,    use_i in {0, 1}.

As printed, that multiplies a continuous by an integer quantity. Here it is a linear program in integers, with
one w_k for each possible N = k, exactly one of which is 1, and on-times V_k for each:

    sum_k g(k) A V_k + s = T,    V_k,i <= bound_i w_k,    sum_k V_k,i <= bound_i use_i,
    sum_i use_i <= sum_k k w_k.

Solved by branch and bound (HiGHS). It overlooks that thrusters fire for different times, so it fires too
much: the slack that it gives is that of the true loss, by overlap. Kept because the source compares with it;
`ExactCompensationMapper` is exact and far faster.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import SolverMapper
from thruster_baselines.mapping.compensation import shares_of
from thruster_baselines.mapping.coupling import Coupling, delivered_rate_change
from thruster_baselines.mapping.model import Model
from thruster_envs.extras import extra
from thruster_envs.protocols import Allocation, FloatArray
from thruster_envs.spacecraft import Spacecraft, load

with extra("baselines", __name__):
    import scipy.sparse
    from scipy.optimize import Bounds, LinearConstraint, milp

__all__ = ["MILPMapper"]


class MILPMapper(SolverMapper):
    """Maps commands by the source's mixed-integer program.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period. Finite.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        coupling: Share of thrust lost per further thruster open, or a loss curve; a spacecraft's default is
            that of its feed. The source takes 0.062 here and 0.06 elsewhere.
        gap: Relative gap to the best bound at which branch and bound may stop.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    `status` is that of `scipy.optimize.milp`: 0 for the optimum.

    >>> allocation = MILPMapper("orion")([-0.01, 0, 0, 0, 0, 0])
    >>> allocation.on_times[[0, 9]].round(4).tolist()  # two thrusters: the loss is what it is taken to be
    [1.773, 1.773]
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        *,
        coupling: Coupling | None = None,
        gap: float = 1e-6,
        fuel_may_win: bool = False,
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, fuel_may_win=fuel_may_win)
        self.shares = shares_of(spacecraft, coupling, self._model)
        if not gap >= 0.0:
            raise ValueError(f"gap is {gap}; a number, zero or more, would be right")
        self.gap = gap

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        if not np.isfinite(model.max_on_time).all():
            raise ValueError(
                "max_on_time is infinite for some thruster; a finite number of s for each would be right"
            )
        found = super()._allocate(command, model)
        losses = 1.0 - self.shares[1:]
        achieved = delivered_rate_change(model.effectiveness, found.on_times, losses)
        return Allocation(found.on_times, command - achieved, found.cost, found.status)

    def _solve(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, float, int]:
        m, n = effectiveness.shape
        unit = np.abs(effectiveness).max(axis=1)  # rows of order one
        unit = 1.0 / np.where(unit > 0.0, unit, 1.0)
        rows = unit[:, np.newaxis] * effectiveness
        eye, counts = scipy.sparse.eye_array, np.arange(1.0, n + 1.0)
        ones = np.ones((1, n))
        # Variables: on-times V by count and thruster, w by count, use by thruster, slack of both signs.
        delivered = scipy.sparse.kron(self.shares[np.newaxis, 1:], rows)
        matrix = scipy.sparse.block_array(
            [
                [delivered, None, None, eye(m), -eye(m)],
                [None, ones, None, None, None],
                [eye(n * n), scipy.sparse.kron(eye(n), -max_on_time[:, np.newaxis]), None, None, None],
                [scipy.sparse.kron(ones, eye(n)), None, -scipy.sparse.diags_array(max_on_time), None, None],
                [None, -counts[np.newaxis], ones, None, None],
            ],
            format="csc",
        )
        inequalities = n * n + n + 1
        right = np.concatenate([unit * command, [1.0], np.zeros(inequalities)])
        left = np.concatenate([right[: m + 1], np.full(inequalities, -np.inf)])
        slack_cost = self._slack_cost / unit
        upper = np.concatenate([np.tile(max_on_time, n), np.ones(2 * n), np.full(2 * m, np.inf)])
        answer = milp(
            np.concatenate([np.tile(self._fuel_cost, n), np.zeros(2 * n), slack_cost, slack_cost]),
            integrality=np.concatenate([np.zeros(n * n), np.ones(2 * n), np.zeros(2 * m)]),
            bounds=Bounds(0.0, upper),
            constraints=LinearConstraint(matrix, left, right),
            options={"mip_rel_gap": self.gap},
        )
        if answer.x is None:
            return np.zeros(n), np.nan, int(answer.status) or 4
        return answer.x[: n * n].reshape(n, n).sum(axis=0), float(answer.fun), int(answer.status)
