"""What an agent observes, as a list of fields: the source of spaces, of tables on pages, and of readings.

An observation is float32 and dimensionless. A :class:`Field` says what a group of its entries is and what 1
stands for in SI units; a :class:`Reader` turns observations back into SI values by name:

>>> import gymnasium as gym
>>> import thruster_envs
>>> env = gym.make("thruster_envs/OrionRendezvous-v1")
>>> observation, info = env.reset(seed=0)
>>> reading = Reader.of(env)(observation)
>>> reading.position.round()  # m, LVLH
array([301.,   3.,  -4.])
>>> reading.time_to_go  # s
array([2855.])

Left out: what a wrapper adds to an observation, and values beyond a bound, which are clipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.configuration import nearest

__all__ = ["Field", "Reader", "Reading", "page_rows", "written"]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Field:
    """A group of neighbouring entries of an observation.

    Attributes:
        name: Under which a reading has its value; an identifier.
        meaning: What it is, as the environment's page has it.
        size: Number of entries, 0 or more.
        unit: SI unit of the quantity.
        scale: What an entry of 1 stands for, in ``unit``: one number, or one for each entry.
        reference: What that is, in words; empty where number and unit say it.
        bound: Largest entry; what is larger is clipped.
        lowest: Smallest entry; None means minus ``bound``.

    Raises:
        ValueError: A size that is no whole number from 0; scales of another number.

    >>> Field("velocity", "measured velocity", 3, "m/s", 0.2, bound=5.0).label
    '0.2 m/s'
    """

    name: str
    meaning: str
    size: int
    unit: str = "1"
    scale: float | tuple[float, ...] = 1.0
    reference: str = ""
    bound: float = 1.0
    lowest: float | None = None

    def __post_init__(self) -> None:
        size: Any = self.size
        if isinstance(size, bool) or not isinstance(size, int | np.integer) or size < 0:
            raise ValueError(f"size of {self.name!r} must be a whole number from 0, got {size!r}")
        if isinstance(self.scale, tuple) and len(self.scale) != self.size:
            raise ValueError(
                f"scale of {self.name!r} must be one number or {self.size}, got {len(self.scale)} of them"
            )

    @property
    def low(self) -> float:
        """Smallest value of an entry."""
        return -self.bound if self.lowest is None else self.lowest

    @property
    def label(self) -> str:
        """What an entry of 1 stands for, as the environment's page has it."""
        if self.reference:
            return self.reference
        return self.unit if self.scale == 1.0 and self.unit == "1" else f"{self.scale:g} {self.unit}"


def page_rows(fields: tuple[Field, ...]) -> list[str]:
    """Rows of the table of an environment's page: index, meaning, least and largest entry, unit.

    >>> page_rows((Field("velocity", "measured velocity", 3, "m/s", bound=5.0),))
    ['| 0-2 | measured velocity | -5 | 5 | 1 m/s |']
    """
    rows, first = [], 0
    for field in fields:
        last = first + field.size - 1
        index = f"{first}-{last}" if last > first else f"{first}"
        rows.append(f"| {index} | {field.meaning} | {field.low:g} | {field.bound:g} | {field.label} |")
        first = last + 1
    return rows


def written(fields: tuple[Field, ...], **values: ArrayLike) -> NDArray[np.float32]:
    """An observation of SI values by name, each divided by its scale and clipped to its bounds.

    Args:
        fields: What is observed, in order.
        **values: (..., entries) of each field. Where a scale is 0 the entry is 0.

    >>> fields = (Field("velocity", "measured velocity", 3, "m/s", 0.5, bound=5.0),)
    >>> written(fields, velocity=[1.0, -9.0, 0.2])
    array([ 2. , -5. ,  0.4], dtype=float32)
    """
    parts = []
    for field in fields:
        value, scale = np.asarray(values[field.name], np.float64), np.asarray(field.scale)
        entries = np.divide(value, scale, out=np.zeros(value.shape), where=scale != 0.0)
        parts.append(entries.clip(field.low, field.bound))
    return np.concatenate(parts, axis=-1, dtype=np.float32)


