"""Networks that predict one signal from several: of dynamic neurons, of static ones, and a recurrent unit.

All three stand behind one interface, `SequenceNetwork`: sequences in, sequence out, and the same on the own
past output in place of the last input. The dynamic network is Valdes 2008, sections 4.3 and 5.3 (2-10-1 and
4-10-1); the other two are for comparison and are not in the source.

Left out: more than one output, inputs that come with a delay.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import nn

from thruster_agents.dynamic_neurons.layers import DynamicLayer
from thruster_agents.dynamic_neurons.own_output import run_on_own_output
from thruster_envs.configuration import coerce_fields, require
from thruster_envs.protocols import FloatArray

__all__ = [
    "Architecture",
    "DynamicNetwork",
    "GRUNetwork",
    "SequenceNetwork",
    "StaticNetwork",
    "build_network",
]


@dataclass(frozen=True, kw_only=True)
class Architecture:
    """What a network is made of; with a generator it makes one, see `build_network`.

    Attributes:
        kind: `dynamic`, `static` (a dynamic network of order 0) or `gru`.
        hidden: Neurons of each hidden layer; of a GRU, the size of its state: one number.
        order: Of the filter of every dynamic neuron.
        output_dynamic: Whether the output neuron has a filter too.
        stable: Poles inside of the unit circle by construction.
        bias: Whether neurons have a trained constant; a GRU always has.
        memory: Shortest and longest time constant at the start, in samples; see `DynamicLayer`.
    """

    kind: Literal["dynamic", "static", "gru"] = "dynamic"
    hidden: tuple[int, ...] = (10,)
    order: int = 2
    output_dynamic: bool = True
    stable: bool = False
    bias: bool = False
    memory: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        coerce_fields(self)
        require(min(self.hidden, default=0) >= 1, "hidden", self.hidden, "one size or more, each 1 or more")
        require(self.kind != "gru" or len(self.hidden) == 1, "hidden of a GRU", self.hidden, "one size")
        dynamic = self.kind == "dynamic"
        require(not dynamic or self.order >= 1, "order of a dynamic network", self.order, "1 or more")


class SequenceNetwork(nn.Module, abc.ABC):
    """Predicts one signal, sample by sample, from several.

    Attributes:
        inputs: How many signals it sees.
    """

    inputs: int

    @abc.abstractmethod
    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, 1) of `inputs` (batch, time, inputs), from rest: of each sample, causally."""

    @abc.abstractmethod
    def _on_own_output(self, inputs: FloatArray) -> FloatArray:
        """(batch, time) of (batch, time, inputs - 1)."""

    def predict(self, inputs: ArrayLike) -> FloatArray:
        """The outputs (batch, time) for `inputs` (batch, time, inputs), as plain arrays.

        Raises:
            ValueError: Another shape.
        """
        seen = self._checked(inputs, self.inputs)
        with torch.no_grad():
            return np.asarray(self(torch.from_numpy(seen))[..., 0].numpy(), np.float64)

    def predict_in_parallel(self, inputs: ArrayLike) -> FloatArray:
        """The outputs (batch, time) when the last input is the network's own output one sample before.

        Args:
            inputs: (batch, time, inputs - 1), all but the last one; the first output fed back is zero.

        Raises:
            ValueError: Another shape.
        """
        return self._on_own_output(self._checked(inputs, self.inputs - 1))

    @property
    def parameter_count(self) -> int:
        """How many numbers are trained."""
        return sum(parameter.numel() for parameter in self.parameters() if parameter.requires_grad)

    def _checked(self, inputs: ArrayLike, wide: int) -> FloatArray:
        seen = np.ascontiguousarray(inputs, np.float64)
        if seen.ndim != 3 or seen.shape[2] != wide:
            raise ValueError(f"inputs has the shape {seen.shape}; (batch, time, {wide}) would be right")
        return seen


