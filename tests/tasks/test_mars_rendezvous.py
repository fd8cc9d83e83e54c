"""The approach about Mars: what the chaser sees, what it may close, how an approach ends, and the pilot."""

import dataclasses
import math

import gymnasium as gym
import numpy as np
import pytest
from numba import njit

from tests.baselines import chaser_flight
from tests.physics.closed_forms import product
from tests.tasks.flying import begin
from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.physics import disturbances
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.pilots.approach import FACING, ApproachPilot
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load
from thruster_envs.tasks import MarsRendezvous
from thruster_envs.views.worlds import Worlds

CHASER = load("msr_chaser")
N = CHASER.mean_motion
#: Body rate of a chaser that turns with LVLH in the attitude of the approach: -n about the body's y axis.
WITH_LVLH = (0.0, -N, 0.0)
EXACT_VEHICLE = {
    "mass_error": 0.0, "inertia_error": 0.0, "thrust_error": 0.0, "centre_of_mass_error": 0.0,
}  # fmt: skip


def piloted(batch, steps=None):
    """Fly the scripted pilot until every world has ended once; returns (worlds,) info at those ends."""
    done = np.zeros(batch.number, np.bool_)
    ended = {}
    for _ in range(steps or batch.task.steps):
        step = batch.step(batch.task.pilot_actions(batch.state))
        fresh = step.terminated & ~done
        if fresh.any():
            truth, report = batch.task.truth(batch.state), batch.task.report(batch.state)["approach"]
            for world in np.flatnonzero(fresh):
                ended[int(world)] = (
                    bool(truth.success[world, 0]), bool(report["safe"][world, 0]), truth.score[world, 0]
                )  # fmt: skip
        done |= fresh
        if done.all():
            break
    return [ended.get(world) for world in range(batch.number)]


def test_the_pilot_captures_in_99_of_100_healthy_validation_flights():
    batch = Worlds(MarsRendezvous(), 100)
    everyone = np.arange(100)
    batch.seed(everyone, list(VALIDATION[:100]))
    batch.reset(everyone)
    ends = piloted(batch)
    assert sum(success for success, _, _ in ends) >= 99
    assert np.mean([score for _, _, score in ends]) > 0.95


def test_it_captures_from_130_m_too():
    batch = begin(MarsRendezvous(distance=130.0), worlds=6)
    assert batch.task.steps == 19500
    assert all(success for success, _, _ in piloted(batch))


def unaccommodated(thruster, worlds):
    """Components of the attitude error, degrees, and position errors, m, after 60 s stuck open."""
    fault = Fault(thruster, "stuck_on", onset=60.0, duration=60.0)
    batch = begin(MarsRendezvous(faults=fault, **EXACT_VEHICLE), worlds=worlds)
    piloted(batch, 1200)
    q = np.array([product(one, chaser_conjugate()) for one in batch.fleet.read(at.ATTITUDE, 4)[:, 0]])
    reference = batch.state.model.pilot.reference(120.0)[0]
    away = batch.fleet.read(at.POSITION, 3)[:, 0] - (0.0, reference, 0.0)
    return np.degrees(2.0 * np.abs(q[:, 1:])), np.abs(away)


def chaser_conjugate():
    return np.array(FACING) * (1.0, -1.0, -1.0, -1.0)


@pytest.mark.parametrize("thruster", range(1, 9))
def test_a_thruster_left_stuck_open_for_a_minute_turns_and_shifts_the_chaser(thruster):
    """The specification has 37 to 41 degrees and 1.2 to 2.7 m per axis; delays spread both.

    The plain simulation, too, reaches 2.9 m.
    """
    turned, away = unaccommodated(thruster, worlds=24)
    assert 37.0 < turned.max(axis=1).mean() < 41.0
    assert np.all((away > 1.1) & (away < 3.1))
    fault = chaser_flight.ValveFault(thruster, "stuck_on", 1.0, 60.0)
    plain = chaser_flight.fly(range(24), 120.1, [fault] * 24)
    expected = plain.true_position[:, -1] - (0.0, -8.0, 0.0)
    np.testing.assert_allclose(away.mean(axis=0), np.abs(expected).mean(axis=0), atol=0.3)
    # One sigma is 2 to 3 degrees, of the means of 24 about 0.6; the filters are driven differently.
    angles = np.degrees(2.0 * np.arcsin(np.radians(0.5 * np.linalg.norm(turned, axis=1))))
    assert angles.mean() == pytest.approx(np.degrees(plain.pointing[:, -1]).mean(), abs=3.0)


