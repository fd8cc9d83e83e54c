"""What valves with a shortest pulse make of any mapper's on-times: those that are too short are left out.

A pulse shorter than the minimum opens no valve. A mapper that does not know this believes that it delivered
what it did not; this wrapper leaves such pulses out and says what is missing. Carried over to the next
command (`thruster_baselines.mapping.carrying`), the missing part is made up for as soon as it is worth a
pulse, for no more fuel than the mapper within asks for.

Left out: rounding up a pulse that is nearly long enough, and finding the on-times that miss least
(`thruster_baselines.mapping.minimum_pulse` does).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.lp import LPMapper
from thruster_baselines.mapping.minimum_pulse import minimum_pulses, pulse_lengths
from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.wrapping import WrappingMapper, achieved_rate_change
from thruster_envs.protocols import Allocation, FloatArray, Mapper
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["TruncatingMapper", "within_and_pulse"]


class TruncatingMapper(WrappingMapper):
    """Leaves out what is shorter than a minimum pulse.

    Args:
        mapper: The mapper within, without a memory; or a spacecraft, of which it is then the `LPMapper`.
        minimum_pulse: (n,) or one number, s; a spacecraft's default is that of its thrusters.

    Raises:
        ValueError: With a mapper, a missing minimum pulse.

    `cost` is the total on-time, s; `status` is that of the mapper within.

    >>> from thruster_baselines.mapping import LPMapper
    >>> allocation = TruncatingMapper(LPMapper([[1.0, -1.0]], max_on_time=1.0), 0.01)([0.004])
    >>> allocation.on_times, allocation.slack
    (array([0., 0.]), array([0.004]))
    """

    def __init__(
        self, mapper: Mapper | Spacecraft | str | Path, minimum_pulse: ArrayLike | None = None
    ) -> None:
        mapper, minimum_pulse = within_and_pulse(mapper, minimum_pulse)
        super().__init__(mapper)
        self.minimum_pulse = pulse_lengths(minimum_pulse, self._model.max_on_time.size, "minimum_pulse")

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        asked = self._ask(command, model)
        on_times = np.where(asked.on_times >= self.minimum_pulse, asked.on_times, 0.0)
        slack = command - achieved_rate_change(model.effectiveness, on_times)
        return Allocation(on_times, slack, np.asarray(on_times.sum(axis=-1)), asked.status)


def within_and_pulse(
    mapper: Mapper | Spacecraft | str | Path, minimum_pulse: ArrayLike | None
) -> tuple[Mapper, ArrayLike]:
    """A mapper and a minimum pulse, s, where either may be left to a spacecraft.

    Raises:
        ValueError: A mapper without a minimum pulse.
    """
    if isinstance(mapper, Spacecraft | str | Path):
        craft = load(mapper)
        return LPMapper(craft), minimum_pulses(craft) if minimum_pulse is None else minimum_pulse
    if minimum_pulse is None:
        raise ValueError(
            "minimum_pulse is missing; give a number of s beside a mapper, such as "
            "minimum_pulses(spacecraft), or the spacecraft in the mapper's place"
        )
    return mapper, minimum_pulse
