"""The redistributed pseudo-inverse: what saturates is fixed there, and the others take over what it leaves.

Cascaded generalized inverses (Bordignon 1996; Bodson 2002): thrusters whose on-times come out negative or too
long are fixed at their bound, and the rest of the command goes to the pseudo-inverse of the others, until
none saturates. Misses are least squares, each axis in units of its largest effectiveness.

Left out: a thruster that was fixed stays fixed. With thrusters that only push, about half are fixed at zero
at once, so that a command that could be tracked is often missed; `NonNegativeLeastSquaresMapper` with
`bounded` frees them again.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.mapping.base import BaseMapper, each_or_shared, leading_axes, whole
from thruster_baselines.mapping.model import Model, matrix_times_vector
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.kernels import kernel
from thruster_envs.protocols import Allocation, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["RedistributedPseudoInverseMapper"]

BoolArray: TypeAlias = NDArray[np.bool_]

_NEGLIGIBLE = 1e-12  # on-times, and what of them stands over a bound, below this share of the largest
_RANK_TOLERANCE = 1e-10  # columns below this share of the largest, once the others are taken out of them


class RedistributedPseudoInverseMapper(BaseMapper):
    """Minimum-norm on-times, in rounds: what saturates is fixed, and the rest goes to the other thrusters.

    Compiled; a batch gives, bit for bit, what its commands give one by one.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> mapper = RedistributedPseudoInverseMapper([[1.0, 1.0]], max_on_time=[1.0, 5.0])
    >>> mapper([4.0]).on_times  # an equal part for each would be 2 s
    array([1., 3.])
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        threads: int | None = None,
    ) -> None:
        if threads is not None and threads < 1:
            raise ValueError(f"threads is {threads}; one or more, or None, would be right")
        super().__init__(spacecraft, max_on_time)
        self._threads = threads

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        m, n = self._model.effectiveness.shape
        leading = leading_axes(command, model)
        commands = whole(command, leading, (m,))
        problem = (
            commands.reshape(-1, m),
            each_or_shared(model.effectiveness, leading, (m, n)),
            each_or_shared(model.max_on_time, leading, (n,)),
        )
        answer = np.empty((len(problem[0]), n))
        in_threads(
            lambda first, last: _redistribute_range(*problem, answer, first, last), len(answer), self._threads
        )
        on_times = answer.reshape(*leading, n)
        return Allocation(
            on_times=on_times,
            slack=commands - matrix_times_vector(model.effectiveness, on_times),
            cost=np.asarray(on_times.sum(axis=-1)),
            status=np.zeros(leading, np.int64),
        )


@kernel(nogil=True)
def _redistribute_range(
    command: FloatArray,
    effectiveness: FloatArray,
    max_on_time: FloatArray,
    on_times: FloatArray,
    first: int,
    last: int,
) -> None:
    """Answer problems `first` to `last` (excluded) of a batch.

    Commands are (batch, m); effectiveness and bounds have a leading axis of batch or of 1.
    """
    m, n = effectiveness.shape[1:]
    matrix, rest, trial, fixed = np.empty((m, n)), np.empty(m), np.empty(n), np.empty(n, np.bool_)
    columns, across, along = np.empty((m, n)), np.empty((m, m)), np.empty((m, n))
    own_effectiveness, own_bounds = effectiveness.shape[0] > 1, max_on_time.shape[0] > 1
    for i in range(first, last):
        bound = max_on_time[i if own_bounds else 0]
        on_time = on_times[i]
        weights = _weigh(effectiveness[i if own_effectiveness else 0], matrix)
        for j in range(n):
            on_time[j] = 0.0
            fixed[j] = bound[j] == 0.0
        for _ in range(n + 1):  # every round but the last fixes a thruster
            for k in range(m):
                rest[k] = weights[k] * command[i, k]
                for j in range(n):
                    if fixed[j]:
                        rest[k] -= matrix[k, j] * on_time[j]
            _minimum_norm(matrix, fixed, rest, columns, across, along, trial)
            if not _fix_what_saturates(trial, bound, on_time, fixed):
                break


