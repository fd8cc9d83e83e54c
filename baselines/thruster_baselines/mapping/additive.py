"""Method II of the source: fire again for what the coupling loss has taken, until nothing is missing.

Each round maps what is still missing by a linear program and adds the on-times to those before; bounds
shrink by what is used. To keep the number of open thrusters small, those not used so far become dearer (Yang
2003, section 2.4.2 and appendix B), or those used become cheaper (the text's rule). The target is what the
first round would give without loss.

Where the thrusters that the first round opened stay the cheapest and none reaches its bound, each further
round asks them for exactly what they have lost, so that the whole is a fixed-point iteration for the on-times
of `thruster_baselines.mapping.coupling.commanded_on_times`; `ExactCompensationMapper` writes these down at
once.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.compensation import (
    CAPPED,
    SHORT,
    CompensatingMapper,
    CompensationSettings,
    largest,
    rate_change,
    settle,
)
from thruster_baselines.mapping.coupling import convert
from thruster_baselines.mapping.dual import change_bounds, change_costs, repair
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
from thruster_envs.spacecraft import Spacecraft

__all__ = ["AdditiveCompensationMapper"]

_PROGRESS = 0.1  # share of the tolerance by which the miss has to change for another round
_ROUND_OFF = 1e-12  # share of the longest on-time below which no thruster is opened
_CHEAPEST = 1e-3  # share of its fuel cost below which the text's rule makes no thruster cheaper


class AdditiveCompensationMapper(CompensatingMapper):
    """Maps commands by the LP, again and again for what the coupling loss has taken (method II).

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        cost_rule: "raise_unused" divides the cost of thrusters that are not open by the share of thrust that
            is left (appendix B); "lower_used" takes `cost_factor` times its on-time from the cost of each
            open one (text); "none" leaves costs alone.
        cost_factor: Of "lower_used", per s.
        settings: Coupling, tolerance and iterations; see `CompensatingMapper`.

    >>> allocation = AdditiveCompensationMapper("orion")([-0.02, -0.02, 0, 0, 0, 0])
    >>> allocation.on_times[[0, 5, 9, 11]].round(3).tolist(), int(allocation.iterations)
    ([4.064, 4.064, 4.064, 4.064], 5)
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
        *,
        cost_rule: Literal["raise_unused", "lower_used", "none"] = "raise_unused",
        cost_factor: float = 0.1,
        **settings: Unpack[CompensationSettings],
    ) -> None:
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, threads, **settings)
        if cost_rule not in _RULES:
            raise ValueError(f"cost_rule is {cost_rule!r}; one of {', '.join(_RULES)} would be right")
        if not 0.0 <= cost_factor < np.inf:
            raise ValueError(f"cost_factor is {cost_factor}; a finite number, zero or more, would be right")
        self._rule, self._factor = _RULES[cost_rule], cost_factor

    def _kernel(self) -> tuple[Callable[..., None], tuple[Any, ...]]:
        return _additive_range, (self.tolerance, self.max_iterations, self._rule, self._factor)


_RULES = {"none": 0, "raise_unused": 1, "lower_used": 2}


@kernel(nogil=True)
def _additive_range(
    problem: Programs,
    answer: Solutions,
    shares: FloatArray,
    settings: tuple[float, int, int, float],
    first: int,
    last: int,
) -> None:
    command, effectiveness, max_on_time, fuel_cost, slack_cost = problem
    on_times, slack, cost, report = answer
    tolerance, max_iterations, rule, factor = settings
    m, n = effectiveness.shape[1:]
    missing, goal, achieved, rest = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    more, room, costs, delivered = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    dearer, order, told = np.empty(n), np.empty(n, np.int64), np.empty(3, np.int64)
    w = np.empty(tableau_shape(m, n))
    for i in range(first, last):
        a = effectiveness[i if effectiveness.shape[0] > 1 else 0]
        bound = max_on_time[i if max_on_time.shape[0] > 1 else 0]
        on_times[i] = 0.0
        missing[:] = command[i]
        room[:] = bound
        costs[:] = fuel_cost
        warm = True
        enough, longest, status = 0.0, 0.0, CAPPED
        for iteration in range(max_iterations):
            solved = False
            if iteration > 0 and warm:
                change_bounds(w, m, n, room)
                magnitude = largest(slack_cost, missing)
                solved = repair(w, m, n, missing, slack_cost, TIE * magnitude, report[i])
            if not solved:
                magnitude = start(w, missing, a, room, costs, slack_cost)
                told[:] = 0
                solve_from_start(w, m, n, magnitude, told)
                report[i, 1:3] += told[1:3]
            read(w, magnitude, missing, a, room, costs, slack_cost, told[0], more, rest)
            report[i, 3] = iteration + 1
            if told[0] != OPTIMAL:
                status = told[0]
                break
            open_ones = 0
            for j in range(n):
                if more[j] > _ROUND_OFF * longest:
                    on_times[i, j] = min(on_times[i, j] + more[j], bound[j])
                    longest = max(longest, on_times[i, j])
                room[j] = bound[j] - on_times[i, j]
                open_ones += 1 if on_times[i, j] > 0.0 else 0
            if iteration == 0:
                rate_change(a, on_times[i], goal)
                enough = tolerance * largest(slack_cost, goal)
            convert(on_times[i], shares, order, True, delivered)
            rate_change(a, delivered, achieved)
            change = 0.0
            for k in range(m):
                now = goal[k] - achieved[k]
                change = max(change, slack_cost[k] * abs(now - missing[k]))
                missing[k] = now
            if largest(slack_cost, missing) <= enough:
                status = OPTIMAL
                break
            if iteration > 0 and change <= _PROGRESS * enough:
                status = SHORT
                break
            for j in range(n):
                used = on_times[i, j] > 0.0
                dearer[j] = fuel_cost[j]
                if rule == 1 and not used and shares[open_ones] > 0.0:
                    dearer[j] = fuel_cost[j] / shares[open_ones]
                elif rule == 2 and used:
                    dearer[j] = max(fuel_cost[j] - factor * on_times[i, j], _CHEAPEST * fuel_cost[j])
            warm = change_costs(w, m, n, costs, dearer)
            costs[:] = dearer
        report[i, 0] = status
        cost[i] = settle(command[i], achieved, on_times[i], fuel_cost, slack_cost, slack[i])
