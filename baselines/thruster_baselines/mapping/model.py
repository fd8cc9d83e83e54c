"""What all mappers here share: the model that a mapper believes in, and the checks on what a call brings.

A model is an effectiveness matrix with a longest on-time per thruster. It comes from a spacecraft or as a
bare matrix, and a call may override it. Bad input raises one line that names the thruster or axis and the
value.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.protocols import Allocation, FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["ClosedFormMapper", "Model", "matrix_times_vector"]


@dataclass(frozen=True, slots=True)
class Model:
    """What thrusters do and how long they may fire.

    Attributes:
        effectiveness: (..., m, n), rate change per second of firing, m/s^2 then rad/s^2.
        max_on_time: (..., n), s.
    """

    effectiveness: FloatArray
    max_on_time: FloatArray

    @classmethod
    def of(cls, spacecraft: Spacecraft | str | Path | ArrayLike, max_on_time: ArrayLike | None) -> Model:
        """The model of a spacecraft, or of a bare effectiveness matrix (m, n).

        Args:
            spacecraft: Description, name in the catalogue, path of a TOML file, or matrix in m/s^2 then
                rad/s^2.
            max_on_time: (n,) or one number for all thrusters, s; a spacecraft's default is its control
                period.

        Raises:
            ValueError: A matrix that is not two-dimensional or not finite; a bound that is missing, NaN or
                negative.
        """
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        if isinstance(spacecraft, Spacecraft):
            matrix = spacecraft.effectiveness()
            max_on_time = spacecraft.control_period if max_on_time is None else max_on_time
        else:
            matrix = np.array(spacecraft, dtype=np.float64)
        if matrix.ndim != 2 or 0 in matrix.shape:
            raise ValueError(f"effectiveness has the shape {matrix.shape}; (axes, thrusters) would be right")
        if max_on_time is None:
            raise ValueError("max_on_time is missing; with a bare matrix, a number of s has to be given")
        bounds = np.array(max_on_time, dtype=np.float64)
        if bounds.ndim == 0:
            bounds = np.full(matrix.shape[1], bounds)
        if bounds.shape != (matrix.shape[1],):
            raise ValueError(
                f"max_on_time has the shape {bounds.shape}; ({matrix.shape[1]},), one per thruster, "
                "would be right"
            )
        require_finite_effectiveness(matrix)
        require_valid_bounds(bounds)
        return cls(matrix, bounds)

    def overridden(self, effectiveness: ArrayLike | None, max_on_time: ArrayLike | None) -> Model:
        """This model with what a call brought in its place; leading axes are kept.

        Raises:
            ValueError: Trailing axes other than this model's; a value that is NaN, infinite (effectiveness)
                or negative (on-times).
        """
        matrix, bounds = self.effectiveness, self.max_on_time
        if effectiveness is not None:
            matrix = np.asarray(effectiveness, dtype=np.float64)
            if matrix.shape[-2:] != self.effectiveness.shape:
                m, n = self.effectiveness.shape
                raise ValueError(
                    f"effectiveness has the shape {matrix.shape}; (..., {m}, {n}) would be right"
                )
            require_finite_effectiveness(matrix)
        if max_on_time is not None:
            bounds = np.asarray(max_on_time, dtype=np.float64)
            if bounds.shape[-1:] != self.max_on_time.shape:
                n = self.max_on_time.size
                raise ValueError(f"max_on_time has the shape {bounds.shape}; (..., {n}) would be right")
            require_valid_bounds(bounds)
        return Model(matrix, bounds)


def require_finite_effectiveness(matrix: FloatArray) -> None:
    """Raise ValueError naming the first entry of an effectiveness (..., m, n) that is not finite."""
    finite = np.isfinite(matrix)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(
            f"effectiveness of thruster {where[-1] + 1} on axis {where[-2]}{_in_batch(where[:-2])} is "
            f"{matrix[where]}; a finite number would be right"
        )


def require_valid_bounds(bounds: FloatArray) -> None:
    """Raise ValueError naming the first longest on-time of (..., n), s, that is negative or NaN."""
    valid = bounds >= 0.0
    if not valid.all():
        where = tuple(int(i) for i in np.argwhere(~valid)[0])
        raise ValueError(
            f"max_on_time of thruster {where[-1] + 1}{_in_batch(where[:-1])} is {bounds[where]} s; "
            "zero or more would be right"
        )


def require_command_shape(command: FloatArray, axes: int) -> None:
    """Raise ValueError unless the command is (..., axes)."""
    if command.shape[-1:] != (axes,):
        raise ValueError(f"command has the shape {command.shape}; (..., {axes}) would be right")


def require_finite_command(command: FloatArray) -> None:
    """Raise ValueError naming the first entry of a command (..., m) that is not finite."""
    finite = np.isfinite(command)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(
            f"command on axis {where[-1]}{_in_batch(where[:-1])} is {command[where]}; "
            "a finite number would be right"
        )


def _in_batch(index: tuple[int, ...]) -> str:
    return f" in problem {index if len(index) > 1 else index[0]}" if index else ""


def matrix_times_vector(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Products (..., rows) of matrices (..., rows, columns) and vectors (..., columns)."""
    product: FloatArray = np.einsum("...rc,...c->...r", matrix, vector)
    return product


