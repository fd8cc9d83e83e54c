"""Residual generators: gains against closed forms and figures, transfers, and what decoupling is worth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from tests.baselines import chaser_flight
from thruster_baselines.control.quaternions import rotation_matrix
from thruster_baselines.detection.residuals import (
    ResidualGenerator,
    assigned_gain,
    closed_form_gain,
    decoupling,
    delay_model,
    observer_design,
    pade_design,
    relative_motion,
)

N, MASS, DELAY = chaser_flight.MEAN_MOTION, chaser_flight.MASS, chaser_flight.NOMINAL_DELAY
EIGENVALUES = (-0.49, -0.50, -0.51)
ONE_AXIS = [1, 4, 7]
"""Position, velocity and delay state of the axis against the orbit's normal, which no other is coupled to."""


def test_orbit_is_that_of_the_parameter_set():
    assert pytest.approx(1.7018995e-3, rel=1e-7) == 2.0 * N
    assert pytest.approx(2.1723464e-6, rel=1e-7) == 3.0 * N**2


def test_motion_turned_into_lvlh_is_hills_equations():
    """x'' = 3 n^2 x + 2 n y', y'' = -2 n x', z'' = -n^2 z in LVLH."""
    turn = np.kron(np.eye(2), chaser_flight.AXES)
    lvlh = turn.T @ relative_motion(N) @ turn
    expected = np.zeros((6, 6))
    expected[:3, 3:] = np.eye(3)
    expected[3, 0], expected[3, 4], expected[4, 3], expected[5, 2] = 3 * N * N, 2 * N, -2 * N, -N * N
    np.testing.assert_allclose(lvlh, expected, atol=1e-18)


@pytest.mark.parametrize("mass", [1.0, MASS])
def test_gain_places_every_eigenvalue_three_times(mass):
    model = delay_model(N, DELAY, mass)
    gain = assigned_gain(model.dynamics, model.measurement, EIGENVALUES)
    found = np.sort(np.linalg.eigvals(model.dynamics - gain @ model.measurement).real)
    np.testing.assert_allclose(found, np.repeat([-0.51, -0.50, -0.49], 3), atol=1e-6)


