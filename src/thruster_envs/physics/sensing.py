"""What a craft's navigation says of it: a noisy state, and the rate change that follows from it.

Models white noise of a stated size on each axis, normal or uniform, independent from one control period to
the next (Yang 2003, section 6.4: carrier-phase differential GPS). The *measured rate change* of a period is
the difference of two consecutive velocity measurements less what free motion would have done in between
(orbital drift, by the linear equations or with J2, and gyroscopic coupling), in body axes; the *expected* one
is what the nominal vehicle would have given for the same command, feed coupling included. Both are beliefs:
neither sees a fault.

Faults of sensors (:func:`apply_sensor_faults`) act on what is measured, and by it on everything that follows;
what truly is stays as it is. What they add is added to the measurement without faults, noise included: all of
it together, so that their order makes no difference. What is held, by a freeze or a drop-out, is the last
measurement that was given. The attitude is turned about body axes, by the sum of what is added on each; its
measured value on an axis is the component of the rotation vector from LVLH, of at most pi. At the start of an
episode there is nothing to hold yet. Leaves out time correlation.
"""

import math

import numpy as np

from thruster_envs.faults import encoding as code
from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.attitude import (
    angular_acceleration,
    conjugate,
    cross,
    exponential,
    normalised,
    quaternion_product,
    rotate,
    symmetric_product,
)
from thruster_envs.physics.body import reference_steps
from thruster_envs.physics.orbits import free_velocity, read_reference
from thruster_envs.physics.vehicle import open_batch, open_vehicle
from thruster_envs.random import MEASUREMENT, STEP, normal_pair, philox, uniform_pair


