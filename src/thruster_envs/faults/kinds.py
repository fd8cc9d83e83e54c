"""What a fault can be: one table, of which every list, code, check and page is made.

A kind is one line of `ACTUATOR_TABLE` or `SENSOR_TABLE`: its name, whose it is, what its severity means and
what that can be. Its code is its place in its table, from 1, so lines are added at the end. A sensor is one
line of `SENSOR_LINES`. What a kind does stands in `thruster_envs.physics.health`, and nowhere else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from thruster_envs.configuration import require, shown, suggestion
from thruster_envs.spacecraft.description import LARGEST, LONGEST_LAG

#: Whose a kind is.
THRUSTER, PLASMA_THRUSTER, MODULATED_THRUSTER = "thruster", "plasma thruster", "thruster behind a modulator"
WHEEL, GYRO = "reaction wheel", "control-moment gyro"
SENSOR = "sensor"

Range = tuple[float, float]

#: Modes of `thruster_envs.faults.MODES` from a severity on, by rising severity.
Modes = tuple[tuple[float, str], ...]

#: Shares of the thrust from which on a thruster counts as weak and as dead, and opening from which on it
#: counts as stuck open.
WEAK_FROM, DEAD_FROM, STUCK_FROM = 0.5, 0.9, 0.5

#: The same in the severities of faults of a discharge: share of the slug with which half of the thrust is
#: lost, and added resistance, ohm, with which half and nine tenths are.
PROPELLANT_WEAK_FROM, RESISTANCE_WEAK_FROM, RESISTANCE_DEAD_FROM = 0.9863, 0.0448, 0.399

_SHARE_LOST: Modes = ((0.0, "slightly weak"), (WEAK_FROM, "weak"), (DEAD_FROM, "dead"))
_OPEN: Modes = ((0.0, "leaking"), (STUCK_FROM, "stuck open"))
_OTHER: Modes = ((0.0, "tilted or late"),)
_A_SHARE = "a share from 0 to 1"


@dataclass(frozen=True, kw_only=True)
class FaultKind:
    """One kind of fault.

    Attributes:
        name: What it is called; within the kinds of actuators and within those of sensors each name stands
            for one.
        whose: `THRUSTER` (any), `PLASMA_THRUSTER`, `MODULATED_THRUSTER`, `WHEEL`, `GYRO` or `SENSOR`.
        meaning: Of its severity, in one sentence.
        unit: Of its severity; of a sensor, "sensor" is the unit of what it measures.
        right: What a severity can be, in words.
        largest: Largest severity; of a sensor, `largest_severity` has it.
        smallest: Smallest one.
        default: Severity where none is given; of a sensor in its `scale` where the unit is the sensor's.
        full_scale: Severity that counts as one where severities are shown on a common scale.
        drawn: Range from which a distribution draws the severity unless told otherwise; of a sensor in its
            `scale` where the unit is the sensor's.
        by_default: Whether a distribution draws it unless told otherwise.
        modes: What a diagnosis calls it, by severity.
        profiles: Whether its severity can change in time; a kind that only acts or does not takes "step" and
            "intermittent" alone.
    """

    name: str
    whose: str
    meaning: str
    unit: str = "1"
    right: str = _A_SHARE
    largest: float = 1.0
    smallest: float = 0.0
    default: float = 1.0
    full_scale: float = 1.0
    drawn: Range = (1.0, 1.0)
    by_default: bool = False
    modes: Modes = ()
    profiles: bool = True


ACTUATOR_TABLE: tuple[FaultKind, ...] = (
    FaultKind(
        name="stuck_off", whose=THRUSTER, by_default=True, modes=_SHARE_LOST,
        meaning="the valve does not open: share of the flow lost (1 = dead)",
    ),
    FaultKind(
        name="stuck_on", whose=THRUSTER, by_default=True, modes=_OPEN,
        meaning="the valve's opening whatever is commanded (1 = fully open)",
    ),
    FaultKind(
        name="loss", whose=THRUSTER, drawn=(0.3, 0.9), by_default=True, modes=_SHARE_LOST,
        meaning="share of the thrust lost while the flow goes on",
    ),
    FaultKind(
        name="leak", whose=THRUSTER, drawn=(0.1, 0.5), by_default=True, modes=_OPEN,
        meaning="opening of the closed valve",
    ),
    FaultKind(
        name="misalignment", whose=THRUSTER, unit="rad", right="an angle from 0 to pi/2 rad",
        largest=math.pi / 2, full_scale=math.pi / 2, drawn=(0.1, 0.5), by_default=True, modes=_OTHER,
        meaning="angle in rad, up to pi/2, by which the thrust tilts towards `azimuth`",
    ),
    FaultKind(
        name="late_opening", whose=THRUSTER, unit="s", right="a finite number of s, zero or more",
        largest=math.nextafter(math.inf, 0.0), full_scale=5.0, drawn=(0.5, 2.0), by_default=True,
        modes=_OTHER, meaning="further opening delay in s",
    ),
    FaultKind(
        name="intermittent", whose=THRUSTER, by_default=True, modes=_SHARE_LOST,
        meaning="as `stuck_off`, coming and going; its profile is always `intermittent`",
    ),
    FaultKind(
        name="propellant_loss", whose=PLASMA_THRUSTER, right="a share from 0 to 0.995", largest=0.995,
        default=0.995, drawn=(0.9, 0.98), modes=((0.0, "slightly weak"), (PROPELLANT_WEAK_FROM, "weak")),
        meaning="share of the slug of plasma that is lost; the thrust falls",
    ),
    FaultKind(
        name="electrode_sediment", whose=PLASMA_THRUSTER, right="a share from 0 to 0.75", largest=0.75,
        default=0.75, drawn=(0.15, 0.5), modes=_OTHER,
        meaning="share of the electrodes' width that is lost; the thrust rises",
    ),
    FaultKind(
        name="conductivity_loss", whose=PLASMA_THRUSTER, unit="ohm", right="a resistance from 0 to 1 ohm",
        full_scale=0.1, drawn=(0.009, 0.03),
        modes=((0.0, "slightly weak"), (RESISTANCE_WEAK_FROM, "weak"), (RESISTANCE_DEAD_FROM, "dead")),
        meaning="resistance added to the circuit, ohm; the thrust falls",
    ),
    FaultKind(
        name="slow_opening", whose=MODULATED_THRUSTER, unit="s",
        right=f"a time from 0 to {LONGEST_LAG:g} s", largest=LONGEST_LAG, drawn=(0.1, 0.5), modes=_OTHER,
        meaning="time added to the time constant with which the thrust rises and falls, s",
    ),
    FaultKind(
        name="sign", whose=THRUSTER, modes=_OTHER,
        meaning="miswired, the thruster pushes the other way: share of the thrust that does (0.5 = none is "
        "left, 1 = all of it is reversed)",
    ),
    FaultKind(
        name="bias", whose=THRUSTER, drawn=(0.1, 0.3), modes=_OPEN,
        meaning="constant added to the commanded duty, as a share of the period; the sum ends at 1, and a "
        "thruster that is not commanded fires for it (a plasma thruster fires one whole pulse)",
    ),
    FaultKind(
        name="wheel_torque_loss", whose=WHEEL, drawn=(0.3, 0.9),
        meaning="share of the torque of a wheel's motor that is lost",
    ),
    FaultKind(
        name="wheel_stuck", whose=WHEEL,
        meaning="above 0, whatever it is: the rotor keeps the speed against the body that it has",
    ),
    FaultKind(
        name="wheel_friction", whose=WHEEL, drawn=(0.1, 0.5),
        meaning="dry friction added in the bearing, as a share of the motor's largest torque",
    ),
    FaultKind(
        name="wheel_speed_limit", whose=WHEEL, drawn=(0.3, 0.9),
        meaning="share of its largest speed that a wheel cannot reach any more",
    ),
    FaultKind(
        name="gimbal_rate_loss", whose=GYRO, drawn=(0.3, 0.9),
        meaning="share of the commanded rate of the gimbal that is lost",
    ),
    FaultKind(
        name="gimbal_lock", whose=GYRO,
        meaning="above 0, whatever it is: the gimbal keeps the angle that it has",
    ),
)  # fmt: skip

SENSOR_TABLE: tuple[FaultKind, ...] = (
    FaultKind(
        name="bias", whose=SENSOR, unit="sensor", smallest=-LARGEST, largest=LARGEST, drawn=(-1.0, 1.0),
        meaning="constant added to the measurement, of either sign",
    ),
    FaultKind(
        name="drift", whose=SENSOR, unit="sensor/s", smallest=-LARGEST, largest=LARGEST, default=0.01,
        full_scale=0.01, drawn=(-0.01, 0.01),
        meaning="added to the measurement for each second since the onset, of either sign",
    ),
    FaultKind(
        name="scale", whose=SENSOR, smallest=-10.0, largest=10.0, default=0.5, drawn=(-0.5, 0.5),
        right="a share from -10 to 10",
        meaning="share of the measured value added to the measurement, of either sign: a factor of 1 + s",
    ),
    FaultKind(
        name="freeze", whose=SENSOR, smallest=1.0, right="1, all of the measurement", profiles=False,
        meaning="1: the last measurement before it acts stays",
    ),
    FaultKind(
        name="spike", whose=SENSOR, unit="sensor", largest=LARGEST, default=10.0, full_scale=10.0,
        drawn=(1.0, 10.0),
        meaning="added to single measurements, each of which is hit with a probability of 0.1",
    ),
    FaultKind(
        name="drop_out", whose=SENSOR, right="a probability from 0 to 1", drawn=(0.2, 1.0),
        meaning="probability that a measurement is missing; the last one is held, and `info` calls it stale",
    ),
)  # fmt: skip

SPIKE_PROBABILITY = 0.1
"""That a spike hits a measurement while it acts."""


class SensorLine(NamedTuple):
    """What can measure, and fail at it.

    Attributes:
        name: Of the sensor.
        unit: Of what it measures.
        axes: Of what, in words.
        scale: A fault of it that counts: the default of a bias, in its unit.
        largest: Largest bias, drift or spike, in its unit (per s).
    """

    name: str
    unit: str
    axes: str
    scale: float
    largest: float


SENSOR_LINES: tuple[SensorLine, ...] = (
    SensorLine("position", "m", "LVLH", 1.0, 1e9),
    SensorLine("velocity", "m/s", "LVLH", 0.05, 1e9),
    SensorLine("attitude", "rad", "body", 0.05, math.pi),
    SensorLine("rate", "rad/s", "body", 0.01, 1e3),
    # The accelerometer and the wheels' tachometers follow here.
)

# What follows is made of the tables.

KINDS: tuple[str, ...] = tuple(one.name for one in ACTUATOR_TABLE)
"""The kinds of fault of an actuator, in the order of their codes; the first has code 1, since 0 marks an
empty slot."""

SENSOR_KINDS: tuple[str, ...] = tuple(one.name for one in SENSOR_TABLE)
"""The kinds of fault of a sensor, in the order of their codes from 1."""

SENSORS: tuple[str, ...] = tuple(one.name for one in SENSOR_LINES)
"""The sensors, in the order of their codes from 1."""

CODES: dict[str, int] = {name: code for code, name in enumerate(KINDS, start=1)}
"""Code of each kind of an actuator."""

SENSOR_CODES: dict[str, int] = {name: code for code, name in enumerate(SENSOR_KINDS, start=1)}
"""Code of each kind of a sensor."""


def kinds_of(whose: str) -> tuple[str, ...]:
    """The kinds that are `whose`, in the order of their codes."""
    return tuple(one.name for one in (*ACTUATOR_TABLE, *SENSOR_TABLE) if one.whose == whose)


THRUSTER_KINDS: tuple[str, ...] = kinds_of(THRUSTER)
"""The kinds that any thruster can have."""

GENERAL_KINDS: tuple[str, ...] = tuple(one.name for one in ACTUATOR_TABLE if one.by_default)
"""Those of them that a distribution draws unless told otherwise."""

DISCHARGE_KINDS: tuple[str, ...] = kinds_of(PLASMA_THRUSTER)
"""The kinds that only a spacecraft with a discharge can have: they change a pulse of its thrusters."""

MODULATOR_KINDS: tuple[str, ...] = kinds_of(MODULATED_THRUSTER)
"""The kinds that only a spacecraft with a modulator can have."""

WHEEL_KINDS: tuple[str, ...] = kinds_of(WHEEL)
"""The kinds of reaction wheels, which have numbers of their own from 1."""

GYRO_KINDS: tuple[str, ...] = kinds_of(GYRO)
"""The kinds of control-moment gyros, which have numbers of their own from 1."""

FULL_SCALE: dict[str, float] = {one.name: one.full_scale for one in ACTUATOR_TABLE}
"""Per kind of an actuator, the severity that counts as one where severities are shown on a common scale:
shares, rad, s, ohm."""

DEFAULT_SEVERITY: dict[str, Range] = {one.name: one.drawn for one in ACTUATOR_TABLE}
"""Range from which a distribution draws the severity of each kind of an actuator unless it has another:
shares, rad, s, ohm."""

LARGEST_SHARE: dict[str, float] = {
    one.name: one.largest for one in ACTUATOR_TABLE if one.unit == "1" and one.largest < 1.0
}
"""Largest severity of the kinds that may lose no more than this: a discharge needs a slug and a gap."""

LARGEST_RESISTANCE = next(one.largest for one in ACTUATOR_TABLE if one.unit == "ohm")
"""Largest severity of a conductivity loss, ohm."""

_BY_NAME = {one.name: one for one in ACTUATOR_TABLE}
_SENSOR_BY_NAME = {one.name: one for one in SENSOR_TABLE}
_LINE_OF_SENSOR = {one.name: one for one in SENSOR_LINES}


def kind_of(name: str, sensor: str | None = None) -> FaultKind:
    """The line of a kind of an actuator or, with the name of a sensor ("" for any), of a sensor.

    Raises:
        ValueError: A kind that there is not, or that the other of the two has.

    >>> kind_of("leak").meaning
    'opening of the closed valve'
    """
    known, other = (_BY_NAME, _SENSOR_BY_NAME) if sensor is None else (_SENSOR_BY_NAME, _BY_NAME)
    if name in known:
        return known[name]
    if name in other:
        its = f"the {sensor} sensor" if sensor else "a sensor"
        wrong, whose = ("a sensor", "an actuator") if sensor is None else ("an actuator", its)
        raise ValueError(
            f"kind {name!r} is a fault of {wrong}; of {whose} it must be one of {', '.join(known)}"
        )
    raise ValueError(f"kind {shown(name)} is unknown; {suggestion(name, known)}")


def check_kind(kind: str, sensor: str | None = None) -> None:
    """Raise a `ValueError` that names the nearest kind unless an actuator, or a sensor, can have `kind`."""
    kind_of(kind, sensor)


def check_sensor(sensor: str) -> None:
    """Raise a `ValueError` that names the nearest sensor unless `sensor` is one."""
    if sensor not in SENSORS:
        raise ValueError(f"sensor {shown(sensor)} is unknown; {suggestion(sensor, SENSORS)}")


def default_severity(kind: object, sensor: str | None = None) -> float:
    """Severity of a fault of this kind whose severity is not given; 1 for what is no kind.

    >>> default_severity("stuck_off"), default_severity("electrode_sediment")
    (1.0, 0.75)
    >>> default_severity("bias", "rate")
    0.01
    """
    known = _BY_NAME if sensor is None else _SENSOR_BY_NAME
    if not isinstance(kind, str) or kind not in known:
        return 1.0
    return known[kind].default * (_unit(known[kind], sensor) if sensor in _LINE_OF_SENSOR else 1.0)


def drawn_severity(kind: str, sensor: str) -> Range:
    """Range from which a distribution draws the severity of a sensor's fault unless it has another."""
    line, unit = _SENSOR_BY_NAME[kind], _unit(_SENSOR_BY_NAME[kind], sensor)
    return (line.drawn[0] * unit, line.drawn[1] * unit)


