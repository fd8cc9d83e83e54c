"""How fast thrust mapping is: the linear program, what is built on it, and other solvers beside it.

One command from Python and in compiled code, along a flight, in batches, on three vehicles and on interior,
saturated and degenerate commands apart (:mod:`benchmarks.problems`); the other mappers
(:mod:`benchmarks.methods`), other solvers (:mod:`benchmarks.solvers`), and what the linear program buys
(:mod:`benchmarks.allocation_value`). Not measured: construction, and the first calls of each.

``python -m benchmarks.mapping`` runs this section alone.
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import allocation_value, methods, solvers
from benchmarks.environments import profile
from benchmarks.problems import KINDS, MIXTURE, VEHICLES, Array, Problems, flight, problems
from benchmarks.report import AtLeast, AtMost, Row, Section, markdown_table, number, section_as_text
from benchmarks.timing import QUICK, Calls, Effort, Timing, Work, clock_cost, race, race_calls
from thruster_baselines.mapping import LPMapper
from thruster_baselines.mapping.sequence import follow_range
from thruster_baselines.mapping.simplex import solve_batch, solve_one, tableau_shape
from thruster_envs.protocols import IntArray

PROBLEMS = 2048
"""Different commands of each vehicle and kind."""

BATCH = 4096
LARGE_BATCH = 65_536

CLOCK = "CLOCK"

ABOUT = f"""\
Commands of six axes to twelve thrusters (6x12: Orion, SPHERES) or to twenty-four (6x24: Orion with a second
thruster of another strength beside each of its own). *Interior* commands can be tracked within the period,
*saturated* ones ask for more of some axis than there is, *degenerate* ones are on one or two axes only;
{PROBLEMS:,} different commands of each. In the *mixture* 30 % of the problems have one thruster dead, a
quarter of the commands is on one or two axes and a quarter four times as large as the rest.

*Kernel*: the compiled solver called from Python with arrays that fit. Each call is timed by itself, by
`time.perf_counter_ns`, whose own {CLOCK} ns are in the figure; the median and the 99th percentile are over
the {PROBLEMS:,} calls, each in turn the median of the repetitions. *In compiled code*: a batch on one thread,
divided by its size. *Public call*: `LPMapper(...)(command)` with its checks. *Along a flight*: commands that
follow each other smoothly, each started from the basis of the one before (`LPMapper.sequence()`), beside the
same commands started cold. A target that holds for every kind of command is judged by the dearest one.
Batches are of the mixture, with an effectiveness of its own for every problem. The gap is the largest
relative difference of the objective to that of HiGHS at tolerances of 1e-10.

{methods.ABOUT}

{solvers.ABOUT}

