"""The referee: one craft flown slowly, plainly and very accurately, to judge the compiled kernels by.

What is modelled is the flight model of the suite: rigid-body attitude, translation relative to a circular
orbit (Hill-Clohessy-Wiltshire or the exact two-body equations), and thrusters with minimum pulse, delays,
rise and fall, firing scatter, feed coupling, propellant and every kind of fault. What is left out is what the
model leaves out: gravity gradient, drag, sloshing, a moving centre of mass, a changing inertia.

How it works. Each period is cut wherever something changes its law: a valve opens or closes, a level reaches
its end, a fault begins, ends, switches, stops ramping or passes a quarter of its sine, a feed has just lost
all its thrust. Inside a piece every thrust is a smooth function of time, evaluated exactly at every stage of
SciPy's DOP853. Nothing is shared with the kernels: no code, no quadratic representation, no sub-step.

Conventions. SI. LVLH: x radial, y along-track, z cross-track; it turns at the mean motion n about its +z, and
coincides with the inertial frame at t = 0. Quaternions are (w, x, y, z), unit, Hamilton product,
body-from-LVLH: `v_body = q v_lvlh q*`. Body rate: inertial, in body axes. Thrusters are numbered from 1 in
`Fault`, from 0 in arrays.

Readings chosen where the model could be read in more than one way:

1.  Consecutive commands are one *run* when each but the last lasts to its period's end. A run has one opening
    delay, counted from its first command, and one closing delay, after its last. So a delay longer than a
    period (late opening) keeps the valve closed on into the run's next periods. A run that would open after
    it closes never opens.
2.  A duty of exactly 0 commands nothing, also when the minimum pulse is 0. A command below the minimum pulse
    commands nothing, so it also ends a run.
3.  Pulses that overlap or touch merge (the valve is open on their union). Each pulse keeps the delay that it
    had when it was commanded, also when that lies beyond the end of its period.
4.  The level that rises and falls is the valve's own; faults act on what it passes on to the nozzle. When a
    fault ends, the opening is at once what the level says.
5.  While stuck_on is active the opening is its severity, even when that is less than the commanded level, 0
    included (a ramp begins there). Of several, the last in the list holds.
6.  Outside its dwell an intermittent profile is not active: stuck_on then leaves the commanded level as it
    is.
7.  Whatever the order of the list, stuck_on acts before leak, and leak before stuck_off and intermittent.
8.  Several misalignments turn the force one after the other: each takes its azimuth relative to the direction
    that the one before it left.
9.  Several late openings add up. Their severity is read at the time `k T` at which a run begins, on [onset,
    end).
10. Feed coupling counts the openings after faults: a leak or a stuck-on valve takes thrust from the others, a
    stuck-off valve takes none.
11. The scatter of a period is that of all flow in the period, tails and leaks included.
12. A craft is out of propellant when its mass at the start of a period is not above `spacecraft.mass -
    feed.propellant_mass`; then nothing flows, leaks and stuck-on valves included.
13. Fault times count from the start of the flight. Before it all valves are closed, at level 0, and nothing
    was commanded.
14. A bias adds to the duty of the commands that are given while it acts, up to 1; so where nothing is
    commanded, it is a command.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.physics.closed_forms import cross, orbit_radius, product, rotation_matrix
from thruster_envs.faults import Fault
from thruster_envs.spacecraft import Spacecraft

Array = NDArray[np.float64]
Loads = tuple[Array, Array, float]
"""Force (3,) N and torque (3,) N m in body axes, and propellant flow, kg/s."""

STANDARD_GRAVITY = 9.80665
"""m/s^2, in the definition of specific impulse."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
"""Gauss and Legendre's rule on [-1, 1]: exact for polynomials of degree 47, far above what a piece holds."""
SHORTEST_PIECE = 1e-15
"""s. Cuts closer than this are the same moment twice, up to round-off."""