def check_severity(kind: str, severity: float, sensor: str | None = None) -> None:
    """Raise a `ValueError` unless a fault of this kind can be that severe."""
    line = kind_of(kind, sensor)
    if sensor is None:
        require(
            line.smallest <= severity <= line.largest, f"severity of a {kind!r} fault", severity, line.right
        )
        return
    low, high, right = line.smallest, line.largest, line.right
    if line.unit.startswith("sensor"):
        its = _LINE_OF_SENSOR[sensor]
        low, high = max(low, -its.largest), min(high, its.largest)
        right = f"from {low:.4g} to {high:.4g} {line.unit.replace('sensor', its.unit)}"
    if not low <= severity <= high:
        raise ValueError(
            f"severity of a {kind!r} fault of the {sensor} sensor must be {right}, got {severity!r}"
        )


def described(table: tuple[FaultKind, ...] = ACTUATOR_TABLE) -> str:
    """The kinds and what their severities mean, one line for each, as docstrings have them.

    >>> described().splitlines()[3]
    '- `leak`: opening of the closed valve.'
    """
    return "\n".join(f"- `{one.name}`: {one.meaning}." for one in table)


def _unit(kind: FaultKind, sensor: str | None) -> float:
    """What one unit of a severity is where it is that of a sensor."""
    return _LINE_OF_SENSOR[sensor].scale if sensor is not None and kind.unit.startswith("sensor") else 1.0
