"""Alarm thresholds of all detectors: `calibrate` finds one for a rate of false alarms on healthy seeds.

The threshold is an order statistic of what the detector gave on healthy flights: as low as it can be while
the exact (Clopper-Pearson) upper bound of the rate at which it is exceeded stays at or below the stated rate
(`threshold_for_rate`). Flights are independent, their intervals are not, so the largest statistic of a flight
counts. Rules of the sources that say nothing of a rate: `margin_threshold`, `largest_scaled_threshold`.
In closed form: `chi_squared_threshold`, and `healthy_limits` for defaults of the likelihood ratio.

`healthy_firings` draws random firings with scatter and sensor errors (the Monte Carlo of Yang 2003, 6.4.2).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.contract import AnyDetector, reader_of
from thruster_baselines.detection.flights import FlightSource, RecordedFlights
from thruster_baselines.mapping.coupling import delivered_on_times
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.extras import extra
from thruster_envs.physics.nominal_firing import Expectation
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = [
    "Calibration",
    "Firings",
    "calibrate",
    "chi_squared_threshold",
    "healthy_firings",
    "largest_scaled_threshold",
    "margin_threshold",
    "rate_per_interval",
    "residual_thresholds",
    "threshold_for",
    "threshold_for_rate",
]

SOURCE_MARGIN = 1.3
"""Of the threshold over the largest residual of healthy flights (Fonod et al. 2013)."""

FLOWN_TOGETHER = 500
"""Vehicles that fly side by side; bounds the memory that a detector takes."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A threshold and what is known of it.

    Attributes:
        threshold: To be exceeded for an alarm.
        false_alarms: The stated rate per interval.
        observed: Rate per interval at which the data exceed the threshold.
        upper: Upper bound of the true rate per interval; at most the stated one.
        confidence: With which it holds.
        samples: How many independent ones there were: intervals, or flights.
    """

    threshold: float
    false_alarms: float
    observed: float
    upper: float
    confidence: float
    samples: int


@dataclass(frozen=True, slots=True)
class Firings:
    """Intervals, each of a vehicle of its own.

    Attributes:
        on_times: (count, n), s, as commanded.
        rate_change: (count, m), m/s then rad/s, as measured.
        duration: s.
    """

    on_times: FloatArray
    rate_change: FloatArray
    duration: float


def calibrate(
    make: Callable[[int], AnyDetector],
    source: FlightSource,
    seeds: Sequence[int],
    *,
    false_alarms: float,
    per: float = 3600.0,
    confidence: float = 0.95,
) -> Calibration:
    """The threshold at which a detector of any kind gives no more than so many false alarms in a time.

    Args:
        make: Builds a detector for so many vehicles.
        source: Of flights that the detector can be fed with.
        seeds: Of healthy flights; none of those that results are reported on.
        false_alarms: How many in the time `per`, above 0.
        per: s; an hour by default.
        confidence: That the true rate is not above it, above 0.5 and below 1.

    Raises:
        ValueError: A rate that cannot be, or that so few flights cannot show; the number that can is named.

    >>> from thruster_baselines.detection import CUSUMDetector, RandomFlights
    >>> from thruster_baselines.estimation import PhysicalNoise
    >>> from thruster_envs.seeds import VALIDATION
    >>> from thruster_envs.spacecraft import load
    >>> orion = load("orion")
    >>> def make(vehicles):
    ...     return CUSUMDetector(orion, 10.0, noise=PhysicalNoise(orion), vehicles=vehicles)
    >>> found = calibrate(make, RandomFlights(spacecraft=orion), VALIDATION[:60], false_alarms=3.0)
    >>> 4.0 < found.threshold < 20.0
    True
    """
    flights = source(seeds, False)
    rate = rate_per_interval(false_alarms, per, flights.duration)
    return threshold_for_rate(statistics_of(make, flights), rate, confidence)


def rate_per_interval(false_alarms: float, per: float, duration: float) -> float:
    """The rate per interval of a duration, s, at which so many false alarms come in a time `per`, s.

    Raises:
        ValueError: A number that is not positive, or as many alarms as intervals.

    >>> rate_per_interval(3.6, 3600.0, 5.0)
    0.005
    """
    for name, value in (("false_alarms", false_alarms), ("per", per), ("duration", duration)):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be positive and finite, got {value}")
    rate = false_alarms * duration / per
    if rate >= 1.0:
        raise ValueError(
            f"false_alarms must be below {per / duration:g} in {per:g} s, the number of intervals, got "
            f"{false_alarms:g}"
        )
    return rate


def statistics_of(make: Callable[[int], AnyDetector], flights: RecordedFlights) -> FloatArray:
    """(flights, intervals): the statistic of a detector all along, without any alarm."""
    count, intervals = flights.on_times.shape[:2]
    found = np.empty((count, intervals))
    for first in range(0, count, FLOWN_TOGETHER):
        part = slice(first, min(first + FLOWN_TOGETHER, count))
        detector = make(part.stop - part.start)
        detector.threshold = math.inf
        detector.reset()
        read = reader_of(detector)
        for t in range(intervals):
            found[part, t] = read(flights.telemetry(part, t)).statistic
    return found


def threshold_for_rate(statistics: ArrayLike, false_alarms: float, confidence: float = 0.95) -> Calibration:
    """The lowest threshold that data of healthy vehicles support.

    Args:
        statistics: `Diagnosis.statistic` of healthy vehicles: (samples,), all independent of each other, or
            (flights, intervals) of flights that are.
        false_alarms: Rate per interval, above 0 and below 1.
        confidence: That the true rate is not above it, above 0.5 and below 1.

    Raises:
        ValueError: A rate or confidence that cannot be, statistics that are no numbers, or too few of them.

    >>> threshold_for_rate(np.arange(1000.0), 0.01).threshold  # four of a thousand are above it
    995.0
    """
    values = np.asarray(statistics, dtype=np.float64)
    if not 0.0 < false_alarms < 1.0:
        raise ValueError(f"false_alarms is {false_alarms}; a rate above 0 and below 1 would be right")
    if not 0.5 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence}; above 0.5 and below 1 would be right")
    if values.ndim not in (1, 2) or values.size == 0:
        raise ValueError(
            f"statistics has the shape {values.shape}; (samples,) or (flights, intervals) would be right"
        )
    if np.isnan(values).any():
        raise ValueError("statistics has an entry that is no number; those of a detector would be right")
    intervals = 1 if values.ndim == 1 else values.shape[1]
    largest = values if values.ndim == 1 else values.max(axis=1)
    samples = largest.size
    rate = -math.expm1(intervals * math.log1p(-false_alarms))
    needed = math.ceil(math.log1p(-confidence) / math.log1p(-rate))
    if samples < needed:
        what = "samples" if values.ndim == 1 else f"flights of {intervals} intervals"
        raise ValueError(
            f"{samples} {what} cannot show a rate of {false_alarms} per interval with a confidence of "
            f"{confidence}; {needed} or more would be right"
        )
    low, high = 0, samples  # exceedances: low is allowed, high is not
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _upper(middle, samples, confidence) <= rate else (low, middle)
    threshold = float(np.partition(largest, samples - 1 - low)[samples - 1 - low])
    above = int((largest > threshold).sum())  # fewer than allowed where values repeat
    return Calibration(
        threshold=threshold,
        false_alarms=false_alarms,
        observed=_per_interval(above / samples, intervals),
        upper=_per_interval(_upper(above, samples, confidence), intervals),
        confidence=confidence,
        samples=samples,
    )


def largest_scaled_threshold(residuals: ArrayLike, scale: ArrayLike) -> FloatArray:
    """The mean of healthy residuals, and so many times the distance of the largest from it.

    The rule of Valdes 2008, eq. 4.2 and 5.3: mean + scale (largest - mean).

    Args:
        residuals: Of healthy pulses or missions (samples, ...), finite; a threshold for each of the rest.
        scale: Of each threshold, or of all; above 1 nothing is an alarm of what the threshold was made from.

    Returns:
        What is left of the shape of the residuals without the samples.

    Raises:
        ValueError: No residuals, some that are no numbers, or a scale below zero.

    >>> round(float(largest_scaled_threshold([0.01, 0.02, 0.03], 1.15)), 4)
    0.0315
    """
    values, factor = np.asarray(residuals, dtype=np.float64), np.asarray(scale, dtype=np.float64)
    if values.ndim == 0 or len(values) == 0:
        raise ValueError(f"residuals has the shape {values.shape}; one sample or more would be right")
    if not np.isfinite(values).all():
        raise ValueError("residuals has an entry that is no number; those of healthy pulses would be right")
    if not (factor >= 0.0).all():
        raise ValueError(f"scale is {factor}; zero or more would be right")
    mean = values.mean(axis=0)
    return np.asarray(mean + factor * (values.max(axis=0) - mean))


def margin_threshold(statistics: ArrayLike, margin: float = SOURCE_MARGIN) -> float:
    """The largest statistic of healthy flights, times a margin.

    Says nothing of the false-alarm rate; `threshold_for_rate` does. The margin is that of Fonod et al. 2013.

    >>> margin_threshold([[0.0, 2.0], [1.0, 0.5]], margin=1.5)
    3.0
    """
    return margin * float(np.max(np.asarray(statistics, dtype=np.float64)))


def threshold_for(false_alarm_rate: float, healthy_statistics: ArrayLike) -> float:
    """Threshold that a stated share of healthy episodes exceeds at least once.

    Args:
        false_alarm_rate: Share of episodes, above 0 and below 1.
        healthy_statistics: (episodes, firings), :attr:`ResponseTest.statistic` after each firing of a
            healthy vehicle.

    Raises:
        ValueError: A rate outside of (0, 1), or too few episodes to tell such a rate.

    >>> threshold_for(0.25, [[0.0, 1.0], [2.0, 0.0], [3.0, 1.0], [4.0, 2.0]])
    3.25
    """
    if not 0.0 < false_alarm_rate < 1.0:
        raise ValueError(
            f"false_alarm_rate is {false_alarm_rate}; a number above 0 and below 1 would be right"
        )
    largest = np.asarray(healthy_statistics, dtype=np.float64).max(axis=1)
    if largest.size * false_alarm_rate < 1.0:
        raise ValueError(
            f"{largest.size} episodes cannot tell a false-alarm rate of {false_alarm_rate}; "
            f"{int(np.ceil(1.0 / false_alarm_rate))} or more would be right"
        )
    return float(np.quantile(largest, 1.0 - false_alarm_rate))


def residual_thresholds(
    residuals: ArrayLike, sensitivity: ArrayLike, false_alarms: float | None = None
) -> FloatArray:
    """The threshold of each column of residuals of healthy pulses or missions.

    Args:
        residuals: (samples,) or (samples, columns).
        sensitivity: How far beyond the mean, in units of the distance of the largest from it: the rule of
            Valdes 2008, eq. 4.2 and 5.3 (`largest_scaled_threshold`).
        false_alarms: Where given, the threshold instead is the lowest for which so large a rate of false
            alarms is shown with a confidence of 95 % (`threshold_for_rate`).

    Returns:
        (), or (columns,).

    Raises:
        ValueError: No residuals, some that are not finite, or too few for that rate.
    """
    if false_alarms is None:
        return largest_scaled_threshold(residuals, sensitivity)
    values = np.asarray(residuals, np.float64)
    columns = values.reshape(len(values), -1)
    limits = [threshold_for_rate(column, false_alarms).threshold for column in columns.T]
    return np.array(limits).reshape(values.shape[1:])


def chi_squared_threshold(false_alarms: float, degrees: int = 1, tests: int = 1) -> float:
    """The threshold of a chi-squared statistic, or of the largest of several, in closed form.

    Of several, the rate is at most the stated one however they depend on each other (Bonferroni): `tests` is
    6 for the axes of `SingleChiSquared`. The likelihood ratio is such a maximum over the distinct directions
    of the thrusters' columns, of one degree of freedom each. It holds where the covariance of the residual is
    the true one and errors are normal.

    Args:
        false_alarms: Rate per interval, above 0 and below 1.
        degrees: Of freedom: m for `GenericChiSquared`.
        tests: How many statistics the largest is of.

    Raises:
        ValueError: A rate or number that cannot be.

    >>> round(chi_squared_threshold(1e-5, tests=6), 1)
    22.9
    """
    with extra("baselines", "chi_squared_threshold"):
        from scipy.special import chdtri  # only here: SciPy is slow to import

    if not 0.0 < false_alarms < 1.0:
        raise ValueError(f"false_alarms is {false_alarms}; a rate above 0 and below 1 would be right")
    for name, number in (("degrees", degrees), ("tests", tests)):
        if number < 1:
            raise ValueError(f"{name} is {number}; one or more would be right")
    return float(chdtri(degrees, false_alarms / tests))


def healthy_firings(
    spacecraft: Spacecraft | str | Path,
    count: int,
    *,
    seed: int,
    open_thrusters: int | None = None,
    longest: float | None = None,
    duration: float | None = None,
    scatter: Literal["uniform", "normal"] = "uniform",
    differenced: bool = True,
) -> Firings:
    """Random firings of a sound vehicle, as it measures them.

    Each interval opens some thrusters, all choices equally likely, for uniform times. Thrust scatters from
    firing to firing by what the description says of each thruster, and the shared feed takes its loss.

    Args:
        spacecraft: Description, name or path.
        count: How many.
        seed: Of all draws.
        open_thrusters: How many are open in an interval; all by default.
        longest: Longest on-time, s; by default the duration.
        duration: Of an interval, s; by default the control period.
        scatter: Uniform within the bounds of the description, or normal with them as three standard
            deviations.
        differenced: Whether a rate change is the difference of two measured velocities, which has twice their
            variance, or has that of one of them.

    Raises:
        ValueError: A number that cannot be.

    >>> firings = healthy_firings("orion", 3, seed=0, open_thrusters=4, duration=1.0)
    >>> (firings.on_times > 0.0).sum(axis=1), firings.rate_change.shape
    (array([4, 4, 4]), (3, 6))
    """
    if isinstance(spacecraft, str | Path):
        spacecraft = load(spacecraft)
    n = spacecraft.number_of_thrusters
    duration = spacecraft.control_period if duration is None else duration
    longest = duration if longest is None else longest
    open_thrusters = n if open_thrusters is None else open_thrusters
    if count < 1:
        raise ValueError(f"count is {count}; one or more would be right")
    if not 0 <= open_thrusters <= n:
        raise ValueError(f"open_thrusters is {open_thrusters}; a number from 0 to {n} would be right")
    if not (0.0 < duration < math.inf and 0.0 <= longest <= duration):
        raise ValueError(
            f"longest is {longest} and duration {duration}; 0 <= longest <= duration s, finite, would be "
            "right"
        )
    rng = np.random.default_rng(seed)
    on_times = np.zeros((count, n))
    chosen = rng.permuted(np.tile(np.arange(n), (count, 1)), axis=1)[:, :open_thrusters]
    np.put_along_axis(on_times, chosen, rng.uniform(0.0, longest, chosen.shape), axis=1)
    bounds = np.array([one.scatter for one in spacecraft.thrusters])
    if scatter == "uniform":
        share = 1.0 + bounds * rng.uniform(-1.0, 1.0, on_times.shape)
    elif scatter == "normal":
        share = 1.0 + bounds / 3.0 * rng.normal(size=on_times.shape)
    else:
        raise ValueError(f"scatter is {scatter!r}; 'uniform' or 'normal' would be right")
    sensors = np.repeat([spacecraft.sensors.velocity, spacecraft.sensors.rate], 3)
    errors = math.sqrt(2.0 if differenced else 1.0) * sensors * rng.normal(size=(count, 6))
    delivered = delivered_on_times(on_times, spacecraft.feed.coupling)
    expectation = Expectation(spacecraft, count)
    if not expectation.follows:
        delivered = expectation.update(np.minimum(on_times / duration, 1.0), duration).on_times
    return Firings(on_times, (share * delivered) @ spacecraft.effectiveness().T + errors, float(duration))


def _upper(successes: int, trials: int, confidence: float) -> float:
    """One-sided upper bound of a rate; one end of the two-sided interval that leaves twice as much out."""
    if successes >= trials:
        return 1.0
    return clopper_pearson(successes, trials, 2.0 * confidence - 1.0)[1]


def _per_interval(rate: float, intervals: int) -> float:
    """The rate of each of independent intervals of which one or more alarm at `rate`."""
    return 1.0 if rate >= 1.0 else -math.expm1(math.log1p(-rate) / intervals)
