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


class DynamicLayer(nn.Module):
    """Neurons side by side that see the same inputs.

    Args:
        inputs: How many.
        units: Neurons.
        order: Of the filter, r; 0 for static neurons.
        activation: `tanh` or `linear`.
        stable: Keep poles inside of the unit circle by construction.
        bias: Add a trained constant to the weighted sum.
        memory: Shortest and longest time constant of the poles at the start, in samples, from which they are
            drawn log-uniformly, all real; the gain for constants then is drawn as weights are. None for
            coefficients drawn around zero, which forget within a few samples.
        generator: Draws the parameters.
        dtype: Of the parameters, and of what goes through.

    Attributes:
        weight: (units, inputs).
        bias: (units,), or None.
        feedforward: (units, r + 1), b_0 first; absent of order 0.
        pole_parameters: (units, r), what `feedback` is made of; absent of order 0.
        slope: (units,).
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
        self.inputs, self.units, self.order = inputs, units, order
        self.activation, self.stable = activation, stable

        def uniform(half_width: float, *shape: int) -> torch.Tensor:
            return half_width * (2.0 * torch.rand(*shape, generator=generator, dtype=dtype) - 1.0)

        self.weight = nn.Parameter(uniform(_WEIGHTS, units, inputs))
        self.register_parameter("bias", nn.Parameter(torch.zeros(units, dtype=dtype)) if bias else None)
        if order:
            feedforward = uniform(_FEEDFORWARD, units, order + 1)
            if memory is None:
                parameters = _parameters_of(uniform(_FEEDBACK, units, order), stable)
            else:
                shortest, longest = torch.log(torch.tensor(memory, dtype=dtype))
                place = torch.rand(units, order, generator=generator, dtype=dtype)
                poles = torch.exp(-torch.exp(-(shortest + (longest - shortest) * place)))
                parameters = _parameters_with(poles, stable)
                feedforward *= denominator(parameters, stable).sum(dim=1, keepdim=True)
            self.feedforward = nn.Parameter(feedforward)
            self.pole_parameters = nn.Parameter(parameters)
        self.slope = nn.Parameter(torch.ones(units, dtype=dtype))

    @property
    def feedback(self) -> torch.Tensor:
        """(units, r), a_1 first, differentiable by `pole_parameters`."""
        return denominator(self.pole_parameters, self.stable)[:, 1:]

    def weighted_sum(self, inputs: torch.Tensor) -> torch.Tensor:
        """(batch, time, units), x of the module, of `inputs` (batch, time, inputs)."""
        return nn.functional.linear(inputs, self.weight, self.bias)

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
    ones = torch.ones_like(parameters[:, :1])
    if not stable:
        return torch.cat([ones, parameters], dim=1)
    product = ones
    bounded = torch.tanh(parameters)
    for first in range(0, parameters.shape[1], 2):
        section = bounded[:, first : first + 2]
        if section.shape[1] == 2:
            second = section[:, 1:]
            section = torch.cat([(1.0 + second) * section[:, :1], second], dim=1)
        product = _product(product, torch.cat([ones, section], dim=1))
    return product


def _product(left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Of polynomials (units, n) and (units, m): (units, n + m - 1)."""
    padded = nn.functional.pad(left, (0, right.shape[1] - 1))
    return sum(  # type: ignore[return-value]
        right[:, j : j + 1] * nn.functional.pad(padded, (j, -j)) for j in range(right.shape[1])
    )


def _parameters_of(sections: torch.Tensor, stable: bool) -> torch.Tensor:
    """Parameters (units, r) whose sections have these coefficients a_1, a_2, a_1, a_2, ..."""
    if not stable:
        return sections
    parameters = sections.clone()
    paired = sections.shape[1] // 2 * 2
    parameters[:, 0:paired:2] = sections[:, 0:paired:2] / (1.0 + sections[:, 1:paired:2])
    return torch.atanh(parameters)


def _parameters_with(poles: torch.Tensor, stable: bool) -> torch.Tensor:
    """Parameters (units, r) whose denominator has these real poles (units, r)."""
    paired = poles.shape[1] // 2 * 2
    sections = -poles
    sections[:, 0:paired:2] = -(poles[:, 0:paired:2] + poles[:, 1:paired:2])
    sections[:, 1:paired:2] = poles[:, 0:paired:2] * poles[:, 1:paired:2]
    if stable:
        return _parameters_of(sections, stable)
    ones = torch.ones_like(poles[:, :1])
    product = ones
    for i in range(poles.shape[1]):
        product = _product(product, torch.cat([ones, -poles[:, i : i + 1]], dim=1))
    return product[:, 1:]
