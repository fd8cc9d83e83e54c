"""Orion's description gives back what its source prints, and what follows from it."""

import numpy as np
import pytest

from thruster_envs.spacecraft import load, objective_weights

# Yang 2003, Table 10, read in m/s^2 and rad/s^2, with the entry y-rotation / thruster 2 as -0.0412.
TABLE_10 = np.array(
    [
        [-0.0030, 0, 0, 0.0030, 0, 0, 0.0030, 0, 0, -0.0030, 0, 0],
        [0, 0, 0.0030, 0, 0, -0.0030, 0, 0, 0.0030, 0, 0, -0.0030],
        [0, -0.0030, 0, 0, -0.0030, 0, 0, 0.0030, 0, 0, 0.0030, 0],
        [0, -0.0417, 0.0417, 0, 0.0417, -0.0417, 0, 0.0417, -0.0417, 0, -0.0417, 0.0417],
        [0.0412, -0.0412, 0, -0.0412, 0.0412, 0, 0.0412, -0.0412, 0, -0.0412, 0.0412, 0],
        [0.0449, 0, -0.0449, 0.0449, 0, -0.0449, -0.0449, 0, 0.0449, -0.0449, 0, 0.0449],
    ]
)


@pytest.fixture(scope="module")
def effectiveness():
    return load("orion").effectiveness()


def test_effectiveness_is_table_10_to_its_printed_digits(effectiveness):
    np.testing.assert_array_equal(np.round(effectiveness, 4), TABLE_10)
    np.testing.assert_allclose(
        effectiveness, TABLE_10, rtol=0, atol=1e-15
    )  # the lever arms were chosen for it


def test_all_twelve_thrusters_together_cancel(effectiveness):
    np.testing.assert_allclose(effectiveness @ np.ones(12), 0.0, atol=1e-16)


def test_singular_values_and_condition_number(effectiveness):
    values = np.linalg.svd(effectiveness, compute_uv=False)
    np.testing.assert_array_equal(np.round(values, 4), [0.1270, 0.1179, 0.1165, 0.0060, 0.0060, 0.0060])
    assert values[0] / values[-1] == pytest.approx(21.2, abs=0.05)


def test_the_six_axes_are_uncoupled_under_equal_on_times(effectiveness):
    gram = effectiveness @ effectiveness.T
    expected = [3.6e-5, 3.6e-5, 3.6e-5, 1.3911e-2, 1.3580e-2, 1.6128e-2]
    np.testing.assert_allclose(np.diag(gram), expected, rtol=5e-5)  # five digits are known
    np.testing.assert_allclose(gram - np.diag(np.diag(gram)), 0.0, atol=1e-17)


def test_squared_column_norms(effectiveness):
    norms = np.sum(effectiveness**2, axis=0)
    np.testing.assert_allclose(norms[[0, 3, 6, 9]], 3.72245e-3, rtol=1e-6)
    np.testing.assert_allclose(norms[[1, 4, 7, 10]], 3.44533e-3, rtol=1e-5)
    np.testing.assert_allclose(norms[[2, 5, 8, 11]], 3.76390e-3, rtol=1e-6)


def test_torque_of_each_thruster_is_0_02398_newton_metres_on_two_axes():
    torques = np.abs(load("orion").wrenches()[3:])
    for column in torques.T:
        assert sorted(np.round(column, 5)) == [0.0, 0.02398, 0.02398]


def test_pairs_that_share_a_force_have_nearly_parallel_signatures(effectiveness):
    unit = effectiveness / np.linalg.norm(effectiveness, axis=0)
    cosines = np.abs(unit.T @ unit)
    for one, other in ((1, 10), (2, 5), (3, 9), (4, 7), (6, 12), (8, 11)):
        assert cosines[one - 1, other - 1] == pytest.approx(0.995, abs=5e-4)


def test_authority_of_a_period_when_healthy():
    np.testing.assert_array_equal(
        np.round(load("orion").authority(), 3), [0.030, 0.030, 0.030, 0.834, 0.824, 0.898]
    )


def test_authority_grows_with_the_period():
    orion = load("orion")
    np.testing.assert_allclose(orion.authority(1.0), orion.authority() / 5.0, rtol=1e-15)


def test_lighter_craft_accelerates_more_but_turns_alike():
    orion = load("orion")
    full, half = orion.effectiveness(), orion.effectiveness(mass=10.0)
    np.testing.assert_allclose(half[:3], 2.0 * full[:3], rtol=1e-15)
    np.testing.assert_array_equal(half[3:], full[3:])


def test_worked_example_gives_its_commanded_velocity_change(effectiveness):
    on_times = np.zeros(12)
    on_times[[0, 5, 9, 11]] = 4.5
    np.testing.assert_allclose(effectiveness @ on_times, [-0.027, -0.027, 0, 0, 0, 0], atol=1e-16)


def test_missing_on_an_axis_is_dearer_than_fuel_by_the_factor_the_source_lacks(effectiveness):
    fuel_cost, slack_cost = objective_weights(effectiveness, 5.0)
    np.testing.assert_array_equal(fuel_cost, np.ones(12))
    assert np.all(slack_cost[:3] >= 1e4)  # 1000, the source's, gives up an axis after a fault
    one_metre_per_second_after_a_fault = 1000.0  # s of firing, thruster 1 dead
    assert np.all(slack_cost[:3] > one_metre_per_second_after_a_fault)


def test_sensors_feed_and_timing_are_those_of_the_source():
    orion = load("orion")
    assert (orion.sensors.position, orion.sensors.velocity) == (0.02, 0.5e-3)
    assert (orion.sensors.attitude, orion.sensors.rate) == (np.deg2rad(1.0), 0.5e-3)
    assert orion.feed.coupling == 0.06
    assert (orion.control_period, orion.mean_motion) == (5.0, 0.0011)
    assert {thruster.scatter for thruster in orion.thrusters} == {0.10}
    assert [thruster.name for thruster in orion.thrusters] == [str(number) for number in range(1, 13)]


def test_every_value_that_the_source_does_not_give_is_marked():
    orion = load("orion")
    for field in ("mass", "thrusters.position", "sensors.rate"):
        assert orion.provenance[field].startswith("reconstructed: ")
    assert orion.provenance["thrusters.specific_impulse"].startswith("assumed: ")
