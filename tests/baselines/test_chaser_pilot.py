"""The pilot of the Mars chaser captures whatever one thruster does, and says what it decided."""

from __future__ import annotations

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401  # registers the environments
from thruster_baselines.control import ChaserPilot, RecoveryPhase, RecoverySettings
from thruster_baselines.detection.residuals import FusionDetector
from thruster_envs.faults import Fault
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

CHASER = load("msr_chaser")
MARS = "thruster_envs/MarsRendezvous-v1"
ONSET = 5.0


def detector(threshold, settle, vehicles=2):
    return FusionDetector(CHASER, threshold, settle=settle, vehicles=vehicles)


def fly(fault, watcher, tell=None, vehicles=2, distance=6.0):
    """Fly to the end of the first episodes: the pilot, who captured, who was safe."""
    envs = gym.make_vec(
        MARS, num_envs=vehicles, vectorization_mode="vector_entry_point", inhibit=True, distance=distance,
        faults=fault,
    )  # fmt: skip
    observations, _ = envs.reset(seed=VALIDATION.start)
    pilot = ChaserPilot(
        CHASER, envs.unwrapped.worlds.task.steps, watcher, vehicles=vehicles, distance=distance
    )
    over, captured, safe = np.zeros((3, vehicles), np.bool_)
    time, log = 0.0, []
    while not over.all():
        if tell is not None and abs(time - ONSET) < 0.01:
            for vehicle in range(vehicles):
                pilot.tell(vehicle, *tell)
        actions = pilot(observations)
        log = [one for one in pilot.log if one.vehicle == 0] if not over[0] else log
        observations, _, terminated, _, info = envs.step(actions)
        captured |= info["success"] & terminated & ~over
        safe |= info["approach"]["safe"] & terminated & ~over
        over |= terminated
        time += 0.1
    return log, captured, safe


def test_without_a_fault_it_captures_and_decides_nothing():
    log, captured, _ = fly(None, None)
    assert captured.all()
    assert log == []


def test_told_of_an_open_valve_it_closes_it_at_once_and_goes_over_a_period_later():
    log, captured, _ = fly(Fault(3, "stuck_on", onset=ONSET), None, (3, "stuck_on", 1.0))
    assert captured.all()
    assert [(one.what, one.thruster) for one in log] == [("told", 3), ("inhibited", 3), ("branch B", 0)]
    # What is told comes before the sight of the same period.
    assert log[2].time - log[0].time == pytest.approx(0.1)


def test_a_valve_that_nobody_knows_of_costs_the_flight():
    log, captured, _ = fly(Fault(3, "stuck_on", onset=ONSET), None)
    assert not captured.any()
    assert [one.what for one in log] == ["retreat", "branch B"]


def test_told_of_half_a_loss_it_stays_on_the_branch_and_captures():
    log, captured, _ = fly(Fault(6, "loss", severity=0.4, onset=ONSET), None, (6, "loss", 0.4))
    assert captured.all()
    assert [one.what for one in log] == ["told", "re-allocated"]


def test_more_than_that_sends_it_to_the_other_branch():
    log, captured, _ = fly(Fault(6, "loss", severity=0.8, onset=ONSET), None, (6, "loss", 0.8))
    assert captured.all()
    assert [one.what for one in log] == ["told", "inhibited", "branch B"]


@pytest.mark.parametrize(("thruster", "kind"), [(1, "stuck_on"), (6, "stuck_off")])
def test_it_finds_out_by_itself(thruster, kind):
    log, captured, _ = fly(Fault(thruster, kind, onset=30.0), detector(30.0, 20.0))
    assert captured.all()
    assert [one.what for one in log] == ["alarm", "named", "inhibited", "branch B"]
    assert log[1].thruster == thruster
    assert 30.0 < log[0].time < 32.5


def test_an_alarm_on_branch_b_ends_in_a_retreat():
    failed = [Fault(1, "stuck_on", onset=ONSET), Fault(8 + 6, "stuck_on", onset=15.0)]
    log, captured, safe = fly(failed, detector(30.0, 2.0), distance=20.0)
    assert safe.all()
    assert not captured.any()
    assert [one.what for one in log] == ["alarm", "named", "inhibited", "branch B", "retreat"]
    assert log[-1].reason == "an alarm on branch B"
    assert 15.0 < log[-1].time < 20.0


