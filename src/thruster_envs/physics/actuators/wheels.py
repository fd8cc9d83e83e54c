"""Reaction wheels: what drives their rotors, when they are held, and what they store.

Models per wheel a motor between body and rotor, of limited torque and up to a limited speed; dry (Coulomb)
and viscous friction of the bearing; a rotor that dry friction holds where the torque on it is no larger. The
speed is that against the body; the inertia of the body is that with all rotors held. At its largest speed a
rotor stays there for as long as the motor would speed it up.

Leaves out imbalance, the rotor's inertia across its axis (it is part of the body's), torque ripple, the
electrical side, and heating. Whether a rotor is held is decided at the start of a sub-step and where its
speed passes zero or its limit; faults are those of the middle of a sub-step.

Source: Hughes 1986, "Spacecraft Attitude Dynamics", section 6.4 (gyrostats).
"""

import math

from thruster_envs.helpers import njit

# Columns of the constants of a wheel: axis in the body, inertia of the rotor about it in kg m^2, largest
# torque in N m, largest speed in rad/s, dry friction in N m, viscous friction in N m s.
AXIS, INERTIA, MAX_TORQUE, MAX_SPEED, COULOMB, VISCOUS, WHEEL_CONSTANTS = 0, 3, 4, 5, 6, 7, 8

# Rows of the scratch of the wheels of one craft: speed at the start of a step, its rates there, at the two
# middle stages, at the end and behind it; speed at the end; torque of the motor, dry friction and largest
# speed as faults make them, and whether the rotor is stuck (1); what the motor gives, the sense in which dry
# friction acts, and whether the rotor is held at its speed against the body (1).
(
    SPEED, RATE_1, RATE_2, RATE_3, RATE_4, RATE_5, END, MOTOR, DRY, LIMIT, STUCK, DRIVE, SENSE, HELD,
    WHEEL_ROWS,
) = range(15)  # fmt: skip


@njit
def stored(wheels, row, s):
    """Angular momentum of the rotors against the body, N m s, body axes, at the speeds in a row of ``s``."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(wheels.shape[0]):
        h = wheels[i, INERTIA] * s[row, i]
        x, y, z = x + h * wheels[i, 0], y + h * wheels[i, 1], z + h * wheels[i, 2]
    return (x, y, z)


@njit
def net_torque(wheels, i, speed, s):
    """Torque on a rotor that is not held, by motor and friction, N m."""
    return s[DRIVE, i] - s[SENSE, i] * s[DRY, i] - wheels[i, VISCOUS] * speed


@njit
def along(wheels, i, v):
    """Component of a body vector along the axis of a wheel."""
    return wheels[i, 0] * v[0] + wheels[i, 1] * v[1] + wheels[i, 2] * v[2]


@njit
def decide(wheels, i, acceleration, s):
    """Set what drives a rotor, or whether it is held, with the body at an angular acceleration (rad/s^2).

    A rotor at rest is held by dry friction, one at its limit by a motor that gives less than it was asked to.
    Returns whether anything has changed.
    """
    speed, motor, limit, dry = s[SPEED, i], s[MOTOR, i], s[LIMIT, i], s[DRY, i]
    carried = wheels[i, INERTIA] * along(wheels, i, acceleration)  # torque that keeps it with the body
    drive, sense, held = motor, math.copysign(1.0, speed), 0.0
    if s[STUCK, i] > 0.0 or (limit <= 0.0 and speed == 0.0):
        held = 1.0
    elif speed == 0.0:
        sense = math.copysign(1.0, motor - carried)
        held = 1.0 if abs(motor - carried) <= dry else 0.0
    elif motor * speed > 0.0 and abs(speed) >= limit:
        needed = math.copysign(1.0, speed) * (carried + sense * dry + wheels[i, VISCOUS] * speed)
        if abs(speed) > limit or needed < 0.0:
            drive = 0.0  # nothing speeds it up further
        elif needed <= abs(motor):
            held = 1.0
    changed = drive != s[DRIVE, i] or sense != s[SENSE, i] or held != s[HELD, i]
    s[DRIVE, i], s[SENSE, i], s[HELD, i] = drive, sense, held
    return changed


@njit
def first_event(wheels, h, s):
    """When in a step of ``h`` seconds a rotor first passes zero or its limit.

    Returns that moment in s of the step, the number of the wheel from 0, and the speed there; -1 for the
    wheel where none does.
    """
    first, which, there = h, -1, 0.0
    for i in range(wheels.shape[0]):
        a, z = s[SPEED, i], s[END, i]
        if s[HELD, i] > 0.0:
            continue
        stops = s[DRY, i] > 0.0 or s[LIMIT, i] <= 0.0
        if stops and a * z < 0.0:
            target = 0.0
        elif s[DRIVE, i] * z > 0.0 and abs(a) < s[LIMIT, i] < abs(z):
            target = math.copysign(s[LIMIT, i], z)
        elif abs(a) > s[LIMIT, i] > abs(z) and s[MOTOR, i] * a > 0.0:
            target = math.copysign(s[LIMIT, i], a)
        else:
            continue
        x = _crossing(a - target, z - target, h * s[RATE_1, i], h * s[RATE_5, i]) * h
        if x <= first:
            first, which, there = x, i, target
    return first, which, there


@njit
def _crossing(a, z, da, dz):
    """Where on 0..1 a cubic of these ends and end slopes is zero, its ends being of two signs."""
    low, high, x = 0.0, 1.0, a / (a - z)
    for _ in range(60):
        t = 1.0 - x
        value = t * t * (a * (1.0 + 2.0 * x) + x * da) + x * x * (z * (1.0 + 2.0 * t) - t * dz)
        if value == 0.0 or high - low < 1e-15:
            break
        if value * a > 0.0:
            low = x
        else:
            high = x
        x = 0.5 * (low + high)
    return x
