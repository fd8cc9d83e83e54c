"""What the studies of chapter 3 measure with, checked against closed forms and brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from reproductions.yang2003.section_3_2_uncertain_command import independent_ends, misses, skewed_by
from reproductions.yang2003.table_6_robust_effectiveness import (
    ROWS,
    errors,
    least_joint_error,
    study,
)

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A matrix (3, 3), a command (3,) that can be met, and corners (8, 3) of its columns' factors."""
    rng = np.random.default_rng(seed)
    matrix = rng.uniform(-1.0, 1.0, (3, 3))
    size = rng.uniform(0.0, 0.3, 3)
    return matrix, matrix @ rng.random(3), 1.0 - size + CORNERS * 2.0 * size


@pytest.mark.parametrize("skewness", [0.0, 0.3, 1.0])
def test_the_gain_of_skewed_intervals_has_its_closed_form(skewness):
    found = misses(skewed_by(skewness), 4_000)
    assert found.gain == pytest.approx(skewness**2 / (1.0 + skewness**2), abs=0.015)  # five standard errors
    assert found.worst_gain == pytest.approx(skewness / (1.0 + skewness), abs=1e-9)


def test_independent_ends_gain_a_quarter_at_worst():
    # Worst misses are max(a, b) and (a + b) / 2 for uniform a and b: 2/3 and 1/2 on average.
    assert misses(independent_ends, 4_000).worst_gain == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_no_errors_within_the_box_are_worse_than_at_its_corners(seed):
    matrix, command, corners = problem(seed)
    rng = np.random.default_rng(seed)
    on_times = rng.random(3)
    at_corners = errors(matrix[None], command[None], corners[None], on_times[None, None])[0, 0]
    inside = corners[0] + rng.random((2_000, 3)) * (corners[-1] - corners[0])
    missed = np.abs((inside * on_times) @ matrix.T - command)
    dense = [missed.max(), missed.max(axis=0).sum(), missed.sum(axis=1).max()]
    assert (dense <= at_corners + 1e-12).all()
    assert dense == pytest.approx(at_corners, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_no_on_times_have_a_smaller_joint_error_than_the_least(seed):
    matrix, command, corners = problem(seed)
    least = least_joint_error(matrix, command, corners)
    rng = np.random.default_rng(seed)
    best, spread = rng.random((1, 3)), 1.0
    for _ in range(60):  # a search that knows nothing of linear programs
        tries = np.maximum(best + spread * rng.normal(size=(1_000, 3)), 0.0)
        tries = np.concatenate([best, tries])
        joint = errors(matrix[None], command[None], corners[None], tries[None])[0, :, 2]
        best, spread = tries[[joint.argmin()]], 0.85 * spread
        assert joint.min() >= least - 1e-9
    assert joint.min() == pytest.approx(least, rel=1e-3)


def test_programs_are_correct_less_often_the_more_they_are_compared_with():
    found = study(ROWS["E19e"], 50)
    assert (np.diff(found.of_candidates, axis=-1) <= 0.0).all()
    assert (found.of_all <= found.of_candidates[..., -1]).all()
    assert found.of_all[1, 1] == found.of_all[2, 0] == 1.0  # each robust program by what it minimises
