"""Counter-based random numbers: one stream per world, drawn anywhere, in any order, by any thread.

What is here: the Philox 4x64 generator with ten rounds (Salmon et al. 2011, "Parallel random numbers: as easy
as 1, 2, 3"), the same function as ``numpy.random.Philox``, and the two distributions that the physics needs.
A draw is a pure function of a *key* (the seed of the world) and a *counter* (which block of the step, which
step, which episode, which craft and purpose): nothing is advanced, so a world's draws depend on its own seed
and its own time alone, never on the batch around it.

What is left out: any generator state, and any distribution other than the uniform and the normal.

The functions are scalar and branch-free, hence they vectorise across worlds and give the same bits in a batch
of one and in a batch of thousands; the logarithm and the sine are polynomials of their own for that reason
(absolute error below 1e-11, far below the 32-bit grid of the uniform numbers underneath).
"""

import numpy as np

from thruster_envs.helpers import njit

_ROUND_0 = np.uint64(0xD2E7470EE14C6C93)
_ROUND_1 = np.uint64(0xCA5A826395121157)
_WEYL_0 = np.uint64(0x9E3779B97F4A7C15)
_WEYL_1 = np.uint64(0xBB67AE8584CAA73B)
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)

#: Purposes: the high half of the last counter word, so that two uses of one step never share a draw.
STEP, RESET, FAULTS, COMMAND, VALVES, SENSOR_FAULTS, MEASUREMENT, ANOMALY = 0, 1, 2, 3, 4, 5, 6, 7


@njit(forceinline=True)
def _multiply_high(a, b):
    """High 64 bits of the 128-bit product of two unsigned 64-bit numbers."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    low, cross_0, cross_1, high = a_low * b_low, a_low * b_high, a_high * b_low, a_high * b_high
    middle = (low >> _HALF) + (cross_0 & _LOW) + (cross_1 & _LOW)
    return high + (cross_0 >> _HALF) + (cross_1 >> _HALF) + (middle >> _HALF)


@njit(forceinline=True)
def philox(c0, c1, c2, c3, key_0, key_1):
    """Four uniform unsigned 64-bit words from a 256-bit counter and a 128-bit key (Philox 4x64-10).

    Equal to the block that ``numpy.random.Philox`` gives for the same key once its counter stands at
    ``(c0, c1, c2, c3)``.
    """
    for _ in range(10):
        high_0, low_0 = _multiply_high(_ROUND_0, c0), _ROUND_0 * c0
        high_1, low_1 = _multiply_high(_ROUND_1, c2), _ROUND_1 * c2
        c0, c1, c2, c3 = high_1 ^ c1 ^ key_0, low_1, high_0 ^ c3 ^ key_1, low_0
        key_0, key_1 = key_0 + _WEYL_0, key_1 + _WEYL_1
    return c0, c1, c2, c3


@njit(forceinline=True)
def uniform_pair(word):
    """Two uniform numbers in the open interval (0, 1), on a grid of 2**-32, from one 64-bit word."""
    return (
        (np.float64(np.int64(word >> _HALF)) + 0.5) * 2.3283064365386963e-10,
        (np.float64(np.int64(word & _LOW)) + 0.5) * 2.3283064365386963e-10,
    )


@njit(forceinline=True)
def normal_pair(word):
    """Two independent standard normal numbers, at most 6.8 in size, from one word (Box and Muller 1958)."""
    first, second = uniform_pair(word)
    radius = np.sqrt(-2.0 * _log(first))
    cosine, sine = cos_sin_turns(second)
    return radius * cosine, radius * sine


@njit(forceinline=True)
def _log(x):
    """Natural logarithm of a number in (0, 1): its exponent, and the area-tangent series of its mantissa."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits >> 52) - 1023
    mantissa = np.int64((bits & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000).view(np.float64)
    large = mantissa > 1.4142135623730951
    mantissa = 0.5 * mantissa if large else mantissa
    power = np.float64(exponent) + (1.0 if large else 0.0)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    series = 1.0 + z * (
        1 / 3 + z * (1 / 5 + z * (1 / 7 + z * (1 / 9 + z * (1 / 11 + z * (1 / 13 + z * (1 / 15))))))
    )
    return power * 0.6931471805599453 + 2.0 * s * series


@njit(forceinline=True)
def cos_sin_turns(u):
    """Cosine and sine of ``u`` turns, 0 <= u <= 1: quarter-turn reduction and two Taylor polynomials."""
    quarter = np.floor(4.0 * u + 0.5)
    x = (4.0 * u - quarter) * 1.5707963267948966
    z = x * x
    sine = x * (1.0 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (1 / 362880 - 1 / 39916800 * z)))))
    cosine = 1.0 + z * (
        -1 / 2 + z * (1 / 24 + z * (-1 / 720 + z * (1 / 40320 + z * (-1 / 3628800 + 1 / 479001600 * z))))
    )
    swap = (quarter == 1.0) | (quarter == 3.0)
    cosine, sine = (sine, cosine) if swap else (cosine, sine)
    cosine = -cosine if (quarter == 1.0) | (quarter == 2.0) else cosine
    sine = -sine if (quarter == 2.0) | (quarter == 3.0) else sine
    return cosine, sine
