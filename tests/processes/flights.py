"""What the tests of processes fly, as digests: the same numbers give the same digest, to the last bit."""

import hashlib
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import thruster_envs  # noqa: F401  # registers the environments
from tests.views.cases import FAULTS, IDS, actions_of, entries, faults_of
from thruster_baselines.mapping import LPMapper
from thruster_envs.missions import fly_missions
from thruster_envs.tasks import FormationAttitude, FormationKeeping
from thruster_envs.views.sb3 import SharedPolicyVecEnv

WORLDS, STEPS = 40, 3  # two blocks of 32 craft, so that two threads have something to share

Flight = Callable[[], str]
"""Flies on and gives the digest of what it saw; the next call goes on from there."""


def digest(*parts: Any) -> str:
    """Of arrays, numbers and dictionaries of them."""
    total = hashlib.sha256()
    for part in parts:
        for name, value in entries(part if isinstance(part, dict) else {"": part}):
            total.update(name.encode())
            total.update(np.ascontiguousarray(value).tobytes())
    return total.hexdigest()


def batch(identifier: str, **arguments: Any) -> Flight:
    """The worlds of an id, with faults, in two threads."""
    env = gym.make_vec(identifier, num_envs=WORLDS, threads=2, faults=faults_of(identifier), **arguments)
    observations, infos = env.reset(seed=5)
    actions = np.stack([actions_of(identifier, world, STEPS) for world in range(WORLDS)])
    begun = [digest(observations, infos)]

    def fly() -> str:
        seen = [digest(*env.step(actions[:, step])) for step in range(STEPS)]
        return digest(np.frombuffer("".join(begun + seen).encode(), np.uint8), env.unwrapped.save_state())

    return fly


def shared(task_type: Any) -> Flight:
    """Formations under one policy, in two threads."""
    env = SharedPolicyVecEnv(WORLDS, task_type=task_type, threads=2, faults=FAULTS)
    env.seed(5)
    env.reset()
    actions = np.stack([env.action_space.sample() * 0] * env.num_envs)

    def fly() -> str:
        return digest(*env.step(actions)[:3], env.worlds.save())

    return fly


def missions() -> Flight:
    """Whole missions, in two threads."""

    def fly() -> str:
        flown = fly_missions([0.3, -0.2, 0.4], steps=5, seeds=range(70), threads=2)
        return digest(flown.attitude, flown.measured_rate, flown.pulses, flown.thrust)

    return fly


def mapping() -> Flight:
    """A batch of linear programs, large enough for two threads."""
    mapper = LPMapper("orion", threads=2)
    commands = np.random.default_rng(0).normal(0.0, 0.01, (600, 6))
    return lambda: digest(mapper(commands).on_times)


FLIGHTS: dict[str, Callable[[], Flight]] = {
    **{identifier: lambda identifier=identifier: batch(identifier) for identifier in IDS},
    "shared policy, positions": lambda: shared(FormationKeeping),
    "shared policy, attitudes": lambda: shared(FormationAttitude),
    "missions": missions,
    "mapping": mapping,
}


def fly_all() -> dict[str, str]:
    """Everything, from the beginning."""
    return {name: make()() for name, make in FLIGHTS.items()}
