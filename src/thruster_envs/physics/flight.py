"""One control period of a batch of craft: thrusters fire, the craft fly, the sensors look.

The compiled core of every environment.

Models what :mod:`.firing`, :mod:`.attitude` and :mod:`.orbits` model, together: any number of
thrusters on a rigid body on a relative orbit, mass depletion included (the inertia matrix and the centre of
mass stay where they are). Each piece between two corners of the thrust is integrated in equal sub-steps, as
many as the turning of the craft needs or none longer than a given length: RK4 for position, velocity and
rate, a fourth-order Magnus step for the attitude, with the body wrench a quadratic in time. The impulse of a
pulse is Simpson's sum of that quadratic over its pieces, hence exact and the same whatever the sub-step.

Craft are processed in blocks whose innermost axis is the craft, so that the arithmetic vectorises. Every lane
of a block does what it would do alone, to the last bit, whatever its neighbours need: they may add pieces of
zero length, which change nothing.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import firing, health
from thruster_envs.physics import rows as at
from thruster_envs.physics.attitude import symmetric_product
from thruster_envs.physics.body import (
    MOST_SUBSTEPS,
    STORED,
    fastest_rate,
    freeze_lost,
    load_state,
    put_in_places,
    simpson,
    size,
    store_state,
    substep,
    substep_rate,
    take_from_places,
)
from thruster_envs.physics.borrowed import borrow, keep
from thruster_envs.physics.expectation import fire_nominal
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
from thruster_envs.random import uniform_pair

FloatArray = NDArray[np.float64]

# Rows of the sums over thrusters at a node (start, middle, end) of a piece: body wrench, flow, open valves.
_WRENCH, _FLOW, _OPEN, _SUMS = 0, 6, 7, 8
# Rows of the clock of a piece.
(
    _BEFORE, _LENGTH, _START, _PIECE, _PARTS, _WAVES, _CHANGES, _COMMANDED, _UNTIL, _SPIN, _RATE, _MASS,
    _SPIN_UP, _DRAIN, _TURNS, _COUNT, _EXTRA, _CLOCK,
) = range(18)  # fmt: skip
#: Craft that a vector holds: those of a block are put in order by their rates, so that a vector of them is
#: done when the slowest of its craft needs no more sub-steps.
_VECTOR = 8
#: From how many sub-steps of the fastest craft on that pays.
_MANY_SUBSTEPS = 4.0
#: Most rows of the schedule beside one for each corner; what finds no room waits until these are flown.
_ROOM = 512
# Rows of one entry of the schedule, which is a piece: length and number of its sub-steps, then force, torque
# and mass flow at its start, middle and end.
_H, _STEPS, _FIRST, _LOAD, _ENTRY = 0, 1, 2, 7, 23
# Rows of what acts now: the length of the sub-step, then force, torque and mass flow at its start, middle and
# end. Rows of the piece that they are of, where they change within it: the same, then one over the number of
# its sub-steps, and how many are done.
_NOW, _SHARE, _DONE, _OF_PIECE = 22, 21, 22, 23
#: Sub-steps that are left of a piece that does not exist.
_NONE_LEFT = 2**62
# Per-thruster groups of rows of the valves: command and carry-over, true strength, nominal duration.
_OPENS, _CLOSES, _STRENGTH, _LEVEL, _TAIL, _NOMINAL, _DELIVERED, _RUN, _VALVE_GROUPS = range(9)
# Per-thruster groups of rows of the nodes (start, middle, end of a piece): opening, thrust as a share of
# nominal, and what faults make of a valve level q, namely an opening of ``floor + slope q`` and a thrust
# multiplied by ``gain``.
_OPENING, _THRUST, _FLOOR, _SLOPE, _GAIN, _NODE_GROUPS = 0, 3, 6, 9, 12, 15


class _Work(NamedTuple):
    """Scratch of one block, (rows, lanes) each: what the constants above number the rows of.

    ``lanes`` is their number once more, as a number that is not known when a kernel for many is compiled:
    loops over it are then vectorised, and not unrolled before they could be.
    """

    lanes: int
    corners: FloatArray
    valves: FloatArray
    nodes: FloatArray
    columns: FloatArray
    state: FloatArray
    sums: FloatArray
    impulse: FloatArray
    clock: FloatArray
    schedule: FloatArray
    now: FloatArray
    piece: FloatArray
    moving: FloatArray
    sight: FloatArray
    words: NDArray[np.uint64]
    places: NDArray[np.int64]
    steps: NDArray[np.int64]
    entries: NDArray[np.int64]
    totals: NDArray[np.int64]
    entry: NDArray[np.int64]
    left: NDArray[np.int64]
    storage: StorageWork | None


def compile_period(lanes: int) -> Any:
    """The kernel that flies craft whose valves follow their commands, in blocks of ``lanes`` craft.

    As :mod:`thruster_envs.physics.period` has it.
    """

    @kernel(nogil=True)
    def fly_period(arrays, parts, move, first, last):
        batch, vehicle = open_batch(arrays), open_vehicle(parts)
        n, slots, constants = vehicle.rows.thrusters, batch.faults.shape[2], vehicle.constants
        of_valve = firing.CORNERS if vehicle.valves.dynamic is None else firing.CORNERS_WITH_DYNAMICS
        corners = of_valve * n + firing.FAULT_CORNERS * slots
        # Rows of a schedule: beside one for each corner,
        room = int(min(2.0 * constants.period / constants.short_substep, _ROOM)) + 2
        owned = (
            np.zeros((corners, lanes)),
            np.zeros((_VALVE_GROUPS * n, lanes)),
            np.zeros((_NODE_GROUPS * n, lanes)),
            np.zeros((6 * n, lanes)),
            np.zeros((state_rows(vehicle.storage, vehicle.rows), lanes)),
            np.zeros((3 * _SUMS, lanes)),
            np.zeros((_SUMS, lanes)),
            np.zeros((_CLOCK, lanes)),
            np.empty((_ENTRY * (corners + room), lanes)),
            np.zeros((_NOW, lanes)),
            np.zeros((_OF_PIECE, lanes)),
            np.zeros((STORED, lanes)),
            np.zeros((SIGHT_ROWS, lanes)),
        )
        words, places = np.zeros((word_rows(n), lanes), np.uint64), np.zeros((6, lanes), np.int64)
        stored = storage_arrays(vehicle.rows, lanes)
        work = _Work(
            lanes,
            borrow(owned[0]), borrow(owned[1]), borrow(owned[2]), borrow(owned[3]), borrow(owned[4]),
            borrow(owned[5]), borrow(owned[6]), borrow(owned[7]), borrow(owned[8]), borrow(owned[9]),
            borrow(owned[10]), borrow(owned[11]), borrow(owned[12]), borrow(words), borrow(places[0]),
            borrow(places[1]), borrow(places[2]), borrow(places[3]), borrow(places[4]), borrow(places[5]),
            storage_work(vehicle.storage, stored),
        )  # fmt: skip
        for b in range(first, last):
            _fly_block(b, batch, vehicle, move, work)
        keep((owned, words, places, stored))

    return fly_period


@njit(inline="always")
def _fly_block(b, batch, vehicle, move, work):
    data, clock, valves = batch.data, work.clock, work.valves
    constants, period, dynamic = vehicle.constants, vehicle.constants.period, vehicle.valves.dynamic
    n, lanes = vehicle.rows.thrusters, work.lanes
    load_state(b, data, work.columns, vehicle, work.state, lanes)
    load_storage(b, batch, vehicle, vehicle.storage, work.storage, work.state)
    for w in range(lanes):
        clock[_START, w] = data[b, at.STEP, w] * period
    draw_words(b, batch, work.words, n, lanes)
    node_count, changing, commanded = _faults_of_period(b, batch, vehicle, work)
    _command_valves(b, batch, vehicle, commanded, work)
    used = _corners_of_period(b, batch, vehicle, changing or commanded, work)
    for k in range(_SUMS):
        for w in range(lanes):
            work.impulse[k, w] = 0.0
    for i in range(n):
        for w in range(lanes):
            valves[_DELIVERED * n + i, w] = 0.0
    _start_clock(constants, vehicle.storage, work)
    for s in range(used + 2):  # the last round only flies what is left on the schedule
        for part in range(_parts(s, used, node_count, constants, work) if s <= used else 1):
            if s <= used:
                for w in range(lanes):
                    length = clock[_PIECE, w] / clock[_PARTS, w]
                    clock[_LENGTH, w] = length if part < clock[_PARTS, w] else 0.0
                if changing:
                    _follow_changes(b, batch.faults, node_count, work, n)
                _openings(vehicle.thrusters, dynamic, node_count, work)
                _sum_thrusters(vehicle.thrusters, constants.coupling, node_count, work)
                if changing:
                    _follow_tilts(b, batch.faults, node_count, work, n)
                _accumulate(node_count, work, n)
                if move:
                    _cut(b, data, vehicle, node_count, work)
            left = move
            while left:
                left = s > used or _schedule(node_count, work)
                if left:
                    _integrate(b, batch, vehicle, vehicle.storage, node_count, work)
                left = left and s <= used
            for w in range(lanes):
                clock[_BEFORE, w] += clock[_LENGTH, w]
        # Exactly at the corner: one that only a neighbour has then makes a piece of exactly no length.
        for w in range(lanes):
            clock[_BEFORE, w] = work.corners[s, w] if s < used else period
    _store(b, data, vehicle, work)
    if commanded:
        for w in range(lanes):
            if clock[_COMMANDED, w] > 0.0:
                _hold_open(b, w, batch, vehicle, work)
    coupling = _fire_nominally(b, data, vehicle, dynamic, work)
    if move:
        freeze_lost(b, data, work.state, work.sight[0], lanes)
        store_state(b, data, vehicle, work.state, 0, lanes)
        expected_change(b, data, vehicle, coupling, valves, _NOMINAL * n, work.sight, lanes)
        store_storage(b, data, vehicle, vehicle.storage, work.storage, work.state)
        look(b, data, vehicle, work.words, work.state, work.sight, lanes)


@njit(forceinline=True)
def _start_clock(constants, storage, work):
    clock, state, places = work.clock, work.state, work.places
    lanes, fastest = work.lanes, 0.0
    for w in range(lanes):
        rate = (state[at.RATE, w], state[at.RATE + 1, w], state[at.RATE + 2, w])
        clock[_BEFORE, w] = 0.0
        clock[_SPIN, w] = abs(rate[0]) + abs(rate[1]) + abs(rate[2])
        clock[_RATE, w] = fastest_rate(rate, constants.gyroscopy)
        clock[_MASS, w], clock[_EXTRA, w] = state[at.MASS, w], 0.0
        fastest = clock[_RATE, w] if clock[_RATE, w] > fastest else fastest
        work.entries[w], work.totals[w] = 0, 0
        places[w] = w
    if storage is None and lanes > _VECTOR:
        turning = fastest * max(1.0 / constants.far_turn, min(1.0 / constants.turn_limit, 1.0))
        if turning * constants.period > _MANY_SUBSTEPS:
            _rank(clock, places, lanes)


@njit(forceinline=True)
def _rank(clock, places, lanes):
    """Number the lanes by their rates, the fastest first; one without a finite rate comes last."""
    for w in range(lanes):
        clock[_PIECE, w] = clock[_RATE, w] if clock[_RATE, w] < math.inf else -1.0
        places[w] = 0
    for v in range(lanes):
        rate = clock[_PIECE, v]
        for w in range(lanes):
            places[w] += (rate > clock[_PIECE, w]) | ((rate == clock[_PIECE, w]) & (v < w))


@njit(forceinline=True)
def _faults_of_period(b, batch, vehicle, work):
    """Sort out the faults of a block for one period.

    What is the same all period long is put into ``floor``, ``slope``, ``gain`` and ``columns`` once; craft
    with a fault that begins, ends or varies within the period, and those with one that acts on their
    commands, are marked in the clock. Returns how many nodes a piece needs (one if everything is constant in
    it), and whether a craft is marked for the one and for the other.
    """
    faults, clock, nodes = batch.faults, work.clock, work.nodes
    n, period = vehicle.rows.thrusters, vehicle.constants.period
    lanes = work.lanes
    smooth, faulty, changing, commanded = vehicle.valves.dynamic is not None, False, False, False
    for w in range(lanes):
        clock[_CHANGES, w], clock[_COMMANDED, w] = 0.0, 0.0
        clock[_WAVES, w], clock[_UNTIL, w] = 0.0, -1.0
        start = clock[_START, w]
        for k in range(faults.shape[2]):
            fault = health.read_fault(faults, b, w, k)
            if health.is_within(fault, start, start + period):
                if health.acts_on_commands(fault):
                    commanded, clock[_COMMANDED, w] = True, 1.0
                    continue
                faulty = True
                if not health.is_steady(fault, start, period):
                    changing, clock[_CHANGES, w] = True, 1.0
                    if health.varies_smoothly(fault):
                        smooth, clock[_WAVES, w] = True, 1.0
        if _storage_changes(b, w, batch.storage_faults, start, period):
            changing, clock[_CHANGES, w] = True, 1.0
    node_count = 3 if smooth else 1
    for k in range(node_count * n):
        for w in range(lanes):
            nodes[_FLOOR * n + k, w] = 0.0
            nodes[_SLOPE * n + k, w] = 1.0
            nodes[_GAIN * n + k, w] = 1.0
    if faulty:
        for w in range(lanes):
            if clock[_CHANGES, w] == 0.0:
                _apply_steady_faults(b, w, faults, period, node_count, work, n)
    return node_count, changing, commanded


@njit(forceinline=True)
def _storage_changes(b, w, storage_faults, start, period):
    """Whether the fault of a wheel or gyro begins, ends or varies within the period."""
    if storage_faults is None:
        return False
    changes = False
    for k in range(storage_faults.shape[2]):
        fault = storage_faults[b, w, k]
        if health.is_within(fault, start, start + period):
            changes |= not health.is_steady(fault, start, period)
    return changes


@njit
def _apply_steady_faults(b, w, faults, period, node_count, work, n):
    """Put the faults of a craft all of whose faults are steady into its rows, for the whole period."""
    columns, middle = work.columns, work.clock[_START, w] + 0.5 * period
    _apply_faults(b, w, faults, middle, middle, node_count, work.nodes, n)
    for k in range(faults.shape[2]):
        fault = health.read_fault(faults, b, w, k)
        if health.tilts(fault) and health.is_active(fault, middle):
            health.tilt_columns(faults[b, w, k], middle, columns, w)


@njit(forceinline=True)
def _parts(s, used, node_count, constants, work):
    """Length of piece ``s`` of each craft, and into how many equal parts it goes.

    Returns the most of these, 0 if no craft has such a piece. A piece is one part, unless a fault that ramps
    or waves bends the thrust: then a part is no longer than a sub-step.
    """
    clock, corners, most, longest = work.clock, work.corners, 1.0, 0.0
    for w in range(work.lanes):
        after = corners[s, w] if s < used else constants.period
        length = after - clock[_BEFORE, w]
        length = length if length > 0.0 else 0.0
        clock[_PIECE, w], clock[_PARTS, w] = length, 1.0
        longest = length if length > longest else longest
    if node_count > 1:
        for w in range(work.lanes):
            parts = math.ceil(clock[_PIECE, w] / constants.wave_part) if clock[_WAVES, w] > 0.0 else 1.0
            parts = parts if parts > 1.0 else 1.0
            clock[_PARTS, w] = parts
            most = parts if parts > most else most
    return int(most) if longest > 0.0 else 0


@njit(forceinline=True)
def _command_valves(b, batch, vehicle, commanded, work):
    """Opening and closing times in the period, carry-over, strength with scatter, nominal duration."""
    data, thrusters, rows = batch.data, vehicle.thrusters, vehicle.rows
    words, valves, state = work.words, work.valves, work.state
    n, lanes = rows.thrusters, work.lanes
    period, dry_mass = vehicle.constants.period, vehicle.constants.dry_mass
    for i in range(n):
        minimum, opening_delay = thrusters.minimum_pulse[i], thrusters.opening_delay[i]
        closing_delay, scatter = thrusters.closing_delay[i], thrusters.scatter[i]
        for w in range(lanes):
            opening, closing = firing.valve_times(
                data[b, rows.duties + i, w], data[b, rows.held + i, w], minimum, opening_delay,
                closing_delay, period,
            )  # fmt: skip
            nominal = closing - opening
            valves[_OPENS * n + i, w] = opening
            valves[_CLOSES * n + i, w] = closing
            valves[_NOMINAL * n + i, w] = nominal if nominal > 0.0 else 0.0
        if i % 2 == 0:
            for w in range(lanes):
                first, second = uniform_pair(words[6 + i // 2, w])
                valves[_STRENGTH * n + i, w] = first
                if i + 1 < n:
                    valves[_STRENGTH * n + i + 1, w] = second
        for w in range(lanes):
            strength = 1.0 + scatter * (2.0 * valves[_STRENGTH * n + i, w] - 1.0)
            valves[_STRENGTH * n + i, w] = strength if state[at.MASS, w] > dry_mass else 0.0
    if commanded:
        for w in range(lanes):
            if work.clock[_COMMANDED, w] > 0.0:
                _command_errors(b, w, batch, vehicle, valves)
    for i in range(n):
        for w in range(lanes):
            valves[_RUN * n + i, w] = valves[_OPENS * n + i, w]
    if vehicle.valves.dynamic is not None:
        for i in range(n):
            for w in range(lanes):
                valves[_LEVEL * n + i, w] = data[b, rows.level + i, w]
                opening, closing, tail = firing.merged_pulse(
                    valves[_OPENS * n + i, w], valves[_CLOSES * n + i, w], data[b, rows.tail + i, w], period
                )
                valves[_TAIL * n + i, w] = tail
                valves[_OPENS * n + i, w], valves[_CLOSES * n + i, w] = opening, closing


@njit(forceinline=True)
def _store(b, data, vehicle, work):
    """What the period left behind: delivered on-times, impulse, open time, and the state of the valves."""
    thrusters, rows, period = vehicle.thrusters, vehicle.rows, vehicle.constants.period
    valves, impulse, n, lanes = work.valves, work.impulse, rows.thrusters, work.lanes
    for i in range(n):
        minimum = thrusters.minimum_pulse[i]
        for w in range(lanes):
            data[b, rows.delivered + i, w] = valves[_DELIVERED * n + i, w]
        for w in range(lanes):
            data[b, rows.held + i, w] = firing.held_after(
                data[b, rows.duties + i, w], valves[_RUN * n + i, w], minimum, period
            )
        if vehicle.valves.dynamic is not None:
            rise, fall = thrusters.rise_rate[i], thrusters.fall_rate[i]
            for w in range(lanes):
                opening, closing = valves[_OPENS * n + i, w], valves[_CLOSES * n + i, w]
                tail = valves[_TAIL * n + i, w]
                level = firing.valve_level(
                    period, valves[_LEVEL * n + i, w], tail, opening, closing, rise, fall
                )
                data[b, rows.level + i, w] = level
                data[b, rows.tail + i, w] = firing.left_open(opening, closing, tail, period)
    for k in range(6):
        for w in range(lanes):
            data[b, at.IMPULSE + k, w] = impulse[_WRENCH + k, w]
    for w in range(lanes):
        data[b, at.OPEN_TIME, w] += impulse[_OPEN, w]
        data[b, at.STEP, w] += 1.0


@njit(forceinline=True)
def _fire_nominally(b, data, vehicle, dynamic, work):
    """Nominal on-times of valves with delays or ramps; returns the coupling that they do not yet have."""
    if dynamic is None:
        return vehicle.constants.coupling
    rows, thrusters, constants = vehicle.rows, vehicle.thrusters, vehicle.constants
    block = data[b]
    for w in range(work.lanes):
        fire_nominal(
            w, (block, rows.duties), (block, rows.nominal),
            (thrusters.minimum_pulse, thrusters.opening_delay, thrusters.closing_delay, thrusters.rise_rate,
             thrusters.fall_rate),
            constants.period, constants.coupling, (work.nodes, work.corners),
            (work.valves, _NOMINAL * rows.thrusters),
        )  # fmt: skip
    return 0.0


@njit
def _command_errors(b, w, batch, vehicle, valves):
    """Let faults that act on commands act: pulses become longer, and valves open late.

    A valve that is held open from before does not open late.
    """
    data, faults, thrusters, rows = batch.data, batch.faults, vehicle.thrusters, vehicle.rows
    n, period = rows.thrusters, vehicle.constants.period
    start = data[b, at.STEP, w] * period
    for k in range(faults.shape[2]):
        fault = health.read_fault(faults, b, w, k)
        if not (health.is_there(fault) and health.acts_on_commands(fault)):
            continue
        i = health.thruster_of(fault)
        delay, _, added = health.command_error(fault, start)
        if data[b, rows.held + i, w] == 0.0:
            valves[_OPENS * n + i, w] += delay
        if added > 0.0:
            on_time = health.biased_duty(faults[b, w], i, start, data[b, rows.duties + i, w], None) * period
            on_time = on_time if on_time >= thrusters.minimum_pulse[i] else 0.0
            valves[_CLOSES * n + i, w] = on_time + thrusters.closing_delay[i] if on_time > 0.0 else 0.0


@njit
def _hold_open(b, w, batch, vehicle, work):
    """Let commands that last to the end of the period by what a fault adds to them be runs."""
    data, faults, rows, n = batch.data, batch.faults, vehicle.rows, vehicle.rows.thrusters
    start, period = work.clock[_START, w], vehicle.constants.period
    for k in range(faults.shape[2]):
        fault = health.read_fault(faults, b, w, k)
        if health.command_error(fault, start)[2] > 0.0:
            i = health.thruster_of(fault)
            to_come = work.valves[_RUN * n + i, w] - period
            duty = health.biased_duty(faults[b, w], i, start, data[b, rows.duties + i, w], None)
            run = duty >= 1.0 and period >= vehicle.thrusters.minimum_pulse[i]
            data[b, rows.held + i, w] = 1.0 + max(to_come, 0.0) if run else 0.0


@njit(forceinline=True)
def _corners_of_period(b, batch, vehicle, faulty, work):
    """Fill the rows of ``corners`` in use, in order, and return how many they are."""
    corners, valves, clock, thrusters = work.corners, work.valves, work.clock, vehicle.thrusters
    n, lanes, period = vehicle.rows.thrusters, work.lanes, vehicle.constants.period
    used = n
    if vehicle.valves.dynamic is not None:
        for i in range(n):
            for w in range(lanes):
                firing.valve_corners(
                    7 * i, corners, w, valves[_LEVEL * n + i, w], valves[_TAIL * n + i, w],
                    valves[_OPENS * n + i, w], valves[_CLOSES * n + i, w],
                    thrusters.rise_rate[i], thrusters.fall_rate[i], period,
                )  # fmt: skip
        used = firing.CORNERS_WITH_DYNAMICS * n
    else:
        for i in range(n):
            for w in range(lanes):
                closing = valves[_CLOSES * n + i, w]
                corners[i, w] = closing if (closing > 0.0) & (closing < period) else period
    firing.sort_rows(corners, vehicle.valves.network, lanes)
    most = used
    if faulty:
        for w in range(lanes):
            clock[_COUNT, w] = used
            if clock[_CHANGES, w] + clock[_COMMANDED, w] > 0.0:
                clock[_COUNT, w] = _insert_corners(b, w, used, batch, vehicle, work)
            most = max(most, int(clock[_COUNT, w]))
        for w in range(lanes):
            for k in range(int(clock[_COUNT, w]), most):
                corners[k, w] = period
    return most


@njit
def _insert_corners(b, w, used, batch, vehicle, work):
    """Put the corners that faults add among the sorted ones of a craft, and return how many there are."""
    corners, start, period = work.corners, work.clock[_START, w], vehicle.constants.period
    n = vehicle.rows.thrusters
    for k in range(batch.faults.shape[2]):
        fault = health.read_fault(batch.faults, b, w, k)
        if health.is_there(fault):
            if health.is_late(fault):
                opening = work.valves[_OPENS * n + health.thruster_of(fault), w]
                if 0.0 < opening < period:
                    used = firing.insert_sorted(corners, w, used, opening)
            elif not health.acts_on_commands(fault):
                for corner in health.fault_corners(fault, start, period):
                    if 0.0 < corner < period:
                        used = firing.insert_sorted(corners, w, used, corner)
        used = _insert_storage_corners(b, w, k, used, batch.storage_faults, start, period, corners)
    return used


@njit(forceinline=True)
def _insert_storage_corners(b, w, k, used, storage_faults, start, period, corners):
    """The same of the fault of a wheel or gyro, where there are any."""
    if storage_faults is not None:
        for corner in health.fault_corners(storage_faults[b, w, k], start, period):
            if 0.0 < corner < period:
                used = firing.insert_sorted(corners, w, used, corner)
    return used


@njit(forceinline=True)
def _openings(thrusters, dynamic, node_count, work):
    """How far each thruster is open at the nodes of the piece, faults included."""
    valves, clock, nodes = work.valves, work.clock, work.nodes
    n, lanes = thrusters.thrust.shape[0], work.lanes
    if dynamic is not None:
        for i in range(n):
            rise, fall = thrusters.rise_rate[i], thrusters.fall_rate[i]
            f, s = _FLOOR * n + i, _SLOPE * n + i
            for w in range(lanes):
                level, tail = valves[_LEVEL * n + i, w], valves[_TAIL * n + i, w]
                opening, closing = valves[_OPENS * n + i, w], valves[_CLOSES * n + i, w]
                t, length = clock[_BEFORE, w], clock[_LENGTH, w]
                a = firing.valve_level(t + 0.25 * length, level, tail, opening, closing, rise, fall)
                z = firing.valve_level(t + 0.75 * length, level, tail, opening, closing, rise, fall)
                nodes[i, w] = nodes[f, w] + nodes[s, w] * (a - 0.5 * (z - a))
                nodes[n + i, w] = nodes[f + n, w] + nodes[s + n, w] * (0.5 * (a + z))
                nodes[2 * n + i, w] = nodes[f + 2 * n, w] + nodes[s + 2 * n, w] * (z + 0.5 * (z - a))
    else:
        for k in range(node_count):
            for i in range(n):
                f, s = (_FLOOR + k) * n + i, (_SLOPE + k) * n + i
                for w in range(lanes):
                    middle = clock[_BEFORE, w] + 0.5 * clock[_LENGTH, w]
                    is_open = (middle >= valves[_OPENS * n + i, w]) & (middle < valves[_CLOSES * n + i, w])
                    nodes[k * n + i, w] = nodes[f, w] + (nodes[s, w] if is_open else 0.0)


@njit(forceinline=True)
def _follow_changes(b, faults, node_count, work, n):
    """Renew what the faults make of the thrusters of the marked craft, for the coming piece."""
    clock = work.clock
    for w in range(work.lanes):
        if clock[_CHANGES, w] > 0.0 and clock[_LENGTH, w] > 0.0:
            middle = clock[_BEFORE, w] + 0.5 * clock[_LENGTH, w]
            if middle >= clock[_UNTIL, w]:
                start, length = clock[_START, w] + clock[_BEFORE, w], clock[_LENGTH, w]
                _apply_faults(b, w, faults, start, start + length, node_count, work.nodes, n)
                clock[_UNTIL, w] = _next_change(b, w, faults, start + 0.5 * length) - clock[_START, w]


@njit
def _next_change(b, w, faults, t):
    """Until when the faults of a craft stay as they are at ``t``, s of the episode.

    It is ``t`` itself while one of them varies smoothly.
    """
    until = math.inf
    for k in range(faults.shape[2]):
        fault = health.read_fault(faults, b, w, k)
        if health.is_there(fault) and not health.acts_on_commands(fault):
            until = min(until, health.next_change(fault, t))
    return until


@njit
def _apply_faults(b, w, faults, start, end, node_count, nodes, n):
    """Floor, slope and gain of the faulty thrusters of a craft between two moments."""
    for k in range(faults.shape[2]):
        fault = health.read_fault(faults, b, w, k)
        if health.is_there(fault) and not health.acts_on_commands(fault):
            i = health.thruster_of(fault)
            first, middle, last = health.health_nodes(faults, b, w, i, start, end)
            for node in range(node_count):
                floor, slope, gain = first if node == 0 else (middle if node == 1 else last)
                nodes[(_FLOOR + node) * n + i, w] = floor
                nodes[(_SLOPE + node) * n + i, w] = slope
                nodes[(_GAIN + node) * n + i, w] = gain


@njit(forceinline=True)
def _sum_thrusters(thrusters, coupling, node_count, work):
    """Thrust of each thruster through the shared feed, and its sums, at each node.

    The sums are the body wrench, the mass flow and the number of open valves. Thrusters are taken four at a
    time: the sums then go through memory a quarter as often.
    """
    columns, valves, nodes, sums = work.columns, work.valves, work.nodes, work.sums
    n, lanes = thrusters.thrust.shape[0], work.lanes
    fours = n - n % 4
    for node in range(node_count):
        level, thrust, row = (_OPENING + node) * n, (_THRUST + node) * n, _SUMS * node
        for k in range(_SUMS):
            for w in range(lanes):
                sums[row + k, w] = 0.0
        for i in range(0, fours, 4):
            q = level + i
            for w in range(lanes):
                sums[row + _OPEN, w] += (nodes[q, w] + nodes[q + 1, w]) + (nodes[q + 2, w] + nodes[q + 3, w])
        for i in range(fours, n):
            for w in range(lanes):
                sums[row + _OPEN, w] += nodes[level + i, w]
        for i in range(n):
            flow_per_thrust = thrusters.thrust[i] * thrusters.flow_per_thrust[i]
            for w in range(lanes):
                q_i = nodes[level + i, w]
                through = 1.0 - coupling * (sums[row + _OPEN, w] - q_i)
                share = valves[_STRENGTH * n + i, w] * q_i * (through if through > 0.0 else 0.0)
                nodes[thrust + i, w] = share * nodes[(_GAIN + node) * n + i, w]
                sums[row + _FLOW, w] += flow_per_thrust * share
        for i in range(0, fours, 4):
            t, c = thrust + i, 6 * i
            for k in range(6):
                for w in range(lanes):
                    sums[row + k, w] += (
                        nodes[t, w] * columns[c + k, w] + nodes[t + 1, w] * columns[c + 6 + k, w]
                    ) + (nodes[t + 2, w] * columns[c + 12 + k, w] + nodes[t + 3, w] * columns[c + 18 + k, w])
        for i in range(fours, n):
            for k in range(6):
                for w in range(lanes):
                    sums[row + k, w] += nodes[thrust + i, w] * columns[6 * i + k, w]


@njit(forceinline=True)
def _follow_tilts(b, faults, node_count, work, n):
    """Turn the thrust of the misaligned thrusters of the marked craft."""
    clock = work.clock
    for w in range(work.lanes):
        if clock[_CHANGES, w] > 0.0 and clock[_LENGTH, w] > 0.0:
            for k in range(faults.shape[2]):
                if health.tilts(health.read_fault(faults, b, w, k)):
                    _tilt_one(faults[b, w, k], w, node_count, work, n)


@njit
def _tilt_one(fault, w, node_count, work, n):
    clock, columns, nodes, sums = work.clock, work.columns, work.nodes, work.sums
    start = clock[_START, w] + clock[_BEFORE, w]
    end = start + clock[_LENGTH, w]
    if not health.is_active(fault, 0.5 * (start + end)):
        return
    i = health.thruster_of(fault)
    s0, sm, s1 = health.severity_nodes(fault, start, end)
    for node in range(node_count):
        s = s0 if node == 0 else (sm if node == 1 else s1)
        force = nodes[(_THRUST + node) * n + i, w]
        along, across = math.cos(s) - 1.0, math.sin(s)
        for c in range(6):
            sums[_SUMS * node + c, w] += force * (
                along * columns[6 * i + c, w] + across * fault[at.FAULT_TILTED + c]
            )


@njit(forceinline=True)
def _accumulate(node_count, work, n):
    """Add the piece to the impulse, the open time and each thruster's delivered on-time."""
    clock, nodes, sums, impulse, valves = work.clock, work.nodes, work.sums, work.impulse, work.valves
    lanes = work.lanes
    if node_count == 1:
        for k in range(_SUMS):
            for w in range(lanes):
                impulse[k, w] += clock[_LENGTH, w] * sums[k, w]
        for i in range(n):
            for w in range(lanes):
                valves[_DELIVERED * n + i, w] += clock[_LENGTH, w] * nodes[_THRUST * n + i, w]
    else:
        for k in range(_SUMS):
            for w in range(lanes):
                mean = simpson(sums[k, w], sums[_SUMS + k, w], sums[2 * _SUMS + k, w])
                impulse[k, w] += clock[_LENGTH, w] * mean
        for i in range(n):
            a, m, z = _THRUST * n + i, (_THRUST + 1) * n + i, (_THRUST + 2) * n + i
            for w in range(lanes):
                mean = simpson(nodes[a, w], nodes[m, w], nodes[z, w])
                valves[_DELIVERED * n + i, w] += clock[_LENGTH, w] * mean


