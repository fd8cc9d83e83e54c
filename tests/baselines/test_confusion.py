"""The measures of declarations against the truth are those that the source prints for its own counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import binomtest

from thruster_baselines.detection import MEASURES, Confusion, largest_scaled_threshold

LOW_LEVEL = Confusion(34, 25, 10, 246)
INTEGRATED = Confusion(7293, 2, 20, 3240)
COUNTS = st.integers(0, 10_000)


@pytest.mark.parametrize(
    ("cells", "printed"),
    [
        (LOW_LEVEL, {"accuracy": 88.89, "specificity": 96.09, "miss_rate": 42.37, "recall": 57.63}),
        (
            INTEGRATED,
            {
                "accuracy": 99.79, "specificity": 99.39, "miss_rate": 0.03, "recall": 99.97,
                "false_alarm_rate": 0.61, "negative_predictive_value": 99.94,
            },
        ),
    ],
)  # fmt: skip
def test_published_cells_give_the_published_measures(cells, printed):
    assert {name: round(100 * getattr(cells, name), 2) for name in printed} == printed


def test_the_published_precision_of_the_low_level_is_no_share_of_its_cells():
    cells = (34, 25, 10, 246)
    sums = [sum(c for c, used in zip(cells, f"{k:04b}", strict=True) if used == "1") for k in range(1, 16)]
    assert all(abs(100 * a / b - 66.67) > 0.005 for a in sums for b in sums)


@given(st.builds(Confusion, COUNTS, COUNTS, COUNTS, COUNTS))
def test_rates_of_one_class_add_up_to_one(cells):
    if cells.faulty:
        assert cells.recall + cells.miss_rate == pytest.approx(1.0)
    if cells.healthy:
        assert cells.specificity + cells.false_alarm_rate == pytest.approx(1.0)
    if cells.faulty and cells.healthy:
        assert cells.balanced_accuracy == pytest.approx(
            1.0 - 0.5 * (cells.miss_rate + cells.false_alarm_rate)
        )


@given(arrays(bool, 40), arrays(bool, 40), st.integers(0, 40))
def test_parts_add_up_to_the_whole(faulty, declared, cut):
    parts = (Confusion.of(faulty[:cut], declared[:cut]), Confusion.of(faulty[cut:], declared[cut:]))
    whole = Confusion.of(faulty, declared)
    assert Confusion.total(parts) == whole
    assert whole.accuracy == pytest.approx(np.mean(faulty == declared))


@pytest.mark.parametrize("measure", MEASURES)
def test_intervals_are_those_of_the_counts_behind_a_measure(measure):
    rate = LOW_LEVEL.rate(measure, confidence=0.9)
    assert rate.value == pytest.approx(getattr(LOW_LEVEL, measure))
    expected = binomtest(rate.successes, rate.trials).proportion_ci(0.9, method="exact")
    assert (rate.low, rate.high) == pytest.approx((expected.low, expected.high))


def test_what_cannot_be_measured_is_no_number():
    nothing_faulty = Confusion(0, 0, 0, 7)
    assert math.isnan(nothing_faulty.recall)
    assert math.isnan(nothing_faulty.precision)
    assert nothing_faulty.specificity == 1.0


def test_a_threshold_of_scale_one_is_the_largest_and_of_scale_zero_the_mean():
    residuals = np.random.default_rng(0).gamma(2.0, size=(120, 3))
    np.testing.assert_allclose(largest_scaled_threshold(residuals, 1.0), residuals.max(axis=0))
    np.testing.assert_allclose(largest_scaled_threshold(residuals, 0.0), residuals.mean(axis=0))


def test_a_threshold_of_a_scale_above_one_clears_everything_that_it_was_made_from():
    residuals = np.random.default_rng(1).gamma(2.0, size=120)
    assert (residuals < largest_scaled_threshold(residuals, 1.15)).all()


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: Confusion(1, -2, 0, 0), "missed is -2; zero or more would be right"),
        (lambda: Confusion.of([True], [True, False]), r"declared has the shape \(2,\); that of faulty"),
        (lambda: LOW_LEVEL.rate("precison"), "measure is 'precison'; one of accuracy,"),
        (lambda: largest_scaled_threshold([], 1.0), r"residuals has the shape \(0,\)"),
        (lambda: largest_scaled_threshold([1.0, math.nan], 1.0), "an entry that is no number"),
        (lambda: largest_scaled_threshold([1.0], [1.0, -1.0]), "scale is .* zero or more would be right"),
    ],
)
def test_what_is_no_count_or_residual_gets_its_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()
