"""What a distribution of faults can be, its table, and what a user may pass as faults."""

import copy
import dataclasses
import json
import math
import pickle
import re

import numpy as np
import pytest

from thruster_envs.faults import GENERAL_KINDS, KINDS, Fault, FaultDistribution, as_faults
from thruster_envs.faults import distribution as layout

FULL = FaultDistribution(
    probability=0.9,
    kinds={"stuck_off": 1.0, "loss": 3.0, "leak": 0.0},
    count=(1, 3),
    onset=(10.0, 100.0),
    duration=(5.0, 50.0),
    severity={"loss": (0.2, 0.4)},
    profiles=("step", "ramp"),
    profile_time=(2.0, 8.0),
    dwell=(0.25, 0.75),
    thrusters=(2, 5, 12),
    onset_grid=5.0,
    shared=True,
    sensor_probability=0.4,
    sensors=("attitude", "rate"),
    sensor_kinds={"bias": 2.0, "freeze": 1.0},
    sensor_count=(1, 2),
    sensor_severity={"rate": {"bias": (-0.01, 0.02)}},
    sensor_axes=(0, 3),
)


def test_table_holds_ranges_as_lower_end_and_width():
    table = FULL.encode(number_of_thrusters=12)
    for index, expected in (
        (layout.PROBABILITY, [0.9]),
        (layout.COUNT_LOW, [1, 2]),
        (layout.ONSET_LOW, [10, 90]),
        (layout.ONSET_GRID, [5]),
        (layout.DURATION_LOW, [5, 45]),
        (layout.PROFILE_TIME_LOW, [2, 6]),
        (layout.DWELL_LOW, [0.25, 0.5]),
        (layout.SHARED, [1]),
        (layout.NUMBER_OF_CHOICES, [3]),
        (layout.FIRST_CHOICE, [1, 4, 11]),
    ):
        np.testing.assert_array_equal(table[index : index + len(expected)], expected)
    loss = KINDS.index("loss")
    assert table[layout.SEVERITY_LOW + loss] == 0.2
    assert table[layout.SEVERITY_WIDTH + loss] == pytest.approx(0.2)
    assert table.size == layout.FIRST_CHOICE + 3


def test_table_holds_weights_as_cumulative_shares_that_end_at_one():
    table = FULL.encode()
    np.testing.assert_array_equal(
        table[layout.KIND_CUMULATIVE : layout.SEVERITY_LOW], [0.25, 0.25] + [1] * (len(KINDS) - 2)
    )
    np.testing.assert_array_equal(
        table[layout.PROFILE_CUMULATIVE : layout.SENSOR_PROBABILITY], [0.5, 1, 1, 1]
    )


def test_kind_without_weight_is_never_the_first_above_a_draw():
    table = FaultDistribution(kinds={"leak": 1.0, "loss": 1.0, "misalignment": 1.0}).encode()
    cumulative = table[layout.KIND_CUMULATIVE : layout.SEVERITY_LOW]
    for uniform in np.concatenate([np.linspace(0.0, 1.0, 1000, endpoint=False), [np.nextafter(1.0, 0.0)]]):
        assert KINDS[int(np.argmax(uniform < cumulative))] in ("leak", "loss", "misalignment")


def test_faults_that_stay_have_an_infinite_duration_of_no_width():
    table = FaultDistribution().encode()
    assert (table[layout.DURATION_LOW], table[layout.DURATION_WIDTH]) == (math.inf, 0.0)
    assert np.isfinite(np.delete(table, layout.DURATION_LOW)).all()


def test_kinds_that_are_listed_are_equally_likely():
    assert FaultDistribution(kinds=["loss", "leak"]).kind_weights() == {"loss": 1.0, "leak": 1.0}
    assert set(FaultDistribution().kind_weights()) == set(GENERAL_KINDS)


@pytest.mark.parametrize("distribution", [FaultDistribution(), FULL])
def test_distributions_survive_json_pickle_and_copies(distribution):
    for again in (
        as_faults(json.loads(json.dumps(dataclasses.asdict(distribution)))),
        pickle.loads(pickle.dumps(distribution)),
        copy.deepcopy(distribution),
        dataclasses.replace(distribution),
    ):
        assert again == distribution
        assert hash(again) == hash(distribution)
        np.testing.assert_array_equal(again.encode(), distribution.encode())


