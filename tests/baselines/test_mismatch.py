"""A description that does not fit is told apart from a faulty thruster, and the parameter is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from thruster_baselines.detection import CUSUMDetector, GLRDetector, RandomFlights
from thruster_baselines.detection.mismatch import PARAMETERS, ModelMismatchWarning
from thruster_envs.faults import FaultDistribution
from thruster_envs.spacecraft import Feed, load

ORION = load("orion")
INTERVALS = 80


def turned(axis: int, factor: float):
    inertia = np.array(ORION.inertia)
    inertia[axis, axis] *= factor
    return ORION.replace(inertia=tuple(map(tuple, inertia.tolist())))


def thrusters(**changes):
    return ORION.replace(thrusters=tuple(replace(one, **changes) for one in ORION.thrusters))


CASES = {
    "feed coupling": (ORION.replace(feed=Feed(coupling=0.03)), -0.03),
    "thrust of all": (thrusters(thrust=0.066), 0.1),
    "mass": (ORION.replace(mass=26.0), 6.0 / 26.0),
    "inertia y": (turned(1, 1.1), 0.1 / 1.1),
    "valve delay": (thrusters(opening_delay=0.05), 0.05),
}
"""What is true, while Orion is believed, and by how much the parameter is off."""


def watched(flights, kind=GLRDetector):
    detector = kind.for_vehicle(ORION, vehicles=len(flights.on_times))
    for t in range(flights.on_times.shape[1]):
        verdict = detector.update(flights.telemetry(slice(None), t))
    return detector, verdict


@pytest.mark.parametrize("parameter", CASES)
def test_the_parameter_that_does_not_fit_is_named(parameter):
    true, off = CASES[parameter]
    flights = RandomFlights(spacecraft=true, intervals=INTERVALS)(range(20), False)
    with pytest.warns(
        ModelMismatchWarning, match=f"does not fit vehicle .*: {parameter} seems to be off by"
    ) as all_of:
        detector, verdict = watched(flights)
    assert len(all_of) == 1  # once
    assert np.mean([one == parameter for one in verdict.mismatch]) >= 0.9
    estimate = detector.mismatch.estimate[:, PARAMETERS.index(parameter)]
    assert np.median(estimate) == pytest.approx(off, rel=0.25)


@pytest.mark.parametrize("kind", ["stuck_off", "loss", "stuck_on", "leak"])
def test_a_faulty_thruster_is_no_mismatch(kind):
    faults = FaultDistribution(kinds=(kind,), onset=(5.0, 40.0), onset_grid=1.0)
    flights = RandomFlights(spacecraft=ORION, faults=faults, intervals=INTERVALS)(range(40), True)
    detector, _ = watched(flights, CUSUMDetector)
    assert (detector.mismatch.parameter < 0).all()


def test_a_healthy_vehicle_fits_for_hours():
    flights = RandomFlights(spacecraft=ORION, intervals=1000)(range(20), False)
    detector, verdict = watched(flights)
    assert verdict.mismatch == ("",) * 20
    spread = detector.mismatch.estimate / detector.mismatch.deviation
    assert np.abs(spread).max() < 5.0


def test_a_reset_forgets():
    flights = RandomFlights(spacecraft=CASES["mass"][0], intervals=INTERVALS)(range(2), False)
    with pytest.warns(ModelMismatchWarning):
        detector, _ = watched(flights)
    detector.reset(np.array([True, False]))
    assert detector.mismatch.names() == ("", "mass")
