"""What one period misses is added to the command of the next.

After each command, the remainder is what was commanded so far minus what the on-times of the mapper within
give: its slack. It is added to the next command. So a mapper that cannot give small commands one by one gives
them in the sum, and the error does not grow with the number of commands.

A remainder that cannot be worked off (a lost axis, a command beyond the authority again and again) grows
without end, and a controller that feeds back what is measured asks for the same again: a bound stops that.

Left out: any knowledge of what was really delivered; the remainder is that of the mapper's own model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.wrapping import Memory, RememberingMapper
from thruster_envs.protocols import Allocation, FloatArray, Mapper

__all__ = ["CarryingMapper"]


class CarryingMapper(RememberingMapper):
    """Carries what a command misses over to the next one.

    It takes commands (m,) or (steps, m) of one craft, or ([steps,] worlds, m) of several that fly side by
    side; steps in their order.

    Args:
        mapper: The mapper within, without a memory; one that says what it misses, such as
            `MinimumPulseMapper` or `TruncatingMapper`.
        worlds: How many craft fly side by side, each with its own remainder; None for one.
        limit: Largest remainder, (m,) or one number, in shares of the authority per axis (the largest rate
            change that the thrusters which help can give in their longest on-times); what is beyond it is
            given up. None for no bound.

    Attributes:
        remainder: (m,) or (worlds, m), m/s then rad/s: what is added to the next command; a copy.
        largest_remainder: (m,), m/s then rad/s: its bound on each axis; infinite without one.

    `slack` is the miss of each command alone, without what was carried over; `cost` and `status` are those of
    the mapper within for the command and the remainder together.

    >>> from thruster_baselines.mapping import LPMapper, TruncatingMapper
    >>> mapper = CarryingMapper(TruncatingMapper(LPMapper([[1.0, -1.0]], max_on_time=1.0), 0.01))
    >>> mapper([[0.004], [0.004], [0.004], [0.004]]).on_times[:, 0], mapper.remainder
    (array([0.   , 0.   , 0.012, 0.   ]), array([0.004]))
    """

    _within = "MinimumPulseMapper(spacecraft)"

    def __init__(self, mapper: Mapper, worlds: int | None = None, *, limit: ArrayLike | None = None) -> None:
        super().__init__(mapper, worlds)
        self.largest_remainder = _largest_remainder(self._model, limit)

    @property
    def remainder(self) -> FloatArray:
        """(m,) or (worlds, m): what is added to the next command, m/s then rad/s; a copy."""
        return self._memory["remainder"].copy()

    def _nothing(self) -> Memory:
        return {"remainder": np.zeros((*self._craft, self._model.effectiveness.shape[0]))}

    def _step(self, command: FloatArray, model: Model, memory: Memory) -> tuple[Allocation, Memory]:
        owed = memory["remainder"]
        found = self._ask(command + owed, model)
        left = np.clip(found.slack, -self.largest_remainder, self.largest_remainder)
        return (
            Allocation(found.on_times, found.slack - owed, found.cost, found.status),
            {"remainder": left},
        )


def _largest_remainder(model: Model, limit: ArrayLike | None) -> FloatArray:
    """Bounds (m,) in command units, read-only, from shares of authority."""
    m = model.effectiveness.shape[0]
    bounds = np.full(m, np.inf)
    if limit is not None:
        shares = np.array(limit, dtype=np.float64)
        if shares.ndim == 0:
            shares = np.full(m, shares)
        if shares.shape != (m,):
            raise ValueError(f"limit has the shape {shares.shape}; ({m},) would be right")
        valid = np.isfinite(shares) & (shares >= 0.0)
        if not valid.all():
            axis = int(np.argmin(valid))
            raise ValueError(
                f"limit of axis {axis} is {shares[axis]}; a finite share of authority, zero or more, "
                "would be right"
            )
        acting = model.effectiveness != 0.0
        longest = np.where(acting, model.max_on_time, 0.0)
        reach = model.effectiveness * longest
        authority = np.maximum(np.maximum(reach, 0.0).sum(axis=1), np.maximum(-reach, 0.0).sum(axis=1))
        bounds = np.multiply(shares, authority, out=np.zeros(m), where=shares > 0.0)
    bounds.setflags(write=False)
    return bounds
