"""What a spacecraft can be, what it cannot, and that geometry gives the matrix."""

import copy
import dataclasses
import json
import pickle
import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given

from tests.spacecraft.strategies import DIRECTIONS, spacecraft
from thruster_envs.spacecraft import (
    Feed,
    Sensors,
    Spacecraft,
    Thruster,
    catalogue,
    load,
    objective_weights,
    save,
)

THRUSTER = {"name": "a", "position": [0.0, 0.5, 0.0], "direction": [1.0, 0.0, 0.0], "thrust": 2.0}
CRAFT = {
    "name": "box",
    "mass": 4.0,
    "inertia": [[3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0]],
    "thrusters": [THRUSTER],
}
DIAGONAL = CRAFT["inertia"]


DISCHARGE = dataclasses.asdict(load("ppt_cubesat").discharge)
CIRCLE: list[object] = []
CIRCLE.append(CIRCLE)


def deep(levels):
    """A list in a list in a list."""
    nested = []
    for _ in range(levels):
        nested = [nested]
    return nested


def with_thruster(**changes):
    return {**CRAFT, "thrusters": [{**THRUSTER, **changes}]}


def test_one_thruster_off_the_centre_pushes_and_turns():
    matrix = load(CRAFT).effectiveness()
    # 2 N along x at y = 0.5 m: 2/4 m/s^2 along x; torque r x F = -1 N m about z, over 4 kg m^2
    np.testing.assert_array_equal(matrix[:, 0], [0.5, 0.0, 0.0, 0.0, 0.0, -0.25])


def test_products_of_inertia_couple_the_axes():
    inertia = [[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]]
    rates = load({**CRAFT, "inertia": inertia}).effectiveness()[3:, 0]
    np.testing.assert_allclose(np.array(inertia) @ rates, [0.0, 0.0, -1.0], atol=1e-15)
    assert rates[0] == pytest.approx(1.0 / 3.0)


@given(spacecraft())
def test_momentum_given_per_second_is_force_and_torque(craft):
    matrix, wrenches = craft.effectiveness(), craft.wrenches()
    np.testing.assert_allclose(matrix[:3] * craft.mass, wrenches[:3], rtol=1e-14, atol=1e-300)
    torque = np.array(craft.inertia) @ matrix[3:]
    scale = np.abs(wrenches).max() * np.linalg.cond(np.array(craft.inertia))
    np.testing.assert_allclose(torque, wrenches[3:], atol=1e-14 * scale + 1e-300)


@given(spacecraft())
def test_authority_bounds_every_axis_and_is_reached(craft):
    matrix, period = craft.effectiveness(), craft.control_period
    for axis, authority in enumerate(craft.authority()):
        forward = matrix[axis] @ np.where(matrix[axis] > 0, period, 0.0)
        backward = matrix[axis] @ np.where(matrix[axis] < 0, period, 0.0)
        assert authority == pytest.approx(max(forward, -backward), rel=1e-12)


@given(DIRECTIONS)
def test_directions_become_unit_vectors_and_stay_what_they_are(direction):
    once = Thruster(**{**THRUSTER, "direction": direction}).direction
    assert np.linalg.norm(once) == pytest.approx(1.0, abs=1e-15)
    assert Thruster(**{**THRUSTER, "direction": once}).direction == once
    np.testing.assert_allclose(np.cross(once, np.array(direction) / np.abs(direction).max()), 0.0, atol=1e-15)


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e200, 1.7e308])
def test_directions_of_any_length_are_normalised(length):
    assert Thruster(**{**THRUSTER, "direction": (0.0, length, 0.0)}).direction == (0.0, 1.0, 0.0)


@given(spacecraft())
def test_descriptions_survive_json(craft):
    again = Spacecraft.from_dict(json.loads(json.dumps(craft.to_dict())))
    assert again == craft
    assert hash(again) == hash(craft)
    assert Spacecraft.from_dict(json.loads(json.dumps(dataclasses.asdict(craft)))) == craft


