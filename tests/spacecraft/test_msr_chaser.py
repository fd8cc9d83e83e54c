"""The Mars chaser MSR-A: its geometry, and what a modulator can be."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

from thruster_envs.spacecraft import Modulator, Sensors, Spacecraft, load, save

CHASER = load("msr_chaser")
CORNERS = np.array(
    [[1, 1, 1], [1, 1, -1], [-1, 1, 1], [-1, 1, -1], [-1, -1, -1], [-1, -1, 1], [1, -1, -1], [1, -1, 1]]
)


def test_each_row_of_the_wrenches_is_one_size_with_the_signs_of_a_hadamard_matrix():
    x, y, z = CORNERS.T
    signs = np.array([-x, -y, -z, -y * z, x * z, x * y])
    sizes = np.array([13.2, 6.6, 16.3156, 9.7156, 6.3788, 5.28])
    np.testing.assert_allclose(CHASER.wrenches(), signs * sizes[:, np.newaxis], atol=5e-5)
    np.testing.assert_array_equal(signs @ signs.T, 8 * np.eye(6))


def test_all_thrusters_together_do_nothing():
    for null in (np.ones(8), CORNERS.prod(axis=1)):
        np.testing.assert_allclose(CHASER.wrenches() @ null, 0.0, atol=1e-13)


def test_the_orbit_is_500_km_above_mars():
    radius = (CHASER.gravitational_parameter / CHASER.mean_motion**2) ** (1 / 3)
    assert radius == pytest.approx(3396.2e3 + 500e3, rel=1e-12)
    assert 2.0 * math.pi / CHASER.mean_motion == pytest.approx(7383.7, abs=0.05)


def test_sensors_reach_the_half_widths_of_msr_a():
    sensors = CHASER.sensors
    reach = math.sqrt(3.0) * np.array([sensors.position, sensors.attitude, sensors.rate])
    np.testing.assert_allclose(reach, [1e-3, math.radians(0.03), math.radians(0.005)], rtol=1e-12)


def test_the_stated_velocity_error_is_that_of_the_alpha_beta_filter():
    """Steady state of x+ = x + 0.3 e, v+ = v + 0.05 / T e under white noise of the position."""
    alpha, beta, period = 0.3, 0.05, CHASER.control_period
    step = np.array([[1.0 - alpha, (1.0 - alpha) * period], [-beta / period, 1.0 - beta]])
    noise = np.array([alpha, beta / period])
    covariance = np.zeros((2, 2))
    for _ in range(2000):
        covariance = step @ covariance @ step.T + np.outer(noise, noise) * CHASER.sensors.position**2
    assert CHASER.sensors.velocity == pytest.approx(math.sqrt(covariance[1, 1]), rel=0.005)


def test_a_modulator_survives_files_and_json(tmp_path):
    save(CHASER, tmp_path / "copy.toml")
    assert load(tmp_path / "copy.toml") == CHASER
    again = Spacecraft.from_dict(json.loads(json.dumps(CHASER.to_dict())))
    assert again == CHASER
    assert isinstance(again.modulator, Modulator)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"modulator": None}, "isolation_valves is True; False, or a modulator beside it"),
        ({"modulator": None, "isolation_valves": False}, "time_constant is 0.02; 0 s where there is no"),
        ({"modulator": {"delay": 0.1, "jitter": 0.06}}, "two pulses together is 0.12; at most the control"),
        ({"feed": {"coupling": 0.06}}, "feed: coupling is 0.06; 0 where there is a modulator"),
        ({"gravitational_parameter": 0.0}, "gravitational_parameter is 0.0; a positive number of m^3/s^2"),
    ],
)
def test_what_does_not_go_together_is_refused(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        CHASER.replace(**changes)


def test_linear_ramps_behind_a_modulator_are_refused():
    slow = dataclasses.replace(CHASER.thrusters[0], rise_time=0.01)
    with pytest.raises(ValueError, match=r"thruster '1': rise_time is 0\.01; 0 s behind a modulator"):
        CHASER.replace(thrusters=(slow, *CHASER.thrusters[1:]))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"delay": -0.1}, "modulator: delay is -0.1; a finite number of s, zero or more"),
        ({"delay": 0.02, "variation": 0.03}, "together is 0.03; at most the delay, 0.02 s,"),
        ({"variation_period": 0.0}, "modulator: variation_period is 0.0; a positive number of s"),
    ],
)
def test_an_impossible_modulator_is_refused(values, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Modulator(**values)


def test_errors_are_normal_or_uniform():
    with pytest.raises(ValueError, match="'unifrom' is unknown; did you mean 'uniform'"):
        Sensors(distribution="unifrom")
