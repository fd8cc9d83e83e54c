"""Fuel-optimal rendezvous, planned directly in thruster on-times.

The plan is one linear program over all remaining periods: on-times of every thruster in every period, least
firing time, relative motion by the Hill-Clohessy-Wiltshire equations, no rotation commanded in any period,
a target state at the end. Planning in on-times, and not in rate changes with limits per axis, is what keeps
the plan within what a damaged craft can still do: after a fault the axes share their authority (Yang 2003,
section 6; reconstruction of its planner).

Modelled: the craft keeps its body axes on LVLH; on-times act as a constant force over their period. Left
out: the feed coupling (`thruster_baselines.control.coupling` makes up for it, and `max_on_time` leaves room
for that), the placement of a pulse within its period, mass depletion, constraints along the way.

The end state carries a slack, so that there is always a plan: if the target is out of reach, the one that
comes nearest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.guidance.hcw import force_response, transition_matrix
from thruster_baselines.mapping.model import Model
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

with extra("baselines", __name__):
    import highspy

__all__ = ["RendezvousPlan", "RendezvousPlanner"]

_SHARE_OF_PERIOD = 0.9  # of the source: the rest is for making up losses
_VELOCITY_UNIT = 0.01  # m/s that count as much as 1 m at the end


@dataclass(frozen=True, slots=True)
class RendezvousPlan:
    """On-times for the periods to come, and the motion that follows from them.

    Attributes:
        on_times: (steps, n), s.
        rate_changes: (steps, 6), m/s then rad/s per period, body axes; the last three are zero.
        states: (steps + 1, 6), m then m/s, LVLH, from the present one on.
        miss: (6,), last state minus target, m then m/s.
    """

    on_times: FloatArray
    rate_changes: FloatArray
    states: FloatArray
    miss: FloatArray

    @property
    def firing_time(self) -> float:
        """Sum of all on-times, s."""
        return float(self.on_times.sum())

    @property
    def delta_v(self) -> float:
        """Sum of the absolute translational rate changes over axes and periods, m/s."""
        return float(np.abs(self.rate_changes[:, :3]).sum())


class RendezvousPlanner:
    """Plans the least firing time from any state to a target state, in any number of periods.

    Args:
        spacecraft: What the plan is for; six axes.
        max_on_time: (n,) or one number, s; by default 90 % of the control period.
        target: (6,), state to end in, m then m/s, LVLH.
        tolerance: (6,), half-width of the box about the target in which all end states are equally good.
        miss_cost: What 1 m (or 0.01 m/s) outside that box costs, s of firing. Large, so that reaching it
            comes first.
        max_total_on_time: Longest sum of all on-times in one period, s. A limit spreads a plan over more
            periods with fewer thrusters at a time, which lose less to each other.
        delta_v_cost: What 1 m/s of translational rate change costs besides its firing time, s. Zero plans
            for least propellant; a large value for least delta-v, as the source does.

    >>> from thruster_envs.spacecraft import load
    >>> plan = RendezvousPlanner(load("orion"))([300.0, 0.0, 0.0, 0.0, 0.0, 0.0], steps=571)
    >>> round(plan.firing_time, 1)
    352.6
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        max_on_time: ArrayLike | None = None,
        target: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        tolerance: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        miss_cost: float = 1e4,
        max_total_on_time: float = np.inf,
        delta_v_cost: float = 0.0,
        detailed_steps: int | None = None,
        group: int = 5,
    ) -> None:
        self.period = spacecraft.control_period
        self.mean_motion = spacecraft.circular_mean_motion("the rendezvous planner")
        if max_on_time is None:
            max_on_time = _SHARE_OF_PERIOD * spacecraft.control_period
        self._model = Model.of(spacecraft, max_on_time)
        self.target = _state(target, "target")
        self.tolerance = _state(tolerance, "tolerance")
        if (self.tolerance < 0.0).any():
            raise ValueError(
                f"tolerance is {self.tolerance.tolist()}; six numbers, zero or more, would be right"
            )
        for name, value in (("miss_cost", miss_cost), ("delta_v_cost", delta_v_cost)):
            if not 0.0 <= value < np.inf:
                raise ValueError(f"{name} is {value}; a finite number of s, zero or more, would be right")
        if not max_total_on_time > 0.0:
            raise ValueError(
                f"max_total_on_time is {max_total_on_time}; a positive number of s would be right"
            )
        if (detailed_steps is not None and detailed_steps < 1) or group < 1:
            raise ValueError(
                f"detailed_steps is {detailed_steps} and group {group}; one or more (or None) would be right"
            )
        self.detailed_steps = detailed_steps
        self.group = group
        self.miss_cost = miss_cost
        self.max_total_on_time = max_total_on_time
        self.delta_v_cost = delta_v_cost
        self._transition = transition_matrix(self.mean_motion, self.period)
        self._response = force_response(self.mean_motion, self.period) / self.period
        self._powers = np.eye(6)[np.newaxis]  # of the transition, as many as a plan has needed so far

    def __call__(
        self,
        state: ArrayLike,
        steps: int,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
        min_on_time: ArrayLike | None = None,
    ) -> RendezvousPlan:
        """Plan the remaining periods.

        Args:
            state: (6,), present relative state, m then m/s, LVLH.
            steps: Periods that remain; none gives an empty plan.
            effectiveness: (6, n), believed instead of the spacecraft's own, m/s^2 then rad/s^2.
            max_on_time: (n,), instead of the planner's own, s.
            min_on_time: (n,), s: how long each thruster fires in every period whatever is planned, as one
                that is stuck on does; by default nobody does. It has to be within the longest on-time. The
                limit on the sum of on-times is then lifted, since the others have to hold against it.

        Raises:
            ValueError: A state that is not six finite numbers, or a model that cannot be.
            RuntimeError: HiGHS found no optimum; not known to happen.
        """
        start = _state(state, "state")
        if steps < 0:
            raise ValueError(f"steps is {steps}; zero or more would be right")
        model = self._model.overridden(effectiveness, max_on_time)
        least = np.zeros(model.max_on_time.size) if min_on_time is None else np.array(min_on_time, np.float64)
        if (
            least.shape != model.max_on_time.shape
            or not ((least >= 0.0) & (least <= model.max_on_time)).all()
        ):
            raise ValueError(
                f"min_on_time is {least.tolist()}; for each thruster, a number of s from zero to its longest "
                "on-time would be right"
            )
        on_times = self._optimum(start, steps, model, least) if steps > 0 else np.zeros((0, least.size))
        rate_changes = on_times @ model.effectiveness.T
        states = np.empty((steps + 1, 6))
        states[0] = start
        for k in range(steps):
            states[k + 1] = self._transition @ states[k] + self._response @ rate_changes[k, :3]
        return RendezvousPlan(on_times, rate_changes, states, states[-1] - self.target)

    def _optimum(self, start: FloatArray, steps: int, model: Model, least: FloatArray) -> FloatArray:
        """On-times (steps, n) of the linear program, none shorter than `least` (n,).

        Variables: on-times by group of periods; the shortfall of each end-state component, above and below;
        what of the tolerance is used; and, if delta-v has a price, its positive and negative parts by
        group.
        """
        n = model.max_on_time.size
        sizes = self._groups(steps)
        count = len(sizes)
        row_scale = np.repeat([1.0, 1.0 / _VELOCITY_UNIT], 3)
        to_end = self._coasting(steps)
        reach = to_end[1:] @ self._response  # end state per m/s in each period
        reach = np.add.reduceat(reach, np.cumsum(sizes) - sizes, axis=0)
        end_per_on_time = (row_scale[:, np.newaxis] * (reach @ model.effectiveness[:3])).transpose(1, 0, 2)

        unit = 1.0 / np.maximum(np.abs(model.effectiveness).max(axis=1), 1e-300)  # entries of order one
        scaled = model.effectiveness * unit[:, np.newaxis]
        limited = self.max_total_on_time < np.inf and not least.any()
        priced = self.delta_v_cost > 0.0
        # where blocks of rows and columns begin; first come the sums per group and the on-times
        end = count * limited
        rotation, translation = end + 6, end + 6 + 3 * count
        short, parts = count * n, count * n + 18
        by_group = np.arange(count)[:, np.newaxis, np.newaxis]
        axes, thrusters = np.arange(3)[:, np.newaxis], np.arange(n)
        problem = _Problem()
        if limited:
            problem.put(by_group, n * by_group + thrusters, 1.0)
        problem.put(end + np.arange(6)[:, np.newaxis], np.arange(short), end_per_on_time.reshape(6, -1))
        for block, sign in enumerate((1.0, -1.0, 1.0)):
            problem.put(end + np.arange(6), short + 6 * block + np.arange(6), sign)
        problem.put(rotation + 3 * by_group + axes, n * by_group + thrusters, scaled[3:])
        cost = [np.repeat(sizes, n), np.full(12, self.miss_cost), np.zeros(6)]
        lower = [np.tile(least, count), np.zeros(12), -self.tolerance * row_scale]
        upper = [np.tile(model.max_on_time, count), np.full(12, np.inf), self.tolerance * row_scale]
        if priced:
            problem.put(translation + 3 * by_group + axes, n * by_group + thrusters, scaled[:3])
            for block, sign in enumerate((-1.0, 1.0)):
                columns = parts + 3 * count * block + np.arange(3 * count)
                problem.put(translation + np.arange(3 * count), columns, sign)
            cost.append(self.delta_v_cost * np.tile(np.outer(sizes, 1.0 / unit[:3]).ravel(), 2))
            lower.append(np.zeros(6 * count))
            upper.append(np.full(6 * count, np.inf))
        balance = np.zeros(6 + 3 * count + 3 * count * priced)
        balance[:6] = row_scale * (self.target - to_end[0] @ start)
        answer, message = problem.optimum(
            np.concatenate(cost),
            (np.concatenate(lower), np.concatenate(upper)),
            (
                np.concatenate([np.full(end, -np.inf), balance]),
                np.concatenate([np.full(end, self.max_total_on_time), balance]),
            ),
        )
        if answer is None:
            raise RuntimeError(
                f"HiGHS found no rendezvous plan from {start.tolist()} in {steps} steps: {message}"
            )
        on_times: FloatArray = np.clip(answer[:short].reshape(count, n), least, model.max_on_time)
        return np.repeat(on_times, sizes, axis=0)

    def _coasting(self, steps: int) -> FloatArray:
        """(steps + 1, 6, 6): from the state at the start of each period, and at the end, to the end state."""
        missing = steps + 1 - len(self._powers)
        if missing > 0:
            powers = list(self._powers)
            for _ in range(missing):
                powers.append(powers[-1] @ self._transition)
            self._powers = np.stack(powers)
        return self._powers[steps::-1]

    def _groups(self, steps: int) -> NDArray[np.int64]:
        """How many periods each set of on-times serves: one each at first, `group` later."""
        if self.detailed_steps is None or steps <= self.detailed_steps:
            return np.ones(steps, np.int64)
        whole, rest = divmod(steps - self.detailed_steps, self.group)
        sizes = [1] * self.detailed_steps + [self.group] * whole + [rest] * (rest > 0)
        return np.array(sizes, np.int64)


