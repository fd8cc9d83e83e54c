"""The counter-based generator: NumPy's Philox word for word, and the two distributions that come from it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray
from scipy import stats

from thruster_envs import random as streams

Array = NDArray[np.float64]
WORDS = st.integers(min_value=0, max_value=2**64 - 1)
DRAWS = 200_000
LARGEST_NORMAL = math.sqrt(-2.0 * math.log(0.5 / 2.0**32))
"""The uniform number underneath is never less than half a step of its grid."""


@njit
def blocks(counters, keys, out):
    """One block of four words for every row of ``counters`` (k, 4) and ``keys`` (k, 2)."""
    for k in range(counters.shape[0]):
        c, key = counters[k], keys[k]
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = streams.philox(c[0], c[1], c[2], c[3], key[0], key[1])


@njit
def uniforms(words, out):
    """Both uniform numbers of every word."""
    for k in range(words.shape[0]):
        out[k, 0], out[k, 1] = streams.uniform_pair(words[k])


@njit
def normals(words, out):
    """Both normal numbers of every word."""
    for k in range(words.shape[0]):
        out[k, 0], out[k, 1] = streams.normal_pair(words[k])


@njit
def logarithms(x, out):
    """The generator's own logarithm of every number."""
    for k in range(x.shape[0]):
        out[k] = streams._log(x[k])


@njit
def circles(turns, out):
    """The generator's own cosine and sine of every number of turns."""
    for k in range(turns.shape[0]):
        out[k, 0], out[k, 1] = streams.cos_sin_turns(turns[k])


def numpy_block(counter: list[int], key: list[int]) -> list[int]:
    """The block of NumPy's generator at a counter; NumPy counts up by one before it gives a block."""
    before = (sum(word << (64 * k) for k, word in enumerate(counter)) - 1) % 2**256
    generator = np.random.Philox(counter=before, key=sum(word << (64 * k) for k, word in enumerate(key)))
    return [int(word) for word in generator.random_raw(4)]


def one_block(counter: list[int], key: list[int]) -> list[int]:
    """The same block of the generator under test."""
    out = np.empty((1, 4), np.uint64)
    blocks(np.array([counter], np.uint64), np.array([key], np.uint64), out)
    return [int(word) for word in out[0]]


