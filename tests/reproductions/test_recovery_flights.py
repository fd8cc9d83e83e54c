"""The pilots that recover meet the same faults, and know what they are said to know."""

from __future__ import annotations

import numpy as np
import pytest

from reproductions.fonod2013.recovery import _median
from reproductions.fonod2013.recovery_flights import AT_ONCE, KINDS_OF_FAULT, ONSET, fly, fly_healthy
from thruster_envs.seeds import VALIDATION

THRESHOLDS = {"best stack": 16.0, "source's method": 0.0235}
SEEDS = VALIDATION[:3]


@pytest.fixture(scope="module")
def flights():
    return {pilot: fly(pilot, SEEDS, THRESHOLDS) for pilot in ("oracle", "best stack", "unprotected")}


def test_all_pilots_meet_the_same_faults_and_kinds_come_in_turn(flights):
    faults = [
        [(one.seed, one.kind, one.thruster, one.severity) for one in those] for those in flights.values()
    ]
    assert faults[0] == faults[1] == faults[2]
    assert [one.kind for one in flights["oracle"]] == list(KINDS_OF_FAULT)[:3]
    # A fault is heard of at the decision that follows it.
    assert all(ONSET[0] <= one.onset <= ONSET[1] + 0.1 for one in flights["unprotected"])


def test_the_oracle_captures_where_the_unprotected_is_lost(flights):
    assert all(one.end == "captured" for one in flights["oracle"])
    opened = [one for one in flights["unprotected"] if one.kind == "open"]
    assert all(one.end == "missed or lost" for one in opened)


def test_the_best_stack_names_the_thruster_after_its_alarm_and_captures(flights):
    for one in flights["best stack"]:
        assert one.named == one.thruster
        assert one.onset < one.alarm < one.name < one.duration
        assert one.end == "captured"


def test_on_branch_b_from_the_start_only_its_own_faults_are_met():
    seeds = VALIDATION[:21]
    alone = fly(AT_ONCE, seeds[:7], THRESHOLDS)
    assert all(one.end == "captured" for one in alone)
    assert all(np.isinf(one.onset) for one in alone)
    either = fly(AT_ONCE, seeds, THRESHOLDS, either_branch=True)
    affected = [one for one in either if np.isfinite(one.onset)]
    assert all(one.thruster > 8 for one in affected)
    assert {one.end for one in either if one not in affected} == {"captured"}
    assert any(one.end == "missed or lost" for one in affected)


def test_nothing_is_found_where_nothing_fails():
    (healthy,) = fly_healthy("best stack", VALIDATION[500:501], THRESHOLDS)
    assert healthy.end == "captured"
    assert np.isinf(healthy.alarm)
    assert 0.0 < healthy.statistic < THRESHOLDS["best stack"]


def test_a_median_counts_who_was_never_found():
    assert _median([1.0, np.inf, 3.0]) == 3.0
    assert _median([1.0, np.inf, np.inf]) == np.inf
