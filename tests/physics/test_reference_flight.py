"""The referee against what is known without it: closed forms, conservation laws, areas, an example."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tests.physics.closed_forms import (
    EARTH_GRAVITATIONAL_PARAMETER,
    angular_momentum,
    conjugate,
    hcw_constant_acceleration,
    hcw_transition,
    inertial_from_lvlh,
    inertial_state,
    product,
    relative_energy,
    rotate,
    rotation_angle,
    rotation_matrix,
    rotation_quaternion,
    rotational_energy,
    torque_free_axisymmetric,
)
from tests.physics.reference_flight import STANDARD_GRAVITY, FlightState, delivered_impulse, fly, tilted
from thruster_envs.faults import Fault
from thruster_envs.spacecraft import Feed, Spacecraft, Thruster, load

N = 0.0011
THRUST = 2.0
PERIOD = 5.0
EXACT = {"rel": 1e-12, "abs": 1e-13}
"""Round-off of sums and products of a few numbers of order one."""


def spacecraft(number_of_thrusters=1, *, coupling=0.0, propellant_mass=math.inf, mean_motion=N, **valve):
    """Thrusters of 2 N through the centre of mass along +x, on a body of 10 kg with a period of 5 s."""
    thrusters = [
        Thruster(name=str(number), position=(0, 0, 0), direction=(1, 0, 0), thrust=THRUST, **valve)
        for number in range(1, number_of_thrusters + 1)
    ]
    return Spacecraft(
        name="test",
        mass=10.0,
        inertia=((0.5, 0.0, 0.0), (0.0, 0.7, 0.0), (0.0, 0.0, 0.9)),
        thrusters=tuple(thrusters),
        feed=Feed(coupling=coupling, propellant_mass=propellant_mass),
        control_period=PERIOD,
        mean_motion=mean_motion,
    )


def open_time(duties, *, faults=(), **valve):
    """Seconds of full thrust that one thruster delivers in each period."""
    return delivered_impulse(spacecraft(**valve), np.reshape(duties, (-1, 1)), faults=faults)[:, 0] / THRUST


def with_inertia(inertia):
    return load("orion").replace(inertia=inertia)


class TestClosedForms:
    @pytest.fixture
    def system(self):
        system = np.zeros((9, 9))  # position, velocity, constant acceleration
        system[0:3, 3:6] = np.eye(3)
        system[3:6, 6:9] = np.eye(3)
        system[3, 0], system[5, 2] = 3.0 * N**2, -(N**2)
        system[3, 4], system[4, 3] = 2.0 * N, -2.0 * N
        return system

    @pytest.mark.parametrize("time", [5.0, 600.0, 5700.0])
    def test_hill_solution_is_the_exponential_of_its_system(self, system, time):
        scale = np.array([1.0, 1.0, 1.0, N, N, N, N**2, N**2, N**2])  # lengths, so that all entries count
        expected = expm(system * time) * scale / scale[:, np.newaxis]
        transition = np.hstack([hcw_transition(N, time), hcw_constant_acceleration(N, time)])
        # Each entry of the solution for an acceleration is a difference that loses digits for small n t.
        np.testing.assert_allclose(
            transition * scale / scale[:6, np.newaxis], expected[:6], rtol=1e-8, atol=1e-13
        )

    def test_hill_transition_over_two_times_is_the_product(self):
        np.testing.assert_allclose(
            hcw_transition(N, 700.0),
            hcw_transition(N, 300.0) @ hcw_transition(N, 400.0),
            rtol=1e-12,
            atol=1e-15,
        )

    def test_slow_orbit_tends_to_free_drift(self):
        np.testing.assert_allclose(hcw_transition(1e-9, 10.0), hcw_transition(0.0, 10.0), atol=1e-6)
        np.testing.assert_allclose(
            hcw_constant_acceleration(1e-6, 10.0), hcw_constant_acceleration(0.0, 10.0), atol=1e-2
        )

    def test_quaternion_algebra(self):
        quarter_turn = rotation_quaternion([0.0, 0.0, math.pi / 2])
        np.testing.assert_allclose(rotate(quarter_turn, [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-15)
        np.testing.assert_array_equal(product([0, 1, 0, 0], [0, 0, 1, 0]), [0, 0, 0, 1])  # i j = k
        attitude, vector = rotation_quaternion([0.3, -1.2, 0.7]), np.array([1.0, 2.0, -3.0])
        np.testing.assert_allclose(rotation_matrix(attitude) @ vector, rotate(attitude, vector), rtol=1e-14)
        assert rotation_angle(-rotation_quaternion([0.0, 1e-9, 0.0]), [1.0, 0.0, 0.0, 0.0]) == pytest.approx(
            1e-9
        )

    def test_regular_precession_keeps_angular_momentum(self):
        attitude, rate = rotation_quaternion([0.4, 0.2, -1.0]), np.array([0.05, -0.02, 0.3])
        inertia = np.diag([0.6, 0.6, 0.4])
        before = angular_momentum(inertia, attitude, rate, 0.0, N)
        after = angular_momentum(
            inertia, *torque_free_axisymmetric(0.6, 0.4, attitude, rate, 250.0, N), 250.0, N
        )
        np.testing.assert_allclose(after, before, rtol=1e-12)


class TestCoasting:
    def test_follows_the_hill_solution(self):
        initial = FlightState(position=(30.0, -250.0, 12.0), velocity=(0.2, -0.1, 0.05))
        flight = fly(spacecraft(), np.zeros((60, 1)), initial=initial)
        start = np.concatenate([flight.position[0], flight.velocity[0]])
        expected = np.array([hcw_transition(N, time) @ start for time in flight.time])
        np.testing.assert_allclose(flight.position, expected[:, :3], rtol=0, atol=1e-9)
        np.testing.assert_allclose(flight.velocity, expected[:, 3:], rtol=0, atol=1e-12)

    def test_nonlinear_motion_is_two_bodies_falling(self):
        initial = FlightState(position=(3000.0, -8000.0, 2000.0), velocity=(2.0, -1.0, 3.0))
        flight = fly(spacecraft(), np.zeros((120, 1)), initial=initial, dynamics="nonlinear")
        position, velocity = inertial_state(flight.position[0], flight.velocity[0], N, 0.0)
        expected = inertial_motion(position, velocity, 600.0)
        actual = np.concatenate(inertial_state(flight.position[-1], flight.velocity[-1], N, 600.0))
        # Seven million metres, held by doubles to 1e-9 m each step.
        np.testing.assert_allclose(actual[:3], expected[:3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(actual[3:], expected[3:], rtol=0, atol=1e-9)

    def test_nonlinear_motion_keeps_jacobis_constant(self):
        initial = FlightState(position=(3000.0, -8000.0, 2000.0), velocity=(2.0, -1.0, 3.0))
        vehicle = spacecraft().replace(control_period=60.0)
        flight = fly(vehicle, np.zeros((95, 1)), initial=initial, dynamics="nonlinear")
        energies = [relative_energy(*each, N) for each in zip(flight.position, flight.velocity, strict=True)]
        np.testing.assert_allclose(energies, energies[0], rtol=1e-10)

    def test_nonlinear_motion_tends_to_hills_for_small_distances(self):
        initial = FlightState(position=(0.3, -0.2, 0.1), velocity=(1e-4, 2e-4, -1e-4))
        linear, exact = (
            fly(spacecraft(), np.zeros((120, 1)), initial=initial, dynamics=dynamics)
            for dynamics in ("hcw", "nonlinear")
        )
        # The difference is of the order of distance^2 / R.
        np.testing.assert_allclose(exact.position, linear.position, rtol=0, atol=1e-7)

    def test_axisymmetric_body_precesses_regularly(self):
        vehicle = with_inertia(((0.6, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, 0.0, 0.4)))
        initial = FlightState(attitude=rotation_quaternion([0.4, 0.2, -1.0]), rate=(0.05, -0.02, 0.3))
        flight = fly(vehicle, np.zeros((60, 12)), initial=initial)
        for time, attitude, rate in zip(flight.time, flight.attitude, flight.rate, strict=True):
            expected = torque_free_axisymmetric(0.6, 0.4, initial.attitude, initial.rate, time, N)
            assert rotation_angle(attitude, expected[0]) < 1e-10
            np.testing.assert_allclose(rate, expected[1], rtol=0, atol=1e-12)

    def test_tumbling_keeps_angular_momentum_and_energy_over_an_orbit(self):
        inertia = ((0.6, 0.02, -0.01), (0.02, 0.8, 0.03), (-0.01, 0.03, 0.5))
        vehicle = with_inertia(inertia).replace(control_period=60.0)
        flight = fly(vehicle, np.zeros((95, 12)), initial=FlightState(rate=(0.02, 0.05, -0.03)))
        momenta = np.array(
            [
                angular_momentum(inertia, attitude, rate, time, N)
                for time, attitude, rate in zip(flight.time, flight.attitude, flight.rate, strict=True)
            ]
        )
        size = np.linalg.norm(momenta[0])
        np.testing.assert_allclose(
            momenta, np.broadcast_to(momenta[0], momenta.shape), rtol=0, atol=1e-10 * size
        )
        energies = [rotational_energy(inertia, rate) for rate in flight.rate]
        np.testing.assert_allclose(energies, energies[0], rtol=1e-10)
        np.testing.assert_allclose(np.linalg.norm(flight.attitude, axis=1), 1.0, rtol=1e-15)

    def test_craft_that_turns_with_the_orbit_stays_aligned(self):
        flight = fly(load("orion"), np.zeros((20, 12)), initial=FlightState(rate=(0.0, 0.0, N)))
        assert rotation_angle(flight.attitude[-1], [1.0, 0.0, 0.0, 0.0]) < 1e-12

    def test_craft_at_inertial_rest_is_left_behind_by_the_orbit(self):
        flight = fly(load("orion"), np.zeros((20, 12)))
        np.testing.assert_allclose(flight.attitude[-1], inertial_from_lvlh(N, 100.0), rtol=0, atol=1e-12)


def inertial_motion(position, velocity, time, acceleration=(0.0, 0.0, 0.0)):
    """Two-body motion in inertial axes with a constant further acceleration, (6,)."""

    def derivative(_, state):
        pull = -EARTH_GRAVITATIONAL_PARAMETER * state[:3] / np.linalg.norm(state[:3]) ** 3
        return np.concatenate([state[3:], pull + np.array(acceleration)])

    start = np.concatenate([position, velocity])
    return solve_ivp(derivative, (0.0, time), start, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]


class TestForceAndTorque:
    def test_yangs_example_loses_eighteen_percent_to_the_feed(self):
        # Commanded -0.027 m/s on x and y; 4.5 s on thrusters 1, 6, 10 and 12 gives -0.02214 m/s.
        orion = load("orion").replace(mean_motion=1e-12)
        duties = np.zeros((1, 12))
        duties[0, [0, 5, 9, 11]] = 4.5 / 5.0
        flight = fly(orion, duties)
        np.testing.assert_allclose(flight.velocity[-1], [-0.02214, -0.02214, 0.0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(flight.rate[-1], 0.0, atol=1e-15)
        np.testing.assert_allclose(
            flight.impulse[0, [0, 5, 9, 11]], 0.060 * 4.5 * (1.0 - 3 * 0.06), rtol=1e-14
        )

    def test_constant_thrust_in_lvlh_follows_hills_forced_solution(self):
        orion = load("orion")
        duties = np.zeros((1, 12))
        duties[0, [0, 9]] = 1.0  # both push along -x, without torque
        flight = fly(orion, duties, initial=FlightState(rate=(0.0, 0.0, N)))
        acceleration = np.array([-2.0 * 0.060 * 0.94 / 20.0, 0.0, 0.0])
        expected = hcw_constant_acceleration(N, PERIOD) @ acceleration
        # The closed form of a position loses digits where n t is small: 1 / (n t)^2 of them.
        np.testing.assert_allclose(flight.position[-1], expected[:3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(flight.velocity[-1], expected[3:], rtol=0, atol=1e-14)

    def test_thrust_of_an_inertially_fixed_craft_keeps_its_inertial_direction(self):
        vehicle = spacecraft(mean_motion=N)
        attitude = rotation_quaternion([0.5, -0.8, 1.3])
        flight = fly(vehicle, np.ones((120, 1)), initial=FlightState(attitude=attitude), dynamics="nonlinear")
        acceleration = rotate(conjugate(attitude), [THRUST / 10.0, 0.0, 0.0])  # LVLH is inertial at t = 0
        start = inertial_state([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], N, 0.0)
        expected = inertial_motion(*start, 600.0, acceleration)
        actual = np.concatenate(inertial_state(flight.position[-1], flight.velocity[-1], N, 600.0))
        np.testing.assert_allclose(actual[:3], expected[:3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(actual[3:], expected[3:], rtol=0, atol=1e-9)

    def test_couple_about_a_principal_axis_spins_up_linearly(self):
        orion = load("orion").replace(feed=Feed(), mean_motion=1e-12)
        duties = np.zeros((1, 12))
        duties[0, [0, 3]] = 1.0  # -x and +x, with levers that add up about z and cancel about y
        acceleration = orion.effectiveness()[3:, [0, 3]].sum(axis=1)
        flight = fly(orion, duties)
        np.testing.assert_allclose(acceleration[:2], 0.0, atol=1e-15)
        assert flight.rate[-1, 2] == pytest.approx(acceleration[2] * PERIOD, rel=1e-12)
        turn = rotation_quaternion([0.0, 0.0, 0.5 * acceleration[2] * PERIOD**2])
        assert rotation_angle(flight.attitude[-1], conjugate(turn)) < 1e-10  # body-from-LVLH turns frames
        np.testing.assert_allclose(flight.position[-1], 0.0, atol=1e-15)

    def test_scatter_scales_each_thruster_of_each_period(self):
        scatter = np.array([[0.1, -0.05], [0.0, 0.08]])
        impulse = delivered_impulse(spacecraft(2), np.full((2, 2), 0.5), scatter=scatter)
        np.testing.assert_allclose(impulse, THRUST * 0.5 * PERIOD * (1.0 + scatter), rtol=1e-14)


class TestValves:
    """Seconds of full thrust, from areas under trapezoids worked out by hand."""

    def test_ideal_valve_delivers_the_command(self):
        np.testing.assert_allclose(
            open_time([0.0, 0.3, 1.0, 1.0, 0.01]), [0.0, 1.5, 5.0, 5.0, 0.05], rtol=1e-14
        )

    @pytest.mark.parametrize("on_time", [0.5, 2.0, 4.0])
    def test_trapezoid(self, on_time):
        area = open_time(
            [on_time / PERIOD, 0.0], opening_delay=0.1, closing_delay=0.3, rise_time=0.4, fall_time=0.2
        )
        assert area.sum() == pytest.approx(on_time + 0.3 - 0.1 - 0.4 / 2 + 0.2 / 2, **EXACT)

    def test_triangle_when_the_valve_closes_before_it_is_fully_open(self):
        area = open_time([0.2 / PERIOD], rise_time=0.8, fall_time=0.4)  # a quarter open
        assert area[0] == pytest.approx(0.5 * 0.25 * (0.2 + 0.1), **EXACT)

    @pytest.mark.parametrize("duty", [0.02, 0.5, 0.97, 1.0])
    def test_equal_delays_move_a_pulse_and_keep_its_area(self, duty):
        area = open_time([duty, 0.0, 0.0], opening_delay=0.35, closing_delay=0.35)
        assert area.sum() == pytest.approx(duty * PERIOD, **EXACT)
        assert area[1] == pytest.approx(max(0.0, duty * PERIOD + 0.35 - PERIOD), **EXACT)

    def test_tail_is_delivered_in_the_next_period(self):
        area = open_time([0.9, 0.0], closing_delay=0.75, fall_time=0.5)
        assert area == pytest.approx([5.0, 0.25 + 0.25], **EXACT)

    def test_fall_goes_on_over_several_periods(self):
        area = open_time([1.0, 0.0, 0.0, 0.0], fall_time=10.0)
        assert area == pytest.approx([5.0, 5.0 * 0.75, 5.0 * 0.25, 0.0], **EXACT)

    def test_rise_goes_on_over_several_periods(self):
        area = open_time([1.0, 1.0, 1.0], rise_time=10.0)
        assert area == pytest.approx([5.0 * 0.25, 5.0 * 0.75, 5.0], **EXACT)

    def test_command_shorter_than_the_minimum_pulse_opens_nothing(self):
        area = open_time([0.0999, 0.1, 0.2], minimum_pulse=0.5)
        assert area == pytest.approx([0.0, 0.5, 1.0], **EXACT)

    def test_no_command_opens_nothing_though_the_closing_delay_is_longer(self):
        assert open_time([0.0, 0.0], opening_delay=0.1, closing_delay=0.5).sum() == 0.0

    def test_pulse_that_would_close_before_it_opens_never_opens(self):
        assert open_time([0.1, 0.0], opening_delay=0.7, closing_delay=0.2).sum() == 0.0
        assert open_time([0.1, 0.0], opening_delay=0.7, closing_delay=0.25).sum() == pytest.approx(0.05)

    def test_command_to_the_end_and_on_pays_its_delays_once(self):
        area = open_time([1.0, 1.0, 0.4, 0.0], opening_delay=0.5, closing_delay=0.2)
        assert area == pytest.approx([4.5, 5.0, 2.2, 0.0], **EXACT)

    def test_command_that_ends_just_before_the_period_pays_its_delays_again(self):
        area = open_time([0.98, 1.0, 0.0], opening_delay=0.5, closing_delay=0.2)
        # Open on [0.5, 5.1) and [5.5, 10.2).
        assert area == pytest.approx([4.5, 0.1 + 4.5, 0.2], **EXACT)

    def test_tail_that_reaches_the_next_opening_merges_with_it(self):
        area = open_time([0.98, 0.2, 0.0], opening_delay=0.5, closing_delay=0.6, rise_time=0.1, fall_time=0.1)
        # Open on [0.5, 5.5) and [5.5, 6.6): the valve never begins to close in between.
        assert area == pytest.approx([4.45, 1.6 + 0.05, 0.0], **EXACT)

    def test_valve_that_reopens_while_falling_rises_from_where_it_is(self):
        area = open_time([0.9, 0.5], rise_time=1.0, fall_time=1.0)
        # Level 1 at 4.5 s, 0.5 at the period's end, 1 again at 0.5 s, closing at 2.5 s.
        assert area == pytest.approx([4.0 + 0.375, 0.375 + 2.0 + 0.5], **EXACT)

    def test_run_ends_with_a_command_below_the_minimum_pulse(self):
        area = open_time([1.0, 0.05, 1.0], opening_delay=0.5, closing_delay=0.2, minimum_pulse=0.5)
        assert area == pytest.approx([4.5, 0.2, 4.5], **EXACT)

    def test_run_after_a_delay_longer_than_the_period(self):
        area = open_time([1.0, 1.0, 0.6, 0.0], opening_delay=7.0, closing_delay=0.5)
        assert area == pytest.approx([0.0, 3.0, 3.5, 0.0], **EXACT)

    def test_pulse_that_opens_after_its_period(self):
        area = open_time([0.9, 0.0], opening_delay=5.2, closing_delay=1.0)
        assert area == pytest.approx([0.0, 0.3], **EXACT)

    def test_delays_longer_than_several_periods_keep_all_pulses(self):
        area = open_time([0.2, 0.4, 0.6, 0.0, 0.0, 0.0, 0.0], opening_delay=12.0, closing_delay=12.0)
        assert area == pytest.approx([0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0], **EXACT)

    def test_pulse_has_the_same_area_however_late_it_comes(self):
        duties = np.full(2000, 0.123)
        area = open_time(duties, opening_delay=0.05, closing_delay=0.02, rise_time=0.01, fall_time=0.03)
        np.testing.assert_allclose(area, 0.615 - 0.05 + 0.02 + 0.01, rtol=1e-14)

    def test_random_pulses_have_the_area_that_their_definition_gives(self):
        # Open at t if t lies in [begin + opening delay, end + closing delay) of a run of commands.
        generator = np.random.default_rng(3)
        moments = (np.arange(200_000) + 0.5) * (10 * PERIOD / 200_000)
        for _ in range(10):
            opening, closing = generator.uniform(0.0, 4.0, size=2)
            duties = np.where(generator.random(10) < 0.4, 1.0, generator.choice([0.0, 0.3, 0.7, 0.95], 10))
            is_open = np.zeros(moments.size, dtype=bool)
            begin = None
            for number, duty in enumerate(duties):
                if duty > 0.0 and begin is None:
                    begin = number * PERIOD
                goes_on = duty == 1.0 and number < 9 and duties[number + 1] > 0.0
                if begin is not None and not goes_on:
                    end = (number + duty) * PERIOD
                    is_open |= (moments >= begin + opening) & (moments < end + closing)
                    begin = None
            expected = is_open.reshape(10, -1).mean(axis=1) * PERIOD
            area = open_time(duties, opening_delay=opening, closing_delay=closing)
            np.testing.assert_allclose(area, expected, rtol=0, atol=4 * 50.0 / 200_000)  # edges in a period


class TestFaults:
    def test_stuck_off_takes_its_share_while_it_is_active(self):
        fault = Fault(1, "stuck_off", severity=0.7, onset=1.0, duration=2.0)  # begins and ends in the pulse
        assert open_time([0.8, 0.8], faults=[fault]) == pytest.approx([1.0 + 0.3 * 2.0 + 1.0, 4.0], **EXACT)

    def test_dead_thruster_loses_its_tail_too(self):
        fault = Fault(1, "stuck_off", onset=5.1)
        assert open_time([1.0, 0.0], faults=[fault], closing_delay=0.5) == pytest.approx([5.0, 0.1], **EXACT)

    def test_recovered_thruster_has_the_level_that_it_would_have_had(self):
        fault = Fault(1, "stuck_off", duration=6.0)
        area = open_time([1.0, 1.0], faults=[fault], rise_time=8.0)
        assert area == pytest.approx([0.0, 0.5 * (6.0 / 8.0 + 1.0) * 2.0 + 2.0], **EXACT)

    def test_stuck_on_holds_its_opening_whatever_is_commanded(self):
        fault = Fault(1, "stuck_on", severity=0.6, onset=2.0)
        assert open_time([0.0, 0.5, 1.0], faults=[fault]) == pytest.approx([0.6 * 3.0, 3.0, 3.0], **EXACT)

    def test_stuck_on_comes_and_goes_with_an_intermittent_profile(self):
        fault = Fault(1, "stuck_on", profile="intermittent", profile_time=2.0, dwell=0.25)
        # Open on [0, 0.5), [2, 2.5), [4, 4.5) and by command until 1.
        assert open_time([0.2], faults=[fault]) == pytest.approx([1.0 + 1.0], **EXACT)

    def test_leak_fills_what_the_command_leaves_closed(self):
        fault = Fault(1, "leak", severity=0.3)
        assert open_time([0.0, 0.4, 1.0], faults=[fault]) == pytest.approx([1.5, 2.0 + 0.9, 5.0], **EXACT)

    def test_leak_on_a_rising_valve(self):
        area = open_time([1.0], faults=[Fault(1, "leak", severity=0.3)], rise_time=2.0)
        assert area[0] == pytest.approx(5.0 - 0.7 * 1.0, **EXACT)

    def test_two_leaks_compose(self):
        faults = [Fault(1, "leak", severity=0.3), Fault(1, "leak", severity=0.5)]
        assert open_time([0.0], faults=faults) == pytest.approx([5.0 * (1.0 - 0.7 * 0.5)], **EXACT)

    def test_dead_valve_neither_leaks_nor_sticks_open_in_either_order(self):
        dead = Fault(1, "stuck_off")
        for other in (Fault(1, "leak", severity=0.4), Fault(1, "stuck_on")):
            for faults in ([dead, other], [other, dead]):
                assert open_time([0.5], faults=faults)[0] == 0.0

    def test_the_last_of_several_stuck_on_holds(self):
        faults = [Fault(1, "stuck_on", severity=0.8), Fault(1, "stuck_on", severity=0.2)]
        assert open_time([1.0], faults=faults) == pytest.approx([1.0], **EXACT)

    def test_loss_takes_thrust_but_no_flow(self):
        vehicle = spacecraft(specific_impulse=200.0, propellant_mass=5.0)
        faults = [Fault(1, "stuck_on", severity=0.4), Fault(1, "loss", severity=0.5)]
        flight = fly(vehicle, [[0.0]], faults=faults)
        assert flight.impulse[0, 0] == pytest.approx(THRUST * PERIOD * 0.4 * 0.5, **EXACT)
        assert flight.propellant[0] == pytest.approx(
            THRUST * PERIOD * 0.4 / (200.0 * STANDARD_GRAVITY), **EXACT
        )

    def test_intermittent_thruster_works_outside_its_dwell(self):
        fault = Fault(1, "intermittent", onset=0.5, profile_time=2.0, dwell=0.75)
        # Dead on [0.5, 2), [2.5, 4), [4.5, 6), ...: alive 0.5 s before, then 0.5 s in every 2 s.
        assert open_time([1.0, 1.0], faults=[fault]) == pytest.approx([1.5, 1.0], **EXACT)

    def test_ramp_rises_linearly_and_stays(self):
        fault = Fault(1, "loss", severity=0.6, onset=1.0, profile="ramp", profile_time=6.0)
        # In the first period four of six seconds of the ramp; it ends at 7 s.
        expected = [5.0 - 0.5 * 0.4 * 4.0, 5.0 - (0.5 * (0.4 + 0.6) * 2.0 + 0.6 * 3.0)]
        assert open_time([1.0, 1.0], faults=[fault]) == pytest.approx(expected, **EXACT)

    def test_stuck_on_ramp_begins_closed(self):
        fault = Fault(1, "stuck_on", profile="ramp", profile_time=5.0)
        assert open_time([1.0], faults=[fault]) == pytest.approx([2.5], **EXACT)

    def test_whole_sine_takes_half_its_severity(self):
        for profile_time in (5.0, 0.5, 0.05):
            fault = Fault(1, "loss", severity=0.8, profile="sine", profile_time=profile_time)
            assert open_time([1.0], faults=[fault]) == pytest.approx([5.0 * 0.6], **EXACT)

    def test_part_of_a_sine(self):
        fault = Fault(1, "loss", severity=0.8, onset=2.0, profile="sine", profile_time=7.0)
        lost = 0.8 * 0.5 * (3.0 - math.sin(math.tau * 3.0 / 7.0) * 7.0 / math.tau)
        assert open_time([1.0], faults=[fault]) == pytest.approx([5.0 - lost], **EXACT)

    def test_ramps_on_a_rising_valve_multiply(self):
        faults = [Fault(1, kind, profile="ramp", profile_time=5.0) for kind in ("loss", "stuck_off")]
        area = open_time([1.0], faults=faults, rise_time=5.0)  # integral of t (1 - t)^2 over 0..1, times 5 s
        assert area[0] == pytest.approx(5.0 / 12.0, **EXACT)

    def test_late_opening_delays_each_command(self):
        fault = Fault(1, "late_opening", severity=0.8)
        assert open_time([0.4, 0.1, 0.4], faults=[fault]) == pytest.approx([1.2, 0.0, 1.2], **EXACT)

    def test_late_opening_counts_at_the_moment_of_the_command(self):
        fault = Fault(1, "late_opening", severity=2.0, onset=1.0, profile="ramp", profile_time=8.0)
        # None at 0 s, half of it at 5 s, all of it at 10 s.
        assert open_time([0.8, 0.8, 0.8], faults=[fault]) == pytest.approx([4.0, 3.0, 2.0], **EXACT)
        fault = Fault(1, "late_opening", severity=2.0, onset=5.0, duration=5.0)
        assert open_time([0.8, 0.8, 0.8], faults=[fault]) == pytest.approx([4.0, 2.0, 4.0], **EXACT)

    def test_late_opening_does_not_touch_a_run_that_has_begun(self):
        fault = Fault(1, "late_opening", severity=2.0, onset=1.0)
        assert open_time([1.0, 0.8, 0.8], faults=[fault]) == pytest.approx([5.0, 4.0, 2.0], **EXACT)

    def test_late_openings_add_to_each_other_and_to_the_delay(self):
        faults = [Fault(1, "late_opening", severity=0.5), Fault(1, "late_opening", severity=0.25)]
        assert open_time([0.8], faults=faults, opening_delay=0.1) == pytest.approx([4.0 - 0.85], **EXACT)

    def test_late_opening_beyond_the_period_keeps_a_run_closed_until_then(self):
        fault = Fault(1, "late_opening", severity=11.0)
        assert open_time([1.0] * 4, faults=[fault]) == pytest.approx([0.0, 0.0, 4.0, 5.0], **EXACT)

    def test_misalignment_tilts_by_its_severity_towards_its_azimuth(self):
        # Along x, the axes y and z are equally misaligned; the first is taken: x cross y = z, x cross z = -y.
        direction = np.array([1.0, 0.0, 0.0])
        np.testing.assert_allclose(tilted(direction, math.pi / 2, 0.0), [0.0, 0.0, 1.0], atol=1e-15)
        np.testing.assert_allclose(tilted(direction, math.pi / 2, math.pi / 2), [0.0, -1.0, 0.0], atol=1e-15)
        slanted = np.array([0.2, -0.5, math.sqrt(1.0 - 0.29)])
        for azimuth in (0.0, 1.0, 4.0):
            turned = tilted(slanted, 0.3, azimuth)
            assert np.linalg.norm(turned) == pytest.approx(1.0, rel=1e-15)
            assert turned @ slanted == pytest.approx(math.cos(0.3), rel=1e-14)

    def test_misalignment_ramp_turns_the_force_through_an_arc(self):
        vehicle = spacecraft(mean_motion=1e-12)
        fault = Fault(1, "misalignment", severity=1.2, profile="ramp", profile_time=PERIOD)
        flight = fly(vehicle, [[1.0]], faults=[fault])
        gain = THRUST / 10.0 * PERIOD / 1.2
        expected = [gain * math.sin(1.2), 0.0, gain * (1.0 - math.cos(1.2))]
        np.testing.assert_allclose(flight.velocity[-1], expected, rtol=0, atol=1e-11)
        assert flight.impulse[0, 0] == pytest.approx(THRUST * PERIOD, **EXACT)

    def test_misaligned_thrust_turns_the_craft_with_the_same_lever(self):
        orion = with_inertia(((0.6, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, 0.0, 0.6)))  # no gyroscopic torque
        thruster = orion.thrusters[0]
        duties = np.zeros((1, 12))
        duties[0, 0] = 1.0
        flight = fly(orion, duties, faults=[Fault(1, "misalignment", severity=0.4, azimuth=2.0)])
        force = tilted(np.array(thruster.direction), 0.4, 2.0) * thruster.thrust
        expected = np.cross(thruster.position, force) / 0.6 * PERIOD
        np.testing.assert_allclose(flight.rate[-1], expected, rtol=0, atol=1e-13)

    def test_fault_of_another_craft_is_not_mine(self):
        vehicle, faults = spacecraft(), [Fault(1, "stuck_off", craft=2)]
        assert delivered_impulse(vehicle, [[0.5]], faults=faults)[0, 0] == pytest.approx(THRUST * 2.5)
        assert delivered_impulse(vehicle, [[0.5]], faults=faults, craft=2)[0, 0] == 0.0


class TestFeed:
    def test_each_further_open_thruster_takes_its_share(self):
        impulse = delivered_impulse(spacecraft(3, coupling=0.1), [[0.2, 0.6, 1.0]])[0] / THRUST
        assert impulse == pytest.approx([0.8, 0.8 + 1.8, 0.8 + 1.8 + 2.0], **EXACT)

    def test_partly_open_valves_take_part(self):
        vehicle = spacecraft(2, coupling=0.06, rise_time=2.0)
        impulse = delivered_impulse(vehicle, [[1.0, 1.0]])[0] / THRUST
        assert impulse == pytest.approx([2.0 * (1 / 2 - 0.06 / 3) + 3.0 * 0.94] * 2, **EXACT)

    def test_leaks_and_stuck_valves_take_part_and_dead_ones_do_not(self):
        vehicle = spacecraft(2, coupling=0.1)
        leak = delivered_impulse(vehicle, [[1.0, 0.0]], faults=[Fault(2, "leak", severity=0.4)])[0] / THRUST
        assert leak == pytest.approx([5.0 * (1 - 0.04), 5.0 * 0.4 * 0.9], **EXACT)
        dead = delivered_impulse(vehicle, [[1.0, 1.0]], faults=[Fault(2, "stuck_off")])[0] / THRUST
        assert dead == pytest.approx([5.0, 0.0], **EXACT)
        weak = delivered_impulse(vehicle, [[1.0, 1.0]], faults=[Fault(2, "loss")])[0] / THRUST
        assert weak == pytest.approx([5.0 * 0.9, 0.0], **EXACT)

    def test_thrust_never_turns_round_when_the_feed_gives_out(self):
        vehicle = spacecraft(3, coupling=1.0, rise_time=5.0)
        impulse = delivered_impulse(vehicle, [[1.0, 1.0, 1.0]])[0] / THRUST
        # q (1 - 2 q) until q = 1/2, then nothing: 5 s times 1/24.
        assert impulse == pytest.approx([5.0 / 24.0] * 3, **EXACT)


class TestPropellant:
    def test_mass_falls_by_what_flows(self):
        vehicle = spacecraft(2, coupling=0.06, specific_impulse=60.0, propellant_mass=5.0, rise_time=0.3)
        scatter = np.array([[0.1, -0.1], [0.05, 0.02]])
        flight = fly(vehicle, [[0.4, 1.0], [0.7, 0.0]], scatter=scatter)
        np.testing.assert_allclose(np.diff(flight.mass), -flight.propellant, rtol=1e-11)
        np.testing.assert_allclose(
            flight.propellant, flight.impulse.sum(axis=1) / (60.0 * STANDARD_GRAVITY), rtol=1e-12
        )

    def test_rocket_equation(self):
        vehicle = spacecraft(specific_impulse=1.0, propellant_mass=9.0, mean_motion=1e-12)
        flight = fly(vehicle, np.ones((4, 1)))
        expected = STANDARD_GRAVITY * math.log(flight.mass[0] / flight.mass[-1])
        assert flight.velocity[-1, 0] == pytest.approx(expected, rel=1e-11)

    def test_empty_craft_gets_no_thrust_from_the_next_period_on(self):
        flow = THRUST / (100.0 * STANDARD_GRAVITY)
        vehicle = spacecraft(specific_impulse=100.0, propellant_mass=1.5 * PERIOD * flow)
        flight = fly(vehicle, np.ones((4, 1)), faults=[Fault(1, "leak", severity=0.5)])
        assert flight.impulse[:, 0] == pytest.approx([10.0, 10.0, 0.0, 0.0], **EXACT)
        assert flight.mass[4] == flight.mass[2]


class TestErrors:
    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"duties": [[0.5, 0.5]]}, r"duties have the shape \(1, 2\)"),
            ({"duties": [[1.5]]}, "outside"),
            ({"scatter": [[0.0, 0.0]]}, "scatter has the shape"),
            ({"dynamics": "kepler"}, "'hcw' or 'nonlinear'"),
            ({"faults": [Fault(2, "leak")]}, "thruster 2"),
        ],
    )
    def test_wrong_argument_is_named(self, changes, words):
        arguments = {"duties": [[0.5]]} | changes
        with pytest.raises(ValueError, match=words):
            fly(spacecraft(), **arguments)


def test_tighter_tolerance_does_not_move_the_flight():
    orion = load("orion")
    generator = np.random.default_rng(7)
    duties, scatter = generator.uniform(size=(12, 12)), generator.uniform(-0.1, 0.1, size=(12, 12))
    faults = [
        Fault(1, "stuck_off", onset=7.0),
        Fault(4, "misalignment", severity=0.4, profile="sine", profile_time=13.0),
        Fault(8, "leak", severity=0.5, profile="ramp", profile_time=30.0, onset=3.0),
    ]
    initial = FlightState(position=(100.0, -200.0, 50.0), velocity=(0.1, 0.2, 0.0), rate=(0.01, -0.02, 0.03))
    usual, tighter = (
        fly(orion, duties, initial=initial, faults=faults, scatter=scatter, dynamics="nonlinear", rtol=rtol)
        for rtol in (1e-12, 1e-13)
    )
    # A minute of tumbling: one part in 1e11 of 200 m, 1 m/s, 1 rad and 1 rad/s.
    np.testing.assert_allclose(usual.position, tighter.position, rtol=0, atol=2e-9)
    np.testing.assert_allclose(usual.velocity, tighter.velocity, rtol=0, atol=1e-11)
    np.testing.assert_allclose(usual.attitude, tighter.attitude, rtol=0, atol=1e-11)
    np.testing.assert_allclose(usual.rate, tighter.rate, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(usual.impulse, tighter.impulse)
