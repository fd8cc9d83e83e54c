"""A Kalman filter for what each thruster does, from what firing it changed (Yang 2003, ch. 4).

    A_(k+1) = A_k + w,    Z_k = A_k U_k + v,

with the effectiveness A (m, n), the measured rate change Z and the effective on-times U of an interval. The
covariance is carried in the cheapest form that is exact: `known` (nothing is learned), `shared` (one n x n
matrix for all axes), `by_axis`, `full`, or `fired_only` (4.2.4), which leaves idle thrusters alone. What each
admits, and its accuracy: docs/derivations/effectiveness_filter.md.

Left out: sensor biases, mass properties, the coupling loss (`delivered_on_times`), free motion
(`rate_change`), and that consecutive rate changes share a velocity measurement.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["EffectivenessFilter", "Innovation"]

Form = Literal["automatic", "known", "shared", "by_axis", "full", "fired_only"]


class Innovation(NamedTuple):
    """What a measurement said that was not expected.

    Attributes:
        residual: (vehicles, m), measured minus expected rate change, m/s then rad/s.
        covariance: (vehicles, m, m), what the filter thinks of its size.
        valid: (vehicles,), whether there was a measurement; where not, the residual is zero.
    """

    residual: FloatArray
    covariance: FloatArray
    valid: NDArray[np.bool_]


class EffectivenessFilter:
    """Estimates the effectiveness of the thrusters of many vehicles, update by update.

    Args:
        spacecraft: Description, name, path, or effectiveness matrix (m, n): the first estimate.
        process_noise: Variance that every entry gains per update: one number, or (m,) per axis.
        measurement_noise: Variance of the rate change: one number, (m,) per axis, or (m, m).
        initial_covariance: Variance of the entries of the first estimate, as `process_noise` is given; by
            default the process noise (Yang 2003, section 4.2.2).
        vehicles: How many are watched.
        form: How the covariance is carried; by default the cheapest form that is exact.

    Attributes:
        effectiveness: (vehicles, m, n), the estimate, m/s^2 then rad/s^2.
        form: The form in use.
        refused: (vehicles,), how many measurements were no numbers and were not taken.

    Raises:
        ValueError: Noise that cannot be, or a form that the noise does not admit.

    >>> filter = EffectivenessFilter("orion", process_noise=0.01, measurement_noise=10.0)
    >>> on_times = np.zeros(12)
    >>> on_times[[0, 5, 9, 11]] = 1.0
    >>> innovation = filter.update(on_times, np.zeros(6))
    >>> innovation.residual.round(4).tolist(), innovation.covariance[0, 0, 0].round(4)
    ([[0.006, 0.006, 0.0, 0.0, 0.0, 0.0]], np.float64(10.08))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        process_noise: ArrayLike,
        measurement_noise: ArrayLike,
        initial_covariance: ArrayLike | None = None,
        vehicles: int = 1,
        form: Form = "automatic",
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        if isinstance(spacecraft, Spacecraft):
            nominal = spacecraft.effectiveness()
        else:
            nominal = np.array(spacecraft, dtype=np.float64)
        if nominal.ndim != 2 or not np.isfinite(nominal).all():
            raise ValueError(f"effectiveness has the shape {nominal.shape}; a finite (m, n) would be right")
        if vehicles < 1:
            raise ValueError(f"vehicles is {vehicles}; one or more would be right")
        m = nominal.shape[0]
        self._nominal, self._vehicles = nominal, vehicles
        self._process = _per_axis(process_noise, m, "process_noise")
        self._measurement = _measurement_noise(measurement_noise, m)
        self._by_axis = np.stack([self._process, np.diag(self._measurement)])
        first = process_noise if initial_covariance is None else initial_covariance
        self._first = _per_axis(first, m, "initial_covariance")
        self.form = self._choose(form)
        self.reset()

    def _choose(self, form: Form) -> Form:
        diagonal = not np.any(self._measurement - np.diag(np.diag(self._measurement)))
        same = all(
            np.ptp(values) == 0.0 for values in (self._process, self._first, np.diag(self._measurement))
        )
        admitted = {"full", "fired_only"}
        known = not (self._process.any() or self._first.any())
        if known:
            admitted.add("known")
        if diagonal:
            admitted.add("by_axis")
            if same:
                admitted.add("shared")
        if form == "automatic":
            if known:
                return "known"
            return "shared" if diagonal and same else "by_axis" if diagonal else "full"
        if form not in admitted:
            raise ValueError(
                f"form is {form!r}, which this noise does not admit; one of "
                f"{', '.join(sorted(admitted))} or automatic would be right"
            )
        return form

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Go back to the first estimate.

        Args:
            vehicles: Which ones, as a mask (vehicles,); all by default.
        """
        if vehicles is None:
            count = self._vehicles
            self.effectiveness: FloatArray = np.repeat(self._nominal[np.newaxis], count, axis=0)
            self.refused = np.zeros(count, np.int64)
            self._covariance: FloatArray = np.repeat(self._first_covariance()[np.newaxis], count, axis=0)
            return
        mask = np.asarray(vehicles, dtype=np.bool_)
        self.effectiveness[mask] = self._nominal
        self.refused[mask] = 0
        self._covariance[mask] = self._first_covariance()

    def _first_covariance(self) -> FloatArray:
        n = self._nominal.shape[1]
        if self.form == "known":
            return np.zeros((0, n, n))
        if self.form == "shared":
            return np.diag(np.full(n, self._first[0]))
        if self.form == "by_axis":
            return np.asarray(self._first[:, np.newaxis, np.newaxis] * np.eye(n))
        return np.diag(np.tile(self._first, n))

    @property
    def covariance(self) -> FloatArray:
        """(vehicles, m n, m n): of the entries of the estimate, columns stacked; a copy in any form."""
        return np.stack([self.covariance_of(vehicle) for vehicle in range(self._vehicles)])

    def covariance_of(self, vehicle: int) -> FloatArray:
        """(m n, m n): of the entries of one vehicle's estimate, columns stacked; its index is from 0."""
        m, n = self._nominal.shape
        if self.form == "known":
            return np.zeros((m * n, m * n))
        if self.form == "shared":
            return np.kron(self._covariance[vehicle], np.eye(m))
        if self.form == "by_axis":
            whole = np.zeros((n, m, n, m))
            for k in range(m):
                whole[:, k, :, k] = self._covariance[vehicle, k]
            return whole.reshape(m * n, m * n)
        return np.array(self._covariance[vehicle])

    def shared_covariance(self) -> tuple[FloatArray, float]:
        """What the forms `known` and `shared` carry of the covariance, for all axes; not a copy.

        Returns:
            The covariance of the entries of an axis (vehicles, n, n), of which there are none if all is
            known, and the variance of the measurement.

        Raises:
            ValueError: Another form.
        """
        if self.form not in ("known", "shared"):
            raise ValueError(f"form must be 'known' or 'shared', got {self.form!r}")
        n = self._nominal.shape[1]
        covariance = self._covariance if self.form == "shared" else np.zeros((0, n, n))
        return covariance, float(self._measurement[0, 0])

    def update(
        self,
        on_times: ArrayLike,
        rate_change: ArrayLike,
        *,
        measurement_noise: ArrayLike | None = None,
        valid: ArrayLike | None = None,
    ) -> Innovation:
        """Take in one interval's measurement.

        Args:
            on_times: (vehicles, n) or (n,), s: effective on-times of the interval, coupling loss taken off.
            rate_change: (vehicles, m) or (m,), m/s then rad/s: measured, free motion taken off. One that is
                not finite is refused and counted.
            measurement_noise: (vehicles, m, m), instead of the filter's own; only with `known` and the full
                forms.
            valid: (vehicles,), where there is a measurement at all; elsewhere only time passes.

        Raises:
            ValueError: A wrong shape; on-times that are not finite.
        """
        m, n = self._nominal.shape
        count = self._vehicles
        times = _batch(on_times, count, n, "on_times")
        if not np.isfinite(times).all():
            raise ValueError("on_times has an entry that is not finite; s of firing would be right")
        measured = _batch(rate_change, count, m, "rate_change")
        there = np.ones(count, np.bool_) if valid is None else np.array(valid, dtype=np.bool_)
        if there.shape != (count,):
            raise ValueError(f"valid has the shape {there.shape}; ({count},) would be right")
        numbers = np.isfinite(measured).all(axis=1)
        self.refused += there & ~numbers
        there &= numbers
        noises = None
        if measurement_noise is not None:
            if self.form in ("shared", "by_axis"):
                raise ValueError(
                    f"measurement_noise is given for each update, which the form {self.form!r} does not "
                    "admit; form='full' would be right"
                )
            noises = np.array(measurement_noise, dtype=np.float64, order="C")
            if noises.shape not in ((1, m, m), (count, m, m)):
                raise ValueError(
                    f"measurement_noise has the shape {noises.shape}; ({count}, {m}, {m}) would be right"
                )
        return self.advance(times, measured, there, noises)

    def advance(
        self,
        on_times: FloatArray,
        rate_change: FloatArray,
        valid: NDArray[np.bool_],
        measurement_noise: FloatArray | None = None,
    ) -> Innovation:
        """As `update`, for arrays that the caller has checked and that are contiguous; all of them whole.

        Args:
            on_times: (vehicles, n), s, finite.
            rate_change: (vehicles, m), m/s then rad/s, finite where it is valid.
            valid: (vehicles,).
            measurement_noise: (vehicles, m, m) or (1, m, m); only with `known` and the full forms.
        """
        count, m = rate_change.shape
        residual, covariance = np.zeros((count, m)), np.zeros((count, m, m))
        errors: tuple[Any, ...] | FloatArray = self._by_axis
        if self.form not in ("shared", "by_axis"):
            errors = self._measurement[np.newaxis] if measurement_noise is None else measurement_noise
            if self.form != "known":
                errors = self._process, errors, self.form == "fired_only"
        work = partial(
            _KERNELS[self.form], on_times, rate_change, valid, errors, self.effectiveness, self._covariance,
            residual, covariance,
        )  # fmt: skip
        in_threads(work, count)
        return Innovation(residual, covariance, valid)

    def replace_column(self, vehicles: ArrayLike, thruster: int, column: ArrayLike) -> None:
        """Overwrite what is believed of one thruster, and know it as well as at the start.

        What was learned of it together with others is forgotten (its cross-covariances become zero).

        Args:
            vehicles: Which ones, as a mask (vehicles,).
            thruster: Its number, from 1.
            column: (m,) or (vehicles in the mask, m), m/s^2 then rad/s^2.
        """
        m, n = self._nominal.shape
        if not 1 <= thruster <= n:
            raise ValueError(f"thruster is {thruster}; a number from 1 to {n} would be right")
        mask, i = np.asarray(vehicles, dtype=np.bool_), thruster - 1
        self.effectiveness[mask, :, i] = column
        if self.form == "known":
            return
        fresh = self._first_covariance()
        if self.form in ("shared", "by_axis"):
            for at in np.flatnonzero(mask):
                self._covariance[at, ..., i, :] = 0.0
                self._covariance[at, ..., :, i] = 0.0
                self._covariance[at, ..., i, i] = fresh[..., i, i]
            return
        block = slice(i * m, (i + 1) * m)
        for at in np.flatnonzero(mask):
            self._covariance[at, block, :] = 0.0
            self._covariance[at, :, block] = 0.0
            self._covariance[at, block, block] = fresh[block, block]


