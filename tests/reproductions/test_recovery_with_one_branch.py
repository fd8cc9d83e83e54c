"""Without a spare branch the same faults are met, and what is said of them follows from the flights."""

from __future__ import annotations

from dataclasses import replace

import pytest

from reproductions.fonod2013.recovery_flights import Flight, fly
from reproductions.fonod2013.recovery_with_one_branch import _among, _ends, _left, _name
from thruster_envs.seeds import VALIDATION

THRESHOLDS = {"best stack": 16.0, "source's method": 0.0235}
FLIGHT = Flight(
    pilot="oracle", seed=1, kind="open", thruster=3, severity=1.0, onset=60.0, end="captured", duration=206.0,
    alarm=60.5, name=61.0, named=3, said="stuck_on", said_at=61.0, statistic=5.0, fuel=160.0,
)  # fmt: skip


def test_the_oracle_retreats_without_the_thruster_and_captures_with_a_stuck_one():
    flights = fly("oracle", VALIDATION[20:23], THRESHOLDS, spare_branch=False)
    assert [(one.kind, one.end) for one in flights] == [
        ("open", "retreated"),
        ("closed", "retreated"),
        ("stuck at", "captured"),
    ]
    with_a_branch = fly("unprotected", VALIDATION[20:23], THRESHOLDS)
    assert [(one.thruster, one.severity) for one in flights] == [
        (one.thruster, one.severity) for one in with_a_branch
    ]


def test_a_name_is_right_wrong_or_none():
    assert _name(FLIGHT) == "right"
    assert _name(replace(FLIGHT, named=4)) == "wrong"
    assert _name(replace(FLIGHT, named=0)) == "none"


def test_flights_are_counted_by_seed_and_end():
    flights = [FLIGHT, replace(FLIGHT, seed=2, end="retreated"), replace(FLIGHT, seed=3, end="out of time")]
    assert _ends(flights) == "1, 1, 1"
    assert _among(flights, {1, 3}, lambda one: one.end == "captured") == (1, 2)


def test_a_thruster_stuck_half_open_leaves_most_of_all_that_are_stuck():
    assert _left("stuck_on", 0.5) == pytest.approx(0.25)
    assert _left("stuck_on", 0.2) == pytest.approx(_left("stuck_on", 0.8)) == pytest.approx(0.1)
