"""From what distribution a world draws its faults, and what a user may pass as faults.

With the given probability a world draws a number of faults, uniform over `count`. Each of them draws,
independently of the others, its craft (uniform), its kind (by weight), its severity, onset, duration,
profile time and dwell (uniform over their ranges), its profile (uniform over `profiles`; the kind
`intermittent` has its own), its azimuth (uniform over the circle) and its thruster, or by its kind its
reaction wheel or control-moment gyro (uniform over those of its craft that have no fault yet; where there
are none left, a kind of the other actuators is drawn). Either all faults or none strike all thrusters on the
same capacitor.
Independently of that, with the probability `sensor_probability` it draws a number of faults of sensors,
uniform over `sensor_count`, each with its craft, sensor, axis, kind and severity; onset, duration, profile,
profile time and dwell are drawn from the same ranges. The draws themselves are made by the environments, from
each world's own streams, of which that for sensors is another than that for thrusters.

Left out: dependence between faults, onsets that depend on how much a thruster has fired.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_envs.configuration import coerce_fields, from_mapping, require, shown
from thruster_envs.faults.kinds import (
    DEFAULT_SEVERITY,
    GENERAL_KINDS,
    GYRO_KINDS,
    KINDS,
    SENSOR_KINDS,
    SENSORS,
    WHEEL_KINDS,
    Range,
    check_kind,
    check_sensor,
    check_severity,
    drawn_severity,
)
from thruster_envs.faults.record import PROFILES, Fault, check_end, check_profile, check_profile_time

__all__ = ["DEFAULT_SEVERITY", "FaultDistribution", "as_faults"]

MOST_GRID_STEPS = 1e15
"""Most steps of an onset grid up to the latest onset: whole numbers that a float holds exactly."""

# Layout of `FaultDistribution.encode()`. A range is held as its lower end and its width, so that a draw is
# `low + uniform * width`, which is right for an infinite `low` too.
PROBABILITY = 0
COUNT_LOW = 1
COUNT_WIDTH = 2  # a whole number: the count is `low + floor(uniform * (width + 1))`
ONSET_LOW = 3
ONSET_WIDTH = 4
ONSET_GRID = 5  # 0: none
DURATION_LOW = 6
DURATION_WIDTH = 7
PROFILE_TIME_LOW = 8
PROFILE_TIME_WIDTH = 9
DWELL_LOW = 10
DWELL_WIDTH = 11
SHARED = 12  # 0 or 1
KIND_CUMULATIVE = 13  # one per kind: the kind is the first one whose entry is above `uniform`
SEVERITY_LOW = KIND_CUMULATIVE + len(KINDS)  # one per kind
SEVERITY_WIDTH = SEVERITY_LOW + len(KINDS)  # one per kind
PROFILE_CUMULATIVE = SEVERITY_WIDTH + len(KINDS)  # one per profile, as for the kinds
SENSOR_PROBABILITY = PROFILE_CUMULATIVE + len(PROFILES)
SENSOR_COUNT_LOW = SENSOR_PROBABILITY + 1
SENSOR_COUNT_WIDTH = SENSOR_COUNT_LOW + 1
SENSOR_CUMULATIVE = SENSOR_COUNT_WIDTH + 1  # one per sensor
AXIS_CUMULATIVE = SENSOR_CUMULATIVE + len(SENSORS)  # one per axis, that for all three first
SENSOR_KIND_CUMULATIVE = AXIS_CUMULATIVE + 4  # one per kind of a sensor
SENSOR_SEVERITY_LOW = SENSOR_KIND_CUMULATIVE + len(SENSOR_KINDS)  # sensor by sensor, one per kind
SENSOR_SEVERITY_WIDTH = SENSOR_SEVERITY_LOW + len(SENSORS) * len(SENSOR_KINDS)  # the same
WHEELS = SENSOR_SEVERITY_WIDTH + len(SENSORS) * len(SENSOR_KINDS)  # of each craft, and
GYROS = WHEELS + 1
NUMBER_OF_CHOICES = GYROS + 1  # thrusters that may fail; 0: all
FIRST_CHOICE = NUMBER_OF_CHOICES + 1  # their indices, from 0


@dataclass(frozen=True, kw_only=True)
class FaultDistribution:
    """What faults a world may draw at a reset.

    Attributes:
        probability: That a world draws any.
        kinds: The kinds that occur, equally likely, or kind to weight; by default those that any spacecraft
            can have.
        count: Fewest and most faults of a world that draws any.
        onset: Range, s.
        duration: Range, s; both ends are infinite when faults stay.
        severity: Kind to range, in the unit of the kind; the kinds that are not named keep
            `DEFAULT_SEVERITY`.
        profiles: The profiles that occur, equally likely. The kind `intermittent` always has its own.
        profile_time: Range, s.
        dwell: Range of the share of each period during which an intermittent profile is on.
        thrusters: Numbers, from 1, of the thrusters that may fail; None for all that are in use at the start.
            All wheels and gyros may, where `kinds` has a kind of theirs.
        onset_grid: Onsets are rounded down to multiples of this, s; 0 leaves them as they are drawn.
        shared: Whether each fault strikes all thrusters that share a capacitor with the one drawn.
        sensor_probability: That a world draws any faults of sensors, whatever its thrusters do.
        sensors: The sensors that may fail, equally likely; None for all that measure.
        sensor_kinds: The kinds of fault of sensors that occur, equally likely, or kind to weight. A `freeze`
            takes the profiles `ramp` and `sine` as `step`.
        sensor_count: Fewest and most faults of sensors of a world that draws any.
        sensor_severity: Sensor to kind to range, in the unit of the kind; others keep what counts for the
            sensor (`thruster_envs.faults.kinds.drawn_severity`).
        sensor_axes: The axes that may fail, equally likely: 1 to 3, and 0 for all three at once.

    Raises:
        ValueError: A value that no distribution can have; one line says which and what would be right.
    """

    probability: float = 0.5
    kinds: tuple[str, ...] | Mapping[str, float] = field(default=GENERAL_KINDS, hash=False)
    count: tuple[int, int] = (1, 1)
    onset: Range = (0.0, 0.0)
    duration: Range = (math.inf, math.inf)
    severity: Mapping[str, Range] = field(default_factory=dict, hash=False)
    profiles: tuple[str, ...] = ("step",)
    profile_time: Range = (10.0, 60.0)
    dwell: Range = (0.5, 0.5)
    thrusters: tuple[int, ...] | None = None
    onset_grid: float = 0.0
    shared: bool = False
    sensor_probability: float = 0.0
    sensors: tuple[str, ...] | None = None
    sensor_kinds: tuple[str, ...] | Mapping[str, float] = field(default=SENSOR_KINDS, hash=False)
    sensor_count: tuple[int, int] = (1, 1)
    sensor_severity: Mapping[str, Mapping[str, Range]] = field(default_factory=dict, hash=False)
    sensor_axes: tuple[int, ...] = (1, 2, 3)

    def __post_init__(self) -> None:
        coerce_fields(self)
        require(0.0 <= self.probability <= 1.0, "probability", self.probability, "a number from 0 to 1")
        _check_weights("kinds", self.kinds, None)
        self._check_severity()
        self._check_sensors()
        require(1 <= self.count[0] <= self.count[1], "count", self.count, "a range of numbers from 1")
        _check_range("onset", self.onset, low=0.0)
        _check_range("profile_time", self.profile_time, low=0.0)
        _check_range("dwell", self.dwell, low=0.0, high=1.0)
        require(self.dwell[0] > 0.0, "dwell", self.dwell, "a range above 0")
        if self.duration != (math.inf, math.inf):
            _check_range("duration", self.duration, low=0.0)
            require(self.duration[0] > 0.0, "duration", self.duration, "a range above 0 s")
            check_end(self.onset[1], self.duration[0])
        require(len(self.profiles) > 0, "profiles", self.profiles, "at least one profile")
        for profile in self.profiles:
            check_profile(profile)
        if self.profiles != ("step",) or "intermittent" in self.kind_weights():
            require(self.profile_time[0] > 0.0, "profile_time", self.profile_time, "a range above 0 s")
            check_profile_time(self.profile_time[0])
        if self.thrusters is not None:
            choices = self.thrusters
            require(
                len(choices) > 0 and min(choices) >= 1,
                "thrusters",
                choices,
                "a list of numbers from 1, or None,",
            )
            require(len(set(choices)) == len(choices), "thrusters", choices, "each number once")
        grid = self.onset_grid
        require(math.isfinite(grid) and grid >= 0.0, "onset_grid", grid, "a finite number of s, zero or more")
        if grid > 0.0 and self.onset[1] / grid > MOST_GRID_STEPS:
            finest = self.onset[1] / MOST_GRID_STEPS
            raise ValueError(
                f"onset_grid must be 0, or at least {finest:.3g} s with this onset, got {grid:g} s"
            )

    def kind_weights(self) -> dict[str, float]:
        """The kinds that occur and their weights."""
        return _weights(self.kinds)

    def sensor_kind_weights(self) -> dict[str, float]:
        """The kinds of fault of sensors that occur, where any do, and their weights."""
        return _weights(self.sensor_kinds)

    def encode(
        self,
        number_of_thrusters: int | None = None,
        number_of_craft: int = 1,
        *,
        spare: int = 0,
        wheels: int = 0,
        gyros: int = 0,
        sensors: tuple[str, ...] = SENSORS,
    ) -> NDArray[np.float64]:
        """The distribution as a flat table, which a compiled kernel draws from.

        Args:
            number_of_thrusters: Of each craft; when given, what may fail is checked against it.
            number_of_craft: In the world.
            spare: Thrusters of each craft's spare branch, whose numbers go on after the others; they fail
                where they are listed.
            wheels: Reaction wheels of each craft.
            gyros: Control-moment gyros of each craft.
            sensors: Those that measure, in the order of their codes.

        Returns:
            (FIRST_CHOICE + k,): laid out by the index constants of this module; k is the number of
            thrusters listed.

        Raises:
            ValueError: A thruster that does not exist, or more faults than thrusters that may fail.
        """
        choices = self.thrusters or ()
        if number_of_thrusters is not None:
            for thruster in choices:
                require(
                    thruster <= number_of_thrusters + spare,
                    "thrusters: one of them",
                    thruster,
                    f"a number from 1 to {number_of_thrusters + spare}",
                )
            kinds = self.kind_weights().keys()
            of_wheels, of_gyros = kinds & {*WHEEL_KINDS}, kinds & {*GYRO_KINDS}
            most = number_of_craft * (
                (len(choices) or number_of_thrusters) * bool(kinds - of_wheels - of_gyros)
                + wheels * bool(of_wheels)
                + gyros * bool(of_gyros)
            )
            whose = "actuators" if of_wheels or of_gyros else "thrusters"
            require(self.count[1] <= most, "count", self.count, f"at most {most}, the {whose} that may fail,")
        table = np.zeros(FIRST_CHOICE + len(choices))
        table[PROBABILITY] = self.probability
        table[ONSET_GRID], table[SHARED] = self.onset_grid, self.shared
        for index, values in (
            (COUNT_LOW, self.count),
            (ONSET_LOW, self.onset),
            (DURATION_LOW, self.duration),
            (PROFILE_TIME_LOW, self.profile_time),
            (DWELL_LOW, self.dwell),
        ):
            table[index], table[index + 1] = values[0], _width(values)
        weights = self.kind_weights()
        for index, kind in enumerate(KINDS):
            table[SEVERITY_LOW + index] = self.severity[kind][0]
            table[SEVERITY_WIDTH + index] = _width(self.severity[kind])
        table[KIND_CUMULATIVE:SEVERITY_LOW] = _cumulative([weights.get(kind, 0.0) for kind in KINDS])
        table[PROFILE_CUMULATIVE:SENSOR_PROBABILITY] = _cumulative(
            [float(self.profiles.count(profile)) for profile in PROFILES]
        )
        if self.sensor_probability > 0.0:
            self._encode_sensors(table, sensors)
        table[WHEELS], table[GYROS], table[NUMBER_OF_CHOICES] = wheels, gyros, len(choices)
        table[FIRST_CHOICE:] = np.array(choices, dtype=np.float64) - 1.0
        return table

    def _encode_sensors(self, table: NDArray[np.float64], sensors: tuple[str, ...]) -> None:
        failing, weights = self.sensors or sensors, self.sensor_kind_weights()
        table[SENSOR_PROBABILITY] = self.sensor_probability
        table[SENSOR_COUNT_LOW], table[SENSOR_COUNT_WIDTH] = self.sensor_count[0], _width(self.sensor_count)
        table[SENSOR_CUMULATIVE:AXIS_CUMULATIVE] = _cumulative([float(one in failing) for one in SENSORS])
        table[AXIS_CUMULATIVE:SENSOR_KIND_CUMULATIVE] = _cumulative(
            [float(axis in self.sensor_axes) for axis in range(4)]
        )
        table[SENSOR_KIND_CUMULATIVE:SENSOR_SEVERITY_LOW] = _cumulative(
            [weights.get(kind, 0.0) for kind in SENSOR_KINDS]
        )
        for place, (sensor, kind) in enumerate((one, kind) for one in SENSORS for kind in SENSOR_KINDS):
            values = self.sensor_severity[sensor][kind]
            table[SENSOR_SEVERITY_LOW + place] = values[0]
            table[SENSOR_SEVERITY_WIDTH + place] = _width(values)

    def _check_sensors(self) -> None:
        require(
            0.0 <= self.sensor_probability <= 1.0,
            "sensor_probability", self.sensor_probability, "a number from 0 to 1",
        )  # fmt: skip
        _check_weights("sensor_kinds", self.sensor_kinds, "")
        require(
            1 <= self.sensor_count[0] <= self.sensor_count[1],
            "sensor_count", self.sensor_count, "a range of numbers from 1",
        )  # fmt: skip
        sensors = SENSORS if self.sensors is None else self.sensors
        require(len(sensors) > 0, "sensors", sensors, "at least one sensor, or None,")
        for sensor in (*sensors, *self.sensor_severity):
            check_sensor(sensor)
        require(len(set(sensors)) == len(sensors), "sensors", sensors, "each sensor once")
        axes = self.sensor_axes
        if not axes or len(set(axes)) != len(axes) or not all(0 <= axis <= 3 for axis in axes):
            raise ValueError(f"sensor_axes must be numbers from 0 to 3, each once, got {axes}")
        whole = {}
        for sensor in SENSORS:
            own = self.sensor_severity.get(sensor, {})
            for kind, values in own.items():
                for end in values:
                    check_severity(kind, end, sensor)
                _check_range(f"severity of {kind!r} of {sensor!r}", values, low=-math.inf)
            whole[sensor] = {kind: drawn_severity(kind, sensor) for kind in SENSOR_KINDS} | dict(own)
        object.__setattr__(self, "sensor_severity", whole)

    def _check_severity(self) -> None:
        for kind, values in self.severity.items():
            check_kind(kind)
            for end in values:
                check_severity(kind, end)
            _check_range(f"severity of {kind!r}", values, low=0.0)
        object.__setattr__(self, "severity", DEFAULT_SEVERITY | dict(self.severity))


def as_faults(argument: object) -> tuple[Fault, ...] | FaultDistribution:
    """What a user passes as faults, as what the environments work with.

    Args:
        argument: None for no faults; a `Fault`, a `FaultDistribution`, or a plain mapping of the fields of
            either; or a sequence of faults and mappings of faults.

    Raises:
        ValueError: Anything else, or a value that no fault can have; one line says which and where.

    >>> as_faults({"thruster": 1, "kind": "stuck_off"}) == (Fault(1, "stuck_off"),)
    True
    >>> as_faults({"probability": 0.9}).probability
    0.9
    """
    if isinstance(argument, FaultDistribution):
        return argument
    if argument is None:
        return ()
    if isinstance(argument, Mapping) and not _KEYS_OF_A_FAULT & argument.keys():
        if not _KEYS_OF_A_DISTRIBUTION & argument.keys():
            raise ValueError(
                f"faults is {shown(argument)}; a mapping with 'thruster' and 'kind', or one with "
                "'probability', would be right"
            )
        return from_mapping(FaultDistribution, argument, "faults")
    if isinstance(argument, Fault | Mapping):
        return (_as_fault(argument, "faults"),)
    if isinstance(argument, Sequence) and not isinstance(argument, str | bytes):
        return tuple(
            _as_fault(one, f"faults, entry {number}") for number, one in enumerate(argument, start=1)
        )
    raise ValueError(
        f"faults is {shown(argument)}; a Fault, a FaultDistribution, a mapping of either's fields, "
        "a list of faults or None would be right"
    )


_KEYS_OF_A_FAULT = frozenset({"thruster", "actuator", "sensor", "kind"})
_KEYS_OF_A_DISTRIBUTION = frozenset(one.name for one in dataclasses.fields(FaultDistribution))


def _as_fault(value: Any, where: str) -> Fault:
    if isinstance(value, FaultDistribution):
        raise ValueError(
            f"{where} is a FaultDistribution; a Fault, or the distribution by itself, would be right"
        )
    if isinstance(value, Mapping):
        value = dict(value)
        if "kind" not in value and not value.keys() - _FIELDS_OF_A_FAULT:
            raise ValueError(f"{where}: the key 'kind' is missing")
        if "actuator" in value:
            if "thruster" in value:
                raise ValueError(f"{where}: 'thruster' and 'actuator' are two names of one number; give one")
            value["thruster"] = value.pop("actuator")
    return from_mapping(Fault, value, where)


_FIELDS_OF_A_FAULT = frozenset(one.name for one in dataclasses.fields(Fault)) | {"actuator"}


def _weights(kinds: Iterable[str] | Mapping[str, float]) -> dict[str, float]:
    if isinstance(kinds, Mapping):
        return {kind: weight for kind, weight in kinds.items() if weight > 0.0}
    return dict.fromkeys(kinds, 1.0)


def _check_weights(name: str, kinds: tuple[str, ...] | Mapping[str, float], sensor: str | None) -> None:
    """Refuse kinds that are none, or without weights from which one can be drawn."""
    for kind in kinds:
        check_kind(kind, sensor)
    if isinstance(kinds, Mapping):
        for kind, weight in kinds.items():
            require(
                math.isfinite(weight) and weight >= 0.0,
                f"weight of the kind {kind!r}",
                weight,
                "a finite number, zero or more",
            )
    else:
        require(len(set(kinds)) == len(kinds), name, kinds, "each kind once")
    if not math.isfinite(sum(_weights(kinds).values())):
        raise ValueError(f"{name} must have weights with a finite sum, got inf")
    require(len(_weights(kinds)) > 0, name, kinds, "at least one kind with a weight above 0")


def _check_range(name: str, values: Range, low: float, high: float = math.inf) -> None:
    right = f"a finite range within {low:g} to {high:g}, lower end first,"
    require(low <= values[0] <= values[1] <= high and math.isfinite(values[1]), name, values, right)


def _width(values: tuple[float, float]) -> float:
    return 0.0 if values[0] == values[1] else values[1] - values[0]


def _cumulative(weights: Sequence[float]) -> NDArray[np.float64]:
    """Cumulative shares; exactly one from the last positive weight on, so that no draw falls behind it."""
    sums = np.cumsum(np.asarray(weights, dtype=np.float64))
    shares: NDArray[np.float64] = sums / sums[-1]
    shares[np.flatnonzero(np.asarray(weights) > 0.0)[-1] :] = 1.0
    return shares
