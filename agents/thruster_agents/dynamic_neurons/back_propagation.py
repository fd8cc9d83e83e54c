"""Extended dynamic back-propagation, the training rule of the source, from its own sensitivities.

Valdes 2008 names the rule and prints no equation; this is its standard form for the neuron of `layers`. Of
a neuron with weighted sum x, filter output v and output y = F(g v), 1/A being the all-pole filter of its a_i:

    P_w(k) = 1/A of sum_j b_j u(k-j),   P_a_j(k) = - 1/A of v(k-j),   P_b_j(k) = 1/A of x(k-j)
    dy/dtheta(k) = g F'(g v(k)) P_theta(k),   dy/dg(k) = F'(g v(k)) v(k)

and -dE/dtheta = sum over k of eps(k) dy/dtheta(k), of E = 1/2 sum of e(k)^2, eps being the error of the
neuron's output. In the output layer it is e. What a neuron's output at k does to later outputs of the next
layer goes through the filter of that layer: exactly,

    eps_s(k) = sum_l w_ls mu_l(k),   mu_l(k) = sum_{k' >= k} h_l(k'-k) g_l F'(g_l v_l(k')) eps_l(k'),

h_l being the impulse response of B_l/A_l: the same filter, run backwards in time. The rule of the source
keeps of it the first term only, mu_l(k) = b_0 g_l F'_l eps_l(k) (*truncated*), which is right where the next
layer has no dynamics. The derivatives left here are of the mean square error, as those of autograd are.

Left out: updates after each sample; the derivatives are summed over the whole training set.
"""

from __future__ import annotations

import torch

from thruster_agents.dynamic_neurons.filtering import recursive_filter
from thruster_agents.dynamic_neurons.layers import DynamicLayer
from thruster_agents.dynamic_neurons.networks import DynamicNetwork

__all__ = ["dynamic_back_propagation"]


@torch.no_grad()
def dynamic_back_propagation(
    network: DynamicNetwork, inputs: torch.Tensor, targets: torch.Tensor, *, truncated: bool = True
) -> torch.Tensor:
    """Fill the gradients of the network with those of its mean square error.

    Args:
        network: Of dynamic neurons, or static ones.
        inputs: (batch, time, inputs).
        targets: (batch, time, 1).
        truncated: Propagate errors through the instantaneous path of filters only, as the source does.

    Returns:
        The mean square error, as a tensor without dimensions.
    """
    layers: list[DynamicLayer] = list(network.layers)  # type: ignore[arg-type]
    seen, filtered = [inputs], []
    for layer in layers:
        filtered.append(layer.filtered(seen[-1]))
        scaled = layer.slope * filtered[-1]
        seen.append(torch.tanh(scaled) if layer.activation == "tanh" else scaled)
    error = seen[-1] - targets
    scale = 2.0 / error.numel()
    propagated = error
    for layer, inward, v, outward in zip(
        layers[::-1], seen[-2::-1], filtered[::-1], seen[:0:-1], strict=True
    ):
        bent = 1.0 - outward.square() if layer.activation == "tanh" else torch.ones_like(outward)
        layer.slope.grad = scale * (propagated * bent * v).sum(dim=(0, 1))
        at_filter = propagated * bent * layer.slope
        _local(layer, inward, v, scale * at_filter)
        propagated = _gained(layer, _through_filter(layer, at_filter, truncated)) @ layer.weight
    for parameter in network.parameters():
        parameter.grad = parameter.grad.contiguous()  # type: ignore[union-attr]  # as optimisers expect it
    return error.square().mean()


def _local(layer: DynamicLayer, inputs: torch.Tensor, v: torch.Tensor, error: torch.Tensor) -> None:
    """Gradients of weights and coefficients, from sensitivities of v and the error that stands there."""
    if not layer.order:
        layer.weight.grad = torch.einsum("ntc,nti->ci", error, inputs)
        if layer.bias is not None:
            layer.bias.grad = error.sum(dim=(0, 1))
        return
    a, b = layer.feedback, layer.feedforward
    summed, gained = layer.weighted_sum(inputs), _gained(layer, error)
    layer.weight.grad = torch.stack(
        [
            (gained * recursive_filter(inputs[..., p : p + 1].expand_as(v), b, a)).sum(dim=(0, 1))
            for p in range(layer.inputs)
        ],
        dim=1,
    )
    if layer.bias is not None:
        layer.bias.grad = (gained * recursive_filter(torch.ones_like(v), b, a)).sum(dim=(0, 1))
    by_x, by_v = (recursive_filter(signal, _only_first(b), a) for signal in (summed, v))
    layer.feedforward.grad = torch.stack(
        [(error * _delayed(by_x, j)).sum(dim=(0, 1)) for j in range(layer.order + 1)], dim=1
    )
    by_feedback = torch.stack(
        [-(error * _delayed(by_v, j)).sum(dim=(0, 1)) for j in range(1, layer.order + 1)], dim=1
    )
    with torch.enable_grad():  # from coefficients to what they are made of
        (layer.pole_parameters.grad,) = torch.autograd.grad(
            layer.feedback, layer.pole_parameters, by_feedback
        )


def _gained(layer: DynamicLayer, error: torch.Tensor) -> torch.Tensor:
    """What an error at the weighted sum is before its gain."""
    return error if layer.gain is None else layer.gain * error


def _through_filter(layer: DynamicLayer, error: torch.Tensor, truncated: bool) -> torch.Tensor:
    """What an error at the filter's output is at its input: mu of the module."""
    if not layer.order:
        return error
    if truncated:
        return layer.feedforward[:, 0] * error
    return recursive_filter(error.flip(1), layer.feedforward, layer.feedback).flip(1)


def _only_first(feedforward: torch.Tensor) -> torch.Tensor:
    """Coefficients of the all-pole filter 1/A."""
    only = torch.zeros_like(feedforward)
    only[:, 0] = 1.0
    return only


def _delayed(signal: torch.Tensor, samples: int) -> torch.Tensor:
    """(batch, time, units), so many samples later, zero before."""
    return torch.nn.functional.pad(signal, (0, 0, samples, 0))[:, : signal.shape[1]]