BAD = {
    "probability above 1": ({"probability": 1.1}, "probability is 1.1; a number from 0 to 1 would be right"),
    "no kinds": ({"kinds": ()}, "at least one kind with a weight above 0 would be right"),
    "no weight": ({"kinds": {"loss": 0.0}}, "at least one kind with a weight above 0"),
    "unknown kind": ({"kinds": ("los",)}, "kind 'los' is unknown; did you mean 'loss'?"),
    "kind twice": ({"kinds": ("loss", "loss")}, "each kind once would be right"),
    "negative weight": ({"kinds": {"loss": -1.0}}, "weight of the kind 'loss' is -1.0; a finite number"),
    "count from 0": ({"count": (0, 1)}, "count is (0, 1); a range of numbers from 1"),
    "count backwards": ({"count": (3, 1)}, "count is (3, 1); a range of numbers from 1"),
    "onset backwards": ({"onset": (5.0, 1.0)}, "onset is (5.0, 1.0); a finite range within 0 to inf"),
    "onset open-ended": ({"onset": (0.0, math.inf)}, "onset is (0.0, inf); a finite range"),
    "duration half open": ({"duration": (1.0, math.inf)}, "duration is (1.0, inf); a finite range"),
    "duration of nothing": ({"duration": (0.0, 1.0)}, "duration is (0.0, 1.0); a range above 0 s"),
    "severity beyond its kind": (
        {"severity": {"loss": (0.5, 1.5)}},
        "severity of a 'loss' fault is 1.5; a share from 0 to 1",
    ),
    "severity backwards": (
        {"severity": {"loss": (0.5, 0.1)}},
        "severity of 'loss' is (0.5, 0.1); a finite range",
    ),
    "severity of no kind": (
        {"severity": {"lossy": (0, 1)}},
        "kind 'lossy' is unknown; did you mean 'loss'?",
    ),
    "no profiles": ({"profiles": ()}, "profiles is (); at least one profile"),
    "unknown profile": ({"profiles": ("sin",)}, "profile 'sin' is unknown; did you mean 'sine'?"),
    "ramp of no time": (
        {"kinds": ("loss",), "profiles": ("ramp",), "profile_time": (0.0, 1.0)},
        "profile_time is (0.0, 1.0); a range above 0 s",
    ),
    "dwell of 0": ({"dwell": (0.0, 0.5)}, "dwell is (0.0, 0.5); a range above 0"),
    "dwell above 1": ({"dwell": (0.5, 2.0)}, "dwell is (0.5, 2.0); a finite range within 0 to 1"),
    "thruster 0": ({"thrusters": (0, 1)}, "thrusters is (0, 1); a list of numbers from 1, or None,"),
    "no thrusters": ({"thrusters": ()}, "thrusters is (); a list of numbers from 1"),
    "thruster twice": ({"thrusters": (1, 1)}, "thrusters is (1, 1); each number once"),
    "weights without a finite sum": ({"kinds": {"loss": 1e308, "leak": 1e308}}, "weights with a finite sum"),
    "over when it begins": (
        {"onset": (0.0, 1e16), "duration": (1.0, 2.0)},
        "duration must be at least 2 s with an onset of 1e+16 s, got 1 s",
    ),
    "wave of no length": (
        {"profiles": ("sine",), "profile_time": (1e-300, 1.0)},
        "profile_time must be at least 1e-06 s, got 1e-300 s",
    ),
    "grid finer than numbers": (
        {"onset": (0.0, 100.0), "onset_grid": 1e-300},
        "onset_grid must be 0, or at least 1e-13 s with this onset, got 1e-300 s",
    ),
    "thruster of 401 digits": (
        {"thrusters": (10**400,)},
        "thrusters, entry 1 must be a whole number of 64 bits, got 1000",
    ),
    "count of 401 digits": ({"count": (1, 10**400)}, "count, entry 2 must be a whole number of 64 bits"),
    "weight beyond floats": ({"kinds": {"loss": 10**400}}, "kinds, 'loss' must be within +/-1.8e+308"),
    "kinds as text": ({"kinds": "loss"}, "kinds is 'loss'; a list would be right"),
    "sensor probability above 1": (
        {"sensor_probability": 1.1},
        "sensor_probability is 1.1; a number from 0 to 1",
    ),
    "no sensor": ({"sensors": ("gyro",)}, "sensor 'gyro' is unknown; known are position, velocity"),
    "no sensors": ({"sensors": ()}, "sensors is (); at least one sensor, or None,"),
    "sensor twice": ({"sensors": ("rate", "rate")}, "sensors is ('rate', 'rate'); each sensor once"),
    "kind of a thruster": (
        {"sensor_kinds": ("leak",)},
        "kind 'leak' is a fault of an actuator; of a sensor it must be one of bias, drift",
    ),
    "kind of a sensor": (
        {"kinds": ("freeze",)},
        "kind 'freeze' is a fault of a sensor; of an actuator it must be one of stuck_off",
    ),
    "fourth axis": (
        {"sensor_axes": (1, 4)},
        "sensor_axes must be numbers from 0 to 3, each once, got (1, 4)",
    ),
    "sensor beyond reach": (
        {"sensor_severity": {"attitude": {"bias": (0.0, 4.0)}}},
        "severity of a 'bias' fault of the attitude sensor must be from -3.142 to 3.142 rad, got 4.0",
    ),
    "severity of no sensor": (
        {"sensor_severity": {"rte": {}}},
        "sensor 'rte' is unknown; did you mean 'rate'?",
    ),
    "sensor count from 0": ({"sensor_count": (0, 1)}, "sensor_count is (0, 1); a range of numbers from 1"),
    "negative grid": ({"onset_grid": -1.0}, "onset_grid is -1.0; a finite number of s, zero or more"),
}