@pytest.mark.parametrize(
    "fault",
    [
        chaser_flight.ValveFault(),
        chaser_flight.ValveFault(3, "stuck_on", 1.0, 15.03),
        chaser_flight.ValveFault(6, "stuck_on", 0.0, 15.0),
        chaser_flight.ValveFault(2, "loss", 0.5, 10.0),
    ],
    ids=lambda fault: fault.kind,
)
def test_the_plant_flies_like_the_plain_simulation_under_the_same_open_rates(fault):
    """Open loop for 20 s, without noise and with the nominal delay: its steps of 10 ms are the difference."""
    settings = chaser_flight.Settings(lidar=0.0, attitude=0.0, rate=0.0, delay_variation=0.0)
    plain = chaser_flight.fly([0], 20.1, [fault], settings)
    vehicle = CHASER.replace(modulator={"delay": 0.1})
    fleet = Fleet(vehicle, 1, nonlinear=True)
    faults = (
        []
        if fault.kind == "none"
        else [Fault(fault.thruster, fault.kind, severity=fault.severity, onset=fault.onset)]
    )
    fleet.begin(fleet.everyone, np.zeros((1, 2), np.uint64), np.zeros(1, np.uint64), fleet.plan(faults))
    fleet.write(0, [[0.0, -20.0, 0.0, 0.0, 0.1, 0.0, *FACING, *WITH_LVLH]])
    fleet.write(fleet.rows.push, [[-3e-7, 2e-7, -1e-7]])
    for k in range(200):
        fleet.write(fleet.rows.duties, plain.open_rates[0, k])
        fleet.fly()
    state = fleet.read(0, 10)[0, 0]
    np.testing.assert_allclose(state[:3], plain.true_position[0, 200], atol=2e-3)
    np.testing.assert_allclose(state[3:6], plain.true_velocity[0, 200], atol=3e-4)
    angle = 2.0 * math.acos(min(1.0, abs(product(state[6:10], chaser_conjugate())[0])))
    assert angle == pytest.approx(plain.pointing[0, 200], abs=2e-3)


def test_what_is_observed_is_one_period_old():
    batch = begin(MarsRendezvous(distance=20.0), worlds=5)
    observed, measured = [], [batch.fleet.read(at.MEASURED, 3)[:, 0]]
    for _ in range(6):
        observed.append(batch.step(batch.task.pilot_actions(batch.state)).observations[:, 0])
        measured.append(batch.fleet.read(at.MEASURED, 3)[:, 0])
    for seen, before in zip(observed, measured[:-1], strict=True):
        np.testing.assert_allclose(20.0 * seen[:, :3], before, rtol=1e-5, atol=1e-7)


def test_without_navigation_delay_it_is_what_was_measured_last():
    batch = begin(MarsRendezvous(navigation_delay=0), worlds=3)
    seen = batch.step(batch.task.pilot_actions(batch.state)).observations[:, 0, 3:6]
    np.testing.assert_array_equal(
        seen, np.clip(batch.fleet.read(at.MEASURED, 3)[:, 0], -5.0, 5.0).astype(np.float32)
    )


def test_the_filtered_velocity_is_good_to_half_a_millimetre_per_second():
    batch = begin(MarsRendezvous(), worlds=60)
    errors = []
    for k in range(500):
        before = batch.fleet.read(at.VELOCITY, 3)[:, 0]
        batch.step(batch.task.pilot_actions(batch.state))
        if k >= 200:
            errors.append(batch.state.estimate[:, 3:] - before)
    spread = np.std(errors, axis=(0, 1))
    assert np.all(np.abs(np.mean(errors, axis=(0, 1))) < 1e-4)
    # White noise through the filter makes 0.41 mm/s; unknown delays and thrusts add a little.
    assert np.all((spread > 3.5e-4) & (spread < 6e-4))


