"""What the reproductions of the detection study measure with."""

from __future__ import annotations

import numpy as np
import pytest

from reproductions.yang2003.detection_study import (
    EFFECTIVENESS,
    FALSE_ALARMS,
    KEPT,
    ONSET,
    Conditions,
    alarm_rate,
    calibrated,
    fly,
    record,
)
from reproductions.yang2003.figs_25_27_detection_probability import PERIOD, _firings
from reproductions.yang2003.table_9_detector_cost import Counter, filter_operations


def test_flights_lose_three_quarters_of_one_thruster_from_the_onset_on():
    told, change, thruster = fly(Conditions(error=0.0, scatter=0.0), 7, seed=3, watched=2)
    missing = np.einsum("mn,tfn->tfm", EFFECTIVENESS, told) - change
    own = told[:, np.arange(7), thruster - 1, np.newaxis] * EFFECTIVENESS[:, thruster - 1].T
    np.testing.assert_allclose(missing[:ONSET], 0.0, atol=1e-15)
    np.testing.assert_allclose(missing[ONSET:], (1.0 - KEPT) * own[ONSET:], atol=1e-15)
    assert ((told > 0.0).sum(axis=2) == 4).all()


def test_calibrated_thresholds_are_exceeded_by_the_stated_share_of_healthy_windows():
    healthy = record(Conditions(), 200, seed=1)
    for name, threshold in calibrated(200).items():
        assert alarm_rate(healthy.statistic[name], threshold, False).value <= FALSE_ALARMS
        assert alarm_rate(healthy.statistic[name], 0.99 * threshold, False).value >= FALSE_ALARMS - 1 / 200


@pytest.mark.parametrize(("own", "rest"), [(0.5, 0.5), (1.5, 13.5), (3.0, 27.0)])
def test_firings_have_the_stated_share_and_fit_into_the_period(own, rest):
    told, thruster = _firings(np.random.default_rng(0), 50, own, rest)
    np.testing.assert_array_equal(told[np.arange(50), thruster - 1], own)
    np.testing.assert_allclose(told.sum(axis=1), own + rest)
    assert told.max() <= PERIOD


def test_an_inverse_is_right_and_takes_two_cubes_less_a_square_and_one_edge_more():
    counter = Counter()
    matrix = np.diag([3.0, 5.0, 4.0]) + 0.5
    np.testing.assert_allclose(counter.invert(matrix), np.linalg.inv(matrix))
    assert counter.operations == 2 * 27 - 9 + 3


def test_a_product_takes_a_sum_of_products_for_each_entry():
    counter = Counter()
    counter.multiply(np.ones((2, 3)), np.ones((3, 4)))
    assert counter.operations == 8 * (3 + 2)


def test_a_filter_of_twice_the_states_takes_four_to_eight_times_the_operations():
    assert 4.0 < filter_operations(8) / filter_operations(4) < 8.0
