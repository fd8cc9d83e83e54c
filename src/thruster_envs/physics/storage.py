"""The motion of a rigid body that stores momentum, in reaction wheels and control-moment gyros.

With the inertia ``J`` of the body and all that is in it, the body rate ``w`` and the stored momentum ``h``
against the body, the total ``H = J w + h`` follows ``H' = T - w x H``. The rotors' share of it is integrated
with the body's rate by RK4; the attitude takes the Magnus step of every other craft. The rate at the end of a
step is then what the total momentum leaves: that of the start and the impulse of the torque, turned into the
body as it has turned. So momentum is conserved to rounding, whatever the sub-step.

A sub-step is cut where a rotor's speed passes zero or its limit. Commands, friction and limits are those of
:mod:`.actuators.wheels` and :mod:`.actuators.gyros`, which say what is left out. Tachometers and encoders
measure speeds and angles without errors.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.actuators import gyros as gyro
from thruster_envs.physics.actuators import wheels as wheel
from thruster_envs.physics.attitude import (
    cross,
    hermite,
    quaternion_product,
    rotate,
    rotate_back,
    symmetric_product,
    turn,
)
from thruster_envs.physics.body import STORED, move
from thruster_envs.physics.borrowed import borrow

FloatArray = NDArray[np.float64]

#: Most pieces into which events cut a sub-step; what is left then is flown as one.
_MOST_PIECES = 24
_IDENTITY = (1.0, 0.0, 0.0, 0.0)


class StorageWork(NamedTuple):
    """Scratch of what stores momentum in one block.

    Attributes:
        time: (lanes,), s of the episode that each craft has reached.
        wheels: (WHEEL_ROWS, m), of one craft.
        gyros: (GYRO_ROWS, g), of one craft.
    """

    time: FloatArray
    wheels: FloatArray
    gyros: FloatArray


@njit(forceinline=True)
def state_rows(storage, rows):
    """Rows of the state of a block: with the speeds of the rotors and the angles of the gimbals."""
    if storage is None:
        return STORED
    return STORED + rows.number_of_wheels + rows.number_of_gyros


@njit(forceinline=True)
def storage_arrays(rows, lanes):
    """The arrays of :class:`StorageWork`."""
    return (
        np.zeros(lanes),
        np.zeros((wheel.WHEEL_ROWS, rows.number_of_wheels)),
        np.zeros((gyro.GYRO_ROWS, rows.number_of_gyros)),
    )


@njit(forceinline=True)
def storage_work(storage, arrays):
    """The scratch of a vehicle's storage in these arrays, which are borrowed; None where it has none."""
    if storage is None:
        return None
    return StorageWork(borrow(arrays[0]), borrow(arrays[1]), borrow(arrays[2]))


@njit(forceinline=True)
def load_storage(b, batch, vehicle, storage, work, state):
    """Copy speeds and angles of a block out of ``data``, and start its clocks."""
    if storage is not None:
        rows, data = vehicle.rows, batch.data
        for w in range(state.shape[1]):
            work.time[w] = data[b, at.STEP, w] * vehicle.constants.period
            for i in range(rows.number_of_wheels):
                state[STORED + i, w] = data[b, rows.wheel_speeds + i, w]
            for j in range(rows.number_of_gyros):
                state[STORED + rows.number_of_wheels + j, w] = data[b, rows.gimbal_angles + j, w]


@njit(forceinline=True)
def store_storage(b, data, vehicle, storage, work, state):
    """Write speeds and angles of a block back, but for craft that are lost, and measure them.

    What the nominal wheels and gyros give for their commands is added to the expected rate change.
    """
    if storage is not None:
        for w in range(state.shape[1]):
            _store_one(b, w, data, vehicle, storage, work, state)


