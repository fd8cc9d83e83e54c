"""The motion of a rigid body: one sub-step of it, how many it needs, and what becomes of one that is lost.

Models position and velocity against the orbit (:mod:`.orbits`), attitude and rate
(:mod:`.attitude`), and depletion, under a body wrench and a mass flow that are quadratics in time: RK4 for
position, velocity and rate, a fourth-order Magnus step for the attitude. The inertia matrix and the centre of
mass stay where they are.
"""

import math

from thruster_envs.helpers import njit
from thruster_envs.physics import rows as at
from thruster_envs.physics.attitude import normalised, rate_step, rotate_back, turn
from thruster_envs.physics.orbits import (
    follow_frame,
    frame_rate,
    read_reference,
    reference_after,
    reference_of,
    step_frames,
    translation_step,
    write_reference,
)

#: Rows of the state of a block that are the first ones of ``data``. Behind them stands the reference of the
#: orbit where it has one, then what stores momentum.
STATE_ROWS = REFERENCE = 14
STORED = REFERENCE + 6
_R, _V, _Q, _W, _M = at.POSITION, at.VELOCITY, at.ATTITUDE, at.RATE, at.MASS

#: Most sub-steps of a craft in a period, beyond one for each piece; one that needs more is lost.
MOST_SUBSTEPS = 8192
#: A craft of which a number of its state is larger is lost.
_OUT_OF_REACH = 1e20
#: How far a craft may turn in a sub-step (rad) over its gyroscopy, and the angle that it may turn so in a
#: period (rad): beyond, sub-steps are shorter, since errors of the rate add up.
_GYROSCOPIC_TURN, _GYROSCOPIC_PERIOD = 0.09, 5.0


@njit(forceinline=True)
def substep(state, w, h, body, forces, torques, flows, push):
    """One sub-step of one craft, of ``h`` seconds.

    Forces and torques on the body are in N and N m, mass flows in kg/s, each at the start, the middle and the
    end of the sub-step. ``push`` is a constant acceleration beside them, m/s^2 in LVLH, or None.
    """
    rate = (state[_W, w], state[_W + 1, w], state[_W + 2, w])
    quarter, middle, end = rate_step(rate, torques[0], torques[1], torques[2], body.inertia, body.inverse, h)
    q = (state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w])
    turned_m, turned_1 = turn(q, rate, quarter, middle, 0.5 * h), turn(q, rate, middle, end, h)
    move(state, w, h, body, (q, turned_m, turned_1), end, forces, flows, push)


@njit(forceinline=True)
def move(state, w, h, body, attitudes, rate, forces, flows, push):
    """Move one craft for ``h`` seconds, with its attitudes at the start, in the middle and at the end.

    These are against a frame that is at rest and is LVLH at the start; ``rate`` is that at the end.
    """
    q, orbit = attitudes[0], body.orbit
    frames = step_frames(orbit, read_reference(orbit, state, REFERENCE, w), h)
    q_m = follow_frame(orbit, frames[0], frames[1], 0.5 * h, attitudes[1])
    q_1 = follow_frame(orbit, frames[0], frames[2], h, attitudes[2])
    flow_0, flow_m, flow_1 = flows
    mass = state[_M, w]
    mass_m = mass - 0.5 * h * (flow_0 + 1 / 12 * (8.0 * (flow_m - flow_0) - (flow_1 - flow_0)))
    mass_1 = mass - h * simpson(flow_0, flow_m, flow_1)
    r, v = translation_step(
        (state[_R, w], state[_R + 1, w], state[_R + 2, w]),
        (state[_V, w], state[_V + 1, w], state[_V + 2, w]),
        _specific(rotate_back(q, forces[0]), mass, push),
        _specific(rotate_back(q_m, forces[1]), mass_m, push),
        _specific(rotate_back(q_1, forces[2]), mass_1, push),
        orbit, frames, h,
    )  # fmt: skip
    write_reference(orbit, state, REFERENCE, w, reference_of(orbit, frames[2]))
    state[_R, w], state[_R + 1, w], state[_R + 2, w] = r[0], r[1], r[2]
    state[_V, w], state[_V + 1, w], state[_V + 2, w] = v[0], v[1], v[2]
    state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w] = q_1[0], q_1[1], q_1[2], q_1[3]
    state[_W, w], state[_W + 1, w], state[_W + 2, w] = rate[0], rate[1], rate[2]
    state[_M, w] = mass_1


@njit(forceinline=True)
def simpson(a, m, z):
    """Mean of a quadratic from its start, middle and end; exactly ``a`` when all three are equal."""
    return a + 1 / 6 * (4.0 * (m - a) + (z - a))


@njit(forceinline=True)
def _specific(force, mass, push):
    """Acceleration by a force and beside it; whether there is any beside it is decided when compiled."""
    inverse = 1.0 / mass
    if push is None:
        return (inverse * force[0], inverse * force[1], inverse * force[2])
    return (inverse * force[0] + push[0], inverse * force[1] + push[1], inverse * force[2] + push[2])


@njit(forceinline=True)
def fastest_rate(rate, gyroscopy):
    """Bound on the size of the rate of a body without torque, rad/s: it grows where axes exchange energy."""
    return (1.0 + 0.42 * gyroscopy) * size(rate)


