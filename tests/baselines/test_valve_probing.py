"""Pulses of valves that push and turn nowhere together, when they come, and what they show."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401  # registers the environments
from thruster_baselines.control import ChaserPilot, ProbeSettings, ValveProbing, balanced_groups
from thruster_baselines.detection.residuals import FusionDetector
from thruster_envs.faults import Fault
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

CHASER = load("msr_chaser")
WRENCHES = CHASER.wrenches()
PERIOD = CHASER.control_period


def test_groups_do_nothing_and_part_opposite_corners():
    groups = balanced_groups(WRENCHES)
    np.testing.assert_allclose(WRENCHES @ groups.T, 0.0, atol=1e-9)
    np.testing.assert_array_equal(groups.sum(axis=0), 1.0)
    corners = np.sign([one.position for one in CHASER.thrusters])
    for thruster, corner in enumerate(corners):
        opposite = int((corners == -corner).all(axis=1).argmax())
        assert (groups[:, thruster] * groups[:, opposite] == 0.0).all()


def test_thrusters_of_unequal_strength_are_balanced_by_unequal_rates():
    strength = np.array([1.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.8])
    groups = balanced_groups(WRENCHES * strength)
    np.testing.assert_allclose((WRENCHES * strength) @ groups.T, 0.0, atol=1e-6)
    # A group is opened until its weakest thruster, or the one that is asked for, is open in full.
    np.testing.assert_allclose(groups[groups[:, 1] > 0.0][0], [0, 1, 0.5, 0, 0.5, 0, 0, 0.625], atol=1e-6)


def test_a_pulse_leaves_the_wrench_and_stays_between_its_height_and_one():
    probing = ValveProbing(WRENCHES, PERIOD, ProbeSettings())
    rng = np.random.default_rng(0)
    rates = rng.uniform(0.0, 0.9, (200, 8))
    heights = np.zeros((200, 2))
    heights[np.arange(100), rng.integers(0, 2, 100)] = rng.uniform(0.3, 1.0, 100)
    opened = probing.open(rates, heights)
    np.testing.assert_allclose(opened @ WRENCHES.T, rates @ WRENCHES.T, atol=1e-9)
    np.testing.assert_array_equal(opened[100:], rates[100:])
    assert opened.max() <= 1.0 + 1e-12
    assert (opened >= rates).all()
    for now, height in zip(opened[:100], heights[:100], strict=True):
        group = now[probing.groups[height.argmax()] > 0.0]
        assert group.min() >= height.max() - 1e-12 or group.max() == pytest.approx(1.0)


def test_groups_take_turns_until_an_alarm_and_that_of_the_named_thruster_is_asked():
    settings = ProbeSettings(interval=0.5, height=0.7, search=(0.6, 0.5), question=(0.9, 0.0))
    probing = ValveProbing(WRENCHES, PERIOD, settings)
    never, nobody = np.full(20, -1), np.zeros(20, np.int64)
    elapsed = np.arange(20)
    routine = probing.heights(elapsed, never, never, nobody)
    np.testing.assert_array_equal(np.flatnonzero(routine[:, 0]), [0, 10])
    np.testing.assert_array_equal(np.flatnonzero(routine[:, 1]), [5, 15])
    assert routine.max() == 0.7
    alarmed = probing.heights(elapsed + 100, elapsed, never, nobody)
    np.testing.assert_array_equal(alarmed[:5], [[0.6, 0], [0.5, 0], [0, 0.6], [0, 0.5], [0.6, 0]])
    for thruster in (1, 2):
        named = probing.heights(elapsed + 100, elapsed + 8, elapsed, np.full(20, thruster))
        own = int(probing.groups[:, thruster - 1].argmax())
        np.testing.assert_array_equal(named[:3, own], [0.9, 0.0, 0.9])
        np.testing.assert_array_equal(named[:, 1 - own], 0.0)


def fly(fault, probe, seconds, vehicles=6):
    """Some seconds of flights with a detector: the pilot, and the fuel that was used."""
    envs = gym.make_vec(
        "thruster_envs/MarsRendezvous-v1", num_envs=vehicles, vectorization_mode="vector_entry_point",
        inhibit=True, faults=fault,
    )  # fmt: skip
    observations, _ = envs.reset(seed=VALIDATION.start + 700)
    detector = FusionDetector(CHASER, 12.0, margin=6.0, vehicles=vehicles)
    pilot = ChaserPilot(CHASER, envs.unwrapped.worlds.task.steps, detector, vehicles=vehicles, probe=probe)
    for _ in range(round(seconds / PERIOD)):
        observations, _, _, _, info = envs.step(pilot(observations))
    envs.close()
    return pilot, info["fuel"]


def test_a_slow_valve_shows_in_the_pulses_and_nowhere_else():
    fault = Fault(5, "slow_opening", severity=0.15, onset=25.0)
    unprobed, _ = fly(fault, None, 50.0)
    probed, _ = fly(fault, ProbeSettings(), 50.0)
    assert (unprobed.named == 0).mean() > 0.5
    np.testing.assert_array_equal(probed.named, 5)
    np.testing.assert_array_equal(probed.kind, "slow_opening")
    assert probed.alarm_time.min() > 25.0


def test_what_is_said_waits_until_it_is_clear_and_then_is_right():
    for kind, size in (("stuck_on", 0.4), ("leak", 0.3), ("loss", 0.5)):
        pilot, _ = fly(Fault(2, kind, severity=size, onset=25.0), ProbeSettings(), 32.0)
        np.testing.assert_array_equal(pilot.kind, kind)
        waited = pilot.kind_time - pilot.name_time
        assert waited.min() >= 0.5 - 1e-6
        assert waited.max() <= 2.0 + 1e-6
        words = [one.what for one in pilot.log if one.vehicle == 0]
        assert words[:3] == ["alarm", "named", "identified"]


def test_routine_probes_alarm_nobody_and_cost_little():
    quiet, without = fly(None, None, 100.0)
    probed, fuel = fly(None, ProbeSettings(), 100.0)
    assert probed.log == quiet.log == []
    assert 1.03 < float(np.mean(fuel / without)) < 1.1


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match=r"interval is 0.0; a positive number of s would be right"):
        ProbeSettings(interval=0.0)
    with pytest.raises(ValueError, match=r"search is \(\); one open rate or more would be right"):
        ProbeSettings(search=())
    with pytest.raises(ValueError, match=r"open rate of a probe is 1.2; a number from 0 to 1 would be right"):
        ProbeSettings(question=(0.5, 1.2))
    with pytest.raises(ValueError, match=r"thruster 2 is balanced by no others; no probe would be right"):
        ValveProbing(WRENCHES[:, :7], PERIOD, ProbeSettings())
    some = replace(CHASER, thrusters=CHASER.thrusters[:7])
    with pytest.raises(ValueError, match="is balanced by no others"):
        ChaserPilot(some, 900, probe=ProbeSettings())


@pytest.mark.parametrize("spare", [True, False])
def test_nothing_is_probed_where_the_target_is_near_nor_after_an_alarm_where_a_retreat_takes_its_time(spare):
    chaser = replace(CHASER, spare_branch=spare)
    envs = gym.make_vec(
        "thruster_envs/MarsRendezvous-v1", num_envs=2, vectorization_mode="vector_entry_point",
        inhibit=True, distance=5.0, spacecraft=chaser, faults=Fault(6, "loss", severity=0.6, onset=12.0),
    )  # fmt: skip
    observations, _ = envs.reset(seed=VALIDATION.start + 40)
    pilot = ChaserPilot(
        chaser, envs.unwrapped.worlds.task.steps, FusionDetector(chaser, 12.0, margin=6.0, vehicles=2),
        vehicles=2, distance=5.0, probe=ProbeSettings(),
    )  # fmt: skip
    told, ahead, alarmed = [], [], []
    for _ in range(500):
        actions = pilot(observations)
        told.append(0.5 * (actions[0, :8] + 1.0))
        ahead.append(-pilot.controller.position(observations)[0, 1])
        alarmed.append(np.isfinite(pilot.alarm_time[0]))
        observations, _, _, _, _ = envs.step(actions)
    envs.close()
    wide, ahead, alarmed = np.max(told, axis=1) >= 0.6, np.array(ahead), np.array(alarmed)
    assert wide[~alarmed].sum() >= 3
    assert wide[alarmed].any() == spare
    assert not wide[ahead < 0.5].any()
    words = [one.what for one in pilot.log if one.vehicle == 0]
    assert ("identified" in words) == spare
    np.testing.assert_array_equal(pilot.named, 6)
