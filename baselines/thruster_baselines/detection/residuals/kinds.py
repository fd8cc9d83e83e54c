"""What is wrong with a thruster: courses of its open rate under each kind of fault, against what is measured.

The part of `FusionDetector` that tells kinds apart. From some onset on, each kind and size of fault makes a
course of what a thruster delivers beyond what it was told; sent through the detector's filters, the course
whose signature explains the kept innovations best has the likeliest kind, size and onset. Sizes that follow
from sums (stuck at, loss, leak) are solved for; others are tried on `GRIDS`.

What cannot be told apart is said in `fusion`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray, IntArray

__all__ = ["FUSION_KINDS", "GRIDS", "NONE", "compare_kinds"]

FUSION_KINDS = ("none", "stuck_off", "stuck_on", "loss", "leak", "late_opening", "slow_opening")
"""What `FusionDetector.identify` tells apart, named as in `thruster_envs.faults`.

A late opening is one of two: the beginning of each pulse is lost, or all of it comes later.
"""

NONE, _STUCK_OFF, _STUCK_ON, _LOSS, _LEAK, _LATE, _SLUGGISH = range(7)

_CLOSE_BY = 14
"""Onsets before the alarm that identification tries one by one; earlier ones are a seventh of their distance
from it apart."""

_LEVELS = tuple(0.05 * k for k in range(1, 20))
"""Openings of a leak that identification tries."""

_LOST_TIMES = (
    0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.1, 0.13, 0.17, 0.22, 0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7,
    0.75, 0.8, 0.85, 0.9, 0.95,
)  # fmt: skip
"""Lost beginnings of a pulse that identification tries, in periods."""

_DELAYS = (1.0, 2.0, 3.0, 5.0, 8.0)
"""Further delays that identification tries, in periods."""

_TIME_CONSTANTS = (1.2, 1.6, 2.2, 3.0, 4.0, 5.5, 7.5, 10.0)
"""Time constants of a slow valve that identification tries, in periods; it may be open as it becomes slow."""

_NEARLY = 0.04
"""A share this near to 0 or 1 is taken for it."""

_FIRST_PERIOD = 0.2
"""By what identification does not know the impulse of a fault's first period, in periods of full thrust: when
it began, and the lag of the thrust."""

_THRUST_ERROR = 0.02
"""By what share it does not know the effect of a thruster, that is its thrust, mass and inertia."""


class Grids(NamedTuple):
    """Levels of a leak, and lost beginnings, further delays and time constants, periods."""

    levels: FloatArray
    lost_times: FloatArray
    delays: FloatArray
    constants: FloatArray


GRIDS = Grids(*(np.array(one) for one in (_LEVELS, _LOST_TIMES, _DELAYS, _TIME_CONSTANTS)))


class Course(NamedTuple):
    """What is kept of flights: rings (kept, vehicles, ...), and their filters; a plain tuple for kernels.

    Attributes:
        rates: (kept, vehicles, n), duties.
        seen: (kept, vehicles, 10): innovations of force and torque, weights of torque and of force.
        newest: (vehicles,), the last sample that is kept.
        begun: (vehicles,), the first sample; -1 before.
        gains: (samples, 4), of the filters by age.
        effectiveness: (vehicles, 6, n), believed.
        lag: Of the thrust behind its command, periods.
        period: s.
    """

    rates: FloatArray
    seen: FloatArray
    newest: IntArray
    begun: IntArray
    gains: FloatArray
    effectiveness: FloatArray
    lag: int
    period: float


@kernel(nogil=True)
def compare_kinds(  # type: ignore[no-untyped-def]
    course_of, alarms, vehicles, named, grids, statistic, severity, first, last
):
    """Likelihoods and sizes (rows, kinds) of all kinds of fault, in one thruster of a vehicle each row."""
    rates, seen, last_kept, begun, gains, effectiveness, lag, period = course_of
    levels, lost_times, delays, constants = grids
    kept = rates.shape[0]
    rows = 3 + levels.size + lost_times.size + delays.size + 2 * constants.size
    closing = rows - constants.size  # of a slow valve that was open
    signature, course = np.empty((rows, 3)), np.empty(rows)
    products, squares, kicks = np.empty(rows), np.empty(rows), np.empty(rows)
    turned, overlap, slow = np.empty(constants.size), np.empty(constants.size), np.empty(constants.size)
    fades, rises = np.exp(-1.0 / constants), np.empty((kept, constants.size))
    for at_row in range(first, last):
        v, i = vehicles[at_row], named[at_row] - 1
        if i < 0:
            continue
        newest, begin = last_kept[v], max(begun[v], 0)
        oldest = max(newest - kept + lag + 12, begin)
        column = effectiveness[v, :, i]
        square = column[0] ** 2 + column[1] ** 2 + column[2] ** 2
        for at in range(oldest + 1, newest + 1):
            for k in range(constants.size):
                told = rates[(at - 1 - lag) % kept, v, i] if at > lag else 0.0
                rises[at % kept, k] = (math.exp(told / constants[k]) - 1.0) * fades[k]
        alarm = min(alarms[v], newest)
        onset = alarm - 1  # the first period with the fault ends with the sample after it
        while onset >= oldest:
            signature[:] = 0.0
            products[:] = 0.0
            squares[:] = 0.0
            kicks[:] = 0.0
            overlap[:] = 0.0
            slow[:] = 0.0
            both = 0.0
            for at in range(onset + 1, newest + 1):
                told = rates[(at - 1 - lag) % kept, v, i] if at > lag else 0.0
                course[0] = 1.0 if at == onset + 1 else 0.0
                course[1], course[2] = 1.0, told
                row = 3
                for k in range(levels.size):
                    course[row] = max(levels[k] - told, 0.0)
                    row += 1
                for k in range(lost_times.size):
                    course[row] = -min(told, lost_times[k])
                    row += 1
                for k in range(delays.size):
                    shift = int(delays[k])
                    came = at - 1 - shift >= onset and at > lag + shift
                    course[row] = (rates[(at - 1 - lag - shift) % kept, v, i] if came else 0.0) - told
                    row += 1
                for k in range(constants.size):
                    after = fades[k] * slow[k] + rises[at % kept, k]
                    course[row] = constants[k] * (slow[k] - after)
                    slow[k] = after
                    left = math.exp(-(at - onset - 1) / constants[k])
                    course[closing + k] = constants[k] * left * (1.0 - fades[k])
                    row += 1
                e = seen[at % kept, v]
                along = (column[0] * e[0] + column[1] * e[1] + column[2] * e[2]) * e[9]
                size = square * e[9]
                turn, turn_size = 0.0, 0.0
                for k in range(3):
                    turn += column[3 + k] * e[3 + k] * e[6 + k]
                    turn_size += column[3 + k] * column[3 + k] * e[6 + k]
                gain = gains[min(at - begin - 1, gains.shape[0] - 1)]
                still, slower = (1.0 - gain[0], gain[1]) if e[9] > 0.0 else (1.0, 0.0)
                turning = 1.0 - gain[2] if e[6] > 0.0 else 1.0
                for row in range(rows):
                    s = signature[row]
                    p = s[0] + period * s[1] + 0.5 * period * period * course[row]
                    w = s[2] + period * course[row]
                    s[0], s[1], s[2] = still * p, s[1] + period * course[row] - slower * p, turning * w
                    products[row] += p * along + w * turn
                    squares[row] += p * p * size + w * w * turn_size
                    if row == 0:
                        p_kick, w_kick = p * size, w * turn_size
                    kicks[row] += p * p_kick + w * w_kick
                    if row == 1:
                        p_one, w_one = p * size, w * turn_size
                    elif row == 2:
                        both += p * p_one + w * w_one
                    course[row] = p
                    if row >= closing:
                        q = row - closing
                        overlap[q] += p * course[row - constants.size] * size + w * turned[q] * turn_size
                    elif row >= closing - constants.size:
                        turned[row - closing + constants.size] = w
            # whatever the fault did in its first period is left out of what tells kinds apart
            known = 1.0 / (squares[0] + 1.0 / _FIRST_PERIOD**2)
            for row in range(1, rows):
                products[row] -= kicks[row] * products[0] * known
                squares[row] -= kicks[row] * kicks[row] * known
            both -= kicks[1] * kicks[2] * known
            for k in range(constants.size):
                overlap[k] -= kicks[closing + k] * kicks[closing - constants.size + k] * known
            found = products[0] ** 2 * known
            price = math.log(6.0 * (newest - onset))
            sums = products, squares, both, overlap
            _weigh(statistic[at_row], severity[at_row], found, price, period, sums, grids)
            back = alarm - onset
            onset -= 1 if back < _CLOSE_BY else back // 7


@njit(error_model="numpy")
def _weigh(statistic, severity, found, price, period, sums, grids):  # type: ignore[no-untyped-def]
    """Keep the likeliest sizes of each kind for one onset."""
    products, squares, both, overlap = sums
    levels, lost_times, delays, constants = grids
    c1, s11, c2, s22 = products[1], squares[1], products[2], squares[2]
    if not (s11 > 0.0):
        return
    # shut, open, and stuck at c: the course is c - told
    _keep(statistic, severity, _STUCK_OFF, found + _fit(-c2, s22), 1.0)
    _keep(statistic, severity, _STUCK_ON, found + _fit(c1 - c2, s11 - 2.0 * both + s22), 1.0)
    c = min(max((c1 + both) / s11, 0.0), 1.0)
    value = found + _fit(c * c1 - c2, c * c * s11 - 2.0 * c * both + s22) - price
    if c < _NEARLY:
        _keep(statistic, severity, _STUCK_OFF, value, 1.0)
    else:
        _keep(statistic, severity, _STUCK_ON, value, c)
    if s22 > 0.0:
        c = min(max(-c2 / s22, 0.0), 1.0)
        value = found + _fit(-c * c2, c * c * s22) - price
        if c > 1.0 - _NEARLY:
            _keep(statistic, severity, _STUCK_OFF, value, 1.0)
        else:
            _keep(statistic, severity, _LOSS, value, c)
    # a leak that adds to the pulses: the course is c (1 - told)
    spare = s11 - 2.0 * both + s22
    if spare > 0.0:
        c = min(max((c1 - c2) / spare, 0.0), 1.0)
        value = found + _fit(c * (c1 - c2), c * c * spare) - price
        value += 2.0 * math.log(3.0 * (1.0 - min(c, 0.99)) ** 2)  # the smaller, the likelier
        _keep(statistic, severity, _LEAK if c <= 1.0 - _NEARLY else _STUCK_ON, value, c)
    row = 3
    for k in range(levels.size):
        value = found + _fit(products[row], squares[row]) - 2.0 * price  # else no more than a stuck valve
        _keep(statistic, severity, _LEAK, value, levels[k])
        row += 1
    for k in range(lost_times.size):
        value = found + _fit(products[row], squares[row]) - price
        _keep(statistic, severity, _LATE, value, lost_times[k] * period)
        row += 1
    for k in range(delays.size):
        value = found + _fit(products[row], squares[row]) - price
        _keep(statistic, severity, _LATE, value, delays[k] * period)
        row += 1
    for k in range(constants.size):
        at = row + constants.size
        c, s = products[at] - overlap[k], squares[at]
        opened = min(max(c / s, 0.0), 1.0) if s > 0.0 else 0.0
        c, s = products[row] + opened * products[at], squares[row] + opened * (2.0 * overlap[k] + opened * s)
        _keep(statistic, severity, _SLUGGISH, found + _fit(c, s) - 2.0 * price, constants[k] * period)
        row += 1


@njit(error_model="numpy", inline="always")
def _fit(product, square):  # type: ignore[no-untyped-def]
    """Twice the log-likelihood ratio of a course that is known but for the error of the thrust."""
    missed = product - square
    return 2.0 * product - square + missed * missed / (square + 1.0 / _THRUST_ERROR**2)


@njit(error_model="numpy", inline="always")
def _keep(statistic, severity, kind, found, size):  # type: ignore[no-untyped-def]
    """Keep the likeliest size of a kind."""
    if found > statistic[kind]:
        statistic[kind] = found
        severity[kind] = size
