"""The sample craft of the detection study: how it fires, how it fails, and what its detectors say.

The source does not say how its random firings were drawn. Here, as far as its other statements tell: the
thrusters of Orion, intervals of 1 s, four thrusters open in each, all choices equally likely, for uniform
times; thrust scatters uniformly by 10 % from firing to firing; a measured rate change has errors of 0.5 mm/s
and 0.5 mrad/s (with the 0.5 degrees/s that the source writes too, its thresholds would alarm all the time;
see E35). On-times are effective: the loss of the shared feed plays no part. The filter has R = 10 and Q =
0.01, and begins with the covariance at which it settles. A flight is healthy, then one thruster, any of them,
keeps a quarter of its thrust.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from reproductions.record import Effort
from thruster_baselines.detection import (
    BaseDetector,
    EstimatorThreshold,
    GenericChiSquared,
    GLRDetector,
    SetChiSquared,
    SingleChiSquared,
)
from thruster_baselines.detection.evaluate import Rate
from thruster_baselines.detection.settings import SOURCE_MEASUREMENT_NOISE, SOURCE_PROCESS_NOISE
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import load

EFFECTIVENESS = load("orion").effectiveness()
AXES, THRUSTERS = EFFECTIVENESS.shape
OPEN = 4  # thrusters in an interval
ERROR = 0.5e-3  # m/s and rad/s, of a rate change
SCATTER = 0.1  # bound
KEPT = 0.25  # of the thrust of the one that fails
WINDOW = 20  # intervals in which alarms are counted, before and after the onset
SETTLING = 40  # intervals before them
ONSET = SETTLING + WINDOW
FALSE_ALARMS = 0.02  # of windows, at the noise of the source
CONFIDENCE = 0.95
_PER_EFFORT = 20  # flights for each flight of the effort: 2,000 at full effort

DETECTORS: dict[str, Callable[..., BaseDetector]] = {
    "estimate below threshold": EstimatorThreshold,
    "generic chi-squared": GenericChiSquared,
    "single chi-squared": SingleChiSquared,
    "set chi-squared": SetChiSquared,
    "likelihood ratio": GLRDetector,
}
"""The five of the source."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What is swept."""

    error: float = 1.0  # of the measurements, as a multiple of the source's
    scatter: float = 1.0  # of the firings, as a multiple of the source's
    measurement_noise: float = SOURCE_MEASUREMENT_NOISE  # R of the filter
    process_noise: float = SOURCE_PROCESS_NOISE  # Q of the filter

    def filter_settings(self) -> dict[str, Any]:
        """What a detector is given: R, Q, and the covariance at which Q u^2 balances what is learned."""
        mean_square = OPEN / THRUSTERS / 3.0  # of an on-time
        settled = np.sqrt(self.process_noise * self.measurement_noise / mean_square)
        return {
            "noise": self.measurement_noise, "process_noise": self.process_noise,
            "initial_covariance": float(settled),
        }  # fmt: skip


@dataclass(frozen=True)
class Record:
    """What the detectors said of the same flights, in every interval."""

    statistic: dict[str, FloatArray]  # by detector, (flights, intervals)
    named: dict[str, IntArray]  # by detector, (flights, intervals): whom it would blame, from 1; 0 for nobody
    thruster: IntArray  # (flights,), the one that fails, from 1


def flights_of(effort: Effort) -> int:
    """Flights of a point of a sweep."""
    return _PER_EFFORT * effort.flights


def random_on_times(
    rng: np.random.Generator, shape: tuple[int, ...], open_thrusters: int = OPEN, longest: float = 1.0
) -> FloatArray:
    """(*shape, n), s: so many thrusters open at random for uniform times."""
    times = np.zeros((*shape, THRUSTERS))
    chosen = np.argsort(rng.random(times.shape), axis=-1)[..., :open_thrusters]
    np.put_along_axis(times, chosen, rng.uniform(0.0, longest, chosen.shape), axis=-1)
    return times


def measure(
    rng: np.random.Generator,
    delivered: FloatArray,
    error: float | FloatArray = ERROR,
    scatter: float = SCATTER,
    effectiveness: FloatArray = EFFECTIVENESS,
) -> FloatArray:
    """(..., m): the rate change of on-times (..., n) that are delivered but for scatter, with errors."""
    share = 1.0 + scatter * rng.uniform(-1.0, 1.0, delivered.shape)
    change = (share * delivered) @ effectiveness.T
    return np.asarray(change + error * rng.normal(size=change.shape))


def fly(
    conditions: Conditions, flights: int, seed: int, watched: int = WINDOW
) -> tuple[FloatArray, FloatArray, IntArray]:
    """On-times and rate changes (intervals, flights, ...), and the thruster that fails, from 1.

    It fails after `ONSET` intervals, and so many more are watched.
    """
    rng = np.random.default_rng(seed)
    intervals = ONSET + watched
    commanded = random_on_times(rng, (intervals, flights))
    thruster = rng.integers(1, THRUSTERS + 1, flights)
    delivered = commanded.copy()
    delivered[ONSET:, np.arange(flights), thruster - 1] *= KEPT
    change = measure(rng, delivered, conditions.error * ERROR, conditions.scatter * SCATTER)
    return commanded, change, thruster


@cache
def record(conditions: Conditions, flights: int, seed: int) -> Record:
    """Fly, and write down what each detector says."""
    commanded, change, thruster = fly(conditions, flights, seed)
    statistic, named = {}, {}
    for name, detector_of in DETECTORS.items():
        detector = detector_of(EFFECTIVENESS, 0.0, vehicles=flights, **conditions.filter_settings())
        said = [detector.update(commanded[t], change[t], 1.0) for t in range(len(commanded))]
        statistic[name] = np.stack([one.statistic for one in said], axis=1)
        named[name] = np.stack([one.thruster for one in said], axis=1)
    return Record(statistic, named, thruster)


@cache
def calibrated(flights: int) -> dict[str, float]:
    """The threshold of each detector that 2 % of healthy windows exceed at the source's noise.

    The flights are others than those that are reported.
    """
    healthy = record(Conditions(), flights, seed=1)
    return {name: float(np.quantile(_largest(one, False), 1.0 - FALSE_ALARMS, method="higher"))
            for name, one in healthy.statistic.items()}  # fmt: skip


def alarm_rate(statistic: FloatArray, threshold: float, failed: bool) -> Rate:
    """The share of windows in which a statistic exceeds the threshold, before or after the onset."""
    alarms = _largest(statistic, failed) > threshold
    return Rate.of(int(alarms.sum()), len(alarms), CONFIDENCE)


def _largest(statistic: FloatArray, failed: bool) -> FloatArray:
    start = SETTLING + WINDOW * failed
    return np.asarray(statistic[:, start : start + WINDOW].max(axis=1))
