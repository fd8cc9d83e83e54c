"""Which reproductions there are: those in `REPRODUCTIONS` of the modules of each source's subpackage."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import inspect
import json
import pkgutil
import re
import sys
from collections.abc import Iterable
from dataclasses import asdict
from functools import partial

import reproductions
from reproductions.record import Effort, Reproduction

__all__ = ["chosen", "find_all", "fingerprint", "order"]


def find_all() -> dict[str, Reproduction]:
    """All reproductions by id, in order.

    Raises:
        ValueError: Two that have the same id.
    """
    found: dict[str, Reproduction] = {}
    for package in pkgutil.iter_modules(reproductions.__path__, "reproductions."):
        if package.ispkg:
            parent = importlib.import_module(package.name)
            for module in pkgutil.walk_packages(parent.__path__, f"{package.name}."):
                _collect(getattr(importlib.import_module(module.name), "REPRODUCTIONS", ()), found)
    return {name: found[name] for name in sorted(found, key=order)}


def _collect(those: Iterable[Reproduction], found: dict[str, Reproduction]) -> None:
    for one in those:
        if one.id in found:
            raise ValueError(
                f"the id {one.id} is that of {one.title!r} and of {found[one.id].title!r}; an id of its own "
                "would be right"
            )
        found[one.id] = one


def order(name: str) -> tuple[str | int, ...]:
    """E3 before E19a before E19b before E20, and E6.9 before E6.10.

    >>> sorted(["E20", "E6.10", "E19b", "E3", "E6.9", "E19a"], key=order)
    ['E3', 'E6.9', 'E6.10', 'E19a', 'E19b', 'E20']
    """
    parts = re.split(r"(\d+)", name)  # every second one is a number
    return tuple(int(part) if number % 2 else part for number, part in enumerate(parts))


def chosen(names: list[str], known: dict[str, Reproduction]) -> list[Reproduction]:
    """The reproductions with these ids, or all of them; in order, each once.

    Raises:
        ValueError: An id that there is not; the line names the nearest.
    """
    if names == ["all"]:
        return list(known.values())
    for name in names:
        if name not in known:
            (nearest,) = difflib.get_close_matches(name, known, n=1, cutoff=0.0)
            raise ValueError(f"there is no reproduction {name!r}; the nearest is {nearest}")
    return [known[name] for name in sorted(set(names), key=order)]


def fingerprint(reproduction: Reproduction, effort: Effort) -> str:
    """Of the effort, of what is said of the source, and of the text of the module; not of what it imports."""
    said = {key: value for key, value in vars(reproduction).items() if key != "run"}
    run = reproduction.run
    while isinstance(run, partial):
        run = run.func
    text = inspect.getsource(sys.modules[run.__module__])
    settings = json.dumps([asdict(effort), said, text], sort_keys=True)
    return hashlib.sha256(settings.encode()).hexdigest()[:16]
