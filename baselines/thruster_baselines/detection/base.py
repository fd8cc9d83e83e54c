"""What detectors of rate changes share: input validation, the filter, the clock, and what a test is made of.

The base expects of commanded on-times what the vehicle's valves and feed make of them
(`thruster_envs.physics.nominal_firing.Expectation`), refuses measurements that are late, NaN or beyond what
this vehicle can do (counted by `thruster_baselines.estimation.REFUSALS`), takes the turning of thrust off
where rates are measured (`ThrustTurning`), and gets from a filter of the effectiveness
(`EffectivenessFilter`) the residual and the covariance Y that it should have, which has a floor for what no
model knows. A detector adds a statistic of these and isolates a thruster.

The errors are `noise`: a number or one per axis (Yang 2003, chapter 6: R = 10, Q = 0.01, to which its
thresholds belong; not the size of any error), or `PhysicalNoise(spacecraft)`: sensors and scatter as
described; then nothing is learned unless a `process_noise` is given.

Left out: that consecutive rate changes share a velocity measurement; measurements without an age, or with a
wrong one (`thruster_baselines.estimation.MeasurementGate` checks navigation's own messages).
"""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from functools import partial
from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.detection.calibration import chi_squared_threshold, rate_per_interval
from thruster_baselines.detection.checks import check_effectiveness, mask_of, rows_of
from thruster_baselines.detection.contract import Telemetry, Verdict, check_alone
from thruster_baselines.detection.flights import RandomFlights
from thruster_baselines.detection.interval import Interval, Scores
from thruster_baselines.detection.mismatch import MismatchMonitor, ModelMismatchWarning
from thruster_baselines.detection.self_calibration import calibrated_threshold
from thruster_baselines.detection.settings import (
    FALSE_ALARMS,
    SOURCE_MEASUREMENT_NOISE,
    SOURCE_PROCESS_NOISE,
    FilterSettings,
)
from thruster_baselines.estimation import REFUSALS, EffectivenessFilter, PhysicalNoise, ThrustTurning
from thruster_baselines.estimation.effectiveness import Form
from thruster_baselines.estimation.refusals import LATE, MISSING, ON_TIME, TAKEN, Limits, first_bad_axis
from thruster_baselines.mapping.coupling import Coupling, convert, thrust_shares
from thruster_envs.configuration import suggestion
from thruster_envs.kernels import kernel
from thruster_envs.physics.nominal_firing import Expectation
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["BaseDetector", "Interval"]

_FLOWN = 120  # intervals of a flight that is simulated for a threshold
_NOT_KEYS = ("noise", "vehicles", "mismatch")  # arguments on which a vehicle's threshold does not depend

_ROUNDING = 1e-6  # of a duration, by which an on-time in single precision may exceed it


_REASON, _AXIS, _REFUSED = range(3)
"""Rows of what is kept of the input: why the last was refused, on which axis, then counts by reason."""


