"""What a spacecraft can do, for people: authority, what each thruster is worth, which of them look alike.

All of it follows from the nominal description: no fault, no feed coupling, full propellant. It does not say
what can be given on one axis with nothing on the others; a mapper says that
(`thruster_baselines.mapping.compare_mappers`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_envs.spacecraft.brief import span
from thruster_envs.spacecraft.description import Spacecraft
from thruster_envs.spacecraft.files import load

FloatArray = NDArray[np.float64]

AXES = ("x", "y", "z", "x-rotation", "y-rotation", "z-rotation")
"""The six axes of rate changes: three of translation, m/s, then three of rotation, rad/s; body frame."""

_SAME = 1e-9  # one less the cosine between effects that count as along one line


@dataclass(frozen=True, kw_only=True)
class SpacecraftSummary:
    """What a spacecraft can do. `str` gives a text of it.

    Attributes:
        name: Of the spacecraft.
        control_period: s.
        authority: (2, 6): largest rate change in one control period along + (row 0) and - (row 1) of each of
            `AXES`, m/s and rad/s, as magnitudes. All thrusters that help fire for the whole period, whatever
            they do on other axes.
        loss: (n, 2, 6): share of that authority, 0..1, that is gone when thruster k gives nothing; 0 where
            there is no authority.
        rank: Of the effectiveness matrix. Below 6 some rate changes are out of reach, of single axes or of
            combinations of them.
        minimum_impulse: (n,), N s: thrust times the minimum pulse, valve delays and ramps left out; of a
            plasma thruster that of one firing.
        minimum_change: (6,): the largest rate change that a minimum impulse of one thruster gives on each
            axis, m/s and rad/s.
        opposite_pairs: Numbers, from 1, of two thrusters whose effects on the six axes point opposite ways:
            a weak one and a leak of the other look alike in the motion.
        parallel_pairs: Of two whose effects point the same way, whatever their strengths.
        identical_pairs: Of those of them that are equally strong: faults of one and of the other cannot be
            told apart by motion.
        wheels: Name of each reaction wheel, largest torque, N m, and largest momentum, N m s.
        gyros: Name of each control-moment gyro, largest torque, N m, and momentum, N m s.
    """

    name: str
    control_period: float
    authority: FloatArray
    loss: FloatArray
    rank: int
    minimum_impulse: FloatArray
    minimum_change: FloatArray
    opposite_pairs: tuple[tuple[int, int], ...]
    parallel_pairs: tuple[tuple[int, int], ...]
    identical_pairs: tuple[tuple[int, int], ...]
    wheels: tuple[tuple[str, float, float], ...]
    gyros: tuple[tuple[str, float, float], ...]

    def __str__(self) -> str:
        """The text, a table of the authority first."""
        lines = [
            f"{self.name}: {len(self.loss)} thrusters, rank {self.rank} of 6, control period "
            f"{self.control_period:g} s",
            "",
            f"{'':12}" + "".join(f"{axis:>12}" for axis in AXES),
            *(
                f"{f'authority {sign}':12}" + "".join(f"{value:12.3g}" for value in row)
                for sign, row in zip("+-", self.authority, strict=True)
            ),
            f"{'min. pulse':12}" + "".join(f"{value:12.3g}" for value in self.minimum_change),
            f"{'':12}" + "".join(f"{unit:>12}" for unit in 3 * ["m/s"] + 3 * ["rad/s"]),
            "",
            "authority that is lost without a thruster, %:",
            *(f"  {number:>3}: {_losses(loss)}" for number, loss in enumerate(self.loss, start=1)),
            "",
            f"minimum impulse, N s: {span(self.minimum_impulse)}",
            f"opposite pairs: {_pairs(self.opposite_pairs)}",
            f"parallel pairs: {_pairs(self.parallel_pairs)}",
            f"identical pairs: {_pairs(self.identical_pairs)}",
        ]
        lacking = [
            f"{sign}{axis}"
            for sign, row in zip("+-", self.authority, strict=True)
            for axis, value in zip(AXES, row, strict=True)
            if value == 0.0
        ]
        if lacking:
            lines.append(f"no authority: {', '.join(lacking)}")
        for what, ones in (("reaction wheel", self.wheels), ("control-moment gyro", self.gyros)):
            lines += [
                f"{what} {name}: {torque:.4g} N m, {momentum:.4g} N m s" for name, torque, momentum in ones
            ]
        return "\n".join(lines)


def describe(spacecraft: Spacecraft | str | PathLike[str] | Mapping[str, Any]) -> SpacecraftSummary:
    """What a spacecraft can do.

    Args:
        spacecraft: As `load` takes it.

    Raises:
        ValueError: What `load` refuses.

    >>> summary = describe("spheres")
    >>> summary.opposite_pairs[0], summary.parallel_pairs
    ((1, 7), ())
    >>> float(summary.loss[0, 0].max())  # without thruster 1, of +x and of the turn about +y
    0.5
    """
    craft = load(spacecraft)
    effectiveness = craft.effectiveness()
    signed = np.stack([np.maximum(effectiveness, 0.0), np.maximum(-effectiveness, 0.0)])  # (2, 6, n)
    total = signed.sum(axis=2)
    share = signed / np.where(total > 0.0, total, 1.0)[..., np.newaxis]
    impulses = np.array([_minimum_impulse(craft, k) for k in range(craft.number_of_thrusters)])
    thrusts = np.array([thruster.thrust for thruster in craft.thrusters])
    scaled = effectiveness / np.maximum(np.abs(effectiveness).max(axis=1, keepdims=True), 1e-300)
    opposite, parallel, identical = _pairs_of(scaled)
    return SpacecraftSummary(
        name=craft.name,
        control_period=craft.control_period,
        authority=craft.control_period * total,
        loss=np.moveaxis(share, 2, 0),
        rank=int(np.linalg.matrix_rank(scaled, tol=1e-9)),
        minimum_impulse=impulses,
        minimum_change=np.abs(effectiveness * (impulses / thrusts)).max(axis=1),
        opposite_pairs=opposite,
        parallel_pairs=parallel,
        identical_pairs=identical,
        wheels=tuple(
            (one.name, one.max_torque, one.inertia * one.max_speed) for one in craft.reaction_wheels
        ),
        gyros=tuple(
            (one.name, one.momentum * one.max_gimbal_rate, one.momentum) for one in craft.control_moment_gyros
        ),
    )


def _minimum_impulse(craft: Spacecraft, index: int) -> float:
    thruster = craft.thrusters[index]
    pulse = thruster.minimum_pulse if craft.discharge is None else craft.discharge.firing_time
    return thruster.thrust * pulse


def _pairs_of(columns: FloatArray) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Opposite, parallel and identical pairs among the effects (6, n) of thrusters."""
    length = np.linalg.norm(columns, axis=0)
    cosine = columns.T @ columns / np.outer(length, length)
    first, second = np.triu_indices(columns.shape[1], k=1)
    between = cosine[first, second]
    parallel = between > 1.0 - _SAME
    equal = np.abs(length[first] - length[second]) <= _SAME * length[first]
    return tuple(
        tuple(zip((first[which] + 1).tolist(), (second[which] + 1).tolist(), strict=True))
        for which in (between < _SAME - 1.0, parallel, parallel & equal)
    )


def _losses(loss: FloatArray) -> str:
    """What is lost, where anything is: "+x 50, -y 25"."""
    return ", ".join(
        f"{sign}{axis} {100.0 * value:.0f}"
        for sign, row in zip("+-", loss, strict=True)
        for axis, value in zip(AXES, row, strict=True)
        if value > 0.0
    )


def _pairs(pairs: tuple[tuple[int, int], ...]) -> str:
    return ", ".join(f"{first} and {second}" for first, second in pairs) or "none"
