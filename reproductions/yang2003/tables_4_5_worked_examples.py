"""Tables 4 and 5: methods I and II on one command, round by round (E07, E08)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.coupling_study import LOSS
from thruster_baselines.mapping import AdditiveCompensationMapper, DifferentialCompensationMapper
from thruster_envs.spacecraft import load

Array = NDArray[np.float64]

COMMAND = np.array([5.0, 1.0, 1.0, 0.0, 0.0, 0.0])
LONGEST = 5.0  # s
ALIGNMENT = np.sign(load("orion").effectiveness())
"""Orion's alignment, as the tables say: with thrusts and torques of one their figures come out."""

TABLE_4 = ((4.52, 0.82, 0.82, 0.0, -0.18, 0.18), (4.97, 1.0, 1.0, 0.0, -0.03, 0.03))
TABLE_5 = ((4.52, 0.82, 0.82, 0.0, -0.18, 0.18), (4.928, 0.9676, 0.9676, 0.0, -0.033, 0.033),
           (4.99, 0.99, 0.99, 0.0, -0.01, 0.01))  # fmt: skip
ROUNDED = 0.0101  # the tables give two decimals, and a misprint or two in the last of them


def achieved(mapper_class: type, rounds: int) -> tuple[Array, Array]:
    """What is achieved after so many rounds, and the on-times."""
    mapper = mapper_class(ALIGNMENT, LONGEST, coupling=LOSS, tolerance=1e-6, max_iterations=rounds)
    answer = mapper(COMMAND)
    return COMMAND - answer.slack, answer.on_times


def deviation(reported: tuple[float, ...], found: Array) -> float:
    """Largest difference, on whichever of two equally cheap vertices: they leave opposite rotations."""
    mirrored = np.array(reported) * [1, 1, 1, -1, -1, -1]
    return float(min(np.abs(np.array(reported) - found).max(), np.abs(mirrored - found).max()))


def _follow(table: tuple[tuple[float, ...], ...], mapper_class: type) -> Finding:
    rows, checks, data = [], {}, []
    for number, reported in enumerate(table, start=1):
        found, on_times = achieved(mapper_class, number)
        far = deviation(reported, found)
        checks[f"round {number} within 0.01 of the table"] = far < ROUNDED
        opened = ", ".join(f"{i + 1}: {on_times[i]:.4f}" for i in np.flatnonzero(on_times > 1e-9))
        rows.append((str(number), _vector(reported), _vector(found), opened))
        data.append({"achieved": found, "on_times": on_times, "deviation": far})
    last = data[-1]["deviation"]
    return Finding(
        ours=f"after {len(table)} rounds {_vector(data[-1]['achieved'])}; largest difference {last:.4f}",
        checks=checks,
        data={"rounds": data},
        note="Two vertices of the linear program are equally cheap here; they differ in the sign of the "
        "rotation that the loss leaves behind, and either counts.",
        tables=(
            Table("Round by round", ("round", "table", "ours", "on-times, s, by thruster"), tuple(rows)),
        ),
    )


def _vector(values: tuple[float, ...] | Array) -> str:
    return "[" + ", ".join(f"{value + 0.0:.4g}" for value in np.round(values, 6)) + "]"


@reproduces(
    "E07",
    lines="Table 4, L501-508",
    reported="two rounds: [4.52, 0.82, 0.82, 0, -0.18, 0.18], then [4.97, 1, 1, 0, -0.03, 0.03]",
    criterion="both rounds to 0.01, on either of the two equally cheap vertices",
)
def method_one(effort: Effort) -> Finding:
    """Method I on the command [5, 1, 1, 0, 0, 0]."""
    return _follow(TABLE_4, DifferentialCompensationMapper)


@reproduces(
    "E08",
    lines="Table 5, L541-551",
    reported="three rounds: [4.52, 0.82, 0.82, 0, -0.18, 0.18], [4.928, 0.9676, 0.9676, 0, -0.033, 0.033], "
    "[4.99, 0.99, 0.99, 0, -0.01, 0.01]",
    criterion="all three rounds to 0.01, on either of the two equally cheap vertices",
)
def method_two(effort: Effort) -> Finding:
    """Method II on the command [5, 1, 1, 0, 0, 0]."""
    return _follow(TABLE_5, AdditiveCompensationMapper)
