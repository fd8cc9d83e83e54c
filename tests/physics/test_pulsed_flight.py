"""Craft on plasma thrusters turn as an independent integration says, and faults change pulses as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.physics.flying import begin, pulsed_fleet, scatter_draws
from thruster_envs.faults import DISCHARGE_KINDS, PROFILES, THRUSTER_KINDS, Fault, FaultDistribution
from thruster_envs.physics import rows as at
from thruster_envs.physics.plasma_pulse import PulseMap
from thruster_envs.physics.pulsed_craft import REPORTED_FAULT_BIAS
from thruster_envs.spacecraft import load

PPT = load("ppt_cubesat")
IMPULSE = 1e-4 * 0.016  # N s of a healthy firing
TURN = IMPULSE * 0.05  # N m s
STILL = {"gravity_gradient": False, "bias_torque": (0.0, 0.0, 0.0)}


def fleet_of(faults=(), *, spacecraft=PPT, seed=0, **options):
    """One craft that nothing but its thrusters turns."""
    fleet = pulsed_fleet(spacecraft, 1, **(STILL | options))
    begin(fleet, faults, seed=seed)
    fleet.look(fleet.everyone)
    return fleet


def fire(fleet, *thrusters, periods=1):
    """Ask thrusters, by number from 1, to fire in each of some periods; the impulses delivered, N m s."""
    duties = np.zeros(6)
    duties[[one - 1 for one in thrusters]] = 1.0
    impulses = []
    for _ in range(periods):
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        impulses.append(fleet.read(at.IMPULSE + 3, 3)[0, 0])
    return np.array(impulses)


def shares(fleet):
    """What each thruster gave in the last period, over the nominal impulse."""
    return fleet.read(fleet.rows.delivered, 6)[0, 0] / 0.016


def test_a_firing_gives_its_impulse_at_once_and_about_its_axis():
    for thruster, (axis, sign) in enumerate([(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)], start=1):
        fleet = fleet_of()
        expected = np.zeros(3)
        expected[axis] = sign * TURN
        np.testing.assert_allclose(fire(fleet, thruster)[0], expected, rtol=1e-12, atol=1e-24)
        rate = expected / np.diag(PPT.inertia)
        np.testing.assert_allclose(fleet.read(at.RATE, 3)[0, 0], rate, rtol=1e-12, atol=1e-22)
        # At the start of the period: the craft has turned at that rate for all of it. v_body = q v q*.
        angle = -2.0 * np.arcsin(fleet.read(at.ATTITUDE, 4)[0, 0, 1 + axis])
        assert angle == pytest.approx(rate[axis] * 1.0, rel=1e-9)


def test_turning_agrees_with_an_independent_integration():
    """Full inertia, gravity gradient with a turning vertical, bias, and random firings, for 150 s."""
    generator = np.random.default_rng(0)
    inertia = np.array([[2.0, 0.3, -0.2], [0.3, 2.4, 0.1], [-0.2, 0.1, 1.5]]) * 1e-3
    craft = PPT.replace(inertia=inertia, mean_motion=0.01)  # the gradient is a hundred times the usual one
    bias = (1e-9, -2e-9, 3e-9)
    fleet = pulsed_fleet(craft, 1, bias_torque=bias)
    begin(fleet)
    start = np.array([2e-3, -3e-3, 4e-3])
    fleet.write(at.RATE, start)
    torques = craft.wrenches()[3:] * 0.016

    def motion(t, y):
        q, w = y[:4], y[4:]
        matrix = to_matrix(q)
        vertical = matrix @ (np.cos(0.01 * t), np.sin(0.01 * t), 0.0)
        torque = bias + 3.0 * 0.01**2 * np.cross(vertical, inertia @ vertical)
        spin = np.array([[0, *(-w)], [w[0], 0, w[2], -w[1]], [w[1], -w[2], 0, w[0]], [w[2], w[1], -w[0], 0]])
        # The conjugate of body-from-reference turns by half of q times the rate.
        return [*(0.5 * spin @ q), *np.linalg.solve(inertia, torque - np.cross(w, inertia @ w))]

    state = np.concatenate([[1.0, 0.0, 0.0, 0.0], start])
    for k in range(150):
        duties = np.zeros(6)
        for pair in range(3):
            choice = generator.integers(3)
            if choice:
                duties[2 * pair + choice - 1] = 1.0
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        state[4:] += np.linalg.solve(inertia, torques @ duties)
        state = solve_ivp(motion, (k, k + 1.0), state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    q = fleet.read(at.ATTITUDE, 4)[0, 0] * (1.0, -1.0, -1.0, -1.0)
    assert np.linalg.norm(state[4:]) > 3e-3
    expected = state[:4] / np.linalg.norm(state[:4]) * np.sign(q @ state[:4])
    np.testing.assert_allclose(q, expected, rtol=0.0, atol=2e-8)  # a torque that grows costs the fourth order
    np.testing.assert_allclose(fleet.read(at.RATE, 3)[0, 0], state[4:], rtol=0.0, atol=5e-10)


def to_matrix(q):
    """Reference to body, from the conjugate of our quaternion (Valdes 2008, eq. 3.8 as it should read)."""
    v = q[1:]
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return (2.0 * q[0] ** 2 - 1.0) * np.eye(3) + 2.0 * np.outer(v, v) - 2.0 * q[0] * cross


def test_one_period_in_many_sub_steps_is_one_in_one():
    ends = []
    for substep in (None, 0.05):
        fleet = pulsed_fleet(PPT, 1, max_substep=substep)
        begin(fleet)
        fleet.write(at.RATE, (0.02, -0.03, 0.04))
        fire(fleet, 1, 4, 5, periods=100)
        ends.append(np.concatenate([fleet.read(at.ATTITUDE, 4)[0, 0], fleet.read(at.RATE, 3)[0, 0]]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-8)


def test_thrusters_on_one_capacitor_never_fire_together():
    fleet = fleet_of()
    fire(fleet, 1, 2, 4, 5, 6)
    np.testing.assert_allclose(shares(fleet), [1.0, 0.0, 0.0, 1.0, 1.0, 0.0], rtol=1e-14)
    fleet.write(fleet.rows.duties, (0.2, 0.9, 0.0, 0.0, 0.6, 0.5))
    fleet.fly()
    np.testing.assert_allclose(shares(fleet), [0.0, 1.0, 0.0, 0.0, 1.0, 0.0], rtol=1e-14)
    assert fleet.read(at.OPEN_TIME)[0, 0, 0] == pytest.approx(0.016 * 5)


def test_one_that_is_stuck_on_fires_unasked_and_takes_from_its_partner():
    fleet = fleet_of([Fault(1, "stuck_on", severity=0.3)])
    for asked, given in (((), (0.3, 0.0)), ((1,), (0.3, 0.0)), ((2,), (0.3, 0.7))):
        fire(fleet, *asked)
        np.testing.assert_allclose(shares(fleet)[:2], given, rtol=1e-14)


@pytest.mark.parametrize(("severity", "share"), [(1.0, -1.0), (0.5, 0.0), (0.25, 0.5)])
def test_one_that_is_miswired_pushes_the_other_way(severity, share):
    fleet = fleet_of([Fault(1, "sign", severity=severity)])
    np.testing.assert_allclose(fire(fleet, 1)[0], [share * TURN, 0.0, 0.0], rtol=1e-12, atol=1e-24)
    assert fleet.read(at.OPEN_TIME)[0, 0, 0] == pytest.approx(0.016)


def test_a_bias_asks_for_a_pulse_beside_what_is_commanded():
    """The highest sum of command and bias on a capacitor fires, a whole pulse; the other one does not."""
    fleet = fleet_of([Fault(1, "bias", severity=0.3, onset=1.0)])
    for duties, given in (
        ((0.0, 0.0), (0.0, 0.0)),  # before the onset
        ((0.0, 0.0), (1.0, 0.0)),
        ((0.0, 0.2), (1.0, 0.0)),
        ((0.0, 0.4), (0.0, 1.0)),
        ((0.2, 0.4), (1.0, 0.0)),
    ):
        fleet.write(fleet.rows.duties, (*duties, 0.0, 0.0, 0.0, 0.0))
        fleet.fly()
        np.testing.assert_allclose(shares(fleet)[:2], given, rtol=1e-14)
    expected = fleet.read(at.EXPECTED_CHANGE + 3, 3)[0, 0]
    np.testing.assert_allclose(expected, [-TURN / PPT.inertia[0][0], 0.0, 0.0], rtol=1e-12, atol=1e-20)


def test_one_that_leaks_gives_a_whole_pulse_on_command():
    fleet = fleet_of([Fault(3, "leak", severity=0.1)])
    for asked, given in (((), (0.1, 0.0)), ((3,), (1.0, 0.0)), ((4,), (0.1, 0.9))):
        fire(fleet, *asked)
        np.testing.assert_allclose(shares(fleet)[2:4], given, rtol=1e-14)


@pytest.mark.parametrize("kind", ["stuck_off", "loss"])
def test_a_share_of_the_thrust_is_lost(kind):
    fleet = fleet_of([Fault(5, kind, severity=0.4, onset=2.0, duration=3.0)])
    np.testing.assert_allclose(
        fire(fleet, 5, periods=7)[:, 2] / TURN, [1.0, 1.0, 0.6, 0.6, 0.6, 1.0, 1.0], rtol=1e-12
    )


def test_a_ramp_and_a_square_wave_act_as_they_stand_at_each_firing():
    ramp = fire(fleet_of([Fault(5, "loss", severity=0.8, profile="ramp", profile_time=4.0)]), 5, periods=6)
    np.testing.assert_allclose(ramp[:, 2] / TURN, [1.0, 0.8, 0.6, 0.4, 0.2, 0.2], rtol=1e-12)
    wave = fire(fleet_of([Fault(5, "intermittent", profile_time=4.0, dwell=0.5)]), 5, periods=6)
    np.testing.assert_allclose(wave[:, 2] / TURN, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0], atol=1e-15)


def test_a_misaligned_thrust_turns_the_craft_about_other_axes():
    """Thruster 1 pushes along +y at (0, 0, -5 cm); tilted by s its torque is r x F of the tilted force."""
    tilt = 0.3
    fleet = fleet_of([Fault(1, "misalignment", severity=tilt, azimuth=1.1)])
    got = fire(fleet, 1)[0]
    force = fleet.read(at.IMPULSE, 3)[0, 0]
    assert np.linalg.norm(force) == pytest.approx(IMPULSE)
    assert force[1] == pytest.approx(IMPULSE * np.cos(tilt))
    np.testing.assert_allclose(got, np.cross((0.0, 0.0, -0.05), force), rtol=0.0, atol=1e-20)


def test_a_late_pulse_gives_its_impulse_later_in_the_period_or_never():
    late = fleet_of([Fault(1, "late_opening", severity=0.25)])
    fire(late, 1)
    rate = TURN / PPT.inertia[0][0]
    np.testing.assert_allclose(late.read(at.RATE)[0, 0, 0], rate, rtol=1e-12)
    angle = -2.0 * np.arcsin(late.read(at.ATTITUDE, 4)[0, 0, 1])
    assert angle == pytest.approx(0.75 * rate, rel=1e-9)
    lost = fleet_of([Fault(1, "late_opening", severity=1.0)])
    assert not fire(lost, 1).any()


def test_faults_of_the_discharge_change_the_impulse_by_the_pulse_map():
    table = PulseMap.of(PPT.discharge)
    for kind, severity, share in (
        ("propellant_loss", 0.88, table.ratio(mass_share=0.12)),
        ("electrode_sediment", 0.14, table.ratio(width_share=0.86)),
        ("conductivity_loss", 0.008, table.ratio(added_resistance=0.008)),
    ):
        fleet = fleet_of([Fault(3, kind, severity=severity)])
        assert fire(fleet, 3)[0, 1] / TURN == pytest.approx(float(share), rel=1e-12)
        assert fire(fleet, 4)[0, 1] / -TURN == pytest.approx(1.0, rel=1e-12)
        fleet = fleet_of([Fault(3, kind, severity=severity, shared=True)])
        assert fire(fleet, 4)[0, 1] / -TURN == pytest.approx(float(share), rel=1e-12)


def test_two_faults_of_one_pulse_act_together_in_the_map():
    faults = [
        Fault(2, "propellant_loss", severity=0.5),
        Fault(1, "conductivity_loss", severity=0.02, shared=True),
    ]
    table = PulseMap.of(PPT.discharge)
    fire(fleet := fleet_of(faults), 2)
    assert shares(fleet)[1] == pytest.approx(
        float(table.ratio(mass_share=0.5, added_resistance=0.02)), rel=1e-12
    )


def test_the_torque_that_may_come_with_a_fault_lies_along_that_of_the_thruster():
    for kind, size in (
        ("propellant_loss", -6e-8),
        ("conductivity_loss", -6e-8),
        ("electrode_sediment", 1e-8),
    ):
        fleet = fleet_of([Fault(4, kind, severity=0.02)], fault_bias=REPORTED_FAULT_BIAS)
        fire(fleet, periods=10)
        momentum = np.array(PPT.inertia) @ fleet.read(at.RATE, 3)[0, 0]
        np.testing.assert_allclose(momentum, (0.0, -10.0 * size, 0.0), rtol=1e-9, atol=1e-20)


def test_scatter_is_the_worlds_own_draw_for_each_firing():
    craft = PPT.replace(thrusters=tuple(replace(one, scatter=0.05) for one in PPT.thrusters))
    fleet = fleet_of(spacecraft=craft, seed=11)
    for step in range(3):
        fire(fleet, 1, 4, 5)
        expected = (1.0 + 0.05 * scatter_draws(11, step, 6)) * (1, 0, 0, 1, 1, 0)
        np.testing.assert_allclose(shares(fleet), expected, rtol=1e-12)


def test_measured_and_expected_changes_are_of_what_was_commanded():
    fleet = fleet_of([Fault(1, "stuck_off", severity=0.5)])
    changes, expected = [], []
    for _ in range(400):
        fire(fleet, 1)
        changes.append(fleet.read(at.MEASURED_CHANGE, 6)[0, 0])
        expected.append(fleet.read(at.EXPECTED_CHANGE, 6)[0, 0])
    step = TURN / PPT.inertia[0][0]
    np.testing.assert_allclose(expected, np.tile([0, 0, 0, step, 0, 0], (400, 1)), rtol=1e-12, atol=1e-20)
    # Consecutive differences of white noise: the mean of 400 has the error of its two ends alone.
    np.testing.assert_allclose(
        np.mean(changes, axis=0)[3:], [0.5 * step, 0.0, 0.0], rtol=0.0, atol=5.0 * np.sqrt(2.0) * 1e-5 / 400
    )


def test_a_craft_without_propellant_does_not_fire():
    thrusters = tuple(replace(one, specific_impulse=400.0) for one in PPT.thrusters)
    flow = 1e-4 / (400.0 * 9.80665)
    craft = PPT.replace(thrusters=thrusters, feed={"propellant_mass": 2.5 * 0.016 * flow})
    fleet = fleet_of(spacecraft=craft)
    given = fire(fleet, 1, periods=5)[:, 0] / TURN
    np.testing.assert_allclose(given, [1.0, 1.0, 1.0, 0.0, 0.0], rtol=1e-12)
    assert fleet.read(at.MASS)[0, 0, 0] == pytest.approx(1.0 - 3.0 * 0.016 * flow, abs=1e-15)


def test_a_spacecraft_without_a_discharge_is_refused():
    with pytest.raises(ValueError, match="'orion' has no discharge"):
        pulsed_fleet(load("orion"), 1)


EVERYTHING = FaultDistribution(
    probability=0.8,
    kinds=THRUSTER_KINDS + DISCHARGE_KINDS,
    count=(1, 3),
    onset=(0.0, 20.0),
    duration=(5.0, 40.0),
    severity={"late_opening": (0.1, 1.2)},
    profiles=PROFILES,
    profile_time=(5.0, 20.0),
    dwell=(0.2, 0.8),
    shared=True,
)


def flown(worlds, first=0, threads=None, periods=40):
    fleet = pulsed_fleet(PPT, worlds, 3, threads=threads, fault_bias=REPORTED_FAULT_BIAS)
    begin(fleet, EVERYTHING, seed=40 + first)
    fleet.look(fleet.everyone)
    duties = np.array([np.random.default_rng([first + w, 1]).random((periods, 3, 6)) for w in range(worlds)])
    duties[duties < 0.5] = 0.0
    for k in range(periods):
        fleet.write(fleet.rows.duties, duties[:, k])
        fleet.fly()
    return fleet.read(0, fleet.rows.fields)


def test_a_world_in_a_batch_is_the_world_alone_on_any_number_of_threads():
    """Alone in blocks of one, in one padded block, and in many."""
    many = flown(110)
    assert np.array_equal(flown(110, threads=3), many)
    assert np.array_equal(flown(7), many[:7])
    for world in range(0, 110, 11):
        assert np.array_equal(flown(1, first=world)[0], many[world])
    assert np.all(np.isfinite(many))
    assert not np.array_equal(many[0, 0], many[0, 1])
