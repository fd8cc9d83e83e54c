"""The linear program along a sequence of commands: each starts from the basis of the one before.

As long as nothing but the command changes, the last basis stays dual feasible: no thruster has become worth
opening. A few pivots of the dual simplex method then repair what has left its bounds, often none
(`thruster_baselines.mapping.dual`). Every answer is checked: the multipliers give a lower bound
of the objective from the unscaled data, and where cost and bound differ by more than round-off, or the repair
takes too long, the problem is solved anew from all slacks. It is also solved anew every `REFRESH` commands,
so that round-off does not pile up.

The cost is that of `LPMapper`. Among equally cheap vertices the answer may be another one, since it depends
on where the sequence came from; it is a vertex, and neighbours with fewer open thrusters are preferred all
the same.

Left out: going on after a change of effectiveness, bounds or costs, which starts the sequence anew.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import WeightedMapper, raise_unless_optimal
from thruster_baselines.mapping.dual import repair
from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.simplex import (
    FALL,
    OPTIMAL,
    TABLEAU,
    TIE,
    Programs,
    Solutions,
    in_threads,
    leave_fewer_open,
    read,
    solve_from_start,
    start,
    tableau_shape,
)
from thruster_envs.kernels import kernel
from thruster_envs.protocols import Allocation, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["REFRESH", "LPSequence"]

REFRESH = 256
"""Commands after which a sequence is solved from all slacks once, whatever happened."""

_GAP = 1e-11  # relative difference of cost and lower bound above which a problem is solved anew
_ROUND_OFF = 1e-15  # the same in units of the largest scaled command


class LPSequence(WeightedMapper):
    """Maps a sequence of commands by the linear program, each from the basis of the one before.

    `LPMapper.sequence()` makes one. It has a memory, which changes how fast an answer is found and which of
    several equally cheap ones, never its cost.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        worlds: How many craft fly side by side, each with its own sequence; None for one.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    >>> from thruster_envs.spacecraft import load
    >>> sequence = LPSequence(load("orion"))
    >>> commands = np.array([[-0.027, -0.027, 0, 0, 0, 0], [-0.0135, -0.027, 0, 0, 0, 0]])
    >>> sequence(commands).on_times[:, [0, 5, 9, 11]].round(9).tolist()
    [[4.5, 4.5, 4.5, 4.5], [2.25, 4.5, 2.25, 4.5]]
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        *,
        worlds: int | None = None,
        threads: int | None = None,
        fuel_may_win: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, fuel_may_win=fuel_may_win)
        if threads is not None and threads < 1:
            raise ValueError(f"threads is {threads}; one or more, or None, would be right")
        if worlds is not None and worlds < 1:
            raise ValueError(f"worlds is {worlds}; one or more, or None for one craft, would be right")
        self.worlds = worlds
        m, n = self._model.effectiveness.shape
        self._tableaus = np.zeros((worlds or 1, *tableau_shape(m, n)))
        self._ages = np.zeros(worlds or 1, np.int64)
        self._threads = threads
        self._costs = self._fuel_cost[np.newaxis]
        self._believed = self._model
        self._stacked = self._model.effectiveness[np.newaxis], self._model.max_on_time[np.newaxis]

    def forget(self, worlds: ArrayLike | None = None) -> None:
        """Start anew from all slacks at the next command.

        Args:
            worlds: Which ones, as a mask (worlds,); all by default.
        """
        self._ages[slice(None) if worlds is None else np.asarray(worlds, dtype=np.bool_)] = 0

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        """Commands (m,) or (steps, m) of one craft, ([steps,] worlds, m) of several; steps in their order."""
        m, n = self._model.effectiveness.shape
        craft = () if self.worlds is None else (self.worlds,)
        if command.ndim not in (1 + len(craft), 2 + len(craft)) or (
            command.shape[command.ndim - 1 - len(craft) : -1] != craft
        ):
            right = "(m,) or (steps, m)" if self.worlds is None else "(worlds, m) or (steps, worlds, m)"
            raise ValueError(
                f"command has the shape {command.shape}; {right} with m = {m}"
                f"{'' if self.worlds is None else f' and worlds = {self.worlds}'} would be right"
            )
        self._believe(model, craft)
        commands = command.reshape(-1, len(self._ages), m)
        steps, worlds = commands.shape[:2]
        on_times, slack = np.empty((steps, worlds, n)), np.empty((steps, worlds, m))
        cost, report = np.empty((steps, worlds)), np.empty((steps, worlds, 3), np.int64)
        arrays = (
            (commands, *self._stacked, self._costs, self._slack_cost), self._tableaus, self._ages,
            (on_times, slack, cost, report),
        )  # fmt: skip
        in_threads(lambda first, last: follow_range(*arrays, first, last), worlds, self._threads)
        raise_unless_optimal(commands, report)
        leading = command.shape[:-1]
        return Allocation(
            on_times.reshape(*leading, n), slack.reshape(*leading, m), cost.reshape(leading),
            report[..., 0].reshape(leading).copy(),
        )  # fmt: skip

    def _believe(self, model: Model, craft: tuple[int, ...]) -> None:
        """Take over a model, and start the sequences anew if it is another one than the last."""
        last = self._believed
        if model is last or (
            np.array_equal(model.effectiveness, last.effectiveness)
            and np.array_equal(model.max_on_time, last.max_on_time)
        ):
            return
        for array, trailing in ((model.effectiveness, 2), (model.max_on_time, 1)):
            if array.shape[:-trailing] not in ((), craft):
                raise ValueError(
                    f"a belief has the leading axes {array.shape[:-trailing]}; none, or {craft} to give each "
                    "craft its own, would be right"
                )
        matrices, bounds = model.effectiveness.copy(), model.max_on_time.copy()
        self._believed = Model(matrices, bounds)
        self._stacked = matrices.reshape(-1, *matrices.shape[-2:]), bounds.reshape(-1, bounds.shape[-1])
        self.forget()


