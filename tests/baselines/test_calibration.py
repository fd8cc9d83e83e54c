"""Thresholds keep the false-alarm rate they are calibrated to; healthy firings are those of the source."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import beta, chi2

from thruster_baselines.detection import (
    CUSUMDetector,
    GenericChiSquared,
    GLRDetector,
    SingleChiSquared,
    chi_squared_threshold,
    healthy_firings,
    rate_per_interval,
    threshold_for_rate,
)
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs.spacecraft import Feed, Sensors, load

ORION = load("orion")
ALONE = ORION.replace(feed=Feed(coupling=0.0))
"""Orion without the loss of the shared feed, which the table of the reference leaves out."""


def likelihood_ratios(spacecraft=ALONE, **firing):
    """The largest likelihood ratio of each of 100,000 firings, with Y = 10 I."""
    firings = healthy_firings(spacecraft, 100_000, seed=55, differenced=False, **firing)
    detector = GLRDetector.yang2003(spacecraft, math.inf, process_noise=0.0, vehicles=100_000)
    return detector.update(firings.on_times, firings.rate_change, firings.duration).statistic


@pytest.mark.parametrize(
    ("open_thrusters", "longest", "rate", "scatter", "mean", "largest", "above_3", "above_5_5"),
    [
        (4, 1.0, 0.5e-3, "uniform", 1.5e-6, 1.8e-5, 0.0, 0.0),
        (6, 1.0, 0.5e-3, "uniform", 2.1e-6, 2.1e-5, 0.0, 0.0),
        (12, 1.0, 0.5e-3, "uniform", 4.1e-6, 3.9e-5, 2e-4, 0.0),
        (4, 1.0, math.radians(0.5), "uniform", 2.0e-5, 1.9e-4, 0.22, 0.046),
        (4, 5.0, 0.5e-3, "uniform", 3.4e-5, 4.4e-4, 0.42, 0.20),
        (6, 5.0, 0.5e-3, "normal", 1.7e-5, 3.1e-4, 0.17, 0.05),
    ],
)
def test_healthy_likelihood_ratios_of_the_reference(
    open_thrusters, longest, rate, scatter, mean, largest, above_3, above_5_5
):
    """Reference 5.5, printed with two digits; the largest of 100,000 varies by some tens of percent."""
    craft = ALONE.replace(sensors=Sensors(velocity=0.5e-3, rate=rate))
    found = likelihood_ratios(
        craft, open_thrusters=open_thrusters, longest=longest, duration=5.0, scatter=scatter
    )
    assert found.mean() == pytest.approx(mean, rel=0.06)
    assert found.max() == pytest.approx(largest, rel=0.35)
    for threshold, share in ((3e-5, above_3), (5.5e-5, above_5_5)):
        sampling = 5.0 * math.sqrt(share * (1.0 - share) / 100_000)
        assert abs((found > threshold).mean() - share) <= sampling + 0.05 * share


def test_scatter_matters_more_than_sensors():
    """Yang 2003, section 6.4.2: doubling the firing errors raises alarms more than doubling the sensors'."""
    wide = ALONE.replace(
        thrusters=[one.__class__(**(vars(one) | {"scatter": 2.0 * one.scatter})) for one in ALONE.thrusters]
    )
    noisy = ALONE.replace(sensors=Sensors(velocity=1e-3, rate=1e-3))
    default, doubled_scatter, doubled_sensors = (
        likelihood_ratios(one, open_thrusters=6, duration=1.0) for one in (ALONE, wide, noisy)
    )
    assert default.max() < doubled_sensors.max() < doubled_scatter.max()
    threshold = 1e-5
    assert (default > threshold).sum() < (doubled_sensors > threshold).sum()
    assert (doubled_sensors > threshold).sum() < (doubled_scatter > threshold).sum()


@pytest.mark.parametrize("confidence", [0.6, 0.9, 0.95])
def test_the_threshold_keeps_its_promise_as_often_as_it_says(confidence):
    """Uniform statistics, whose true rate above a threshold t is 1 - t; 4,000 calibrations of 500."""
    rng, rate = np.random.default_rng(0), 0.02
    kept = [
        1.0 - threshold_for_rate(rng.random(500), rate, confidence).threshold <= rate for _ in range(4000)
    ]
    sampling = math.sqrt(confidence * (1.0 - confidence) / 4000)
    assert np.mean(kept) > confidence - 4.0 * sampling


