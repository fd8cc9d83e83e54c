"""Studies of Fonod 2013's isolation: pilots that fly otherwise, histories, medians, a proof that can fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reproductions.cells import median
from reproductions.fonod2013.fig_3_time_histories import history
from reproductions.fonod2013.impossible_decoupling import _independent_rows, _ratio_errors
from reproductions.fonod2013.isolation_study import Isolation, correlation, watched
from reproductions.fonod2013.other_pilots import fixed_bias, law, minimum_fuel, stopping
from reproductions.fonod2013.robustness import _medians
from reproductions.fonod2013.worth_of_the_delay_model import DESIGNS, _noise, _silent
from thruster_baselines.control import ApproachController, ApproachSettings
from thruster_baselines.detection.approach_flights import NO_ERRORS, fly
from thruster_baselines.detection.residuals import (
    CorrelationDetector,
    ResidualGenerator,
    delay_model,
    named_design,
)
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

CHASER = load("msr_chaser")
SEEDS = VALIDATION[:4]
THRESHOLD = 0.0205
HALVES = [0, 3, 5, 6], [1, 2, 4, 7]
"""Thrusters, from 0, of which each half gives nothing against the other."""


@pytest.mark.parametrize(("braking", "place"), [(np.inf, -14.0), (2e-3, -11.5)])
def test_a_stop_ends_where_its_reference_does(braking, place):
    """From -20 m at 0.1 m/s for 60 s, then 0 or 0.1 x 50 / 2 m more."""
    flights = fly(SEEDS[:2], pilot=stopping(60.0, braking), spacecraft=_silent(0.0), **NO_ERRORS)
    np.testing.assert_allclose(flights.position[:, -1, 1], place, atol=5e-3)
    np.testing.assert_allclose(flights.position[:, 590, 1], -20.0 + 5.9, atol=0.02)


def test_the_filter_that_takes_thrust_to_come_at_once_ends_full_thrust_sooner():
    told = [
        fly(SEEDS[:1], pilot=stopping(60.0, np.inf, own_filter=own), spacecraft=_silent(0.0), **NO_ERRORS)
        for own in (False, True)
    ]
    plain, eager = (int((one.open_rates[0, 600:650, 0] > 0.999).sum()) for one in told)
    assert 1 <= eager < plain
    np.testing.assert_allclose(told[1].position[0, -1, 1], -14.0, atol=5e-3)


def test_minimum_fuel_gives_the_wrench_of_the_law_for_less_and_shuts_one_of_each_half():
    observations = np.zeros((1, 36), np.float32)
    observations[0, 15] = 1.0
    observations[0, 1], observations[0, 4], observations[0, 7] = -1.0, -5.0, 1.0
    observations[0, 3], observations[0, 5], observations[0, 9:12] = 0.1, -0.05, (0.05, -0.08, 0.1)
    thrifty, lifted = (
        0.5 * (one(CHASER, 3000)(observations)[0].astype(np.float64) + 1.0) for one in (minimum_fuel(), law())
    )
    wrench = ApproachController(CHASER, 3000).wrench(observations)[0]
    assert np.abs(wrench[3:]).min() > 1.0
    for rates in (thrifty, lifted):
        np.testing.assert_allclose(CHASER.wrenches() @ rates, wrench, atol=2e-5)
    assert thrifty.sum() < lifted.sum() - 0.3
    for half in HALVES:
        assert thrifty[half].min() == pytest.approx(0.0, abs=1e-7)


def test_a_fixed_bias_is_what_idle_thrusters_have():
    flights = fly(SEEDS[:1], pilot=fixed_bias(0.2), spacecraft=_silent(0.0), **NO_ERRORS)
    np.testing.assert_allclose(flights.open_rates[:, 500:1500], 0.2, atol=0.01)


def test_the_clipped_bias_lets_the_opposite_corner_fall_with_the_open_thruster():
    flights = fly(SEEDS, 6, "stuck_on", 1.0, pilot=fixed_bias(0.2))
    told = flights.open_rates[:, 620:640].mean(axis=1)
    assert (told[:, [1, 5]] < 0.02).all()  # thrusters 2 and 6
    assert np.delete(told, [1, 5], axis=1).min() > 0.1
    seen = watched([flights], correlation(), 0.0296)
    assert (seen.named == 2).all()
    fast = fly(SEEDS, 6, "stuck_on", 1.0, pilot=fixed_bias(0.2, ApproachSettings(translation=0.4)))
    assert watched([fast], correlation(), 0.0296).share == 1.0


def test_the_index_is_the_open_thruster_for_the_whole_window_and_not_judged_after_the_name():
    flights = fly(SEEDS, 5, "stuck_on", 1.0)
    detector = CorrelationDetector(CHASER, THRESHOLD, confirmations=7, vehicles=4)
    found = history(detector, flights)
    for flight in range(4):
        window = found.window(flight, 7)
        assert window.stop - window.start == 7
        assert (found.index[flight, window] == 5).all()
        assert (found.index[flight, window.stop :] == 0).all()
        assert found.named[flight, window.stop - 1] == 5
        assert found.named[flight, window.stop - 2] == 0
        assert found.detected[flight, window.start]
        assert found.norm[flight, found.detected[flight].argmax()] >= THRESHOLD


def test_medians_leave_out_who_alarmed_before_the_fault_and_count_wrong_names_as_none():
    seen = Isolation(
        detection=np.array([1.0, 2.0, 3.0, -5.0]),
        isolation=np.array([2.0, 4.0, 5.0, -4.0]),
        named=np.array([3, 4, 3, 3]),
        thruster=np.array([3, 3, 3, 3]),
    )
    assert _medians(seen) == (2.0, 5.0)
    assert seen.share == 0.75


def test_a_median_that_fewer_than_half_have_is_never():
    assert median(np.array([1.0, np.inf, 3.0])) == 3.0
    assert median(np.array([1.0, np.inf])) == 1.0
    assert median(np.array([1.0, np.inf, np.inf])) == np.inf
    assert median(np.array([])) == np.inf


@pytest.mark.parametrize("name", DESIGNS)
def test_one_sigma_of_the_residual_is_that_of_noise_sent_through_the_observer(name):
    generator = ResidualGenerator(named_design(CHASER, name), 200)
    noise = np.random.default_rng(1).uniform(-1e-3, 1e-3, (400, 200, 3))
    residuals = [generator.step(np.zeros((200, 3)), one)[:, 1] for one in noise][300:]
    assert np.std(residuals) == pytest.approx(_noise(name), rel=0.03)


def test_the_proof_that_decoupling_is_impossible_can_fail():
    model = delay_model(CHASER.mean_motion, 0.1)
    assert _ratio_errors(model, 3).max() < 1e-10
    assert _independent_rows(model) == 6
    rng = np.random.default_rng(2)
    elsewhere = replace(model, delay_variation=rng.standard_normal((9, 3)))
    assert _ratio_errors(elsewhere, 3).min() > 0.1
    measured = np.vstack([model.measurement[0], np.eye(9)[6], model.measurement[2]])
    assert _independent_rows(replace(model, measurement=measured)) < 6  # a state of the delay is assignable
