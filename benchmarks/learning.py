"""How fast an agent learns: Stable-Baselines3's PPO on a native batch through the adapter of this package.

Measured: whole iterations of PPO (a rollout and its updates) in processor seconds of the whole process,
with one thread for PyTorch and one for the environment; and the share of them that the environment takes.
Not measured: whether it learns anything, and the time of callbacks, logging and evaluation.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import gymnasium as gym

from benchmarks.environments import ALL_KINDS, profile
from benchmarks.report import AtLeast, AtMost, Row, Section
from benchmarks.timing import Effort, announce
from thruster_envs.registration import register_all

register_all()

TASKS = ("ThrusterMapping-v0", "OrionRendezvous-v1")
#: Length of a rollout, size of a minibatch (a multiple of it for fewer worlds), passes over a rollout.
ROLLOUT, MINIBATCH, EPOCHS = 32, 4096, 4

ABOUT = f"""\
PPO of Stable-Baselines3 through `SB3VecEnv`: policy and value networks of 64x64, rollouts of {ROLLOUT} steps,
minibatches of {MINIBATCH:,}, {EPOCHS} epochs; every world draws one fault of any kind. Processor seconds are
those of the whole process, one thread for PyTorch and one for the environment."""


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    worlds = 32 if effort.quick else 1024
    rows = []
    for task in TASKS:
        rows += _rows(task, worlds, effort)
    return Section("Learning", ABOUT, rows)


def _rows(task: str, worlds: int, effort: Effort) -> list[Row]:
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    env = _timed(gym.make_vec(f"thruster_envs/{task}", num_envs=worlds, threads=1, faults=ALL_KINDS))
    model = PPO(
        "MlpPolicy", env, n_steps=ROLLOUT, batch_size=min(MINIBATCH, worlds * ROLLOUT), n_epochs=EPOCHS,
        seed=0, device="cpu",
    )  # fmt: skip

    def iterate() -> None:
        model.learn(worlds * ROLLOUT, reset_num_timesteps=False)

    announce(f"PPO on {task}", effort)
    iterate()
    rates, shares = [], []
    for _ in range(effort.repetitions):
        start, in_env = time.process_time(), env.seconds
        iterate()
        spent = time.process_time() - start
        rates.append(worlds * ROLLOUT / spent)
        shares.append(100.0 * (env.seconds - in_env) / spent)

    def explain() -> str:
        return profile(iterate, 1)

    return [
        Row(
            f"PPO on {task}, {worlds:,} worlds", statistics.median(rates), "steps/CPU s", AtLeast(25_000),
            explain=explain,
        ),
        Row(
            f"PPO on {task}, share of the environment", statistics.median(shares), "%", AtMost(10.0),
            note="`step_wait` of the adapter: conversion, step, infos", explain=explain,
        ),
    ]  # fmt: skip


def _timed(env: Any) -> Any:
    """The adapter, which adds up the processor time that its steps take in ``seconds``."""
    from thruster_envs.views import SB3VecEnv

    class Timed(SB3VecEnv):
        seconds = 0.0

        def step_wait(self) -> Any:
            start = time.process_time()
            result = super().step_wait()
            self.seconds += time.process_time() - start
            return result

    return Timed(env)
