"""A model that does not fit, told apart from a faulty thruster.

A wrong feed coupling, mass, inertia, valve delay, or a thrust that is off alike for all thrusters leaves
residuals in every interval, and a detector alarms. Over all intervals since a reset the residuals e of
covariance Y are fitted by the signature s of each such parameter, by least squares,

    estimate = sum s' Y^-1 e / sum s' Y^-1 s,   statistic = (sum s' Y^-1 e)^2 / sum s' Y^-1 s,

and likewise by a loss and by thrust without command of each single thruster. The parameter that explains the
most does not fit if for twenty intervals on end it explains more than any single thruster, leaves no more
than errors explain, is sure, is off by more than matters, and is off by the same in the first quarter to half
of the intervals as in the others: a fault begins at some time, a wrong model has always been wrong.

Left out: several parameters at once, parameters that change, vehicles behind a modulator, whose delays vary
slowly.
"""

from __future__ import annotations

import numpy as np

from thruster_baselines.detection.interval import Interval
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["PARAMETERS", "MismatchMonitor", "ModelMismatchWarning"]

PARAMETERS = ("feed coupling", "thrust of all", "mass", "inertia x", "inertia y", "inertia z", "valve delay")
"""What may not fit. It is off by so much: the coupling by a share of thrust per further thruster, the delay
of all valves by s, the thrust by a share of what is believed, mass and inertia by one of what is true."""

_SURE, _LEAD, _MORE, _LASTING, _LEFT, _SAME = 30.0, 10.0, 1.2, 20, 1.1, 9.0
_MATTERS = (0.005, 0.01, 0.01, 0.02, 0.02, 0.02)  # of the delay: as a share of the interval
_DELAY_MATTERS = 0.002


class ModelMismatchWarning(UserWarning):
    """A vehicle is not what its description says: which parameter, and by how much."""


