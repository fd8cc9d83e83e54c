"""A batch of worlds, each with one or several like craft: the arrays, and the calls that move them.

This is the host side of the compiled kernels. It knows nothing of tasks, rewards or episodes: a task begins
some worlds, writes where their craft start, commands duties and flies a period.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults import (
    DISCHARGE_KINDS,
    GENERAL_KINDS,
    MODULATOR_KINDS,
    Fault,
    FaultDistribution,
    encode,
)
from thruster_envs.faults import encoding as code
from thruster_envs.faults.sampling import draw_faults
from thruster_envs.kernels import kernel
from thruster_envs.physics import firing, flight, modulated_flight
from thruster_envs.physics import layout as at
from thruster_envs.physics.relative_orbit import orbit_radius, transition_matrix
from thruster_envs.physics.sensing import measure, uniform_errors, write_measurement
from thruster_envs.random import RESET, normal_pair, philox
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.threads import run_shared

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: A batch of fewer craft than this is kept in blocks of one; threads pay from this many craft on.
FEW_CRAFT, MANY_CRAFT = 6, 1024

#: Unless a longest sub-step is asked for, a craft turns in one sub-step by no more than this (rad) with its
#: rate, and by no more than this (rad) with a torque, though none is cut shorter than this (s). Errors then
#: stay a thousand times below Orion's sensor noise over half an orbit.
TURN_LIMIT, TWIST_LIMIT, SHORT_SUBSTEP = 0.02, 0.005, 0.5

#: Nor does any craft turn further than this in a sub-step (rad) with its rate or with a torque, however fast
#: it tumbles: its sub-steps are as short as that takes. So the error of a period is less than :data:`ERROR`
#: times what its impulse moves a craft that does not turn (position, velocity), times the rate, and in
#: attitude less than as many rad.
FAR_TURN, FAR_TWIST = 0.25, 0.09

#: The same behind a modulator, where a sub-step has a straight line for the thrust.
MODULATED_TURN = 0.03

#: Largest error of a period, see :data:`FAR_TURN`.
ERROR = 2e-5

#: Angle by which the orbit may turn in a sub-step, rad.
ORBIT_TURN = 0.05

#: Longest sub-step of craft behind a modulator unless another one is asked for, s.
MODULATED_SUBSTEP = 0.1


@dataclass(frozen=True)
class FaultPlan:
    """Encoded faults of a world: the rows (craft, slots, 10), or the table from which they are drawn."""

    rows: FloatArray
    table: FloatArray
    drawn: bool


class Fleet:
    """Craft of one kind in many worlds.

    Args:
        spacecraft: What every craft is, nominally. What is true of each one stands in the arrays.
        worlds: Number of worlds.
        craft: Number of craft in each world.
        slots: Faults that one craft can have at once.
        nonlinear: Full two-body relative motion instead of Hill's equations.
        max_substep: Longest integration sub-step, s; None lets each craft take as many as its turning needs,
            and those behind a modulator equal ones of at most 0.1 s.
        threads: Threads that share a period's work; None takes one below 1,024 craft and one per core above.
            Results do not depend on it.
        kinds: Kinds of fault that what flies the fleet knows; :meth:`fly` knows the general ones, and those
            of a modulator where the spacecraft has one.

    Attributes:
        data: (blocks, fields, lanes) float64, laid out as :mod:`thruster_envs.physics.layout` says.
        faults: (blocks, lanes, slots, 16) float64.
        streams: (blocks, 4, lanes) uint64.
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        worlds: int,
        craft: int = 1,
        *,
        slots: int = 4,
        nonlinear: bool = False,
        max_substep: float | None = None,
        threads: int | None = None,
        kinds: tuple[str, ...] = GENERAL_KINDS,
    ) -> None:
        modulated = spacecraft.modulator is not None
        self.kinds = kinds + MODULATOR_KINDS if modulated else kinds
        self.spacecraft, self.worlds, self.craft, self.slots = spacecraft, worlds, craft, slots
        bodies = worlds * craft
        self.everyone = np.arange(worlds)
        self.lanes = 1 if bodies < FEW_CRAFT else at.LANES
        self.blocks = -(-bodies // self.lanes)
        self.layout = at.Layout(
            spacecraft.number_of_thrusters,
            modulated_flight.carried_pulses(spacecraft) if modulated else None,
        )
        self.data = np.zeros((self.blocks, self.layout.fields, self.lanes))
        self.faults = np.zeros((self.blocks, self.lanes, slots, at.FAULT_WIDTH))
        self.streams = np.zeros((self.blocks, at.STREAM_ROWS, self.lanes), np.uint64)
        self.data[:, at.ATTITUDE] = 1.0
        self.data[:, at.MEASURED + 6] = 1.0
        self.data[:, at.MASS] = spacecraft.mass
        self.thrusters = _thruster_constants(spacecraft)
        self.constants = _scalar_constants(spacecraft, max_substep)
        self.wrenches = np.ascontiguousarray(spacecraft.wrenches().T)
        self._tilts = _tilted_wrenches(spacecraft)
        inertia = np.array(spacecraft.inertia)
        self._inertia = _symmetric(inertia), _symmetric(np.linalg.inv(inertia))
        self._radius = None
        if nonlinear:
            self._radius = orbit_radius(spacecraft.mean_motion, spacecraft.gravitational_parameter)
        self._dynamic = bool(
            np.any(self.thrusters[[at.OPENING_DELAY, at.CLOSING_DELAY]] > 0.0)
            or np.any(self.thrusters[[at.RISE_RATE, at.FALL_RATE]] < 1.0 / _NO_TIME)
        )
        corners = spacecraft.number_of_thrusters * (
            firing.CORNERS_WITH_DYNAMICS if self._dynamic else firing.CORNERS
        )
        networks = [_sorting_network(corners + firing.FAULT_CORNERS * busy) for busy in range(slots + 1)]
        self._networks = np.concatenate(networks)
        self._starts = np.cumsum([0] + [len(network) for network in networks])
        self._kernel = flight.fly_singly if self.lanes == 1 else flight.fly_blocks
        #: What the kernels behind a modulator read of the vehicle; None without one.
        self._modulated: modulated_flight.Vehicle | None = None
        if modulated:
            self._modulated = modulated_flight.Vehicle(
                self.thrusters, self.constants,
                modulated_flight.modulator_constants(spacecraft, max_substep or MODULATED_SUBSTEP),
                *self._inertia, self._radius,
            )  # fmt: skip
        cores = os.cpu_count() or 1
        wanted = threads if threads is not None else (cores if bodies >= MANY_CRAFT else 1)
        self.threads = max(1, min(wanted, self.blocks))
        edges = np.linspace(0, self.blocks, self.threads + 1).astype(int).tolist()
        #: The blocks that each thread works on: (first, one past the last).
        self.shares: list[tuple[int, int]] = list(pairwise(edges))
        edges = np.linspace(0, worlds, self.threads + 1).astype(int).tolist()
        self._world_shares: list[tuple[int, int]] = list(pairwise(edges))

    def plan(self, source: Sequence[Fault] | FaultDistribution) -> FaultPlan:
        """Faults in the form in which :meth:`begin` takes them.

        Raises:
            ValueError: A craft or thruster that does not exist, more faults than slots, a dwell that is
                shorter than can be followed, or a kind that the spacecraft or what flies it does not know.
        """
        self._check_kinds(source)
        n, period = self.layout.thrusters, self.spacecraft.control_period
        spare = n if self._modulated is not None and self.spacecraft.spare_branch else 0
        if isinstance(source, FaultDistribution):
            shortest = source.profile_time[0]
            waves = "intermittent" in source.kind_weights() or "intermittent" in source.profiles
            table = source.encode(n, self.craft, spare=spare)
            rows = np.zeros((self.craft, self.slots, len(code.FAULT_FIELDS)))
            if source.count[1] > self.slots:
                raise ValueError(
                    f"count is {source.count!r}; at most {self.slots} faults (fault_slots) would be right"
                )
        else:
            rows, table = encode(source, self.craft, n, self.slots, spare=spare), np.zeros(1)
            dwelling = [fault.profile_time for fault in source if fault.profile == "intermittent"]
            shortest, waves = min(dwelling, default=math.inf), bool(dwelling)
        if waves and shortest < period:
            raise ValueError(
                f"profile_time of an intermittent fault is {shortest:g} s; "
                f"at least the control period, {period:g} s, would be right"
            )
        return FaultPlan(rows, table, isinstance(source, FaultDistribution))

    def _check_kinds(self, source: Sequence[Fault] | FaultDistribution) -> None:
        if isinstance(source, FaultDistribution):
            kinds, shared = tuple(source.kind_weights()), source.shared
        else:
            kinds, shared = tuple(fault.kind for fault in source), any(fault.shared for fault in source)
        name, discharges = self.spacecraft.name, self.spacecraft.discharge is not None
        possible = ", ".join(kind for kind in self.kinds if discharges or kind not in DISCHARGE_KINDS)
        for kind in kinds:
            if kind in DISCHARGE_KINDS and not discharges:
                raise ValueError(
                    f"kind {kind!r} is a fault of a discharge, and {name!r} has none; "
                    f"one of {possible} would be right"
                )
            if kind not in self.kinds:
                raise ValueError(f"kind {kind!r} has no meaning here; one of {possible} would be right")
        if shared and not (discharges and set(DISCHARGE_KINDS) <= set(self.kinds)):
            raise ValueError(
                f"shared is True, and here no thrusters of {name!r} share a capacitor; "
                "shared=False would be right"
            )

    # What tasks do with it -----------------------------------------------------------------------------

    def begin(
        self,
        which: NDArray[np.int64],
        keys: NDArray[np.uint64],
        episodes: NDArray[np.uint64],
        faults: FaultPlan,
    ) -> None:
        """Put the craft of some worlds back to the start of an episode: at rest at the origin, whole.

        Args:
            which: (k,), the worlds.
            keys: (worlds, 2), low and high half of every world's seed.
            episodes: (worlds,), number of the episode that begins, from 0.
            faults: What they carry, or from what it is drawn, as :meth:`plan` gives it.
        """
        _begin(
            self.data, self.faults, self.streams, which, keys, episodes, self.craft,
            self.spacecraft.mass, self.wrenches, self._tilts, faults.rows, faults.table, faults.drawn,
        )  # fmt: skip
        if self._modulated is not None:
            modulated_flight.draw_phases(self.data, self.streams, which, self.craft, self.layout.phase)

    def look(self, which: NDArray[np.int64]) -> None:
        """Let the sensors of some worlds look at where their craft start."""
        _first_look(self.data, self.streams, self.constants, which, self.craft)

    def fly(self, *, move: bool = True) -> None:
        """Advance every craft by one control period, under the duties that stand in ``data``.

        ``move`` False fires the thrusters (impulse, delivered on-times) and leaves the craft where they are.
        """
        if self.threads == 1:
            self._fly(move, 0, self.blocks)
        else:
            run_shared(lambda first, last: self._fly(move, first, last), self.shares)

    def by_worlds(self, work: Callable[[int, int], None]) -> None:
        """Call ``work(first, last)`` so that it covers all worlds, in as many threads as the fleet flies in.

        ``work`` must release the interpreter lock to gain by it, and touch only the worlds it is given.
        """
        if self.threads == 1:
            work(0, self.worlds)
        else:
            run_shared(work, self._world_shares)

    def _fly(self, move: bool, first: int, last: int) -> None:
        if self._modulated is not None:
            fly = modulated_flight.fly_singly if self.lanes == 1 else modulated_flight.fly_blocks
            fly(self.data, self.faults, self.streams, self._modulated, move, first, last)
            return
        self._kernel(
            self.data, self.faults, self.streams, self.thrusters, self.constants,
            self._networks, self._starts, *self._inertia, self._radius, self._dynamic, move, first, last,
        )  # fmt: skip

    # Reading and writing by world and craft ------------------------------------------------------------

    def read(self, row: int, count: int = 1) -> FloatArray:
        """A copy of ``count`` rows from ``row`` on, as (worlds, craft, count)."""
        rows = self.data[:, row : row + count].transpose(0, 2, 1).reshape(-1, count)
        return rows[: self.worlds * self.craft].reshape(self.worlds, self.craft, count).copy()

    def write(self, row: int, values: ArrayLike) -> None:
        """Write (worlds, craft, count) values into the rows from ``row`` on."""
        array = np.asarray(values, dtype=np.float64)
        flat = np.broadcast_to(array, (self.worlds, self.craft, array.shape[-1])).reshape(-1, array.shape[-1])
        for body in range(flat.shape[0]):
            self.data[body // self.lanes, row : row + flat.shape[1], body % self.lanes] = flat[body]

    def fault_rows(self, which: NDArray[np.int64] | None = None) -> FloatArray:
        """A copy of the encoded faults of some worlds, or of all: (worlds, craft, slots, 10)."""
        worlds = self.everyone if which is None else which
        bodies = worlds[:, np.newaxis] * self.craft + np.arange(self.craft)
        rows: FloatArray = self.faults[bodies // self.lanes, bodies % self.lanes]
        return rows[..., : len(code.FAULT_FIELDS)].copy()

    def struck(self, time: ArrayLike) -> BoolArray:
        """Whether each of the encoded faults strikes at ``time`` (worlds,), s: (worlds, craft, slots).

        After its onset and before its end, on a thruster of the branch in use.
        """
        strikes = np.zeros((self.worlds, self.craft, self.slots), np.bool_)
        _struck(self.faults, np.asarray(time, dtype=np.float64), strikes)
        return strikes

    def active(self, steps: NDArray[np.int64], first: int, count: int) -> BoolArray:
        """Which of the encoded faults act after ``steps`` (worlds,) periods: (worlds, count, slots).

        Of ``count`` craft of each world from ``first`` on.
        """
        active = np.empty((self.worlds, count, self.slots), np.bool_)
        _active(self.faults, steps, self.spacecraft.control_period, self.craft, first, active)
        return active

    def pulse_delays(self) -> FloatArray:
        """(worlds, craft, n): from its command to its opening, s, of the pulse commanded last, told or not.

        Behind a modulator only; 0 before the first command.
        """
        layout, n = self.layout, self.layout.thrusters
        if not layout.carried:
            return np.zeros((self.worlds, self.craft, n))
        opening = np.array([thruster.opening_delay for thruster in self.spacecraft.thrusters])
        opens = self.read(layout.pending + 3 * (layout.carried - 1) * n, n)
        flown = self.read(at.STEP) > 0.0
        return np.where(flown, opens + self.spacecraft.control_period - opening, 0.0)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Everything that a later period depends on, as copies."""
        return {"data": self.data.copy(), "faults": self.faults.copy(), "streams": self.streams.copy()}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Go back to what :meth:`state` gave, for a fleet of the same sizes."""
        for name, array in state.items():
            getattr(self, name)[...] = array


#: Seconds; a valve level that takes no longer to rise or fall jumps.
_NO_TIME = 1e-30


def _thruster_constants(spacecraft: Spacecraft) -> FloatArray:
    """(THRUSTER_ROWS, n): the constants of each thruster that the kernels read."""
    rows = np.zeros((at.THRUSTER_ROWS, spacecraft.number_of_thrusters))
    for i, thruster in enumerate(spacecraft.thrusters):
        rows[at.THRUST, i] = thruster.thrust
        rows[at.MINIMUM_PULSE, i] = thruster.minimum_pulse
        rows[at.OPENING_DELAY, i] = thruster.opening_delay
        rows[at.CLOSING_DELAY, i] = thruster.closing_delay
        rows[at.RISE_RATE, i] = 1.0 / max(thruster.rise_time, _NO_TIME)
        rows[at.FALL_RATE, i] = 1.0 / max(thruster.fall_time, _NO_TIME)
        rows[at.SCATTER, i] = thruster.scatter
        rows[at.LAG_RATE, i] = 1.0 / max(thruster.time_constant, _NO_TIME)
        rows[at.FLOW_PER_THRUST, i] = 1.0 / (thruster.specific_impulse * STANDARD_GRAVITY)
    rows[at.BELIEVED : at.BELIEVED + 6] = spacecraft.effectiveness()
    return rows


#: m/s^2, turns a specific impulse in seconds into an exhaust speed.
STANDARD_GRAVITY = 9.80665


def _scalar_constants(spacecraft: Spacecraft, max_substep: float | None) -> FloatArray:
    """(CONSTANTS,): the vehicle's scalars that the kernels read."""
    values = np.zeros(at.CONSTANTS)
    period = spacecraft.control_period
    orbit = ORBIT_TURN / spacecraft.mean_motion
    values[at.PERIOD], values[at.MAX_SUBSTEP] = period, max_substep or min(period, orbit)
    values[at.TURN_LIMIT] = TURN_LIMIT if max_substep is None else np.inf
    values[at.TWIST_LIMIT] = TWIST_LIMIT if max_substep is None else np.inf
    values[at.SHORT_SUBSTEP] = SHORT_SUBSTEP if max_substep is None else values[at.MAX_SUBSTEP]
    values[at.WAVE_PART] = SHORT_SUBSTEP if max_substep is None else max_substep
    far = MODULATED_TURN if spacecraft.modulator is not None else FAR_TURN
    values[at.FAR_TURN] = far if max_substep is None else np.inf
    values[at.FAR_TWIST] = FAR_TWIST if max_substep is None else np.inf
    values[at.GYROSCOPY], values[at.SPIN_UP] = _gyroscopy(spacecraft), spin_up(spacecraft)
    values[at.SPIN_PER_TORQUE] = 1.0 / np.linalg.eigvalsh(np.array(spacecraft.inertia)).min()
    values[at.MEAN_MOTION], values[at.COUPLING] = spacecraft.mean_motion, spacecraft.feed.coupling
    values[at.DRY_MASS] = max(0.0, spacecraft.mass - spacecraft.feed.propellant_mass)
    sensors = spacecraft.sensors
    values[at.UNIFORM_ERRORS] = 1.0 if sensors.distribution == "uniform" else 0.0
    values[at.SIGMA_POSITION], values[at.SIGMA_VELOCITY] = sensors.position, sensors.velocity
    values[at.SIGMA_ATTITUDE], values[at.SIGMA_RATE] = sensors.attitude, sensors.rate
    drift = transition_matrix(spacecraft.mean_motion, spacecraft.control_period)[3:]
    values[at.VELOCITY_DRIFT : at.VELOCITY_DRIFT + 18] = drift.reshape(-1)
    return values


#: Shortest control period of a craft that flies, s; largest error of a measured attitude, rad.
SHORTEST_PERIOD, COARSEST_ATTITUDE = 1e-3, 1.0


def check_flyable(spacecraft: Spacecraft, max_substep: float | None = None) -> None:
    """Refuse a vehicle whose flight cannot be followed within :data:`ERROR`.

    With a longest sub-step of the user's own how far it turns in one is the user's to know.

    Raises:
        ValueError: One line with the number that is out of reach.
    """
    name, period, n = spacecraft.name, spacecraft.control_period, spacecraft.mean_motion
    longest = flight.MOST_SUBSTEPS * SHORT_SUBSTEP
    if not SHORTEST_PERIOD <= period <= longest:
        raise ValueError(
            f"control_period of {name!r} must be from {SHORTEST_PERIOD:g} to {longest:g} s to be flown, "
            f"got {period!r}"
        )
    # By how much the orbit may turn in a period: modulated craft have sub-steps of 0.1 s at the longest.
    turn, most = n * period, 0.1 if spacecraft.discharge is not None else 1.0
    if turn > most or (spacecraft.modulator is not None and n * MODULATED_SUBSTEP > ORBIT_TURN):
        raise ValueError(
            f"mean_motion of {name!r} must be at most {most / period:g} rad/s, "
            f"{most:g} rad in a control period, to be flown, got {n!r}"
        )
    if spacecraft.sensors.attitude > COARSEST_ATTITUDE:
        raise ValueError(
            f"sensors: attitude of {name!r} must be at most {COARSEST_ATTITUDE:g} rad, "
            f"got {spacecraft.sensors.attitude!r}"
        )
    firing = period if spacecraft.discharge is None else spacecraft.discharge.firing_time
    used = firing * sum(
        (1.0 + one.scatter) * one.thrust / (one.specific_impulse * STANDARD_GRAVITY)
        for one in spacecraft.thrusters
    )
    dry = spacecraft.mass - min(spacecraft.feed.propellant_mass, spacecraft.mass)
    if used > 0.0 and not used < dry:
        raise ValueError(
            f"all thrusters of {name!r} use up to {used:.3g} kg in a control period, which must be less than "
            f"its mass without propellant, {dry:.3g} kg"
        )
    acceleration = spin_up(spacecraft)
    rate = acceleration * period
    constants = _scalar_constants(spacecraft, max_substep).tolist()
    wanted = period * flight.substep_rate.py_func(rate, acceleration, constants)
    if not wanted <= flight.MOST_SUBSTEPS:
        raise ValueError(
            f"the thrusters of {name!r} can turn it to {rate:.3g} rad/s in a control period of {period:g} s, "
            f"which takes {wanted:.3g} integration sub-steps and must take at most {flight.MOST_SUBSTEPS}; "
            "a larger inertia, weaker thrusters or a shorter control_period would do"
        )


def spin_up(spacecraft: Spacecraft) -> float:
    """Largest angular acceleration that the thrusters can give together, rad/s^2; none where they pulse."""
    if spacecraft.discharge is not None:
        return 0.0
    return math.hypot(*spacecraft.authority()[3:].tolist()) / spacecraft.control_period


def _gyroscopy(spacecraft: Spacecraft) -> float:
    """Largest difference of two principal moments of inertia over the third."""
    a, b, c = np.linalg.eigvalsh(np.array(spacecraft.inertia))
    return float(max((c - b) / a, (c - a) / b, (b - a) / c))


def _symmetric(matrix: FloatArray) -> tuple[float, ...]:
    """The diagonal of a symmetric matrix, followed by (xy, xz, yz) unless these are zero."""
    upper = matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()
    return tuple(upper if any(upper[3:]) else upper[:3])


def _tilted_wrenches(spacecraft: Spacecraft) -> FloatArray:
    """(2, n, 6): the wrench of each thruster if it pointed square to its direction, azimuth 0 and 90 deg."""
    wrenches = np.zeros((2, spacecraft.number_of_thrusters, 6))
    for i, thruster in enumerate(spacecraft.thrusters):
        direction = np.array(thruster.direction)
        axis = np.zeros(3)
        axis[int(np.argmin(np.abs(direction)))] = 1.0
        first = np.cross(direction, axis)
        first /= np.linalg.norm(first)
        for k, across in enumerate((first, np.cross(direction, first))):
            force = thruster.thrust * across
            wrenches[k, i] = np.concatenate((force, np.cross(thruster.position, force)))
    return wrenches


@cache
def _sorting_network(size: int) -> NDArray[np.int64]:
    """Batcher's odd-even merge sort of ``size`` rows: (p, 2), pairs i < j to be put in order in turn."""
    return np.array(list(_comparators(size)), dtype=np.int64).reshape(-1, 2)


def _comparators(size: int) -> Iterator[tuple[int, int]]:
    p = 1
    while p < size:
        k = p
        while k >= 1:
            for j in range(k % p, size - k, 2 * k):
                for i in range(min(k, size - j - k)):
                    if (i + j) // (2 * p) == (i + j + k) // (2 * p):
                        yield i + j, i + j + k
            k //= 2
        p *= 2


@kernel
def _begin(
    data, faults, streams, which, keys, episodes, craft, mass, wrenches, tilts, rows, table, drawn
):  # fmt: skip
    n, lanes, width = wrenches.shape[0], data.shape[2], rows.shape[2]
    slots = faults.shape[2]
    fresh = np.zeros((craft, slots, width))
    for k in range(which.shape[0]):
        world = which[k]
        if drawn:
            draw_faults(fresh, table, n, episodes[world], keys[world, 0], keys[world, 1])
        else:
            fresh[:] = rows
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w] = keys[world, 0], keys[world, 1]
            streams[b, at.EPISODE, w], streams[b, at.CRAFT, w] = episodes[world], c
            for row in range(at.SCALARS + 5 * n):
                data[b, row, w] = 0.0
            for row in range(at.SCALARS + 11 * n, data.shape[1]):
                data[b, row, w] = 0.0
            data[b, at.ATTITUDE, w], data[b, at.MEASURED + 6, w] = 1.0, 1.0
            data[b, at.MASS, w] = mass
            for i in range(n):
                for row in range(6):
                    data[b, at.SCALARS + 5 * n + 6 * i + row, w] = wrenches[i, row]
            for slot in range(slots):
                for column in range(width):
                    faults[b, w, slot, column] = fresh[c, slot, column]
                i = int(fresh[c, slot, code.FIELD_THRUSTER])
                if i >= n:  # of the spare branch, which is not in use yet
                    i -= n
                    faults[b, w, slot, code.FIELD_THRUSTER] = i
                    faults[b, w, slot, code.FIELD_KIND] *= -1.0
                azimuth = fresh[c, slot, code.FIELD_AZIMUTH]
                for column in range(6):
                    faults[b, w, slot, at.FAULT_TILTED + column] = (
                        np.cos(azimuth) * tilts[0, i, column] + np.sin(azimuth) * tilts[1, i, column]
                    )


@kernel
def _struck(faults, time, strikes):
    lanes, craft = faults.shape[1], strikes.shape[1]
    for world in range(strikes.shape[0]):
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            for slot in range(strikes.shape[2]):
                fault = faults[b, w, slot]
                strikes[world, c, slot] = (
                    fault[code.FIELD_KIND] > 0.0
                    and fault[code.FIELD_ONSET] <= time[world] < fault[code.FIELD_END]
                )


@kernel
def _active(faults, steps, period, craft, first, active):
    lanes = faults.shape[1]
    for world in range(active.shape[0]):
        time = steps[world] * period
        for c in range(active.shape[1]):
            body = world * craft + first + c
            b, w = body // lanes, body % lanes
            for slot in range(active.shape[2]):
                fault = faults[b, w, slot]
                active[world, c, slot] = (
                    fault[code.FIELD_KIND] > 0.0
                    and fault[code.FIELD_ONSET] <= time
                    and time < fault[code.FIELD_END]
                )


@kernel
def _first_look(data, streams, constants, which, craft):
    lanes = data.shape[2]
    for k in range(which.shape[0]):
        for c in range(craft):
            b, w = (which[k] * craft + c) // lanes, (which[k] * craft + c) % lanes
            episode, key = streams[b, at.EPISODE, w], (streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w])
            purpose = np.uint64(RESET << 32) | np.uint64(c)
            a = philox(np.uint64(0), np.uint64(0), episode, purpose, key[0], key[1])
            z = philox(np.uint64(1), np.uint64(0), episode, purpose, key[0], key[1])
            uniform = constants[at.UNIFORM_ERRORS] > 0.0
            n0, n1 = uniform_errors(a[0]) if uniform else normal_pair(a[0])
            n2, n3 = uniform_errors(a[1]) if uniform else normal_pair(a[1])
            n4, n5 = uniform_errors(a[2]) if uniform else normal_pair(a[2])
            n6, n7 = uniform_errors(a[3]) if uniform else normal_pair(a[3])
            n8, n9 = uniform_errors(z[0]) if uniform else normal_pair(z[0])
            n10, n11 = uniform_errors(z[1]) if uniform else normal_pair(z[1])
            truth = (
                data[b, 0, w], data[b, 1, w], data[b, 2, w], data[b, 3, w], data[b, 4, w], data[b, 5, w],
                data[b, 6, w], data[b, 7, w], data[b, 8, w], data[b, 9, w], data[b, 10, w], data[b, 11, w],
                data[b, 12, w],
            )  # fmt: skip
            errors = (n0, n1, n2, n3, n4, n5, n6, n7, n8, n9, n10, n11)
            write_measurement(b, w, data, measure(truth, errors, constants))
