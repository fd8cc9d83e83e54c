"""What compiled kernels read of a vehicle and of a batch, by name.

A kernel is called with plain tuples of arrays, since NamedTuples take longer to enter one; its first line
opens them: :func:`open_batch` and :func:`open_vehicle`. What a vehicle does not have is None in them, so that
whatever deals with it is left out when the kernel is compiled.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.physics import firing
from thruster_envs.physics import rows as at
from thruster_envs.physics.actuators import gyros as gyro
from thruster_envs.physics.actuators import wheels as wheel
from thruster_envs.physics.borrowed import borrow
from thruster_envs.physics.firing import NO_TIME, STANDARD_GRAVITY, has_dynamics
from thruster_envs.physics.orbits import (
    REFERENCE_SIZES,
    Circular,
    Elliptic,
    Hill,
    LinearElliptic,
    Oblate,
    kind_of,
    open_orbit,
    pack_orbit,
    transition_matrix,
)
from thruster_envs.spacecraft import Modulator, Spacecraft

FloatArray = NDArray[np.float64]

#: Unless a longest sub-step is asked for, a craft turns in one sub-step by no more than this (rad) with its
#: rate, and by no more than this (rad) with a torque, though none is cut shorter than this (s). Errors then
#: stay a thousand times below Orion's sensor noise over half an orbit.
TURN_LIMIT, TWIST_LIMIT, SHORT_SUBSTEP = 0.02, 0.005, 0.5

#: Nor does any craft turn further than this in a sub-step (rad) with its rate or with a torque, however fast
#: it tumbles: its sub-steps are as short as that takes. So the error of a period is less than :data:`ERROR`
#: times what its impulse moves a craft that does not turn (position, velocity), times the rate, and in
#: attitude less than as many rad.
FAR_TURN, FAR_TWIST = 0.25, 0.09

#: The same behind a modulator, where a sub-step has a straight line for the thrust.
MODULATED_TURN = 0.03

#: Largest error of a period, see :data:`FAR_TURN`.
ERROR = 2e-5

#: Angle by which the orbit may turn in a sub-step, rad.
ORBIT_TURN = 0.05

#: Longest sub-step of craft behind a modulator unless another one is asked for, s.
MODULATED_SUBSTEP = 0.1


class Batch(NamedTuple):
    """The arrays of a batch.

    Attributes:
        data: (blocks, fields, lanes) float64, laid out as :mod:`thruster_envs.physics.rows` says.
        faults: (blocks, lanes, slots, FAULT_WIDTH) float64.
        streams: (blocks, STREAM_ROWS, lanes) uint64.
        storage_faults: (blocks, lanes, slots, columns) float64, those of wheels and gyros; None without any.
    """

    data: FloatArray
    faults: FloatArray
    streams: NDArray[np.uint64]
    storage_faults: FloatArray | None


class Thrusters(NamedTuple):
    """Constants of thrusters, (n,) each but for the last.

    Attributes:
        thrust: N.
        minimum_pulse: s.
        opening_delay: s.
        closing_delay: s.
        rise_rate: 1/s.
        fall_rate: 1/s.
        scatter: Share of the thrust.
        flow_per_thrust: kg/s per N.
        lag_rate: 1/s, one over the time constant behind a modulator.
        believed: (6, n), nominal rate change per second of firing, m/s^2 and rad/s^2.
    """

    thrust: FloatArray
    minimum_pulse: FloatArray
    opening_delay: FloatArray
    closing_delay: FloatArray
    rise_rate: FloatArray
    fall_rate: FloatArray
    scatter: FloatArray
    flow_per_thrust: FloatArray
    lag_rate: FloatArray
    believed: FloatArray


class Constants(NamedTuple):
    """Scalars of a vehicle.

    Sub-steps are none longer than `max_substep` (s); there are more of them while the craft would turn
    further in one than `turn_limit` by its rate or `twist_limit` by a torque (rad), but then none shorter
    than `short_substep` (s) unless it would turn further than `far_turn` or `far_twist` (rad).

    Attributes:
        period: s.
        max_substep: s.
        coupling: Share of its thrust that a thruster loses for each further one that is open.
        dry_mass: kg.
        uniform_errors: 1 where measurement errors are uniform, 0 where they are normal.
        sigma_position: m.
        sigma_velocity: m/s.
        sigma_attitude: rad.
        sigma_rate: rad/s.
        turn_limit: rad.
        twist_limit: rad.
        short_substep: s.
        wave_part: Longest part in which a sine is followed, s.
        spin_per_torque: One over the smallest principal moment of inertia, 1/(kg m^2).
        far_turn: rad.
        far_twist: rad.
        gyroscopy: How strongly rates turn each other: largest difference of two principal moments over the
            third.
        spin_up: The most that the actuators give together, rad/s^2.
        stored_spin: The part of wheels and gyros in that, rad/s^2.
        stored_rate: Least sub-steps per second for what stores momentum, 1/s.
        mass: Nominal, at the start, kg.
        velocity_drift: Lower half of the transition matrix over one period on a circular orbit, row by row;
            zeros on others, where it changes as time goes on.
    """

    period: float
    max_substep: float
    coupling: float
    dry_mass: float
    uniform_errors: float
    sigma_position: float
    sigma_velocity: float
    sigma_attitude: float
    sigma_rate: float
    turn_limit: float
    twist_limit: float
    short_substep: float
    wave_part: float
    spin_per_torque: float
    far_turn: float
    far_twist: float
    gyroscopy: float
    spin_up: float
    stored_spin: float
    stored_rate: float
    mass: float
    velocity_drift: tuple[float, ...]


class Body(NamedTuple):
    """What moves.

    Attributes:
        inertia: kg m^2, (xx, yy, zz) or (xx, yy, zz, xy, xz, yz).
        inverse: Of the inertia, in the same form.
        orbit: About which it moves, of one of the kinds of :mod:`.orbits`.
    """

    inertia: tuple[float, ...]
    inverse: tuple[float, ...]
    orbit: Hill | Circular | LinearElliptic | Elliptic | Oblate


class Valves(NamedTuple):
    """Valves that follow their commands by themselves.

    Attributes:
        network: (p, 2), a network that sorts the corners of a period.
        dynamic: True where a valve has delays or ramps; None without.
    """

    network: NDArray[np.int64]
    dynamic: bool | None


class Modulation(NamedTuple):
    """A modulator: delay and its variation, s; frequency of that, 1/s; jitter, s; sub-steps of a period."""

    delay: float
    variation: float
    frequency: float
    jitter: float
    substeps: float


class Pulses(NamedTuple):
    """Pulsed plasma thrusters.

    Attributes:
        capacitors: (n,), number of the capacitor of each thruster.
        logarithms: Of the :class:`~.plasma_pulse.PulseMap` of the discharge, and
        resistance: of the same.
        firing_time: s.
        gradient: Strength of the gravity gradient: 3 n^2, 1/s^2, on a circular orbit, on others 3, the factor
            of ``mu / r^3``; 0 where it does not act.
        bias: A torque, N m along body axes.
        substeps: Integration sub-steps of a period.
        bias_of_loss: N m along the torque of a thruster whose fault takes thrust away, and
        bias_of_gain: of one whose fault adds some.
    """

    capacitors: NDArray[np.int64]
    logarithms: FloatArray
    resistance: float
    firing_time: float
    gradient: float
    bias: tuple[float, float, float]
    substeps: float
    bias_of_loss: float
    bias_of_gain: float


class Storage(NamedTuple):
    """What stores momentum: the constants of reaction wheels and control-moment gyros.

    Attributes:
        wheels: (m, WHEEL_CONSTANTS), as :mod:`.actuators.wheels` has them.
        gyros: (g, GYRO_CONSTANTS), as :mod:`.actuators.gyros` has them.
    """

    wheels: FloatArray
    gyros: FloatArray


class Vehicle(NamedTuple):
    """What the kernels read of a vehicle; of valves, modulator and pulses it has exactly one."""

    thrusters: Thrusters
    constants: Constants
    rows: at.Rows
    body: Body
    valves: Valves | None
    modulator: Modulation | None
    pulses: Pulses | None
    storage: Storage | None


@njit(forceinline=True)
def open_batch(arrays):
    """The :class:`Batch` of the arrays with which a kernel is called."""
    return Batch(borrow(arrays[0]), borrow(arrays[1]), borrow(arrays[2]), _borrowed(arrays[3]))


@njit(forceinline=True)
def _borrowed(array):
    """An array, or None."""
    if array is None:
        return None
    return borrow(array)


@njit(forceinline=True)
def open_vehicle(parts):
    """The :class:`Vehicle` of the parts with which a kernel is called, as :func:`pack_vehicle` made them."""
    numbers, body = borrow(parts[1]), parts[3]
    constants = Constants(
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], numbers[7],
        numbers[8], numbers[9], numbers[10], numbers[11], numbers[12], numbers[13], numbers[14], numbers[15],
        numbers[16], numbers[17], numbers[18], numbers[19], numbers[20], _drift(numbers[21:]),
    )  # fmt: skip
    return Vehicle(
        open_thrusters(borrow(parts[0])),
        constants,
        _open_rows(borrow(parts[2])),
        Body(body[0], body[1], open_orbit(body[2], body[3])),
        _open_valves(parts[4]),
        _open_modulator(parts[5]),
        _open_pulses(parts[6]),
        _open_storage(parts[7]),
    )  # fmt: skip


@njit(forceinline=True)
def open_thrusters(rows):
    """The :class:`Thrusters` of (15, n) constants, as :func:`thruster_constants` gives them."""
    return Thrusters(
        rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8], rows[9:]
    )


@njit(forceinline=True)
def _drift(d):
    return (
        d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7], d[8], d[9], d[10], d[11], d[12], d[13], d[14], d[15],
        d[16], d[17],
    )  # fmt: skip


@njit(forceinline=True)
def _open_rows(rows):
    return at.Rows(
        rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8], rows[9],
        rows[10], rows[11], rows[12], rows[13], rows[14], rows[15], rows[16], rows[17], rows[18],
        rows[19], rows[20], rows[21], rows[22], rows[23], rows[24],
    )  # fmt: skip


@njit(forceinline=True)
def _open_valves(parts):
    if parts is None:
        return None
    return Valves(borrow(parts[0]), parts[1])


@njit(forceinline=True)
def _open_storage(parts):
    if parts is None:
        return None
    return Storage(borrow(parts[0]), borrow(parts[1]))


@njit(forceinline=True)
def _open_modulator(numbers):
    if numbers is None:
        return None
    return Modulation(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4])


@njit(forceinline=True)
def _open_pulses(parts):
    if parts is None:
        return None
    numbers = borrow(parts[2])
    return Pulses(
        borrow(parts[0]), borrow(parts[1]), numbers[0], numbers[1], numbers[2],
        (numbers[3], numbers[4], numbers[5]), numbers[6], numbers[7], numbers[8],
    )  # fmt: skip


def arrange_rows(spacecraft: Spacecraft) -> at.Rows:
    """The rows of a spacecraft's state."""
    carried = None if spacecraft.modulator is None else carried_pulses(spacecraft)
    return at.arrange(
        spacecraft.number_of_thrusters, carried, len(spacecraft.reaction_wheels),
        len(spacecraft.control_moment_gyros),
        REFERENCE_SIZES[type(kind_of(spacecraft.reference_orbit, nonlinear=False))],
        pulsed=spacecraft.discharge is not None,
        dynamic=spacecraft.modulator is None and has_dynamics(spacecraft),
    )  # fmt: skip


