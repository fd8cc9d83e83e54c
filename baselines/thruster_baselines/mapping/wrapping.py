"""Mappers around another mapper, and what those of them share that remember earlier commands.

What is wrapped can be any mapper without a memory of its own. The wrapper asks it with the same beliefs
(`effectiveness`, `max_on_time`) that a call brings.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.mapping.base import BaseMapper
from thruster_baselines.mapping.model import Model
from thruster_envs.configuration import shown
from thruster_envs.protocols import Allocation, FloatArray, Mapper, MapperWithMemory

__all__ = ["Memory", "RememberingMapper", "WrappingMapper", "achieved_rate_change"]

Memory = dict[str, NDArray[Any]]
"""What is remembered, by name; the first axis of each array is the craft."""


class WrappingMapper(BaseMapper):
    """A mapper that makes something else of another one's answers.

    Args:
        mapper: The mapper within.

    Attributes:
        mapper: The mapper within.
        effectiveness: (m, n), m/s^2 then rad/s^2, that of the mapper within; read-only.
        max_on_time: (n,), s, that of the mapper within; read-only.

    Raises:
        ValueError: Something else than a mapper, or one that has a memory of its own.
    """

    #: What the mapper within may be, for the error line.
    _within = "LPMapper(spacecraft)"

    def __init__(self, mapper: Mapper) -> None:
        if not hasattr(mapper, "max_on_time"):
            raise ValueError(f"mapper must be a mapper such as {self._within}, got {shown(mapper)}")
        if isinstance(mapper, MapperWithMemory):
            raise ValueError(
                f"the mapper within is a {type(mapper).__name__}, which carries over by itself; "
                "one without a memory would be right"
            )
        self.mapper = mapper
        self._model = Model(
            np.array(mapper.effectiveness, dtype=np.float64), np.array(mapper.max_on_time, dtype=np.float64)
        )

    def _ask(self, command: FloatArray, model: Model) -> Allocation:
        """The answer of the mapper within."""
        if model is self._model:
            return self.mapper(command)
        return self.mapper(command, effectiveness=model.effectiveness, max_on_time=model.max_on_time)


class RememberingMapper(WrappingMapper):
    """A wrapper whose answer depends on the commands before.

    It takes commands (m,) or (steps, m) of one craft, or ([steps,] worlds, m) of several that fly side by
    side; steps in their order. Each craft has a memory of its own. A call that raises changes no memory.

    Args:
        mapper: The mapper within.
        worlds: How many craft fly side by side; None for one.

    Attributes:
        worlds: How many craft fly side by side; None for one.
        remainder: (m,) or (worlds, m), m/s then rad/s: what is carried over to the next command.
    """

    def __init__(self, mapper: Mapper, worlds: int | None = None) -> None:
        super().__init__(mapper)
        if worlds is not None and worlds < 1:
            raise ValueError(f"worlds is {worlds}; one or more, or None for one craft, would be right")
        self.worlds = worlds
        self._craft = () if worlds is None else (worlds,)
        self._memory = self._nothing()

    @property
    @abstractmethod
    def remainder(self) -> FloatArray:
        """(m,) or (worlds, m): what is carried over to the next command, m/s then rad/s; a copy."""

    def forget(self, worlds: ArrayLike | None = None) -> None:
        """Owe nothing any more.

        Args:
            worlds: Which craft, as a mask (worlds,); all by default.

        Raises:
            ValueError: A mask of another shape, or one for a mapper that serves one craft.
        """
        if worlds is None:
            self._memory = self._nothing()
            return
        mask = np.asarray(worlds)
        if mask.dtype != np.bool_ or mask.shape != self._craft or not self._craft:
            right = f"a bool array of shape {self._craft}" if self._craft else "None, for one craft,"
            raise ValueError(f"the mask of worlds to forget is {worlds!r}; {right} would be right")
        for remembered in self._memory.values():
            remembered[mask] = 0

    def save_state(self) -> Memory:
        """What is remembered, as copies by name."""
        return {name: remembered.copy() for name, remembered in self._memory.items()}

    def restore_state(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `save_state` gave.

        Raises:
            ValueError: What was saved is of other craft, or of another mapper.
        """
        shapes = {name: np.shape(array) for name, array in saved.items()}
        right = {name: array.shape for name, array in self._memory.items()}
        if shapes != right:
            raise ValueError(f"what was saved has the shapes {shapes}; {right} would be right")
        self._memory = {
            name: np.array(saved[name], dtype=remembered.dtype) for name, remembered in self._memory.items()
        }

    @abstractmethod
    def _nothing(self) -> Memory:
        """The memory of craft that owe nothing: zeros."""

    @abstractmethod
    def _step(self, command: FloatArray, model: Model, memory: Memory) -> tuple[Allocation, Memory]:
        """Answer one command of each craft (*craft, m); returns the memory after it as new arrays."""

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        m, axes = self._model.effectiveness.shape[0], len(self._craft)
        steps = command.ndim - 1 - axes
        if steps not in (0, 1) or command.shape[steps:-1] != self._craft:
            right = "(m,) or (steps, m)" if self.worlds is None else "(worlds, m) or (steps, worlds, m)"
            raise ValueError(
                f"command has the shape {command.shape}; {right} with m = {m}"
                f"{'' if self.worlds is None else f' and worlds = {self.worlds}'} would be right"
            )
        for array, trailing in ((model.effectiveness, 2), (model.max_on_time, 1)):
            if array.shape[:-trailing] not in ((), self._craft):
                raise ValueError(
                    f"a belief has the leading axes {array.shape[:-trailing]}; none"
                    f"{f', or {self._craft} to give each craft its own,' if self._craft else ''} "
                    "would be right"
                )
        memory = self._memory
        if steps == 0:
            allocation, self._memory = self._step(command, model, memory)
            return allocation
        n = self._model.max_on_time.size
        on_times, slack = np.empty((*command.shape[:-1], n)), np.empty(command.shape)
        cost, status = np.empty(command.shape[:-1]), np.empty(command.shape[:-1], np.int64)
        for step in range(len(command)):
            one, memory = self._step(command[step], model, memory)
            on_times[step], slack[step], cost[step], status[step] = (
                one.on_times, one.slack, one.cost, one.status,
            )  # fmt: skip
        self._memory = memory
        return Allocation(on_times, slack, cost, status)


def achieved_rate_change(effectiveness: FloatArray, on_times: FloatArray) -> FloatArray:
    """What on-times (..., n) achieve, (..., m), summed in the order of the thrusters whatever the batch.

    Args:
        effectiveness: (..., m, n), m/s^2 then rad/s^2.
        on_times: (..., n), s.
    """
    total = effectiveness[..., 0] * on_times[..., 0, np.newaxis]
    for thruster in range(1, on_times.shape[-1]):
        total = total + effectiveness[..., thruster] * on_times[..., thruster, np.newaxis]
    return total
