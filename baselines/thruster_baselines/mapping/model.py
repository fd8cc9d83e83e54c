"""The model that a mapper believes in, and the checks on what a call brings.

A model is an effectiveness matrix with a longest on-time per thruster. It comes from a spacecraft or as a
bare matrix, and a call may override it. Bad input raises one line that names the thruster or axis and the
value.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["LostDirectionsWarning", "Model", "matrix_times_vector"]

_OUTSIDE = 5  # frames from the warning to who makes a mapper
_RANK_TOLERANCE = 1e-10  # singular values of the weighed matrix below this share of the largest are zero


class LostDirectionsWarning(UserWarning):
    """A mapper was made for thrusters that leave some rate changes out of reach."""


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
        model = cls(matrix, bounds)
        model.say_what_is_lost()
        return model

    @property
    def lost_directions(self) -> FloatArray:
        """(k, m): unit vectors of the rate changes that no firing gives, k being m less the rank.

        Only for a single matrix. Axes are weighed by their largest effectiveness, so that the vectors are
        shares of authority; an axis on which nothing acts is a lost direction of its own.
        """
        largest = np.abs(self.effectiveness).max(axis=-1)
        weight = np.where(largest > 0.0, 1.0 / np.where(largest > 0.0, largest, 1.0), 0.0)
        left, values, _ = np.linalg.svd(self.effectiveness * weight[:, np.newaxis])
        rank = int((values > _RANK_TOLERANCE * values.max(initial=0.0)).sum())
        directions: FloatArray = left[:, rank:].T.copy()
        return directions

    def say_what_is_lost(self) -> None:
        """Warn (`LostDirectionsWarning`) if some rate changes are out of reach, and name them."""
        lost = self.lost_directions
        if len(lost):
            named = "; ".join(
                " ".join(f"{share:+.2g} on axis {k}" for k, share in enumerate(row) if abs(share) > 5e-3)
                for row in lost
            )
            warnings.warn(
                f"effectiveness has rank {len(self.effectiveness) - len(lost)} of {len(self.effectiveness)}: "
                f"no firing gives {named} (shares of authority)",
                LostDirectionsWarning,
                stacklevel=_OUTSIDE,
            )

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