def pack_vehicle(
    spacecraft: Spacecraft,
    constants: Constants,
    *,
    nonlinear: bool,
    max_substep: float | None,
    pulses: tuple[Any, ...] | None = None,
) -> tuple[Any, ...]:
    """What a kernel takes of a vehicle, in the order in which :func:`open_vehicle` reads it.

    Args:
        spacecraft: The vehicle.
        constants: Its scalars.
        nonlinear: Full two-body relative motion instead of the linear equations.
        max_substep: Longest sub-step, s; None for the usual ones.
        pulses: As :func:`pack_pulses` gives it, where its thrusters fire as pulsed plasma thrusters.
    """
    inertia, orbit = np.array(spacecraft.inertia), kind_of(spacecraft.reference_orbit, nonlinear=nonlinear)
    modulated = spacecraft.modulator is not None
    thrusters = thruster_constants(spacecraft)
    return (
        thrusters,
        np.array([*constants[:-1], *constants.velocity_drift]),
        np.array(arrange_rows(spacecraft), np.int64),
        (_symmetric(inertia), _symmetric(np.linalg.inv(inertia)), *pack_orbit(orbit)),
        None if modulated or pulses is not None else _pack_valves(spacecraft),
        _pack_modulator(spacecraft.modulator, spacecraft.control_period, max_substep),
        pulses,
        _pack_storage(spacecraft),
    )  # fmt: skip


