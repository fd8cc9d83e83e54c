"""Dynamic neurons: weighted sum, recursive filter, slope, activation.

    x(k) = sum_p w_p u_p(k) + bias,    v(k) = filter of x (a, b; see `filtering`),    y(k) = F(g v(k))

(Valdes 2008, eq. 4.3; there without bias, r = 2, F the hyperbolic tangent or the identity.) Everything is
trained, the slope g too. Of order 0 there is no filter, and the neuron is a static one.

Poles are free, as in the source, or inside of the unit circle whatever the parameters are: the denominator
then is a product of sections of second order, and one of first order if the order is odd, with

    a2 = tanh(p2),    a1 = (1 + a2) tanh(p1),    and tanh(p1) for a section of first order,

which is the whole triangle of stable sections.

Left out: time constants shared by neurons, connections that jump a layer.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import nn

from thruster_agents.dynamic_neurons.filtering import recursive_filter
from thruster_envs.configuration import require

__all__ = ["Activation", "DynamicLayer", "DynamicNeuron", "denominator"]

Activation = Literal["tanh", "linear"]

#: Half widths of the uniform distributions that parameters are drawn from at the start.
_WEIGHTS, _FEEDBACK, _FEEDFORWARD = 1.0, 0.3, 0.5
#: Largest angle that a pair of poles with a given memory turns in its time constant, rad.
_SWING = 3.0


class DynamicLayer(nn.Module):
    """Neurons side by side that see the same inputs.

    Args:
        inputs: How many.
        units: Neurons.
        order: Of the filter, r; 0 for static neurons.
        activation: `tanh` or `linear`.
        stable: Keep poles inside of the unit circle by construction.
        bias: Add a trained constant to the weighted sum.
        memory: Shortest and longest time constant at the start, in samples, between which those of pairs of
            poles are drawn log-uniformly, each pair a damped oscillation of up to 3 rad per time constant.
            The weighted sum then has a fixed gain, so that constants come through the filter as large as
            without memory: slow filters amplify them, and would dwarf all other derivatives. Poles must be
            stable ones: free coefficients of slow poles are too sensitive to be trained. None for
            coefficients drawn around zero, which forget within a few samples.
        generator: Draws the parameters.
        dtype: Of the parameters, and of what goes through.

    Attributes:
        weight: (units, inputs).
        bias: (units,), or None.
        feedforward: (units, r + 1), b_0 first; absent of order 0.
        pole_parameters: (units, r), what `feedback` is made of; absent of order 0.
        slope: (units,).
        gain: (units,), fixed, of the weighted sum; None without `memory`.
    """

    def __init__(
        self,
        inputs: int,
        units: int,
        *,
        order: int = 2,
        activation: Activation = "tanh",
        stable: bool = False,
        bias: bool = False,
        memory: tuple[float, float] | None = None,
        generator: torch.Generator | None = None,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        require(inputs >= 1, "inputs", inputs, "1 or more")
        require(units >= 1, "units", units, "1 or more")
        require(order >= 0, "order", order, "0 or more")
        require(activation in ("tanh", "linear"), "activation", activation, "'tanh' or 'linear'")
        if memory is not None:
            require(0.0 < memory[0] <= memory[1], "memory", memory, "a shorter and a longer time in samples")
            require(stable, "memory of free poles", memory, "None, or stable poles,")
        self.inputs, self.units, self.order = inputs, units, order
        self.activation, self.stable = activation, stable

        def uniform(half_width: float, *shape: int) -> torch.Tensor:
            return half_width * (2.0 * torch.rand(*shape, generator=generator, dtype=dtype) - 1.0)

        self.weight = nn.Parameter(uniform(_WEIGHTS, units, inputs))
        self.register_parameter("bias", nn.Parameter(torch.zeros(units, dtype=dtype)) if bias else None)
        gain = None
        if order:
            self.feedforward = nn.Parameter(uniform(_FEEDFORWARD, units, order + 1))
            if memory is None:
                sections = uniform(_FEEDBACK, units, order)
            else:
                sections = _sections(units, order, memory, generator, dtype)
                gain = _expanded(sections).sum(dim=1)
            self.pole_parameters = nn.Parameter(_parameters_of(sections) if stable else sections)
        self.register_buffer("gain", gain)
        self.slope = nn.Parameter(torch.ones(units, dtype=dtype))

    @property
    def feedback(self) -> torch.Tensor:
        """(units, r), a_1 first, differentiable by `pole_parameters`."""
        return denominator(self.pole_parameters, self.stable)[:, 1:]

    def weighted_sum(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, units), x of the module, of `inputs` (batch, time, inputs)."""
        summed = nn.functional.linear(inputs, self.weight, self.bias)
        return summed if self.gain is None else self.gain * summed

    def filtered(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, units), v of the module, of `inputs` (batch, time, inputs)."""
        summed = self.weighted_sum(inputs)
        return recursive_filter(summed, self.feedforward, self.feedback) if self.order else summed

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, units), y of the module, of `inputs` (batch, time, inputs)."""
        scaled = self.slope * self.filtered(inputs)
        return torch.tanh(scaled) if self.activation == "tanh" else scaled


