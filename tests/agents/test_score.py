"""The score that the README states: what `make train` reaches on beliefs, with its own configuration."""

import pytest

import train
from thruster_agents.evaluation import FAULTS, SCENARIOS, classical_methods, compare
from thruster_agents.evaluation.methods import Learned
from thruster_agents.ppo import train as train_policy
from thruster_envs.seeds import TEST

#: Least share of the way from doing nothing to the oracle, and the score with faults; the README names them.
STATED_WAY = {"healthy": 0.995, "faults": 0.98, "dead": 0.97}
STATED_SCORE = 0.655


@pytest.fixture(scope="module")
def rows(orion, tmp_path_factory):
    """The table of the default configuration without PPO on duties: about a minute of one processor."""
    settings = train.Configuration().settings("beliefs", 0, orion)
    trained = train_policy(settings, tmp_path_factory.mktemp("beliefs"))
    learned = Learned(trained.model, "beliefs", "PPO on beliefs")
    methods = [[learned], *([one] for one in classical_methods(orion))]
    return {row.key: row for row in compare(methods, TEST[:500], orion)}


def test_the_trained_policy_reaches_what_is_stated(rows):
    for name, least in STATED_WAY.items():
        assert rows["ppo_beliefs"].cells[name].way > least, name
    assert rows["ppo_beliefs"].cells["faults"].score > STATED_SCORE


def test_the_trained_policy_stands_between_the_blind_mapper_and_the_oracle(rows):
    """With faults: it has learned to diagnose, by more than the width of the interval, and is no oracle."""
    for scenario in SCENARIOS[1:]:
        oracle, learned, blind = (rows[k].cells[scenario.name] for k in ("oracle", "ppo_beliefs", "blind"))
        assert oracle.score > learned.score > blind.score
        assert learned.low > blind.high or scenario is FAULTS
        assert learned.way - blind.way > 0.02
