"""The compiled draw of a world's faults from an encoded :class:`~thruster_envs.faults.FaultDistribution`.

Every draw comes from the stream of its own world (purpose ``FAULTS``; that of sensors ``SENSOR_FAULTS``), so
that the faults of an episode are a function of the world's seed and of the number of the episode.
"""

import math

import numpy as np

from thruster_envs.faults import distribution as table
from thruster_envs.faults import encoding as code
from thruster_envs.helpers import njit
from thruster_envs.random import FAULTS, SENSOR_FAULTS, philox, uniform_pair

_KINDS = table.SEVERITY_LOW - table.KIND_CUMULATIVE
_PROFILES = table.SENSOR_PROBABILITY - table.PROFILE_CUMULATIVE
_SENSORS = table.AXIS_CUMULATIVE - table.SENSOR_CUMULATIVE
_AXES = table.SENSOR_KIND_CUMULATIVE - table.AXIS_CUMULATIVE
_SENSOR_KINDS = table.SENSOR_SEVERITY_LOW - table.SENSOR_KIND_CUMULATIVE


@njit
def draw_faults(rows, distribution, thrusters, episode, key_low, key_high):
    """Fill the slots of one world, ``rows`` (craft, slots, >= 13), with what the distribution draws.

    Slots that it leaves empty are zero. Thrusters of a redundant branch have the indices that follow those of
    the branch in use.
    """
    rows[:] = 0.0
    uniform = np.empty(16)
    used = np.zeros(rows.shape[0], np.int64)
    _uniforms(uniform, 0, FAULTS, episode, key_low, key_high)
    if uniform[0] < distribution[table.PROBABILITY]:
        count = _count(uniform[1], distribution[table.COUNT_LOW], distribution[table.COUNT_WIDTH])
        for number in range(count):
            _uniforms(uniform, number + 1, FAULTS, episode, key_low, key_high)
            craft = int(uniform[0] * rows.shape[0])
            if used[craft] == rows.shape[1]:
                continue
            kind, own = _choice(distribution, table.KIND_CUMULATIVE, _KINDS, uniform[2]), 0
            thruster = _actuator(rows, distribution, thrusters, kind + 1, craft, used[craft], uniform[1])
            while thruster < 0 and own < _ACTUATORS:  # all of that kind have failed: another kind of actuator
                kind = _choice_of(distribution, own, kind, uniform[2])
                thruster = _actuator(rows, distribution, thrusters, kind + 1, craft, used[craft], uniform[1])
                own += 1
            if thruster < 0:
                continue
            row = rows[craft, used[craft]]
            used[craft] += 1
            row[code.FIELD_KIND] = kind + 1.0
            row[code.FIELD_THRUSTER] = thruster
            row[code.FIELD_SEVERITY] = (
                distribution[table.SEVERITY_LOW + kind]
                + uniform[4] * distribution[table.SEVERITY_WIDTH + kind]
            )
            _draw_times(row, distribution, uniform)
            if kind + 1 == code.INTERMITTENT:
                row[code.FIELD_PROFILE] = code.SQUARE
            row[code.FIELD_AZIMUTH] = 2.0 * math.pi * uniform[9]
            row[code.FIELD_SHARED] = distribution[table.SHARED]
    if distribution[table.SENSOR_PROBABILITY] > 0.0:
        _draw_sensor_faults(rows, distribution, used, uniform, episode, key_low, key_high)


@njit
def _draw_sensor_faults(rows, distribution, used, uniform, episode, key_low, key_high):
    """Fill further slots of one world with faults of sensors; ``used`` (craft,) are those that are taken."""
    _uniforms(uniform, 0, SENSOR_FAULTS, episode, key_low, key_high)
    if uniform[0] >= distribution[table.SENSOR_PROBABILITY]:
        return
    count = _count(uniform[1], distribution[table.SENSOR_COUNT_LOW], distribution[table.SENSOR_COUNT_WIDTH])
    for number in range(count):
        _uniforms(uniform, number + 1, SENSOR_FAULTS, episode, key_low, key_high)
        craft = int(uniform[0] * rows.shape[0])
        if used[craft] == rows.shape[1]:
            continue
        row = rows[craft, used[craft]]
        used[craft] += 1
        sensor = _choice(distribution, table.SENSOR_CUMULATIVE, _SENSORS, uniform[1])
        kind = _choice(distribution, table.SENSOR_KIND_CUMULATIVE, _SENSOR_KINDS, uniform[2])
        place = sensor * _SENSOR_KINDS + kind
        row[code.FIELD_KIND] = kind + 1.0
        row[code.FIELD_THRUSTER] = -1.0
        row[code.FIELD_SEVERITY] = (
            distribution[table.SENSOR_SEVERITY_LOW + place]
            + uniform[4] * distribution[table.SENSOR_SEVERITY_WIDTH + place]
        )
        _draw_times(row, distribution, uniform)
        varies = row[code.FIELD_PROFILE] == code.RAMP or row[code.FIELD_PROFILE] == code.SINE
        if varies and kind + 1 == code.SENSOR_FREEZE:
            row[code.FIELD_PROFILE] = code.STEP
        row[code.FIELD_SENSOR] = sensor + 1.0
        row[code.FIELD_AXIS] = _choice(distribution, table.AXIS_CUMULATIVE, _AXES, uniform[9])