class BaseDetector(ABC):
    """A detector that checks what it is given, keeps the filter and the time, and asks a subclass to judge.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        threshold: What the statistic has to exceed for a detection.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        threshold: May be changed at any time.
        time: (vehicles,), s since the last reset.
        filter: What it believes of the thrusters.
        last: The interval last taken in.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float,
        **settings: Unpack[FilterSettings],
    ) -> None:
        unknown = sorted(settings.keys() - FilterSettings.__annotations__.keys())
        if unknown:
            raise TypeError(
                f"{type(self).__name__} got an unexpected keyword argument {unknown[0]!r}; "
                f"{suggestion(unknown[0], FilterSettings.__annotations__)}"
            )
        if not threshold >= 0.0:
            raise ValueError(f"threshold is {threshold}; a number of 0 or more would be right")
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        self.threshold = float(threshold)
        noise = settings.get("noise", SOURCE_MEASUREMENT_NOISE)
        process_noise, initial_covariance = settings.get("process_noise"), settings.get("initial_covariance")
        coupling, vehicles = settings.get("coupling"), settings.get("vehicles", 1)
        effective = settings.get("effective", False)
        self._noise = noise if isinstance(noise, PhysicalNoise) else None
        if process_noise is None:
            process_noise = 0.0 if self._noise is not None else SOURCE_PROCESS_NOISE
        form: Form = "automatic"
        if isinstance(noise, PhysicalNoise):
            learns = np.any(process_noise) or (initial_covariance is not None and np.any(initial_covariance))
            form = "full" if learns else "known"
            noise = np.diag(noise.sensors)
        self._filter_of = partial(
            EffectivenessFilter, spacecraft, process_noise, noise, initial_covariance, form=form
        )
        self.filter = self._filter_of(vehicles=vehicles)
        self._vehicles = vehicles
        self._nominal = self.filter.effectiveness[0].copy()
        m, n = self._nominal.shape
        self._expectation: Expectation | None = None
        self._turning: ThrustTurning | None = None
        if effective:
            coupling = 0.0
        if isinstance(spacecraft, Spacecraft):
            coupling = spacecraft.feed.coupling if coupling is None else coupling
            self._limits = Limits.of(spacecraft)
            self._turning = ThrustTurning(spacecraft)
            expectation = _expectation_of(spacecraft, coupling, vehicles)
            if not effective and (expectation.depletes or not expectation.follows):
                self._expectation = expectation
        else:
            coupling = 0.0 if coupling is None else coupling
            self._limits = Limits.none(m)
        self._unmodelled: FloatArray | None = None
        #: Whether the model fits, where that is asked for.
        loss = float(coupling) if isinstance(coupling, int | float) else 0.0
        follows = settings.get("mismatch", False)
        self.mismatch = MismatchMonitor(vehicles, n, loss) if follows else None
        self._warned = False
        self._shares = thrust_shares(coupling, n)
        self._input_limits = np.concatenate([self._shares, self._limits.rate, self._limits.error])
        self._no_kinds, self._no_age = ("",) * vehicles, np.zeros(vehicles)
        self.reset()

    @classmethod
    def for_vehicle(
        cls,
        spacecraft: Spacecraft | str | Path,
        false_alarms: float = FALSE_ALARMS,
        duration: float | None = None,
        **arguments: Any,
    ) -> Self:
        """A detector whose errors and threshold are those of a vehicle, at a rate of false alarms.

        The threshold has a closed form where there is one; else healthy flights are simulated, once: it is
        kept in the user's folder for caches (`self_calibration`).

        Args:
            spacecraft: Description, name or path.
            false_alarms: How many there may be in a healthy flight of `duration`.
            duration: s; by default one control period.
            arguments: Of the class, but for the threshold.

        Raises:
            ValueError: A rate that cannot be, or a value that the class refuses.
        """
        craft = load(spacecraft) if isinstance(spacecraft, str | Path) else spacecraft
        period = craft.control_period
        rate = rate_per_interval(false_alarms, period if duration is None else duration, period)
        arguments = cls._own_noise(craft) | arguments
        threshold = cls._closed_form(craft, rate, **arguments)
        if threshold is None:
            flown = calibrated_threshold(
                lambda vehicles: cls(craft, 0.0, **(arguments | {"vehicles": vehicles, "mismatch": False})),
                RandomFlights(spacecraft=craft, intervals=_FLOWN, duration=period),
                craft,
                rate,
                _FLOWN,
                {"test": cls.__qualname__} | {k: v for k, v in arguments.items() if k not in _NOT_KEYS},
            )
            # Flights without errors show none of what no model knows, for which the covariance has a floor.
            threshold = max(flown, chi_squared_threshold(rate))
        return cls(craft, threshold, **arguments)

    @classmethod
    def _own_noise(cls, spacecraft: Spacecraft) -> dict[str, Any]:
        """Settings of the filter for a vehicle."""
        return {"noise": PhysicalNoise(spacecraft), "mismatch": spacecraft.modulator is None}

    @classmethod
    def _closed_form(cls, _: Spacecraft, __: float, /, **___: Any) -> float | None:
        """The threshold for a vehicle and a rate per interval; None where healthy flights have to tell."""
        return None

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin anew with nominal thrusters, in the vehicles of a mask (vehicles,) or in all of them."""
        mask = self._mask(vehicles)
        m, n = self._nominal.shape
        if vehicles is None:
            self.time: FloatArray = np.zeros(self._vehicles)
            self._intake: IntArray = np.zeros((2 + len(REFUSALS), self._vehicles), np.int64)
            self._age: FloatArray = self._no_age
            self._believed: FloatArray = np.empty((self._vehicles, m, n))
            self._dead: BoolArray = np.empty((self._vehicles, n), np.bool_)
            self.last: Interval | None = None
        self.time[mask] = 0.0
        if self._expectation is not None:
            self._expectation.reset(None if vehicles is None else mask)
        if self.mismatch is not None:
            self.mismatch.reset(mask)
        self._intake[_REFUSED:, mask] = 0
        self._intake[_REASON, mask] = TAKEN
        self._believed[mask] = self._nominal
        self._dead = self._dead.copy()  # the last interval keeps its own
        self._dead[mask] = ~self._nominal.any(axis=0)
        self._begin(mask)
        self._forget(mask)

    def believe(self, effectiveness: ActuatorBelief | ArrayLike, vehicles: ArrayLike | None = None) -> None:
        """From now on expect what thrusters of this effectiveness give.

        What was believed before of a thruster whose column is another now is forgotten, and its uncertainty
        is that of the start; what was learned of the others stays. A thruster with a column of zeros is not
        suspected any more. Evidence gathered so far is dropped.

        Args:
            effectiveness: (m, n) or (vehicles, m, n), m/s^2 then rad/s^2, or a belief about the thrusters.
            vehicles: Which ones, as a mask (vehicles,); all by default.

        Raises:
            ValueError: A wrong shape, an entry that is not finite.
        """
        mask = self._mask(vehicles)
        if isinstance(effectiveness, ActuatorBelief):
            effectiveness = effectiveness.effectiveness(self._nominal)
        given = np.array(effectiveness, dtype=np.float64)
        check_effectiveness(given, self._vehicles, self._nominal.shape)
        given = np.broadcast_to(given, self._believed.shape)
        changed = (given != self._believed).any(axis=1) & mask[:, np.newaxis]
        for i in np.flatnonzero(changed.any(axis=0)):
            self._replace(changed[:, i], int(i) + 1, given[changed[:, i], :, i])
        self._believed[mask] = given[mask]
        self._dead = self._dead.copy()  # the last interval keeps its own
        self._dead[mask] = ~given[mask].any(axis=1)
        self._forget(mask)

    def update(
        self,
        on_times: Telemetry | ArrayLike,
        rate_change: ArrayLike | None = None,
        duration: float | None = None,
        *,
        valid: ArrayLike | None = None,
        age: ArrayLike | None = None,
        turning: ArrayLike | None = None,
    ) -> Verdict:
        """Take in one interval: `Telemetry`, or arrays as in `thruster_envs.protocols.Detector`.

        Raises:
            ValueError: A wrong shape, on-times that are negative, longer than the interval or no numbers, a
                duration that is not positive; telemetry without on-times or rate change.
            TypeError: Arguments beside telemetry, or too few without it.
        """
        if isinstance(on_times, Telemetry):
            seen = on_times
            check_alone(rate_change=rate_change, duration=duration, valid=valid, age=age)
            commanded, measured = seen.need("on_times"), seen.need("rate_change")
            duration, valid, age, turning = seen.duration, seen.valid, seen.age, seen.turning
        else:
            commanded, measured = on_times, rate_change
        if measured is None or duration is None:
            raise TypeError("update must have telemetry, or on_times, rate_change and duration")
        self.last = self._take_in(commanded, measured, duration, valid, age, turning)
        if self.mismatch is not None:
            self.mismatch.update(self.last)
            self._warn(self.mismatch)
        return self._diagnose(self.last)

    def _warn(self, mismatch: MismatchMonitor) -> None:
        """Say once that the model does not fit, and which parameter."""
        found = np.flatnonzero(mismatch.parameter >= 0)
        if found.size and not self._warned:
            self._warned = True
            line = f"the model does not fit vehicle {found[0]}: {mismatch.line(int(found[0]))}"
            warnings.warn(line, ModelMismatchWarning, stacklevel=3)

    @property
    def refused(self) -> dict[str, IntArray]:
        """How many measurements were refused since the last reset, (vehicles,), for each reason."""
        return {reason: self._intake[_REFUSED + k].copy() for k, reason in enumerate(REFUSALS)}

    def last_refusal(self, vehicle: int = 0) -> str:
        """Why the measurement of the last interval was refused, for people; empty if it was taken.

        Args:
            vehicle: Which one, from 0.
        """
        reason, interval = int(self._intake[_REASON, vehicle]), self.last
        if reason == TAKEN or interval is None:
            return ""
        if reason == MISSING:
            return f"the rate change of vehicle {vehicle} is missing"
        if reason == LATE:
            return (
                f"the rate change of vehicle {vehicle} is {self._age[vehicle]:g} s old; that of the interval "
                "that has just ended would be right"
            )
        k = int(self._intake[_AXIS, vehicle])
        value = interval.rate_change[vehicle, k]
        return f"the rate change of vehicle {vehicle}, {self._limits.line(k, value, interval.duration)}"

    @abstractmethod
    def _diagnose(self, interval: Interval) -> Verdict:
        """What to say of a checked interval."""

    def _begin(self, mask: BoolArray) -> None:
        """Go back to the first estimate in the vehicles of a mask (vehicles,)."""
        self.filter.reset(mask)

    def _replace(self, mask: BoolArray, thruster: int, columns: FloatArray) -> None:
        """Believe columns (vehicles in the mask, m) of a thruster, numbered from 1."""
        self.filter.replace_column(mask, thruster, columns)

    def _forget(self, mask: BoolArray) -> None:  # noqa: B027 - most detectors gather nothing
        """Drop the evidence gathered of the vehicles of a mask (vehicles,)."""

    def _take_in(
        self,
        on_times: ArrayLike,
        rate_change: ArrayLike,
        duration: float,
        valid: ArrayLike | None,
        age: ArrayLike | None,
        turning: ArrayLike | None,
    ) -> Interval:
        count, (m, n) = self._vehicles, self._nominal.shape
        commanded = self._whole(on_times, n, "on_times")
        measured = self._whole(rate_change, m, "rate_change")
        if not (duration > 0.0 and math.isfinite(duration)):
            raise ValueError(f"duration is {duration}; a positive number of s would be right")
        there = np.ones(count, np.bool_) if valid is None else np.array(valid, dtype=np.bool_)
        if there.shape != (count,):
            raise ValueError(f"valid has the shape {there.shape}; ({count},) would be right")
        ages = self._no_age if age is None else np.array(age, dtype=np.float64)
        if ages.shape != (count,):
            raise ValueError(f"age has the shape {ages.shape}; ({count},) would be right")
        effective = np.empty((count, n))
        wrong = _validate_input(
            commanded, measured, there, ages, float(duration), self._input_limits, self._intake, self.time,
            effective,
        )  # fmt: skip
        if wrong >= 0:
            vehicle, thruster = divmod(int(wrong), n)
            raise ValueError(
                f"on_times of vehicle {vehicle}, thruster {thruster + 1} is {commanded[vehicle, thruster]}; "
                f"a number of s from 0 to the duration of {duration:g} s would be right"
            )
        self._age = ages
        opened = commanded
        if self._expectation is not None:
            firing = self._expectation.update(np.minimum(commanded / duration, 1.0), duration)
            if not self._expectation.follows:
                opened, effective = firing.open_times, firing.on_times
            measured[:, :3] *= np.where(firing.mass_ratio > 0.0, firing.mass_ratio, 1.0)[:, np.newaxis]
            self._unmodelled = _by_modulator(firing.deviation, self._nominal)
        else:
            self._unmodelled = None
        self._take_turning_off(opened, effective, measured, duration, turning)
        before = self.filter.effectiveness.copy()
        noise = None if self._noise is None else self._noise.of_rows(effective)
        if noise is not None and self._unmodelled is not None:
            noise += self._unmodelled
        innovation = self.filter.advance(effective, measured, there, noise)
        return Interval(
            opened, effective, measured, float(duration), innovation.valid, before,
            innovation.residual, innovation.covariance, self._dead,
        )  # fmt: skip

    def _take_turning_off(
        self,
        opened: FloatArray,
        effective: FloatArray,
        measured: FloatArray,
        duration: float,
        turning: ArrayLike | None,
    ) -> None:
        """Take the turning of thrust off `measured`, and add what is left of it to what has no model."""
        if turning is None or self._turning is None:
            return
        rates = np.asarray(turning, np.float64)
        if rates.shape != (self._vehicles, 2, 3):
            raise ValueError(f"turning must have the shape ({self._vehicles}, 2, 3), got {rates.shape}")
        rates = np.where(np.isfinite(rates).all(axis=(1, 2), keepdims=True), rates, 0.0)
        off, unknown = self._turning(opened, effective, rates, duration)
        measured[:, :3] -= off
        self._unmodelled = unknown if self._unmodelled is None else self._unmodelled + unknown

    def _whole(self, given: ArrayLike, size: int, name: str) -> FloatArray:
        return rows_of(np.array(given, dtype=np.float64, order="C"), self._vehicles, size, name)

    def _mask(self, vehicles: ArrayLike | None) -> BoolArray:
        return mask_of(vehicles, self._vehicles)

    def _answer(self, scores: Scores, limit: FloatArray | None = None) -> Verdict:
        """The verdict; `limit` (vehicles,) stands for the threshold in this interval."""
        detected = scores.statistic > (self.threshold if limit is None else limit)
        kinds = self._kinds(detected) if np.count_nonzero(detected) else self._no_kinds
        return Verdict(
            detected, scores.thruster * detected, scores.statistic, self.time.copy(), scores.suspicion,
            scores.shortfall, kinds, () if self.mismatch is None else self.mismatch.names(),
        )  # fmt: skip

    def _kinds(self, detected: BoolArray) -> tuple[str, ...]:  # noqa: ARG002 - most tests tell no kinds
        """Of each vehicle, the kind of fault where one is detected; nothing where it cannot be told."""
        return self._no_kinds


