"""The Schmitt trigger: each thruster collects its on-time until it is worth opening the valve.

A post-processor that flight programs put behind a mapper. On-times that the mapper within asks for are added
up for each thruster. It starts to fire when the sum reaches `open_at`, and then fires in every period what
has come together, as far as the period allows, until that is less than `close_at`: the hysteresis keeps a
valve from opening and closing with every command. What is not fired is carried over.

    t_i <- t_i + u_i;    it fires min(t_i, U_i) if t_i >= open_at, or if t_i >= close_at and it fired before;
    t_i <- t_i - what it fires.

Each thruster stands for itself. What two opposed thrusters have collected is not set off against each other,
and the thrusters of one command do not open at the same time, so that what a couple should give comes out as
a push and a turn that cancel only in the sum. `thruster_baselines.mapping.carrying` keeps the account in
rate changes and has neither weakness.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.minimum_pulse import pulse_lengths
from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.truncating import within_and_pulse
from thruster_baselines.mapping.wrapping import Memory, RememberingMapper, achieved_rate_change
from thruster_envs.protocols import Allocation, FloatArray, Mapper
from thruster_envs.spacecraft import Spacecraft

__all__ = ["SchmittTriggerMapper"]


class SchmittTriggerMapper(RememberingMapper):
    """Opens a thruster when the on-times asked of it have added up to a pulse.

    It takes commands (m,) or (steps, m) of one craft, or ([steps,] worlds, m) of several that fly side by
    side; steps in their order. A thruster whose longest on-time is below its minimum pulse collects nothing
    and stays shut; no other collects more than `open_at` and one period.

    Args:
        mapper: The mapper within, without a memory; or a spacecraft, of which it is then the `LPMapper`.
        minimum_pulse: (n,) or one number, s: the shortest pulse that opens a valve; a spacecraft's default is
            that of its thrusters.
        open_at: (n,) or one number, s: collected on-time at which a thruster starts to fire; `close_at` by
            default.
        close_at: (n,) or one number, s: collected on-time below which it stops; the minimum pulse by
            default.
        worlds: How many craft fly side by side, each with its own memory; None for one.

    Attributes:
        collected: (n,) or (worlds, n), s: on-time asked for and not yet fired; a copy.
        firing: (n,) or (worlds, n): which thrusters fired in the last period; a copy.
        remainder: (m,) or (worlds, m), m/s then rad/s: what the collected on-times would give.

    Raises:
        ValueError: Lengths that are not in the order minimum pulse, `close_at`, `open_at`; with a mapper, a
            missing minimum pulse.

    `cost` is the total on-time, s; `status` is that of the mapper within.

    >>> from thruster_baselines.mapping import LPMapper
    >>> mapper = SchmittTriggerMapper(LPMapper([[1.0, -1.0]], max_on_time=1.0), 0.01, open_at=0.02)
    >>> mapper([[0.015], [0.015], [0.015], [0.005], [0.005]]).on_times[:, 0]
    array([0.   , 0.03 , 0.015, 0.   , 0.   ])
    """

    def __init__(
        self,
        mapper: Mapper | Spacecraft | str | Path,
        minimum_pulse: ArrayLike | None = None,
        *,
        open_at: ArrayLike | None = None,
        close_at: ArrayLike | None = None,
        worlds: int | None = None,
    ) -> None:
        mapper, minimum_pulse = within_and_pulse(mapper, minimum_pulse)
        super().__init__(mapper, worlds)
        n = self._model.max_on_time.size
        self.minimum_pulse = pulse_lengths(minimum_pulse, n, "minimum_pulse")
        self.close_at = self.minimum_pulse if close_at is None else pulse_lengths(close_at, n, "close_at")
        self.open_at = self.close_at if open_at is None else pulse_lengths(open_at, n, "open_at")
        for name, longer, other, shorter in (
            ("close_at", self.close_at, "minimum_pulse", self.minimum_pulse),
            ("open_at", self.open_at, "close_at", self.close_at),
        ):
            if (longer < shorter).any():
                index = int(np.argmax(longer < shorter))
                raise ValueError(
                    f"{name} of thruster {index + 1} is {longer[index]} s; no less than its {other}, "
                    f"{shorter[index]} s, would be right"
                )

    @property
    def collected(self) -> FloatArray:
        """(n,) or (worlds, n), s: on-time asked for and not yet fired; a copy."""
        return self._memory["collected"].copy()

    @property
    def firing(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """(n,) or (worlds, n): which thrusters fired in the last period; a copy."""
        return self._memory["firing"].copy()

    @property
    def remainder(self) -> FloatArray:
        """(m,) or (worlds, m), m/s then rad/s: what the collected on-times would give."""
        return achieved_rate_change(self._model.effectiveness, self._memory["collected"])

    def _nothing(self) -> Memory:
        shape = (*self._craft, self._model.max_on_time.size)
        return {"collected": np.zeros(shape), "firing": np.zeros(shape, np.bool_)}

    def _step(self, command: FloatArray, model: Model, memory: Memory) -> tuple[Allocation, Memory]:
        asked = self._ask(command, model)
        able = model.max_on_time >= self.minimum_pulse
        collected = memory["collected"] + np.where(able, asked.on_times, 0.0)
        firing = able & ((collected >= self.open_at) | (memory["firing"] & (collected >= self.close_at)))
        on_times = np.where(firing, np.minimum(collected, model.max_on_time), 0.0)
        slack = command - achieved_rate_change(model.effectiveness, on_times)
        return (
            Allocation(on_times, slack, np.asarray(on_times.sum(axis=-1)), asked.status),
            {"collected": collected - on_times, "firing": firing & (on_times > 0.0)},
        )