def allocation_with_total_on_time(command: FloatArray, model: Model, on_times: FloatArray) -> Allocation:
    """The allocation of a mapper without an objective of its own: its cost is the total on-time, s."""
    slack = command - matrix_times_vector(model.effectiveness, on_times)
    return Allocation(
        on_times=on_times,
        slack=slack,
        cost=np.asarray(on_times.sum(axis=-1)),
        status=np.zeros(on_times.shape[:-1], np.int64),
    )


class ClosedFormMapper(ABC):
    """A mapper that is a formula: it checks the call, and a subclass says which on-times it gives.

    A subclass works out what it needs to know of an effectiveness (`_prepare`), and from that the on-times of
    a command (`_on_times`), which are then clipped to what is possible.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2; read-only.
        max_on_time: (n,), s; read-only.
    """

    def __init__(
        self, spacecraft: Spacecraft | str | Path | ArrayLike, max_on_time: ArrayLike | None = None
    ) -> None:
        self._model = Model.of(spacecraft, max_on_time)
        self._model.effectiveness.setflags(write=False)
        self._model.max_on_time.setflags(write=False)
        self._prepared = self._prepare(self._model.effectiveness)

    @property
    def effectiveness(self) -> FloatArray:
        """(m, n): rate change per second of firing, m/s^2 then rad/s^2."""
        return self._model.effectiveness

    @property
    def max_on_time(self) -> FloatArray:
        """(n,), s: the longest on-time of each thruster."""
        return self._model.max_on_time

    def __call__(
        self,
        command: ArrayLike,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
    ) -> Allocation:
        """Allocate a command (..., m), m/s then rad/s, body frame; see `thruster_envs.protocols.Mapper`.

        Raises:
            ValueError: A wrong shape, or a value that is not finite or (on-times) negative.
        """
        command = np.array(command, dtype=np.float64)
        require_command_shape(command, self.effectiveness.shape[0])
        require_finite_command(command)
        model = self._model.overridden(effectiveness, max_on_time)
        prepared = self._prepared if effectiveness is None else self._prepare(model.effectiveness)
        on_times = np.clip(self._on_times(command, *prepared), 0.0, model.max_on_time)
        command = np.broadcast_to(command, (*on_times.shape[:-1], command.shape[-1]))
        return allocation_with_total_on_time(command, model, on_times)

    @abstractmethod
    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        """What `_on_times` needs to know of an effectiveness (..., m, n)."""

    @abstractmethod
    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        """On-times (..., n) in s, not yet clipped, for a checked command (..., m)."""