{allocation_value.ABOUT}"""


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    effort = effort.brief()
    count = 24 if effort.quick else PROBLEMS
    singles = {craft: _one_by_one(effort, craft, count) for craft in VEHICLES}
    rows = [row for craft in VEHICLES for row in _single_rows(effort, craft, singles[craft])]
    for craft in VEHICLES:
        rows += _batches(effort, craft)
    rows += [_gap(craft, count) for craft in VEHICLES]
    rows += _memory(1024 if effort.quick else LARGE_BATCH)
    tables = [_table(singles)]
    for more, table in (
        methods.rows(effort, count),
        solvers.rows(effort, count, kernel),
        allocation_value.rows(240 if effort.quick else allocation_value.REQUESTS),
    ):
        rows += more
        tables.append(table)
    about = ABOUT.replace(CLOCK, number(1e9 * clock_cost()))
    return Section("Thrust mapping", about, rows, "\n\n".join(tables))


# One command ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Single:
    """Times of one command of a vehicle and a kind.

    Attributes:
        kernel: Called from Python.
        public: The public call.
        compiled: In compiled code, s per command.
        flight_cold: Kernel on the commands of a flight, each from all slacks; None for the mixture.
        flight_warm: The same from basis to basis.
        flight_compiled: Cold and warm in compiled code, s per command.
    """

    kernel: Calls
    public: Calls
    compiled: float
    flight_cold: Calls | None = None
    flight_warm: Calls | None = None
    flight_compiled: tuple[Timing, Timing] | None = None


def _one_by_one(effort: Effort, craft: str, count: int) -> dict[str, Single]:
    found = {}
    for kind in (*KINDS, MIXTURE):
        these = problems(count, craft, kind)
        mapper = LPMapper(these.effectiveness, these.max_on_time.max())
        if kind == MIXTURE:
            public: Work = (
                lambda command, matrix, mapper=mapper: mapper(command, effectiveness=matrix),
                list(zip(these.command, these.faulted, strict=True)),
            )
        else:
            public = (mapper, [(command,) for command in these.command])
        calls = race_calls({"kernel": kernel(these), "public call": public}, effort)
        batch = race({"in compiled code": lambda these=these: these.solve(1)}, effort)["in compiled code"]
        found[kind] = Single(calls["kernel"], calls["public call"], batch.seconds / count)
    for kind in KINDS:
        way = flight(count, craft, kind)
        calls = race_calls({"flight, cold": kernel(way), "flight, warm": warm_kernel(way)}, effort)
        follower = LPMapper(way.effectiveness, way.max_on_time[0], threads=1).sequence()
        batches = race(
            {
                "flight, cold, in compiled code": lambda way=way: way.solve(1),
                "flight, warm, in compiled code": lambda way=way, follower=follower: follower(way.command),
            },
            effort,
        )
        alone = found[kind]
        found[kind] = Single(
            alone.kernel, alone.public, alone.compiled, calls["flight, cold"], calls["flight, warm"],
            (batches["flight, cold, in compiled code"], batches["flight, warm, in compiled code"]),
        )  # fmt: skip
    return found


def kernel(these: Problems) -> Work:
    """Calls of the compiled solver from Python, one for each problem."""
    m, n = these.effectiveness.shape
    room = np.empty(n), np.empty(m), np.empty(1), np.empty(3, np.int64)
    return solve_one, [
        (command, these.effectiveness, max_on_time, these.fuel_cost, these.slack_cost, *room)
        for command, max_on_time in zip(these.command, these.max_on_time, strict=True)
    ]


def warm_kernel(these: Problems) -> Work:
    """The same from basis to basis; the vehicle stays the same."""
    memory = _memory_of_a_sequence(these)
    answer = _room(these, 1)
    return follow_range, [
        ((command[np.newaxis, np.newaxis], *_shared(these)), *memory, answer, 0, 1)
        for command in these.command
    ]


def _shared(these: Problems) -> tuple[Array, Array, Array, Array]:
    """What all commands of a flight have in common, as the kernel takes it."""
    return (
        these.effectiveness[np.newaxis], these.max_on_time[:1], these.fuel_cost[np.newaxis], these.slack_cost
    )  # fmt: skip


def _memory_of_a_sequence(these: Problems) -> tuple[Array, IntArray]:
    """The tableau and the age of a sequence that is still to begin."""
    return np.zeros((1, *tableau_shape(*these.effectiveness.shape))), np.zeros(1, np.int64)


def _room(these: Problems, steps: int) -> tuple[Array, Array, Array, IntArray]:
    """Room for the answers to so many commands of one craft: on-times, slack, cost and report."""
    m, n = these.effectiveness.shape
    return (
        np.empty((steps, 1, n)), np.empty((steps, 1, m)), np.empty((steps, 1)),
        np.empty((steps, 1, 3), np.int64),
    )  # fmt: skip


def _single_rows(effort: Effort, craft: str, singles: dict[str, Single]) -> list[Row]:
    """What a vehicle's targets are judged by: the dearest kind of command."""
    large = craft.endswith("6x24")
    first = craft == VEHICLES[0]
    apart = {kind: singles[kind] for kind in KINDS}
    median = _dearest({kind: single.kernel.median for kind, single in apart.items()})
    slowest = _dearest({kind: single.kernel.percentile(99.0) for kind, single in apart.items()})
    compiled = _dearest({kind: single.compiled for kind, single in apart.items()})
    public = _dearest({kind: single.public.median - single.kernel.median for kind, single in apart.items()})
    calls = _dearest({kind: single.public.median for kind, single in apart.items()})
    warm = {kind: single.flight_warm for kind, single in apart.items() if single.flight_warm is not None}
    warmest = _dearest({kind: each.median for kind, each in warm.items()})
    gains = ", ".join(
        f"{each.times_faster_than(apart[kind].flight_cold or each):.2f} ({kind})"
        for kind, each in warm.items()
    )
    both = {kind: single.flight_compiled for kind, single in apart.items() if single.flight_compiled}
    inside = _dearest({kind: pair[1].seconds for kind, pair in both.items()})
    gains_inside = ", ".join(
        f"{pair[1].times_faster_than(pair[0]):.2f} ({kind})" for kind, pair in both.items()
    )
    commands = len(singles[KINDS[0]].kernel.rounds[0])
    target, warm_target = (4.0, 2.0) if large else (3.0, 1.5)
    kernel_note, explain = f"dearest kind: {median[1]}", lambda: _explain(effort, craft, median[1])
    return [
        Row(
            f"{craft}: kernel", 1e6 * median[0], "µs", AtMost(target), note=kernel_note, explain=explain,
            charted=True,
        ),
        Row(
            f"{craft}: kernel, 99th percentile", 1e6 * slowest[0], "µs", AtMost(10.0),
            note=f"dearest kind: {slowest[1]}", explain=lambda: _explain(effort, craft, slowest[1]),
        ),
        Row(
            f"{craft}: kernel, in compiled code", 1e6 * compiled[0], "µs",
            note=f"dearest kind: {compiled[1]}",
        ),
        Row(
            f"{craft}: public call", 1e6 * calls[0], "µs", note=f"dearest kind: {calls[1]}", charted=first,
        ),
        Row(
            f"{craft}: public call, more than the kernel", 1e6 * public[0], "µs", AtMost(5.0),
            note=f"dearest kind: {public[1]}", explain=lambda: _explain_public(effort, craft, public[1]),
        ),
        Row(
            f"{craft}: public call, with an effectiveness of its own", 1e6 * singles[MIXTURE].public.median,
            "µs", note="of the mixture, checked anew for every command",
        ),
        Row(
            f"{craft}: warm along a flight, kernel", 1e6 * warmest[0], "µs", AtMost(warm_target),
            ratio=f"{gains} times as fast as cold", note=f"dearest kind: {warmest[1]}", charted=True,
            explain=lambda: _explain_flight(craft, warmest[1], commands),
        ),
        Row(
            f"{craft}: warm along a flight, in compiled code", 1e6 * inside[0] / commands, "µs",
            ratio=f"{gains_inside} times as fast as cold", note=f"dearest kind: {inside[1]}",
        ),
    ]  # fmt: skip


