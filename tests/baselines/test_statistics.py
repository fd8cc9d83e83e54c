from __future__ import annotations

import pytest
from scipy.stats import binom, binomtest

from thruster_baselines.statistics import clopper_pearson


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 1), (1, 1), (3, 10), (10, 10), (1, 10_000), (9_950, 10_000)]
)
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_the_interval_is_that_of_scipy(successes, trials, confidence):
    interval = binomtest(successes, trials).proportion_ci(confidence, method="exact")
    assert clopper_pearson(successes, trials, confidence) == pytest.approx(
        (interval.low, interval.high), rel=1e-9
    )


def test_the_interval_of_no_success_has_a_closed_form():
    assert clopper_pearson(0, 25) == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / 25)), rel=1e-12)


@pytest.mark.parametrize("rate", [0.01, 0.3, 0.5, 0.9])
def test_the_true_rate_is_inside_as_often_as_promised(rate):
    trials = 30
    inside = [low <= rate <= high for low, high in (clopper_pearson(k, trials) for k in range(trials + 1))]
    assert sum(binom.pmf(k, trials, rate) for k in range(trials + 1) if inside[k]) >= 0.95


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((1, 0), "trials is 0; one or more would be right"),
        ((-1, 5), "successes is -1 of 5 trials; 0 to 5 would be right"),
        ((6, 5), "successes is 6 of 5 trials; 0 to 5 would be right"),
        ((1, 5, 1.0), "confidence is 1.0; between 0 and 1 would be right"),
    ],
)
def test_what_is_no_rate_gets_its_line(arguments, line):
    with pytest.raises(ValueError, match=line):
        clopper_pearson(*arguments)
