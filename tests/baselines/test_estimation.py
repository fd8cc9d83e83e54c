from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from thruster_baselines.estimation import EffectivenessFilter, PhysicalNoise
from thruster_baselines.mapping.simplex import PARALLEL_FROM
from thruster_envs.spacecraft import load

ORION = load("orion")
NOMINAL = ORION.effectiveness()
AXES, THRUSTERS = NOMINAL.shape


def textbook(updates, process, noise, first):
    """The 72-state filter as it is printed in textbooks, with matrices; yields estimate, covariance, S."""
    x, p = NOMINAL.T.reshape(-1).copy(), first.copy()
    for u, z in updates:
        h = np.kron(u[np.newaxis], np.eye(AXES))
        p = p + process
        s = h @ p @ h.T + noise
        gain = p @ h.T @ np.linalg.inv(s)
        x = x + gain @ (z - h @ x)
        rest = np.eye(x.size) - gain @ h
        p = rest @ p @ rest.T + gain @ noise @ gain.T
        yield x.reshape(THRUSTERS, AXES).T, p, s


def firings(count: int, seed: int = 0, open_share: float = 0.4) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    times = rng.uniform(0.0, 5.0, (count, THRUSTERS)) * (rng.random((count, THRUSTERS)) < open_share)
    truth = NOMINAL * rng.uniform(0.8, 1.2, THRUSTERS)
    return [(u, truth @ u + 1e-3 * rng.normal(size=AXES)) for u in times]


@pytest.mark.parametrize(
    ("form", "noise", "process", "first"),
    [
        ("shared", 10.0, 0.01, 0.01),
        ("by_axis", 10.0, 0.01, 0.01),
        ("full", 10.0, 0.01, 0.02),
        ("by_axis", [1e-6] * 3 + [1e-4] * 3, [1e-9] * 3 + [1e-7] * 3, 1e-6),
        ("full", [1e-6] * 3 + [1e-4] * 3, [1e-9] * 3 + [1e-7] * 3, 1e-6),
        ("full", 1e-5 * (np.eye(6) + 0.4), 1e-8, 1e-6),
    ],
)
def test_every_form_is_the_textbook_filter(form, noise, process, first):
    updates = firings(40)
    full_noise = np.asarray(noise) if np.ndim(noise) == 2 else np.diag(np.broadcast_to(noise, 6))
    expand = [np.diag(np.tile(np.broadcast_to(values, 6), THRUSTERS)) for values in (process, first)]
    reference = textbook(updates, expand[0], full_noise, expand[1])
    own = EffectivenessFilter(NOMINAL, process, noise, first, vehicles=2, form=form)
    assert own.form == form
    scale = np.abs(NOMINAL).max(axis=1, keepdims=True)
    for (u, z), (estimate, covariance, spread) in zip(updates, reference, strict=True):
        innovation = own.update(np.stack([u, u]), np.stack([z, z]))
        np.testing.assert_allclose(own.effectiveness[1] / scale, estimate / scale, rtol=0, atol=1e-10)
        np.testing.assert_allclose(own.covariance[1], covariance, rtol=1e-9, atol=1e-10 * covariance.max())
        np.testing.assert_allclose(innovation.covariance[0], spread, rtol=1e-10)


def test_the_cheapest_exact_form_is_chosen_and_an_inexact_one_refused():
    assert EffectivenessFilter("orion", 0.01, 10.0).form == "shared"
    assert EffectivenessFilter("orion", 0.01, [1.0] * 3 + [2.0] * 3).form == "by_axis"
    assert EffectivenessFilter("orion", 0.01, np.eye(6) + 0.1).form == "full"
    with pytest.raises(ValueError, match="form is 'shared', which this noise does not admit"):
        EffectivenessFilter("orion", 0.01, [1.0] * 3 + [2.0] * 3, form="shared")


