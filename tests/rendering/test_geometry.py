"""The geometry under the picture: rotations, solids, round numbers."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from thruster_envs.rendering.layout import arrange
from thruster_envs.rendering.model import build_model, rotation_from_quaternion
from thruster_envs.rendering.ticks import round_limits, round_step, tick_label, tick_values
from thruster_envs.spacecraft import catalogue, load

THRUSTERS = load("orion").thrusters
SIDES = np.where(np.arange(len(THRUSTERS)) % 2 == 0, 1.0, -1.0)
finite = st.floats(-1e6, 1e6)


def test_a_quarter_turn_about_z_takes_the_along_track_axis_to_minus_x():
    # v_body = q v q* with q = cos 45 + k sin 45 turns vectors by +90 degrees about z: y goes to -x.
    matrix = rotation_from_quaternion(np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]))
    np.testing.assert_allclose(matrix @ [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], atol=1e-15)


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_a_quaternion_gives_a_proper_rotation(quaternion):
    matrix = rotation_from_quaternion(np.array(quaternion))
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize("name", catalogue())
def test_solids_are_convex_with_outward_normals(name):
    model = build_model(load(name))
    for solids in (model.box, model.nozzles, model.clusters):
        np.testing.assert_allclose(np.linalg.norm(solids.normals, axis=-1), 1.0)
        for corners, normals in zip(solids.corners, solids.normals, strict=True):
            for face, normal in zip(corners, normals, strict=True):
                heights = (corners.reshape(-1, 3) - face[0]) @ normal
                assert heights.max() < 1e-9 * model.size


@pytest.mark.parametrize("name", catalogue())
def test_everything_drawn_is_within_reach_and_no_thruster_inside_the_body(name):
    spacecraft = load(name)
    model = build_model(spacecraft)
    ends = model.exits + model.plume_length * model.plume_directions
    assert np.linalg.norm(ends, axis=1).max() <= model.reach
    assert np.linalg.norm(model.box.corners, axis=-1).max() <= model.reach
    half = np.abs(model.box.corners).max(axis=(0, 1, 2))
    assert (np.abs(model.positions) >= half - 1e-12).any(axis=1).all()
    forces = np.array([thruster.direction for thruster in spacecraft.thrusters])
    np.testing.assert_allclose(model.plume_directions, -forces)


def test_a_cube_with_thrusters_in_one_plane_is_drawn_as_a_cube():
    """The body is 10 cm long on each axis, and nothing fires off the plane y = 0."""
    box = np.abs(build_model(load("ppt_cubesat")).box.corners).max(axis=(0, 1, 2))
    assert box.min() > 0.9 * box.max()
    assert 0.035 < box.min() <= box.max() < 0.055
    # A uniform box of 2 by 4 by 6: I = m (b^2 + c^2) / 3 about each axis, for its half sides 1, 2 and 3.
    inertia = np.diag([4.0 + 9.0, 1.0 + 9.0, 1.0 + 4.0]) / 3.0
    flat = [
        dataclasses.replace(one, position=(x, 0.0, 3.0 * x)) for one, x in zip(THRUSTERS, SIDES, strict=True)
    ]
    model = build_model(load("orion").replace(mass=1.0, inertia=inertia, thrusters=flat))
    half = np.abs(model.box.corners).max(axis=(0, 1, 2))
    np.testing.assert_allclose(half / half[0], [1.0, 2.0, 3.0], rtol=1e-12)


def test_thrusters_of_one_cluster_share_one_mount():
    assert len(build_model(load("orion")).clusters.corners) == 4


@given(finite, st.floats(1e-6, 1e6), st.floats(2.0, 12.0))
def test_round_limits_hold_the_data_on_multiples_of_a_round_step(low, span, intervals):
    high = low + span
    if high - low < 1e-9 * max(abs(low), 1.0):
        return  # the span itself is lost in rounding
    first, last, step = round_limits(low, high, intervals)
    slack = 1e-6 * step
    assert first <= low + slack
    assert last >= high - slack
    assert (last - first) / step <= intervals + 2 + 1e-6
    mantissa = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - factor) for factor in (1.0, 2.0, 5.0)) < 1e-9
    values = tick_values(first, last, step)
    assert len(values) == round((last - first) / step) + 1


@pytest.mark.parametrize(
    ("span", "step"), [(1.0, 0.5), (10.0, 5.0), (7.9, 2.0), (0.03, 0.01), (20000.0, 5000.0)]
)
def test_round_step(span, step):
    assert round_step(span, 4.0) == pytest.approx(step)


def test_tick_labels_carry_the_decimals_that_their_step_needs():
    assert [tick_label(value, 0.02) for value in (-0.5, -0.0, 0.04)] == ["−0.50", "0.00", "0.04"]
    assert tick_label(-3.0, 1.0) == "−3"


@pytest.mark.parametrize("size", [(320, 240), (960, 540), (400, 1000), (3000, 300), (320, 4000)])
def test_panels_neither_overlap_nor_leave_the_picture(size):
    width, height = size
    layout = arrange(width, height)
    boxes = [layout.header, layout.craft, layout.path, layout.duties]
    for left, top, across, down in boxes:
        assert left >= 0
        assert top >= 0
        assert across > 0
        assert down > 0
        assert left + across <= width
        assert top + down <= height
    for number, (left, top, across, down) in enumerate(boxes):
        for other_left, other_top, other_across, other_down in boxes[number + 1 :]:
            apart_across = left + across <= other_left or other_left + other_across <= left
            apart_down = top + down <= other_top or other_top + other_down <= top
            assert apart_across or apart_down
