"""Flights with one fault of any kind, of a thruster or of a sensor, and how large its effect is.

The vehicle flies `FaultDiagnosis-v1` under its scripted pilot, in six axes. Unlike `EnvironmentFlights`, a
flight keeps all that navigation measures, sensors fail as well as thrusters, and each fault has an effect in
standard deviations: of the change f that it makes in an interval the root of f' Y^-1 f, with the covariance Y
of a fault-free rate change (`PhysicalNoise`), the largest over the ten intervals after the onset. Of a sensor
it is the largest difference from the fault-free flight of the same seed, in the first three intervals.

Left out: several faults in a flight; faults of wheels and gyros, which their own tachometers show.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.detection.contract import Telemetry
from thruster_baselines.detection.environment_flights import ObservedFiring
from thruster_baselines.detection.flights import Flights
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs import rollout
from thruster_envs.faults import Fault
from thruster_envs.physics.vehicle import tilted_wrenches
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FaultFlights", "SensedFlights", "effect_of_fault", "tilted_columns"]

ENVIRONMENT = "thruster_envs/FaultDiagnosis-v1"
WITH_TESTS = "thruster_envs/ActiveDiagnosis-v1"

_LOOKED_AT = 10
"""Intervals after the onset in which the largest effect is looked for."""

_JUMPS_LOOKED_AT = 3
"""The same for sensors: later the two flights differ by what the pilot has made of it."""

_TEST_DUTY = 0.2
"""Of a test pulse, as a share of the period."""

_SEVERITIES = {
    "stuck_off": (1.0, 1.0), "stuck_on": (0.5, 1.0), "loss": (0.3, 0.9), "leak": (0.1, 0.5),
    "misalignment": (0.1, 0.6), "late_opening": (0.1, 0.4), "intermittent": (1.0, 1.0), "sign": (1.0, 1.0),
    "bias": (0.1, 0.3),
}  # fmt: skip
"""Ranges of severities; that of a late opening in control periods."""


@dataclass(frozen=True, slots=True)
class SensedFlights(Flights):
    """Flights with all that navigation measured at the end of each interval.

    Attributes:
        position: (flights, intervals, 3), m, LVLH.
        velocity: (flights, intervals, 3), m/s, LVLH.
        attitude: (flights, intervals, 4), body from LVLH.
        rate: (flights, intervals, 3), rad/s, body axes.
        sensor: (flights,), the one that fails; empty where a thruster does, or nothing.
        effect: (flights,), of the fault, in standard deviations; 0 in a healthy flight.
    """

    position: FloatArray | None = None
    velocity: FloatArray | None = None
    attitude: FloatArray | None = None
    rate: FloatArray | None = None
    sensor: tuple[str, ...] = ()
    effect: FloatArray | None = None

    def telemetry(self, flights: slice, interval: int) -> Telemetry:
        """What a detector is given of one interval of some of them."""
        at = (flights, interval)
        measured: dict[str, Any] = {
            name: None if (values := getattr(self, name)) is None else values[at]
            for name in ("position", "velocity", "attitude", "rate")
        }
        return Telemetry(**Flights.step(self, flights, interval), **measured)


@dataclass(frozen=True, kw_only=True)
class FaultFlights:
    """Flights of a vehicle, each faulty one with a fault of one kind.

    Attributes:
        spacecraft: What flies.
        kind: Of the fault, as `thruster_envs.faults` has it.
        sensor: That fails; empty for a thruster.
        severity: Range of the severity; by default one for each kind, of a sensor 5 to 20 of its standard
            deviations, of either sign.
        onset: Range of the control periods at whose start the fault begins.
        periods: In a flight.
        test_threshold: Of a `HypothesisDetector` that watches in flight: from its alarm on, while several
            thrusters come into question, the two likeliest fire a test pulse in each period. 0 for none.

    Raises:
        ValueError: Onsets that are not within the flight.

    >>> from thruster_envs.spacecraft import load
    >>> source = FaultFlights(spacecraft=load("orion"), kind="leak", onset=(5, 9), periods=20)
    >>> flights = source(range(3), faulty=True)
    >>> flights.on_times.shape, flights.kind
    ((3, 20, 12), ('leak', 'leak', 'leak'))
    """

    spacecraft: Spacecraft
    kind: str
    sensor: str = ""
    severity: tuple[float, float] | None = None
    onset: tuple[int, int] = (15, 40)
    periods: int = 60
    test_threshold: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.onset[0] <= self.onset[1] < self.periods:
            raise ValueError(
                f"onset must be within the {self.periods} periods, first to last, got {self.onset}"
            )

    def __call__(self, seeds: Sequence[int], faulty: bool) -> SensedFlights:
        """One flight for each seed. A healthy and a faulty one of a seed are alike until the onset."""
        faults = [self.fault(seed) for seed in seeds] if faulty else [None] * len(seeds)
        flown = self._fly(seeds, faults)
        if faulty and self.sensor:
            effect = self._jumps(flown, self._fly(seeds, [None] * len(seeds)))
            return dataclasses.replace(flown, effect=effect)
        return flown

    def _fly(self, seeds: Sequence[int], faults: Sequence[Fault | None]) -> SensedFlights:
        """One flight for each seed and its fault."""
        craft = self.spacecraft
        tests: dict[str, Any] = {}
        if self.test_threshold > 0.0:
            tests = {"reach": None, "budget": 1e6, "test_duties": (_TEST_DUTY,)}
        env = gym.make_vec(
            WITH_TESTS if tests else ENVIRONMENT, num_envs=len(seeds), faults=[], spacecraft=craft, **tests,
            vectorization_mode="vector_entry_point", autoreset_mode=gym.vector.AutoresetMode.DISABLED,
        )  # fmt: skip
        watching = _Tests(env, self.test_threshold) if tests else "idle"
        names = ("position", "velocity", "attitude", "rate")
        flown = rollout.fly(
            env, watching, list(seeds), steps=self.periods, past_end=True,
            options={"faults": [[] if one is None else [one] for one in faults]},
            record=("duty", "terminated", "measured_change", *(f"measured_{name}" for name in names)),
        )  # fmt: skip
        env.close()
        measured = {name: flown.padded(f"measured_{name}")[:, 1:] for name in names}
        on_times = flown.padded("duty") * craft.control_period
        lost = np.logical_or.accumulate(flown.padded("terminated"), axis=1)
        onset = np.array([math.inf if one is None else one.onset for one in faults])
        return SensedFlights(
            on_times=on_times,
            rate_change=flown.padded("measured_change"),
            valid=~np.pad(lost[:, :-1], ((0, 0), (1, 0))),
            duration=craft.control_period,
            thruster=np.array([0 if one is None or one.sensor else one.thruster for one in faults]),
            kind=tuple("none" if one is None else one.kind for one in faults),
            severity=np.array([0.0 if one is None else one.severity for one in faults]),
            onset=onset,
            sensor=tuple("" if one is None or one.sensor is None else one.sensor for one in faults),
            effect=np.array([_largest(craft, *pair) for pair in zip(faults, on_times, strict=True)]),
            **measured,
        )

    def _jumps(self, faulty: SensedFlights, healthy: SensedFlights) -> FloatArray:
        """(flights,): the largest step of its error between intervals, in standard deviations."""
        sigma = float(getattr(self.spacecraft.sensors, self.sensor)) * math.sqrt(2.0)
        error = getattr(faulty, self.sensor) - getattr(healthy, self.sensor)
        if self.sensor == "attitude":
            error = 2.0 * error  # of a quaternion
        size = np.linalg.norm(np.diff(error, axis=1, prepend=0.0), axis=2) / sigma
        first = np.floor(faulty.onset / faulty.duration).astype(np.int64)
        return np.array([one[k : k + _JUMPS_LOOKED_AT].max() for one, k in zip(size, first, strict=True)])

    def fault(self, seed: int) -> Fault:
        """The fault of the flight of a seed."""
        rng = np.random.default_rng([seed, 14])
        craft, period = self.spacecraft, self.spacecraft.control_period
        onset = period * float(rng.integers(self.onset[0], self.onset[1] + 1))
        share, which = rng.random(), int(rng.integers(craft.number_of_thrusters))
        if self.sensor:
            sigma = float(getattr(craft.sensors, self.sensor))
            low, high = (5.0 * sigma, 20.0 * sigma) if self.severity is None else self.severity
            size = low + share * (high - low)
            if self.severity is None:
                size *= {"drift": 0.2 / period, "scale": 0.0}.get(self.kind, 1.0)
                size += {"scale": 0.5, "freeze": 0.0}.get(self.kind, 0.0)
                size = {"freeze": 1.0, "drop_out": 0.8}.get(self.kind, size)
            # within a period, so that the measurement at its end is the first that is wrong
            middle = onset + 0.5 * period
            return Fault(sensor=self.sensor, axis=1 + which % 3, kind=self.kind, severity=size, onset=middle)
        low, high = _SEVERITIES[self.kind] if self.severity is None else self.severity
        size = low + share * (high - low)
        if self.kind == "late_opening":
            size *= period
        return Fault(
            which + 1, self.kind, severity=size, onset=onset, azimuth=2.0 * math.pi * rng.random(),
            profile_time=8.0 * period if self.kind == "intermittent" else 0.0,
        )  # fmt: skip


def effect_of_fault(spacecraft: Spacecraft, fault: Fault, on_times: FloatArray) -> FloatArray:
    """(intervals, 6), m/s then rad/s: what a fault changes while it acts, feed coupling left out.

    Args:
        spacecraft: Nominal.
        fault: Of a thruster.
        on_times: (intervals, n), s, commanded.

    Raises:
        ValueError: A kind whose effect on the rate change is not known here.
    """
    period = spacecraft.control_period
    i, size = fault.thruster - 1, fault.severity
    fired = on_times[:, i]
    column = spacecraft.effectiveness()[:, i]
    if fault.kind == "misalignment":
        first, second = tilted_columns(spacecraft)[:, :, i]
        across = math.cos(fault.azimuth) * first + math.sin(fault.azimuth) * second
        return np.outer(fired, (math.cos(size) - 1.0) * column + math.sin(size) * across)
    seconds = {
        "stuck_off": -fired * size,
        "intermittent": -fired * size,
        "loss": -fired * size,
        "stuck_on": size * period - fired,
        "leak": size * (period - fired),
        "late_opening": -np.minimum(fired, size),
        "sign": -2.0 * size * fired,
        "bias": np.minimum(fired + size * period, period) - fired,
    }
    if fault.kind not in seconds:
        raise ValueError(f"kind must be one of {', '.join(seconds)} or misalignment, got {fault.kind!r}")
    return np.outer(seconds[fault.kind], column)


def tilted_columns(spacecraft: Spacecraft) -> FloatArray:
    """(2, 6, n), m/s^2 then rad/s^2: of thrusters square to their direction, azimuth 0 and 90 degrees."""
    wrenches = tilted_wrenches(spacecraft)
    turning = np.linalg.solve(np.array(spacecraft.inertia), np.moveaxis(wrenches[..., 3:], 2, 1))
    return np.concatenate([np.moveaxis(wrenches[..., :3], 2, 1) / spacecraft.mass, turning], axis=1)


def _largest(spacecraft: Spacecraft, fault: Fault | None, on_times: FloatArray) -> float:
    """The largest effect in one interval, in standard deviations."""
    if fault is None or fault.sensor is not None:
        return 0.0
    first = round(fault.onset / spacecraft.control_period)
    told = on_times[first : first + _LOOKED_AT]
    change = effect_of_fault(spacecraft, fault, told)
    covariance = PhysicalNoise(spacecraft)(told)
    squares = np.einsum("ti,ti->t", change, np.linalg.solve(covariance, change[..., np.newaxis])[..., 0])
    return float(np.sqrt(squares.max()))


class _Tests:
    """Acts in `ActiveDiagnosis-v1`: fires test pulses while several thrusters are suspected."""

    def __init__(self, environment: Any, threshold: float) -> None:
        from thruster_baselines.detection.hypotheses import HypothesisDetector  # which needs this module

        self._read = ObservedFiring(environment)
        self._entries = len(environment.unwrapped.task.choices)
        self._begins = True
        self._detector = HypothesisDetector(
            self._read.spacecraft, threshold, patience=_LOOKED_AT, vehicles=environment.num_envs
        )

    def __call__(self, observations: NDArray[np.float32]) -> IntArray:
        actions = np.zeros((len(observations), self._entries), np.int64)
        if self._begins:  # nothing has been fired yet
            self._begins = False
            return actions
        on_times, rate_change = self._read(observations)
        verdict = self._detector.update(on_times, rate_change, self._read.duration)
        candidates = verdict.candidates
        assert candidates is not None  # a verdict always has them
        for world in np.flatnonzero(candidates.sum(axis=1) > 1):
            likeliest = np.argsort(np.where(candidates[world], verdict.suspicion[world], -np.inf))[-2:]
            actions[world, 2 + likeliest] = 1
        return actions