class DynamicNeuron(DynamicLayer):
    """One dynamic neuron: a layer of one; the options are those of `DynamicLayer`.

    >>> neuron = DynamicNeuron(2, generator=torch.Generator().manual_seed(0))
    >>> neuron(torch.zeros(1, 5, 2, dtype=torch.float64)).shape
    torch.Size([1, 5, 1])
    """

    def __init__(self, inputs: int, **options: object) -> None:
        super().__init__(inputs, 1, **options)  # type: ignore[arg-type]


def denominator(parameters: torch.Tensor, stable: bool) -> torch.Tensor:
    """(units, r + 1), 1, a_1 to a_r, of parameters (units, r).

    >>> denominator(torch.tensor([[20.0, 20.0]]), stable=True)  # both poles at -1, as far as they can go
    tensor([[1., 2., 1.]])
    """
    if not stable:
        return torch.cat([torch.ones_like(parameters[:, :1]), parameters], dim=1)
    bounded = torch.tanh(parameters)
    sections = list(bounded.split(1, dim=1))
    for first in range(0, parameters.shape[1] - 1, 2):
        sections[first] = (1.0 + sections[first + 1]) * sections[first]
    return _expanded(torch.cat(sections, dim=1))


def _expanded(sections: torch.Tensor) -> torch.Tensor:
    """(units, r + 1), the product of sections (units, r) of second order, and one of first if r is odd."""
    product = ones = torch.ones_like(sections[:, :1])
    for section in sections.split(2, dim=1):
        product = _product(product, torch.cat([ones, section], dim=1))
    return product


def _product(left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Of polynomials (units, n) and (units, m): (units, n + m - 1)."""
    padded = nn.functional.pad(left, (0, right.shape[1] - 1))
    return sum(  # type: ignore[return-value]
        right[:, j : j + 1] * nn.functional.pad(padded, (j, -j)) for j in range(right.shape[1])
    )


def _parameters_of(sections: torch.Tensor) -> torch.Tensor:
    """Parameters (units, r) of stable sections with these coefficients a_1, a_2, a_1, a_2, ..."""
    parameters = sections.clone()
    paired = sections.shape[1] // 2 * 2
    parameters[:, 0:paired:2] = sections[:, 0:paired:2] / (1.0 + sections[:, 1:paired:2])
    return torch.atanh(parameters)


def _sections(
    units: int,
    order: int,
    memory: tuple[float, float],
    generator: torch.Generator | None,
    dtype: torch.dtype,
) -> torch.Tensor:
    """(units, r), a_1 and a_2 of damped oscillations, and a_1 of a decay if r is odd."""
    pairs, rest = divmod(order, 2)
    shortest, longest = torch.log(torch.tensor(memory, dtype=dtype))
    place = torch.rand(units, pairs + rest, generator=generator, dtype=dtype)
    constants = torch.exp(shortest + (longest - shortest) * place)
    radii = torch.exp(-1.0 / constants)
    angles = _SWING * torch.rand(units, pairs, generator=generator, dtype=dtype) / constants[:, :pairs]
    both = torch.stack([-2.0 * radii[:, :pairs] * torch.cos(angles), radii[:, :pairs].square()], dim=2)
    return torch.cat([both.flatten(1), -radii[:, pairs:]], dim=1)