def test_first_update_of_the_source():
    """Yang 2003, chapter 6: four thrusters, one second, the first of them dead (reference 10.2)."""
    own = EffectivenessFilter("orion", 0.01, 10.0)
    u = np.zeros(12)
    u[[0, 5, 9, 11]] = 1.0
    dead = NOMINAL.copy()
    dead[:, 0] = 0.0
    innovation = own.update(u, dead @ u)
    np.testing.assert_allclose(innovation.covariance[0], 10.08 * np.eye(6), rtol=1e-12)
    moving = NOMINAL[:, 0] != 0.0
    np.testing.assert_allclose(
        own.effectiveness[0, moving, 0] / NOMINAL[moving, 0], 1.0 - 0.02 / 10.08, rtol=1e-12
    )


@pytest.mark.parametrize(("seconds", "variance", "spread"), [(1.0, 0.3213, 10.32), (5.0, 0.0684, 11.7)])
def test_steady_state_of_the_published_tuning(seconds, variance, spread):
    """One thruster fired again and again: the steady state in closed form (reference 3.3)."""
    own = EffectivenessFilter("orion", 0.01, 10.0)
    u = np.eye(12)[0] * seconds
    for _ in range(2000):
        innovation = own.update(u, NOMINAL @ u)
    closed = (0.01 * seconds**2 + np.sqrt(1e-4 * seconds**4 + 0.4 * seconds**2)) / (2.0 * seconds**2)
    assert closed == pytest.approx(variance, rel=1e-3)
    assert own.covariance[0, 0, 0] + 0.01 == pytest.approx(closed, rel=1e-9)
    assert innovation.covariance[0, 0, 0] == pytest.approx(spread, rel=2e-3)


@pytest.mark.parametrize(("share", "fresh"), [(0.8, 21), (0.6, 34), (0.2, 72)])
def test_the_published_tuning_is_as_slow_as_the_reference_computes(share, fresh):
    own = EffectivenessFilter("orion", 0.01, 10.0)
    u, firing = np.eye(12)[0], 0
    while own.effectiveness[0, 0, 0] / NOMINAL[0, 0] >= share:
        own.update(u, np.zeros(6))
        firing += 1
    assert firing == fresh


@pytest.mark.parametrize("noise", ["shared", "by_axis", "full"])
def test_innovations_are_white_and_the_covariance_is_consistent(noise):
    """Simulated with the filter's own model: NIS and NEES are chi-squared, lags uncorrelated."""
    rng = np.random.default_rng(1)
    vehicles, steps = 400, 60
    r = {"shared": 1e-4 * np.eye(6), "by_axis": np.diag([1e-6] * 3 + [1e-4] * 3)}
    r["full"] = 1e-5 * (np.eye(6) + 0.5)
    noise_matrix, process, first = r[noise], 1e-8, 1e-6
    own = EffectivenessFilter(NOMINAL, process, noise_matrix, first, vehicles=vehicles)
    truth = NOMINAL + np.sqrt(first) * rng.normal(size=(vehicles, 6, 12))
    root = np.linalg.cholesky(noise_matrix)
    whitened = np.empty((steps, vehicles, 6))
    for step in range(steps):
        truth += np.sqrt(process) * rng.normal(size=truth.shape)
        u = rng.uniform(0.0, 5.0, (vehicles, 12)) * (rng.random((vehicles, 12)) < 0.5)
        z = np.einsum("vkn,vn->vk", truth, u) + rng.normal(size=(vehicles, 6)) @ root.T
        innovation = own.update(u, z)
        whitened[step] = np.linalg.solve(
            np.linalg.cholesky(innovation.covariance), innovation.residual[..., np.newaxis]
        )[..., 0]
    nis = np.square(whitened).sum(axis=2)
    # sums over independent vehicles of chi-squared variables; five sigma
    assert abs(nis.mean() - 6.0) < 5.0 * np.sqrt(12.0 / nis.size)
    lag = (whitened[1:] * whitened[:-1]).mean()
    assert abs(lag) < 5.0 / np.sqrt(whitened[1:].size)
    error = (own.effectiveness - truth).transpose(0, 2, 1).reshape(vehicles, -1)
    nees = np.einsum("vi,vi->v", error, np.linalg.solve(own.covariance, error[..., np.newaxis])[..., 0])
    low, high = stats.chi2.ppf([1e-6, 1.0 - 1e-6], 72 * vehicles)
    assert low < nees.sum() < high


