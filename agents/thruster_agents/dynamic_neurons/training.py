"""Training of a network on sequences: the whole set at once, until the mean square error is small enough.

The optimisers are torch's: L-BFGS with a line search, Adam, and plain gradient descent; the gradients
autograd's (exact), or those of extended dynamic back-propagation, exact or truncated as in the source. L-BFGS
needs exact ones. Parameters with which the outputs overflow, as poles outside of the unit circle make them,
count as infinitely wrong: a line search steps back from them.

A training run is a function of the network as it was, the data and the settings: on one machine the same
bits, interrupted or not. Left out: minibatches, schedules of the learning rate, regularisation.
"""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike

from thruster_agents.checkpoints import check_like, read_tree, write_tree
from thruster_agents.dynamic_neurons.back_propagation import dynamic_back_propagation
from thruster_agents.dynamic_neurons.networks import DynamicNetwork, SequenceNetwork
from thruster_envs.configuration import coerce_fields, require
from thruster_envs.protocols import FloatArray

__all__ = ["TrainingRecord", "TrainingSettings", "one_thread", "train"]

_LEARNING_RATES = {"lbfgs": 1.0, "adam": 1e-2, "gradient_descent": 3e-2}
#: What L-BFGS sees the error multiplied by: torch's takes no note of curvature where a product of steps and
#: changes of the gradient is below 1e-10, which small errors of flat valleys are.
_SCALES = {"lbfgs": 1e6, "adam": 1.0, "gradient_descent": 1.0}


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """How a network is trained.

    Attributes:
        optimiser: `lbfgs`, `adam` or `gradient_descent`.
        gradient: `autograd`; or `exact` or `truncated` extended dynamic back-propagation.
        learning_rate: None for 1 (L-BFGS: what the line search begins with), 0.01 (Adam) or 0.03.
        stop: Mean square error at which training ends (Valdes 2008: 1e-4 for the low level).
        iterations: At most so many steps of the optimiser, over all.
        checkpoint_every: Steps between checkpoints, where there is a file for them.
    """

    optimiser: Literal["lbfgs", "adam", "gradient_descent"] = "lbfgs"
    gradient: Literal["autograd", "exact", "truncated"] = "autograd"
    learning_rate: float | None = None
    stop: float = 1e-4
    iterations: int = 2000
    checkpoint_every: int = 100

    def __post_init__(self) -> None:
        coerce_fields(self)
        require(self.stop >= 0.0, "stop", self.stop, "0 or more")
        require(self.iterations >= 0, "iterations", self.iterations, "0 or more")
        require(self.checkpoint_every >= 1, "checkpoint_every", self.checkpoint_every, "1 or more")
        exact = self.gradient != "truncated" or self.optimiser != "lbfgs"
        require(exact, "gradient with L-BFGS", self.gradient, "'autograd' or 'exact'")


@dataclass(frozen=True)
class TrainingRecord:
    """What a training run was like.

    Attributes:
        errors: (iterations + 1,), mean square error before the first step and after each.
        error: That of the parameters which the network was left with: the smallest.
        reached: Whether it is at or below the stopping criterion.
        seconds: Wall-clock time, interruptions not counted.
    """

    errors: FloatArray
    error: float
    reached: bool
    seconds: float

    @property
    def iterations(self) -> int:
        """Steps of the optimiser."""
        return len(self.errors) - 1


