"""Isolation by comparing hypotheses: which thruster or which sensor, over all that was seen since an onset.

Of thruster i with column a_i, commanded for u_i of T seconds, the residual of an interval is, by hypothesis,

    loss -q u_i a_i,   stuck open c T a_i - u_i a_i,   leak s (T - u_i) a_i,   added duty b T a_i,
    late by d -min(u_i, d) a_i,   misalignment u_i (p a_i + q b_i + r c_i),

with b_i and c_i the columns of the thruster turned square to its direction. Sizes have normal priors, so that
the likelihood with the sizes integrated out has a closed form (Bayes factor against no fault); a hypothesis
with three unknowns pays for them. What was commanded tells opposite thrusters apart: one that did not fire
cannot be weak. A sensor that fails changes its own axes by anything, in some intervals; position is compared
with velocity and attitude with rate as well. Each factor is that of the course since an onset, for several
onsets; thrusters and sensors are compared by the sums over theirs. The largest log factor is the statistic.

After an alarm the likeliest is named once it is `odds` times as likely as any other, or after `patience`
intervals; `Verdict.candidates` are those that are not yet excluded.

Left out: several faults at once, faults that turn or delay a thrust and weaken it too.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.base import BaseDetector, Interval
from thruster_baselines.detection.contract import Telemetry, Verdict
from thruster_baselines.detection.fault_flights import tilted_columns
from thruster_baselines.detection.settings import FilterSettings
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["HypothesisDetector"]

SENSORS = ("velocity", "rate", "position", "attitude")
"""The sensors that are compared with the thrusters."""

_ONSETS = (1, 2, 3, 4, 6, 8, 12)
"""Ages of a fault, in intervals, that are compared."""

_LATE = (0.04, 0.1, 0.2, 0.35, 0.6)
"""Opening delays that are compared, in intervals."""

_JUMPS = (4.0, 40.0)
"""Sizes of the error of a failed sensor that are compared, in its standard deviations."""

_EXCESS = (  # name, mean and deviation of the constant opening x and of the share y, and how they correlate
    ("stuck_on", (0.75, 0.25), (-1.0, 0.03), 0.0),
    ("leak", (0.3, 0.2), (-0.3, 0.2), -0.999),
    ("bias", (0.2, 0.1), (0.0, 0.03), 0.0),
)
_LOSSES = (("stuck_off", -1.0, 0.02), ("loss", -0.55, 0.25), ("sign", -1.8, 0.2))
_TILT = (np.array([-0.06, 0.0, 0.0]), np.array([0.06, 0.3, 0.3]))
"""Mean and deviation of the shares along and across the thrust of a misaligned thruster."""

_MODEL_ERROR = 0.04
"""By what share of itself a change is not known: turning within an interval is left out of its model."""

_OPENING = 0.3
"""Of a valve that is open without command, where its scatter counts."""

_TIMING = 0.05
"""What is not known of the moment of a firing, as a share of what is left of its interval."""

_KINDS = (
    *(one[0] for one in _EXCESS), *(one[0] for one in _LOSSES), "late_opening", "intermittent", "misalignment"
)  # fmt: skip


class _Evidence(NamedTuple):
    """What one interval says, (vehicles, ...); rows of the window.

    Attributes:
        excess: (vehicles, n, 6): x and y products with the residual, their three squares, and a constant.
        loss: (vehicles, n, 2): of the lost firing.
        late: (vehicles, n, delays, 2): likewise of each delay.
        comes: (vehicles, n): log factor of a thruster that comes and goes.
        tilt: (vehicles, n, 12): three products, nine squares.
        sensors: (vehicles, sensors): log factors.
    """

    excess: FloatArray
    loss: FloatArray
    late: FloatArray
    comes: FloatArray
    tilt: FloatArray
    sensors: FloatArray


class HypothesisDetector(BaseDetector):
    """Names the thruster or the sensor whose faults explain all that was seen since an onset best.

    Args:
        spacecraft: Description, name or path.
        threshold: Of the largest log factor against no fault.
        odds: How many times as likely as any other the named one is.
        patience: After how many intervals since the alarm the likeliest is named anyway.
        settings: Of the filter and of the feed, see `FilterSettings`; the noise is that of the spacecraft.

    Attributes:
        log_factors: (vehicles, n + 4), of each thruster and each of the four sensors in the last interval.

    Raises:
        ValueError: A value that cannot be.

    >>> detector = HypothesisDetector("orion", threshold=15.0, coupling=0.0)
    >>> told = np.outer([1.0, 0.4, 2.0], np.linspace(0.4, 1.0, 12))
    >>> for on_times in told:
    ...     weak = on_times * np.where(np.arange(12) == 4, 0.2, 1.0)
    ...     verdict = detector.update(on_times, detector.filter.effectiveness[0] @ weak, 5.0)
    >>> verdict.thruster, verdict.kind
    (array([5]), ('loss',))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path,
        threshold: float,
        *,
        odds: float = 300.0,
        patience: int = 2,
        **settings: Unpack[FilterSettings],
    ) -> None:
        spacecraft = load(spacecraft)
        if not odds >= 1.0:
            raise ValueError(f"odds must be at least 1, got {odds}")
        if patience < 0:
            raise ValueError(f"patience must be at least 0, got {patience}")
        self.spacecraft, self.patience, self._lead = spacecraft, patience, math.log(odds)
        settings.setdefault("noise", PhysicalNoise(spacecraft))
        self._across = tilted_columns(spacecraft)
        self._scatter = np.array([one.scatter for one in spacecraft.thrusters]) / math.sqrt(3.0)
        coupling = settings.get("coupling")
        coupling = spacecraft.feed.coupling if coupling is None else coupling
        self._coupling = coupling if isinstance(coupling, float) else 0.0  # curves are left to the base
        self._seen: Telemetry | None = None
        self._before: tuple[FloatArray, ...] | None = None
        super().__init__(spacecraft, threshold, **settings)

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
        """Take in one interval; of telemetry with position, velocity, attitude and rate, these too."""
        self._seen = on_times if isinstance(on_times, Telemetry) else None
        if self._seen is not None and self._seen.rate is not None:
            on_times = self._seen._replace(rate_change=self._in_mean_axes(self._seen), turning=None)
        return super().update(on_times, rate_change, duration, valid=valid, age=age, turning=turning)

    def _in_mean_axes(self, seen: Telemetry) -> FloatArray:
        """The rate change with its translation turned to the mean attitude while thrusters fired."""
        change, rate = np.array(seen.need("rate_change")), np.asarray(seen.rate)
        fired = np.asarray(seen.need("on_times")).max(axis=1, keepdims=True)
        turn = (rate - change[:, 3:]) * (0.5 * fired) + change[:, 3:] * (fired / 6.0)
        turn = np.where(np.isfinite(turn), turn, 0.0)
        self._turn: FloatArray = np.linalg.norm(turn, axis=1)
        change[:, :3] -= np.cross(turn, change[:, :3])
        return change

    def _forget(self, mask: BoolArray) -> None:
        count, _, n = self._believed.shape
        if mask.all():
            depth = (max(_ONSETS), count)  # the newest first
            self._window = _Evidence(
                np.zeros((*depth, n, 6)), np.zeros((*depth, n, 2)), np.zeros((*depth, n, len(_LATE), 2)),
                np.zeros((*depth, n)), np.zeros((*depth, n, 12)), np.zeros((*depth, len(SENSORS))),
            )  # fmt: skip
            self._since: IntArray = np.full(count, -1, np.int64)
            self._seen_before: BoolArray = np.zeros(count, np.bool_)
            self.log_factors: FloatArray = np.zeros((count, n + len(SENSORS)))
            return
        for one in self._window:
            one[:, mask] = 0.0
        self._since[mask], self._seen_before[mask], self.log_factors[mask] = -1, False, 0.0

    def _diagnose(self, interval: Interval) -> Verdict:
        new = self._evidence(interval)
        for ring, values in zip(self._window, new, strict=True):
            ring[1:] = ring[:-1]
            there = interval.valid.reshape(-1, *[1] * (values.ndim - 1))
            ring[0] = np.where(there, values, 0.0)
        by_kind = self._by_kind()  # (kinds, vehicles, n)
        by_kind[:, interval.excluded] = -np.inf
        thrusters = np.logaddexp.reduce(by_kind, axis=0) - math.log(len(_KINDS))
        sensors = np.stack([np.cumsum(self._window.sensors, axis=0)[age - 1] for age in _ONSETS])
        sensors = np.logaddexp.reduce(sensors, axis=0) - math.log(len(_ONSETS))
        self.log_factors = np.concatenate([thrusters, sensors], axis=1)
        return self._verdict(interval, by_kind)

    def _verdict(self, interval: Interval, by_kind: FloatArray) -> Verdict:
        count, n = interval.on_times.shape
        rows = np.arange(count)
        statistic = np.where(interval.valid, np.maximum(self.log_factors.max(axis=1), 0.0), 0.0)
        alarm = statistic > self.threshold
        self._since = np.where(self._since >= 0, self._since + 1, np.where(alarm, 0, -1))
        detected = alarm | ((self._since >= 0) & (self._since <= self.patience))  # until somebody is named
        best = self.log_factors.argmax(axis=1)
        top = self.log_factors[rows, best]
        second = np.partition(self.log_factors, -2, axis=1)[:, -2]
        names = detected & ((top - second >= self._lead) | (self._since >= self.patience))
        thruster = np.where(names & (best < n), best + 1, 0)
        near = self.log_factors[:, :n] >= top[:, np.newaxis] - self._lead
        kinds = by_kind[:, rows, np.minimum(best, n - 1)].argmax(axis=0)
        of_sensor = names & (best >= n)
        return Verdict(
            detected, thruster, statistic, self.time.copy(), np.maximum(self.log_factors[:, :n], 0.0),
            np.zeros((count, n)),
            kind=tuple(_KINDS[k] if one > 0 else "" for k, one in zip(kinds, thruster, strict=True)),
            sensor=tuple(SENSORS[k - n] if one else "" for k, one in zip(best, of_sensor, strict=True)),
            candidates=near & detected[:, np.newaxis],
        )  # fmt: skip

    def _evidence(self, interval: Interval) -> _Evidence:
        """Products of the signatures with the residual and with each other, all by the inverse covariance."""
        duration, u, told = interval.duration, interval.on_times, interval.commanded
        a, e, n = interval.effectiveness, interval.residual, u.shape[1]
        covariance = interval.covariance.copy()
        if self._seen is not None and self._seen.rate is not None:
            loose = np.square(0.3 * self._turn) * np.square(interval.rate_change[:, :3]).sum(axis=1)
            loose = np.where(np.isfinite(loose), loose, 0.0)
            covariance[:, :3, :3] += loose[:, np.newaxis, np.newaxis] * np.eye(3)
        e = np.where(interval.valid[:, np.newaxis], e, 0.0)
        weighed = np.linalg.solve(covariance, e[..., np.newaxis])[..., 0]
        covariance *= 1.0 + (_MODEL_ERROR**2 * (e * weighed).sum(axis=1))[:, np.newaxis, np.newaxis]
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        e = (root @ e[..., np.newaxis])[..., 0]
        a = np.asarray(root @ a, np.float64)
        b = root @ self._across[:, np.newaxis]  # (2, vehicles, m, n)
        share = self._coupling
        shared = np.minimum(told[:, :, np.newaxis], told[:, np.newaxis]) * (1.0 - np.eye(n))
        lost = u[:, np.newaxis] * a - share * a @ shared  # (vehicles, m, n): what the firing of each adds
        whole = a * (duration - share * told.sum(axis=1)[:, np.newaxis, np.newaxis])
        whole -= share * (a @ told[..., np.newaxis] - told[:, np.newaxis] * a)
        # what comes without command scatters as well: its covariance is larger along the thruster's column
        own = np.square(_OPENING * self._scatter * np.maximum(duration - u, 0.0))
        along, size = np.einsum("vmn,vm->vn", a, e), np.square(a).sum(axis=1)
        damping = own / (1.0 + own * size)

        def product(x: FloatArray, y: FloatArray) -> FloatArray:
            plain: FloatArray = np.einsum("vmn,vmn->vn", x, y)
            plain -= damping * np.einsum("vmn,vmn->vn", x, a) * np.einsum("vmn,vmn->vn", y, a)
            return plain

        every = np.broadcast_to(e[..., np.newaxis], a.shape)
        constant = 0.5 * damping * np.square(along) - 0.5 * np.log1p(own * size)
        excess = np.stack(
            [product(whole, every), product(lost, every), product(whole, whole), product(whole, lost),
             product(lost, lost), constant], axis=-1,
        )  # fmt: skip
        plain, square = np.einsum("vmn,vm->vn", lost, e), np.square(lost).sum(axis=1)
        late = np.minimum(u[..., np.newaxis], duration * np.array(_LATE))
        turned = u[:, np.newaxis] * np.stack([a, *b])  # (3, vehicles, m, n)
        products = np.einsum("kvmn,vm->vnk", turned, e)
        squares = np.einsum("kvmn,lvmn->vnkl", turned, turned).reshape(*u.shape, 9)
        return _Evidence(
            excess,
            np.stack([plain, square], axis=-1),
            np.stack([along[..., np.newaxis] * late, size[..., np.newaxis] * np.square(late)], axis=-1),
            np.logaddexp(-plain - 0.5 * square, 0.0) - math.log(2.0),
            np.concatenate([products, squares], axis=-1),
            self._of_sensors(interval, covariance),
        )

    def _of_sensors(self, interval: Interval, covariance: FloatArray) -> FloatArray:
        """(vehicles, 4): log factors of an error of each sensor in this interval, against none."""
        e = np.where(interval.valid[:, np.newaxis], interval.residual, 0.0)
        own = np.asarray(np.linalg.inv(covariance), np.float64)
        weighed = np.asarray((own @ e[..., np.newaxis])[..., 0], np.float64)
        translation, rotation = (
            _jump(weighed[:, part], own[:, part, part], self._noise_of(part))
            for part in (slice(0, 3), slice(3, 6))
        )
        position, attitude = self._consistency(interval)
        return np.stack([translation + position, rotation + attitude, position, attitude], axis=1)

    def _noise_of(self, part: slice) -> FloatArray:
        return np.asarray(self._noise.sensors[part]) if self._noise is not None else np.ones(3)

    def _consistency(self, interval: Interval) -> tuple[FloatArray, FloatArray]:
        """Log factors (vehicles,) of position against velocity, and of attitude against rate."""
        seen, count = self._seen, interval.valid.size
        nothing = np.zeros(count)
        if seen is None or any(
            one is None for one in (seen.position, seen.velocity, seen.attitude, seen.rate)
        ):
            return nothing, nothing
        now = tuple(np.asarray(one) for one in (seen.position, seen.velocity, seen.attitude, seen.rate))
        before, self._before = self._before, now
        usable, self._seen_before = self._seen_before & interval.valid, interval.valid.copy()
        if before is None:
            return nothing, nothing
        duration, told, sensors = interval.duration, interval.on_times, self.spacecraft.sensors
        left = told * (duration - told)
        # thrust comes at the start of an interval, which the trapezoid rule misses
        missed = 0.5 * np.einsum("vmn,vn->vm", interval.effectiveness, left)
        spread = _TIMING**2 * np.einsum("vmn,vn->vm", np.square(interval.effectiveness), np.square(left))
        # and so is when a fault acted
        late = 0.5 * duration * np.where(interval.valid[:, np.newaxis], interval.residual, 0.0)
        spread += np.square(late)
        moved = now[0] - before[0] - 0.5 * duration * (now[1] + before[1])
        moved -= _to_frame(before[2], missed[:, :3])
        variance = 2.0 * sensors.position**2 + 0.5 * (duration * sensors.velocity) ** 2
        position = _free_jump(moved, variance + spread[:, :3].sum(axis=1), sensors.position)
        orbit = _to_body(before[2], np.array([0.0, 0.0, self.spacecraft.mean_motion]))
        turned = _turn_between(before[2], now[2]) - duration * (0.5 * (now[3] + before[3]) - orbit)
        turned -= missed[:, 3:]
        rates = np.square(now[3] - before[3]).sum(axis=1) + np.square(before[3]).sum(axis=1)
        variance = 2.0 * sensors.attitude**2 + 0.5 * (duration * sensors.rate) ** 2
        loose = np.square(0.1 * duration**2 * rates)
        attitude = _free_jump(turned, variance + spread[:, 3:].sum(axis=1) + loose, sensors.attitude)
        return np.where(usable, position, 0.0), np.where(usable, attitude, 0.0)

    def _by_kind(self) -> FloatArray:
        """(kinds, vehicles, n): log factor of each kind of fault of each thruster, over the onsets."""
        sums = _Evidence(*(np.cumsum(one, axis=0)[np.array(_ONSETS) - 1] for one in self._window))
        found = [_excess(sums.excess, x, y, correlation) for _, x, y, correlation in _EXCESS]
        found += [_one(sums.loss, mean, deviation) for _, mean, deviation in _LOSSES]
        late = _one(sums.late, -1.0, 0.1)
        found += [np.logaddexp.reduce(late, axis=-1) - math.log(len(_LATE)), sums.comes]
        tilt = sums.tilt
        mean, precision = _TILT[0], np.diag(_TILT[1] ** -2.0)
        posterior = tilt[..., 3:].reshape(*tilt.shape[:-1], 3, 3) + precision
        shift = tilt[..., :3] + precision @ mean
        solved = np.linalg.solve(posterior, shift[..., np.newaxis])[..., 0]
        found.append(
            0.5 * ((shift * solved).sum(axis=-1) - mean @ precision @ mean)
            - 0.5 * (np.linalg.slogdet(posterior)[1] - np.log(np.diag(precision)).sum())
        )
        factors: FloatArray = np.logaddexp.reduce(np.stack(found), axis=1) - math.log(len(_ONSETS))
        return factors


