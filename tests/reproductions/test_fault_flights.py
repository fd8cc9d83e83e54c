"""Pilots are compared on the same faults, and each knows what it is said to know."""

from __future__ import annotations

import numpy as np
import pytest

from reproductions.yang2003.closed_loop_faults import study
from reproductions.yang2003.fault_flights import FAULT_KINDS, PILOTS, Oracle, fly
from thruster_envs.faults import KINDS
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

ORION = load("orion")
SHORT = 0.05  # orbits: 57 periods
DURATION = 57 * 5.0


@pytest.fixture(scope="module")
def idle():
    return [fly("does nothing", seed, SHORT) for seed in VALIDATION[:40]]


def test_each_kind_strikes_in_the_first_third_and_any_thruster(idle):
    assert {one.kind for one in idle} == set(FAULT_KINDS)
    assert len({one.thruster for one in idle}) > 8
    assert all(0.0 <= one.onset <= DURATION / 3.0 + 5.0 for one in idle)
    assert max(one.onset for one in idle) > DURATION / 4.0


def test_who_commands_nothing_fires_only_what_is_stuck_open(idle):
    for one in idle:
        assert (one.firing_time > 0.0) == (one.kind == "stuck_on")


def test_all_pilots_meet_the_same_fault_and_only_the_classical_one_says_anything(idle):
    seed = next(one.seed for one in idle if one.kind == "stuck_on")
    flown = [fly(pilot, seed, SHORT) for pilot in PILOTS]
    assert len({(one.kind, one.thruster, one.onset) for one in flown if not one.lost}) == 1
    classical = flown[list(PILOTS).index("classical")]
    assert [(one.thruster, one.kind) for one in classical.decisions if one.what == "named"] == [
        (classical.thruster, "stuck_on")
    ]
    assert not flown[list(PILOTS).index("blind")].decisions
    assert classical.rate < 0.5 * flown[list(PILOTS).index("blind")].rate


def test_the_oracle_believes_what_is_true_and_no_longer_than_that():
    oracle = Oracle(ORION, 571)
    truth = {
        "active": np.array([True, False]),
        "kind": np.array([KINDS.index("loss") + 1, 0]),
        "thruster": np.array([4, 0]),
        "severity": np.array([0.5, 0.0]),
    }
    oracle.tell(truth)
    assert [(one.what, one.thruster, one.kind, one.level) for one in oracle.log] == [("told", 4, "loss", 0.5)]
    oracle.tell(truth)
    assert len(oracle.log) == 1
    oracle.tell(truth | {"active": np.array([False, False])})
    assert oracle.log[-1].kind == "healthy"


def test_the_study_judges_the_classical_pilot_by_what_the_oracle_can_fly(monkeypatch):
    """Three flights by hand: the oracle flies two of them, the classical pilot one of those."""
    import dataclasses

    from reproductions.record import QUICK
    from reproductions.yang2003 import closed_loop_faults

    one = fly("does nothing", VALIDATION[0], SHORT)
    success = {"oracle": (True, True, False), "classical": (True, False, True)}
    time = {"oracle": (100.0, 100.0, 100.0), "classical": (105.0, 300.0, 300.0)}
    flown = [
        dataclasses.replace(
            one,
            pilot=pilot,
            seed=seed,
            success=success.get(pilot, (False,) * 3)[seed],
            firing_time=time.get(pilot, (50.0,) * 3)[seed],
        )
        for seed in range(3)
        for pilot in PILOTS
    ]
    monkeypatch.setattr(closed_loop_faults, "fly_all", lambda seeds, orbits: flown)
    finding = study(QUICK)
    assert finding.data["oracle can fly"] == 2
    assert finding.data["of these the classical pilot flies"] == 1
    assert finding.data["firing time of the oracle's, median"] == pytest.approx(1.05)
    assert list(finding.checks.values()) == [False, True, False]