def words(number: int) -> NDArray[np.uint64]:
    """Words of one stream, four to a block."""
    counters = np.zeros((-(-number // 4), 4), np.uint64)
    counters[:, 0] = np.arange(len(counters))
    out = np.empty_like(counters)
    blocks(counters, np.full((len(counters), 2), 7, np.uint64), out)
    return out.reshape(-1)[:number]


def drawn(kernel: Callable[..., None], number: int = DRAWS) -> Array:
    """(number, 2) numbers that a kernel makes of that many words."""
    out = np.empty((number, 2))
    kernel(words(number), out)
    return out


@given(st.lists(WORDS, min_size=4, max_size=4), st.lists(WORDS, min_size=2, max_size=2))
def test_every_block_is_the_one_that_numpy_gives(counter, key):
    assert one_block(counter, key) == numpy_block(counter, key)


@pytest.mark.parametrize("counter", [[0, 0, 0, 0], [2**64 - 1] * 4, [0, 1, 0, 0], [1, 0, 0, 2**33]])
def test_the_ends_of_the_counter_are_no_exception(counter):
    assert one_block(counter, [0, 0]) == numpy_block(counter, [0, 0])


def test_neighbouring_counters_and_keys_share_no_word():
    """Streams that differ in one number (block, step, episode, craft or seed) differ in every word."""
    first = one_block([0, 0, 0, 0], [0, 0])
    for index in range(6):
        numbers = [0] * 6
        numbers[index] = 1
        assert not set(first) & set(one_block(numbers[:4], numbers[4:]))


@given(WORDS)
def test_uniform_numbers_are_the_middles_of_a_32_bit_grid(word):
    out = np.empty((1, 2))
    uniforms(np.array([word], np.uint64), out)
    assert out[0, 0] == ((word >> 32) + 0.5) / 2.0**32
    assert out[0, 1] == ((word & 0xFFFFFFFF) + 0.5) / 2.0**32
    assert out.min() > 0.0
    assert out.max() < 1.0


def test_uniform_numbers_are_uniform_and_the_two_of_a_word_independent():
    numbers = drawn(uniforms)
    for column in numbers.T:
        assert stats.kstest(column, "uniform").pvalue > 0.01
        assert column.mean() == pytest.approx(0.5, abs=4.0 * math.sqrt(1 / 12 / DRAWS))
        assert column.var() == pytest.approx(1 / 12, rel=0.01)
    assert abs(np.corrcoef(numbers.T)[0, 1]) < 4.0 / math.sqrt(DRAWS)


def test_normal_numbers_are_standard_normal_and_the_two_of_a_word_independent():
    numbers = drawn(normals)
    for column in numbers.T:
        assert stats.kstest(column, "norm").pvalue > 0.01
        assert column.mean() == pytest.approx(0.0, abs=4.0 / math.sqrt(DRAWS))
        assert column.var() == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / DRAWS))
        assert stats.skew(column) == pytest.approx(0.0, abs=4.0 * math.sqrt(6.0 / DRAWS))
        assert stats.kurtosis(column) == pytest.approx(0.0, abs=4.0 * math.sqrt(24.0 / DRAWS))
    assert abs(np.corrcoef(numbers.T)[0, 1]) < 4.0 / math.sqrt(DRAWS)
    assert abs(np.corrcoef(numbers.T**2)[0, 1]) < 4.0 / math.sqrt(DRAWS)


@given(st.lists(WORDS, min_size=1, max_size=20))
def test_a_normal_number_is_finite_and_below_its_bound(several):
    out = np.empty((len(several), 2))
    normals(np.array(several, np.uint64), out)
    assert np.abs(out).max() <= LARGEST_NORMAL * (1.0 + 1e-12)
    assert LARGEST_NORMAL < 6.8


def test_the_largest_normal_number_comes_from_the_smallest_word():
    out = np.empty((1, 2))
    normals(np.array([0], np.uint64), out)
    assert out[0, 0] == pytest.approx(LARGEST_NORMAL, rel=1e-12)


def test_the_logarithm_is_right_to_eleven_digits():
    grid = (
        np.concatenate([np.arange(1000.0), np.random.default_rng(0).integers(0, 2**32, 100_000)]) + 0.5
    ) / 2.0**32
    ends = np.array([0.5 / 2.0**32, 0.25, 0.5, math.sqrt(0.5), 1.0 - 0.5 / 2.0**32])
    x = np.concatenate([grid, ends, np.nextafter(ends, 0.0)])
    out = np.empty_like(x)
    logarithms(x, out)
    assert np.abs(out - np.log(x)).max() < 1e-11
    assert out.max() < 0.0


def test_cosine_and_sine_are_right_to_eleven_digits_all_round():
    turns = np.concatenate(
        [np.linspace(0.0, 1.0, 100_001), np.arange(1, 8) / 8, np.nextafter(np.arange(1, 8) / 8, 0.0)]
    )
    out = np.empty((len(turns), 2))
    circles(turns, out)
    exact = np.stack([np.cos(2.0 * np.pi * turns), np.sin(2.0 * np.pi * turns)], axis=1)
    assert np.abs(out - exact).max() < 1e-11


@pytest.mark.parametrize("kernel", [uniforms, normals])
def test_a_number_has_the_same_bits_drawn_alone_or_in_a_vectorised_loop(kernel):
    several = words(1000)
    together = drawn(kernel, 1000)
    alone = np.empty((1, 2))
    for k, word in enumerate(several):
        kernel(np.array([word], np.uint64), alone)
        assert np.array_equal(alone[0], together[k])
