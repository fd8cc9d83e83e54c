"""The robust linear program for a command that is known only to lie in a box.

It minimises `fuel_cost @ on_times + slack_cost @ worst_miss`, where the worst miss of an axis is the largest
difference between what is achieved and any command of the box (Yang 2003, eqs. 18-23). With the middle and
the half width of the box, the worst miss of axis k is

    max(A_k x - low_k, high_k - A_k x) = |A_k x - middle_k| + half_width_k,

so the program is the plain one for the middle of the box, and as fast. An interval that is symmetric about
the command changes nothing: the plain linear program is already the robust one.

Exact for each axis, and for errors that are independent from axis to axis. Conservative where the errors
are tied to each other, as those of an attitude error are: the box holds commands that cannot happen.
Uncertainty of what thrusters do is in `RobustEffectivenessMapper`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.attitude_uncertainty import AttitudeUncertainty
from thruster_baselines.mapping.base import CompiledMapper
from thruster_baselines.mapping.model import Model, matrix_times_vector
from thruster_baselines.mapping.uncertainty import RobustAllocation
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["RobustCommandMapper"]


class RobustCommandMapper(CompiledMapper):
    """Maps the middle of what the command may be, and says how far off the rest of it is.

    A call takes a command, and its interval is what the mapper was told: from `below` less to `above` more,
    around what an attitude error may make of it. `within` takes the intervals themselves, and `among` the
    commands that are possible.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of worst miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        below: (m,) or one number, m/s then rad/s: by how much the true command may be less.
        above: (m,) or one number, m/s then rad/s: by how much it may be more.
        attitude: Attitude errors that may have turned the command; m has to be 3 or 6.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> mapper = RobustCommandMapper([[1.0, -1.0]], max_on_time=5.0, below=0.0, above=0.5)
    >>> answer = mapper([2.0])
    >>> answer.on_times, answer.slack, answer.worst_miss
    (array([2.25, 0.  ]), array([-0.25]), array([0.25]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
        *,
        below: ArrayLike = 0.0,
        above: ArrayLike = 0.0,
        attitude: AttitudeUncertainty | None = None,
        fuel_may_win: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, threads, fuel_may_win=fuel_may_win)
        axes = self._model.effectiveness.shape[0]
        if attitude is not None and axes % 3:
            raise ValueError(f"attitude is given for {axes} axes; 3 or 6 axes would be right")
        self._below = _margin(below, axes, "below")
        self._above = _margin(above, axes, "above")
        self._attitude = attitude

    def interval(self, command: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Between what a command (..., m) may truly be: low and high, each (..., m), m/s then rad/s."""
        low = high = np.asarray(command, dtype=np.float64)
        if self._attitude is not None:
            low, high = self._attitude.interval(low)
        return low - self._below, high + self._above

    def within(
        self,
        low: ArrayLike,
        high: ArrayLike,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
    ) -> RobustAllocation:
        """Allocate for commands between low and high; the slack is that of the middle.

        Args:
            low: (..., m), m/s then rad/s.
            high: (..., m), not less than low.
            effectiveness: (..., m, n), in place of the mapper's own for this call.
            max_on_time: (..., n), s, in place of the mapper's own for this call.

        Raises:
            ValueError: A wrong shape, a value that is not finite, a low above its high.
        """
        axes = self._model.effectiveness.shape[0]
        low, high = np.broadcast_arrays(_checked(low, axes, "low"), _checked(high, axes, "high"))
        ordered = low <= high
        if not ordered.all():
            where = tuple(int(i) for i in np.argwhere(~ordered)[0])
            raise ValueError(
                f"low on axis {where[-1]} is {low[where]}; at most high, {high[where]}, would be right"
            )
        return self._for_box(
            low, high, low + 0.5 * (high - low), self._model.overridden(effectiveness, max_on_time)
        )

    def among(
        self,
        candidates: ArrayLike,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
    ) -> RobustAllocation:
        """Allocate for the smallest box that holds all candidates (count, ..., m); see `within`.

        Raises:
            ValueError: No candidate, a wrong shape, a value that is not finite.
        """
        axes = self._model.effectiveness.shape[0]
        commands = _checked(candidates, axes, "candidates")
        if commands.ndim < 2 or commands.shape[0] == 0:
            raise ValueError(
                f"candidates has the shape {commands.shape}; (count, ..., {axes}), one or more, would be "
                "right"
            )
        return self.within(
            commands.min(axis=0), commands.max(axis=0), effectiveness=effectiveness, max_on_time=max_on_time
        )

    def _allocate(self, command: FloatArray, model: Model) -> RobustAllocation:
        low, high = self.interval(command)
        return self._for_box(low, high, command, model)

    def _for_box(
        self, low: FloatArray, high: FloatArray, command: FloatArray, model: Model
    ) -> RobustAllocation:
        half_width = 0.5 * (high - low)
        answer = super()._allocate(low + half_width, model)
        return RobustAllocation(
            on_times=answer.on_times,
            slack=command - matrix_times_vector(model.effectiveness, answer.on_times),
            cost=np.asarray(answer.cost + half_width @ self._slack_cost),
            status=answer.status,
            worst_miss=np.abs(answer.slack) + half_width,
        )


def _margin(given: ArrayLike, axes: int, name: str) -> FloatArray:
    """By how much a command may be off, (m,), from one number or one per axis."""
    margin = np.array(given, dtype=np.float64)
    if margin.ndim == 0:
        margin = np.full(axes, margin)
    if margin.shape != (axes,):
        raise ValueError(f"{name} has the shape {margin.shape}; one number or ({axes},) would be right")
    valid = np.isfinite(margin) & (margin >= 0.0)
    if not valid.all():
        axis = int(np.argmin(valid))
        raise ValueError(
            f"{name} on axis {axis} is {margin[axis]}; a finite number, zero or more, would be right"
        )
    return margin


def _checked(given: ArrayLike, axes: int, name: str) -> FloatArray:
    """Commands (..., m), finite."""
    commands = np.array(given, dtype=np.float64)
    if commands.shape[-1:] != (axes,):
        raise ValueError(f"{name} has the shape {commands.shape}; (..., {axes}) would be right")
    finite = np.isfinite(commands)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(f"{name} on axis {where[-1]} is {commands[where]}; a finite number would be right")
    return commands
