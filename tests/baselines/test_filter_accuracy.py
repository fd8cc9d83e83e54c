"""The effectiveness filter against exact arithmetic: every form, a thousand updates, any first covariance."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext

import numpy as np
import pytest

from thruster_baselines.control.navigation import RelativeNavigation
from thruster_baselines.detection.residuals.fusion import _gains_by_age
from thruster_baselines.estimation import EffectivenessFilter
from thruster_envs.spacecraft import catalogue, load

FORMS = ["shared", "by_axis", "full", "fired_only"]
every_form = pytest.mark.parametrize("form", FORMS)


def exactly(nominal, on_times, measured, process, noise, first, *, fired_only=False):
    """The filter with 60 digits, for noise that is one number for all axes.

    Returns:
        The estimate (m, n), and the covariance of the entries of an axis (n, n).
    """
    with localcontext(Context(prec=60)):
        m, n = nominal.shape
        p = [[Decimal(float(first)) if i == j else Decimal(0) for j in range(n)] for i in range(n)]
        a = [[Decimal(float(entry)) for entry in row] for row in nominal]
        for times, change in zip(on_times, measured, strict=True):
            u = {i: Decimal(float(times[i])) for i in range(n) if times[i] != 0.0}
            for i in range(n):
                p[i][i] += Decimal(float(process))
            if not np.isfinite(change).all():
                continue
            pu = [sum((p[i][j] * u[j] for j in u), Decimal(0)) for i in range(n)]
            spread = Decimal(float(noise)) + sum((pu[i] * u[i] for i in u), Decimal(0))
            for k in range(m):
                rest = Decimal(float(change[k])) - sum((a[k][i] * u[i] for i in u), Decimal(0))
                for i in u if fired_only else range(n):
                    a[k][i] += pu[i] / spread * rest
            for i in range(n):
                for j in range(i + 1):
                    if not fired_only or i in u or j in u:
                        p[i][j] -= pu[i] * pu[j] / spread
                        p[j][i] = p[i][j]
        return np.array(a, dtype=np.float64), np.array(p, dtype=np.float64)


def flight(nominal, updates, seed, *, duration=5.0):
    """On-times and rate changes: all, some, one or no thrusters fired, and some measurements missing."""
    rng = np.random.default_rng(seed)
    m, n = nominal.shape
    share = rng.choice([0.0, 0.1, 0.4, 1.0], (updates, 1))
    on_times = rng.uniform(0.0, duration, (updates, n)) * (rng.random((updates, n)) < share)
    alone = rng.random(updates) < 0.2
    on_times[alone] = duration * np.eye(n)[rng.integers(n, size=alone.sum())]
    truth = nominal * rng.uniform(0.8, 1.2, n)
    measured = on_times @ truth.T + 1e-3 * rng.normal(size=(updates, m))
    measured[rng.random(updates) < 0.05] = np.nan
    return on_times, measured


def positive(covariance) -> bool:
    """Symmetric to the bit, and no eigenvalue below what round-off of the entries can do."""
    values = np.linalg.eigvalsh(covariance)
    return bool((covariance == covariance.T).all() and values[0] >= -1e-14 * values[-1])


def compare(nominal, form, process, noise, first, updates, seed, duration=5.0) -> None:
    on_times, measured = flight(nominal, updates, seed, duration=duration)
    own = EffectivenessFilter(nominal, process, noise, first, form=form)
    for step, (u, z) in enumerate(zip(on_times, measured, strict=True)):
        own.update(u, z)
        if step % 50 == 49:
            assert positive(own.covariance_of(0))
    estimate, exact = exactly(
        nominal, on_times, measured, process, noise, first, fired_only=form == "fired_only"
    )
    expected = np.kron(exact, np.eye(len(nominal)))
    deviation = np.sqrt(np.diag(exact))
    scale = np.kron(np.outer(deviation, deviation), np.ones((len(nominal), len(nominal))))
    assert (np.abs(own.covariance_of(0) - expected) <= 1e-6 * scale).all()
    assert (np.abs(own.effectiveness[0] - estimate) <= 1e-6 * deviation).all()


@every_form
@pytest.mark.parametrize("first", [1e-4, 1.0, 1e4, 1e8])
def test_a_thousand_updates_with_the_noise_of_the_source_are_those_of_exact_arithmetic(form, first):
    """Estimates to a millionth of their deviation, covariances to a millionth of their variances."""
    compare(load("orion").effectiveness(), form, 0.01, 10.0, first, 1000, seed=1)


@every_form
@pytest.mark.parametrize("seed", range(4))
def test_random_vehicles_and_noise_are_those_of_exact_arithmetic(form, seed):
    """Three to six axes, two to nine thrusters, R from 1e-8 to 1e6, Q from nothing to ten times R."""
    rng = np.random.default_rng(seed)
    for _ in range(4):
        nominal = rng.normal(size=(rng.integers(3, 7), rng.integers(2, 10))) * 10.0 ** rng.uniform(-4.0, 1.0)
        nominal[rng.integers(len(nominal))] = 0.0  # an axis that nothing serves
        noise = 10.0 ** rng.uniform(-8.0, 6.0)
        process = noise * rng.choice([0.0, 1e-6, 1e-3, 10.0])
        first = noise * 10.0 ** rng.uniform(-6.0, 7.0)
        compare(nominal, form, process, noise, first, 200, seed, duration=rng.choice([0.2, 1.0, 5.0]))


@every_form
@pytest.mark.parametrize("craft", catalogue())
def test_every_vehicle_of_the_catalogue_keeps_a_covariance(form, craft):
    nominal = load(craft).effectiveness()
    for first in (1e-4, 1.0, 1e8):
        compare(nominal, form, 0.01, 10.0, first, 60, seed=2)


def test_fired_only_is_full_where_nothing_is_left_out_and_never_surer():
    """The same where all thrusters fire or each fires alone, and P of `full` is below its P elsewhere."""
    nominal = load("orion").effectiveness()
    rng = np.random.default_rng(3)
    for patterns in (np.ones((40, 12)), np.eye(12)[rng.integers(12, size=40)]):
        own, full = (EffectivenessFilter(nominal, 0.01, 10.0, form=form) for form in ("fired_only", "full"))
        for pattern in patterns:
            u = pattern * rng.uniform(0.1, 5.0, 12)
            for one in (own, full):
                one.update(u, 0.9 * nominal @ u)
        np.testing.assert_allclose(own.effectiveness, full.effectiveness, rtol=0, atol=1e-14)
        np.testing.assert_allclose(own.covariance, full.covariance, rtol=0, atol=1e-14)
    for first in (1e-4, 1.0, 1e4):
        own, full = (
            EffectivenessFilter(nominal, 0.01, 10.0, first, form=form) for form in ("fired_only", "full")
        )
        for u, z in zip(*flight(nominal, 300, 4), strict=True):
            for one in (own, full):
                one.update(u, z)
        more = np.linalg.eigvalsh(own.covariance_of(0) - full.covariance_of(0))
        assert more[0] >= -1e-9
        deviation = np.sqrt(np.diag(own.covariance_of(0))).reshape(12, 6).T
        assert (np.abs(own.effectiveness[0] - full.effectiveness[0]) < 0.1 * deviation).all()


def test_navigation_keeps_a_covariance():
    """Two thousand periods with firings, predicted and measured, for each vehicle that navigates."""
    for craft in ("orion", "spheres"):
        vehicle = load(craft)
        navigation, rng = RelativeNavigation(vehicle), np.random.default_rng(5)
        for step in range(500):
            u = rng.uniform(0.0, vehicle.control_period, vehicle.number_of_thrusters)
            u *= rng.random(u.size) < 0.2
            if step % 7 == 3:
                navigation.predict(u)
            else:
                navigation.update(u, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
            assert positive(navigation.covariance)


@pytest.mark.parametrize("force", [0.0, 1e-6, 1.0])
def test_gains_of_position_filters_are_those_of_exact_arithmetic(force):
    """Two states, four hundred samples: position measured, velocity unknown at first."""
    period, position = 0.1, 1e-3
    table = _gains_by_age(period, position, force, 1e-4, 1e-5)
    with localcontext(Context(prec=60)):
        t, r, q = Decimal(period), Decimal(position) ** 2, Decimal(force) ** 2
        p, c, v = r, Decimal(0), Decimal(1)  # position, both, velocity
        for gain, gain_of_velocity, _, variance in table:
            p, c, v = p + 2 * t * c + t * t * v, c + t * v, v
            p, c, v = p + q * t**4 / 4, c + q * t**3 / 2, v + q * t**2
            assert [gain, gain_of_velocity, variance] == pytest.approx(
                [float(p / (p + r)), float(c / (p + r)), float(p + r)], rel=1e-8
            )
            p, c, v = p * r / (p + r), c * r / (p + r), v - c * c / (p + r)
