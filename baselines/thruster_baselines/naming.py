"""Names of before, for one version: settings that have taken the field's terms go on taking the old ones."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from operator import attrgetter
from typing import Any, TypeVar

__all__ = ["with_old_names"]

_Class = TypeVar("_Class", bound=type)


def _is_replacing() -> bool:
    """Whether :func:`dataclasses.replace` constructs, which gives every field under its new name too."""
    caller = sys._getframe(2)
    return caller.f_globals.get("__name__") == "dataclasses" and "replace" in caller.f_code.co_name


def with_old_names(**names: str) -> Callable[[_Class], _Class]:
    """Let a class be constructed with, and read by, old names of its fields, each with its new one.

    Raises:
        TypeError: When constructed with both names of a field.
    """

    def decorate(cls: _Class) -> _Class:
        construct: Callable[..., None] = cls.__init__  # type: ignore[misc]

        @wraps(construct)
        def init(self: Any, *args: Any, **kwargs: Any) -> None:
            for old, new in names.items():
                if old in kwargs:
                    if new in kwargs and not _is_replacing():
                        raise TypeError(f"{cls.__name__} got both {new!r} and its old name {old!r}")
                    kwargs[new] = kwargs.pop(old)
            construct(self, *args, **kwargs)

        cls.__init__ = init  # type: ignore[misc]
        for old, new in names.items():
            setattr(cls, old, property(attrgetter(new), doc=f"The name of before of `{new}`."))
        return cls

    return decorate
