"""Helpers of kernels: the same numbers inside a kernel and called from Python."""

import math

import numpy as np
import pytest

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel


@njit
def _root(x):
    return math.sqrt(x)


@njit(forceinline=True)
def _length(v, scale=1.0):
    total = 0.0
    for one in v:
        total += one * one
    return scale * _root(total)


@kernel
def _lengths(rows, lengths):
    for k in range(rows.shape[0]):
        lengths[k] = _length(rows[k], 2.0) + _length((3.0, 4.0))


def test_a_helper_is_the_same_in_a_kernel_called_from_python_and_undecorated():
    rows = np.random.default_rng(0).normal(size=(5, 3))
    lengths = np.empty(5)
    _lengths(rows, lengths)
    assert lengths.tolist() == [_length(row, 2.0) + 5.0 for row in rows]
    assert lengths.tolist() == [_length.py_func(row, 2.0) + 5.0 for row in rows]


def test_a_helper_called_from_python_first_still_goes_into_a_kernel():
    @njit
    def doubled(x):
        return 2 * x

    @kernel
    def doubled_twice(x):
        return doubled(doubled(x))

    assert doubled(3) == 6
    assert doubled_twice(3) == 12
    assert doubled(0.5) == 1.0


def test_a_helper_divides_by_zero_by_the_rules_of_who_calls_it():
    @njit
    def divided(a, b):
        return a / b

    @kernel
    def shared(a, b):
        return divided(a, b)

    assert shared(1.0, 0.0) == math.inf
    with pytest.raises(ZeroDivisionError):
        divided(1.0, 0.0)