def _pack_valves(spacecraft: Spacecraft) -> tuple[NDArray[np.int64], bool | None]:
    dynamic = has_dynamics(spacecraft)
    corners = firing.CORNERS_WITH_DYNAMICS if dynamic else firing.CORNERS
    return _sorting_network(spacecraft.number_of_thrusters * corners), True if dynamic else None


def _pack_storage(spacecraft: Spacecraft) -> tuple[FloatArray, FloatArray] | None:
    if not spacecraft.stores_momentum:
        return None
    wheels = np.zeros((len(spacecraft.reaction_wheels), wheel.WHEEL_CONSTANTS))
    for row, one in zip(wheels, spacecraft.reaction_wheels, strict=True):
        row[:] = (
            *one.axis, one.inertia, one.max_torque, one.max_speed, one.coulomb_friction, one.viscous_friction,
        )  # fmt: skip
    gyros = np.zeros((len(spacecraft.control_moment_gyros), gyro.GYRO_CONSTANTS))
    for row, turned in zip(gyros, spacecraft.control_moment_gyros, strict=True):
        across = np.cross(turned.gimbal_axis, turned.spin_axis)
        row[:] = (*turned.gimbal_axis, *turned.spin_axis, *across, turned.momentum, turned.max_gimbal_rate)
    return wheels, gyros


