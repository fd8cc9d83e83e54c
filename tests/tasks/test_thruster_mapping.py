"""Thrust mapping: the commands, the rate changes and the objective are what the page says."""

import numpy as np
import pytest

from tests.tasks.flying import actions, begin
from thruster_baselines.mapping import LPMapper
from thruster_envs.faults import Fault
from thruster_envs.spacecraft import load, objective_weights
from thruster_envs.tasks import ThrusterMapping

ORION = load("orion")
PERIOD = ORION.control_period
FUEL_COST, SLACK_COST = objective_weights(ORION.effectiveness(), PERIOD)
SCALE = SLACK_COST @ ORION.authority()

STEADY = [
    [],
    [Fault(3, "stuck_off")],
    [Fault(3, "stuck_off", severity=0.4)],
    [Fault(7, "stuck_on", severity=0.6)],
    [Fault(7, "loss", severity=0.3)],
    [Fault(1, "leak", severity=0.2)],
    [Fault(12, "misalignment", severity=0.7, azimuth=2.0)],
    [Fault(5, "intermittent", severity=1.0, profile_time=40.0, dwell=0.5)],
    [Fault(2, "loss", severity=0.5, onset=20.0, duration=40.0)],
    [Fault(4, "leak", severity=0.3), Fault(4, "loss", severity=0.5), Fault(4, "misalignment", severity=0.2)],
    [Fault(6, "stuck_on", severity=0.5), Fault(6, "stuck_off", severity=0.5), Fault(9, "stuck_off")],
]


@pytest.mark.parametrize(
    "faults", STEADY, ids=lambda faults: "+".join(fault.kind for fault in faults) or "none"
)
def test_the_reward_is_the_objective_as_the_true_vehicle_delivers_it(faults):
    batch = begin(ThrusterMapping(faults=faults), worlds=7)
    generator = np.random.default_rng(0)
    for _ in range(32):
        command = batch.state.command.copy()
        effectiveness, offset = batch.task.true_model(batch.state)
        duties = generator.random((7, 12)) * (generator.random((7, 12)) < 0.7)
        step = batch.step(actions(duties))
        on_times = PERIOD * duties
        delivered = np.einsum("wkn,wn->wk", effectiveness, on_times) + offset
        objective = on_times @ FUEL_COST + np.abs(command - delivered) @ SLACK_COST
        np.testing.assert_allclose(step.rewards[:, 0], -objective / SCALE, rtol=1e-10)
        np.testing.assert_allclose(step.reward_terms[:, 0, 1], -on_times @ FUEL_COST / SCALE, rtol=1e-12)
        np.testing.assert_allclose(batch.state.delivered, delivered, rtol=0.0, atol=1e-12)


