"""What a commanded rate change may turn into when the attitude is not known exactly.

A command that was worked out in another frame is turned into the body frame with the measured attitude. If
that is wrong by the angles phi, theta, psi, the command that should have been mapped is

    b' = Rx(phi) Ry(theta) Rz(psi) b,        for small angles  b' = b + b x (phi, theta, psi)

for the translation and for the rotation alike (Yang 2003, section 3.2). Angles lie in a box: each between its
bias minus and plus its half width. The intervals of `interval` are exact for each component alone. Taken
together they are conservative: one attitude error moves all components at once, so that most corners of the
box of intervals cannot happen.

Left out: errors of the commanded rate change itself, and attitudes that change during the period.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray

__all__ = ["AttitudeUncertainty"]

_STEPS = 16  # of the grid over the angle that is searched
_ZOOMS = 8  # each narrows the search to two steps of the grid

# What `_value` gives at an angle: a component of the turned command, either largest over the other two
# angles, or at three equal angles.
_SECOND_UPWARD, _SECOND_DOWNWARD, _THIRD, _EQUAL_FIRST, _EQUAL_SECOND, _EQUAL_THIRD = range(6)


@dataclass(frozen=True, kw_only=True)
class AttitudeUncertainty:
    """A box of attitude errors, and the intervals that it makes of commands.

    Args:
        half_widths: rad, one number or three, about x, y and z.
        bias: rad, the middle of each angle's range, one number or three. Not zero: skewed intervals.
        equal_angles: The three angles are always the same (the case that the source works out).
        small_angles: Leave out what is of second order in the angles, as the source does. Without bias the
            intervals then have the command in their middle.

    Raises:
        ValueError: An angle that is negative, not finite, or beyond a quarter turn; equal angles with three
            different ranges.

    >>> one_degree = AttitudeUncertainty(half_widths=math.radians(1.0), equal_angles=True, small_angles=True)
    >>> low, high = one_degree.interval([-0.027, -0.027, 0.0])
    >>> ((high - low) / 2).round(6)
    array([0.000471, 0.000471, 0.      ])
    """

    half_widths: float | tuple[float, float, float]
    bias: float | tuple[float, float, float] = 0.0
    equal_angles: bool = False
    small_angles: bool = False

    def __post_init__(self) -> None:
        half_widths = _three_angles(self.half_widths, "half_widths")
        bias = _three_angles(self.bias, "bias")
        for axis in range(3):
            if half_widths[axis] < 0.0:
                raise ValueError(
                    f"half_widths on axis {axis} is {half_widths[axis]} rad; zero or more would be right"
                )
            reach = abs(bias[axis]) + half_widths[axis]
            if reach > math.pi / 2.0:
                raise ValueError(
                    f"bias and half_widths on axis {axis} reach {reach:g} rad; at most a quarter turn "
                    "would be right"
                )
        if self.equal_angles and (len(set(half_widths)) > 1 or len(set(bias)) > 1):
            raise ValueError(
                f"half_widths is {half_widths} and bias {bias} for equal angles; one number each would be "
                "right"
            )
        object.__setattr__(self, "half_widths", half_widths)
        object.__setattr__(self, "bias", bias)

    def interval(self, command: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The smallest and the largest value of each component of a command over the box of angles.

        In closed form for small angles. Otherwise in closed form over two of the angles, and by a narrowing
        search over the third (all in one where the angles are equal), to round-off.

        Args:
            command: (..., m), m/s then rad/s, body frame by the measured attitude; m is 3 or 6, a triplet or
                two.

        Returns:
            Low and high, each (..., m).

        Raises:
            ValueError: A number of components that is no multiple of three.
        """
        triplets = _triplets(command)
        if self.small_angles:
            low, high = self._small_angle_interval(triplets)
        else:
            low, high = -self._largest_components(-triplets), self._largest_components(triplets)
        shape = np.shape(command)
        return low.reshape(shape), high.reshape(shape)

    def samples(self, command: ArrayLike, count: int, seed: int) -> FloatArray:
        """Commands (count, ..., m) under attitude errors drawn evenly from the box, the same error for all.

        Args:
            command: (..., m), m/s then rad/s.
            count: How many errors are drawn; more draws with the same seed begin with the same errors.
            seed: Of the generator.

        Raises:
            ValueError: A number of components that is no multiple of three, or fewer than one draw.
        """
        if count < 1:
            raise ValueError(f"count is {count}; one or more would be right")
        triplets = _triplets(command)
        low, high = self._angles()
        shares = np.random.default_rng(seed).random((count, 1 if self.equal_angles else 3))
        angles = low + np.broadcast_to(shares, (count, 3)) * (high - low)
        rotation = _small_rotation(angles) if self.small_angles else _rotation(angles)
        turned: FloatArray = np.einsum("sij,...j->s...i", rotation, triplets)
        return turned.reshape(count, *np.shape(command))

    def sampled_interval(self, command: ArrayLike, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
        """The extremes of `samples`: within `interval`, and nearer to it the more are drawn."""
        samples = self.samples(command, count, seed)
        return samples.min(axis=0), samples.max(axis=0)

    def _angles(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest phi, theta, psi, rad."""
        bias, half_widths = np.array(self.bias), np.array(self.half_widths)
        return bias - half_widths, bias + half_widths

    def _small_angle_interval(self, triplets: FloatArray) -> tuple[FloatArray, FloatArray]:
        middle = triplets + np.cross(triplets, np.array(self.bias))
        half_widths = np.array(self.half_widths)
        if self.equal_angles:
            half = np.abs(np.cross(triplets, half_widths))
        else:
            x, y, z = np.moveaxis(np.abs(triplets), -1, 0)
            phi, theta, psi = half_widths
            half = np.stack([psi * y + theta * z, psi * x + phi * z, theta * x + phi * y], axis=-1)
        return middle - half, middle + half

    def _largest_components(self, triplets: FloatArray) -> FloatArray:
        """The largest value of each component of b' over the box, (..., 3)."""
        flat = triplets.reshape(-1, 3).copy()
        largest = np.empty_like(flat)
        _largest_over_box(flat, *self._angles(), self.equal_angles, largest)
        return largest.reshape(triplets.shape)


def _three_angles(given: float | tuple[float, float, float], name: str) -> tuple[float, float, float]:
    angles = np.array(given, dtype=np.float64)
    if angles.ndim == 0:
        angles = np.full(3, angles)
    if angles.shape != (3,):
        raise ValueError(f"{name} has the shape {angles.shape}; one number or three would be right")
    if not np.isfinite(angles).all():
        axis = int(np.argmin(np.isfinite(angles)))
        raise ValueError(f"{name} on axis {axis} is {angles[axis]} rad; a finite number would be right")
    x, y, z = angles.tolist()
    return x, y, z


def _triplets(command: ArrayLike) -> FloatArray:
    """The command (..., m) as (..., m / 3, 3)."""
    values = np.asarray(command, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] % 3:
        raise ValueError(f"command has the shape {values.shape}; (..., 3) or (..., 6) would be right")
    return values.reshape(*values.shape[:-1], values.shape[-1] // 3, 3)


def _rotation(angles: FloatArray) -> FloatArray:
    """Rx(phi) Ry(theta) Rz(psi), turning the frame: (..., 3, 3) of angles (..., 3) in rad."""
    c1, c2, c3 = np.moveaxis(np.cos(angles), -1, 0)
    s1, s2, s3 = np.moveaxis(np.sin(angles), -1, 0)
    rows = [
        [c2 * c3, c2 * s3, -s2],
        [s1 * s2 * c3 - c1 * s3, s1 * s2 * s3 + c1 * c3, s1 * c2],
        [c1 * s2 * c3 + s1 * s3, c1 * s2 * s3 - s1 * c3, c1 * c2],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _small_rotation(angles: FloatArray) -> FloatArray:
    """What of `_rotation` is of first order in the angles."""
    phi, theta, psi = np.moveaxis(angles, -1, 0)
    one = np.ones_like(phi)
    rows = [[one, psi, -theta], [-psi, one, phi], [theta, -phi, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@kernel
def _largest_over_box(
    triplets: FloatArray, low: FloatArray, high: FloatArray, equal_angles: bool, largest: FloatArray
) -> None:
    """Write the largest components of triplets (count, 3), turned by angles from low to high (3,), rad.

    With p = b1 cos psi + b2 sin psi, q = b2 cos psi - b1 sin psi and v = p sin theta + b3 cos theta:

        b'1 = p cos theta - b3 sin theta,  b'2 = q cos phi + v sin phi,  b'3 = v cos phi - q sin phi.

    The first is a sinusoid in theta at the largest p. The others are, for a given psi, largest at an extreme
    v, and then sinusoids in phi; where sin phi is negative, b'2 wants the smallest v.
    """
    for i in range(triplets.shape[0]):
        b1, b2, b3 = triplets[i]
        if equal_angles:
            for k in range(3):
                largest[i, k] = _search(_EQUAL_FIRST + k, b1, b2, b3, low, high)
            continue
        p = _largest_sinusoid(b1, b2, low[2], high[2])
        largest[i, 0] = _largest_sinusoid(p, -b3, low[1], high[1])
        largest[i, 1] = -np.inf
        if high[0] >= 0.0:
            largest[i, 1] = _search(_SECOND_UPWARD, b1, b2, b3, low, high)
        if low[0] < 0.0:
            largest[i, 1] = max(largest[i, 1], _search(_SECOND_DOWNWARD, b1, b2, b3, low, high))
        largest[i, 2] = _search(_THIRD, b1, b2, b3, low, high)


@njit(error_model="numpy")
def _search(form: int, b1: float, b2: float, b3: float, low: FloatArray, high: FloatArray) -> float:
    """The largest `_value` over psi, by a grid that narrows around its best point."""
    first, last = low[2], high[2]
    largest = -np.inf
    for _ in range(_ZOOMS):
        step = (last - first) / _STEPS
        best, best_value = 0, -np.inf
        for k in range(_STEPS + 1):
            value = _value(form, b1, b2, b3, first + k * step, low, high)
            if value > best_value:
                best, best_value = k, value
        largest = max(largest, best_value)
        first, last = first + max(best - 1, 0) * step, first + min(best + 1, _STEPS) * step
    return largest


@njit(error_model="numpy")
def _value(
    form: int, b1: float, b2: float, b3: float, psi: float, low: FloatArray, high: FloatArray
) -> float:
    cosine, sine = math.cos(psi), math.sin(psi)
    p, q = b1 * cosine + b2 * sine, b2 * cosine - b1 * sine
    if form == _SECOND_UPWARD:
        v = _largest_sinusoid(b3, p, low[1], high[1])
        return _largest_sinusoid(q, v, max(low[0], 0.0), high[0])
    if form == _SECOND_DOWNWARD:
        v = -_largest_sinusoid(-b3, -p, low[1], high[1])
        return _largest_sinusoid(q, v, low[0], min(high[0], 0.0))
    if form == _THIRD:
        v = _largest_sinusoid(b3, p, low[1], high[1])
        return _largest_sinusoid(v, -q, low[0], high[0])
    if form == _EQUAL_FIRST:
        return p * cosine - b3 * sine
    v = p * sine + b3 * cosine
    if form == _EQUAL_SECOND:
        return q * cosine + v * sine
    return v * cosine - q * sine


@njit(error_model="numpy")
def _largest_sinusoid(cosine: float, sine: float, low: float, high: float) -> float:
    """The largest value of `cosine cos t + sine sin t` for t from low to high, at most half a turn apart."""
    cosine_low, sine_low, cosine_high, sine_high = (
        math.cos(low),
        math.sin(low),
        math.cos(high),
        math.sin(high),
    )
    rises = sine * cosine_low - cosine * sine_low > 0.0
    falls = sine * cosine_high - cosine * sine_high < 0.0
    if rises and falls:  # the peak is between
        return math.hypot(cosine, sine)
    return max(cosine * cosine_low + sine * sine_low, cosine * cosine_high + sine * sine_high)
