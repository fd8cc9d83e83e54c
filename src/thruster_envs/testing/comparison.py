"""Comparing what environments return: nested dictionaries, tuples and arrays, to the last bit or nearly.

What is here: the first difference between two such structures, the arrays and containers that two of them
share, the first number that is not finite, the first way in which a value does not fit its space, and copy
*i*'s part of the `infos` of a vector environment.

Equality is of bits: 0.0 and -0.0 differ, and a NaN equals a NaN. Types are compared by meaning: the Python
float of a single environment equals the array element of a vector environment that holds the same number,
also when the array has fewer digits than the float (the float is then rounded as the array was). Left out:
objects that compare neither by `==` nor as arrays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
from gymnasium import Space, spaces


class Difference(NamedTuple):
    """Where two structures differ, and what each of them holds there, ready to be printed."""

    where: str
    actual: str
    expected: str


def first_difference(
    actual: Any, expected: Any, where: str = "value", tolerance: float = 0.0
) -> Difference | None:
    """Find the first place where two structures differ.

    Args:
        actual: A nest of mappings, lists, tuples, arrays, numbers, strings and None.
        expected: What it should be.
        where: The name of the structure in the answer.
        tolerance: Relative and absolute tolerance on floating-point numbers; 0 asks for equal bits.

    Returns:
        The first difference, or None.

    >>> first_difference({"fuel": np.array([1.0, 2.0])}, {"fuel": np.array([1.0, 2.5])}, "info")
    Difference(where="info['fuel'][1]", actual='2.0', expected='2.5')
    """
    if isinstance(actual, Mapping) and isinstance(expected, Mapping):
        for key in expected:
            if key not in actual:
                return Difference(f"{where}[{key!r}]", "missing", "present")
        for key in actual:
            if key not in expected:
                return Difference(f"{where}[{key!r}]", "present", "missing")
        pairs: list[tuple[str, Any, Any]] = [
            (f"{where}[{key!r}]", actual[key], expected[key]) for key in expected
        ]
    elif _is_array_like(actual) or _is_array_like(expected):
        return _array_difference(actual, expected, where, tolerance)
    elif isinstance(actual, (list, tuple)) and isinstance(expected, (list, tuple)):
        if len(actual) != len(expected):
            return Difference(where, f"of length {len(actual)}", f"of length {len(expected)}")
        pairs = [
            (f"{where}[{index}]", *both) for index, both in enumerate(zip(actual, expected, strict=True))
        ]
    else:
        return None if _same_object(actual, expected) else Difference(where, show(actual), show(expected))
    for place, one, other in pairs:
        difference = first_difference(one, other, place, tolerance)
        if difference is not None:
            return difference
    return None


def first_non_finite(data: Any, where: str) -> tuple[str, float] | None:
    """Find the first NaN or infinity in a nest of arrays and numbers: its place and its value, or None."""
    for place, array in arrays_in(data, where):
        if array.dtype.kind in "fc":
            bad = ~np.isfinite(array)
            if bad.any():
                index = first_index(bad)
                return place + show_index(index), array[index].item()
    return None


def first_misfit(space: Space[Any], value: Any, where: str) -> str | None:
    """Say in which way a value does not fit its space, or None when it fits.

    Stricter than `space.contains` about types: an array must have the very dtype of its space. Says nothing
    about NaN.
    """
    if isinstance(space, spaces.Dict):
        if not isinstance(value, Mapping):
            return f"{where} is a {type(value).__name__}, not a dict as its space {show(space)}"
        if set(value) != set(space.spaces):
            return f"{where} has the keys {sorted(value)}, its space {sorted(space.spaces)}"
        parts = [(space.spaces[key], value[key], f"{where}[{key!r}]") for key in space.spaces]
    elif isinstance(space, spaces.Tuple):
        if not isinstance(value, tuple):
            return f"{where} is a {type(value).__name__}, not a tuple as its space {show(space)}"
        if len(value) != len(space.spaces):
            return f"{where} has {len(value)} entries, its space {len(space.spaces)}"
        parts = [(part, value[index], f"{where}[{index}]") for index, part in enumerate(space.spaces)]
    elif isinstance(space, (spaces.Box, spaces.MultiDiscrete, spaces.MultiBinary)):
        return _array_misfit(space, value, where)
    else:
        return None if space.contains(value) else f"{where} is {show(value)}, not a member of {show(space)}"
    for part, inner, place in parts:
        misfit = first_misfit(part, inner, place)
        if misfit is not None:
            return misfit
    return None


def info_of_copy(infos: Mapping[str, Any], copy: int) -> dict[str, Any]:
    """Take the `info` of copy number `copy` (from 0) out of the `infos` of a vector environment.

    A key whose mask `_key` is False for that copy is left out; a key without a mask counts as present.
    """
    info: dict[str, Any] = {}
    for key, value in infos.items():
        if is_mask(key, infos):
            continue
        mask = infos.get(f"_{key}")
        if mask is None or mask[copy]:
            info[key] = info_of_copy(value, copy) if isinstance(value, Mapping) else value[copy]
    return info


def is_mask(key: str, infos: Mapping[str, Any]) -> bool:
    """Whether `key` is the mask of another key of these `infos`."""
    return key.startswith("_") and key[1:] in infos


def arrays_in(data: Any, where: str) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Walk through the arrays of a nest with their places; a number counts as an array without axes."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from arrays_in(value, f"{where}[{key!r}]")
    elif isinstance(data, np.ndarray) and data.dtype != object:
        yield where, data
    elif isinstance(data, (list, tuple)) or (isinstance(data, np.ndarray) and data.ndim):
        for index, value in enumerate(data):
            yield from arrays_in(value, f"{where}[{index}]")
    elif isinstance(data, (bool, int, float, complex, np.generic)):
        yield where, np.asarray(data)


def first_shared(one: Any, other: Any, where: str, other_where: str) -> tuple[str, str] | None:
    """Find the first array, dict or list that two nests share: its place in each, or None."""
    others = list(_mutable_parts(other, other_where))
    for place, part in _mutable_parts(one, where):
        for other_place, other_part in others:
            if part is other_part:
                return place, other_place
            if (
                isinstance(part, np.ndarray)
                and isinstance(other_part, np.ndarray)
                and np.shares_memory(part, other_part)
            ):
                return place, other_place
    return None


def first_shared_part(parts: Mapping[str, Any], other_parts: Mapping[str, Any]) -> tuple[str, str] | None:
    """Find the first thing that the parts of two return values share: its place in each, or None."""
    for name, part in parts.items():
        for other_name, other_part in other_parts.items():
            shared = first_shared(part, other_part, name, other_name)
            if shared is not None:
                return shared
    return None


def overwrite_arrays(data: Any) -> None:
    """Write something else into every array of a nest that can be written to."""
    if isinstance(data, Mapping):
        for value in data.values():
            overwrite_arrays(value)
    elif isinstance(data, (list, tuple)) or (isinstance(data, np.ndarray) and data.dtype == object):
        for value in data:
            overwrite_arrays(value)
    elif isinstance(data, np.ndarray) and data.flags.writeable:
        if data.dtype.kind == "b":
            np.logical_not(data, out=data)
        elif data.dtype.kind in "iufc":
            data[...] = np.where(data == 99, 98, 99).astype(data.dtype)


def snapshot(data: Any) -> Any:
    """Copy a nest with everything in it, as `copy.deepcopy` does, but faster for dictionaries of arrays."""
    kind = type(data)
    if kind is np.ndarray and data.dtype != object:
        return data.copy()
    if kind is dict:
        return {key: snapshot(value) for key, value in data.items()}
    if kind is tuple or kind is list:
        return kind(map(snapshot, data))
    return data if kind in (bool, int, float, str, type(None)) else deepcopy(data)


def show(value: Any) -> str:
    """Print a value on one short line: NumPy numbers as plain ones, long things cut."""
    if isinstance(value, np.generic):
        text = str(value) if value.dtype.kind in "biufc" else repr(value.item())
    else:
        text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


def show_index(index: tuple[int, ...]) -> str:
    """Print the index of an array element as it is typed, nothing for an array without axes."""
    return f"[{', '.join(map(str, index))}]" if index else ""


def first_index(mask: np.ndarray[Any, Any]) -> tuple[int, ...]:
    """Give the index of the first True of a mask that has one."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(mask)), mask.shape))


