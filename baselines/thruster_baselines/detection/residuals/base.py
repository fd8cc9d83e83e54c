"""What all detectors fed by navigation share: input validation, the clock, alarms and isolations that latch.

A detector here takes the duties of each period and what navigation measured at its beginning, and says at
once whether something is wrong and, when it is sure, with which thruster. Both stay until a reset, since the
source (Fonod et al. 2013) latches both.

Left out: what becomes of a fault that ends, and several faults at once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.detection.checks import check_effectiveness, mask_of, rows_of
from thruster_baselines.detection.contract import Telemetry, Verdict, check_alone
from thruster_envs.configuration import require
from thruster_envs.construction import RecordsArguments
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = [
    "BaseNavigationDetector",
    "Monitor",
    "NavigationSettings",
    "Sample",
    "nominal_delay",
    "take_attitude",
]

SETTLING_TIME = 40.0
"""s after the first sample without alarms: the observers begin at rest, the vehicles do not."""


class NavigationSettings(TypedDict, total=False):
    """What every detector fed by navigation takes as keyword arguments.

    Attributes:
        settle: How long after the first sample there are no alarms, s.
        vehicles: Number of vehicles monitored; 1 by default.
    """

    settle: float
    vehicles: int


class Sample(NamedTuple):
    """One sample, as a detector sees it after the checks of its shapes.

    Attributes:
        open_rates: (vehicles, n), 0..1.
        position: (vehicles, 3), m, LVLH; may be anything where it is not valid.
        attitude: (vehicles, 4), body from LVLH; the same.
        rate: (vehicles, 3), rad/s, body axes; zero if it was not given.
        valid: (vehicles,), where there is said to be a measurement.
    """

    open_rates: FloatArray
    position: FloatArray
    attitude: FloatArray
    rate: FloatArray
    valid: BoolArray


class Monitor(NamedTuple):
    """What is kept of each vehicle, (vehicles,) unless stated, in the order in which kernels take it.

    Attributes:
        effectiveness: (vehicles, 6, n), believed, m/s^2 then rad/s^2.
        attitude: (vehicles, 4), the last one that was one.
        samples: How many there were.
        refused: How many were not usable.
        detected: Whether there has been an alarm.
        thruster: The isolated one, from 1; 0 for none.
        detection_time: s, from the first sample to the alarm.
        isolation_time: s, from the first sample to the isolation.
    """

    effectiveness: FloatArray
    attitude: FloatArray
    samples: IntArray
    refused: IntArray
    detected: BoolArray
    thruster: IntArray
    detection_time: FloatArray
    isolation_time: FloatArray


class BaseNavigationDetector(RecordsArguments, ABC):
    """A detector that checks what navigation gives it, keeps time, alarms and names, and leaves the rest.

    Args:
        spacecraft: Description, name or path: of its effectiveness, control period and mean motion.
        threshold: What the statistic is held against.
        settle: How long after the first sample there are no alarms, s.
        vehicles: How many are watched.

    Attributes:
        threshold: May be changed at any time.
        spacecraft: As it was given.
        effectiveness: (vehicles, 6, n), believed, m/s^2 then rad/s^2.
        detected: (vehicles,), whether there has been an alarm.
        thruster: (vehicles,), the named one, from 1; 0 as long as there is none.
        detection_time: (vehicles,), s from the first sample to the alarm; infinite without.
        isolation_time: (vehicles,), s from the first sample to the name; infinite without.
        refused: (vehicles,), how many samples were no numbers or no attitudes.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path,
        threshold: float,
        *,
        settle: float = SETTLING_TIME,
        vehicles: int = 1,
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        require(threshold >= 0.0, "threshold", threshold, "a number of 0 or more")
        require(settle >= 0.0, "settle", settle, "a number of s, 0 or more")
        require(vehicles >= 1 and vehicles % 1 == 0, "vehicles", vehicles, "a whole number from 1")
        self.spacecraft = spacecraft
        self.threshold = float(threshold)
        self.settle = float(settle)
        self._period = spacecraft.control_period
        self._vehicles = vehicles
        self._n = spacecraft.number_of_thrusters
        self._everywhere: BoolArray = np.ones(vehicles, np.bool_)
        self._no_rate: FloatArray = np.zeros((vehicles, 3))
        self.effectiveness: FloatArray = np.empty((vehicles, 6, self._n))
        self.samples: IntArray = np.zeros(vehicles, np.int64)
        self.detected: BoolArray = np.zeros(vehicles, np.bool_)
        self.thruster: IntArray = np.zeros(vehicles, np.int64)
        self.detection_time: FloatArray = np.full(vehicles, np.inf)
        self.isolation_time: FloatArray = np.full(vehicles, np.inf)
        self.refused: IntArray = np.zeros(vehicles, np.int64)
        self._attitude: FloatArray = np.zeros((vehicles, 4))
        self._monitor = Monitor(
            self.effectiveness, self._attitude, self.samples, self.refused, self.detected, self.thruster,
            self.detection_time, self.isolation_time,
        )  # fmt: skip
        self._said: tuple[bytes, tuple[str, ...]] = b"", ()  # isolated thrusters, and kinds of their faults

    def constructor_arguments(self) -> dict[str, Any]:
        """The arguments with which to construct the like of it, with the threshold that it has now."""
        arguments = super().constructor_arguments()
        arguments.update(arguments.pop("common", {}), threshold=self.threshold)
        return arguments

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin anew with nominal thrusters, in the vehicles of a mask (vehicles,) or in all of them."""
        mask = self._mask(vehicles)
        self.effectiveness[mask] = self.spacecraft.effectiveness()
        self.samples[mask] = 0
        self.refused[mask] = 0
        self._attitude[mask] = (1.0, 0.0, 0.0, 0.0)
        self._begin(mask)
        self._clear(mask)

    def believe(self, effectiveness: ActuatorBelief | ArrayLike, vehicles: ArrayLike | None = None) -> None:
        """From now on expect what thrusters of this effectiveness give, and take back alarms and names.

        The observers go on. A thruster with a column of zeros is not suspected any more.

        Args:
            effectiveness: (6, n) or (vehicles, 6, n), m/s^2 then rad/s^2, or a belief about the thrusters.
            vehicles: Which ones, as a mask (vehicles,); all by default.

        Raises:
            ValueError: A wrong shape, an entry that is not finite.
        """
        mask = self._mask(vehicles)
        if isinstance(effectiveness, ActuatorBelief):
            effectiveness = effectiveness.effectiveness(self.spacecraft.effectiveness())
        given = np.asarray(effectiveness, dtype=np.float64)
        whole = self.effectiveness.shape
        check_effectiveness(given, self._vehicles, whole[1:])
        self.effectiveness[mask] = np.broadcast_to(given, whole)[mask]
        self._clear(mask)

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later answers depend on beside the samples to come, as copies by name."""
        return {name: array.copy() for name, array in self._memory().items()}

    def restore_state(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `save_state` gave, of a detector with the same settings.

        Raises:
            ValueError: Something is missing, too much, or of another shape.
        """
        own = self._memory()
        for name in own.keys() | saved.keys():
            shape = own[name].shape if name in own else None
            given = np.shape(saved[name]) if name in saved else None
            if given != shape:
                raise ValueError(f"the saved {name} has the shape {given}; {shape} would be right")
        for name, value in saved.items():
            own[name][...] = value
        self._said = b"", ()

    def _memory(self) -> dict[str, NDArray[Any]]:
        """The arrays themselves, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def update(
        self,
        open_rates: Telemetry | ArrayLike,
        position: ArrayLike | None = None,
        attitude: ArrayLike | None = None,
        rate: ArrayLike | None = None,
        *,
        valid: ArrayLike | None = None,
    ) -> Verdict:
        """Take in one sample: `Telemetry`, or arrays as in `thruster_envs.protocols.NavigationDetector`.

        Raises:
            ValueError: A wrong shape, an open rate that is none, telemetry without duties, position or
                attitude.
            TypeError: Arguments beside telemetry, or too few without it.
        """
        if isinstance(open_rates, Telemetry):
            seen = open_rates
            check_alone(position=position, attitude=attitude, rate=rate, valid=valid)
            duties, position, attitude = (seen.need(name) for name in ("duties", "position", "attitude"))
            rate, valid = seen.rate, seen.valid
        else:
            duties = open_rates
        if position is None or attitude is None:
            raise TypeError("update must have telemetry, or open_rates, position and attitude")
        told = self._rows(duties, self._n, "open_rates")
        place = self._rows(position, 3, "position")
        pointing = self._rows(attitude, 4, "attitude")
        turning = self._no_rate if rate is None else self._rows(rate, 3, "rate")
        there = self._everywhere
        if valid is not None:
            there = np.asarray(valid, dtype=np.bool_)
            if there.shape != (self._vehicles,):
                raise ValueError(f"valid has the shape {there.shape}; ({self._vehicles},) would be right")
        wrong = _first_wrong(told)
        if wrong >= 0:
            vehicle, thruster = divmod(int(wrong), self._n)
            raise ValueError(
                f"open_rates of vehicle {vehicle}, thruster {thruster + 1} is {told[vehicle, thruster]}; "
                "a number from 0 to 1 would be right"
            )
        return self._diagnose(Sample(told, place, pointing, turning, there))

    @abstractmethod
    def _diagnose(self, sample: Sample) -> Verdict:
        """What to say of a checked sample."""

    @abstractmethod
    def _begin(self, mask: BoolArray) -> None:
        """Start the observers of the vehicles of a mask (vehicles,) anew."""

    def _clear(self, mask: BoolArray) -> None:
        """Take back alarms and names, and drop the evidence, in the vehicles of a mask (vehicles,)."""
        self._said = b"", ()
        self.detected[mask] = False
        self.thruster[mask] = 0
        self.detection_time[mask] = self.isolation_time[mask] = np.inf

    def _answer(
        self,
        statistic: FloatArray,
        time: FloatArray,
        suspicion: FloatArray | None = None,
        shortfall: FloatArray | None = None,
    ) -> Verdict:
        shape = (self._vehicles, self._n)
        return Verdict(
            self.detected.copy(),
            self.thruster.copy(),
            statistic,
            time,
            np.zeros(shape) if suspicion is None else suspicion,
            np.zeros(shape) if shortfall is None else shortfall,
            self._latched_kinds(),
        )

    def _latched_kinds(self) -> tuple[str, ...]:
        """Of each vehicle, the kind of fault, worked out anew where another thruster has been isolated."""
        isolated = self.thruster.tobytes()
        if isolated != self._said[0]:
            self._said = isolated, self._kinds()
        return self._said[1]

    def _kinds(self) -> tuple[str, ...]:
        """Of each vehicle, the kind of fault where a thruster is isolated and it can be told."""
        return ("",) * self._vehicles

    def _rows(self, given: ArrayLike, size: int, name: str) -> FloatArray:
        return rows_of(np.ascontiguousarray(given, dtype=np.float64), self._vehicles, size, name)

    def _mask(self, vehicles: ArrayLike | None) -> BoolArray:
        return mask_of(vehicles, self._vehicles)


def nominal_delay(spacecraft: Spacecraft) -> float:
    """How long thrust comes after its command, s: the modulator's delay, or the valves' average one."""
    if spacecraft.modulator is not None:
        return spacecraft.modulator.delay
    return float(np.mean([one.opening_delay for one in spacecraft.thrusters]))


@njit(error_model="numpy", inline="always")
def take_attitude(attitude, last, v):  # type: ignore[no-untyped-def]
    """Whether the attitude of vehicle v is one; if so it is kept, of unit length, in `last` (vehicles, 4)."""
    square = 0.0
    for j in range(4):
        square += attitude[v, j] * attitude[v, j]
    if not (0.8 < square < 1.25):  # written so that what is no number is refused, too
        return False
    scale = 1.0 / np.sqrt(square)
    for j in range(4):
        last[v, j] = scale * attitude[v, j]
    return True


@kernel(nogil=True)
def _first_wrong(open_rates):  # type: ignore[no-untyped-def]
    """The flat index of the first open rate that is none, or -1."""
    count, n = open_rates.shape
    for v in range(count):
        for i in range(n):
            if not (0.0 <= open_rates[v, i] <= 1.0):
                return v * n + i
    return -1
