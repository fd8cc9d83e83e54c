"""What became of flights: arrays by name, of any number of episodes, in memory and in files.

A :class:`Recording` holds *channels*. Each has one entry for each episode, for each *instant* (the reset and
the end of each step), or for each *step*; entry ``k`` of a step's channel lies between the instants ``k`` and
``k + 1``. Episodes may differ in length: their entries follow each other, and ``recording[3]`` is one of
them. A recording knows the truth; what a policy was shown is in the channel ``observation``.

>>> from thruster_envs.rollout import fly
>>> recording = fly("thruster_envs/OrionRendezvous-v1", "idle", seeds=range(3), steps=4)
>>> len(recording), recording.position.shape, recording[1].position.shape, recording.duty.shape
(3, (15, 3), (5, 3), (12, 12))
>>> recording.channels["position"].unit, recording.padded("time")[:, -1].tolist()
('m', [20.0, 20.0, 20.0])

Files: ``.npz`` and ``.parquet`` are the smallest, ``.csv`` is for a look; all three give back the same bits.
In tables a row is an instant, numbers of steps stand in the row in which the step begins, and those of an
episode in every row.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from thruster_envs.configuration import nearest, shown

Per: TypeAlias = Literal["episode", "instant", "step"]
Array: TypeAlias = NDArray[Any]

FORMAT = 1
"""Of the files; a later version reads earlier ones."""


@dataclass(frozen=True, slots=True)
class Channel:
    """What an array of a recording is.

    Attributes:
        per: What there is an entry of: each episode, instant or step.
        unit: Of all its numbers; "1" where they have none.
        labels: For each axis behind the first, the names of its entries.
    """

    per: Per
    unit: str = "1"
    labels: tuple[tuple[str, ...], ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one entry."""
        return tuple(len(axis) for axis in self.labels)

    def columns(self, name: str) -> list[str]:
        """Names of the columns of a table that hold it.

        >>> Channel("instant", "m", (("x", "y", "z"),)).columns("position")
        ['position_x', 'position_y', 'position_z']
        """
        return ["_".join((name, *labels)) for labels in itertools.product(*self.labels)]