def _is_array_like(value: Any) -> bool:
    return isinstance(value, (np.ndarray, np.generic, bool, int, float, complex))


def _same_object(actual: Any, expected: Any) -> bool:
    return actual is expected or bool(actual == expected)


def _array_difference(actual: Any, expected: Any, where: str, tolerance: float) -> Difference | None:
    if actual is None or expected is None or isinstance(actual, Mapping) or isinstance(expected, Mapping):
        return Difference(where, show(actual), show(expected))
    one, other = np.asarray(actual), np.asarray(expected)
    if one.shape != other.shape:
        return Difference(where, f"of shape {one.shape}", f"of shape {other.shape}")
    if object in (one.dtype, other.dtype):
        for index in np.ndindex(one.shape):
            difference = first_difference(one[index], other[index], where + show_index(index), tolerance)
            if difference is not None:
                return difference
        return None
    differ = _differing(one, other, tolerance)
    if not differ.any():
        return None
    index = first_index(differ)
    return Difference(where + show_index(index), show(one[index]), show(other[index]))


def _differing(
    one: np.ndarray[Any, Any], other: np.ndarray[Any, Any], tolerance: float
) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Mark the elements that differ in two arrays of equal shape."""
    if one.dtype != other.dtype and one.dtype.kind not in "US":
        if np.can_cast(other.dtype, one.dtype, "same_kind"):
            other = other.astype(one.dtype)
        elif np.can_cast(one.dtype, other.dtype, "same_kind"):
            one = one.astype(other.dtype)
    differ: np.ndarray[Any, np.dtype[np.bool_]] = np.asarray(one != other)
    if one.dtype.kind in "fc" and other.dtype.kind in "fc":
        differ &= ~(np.isnan(one) & np.isnan(other))
        if tolerance > 0.0:
            differ &= ~np.isclose(one, other, rtol=tolerance, atol=tolerance)
            return differ
        if one.dtype.kind == "f" and other.dtype.kind == "f":
            differ |= (one == other) & (np.signbit(one) != np.signbit(other))
    return differ


def _array_misfit(
    space: spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary, value: Any, where: str
) -> str | None:
    if not isinstance(value, np.ndarray):
        return f"{where} is a {type(value).__name__}, not an array"
    if value.shape != space.shape:
        return f"{where} has shape {value.shape}, its space {space.shape}"
    if value.dtype != space.dtype:
        return f"{where} has dtype {value.dtype}, its space {space.dtype}"
    if isinstance(space, spaces.Box):
        low, high = space.low, space.high
    elif isinstance(space, spaces.MultiDiscrete):
        low, high = space.start, space.start + space.nvec - 1
    else:
        low, high = np.zeros(space.shape), np.ones(space.shape)
    outside = (value < low) | (value > high)
    if outside.any():
        index = first_index(outside)
        bounds = f"[{show(low[index])}, {show(high[index])}]"
        return f"{where}{show_index(index)} is {show(value[index])}, outside the bounds {bounds} of its space"
    return None


def _mutable_parts(data: Any, where: str) -> Iterator[tuple[str, Any]]:
    if isinstance(data, Mapping):
        yield where, data
        for key, value in data.items():
            yield from _mutable_parts(value, f"{where}[{key!r}]")
    elif isinstance(data, (list, tuple)) or (isinstance(data, np.ndarray) and data.dtype == object):
        if not isinstance(data, tuple):
            yield where, data
        for index, value in enumerate(data):
            yield from _mutable_parts(value, f"{where}[{index}]")
    elif isinstance(data, np.ndarray):
        yield where, data
