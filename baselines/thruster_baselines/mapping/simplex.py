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

__all__ = ["NOT_CONVERGED", "NOT_FINITE", "OPTIMAL", "PARALLEL_FROM", "solve_batch", "solve_one"]

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
_SCRATCH_VECTORS = 7


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
        threading.Thread(target=_solve_range, args=(*problem, *answer, first, last))
        for first, last in itertools.pairwise(edges[1:])
    ]
    for helper in helpers:
        helper.start()
    _solve_range(*problem, *answer, edges[0], edges[1])
    for helper in helpers:
        helper.join()
    return answer


@njit(error_model="numpy", cache=True)
def solve_one(
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    on_times: FloatArray,
    slack: FloatArray,
    cost: FloatArray,
) -> int:
    """Solve one mapping problem into the given arrays and return its status, as `solve_batch` does for many.

    Args:
        command: (m,), m/s then rad/s.
        effectiveness: (m, n), m/s^2 then rad/s^2.
        max_on_time: (n,), s.
        fuel_cost: (n,), per s.
        slack_cost: (m,), per m/s then per rad/s.
        on_times: (n,), s, written.
        slack: (m,), m/s then rad/s, written.
        cost: (), written.
    """
    m, n = effectiveness.shape
    scratch, basis = _scratch(m, n)
    status = _pivot_to_optimum(
        command, effectiveness, max_on_time, fuel_cost, slack_cost, on_times, slack, scratch, basis
    )
    cost[()] = _objective(on_times, slack, fuel_cost, slack_cost)
    return status


