"""The coupling loss made up for exactly, with one linear program: beyond the source.

What thrusters have to deliver, e, solves the linear program without loss: A e = T. Which on-times deliver it
is a relation in closed form (`thruster_baselines.mapping.coupling`): sort e, and let time pass 1 / g(N) times
as fast where N thrusters are to be open. The command is then met to round-off, where the source's methods
stop at a tolerance after several linear programs.

If the on-times come out longer than the period, the bounds on e are drawn in, all in the same proportion, as
far as needed and no farther: a root of one variable, found by interpolation and bisection. Only the bounds
change from one linear program to the next, so that the dual simplex method goes on from the last basis.

Left out: choosing *which* thrusters to open with the loss in mind. The set of what can be delivered in a
period is not convex (opening one more thruster costs all the others), so that the best choice beyond the
authority is a combinatorial problem. The linear program's choice is kept there, which is nearer to the
command than method II on average and not in every case.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from thruster_baselines.mapping.compensation import SHORT, CompensatingMapper, rate_change, settle
from thruster_baselines.mapping.coupling import convert
from thruster_baselines.mapping.dual import change_bounds, repair
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

__all__ = ["ExactCompensationMapper"]

_ROUND_OFF = 1e-9  # share of its bound by which an on-time may be beyond it before it is cut
_MARGIN = 0.05  # the scale falls by at least this share, and more each time, until something fits
_SMALLEST = 0.3  # the scale falls by no more than to this share at a time


class ExactCompensationMapper(CompensatingMapper):
    """Maps commands by the LP and stretches the on-times by what the coupling loss takes, exactly.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        coupling: Share of thrust lost per further thruster open, or a loss curve; a spacecraft's default is
            that of its feed.
        tolerance: How closely the bounds are used where a command is beyond them, as a share of the bounds.
        max_iterations: Linear programs at most.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    >>> allocation = ExactCompensationMapper("orion")([-0.02, -0.02, 0, 0, 0, 0])
    >>> allocation.on_times[[0, 5, 9, 11]].round(6).tolist(), int(allocation.iterations)
    ([4.065041, 4.065041, 4.065041, 4.065041], 1)
    """

    def _kernel(self) -> tuple[Callable[..., None], tuple[Any, ...]]:
        return _exact_range, (self.tolerance, self.max_iterations)


@kernel(nogil=True)
def _exact_range(
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
    wanted, room, trial, delivered = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    achieved, rest, order = np.empty(m), np.empty(m), np.empty(n, np.int64)
    w = np.empty(tableau_shape(m, n))
    for i in range(first, last):
        a = effectiveness[i if effectiveness.shape[0] > 1 else 0]
        bound = max_on_time[i if max_on_time.shape[0] > 1 else 0]
        on_times[i] = 0.0
        # The on-times are `longest(scale)` times their bounds if the bounds on what is wanted are scaled.
        magnitude, scale, low, high, longest_low, longest_high = 0.0, 1.0, 0.0, 1.0, 0.0, 1.0
        status = SHORT
        for iteration in range(max_iterations):
            for j in range(n):
                room[j] = scale * bound[j]
            if iteration > 0:
                change_bounds(w, m, n, room)
            if iteration == 0 or not repair(w, m, n, command[i], slack_cost, TIE * magnitude, report[i]):
                magnitude = start(w, command[i], a, room, fuel_cost, slack_cost)
                solve_from_start(w, m, n, magnitude, report[i])
                if report[i, 0] != OPTIMAL:
                    status = report[i, 0]
                    break
            read(w, magnitude, command[i], a, room, fuel_cost, slack_cost, OPTIMAL, wanted, rest)
            report[i, 3] = iteration + 1
            convert(wanted, shares, order, False, trial)
            longest = 0.0
            for j in range(n):
                if trial[j] > 0.0:
                    longest = max(longest, trial[j] / bound[j])
            if longest <= 1.0 + _ROUND_OFF:
                for j in range(n):
                    on_times[i, j] = min(trial[j], bound[j])
                low, longest_low = scale, longest
                if iteration == 0:
                    status = OPTIMAL
                if iteration == 0 or longest >= 1.0 - tolerance:
                    break
            else:
                high, longest_high = scale, longest
            if high - low <= tolerance * high:
                break
            if longest_low == 0.0:  # nothing that fits is known yet: this would, if no thruster joined
                scale = high * max(min(1.0 / longest_high, 1.0 - _MARGIN * iteration), _SMALLEST)
            elif iteration % 2:
                scale = low + (high - low) * (1.0 - longest_low) / (longest_high - longest_low)
            else:
                scale = 0.5 * (low + high)
        convert(on_times[i], shares, order, True, delivered)
        rate_change(a, delivered, achieved)
        report[i, 0] = status
        cost[i] = settle(command[i], achieved, on_times[i], fuel_cost, slack_cost, slack[i])
