"""SPHERES: the pair mixer's matrix, and the catalogue as a whole."""

import dataclasses

import numpy as np
import pytest

from thruster_envs.spacecraft import catalogue, load
from thruster_envs.spacecraft.description import EARTH_MU

PAIR_COLUMNS = np.array(  # jets 1 to 6 of the mixer: signs of force x, y, z and torque x, y, z
    [
        [1, 1, 0, 0, 0, 0],
        [0, 0, 1, 1, 0, 0],
        [0, 0, 0, 0, 1, 1],
        [0, 0, 0, 0, 1, -1],
        [1, -1, 0, 0, 0, 0],
        [0, 0, 1, -1, 0, 0],
    ]
)


def test_effectiveness_is_the_pair_mixers_matrix():
    spheres = load("spheres")
    scale = np.array([0.0243] * 3 + [0.4804] * 3)[:, np.newaxis]
    expected = np.hstack([PAIR_COLUMNS, -PAIR_COLUMNS]) * scale
    np.testing.assert_array_equal(np.round(spheres.effectiveness(), 4) + 0.0, expected)


def test_pair_mixer_forces_reproduce_any_wanted_wrench():
    spheres = load("spheres")
    wanted = np.array([0.03, -0.05, 0.02, 0.004, -0.003, 0.001])
    (force_x, force_y, force_z, torque_x, torque_y, torque_z), arm = wanted, 0.0965
    pairs = np.array(
        [
            force_x / 2 + torque_y / (2 * arm),
            force_x / 2 - torque_y / (2 * arm),
            force_y / 2 + torque_z / (2 * arm),
            force_y / 2 - torque_z / (2 * arm),
            force_z / 2 + torque_x / (2 * arm),
            force_z / 2 - torque_x / (2 * arm),
        ]
    )
    duties = np.concatenate([np.maximum(pairs, 0.0), np.maximum(-pairs, 0.0)]) / 0.112
    np.testing.assert_allclose(spheres.wrenches() @ duties, wanted, atol=1e-15)


@pytest.mark.parametrize("thruster", range(12))
def test_no_loss_of_a_thruster_is_tolerated(thruster):
    """Every thruster is one of only two for its force and for its torque, in both signs."""
    matrix = load("spheres").effectiveness()
    without = np.delete(matrix, thruster, axis=1)
    weakened = [
        axis
        for axis in range(6)
        if np.maximum(without[axis] * np.sign(matrix[axis, thruster]), 0).sum()
        < 0.51 * np.maximum(matrix[axis] * np.sign(matrix[axis, thruster]), 0).sum()
    ]
    assert len(weakened) == 2


def test_pulses_and_period():
    spheres = load("spheres")
    assert spheres.control_period == 1.0
    assert {thruster.minimum_pulse for thruster in spheres.thrusters} == {0.010}


def test_plumes_leave_the_body():
    for thruster in load("spheres").thrusters:
        assert np.dot(thruster.position, thruster.direction) < 0


@pytest.mark.parametrize("name", catalogue())
def test_every_vehicle_of_the_catalogue_can_push_and_turn_every_way_that_it_is_made_for(name):
    spacecraft = load(name)
    matrix = spacecraft.effectiveness()
    assert spacecraft.name == name
    if name == "atmos_like":  # planar: x, y and the turn about z
        assert np.linalg.matrix_rank(matrix[[0, 1, 5]]) == np.linalg.matrix_rank(matrix) == 3
    else:
        assert np.linalg.matrix_rank(matrix[3:]) == 3
    if name not in ("atmos_like", "ppt_cubesat"):  # the second: three pairs, made to turn
        assert np.linalg.matrix_rank(matrix) == 6
    np.testing.assert_allclose(matrix.sum(axis=1), 0.0, atol=1e-15)  # a positive null vector: both signs


@pytest.mark.parametrize("name", catalogue())
def test_every_value_of_the_catalogue_has_a_provenance(name):
    spacecraft = load(name)
    missing, plain = [], dataclasses.replace(spacecraft.sensors, distribution="normal")
    unused = {"sensors.distribution"} if spacecraft.sensors == plain else set()
    for field, value in spacecraft.to_dict().items():
        if field in ("name", "provenance") or value in (None, False, (), EARTH_MU):
            continue
        if field == "thrusters":
            left_out = ["name"]
            left_out += ["capacitor"] if spacecraft.discharge is None else []
            left_out += ["time_constant"] if spacecraft.modulator is None else []
            dotted = [f"thrusters.{key}" for key in value[0] if key not in left_out]
        elif isinstance(value, dict):
            dotted = [f"{field}.{key}" for key in value]
        else:
            dotted = [field]
        missing += [one for one in dotted if one not in {*spacecraft.provenance, *unused}]
    assert missing == []
    for mark in spacecraft.provenance.values():
        assert mark.split(":")[0].split(" ")[0] in (
            "stated",
            "reconstructed",
            "external",
            "assumed",
            "proposed",
        )
