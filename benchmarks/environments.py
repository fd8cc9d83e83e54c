"""How fast the environments step: one world, a batch, two threads, growth with the batch.

Measured on ``OrionRendezvous-v1``, and a batch of ``MarsRendezvous-v1``: whole steps, from actions to
observation, reward, flags and info, with scatter, sensor noise, faults and the resets that fall due
(NEXT_STEP). Not measured: compilation, construction, rendering and the policy, whose actions are drawn
beforehand.
"""

from __future__ import annotations

import cProfile
import pstats
from collections.abc import Callable
from itertools import cycle
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import AtLeast, AtMost, Row, Section, markdown_table, number
from benchmarks.timing import Effort, Timing, race
from thruster_envs.registration import register_all

register_all()

TASK = "thruster_envs/OrionRendezvous-v1"
MARS_TASK = "thruster_envs/MarsRendezvous-v1"
ONE_DEAD = [{"thruster": 1, "kind": "stuck_off"}]
ALL_KINDS = {"probability": 1.0}
DEAD = {"probability": 1.0, "kinds": ["stuck_off"]}

ABOUT = f"""\
`{TASK}`, complete steps with firing scatter and sensor noise. The single environment has thruster 1 dead
and is flown with twelve different duties below 1 %, so that its episodes last. In the batch every duty
is drawn anew for every period: uniform in 0..1 (all twelve differ: thirteen pieces a period), or open
for the whole period with a probability of 10 % and shut else. Craft that such duties spin up leave the
bounds, and their resets (autoreset NEXT_STEP) are part of the time; *out of no bounds* has the same
craft with the bounds out of reach, so that episodes last as they do under control. *All kinds*: every
world carries one fault of any of the seven kinds, equally likely, from the start of each episode, as
`FaultDistribution(probability=1.0)` draws it. `MarsRendezvous-v1` is flown in the same way, all duties
drawn anew; its period of 0.1 s is one sub-step, as exact as ten of 10 ms."""


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    worlds, many = (64, 128) if effort.quick else (1024, 4096)
    single_rows = _single(effort)
    batch_rows = _batch(effort, worlds)
    mars_rows = _mars(effort, many)
    thread_rows = _threads(effort, many)
    growth_rows, appendix = _growth(effort)
    return Section(
        "Environments", ABOUT, [*single_rows, *batch_rows, *mars_rows, *thread_rows, *growth_rows], appendix
    )


# One world ------------------------------------------------------------------------------------------------


def calm_flight(env: gym.Env[Any, Any]) -> Callable[[], None]:
    """One step of a single environment after another, with duties below 1 %, resets where they fall due."""
    rng = np.random.default_rng(0)
    actions = cycle(
        list((0.02 * rng.random((256, *(env.action_space.shape or ()))) - 1.0).astype(np.float32))
    )
    env.reset(seed=0)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(next(actions))
        if terminated or truncated:
            env.reset()

    return step


def _single(effort: Effort) -> list[Row]:
    env = gym.make(TASK, faults=ONE_DEAD)
    bare = gym.make(TASK, faults=ONE_DEAD).unwrapped
    works = {"wrapped": calm_flight(env), "bare": calm_flight(bare), "kernel": kernel_flight()}
    times = race(works, effort)
    rate = {name: timing.per_second(1.0) for name, timing in times.items()}
    return [
        Row(
            "one world, `gym.make` with its wrappers", rate["wrapped"], "steps/s",
            AtLeast(60_000, bound=40_000),
            note="thruster 1 dead; PassiveEnvChecker and OrderEnforcing on",
            explain=lambda: profile(works["wrapped"], 300 if effort.quick else 20_000), charted=True,
        ),
        Row(
            "one world, without wrappers", rate["bare"], "steps/s",
            ratio=f"{times['bare'].times_faster_than(times['wrapped']):.2f} times the wrapped one",
        ),
        Row(
            "one world, kernel alone", 1e6 / PERIODS * times["kernel"].seconds, "µs/period", AtMost(5.0),
            note="`Fleet.fly()`: firing, flight, sensors",
            explain=lambda: _explain_one_world(effort),
        ),
    ]  # fmt: skip


#: Periods that :func:`kernel_flight` flies in one call.
PERIODS = 100


def kernel_flight(*, move: bool = True) -> Callable[[], None]:
    """A hundred calls of the kernel for one craft, always from the same state."""
    env: Any = gym.make(TASK, faults=ONE_DEAD)
    calm_flight(env)()
    fleet = env.unwrapped.worlds.fleet
    saved = fleet.state()

    def fly() -> None:
        fleet.restore(saved)
        for _ in range(PERIODS):
            fleet.fly(move=move)

    return fly