def _dearest(times: dict[str, float]) -> tuple[float, str]:
    """The longest of some times, and whose it is."""
    kind = max(times, key=times.__getitem__)
    return times[kind], kind


def _table(singles: dict[str, dict[str, Single]]) -> str:
    headings = (
        "vehicle", "commands", "kernel", "99th percentile", "in compiled code", "public call",
        "99th percentile", "flight, cold", "flight, warm", "99th percentile", "times as fast",
        "flight in compiled code, cold", "warm", "times as fast",
    )  # fmt: skip
    lines = []
    for craft, kinds in singles.items():
        for kind, single in kinds.items():
            line = [craft, kind]
            line += [_micro(single.kernel.median), _micro(single.kernel.percentile(99.0))]
            line += [_micro(single.compiled)]
            line += [_micro(single.public.median), _micro(single.public.percentile(99.0))]
            if single.flight_cold is None or single.flight_warm is None or single.flight_compiled is None:
                line += ["–"] * 7
            else:
                count = single.kernel.rounds.shape[1]
                cold, warm = single.flight_compiled
                line += [_micro(single.flight_cold.median), _micro(single.flight_warm.median)]
                line += [_micro(single.flight_warm.percentile(99.0))]
                line += [f"{single.flight_warm.times_faster_than(single.flight_cold):.2f}"]
                line += [_micro(cold.seconds / count), _micro(warm.seconds / count)]
                line += [f"{warm.times_faster_than(cold):.2f}"]
            lines.append(line)
    return "### One command, by vehicle and kind (µs)\n\n" + markdown_table(headings, lines)


def _micro(seconds: float) -> str:
    return number(1e6 * seconds)


def _explain(effort: Effort, craft: str, kind: str) -> str:
    """What a call from Python adds to the solver, and what the solver does."""
    these = problems(64 if effort.quick else PROBLEMS, craft, kind)
    count = len(these.command)
    calls = race_calls({"from Python": kernel(these)}, effort)["from Python"]
    batch = race({"in compiled code": lambda: these.solve(1)}, effort)["in compiled code"]
    report = solve_batch(
        these.command, these.effectiveness[np.newaxis], these.max_on_time, these.fuel_cost[np.newaxis],
        these.slack_cost,
    )[3]  # fmt: skip
    lines = [
        ("from Python, median (µs)", _micro(calls.median)),
        ("in compiled code, mean (µs)", _micro(batch.seconds / count)),
        ("changes of basis, mean", number(float(report[:, 1].mean()))),
        ("changes of basis, most", number(float(report[:, 1].max()))),
        ("runs from bound to bound, mean", number(float(report[:, 2].mean()))),
    ]
    return markdown_table(("part", "value"), lines)


def _explain_public(effort: Effort, craft: str, kind: str) -> str:
    these = problems(64 if effort.quick else PROBLEMS, craft, kind)
    mapper = LPMapper(these.effectiveness, these.max_on_time[0])
    commands = list(these.command)

    def work() -> None:
        for command in commands:
            mapper(command)

    return profile(work, 2 if effort.quick else 20)