@dataclass(frozen=True, kw_only=True)
class FlightState:
    """State of one craft.

    Attributes:
        position: (3,) m, relative to the origin of LVLH, in LVLH axes.
        velocity: (3,) m/s, as seen in the turning LVLH axes.
        attitude: (4,) unit quaternion, body-from-LVLH.
        rate: (3,) rad/s, inertial angular rate in body axes.
        mass: kg; None is the spacecraft's own, with all its propellant.
    """

    position: ArrayLike = (0.0, 0.0, 0.0)
    velocity: ArrayLike = (0.0, 0.0, 0.0)
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)
    rate: ArrayLike = (0.0, 0.0, 0.0)
    mass: float | None = None


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A flight of K control periods with n thrusters; K + 1 states, the first being the initial one.

    Attributes:
        time: (K + 1,) s.
        position: (K + 1, 3) m, LVLH.
        velocity: (K + 1, 3) m/s, LVLH.
        attitude: (K + 1, 4) body-from-LVLH, unit, continuous in sign.
        rate: (K + 1, 3) rad/s, body axes.
        mass: (K + 1,) kg, from the integrator.
        impulse: (K, n) N s, by quadrature: integral of each thruster's delivered thrust, with coupling,
            scatter, openings and lost gain in it; its direction is not.
        propellant: (K,) kg used in each period, by quadrature.
    """

    time: Array
    position: Array
    velocity: Array
    attitude: Array
    rate: Array
    mass: Array
    impulse: Array
    propellant: Array


def fly(
    spacecraft: Spacecraft,
    duties: ArrayLike,
    *,
    initial: FlightState | None = None,
    faults: Sequence[Fault] = (),
    scatter: ArrayLike | None = None,
    dynamics: Literal["hcw", "nonlinear"] = "hcw",
    craft: int = 1,
    rtol: float = 1e-12,
    atol: float = 1e-15,
) -> Flight:
    """Fly one craft through a sequence of control periods.

    Args:
        spacecraft: What flies.
        duties: (K, n) commanded on-time as a share of the period, in [0, 1].
        initial: By default at the origin, aligned with LVLH, at rest (inertially: LVLH turns away from it).
        faults: What fails, in the order of the slots; those of another craft are ignored.
        scatter: (K, n) relative error of each thruster's thrust in each period: the draw in [-1, 1] times the
            half-width of the thruster. Zero by default.
        dynamics: "hcw" (Hill-Clohessy-Wiltshire) or "nonlinear" (two bodies, circular reference orbit).
        craft: Number of the craft, from 1.
        rtol: Relative tolerance of DOP853.
        atol: Absolute tolerance of DOP853, in the unit of each component.

    Raises:
        ValueError: Duties or scatter of a wrong shape, duties outside [0, 1], unknown dynamics, or a fault of
            a thruster that does not exist.
    """
    duties, scatter = checked_commands(spacecraft, duties, scatter)
    if dynamics not in ("hcw", "nonlinear"):
        raise ValueError(f"dynamics is {dynamics!r}; 'hcw' or 'nonlinear' would be right")
    state = initial_vector(spacecraft, FlightState() if initial is None else initial)
    dry_mass = spacecraft.mass - spacecraft.feed.propellant_mass
    firing = Firing(spacecraft, faults, craft=craft)

    states, impulses, propellants = [state], [], []
    for period_duties, period_scatter in zip(duties, scatter, strict=True):
        pieces: Sequence[Piece | Coast] = firing.next_period(period_duties, period_scatter)
        if state[13] <= dry_mass:
            pieces = [Coast(spacecraft)]
        for piece in pieces:
            state = integrate(spacecraft, piece, state, dynamics, rtol, atol)
        states.append(state)
        impulses.append(sum(piece.integral(piece.thrust) for piece in pieces))
        propellants.append(sum(piece.integral(piece.mass_flow) for piece in pieces))

    history = np.array(states)
    return Flight(
        time=spacecraft.control_period * np.arange(len(states)),
        position=history[:, 0:3],
        velocity=history[:, 3:6],
        attitude=history[:, 6:10],
        rate=history[:, 10:13],
        mass=history[:, 13],
        impulse=np.array(impulses).reshape(duties.shape),
        propellant=np.array(propellants, dtype=float),
    )


def delivered_impulse(
    spacecraft: Spacecraft,
    duties: ArrayLike,
    *,
    faults: Sequence[Fault] = (),
    scatter: ArrayLike | None = None,
    craft: int = 1,
) -> Array:
    """Impulse of each thruster in each period, (K, n) N s, as if propellant never ran out.

    Arguments as those of `fly`.
    """
    duties, scatter = checked_commands(spacecraft, duties, scatter)
    firing = Firing(spacecraft, faults, craft=craft)
    impulses = [
        sum(piece.integral(piece.thrust) for piece in firing.next_period(period_duties, period_scatter))
        for period_duties, period_scatter in zip(duties, scatter, strict=True)
    ]
    return np.array(impulses).reshape(duties.shape)


def checked_commands(
    spacecraft: Spacecraft, duties: ArrayLike, scatter: ArrayLike | None
) -> tuple[Array, Array]:
    """Duties and scatter as (K, n) arrays; ValueError for a wrong shape or a duty outside [0, 1]."""
    duties = np.array(duties, dtype=float)
    scatter = np.zeros_like(duties) if scatter is None else np.array(scatter, dtype=float)
    n = spacecraft.number_of_thrusters
    if duties.ndim != 2 or duties.shape[1] != n:
        raise ValueError(f"duties have the shape {duties.shape}; (periods, {n}) would be right")
    if scatter.shape != duties.shape:
        raise ValueError(
            f"scatter has the shape {scatter.shape}; {duties.shape}, as the duties, would be right"
        )
    if not np.all((duties >= 0.0) & (duties <= 1.0)):
        raise ValueError("a duty lies outside [0, 1]; shares of the period would be right")
    return duties, scatter


def initial_vector(spacecraft: Spacecraft, initial: FlightState) -> Array:
    """The 14 integrated components: position, velocity, attitude, rate, mass."""
    attitude = np.array(initial.attitude, dtype=float)
    mass = spacecraft.mass if initial.mass is None else initial.mass
    return np.concatenate(
        [
            np.array(initial.position, dtype=float),
            np.array(initial.velocity, dtype=float),
            attitude / np.linalg.norm(attitude),
            np.array(initial.rate, dtype=float),
            [mass],
        ]
    )


def integrate(
    spacecraft: Spacecraft, piece: Piece | Coast, state: Array, dynamics: str, rtol: float, atol: float
) -> Array:
    """Carry the 14 components through one piece."""
    inertia = np.array(spacecraft.inertia)
    inverse_inertia = np.linalg.inv(inertia)
    mean_motion = spacecraft.mean_motion
    orbital_acceleration = hcw_acceleration if dynamics == "hcw" else two_body_relative_acceleration
    lvlh_rate = np.array([0.0, 0.0, 0.0, mean_motion])
    steady_loads = piece.loads(0.5 * (piece.start + piece.end)) if piece.is_steady else None

    def derivative(time: float, state: Array) -> Array:
        position, velocity, attitude, rate, mass = np.split(state, [3, 6, 10, 13])
        force, torque, mass_flow = steady_loads or piece.loads(time)
        force_lvlh = rotation_matrix(attitude).T @ force
        # The body turns at `rate`; the frame that it is compared with turns at the mean motion about z.
        body_rate = np.concatenate([[0.0], rate])
        attitude_change = 0.5 * (product(attitude, lvlh_rate) - product(body_rate, attitude))
        acceleration = orbital_acceleration(position, velocity, mean_motion) + force_lvlh / mass
        rate_change = inverse_inertia @ (torque - cross(rate, inertia @ rate))
        return np.concatenate([velocity, acceleration, attitude_change, rate_change, [-mass_flow]])

    solution = solve_ivp(derivative, (piece.start, piece.end), state, method="DOP853", rtol=rtol, atol=atol)
    if not solution.success:
        raise ArithmeticError(f"DOP853 stopped between {piece.start} and {piece.end} s: {solution.message}")
    after: Array = solution.y[:, -1]
    after[6:10] /= np.linalg.norm(after[6:10])
    return after


def hcw_acceleration(position: Array, velocity: Array, mean_motion: float) -> Array:
    """Hill-Clohessy-Wiltshire acceleration in LVLH (3,) m/s^2, from (3,) m and (3,) m/s."""
    x, _, z = position
    vx, vy, _ = velocity
    n = mean_motion
    return np.array([2.0 * n * vy + 3.0 * n * n * x, -2.0 * n * vx, -n * n * z])


def two_body_relative_acceleration(position: Array, velocity: Array, mean_motion: float) -> Array:
    """Exact relative acceleration about a circular orbit in LVLH (3,) m/s^2, from (3,) m and (3,) m/s.

    `n^2 R - mu (R + x) / r^3 + n^2 x` loses nine digits as it stands. With `e = (2 R x + |position|^2) / R^2`
    it is `n^2 (R + x) (1 - (1 + e)^(-3/2))`, which loses none; y and z likewise.
    """
    x, y, z = position
    vx, vy, _ = velocity
    n = mean_motion
    radius = orbit_radius(n)
    excess = (2.0 * radius * x + x * x + y * y + z * z) / radius**2
    pull = math.expm1(-1.5 * math.log1p(excess))  # (R / r)^3 - 1
    return np.array(
        [
            2.0 * n * vy - n * n * (radius + x) * pull,
            -2.0 * n * vx - n * n * y * pull,
            -n * n * z * (1.0 + pull),
        ]
    )


@dataclass
class Pulse:
    """A stretch of time in which a valve is open, s from the start of the present period."""

    opens: float
    closes: float


@dataclass
class Valve:
    """What a valve carries from one period into the next.

    Attributes:
        pulses: Those that are not over yet, the latest last.
        in_run: Whether the last command lasted to its period's end, so that a next one goes on with the last
            pulse.
        level: At the end of the last period, 0 to 1, before faults.
    """

    pulses: list[Pulse] = field(default_factory=list)
    in_run: bool = False
    level: float = 0.0

    def command(
        self, on_time: float, period: float, minimum_pulse: float, opening_delay: float, closing_delay: float
    ) -> None:
        """Take the command of the present period; all in s."""
        if on_time == 0.0 or on_time < minimum_pulse:
            self.in_run = False
            return
        if self.in_run:
            self.pulses[-1].closes = on_time + closing_delay  # its opening lies behind it, or still before it
        else:
            self.pulses.append(Pulse(opening_delay, on_time + closing_delay))
        self.in_run = on_time == period

    def end_period(self, period: float, level: float) -> None:
        """Count times from the start of the next period, and forget the pulses that are over."""
        self.level = level
        for pulse in self.pulses:
            pulse.opens -= period
            pulse.closes -= period
        last = self.pulses[-1:] if self.in_run else []
        others = self.pulses[:-1] if self.in_run else self.pulses
        self.pulses = [pulse for pulse in others if pulse.closes > 0.0] + last

    def open_stretches(self) -> list[tuple[float, float]]:
        """Disjoint, ordered stretches [opens, closes) in s; a pulse that closes before it opens drops out."""
        stretches: list[tuple[float, float]] = []
        proper = [pulse for pulse in self.pulses if pulse.opens < pulse.closes and pulse.closes > 0.0]
        for opens, closes in sorted((max(0.0, pulse.opens), pulse.closes) for pulse in proper):
            if stretches and opens <= stretches[-1][1]:
                stretches[-1] = (stretches[-1][0], max(closes, stretches[-1][1]))
            else:
                stretches.append((opens, closes))
        return stretches


@dataclass(frozen=True)
class LevelLine:
    """From `start` on (s), the level of a valve is `level + slope * (time - start)`, within 0 and 1."""

    start: float
    level: float
    slope: float

    def at(self, time: float) -> float:
        return min(1.0, max(0.0, self.level + self.slope * (time - self.start)))


def valve_level(
    level: float, open_stretches: Sequence[tuple[float, float]], rise_time: float, fall_time: float
) -> list[LevelLine]:
    """Level of a valve from time 0 on, as consecutive lines.

    It rises at 1 / rise_time while the valve is open and falls at 1 / fall_time while it is closed; 0 s is a
    jump.

    Args:
        level: At time 0, 0 to 1.
        open_stretches: Disjoint, ordered, none before 0, [opens, closes), s.
        rise_time: s.
        fall_time: s.
    """
    orders = []  # (when, level to go to, time for the whole way)
    if not open_stretches or open_stretches[0][0] > 0.0:
        orders.append((0.0, 0.0, fall_time))
    for opens, closes in open_stretches:
        orders += [(opens, 1.0, rise_time), (closes, 0.0, fall_time)]
    lines = [LevelLine(0.0, level, 0.0)]
    for start, target, whole_way in orders:
        level = line_at(lines, start).at(start)
        lines = [line for line in lines if line.start < start]
        arrival = start + abs(target - level) * whole_way
        if arrival > start:
            lines.append(LevelLine(start, level, math.copysign(1.0 / whole_way, target - level)))
        lines.append(LevelLine(arrival, target, 0.0))
    return lines


def line_at(lines: Sequence[LevelLine], time: float) -> LevelLine:
    """The line that holds at a time: the last one that has begun."""
    return [line for line in lines if line.start <= time][-1]


class Firing:
    """The thrusters of one craft, from period to period; every valve begins closed, with nothing commanded.

    Raises:
        ValueError: A fault of a thruster that does not exist.
    """

    def __init__(self, spacecraft: Spacecraft, faults: Sequence[Fault] = (), *, craft: int = 1) -> None:
        self.thrusters = Thrusters(spacecraft)
        self.spacecraft = spacecraft
        self.faults = [fault for fault in faults if fault.craft == craft]
        self.valves = [Valve() for _ in spacecraft.thrusters]
        self.periods_flown = 0
        n = spacecraft.number_of_thrusters
        for fault in self.faults:
            if fault.thruster > n:
                raise ValueError(f"fault of thruster {fault.thruster}; a number from 1 to {n} would be right")

    def next_period(self, duties: Array, scatter: Array) -> list[Piece]:
        """The pieces of the next period, given its duties (n,) and relative thrust errors (n,)."""
        period = self.spacecraft.control_period
        period_start = self.periods_flown * period
        self.periods_flown += 1

        all_lines = []
        for index, (thruster, valve) in enumerate(zip(self.spacecraft.thrusters, self.valves, strict=True)):
            opening_delay = thruster.opening_delay + self.summed("late_opening", index, period_start)
            on_time = min(1.0, float(duties[index]) + self.summed("bias", index, period_start)) * period
            valve.command(on_time, period, thruster.minimum_pulse, opening_delay, thruster.closing_delay)
            lines = valve_level(valve.level, valve.open_stretches(), thruster.rise_time, thruster.fall_time)
            # A jump at the very end of the period belongs to the next one.
            level_at_end = [line for line in lines if line.start < period][-1].at(period)
            valve.end_period(period, level_at_end)
            all_lines.append(lines)

        cuts = {0.0, period}
        cuts.update(line.start for lines in all_lines for line in lines)
        for fault in self.faults:
            cuts.update(
                edge - period_start for edge in fault_edges(fault, period_start, period_start + period)
            )
        ordered = sorted(cut for cut in cuts if 0.0 <= cut <= period)
        pieces = []
        for start, end in pairwise(ordered):
            if end - start < SHORTEST_PIECE:
                continue
            middle = 0.5 * (start + end)
            piece = Piece(
                thrusters=self.thrusters,
                start=start,
                end=end,
                lines=tuple(line_at(lines, middle) for lines in all_lines),
                faults=tuple(
                    ActiveFault(fault, period_start, middle)
                    for fault in self.faults
                    if is_active(fault, period_start + middle)
                ),
                scatter=scatter,
            )
            pieces += piece.cut_where_the_feed_gives_out()
        return pieces

    def summed(self, kind: str, index: int, time: float) -> float:
        """Severities of the faults of a kind that act on a command given at a time (s of the flight)."""
        return sum(
            ActiveFault(fault, 0.0, time).severity(time)
            for fault in self.faults
            if fault.kind == kind and fault.thruster == index + 1 and is_active(fault, time)
        )


class Thrusters:
    """The thrusters of a spacecraft as arrays, (n,) and (n, 3), in SI units."""

    def __init__(self, spacecraft: Spacecraft) -> None:
        self.number = spacecraft.number_of_thrusters
        self.nominal_thrust = np.array([thruster.thrust for thruster in spacecraft.thrusters])
        self.position = np.array([thruster.position for thruster in spacecraft.thrusters])
        self.direction = np.array([thruster.direction for thruster in spacecraft.thrusters])
        self.specific_impulse = np.array([thruster.specific_impulse for thruster in spacecraft.thrusters])
        self.coupling = spacecraft.feed.coupling


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A stretch of a period in which every thrust is a smooth function of time.

    Attributes:
        thrusters: What fires.
        start: s from the period's start.
        end: s from the period's start.
        lines: Level of each of the n valves.
        faults: Those active all through the piece, in the order of the slots.
        scatter: (n,) relative thrust errors.
    """

    thrusters: Thrusters
    start: float
    end: float
    lines: tuple[LevelLine, ...]
    faults: tuple[ActiveFault, ...]
    scatter: Array

    def levels(self, time: float) -> Array:
        """Level of every valve, (n,), 0 to 1, at a time in s from the period's start."""
        if not self.has_moving_levels:
            return self.level_lines[1].copy()
        start, level, slope = self.level_lines
        return np.clip(level + slope * (time - start), 0.0, 1.0)

    def openings(self, time: float) -> Array:
        """Opening of every valve after faults, (n,), 0 to 1, at a time in s from the period's start."""
        openings = self.levels(time)
        for fault in self.of_kind("stuck_on"):
            openings[fault.index] = fault.severity(time)
        for fault in self.of_kind("leak"):
            openings[fault.index] += fault.severity(time) * (1.0 - openings[fault.index])
        for fault in self.of_kind("stuck_off", "intermittent"):
            openings[fault.index] *= 1.0 - fault.severity(time)
        return openings

    def gains(self, time: float) -> Array:
        """Share of its thrust that each thruster makes of its flow, (n,)."""
        gains = np.ones(self.thrusters.number)
        for fault in self.of_kind("loss"):
            gains[fault.index] *= 1.0 - fault.severity(time)
        for fault in self.of_kind("sign"):
            gains[fault.index] *= 1.0 - 2.0 * fault.severity(time)
        return gains

    def directions(self, time: float) -> Array:
        """Unit vector of each thruster's force, (n, 3), body axes."""
        directions = self.thrusters.direction.copy()
        for fault in self.of_kind("misalignment"):
            directions[fault.index] = tilted(directions[fault.index], fault.severity(time), fault.azimuth)
        return directions

    def feed_margins(self, openings: Array) -> Array:
        """What the other openings leave of each thruster's thrust, (n,); below 0 it is none at all."""
        return 1.0 - self.thrusters.coupling * (openings.sum() - openings)

    def flow_thrust(self, time: float) -> Array:
        """Thrust that each thruster's flow is worth, (n,) N: before what a loss of gain takes from it."""
        openings = self.openings(time)
        share = openings * np.maximum(0.0, self.feed_margins(openings))
        return self.thrusters.nominal_thrust * (1.0 + self.scatter) * share

    def thrust(self, time: float) -> Array:
        """Delivered thrust of each thruster, (n,) N."""
        return self.gains(time) * self.flow_thrust(time)

    def mass_flow(self, time: float) -> float:
        """Propellant flow of all thrusters, kg/s."""
        return float(np.sum(self.flow_thrust(time) / (self.thrusters.specific_impulse * STANDARD_GRAVITY)))

    def loads(self, time: float) -> Loads:
        """Force, torque and propellant flow."""
        forces = self.thrust(time) * self.directions(time).T  # (3, n)
        torques = cross(self.thrusters.position.T, forces)
        return forces.sum(axis=1), torques.sum(axis=1), self.mass_flow(time)

    @cached_property
    def level_lines(self) -> Array:
        """Start, level and slope of the lines, (3, n)."""
        return np.array([(line.start, line.level, line.slope) for line in self.lines]).T

    @cached_property
    def has_moving_levels(self) -> bool:
        """Whether some valve rises or falls."""
        return any(line.slope != 0.0 for line in self.lines)

    @cached_property
    def is_steady(self) -> bool:
        """Whether the loads are the same all through the piece."""
        return not self.has_moving_levels and all(fault.is_steady for fault in self.faults)

    def integral(self, function: Callable[[float], ArrayLike]) -> Array:
        """Integral of a function of time over the piece, by Gauss and Legendre's rule with 24 nodes."""
        half, middle = 0.5 * (self.end - self.start), 0.5 * (self.end + self.start)
        if self.is_steady:
            return 2.0 * half * np.asarray(function(middle), dtype=float)
        values = np.array([function(middle + half * node) for node in NODES])
        return half * np.tensordot(WEIGHTS, values, axes=1)

    def cut_where_the_feed_gives_out(self) -> list[Piece]:
        """The same piece, cut where a feed margin passes through 0: the thrust has a corner there."""
        if self.is_steady or self.thrusters.coupling * (self.thrusters.number - 1) <= 1.0:
            return [self]

        def margin(time: float, index: int) -> float:
            return float(self.feed_margins(self.openings(time))[index])

        cuts = {self.start, self.end}
        times = np.linspace(self.start, self.end, 65)
        for index in range(self.thrusters.number):
            margins = np.array([margin(time, index) for time in times])
            cuts.update(times[margins == 0.0])
            for step in np.flatnonzero(margins[:-1] * margins[1:] < 0.0):
                cuts.add(brentq(margin, times[step], times[step + 1], args=(index,), xtol=1e-15))
        ordered = sorted(cuts)
        return [replace(self, start=start, end=end) for start, end in pairwise(ordered)]

    def of_kind(self, *kinds: str) -> list[ActiveFault]:
        """The active faults of some kinds, in the order of the slots."""
        return [fault for fault in self.faults if fault.kind in kinds]


