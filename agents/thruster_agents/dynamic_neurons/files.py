"""Classifiers in folders: numbers of networks in a safetensors file, all the rest in a JSON file; no pickle.

```
<folder>/classifier.json       format, kind, settings, thresholds
<folder>/weights.safetensors   parameters, by the names of networks and layers
```

Each file is written whole or not at all. What is read is checked: kind, keys, names and shapes of parameters,
finite numbers. Left out: the state of an unfinished training; `train` has checkpoints.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from thruster_agents.dynamic_neurons.networks import SequenceNetwork
from thruster_envs.configuration import suggestion

__all__ = ["read_description", "read_weights", "write_description", "write_weights"]

_FORMAT = "thruster_agents.dynamic_neurons 1"
_DESCRIPTION, _WEIGHTS = "classifier.json", "weights.safetensors"


def write_description(folder: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write the JSON file of a classifier; the folder is made where there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"format": _FORMAT, "kind": kind, **content}, indent=2, allow_nan=False)
    unfinished = folder / f"{_DESCRIPTION}.unfinished"
    unfinished.write_text(text + "\n", encoding="utf-8")
    os.replace(unfinished, folder / _DESCRIPTION)


def read_description(folder: Path, kind: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """What `write_description` was given, format and kind taken off.

    Raises:
        ValueError: No such file, no JSON, another kind, or other keys than these.
    """
    path = folder / _DESCRIPTION
    if not path.is_file():
        raise ValueError(f"{path} does not exist; the folder of a saved classifier would be right")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not JSON ({error})") from None
    found: dict[str, Any] = content if isinstance(content, dict) else {}
    for key, right in (("format", _FORMAT), ("kind", kind)):
        shown = found.pop(key, None)
        if shown != right:
            raise ValueError(f"{path}: {key} is {shown!r}; {right!r} would be right")
    for key in found:
        if key not in keys:
            raise ValueError(f"{path}: unknown key {key!r}; {suggestion(key, keys)}")
    for key in keys:
        if key not in found:
            raise ValueError(f"{path}: the key {key!r} is missing")
    return found


def write_weights(folder: Path, networks: Mapping[str, SequenceNetwork]) -> None:
    """Write the parameters of named networks."""
    folder.mkdir(parents=True, exist_ok=True)
    unfinished = folder / f"{_WEIGHTS}.unfinished"
    save_file(
        {name: parameter.detach().contiguous() for name, parameter in _named(networks).items()}, unfinished
    )
    os.replace(unfinished, folder / _WEIGHTS)


def read_weights(folder: Path, networks: Mapping[str, SequenceNetwork]) -> None:
    """Put the parameters that `write_weights` left into networks of the same architecture.

    Raises:
        ValueError: No such file, another format, other parameters, or numbers that are not finite.
    """
    path = folder / _WEIGHTS
    if not path.is_file():
        raise ValueError(f"{path} does not exist; the folder of a saved classifier would be right")
    try:
        saved = load_file(path)
    except SafetensorError as error:
        raise ValueError(f"{path} is not a safetensors file ({error})") from None
    wanted = _named(networks)
    for name in saved.keys() | wanted.keys():
        there, here = (tuple(one[name].shape) if name in one else None for one in (saved, wanted))
        if there != here:
            raise ValueError(f"{path}: {name} has the shape {there}; {here} would be right")
    for name, value in saved.items():
        if not bool(torch.isfinite(value).all()):
            raise ValueError(f"{path}: {name} has a number that is not finite")
    with torch.no_grad():
        for name, parameter in wanted.items():
            parameter.copy_(saved[name])


def _named(networks: Mapping[str, SequenceNetwork]) -> dict[str, torch.Tensor]:
    return {
        f"{network}.{name}": parameter
        for network, module in networks.items()
        for name, parameter in (*module.named_parameters(), *module.named_buffers())
    }
