"""A detector for every kind of fault: force and torque residuals together, in a likelihood ratio.

The source looks at position alone, where a valve stuck open and the loss of its opposite corner pull the same
way. Torque tells them apart, since opposite corners turn the same way, and the measured rate shows it within
a few samples. So here

1. an observer of position and velocity and one of the rate, both steady Kalman filters fed with the thrust
   that the valves were told a fixed number of periods ago, give innovations of force and torque;
2. a thruster that from an onset on gives the share a of its thrust more than it was told, or less for a < 0,
   adds a known signature to both, times a. With c and s the weighted products of signature and innovation and
   of signature and signature, twice the log-likelihood of the best a within -1..1 against none is 2 a c - a^2
   s. The largest over thrusters and a few onsets is the statistic. Onsets are those of sums that begin anew
   every 4, 12 and 36 samples by turns, two of each, so that every age up to 72 samples is within a factor of
   three of one;
3. after an alarm, the thruster is named whose likelihood stays ahead of the next one's by `margin`;
4. `identify` says what is wrong with the named one, at that moment or later, when more has been seen: from
   the kept samples, the whole course of the open rate under each kind of fault, its size and its onset is
   sent through the filters, and the likeliest kind that its one or no free number is worth (by the Bayesian
   information criterion) is the answer.

What is no fault and looks like one is taken care of twice. Errors of mass properties and thrust act as a
constant force and torque in an even flight; a bias, which follows over `bias_time` until the alarm, takes
them up, and with them whatever fault comes as slowly. The timing of pulses varies by `timing`: it moves
impulse from one period to the next, so that the wider the pulses of the moment, the less a single measured
rate counts; and where the command changes, a common shift leaves a wrong velocity behind, so that after an
abrupt manoeuvre both residuals count less for as long as the filters remember it.

Samples are kept until some seconds after an alarm and no longer, so that those at the onset stay.

What cannot be told apart: a leak and a valve stuck at the same opening as long as no more was commanded,
which then goes by the name of the latter; a loss and a late opening while the command stays the same; a late
and a slow valve, which shift thrust in nearly the same way, and either of them and a sound one once they have
begun, while commands do not change. Left out: several faults at once, faults that turn a thrust, thrust lost
to a shared feed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.detection.identification import Identification
from thruster_baselines.detection.residuals.base import (
    SETTLING_TIME,
    BaseNavigationDetector,
    Sample,
    nominal_delay,
    take_attitude,
)
from thruster_baselines.guidance.hcw import force_response, transition_matrix
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.configuration import require
from thruster_envs.physics.attitude import rotate, rotate_back
from thruster_envs.protocols import BoolArray, Diagnosis, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FUSION_KINDS", "FusionDetector"]

FUSION_KINDS = ("none", "stuck_off", "stuck_on", "loss", "leak", "late_opening", "slow_opening")
"""What `FusionDetector.identify` tells apart, named as in `thruster_envs.faults`.

