"""The force-torque generalised likelihood ratio detector, for every kind of fault of a thruster.

Kalman filters of position and velocity and of the rate, fed with the commanded thrust, give innovations of
force and torque. A thruster that from an onset on gives the share a more than commanded adds a known
signature to both, times a; with c and s the weighted products of signature and innovation and of signature
and signature, the statistic is the largest 2 a c - a^2 s over thrusters and onsets, -1 <= a <= 1, less that
of the best a within `share_error`. A sum of its own looks for slow valves. After an alarm the thruster is
isolated whose likelihood stays ahead by `margin`; `identify` compares kinds of fault (`kinds`).

Inputs, limits and what cannot be told apart: docs/derivations/force_torque_glr.md. Left out: several faults
at once, faults that turn a thrust, thrust lost to a shared feed.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.identification import Identification
from thruster_baselines.detection.residuals.base import (
    BaseNavigationDetector,
    NavigationSettings,
    Sample,
    nominal_delay,
    take_attitude,
)
from thruster_baselines.detection.residuals.kinds import FUSION_KINDS, GRIDS, NONE, Course, compare_kinds
from thruster_baselines.guidance.hcw import force_response, transition_matrix
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.configuration import require
from thruster_envs.kernels import kernel
from thruster_envs.physics.attitude import rotate, rotate_back
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FusionDetector"]

_SCALES = (4, 12, 36)
"""Samples after which sums begin anew."""

_SLOW = 0.2
"""Time constant of the slow valve whose signature is summed up, s; one twice as slow looks much the same."""

_FORGOTTEN = 0.01
"""Share of the sums of slow valves that is forgotten in every sample."""

_UNLEARNED = 3.0
"""How long after the first sample the bias stays zero, s: the commands of a start are anything but even."""

_AGES = 400
"""Samples after which the gains of the filters have long been steady."""

_KEPT = 112
"""Samples that identification looks back on."""

_AFTER = 60
"""Samples that are kept after an alarm."""

_AGAIN = 5
"""Samples after which whole courses are compared again, if none was far enough ahead."""

_LATEST = 12
"""Largest lag of the thrust behind its command, periods."""

_PERSISTENCE = 10.0
"""How many samples the error of a wrong velocity counts for, since it is the same in all of them."""

_LEAD = 0.06
"""By what share of its own likelihood a thruster that is named has to be ahead: models are off by as much."""

# one sum: states of the signature, then products with the innovations, then with itself
_POSITION, _VELOCITY, _RATE, _FORCE, _TORQUE, _FORCE_SQUARE, _TORQUE_SQUARE = 0, 1, 2, 3, 6, 9, 10
_SUM = 13

# rows of slow valves: what they hold back, the rate that is missing for it, its products with the innovations
# and with itself
_BACK, _BEHIND, _PRODUCT, _SQUARE, _SLUGGISH_ROWS = range(5)

# states after position, velocity and rate: force and torque over mass and inertia that are always there, what
# a shift of all pulses by a second would do to position, velocity and rate, and the last commanded force and
# torque
_BIAS, _SHIFTED, _LAST, _STATES = 9, 15, 24, 30


class _Tuning(NamedTuple):
    """Scalars of a detector; see its arguments."""

    use_rate: bool
    period: float
    settle: float
    threshold: float
    margin: float
    confirmations: int
    lag: int
    timing: float


class _Filters(NamedTuple):
    """Matrices and errors of the filters; kernels are called with all of them in one array.

    Attributes:
        motion: (6, 9), position and velocity over a period.
        spin: (2, 3, 3), inertia and its inverse.
        noise: (4,): variances of rate and torque, the bias's rate of learning, the share error.
    """

    motion: FloatArray
    spin: FloatArray
    noise: FloatArray


@njit(forceinline=True)
def _open_filters(numbers: FloatArray) -> _Filters:
    return _Filters(numbers[:54].reshape(6, 9), numbers[54:72].reshape(2, 3, 3), numbers[72:])


class _Memory(NamedTuple):
    """What is kept of each vehicle from sample to sample; the axis of vehicles is the second in rings."""

    states: FloatArray
    begun: IntArray
    sums: FloatArray
    sluggish: FloatArray
    commands: FloatArray
    newest: IntArray
    rates: FloatArray
    seen: FloatArray
    ahead: IntArray
    share: FloatArray


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
        share_error: By what share of its thrust a sound thruster may give more or less than it is told.
        common: See `NavigationSettings`; here 2 s to settle by default.

    Attributes:
        share: (vehicles, n), the best a of each thruster in the last sample.

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
        share_error: float = 0.005,
        **common: Unpack[NavigationSettings],
    ) -> None:
        common.setdefault("settle", 2.0)
        super().__init__(spacecraft, threshold, **common)
        vehicles = self._vehicles
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
        require(0.0 <= share_error < math.inf, "share_error", share_error, "a share of 0 or more")
        sensors = self.spacecraft.sensors
        require(sensors.position > 0.0, "sensors: position", sensors.position, "an error above 0")
        if use_rate:
            require(sensors.rate > 0.0, "sensors: rate", sensors.rate, "an error above 0")
        self.margin, self.confirmations, self.lag = float(margin), int(confirmations), int(lag)
        self.use_rate = use_rate
        period, motion = self._period, self.spacecraft.circular_mean_motion("the fusion detector")
        columns = self.spacecraft.effectiveness()
        force = disturbance * float(np.linalg.norm(columns[:3], axis=0).mean())
        torque = disturbance * float(np.linalg.norm(columns[3:], axis=0).mean())
        idle = timing * float(np.sqrt(np.square(columns[3:]).sum(axis=1)).mean()) / 3.0
        self._gains = _gains_by_age(period, sensors.position, force, math.hypot(sensors.rate, idle), torque)
        noise = np.array([sensors.rate**2, (period * torque) ** 2, 1.0 / bias_time, share_error])
        self._timing = float(timing)
        steps = np.hstack([transition_matrix(motion, period), force_response(motion, period)])
        inertia = np.array(self.spacecraft.inertia)
        spin = np.stack([inertia, np.linalg.inv(inertia)])
        self._filters = np.concatenate([one.ravel() for one in _Filters(steps, spin, noise)])
        n = self._n
        self._states: FloatArray = np.zeros((vehicles, _STATES))
        self._begun: IntArray = np.full(vehicles, -1, np.int64)
        self._sums: FloatArray = np.zeros((vehicles, 2 * len(_SCALES), _SUM))
        self._sluggish: FloatArray = np.zeros((vehicles, _SLUGGISH_ROWS, n))
        # the thruster that is ahead, and in how many samples in a row; below 0 in how many it is asked again
        self._ahead: IntArray = np.zeros((vehicles, 2), np.int64)
        self._commands: FloatArray = np.zeros((_LATEST, vehicles, n))
        self._newest: IntArray = np.zeros(vehicles, np.int64)  # the last sample that is kept
        self._rates: FloatArray = np.zeros((_KEPT, vehicles, n))
        # innovations of force and torque, body axes, and the weights of torque
        self._seen: FloatArray = np.zeros((_KEPT, vehicles, 10))
        self.share: FloatArray = np.zeros((vehicles, n))
        self._kind: IntArray = np.zeros(vehicles, np.int64)  # of the named thruster, when it was named
        self._kept = _Memory(
            self._states, self._begun, self._sums, self._sluggish, self._commands, self._newest, self._rates,
            self._seen, self._ahead, self.share,
        )  # fmt: skip
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
        statistic, severity = self._compare(np.arange(self._vehicles), named)
        best = np.where(named > 0, statistic.argmax(axis=1), NONE)
        size = severity[np.arange(self._vehicles), best]
        return Identification(tuple(FUSION_KINDS[one] for one in best), size, statistic)

    def _compare(self, vehicles: IntArray, thrusters: IntArray) -> tuple[FloatArray, FloatArray]:
        """Likelihoods and sizes (rows, kinds) of all kinds in thrusters, from 1, of vehicles (rows,)."""
        statistic, severity = np.zeros((2, vehicles.size, len(FUSION_KINDS)))
        alarms: IntArray = self._newest.copy()
        alarms[self.detected] = np.round(self.detection_time[self.detected] / self._period)
        work = partial(
            compare_kinds,
            tuple(
                Course(
                    rates=self._rates, seen=self._seen, newest=self._newest, begun=self._begun,
                    gains=self._gains, effectiveness=self.effectiveness, lag=self.lag, period=self._period,
                )
            ),
            alarms, vehicles, thrusters, tuple(GRIDS), statistic, severity,
        )  # fmt: skip
        in_threads(work, vehicles.size)
        return statistic, severity

    def _kinds(self) -> tuple[str, ...]:
        return tuple(FUSION_KINDS[one] if one != NONE else "" for one in self._kind)

    def _begin(self, mask: BoolArray) -> None:
        self._begun[mask] = -1

    def _clear(self, mask: BoolArray) -> None:
        super()._clear(mask)
        self._sums[mask] = 0.0
        self._ahead[mask] = 0
        self._sluggish[mask] = 0.0
        self._seen[:, mask] = 0.0
        self.share[mask] = 0.0
        self._kind[mask] = NONE

    def _diagnose(self, sample: Sample) -> Verdict:
        statistic = np.zeros(self._vehicles)
        time = np.empty(self._vehicles)
        suspicion = np.zeros((self._vehicles, self._n))
        shortfall = np.empty((self._vehicles, self._n))
        asked = np.zeros(1, np.int64)  # whether some thruster is ahead for long enough
        tuning = (
            self.use_rate and sample.rate is not self._no_rate, self._period, self.settle, self.threshold,
            self.margin, self.confirmations, self.lag, self._timing,
        )  # fmt: skip
        work = partial(
            _monitor_samples, tuple(sample), tuple(self._monitor), tuning, self._filters, self._gains,
            tuple(self._kept), (statistic, time, suspicion, shortfall, asked),
        )  # fmt: skip
        in_threads(work, self._vehicles)
        if asked[0]:
            self._name(np.flatnonzero((self._ahead[:, 1] >= self.confirmations) & (self.thruster == 0)))
        return self._answer(statistic, time, suspicion, shortfall)

    def _name(self, vehicles: IntArray) -> None:
        """Name the thruster that is likeliest by its whole course, if it is far enough ahead."""
        n = self._n
        statistic, _ = self._compare(np.repeat(vehicles, n), np.tile(np.arange(1, n + 1), vehicles.size))
        best = statistic.max(axis=1).reshape(-1, n)
        kinds = statistic.argmax(axis=1).reshape(-1, n)
        second, first = np.sort(best, axis=1)[:, -2:].T
        sure = first - second >= np.maximum(self.margin, _LEAD * first)
        self.thruster[vehicles] = np.where(sure, best.argmax(axis=1) + 1, 0)
        self._kind[vehicles] = np.where(sure, kinds[np.arange(vehicles.size), best.argmax(axis=1)], NONE)
        self.isolation_time[vehicles[sure]] = self._period * (self.samples[vehicles[sure]] - 1)
        self._ahead[vehicles, 1] = -_AGAIN


def _gains_by_age(period: float, position: float, force: float, rate: float, torque: float) -> FloatArray:
    """Gains of Kalman filters since their first measurement, for white errors and white accelerations.

    Nothing is known of the velocity before the second measurement.

    Returns:
        (samples, 4) gains of position, of velocity by position, and of rate, and the variance of a position's
        innovation.
    """
    step = np.array([[1.0, period], [0.0, 1.0]])
    push = np.array([0.5 * period**2, period])
    noise = force**2 * np.outer(push, push)
    covariance = np.diag([position**2, 1.0])
    turned = (period * torque) ** 2
    spread = rate**2
    table = []
    for _ in range(_AGES):
        covariance = step @ covariance @ step.T + noise
        spread += turned
        gain = covariance[:, 0] / (covariance[0, 0] + position**2)
        table.append((gain[0], gain[1], spread / (spread + rate**2), covariance[0, 0] + position**2))
        rest = np.array([[1.0 - gain[0], 0.0], [-gain[1], 1.0]])
        covariance = rest @ covariance @ rest.T + position**2 * np.outer(gain, gain)  # Joseph's form
        spread *= rate**2 / (spread + rate**2)
    return np.array(table)


@kernel(nogil=True)
def _monitor_samples(  # type: ignore[no-untyped-def]
    sample, monitor, tuning, filters, gains, memory, scores, first, last
):
    """One sample of each vehicle: filters, sums since onsets, alarms; see docs/derivations.

    Those before the last two are plain tuples and arrays of `Sample`, `Monitor`, `_Tuning`, `_Filters`, the
    gains, `_Memory`, and what is written.
    """
    open_rates, position, attitude, rate, valid = sample
    effectiveness, last_attitude, samples, refused, detected, thruster, detection_time, _ = monitor
    use_rate, period, settle, threshold, margin, confirmations, lag, timing = tuning
    motion, spin, noise = _open_filters(filters)
    states, begun, sums, sluggish, commands, newest, rates, seen, ahead, share = memory
    statistic, clock, suspicion, shortfall, asked = scores
    n, kept, latest, after = open_rates.shape[1], rates.shape[0], commands.shape[0], _AFTER
    quick, fade = period / _SLOW, math.exp(-period / _SLOW)
    before, e, momentum, weight = np.empty(9), np.empty(6), np.empty(3), np.empty(3)
    angular, products, squares = np.empty(3), np.empty(n), np.empty(n)
    for v in range(first, last):
        number = samples[v]
        samples[v] += 1
        clock[v] = number * period
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
        if begun[v] < 0:
            for j in range(seen.shape[2]):
                seen[slot, v, j] = 0.0
            for i in range(n):
                shortfall[v, i] = -period * share[v, i]
            if there:
                begun[v] = number
                for j in range(_STATES):
                    x[j] = 0.0
                for j in range(3):
                    x[j] = position[v, j]
                    x[3 + j] = 0.0
                    x[6 + j] = rate[v, j] if turning else 0.0
            continue
        gain = gains[min(number - begun[v] - 1, gains.shape[0] - 1)]
        # what the thrust of the last period should have done
        told = commands[(number - 1 - lag) % latest if number > lag else 0, v]
        coming = commands[(number - lag) % latest if number >= lag else 0, v]
        fx, fy, fz = 0.0, 0.0, 0.0
        for k in range(3):
            angular[k] = 0.0
            weight[k] = 0.0
        for i in range(n):
            u = told[i]
            fx += effectiveness[v, 0, i] * u
            fy += effectiveness[v, 1, i] * u
            fz += effectiveness[v, 2, i] * u
            early = min(0.45 * coming[i] * period, 0.6 * timing)  # s of the next pulse before this sample
            late = max(0.6 * timing - 0.4 * (1.0 - u) * period, 0.0)  # and of the last one after it
            moved = early * early + late * late
            for k in range(3):
                angular[k] += effectiveness[v, 3 + k, i] * u
                weight[k] += effectiveness[v, 3 + k, i] ** 2 * moved
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
            weight[j] += _PERSISTENCE * timing**2 * x[_SHIFTED + 6 + j] ** 2
        shifted = 1.0 / (gain[3] + _PERSISTENCE * timing**2 * shifted)  # the weight of each axis of force
        # what it did
        time = number * period
        learning = noise[2] if time >= _UNLEARNED and not detected[v] else 0.0
        for j in range(6):
            e[j] = 0.0
        for j in range(9):
            x[j] = before[j]
        if there:
            q = (last_attitude[v, 0], last_attitude[v, 1], last_attitude[v, 2], last_attitude[v, 3])
            missed = (position[v, 0] - before[0], position[v, 1] - before[1], position[v, 2] - before[2])
            for j in range(3):
                x[j] += gain[0] * missed[j]
                x[3 + j] += gain[1] * missed[j]
                x[_BIAS + j] += learning * gain[1] * missed[j]
                p = x[_SHIFTED + j]
                x[_SHIFTED + j] -= gain[0] * p
                x[_SHIFTED + 3 + j] -= gain[1] * p
            body = rotate(q, missed)
            e[0], e[1], e[2] = body
        if turning:
            for j in range(3):
                e[3 + j] = rate[v, j] - before[6 + j]
                x[6 + j] += gain[2] * e[3 + j]
                x[_BIAS + 3 + j] += learning * gain[2] * e[3 + j]
                x[_SHIFTED + 6 + j] -= gain[2] * x[_SHIFTED + 6 + j]
                weight[j] = 1.0 / ((noise[0] + weight[j]) / (1.0 - gain[2]) + noise[1])
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
                one[0] -= gain[0] * p
                one[1] -= gain[1] * p
                weighed = p * shifted
                for j in range(3):
                    one[3 + j] += weighed * e[j]
                one[9] += weighed * p
            if turning:
                one[2] -= gain[2] * w
                for j in range(3):
                    one[6 + j] += w * weight[j] * e[3 + j]
                    one[10 + j] += w * w * weight[j]
        # what valves as slow as _SLOW hold back, and the rate that is missing for it
        slow = sluggish[v]
        for i in range(n):
            u = told[i] * quick
            level = fade * (slow[_BACK, i] + u * (1.0 + u * (0.5 + u / 6.0)))
            slow[_BEHIND, i] += _SLOW * (slow[_BACK, i] - level)
            slow[_BACK, i] = level
            slow[_PRODUCT, i] *= 1.0 - _FORGOTTEN
            slow[_SQUARE, i] *= 1.0 - _FORGOTTEN
        if turning:
            for k in range(3):
                weighed, heavy = weight[k] * e[3 + k], weight[k]
                for i in range(n):
                    signature = effectiveness[v, 3 + k, i] * slow[_BEHIND, i]
                    slow[_PRODUCT, i] += signature * weighed
                    slow[_SQUARE, i] += signature * signature * heavy
            for i in range(n):
                slow[_BEHIND, i] -= gain[2] * slow[_BEHIND, i]
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
                    sound = min(max(a, -noise[3]), noise[3])
                    a = min(max(a, -1.0), 1.0)
                    found = a * (2.0 * c - a * s) - sound * (2.0 * c - sound * s)
                    if found > suspicion[v, i]:
                        suspicion[v, i] = found
                        share[v, i] = a
            best, second, who = _foremost(suspicion[v])
            lead = best - second
            for i in range(n):
                if suspicion[v, i] == 0.0:
                    share[v, i] = 0.0
                c, s = slow[_PRODUCT, i], slow[_SQUARE, i]
                a = min(max(c / s, 0.0), 2.0) if s > 0.0 else 0.0
                suspicion[v, i] = max(suspicion[v, i], a * (2.0 * c - a * s))
            best, second, likeliest = _foremost(suspicion[v])
            if lead < margin:
                who, lead = likeliest, best - second
            statistic[v] = best
            if best > threshold and not detected[v]:
                detected[v] = True
                detection_time[v] = time
            if detected[v] and thruster[v] == 0 and keep:
                if ahead[v, 1] < 0:
                    ahead[v, 1] = ahead[v, 1] + 1 if ahead[v, 1] < -1 else confirmations
                elif who < 0 or lead < margin:
                    ahead[v, 1] = 0
                elif ahead[v, 0] == who + 1:
                    ahead[v, 1] += 1
                else:
                    ahead[v, 0], ahead[v, 1] = who + 1, 1
                if ahead[v, 1] >= confirmations:
                    asked[0] = 1
        for i in range(n):
            shortfall[v, i] = -period * share[v, i]
        # sums that begin anew
        for j in range(len(_SCALES)):
            if number % _SCALES[j] == 0:
                m = 2 * j + (number // _SCALES[j]) % 2
                for k in range(sums.shape[2]):
                    sums[v, m, k] = 0.0


@njit(error_model="numpy", inline="always")
def _foremost(suspicion):  # type: ignore[no-untyped-def]
    """The largest and the second largest of all thrusters, and whose the largest is; -1 for nobody's."""
    best, second, who = 0.0, 0.0, -1
    for i in range(suspicion.size):
        found = suspicion[i]
        if found > best:
            best, second, who = found, best, i
        elif found > second:
            second = found
    return best, second, who
