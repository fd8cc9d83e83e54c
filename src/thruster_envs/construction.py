"""How an object was constructed, as plain data: what a wrapper records of a mapper or a detector.

A record is ``{"callable": "module:Name", "arguments": {...}}`` of plain data, so that an ``EnvSpec`` with it
survives JSON; :func:`rebuilt` makes the object anew. Records exist of what inherits from
:class:`RecordsArguments`, and of dataclasses. Of anything else there is only an :class:`Unrecorded`.

Left out: what an object has learnt since it was constructed.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from thruster_envs.configuration import as_plain

_CALLABLE, _ARGUMENTS = "callable", "arguments"


class RecordsArguments:
    """Remembers the arguments of its constructor, for :func:`record_of`."""

    _constructed_with: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        """The object, with copies of the arrays among its arguments."""
        self = super().__new__(cls)
        self._constructed_with = (
            tuple(_own(value) for value in args),
            {name: _own(value) for name, value in kwargs.items()},
        )
        return self

    def constructor_arguments(self) -> dict[str, Any]:
        """The arguments by name with which to construct the like of it."""
        args, kwargs = self._constructed_with
        return inspect.signature(type(self)).bind(*args, **kwargs).arguments


class Unrecorded(str):
    """The name of a class of which no record can be made, with the object beside it while it is in memory.

    In JSON only the name is left, from which nothing can be rebuilt.
    """

    thing: Any

    @classmethod
    def of(cls, thing: Any) -> Unrecorded:
        """For an object."""
        name = cls(_path(type(thing)))
        name.thing = thing
        return name


def record_of(thing: Any) -> dict[str, Any] | Unrecorded:
    """How an object was constructed, as plain data, or else an :class:`Unrecorded`."""
    try:
        record: dict[str, Any] = _record(thing)
    except TypeError:
        return Unrecorded.of(thing)
    return record


def rebuilt(record: Any) -> Any:
    """The object of a record, new; anything else is returned as it is.

    Raises:
        ValueError: A record of which the object cannot be made, or a mere name that was one's.
    """
    if isinstance(record, Unrecorded):
        return record.thing
    if isinstance(record, str):
        raise ValueError(
            f"{record} cannot be rebuilt from its name: wrap the environment by hand, or let the class "
            "inherit from thruster_envs.construction.RecordsArguments"
        )
    return _rebuilt(record) if _is_record(record) else record


def _is_record(value: Any) -> bool:
    return isinstance(value, Mapping) and value.keys() == {_CALLABLE, _ARGUMENTS}


def _rebuilt(value: Any) -> Any:
    if _is_record(value):
        return _named(value[_CALLABLE])(**{name: _rebuilt(one) for name, one in value[_ARGUMENTS].items()})
    if isinstance(value, Mapping):
        return {name: _rebuilt(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rebuilt(one) for one in value]
    return value


def _record(value: Any) -> Any:
    """The value as plain data; raises TypeError where there is none."""
    if isinstance(value, RecordsArguments):
        return _call(_checked_path(value), value.constructor_arguments())
    if hasattr(value, "to_dict") and hasattr(value, "from_dict"):  # a Spacecraft
        return _call(f"{_checked_path(value)}.from_dict", {"mapping": as_plain(value.to_dict())})
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {one.name: getattr(value, one.name) for one in dataclasses.fields(value) if one.init}
        return _call(_checked_path(value), fields)
    if isinstance(value, np.ndarray):
        return _call("numpy:array", {"object": value.tolist(), "dtype": value.dtype.str})
    if isinstance(value, Mapping):
        return {str(name): _record(one) for name, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_record(one) for one in value]
    return as_plain(value)


def _call(path: str, arguments: dict[str, Any]) -> dict[str, Any]:
    return {_CALLABLE: path, _ARGUMENTS: {name: _record(value) for name, value in arguments.items()}}


def _own(value: Any) -> Any:
    return value.copy() if isinstance(value, np.ndarray) else value


def _path(cls: type[Any]) -> str:
    return f"{cls.__module__}:{cls.__qualname__}"


def _checked_path(thing: Any) -> str:
    path = _path(type(thing))
    if "<locals>" in path:
        raise TypeError(f"{path} is inside a function")
    return path


def _named(path: str) -> Any:
    """What stands at ``module:Name``."""
    module, _, name = path.partition(":")
    try:
        found: Any = import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"{path} of the recorded specification does not exist here: {error}") from None
    return found
