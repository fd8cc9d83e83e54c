"""The null-space map: minimum-norm on-times, with what cancels taken out of each group of thrusters.

Firing a group in the proportion of a null vector v (A v = 0, v >= 0) changes nothing, so

    u = A+ T - sum_i v_i min_{j in group i} (A+ T)_j / v_ij

leaves one thruster of each group at zero and none below; longer on-times than the bounds are cut off. For six
pulsed plasma thrusters it is the map of Valdes 2008, eqs. 3.36-3.39, on SPHERES the pair mixer. Groups share
no thruster and are found by linear programs unless given. A thruster without a group, the partner of a dead
one say, keeps its minimum-norm on-time, cut off at zero.

Left out: a search for the groups that serve most thrusters.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.mapping.base import ClosedFormMapper
from thruster_baselines.mapping.model import matrix_times_vector
from thruster_baselines.mapping.pseudo_inverse import axis_weights, minimum_norm_inverse
from thruster_baselines.mapping.simplex import OPTIMAL, solve_batch
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["NullSpaceMapper", "disjoint_null_vectors"]

BoolArray: TypeAlias = NDArray[np.bool_]

_NEGLIGIBLE = 1e-9  # of a thruster's effect: below this share it has none on an axis, and a group cancels
_ROUND_OFF = 1e-12  # shares of the largest minimum-norm on-time below this open no thruster
_ELSEWHERE = 1e3  # what the whole of a thruster's effect costs on foreign axes, beside 1 for firing it
_MISS = 1e8  # what missing as much costs


class NullSpaceMapper(ClosedFormMapper):
    """Minimum-norm on-times, less what cancels in each group of thrusters, then clipped.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        null_vectors: (k, n), the proportions in which k groups of thrusters cancel; zero or more, no thruster
            in two of them. By default they are found (`disjoint_null_vectors`), anew for an effectiveness
            that comes with a call; given ones are used for it as far as they cancel there too.

    Attributes:
        null_vectors: (k, n), as given or found; read-only.

    Raises:
        ValueError: A value that cannot be; null vectors that do not cancel or that share a thruster.

    >>> mapper = NullSpaceMapper([[1.0, -1.0]], max_on_time=5.0)
    >>> mapper.null_vectors, mapper([-2.0]).on_times.round(12)
    (array([[1., 1.]]), array([0., 2.]))
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        *,
        null_vectors: ArrayLike | None = None,
    ) -> None:
        self._given: FloatArray | None = None
        super().__init__(spacecraft, max_on_time)
        if null_vectors is not None:
            self._given = _checked(null_vectors, self._model.effectiveness)
            self._prepared = self._prepare(self._model.effectiveness)

    @property
    def null_vectors(self) -> FloatArray:
        """(k, n): the proportion in which each group cancels."""
        vectors = self._prepared[1]
        kept: FloatArray = vectors[vectors.any(axis=1)]
        kept.setflags(write=False)
        return kept

    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        if self._given is None:
            vectors = disjoint_null_vectors(effectiveness)
        else:
            cancels = _cancels(effectiveness[..., np.newaxis, :, :], self._given)
            vectors = np.where(cancels[..., np.newaxis], self._given, 0.0)
        return minimum_norm_inverse(effectiveness), vectors

    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        inverse, vectors = prepared
        balanced = matrix_times_vector(inverse, command)
        member = vectors > 0.0
        shares = np.where(member, balanced[..., np.newaxis, :] / np.where(member, vectors, 1.0), np.inf)
        smallest = shares.min(axis=-1)
        smallest = np.where(np.isfinite(smallest), smallest, 0.0)
        on_times: FloatArray = balanced - (smallest[..., np.newaxis] * vectors).sum(axis=-2)
        round_off = _ROUND_OFF * np.abs(balanced).max(axis=-1, keepdims=True)
        return np.where(on_times > round_off, on_times, 0.0)


