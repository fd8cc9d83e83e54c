"""Flights on which detectors are measured: what was told, what was measured, and what was truly wrong.

Any source of such flights will do; here is the simplest, `RandomFlights`: a vehicle that fires at random and
measures its velocity after each interval, with the faults of a `FaultDistribution`. Modelled: the shared
feed, through which partly open valves take their share, the scatter of each firing, all kinds of fault but
misalignment, sensor errors of each velocity, so that those of consecutive rate changes are correlated as they
are in truth, and measurements that are missing, late or spoilt. A flight is a function of its seed alone.

Valves are those of the description (`Expectation`). Left out: motion without thrust and gyroscopic coupling,
which flights of the environments have, and propellant used; a fault acts as if all pulses began together. A
fault is as severe all through an interval as it is in the middle of it, so onsets on the grid of intervals
are exact.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.detection.contract import Telemetry
from thruster_envs.faults import KINDS, FaultDistribution
from thruster_envs.faults import encoding as code
from thruster_envs.faults.sampling import draw_faults
from thruster_envs.kernels import kernel
from thruster_envs.physics import health
from thruster_envs.physics.nominal_firing import Expectation
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FlightSource", "Flights", "RandomFlights", "RecordedFlights"]

_Flights = TypeVar("_Flights")


class RecordedFlights(Protocol):
    """What the yardstick of detectors needs of flights, whatever detectors are fed with in them."""

    @property
    def on_times(self) -> FloatArray:
        """(flights, intervals, n), s, as commanded."""
        ...

    @property
    def duration(self) -> float:
        """Of an interval, s."""
        ...

    @property
    def first_answer(self) -> float:
        """When the answer to the first interval or sample is there, s since the start."""
        ...

    @property
    def thruster(self) -> IntArray:
        """(flights,), the one that fails, from 1; 0 in a healthy flight."""
        ...

    @property
    def kind(self) -> tuple[str, ...]:
        """(flights,), of the fault, or `none`."""
        ...

    @property
    def severity(self) -> FloatArray:
        """(flights,); 0 in a healthy flight."""
        ...

    @property
    def onset(self) -> FloatArray:
        """(flights,), s since the start; infinite in a healthy flight."""
        ...

    def telemetry(self, flights: slice, interval: int) -> Telemetry:
        """What a detector is given of one interval or sample of some of them."""
        ...


@dataclass(frozen=True, slots=True)
class Flights:
    """Flights of equal length, and the fault of each.

    Attributes:
        on_times: (flights, intervals, n), s, as commanded.
        rate_change: (flights, intervals, m), m/s then rad/s, body axes, as measured, motion without thrust
            taken off.
        valid: (flights, intervals), where there is a measurement.
        duration: Of an interval, s.
        thruster: (flights,), the one that fails, from 1; 0 in a healthy flight.
        kind: (flights,), a kind of `thruster_envs.faults.KINDS`, or `none`.
        severity: (flights,), as `thruster_envs.faults.Fault` has it; 0 in a healthy flight.
        onset: (flights,), s since the start; infinite in a healthy flight.
        turning: (flights, intervals, 2, 3), as `Telemetry` has it; None where it is not measured.
        age: (flights, intervals), s: how much older than the end of the interval each measurement is, as
            `Detector.update` takes it; None for none of them.
        observations: (flights, intervals, size), what a player of the environment saw at the end of each
            interval; None where there is none. Only detectors that take an `observation` can be measured on
            such flights.
    """

    on_times: FloatArray
    rate_change: FloatArray
    valid: BoolArray
    duration: float
    thruster: IntArray
    kind: tuple[str, ...]
    severity: FloatArray
    onset: FloatArray
    age: FloatArray | None = None
    turning: FloatArray | None = None
    observations: NDArray[np.float32] | None = None

    @property
    def first_answer(self) -> float:
        """The end of the first interval, s."""
        return self.duration

    def telemetry(self, flights: slice, interval: int) -> Telemetry:
        """What a detector is given of one interval of some of them."""
        turning = None if self.turning is None else self.turning[flights, interval]
        return Telemetry(**self.step(flights, interval), turning=turning)

    def step(self, flights: slice, interval: int) -> dict[str, Any]:
        """The arguments of `Detector.update` for one interval of some of them."""
        at = (flights, interval)
        seen = {} if self.observations is None else {"observation": self.observations[at]}
        return seen | {
            "on_times": self.on_times[at],
            "rate_change": self.rate_change[at],
            "duration": self.duration,
            "valid": self.valid[at],
            "age": None if self.age is None else self.age[at],
        }


class FlightSource(Protocol):
    """Where flights come from."""

    def __call__(self, seeds: Sequence[int], faulty: bool) -> RecordedFlights:
        """One flight for each seed: all of them healthy, or each with one fault."""
        ...


@dataclass(frozen=True, kw_only=True)
class RandomFlights:
    """A vehicle that fires at random.

    Attributes:
        spacecraft: What flies.
        faults: What fails in a faulty flight. Exactly one fault strikes, whatever its `probability` and
            `count`.
        intervals: In a flight.
        duration: Of an interval, s.
        open_share: Probability that a thruster is told to fire in an interval.
        longest: Longest on-time, s; they are uniform up to it. By default the duration.
        bad_measurements: Share of the measurements that are bad: one quarter each is missing, no number, far
            outside of what the thrusters can do, and late, which is that of the interval before once more
            (before the first one: of a vehicle at rest), with its age. Without the age nobody could tell it
            from a fault: what was fired then and what is fired now differ as they please.

    Raises:
        ValueError: A value that cannot be.

    >>> from thruster_envs.spacecraft import load
    >>> source = RandomFlights(spacecraft=load("orion"), intervals=20)
    >>> flights = source(range(3), faulty=True)
    >>> flights.on_times.shape, flights.kind
    ((3, 20, 12), ('stuck_off', 'stuck_off', 'stuck_off'))
    """

    spacecraft: Spacecraft
    faults: FaultDistribution = field(
        default_factory=lambda: FaultDistribution(kinds=("stuck_off",), onset=(5.0, 15.0), onset_grid=1.0)
    )
    intervals: int = 60
    duration: float = 1.0
    open_share: float = 1.0 / 3.0
    longest: float | None = None
    bad_measurements: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.spacecraft, Spacecraft):
            raise ValueError(
                f"spacecraft is {self.spacecraft!r}; a description, as `thruster_envs.spacecraft.load` gives "
                "it, would be right"
            )
        if self.intervals < 1:
            raise ValueError(f"intervals is {self.intervals}; one or more would be right")
        if not 0.0 < self.duration < math.inf:
            raise ValueError(f"duration is {self.duration}; a positive number of s would be right")
        for name in ("open_share", "bad_measurements"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} is {value}; a share from 0 to 1 would be right")
        if self.longest is not None and not 0.0 < self.longest <= self.duration:
            raise ValueError(
                f"longest is {self.longest}; above 0 and up to the duration of {self.duration} s would be "
                "right"
            )
        one_fault_each(self.faults)
        if "misalignment" in self.faults.kind_weights():
            raise ValueError(
                "faults has misalignment, which these flights do not model; other kinds, or flights of an "
                "environment, would be right"
            )

    def __call__(self, seeds: Sequence[int], faulty: bool) -> Flights:
        """One flight for each seed. A healthy and a faulty one of the same seed are told the same."""
        craft, count, n = self.spacecraft, len(seeds), self.spacecraft.number_of_thrusters
        on_times, share = np.empty((2, count, self.intervals, n))
        errors, badness = np.empty((count, self.intervals + 1, 6)), np.empty((count, self.intervals, 2))
        longest = self.duration if self.longest is None else self.longest
        scatter = np.array([one.scatter for one in craft.thrusters])
        for flight, seed in enumerate(seeds):
            rng = np.random.default_rng(seed)
            told = rng.random((self.intervals, n)) < self.open_share
            on_times[flight] = told * rng.uniform(0.0, longest, told.shape)
            share[flight] = 1.0 + scatter * rng.uniform(-1.0, 1.0, told.shape)
            errors[flight] = rng.normal(size=errors.shape[1:])
            badness[flight] = rng.random(badness.shape[1:])
        rows = faults_of(self.faults, n, seeds, faulty)
        delivered = self._delivered(on_times, rows)
        sensors = np.repeat([craft.sensors.velocity, craft.sensors.rate], 3)
        rate_change = (share * delivered) @ craft.effectiveness().T + sensors * np.diff(errors, axis=1)
        valid, age = self._spoil(rate_change, badness)
        return Flights(
            on_times=on_times,
            rate_change=rate_change,
            valid=valid,
            duration=self.duration,
            **truth_of(rows),
            age=age,
        )

    def _delivered(self, on_times: FloatArray, faults: FloatArray) -> FloatArray:
        """Effective on-times (flights, intervals, n), s, with faults (flights, 13)."""
        craft, delivered = self.spacecraft, np.empty_like(on_times)
        coupling, expectation = craft.feed.coupling, Expectation(craft, len(on_times))
        if expectation.follows:
            _deliver(on_times, faults, self.duration, coupling, delivered)
            return delivered
        opened, nominal, healthy = np.empty((3, *on_times.shape))
        for t in range(self.intervals):
            firing = expectation.update(np.minimum(on_times[:, t] / self.duration, 1.0), self.duration)
            opened[:, t], nominal[:, t] = firing.open_times, firing.on_times
        opened = np.minimum(opened, self.duration)
        _deliver(opened, faults, self.duration, coupling, delivered)
        _deliver(opened, np.zeros_like(faults), self.duration, coupling, healthy)
        return np.asarray(nominal + (delivered - healthy), np.float64)

    def _spoil(self, rate_change: FloatArray, badness: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Make some of them bad; returns where there is one at all, and how old each is."""
        bad = badness[..., 0] < self.bad_measurements
        missing, spoilt, far, late = (bad & (np.floor(4.0 * badness[..., 1]) == which) for which in range(4))
        before = np.concatenate([np.zeros_like(rate_change[:, :1]), rate_change[:, :-1]], axis=1)
        rate_change[late] = before[late]
        rate_change[spoilt] = np.nan
        rate_change[far] += 1e3 * self.spacecraft.authority(self.duration)
        return ~missing, np.where(late, self.duration, 0.0)


