"""Thrusters behind a modulator: impulses in closed form and by the referee, motion by another solver."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from tests.physics import modulated_reference as referee
from tests.physics.closed_forms import product, rotation_matrix
from tests.physics.flying import begin, fly, random_duties, random_faults
from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.faults.record import GENERAL_KINDS, MODULATOR_KINDS, PROFILES
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.modulated_flight import falling
from thruster_envs.spacecraft import Modulator, Sensors, load

CHASER = load("msr_chaser")
PERIOD = CHASER.control_period
KINDS = (*GENERAL_KINDS, *MODULATOR_KINDS, "sign", "bias")
MARS = CHASER.gravitational_parameter
N = CHASER.mean_motion
UPRIGHT = (0.5, 0.5, 0.5, -0.5)
#: The sine of the delays is good to 1e-11 of 15 ms; relative, and absolute in s.
EXACT = {"rtol": 1e-12, "atol": 2e-13}


def thrusters(**changes):
    return tuple(dataclasses.replace(one, **changes) for one in CHASER.thrusters)


@njit
def _falling(x, out):
    for k in range(x.size):
        out[k] = falling(x[k])


def test_the_falling_exponential_is_exact_to_rounding():
    x = np.concatenate([np.linspace(0.0, 30.0, 30001), [1e-300, 0.5 * math.log(2.0), 300.0, 1e30]])
    out = np.empty_like(x)
    _falling(x, out)
    np.testing.assert_allclose(out[:-1], np.exp(-x[:-1]), rtol=4e-16)
    assert out[0] == 1.0
    assert out[-1] < 1e-300


def test_a_pulse_gives_its_on_time_whatever_its_delay_and_lag():
    duties = np.zeros((40, 8))
    duties[0] = [0.06, 0.1, 0.2, 0.5, 0.8, 1.0, 0.05, 0.04]
    total = fly(CHASER, duties, seed=3).delivered.sum(axis=0)
    expected = PERIOD * np.array([0.06, 0.1, 0.2, 0.5, 0.8, 1.0, 0.05, 0.0])
    np.testing.assert_allclose(total, expected, rtol=1e-12, atol=1e-16)


def test_a_pulse_delayed_by_exactly_a_period_opens_in_the_next_one():
    plain = CHASER.replace(modulator={"delay": 0.1}, thrusters=thrusters(time_constant=0.0))
    delivered = fly(plain, np.array([[0.3] * 8, [0.0] * 8, [0.0] * 8])).delivered
    np.testing.assert_allclose(delivered, [[0.0] * 8, [0.03] * 8, [0.0] * 8], rtol=1e-13, atol=1e-17)


def test_a_lag_spreads_a_pulse_as_an_exponential():
    plain = CHASER.replace(modulator={"delay": 0.04})
    delivered = fly(plain, np.array([[0.3] * 8, [0.0] * 8])).delivered[:, 0]
    closes, tau = 0.07, 0.02
    level = math.exp(-(PERIOD - closes) / tau) - math.exp(-(PERIOD - 0.04) / tau)
    later = level * tau * (1.0 - math.exp(-PERIOD / tau))
    np.testing.assert_allclose(delivered, [0.03 - tau * level, later], rtol=1e-12)


@pytest.mark.parametrize("max_substep", [0.1, 0.03])
def test_pulses_are_exact_at_every_substep(max_substep):
    rng = np.random.default_rng(5)
    duties = random_duties(rng, 40, 8)
    flight = fly(CHASER, duties, seed=11, max_substep=max_substep)
    np.testing.assert_allclose(flight.delivered, referee.delivered(CHASER, duties, seed=11), **EXACT)
    np.testing.assert_allclose(
        flight.impulses, flight.delivered @ CHASER.wrenches().T, rtol=1e-11, atol=1e-12
    )


@pytest.mark.parametrize(
    "modulator",
    [
        Modulator(delay=0.35, variation=0.01, jitter=0.01),  # five pulses are on their way at a time
        Modulator(delay=0.1, variation=0.053, variation_period=7.3, jitter=0.047),  # 0 to 2 periods
    ],
)
def test_delayed_pulses_are_the_referees(modulator):
    late = CHASER.replace(modulator=modulator)
    duties = random_duties(np.random.default_rng(6), 100, 8)
    exact = referee.delivered(late, duties, seed=2)
    sine = 1e-11 * modulator.variation
    np.testing.assert_allclose(fly(late, duties, seed=2).delivered, exact, rtol=1e-12, atol=1e-13 + sine)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_impulse_under_a_fault_is_the_referees(kind, profile):
    """A sine, here of 0.1 to 0.4 s, is followed in parts of 10 ms with straight lines."""
    rng = np.random.default_rng([KINDS.index(kind), PROFILES.index(profile)])
    faults = random_faults(rng, CHASER, number=3, kinds=[kind], profiles=[profile])
    faults = [dataclasses.replace(one, duration=0.9) if one.duration < np.inf else one for one in faults]
    duties = random_duties(rng, 25, 8)
    faulty = [fault.thruster - 1 for fault in faults]
    exact = referee.delivered(CHASER, duties, faulty, faults=faults, seed=4)
    for max_substep in (0.1, 0.04):
        flight = fly(CHASER, duties, faults=faults, seed=4, max_substep=max_substep).delivered
        within = {"rtol": 1e-5, "atol": 1e-6} if profile == "sine" else EXACT
        np.testing.assert_allclose(flight[:, faulty], exact, **within)


def test_several_faults_of_one_thruster_act_in_their_order():
    faults = [
        Fault(2, "loss", severity=0.4, onset=0.33),
        Fault(2, "leak", severity=0.3, onset=0.52, profile="ramp", profile_time=1.0),
        Fault(2, "stuck_on", severity=0.5, onset=1.21, duration=0.4),
        Fault(2, "slow_opening", severity=0.05, onset=0.8),
    ]
    duties = random_duties(np.random.default_rng(1), 25, 8)
    exact = referee.delivered(CHASER, duties, [1], faults=faults, seed=4)[:, 0]
    np.testing.assert_allclose(fly(CHASER, duties, faults=faults, seed=4).delivered[:, 1], exact, **EXACT)


def isolated(faults, shut, duties, seed=4):
    """(K, n) delivered on-times with isolation valves ``shut`` (K, n)."""
    fleet = Fleet(CHASER, 1)
    begin(fleet, faults, seed=seed)
    fleet.look(fleet.everyone)
    rows = []
    for told, closed in zip(duties, shut, strict=True):
        fleet.write(fleet.rows.duties, told)
        fleet.write(fleet.rows.inhibited, closed.astype(float))
        fleet.fly()
        rows.append(fleet.read(fleet.rows.delivered, 8)[0, 0])
    return np.array(rows)


@pytest.mark.parametrize("kind", ["stuck_on", "leak", "loss"])
@pytest.mark.parametrize("profile", ["step", "ramp"])
def test_an_isolation_valve_stops_the_flow_whatever_the_fault_does(kind, profile):
    faults = [Fault(3, kind, severity=0.8, onset=0.25, profile=profile, profile_time=2.0)]
    duties = random_duties(np.random.default_rng(2), 40, 8)
    shut = np.zeros((40, 8), np.bool_)
    shut[8:30, 2], shut[12:14, 5] = True, True
    flown = isolated(faults, shut, duties)
    exact = referee.delivered(CHASER, duties, [2, 5], faults=faults, seed=4, shut=shut)
    np.testing.assert_allclose(flown[:, [2, 5]], exact, **EXACT)
    # Two periods later what was left in the chamber has gone down by ten time constants.
    assert np.all(flown[10:30, 2] < 1e-5)
    assert flown[31, 2] > 0.01 or kind == "loss"


def test_the_open_time_is_that_of_the_valves():
    duties = np.zeros((20, 8))
    duties[:3] = 0.4
    fleet = fly(CHASER, duties).fleet
    assert fleet.read(at.OPEN_TIME)[0, 0, 0] == pytest.approx(3 * 8 * 0.04, rel=1e-12)


def two_body(r, v):
    """Relative acceleration about Mars, LVLH, in the plain form of the equations."""
    radius = (MARS / N**2) ** (1.0 / 3.0)
    e = (2.0 * radius * r[0] + r @ r) / radius**2
    pull = math.expm1(-1.5 * math.log1p(e))
    return np.array(
        [
            2.0 * N * v[1] - N * N * (radius + r[0]) * pull,
            -2.0 * N * v[0] - N * N * r[1] * pull,
            -N * N * r[2] * (1.0 + pull),
        ]
    )


def solved(duties, seed, start, push):
    """State (13,) after a flight, by DOP853 between all corners of the true thrust."""
    vehicle, inertia = CHASER.wrenches(), np.array(CHASER.inertia)
    lines = referee.lines(CHASER, duties, seed=seed)
    tau = CHASER.thrusters[0].time_constant
    corners = sorted({t for line in lines for t in line.corners(len(duties) * PERIOD)})
    state, levels = np.array(start), np.zeros(8)
    for begins, ends in pairwise(corners):
        middle = 0.5 * (begins + ends)
        g = np.array([line.opening(middle, np.array([middle]))[0] for line in lines])

        def derivative(t, y, begins=begins, g=g, levels=levels):
            wrench = vehicle @ (g + (levels - g) * math.exp(-(t - begins) / tau))
            q, rate = y[6:10], y[10:13]
            force = rotation_matrix(q).T @ wrench[:3] / CHASER.mass + push
            turn = 0.5 * (product(q, [0.0, 0.0, 0.0, N]) - product([0.0, *rate], q))
            spin = np.linalg.solve(inertia, wrench[3:] - np.cross(rate, inertia @ rate))
            return np.concatenate([y[3:6], two_body(y[:3], y[3:6]) + force, turn, spin])

        if ends - begins > 1e-13:
            state = solve_ivp(derivative, (begins, ends), state, method="DOP853", rtol=1e-12, atol=1e-13).y[
                :, -1
            ]
        levels = g + (levels - g) * math.exp(-(ends - begins) / tau)
    return state


def test_the_motion_is_that_of_an_independent_solver():
    """Hard firing for 2.5 s, at a rate of 0.1 rad/s, with an acceleration beside the thrust."""
    duties, push = random_duties(np.random.default_rng(9), 25, 8), np.array([3e-3, -2e-3, 1e-3])
    start = (0.4, -20.0, -0.3, 0.01, 0.1, -0.02, *UPRIGHT, 0.06, -0.05, 0.07)
    exact = solved(duties, 21, start, push)
    errors = []
    for max_substep in (0.1, 0.02):
        fleet = Fleet(CHASER, 1, nonlinear=True, max_substep=max_substep)
        begin(fleet, seed=21)
        fleet.write(0, [start])
        fleet.write(fleet.rows.push, push)
        for told in duties:
            fleet.write(fleet.rows.duties, told)
            fleet.fly()
        errors.append(np.abs(fleet.read(0, 13)[0, 0] - exact))
    # m, m/s, 1, rad/s: at the period as the only sub-step a ten thousandth of the noise of the LIDAR
    assert np.all(errors[0] < [2e-7] * 3 + [2e-8] * 3 + [4e-8] * 4 + [5e-9] * 3)
    assert np.all(errors[1] < [1e-9] * 3 + [1e-10] * 3 + [1e-10] * 4 + [2e-11] * 3)


def test_free_motion_is_that_about_mars():
    """An orbit of the planet that the description names: after a period of it a drift-free craft is back."""
    fleet = Fleet(CHASER, 1, nonlinear=True, max_substep=0.1)
    begin(fleet)
    # A small ellipse about the same orbit has the same period if its energy is: a = R.
    radius = (MARS / N**2) ** (1.0 / 3.0)
    r = np.array([50.0, 0.0, 0.0])
    speed = math.sqrt(MARS * (2.0 / (radius + 50.0) - 1.0 / radius))
    velocity = np.array([0.0, speed - N * (radius + 50.0), 0.0])
    exact = solve_ivp(
        lambda _, y: np.concatenate([y[3:], two_body(y[:3], y[3:])]), (0.0, 60.0), [*r, *velocity],
        method="DOP853", rtol=1e-12, atol=1e-12,
    ).y[:, -1]  # fmt: skip
    fleet.write(0, [[*r, *velocity]])
    for _ in range(600):
        fleet.fly()
    np.testing.assert_allclose(fleet.read(0, 6)[0, 0], exact, rtol=0.0, atol=1e-9)


def test_the_errors_of_the_sensors_are_uniform():
    worlds = 4096
    fleet = Fleet(CHASER, worlds)
    begin(fleet)
    fleet.write(at.ATTITUDE, [UPRIGHT])
    for look_again in (lambda: fleet.look(fleet.everyone), fleet.fly):
        look_again()
        error = fleet.read(at.MEASURED, 3)[:, 0] - fleet.read(at.POSITION, 3)[:, 0]
        assert np.abs(error).max() <= 1e-3
        np.testing.assert_allclose(np.abs(error).max(axis=0), 1e-3, rtol=0.01)
        np.testing.assert_allclose(error.std(axis=0), 1e-3 / math.sqrt(3.0), rtol=0.03)
        # Of a uniform distribution the fourth moment is 9/5 of the square of the second.
        np.testing.assert_allclose((error**4).mean(axis=0), 1.8 * 1e-12 / 9.0, rtol=0.06)
    gyro = fleet.read(at.MEASURED + 10, 3)[:, 0] - fleet.read(at.RATE, 3)[:, 0]
    assert np.abs(gyro).max() <= math.radians(0.005) * (1.0 + 1e-12)


def test_what_is_true_of_a_craft_may_differ_from_the_description():
    """Mass and wrenches of one world of two: impulse by the true wrench, acceleration by the true mass."""
    fleet = Fleet(CHASER, 2)
    begin(fleet)
    fleet.write(at.ATTITUDE, [UPRIGHT])
    columns = fleet.read(fleet.rows.columns, 48)
    columns[1] *= 1.1
    fleet.write(fleet.rows.columns, columns)
    mass = np.full((2, 1, 1), 1500.0)
    mass[1] = 1200.0
    fleet.write(at.MASS, mass)
    impulse = np.zeros((2, 6))
    fleet.write(fleet.rows.duties, [[1.0, 1.0, 0, 0, 0, 0, 1.0, 1.0]])
    for _ in range(3):
        fleet.fly()
        impulse += fleet.read(at.IMPULSE, 6)[:, 0]
    velocity = fleet.read(at.VELOCITY, 3)[:, 0]
    assert velocity[0, 1] == pytest.approx(impulse[0, 0] / 1500.0, rel=1e-4)
    assert velocity[1, 1] == pytest.approx(impulse[1, 0] / 1200.0, rel=1e-4)
    delivered = fleet.read(fleet.rows.delivered, 8)[:, 0]
    np.testing.assert_allclose(
        fleet.read(at.IMPULSE, 6)[:, 0], (delivered @ CHASER.wrenches().T) * [[1.0], [1.1]], atol=1e-12
    )


def test_expected_change_is_that_of_the_nominal_delay_and_lag():
    """A single whole pulse, nominally from 0.12 to 0.22 s by its delay and the time constant of its lag."""
    fleet = Fleet(CHASER, 1)
    begin(fleet)
    seen = []
    for duty in (1.0, 0.0, 0.0, 0.0):
        fleet.write(fleet.rows.duties, [[duty, 0, 0, 0, 0, 0, 0, 0]])
        fleet.fly()
        seen.append(fleet.read(at.EXPECTED_CHANGE, 6)[0, 0])
    column = CHASER.effectiveness()[:, 0]
    for change, on_time in zip(seen, (0.0, 0.08, 0.02, 0.0), strict=True):
        np.testing.assert_allclose(change, on_time * column, rtol=1e-12, atol=1e-18)


FAULTS = FaultDistribution(
    probability=0.8, kinds=KINDS, count=(1, 3), onset=(0.0, 5.0), duration=(1.0, 9.0), profiles=PROFILES,
    severity={"late_opening": (0.01, 0.05)}, dwell=(0.2, 0.8),
)  # fmt: skip


def flown(worlds, *, first=0, threads=None, periods=60):
    """Rows (worlds, fields) after the flight of the worlds from number ``first`` on."""
    fleet = Fleet(CHASER, worlds, nonlinear=True, threads=threads)
    begin(fleet, FAULTS, seed=40 + first)
    fleet.look(fleet.everyone)
    rng = [np.random.default_rng([first + world, 1]) for world in range(worlds)]
    duties = np.array([random_duties(one, periods, 8) for one in rng])
    for period in range(periods):
        fleet.write(fleet.rows.duties, duties[:, period, None])
        fleet.write(fleet.rows.inhibited, (duties[:, period, None] > 0.97).astype(float))
        fleet.fly()
    return fleet.read(0, fleet.rows.fields)[:, 0]


def test_a_world_in_a_batch_is_the_world_alone_on_any_number_of_threads():
    many = flown(70)
    assert np.all(np.isfinite(many))
    assert np.array_equal(flown(70, threads=3), many)
    assert np.array_equal(flown(7), many[:7])
    for world in range(0, 70, 3):
        assert np.array_equal(flown(1, first=world)[0], many[world])


def test_errors_that_are_called_normal_are_normal():
    normal = dataclasses.replace(CHASER.sensors, distribution="normal")
    fleet = Fleet(CHASER.replace(sensors=Sensors(**dataclasses.asdict(normal))), 4096)
    begin(fleet)
    fleet.fly()
    error = fleet.read(at.MEASURED, 3)[:, 0] - fleet.read(at.POSITION, 3)[:, 0]
    np.testing.assert_allclose((error**4).mean(axis=0), 3.0 * 1e-12 / 9.0, rtol=0.12)