class Coast:
    """A period in which nothing flows."""

    is_steady = True
    start = 0.0

    def __init__(self, spacecraft: Spacecraft) -> None:
        self.end = spacecraft.control_period
        self.number = spacecraft.number_of_thrusters

    def thrust(self, time: float) -> Array:
        return np.zeros(self.number)

    def mass_flow(self, time: float) -> float:
        return 0.0

    def loads(self, time: float) -> Loads:
        return np.zeros(3), np.zeros(3), 0.0

    def integral(self, function: Callable[[float], ArrayLike]) -> Array:
        return (self.end - self.start) * np.asarray(function(self.start), dtype=float)


class ActiveFault:
    """A fault on a stretch of time in which it is active and its severity obeys one law.

    Args:
        fault: The record.
        period_start: s of the flight; the origin of the times that `severity` takes.
        within: A time inside the stretch, s from `period_start`.
    """

    def __init__(self, fault: Fault, period_start: float, within: float) -> None:
        self.kind, self.index, self.azimuth = fault.kind, fault.thruster - 1, fault.azimuth
        self.fault = fault
        self.lead = period_start - fault.onset  # by how much the period began after the fault
        self.is_ramping = fault.profile == "ramp" and self.lead + within < fault.profile_time
        self.is_steady = fault.profile != "sine" and not self.is_ramping

    def severity(self, time: float) -> float:
        """Severity at a time of the stretch, s from the period's start."""
        full, since_onset = self.fault.severity, self.lead + time
        if self.is_steady:
            return full
        if self.is_ramping:
            return full * min(1.0, max(0.0, since_onset / self.fault.profile_time))
        return full * math.sin(math.pi * since_onset / self.fault.profile_time) ** 2  # (1 - cos 2a) / 2