@njit(forceinline=True)
def _cut(b, data, vehicle, node_count, work):
    """Count into how many equal sub-steps the piece of each craft is cut.

    Craft have their pieces at different times; each one takes only the sub-steps that it needs. How far it
    can turn in a piece is bounded from its rate at the start of the period and the torques since then. One
    that needs more than can be flown is lost.
    """
    constants, inverse, clock, sums = vehicle.constants, vehicle.body.inverse, work.clock, work.sums
    last, bounded = _SUMS * (node_count - 1), constants.far_turn < math.inf
    for w in range(work.lanes):
        clock[_SPIN_UP, w], clock[_DRAIN, w] = 0.0, 0.0
    for node in range(node_count):
        k = _SUMS * node
        for w in range(work.lanes):
            torques = (sums[k + 3, w], sums[k + 4, w], sums[k + 5, w])
            clock[_SPIN_UP, w] = _larger(clock[_SPIN_UP, w], size(symmetric_product(inverse, torques)))
            clock[_DRAIN, w] = _larger(clock[_DRAIN, w], sums[k + _FLOW, w])
    for w in range(work.lanes):
        length = clock[_LENGTH, w]
        torque = _larger(
            abs(sums[3, w]) + abs(sums[4, w]) + abs(sums[5, w]),
            abs(sums[last + 3, w]) + abs(sums[last + 4, w]) + abs(sums[last + 5, w]),
        )
        acceleration = constants.spin_per_torque * torque + constants.stored_spin
        turns = _larger(
            clock[_SPIN, w] * length / constants.turn_limit,
            math.sqrt(acceleration / constants.twist_limit) * length,
        )
        shortest = length / constants.short_substep
        clock[_TURNS, w] = turns if turns < shortest else shortest
        clock[_SPIN, w] += acceleration * length
    for w in range(work.lanes):
        length = clock[_LENGTH, w]
        spin_up = clock[_SPIN_UP, w] + constants.stored_spin
        clock[_RATE, w] += spin_up * length
        turns = length * substep_rate(clock[_RATE, w], spin_up, constants)
        clock[_TURNS, w] = _larger(clock[_TURNS, w], turns)
    if bounded:
        for w in range(work.lanes):
            used = clock[_DRAIN, w] * clock[_LENGTH, w]
            left = clock[_MASS, w] - used
            clock[_MASS, w] = left
            turns = used / (_LARGEST_DRAIN * left) if left > 0.0 else math.inf
            clock[_TURNS, w] = _larger(clock[_TURNS, w], turns)
    for w in range(work.lanes):
        length = clock[_LENGTH, w]
        wanted = _larger(length / constants.max_substep, clock[_TURNS, w])
        flies = (length > 0.0) & (data[b, at.LOST, w] == 0.0)
        fits = (clock[_EXTRA, w] + wanted <= MOST_SUBSTEPS + 1.0) & (clock[_RATE, w] < math.inf)
        count = np.ceil(wanted) if flies & fits else 0.0
        clock[_COUNT, w] = count
        clock[_EXTRA, w] += count - 1.0 if count > 0.0 else 0.0
        data[b, at.LOST, w] = 1.0 if flies & (not fits) else data[b, at.LOST, w]


