"""What the detection benchmarks measure is what they say: forms of the filter, firings, the peer's filter."""

from __future__ import annotations

import importlib
import importlib.util

import numpy as np
import pytest

from benchmarks.detection import (
    FORMS,
    LEARNING_BANK,
    ONE_THREAD_BATCH,
    OPEN,
    OTHERS,
    filterpy_filter,
    glr,
    one_by_one_with_filterpy,
    orion_firings,
)
from thruster_baselines.mapping.simplex import PARALLEL_FROM


@pytest.mark.parametrize("form", FORMS)
def test_the_noise_leads_to_the_form_that_it_is_named_for(form):
    assert glr(form).filter.form == form


def test_other_detectors_learn_nothing_but_for_those_that_are_said_to():
    for name, make in OTHERS.items():
        if name != "ResponseTest":
            learns = name in ("EstimatorThreshold", LEARNING_BANK)
            assert make(1).filter.form == ("shared" if learns else "known")


def test_firings_open_as_many_thrusters_as_they_say_and_sizes_are_on_their_side_of_the_threads():
    assert ((orion_firings(50).on_times > 0.0).sum(axis=1) == OPEN).all()
    assert ONE_THREAD_BATCH < PARALLEL_FROM <= min(size for noise in FORMS.values() for size in noise.batches)


@pytest.mark.skipif(importlib.util.find_spec("filterpy") is None, reason="a peer that need not be installed")
def test_the_filter_of_filterpy_is_the_same_filter():
    firings, other = orion_firings(60), filterpy_filter(importlib.import_module("filterpy.kalman"))
    own = glr("shared").filter
    update, calls = one_by_one_with_filterpy(other, firings)
    first = own.effectiveness[0].copy()
    for on_times, rate_change, arguments in zip(firings.on_times, firings.rate_change, calls, strict=True):
        own.update(on_times, rate_change)
        update(*arguments)
    np.testing.assert_allclose(other.x[:, 0], own.effectiveness[0].T.ravel(), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(other.P, own.covariance_of(0), rtol=0.0, atol=1e-13)
    assert np.abs(own.effectiveness[0] - first).max() > 1e-6
