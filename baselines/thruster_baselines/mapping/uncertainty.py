"""What the robust mappers share: the form of their answer, and how a spread of the effectiveness is stated.

A robust mapper minimises `fuel_cost @ on_times + slack_cost @ worst_miss`, where the worst miss of an axis is
the largest difference between command and achievement over all that the mapper was told may happen. Axes are
judged one by one: the worst of one axis and the worst of another need not happen together (Yang 2003,
ch. 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.protocols import Allocation, FloatArray

__all__ = ["RobustAllocation", "spread_at", "stated_spread"]


@dataclass(frozen=True, slots=True)
class RobustAllocation(Allocation):
    """An allocation that also says how far off each axis may end up.

    `slack` is, as for every mapper, the command minus what the on-times achieve under the nominal model;
    `cost` is the mapper's own objective, which counts the worst miss in place of the slack.

    Attributes:
        worst_miss: (..., m), command units (m/s, then rad/s), zero or more: the largest miss of each axis
            over the stated uncertainty (`ChanceConstrainedMapper`: with the stated probability).
    """

    worst_miss: FloatArray


def stated_spread(given: ArrayLike, axes: int, thrusters: int, name: str) -> FloatArray:
    """The spread of an effectiveness as it was stated, checked.

    Args:
        given: One number or (n,), a share of each thruster's nominal effectiveness; or (axes, n), m/s^2 then
            rad/s^2.
        axes: m.
        thrusters: n.
        name: What the caller calls it, for the error.

    Returns:
        (n,), shares, or (m, n), units of the effectiveness; see `spread_at`.

    Raises:
        ValueError: Another shape; an entry that is negative or not finite.
    """
    spread = np.array(given, dtype=np.float64)
    if spread.ndim == 0:
        spread = np.full(thrusters, spread)
    if spread.shape not in ((thrusters,), (axes, thrusters)):
        raise ValueError(
            f"{name} has the shape {spread.shape}; one number, ({thrusters},) for shares, or "
            f"({axes}, {thrusters}) for units of the effectiveness, would be right"
        )
    valid = np.isfinite(spread) & (spread >= 0.0)
    if not valid.all():
        where = tuple(int(i) for i in np.argwhere(~valid)[0])
        axis = f" on axis {where[0]}" if spread.ndim == 2 else ""
        raise ValueError(
            f"{name} of thruster {where[-1] + 1}{axis} is {spread[where]}; a finite number, zero or more, "
            "would be right"
        )
    return spread


def spread_at(effectiveness: FloatArray, stated: FloatArray) -> FloatArray:
    """The spread (..., m, n) of an effectiveness (..., m, n), in its units; shares go with it."""
    if stated.ndim == 1:
        return np.abs(effectiveness) * stated
    return np.broadcast_to(stated, effectiveness.shape)
