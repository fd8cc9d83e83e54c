"""Non-negative least squares: the closest that thrusters which only push can come, with no longest on-time.

The mapper minimises |W (T - A u)| over u >= 0 by the active-set method of Lawson and Hanson (`scipy.optimize.
nnls`), with each axis in units of its largest effectiveness (the diagonal matrix W). What is longer than a
thruster's bound is then cut off, as flight software does that has a solver without bounds: a command may be
missed although other on-times would track it, and beyond the authority both size and direction are off. With
`bounded` the bounds are part of the problem, solved by the method of Stark and Parker (`scipy.optimize.
lsq_linear`, "bvls"): the closest that thrusters can come indeed.

Left out: fuel. A command that can be tracked is tracked by some vertex of the feasible set, no more thrusters
open than there are axes, but not always by the cheapest; with `bounded`, by whichever point the method meets.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import BaseMapper, one_by_one
from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.pseudo_inverse import axis_weights
from thruster_envs.extras import extra
from thruster_envs.protocols import Allocation, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["NonNegativeLeastSquaresMapper"]

_ITERATIONS = 1000  # of either method; some ten are common
_GAIN = 1e-14  # shares of the squared miss below which an iteration of the bounded method ends it
_NEGLIGIBLE = 1e-12  # shares of the longest on-time below this, from zero or from the bound, are round-off


class NonNegativeLeastSquaresMapper(BaseMapper):
    """Fires so that the weighed miss is shortest, with thrusters that push and, if `bounded`, for so long.

    `cost` is that length: s of the strongest thruster on each axis. `status` is 0, or 1 where the bounded
    method ran out of iterations.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        bounded: Heed the longest on-times while solving, instead of cutting off afterwards.

    Attributes:
        bounded: As stated.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> NonNegativeLeastSquaresMapper([[1.0, 0.8]], max_on_time=[1.0, 5.0])([3.0]).on_times.round(9)
    array([1., 0.])
    >>> NonNegativeLeastSquaresMapper([[1.0, 0.8]], [1.0, 5.0], bounded=True)([3.0]).on_times.round(9)
    array([1. , 2.5])
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        *,
        bounded: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time)
        self.bounded = bounded

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        return one_by_one(self._solve, command, model)

    def _solve(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, float, int]:
        weight = axis_weights(effectiveness)
        wanted = weight * command
        matrix = weight[:, np.newaxis] * effectiveness
        on_times, status = np.zeros_like(max_on_time), 0
        unit = float(np.abs(wanted).max())  # s; in it the problem is of order one
        usable = np.flatnonzero((max_on_time > 0.0) & np.any(matrix != 0.0, axis=0))
        if unit > 0.0 and usable.size:
            if self.bounded:
                with np.errstate(over="ignore"):  # a bound beyond all numbers is none
                    bound = max_on_time[usable] / unit
                shares, status = _bounded(matrix[:, usable], wanted / unit, bound)
            else:
                shares = _unbounded(matrix[:, usable], wanted / unit)
            on_times[usable] = _without_round_off(shares * unit, max_on_time[usable])
        return on_times, float(np.linalg.norm(wanted - matrix @ on_times)), status


def _unbounded(matrix: FloatArray, wanted: FloatArray) -> FloatArray:
    """The u >= 0 with least |A u - b|."""
    with extra("baselines", "NonNegativeLeastSquaresMapper"):
        from scipy.optimize import nnls  # only here: the linear programs need no SciPy

    try:
        solution: FloatArray = nnls(matrix, wanted, maxiter=_ITERATIONS)[0]
    except RuntimeError:
        raise RuntimeError(
            f"non-negative least squares did not end within {_ITERATIONS} iterations; columns of the "
            "effectiveness within 8 orders of magnitude of each other would be right"
        ) from None
    return solution


def _bounded(matrix: FloatArray, wanted: FloatArray, bound: FloatArray) -> tuple[FloatArray, int]:
    """The 0 <= u <= U with least |A u - b|, U positive, and a status."""
    with extra("baselines", "NonNegativeLeastSquaresMapper"):
        from scipy.optimize import lsq_linear

    answer = lsq_linear(matrix, wanted, (0.0, bound), method="bvls", tol=_GAIN, max_iter=_ITERATIONS)
    return answer.x, int(answer.status == 0)


def _without_round_off(on_times: FloatArray, max_on_time: FloatArray) -> FloatArray:
    """On-times (n,) within their bounds, and at them where all but round-off is."""
    round_off = _NEGLIGIBLE * float(on_times.max())
    closed = np.where(on_times <= round_off, 0.0, on_times)
    return np.where(closed >= max_on_time - round_off, max_on_time, closed)