def _one(sums: FloatArray, mean: float, deviation: float) -> FloatArray:
    """Log factor (...) of one size with a normal prior, from its products (..., 2)."""
    precision = deviation**-2.0
    shift, posterior = sums[..., 0] + precision * mean, sums[..., 1] + precision
    explained: FloatArray = np.square(shift) / posterior - precision * mean**2
    price: FloatArray = 0.5 * np.log(posterior / precision)
    return 0.5 * explained - price


def _excess(
    sums: FloatArray, x: tuple[float, float], y: tuple[float, float], correlation: float
) -> FloatArray:
    """Log factor (...) of a constant opening and a share with a normal prior, from products (..., 6)."""
    both = correlation * x[1] * y[1]
    prior = np.linalg.inv(np.array([[x[1] ** 2, both], [both, y[1] ** 2]]))
    mean = np.array([x[0], y[0]])
    first, second = sums[..., 0] + prior[0] @ mean, sums[..., 1] + prior[1] @ mean
    p, q, r = sums[..., 2] + prior[0, 0], sums[..., 3] + prior[0, 1], sums[..., 4] + prior[1, 1]
    determinant = p * r - q * q
    explained = (r * np.square(first) - 2.0 * q * first * second + p * np.square(second)) / determinant
    price: FloatArray = 0.5 * np.log(determinant / np.linalg.det(prior))
    factor: FloatArray = 0.5 * (explained - mean @ prior @ mean) - price + sums[..., 5]
    return factor


