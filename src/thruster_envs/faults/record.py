"""One fault: of one thruster, of all that share its capacitor, or of one sensor.

The kinds stand in `thruster_envs.faults.kinds`. Those of Yang 2003 (section 4.2: full off, partial, full on,
drift) are there; four that the source lacks: leak, misalignment, late opening, intermittent; three of pulsed
plasma thrusters, which change the discharge and by it the thrust (Valdes 2008, chapter 4: fault cases 1 to
3); one of thrusters whose thrust follows the valve with a lag: slow opening; and two of wiring and command:
sign and bias. A fault is active from `onset` until `onset + duration`; while it is, its severity follows its
profile in time.

Left out: faults of the propellant feed and of the spacecraft's mass properties.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, InitVar, dataclass
from typing import Any, Literal, get_args

from thruster_envs.configuration import coerce_fields, require, shown, suggestion
from thruster_envs.faults.kinds import (
    ACTUATOR_TABLE,
    DISCHARGE_KINDS,
    FULL_SCALE,
    GENERAL_KINDS,
    KINDS,
    LARGEST_RESISTANCE,
    LARGEST_SHARE,
    MODULATOR_KINDS,
    SENSOR_TABLE,
    check_kind,
    check_sensor,
    check_severity,
    default_severity,
    described,
    kind_of,
)

__all__ = [
    "DEFAULT_INTERMITTENT_PERIOD",
    "DISCHARGE_KINDS",
    "FULL_SCALE",
    "GENERAL_KINDS",
    "KINDS",
    "LARGEST_RESISTANCE",
    "LARGEST_SHARE",
    "MODULATOR_KINDS",
    "PROFILES",
    "SHORTEST_PROFILE_TIME",
    "Fault",
    "Profile",
    "check_end",
    "check_kind",
    "check_profile",
    "check_profile_time",
    "check_severity",
    "default_severity",
]

Profile = Literal["step", "ramp", "sine", "intermittent"]

PROFILES: tuple[str, ...] = get_args(Profile)
"""The profiles in time, in the order of their codes; the first has code 0."""

SHORTEST_PROFILE_TIME = 1e-6
"""Shortest ramp or period of a wave, s."""

DEFAULT_INTERMITTENT_PERIOD = 20.0
"""Period of an intermittent fault whose `profile_time` is not given, s."""


@dataclass(frozen=True)
class Fault:
    """What fails, how, how badly, from when, until when, with what profile in time.

    Either a thruster fails or a sensor: `Fault(1, "leak")`, or `Fault(sensor="rate", axis=2, kind="bias")`.

    Attributes:
        thruster: Number of the thruster that fails, from 1; 0 where a sensor does. `actuator` is another
            name of it. The kind says whose it is: reaction wheels and control-moment gyros have numbers of
            their own, from 1.
        kind: What goes wrong; `severity` says how badly. Of an actuator:

            {actuators}

            Of a sensor, where "the measurement" is that of `axis`:

            {sensors}
        severity: As the kind has it; shares lie in 0..1, and what is added to a measurement is in the unit of
            the sensor (m, m/s, rad, rad/s). Unless given, 1 in the unit of the kind, or the largest that the
            kind can have where that is less; of a sensor, what counts for it (`default_severity`).
        onset: When it begins, s from the start of the episode.
        duration: How long it lasts, s; after that the thruster or sensor is sound again.
        profile: How the severity goes with the time since onset:

            - `step`: at once.
            - `ramp`: linearly from zero over `profile_time`, then constant.
            - `sine`: `severity * (1 - cos(2 pi t / profile_time)) / 2`.
            - `intermittent`: a square wave of period `profile_time`, on during the first `dwell` of each.

            A `freeze`, which only acts or does not, takes `step` and `intermittent`.
        profile_time: Length of the ramp, or period of the wave, s. For the kind `intermittent` 0 means 20 s.
        dwell: Share of each period during which an `intermittent` profile is on.
        azimuth: Direction of a misalignment about the nominal thrust, rad.
        craft: Number of the spacecraft that has the fault, from 1.
        shared: Whether it strikes all thrusters that share this one's capacitor.
        sensor: `position` or `velocity` (LVLH axes), `attitude` or `rate` (body axes) where a sensor fails.
            Faults of the attitude turn what is measured about body axes.
        axis: 1, 2 or 3 where one axis of the sensor fails, 0 where all three do.

    Raises:
        ValueError: A value that no fault can have; one line says which and what would be right.
    """

    thruster: int = None  # type: ignore[assignment]  # a number from __post_init__ on: 0 where a sensor fails
    kind: str = None  # type: ignore[assignment]  # required, but a sensor's fault has no thruster before it
    _: KW_ONLY
    severity: float = None  # type: ignore[assignment]  # a number from __post_init__ on: it goes by the kind
    onset: float = 0.0
    duration: float = math.inf
    profile: str = "step"
    profile_time: float = 0.0
    dwell: float = 0.5
    azimuth: float = 0.0
    craft: int = 1
    shared: bool = False
    sensor: str | None = None
    axis: int = 0
    actuator: InitVar[int | None] = None

    def __post_init__(self, actuator: int | None) -> None:
        if actuator is not None and not isinstance(actuator, _Told):
            if self.thruster is not None:
                raise ValueError(
                    f"thruster and actuator are two names of one number; only one of them must be given, got "
                    f"{shown(self.thruster)} and {shown(actuator)}"
                )
            object.__setattr__(self, "thruster", actuator)
        if self.thruster is None and self.sensor is not None:
            object.__setattr__(self, "thruster", 0)
        if self.axis is None:
            object.__setattr__(self, "axis", 0)
        if self.thruster is None:
            raise ValueError("a fault must have a thruster or a sensor, got neither")
        if self.severity is None:
            object.__setattr__(self, "severity", default_severity(self.kind, self._sensor_name()))
        coerce_fields(self)
        self._check_whose()
        require(self.craft >= 1, "craft", self.craft, "a number from 1")
        check_kind(self.kind, self.sensor)
        check_profile(self.profile)
        if self.kind == "intermittent":
            if self.profile == "step":
                object.__setattr__(self, "profile", "intermittent")
            require(
                self.profile == "intermittent", "profile", self.profile, "'intermittent', as the kind is,"
            )
            if self.profile_time == 0.0:
                object.__setattr__(self, "profile_time", DEFAULT_INTERMITTENT_PERIOD)
        if not kind_of(self.kind, self.sensor).profiles and self.profile not in ("step", "intermittent"):
            raise ValueError(
                f"profile of a {self.kind!r} fault must be 'step' or 'intermittent', got {self.profile!r}"
            )
        check_severity(self.kind, self.severity, self.sensor)
        require(
            math.isfinite(self.onset) and self.onset >= 0.0,
            "onset",
            self.onset,
            "a finite number of s, zero or more",
        )
        require(self.duration > 0.0, "duration", self.duration, "a positive number of s, or inf")
        check_end(self.onset, self.duration)
        require(
            math.isfinite(self.profile_time) and self.profile_time >= 0.0,
            "profile_time",
            self.profile_time,
            "a finite number of s, zero or more",
        )
        if self.profile != "step":
            require(
                self.profile_time > 0.0,
                f"profile_time of a {self.profile!r} profile",
                self.profile_time,
                "a positive number of s",
            )
            check_profile_time(self.profile_time)
        require(0.0 < self.dwell <= 1.0, "dwell", self.dwell, "a share above 0 and up to 1")
        require(math.isfinite(self.azimuth), "azimuth", self.azimuth, "a finite number of rad")

    def _sensor_name(self) -> str | None:
        return self.sensor if isinstance(self.sensor, str) else None

    def _check_whose(self) -> None:
        """Refuse a fault of no thruster and no sensor, and one of both."""
        if self.sensor is None:
            require(self.thruster >= 1, "thruster", self.thruster, "a number from 1")
            if self.axis != 0:
                raise ValueError(f"axis must be 0 where no sensor is given, got {self.axis}")
            return
        check_sensor(self.sensor)
        if self.thruster != 0:
            raise ValueError(
                f"a fault must be of a thruster or of a sensor, got thruster {self.thruster} and "
                f"sensor {self.sensor!r}"
            )
        if not 0 <= self.axis <= 3:
            raise ValueError(f"axis must be 1, 2 or 3, or 0 for all three, got {self.axis}")
        if self.shared:
            raise ValueError("shared must be False for a fault of a sensor, got True")


class _Told(int):
    """The number of an actuator as a fault tells it, which `dataclasses.replace` hands back."""


setattr(Fault, "actuator", property(lambda fault: _Told(fault.thruster)))  # noqa: B010  # an argument's name


_KINDS_IN_WORDS: dict[str, Any] = {
    f"{{{name}}}": described(table).replace("\n", "\n            ")
    for name, table in (("actuators", ACTUATOR_TABLE), ("sensors", SENSOR_TABLE))
}
for _name, _words in _KINDS_IN_WORDS.items():
    Fault.__doc__ = (Fault.__doc__ or "").replace(_name, _words)  # none under python -OO


def check_profile(profile: str) -> None:
    """Raise a `ValueError` that names the nearest profile unless `profile` is one."""
    if profile not in PROFILES:
        raise ValueError(f"profile {shown(profile)} is unknown; {suggestion(profile, PROFILES)}")


def check_profile_time(profile_time: float) -> None:
    """Raise a `ValueError` if a ramp or wave would be too quick for the clock of an episode."""
    if profile_time < SHORTEST_PROFILE_TIME:
        raise ValueError(f"profile_time must be at least {SHORTEST_PROFILE_TIME:g} s, got {profile_time:g} s")


def check_end(onset: float, duration: float) -> None:
    """Raise a `ValueError` if a fault would end at the moment at which it begins, for want of digits."""
    if onset + duration == onset:
        raise ValueError(
            f"duration must be at least {math.ulp(onset):.3g} s with an onset of {onset:g} s, "
            f"got {duration:g} s"
        )