def test_lists_arrays_and_numpy_numbers_are_as_good_as_tuples():
    loose = Spacecraft(
        name="box",
        mass=np.float64(4.0),
        inertia=np.array(DIAGONAL),
        thrusters=[Thruster(**{**THRUSTER, "position": np.array([0.0, 0.5, 0.0])})],
    )
    assert loose == load(CRAFT)
    assert type(loose.mass) is float
    assert hash(loose) == hash(load(CRAFT))


def test_vehicle_that_lacks_a_value_gets_a_neutral_one():
    craft = load(CRAFT)
    thruster = craft.thrusters[0]
    assert craft.feed == Feed(coupling=0.0, propellant_mass=np.inf)
    assert craft.sensors == Sensors(position=0.0, velocity=0.0, attitude=0.0, rate=0.0)
    assert thruster.minimum_pulse == thruster.opening_delay == thruster.closing_delay == 0.0
    assert thruster.rise_time == thruster.fall_time == thruster.scatter == 0.0
    assert thruster.specific_impulse == np.inf


def test_descriptions_are_frozen_and_changed_by_replacement():
    craft = load(CRAFT)
    with pytest.raises(dataclasses.FrozenInstanceError):
        craft.mass = 5.0
    assert craft.replace(mass=8, control_period=1).mass == 8.0
    assert craft.replace(feed={"coupling": 0.1}).feed.coupling == 0.1
    assert craft.mass == 4.0


def rotated(first, second, third):
    """An inertia of these principal moments about other axes than those of the body."""
    axes = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [-1.0, 1.0, 0.3], [0.2, -0.4, 1.0]]))[0]
    matrix = axes @ np.diag([first, second, third]) @ axes.T
    return ((matrix + matrix.T) / 2.0).tolist()


@pytest.mark.parametrize(
    "moments", [(1.0, 1.0, 2.0), (1e-3, 1e-3, 1e-3), (1e-9, 1.0, 1.0), (0.1, 0.2, 0.3), (3e9, 4e9, 7e9)]
)
def test_bodies_as_thin_as_a_plate_or_a_rod_are_accepted(moments):
    for inertia in (np.diag(moments).tolist(), rotated(*moments)):
        assert np.isfinite(load({**CRAFT, "inertia": inertia}).effectiveness()).all()


@pytest.mark.parametrize("moments", [(1.0, 1.0, 2.001), (1.0, 2.0, 4.0), (1e-3, 1e-3, 3e-3), (1.0, 1e6, 2e6)])
def test_moments_that_break_the_triangle_inequality_are_refused(moments):
    for inertia in (np.diag(moments).tolist(), np.diag(moments[::-1]).tolist(), rotated(*moments)):
        with pytest.raises(ValueError, match="must be that of a body, each principal moment at most the sum"):
            load({**CRAFT, "inertia": inertia})
    with pytest.raises(ValueError, match=re.escape("got 1, 2 and 4 kg m^2")):
        load("orion").replace(inertia=np.diag([4.0, 1.0, 2.0]))


def test_an_inertia_as_a_source_prints_it_is_taken_where_the_description_says_so(tmp_path):
    printed = np.diag([1.0, 2.0, 4.0])
    with pytest.raises(ValueError, match="unphysical_inertia = true takes it as it is"):
        load("orion").replace(inertia=printed)
    craft = load("orion").replace(inertia=printed, unphysical_inertia=True)
    save(craft, tmp_path / "printed.toml")
    assert load(tmp_path / "printed.toml") == craft
    np.testing.assert_allclose(printed @ craft.effectiveness()[3:], craft.wrenches()[3:], rtol=1e-14)
    with pytest.raises(ValueError, match="not positive definite"):
        craft.replace(inertia=np.diag([1.0, -2.0, 4.0]))


@pytest.mark.parametrize("name", catalogue())
def test_pickles_and_copies_are_equal_and_vehicles_are_keys(name):
    craft = load(name)
    for again in (pickle.loads(pickle.dumps(craft)), copy.deepcopy(craft), copy.copy(craft)):
        assert again == craft
        assert hash(again) == hash(craft)
    assert {craft: 1}[load(name)] == 1
    assert repr(craft).startswith(f"Spacecraft(name={name!r}, mass=")