A late opening is one of two: the beginning of each pulse is lost, or all of it comes later.
"""

_NONE, _STUCK_OFF, _STUCK_ON, _LOSS, _LEAK, _LATE, _SLOW = range(7)

_SCALES = (4, 12, 36)
"""Samples after which sums begin anew."""

_AGES = (2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 26, 31, 37, 44, 51, 57, 62, 65, 68, 71, 74, 78, 82, 86, 90)
"""Onsets that identification tries, samples before the last that is kept."""

_KEPT = 112
"""Samples that identification looks back on."""

_AFTER = 60
"""Samples that are kept after an alarm."""

_LATEST = 12
"""Largest lag of the thrust behind its command, periods."""

_LEVELS = tuple(0.05 * k for k in range(1, 20))
"""Openings of a leak that identification tries."""

_LOST_TIMES = (0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.1, 0.13, 0.17, 0.22, 0.3, 0.45)
"""Lost beginnings of a pulse that identification tries, in periods."""

_DELAYS = (1.0, 2.0, 3.0, 5.0, 8.0)
"""Further delays that identification tries, in periods."""

_TIME_CONSTANTS = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
"""Time constants of a slow valve that identification tries, in periods; it may be open as it becomes slow."""

_PERSISTENCE = 10.0
"""How many samples the error of a wrong velocity counts for, since it is the same in all of them."""

_NEARLY = 0.04
"""A share this near to 0 or 1 is taken for it."""

# one sum: states of the signature, then products with the innovations, then with itself
_POSITION, _VELOCITY, _RATE, _FORCE, _TORQUE, _FORCE_SQUARE, _TORQUE_SQUARE = 0, 1, 2, 3, 6, 9, 10
_SUM = 13

# states after position, velocity and rate: force and torque over mass and inertia that are always there, what
# a shift of all pulses by a second would do to position, velocity and rate, and the last commanded force and
# torque
_BIAS, _SHIFTED, _LAST, _STATES = 9, 15, 24, 30


class FusionDetector(BaseNavigationDetector):
    """Alarms, names the thruster and says what is wrong with it, for every kind of fault.

    Args:
        spacecraft: Description, name or path: also of its sensors' errors and its inertia.
        threshold: Of twice the log-likelihood ratio, dimensionless.
        margin: By how much the named thruster's has to be ahead of every other's.
        confirmations: Samples in a row in which it has to be.
        lag: How many periods the thrust comes after its command; by default the nominal delay.
        timing: Standard deviation of the moment at which a pulse comes, s; by default the modulator's.
        disturbance: Standard deviation of unmodelled acceleration, new in each sample, as a share of what the
            average thruster gives; it sets how soon the filters forget.
        bias_time: Over which a constant force and torque is taken up, s; infinite takes up none.
        use_rate: Whether the rate is looked at; otherwise it is the likelihood ratio of the force alone.
        settle: How long after the first sample there are no alarms, s.
        vehicles: How many are watched.

    Attributes:
        share: (vehicles, n), the best a of each thruster in the last sample.
        first_velocity: (vehicles, 3), m/s, LVLH, with which the observer begins; zero unless it is set before
            the first sample. Where it is right, the filter has no swing to settle from.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path,
        threshold: float,
        *,
        margin: float = 12.0,
        confirmations: int = 3,
        lag: int | None = None,
        timing: float | None = None,
        disturbance: float = 0.01,
        bias_time: float = 20.0,
        use_rate: bool = True,
        settle: float = SETTLING_TIME,
        vehicles: int = 1,
    ) -> None:
        super().__init__(spacecraft, threshold, settle=settle, vehicles=vehicles)
        require(margin >= 0.0, "margin", margin, "a number of 0 or more")
        require(confirmations >= 1, "confirmations", confirmations, "one sample or more")
        if lag is None:
            lag = round(nominal_delay(self.spacecraft) / self._period)
        if timing is None:
            modulator = self.spacecraft.modulator
            timing = 0.0
            if modulator is not None:
                timing = math.sqrt(modulator.variation**2 / 2.0 + modulator.jitter**2 / 3.0)
        require(0 <= lag < _LATEST - 1, "lag", lag, f"a number of periods from 0 to {_LATEST - 2}")
        require(0.0 <= timing < math.inf, "timing", timing, "a number of s, 0 or more")
        require(0.0 < disturbance < math.inf, "disturbance", disturbance, "a share above 0")
        require(bias_time > 0.0, "bias_time", bias_time, "a positive number of s")
        sensors = self.spacecraft.sensors
        require(sensors.position > 0.0, "sensors: position", sensors.position, "an error above 0")
        if use_rate:
            require(sensors.rate > 0.0, "sensors: rate", sensors.rate, "an error above 0")
        self.margin, self.confirmations, self.lag = float(margin), int(confirmations), int(lag)
        self.use_rate = use_rate
        period, motion = self._period, self.spacecraft.mean_motion
        columns = self.spacecraft.effectiveness()
        force = disturbance * float(np.linalg.norm(columns[:3], axis=0).mean())
        torque = disturbance * float(np.linalg.norm(columns[3:], axis=0).mean())
        idle = timing * float(np.sqrt(np.square(columns[3:]).sum(axis=1)).mean()) / 3.0
        self._gains, variance = _steady_gains(
            period, sensors.position, force, math.hypot(sensors.rate, idle), torque
        )
        self._noise = np.array([variance, sensors.rate**2, (period * torque) ** 2, timing, 1.0 / bias_time])
        self._motion = np.hstack([transition_matrix(motion, period), force_response(motion, period)])
        inertia = np.array(self.spacecraft.inertia)
        self._spin = np.stack([inertia, np.linalg.inv(inertia)])
        n = self._n
        self._states: FloatArray = np.zeros((vehicles, _STATES))
        self._begun: BoolArray = np.zeros(vehicles, np.bool_)
        self.first_velocity: FloatArray = np.zeros((vehicles, 3))
        self._scales: IntArray = np.array(_SCALES)
        self._sums: FloatArray = np.zeros((vehicles, 2 * len(_SCALES), _SUM))
        self._ahead: IntArray = np.zeros((vehicles, 2), np.int64)  # thruster, how often in a row
        self._commands: FloatArray = np.zeros((_LATEST, vehicles, n))
        self._newest: IntArray = np.zeros(vehicles, np.int64)  # the last sample that is kept
        self._rates: FloatArray = np.zeros((_KEPT, vehicles, n))
        # innovations of force and torque, body axes, and the weights of torque
        self._seen: FloatArray = np.zeros((_KEPT, vehicles, 10))
        self.share: FloatArray = np.zeros((vehicles, n))
        self.reset()

    def identify(self, thruster: ArrayLike | None = None) -> Identification:
        """What is wrong with the named thruster of each vehicle, by all that is kept of its flight.

        Args:
            thruster: (vehicles,), from 1; 0 for none. By default those that have been named.

        Returns:
            `kind` is one of `FUSION_KINDS`, `severity` its size, and `statistic` (vehicles, kinds) twice the
            log-likelihood ratio of each kind against none, less the price of its free number.

        Raises:
            ValueError: A thruster that does not exist.
        """
        named = self.thruster if thruster is None else np.asarray(thruster, dtype=np.int64)
        if named.shape != (self._vehicles,) or (named < 0).any() or (named > self._n).any():
            raise ValueError(
                f"thruster is {named.tolist()}; {self._vehicles} numbers from 0 to {self._n} would be right"
            )
        statistic = np.zeros((self._vehicles, len(FUSION_KINDS)))
        severity = np.zeros((self._vehicles, len(FUSION_KINDS)))
        work = partial(
            _identify, self._rates, self._seen, self._newest, self.effectiveness, named, self.lag,
            self._period, self._gains, _grid(_AGES), _grid(_LEVELS), _grid(_LOST_TIMES),
            _grid(_DELAYS), _grid(_TIME_CONSTANTS), statistic, severity,
        )  # fmt: skip
        in_threads(work, self._vehicles)
        best = np.where(named > 0, statistic.argmax(axis=1), _NONE)
        size = severity[np.arange(self._vehicles), best]
        closed = ((best == _STUCK_ON) & (size < _NEARLY)) | ((best == _LOSS) & (size > 1.0 - _NEARLY))
        best = np.where(closed, _STUCK_OFF, best)
        size = np.where(closed, 1.0, size)
        return Identification(tuple(FUSION_KINDS[one] for one in best), size, statistic)

    def _begin(self, mask: BoolArray) -> None:
        self._begun[mask] = False

    def _clear(self, mask: BoolArray) -> None:
        super()._clear(mask)
        self._sums[mask] = 0.0
        self._ahead[mask] = 0
        self._seen[:, mask] = 0.0
        self.share[mask] = 0.0

    def _judge(self, sample: Sample) -> Diagnosis:
        statistic = np.zeros(self._vehicles)
        suspicion = np.zeros((self._vehicles, self._n))
        work = partial(
            _watch, sample.open_rates, sample.position, sample.attitude, sample.rate, sample.valid,
            self.use_rate and sample.rate is not self._no_rate, self._attitude, self.samples, self._period,
            self.settle, self.threshold, self.margin, self.confirmations, self.lag, self.effectiveness,
            self._motion, self._spin, self._gains, self._noise, self._states, self._begun,
            self.first_velocity, self._scales, self._sums, self._commands, self._newest, self._rates,
            self._seen, self._ahead, self.refused, self.detected, self.thruster, self.detection_time,
            self.isolation_time, self.share, suspicion, statistic,
        )  # fmt: skip
        in_threads(work, self._vehicles)
        return self._answer(statistic, suspicion, -self._period * self.share)