@pytest.mark.parametrize("mass", [1.0, MASS])
def test_gain_is_its_closed_form(mass):
    model = delay_model(N, DELAY, mass)
    gain = assigned_gain(model.dynamics, model.measurement, EIGENVALUES)
    expected = closed_form_gain(N, DELAY, EIGENVALUES, mass)
    np.testing.assert_allclose(gain, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_gain_is_the_one_of_the_parameter_set():
    gain = closed_form_gain(N, DELAY, EIGENVALUES, MASS)
    assert gain[0, 0] == pytest.approx(-18.5)
    assert gain[0, 2] == pytest.approx(1.70190e-3, rel=1e-5)
    assert gain[3, 0] == pytest.approx(370.7499, rel=1e-7)
    assert gain[3, 2] == pytest.approx(-3.14851e-2, rel=1e-5)
    assert gain[6, 0] == pytest.approx(-2.780577e5, rel=1e-6)


def test_discrete_block_of_one_axis_is_the_one_of_the_parameter_set():
    design = pade_design(N, mass=MASS)
    inputs = [1, 4]
    np.testing.assert_allclose(
        design.transition[np.ix_(ONE_AXIS, ONE_AXIS)],
        [
            [2.7143985, 0.18571993, 1.2381328e-4],
            [-34.428402, -0.72142011, 1.8571993e-4],
            [25820.431, 1291.0216, 0.86068105],
        ],
        rtol=1e-7,
    )
    np.testing.assert_allclose(
        design.entry[np.ix_(ONE_AXIS, inputs)],
        [[0.0, -1.7143985], [0.0, 34.428402], [0.05, -25820.431]],
        rtol=1e-7,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        design.output[1, ONE_AXIS], [-1.8571993, -0.092859963, -6.1906642e-5], rtol=1e-7
    )
    np.testing.assert_allclose(design.feedthrough[1, inputs], [0.0, 1.8571993], rtol=1e-7, atol=1e-12)


def test_discrete_eigenvalues_are_those_of_tustins_rule():
    found = np.sort(np.linalg.eigvals(pade_design(N).transition).real)
    expected = [(1.0 + 0.05 * one) / (1.0 - 0.05 * one) for one in sorted(EIGENVALUES)]
    np.testing.assert_allclose(found, np.repeat(expected, 3), atol=1e-6)
    np.testing.assert_allclose(expected, [0.95027, 0.95122, 0.95217], atol=5e-6)


def test_transfers_are_the_scalar_closed_forms():
    """Without an orbit, r = ((s + 20) s^2 y - (20 - s) u) / prod(s - lambda), a fault (s + 20) f over it."""
    design, s = pade_design(1e-12), 0.7j
    model = delay_model(1e-12, DELAY)
    gain = assigned_gain(model.dynamics, model.measurement, EIGENVALUES)
    inverse = np.linalg.inv(s * np.eye(9) - design.motion)
    chain = np.prod([s - one for one in EIGENVALUES])
    observer = np.hstack([model.command, gain])
    residual = np.hstack([np.zeros((3, 3)), np.eye(3)]) - model.measurement @ inverse @ observer
    assert residual[1, 4] == pytest.approx(s * s * (s + 20.0) / chain, rel=1e-6)
    assert residual[1, 1] == pytest.approx(-(20.0 - s) / chain, rel=1e-6)
    fault = model.measurement @ inverse @ design.fault
    assert fault[1, 1] == pytest.approx((s + 20.0) / chain, rel=1e-6)


def test_step_response_of_an_open_thruster_is_the_tabled_one():
    response = 1e3 * 22.0 / MASS * pade_design(N).fault_response(101)[:, 1, 1]
    table = {3: 1.75, 4: 3.7, 5: 6.5, 6: 10.4, 7: 15.5, 8: 21.8, 9: 29.3, 10: 38.2, 11: 48.5}
    slow = {15: 103, 20: 199, 30: 463, 50: 1086, 100: 2060}
    for sample, expected in (table | slow).items():
        assert response[sample] == pytest.approx(expected, rel=0.015)
    rest = np.linalg.solve(-pade_design(N).motion, pade_design(N).fault)
    assert rest[1, 1] == pytest.approx(160.0, rel=1e-3)


def test_fault_response_of_an_observer_is_the_matrix_exponential():
    design = observer_design(N)
    block = np.zeros((9, 9))
    block[:6, :6], block[:6, 6:] = design.motion, design.fault
    np.testing.assert_allclose(
        design.fault_response(31)[30], expm(3.0 * block)[:3, 6:], rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize("mass", [1.0, MASS])
def test_a_varying_delay_cannot_be_decoupled_from_a_fault(mass):
    facts = decoupling(delay_model(N, DELAY, mass))
    assert facts.weight_rank == 0
    assert facts.ratio_error < 1e-10
    assert facts.rank_of_both == 3


def test_eigenvectors_that_decoupling_asks_for_are_far_from_assignable():
    newtons = decoupling(delay_model(N, DELAY, MASS)).alignment
    expected = [-one / math.hypot(1.0, one) for one in EIGENVALUES]
    np.testing.assert_allclose(newtons, expected, rtol=1e-3)
    assert decoupling(delay_model(N, DELAY)).alignment[1] == pytest.approx(0.214, abs=5e-4)
    fast = decoupling(delay_model(N, DELAY), (-9.9, -10.0, -10.1)).alignment
    assert fast[1] == pytest.approx(0.924, abs=1e-3)


@pytest.mark.parametrize("design", [pade_design(N), observer_design(N), observer_design(N, late=0)])
def test_residual_begins_at_rest_and_stays_there_under_constant_input(design):
    generator = ResidualGenerator(design)
    command, position = [[1e-3, -2e-3, 5e-4]], [[-20.0, 0.3, 0.1]]
    first = generator.step(command, position)
    for _ in range(50):
        last = generator.step(command, position)
    np.testing.assert_allclose(last, first, atol=1e-9)
    generator.reset()
    np.testing.assert_array_equal(generator.step(command, position), first)


def test_running_filter_is_the_discrete_design():
    design = pade_design(N)
    rng = np.random.default_rng(0)
    commands, positions = rng.normal(size=(40, 700, 3)) * 1e-3, rng.normal(size=(40, 700, 3))
    generator = ResidualGenerator(design, vehicles=700)
    state = None
    for u, y in zip(commands, positions, strict=True):
        given = np.hstack([u, y])
        state = given @ design.steady_state().T if state is None else state
        expected = state @ design.output.T + given @ design.feedthrough.T
        np.testing.assert_allclose(generator.step(u, y), expected, rtol=1e-9, atol=1e-9)
        state = state @ design.transition.T + given @ design.entry.T


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match=r"eigenvalues is .* different negative numbers of rad/s"):
        pade_design(N, eigenvalues=(-0.5, -0.5, -0.5))
    with pytest.raises(ValueError, match=r"delay is 0\.0; a positive number of s would be right"):
        delay_model(N, 0.0)
    with pytest.raises(ValueError, match=r"position has the shape \(1, 2\); \(1, 3\) would be right"):
        ResidualGenerator(observer_design(N)).step([[0.0] * 3], [[0.0] * 2])


def norms(record, design):
    """(flights, samples): what the residual comes to, m."""
    generator = ResidualGenerator(design, record.position.shape[0])
    found = []
    for k in range(record.position.shape[1]):
        body = record.open_rates[:, k] @ chaser_flight.FORCES.T / MASS
        turned = [rotation_matrix(q).T @ one for q, one in zip(record.attitude[:, k], body, strict=True)]
        residual = generator.step(
            np.array(turned) @ chaser_flight.AXES.T, record.position[:, k] @ chaser_flight.AXES.T
        )
        found.append(np.linalg.norm(residual, axis=1))
    return np.stack(found, axis=1)


def test_one_sample_of_exact_delay_is_more_robust_than_pades_states():
    """Noise-free residuals of an abrupt stop, mm, over the fault response after a second, as tabled."""
    calm = replace(
        chaser_flight.Settings(), lidar=0.0, attitude=0.0, rate=0.0, stop_at=45.0, braking=math.inf
    )
    record = chaser_flight.fly(range(3), 80.0, settings=calm)
    pade, plain, exact = (
        1e3 * norms(record, design)[:, 400:].max()
        for design in (pade_design(N), observer_design(N, late=0), observer_design(N))
    )
    assert pade == pytest.approx(48.8, rel=0.3)
    assert plain == pytest.approx(3.9, rel=0.3)
    assert exact == pytest.approx(1.8, rel=0.4)
    response = [one.fault_response(11)[10, 1, 1] for one in (pade_design(N), observer_design(N))]
    assert exact / response[1] < 0.5 * pade / response[0]


def test_lidar_noise_of_a_millimetre_gives_the_residual_its_spread():
    record = chaser_flight.fly(range(4), 100.0)
    for design, spread in ((pade_design(N), 2.2), (observer_design(N), 0.57)):
        per_axis = 1e3 * np.sqrt(np.mean(norms(record, design)[:, 400:] ** 2) / 3.0)
        assert per_axis == pytest.approx(spread, rel=0.1)