def _expectation_of(spacecraft: Spacecraft, coupling: Coupling, vehicles: int) -> Expectation:
    """What is expected of the valves of a vehicle.

    Raises:
        ValueError: A loss curve, for valves that do not just follow their commands.
    """
    linear = isinstance(coupling, int | float)
    expectation = Expectation(
        spacecraft,
        vehicles,
        coupling=max(0.0, min(float(coupling), 1.0)) if linear else 0.0,  # type: ignore[arg-type]
    )
    if not (linear or expectation.follows):
        raise ValueError(
            f"coupling must be one number for {spacecraft.name!r}, whose valves do not just follow"
        )
    return expectation


def _by_modulator(deviation: FloatArray, effectiveness: FloatArray) -> FloatArray | None:
    """(vehicles, m, m): of a rate change, by the modulator's delays; None where they are known."""
    if not deviation.any():
        return None
    each = deviation[:, np.newaxis, :] * effectiveness  # (vehicles, m, n)
    together = each.sum(axis=2)
    return np.asarray(each @ each.transpose(0, 2, 1) + together[:, :, np.newaxis] * together[:, np.newaxis])


@kernel(nogil=True)
def _validate_input(
    commanded: FloatArray,
    measured: FloatArray,
    there: NDArray[np.bool_],
    age: FloatArray,
    duration: float,
    limits: FloatArray,
    intake: IntArray,
    time: FloatArray,
    effective: FloatArray,
) -> int:
    """Effective on-times, clock, and refusals; the flat index of the first on-time that cannot be, or -1.

    Nothing but scratch is written if there is one. The limits are the shares of thrust of the shared feed,
    the largest rate of change and the largest error, one after the other; `_REASON` tells the rows of the
    intake.
    """
    shares = limits[: commanded.shape[1] + 1]
    largest_rate, largest_error = limits[shares.size :].reshape(2, -1)
    reason, axis, refused = intake[_REASON], intake[_AXIS], intake[_REFUSED:]
    count, n = commanded.shape
    wrong, longest = -1, duration * (1.0 + _ROUNDING)
    for v in range(count):
        for i in range(n):
            if wrong < 0 and not (commanded[v, i] >= 0.0 and commanded[v, i] <= longest):
                wrong = v * n + i
    if wrong >= 0:
        return wrong
    order = np.empty(n, np.int64)
    for v in range(count):
        convert(commanded[v], shares, order, True, effective[v])
        time[v] += duration
        reason[v] = TAKEN
        if not there[v]:
            reason[v] = MISSING
        elif not abs(age[v]) <= ON_TIME * duration:  # written so that what is no number is refused, too
            reason[v] = LATE
        else:
            reason[v], axis[v] = first_bad_axis(measured[v], duration, largest_rate, largest_error)
        if reason[v] != TAKEN:
            there[v] = False
            refused[reason[v], v] += 1
    return wrong
