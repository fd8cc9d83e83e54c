"""The response test blames the thruster that failed, by the share that it lost, and rarely anybody else."""

import numpy as np
import pytest

from thruster_baselines.detection import ResponseTest, threshold_for
from thruster_envs.spacecraft import load

ORION = load("orion")


def _fire(generator, vehicles, thruster, health, noise=1.0):
    """Random on-times, and the difference that a thruster of that health makes, with sensor noise."""
    on_times = generator.uniform(0.5, 5.0, (vehicles, 12))
    sensors = ORION.sensors
    sigma = noise * np.sqrt(2.0) * np.repeat([sensors.velocity, sensors.rate], 3)
    column = ORION.effectiveness()[:, thruster]
    difference = -(1.0 - health) * on_times[:, thruster, np.newaxis] * column
    return on_times, difference + sigma * generator.normal(size=(vehicles, 6))


@pytest.mark.parametrize("thruster", range(12))
@pytest.mark.parametrize("health", [0.0, 0.4, 0.8])
def test_without_noise_the_lost_share_is_found_exactly(thruster, health):
    test = ResponseTest(ORION, 10.0, 5)
    believed = test.update(*_fire(np.random.default_rng(thruster), 5, thruster, health, noise=0.0))
    expected = np.ones((5, 12))
    expected[:, thruster] = health
    np.testing.assert_allclose(believed, expected, atol=1e-9)


def test_with_noise_a_dead_thruster_is_blamed_in_almost_every_vehicle():
    test = ResponseTest(ORION, 30.0, 1000)
    believed = test.update(*_fire(np.random.default_rng(0), 1000, 6, 0.0))
    assert (believed.argmin(axis=1) == 6).mean() > 0.98


def test_a_thruster_that_was_not_told_to_fire_is_never_blamed():
    test = ResponseTest(ORION, 0.0, 1)
    on_times = np.zeros((1, 12))
    on_times[0, 3] = 2.0
    difference = -ORION.effectiveness()[:, 7] * 5.0  # thruster 8 is what it looks like
    believed = test.update(on_times, difference)
    assert np.delete(believed[0], 3).min() == 1.0


def test_belief_lasts_while_there_is_nothing_to_see():
    test = ResponseTest(ORION, 10.0, 1)
    believed = test.update(*_fire(np.random.default_rng(1), 1, 2, 0.0, noise=0.0)).copy()
    np.testing.assert_array_equal(test.update(np.zeros((1, 12)), np.zeros((1, 6))), believed)
    test.reset(1)
    assert test.health.min() == 1.0


def test_healthy_vehicles_alarm_at_the_rate_that_the_threshold_was_calibrated_to():
    """2,000 episodes to calibrate, 2,000 others to check; three standard deviations of both."""
    rate, generator = 0.05, np.random.default_rng(2)

    def statistics(threshold):
        test = ResponseTest(ORION, threshold, 2000)
        found = []
        for _ in range(10):
            test.update(*_fire(generator, 2000, 0, 1.0))
            found.append(test.statistic)
        return np.stack(found, axis=1)

    threshold = threshold_for(rate, statistics(np.inf))
    alarms = (statistics(threshold) > threshold).any(axis=1).mean()
    assert abs(alarms - rate) < 3.0 * np.sqrt(2.0 * rate * (1.0 - rate) / 2000)


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: ResponseTest(ORION, -1.0), "threshold is -1.0; a number of 0 or more would be right"),
        (lambda: ResponseTest(ORION, np.nan), "threshold is nan"),
        (lambda: ResponseTest(ORION, 1.0, 0), "vehicles is 0; one or more would be right"),
        (lambda: threshold_for(1.0, [[1.0]]), "false_alarm_rate is 1.0"),
        (lambda: threshold_for(0.01, np.ones((50, 3))), "50 episodes cannot tell .* 100 or more"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()