def _pack_modulator(
    modulator: Modulator | None, period: float, max_substep: float | None
) -> FloatArray | None:
    if modulator is None:
        return None
    return np.array(
        Modulation(
            modulator.delay, modulator.variation, 1.0 / modulator.variation_period, modulator.jitter,
            math.ceil(period / (max_substep or MODULATED_SUBSTEP)),
        )
    )  # fmt: skip


def pack_pulses(pulses: Pulses) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """What a kernel takes of pulsed plasma thrusters."""
    numbers = (
        pulses.resistance, pulses.firing_time, pulses.gradient, *pulses.bias, pulses.substeps,
        pulses.bias_of_loss, pulses.bias_of_gain,
    )  # fmt: skip
    return pulses.capacitors, pulses.logarithms, np.array(numbers)


def carried_pulses(spacecraft: Spacecraft) -> int:
    """Pulses of earlier periods that may still be open when a period begins, behind a modulator."""
    modulator = spacecraft.modulator
    if modulator is None:
        raise ValueError(f"{spacecraft.name!r} has no modulator; a spacecraft with one would be right")
    longest = max(thruster.closing_delay for thruster in spacecraft.thrusters)
    latest = modulator.delay + modulator.variation + modulator.jitter + longest
    return math.ceil(latest / spacecraft.control_period)


def thruster_constants(spacecraft: Spacecraft) -> FloatArray:
    """(15, n): the constants of each thruster, in the order of :class:`Thrusters`."""
    rows = np.zeros((15, spacecraft.number_of_thrusters))
    for i, thruster in enumerate(spacecraft.thrusters):
        rows[:9, i] = (
            thruster.thrust, thruster.minimum_pulse, thruster.opening_delay, thruster.closing_delay,
            1.0 / max(thruster.rise_time, NO_TIME), 1.0 / max(thruster.fall_time, NO_TIME),
            thruster.scatter, 1.0 / (thruster.specific_impulse * STANDARD_GRAVITY),
            1.0 / max(thruster.time_constant, NO_TIME),
        )  # fmt: skip
    rows[9:] = spacecraft.effectiveness()
    return rows


def scalar_constants(spacecraft: Spacecraft, max_substep: float | None) -> Constants:
    """The scalars of a vehicle; with a longest sub-step of the user's own, no other limit of them."""
    period, own, sensors = spacecraft.control_period, max_substep is not None, spacecraft.sensors
    orbit = spacecraft.reference_orbit
    longest = max_substep or min(period, ORBIT_TURN / orbit.fastest_rate)
    far = MODULATED_TURN if spacecraft.modulator is not None else FAR_TURN
    drift = transition_matrix(orbit, period)[3:] if orbit.is_steady else np.zeros((3, 6))
    return Constants(
        period=period,
        max_substep=longest,
        coupling=spacecraft.feed.coupling,
        dry_mass=max(0.0, spacecraft.mass - spacecraft.feed.propellant_mass),
        uniform_errors=1.0 if sensors.distribution == "uniform" else 0.0,
        sigma_position=sensors.position,
        sigma_velocity=sensors.velocity,
        sigma_attitude=sensors.attitude,
        sigma_rate=sensors.rate,
        turn_limit=math.inf if own else TURN_LIMIT,
        twist_limit=math.inf if own else TWIST_LIMIT,
        short_substep=longest if own else SHORT_SUBSTEP,
        wave_part=longest if own else SHORT_SUBSTEP,
        spin_per_torque=1.0 / np.linalg.eigvalsh(np.array(spacecraft.inertia)).min(),
        far_turn=math.inf if own else far,
        far_twist=math.inf if own else FAR_TWIST,
        gyroscopy=_gyroscopy(spacecraft),
        spin_up=spin_up(spacecraft),
        stored_spin=_stored_spin(spacecraft),
        stored_rate=0.0 if own else _stored_rate(spacecraft),
        mass=spacecraft.mass,
        velocity_drift=tuple(drift.reshape(-1).tolist()),
    )


