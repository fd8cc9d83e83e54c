"""Thrusters with a shortest pulse: the pulses that miss a command least, found exactly.

An on-time is zero, or from the minimum pulse to the longest one, on a grid of clock ticks if a resolution is
given. The objective is that of the linear program (Yang 2003, eqs. 1-3, without pulses), minimised by branch
and bound with the dual simplex method: docs/derivations/minimum_pulse.md. At the default costs opposed
thrusters open together to give less than one pulse; to spare that fuel, lower `slack_cost` (with
`fuel_may_win`), or carry short pulses over (`carrying`, `truncating`).

Left out: a shortest time between two pulses, rise and fall, coupling between thrusters, and a stated choice
among equally good pulses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import CompiledMapper, raise_unless_optimal
from thruster_baselines.mapping.compensation import rate_change, settle
from thruster_baselines.mapping.dual import change_bounds, repair
from thruster_baselines.mapping.sequence import REFRESH, lower_bound
from thruster_baselines.mapping.simplex import (
    BOUND,
    NOT_CONVERGED,
    NOT_FINITE,
    OPTIMAL,
    OPTIMALITY,
    SIGN,
    TABLEAU,
    TIE,
    Programs,
    Solutions,
    in_threads,
    read,
    solve_from_start,
    start,
    tableau_shape,
)
from thruster_envs.kernels import kernel
from thruster_envs.protocols import Allocation, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["UNPROVEN", "MinimumPulseMapper", "PulsedAllocation", "minimum_pulses"]

UNPROVEN = 6
"""Status: the nodes ran out; the answer is the best one found, and a better one may exist."""

_GAP = 1e-11  # share of the best cost by which a node has to promise better
_ROUND_OFF = 1e-15  # the same in units of the largest scaled command
_GRID = 1e-12  # shares of a tick below this are round-off
_FITS = 1e-9  # the same where bounds are counted in ticks, which people type in decimals


@dataclass(frozen=True, slots=True)
class PulsedAllocation(Allocation):
    """An allocation in pulses that a valve can give.

    Attributes:
        on_times: (..., n), s; zero, or from the shortest to the longest pulse.
        slack: (..., m), command units, signed: what was commanded minus what these on-times achieve.
        cost: (...,), fuel cost of the on-times plus slack cost of that slack.
        status: (...,). 0 for the optimum, or `UNPROVEN`.
        nodes: (...,). How many linear programs were solved; one if its answer was already possible.
    """

    nodes: IntArray


class MinimumPulseMapper(CompiledMapper):
    """Maps commands to on-times of zero, or of a minimum pulse and more, at the least cost.

    A thruster whose longest on-time is below its minimum pulse stays shut. One command or a batch of any
    shape; a batch gives, bit for bit, what its commands give one by one.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        minimum_pulse: (n,) or one number, s; a spacecraft's default is that of its thrusters.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        resolution: One tick of the valves' clock, s: on-times are whole numbers of it. None for any on-time.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        max_nodes: Linear programs at most for one command. Without a resolution a few suffice; a fine
            resolution makes a hard problem in integers, and an answer that is good but `UNPROVEN`.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Attributes:
        minimum_pulse: (n,), s; read-only.
        resolution: s, or None.
        max_nodes: Linear programs at most for one command.

    Raises:
        ValueError: A value that cannot be; with a bare matrix, a missing minimum pulse.

    A command below the shortest pulse is given by two opposed thrusters, or missed if that is dearer:

    >>> MinimumPulseMapper([[1.0, -1.0]], 0.01, max_on_time=1.0)([0.004]).on_times
    array([0.014, 0.01 ])
    >>> spare = MinimumPulseMapper([[1.0, -1.0]], 0.01, max_on_time=1.0, slack_cost=2.0)
    >>> spare([0.004]).on_times, spare([0.016]).on_times
    (array([0., 0.]), array([0.016, 0.   ]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        minimum_pulse: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        resolution: float | None = None,
        threads: int | None = None,
        *,
        max_nodes: int = 10_000,
        fuel_may_win: bool = False,
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, threads, fuel_may_win=fuel_may_win)
        if minimum_pulse is None:
            if not isinstance(spacecraft, Spacecraft):
                raise ValueError(
                    "minimum_pulse is missing; with a bare matrix, a number of s has to be given"
                )
            minimum_pulse = minimum_pulses(spacecraft)
        self.minimum_pulse = pulse_lengths(minimum_pulse, self._model.max_on_time.size, "minimum_pulse")
        if resolution is not None and not 0.0 < resolution < np.inf:
            raise ValueError(f"resolution is {resolution} s; a positive number of s, or None, would be right")
        if max_nodes < 1:
            raise ValueError(f"max_nodes is {max_nodes}; one or more would be right")
        self.resolution, self.max_nodes = resolution, max_nodes

    def _run(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        batch, m = command.shape
        answer = Solutions.empty(batch, m, effectiveness.shape[2], programs=True)
        problem = command, effectiveness, max_on_time, self._fuel_cost, self._slack_cost
        settings = self.minimum_pulse, self.resolution or 0.0, self.max_nodes
        work = partial(_search_range, problem, tuple(answer), settings)
        in_threads(work, batch, self._threads)
        status = answer.report[:, 0]
        if status.any():
            failed = (status == NOT_FINITE) | (status == NOT_CONVERGED)
            raise_unless_optimal(command[failed], answer.report[failed])
        return answer

    def _answer(
        self, on_times: FloatArray, slack: FloatArray, cost: FloatArray, report: IntArray
    ) -> PulsedAllocation:
        return PulsedAllocation(on_times, slack, cost, report[..., 0].copy(), nodes=report[..., 3].copy())


def minimum_pulses(spacecraft: Spacecraft | str | Path) -> FloatArray:
    """Shortest pulses (n,), s, of a spacecraft's thrusters.

    >>> minimum_pulses("spheres").max()
    np.float64(0.01)
    """
    if isinstance(spacecraft, str | Path):
        spacecraft = load(spacecraft)
    return np.array([thruster.minimum_pulse for thruster in spacecraft.thrusters])


def pulse_lengths(given: ArrayLike, thrusters: int, what: str) -> FloatArray:
    """Read-only lengths (n,), s, from one number or one per thruster; finite and not negative."""
    values = np.array(given, dtype=np.float64)
    if values.ndim == 0:
        values = np.full(thrusters, values)
    if values.shape != (thrusters,):
        raise ValueError(
            f"{what} has the shape {values.shape}; ({thrusters},), one per thruster, would be right"
        )
    valid = np.isfinite(values) & (values >= 0.0)
    if not valid.all():
        index = int(np.argmin(valid))
        raise ValueError(
            f"{what} of thruster {index + 1} is {values[index]} s; a finite number, zero or more, "
            "would be right"
        )
    values.setflags(write=False)
    return values


@kernel(nogil=True)
def _search_range(
    problem: Programs,
    answer: Solutions,
    settings: tuple[FloatArray, float, int],
    first: int,
    last: int,
) -> None:
    """Answer commands `first` to `last` (excluded) of a batch; `report` is status, pivots, flips, nodes.

    A node is the problem with each thruster kept between two on-times that it can give. Nodes wait on a
    stack, with the lower bound of the one that they come from; the one nearer to that one's answer is next.
    """
    command, effectiveness, max_on_time, fuel_cost, slack_cost = problem
    on_times, slack, cost, report = answer
    minimum_pulse, resolution, max_nodes = settings
    m, n = effectiveness.shape[1:]
    w = np.empty(tableau_shape(m, n))
    depth = (n if resolution == 0.0 else max_nodes) + 2
    lows, highs, promises = np.empty((depth, n)), np.empty((depth, n)), np.empty(depth)
    least, most, low, high, room = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    relaxed, rounded, best = np.empty(n), np.empty(n), np.empty(n)
    rest, achieved, unused = np.empty(m), np.empty(m), np.empty(m)
    for i in range(first, last):
        a = effectiveness[i if effectiveness.shape[0] > 1 else 0]
        bound = max_on_time[i if max_on_time.shape[0] > 1 else 0]
        told = report[i]
        _possible(minimum_pulse, bound, resolution, least, most)
        best[:] = 0.0
        achieved[:] = 0.0
        best_cost = settle(command[i], achieved, best, fuel_cost, slack_cost, unused)
        status, warm, age = OPTIMAL, False, 0
        lows[0], highs[0], promises[0] = 0.0, most, 0.0
        waiting = 1
        while waiting > 0:
            waiting -= 1
            if promises[waiting] >= best_cost * (1.0 - _GAP):
                continue
            if told[3] >= max_nodes:
                status = UNPROVEN
                break
            told[3] += 1
            low[:], high[:] = lows[waiting], highs[waiting]
            rate_change(a, low, achieved)
            magnitude, kept_open = 0.0, 0.0
            for k in range(m):
                rest[k] = command[i, k] - achieved[k]
                magnitude = max(magnitude, slack_cost[k] * (abs(command[i, k]) + abs(achieved[k])))
            for j in range(n):
                room[j] = high[j] - low[j]
                kept_open += fuel_cost[j] * low[j]

            # The linear program of this node: from the last basis, else from all slacks.
            solved, promise = False, 0.0
            if told[3] > 1:
                if not warm or age >= REFRESH:
                    warm, age = _anew(w, command[i], a, most, fuel_cost, slack_cost, told) == OPTIMAL, 0
                if warm:
                    change_bounds(w, m, n, room)
                    warm = _choose_sides(w, m, n) and repair(w, m, n, rest, slack_cost, TIE * magnitude, told)
                if warm:
                    age += 1
                    total = read(w, magnitude, rest, a, room, fuel_cost, slack_cost, OPTIMAL, relaxed, unused)
                    promise = lower_bound(w, rest, a, room, fuel_cost, slack_cost)
                    solved = total - promise <= _GAP * total + _ROUND_OFF * magnitude
            if not solved:
                status = _anew(w, rest, a, room, fuel_cost, slack_cost, told)
                if status != OPTIMAL:
                    break
                promise = read(w, magnitude, rest, a, room, fuel_cost, slack_cost, OPTIMAL, relaxed, unused)
                warm = told[3] == 1  # the first node has all bounds open, as later ones need it
            promise += kept_open

            # What valves can give next to it, and the thruster that this changes most.
            widest, branch = 0.0, -1
            for j in range(n):
                relaxed[j] = min(relaxed[j] + low[j], high[j])
                below = _next_below(relaxed[j], least[j], most[j], resolution)
                above = _next_above(relaxed[j], least[j], most[j], resolution)
                near = min(relaxed[j] - below, above - relaxed[j])
                rounded[j] = below if relaxed[j] - below <= above - relaxed[j] else above
                weight = 0.0
                for k in range(m):
                    weight = max(weight, slack_cost[k] * abs(a[k, j]))
                if above > below and (branch < 0 or near * weight > widest):
                    widest, branch = near * weight, j
            rate_change(a, rounded, achieved)
            rounded_cost = settle(command[i], achieved, rounded, fuel_cost, slack_cost, unused)
            if rounded_cost < best_cost:
                best_cost = rounded_cost
                best[:] = rounded
            if branch < 0 or promise >= best_cost * (1.0 - _GAP):
                continue

            # Two new nodes; the nearer one on top.
            below = _next_below(relaxed[branch], least[branch], most[branch], resolution)
            above = _next_above(relaxed[branch], least[branch], most[branch], resolution)
            up_is_near = above - relaxed[branch] < relaxed[branch] - below
            for second in range(2):
                lows[waiting], highs[waiting], promises[waiting] = low, high, promise
                if (second == 1) == up_is_near:
                    lows[waiting, branch] = above
                else:
                    highs[waiting, branch] = below
                waiting += 1
        if status in (NOT_FINITE, NOT_CONVERGED):
            best[:] = 0.0
        told[0] = status
        on_times[i] = best
        rate_change(a, best, achieved)
        cost[i] = settle(command[i], achieved, best, fuel_cost, slack_cost, slack[i])


@njit(error_model="numpy")
def _possible(
    minimum_pulse: FloatArray, bound: FloatArray, resolution: float, least: FloatArray, most: FloatArray
) -> None:
    """Write the shortest and the longest pulse (n,) that a valve can give; the longest is 0 without any."""
    for j in range(bound.size):
        least[j], most[j] = minimum_pulse[j], bound[j]
        fits = least[j] <= most[j]
        if resolution > 0.0:
            shortest = max(np.ceil(minimum_pulse[j] / resolution - _FITS), 1.0)
            longest = np.floor(bound[j] / resolution + _FITS)
            least[j] = min(max(shortest * resolution, minimum_pulse[j]), bound[j])
            most[j] = max(min(longest * resolution, bound[j]), least[j])
            fits &= shortest <= longest
        if not fits:
            most[j] = 0.0


@njit(error_model="numpy")
def _next_below(on_time: float, least: float, most: float, resolution: float) -> float:
    """The longest on-time that a valve can give, up to this one."""
    if on_time < least:
        return 0.0
    if resolution == 0.0:
        return on_time
    return min(max(math.floor(on_time / resolution * (1.0 + _GRID)) * resolution, least), most)


@njit(error_model="numpy")
def _next_above(on_time: float, least: float, most: float, resolution: float) -> float:
    """The shortest on-time that a valve can give, from this one on."""
    if on_time <= 0.0:
        return 0.0
    if on_time < least:
        return least
    if resolution == 0.0:
        return on_time
    return min(max(math.ceil(on_time / resolution * (1.0 - _GRID)) * resolution, least), most)


@njit(error_model="numpy")
def _anew(
    w: FloatArray,
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    report: IntArray,
) -> int:
    """Solve a linear program from all slacks; status and pivots go to the report."""
    m, n = effectiveness.shape
    magnitude = start(w, command, effectiveness, max_on_time, fuel_cost, slack_cost)
    report[0] = OPTIMAL
    solve_from_start(w, m, n, magnitude, report)
    return int(report[0])


@njit(error_model="numpy")
def _choose_sides(w: FloatArray, m: int, n: int) -> bool:
    """Put thrusters outside the basis to the bound where they gain nothing; False if one would gain forever.

    A thruster that had no room stood anywhere; with room it has to be where the multipliers want it.
    """
    z = TABLEAU + m
    for j in range(n):
        if w[SIGN, j] < 0.0 and w[BOUND, j] == np.inf:
            w[SIGN, j] = 1.0
        if w[BOUND, j] > 0.0 and w[SIGN, j] * w[z, j] > OPTIMALITY:
            if w[BOUND, j] == np.inf:
                return False
            w[SIGN, j] = -w[SIGN, j]
    return True
