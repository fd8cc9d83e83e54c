from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from thruster_baselines.mapping import commanded_on_times, delivered_on_times, delivered_rate_change
from thruster_baselines.mapping.coupling import thrust_shares
from thruster_envs.spacecraft import load

ORION = load("orion")


def by_counting(on_times: np.ndarray, share) -> np.ndarray:
    """Delivered on-times by cutting the period where a thruster closes and counting the open ones."""
    delivered, before = np.zeros(on_times.size), 0.0
    for until in np.unique(on_times[on_times > 0.0]):
        is_open = on_times >= until
        delivered[is_open] += (until - before) * share(is_open.sum())
        before = until
    return delivered


def test_the_worked_example_of_the_source():
    on_times = np.zeros(12)
    on_times[[0, 5, 9, 11]] = 4.5  # four together: 18 % lost
    achieved = ORION.effectiveness() @ delivered_on_times(on_times, 0.06)
    np.testing.assert_allclose(achieved, [-0.02214, -0.02214, 0, 0, 0, 0], atol=1e-12)


def test_the_overlap_example_of_the_source():
    signs = np.sign(np.round(ORION.effectiveness(), 9))
    on_times = np.zeros(12)
    on_times[[2, 3, 6, 10]] = 1.0, 3.0, 2.0, 1.0
    achieved = signs @ delivered_on_times(on_times, 0.06)
    np.testing.assert_allclose(achieved, [4.52, 0.82, 0.82, 0.0, -0.18, 0.18], atol=1e-12)


on_time_lists = st.lists(st.one_of(st.just(0.0), st.floats(0.0, 5.0)), min_size=1, max_size=12).map(np.array)


@given(on_time_lists, st.floats(0.0, 0.09))
def test_delivery_counts_the_open_thrusters(on_times, coupling):
    np.testing.assert_allclose(
        delivered_on_times(on_times, coupling),
        by_counting(on_times, lambda count: 1.0 - coupling * (count - 1)),
        rtol=1e-12,
        atol=1e-12,
    )


@given(on_time_lists, st.floats(0.0, 0.08))
def test_commanded_on_times_deliver_what_was_wanted(wanted, coupling):
    commanded = commanded_on_times(wanted, coupling)
    np.testing.assert_allclose(delivered_on_times(commanded, coupling), wanted, rtol=0, atol=1e-10)
    assert (commanded >= wanted * (1.0 - 1e-14)).all()
    assert ((commanded > 0.0) == (wanted > 0.0)).all()


def test_commanded_on_times_are_cut_at_the_bound_and_keep_their_shape():
    wanted = np.full((2, 3, 4), 4.5)
    wanted[1] = 1.0
    commanded = commanded_on_times(wanted, 0.06, max_on_time=5.0)
    assert commanded.shape == wanted.shape
    assert (commanded[0] == 5.0).all()
    np.testing.assert_allclose(commanded[1], 1.0 / 0.82, rtol=1e-14)
    # so strong a coupling that no on-times would do still gives an answer within the bound
    assert (commanded_on_times(np.full(12, 3.0), 0.5, max_on_time=5.0) == 5.0).all()


@pytest.mark.parametrize("as_function", [False, True])
def test_any_loss_curve_can_be_given(as_function):
    losses = np.array([0.02, 0.05, 0.2, 0.21])  # even one thruster alone may lose something
    curve = (lambda count: losses[count - 1]) if as_function else losses
    on_times = np.random.default_rng(0).uniform(0.0, 5.0, (200, 4)) * (np.arange(4) != 2)
    delivered = delivered_on_times(on_times, curve)
    for row, expected in zip(on_times, delivered, strict=True):
        np.testing.assert_allclose(
            by_counting(row, lambda count: 1.0 - losses[count - 1]), expected, rtol=1e-13
        )
    np.testing.assert_allclose(commanded_on_times(delivered, curve), on_times, rtol=1e-12)
    np.testing.assert_allclose(
        delivered_rate_change(np.eye(4), on_times, curve), delivered, rtol=1e-14, atol=1e-300
    )


def test_six_open_thrusters_of_orion_lose_thirty_percent_each():
    np.testing.assert_allclose(thrust_shares(ORION.feed.coupling, 12)[1:7], 1.0 - 0.06 * np.arange(6))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: delivered_on_times([1.0, -1.0], 0.06), r"on_times has the entry -1\.0"),
        (lambda: delivered_on_times([1.0, np.nan], 0.06), "on_times has the entry nan"),
        (lambda: delivered_on_times(1.0, 0.06), "on_times is a single number"),
        (lambda: delivered_on_times([1.0, 1.0], 1.5), "coupling is 1.5; a share of the thrust"),
        (lambda: delivered_on_times([1.0, 1.0], [0.0, 0.1, 0.2]), r"coupling has the shape \(3,\)"),
        (lambda: delivered_on_times([1.0, 1.0], [0.0, 1.1]), r"with 2 thrusters open is 1\.1"),
        (lambda: delivered_on_times([1.0, 1.0], lambda count: np.nan), "with 1 thrusters open is nan"),
        (lambda: commanded_on_times([1.0, 1.0, 1.0], 0.5), "nothing of their thrust is left"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
