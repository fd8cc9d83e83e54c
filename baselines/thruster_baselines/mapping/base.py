"""What all mappers here share: the checks at the door, and the forms in which a mapper can be written.

A mapper is a formula over a whole batch (`ClosedFormMapper`), a solver that takes one problem after the other
(`SolverMapper`), or a compiled kernel (`CompiledMapper`). The last two minimise
`fuel_cost @ on_times + slack_cost @ abs(slack)` in one way or another and so have weights (`WeightedMapper`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.model import (
    Model,
    matrix_times_vector,
    require_command_shape,
    require_finite_command,
)
from thruster_baselines.mapping.simplex import NOT_FINITE, OPTIMAL, solve_batch
from thruster_envs.construction import RecordsArguments
from thruster_envs.protocols import Allocation, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, objective_weights

__all__ = ["BaseMapper", "ClosedFormMapper", "CompiledMapper", "SolverMapper", "WeightedMapper"]


class BaseMapper(RecordsArguments, ABC):
    """A mapper that checks what a call brings and hands clean arrays on.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2; read-only.
        max_on_time: (n,), s; read-only.
        lost_directions: (k, m), rate changes that no firing gives; empty for a model of full rank.
    """

    def __init__(
        self, spacecraft: Spacecraft | str | Path | ArrayLike, max_on_time: ArrayLike | None = None
    ) -> None:
        self._model = Model.of(spacecraft, max_on_time)

    @property
    def effectiveness(self) -> FloatArray:
        """(m, n): rate change per second of firing, m/s^2 then rad/s^2."""
        return _read_only(self._model.effectiveness)

    @property
    def max_on_time(self) -> FloatArray:
        """(n,), s: the longest on-time of each thruster."""
        return _read_only(self._model.max_on_time)

    @property
    def lost_directions(self) -> FloatArray:
        """(k, m): unit vectors, in shares of authority, of what no firing gives; k is 0 for a full rank."""
        return self._model.lost_directions

    def __call__(
        self,
        command: ArrayLike,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
    ) -> Allocation:
        """Allocate a command (..., m), m/s then rad/s, body frame; see `thruster_envs.protocols.Mapper`.

        Raises:
            ValueError: A wrong shape, a command or effectiveness that is not finite, an on-time bound that
                is negative or NaN.
        """
        command = np.array(command, dtype=np.float64, order="C")  # a copy: contiguous and writeable
        require_command_shape(command, self._model.effectiveness.shape[0])
        require_finite_command(command)
        if effectiveness is None and max_on_time is None:
            return self._allocate(command, self._model)
        return self._allocate(command, self._model.overridden(effectiveness, max_on_time))

    @abstractmethod
    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        """Answer a checked command (..., m) under a checked model; leading axes broadcast."""


class ClosedFormMapper(BaseMapper):
    """A mapper that is a formula, worked out for a whole batch at once.

    A subclass works out what it needs to know of an effectiveness (`_prepare`), and from that the on-times of
    a command (`_on_times`), which are then clipped to what is possible.
    """

    def __init__(
        self, spacecraft: Spacecraft | str | Path | ArrayLike, max_on_time: ArrayLike | None = None
    ) -> None:
        super().__init__(spacecraft, max_on_time)
        self._prepared = self._prepare(self._model.effectiveness)

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        own = model.effectiveness is self._model.effectiveness
        prepared = self._prepared if own else self._prepare(model.effectiveness)
        on_times = np.clip(self._on_times(command, *prepared), 0.0, model.max_on_time)
        command = np.broadcast_to(command, (*on_times.shape[:-1], command.shape[-1]))
        return Allocation(
            on_times=on_times,
            slack=command - matrix_times_vector(model.effectiveness, on_times),
            cost=np.asarray(on_times.sum(axis=-1)),
            status=np.zeros(on_times.shape[:-1], np.int64),
        )

    @abstractmethod
    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        """What `_on_times` needs to know of an effectiveness (..., m, n)."""

    @abstractmethod
    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        """On-times (..., n) in s, not yet clipped, for a checked command (..., m)."""


class WeightedMapper(BaseMapper):
    """A mapper that weighs firing against missing.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss. The default is so large that
            tracking always comes before fuel; see `thruster_envs.spacecraft.objective_weights`.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Attributes:
        fuel_cost: (n,), per s; read-only.
        slack_cost: (m,), per m/s then per rad/s; read-only.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        *,
        fuel_may_win: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time)
        m, n = self._model.effectiveness.shape
        given = fuel_cost is not None or slack_cost is not None
        if fuel_cost is None or slack_cost is None:
            default_fuel, default_slack = objective_weights(self._model.effectiveness, 1.0)  # period cancels
            fuel_cost = default_fuel if fuel_cost is None else fuel_cost
            slack_cost = default_slack if slack_cost is None else slack_cost
        self._fuel_cost = _weights(fuel_cost, n, "fuel_cost of thruster", 1)
        self._slack_cost = _weights(slack_cost, m, "slack_cost of axis", 0)
        if given and not fuel_may_win:
            _require_tracking_first(self._model.effectiveness, self._fuel_cost, self._slack_cost)

    @property
    def fuel_cost(self) -> FloatArray:
        """(n,), per s of firing."""
        return _read_only(self._fuel_cost)

    @property
    def slack_cost(self) -> FloatArray:
        """(m,), per m/s then per rad/s of miss."""
        return _read_only(self._slack_cost)