def train(
    network: SequenceNetwork,
    inputs: ArrayLike,
    targets: ArrayLike,
    settings: TrainingSettings | None = None,
    *,
    checkpoint: Path | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> TrainingRecord:
    """Train a network in place, or go on with what the checkpoint has.

    Args:
        network: Of any kind; as it was at first, where there is a checkpoint to go on with.
        inputs: (batch, time, inputs).
        targets: (batch, time), what it should give out.
        settings: By default L-BFGS to a mean square error of 1e-4.
        checkpoint: File that the run can be resumed from; None for none. The one before it is kept beside it,
            and taken with a warning where the file is damaged. Neither holds anything that is run.
        progress: Called after each step with the steps so far and the mean square error.

    Raises:
        ValueError: Shapes that do not belong together, a rule that this network has not, or a network whose
            outputs are not finite from the start.
    """
    settings = TrainingSettings() if settings is None else settings
    if settings.gradient != "autograd" and not isinstance(network, DynamicNetwork):
        raise ValueError(
            f"gradient is {settings.gradient!r} for a {type(network).__name__}; 'autograd' would be right"
        )
    seen = torch.from_numpy(np.array(inputs, np.float64))
    wanted = torch.from_numpy(np.array(targets, np.float64))
    if seen.ndim != 3 or seen.shape[2] != network.inputs or wanted.shape != seen.shape[:2]:
        raise ValueError(
            f"inputs have the shape {tuple(seen.shape)} and targets {tuple(wanted.shape)}; "
            f"(batch, time, {network.inputs}) and (batch, time) would be right"
        )
    with one_thread():
        return _Run(network, seen, wanted[..., None], settings, checkpoint).go(progress)


@contextmanager
def one_thread() -> Iterator[None]:
    """These networks are small: more threads than one wait for each other, and add up in another order."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class _Run:
    """One training run: its optimiser, its errors so far and the best parameters."""

    def __init__(
        self,
        network: SequenceNetwork,
        inputs: torch.Tensor,
        targets: torch.Tensor,
        settings: TrainingSettings,
        checkpoint: Path | None,
    ) -> None:
        self.network, self.inputs, self.targets = network, inputs, targets
        self.settings, self.path = settings, checkpoint
        self.optimiser, self.scale = _optimiser(network, settings), _SCALES[settings.optimiser]
        self.errors: list[float] = []
        self.seconds = 0.0
        self.best = _parameters(network)
        self.evaluated: tuple[torch.Tensor, torch.Tensor] | None = None
        if checkpoint is not None:
            self._restore(checkpoint, warnings.warn)

    def go(self, progress: Callable[[int, float], None] | None) -> TrainingRecord:
        """Take steps until the error is small enough, there were enough, or none leads on."""
        begun = time.perf_counter() - self.seconds
        if not self.errors:
            self._note(float(self._error()) / self.scale)
            if not math.isfinite(self.errors[0]):
                raise ValueError(
                    f"the mean square error is {self.errors[0]} before the first step; "
                    "a network with other parameters, or stable poles, would be right"
                )
        while len(self.errors) <= self.settings.iterations and min(self.errors) > self.settings.stop:
            if not self._step():
                break
            self._note(float(self._error()) / self.scale)
            if progress is not None:
                progress(len(self.errors) - 1, self.errors[-1])
            if (len(self.errors) - 1) % self.settings.checkpoint_every == 0:
                self._save(time.perf_counter() - begun)
            if not math.isfinite(self.errors[-1]):
                break
        self.seconds = time.perf_counter() - begun
        self._save(self.seconds)
        torch.nn.utils.vector_to_parameters(self.best, self.network.parameters())
        error = min(self.errors)
        return TrainingRecord(np.array(self.errors), error, error <= self.settings.stop, self.seconds)

    def _step(self) -> bool:
        """One step of the optimiser; whether there was one."""
        before = _parameters(self.network)
        self.optimiser.step(self._error)
        if torch.equal(before, _parameters(self.network)):
            # Where a line search finds nothing in the direction that L-BFGS makes of its memory, the gradient
            # itself may still lead on.
            self.optimiser.state.clear()
            self.optimiser.step(self._error)
        return not torch.equal(before, _parameters(self.network))

    def _note(self, error: float) -> None:
        if not self.errors or error < min(self.errors):
            self.best = _parameters(self.network)
        self.errors.append(error)

    def _error(self) -> torch.Tensor:
        """Scaled mean square error, its gradient in the parameters; not computed twice for the same ones."""
        now = _parameters(self.network)
        if self.evaluated is not None and torch.equal(now, self.evaluated[0]):
            return self.evaluated[1]
        self.network.zero_grad()
        if self.settings.gradient == "autograd":
            error = (self.network(self.inputs) - self.targets).square().mean()
            error.backward()
        else:
            error = dynamic_back_propagation(
                self.network,  # type: ignore[arg-type]
                self.inputs,
                self.targets,
                truncated=self.settings.gradient == "truncated",
            )
        gradients = [parameter.grad for parameter in self.network.parameters()]
        if not all(bool(torch.isfinite(one).all()) for one in (error, *gradients) if one is not None):
            error = torch.tensor(math.inf, dtype=torch.float64)
            for gradient in gradients:
                gradient.zero_()  # type: ignore[union-attr]
        else:
            for gradient in gradients:
                gradient.mul_(self.scale)  # type: ignore[union-attr]
        self.evaluated = now, self.scale * error.detach()
        return self.evaluated[1]

    def _save(self, seconds: float) -> None:
        if self.path is None:
            return
        saved = {
            "parameters": _parameters(self.network),
            "buffers": dict(self.network.named_buffers()),
            "best": self.best,
            "optimiser": self.optimiser.state_dict()["state"],
            "errors": self.errors,
            "seconds": seconds,
        }
        if self.path.is_file():
            os.replace(self.path, _previous(self.path))
        write_tree(self.path, saved)

    def _restore(self, path: Path, tell: Callable[[str], None]) -> None:
        """Go on with a checkpoint, or where it is damaged with the one before it."""
        for one in (path, _previous(path)):
            if one.exists():
                try:
                    saved = read_tree(one)
                except ValueError as error:
                    tell(f"{error}; going on from an earlier moment")
                    continue
                self._take(one, saved)
                return

    def _take(self, path: Path, saved: Any) -> None:
        count = self.best.numel()
        vector = saved.get("parameters") if isinstance(saved, dict) else None
        if not isinstance(vector, torch.Tensor) or vector.numel() != count:
            there = vector.numel() if isinstance(vector, torch.Tensor) else "no"
            raise ValueError(f"{path} has {there} parameters; {count}, those of the network, would be right")
        errors, state = saved.get("errors"), saved.get("optimiser")
        form = {
            "parameters": self.best,
            "buffers": dict(self.network.named_buffers()),
            "best": self.best,
            "optimiser": state,
            "errors": [0.0] * (len(errors) if isinstance(errors, list) else 1),
            "seconds": 0.0,
        }
        check_like(saved, form, str(path))
        _check_state(path, state, self.optimiser)
        torch.nn.utils.vector_to_parameters(saved["parameters"], self.network.parameters())
        self.network.load_state_dict(saved["buffers"], strict=False)
        self.best, self.errors, self.seconds = saved["best"], list(saved["errors"]), saved["seconds"]
        self.optimiser.load_state_dict(self.optimiser.state_dict() | {"state": state})


def _previous(path: Path) -> Path:
    return path.with_name(f"{path.name}.previous")


def _check_state(path: Path, state: Any, optimiser: torch.optim.Optimizer) -> None:
    """Check what an optimiser remembers: of its own parameters, and nothing larger than they are."""
    parameters = [one for group in optimiser.param_groups for one in group["params"]]
    largest = sum(one.numel() for one in parameters)
    if not isinstance(state, dict) or not state.keys() <= set(range(len(parameters))):
        raise ValueError(f"{path}: optimiser must be the state of {len(parameters)} parameters")
    for key, remembered in state.items():
        whole = isinstance(optimiser, torch.optim.LBFGS)
        shapes = {(), (largest,)} if whole else {(), tuple(parameters[key].shape)}
        values = list(remembered.values()) if isinstance(remembered, dict) else [""]
        values += [one for value in values if isinstance(value, list) for one in value]
        for value in values:
            fits = (
                tuple(value.shape) in shapes
                if isinstance(value, torch.Tensor)
                else not isinstance(value, str)
            )
            if not fits:
                raise ValueError(f"{path}: optimiser: parameter {key} has a state of another kind or shape")


def _optimiser(network: SequenceNetwork, settings: TrainingSettings) -> torch.optim.Optimizer:
    rate = settings.learning_rate
    rate = _LEARNING_RATES[settings.optimiser] if rate is None else rate
    if settings.optimiser == "adam":
        return torch.optim.Adam(network.parameters(), rate)
    if settings.optimiser == "gradient_descent":
        return torch.optim.SGD(network.parameters(), rate)
    return torch.optim.LBFGS(
        network.parameters(),
        rate,
        max_iter=1,
        max_eval=26,  # one, and the 25 of a line search
        tolerance_grad=0.0,
        tolerance_change=0.0,
        history_size=30,
        line_search_fn="strong_wolfe",
    )


def _parameters(network: SequenceNetwork) -> torch.Tensor:
    """All of them in one vector, a copy."""
    return torch.nn.utils.parameters_to_vector(network.parameters()).detach().clone()
