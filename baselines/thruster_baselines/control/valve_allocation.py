"""Open rates for wrenches from thrusters of which some deliver more, or less, than they are told.

By what is believed of it (`thruster_baselines.belief.ActuatorBelief`), each thruster delivers something
between two bounds, and to allocate a wrench w is to find rates v between them with W v = w
(`ValveAllocation`):

1. if there are such, those next to the minimum-norm answer raised by one and the same rate for all, so far
   that none falls below an idle rate;
2. otherwise those that give the torque exactly and come nearest to the force;
3. otherwise those that come nearest to the torque, each axis by its own authority, and then to the force.

The first case has a closed form where that meets the bounds; the rest are small quadratic programs (DAQP).
How much authority bounds leave is measured by the largest ball of wrenches that they allow
(`authority_left`): eight thrusters that just suffice for six directions lose it all when one of them is
closed, and keep some when it is stuck half open.

Left out: the shared feed, the shortest pulse, thrusters that are slow, and the time that a pulse takes.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.mapping.model import require_command_shape, require_finite_command
from thruster_envs.configuration import require
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray

__all__ = ["ValveAllocation", "ValveBelief", "authority_left"]

ValveBelief = ActuatorBelief
"""The name of before; to go after one version."""

_ROUND_OFF = 1e-9  # open rates over a bound by less than this are within it
_OPTIMAL = 1  # DAQP's exit flag
_IDLE_WEIGHT = 1e-9  # of the square of an open rate's distance from its preference, beside that of a miss
_TORQUE_WEIGHT = 1e4  # of the square of a missed torque, beside that of a missed force
_DEGENERATE = 1e-9  # singular values below this share of the largest are none


def authority_left(wrenches: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Radius of the largest ball of wrenches about none that thrusters can give, each axis by its authority.

    The authority of an axis is the largest wrench about or along it alone that the thrusters of a vehicle in
    balance can give: half of the sum of what each gives at most. The wrenches that bounds allow are a
    zonotope; the nearest of its facets is found among those that any m - 1 of its n generators span.

    Args:
        wrenches: (m, n), of thrusters that are fully open.
        lower: (n,), least open rate that each delivers.
        upper: (n,), most.

    Returns:
        Zero, or less, if not even no wrench can be given in the middle of others.

    >>> authority_left([[1.0, -1.0]], [0.0, 0.0], [1.0, 1.0])
    1.0
    >>> authority_left([[1.0, -1.0]], [0.0, 0.2], [1.0, 1.0])  # the second one leaks
    0.8
    """
    given = np.asarray(wrenches, np.float64)
    size = 0.5 * np.abs(given).sum(axis=1, keepdims=True)
    columns = given / np.maximum(size, np.finfo(np.float64).tiny)
    least, most = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    moving = np.flatnonzero(most - least > _ROUND_OFF)
    axes = given.shape[0]
    if moving.size == 0 or np.linalg.matrix_rank(columns[:, moving], tol=_DEGENERATE) < axes:
        return 0.0
    nearest = np.inf
    for chosen in combinations(moving, axes - 1):
        normals, sizes, _ = np.linalg.svd(columns[:, chosen])
        if axes > 1 and sizes[-1] < _DEGENERATE * sizes[0]:
            continue  # these span no facet
        along = normals[:, -1] @ columns
        for side in (along, -along):
            nearest = min(nearest, float(np.maximum(side * least, side * most).sum()))
    return nearest


