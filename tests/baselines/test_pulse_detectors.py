"""Plasma thrusters that fail: what waveforms, counts and motion say of them, and what they cannot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from thruster_baselines.detection.pulses import (
    MotionFit,
    PulseCountCUSUM,
    PulseFit,
    PulseResidual,
    absolute_motion,
)
from thruster_envs.faults import Fault
from thruster_envs.missions import fly_missions
from thruster_envs.physics.plasma_pulse import pulse_thrust, pulse_waveforms
from thruster_envs.spacecraft import load

CUBESAT = load("ppt_cubesat")
CIRCUIT = CUBESAT.discharge
ERRORS = (4.0, 60.0)
STEPS = {
    "propellant_loss": 1.0 - 3.00e-9 / CIRCUIT.slug_mass,
    "electrode_sediment": 1.0 - 0.02195 / CIRCUIT.electrode_width,
    "conductivity_loss": 0.008,
}


@pytest.fixture(scope="module")
def fit():
    return PulseFit(CIRCUIT, *ERRORS)


def pulses(seed=None, **parameters):
    waves = pulse_waveforms(CIRCUIT, **parameters)
    if seed is None:
        return waves.voltage, waves.current
    rng = np.random.default_rng(seed)
    return tuple(
        wave + error * rng.normal(size=wave.shape)
        for wave, error in zip((waves.voltage, waves.current), ERRORS, strict=True)
    )


@pytest.fixture(scope="module")
def drawn():
    """Mass, width, resistance and voltage of pulses across all ramps of the source."""
    rng, count = np.random.default_rng(5), 40
    loss = rng.uniform(0.01, 1.0, count), rng.uniform(0.36, 1.0, count), rng.uniform(0.0, 0.1, count)
    one, zero = np.ones(count), np.zeros(count)
    return {
        "slug_mass": CIRCUIT.slug_mass * np.concatenate((loss[0], one, one)),
        "electrode_width": CIRCUIT.electrode_width * np.concatenate((one, loss[1], one)),
        "added_resistance": np.concatenate((zero, zero, loss[2])),
        "voltage": rng.uniform(857.0, 977.0, 3 * count),
    }


def test_waveforms_without_errors_give_voltage_resistance_and_thrust_back(fit, drawn):
    estimate = fit(*pulses(**drawn))
    widened = np.arange(120) // 40 == 1
    thrust = np.where(widened, estimate.thrust_if_width, estimate.thrust_if_mass)
    truth = pulse_thrust(CIRCUIT, **drawn) / pulse_thrust(CIRCUIT)
    np.testing.assert_allclose(thrust, truth, rtol=5e-4)  # 0.05 %, the error of the map of thrusts
    np.testing.assert_allclose(
        CIRCUIT.voltage * np.exp(estimate.parameters[:, 0]), drawn["voltage"], rtol=1e-5
    )
    np.testing.assert_allclose(
        CIRCUIT.resistance * np.expm1(estimate.parameters[:, 2]), drawn["added_resistance"], atol=1e-5
    )


def test_with_errors_a_single_pulse_tells_the_thrust_within_one_percent(fit, drawn):
    estimate = fit(*pulses(seed=1, **drawn))
    thrust = np.where(np.arange(120) // 40 == 1, estimate.thrust_if_width, estimate.thrust_if_mass)
    truth = pulse_thrust(CIRCUIT, **drawn) / pulse_thrust(CIRCUIT)
    assert np.abs(thrust / truth - 1.0).max() < 0.01


def test_errors_of_the_estimates_are_of_the_size_that_is_stated(fit, drawn):
    exact, seen = fit(*pulses(**drawn)), fit(*pulses(seed=2, **drawn))
    normal = ((seen.parameters - exact.parameters) / seen.deviation)[:80]  # of 40 the kick is out of sight
    assert normal.std(axis=0) == pytest.approx(np.ones(3), abs=0.25)


def test_the_statistic_of_healthy_pulses_is_chi_squared_of_two_degrees(fit):
    voltage = np.random.default_rng(3).uniform(857.0, 977.0, 400)
    statistic = fit(*pulses(seed=3, voltage=voltage)).statistic
    assert kstest(statistic, chi2(2).cdf).pvalue > 1e-3


@pytest.mark.parametrize("width", [0.3, 0.6, 0.9])
def test_a_circuit_does_not_tell_a_lighter_slug_from_narrower_electrodes(fit, width):
    narrow = pulses(electrode_width=[width * CIRCUIT.electrode_width])
    light = pulses(slug_mass=[width**2 * CIRCUIT.slug_mass])
    for one, other in zip(narrow, light, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)
    thrust = fit(*light)
    assert thrust.thrust_if_width == pytest.approx(thrust.thrust_if_mass / width, rel=1e-4)


def test_without_a_cause_a_pulse_is_faulty_if_either_would_make_it_so(fit):
    light = fit(*pulses(slug_mass=[0.74 * CIRCUIT.slug_mass]))
    assert (bool(light.faulty(False)), bool(light.faulty(True)), bool(light.faulty())) == (False, True, True)


def test_a_fault_is_named_by_what_it_changes_in_the_circuit(fit):
    changed = {
        "slug_mass": CIRCUIT.slug_mass * np.array([1.0 - STEPS["propellant_loss"], 1.0, 1.0]),
        "electrode_width": CIRCUIT.electrode_width * np.array([1.0, 1.0 - STEPS["electrode_sediment"], 1.0]),
        "added_resistance": np.array([0.0, 0.0, STEPS["conductivity_loss"]]),
    }
    assert fit(*pulses(seed=4, **changed)).impulse_changed.tolist() == [True, True, False]


def test_residuals_are_those_of_the_reference_and_none_of_a_healthy_pulse(fit):
    """Reference 6.2.6: mean absolute difference from the nominal current, over 11,093 A."""
    test = PulseResidual(fit, threshold=0.01)
    healthy = test.residual(*pulses(voltage=[857.0, 910.0, 980.0]))
    np.testing.assert_allclose(healthy, 0.0, atol=1e-6)
    mass = test.residual(*pulses(slug_mass=[3.00e-9]))
    width = test.residual(*pulses(electrode_width=[0.02195]))
    resistance = test.residual(*pulses(added_resistance=[0.008]))
    for found, printed in ((mass, 0.0342), (width, 0.0033), (resistance, 0.0108)):
        assert 0.5 * printed < found[0] < 1.05 * printed  # less: the charge voltage is fitted, too


@pytest.fixture(scope="module")
def missions():
    """Healthy ones, then each step fault of the source on each thruster, of follower 1."""
    faults = [None] * 6 + [
        [Fault(thruster, kind, severity=severity, craft=2)]
        for kind, severity in STEPS.items()
        for thruster in range(1, 7)
    ]
    flown = fly_missions([25.0, 35.0, 45.0], degrees=True, craft=2, faults=faults, seeds=2_000_000)
    motion = absolute_motion(
        flown.measured_attitude[:, :, 1], flown.measured_rate[:, :, 1],
        flown.measured_attitude[:, :, 0], flown.measured_rate[:, :, 0],
    )  # fmt: skip
    return flown, motion, flown.pulses[:, :, 1].astype(np.float64)


RATE_ERROR = np.sqrt(2.0) * CUBESAT.sensors.rate  # of the follower's and of the leader's


def test_the_motion_tells_each_thrusters_share_within_five_standard_deviations(missions):
    flown, motion, commanded = missions
    found = MotionFit(CUBESAT, RATE_ERROR)(*motion, commanded)
    share = np.ones((24, 6))
    fired = flown.thrust[:, :, 1]
    for mission in range(6, 24):
        thruster = (mission - 6) % 6
        share[mission, thruster] = fired[mission, :, thruster].max()
    assert np.abs((found.share - share) / found.deviation).max() < 5.0
    assert found.deviation.max() < 0.01


def test_the_motion_tells_less_mass_from_less_width(missions):
    _, motion, commanded = missions
    fit_motion = MotionFit(CUBESAT, RATE_ERROR)
    for mission, cause in ((6, 0.851), (12, 1.147)):  # thruster 1
        own = commanded[mission : mission + 1, :, 0] > 0
        misfit = []
        for share in (0.851, 1.147):
            shares = np.ones((1, own.shape[1], 3))
            shares[..., 0][own] = share
            one = tuple(part[mission : mission + 1] for part in motion)
            misfit.append(fit_motion.misfit(*one, commanded[mission : mission + 1], shares)[0, 0])
        assert abs(misfit[0] - misfit[1]) > 100.0
        assert (misfit[0] < misfit[1]) == (cause < 1.0)


def test_each_thruster_is_asked_whether_its_width_has_changed(missions):
    flown, motion, commanded = missions
    fit_motion = MotionFit(CUBESAT, RATE_ERROR)
    for mission in (6, 9, 12, 17):  # mass of thrusters 1 and 4, width of 1 and 6
        found = flown.discharges(mission, 1)
        fired = found.step, found.thruster - 1
        own = found.thruster == (mission - 6) % 6 + 1
        by_mass, by_width = np.where(own, 0.851, 1.0), np.where(own, 1.147, 1.0)
        one = tuple(part[mission] for part in (*motion, commanded))
        answer = fit_motion.width_changed(*one, fired, by_mass, by_width)
        assert bool(answer[(mission - 6) % 6]) == (mission >= 12)
        assert answer.sum() == (mission >= 12)


def test_misfits_of_healthy_missions_are_those_of_white_errors(missions):
    _, motion, commanded = missions
    healthy = [part[:6] for part in (*motion, commanded)]
    misfit = MotionFit(CUBESAT, RATE_ERROR).misfit(*healthy, np.ones_like(healthy[2]))
    freedom = healthy[2].shape[1] + 1 - 2
    assert np.abs(misfit / freedom - 1.0).max() < 5.0 * np.sqrt(2.0 / freedom)


def test_a_sum_is_the_largest_of_all_that_end_at_its_period():
    rng = np.random.default_rng(8)
    record = rng.integers(-1, 2, (3, 60, 2))
    detector = PulseCountCUSUM([0.1, -0.2], [0.05, 0.0], [4.0, 4.0], begin=10)
    beyond = record[:, 10:] - detector.mean
    sums = detector.sums(record)
    for side, sign in enumerate((1.0, -1.0)):
        gathered = np.zeros((3, 2))
        for k in range(50):
            gathered = np.maximum(0.0, gathered + sign * beyond[:, k] - detector.slack)
            np.testing.assert_allclose(sums[:, k, :, side], gathered, atol=1e-12)


def test_a_pair_that_fires_on_one_side_is_flagged_with_its_side_and_period():
    rng = np.random.default_rng(9)
    healthy = rng.integers(-1, 2, (400, 300, 3))
    detector = PulseCountCUSUM.calibrated(healthy, begin=100, false_alarms=0.05, change=0.4)
    faulty = rng.integers(-1, 2, (1, 300, 3))
    faulty[0, 150:, 1] = -1
    said = detector(faulty)
    assert said.more.tolist() == [[0, -1, 0]]
    assert 150 <= said.first[0, 1] < 250
    assert detector(healthy).flagged.mean(axis=0).max() <= 0.05


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda fit: PulseFit(CIRCUIT, current_error=0.0), "current_error is 0.0; a positive number of A"),
        (lambda fit: fit(np.zeros((2, 3001)), np.zeros((1, 3001))), r"current has the shape \(1, 3001\)"),
        (
            lambda fit: fit(np.zeros(3001), np.zeros(3001)),
            r"voltage has the shape \(3001,\); \(pulses, 3001\)",
        ),
        (lambda fit: PulseResidual(fit, 0.0), "threshold is 0.0; a positive share would be right"),
        (lambda fit: MotionFit(load("orion"), 1e-5), "orion has no discharge; a craft with pulsed"),
        (lambda fit: MotionFit(CUBESAT, 0.0), "rate_error is 0.0; a positive number of rad/s"),
        (lambda fit: PulseCountCUSUM([0.0], [0.0], [0.0], 0), "threshold is .* a positive number of pulses"),
        (
            lambda fit: PulseCountCUSUM([0.0], [0.0], [1.0], 0).sums(np.zeros((4, 3))),
            r"pulses has the shape \(4, 3\)",
        ),
    ],
)
def test_what_cannot_be_gets_its_line(fit, call, line):
    with pytest.raises(ValueError, match=line):
        call(fit)
