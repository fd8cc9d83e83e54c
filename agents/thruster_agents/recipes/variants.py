"""Variants: easier settings of a task, by name, to learn it by or to begin a curriculum with.

A variant changes settings of the environment, how long an action is held, who allocates (`LPMapper`, so that
an action is a rate change of the body), and whether evidence is added up in the observation. It is judged by
the same `score` and `success` as the task, within its own settings.

>>> env = make("OrionRendezvous-v1", "near")
>>> env.action_space.shape, env.unwrapped.task.start
((6,), (10.0, 0.0, 0.0))
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

import thruster_envs
from thruster_baselines.detection.evidence import EvidenceObservation, VectorEvidenceObservation
from thruster_baselines.mapping import LPMapper
from thruster_envs.configuration import nearest
from thruster_envs.views import HoldAction, MapperAction, VectorHoldAction, VectorMapperAction

__all__ = ["VARIANTS", "Variant", "make", "make_vec", "variant_of"]


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A named setting of a task.

    Attributes:
        task: Id of the environment, without its namespace.
        name: Of the variant.
        changes: What it changes, one sentence.
        settings: Arguments of the environment that differ from its defaults.
        hold: Control periods for which each action is held.
        command: Largest rate change that can be commanded, as a share of the vehicle's authority: one number
            for translation, one for rotation. None leaves the action as the environment has it.
        evidence: Whether evidence for a fault of each thruster is added to the observation.
    """

    task: str
    name: str
    changes: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    hold: int = 1
    command: tuple[float, float] | None = None
    evidence: bool = False

    @property
    def identifier(self) -> str:
        """The id that `gym.make` knows."""
        return f"{thruster_envs.__name__}/{self.task}"

    def plain(self) -> Variant:
        """The same settings of the environment, with nothing between policy and environment."""
        return replace(self, hold=1, command=None, evidence=False)

    def make(self, **arguments: Any) -> gym.Env[Any, Any]:
        """One environment; arguments as of `gym.make`."""
        env = gym.make(self.identifier, **dict(self.settings) | arguments)
        if self.evidence:
            env = EvidenceObservation(env)
        if self.hold > 1:
            env = HoldAction(env, self.hold)
        if self.command is not None:
            env = MapperAction(env, self._mapper(env))
            shares, space = self._shares(env), env.action_space
            env = gym.wrappers.TransformAction(env, lambda action: np.asarray(action) * shares, space)
        return env

    def make_vec(
        self, worlds: int, *, autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP, **arguments: Any
    ) -> VectorEnv[Any, Any, Any]:
        """The native batch of that many worlds; arguments as of `gym.make_vec`."""
        env: VectorEnv[Any, Any, Any] = gym.make_vec(
            self.identifier,
            num_envs=worlds,
            vectorization_mode="vector_entry_point",
            autoreset_mode=autoreset_mode,
            **dict(self.settings) | arguments,
        )
        if self.evidence:
            env = VectorEvidenceObservation(env)
        if self.hold > 1:
            env = VectorHoldAction(env, self.hold)
        if self.command is not None:
            env = VectorMapperAction(env, self._mapper(env))
            shares, space = self._shares(env), env.action_space
            env = gym.wrappers.vector.TransformAction(
                env, lambda actions: np.asarray(actions) * shares, space, env.single_action_space
            )
        return env

    def _mapper(self, env: Any) -> LPMapper:
        return LPMapper(env.unwrapped.task.vehicle, threads=1)

    def _shares(self, env: Any) -> Any:
        """What each entry of an action is multiplied by, float32."""
        size = env.unwrapped.task.action_size - env.unwrapped.task.vehicle.number_of_thrusters
        assert self.command is not None  # whoever asks has looked
        return np.array([*3 * self.command[:1], *3 * self.command[1:], *size * [1.0]], np.float32)


VARIANTS: tuple[Variant, ...] = (
    Variant(
        task="OrionRendezvous-v1",
        name="near",
        changes="Starts 10 m off, a twentieth of an orbit to go, to a wider box; rate changes are commanded.",
        settings={
            "start": (10.0, 0.0, 0.0), "orbits": 0.05, "range_limit": 50.0, "position_tolerance": 3.0,
            "velocity_tolerance": 0.05, "attitude_tolerance": 0.2, "rate_tolerance": 0.02,
        },
        command=(0.4, 0.001),
    ),
    Variant(
        task="OrionRendezvous-v1",
        name="mapped",
        changes="The whole way, by commanded rate changes.",
        command=(0.4, 0.001),
    ),
    Variant(
        task="MarsRendezvous-v1",
        name="short",
        changes="Starts 5 m off, to a wider box; a rate change is commanded every second and held.",
        settings={
            "distance": 5.0, "offset_tolerance": 0.3, "lateral_tolerance": 0.05, "attitude_tolerance": 0.15,
            "rate_tolerance": 0.03,
        },
        hold=10,
        command=(0.3, 0.2),
    ),
    Variant(
        task="MarsRendezvous-v1",
        name="mapped",
        changes="The whole way, by rate changes that are commanded every second and held.",
        hold=10,
        command=(0.3, 0.2),
    ),
    Variant(
        task="FormationKeeping-v1",
        name="mapped",
        changes="Rate changes are commanded, and the linear program allocates them.",
        command=(0.15, 0.002),
    ),
    Variant(
        task="FormationAttitude-v1",
        name="held",
        changes="Each choice of pulses is held for 30 periods.",
        hold=30,
    ),
    Variant(
        task="FaultDiagnosis-v1",
        name="evidence",
        changes="What speaks for a fault of each thruster is added up in the observation.",
        evidence=True,
    ),
    Variant(
        task="ActiveDiagnosis-v1",
        name="evidence",
        changes="What speaks for a fault of each thruster is added up in the observation.",
        evidence=True,
    ),
    Variant(
        task="PulseDiagnosis-v0",
        name="plain",
        changes="Nothing: the task as it is.",
    ),
)  # fmt: skip


def variant_of(task: str, name: str) -> Variant:
    """The variant of a task.

    Args:
        task: Id of the environment, with or without its namespace.
        name: Of the variant.

    Raises:
        ValueError: There is none; one line says which there are.
    """
    task = task.removeprefix(f"{thruster_envs.__name__}/")
    found = next((one for one in VARIANTS if (one.task, one.name) == (task, name)), None)
    if found is None:
        known = [f"{one.task} {one.name}" for one in VARIANTS]
        near = nearest(f"{task} {name}", known)
        hint = f"did you mean {near!r}?" if near else f"there are {', '.join(known)}"
        raise ValueError(f"variant must be one of a task, got {f'{task} {name}'!r}; {hint}")
    return found


def make(task: str, name: str, **arguments: Any) -> gym.Env[Any, Any]:
    """One environment of a variant; arguments as of `gym.make`."""
    return variant_of(task, name).make(**arguments)


def make_vec(task: str, name: str, worlds: int, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    """The native batch of a variant; arguments as of `gym.make_vec`."""
    return variant_of(task, name).make_vec(worlds, **arguments)