class ValveAllocation:
    """Maps wrenches to the open rates that thrusters between bounds have to deliver.

    Args:
        wrenches: (6, n), N and N m, of thrusters that are fully open: `Spacecraft.wrenches()`.

    >>> from thruster_envs.spacecraft import load
    >>> chaser = load("msr_chaser")
    >>> belief = ActuatorBelief.healthy(1, 8)
    >>> belief.blame(0, 3, "stuck_on", 0.4, period=chaser.control_period)
    >>> wrench = [[3.0, 0.0, 0.0, 0.5, 0.0, 0.0]]
    >>> rates = ValveAllocation(chaser.wrenches())(wrench, belief.lower, belief.upper)
    >>> (chaser.wrenches() @ rates[0]).round(6) + 0.0, float(rates[0, 2])
    (array([3. , 0. , 0. , 0.5, 0. , 0. ]), 0.4)
    """

    def __init__(self, wrenches: ArrayLike) -> None:
        self.wrenches: FloatArray = np.array(wrenches, np.float64)
        require(
            self.wrenches.ndim == 2 and self.wrenches.shape[0] == 6,
            "wrenches: shape",
            self.wrenches.shape,
            "(6, n)",
        )
        self.inverse: FloatArray = np.asarray(np.linalg.pinv(self.wrenches), np.float64)
        self._n = self.wrenches.shape[1]
        self._null = _null_space(self.wrenches)
        self._together: FloatArray = self._null @ self._null.sum(axis=0)  # what of all of them does nothing
        size = np.maximum(0.5 * np.abs(self.wrenches).sum(axis=1), np.finfo(np.float64).tiny)
        self._force = self.wrenches[:3] / size[:3].max()  # of the same unit on all axes: nearest in N
        self._force_size = float(size[:3].max())
        torque = self.wrenches[3:]
        self._torque_inverse: FloatArray = np.asarray(np.linalg.pinv(torque), np.float64)
        self._free = _null_space(torque)  # what turns nothing
        pushed = self._force @ self._free
        self._free_hessian = pushed.T @ pushed + _IDLE_WEIGHT * np.eye(self._free.shape[1])
        self._torque, self._torque_size = torque / size[3:, np.newaxis], size[3:]
        self._hessian = (
            self._force.T @ self._force
            + _TORQUE_WEIGHT * self._torque.T @ self._torque
            + _IDLE_WEIGHT * np.eye(self._n)
        )

    def __call__(
        self, wrench: ArrayLike, lower: ArrayLike, upper: ArrayLike, *, idle: ArrayLike = 0.1
    ) -> FloatArray:
        """(vehicles, n) open rates, of sound thrusters, for wrenches (vehicles, 6), N and N m, body axes.

        Args:
            wrench: (vehicles, 6).
            lower: (vehicles, n), least that each thruster delivers.
            upper: (vehicles, n), most; where it is the same, nothing is left to choose.
            idle: Open rate below which none falls without need: one number, or (vehicles, 1).

        Raises:
            ValueError: A wrench that is no number; bounds of a wrong shape, or crossed.
        """
        wanted = np.asarray(wrench, np.float64)
        require(wanted.ndim == 2, "wrench: shape", wanted.shape, "(vehicles, 6)")
        require_command_shape(wanted, 6)
        require_finite_command(wanted)
        least, most = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
        shape = wanted.shape[0], self._n
        for name, bound in (("lower", least), ("upper", most)):
            require(bound.shape == shape, f"{name}: shape", bound.shape, str(shape))
        if not (least <= most).all():
            vehicle, thruster = np.argwhere(~(least <= most))[0]
            raise ValueError(
                f"lower is {least[vehicle, thruster]} of vehicle {vehicle}, thruster {thruster + 1}; no more "
                f"than upper, which is {most[vehicle, thruster]}, would be right"
            )
        smallest = wanted @ self.inverse.T
        raised = np.asarray(idle, np.float64) - smallest.min(axis=1, keepdims=True)
        rates = smallest + np.maximum(raised, 0.0) * self._together
        outside = ((rates < least - _ROUND_OFF) | (rates > most + _ROUND_OFF)).any(axis=1)
        for vehicle in np.flatnonzero(outside):
            rates[vehicle] = self._within(wanted[vehicle], rates[vehicle], least[vehicle], most[vehicle])
        return np.asarray(np.clip(rates, least, most))

    def _within(
        self, wanted: FloatArray, rates: FloatArray, least: FloatArray, most: FloatArray
    ) -> FloatArray:
        """(n,) rates within their bounds; `rates` (n,) are those of the first choice without bounds."""
        first = _nearest(
            np.eye(self._null.shape[1]), np.zeros(self._null.shape[1]), self._null, rates, least, most
        )
        if first is not None:
            return first
        turning = self._torque_inverse @ wanted[3:]
        turning += self._free @ (self._free.T @ (rates - turning))
        missed = self._force @ turning - wanted[:3] / self._force_size
        second = _nearest(
            self._free_hessian, (self._force @ self._free).T @ missed, self._free, turning, least, most
        )
        if second is not None:
            return second
        gradient = self._force.T @ (self._force @ rates - wanted[:3] / self._force_size)
        gradient += _TORQUE_WEIGHT * self._torque.T @ (self._torque @ rates - wanted[3:] / self._torque_size)
        third = _nearest(self._hessian, gradient, np.eye(self._n), rates, least, most)
        return np.clip(rates, least, most) if third is None else third


def _nearest(
    hessian: FloatArray,
    gradient: FloatArray,
    directions: FloatArray,
    start: FloatArray,
    least: FloatArray,
    most: FloatArray,
) -> FloatArray | None:
    """`start + directions z` within bounds with the least z H z / 2 + g z; None if there are none."""
    if directions.shape[1] == 0:
        within = (start >= least - _ROUND_OFF) & (start <= most + _ROUND_OFF)
        return start if within.all() else None
    with extra("baselines", "ValveAllocation"):
        import daqp  # only here: sound thrusters need no solver

    steps, _, flag, _ = daqp.solve(
        hessian, gradient, np.ascontiguousarray(directions), most - start, least - start,
        np.zeros(start.size, np.int32),
    )  # fmt: skip
    return None if flag != _OPTIMAL else start + directions @ steps


def _null_space(matrix: FloatArray) -> FloatArray:
    """(n, k), orthonormal: what a matrix makes nothing of."""
    _, sizes, rows = np.linalg.svd(matrix)
    rank = int((sizes > _DEGENERATE * sizes[0]).sum())
    return np.ascontiguousarray(rows[rank:].T)