@pytest.mark.parametrize(("changes", "message"), BAD.values(), ids=BAD.keys())
def test_impossible_distributions_are_refused_in_one_clear_line(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        FaultDistribution(**changes)
    assert "\n" not in str(refusal.value)


def test_what_may_fail_is_checked_against_the_vehicle():
    with pytest.raises(ValueError, match="thrusters: one of them is 5; a number from 1 to 4 would be right"):
        FULL.encode(number_of_thrusters=4)
    with pytest.raises(ValueError, match="at most 3, the thrusters that may fail"):
        FaultDistribution(count=(1, 4), thrusters=(1, 2, 3)).encode(number_of_thrusters=12)
    assert FaultDistribution(count=(1, 4), thrusters=(1, 2, 3)).encode(12, number_of_craft=2).size > 0


def test_everything_a_user_may_pass():
    fault = Fault(1, "loss", severity=0.5)
    mapping = {"thruster": 1, "kind": "loss", "severity": 0.5}
    assert as_faults(None) == ()
    assert as_faults([]) == ()
    assert as_faults(fault) == as_faults(mapping) == as_faults([mapping]) == as_faults((fault,)) == (fault,)
    assert as_faults([fault, {"thruster": 2, "kind": "leak"}]) == (fault, Fault(2, "leak"))
    assert as_faults(FULL) is FULL
    assert as_faults({"probability": 0.5}) == FaultDistribution()
    assert as_faults({"kinds": ["loss"]}) == FaultDistribution(kinds=("loss",))
    assert as_faults({"actuator": 1, "kind": "loss", "severity": 0.5}) == (fault,)
    noise = {"sensor": "rate", "axis": 2, "kind": "bias", "severity": -0.01}
    assert as_faults([noise, mapping]) == (Fault(sensor="rate", axis=2, kind="bias", severity=-0.01), fault)
    assert as_faults({"sensor_probability": 0.5}) == FaultDistribution(sensor_probability=0.5)


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("stuck_off", "faults is 'stuck_off'; a Fault, a FaultDistribution"),
        ("x" * 10**6, f"faults is '{'x' * 76}...; a Fault, a FaultDistribution"),
        (["x" * 10**6], f"faults, entry 1: '{'x' * 76}... is not a mapping of the fields of Fault"),
        ({"x" * 10**6: 1}, "...; a mapping with 'thruster' and 'kind'"),
        ([[Fault(1, "loss")]], "faults, entry 1: [Fault(thruster=1, kind='loss', severity=1.0, "),
        (b"loss", "faults is b'loss'; a Fault, a FaultDistribution"),
        (3, "faults is 3; a Fault, a FaultDistribution"),
        ({}, "a mapping with 'thruster' and 'kind', or one with 'probability', would be right"),
        ({"thruster": 1}, "faults: the key 'kind' is missing"),
        ({"sensor": "rate"}, "faults: the key 'kind' is missing"),
        ({"kind": "loss"}, "faults: a fault must have a thruster or a sensor, got neither"),
        (
            {"thruster": 1, "actuator": 1, "kind": "loss"},
            "faults: 'thruster' and 'actuator' are two names of one number; give one",
        ),
        (
            {"thruster": 1, "kind": "loss", "sevrity": 1},
            "faults: unknown key 'sevrity'; did you mean 'severity'?",
        ),
        ({"probability": 1, "kind": ["loss"]}, "faults: unknown key 'probability'"),
        ([Fault(1, "loss"), 3], "faults, entry 2: 3 is not a mapping of the fields of Fault"),
        ([Fault(1, "loss"), {"thruster": 0, "kind": "loss"}], "faults, entry 2: thruster is 0"),
        (
            [FaultDistribution()],
            "faults, entry 1 is a FaultDistribution; a Fault, or the distribution by itself",
        ),
    ],
)
def test_anything_else_is_refused(argument, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        as_faults(argument)