@njit
def _disturb(r, latitude, sun, numbers):
    return disturbances.disturb(r, latitude, sun, numbers)


def oblate_gravity(position, setting):
    """Acceleration by J2, inertial axes with z the pole: gradient of the potential in closed form."""
    r = np.linalg.norm(position)
    factor = -1.5 * setting.oblateness * CHASER.gravitational_parameter * setting.equatorial_radius**2 / r**5
    z = 5.0 * position[2] ** 2 / r**2
    return factor * position * np.array([1.0 - z, 1.0 - z, 3.0 - z])


@pytest.mark.parametrize("latitude", [0.0, 0.13, 0.41, 0.77])
def test_differential_gravity_is_the_gradient_of_the_oblate_field(latitude):
    setting = disturbances.Disturbances(area=0.0, inclination=0.7)
    radius = (CHASER.gravitational_parameter / N**2) ** (1.0 / 3.0)
    u, i = 2.0 * math.pi * latitude, setting.inclination
    radial = np.array([math.cos(u), math.sin(u) * math.cos(i), math.sin(u) * math.sin(i)])
    along = np.array([-math.sin(u), math.cos(u) * math.cos(i), math.cos(u) * math.sin(i)])
    axes = np.array([radial, along, np.cross(radial, along)])
    r = np.array([13.0, -20.0, 8.0])
    difference = oblate_gravity(radius * radial + 0.5 * r @ axes, setting) - oblate_gravity(
        radius * radial - 0.5 * r @ axes, setting
    )
    given = _disturb(tuple(r), latitude, 0.0, setting.numbers(CHASER))
    np.testing.assert_allclose(given, axes @ difference, rtol=1e-6, atol=1e-14)


def test_drag_and_sunlight_have_the_sizes_of_msr_a():
    """The specification has 1.6e-8 m/s^2 and 3.4e-8 m/s^2, and 1.3e-7 m/s^2 of differential J2 at 20 m."""
    numbers = disturbances.Disturbances().numbers(CHASER)
    drag = -_disturb((0.0, 0.0, 0.0), 0.2, 0.2, numbers)[1]
    assert drag == pytest.approx(1.6e-8, rel=0.02)
    light = np.array(_disturb((0.0, 0.0, 0.0), 0.2, 0.6, numbers)) + np.array([0.0, drag, 0.0])
    assert np.linalg.norm(light) == pytest.approx(3.4e-8, rel=0.01)
    assert math.atan2(light[1], light[0]) == pytest.approx(0.4 * 2.0 * math.pi, rel=1e-6)
    assert 20.0 * numbers[0] == pytest.approx(1.3e-7, rel=0.02)


def test_disturbances_push_the_chaser_unless_told_otherwise():
    for on in (True, False):
        batch = begin(MarsRendezvous(disturbances=on), worlds=3)
        batch.step(batch.task.pilot_actions(batch.state))
        pushed = batch.fleet.read(batch.fleet.rows.push, 3)[:, 0]
        size = np.linalg.norm(pushed, axis=1)
        assert np.all((size > 1e-8) & (size < 3e-7)) if on else np.all(size == 0.0)


def test_the_truth_differs_from_the_description_as_told():
    task = MarsRendezvous(mass_error=0.1, inertia_error=0.2, thrust_error=0.05, centre_of_mass_error=0.03)
    fleet = begin(task, worlds=400).fleet
    mass = fleet.read(at.MASS)[:, 0, 0] / 1500.0 - 1.0
    assert 0.098 < np.abs(mass).max() <= 0.1
    columns = fleet.read(fleet.rows.columns, 48)[:, 0].reshape(400, 8, 6)
    nominal = CHASER.wrenches().T
    gains = columns[:, :, 0] / nominal[:, 0]
    np.testing.assert_allclose(columns[:, :, :3], gains[..., np.newaxis] * nominal[:, :3], rtol=1e-12)
    assert 0.049 < np.abs(gains - 1.0).max() <= 0.05 + 1e-12
    # Torques are s (r - c) x F with one scale and one centre of mass for all thrusters of a chaser.
    for world in range(0, 400, 57):
        unknown = np.vstack(
            [
                np.column_stack([nominal[i, 3:], *(np.cross(nominal[i, :3], axis) for axis in np.eye(3))])
                for i in range(8)
            ]
        )
        torque = (columns[world, :, 3:] / gains[world][:, np.newaxis]).ravel()
        (scale, *moved), residue, _, _ = np.linalg.lstsq(unknown, torque, rcond=None)
        assert residue[0] < 1e-20
        assert abs(1.0 / scale - 1.0) <= 0.2 + 1e-12
        assert np.abs(np.array(moved) / scale).max() <= 0.03 + 1e-12


