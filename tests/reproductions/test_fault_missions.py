from __future__ import annotations

import numpy as np
import pytest

from reproductions.yang2003.fault_flights import fly_with_dead_thruster
from reproductions.yang2003.fault_mission import DEGRADED, LOST, TWO_LOST, Failure, fly, shares
from reproductions.yang2003.section_6_1_planned_trajectory import two_impulses
from reproductions.yang2003.section_6_3_coupling_in_flight import ORION, PERIOD, START, STEPS, plan
from thruster_baselines.guidance import force_response, transition_matrix
from thruster_envs.seeds import VALIDATION


def test_without_a_failure_the_plan_is_flown_and_nobody_is_blamed():
    flight = fly(diagnosis=True, deviation=1.0)
    assert flight.miss < 1e-6
    assert flight.found == ()
    assert flight.replans == 0
    np.testing.assert_array_equal(flight.on_times, flight.delivered)
    np.testing.assert_allclose(flight.states, plan(0.9).states, atol=1e-6)


def test_two_impulses_by_hills_equations():
    departure, arrival = two_impulses()
    free = transition_matrix(ORION.mean_motion, STEPS * PERIOD)
    left = START + np.concatenate([np.zeros(3), departure])
    np.testing.assert_allclose(free @ left + np.concatenate([np.zeros(3), arrival]), np.zeros(6), atol=1e-9)
    np.testing.assert_allclose(departure, [-0.1944, -0.5775, 0.0], atol=2e-4)  # in pi / n
    np.testing.assert_allclose(arrival, [-0.1944, -0.0825, 0.0], atol=2e-4)


@pytest.mark.parametrize(
    ("failures", "miss"), [(LOST, 358.7), (DEGRADED, 277.5), (TWO_LOST, 555.0)], ids=["E39", "E47", "E48"]
)
def test_a_failure_not_noticed_ends_where_the_lost_thrust_would_have_taken_it(failures, miss):
    """Linear motion: the miss is what the lost rate changes alone lead to."""
    flight = fly(failures)
    assert flight.miss == pytest.approx(miss, abs=0.05)
    lost = (flight.on_times - flight.delivered) @ ORION.effectiveness().T
    transition = transition_matrix(ORION.mean_motion, PERIOD)
    response = force_response(ORION.mean_motion, PERIOD) / PERIOD
    state = np.zeros(6)
    for change in lost:
        state = transition @ state + response @ change[:3]
    np.testing.assert_allclose(flight.states[-1], -state, atol=1e-6)


def test_a_failure_begins_with_its_period():
    failures = (Failure(3, share=0.25, period=4),)
    assert shares(failures, 3)[2] == 1.0
    assert shares(failures, 4)[2] == 0.25
    assert shares(failures, 4).sum() == 11.25


def test_a_diagnosis_is_right_at_the_first_second_and_spends_what_a_pilot_that_is_told_does():
    flight, told = fly(LOST, diagnosis=True), fly(LOST, known=True)
    (found,) = flight.found
    assert (found.period, found.second, found.thruster, found.kind, found.since) == (5, 1, 1, "stuck_off", 1)
    assert flight.miss < 1e-6
    assert flight.delta_v == pytest.approx(told.delta_v, rel=0.02)
    assert (flight.on_times[5:, 0] < 1e-9).all()  # what is dead is not fired any more
    assert found.period in [made for made, _ in flight.plans]


def test_the_dead_thruster_is_first_and_its_twin_second():
    """At Y = 10 they are 3.7225e-4 and 3.6865e-4; the filter's own Y is a little more."""
    second = next(one for one in fly(LOST, diagnosis=True).seconds if one.time == 21.0)
    assert np.argsort(second.ratio)[[-1, -2]].tolist() == [0, 9]
    assert second.ratio[9] / second.ratio[0] == pytest.approx(3.6865 / 3.7225, rel=1e-3)
    np.testing.assert_allclose(second.measured, [-0.003, -0.006, 0.0, 0.0, -0.0412, -0.0449], atol=1e-12)


def test_the_second_of_two_failures_is_found_when_it_is_first_told_to_fire():
    for taken_back, periods in ((0.0, None), (1.0, [1, 2])):
        flight = fly(TWO_LOST, diagnosis=True, taken_back=taken_back)
        assert [one.thruster for one in flight.found] == [1, 2]
        assert [one.since for one in flight.found] == [1, 1]
        assert flight.miss < 1e-6
        if periods:
            assert [one.period for one in flight.found] == periods
            assert np.abs(flight.rate).max() < 1e-9
        second = flight.found[1].period
        assert not (flight.on_times[: second - 1, 1] > 0.0).any()


def test_feedback_plans_anew_only_when_it_is_off():
    flight = fly(LOST, deviation=25.0)
    assert flight.replans == 4
    for (made, before), (anew, _) in zip(flight.plans, flight.plans[1:], strict=False):
        off = np.linalg.norm(
            flight.states[made : anew + 1, :3] - before.states[: anew + 1 - made, :3], axis=1
        )
        assert off[-1] > 25.0
        assert (off[:-1] <= 25.0).all()
    assert len(flight.states) == STEPS + 1


def test_with_attitude_a_dead_thruster_shows_in_what_is_fired():
    told, blind = (
        fly_with_dead_thruster(pilot, VALIDATION[:1], thruster=1, onset=0.0, orbits=0.02)
        for pilot in ("oracle", "blind")
    )
    assert told.spent.shape == blind.spent.shape
    assert (np.diff(told.spent[0]) >= 0.0).all()
    assert told.spent[0, -1] == told.firing_time[0] > 0.0
    assert told.firing_time[0] != blind.firing_time[0]
