"""Table 3: how far the linear program and SPHERES' crude map deviate from what the controller asks for.

The source names neither the commands nor the rule of the crude map beyond "turned on the thrusters that are
pointed in the direction of the desired motion". Deviation is the size of the miss over that of the command,
in shares of authority. Commands of four kinds are drawn, all of which thrusters can meet. The crude rule is
read in three ways: shared among the thrusters that help on the same axis (`CrudeMapper`), not shared, and all
that help open for the same time, the one that comes nearest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from reproductions.figures import Figure, panels, reference_line
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.spheres_loop import LOOP_PERIOD, SPHERES, regulate, relative_deviation
from thruster_baselines.mapping import CrudeMapper, LPMapper
from thruster_envs.protocols import FloatArray

REPORTED_CRUDE = 0.1518
REPORTED_GAIN = 0.15  # in the conclusions: accuracy, not fuel
SEED = 5
EXACT = 1e-12

EFFECTIVENESS = SPHERES.effectiveness()
AUTHORITY = SPHERES.authority(LOOP_PERIOD)
KINDS = {"one axis": 1, "two axes": 2, "three axes": 3, "six axes": 6}


@reproduces(
    "E05",
    lines="L445-451, Table 3",
    reported="average deviation 0 % and 15.18 %",
    criterion="the linear program exact on commands that can be met, the crude map not",
)
def accuracy(effort: Effort) -> Finding:
    """Accuracy of the linear program and of SPHERES' crude map."""
    rng = np.random.default_rng(SEED)
    sets = {name: reachable_commands(rng, effort.samples, axes) for name, axes in KINDS.items()}
    flown = regulate(LPMapper(SPHERES, max_on_time=LOOP_PERIOD), effort.flights)
    sets["of a loop at 20 Hz"] = flown.commands[:: round(1.0 / LOOP_PERIOD)].reshape(-1, 6)
    means = {
        rule: {name: float(deviation(allocate, commands).mean()) for name, commands in sets.items()}
        for rule, allocate in RULES.items()
    }
    exact = max(means["linear program"].values())
    crude = [value for rule in CRUDE for value in means[rule].values()]
    within = min(crude) <= REPORTED_CRUDE <= max(crude)
    table = Table(
        "Mean deviation from the command, %; reported: 0 and 15.18",
        ("rule", *sets),
        [(rule, *map(percent, line.values())) for rule, line in means.items()],
    )
    return Finding(
        ours=f"linear program {percent(exact)} %; crude map {percent(min(crude))} to {percent(max(crude))} "
        "%, by how its rule is read and by the commands",
        checks={
            "the linear program misses nothing of any command": exact < EXACT,
            "the crude map in the library does, of commands of every kind": (
                min(means["crude, shared"].values()) > 0.01
            ),
        },
        not_reproducible=f"the {100.0 * REPORTED_CRUDE:.4g} % of the crude map; neither its rule nor the "
        f"commands are given, and readings of the rule lie {'on both sides' if within else 'on one side'} of "
        "it",
        note="On this vehicle the effects of thrusters that help each other are at right angles, so that the "
        "rule without sharing is exact, and the rule with sharing gives half of every command. Vehicle "
        f"and gains of the loop are external. {effort.samples} commands of each kind.",
        data={"mean_deviation": means},
        tables=(table,),
        figure=lambda: _draw(means),
    )


def percent(share: float) -> str:
    """A share in %, zero if it is round-off."""
    return "0" if share < EXACT else f"{100.0 * share:.3g}"


def reachable_commands(rng: np.random.Generator, count: int, axes: int) -> FloatArray:
    """Commands (count, 6) on so many axes, drawn anew for each, that can be met for certain."""
    shares = rng.exponential(size=(count, axes + 1))
    shares = shares[:, :axes] / shares.sum(axis=1, keepdims=True)
    chosen = rng.permuted(np.tile(np.arange(6), (count, 1)), axis=1)[:, :axes]
    commands = np.zeros((count, 6))
    np.put_along_axis(commands, chosen, shares * rng.choice([-1.0, 1.0], shares.shape), axis=1)
    return commands * AUTHORITY


def deviation(allocate: Callable[[FloatArray], FloatArray], commands: FloatArray) -> FloatArray:
    """(count,) of on-times that a rule gives for commands."""
    return relative_deviation(allocate(commands) @ EFFECTIVENESS.T, commands, AUTHORITY)