@njit(error_model="numpy", cache=True, nogil=True)
def _solve_range(
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
    """Solve problems `first` to `last` (excluded) of a batch into the given arrays."""
    m, n = effectiveness.shape[1:]
    scratch, basis = _scratch(m, n)
    own_effectiveness = effectiveness.shape[0] > 1
    own_bounds = max_on_time.shape[0] > 1
    for i in range(first, last):
        status[i] = _pivot_to_optimum(
            command[i],
            effectiveness[i if own_effectiveness else 0],
            max_on_time[i if own_bounds else 0],
            fuel_cost,
            slack_cost,
            on_times[i],
            slack[i],
            scratch,
            basis,
        )
        cost[i] = _objective(on_times[i], slack[i], fuel_cost, slack_cost)


@njit(forceinline=True, error_model="numpy")
def _scratch(m: int, n: int) -> tuple[FloatArray, IntArray]:
    """Room for one problem: the tableau with working vectors under it, and the list of basic variables."""
    width = (m + n + _LANES - 1) // _LANES * _LANES  # whole vector registers: no remainder to loop over
    return np.empty((m + 1 + _SCRATCH_VECTORS, width)), np.empty(m, np.int64)


@njit(forceinline=True, error_model="numpy")
def _objective(u: FloatArray, s: FloatArray, c: FloatArray, K: FloatArray) -> float:
    """Fuel plus weighted slack: sum_j c_j u_j + sum_k K_k |s_k|."""
    total = 0.0
    for j in range(u.size):
        total += c[j] * u[j]
    for k in range(s.size):
        total += K[k] * abs(s[k])
    return total


@njit(forceinline=True, error_model="numpy")
def _pivot_to_optimum(
    T: FloatArray,
    A: FloatArray,
    U: FloatArray,
    c: FloatArray,
    K: FloatArray,
    u: FloatArray,
    s: FloatArray,
    scratch: FloatArray,
    basis: IntArray,
) -> int:
    """Write the optimal on-times into `u` and the slack T - A u into `s`; return the status.

    Variables 0..n-1 are the thrusters, scaled by the largest entry of their weighted column, n..n+m-1 the
    slacks, in units of their cost. Row r of the tableau Y = B^-1 [K A, I] belongs to the basic variable
    basis[r], whose value is x[r] and whose largest value is ceiling[r]. The last row z holds the reduced
    costs c_B Y_j - c_j of the thrusters and the multipliers of the slacks, which may enter with either sign
    at unit cost: worth it when |z_k| > 1. A thruster outside the basis stands at zero (sign 1) or at its
    bound (sign -1).
    """
    m, n = A.shape
    Y = scratch[: m + 1]
    z = scratch[m]
    x, ceiling, y, ratio = scratch[m + 1], scratch[m + 2], scratch[m + 3], scratch[m + 4]
    sign, bound, scale = scratch[m + 5], scratch[m + 6], scratch[m + 7]

    magnitude = _start(T, A, U, c, K, Y, z, x, ceiling, sign, bound, scale, ratio, basis)
    if not magnitude < np.inf:
        return NOT_FINITE
    tie = _TIE * magnitude
    if magnitude == 0.0:
        _read_off(T, A, U, u, s, x, ceiling, sign, scale, basis, tie)
        return OPTIMAL

    stalled = 0
    patience = m + n
    for _ in range(_PIVOTS_PER_VARIABLE * (m + n)):
        careful = stalled >= patience
        j, gain = _entering(z, sign, m, n, careful)
        if j < 0:
            _read_off(T, A, U, u, s, x, ceiling, sign, scale, basis, tie)
            return OPTIMAL
        if j < n:
            direction, room = sign[j], bound[j]
        else:
            direction, room = (1.0 if z[j] > 0.0 else -1.0), np.inf
        p, step = _leaving(Y, x, ceiling, y, ratio, basis, j, direction, m, tie, careful)
        if not min(step, room) < np.inf:
            return NOT_CONVERGED

        if room <= step:  # the thruster runs from one of its bounds straight to the other
            for r in range(m):
                x[r] -= room * y[r]
            sign[j] = -direction
            stalled = 0
            continue

        stalled = stalled + 1 if step <= tie else 0
        if basis[p] < n:
            sign[basis[p]] = 1.0 if y[p] > 0.0 else -1.0  # leaves at zero, or at its bound
        for r in range(m):
            x[r] -= step * y[r]
        basis[p] = j
        ceiling[p] = room
        if j < n:
            x[p] = step if direction > 0.0 else room - step
            for r in range(m):
                y[r] = Y[r, j]
            y[m] = z[j]
            _eliminate(Y, y, p, m + 1)
            for r in range(m + 1):
                Y[r, j] = 0.0
            Y[p, j] = 1.0
        else:
            x[p] = step
            sign[j] = direction
            y[m] = gain
            _eliminate(Y, y, p, m + 1)
    return NOT_CONVERGED


@njit(forceinline=True, error_model="numpy")
def _start(
    T: FloatArray,
    A: FloatArray,
    U: FloatArray,
    c: FloatArray,
    K: FloatArray,
    Y: FloatArray,
    z: FloatArray,
    x: FloatArray,
    ceiling: FloatArray,
    sign: FloatArray,
    bound: FloatArray,
    scale: FloatArray,
    factor: FloatArray,
    basis: IntArray,
) -> float:
    """Set up the scaled tableau, every slack basic; return the largest scaled command, NaN if not finite."""
    m, n = A.shape
    width = Y.shape[1]
    for j in range(n):
        scale[j] = 0.0
    for k in range(m):
        weight = K[k]
        for j in range(n):
            Y[k, j] = weight * A[k, j]
            scale[j] = max(scale[j], abs(Y[k, j]))
    for j in range(n):
        usable = scale[j] > 0.0 and U[j] > 0.0
        scale[j] = scale[j] if usable else 1.0
        factor[j] = 1.0 / scale[j] if usable else 0.0  # a thruster that cannot act never enters
        bound[j] = U[j] * scale[j]
        sign[j] = 1.0
        z[j] = -c[j] / scale[j] if usable else -1.0
    magnitude = 0.0
    finite = 0.0
    for k in range(m):
        demand = K[k] * T[k]
        finite += T[k] * 0.0
        side = 1.0 if demand >= 0.0 else -1.0
        x[k] = abs(demand)
        magnitude = max(magnitude, x[k])
        ceiling[k] = np.inf
        basis[k] = n + k
        for j in range(n):
            Y[k, j] *= side * factor[j]
            z[j] += Y[k, j]
        for j in range(n, width):
            Y[k, j] = 0.0
        Y[k, n + k] = side
    for j in range(n, width):
        z[j] = 0.0
    for k in range(m):
        z[n + k] = Y[k, n + k]
        sign[n + k] = Y[k, n + k]
    return magnitude + finite


@njit(forceinline=True, error_model="numpy")
def _entering(z: FloatArray, sign: FloatArray, m: int, n: int, careful: bool) -> tuple[int, float]:
    """The variable that gains most per unit or (`careful`, Bland's rule) the first that gains, else -1."""
    chosen = -1
    best = _OPTIMALITY
    if careful:
        for j in range(m + n - 1, -1, -1):
            gain = sign[j] * z[j] if j < n else abs(z[j]) - 1.0
            if gain > _OPTIMALITY:
                best = gain
                chosen = j
        return chosen, best
    for j in range(n):
        gain = sign[j] * z[j]
        if gain > best:
            best = gain
            chosen = j
    for j in range(n, m + n):
        gain = abs(z[j]) - 1.0
        if gain > best:
            best = gain
            chosen = j
    return chosen, best


@njit(forceinline=True, error_model="numpy")
def _leaving(
    Y: FloatArray,
    x: FloatArray,
    ceiling: FloatArray,
    y: FloatArray,
    ratio: FloatArray,
    basis: IntArray,
    j: int,
    direction: float,
    m: int,
    tie: float,
    careful: bool,
) -> tuple[int, float]:
    """The row whose variable stops the entering one first, and the step to there.

    Fills y, the rate at which x falls. Among equal steps the largest pivot is taken, or (`careful`, Bland's
    rule) the variable of lowest number.
    """
    shortest = np.inf
    for r in range(m):
        y[r] = direction * Y[r, j]
        slope = abs(y[r])
        way = x[r] if y[r] > 0.0 else ceiling[r] - x[r]
        ratio[r] = max(way, 0.0) / slope if slope > _PIVOT else np.inf
        shortest = min(shortest, ratio[r])
    chosen = 0
    largest = 0.0
    for r in range(m):
        if ratio[r] <= shortest + tie and abs(y[r]) > largest:
            largest = abs(y[r])
            chosen = r
    if careful:
        for r in range(m):
            if ratio[r] <= shortest + tie and (basis[r] < basis[chosen] or ratio[chosen] > shortest + tie):
                chosen = r
    return chosen, ratio[chosen]


@njit(forceinline=True, error_model="numpy")
def _eliminate(Y: FloatArray, y: FloatArray, p: int, rows: int) -> None:
    """Pivot on row p, column y: Y[p] /= y[p], then Y[r] -= y[r] Y[p] for the others."""
    inverse = 1.0 / y[p]
    width = Y.shape[1]
    for j in range(width):
        Y[p, j] *= inverse
    for r in range(rows):
        if r != p:
            factor = y[r]
            for j in range(width):
                Y[r, j] -= factor * Y[p, j]


@njit(forceinline=True, error_model="numpy")
def _read_off(
    T: FloatArray,
    A: FloatArray,
    U: FloatArray,
    u: FloatArray,
    s: FloatArray,
    x: FloatArray,
    ceiling: FloatArray,
    sign: FloatArray,
    scale: FloatArray,
    basis: IntArray,
    tie: float,
) -> None:
    """On-times of the final basis, and the slack that they leave; round-off opens or closes no thruster."""
    m, n = A.shape
    for j in range(n):
        u[j] = U[j] if sign[j] < 0.0 else 0.0
    for r in range(m):
        j = basis[r]
        if j < n:
            if x[r] <= tie:
                u[j] = 0.0
            elif x[r] >= ceiling[r] - tie:
                u[j] = U[j]
            else:
                u[j] = min(x[r] / scale[j], U[j])
    for k in range(m):
        rest = T[k]
        for j in range(n):
            rest -= A[k, j] * u[j]
        s[k] = rest


def _processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
