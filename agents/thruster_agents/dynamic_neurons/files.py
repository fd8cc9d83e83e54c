"""Classifiers in folders: numbers of networks in a safetensors file, all the rest in a JSON file; no pickle.

```
<folder>/classifier.json       format, kind, settings, thresholds
<folder>/weights.safetensors   parameters, by the names of networks and layers
```

Each file is written whole or not at all. What is read is checked: kind, keys, names, types and shapes of
parameters, finite numbers; shapes before a network is made, so that no description makes one that is larger
than its file. Left out: the state of an unfinished training; `train` has checkpoints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from thruster_agents.dynamic_neurons.networks import Architecture, SequenceNetwork
from thruster_agents.files import read_json, write_json, write_whole
from thruster_envs.configuration import shown, suggestion

__all__ = [
    "check_weights",
    "number_of",
    "read_description",
    "read_weights",
    "write_description",
    "write_weights",
]

_FORMAT = "thruster_agents.dynamic_neurons 1"
_DESCRIPTION, _WEIGHTS = "classifier.json", "weights.safetensors"


def write_description(folder: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write the JSON file of a classifier; the folder is made where there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / _DESCRIPTION, {"format": _FORMAT, "kind": kind, **content})


def read_description(folder: Path, kind: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """What `write_description` was given, format and kind taken off.

    Raises:
        ValueError: No such file, no JSON (see `read_json`), another kind, or other keys than these.
    """
    path = folder / _DESCRIPTION
    if not path.is_file():
        raise ValueError(f"{path} does not exist; the folder of a saved classifier would be right")
    found = read_json(path)
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
    named = {name: parameter.detach().contiguous() for name, parameter in _named(networks).items()}
    write_whole(folder / _WEIGHTS, save(named))


def check_weights(
    folder: Path, architecture: Architecture, names: Iterable[str], build: Callable[[], SequenceNetwork]
) -> None:
    """Check that the file has the parameters of such networks, before one is made.

    Args:
        folder: Of the classifier.
        architecture: Of each network.
        names: Of the networks.
        build: Makes one.

    Raises:
        ValueError: No such file, another format, or other parameters.
    """
    shapes = _shapes(folder)
    sizes = (*architecture.hidden, architecture.order)
    largest = max((one for shape in shapes.values() for one in shape), default=0)
    if max(sizes) > 3 * largest + 1 or len(sizes) > len(shapes) + 1:
        raise ValueError(
            f"{folder / _WEIGHTS} has {len(shapes)} parameters with at most {largest} rows or columns, too "
            f"few for hidden layers of {shown(architecture.hidden)} and order {architecture.order}"
        )
    with torch.device("meta"):  # shapes without memory
        network = build()
    _compare(
        folder,
        shapes,
        {name: tuple(one.shape) for name, one in _named(dict.fromkeys(names, network)).items()},
    )


def read_weights(folder: Path, networks: Mapping[str, SequenceNetwork]) -> None:
    """Put the parameters that `write_weights` left into networks of the same architecture.

    Raises:
        ValueError: No such file, another format, other parameters, or numbers that are not finite.
    """
    path = folder / _WEIGHTS
    wanted = _named(networks)
    _compare(folder, _shapes(folder), {name: tuple(one.shape) for name, one in wanted.items()})
    with safe_open(path, framework="pt") as file:
        saved = {name: file.get_tensor(name) for name in wanted}
    for name, value in saved.items():
        if value.dtype != wanted[name].dtype:
            raise ValueError(f"{path}: {name} must be of type {wanted[name].dtype}, got {value.dtype}")
        if not bool(torch.isfinite(value).all()):
            raise ValueError(f"{path}: {name} has a number that is not finite")
    with torch.no_grad():
        for name, parameter in wanted.items():
            parameter.copy_(saved[name])


def number_of(value: object, where: str) -> float:
    """A finite number that was read.

    Raises:
        ValueError: Something else; `where` it stands is at the head of the line.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{where} is {value!r}; a number would be right")
    if not -1e300 < value < 1e300:
        raise ValueError(f"{where} must be a finite number, got {shown(value)}")
    return float(value)


def _shapes(folder: Path) -> dict[str, tuple[int, ...]]:
    """Those of the parameters in the file, from its header alone."""
    path = folder / _WEIGHTS
    if not path.is_file():
        raise ValueError(f"{path} does not exist; the folder of a saved classifier would be right")
    try:
        with safe_open(path, framework="pt") as file:
            return {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{path} is not a safetensors file ({' '.join(str(error).split())})") from None


def _compare(folder: Path, saved: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for name in sorted(saved.keys() | wanted.keys()):
        there, here = saved.get(name), wanted.get(name)
        if there != here:
            raise ValueError(f"{folder / _WEIGHTS}: {name} has the shape {there}; {here} would be right")


def _named(networks: Mapping[str, SequenceNetwork]) -> dict[str, torch.Tensor]:
    return {
        f"{network}.{name}": parameter
        for network, module in networks.items()
        for name, parameter in (*module.named_parameters(), *module.named_buffers())
    }