@dataclass(frozen=True)
class Reader:
    """Reads observations of a task: of one agent or of a batch, whole arrays at a time.

    Attributes:
        fields: What is observed, in order.
    """

    fields: tuple[Field, ...]

    @classmethod
    def of(cls, environment: Any, **settings: Any) -> Reader:
        """The reader of an environment.

        Args:
            environment: Any environment of this suite, of any view and within any wrappers that leave the
                entries of its observations as they are; or an id of Gymnasium's, for which no environment is
                made.
            **settings: Of the task, where an id is given: the arguments that ``gym.make`` would have. Those
                of views alone, such as ``render_mode``, change nothing.

        Raises:
            ValueError: Another environment; a wrapper that changes observations, such as Gymnasium's
                ``RescaleObservation``; a setting that cannot be.
            TypeError: An unknown setting, or settings beside an environment.

        >>> Reader.of("thruster_envs/MarsRendezvous-v1", distance=15.0).columns("velocity")
        slice(6, 9, None)
        """
        if isinstance(environment, str):
            task = _task_of_id(environment, settings)
        elif settings:
            raise TypeError(f"settings must be empty beside an environment, got {', '.join(settings)}")
        else:
            task = getattr(getattr(environment, "unwrapped", environment), "task", None)
            spec: Any = getattr(environment, "spec", None)
            if task is None and isinstance(getattr(spec, "id", None), str):  # one of Gymnasium's own batches
                task = _task_of_id(spec.id, dict(spec.kwargs))
        fields = getattr(task, "observation_fields", None)
        if fields is None:
            raise ValueError(f"environment must be one of thruster_envs or its id, got {environment}")
        reader = cls(tuple(fields))
        if not isinstance(environment, str):
            _check_unchanged(environment, reader)
        return reader

    @overload
    def __call__(self, observation: Mapping[str, ArrayLike]) -> dict[str, Reading]: ...

    @overload
    def __call__(self, observation: ArrayLike) -> Reading: ...

    def __call__(self, observation: Any) -> Any:
        """What an observation says.

        Args:
            observation: (..., size); what a wrapper has added behind it is not read. Or one for each agent,
                by name, as PettingZoo has them.

        Returns:
            A reading, whose values are (..., entries); or one for each agent, by name.

        Raises:
            ValueError: An observation without an axis. One that is too short for a field: when that is read.
        """
        if isinstance(observation, Mapping):
            return {agent: self(one) for agent, one in observation.items()}
        rows = np.asarray(observation, dtype=np.float64)
        if rows.ndim == 0:
            raise ValueError(f"observation must have the shape (..., {self.size}) or more, got {rows.shape}")
        return Reading(self, rows)

    @cached_property
    def size(self) -> int:
        """Number of entries of an observation."""
        return sum(field.size for field in self.fields)

    def __contains__(self, name: str) -> bool:
        """Whether there is a field of that name."""
        return name in self._places

    def field(self, name: str) -> Field:
        """The field of a name.

        Raises:
            KeyError: There is none.
        """
        return self._place(name)[0]

    def columns(self, name: str) -> slice:
        """Where the entries of a field stand in an observation.

        Raises:
            KeyError: There is none of that name.
        """
        return self._place(name)[1]

    def scale(self, name: str) -> Any:
        """What 1 stands for in an entry of a field, SI: a number, or an array (entries,).

        Raises:
            KeyError: There is none of that name.
        """
        return self._place(name)[2]

    def _place(self, name: str) -> tuple[Field, slice, Any]:
        if name not in self._places:
            near = nearest(name, list(self._places))
            hint = f"did you mean {near!r}?" if near else f"there are {', '.join(self._places)}"
            raise KeyError(f"the observation has no field {name!r}; {hint}")
        return self._places[name]

    @cached_property
    def _places(self) -> dict[str, tuple[Field, slice, Any]]:
        places, first = {}, 0
        for field in self.fields:
            scale = np.array(field.scale) if isinstance(field.scale, tuple) else field.scale
            places[field.name] = field, slice(first, first + field.size), scale
            first += field.size
        return places