@njit
def _store_one(b, w, data, vehicle, storage, work, state):
    rows, m = vehicle.rows, vehicle.rows.number_of_wheels
    _expect(b, w, data, vehicle, storage, work)
    first = _measured_momentum(b, w, data, rows, storage, work)
    for i in range(m):
        if data[b, at.LOST, w] == 0.0:
            data[b, rows.wheel_speeds + i, w] = state[STORED + i, w]
        data[b, rows.measured_speeds + i, w] = data[b, rows.wheel_speeds + i, w]
    for j in range(rows.number_of_gyros):
        if data[b, at.LOST, w] == 0.0:
            data[b, rows.gimbal_angles + j, w] = state[STORED + m + j, w]
        data[b, rows.measured_angles + j, w] = data[b, rows.gimbal_angles + j, w]
    last = _measured_momentum(b, w, data, rows, storage, work)
    for k in range(3):
        data[b, rows.stored_momentum + k, w] = 0.5 * (first[k] + last[k])


@njit
def _measured_momentum(b, w, data, rows, storage, work):
    """What is stored by the speeds and angles that were measured last, N m s, body axes."""
    for i in range(rows.number_of_wheels):
        work.wheels[wheel.SPEED, i] = data[b, rows.measured_speeds + i, w]
    for j in range(rows.number_of_gyros):
        work.gyros[gyro.ANGLE, j] = data[b, rows.measured_angles + j, w]
    h = wheel.stored(storage.wheels, wheel.SPEED, work.wheels)
    g, _ = gyro.stored(storage.gyros, 0.0, work.gyros)
    return (h[0] + g[0], h[1] + g[1], h[2] + g[2])


@njit
def _expect(b, w, data, vehicle, storage, work):
    """Add what nominal wheels and gyros give in a period, from what was measured at its start."""
    rows, period, wheels, gyros = vehicle.rows, vehicle.constants.period, storage.wheels, storage.gyros
    before = _measured_momentum(b, w, data, rows, storage, work)
    for i in range(wheels.shape[0]):
        share, speed = min(max(data[b, rows.wheel_torques + i, w], -1.0), 1.0), work.wheels[wheel.SPEED, i]
        most, own = wheels[i, wheel.MAX_SPEED], wheels[i, wheel.INERTIA]
        drive, dry = share * wheels[i, wheel.MAX_TORQUE], wheels[i, wheel.COULOMB]
        if speed == 0.0:
            net = math.copysign(max(abs(drive) - dry, 0.0), drive)
        else:
            net = drive - math.copysign(dry, speed) - wheels[i, wheel.VISCOUS] * speed
        after = min(max(speed + period * net / own, -most), most)
        work.wheels[wheel.SPEED, i] = after if abs(speed) <= most else speed
    for j in range(gyros.shape[0]):
        share = min(max(data[b, rows.gimbal_rates + j, w], -1.0), 1.0)
        work.gyros[gyro.ANGLE, j] += period * share * gyros[j, gyro.MAX_RATE]
    h, (g, _) = wheel.stored(wheels, wheel.SPEED, work.wheels), gyro.stored(gyros, 0.0, work.gyros)
    for i in range(wheels.shape[0]):
        work.wheels[wheel.HELD, i] = 0.0
    change = _solved(
        _moving_inertia(vehicle.body, wheels, work.wheels),
        (before[0] - h[0] - g[0], before[1] - h[1] - g[1], before[2] - h[2] - g[2]),
    )
    for k in range(3):
        data[b, at.EXPECTED_CHANGE + 3 + k, w] += change[k]