@njit(forceinline=True)
def _larger(a, b):
    """The larger of two numbers, and NaN where the second is that."""
    return a if a >= b else b


#: Share of its mass that a craft may lose in one sub-step.
_LARGEST_DRAIN = 0.1


@njit(forceinline=True)
def _schedule(node_count, work):
    """Enter the piece of each craft in its schedule, which is by its place, where there is room.

    Returns whether one finds none.
    """
    clock, sums, schedule, entries = work.clock, work.sums, work.schedule, work.entries
    room, left = schedule.shape[0] // _ENTRY, False
    for w in range(work.lanes):
        if clock[_COUNT, w] > 0.0:
            p = work.places[w]
            if entries[p] == room:
                left = True
                continue
            row = _ENTRY * entries[p]
            entries[p] += 1
            work.totals[p] += int(clock[_COUNT, w])
            schedule[row + _H, p] = clock[_LENGTH, w] * (1.0 / clock[_COUNT, w])
            schedule[row + _STEPS, p] = clock[_COUNT, w]
            for node in range(node_count):
                for k in range(_LOAD):
                    schedule[row + _FIRST + _LOAD * node + k, p] = sums[_SUMS * node + k, w]
            clock[_COUNT, w] = 0.0
    return left


@njit
def _next_entry(p, node_count, work):
    """Let the craft at a place go on to the next piece of its schedule; after the last one it waits."""
    schedule, now, piece, entry = work.schedule, work.now, work.piece, work.entry
    entry[p] += 1
    row = _ENTRY * entry[p]
    if entry[p] == work.entries[p]:
        now[_H, p], work.left[p] = 0.0, _NONE_LEFT
        return
    now[_H, p], work.left[p] = schedule[row + _H, p], int(schedule[row + _STEPS, p])
    if node_count == 1:
        for k in range(_LOAD):
            now[1 + k, p] = schedule[row + _FIRST + k, p]
    else:
        for k in range(3 * _LOAD):
            piece[k, p] = schedule[row + _FIRST + k, p]
        piece[_SHARE, p], piece[_DONE, p] = 1.0 / schedule[row + _STEPS, p], 0.0


