"""From the messages of navigation, good and bad, to intervals that a detector can take.

A rate change needs two measurements of the motion. If one is missing, late or wrong, the next good one covers
all intervals since the last good one; a late message is used for what was fired up to its time tag. `fired`
is called after each interval, `measured` for each message; what is refused is counted by its reason. The loss
of the shared feed is taken off each interval, so that the detector has to be built with `coupling=0.0`.
Reasons and limits: docs/derivations/measurement_gate.md.

Left out: a new message without a time tag that belongs to an earlier interval; a wrong message that is
possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.estimation.rate_change import thrust_rate_change
from thruster_baselines.estimation.refusals import (
    LATE,
    MISSING,
    NOT_A_NUMBER,
    ON_TIME,
    OUT_OF_RANGE,
    REFUSALS,
    TAKEN,
    Limits,
)
from thruster_baselines.mapping.coupling import delivered_on_times
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["MeasuredInterval", "MeasurementGate"]

_UNIT = 1e-3
"""By how much the norm of a measured attitude may differ from one."""

_ENTRIES = (
    *(f"{kind} {axis}" for kind in ("position", "velocity") for axis in "xyz"),
    *(f"attitude {axis}" for axis in "wxyz"),
    *(f"rate {axis}" for axis in "xyz"),
)


@dataclass(frozen=True, slots=True)
class MeasuredInterval:
    """One or more intervals between two measurements.

    Attributes:
        on_times: (n,), s, effective: the loss of the shared feed taken off, added up over the intervals.
        rate_change: (6,), m/s then rad/s, body axes: measured, motion without thrust taken off.
        duration: Of all of them, s.
    """

    on_times: FloatArray
    rate_change: FloatArray
    duration: float


class MeasurementGate:
    """Pairs what was fired with what was measured, for one vehicle.

    Args:
        spacecraft: Description, name or path.
        longest_gap: Intervals that may be taken as one. After more without a good measurement what was fired
            in them stays untested, and the next good one begins anew.

    Attributes:
        time: s, the end of the last interval.
        refused: How many messages were refused, for each reason.
        last_refusal: Why the last message was refused, in one line; empty if it was taken.

    Raises:
        ValueError: A gap that cannot be.

    >>> gate = MeasurementGate("orion")
    >>> at_rest = np.eye(13)[6]  # at the origin, body axes along LVLH
    >>> gate.measured(at_rest, measured_at=0.0)  # there is nothing yet to compare it with
    >>> for _ in range(2):
    ...     gate.fired(np.eye(12)[0], duration=5.0)
    >>> gate.measured(at_rest * np.nan, measured_at=5.0)
    >>> gate.last_refusal
    'position x at 5 s is nan; a finite number would be right'
    >>> gate.measured(at_rest, measured_at=10.0)  # a receiver that says the same again has stopped
    >>> gate.refused["late"]
    1
    >>> interval = gate.measured(at_rest + 1e-3 * np.eye(13)[3], measured_at=10.0)
    >>> interval.on_times[0], interval.duration
    (np.float64(2.0), 10.0)
    """

    def __init__(self, spacecraft: Spacecraft | str | Path, *, longest_gap: int = 3) -> None:
        if longest_gap < 1:
            raise ValueError(f"longest_gap is {longest_gap}; one interval or more would be right")
        self._spacecraft = load(spacecraft) if isinstance(spacecraft, str | Path) else spacecraft
        self._limits = Limits.of(self._spacecraft)
        self._longest_gap = longest_gap
        self.reset()

    def reset(self, time: float = 0.0) -> None:
        """Begin anew at a time, s: nothing was fired and nothing measured."""
        self.time = time
        self.refused = dict.fromkeys(REFUSALS, 0)
        self.last_refusal = ""
        self._before: FloatArray | None = None  # the last measurement that was taken
        self._origin = time  # the end of the interval to which it belongs, or the start
        self._pending: list[tuple[float, FloatArray, float]] = []  # since then: end, on-times, duration

    def fired(self, on_times: ArrayLike, duration: float) -> None:
        """An interval has ended.

        Args:
            on_times: (n,), s, as they were commanded.
            duration: s.

        Raises:
            ValueError: On-times of a wrong shape, negative or not finite; a duration that is not positive.
        """
        n = self._spacecraft.number_of_thrusters
        effective = delivered_on_times(on_times, self._spacecraft.feed.coupling)
        if effective.shape != (n,):
            raise ValueError(f"on_times has the shape {effective.shape}; ({n},) would be right")
        if not 0.0 < duration < math.inf:
            raise ValueError(f"duration is {duration}; a positive number of s would be right")
        self.time += duration
        self._pending.append((self.time, effective, float(duration)))
        if len(self._pending) > self._longest_gap:
            self._origin, self._before = self._pending.pop(0)[0], None

    def measured(
        self, measurement: ArrayLike | None, measured_at: float | None = None
    ) -> MeasuredInterval | None:
        """A message has come; returns what it closes, or None if there is nothing to test.

        Args:
            measurement: (13,): position, m, velocity, m/s, LVLH; attitude, body-from-LVLH, scalar first;
                inertial rate, rad/s, body axes. None for an empty message.
            measured_at: Its time tag, s, on the clock of `time`; by default now.

        Raises:
            ValueError: A wrong shape.
        """
        if measurement is None:
            return self._refuse(MISSING, f"the measurement at {self.time:g} s is missing")
        state = np.array(measurement, dtype=np.float64)
        if state.shape != (len(_ENTRIES),):
            raise ValueError(f"measurement has the shape {state.shape}; ({len(_ENTRIES)},) would be right")
        tag = self.time if measured_at is None else float(measured_at)
        closed = self._closed_by(tag)
        if closed is None:
            return self._refuse(
                LATE, f"the measurement is tagged {tag:g} s; {self._awaited()} would be right"
            )
        bad = np.flatnonzero(~np.isfinite(state))
        if bad.size > 0:
            name = _ENTRIES[bad[0]]
            return self._refuse(
                NOT_A_NUMBER, f"{name} at {tag:g} s is {state[bad[0]]}; a finite number would be right"
            )
        norm = float(np.linalg.norm(state[6:10]))
        if abs(norm - 1.0) > _UNIT:
            return self._refuse(
                OUT_OF_RANGE, f"attitude at {tag:g} s has the norm {norm:.4g}; 1 would be right"
            )
        if self._before is None:
            return self._take(state, closed, None)
        if np.array_equal(state, self._before):
            return self._refuse(
                LATE,
                f"the measurement tagged {tag:g} s is that of {self._origin:g} s once more; a new one would "
                "be right",
            )
        duration = sum(one[2] for one in self._pending[:closed])
        change = thrust_rate_change(self._spacecraft, self._before, state, duration)
        reason, axis = self._limits.check(change, duration)
        if reason != TAKEN:
            line = self._limits.line(axis, float(change[axis]), duration)
            return self._refuse(reason, f"the rate change up to {tag:g} s, {line}")
        on_times: FloatArray = np.sum([one[1] for one in self._pending[:closed]], axis=0)
        return self._take(state, closed, MeasuredInterval(on_times, change, duration))

    def _closed_by(self, tag: float) -> int | None:
        """How many of the pending intervals end with a measurement of this time; None if it is of no use."""
        for number, (end, _, duration) in enumerate(self._pending, start=1):
            if abs(tag - end) <= ON_TIME * duration:
                return number
        return 0 if self._before is None and tag == self._origin else None

    def _awaited(self) -> str:
        ends = [f"{end:g}" for end, _, _ in self._pending]
        if self._before is None:
            ends.insert(0, f"{self._origin:g}")
        return " or ".join(ends) + " s" if ends else "one after the next interval"

    def _take(
        self, state: FloatArray, closed: int, interval: MeasuredInterval | None
    ) -> MeasuredInterval | None:
        if closed > 0:
            self._origin = self._pending[closed - 1][0]
        self._before, self._pending, self.last_refusal = state, self._pending[closed:], ""
        return interval

    def _refuse(self, reason: int, line: str) -> MeasuredInterval | None:
        self.refused[REFUSALS[reason]] += 1
        self.last_refusal = line
        return None