@njit(forceinline=True)
def word_rows(n):
    """Rows of the random words of a period of a craft with ``n`` thrusters."""
    return 4 * ((n + 1) // 8 + 3)


@njit(forceinline=True)
def draw_words(b, batch, words, n, lanes):
    """Random words of the period, 6 + n / 2 of them.

    They give twelve normal numbers for the sensors, then one uniform number for each thruster.
    """
    data, streams = batch.data, batch.streams
    for block in range((6 + (n + 1) // 2 + 3) // 4):
        for w in range(lanes):
            words[4 * block, w], words[4 * block + 1, w], words[4 * block + 2, w], words[4 * block + 3, w] = (
                philox(
                    np.uint64(block),
                    np.uint64(np.int64(data[b, at.STEP, w])),
                    streams[b, at.EPISODE, w],
                    streams[b, at.CRAFT, w] | np.uint64(STEP << 32),
                    streams[b, at.KEY_LOW, w],
                    streams[b, at.KEY_HIGH, w],
                )
            )


@njit(forceinline=True)
def uniform_errors(word):
    """Two independent uniform numbers of mean 0 and variance 1 from one word."""
    first, second = uniform_pair(word)
    return 1.7320508075688772 * (2.0 * first - 1.0), 1.7320508075688772 * (2.0 * second - 1.0)


@njit(forceinline=True)
def measure(truth, noise, constants):
    """Thirteen measured numbers from the true ones and twelve random numbers of mean 0 and variance 1.

    They are position, velocity, attitude and rate.
    """
    a, b = constants.sigma_position, constants.sigma_velocity
    c, d = 0.5 * constants.sigma_attitude, constants.sigma_rate
    q = quaternion_product(
        exponential(c * noise[6], c * noise[7], c * noise[8]), (truth[6], truth[7], truth[8], truth[9])
    )
    return (
        truth[0] + a * noise[0],
        truth[1] + a * noise[1],
        truth[2] + a * noise[2],
        truth[3] + b * noise[3],
        truth[4] + b * noise[4],
        truth[5] + b * noise[5],
        q[0],
        q[1],
        q[2],
        q[3],
        truth[10] + d * noise[9],
        truth[11] + d * noise[10],
        truth[12] + d * noise[11],
    )


@njit(forceinline=True)
def measured_change(before, after, constants, body, reference):
    """Rate change of a period in body axes, m/s and rad/s, from two measurements, free motion removed.

    ``reference`` says where LVLH stands at the end.
    """
    period = constants.period
    drift = free_velocity(
        body.orbit, reference, constants.velocity_drift, period, reference_steps(constants),
        (before[0], before[1], before[2]), (before[3], before[4], before[5]),
    )  # fmt: skip
    q = (before[6], before[7], before[8], before[9])
    translation = rotate(q, (after[3] - drift[0], after[4] - drift[1], after[5] - drift[2]))
    mean = (
        0.5 * (before[10] + after[10]),
        0.5 * (before[11] + after[11]),
        0.5 * (before[12] + after[12]),
    )
    free = angular_acceleration(mean, (0.0, 0.0, 0.0), body.inertia, body.inverse)
    return (
        translation[0],
        translation[1],
        translation[2],
        after[10] - before[10] - period * free[0],
        after[11] - before[11] - period * free[1],
        after[12] - before[12] - period * free[2],
    )


@njit(forceinline=True)
def write_measurement(b, w, data, measured):
    """Store the thirteen measured numbers of one craft."""
    m = at.MEASURED
    data[b, m, w], data[b, m + 1, w], data[b, m + 2, w] = measured[0], measured[1], measured[2]
    data[b, m + 3, w], data[b, m + 4, w], data[b, m + 5, w] = measured[3], measured[4], measured[5]
    data[b, m + 6, w], data[b, m + 7, w], data[b, m + 8, w] = measured[6], measured[7], measured[8]
    data[b, m + 9, w], data[b, m + 10, w] = measured[9], measured[10]
    data[b, m + 11, w], data[b, m + 12, w] = measured[11], measured[12]


# Rows of a block's scratch: random numbers, the measurement before and after the period, the rate change in
# between.
_NORMAL, _OLD, _NEW, _CHANGE, SIGHT_ROWS = 0, 12, 25, 38, 44


@njit(forceinline=True)
def look(b, data, vehicle, words, state, sight, lanes):
    """Measure every craft of a block after a period, and form the measured rate change.

    The noise comes from the first six random words of each lane. ``state`` (14, lanes) is the true state,
    ``sight`` (SIGHT_ROWS, lanes) scratch.
    """
    constants, body, block, row = vehicle.constants, vehicle.body, data[b], vehicle.rows.reference
    if constants.uniform_errors > 0.0:
        for k in range(6):
            for w in range(lanes):
                sight[2 * k, w], sight[2 * k + 1, w] = uniform_errors(words[k, w])
    else:
        for k in range(6):
            for w in range(lanes):
                sight[2 * k, w], sight[2 * k + 1, w] = normal_pair(words[k, w])
    for k in range(13):
        for w in range(lanes):
            sight[_OLD + k, w] = data[b, at.MEASURED + k, w]
    for w in range(lanes):
        truth = (
            state[0, w], state[1, w], state[2, w], state[3, w], state[4, w], state[5, w], state[6, w],
            state[7, w], state[8, w], state[9, w], state[10, w], state[11, w], state[12, w],
        )  # fmt: skip
        normal = (
            sight[0, w], sight[1, w], sight[2, w], sight[3, w], sight[4, w], sight[5, w],
            sight[6, w], sight[7, w], sight[8, w], sight[9, w], sight[10, w], sight[11, w],
        )  # fmt: skip
        new = measure(truth, normal, constants)
        sight[25, w], sight[26, w], sight[27, w], sight[28, w], sight[29, w] = (
            new[0],
            new[1],
            new[2],
            new[3],
            new[4],
        )
        sight[30, w], sight[31, w], sight[32, w], sight[33, w] = new[5], new[6], new[7], new[8]
        sight[34, w], sight[35, w], sight[36, w], sight[37, w] = new[9], new[10], new[11], new[12]
    for w in range(lanes):
        old = (
            sight[12, w], sight[13, w], sight[14, w], sight[15, w], sight[16, w], sight[17, w], sight[18, w],
            sight[19, w], sight[20, w], sight[21, w], sight[22, w], sight[23, w], sight[24, w],
        )  # fmt: skip
        new = (
            sight[25, w], sight[26, w], sight[27, w], sight[28, w], sight[29, w], sight[30, w], sight[31, w],
            sight[32, w], sight[33, w], sight[34, w], sight[35, w], sight[36, w], sight[37, w],
        )  # fmt: skip
        reference = read_reference(body.orbit, block, row, w)
        change = measured_change(old, new, constants, body, reference)
        sight[38, w], sight[39, w], sight[40, w] = change[0], change[1], change[2]
        sight[41, w], sight[42, w], sight[43, w] = change[3], change[4], change[5]
    for k in range(13):
        for w in range(lanes):
            data[b, at.MEASURED + k, w] = sight[_NEW + k, w]
    for k in range(6):
        for w in range(lanes):
            data[b, at.MEASURED_CHANGE + k, w] = sight[_CHANGE + k, w]
    _add_stored(b, data, vehicle, vehicle.storage, sight, lanes)


@njit(forceinline=True)
def _add_stored(b, data, vehicle, storage, sight, lanes):
    """Take the turning by stored momentum out of the measured rate changes of a block."""
    if storage is not None:
        for w in range(lanes):
            add_stored(b, w, data, vehicle, sight[_OLD + 10 : _OLD + 13, w], sight[_NEW + 10 : _NEW + 13, w])


@njit
def add_stored(b, w, data, vehicle, before, after):
    """Take the turning by stored momentum, between two measured rates, out of a measured rate change."""
    h, period = vehicle.rows.stored_momentum, vehicle.constants.period
    mean = (0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1]), 0.5 * (before[2] + after[2]))
    turning = cross(mean, (data[b, h, w], data[b, h + 1, w], data[b, h + 2, w]))
    change = symmetric_product(vehicle.body.inverse, turning)
    for k in range(3):
        data[b, at.MEASURED_CHANGE + 3 + k, w] += period * change[k]


@njit(forceinline=True)
def expected_change(b, data, vehicle, coupling, durations, first_row, sight, lanes):
    """Rate change that the nominal vehicle gives for the commanded pulses, feed coupling included.

    ``durations`` holds the nominal on-times from ``first_row`` on, of pulses that start together and still
    lose ``coupling``; where it is 0 they are effective ones. The propellant that these use makes the nominal
    vehicle lighter. ``sight`` is scratch.
    """
    n, thrusters, constants = vehicle.rows.thrusters, vehicle.thrusters, vehicle.constants
    believed = thrusters.believed
    for k in range(8):
        for w in range(lanes):
            sight[k, w] = 0.0
    for i in range(n):
        for w in range(lanes):
            sight[6, w] = -durations[first_row + i, w]
        for j in range(n):
            for w in range(lanes):
                own, other = durations[first_row + i, w], durations[first_row + j, w]
                sight[6, w] += own if own < other else other
        for w in range(lanes):
            effective = durations[first_row + i, w] - coupling * sight[6, w]
            sight[6, w] = effective if effective > 0.0 else 0.0
        for k in range(6):
            column = believed[k, i]
            for w in range(lanes):
                sight[k, w] += column * sight[6, w]
        flow = thrusters.thrust[i] * thrusters.flow_per_thrust[i]
        for w in range(lanes):
            sight[7, w] += flow * sight[6, w]
    for w in range(lanes):
        mass = constants.mass - data[b, at.EXPECTED_USE, w]
        fires = 1.0 if mass > constants.dry_mass else 0.0
        mean = mass - 0.5 * fires * sight[7, w]
        data[b, at.EXPECTED_USE, w] += fires * sight[7, w]
        for k in range(3):
            sight[k, w] *= fires * constants.mass / mean
        for k in range(3, 6):
            sight[k, w] *= fires
    for k in range(6):
        for w in range(lanes):
            data[b, at.EXPECTED_CHANGE + k, w] = sight[k, w]


#: First row of each sensor's measurement, by its code; the attitude has four, the others three.
_ROWS = (-1, at.MEASURED, at.MEASURED + 3, at.MEASURED + 6, at.MEASURED + 10)
_SENSORS = len(_ROWS)


@kernel(nogil=True)
def apply_sensor_faults(arrays, faults, parts, before, translates, first, last):
    """Let the faults of sensors act on the measurements of the blocks ``first`` to ``last`` (exclusive).

    Args:
        arrays: Of the batch, with the measurements at the end of a period, and the rate change that follows
            from them.
        faults: (blocks, lanes, slots, FAULT_FIELDS), those of sensors alone.
        parts: Of the vehicle.
        before: (last - first, 13, lanes), the measurements at the start of the period, as they were given.
        translates: Whether velocities are measured; without, the rate change of translation stays zero.
        first: Block, and
        last: one past the last of them.
    """
    batch, vehicle = open_batch(arrays), open_vehicle(parts)
    data, constants = batch.data, vehicle.constants
    error, held = np.zeros((_SENSORS, 3)), np.zeros((_SENSORS, 3), np.bool_)
    for b in range(first, last):
        for w in range(data.shape[2]):
            if not _measure_faultily(b, w, batch, faults, constants.period, before[b - first], error, held):
                continue
            old, m = before[b - first], at.MEASURED
            change = measured_change(
                (old[0, w], old[1, w], old[2, w], old[3, w], old[4, w], old[5, w], old[6, w], old[7, w],
                 old[8, w], old[9, w], old[10, w], old[11, w], old[12, w]),
                (data[b, m, w], data[b, m + 1, w], data[b, m + 2, w], data[b, m + 3, w], data[b, m + 4, w],
                 data[b, m + 5, w], data[b, m + 6, w], data[b, m + 7, w], data[b, m + 8, w],
                 data[b, m + 9, w], data[b, m + 10, w], data[b, m + 11, w], data[b, m + 12, w]),
                constants, vehicle.body,
                read_reference(vehicle.body.orbit, data[b], vehicle.rows.reference, w),
            )  # fmt: skip
            for k in range(0 if translates else 3, 6):
                data[b, at.MEASURED_CHANGE + k, w] = change[k]
            if vehicle.rows.number_of_wheels + vehicle.rows.number_of_gyros > 0:
                add_stored(b, w, data, vehicle, old[10:13, w], data[b, m + 10 : m + 13, w])


@kernel
def apply_first_sensor_faults(arrays, faults, parts, which, craft):
    """The same for what the craft of some worlds measure at the start of an episode."""
    batch, period = open_batch(arrays), open_vehicle(parts).constants.period
    data, lanes = batch.data, batch.data.shape[2]
    error, held = np.zeros((_SENSORS, 3)), np.zeros((_SENSORS, 3), np.bool_)
    for world in which:
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            before = data[b, at.MEASURED : at.MEASURED + 13].copy()
            _measure_faultily(b, w, batch, faults, period, before, error, held)


@kernel
def find_stale(arrays, faults, parts, stale):
    """Whether a drop-out left each sensor without its last measurement, (worlds, craft, sensors), written."""
    batch, period = open_batch(arrays), open_vehicle(parts).constants.period
    data, streams = batch.data, batch.streams
    lanes, craft = data.shape[2], stale.shape[1]
    for world in range(stale.shape[0]):
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            t = data[b, at.STEP, w] * period
            for k in range(faults.shape[2]):
                fault = faults[b, w, k]
                acts = data[b, at.STEP, w] > 0.0 and health.is_active(fault, t)
                if acts and health.is_missing(fault, t, _chance(b, w, k, data, streams)):
                    stale[world, c, int(fault[code.FIELD_SENSOR]) - 1] = True


@njit
def _chance(b, w, slot, data, streams):
    """A random number from 0 to 1 of one fault and one measurement."""
    words = philox(
        np.uint64(slot), np.uint64(np.int64(data[b, at.STEP, w])), streams[b, at.EPISODE, w],
        streams[b, at.CRAFT, w] | np.uint64(MEASUREMENT << 32),
        streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
    )  # fmt: skip
    return uniform_pair(words[0])[0]


@njit
def _measure_faultily(b, w, batch, faults, period, before, error, held):
    """Put the faults of one craft into its measurement; whether it has any.

    ``before`` (13, lanes) is its last measurement; ``error`` (sensors from 1, axes) and ``held`` (the
    same) are scratch.
    """
    data, streams = batch.data, batch.streams
    t, faulty = data[b, at.STEP, w] * period, False
    for k in range(faults.shape[2]):
        fault = faults[b, w, k]
        if not health.is_there(fault):
            continue
        if not faulty:
            error[:], held[:], faulty = 0.0, False, True
        if health.is_active(fault, t):
            chance, sensor = _chance(b, w, k, data, streams), int(fault[code.FIELD_SENSOR])
            axis = int(fault[code.FIELD_AXIS])
            keeps = data[b, at.STEP, w] > 0.0 and health.holds(fault, t, chance)
            for c in range(3):
                if axis == 0 or axis == c + 1:
                    value = _measured(b, w, data, sensor, c)
                    error[sensor, c] += health.measurement_error(fault, t, value, chance)
                    held[sensor, c] |= keeps
    if faulty:
        for sensor in range(1, _SENSORS):
            if sensor == code.ATTITUDE:
                _turn_measurement(b, w, data, before, error[sensor], held[sensor])
                continue
            for c in range(3):
                place = _ROWS[sensor] + c
                data[b, place, w] += error[sensor, c]
                if held[sensor, c]:
                    data[b, place, w] = before[place - at.MEASURED, w]
    return faulty


@njit
def _measured(b, w, data, sensor, c):
    """One number that a sensor measures, in its unit."""
    m = _ROWS[sensor]
    if sensor == code.ATTITUDE:
        return rotation_vector((data[b, m, w], data[b, m + 1, w], data[b, m + 2, w], data[b, m + 3, w]))[c]
    return data[b, m + c, w]


@njit
def _turn_measurement(b, w, data, before, error, held):
    """Put errors (3,), rad, and axes that are held (3,) into the measured attitude of one craft."""
    m = _ROWS[code.ATTITUDE]
    old = m - at.MEASURED
    q = (data[b, m, w], data[b, m + 1, w], data[b, m + 2, w], data[b, m + 3, w])
    last = (before[old, w], before[old + 1, w], before[old + 2, w], before[old + 3, w])
    if error[0] != 0.0 or error[1] != 0.0 or error[2] != 0.0:
        q = normalised(turned_by((error[0], error[1], error[2]), q))
    if held[0] and held[1] and held[2]:
        q = last
    elif held[0] or held[1] or held[2]:
        back = rotation_vector(quaternion_product(last, conjugate(q)))
        x, y, z = back[0] if held[0] else 0.0, back[1] if held[1] else 0.0, back[2] if held[2] else 0.0
        q = normalised(turned_by((x, y, z), q))
    for k in range(4):
        data[b, m + k, w] = q[k]


@njit
def rotation_vector(q):
    """How a body is turned from its reference, rad, body axes, by at most pi: of a unit quaternion."""
    sign = -1.0 if q[0] >= 0.0 else 1.0
    size = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    factor = sign * (2.0 * math.atan2(size, abs(q[0])) / size if size > 1e-300 else 2.0)
    return (factor * q[1], factor * q[2], factor * q[3])


@njit
def turned_by(vector, q):
    """The attitude ``q`` turned further by a rotation vector, rad, body axes."""
    size = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    factor = -math.sin(0.5 * size) / size if size > 1e-300 else -0.5
    turn = (math.cos(0.5 * size), factor * vector[0], factor * vector[1], factor * vector[2])
    return quaternion_product(turn, q)