def _explain_one_world(effort: Effort) -> str:
    parts = {"fire only": kernel_flight(move=False), "fire, fly and look": kernel_flight()}
    times = race(parts, effort)
    lines = [(name, number(1e6 / PERIODS * timing.seconds)) for name, timing in times.items()]
    return markdown_table(("variant", "µs"), lines)


# A batch --------------------------------------------------------------------------------------------------


class BatchFlight:
    """A native batch that is stepped again and again with actions drawn beforehand.

    Args:
        worlds: How many.
        whole_periods: Whether thrusters are on or off for whole periods; else all duties differ.
        faults: As the environment takes them.
        threads: Threads that share a step.
        task: Id of the environment.
        configuration: Fields of the task.
    """

    def __init__(
        self,
        worlds: int,
        *,
        whole_periods: bool = False,
        faults: Any = ALL_KINDS,
        threads: int = 1,
        task: str = TASK,
        **configuration: Any,
    ) -> None:
        self.env: Any = gym.make_vec(task, num_envs=worlds, threads=threads, faults=faults, **configuration)
        self.env.reset(seed=0)
        self.worlds, self.resets, self.steps = worlds, 0, 0
        rng = np.random.default_rng(0)
        self.choices: list[NDArray[np.float32]] = []
        for _ in range(8 if worlds > 8192 else 64):
            drawn = rng.random(self.env.action_space.shape)
            actions = np.where(drawn < 0.1, 1.0, -1.0) if whole_periods else 2.0 * drawn - 1.0
            self.choices.append(actions.astype(np.float32))

    def __call__(self) -> None:
        """One step."""
        _, _, terminated, truncated, _ = self.env.step(self.choices[self.steps % len(self.choices)])
        self.steps += 1
        self.resets += int(np.count_nonzero(terminated | truncated))

    @property
    def share_of_resets(self) -> float:
        """How many of the world-steps so far began an episode."""
        return self.resets / max(1, self.steps * self.worlds)


#: Name to faults and configuration of the batches that are compared.
BATCHES: dict[str, dict[str, Any]] = {
    "healthy": {"faults": None},
    "thruster dead": {"faults": DEAD},
    "all kinds": {"faults": ALL_KINDS},
    "all kinds, out of no bounds": {"faults": ALL_KINDS, "range_limit": 1e9, "rate_limit": 1e9},
}


def _batch(effort: Effort, worlds: int) -> list[Row]:
    rows = []
    for duties, target in (("all duties differ", 800_000), ("whole periods", 3_000_000)):
        flights = {
            name: BatchFlight(worlds, whole_periods=duties == "whole periods", **configuration)
            for name, configuration in BATCHES.items()
        }
        times = race(flights, effort)
        rows += [
            Row(
                f"{worlds:,} worlds, 1 thread, {duties}, {name}", times[name].per_second(worlds), "steps/s",
                AtLeast(target) if name.startswith("all kinds") else None,
                ratio="" if name == "healthy" else _against(times[name], times["healthy"]),
                note=f"{flight.share_of_resets:.1%} of the world-steps begin an episode",
                explain=_explanation(flight, times[name], effort) if name == "all kinds" else None,
                charted=name == "all kinds",
            )
            for name, flight in flights.items()
        ]  # fmt: skip
    return rows


def _mars(effort: Effort, worlds: int) -> list[Row]:
    flights = {
        name: BatchFlight(worlds, faults=faults, task=MARS_TASK)
        for name, faults in (("healthy", None), ("all kinds", ALL_KINDS))
    }
    times = race(flights, effort)
    return [
        Row(
            f"MarsRendezvous-v1, {worlds:,} worlds, 1 thread, {name}", times[name].per_second(worlds),
            "steps/s", AtLeast(500_000),
            ratio="" if name == "healthy" else _against(times[name], times["healthy"]),
            note=f"{flight.share_of_resets:.1%} of the world-steps begin an episode",
        )
        for name, flight in flights.items()
    ]  # fmt: skip


def _against(timing: Timing, healthy: Timing) -> str:
    return f"{timing.times_faster_than(healthy):.2f} times healthy"


def _explanation(flight: BatchFlight, timing: Timing, effort: Effort) -> Callable[[], str]:
    return lambda: _breakdown(flight, timing, effort)


