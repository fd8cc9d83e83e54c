"""What is wrong with an isolated thruster: model comparison, and a severity by least squares.

For each model of the fault (none, stuck off or on, losses, leaks, and if asked for tilts) the rate change is
predicted with the shared feed; the statistic is the squared distance from what was measured, weighed by the
inverse of the detector's covariance Y (Yang 2003, section 5.3.1), and infinite where the model cannot be told
from no fault in this interval. Least squares beside it fit the share, with its standard deviation. A thruster
that is stuck on fires for the whole interval, not for the longest on-time of 5 s (section 6.4.4).

Left out: faults that come late; look at `statistic` then.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.interval import Interval, whiten
from thruster_baselines.mapping.coupling import Coupling, convert, thrust_shares
from thruster_envs.faults import encoding as code
from thruster_envs.faults.kinds import CODES
from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["Identification", "ModelComparison", "Severity", "least_squares_severity"]


@dataclass(frozen=True, slots=True)
class Identification:
    """What the comparison says of each vehicle.

    Attributes:
        kind: (vehicles,). `none`, or a kind of `thruster_envs.faults.KINDS`; `none` also where no thruster
            was named or nothing was measured.
        severity: (vehicles,). Of the best model, as `thruster_envs.faults.Fault` has it: the share lost, the
            opening of a closed valve, or the angle in rad; 0 for `none`.
        statistic: (vehicles, models). Of each model in the order of `ModelComparison.models`; infinite where
            it cannot be told from no fault; zeros where there was nothing to compare.
    """

    kind: tuple[str, ...]
    severity: FloatArray
    statistic: FloatArray


@dataclass(frozen=True, slots=True)
class Severity:
    """Least-squares size of a fault of the named thruster, of each vehicle.

    Attributes:
        loss: (vehicles,). Share of its thrust that it has lost, 0 to 1.
        loss_deviation: (vehicles,). Standard deviation of the loss before it was cut; infinite where the
            thruster was not fired.
        opening: (vehicles,). Share of full thrust that comes while it is shut, 0 to 1.
        opening_deviation: (vehicles,). Infinite where it was never shut.
    """

    loss: FloatArray
    loss_deviation: FloatArray
    opening: FloatArray
    opening_deviation: FloatArray


class ModelComparison:
    """Says how a thruster fails, from the interval in which a detector named it.

    Args:
        spacecraft: Description, name or path, for the coupling; or the number of thrusters.
        losses: Shares lost of the partial models, each above 0 and below 1.
        openings: Openings of the leak models, each above 0 and below 1.
        coupling: Share of thrust lost per further thruster open, or a loss curve; by default that of the
            spacecraft.
        tilts: Angles of the models of misalignment, rad, above 0 and at most pi/2; none by default. They need
            a spacecraft.
        sides: To how many sides a thrust is tilted, in models of their own.

    Attributes:
        models: (kind, severity) of each model, in order; those of a tilt once for each side.

    Raises:
        ValueError: A level that cannot be.

    >>> from thruster_baselines.detection import GLRDetector
    >>> detector = GLRDetector("orion")
    >>> told = 2.0 * np.eye(12)[4]
    >>> half = detector.filter.effectiveness[0] @ (0.5 * told)
    >>> diagnosis = detector.update(told, half, duration=5.0)
    >>> answer = ModelComparison("orion", losses=(0.25, 0.5, 0.75))(detector.last, diagnosis.thruster)
    >>> answer.kind, answer.severity
    (('loss',), array([0.5]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | int,
        losses: Sequence[float] = (0.2, 0.4, 0.6, 0.8),
        openings: Sequence[float] = (0.2, 0.4, 0.6, 0.8),
        coupling: Coupling | None = None,
        tilts: Sequence[float] = (),
        sides: int = 8,
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        for angle in tilts:
            if not 0.0 < angle <= math.pi / 2:
                raise ValueError(f"tilts has {angle}; an angle above 0 and at most pi/2 rad would be right")
        if sides < 1:
            raise ValueError(f"sides is {sides}; one or more would be right")
        turned: list[FloatArray] = []
        if isinstance(spacecraft, Spacecraft):
            coupling = spacecraft.feed.coupling if coupling is None else coupling
            turned = [one for angle in tilts for one in _turned(spacecraft, angle, sides)]
            spacecraft = spacecraft.number_of_thrusters
        elif tilts:
            raise ValueError(f"spacecraft is {spacecraft}; with tilts a spacecraft would be right")
        self._shares = thrust_shares(0.0 if coupling is None else coupling, spacecraft)
        for name, levels in (("losses", losses), ("openings", openings)):
            for level in levels:
                if not 0.0 < level < 1.0:
                    raise ValueError(f"{name} has the level {level}; a share between 0 and 1 would be right")
        self.models: tuple[tuple[str, float], ...] = (
            ("none", 0.0), ("stuck_off", 1.0), ("stuck_on", 1.0),
            *(("loss", float(level)) for level in losses),
            *(("leak", float(level)) for level in openings),
            *(("misalignment", float(angle)) for angle in tilts for _ in range(sides)),
        )  # fmt: skip
        self._codes = np.array([CODES.get(kind, code.EMPTY) for kind, _ in self.models])
        self._levels = np.array([level for _, level in self.models])
        self._turned = np.array(turned) if turned else np.empty((0, 0, 0))

    def __call__(self, interval: Interval, thruster: ArrayLike) -> Identification:
        """Compare the models in one interval.

        Args:
            interval: `BaseDetector.last`: what was told and measured, and what was believed before.
            thruster: (vehicles,), the named one, from 1; 0 for none.

        Raises:
            ValueError: A thruster that does not exist, or no interval.
        """
        named = _named(interval, thruster)
        count = named.size
        statistic = np.zeros((count, self._codes.size))
        best = np.zeros(count, np.int64)
        models = self._codes, self._levels, self._turned
        _compare(tuple(interval), named, self._shares, models, statistic, best)
        return Identification(tuple(self.models[one][0] for one in best), self._levels[best], statistic)


def least_squares_severity(interval: Interval, thruster: ArrayLike) -> Severity:
    """The size of a loss, and of thrust without command, that fit the residual best.

    With the thruster's column a, nu = a' Y^-1 e / (a' Y^-1 a) is the number of seconds of its thrust that the
    residual e amounts to, of variance 1 / (a' Y^-1 a). A loss is -nu over its effective on-time, an opening
    is nu over the time that it was shut.

    Args:
        interval: `BaseDetector.last`.
        thruster: (vehicles,), from 1; 0 for none, which gives zeros of infinite deviation.

    Raises:
        ValueError: A thruster that does not exist.
    """
    named = _named(interval, thruster)
    seconds, variance = np.zeros(named.size), np.full(named.size, np.inf)
    _seconds(tuple(interval), named, seconds, variance)
    rows = np.arange(named.size)
    fired = interval.on_times[rows, named - 1]
    spare = interval.duration - interval.commanded[rows, named - 1]
    sizes = []
    for missing, time in ((-seconds, fired), (seconds, spare)):
        there = time > 0.0
        per_second = np.where(there, 1.0 / np.where(there, time, 1.0), 0.0)
        deviation = np.where(there, np.sqrt(variance) * np.where(there, per_second, 1.0), np.inf)
        sizes += [np.clip(missing * per_second, 0.0, 1.0), deviation]
    return Severity(*sizes)


def _turned(spacecraft: Spacecraft, angle: float, sides: int) -> Iterator[FloatArray]:
    """(6, n) for each side: by how much the effectiveness of each thruster changes if it is tilted there."""
    nominal = spacecraft.effectiveness()
    for side in range(sides):
        turn = 2.0 * math.pi * side / sides
        thrusters = []
        for thruster in spacecraft.thrusters:
            along = np.array(thruster.direction)
            across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
            across /= np.linalg.norm(across)
            tilted = math.cos(angle) * along + math.sin(angle) * (
                math.cos(turn) * across + math.sin(turn) * np.cross(along, across)
            )
            thrusters.append(dataclasses.replace(thruster, direction=tuple(tilted.tolist())))
        yield spacecraft.replace(thrusters=thrusters).effectiveness() - nominal


def _named(interval: Interval | None, thruster: ArrayLike) -> IntArray:
    if interval is None:
        raise ValueError("interval is None; `BaseDetector.last` after an update would be right")
    named = np.asarray(thruster, dtype=np.int64)
    count, n = interval.on_times.shape
    if named.shape != (count,) or (named < 0).any() or (named > n).any():
        raise ValueError(f"thruster is {named.tolist()}; {count} numbers from 0 to {n} would be right")
    return named


class _Models(NamedTuple):
    """Codes and levels (models,), and of tilts the changes of effectiveness (tilts, m, n)."""

    codes: IntArray
    levels: FloatArray
    turned: FloatArray


@kernel(nogil=True)
def _compare(
    interval: Interval,
    named: IntArray,
    shares: FloatArray,
    models: _Models,
    statistic: FloatArray,
    best: IntArray,
) -> None:
    interval = Interval(*interval)
    effectiveness, duration = interval.effectiveness, interval.duration
    codes, levels, turned = models
    m, n = effectiveness.shape[1:]
    first_turned = codes.size - turned.shape[0]
    order = np.empty(n, np.int64)
    delivered = np.empty((3, n))  # as told, shut, open all the time
    left, rest, white = np.empty((m, 3)), np.empty((m, codes.size)), np.empty((m, codes.size))
    root, e = np.empty((m, m)), np.empty(m)
    for v in range(named.size):
        if not interval.valid[v] or named[v] == 0:
            continue
        i = named[v] - 1
        told = interval.commanded[v].copy()
        own = told[i]
        convert(told, shares, order, True, delivered[0])
        told[i] = 0.0
        convert(told, shares, order, True, delivered[1])
        told[i] = duration
        convert(told, shares, order, True, delivered[2])
        for k in range(m):
            for way in range(3):
                left[k, way] = interval.rate_change[v, k]
                for j in range(n):
                    left[k, way] -= effectiveness[v, k, j] * delivered[way, j]
        for model in range(codes.size):
            kind, level = codes[model], levels[model]
            for k in range(m):
                rest[k, model] = left[k, 0]
                if kind == code.STUCK_OFF:
                    rest[k, model] = left[k, 1]
                elif kind == code.STUCK_ON:
                    rest[k, model] = left[k, 2]
                elif kind == code.LOSS:
                    rest[k, model] += effectiveness[v, k, i] * level * delivered[0, i]
                elif kind == code.LEAK:
                    rest[k, model] += level * (left[k, 2] - left[k, 0])
                elif kind == code.MISALIGNMENT:
                    rest[k, model] -= turned[model - first_turned, k, i] * delivered[0, i]
        whiten(interval.covariance[v], left[:, 0], rest, root, e, white)
        for model in range(codes.size):
            kind = codes[model]
            opens = kind == code.STUCK_ON or kind == code.LEAK
            if kind != code.EMPTY and ((opens and own >= duration) or (not opens and own == 0.0)):
                statistic[v, model] = np.inf
                continue
            total = 0.0
            for k in range(m):
                total += white[k, model] * white[k, model]
            statistic[v, model] = total
            if total < statistic[v, best[v]]:
                best[v] = model


@kernel(nogil=True)
def _seconds(interval: Interval, named: IntArray, seconds: FloatArray, variance: FloatArray) -> None:
    interval = Interval(*interval)
    m = interval.residual.shape[1]
    root, e, a, column = np.empty((m, m)), np.empty(m), np.empty((m, 1)), np.empty((m, 1))
    for v in range(named.size):
        if not interval.valid[v] or named[v] == 0:
            continue
        column[:, 0] = interval.effectiveness[v, :, named[v] - 1]
        whiten(interval.covariance[v], interval.residual[v], column, root, e, a)
        along, square = 0.0, 0.0
        for k in range(m):
            along += a[k, 0] * e[k]
            square += a[k, 0] * a[k, 0]
        if square > 0.0:
            seconds[v] = along / square
            variance[v] = 1.0 / square