def joined(parts: Sequence[_Flights]) -> _Flights:
    """Batches of flights of the same form and length as one, in their order."""
    first: Any = parts[0]
    values: dict[str, Any] = {}
    for one in dataclasses.fields(first):
        held = [getattr(part, one.name) for part in parts]
        values[one.name] = held[0]
        if isinstance(held[0], tuple):
            values[one.name] = tuple(itertools.chain.from_iterable(held))
        elif isinstance(held[0], np.ndarray):
            values[one.name] = np.concatenate(held)
    whole: _Flights = type(first)(**values)
    return whole


def one_fault_each(faults: FaultDistribution) -> FaultDistribution:
    """The same distribution, of which every world draws exactly one fault of a thruster.

    Raises:
        ValueError: One with faults of sensors, of which the truth of a flight has no place.
    """
    if faults.sensor_probability > 0.0:
        raise ValueError(
            "sensor_probability must be 0 in flights with one fault of a thruster each, got "
            f"{faults.sensor_probability:g}"
        )
    return dataclasses.replace(faults, probability=1.0, count=(1, 1))


def faults_of(faults: FaultDistribution, thrusters: int, seeds: Sequence[int], faulty: bool) -> FloatArray:
    """(flights, 13): the one fault that a world draws from each seed; all zeros for none."""
    rows = np.zeros((len(seeds), 1, 1, len(code.FAULT_FIELDS)))
    if faulty:
        _draw(rows, one_fault_each(faults).encode(thrusters), thrusters, np.array(seeds, dtype=np.uint64))
    return rows[:, 0, 0]


