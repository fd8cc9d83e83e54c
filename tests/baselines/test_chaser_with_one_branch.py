"""Without a spare branch the Mars chaser captures with what is left, or retreats where the others push."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401  # registers the environments
from thruster_baselines.control import ChaserPilot
from thruster_baselines.detection.residuals import FusionDetector
from thruster_envs.faults import Fault
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

CHASER = replace(load("msr_chaser"), spare_branch=False)
MARS = "thruster_envs/MarsRendezvous-v1"
ONSET = 5.0


def fly(fault, *, told=None, watcher=None, distance=6.0):
    """Fly one episode: the pilot, how the flight ended, the actions of its last period."""
    envs = gym.make_vec(
        MARS, num_envs=1, vectorization_mode="vector_entry_point", spacecraft=CHASER, inhibit=True,
        distance=distance, faults=fault,
    )  # fmt: skip
    observations, _ = envs.reset(seed=VALIDATION.start)
    steps = envs.unwrapped.worlds.task.steps
    pilot = ChaserPilot(CHASER, steps, watcher, distance=distance)
    for step in range(steps):
        if told is not None and step == round(ONSET / 0.1):
            pilot.tell(0, *told)
        actions = pilot(observations)
        observations, _, terminated, _, info = envs.step(actions)
        if terminated[0]:
            break
    envs.close()
    if info["success"][0]:
        return pilot, "captured", actions[0]
    return pilot, "retreated" if info["approach"]["retreated"][0] else "lost", actions[0]


@pytest.mark.parametrize(
    ("thruster", "kind", "severity"),
    [
        (3, "stuck_on", 0.2),
        (8, "stuck_on", 0.85),
        (1, "leak", 0.45),
        (6, "loss", 0.85),
        (5, "slow_opening", 0.4),
        (2, "late_opening", 0.06),
    ],
)
def test_told_of_a_fault_that_leaves_authority_it_captures_with_all_valves_open(thruster, kind, severity):
    fault = Fault(thruster, kind, severity=severity, onset=ONSET)
    pilot, end, actions = fly(fault, told=(thruster, kind, severity))
    assert end == "captured"
    assert [one.what for one in pilot.log] == ["told", "re-allocated"]
    assert (actions[8:] == -1.0).all()
    assert actions.size == 16


@pytest.mark.parametrize(
    ("thruster", "kind"), [(1, "stuck_on"), (7, "stuck_off"), (4, "stuck_on"), (5, "stuck_off")]
)
def test_told_of_an_open_or_a_closed_thruster_it_closes_the_valve_and_retreats(thruster, kind):
    pilot, end, actions = fly(Fault(thruster, kind, onset=ONSET), told=(thruster, kind, 1.0), distance=10.0)
    assert end == "retreated"
    assert [one.what for one in pilot.log] == ["told", "re-allocated", "inhibited", "retreat"]
    assert np.flatnonzero(actions[8:] > 0.0).tolist() == [thruster - 1]
    assert actions[thruster - 1] == -1.0


def test_a_retreat_is_straight_if_the_thruster_pushed_forward_and_along_a_thruster_if_it_pushed_back():
    pilot = ChaserPilot(CHASER, 900)
    forces = CHASER.wrenches()[:3]
    for thruster in range(1, 9):
        pilot.tell(0, thruster, "stuck_off", 1.0)
        away = pilot.state.away[0]
        if forces[0, thruster - 1] > 0.0:
            np.testing.assert_allclose(away, [0.0, -1.0, 0.0], atol=1e-6)
        else:
            # 0.6 of each thruster's push is along the approach; the one left that is on neither of the closed
            # one's sides gives the direction.
            assert away[1] == pytest.approx(-0.6, abs=1e-6)


def test_closer_than_a_diagonal_retreat_allows_it_goes_on_unbraked():
    pilot, end, _ = fly(Fault(1, "stuck_off", onset=ONSET), told=(1, "stuck_off", 1.0), distance=2.6)
    assert end == "captured"
    assert [one.what for one in pilot.log] == ["told", "re-allocated", "inhibited"]


def test_a_wrong_name_costs_two_thrusters_and_the_flight():
    _, end, _ = fly(Fault(8, "stuck_off", onset=ONSET), told=(1, "stuck_on", 1.0), distance=5.0)
    assert end == "lost"


def test_it_finds_out_by_itself_what_leaves_authority_and_captures():
    watcher = FusionDetector(CHASER, 30.0, settle=20.0)
    pilot, end, _ = fly(Fault(6, "stuck_on", severity=0.6, onset=30.0), watcher=watcher)
    assert end == "captured"
    assert pilot.named[0] == 6
    assert {one.what for one in pilot.log} == {"alarm", "named", "re-allocated"}
    believed = [one for one in pilot.log if one.what == "re-allocated"][-1]
    assert believed.severity == pytest.approx(0.6, abs=0.05)


def test_it_finds_out_by_itself_what_does_not_and_retreats():
    watcher = FusionDetector(CHASER, 30.0, settle=20.0)
    pilot, end, _ = fly(Fault(2, "stuck_off", onset=25.0), watcher=watcher, distance=10.0)
    assert end == "retreated"
    assert pilot.named[0] == 2
    assert [one.what for one in pilot.log if one.what in ("inhibited", "retreat")] == ["inhibited", "retreat"]


def test_a_velocity_is_seen_through_the_filter_that_expects_nominal_thrust():
    # An error c of the change in every period leaves an alpha-beta filter (alpha / beta - 1/2) c behind.
    pilot, end, _ = fly(Fault(3, "stuck_on", severity=0.6, onset=ONSET), told=(3, "stuck_on", 0.6))
    assert end == "captured"
    change = 0.1 * (0.6 - 0.1) * CHASER.wrenches()[:3, 2] / CHASER.mass
    behind = (0.3 / 0.05 - 0.5) * np.array([-change[2], change[0], -change[1]])  # LVLH
    np.testing.assert_allclose(pilot.state.unseen[0, 3:], behind, rtol=1e-6)


def test_a_chaser_without_isolation_valves_is_refused():
    bare = replace(CHASER, isolation_valves=False)
    with pytest.raises(ValueError, match="spacecraft: isolation_valves is False; True would be right"):
        ChaserPilot(bare, 900)
