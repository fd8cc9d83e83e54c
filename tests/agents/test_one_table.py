"""Every detector, of whatever family, is flown by one evaluation and stands in one table."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import torch

from tests.agents.pulses import NOISE, pulses
from tests.baselines.chaser_flight import MSR_A, ValveFault, fly
from thruster_agents.dynamic_neurons import (
    Architecture,
    HighLevelClassifier,
    HighLevelSettings,
    IntegratedClassifier,
    LowLevelClassifier,
    LowLevelSettings,
    MissionDetector,
    MissionSignals,
    TrainingSettings,
    low_level_detector,
)
from thruster_baselines.detection import (
    CUSUMDetector,
    Detector,
    EstimatorThreshold,
    FilterBank,
    GenericChiSquared,
    GLRDetector,
    HypothesisDetector,
    RandomFlights,
    ResponseTest,
    SetChiSquared,
    SingleChiSquared,
    Telemetry,
    Verdict,
    WindowedGLR,
    calibrate,
    evaluate,
    table,
)
from thruster_baselines.detection.pulses import (
    PulseCountCUSUM,
    PulseCountDetector,
    PulseFit,
    PulseFlights,
    PulseResidual,
    WaveformDetector,
)
from thruster_baselines.detection.residuals import (
    CorrelationDetector,
    FusionDetector,
    NormThreshold,
    SignatureDetector,
)
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.missions import fly_missions
from thruster_envs.spacecraft import load

ORION, CUBESAT = load("orion"), load("ppt_cubesat")
NOISE_OF_ORION = PhysicalNoise(ORION)
STEPS, WINDOW = 60, (20, 60)


def rate_changes(seeds, faulty):
    faults = FaultDistribution(kinds=("stuck_off",), onset=(10.0, 10.0))
    return RandomFlights(spacecraft=ORION, faults=faults, intervals=40)(seeds, faulty)


def approaches(seeds, faulty):
    faults = [ValveFault(1 + k % 8, "stuck_on", 1.0, 50.013) for k in range(len(seeds))] if faulty else None
    return fly(seeds, 58.0, faults).seen()


def missions(seeds, faulty):
    fault = Fault(craft=2, thruster=1, kind="propellant_loss", severity=0.7, onset=10.0)
    flown = fly_missions(
        [[20.0, 0.0, 0.0]], degrees=True, craft=2, steps=STEPS, faults=[fault] if faulty else None,
        seeds=seeds,
    )  # fmt: skip
    return PulseFlights.of(flown, seeds, errors=NOISE)


@cache
def low_level():
    rng = np.random.default_rng(0)
    settings = LowLevelSettings(architecture=Architecture(hidden=(4,)), stride=25)
    classifier = LowLevelClassifier(settings, generator=torch.Generator().manual_seed(0))
    healthy = pulses(rng.uniform(900.0, 930.0, 12), rng)
    classifier.train(*healthy, training=TrainingSettings(iterations=5))
    classifier.calibrate(*healthy)
    return classifier


@cache
def high_level():
    flown = fly_missions([[20.0, 0.0, 0.0]], degrees=True, craft=2, steps=STEPS, seeds=list(range(4)))
    signals = MissionSignals.of(flown, 1)
    settings = HighLevelSettings(architecture=Architecture(hidden=(4,)), window=WINDOW)
    classifier = HighLevelClassifier(settings, generator=torch.Generator().manual_seed(0))
    classifier.train(signals, training=TrainingSettings(iterations=5))
    classifier.calibrate(signals)
    return classifier


@cache
def both_levels():
    classifier = IntegratedClassifier(high_level(), low_level())
    rng = np.random.default_rng(1)
    classifier.calibrate(*pulses(np.full(12, 917.0), rng))
    return classifier


@cache
def fit():
    return PulseFit(CUBESAT.discharge, *NOISE)


COUNTS = PulseCountCUSUM(np.zeros(3), np.full(3, 0.1), np.full(3, 5.0), 5)
DETECTORS = {
    "response test": (rate_changes, lambda k: ResponseTest(ORION, 20.0, k)),
    "estimator threshold": (rate_changes, lambda k: EstimatorThreshold(ORION, vehicles=k)),
    "generic chi-squared": (
        rate_changes,
        lambda k: GenericChiSquared(ORION, 20.0, noise=NOISE_OF_ORION, vehicles=k),
    ),
    "single chi-squared": (
        rate_changes,
        lambda k: SingleChiSquared(ORION, 20.0, noise=NOISE_OF_ORION, vehicles=k),
    ),
    "set chi-squared": (
        rate_changes,
        lambda k: SetChiSquared(ORION, 20.0, noise=NOISE_OF_ORION, vehicles=k),
    ),
    "likelihood ratio": (rate_changes, lambda k: GLRDetector(ORION, noise=NOISE_OF_ORION, vehicles=k)),
    "windowed ratio": (rate_changes, lambda k: WindowedGLR(ORION, 30.0, noise=NOISE_OF_ORION, vehicles=k)),
    "cumulative sums": (rate_changes, lambda k: CUSUMDetector(ORION, 10.0, noise=NOISE_OF_ORION, vehicles=k)),
    "filter bank": (rate_changes, lambda k: FilterBank(ORION, 8.0, noise=NOISE_OF_ORION, vehicles=k)),
    "hypotheses": (rate_changes, lambda k: HypothesisDetector(ORION, 10.0, vehicles=k)),
    "norm of the residual": (approaches, lambda k: NormThreshold(MSR_A, 0.0136, vehicles=k)),
    "cross-correlation": (approaches, lambda k: CorrelationDetector(MSR_A, 0.0136, vehicles=k)),
    "signature": (approaches, lambda k: SignatureDetector(MSR_A, 0.0136, vehicles=k)),
    "force and torque": (approaches, lambda k: FusionDetector(MSR_A, 30.0, vehicles=k)),
    "pulse counts": (missions, lambda k: PulseCountDetector(COUNTS, vehicles=k)),
    "pulse residual": (missions, lambda k: WaveformDetector.of_residual(PulseResidual(fit(), 0.02), k)),
    "pulse fit": (missions, lambda k: WaveformDetector.of_fit(fit(), 30.0, k)),
    "low-level network": (missions, lambda k: low_level_detector(low_level(), k)),
    "high-level networks": (missions, lambda k: MissionDetector(high_level(), k)),
    "both levels": (missions, lambda k: MissionDetector(both_levels(), k)),
}
NUMBER = {rate_changes: 30, approaches: 8, missions: 6}
SIZES = {rate_changes: 12, approaches: 8, missions: 6}


@cache
def evaluation(name):
    source, make = DETECTORS[name]
    count = NUMBER[source]
    intervals = {rate_changes: 40, approaches: 580, missions: STEPS + 1}[source]
    rate = -np.expm1(np.log(0.05) / (count * intervals)) * 1.01
    return evaluate(
        make, source, name=name, false_alarms=rate, validation=range(1000, 1000 + count),
        test=range(2000, 2000 + count), rates=(), patience=8.0,
    )  # fmt: skip


@pytest.mark.parametrize("name", DETECTORS)
def test_a_detector_keeps_the_contract_and_is_measured(name):
    source, make = DETECTORS[name]
    detector = make(2)
    assert isinstance(detector, Detector)
    flights = source(range(2), True)
    detector.reset()
    for interval in range(5):
        verdict = detector.update(flights.telemetry(slice(0, 2), interval))
        assert isinstance(verdict, Verdict)
        assert verdict.detected.shape == verdict.thruster.shape == verdict.statistic.shape == (2,)
        assert verdict.thruster_statistics.shape == verdict.on_time_deficit.shape == (2, SIZES[source])
        assert len(verdict.kind) == 2
    with pytest.raises(ValueError, match=r"telemetry must have \w+, got None"):
        detector.update(Telemetry(1.0))
    found = evaluation(name)
    assert found.name == name
    assert found.flights == NUMBER[source]
    assert np.array(found.confusion).shape == (SIZES[source] + 1, SIZES[source] + 2)


@pytest.mark.parametrize(
    ("name", "missed", "right"),
    [
        ("likelihood ratio", 0.0, 0.9),
        ("cumulative sums", 0.0, 0.9),
        ("hypotheses", 0.0, 0.95),
        ("response test", 0.1, 0.9),
        ("norm of the residual", 0.0, 0.0),
        ("cross-correlation", 0.0, 0.9),
        ("force and torque", 0.0, 1.0),
        ("pulse fit", 0.2, 0.9),
    ],
)
def test_who_is_known_to_find_a_fault_finds_it(name, missed, right):
    found = evaluation(name)
    assert found.missed.value <= missed
    assert right == 0.0 or found.isolated.value >= right


@pytest.mark.parametrize("name", DETECTORS)
def test_one_calibrator_sets_the_threshold_of_each(name):
    source, make = DETECTORS[name]
    known = evaluation(name).calibration
    duration = {rate_changes: 1.0, approaches: 0.1, missions: 1.0}[source]
    found = calibrate(
        make, source, range(1000, 1000 + NUMBER[source]), false_alarms=known.false_alarms * 60.0 / duration,
        per=60.0,
    )  # fmt: skip
    assert found.threshold == known.threshold
    assert found.samples == NUMBER[source]


def test_one_table_holds_them_all():
    rows = table([evaluation(name) for name in DETECTORS]).splitlines()
    assert [row.split("|")[1].strip() for row in rows[2:]] == list(DETECTORS)


def test_arrays_and_telemetry_are_the_same():
    flights = rate_changes(range(3), True)
    by_arrays, by_telemetry = (GLRDetector(ORION, noise=NOISE_OF_ORION, vehicles=3) for _ in range(2))
    for interval in range(40):
        one = by_arrays.update(**flights.step(slice(None), interval))
        other = by_telemetry.update(flights.telemetry(slice(None), interval))
        np.testing.assert_array_equal(one.statistic, other.statistic)
        np.testing.assert_array_equal(one.thruster, other.thruster)


def test_pulse_counts_period_by_period_are_those_of_the_whole_record():
    flights = missions(range(3), True)
    detector = PulseCountDetector(COUNTS, vehicles=3)
    largest = np.zeros((3, 3))
    for interval in range(STEPS):
        verdict = detector.update(flights.telemetry(slice(None), interval))
        largest = np.maximum(largest, verdict.thruster_statistics.reshape(3, 3, 2).max(axis=2))
    np.testing.assert_allclose(largest, COUNTS(flights.pulses[:, :STEPS]).largest, rtol=1e-12)


def test_the_high_level_says_at_the_end_of_its_window_what_it_says_of_the_mission():
    flights = missions(range(3), True)
    detector = MissionDetector(high_level(), 3)
    for interval in range(STEPS + 1):
        verdict = detector.update(flights.telemetry(slice(None), interval))
        assert interval == STEPS or not verdict.statistic.any()
    signals = MissionSignals(flights.pulses[:, :STEPS], flights.attitude, flights.rate, flights.target)
    shares = high_level().residuals(signals) / high_level().thresholds
    np.testing.assert_allclose(verdict.statistic, shares.max(axis=1), rtol=1e-12)