def test_the_threshold_is_the_lowest_that_the_data_support():
    """The true rate above the (c + 1)-th largest of N is Beta(c + 1, N - c), whatever the distribution."""
    samples, rate, confidence = 2000, 0.01, 0.95
    values = np.random.default_rng(1).normal(size=samples)
    calibration = threshold_for_rate(values, rate, confidence)
    above = int((values > calibration.threshold).sum())
    assert calibration.upper == pytest.approx(beta.ppf(confidence, above + 1, samples - above), rel=1e-9)
    assert calibration.upper <= rate < beta.ppf(confidence, above + 2, samples - above - 1)
    assert calibration.observed == pytest.approx(above / samples, rel=1e-12)
    assert calibration.threshold in values


def test_where_statistics_repeat_the_bound_is_of_what_truly_exceeds():
    calibration = threshold_for_rate(np.repeat([0.0, 1.0], [900, 100]), 0.02)
    assert calibration.threshold == 1.0
    assert calibration.observed == 0.0


def test_the_number_of_samples_that_is_asked_for_is_just_enough():
    """Without any exceedance N samples show a rate p if (1 - p)^N <= 1 - confidence."""
    with pytest.raises(ValueError, match=r"100 samples cannot show .* 2995 or more would be right"):
        threshold_for_rate(np.zeros(100), 0.001)
    values = np.random.default_rng(2).random(2995)
    assert threshold_for_rate(values, 0.001).threshold == values.max()
    with pytest.raises(ValueError, match="2994 samples cannot show"):
        threshold_for_rate(values[1:], 0.001)


def test_flights_of_dependent_intervals_count_as_flights():
    """Statistics that stay all flight long: a flight either alarms in all intervals or in none."""
    rng, intervals, rate = np.random.default_rng(3), 50, 1e-3
    flights = np.repeat(rng.random((4000, 1)), intervals, axis=1)
    calibration = threshold_for_rate(flights, rate)
    of_flights = 1.0 - (1.0 - rate) ** intervals
    assert calibration.samples == 4000
    assert 1.0 - calibration.threshold <= of_flights
    assert 1.0 - calibration.threshold > 0.7 * of_flights  # and not much lower than it has to be
    with pytest.raises(ValueError, match=r"50 flights of 50 intervals .*; 60 or more would be right"):
        threshold_for_rate(flights[:50], rate)


def test_independent_intervals_may_be_given_either_way():
    """As flights they give nearly the same threshold, one of the largest being hidden now and then."""
    values = np.random.default_rng(4).exponential(size=(4000, 25))
    flat, flown = threshold_for_rate(values.ravel(), 1e-3), threshold_for_rate(values, 1e-3)
    # the exponential distribution: the rate above t is exp(-t), both within what 100 exceedances tell
    assert math.exp(-flat.threshold) == pytest.approx(1e-3, rel=0.35)
    assert math.exp(-flown.threshold) == pytest.approx(1e-3, rel=0.35)


@pytest.mark.parametrize("kind", ["generic", "single", "ratio", "cumulative"])
def test_healthy_vehicles_alarm_no_more_often_than_calibrated(kind):
    """20,000 intervals to calibrate, 20,000 others to check, four standard deviations."""
    rate, flights, intervals = 0.01, 1000, 20
    noise = PhysicalNoise(ORION)
    make = {
        "generic": lambda t: GenericChiSquared(ORION, t, noise=noise, vehicles=flights),
        "single": lambda t: SingleChiSquared(ORION, t, noise=noise, vehicles=flights),
        "ratio": lambda t: GLRDetector(ORION, t, noise=noise, vehicles=flights),
        "cumulative": lambda t: CUSUMDetector(ORION, t, noise=noise, vehicles=flights),
    }[kind]

    def statistics(first_seed):
        detector, found = make(math.inf), []
        for step in range(intervals):
            firings = healthy_firings(ORION, flights, seed=first_seed + step, open_thrusters=4, duration=1.0)
            found.append(detector.update(firings.on_times, firings.rate_change, 1.0).statistic)
        return np.stack(found, axis=1)

    calibration = threshold_for_rate(statistics(0), rate)
    with_alarm = (statistics(1000) > calibration.threshold).any(axis=1).mean()
    stated = 1.0 - (1.0 - rate) ** intervals
    assert with_alarm < stated + 4.0 * math.sqrt(stated * (1.0 - stated) / flights)
    assert with_alarm > 0.5 * stated


