"""What an observation of `OrionRendezvous-v1` says, and what of it can be believed.

Turns the entries back into measurements in SI units. Measurements do not always come as they should: an entry
may be missing (no number), at the end of its range (clipped, so it says no more than "at least that"), or the
observation may be that of an earlier period, delivered late. Such a measurement is named and not used. A rate
at the end of its range is the exception: the environment also gives the measured rate change, whose range is
far wider, and the rate follows from that and the one before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.control.quaternions import rotation_matrix
from thruster_envs.observations import Reader, Reading
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Measured", "ObservationReader", "task_of"]

_MOTION = ("position", "velocity", "attitude_error", "rate_error")
_ROUNDING = 1e-6  # periods


@dataclass(frozen=True, slots=True)
class Measured:
    """A measurement of the relative motion.

    Attributes:
        position: (3,), m, LVLH.
        velocity: (3,), m/s, LVLH.
        attitude: (4,), body-from-LVLH, scalar first.
        rate: (3,), rad/s, inertial, body axes.
    """

    position: FloatArray
    velocity: FloatArray
    attitude: FloatArray
    rate: FloatArray


def task_of(environment: Any, name: str) -> Any:
    """The task of an environment, wrapped or not.

    Raises:
        ValueError: An environment of another task; `name` is that of the class that is needed.
    """
    task = getattr(environment.unwrapped, "task", None)
    if name not in (one.__name__ for one in type(task).__mro__):
        got = type(environment.unwrapped if task is None else task).__name__
        raise ValueError(f"environment must be one of {name}, got {got}")
    return task


class ObservationReader:
    """Reads the observations of one flight after the other, in the order in which they come.

    Args:
        spacecraft: That flies.
        steps: Control periods of an episode: `task.steps` of the unwrapped environment.

    Attributes:
        step: Periods since the start of the episode, by its own count.
        fault: Why the last measurement was not used; empty if it was.
    """

    def __init__(self, spacecraft: Spacecraft, steps: int) -> None:
        self._spacecraft, self._steps = spacecraft, steps
        self._fields = Reader.of("thruster_envs/OrionRendezvous-v1", spacecraft=spacecraft)
        self.step = 0
        self.fault = ""
        self._last: FloatArray = np.full(13, np.nan)
        self._rate: FloatArray | None = None  # of the last observation, if it could be used

    def begins(self, observation: ArrayLike) -> bool:
        """Whether this is the first observation of an episode and not a repetition of it.

        Raises:
            ValueError: An observation that is too short.
        """
        reading = self._checked(observation)
        (left,) = reading.entries("time_to_go")
        return bool(left == 1.0) and not np.array_equal(reading.entries(*_MOTION, "time_to_go"), self._last)

    def read(self, observation: ArrayLike) -> Measured | None:
        """The measurement of the next period, or None if it cannot be used.

        Raises:
            ValueError: An observation that is too short; a second one whose time is that of an episode of
                other length.
        """
        reading = self._checked(observation)
        seen, (left,) = reading.entries(*_MOTION, "time_to_go"), reading.entries("time_to_go")
        begins = self.begins(reading.rows)
        due = 0 if begins else self.step + 1
        told = round((1.0 - left) * self._steps) if 0.0 <= left <= 1.0 else None
        if due == 1:
            self._check_length(reading)
        late = (told is not None and told < due) or np.array_equal(seen, self._last)
        self.step = due
        self._last = seen
        before, self._rate = (None if begins else self._rate), None
        if late:
            return self._refuse("late")
        if not np.isfinite(seen).all():
            return self._refuse("missing")
        if told != due:
            return self._refuse("out of range")
        angle, rate, change = reading.attitude_error, reading.rate_error, reading.measured_change[3:]
        clipped = ~reading.within("rate_error")
        turned = reading.entries("attitude_error")
        outside = not reading.within("position", "velocity", "attitude_error").all() or (
            float(turned @ turned) > (2.0 / self._fields.scale("attitude_error")) ** 2 * 1.01
        )
        if clipped.any():
            bound = self._fields.field("measured_change").bound
            if before is None or not (np.isfinite(change).all() and (np.abs(change) < bound).all()):
                outside = True
            else:
                rate = np.where(clipped, before + change, rate)
        if outside:
            return self._refuse("out of range")
        self.fault, self._rate = "", rate
        # The observed attitude error is minus twice the vector part of the quaternion.
        vector = -0.5 * angle
        attitude = np.concatenate([[np.sqrt(max(0.0, 1.0 - float(vector @ vector)))], vector])
        attitude /= np.linalg.norm(attitude)
        orbit_rate = rotation_matrix(attitude) @ [0.0, 0.0, self._spacecraft.mean_motion]
        return Measured(reading.position, reading.velocity, attitude, rate + orbit_rate)

    def _checked(self, observation: ArrayLike) -> Reading:
        seen = np.asarray(observation, dtype=np.float64)
        size = self._fields.columns("expected_change").stop
        if seen.ndim != 1 or seen.size < size:
            raise ValueError(f"observation has the shape {seen.shape}; ({size},) or more would be right")
        return self._fields(seen)

    def _check_length(self, second: Reading) -> None:
        """With another length than the episode's, all of its measurements would be taken for late ones."""
        elapsed = 1.0 - second.entries("time_to_go")[0]
        periods = elapsed * self._steps
        wrong = min(abs(periods), abs(periods - 1.0)) > self._steps * np.finfo(np.float32).eps + _ROUNDING
        if wrong and 0.0 < elapsed < 1.0 and second.within(*_MOTION).all():
            raise ValueError(
                f"steps is {self._steps}; {round(1.0 / elapsed)}, as the time to go of the second "
                "observation has it (`task.steps` of the unwrapped environment), would be right"
            )

    def _refuse(self, why: str) -> Measured | None:
        self.fault = why
        return None