class Recording:
    """Flights, as arrays by name.

    A channel is an attribute, ``recording.position``, or an item, ``recording["reward_terms/fuel"]``; those
    whose names begin alike are a dictionary, ``recording.reward_terms["fuel"]``. ``recording[2]``,
    ``recording[1:3]`` and ``recording[recording.final("success")]`` are recordings of some of the episodes.

    Args:
        channels: What each array is.
        arrays: Of each channel its numbers, (entries, ...), episode after episode.
        lengths: (episodes,), steps of each episode.
        seeds: Of each episode.
        sources: How the flights were made, as plain data; see :attr:`metadata`.
        source: (episodes,), number of the source of each, from 0; by default all are of the first.

    Raises:
        ValueError: Arrays that do not fit the channels, or lengths.
    """

    def __init__(
        self,
        channels: Mapping[str, Channel],
        arrays: Mapping[str, Array],
        lengths: Sequence[int] | Array,
        seeds: Sequence[int],
        sources: Sequence[Mapping[str, Any]] = ({},),
        source: Sequence[int] | Array | None = None,
    ) -> None:
        self.channels, self.arrays = dict(channels), dict(arrays)
        self.lengths: NDArray[np.int64] = np.array(lengths, np.int64).reshape(-1)
        self.seeds = tuple(int(seed) for seed in seeds)
        self.sources = tuple(dict(one) for one in sources)
        episodes = self.lengths.size
        self.source: NDArray[np.int64] = (
            np.zeros(episodes, np.int64) if source is None else np.array(source, np.int64).reshape(-1)
        )
        if (self.lengths < 0).any():
            raise ValueError(f"lengths must be at least 0, got {self.lengths.min()}")
        if len(self.seeds) != episodes or self.source.size != episodes:
            raise ValueError(
                f"there must be a seed and a source for each of {episodes} episodes, "
                f"got {len(self.seeds)} and {self.source.size}"
            )
        if episodes and not (self.source.min() >= 0 and self.source.max() < len(self.sources)):
            raise ValueError(f"source must be from 0 to {len(self.sources) - 1}, got {self.source.max()}")
        if self.channels.keys() != self.arrays.keys():
            odd = sorted(self.channels.keys() ^ self.arrays.keys())[0]
            raise ValueError(f"every channel must have its array, got {odd!r} on one side only")
        for name, channel in self.channels.items():
            right = (self._entries(channel.per), *channel.shape)
            if self.arrays[name].shape != right:
                raise ValueError(f"{name} must have the shape {right}, got {self.arrays[name].shape}")

    # Reading -------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        """Number of episodes."""
        return int(self.lengths.size)

    def __iter__(self) -> Iterator[Recording]:
        """The episodes one by one."""
        return (self[k] for k in range(len(self)))

    def __getitem__(self, key: Any) -> Any:
        """A channel by name; or a recording of an episode, or of several, as NumPy takes them."""
        if isinstance(key, str):
            if key in self.arrays:
                return self.arrays[key]
            raise KeyError(self._unknown(key))
        key = np.asarray(key, None if key else np.int64) if isinstance(key, list) else key
        which = np.atleast_1d(np.arange(len(self))[key])
        arrays = {
            name: np.concatenate(
                [self.arrays[name][self._rows(channel.per, k)] for k in which] or [self.arrays[name][:0]]
            )
            for name, channel in self.channels.items()
        }
        used, source = np.unique(self.source[which], return_inverse=True)
        return Recording(
            self.channels, arrays, self.lengths[which], [self.seeds[k] for k in which],
            [self.sources[k] for k in used] or self.sources[:1], source,
        )  # fmt: skip

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or "arrays" not in self.__dict__:
            raise AttributeError(name)
        if name in self.arrays:
            return self.arrays[name]
        group = {
            one[len(name) + 1 :]: array for one, array in self.arrays.items() if one.startswith(f"{name}/")
        }
        if group:
            return group
        raise AttributeError(self._unknown(name))

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *{name.partition("/")[0] for name in self.arrays}]

    def __repr__(self) -> str:
        steps = int(self.lengths.sum())
        return f"Recording({len(self)} episodes, {steps:,} steps, channels {', '.join(self.channels)})"

    @property
    def metadata(self) -> dict[str, Any]:
        """How the flights were made, as far as that is the same for all: environment, policy, versions."""
        used = [self.sources[k] for k in np.unique(self.source)] or [self.sources[0]]
        return {
            key: value
            for key, value in used[0].items()
            if all(key in other and other[key] == value for other in used[1:])
        }

    @property
    def episode(self) -> NDArray[np.int64]:
        """(instants,), the number of the episode, from 0, that each instant belongs to."""
        return np.repeat(np.arange(len(self)), self.lengths + 1)

    @property
    def returns(self) -> Array:
        """(episodes, ...), sum of the rewards of each."""
        reward = self["reward"]
        sums = [reward[self._rows("step", k)].sum(axis=0) for k in range(len(self))]
        return np.array(sums).reshape(len(self), *reward.shape[1:])

    def final(self, name: str) -> Array:
        """(episodes, ...), what a channel was last in each episode.

        Raises:
            ValueError: A channel of steps, where an episode has none.
        """
        array, per = self[name], self.channels[name].per
        if per == "episode":
            return np.array(array)
        if per == "step" and not self.lengths.all():
            raise ValueError(f"{name} has no last entry in an episode without a step")
        return np.array(array[np.cumsum(self.lengths + (per == "instant")) - 1])

    def padded(self, name: str, fill: Any = None) -> Array:
        """(episodes, longest, ...): a channel of instants or steps, with one row for each episode.

        Args:
            name: Of the channel.
            fill: What stands behind the end of the shorter ones; NaN, 0 or False by default.
        """
        array, per = self[name], self.channels[name].per
        if per == "episode":
            return np.array(array)
        most = int(self.lengths.max(initial=0)) + (per == "instant")
        if fill is None:
            fill = np.nan if array.dtype.kind == "f" else array.dtype.type(0)
        result = np.full((len(self), most, *array.shape[1:]), fill, array.dtype)
        for k in range(len(self)):
            rows = array[self._rows(per, k)]
            result[k, : len(rows)] = rows
        return result

    def _entries(self, per: Per) -> int:
        if per == "episode":
            return len(self)
        return int(self.lengths.sum()) + (len(self) if per == "instant" else 0)

    def _rows(self, per: Per, episode: int) -> slice:
        """Where an episode stands in arrays of that kind."""
        if per == "episode":
            return slice(episode, episode + 1)
        counts = self.lengths + (per == "instant")
        first = int(counts[:episode].sum())
        return slice(first, first + int(counts[episode]))

    def _unknown(self, name: str) -> str:
        near = nearest(name, self.channels)
        hint = f"there are {', '.join(self.channels)}" if near is None else f"did you mean {near!r}?"
        return f"{name!r} is not recorded; {hint}"

    # Files ---------------------------------------------------------------------------------------------

    def save(self, path: str | PathLike[str]) -> None:
        """Write a ``.npz``, ``.parquet`` or ``.csv`` file, whole or not at all.

        Raises:
            ValueError: Another ending.
            ModuleNotFoundError: For ``.parquet``, where PyArrow misses: one line with the command.
            OSError: The system refuses.
        """
        from thruster_envs import recording_files

        recording_files.write(self, Path(path))

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Recording:
        """Read what :meth:`save` wrote.

        Raises:
            ValueError: Another ending, or a damaged file: one line that begins with its name.
            ModuleNotFoundError: As of :meth:`save`.
        """
        from thruster_envs import recording_files

        return recording_files.read(Path(path))

    def to_npz(self, path: str | PathLike[str]) -> None:
        """:meth:`save` as arrays by name, whatever the file is called."""
        from thruster_envs import recording_files

        recording_files.write(self, Path(path), ".npz")

    def to_parquet(self, path: str | PathLike[str]) -> None:
        """:meth:`save` as a Parquet table with units in its schema, whatever the file is called."""
        from thruster_envs import recording_files

        recording_files.write(self, Path(path), ".parquet")

    def to_csv(self, path: str | PathLike[str]) -> None:
        """:meth:`save` as text, whatever the file is called."""
        from thruster_envs import recording_files

        recording_files.write(self, Path(path), ".csv")