def _grid(values: Sequence[float]) -> FloatArray:
    return np.array(values, dtype=np.float64)


def _steady_gains(
    period: float, position: float, force: float, rate: float, torque: float
) -> tuple[FloatArray, float]:
    """Gains of steady Kalman filters for white measurement errors and white accelerations.

    Returns:
        (3,) gains of position, of velocity by position, and of rate; the variance of a position's innovation.
    """
    step = np.array([[1.0, period], [0.0, 1.0]])
    push = np.array([0.5 * period**2, period])
    noise = force**2 * np.outer(push, push)
    covariance = np.diag([position**2, (position / period) ** 2])
    for _ in range(2000):
        gain = covariance[:, 0] / (covariance[0, 0] + position**2)
        covariance = step @ (covariance - np.outer(gain, covariance[0])) @ step.T + noise
    turned = (period * torque) ** 2
    before = 0.5 * (turned + math.sqrt(turned**2 + 4.0 * turned * rate**2))
    gains = np.array([gain[0], gain[1], before / (before + rate**2)])
    return gains, float(covariance[0, 0] + position**2)


@njit(error_model="numpy", cache=True, nogil=True)
def _watch(  # type: ignore[no-untyped-def]
    open_rates, position, attitude, rate, valid, use_rate, last_attitude, samples, period, settle, threshold,
    margin, confirmations, lag, effectiveness, motion, spin, gains, noise, states, begun, first_velocity,
    scales, sums, commands, newest, rates, seen, ahead, refused, detected, thruster, detection_time,
    isolation_time, share, suspicion, statistic, first, last,
):  # fmt: skip
    n, kept, latest, after = open_rates.shape[1], rates.shape[0], commands.shape[0], _AFTER
    before, e, momentum, weight = np.empty(9), np.empty(6), np.empty(3), np.empty(3)
    angular, products, squares = np.empty(3), np.empty(n), np.empty(n)
    for v in range(first, last):
        number = samples[v]
        samples[v] += 1
        keep = not detected[v] or number * period < detection_time[v] + (after + 0.5) * period
        slot = number % kept
        for i in range(n):
            commands[number % latest, v, i] = open_rates[v, i]
        if keep:
            newest[v] = number
            for i in range(n):
                rates[slot, v, i] = open_rates[v, i]
        there, turning = valid[v], False
        old = (last_attitude[v, 0], last_attitude[v, 1], last_attitude[v, 2], last_attitude[v, 3])
        if there:
            there = np.isfinite(position[v, 0] + position[v, 1] + position[v, 2])
            there = there and take_attitude(attitude, last_attitude, v)
            turning = use_rate and there and np.isfinite(rate[v, 0] + rate[v, 1] + rate[v, 2])
            if not there:
                refused[v] += 1
        x = states[v]
        if not begun[v]:
            for j in range(seen.shape[2]):
                seen[slot, v, j] = 0.0
            if there:
                begun[v] = True
                for j in range(_STATES):
                    x[j] = 0.0
                for j in range(3):
                    x[j] = position[v, j]
                    x[3 + j] = first_velocity[v, j]
                    x[6 + j] = rate[v, j] if turning else 0.0
            continue
        # what the thrust of the last period should have done
        told = commands[(number - 1 - lag) % latest if number > lag else 0, v]
        fx, fy, fz = 0.0, 0.0, 0.0
        for k in range(3):
            angular[k] = 0.0
            weight[k] = 0.0
        for i in range(n):
            u = told[i]
            fx += effectiveness[v, 0, i] * u
            fy += effectiveness[v, 1, i] * u
            fz += effectiveness[v, 2, i] * u
            moved = min(0.45 * u * period, 0.6 * noise[3])  # s of firing that come before or after the edge
            for k in range(3):
                angular[k] += effectiveness[v, 3 + k, i] * u
                spill = effectiveness[v, 3 + k, i] * moved
                weight[k] += spill * spill
        force = rotate_back(old, (fx, fy, fz))
        for j in range(6):
            total = (
                motion[j, 6] * (force[0] + x[_BIAS]) + motion[j, 7] * (force[1] + x[_BIAS + 1])
                + motion[j, 8] * (force[2] + x[_BIAS + 2])
            )  # fmt: skip
            for k in range(6):
                total += motion[j, k] * x[k]
            before[j] = total
        for j in range(3):
            momentum[j] = spin[0, j, 0] * x[6] + spin[0, j, 1] * x[7] + spin[0, j, 2] * x[8]
        gx = x[7] * momentum[2] - x[8] * momentum[1]
        gy = x[8] * momentum[0] - x[6] * momentum[2]
        gz = x[6] * momentum[1] - x[7] * momentum[0]
        for j in range(3):
            free = spin[1, j, 0] * gx + spin[1, j, 1] * gy + spin[1, j, 2] * gz
            before[6 + j] = x[6 + j] + period * (angular[j] + x[_BIAS + 3 + j] - free)
        # what a common shift of the pulses does
        shifted, calm = 0.0, number <= lag + 1
        for j in range(3):
            change = 0.0 if calm else force[j] - x[_LAST + j]
            turn = 0.0 if calm else angular[j] - x[_LAST + 3 + j]
            x[_LAST + j], x[_LAST + 3 + j] = force[j], angular[j]
            x[_SHIFTED + j] += period * x[_SHIFTED + 3 + j] + 0.5 * period * change
            x[_SHIFTED + 3 + j] += change
            x[_SHIFTED + 6 + j] += turn
            shifted += x[_SHIFTED + j] ** 2
            weight[j] += _PERSISTENCE * noise[3] ** 2 * x[_SHIFTED + 6 + j] ** 2
        shifted = 1.0 / (
            noise[0] + _PERSISTENCE * noise[3] ** 2 * shifted
        )  # the weight of each axis of force
        # what it did
        time = number * period
        learning = noise[4] if time >= 0.25 * settle and not detected[v] else 0.0
        for j in range(6):
            e[j] = 0.0
        for j in range(9):
            x[j] = before[j]
        if there:
            q = (last_attitude[v, 0], last_attitude[v, 1], last_attitude[v, 2], last_attitude[v, 3])
            missed = (position[v, 0] - before[0], position[v, 1] - before[1], position[v, 2] - before[2])
            for j in range(3):
                x[j] += gains[0] * missed[j]
                x[3 + j] += gains[1] * missed[j]
                x[_BIAS + j] += learning * gains[1] * missed[j]
                p = x[_SHIFTED + j]
                x[_SHIFTED + j] -= gains[0] * p
                x[_SHIFTED + 3 + j] -= gains[1] * p
            body = rotate(q, missed)
            e[0], e[1], e[2] = body
        if turning:
            for j in range(3):
                e[3 + j] = rate[v, j] - before[6 + j]
                x[6 + j] += gains[2] * e[3 + j]
                x[_BIAS + 3 + j] += learning * gains[2] * e[3 + j]
                x[_SHIFTED + 6 + j] -= gains[2] * x[_SHIFTED + 6 + j]
                weight[j] = 1.0 / ((noise[1] + weight[j]) / (1.0 - gains[2]) + noise[2])
        if keep:
            for j in range(6):
                seen[slot, v, j] = e[j]
            for j in range(3):
                seen[slot, v, 6 + j] = weight[j] if turning else 0.0
            seen[slot, v, 9] = shifted if there else 0.0
        # sums since their onsets
        for m in range(sums.shape[1]):
            one = sums[v, m]
            p = one[0] + period * one[1] + 0.5 * period * period
            w = one[2] + period
            one[0], one[1], one[2] = p, one[1] + period, w
            if there:
                one[0] -= gains[0] * p
                one[1] -= gains[1] * p
                weighed = p * shifted
                for j in range(3):
                    one[3 + j] += weighed * e[j]
                one[9] += weighed * p
            if turning:
                one[2] -= gains[2] * w
                for j in range(3):
                    one[6 + j] += w * weight[j] * e[3 + j]
                    one[10 + j] += w * w * weight[j]
        if time >= settle:
            for m in range(sums.shape[1]):
                one = sums[v, m]
                if one[9] == 0.0 and one[10] == 0.0:
                    continue
                for i in range(n):
                    products[i] = 0.0
                    squares[i] = 0.0
                for k in range(6):
                    product, square = one[3 + k], one[9] if k < 3 else one[7 + k]
                    for i in range(n):
                        column = effectiveness[v, k, i]
                        products[i] += column * product
                        squares[i] += column * column * square
                for i in range(n):
                    c, s = products[i], squares[i]
                    a = c / s if s > 0.0 else 0.0
                    a = min(max(a, -1.0), 1.0)
                    found = a * (2.0 * c - a * s)
                    if found > suspicion[v, i]:
                        suspicion[v, i] = found
                        share[v, i] = a
            best, second, who = 0.0, 0.0, -1
            for i in range(n):
                found = suspicion[v, i]
                if found > best:
                    best, second, who = found, best, i
                elif found > second:
                    second = found
                if found == 0.0:
                    share[v, i] = 0.0
            statistic[v] = best
            if best > threshold and not detected[v]:
                detected[v] = True
                detection_time[v] = time
            if detected[v] and thruster[v] == 0:
                if who < 0 or best - second < margin or best <= threshold:
                    ahead[v, 1] = 0
                elif ahead[v, 0] == who + 1:
                    ahead[v, 1] += 1
                else:
                    ahead[v, 0], ahead[v, 1] = who + 1, 1
                if ahead[v, 1] >= confirmations:
                    thruster[v] = who + 1
                    isolation_time[v] = time
        # sums that begin anew
        for j in range(scales.size):
            if number % scales[j] == 0:
                m = 2 * j + (number // scales[j]) % 2
                for k in range(sums.shape[2]):
                    sums[v, m, k] = 0.0


@njit(error_model="numpy", cache=True, nogil=True)
def _identify(  # type: ignore[no-untyped-def]
    rates, seen, last_kept, effectiveness, named, lag, period, gains, ages, levels, lost_times,
    delays, constants, statistic, severity, first, last,
):  # fmt: skip
    kept = rates.shape[0]
    rows = 2 + levels.size + lost_times.size + delays.size + 2 * constants.size
    closing = rows - constants.size  # of a slow valve that was open
    overlap = np.empty(constants.size)
    signature, sums = np.empty((rows, 3)), np.empty((rows, 3))
    slow, signed = np.empty(constants.size), np.empty((constants.size, 2))
    course = np.empty(rows)
    for v in range(first, last):
        if named[v] == 0:
            continue
        i, newest = named[v] - 1, last_kept[v]
        column = effectiveness[v, :, i]
        square = column[0] ** 2 + column[1] ** 2 + column[2] ** 2
        for age_at in range(ages.size):
            age = int(ages[age_at])
            if age + lag + 12 > min(newest + 1, kept):
                break
            signature[:] = 0.0
            sums[:] = 0.0
            cross = 0.0
            overlap[:] = 0.0
            onset = newest - age  # the first period with the fault ends with the sample after it
            slow[:] = 0.0
            for at in range(onset + 1, newest + 1):
                told = rates[(at - 1 - lag) % kept, v, i]
                course[0], course[1] = 1.0, told
                row = 2
                for k in range(levels.size):
                    course[row] = max(levels[k] - told, 0.0)
                    row += 1
                for k in range(lost_times.size):
                    course[row] = -min(told, lost_times[k])
                    row += 1
                for k in range(delays.size):
                    shift = int(delays[k])
                    came = rates[(at - 1 - lag - shift) % kept, v, i] if at - 1 - shift >= onset else 0.0
                    course[row] = came - told
                    row += 1
                for k in range(constants.size):
                    slow[k] += (told - slow[k]) * (1.0 - math.exp(-1.0 / constants[k]))
                    course[row] = slow[k] - told
                    course[closing + k] = math.exp(-(at - onset - 0.5) / constants[k])
                    row += 1
                e = seen[at % kept, v]
                along = (column[0] * e[0] + column[1] * e[1] + column[2] * e[2]) * e[9]
                size = square * e[9]
                turn, turn_size = 0.0, 0.0
                for k in range(3):
                    turn += column[3 + k] * e[3 + k] * e[6 + k]
                    turn_size += column[3 + k] * column[3 + k] * e[6 + k]
                for row in range(rows):
                    s = signature[row]
                    p = s[0] + period * s[1] + 0.5 * period * period * course[row]
                    w = s[2] + period * course[row]
                    s[0], s[1], s[2] = p, s[1] + period * course[row], w
                    if e[9] > 0.0:
                        s[0] -= gains[0] * p
                        s[1] -= gains[1] * p
                    if e[6] > 0.0:
                        s[2] -= gains[2] * w
                    sums[row, 0] += p * along + w * turn
                    sums[row, 1] += p * p * size + w * w * turn_size
                    if row == 0:
                        p_one, w_one = p, w
                    elif row == 1:
                        cross += p * p_one * size + w * w_one * turn_size
                    elif row >= closing:
                        other = signed[row - closing]
                        overlap[row - closing] += p * other[0] * size + w * other[1] * turn_size
                    elif row >= closing - constants.size:
                        other = signed[row - closing + constants.size]
                        other[0], other[1] = p, w
            price = math.log(6.0 * age)
            c1, s11, c2, s22 = sums[0, 0], sums[0, 1], sums[1, 0], sums[1, 1]
            if not (s11 > 0.0):
                continue
            # shut, open, and stuck at c: the course is c - told
            _keep(statistic, severity, v, _STUCK_OFF, -2.0 * c2 - s22, 1.0)
            _keep(statistic, severity, v, _STUCK_ON, 2.0 * (c1 - c2) - (s11 - 2.0 * cross + s22), 1.0)
            opening = min(max((c1 + cross) / s11, 0.0), 1.0)
            stuck = 2.0 * (opening * c1 - c2) - (opening**2 * s11 - 2.0 * opening * cross + s22)
            _keep(statistic, severity, v, _STUCK_ON, stuck - price, opening)
            if s22 > 0.0:
                lost = min(max(-c2 / s22, 0.0), 1.0)
                _keep(statistic, severity, v, _LOSS, -2.0 * lost * c2 - lost**2 * s22 - price, lost)
            # a leak that adds to the pulses: the course is c (1 - told)
            spare = s11 - 2.0 * cross + s22
            if spare > 0.0:
                leak = min(max((c1 - c2) / spare, 0.0), 1.0)
                _keep(statistic, severity, v, _LEAK, 2.0 * leak * (c1 - c2) - leak**2 * spare - price, leak)
            row = 2
            for k in range(levels.size):
                _keep(statistic, severity, v, _LEAK, 2.0 * sums[row, 0] - sums[row, 1] - price, levels[k])
                row += 1
            for k in range(lost_times.size):
                found = 2.0 * sums[row, 0] - sums[row, 1] - price
                _keep(statistic, severity, v, _LATE, found, lost_times[k] * period)
                row += 1
            for k in range(delays.size):
                _keep(
                    statistic,
                    severity,
                    v,
                    _LATE,
                    2.0 * sums[row, 0] - sums[row, 1] - price,
                    delays[k] * period,
                )
                row += 1
            for k in range(constants.size):
                c, square_sum = sums[closing + k, 0] - overlap[k], sums[closing + k, 1]
                opened = min(max(c / square_sum, 0.0), 1.0) if square_sum > 0.0 else 0.0
                found = 2.0 * sums[row, 0] - sums[row, 1] + opened * (2.0 * c - opened * square_sum)
                _keep(statistic, severity, v, _SLOW, found - 2.0 * price, constants[k] * period)
                row += 1


@njit(error_model="numpy", inline="always")
def _keep(statistic, severity, v, kind, found, size):  # type: ignore[no-untyped-def]
    """Keep the likeliest size of a kind."""
    if found > statistic[v, kind]:
        statistic[v, kind] = found
        severity[v, kind] = size
