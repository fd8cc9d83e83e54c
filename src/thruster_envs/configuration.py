"""Frozen configurations that travel as plain mappings: JSON, TOML, an `EnvSpec`'s keyword arguments.

A configuration is a frozen dataclass. `from_mapping` builds one from a plain mapping and refuses what it
does not know by naming the nearest thing that it does know; `to_mapping` is the way back. A dataclass that
calls `coerce_fields(self)` first in its `__post_init__` accepts the same loose values (lists for tuples,
whole numbers for floats, NumPy scalars and arrays) when it is built directly. Fields hold Python's own types:
a NumPy number or a member of an `Enum` with a value of such a type becomes that type.

Every problem is a `ValueError` of one line: the value, where it stands, what would be right.

Left out: defaults that depend on other fields, inheritance between mappings, any file format.
"""

from __future__ import annotations

import dataclasses
import difflib
import enum
import math
import os
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, TypeVar

import numpy as np

Configuration = TypeVar("Configuration")

_LONGEST_RANGE = 1_000_000
_LARGEST_FLOAT = float(np.finfo(np.float64).max)
_KNOWN_FIELD_TYPES: dict[type[Any], dict[str, Any]] = {}  # a class's annotations, evaluated once


def from_mapping(cls: type[Configuration], mapping: Mapping[str, Any], where: str = "") -> Configuration:
    """Build the dataclass `cls` from a plain mapping of its fields.

    Nested dataclasses, tuples of dataclasses and mappings of them are built in the same way.

    Args:
        cls: A dataclass type.
        mapping: Field name to value; the values may be what a JSON or TOML reader returns.
        where: Where the mapping stands (a file, an argument), put at the head of every error line.

    Raises:
        ValueError: An unknown or missing key, a value of the wrong kind, or whatever `cls` refuses.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Box:
    ...     width: float
    ...     colours: tuple[str, ...] = ()
    >>> from_mapping(Box, {"width": 2, "colours": ["red"]})
    Box(width=2.0, colours=('red',))
    >>> from_mapping(Box, {"widht": 2}, where="box.toml")
    Traceback (most recent call last):
    ValueError: box.toml: unknown key 'widht'; did you mean 'width'?
    """
    if isinstance(mapping, cls):
        return mapping
    prefix = f"{where}: " if where else ""
    if not isinstance(mapping, Mapping):
        raise ValueError(f"{prefix}{shown(mapping)} is not a mapping of the fields of {cls.__name__}")
    hints = _field_types(cls)
    for key in mapping:
        if key not in hints:
            raise ValueError(f"{prefix}unknown key {shown(key)}; {suggestion(key, hints)}")
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]  # a TypeVar cannot be bound to "a dataclass"
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if field.init and required and field.name not in mapping:
            raise ValueError(f"{prefix}the key {field.name!r} is missing")
    values = {key: _coerced(hints[key], value, f"{prefix}{key}") for key, value in mapping.items()}
    try:
        return cls(**values)
    except ValueError as error:
        raise ValueError(f"{prefix}{error}") from None


def to_mapping(configuration: Any) -> dict[str, Any]:
    """A configuration as nested plain dicts, tuples, strings and numbers; `from_mapping` reads it back.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Box:
    ...     width: float
    >>> to_mapping(Box(width=2.0))
    {'width': 2.0}
    """
    if not dataclasses.is_dataclass(configuration) or isinstance(configuration, type):
        raise ValueError(
            f"{shown(configuration)} is not a configuration; a dataclass instance would be right"
        )
    return dataclasses.asdict(configuration)