def _breakdown(flight: BatchFlight, whole: Timing, effort: Effort) -> str:
    """Parts of a step, each timed by itself on the batch as the benchmark left it; and a profile."""
    vector = flight.env.unwrapped
    worlds, task, state = vector.worlds, vector.task, vector.worlds.state
    fleet, everyone = worlds.fleet, np.ones(flight.worlds, bool)
    saved = vector.save_state()
    step = worlds.step(flight.choices[0][:, np.newaxis])
    actions = flight.choices[0][:, np.newaxis]

    def judge_again() -> None:
        task.outcome(state)
        task.truth(state)

    parts: dict[str, Callable[[], object]] = {
        "fire (`fly(move=False)`)": lambda: fleet.fly(move=False),
        "fire, fly and look (`fly()`)": fleet.fly,
        "command, fly, judge (`task.step`)": lambda: task.step(state, 0.5 * actions + 0.5),
        "all of `Worlds.step`": lambda: worlds.step(actions),
        "of which: observe": lambda: task.observe(state),
        "of which: outcome and truth": judge_again,
        "info (`Worlds.info`)": lambda: worlds.info(step),
        "reset of every world": lambda: worlds.reset(np.flatnonzero(everyone)),
    }
    lines = []
    for name, work in parts.items():
        vector.restore_state(saved)
        lines.append((name, number(1e9 * race({name: work}, effort)[name].seconds / flight.worlds)))
    vector.restore_state(saved)
    lines.append(("the whole step", number(1e9 * whole.seconds / flight.worlds)))
    table = markdown_table(("part", "ns per world"), lines)
    return f"{table}\n\n{profile(flight, 3 if effort.quick else 100)}"


# Threads and growth ---------------------------------------------------------------------------------------


def _threads(effort: Effort, worlds: int) -> list[Row]:
    flights = {threads: BatchFlight(worlds, threads=threads) for threads in (1, 2)}
    times = race({str(threads): flight for threads, flight in flights.items()}, effort, threaded=True)
    gain = times["2"].times_faster_than(times["1"])
    return [
        Row(
            f"{worlds:,} worlds, {threads} thread{'s' if threads > 1 else ''}, all duties differ, all kinds",
            times[str(threads)].per_second(worlds), "steps/s", charted=threads > 1,
        )
        for threads in flights
    ] + [
        Row(
            f"{worlds:,} worlds, 2 threads over 1", gain, "times", AtLeast(1.75),
            explain=lambda: profile(flights[2], 3 if effort.quick else 50),
        )
    ]  # fmt: skip


def _growth(effort: Effort) -> tuple[list[Row], str]:
    sizes = (32, 64, 128) if effort.quick else (64, 256, 1024, 4096, 16_384, 65_536)
    flights = {str(worlds): BatchFlight(worlds) for worlds in sizes}
    times = race(flights, effort)
    cost = {worlds: 1e9 * times[str(worlds)].seconds / worlds for worlds in sizes}
    lines = [
        (
            f"{worlds:,}",
            number(cost[worlds]),
            number(1e-3 * cost[worlds] * worlds),
            number(1e9 / cost[worlds]),
        )
        for worlds in sizes
    ]
    usual = 64 if effort.quick else 1024
    worst = max(cost[worlds] for worlds in sizes if worlds >= usual) / cost[usual]
    table = markdown_table(("worlds", "ns per world-step", "µs per step", "steps/s"), lines)
    row = Row(
        f"cost of a world-step up to {sizes[-1]:,} worlds over that at {usual:,}", worst, "times",
        AtMost(1.25),
        note="1 when the cost of a step grows linearly with the batch",
    )  # fmt: skip
    return [row], f"### Growth with the batch (one thread, all duties differ, all kinds)\n\n{table}"


def profile(work: Callable[[], object], calls: int, lines: int = 14) -> str:
    """Functions in which ``calls`` calls of ``work`` spend their time, by their own time, as a table."""
    for _ in range(min(calls, 10)):
        work()
    profiler = cProfile.Profile()
    profiler.enable()
    for _ in range(calls):
        work()
    profiler.disable()
    stats: dict[tuple[str, int, str], tuple[int, int, float, float, Any]] = pstats.Stats(profiler).stats  # type: ignore[attr-defined]  # undocumented, but there since 1994
    total = sum(entry[2] for entry in stats.values())
    ranked = sorted(stats.items(), key=lambda item: -item[1][2])[:lines]
    rows = [
        (
            f"`{name}`" if line == 0 else f"`{name}` ({file.rpartition('/')[2]}:{line})",
            number(entry[1] / calls),
            f"{entry[2] / total:.0%}",
            f"{min(1.0, entry[3] / total):.0%}",
        )
        for (file, line, name), entry in ranked
    ]
    note = "By `cProfile`, which makes calls of small functions look dearer than they are."
    return f"{note}\n\n{markdown_table(('function', 'calls per step', 'own time', 'with callees'), rows)}"
