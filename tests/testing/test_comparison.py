"""Structures are equal to the last bit, or the first difference is named."""

from copy import deepcopy

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from thruster_envs.testing.comparison import (
    first_difference,
    first_misfit,
    first_non_finite,
    first_shared,
    info_of_copy,
    overwrite_arrays,
    snapshot,
)

ARRAYS = arrays.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.bool_]), arrays.array_shapes(min_side=1, max_dims=3)
)
LEAVES = st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=3) | ARRAYS
NESTS = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.tuples(inner, inner)
        | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)


@given(NESTS)
def test_a_structure_equals_its_copy_and_shares_nothing_with_it(nest):
    copy = snapshot(nest)
    assert first_difference(copy, deepcopy(nest)) is None
    assert first_difference(nest, copy) is None
    assert first_shared(nest, copy, "nest", "copy") is None


@given(ARRAYS)
def test_an_array_differs_from_itself_overwritten(array):
    other = array.copy()
    overwrite_arrays({"inside": [other]})
    assert first_difference(array, other) is not None


@given(ARRAYS, st.data())
def test_one_flipped_bit_is_a_difference_and_its_place_is_named(array, data):
    index = tuple(data.draw(st.integers(0, side - 1)) for side in array.shape)
    other = array.copy()
    if array.dtype.kind == "f":
        array[index], other[index] = 1.0, np.nextafter(array.dtype.type(1.0), array.dtype.type(2.0))
    else:
        other[index] = not other[index]
    difference = first_difference(other, array, "it")
    assert difference is not None
    assert difference.where == f"it[{', '.join(map(str, index))}]"


@pytest.mark.parametrize(
    ("actual", "expected", "where", "is_it", "not_it"),
    [
        (0.0, -0.0, "value", "0.0", "-0.0"),
        (np.float32(0.5), 0.25, "value", "0.5", "0.25"),
        ({"a": 1}, {"a": 1, "b": 2}, "value['b']", "missing", "present"),
        ({"a": 1, "b": 2}, {"a": 1}, "value['b']", "present", "missing"),
        ([1, 2], [1], "value", "of length 2", "of length 1"),
        (np.zeros(2), np.zeros((2, 1)), "value", "of shape (2,)", "of shape (2, 1)"),
        (None, 1.0, "value", "None", "1.0"),
        ("on", "off", "value", "'on'", "'off'"),
        (np.array([1, 2]), np.array([1.0, 2.5]), "value[1]", "2", "2.5"),
        (np.array(["a", "bc"]), np.array(["a", "bcd"]), "value[1]", "'bc'", "'bcd'"),
        (np.array([None, "x"], dtype=object), np.array([None, "y"], dtype=object), "value[1]", "'x'", "'y'"),
        (
            {"deep": ({"er": np.array([1.0, 2.0])},)},
            {"deep": ({"er": [1.0, 3.0]},)},
            "value['deep'][0]['er'][1]",
            "2.0",
            "3.0",
        ),
    ],
)
def test_a_difference_names_its_place_and_both_values(actual, expected, where, is_it, not_it):
    assert first_difference(actual, expected) == (where, is_it, not_it)


def test_a_python_float_equals_the_array_element_that_it_rounds_to():
    assert first_difference(np.float32(0.1), 0.1) is None
    assert first_difference(np.float64(0.1), float(np.float32(0.1))) is not None


def test_nan_equals_nan_and_nothing_else():
    assert first_difference(np.array([np.nan]), np.array([np.nan])) is None
    assert first_difference(np.array([np.nan]), np.array([0.0])) is not None
    assert first_difference(np.array([np.nan]), np.array([0.0]), tolerance=1.0) is not None


def test_a_tolerance_is_relative_and_absolute():
    assert first_difference(1.0, 1.0 + 1e-7, tolerance=1e-6) is None
    assert first_difference(1e9, 1e9 + 100.0, tolerance=1e-6) is None
    assert first_difference(1.0, 1.0 + 1e-5, tolerance=1e-6) is not None
    assert first_difference(1, 2, tolerance=10.0) is not None  # whole numbers are counted, not measured


def test_the_first_number_that_is_not_finite_is_found_anywhere():
    assert first_non_finite({"a": [np.zeros(2), {"b": np.array([0.0, -np.inf])}]}, "infos") == (
        "infos['a'][1]['b'][1]",
        -np.inf,
    )
    assert first_non_finite({"a": np.arange(3), "b": "nan", "c": None}, "infos") is None


@pytest.mark.parametrize(
    ("space", "value", "says"),
    [
        (spaces.Box(-1, 1, (2,)), np.zeros(2), "it has dtype float64, its space float32"),
        (spaces.Box(-1, 1, (2,)), [0.0, 0.0], "it is a list, not an array"),
        (
            spaces.Box(-1, 1, (2,)),
            np.float32([0, 2]),
            "it[1] is 2.0, outside the bounds [-1.0, 1.0] of its space",
        ),
        (
            spaces.MultiDiscrete([2, 3]),
            np.array([1, 3]),
            "it[1] is 3, outside the bounds [0, 2] of its space",
        ),
        (spaces.MultiBinary(2), np.array([1, 2], dtype=np.int8), "it[1] is 2, outside the bounds [0.0, 1.0]"),
        (spaces.Discrete(3), 3, "it is 3, not a member of Discrete(3)"),
        (spaces.Dict(a=spaces.Discrete(2)), {"b": 1}, "it has the keys ['b'], its space ['a']"),
        (spaces.Dict(a=spaces.Discrete(2)), {"a": 2}, "it['a'] is 2, not a member of Discrete(2)"),
        (spaces.Tuple([spaces.Discrete(2)]), (0, 0), "it has 2 entries, its space 1"),
        (spaces.Tuple([spaces.Discrete(2)]), [0], "it is a list, not a tuple"),
    ],
)
def test_a_misfit_says_in_which_way(space, value, says):
    misfit = first_misfit(space, value, "it")
    assert misfit is not None
    assert misfit.startswith(says)


@pytest.mark.parametrize(
    "space",
    [
        spaces.Box(-np.inf, 1, (2, 3)),
        spaces.MultiDiscrete([2, 3], start=[-1, 5]),
        spaces.MultiBinary(4),
        spaces.Dict(a=spaces.Tuple([spaces.Discrete(2), spaces.Text(5)])),
    ],
)
def test_samples_of_a_space_fit_it(space):
    space.seed(1)
    assert all(first_misfit(space, space.sample(), "sample") is None for _ in range(50))


def test_two_views_of_one_buffer_share_it_and_two_buffers_do_not():
    buffer = np.zeros(4)
    assert first_shared({"a": buffer[:2]}, [buffer[1:]], "one", "other") == ("one['a']", "other[0]")
    assert first_shared(buffer[:2], buffer[2:], "one", "other") is None


def test_the_info_of_a_copy_is_what_its_masks_leave():
    infos = {
        "fuel": np.array([1.0, 2.0]),
        "_fuel": np.array([True, False]),
        "terms": {"miss": np.array([3.0, 4.0]), "_miss": np.array([True, True])},
        "_terms": np.array([True, True]),
        "unmasked": np.array([5, 6]),
    }
    assert info_of_copy(infos, 0) == {"fuel": 1.0, "terms": {"miss": 3.0}, "unmasked": 5}
    assert info_of_copy(infos, 1) == {"terms": {"miss": 4.0}, "unmasked": 6}
