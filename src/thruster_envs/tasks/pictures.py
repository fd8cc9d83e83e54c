"""What a task adds to the picture of one of its worlds: plain values, which a view hands to the renderer.

Whatever has become of a world, what is drawn of it is finite: :func:`drawable`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

#: Largest number that is drawn.
FARTHEST = 1e9


class Trace(NamedTuple):
    """Something measured over time, beside what was expected.

    Attributes:
        label: What it is, and its unit.
        time_label: What the time is, and its unit.
        time: (k,), rising, at least two.
        expected: (k,), drawn as a line.
        measured: (k,), drawn as dots.
    """

    label: str
    time_label: str
    time: FloatArray
    expected: FloatArray
    measured: FloatArray


class Frame(NamedTuple):
    """Of what a picture is made.

    Attributes:
        state: Of the batch.
        world: Which one is drawn.
        info: Of all worlds, arrays (worlds, agents) by name.
        samples: (k, numbers), what :meth:`~thruster_envs.tasks.Task.sample` gave at the reset and after each
            step since.
    """

    state: Any
    world: int
    info: dict[str, Any]
    samples: FloatArray


@dataclass(frozen=True, kw_only=True)
class Picture:
    """What is to be seen of a world beside its craft, their thrusters and their path.

    Attributes:
        readouts: Pairs of label and value for the header, the most important first.
        targets: (craft, 3), m, LVLH, where the craft should be; without rows, the origin.
        closed: (craft, n), whether isolation valves are closed; without rows, none is.
        bars: Label, what was commanded and what was delivered, in shares of the authority; in place of the
            path.
        traces: If there are any, and no bars, they are in place of the path.
        traces_name: What they are of.
        corridor: (k, 2), m: along-track position and half-width of the corridor to stay in.
    """

    readouts: tuple[tuple[str, str], ...] = ()
    targets: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    closed: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), np.bool_))
    bars: tuple[tuple[str, float, float], ...] = ()
    traces: tuple[Trace, ...] = ()
    traces_name: str = ""
    corridor: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))


def drawable(values: ArrayLike, otherwise: ArrayLike = 0.0) -> FloatArray:
    """The values where they are finite, within reach of a picture; something else where they are not."""
    array = np.asarray(values, np.float64)
    return np.where(np.isfinite(array), array, otherwise).clip(-FARTHEST, FARTHEST)


def fuel_and_score(frame: Frame) -> tuple[tuple[str, str], ...]:
    """The readouts that every flight has."""
    fuel, score = frame.info["fuel"][frame.world], frame.info["score"][frame.world]
    return ("fuel", f"{fuel.sum():.0f} thruster-s"), ("score", f"{score.mean():.2f}")


def distance(place: FloatArray, target: FloatArray) -> tuple[str, str]:
    """The readout of how far a craft is from its target, (3,) m each."""
    away = float(np.linalg.norm(place - target))
    return "distance", f"{away:.{1 if away >= 1.0 else 2}f} m"
