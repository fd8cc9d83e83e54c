"""The recursion of a dynamic neuron as a plain loop over samples: what the compiled filter is held against.

Left out: any use in training; it is hundreds of times slower.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch

from thruster_agents.dynamic_neurons.filtering import recursive_filter
from thruster_envs.configuration import require

__all__ = ["FilterTimes", "loop_filter", "time_filters"]


@dataclass(frozen=True)
class FilterTimes:
    """Seconds for one pass forwards and one backwards, on one thread.

    Attributes:
        compiled: `recursive_filter`, the median of some.
        loop: `loop_filter`, once.
        difference: Largest one between their outputs, relative to the largest output.
    """

    compiled: float
    loop: float
    difference: float

    @property
    def ratio(self) -> float:
        """How many times faster the compiled filter is."""
        return self.loop / self.compiled


def loop_filter(signal: torch.Tensor, feedforward: torch.Tensor, feedback: torch.Tensor) -> torch.Tensor:
    """What `recursive_filter` gives, sample by sample; autograd differentiates it."""
    filtered: list[torch.Tensor] = []
    for k in range(signal.shape[1]):
        now = feedforward[:, 0] * signal[:, k]
        for j in range(1, min(feedback.shape[1], k) + 1):
            now = now + feedforward[:, j] * signal[:, k - j] - feedback[:, j - 1] * filtered[k - j]
        filtered.append(now)
    return torch.stack(filtered, dim=1)


def time_filters(
    batch: int = 8, samples: int = 3000, units: int = 10, order: int = 2, repetitions: int = 20
) -> FilterTimes:
    """Time both on noise; by default on as much as the hidden layer of a low-level network is trained with.

    Args:
        batch: Sequences.
        samples: Of each.
        units: Channels.
        order: Of the filter, 1 or more.
        repetitions: Of the compiled filter.
    """
    require(order >= 1, "order", order, "1 or more")
    require(repetitions >= 1, "repetitions", repetitions, "1 or more")
    generator = torch.Generator().manual_seed(0)
    signal = torch.randn(batch, samples, units, dtype=torch.float64, generator=generator)
    feedforward = torch.randn(units, order + 1, dtype=torch.float64, generator=generator)
    feedback = torch.rand(units, order, dtype=torch.float64, generator=generator) / (2.0 * order)
    arguments = [one.requires_grad_() for one in (signal, feedforward, feedback)]
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        _pass(recursive_filter, arguments)  # compiles
        compiled = statistics.median(_pass(recursive_filter, arguments)[0] for _ in range(repetitions))
        loop, expected = _pass(loop_filter, arguments)
    finally:
        torch.set_num_threads(threads)
    difference = (recursive_filter(*arguments).detach() - expected).abs().max() / expected.abs().max()
    return FilterTimes(compiled, loop, float(difference))


def _pass(
    filtering: Callable[..., torch.Tensor], arguments: list[torch.Tensor]
) -> tuple[float, torch.Tensor]:
    begun = time.perf_counter()
    filtered = filtering(*arguments)
    torch.autograd.grad(filtered.square().sum(), arguments)
    return time.perf_counter() - begun, filtered.detach()
