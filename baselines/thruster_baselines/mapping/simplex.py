"""The linear program of thrust mapping, solved by a compiled bounded-variable simplex.

For a command T (m), an effectiveness A (m, n), longest on-times U (n), fuel costs c (n) and slack
costs K (m):

    minimise    sum_j c_j u_j + sum_k K_k |s_k|
    subject to  A u + s = T,    0 <= u <= U                                     (Yang 2003, eqs. 1-3)

The method is the tableau simplex of Yang 2003, ch. 2 and app. A, started from the basis of all slacks,
with its defects mended: a slack may be of either sign and may come back into the basis, a thruster parked
at its bound may run back to zero, one that enters the basis from its bound keeps its true value, and every
tolerance is relative. It differs from the printed program in three ways that save time or trouble. Rows are
scaled by slack cost and columns by their largest entry, so that entries are of order one whatever the units.
Only the columns of the positive slacks are kept: those of the negative ones are their negatives. Thrusters at
their bound are priced with a sign in place of being reflected. Should the objective stand still for as many
pivots as there are variables, Bland's rule takes over, so that the method cannot cycle.

The answer is a vertex: no more thrusters than rows are open for part of the period. It depends on
the problem alone, to the last bit: not on the batch that it is solved in, nor on the number of
threads.

Left out: warm starts, equality with other solvers' choice among equally cheap vertices, and
coupling between thrusters (`thruster_baselines.control.coupling` inflates on-times for that).
"""

from __future__ import annotations

import itertools
import os
import threading

import numpy as np
from numba import njit

from thruster_envs.protocols import FloatArray, IntArray

__all__ = ["NOT_CONVERGED", "NOT_FINITE", "OPTIMAL", "PARALLEL_FROM", "solve_batch", "solve_range"]

OPTIMAL = 0
NOT_FINITE = 1
NOT_CONVERGED = 2

PARALLEL_FROM = 512
"""Smallest batch that is shared between threads; below it, starting a thread costs more than it saves."""

_OPTIMALITY = 1e-12  # smallest reduced cost worth a pivot, in units of one slack's cost
_PIVOT = 1e-9  # smallest entry to pivot on; the scaled entries are of order one
_TIE = 1e-13  # steps that differ by less than this share of the largest scaled command are equal
_PIVOTS_PER_VARIABLE = 100  # give up after so many; a half is common
_LANES = 8  # float64 numbers in the widest vector register

# Rows of the working array `w` of one problem. By basic variable: its value, its largest value, the rate at
# which it falls as the entering one grows, the step to where it stops that, its number. By variable: where it
# stands, its bound, the unit that it is scaled by, what it would gain. Then the pivot row. From `_TABLEAU` on
# the tableau Y = B^-1 [K A, I]; its last row is z, the reduced costs c_B Y_j - c_j of the thrusters and the
# multipliers of the slacks.
_VALUE, _CEILING, _FALL, _RATIO, _BASIS, _SIGN, _BOUND, _SCALE, _GAIN, _PIVOT_ROW, _TABLEAU = range(11)