def disjoint_null_vectors(effectiveness: FloatArray) -> FloatArray:
    """Proportions (..., n // 2, n) in which groups of thrusters cancel; rows of zeros fill up.

    No thruster is in two groups; the smallest entry of each is one. Thrusters without effect are in none.

    Args:
        effectiveness: (..., m, n), m/s^2 then rad/s^2.
    """
    m, n = effectiveness.shape[-2:]
    weighed = (effectiveness * axis_weights(effectiveness)[..., np.newaxis]).reshape(-1, m, n)
    length = np.linalg.norm(weighed, axis=1)
    taken = length == 0.0
    length = np.where(taken, 1.0, length)
    effect = weighed / length[:, np.newaxis, :]
    vectors = np.zeros((len(effect), n // 2, n))
    groups = np.zeros(len(effect), np.int64)
    for j in range(n):
        proportion, undone = _cheapest_cancellation(effect, taken, j)
        found = np.flatnonzero(undone & ~taken[:, j])
        proportion = proportion[found] / length[found]
        smallest = np.where(proportion > 0.0, proportion, np.inf).min(axis=-1, keepdims=True)
        vectors[found, groups[found]] = proportion / smallest
        taken[found] |= proportion > 0.0
        groups[found] += 1
    return vectors.reshape(*effectiveness.shape[:-2], n // 2, n)


def _cheapest_cancellation(effect: FloatArray, taken: BoolArray, j: int) -> tuple[FloatArray, BoolArray]:
    """The firing (batch, n) that undoes one of thruster j and includes it, and whether there is any.

    Args:
        effect: (batch, m, n), columns of length one, or of zeros.
        taken: (batch, n), thrusters that may not be used.
        j: The thruster.
    """
    elsewhere = np.abs(effect[:, :, j]) <= _NEGLIGIBLE
    bounds = np.where(taken, 0.0, np.inf)
    bounds[:, j] = 0.0
    firing, slack, _, report = solve_batch(
        np.ascontiguousarray(-effect[:, :, j]),
        effect,
        bounds,
        1.0 + _ELSEWHERE * (np.abs(effect) * elsewhere[:, :, np.newaxis]).sum(axis=1),
        np.full(effect.shape[1], _MISS),
    )
    firing[:, j] = 1.0
    return firing, (report[:, 0] == OPTIMAL) & (np.abs(slack).max(axis=1) <= _NEGLIGIBLE)


def _cancels(effectiveness: FloatArray, vectors: FloatArray) -> BoolArray:
    """Whether firing in these proportions (..., n) leaves, on every axis, nothing of what it does."""
    left = np.abs(matrix_times_vector(effectiveness, vectors))
    moved = matrix_times_vector(np.abs(effectiveness), vectors)
    return np.asarray((left <= _NEGLIGIBLE * moved).all(axis=-1))


def _checked(given: ArrayLike, effectiveness: FloatArray) -> FloatArray:
    """The null vectors (k, n) that were given, or a ValueError that says which of them is none."""
    vectors = np.array(given, dtype=np.float64)
    n = effectiveness.shape[1]
    if vectors.ndim != 2 or vectors.shape[1] != n:
        raise ValueError(f"null_vectors has the shape {vectors.shape}; (groups, {n}) would be right")
    valid = np.isfinite(vectors) & (vectors >= 0.0)
    if not valid.all():
        i, j = (int(index) for index in np.argwhere(~valid)[0])
        raise ValueError(
            f"null_vectors of group {i} is {vectors[i, j]} for thruster {j + 1}; a finite number, zero or "
            "more, would be right"
        )
    shared = np.flatnonzero((vectors > 0.0).sum(axis=0) > 1)
    if shared.size:
        groups = np.flatnonzero(vectors[:, shared[0]]).tolist()
        raise ValueError(
            f"null_vectors of groups {groups[0]} and {groups[1]} share thruster {shared[0] + 1}; each "
            "thruster in one group at most would be right"
        )
    cancels = _cancels(effectiveness, vectors)
    if not cancels.all():
        i = int(np.argmin(cancels))
        raise ValueError(
            f"null_vectors of group {i} gives the rate change {(effectiveness @ vectors[i]).tolist()}; a "
            "proportion in which thrusters cancel would be right"
        )
    return vectors
