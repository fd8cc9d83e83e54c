"""One form of belief serves what deals in shares and what deals in floors and slopes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.baselines.chaser_flight import MSR_A
from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.control import FaultAllocation, ThrusterBelief, ValveBelief
from thruster_baselines.detection import GLRDetector, ResponseTest
from thruster_baselines.detection.residuals import FusionDetector
from thruster_envs.physics.health import effect_of
from thruster_envs.spacecraft import load

ORION = load("orion")
SHARES = np.array([1.0, 0.0, 0.4, 1.0, 0.7, *np.ones(7)])
STUCK = np.arange(12) == 4


def test_shares_and_what_is_stuck_come_back_as_they_were_given():
    belief = ActuatorBelief.of_shares(SHARES, STUCK)
    np.testing.assert_array_equal(belief.share, SHARES)
    np.testing.assert_array_equal(belief.stuck_on, STUCK)
    np.testing.assert_array_equal(belief.delivered(np.zeros(12)), np.where(STUCK, SHARES, 0.0))
    np.testing.assert_array_equal(belief.delivered(np.ones(12)), SHARES)
    np.testing.assert_array_equal(belief.effectiveness(ORION.effectiveness()), ORION.effectiveness() * SHARES)


def test_one_thruster_is_changed_and_the_others_are_not():
    belief = ActuatorBelief.of_shares(SHARES, STUCK).changed(3, share=0.9)
    assert belief.share[2] == 0.9
    others = np.arange(12) != 2
    np.testing.assert_array_equal(belief.share[others], SHARES[others])
    np.testing.assert_array_equal(belief.stuck_on, STUCK)


def test_a_fault_that_is_blamed_has_the_share_that_the_physics_gives_it():
    for kind, severity in (("loss", 0.3), ("stuck_on", 0.6), ("leak", 0.2), ("stuck_off", 1.0)):
        belief = ActuatorBelief.healthy(2, 12)
        belief.blame(1, 5, kind, severity, period=0.1)
        effect = effect_of(kind, severity)
        assert belief.share[1, 4] == pytest.approx(effect.gain * (effect.floor + effect.slope), rel=1e-15)
        assert belief.stuck_on[1, 4] == (kind == "stuck_on")
        np.testing.assert_array_equal(np.delete(belief.share[1], 4), 1.0)
        np.testing.assert_array_equal(belief.share[0], 1.0)


def test_names_of_before_give_the_same():
    old, new = ThrusterBelief(SHARES, STUCK), ActuatorBelief.of_shares(SHARES, STUCK)
    for one, other in zip(old, new, strict=True):
        np.testing.assert_array_equal(one, other)
    assert ThrusterBelief.healthy(12).share.shape == (12,)
    assert ValveBelief.sound(3, 8).floor.shape == (3, 8)
    allocation = FaultAllocation("orion")
    command = np.array([0.01, -0.01, 0.0, 0.0, 0.001, 0.0])
    np.testing.assert_array_equal(allocation(command, old), allocation(command, new))


def test_detectors_are_told_of_a_belief_or_of_its_effectiveness():
    belief = ActuatorBelief.of_shares(np.where(STUCK, 0.5, SHARES))
    by_belief, by_matrix = GLRDetector.yang2003(ORION, 30.0), GLRDetector.yang2003(ORION, 30.0)
    by_belief.believe(belief)
    by_matrix.believe(ORION.effectiveness() * belief.share)
    np.testing.assert_array_equal(by_belief.filter.effectiveness, by_matrix.filter.effectiveness)
    two = ActuatorBelief.healthy(2, 8)
    two.blame(1, 3, "loss", 0.5, period=0.1)
    watcher = FusionDetector(MSR_A, 30.0, vehicles=2)
    watcher.believe(two)
    shares = np.where(np.arange(8) == 2, 0.5, 1.0)
    np.testing.assert_array_equal(watcher.effectiveness[1], MSR_A.effectiveness() * shares)
    np.testing.assert_array_equal(watcher.effectiveness[0], MSR_A.effectiveness())


def test_the_response_test_gives_its_belief():
    test = ResponseTest(ORION, 20.0)
    test.update(np.full((1, 12), 4.0), -ORION.effectiveness()[:, 2] * 2.0)
    np.testing.assert_array_equal(test.belief.share, test.health)
    assert test.belief.share[0, 2] == pytest.approx(0.5)


def test_a_valve_that_is_stuck_open_and_delivers_nothing_is_none():
    with pytest.raises(ValueError, match="share of a thruster that is stuck on must be above 0, got 0"):
        ActuatorBelief.of_shares(np.zeros(3), np.ones(3, np.bool_))
