"""Method I of the source: ask for more than is wanted, by as much as the coupling loss takes.

Each round maps a command T_i by the linear program, works out what comes of it with the loss, T_a, and asks
for

    T_(i+1) = T_i + D (T - T_a),    D = diag(T_i / T_a)                  (Yang 2003, section 2.4.1)

in the next. Where nothing was wanted on an axis, or nothing came, D is 1. Each linear program goes on from
the basis of the one before, so that among equally cheap vertices it stays where it is: commands on the axes
of translation or of rotation alone then converge. On all six, the best vertex itself may change from round to
round, so that the iteration comes back to where it was and would go on for ever. That is noticed (`CYCLED`):
three rounds in which nothing came nearer. The best round is the answer then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from thruster_baselines.mapping.compensation import (
    CAPPED,
    CYCLED,
    CompensatingMapper,
    largest,
    rate_change,
    settle,
)
from thruster_baselines.mapping.coupling import convert
from thruster_baselines.mapping.dual import repair
from thruster_baselines.mapping.simplex import (
    OPTIMAL,
    TIE,
    Programs,
    Solutions,
    read,
    solve_from_start,
    start,
    tableau_shape,
)
from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray

__all__ = ["DifferentialCompensationMapper"]

_PATIENCE = 3  # rounds without coming nearer
_NEARER = 0.95  # of the best miss so far; a round that converges leaves half of it or less
_RUNAWAY = 1e6  # commands this many times the first are not worth mapping


class DifferentialCompensationMapper(CompensatingMapper):
    """Maps commands by the LP, inflated by what the coupling loss takes (method I).

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        coupling: Share of thrust lost per further thruster open, or a loss curve; a spacecraft's default is
            that of its feed.
        tolerance: Largest miss that is good enough, as a share of the largest commanded rate change.
        max_iterations: Linear programs at most.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    >>> allocation = DifferentialCompensationMapper("orion")([-0.02, -0.02, 0, 0, 0, 0])
    >>> allocation.on_times[[0, 5, 9, 11]].round(3).tolist(), int(allocation.iterations)
    ([4.065, 4.065, 4.065, 4.065], 2)
    """

    def _kernel(self) -> tuple[Callable[..., None], tuple[Any, ...]]:
        return _differential_range, (self.tolerance, self.max_iterations)


@kernel(nogil=True)
def _differential_range(
    problem: Programs,
    answer: Solutions,
    shares: FloatArray,
    settings: tuple[float, int],
    first: int,
    last: int,
) -> None:
    command, effectiveness, max_on_time, fuel_cost, slack_cost = problem
    on_times, slack, cost, report = answer
    tolerance, max_iterations = settings
    m, n = effectiveness.shape[1:]
    asked, goal, achieved, missing, rest = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    trial, delivered, order = np.empty(n), np.empty(n), np.empty(n, np.int64)
    w = np.empty(tableau_shape(m, n))
    for i in range(first, last):
        a = effectiveness[i if effectiveness.shape[0] > 1 else 0]
        bound = max_on_time[i if max_on_time.shape[0] > 1 else 0]
        asked[:] = command[i]
        on_times[i] = 0.0
        enough, size, best, waiting, status = 0.0, 0.0, np.inf, 0, CAPPED
        for iteration in range(max_iterations):
            magnitude = largest(slack_cost, asked)
            if iteration == 0 or not repair(w, m, n, asked, slack_cost, TIE * magnitude, report[i]):
                magnitude = start(w, asked, a, bound, fuel_cost, slack_cost)
                solve_from_start(w, m, n, magnitude, report[i])
                if report[i, 0] != OPTIMAL:
                    status = report[i, 0]
                    break
            read(w, magnitude, asked, a, bound, fuel_cost, slack_cost, OPTIMAL, trial, rest)
            report[i, 3] = iteration + 1
            if iteration == 0:
                rate_change(a, trial, goal)
                size = largest(slack_cost, goal)
                enough = tolerance * size
                asked[:] = goal
            convert(trial, shares, order, True, delivered)
            rate_change(a, delivered, achieved)
            for k in range(m):
                missing[k] = goal[k] - achieved[k]
            miss = largest(slack_cost, missing)
            waiting = 0 if miss < _NEARER * best else waiting + 1
            if miss < best:
                best = miss
                on_times[i] = trial
            if miss <= enough:
                status = OPTIMAL
                break
            if waiting >= _PATIENCE or not largest(slack_cost, asked) < _RUNAWAY * size:
                status = CYCLED
                break
            for k in range(m):
                steep = abs(slack_cost[k] * goal[k]) > enough and achieved[k] != 0.0
                asked[k] += missing[k] * (asked[k] / achieved[k] if steep else 1.0)
        convert(on_times[i], shares, order, True, delivered)
        rate_change(a, delivered, achieved)
        report[i, 0] = status
        cost[i] = settle(command[i], achieved, on_times[i], fuel_cost, slack_cost, slack[i])
