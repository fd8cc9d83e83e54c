"""What a spacecraft is: mass properties, its actuators, the feed of its thrusters, its navigation errors.

Modelled: a rigid body of constant inertia about a fixed centre of mass; thrusters of constant nominal
thrust with a shortest useful pulse, valve delays, rise and fall times and a firing-to-firing scatter; the
thrust that simultaneous firings cost each other through a shared feed (Yang 2003, section 2.3: about 6 %
for each further open thruster); the electrical circuit of pulsed plasma thrusters, and which of them share a
capacitor (Valdes 2008, chapter 3); electronics that open a valve some time after the command (Fonod et al.
2013, section 4), isolation valves and a spare set of thrusters; reaction wheels and control-moment gyros;
white measurement errors, equal on the three axes. What flies and what the flight software
believes are two values of this type.

Left out: the motion of the centre of mass as propellant is used, flexible parts, plume impingement,
sensor biases; a shared feed or valves with linear ramps together with a modulator, and
isolation valves or thrust with a lag without one. Faults are not a property of the description: they are
data of their own, in `thruster_envs.faults`.

All lengths, forces and rates are in SI units and in body axes, with the centre of mass as origin.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.configuration import coerce_fields, from_mapping, require, shown, to_mapping
from thruster_envs.spacecraft.actuators import LARGEST as LARGEST  # it stood here once
from thruster_envs.spacecraft.actuators import LONGEST_LAG as LONGEST_LAG
from thruster_envs.spacecraft.actuators import (
    MOST_CARRIED,
    ControlMomentGyro,
    Discharge,
    Feed,
    Modulator,
    ReactionWheel,
    Thruster,
    check_positive,
    check_size,
)
from thruster_envs.spacecraft.actuators import Vector as Vector
from thruster_envs.spacecraft.brief import brief
from thruster_envs.spacecraft.orbit import EARTH_MU as EARTH_MU  # it stood here once
from thruster_envs.spacecraft.orbit import FASTEST_ORBIT, Orbit

ROUND_OFF = 1e-6
"""Share of the largest principal moment by which it may exceed the sum of the other two."""

SLACK_FACTOR = 20.0
"""How much dearer it is to miss all of an axis's authority than to fire all thrusters for a whole period."""


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """One standard deviation, per axis, of the white errors of relative navigation.

    Attributes:
        distribution: Of the errors: "normal", or "uniform", which then reach sqrt(3) standard deviations.
        position: m.
        velocity: m/s.
        attitude: rad.
        rate: rad/s.
    """

    position: float = 0.0
    velocity: float = 0.0
    attitude: float = 0.0
    rate: float = 0.0
    distribution: Literal["normal", "uniform"] = "normal"

    def __post_init__(self) -> None:
        coerce_fields(self)
        for name, unit in (("position", "m"), ("velocity", "m/s"), ("attitude", "rad"), ("rate", "rad/s")):
            value = getattr(self, name)
            require(
                math.isfinite(value) and value >= 0.0,
                f"sensors: {name}",
                value,
                "a finite number, zero or more",
            )
            check_size(f"sensors: {name}", value, unit)


_MEAN_MOTION = 0.0011  # rad/s, of a low orbit of the Earth


