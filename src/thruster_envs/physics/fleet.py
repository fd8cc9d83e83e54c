"""A batch of worlds, each with one or several like craft: the arrays, and the calls that move them.

This is the host side of the compiled kernels. It knows nothing of tasks, rewards or episodes: a task begins
some worlds, writes where their craft start, commands duties and flies a period.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults import (
    DISCHARGE_KINDS,
    MODULATOR_KINDS,
    SENSORS,
    THRUSTER_KINDS,
    Fault,
    FaultDistribution,
    encode,
)
from thruster_envs.faults import encoding as code
from thruster_envs.faults.kinds import GYRO_KINDS, WHEEL_KINDS
from thruster_envs.faults.sampling import draw_faults
from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import health, modulated_flight
from thruster_envs.physics import rows as at
from thruster_envs.physics.body import MOST_SUBSTEPS, substep_rate, write_frame_rate
from thruster_envs.physics.firing import STANDARD_GRAVITY
from thruster_envs.physics.orbits import (
    Elements,
    Ellipse,
    anomaly_at_start,
    frame_rate,
    kind_of,
    open_elements,
    osculating,
    read_reference,
    reference_at,
    write_reference,
)
from thruster_envs.physics.period import choose_lanes, choose_period
from thruster_envs.physics.pulsed_craft import MEASURED, PulsedFlight
from thruster_envs.physics.sensing import (
    apply_first_sensor_faults,
    apply_sensor_faults,
    find_stale,
    measure,
    uniform_errors,
    write_measurement,
)
from thruster_envs.physics.vehicle import (
    MODULATED_SUBSTEP,
    ORBIT_TURN,
    SHORT_SUBSTEP,
    arrange_rows,
    open_batch,
    open_vehicle,
    pack_pulses,
    pack_vehicle,
    scalar_constants,
    spin_up,
    tilted_wrenches,
)
from thruster_envs.random import ANOMALY, RESET, normal_pair, philox, uniform_pair
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.threads import physical_cores, run_shared

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Threads pay from this many craft on.
MANY_CRAFT = 1024


@dataclass(frozen=True)
class FaultPlan:
    """Encoded faults of a world: the rows (craft, slots, 13), and the table from which they are drawn, if so.

    ``of_sensors`` says whether some are, or may be, faults of sensors.
    """

    rows: FloatArray
    table: FloatArray | None
    of_sensors: bool


class Fleet:
    """Craft of one kind in many worlds.

    Args:
        spacecraft: What every craft is, nominally. What is true of each one stands in the arrays.
        worlds: Number of worlds.
        craft: Number of craft in each world.
        slots: Faults that one craft can have at once.
        nonlinear: Full two-body relative motion instead of the linear equations, which are Hill's on a
            circular orbit; with J2 it is never linear.
        max_substep: Longest integration sub-step, s; None lets each craft take as many as its turning needs,
            and those behind a modulator equal ones of at most 0.1 s.
        threads: Threads that share a period's work; None takes one below 1,024 craft and one per core above.
            Results do not depend on it.
        kinds: Kinds of fault that what flies the fleet knows; None for those of the actuators that the
            spacecraft has.
        sensors: The sensors whose faults have a meaning for what flies the fleet; None for all that measure
            something.
        pulsed: Given, thrusters fire as pulsed plasma thrusters do, and the craft only turn; None lets them
            fire as their valves or their modulator do.

    Attributes:
        data: (blocks, fields, lanes) float64, laid out as :mod:`thruster_envs.physics.rows` says.
        faults: (blocks, lanes, slots, 19) float64, those of thrusters.
        sensor_faults: (blocks, lanes, slots, 13) float64, those of sensors, in slots that `faults` leaves
            empty.
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
        kinds: tuple[str, ...] | None = None,
        sensors: tuple[str, ...] | None = None,
        pulsed: PulsedFlight | None = None,
    ) -> None:
        self.kinds = _kinds_of(spacecraft, pulsed) if kinds is None else kinds
        self.sensors = (SENSORS if pulsed is None else MEASURED) if sensors is None else sensors
        self.spacecraft, self.worlds, self.craft, self.slots = spacecraft, worlds, craft, slots
        bodies = worlds * craft
        self.everyone = np.arange(worlds)
        self.lanes = choose_lanes(bodies, pulsed=spacecraft.discharge is not None)
        self.blocks = -(-bodies // self.lanes)
        self.rows = arrange_rows(spacecraft)
        self.data = np.zeros((self.blocks, self.rows.fields, self.lanes))
        self.faults = np.zeros((self.blocks, self.lanes, slots, at.FAULT_WIDTH))
        self.sensor_faults = np.zeros((self.blocks, self.lanes, slots, len(code.FAULT_FIELDS)))
        #: Whether any craft may have the fault of a sensor: without, nothing is spent on them.
        self.sensors_fail = False
        self.streams = np.zeros((self.blocks, at.STREAM_ROWS, self.lanes), np.uint64)
        self.data[:, at.ATTITUDE] = 1.0
        self.data[:, at.MEASURED + 6] = 1.0
        self.data[:, at.MASS] = spacecraft.mass
        self._put_frames(nonlinear)
        self.wrenches = np.ascontiguousarray(spacecraft.wrenches().T)
        self._tilts = tilted_wrenches(spacecraft)
        self.storage_faults = np.zeros_like(self.sensor_faults) if spacecraft.stores_momentum else None
        if self.storage_faults is not None:
            self.saved = (*self.saved, "storage_faults")
        self.arrays = (self.data, self.faults, self.streams, self.storage_faults)
        #: (n,), number of the capacitor of each thruster; 0 without one.
        self.capacitors = np.array([thruster.capacitor for thruster in spacecraft.thrusters])
        constants = scalar_constants(spacecraft, max_substep)
        #: What the kernels take of the vehicle.
        self.vehicle = pack_vehicle(
            spacecraft,
            constants if pulsed is None else pulsed.turning(constants, spacecraft, slots),
            nonlinear=nonlinear,
            max_substep=max_substep,
            pulses=None if pulsed is None else pack_pulses(pulsed.pulses_of(spacecraft, max_substep)),
        )
        self._kernel = choose_period(self.lanes, self.vehicle)
        wanted = threads if threads is not None else (physical_cores() if bodies >= MANY_CRAFT else 1)
        self.threads = max(1, min(wanted, self.blocks))
        edges = np.linspace(0, self.blocks, self.threads + 1).astype(int).tolist()
        #: The blocks that each thread works on: (first, one past the last).
        self.shares: list[tuple[int, int]] = list(pairwise(edges))
        edges = np.linspace(0, worlds, self.threads + 1).astype(int).tolist()
        self._world_shares: list[tuple[int, int]] = list(pairwise(edges))

    def _put_frames(self, nonlinear: bool) -> None:
        """Let LVLH stand where an episode without a draw begins, in all worlds."""
        orbit, elements = self.spacecraft.reference_orbit, Elements.of(self.spacecraft.reference_orbit)
        #: Whether LVLH turns at one rate all the time.
        self.steady = orbit.is_steady
        self._elements, kind = tuple(elements), kind_of(orbit, nonlinear=nonlinear)
        reference = reference_at(kind, elements, anomaly_at_start.py_func(elements, 0.5))
        numbers = np.atleast_1d([] if reference is None else reference)[:, np.newaxis]
        for first in {self.rows.reference, self.rows.first_reference}:
            count = min(numbers.size, self.rows.fields - first)
            self.data[:, first : first + count] = numbers[:count]
        rate = frame_rate(kind, reference)
        self.data[:, at.FRAME_RATE], self.data[:, at.FRAME_RATE + 1] = rate[0], rate[2]

    def plan(self, source: Sequence[Fault] | FaultDistribution) -> FaultPlan:
        """Faults in the form in which :meth:`begin` takes them.

        Raises:
            ValueError: A craft or thruster that does not exist, more faults than slots, a dwell that is
                shorter than can be followed, or a kind that the spacecraft or what flies it does not know.
        """
        self._check_kinds(source)
        n, period = self.rows.thrusters, self.spacecraft.control_period
        spare = n if self.spacecraft.modulator is not None and self.spacecraft.spare_branch else 0
        if isinstance(source, FaultDistribution):
            shortest = source.profile_time[0]
            waves = "intermittent" in source.kind_weights() or "intermittent" in source.profiles
            table = source.encode(
                n, self.craft, spare=spare, wheels=self.rows.number_of_wheels,
                gyros=self.rows.number_of_gyros, sensors=self.sensors,
            )  # fmt: skip
            rows = np.zeros((self.craft, self.slots, len(code.FAULT_FIELDS)))
            of_sensors = source.sensor_probability > 0.0
            if source.count[1] > self.slots:
                raise ValueError(
                    f"count is {source.count!r}; at most {self.slots} faults (fault_slots) would be right"
                )
            most = source.sensor_count[1] + (source.count[1] if source.probability > 0.0 else 0)
            if of_sensors and most > self.slots:
                raise ValueError(
                    f"count and sensor_count must together be at most {self.slots} (fault_slots), got "
                    f"{source.count} and {source.sensor_count}"
                )
        else:
            rows, table = (
                encode(
                    source,
                    self.craft,
                    n,
                    self.slots,
                    spare=spare,
                    wheels=self.rows.number_of_wheels,
                    gyros=self.rows.number_of_gyros,
                ),
                None,
            )
            dwelling = [fault.profile_time for fault in source if fault.profile == "intermittent"]
            shortest, waves = min(dwelling, default=math.inf), bool(dwelling)
            of_sensors = any(fault.sensor is not None for fault in source)
        if waves and shortest < period:
            raise ValueError(
                f"profile_time of an intermittent fault is {shortest:g} s; "
                f"at least the control period, {period:g} s, would be right"
            )
        return FaultPlan(rows, table, of_sensors)

    def _check_kinds(self, source: Sequence[Fault] | FaultDistribution) -> None:
        if isinstance(source, FaultDistribution):
            kinds, shared = tuple(source.kind_weights()), source.shared
            failing = source.sensors or self.sensors if source.sensor_probability > 0.0 else ()
            if source.sensor_probability > 0.0 and not self.sensors:
                raise ValueError(
                    "sensor_probability must be 0 where no sensor is modelled, got "
                    f"{source.sensor_probability:g}"
                )
        else:
            kinds = tuple(fault.kind for fault in source if fault.sensor is None)
            shared = any(fault.shared for fault in source)
            failing = tuple(fault.sensor for fault in source if fault.sensor is not None)
        for sensor in failing:
            if sensor not in self.sensors:
                which = f"must be one of {', '.join(self.sensors)}" if self.sensors else "has no meaning"
                raise ValueError(f"sensor {which} here, got {sensor!r}")
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

        Where the orbit disperses the true anomaly at the start, it is drawn from the world's own stream.

        Args:
            which: (k,), the worlds.
            keys: (worlds, 2), low and high half of every world's seed.
            episodes: (worlds,), number of the episode that begins, from 0.
            faults: What they carry, or from what it is drawn, as :meth:`plan` gives it.
        """
        self.sensors_fail |= faults.of_sensors
        rows = faults.rows[np.newaxis]
        if faults.table is not None:
            rows = np.empty((len(which), *faults.rows.shape))
            _draw(rows, faults.table, self.rows.thrusters, which, keys, episodes)
        _begin(
            self.arrays, self.vehicle, which, (keys, episodes),
            (self.craft, self.spacecraft.mass, self.wrenches, self._tilts, self._elements), rows,
            (self.sensor_faults, self.sensors_fail),
        )  # fmt: skip
        if self.storage_faults is not None:
            _begin_storage(
                self.arrays, self.vehicle, which, self.craft,
                np.array([one.initial_speed for one in self.spacecraft.reaction_wheels], np.float64),
                np.array([one.initial_angle for one in self.spacecraft.control_moment_gyros], np.float64),
            )  # fmt: skip
        if self.spacecraft.modulator is not None:
            modulated_flight.draw_phases(self.data, self.streams, which, self.craft, self.rows.phase)

    def look(self, which: NDArray[np.int64]) -> None:
        """Let the sensors of some worlds measure where their craft start."""
        _first_look(self.data, self.streams, self.vehicle, which, self.craft)
        if self.sensors_fail:
            apply_first_sensor_faults(self.arrays, self.sensor_faults, self.vehicle, which, self.craft)

    def ellipses(self) -> FloatArray | None:
        """The orbit of each world as it is now: (worlds, 7), or None where LVLH turns steadily.

        In the order of :class:`.orbits.Ellipse`. With J2 it is the osculating one.
        """
        if self.steady:
            return None
        ellipses = np.empty((self.worlds, len(Ellipse._fields)))
        _find_ellipses(self.data, self.vehicle, self.craft, ellipses)
        return ellipses

    def fly(self, *, move: bool = True) -> None:
        """Advance every craft by one control period, under the duties that stand in ``data``.

        ``move`` False fires the thrusters (impulse, delivered on-times) and leaves the craft where they are.
        """
        fly = self._fly_and_measure if self.sensors_fail and move else self._fly
        if self.threads == 1:
            fly(move, 0, self.blocks)
        else:
            run_shared(lambda first, last: fly(move, first, last), self.shares)

    def _fly(self, move: bool, first: int, last: int) -> None:
        self._kernel(self.arrays, self.vehicle, move, first, last)

    def _fly_and_measure(self, move: bool, first: int, last: int) -> None:
        """Fly a period where sensors may fail."""
        before = self.data[first:last, at.MEASURED : at.MEASURED + 13].copy()
        self._fly(move, first, last)
        apply_sensor_faults(
            self.arrays, self.sensor_faults, self.vehicle, before, "velocity" in self.sensors, first, last
        )

    def by_worlds(self, work: Callable[[int, int], None]) -> None:
        """Call ``work(first, last)`` so that it covers all worlds, in as many threads as the fleet flies in.

        ``work`` must release the interpreter lock to gain by it, and touch only the worlds it is given.
        """
        if self.threads == 1:
            work(0, self.worlds)
        else:
            run_shared(work, self._world_shares)

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

    def describe_faults(
        self, which: NDArray[np.int64], first: int, described: tuple[NDArray[Any], ...]
    ) -> None:
        """Write what the encoded faults of some worlds are into arrays (worlds, craft, slots).

        Args:
            which: (k,), the worlds.
            first: The first of their craft that the arrays are about.
            described: Number of the thruster from 1, those of a redundant branch after the others; code of
                the kind; severity; onset, s; code of the sensor; axis.
        """
        stored = self.faults if self.storage_faults is None else self.storage_faults
        for faults in {id(one): one for one in (self.faults, self.sensor_faults, stored)}.values():
            fresh = faults is self.faults
            _describe(faults, which, (self.craft, first, self.rows.thrusters), fresh, described)

    def fault_rows(self, which: NDArray[np.int64] | None = None) -> FloatArray:
        """A copy of the encoded faults of some worlds, or of all: (worlds, craft, slots, 13)."""
        worlds = self.everyone if which is None else which
        bodies = worlds[:, np.newaxis] * self.craft + np.arange(self.craft)
        places = bodies // self.lanes, bodies % self.lanes
        rows: FloatArray = self.faults[places][..., : len(code.FAULT_FIELDS)]
        rows += self.sensor_faults[places]  # all but one are empty
        if self.storage_faults is not None:
            rows += self.storage_faults[places]
        return rows

    def struck(self, time: ArrayLike) -> BoolArray:
        """Whether each of the encoded faults strikes at ``time`` (worlds,), s: (worlds, craft, slots).

        After its onset and before its end, on a sensor or a thruster of the branch in use.
        """
        strikes = np.zeros((self.worlds, self.craft, self.slots), np.bool_)
        _struck(self.faults, np.asarray(time, dtype=np.float64), strikes)
        if self.sensors_fail:
            _struck(self.sensor_faults, np.asarray(time, dtype=np.float64), strikes)
        if self.storage_faults is not None:
            _struck(self.storage_faults, np.asarray(time, dtype=np.float64), strikes)
        return strikes

    def active(self, steps: NDArray[np.int64], first: int, count: int) -> BoolArray:
        """Which of the encoded faults act after ``steps`` (worlds,) periods: (worlds, count, slots).

        Of ``count`` craft of each world from ``first`` on.
        """
        active = np.zeros((self.worlds, count, self.slots), np.bool_)
        period = self.spacecraft.control_period
        _active(self.faults, steps, period, self.craft, first, active)
        if self.sensors_fail:
            _active(self.sensor_faults, steps, period, self.craft, first, active)
        if self.storage_faults is not None:
            _active(self.storage_faults, steps, period, self.craft, first, active)
        return active

    def stale(self) -> BoolArray:
        """Of which sensors the last measurement dropped out: (worlds, craft, sensors).

        In the order of :data:`thruster_envs.faults.SENSORS`.
        """
        stale = np.zeros((self.worlds, self.craft, len(SENSORS)), np.bool_)
        if self.sensors_fail:
            find_stale(self.arrays, self.sensor_faults, self.vehicle, stale)
        return stale

    def pulse_delays(self) -> FloatArray:
        """(worlds, craft, n): from its command to its opening, s, of the pulse commanded last, told or not.

        Behind a modulator only; 0 before the first command.
        """
        rows, n = self.rows, self.rows.thrusters
        if not rows.carried:
            return np.zeros((self.worlds, self.craft, n))
        opening = np.array([thruster.opening_delay for thruster in self.spacecraft.thrusters])
        opens = self.read(rows.pending + 3 * (rows.carried - 1) * n, n)
        flown = self.read(at.STEP) > 0.0
        return np.where(flown, opens + self.spacecraft.control_period - opening, 0.0)

    #: Names of the arrays that a later period depends on.
    saved: tuple[str, ...] = ("data", "faults", "sensor_faults", "streams")

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Everything that a later period depends on, as copies."""
        return {name: getattr(self, name).copy() for name in self.saved}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Go back to what :meth:`state` gave, for a fleet of the same sizes."""
        for name, array in state.items():
            getattr(self, name)[...] = array
        self.sensors_fail = bool(self.sensor_faults.any())


def _kinds_of(spacecraft: Spacecraft, pulsed: PulsedFlight | None) -> tuple[str, ...]:
    """Kinds of fault of the actuators that a spacecraft has."""
    kinds = THRUSTER_KINDS
    for has, more in (
        (pulsed is not None, DISCHARGE_KINDS),
        (spacecraft.modulator is not None, MODULATOR_KINDS),
        (spacecraft.reaction_wheels, WHEEL_KINDS),
        (spacecraft.control_moment_gyros, GYRO_KINDS),
    ):
        kinds += more if has else ()
    return kinds


#: Shortest control period of a craft that flies, s; largest error of a measured attitude, rad.
SHORTEST_PERIOD, COARSEST_ATTITUDE = 1e-3, 1.0


def check_flyable(spacecraft: Spacecraft, max_substep: float | None = None) -> None:
    """Refuse a vehicle whose flight cannot be followed within :data:`ERROR`.

    With a longest sub-step of the user's own how far it turns in one is the user's to know.

    Raises:
        ValueError: One line with the number that is out of reach.
    """
    name, period, orbit = spacecraft.name, spacecraft.control_period, spacecraft.reference_orbit
    n = orbit.fastest_rate
    longest = MOST_SUBSTEPS * SHORT_SUBSTEP
    if not SHORTEST_PERIOD <= period <= longest:
        raise ValueError(
            f"control_period of {name!r} must be from {SHORTEST_PERIOD:g} to {longest:g} s to be flown, "
            f"got {period!r}"
        )
    # By how much the orbit may turn in a period: modulated craft have sub-steps of 0.1 s at the longest.
    turn, most = n * period, 0.1 if spacecraft.discharge is not None else 1.0
    if turn > most or (spacecraft.modulator is not None and n * MODULATED_SUBSTEP > ORBIT_TURN):
        which = "mean_motion" if orbit.is_circular else "the rate at perigee"
        raise ValueError(
            f"{which} of {name!r} must be at most {most / period:g} rad/s, "
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
    constants = scalar_constants(spacecraft, max_substep)
    wanted = period * substep_rate.py_func(rate, acceleration, constants)
    if not wanted <= MOST_SUBSTEPS:
        whose = "thrusters, wheels and gyros" if spacecraft.stores_momentum else "thrusters"
        raise ValueError(
            f"the {whose} of {name!r} can turn it to {rate:.3g} rad/s in a control period of {period:g} s, "
            f"which takes {wanted:.3g} integration sub-steps and must take at most {MOST_SUBSTEPS}; "
            f"a larger inertia, weaker {whose} or a shorter control_period would do"
        )


@kernel
def _draw(rows, table, thrusters, which, keys, episodes):
    """Draw the faults of some worlds: ``rows`` (k, craft, slots, 13), filled."""
    for k in range(which.shape[0]):
        world = which[k]
        draw_faults(rows[k], table, thrusters, episodes[world], keys[world, 0], keys[world, 1])


@kernel
def _begin(arrays, parts, which, seeds, nominal, rows, of_sensors):
    """Begin an episode in some worlds; ``rows`` are their encoded faults, or the one set that all have."""
    batch = open_batch(arrays)
    data, faults, streams, storage_faults = batch.data, batch.faults, batch.streams, batch.storage_faults
    (keys, episodes), (craft, mass, wrenches, tilts, elements) = seeds, nominal
    sensor_faults, sensors_fail = of_sensors
    at_rows, n, lanes, width = open_vehicle(parts).rows, wrenches.shape[0], data.shape[2], rows.shape[3]
    slots = faults.shape[2]
    for k in range(which.shape[0]):
        world, fresh = which[k], rows[k if rows.shape[0] > 1 else 0]
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w] = keys[world, 0], keys[world, 1]
            streams[b, at.EPISODE, w], streams[b, at.CRAFT, w] = episodes[world], c
            for row in range(at_rows.columns):
                data[b, row, w] = 0.0
            for row in range(at_rows.pending, data.shape[1]):
                data[b, row, w] = 0.0
            data[b, at.ATTITUDE, w], data[b, at.MEASURED + 6, w] = 1.0, 1.0
            data[b, at.MASS, w] = mass
            _begin_frame(b, w, data, streams, open_vehicle(parts), open_elements(elements))
            for i in range(n):
                for row in range(6):
                    data[b, at_rows.columns + 6 * i + row, w] = wrenches[i, row]
            for slot in range(slots):
                row = fresh[c, slot]
                of_sensor = row[code.FIELD_SENSOR] > 0.0
                stores = not of_sensor and health.is_of_storage(row[code.FIELD_KIND])
                _put_storage_fault(storage_faults, b, w, slot, row, stores, width)
                if sensors_fail:
                    for column in range(width):
                        sensor_faults[b, w, slot, column] = row[column] if of_sensor else 0.0
                for column in range(width):
                    faults[b, w, slot, column] = 0.0 if of_sensor or stores else row[column]
                i = int(faults[b, w, slot, code.FIELD_THRUSTER])
                if i >= n:  # drawn of the redundant branch, which is not in use yet
                    i -= n
                    faults[b, w, slot, code.FIELD_THRUSTER] = i
                    faults[b, w, slot, code.FIELD_BRANCH] = code.REDUNDANT
                azimuth = row[code.FIELD_AZIMUTH]
                for column in range(6):
                    faults[b, w, slot, at.FAULT_TILTED + column] = (
                        np.cos(azimuth) * tilts[0, i, column] + np.sin(azimuth) * tilts[1, i, column]
                    )


@njit(forceinline=True)
def _begin_frame(b, w, data, streams, vehicle, elements):
    """Put LVLH of one craft where it stands at the start of the episode, which is the same in a world."""
    orbit, rows, block = vehicle.body.orbit, vehicle.rows, data[b]
    chance = 0.5
    if elements.true_anomaly_dispersion > 0.0:
        words = philox(
            np.uint64(0), np.uint64(0), streams[b, at.EPISODE, w], np.uint64(ANOMALY << 32),
            streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
        )  # fmt: skip
        chance, _ = uniform_pair(words[0])
    reference = reference_at(orbit, elements, anomaly_at_start(elements, chance))
    write_reference(orbit, block, rows.reference, w, reference)
    if vehicle.pulses is not None:
        write_reference(orbit, block, rows.first_reference, w, reference)
    write_frame_rate(w, block, orbit, reference)


@kernel
def _find_ellipses(data, parts, craft, ellipses):
    vehicle, lanes = open_vehicle(parts), data.shape[2]
    orbit, row = vehicle.body.orbit, vehicle.rows.reference
    for world in range(ellipses.shape[0]):
        b, w = world * craft // lanes, world * craft % lanes
        ellipse = osculating(orbit, read_reference(orbit, data[b], row, w))
        for k, number in enumerate(ellipse):
            ellipses[world, k] = number


@njit(forceinline=True)
def _put_storage_fault(storage_faults, b, w, slot, row, stores, width):
    """Keep the fault of a wheel or gyro, or empty its slot; nothing where the craft have none of these."""
    if storage_faults is not None:
        for column in range(width):
            storage_faults[b, w, slot, column] = row[column] if stores else 0.0


@kernel
def _begin_storage(arrays, parts, which, craft, speeds, angles):
    """Put rotors and gimbals of some worlds to their speeds and angles at the start."""
    data, rows, lanes = arrays[0], open_vehicle(parts).rows, arrays[0].shape[2]
    for world in which:
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            for i in range(speeds.shape[0]):
                data[b, rows.wheel_speeds + i, w] = speeds[i]
                data[b, rows.measured_speeds + i, w] = speeds[i]
            for j in range(angles.shape[0]):
                data[b, rows.gimbal_angles + j, w] = angles[j]
                data[b, rows.measured_angles + j, w] = angles[j]


@kernel
def _describe(faults, which, sizes, fresh, described):
    """Write what a slot holds, or where it is not ``fresh`` only what holds something."""
    (craft, first, n), lanes = sizes, faults.shape[1]
    thruster, kind, severity, onset, sensor, axis = described
    for world in which:
        for c in range(thruster.shape[1]):
            body = world * craft + first + c
            b, w = body // lanes, body % lanes
            for slot in range(faults.shape[2]):
                fault = health.read_fault(faults, b, w, slot)
                is_one = fault[code.FIELD_KIND] != code.EMPTY
                if is_one or fresh:
                    number = fault[code.FIELD_THRUSTER] + 1.0 + n * fault[code.FIELD_BRANCH]
                    thruster[world, c, slot] = int(number) if is_one else 0
                    kind[world, c, slot] = int(fault[code.FIELD_KIND])
                    severity[world, c, slot] = fault[code.FIELD_SEVERITY]
                    onset[world, c, slot] = fault[code.FIELD_ONSET]
                    sensor[world, c, slot] = int(fault[code.FIELD_SENSOR])
                    axis[world, c, slot] = int(fault[code.FIELD_AXIS])


@kernel
def _struck(faults, time, strikes):
    lanes, craft = faults.shape[1], strikes.shape[1]
    for world in range(strikes.shape[0]):
        for c in range(craft):
            b, w = (world * craft + c) // lanes, (world * craft + c) % lanes
            for slot in range(strikes.shape[2]):
                fault = health.read_fault(faults, b, w, slot)
                strikes[world, c, slot] |= health.is_between(fault, time[world])


@kernel
def _active(faults, steps, period, craft, first, active):
    lanes = faults.shape[1]
    for world in range(active.shape[0]):
        time = steps[world] * period
        for c in range(active.shape[1]):
            body = world * craft + first + c
            b, w = body // lanes, body % lanes
            for slot in range(active.shape[2]):
                fault = health.read_fault(faults, b, w, slot)
                active[world, c, slot] |= health.is_between(fault, time)


@kernel
def _first_look(data, streams, parts, which, craft):
    lanes, constants = data.shape[2], open_vehicle(parts).constants
    for k in range(which.shape[0]):
        for c in range(craft):
            b, w = (which[k] * craft + c) // lanes, (which[k] * craft + c) % lanes
            episode, key = streams[b, at.EPISODE, w], (streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w])
            purpose = np.uint64(RESET << 32) | np.uint64(c)
            a = philox(np.uint64(0), np.uint64(0), episode, purpose, key[0], key[1])
            z = philox(np.uint64(1), np.uint64(0), episode, purpose, key[0], key[1])
            uniform = constants.uniform_errors > 0.0
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