def truth_of(rows: FloatArray) -> dict[str, Any]:
    """What `Flights` says of the faults (flights, 13), by the names of its fields."""
    faulty = rows[:, code.FIELD_KIND] > 0.0
    return {
        "thruster": np.where(faulty, rows[:, code.FIELD_THRUSTER].astype(np.int64) + 1, 0),
        "kind": tuple(KINDS[int(one) - 1] if one > 0 else "none" for one in rows[:, code.FIELD_KIND]),
        "severity": rows[:, code.FIELD_SEVERITY].copy(),
        "onset": np.where(faulty, rows[:, code.FIELD_ONSET], np.inf),
    }


@kernel
def _draw(rows: FloatArray, table: FloatArray, thrusters: int, seeds: NDArray[np.uint64]) -> None:
    for flight in range(rows.shape[0]):
        draw_faults(rows[flight], table, thrusters, 0, seeds[flight], np.uint64(0))


@kernel
def _deliver(
    on_times: FloatArray, faults: FloatArray, duration: float, coupling: float, delivered: FloatArray
) -> None:
    """Effective on-times: how long each would have to fire alone and sound to give what it gives.

    Args:
        on_times: (flights, intervals, n), s.
        faults: (flights, 13), one for each flight; all zeros for none.
        duration: s.
        coupling: Share of thrust lost per further thruster open.
        delivered: (flights, intervals, n), s, written.
    """
    flights, intervals, n = on_times.shape
    floor, slope, gain, told = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    edges, opening = np.empty(n + 3), np.empty(n)
    for flight in range(flights):
        fault = faults[flight : flight + 1]
        thruster = health.thruster_of(fault[0])
        for t in range(intervals):
            for i in range(n):
                floor[i], slope[i], gain[i], told[i] = 0.0, 1.0, 1.0, on_times[flight, t, i]
            middle = (t + 0.5) * duration
            delay, _, added = health.command_errors(fault, thruster, middle, None)
            late = min(delay, duration)
            told[thruster] = (
                min(told[thruster] + added * duration, duration) if added > 0.0 else told[thruster]
            )
            floor[thruster], slope[thruster], gain[thruster] = health.health_at(
                fault, thruster, middle, middle, None
            )
            edges[0] = 0.0
            for i in range(n + 1):  # when valves shut, and when the late one opens, upwards
                edge, place = late if i == n else told[i], i + 1
                while edges[place - 1] > edge:
                    edges[place] = edges[place - 1]
                    place -= 1
                edges[place] = edge
            edges[n + 2] = duration
            for i in range(n):
                delivered[flight, t, i] = 0.0
            for piece in range(n + 2):
                start, length = edges[piece], edges[piece + 1] - edges[piece]
                if length <= 0.0:
                    continue
                together = 0.0
                for i in range(n):
                    shut = told[i] <= start or (i == thruster and start < late)
                    opening[i] = floor[i] + (0.0 if shut else slope[i])
                    together += opening[i]
                for i in range(n):
                    through = max(1.0 - coupling * (together - opening[i]), 0.0)
                    delivered[flight, t, i] += length * gain[i] * opening[i] * through