@dataclass(frozen=True, kw_only=True)
class Spacecraft:
    """A spacecraft as the flight software, or the truth, has it.

    Thrusters are numbered from 1 in what people read and type, and from 0 in arrays, in the order given here.

    Attributes:
        name: What the vehicle is called.
        mass: With all its propellant, kg.
        inertia: About the centre of mass, body axes, 3 rows of 3, kg m^2; symmetric and positive definite,
            no principal moment larger than the sum of the other two.
        unphysical_inertia: Take an inertia that breaks this last rule, as printed by a source.
        thrusters: At least one.
        feed: The propellant feed that they share.
        sensors: Errors of the relative navigation.
        control_period: Time between two commands, s.
        mean_motion: Of the orbit about which it flies, rad/s. Without an `orbit` that is a circular one.
        gravitational_parameter: Of the planet below, m^3/s^2; the Earth's unless given.
        orbit: The orbit by its elements, where it is not just a circular one of that mean motion. It then
            gives `mean_motion` and `gravitational_parameter` too.
        modulator: The electronics that put off its pulses; None where valves follow the command by
            themselves.
        isolation_valves: Whether there is a second valve before each thruster that can be closed to stop its
            flow, whatever is wrong with it.
        spare_branch: Whether there is a second set of thrusters like the first, unused until it takes over
            as a whole.
        discharge: The circuit of its thrusters, all of which are then pulsed plasma thrusters with a
            capacitor; None where no thruster is one.
        reaction_wheels: Numbered from 1 like thrusters, apart from them. The inertia is that with all rotors
            held.
        control_moment_gyros: Numbered likewise. The inertia is that with all gimbals at any angle: their own
            is left out.
        provenance: Where values come from: dotted field name to "stated", "reconstructed: why" or
            "external: what". It takes no part in the hash, and in nothing that is computed.

    Raises:
        ValueError: A value that no spacecraft can have; one line says which and what would be right.
    """

    name: str
    mass: float
    inertia: tuple[Vector, Vector, Vector]
    unphysical_inertia: bool = False
    thrusters: tuple[Thruster, ...]
    feed: Feed = field(default_factory=Feed)
    sensors: Sensors = field(default_factory=Sensors)
    control_period: float = 5.0
    mean_motion: float = _MEAN_MOTION
    gravitational_parameter: float = EARTH_MU
    orbit: Orbit | None = None
    modulator: Modulator | None = None
    isolation_valves: bool = False
    spare_branch: bool = False
    discharge: Discharge | None = None
    reaction_wheels: tuple[ReactionWheel, ...] = ()
    control_moment_gyros: tuple[ControlMomentGyro, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        coerce_fields(self)
        check_positive("mass", self.mass, "kg")
        _check_inertia(self.inertia, self.unphysical_inertia)
        require(len(self.thrusters) > 0, "thrusters", (), "at least one thruster")
        _check_names("thrusters", self.thrusters)
        propellant = self.feed.propellant_mass
        if math.isfinite(propellant):
            require(
                propellant < self.mass,
                "feed: propellant_mass",
                propellant,
                f"less than the mass, {self.mass!r} kg",
            )
        elif any(math.isfinite(thruster.specific_impulse) for thruster in self.thrusters):
            raise ValueError(
                "feed: propellant_mass is infinite while a thruster has a finite specific_impulse, so that "
                "the mass would fall below zero; a finite propellant_mass, or specific_impulse = inf, "
                "would be right"
            )
        check_positive("control_period", self.control_period, "s")
        self._follow_orbit()
        check_positive("mean_motion", self.mean_motion, "rad/s", largest=FASTEST_ORBIT)
        check_positive("gravitational_parameter", self.gravitational_parameter, "m^3/s^2", largest=1e25)
        self._check_modulator()
        self._check_discharge()
        self._check_storage()

    def _follow_orbit(self) -> None:
        """Take what the orbit gives from it, and refuse other values beside it."""
        for name, default in (("mean_motion", _MEAN_MOTION), ("gravitational_parameter", EARTH_MU)):
            if self.orbit is None:
                return
            value, its = getattr(self, name), getattr(self.orbit, name)
            if value not in (default, its):
                raise ValueError(
                    f"{name} must be left out beside an orbit, or be that of the orbit, {its!r}, "
                    f"got {value!r}"
                )
            object.__setattr__(self, name, its)

    def _check_modulator(self) -> None:
        if self.modulator is None:
            require(
                not self.isolation_valves,
                "isolation_valves",
                self.isolation_valves,
                "False, or a modulator beside it (one without delay at the least),",
            )
            for thruster in self.thrusters:
                require(
                    thruster.time_constant == 0.0,
                    f"thruster {shown(thruster.name)}: time_constant",
                    thruster.time_constant,
                    "0 s where there is no modulator",
                )
            return
        modulator, period = self.modulator, self.control_period
        turn = math.sin(math.pi * min(period / modulator.variation_period, 0.5))
        closer = 2.0 * modulator.jitter + 2.0 * modulator.variation * turn
        require(
            closer <= period,
            "modulator: by how much variation and jitter may bring two pulses together",
            closer,
            f"at most the control_period, {period!r} s, so that pulses keep their order,",
        )
        latest = modulator.delay + modulator.variation + modulator.jitter
        latest += max(thruster.closing_delay for thruster in self.thrusters)
        if latest > MOST_CARRIED * period:
            raise ValueError(
                f"modulator: the delay of a pulse's end must be at most {MOST_CARRIED} control periods, "
                f"{MOST_CARRIED * period:g} s, got {latest:g} s"
            )
        require(
            self.feed.coupling == 0.0, "feed: coupling", self.feed.coupling, "0 where there is a modulator"
        )
        require(self.discharge is None, "discharge", self.discharge, "None where there is a modulator")
        for thruster in self.thrusters:
            for name in ("rise_time", "fall_time"):
                require(
                    getattr(thruster, name) == 0.0,
                    f"thruster {shown(thruster.name)}: {name}",
                    getattr(thruster, name),
                    "0 s behind a modulator, and a time_constant instead,",
                )

    def _check_discharge(self) -> None:
        for thruster in self.thrusters:
            if self.discharge is not None and thruster.capacitor == 0:
                raise ValueError(
                    f"thruster {shown(thruster.name)} has no capacitor while the spacecraft has a discharge; "
                    "a number from 1 for each thruster would be right"
                )
            if self.discharge is None and thruster.capacitor > 0:
                raise ValueError(
                    f"thruster {shown(thruster.name)} has the capacitor {thruster.capacitor} while the "
                    "spacecraft has no discharge; a [discharge] table, or capacitor = 0, would be right"
                )
        if self.discharge is not None:
            require(
                self.discharge.firing_time <= self.control_period,
                "discharge: firing_time",
                self.discharge.firing_time,
                f"at most the control_period, {self.control_period!r} s,",
            )

    def __repr__(self) -> str:
        """A few lines that tell it from others; `to_dict` has everything."""
        return brief(self)

    @property
    def reference_orbit(self) -> Orbit:
        """The orbit about which it flies: `orbit`, or else the circular one of `mean_motion`."""
        if self.orbit is not None:
            return self.orbit
        return Orbit(mean_motion=self.mean_motion, gravitational_parameter=self.gravitational_parameter)

    def circular_mean_motion(self, who: str) -> float:
        """The mean motion for someone who has no other use for the orbit, rad/s.

        Args:
            who: What needs a circular orbit, for the error line.

        Raises:
            ValueError: The orbit is elliptic.
        """
        if self.orbit is not None and not self.orbit.is_circular:
            raise ValueError(
                f"{who} needs a circular orbit: the eccentricity of {shown(self.name)} must be 0, "
                f"got {self.orbit.eccentricity!r}"
            )
        return self.mean_motion

    def _check_storage(self) -> None:
        _check_names("reaction_wheels", self.reaction_wheels)
        _check_names("control_moment_gyros", self.control_moment_gyros)
        free = np.array(self.inertia)
        for wheel in self.reaction_wheels:
            free -= wheel.inertia * np.outer(wheel.axis, wheel.axis)
        smallest = float(np.linalg.eigvalsh(free).min())
        if self.reaction_wheels and not smallest > 1e-6 * np.abs(free).max():
            raise ValueError(
                "reaction_wheels: the inertia must be that with all rotors held, and without their own about "
                f"their axes have positive principal moments, got {smallest:.4g} kg m^2"
            )

    @property
    def stores_momentum(self) -> bool:
        """Whether it has reaction wheels or control-moment gyros."""
        return bool(self.reaction_wheels or self.control_moment_gyros)

    @property
    def number_of_thrusters(self) -> int:
        """How many thrusters there are."""
        return len(self.thrusters)

    def wrenches(self) -> NDArray[np.float64]:
        """Nominal force and torque of each thruster firing alone.

        Returns:
            (6, n): rows 0 to 2 the force in N, rows 3 to 5 the torque r x F in N m; body axes.
        """
        positions = np.array([thruster.position for thruster in self.thrusters])
        thrusts = np.array([thruster.thrust for thruster in self.thrusters])
        forces = np.array([thruster.direction for thruster in self.thrusters]) * thrusts[:, np.newaxis]
        return np.vstack([forces.T, np.cross(positions, forces).T])

    def effectiveness(self, mass: float | None = None) -> NDArray[np.float64]:
        """Rate change that each thruster gives per second of firing alone (Yang 2003, Table 10).

        The torque acts on a body at rest: the gyroscopic term is left to the equations of motion.

        Args:
            mass: Present mass in kg; by default the mass with all propellant.

        Returns:
            (6, n): rows x, y, z of translation in m/s^2, then of rotation in rad/s^2; body axes.

        Raises:
            ValueError: A mass that is not positive.
        """
        mass = self.mass if mass is None else float(mass)
        require(math.isfinite(mass) and mass > 0.0, "mass", mass, "a positive number of kg")
        wrenches = self.wrenches()
        return np.vstack([wrenches[:3] / mass, np.linalg.solve(np.array(self.inertia), wrenches[3:])])

    def authority(self, period: float | None = None) -> NDArray[np.float64]:
        """Largest rate change per axis, over both signs, that one period can give.

        Every thruster that helps on that axis fires for the whole period, whatever it does on the other
        axes, and without feed coupling.

        Args:
            period: s; by default the control period.

        Returns:
            (6,): m/s for the three translations, rad/s for the three rotations; body axes.
        """
        period = self.control_period if period is None else float(period)
        require(math.isfinite(period) and period > 0.0, "period", period, "a positive number of s")
        return period * _reach(self.effectiveness())

    def replace(self, **changes: Any) -> Spacecraft:
        """The same spacecraft with some fields changed.

        Another `orbit` brings its own mean motion and gravitational parameter; None goes back to the default.

        Raises:
            ValueError: An unknown field, or a value that no spacecraft can have.
        """
        current = {one.name: getattr(self, one.name) for one in dataclasses.fields(self)}
        if "orbit" in changes:  # it brings its own
            del current["mean_motion"], current["gravitational_parameter"]
        return from_mapping(Spacecraft, current | changes)

    def to_dict(self) -> dict[str, Any]:
        """The description as plain dicts, tuples, strings and numbers; `from_dict` reads it back."""
        return to_mapping(self)

    @classmethod
    def from_dict(cls, mapping: Mapping[str, Any], where: str = "spacecraft") -> Spacecraft:
        """Build a spacecraft from a plain mapping of its fields.

        Args:
            mapping: Such as `to_dict` returns, or a JSON or TOML reader.
            where: Where the mapping stands, put at the head of every error line.

        Raises:
            ValueError: One line that says what is wrong, where, and what would be right.
        """
        return from_mapping(cls, _with_orbit(mapping, where), where)


def _with_orbit(mapping: Any, where: str) -> Any:
    """The mapping of a spacecraft, with an orbit that has what stands beside it and not in it.

    Raises:
        ValueError: Both give it, and differently.
    """
    orbit = mapping.get("orbit") if isinstance(mapping, Mapping) else None
    if not isinstance(orbit, Mapping):
        return mapping
    merged = dict(orbit)
    size = "mean_motion" in orbit or "semi_major_axis" in orbit
    for name, given in (
        ("mean_motion", size),
        ("gravitational_parameter", "gravitational_parameter" in orbit),
    ):
        if name in mapping and not given:
            merged[name] = mapping[name]
    built = from_mapping(Orbit, merged, f"{where}: orbit" if where else "orbit")
    for name in ("mean_motion", "gravitational_parameter"):
        if name in mapping and mapping[name] != getattr(built, name):
            raise ValueError(
                f"{where}: {name} must be that of the orbit, {getattr(built, name)!r}, or left out, "
                f"got {shown(mapping[name])}"
            )
    return {**mapping, "orbit": built}


def objective_weights(
    effectiveness: ArrayLike, period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a second of firing costs, and what a miss costs, in the objective of the mapping problem.

    The objective is `fuel_cost @ on_times + slack_cost @ abs(slack)` (Yang 2003, eqs. 1-3). Here a miss as
    large as an axis's authority costs `SLACK_FACTOR` times what it costs to fire all thrusters for the
    whole period. This scales with the vehicle and its units, where the fixed K = 1000 of the source gives
    up an axis of Orion after a fault.

    Args:
        effectiveness: (m, n), rate change per second of firing, m/s^2 and rad/s^2.
        period: s.

    Returns:
        `fuel_cost` (n,), per s of firing, all ones; `slack_cost` (m,), per m/s and per rad/s. An axis
        without any authority has the largest weight of the others.

    Raises:
        ValueError: A matrix that is not two-dimensional, not finite, or zero throughout; a period that is
            not positive.
    """
    matrix = np.asarray(effectiveness, dtype=np.float64)
    if matrix.ndim != 2 or 0 in matrix.shape:
        raise ValueError(f"effectiveness has the shape {matrix.shape}; (axes, thrusters) would be right")
    if not np.all(np.isfinite(matrix)):
        row, column = np.argwhere(~np.isfinite(matrix))[0]
        raise ValueError(
            f"effectiveness[{row}, {column}] is {matrix[row, column]}; a finite number would be right"
        )
    require(math.isfinite(period) and period > 0.0, "period", period, "a positive number of s")
    authority = period * _reach(matrix)
    if not np.any(authority > 0.0):
        raise ValueError(
            "effectiveness is zero throughout; at least one thruster with an effect would be right"
        )
    number_of_thrusters = matrix.shape[1]
    smallest = np.min(authority[authority > 0.0])
    slack_cost = SLACK_FACTOR * number_of_thrusters * period / np.where(authority > 0.0, authority, smallest)
    return np.ones(number_of_thrusters), slack_cost


def _reach(effectiveness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Per row, the larger of the sums of the positive and of the negative entries, as a magnitude."""
    positive = np.maximum(effectiveness, 0.0).sum(axis=1)
    negative = np.maximum(-effectiveness, 0.0).sum(axis=1)
    reach: NDArray[np.float64] = np.maximum(positive, negative)
    return reach


def _check_names(what: str, actuators: tuple[Any, ...]) -> None:
    names: dict[str, int] = {}
    for number, one in enumerate(actuators, start=1):
        if one.name in names:
            raise ValueError(
                f"{what} {names[one.name]} and {number} are both named {shown(one.name)}; "
                "a name of its own for each would be right"
            )
        names[one.name] = number


def _check_inertia(inertia: tuple[Vector, Vector, Vector], unphysical: bool) -> None:
    matrix = np.array(inertia)
    require(bool(np.all(np.isfinite(matrix))), "inertia", inertia, "nine finite numbers of kg m^2")
    largest = float(np.abs(matrix).max())
    if largest == 0.0:
        raise ValueError("inertia must have positive principal moments, got nine zeros")
    check_size("inertia: its largest entry", largest, "kg m^2", low=1.0 / LARGEST)
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12 * largest):
        raise ValueError(
            f"inertia is {inertia!r}, which is not symmetric; "
            "the same value across the diagonal would be right"
        )
    first, second, third = np.linalg.eigvalsh(matrix).tolist()
    if not first > 1e-12 * largest:
        raise ValueError(
            f"inertia is {inertia!r}, which is not positive definite: its smallest principal moment is "
            f"{first:.4g} kg m^2; positive principal moments would be right"
        )
    if third - first - second > ROUND_OFF * third and not unphysical:
        raise ValueError(
            "inertia must be that of a body, each principal moment at most the sum of the other two, "
            f"got {first:.6g}, {second:.6g} and {third:.6g} kg m^2; "
            "unphysical_inertia = true takes it as it is"
        )
