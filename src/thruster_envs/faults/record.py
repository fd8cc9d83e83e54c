"""One fault of one thruster, or of all that share its capacitor.

The kinds are those of Yang 2003 (section 4.2: full off, partial, full on, drift); four that the source
lacks: leak, misalignment, late opening, intermittent; and three of pulsed plasma thrusters, which change the
discharge and by it the thrust (Valdes 2008, chapter 4: fault cases 1 to 3): propellant loss, electrode
sediment, conductivity loss; and one of thrusters whose thrust follows the valve with a lag: slow opening.
A fault is active from `onset` until `onset + duration`; while it is, its
severity follows its profile in time.

Left out: faults of sensors, of the propellant feed and of the spacecraft's mass properties.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Literal, get_args

from thruster_envs.configuration import coerce_fields, require, shown, suggestion
from thruster_envs.spacecraft.description import LONGEST_LAG

Kind = Literal[
    "stuck_off", "stuck_on", "loss", "leak", "misalignment", "late_opening", "intermittent",
    "propellant_loss", "electrode_sediment", "conductivity_loss", "slow_opening",
]  # fmt: skip
Profile = Literal["step", "ramp", "sine", "intermittent"]

KINDS: tuple[str, ...] = get_args(Kind)
"""The kinds of fault, in the order of their codes; the first has code 1, since 0 marks an empty slot."""

DISCHARGE_KINDS: tuple[str, ...] = ("propellant_loss", "electrode_sediment", "conductivity_loss")
"""The kinds that only a spacecraft with a discharge can have: they change a pulse of its thrusters."""

MODULATOR_KINDS: tuple[str, ...] = ("slow_opening",)
"""The kinds that only a spacecraft with a modulator can have."""

GENERAL_KINDS: tuple[str, ...] = tuple(
    kind for kind in KINDS if kind not in DISCHARGE_KINDS + MODULATOR_KINDS
)
"""The kinds that any spacecraft can have."""

PROFILES: tuple[str, ...] = get_args(Profile)
"""The profiles in time, in the order of their codes; the first has code 0."""

FULL_SCALE: dict[str, float] = dict.fromkeys(KINDS, 1.0) | {
    "misalignment": math.pi / 2,
    "late_opening": 5.0,
    "conductivity_loss": 0.1,
    "slow_opening": 1.0,
}
"""Per kind, the severity that counts as one where severities are shown on a common scale: shares, rad, s,
ohm."""

LARGEST_SHARE: dict[str, float] = {"propellant_loss": 0.995, "electrode_sediment": 0.75}
"""Largest severity of the kinds that may lose no more than this: a discharge needs a slug and a gap."""

LARGEST_RESISTANCE = 1.0
"""Largest severity of a conductivity loss, ohm."""

SHORTEST_PROFILE_TIME = 1e-6
"""Shortest ramp or period of a wave, s."""

DEFAULT_INTERMITTENT_PERIOD = 20.0
"""Period of an intermittent fault whose `profile_time` is not given, s."""


@dataclass(frozen=True)
class Fault:
    """What fails, how, how badly, from when, until when, with what profile in time.

    Attributes:
        thruster: Its number, from 1.
        kind: What goes wrong; `severity` says how badly:

            - `stuck_off`: the valve does not open: share of the flow lost (1 = dead).
            - `stuck_on`: the valve's opening whatever is commanded (1 = fully open).
            - `loss`: share of the thrust lost while the flow goes on.
            - `leak`: opening of the closed valve.
            - `misalignment`: angle in rad, up to pi/2, by which the thrust tilts towards `azimuth`.
            - `late_opening`: further opening delay in s.
            - `intermittent`: as `stuck_off`, coming and going; its profile is always `intermittent`.
            - `propellant_loss`: share of the slug of plasma that is lost; the thrust falls.
            - `electrode_sediment`: share of the electrodes' width that is lost; the thrust rises.
            - `conductivity_loss`: resistance added to the circuit, ohm; the thrust falls.
            - `slow_opening`: time added to the time constant with which the thrust rises and falls, s.
        severity: As the kind has it; shares lie in 0..1. Unless given, 1 in the unit of the kind, or the
            largest that the kind can have where that is less (`default_severity`).
        onset: When it begins, s from the start of the episode.
        duration: How long it lasts, s; after that the thruster is sound again.
        profile: How the severity goes with the time since onset:

            - `step`: at once.
            - `ramp`: linearly from zero over `profile_time`, then constant.
            - `sine`: `severity * (1 - cos(2 pi t / profile_time)) / 2`.
            - `intermittent`: a square wave of period `profile_time`, on during the first `dwell` of each.
        profile_time: Length of the ramp, or period of the wave, s. For the kind `intermittent` 0 means 20 s.
        dwell: Share of each period during which an `intermittent` profile is on.
        azimuth: Direction of a misalignment about the nominal thrust, rad.
        craft: Number of the spacecraft that has the fault, from 1.
        shared: Whether it strikes all thrusters that share this one's capacitor.

    Raises:
        ValueError: A value that no fault can have; one line says which and what would be right.
    """

    thruster: int
    kind: str
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

    def __post_init__(self) -> None:
        if self.severity is None:
            object.__setattr__(self, "severity", default_severity(self.kind))
        coerce_fields(self)
        require(self.thruster >= 1, "thruster", self.thruster, "a number from 1")
        require(self.craft >= 1, "craft", self.craft, "a number from 1")
        check_kind(self.kind)
        check_profile(self.profile)
        if self.kind == "intermittent":
            if self.profile == "step":
                object.__setattr__(self, "profile", "intermittent")
            require(
                self.profile == "intermittent", "profile", self.profile, "'intermittent', as the kind is,"
            )
            if self.profile_time == 0.0:
                object.__setattr__(self, "profile_time", DEFAULT_INTERMITTENT_PERIOD)
        check_severity(self.kind, self.severity)
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


def default_severity(kind: object) -> float:
    """Severity of a fault of this kind whose severity is not given.

    >>> default_severity("stuck_off"), default_severity("electrode_sediment")
    (1.0, 0.75)
    """
    return LARGEST_SHARE[kind] if isinstance(kind, str) and kind in LARGEST_SHARE else 1.0


def check_kind(kind: str) -> None:
    """Raise a `ValueError` that names the nearest kind unless `kind` is one."""
    if kind not in KINDS:
        raise ValueError(f"kind {shown(kind)} is unknown; {suggestion(kind, KINDS)}")


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


def check_severity(kind: str, severity: float) -> None:
    """Raise a `ValueError` unless a fault of this kind can be that severe."""
    if kind == "misalignment":
        right, largest = "an angle from 0 to pi/2 rad", math.pi / 2
    elif kind == "late_opening":
        right, largest = "a finite number of s, zero or more", math.nextafter(math.inf, 0.0)
    elif kind == "slow_opening":
        right, largest = f"a time from 0 to {LONGEST_LAG:g} s", LONGEST_LAG
    elif kind == "conductivity_loss":
        right, largest = f"a resistance from 0 to {LARGEST_RESISTANCE:g} ohm", LARGEST_RESISTANCE
    elif kind in LARGEST_SHARE:
        largest = LARGEST_SHARE[kind]
        right = f"a share from 0 to {largest:g}"
    else:
        right, largest = "a share from 0 to 1", 1.0
    require(0.0 <= severity <= largest, f"severity of a {kind!r} fault", severity, right)
