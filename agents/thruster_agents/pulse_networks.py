"""Small networks that see a whole pulse of a plasma thruster at once, and were shown faults as well.

The networks of Valdes 2008 predict the current of a healthy pulse from sample to sample; whatever they
predict badly counts as a fault. Those here are trained on simulated pulses of healthy and failing thrusters,
and on what is asked: is this pulse faulty, or what thrust did it give? Voltage and current of a pulse, in
units of their errors, become a few scores along the directions in which training pulses differ most; the
charge voltage is one of the things that they show.

Waveforms do not tell less mass from less width (`thruster_baselines.detection.pulses.library`). So the thrust
comes as two numbers, one for either cause.

Left out: pulses of circuits that differ from the simulated one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import nn

from thruster_agents.dynamic_neurons.training import one_thread
from thruster_envs.configuration import coerce_fields, require
from thruster_envs.protocols import FloatArray

__all__ = ["PulseNetwork", "PulseNetworkSettings", "WaveformScores"]


@dataclass(frozen=True)
class WaveformScores:
    """The directions in which waveforms differ.

    Attributes:
        mean: (2 samples,), of the training pulses in units of the errors, voltage first.
        directions: (k, 2 samples), orthonormal, by falling variance.
        errors: Standard deviations of a voltage sample, V, and of a current sample, A.
    """

    mean: FloatArray
    directions: FloatArray
    errors: tuple[float, float]

    @classmethod
    def of(
        cls, voltage: ArrayLike, current: ArrayLike, errors: tuple[float, float], count: int = 8
    ) -> WaveformScores:
        """From pulses (pulses, samples) in V and A, healthy and failing ones.

        Raises:
            ValueError: Shapes that differ, or fewer pulses than directions.
        """
        stacked = _stacked(voltage, current, errors)
        if len(stacked) <= count:
            raise ValueError(f"there are {len(stacked)} pulses; more than {count} would be right")
        mean = stacked.mean(axis=0)
        apart = stacked - mean
        _, mixtures = np.linalg.eigh(apart @ apart.T)
        directions = np.linalg.qr((mixtures[:, : -count - 1 : -1].T @ apart).T)[0].T
        return cls(mean, directions, errors)

    def __call__(self, voltage: ArrayLike, current: ArrayLike) -> FloatArray:
        """(pulses, k): scores of pulses (pulses, samples) in V and A; each has errors of variance one."""
        return np.asarray((_stacked(voltage, current, self.errors) - self.mean) @ self.directions.T)


def _stacked(voltage: ArrayLike, current: ArrayLike, errors: tuple[float, float]) -> FloatArray:
    v, i = np.asarray(voltage, np.float64), np.asarray(current, np.float64)
    if v.ndim != 2 or v.shape != i.shape:
        raise ValueError(
            f"voltage has the shape {v.shape} and current {i.shape}; the same (pulses, samples) for both "
            "would be right"
        )
    return np.concatenate((v / errors[0], i / errors[1]), axis=1)


@dataclass(frozen=True, kw_only=True)
class PulseNetworkSettings:
    """What a network is, and how it is trained.

    Attributes:
        asked: `thrust`: the logarithms of the thrust over nominal if mass, and if width, has changed the
            kick; or `health`: whether the pulse is faulty.
        hidden: Neurons of each hidden layer.
        iterations: Of L-BFGS.
    """

    asked: Literal["thrust", "health"] = "thrust"
    hidden: tuple[int, ...] = (32, 32)
    iterations: int = 300

    def __post_init__(self) -> None:
        coerce_fields(self)
        require(min(self.hidden, default=0) >= 1, "hidden", self.hidden, "one size or more, each 1 or more")
        require(self.iterations >= 1, "iterations", self.iterations, "1 or more")


class PulseNetwork:
    """Tells from the scores of a pulse what is asked. Trained and run in float64.

    Args:
        scores: How many there are.
        settings: The thrust by default.
        generator: Draws the parameters.
    """

    def __init__(
        self,
        scores: int,
        settings: PulseNetworkSettings | None = None,
        *,
        generator: torch.Generator | None = None,
    ) -> None:
        self.settings = PulseNetworkSettings() if settings is None else settings
        outputs = 2 if self.settings.asked == "thrust" else 1
        sizes = (scores, *self.settings.hidden, outputs)
        layers: list[nn.Module] = []
        for wide, narrow in itertools.pairwise(sizes):
            linear = nn.Linear(wide, narrow, dtype=torch.float64)
            with torch.no_grad():
                linear.weight.uniform_(-(wide**-0.5), wide**-0.5, generator=generator)
                linear.bias.uniform_(-(wide**-0.5), wide**-0.5, generator=generator)
            layers += [linear, nn.Tanh()]
        self.network = nn.Sequential(*layers[:-1])
        self._centre, self._scale = np.zeros(scores), np.ones(scores)

    def train(self, scores: FloatArray, targets: FloatArray) -> float:
        """Fit to pulses whose answers are known; the loss that is left.

        Args:
            scores: (pulses, k).
            targets: (pulses, 2), logarithms of the thrust over nominal; or (pulses,), 1 for a faulty pulse.
        """
        self._centre, self._scale = scores.mean(axis=0), scores.std(axis=0)
        seen = torch.from_numpy((scores - self._centre) / self._scale)
        wanted = torch.from_numpy(np.asarray(targets, np.float64).reshape(len(scores), -1))
        asked = self.settings.asked
        loss_of = nn.MSELoss() if asked == "thrust" else nn.BCEWithLogitsLoss()
        optimiser = torch.optim.LBFGS(
            self.network.parameters(),
            max_iter=self.settings.iterations,
            history_size=30,
            tolerance_grad=0.0,
            tolerance_change=0.0,
            line_search_fn="strong_wolfe",
        )

        def closure() -> torch.Tensor:
            optimiser.zero_grad()
            loss: torch.Tensor = loss_of(self.network(seen), wanted)
            loss.backward()
            return loss

        with one_thread():
            optimiser.step(closure)
            return float(closure().detach())

    def predict(self, scores: FloatArray) -> FloatArray:
        """(pulses, 2): thrust over nominal for either cause; or (pulses,), probability that it is faulty."""
        seen = torch.from_numpy((scores - self._centre) / self._scale)
        with one_thread(), torch.no_grad():
            out = self.network(seen)
            if self.settings.asked == "thrust":
                return np.asarray(torch.exp(out).numpy())
            return np.asarray(torch.sigmoid(out[:, 0]).numpy())