@njit
def substep_stored(b, w, batch, vehicle, storage, work, state, h, loads):
    """One sub-step of one craft that stores momentum.

    ``loads`` are forces, torques, flows and push, as :func:`.body.substep` takes them.
    """
    if not h > 0.0:
        return
    body, m, g = vehicle.body, storage.wheels.shape[0], storage.gyros.shape[0]
    forces, torques, flows, push = loads
    _command(b, w, batch, vehicle, storage, work, work.time[w] + 0.5 * h)
    done, pieces = 0.0, 0
    while done < h:
        pieces += 1
        for i in range(m):
            work.wheels[wheel.SPEED, i] = state[STORED + i, w]
        for j in range(g):
            work.gyros[gyro.ANGLE, j] = state[STORED + m + j, w]
        rate = (state[at.RATE, w], state[at.RATE + 1, w], state[at.RATE + 2, w])
        piece = h - done
        _decide(rate, _at_share(torques, done / h), body, storage, work)
        half, whole, end = _turn(rate, _nodes(torques, done, piece, h), piece, body, storage, work)
        which, there = -1, 0.0
        if pieces < _MOST_PIECES:
            until, which, there = wheel.first_event(storage.wheels, piece, work.wheels)
            for _ in range(3 if which >= 0 else 0):
                piece = min(max(until, 0.0), h - done)
                half, whole, end = _turn(rate, _nodes(torques, done, piece, h), piece, body, storage, work)
                slope = work.wheels[wheel.RATE_5, which]
                if slope != 0.0:
                    until = piece - (work.wheels[wheel.END, which] - there) / slope
        q = (
            state[at.ATTITUDE, w], state[at.ATTITUDE + 1, w], state[at.ATTITUDE + 2, w],
            state[at.ATTITUDE + 3, w],
        )  # fmt: skip
        if piece > 0.0:
            attitudes = (q, quaternion_product(half, q), quaternion_product(whole, q))
            move(
                state, w, piece, body, attitudes, end, _nodes(forces, done, piece, h),
                _flows(flows, done, piece, h), push,
            )  # fmt: skip
        for i in range(m):
            state[STORED + i, w] = there if i == which else work.wheels[wheel.END, i]
        for j in range(g):
            state[STORED + m + j, w] += piece * work.gyros[gyro.RATE, j]
        done = done + piece if h - done > piece else h
    work.time[w] += h


@njit
def _command(b, w, batch, vehicle, storage, work, t):
    """What motors and gimbals do, by the commands of the period and the faults at ``t``."""
    data, rows, wheels, gyros = batch.data, vehicle.rows, storage.wheels, storage.gyros
    faults = batch.storage_faults[b, w]
    for i in range(wheels.shape[0]):
        loss, stuck, drag, slower = health.wheel_health(faults, i, t)
        share = min(max(data[b, rows.wheel_torques + i, w], -1.0), 1.0)
        work.wheels[wheel.MOTOR, i] = (1.0 - loss) * share * wheels[i, wheel.MAX_TORQUE]
        work.wheels[wheel.DRY, i] = wheels[i, wheel.COULOMB] + drag * wheels[i, wheel.MAX_TORQUE]
        work.wheels[wheel.LIMIT, i] = (1.0 - slower) * wheels[i, wheel.MAX_SPEED]
        work.wheels[wheel.STUCK, i] = stuck
    for j in range(gyros.shape[0]):
        share = min(max(data[b, rows.gimbal_rates + j, w], -1.0), 1.0)
        kept = 1.0 - health.gimbal_loss(faults, j, t)
        work.gyros[gyro.RATE, j] = kept * share * gyros[j, gyro.MAX_RATE]


@njit
def _decide(rate, torque, body, storage, work):
    """Find which rotors are held at the start of a piece."""
    wheels, s = storage.wheels, work.wheels
    momentum, change = gyro.stored(storage.gyros, 0.0, work.gyros)
    for i in range(wheels.shape[0]):
        wheel.decide(wheels, i, (0.0, 0.0, 0.0), s)
    for _ in range(2 * wheels.shape[0]):
        acceleration = _rates(rate, torque, momentum, change, wheel.SPEED, wheel.RATE_1, body, wheels, s)
        changed = False
        for i in range(wheels.shape[0]):
            changed |= wheel.decide(wheels, i, acceleration, s)
        if not changed:
            break