@kernel
def _weigh(effectiveness: FloatArray, matrix: FloatArray) -> FloatArray:
    """Fill in the effectiveness (m, n) with each axis in units of its largest entry; return the weights."""
    m, n = effectiveness.shape
    weights = np.empty(m)
    for k in range(m):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(effectiveness[k, j]))
        weights[k] = 1.0 / largest if largest > 0.0 else 0.0
        for j in range(n):
            matrix[k, j] = weights[k] * effectiveness[k, j]
    return weights


@kernel
def _fix_what_saturates(trial: FloatArray, bound: FloatArray, on_time: FloatArray, fixed: BoolArray) -> bool:
    """Fix the free thrusters that saturate; if none does, take over the on-times tried. Says if any did."""
    n = trial.size
    largest = 0.0
    for j in range(n):
        if not fixed[j]:
            largest = max(largest, abs(trial[j]))
    tie = _NEGLIGIBLE * largest
    saturated = False
    for j in range(n):
        if fixed[j]:
            continue
        on_time[j] = min(trial[j], bound[j]) if trial[j] > tie else 0.0
        if trial[j] < -tie or trial[j] > bound[j] + tie:
            fixed[j] = True
            saturated = True
    return saturated


@kernel
def _minimum_norm(
    matrix: FloatArray,
    fixed: BoolArray,
    rest: FloatArray,
    columns: FloatArray,
    across: FloatArray,
    along: FloatArray,
    solution: FloatArray,
) -> None:
    """The x of smallest norm among those with least |A x - b| for the columns A of the free thrusters.

    With rows q of an orthonormal basis Q of what A reaches, Q A x = Q b has full row rank; with rows p of an
    orthonormal basis P of the rows of Q A = L P, x = P^T L^-1 Q b. Both by Gram and Schmidt, each vector
    cleared twice of those before it; columns are taken by size, which tells the rank.

    Args:
        matrix: (m, n).
        fixed: (n,), columns to leave out; their x is zero.
        rest: (m,), b.
        columns: (m, n), working memory.
        across: (m, m), working memory; Q.
        along: (m, n), working memory; P.
        solution: (n,), filled in with x.
    """
    m, n = matrix.shape
    for k in range(m):
        for j in range(n):
            columns[k, j] = 0.0 if fixed[j] else matrix[k, j]
    for j in range(n):
        solution[j] = 0.0
    threshold = 0.0
    for r in range(min(m, n)):
        pivot, largest = 0, 0.0
        for j in range(n):
            size = 0.0
            for k in range(m):
                size += columns[k, j] * columns[k, j]
            if size > largest:
                pivot, largest = j, size
        if r == 0:
            threshold = largest * _RANK_TOLERANCE * _RANK_TOLERANCE
        if largest <= threshold:
            return
        for k in range(m):
            across[r, k] = columns[k, pivot]
        _clear(across, r)
        for j in range(n):
            part = 0.0
            for k in range(m):
                part += across[r, k] * columns[k, j]
            for k in range(m):
                columns[k, j] -= part * across[r, k]
        # The next row of Q A = L P and of L^-1 Q b; what it adds to x is orthogonal to what is there.
        right = 0.0
        for k in range(m):
            right += across[r, k] * rest[k]
        for j in range(n):
            along[r, j] = 0.0
            if not fixed[j]:
                for k in range(m):
                    along[r, j] += across[r, k] * matrix[k, j]
                right -= along[r, j] * solution[j]
        length = _clear(along, r)
        for j in range(n):
            solution[j] += right / length * along[r, j]


@kernel
def _clear(rows: FloatArray, r: int) -> float:
    """Clear row r of the orthonormal rows before it, and make its length one; returns the one it had."""
    for _ in range(2):
        for i in range(r):
            part = 0.0
            for j in range(rows.shape[1]):
                part += rows[i, j] * rows[r, j]
            for j in range(rows.shape[1]):
                rows[r, j] -= part * rows[i, j]
    length = 0.0
    for j in range(rows.shape[1]):
        length += rows[r, j] * rows[r, j]
    length = math.sqrt(length)
    for j in range(rows.shape[1]):
        rows[r, j] /= length
    return length