def as_plain(value: Any) -> Any:
    """A value in the types of JSON: configurations as mappings, paths as text, arrays and tuples as lists.

    Raises:
        TypeError: What has no such form.

    >>> as_plain({"shape": (2, np.float32(0.5)), "start": np.zeros(2)})
    {'shape': [2, 0.5], 'start': [0.0, 0.0]}
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {one.name: as_plain(getattr(value, one.name)) for one in dataclasses.fields(value) if one.init}
    if isinstance(value, enum.Enum):
        return as_plain(value.value)
    if isinstance(value, np.generic | np.ndarray):
        return as_plain(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Mapping):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [as_plain(item) for item in value]
    for plain_type in (bool, int, float, str):  # subclasses of them too
        if isinstance(value, plain_type):
            return plain_type(value)
    if value is None:
        return None
    raise TypeError(f"{shown(value)} has no form in JSON")


def coerce_fields(configuration: Any) -> None:
    """Turn the fields of a frozen dataclass under construction into the types that they declare.

    To be called first in `__post_init__`. A list becomes a tuple, a whole number or a NumPy scalar a float,
    a mapping the dataclass that the field declares.

    Raises:
        ValueError: A value that cannot be what its field declares, the field named.
    """
    for name, hint in _field_types(type(configuration)).items():
        value = getattr(configuration, name)
        object.__setattr__(configuration, name, _coerced(hint, value, name))


def require(condition: bool, what: str, value: object, right: str) -> None:
    """Raise one clear line unless `condition` holds.

    Args:
        condition: Whether the value is right.
        what: What it is and where it stands.
        value: The value.
        right: What would be right.

    Raises:
        ValueError: "`what` is `value`; `right` would be right".

    >>> require(False, "mass", -1.0, "a positive number of kg")
    Traceback (most recent call last):
    ValueError: mass is -1.0; a positive number of kg would be right
    """
    if not condition:
        raise ValueError(f"{what} is {shown(value)}; {right} would be right")


def shown(value: object, longest: int = 80) -> str:
    """A value as it is printed in an error: its `repr` on one line, of at most `longest` characters.

    >>> shown([1.0, 2.0])
    '[1.0, 2.0]'
    >>> shown("abcdefgh", longest=6)
    "'ab..."
    """
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # whole numbers of thousands of digits; nested too deep
        size = f" of {value.bit_length()} bits" if isinstance(value, int) else " that cannot be printed"
        text = f"<{type(value).__name__}{size}>"
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


def suggestion(name: object, known: Iterable[str]) -> str:
    """The end of an error line about an unknown name: the nearest known one, or else all of them.

    >>> suggestion("thurst", ("thrust", "position"))
    "did you mean 'thrust'?"
    >>> suggestion("q", ("thrust", "position"))
    'known are thrust, position'
    """
    names = [str(one) for one in known]
    near = nearest(name, names) if isinstance(name, str) else None
    return f"known are {', '.join(names)}" if near is None else f"did you mean {near!r}?"


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str | None:
    """The known name that is most like `name`; None where none is like it.

    Args:
        name: What was typed.
        known: The names that exist.
        likeness: How much alike the two must be at least, 0..1, in the sense of `difflib`.

    >>> nearest("Faults", ("faults", "reset_mask"), likeness=0.8)
    'faults'
    """
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=likeness)
    return near[0] if near else None


def _field_types(cls: type[Any]) -> dict[str, Any]:
    """The declared type of each field that the constructor takes."""
    if cls not in _KNOWN_FIELD_TYPES:
        hints = typing.get_type_hints(cls)
        _KNOWN_FIELD_TYPES[cls] = {
            field.name: hints[field.name] for field in dataclasses.fields(cls) if field.init
        }
    return _KNOWN_FIELD_TYPES[cls]


def _coerced(hint: Any, value: Any, where: str) -> Any:
    """`value` as the type `hint`; raises one line that begins with `where`."""
    origin = typing.get_origin(hint)
    if hint is Any:
        return value
    if origin in (typing.Union, types.UnionType):
        return _coerced_union(typing.get_args(hint), value, where)
    if origin is Literal:
        return _coerced_choice(typing.get_args(hint), value, where)
    if origin is tuple:
        return _coerced_tuple(typing.get_args(hint), value, where)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _coerced_dict(typing.get_args(hint), value, where)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return from_mapping(hint, value, where)
    return _coerced_scalar(hint, value, where)


def _coerced_union(choices: Sequence[Any], value: Any, where: str) -> Any:
    if value is None and types.NoneType in choices:
        return None
    problems = []
    for choice in choices:
        if choice is types.NoneType:
            continue
        try:
            return _coerced(choice, value, where)
        except ValueError as error:
            problems.append(error)
    # What lies within the value says more than that the whole is of another type.
    raise next((one for one in problems if not str(one).startswith(f"{where} ")), problems[0])


def _coerced_choice(choices: Sequence[Any], value: Any, where: str) -> Any:
    plain = _plain(value)
    for choice in choices:
        if type(plain) is type(choice) and plain == choice:
            return choice
    raise ValueError(f"{where}: {shown(value)} is unknown; {suggestion(plain, map(str, choices))}")


def _coerced_tuple(item_types: Sequence[Any], value: Any, where: str) -> tuple[Any, ...]:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, Sequence) or isinstance(value, str | bytes | bytearray | memoryview):
        raise ValueError(f"{where} is {shown(value)}; a list would be right")
    if isinstance(value, range) and value[_LONGEST_RANGE:]:
        raise ValueError(f"{where} must have at most {_LONGEST_RANGE:,} entries, got {shown(value)}")
    if len(item_types) == 2 and item_types[1] is Ellipsis:
        item_types = [item_types[0]] * len(value)
    if len(value) != len(item_types):
        raise ValueError(f"{where} has {len(value)} entries; {len(item_types)} would be right")
    return tuple(
        _coerced(item_type, item, f"{where}, entry {number}")
        for number, (item_type, item) in enumerate(zip(item_types, value, strict=True), start=1)
    )


def _coerced_dict(item_types: Sequence[Any], value: Any, where: str) -> dict[Any, Any]:
    if not isinstance(value, Mapping):
        raise ValueError(f"{where} is {shown(value)}; a table of keys and values would be right")
    key_type, value_type = item_types if item_types else (Any, Any)
    return {
        _coerced(key_type, key, f"{where}, key {shown(key)}"): _coerced(
            value_type, item, f"{where}, {shown(key)}"
        )
        for key, item in value.items()
    }


def _coerced_scalar(hint: Any, value: Any, where: str) -> Any:
    value = _plain(value)
    if hint is float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{where} is {shown(value)}; a number would be right")
        if abs(value) > _LARGEST_FLOAT and not isinstance(value, float):
            raise ValueError(f"{where} must be within +/-{_LARGEST_FLOAT:.2g}, got {shown(value)}")
        if math.isnan(value):
            raise ValueError(f"{where} is NaN; a number would be right")
        return float(value)
    if hint is int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            raise ValueError(f"{where} is {shown(value)}; a whole number would be right")
        if not -(2**63) <= value < 2**63:
            raise ValueError(f"{where} must be a whole number of 64 bits, got {shown(value)}")
        return value
    if isinstance(hint, type) and not isinstance(value, hint):
        raise ValueError(f"{where} is {shown(value)}; a value of type {hint.__name__} would be right")
    return value


def _plain(value: Any) -> Any:
    """NumPy's scalars and arrays without a dimension, and subclasses of Python's scalars, as the latter."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, float | np.floating):
        return float(value)
    if isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64):
        return int(value)
    return value