class DynamicNetwork(SequenceNetwork):
    """Layers of dynamic neurons, hyperbolic tangent inside, linear output; trained and run in float64.

    Args:
        sizes: Inputs, neurons of each layer, 1 at last.
        order: Of every filter.
        output_dynamic: Whether the output neuron has a filter too.
        stable, bias, memory, generator: As for `DynamicLayer`.

    Attributes:
        layers: The `DynamicLayer`s, in order.

    >>> DynamicNetwork((2, 10, 1)).parameter_count, DynamicNetwork((4, 10, 1)).parameter_count
    (96, 116)
    """

    def __init__(
        self,
        sizes: Sequence[int] = (2, 10, 1),
        *,
        order: int = 2,
        output_dynamic: bool = True,
        stable: bool = False,
        bias: bool = False,
        memory: tuple[float, float] | None = None,
        generator: torch.Generator | None = None,
    ) -> None:
        super().__init__()
        require(len(sizes) >= 2 and sizes[-1] == 1, "sizes", tuple(sizes), "inputs, hidden layers, 1 at last")
        self.inputs = sizes[0]
        last = len(sizes) - 2
        self.layers = nn.ModuleList(
            DynamicLayer(
                sizes[i],
                sizes[i + 1],
                order=order if i < last or output_dynamic else 0,
                activation="tanh" if i < last else "linear",
                stable=stable,
                bias=bias,
                memory=memory,
                generator=generator,
            )
            for i in range(last + 1)
        )

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, 1) of `inputs` (batch, time, inputs), from rest."""
        for layer in self.layers:
            inputs = layer(inputs)
        return inputs

    def _on_own_output(self, inputs: FloatArray) -> FloatArray:
        return run_on_own_output(list(self.layers), inputs)  # type: ignore[arg-type]


class StaticNetwork(DynamicNetwork):
    """A dynamic network without filters: no memory at all. Options as for `DynamicNetwork`.

    >>> StaticNetwork((2, 10, 1)).parameter_count
    41
    """

    def __init__(
        self,
        sizes: Sequence[int] = (2, 10, 1),
        *,
        bias: bool = False,
        generator: torch.Generator | None = None,
    ) -> None:
        super().__init__(sizes, order=0, bias=bias, generator=generator)


class GRUNetwork(SequenceNetwork):
    """A gated recurrent unit with a linear output, in float64.

    Args:
        inputs: How many signals it sees.
        hidden: Size of the state.
        generator: Draws the parameters, uniformly as torch does.

    >>> GRUNetwork(2, hidden=4).parameter_count
    101
    """

    def __init__(self, inputs: int, hidden: int = 4, *, generator: torch.Generator | None = None) -> None:
        super().__init__()
        require(inputs >= 1, "inputs", inputs, "1 or more")
        require(hidden >= 1, "hidden", hidden, "1 or more")
        self.inputs = inputs
        self.recurrence = nn.GRU(inputs, hidden, batch_first=True, dtype=torch.float64)
        self.output = nn.Linear(hidden, 1, dtype=torch.float64)
        with torch.no_grad():
            for parameter in self.parameters():
                parameter.uniform_(-(hidden**-0.5), hidden**-0.5, generator=generator)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, 1) of `inputs` (batch, time, inputs), from rest."""
        states, _ = self.recurrence(inputs)
        predicted: torch.Tensor = self.output(states)
        return predicted

    def _on_own_output(self, inputs: FloatArray) -> FloatArray:
        batch, time, _ = inputs.shape
        seen, given = torch.from_numpy(inputs), torch.zeros(batch, 1, dtype=torch.float64)
        state = torch.zeros(1, batch, self.recurrence.hidden_size, dtype=torch.float64)
        outputs = np.empty((batch, time))
        with torch.no_grad():
            for k in range(time):
                now, state = self.recurrence(torch.cat([seen[:, k], given], dim=1)[:, None], state)
                given = self.output(now[:, 0])
                outputs[:, k] = given[:, 0].numpy()
        return outputs


def build_network(
    architecture: Architecture, inputs: int, generator: torch.Generator | None = None
) -> SequenceNetwork:
    """A network of this architecture that sees so many signals.

    >>> build_network(Architecture(hidden=(10, 5), stable=True), inputs=3).layers[1].units
    5
    """
    if architecture.kind == "gru":
        return GRUNetwork(inputs, architecture.hidden[0], generator=generator)
    sizes = (inputs, *architecture.hidden, 1)
    if architecture.kind == "static":
        return StaticNetwork(sizes, bias=architecture.bias, generator=generator)
    return DynamicNetwork(
        sizes,
        order=architecture.order,
        output_dynamic=architecture.output_dynamic,
        stable=architecture.stable,
        bias=architecture.bias,
        memory=architecture.memory,
        generator=generator,
    )
