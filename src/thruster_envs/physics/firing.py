"""Thruster firing within one control period: valves, faults and the shared feed, as a body wrench.

The wrench is known exactly at every moment.

Models, per thruster: a minimum pulse, opening and closing delays, linear rise and fall of the flow, uniform
firing-to-firing scatter, the faults of :mod:`thruster_envs.faults`; and one propellant feed shared by all,
through which every open thruster takes a share of the thrust of the others, in proportion to how far it is
open (Yang 2003, section 2.4: 6 % on Orion). The period is cut at every corner of every valve level and of
every fault; inside a piece all levels are linear in time.

Consecutive commands that last to the end of their periods are one run, with one opening delay. A pulse that
would open after the end of its period is lost. Several misalignments of one thruster add up; they are not
turned one after the other.

Leaves out plume impingement, pulse-to-pulse memory (thermal or hydraulic), water hammer, and depletion inside
a period (a craft whose propellant is used up at the start of a period does not fire in it).

The helpers here work on one block of craft at a time: arrays of shape (rows, lanes), lanes innermost, plain
arithmetic across lanes so that the loops vectorise; what is rare (a fault) is done lane by lane.
"""

import math

from numba import njit

from thruster_envs.faults import encoding as code

#: Corners that one thruster's level can have in a period when its valve has delays or ramps, and without
#: them; corners of one fault.
CORNERS_WITH_DYNAMICS, CORNERS, FAULT_CORNERS = 7, 1, 5


@njit(forceinline=True)
def sort_rows(rows, comparators, first, last):
    """Sort every lane of ``rows`` (k, lanes) upwards, by a fixed network of comparisons.

    The network stands in ``comparators`` (p, 2) from ``first`` to ``last``.
    """
    for p in range(first, last):
        i, j = comparators[p, 0], comparators[p, 1]
        for w in range(rows.shape[1]):
            a, b = rows[i, w], rows[j, w]
            rows[i, w] = a if a < b else b
            rows[j, w] = b if a < b else a


@njit(forceinline=True)
def saturating_ramp(level, slope, duration):
    """Level after ``duration`` seconds at ``slope`` per second, kept in 0..1."""
    end = level + slope * duration
    end = end if end < 1.0 else 1.0
    return end if end > 0.0 else 0.0


@njit(forceinline=True)
def valve_level(t, start_level, tail, opening, closing, rise, fall):
    """Opening of a valve, 0..1, at time ``t`` of the period.

    It is open until ``tail``, shut until ``opening``, open until ``closing`` and then shut.
    """
    first = t if t < tail else tail
    level = saturating_ramp(start_level, rise, first)
    shut = (t if t < opening else opening) - first
    level = saturating_ramp(level, -fall, shut if shut > 0.0 else 0.0)
    open_again = (t if t < closing else closing) - opening
    level = saturating_ramp(level, rise, open_again if open_again > 0.0 else 0.0)
    last = t - (closing if closing > opening else first)
    return saturating_ramp(level, -fall, last) if (closing > opening) & (t > closing) else level


@njit
def valve_corners(row, corners, w, start_level, tail, opening, closing, rise, fall, period):
    """Write the times at which a valve's level has a corner into seven rows of ``corners``.

    Those that do not occur become ``period``.
    """
    at_tail = saturating_ramp(start_level, rise, tail)
    at_opening = saturating_ramp(at_tail, -fall, opening - tail if opening > tail else 0.0)
    at_closing = saturating_ramp(at_opening, rise, closing - opening if closing > opening else 0.0)
    corners[row, w] = tail
    corners[row + 1, w] = (1.0 - start_level) / rise if tail > 0.0 else period
    corners[row + 2, w] = tail + at_tail / fall
    corners[row + 3, w] = opening
    corners[row + 4, w] = opening + (1.0 - at_opening) / rise if closing > opening else period
    corners[row + 5, w] = closing
    corners[row + 6, w] = closing + at_closing / fall if closing > opening else period
    for k in range(row, row + 7):
        corners[k, w] = min(max(corners[k, w], 0.0), period)


@njit
def severity(fault, t):
    """Severity of an active fault at time ``t`` of the episode, in the unit of its kind."""
    since = t - fault[code.FIELD_ONSET]
    profile = fault[code.FIELD_PROFILE]
    if profile == code.RAMP:
        return fault[code.FIELD_SEVERITY] * min(1.0, since / fault[code.FIELD_PROFILE_TIME])
    if profile == code.SINE:
        return fault[code.FIELD_SEVERITY] * 0.5 * (1.0 - math.cos(_turns(fault, since)))
    return fault[code.FIELD_SEVERITY]