@njit
def _rates(rate, torque, momentum, change, speeds, row, body, wheels, s):
    """Angular acceleration of the body, rad/s^2; that of the rotors' speeds goes into a row of the scratch.

    ``momentum`` (N m s) and its ``change`` (N m) are those of the gyros. A rotor that is free takes part in
    the body's turning but for its own axis.
    """
    h, jw = wheel.stored(wheels, speeds, s), symmetric_product(body.inertia, rate)
    total = (jw[0] + h[0] + momentum[0], jw[1] + h[1] + momentum[1], jw[2] + h[2] + momentum[2])
    turning = cross(rate, total)
    x, y = torque[0] - turning[0] - change[0], torque[1] - turning[1] - change[1]
    z = torque[2] - turning[2] - change[2]
    for i in range(wheels.shape[0]):
        if s[wheel.HELD, i] == 0.0:
            net = wheel.net_torque(wheels, i, s[speeds, i], s)
            x, y, z = x - net * wheels[i, 0], y - net * wheels[i, 1], z - net * wheels[i, 2]
    acceleration = _solved(_moving_inertia(body, wheels, s), (x, y, z))
    for i in range(wheels.shape[0]):
        s[row, i] = 0.0
        if s[wheel.HELD, i] == 0.0:
            net = wheel.net_torque(wheels, i, s[speeds, i], s)
            s[row, i] = net / wheels[i, wheel.INERTIA] - wheel.along(wheels, i, acceleration)
    return acceleration


@njit
def _moving_inertia(body, wheels, s):
    """Inertia of the body without that of the rotors that are free, about their axes, kg m^2."""
    a, b, c, d, e, f = _six(body.inertia)
    for i in range(wheels.shape[0]):
        if s[wheel.HELD, i] == 0.0:
            own, u, v, n = wheels[i, wheel.INERTIA], wheels[i, 0], wheels[i, 1], wheels[i, 2]
            a, b, c = a - own * u * u, b - own * v * v, c - own * n * n
            d, e, f = d - own * u * v, e - own * u * n, f - own * v * n
    return (a, b, c, d, e, f)


@njit
def _six(m):
    """The six numbers of a symmetric matrix of which only the diagonal may be given."""
    if len(m) == 3:
        return (m[0], m[1], m[2], 0.0, 0.0, 0.0)
    return (m[0], m[1], m[2], m[3], m[4], m[5])


@njit
def _solved(m, v):
    """Solution of three equations with a symmetric matrix (xx, yy, zz, xy, xz, yz)."""
    a, b, c, d, e, f = m
    p, q, r = b * c - f * f, e * f - d * c, d * f - e * b
    s, t, u = a * c - e * e, d * e - a * f, a * b - d * d
    over = 1.0 / (a * p + d * q + e * r)
    return (
        over * (p * v[0] + q * v[1] + r * v[2]),
        over * (q * v[0] + s * v[1] + t * v[2]),
        over * (r * v[0] + t * v[1] + u * v[2]),
    )