@njit(forceinline=True)
def substep_rate(rate, spin_up, constants):
    """Sub-steps per second so that none turns a craft too far, at the rate that it may reach."""
    gyroscopic = constants.gyroscopy / _GYROSCOPIC_TURN
    angle = rate * constants.period / _GYROSCOPIC_PERIOD
    if angle > 1.0:
        gyroscopic *= math.sqrt(math.sqrt(angle))
    gyroscopic = gyroscopic if constants.far_turn < math.inf else 0.0
    turning = rate * max(1.0 / constants.far_turn, gyroscopic)
    return max(turning, math.sqrt(spin_up / constants.far_twist), constants.stored_rate)


@njit(forceinline=True)
def size(v):
    """Length of a 3-vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@njit(forceinline=True)
def equal_substeps(b, w, data, state, length, fewest, constants):
    """Into how many equal sub-steps a craft cuts ``length`` seconds, at least ``fewest``.

    One that would need more than can be flown is lost.
    """
    if data[b, at.LOST, w] > 0.0:
        return fewest
    rate = fastest_rate((state[_W, w], state[_W + 1, w], state[_W + 2, w]), constants.gyroscopy)
    wanted = length * substep_rate(rate + constants.spin_up * length, constants.spin_up, constants)
    if not wanted <= MOST_SUBSTEPS:
        data[b, at.LOST, w] = 1.0
        return fewest
    return math.ceil(wanted) if wanted > fewest else fewest


@njit(forceinline=True)
def load_state(b, data, columns, vehicle, state, lanes):
    """Copy the state of a block and the true wrenches of its thrusters out of ``data``."""
    rows, orbit, block = vehicle.rows, vehicle.body.orbit, data[b]
    for w in range(lanes):
        reference = read_reference(orbit, block, rows.reference, w)
        write_reference(orbit, state, REFERENCE, w, reference)
    for k in range(STATE_ROWS):
        for w in range(lanes):
            state[k, w] = data[b, k, w]
    for k in range(columns.shape[0]):
        for w in range(lanes):
            columns[k, w] = data[b, rows.columns + k, w]


@njit(forceinline=True)
def put_in_places(orbit, state, moving, places, lanes):
    """Copy the state of each craft of a block to its place, by its number in ``places`` (lanes,)."""
    for k in range(STATE_ROWS):
        for w in range(lanes):
            moving[k, places[w]] = state[k, w]
    for w in range(lanes):
        reference = read_reference(orbit, state, REFERENCE, w)
        write_reference(orbit, moving, REFERENCE, places[w], reference)


@njit(forceinline=True)
def take_from_places(orbit, state, moving, places, lanes):
    """Copy the state of each craft of a block back from its place."""
    for k in range(STATE_ROWS):
        for w in range(lanes):
            state[k, w] = moving[k, places[w]]
    for w in range(lanes):
        reference = read_reference(orbit, moving, REFERENCE, places[w])
        write_reference(orbit, state, REFERENCE, w, reference)


@njit(forceinline=True)
def freeze_lost(b, data, state, within, lanes):
    """Put craft that are lost back to where they were at the start of the period, and mark them so.

    Lost are those that turned too fast to be followed, those that have no mass left, and those of which a
    number is not finite or out of any reach, in the unit that it has. ``within`` (lanes,) is scratch.
    """
    for w in range(lanes):
        within[w] = 1.0 if (data[b, at.LOST, w] == 0.0) & (state[_M, w] > 0.0) else 0.0
    for k in range(STATE_ROWS):
        for w in range(lanes):
            within[w] = within[w] if abs(state[k, w]) <= _OUT_OF_REACH else 0.0
    for w in range(lanes):
        if within[w] == 0.0:
            data[b, at.LOST, w] = 1.0
            for k in range(STATE_ROWS):
                state[k, w] = data[b, k, w]


@njit(forceinline=True)
def store_state(b, data, vehicle, state, first, lanes):
    """Write the moved state back from row ``first`` on, with the quaternion at unit length.

    LVLH moves on for the whole period, whatever became of the craft: all craft of a world agree on it.
    """
    block = data[b]
    for w in range(lanes):
        move_frame(w, block, vehicle)
    for w in range(lanes):
        q = normalised((state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w]))
        state[_Q, w], state[_Q + 1, w], state[_Q + 2, w], state[_Q + 3, w] = q[0], q[1], q[2], q[3]
    for k in range(first, STATE_ROWS):
        for w in range(lanes):
            data[b, k, w] = state[k, w]


@njit(forceinline=True)
def move_frame(w, block, vehicle):
    """Move LVLH of one craft of a block (rows, lanes) of ``data`` on by a control period."""
    orbit, constants, row = vehicle.body.orbit, vehicle.constants, vehicle.rows.reference
    reference = read_reference(orbit, block, row, w)
    after = reference_after(orbit, reference, constants.period, reference_steps(constants))
    write_reference(orbit, block, row, w, after)
    write_frame_rate(w, block, orbit, after)


@njit(forceinline=True)
def reference_steps(constants):
    """In how many integration steps LVLH moves on by a control period."""
    return math.ceil(constants.period / constants.max_substep)


@njit(forceinline=True)
def write_frame_rate(w, block, orbit, reference):
    """Write the rate at which LVLH turns, rad/s."""
    rate = frame_rate(orbit, reference)
    block[at.FRAME_RATE, w], block[at.FRAME_RATE + 1, w] = rate[0], rate[2]