def _explain_flight(craft: str, kind: str, commands: int) -> str:
    """How much there is to repair from command to command, beside a start from all slacks."""
    way = flight(commands, craft, kind)
    room = _room(way, commands)
    commands_of_one = way.command[:, np.newaxis], *_shared(way)
    follow_range(commands_of_one, *_memory_of_a_sequence(way), room, 0, 1)
    effectiveness, _, fuel_cost, slack_cost = _shared(way)
    cold = solve_batch(way.command, effectiveness, way.max_on_time, fuel_cost, slack_cost)[3]
    lines = [
        (name, number(float(changes.mean())), f"{np.mean(changes == 0):.0%}")
        for name, changes in (("warm", room[3][:, 0, 1]), ("cold", cold[:, 1]))
    ]
    return markdown_table(("start", "changes of basis, mean", "commands without any"), lines)


# Batches, gap and memory ----------------------------------------------------------------------------------


def _batches(effort: Effort, craft: str) -> list[Row]:
    count = 64 if effort.quick else BATCH
    these = problems(count, craft, seed=1)
    faulted, bound, fuel_cost = these.faulted, these.max_on_time, these.fuel_cost[np.newaxis]
    mapper = LPMapper(these.effectiveness, bound.max())

    def with_threads(threads: int) -> Callable[[], object]:
        return lambda: solve_batch(these.command, faulted, bound, fuel_cost, these.slack_cost, threads)

    times = race(
        {
            "one thread": with_threads(1),
            "two threads": with_threads(2),
            "public": lambda: mapper(these.command, effectiveness=faulted),
        },
        effort,
        threaded=True,
    )
    rate = {name: timing.per_second(count) for name, timing in times.items()}
    gain = times["two threads"].times_faster_than(times["one thread"])
    target = AtLeast(5e5 if craft.endswith("6x24") else 1e6)
    return [
        Row(f"{craft}: batch of {count:,}, one thread", rate["one thread"], "LP/s"),
        Row(
            f"{craft}: batch of {count:,}, two threads", rate["two threads"], "LP/s", target,
            ratio=f"{gain:.2f} times one thread", charted=True,
            explain=lambda: _explain(effort, craft, MIXTURE),
        ),
        Row(
            f"{craft}: batch of {count:,}, public call", rate["public"], "LP/s",
            ratio=f"{times['public'].times_faster_than(times['two threads']):.2f} times two threads",
            note="as many threads as processors, arrays checked",
        ),
    ]  # fmt: skip


def _gap(craft: str, count: int) -> Row:
    """How far the kernel's objective is from that of HiGHS, over the mixture."""
    these = problems(count, craft, seed=2)
    cost, referee = these.solve()[2], solvers.tight_highs(these)
    gaps = [abs(cost[i] - referee(i)) / cost[i] for i in range(count)]
    largest = max(float(np.finfo(np.float64).eps), *gaps)
    return Row(
        f"{craft}: largest gap to HiGHS", largest, "of the objective", AtMost(1e-10),
        note=f"of {count:,} problems of the mixture; median {number(float(np.median(gaps)))}",
    )  # fmt: skip


def _memory(count: int) -> list[Row]:
    """Peak of what a large batch allocates, the answer included, by `tracemalloc`."""
    these = problems(count, kind=KINDS[0])
    faulted = np.repeat(these.effectiveness[np.newaxis], count, axis=0)
    mapper = LPMapper(these.effectiveness, these.max_on_time[0])
    mapper(these.command[:8])
    mapper(these.command[:8], effectiveness=faulted[:8])
    plain = peak_memory(lambda: mapper(these.command))
    own = peak_memory(lambda: mapper(these.command, effectiveness=faulted))
    answer = mapper(these.command)
    kept = sum(array.nbytes for array in (answer.on_times, answer.slack, answer.cost, answer.status))
    return [
        Row(
            f"batch of {count:,}: peak of additional memory", plain / 1e6, "MB",
            note=f"by `tracemalloc`; {number(plain / count)} bytes a command, "
            f"of which the answer takes {number(kept / count)}",
        ),
        Row(
            f"batch of {count:,}: the same with an effectiveness for each", own / 1e6, "MB",
            note=f"{number(own / count)} bytes a command; the effectiveness itself, not counted, has "
            f"{number(faulted.nbytes / count)}",
        ),
    ]  # fmt: skip


def peak_memory(work: Callable[[], object]) -> int:
    """Largest number of bytes that Python and NumPy hold for some work at a time, its result included."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        result = work()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    del result
    return peak - before


def main(arguments: Sequence[str] = ()) -> None:
    """Measure and print this section."""
    print(section_as_text(measure(QUICK if "--quick" in arguments else Effort())))


if __name__ == "__main__":
    main(sys.argv[1:])