def test_a_chaser_without_errors_is_the_one_described():
    fleet = begin(MarsRendezvous(**EXACT_VEHICLE), worlds=3).fleet
    np.testing.assert_allclose(
        fleet.read(fleet.rows.columns, 48)[:, 0].reshape(3, 8, 6),
        np.broadcast_to(CHASER.wrenches().T, (3, 8, 6)),
        rtol=0.0,
        atol=1e-13,
    )
    assert np.all(fleet.read(at.MASS) == 1500.0)


def recovered(closes, switches, steps=2100):
    """Approaches with thruster 3 stuck open at 30 s, where at 32 s its valve closes or its branch goes."""
    task = MarsRendezvous(inhibit=True, faults=Fault(3, "stuck_on", onset=30.0))
    batch = begin(task, worlds=4)
    for k in range(steps):
        actions = task.pilot_actions(batch.state)
        if k >= 320:
            actions[:, 0, 8 + 2], actions[:, 0, 16] = 2.0 * closes - 1.0, 2.0 * switches - 1.0
        step = batch.step(actions)
        if step.terminated.all():
            break
    return batch


def test_going_over_to_the_spare_branch_saves_the_capture():
    batch = recovered(closes=0, switches=1)
    report = batch.task.report(batch.state)["approach"]
    assert batch.task.truth(batch.state).success.all()
    assert np.all(report["branch"] == 1)


def test_without_it_there_is_no_capture():
    batch = recovered(closes=0, switches=0)
    assert not batch.task.truth(batch.state).success.any()


def test_a_closed_isolation_valve_stops_the_stuck_thruster():
    batch = recovered(closes=1, switches=0, steps=330)
    fleet = batch.fleet
    delivered = fleet.read(fleet.rows.delivered, 8)[:, 0]
    assert np.all(delivered[:, 2] < 1e-12)
    assert np.all(delivered[:, [0, 1]] > 1e-3)
    observed = batch.task.observe(batch.state)[:, 0]
    np.testing.assert_array_equal(observed[:, 36:45], [[0, 0, 1, 0, 0, 0, 0, 0, 0]] * 4)


def test_a_chaser_without_a_spare_branch_has_valves_to_close_and_nothing_more():
    task = MarsRendezvous(inhibit=True, spacecraft=dataclasses.replace(CHASER, spare_branch=False))
    batch = begin(task, worlds=2)
    assert task.action_size == 16
    assert task.fields[-1].meaning == "whether each isolation valve is closed"
    actions = np.full((2, 1, 16), 1.0)
    actions[1, 0, 8 + 4] = -1.0
    for _ in range(5):
        batch.step(actions)
    observed = task.observe(batch.state)[:, 0]
    np.testing.assert_array_equal(observed[:, 36:], [[1] * 8, [1, 1, 1, 1, 0, 1, 1, 1]])
    delivered = batch.fleet.read(batch.fleet.rows.delivered, 8)[:, 0]
    np.testing.assert_array_equal(delivered > 0.01, [[False] * 8, [i == 4 for i in range(8)]])
    assert np.all(task.report(batch.state)["approach"]["branch"] == 0)


def test_a_fault_is_over_for_info_once_its_branch_is_left():
    env = gym.make(
        "thruster_envs/MarsRendezvous-v1", inhibit=True, faults=[{"thruster": 3, "kind": "stuck_on"}]
    )
    env.reset(seed=0)
    action = np.full(17, -1.0, np.float32)
    assert env.step(action)[-1]["fault"]["active"].tolist() == [True, False, False, False]
    action[16] = 1.0
    assert not env.step(action)[-1]["fault"]["active"].any()


