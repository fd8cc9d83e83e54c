"""The compiled draw of faults: what comes out follows the law that the distribution states."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from numba import njit
from scipy import stats

from thruster_envs.faults import GENERAL_KINDS, SENSOR_KINDS, SENSORS, Fault, FaultDistribution, decode
from thruster_envs.faults.distribution import DEFAULT_SEVERITY
from thruster_envs.faults.encoding import FAULT_FIELDS
from thruster_envs.faults.kinds import drawn_severity
from thruster_envs.faults.record import KINDS, PROFILES
from thruster_envs.faults.sampling import draw_faults

THRUSTERS = 12
WORLDS = 6000
RARE = 1e-3
"""A law is rejected below this p-value; the draws are the same in each run."""


@njit
def draw_all(rows, table, thrusters, episode, keys):
    for world in range(rows.shape[0]):
        draw_faults(rows[world], table, thrusters, episode, keys[world], np.uint64(0))


def drawn(
    *,
    worlds: int = WORLDS,
    craft: int = 1,
    slots: int = 4,
    episode: int = 0,
    first_seed: int = 0,
    wheels: int = 3,
    gyros: int = 2,
    **law: object,
) -> list[list[Fault]]:
    """The faults of each world."""
    table = FaultDistribution(**law).encode(THRUSTERS, craft, wheels=wheels, gyros=gyros)
    rows = np.full((worlds, craft, slots, len(FAULT_FIELDS)), 7.0)
    draw_all(rows, table, THRUSTERS, episode, np.arange(first_seed, first_seed + worlds, dtype=np.uint64))
    return [decode(one) for one in rows]


def every(faults: list[list[Fault]]) -> list[Fault]:
    """All faults of all worlds."""
    return [fault for world in faults for fault in world]


def assert_shares(values: list[object], shares: dict[object, float]) -> None:
    """That values come in these shares, and no others come (chi-square)."""
    count = Counter(values)
    assert set(count) == set(shares)
    expected = [share * len(values) for share in shares.values()]
    assert stats.chisquare([count[value] for value in shares], expected).pvalue > RARE


def assert_uniform(values: list[float], low: float, high: float) -> None:
    """That values are uniform over a range (Kolmogorov and Smirnov)."""
    assert low <= min(values) <= max(values) <= high
    assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > RARE


@pytest.mark.parametrize("probability", [0.0, 0.3, 1.0])
def test_a_world_draws_faults_with_the_stated_probability(probability):
    some = sum(bool(world) for world in drawn(probability=probability))
    assert abs(some - probability * WORLDS) <= 4.0 * math.sqrt(probability * (1.0 - probability) * WORLDS)


def test_the_number_of_faults_is_uniform_over_its_range():
    assert_shares(
        [len(world) for world in drawn(probability=1.0, count=(1, 3))], {1: 1 / 3, 2: 1 / 3, 3: 1 / 3}
    )


def test_kinds_come_by_their_weights():
    general = dict.fromkeys(GENERAL_KINDS, 1 / len(GENERAL_KINDS))
    assert_shares([one.kind for one in every(drawn(probability=1.0))], general)
    weighted = drawn(probability=1.0, kinds={"leak": 3.0, "loss": 1.0, "stuck_on": 0.0})
    assert_shares([one.kind for one in every(weighted)], {"leak": 0.75, "loss": 0.25})


@pytest.mark.parametrize("shared", [False, True])
def test_either_all_faults_or_none_are_shared(shared):
    assert {one.shared for one in every(drawn(probability=1.0, shared=shared))} == {shared}


def test_each_thruster_is_equally_likely():
    faults = every(drawn(probability=1.0))
    assert_shares([one.thruster for one in faults], dict.fromkeys(range(1, THRUSTERS + 1), 1 / THRUSTERS))


def test_only_listed_thrusters_fail():
    faults = drawn(probability=1.0, thrusters=(2, 5, 11), count=(2, 2))
    assert_shares([one.thruster for one in every(faults)], {2: 1 / 3, 5: 1 / 3, 11: 1 / 3})


def test_no_thruster_of_a_craft_fails_twice():
    for world in drawn(probability=1.0, count=(1, 4), thrusters=(1, 2, 3, 4)):
        assert len({one.thruster for one in world}) == len(world)


def test_the_last_free_thruster_is_found_and_then_no_more():
    worlds = drawn(worlds=200, probability=1.0, count=(3, 3), thrusters=(4, 8, 9))
    assert all({one.thruster for one in world} == {4, 8, 9} for world in worlds)


def test_each_craft_is_equally_likely_and_has_thrusters_of_its_own():
    worlds = drawn(probability=1.0, craft=3, count=(4, 4), thrusters=(6, 7))
    assert all(len({(one.craft, one.thruster) for one in world}) == len(world) for world in worlds)
    singles = every(drawn(probability=1.0, craft=3))
    assert_shares([one.craft for one in singles], {1: 1 / 3, 2: 1 / 3, 3: 1 / 3})


def test_a_craft_without_a_free_slot_gets_no_more_faults():
    worlds = drawn(worlds=300, probability=1.0, count=(4, 4), slots=2)
    assert {len(world) for world in worlds} == {2}


@pytest.mark.parametrize("kind", KINDS)
def test_severities_are_uniform_over_the_range_of_their_kind(kind):
    values = [one.severity for one in every(drawn(probability=1.0, kinds=(kind,)))]
    low, high = DEFAULT_SEVERITY[kind]
    if low == high:
        assert set(values) == {low}
    else:
        assert_uniform(values, low, high)
    own = drawn(probability=1.0, kinds=(kind,), severity={kind: (0.2, 0.6)})
    assert_uniform([one.severity for one in every(own)], 0.2, 0.6)


def test_times_dwell_and_azimuth_are_uniform_over_their_ranges():
    faults = every(
        drawn(
            probability=1.0,
            onset=(10.0, 90.0),
            duration=(5.0, 25.0),
            profiles=("intermittent",),
            profile_time=(10.0, 30.0),
            dwell=(0.2, 0.7),
        )
    )
    assert_uniform([one.onset for one in faults], 10.0, 90.0)
    assert_uniform([one.duration for one in faults], 5.0 - 1e-9, 25.0)
    assert_uniform([one.profile_time for one in faults], 10.0, 30.0)
    assert_uniform([one.dwell for one in faults], 0.2, 0.7)
    assert_uniform([one.azimuth for one in faults], 0.0, 2.0 * math.pi)


def test_what_is_drawn_of_a_fault_is_independent():
    faults = every(drawn(probability=1.0, kinds=("loss",), onset=(0.0, 1.0), profiles=PROFILES))
    columns = [
        [getattr(one, name) for one in faults]
        for name in ("thruster", "severity", "onset", "profile_time", "azimuth")
    ]
    correlation = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlation).max() < 4.0 / math.sqrt(len(faults))


def test_faults_stay_unless_they_are_given_a_duration():
    assert {one.duration for one in every(drawn(probability=1.0, onset=(0.0, 10.0)))} == {math.inf}


def test_onsets_stand_on_their_grid_where_there_is_one():
    """Rounded down: the first of the grid's steps is as likely as the others."""
    onsets = [one.onset for one in every(drawn(probability=1.0, onset=(0.0, 20.0), onset_grid=5.0))]
    assert_shares(onsets, {0.0: 0.25, 5.0: 0.25, 10.0: 0.25, 15.0: 0.25})


