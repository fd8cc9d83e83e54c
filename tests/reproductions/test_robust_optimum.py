from __future__ import annotations

import itertools

import numpy as np
import pytest

from reproductions.yang2003.section_6_3_robust_optimum import (
    AUTHORITY,
    NOMINAL,
    ONE_DEGREE,
    attitude_rows,
    axis_rows,
    least_largest_error,
    scatter_rows,
)
from thruster_baselines.mapping import LPMapper
from thruster_envs.spacecraft import load

ORION = load("orion")
FIRED = [0, 1, 5, 8, 9]  # few, so that all corners of their factors can be tried


@pytest.fixture
def case():
    rng = np.random.default_rng(7)
    on_times = np.zeros(12)
    on_times[FIRED] = rng.uniform(0.0, 5.0, len(FIRED))
    return on_times, rng.uniform(-0.2, 0.2, 6) * AUTHORITY


def test_the_worst_scatter_is_at_a_corner_of_the_factors(case):
    on_times, command = case
    missed = []
    for corner in itertools.product((0.8, 1.2), repeat=len(FIRED)):
        factors = np.ones(12)
        factors[FIRED] = corner
        missed.append(np.abs(NOMINAL @ (factors * on_times) - command) / AUTHORITY)
    rows, offset = scatter_rows(command, 0.2)
    assert (rows @ on_times - offset).max() == pytest.approx(np.sum(missed, axis=1).max(), rel=1e-12)
    rows, offset = axis_rows(command, 0.2)
    assert (rows @ on_times - offset).max() == pytest.approx(np.max(missed, axis=0).sum(), rel=1e-12)


def test_no_attitude_error_in_the_box_is_worse_than_the_worst_corner(case):
    on_times, command = case
    rows, offset = attitude_rows(command)
    worst = (rows @ on_times - offset).max()
    seen = []
    for angles in np.random.default_rng(1).uniform(-ONE_DEGREE, ONE_DEGREE, (2000, 3)):
        meant = command + np.concatenate([np.cross(command[:3], angles), np.cross(command[3:], angles)])
        seen.append((np.abs(NOMINAL @ on_times - meant) / AUTHORITY).sum())
    assert 0.98 * worst < max(seen) <= worst


def test_without_error_the_least_is_none_and_beyond_reach_it_is_what_is_missing(case):
    _, command = case
    assert least_largest_error(*scatter_rows(command, 0.0)) == pytest.approx(0.0, abs=1e-9)
    alone = np.zeros(6)
    alone[0] = 3.0 * AUTHORITY[0]
    assert least_largest_error(*scatter_rows(alone, 0.0)) == pytest.approx(2.0, rel=1e-9)


def test_a_single_burn_misses_its_share_of_scatter_and_nothing_is_better():
    """A pair of thrusters: 10 % of the force, and of the torques that cancel, one on each of two axes."""
    command = np.array([0.5 * AUTHORITY[0], 0.0, 0.0, 0.0, 0.0, 0.0])
    on_times = LPMapper(ORION)(command).on_times
    rows, offset = axis_rows(command, 0.1)
    by_hand = 0.1 * (np.abs(NOMINAL) @ on_times / AUTHORITY).sum()
    assert (rows @ on_times - offset).max() == pytest.approx(by_hand, rel=1e-9)
    assert least_largest_error(rows, offset) == pytest.approx(by_hand, rel=1e-7)