def _per_axis(given: ArrayLike, m: int, name: str) -> FloatArray:
    values = np.array(given, dtype=np.float64)
    values = np.full(m, values) if values.ndim == 0 else values
    if values.shape != (m,) or not (np.isfinite(values) & (values >= 0.0)).all():
        raise ValueError(
            f"{name} is {values.tolist()}; a variance, or one for each of {m} axes, zero or more, "
            "would be right"
        )
    return values


def _measurement_noise(given: ArrayLike, m: int) -> FloatArray:
    values = np.array(given, dtype=np.float64)
    if values.ndim < 2:
        values = np.diag(_per_axis(values, m, "measurement_noise"))
    if values.shape != (m, m) or not np.isfinite(values).all() or not np.array_equal(values, values.T):
        raise ValueError(
            f"measurement_noise has the shape {values.shape}; a variance, ({m},), or a symmetric ({m}, {m}) "
            "would be right"
        )
    if np.linalg.eigvalsh(values).min() <= 0.0:
        raise ValueError("measurement_noise is not positive definite; positive variances would be right")
    return values


def _batch(given: ArrayLike, count: int, size: int, name: str) -> FloatArray:
    values = np.array(given, dtype=np.float64, order="C")
    if values.shape == (size,):
        values = np.repeat(values[np.newaxis], count, axis=0)
    if values.shape != (count, size):
        raise ValueError(f"{name} has the shape {values.shape}; ({count}, {size}) would be right")
    return values


