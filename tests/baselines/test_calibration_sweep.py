"""A sweep of single firings finds what each thruster does, as well as its covariance says."""

from __future__ import annotations

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import chi2

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.estimation import CalibrationSweep, EffectivenessFilter, PhysicalNoise
from thruster_envs.spacecraft import load

ORION = load("orion")
NOMINAL = ORION.effectiveness()


def fired(sweep, effectiveness, rng, scatter=0.1):
    """Rate changes (firings, 6) with scatter, and velocities and rates measured before and after each."""
    strength = 1.0 + scatter * rng.uniform(-1.0, 1.0, len(sweep.on_times))
    sigma = np.repeat([ORION.sensors.velocity, ORION.sensors.rate], 3)
    errors = sigma * rng.normal(size=(len(sweep.on_times) + 1, 6))
    return (sweep.on_times * strength[:, np.newaxis]) @ effectiveness.T + np.diff(errors, axis=0)


def misaligned(rng, degrees=3.0):
    """Orion's thrusters after a rough launch: each column off by some per cent, in any direction."""
    size = np.linalg.norm(NOMINAL[:3], axis=0), np.linalg.norm(NOMINAL[3:], axis=0)
    off = np.concatenate([np.repeat(one[np.newaxis], 3, axis=0) for one in size])
    return NOMINAL + np.radians(degrees) * off * rng.normal(size=NOMINAL.shape)


@pytest.mark.parametrize(
    ("pulse", "repetitions", "scatter"), [(1.0, 1, 0.1), (4.0, 3, 0.1), (1.0, 1, 0.0), (4.0, 3, 0.0)]
)
def test_errors_are_what_the_covariance_says(pulse, repetitions, scatter):
    rng = np.random.default_rng(3)
    thrusters = [dataclasses.replace(one, scatter=scatter) for one in ORION.thrusters]
    sweep = CalibrationSweep(ORION.replace(thrusters=thrusters), pulse, repetitions)
    squares = []
    for _ in range(60):
        true = misaligned(rng)
        calibration = sweep.estimate(fired(sweep, true, rng, scatter))
        error = (calibration.effectiveness - true).T.ravel()
        squares.append(error @ np.linalg.solve(calibration.covariance, error))
    # 72 entries: the mean of 60 squares has a standard deviation of sqrt(2 * 72 / 60) = 1.5; five of them
    assert abs(np.mean(squares) - 72.0) < 7.7


def test_what_was_misaligned_stands_out_and_what_was_not_does_not():
    rng = np.random.default_rng(4)
    sweep = CalibrationSweep(ORION, 4.0, 3)
    limit = chi2.isf(1e-4 / 12, 6)
    true = NOMINAL.copy()
    true[:3, 4] = np.linalg.norm(NOMINAL[:3, 4]) * np.array([np.sin(0.3), 0.0, -np.cos(0.3)])
    for _ in range(20):
        statistic = sweep.estimate(fired(sweep, true, rng)).statistic
        assert (statistic > limit).nonzero()[0].tolist() == [4]


def test_more_firings_help_against_scatter_and_longer_ones_do_not():
    def along(pulse, repetitions):
        """Relative deviation of the thrust of thruster 1, along its column."""
        sweep = CalibrationSweep(ORION, pulse, repetitions)
        covariance = sweep.estimate(sweep.on_times @ NOMINAL.T).covariance[:6, :6]
        column = NOMINAL[:, 0]
        return np.sqrt(1.0 / (column @ np.linalg.solve(covariance, column)))

    assert along(5.0, 1) == pytest.approx(0.1 / np.sqrt(3.0), rel=0.01)
    assert along(5.0, 4) == pytest.approx(along(5.0, 1) / 2.0, rel=0.01)
    assert along(2.5, 1) == pytest.approx(along(5.0, 1), rel=0.01)


def test_the_kalman_filter_that_knows_nothing_gives_the_same_if_errors_are_independent():
    """With sensors without error only scatter is left, which firings do not share."""
    rng = np.random.default_rng(5)
    sweep = CalibrationSweep(ORION, 2.0, 2)
    measured = fired(sweep, NOMINAL, rng)
    filter_ = EffectivenessFilter(ORION, 0.0, np.eye(6) * 1e-6, initial_covariance=1e4, form="full")
    for on_times, change in zip(sweep.on_times, measured, strict=True):
        filter_.update(on_times, change)
    sweep._errors = lambda columns: np.eye(6 * len(measured)) * 1e-6  # what the filter takes them to be
    answer = sweep.estimate(measured)
    np.testing.assert_allclose(filter_.effectiveness[0], answer.effectiveness, atol=1e-9)
    np.testing.assert_allclose(np.diag(filter_.covariance[0]), np.diag(answer.covariance), rtol=1e-6)


def test_flown_in_the_environment_it_finds_the_turned_thruster():
    env = gym.make(
        "thruster_envs/OrionRendezvous-v1",
        faults=[{"thruster": 8, "kind": "misalignment", "severity": 0.3, "azimuth": 1.0}],
    )
    sweep = CalibrationSweep(ORION, 1.0, 3)
    env.reset(seed=2_000_000)
    rows = []
    for on_times in sweep.on_times:
        observation, *_ = env.step((2.0 * on_times / ORION.control_period - 1.0).astype(np.float32))
        rows.append(observation[25:31].astype(np.float64) * ORION.authority())
    statistic = sweep.estimate(rows).statistic
    assert int(statistic.argmax()) + 1 == 8
    assert statistic[7] > chi2.isf(1e-6, 6) > np.delete(statistic, 7).max()


def test_the_order_keeps_the_body_slow():
    """Eight firings come one after the other in turn-cancelling order; by number they would spin it up."""
    sweep = CalibrationSweep(ORION, 1.0)
    in_order = np.cumsum(sweep.on_times @ NOMINAL[3:].T, axis=0)
    by_number = np.cumsum(NOMINAL[3:].T, axis=0)
    assert np.linalg.norm(in_order, axis=1).max() <= np.linalg.norm(by_number, axis=1).max()
    np.testing.assert_allclose(in_order[-1], 0.0, atol=1e-12)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(
        ValueError, match=r"pulse is 6\.0; a number of s above 0 and up to the control period, 5"
    ):
        CalibrationSweep(ORION, 6.0)
    with pytest.raises(ValueError, match="repetitions is 0"):
        CalibrationSweep(ORION, 1.0, 0)
    sweep = CalibrationSweep(ORION, 1.0)
    with pytest.raises(ValueError, match=r"shape \(3, 6\); \(12, 6\)"):
        sweep.estimate(np.zeros((3, 6)))
    broken = np.zeros((12, 6))
    broken[4, 2] = np.nan
    with pytest.raises(ValueError, match="rate_changes of firing 5"):
        sweep.estimate(broken)
    assert PhysicalNoise(ORION).sensors.shape == (6,)
