"""Rendezvous: what the reward pays, what counts as arrived, and what as lost."""

import math

import numpy as np
import pytest

from tests.tasks.flying import actions, begin
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.spacecraft import load
from thruster_envs.tasks import OrionRendezvous
from thruster_envs.tasks.shaping import delta_v_to_go

ORION = load("orion")
N = ORION.mean_motion
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def place(
    batch, position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), attitude=UPRIGHT, rate=(0.0, 0.0, N), step=0
):
    """Put every craft somewhere, at some step of its episode."""
    fleet = batch.fleet
    fleet.write(at.POSITION, [position])
    fleet.write(at.VELOCITY, [velocity])
    fleet.write(at.ATTITUDE, [attitude])
    fleet.write(at.RATE, [rate])
    fleet.write(at.STEP, [[float(step)]])


def coast(batch):
    return batch.step(actions(np.zeros((batch.number, 12))))


def test_it_starts_near_300_m_at_rest_and_upright():
    batch = begin(OrionRendezvous(), worlds=2000)
    position, velocity = batch.fleet.read(at.POSITION, 3)[:, 0], batch.fleet.read(at.VELOCITY, 3)[:, 0]
    away = position - (300.0, 0.0, 0.0)
    for values, reach in ((away, 5.0), (velocity, 0.005)):
        assert np.abs(values).max() <= reach
        np.testing.assert_allclose(values.std(axis=0), reach / np.sqrt(3.0), rtol=0.05)
        assert np.abs(values.mean(axis=0)).max() < 4.0 * reach / np.sqrt(3.0 * 2000)
    attitude = batch.fleet.read(at.ATTITUDE, 4)[:, 0]
    np.testing.assert_allclose(np.linalg.norm(attitude, axis=1), 1.0, atol=1e-14)
    angle = 2.0 * np.arccos(np.clip(attitude[:, 0], -1.0, 1.0))
    assert math.radians(7.0) < angle.max() <= math.radians(5.0) * math.sqrt(3.0) + 1e-9


def test_it_ends_after_half_an_orbit():
    task = OrionRendezvous()
    assert task.steps == round(math.pi / N / 5.0) == 571
    batch = begin(OrionRendezvous(orbits=0.01, faults=[]))
    ends = [bool(coast(batch).terminated[0]) for _ in range(batch.task.steps)]
    assert ends == [False] * (batch.task.steps - 1) + [True]


def test_progress_telescopes():
    batch = begin(OrionRendezvous(faults=[Fault(2, "leak", severity=0.3)]), worlds=3)
    generator = np.random.default_rng(0)
    start, total = batch.state.episode.potential.copy(), np.zeros(3)
    for _ in range(60):
        duties = 0.03 * generator.random((3, 12)) * (generator.random((3, 12)) < 0.1)
        step = batch.step(actions(duties))
        total += step.reward_terms[:, 0, 1]
    np.testing.assert_allclose(total, 5.0 * (batch.state.episode.potential - start), rtol=0.0, atol=1e-12)
    assert np.abs(total).min() > 1e-4


def test_the_potential_falls_from_0_to_minus_1_with_the_delta_v_to_go_over_that_of_the_mission():
    batch = begin(OrionRendezvous(faults=[]))
    reference = delta_v_to_go((300.0, 0.0, 0.0), (0.0, 0.0, 0.0), 571 * 5.0, N)
    place(batch, position=(120.0, -40.0, 7.0), velocity=(0.1, -0.02, 0.01), step=99)
    coast(batch)
    position, velocity = batch.fleet.read(0, 3)[0, 0], batch.fleet.read(3, 3)[0, 0]
    expected = delta_v_to_go(tuple(position), tuple(velocity), (571 - 100) * 5.0, N)
    # The attitude stays upright within rounding, so that nothing is to be paid for it.
    x = expected / reference
    assert batch.state.episode.potential[0] == pytest.approx(-x / (1.0 + x), rel=1e-9)


def test_fuel_is_the_share_of_all_valves_that_were_open():
    batch = begin(OrionRendezvous(faults=[]))
    duties = np.zeros((1, 12))
    duties[0, [0, 5]] = 0.4, 0.2
    step = batch.step(actions(duties))
    assert batch.task.truth(batch.state).fuel[0, 0] == pytest.approx(5.0 * 0.6, rel=1e-12)
    assert step.reward_terms[0, 0, 0] == pytest.approx(-2.0 / 571.0 * 0.6 / 12.0, rel=1e-12)