@njit
def severity_nodes(fault, start, end):
    """Severity at the start, middle and end of a piece of time without corners.

    Of a sine, the middle value is the one that makes Simpson's mean exact.
    """
    middle = 0.5 * (start + end)
    if fault[code.FIELD_PROFILE] == code.SQUARE or fault[code.FIELD_PROFILE] == code.STEP:
        s = severity(fault, middle)
        return s, s, s
    first, last = severity(fault, start), severity(fault, end)
    if fault[code.FIELD_PROFILE] == code.RAMP:
        return first, severity(fault, middle), last
    half = 0.5 * _turns(fault, end - start)
    sinc = math.sin(half) / half if half > 1e-4 else 1.0 - half * half / 6.0
    mean = 0.5 * (1.0 - math.cos(_turns(fault, middle - fault[code.FIELD_ONSET])) * sinc)
    return first, (6.0 * fault[code.FIELD_SEVERITY] * mean - first - last) / 4.0, last


@njit
def _turns(fault, time):
    return 2.0 * math.pi * time / fault[code.FIELD_PROFILE_TIME]


@njit
def is_active(fault, t):
    """Whether a fault acts at ``t``, s of the episode: after its onset, before its end, not in a pause.

    An empty slot never does.
    """
    if not (fault[code.FIELD_KIND] > 0.0 and fault[code.FIELD_ONSET] <= t < fault[code.FIELD_END]):
        return False
    if fault[code.FIELD_PROFILE] == code.SQUARE:
        cycles = (t - fault[code.FIELD_ONSET]) / fault[code.FIELD_PROFILE_TIME]
        return cycles - math.floor(cycles) < fault[code.FIELD_DWELL]
    return True


@njit
def fault_corners(fault, start, period, corners, row, w):
    """Write the moments at which a fault begins, ends or has a kink into four rows of ``corners``.

    Those that do not lie inside the period become one of its ends.
    """
    for k in range(4):
        corners[row + k, w] = period
    if fault[code.FIELD_KIND] == 0.0:
        return
    onset = fault[code.FIELD_ONSET] - start
    corners[row, w] = onset
    corners[row + 1, w] = fault[code.FIELD_END] - start
    length = fault[code.FIELD_PROFILE_TIME]
    if fault[code.FIELD_PROFILE] == code.RAMP:
        corners[row + 2, w] = onset + length
    elif fault[code.FIELD_PROFILE] == code.SQUARE:
        cycle = max(0.0, math.floor(-onset / length))
        next_on = onset + cycle * length
        next_off = next_on + fault[code.FIELD_DWELL] * length
        corners[row + 2, w] = next_on if next_on > 0.0 else next_on + length
        corners[row + 3, w] = next_off if next_off > 0.0 else next_off + length
    for k in range(4):
        corners[row + k, w] = min(max(corners[row + k, w], 0.0), period)


@njit
def is_steady(fault, start, period):
    """Whether a fault stays as it is all through a period of ``period`` seconds from ``start`` on.

    A late opening never counts as steady.
    """
    if fault[code.FIELD_KIND] == code.LATE_OPENING:
        return False
    end = start + period
    if fault[code.FIELD_ONSET] > start or fault[code.FIELD_END] < end:
        return False
    since, length = start - fault[code.FIELD_ONSET], fault[code.FIELD_PROFILE_TIME]
    if fault[code.FIELD_PROFILE] == code.RAMP:
        return since >= length
    if fault[code.FIELD_PROFILE] == code.SQUARE:
        cycle = since - math.floor(since / length) * length
        edge = fault[code.FIELD_DWELL] * length
        # A little before an edge counts as at the edge, so that rounding cannot hide one.
        margin = 1e-9 * length
        return margin < cycle < edge - period - margin or edge + margin < cycle < length - period - margin
    return fault[code.FIELD_PROFILE] == code.STEP


@njit
def next_change(fault, t):
    """When a fault next begins, ends or changes after ``t``, s of the episode; infinity if never.

    It is ``t`` itself while the fault varies smoothly.
    """
    if t < fault[code.FIELD_ONSET]:
        return fault[code.FIELD_ONSET]
    if t >= fault[code.FIELD_END]:
        return math.inf
    profile, since = fault[code.FIELD_PROFILE], t - fault[code.FIELD_ONSET]
    length = fault[code.FIELD_PROFILE_TIME]
    if profile == code.SINE or (profile == code.RAMP and since < length):
        return t
    if profile == code.SQUARE:
        cycle = math.floor(since / length)
        edge = fault[code.FIELD_DWELL] if since / length - cycle < fault[code.FIELD_DWELL] else 1.0
        return min(fault[code.FIELD_END], fault[code.FIELD_ONSET] + (cycle + edge) * length)
    return fault[code.FIELD_END]


@njit
def apply_fault(kind, s, floor, slope, gain):
    """Opening and gain of a thruster under one more fault of severity ``s`` (a share).

    The opening is ``floor + slope q`` for a valve level ``q``.
    """
    if kind == code.STUCK_ON:
        return s, 0.0, gain
    if kind == code.LEAK:
        return floor + s * (1.0 - floor), slope * (1.0 - s), gain
    if kind == code.STUCK_OFF or kind == code.INTERMITTENT:
        return floor * (1.0 - s), slope * (1.0 - s), gain
    if kind == code.LOSS:
        return floor, slope, gain * (1.0 - s)
    return floor, slope, gain
