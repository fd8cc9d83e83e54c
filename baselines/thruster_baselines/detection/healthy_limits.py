"""What the statistics of healthy thrusters exceed at a stated rate, interval by interval: default thresholds.

For each projection d_i'e of a healthy residual, the variance follows from the on-times, by sensors and
scatter as described (`PhysicalNoise`) and by what the filter has wrongly learned before. The limit x of the
root of the likelihood ratio is where sum over i of P(|d_i' e| > x) is the stated rate, for a normal e: no
more than that rate however the projections depend on each other (docs/derivations/healthy_limits.md).

Left out: biases of sensors, free motion that was not taken off, thrusters that are not as described.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.interval import Interval, whiten
from thruster_baselines.detection.settings import FALSE_ALARMS, FilterSettings
from thruster_baselines.estimation import EffectivenessFilter, PhysicalNoise
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["FALSE_ALARMS", "HealthyLimits", "LimitedDetector"]


class HealthyLimits:
    """Follows what sensors and scatter do to the residual and to the estimate of healthy vehicles.

    Args:
        noise: Of the rate change, by the description of the vehicle.
        filter_: Of the detector. If it learns, it has to be of the form `shared`.
        false_alarms: Rate per interval, above 0 and below 1.

    Raises:
        ValueError: A rate that cannot be, a filter of another form.
    """

    def __init__(self, noise: PhysicalNoise, filter_: EffectivenessFilter, false_alarms: float) -> None:
        from scipy.special import ndtri  # only here: SciPy is slow to import

        if not 0.0 < false_alarms < 1.0:
            raise ValueError(f"false_alarms must be above 0 and below 1, got {false_alarms}")
        if filter_.form not in ("known", "shared"):
            raise ValueError(
                "threshold must be given, got None: with a filter that learns, it follows from false_alarms "
                "only where noise and process_noise are one number for all axes"
            )
        self._filter, self._noise, self._rate = filter_, noise, false_alarms
        n = noise.effectiveness.shape[1]
        self._one, self._one_of_all = float(-ndtri(0.5 * false_alarms)), float(-ndtri(false_alarms / n))
        self.reset()

    def reset(self, mask: BoolArray | None = None) -> None:
        """Nothing has been learned wrongly in the vehicles of a mask (vehicles,), or in all of them."""
        if mask is None:
            count, _, n = self._filter.effectiveness.shape
            self._wrong: FloatArray = np.zeros((count, n, n))
            self._gain: FloatArray = np.zeros((count, n))
            return
        self._wrong[mask], self._gain[mask] = 0.0, 0.0

    def forget(self, mask: BoolArray, thruster: int) -> None:
        """Nothing has been learned wrongly of a thruster, numbered from 1, in the vehicles of a mask."""
        self._wrong[mask, thruster - 1, :] = 0.0
        self._wrong[mask, :, thruster - 1] = 0.0
        self._gain[mask, thruster - 1] = 0.0

    def of_ratio(
        self,
        on_times: FloatArray,
        covariance: FloatArray,
        effectiveness: FloatArray,
        valid: BoolArray,
        least: float,
        more: FloatArray | None = None,
    ) -> FloatArray:
        """(vehicles,): the limit of the largest (a' Y^-1 e)^2 / (a' Y^-1 a) over thrusters.

        To be called once for each interval, after the filter has taken it in.

        Args:
            on_times: (vehicles, n), s, effective.
            covariance: (vehicles, m, m), Y.
            effectiveness: (vehicles, m, n), whose columns are a; those of zeros do not count.
            valid: (vehicles,), whether there was a measurement.
            least: Limits below this need not be exact.
            more: (vehicles, m, m), covariance of what no model knows; by default none.
        """
        limit = np.zeros(len(on_times))
        self._follow(
            on_times, covariance, effectiveness, valid, limit, np.zeros(on_times.shape), least, False, more
        )
        return limit

    def of_lost_share(
        self,
        on_times: FloatArray,
        scale: FloatArray,
        effectiveness: FloatArray,
        valid: BoolArray,
        more: FloatArray | None = None,
    ) -> FloatArray:
        """(vehicles,): the limit of the largest share that the estimate of a thruster has lost.

        To be called once for each interval, after the filter has taken it in.

        Args:
            on_times: (vehicles, n), s, effective.
            scale: (vehicles, m, m), diagonal: the squares of the units in which columns are compared.
            effectiveness: (vehicles, m, n), believed; columns of zeros do not count.
            valid: (vehicles,), whether there was a measurement.
            more: (vehicles, m, m), covariance of what no model knows; by default none.
        """
        deviation, limit = np.zeros(on_times.shape), np.zeros(len(on_times))
        self._follow(on_times, scale, effectiveness, valid, limit, deviation, 0.0, True, more)
        return np.asarray(self._one_of_all * deviation.max(axis=1))

    def _follow(
        self, on_times: FloatArray, metric: FloatArray, effectiveness: FloatArray, valid: BoolArray,
        limit: FloatArray, deviation: FloatArray, least: float, shares: bool, more: FloatArray | None,
    ) -> None:  # fmt: skip
        covariance, variance = self._filter.shared_covariance()
        noise = self._noise
        extra = np.zeros((len(on_times), noise.sensors.size))
        if more is not None:  # on each axis as much as the largest in any direction
            extra[:, :3] = np.trace(more[:, :3, :3], axis1=1, axis2=2)[:, np.newaxis]
            extra[:, 3:] = np.trace(more[:, 3:, 3:], axis1=1, axis2=2)[:, np.newaxis]
        test = on_times, metric, effectiveness, valid, self._rate, self._one, least, shares, extra
        errors = noise.sensors, noise.effectiveness, noise.scatter, covariance, variance
        work = partial(_propagate, test, errors, self._wrong, self._gain, limit, deviation)
        in_threads(work, len(on_times))


class _Test(NamedTuple):
    """What is tested in an interval: (vehicles, ...), the rate with its quantile, and what is asked for."""

    on_times: FloatArray
    metric: FloatArray
    effectiveness: FloatArray
    valid: BoolArray
    rate: float
    quantile: float
    least: float
    shares: bool
    more: FloatArray


class _Errors(NamedTuple):
    """Variances of the sensors (m,), columns (m, n), scatter (n,), and the filter's covariance and noise."""

    sensors: FloatArray
    columns: FloatArray
    scatter: FloatArray
    covariance: FloatArray
    noise: float


