"""The dual simplex method: a tableau that was optimal is brought to the optimum of a changed problem.

What may change is the command and the bounds, which leave the reduced costs as they are, and costs in the
direction in which no thruster becomes worth opening. Basic variables that have left their bounds are then
driven back, each by what loses least by it. A basic slack that changes its sign is reflected in place, since
it costs the same on both sides. Few pivots are needed where little has changed, often none.

Works on the tableau of `thruster_baselines.mapping.simplex`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from thruster_baselines.mapping.simplex import (
    BASIS,
    BOUND,
    CEILING,
    FALL,
    OPTIMALITY,
    PIVOT,
    SCALE,
    SIGN,
    TABLEAU,
    VALUE,
    pivot,
)
from thruster_envs.protocols import FloatArray, IntArray

__all__ = ["change_bounds", "change_costs", "repair"]

_REPAIRS_PER_VARIABLE = 2  # dual pivots after which starting anew is cheaper


@njit(forceinline=True, error_model="numpy")
def repair(
    w: FloatArray, m: int, n: int, command: FloatArray, slack_cost: FloatArray, tie: float, report: IntArray
) -> bool:
    """Bring the basis of the last command to the optimum of this one; False if that takes too long."""
    for r in range(m):
        value = 0.0
        for k in range(m):
            value += w[TABLEAU + r, n + k] * (slack_cost[k] * command[k])
        w[VALUE, r] = value
    for j in range(n):
        if w[SIGN, j] < 0.0:  # at its bound, and so outside the basis
            for r in range(m):
                w[VALUE, r] -= w[TABLEAU + r, j] * w[BOUND, j]
    for _ in range(_REPAIRS_PER_VARIABLE * (m + n)):
        p, worst = -1, tie
        for r in range(m):
            outside = max(-w[VALUE, r], w[VALUE, r] - w[CEILING, r])
            if outside > worst:
                p, worst = r, outside
        if p < 0:
            return True
        if not worst < np.inf:
            return False
        report[1] += 1
        _dual_pivot(w, m, n, p)
    return False


@njit(forceinline=True, error_model="numpy")
def _dual_pivot(w: FloatArray, m: int, n: int, p: int) -> None:
    """Drive the basic variable of row p to the bound that it has passed, by what loses least by it."""
    z = TABLEAU + m
    leaving = int(w[BASIS, p])
    below = w[VALUE, p] < 0.0
    target = 0.0 if below else w[CEILING, p]
    want = -1.0 if below else 1.0
    entering, direction, least, largest = -1, 1.0, np.inf, 0.0
    for j in range(n + m):
        rate = want * w[TABLEAU + p, j]
        if j < n:
            side = w[SIGN, j]
            rate *= side
            loss = -side * w[z, j]
            if j == leaving or not rate > PIVOT or w[BOUND, j] == 0.0:
                continue
        else:
            side = 1.0 if rate > 0.0 else -1.0
            rate = abs(rate)
            loss = 1.0 - side * w[z, j]
            if not rate > PIVOT:
                continue
        ratio = max(loss, 0.0) / rate
        if ratio < least or (ratio == least and rate > largest):
            entering, direction, least, largest = j, side, ratio, rate
    if entering == leaving:  # a slack changes its sign
        for j in range(w.shape[1]):
            w[z, j] -= 2.0 * w[TABLEAU + p, j]
            w[TABLEAU + p, j] = -w[TABLEAU + p, j]
        w[VALUE, p] = -w[VALUE, p]
        w[SIGN, leaving] = -w[SIGN, leaving]
        return
    for r in range(m):
        w[FALL, r] = direction * w[TABLEAU + r, entering]
    step = (w[VALUE, p] - target) / w[FALL, p]
    if leaving < n:
        w[SIGN, leaving] = 1.0 if below else -1.0
    pivot(w, m, n, entering, p, direction, step)


@njit(forceinline=True, error_model="numpy")
def change_bounds(w: FloatArray, m: int, n: int, bounds: FloatArray) -> None:
    """Put other longest on-times (n,), s, in the tableau; `repair` has to follow."""
    for j in range(n):
        w[BOUND, j] = bounds[j] * w[SCALE, j]
    for r in range(m):
        j = int(w[BASIS, r])
        if j < n:
            w[CEILING, r] = w[BOUND, j]


@njit(forceinline=True, error_model="numpy")
def change_costs(w: FloatArray, m: int, n: int, before: FloatArray, after: FloatArray) -> bool:
    """Put other fuel costs (n,), per s, in the tableau; False if some thruster has become worth opening."""
    z = TABLEAU + m
    for j in range(n):
        w[z, j] += (before[j] - after[j]) / w[SCALE, j]
    for r in range(m):
        basic = int(w[BASIS, r])
        if basic < n and before[basic] != after[basic]:
            dearer = (after[basic] - before[basic]) / w[SCALE, basic]
            for j in range(w.shape[1]):
                w[z, j] += dearer * w[TABLEAU + r, j]
    worth = False
    for j in range(n):
        worth |= w[SIGN, j] * w[z, j] > OPTIMALITY
    for k in range(n, n + m):
        worth |= abs(w[z, k]) > 1.0 + OPTIMALITY
    return not worth
