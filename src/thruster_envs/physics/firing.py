"""Thruster firing within one control period: valves and the shared feed, as a body wrench.

The wrench is known exactly at every moment.

Models, per thruster: a minimum pulse, opening and closing delays, linear rise and fall of the flow, uniform
firing-to-firing scatter, what :mod:`.health` makes of it; and one propellant feed shared by all,
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

from typing import Any

from thruster_envs.helpers import njit

#: m/s^2, turns a specific impulse in seconds into an exhaust speed.
STANDARD_GRAVITY = 9.80665

#: Seconds; a valve level that takes no longer to rise or fall jumps.
NO_TIME = 1e-30

#: Corners that one thruster's level can have in a period when its valve has delays or ramps, and without
#: them; corners of one fault.
CORNERS_WITH_DYNAMICS, CORNERS, FAULT_CORNERS = 7, 1, 5


def has_dynamics(spacecraft: Any) -> bool:
    """Whether any valve of a spacecraft has a delay or takes time to rise or fall."""
    return any(
        one.opening_delay > 0.0
        or one.closing_delay > 0.0
        or one.rise_time > NO_TIME
        or one.fall_time > NO_TIME
        for one in spacecraft.thrusters
    )


@njit(forceinline=True)
def sort_rows(rows, comparators, lanes):
    """Sort each of the first lanes of ``rows`` upwards, by a fixed network of comparisons (p, 2)."""
    for p in range(comparators.shape[0]):
        i, j = comparators[p, 0], comparators[p, 1]
        for w in range(lanes):
            a, b = rows[i, w], rows[j, w]
            rows[i, w] = a if a < b else b
            rows[j, w] = b if a < b else a


@njit
def insert_sorted(rows, w, number, value):
    """Put a value into the ``number`` sorted rows of lane ``w``, and return how many they are then."""
    k = number
    while k > 0 and rows[k - 1, w] > value:
        rows[k, w] = rows[k - 1, w]
        k -= 1
    rows[k, w] = value
    return number + 1


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


@njit(forceinline=True)
def valve_times(duty, held, minimum, opening_delay, closing_delay, period):
    """When a valve that is commanded opens and closes, s of the period; it closes at 0 without a command."""
    on_time = duty * period
    on_time = on_time if on_time >= minimum else 0.0
    opening = held - 1.0 if held >= 1.0 else opening_delay
    return opening, on_time + closing_delay if on_time > 0.0 else 0.0


@njit(forceinline=True)
def merged_pulse(opening, closing, tail, period):
    """Opening and closing of the pulse of a period and the tail before it, where they overlap made one.

    What is no pulse of its own, or would open after the period, opens and closes far behind it.
    """
    merges = (closing > opening) & (opening <= tail)
    pulse = (closing > opening) & (opening > tail) & (opening < period)
    tail = closing if merges & (closing > tail) else tail
    return opening if pulse else 2.0 * period, closing if pulse else 2.0 * period, tail


@njit(forceinline=True)
def held_after(duty, opening, minimum, period):
    """1 plus the opening delay still to come where a command lasts to the end of the period, else 0."""
    to_come = opening - period
    run = (duty >= 1.0) & (period >= minimum)
    return (1.0 + (to_come if to_come > 0.0 else 0.0)) if run else 0.0


@njit(forceinline=True)
def left_open(opening, closing, tail, period):
    """For how long a valve stays open into the next period, s."""
    over = (closing if opening < period else tail) - period
    return over if over > 0.0 else 0.0
