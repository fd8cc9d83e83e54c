"""The linear-programming mapper: least fuel where a command can be tracked, least miss where it cannot.

It minimises `fuel_cost @ on_times + slack_cost @ abs(slack)` over 0 <= on_times <= max_on_time, where slack
is the commanded minus the achieved rate change (Yang 2003, eqs. 1-3). Simultaneous firings are taken as
independent: the thrust that they cost each other through a shared feed is not in the model.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping import model as checks
from thruster_baselines.mapping.simplex import NOT_FINITE, OPTIMAL, solve_batch, solve_range
from thruster_envs.protocols import Allocation, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, objective_weights

__all__ = ["LPMapper"]


class LPMapper:
    """Maps commanded rate changes to thruster on-times by a linear program, solved exactly.

    The answer is a vertex of the feasible set: at most as many thrusters as axes are open for part of the
    period, the others not at all or for all of it. One command or a batch of any shape; a batch gives, bit
    for bit, what its commands give one by one.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period. May be infinite.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss. The default is so large that
            tracking always comes before fuel; see `thruster_envs.spacecraft.objective_weights`.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2; read-only.
        max_on_time: (n,), s; read-only.
        fuel_cost: (n,), per s; read-only.
        slack_cost: (m,), per m/s then per rad/s; read-only.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> from thruster_envs.spacecraft import load
    >>> allocation = LPMapper(load("orion"))([-0.027, -0.027, 0.0, 0.0, 0.0, 0.0])
    >>> allocation.on_times.round(9)
    array([4.5, 0. , 0. , 0. , 0. , 4.5, 0. , 0. , 0. , 4.5, 0. , 4.5])
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
    ) -> None:
        if threads is not None and threads < 1:
            raise ValueError(f"threads is {threads}; one or more, or None, would be right")
        self._model = checks.Model.of(spacecraft, max_on_time)
        m, n = self._model.effectiveness.shape
        if fuel_cost is None or slack_cost is None:
            default_fuel, default_slack = objective_weights(self._model.effectiveness, 1.0)  # period cancels
            fuel_cost = default_fuel if fuel_cost is None else fuel_cost
            slack_cost = default_slack if slack_cost is None else slack_cost
        self._fuel_cost = _weights(fuel_cost, n, "fuel_cost of thruster", 1)
        self._slack_cost = _weights(slack_cost, m, "slack_cost of axis", 0)
        self._threads = threads
        self._single = (m,)
        self._alone = self._model.effectiveness[np.newaxis], self._model.max_on_time[np.newaxis]

    @property
    def effectiveness(self) -> FloatArray:
        """(m, n): rate change per second of firing, m/s^2 then rad/s^2."""
        return _read_only(self._model.effectiveness)

    @property
    def max_on_time(self) -> FloatArray:
        """(n,), s: the longest on-time of each thruster."""
        return _read_only(self._model.max_on_time)

    @property
    def fuel_cost(self) -> FloatArray:
        """(n,), per s of firing."""
        return _read_only(self._fuel_cost)

    @property
    def slack_cost(self) -> FloatArray:
        """(m,), per m/s then per rad/s of miss."""
        return _read_only(self._slack_cost)

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
            RuntimeError: The solver did not reach the optimum; not known to happen.
        """
        command = np.array(command, dtype=np.float64, order="C")  # a copy: contiguous and writeable
        if effectiveness is None and max_on_time is None:
            model, alone = self._model, self._alone
        else:
            model = self._model.overridden(effectiveness, max_on_time)
            alone = None
        if command.shape == self._single and model.effectiveness.ndim == 2 and model.max_on_time.ndim == 1:
            if alone is None:
                alone = _plain(model.effectiveness)[np.newaxis], _plain(model.max_on_time)[np.newaxis]
            return self._solve_one(command, *alone)
        checks.require_command_shape(command, self._single[0])
        return self._solve_batch(command, model)

    def _solve_one(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> Allocation:
        """One command (m,), as a batch of one."""
        _, m, n = effectiveness.shape
        on_times, slack, cost, status = np.empty((1, n)), np.empty((1, m)), np.empty(1), np.empty(1, np.int64)
        fuel_cost, slack_cost = self._fuel_cost, self._slack_cost
        solve_range(
            command[np.newaxis], effectiveness, max_on_time, fuel_cost, slack_cost,
            on_times, slack, cost, status, 0, 1,
        )  # fmt: skip
        if status[0] != OPTIMAL:
            _explain(command, status)
        return Allocation(on_times[0], slack[0], cost.reshape(()), status.reshape(()))

    def _solve_batch(self, command: FloatArray, model: checks.Model) -> Allocation:
        m, n = self._model.effectiveness.shape
        leading = np.broadcast_shapes(
            command.shape[:-1], model.effectiveness.shape[:-2], model.max_on_time.shape[:-1]
        )
        on_times, slack, cost, status = solve_batch(
            _whole(command, leading, (m,)).reshape(-1, m),
            _each_or_shared(model.effectiveness, leading, (m, n)),
            _each_or_shared(model.max_on_time, leading, (n,)),
            self._fuel_cost,
            self._slack_cost,
            self._threads,
        )
        if status.any():
            _explain(np.broadcast_to(command, (*leading, m)), status.reshape(leading))
        return Allocation(
            on_times.reshape(*leading, n),
            slack.reshape(*leading, m),
            cost.reshape(leading),
            status.reshape(leading),
        )


def _each_or_shared(array: FloatArray, leading: tuple[int, ...], trailing: tuple[int, ...]) -> FloatArray:
    """The array with its leading axes made one: as long as the batch, or of length one if all share it."""
    if array.shape == trailing:
        return _plain(array)[np.newaxis]
    return _whole(array, leading, trailing).reshape(-1, *trailing)


def _whole(array: FloatArray, leading: tuple[int, ...], trailing: tuple[int, ...]) -> FloatArray:
    """The array with all of these axes, fit for the compiled kernel."""
    shape = leading + trailing
    return _plain(array) if array.shape == shape else np.broadcast_to(array, shape).copy()


def _plain(array: FloatArray) -> FloatArray:
    """The array as the compiled kernel wants it, contiguous and writeable; copied only if it is not."""
    return array if array.flags.c_contiguous and array.flags.writeable else array.copy()


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


def _read_only(array: FloatArray) -> FloatArray:
    view = array.view()
    view.setflags(write=False)
    return view


def _explain(command: FloatArray, status: IntArray) -> None:
    """Raise the error that belongs to the statuses of a batch of which not all are optimal."""
    if (status == NOT_FINITE).any():
        checks.require_finite_command(command)
    where = np.argwhere(status != OPTIMAL)[0].tolist()
    at = command if command.ndim == 1 else command[tuple(where)]
    raise RuntimeError(
        f"the simplex method did not reach the optimum for the command {at.tolist()}; effectiveness, bounds "
        "and costs within 12 orders of magnitude of each other would be right"
    )
