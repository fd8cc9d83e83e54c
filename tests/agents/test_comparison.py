"""Facts of the table: who is above whom, and why nobody is above the oracle."""

from itertools import pairwise

import numpy as np
import pytest

from thruster_agents.evaluation import DEAD, FAULTS, HEALTHY, SCENARIOS, classical_methods, compare, play
from thruster_agents.evaluation.methods import FALSE_ALARM_RATE
from thruster_agents.evaluation.table import bootstrap_interval
from thruster_envs.seeds import TEST, TRAIN, VALIDATION, first_training_seed

SEEDS = TEST[-200:]  # of the test set, the end that the table does not use
ROUND_OFF = 1e-9


@pytest.fixture(scope="module")
def methods(orion):
    return {one.key: one for one in classical_methods(orion)}


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda one: one.name)
def test_the_oracle_is_the_ceiling_for_every_single_command(methods, orion, scenario):
    """Its objective is the least that any on-times can have, so nobody's reward exceeds its own."""
    best = play(methods["oracle"], scenario, SEEDS, orion).rewards
    for method in methods.values():
        assert (play(method, scenario, SEEDS, orion).rewards <= best + ROUND_OFF).all(), method.key


def test_the_oracle_is_the_ceiling_with_every_kind_of_constant_fault(methods, orion):
    """What acts without being asked (stuck open, a leak) is taken off the command before it is mapped."""
    kinds = {"probability": 1.0, "kinds": ["stuck_off", "stuck_on", "loss", "leak", "misalignment"]}
    scenario = type(HEALTHY)("kinds", "kinds", kinds | {"count": [1, 3]})
    best = play(methods["oracle"], scenario, SEEDS, orion).rewards
    for method in methods.values():
        assert (play(method, scenario, SEEDS, orion).rewards <= best + ROUND_OFF).all(), method.key


def test_without_faults_the_blind_mapper_is_the_oracle(methods, orion):
    oracle, blind = (play(methods[key], HEALTHY, SEEDS, orion) for key in ("oracle", "blind"))
    np.testing.assert_array_equal(blind.rewards, oracle.rewards)


@pytest.mark.parametrize("scenario", [FAULTS, DEAD], ids=lambda one: one.name)
def test_who_knows_more_does_better(methods, orion, scenario):
    order = ["oracle", "response_test", "blind", "minimum_norm", "crude", "nothing"]
    scores = [play(methods[key], scenario, SEEDS, orion).scores.mean() for key in order]
    assert all(above > below for above, below in pairwise(scores)), scores


def test_degenerate_policies_score_nothing(methods, orion):
    for scenario in SCENARIOS:
        for key in ("nothing", "random"):
            assert play(methods[key], scenario, SEEDS, orion).scores.max() == 0.0


def test_the_response_test_alarms_as_rarely_as_it_was_told(methods, orion):
    """On healthy seeds that it was not calibrated on: within three standard deviations of the stated rate."""
    test = methods["response_test"]
    play(test, HEALTHY, VALIDATION[:1000], orion)
    alarms = (np.stack(test.statistics, axis=1) > test.test.threshold).any(axis=1).mean()
    assert alarms < FALSE_ALARM_RATE + 3.0 * np.sqrt(FALSE_ALARM_RATE / 1000)


def test_a_method_flies_the_same_episodes_twice(methods, orion):
    for method in methods.values():
        first, second = (play(method, FAULTS, SEEDS[:20], orion).rewards for _ in range(2))
        np.testing.assert_array_equal(first, second)


def test_the_table_has_every_row_and_the_way_runs_from_nothing_to_the_oracle(methods, orion):
    rows = {row.key: row for row in compare([[one] for one in methods.values()], SEEDS[:50], orion)}
    assert list(rows) == ["oracle", "response_test", "blind", "minimum_norm", "crude", "nothing", "random"]
    for scenario in SCENARIOS:
        assert rows["oracle"].cells[scenario.name].way == 1.0
        assert rows["nothing"].cells[scenario.name].way == 0.0
        for row in rows.values():
            cell = row.cells[scenario.name]
            assert cell.low <= cell.score <= cell.high


def test_the_interval_covers_as_often_as_it_says():
    """Means of normal scores: 95 % of 400 intervals, give or take three standard deviations."""
    generator = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        low, high = bootstrap_interval(generator.normal(0.5, 0.1, (1, 60)))
        covered += low <= 0.5 <= high
    assert abs(covered / 400 - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 400) + 0.01


def test_seeds_for_training_validation_and_test_are_disjoint():
    sets = [TRAIN, VALIDATION, TEST]
    assert all(first.stop <= second.start for first, second in pairwise(sets))
    with pytest.raises(ValueError, match="from 0 to 3905 would be right"):
        first_training_seed(3906, worlds=256)
