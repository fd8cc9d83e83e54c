"""Where everything stands in the arrays that the compiled kernels share.

A batch of craft is one float64 array ``data`` of shape (blocks, fields, lanes): the craft of block ``b`` and
lane ``l`` is number ``b * lanes + l`` (world-major: ``world * number_of_craft + craft``). A block is
contiguous, so a kernel that goes from block to block streams through memory whatever the size of the batch.
Fields are in SI units; the per-thruster ones come last, ``n`` rows each.
"""

from dataclasses import dataclass

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
SCALARS = 48

# A fault as the kernels hold it: the columns of ``thruster_envs.faults.encoding`` and then the wrench that
# the thruster would give if its thrust were turned by a right angle towards the fault's azimuth.
FAULT_TILTED = len(FAULT_FIELDS)
FAULT_WIDTH = FAULT_TILTED + 6

# Rows of the per-thruster constants, shape (THRUSTER_ROWS, n).
THRUST, MINIMUM_PULSE, OPENING_DELAY, CLOSING_DELAY = 0, 1, 2, 3
RISE_RATE, FALL_RATE, SCATTER, FLOW_PER_THRUST = 4, 5, 6, 7  # 1/s, 1/s, share, kg/s per N
BELIEVED = 8  # 6, nominal rate change per second of firing, m/s^2 and rad/s^2
LAG_RATE = 14  # 1/s
THRUSTER_ROWS = 15

# Entries of the vehicle's scalar constants.
PERIOD, MAX_SUBSTEP, MEAN_MOTION, COUPLING, DRY_MASS = 0, 1, 2, 3, 4
UNIFORM_ERRORS = 5  # 1 where measurement errors are uniform, 0 where they are normal
SIGMA_POSITION, SIGMA_VELOCITY, SIGMA_ATTITUDE, SIGMA_RATE = 6, 7, 8, 9
# Sub-steps: none longer than MAX_SUBSTEP (s); more of them while the craft would turn further in one than
# TURN_LIMIT by its rate or TWIST_LIMIT by a torque (rad), but then none shorter than SHORT_SUBSTEP (s) unless
# it would turn further than FAR_TURN or FAR_TWIST (rad). A sine is followed in parts no longer than WAVE_PART
# (s).
TURN_LIMIT, TWIST_LIMIT, SHORT_SUBSTEP, WAVE_PART, SPIN_PER_TORQUE = 10, 11, 12, 13, 14
FAR_TURN, FAR_TWIST = 15, 16
GYROSCOPY = (
    17  # how strongly rates turn each other: largest difference of two principal moments over the third
)
SPIN_UP = 18  # rad/s^2, the most that the thrusters give together
VELOCITY_DRIFT = 19  # 18: lower half of the HCW transition matrix over one period, row by row
CONSTANTS = 37

# Rows of ``streams`` (blocks, STREAM_ROWS, lanes), uint64: the randomness of a craft is a function of these
# and of its STEP.
KEY_LOW, KEY_HIGH, EPISODE, CRAFT = 0, 1, 2, 3
STREAM_ROWS = 4


@dataclass(frozen=True)
class Layout:
    """Rows of the per-thruster fields for a vehicle of ``thrusters`` thrusters.

    ``carried`` is the number of earlier pulses that a modulator may still have open; None without one.
    """

    thrusters: int
    carried: int | None = None

    @property
    def duties(self) -> int:
        """First row of the duties commanded in the last period, 0..1."""
        return SCALARS

    @property
    def delivered(self) -> int:
        """First row of the on-time delivered in the last period: impulse over nominal thrust, s."""
        return SCALARS + self.thrusters

    @property
    def held(self) -> int:
        """First row of the runs: 0, or 1 plus the opening delay still to come, s.

        A valve is in a run where its command lasted to the end of the period.
        """
        return SCALARS + 2 * self.thrusters

    @property
    def level(self) -> int:
        """First row of the valve levels carried into the next period, 0..1."""
        return SCALARS + 3 * self.thrusters

    @property
    def tail(self) -> int:
        """First row of the times for which a valve stays open into the next period, s."""
        return SCALARS + 4 * self.thrusters

    @property
    def columns(self) -> int:
        """First row of the true wrenches, 6 rows for each thruster: N and N m at full nominal thrust."""
        return SCALARS + 5 * self.thrusters

    @property
    def pending(self) -> int:
        """First row of the pulses still to come behind a modulator, oldest first.

        Of each: ``thrusters`` rows of its opening, of its closing (s of the coming period), and of the
        on-time commanded (s).
        """
        return SCALARS + 11 * self.thrusters

    @property
    def inhibited(self) -> int:
        """Behind a modulator, first row of the isolation valves: 1 closed, 0 open. For a task to write."""
        return self.pending + 3 * (self.carried or 0) * self.thrusters

    @property
    def push(self) -> int:
        """Behind a modulator, first row of the acceleration beside the thrust: 3, m/s^2, LVLH.

        For a task to write; it is held until written again.
        """
        return self.inhibited + self.thrusters

    @property
    def phase(self) -> int:
        """Row of the phase of a modulator's sine, turns."""
        return self.push + 3

    @property
    def fields(self) -> int:
        """Number of rows."""
        return self.pending if self.carried is None else self.phase + 1