class Reading:
    """What an observation says: the value of each field by its name, in SI units, float64 (..., entries).

    ``reading.velocity`` and ``reading["velocity"]`` are the same.

    Attributes:
        rows: (..., size or more), the observation, float64.
    """

    def __init__(self, reader: Reader, rows: FloatArray) -> None:
        self._reader, self.rows = reader, rows

    def __getitem__(self, name: str) -> FloatArray:
        return np.asarray(self._reader.scale(name) * self._entries(name))

    def __getattr__(self, name: str) -> FloatArray:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None

    def __dir__(self) -> list[str]:
        """Attributes, the names of the fields among them."""
        return [*super().__dir__(), *(field.name for field in self._reader.fields)]

    def entries(self, *names: str) -> FloatArray:
        """(..., entries) of these fields, one after another, as they stand in the observation."""
        parts = [self._entries(name) for name in names]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=-1)

    def within(self, *names: str) -> BoolArray:
        """(..., entries) of these fields: whether each is a number and not at a bound."""
        parts = []
        for name in names:
            field, entries = self._reader.field(name), self._entries(name)
            parts.append((entries > field.low) & (entries < field.bound))
        return np.concatenate(parts, axis=-1)

    def _entries(self, name: str) -> FloatArray:
        columns = self._reader.columns(name)
        if self.rows.shape[-1] < columns.stop:
            raise ValueError(
                f"observation must have the shape (..., {columns.stop}) or more for {name!r}, "
                f"got {self.rows.shape}"
            )
        return np.asarray(self.rows[..., columns])


def _task_of_id(identifier: str, settings: dict[str, Any]) -> Any:
    """The task that ``gym.make`` would make of an id."""
    import gymnasium as gym
    from gymnasium.envs.registration import load_env_creator

    spec = gym.spec(identifier)
    creator = load_env_creator(spec.entry_point) if isinstance(spec.entry_point, str) else spec.entry_point
    task_of = getattr(creator, "task_of", None)
    given = {name: value for name, value in (spec.kwargs | settings).items() if name not in _OF_VIEWS}
    return None if task_of is None else task_of(**given)


def _check_unchanged(environment: Any, reader: Reader) -> None:
    """Refuse wrappers that change entries of observations: by their space, or where that says nothing."""
    wrong, layer = None, environment
    while layer is not None:
        inner = vars(layer).get("env", vars(layer).get("venv"))
        if not all(_begins_with(space, reader) for space in _spaces(layer)) or _changes(layer, inner):
            wrong = layer
        layer = inner
    if wrong is not None:
        raise ValueError(
            f"environment must have wrappers that leave observations as they are, got {type(wrong).__name__}"
        )


def _spaces(layer: Any) -> list[Any]:
    """Observation spaces of an environment: of each agent where there are some."""
    space = getattr(layer, "observation_space", None)
    return [space(agent) for agent in layer.possible_agents] if callable(space) else [space]


def _begins_with(space: Any, reader: Reader) -> bool:
    """Whether observations of a space begin with the entries of a task."""
    low, high = getattr(space, "low", None), getattr(space, "high", None)
    if low is None or high is None or low.ndim == 0 or not np.issubdtype(low.dtype, np.floating):
        return False
    size, sizes = reader.size, [field.size for field in reader.fields]
    lowest = np.repeat(np.array([field.low for field in reader.fields], np.float32), sizes)
    highest = np.repeat(np.array([field.bound for field in reader.fields], np.float32), sizes)
    return bool(
        low.shape[-1] >= size and (low[..., :size] == lowest).all() and (high[..., :size] == highest).all()
    )


def _changes(layer: Any, inner: Any) -> bool:
    """Whether it is an observation wrapper that changes values, though its space is that within."""
    import gymnasium as gym

    if not isinstance(layer, gym.ObservationWrapper | gym.vector.VectorObservationWrapper):
        return False
    known = type(layer).__module__.startswith("gymnasium.") and type(layer).__name__ in _CHANGE_NOTHING
    return not known and bool(layer.observation_space == inner.observation_space)


#: Observation wrappers of Gymnasium's that leave the values of entries as they are.
_CHANGE_NOTHING = frozenset({
    "DelayObservation", "DtypeObservation", "FlattenObservation", "ReshapeObservation",
})  # fmt: skip
#: Arguments of ``gym.make`` and ``gym.make_vec`` that are not settings of a task.
_OF_VIEWS = frozenset({
    "render_mode", "flat_info", "max_episode_steps", "disable_env_checker", "num_envs", "vectorization_mode",
    "vector_kwargs", "wrappers", "autoreset_mode", "threads",
})  # fmt: skip
