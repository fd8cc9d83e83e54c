"""One control period of a batch of craft whose thrusters stand behind a modulator.

Models one pulse per thruster and period, put off by the delay of the modulator: nominal, with a sine common
to the thrusters of a craft and an error of each pulse (:class:`~thruster_envs.spacecraft.Modulator`), so that
a pulse may lie in the periods after that of its command. Pulses that overlap are one. The thrust follows the
opening ``g`` of the valve with a first-order lag, ``time_constant q' = g - q``; an isolation valve that is
closed stops ``g``, whatever is wrong with the thruster. Faults act on ``g``, on the lag, on the delay, on the
commanded on-time or on the thrust, as :mod:`.health` has it. There is a constant acceleration
beside the thrust, held for the period, for whatever else disturbs a craft.

No thruster feels another one, so a period needs no corners: with the lag, the impulse of a thruster over a
sub-step and its first moment are closed forms of the pulses and of the levels at both ends. The craft moves,
sub-step by sub-step, under the wrench that is a straight line in time of the same impulse and the same first
moment. So impulses are exact whatever the sub-step, and so is the motion but for how far the craft turns in
one. A thruster with a fault that begins, ends or varies in a sub-step is followed corner by corner, its
thrust integrated by Gauss and Legendre's rule.

Leaves out the shared feed, linear ramps of the valves (a spacecraft with a modulator has neither), pulses
that a fault makes overtake each other, and depletion inside a period. A thruster is as slow or as late in a
period as at its start. What a misalignment turns is the nominal thrust, whatever stands in ``columns``.

Source: Fonod, Henry, Charbonnel, Bornschlegl 2013, "Robust thruster fault diagnosis: application to the
rendezvous phase of the Mars Sample Return mission", sections 2 and 4.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.body import (
    equal_substeps,
    freeze_lost,
    load_state,
    store_state,
    substep,
)
from thruster_envs.physics.borrowed import borrow, keep
from thruster_envs.physics.expectation import time_in_period
from thruster_envs.physics.sensing import SIGHT_ROWS, draw_words, expected_change, look, word_rows
from thruster_envs.physics.storage import (
    StorageWork,
    load_storage,
    state_rows,
    storage_arrays,
    storage_work,
    store_storage,
    substep_stored,
)
from thruster_envs.physics.vehicle import open_batch, open_vehicle
from thruster_envs.random import VALVES, cos_sin_turns, philox, uniform_pair

FloatArray = NDArray[np.float64]

# Groups of rows of one pulse: opening and closing, s of the period, and the on-time that was commanded, s.
_OPENS, _CLOSES, _ON_TIME, _PULSE = range(4)
# Per-thruster groups of rows of the valves. Level of the thrust now and at the start of the sub-step, 1 over
# the time constant, strength by scatter, nominal on-time of the period, delivered on-time of it; what faults
# make of a command g, namely an opening of ``floor + slope g`` and a thrust multiplied by ``gain``; how the
# faults go with time; 0 if its isolation valve is closed, else 1; then impulse over nominal thrust and first
# moment of it in the sub-step, s and s^2, of the flow and of the thrust, and the time for which the valve was
# open.
(
    _LEVEL, _BEFORE, _RATE, _STRENGTH, _NOMINAL, _DELIVERED, _FLOOR, _SLOPE, _GAIN, _FAULTY, _FED,
    _FLOW_0, _FLOW_1, _THRUST_0, _THRUST_1, _OPEN, _VALVE_GROUPS,
) = range(17)  # fmt: skip
#: How the faults of a thruster go with time within a period.
_STEADY, _CHANGING = 1.0, 2.0
# Rows of the impulse in a sub-step and then of its first moment: body wrench, mass.
_WRENCH, _MASS_FLOW, _MOMENT, _SUMS = 0, 6, 7, 14
# Rows of the scratch of a valve: time open, its first moment, what it adds to the level, end of the pulse.
_TIME, _TIME_MOMENT, _RISE, _CURSOR, _SCRATCH = range(5)
# Rows of the clock: start of the sub-step, s of the period; its length, s, 0 for a craft that waits for its
# neighbours; number of the sub-steps of a craft, and the length of each of them, s.
_START, _H, _COUNT, _EACH, _CLOCK = range(5)


class _Work(NamedTuple):
    """Scratch of one block, (rows, lanes) each but for the corners, which are those of one thruster."""

    words: NDArray[np.uint64]
    pulses: FloatArray
    valves: FloatArray
    columns: FloatArray
    state: FloatArray
    sums: FloatArray
    scratch: FloatArray
    clock: FloatArray
    sight: FloatArray
    corners: FloatArray
    storage: StorageWork | None


def compile_period(lanes: int) -> Any:
    """The kernel that flies craft behind a modulator, in blocks of ``lanes`` craft.

    As :mod:`thruster_envs.physics.period` has it. Closed isolation valves and the
    acceleration beside the thrust stand in ``data``, in the rows that :class:`.rows.Rows` names.
    """

    @kernel(nogil=True)
    def fly_period(arrays, parts, move, first, last):
        batch, vehicle = open_batch(arrays), open_vehicle(parts)
        n, count = vehicle.rows.thrusters, vehicle.rows.carried + 1
        words, owned = np.zeros((word_rows(n), lanes), np.uint64), (
            np.zeros((_PULSE * count * n, lanes)),
            np.zeros((_VALVE_GROUPS * n, lanes)),
            np.zeros((6 * n, lanes)),
            np.zeros((state_rows(vehicle.storage, vehicle.rows), lanes)),
            np.zeros((_SUMS, lanes)),
            np.zeros((_SCRATCH, lanes)),
            np.zeros((_CLOCK, lanes)),
            np.zeros((SIGHT_ROWS, lanes)),
            np.zeros((2 * count + 4 * batch.faults.shape[2], 1)),
        )  # fmt: skip
        stored = storage_arrays(vehicle.rows, lanes)
        work = _Work(
            borrow(words), borrow(owned[0]), borrow(owned[1]), borrow(owned[2]), borrow(owned[3]),
            borrow(owned[4]), borrow(owned[5]), borrow(owned[6]), borrow(owned[7]), borrow(owned[8]),
            storage_work(vehicle.storage, stored),
        )  # fmt: skip
        for b in range(first, last):
            _fly_block(b, batch, vehicle, move, work)
        keep((words, owned, stored))

    return fly_period


@kernel
def draw_phases(data, streams, which, craft, row):
    """Draw the phase of the modulator's sine, in turns, for the craft of the worlds ``which``."""
    lanes = data.shape[2]
    for k in range(which.shape[0]):
        for c in range(craft):
            b, w = (which[k] * craft + c) // lanes, (which[k] * craft + c) % lanes
            data[b, row, w] = uniform_pair(_valve_words(b, w, streams, 0xFFFFFFFF, 0)[0])[0]


