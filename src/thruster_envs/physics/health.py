"""What faults make of an actuator or a sensor at a moment: the only code that knows what a kind does.

A thruster has a *health* of three numbers: a valve level q becomes an opening ``floor + slope q``, and its
thrust is multiplied by ``gain``. Of several faults of one thruster, stuck open acts first, then leaking, then
the rest in their order. Beside that a fault may act on the command of a period (an opening delay, a lag, a
duty that is added), turn the thrust, or change the discharge of a plasma thruster. A measurement has an error
that is added to it, or is held. Kinds and what their severities mean stand in
:mod:`thruster_envs.faults.kinds`; a new kind is one branch here.

A ``fault`` is one row of an encoded one, ``faults`` (slots, FAULT_WIDTH) are those of one craft, times are in
s of the episode. Flight kernels, the oracle view, pictures and the studies of detectors call this.
"""

import math
from typing import Any, NamedTuple

from thruster_envs.faults import encoding as code
from thruster_envs.faults.kinds import CODES, SPIKE_PROBABILITY, check_kind
from thruster_envs.helpers import njit
from thruster_envs.physics import rows as at

# Reading one --------------------------------------------------------------------------------------------


@njit(forceinline=True)
def read_fault(faults, b, w, k):
    """The columns of one encoded fault, as numbers: a kernel then touches only those that it asks for."""
    return (
        faults[b, w, k, 0], faults[b, w, k, 1], faults[b, w, k, 2], faults[b, w, k, 3], faults[b, w, k, 4],
        faults[b, w, k, 5], faults[b, w, k, 6], faults[b, w, k, 7], faults[b, w, k, 8], faults[b, w, k, 9],
        faults[b, w, k, 10], faults[b, w, k, 11], faults[b, w, k, 12],
    )  # fmt: skip


# When a fault acts --------------------------------------------------------------------------------------


@njit(forceinline=True)
def is_there(fault):
    """Whether a slot holds a fault, on the branch in use."""
    return fault[code.FIELD_KIND] > 0.0 and fault[code.FIELD_BRANCH] == code.IN_USE


@njit(forceinline=True)
def is_within(fault, start, end):
    """Whether a fault that is there begins before ``end`` and ends after ``start``."""
    return is_there(fault) and fault[code.FIELD_ONSET] < end and fault[code.FIELD_END] > start


@njit
def is_between(fault, t):
    """Whether ``t`` is after the onset and before the end of a fault that is there."""
    return is_there(fault) and fault[code.FIELD_ONSET] <= t < fault[code.FIELD_END]


@njit
def is_active(fault, t):
    """Whether a fault acts at ``t``: after its onset, before its end, not in a pause of its profile."""
    if not is_between(fault, t):
        return False
    if fault[code.FIELD_PROFILE] == code.SQUARE:
        cycles = (t - fault[code.FIELD_ONSET]) / fault[code.FIELD_PROFILE_TIME]
        return cycles - math.floor(cycles) < fault[code.FIELD_DWELL]
    return True


@njit
def severity(fault, t):
    """Severity of an active fault at ``t``, in the unit of its kind."""
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
def fault_corners(fault, start, period):
    """The four moments at which a fault begins, ends or has a kink, s after ``start``.

    Those that do not lie inside the period are one of its ends.
    """
    first, second, third, fourth = period, period, period, period
    if is_there(fault):
        onset = fault[code.FIELD_ONSET] - start
        first, second = onset, fault[code.FIELD_END] - start
        length = fault[code.FIELD_PROFILE_TIME]
        if fault[code.FIELD_PROFILE] == code.RAMP:
            third = onset + length
        elif fault[code.FIELD_PROFILE] == code.SQUARE:
            cycle = max(0.0, math.floor(-onset / length))
            next_on = onset + cycle * length
            next_off = next_on + fault[code.FIELD_DWELL] * length
            third = next_on if next_on > 0.0 else next_on + length
            fourth = next_off if next_off > 0.0 else next_off + length
    return _within(first, period), _within(second, period), _within(third, period), _within(fourth, period)


@njit(forceinline=True)
def _within(t, period):
    return min(max(t, 0.0), period)


@njit
def is_steady(fault, start, period):
    """Whether a fault stays as it is all through a period of ``period`` seconds from ``start`` on."""
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
def varies_smoothly(fault):
    """Whether the severity of a fault goes with time, but for jumps."""
    return fault[code.FIELD_PROFILE] == code.RAMP or fault[code.FIELD_PROFILE] == code.SINE


