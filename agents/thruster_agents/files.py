"""Files that are written whole or not at all, JSON that is read with care, and folders that one process uses.

Whatever is wrong with a file that is read is a `ValueError` of one line; an `OSError` (no space, no
permission) is the system's own.
"""

from __future__ import annotations

import fcntl
import json
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from thruster_envs.text_files import read_text
from thruster_envs.whole_files import remove_unfinished, write_whole

__all__ = [
    "as_json",
    "first_difference",
    "locked",
    "read_json",
    "remove_unfinished",
    "write_json",
    "write_whole",
]

_LARGEST_JSON = 16 * 2**20
_DEEPEST = 32


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file whole or not at all.

    Raises:
        ValueError: A number that is not finite.
    """
    write_whole(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> dict[str, Any]:
    """The object that a JSON file holds.

    Raises:
        ValueError: No such file, too large a one, no JSON in UTF-8, nested too deeply, a key that stands
            twice, NaN or an infinity, or something else than an object.
    """
    text = read_text(path, largest=_LARGEST_JSON)
    try:
        found = json.loads(text, object_pairs_hook=_unique, parse_constant=_no_number)
    except RecursionError:
        raise ValueError(f"{path} is nested more than {_DEEPEST} deep") from None
    except ValueError as error:  # of JSON, and of whole numbers with thousands of digits
        raise ValueError(f"{path} is not JSON ({' '.join(str(error).split())})") from None
    if not isinstance(found, dict):
        raise ValueError(f"{path} must hold a JSON object, got {type(found).__name__}")
    if _deeper(found, _DEEPEST):
        raise ValueError(f"{path} is nested more than {_DEEPEST} deep")
    return found


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {twice!r} stands twice")
    return found


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is not a number of JSON")


def _deeper(value: Any, levels: int) -> bool:
    if not isinstance(value, dict | list):
        return False
    inside = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_deeper(one, levels - 1) for one in inside)


def as_json(value: Any) -> Any:
    """A value as it comes back from JSON: tuples as lists, infinities by their names.

    >>> as_json({"duration": (5.0, float("inf"))})
    {'duration': [5.0, 'inf']}
    """
    if isinstance(value, Mapping):
        return {str(key): as_json(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [as_json(one) for one in value]
    if isinstance(value, float) and value - value != 0.0:
        return str(value)
    return value


def first_difference(then: Any, now: Any, name: str = "") -> tuple[str, Any, Any] | None:
    """Where two plain values differ first: the field's name and the value in either; None for nowhere.

    >>> first_difference({"feed": {"coupling": 0.06}}, {"feed": {"coupling": 0.0}})
    ('feed.coupling', 0.06, 0.0)
    """
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in [*then, *(key for key in now if key not in then)]:
            inside = f"{name}.{key}" if name else str(key)
            if key not in then or key not in now:
                return inside, then.get(key, "missing"), now.get(key, "missing")
            found = first_difference(then[key], now[key], inside)
            if found is not None:
                return found
        return None
    lists = list | tuple
    if isinstance(then, lists) and isinstance(now, lists) and len(then) == len(now):
        pairs = enumerate(zip(then, now, strict=True), start=1)
        differences = (first_difference(one, other, f"{name}[{k}]") for k, (one, other) in pairs)
        return next((one for one in differences if one is not None), None)
    return None if type(then) is type(now) and then == now else (name, then, now)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Use a folder alone. The system lets go of the lock when the process ends, however it ends.

    Raises:
        ValueError: Another process uses it, or no file can be made in it; one line says which.
    """
    path = folder / "lock"
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        raise ValueError(f"{folder} cannot be written to ({error.strerror}: {path.name})") from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            said = "".join(filter(str.isprintable, os.read(handle, 200).decode(errors="replace")))
            raise ValueError(f"{folder} is in use by {said or 'another process'}; wait for its end") from None
        except OSError as error:
            raise ValueError(f"{folder} cannot be locked ({error.strerror})") from None
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
        yield
    finally:
        os.close(handle)