@njit(forceinline=True)
def _cut(b, data, vehicle, move, state, clock):
    """Into how many equal sub-steps each craft cuts the period; returns the most of them."""
    most, fewest, period = 0, vehicle.modulator.substeps, vehicle.constants.period
    for w in range(state.shape[1]):
        count = equal_substeps(b, w, data, state, period, fewest, vehicle.constants) if move else fewest
        clock[_COUNT, w], clock[_EACH, w] = count, period / count
        most = int(count) if count > most else most
    return most


@njit(forceinline=True)
def _valve_words(b, w, streams, block, step):
    """Four random words of a craft for its modulator."""
    return philox(
        np.uint64(block), np.uint64(step), streams[b, at.EPISODE, w],
        streams[b, at.CRAFT, w] | np.uint64(VALVES << 32),
        streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
    )  # fmt: skip


@njit(inline="always")
def _fly_block(b, batch, vehicle, move, work):
    data, faults, rows, period = batch.data, batch.faults, vehicle.rows, vehicle.constants.period
    clock, valves, sums, state = work.clock, work.valves, work.sums, work.state
    n, lanes = rows.thrusters, state.shape[1]
    load_state(b, data, work.columns, vehicle, state, lanes)
    load_storage(b, batch, vehicle, vehicle.storage, work.storage, state)
    _command_valves(b, batch, vehicle, work.pulses, valves)
    draw_words(b, batch, work.words, n, lanes)
    _set_strengths(vehicle, work.words, state, valves)
    changing = False
    for w in range(lanes):
        for k in range(faults.shape[2]):
            if health.is_there(faults[b, w, k]):
                changing |= _strike(b, w, batch, vehicle, work)
                break
    for i in range(n):
        for w in range(lanes):
            flows = 1.0 - data[b, rows.inhibited + i, w]
            valves[_FLOOR * n + i, w] *= flows
            valves[_SLOPE * n + i, w] *= flows
            valves[_FED * n + i, w] = flows
            valves[_NOMINAL * n + i, w] *= flows
    for k in range(6):
        for w in range(lanes):
            data[b, at.IMPULSE + k, w] = 0.0
    for s in range(_cut(b, data, vehicle, move, state, clock)):
        for w in range(lanes):
            clock[_H, w] = clock[_EACH, w] if s < clock[_COUNT, w] else 0.0
            clock[_START, w] = s * clock[_EACH, w] if s < clock[_COUNT, w] else period
        _follow_valves(rows, work)
        _sum_thrusters(vehicle.thrusters, work.columns, valves, sums)
        if changing:
            for w in range(lanes):
                start = data[b, at.STEP, w] * period + clock[_START, w]
                for i in range(n):
                    if valves[_FAULTY * n + i, w] == _CHANGING and clock[_H, w] > 0.0:
                        _follow_changes(b, w, i, faults, start, vehicle, work)
        for i in range(n):
            for w in range(lanes):
                valves[_DELIVERED * n + i, w] += valves[_THRUST_0 * n + i, w]
                data[b, at.OPEN_TIME, w] += valves[_OPEN * n + i, w]
        for k in range(6):
            for w in range(lanes):
                data[b, at.IMPULSE + k, w] += sums[k, w]
        if move:
            _move(b, batch, vehicle, vehicle.storage, work)
    _store(b, data, vehicle, work.pulses, valves)
    if move:
        freeze_lost(b, data, state, work.sight[0], lanes)
        store_state(b, data, vehicle, state, 0, lanes)
        expected_change(b, data, vehicle, 0.0, valves, _NOMINAL * n, work.sight, lanes)
        store_storage(b, data, vehicle, vehicle.storage, work.storage, state)
        look(b, data, vehicle, work.words, state, work.sight, lanes)