def on_branch(faults, switch, steps=60, worlds=3, seed=4):
    """Impulse of each thruster, s, after going over to the spare branch at step ``switch``, if at all."""
    batch = begin(MarsRendezvous(inhibit=True, faults=faults), worlds=worlds, seed=seed)
    given = np.zeros((worlds, 8))
    for k in range(steps):
        actions = np.full((worlds, 1, 17), -1.0)
        actions[..., :8] = -0.6
        actions[..., 16] = 1.0 if switch is not None and k >= switch else -1.0
        batch.step(actions)
        if k >= steps - 10:
            given += batch.fleet.read(batch.fleet.rows.delivered, 8)[:, 0]
    return batch, given


def test_what_is_wrong_with_the_spare_branch_shows_once_it_is_in_use():
    failed = [Fault(8 + 5, "stuck_off", onset=1.0), Fault(2, "stuck_off", onset=1.0)]
    batch, given = on_branch(failed, None)
    assert np.all((given < 1e-9) == (np.arange(8) == 1))
    told = batch.info()["fault"]
    np.testing.assert_array_equal(told["thruster"][:, 0, :2], [[13, 2]] * 3)
    np.testing.assert_array_equal(told["active"][:, 0, :2], [[False, True]] * 3)
    batch, given = on_branch(failed, 30)
    assert np.all((given < 1e-9) == (np.arange(8) == 4))
    told = batch.info()["fault"]
    np.testing.assert_array_equal(told["thruster"][:, 0, :2], [[13, 2]] * 3)
    np.testing.assert_array_equal(told["active"][:, 0, :2], [[True, False]] * 3)


def test_a_saved_state_remembers_which_branch_a_fault_is_on():
    failed = Fault(8 + 5, "stuck_on", severity=0.5, onset=1.0)
    batch, _ = on_branch(failed, 30)
    saved = batch.save()
    other, _ = on_branch(failed, None, steps=20)
    other.restore(saved)
    for name, array in batch.info()["fault"].items():
        np.testing.assert_array_equal(other.info()["fault"][name], array)
    actions = np.full((3, 1, 17), -1.0)
    np.testing.assert_array_equal(other.step(actions).observations, batch.step(actions).observations)


def test_a_distribution_strikes_the_spare_branch_where_it_is_listed():
    settings = {"probability": 1.0, "kinds": ("stuck_off",), "onset": (0.0, 1.0)}
    batch, _ = on_branch(FaultDistribution(**settings, thrusters=tuple(range(1, 17))), None, 1, 400)
    struck = batch.info()["fault"]["thruster"][:, 0, 0]
    assert set(struck.tolist()) == set(range(1, 17))
    batch, _ = on_branch(FaultDistribution(**settings), None, 1, 200)
    assert set(batch.info()["fault"]["thruster"][:, 0, 0].tolist()) == set(range(1, 9))


def test_where_there_is_no_spare_branch_its_thrusters_cannot_fail():
    alone = dataclasses.replace(CHASER, spare_branch=False)
    with pytest.raises(ValueError, match="fault 1 is on thruster 9; a number from 1 to 8 would be right"):
        Worlds(MarsRendezvous(spacecraft=alone, faults=Fault(9, "stuck_off")), 1)
    with pytest.raises(ValueError, match="fault 1 is on thruster 17; a number from 1 to 16 would be right"):
        Worlds(MarsRendezvous(faults=Fault(17, "stuck_off")), 1)
    with pytest.raises(ValueError, match=r"thrusters: one of them is 17; a number from 1 to 16 would be"):
        Worlds(MarsRendezvous(faults=FaultDistribution(thrusters=(17,))), 1)


def test_info_has_the_true_state_and_the_onset():
    env = gym.make(
        "thruster_envs/MarsRendezvous-v1", faults=[{"thruster": 3, "kind": "stuck_on", "onset": 4.25}]
    )
    _, info = env.reset(seed=0)
    assert info["fault"]["onset"].tolist() == [4.25, 0.0, 0.0, 0.0]
    for _ in range(5):
        info = env.step(np.zeros(8, np.float32))[-1]
    state, worlds = info["approach"]["state"], env.unwrapped.worlds
    assert state.shape == (13,)
    np.testing.assert_array_equal(state[:3], worlds.fleet.read(at.POSITION, 3)[0, 0])
    np.testing.assert_array_equal(state[6:10], worlds.fleet.read(at.ATTITUDE, 4)[0, 0])
    assert np.linalg.norm(state[6:10]) == pytest.approx(1.0)
    # What navigation says of the moment before is true to its errors: a millimetre.
    assert np.abs(state[:3] - worlds.state.sights[0, -1, :3]).max() < 1e-3 + 1e-9


