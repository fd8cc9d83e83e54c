"""The PPT cubesat: torques of its thrusters, its pairs, and what a discharge can be."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

from thruster_envs.spacecraft import Discharge, Spacecraft, Thruster, load, save

CUBESAT = load("ppt_cubesat")


def test_each_pair_turns_about_its_own_axis_with_five_micronewton_metres():
    """Valdes 2008, eq. 3.36: 100 uN on an arm of 5 cm."""
    expected = 5e-6 * np.array([[1, -1, 0, 0, 0, 0], [0, 0, 1, -1, 0, 0], [0, 0, 0, 0, 1, -1]])
    np.testing.assert_allclose(CUBESAT.wrenches()[3:], expected, atol=1e-20)


def test_the_two_thrusters_of_a_pair_share_a_capacitor():
    assert [thruster.capacitor for thruster in CUBESAT.thrusters] == [1, 1, 2, 2, 3, 3]


def test_a_pulse_has_3001_samples_and_seven_joules():
    discharge = CUBESAT.discharge
    assert discharge.number_of_samples == 3001
    assert 0.5 * discharge.capacitance * discharge.voltage**2 == pytest.approx(7.04, abs=0.005)


def test_the_orbit_is_600_km_high():
    radius = (3.986004418e14 / CUBESAT.mean_motion**2) ** (1 / 3)
    assert radius == pytest.approx(6378137.0 + 600e3, rel=1e-12)


def test_a_discharge_survives_files_and_json(tmp_path):
    save(CUBESAT, tmp_path / "copy.toml")
    assert load(tmp_path / "copy.toml") == CUBESAT
    again = Spacecraft.from_dict(json.loads(json.dumps(CUBESAT.to_dict())))
    assert again == CUBESAT
    assert isinstance(again.discharge, Discharge)


def test_vehicles_without_a_discharge_have_no_capacitors():
    orion = load("orion")
    assert orion.discharge is None
    assert {thruster.capacitor for thruster in orion.thrusters} == {0}


BAD = {
    "no capacitance": ({"capacitance": 0.0}, "discharge: capacitance is 0.0; a positive number of F"),
    "negative width": (
        {"electrode_width": -1.0},
        "discharge: electrode_width is -1.0; a positive number of m",
    ),
    "infinite slug": ({"slug_mass": math.inf}, "discharge: slug_mass is inf; a positive number of kg"),
    "too coarse": ({"sample_time": 5e-8}, "discharge: sample_time is 5e-08; at most 1.5e-08 s"),
    "odd end": ({"duration": 3.005e-6}, "discharge: duration is 3.005e-06; a whole number of times"),
}


@pytest.mark.parametrize(("changes", "message"), BAD.values(), ids=BAD.keys())
def test_impossible_discharges_are_refused_in_one_clear_line(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        dataclasses.replace(CUBESAT.discharge, **changes)
    assert "\n" not in str(refusal.value)


def test_a_discharge_and_capacitors_belong_together():
    with pytest.raises(
        ValueError, match="thruster '1' has the capacitor 1 while the spacecraft has no discharge"
    ):
        CUBESAT.replace(discharge=None)
    plain = tuple(dataclasses.replace(one, capacitor=0) for one in CUBESAT.thrusters)
    with pytest.raises(
        ValueError, match="thruster '1' has no capacitor while the spacecraft has a discharge"
    ):
        CUBESAT.replace(thrusters=plain)
    assert CUBESAT.replace(thrusters=plain, discharge=None).discharge is None
    with pytest.raises(ValueError, match="capacitor is -1; a number from 1, or 0 for none, would be right"):
        Thruster(name="a", position=(0, 0, 0), direction=(1, 0, 0), thrust=1.0, capacitor=-1)
    with pytest.raises(ValueError, match=r"firing_time is 0\.016; at most the control_period, 0\.01 s,"):
        CUBESAT.replace(control_period=0.01)