BAD = {
    "negative mass": ({**CRAFT, "mass": -4.0}, "mass is -4.0; a positive number of kg would be right"),
    "infinite mass": ({**CRAFT, "mass": np.inf}, "mass is inf; a positive number of kg"),
    "NaN mass": ({**CRAFT, "mass": np.nan}, "mass is NaN; a number would be right"),
    "mass as text": ({**CRAFT, "mass": "4 kg"}, "mass is '4 kg'; a number would be right"),
    "mass as truth": ({**CRAFT, "mass": True}, "mass is True; a number would be right"),
    "inertia not positive definite": (
        {**CRAFT, "inertia": [[1, 0, 0], [0, -2, 0], [0, 0, 4]]},
        "not positive definite: its smallest principal moment is -2 kg m^2",
    ),
    "inertia singular": ({**CRAFT, "inertia": [[1, 0, 0], [0, 0, 0], [0, 0, 4]]}, "not positive definite"),
    "inertia not symmetric": ({**CRAFT, "inertia": [[1, 0.1, 0], [0, 2, 0], [0, 0, 4]]}, "is not symmetric"),
    "inertia infinite": ({**CRAFT, "inertia": [[np.inf, 0, 0], [0, 2, 0], [0, 0, 4]]}, "nine finite numbers"),
    "inertia of zeros": ({**CRAFT, "inertia": [[0, 0, 0]] * 3}, "positive principal moments, got nine zeros"),
    "inertia all but singular": (
        {**CRAFT, "inertia": [[1, 0, 0], [0, 1e-14, 0], [0, 0, 1]]},
        "not positive definite: its smallest principal moment is 1e-14 kg m^2",
    ),
    "inertia tiny": (
        {**CRAFT, "inertia": (np.eye(3) * 1e-300).tolist()},
        "inertia: its largest entry must be from 1e-15 to 1e+15 kg m^2, got 1e-300",
    ),
    "mass beyond floats": (
        {**CRAFT, "mass": 10**400},
        f"mass must be within +/-1.8e+308, got 1{'0' * 76}...",
    ),
    "mass of 5000 digits": ({**CRAFT, "mass": 10**5000}, "got <int of 16610 bits>"),
    "mass of a star": ({**CRAFT, "mass": 2e30}, "mass must be from 1e-15 to 1e+15 kg, got 2e+30"),
    "mass as an exact number": ({**CRAFT, "mass": Decimal(4)}, "mass is Decimal('4'); a number"),
    "mass as a share": ({**CRAFT, "mass": Fraction(4)}, "mass is Fraction(4, 1); a number"),
    "mass as a complex number": ({**CRAFT, "mass": 4 + 0j}, "mass is (4+0j); a number would be right"),
    "mass as an array": ({**CRAFT, "mass": np.array([4.0])}, "mass is array([4.]); a number would be right"),
    "mass as a time": ({**CRAFT, "mass": np.timedelta64(4, "s")}, "; a number would be right"),
    "inertia of complex numbers": ({**CRAFT, "inertia": np.eye(3) * 1j}, "inertia, entry 1, entry 1 is 1j"),
    "inertia of objects": ({**CRAFT, "inertia": np.full((3, 3), None)}, "entry 1 is None; a number"),
    "inertia of three axes": (
        {**CRAFT, "inertia": np.ones((3, 3, 3))},
        "entry 1 is [1.0, 1.0, 1.0]; a number",
    ),
    "inertia of no axis": ({**CRAFT, "inertia": np.array(3.0)}, "inertia is 3.0; a list would be right"),
    "inertia that holds itself": ({**CRAFT, "inertia": CIRCLE}, "inertia has 1 entries; 3 would be right"),
    "inertia nested deep": ({**CRAFT, "inertia": deep(100_000)}, "inertia has 1 entries; 3 would be right"),
    "mass nested deep": (
        {**CRAFT, "mass": deep(100_000)},
        "mass is <list that cannot be printed>; a number would be right",
    ),
    "position of bytes": (with_thruster(position=b"abc"), "position is b'abc'; a list would be right"),
    "position of more bytes": (with_thruster(position=bytearray(3)), "position is bytearray("),
    "huge position": (
        with_thruster(position=[0, 1e200, 0]),
        "position must be from -1e+15 to 1e+15 m, got 1e+200",
    ),
    "tiny thrust": (with_thruster(thrust=5e-324), "thrust must be from 1e-15 to 1e+15 N, got 5e-324"),
    "long lag": (
        with_thruster(time_constant=1e5),
        "thruster 'a': time_constant must be from 0 to 10000 s, got 100000.0",
    ),
    "capacitor beyond 64 bits": (
        with_thruster(capacitor=10**30),
        f"capacitor must be a whole number of 64 bits, got {10**30}",
    ),
    "name of a book": (with_thruster(name="x" * 10**6, thrust=0), f"thruster '{'x' * 76}...: thrust is 0.0"),
    "key of a book": ({**CRAFT, "k" * 10**6: 1}, f"unknown key '{'k' * 76}...; known are name, mass"),
    "key of 5000 digits": ({**CRAFT, 10**5000: 1}, "unknown key <int of 16610 bits>; known are name, mass"),
    "orbit of a second": (
        {**CRAFT, "mean_motion": 6.3},
        "mean_motion must be from 1e-15 to 1 rad/s, got 6.3",
    ),
    "no orbit": ({**CRAFT, "mean_motion": 1e-300}, "mean_motion must be from 1e-15 to 1 rad/s, got 1e-300"),
    "delay of an age": (
        {**CRAFT, "modulator": {"delay": 1e9}},
        "the delay of a pulse's end must be at most 1000 control periods, 5000 s, got 1e+09 s",
    ),
    "discharge of a million samples": (
        {**CRAFT, "discharge": {**DISCHARGE, "duration": 1.0}},
        "discharge: duration must be at most 1,000,000 times the sample_time, got 1e+08",
    ),
    "discharge of ever": (
        {**CRAFT, "discharge": {**DISCHARGE, "duration": 1e308, "sample_time": 1e-10}},
        "discharge: duration must be from 1e-15 to 1e+15 s, got 1e+308",
    ),
    "inertia too short": (
        {**CRAFT, "inertia": [[1, 0, 0], [0, 2, 0]]},
        "inertia has 2 entries; 3 would be right",
    ),
    "inertia row too long": (
        {**CRAFT, "inertia": [[1, 0, 0, 0], [0, 2, 0], [0, 0, 4]]},
        "inertia, entry 1 has 4 entries; 3 would be right",
    ),
    "no thrusters": ({**CRAFT, "thrusters": []}, "thrusters is (); at least one thruster would be right"),
    "thrusters not a list": ({**CRAFT, "thrusters": "many"}, "thrusters is 'many'; a list would be right"),
    "thruster not a table": ({**CRAFT, "thrusters": [3]}, "thrusters, entry 1: 3 is not a mapping"),
    "two thrusters of one name": (
        {**CRAFT, "thrusters": [THRUSTER, {**THRUSTER, "name": "b"}, THRUSTER]},
        "thrusters 1 and 3 are both named 'a'",
    ),
    "unknown key": ({**CRAFT, "intertia": 1}, "unknown key 'intertia'; did you mean 'inertia'?"),
    "unknown key of a thruster": (
        with_thruster(thurst=1.0),
        "thrusters, entry 1: unknown key 'thurst'; did you mean 'thrust'?",
    ),
    "unknown key of the feed": (
        {**CRAFT, "feed": {"q": 1}},
        "feed: unknown key 'q'; known are coupling, propellant_mass",
    ),
    "missing key": ({"name": "box"}, "the key 'mass' is missing"),
    "missing key of a thruster": (
        {**CRAFT, "thrusters": [{"name": "a"}]},
        "entry 1: the key 'position' is missing",
    ),
    "zero direction": (
        with_thruster(direction=[0, 0, 0]),
        "direction is (0.0, 0.0, 0.0); a finite vector that is not zero",
    ),
    "infinite direction": (with_thruster(direction=[np.inf, 0, 0]), "a finite vector that is not zero"),
    "NaN direction": (with_thruster(direction=[np.nan, 0, 1]), "direction, entry 1 is NaN"),
    "short position": (with_thruster(position=[0, 1]), "position has 2 entries; 3 would be right"),
    "infinite position": (with_thruster(position=[0, 1, np.inf]), "three finite numbers of m would be right"),
    "zero thrust": (
        with_thruster(thrust=0.0),
        "thruster 'a': thrust is 0.0; a positive number of N would be right",
    ),
    "negative delay": (
        with_thruster(opening_delay=-1.0),
        "opening_delay is -1.0; a finite number of s, zero or more",
    ),
    "infinite rise": (with_thruster(rise_time=np.inf), "rise_time is inf; a finite number of s"),
    "scatter of one": (
        with_thruster(scatter=1.0),
        "scatter is 1.0; a share of the thrust, at least 0 and below 1",
    ),
    "zero specific impulse": (
        with_thruster(specific_impulse=0.0),
        "specific_impulse is 0.0; a positive number of s",
    ),
    "coupling above one": ({**CRAFT, "feed": {"coupling": 1.5}}, "feed: coupling is 1.5; a share"),
    "negative propellant": (
        {**CRAFT, "feed": {"propellant_mass": -1}},
        "propellant_mass is -1.0; zero or more kg",
    ),
    "all propellant": (
        {**CRAFT, "feed": {"propellant_mass": 4}},
        "propellant_mass is 4.0; less than the mass, 4.0 kg",
    ),
    "endless propellant": (with_thruster(specific_impulse=70.0), "so that the mass would fall below zero"),
    "negative noise": (
        {**CRAFT, "sensors": {"rate": -1.0}},
        "sensors: rate is -1.0; a finite number, zero or more",
    ),
    "zero period": ({**CRAFT, "control_period": 0}, "control_period is 0.0; a positive number of s"),
    "zero mean motion": ({**CRAFT, "mean_motion": 0}, "mean_motion is 0.0; a positive number of rad/s"),
    "provenance not text": (
        {**CRAFT, "provenance": {"mass": 3}},
        "provenance, 'mass' is 3; a value of type str",
    ),
    "name not text": ({**CRAFT, "name": 3}, "name is 3; a value of type str would be right"),
}