def test_thrusters_that_did_not_fire_are_left_alone_by_the_reduced_form():
    updates = firings(30, seed=2, open_share=0.2)
    full = EffectivenessFilter("orion", 1e-7, 1e-4, 1e-6, form="full")
    reduced = EffectivenessFilter("orion", 1e-7, 1e-4, 1e-6, form="fired_only")
    for u, z in updates:
        before = reduced.effectiveness.copy()
        reduced.update(u, z)
        full.update(u, z)
        assert (reduced.effectiveness[0, :, u == 0.0] == before[0, :, u == 0.0]).all()
    # an approximation, and a near one: the same estimate within a part of what is uncertain
    deviation = np.sqrt(np.diagonal(full.covariance[0]))
    difference = (reduced.effectiveness - full.effectiveness)[0].T.reshape(-1)
    assert np.abs(difference / deviation).max() < 3.0
    assert np.abs(difference).max() > 0.0


def test_a_covariance_stays_symmetric_and_positive_over_very_many_updates():
    own = EffectivenessFilter("orion", 0.0, 1e-8, 1.0, form="full")
    rng = np.random.default_rng(3)
    for _ in range(3000):
        u = rng.uniform(0.0, 5.0, 12)
        own.update(u, NOMINAL @ u)
    covariance = own.covariance[0]
    assert (covariance == covariance.T).all()
    assert np.linalg.eigvalsh(covariance).min() > -1e-16


@pytest.mark.parametrize("form", ["shared", "by_axis", "full"])
def test_missing_measurements_let_time_pass_and_no_number_is_refused_by_count(form):
    own = EffectivenessFilter("orion", 0.01, 10.0, vehicles=3, form=form)
    u = np.full(12, 1.0)
    before = own.covariance
    z = np.stack([NOMINAL @ u + 1.0, np.full(6, np.nan), NOMINAL @ u + 1.0])
    innovation = own.update(u, z, valid=[True, True, False])
    assert innovation.valid.tolist() == [True, False, False]
    assert own.refused.tolist() == [0, 1, 0]
    assert (own.effectiveness[1:] == NOMINAL).all()
    assert (own.effectiveness[0] != NOMINAL).any()
    assert (innovation.residual[1:] == 0.0).all()
    np.testing.assert_allclose(own.covariance[1:], before[1:] + 0.01 * np.eye(72), rtol=1e-12)


