"""How fast the environments step beside Gymnasium's CartPole in the same run; and the first step of all.

Ratios within one race hold on any machine; their targets are those that the environments are built to.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.environments import MARS_TASK, ONE_DEAD, TASK, BatchFlight, calm_flight, profile
from benchmarks.formation import CRAFT, random_steps
from benchmarks.formation import TASK as PLASMA_TASK
from benchmarks.report import AtLeast, AtMost, Row, Section, markdown_table, number
from benchmarks.timing import Effort, announce, race
from thruster_envs.registration import ENVIRONMENTS

ABOUT = f"""\
Whole steps of `{TASK}` and others beside Gymnasium's CartPole, both in turns in the same run: one world each
through `gym.make`, and batches beside CartPole's own vector form (1,024 worlds). *Share of CartPole's* is
steps per second over CartPole's. What is flown stands under Environments; the plasma formation is
`{PLASMA_TASK}`, {CRAFT} craft in each world, counted by craft; its target and that of
MarsRendezvous-v1 are 1.5 times their shares of November 2026. The first step is that of a new process with
an empty kernel cache, from `import` on."""

#: Shares of CartPole's in a run of November 2026, and how many times them is asked for.
_MARS, _PLASMA, _GAIN = 0.0918, 0.2295, 1.5


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    worlds, many = (64, 128) if effort.quick else (1024, 4096)
    singles, appendix = _singles(effort)
    rows = [*singles, *_batches(effort, worlds, many), *_few(effort)]
    if not effort.quick:
        rows += _first_step()
    return Section("Beside CartPole", ABOUT, rows, appendix)


def cart_pole() -> Callable[[], None]:
    """One step of CartPole after another through ``gym.make``, resets where they fall due."""
    env = gym.make("CartPole-v1")
    env.reset(seed=0)
    pushes = np.random.default_rng(0).integers(0, 2, 1024).tolist()
    count = 0

    def step() -> None:
        nonlocal count
        count += 1
        _, _, terminated, truncated, _ = env.step(pushes[count % 1024])
        if terminated or truncated:
            env.reset()

    return step


def cart_poles(worlds: int) -> Callable[[], object]:
    """One step of CartPole's own vector form after another."""
    poles: Any = gym.make_vec("CartPole-v1", num_envs=worlds, vectorization_mode="vector_entry_point")
    poles.reset(seed=0)
    pushes = np.random.default_rng(0).integers(0, 2, worlds)
    return lambda: poles.step(pushes)


def _singles(effort: Effort) -> tuple[list[Row], str]:
    works = {"CartPole": cart_pole(), TASK: calm_flight(gym.make(TASK, faults=ONE_DEAD))}
    works |= {name: drawn_flight(name) for name in ENVIRONMENTS if name != TASK}
    times = race(works, effort.brief())
    share = {name: timing.times_faster_than(times["CartPole"]) for name, timing in times.items()}
    row = Row(
        "one world through `gym.make`", share[TASK], "share of CartPole's", AtLeast(0.4),
        ratio=f"{number(times[TASK].per_second(1.0))} steps/s",
        explain=lambda: profile(works[TASK], 300 if effort.quick else 20_000),
    )  # fmt: skip
    lines = [
        (name.removeprefix("thruster_envs/"), number(1e6 * times[name].seconds), number(share[name]))
        for name in works
    ]
    table = markdown_table(("one world through `gym.make`", "µs per step", "share of CartPole's"), lines)
    return [row], f"### Every environment, one world\n\n{table}"


def drawn_flight(name: str) -> Callable[[], None]:
    """One step of a single environment after another under drawn actions, duties below 1 %."""
    env = gym.make(name)
    env.action_space.seed(0)
    drawn = [env.action_space.sample() for _ in range(256)]
    if isinstance(env.action_space, gym.spaces.Box):
        drawn = [(0.01 * (action + 1.0) - 1.0).astype(np.float32) for action in drawn]
    env.reset(seed=0)
    count = 0

    def step() -> None:
        nonlocal count
        count += 1
        _, _, terminated, truncated, _ = env.step(drawn[count % 256])
        if terminated or truncated:
            env.reset()

    return step


def _batches(effort: Effort, worlds: int, many: int) -> list[Row]:
    orion = f"{worlds:,} worlds, 1 thread, all kinds of fault"
    plasma: Any = gym.make_vec(PLASMA_TASK, num_envs=worlds, threads=1, craft=CRAFT)
    works: dict[str, tuple[Callable[[], object], int, float]] = {
        f"{orion}, whole periods": (BatchFlight(worlds, whole_periods=True), worlds, 1 / 4.5),
        f"{orion}, all duties differ": (BatchFlight(worlds), worlds, 1 / 10),
        f"MarsRendezvous-v1, {many:,} worlds, 1 thread, all kinds of fault": (
            BatchFlight(many, task=MARS_TASK), many, _GAIN * _MARS,
        ),
        f"plasma formation, {worlds:,} worlds, 1 thread": (
            random_steps(plasma), CRAFT * worlds, _GAIN * _PLASMA,
        ),
    }  # fmt: skip
    poles = cart_poles(worlds)
    times = race({"CartPole": poles} | {name: work for name, (work, _, _) in works.items()}, effort)
    return [
        Row(
            name, times[name].times_faster_than(times["CartPole"], amount, worlds), "share of CartPole's",
            AtLeast(target), ratio=f"{number(times[name].per_second(amount))} steps/s",
            explain=_explanation(work, effort),
        )
        for name, (work, amount, target) in works.items()
    ]  # fmt: skip


def _explanation(work: Callable[[], object], effort: Effort) -> Callable[[], str]:
    return lambda: profile(work, 3 if effort.quick else 100)


def _few(effort: Effort) -> list[Row]:
    flight = BatchFlight(8, whole_periods=True)
    time = race({"few": flight}, effort)["few"]
    return [
        Row(
            "8 worlds natively, whole periods, all kinds of fault", time.per_second(8), "steps/s",
            AtLeast(300_000), explain=_explanation(flight, effort),
        )
    ]  # fmt: skip


_FIRST = """
import time
start = time.perf_counter()
import gymnasium, thruster_envs
env = gymnasium.make("{name}")
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - start)
"""


def _first_step() -> list[Row]:
    """Each environment by itself: its first step, in a new process without compiled kernels."""
    taken = {}
    for name in ENVIRONMENTS:
        announce(f"first step of {name}", Effort())
        with tempfile.TemporaryDirectory() as folder:
            own = os.environ | {"THRUSTER_ENVS_CACHE_DIR": folder}
            command = [sys.executable, "-c", _FIRST.format(name=name)]
            done = subprocess.run(command, env=own, capture_output=True, text=True, check=True)
        taken[name] = float(done.stdout)
    slowest = max(taken, key=lambda name: taken[name])
    lines = [(name.removeprefix("thruster_envs/"), number(seconds)) for name, seconds in taken.items()]
    return [
        Row(
            "first step without compiled kernels, slowest environment", taken[slowest], "s", AtMost(15.0),
            note=slowest.removeprefix("thruster_envs/"),
            explain=lambda: markdown_table(("first step of", "s"), lines),
        )
    ]  # fmt: skip