@njit
def _count(uniform, low, width):
    return int(low + math.floor(uniform * (width + 1.0)))


@njit
def _draw_times(row, distribution, uniform):
    """Onset, end and profile of a fault, by its own uniform numbers."""
    onset = distribution[table.ONSET_LOW] + uniform[3] * distribution[table.ONSET_WIDTH]
    grid = distribution[table.ONSET_GRID]
    onset = math.floor(onset / grid) * grid if grid > 0.0 else onset
    row[code.FIELD_ONSET] = onset
    row[code.FIELD_END] = (
        onset + distribution[table.DURATION_LOW] + uniform[5] * distribution[table.DURATION_WIDTH]
    )
    row[code.FIELD_PROFILE] = _choice(distribution, table.PROFILE_CUMULATIVE, _PROFILES, uniform[6])
    row[code.FIELD_PROFILE_TIME] = (
        distribution[table.PROFILE_TIME_LOW] + uniform[7] * distribution[table.PROFILE_TIME_WIDTH]
    )
    row[code.FIELD_DWELL] = distribution[table.DWELL_LOW] + uniform[8] * distribution[table.DWELL_WIDTH]


@njit
def _uniforms(uniform, number, purpose, episode, key_low, key_high):
    """Sixteen uniform numbers: those of fault ``number`` of the world (0: whether, and how many)."""
    for block in range(2):
        words = philox(
            np.uint64(2 * number + block),
            np.uint64(0),
            np.uint64(episode),
            np.uint64(purpose << 32),
            key_low,
            key_high,
        )
        for k in range(4):
            uniform[8 * block + 2 * k], uniform[8 * block + 2 * k + 1] = uniform_pair(words[k])


@njit
def _choice(distribution, first, length, uniform):
    """Index of the first cumulative share above the uniform number."""
    for k in range(length):
        if uniform < distribution[first + k]:
            return k
    return length - 1


@njit
def _choice_of(distribution, own, kind, uniform):
    """Index of a kind of fault of one kind of actuator, by their weights; ``kind`` if these are 0."""
    first, total, below = table.KIND_CUMULATIVE, 0.0, 0.0
    for k in range(_KINDS):
        if _own(k + 1) == own:
            total += distribution[first + k] - (distribution[first + k - 1] if k > 0 else 0.0)
    for k in range(_KINDS):
        if _own(k + 1) == own:
            weight = distribution[first + k] - (distribution[first + k - 1] if k > 0 else 0.0)
            below += weight
            if weight > 0.0 and uniform * total < below:
                return k
    return kind


@njit
def _actuator(rows, distribution, thrusters, kind, craft, used, uniform):
    """Index of an actuator that may have that kind of fault and has none yet, all equally likely.

    -1 if there is none.
    """
    own, listed, number = _own(kind), 0, thrusters
    if own == _WHEEL:
        number = int(distribution[table.WHEELS])
    elif own == _GYRO:
        number = int(distribution[table.GYROS])
    else:
        listed = int(distribution[table.NUMBER_OF_CHOICES])
        number = listed if listed > 0 else thrusters
    candidates = np.empty(max(number, 1), np.int64)
    free = 0
    for k in range(number):
        actuator = int(distribution[table.FIRST_CHOICE + k]) if listed > 0 else k
        taken = False
        for slot in range(used):
            same = _own(rows[craft, slot, code.FIELD_KIND]) == own
            taken |= same and rows[craft, slot, code.FIELD_THRUSTER] == actuator
        if not taken:
            candidates[free] = actuator
            free += 1
    return candidates[int(uniform * free)] if free > 0 else -1


_THRUSTER, _WHEEL, _GYRO, _ACTUATORS = range(4)


@njit
def _own(kind):
    """Of which kind of actuator a kind of fault is, by its code."""
    if kind < code.WHEEL_TORQUE_LOSS:
        return _THRUSTER
    return _WHEEL if kind < code.GIMBAL_RATE_LOSS else _GYRO