def test_info_has_the_true_delay_of_each_pulse():
    late = Fault(2, "late_opening", severity=0.03, onset=0.95)
    env = gym.make("thruster_envs/MarsRendezvous-v1", faults=late)
    assert np.all(env.reset(seed=3)[1]["approach"]["delay"] == 0.0)
    seen = np.array([env.step(np.zeros(8, np.float32))[-1]["approach"]["delay"] for _ in range(40)])
    modulator = CHASER.modulator
    opening = np.array([thruster.opening_delay for thruster in CHASER.thrusters])
    beyond = seen - opening - modulator.delay
    beyond[10:, 1] -= 0.03
    widest = modulator.variation + modulator.jitter
    assert np.all(np.abs(beyond) <= widest + 1e-12)
    assert beyond.max() > 0.5 * widest  # and it is drawn anew for every pulse
    assert len(np.unique(beyond.round(9))) == beyond.size


def test_pulses_under_way_are_lost_when_the_branch_changes():
    task = MarsRendezvous(inhibit=True)
    batch = begin(task, worlds=1)
    actions = np.full((1, 1, 17), -1.0)
    actions[..., :8] = 1.0
    batch.step(actions)
    actions[..., :8], actions[..., 16] = -1.0, 1.0
    given = 0.0
    for _ in range(5):
        batch.step(actions)
        given += batch.fleet.read(batch.fleet.rows.delivered, 8)[0, 0].sum()
    # All that comes is what had been let in before: the delay is at least 70 ms of 100 ms.
    assert given < 8 * 0.03


def place(batch, position, velocity, rate=WITH_LVLH, attitude=FACING, step=100):
    """Put every chaser somewhere, with nothing on its way from its valves."""
    fleet = batch.fleet
    fleet.write(at.POSITION, [position])
    fleet.write(at.VELOCITY, [velocity])
    fleet.write(at.ATTITUDE, [attitude])
    fleet.write(at.RATE, [rate])
    fleet.write(at.STEP, [[float(step)]])


TILTED = tuple(product((math.cos(0.03), 0.0, -math.sin(0.03), 0.0), FACING))
AT_THE_PLANE = {"position": (0.0, -0.002, 0.0), "velocity": (0.0, 0.05, 0.0)}


@pytest.mark.parametrize(
    ("state", "ends", "captured", "safe"),
    [
        ({}, True, True, True),
        ({"position": (0.09, -0.002, 0.03)}, True, True, True),
        ({"position": (0.09, -0.002, 0.06)}, True, False, False),
        ({"velocity": (0.0, 0.16, 0.0)}, True, False, False),
        ({"velocity": (0.025, 0.05, 0.0)}, True, False, False),
        ({"attitude": TILTED}, True, False, False),
        ({"rate": (0.01, -N, 0.0)}, True, False, False),
        ({"position": (0.0, -0.02, 0.0)}, False, False, True),
        ({"position": (0.9, -1.5, 0.0)}, True, False, False),
        ({"position": (0.9, -6.0, 0.0)}, False, False, True),
        ({"position": (0.0, -15.0, 0.0), "rate": (0.21, 0.0, 0.0)}, True, False, False),
        ({"position": (0.0, -30.1, 0.0), "velocity": (0.0, -0.1, 0.0)}, True, False, True),
        ({"position": (0.0, -15.0, 0.0), "step": 2999}, True, False, True),
        ({"position": (0.0, -15.0, 0.0), "step": 2998}, False, False, True),
    ],
)
def test_how_an_approach_ends(state, ends, captured, safe):
    batch = begin(MarsRendezvous())
    place(batch, **(AT_THE_PLANE | state))
    step = batch.step(np.full((1, 1, 8), -1.0))
    truth, report = batch.task.truth(batch.state), batch.task.report(batch.state)["approach"]
    assert (step.terminated[0], truth.success[0, 0], report["safe"][0, 0]) == (ends, captured, safe)
    capture, lost = step.reward_terms[0, 0, 4:]
    assert capture == (4.0 if captured else 0.0)  # without any fuel
    left = 3.2 * max(3000.0 - batch.fleet.read(at.STEP)[0, 0, 0], 0.0) / 3000.0
    if captured or not ends:
        assert lost == 0.0
    elif safe:
        assert lost == pytest.approx(-left, abs=1e-12)
    else:
        assert -4.0 <= lost + left <= -2.0
    if captured:
        assert truth.score[0, 0] == 1.0  # without any fuel
    elif not safe:
        assert truth.score[0, 0] == 0.0