def by_linear_program(commands: FloatArray) -> FloatArray:
    """On-times (count, n), s."""
    return LPMapper(SPHERES, max_on_time=LOOP_PERIOD)(commands).on_times


def shared(commands: FloatArray) -> FloatArray:
    """On-times (count, n), s, of the crude map as the library has it."""
    return CrudeMapper(SPHERES, max_on_time=LOOP_PERIOD)(commands).on_times


def not_shared(commands: FloatArray) -> FloatArray:
    """On-times (count, n), s: each thruster that helps does what would be right if it were alone."""
    columns = EFFECTIVENESS / AUTHORITY[:, np.newaxis]
    alone = (commands / AUTHORITY) @ columns / np.square(columns).sum(axis=0)
    on_times: FloatArray = np.clip(alone, 0.0, LOOP_PERIOD)
    return on_times


def for_the_same_time(commands: FloatArray) -> FloatArray:
    """On-times (count, n), s: all thrusters that help are open for the time that comes nearest."""
    columns = EFFECTIVENESS / AUTHORITY[:, np.newaxis]
    helping = ((commands / AUTHORITY) @ columns > 1e-9).astype(np.float64)
    together = helping @ columns.T
    size = np.square(together).sum(axis=1)
    time = (together * commands / AUTHORITY).sum(axis=1) / np.where(size > 0.0, size, 1.0)
    on_times: FloatArray = helping * np.clip(time, 0.0, LOOP_PERIOD)[:, np.newaxis]
    return on_times


CRUDE = {"crude, shared": shared, "crude, not shared": not_shared, "crude, same time": for_the_same_time}
RULES = {"linear program": by_linear_program} | CRUDE


def _draw(means: dict[str, dict[str, float]]) -> Figure:
    """Deviation by kind of command, a mark for each rule."""
    figure, (axes,) = panels(height=3.6)
    for (rule, line), marker in zip(means.items(), "osD^", strict=True):
        mark = {"markersize": 8} if rule in CRUDE else {"fillstyle": "none", "markersize": 14}
        axes.plot(list(line), [100.0 * value for value in line.values()], marker, label=rule, **mark)
    reference_line(axes, 100.0 * REPORTED_CRUDE, "reported for the crude map")
    axes.set(
        xlim=(-0.5, 4.5), ylim=(-3.0, 75.0), xlabel="commands", ylabel="mean deviation from the command, %"
    )
    axes.set(title="What a crude map misses on SPHERES hangs on how its rule is read")
    axes.legend(loc="upper center", ncols=4, bbox_to_anchor=(0.5, 1.0), fontsize=9)
    return figure


@reproduces(
    "E50",
    lines="L1578",
    reported="the mapper improved performance by over 15 %",
    criterion="as Table 3 (E05): over 15 % of the command with the crude map of the library",
)
def improvement(effort: Effort) -> Finding:
    """The improvement on SPHERES in the conclusions."""
    table = accuracy(effort)  # the same readings and commands
    means: dict[str, dict[str, float]] = table.data["mean_deviation"]
    gains = {
        rule: {kind: means[rule][kind] - means["linear program"][kind] for kind in means[rule]}
        for rule in CRUDE
    }
    all_gains = [gain for line in gains.values() for gain in line.values()]
    beyond = sum(gain > REPORTED_GAIN for gain in all_gains)
    by_rule = Table(
        "What the linear program gains on the crude map, % of the command",
        ("rule", *next(iter(gains.values()))),
        [(rule, *map(percent, line.values())) for rule, line in gains.items()],
    )
    return Finding(
        ours=f"{percent(min(all_gains))} to {percent(max(all_gains))} % of the command; more than "
        f"{100.0 * REPORTED_GAIN:g} % in {beyond} of {len(all_gains)} readings and sets of commands",
        checks={
            "Table 3 comes out as far as it can": all(table.checks.values()),
            "for the library's crude map it is over 15 % on commands of every kind": (
                min(gains["crude, shared"].values()) > REPORTED_GAIN
            ),
            "never does the crude map do better": min(all_gains) > -1e-9,
        },
        not_reproducible=table.not_reproducible,
        note="A difference of mean deviations, in points of the command's size. Nothing is said of fuel.",
        data={"gains": gains},
        tables=(by_rule,),
    )