@kernel(nogil=True)
def follow_range(
    problem: Programs, tableaus: FloatArray, ages: IntArray, solutions: Solutions, first: int, last: int
) -> None:
    """Solve the commands (steps, worlds, m) of worlds `first` to `last` (excluded), step after step.

    Args:
        problem: Commands (steps, worlds, m), and the effectiveness, bounds and costs of the worlds, a plain
            tuple in the order of `Programs`.
        tableaus: (worlds, rows, width), the last tableau of each world; changed.
        ages: (worlds,), commands since it was set up; 0 where there is none; changed.
        solutions: Arrays (steps, worlds, ...), written.
        first: The first world.
        last: One behind the last world.
    """
    command, effectiveness, max_on_time, fuel_cost, slack_cost = problem
    on_times, slack, cost, report = solutions
    m, n = effectiveness.shape[1:]
    c = fuel_cost[0]
    for world in range(first, last):
        a = effectiveness[world if effectiveness.shape[0] > 1 else 0]
        b = max_on_time[world if max_on_time.shape[0] > 1 else 0]
        w = tableaus[world]
        for step in range(command.shape[0]):
            demand, told = command[step, world], report[step, world]
            answer, rest = on_times[step, world], slack[step, world]
            told[:] = 0
            if 0 < ages[world] < REFRESH:
                magnitude = 0.0
                for k in range(m):
                    magnitude = max(magnitude, abs(slack_cost[k] * demand[k]))
                if repair(w, m, n, demand, slack_cost, TIE * magnitude, told):
                    leave_fewer_open(w, m, n, TIE * magnitude, told)
                    total = read(w, magnitude, demand, a, b, c, slack_cost, OPTIMAL, answer, rest)
                    bound = lower_bound(w, demand, a, b, c, slack_cost)
                    if total - bound <= _GAP * total + _ROUND_OFF * magnitude:  # False for what is not finite
                        cost[step, world] = total
                        ages[world] += 1
                        continue
            magnitude = start(w, demand, a, b, c, slack_cost)
            solve_from_start(w, m, n, magnitude, told)
            cost[step, world] = read(w, magnitude, demand, a, b, c, slack_cost, told[0], answer, rest)
            ages[world] = 1 if told[0] == OPTIMAL else 0


@njit(forceinline=True, error_model="numpy")
def lower_bound(
    w: FloatArray,
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
) -> float:
    """What no on-times can cost less than: from the multipliers and the problem as it was given."""
    m, n = effectiveness.shape
    z = TABLEAU + m
    bound = 0.0
    for k in range(m):
        w[FALL, k] = slack_cost[k] * min(max(w[z, n + k], -1.0), 1.0)
        bound += w[FALL, k] * command[k]
    for j in range(n):
        gain = -fuel_cost[j]
        for k in range(m):
            gain += w[FALL, k] * effectiveness[k, j]
        if gain > _ROUND_OFF * fuel_cost[j] and max_on_time[j] > 0.0:
            bound -= gain * max_on_time[j]
    return bound