@kernel(nogil=True)
def _update_axis(
    times: FloatArray, innovation: float, q: float, r: float, row: FloatArray, p: FloatArray, taught: bool,
    pu: FloatArray,
) -> float:  # fmt: skip
    """One axis, or all in one: covariance p (n, n) and, with the innovation, row (n,); its variance."""
    n = times.size
    variance = r
    for i in range(n):
        p[i, i] += q
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += p[i, j] * times[j]
        pu[i] = total
        variance += total * times[i]
    if taught:
        for i in range(n):
            gain = pu[i] / variance
            row[i] += gain * innovation
            for j in range(i + 1):  # the lower triangle, and its mirror: else round-off makes the two differ
                p[i, j] -= gain * pu[j]
                p[j, i] = p[i, j]
    return variance


@kernel(nogil=True)
def _update_shared(  # type: ignore[no-untyped-def]
    times, measured, there, noise, effectiveness, covariance, residual, spread, first, last
):
    process, error = noise[0], noise[1]
    m, n = effectiveness.shape[1:]
    pu, nothing = np.empty(n), np.zeros(n)
    for v in range(first, last):
        variance = _update_axis(times[v], 0.0, process[0], error[0], nothing, covariance[v], there[v], pu)
        for k in range(m):
            spread[v, k, k] = variance
            if there[v]:
                rest = measured[v, k]
                for i in range(n):
                    rest -= effectiveness[v, k, i] * times[v, i]
                residual[v, k] = rest
                rest /= variance
                for i in range(n):
                    effectiveness[v, k, i] += pu[i] * rest