@pytest.mark.parametrize("form", ["shared", "by_axis", "full"])
def test_a_thruster_can_be_known_anew(form):
    own = EffectivenessFilter("orion", 0.01, 10.0, vehicles=2, form=form)
    for u, z in firings(10):
        own.update(u, z)
    kept = own.effectiveness[0].copy()
    own.replace_column([False, True], 3, 0.5 * NOMINAL[:, 2])
    assert (own.effectiveness[0] == kept).all()
    np.testing.assert_array_equal(own.effectiveness[1, :, 2], 0.5 * NOMINAL[:, 2])
    covariance = own.covariance[1]
    block = slice(12, 18)
    np.testing.assert_array_equal(covariance[block, block], 0.01 * np.eye(6))
    assert (covariance[block, 18:] == 0.0).all()
    assert (covariance[:12, block] == 0.0).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: EffectivenessFilter("orion", -1.0, 1.0), "process_noise is"),
        (lambda: EffectivenessFilter("orion", 1.0, 0.0), "measurement_noise is not positive definite"),
        (lambda: EffectivenessFilter("orion", 1.0, np.ones((6, 5))), r"measurement_noise has the shape"),
        (lambda: EffectivenessFilter("orion", 1.0, 1.0, vehicles=0), "vehicles is 0"),
        (lambda: EffectivenessFilter("orion", 1.0, 1.0).update(np.ones(11), np.ones(6)), "on_times has the"),
        (
            lambda: EffectivenessFilter("orion", 1.0, 1.0).update(np.full(12, np.nan), np.ones(6)),
            "not finite",
        ),
        (lambda: EffectivenessFilter("orion", 1.0, 1.0).replace_column([True], 0, 0.0), "thruster is 0"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_what_is_known_is_compared_and_never_learned():
    """No process noise and no first covariance: the full filter, at the cost of a subtraction."""
    noise = 1e-5 * (np.eye(6) + 0.4)
    known = EffectivenessFilter("orion", 0.0, noise)
    full = EffectivenessFilter("orion", 0.0, noise, form="full")
    assert known.form == "known"
    for u, z in firings(10):
        own, reference = known.update(u, z), full.update(u, z)
        np.testing.assert_allclose(own.residual, reference.residual, rtol=1e-12)
        np.testing.assert_allclose(own.covariance, reference.covariance, rtol=1e-12)
    assert (known.effectiveness == NOMINAL).all()
    assert (known.covariance == 0.0).all()


def test_the_physical_noise_is_the_covariance_of_simulated_rate_changes():
    noise = PhysicalNoise("orion")
    rng = np.random.default_rng(5)
    u = rng.uniform(0.0, 5.0, 12) * (np.arange(12) < 5)
    count = 200_000
    scattered = u * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, (count, 12)))
    velocities = 0.5e-3 * rng.normal(size=(2, count, 6))
    errors = (scattered - u) @ NOMINAL.T + velocities[1] - velocities[0]
    expected = noise(u)
    root = np.linalg.cholesky(expected)
    white = np.linalg.solve(root, errors.T)
    # entries of a sample covariance of near-normal numbers: standard deviation sqrt(2 / count) at most
    np.testing.assert_allclose(np.cov(white), np.eye(6), rtol=0, atol=5.0 * np.sqrt(2.0 / count))


def test_the_physical_noise_of_a_batch_is_that_of_its_rows():
    noise = PhysicalNoise(ORION)
    times = np.random.default_rng(6).uniform(0.0, 5.0, (2, 3, 12))
    np.testing.assert_array_equal(noise(times)[1, 2], noise(times[1, 2]))
    with pytest.raises(ValueError, match=r"on_times has the shape \(11,\)"):
        noise(np.zeros(11))


@pytest.mark.parametrize("form", ["known", "shared", "by_axis", "full", "fired_only"])
def test_vehicles_shared_among_threads_are_those_of_small_batches(form):
    count, some = PARALLEL_FROM + 88, 100
    variance = 0.0 if form == "known" else 0.01
    whole = EffectivenessFilter("orion", variance, 10.0, vehicles=count, form=form)
    for u, z in (zip(*firings(count, seed), strict=True) for seed in range(2)):
        found = whole.update(np.array(u), np.array(z))
    for first in range(0, count, some):
        part = EffectivenessFilter("orion", variance, 10.0, vehicles=min(some, count - first), form=form)
        here = slice(first, first + some)
        for u, z in (zip(*firings(count, seed), strict=True) for seed in range(2)):
            alone = part.update(np.array(u)[here], np.array(z)[here])
        assert np.array_equal(part.effectiveness, whole.effectiveness[here])
        assert np.array_equal(alone.residual, found.residual[here])
        assert np.array_equal(alone.covariance, found.covariance[here])
        assert np.array_equal(part.covariance_of(some // 2), whole.covariance_of(first + some // 2))
