"""The random commands of Yang 2003, section 2.4.4, and how well and fast each way of compensating answers.

Commands are uniform in a box of 15 % of Orion's authority on each axis, on the three axes of translation, on
those of rotation, or on all six. The source does not say how it drew them. Up to that size no on-time reaches
its bound even with the loss made up for, so that every command can be met. Error is the miss with the loss,
by overlap, over the command, both in shares of authority (Euclidean).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.mapping import (
    AdditiveCompensationMapper,
    DifferentialCompensationMapper,
    ExactCompensationMapper,
    LPMapper,
    MILPMapper,
    delivered_rate_change,
)
from thruster_envs.protocols import Allocation, Mapper
from thruster_envs.spacecraft import load

Array = NDArray[np.float64]

CONDITIONS = {"rotation": (0, 0, 0, 1, 1, 1), "translation": (1, 1, 1, 0, 0, 0), "six axes": (1,) * 6}
SHARE = 0.15
LOSS, INTEGER_LOSS = 0.06, 0.062  # per further thruster; the source has another number in its integer program
FAILED = 0.01  # an error above this is a failure

METHODS: Mapping[str, Callable[[], Mapper]] = {
    "no compensation": lambda: LPMapper("orion", threads=1),
    "method I": lambda: DifferentialCompensationMapper("orion", threads=1),
    "method II": lambda: AdditiveCompensationMapper("orion", threads=1),
    "exact": lambda: ExactCompensationMapper("orion", threads=1),
    "integer program": lambda: MILPMapper("orion", coupling=INTEGER_LOSS),
}


@dataclass(frozen=True)
class Trial:
    """What one method made of the commands of one condition."""

    error: Array  # (count,), miss over command
    iterations: NDArray[np.int64]  # (count,), linear programs solved; ones where there is nothing to count
    failed: NDArray[np.bool_]  # (count,), whether the method itself says that it did not get there
    seconds: float  # per command, in a batch on one thread
    firing: Array  # (count,), s, sum of on-times


def commands(condition: str, count: int, share: float = SHARE, seed: int = 2003) -> Array:
    """(count, 6), m/s and rad/s."""
    drawn = np.random.default_rng(seed).uniform(-share, share, (count, 6))
    return np.asarray(drawn * load("orion").authority() * CONDITIONS[condition])


def relative_error(asked: Array, on_times: Array) -> Array:
    """(count,): miss with the loss over command, both in shares of authority."""
    orion = load("orion")
    achieved = delivered_rate_change(orion.effectiveness(), on_times, LOSS)
    unit = orion.authority()
    return np.asarray(
        np.linalg.norm((asked - achieved) / unit, axis=1) / np.linalg.norm(asked / unit, axis=1)
    )


@cache
def trial(method: str, condition: str, count: int) -> Trial:
    """Fly the commands of a condition through a method; remembered, since several figures need the same."""
    asked, mapper = commands(condition, count), METHODS[method]()
    mapper(asked[:2])  # compiled by now
    start = time.perf_counter()
    answer: Allocation = mapper(asked)
    seconds = (time.perf_counter() - start) / count
    iterations = getattr(answer, "iterations", np.ones(count, np.int64))
    return Trial(
        relative_error(asked, answer.on_times), iterations, answer.status != 0, seconds,
        answer.on_times.sum(axis=1),
    )  # fmt: skip