@pytest.mark.parametrize("delay", [1, 3])
def test_a_second_episode_is_flown_as_if_it_were_the_first(delay):
    env = gym.make(
        MARS, inhibit=True, distance=6.0, navigation_delay=delay, faults=Fault(3, "stuck_on", onset=ONSET)
    )
    task = env.unwrapped.task

    def pilot():
        return ChaserPilot(CHASER, task.steps, detector(30.0, 2.0, 1), distance=6.0, navigation_delay=delay)

    def episode(who, periods):
        observation, _ = env.reset(seed=VALIDATION.start)
        begun = len(who.log)
        seen = [observation]
        for _ in range(periods):
            seen.append(env.step(who(seen[-1]))[0])
        return np.array(seen), who.log[begun:]

    fresh, log = episode(pilot(), 120)
    used = pilot()
    episode(used, 37)
    again, later = episode(used, 120)
    np.testing.assert_array_equal(again, fresh)
    assert [str(one) for one in later] == [str(one) for one in log]
    assert log


def test_phases_of_a_recovery_follow_each_other():
    pilot = ChaserPilot(CHASER, 900, vehicles=2)
    assert pilot.phase.tolist() == [RecoveryPhase.NOMINAL] * 2
    pilot.tell(0, 6, "loss", 0.4)
    pilot.tell(1, 3, "stuck_on", 1.0)
    assert pilot.phase.tolist() == [RecoveryPhase.ACCOMMODATED, RecoveryPhase.NOMINAL]
    assert pilot.state.due == {1: "authority is lost"}
    assert pilot.belief.share[0, 5] == 0.6
    observation = gym.make(MARS, inhibit=True).reset(seed=0)[0]
    pilot(np.repeat(observation[np.newaxis], 2, axis=0))
    assert pilot.phase.tolist() == [RecoveryPhase.ACCOMMODATED, RecoveryPhase.REDUNDANT]
    pilot.reset()
    assert pilot.phase.tolist() == [RecoveryPhase.NOMINAL] * 2


def test_a_weak_thruster_still_gives_the_wrench_that_is_asked_for():
    pilot = ChaserPilot(CHASER, 900)
    pilot.tell(0, 4, "loss", 0.4)
    shares = np.ones(8)
    shares[3] = 0.6
    wrench = np.array([[6.0, -2.0, 4.0, 1.0, -0.5, 0.4]])
    rates = pilot._allocate(wrench)
    np.testing.assert_allclose((CHASER.wrenches() * shares) @ rates[0], wrench[0], atol=1e-9)
    assert rates.min() >= 0.1 - 1e-12


def test_settings_take_their_names_of_before():
    assert dataclasses.replace(RecoverySettings(), swing=5.0) == RecoverySettings(transient=5.0)
    settings = RecoverySettings(mouth=0.3, swing=5.0)
    assert settings == RecoverySettings(corridor_radius=0.3, transient=5.0)
    assert (settings.mouth, settings.swing, settings.widening) == (0.3, 5.0, settings.corridor_slope)
    with pytest.raises(TypeError, match="got both 'transient' and its old name 'swing'"):
        RecoverySettings(swing=5.0, transient=5.0)


def test_a_sight_of_this_moment_or_too_few_rows_are_refused():
    with pytest.raises(ValueError, match="navigation_delay is 0; a whole number of 1 or more would be right"):
        ChaserPilot(CHASER, 900, navigation_delay=0)
    with pytest.raises(ValueError, match="observation has 1 rows; 2 would be right"):
        ChaserPilot(CHASER, 900, vehicles=2)(np.zeros(45))


def test_the_pilot_reads_its_environment():
    env = gym.make("thruster_envs/MarsRendezvous-v1", inhibit=True, distance=8.0, navigation_delay=2)
    pilot = ChaserPilot.of(env)
    assert pilot.controller.distance == 8.0
    assert pilot.controller.navigation_delay == 2
    assert pilot.controller.steps == env.unwrapped.task.steps
    with pytest.raises(
        ValueError, match=r"must have inhibit=True, since the pilot closes .* got inhibit=False"
    ):
        ChaserPilot.of(gym.make("thruster_envs/MarsRendezvous-v1"))
    with pytest.raises(
        ValueError, match=r"distance must be that of the environment, 8\.0, or None, got 9\.0"
    ):
        ChaserPilot.of(env, distance=9.0)
    with pytest.raises(ValueError, match="steps must be given with a spacecraft"):
        ChaserPilot(CHASER)