def test_a_retreat_is_safe_and_no_success():
    batch = begin(MarsRendezvous())
    place(batch, (0.0, -30.1, 0.0), (0.0, -0.1, 0.0))
    batch.step(np.full((1, 1, 8), -1.0))
    report = batch.task.report(batch.state)["approach"]
    assert report["retreated"][0, 0]
    assert batch.task.truth(batch.state).score[0, 0] == 0.25


def test_rewards_are_what_they_are_said_to_be():
    batch = begin(MarsRendezvous(disturbances=False))
    place(batch, (0.3, -10.0, -0.4), (0.0, 0.1, 0.0), attitude=TILTED, step=1500)  # it is late
    before = batch.state.episode.potential[0]
    step = batch.step(np.full((1, 1, 8), -1.0))
    position = batch.fleet.read(0, 3)[0, 0]
    offset, distance = np.hypot(position[0], position[2]), np.linalg.norm(position)
    expected = [
        -2.0 / 3000.0 * offset / (offset + 0.25),
        -0.5 / 3000.0 * 0.06 / (0.06 + math.radians(3.0)),
        0.0,
        4.0 * (-distance / 20.0 - before),
        0.0,
        0.0,
    ]
    np.testing.assert_allclose(step.reward_terms[0, 0], expected, rtol=1e-3, atol=1e-9)
    assert step.cost[0, 0] == 0.0
    place(batch, (3.0, -10.0, 0.0), (0.0, 0.1, 0.0))
    free = 0.25 + 9.99 * math.tan(math.radians(10.0))
    assert batch.step(np.full((1, 1, 8), -1.0)).cost[0, 0] == pytest.approx(3.0 / free - 1.0, rel=1e-4)


def test_who_is_ahead_of_the_nominal_approach_gains_nothing_by_it():
    batch = begin(MarsRendezvous(disturbances=False))
    place(batch, (0.0, -10.0, 0.0), (0.0, 0.1, 0.0), step=500)
    step = batch.step(np.full((1, 1, 8), -1.0))
    assert step.reward_terms[0, 0, 3] == pytest.approx(4.0 * 50.1 / 200.0, abs=0.03)


def test_fuel_is_the_share_of_all_valves_that_were_open():
    batch = begin(MarsRendezvous(), worlds=2)
    total = sum(
        batch.step(np.full((2, 1, 8), 2.0 * duty - 1.0)).reward_terms[:, 0, 2] for duty in (0.5, 0.5, 0, 0, 0)
    )
    np.testing.assert_allclose(total, -0.2 / 3000.0, rtol=1e-9)


def test_the_reference_of_the_pilot_brakes_steadily_and_arrives_at_the_speed_of_contact():
    pilot = ApproachPilot.of(CHASER, 20.0)
    times = np.linspace(0.0, 215.0, 4301)
    rows = np.array([pilot.reference(t) for t in times])
    np.testing.assert_allclose(np.diff(rows[:, 0]), 0.05 * 0.5 * (rows[1:, 1] + rows[:-1, 1]), atol=1e-9)
    assert rows[0].tolist() == [-20.0, 0.1, 0.0]
    assert np.all((rows[:, 1] >= 0.05) & (rows[:, 1] <= 0.1 + 1e-15))
    assert np.ptp(np.diff(rows[:, 1])) <= 0.05 * 2e-3 + 1e-12
    assert pilot.reference(206.25)[0] == pytest.approx(0.0, abs=1e-12)


