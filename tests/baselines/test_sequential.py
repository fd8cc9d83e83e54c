"""Detectors that gather evidence over several intervals: their sums, their weights, and what they find."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from thruster_baselines.detection import CUSUMDetector, FilterBank, GLRDetector, WindowedGLR
from thruster_baselines.estimation import EffectivenessFilter, PhysicalNoise
from thruster_envs.spacecraft import load

ORION = load("orion")
NOMINAL = ORION.effectiveness()
NOISE = PhysicalNoise(ORION)


def intervals(count: int, seed: int, fault=lambda u: u, longest: float = 0.3):
    """On-times (n,) and rate changes (m,) of intervals of a second; `fault` says what was delivered."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        u = rng.uniform(0.0, longest, 12) * (rng.random(12) < 0.5)
        scattered = fault(u.copy()) * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, 12))
        yield u, NOMINAL @ scattered + np.sqrt(5e-7) * rng.normal(size=6)


def loses(thruster: int, share: float):
    def fault(u):
        u[thruster] *= 1.0 - share
        return u

    return fault


def leaks(thruster: int, share: float):
    def fault(u):
        u[thruster] += share * (1.0 - u[thruster])
        return u

    return fault


def whitened(u, z):
    """Residual and columns in units of the covariance, by linear algebra."""
    root = np.linalg.cholesky(NOISE(u))
    return np.linalg.solve(root, z - NOMINAL @ u), np.linalg.solve(root, NOMINAL)


def test_the_window_is_the_best_of_all_least_squares_fits_within_it():
    """Each thruster, kind and onset fitted to the stacked residuals with a share from 0 to 1."""
    window = 4
    detector = WindowedGLR(NOMINAL, np.inf, window, noise=NOISE)
    seen = []
    for u, z in intervals(11, 0, leaks(8, 0.05)):
        diagnosis = detector.update(u, z, 1.0)
        seen.append((u, *whitened(u, z)))
        best = np.zeros(12)
        for first in range(max(0, len(seen) - window), len(seen)):
            e = np.concatenate([one[1] for one in seen[first:]])
            for i in range(12):
                for kind in (-1, 1):
                    f = np.concatenate(
                        [(-u[i] if kind < 0 else 1.0 - u[i]) * a[:, i] for u, _, a in seen[first:]]
                    )
                    share = np.clip(np.dot(f, e) / np.dot(f, f), 0.0, 1.0) if f.any() else 0.0
                    best[i] = max(best[i], np.dot(e, e) - np.sum((e - share * f) ** 2))
        np.testing.assert_allclose(diagnosis.suspicion[0], best, rtol=1e-9, atol=1e-9)
        assert diagnosis.statistic[0] == diagnosis.suspicion[0].max()


@pytest.mark.parametrize("thruster", [0, 4, 11])
@pytest.mark.parametrize("make", [loses, leaks])
def test_a_window_finds_who_how_how_badly_and_since_when(make, thruster):
    detector = WindowedGLR(NOMINAL, 40.0, 40, noise=NOISE)
    share, onset = (0.8 if make is loses else 0.2), 10
    for u, z in intervals(onset, 1):
        assert not detector.update(u, z, 1.0).detected[0]
    for u, z in intervals(30, 2, make(thruster, share)):
        diagnosis = detector.update(u, z, 1.0)
    assert diagnosis.thruster.tolist() == [thruster + 1]
    assert detector.excess.tolist() == [make is leaks]
    assert detector.share[0] == pytest.approx(share, abs=0.05)
    assert abs(detector.onset[0] - onset) <= 3.0


def test_a_window_finds_a_leak_that_no_single_interval_shows():
    """Half a percent: one interval has a chance of a few percent at a threshold of 20."""
    single = GLRDetector(NOMINAL, 20.0, noise=NOISE)
    window = WindowedGLR(NOMINAL, 20.0, 40, noise=NOISE)
    alarms = np.zeros(2)
    for u, z in intervals(60, 3, leaks(5, 0.02), longest=0.05):
        alarms += single.update(u, z, 1.0).detected[0], window.update(u, z, 1.0).detected[0]
    assert alarms[0] == 0
    assert alarms[1] > 0


