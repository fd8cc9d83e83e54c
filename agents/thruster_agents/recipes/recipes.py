"""Recipes: for each task a variant and settings of PPO that learn it in a few processor minutes."""

from __future__ import annotations

from dataclasses import dataclass

from thruster_agents.recipes.variants import Variant, variant_of
from thruster_envs.configuration import nearest

__all__ = ["RECIPES", "PPOSettings", "Recipe", "recipe_of"]


@dataclass(frozen=True, kw_only=True)
class PPOSettings:
    """Settings of Stable-Baselines3's PPO.

    Attributes:
        worlds: Environments side by side.
        rollout: Steps of each world between two updates.
        minibatch: Samples to a gradient step.
        epochs: Passes over a rollout.
        learning_rate: At the start; it falls linearly to 0.
        discount: Per step, of which a held action is one.
        trace: Decay of the advantage estimate (lambda).
        clip: Range within which the ratio of probabilities counts.
        entropy: Coefficient of the entropy.
        exploration: Standard deviation of continuous actions at the start.
        scales: The network sees ``tanh(scale * x)`` of each entry of the observation, once for each scale.
        width: Of each of the two hidden layers.
    """

    worlds: int = 128
    rollout: int = 64
    minibatch: int = 1024
    epochs: int = 4
    learning_rate: float = 2e-3
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.0
    exploration: float = 0.5
    scales: tuple[float, ...] = (1.0,)
    width: int = 64


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a task is learnt.

    Attributes:
        variant: Of the task, which is learnt.
        steps: Environment steps over all worlds, rounded up to whole rollouts.
        ppo: Settings of the algorithm.
    """

    variant: Variant
    steps: int
    ppo: PPOSettings = PPOSettings()

    @property
    def key(self) -> str:
        """Task and variant: `OrionRendezvous-near`."""
        return f"{self.variant.task.rpartition('-')[0]}-{self.variant.name}"


RECIPES: tuple[Recipe, ...] = (
    Recipe(
        variant=variant_of("OrionRendezvous-v1", "near"),
        steps=300_000,
        ppo=PPOSettings(
            rollout=57, epochs=5, learning_rate=3e-3, discount=0.995, exploration=0.3,
            scales=(1.0, 10.0, 100.0),
        ),
    ),
    Recipe(
        variant=variant_of("MarsRendezvous-v1", "short"),
        steps=250_000,
        ppo=PPOSettings(rollout=75, exploration=0.3, scales=(1.0, 10.0)),
    ),
    Recipe(
        variant=variant_of("FormationKeeping-v1", "mapped"),
        steps=400_000,
        ppo=PPOSettings(discount=0.98, exploration=0.3, scales=(1.0, 10.0)),
    ),
    Recipe(
        variant=variant_of("FormationAttitude-v1", "held"),
        steps=100_000,
        ppo=PPOSettings(rollout=100, minibatch=512, epochs=6, worlds=64, discount=0.97, scales=(1.0, 3.0)),
    ),
    Recipe(
        variant=variant_of("FaultDiagnosis-v1", "evidence"),
        steps=300_000,
        ppo=PPOSettings(discount=0.5, trace=0.8),
    ),
    Recipe(
        variant=variant_of("ActiveDiagnosis-v1", "evidence"),
        steps=250_000,
        ppo=PPOSettings(discount=0.9, trace=0.9),
    ),
    Recipe(
        variant=variant_of("PulseDiagnosis-v0", "plain"),
        steps=200_000,
        ppo=PPOSettings(discount=0.0, trace=0.0),
    ),
)  # fmt: skip


def recipe_of(key: str) -> Recipe:
    """The recipe of a key, or of the task's name alone.

    Raises:
        ValueError: There is none; one line says which there are.
    """
    found = next((one for one in RECIPES if key in (one.key, one.variant.task, one.variant.identifier)), None)
    if found is None:
        known = [one.key for one in RECIPES]
        near = nearest(key, known)
        hint = f"did you mean {near!r}?" if near else f"there are {', '.join(known)}"
        raise ValueError(f"recipe must be one of those there are, got {key!r}; {hint}")
    return found
