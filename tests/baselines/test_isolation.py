"""Hypotheses tell thrusters, opposite ones too, and sensors apart; what cannot be told apart is said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.control import FaultAllocation
from thruster_baselines.detection import (
    FaultFlights,
    GLRDetector,
    HypothesisDetector,
    Telemetry,
    inseparable_pairs,
)
from thruster_baselines.detection.fault_flights import effect_of_fault, tilted_columns
from thruster_baselines.detection.separability import OPPOSITE, PARALLEL, TILTS
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping import delivered_on_times
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

ORION = load("orion")
BARE = load("spheres")
SPHERES = BARE.replace(
    sensors=dataclasses.replace(BARE.sensors, position=2e-3, velocity=1e-3, attitude=5e-3, rate=3e-3),
    thrusters=[dataclasses.replace(one, minimum_pulse=0.0, scatter=0.1) for one in BARE.thrusters],
)
FLIGHTS, INTERVALS, ONSET = 24, 8, 4


def watch(spacecraft, change, told=None):
    """The verdicts, interval by interval, of flights in which thruster `1 + flight % 12` fails.

    `change` gives (6,) from the thruster's index, on-times (12,), and interval; it acts from `ONSET` on.
    """
    rng = np.random.default_rng(0)
    period, n = spacecraft.control_period, spacecraft.number_of_thrusters
    detector = HypothesisDetector(spacecraft, 12.0, coupling=0.0, vehicles=FLIGHTS)
    noise, verdicts = PhysicalNoise(spacecraft), []
    for interval in range(INTERVALS):
        fires = rng.random((FLIGHTS, n)) < 0.3
        fires[np.arange(FLIGHTS), np.arange(FLIGHTS) % n] = True
        on_times = period * rng.uniform(0.1, 0.5, (FLIGHTS, n)) * fires
        if told is not None:
            on_times = np.tile(told, (FLIGHTS, 1))
        residual = np.stack([rng.multivariate_normal(np.zeros(6), noise(one)) for one in on_times])
        if interval >= ONSET:
            residual += np.stack([change(k % n, on_times[k], interval) for k in range(FLIGHTS)])
        rate_change = on_times @ spacecraft.effectiveness().T + residual
        verdicts.append(detector.update(on_times, rate_change, period))
    return verdicts


def loss(spacecraft):
    return lambda i, told, _: -0.7 * told[i] * spacecraft.effectiveness()[:, i]


def leak(spacecraft):
    return lambda i, told, _: 0.4 * (spacecraft.control_period - told[i]) * spacecraft.effectiveness()[:, i]


@pytest.mark.parametrize("spacecraft", [ORION, SPHERES], ids=lambda one: one.name)
@pytest.mark.parametrize("fault", [loss, leak])
def test_it_names_the_thruster_that_fails_and_not_the_opposite_one(spacecraft, fault):
    verdicts = watch(spacecraft, fault(spacecraft))
    assert not any(verdict.detected.any() for verdict in verdicts[:ONSET])
    right = verdicts[-1].thruster == 1 + np.arange(FLIGHTS) % 12
    assert right.mean() >= 0.95


def test_a_misalignment_is_a_misalignment_of_the_thruster_that_has_it():
    across = tilted_columns(ORION)[1]
    verdicts = watch(ORION, lambda i, told, _: told[i] * (np.sin(0.5) * across[:, i]))
    last = verdicts[-1]
    assert (last.thruster == 1 + np.arange(FLIGHTS) % 12).mean() >= 0.8
    assert last.kind.count("misalignment") >= 0.8 * FLIGHTS


def test_a_jump_of_the_rate_is_a_fault_of_the_sensor():
    jump = np.array([0.0, 0.0, 0.0, 0.0, 20.0 * 2**0.5 * ORION.sensors.rate, 0.0])
    briefly = np.full(12, 0.05)
    verdicts = watch(ORION, lambda i, told, interval: jump if interval == ONSET else np.zeros(6), briefly)
    named = verdicts[ONSET + 2]
    assert named.sensor.count("rate") >= 0.9 * FLIGHTS
    assert (named.thruster > 0).mean() <= 0.1


def test_while_commands_stay_the_same_opposite_thrusters_are_candidates_together():
    steady = watch(SPHERES, loss(SPHERES), told=np.full(12, 0.3))
    rows, failed = np.arange(FLIGHTS), np.arange(FLIGHTS) % 12
    candidates = steady[ONSET + 2].candidates
    assert candidates[rows, failed].all()
    assert candidates[rows, (failed + 6) % 12].mean() >= 0.8
    varied = watch(SPHERES, loss(SPHERES))[-1].candidates
    assert varied[rows, (failed + 6) % 12].mean() <= 0.5


def test_a_verdict_without_candidates_has_the_named_thruster_alone():
    detector = GLRDetector("orion", coupling=0.0)
    verdict = detector.update(np.eye(12)[3], np.zeros(6), 1.0)
    assert verdict.candidates.tolist() == [(np.arange(1, 13) == verdict.thruster[0]).tolist()]
    assert verdict.sensor == ("",)


def test_the_pairs_that_physics_cannot_tell_apart_follow_from_the_effectiveness():
    def of(spacecraft, reason):
        return {one[:2] for one in inseparable_pairs(spacecraft) if one.reason == reason}

    assert of(SPHERES, OPPOSITE) == {(i, i + 6) for i in range(1, 7)}
    assert of(SPHERES, PARALLEL) == of(ORION, PARALLEL) == of(ORION, OPPOSITE) == set()
    corners = [range(first, first + 3) for first in (1, 4, 7, 10)]
    clusters = {(i, j) for corner in corners for i in corner for j in corner if i < j}
    assert clusters <= of(ORION, TILTS)


@pytest.mark.parametrize("kind", ["leak", "loss", "misalignment", "bias", "sign", "stuck_on"])
def test_the_effect_of_a_fault_is_what_the_physics_make_of_it(kind):
    quiet = ORION.replace(
        sensors=dataclasses.replace(ORION.sensors, position=1e-6, velocity=1e-7, attitude=1e-9, rate=1e-7),
        thrusters=[dataclasses.replace(one, scatter=0.0) for one in ORION.thrusters],
        feed=dataclasses.replace(ORION.feed, coupling=0.0),
    )
    source = FaultFlights(spacecraft=quiet, kind=kind, periods=20, onset=(15, 15))
    flights = source(VALIDATION[:3], True)
    for flight, seed in enumerate(VALIDATION[:3]):
        fault = source.fault(seed)
        on_times = flights.on_times[flight, 15:16]
        residual = flights.rate_change[flight, 15] - quiet.effectiveness() @ on_times[0]
        expected = effect_of_fault(quiet, fault, on_times)[0, 3:]
        # but for the gyroscopic term of the mean rate
        np.testing.assert_allclose(residual[3:], expected, atol=2e-4 + 0.03 * np.abs(expected).max())
    assert (flights.effect > 0.0).all()


def test_a_sensor_fault_is_as_large_as_it_is_in_standard_deviations():
    source = FaultFlights(spacecraft=ORION, kind="bias", sensor="rate", periods=45)
    flights = source(VALIDATION[:4], True)
    sizes = np.abs([source.fault(seed).severity for seed in VALIDATION[:4]])
    np.testing.assert_allclose(flights.effect, sizes / (2**0.5 * ORION.sensors.rate), rtol=0.5)
    assert flights.sensor == ("rate",) * 4
    assert not flights.thruster.any()
    assert isinstance(flights.telemetry(slice(None), 0), Telemetry)


def test_a_leaking_valve_takes_its_opening_of_the_others_loss():
    allocation = FaultAllocation(ORION)
    on_times = np.array([0.0, *np.full(11, 2.0)])
    shut = delivered_on_times(on_times, ORION.feed.coupling)
    wide = delivered_on_times(np.where(np.arange(12) == 0, 5.0, on_times), ORION.feed.coupling)
    leaking = ActuatorBelief.healthy(12).changed(1, share=0.25, stuck_on=True)
    np.testing.assert_allclose(allocation.delivered(on_times, leaking)[1:], (0.75 * shut + 0.25 * wide)[1:])


def test_what_cannot_be_is_refused_in_one_line():
    with pytest.raises(ValueError, match=r"odds must be at least 1, got 0\.5"):
        HypothesisDetector(ORION, 10.0, odds=0.5)
    with pytest.raises(ValueError, match="patience must be at least 0, got -1"):
        HypothesisDetector(ORION, 10.0, patience=-1)