class MismatchMonitor:
    """Follows the residuals of vehicles that are all of one description.

    Args:
        vehicles: How many.
        thrusters: How many each has.
        coupling: Share of thrust lost per further thruster open.

    Attributes:
        estimate: (vehicles, parameters), by how much each parameter is off if it alone is, in the order and
            units of `PARAMETERS`.
        deviation: (vehicles, parameters), its standard deviation; infinite where nothing is known.
        statistic: (vehicles, parameters), squared estimates over their variances.
        parameter: (vehicles,), index of the one that does not fit; -1 for none.
    """

    def __init__(self, vehicles: int, thrusters: int, coupling: float = 0.0) -> None:
        self._vehicles, self._thrusters, self._coupling = vehicles, thrusters, coupling
        self.reset()

    def reset(self, mask: BoolArray | None = None) -> None:
        """Start anew in the vehicles of a mask (vehicles,), or in all of them."""
        size = len(PARAMETERS) + 2 * self._thrusters
        if mask is None:
            self._along: FloatArray = np.zeros((self._vehicles, size))
            self._square: FloatArray = np.zeros((self._vehicles, size))
            self._total: FloatArray = np.zeros(self._vehicles)
            self._degrees: FloatArray = np.zeros(self._vehicles)
            self._lasting: IntArray = np.zeros(self._vehicles, np.int64)
            self._count: IntArray = np.zeros(self._vehicles, np.int64)
            self._early, self._next = np.zeros((2, 2, self._vehicles, len(PARAMETERS)))  # along, square
        else:
            self._along[mask], self._square[mask], self._lasting[mask] = 0.0, 0.0, 0
            self._total[mask], self._degrees[mask], self._count[mask] = 0.0, 0.0, 0
            self._early[:, mask], self._next[:, mask] = 0.0, 0.0
            self.estimate[mask], self.statistic[mask], self.deviation[mask] = 0.0, 0.0, np.inf
            self.parameter[mask] = -1
            return
        self._conclude(np.inf)

    def update(self, interval: Interval) -> None:
        """Take in an interval."""
        root = np.linalg.cholesky(interval.covariance)
        signatures = np.linalg.solve(root, _signatures(interval, self._coupling))
        residual = np.linalg.solve(root, interval.residual[..., np.newaxis])
        valid = interval.valid
        self._total += np.square(residual[..., 0]).sum(axis=1) * valid
        self._degrees += residual.shape[1] * valid
        self._along += (signatures * residual).sum(axis=1) * valid[:, np.newaxis]
        self._square += np.square(signatures).sum(axis=1) * valid[:, np.newaxis]
        self._count += valid
        doubled = valid & (self._count & (self._count - 1) == 0)  # sums are kept at every power of two
        self._early[:, doubled] = self._next[:, doubled]
        for kept, sums in zip(self._next, (self._along, self._square), strict=True):
            kept[doubled] = sums[doubled, : len(PARAMETERS)]
        self._conclude(interval.duration)

    def _conclude(self, duration: float) -> None:
        known, first = self._square > 0.0, len(PARAMETERS)
        square = np.where(known, self._square, 1.0)
        size = np.where(known, self._along / square, 0.0)
        explained = size * self._along
        self.estimate, self.statistic = size[:, :first], explained[:, :first]
        self.deviation: FloatArray = np.where(known, 1.0 / np.sqrt(square), np.inf)[:, :first]
        one = np.where(size[:, first:] > 0.0, explained[:, first:], 0.0).max(axis=1, initial=0.0)
        best = self.statistic.argmax(axis=1)
        rows = np.arange(self._vehicles)
        most = self.statistic[rows, best]
        matters = np.array([*_MATTERS, _DELAY_MATTERS * duration])[best]
        off = np.abs(self.estimate[rows, best]) > matters
        fits_not = (most > np.maximum(_MORE * one + _LEAD, _SURE)) & off
        fits_not &= self._total - most <= _LEFT * self._degrees + 4.0 * np.sqrt(2.0 * self._degrees)
        fits_not &= self._steady()[rows, best]
        self._lasting = np.where(fits_not, self._lasting + 1, 0)
        self.parameter: IntArray = np.where(self._lasting >= _LASTING, best, -1)

    def _steady(self) -> BoolArray:
        """(vehicles, parameters): whether early and late intervals agree; where one says nothing, they do."""
        first = len(PARAMETERS)
        (along, square), late = self._early, self._square[:, :first] - self._early[1]
        known = (square > 0.0) & (late > 0.0)
        square, late = np.where(known, square, 1.0), np.where(known, late, 1.0)
        apart = along / square - (self._along[:, :first] - along) / late
        same: BoolArray = (np.square(apart) <= _SAME * (1.0 / square + 1.0 / late)) | ~known
        return same

    def names(self) -> tuple[str, ...]:
        """Of each vehicle, the parameter that does not fit; empty for none."""
        return tuple(["" if one < 0 else PARAMETERS[one] for one in self.parameter.tolist()])

    def line(self, vehicle: int) -> str:
        """What does not fit of a vehicle, for people."""
        one = int(self.parameter[vehicle])
        if one < 0:
            return ""
        off, deviation = float(self.estimate[vehicle, one]), float(self.deviation[vehicle, one])
        unit = " s" if PARAMETERS[one] == "valve delay" else ""
        return f"{PARAMETERS[one]} seems to be off by {off:+.3g}{unit}, give or take {deviation:.1g}{unit}"


def _signatures(interval: Interval, coupling: float) -> FloatArray:
    """(vehicles, m, parameters + 2 n): what one unit of each adds to a residual."""
    u, opened, a = interval.on_times, interval.commanded, interval.effectiveness
    m = a.shape[1]
    change = np.einsum("vmn,vn->vm", a, u)
    together = np.minimum(opened[:, :, np.newaxis], opened[:, np.newaxis, :])
    overlap = together.sum(axis=2) - opened
    columns = [np.einsum("vmn,vn->vm", a, -overlap), change]
    for axes in (range(3), [3], [4], [5]):
        part = np.zeros_like(change)
        part[:, [k for k in axes if k < m]] = -change[:, [k for k in axes if k < m]]
        columns.append(part)
    columns.append(np.einsum("vmn,vn->vm", a, -(u > 0.0).astype(np.float64)))
    # One that is open all the time takes its part of the feed from those open without it, and they its.
    more = opened[:, np.newaxis, :] - together
    spare = np.maximum(interval.duration - opened - coupling * more.sum(axis=2), 0.0)
    excess = a * spare[:, np.newaxis] - coupling * np.einsum("vmj,vij->vmi", a, more)
    single = np.concatenate([-a * u[:, np.newaxis], excess], axis=2)
    single[:, :, np.tile(~a.any(axis=(0, 1)), 2)] = 0.0
    return np.concatenate([np.stack(columns, axis=2), single], axis=2)