class SolverMapper(WeightedMapper):
    """A mapper that hands one problem after the other to a solver."""

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        return one_by_one(self._solve, command, model)

    @abstractmethod
    def _solve(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, float, int]:
        """On-times (n,) in s, objective and status (0 for the optimum) of one problem."""


class CompiledMapper(WeightedMapper):
    """A mapper that is a compiled kernel over a batch, which threads may share.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
        *,
        fuel_may_win: bool = False,
    ) -> None:
        if threads is not None and threads < 1:
            raise ValueError(f"threads is {threads}; one or more, or None, would be right")
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, fuel_may_win=fuel_may_win)
        self._threads = threads

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        m, n = self._model.effectiveness.shape
        leading = leading_axes(command, model)
        on_times, slack, cost, report = self._run(
            whole(command, leading, (m,)).reshape(-1, m),
            each_or_shared(model.effectiveness, leading, (m, n)),
            each_or_shared(model.max_on_time, leading, (n,)),
        )
        return self._answer(
            on_times.reshape(*leading, n),
            slack.reshape(*leading, m),
            cost.reshape(leading),
            report.reshape(*leading, report.shape[-1]),
        )

    def _run(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Solve (batch, m) commands; effectiveness and bounds have a leading axis of batch or of 1.

        Returns:
            on_times (batch, n) in s, slack (batch, m) in command units, cost (batch,), and a report (batch,
            k) that begins with the status. Here they are those of the linear program.
        """
        costs = self._fuel_cost[np.newaxis]
        answer = solve_batch(command, effectiveness, max_on_time, costs, self._slack_cost, self._threads)
        raise_unless_optimal(command, answer.report)
        return answer

    def _answer(
        self, on_times: FloatArray, slack: FloatArray, cost: FloatArray, report: IntArray
    ) -> Allocation:
        """The allocation, all arrays in the shape of the call."""
        return Allocation(on_times, slack, cost, report[..., 0].copy())


def raise_unless_optimal(command: FloatArray, report: IntArray) -> None:
    """Raise the error that belongs to the reports (..., k) of a batch, unless all are of optima.

    Raises:
        ValueError: A command (..., m) that is not finite.
        RuntimeError: A solver that stopped before the optimum; says at which command, and after how much.
    """
    if not report[..., 0].any():
        return
    if (report[..., 0] == NOT_FINITE).any():
        require_finite_command(command)
    where = tuple(np.argwhere(report[..., 0] != OPTIMAL)[0].tolist())
    raise RuntimeError(
        f"the simplex method did not reach the optimum for the command {command[where].tolist()} in "
        f"{report[where][1]} changes of basis and {report[where][2]} of bound; effectiveness, bounds and "
        "costs within 12 orders of magnitude of each other would be right"
    )


