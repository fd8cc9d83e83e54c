"""Craft about elliptic orbits and about an oblate planet fly as in inertial space, whatever fires them.

Judged by SciPy's integration of LVLH and craft in the planet's axes (:mod:`.inertial`), which shares nothing
with the kernels.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.physics.closed_forms import rotation_matrix, rotation_quaternion
from tests.physics.flying import begin, pulsed_fleet, random_duties, random_faults
from tests.physics.inertial import InertialFlight
from tests.physics.reference_flight import Firing
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.orbits import true_anomaly_at
from thruster_envs.spacecraft import ControlMomentGyro, Modulator, Orbit, ReactionWheel, load
from thruster_envs.spacecraft.orbit import EARTH_J2, EARTH_RADIUS, MARS_J2, MARS_MU, MARS_RADIUS

ELLIPTIC = Orbit(
    semi_major_axis=8000e3, eccentricity=0.15, inclination=1.1, raan=0.3, argument_of_perigee=0.7,
    true_anomaly=-0.3, planet_radius=EARTH_RADIUS,
)  # fmt: skip
OBLATE = dataclasses.replace(ELLIPTIC, j2=EARTH_J2)
ORBITS = pytest.mark.parametrize("orbit", [ELLIPTIC, OBLATE], ids=["elliptic", "oblate"])
#: Position, velocity, attitude, rate.
START = np.concatenate(
    [(300.0, -500.0, 200.0), (0.1, -0.5, 0.2), rotation_quaternion([0.4, -1.1, 0.7]), (4e-3, -3e-3, 2e-3)]
)
NOISELESS = {"sensors": {}}


def of_orion(orbit, **changes):
    """Orion on an orbit, without scatter and without errors of its sensors."""
    orion = load("orion")
    thrusters = [dataclasses.replace(one, scatter=0.0) for one in orion.thrusters]
    return orion.replace(orbit=orbit, thrusters=thrusters, **(NOISELESS | changes))


def flying(spacecraft, start=START, **options):
    """One craft at START, and the same in inertial space."""
    fleet = Fleet(spacecraft, 1, **options)
    begin(fleet)
    fleet.write(0, start)
    fleet.look(fleet.everyone)
    anomaly = true_anomaly_at(spacecraft.reference_orbit, 0.0)
    return fleet, InertialFlight.begin(spacecraft, [*start, spacecraft.mass], anomaly)


def assert_same(fleet, exact, tolerance=1e-8):
    found = fleet.read(0, 14)[0, 0]
    for part in (slice(0, 3), slice(3, 6)):
        size = np.linalg.norm(exact.relative[part])
        assert np.linalg.norm(found[part] - exact.relative[part]) < tolerance * size
    np.testing.assert_allclose(rotation_matrix(found[6:10]), exact.body_from_lvlh, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(found[10:13], exact.state[21:24], rtol=0.0, atol=tolerance)
    assert found[13] == pytest.approx(exact.state[24], rel=1e-11)


@ORBITS
def test_valves_fire_as_in_inertial_space(orbit):
    """Twenty periods of random duties, tumbling, past perigee."""
    spacecraft = of_orion(orbit)
    fleet, exact = flying(spacecraft, nonlinear=True, max_substep=0.1)
    duties = 0.3 * random_duties(np.random.default_rng(1), 20, 12)
    firing = Firing(spacecraft, [], craft=1)
    for row in duties:
        fleet.write(fleet.rows.duties, row)
        fleet.fly()
        begins = exact.state[25]
        for piece in firing.next_period(row, np.zeros(12)):
            exact.fly(piece.end - piece.start, lambda t, piece=piece, begins=begins: piece.loads(t - begins))
    assert_same(fleet, exact)


@ORBITS
def test_a_coast_past_perigee_is_that_of_two_orbits(orbit):
    """Three quarters of an orbit in sub-steps that the craft chooses itself, and where LVLH stands then."""
    spacecraft = of_orion(orbit, control_period=60.0)
    start = START.copy()
    start[10:] = 0.0
    fleet, exact = flying(spacecraft, start, nonlinear=True)
    for _ in range(90):
        fleet.fly()
    exact.fly(90 * 60.0)
    assert_same(fleet, exact, 1e-7)
    place, velocity = exact.state[:3], exact.state[3:6]
    assert fleet.read(at.FRAME_RATE, 2)[0, 0, 1] == pytest.approx(
        np.linalg.norm(np.cross(place, velocity)) / (place @ place), rel=1e-8
    )
    ellipse = fleet.ellipses()[0]
    toward = np.cross(velocity, np.cross(place, velocity)) / orbit.gravitational_parameter
    toward -= place / np.linalg.norm(place)
    assert ellipse[2] == pytest.approx(np.linalg.norm(toward), rel=1e-7)
    anomaly = math.atan2(np.linalg.norm(np.cross(toward, place)) * np.sign(place @ velocity), toward @ place)
    assert ellipse[5] == pytest.approx(anomaly, abs=1e-7)


@pytest.mark.parametrize("j2", [0.0, MARS_J2], ids=["elliptic", "oblate"])
def test_thrusters_behind_a_modulator_fire_as_in_inertial_space(j2):
    """Without delay or lag a duty of 1 is steady thrust."""
    orbit = Orbit(
        semi_major_axis=4500e3, eccentricity=0.1, inclination=0.8, raan=1.0, true_anomaly=0.2, j2=j2,
        gravitational_parameter=MARS_MU, planet_radius=MARS_RADIUS,
    )  # fmt: skip
    chaser = load("msr_chaser")
    plain = {"scatter": 0.0, "opening_delay": 0.0, "closing_delay": 0.0, "time_constant": 0.0}
    thrusters = [dataclasses.replace(one, **plain) for one in chaser.thrusters]
    spacecraft = chaser.replace(orbit=orbit, thrusters=thrusters, modulator=Modulator(), **NOISELESS)
    fleet, exact = flying(spacecraft, nonlinear=True)
    wrenches = spacecraft.wrenches()
    flows = np.array([one.thrust / (one.specific_impulse * 9.80665) for one in thrusters])
    rng = np.random.default_rng(2)
    for _ in range(30):
        duties = rng.integers(0, 2, len(thrusters)).astype(float)
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        wrench = wrenches @ duties
        exact.fly(
            spacecraft.control_period,
            lambda _, wrench=wrench, duties=duties: (wrench[:3], wrench[3:], float(flows @ duties)),
        )
    assert_same(fleet, exact)


def test_with_wheels_and_gyros_momentum_stays_in_inertial_space_and_the_craft_coasts():
    wheel = ReactionWheel(name="x", axis=(1, 0, 0), inertia=2e-3, max_torque=5e-3, max_speed=500.0)
    gyro = ControlMomentGyro(
        name="a", gimbal_axis=(0, 0, 1), spin_axis=(1, 0, 0), momentum=0.08, max_gimbal_rate=0.1
    )
    spacecraft = of_orion(ELLIPTIC, reaction_wheels=[wheel], control_moment_gyros=[gyro])
    fleet, exact = flying(spacecraft)
    rows = fleet.rows

    def momentum():
        state = fleet.read(0, 14)[0, 0]
        speed, angle = fleet.read(rows.wheel_speeds)[0, 0, 0], fleet.read(rows.gimbal_angles)[0, 0, 0]
        stored = np.array(spacecraft.inertia) @ state[10:13]
        stored += wheel.inertia * speed * np.array(wheel.axis)
        stored += gyro.momentum * np.array([math.cos(angle), math.sin(angle), 0.0])
        return exact.axes.T @ rotation_matrix(state[6:10]).T @ stored

    before = momentum()
    for k in range(20):
        fleet.write(rows.wheel_torques, [[[(-1.0) ** (k // 3)]]])
        fleet.write(rows.gimbal_rates, [[[math.sin(k)]]])
        fleet.fly()
        exact.fly(spacecraft.control_period)
    assert np.linalg.norm(momentum() - before) < 1e-10 * np.linalg.norm(before)
    assert np.linalg.norm(fleet.read(rows.wheel_speeds)) > 1.0
    # By the linear equations: off by the square of the distance over that to the planet.
    assert np.abs(fleet.read(0, 3)[0, 0] - exact.relative[:3]).max() < 0.5


@ORBITS
def test_plasma_pulses_turn_a_craft_under_the_gravity_of_where_it_stands(orbit):
    """The gradient goes with the cube of the distance, and its vertical with the anomaly."""
    inertia = np.array([[2.0, 0.3, -0.2], [0.3, 2.4, 0.1], [-0.2, 0.1, 1.5]]) * 1e-3
    ppt = load("ppt_cubesat")
    thrusters = [dataclasses.replace(one, scatter=0.0) for one in ppt.thrusters]
    craft = ppt.replace(inertia=inertia, orbit=orbit, thrusters=thrusters, **NOISELESS)
    bias = (1e-9, -2e-9, 3e-9)
    fleet = pulsed_fleet(craft, 1, bias_torque=bias)
    begin(fleet)
    rate = np.array([2e-3, -3e-3, 4e-3])
    fleet.write(at.RATE, rate)
    exact = InertialFlight.begin(craft, [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, *rate, craft.mass], orbit.true_anomaly)
    first = exact.axes

    def gradient(place, attitude):
        distance = np.linalg.norm(place)
        up = attitude @ place / distance
        return 3.0 * orbit.gravitational_parameter / distance**3 * np.cross(up, inertia @ up)

    rng, torques = np.random.default_rng(0), craft.wrenches()[3:] * 0.016
    turned = 0.0
    for _ in range(120):
        duties = np.zeros(6)
        duties[rng.integers(6)] = 1.0
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        exact.turn(np.linalg.solve(inertia, torques @ duties))
        exact.fly(1.0, gradients=lambda place, attitude: gradient(place, attitude) + bias)
        turned += np.linalg.norm(gradient(exact.state[:3], exact.state[12:21].reshape(3, 3)))
    assert turned > 1e-7  # N m s: the gradient has not been idle
    found = rotation_matrix(fleet.read(at.ATTITUDE, 4)[0, 0])
    np.testing.assert_allclose(found, exact.state[12:21].reshape(3, 3) @ first.T, rtol=0.0, atol=2e-8)
    np.testing.assert_allclose(fleet.read(at.RATE, 3)[0, 0], exact.state[21:24], rtol=0.0, atol=1e-9)


def identical(spacecraft, worlds, make, dispersed):
    """Whether a batch is its worlds flown alone, bit for bit, under faults and random duties."""
    n = spacecraft.number_of_thrusters
    orbit = dataclasses.replace(spacecraft.orbit, true_anomaly_dispersion=dispersed)
    spacecraft = spacecraft.replace(orbit=orbit)
    rng = np.random.default_rng(7)
    duties = rng.random((6, worlds, 1, n))
    faults = random_faults(np.random.default_rng(3), spacecraft, number=2)
    batch, singles = make(spacecraft, worlds), [make(spacecraft, 1) for _ in range(worlds)]
    begin(batch, faults, seed=40)
    rates = rng.normal(size=(worlds, 1, 3)) * 0.02
    batch.write(at.RATE, rates)
    batch.look(batch.everyone)
    for world, single in enumerate(singles):
        begin(single, faults, seed=40 + world)
        single.write(at.RATE, rates[world : world + 1])
        single.look(single.everyone)
    for row in duties:
        batch.write(batch.rows.duties, row)
        batch.fly()
        for world, single in enumerate(singles):
            single.write(single.rows.duties, row[world : world + 1])
            single.fly()
    whole = batch.read(0, batch.rows.fields)
    assert np.ptp(whole[:, 0, batch.rows.reference]) > 0.0
    for world, single in enumerate(singles):
        np.testing.assert_array_equal(whole[world], single.read(0, batch.rows.fields)[0])


@ORBITS
def test_a_batch_is_its_worlds_flown_alone_bit_for_bit(orbit):
    identical(load("orion").replace(orbit=orbit), 33, Fleet, math.pi)


def test_so_it_is_where_thrusters_pulse():
    identical(load("ppt_cubesat").replace(orbit=ELLIPTIC), 33, pulsed_fleet, 0.5)


@ORBITS
def test_a_measured_rate_change_has_no_drift_left(orbit):
    """Of a craft that coasts past perigee; by Hill's equations it would be up to 6 mm/s a period here."""
    spacecraft = of_orion(orbit, control_period=20.0)
    start = START.copy()
    start[6:] = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    fleet, _ = flying(spacecraft, start)
    for _ in range(40):
        fleet.fly()
        change = fleet.read(at.MEASURED_CHANGE, 6)[0, 0]
        assert np.abs(change).max() < 2e-9
