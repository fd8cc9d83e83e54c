"""The actuators of a spacecraft: thrusters and what feeds and drives them, reaction wheels, gyros.

Modelled and left out is what each class says, and what `thruster_envs.physics` says of its motion.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from thruster_envs.configuration import coerce_fields, require, shown

Vector = tuple[float, float, float]

LARGEST = 1e15
"""No value of a description is larger, but for those that may be infinite and the gravitational parameter;
none that has to be positive is smaller than one over this. So what is computed from them stays finite."""

LONGEST_LAG = 1e4
"""Largest time constant, s; with a longer lag rounding would be as large as the thrust."""

MOST_CARRIED = 1000
"""Most control periods by which a modulator may put off a pulse."""


@dataclass(frozen=True, kw_only=True)
class Thruster:
    """One on-off thruster, or anything else that pushes along a fixed line.

    Attributes:
        name: What people call it; unique in its spacecraft.
        position: Where the thrust acts, from the centre of mass, m.
        direction: Direction of the *force on the spacecraft*, opposite to the plume; any length but zero is
            accepted and normalised.
        thrust: Nominal thrust of this thruster firing alone, N.
        minimum_pulse: A command shorter than this opens no valve, s.
        opening_delay: From the command to the valve's opening, s.
        closing_delay: From the end of the command to the valve's closing, s.
        rise_time: From zero to full thrust once the valve is open, linear, s.
        fall_time: From full to zero thrust once the valve is closed, linear, s.
        scatter: Half-width of the uniform scatter of the thrust from one firing to the next, as a share of
            `thrust`.
        specific_impulse: Thrust over weight flow, s; infinite means that firing uses up no mass.
        time_constant: Of the first-order lag with which the thrust follows the valve of a thruster behind a
            modulator, s.
        capacitor: Number, from 1, of the capacitor that a pulsed plasma thruster discharges; thrusters with
            the same one never fire together. 0 for a thruster without one.
    """

    name: str
    position: Vector
    direction: Vector
    thrust: float
    minimum_pulse: float = 0.0
    opening_delay: float = 0.0
    closing_delay: float = 0.0
    rise_time: float = 0.0
    fall_time: float = 0.0
    scatter: float = 0.0
    specific_impulse: float = math.inf
    time_constant: float = 0.0
    capacitor: int = 0

    def __post_init__(self) -> None:
        coerce_fields(self)
        who = f"thruster {shown(self.name)}: "
        require(
            all(map(math.isfinite, self.position)),
            f"{who}position",
            self.position,
            "three finite numbers of m",
        )
        for component in self.position:
            check_size(f"{who}position", component, "m", low=-LARGEST)
        object.__setattr__(self, "direction", unit_vector(f"{who}direction", self.direction))
        check_positive(f"{who}thrust", self.thrust, "N")
        for name in ("minimum_pulse", "opening_delay", "closing_delay", "rise_time", "fall_time"):
            check_not_negative(f"{who}{name}", getattr(self, name), "s")
        check_not_negative(f"{who}time_constant", self.time_constant, "s", largest=LONGEST_LAG)
        require(
            0.0 <= self.scatter < 1.0,
            f"{who}scatter",
            self.scatter,
            "a share of the thrust, at least 0 and below 1",
        )
        require(
            self.specific_impulse > 0.0,
            f"{who}specific_impulse",
            self.specific_impulse,
            "a positive number of s, or inf",
        )
        check_size(f"{who}specific_impulse", self.specific_impulse, "s", low=1.0 / LARGEST, high=math.inf)
        require(self.capacitor >= 0, f"{who}capacitor", self.capacitor, "a number from 1, or 0 for none,")


@dataclass(frozen=True, kw_only=True)
class Feed:
    """The propellant feed that all thrusters share.

    Attributes:
        coupling: Share of its thrust that a thruster loses for each further thruster open at the same moment.
        propellant_mass: Propellant on board, part of the spacecraft's mass, kg; infinite means that it
            never runs out.
    """

    coupling: float = 0.0
    propellant_mass: float = math.inf

    def __post_init__(self) -> None:
        coerce_fields(self)
        require(
            0.0 <= self.coupling <= 1.0, "feed: coupling", self.coupling, "a share of the thrust from 0 to 1"
        )
        require(
            self.propellant_mass >= 0.0,
            "feed: propellant_mass",
            self.propellant_mass,
            "zero or more kg, or inf",
        )


@dataclass(frozen=True, kw_only=True)
class Modulator:
    """The electronics between commands and valves: one pulse per control period, some time later.

    The pulse that is commanded at time `t` begins at `t + delay + variation sin(2 pi t / variation_period +
    phase) + e`: the phase is drawn once an episode, `e` for each thruster and pulse, uniformly within
    `jitter`. So it may lie in a later period. Pulses that overlap are one.

    Attributes:
        delay: Nominal, s.
        variation: Amplitude of what varies alike for all thrusters, s.
        variation_period: Period of that, s.
        jitter: Half-width of what varies from pulse to pulse, s.
    """

    delay: float = 0.0
    variation: float = 0.0
    variation_period: float = 1.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        coerce_fields(self)
        for name in ("delay", "variation", "jitter"):
            check_not_negative(f"modulator: {name}", getattr(self, name), "s")
        check_positive("modulator: variation_period", self.variation_period, "s")
        require(
            self.variation + self.jitter <= self.delay,
            "modulator: variation and jitter together",
            self.variation + self.jitter,
            f"at most the delay, {self.delay!r} s,",
        )


@dataclass(frozen=True, kw_only=True)
class Discharge:
    """The circuit that every pulsed plasma thruster of a spacecraft discharges, when all is well.

    A charged capacitor drives a current through two parallel electrodes and the slug of plasma between them;
    its own magnetic field throws the slug out.

    Attributes:
        capacitance: F.
        inductance: Of the circuit before the slug has moved, H.
        resistance: Of the whole circuit, the plasma included, ohm.
        electrode_gap: Distance between the electrodes, m.
        electrode_width: m.
        slug_mass: Mass of the plasma that one pulse throws out, kg.
        voltage: Of the capacitor when a pulse begins, V.
        duration: How long a pulse is followed, s.
        sample_time: Time between two samples of its waveforms, s; they divide `duration` evenly.
        firing_time: How long one firing pushes with the nominal thrust, s. The impulse of a healthy firing in
            flight is `thrust` times this.
    """

    capacitance: float
    inductance: float
    resistance: float
    electrode_gap: float
    electrode_width: float
    slug_mass: float
    voltage: float
    duration: float = 30e-6
    sample_time: float = 1e-8
    firing_time: float = 0.016

    def __post_init__(self) -> None:
        coerce_fields(self)
        for one in dataclasses.fields(self):
            check_positive(f"discharge: {one.name}", getattr(self, one.name), _DISCHARGE_UNITS[one.name])
        coarsest = COARSEST_SAMPLE * math.sqrt(self.inductance * self.capacitance)
        require(
            self.sample_time <= coarsest,
            "discharge: sample_time",
            self.sample_time,
            f"at most {coarsest:.2g} s, {COARSEST_SAMPLE:g} sqrt(inductance capacitance),",
        )
        steps = self.duration / self.sample_time
        require(
            abs(steps - round(steps)) <= 1e-6 * steps and round(steps) >= 1,
            "discharge: duration",
            self.duration,
            "a whole number of times the sample_time",
        )
        if steps > MOST_SAMPLES:
            raise ValueError(
                f"discharge: duration must be at most {MOST_SAMPLES:,} times the sample_time, got {steps:.3g}"
            )

    @property
    def number_of_samples(self) -> int:
        """Samples of a waveform, both ends included."""
        return round(self.duration / self.sample_time) + 1


#: Longest sample time, in units of sqrt(inductance capacitance): a step of the integration is no longer.
COARSEST_SAMPLE = 0.02

MOST_SAMPLES = 1_000_000
"""Most samples of the waveforms of one pulse."""

_DISCHARGE_UNITS = {
    "capacitance": "F",
    "inductance": "H",
    "resistance": "ohm",
    "electrode_gap": "m",
    "electrode_width": "m",
    "slug_mass": "kg",
    "voltage": "V",
    "duration": "s",
    "sample_time": "s",
    "firing_time": "s",
}


@dataclass(frozen=True, kw_only=True)
class ReactionWheel:
    """A rotor on a fixed axis, with a motor between it and the body.

    A positive torque speeds the rotor up about the axis, and turns the body the other way.

    Attributes:
        name: What people call it; unique among the wheels of its spacecraft.
        axis: In the body; any length but zero is accepted and normalised.
        inertia: Of the rotor about its axis, kg m^2; part of the spacecraft's inertia.
        max_torque: Largest torque of the motor, N m.
        max_speed: Largest speed against the body, rad/s, at which the motor stops pushing.
        coulomb_friction: Dry friction of the bearing, N m.
        viscous_friction: Friction that grows with the speed, N m s.
        initial_speed: Speed against the body at the start of an episode, rad/s.
    """

    name: str
    axis: Vector
    inertia: float
    max_torque: float
    max_speed: float
    coulomb_friction: float = 0.0
    viscous_friction: float = 0.0
    initial_speed: float = 0.0

    def __post_init__(self) -> None:
        coerce_fields(self)
        who = f"reaction wheel {shown(self.name)}: "
        object.__setattr__(self, "axis", unit_vector(f"{who}axis", self.axis))
        for name, unit in (("inertia", "kg m^2"), ("max_torque", "N m"), ("max_speed", "rad/s")):
            check_positive(f"{who}{name}", getattr(self, name), unit)
        check_not_negative(f"{who}coulomb_friction", self.coulomb_friction, "N m")
        check_not_negative(f"{who}viscous_friction", self.viscous_friction, "N m s")
        if not abs(self.initial_speed) <= self.max_speed:
            raise ValueError(
                f"{who}initial_speed must be within the max_speed, {self.max_speed!r} rad/s, "
                f"got {self.initial_speed!r}"
            )


@dataclass(frozen=True, kw_only=True)
class ControlMomentGyro:
    """A rotor of constant momentum, turned across the body by a single gimbal.

    Attributes:
        name: What people call it; unique among the gyros of its spacecraft.
        gimbal_axis: In the body; any length but zero is accepted and normalised.
        spin_axis: Axis of the rotor in the body at the gimbal angle zero, at right angles to the gimbal axis.
        momentum: Of the rotor, N m s.
        max_gimbal_rate: rad/s.
        initial_angle: Of the gimbal at the start of an episode, rad.
    """

    name: str
    gimbal_axis: Vector
    spin_axis: Vector
    momentum: float
    max_gimbal_rate: float
    initial_angle: float = 0.0

    def __post_init__(self) -> None:
        coerce_fields(self)
        who = f"control-moment gyro {shown(self.name)}: "
        for name in ("gimbal_axis", "spin_axis"):
            object.__setattr__(self, name, unit_vector(f"{who}{name}", getattr(self, name)))
        cosine = sum(a * b for a, b in zip(self.gimbal_axis, self.spin_axis, strict=True))
        if abs(cosine) > 1e-9:
            raise ValueError(
                f"{who}spin_axis must be at right angles to the gimbal_axis, got a cosine of {cosine:.3g}"
            )
        check_positive(f"{who}momentum", self.momentum, "N m s")
        check_positive(f"{who}max_gimbal_rate", self.max_gimbal_rate, "rad/s")
        check_size(f"{who}initial_angle", self.initial_angle, "rad", low=-1e6, high=1e6)


def unit_vector(what: str, vector: Vector) -> Vector:
    """The vector at unit length.

    Raises:
        ValueError: It is zero, or not finite.
    """
    length = math.hypot(*vector)
    require(
        math.isfinite(length) and length > 0.0,
        what,
        vector,
        "a finite vector that is not zero",
    )
    if abs(length - 1.0) > 4.0 * np.finfo(np.float64).eps:
        largest = max(map(abs, vector))  # so that neither tiny nor huge components are lost in the norm
        scaled = tuple(component / largest for component in vector)
        length = math.hypot(*scaled)
        x, y, z = (component / length for component in scaled)
        return x, y, z
    return vector


def check_positive(what: str, value: float, unit: str, largest: float = LARGEST) -> None:
    """Refuse what is not a positive number of a size that there is."""
    require(math.isfinite(value) and value > 0.0, what, value, f"a positive number of {unit}")
    check_size(what, value, unit, low=1.0 / LARGEST, high=largest)


def check_not_negative(what: str, value: float, unit: str, largest: float = LARGEST) -> None:
    """Refuse what is not a number from 0 up, of a size that there is."""
    require(math.isfinite(value) and value >= 0.0, what, value, f"a finite number of {unit}, zero or more")
    check_size(what, value, unit, high=largest)


def check_size(what: str, value: float, unit: str, low: float = 0.0, high: float = LARGEST) -> None:
    """Refuse a finite number that no spacecraft has and from which numbers that are not finite may come."""
    if not low <= value <= high:
        raise ValueError(f"{what} must be from {low:g} to {high:g} {unit}, got {value!r}")
