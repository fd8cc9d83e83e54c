"""The impulse of a pulse, exact whatever the sub-step: by hand in closed form, and by the referee.

Delivered on-times are impulses over the nominal thrust of their thruster, in seconds.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.physics.flying import (
    Array,
    fly,
    random_duties,
    random_faults,
    random_vehicle,
    scatter_of_flight,
    with_valves,
)
from tests.physics.reference_flight import delivered_impulse
from thruster_envs.faults import THRUSTER_KINDS, Fault
from thruster_envs.spacecraft import Feed, Spacecraft, Thruster, load

PERIOD = 5.0
EXACT = {"rel": 1e-12, "abs": 1e-13}
SUBSTEPS = (5.0, 1.0, 0.1)


def craft(
    thrusters: int = 1, *, coupling: float = 0.0, propellant_mass: float = math.inf, **valve: float
) -> Spacecraft:
    """Thrusters of 2 N through the centre of mass along +x, on a body of 10 kg."""
    return Spacecraft(
        name="test",
        mass=10.0,
        inertia=((0.5, 0.0, 0.0), (0.0, 0.7, 0.0), (0.0, 0.0, 0.9)),
        thrusters=tuple(
            Thruster(name=str(number), position=(0, 0, 0), direction=(1, 0, 0), thrust=2.0, **valve)
            for number in range(1, thrusters + 1)
        ),
        feed=Feed(coupling=coupling, propellant_mass=propellant_mass),
        control_period=PERIOD,
        mean_motion=0.0011,
    )


def on_times(
    duties: object, *, faults: list[Fault] | None = None, max_substep: float = 1.0, **valve: float
) -> Array:
    """Delivered on-time (s) of the only thruster in each period."""
    return fly(
        craft(**valve), np.reshape(duties, (-1, 1)), faults=faults or [], max_substep=max_substep
    ).delivered[:, 0]


def agrees_with_the_referee(spacecraft: Spacecraft, duties: Array, faults: list[Fault], rel: float) -> Array:
    """Assert it at every sub-step; returns the delivered on-times at the largest of them."""
    thrust = np.array([thruster.thrust for thruster in spacecraft.thrusters])
    scatter = scatter_of_flight(spacecraft, 7, len(duties))
    exact = delivered_impulse(spacecraft, duties, faults=faults, scatter=scatter) / thrust
    flights = [
        fly(spacecraft, duties, faults=faults, seed=7, max_substep=substep).delivered for substep in SUBSTEPS
    ]
    for flight in flights:
        np.testing.assert_allclose(flight, exact, rtol=rel, atol=rel)
    return flights[0]


@pytest.mark.parametrize("valve_dynamics", [False, True], ids=["plain_valves", "slow_valves"])
@pytest.mark.parametrize("profile", ["step", "intermittent", "ramp"])
@pytest.mark.parametrize("kind", THRUSTER_KINDS)
def test_the_impulse_under_one_fault_is_exact_at_every_substep(kind, profile, valve_dynamics):
    """With coupling, scatter, delays and ramps of the valves: at most three factors move at a time."""
    rng = np.random.default_rng([THRUSTER_KINDS.index(kind), len(profile), valve_dynamics])
    spacecraft = random_vehicle(rng, valve_dynamics=valve_dynamics, thrusters=5)
    faults = random_faults(rng, spacecraft, number=1, kinds=[kind], profiles=[profile])
    agrees_with_the_referee(spacecraft, random_duties(rng, 10, 5), faults, 1e-12)


@pytest.mark.parametrize("valve_dynamics", [False, True], ids=["plain_valves", "slow_valves"])
@pytest.mark.parametrize("draw", range(6))
def test_the_impulse_under_several_faults_is_exact_at_every_substep(draw, valve_dynamics):
    """Steps and intermittent dwells; several ramps at once may multiply more than three moving factors."""
    rng = np.random.default_rng([draw, valve_dynamics])
    spacecraft = random_vehicle(rng, valve_dynamics=valve_dynamics)
    faults = random_faults(rng, spacecraft, number=4, profiles=["step", "intermittent"])
    duties = random_duties(rng, 10, spacecraft.number_of_thrusters)
    agrees_with_the_referee(spacecraft, duties, faults, 1e-12)


@pytest.mark.parametrize("kind", ["stuck_off", "stuck_on", "loss", "leak", "sign"])
def test_a_sine_alone_has_its_exact_impulse(kind):
    """Without coupling and moving levels; with these the product converges as the sub-step shrinks."""
    rng = np.random.default_rng(THRUSTER_KINDS.index(kind))
    spacecraft = random_vehicle(rng, valve_dynamics=False, thrusters=4)
    spacecraft = spacecraft.replace(feed=Feed(propellant_mass=3.0))
    faults = random_faults(rng, spacecraft, number=2, kinds=[kind], profiles=["sine"])
    agrees_with_the_referee(spacecraft, random_duties(rng, 10, 4), faults, 1e-12)


@pytest.mark.parametrize("draw", range(4))
def test_products_of_many_moving_factors_converge(draw):
    """Ramps and sines, down to a second long, on moving levels that share a feed."""
    rng = np.random.default_rng([draw, 5])
    spacecraft = random_vehicle(rng, valve_dynamics=True, thrusters=6)
    faults = random_faults(rng, spacecraft, number=4, profiles=["ramp", "sine"])
    duties = random_duties(rng, 8, 6)
    exact = delivered_impulse(spacecraft, duties, faults=faults, scatter=scatter_of_flight(spacecraft, 7, 8))
    thrust = np.array([thruster.thrust for thruster in spacecraft.thrusters])
    errors = [
        np.abs(
            fly(spacecraft, duties, faults=faults, seed=7, max_substep=substep).delivered - exact / thrust
        ).max()
        for substep in (1.0, 0.05)
    ]
    assert errors[0] < 1e-3
    assert errors[1] < max(1e-12, 1e-3 * errors[0])


@settings(max_examples=40)
@given(
    duty=st.floats(0.0, 1.0),
    opening_delay=st.floats(0.0, 1.0),
    closing_delay=st.floats(0.0, 2.0),
    rise_time=st.floats(0.0, 1.0),
    fall_time=st.floats(0.0, 1.0),
    substep=st.sampled_from(SUBSTEPS),
)
def test_a_pulse_is_worth_the_area_under_its_level(
    duty, opening_delay, closing_delay, rise_time, fall_time, substep
):
    """A trapezoid, or a triangle with its top cut off where the valve closes before it is fully open."""
    valve = {
        "opening_delay": opening_delay,
        "closing_delay": closing_delay,
        "rise_time": rise_time,
        "fall_time": fall_time,
    }
    open_for = duty * PERIOD + closing_delay - opening_delay if duty > 0.0 else 0.0
    if open_for <= 0.0:
        area = 0.0
    elif open_for >= rise_time:
        area = open_for - 0.5 * rise_time + 0.5 * fall_time
    else:
        top = open_for / rise_time
        area = 0.5 * top * open_for + 0.5 * top * top * fall_time
    assert on_times([duty, 0.0, 0.0], max_substep=substep, **valve).sum() == pytest.approx(area, **EXACT)


@pytest.mark.parametrize("opening_delay", [0.0, 0.4])
def test_commands_that_last_to_the_end_of_their_periods_are_one_run_with_one_delay(opening_delay):
    valve = {"opening_delay": opening_delay, "closing_delay": 0.3, "rise_time": 0.2, "fall_time": 0.1}
    run = on_times([1.0, 1.0, 0.5, 0.0], **valve)
    assert run.sum() == pytest.approx(12.5 + 0.3 - opening_delay - 0.1 + 0.05, **EXACT)
    assert run[1] == pytest.approx(PERIOD, **EXACT)
    apart = on_times([0.9, 1.0, 0.5, 0.0], **valve)
    assert apart[0] == pytest.approx(4.5 + 0.3 - opening_delay - 0.1 + 0.05, **EXACT)


def test_a_tail_and_the_next_pulse_merge_where_they_meet():
    """A valve that is still open when the next pulse opens stays open in between."""
    valve = {"opening_delay": 0.1, "closing_delay": 0.6}
    assert on_times([0.98, 0.2, 0.0], **valve) == pytest.approx([4.9, 1.6, 0.0], **EXACT)
    assert on_times([0.9, 0.2, 0.0], **valve) == pytest.approx([4.9, 0.1 + 1.5, 0.0], **EXACT)
    late = {"opening_delay": 0.4, "closing_delay": 0.6}
    assert on_times([0.9, 0.2, 0.0], **late) == pytest.approx([4.6, 0.1 + 1.2, 0.0], **EXACT)


@pytest.mark.parametrize("minimum_pulse", [0.3, 2.0, 5.0])
def test_a_command_below_the_minimum_pulse_does_nothing(minimum_pulse):
    shortest = minimum_pulse / PERIOD
    assert on_times([shortest - 1e-9], minimum_pulse=minimum_pulse) == pytest.approx([0.0])
    assert on_times([shortest], minimum_pulse=minimum_pulse) == pytest.approx([minimum_pulse], **EXACT)


def test_a_pulse_shorter_than_the_opening_delay_never_opens():
    assert on_times([0.1, 0.0], opening_delay=0.6) == pytest.approx([0.0, 0.0])
    late = [Fault(1, "late_opening", severity=0.6)]
    assert on_times([0.1, 0.0], faults=late) == pytest.approx([0.0, 0.0])
    assert on_times([0.5, 0.0], faults=late) == pytest.approx([1.9, 0.0], **EXACT)


def test_a_late_opening_delays_a_run_once_even_past_its_first_period():
    late = [Fault(1, "late_opening", severity=6.0)]
    assert on_times([1.0, 1.0, 0.5], faults=late) == pytest.approx([0.0, 4.0, 2.5], **EXACT)


@pytest.mark.parametrize(
    ("fault", "shares"),
    [
        (Fault(1, "stuck_off"), [0.0, 0.0]),
        (Fault(1, "stuck_off", severity=0.3), [0.7 * 3.0, 0.0]),
        (Fault(1, "loss", severity=0.3), [0.7 * 3.0, 0.0]),
        (Fault(1, "stuck_on", severity=0.4), [2.0, 2.0]),
        (Fault(1, "leak", severity=0.4), [3.0 + 0.4 * 2.0, 2.0]),
        (Fault(1, "misalignment", severity=0.4), [3.0, 0.0]),
        (Fault(1, "late_opening", severity=0.4), [2.6, 0.0]),
        (Fault(1, "intermittent", profile_time=5.0, dwell=0.2), [2.0, 0.0]),
        (Fault(1, "stuck_off", onset=1.0, duration=1.5), [1.5, 0.0]),
        (Fault(1, "loss", profile="ramp", profile_time=4.0), [3.0 - 0.5 * 3.0**2 / 4.0, 0.0]),
        (Fault(1, "stuck_on", profile="sine", profile_time=5.0), [2.5, 2.5]),
        (Fault(1, "stuck_on", profile="intermittent", profile_time=5.0, dwell=0.2), [3.0, 1.0]),
    ],
    ids=lambda value: f"{value.kind}-{value.profile}-{value.severity:g}" if isinstance(value, Fault) else "",
)
def test_what_each_fault_leaves_of_three_seconds_and_of_none(fault, shares):
    for substep in SUBSTEPS:
        assert on_times([0.6, 0.0], faults=[fault], max_substep=substep) == pytest.approx(shares, **EXACT)


def test_the_wrench_is_the_sum_over_the_thrusters():
    """Force and torque of the period, body axes, from delivered on-times and the geometry."""
    rng = np.random.default_rng(0)
    spacecraft = random_vehicle(rng, valve_dynamics=True, thrusters=7)
    flight = fly(spacecraft, random_duties(rng, 10, 7), seed=3)
    np.testing.assert_allclose(
        flight.impulses, flight.delivered @ spacecraft.wrenches().T, rtol=1e-12, atol=1e-15
    )


def test_a_misaligned_thruster_pushes_where_its_tilt_points():
    spacecraft = with_valves(load("orion"), scatter=0.0)
    duties = np.zeros((1, 12))
    duties[0, 0] = 1.0
    straight = fly(spacecraft, duties).impulses[0]
    tilted = fly(spacecraft, duties, faults=[Fault(1, "misalignment", severity=0.3, azimuth=0.7)]).impulses[0]
    assert np.linalg.norm(tilted[:3]) == pytest.approx(np.linalg.norm(straight[:3]), rel=1e-12)
    cosine = tilted[:3] @ straight[:3] / np.linalg.norm(straight[:3]) ** 2
    assert math.acos(cosine) == pytest.approx(0.3, rel=1e-9)
    np.testing.assert_allclose(tilted[3:], np.cross(spacecraft.thrusters[0].position, tilted[:3]), atol=1e-15)


def test_each_open_thruster_takes_its_share_of_the_others():
    """Pulses of 1, 2 and 3 s that begin together lose 6 % of what overlaps with each other one."""
    delivered = fly(craft(3, coupling=0.06), np.array([[0.2, 0.4, 0.6]])).delivered[0]
    assert delivered == pytest.approx([1.0 - 0.12, 2.0 - 0.06 * 3.0, 3.0 - 0.06 * 3.0], **EXACT)


def test_the_worked_example_of_the_source():
    """Yang 2003: 4.5 s on thrusters 1, 6, 10 and 12 give 82 % of the commanded -0.027 m/s on x and y."""
    spacecraft = with_valves(load("orion"), scatter=0.0)
    duties = np.zeros((1, 12))
    duties[0, [0, 5, 9, 11]] = 0.9
    flight = fly(spacecraft, duties)
    change = flight.impulses[0, :3] / spacecraft.mass
    assert change == pytest.approx([-0.02214, -0.02214, 0.0], abs=1e-12)
    np.testing.assert_allclose(
        spacecraft.effectiveness()[:3] @ (5.0 * duties[0]), [-0.027, -0.027, 0.0], atol=1e-12
    )
    assert flight.delivered[0, [0, 5, 9, 11]] == pytest.approx([0.82 * 4.5] * 4, **EXACT)


def test_propellant_flows_by_specific_impulse_until_there_is_none():
    """2 N at 100 s use 2.0394e-3 kg/s; a period that begins with some left fires to its end."""
    use = 2.0 / (100.0 * 9.80665) * PERIOD
    flight = fly(craft(propellant_mass=1.5 * use, specific_impulse=100.0), np.ones((4, 1)))
    assert flight.states[:, 13] == pytest.approx(
        [10.0 - use, 10.0 - 2 * use, 10.0 - 2 * use, 10.0 - 2 * use], rel=1e-13
    )
    assert flight.delivered[:, 0] == pytest.approx([5.0, 5.0, 0.0, 0.0], **EXACT)


def test_without_a_specific_impulse_nothing_is_used_up():
    assert np.all(fly(craft(), np.ones((4, 1))).states[:, 13] == 10.0)
