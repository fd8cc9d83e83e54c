"""Which reproductions there are: studies decorated by `reproduces`, and what stands in `REPRODUCTIONS`."""

from __future__ import annotations

import ast
import difflib
import hashlib
import importlib
import json
import pkgutil
import re
import sys
from collections.abc import Iterable
from dataclasses import asdict
from functools import cache, partial
from importlib.resources import files
from types import ModuleType

import reproductions
from reproductions.record import Effort, Reproduction
from thruster_envs.kernels import sources_of

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
                _collect(_of_module(importlib.import_module(module.name)), found)
    return {name: found[name] for name in sorted(found, key=order)}


def _of_module(module: ModuleType) -> list[Reproduction]:
    """Those of a module's own studies, and of a family of results that one study recomputes."""
    own = [one for one in vars(module).values() if getattr(one, "__module__", "") == module.__name__]
    decorated = [one.reproduction for one in own if hasattr(one, "reproduction")]
    return [*decorated, *getattr(module, "REPRODUCTIONS", ())]


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
    """Of the effort, of what is said of the source, and of all code of ours and all vehicles that it may use.

    Comments, docstrings and the layout of the code do not count.
    """
    said = {key: value for key, value in vars(reproduction).items() if key != "run"}
    run = reproduction.run
    while isinstance(run, partial):
        run = run.func
    settings = json.dumps([asdict(effort), said, _code_under(run.__module__)], sort_keys=True)
    return hashlib.sha256(settings.encode()).hexdigest()[:16]


@cache
def _code_under(module: str) -> str:
    """A hash of the code of a module and of all that it imports, directly, or by the name of an environment.

    The catalogue of spacecraft counts as code.
    """
    sources = sources_of(module, sys.modules[module].__file__)
    if "thruster_envs.registration" in sources:  # whose table names the views as texts
        sources |= sources_of("thruster_envs.views.environments")
    digest = hashlib.sha256()
    for name, source in sorted(sources.items()):
        digest.update(name.encode() + _code_of(source))
    for path in sorted((files("thruster_envs.spacecraft") / "catalogue").iterdir(), key=str):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _code_of(source: bytes) -> bytes:
    """A hash of what a source says to the computer."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):  # a text that stands alone is a docstring or a comment
            node.body = [one for one in body if not _is_text(one)]  # type: ignore[attr-defined]  # as of nodes with bodies
    return hashlib.sha256(ast.dump(tree).encode()).digest()


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
