"""Which seeds are for what."""

import itertools
import re

import pytest

from thruster_envs.seeds import TEST, TRAIN, VALIDATION, first_training_seed


def test_sets_of_seeds_are_disjoint():
    ends = sorted((one.start, one.stop) for one in (TRAIN, VALIDATION, TEST))
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(ends))


def test_runs_with_different_seeds_share_no_world():
    assert first_training_seed(0, worlds=10**6) == 0
    assert [first_training_seed(seed, worlds=300) for seed in range(3)] == [0, 300, 600]


@pytest.mark.parametrize(
    ("seed", "worlds", "message"),
    [
        (-1, 100, "seed is -1; with 100 worlds, a whole number from 0 to 9999 would be right"),
        (10_000, 100, "seed is 10000; with 100 worlds, a whole number from 0 to 9999"),
        (10**400, 100, f"seed is 1{'0' * 76}...; with 100 worlds"),
        (10**5000, 100, "seed is <int of 16610 bits>; with 100 worlds"),
        (0, 0, "worlds must be from 1 to 1000000, got 0"),
        (0, 10**5000, "worlds must be from 1 to 1000000, got <int of 16610 bits>"),
    ],
    ids=["negative", "one too many", "401 digits", "5000 digits", "no world", "worlds of 5000 digits"],
)
def test_runs_outside_of_the_training_seeds_are_refused(seed, worlds, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        first_training_seed(seed, worlds)
