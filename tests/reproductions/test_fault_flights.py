"""Pilots are compared on the same faults, and each knows what it is said to know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reproductions.yang2003.closed_loop_faults import _holding, study
from reproductions.yang2003.fault_flights import (
    FAULT_KINDS,
    PILOTS,
    HealthyFlight,
    Oracle,
    fly,
    fly_healthy,
)
from thruster_baselines.control.fault_allocation import FaultAllocation, ThrusterBelief
from thruster_baselines.detection.calibration import chi_squared_threshold
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


def test_healthy_flights_keep_the_likelihood_ratio_of_every_interval():
    (flight,) = fly_healthy(VALIDATION[:1], SHORT)
    assert flight.statistics.shape == (57 - 1,)  # the last measurement comes after the last decision
    assert flight.threshold == pytest.approx(chi_squared_threshold(1e-4, tests=12))
    assert flight.names == 0


@pytest.mark.parametrize(("period", "thruster"), [(5.0, 3), (1.0, 3), (1.0, 8)])
def test_what_scatter_leaves_while_others_hold_grows_with_the_period(period, thruster):
    """Drawn firings against the computed spread, for one thruster; the median over all is of its size."""
    spacecraft = replace(ORION, control_period=period)
    allocation = FaultAllocation(spacecraft)
    belief = ThrusterBelief.healthy(12).changed(thruster, share=1.0, stuck_on=True)
    delivered = allocation.delivered(allocation(np.zeros(6), belief), belief)
    share = 1.0 + 0.1 * np.random.default_rng(3).uniform(-1.0, 1.0, (4000, 12))
    rates = (share * delivered) @ allocation.nominal[3:].T
    spread = np.sqrt(np.square(rates).sum(axis=1).mean())
    computed = _holding(period)["rate after a period, root mean square, rad/s"]
    assert spread == pytest.approx(computed, rel=0.1)
    assert np.degrees(computed) < 0.5 or period > 1.0  # 0.5 degrees/s is the terminal box


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
    statistics = [np.full(1000, 5.0), np.r_[np.full(3, 30.0), np.full(997, 5.0)]]  # no alarm, and three
    healthy = [HealthyFlight(seed, True, 400.0, 20.0, statistics[seed], seed) for seed in range(2)]
    monkeypatch.setattr(closed_loop_faults, "fly_all", lambda *given, **more: flown)
    monkeypatch.setattr(closed_loop_faults, "fly_healthy", lambda *given, **more: healthy)
    finding = study(QUICK)
    assert finding.data["oracle can fly"] == 2
    assert finding.data["of these the classical pilot flies"] == 1
    assert finding.data["firing time of the oracle's, median"] == pytest.approx(1.05)
    assert list(finding.checks.values()) == [False, True, False, False, False]
    seen = finding.data["alarms of healthy flights"]["periods of 5 s"]
    assert (seen["alarms"], seen["intervals"], seen["flights in which one was named"]) == (3, 2000, 1)
