"""How many arithmetic operations a solve by the bounded simplex takes.

The unit is that of Yang 2003, Table 2: one addition, subtraction, multiplication or division of two numbers
is one operation; comparisons, changes of sign and copies are none. What is counted is the dense tableau with
the columns of thrusters and slacks, as `thruster_baselines.mapping.simplex` has it (its columns that only
fill up vector registers are left out).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping import LPMapper
from thruster_envs.protocols import IntArray


@dataclass(frozen=True, slots=True)
class Operations:
    """What solves took; all arrays (...,), in the shape of the batch."""

    pivots: IntArray  # changes of basis
    flips: IntArray  # Runs of a thruster from one of its bounds straight to the other
    arithmetic: IntArray  # additions, subtractions, multiplications and divisions


def count(mapper: LPMapper, commands: ArrayLike) -> Operations:
    """Operations of the mapper's solves for each command (..., m)."""
    axes, thrusters = mapper.effectiveness.shape
    return operations_of(*mapper.pivots(commands), axes=axes, thrusters=thrusters)


def operations_of(pivots: IntArray, flips: IntArray, *, axes: int, thrusters: int) -> Operations:
    """Operations of solves with so many pivots and flips.

    Args:
        pivots: (...,).
        flips: (...,).
        axes: m, of the problem.
        thrusters: n, of the problem.

    >>> operations_of(np.array([9]), np.array([1]), axes=6, thrusters=12).arithmetic.tolist()
    [3441]
    """
    m, n = axes, thrusters
    start = 4 * m * n + 2 * n + m  # weigh and scale the tableau, sum up the reduced costs
    pricing = n + m
    ratios = 3 * m  # rate, way and quotient of each basic variable
    flip = 2 * m
    change = 2 * m + 1 + (n + m) + 2 * (m + 1) * (n + m)  # values, pivot row, elimination
    answer = m + 2 * m * n + 2 * (m + n)  # on-times, slack, objective
    pivots, flips = np.asarray(pivots, np.int64), np.asarray(flips, np.int64)
    rounds = pivots + flips
    arithmetic = start + answer + pricing * (rounds + 1) + ratios * rounds + flip * flips + change * pivots
    return Operations(pivots.copy(), flips.copy(), np.asarray(arithmetic))