@kernel(nogil=True)
def _update_by_axis(  # type: ignore[no-untyped-def]
    times, measured, there, noise, effectiveness, covariance, residual, spread, first, last
):
    process, error = noise[0], noise[1]
    m, n = effectiveness.shape[1:]
    pu = np.empty(n)
    for v in range(first, last):
        for k in range(m):
            rest = 0.0
            if there[v]:
                rest = measured[v, k]
                for i in range(n):
                    rest -= effectiveness[v, k, i] * times[v, i]
            residual[v, k] = rest
            spread[v, k, k] = _update_axis(
                times[v], rest, process[k], error[k], effectiveness[v, k], covariance[v, k], there[v], pu
            )


@kernel(nogil=True)
def _compare(  # type: ignore[no-untyped-def]
    times, measured, there, noise, effectiveness, _, residual, spread, first, last
):
    m, n = effectiveness.shape[1:]
    for v in range(first, last):
        spread[v] = noise[v if noise.shape[0] > 1 else 0]
        if there[v]:
            for k in range(m):
                rest = measured[v, k]
                for i in range(n):
                    rest -= effectiveness[v, k, i] * times[v, i]
                residual[v, k] = rest


@kernel(nogil=True)
def _update_full(  # type: ignore[no-untyped-def]
    times, measured, there, noise, effectiveness, covariance, residual, spread, first, last
):
    process, error, fired_only = noise
    m, n = effectiveness.shape[1:]
    size = m * n
    ph, gain = np.empty((m, size)), np.empty((m, size))  # H P and K'
    learns, masked = np.empty(n, np.bool_), np.empty((2, m, size))
    for v in range(first, last):
        p, u = covariance[v], times[v]
        for i in range(n):
            for k in range(m):
                p[i * m + k, i * m + k] += process[k]
        r = error[v if error.shape[0] > 1 else 0]
        for k in range(m):
            row = ph[k]
            row[:] = 0.0
            for j in range(n):
                if u[j] != 0.0:
                    column = p[j * m + k]  # which is the row, as P is symmetric
                    for s in range(size):
                        row[s] += u[j] * column[s]
        for k in range(m):
            for other in range(m):
                total = r[k, other]
                for i in range(n):
                    total += u[i] * ph[other, i * m + k]
                spread[v, k, other] = total
        if not there[v]:
            continue
        for k in range(m):
            rest = measured[v, k]
            for i in range(n):
                rest -= effectiveness[v, k, i] * u[i]
            residual[v, k] = rest
        inverse = np.linalg.inv(spread[v])
        for k in range(m):
            row = gain[k]
            row[:] = 0.0
            for other in range(m):
                seen = ph[other]
                for s in range(size):
                    row[s] += inverse[other, k] * seen[s]
        for i in range(n):
            learns[i] = not fired_only or u[i] != 0.0
            if learns[i]:
                for axis in range(m):
                    for k in range(m):
                        effectiveness[v, axis, i] += gain[k, i * m + axis] * residual[v, k]
        _joseph(p, gain, ph, spread[v], learns, masked)