class LimitedDetector(BaseDetector):
    """A detector that without a threshold takes what healthy vehicles exceed at a stated rate.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n), with which a threshold is needed
            unless the noise is `PhysicalNoise`.
        threshold: What the statistic has to exceed for a detection, in every interval, or None.
        least: What it has to exceed at least if none is given.
        false_alarms: Rate per interval, if no threshold is given.
        settings: Of the filter and of the feed; see `FilterSettings`.

    Attributes:
        limit: (vehicles,), what the statistic had to exceed in the last interval.
    """

    limit: FloatArray

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        threshold: float | None,
        least: float,
        *,
        false_alarms: float,
        **settings: Unpack[FilterSettings],
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        self._healthy: HealthyLimits | None = None
        self._without = False
        super().__init__(spacecraft, least if threshold is None else threshold, **settings)
        self.limit = np.full(self._vehicles, self._threshold)
        if threshold is not None:
            return
        noise = settings.get("noise")
        if isinstance(spacecraft, Spacecraft) and not isinstance(noise, PhysicalNoise):
            noise = PhysicalNoise(spacecraft)
        self._without = not isinstance(noise, PhysicalNoise)
        if isinstance(noise, PhysicalNoise):
            self._healthy = HealthyLimits(noise, self.filter, false_alarms)

    @property
    def threshold(self) -> float:
        """What the statistic has to exceed, or without a threshold what it has to exceed at least.

        Setting it ends that it follows from the false-alarm rate.
        """
        return self._threshold

    @threshold.setter
    def threshold(self, value: float) -> None:
        self._threshold, self._healthy, self._without = float(value), None, False

    def _limits_of(self, interval: Interval) -> FloatArray:
        """(vehicles,): what the statistic has to exceed in an interval that the filter has taken in."""
        if self._healthy is None:
            if self._without and interval.valid.any():
                raise ValueError(
                    "threshold must be given, got None: an effectiveness matrix says nothing of sensors and "
                    "scatter (a description of the spacecraft or noise=PhysicalNoise(...) does)"
                )
            self.limit = np.full(self._vehicles, self._threshold)
        else:
            self.limit = np.maximum(self._healthy_limit(self._healthy, interval), self._threshold)
        return self.limit

    def _healthy_limit(self, healthy: HealthyLimits, interval: Interval) -> FloatArray:
        """(vehicles,): what the statistic of healthy vehicles exceeds at the stated rate."""
        raise NotImplementedError

    def _begin(self, mask: BoolArray) -> None:
        super()._begin(mask)
        if self._healthy is not None:
            self._healthy.reset(mask)

    def _replace(self, mask: BoolArray, thruster: int, columns: FloatArray) -> None:
        super()._replace(mask, thruster, columns)
        if self._healthy is not None:
            self._healthy.forget(mask, thruster)