@njit
def _turn(rate, torques, h, body, storage, work):
    """Turn a body and its rotors for ``h`` seconds.

    Returns how it has turned after half of them and after all, as quaternions, and its rate then; the
    scratch has the speeds.
    """
    wheels, s, gyros = storage.wheels, work.wheels, storage.gyros
    g_0, d_0 = gyro.stored(gyros, 0.0, work.gyros)
    g_m, d_m = gyro.stored(gyros, 0.5 * h, work.gyros)
    g_1, d_1 = gyro.stored(gyros, h, work.gyros)
    k_1 = _rates(rate, torques[0], g_0, d_0, wheel.SPEED, wheel.RATE_1, body, wheels, s)
    _advance(s, wheel.RATE_1, 0.5 * h)
    k_2 = _rates(_along(rate, 0.5 * h, k_1), torques[1], g_m, d_m, wheel.END, wheel.RATE_2, body, wheels, s)
    _advance(s, wheel.RATE_2, 0.5 * h)
    k_3 = _rates(_along(rate, 0.5 * h, k_2), torques[1], g_m, d_m, wheel.END, wheel.RATE_3, body, wheels, s)
    _advance(s, wheel.RATE_3, h)
    k_4 = _rates(_along(rate, h, k_3), torques[2], g_1, d_1, wheel.END, wheel.RATE_4, body, wheels, s)
    end = (
        rate[0] + 1 / 6 * h * (k_1[0] + 2.0 * (k_2[0] + k_3[0]) + k_4[0]),
        rate[1] + 1 / 6 * h * (k_1[1] + 2.0 * (k_2[1] + k_3[1]) + k_4[1]),
        rate[2] + 1 / 6 * h * (k_1[2] + 2.0 * (k_2[2] + k_3[2]) + k_4[2]),
    )
    for i in range(wheels.shape[0]):
        mean = s[wheel.RATE_1, i] + 2.0 * (s[wheel.RATE_2, i] + s[wheel.RATE_3, i]) + s[wheel.RATE_4, i]
        s[wheel.END, i] = s[wheel.SPEED, i] + 1 / 6 * h * mean
    k_5 = _rates(end, torques[2], g_1, d_1, wheel.END, wheel.RATE_5, body, wheels, s)
    quarter = hermite(rate, k_1, end, k_5, h, 0.84375, 0.140625, 0.15625, -0.046875)
    middle = hermite(rate, k_1, end, k_5, h, 0.5, 0.125, 0.5, -0.125)
    half, whole = turn(_IDENTITY, rate, quarter, middle, 0.5 * h), turn(_IDENTITY, rate, middle, end, h)
    before, after = wheel.stored(wheels, wheel.SPEED, s), wheel.stored(wheels, wheel.END, s)
    jw = symmetric_product(body.inertia, rate)
    first, between, last = torques[0], rotate_back(half, torques[1]), rotate_back(whole, torques[2])
    total = rotate(
        whole,
        (
            jw[0] + before[0] + g_0[0] + 1 / 6 * h * (first[0] + 4.0 * between[0] + last[0]),
            jw[1] + before[1] + g_0[1] + 1 / 6 * h * (first[1] + 4.0 * between[1] + last[1]),
            jw[2] + before[2] + g_0[2] + 1 / 6 * h * (first[2] + 4.0 * between[2] + last[2]),
        ),
    )
    left = (total[0] - after[0] - g_1[0], total[1] - after[1] - g_1[1], total[2] - after[2] - g_1[2])
    return half, whole, symmetric_product(body.inverse, left)


@njit
def _advance(s, row, h):
    """Speeds after ``h`` seconds at the rates in a row, into the row of those at the end."""
    for i in range(s.shape[1]):
        s[wheel.END, i] = s[wheel.SPEED, i] + h * s[row, i]


@njit(forceinline=True)
def _along(a, s, b):
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@njit(forceinline=True)
def _at_share(nodes, s):
    """A quadratic of three nodes, 3-vectors, at the share ``s`` of a sub-step."""
    a, m, z = nodes
    return (
        _quadratic(a[0], m[0], z[0], s), _quadratic(a[1], m[1], z[1], s), _quadratic(a[2], m[2], z[2], s)
    )  # fmt: skip


@njit(forceinline=True)
def _nodes(nodes, done, piece, h):
    """The three nodes of a quadratic over a piece of a sub-step."""
    return (
        _at_share(nodes, done / h), _at_share(nodes, (done + 0.5 * piece) / h),
        _at_share(nodes, (done + piece) / h),
    )  # fmt: skip


@njit(forceinline=True)
def _flows(flows, done, piece, h):
    """The same of three numbers."""
    a, m, z = flows
    return (
        _quadratic(a, m, z, done / h), _quadratic(a, m, z, (done + 0.5 * piece) / h),
        _quadratic(a, m, z, (done + piece) / h),
    )  # fmt: skip


@njit(forceinline=True)
def _quadratic(a, m, z, s):
    return a + s * ((4.0 * (m - a) - (z - a)) + 2.0 * s * ((z - a) - 2.0 * (m - a)))