@njit(error_model="numpy", nogil=True)
def _joseph(
    p: FloatArray, gain: FloatArray, ph: FloatArray, spread: FloatArray, learns: BoolArray, masked: FloatArray
) -> None:
    """P - K H P - P H' K' + K (H P H' + R) K', which is Joseph's form multiplied out.

    A thruster that does not learn has zeros in K. Joseph's form holds for any gain: what it has in common
    with one that learns is as with the full gain, and what two of them have in common stays.

    Args:
        p: (size, size), changed: the upper triangle is computed, the lower one is its mirror.
        gain: (m, size), K' if all learn.
        ph: (m, size), H P.
        spread: (m, m), of the innovation.
        learns: (n,), which thrusters learn.
        masked: (2, m, size), scratch.
    """
    m, size = gain.shape
    everyone = learns.all()
    if not everyone:
        for k in range(m):
            for t in range(size):
                masked[0, k, t] = gain[k, t] if learns[t // m] else 0.0
                masked[1, k, t] = ph[k, t] if learns[t // m] else 0.0
    for s in range(size):
        row = p[s, s:]
        whole = everyone or learns[s // m]
        for k in range(m):
            weighed = -ph[k, s]
            for other in range(m):
                weighed += gain[other, s] * spread[other, k]
            own = gain[k, s]
            gains = gain[k, s:] if whole else masked[0, k, s:]
            seen = ph[k, s:] if whole else masked[1, k, s:]
            for t in range(row.size):  # along memory, so that it is done four at a time
                row[t] += weighed * gains[t] - own * seen[t]
        for t in range(s + 1, size):
            p[t, s] = p[s, t]


_KERNELS = {
    "known": _compare,
    "shared": _update_shared,
    "by_axis": _update_by_axis,
    "full": _update_full,
    "fired_only": _update_full,
}
"""By form. The noise is (2, m) of process and measurement; in full (vehicles or 1, m, m) of the measurement,
alone or between that of the process (m,) and whether idle thrusters are left alone."""
