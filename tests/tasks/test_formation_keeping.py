"""Formation keeping: slots are a natural motion, the scripted pilot keeps them, and all pay for the fuel."""

import numpy as np
import pytest

from tests.tasks.flying import begin
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.pilots.slots import SlotPilot
from thruster_envs.spacecraft import load
from thruster_envs.tasks import FormationKeeping

ORION = load("orion")
N = ORION.mean_motion


def put_on_slots(batch):
    batch.fleet.write(at.POSITION, batch.state.slots[..., :3])
    batch.fleet.write(at.VELOCITY, batch.state.slots[..., 3:])


def by_pilot(batch, craft=None):
    """Actions of the suite's own pilot for the commanded craft, from what these measure."""
    agents = len(batch.task.agents)
    scratch = batch.fleet.data.copy()
    batch.state.model.pilot.fly(scratch, batch.state.slots, 0, batch.task.craft, batch.number)
    rows = scratch[:, at.DUTIES : at.DUTIES + 12].transpose(0, 2, 1).reshape(-1, 12)
    duties = rows[: batch.number * batch.task.craft].reshape(batch.number, batch.task.craft, 12)[:, :agents]
    return 2.0 * duties - 1.0


def nothing(batch):
    return np.full((batch.number, len(batch.task.agents), 12), -1.0)


@pytest.mark.parametrize("craft", [2, 3, 8])
def test_slots_are_solutions_of_hills_equations_evenly_apart(craft):
    batch = begin(FormationKeeping(craft=craft, faults=[]), worlds=2)
    put_on_slots(batch)
    for _ in range(120):
        slots = batch.state.slots
        np.testing.assert_allclose(np.linalg.norm(slots[..., :3], axis=-1), 50.0, rtol=1e-12)
        apart = np.linalg.norm(slots[:, 1:, :3] - slots[:, :-1, :3], axis=-1)
        np.testing.assert_allclose(apart, 100.0 * np.sin(np.pi / craft), rtol=1e-12)
        # The condition of no drift along the track.
        np.testing.assert_allclose(slots[..., 4], -2.0 * N * slots[..., 0], rtol=0.0, atol=1e-15)
        batch.step(nothing(batch))
    np.testing.assert_allclose(
        batch.fleet.read(at.POSITION, 3), batch.state.slots[..., :3], rtol=0.0, atol=1e-7
    )
    np.testing.assert_allclose(
        batch.fleet.read(at.VELOCITY, 3), batch.state.slots[..., 3:], rtol=0.0, atol=1e-10
    )


def test_craft_start_near_their_slots_at_any_phase():
    batch = begin(FormationKeeping(faults=[]), worlds=1000)
    away = batch.fleet.read(at.POSITION, 3) - batch.state.slots[..., :3]
    assert np.abs(away).max() <= 1.5
    np.testing.assert_allclose(away.reshape(-1, 3).std(axis=0), 1.5 / np.sqrt(3.0), rtol=0.05)
    correlation = np.corrcoef(away[:, 0, 0], away[:, 1, 0])[0, 1]
    assert abs(correlation) < 4.0 / np.sqrt(1000)
    histogram, _ = np.histogram(batch.state.phase, bins=8, range=(0.0, 2.0 * np.pi))
    assert abs(histogram - 125).max() < 4.0 * np.sqrt(125)


def test_the_pilot_keeps_a_healthy_formation():
    """The heuristic that proves the task: a score of 0.9 without learning, and success for nearly all."""
    batch = begin(FormationKeeping(faults=[]), worlds=100, seed=1000)
    for _ in range(120):
        step = batch.step(by_pilot(batch))
        assert not step.terminated.any()
    truth = batch.task.truth(batch.state)
    assert truth.score.mean() >= 0.9
    assert truth.success.mean() >= 0.98
    assert truth.fuel.mean() <= 50.0  # thruster-seconds of the 7,200 there are
    idle = begin(FormationKeeping(faults=[]), worlds=100, seed=1000)
    for _ in range(120):
        idle.step(nothing(idle))
    assert idle.task.truth(idle.state).score.mean() <= 0.2