def concatenate(recordings: Sequence[Recording]) -> Recording:
    """The episodes of several recordings as one.

    Raises:
        ValueError: None at all, or recordings whose channels are not the same.
    """
    if not recordings:
        raise ValueError("recordings must have at least one, got none")
    first = recordings[0]
    for number, other in enumerate(recordings[1:], start=2):
        for name in (*first.channels, *other.channels):
            here, there = first.channels.get(name), other.channels.get(name)
            if here != there:
                which = "has another" if here and there else ("lacks" if here else "alone has")
                raise ValueError(f"recordings must have the same channels; number {number} {which} {name!r}")
    sources: list[Mapping[str, Any]] = []
    source: list[int] = []
    for one in recordings:
        numbers = []
        for made in one.sources:
            if made not in sources:
                sources.append(made)
            numbers.append(sources.index(made))
        source += [numbers[k] for k in one.source]
    return Recording(
        first.channels,
        {name: np.concatenate([one.arrays[name] for one in recordings]) for name in first.channels},
        np.concatenate([one.lengths for one in recordings]),
        [seed for one in recordings for seed in one.seeds],
        sources,
        source,
    )


# The head of a file ----------------------------------------------------------------------------------------


def header_of(recording: Recording) -> str:
    """Everything of a recording but its numbers, as JSON."""
    return json.dumps(
        {
            "recording": FORMAT,
            "channels": {
                name: {
                    "per": channel.per,
                    "unit": channel.unit,
                    "labels": channel.labels,
                    "type": recording.arrays[name].dtype.str,
                }
                for name, channel in recording.channels.items()
            },
            "lengths": recording.lengths.tolist(),
            "seeds": recording.seeds,
            "sources": recording.sources,
            "source": recording.source.tolist(),
        }
    )


@dataclass(frozen=True)
class Header:
    """What :func:`header_of` says.

    Attributes:
        channels: What each array is.
        types: Of the numbers of each.
        lengths: (episodes,), steps.
        seeds: Of each episode.
        sources: How the flights were made.
        source: (episodes,), numbers of the sources.
    """

    channels: dict[str, Channel]
    types: dict[str, np.dtype[Any]]
    lengths: list[int]
    seeds: list[int]
    sources: list[dict[str, Any]]
    source: list[int]

    @classmethod
    def parse(cls, text: str | bytes) -> Header:
        """The header in a file.

        Raises:
            ValueError: Something else; one line.
        """
        try:
            found = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"its header is not JSON ({' '.join(str(error).split())})") from None
        if not isinstance(found, dict) or found.get("recording") != FORMAT:
            version = found.get("recording") if isinstance(found, dict) else None
            raise ValueError(f"it must be a recording of format {FORMAT}, got {shown(version)}")
        try:
            channels = {
                name: Channel(one["per"], one["unit"], tuple(tuple(axis) for axis in one["labels"]))
                for name, one in found["channels"].items()
            }
            types = {name: _plain_type(one["type"]) for name, one in found["channels"].items()}
            header = cls(
                channels, types, *(found[name] for name in ("lengths", "seeds", "sources", "source"))
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"its header is damaged ({type(error).__name__}: {error})") from None
        header._check()
        return header

    def _check(self) -> None:
        numbers = (self.lengths, self.seeds, self.source)
        whole = all(type(one) is list and all(type(k) is int and k >= 0 for k in one) for one in numbers)
        plain = type(self.sources) is list and all(type(one) is dict for one in self.sources)
        strings = all(
            type(channel.unit) is str
            and channel.per in ("episode", "instant", "step")
            and all(type(label) is str for axis in channel.labels for label in axis)
            for channel in self.channels.values()
        )
        if not (whole and plain and strings) or max(self.lengths, default=0) >= 2**40:
            raise ValueError("its header is damaged (a value of another type than it should have)")

    @property
    def instants(self) -> int:
        """Number of instants of all episodes."""
        return sum(self.lengths) + len(self.lengths)

    def recording(self, arrays: Mapping[str, Array]) -> Recording:
        """The recording with these arrays.

        Raises:
            ValueError: Arrays that do not fit.
        """
        for name, kind in self.types.items():
            if name in arrays and arrays[name].dtype != kind:
                raise ValueError(f"{name} must be of type {kind}, got {arrays[name].dtype}")
        return Recording(self.channels, arrays, self.lengths, self.seeds, self.sources, self.source)


def _plain_type(text: Any) -> np.dtype[Any]:
    kind: np.dtype[Any] = np.dtype(text)
    if kind.kind not in "biuf":
        raise TypeError(f"type {text}")
    return kind