class _Problem:
    """A linear program under construction: the entries of its matrix, in any order."""

    def __init__(self) -> None:
        self._rows: list[NDArray[np.int64]] = []
        self._columns: list[NDArray[np.int64]] = []
        self._values: list[FloatArray] = []

    def put(self, row: NDArray[np.int64], column: NDArray[np.int64], value: ArrayLike) -> None:
        """Set entries; row, column and value broadcast."""
        rows, columns, values = np.broadcast_arrays(row, column, np.asarray(value, dtype=np.float64))
        there = values != 0.0
        self._rows.append(rows[there])
        self._columns.append(columns[there])
        self._values.append(values[there])

    def optimum(
        self,
        cost: FloatArray,
        columns: tuple[FloatArray, FloatArray],
        rows: tuple[FloatArray, FloatArray],
    ) -> tuple[FloatArray | None, str]:
        """Least cost with columns and rows within (lower, upper); None and why, if HiGHS finds none."""
        entries = np.concatenate(self._rows), np.concatenate(self._columns)
        order = np.lexsort(entries)
        highs = highspy.Highs()  # type: ignore[no-untyped-call]  # highspy is typed in part
        highs.silent()
        problem = highspy.HighsLp()
        problem.num_col_, problem.num_row_ = cost.size, rows[0].size
        problem.col_cost_ = cost
        problem.col_lower_, problem.col_upper_ = columns
        problem.row_lower_, problem.row_upper_ = rows
        problem.a_matrix_.format_ = highspy.MatrixFormat.kColwise
        per_column = np.bincount(entries[1], minlength=cost.size)
        problem.a_matrix_.start_ = np.concatenate([[0], np.cumsum(per_column)])
        problem.a_matrix_.index_ = entries[0][order]
        problem.a_matrix_.value_ = np.concatenate(self._values)[order]
        highs.passModel(problem)
        highs.run()
        status = highs.getModelStatus()
        if status != highspy.HighsModelStatus.kOptimal:
            return None, highs.modelStatusToString(status)
        return np.array(highs.getSolution().col_value), ""


def _state(given: ArrayLike, name: str) -> FloatArray:
    values = np.array(given, dtype=np.float64)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise ValueError(f"{name} is {values.tolist()}; six finite numbers, m then m/s, would be right")
    return values
