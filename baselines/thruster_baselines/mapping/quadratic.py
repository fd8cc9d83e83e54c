"""The quadratic mapper: least squares of miss and of firing, with on-times that stay within their bounds.

It minimises

    sum_k (slack_cost_k slack_k)^2 + sum_j (fuel_cost_j u_j)^2    over    0 <= u <= max_on_time

(control allocation by quadratic programming: Härkegård 2002), with DAQP, a dual active-set solver for small
dense problems. The squares make the answer unique and a continuous function of the command, where a linear
program may jump between vertices that are equally cheap. The price is that more thrusters are open, and that
a command is never quite met: a share of about (fuel / miss)^2 of it, in the costs of a thruster's firing and
of missing what it does, is left. Beyond the authority the miss is shared out among axes.

Left out: what fuel costs in proportion. The squares spread firing over thrusters; they do not save it.
"""

from __future__ import annotations

import numpy as np

from thruster_baselines.mapping.base import SolverMapper
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray

__all__ = ["QuadraticMapper"]

_FEASIBILITY = 1e-12  # what DAQP may leave of a bound, of a problem scaled to order one
_STANDSTILL = 1e-12  # where its proximal steps, taken if firing costs nothing, are at their end
_OPTIMAL = 1  # DAQP's exit flag


class QuadraticMapper(SolverMapper):
    """Maps commanded rate changes to on-times by a quadratic program, one after the other.

    `cost` is the sum above. `status` is 0 for the optimum, otherwise DAQP's exit flag: -2 where it cycled, -4
    where it ran out of iterations.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing, squared with it; raise an entry to spare that
            thruster. At zero the least miss alone counts, and the on-times are no longer unique.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss, squared with it.
        fuel_may_win: Accept costs at which, in proportion, leaving an axis alone is cheaper than serving it.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> QuadraticMapper([[1.0, 1.0]], max_on_time=5.0, slack_cost=10.0)([3.0]).on_times.round(4)
    array([1.4925, 1.4925])
    """

    def _solve(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, float, int]:
        matrix = self._slack_cost[:, np.newaxis] * effectiveness
        wanted = self._slack_cost * command
        on_times, status = np.zeros_like(max_on_time), 0
        usable = np.flatnonzero((max_on_time > 0.0) & np.any(matrix != 0.0, axis=0))
        if wanted.any() and usable.size:
            on_times[usable], status = _solve_quadratic(
                matrix[:, usable], wanted, self._fuel_cost[usable], max_on_time[usable]
            )
        miss = wanted - matrix @ on_times
        return on_times, float(miss @ miss + np.square(self._fuel_cost * on_times).sum()), status


def _solve_quadratic(
    matrix: FloatArray, wanted: FloatArray, fuel_cost: FloatArray, max_on_time: FloatArray
) -> tuple[FloatArray, int]:
    """Minimise |M u - d|^2 + |c u|^2 over 0 <= u <= U; u and status.

    Which bounds an on-time stands at is read off the multipliers, so that it stands there exactly.
    """
    with extra("baselines", "QuadraticMapper"):
        import daqp  # only here: the linear programs need no quadratic solver

    size = float(np.abs(matrix).max())
    unit = float(np.abs(wanted).max()) / size  # s; in it, with costs in `size`, all is of order one
    scaled = matrix / size
    hessian = scaled.T @ scaled + np.diag(np.square(fuel_cost / size))
    with np.errstate(over="ignore"):  # a bound beyond all numbers is none
        bound = max_on_time / unit
    shares, _, flag, information = daqp.solve(
        hessian,
        -scaled.T @ (wanted / (size * unit)),
        np.empty((0, fuel_cost.size)),
        bound,
        np.zeros(fuel_cost.size),
        primal_tol=_FEASIBILITY,
        eta_prox=_STANDSTILL,
    )
    multipliers = np.asarray(information["lam"])
    on_times = np.where(multipliers > 0.0, max_on_time, np.where(multipliers < 0.0, 0.0, shares * unit))
    return np.nan_to_num(on_times, nan=0.0), 0 if flag == _OPTIMAL else int(flag)
