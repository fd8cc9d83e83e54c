"""What the benchmarks of detection from navigation measure is what they say: flights, alarms, threads."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.navigation import (
    ALARMED,
    DETECTORS,
    ONE_THREAD_VEHICLES,
    QUIET,
    VEHICLES,
    detector,
    samples_of,
)
from thruster_baselines.detection.approach_flights import fly
from thruster_baselines.mapping.simplex import PARALLEL_FROM


@pytest.fixture(scope="module")
def flights():
    return fly(range(3))


@pytest.fixture(scope="module")
def samples(flights):
    return samples_of(flights, 6, 10)


@pytest.mark.parametrize("name", DETECTORS)
@pytest.mark.parametrize("state", [QUIET, ALARMED])
def test_from_the_second_sample_on_all_are_in_alarm_and_nobody_is_named_or_there_is_no_alarm(
    name, state, samples
):
    one = detector(name, state, 6)
    for k, sample in enumerate(samples):
        diagnosis = one.update(*sample)
        assert (diagnosis.detected == (state == ALARMED)).all() or k == 0
    assert (diagnosis.thruster == 0).all()
    assert (diagnosis.statistic > 0.0).all()


def test_each_vehicle_has_a_piece_of_a_flight_in_the_order_in_which_a_detector_takes_it(flights, samples):
    for k, (open_rates, position, attitude, rate) in enumerate(samples):
        for vehicle in range(6):
            at = (vehicle % 3, k if vehicle < 3 else flights.position.shape[1] - 10 + k)
            np.testing.assert_array_equal(open_rates[vehicle], flights.open_rates[at])
            np.testing.assert_array_equal(position[vehicle], flights.position[at])
            np.testing.assert_array_equal(attitude[vehicle], flights.attitude[at])
            np.testing.assert_array_equal(rate[vehicle], flights.rate[at])


def test_one_vehicle_has_the_whole_of_the_first_flight(flights):
    one = samples_of(flights)
    np.testing.assert_array_equal(np.array([position[0] for _, position, _, _ in one]), flights.position[0])


def test_batches_are_on_their_side_of_the_threads():
    assert ONE_THREAD_VEHICLES < PARALLEL_FROM <= VEHICLES
