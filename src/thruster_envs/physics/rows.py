"""Where everything stands in the arrays that the compiled kernels share.

A batch of craft is one float64 array ``data`` of shape (blocks, fields, lanes): the craft of block ``b`` and
lane ``l`` is number ``b * lanes + l`` (world-major: ``world * number_of_craft + craft``). A block is
contiguous, so a kernel that goes from block to block streams through memory whatever the size of the batch.
Fields are in SI units; the per-thruster ones come last, ``n`` rows each.
"""

from typing import NamedTuple

from thruster_envs.faults.encoding import FAULT_FIELDS

#: Craft per block in a large batch; a batch of a few craft uses blocks of one, by the same source.
LANES = 32

# State of a craft: one row each.
POSITION = 0  # 3, m, LVLH
VELOCITY = 3  # 3, m/s, LVLH
ATTITUDE = 6  # 4, body-from-LVLH
RATE = 10  # 3, rad/s, inertial rate in body axes
MASS = 13  # kg
OPEN_TIME = 14  # thruster-seconds of open valve since the reset
STEP = 15  # control periods since the reset
# What the sensors said at the end of the last period, and what followed from it.
MEASURED = 16  # 13: position, velocity, attitude, rate
MEASURED_CHANGE = 29  # 6, rate change of the last period as measured, body axes, drift removed
EXPECTED_CHANGE = 35  # 6, the same as the nominal vehicle would have given
IMPULSE = 41  # 6, what the thrusters gave in the last period: N s and N m s, body axes
LOST = 47  # 1 once the craft could not be followed any further: it stays where it was; else 0
FRAME_RATE = 48  # 2, rad/s: at which LVLH turns about its x and about its z
EXPECTED_USE = 50  # kg, propellant that the nominal vehicle would have used since the reset
DUTIES = 51  # one for each thruster, 0..1, commanded in the last period; Rows has what follows

# A fault as the kernels hold it: the columns of ``thruster_envs.faults.encoding`` and then the wrench that
# the thruster would give if its thrust were turned by a right angle towards the fault's azimuth.
FAULT_TILTED = len(FAULT_FIELDS)
FAULT_WIDTH = FAULT_TILTED + 6

# Rows of ``streams`` (blocks, STREAM_ROWS, lanes), uint64: the randomness of a craft is a function of these
# and of its STEP.
KEY_LOW, KEY_HIGH, EPISODE, CRAFT = 0, 1, 2, 3
STREAM_ROWS = 4


class Rows(NamedTuple):
    """First row of each slice of the state that depends on the vehicle.

    Attributes:
        thrusters: Number of thrusters, n: what follows has n rows unless it says otherwise.
        number_of_wheels: Number of reaction wheels, m.
        number_of_gyros: Number of control-moment gyros, g.
        carried: Number of earlier pulses that a modulator may still have open; 0 without one.
        duties: Duties commanded in the last period, 0..1.
        delivered: On-time delivered in the last period: impulse over nominal thrust, s.
        held: Runs: 0, or 1 plus the opening delay still to come, s. A valve is in a run where its command
            lasted to the end of the period.
        level: Valve levels carried into the next period, 0..1.
        tail: Times for which a valve stays open into the next period, s.
        columns: True wrenches, 6 rows for each thruster: N and N m at full nominal thrust.
        pending: Behind a modulator, the pulses still to come, oldest first. Of each: n rows of its opening,
            of its closing (s of the coming period), and of the on-time commanded (s).
        inhibited: Behind a modulator, the isolation valves: 1 closed, 0 open. For a task to write.
        push: Behind a modulator, the acceleration beside the thrust: 3 rows, m/s^2, LVLH. For a task to
            write; it is held until written again.
        phase: Behind a modulator, the phase of its sine, turns: 1 row.
        wheel_torques: Commanded torques of the wheels, shares of the largest, -1..1: m rows.
        gimbal_rates: Commanded rates of the gimbals, shares of the largest, -1..1: g rows.
        wheel_speeds: Speeds of the rotors against the body, rad/s: m rows.
        gimbal_angles: rad: g rows.
        measured_speeds: The speeds as measured: m rows.
        measured_angles: The angles as measured: g rows.
        stored_momentum: Where there is a wheel or a gyro, mean of what they stored in the last period by what
            was measured, N m s, body axes: 3 rows.
        reference: Where LVLH stands, as :mod:`.orbits` has it: as many rows as the kind of orbit has numbers,
            none on a circular orbit.
        first_reference: The same at the start of the episode, for craft on pulsed plasma thrusters.
        nominal: Of valves with delays or ramps, what nominal ones carry over: rows as of `held`, `level` and
            `tail`; none for other craft.
        fields: Number of rows.
    """

    thrusters: int
    number_of_wheels: int
    number_of_gyros: int
    carried: int
    duties: int
    delivered: int
    held: int
    level: int
    tail: int
    columns: int
    pending: int
    inhibited: int
    push: int
    phase: int
    wheel_torques: int
    gimbal_rates: int
    wheel_speeds: int
    gimbal_angles: int
    measured_speeds: int
    measured_angles: int
    stored_momentum: int
    reference: int
    first_reference: int
    nominal: int
    fields: int


def arrange(
    thrusters: int,
    carried: int | None = None,
    wheels: int = 0,
    gyros: int = 0,
    reference: int = 0,
    *,
    pulsed: bool = False,
    dynamic: bool = False,
) -> Rows:
    """The rows of a vehicle.

    Args:
        thrusters: Number of thrusters.
        carried: Number of earlier pulses that its modulator may still have open; None without a modulator.
        wheels: Number of reaction wheels.
        gyros: Number of control-moment gyros.
        reference: Numbers that say where LVLH stands.
        pulsed: Whether its thrusters are pulsed plasma thrusters.
        dynamic: Whether its valves have delays or ramps, and no modulator.
    """
    modulated, pulses = carried is not None, carried or 0
    sizes = {
        "duties": thrusters,
        "delivered": thrusters,
        "held": thrusters,
        "level": thrusters,
        "tail": thrusters,
        "columns": 6 * thrusters,
        "pending": 3 * pulses * thrusters,
        "inhibited": thrusters * modulated,
        "push": 3 * modulated,
        "phase": 1 * modulated,
        "wheel_torques": wheels,
        "gimbal_rates": gyros,
        "wheel_speeds": wheels,
        "gimbal_angles": gyros,
        "measured_speeds": wheels,
        "measured_angles": gyros,
        "stored_momentum": 3 * (wheels + gyros > 0),
        "reference": reference,
        "first_reference": reference * pulsed,
        "nominal": 3 * thrusters * dynamic,
    }
    first, row = {}, DUTIES
    for name, size in sizes.items():
        first[name], row = row, row + size
    return Rows(
        thrusters=thrusters,
        number_of_wheels=wheels,
        number_of_gyros=gyros,
        carried=pulses,
        fields=row,
        **first,
    )
