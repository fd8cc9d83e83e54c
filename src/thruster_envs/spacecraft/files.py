"""Spacecraft as TOML files: the catalogue that comes with the package, and a user's own.

A file has the fields of `Spacecraft` as its keys, `[feed]`, `[sensors]`, `[orbit]`, `[modulator]` and
`[discharge]` (where there is one) and `[provenance]` as tables, and one `[[thrusters]]` table for each
thruster. What all thrusters share may stand once, in `[thruster_defaults]`; a thruster's own value goes
before it. A file that is saved and loaded again gives an equal spacecraft, to the last bit.

Left out: comments are not kept when a file is loaded and saved; other formats.
"""

from __future__ import annotations

import json
import math
import os
import re
import tomllib
from collections.abc import Mapping
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any

from thruster_envs.configuration import shown, suggestion
from thruster_envs.spacecraft.description import Spacecraft
from thruster_envs.text_files import printable, read_text

_TABLES = ("orbit", "feed", "sensors", "modulator", "discharge", "provenance")

_LISTS = ("thrusters", "reaction_wheels", "control_moment_gyros")

_KEY_END = re.compile(r"[\n=,{#]")
_DEEPEST_KEY = 100  # dots in a dotted key


def load(source: str | PathLike[str] | Mapping[str, Any] | Spacecraft) -> Spacecraft:
    """A spacecraft of the catalogue, or a user's own.

    Args:
        source: A name of the catalogue, the path of a TOML file (UTF-8, at most 1 MB), a mapping like such
            a file, or a `Spacecraft`, which is returned as it is.

    Raises:
        ValueError: No such name or file, a file that cannot be read, or something in it that is wrong: one
            line says what, where, and what would be right.

    >>> load("orion").mass
    20.0
    """
    if isinstance(source, Spacecraft):
        return source
    if isinstance(source, Mapping):
        return _from_document(source, "spacecraft")
    if isinstance(source, str) and source in catalogue():
        file = resources.files(__package__) / "catalogue" / f"{source}.toml"
        return _from_text(file.read_text(encoding="utf-8"), f"{source}.toml")
    if not isinstance(source, str | PathLike):
        raise ValueError(
            f"{shown(source)} is no spacecraft; a name, a path, a mapping or a Spacecraft would be right"
        )
    path = os.fsdecode(source)
    if not _exists(path):
        raise ValueError(
            f"there is no spacecraft {shown(path)} in the catalogue, and no such file; "
            f"{_hint(path, catalogue())}"
        )
    return _from_text(read_text(path), printable(path))


def catalogue() -> tuple[str, ...]:
    """The names of the spacecraft that come with the package, in alphabetical order.

    >>> "orion" in catalogue()
    True
    """
    folder = resources.files(__package__) / "catalogue"
    names = (entry.name for entry in folder.iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def save(spacecraft: Spacecraft, path: str | PathLike[str]) -> None:
    """Write a spacecraft to a TOML file that `load` reads back exactly.

    Args:
        spacecraft: What to write.
        path: The file; an existing one is replaced.

    Raises:
        ValueError: A text with half of a surrogate pair, which no file can have.
    """
    document = spacecraft.to_dict()
    actuators = {name: document.pop(name) for name in _LISTS}
    tables = {name: document.pop(name) for name in _TABLES}
    lines = _entries(document)
    for name, table in tables.items():
        if table:
            lines += ["", f"[{name}]", *_entries(table)]
    for name, ones in actuators.items():
        for one in ones:
            lines += ["", f"[[{name}]]", *_entries(one)]
    content = ("\n".join(lines) + "\n").encode("utf-8")  # before the file is touched: it may fail
    Path(path).write_bytes(content)


def _exists(path: str) -> bool:
    """Whether there is anything under a path; what the system cannot even look for is not there."""
    try:
        os.stat(path)
    except PermissionError:
        return True  # whoever reads it says so
    except (OSError, ValueError):  # among them names that are too long or have a NUL
        return False
    return True


def _hint(path: str, names: tuple[str, ...]) -> str:
    return (
        f"a path that exists would be right (the catalogue has {', '.join(names)})"
        if Path(path).suffix
        else suggestion(path, names)
    )


def _from_text(text: str, where: str) -> Spacecraft:
    try:
        if any(piece.count(".") > _DEEPEST_KEY for piece in _KEY_END.split(text)):
            raise RecursionError  # the reader's time grows with the square of the depth
        document = tomllib.loads(text, parse_float=_float)
    except RecursionError:
        raise ValueError(f"{where}: not a TOML file that can be read: it is nested too deep") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{where}: not a TOML file: {_shortened(str(error))}") from None
    except ValueError as error:  # a number that Python cannot hold
        raise ValueError(f"{where}: {_shortened(str(error))}") from None
    return _from_document(document, where)


def _float(text: str) -> float:
    """A TOML float; one that overflows is refused, since "inf" is there for those who mean it."""
    number = float(text)
    if math.isinf(number) and "inf" not in text:
        raise ValueError(f"the number {_shortened(text)} must be within +/-1.8e+308")
    return number


def _shortened(text: str) -> str:
    """A line of at most 200 characters: the end, which has the place, is kept."""
    text = " ".join(text.split())
    return text if len(text) <= 200 else f"{text[:120]}...{text[-77:]}"


def _from_document(document: Mapping[str, Any], where: str) -> Spacecraft:
    """The spacecraft of a parsed file, with `thruster_defaults` written into every thruster."""
    fields = dict(document)
    defaults = fields.pop("thruster_defaults", {})
    if not isinstance(defaults, Mapping):
        raise ValueError(f"{where}: thruster_defaults is {shown(defaults)}; a table would be right")
    thrusters = fields.get("thrusters")
    if defaults and isinstance(thrusters, list | tuple):
        fields["thrusters"] = [
            {**defaults, **thruster} if isinstance(thruster, Mapping) else thruster for thruster in thrusters
        ]
    return Spacecraft.from_dict(fields, where)


def _entries(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(name)} = {_value(value)}" for name, value in table.items()]


def _key(name: str) -> str:
    bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if bare else _string(name)


def _value(value: Any) -> str:
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, int):
        return repr(value).lower()  # true and false are whole numbers too
    return repr(float(value))  # the shortest text that reads back as the same number; "inf" is TOML too


def _string(text: str) -> str:
    """A TOML basic string: JSON's escapes, plus the delete character, which JSON leaves as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")
