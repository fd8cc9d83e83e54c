"""Faults as rows of numbers and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.faults.strategies import faults
from thruster_envs.faults import (
    FAULT_FIELDS,
    KINDS,
    PROFILES,
    SENSOR_KINDS,
    SENSORS,
    Fault,
    decode,
    encode,
    encoding,
)


def test_row_has_the_columns_in_the_stated_order():
    fault = Fault(
        7,
        "leak",
        severity=0.25,
        onset=100.0,
        duration=50.0,
        profile="sine",
        profile_time=30.0,
        dwell=0.4,
        azimuth=1.5,
        craft=2,
        shared=True,
    )
    rows = encode([fault], number_of_craft=2, number_of_thrusters=12, slots=3)
    assert rows.shape == (2, 3, len(FAULT_FIELDS))
    assert rows.dtype == np.float64
    np.testing.assert_array_equal(rows[1, 0], [4, 6, 0.25, 100.0, 150.0, 2, 30.0, 0.4, 1.5, 1, 0, 0, 0])
    assert np.count_nonzero(rows) == 10


def test_constants_are_the_places_of_the_names():
    for field, index in (
        ("kind", encoding.FIELD_KIND),
        ("end", encoding.FIELD_END),
        ("azimuth", encoding.FIELD_AZIMUTH),
        ("shared", encoding.FIELD_SHARED),
        ("branch", encoding.FIELD_BRANCH),
        ("sensor", encoding.FIELD_SENSOR),
        ("axis", encoding.FIELD_AXIS),
    ):
        assert FAULT_FIELDS[index] == field
    for kind in KINDS:
        assert KINDS[getattr(encoding, kind.upper()) - 1] == kind
    for kind in SENSOR_KINDS:
        assert SENSOR_KINDS[getattr(encoding, f"SENSOR_{kind.upper()}") - 1] == kind
    assert [SENSORS[getattr(encoding, name.upper()) - 1] for name in SENSORS] == list(SENSORS)
    assert [
        PROFILES[code] for code in (encoding.STEP, encoding.RAMP, encoding.SINE, encoding.SQUARE)
    ] == list(PROFILES)


def test_fault_that_stays_never_ends():
    assert encode([Fault(1, "loss", onset=5.0)], 1, 1, 1)[0, 0, encoding.FIELD_END] == math.inf


def test_no_faults_are_empty_slots():
    rows = encode([], 2, 12, 4)
    assert not rows.any()
    assert decode(rows) == []


def test_faults_on_one_thruster_keep_their_order():
    both = [Fault(3, "loss", severity=0.5), Fault(3, "stuck_on", severity=0.2)]
    assert decode(encode(both, 1, 12, 2)) == both


@given(st.lists(faults(), max_size=6))
def test_rows_give_the_faults_back(given_faults):
    rows = encode(given_faults, number_of_craft=3, number_of_thrusters=12, slots=6, wheels=12, gyros=12)
    back = decode(rows)
    expected = sorted(given_faults, key=lambda fault: fault.craft)  # stable: the order within a craft stays
    assert len(back) == len(expected)
    for one, other in zip(back, expected, strict=True):
        # the end is stored, so that a duration comes back to the rounding of onset + duration
        assert one.duration == pytest.approx(other.duration, abs=1e-10)
        assert dataclass_without_duration(one) == dataclass_without_duration(other)


def dataclass_without_duration(fault):
    return {name: value for name, value in vars(fault).items() if name != "duration"}


def test_rows_of_one_craft_are_enough():
    rows = encode([Fault(2, "loss", craft=2)], 2, 12, 1)
    assert decode(rows[1]) == [Fault(2, "loss")]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (Fault(13, "loss"), "fault 1 is on thruster 13; a number from 1 to 12 would be right"),
        (Fault(1, "loss", craft=2), "fault 1 is on craft 2; a number from 1 to 1 would be right"),
    ],
)
def test_fault_of_what_does_not_exist_is_refused(fault, message):
    with pytest.raises(ValueError, match=message):
        encode([fault], 1, 12, 1)


def test_more_faults_than_slots_are_refused():
    with pytest.raises(ValueError, match="fault 2 is one too many for craft 1; at most 1 would be right"):
        encode([Fault(1, "loss"), Fault(2, "loss")], 1, 12, 1)


def test_rows_that_hold_no_fault_are_refused():
    with pytest.raises(ValueError, match=r"shape \(13,\)"):
        decode(np.zeros(13))
    with pytest.raises(ValueError, match="craft 1, slot 2: kind 99 is no code; it must be from 1 to"):
        decode([[0.0] * 13, [99.0] + [0.0] * 12])
    with pytest.raises(ValueError, match="craft 1, slot 1: sensor 9 is no code; it must be from 0 to 4"):
        decode([[1.0] + [0.0] * 10 + [9.0, 0.0]])


def test_a_fault_of_a_sensor_says_which_and_which_axis():
    fault = Fault(sensor="rate", axis=2, kind="drift", severity=-1e-4, onset=5.0)
    row = encode([fault], 1, 12, 1)[0, 0]
    assert (row[encoding.FIELD_KIND], row[encoding.FIELD_THRUSTER]) == (encoding.SENSOR_DRIFT, -1)
    assert (row[encoding.FIELD_SENSOR], row[encoding.FIELD_AXIS]) == (encoding.RATE, 2)
    assert decode([row]) == [fault]


def test_the_redundant_branch_has_a_column_of_its_own():
    fault = Fault(11, "leak", severity=0.3)
    row = encode([fault], 1, 8, 1, spare=8)[0, 0]
    assert (row[encoding.FIELD_THRUSTER], row[encoding.FIELD_BRANCH]) == (2, encoding.REDUNDANT)
    assert decode([row], number_of_thrusters=8) == [fault]
    with pytest.raises(ValueError, match="on the redundant branch; number_of_thrusters must be given"):
        decode([row])