def test_profiles_are_equally_likely_and_an_intermittent_fault_has_its_own():
    faults = every(drawn(probability=1.0, kinds=("loss", "intermittent"), profiles=("step", "ramp", "sine")))
    assert_shares(
        [one.profile for one in faults if one.kind == "loss"], {"step": 1 / 3, "ramp": 1 / 3, "sine": 1 / 3}
    )
    assert {one.profile for one in faults if one.kind == "intermittent"} == {"intermittent"}


LAW = {"probability": 0.7, "count": (1, 3), "onset": (0.0, 100.0), "profiles": PROFILES}


def test_a_draw_depends_on_the_seed_and_the_episode_and_on_nothing_else():
    together = drawn(worlds=50, first_seed=100, **LAW)
    assert drawn(worlds=50, first_seed=100, **LAW) == together
    assert drawn(worlds=1, first_seed=120, **LAW)[0] == together[20]
    assert drawn(worlds=50, first_seed=100, episode=1, **LAW) != together
    assert drawn(worlds=50, first_seed=101, **LAW)[:49] == together[1:]


def test_consecutive_episodes_draw_independently():
    """Whether a world draws a fault in one episode says nothing of the next."""
    first, second = (np.array([bool(world) for world in drawn(episode=episode)]) for episode in (0, 1))
    assert abs(np.corrcoef(first, second)[0, 1]) < 4.0 / math.sqrt(WORLDS)


# ---- Faults of sensors -------------------------------------------------------------------------------------

SENSING = {
    "probability": 0.0, "sensor_probability": 1.0, "onset": (10.0, 90.0), "duration": (5.0, 25.0),
    "profile_time": (10.0, 30.0), "profiles": PROFILES,
}  # fmt: skip


def test_sensors_fail_with_a_probability_of_their_own():
    worlds = drawn(probability=0.3, sensor_probability=0.6)
    both = [({one.sensor is None for one in world}) for world in worlds]
    for share, whose in ((0.3, True), (0.6, False)):
        count = sum(whose in one for one in both)
        assert abs(count - share * WORLDS) < 4.0 * math.sqrt(share * (1.0 - share) * WORLDS)
    together = sum(len(one) == 2 for one in both)
    assert abs(together - 0.18 * WORLDS) < 4.0 * math.sqrt(0.18 * 0.82 * WORLDS)