def test_an_interval_without_a_measurement_takes_no_place_in_the_window():
    gaps, whole = (WindowedGLR(NOMINAL, np.inf, 3, noise=NOISE) for _ in range(2))
    for index, (u, z) in enumerate(intervals(8, 4, loses(3, 0.5))):
        expected = whole.update(u, z, 1.0)
        if index % 2:
            gaps.update(u, np.full(6, np.nan), 1.0)
        diagnosis = gaps.update(u, z, 1.0)
        np.testing.assert_array_equal(diagnosis.suspicion, expected.suspicion)


def test_a_cumulative_sum_is_the_walk_above_its_lowest_point():
    """g_k = S_k - min over j <= k of S_j, S the plain sum of the log-likelihood ratios (Page 1954)."""
    detector = CUSUMDetector(NOMINAL, np.inf, design_loss=0.4, design_excess=0.1, noise=NOISE)
    walk, lowest = np.zeros((2, 12)), np.zeros((2, 12))
    for u, z in intervals(30, 5, loses(2, 0.3)):
        diagnosis = detector.update(u, z, 1.0)
        e, a = whitened(u, z)
        for i in range(12):
            for kind, size in ((0, -0.4 * u[i]), (1, 0.1 * (1.0 - u[i]))):
                shift = size * a[:, i]
                # log of the ratio of the two normal densities of the whitened residual
                walk[kind, i] += (norm.logpdf(e, shift) - norm.logpdf(e)).sum()
        lowest = np.minimum(lowest, walk)
        np.testing.assert_allclose(detector.sums[0], walk - lowest, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(diagnosis.suspicion[0], detector.sums[0].max(axis=0))


@pytest.mark.parametrize(("make", "share"), [(loses, 0.5), (leaks, 0.3)])
@pytest.mark.parametrize("thruster", [1, 6, 9])
def test_a_cumulative_sum_names_who_failed(make, share, thruster):
    detector = CUSUMDetector(NOMINAL, 12.0, design_excess=0.2, noise=NOISE)
    for u, z in intervals(30, 6):
        assert not detector.update(u, z, 1.0).detected[0]
    for u, z in intervals(40, 7, make(thruster, share)):
        diagnosis = detector.update(u, z, 1.0)
    assert diagnosis.thruster.tolist() == [thruster + 1]
    assert detector.sums[0, :, thruster].argmax() == (make is leaks)


def test_the_blame_goes_to_the_share_from_none_to_all_that_explains_the_most():
    """Since each sum was last at zero, by least squares; no more than all thrust is missing or too much.

    Thruster 5 is stuck wide open, of which noise makes more than all in some intervals.
    """
    detector = CUSUMDetector(NOMINAL, 1e-9, design_loss=0.4, design_excess=0.2, noise=NOISE)
    since = [[[] for _ in range(12)] for _ in range(2)]
    beyond = 0
    for u, z in intervals(40, 8, leaks(4, 1.0)):
        diagnosis = detector.update(u, z, 1.0)
        e, a = whitened(u, z)
        explained, shares = np.full((2, 12), -np.inf), np.zeros((2, 12))
        for kind in range(2):
            for i in range(12):
                run = since[kind][i]
                run.append((e, (-u[i] if kind == 0 else 1.0 - u[i]) * a[:, i]))
                if detector.sums[0, kind, i] == 0.0:
                    run.clear()
                    continue
                residual, signature = (np.concatenate(one) for one in zip(*run, strict=True))
                free = np.dot(signature, residual) / np.dot(signature, signature)
                beyond += free > 1.0
                shares[kind, i] = min(free, 1.0)
                left = residual - shares[kind, i] * signature
                explained[kind, i] = np.dot(residual, residual) - np.dot(left, left)
        assert diagnosis.thruster[0] == 1 + explained.max(axis=0).argmax()
        larger = detector.sums[0].argmax(axis=0)
        change = np.where(larger == 0, u, u - 1.0) * shares[larger, np.arange(12)]
        np.testing.assert_allclose(diagnosis.shortfall[0], change, rtol=1e-9, atol=1e-12)
    assert beyond > 10


def hypotheses(u):
    """What is delivered, without coupling, under each hypothesis of the bank, in its order."""
    yield u
    for i in range(12):
        for value in (0.0, 0.5 * u[i], 1.0):
            other = u.copy()
            other[i] = value
            yield other


def test_the_weights_of_the_bank_are_those_of_bayes_and_its_mixture_is_that_of_its_filters():
    """Against 37 filters of their own and the normal density of SciPy."""
    noise, process = 1e-6, 1e-8
    bank = FilterBank(NOMINAL, np.inf, noise=noise, process_noise=process, floor=1e-9)
    filters = [EffectivenessFilter(NOMINAL, process, noise) for _ in range(37)]
    log_posterior = np.log(np.array([1.0 - 36e-9] + [1e-9] * 36))
    for u, z in intervals(6, 8, loses(7, 0.75), longest=0.3):
        bank.update(u, z, 1.0)
        for h, delivered in enumerate(hypotheses(u)):
            innovation = filters[h].update(delivered, z)
            log_posterior[h] += multivariate_normal.logpdf(
                innovation.residual[0], cov=innovation.covariance[0]
            )
    posterior = np.exp(log_posterior - log_posterior.max())
    posterior /= posterior.sum()
    assert bank.log_weights.min() == pytest.approx(np.log(1e-9), abs=1e-3)  # the floor was reached, and
    np.testing.assert_allclose(bank.probability[0], posterior, rtol=0, atol=1e-6)  # changed nothing else
    assert np.sort(posterior)[-2] > 0.01  # a true mixture, or the rest would test nothing
    mean, second = np.zeros(72), np.zeros((72, 72))
    for h in range(37):
        scale = np.ones(12)
        if h:
            scale[(h - 1) // 3] = (0.0, 0.5, 0.0)[(h - 1) % 3]
        own = (filters[h].effectiveness[0] * scale).T.reshape(-1)
        by_entry = np.repeat(scale, 6)
        mean += posterior[h] * own
        second += posterior[h] * (
            filters[h].covariance[0] * np.outer(by_entry, by_entry) + np.outer(own, own)
        )
    found_mean, found_covariance = bank.mixture()
    np.testing.assert_allclose(found_mean.T.reshape(-1), mean, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found_covariance, second - np.outer(mean, mean), rtol=0, atol=1e-10)
    assert np.diagonal(found_covariance).max() > 1e-6  # what is asked for is far below what there is


@pytest.mark.parametrize("thruster", [0, 7])
@pytest.mark.parametrize(
    ("kind", "fault"), [("off", lambda i: loses(i, 1.0)), ("weak", lambda i: loses(i, 0.5)), ("on", None)]
)
def test_the_bank_finds_a_new_fault_after_a_long_time_of_health(kind, fault, thruster):
    bank = FilterBank(NOMINAL, 8.0, noise=NOISE)
    for u, z in intervals(300, 9):
        assert not bank.update(u, z, 1.0).detected[0]
    assert bank.log_weights.min() == pytest.approx(np.log(1e-9), abs=1e-6)
    for u, z in intervals(40, 10, leaks(thruster, 1.0) if fault is None else fault(thruster)):
        diagnosis = bank.update(u, z, 1.0)
    assert diagnosis.thruster.tolist() == [thruster + 1]
    assert bank.kind == [kind]
    assert np.exp(bank.log_weights).sum() == pytest.approx(1.0, rel=1e-12)


def test_the_bank_does_not_suspect_a_thruster_that_is_believed_dead():
    bank = FilterBank(NOMINAL, 1.0, noise=NOISE)
    believed = NOMINAL.copy()
    believed[:, 3] = 0.0
    bank.believe(believed)
    assert (bank.probability[0, 10:13] == 0.0).all()
    for u, z in intervals(5, 11, loses(3, 1.0)):
        diagnosis = bank.update(u, z, 1.0)
    assert (bank.probability[0, 10:13] == 0.0).all()
    assert diagnosis.thruster[0] != 4


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: WindowedGLR(ORION, 1.0, 0), "window is 0; one interval or more would be right"),
        (lambda: CUSUMDetector(ORION, 1.0, design_loss=0.0), "design_loss is 0.0; a share above 0"),
        (lambda: CUSUMDetector(ORION, 1.0, design_excess=1.5), "design_excess is 1.5"),
        (lambda: FilterBank(ORION, 1.0, weak_share=1.0), "weak_share is 1.0; between 0 and 1 would be right"),
        (lambda: FilterBank(ORION, 1.0, floor=0.0), "floor is 0.0; between 0 and 1 would be right"),
        (lambda: FilterBank(ORION, 1.0, floor=0.1), "floor is 0.1; below 1 / 37, as there are so many"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()