def spin_up(spacecraft: Spacecraft) -> float:
    """Largest angular acceleration that the actuators can give together, rad/s^2; none where they pulse."""
    if spacecraft.discharge is not None:
        return 0.0
    thrusters = math.hypot(*spacecraft.authority()[3:].tolist()) / spacecraft.control_period
    return thrusters + _stored_spin(spacecraft)


def _stored_spin(spacecraft: Spacecraft) -> float:
    """The same of wheels and gyros alone."""
    torque = sum(one.max_torque + one.coulomb_friction for one in spacecraft.reaction_wheels)
    torque += sum(one.momentum * one.max_gimbal_rate for one in spacecraft.control_moment_gyros)
    return torque / _smallest_moment(spacecraft)


#: Angle, rad, by which the axis of the body may move in a sub-step about that of the stored momentum, and
#: share of its time constant that viscous friction may act in one.
_STORED_TURN, _FRICTION_SHARE = 0.09, 0.3


def _stored_rate(spacecraft: Spacecraft) -> float:
    """Least sub-steps per second of a craft that stores momentum, by how fast that turns the body."""
    momentum = sum(one.momentum for one in spacecraft.control_moment_gyros)
    momentum += sum(
        one.inertia * max(one.max_speed, abs(one.initial_speed)) for one in spacecraft.reaction_wheels
    )
    friction = max((one.viscous_friction / one.inertia for one in spacecraft.reaction_wheels), default=0.0)
    free = _smallest_moment(spacecraft)
    gimbals = max((one.max_gimbal_rate for one in spacecraft.control_moment_gyros), default=0.0)
    return max(momentum / free / _STORED_TURN, gimbals / _STORED_TURN, 2.0 * friction / _FRICTION_SHARE)


def _smallest_moment(spacecraft: Spacecraft) -> float:
    """Smallest principal moment of inertia with all rotors free, kg m^2."""
    free = np.array(spacecraft.inertia)
    for one in spacecraft.reaction_wheels:
        free -= one.inertia * np.outer(one.axis, one.axis)
    return float(np.linalg.eigvalsh(free).min())


def _gyroscopy(spacecraft: Spacecraft) -> float:
    """Largest difference of two principal moments of inertia over the third."""
    a, b, c = np.linalg.eigvalsh(np.array(spacecraft.inertia))
    return float(max((c - b) / a, (c - a) / b, (b - a) / c))


def _symmetric(matrix: FloatArray) -> tuple[float, ...]:
    """The diagonal of a symmetric matrix, followed by (xy, xz, yz) unless these are zero."""
    upper = matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()
    return tuple(upper if any(upper[3:]) else upper[:3])


def tilted_wrenches(spacecraft: Spacecraft) -> FloatArray:
    """(2, n, 6): the wrench of each thruster if it pointed square to its direction, azimuth 0 and 90 deg."""
    wrenches = np.zeros((2, spacecraft.number_of_thrusters, 6))
    for i, thruster in enumerate(spacecraft.thrusters):
        direction = np.array(thruster.direction)
        axis = np.zeros(3)
        axis[int(np.argmin(np.abs(direction)))] = 1.0
        first = np.cross(direction, axis)
        first /= np.linalg.norm(first)
        for k, across in enumerate((first, np.cross(direction, first))):
            force = thruster.thrust * across
            wrenches[k, i] = np.concatenate((force, np.cross(thruster.position, force)))
    return wrenches


@cache
def _sorting_network(size: int) -> NDArray[np.int64]:
    """Batcher's odd-even merge sort of ``size`` rows: (p, 2), pairs i < j to be put in order in turn."""
    return np.array(list(_comparators(size)), dtype=np.int64).reshape(-1, 2)


def _comparators(size: int) -> Iterator[tuple[int, int]]:
    p = 1
    while p < size:
        k = p
        while k >= 1:
            for j in range(k % p, size - k, 2 * k):
                for i in range(min(k, size - j - k)):
                    if (i + j) // (2 * p) == (i + j + k) // (2 * p):
                        yield i + j, i + j + k
            k //= 2
        p *= 2