INSIDE = {"position": (1.9, 0.0, 0.0), "velocity": (0.0, 0.019, 0.0)}


@pytest.mark.parametrize(
    ("state", "arrives"),
    [
        ({}, True),
        ({"position": (1.2, 1.2, 0.9)}, True),
        ({"position": (1.3, 1.3, 1.3)}, False),
        ({"position": (0.0, -2.05, 0.0)}, False),
        ({"velocity": (0.0, 0.0, 0.019)}, True),
        ({"velocity": (0.0, 0.0, 0.021)}, False),
        ({"attitude": (math.cos(0.04), math.sin(0.04), 0.0, 0.0)}, True),
        ({"attitude": (math.cos(0.05), 0.0, -math.sin(0.05), 0.0)}, False),
        ({"attitude": (-1.0, 0.0, 0.0, 0.0)}, True),
        ({"attitude": (0.0, 1.0, 0.0, 0.0)}, False),
        ({"attitude": (0.0, 0.0, 0.0, 1.0)}, False),
        ({"rate": (0.008, 0.0, N)}, True),
        ({"rate": (0.009, 0.0, N)}, False),
    ],
)
def test_the_box_decides_what_has_arrived(state, arrives):
    batch = begin(OrionRendezvous(faults=[]))
    place(batch, step=570, **state)
    step = coast(batch)
    assert step.terminated[0]
    assert step.reward_terms[0, 0, 2] == (5.0 if arrives else 0.0)  # without any fuel
    truth = batch.task.truth(batch.state)
    assert truth.success[0, 0] == arrives
    assert (truth.score[0, 0] > 0.5) == arrives
    if arrives:
        assert truth.score[0, 0] == 1.0  # without any fuel


def test_to_be_in_the_box_too_early_pays_nothing():
    batch = begin(OrionRendezvous(faults=[]))
    place(batch, step=100)
    step = coast(batch)
    assert not step.terminated[0]
    assert step.reward_terms[0, 0, 2] == 0.0


@pytest.mark.parametrize(
    "state", [{"position": (0.0, 2001.0, 0.0)}, {"rate": (0.0, 1.01, N)}], ids=["too far", "too fast"]
)
def test_out_of_bounds_ends_the_episode_as_a_failure(state):
    batch = begin(OrionRendezvous(faults=[]))
    place(batch, step=10, **state)
    step = coast(batch)
    assert step.terminated[0]
    assert step.reward_terms[0, 0, 2] == 0.0
    assert step.reward_terms[0, 0, 3] == pytest.approx(-5.0 - 2.0 * 560.0 / 571.0, rel=1e-12)
    truth = batch.task.truth(batch.state)
    assert truth.score[0, 0] == 0.0
    assert not truth.success[0, 0]


def test_the_cost_is_the_rate_above_its_soft_limit():
    batch = begin(OrionRendezvous(faults=[]))
    for rate, expected in ((0.05, 0.0), (0.25, 1.5), (0.1, 0.0)):
        place(batch, position=(100.0, 0.0, 0.0), rate=(0.0, 0.0, N + rate), step=5)
        assert coast(batch).cost[0, 0] == pytest.approx(expected, abs=1e-9)


def test_economy_is_worth_half_of_the_score():
    batch = begin(OrionRendezvous(faults=[]))
    reference = delta_v_to_go((300.0, 0.0, 0.0), (0.0, 0.0, 0.0), 571 * 5.0, N)
    thrust = np.mean([thruster.thrust for thruster in ORION.thrusters])
    place(batch, step=570)
    batch.fleet.write(at.OPEN_TIME, [[4.0 * reference * ORION.mass / thrust]])
    coast(batch)
    assert batch.task.truth(batch.state).score[0, 0] == pytest.approx(0.5 + 0.5 / 4.0, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": (3000.0, 0.0, 0.0)}, "within 2000 m"),
        ({"start": (1.0, 2.0)}, "start has 2 entries; 3"),
        ({"orbits": 0.0}, "orbits is 0.0"),
        ({"position_tolerance": math.nan}, "position_tolerance is NaN"),
    ],
)
def test_a_bad_configuration_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        OrionRendezvous(**arguments)