def test_a_healthy_vehicle_is_the_nominal_one():
    batch = begin(ThrusterMapping(faults=[]))
    effectiveness, offset = batch.task.true_model(batch.state)
    np.testing.assert_allclose(effectiveness[0], ORION.effectiveness(), rtol=1e-12, atol=1e-15)
    assert not offset.any()
    batch.step(np.full((1, 1, 12), 0.2))
    np.testing.assert_allclose(batch.state.delivered, batch.state.expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("faults", [[], [Fault(3, "stuck_off")], [Fault(8, "leak", severity=0.2)]])
def test_nobody_beats_the_linear_program_that_knows_the_fault(faults):
    batch = begin(ThrusterMapping(faults=faults), worlds=50)
    others = begin(ThrusterMapping(faults=faults), worlds=50)
    mapper = LPMapper(ORION)
    generator = np.random.default_rng(1)
    for _ in range(10):
        effectiveness, offset = batch.task.true_model(batch.state)
        best = mapper(batch.state.command - offset, effectiveness=effectiveness).on_times
        noisy = np.clip(best / PERIOD + 0.05 * generator.standard_normal(best.shape), 0.0, 1.0)
        ceiling, below = batch.step(actions(best / PERIOD)), others.step(actions(noisy))
        assert (ceiling.rewards >= below.rewards - 1e-12).all()
    assert batch.task.truth(batch.state).score.mean() > others.task.truth(others.state).score.mean()


def test_the_score_is_one_minus_the_objective_over_that_of_doing_nothing():
    batch = begin(ThrusterMapping(), worlds=20)
    generator = np.random.default_rng(2)
    objective, idle = np.zeros(20), np.zeros(20)
    for _ in range(32):
        idle += np.abs(batch.state.command) @ SLACK_COST
        duties = 0.1 * generator.random((20, 12))
        objective -= SCALE * batch.step(actions(duties)).rewards[:, 0]
        score = batch.task.truth(batch.state).score[:, 0]
        np.testing.assert_allclose(score, np.clip(1.0 - objective / idle, 0.0, 1.0), rtol=1e-9, atol=1e-12)
    doing_nothing = begin(ThrusterMapping(faults=[]), worlds=5)
    for _ in range(32):
        doing_nothing.step(actions(np.zeros((5, 12))))
    assert not doing_nothing.task.truth(doing_nothing.state).score.any()


def test_commands_come_in_four_kinds_equally_often():
    batch = begin(ThrusterMapping(), worlds=500)
    drawn = []
    for _ in range(20):
        drawn.append(batch.state.command / ORION.authority())
        batch.step(actions(np.zeros((500, 12))))
    shares = np.concatenate(drawn)
    active, largest = np.count_nonzero(shares, axis=1), np.abs(shares).max(axis=1)
    assert set(active) == {1, 6}
    assert largest.max() <= 1.5
    single = active == 1
    assert np.abs(shares[single]).max() <= 1.0
    # 10,000 commands: a quarter of each kind, within four standard deviations of a binomial.
    tolerance = 4.0 * np.sqrt(0.25 * 0.75 / 10_000)
    assert single.mean() == pytest.approx(0.25, abs=tolerance)
    assert ((largest <= 0.02) & ~single).mean() == pytest.approx(0.25, abs=tolerance)
    # Six uniform numbers of reach 1.5 are all below 0.3 once in 15,625 times.
    assert ((largest <= 0.3) & ~single).mean() == pytest.approx(0.5, abs=1.5 * tolerance)
    axis, sign = np.abs(shares[single]).argmax(axis=1), np.sign(shares[single].sum(axis=1))
    assert np.bincount(axis) / single.sum() == pytest.approx(np.full(6, 1 / 6), abs=0.03)
    assert abs(sign.mean()) < 4.0 / np.sqrt(single.sum())
    coupled = shares[(largest > 0.02) & (largest <= 0.3) & ~single]
    correlation = np.corrcoef(coupled.T) - np.eye(6)
    assert np.abs(correlation).max() < 4.0 / np.sqrt(len(coupled))


def test_the_measured_rate_change_is_the_delivered_one_with_the_noise_of_two_measurements():
    batch = begin(ThrusterMapping(faults=[]), worlds=2000)
    noise = []
    for _ in range(5):
        batch.step(actions(np.zeros((2000, 12))))
        noise.append(batch.state.measured - batch.state.delivered)
    sigma = np.concatenate(noise).std(axis=0)
    expected = np.sqrt(2.0) * np.repeat([ORION.sensors.velocity, ORION.sensors.rate], 3)
    np.testing.assert_allclose(sigma, expected, rtol=4.0 / np.sqrt(20_000))


def test_the_projection_reads_off_which_thruster_fired():
    batch = begin(ThrusterMapping(faults=[]))
    for i in range(12):
        duties = np.zeros((1, 12))
        duties[0, i] = 0.5
        observation = batch.step(actions(duties)).observations[0, 0]
        along_expected = observation[-12:]
        assert along_expected[i] == pytest.approx(0.5, abs=1e-6)
        assert along_expected.argmax() == i


def test_faults_are_drawn_by_default_and_may_be_switched_off():
    batch = begin(ThrusterMapping(), worlds=1000)
    kinds = batch.info()["fault"]["kind"][:, 0, 0]
    assert np.count_nonzero(kinds) / 1000 == pytest.approx(0.8, abs=4.0 * np.sqrt(0.16 / 1000))
    assert set(kinds) == {0, 1, 3}
    assert not begin(ThrusterMapping(faults=[]), worlds=100).info()["fault"]["kind"].any()


def test_the_craft_stays_where_it_is():
    batch = begin(ThrusterMapping(faults=[Fault(3, "stuck_on")]))
    before = batch.fleet.read(0, 14)
    batch.step(np.ones((1, 1, 12)))
    assert np.array_equal(batch.fleet.read(0, 14), before)