@njit
def next_change(fault, t):
    """When a fault next begins, ends or changes after ``t``; infinity if never.

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
def switch_branch(faults, t):
    """Switch over to the redundant branch at ``t``: the faults of the other end, its own are there."""
    for k in range(faults.shape[0]):
        if is_there(faults[k]):
            faults[k, code.FIELD_END] = min(faults[k, code.FIELD_END], t)
        faults[k, code.FIELD_BRANCH] = code.IN_USE


# What it makes of a thruster ----------------------------------------------------------------------------

#: Numbers of the ranks in which the faults of one thruster act.
_RANKS = 3
#: The health of a thruster without a fault.
SOUND = (0.0, 1.0, 1.0)
#: The shares of a pulse without a fault: mass, width, and added resistance in ohm.
NOMINAL_PULSE = (1.0, 1.0, 0.0)


@njit(forceinline=True)
def thruster_of(fault):
    """Index from 0 of the thruster that a fault strikes."""
    return int(fault[code.FIELD_THRUSTER])


@njit
def strikes(fault, thruster, capacitors):
    """Whether a fault strikes a thruster, by its index from 0.

    A shared one strikes all thrusters whose entry in ``capacitors`` (n,) is the same; None where there are
    none.
    """
    if capacitors is None:
        return thruster_of(fault) == thruster
    struck = thruster_of(fault)
    shared = fault[code.FIELD_SHARED] > 0.0 and capacitors[struck] == capacitors[thruster]
    return shared or struck == thruster


@njit
def health_at(faults, thruster, t, within, capacitors):
    """Health of a thruster at ``t``: floor, slope and gain, by the faults that are active at ``within``.

    ``within`` is a moment of the piece of time in which ``t`` is, away from its ends.
    """
    health = SOUND
    for rank in range(_RANKS):
        for k in range(faults.shape[0]):
            fault = faults[k]
            if _rank(fault) == rank and strikes(fault, thruster, capacitors) and is_active(fault, within):
                health = applied(fault[code.FIELD_KIND], severity(fault, t), health)
    return health


@njit
def health_nodes(faults, b, w, thruster, start, end):
    """Health of a thruster at the start, middle and end of a piece of time without corners.

    Means over the piece by Simpson's rule are exact. ``faults`` (blocks, lanes, slots, columns) are those of
    a batch.
    """
    middle, first, between, last = 0.5 * (start + end), SOUND, SOUND, SOUND
    for rank in range(_RANKS):
        for k in range(faults.shape[2]):
            fault = read_fault(faults, b, w, k)
            if _rank(fault) == rank and thruster_of(fault) == thruster and is_active(fault, middle):
                s0, sm, s1 = severity_nodes(fault, start, end)
                kind = fault[code.FIELD_KIND]
                first, between = applied(kind, s0, first), applied(kind, sm, between)
                last = applied(kind, s1, last)
    return first, between, last


@njit
def _rank(fault):
    """In which turn the fault of a thruster acts."""
    kind = fault[code.FIELD_KIND]
    return 0 if kind == code.STUCK_ON else (1 if kind == code.LEAK else 2)


@njit
def applied(kind, s, health):
    """A thruster's health (floor, slope, gain) under one more fault, by its kind's code and its severity."""
    floor, slope, gain = health
    if kind == code.STUCK_ON:
        return s, 0.0, gain
    if kind == code.LEAK:
        return floor + s * (1.0 - floor), slope * (1.0 - s), gain
    if kind == code.STUCK_OFF or kind == code.INTERMITTENT:
        return floor * (1.0 - s), slope * (1.0 - s), gain
    if kind == code.LOSS:
        return floor, slope, gain * (1.0 - s)
    if kind == code.SIGN:
        return floor, slope, gain * (1.0 - 2.0 * s)
    return floor, slope, gain


@njit(forceinline=True)
def acts_on_commands(fault):
    """Whether a fault acts on the command of a period, as it stands at its start: late, slow or biased."""
    kind = fault[code.FIELD_KIND]
    return kind == code.LATE_OPENING or kind == code.SLOW_OPENING or kind == code.BIAS


@njit(forceinline=True)
def is_late(fault):
    """Whether a fault puts off the opening of a valve."""
    return fault[code.FIELD_KIND] == code.LATE_OPENING


@njit
def command_error(fault, t):
    """What a fault does to the command of a period that begins at ``t``.

    Returns the delay by which the thruster opens later and what comes to its time constant, both in s, and
    the duty that is added.
    """
    if acts_on_commands(fault) and is_active(fault, t):
        return on_command(fault[code.FIELD_KIND], severity(fault, t))
    return 0.0, 0.0, 0.0


@njit
def on_command(kind, s):
    """Delay (s), lag (s) and duty that a fault adds, by the code of its kind and its severity."""
    if kind == code.LATE_OPENING:
        return s, 0.0, 0.0
    if kind == code.SLOW_OPENING:
        return 0.0, s, 0.0
    if kind == code.BIAS:
        return 0.0, 0.0, s
    return 0.0, 0.0, 0.0


@njit
def command_errors(faults, thruster, t, capacitors):
    """What all faults of a craft do to the command of a thruster: delay (s), lag (s) and duty added."""
    delay, lag, duty = 0.0, 0.0, 0.0
    for k in range(faults.shape[0]):
        if strikes(faults[k], thruster, capacitors):
            one = command_error(faults[k], t)
            delay, lag, duty = delay + one[0], lag + one[1], duty + one[2]
    return delay, lag, duty


@njit
def biased_duty(faults, thruster, t, duty, capacitors):
    """The duty that a thruster is fired by: that commanded, and what faults add to it, up to 1."""
    return min(1.0, duty + command_errors(faults, thruster, t, capacitors)[2])


@njit(forceinline=True)
def tilts(fault):
    """Whether a fault turns the thrust."""
    return fault[code.FIELD_KIND] == code.MISALIGNMENT


@njit
def tilt_columns(fault, t, columns, w):
    """Turn the wrench of a thruster that a fault tilts at ``t``, six rows of ``columns``, in lane ``w``."""
    if tilts(fault):
        row, tilt = 6 * thruster_of(fault), severity(fault, t)
        for c in range(6):
            columns[row + c, w] = (
                math.cos(tilt) * columns[row + c, w] + math.sin(tilt) * fault[at.FAULT_TILTED + c]
            )


@njit
def shares_of(faults, thruster, start, period):
    """What faults make of a thruster in a period that begins at ``start``, as they stand in its middle.

    Returns the share of the commanded on-time that it delivers, the same along its nominal direction, and its
    opening without a command; both are negative where the thrust is reversed. They are those of a thruster
    whose thrust is proportional to its on-time; what a fault adds to the duty counts as an opening.
    """
    middle = start + 0.5 * period
    floor, slope, gain = health_at(faults, thruster, middle, middle, None)
    delivered, closed, along = slope * gain, floor * gain, 1.0
    for k in range(faults.shape[0]):
        fault = faults[k]
        if thruster_of(fault) == thruster and is_active(fault, middle):
            s = severity(fault, middle)
            if tilts(fault):
                along *= math.cos(s)
            elif is_late(fault):
                delivered *= max(0.0, 1.0 - s / period)
    added = command_errors(faults, thruster, start, None)[2]
    closed += min(added, 1.0) * delivered
    return delivered, delivered * along, closed


@njit
def changes_discharge(fault):
    """-1 where a fault of the discharge takes thrust away, 1 where it adds some, 0 for any other fault."""
    kind = fault[code.FIELD_KIND]
    if kind == code.PROPELLANT_LOSS or kind == code.CONDUCTIVITY_LOSS:
        return -1
    return 1 if kind == code.ELECTRODE_SEDIMENT else 0


@njit
def pulse_shares(faults, thruster, capacitors, time):
    """What the faults of a craft make of a pulse of a thruster at ``time``.

    Several faults of one kind take their shares one after the other; resistances add up. Returns the share of
    the slug's mass, the share of the electrodes' width and the added resistance in ohm, as
    :func:`~thruster_envs.physics.plasma_pulse.pulse_ratio` takes them.
    """
    shares = NOMINAL_PULSE
    for slot in range(faults.shape[0]):
        fault = faults[slot]
        if changes_discharge(fault) == 0 or not is_active(fault, time):
            continue
        if strikes(fault, thruster, capacitors):
            shares = discharged(fault[code.FIELD_KIND], severity(fault, time), shares)
    return shares


@njit
def discharged(kind, s, shares):
    """The shares of :func:`pulse_shares` under one more fault, by the code of its kind and its severity."""
    mass, width, resistance = shares
    if kind == code.PROPELLANT_LOSS:
        return mass * (1.0 - s), width, resistance
    if kind == code.ELECTRODE_SEDIMENT:
        return mass, width * (1.0 - s), resistance
    if kind == code.CONDUCTIVITY_LOSS:
        return mass, width, resistance + s
    return mass, width, resistance


# What it makes of wheels and gyros ----------------------------------------------------------------------


@njit(forceinline=True)
def is_of_storage(kind):
    """Whether a kind, by its code, is that of a reaction wheel or a control-moment gyro."""
    return kind >= code.WHEEL_TORQUE_LOSS


@njit
def wheel_health(faults, wheel, t):
    """What the faults of a craft make of a reaction wheel at ``t``, by its index from 0.

    ``faults`` (slots, fields) are those of wheels and gyros. Returns the share of its torque that is lost, 1
    where it is stuck, the dry friction that is added as a share of its largest torque, and the share of its
    largest speed that is lost. Losses of one kind go one after the other; frictions add up.
    """
    torque, stuck, friction, speed = 1.0, 0.0, 0.0, 1.0
    for k in range(faults.shape[0]):
        fault = faults[k]
        if is_active(fault, t) and thruster_of(fault) == wheel:
            kind, s = fault[code.FIELD_KIND], severity(fault, t)
            if kind == code.WHEEL_TORQUE_LOSS:
                torque *= 1.0 - s
            elif kind == code.WHEEL_STUCK:
                stuck = 1.0 if s > 0.0 else stuck
            elif kind == code.WHEEL_FRICTION:
                friction += s
            elif kind == code.WHEEL_SPEED_LIMIT:
                speed *= 1.0 - s
    return 1.0 - torque, stuck, friction, 1.0 - speed


@njit
def gimbal_loss(faults, gyro, t):
    """The share of its commanded rate that the gimbal of a gyro, by its index from 0, has lost at ``t``."""
    rate = 1.0
    for k in range(faults.shape[0]):
        fault = faults[k]
        if is_active(fault, t) and thruster_of(fault) == gyro:
            kind, s = fault[code.FIELD_KIND], severity(fault, t)
            if kind == code.GIMBAL_RATE_LOSS:
                rate *= 1.0 - s
            elif kind == code.GIMBAL_LOCK and s > 0.0:
                rate = 0.0
    return 1.0 - rate


# The same by the name of a kind -------------------------------------------------------------------------


class Effect(NamedTuple):
    """What a fault of one kind and severity, by itself, makes of a thruster while it acts.

    Attributes:
        floor: Opening whatever is commanded.
        slope: Opening that comes with each unit that is commanded.
        gain: Thrust over that of the same flow without a fault; negative where it is reversed.
        delay: By how much it opens later, s.
        lag: What comes to its time constant, s.
        duty: What is added to the commanded duty.
    """

    floor: Any
    slope: Any
    gain: Any
    delay: Any
    lag: Any
    duty: Any


def effect_of(kind: str, severity: Any, health: tuple[Any, Any, Any] = SOUND) -> Effect:
    """What a fault makes of a thruster, by the name of its kind; the severity may be an array.

    ``health`` is what other faults have made of it before: floor, slope and gain.

    >>> effect_of("leak", 0.25)
    Effect(floor=0.25, slope=0.75, gain=1.0, delay=0.0, lag=0.0, duty=0.0)
    """
    check_kind(kind)
    floor, slope, gain = applied.py_func(CODES[kind], severity, health)
    return Effect(floor, slope, gain, *on_command.py_func(CODES[kind], severity))


def pulse_of(kind: str, severity: Any) -> tuple[Any, Any, Any]:
    """What a fault makes of a pulse: shares of mass and width and added resistance in ohm.

    The severity may be an array.

    >>> pulse_of("electrode_sediment", 0.25)
    (1.0, 0.75, 0.0)
    """
    check_kind(kind)
    shares: tuple[Any, Any, Any] = discharged.py_func(CODES[kind], severity, NOMINAL_PULSE)
    return shares


# What it makes of a measurement -------------------------------------------------------------------------


@njit
def measurement_error(fault, t, measured, uniform):
    """What the fault of a sensor adds to one number that it measures at ``t``, in its unit.

    ``measured`` is what it would measure without faults, ``uniform`` a random number from 0 to 1.
    """
    kind, s = fault[code.FIELD_KIND], severity(fault, t)
    if kind == code.SENSOR_BIAS:
        return s
    if kind == code.SENSOR_DRIFT:
        return s * (t - fault[code.FIELD_ONSET])
    if kind == code.SENSOR_SCALE:
        return s * measured
    if kind == code.SENSOR_SPIKE:
        return s if uniform < SPIKE_PROBABILITY else 0.0
    return 0.0


@njit
def holds(fault, t, uniform):
    """Whether the fault of a sensor that acts at ``t`` keeps the last measurement in place of a new one."""
    return fault[code.FIELD_KIND] == code.SENSOR_FREEZE or is_missing(fault, t, uniform)


@njit
def is_missing(fault, t, uniform):
    """Whether the fault of a sensor that acts at ``t`` leaves it without a measurement, and it says so."""
    return fault[code.FIELD_KIND] == code.SENSOR_DROP_OUT and uniform < severity(fault, t)
