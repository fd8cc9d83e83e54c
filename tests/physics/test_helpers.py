"""The small compiled functions of attitude and relative orbit: right by closed forms, and usable on arrays.

Undecorated (`function.py_func`), each takes NumPy arrays in place of numbers, componentwise over a batch.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.physics import closed_forms as exact
from tests.physics.reference_flight import hcw_acceleration, two_body_relative_acceleration
from thruster_envs.physics import attitude as kernel
from thruster_envs.physics import orbits

N = 0.0011
RADIUS = orbits.orbit_radius(N)
SIZES = {"q": 4, "v": 3, "s": 1}


def upper(matrix):
    """A symmetric matrix as the kernels hold it: xx, yy, zz, xy, xz, yz."""
    return tuple(matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist())


def angles(largest: float):
    """Three numbers, each at most so large."""
    return st.lists(st.floats(-largest, largest), min_size=3, max_size=3)


@given(angles(3.0), angles(3.0), st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3))
def test_products_and_rotations_are_hamiltons(first, second, vector):
    p, q = exact.rotation_quaternion(first), exact.rotation_quaternion(second)
    np.testing.assert_allclose(kernel.quaternion_product(tuple(p), tuple(q)), exact.product(p, q), atol=1e-15)
    np.testing.assert_allclose(kernel.rotate(tuple(q), tuple(vector)), exact.rotate(q, vector), atol=1e-13)
    back = kernel.rotate_back(tuple(q), kernel.rotate(tuple(q), tuple(vector)))
    np.testing.assert_allclose(back, vector, atol=1e-13)
    np.testing.assert_allclose(kernel.cross(tuple(first), tuple(second)), np.cross(first, second), atol=1e-14)


@given(angles(1.1))
def test_the_exponential_is_right_to_rounding_up_to_a_length_of_two(half):
    np.testing.assert_allclose(
        kernel.exponential(*half), exact.rotation_quaternion(2.0 * np.array(half)), atol=2e-15
    )


@pytest.mark.parametrize("length", [3.0, 6.0])
def test_the_exponential_is_good_to_nine_digits_up_to_a_length_of_six(length):
    half = length * np.array([0.6, -0.8, 0.0])
    np.testing.assert_allclose(kernel.exponential(*half), exact.rotation_quaternion(2.0 * half), atol=1e-9)


@pytest.mark.parametrize("time", [0.0, 0.3, 5.0, 36.0])
def test_a_body_at_rest_falls_behind_the_turning_frame(time):
    q = exact.rotation_quaternion([0.3, 1.0, -0.4])
    turned = exact.product(q, exact.rotation_quaternion([0.0, 0.0, N * time]))
    np.testing.assert_allclose(kernel.follow_orbit(tuple(q), N, time), turned, atol=1e-15)


def test_a_normalised_quaternion_has_unit_length():
    assert np.linalg.norm(kernel.normalised((1.0, 2.0, -3.0, 0.5))) == pytest.approx(1.0, abs=1e-16)


def test_the_angular_acceleration_solves_eulers_equation():
    inertia = np.array([[2.0, 0.1, -0.2], [0.1, 1.5, 0.3], [-0.2, 0.3, 1.0]])
    rate, torque = np.array([0.1, -0.4, 0.2]), np.array([0.03, 0.02, -0.01])
    found = kernel.angular_acceleration(
        tuple(rate), tuple(torque), upper(inertia), upper(np.linalg.inv(inertia))
    )
    np.testing.assert_allclose(inertia @ found, torque - np.cross(rate, inertia @ rate), atol=1e-16)
    diagonal = kernel.angular_acceleration(
        tuple(rate), tuple(torque), (2.0, 1.5, 1.0), (1 / 2.0, 1 / 1.5, 1.0)
    )
    body = np.diag([2.0, 1.5, 1.0])
    np.testing.assert_allclose(body @ diagonal, torque - np.cross(rate, body @ rate), atol=1e-16)


def test_the_transition_matrix_is_the_closed_form():
    for time in (0.0, 1.0, 5.0, 300.0, 5712.0):
        np.testing.assert_allclose(
            orbits.transition_matrix(N, time), exact.hcw_transition(N, time), rtol=1e-9, atol=1e-9
        )
    assert pytest.approx(exact.orbit_radius(N), rel=1e-15) == RADIUS


@given(
    st.lists(st.floats(-1e5, 1e5), min_size=3, max_size=3),
    st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3),
)
def test_the_relative_accelerations_are_those_of_the_referee(position, velocity):
    r, v = tuple(position), tuple(velocity)
    np.testing.assert_allclose(
        orbits.hill_acceleration(r, v, N), hcw_acceleration(np.array(r), np.array(v), N), rtol=1e-14
    )
    np.testing.assert_allclose(
        orbits.two_body_acceleration(r, v, N, RADIUS),
        two_body_relative_acceleration(np.array(r), np.array(v), N),
        rtol=1e-12,
        atol=1e-15,
    )


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (kernel.quaternion_product, "qq"),
        (kernel.conjugate, "q"),
        (kernel.cross, "vv"),
        (kernel.rotate, "qv"),
        (kernel.rotate_back, "qv"),
        (kernel.exponential, "sss"),
        (kernel.follow_orbit, "qss"),
        (kernel.normalised, "q"),
        (kernel.turn, "qvvvs"),
        (kernel.angular_acceleration, "vvvv"),
        (orbits.hill_acceleration, "vvs"),
        (orbits.two_body_acceleration, "vvss"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.py_func.__name__,
)
def test_undecorated_a_function_takes_arrays(function, arguments):
    """A batch of five at once gives what five calls of the compiled function give."""
    rng = np.random.default_rng(1)
    batch = [
        rng.uniform(0.01, 0.1, 5) if kind == "s" else tuple(rng.uniform(-1.0, 1.0, (SIZES[kind], 5)))
        for kind in arguments
    ]
    together = np.array(function.py_func(*batch))
    for k in range(5):
        one = [
            value[k] if isinstance(value, np.ndarray) else tuple(row[k] for row in value) for value in batch
        ]
        np.testing.assert_allclose(together[:, k], function(*one), rtol=1e-13, atol=1e-15)
