"""What the sensors say: the truth plus noise of the stated size, and the rate change that follows from it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from tests.physics.closed_forms import rotation_quaternion
from tests.physics.flying import Array, begin, random_duties, with_valves
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import Sensors, load

WORLDS = 4000
ATTITUDE = rotation_quaternion([0.3, -0.5, 0.2])
DRIFT = {
    at.POSITION: (120.0, -80.0, 30.0),
    at.VELOCITY: (0.05, -0.2, 0.03),
    at.ATTITUDE: ATTITUDE,
    at.RATE: (0.01, -0.02, 0.015),
}


def drifting_fleet(worlds: int = WORLDS, spacecraft=None, faults=()) -> Fleet:
    """Orion, or another craft, drifting freely in each world, seen once."""
    fleet = Fleet(load("orion") if spacecraft is None else spacecraft, worlds)
    begin(fleet, faults, seed=9)
    for row, values in DRIFT.items():
        fleet.write(row, np.array(values))
    fleet.look(fleet.everyone)
    return fleet


def noise(fleet: Fleet) -> Array:
    """(worlds, 12) measured less true: position, velocity, small rotation vector in the body, rate."""
    measured, true = fleet.read(at.MEASURED, 13)[:, 0], fleet.read(0, 13)[:, 0]
    q, p = measured[:, 6:10], true[:, 6:10]
    # The vector part of q p*, twice of which is the small rotation between them.
    vector = -q[:, :1] * p[:, 1:] + p[:, :1] * q[:, 1:] - np.cross(q[:, 1:], p[:, 1:])
    return np.concatenate([(measured - true)[:, :6], 2.0 * vector, (measured - true)[:, 10:]], axis=1)


def sigmas() -> Array:
    """(12,) the stated noise of Orion's sensors."""
    sensors = load("orion").sensors
    return np.repeat([sensors.position, sensors.velocity, sensors.attitude, sensors.rate], 3)


@pytest.mark.parametrize("periods", [0, 1, 7])
def test_noise_is_normal_with_the_stated_size_on_each_axis(periods):
    """After the reset and after any period."""
    fleet = drifting_fleet()
    for _ in range(periods):
        fleet.fly()
    scaled = noise(fleet) / sigmas()
    for axis in scaled.T:
        assert axis.mean() == pytest.approx(0.0, abs=4.0 / math.sqrt(WORLDS))
        assert axis.std() == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * WORLDS))
        assert stats.kstest(axis, "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(scaled.T) - np.eye(12)).max() < 4.5 / math.sqrt(WORLDS)


def test_noise_of_one_period_says_nothing_of_the_next():
    fleet = drifting_fleet()
    looks = [noise(fleet)]
    for _ in range(3):
        fleet.fly()
        looks.append(noise(fleet))
    scaled = np.concatenate(looks, axis=1) / np.tile(sigmas(), len(looks))
    assert np.abs(np.corrcoef(scaled.T) - np.eye(48)).max() < 5.0 / math.sqrt(WORLDS)


def test_a_measured_attitude_has_unit_length():
    fleet = drifting_fleet()
    fleet.fly()
    lengths = np.linalg.norm(fleet.read(at.MEASURED + 6, 4), axis=-1)
    assert np.abs(lengths - 1.0).max() < 1e-15


def test_sensors_without_noise_tell_the_truth():
    fleet = drifting_fleet(10, load("orion").replace(sensors=Sensors()))
    for _ in range(3):
        assert np.array_equal(fleet.read(at.MEASURED, 13), fleet.read(0, 13))
        fleet.fly()


def test_in_free_drift_the_measured_rate_change_is_noise_alone():
    """Two measurements' worth of it: orbital drift and the gyroscopic change of the rate are taken out."""
    fleet = drifting_fleet()
    fleet.fly()
    change = fleet.read(at.MEASURED_CHANGE, 6)[:, 0]
    sensors = load("orion").sensors
    for column, sigma in enumerate([sensors.velocity] * 3 + [sensors.rate] * 3):
        assert change[:, column].std() == pytest.approx(math.sqrt(2.0) * sigma, rel=0.05)
        assert abs(change[:, column].mean()) < 4.0 * math.sqrt(2.0) * sigma / math.sqrt(WORLDS)


def test_without_noise_a_free_drift_measures_no_rate_change():
    fleet = drifting_fleet(1, load("orion").replace(sensors=Sensors()))
    for _ in range(20):
        fleet.fly()
        change = fleet.read(at.MEASURED_CHANGE, 6)[0, 0]
        assert np.abs(change[:3]).max() < 1e-12
        assert np.abs(change[3:]).max() < 1e-7  # the mean of two rates stands for the rate in between


def test_the_expected_change_is_what_the_nominal_craft_delivers():
    """Pulses that begin together lose the coupling's share of their overlap; no scatter, no fault."""
    spacecraft = with_valves(load("orion"), scatter=0.0)
    for duties in random_duties(np.random.default_rng(2), 20, 12):
        fleet = drifting_fleet(1, spacecraft)
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        expected = fleet.read(at.EXPECTED_CHANGE, 6)[0, 0]
        on_times = 5.0 * duties
        overlap = np.minimum.outer(on_times, on_times).sum(axis=1) - on_times
        by_hand = spacecraft.effectiveness() @ np.maximum(0.0, on_times - 0.06 * overlap)
        np.testing.assert_allclose(expected, by_hand, rtol=1e-12, atol=1e-15)
        delivered = fleet.read(at.IMPULSE, 6)[0, 0]
        inertia = np.array(spacecraft.inertia)
        np.testing.assert_allclose(expected[:3], delivered[:3] / spacecraft.mass, rtol=1e-11, atol=1e-14)
        np.testing.assert_allclose(
            expected[3:], np.linalg.solve(inertia, delivered[3:]), rtol=1e-11, atol=1e-14
        )


def test_a_fault_shows_in_the_measured_change_and_not_in_the_expected_one():
    """Thrusters 1 and 2 alone; thruster 1 dead."""
    spacecraft = with_valves(load("orion"), scatter=0.0).replace(sensors=Sensors())
    duties = np.zeros(12)
    duties[[0, 1]] = 0.02
    changes = {}
    for name, faults in (("whole", []), ("dead", [Fault(1, "stuck_off")])):
        fleet = drifting_fleet(1, spacecraft, faults)
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        changes[name] = (fleet.read(at.MEASURED_CHANGE, 6)[0, 0], fleet.read(at.EXPECTED_CHANGE, 6)[0, 0])
    assert np.array_equal(changes["whole"][1], changes["dead"][1])
    effect = spacecraft.effectiveness()[:, 0] * 0.1 * (1.0 - 0.06)
    missing = changes["whole"][0] - changes["dead"][0]
    second = spacecraft.effectiveness()[:, 1] * 0.1 * 0.06  # no longer takes its share from thruster 2
    np.testing.assert_allclose(missing, effect - second, atol=0.15 * np.abs(effect).max())
    np.testing.assert_allclose(changes["whole"][0], changes["whole"][1], atol=0.15 * np.abs(effect).max())