def test_the_pilot_gives_the_wrench_it_wants_about_the_idle_rate():
    pilot = ApproachPilot.of(CHASER, 20.0)
    position, velocity = [0.02, -19.97, -0.01], [0.0, 0.101, 0.002]
    duties = pilot(0.0, [position], [velocity], [FACING], [WITH_LVLH])[0]
    assert duties.mean() == pytest.approx(0.1, abs=1e-12)
    assert duties.min() > 0.0
    error = np.array(position) - (0.0, -20.0, 0.0)
    pull = -0.04 * error - 0.36 * (np.array(velocity) - (0.0, 0.1, 0.0))
    free = [2 * N * 0.101 + 3 * N * N * 0.02, 0.0, N * N * 0.01]
    x, y, z = 1500.0 * (pull - free)
    expected = [y, -z, -x, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(CHASER.wrenches() @ duties, expected, atol=1e-9)
    wanted = pilot.wrench(0.0, [position], [velocity], [FACING], [WITH_LVLH])[0]
    np.testing.assert_allclose(wanted, expected, atol=1e-9)


def test_the_pilot_turns_the_chaser_back():
    """Turned by 0.06 rad about its own y axis, and turning on by 1 mrad/s."""
    wrench = ApproachPilot.of(CHASER, 20.0).wrench(
        0.0, [0.0, -20.0, 0.0], [0.0, 0.1, 0.0], TILTED, (0.0, 1e-3 - N, 0.0)
    )[0]
    sign = 1.0 if turned_about_y() > 0.0 else -1.0
    expected = 1700.0 * (-0.25 * sign * 2.0 * math.sin(0.03) - 0.9 * 1e-3)
    np.testing.assert_allclose(wrench[3:], [0.0, expected, 0.0], atol=1e-6)


def turned_about_y():
    """By how much the attitude ``TILTED`` is one that a positive rate about y leads to."""
    q, rate = np.array(FACING), np.array([0.0, 0.0, 1.0, 0.0])
    change = -0.5 * product(rate, q)
    return float(change @ (np.array(TILTED) - q))


def test_the_pilot_of_the_task_is_the_pilot_on_its_own():
    batch = begin(MarsRendezvous(), worlds=7)
    for _ in range(30):
        batch.step(batch.task.pilot_actions(batch.state))
    state = batch.state
    duties = state.model.pilot(
        np.full(7, 2.9), state.estimate[:, :3], state.estimate[:, 3:], state.sights[:, 0, 6:10],
        state.sights[:, 0, 10:13],
    )  # fmt: skip
    np.testing.assert_allclose(
        0.5 * batch.task.pilot_actions(state)[:, 0] + 0.5, duties, rtol=1e-9, atol=1e-12
    )


def test_where_thrusters_do_not_cancel_the_pilot_leaves_them_shut_unless_they_help():
    lame = ApproachPilot.of(CHASER.replace(thrusters=CHASER.thrusters[:7]), 20.0)
    at_rest = ([0.0, -20.0, 0.0], [0.0, 0.1, 0.0])
    np.testing.assert_allclose(lame(0.0, *at_rest, FACING, WITH_LVLH), 0.0, atol=1e-2)
    behind = lame(0.0, [0.0, -20.5, 0.0], [0.0, 0.1, 0.0], FACING, WITH_LVLH)[0]
    assert behind.min() == 0.0
    assert behind[2:6].min() > 0.05


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spacecraft": "orion"}, "'orion' has no modulator; a spacecraft with one"),
        ({"distance": 1.0}, "distance is 1.0; 2.5 to 1000 m would be right"),
        ({"mass_error": 0.7}, "mass_error is 0.7; a share from 0 to 0.5 would be right"),
        ({"navigation_delay": -1}, "navigation_delay is -1; a whole number from 0 to 10"),
        ({"rate_limit": math.inf}, "rate_limit is inf; a finite number above 0"),
        ({"centre_of_mass_error": -0.1}, "centre_of_mass_error is -0.1; 0 m or more"),
        (
            {"inhibit": True, "spacecraft": dataclasses.replace(CHASER, isolation_valves=False)},
            "has no isolation valves; inhibit=False would be right",
        ),
    ],
)
def test_a_bad_configuration_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        MarsRendezvous(**arguments)