@kernel(nogil=True)
def _propagate(
    test: _Test,
    errors: _Errors,
    wrong: FloatArray,
    gain: FloatArray,
    limit: FloatArray,
    deviation: FloatArray,
    first: int,
    last: int,
) -> None:
    """Limits of the ratio (vehicles,), deviations of the shares (vehicles, n); `wrong` and `gain` go on."""
    on_times, metric, effectiveness, valid, rate, quantile, least, shares, more = test
    sensors, columns, scatter, covariance, noise = errors
    m, n = columns.shape
    learns = covariance.shape[0] > 0
    root, none, white = np.empty((m, m)), np.empty(m), np.empty((m, n))
    d, k, mu, spread, along, fired = (
        np.empty(m), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    )  # fmt: skip
    for v in range(first, last):
        if not valid[v]:
            gain[v] = 0.0
            continue
        u = on_times[v]
        learned, again = 0.0, 0.0
        for i in range(n):
            fired[i] = scatter[i] * u[i]
            mu[i] = 0.0
        if learns:
            for j in range(n):
                if u[j] != 0.0:
                    for i in range(n):
                        mu[i] += wrong[v, j, i] * u[j]
            for i in range(n):
                learned += mu[i] * u[i]
                again += gain[v, i] * u[i]
        again = max(again, 0.0)
        whiten(metric[v], sensors, effectiveness[v], root, none, white)
        largest = 0.0
        for i in range(n):
            square = 0.0
            for axis in range(m):
                square += white[axis, i] ** 2
            spread[i] = 0.0
            if square == 0.0:
                continue
            deviation[v, i] = 1.0 / square
            size = math.sqrt(square)
            length, by_sensors, by_scatter = 0.0, 0.0, 0.0
            for j in range(n):
                along[j] = 0.0
            for back in range(m):  # d = L^-T w / |w|
                axis = m - 1 - back
                d[axis] = white[axis, i] / size
                for other in range(axis + 1, m):
                    d[axis] -= root[other, axis] * d[other]
                d[axis] /= root[axis, axis]
                length += d[axis] ** 2
                by_sensors += d[axis] ** 2 * (sensors[axis] + more[v, axis])
                if d[axis] != 0.0:
                    for j in range(n):
                        along[j] += d[axis] * columns[axis, j]
            for j in range(n):
                by_scatter += (fired[j] * along[j]) ** 2
            along_one = by_scatter + 2.0 * by_sensors
            largest = max(largest, along_one if shares else along_one / length)
            spread[i] = math.sqrt(by_scatter + (1.0 + again) * by_sensors + length * learned)
        if not shares:
            limit[v] = _union_limit(spread, rate, quantile, least)
        if learns:
            total = learned + largest
            for i in range(n):
                k[i] = 0.0
                for j in range(n):
                    k[i] += covariance[v, i, j] * u[j]
                k[i] /= noise
            for i in range(n):
                for j in range(n):
                    wrong[v, i, j] += total * k[i] * k[j] - k[i] * mu[j] - mu[i] * k[j]
                gain[v, i] = k[i]
        for i in range(n):
            deviation[v, i] = math.sqrt(max(wrong[v, i, i], 0.0) * deviation[v, i])


@njit(error_model="numpy")
def _union_limit(spread: FloatArray, rate: float, quantile: float, least: float) -> float:
    """The square that those of normal variables exceed at no more than a rate, any of them; or below `least`.

    Newton's method on the logarithm of the sum of their tails, from the quantile of the widest alone.

    Args:
        spread: (n,), deviations.
        rate: Above 0 and below 1.
        quantile: What a variable of deviation 1 exceeds in size at that rate.
        least: Below this the answer need not be exact, but only not too small.
    """
    widest: float = spread.max()
    x = quantile * widest
    if 2.0 * x**2 <= least:  # twice as much is enough for a hundred of them and any rate below 0.2
        return 2.0 * x**2
    for _ in range(2):  # the first step is a per cent too long at most
        tails, slope = 0.0, 0.0
        for i in range(spread.size):
            if spread[i] > 0.0:
                far = x / (math.sqrt(2.0) * spread[i])
                tails += math.erfc(far)
                slope += math.exp(-far * far) * math.sqrt(2.0 / math.pi) / spread[i]
        x += math.log(tails / rate) * tails / slope
    return float(x**2)
