"""What nominal valves deliver for the commands of a period: the compiled core of flights and detectors.

The valve is that of :mod:`.firing`: minimum pulse, opening and closing delays, linear rise and fall, runs and
what is still open from the period before. The feed takes its share of the thrust at every moment (Yang 2003,
section 2.4), which for levels that are linear in time Simpson's rule integrates exactly. So the on-times are
those that a flight of a healthy vehicle without scatter delivers. Leaves out scatter, faults, and how far a
modulator's delays are off their nominal value.
"""

import numpy as np

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import firing

#: Groups of rows, one for each thruster, of the scratch of a valve: opening and closing time, level and tail
#: from the period before, level at the start, middle and end of a piece, time for which it is open.
_OPENS, _CLOSES, _LEVEL, _TAIL, _NODES, _OPENED, SCRATCH_GROUPS = 0, 1, 2, 3, 4, 7, 8
#: Groups of rows of what a valve carries into the next period: runs, level and tail, as
#: :class:`.rows.Rows` has them.
HELD, LEVEL, TAIL, CARRIED_GROUPS = range(4)


@njit
def fire_nominal(w, duties, carried, valves, period, coupling, work, answer):
    """Fire the valves of one craft for a period, and carry over what is left open.

    Args:
        w: Its lane.
        duties: The array (rows, lanes) with the commanded duties, and the first row of them.
        carried: The array (rows, lanes) with runs, levels and tails, and the first row of them; renewed.
        valves: Minimum pulse, opening and closing delay (n,), s; rates of rise and fall (n,), 1/s.
        period: s.
        coupling: Share of its thrust that a thruster loses for each further one that is open.
        work: Two scratch arrays: (SCRATCH_GROUPS n, lanes), whose last group becomes the times for which the
            valves are open (s, with a valve that is half open counted half), and (7 n + 1, lanes).
        answer: The array (rows, lanes) for the effective on-times, s, and the first row of them.
    """
    minimum, opening_delay, closing_delay, rise, fall = valves
    (told, d), (left, c), (scratch, corners), (given, a) = duties, carried, work, answer
    n = minimum.shape[0]
    for i in range(n):
        held, level, tail = left[c + i, w], left[c + n + i, w], left[c + 2 * n + i, w]
        opening, closing = firing.valve_times(
            told[d + i, w], held, minimum[i], opening_delay[i], closing_delay[i], period
        )
        left[c + i, w] = firing.held_after(told[d + i, w], opening, minimum[i], period)
        opening, closing, tail = firing.merged_pulse(opening, closing, tail, period)
        firing.valve_corners(7 * i, corners, w, level, tail, opening, closing, rise[i], fall[i], period)
        left[c + n + i, w] = firing.valve_level(period, level, tail, opening, closing, rise[i], fall[i])
        left[c + 2 * n + i, w] = firing.left_open(opening, closing, tail, period)
        scratch[_OPENS * n + i, w], scratch[_CLOSES * n + i, w] = opening, closing
        scratch[_LEVEL * n + i, w], scratch[_TAIL * n + i, w] = level, tail
        scratch[_OPENED * n + i, w], given[a + i, w] = 0.0, 0.0
    used = 0
    for k in range(firing.CORNERS_WITH_DYNAMICS * n):
        corner = corners[k, w]
        if 0.0 < corner < period:
            used = firing.insert_sorted(corners, w, used, corner)
    before = 0.0
    for piece in range(used + 1):
        after = corners[piece, w] if piece < used else period
        length = after - before
        if length > 0.0:
            _fire_piece(w, before, length, valves, coupling, scratch, given, a)
        before = after


@njit
def _fire_piece(w, before, length, valves, coupling, scratch, given, a):
    """Add one piece of time, in which all levels are linear, to what the valves of a craft give."""
    _, _, _, rise, fall = valves
    n = rise.shape[0]
    first, middle, last = 0.0, 0.0, 0.0
    for i in range(n):
        level, tail = scratch[_LEVEL * n + i, w], scratch[_TAIL * n + i, w]
        opening, closing = scratch[_OPENS * n + i, w], scratch[_CLOSES * n + i, w]
        s = firing.valve_level(before + 0.25 * length, level, tail, opening, closing, rise[i], fall[i])
        e = firing.valve_level(before + 0.75 * length, level, tail, opening, closing, rise[i], fall[i])
        q = (s - 0.5 * (e - s), 0.5 * (s + e), e + 0.5 * (e - s))
        first, middle, last = first + q[0], middle + q[1], last + q[2]
        for k in range(3):
            scratch[(_NODES + k) * n + i, w] = q[k]
    for i in range(n):
        q_1 = scratch[(_NODES + 1) * n + i, w]
        if q_1 > 0.0:
            q_0, q_2 = scratch[_NODES * n + i, w], scratch[(_NODES + 2) * n + i, w]
            p_0 = q_0 * max(1.0 - coupling * (first - q_0), 0.0)
            p_1 = q_1 * max(1.0 - coupling * (middle - q_1), 0.0)
            p_2 = q_2 * max(1.0 - coupling * (last - q_2), 0.0)
            scratch[_OPENED * n + i, w] += length * q_1
            given[a + i, w] += length * ((p_0 + 4.0 * p_1 + p_2) / 6.0)


@njit(forceinline=True)
def share_feed(w, open_times, first_row, n, i, coupling):
    """What thruster ``i`` (from 0) delivers of pulses that all start together, s.

    A pulse of duration ``u_i`` loses ``coupling * min(u_i, u_j)`` to every other one.
    """
    own = open_times[first_row + i, w]
    total = -own
    for j in range(n):
        other = open_times[first_row + j, w]
        total += own if own < other else other
    effective = own - coupling * total
    return effective if effective > 0.0 else 0.0


@njit(forceinline=True)
def time_in_period(begin, end, period):
    """For how long of a period, s, something lasts that begins and ends at these times of it."""
    begin = begin if begin > 0.0 else 0.0
    end = end if end < period else period
    return end - begin if end > begin else 0.0


@kernel(nogil=True)
def fire_valves(duties, carried, valves, period, coupling, dynamic, answer):
    """Fire valves of many craft: open times and effective on-times into ``answer`` (2, n, vehicles), s.

    Args:
        duties: (n, vehicles), 0..1.
        carried: (CARRIED_GROUPS n, vehicles), renewed where there are dynamics.
        valves: As :func:`fire_nominal` takes them.
        period: s.
        coupling: Share of thrust lost per further thruster open.
        dynamic: Whether a valve has delays or ramps.
        answer: Written.
    """
    n, vehicles = duties.shape
    if dynamic:
        scratch, corners = np.empty((SCRATCH_GROUPS * n, 1)), np.empty((7 * n + 1, 1))
        told, left, given = np.empty((n, 1)), np.empty((CARRIED_GROUPS * n, 1)), np.empty((n, 1))
        for v in range(vehicles):
            told[:, 0], left[:, 0] = duties[:, v], carried[:, v]
            fire_nominal(
                0, (told, 0), (left, 0), valves, period, coupling, (scratch, corners), (given, 0)
            )  # fmt: skip
            carried[:, v] = left[:, 0]
            for i in range(n):
                answer[0, i, v], answer[1, i, v] = scratch[_OPENED * n + i, 0], given[i, 0]
        return
    minimum = valves[0]
    for i in range(n):
        for v in range(vehicles):
            on_time = duties[i, v] * period
            answer[0, i, v] = on_time if on_time >= minimum[i] else 0.0
    for i in range(n):
        for v in range(vehicles):
            answer[1, i, v] = share_feed(v, answer[0], 0, n, i, coupling)
