"""Nested values with arrays in one safetensors file, with a checksum: nothing that is read is run.

A value is made of dicts, lists, tuples, strings, numbers, None, NumPy arrays and torch tensors. Arrays are
the tensors of the file; all the rest is JSON in its header. The checksum finds damage, not malice: who reads
a value still checks that it has the names, kinds and shapes that he expects (`check_like`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from thruster_agents.files import write_whole

__all__ = ["check_like", "read_tree", "write_tree"]

_FORMAT = "thruster_agents 1"
_TYPES = {"BOOL", "U8", "U16", "U32", "U64", "I8", "I16", "I32", "I64", "F16", "F32", "F64"}
_LARGEST = 2**32  # bytes


def write_tree(path: Path, tree: Any) -> None:
    """Write a value whole or not at all."""
    arrays: dict[str, NDArray[Any]] = {}
    text = json.dumps(_packed(tree, "", arrays))
    metadata = {"format": _FORMAT, "tree": text, "sha256": _checksum(text, arrays)}
    write_whole(path, save(arrays, metadata))


def read_tree(path: Path) -> Any:
    """What `write_tree` was given.

    Raises:
        ValueError: No such file, or one that is damaged or something else; one line.
    """
    if not path.is_file():
        raise ValueError(f"{path} does not exist")
    try:
        if path.stat().st_size > _LARGEST:
            raise ValueError(f"{path} must have at most {_LARGEST} bytes, got {path.stat().st_size}")
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            names = file.keys()
            strange = next((one for one in names if file.get_slice(one).get_dtype() not in _TYPES), None)
            if metadata.get("format") != _FORMAT or "tree" not in metadata or strange is not None:
                raise ValueError(f"{path} is not a file of this package's, or of another version of it")
            arrays = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{path} is damaged ({' '.join(str(error).split())})") from None
    text = metadata["tree"]
    if metadata.get("sha256") != _checksum(text, arrays):
        raise ValueError(f"{path} is damaged (its checksum is another)")
    try:
        return _unpacked(json.loads(text), arrays)
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ValueError(f"{path} is not a file of this package's") from None


def check_like(found: Any, wanted: Any, where: str) -> None:
    """Check that a value has the kinds, names and shapes of another one.

    Args:
        found: What was read.
        wanted: What has the right form.
        where: At the head of the line.

    Raises:
        ValueError: The first place that differs, in one line.
    """
    if isinstance(wanted, Mapping):
        if not isinstance(found, Mapping) or found.keys() != wanted.keys():
            names = sorted(map(str, found.keys() ^ wanted.keys())) if isinstance(found, Mapping) else wanted
            raise ValueError(f"{where}: other names than expected ({', '.join(map(str, names))})")
        for name, one in wanted.items():
            check_like(found[name], one, f"{where}: {name}")
        return
    if isinstance(wanted, torch.Tensor | np.ndarray):
        there = (found.dtype, tuple(found.shape)) if isinstance(found, type(wanted)) else type(found)
        here = (wanted.dtype, tuple(wanted.shape))
        if there != here:
            raise ValueError(f"{where} must have the type and shape {here}, got {there}")
        return
    if isinstance(wanted, list | tuple):
        if type(found) is not type(wanted) or len(found) != len(wanted):
            raise ValueError(f"{where} must have {len(wanted)} entries")
        for number, (one, other) in enumerate(zip(found, wanted, strict=True), start=1):
            check_like(one, other, f"{where}[{number}]")
        return
    if type(found) is not type(wanted):
        raise ValueError(f"{where} must be of type {type(wanted).__name__}, got {type(found).__name__}")


def _packed(value: Any, path: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """A value as JSON, its arrays apart."""
    if isinstance(value, torch.Tensor):
        arrays[path] = np.array(value.detach().cpu().numpy(), order="C")
        return {"tensor": path}
    if isinstance(value, np.ndarray):
        arrays[path] = np.array(value, order="C")
        return {"array": path}
    if isinstance(value, Mapping):
        return {"dict": [[key, _packed(one, f"{path}/{key}", arrays)] for key, one in value.items()]}
    if isinstance(value, list | tuple):
        inside = [_packed(one, f"{path}/{number}", arrays) for number, one in enumerate(value)]
        return {"list" if isinstance(value, list) else "tuple": inside}
    return value.item() if isinstance(value, np.generic) else value


def _unpacked(packed: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    if isinstance(packed, list):
        raise TypeError(packed)
    if not isinstance(packed, dict):
        return packed
    ((kind, inside),) = packed.items()
    if kind == "tensor":
        return torch.from_numpy(arrays[inside])
    if kind == "array":
        return arrays[inside]
    if kind == "dict":
        return {key: _unpacked(one, arrays) for key, one in inside}
    return {"list": list, "tuple": tuple}[kind](_unpacked(one, arrays) for one in inside)


def _checksum(text: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    found = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        found.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()
