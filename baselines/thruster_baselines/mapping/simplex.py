"""The linear program of thrust mapping, solved by a compiled bounded-variable simplex (Yang 2003, eqs. 1-3).

    minimise    sum_j c_j u_j + sum_k K_k |s_k|
    subject to  A u + s = T,    0 <= u <= U,

for a command T (m), an effectiveness A (m, n), longest on-times U (n), fuel costs c (n) and slack costs K
(m). The answer is a vertex, the one with fewer open thrusters among equally cheap neighbours, and depends on
the problem alone, to the last bit. How it differs from the printed program:
docs/derivations/linear_program.md.

Left out: the fewest open thrusters of all optima, coupling between thrusters
(`thruster_baselines.mapping.coupling`).
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.threads import run_shared

__all__ = [
    "NOT_CONVERGED",
    "NOT_FINITE",
    "OPTIMAL",
    "PARALLEL_FROM",
    "Programs",
    "Solutions",
    "in_threads",
    "solve_batch",
    "solve_one",
    "solve_range",
]

OPTIMAL = 0
NOT_FINITE = 1
NOT_CONVERGED = 2

PARALLEL_FROM = 512
"""Smallest batch that is shared between threads; below it, starting a thread costs more than it saves."""

OPTIMALITY = 1e-12  # smallest reduced cost worth a pivot, in units of one slack's cost
PIVOT = 1e-9  # smallest entry to pivot on; the scaled entries are of order one
TIE = 1e-13  # steps that differ by less than this share of the largest scaled command are equal
ROUND_OFF = 1e-14  # values nearer to a bound than this share of the largest scaled command are on it
PIVOTS_PER_VARIABLE = 100  # give up after so many; a half is common
LANES = 8  # float64 numbers in the widest vector register

# Rows of the working array `w` of one problem, for this package's kernels. By basic variable: its value, its
# largest value, the rate at which it falls as the entering one grows, the step to where it stops that, its
# number. By variable: where it stands, its bound, the unit that it is scaled by, what it would gain. Then the
# pivot row. From `TABLEAU` on the tableau Y = B^-1 [K A, I]; its last row is z, the reduced costs
# c_B Y_j - c_j of the thrusters and the multipliers of the slacks.
VALUE, CEILING, FALL, RATIO, BASIS, SIGN, BOUND, SCALE, GAIN, PIVOT_ROW, TABLEAU = range(11)


class Programs(NamedTuple):
    """A batch of mapping problems as kernels take them; see `solve_batch`.

    Attributes:
        command: (batch, m), m/s then rad/s.
        effectiveness: (batch, m, n), or (1, m, n) for all, m/s^2 then rad/s^2.
        max_on_time: (batch, n), or (1, n) for all, s.
        fuel_cost: (batch, n), (1, n) or (n,), per s.
        slack_cost: (m,), per m/s then per rad/s.
    """

    command: FloatArray
    effectiveness: FloatArray
    max_on_time: FloatArray
    fuel_cost: FloatArray
    slack_cost: FloatArray


class Solutions(NamedTuple):
    """Where kernels write.

    Attributes:
        on_times: (batch, n), s.
        slack: (batch, m), command units.
        cost: (batch,).
        report: (batch, 3 or 4): status, changes of basis, runs from bound to bound, linear programs.
    """

    on_times: FloatArray
    slack: FloatArray
    cost: FloatArray
    report: IntArray

    @classmethod
    def empty(cls, batch: int, axes: int, thrusters: int, programs: bool = False) -> Solutions:
        """Room for a batch; where linear programs are counted, the report begins with zeros."""
        report = np.zeros((batch, 4), np.int64) if programs else np.empty((batch, 3), np.int64)
        return cls(np.empty((batch, thrusters)), np.empty((batch, axes)), np.empty(batch), report)


def solve_batch(
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    threads: int | None = None,
) -> Solutions:
    """Solve a batch of mapping problems; arrays must be C-contiguous and writeable float64.

    Args:
        command: (batch, m), m/s then rad/s.
        effectiveness: (batch, m, n), or (1, m, n) for all, m/s^2 then rad/s^2.
        max_on_time: (batch, n), or (1, n) for all, s; not negative, may be infinite.
        fuel_cost: (batch, n), or (1, n) for all, per s; not negative.
        slack_cost: (m,), per m/s then per rad/s; not negative.
        threads: how many threads share the batch. By default as many as there are processors, if
            the batch is large enough (`PARALLEL_FROM`). The result is the same.

    Returns:
        on_times (batch, n) in s, slack (batch, m) in command units, cost (batch,) and a report (batch, 3):
        status (`OPTIMAL`, `NOT_FINITE` or `NOT_CONVERGED`; in the last two cases the other arrays are
        zero), changes of basis, and runs of a thruster from bound to bound.
    """
    batch, axes = command.shape
    answer = Solutions.empty(batch, axes, effectiveness.shape[2])
    problem = Programs(command, effectiveness, max_on_time, fuel_cost, slack_cost)
    plain = tuple(problem), tuple(answer)  # which a call from Python takes sooner than named ones
    in_threads(lambda first, last: solve_range(*plain, first, last), batch, threads)
    return answer


@kernel(nogil=True)
def solve_one(
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    on_times: FloatArray,
    slack: FloatArray,
    cost: FloatArray,
    report: IntArray,
) -> None:
    """Solve one problem, which a call from Python enters sooner than a batch of one.

    Args:
        command: (m,), m/s then rad/s.
        effectiveness: (m, n), m/s^2 then rad/s^2.
        max_on_time: (n,), s.
        fuel_cost: (n,), per s.
        slack_cost: (m,), per m/s then per rad/s.
        on_times: (n,), s, written.
        slack: (m,), written.
        cost: (1,), written.
        report: (3,), written: status, changes of basis, runs from bound to bound.
    """
    m, n = effectiveness.shape
    w = np.empty(tableau_shape(m, n))
    report[:] = 0
    magnitude = start(w, command, effectiveness, max_on_time, fuel_cost, slack_cost)
    solve_from_start(w, m, n, magnitude, report)
    cost[0] = read(
        w, magnitude, command, effectiveness, max_on_time, fuel_cost, slack_cost, report[0], on_times, slack
    )


@kernel(nogil=True)
def solve_range(problem: Programs, answer: Solutions, first: int, last: int) -> None:
    """Solve problems `first` to `last` (excluded) of a batch into the answer, both plain tuples."""
    command, effectiveness, max_on_time, fuel_cost, slack_cost = problem
    on_times, slack, cost, report = answer
    m, n = effectiveness.shape[1:]
    w = np.empty(tableau_shape(m, n))
    own_effectiveness, own_bounds = effectiveness.shape[0] > 1, max_on_time.shape[0] > 1
    own_costs = fuel_cost.shape[0] > 1
    for i in range(first, last):
        a = effectiveness[i if own_effectiveness else 0]
        b = max_on_time[i if own_bounds else 0]
        c = fuel_cost[i if own_costs else 0]
        report[i] = 0
        magnitude = start(w, command[i], a, b, c, slack_cost)
        solve_from_start(w, m, n, magnitude, report[i])
        cost[i] = read(w, magnitude, command[i], a, b, c, slack_cost, report[i, 0], on_times[i], slack[i])


@kernel(forceinline=True)
def tableau_shape(m: int, n: int) -> tuple[int, int]:
    """Shape of the working array of one problem; whole vector registers, with no remainder to loop over."""
    return TABLEAU + m + 1, (m + n + LANES - 1) // LANES * LANES


@njit(forceinline=True, error_model="numpy")
def start(
    w: FloatArray,
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
) -> float:
    """Set up the scaled tableau with every slack basic; return the largest scaled command, or NaN."""
    m, n = effectiveness.shape
    width = w.shape[1]
    z = TABLEAU + m
    for j in range(n):
        w[SCALE, j] = 0.0
    for k in range(m):
        weight = slack_cost[k]
        for j in range(n):
            w[TABLEAU + k, j] = weight * effectiveness[k, j]
            w[SCALE, j] = max(w[SCALE, j], abs(w[TABLEAU + k, j]))
    for j in range(n):
        usable = w[SCALE, j] > 0.0 and max_on_time[j] > 0.0
        w[SCALE, j] = w[SCALE, j] if usable else 1.0
        w[PIVOT_ROW, j] = 1.0 / w[SCALE, j] if usable else 0.0  # one that cannot act never enters
        w[BOUND, j] = max_on_time[j] * w[SCALE, j]
        w[SIGN, j] = 1.0
        w[z, j] = -fuel_cost[j] / w[SCALE, j] if usable else -1.0
    magnitude = 0.0
    finite = 0.0
    for k in range(m):
        demand = slack_cost[k] * command[k]
        finite += command[k] * 0.0
        side = 1.0 if demand >= 0.0 else -1.0
        w[VALUE, k] = abs(demand)
        magnitude = max(magnitude, abs(demand))
        w[CEILING, k] = np.inf
        w[BASIS, k] = n + k
        for j in range(n):
            w[TABLEAU + k, j] *= side * w[PIVOT_ROW, j]
            w[z, j] += w[TABLEAU + k, j]
        for j in range(n, width):
            w[TABLEAU + k, j] = 0.0
        w[TABLEAU + k, n + k] = side
    for j in range(n, width):
        w[z, j] = 0.0
    for k in range(m):
        w[z, n + k] = w[TABLEAU + k, n + k]
        w[SIGN, n + k] = w[TABLEAU + k, n + k]
    return magnitude + finite


@njit(forceinline=True, error_model="numpy")
def solve_from_start(w: FloatArray, m: int, n: int, magnitude: float, report: IntArray) -> None:
    """Pivot from the starting tableau to the answer; the status and the pivots are added to the report."""
    if not magnitude < np.inf:
        report[0] = NOT_FINITE
    elif magnitude > 0.0:
        report[0] = _pivot_to_optimum(w, m, n, TIE * magnitude, report)
        if report[0] == OPTIMAL:
            leave_fewer_open(w, m, n, TIE * magnitude, report)


@njit(forceinline=True, error_model="numpy")
def read(
    w: FloatArray,
    magnitude: float,
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    status: int,
    on_times: FloatArray,
    slack: FloatArray,
) -> float:
    """On-times of the final basis (round-off opens or closes no thruster), and the slack that they leave.

    Returns the cost. Without an optimum all is zero: nothing half-done is left in the answer.
    """
    m, n = effectiveness.shape
    if status != OPTIMAL:
        on_times[:] = 0.0
        slack[:] = 0.0
        return 0.0
    round_off = ROUND_OFF * magnitude
    for j in range(n):
        on_times[j] = max_on_time[j] if w[SIGN, j] < 0.0 else 0.0
    for r in range(m):
        j = int(w[BASIS, r])
        if j < n:
            if w[VALUE, r] <= round_off:
                on_times[j] = 0.0
            elif w[VALUE, r] >= w[CEILING, r] - round_off:
                on_times[j] = max_on_time[j]
            else:
                on_times[j] = min(w[VALUE, r] / w[SCALE, j], max_on_time[j])
    total = 0.0
    for j in range(n):
        total += fuel_cost[j] * on_times[j]
    for k in range(m):
        rest = command[k]
        for j in range(n):
            rest -= effectiveness[k, j] * on_times[j]
        slack[k] = rest
        total += slack_cost[k] * abs(rest)
    return total


@njit(forceinline=True, error_model="numpy")
def _pivot_to_optimum(w: FloatArray, m: int, n: int, tie: float, report: IntArray) -> int:
    """Pivot from the starting tableau to the optimal one, counting in the report; return the status.

    Variables 0..n-1 are the thrusters, n..n+m-1 the slacks. A thruster outside the basis stands at zero
    (sign 1) or at its bound (sign -1). A slack may enter with either sign.
    """
    z = TABLEAU + m
    stalled = 0
    for _ in range(PIVOTS_PER_VARIABLE * (m + n)):
        careful = stalled >= m + n
        j = _entering(w, m, n, careful)
        if j < 0:
            return OPTIMAL
        if j < n:
            direction, room = w[SIGN, j], w[BOUND, j]
        else:
            direction, room = (1.0 if w[z, j] > 0.0 else -1.0), np.inf
        p, step = _leaving(w, j, direction, m, tie, careful)
        if not min(step, room) < np.inf:
            return NOT_CONVERGED

        report[2 if room <= step else 1] += 1
        stalled = 0 if room <= step or step > tie else stalled + 1
        _move(w, m, n, j, p, direction, step, room)
    return NOT_CONVERGED


@njit(forceinline=True, error_model="numpy")
def _move(w: FloatArray, m: int, n: int, j: int, p: int, direction: float, step: float, room: float) -> None:
    """Let variable j run in its direction until row p stops it after `step`, or its own far bound at `room`.

    `FALL` has to hold at which rates the basic variables fall (`_leaving` leaves them there).
    """
    if room <= step:  # the thruster runs from one of its bounds straight to the other
        for r in range(m):
            w[VALUE, r] -= room * w[FALL, r]
        w[SIGN, j] = -direction
        return
    leaving = int(w[BASIS, p])
    if leaving < n:
        w[SIGN, leaving] = 1.0 if w[FALL, p] > 0.0 else -1.0  # leaves at zero, or at its bound
    pivot(w, m, n, j, p, direction, step)


@njit(forceinline=True, error_model="numpy")
def pivot(w: FloatArray, m: int, n: int, j: int, p: int, direction: float, step: float) -> None:
    """Take variable j, after it ran `step` in its direction, into the basis in place of the one in row p."""
    for r in range(m):
        w[VALUE, r] -= step * w[FALL, r]
    w[BASIS, p] = j
    z = TABLEAU + m
    if j < n:
        w[CEILING, p] = w[BOUND, j]
        w[VALUE, p] = step if direction > 0.0 else w[BOUND, j] - step
        w[SIGN, j] = 1.0
        for r in range(m + 1):
            w[FALL, r] = w[TABLEAU + r, j]
        _eliminate(w, p, m)
        for r in range(m + 1):
            w[TABLEAU + r, j] = 0.0
        w[TABLEAU + p, j] = 1.0
    else:
        w[CEILING, p] = np.inf
        w[VALUE, p] = step
        w[SIGN, j] = direction
        w[FALL, m] = direction * w[z, j] - 1.0
        _eliminate(w, p, m)


@njit(forceinline=True, error_model="numpy")
def leave_fewer_open(w: FloatArray, m: int, n: int, tie: float, report: IntArray) -> None:
    """Move along edges of equal cost as long as a move leaves fewer thrusters open."""
    z = TABLEAU + m
    for _ in range(n):  # each move opens one thruster less
        moved = False
        for j in range(n):
            if abs(w[z, j]) > OPTIMALITY or not w[BOUND, j] > 0.0 or _is_basic(w, m, j):
                continue
            direction, room = w[SIGN, j], w[BOUND, j]
            p, step = _leaving(w, j, direction, m, tie, False)
            way = min(step, room)
            if not tie < way < np.inf:
                continue
            change = (1 if direction > 0.0 else 0) - (0 if direction > 0.0 or way < room - tie else 1)
            for r in range(m):
                if w[BASIS, r] < n:
                    after = w[VALUE, r] - way * w[FALL, r]
                    change += (1 if after > tie else 0) - (1 if w[VALUE, r] > tie else 0)
            if change < 0:
                report[2 if room <= step else 1] += 1
                _move(w, m, n, j, p, direction, step, room)
                moved = True
                break
        if not moved:
            return


@njit(forceinline=True, error_model="numpy")
def _is_basic(w: FloatArray, m: int, j: int) -> bool:
    basic = False
    for r in range(m):
        basic |= w[BASIS, r] == j
    return basic


@njit(forceinline=True, error_model="numpy")
def _entering(w: FloatArray, m: int, n: int, careful: bool) -> int:
    """The variable that gains most per unit or (`careful`, Bland's rule) the first that gains, else -1.

    Four searches side by side, since each comparison waits for the one before.
    """
    z, width = TABLEAU + m, w.shape[1]
    for j in range(n):
        w[GAIN, j] = w[SIGN, j] * w[z, j]
    for j in range(n, width):
        w[GAIN, j] = abs(w[z, j]) - 1.0
    if careful:
        for j in range(m + n):
            if w[GAIN, j] > OPTIMALITY:
                return j
        return -1
    j0, j1, j2, j3 = 0, 1, 2, 3
    g0, g1, g2, g3 = w[GAIN, 0], w[GAIN, 1], w[GAIN, 2], w[GAIN, 3]
    for j in range(4, width, 4):
        if w[GAIN, j] > g0:
            g0, j0 = w[GAIN, j], j
        if w[GAIN, j + 1] > g1:
            g1, j1 = w[GAIN, j + 1], j + 1
        if w[GAIN, j + 2] > g2:
            g2, j2 = w[GAIN, j + 2], j + 2
        if w[GAIN, j + 3] > g3:
            g3, j3 = w[GAIN, j + 3], j + 3
    if g1 > g0:
        g0, j0 = g1, j1
    if g3 > g2:
        g2, j2 = g3, j3
    if g2 > g0:
        g0, j0 = g2, j2
    return j0 if g0 > OPTIMALITY else -1


@njit(forceinline=True, error_model="numpy")
def _leaving(w: FloatArray, j: int, direction: float, m: int, tie: float, careful: bool) -> tuple[int, float]:
    """The row whose variable stops the entering one first, and the step to there.

    Also notes at which rate each basic variable falls. Among equal steps the largest pivot is taken, or
    (`careful`, Bland's rule) the variable of lowest number.
    """
    p, step, largest = 0, np.inf, 0.0
    for r in range(m):
        fall = direction * w[TABLEAU + r, j]
        slope = abs(fall)
        way = w[VALUE, r] if fall > 0.0 else w[CEILING, r] - w[VALUE, r]
        ratio = max(way, 0.0) / slope if slope > PIVOT else np.inf
        w[FALL, r] = fall
        w[RATIO, r] = ratio
        better = ratio < step - tie or (ratio <= step + tie and slope > largest)
        p = r if better else p
        step = ratio if better else step
        largest = slope if better else largest
    if careful:
        shortest = step
        for r in range(m):
            if w[RATIO, r] <= shortest + tie and w[BASIS, r] < w[BASIS, p]:
                p, step = r, w[RATIO, r]
    return p, step


@njit(forceinline=True, error_model="numpy")
def _eliminate(w: FloatArray, p: int, m: int) -> None:
    """Pivot on row p and the column in `FALL`, reduced costs included.

    The pivot row is put aside first, since the compiler vectorises only what cannot overlap.
    """
    inverse = 1.0 / w[FALL, p]
    width = w.shape[1]
    for j in range(width):
        w[PIVOT_ROW, j] = w[TABLEAU + p, j] * inverse
    for r in range(m + 1):
        factor = w[FALL, r]
        for j in range(width):
            w[TABLEAU + r, j] -= factor * w[PIVOT_ROW, j]
    for j in range(width):
        w[TABLEAU + p, j] = w[PIVOT_ROW, j]


def in_threads(work: Callable[[int, int], object], batch: int, threads: int | None = None) -> None:
    """Call `work(first, last)` for ranges that make up a batch, at the same time if it is large.

    Args:
        work: Takes the range's ends (the last excluded); it should release the interpreter.
        batch: How many there are.
        threads: How many share them; by default as many as there are processors, from `PARALLEL_FROM` on.
    """
    if threads is None:
        threads = min(_processors(), 2 * batch // PARALLEL_FROM) if batch >= PARALLEL_FROM else 1
    if threads <= 1:
        work(0, batch)
        return
    edges = np.linspace(0, batch, threads + 1).astype(int).tolist()
    run_shared(work, list(itertools.pairwise(edges)))


def _processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