def test_craft_that_nobody_commands_fly_as_the_pilot_would():
    faults = [Fault(3, "leak", severity=0.05, craft=2)]
    alone = begin(FormationKeeping(commanded=1, faults=faults), worlds=5)
    together = begin(FormationKeeping(faults=faults), worlds=5)
    generator = np.random.default_rng(0)
    for _ in range(30):
        actions = by_pilot(together)
        actions[:, 0] = generator.uniform(-1.0, -0.8, (5, 12))
        one, all_of_them = alone.step(actions[:, :1]), together.step(actions)
        # Duties that went through an action have been rounded once more; the flight amplifies that a little.
        np.testing.assert_allclose(one.rewards[:, 0], all_of_them.rewards[:, 0], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(alone.fleet.data, together.fleet.data, rtol=0.0, atol=1e-8)


def test_a_dead_thruster_makes_itself_felt_under_the_pilot():
    scores = {}
    for name, faults in (("healthy", []), ("faulty", [Fault(3, "stuck_on", severity=0.3)])):
        batch = begin(FormationKeeping(faults=faults), worlds=30)
        for _ in range(120):
            batch.step(by_pilot(batch))
        scores[name] = batch.task.truth(batch.state).score[:, 0].mean()
    assert scores["faulty"] < scores["healthy"] - 0.1


def test_all_craft_pay_the_same_share_of_the_fuel_bill():
    batch = begin(FormationKeeping(fuel_price=3.0, faults=[]))
    actions = nothing(batch)
    actions[0, 1, 4] = 0.0  # half a period of one thruster of one craft
    step = batch.step(actions)
    saved = 3.0 * (1.0 - 0.5 / 12.0 / 3.0)
    np.testing.assert_allclose(step.reward_terms[0, :, 2], [5.0 / 120.0 * saved] * 3, rtol=1e-12)
    np.testing.assert_allclose(batch.task.truth(batch.state).fuel[0], [0.0, 2.5, 0.0], rtol=1e-12)
    assert batch.observe()[0, :, 36].tolist() == [-1.0, 2.0, -1.0]


def test_the_reward_is_for_the_place_and_the_attitude():
    batch = begin(FormationKeeping(faults=[]))
    put_on_slots(batch)
    batch.fleet.write(at.RATE, [[[0.0, 0.0, N]]])
    batch.fleet.write(at.ATTITUDE, [[[1.0, 0.0, 0.0, 0.0]]])
    away = batch.state.slots[..., :3].copy()
    away[0, 1] += (3.0, 0.0, 0.0)
    away[0, 2] += (0.0, 0.0, 30.0)
    batch.fleet.write(at.POSITION, away)
    batch.fleet.write(
        at.ATTITUDE, [[[1.0, 0.0, 0.0, 0.0], [np.cos(0.1), np.sin(0.1), 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]]
    )
    batch.fleet.write(at.RATE, [[[0.0, 0.0, N], [0.0, 0.0, N], [0.0, 0.0, -N]]])
    step = batch.step(nothing(batch))
    tracking, attitude, fuel, lost = step.reward_terms[0].T
    np.testing.assert_allclose(tracking, 5.0 / 120.0 / np.array([1.0, 4.0, 31.0]), rtol=0.01)
    angles = np.array([0.0, 2.0 * np.sin(0.1), 2.0])
    np.testing.assert_allclose(attitude, 2.5 / 120.0 / (1.0 + angles / 0.1), rtol=0.02)
    np.testing.assert_allclose(fuel, 2.5 / 120.0, rtol=1e-12)
    assert not lost.any()


def test_the_loss_of_a_craft_costs_every_agent_a_whole_episode():
    batch = begin(FormationKeeping(rate_limit=0.01))
    turning = batch.fleet.read(at.RATE, 3)
    turning[0, 2] += (0.0, 0.02, 0.0)
    batch.fleet.write(at.RATE, turning)
    step = batch.step(nothing(batch))
    assert step.terminated[0]
    np.testing.assert_allclose(step.reward_terms[0, :, 3], -5.0 * (1.0 + 0.5 + 0.5), rtol=1e-12)


def test_a_near_miss_costs_both_and_rules_success_out():
    batch = begin(FormationKeeping(faults=[]))
    put_on_slots(batch)
    places = batch.state.slots[..., :3].copy()
    places[0, 1] = places[0, 0] + (0.0, 4.0, 0.0)
    batch.fleet.write(at.POSITION, places)
    batch.fleet.write(at.VELOCITY, batch.state.slots[:, :1, 3:])
    step = batch.step(nothing(batch))
    np.testing.assert_allclose(step.cost[0], [0.6, 0.6, 0.0], atol=1e-3)
    assert not step.terminated[0]
    put_on_slots(batch)
    for _ in range(30):
        step = batch.step(by_pilot(batch))
    assert not step.cost.any()
    truth = batch.task.truth(batch.state)
    assert truth.score[0, 0] >= 0.9
    assert truth.success[0].tolist() == [False, False, truth.score[0, 2] >= 0.8]


def test_a_craft_that_is_lost_ends_the_episode():
    batch = begin(FormationKeeping(faults=[]), worlds=2)
    places = batch.state.slots[..., :3].copy()
    places[1, 2, 1] += 101.0
    batch.fleet.write(at.POSITION, places)
    assert batch.step(nothing(batch)).terminated.tolist() == [False, True]
    assert not batch.task.truth(batch.state).success[1].any()


def test_the_pilots_map_gives_the_rate_change_that_it_is_asked_for():
    for vehicle in (ORION, load("spheres")):
        pilot = SlotPilot.of(vehicle)
        np.testing.assert_allclose(vehicle.effectiveness() @ pilot.inverse, np.eye(6), atol=1e-9)
        assert np.abs(vehicle.effectiveness() @ pilot.null).max() < 1e-12
        assert pilot.null.min() >= 0.0


def test_the_pilot_holds_spheres_as_well_as_its_minimum_pulse_allows():
    """Below a minimum pulse nothing is fired: the craft drifts until what is asked for exceeds it."""
    batch = begin(FormationKeeping(spacecraft="spheres", faults=[]), worlds=10)
    for _ in range(400):
        batch.step(by_pilot(batch))
        assert not batch.state.over.any()
    away = np.linalg.norm(batch.fleet.read(at.POSITION, 3) - batch.state.slots[..., :3], axis=-1)
    assert away.max() < 2.5  # an error of 0.6 m on one axis asks for one minimum pulse of one thruster