def test_the_closed_form_is_that_of_scipy_and_of_the_reference():
    assert chi_squared_threshold(0.05, degrees=6) == pytest.approx(chi2.isf(0.05, 6), rel=1e-12)
    assert chi_squared_threshold(1e-5, tests=6) == pytest.approx(23.0, abs=0.2)  # reference 5.4


@pytest.mark.parametrize(
    ("kind", "degrees", "tests"), [("generic", 6, 1), ("single", 1, 6), ("ratio", 1, 12)]
)
def test_the_closed_form_keeps_the_rate_where_errors_are_normal(kind, degrees, tests):
    count, rate = 100_000, 0.01
    noise = PhysicalNoise(ORION)
    rng = np.random.default_rng(6)
    errors = np.sqrt(5e-7) * rng.normal(size=(count, 6))
    threshold = chi_squared_threshold(rate, degrees, tests)
    maker = {"generic": GenericChiSquared, "single": SingleChiSquared, "ratio": GLRDetector}[kind]
    diagnosis = maker(ORION, threshold, noise=noise, vehicles=count).update(np.zeros(12), errors, 1.0)
    share = diagnosis.detected.mean()
    sampling = 5.0 * math.sqrt(rate * (1.0 - rate) / count)
    assert share < rate + sampling
    if kind != "ratio":  # of the ratio's twelve directions six pairs are nearly the same, so it is lower
        assert share > 0.95 * rate - sampling
    else:
        assert share > 0.4 * rate


def test_firings_are_told_by_their_seed_and_as_large_as_described():
    one, same, other = (
        healthy_firings(ORION, 5, seed=seed, open_thrusters=3, longest=0.5, duration=2.0)
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.rate_change, same.rate_change)
    assert (one.on_times != other.on_times).any()
    assert one.on_times.max() <= 0.5
    assert one.duration == 2.0
    assert healthy_firings(ORION, 1, seed=0).duration == ORION.control_period


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: threshold_for_rate([1.0], 0.0), "false_alarms is 0.0; a rate above 0 and below 1"),
        (lambda: threshold_for_rate([1.0], 0.5, 1.0), "confidence is 1.0; above 0.5 and below 1"),
        (lambda: threshold_for_rate([[[1.0]]], 0.5), r"statistics has the shape \(1, 1, 1\)"),
        (lambda: threshold_for_rate([], 0.5), r"statistics has the shape \(0,\)"),
        (lambda: threshold_for_rate([np.nan] * 10, 0.5), "statistics has an entry that is no number"),
        (lambda: rate_per_interval(0.0, 3600.0, 5.0), "false_alarms must be positive and finite, got 0.0"),
        (lambda: rate_per_interval(1.0, -1.0, 5.0), "per must be positive and finite, got -1.0"),
        (lambda: rate_per_interval(720.0, 3600.0, 5.0), "false_alarms must be below 720 in 3600 s"),
        (lambda: chi_squared_threshold(1.0), "false_alarms is 1.0"),
        (lambda: chi_squared_threshold(0.1, 0), "degrees is 0; one or more would be right"),
        (lambda: chi_squared_threshold(0.1, tests=0), "tests is 0"),
        (lambda: healthy_firings(ORION, 0, seed=0), "count is 0"),
        (lambda: healthy_firings(ORION, 1, seed=0, open_thrusters=13), "open_thrusters is 13; a number from"),
        (lambda: healthy_firings(ORION, 1, seed=0, longest=6.0), "longest is 6.0 and duration 5.0"),
        (lambda: healthy_firings(ORION, 1, seed=0, scatter="none"), "scatter is 'none'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()
