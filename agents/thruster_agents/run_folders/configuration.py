"""The options of a training run, as the command takes them and `config.json` keeps them; their checks."""

from __future__ import annotations

import os
from dataclasses import dataclass

from thruster_agents.environments import Form
from thruster_agents.ppo import Settings
from thruster_agents.run_folders.folder import RunFolder
from thruster_envs.configuration import from_mapping, shown
from thruster_envs.seeds import TEST, VALIDATION, first_training_seed
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Configuration", "read_configuration"]

#: Least and most of each whole number.
_WHOLE = {
    "seed": (0, 10**6),
    "seeds": (1, 1000),
    "belief_steps": (0, 10**12),
    "duty_steps": (0, 10**12),
    "worlds": (1, 100_000),
    "minibatch": (2, 10**9),
    "epochs": (1, 1000),
    "duty_epochs": (1, 1000),
    "validate_every": (1, 10**9),
    "validation_worlds": (1, len(VALIDATION) // 2),
    "test_worlds": (1, len(TEST) // 2),
    "checkpoint_every": (1, 10**9),
    "threads": (1, 1024),
}
#: Least and most of each other number.
_REAL = {
    "learning_rate": (1e-9, 10.0),
    "duty_learning_rate": (1e-9, 10.0),
    "discount": (0.0, 1.0),
    "duty_discount": (0.0, 1.0),
    "trace": (0.0, 1.0),
    "exploration": (1e-3, 10.0),
    "duty_exploration": (1e-3, 10.0),
}
_LONGEST_NAME = 100  # bytes; file systems have 255 for the folder, which begins with the time


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """Train PPO on ThrusterMapping-v0, evaluate it beside classical mappers, print one table."""

    spacecraft: str = "orion"
    """Name in the catalogue, or path of a TOML file."""
    seed: int = 0
    """Of networks and training worlds."""
    seeds: int = 1
    """How many policies of each form to train, with seeds from `seed` on; the table is over all of them."""
    belief_steps: int = 600_000
    """Environment steps of PPO on beliefs; 0 leaves the row out."""
    duty_steps: int = 500_000
    """Environment steps of PPO on duties; 0 leaves the row out."""
    worlds: int = 256
    """Environments side by side; a rollout is one episode of 32 commands in each."""
    learning_rate: float = 5e-3
    """Of PPO on beliefs at the start; falls linearly to 0."""
    duty_learning_rate: float = 5e-3
    """Of PPO on duties at the start; falls linearly to 0."""
    minibatch: int = 1024
    """Samples to a gradient step."""
    epochs: int = 6
    """Passes over each rollout, beliefs."""
    duty_epochs: int = 10
    """Passes over each rollout, duties."""
    discount: float = 0.5
    """Discount per command, beliefs: commands are independent of each other, only a diagnosis lasts."""
    duty_discount: float = 0.0
    """Discount per command, duties: nothing that a policy without a belief does now lasts."""
    trace: float = 0.9
    """Decay of the advantage estimate (lambda of GAE)."""
    exploration: float = 0.37
    """Standard deviation of actions at the start, beliefs; wide, because the LP answers a belief in jumps."""
    duty_exploration: float = 0.5
    """Standard deviation of actions at the start, duties."""
    validate_every: int = 5
    """Rollouts between points of the learning curve."""
    validation_worlds: int = 128
    """Episodes to a point of the learning curve."""
    test_worlds: int = 1000
    """Episodes to a cell of the table."""
    checkpoint_every: int = 10
    """Rollouts between checkpoints."""
    threads: int = 1
    """Threads of torch. Another number may give other last digits."""
    name: str = "mapping"
    """End of the run folder's name."""
    runs: str = "runs"
    """Where run folders are made."""
    results: str | None = None
    """Also write the table to this Markdown file, with the command that makes it."""
    resume: str | None = None
    """Folder of an interrupted run to go on with, as it was begun; only --results is taken beside it."""

    def check(self) -> None:
        """Raise ValueError, one line, for a value that cannot be."""
        for name, (least, most) in _WHOLE.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ValueError(f"{name} must be a whole number from {least} to {most}, got {shown(value)}")
        for name, (low, high) in _REAL.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name} must be a number from {low:g} to {high:g}, got {value}")
        if self.belief_steps + self.duty_steps == 0:
            raise ValueError("belief_steps or duty_steps must be above 0, got 0 for both")
        plain = self.name.replace("-", "").replace("_", "")
        if not plain.isalnum() or len(os.fsencode(self.name)) > _LONGEST_NAME:
            raise ValueError(
                f"name must be letters, digits, - and _, at most {_LONGEST_NAME} bytes, "
                f"got {shown(self.name)}"
            )
        for name in ("spacecraft", "runs", "results", "resume"):
            if "\0" in (getattr(self, name) or ""):
                raise ValueError(f"{name} must be a path, got {shown(getattr(self, name))}")
        first_training_seed(self.seed + self.seeds - 1, self.worlds)

    def settings(self, form: Form, seed: int, spacecraft: Spacecraft) -> Settings:
        """Of one training."""
        beliefs = form == "beliefs"
        return Settings(
            spacecraft=spacecraft,
            form=form,
            seed=seed,
            steps=self.belief_steps if beliefs else self.duty_steps,
            worlds=self.worlds,
            learning_rate=self.learning_rate if beliefs else self.duty_learning_rate,
            minibatch=self.minibatch,
            epochs=self.epochs if beliefs else self.duty_epochs,
            discount=self.discount if beliefs else self.duty_discount,
            trace=self.trace,
            exploration=self.exploration if beliefs else self.duty_exploration,
            checkpoint_every=self.checkpoint_every,
            validate_every=self.validate_every,
            validation_worlds=self.validation_worlds,
        )


def read_configuration(run: RunFolder) -> Configuration:
    """The options that a run began with, checked as those of the command are.

    Raises:
        ValueError: A file that is missing or damaged, an unknown or missing key, a value that cannot be.
    """
    path = run.file("config.json")
    content = run.read("config.json")
    found = from_mapping(Configuration, content, str(path))
    missing = [name for name in vars(found) if name not in content]
    if missing:
        raise ValueError(f"{path}: the key {missing[0]!r} is missing")
    try:
        found.check()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return found