def is_active(fault: Fault, time: float) -> bool:
    """Whether a fault acts at a time (s of the flight): within its duration and its dwell."""
    if not fault.onset <= time < fault.onset + fault.duration:
        return False
    if fault.profile != "intermittent":
        return True
    cycles = (time - fault.onset) / fault.profile_time
    return cycles - math.floor(cycles) < fault.dwell


def fault_edges(fault: Fault, start: float, end: float) -> Iterator[float]:
    """Moments in [start, end] (s of the flight) at which the severity changes its law.

    Of a sine also every quarter, so that no piece holds more of it than its integration resolves.
    """
    edges = [fault.onset, fault.onset + fault.duration]
    if fault.profile == "ramp":
        edges.append(fault.onset + fault.profile_time)
    phases = {"sine": (0.0, 0.25, 0.5, 0.75), "intermittent": (0.0, fault.dwell)}.get(fault.profile, ())
    if phases and fault.onset <= end:
        first = max(0, math.floor((start - fault.onset) / fault.profile_time))
        last = math.floor((end - fault.onset) / fault.profile_time)
        edges += [
            fault.onset + (cycle + phase) * fault.profile_time
            for cycle in range(first, last + 1)
            for phase in phases
        ]
    return (edge for edge in edges if start <= edge <= end)


def tilted(direction: Array, tilt: float, azimuth: float) -> Array:
    """A unit vector (3,) tilted by an angle (rad) towards an azimuth (rad).

    The azimuth counts from `direction x a`, `a` being the body axis least aligned with the direction (the
    first one on ties), towards `direction x (direction x a)`.
    """
    least_aligned = np.zeros(3)
    least_aligned[np.argmin(np.abs(direction))] = 1.0
    first = cross(direction, least_aligned)
    first /= np.linalg.norm(first)
    second = cross(direction, first)
    towards = math.cos(azimuth) * first + math.sin(azimuth) * second
    return math.cos(tilt) * direction + math.sin(tilt) * towards