def _jump(weighed: FloatArray, information: FloatArray, variances: FloatArray) -> FloatArray:
    """Log factor (vehicles,) of an error of one axis or all three that is there or not, of several sizes.

    Args:
        weighed: (vehicles, 3), the residual times the inverse covariance, on these axes.
        information: (vehicles, 3, 3), the inverse covariance on these axes.
        variances: (3,), of the sensor.
    """
    found = []
    for size in _JUMPS:
        prior = np.diag(1.0 / (size**2 * variances))
        posterior = information + prior
        solved = np.linalg.solve(posterior, weighed[..., np.newaxis])[..., 0]
        found.append(
            0.5 * (weighed * solved).sum(axis=1)
            - 0.5 * (np.linalg.slogdet(posterior)[1] - np.linalg.slogdet(prior)[1])
        )
        for axis in range(3):
            known, own = information[:, axis, axis] + prior[axis, axis], prior[axis, axis]
            found.append(0.5 * np.square(weighed[:, axis]) / known - 0.5 * np.log(known / own))
    factor: FloatArray = np.logaddexp.reduce(found, axis=0) - math.log(len(found))
    return np.logaddexp(factor, 0.0) - math.log(2.0)


def _free_jump(residual: FloatArray, variance: FloatArray, deviation: float) -> FloatArray:
    """The same for a residual (vehicles, 3) of one variance (vehicles,) on all axes."""
    if not deviation > 0.0:
        return np.zeros(len(residual))
    residual = np.where(np.isfinite(residual), residual, 0.0)
    information = np.eye(3) / variance[:, np.newaxis, np.newaxis]
    return _jump(residual / variance[:, np.newaxis], information, np.full(3, deviation**2))


def _matrices(attitude: FloatArray) -> FloatArray:
    """(vehicles, 3, 3): body from LVLH."""
    w, x, y, z = attitude.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def _to_body(attitude: FloatArray, vector: FloatArray) -> FloatArray:
    turned: FloatArray = np.einsum("vij,j->vi", _matrices(attitude), vector)
    return turned


def _to_frame(attitude: FloatArray, vectors: FloatArray) -> FloatArray:
    turned: FloatArray = np.einsum("vji,vj->vi", _matrices(attitude), vectors)
    return turned


def _turn_between(before: FloatArray, after: FloatArray) -> FloatArray:
    """(vehicles, 3), rad, body axes: how the body turned, exact to third order."""
    change = _matrices(after) @ np.swapaxes(_matrices(before), 1, 2)
    skew = 0.5 * (change - np.swapaxes(change, 1, 2))
    turn = np.stack([skew[:, 1, 2], skew[:, 2, 0], skew[:, 0, 1]], axis=1)
    size = np.linalg.norm(turn, axis=1, keepdims=True)
    return turn * np.where(size > 1e-9, np.arcsin(np.minimum(size, 1.0)) / np.maximum(size, 1e-9), 1.0)
