"""One control period of a batch of craft on pulsed plasma thrusters: they fire, the craft turn, sensors look.

Models attitude alone, against the local-vertical frame as it stands when the episode begins, held fixed in
inertial space. A firing takes tens of microseconds, so it is an impulse at the start of the period: nominal
thrust times the firing time of the discharge times what faults and scatter make of it. Then the craft moves
freely, under the gravity gradient (the vertical turns with the mean motion) and a constant torque in body
axes: RK4 for the rate, a fourth-order Magnus step for the attitude. On an elliptic orbit the vertical turns
with the true anomaly and the gradient goes with the cube of the distance; with J2 the vertical is that of the
disturbed orbit, and the gradient that of a sphere.

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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.attitude import (
    angular_acceleration,
    exponential,
    gravity_gradient,
    quaternion_product,
    rate_step,
    rotate,
    rotate_back,
    turn,
)
from thruster_envs.physics.body import (
    REFERENCE,
    STORED,
    equal_substeps,
    freeze_lost,
    load_state,
    store_state,
)
from thruster_envs.physics.borrowed import borrow, keep
from thruster_envs.physics.orbits import (
    Circular,
    Elliptic,
    Hill,
    LinearElliptic,
    Oblate,
    chosen_by_kind,
    frame_motion,
    oblate_attitude,
    read_reference,
    reference_of,
    step_frames,
    write_reference,
)
from thruster_envs.physics.plasma_pulse import pulse_ratio
from thruster_envs.physics.sensing import SIGHT_ROWS, draw_words, expected_change, look, word_rows
from thruster_envs.physics.vehicle import open_batch, open_vehicle
from thruster_envs.random import uniform_pair

FloatArray = NDArray[np.float64]

_Q, _W = at.ATTITUDE, at.RATE
# Per-thruster groups of rows of the firings: whether it fires on command, thrust of a whole discharge by its
# scatter, the share of a discharge that comes about, thrust, both as shares of nominal, delay in s, commanded
# firing time in s.
_FIRES, _STRENGTH, _SHARE, _THRUST, _DELAY, _NOMINAL, _FIRING_GROUPS = range(7)
# Rows of the clock: start of the period in s of the episode; cosine and sine of the angle by which the
# vertical has turned by then; start, end and length of the piece to fly, s of the period; torque, N m, and
# impulse at its start, N m s, body axes.
# Then in how many sub-steps a craft flies the piece.
_START, _COSINE, _SINE, _BEFORE, _UNTIL, _LENGTH, _TORQUE, _KICK, _COUNT, _CLOCK = (
    0, 1, 2, 3, 4, 5, 6, 9, 12, 13,
)  # fmt: skip
#: Rows of what faults make of thrusters: share of a discharge that comes about without a command and what a
#: command adds to it, thrust of a discharge as a share of nominal, delay in s, duty added to that commanded.
FLOOR, SLOPE, GAIN, DELAY, ADDED, HEALTH_GROUPS = range(6)


class _Work(NamedTuple):
    """Scratch of one block, (rows, lanes) each."""

    words: NDArray[np.uint64]
    firings: FloatArray
    columns: FloatArray
    state: FloatArray
    clock: FloatArray
    sight: FloatArray


def compile_period(lanes: int) -> Any:
    """The kernel that flies craft on pulsed plasma thrusters, in blocks of ``lanes`` craft.

    As :mod:`thruster_envs.physics.period` has it. A duty above 0 asks a
    thruster to fire once.
    """

    @kernel(nogil=True)
    def fly_period(arrays, parts, move, first, last):
        batch, vehicle = open_batch(arrays), open_vehicle(parts)
        n = vehicle.rows.thrusters
        words, owned = np.zeros((word_rows(n), lanes), np.uint64), (
            np.zeros((_FIRING_GROUPS * n, lanes)),
            np.zeros((6 * n, lanes)),
            np.zeros((STORED, lanes)),
            np.zeros((_CLOCK, lanes)),
            np.zeros((SIGHT_ROWS, lanes)),
        )  # fmt: skip
        work = _Work(
            borrow(words), borrow(owned[0]), borrow(owned[1]), borrow(owned[2]), borrow(owned[3]),
            borrow(owned[4]),
        )  # fmt: skip
        for b in range(first, last):
            _fly_block(b, batch, vehicle, move, work)
        keep((words, owned))

    return fly_period


@njit(inline="always")
def _fly_block(b, batch, vehicle, move, work):
    data, faults, constants, bias = batch.data, batch.faults, vehicle.constants, vehicle.pulses.bias
    firings, columns, state, clock, sight = work.firings, work.columns, work.state, work.clock, work.sight
    n, lanes, period = vehicle.rows.thrusters, state.shape[1], constants.period
    load_state(b, data, columns, vehicle, state, lanes)
    for w in range(lanes):
        clock[_START, w], clock[_BEFORE, w], clock[_LENGTH, w] = data[b, at.STEP, w] * period, 0.0, period
        clock[_TORQUE, w], clock[_TORQUE + 1, w], clock[_TORQUE + 2, w] = bias[0], bias[1], bias[2]
    draw_words(b, batch, work.words, n, lanes)
    _ask(b, data, vehicle, work)
    late = False
    for w in range(lanes):
        used = False
        for k in range(faults.shape[2]):
            used |= health.is_there(faults[b, w, k])
        if used:
            late |= _strike(b, w, batch, vehicle, work)
    _fire(b, data, vehicle, work)
    if move:
        find_vertical(vehicle.body.orbit, clock)
        if late:
            _fly_in_pieces(b, data, vehicle, work)
        else:
            for k in range(3):
                for w in range(lanes):
                    clock[_KICK + k, w] = data[b, at.IMPULSE + 3 + k, w]
            _move(b, data, vehicle, state, clock)
        freeze_lost(b, data, state, sight[0], lanes)
        store_state(b, data, vehicle, state, _Q, lanes)
        expected_change(b, data, vehicle, constants.coupling, firings, _NOMINAL * n, sight, lanes)
        look(b, data, vehicle, work.words, state, sight, lanes)
        for k in range(3):
            for w in range(lanes):
                data[b, at.EXPECTED_CHANGE + k, w], data[b, at.MEASURED_CHANGE + k, w] = 0.0, 0.0


@njit(forceinline=True)
def _ask(b, data, vehicle, work):
    """Which thrusters fire on command, and with which share of the nominal thrust if all is well."""
    rows, capacitors, firings, state = vehicle.rows, vehicle.pulses.capacitors, work.firings, work.state
    n, lanes, words = rows.thrusters, state.shape[1], work.words
    for i in range(n):
        fires = _FIRES * n + i
        for w in range(lanes):
            firings[fires, w] = 1.0 if data[b, rows.duties + i, w] > 0.0 else 0.0
        for j in range(n):
            if j != i and capacitors[j] == capacitors[i]:
                for w in range(lanes):
                    own, other = data[b, rows.duties + i, w], data[b, rows.duties + j, w]
                    yields = (other > own) | ((other == own) & (j < i))
                    firings[fires, w] = 0.0 if yields else firings[fires, w]
    for i in range(n):
        scatter = vehicle.thrusters.scatter[i]
        for w in range(lanes):
            first, second = uniform_pair(words[6 + i // 2, w])
            strength = 1.0 + scatter * (2.0 * (first if i % 2 == 0 else second) - 1.0)
            strength = strength if state[at.MASS, w] > vehicle.constants.dry_mass else 0.0
            fires = firings[_FIRES * n + i, w]
            firings[_STRENGTH * n + i, w] = strength
            firings[_SHARE * n + i, w] = fires
            firings[_THRUST * n + i, w] = fires * strength
            firings[_DELAY * n + i, w] = 0.0
            firings[_NOMINAL * n + i, w] = fires * vehicle.pulses.firing_time


@njit
def _strike(b, w, batch, vehicle, work):
    """Put the faults of a craft into its firings, columns and torque; True if one makes a pulse late."""
    firings, columns, clock, period = work.firings, work.columns, work.clock, vehicle.constants.period
    data, faults, rows = batch.data, batch.faults, vehicle.rows
    capacitors, start = vehicle.pulses.capacitors, clock[_START, w]
    n = capacitors.shape[0]
    made = np.empty((HEALTH_GROUPS, n))
    pulse_health(faults[b, w], start, vehicle.pulses, made)
    late = False
    for i in range(n):
        left = 1.0  # in the capacitor
        asked = data[b, rows.duties + i, w] + made[ADDED, i]
        fires = 1.0 if asked > 0.0 else 0.0
        for j in range(n):
            if j != i and capacitors[j] == capacitors[i]:
                left *= 1.0 - made[FLOOR, j]
                other = data[b, rows.duties + j, w] + made[ADDED, j]
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
            _bias(faults[b, w, k], vehicle.pulses, w, columns, clock)
    return late


@njit
def _bias(fault, pulses, w, columns, clock):
    """Add the torque that comes with a fault of the discharge, along the torque of the thruster."""
    change, row = health.changes_discharge(fault), 6 * health.thruster_of(fault) + 3
    size = 0.0 if change == 0 else (pulses.bias_of_gain if change > 0 else pulses.bias_of_loss)
    arm = math.sqrt(columns[row, w] ** 2 + columns[row + 1, w] ** 2 + columns[row + 2, w] ** 2)
    if size != 0.0 and arm > 0.0:
        for c in range(3):
            clock[_TORQUE + c, w] += size * columns[row + c, w] / arm


@njit(forceinline=True)
def _fire(b, data, vehicle, work):
    """What the firings give: delivered times, impulse, open time, mass used."""
    thrusters, rows, time = vehicle.thrusters, vehicle.rows, vehicle.pulses.firing_time
    firings, columns, state = work.firings, work.columns, work.state
    n, lanes = rows.thrusters, state.shape[1]
    for k in range(6):
        for w in range(lanes):
            data[b, at.IMPULSE + k, w] = 0.0
    for i in range(n):
        flow = time * thrusters.thrust[i] * thrusters.flow_per_thrust[i]
        for w in range(lanes):
            share = firings[_SHARE * n + i, w]
            data[b, rows.delivered + i, w] = time * firings[_THRUST * n + i, w]
            data[b, at.OPEN_TIME, w] += time * share
            state[at.MASS, w] -= flow * share * firings[_STRENGTH * n + i, w]
        for k in range(6):
            for w in range(lanes):
                data[b, at.IMPULSE + k, w] += data[b, rows.delivered + i, w] * columns[6 * i + k, w]
    for w in range(lanes):
        data[b, at.STEP, w] += 1.0


def find_vertical(orbit, clock):
    """Where the vertical stands at the start of the period, on a circular orbit."""
    _FIND_VERTICAL[type(orbit)](orbit, clock)


def _find_steadily(orbit, clock):
    for w in range(clock.shape[1]):
        angle = orbit.mean_motion * clock[_START, w]
        clock[_COSINE, w], clock[_SINE, w] = math.cos(angle), math.sin(angle)


def _find_nothing(orbit, clock):
    return None


_FIND_VERTICAL = {
    Hill: _find_steadily, Circular: _find_steadily, LinearElliptic: _find_nothing, Elliptic: _find_nothing,
    Oblate: _find_nothing,
}  # fmt: skip
chosen_by_kind(find_vertical, _FIND_VERTICAL.__getitem__)


@njit(forceinline=True)
def _fly_in_pieces(b, data, vehicle, work):
    """Fly the period from late pulse to late pulse.

    A craft with fewer of them than a neighbour waits: its last pieces have no length and change nothing.
    """
    state, clock, period = work.state, work.clock, vehicle.constants.period
    lanes = state.shape[1]
    flying = True
    while flying:
        for w in range(lanes):
            _next_pulse(w, vehicle, work)
        _move(b, data, vehicle, state, clock)
        flying = False
        for w in range(lanes):
            clock[_BEFORE, w] = clock[_UNTIL, w]
            flying |= clock[_BEFORE, w] < period


@njit
def _next_pulse(w, vehicle, work):
    """Impulse of the pulses that are due, and how long it is to the next one."""
    firings, columns, clock, n = work.firings, work.columns, work.clock, vehicle.rows.thrusters
    period, time = vehicle.constants.period, vehicle.pulses.firing_time
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
def _move(b, data, vehicle, state, clock):
    """Give every craft the impulse that is due and let it move for the length of the piece."""
    constants, body, gradient = vehicle.constants, vehicle.body, vehicle.pulses.gradient
    lanes, fewest, block, first = (
        state.shape[1], vehicle.pulses.substeps, data[b], vehicle.rows.first_reference
    )  # fmt: skip
    most = 0
    for w in range(lanes):
        kick = angular_acceleration(
            (0.0, 0.0, 0.0), (clock[_KICK, w], clock[_KICK + 1, w], clock[_KICK + 2, w]), body.inertia,
            body.inverse,
        )  # fmt: skip
        state[_W, w], state[_W + 1, w] = state[_W, w] + kick[0], state[_W + 1, w] + kick[1]
        state[_W + 2, w] = state[_W + 2, w] + kick[2]
        count = equal_substeps(b, w, data, state, clock[_LENGTH, w], fewest, constants)
        clock[_COUNT, w] = count
        most = int(count) if count > most else most
    for step in range(most):
        for w in range(lanes):
            h = clock[_LENGTH, w] / clock[_COUNT, w] if step < clock[_COUNT, w] else 0.0
            offset = clock[_BEFORE, w] + step * h
            frames = step_frames(body.orbit, read_reference(body.orbit, state, REFERENCE, w), h)
            start = read_reference(body.orbit, block, first, w)
            vertical = (clock[_COSINE, w], clock[_SINE, w])
            q, rate = _turned(
                (state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w]),
                (state[_W, w], state[_W + 1, w], state[_W + 2, w]),
                h,
                verticals(body.orbit, frames, start, vertical, offset, h, gradient),
                (clock[_TORQUE, w], clock[_TORQUE + 1, w], clock[_TORQUE + 2, w]),
                body,
            )  # fmt: skip
            write_reference(body.orbit, state, REFERENCE, w, reference_of(body.orbit, frames[2]))
            state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w] = q[0], q[1], q[2], q[3]
            state[_W, w], state[_W + 1, w], state[_W + 2, w] = rate[0], rate[1], rate[2]


@njit(forceinline=True)
def _turned(q, rate, h, pulls, torque, body):
    """Attitude and rate after ``h`` seconds of free motion.

    ``pulls`` are those of :func:`verticals`. The gravity gradient there is that of an attitude to second
    order.
    """
    inertia, inverse = body.inertia, body.inverse
    torque_0 = _torque(q, pulls[0], torque, inertia)
    a = angular_acceleration(rate, torque_0, inertia, inverse)
    q_m = _roughly_turned(q, rate, a, 0.5 * h)
    q_1 = _roughly_turned(q, rate, a, h)
    _, middle, end = rate_step(
        rate,
        torque_0,
        _torque(q_m, pulls[1], torque, inertia),
        _torque(q_1, pulls[2], torque, inertia),
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
def _torque(q, pull, torque, inertia):
    gradient = gravity_gradient(rotate(q, (pull[0], pull[1], pull[2])), pull[3], inertia)
    return (torque[0] + gradient[0], torque[1] + gradient[1], torque[2] + gradient[2])


def verticals(orbit, frames, start, vertical, offset, h, gradient):
    """Where the vertical stands at the start, middle and end of a sub-step, and how strong the gradient is.

    Args:
        orbit: Of any kind.
        frames: Motions of LVLH, as :func:`.orbits.step_frames` gives them.
        start: The reference of LVLH at the start of the episode.
        vertical: On a circular orbit, where the vertical stands at the start of the period.
        offset: From there to the start of the sub-step, s.
        h: Length of the sub-step, s.
        gradient: As :class:`.vehicle.Pulses` has it.

    Returns:
        Three times the direction, in LVLH as it stood at the start of the episode, and the strength, 1/s^2.
    """
    return _VERTICALS[type(orbit)](orbit, frames, start, vertical, offset, h, gradient)


def _steady_verticals(orbit, frames, start, vertical, offset, h, gradient):
    n = orbit.mean_motion
    return (
        _ahead(vertical, n * offset, gradient),
        _ahead(vertical, n * (offset + 0.5 * h), gradient),
        _ahead(vertical, n * (offset + h), gradient),
    )


def _elliptic_verticals(orbit, frames, start, vertical, offset, h, gradient):
    first = frame_motion(orbit, start)
    return (
        _about(first, frames[0], gradient), _about(first, frames[1], gradient),
        _about(first, frames[2], gradient),
    )  # fmt: skip


def _oblate_verticals(orbit, frames, start, vertical, offset, h, gradient):
    first, pull = oblate_attitude(start), gradient * orbit.mu
    return (
        _over(first, frames[0], pull), _over(first, frames[1], pull), _over(first, frames[2], pull),
    )  # fmt: skip


_VERTICALS = {
    Hill: _steady_verticals, Circular: _steady_verticals, LinearElliptic: _elliptic_verticals,
    Elliptic: _elliptic_verticals, Oblate: _oblate_verticals,
}  # fmt: skip
chosen_by_kind(verticals, _VERTICALS.__getitem__)


@njit(forceinline=True)
def _ahead(vertical, angle, gradient):
    """The vertical a small angle further on: series, exact to rounding up to 0.02 rad."""
    z = angle * angle
    c, s = 1.0 - 0.5 * z * (1.0 - 1 / 12 * z), angle * (1.0 - 1 / 6 * z * (1.0 - 1 / 20 * z))
    return (c * vertical[0] - s * vertical[1], s * vertical[0] + c * vertical[1], 0.0, gradient)


@njit(forceinline=True)
def _about(first, motion, gradient):
    """The vertical of a motion on an ellipse, from LVLH of another one."""
    c = first.cosine * motion.cosine + first.sine * motion.sine
    s = first.cosine * motion.sine - first.sine * motion.cosine
    return (1.0 - 2.0 * s * s, 2.0 * s * c, 0.0, gradient * motion.gravity)


@njit(forceinline=True)
def _over(first, motion, pull):
    """The vertical of a motion with J2, from LVLH of an attitude."""
    up = rotate(first, rotate_back(oblate_attitude(motion.reference), (1.0, 0.0, 0.0)))
    return (up[0], up[1], up[2], pull / (motion.radius * motion.radius * motion.radius))


@njit
def pulse_health(faults, t, pulses, made):
    """What the faults of a craft make of firings at ``t``, s of the episode.

    ``faults`` (slots, FAULT_WIDTH); ``made`` (HEALTH_GROUPS, n) is filled.
    """
    capacitors = pulses.capacitors
    for i in range(made.shape[1]):
        floor, slope, gain = health.health_at(faults, i, t, t, capacitors)
        mass, width, resistance = health.pulse_shares(faults, i, capacitors, t)
        if mass != 1.0 or width != 1.0 or resistance != 0.0:
            gain *= pulse_ratio(mass, width, resistance, 1.0, pulses.logarithms, pulses.resistance)
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
