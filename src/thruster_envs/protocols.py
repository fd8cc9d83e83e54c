"""What a method must offer so that a comparison need not know which kind it is running.

A mapper turns a commanded body rate change into thruster on-times: the linear program, a pseudo-inverse and a
trained network stand behind the same call. Left out on purpose: how a mapper learns of a fault. Whoever knows
better than the model that a mapper was built with passes `effectiveness` or `max_on_time` with the call.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Allocation", "FloatArray", "IntArray", "Mapper"]

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Allocation:
    """On-times for one commanded rate change, or for a batch of them. Leading axes are those of the command.

    Attributes:
        on_times: (..., n), s. How long each thruster is open in the control period.
        slack: (..., m), command units (m/s, then rad/s), signed: what was commanded minus what these on-times
            achieve
            under the model that the mapper was given.
        cost: (...,). The mapper's own objective at these on-times; one without an objective gives the total
            on-time, s.
        status: (...,). 0 where the mapper reached its own optimum (closed-form mappers always do).
    """

    on_times: FloatArray
    slack: FloatArray
    cost: FloatArray
    status: IntArray


class Mapper(Protocol):
    """Turns a commanded body-frame rate change into thruster on-times."""

    @property
    def effectiveness(self) -> FloatArray:
        """(m, n): rate change per second of firing, m/s^2 then rad/s^2, that the mapper believes in."""
        ...

    @property
    def max_on_time(self) -> FloatArray:
        """(n,), s: the longest on-time of each thruster in one period."""
        ...

    def __call__(
        self,
        command: ArrayLike,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
    ) -> Allocation:
        """Allocate a command (..., m), body frame, m/s then rad/s.

        `effectiveness` (..., m, n) and `max_on_time` (..., n), where given, replace the mapper's own for this
        call;
        leading axes broadcast against those of the command.
        """
        ...
