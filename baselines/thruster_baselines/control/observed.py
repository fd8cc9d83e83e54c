"""What an observation of `OrionRendezvous-v0` says, and what of it can be believed.

Turns the entries back into measurements in SI units. Measurements do not always come as they should: an entry
may be missing (no number), at the end of its range (clipped, so it says no more than "at least that"), or the
observation may be that of an earlier period, delivered late. Such a measurement is named and not used. A rate
at the end of its range is the exception: the environment also gives the measured rate change, whose range is
far wider, and the rate follows from that and the one before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.control.quaternions import rotation_matrix
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Measured", "ObservationReader"]

_POSITION, _VELOCITY, _ANGLE, _RATE = 300.0, 0.5, 0.5, 0.05  # what 1 stands for: m, m/s, rad, rad/s
_BOUND = 5.0  # where entries are clipped
_TIME = 12  # time to go
_LAST_DUTIES = 13  # first of n, and after them the measured rate change
_ROUNDING = 1e-6  # periods
_UNITS = np.repeat([_POSITION, _VELOCITY, _ANGLE, _RATE], 3)


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
        self._authority = spacecraft.authority()
        self.step = 0
        self.fault = ""
        self._last: FloatArray = np.full(13, np.nan)
        self._rate: FloatArray | None = None  # of the last observation, if it could be used

    def begins(self, observation: ArrayLike) -> bool:
        """Whether this is the first observation of an episode and not a repetition of it.

        Raises:
            ValueError: An observation that is too short.
        """
        seen = self._checked(observation)
        return bool(seen[_TIME] == 1.0) and not np.array_equal(seen[:13], self._last)

    def read(self, observation: ArrayLike) -> Measured | None:
        """The measurement of the next period, or None if it cannot be used.

        Raises:
            ValueError: An observation that is too short; a second one whose time is that of an episode of
                other length.
        """
        seen, n = self._checked(observation), self._spacecraft.number_of_thrusters
        begins = self.begins(seen)
        due = 0 if begins else self.step + 1
        told = round((1.0 - seen[_TIME]) * self._steps) if 0.0 <= seen[_TIME] <= 1.0 else None
        if due == 1:
            self._check_length(seen)
        late = (told is not None and told < due) or np.array_equal(seen[:13], self._last)
        self.step = due
        self._last = seen[:13].copy()
        before, self._rate = (None if begins else self._rate), None
        if late:
            return self._refuse("late")
        if not np.isfinite(seen[:13]).all():
            return self._refuse("missing")
        if told != due:
            return self._refuse("out of range")
        entries = seen[:12] * _UNITS
        clipped = np.abs(seen[:12]) >= _BOUND
        change = seen[_LAST_DUTIES + n :][3:6] * self._authority[3:]
        outside = clipped[:9].any() or float(seen[6:9] @ seen[6:9]) > (2.0 / _ANGLE) ** 2 * 1.01
        if clipped[9:].any():
            if before is None or not (np.isfinite(change).all() and (np.abs(change) < _BOUND).all()):
                outside = True
            else:
                entries[9:] = np.where(clipped[9:], before + change, entries[9:])
        if outside:
            return self._refuse("out of range")
        self.fault, self._rate = "", entries[9:]
        # The observed attitude error is minus twice the vector part of the quaternion.
        vector = -0.5 * entries[6:9]
        attitude = np.concatenate([[np.sqrt(max(0.0, 1.0 - float(vector @ vector)))], vector])
        attitude /= np.linalg.norm(attitude)
        orbit_rate = rotation_matrix(attitude) @ [0.0, 0.0, self._spacecraft.mean_motion]
        return Measured(entries[:3], entries[3:6], attitude, entries[9:] + orbit_rate)

    def _checked(self, observation: ArrayLike) -> FloatArray:
        seen = np.asarray(observation, dtype=np.float64)
        size = _LAST_DUTIES + self._spacecraft.number_of_thrusters + 12
        if seen.ndim != 1 or seen.size < size:
            raise ValueError(f"observation has the shape {seen.shape}; ({size},) or more would be right")
        return seen

    def _check_length(self, second: FloatArray) -> None:
        """With another length than the episode's, all of its measurements would be taken for late ones."""
        elapsed = 1.0 - second[_TIME]
        periods = elapsed * self._steps
        wrong = min(abs(periods), abs(periods - 1.0)) > self._steps * np.finfo(np.float32).eps + _ROUNDING
        if wrong and 0.0 < elapsed < 1.0 and (np.abs(second[:12]) < _BOUND).all():
            raise ValueError(
                f"steps is {self._steps}; {round(1.0 / elapsed)}, as the time to go of the second "
                "observation has it (`task.steps` of the unwrapped environment), would be right"
            )

    def _refuse(self, why: str) -> Measured | None:
        self.fault = why
        return None