def solve_batch(
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    threads: int | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Solve a batch of mapping problems; arrays must be C-contiguous and writeable float64.

    Args:
        command: (batch, m), m/s then rad/s.
        effectiveness: (batch, m, n), or (1, m, n) for all, m/s^2 then rad/s^2.
        max_on_time: (batch, n), or (1, n) for all, s; not negative, may be infinite.
        fuel_cost: (n,), per s; not negative.
        slack_cost: (m,), per m/s then per rad/s; not negative.
        threads: how many threads share the batch. By default as many as there are processors, if
            the batch is large enough (`PARALLEL_FROM`). The result is the same.

    Returns:
        on_times (batch, n) in s, slack (batch, m) in command units, cost (batch,), status (batch,):
        `OPTIMAL`, `NOT_FINITE` or `NOT_CONVERGED`, with the other three meaningless in the last two
        cases.
    """
    batch, axes = command.shape
    on_times = np.empty((batch, effectiveness.shape[2]))
    slack = np.empty((batch, axes))
    cost = np.empty(batch)
    status = np.empty(batch, np.int64)
    problem = (command, effectiveness, max_on_time, fuel_cost, slack_cost)
    answer = (on_times, slack, cost, status)
    if threads is None:
        threads = min(_processors(), 2 * batch // PARALLEL_FROM) if batch >= PARALLEL_FROM else 1
    edges = np.linspace(0, batch, max(threads, 1) + 1).astype(int).tolist()
    helpers = [
        threading.Thread(target=solve_range, args=(*problem, *answer, first, last))
        for first, last in itertools.pairwise(edges[1:])
    ]
    for helper in helpers:
        helper.start()
    solve_range(*problem, *answer, edges[0], edges[1])
    for helper in helpers:
        helper.join()
    return answer


@njit(error_model="numpy", cache=True, nogil=True)
def solve_range(
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    on_times: FloatArray,
    slack: FloatArray,
    cost: FloatArray,
    status: IntArray,
    first: int,
    last: int,
) -> None:
    """Solve problems `first` to `last` (excluded) of a batch into the given arrays; see `solve_batch`."""
    m, n = effectiveness.shape[1:]
    width = (m + n + _LANES - 1) // _LANES * _LANES  # whole vector registers: no remainder to loop over
    w = np.empty((_TABLEAU + m + 1, width))
    own_effectiveness, own_bounds = effectiveness.shape[0] > 1, max_on_time.shape[0] > 1
    for i in range(first, last):
        a = i if own_effectiveness else 0
        b = i if own_bounds else 0

        # The scaled tableau with every slack basic.
        z = _TABLEAU + m
        for j in range(n):
            w[_SCALE, j] = 0.0
        for k in range(m):
            weight = slack_cost[k]
            for j in range(n):
                w[_TABLEAU + k, j] = weight * effectiveness[a, k, j]
                w[_SCALE, j] = max(w[_SCALE, j], abs(w[_TABLEAU + k, j]))
        for j in range(n):
            usable = w[_SCALE, j] > 0.0 and max_on_time[b, j] > 0.0
            w[_SCALE, j] = w[_SCALE, j] if usable else 1.0
            w[_PIVOT_ROW, j] = 1.0 / w[_SCALE, j] if usable else 0.0  # one that cannot act never enters
            w[_BOUND, j] = max_on_time[b, j] * w[_SCALE, j]
            w[_SIGN, j] = 1.0
            w[z, j] = -fuel_cost[j] / w[_SCALE, j] if usable else -1.0
        magnitude = 0.0
        finite = 0.0
        for k in range(m):
            demand = slack_cost[k] * command[i, k]
            finite += command[i, k] * 0.0
            side = 1.0 if demand >= 0.0 else -1.0
            w[_VALUE, k] = abs(demand)
            magnitude = max(magnitude, abs(demand))
            w[_CEILING, k] = np.inf
            w[_BASIS, k] = n + k
            for j in range(n):
                w[_TABLEAU + k, j] *= side * w[_PIVOT_ROW, j]
                w[z, j] += w[_TABLEAU + k, j]
            for j in range(n, width):
                w[_TABLEAU + k, j] = 0.0
            w[_TABLEAU + k, n + k] = side
        for j in range(n, width):
            w[z, j] = 0.0
        for k in range(m):
            w[z, n + k] = w[_TABLEAU + k, n + k]
            w[_SIGN, n + k] = w[_TABLEAU + k, n + k]

        magnitude += finite
        if not magnitude < np.inf:
            status[i] = NOT_FINITE
            continue
        tie = _TIE * magnitude
        status[i] = _pivot_to_optimum(w, m, n, tie) if magnitude > 0.0 else OPTIMAL

        # On-times of the final basis (round-off opens or closes no thruster), and the slack that they leave.
        for j in range(n):
            on_times[i, j] = max_on_time[b, j] if w[_SIGN, j] < 0.0 else 0.0
        for r in range(m):
            j = int(w[_BASIS, r])
            if j < n:
                if w[_VALUE, r] <= tie:
                    on_times[i, j] = 0.0
                elif w[_VALUE, r] >= w[_CEILING, r] - tie:
                    on_times[i, j] = max_on_time[b, j]
                else:
                    on_times[i, j] = min(w[_VALUE, r] / w[_SCALE, j], max_on_time[b, j])
        total = 0.0
        for j in range(n):
            total += fuel_cost[j] * on_times[i, j]
        for k in range(m):
            rest = command[i, k]
            for j in range(n):
                rest -= effectiveness[a, k, j] * on_times[i, j]
            slack[i, k] = rest
            total += slack_cost[k] * abs(rest)
        cost[i] = total


@njit(forceinline=True, error_model="numpy")
def _pivot_to_optimum(w: FloatArray, m: int, n: int, tie: float) -> int:
    """Pivot from the starting tableau to the optimal one; return the status.

    Variables 0..n-1 are the thrusters, n..n+m-1 the slacks. A thruster outside the basis stands at zero
    (sign 1) or at its bound (sign -1). A slack may enter with either sign.
    """
    z = _TABLEAU + m
    stalled = 0
    for _ in range(_PIVOTS_PER_VARIABLE * (m + n)):
        careful = stalled >= m + n
        j = _entering(w, m, n, careful)
        if j < 0:
            return OPTIMAL
        if j < n:
            direction, room = w[_SIGN, j], w[_BOUND, j]
        else:
            direction, room = (1.0 if w[z, j] > 0.0 else -1.0), np.inf
        p, step = _leaving(w, j, direction, m, tie, careful)
        if not min(step, room) < np.inf:
            return NOT_CONVERGED

        if room <= step:  # the thruster runs from one of its bounds straight to the other
            for r in range(m):
                w[_VALUE, r] -= room * w[_FALL, r]
            w[_SIGN, j] = -direction
            stalled = 0
            continue

        stalled = stalled + 1 if step <= tie else 0
        leaving = int(w[_BASIS, p])
        if leaving < n:
            w[_SIGN, leaving] = 1.0 if w[_FALL, p] > 0.0 else -1.0  # leaves at zero, or at its bound
        for r in range(m):
            w[_VALUE, r] -= step * w[_FALL, r]
        w[_BASIS, p] = j
        w[_CEILING, p] = room
        if j < n:
            w[_VALUE, p] = step if direction > 0.0 else room - step
            for r in range(m + 1):
                w[_FALL, r] = w[_TABLEAU + r, j]
            _eliminate(w, p, m)
            for r in range(m + 1):
                w[_TABLEAU + r, j] = 0.0
            w[_TABLEAU + p, j] = 1.0
        else:
            w[_VALUE, p] = step
            w[_SIGN, j] = direction
            w[_FALL, m] = w[_GAIN, j]
            _eliminate(w, p, m)
    return NOT_CONVERGED


@njit(forceinline=True, error_model="numpy")
def _entering(w: FloatArray, m: int, n: int, careful: bool) -> int:
    """The variable that gains most per unit or (`careful`, Bland's rule) the first that gains, else -1.

    Four searches side by side, since each comparison waits for the one before.
    """
    z, width = _TABLEAU + m, w.shape[1]
    for j in range(n):
        w[_GAIN, j] = w[_SIGN, j] * w[z, j]
    for j in range(n, width):
        w[_GAIN, j] = abs(w[z, j]) - 1.0
    if careful:
        for j in range(m + n):
            if w[_GAIN, j] > _OPTIMALITY:
                return j
        return -1
    j0, j1, j2, j3 = 0, 1, 2, 3
    g0, g1, g2, g3 = w[_GAIN, 0], w[_GAIN, 1], w[_GAIN, 2], w[_GAIN, 3]
    for j in range(4, width, 4):
        if w[_GAIN, j] > g0:
            g0, j0 = w[_GAIN, j], j
        if w[_GAIN, j + 1] > g1:
            g1, j1 = w[_GAIN, j + 1], j + 1
        if w[_GAIN, j + 2] > g2:
            g2, j2 = w[_GAIN, j + 2], j + 2
        if w[_GAIN, j + 3] > g3:
            g3, j3 = w[_GAIN, j + 3], j + 3
    if g1 > g0:
        g0, j0 = g1, j1
    if g3 > g2:
        g2, j2 = g3, j3
    if g2 > g0:
        g0, j0 = g2, j2
    return j0 if g0 > _OPTIMALITY else -1


@njit(forceinline=True, error_model="numpy")
def _leaving(w: FloatArray, j: int, direction: float, m: int, tie: float, careful: bool) -> tuple[int, float]:
    """The row whose variable stops the entering one first, and the step to there.

    Also notes at which rate each basic variable falls. Among equal steps the largest pivot is taken, or
    (`careful`, Bland's rule) the variable of lowest number.
    """
    p, step, largest = 0, np.inf, 0.0
    for r in range(m):
        fall = direction * w[_TABLEAU + r, j]
        slope = abs(fall)
        way = w[_VALUE, r] if fall > 0.0 else w[_CEILING, r] - w[_VALUE, r]
        ratio = max(way, 0.0) / slope if slope > _PIVOT else np.inf
        w[_FALL, r] = fall
        w[_RATIO, r] = ratio
        better = ratio < step - tie or (ratio <= step + tie and slope > largest)
        p = r if better else p
        step = ratio if better else step
        largest = slope if better else largest
    if careful:
        shortest = step
        for r in range(m):
            if w[_RATIO, r] <= shortest + tie and w[_BASIS, r] < w[_BASIS, p]:
                p, step = r, w[_RATIO, r]
    return p, step


@njit(forceinline=True, error_model="numpy")
def _eliminate(w: FloatArray, p: int, m: int) -> None:
    """Pivot on row p and the column in `_FALL`, reduced costs included.

    The pivot row is put aside first, since the compiler vectorises only what cannot overlap.
    """
    inverse = 1.0 / w[_FALL, p]
    width = w.shape[1]
    for j in range(width):
        w[_PIVOT_ROW, j] = w[_TABLEAU + p, j] * inverse
    for r in range(m + 1):
        factor = w[_FALL, r]
        for j in range(width):
            w[_TABLEAU + r, j] -= factor * w[_PIVOT_ROW, j]
    for j in range(width):
        w[_TABLEAU + p, j] = w[_PIVOT_ROW, j]


def _processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