@pytest.mark.parametrize(("mapping", "message"), BAD.values(), ids=BAD.keys())
def test_impossible_spacecraft_are_refused_in_one_clear_line(mapping, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        load(mapping)
    text = str(refusal.value)
    assert text.startswith("spacecraft: ")
    assert "\n" not in text


def test_impossible_changes_are_refused():
    craft = load(CRAFT)
    with pytest.raises(ValueError, match="unknown key 'weight'"):
        craft.replace(weight=3.0)
    with pytest.raises(ValueError, match=r"mass is 0\.0"):
        craft.effectiveness(mass=0.0)
    with pytest.raises(ValueError, match=r"period is -1\.0"):
        craft.authority(period=-1.0)


def test_axis_without_authority_is_weighed_like_the_dearest_other():
    fuel_cost, slack_cost = objective_weights([[2.0, -1.0], [0.0, 0.0], [0.5, 0.5]], period=10.0)
    np.testing.assert_array_equal(fuel_cost, [1.0, 1.0])
    # 20 * (2 thrusters * 10 s) over 20, and over 10; the middle axis as the dearest
    np.testing.assert_allclose(slack_cost, [20.0, 40.0, 40.0])


@pytest.mark.parametrize(
    ("matrix", "period", "message"),
    [
        (np.zeros((6, 2)), 1.0, "zero throughout"),
        (np.zeros(6), 1.0, r"shape \(6,\); \(axes, thrusters\)"),
        ([[1.0, np.nan]], 1.0, r"effectiveness\[0, 1\] is nan"),
        ([[1.0]], 0.0, r"period is 0\.0"),
    ],
)
def test_objectives_of_impossible_matrices_are_refused(matrix, period, message):
    with pytest.raises(ValueError, match=message):
        objective_weights(matrix, period)