def one_by_one(
    solve: Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, float, int]],
    command: FloatArray,
    model: Model,
) -> Allocation:
    """Solve the problems of a call one after the other.

    Args:
        solve: Takes a command (m,), an effectiveness (m, n) and longest on-times (n,); gives on-times (n,) in
            s, which are clipped to what is possible, an objective and a status.
        command: (..., m), m/s then rad/s.
        model: Leading axes broadcast against those of the command.
    """
    m, n = model.effectiveness.shape[-2:]
    leading = leading_axes(command, model)
    commands = np.broadcast_to(command, (*leading, m))
    matrices = np.broadcast_to(model.effectiveness, (*leading, m, n))
    bounds = np.broadcast_to(model.max_on_time, (*leading, n))
    on_times, cost, status = np.empty((*leading, n)), np.empty(leading), np.empty(leading, np.int64)
    for at in np.ndindex(leading):
        solution, cost[at], status[at] = solve(commands[at], matrices[at], bounds[at])
        on_times[at] = np.clip(solution, 0.0, bounds[at])
    slack = commands - matrix_times_vector(matrices, on_times)
    return Allocation(on_times, slack, cost, status)


def leading_axes(command: FloatArray, model: Model) -> tuple[int, ...]:
    """The batch axes of a call."""
    if model.effectiveness.ndim == 2 and model.max_on_time.ndim == 1:
        return command.shape[:-1]
    return np.broadcast_shapes(
        command.shape[:-1], model.effectiveness.shape[:-2], model.max_on_time.shape[:-1]
    )


def plain(array: FloatArray) -> FloatArray:
    """The array as a compiled kernel wants it, contiguous and writeable; copied only if it is not."""
    return array if array.flags.c_contiguous and array.flags.writeable else array.copy()


def each_or_shared(array: FloatArray, leading: tuple[int, ...], trailing: tuple[int, ...]) -> FloatArray:
    """The array with its leading axes made one: as long as the batch, or of length one if all share it."""
    if array.shape == trailing:
        return plain(array)[np.newaxis]
    return whole(array, leading, trailing).reshape(-1, *trailing)


def whole(array: FloatArray, leading: tuple[int, ...], trailing: tuple[int, ...]) -> FloatArray:
    """The array with all of these axes, fit for a compiled kernel."""
    shape = leading + trailing
    return plain(array) if array.shape == shape else np.broadcast_to(array, shape).copy()


def _weights(given: ArrayLike, size: int, what: str, first: int) -> FloatArray:
    """A cost vector from one number or one per entry; finite and not negative."""
    values = np.array(given, dtype=np.float64)
    if values.ndim == 0:
        values = np.full(size, values)
    if values.shape != (size,):
        raise ValueError(f"{what.split()[0]} has the shape {values.shape}; ({size},) would be right")
    valid = np.isfinite(values) & (values >= 0.0)
    if not valid.all():
        index = int(np.argmin(valid))
        raise ValueError(
            f"{what} {index + first} is {values[index]}; a finite number, zero or more, would be right"
        )
    return values


_EXACT = 1e6
"""How much dearer a miss is made to find out what serving an axis takes in fuel alone."""


def _require_tracking_first(effectiveness: FloatArray, fuel_cost: FloatArray, slack_cost: FloatArray) -> None:
    """Raise ValueError if some rate change along one axis costs more fuel than missing it would.

    Directions that no firing gives are passed over; no price of a miss could help there.
    """
    m, n = effectiveness.shape
    largest = np.abs(effectiveness).max(axis=1)
    unit = np.where(largest > 0.0, largest, 1.0)  # one second of the strongest thruster
    commands = np.concatenate([np.diag(unit), np.diag(-unit)])
    _, slack, cost, report = solve_batch(
        commands, effectiveness[np.newaxis], np.full((1, n), np.inf), fuel_cost[np.newaxis],
        _EXACT * np.maximum(slack_cost, fuel_cost.max() / unit),
    )  # fmt: skip
    served = (report[:, 0] == OPTIMAL) & (np.abs(slack) <= 1e-9 * unit).all(axis=1)
    price = np.where(served, cost, 0.0).reshape(2, m) / unit
    axis = int(np.argmax(price.max(axis=0) / np.maximum(slack_cost, np.finfo(np.float64).tiny)))
    dearest = float(price[:, axis].max())
    if dearest > slack_cost[axis] * (1.0 + 1e-9):
        raise ValueError(
            f"slack_cost of axis {axis} is {slack_cost[axis]:g} while serving that axis costs up to "
            f"{dearest:g} of fuel, so that fuel would win over tracking; above {dearest:g}, or "
            "fuel_may_win=True, would be right"
        )


def _read_only(array: FloatArray) -> FloatArray:
    view = array.view()
    view.setflags(write=False)
    return view