@njit(forceinline=True)
def _follow_piece(width, work):
    """What acts at the start, middle and end of the next sub-step of each craft, by quadratics in time.

    Exact where all three nodes of a piece are equal.
    """
    now, piece = work.now, work.piece
    for node in range(3):
        for k in range(_LOAD):
            for w in range(width):
                s = (piece[_DONE, w] + 0.5 * node) * piece[_SHARE, w]
                a = piece[k, w]
                m, z = piece[_LOAD + k, w] - a, piece[2 * _LOAD + k, w] - a
                now[1 + _LOAD * node + k, w] = a + s * ((4.0 * m - z) + 2.0 * s * (z - 2.0 * m))
    for w in range(width):
        piece[_DONE, w] += 1.0


@njit(forceinline=True)
def _integrate(b, batch, vehicle, storage, node_count, work):
    """Move the craft of the block through their schedules, and empty these.

    Those with fewer sub-steps wait for the others of their vector, by sub-steps of no length.
    """
    now, places, steps, left, state = work.now, work.places, work.steps, work.left, work.state
    lanes = work.lanes
    vector = min(lanes, _VECTOR)
    for w in range(lanes):
        steps[w] = 0
    for p in range(lanes):
        v = p // vector
        steps[v] = work.totals[p] if work.totals[p] > steps[v] else steps[v]
    for v in range(lanes // vector - 2, -1, -1):
        steps[v] = steps[v] if steps[v] > steps[v + 1] else steps[v + 1]
    for p in range(lanes):
        work.entry[p] = -1
        _next_entry(p, node_count, work)
    middle, end, width = (1 + _LOAD, 1 + 2 * _LOAD, lanes) if node_count == 3 else (1, 1, lanes)
    if storage is None:
        body, moving = vehicle.body, work.moving
        put_in_places(body.orbit, state, moving, places, lanes)
        for j in range(steps[0]):
            while steps[width // vector - 1] <= j:
                width -= vector
            if node_count == 3:
                _follow_piece(width, work)
            for w in range(width):
                forces, torques, flows = _loads(now, w, 1, middle, end)
                substep(moving, w, now[_H, w], body, forces, torques, flows, None)
            for p in range(width):
                left[p] -= 1
                if left[p] == 0:
                    _next_entry(p, node_count, work)
        take_from_places(body.orbit, state, moving, places, lanes)
    else:
        for _ in range(steps[0]):
            if node_count == 3:
                _follow_piece(lanes, work)
            for w in range(lanes):
                forces, torques, flows = _loads(now, w, 1, middle, end)
                substep_stored(
                    b, w, batch, vehicle, storage, work.storage, state, now[_H, w],
                    (forces, torques, flows, None),
                )  # fmt: skip
            for p in range(lanes):
                left[p] -= 1
                if left[p] == 0:
                    _next_entry(p, node_count, work)
    for p in range(lanes):
        work.entries[p], work.totals[p] = 0, 0


@njit(forceinline=True)
def _loads(now, w, a, m, z):
    """Forces, torques and flows of a sub-step, by the rows of its start, middle and end."""
    return (
        ((now[a, w], now[a + 1, w], now[a + 2, w]),
         (now[m, w], now[m + 1, w], now[m + 2, w]),
         (now[z, w], now[z + 1, w], now[z + 2, w])),
        ((now[a + 3, w], now[a + 4, w], now[a + 5, w]),
         (now[m + 3, w], now[m + 4, w], now[m + 5, w]),
         (now[z + 3, w], now[z + 4, w], now[z + 5, w])),
        (now[a + _FLOW, w], now[m + _FLOW, w], now[z + _FLOW, w]),
    )  # fmt: skip
