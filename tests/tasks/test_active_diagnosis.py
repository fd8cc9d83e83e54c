"""Diagnosis with test pulses: fired as far as the budget goes, they find what a quiet flight hides."""

import numpy as np
import pytest

from tests.tasks.diagnosing import LikelihoodPlayer
from tests.tasks.flying import begin
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.tasks import ActiveDiagnosis
from thruster_envs.tasks.fault_diagnosis import FLIGHT

PERIOD = 5.0


def choose(worlds, tests=0, declared=(0, 0)):
    """Actions (worlds, 1, 14): one declaration, and ``tests`` (12,) for all worlds."""
    actions = np.zeros((worlds, 1, 14), np.int64)
    actions[..., :2], actions[..., 2:] = declared, tests
    return actions


def duties(batch):
    return batch.fleet.read(at.DUTIES, 12)[:, 0]


def play(schedule, worlds=100, seed=1000):
    """Mean score and return of the classical player with a schedule of tests: number of the step to (12,)."""
    batch, player = begin(ActiveDiagnosis(), worlds=worlds, seed=seed), LikelihoodPlayer(worlds)
    observations, returned = batch.observe()[:, 0], 0.0
    for number in range(FLIGHT):
        actions = choose(worlds, schedule(number))
        actions[:, 0, :2] = player(observations)
        step = batch.step(actions)
        observations = step.observations[:, 0]
        returned += step.rewards.mean()
    return batch.task.truth(batch.state).score.mean(), returned


def test_a_sweep_of_test_pulses_finds_what_a_quiet_flight_hides():
    score, returned = play(lambda number: np.arange(12) == number % 12)
    untested, cheaper = play(lambda _: np.zeros(12))
    assert score >= 0.82
    assert untested <= 0.7
    assert returned > cheaper + 0.05  # the tests are worth their fuel


@pytest.mark.parametrize("tests", ["none", "all", "random"])
def test_testing_without_looking_gets_little(tests):
    batch, generator = begin(ActiveDiagnosis(), worlds=150, seed=1000), np.random.default_rng(0)
    for _ in range(FLIGHT):
        actions = choose(150, 2 if tests == "all" else 0)
        if tests == "random":
            actions[:, 0] = generator.integers(0, batch.task.choices, (150, 14))
        batch.step(actions)
    truth = batch.task.truth(batch.state)
    assert truth.score.mean() <= 0.3


def test_test_pulses_are_added_to_the_pilots_duties():
    tested, twin = (begin(ActiveDiagnosis(), worlds=20) for _ in range(2))
    tests = np.arange(12) % 3
    twin.step(choose(20))
    step = tested.step(choose(20, tests))
    expected = np.minimum(duties(twin) + np.array((0.0, 0.1, 0.4))[tests], 1.0)
    np.testing.assert_allclose(duties(tested), expected, rtol=0.0, atol=1e-15)
    fired = PERIOD * (expected - duties(twin)).sum(axis=1)
    told = tested.info(step)
    np.testing.assert_allclose(told["diagnosis"]["tested"][:, 0], fired, rtol=1e-12)
    np.testing.assert_allclose(told["reward_terms"]["fuel"][:, 0], -0.5 * fired / 60.0, rtol=1e-12)
    left = step.observations[:, 0, -1]
    np.testing.assert_allclose(left, 1.0 - fired / 60.0, rtol=1e-6)


def test_what_is_over_the_budget_is_not_fired():
    batch = begin(ActiveDiagnosis(faults=[], budget=7.0, pilot=lambda sight: 0.0 * sight.duties))
    fired, paid = [], 0.0
    for _ in range(3):
        step = batch.step(choose(1, 2))
        fired.append(PERIOD * duties(batch)[0])
        paid += step.reward_terms[0, 0, 5]
    np.testing.assert_allclose(fired[0], 3 * [2.0] + [1.0] + 8 * [0.0], rtol=0.0, atol=1e-14)
    assert not np.concatenate(fired[1:]).any()
    assert paid == pytest.approx(-0.5, abs=1e-15)
    assert step.observations[0, 0, -1] == 0.0
    assert batch.info()["diagnosis"]["tested"].item() == 7.0


def test_a_duty_that_is_full_already_takes_no_test():
    batch = begin(
        ActiveDiagnosis(faults=[], test_duties=(1.0,), pilot=lambda sight: 0.75 + 0.0 * sight.duties)
    )
    batch.step(choose(1, np.arange(12) < 2))
    assert duties(batch)[0].tolist() == 2 * [1.0] + 10 * [0.75]
    assert batch.info()["diagnosis"]["tested"].item() == 2.5


def test_cost_counts_a_craft_that_turns_too_fast():
    batch = begin(ActiveDiagnosis(faults=[], pilot=lambda sight: 0.0 * sight.duties), worlds=1)
    costs, rates = [], []
    for _ in range(4):
        step = batch.step(choose(1, 2 * (np.arange(12) == 0)))
        rate = batch.fleet.read(at.RATE, 3)[0, 0]
        costs.append(step.cost.item())
        rates.append(np.linalg.norm(rate))
    # The rate against LVLH differs by the mean motion, 0.0011 rad/s, at most.
    np.testing.assert_allclose(costs, np.maximum(np.array(rates) / 0.1 - 1.0, 0.0), atol=0.012)
    assert costs[-1] > 0.5


def test_a_lost_flight_costs_more_than_any_other_and_is_no_success():
    """Whatever was declared: else it would pay to be lost as long as no fault has come."""
    batch = begin(ActiveDiagnosis(faults=[]))
    for _ in range(10):
        batch.step(choose(1))
    batch.fleet.write(at.RATE, np.array((1.5, 0.0, 0.0)))
    step = batch.step(choose(1))
    assert step.terminated.all()
    left = (FLIGHT - 11) / FLIGHT
    assert step.rewards.item() == pytest.approx(-(5.0 + 5.0 + 0.5) - 5.0 * left, rel=1e-12)
    truth = batch.task.truth(batch.state)
    assert truth.score.item() == 0.0
    assert not truth.success.any()


def test_a_quiet_flight_hardly_fires_and_an_oracle_needs_no_test():
    batch = begin(ActiveDiagnosis(faults=[]), worlds=100)
    for _ in range(FLIGHT):
        step = batch.step(choose(100))
        assert not step.rewards.any()
    assert batch.task.truth(batch.state).fuel.mean() < 60.0  # thruster-seconds of 7,200


def test_a_dead_thruster_that_is_tested_shows():
    batch = begin(
        ActiveDiagnosis(faults=[Fault(2, "stuck_off")], pilot=lambda sight: 0.0 * sight.duties), worlds=50
    )
    step = batch.step(choose(50, 2 * (np.arange(12) == 1)))
    along = step.observations[:, 0, 25 + 12 + 1]
    assert (along < -0.3).all()  # of 0.4 periods


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"test_duties": ()}, r"test_duties is \(\)"),
        ({"test_duties": (0.5, 1.5)}, "test_duties"),
        ({"budget": 0.0}, "budget is 0.0; a finite number above 0"),
        ({"fuel_cost": -1.0}, "fuel_cost is -1.0"),
    ],
)
def test_a_bad_argument_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ActiveDiagnosis(**arguments)