@njit(forceinline=True)
def _command_valves(b, batch, vehicle, pulses, valves):
    """The pulses that are still to come, the one that is commanded now, and the nominal on-times."""
    data, streams, rows, modulator = batch.data, batch.streams, vehicle.rows, vehicle.modulator
    thrusters, n, lanes, period = vehicle.thrusters, rows.thrusters, pulses.shape[1], vehicle.constants.period
    count, newest = rows.carried + 1, _PULSE * rows.carried * n
    for k in range(newest):
        for w in range(lanes):
            pulses[k, w] = data[b, rows.pending + k, w]
    # The errors of the delays, -1..1, wait in the rows of the openings.
    for block in range((n + 7) // 8):
        for w in range(lanes):
            four = _valve_words(b, w, streams, block, np.int64(data[b, at.STEP, w]))
            for k in range(4):
                i = 8 * block + 2 * k
                first, second = uniform_pair(four[k])
                if i < n:
                    pulses[newest + _OPENS * n + i, w] = 2.0 * first - 1.0
                if i + 1 < n:
                    pulses[newest + _OPENS * n + i + 1, w] = 2.0 * second - 1.0
    for w in range(lanes):
        turns = data[b, at.STEP, w] * period * modulator.frequency + data[b, rows.phase, w]
        sine = cos_sin_turns(turns - math.floor(turns))[1]
        valves[_NOMINAL * n, w] = modulator.delay + modulator.variation * sine
    common = _NOMINAL * n
    for i in range(n - 1, -1, -1):
        minimum = thrusters.minimum_pulse[i]
        later, longer = thrusters.opening_delay[i], thrusters.closing_delay[i]
        nominal = modulator.delay + later + 1.0 / thrusters.lag_rate[i]
        for w in range(lanes):
            on_time = data[b, rows.duties + i, w] * period
            on_time = on_time if on_time >= minimum else 0.0
            begins = valves[common, w] + modulator.jitter * pulses[newest + _OPENS * n + i, w]
            opens = begins + later
            closes = begins + on_time + longer if on_time > 0.0 else opens
            pulses[newest + _OPENS * n + i, w] = opens
            pulses[newest + _CLOSES * n + i, w] = closes if closes > opens else opens
            pulses[newest + _ON_TIME * n + i, w] = on_time
            valves[_LEVEL * n + i, w] = data[b, rows.level + i, w]
            valves[_RATE * n + i, w] = thrusters.lag_rate[i]
            valves[_FLOOR * n + i, w], valves[_SLOPE * n + i, w] = 0.0, 1.0
            valves[_GAIN * n + i, w], valves[_FAULTY * n + i, w] = 1.0, 0.0
            valves[_DELIVERED * n + i, w] = 0.0
        for w in range(lanes):
            valves[_STRENGTH * n + i, w] = 0.0
        for p in range(count):
            age = (count - 1 - p) * period
            for w in range(lanes):
                begin = nominal - age
                end = begin + pulses[(_PULSE * p + _ON_TIME) * n + i, w] + longer - later
                valves[_STRENGTH * n + i, w] += time_in_period(begin, end, period)
        for w in range(lanes):
            # The first thruster comes last: until then its row holds the delay common to all.
            valves[_NOMINAL * n + i, w] = valves[_STRENGTH * n + i, w]


@njit(forceinline=True)
def _set_strengths(vehicle, words, state, valves):
    """Strength of each thruster in this period: its scatter, and none without propellant."""
    n, lanes = vehicle.rows.thrusters, state.shape[1]
    for i in range(n):
        scatter = vehicle.thrusters.scatter[i]
        for w in range(lanes):
            first, second = uniform_pair(words[6 + i // 2, w])
            strength = 1.0 + scatter * (2.0 * (first if i % 2 == 0 else second) - 1.0)
            valves[_STRENGTH * n + i, w] = strength if state[at.MASS, w] > vehicle.constants.dry_mass else 0.0


@njit
def _strike(b, w, batch, vehicle, work):
    """Let the faults of a craft act on its thrusters for a period, those that change within it apart.

    Returns whether there are such.
    """
    faults, period, pulses, valves, columns = (
        batch.faults, vehicle.constants.period, work.pulses, work.valves, work.columns,
    )  # fmt: skip
    n, newest, changing = vehicle.rows.thrusters, _PULSE * vehicle.rows.carried, False
    start = batch.data[b, at.STEP, w] * period
    middle = start + 0.5 * period
    for k in range(faults.shape[2]):
        fault = faults[b, w, k]
        if not health.is_within(fault, start, start + period):
            continue
        if health.acts_on_commands(fault):
            _lengthen(b, w, fault, batch, vehicle, pulses)
        else:
            steady = health.is_steady(fault, start, period)
            changing |= not steady
            row = _FAULTY * n + health.thruster_of(fault)
            valves[row, w] = max(valves[row, w], _STEADY if steady else _CHANGING)
    for k in range(faults.shape[2]):
        delay, lag, _ = health.command_error(faults[b, w, k], start)
        i = health.thruster_of(faults[b, w, k])
        if delay > 0.0:
            opens, closes = (newest + _OPENS) * n + i, (newest + _CLOSES) * n + i
            pulses[opens, w] = min(pulses[opens, w] + delay, pulses[closes, w])
        if lag > 0.0:
            valves[_RATE * n + i, w] = 1.0 / (1.0 / valves[_RATE * n + i, w] + lag)
    for i in range(n):
        if valves[_FAULTY * n + i, w] == _STEADY:
            floor, slope, gain = health.health_at(faults[b, w], i, middle, middle, None)
            valves[_FLOOR * n + i, w], valves[_SLOPE * n + i, w] = floor, slope
            valves[_GAIN * n + i, w] = gain
            for k in range(faults.shape[2]):
                if _tilts(faults[b, w, k], i, middle):
                    health.tilt_columns(faults[b, w, k], middle, columns, w)
    return changing


@njit
def _lengthen(b, w, fault, batch, vehicle, pulses):
    """Let the pulse commanded now last as long as what faults add to its duty makes it."""
    rows, thrusters, n, period = (
        vehicle.rows,
        vehicle.thrusters,
        vehicle.rows.thrusters,
        vehicle.constants.period,
    )
    start = batch.data[b, at.STEP, w] * period
    if health.command_error(fault, start)[2] > 0.0:
        n, i, newest = rows.thrusters, health.thruster_of(fault), _PULSE * rows.carried
        opens, closes = (newest + _OPENS) * n + i, (newest + _CLOSES) * n + i
        duty = batch.data[b, rows.duties + i, w]
        on_time = health.biased_duty(batch.faults[b, w], i, start, duty, None) * period
        on_time = on_time if on_time >= thrusters.minimum_pulse[i] else 0.0
        longer = on_time + thrusters.closing_delay[i] - thrusters.opening_delay[i]
        pulses[closes, w] = pulses[opens, w] + (max(longer, 0.0) if on_time > 0.0 else 0.0)


@njit
def _tilts(fault, i, t):
    """Whether a fault tilts thruster ``i`` (from 0) at ``t``, s of the episode."""
    return health.tilts(fault) and health.thruster_of(fault) == i and health.is_active(fault, t)


@njit(forceinline=True)
def falling(x):
    """``exp(-x)`` for ``x`` of 0 or more, to rounding; without branches, so that it vectorises."""
    x = x if x < 700.0 else 700.0
    k = math.floor(1.4426950408889634 * x + 0.5)
    r = (0.693147180369123816490 * k - x) + 1.90821492927058770002e-10 * k
    series = 1.0 + r * (1.0 + 1 / 2 * r * (1.0 + 1 / 3 * r * (1.0 + 1 / 4 * r * (1.0 + 1 / 5 * r * (
        1.0 + 1 / 6 * r * (1.0 + 1 / 7 * r * (1.0 + 1 / 8 * r * (1.0 + 1 / 9 * r * (1.0 + 1 / 10 * r * (
            1.0 + 1 / 11 * r * (1.0 + 1 / 12 * r * (1.0 + 1 / 13 * r)))))))))
    )))  # fmt: skip
    # The sum with 1.5 * 2**52 has the whole number 1023 - k in its last bits, the exponent of 2**-k.
    bits = np.float64(6755399441055744.0 + (1023.0 - k)).view(np.int64) << 52
    return series * np.int64(bits).view(np.float64)


@njit(forceinline=True)
def _follow_valves(rows, work):
    """Impulse and first moment of every thruster over the sub-step of each craft, by its pulses.

    The lag turns the time open and its moment, ``G0`` and ``G1``, into those of the level, ``Q0 = G0 - tau
    (q1 - q0)`` and ``Q1 = G1 - tau (h q1 - Q0)``, with the levels ``q0`` and ``q1`` at both ends.
    """
    pulses, clock, valves, scratch = work.pulses, work.clock, work.valves, work.scratch
    n, count, lanes = rows.thrusters, rows.carried + 1, valves.shape[1]
    for i in range(n):
        for k in range(_SCRATCH):
            for w in range(lanes):
                scratch[k, w] = 0.0
        rate_row = _RATE * n + i
        for p in range(count):
            opens_row, closes_row = (_PULSE * p + _OPENS) * n + i, (_PULSE * p + _CLOSES) * n + i
            for w in range(lanes):
                before, h = clock[_START, w], clock[_H, w]
                start, end = pulses[opens_row, w] - before, pulses[closes_row, w] - before
                start = start if start > scratch[_CURSOR, w] else scratch[_CURSOR, w]
                start = start if start < h else h
                end = end if end > start else start
                end = end if end < h else h
                rate = valves[rate_row, w]
                scratch[_TIME, w] += end - start
                scratch[_TIME_MOMENT, w] += 0.5 * (end - start) * (end + start)
                scratch[_RISE, w] += falling((h - end) * rate) - falling((h - start) * rate)
                scratch[_CURSOR, w] = end
        for w in range(lanes):
            h = clock[_H, w]
            floor, slope, rate = valves[_FLOOR * n + i, w], valves[_SLOPE * n + i, w], valves[rate_row, w]
            level, kept = valves[_LEVEL * n + i, w], falling(h * rate)
            opened = floor * h + slope * scratch[_TIME, w]
            moment = 0.5 * floor * h * h + slope * scratch[_TIME_MOMENT, w]
            after = level * kept + floor * (1.0 - kept) + slope * scratch[_RISE, w]
            lag = 1.0 / rate
            flow = opened - lag * (after - level)
            flow_moment = moment - lag * (h * after - flow)
            strength = valves[_STRENGTH * n + i, w]
            valves[_BEFORE * n + i, w], valves[_LEVEL * n + i, w] = level, after
            valves[_OPEN * n + i, w] = opened
            valves[_FLOW_0 * n + i, w], valves[_FLOW_1 * n + i, w] = strength * flow, strength * flow_moment
            gain = valves[_GAIN * n + i, w]
            valves[_THRUST_0 * n + i, w] = gain * (strength * flow)
            valves[_THRUST_1 * n + i, w] = gain * (strength * flow_moment)


@njit(forceinline=True)
def _sum_thrusters(thrusters, columns, valves, sums):
    """Body impulse, mass that has flown out, and their first moments; thrusters are taken four at a time."""
    n, lanes = thrusters.thrust.shape[0], sums.shape[1]
    fours = n - n % 4
    for k in range(_SUMS):
        for w in range(lanes):
            sums[k, w] = 0.0
    for moment in range(2):
        row, thrust, flow = _MOMENT * moment, (_THRUST_0 + moment) * n, (_FLOW_0 + moment) * n
        for i in range(0, fours, 4):
            t, c = thrust + i, 6 * i
            for k in range(6):
                for w in range(lanes):
                    sums[row + k, w] += (
                        valves[t, w] * columns[c + k, w] + valves[t + 1, w] * columns[c + 6 + k, w]
                    ) + (
                        valves[t + 2, w] * columns[c + 12 + k, w] + valves[t + 3, w] * columns[c + 18 + k, w]
                    )
        for i in range(fours, n):
            for k in range(6):
                for w in range(lanes):
                    sums[row + k, w] += valves[thrust + i, w] * columns[6 * i + k, w]
        for i in range(n):
            flow_per_thrust = thrusters.thrust[i] * thrusters.flow_per_thrust[i]
            for w in range(lanes):
                sums[row + _MASS_FLOW, w] += flow_per_thrust * valves[flow + i, w]


#: Longest part of a sub-step in which a fault that varies is followed at once, s, and most parts of a piece.
_PART, _MOST_PARTS = 0.01, 64.0
#: Nodes and weights of Gauss and Legendre's rule on 0..1 with five nodes, and the first node of the one with
#: two.
_NODES = tuple(0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0])
_WEIGHTS = tuple(0.5 * np.polynomial.legendre.leggauss(5)[1])
_GAUSS = 0.5 - 0.5 / math.sqrt(3.0)


@njit
def _follow_changes(b, w, i, faults, start, vehicle, work):
    """Take thruster ``i`` of one craft out of the sums, and put it in as its changing faults make it.

    Between the corners of its pulses and faults, in parts in which the opening is taken as a straight line,
    so that the lag has a closed form; ``start``, s of the episode, is where the sub-step begins.
    """
    thrusters, n = vehicle.thrusters, vehicle.rows.thrusters
    pulses, valves, columns, sums = work.pulses, work.valves, work.columns, work.sums
    count, before, h = vehicle.rows.carried + 1, work.clock[_START, w], work.clock[_H, w]
    rate, strength = valves[_RATE * n + i, w], valves[_STRENGTH * n + i, w]
    flow_per_thrust = thrusters.thrust[i] * thrusters.flow_per_thrust[i]
    _add_thruster(w, i, flow_per_thrust, -1.0, n, valves, columns, sums)
    lag, level, fed = 1.0 / rate, valves[_BEFORE * n + i, w], valves[_FED * n + i, w]
    used, corners = _sorted_corners(b, w, i, faults, start, vehicle.rows, work), work.corners
    flow_0, flow_1, thrust_0, thrust_1, opened, a = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(used + 1):
        end = corners[c, 0] if c < used else h
        piece = end - a
        if not piece > 0.0:
            continue
        parts = math.ceil(piece * max(1.0 / _PART, min(rate, _MOST_PARTS / piece)))
        length = piece / parts
        within = start + a + 0.5 * piece
        commanded = _is_open(w, i, pulses, count, n, before + a + 0.5 * piece)
        for part in range(int(parts)):
            left = a + part * length
            f_1, s_1, _ = health.health_at(faults[b, w], i, start + left + _GAUSS * length, within, None)
            f_2, s_2, _ = health.health_at(
                faults[b, w], i, start + left + (1.0 - _GAUSS) * length, within, None
            )
            g_1, g_2 = fed * (f_1 + s_1 * commanded), fed * (f_2 + s_2 * commanded)
            bend = (g_2 - g_1) / (1.0 - 2.0 * _GAUSS)  # over the whole part
            first = g_1 - _GAUSS * bend
            behind = first - bend / length * lag
            opened += 0.5 * (g_1 + g_2) * length
            for k in range(5):
                since = _NODES[k] * length
                at_node = behind + bend * _NODES[k] + (level - behind) * falling(since * rate)
                t = start + left + since
                gain = health.health_at(faults[b, w], i, t, within, None)[2]
                share = strength * _WEIGHTS[k] * length * at_node
                flow_0 += share
                flow_1 += share * (left + since)
                thrust_0 += gain * share
                thrust_1 += gain * share * (left + since)
                _tilt(b, w, i, faults, within, t, gain * share, left + since, columns, sums)
            level = behind + bend + (level - behind) * falling(length * rate)
        a = end
    valves[_LEVEL * n + i, w], valves[_OPEN * n + i, w] = level, opened
    valves[_FLOW_0 * n + i, w], valves[_FLOW_1 * n + i, w] = flow_0, flow_1
    valves[_THRUST_0 * n + i, w], valves[_THRUST_1 * n + i, w] = thrust_0, thrust_1
    _add_thruster(w, i, flow_per_thrust, 1.0, n, valves, columns, sums)


@njit
def _add_thruster(w, i, flow_per_thrust, sign, n, valves, columns, sums):
    """Add one thruster of one craft to the sums, or take it out with ``sign`` -1."""
    for moment in range(2):
        row = _MOMENT * moment
        for k in range(6):
            sums[row + k, w] += sign * valves[(_THRUST_0 + moment) * n + i, w] * columns[6 * i + k, w]
        sums[row + _MASS_FLOW, w] += sign * flow_per_thrust * valves[(_FLOW_0 + moment) * n + i, w]


@njit
def _tilt(b, w, i, faults, within, t, share, since, columns, sums):
    """Add what the misalignments of thruster ``i`` turn a share of its impulse by, at ``t``."""
    for k in range(faults.shape[2]):
        if _tilts(faults[b, w, k], i, within):
            tilt = health.severity(faults[b, w, k], t)
            along, across = math.cos(tilt) - 1.0, math.sin(tilt)
            for c in range(6):
                turned = share * (
                    along * columns[6 * i + c, w] + across * faults[b, w, k, at.FAULT_TILTED + c]
                )
                sums[c, w] += turned
                sums[_MOMENT + c, w] += turned * since


@njit
def _sorted_corners(b, w, i, faults, start, rows, work):
    """Write the corners of thruster ``i`` into ``corners`` (rows, 1), s of the sub-step, and say how many."""
    pulses, corners, before, h = work.pulses, work.corners, work.clock[_START, w], work.clock[_H, w]
    n, count, used = rows.thrusters, rows.carried + 1, 0
    for p in range(count):
        for group in (_OPENS, _CLOSES):
            corners[used, 0] = min(max(pulses[(_PULSE * p + group) * n + i, w] - before, 0.0), h)
            used += 1
    for k in range(faults.shape[2]):
        if health.thruster_of(faults[b, w, k]) == i:
            for corner in health.fault_corners(faults[b, w, k], start, h):
                corners[used, 0] = corner
                used += 1
    for k in range(1, used):
        corner, place = corners[k, 0], k
        while place > 0 and corners[place - 1, 0] > corner:
            corners[place, 0] = corners[place - 1, 0]
            place -= 1
        corners[place, 0] = corner
    return used


@njit
def _is_open(w, i, pulses, count, n, t):
    """1.0 if a pulse opens thruster ``i`` at ``t``, s of the period, else 0.0."""
    for p in range(count):
        if pulses[(_PULSE * p + _OPENS) * n + i, w] <= t < pulses[(_PULSE * p + _CLOSES) * n + i, w]:
            return 1.0
    return 0.0


@njit(forceinline=True)
def _move(b, batch, vehicle, storage, work):
    """One sub-step of every craft of a block, under straight lines of the same impulse and first moment."""
    clock, sums, state = work.clock, work.sums, work.state
    lanes, body, data, push = state.shape[1], vehicle.body, batch.data, vehicle.rows.push
    for k in range(_MOMENT):
        for w in range(lanes):
            h = clock[_H, w] if clock[_H, w] > 0.0 else 1.0  # one that waits has no impulse
            mean = sums[k, w] / h
            sums[_MOMENT + k, w] = 6.0 * (sums[_MOMENT + k, w] / (h * h) - 0.5 * mean)
            sums[k, w] = mean
    if storage is None:
        for w in range(lanes):
            forces, torques, flows = _loads(sums, w)
            beside = (data[b, push, w], data[b, push + 1, w], data[b, push + 2, w])
            substep(state, w, clock[_H, w], body, forces, torques, flows, beside)
    else:
        for w in range(lanes):
            forces, torques, flows = _loads(sums, w)
            beside = (data[b, push, w], data[b, push + 1, w], data[b, push + 2, w])
            substep_stored(
                b, w, batch, vehicle, storage, work.storage, state, clock[_H, w],
                (forces, torques, flows, beside),
            )  # fmt: skip


@njit(forceinline=True)
def _loads(sums, w):
    """Forces, torques and flows at the start, middle and end of a sub-step."""
    f = (sums[0, w], sums[1, w], sums[2, w])
    df = (sums[7, w], sums[8, w], sums[9, w])
    t = (sums[3, w], sums[4, w], sums[5, w])
    dt = (sums[10, w], sums[11, w], sums[12, w])
    flow, change = sums[_MASS_FLOW, w], sums[_MOMENT + _MASS_FLOW, w]
    return (
        ((f[0] - df[0], f[1] - df[1], f[2] - df[2]), f, (f[0] + df[0], f[1] + df[1], f[2] + df[2])),
        ((t[0] - dt[0], t[1] - dt[1], t[2] - dt[2]), t, (t[0] + dt[0], t[1] + dt[1], t[2] + dt[2])),
        (flow - change, flow, flow + change),
    )  # fmt: skip


@njit(forceinline=True)
def _store(b, data, vehicle, pulses, valves):
    """What the period left behind: delivered on-times, levels, and the pulses that are still to come."""
    rows, period, n, lanes = vehicle.rows, vehicle.constants.period, vehicle.rows.thrusters, valves.shape[1]
    for i in range(n):
        for w in range(lanes):
            data[b, rows.delivered + i, w] = valves[_DELIVERED * n + i, w]
            data[b, rows.level + i, w] = valves[_LEVEL * n + i, w]
    for p in range(rows.carried):
        for k in range(2 * n):
            for w in range(lanes):
                data[b, rows.pending + _PULSE * p * n + k, w] = pulses[_PULSE * (p + 1) * n + k, w] - period
        for k in range(2 * n, 3 * n):
            for w in range(lanes):
                data[b, rows.pending + _PULSE * p * n + k, w] = pulses[_PULSE * (p + 1) * n + k, w]
    for w in range(lanes):
        data[b, at.STEP, w] += 1.0
