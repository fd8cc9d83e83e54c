"""What a method must offer so that a comparison need not know which kind it is running.

A mapper turns a commanded body rate change into thruster on-times: the linear program, a pseudo-inverse and a
trained network stand behind the same call. Left out on purpose: how a mapper learns of a fault. Whoever knows
better than the model that a mapper was built with passes `effectiveness` or `max_on_time` with the call.

A detector says after each interval of firing whether something is wrong, and with which thruster, for many
vehicles at once. It sees what was commanded and what was measured, never the truth.

A pilot turns what the flight software sees into the duties of the coming control period, for many vehicles at
once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Allocation",
    "BoolArray",
    "Detector",
    "Diagnosis",
    "FloatArray",
    "IntArray",
    "Mapper",
    "MapperWithMemory",
    "NavigationDetector",
    "Pilot",
    "ResidualDetector",
    "Sight",
]

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]


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


@runtime_checkable
class MapperWithMemory(Mapper, Protocol):
    """A mapper that owes something from earlier commands and makes up for it in later ones.

    It serves one craft, or a fixed number of them (worlds), and takes their commands in the order in which
    they are flown.
    """

    @property
    def remainder(self) -> FloatArray:
        """(m,), or (worlds, m): the rate change that is carried over to the next command, m/s then rad/s."""
        ...

    def forget(self, worlds: ArrayLike | None = None) -> None:
        """Owe nothing any more, in all worlds or in those of a mask (worlds,)."""
        ...

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later answers depend on beside the command, as copies by name."""
        ...

    def restore_state(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `save_state` gave."""
        ...


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a detector says of each vehicle after one interval.

    Attributes:
        detected: (vehicles,). Whether the statistic of this interval exceeds the threshold.
        thruster: (vehicles,). The blamed one, numbered from 1; 0 where nothing is detected, or where the
            method cannot tell which thruster it is.
        statistic: (vehicles,). What is compared with the threshold; 0 where there was no measurement.
        time: (vehicles,), s. Since the last reset, at the end of this interval.
        suspicion: (vehicles, n). The statistic of each thruster; zeros where the method has none.
        shortfall: (vehicles, n), s. By how much each thruster would have fired less than it was told, if it
            were the one; negative for thrust that was not commanded; zeros where the method has none.
    """

    detected: BoolArray
    thruster: IntArray
    statistic: FloatArray
    time: FloatArray
    suspicion: FloatArray
    shortfall: FloatArray


class Detector(Protocol):
    """Watches vehicles, interval by interval, for thrusters that do not do what they are told."""

    threshold: float

    def update(
        self,
        on_times: ArrayLike,
        rate_change: ArrayLike,
        duration: float,
        *,
        valid: ArrayLike | None = None,
        age: ArrayLike | None = None,
    ) -> Diagnosis:
        """Take in one interval.

        Args:
            on_times: (vehicles, n), s: for how long each thruster was commanded to be open in the interval.
            rate_change: (vehicles, m), m/s then rad/s, body axes: measured over the interval, motion without
                thrust taken off.
            duration: Of the interval, s.
            valid: (vehicles,), where there is a measurement; everywhere by default. One that is not finite
                is refused and counts as none.
            age: (vehicles,), s: how long before the end of this interval that ended to which the measurement
                belongs; 0 by default. One that belongs to another interval is refused and counts as none.
        """
        ...

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin anew, in the vehicles of a mask (vehicles,) or in all of them."""
        ...

    def believe(self, effectiveness: ArrayLike, vehicles: ArrayLike | None = None) -> None:
        """From now on expect what thrusters of this effectiveness (..., m, n) give, m/s^2 then rad/s^2."""
        ...


class NavigationDetector(Protocol):
    """Watches vehicles, sample by sample, by where they are and how they point.

    A sibling of `Detector` for periods so short that a rate change measured in one of them is lost in noise:
    second differences of a position known to a millimetre are off by 0.2 m/s^2 at ten samples a second.
    Such a detector takes what navigation gives and carries a model of the motion; a `Detector` is told what a
    firing has changed. Both answer with a `Diagnosis`, forget by `reset` and learn of a changed vehicle by
    `believe`.

    An alarm stays until the reset. The statistic is that of the sample, and 0 as long as the detector has not
    settled; the thruster is 0 until it is sure of one, and stays then.

    Attributes:
        threshold: What the statistic is held against; there is an alarm where it is above.
        effectiveness: (vehicles, 6, n), believed, m/s^2 then rad/s^2.
        detected: (vehicles,), whether there has been an alarm.
        thruster: (vehicles,), the named one, from 1; 0 as long as there is none.
    """

    threshold: float
    effectiveness: FloatArray
    detected: BoolArray
    thruster: IntArray

    def update(
        self,
        open_rates: ArrayLike,
        position: ArrayLike,
        attitude: ArrayLike,
        rate: ArrayLike | None = None,
        *,
        valid: ArrayLike | None = None,
    ) -> Diagnosis:
        """Take in one sample.

        Args:
            open_rates: (vehicles, n), 0..1: commanded for the period that begins with this sample, after
                clipping and after what the minimum on-time took away.
            position: (vehicles, 3), m, LVLH, measured. Of a LIDAR that sees the target from the vehicle, it
                is the measurement with its sign turned.
            attitude: (vehicles, 4), body from LVLH, scalar first, measured.
            rate: (vehicles, 3), rad/s, inertial rate in body axes, measured; a method that needs none takes
                no notice of it.
            valid: (vehicles,), where there is a measurement; everywhere by default. One that is not finite
                is refused and counts as none.
        """
        ...

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin anew, in the vehicles of a mask (vehicles,) or in all of them."""
        ...

    def believe(self, effectiveness: ArrayLike, vehicles: ArrayLike | None = None) -> None:
        """From now on expect what thrusters of this effectiveness (..., 6, n) give, m/s^2 then rad/s^2."""
        ...

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later answers depend on beside the samples to come, as copies by name."""
        ...

    def restore_state(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `save_state` gave."""
        ...


@runtime_checkable
class ResidualDetector(NavigationDetector, Protocol):
    """A detector whose statistic is the length of a residual that can be looked at.

    Attributes:
        residual: (vehicles, 3), in the unit of the threshold.
    """

    residual: FloatArray


@dataclass(frozen=True, slots=True)
class Sight:
    """What the flight software of a batch of vehicles sees at the beginning of a control period.

    Attributes:
        time: (vehicles,), s since the episode began; 0 where it begins.
        target: (vehicles, 6), where the vehicle should be: m and m/s, LVLH.
        position: (vehicles, 3), m, LVLH, measured.
        velocity: (vehicles, 3), m/s, LVLH, measured.
        attitude: (vehicles, 4), body-from-LVLH, scalar first, measured.
        rate: (vehicles, 3), rad/s, inertial rate in body axes, measured.
        duties: (vehicles, n), 0..1, commanded in the last period.
        measured_change: (vehicles, 6), m/s then rad/s: rate change of the last period, body axes, motion
            without thrust taken off.
        expected_change: (vehicles, 6): the same, as the nominal vehicle would have given it.
    """

    time: FloatArray
    target: FloatArray
    position: FloatArray
    velocity: FloatArray
    attitude: FloatArray
    rate: FloatArray
    duties: FloatArray
    measured_change: FloatArray
    expected_change: FloatArray


class Pilot(Protocol):
    """Flies a batch of vehicles."""

    def __call__(self, sight: Sight) -> ArrayLike:
        """Duties of the coming period, (vehicles, n), 0..1; what lies outside is clipped.

        What it gives one vehicle must not depend on the others, and what it remembers is its own affair: a
        saved state knows nothing of it.
        """
        ...