def test_faults_of_sensors_leave_those_of_thrusters_as_they_are():
    law = {"probability": 0.7, "count": (1, 2), "onset": (0.0, 100.0), "profiles": PROFILES}
    alone = drawn(worlds=500, **law)
    beside = drawn(worlds=500, sensor_probability=0.8, sensor_count=(1, 2), **law)
    assert [[one for one in world if one.sensor is None] for world in beside] == alone


def test_sensors_axes_and_kinds_are_equally_likely():
    faults = every(drawn(**SENSING))
    assert len(faults) == WORLDS
    assert {one.thruster for one in faults} == {0}
    assert_shares([one.sensor for one in faults], dict.fromkeys(SENSORS, 0.25))
    assert_shares([one.axis for one in faults], dict.fromkeys((1, 2, 3), 1 / 3))
    assert_shares([one.kind for one in faults], dict.fromkeys(SENSOR_KINDS, 1 / 6))
    freezes = [one.profile for one in faults if one.kind == "freeze"]
    assert_shares(freezes, {"step": 0.75, "intermittent": 0.25})
    assert_uniform([one.onset for one in faults], 10.0, 90.0)
    assert_uniform([one.duration for one in faults], 5.0 - 1e-9, 25.0)


def test_what_is_asked_of_sensors_is_drawn():
    law = SENSING | {
        "sensors": ("rate",), "sensor_axes": (0, 2), "sensor_kinds": {"bias": 3.0, "spike": 1.0},
        "sensor_severity": {"rate": {"bias": (-0.02, 0.01)}}, "sensor_count": (1, 3),
    }  # fmt: skip
    worlds = drawn(**law)
    faults = every(worlds)
    assert_shares([len(world) for world in worlds], {1: 1 / 3, 2: 1 / 3, 3: 1 / 3})
    assert {one.sensor for one in faults} == {"rate"}
    assert_shares([one.axis for one in faults], {0: 0.5, 2: 0.5})
    assert_shares([one.kind for one in faults], {"bias": 0.75, "spike": 0.25})
    assert_uniform([one.severity for one in faults if one.kind == "bias"], -0.02, 0.01)
    assert_uniform([one.severity for one in faults if one.kind == "spike"], 0.01, 0.1)


@pytest.mark.parametrize("sensor", SENSORS)
def test_severities_of_sensors_are_uniform_over_their_ranges(sensor):
    faults = every(drawn(**SENSING | {"sensors": (sensor,), "profiles": ("step",)}))
    for kind in SENSOR_KINDS:
        values = [one.severity for one in faults if one.kind == kind]
        low, high = drawn_severity(kind, sensor)
        if low == high:
            assert set(values) == {low}
        else:
            assert_uniform(values, low, high)


def test_wheels_and_gyros_fail_by_their_own_numbers():
    kinds = ("stuck_off", "wheel_torque_loss", "wheel_stuck", "gimbal_lock")
    faults = every(drawn(probability=1.0, kinds=kinds, wheels=3, gyros=2))
    shares = {("stuck_off", k): 0.25 / THRUSTERS for k in range(1, THRUSTERS + 1)}
    shares |= {(kind, k): 0.25 / 3.0 for kind in kinds[1:3] for k in (1, 2, 3)}
    shares |= {("gimbal_lock", k): 0.25 / 2.0 for k in (1, 2)}
    assert_shares([(fault.kind, fault.thruster) for fault in faults], shares)


def test_no_wheel_fails_twice_while_a_thruster_of_its_number_may():
    law = {"probability": 1.0, "kinds": ("stuck_off", "wheel_stuck"), "count": (4, 4)}
    for faults in drawn(worlds=500, wheels=2, **law):
        pairs = [(fault.kind, fault.thruster) for fault in faults]
        assert len(set(pairs)) == len(pairs)
        assert sum(kind == "wheel_stuck" for kind, _ in pairs) <= 2
    with pytest.raises(ValueError, match="at most 2, the actuators that may fail"):
        FaultDistribution(kinds=("wheel_stuck",), count=(3, 3)).encode(THRUSTERS, wheels=2)


def test_there_are_as_many_faults_as_are_drawn_while_anything_is_left_to_fail():
    law = {"probability": 1.0, "kinds": ("stuck_off", "wheel_stuck", "gimbal_lock"), "thrusters": (5,)}
    for faults in drawn(worlds=500, count=(4, 4), wheels=2, gyros=1, **law):
        assert sorted((fault.kind, fault.thruster) for fault in faults) == [
            ("gimbal_lock", 1), ("stuck_off", 5), ("wheel_stuck", 1), ("wheel_stuck", 2),
        ]  # fmt: skip
