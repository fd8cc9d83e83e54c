"""Approaches of the Mars chaser for detectors to look at, and what the source's test says of them."""

from __future__ import annotations

import numpy as np

from thruster_baselines.detection.approach_flights import HEALTHY_DURATION, ONSET, fly
from thruster_baselines.detection.residuals import CorrelationDetector, NormThreshold, margin_threshold, watch
from thruster_envs.seeds import VALIDATION

VEHICLE = "msr_chaser"


def test_the_flights_approach_and_their_fault_begins_off_the_sample_grid():
    healthy, opened = fly(VALIDATION[:3]), fly(VALIDATION[:3], 4, "stuck_on", 1.0)
    assert healthy.position.shape == (3, round(HEALTHY_DURATION / healthy.period), 3)
    assert np.isinf(healthy.onset).all()
    assert (ONSET[0] <= opened.onset).all()
    assert (opened.onset <= ONSET[1]).all()
    assert np.unique(opened.onset).size == 3
    until = int(ONSET[0] / opened.period)
    np.testing.assert_array_equal(opened.position[:, :until], healthy.position[:, :until])
    assert (np.abs(opened.position[:, until + 20] - healthy.position[:, until + 20]).max(axis=1) > 0.01).all()


def test_the_controller_drives_the_open_thruster_s_command_to_the_lowest():
    opened = fly(VALIDATION[:5], 6, "stuck_on", 1.0)
    later = opened.open_rates[:, 620:630].mean(axis=1)
    assert (later.argmin(axis=1) == 5).all()


def test_the_source_s_test_is_right_for_open_valves_and_wrong_for_closed_ones():
    norms = watch(NormThreshold(VEHICLE, np.inf, vehicles=20), fly(VALIDATION[:20])).statistic
    detector = CorrelationDetector(VEHICLE, margin_threshold(norms), vehicles=5)
    for thruster in (1, 6):
        assert (watch(detector, fly(VALIDATION[:5], thruster, "stuck_on", 1.0)).thruster == thruster).all()
        assert (watch(detector, fly(VALIDATION[:5], thruster, "stuck_off", 1.0)).thruster != thruster).all()
