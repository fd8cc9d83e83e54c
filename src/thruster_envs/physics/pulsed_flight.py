"""One control period of a batch of craft on pulsed plasma thrusters: they fire, the craft turn, sensors look.

Models attitude alone, against the local-vertical frame as it stands when the episode begins, held fixed in
inertial space. A firing takes tens of microseconds, so it is an impulse at the start of the period: nominal
thrust times the firing time of the discharge times what faults and scatter make of it. Then the craft moves
freely, under the gravity gradient (the vertical turns with the mean motion) and a constant torque in body
axes: RK4 for the rate, a fourth-order Magnus step for the attitude.

Thrusters that share a capacitor never fire together. Where several are asked to, the one with the highest
duty fires, the first of them at a tie; the others do not.

What faults mean for a pulse; they act as they stand at the moment of the firing:

- `stuck_off`, `intermittent`: share of the discharge that does not come about. `loss`, `sign`: share of the
  thrust, that is lost or turned round.
- `bias`: the duty that is added asks it to fire in every period, beside what is commanded: of several on a
  capacitor that are asked the one with the highest sum fires.
- `stuck_on`: it fires in every period, asked or not, with this share of a discharge. `leak`: when it is not
  asked to, it fires with this share. What goes that way is missing in the capacitor: its other thrusters fire
  with the rest.
- `misalignment`: the thrust is tilted. `late_opening`: the pulse comes so much later in the period, and not
  at all if the period is over by then.
- `propellant_loss`, `electrode_sediment`, `conductivity_loss`: the pulse itself changes, and its impulse with
  it, as :mod:`.plasma_pulse` has it.
- A fault that is `shared` strikes all thrusters on the capacitor, but for a misalignment.

Leaves out translation (position, velocity and the translation of measured and expected rate changes stay
zero; the impulse is recorded), the time a capacitor takes to charge, and any other torque.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from thruster_envs.kernels import kernel
from thruster_envs.physics import health
from thruster_envs.physics import layout as at
from thruster_envs.physics.attitude import (
    angular_acceleration,
    exponential,
    gravity_gradient,
    normalised,
    quaternion_product,
    rate_step,
    rotate,
    turn,
)
from thruster_envs.physics.flight import (
    MOST_SUBSTEPS,
    draw_words,
    fastest_rate,
    freeze_lost,
    substep_rate,
)
from thruster_envs.physics.plasma_pulse import pulse_ratio
from thruster_envs.physics.sensing import SIGHT_ROWS, expected_change, look
from thruster_envs.random import uniform_pair

# Entries of the constants of a pulsed craft: s; 3 n^2, 1/s^2; N m along body axes; integration sub-steps of a
# period; N m along the torque of a thruster whose fault takes thrust away, and of one whose fault adds some.
FIRING_TIME, GRADIENT, BIAS, SUBSTEPS, BIAS_OF_LOSS, BIAS_OF_GAIN, PULSED = 0, 1, 2, 5, 6, 7, 8


class Vehicle(NamedTuple):
    """What the kernels read of a vehicle.

    Attributes:
        thrusters: (THRUSTER_ROWS, n) and
        constants: (CONSTANTS,), as :mod:`.layout` has them.
        capacitors: (n,), number of the capacitor of each thruster.
        logarithms: Of the :class:`~.plasma_pulse.PulseMap` of its discharge, and
        resistance: of the same.
        pulsed: (PULSED,).
        inertia: kg m^2, (xx, yy, zz) or (xx, yy, zz, xy, xz, yz).
        inverse: Of the inertia, in the same form.
    """

    thrusters: NDArray[np.float64]
    constants: NDArray[np.float64]
    capacitors: NDArray[np.int64]
    logarithms: NDArray[np.float64]
    resistance: float
    pulsed: NDArray[np.float64]
    inertia: tuple[float, ...]
    inverse: tuple[float, ...]


# Rows of a block's moving state, as in ``data``.
_Q, _W, _M, _STATE = 6, 10, 13, 14
# Per-thruster groups of rows of the firings: whether it fires on command, thrust of a whole discharge by its
# scatter, the share of a discharge that comes about, thrust, both as shares of nominal, delay in s, commanded
# firing time in s.
_FIRES, _STRENGTH, _SHARE, _THRUST, _DELAY, _NOMINAL, _FIRING_GROUPS = range(7)
# Rows of the clock: start of the period in s of the episode; cosine and sine of the angle by which the
# vertical has turned by then; start, end and length of the piece to fly, s of the period; torque, N m, and
# impulse at its start, N m s, body axes.
# Then in how many sub-steps a craft flies the piece.
_START, _COSINE, _SINE, _BEFORE, _UNTIL, _LENGTH, _TORQUE, _KICK, _COUNT, _CLOCK = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    9,
    12,
    13,
)
#: Rows of what faults make of thrusters: share of a discharge that comes about without a command and what a
#: command adds to it, thrust of a discharge as a share of nominal, delay in s, duty added to that commanded.
FLOOR, SLOPE, GAIN, DELAY, ADDED, HEALTH_GROUPS = range(6)


@kernel(nogil=True)
def fly_blocks(data, faults, streams, vehicle, fly, first, last):
    """Advance the blocks ``first`` to ``last`` (exclusive) by one control period, 32 craft at a time.

    A duty above 0 in the rows ``Layout.duties`` of ``data`` asks a thruster to fire once. ``vehicle`` is a
    :class:`Vehicle`. ``fly`` False fires the thrusters without turning the craft or reading its sensors.
    Nothing outside the given blocks is read or written.
    """
    n = vehicle.thrusters.shape[1]
    words = np.zeros((4 * ((n + 1) // 8 + 3), 32), np.uint64)
    firings = np.zeros((_FIRING_GROUPS * n, 32))
    columns = np.zeros((6 * n, 32))
    state = np.zeros((_STATE, 32))
    clock = np.zeros((_CLOCK, 32))
    sight = np.zeros((SIGHT_ROWS, 32))
    for b in range(first, last):
        _fly_block(
            b, data, faults, streams, vehicle, fly, words, firings, columns, state, clock, sight,
        )  # fmt: skip


@kernel(nogil=True)
def fly_singly(data, faults, streams, vehicle, fly, first, last):
    """The same as :func:`fly_blocks` for blocks of one craft."""
    n = vehicle.thrusters.shape[1]
    words = np.zeros((4 * ((n + 1) // 8 + 3), 1), np.uint64)
    firings = np.zeros((_FIRING_GROUPS * n, 1))
    columns = np.zeros((6 * n, 1))
    state = np.zeros((_STATE, 1))
    clock = np.zeros((_CLOCK, 1))
    sight = np.zeros((SIGHT_ROWS, 1))
    for b in range(first, last):
        _fly_block(
            b, data, faults, streams, vehicle, fly, words, firings, columns, state, clock, sight,
        )  # fmt: skip


@njit(forceinline=True)
def _fly_block(
    b, data, faults, streams, vehicle, fly, words, firings, columns, state, clock, sight
):  # fmt: skip
    thrusters, constants, pulsed = vehicle.thrusters, vehicle.constants, vehicle.pulsed
    capacitors, inertia, inverse = vehicle.capacitors, vehicle.inertia, vehicle.inverse
    n, lanes, period = thrusters.shape[1], state.shape[1], constants[at.PERIOD]
    for k in range(_STATE):
        for w in range(lanes):
            state[k, w] = data[b, k, w]
    for k in range(6 * n):
        for w in range(lanes):
            columns[k, w] = data[b, at.SCALARS + 5 * n + k, w]
    for w in range(lanes):
        clock[_START, w], clock[_BEFORE, w], clock[_LENGTH, w] = data[b, at.STEP, w] * period, 0.0, period
        clock[_TORQUE, w], clock[_TORQUE + 1, w] = pulsed[BIAS], pulsed[BIAS + 1]
        clock[_TORQUE + 2, w] = pulsed[BIAS + 2]
    draw_words(b, data, streams, words, n)
    _ask(b, data, thrusters, constants, capacitors, pulsed, words, firings, state)
    late = False
    for w in range(lanes):
        used = False
        for k in range(faults.shape[2]):
            used |= health.is_there(faults[b, w, k])
        if used:
            late |= _strike(b, w, data, faults, vehicle, period, firings, columns, clock)
    _fire(b, data, thrusters, pulsed, firings, columns, state)
    if fly:
        _find_vertical(constants, clock)
        if late:
            _fly_in_pieces(b, data, constants, pulsed, inertia, inverse, firings, columns, state, clock)
        else:
            for k in range(3):
                for w in range(lanes):
                    clock[_KICK + k, w] = data[b, at.IMPULSE + 3 + k, w]
            _move(b, data, constants, pulsed, inertia, inverse, state, clock)
        freeze_lost(b, data, state)
        for w in range(lanes):
            q = normalised((state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w]))
            state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w] = q[0], q[1], q[2], q[3]
        for k in range(_Q, _STATE):
            for w in range(lanes):
                data[b, k, w] = state[k, w]
        expected_change(b, data, constants, thrusters, firings, _NOMINAL * n, sight)
        look(b, data, constants, inertia, inverse, words, state, sight)
        for k in range(3):
            for w in range(lanes):
                data[b, at.EXPECTED_CHANGE + k, w], data[b, at.MEASURED_CHANGE + k, w] = 0.0, 0.0


@njit(forceinline=True)
def _ask(b, data, thrusters, constants, capacitors, pulsed, words, firings, state):
    """Which thrusters fire on command, and with which share of the nominal thrust if all is well."""
    n, lanes = thrusters.shape[1], state.shape[1]
    for i in range(n):
        fires = _FIRES * n + i
        for w in range(lanes):
            firings[fires, w] = 1.0 if data[b, at.SCALARS + i, w] > 0.0 else 0.0
        for j in range(n):
            if j != i and capacitors[j] == capacitors[i]:
                for w in range(lanes):
                    own, other = data[b, at.SCALARS + i, w], data[b, at.SCALARS + j, w]
                    yields = (other > own) | ((other == own) & (j < i))
                    firings[fires, w] = 0.0 if yields else firings[fires, w]
    for i in range(n):
        scatter = thrusters[at.SCATTER, i]
        for w in range(lanes):
            first, second = uniform_pair(words[6 + i // 2, w])
            strength = 1.0 + scatter * (2.0 * (first if i % 2 == 0 else second) - 1.0)
            strength = strength if state[_M, w] > constants[at.DRY_MASS] else 0.0
            fires = firings[_FIRES * n + i, w]
            firings[_STRENGTH * n + i, w] = strength
            firings[_SHARE * n + i, w] = fires
            firings[_THRUST * n + i, w] = fires * strength
            firings[_DELAY * n + i, w] = 0.0
            firings[_NOMINAL * n + i, w] = fires * pulsed[FIRING_TIME]


@njit
def _strike(b, w, data, faults, vehicle, period, firings, columns, clock):
    """Put the faults of a craft into its firings, columns and torque; True if one makes a pulse late."""
    capacitors, start = vehicle.capacitors, clock[_START, w]
    n = capacitors.shape[0]
    made = np.empty((HEALTH_GROUPS, n))
    pulse_health(faults[b, w], start, vehicle, made)
    late = False
    for i in range(n):
        left = 1.0  # in the capacitor
        asked = data[b, at.SCALARS + i, w] + made[ADDED, i]
        fires = 1.0 if asked > 0.0 else 0.0
        for j in range(n):
            if j != i and capacitors[j] == capacitors[i]:
                left *= 1.0 - made[FLOOR, j]
                other = data[b, at.SCALARS + j, w] + made[ADDED, j]
                if other > asked or (other == asked and j < i):
                    fires = 0.0
        share = left * (made[FLOOR, i] + made[SLOPE, i] * fires)
        share = share if made[DELAY, i] < period else 0.0
        firings[_SHARE * n + i, w] = share
        firings[_THRUST * n + i, w] = share * firings[_STRENGTH * n + i, w] * made[GAIN, i]
        firings[_DELAY * n + i, w] = made[DELAY, i] if share > 0.0 else 0.0
        late |= made[DELAY, i] > 0.0 and share > 0.0
    for k in range(faults.shape[2]):
        if health.is_active(faults[b, w, k], start):
            health.tilt_columns(faults[b, w, k], start, columns, w)
            _bias(faults[b, w, k], vehicle.pulsed, w, columns, clock)
    return late


@njit
def _bias(fault, pulsed, w, columns, clock):
    """Add the torque that comes with a fault of the discharge, along the torque of the thruster."""
    change, row = health.changes_discharge(fault), 6 * health.thruster_of(fault) + 3
    size = 0.0 if change == 0 else (pulsed[BIAS_OF_GAIN] if change > 0 else pulsed[BIAS_OF_LOSS])
    arm = math.sqrt(columns[row, w] ** 2 + columns[row + 1, w] ** 2 + columns[row + 2, w] ** 2)
    if size != 0.0 and arm > 0.0:
        for c in range(3):
            clock[_TORQUE + c, w] += size * columns[row + c, w] / arm


@njit(forceinline=True)
def _fire(b, data, thrusters, pulsed, firings, columns, state):
    """What the firings give: delivered times, impulse, open time, mass used."""
    n, lanes, time = thrusters.shape[1], state.shape[1], pulsed[FIRING_TIME]
    for k in range(6):
        for w in range(lanes):
            data[b, at.IMPULSE + k, w] = 0.0
    for i in range(n):
        flow = time * thrusters[at.THRUST, i] * thrusters[at.FLOW_PER_THRUST, i]
        for w in range(lanes):
            share = firings[_SHARE * n + i, w]
            data[b, at.SCALARS + n + i, w] = time * firings[_THRUST * n + i, w]
            data[b, at.OPEN_TIME, w] += time * share
            state[_M, w] -= flow * share * firings[_STRENGTH * n + i, w]
        for k in range(6):
            for w in range(lanes):
                data[b, at.IMPULSE + k, w] += data[b, at.SCALARS + n + i, w] * columns[6 * i + k, w]
    for w in range(lanes):
        data[b, at.STEP, w] += 1.0


@njit(forceinline=True)
def _find_vertical(constants, clock):
    """Where the vertical stands at the start of the period."""
    for w in range(clock.shape[1]):
        angle = constants[at.MEAN_MOTION] * clock[_START, w]
        clock[_COSINE, w], clock[_SINE, w] = math.cos(angle), math.sin(angle)


@njit(forceinline=True)
def _fly_in_pieces(b, data, constants, pulsed, inertia, inverse, firings, columns, state, clock):
    """Fly the period from late pulse to late pulse.

    A craft with fewer of them than a neighbour waits: its last pieces have no length and change nothing.
    """
    lanes, period, n = state.shape[1], constants[at.PERIOD], columns.shape[0] // 6
    flying = True
    while flying:
        for w in range(lanes):
            _next_pulse(w, period, pulsed[FIRING_TIME], firings, columns, clock, n)
        _move(b, data, constants, pulsed, inertia, inverse, state, clock)
        flying = False
        for w in range(lanes):
            clock[_BEFORE, w] = clock[_UNTIL, w]
            flying |= clock[_BEFORE, w] < period


@njit
def _next_pulse(w, period, time, firings, columns, clock, n):
    """Impulse of the pulses that are due, and how long it is to the next one."""
    before = clock[_BEFORE, w]
    until = period
    clock[_KICK, w], clock[_KICK + 1, w], clock[_KICK + 2, w] = 0.0, 0.0, 0.0
    if before < period:
        for i in range(n):
            delay = firings[_DELAY * n + i, w]
            if delay == before:
                for c in range(3):
                    clock[_KICK + c, w] += time * firings[_THRUST * n + i, w] * columns[6 * i + 3 + c, w]
            elif delay > before:
                until = min(until, delay)
    clock[_UNTIL, w], clock[_LENGTH, w] = until, until - before


@njit(forceinline=True)
def _move(b, data, constants, pulsed, inertia, inverse, state, clock):
    """Give every craft the impulse that is due and let it move for the length of the piece."""
    lanes, mean_motion, fewest = state.shape[1], constants[at.MEAN_MOTION], pulsed[SUBSTEPS]
    most = 0
    for w in range(lanes):
        kick = angular_acceleration(
            (0.0, 0.0, 0.0), (clock[_KICK, w], clock[_KICK + 1, w], clock[_KICK + 2, w]), inertia, inverse
        )
        state[_W, w], state[_W + 1, w] = state[_W, w] + kick[0], state[_W + 1, w] + kick[1]
        state[_W + 2, w] = state[_W + 2, w] + kick[2]
        clock[_COUNT, w] = fewest
        if data[b, at.LOST, w] == 0.0:
            rate = fastest_rate((state[_W, w], state[_W + 1, w], state[_W + 2, w]), constants[at.GYROSCOPY])
            spin_up = constants[at.SPIN_UP]
            wanted = clock[_LENGTH, w] * substep_rate(rate + spin_up * clock[_LENGTH, w], spin_up, constants)
            if wanted > fewest:
                clock[_COUNT, w] = math.ceil(min(wanted, MOST_SUBSTEPS))
            if not wanted <= MOST_SUBSTEPS:
                clock[_COUNT, w], data[b, at.LOST, w] = fewest, 1.0
        most = int(clock[_COUNT, w]) if clock[_COUNT, w] > most else most
    for step in range(most):
        for w in range(lanes):
            h = clock[_LENGTH, w] / clock[_COUNT, w] if step < clock[_COUNT, w] else 0.0
            offset = clock[_BEFORE, w] + step * h
            vertical = (clock[_COSINE, w], clock[_SINE, w])
            q, rate = _turned(
                (state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w]),
                (state[_W, w], state[_W + 1, w], state[_W + 2, w]),
                h,
                (_ahead(vertical, mean_motion * offset), _ahead(vertical, mean_motion * (offset + 0.5 * h)),
                 _ahead(vertical, mean_motion * (offset + h))),
                (clock[_TORQUE, w], clock[_TORQUE + 1, w], clock[_TORQUE + 2, w]),
                pulsed[GRADIENT], inertia, inverse,
            )  # fmt: skip
            state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w] = q[0], q[1], q[2], q[3]
            state[_W, w], state[_W + 1, w], state[_W + 2, w] = rate[0], rate[1], rate[2]


@njit(forceinline=True)
def _turned(q, rate, h, verticals, torque, strength, inertia, inverse):
    """Attitude and rate after ``h`` seconds of free motion.

    ``verticals`` is where the vertical stands at the start, middle and end, in the reference frame. The
    gravity gradient there is that of an attitude to second order.
    """
    torque_0 = _torque(q, verticals[0], torque, strength, inertia)
    a = angular_acceleration(rate, torque_0, inertia, inverse)
    q_m = _roughly_turned(q, rate, a, 0.5 * h)
    q_1 = _roughly_turned(q, rate, a, h)
    _, middle, end = rate_step(
        rate,
        torque_0,
        _torque(q_m, verticals[1], torque, strength, inertia),
        _torque(q_1, verticals[2], torque, strength, inertia),
        inertia,
        inverse,
        h,
    )
    return turn(q, rate, middle, end, h), end


@njit(forceinline=True)
def _roughly_turned(q, rate, acceleration, h):
    """Attitude after ``h`` seconds at the rate that a constant acceleration gives halfway."""
    twist = exponential(
        -0.5 * h * (rate[0] + 0.5 * h * acceleration[0]),
        -0.5 * h * (rate[1] + 0.5 * h * acceleration[1]),
        -0.5 * h * (rate[2] + 0.5 * h * acceleration[2]),
    )
    return quaternion_product(twist, q)


@njit(forceinline=True)
def _torque(q, vertical, torque, strength, inertia):
    gradient = gravity_gradient(rotate(q, (vertical[0], vertical[1], 0.0)), strength, inertia)
    return (torque[0] + gradient[0], torque[1] + gradient[1], torque[2] + gradient[2])


@njit(forceinline=True)
def _ahead(vertical, angle):
    """The vertical a small angle further on: series, exact to rounding up to 0.02 rad."""
    z = angle * angle
    c, s = 1.0 - 0.5 * z * (1.0 - 1 / 12 * z), angle * (1.0 - 1 / 6 * z * (1.0 - 1 / 20 * z))
    return (c * vertical[0] - s * vertical[1], s * vertical[0] + c * vertical[1])


@njit
def pulse_health(faults, t, vehicle, made):
    """What the faults of a craft make of firings at ``t``, s of the episode.

    ``faults`` (slots, FAULT_WIDTH); ``made`` (HEALTH_GROUPS, n) is filled.
    """
    capacitors = vehicle.capacitors
    for i in range(made.shape[1]):
        floor, slope, gain = health.health_at(faults, i, t, t, capacitors)
        mass, width, resistance = health.pulse_shares(faults, i, capacitors, t)
        if mass != 1.0 or width != 1.0 or resistance != 0.0:
            gain *= pulse_ratio(mass, width, resistance, 1.0, vehicle.logarithms, vehicle.resistance)
        made[FLOOR, i], made[SLOPE, i], made[GAIN, i] = floor, slope, gain
        made[DELAY, i], _, made[ADDED, i] = health.command_errors(faults, i, t, capacitors)


@njit
def impulses_of(made, i):
    """What asking thruster ``i`` adds and what it gives unasked, over the nominal impulse of a pulse.

    ``made`` is that of :func:`pulse_health`; the others on its capacitor are not asked.
    """
    floor, slope, gain = made[FLOOR, i], made[SLOPE, i], made[GAIN, i]
    if made[ADDED, i] > 0.0:
        floor, slope = floor + slope, 0.0
    return gain * slope, gain * floor
