"""What this package's other mappers take, beside the plain linear program on the same commands.

Compiled ones are timed over a batch on one thread, as a ratio to one plain solve; the others by their public
call, one command after the other. Beside each stands how many commands it solves as well as the linear
program does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.problems import KINDS, VEHICLES, Array, Problems, problems
from benchmarks.report import AtMost, Row, markdown_table, number
from benchmarks.timing import Calls, Effort, Timing, race, race_calls
from thruster_baselines.mapping import (
    AdditiveCompensationMapper,
    ChanceConstrainedMapper,
    ConicRobustMapper,
    CrudeMapper,
    DifferentialCompensationMapper,
    ExactCompensationMapper,
    LPMapper,
    MILPMapper,
    MinimumNormShiftMapper,
    MinimumPulseMapper,
    NonNegativeLeastSquaresMapper,
    NullSpaceMapper,
    PseudoInverseMapper,
    QuadraticMapper,
    RedistributedPseudoInverseMapper,
    RobustCommandMapper,
    RobustEffectivenessMapper,
    delivered_rate_change,
)
from thruster_baselines.mapping.base import BaseMapper
from thruster_envs.spacecraft import load

EXACT = 1e-8
"""A command is solved if its weighed miss exceeds the linear program's by less than this share of it."""

UNCERTAIN = 0.05
"""What the robust mappers are told: by how large a share a thruster, or of what share of authority a
command, may be off."""

SHORTEST_PULSE = 0.01
"""Of the mapper for minimum pulses, in control periods: that of SPHERES."""

ABOUT = f"""\
*Plain solves* is the time of a compiled mapper over that of the linear program on the same commands, both
in one batch on one thread. The coupling is that of Orion's feed for every vehicle; commands are known to
{UNCERTAIN:.0%} of authority and thrusters to {UNCERTAIN:.0%}; shortest pulses are {SHORTEST_PULSE:.0%} of
the period. A compensator *reaches* a command if what its on-times deliver, with the loss, is what the linear
program would give without one, to 1e-3 of it (its tolerance) or to {number(EXACT)}; where that takes all of
the period, none can. Mappers of all sorts are also timed by their public call, each command by itself and
twice; the median is the mean of those of the three kinds. They *solve* a command if their weighed miss is the
linear program's to {number(EXACT)} of the command; they may burn more for it."""

FEW = 200
"""Commands of each kind for mappers that take a millisecond."""

FEWER = 20
"""Commands of each kind for the integer program."""


@dataclass(frozen=True)
class Compiled:
    """A compiled mapper in the comparison.

    Attributes:
        make: Makes it from problems, on one thread.
        target: Plain solves it may take on interior and saturated commands.
        compensates: Whether it knows of the coupling loss.
    """

    make: Callable[[Problems], BaseMapper]
    target: float | None = None
    compensates: bool = False


def _coupling() -> float:
    """Share of thrust lost per further thruster open, of Orion's feed."""
    coupling = load("orion").feed.coupling
    if not isinstance(coupling, float):
        raise TypeError(f"coupling of Orion is {coupling!r}; one number would be right")
    return coupling


def _margin(these: Problems) -> Array:
    """`UNCERTAIN` of the authority on each axis."""
    reach: Array = np.maximum(these.effectiveness, 0.0).sum(axis=1) * these.max_on_time.max()
    return UNCERTAIN * reach


COMPILED: Mapping[str, Compiled] = {
    "method I (differential)": Compiled(
        lambda these: DifferentialCompensationMapper(*_model(these), threads=1, coupling=_coupling()),
        compensates=True,
    ),
    "method II (additive)": Compiled(
        lambda these: AdditiveCompensationMapper(*_model(these), threads=1, coupling=_coupling()),
        target=5.0, compensates=True,
    ),
    "exact compensation": Compiled(
        lambda these: ExactCompensationMapper(*_model(these), threads=1, coupling=_coupling()),
        target=5.0, compensates=True,
    ),
    "robust, command in a box": Compiled(
        lambda these: RobustCommandMapper(*_model(these), threads=1, below=0.0, above=_margin(these)),
        target=20.0,
    ),
    "robust, thrusters in a box": Compiled(
        lambda these: RobustEffectivenessMapper(*_model(these), threads=1, relative=UNCERTAIN), target=20.0
    ),
    "minimum pulse": Compiled(
        lambda these: MinimumPulseMapper(
            these.effectiveness, SHORTEST_PULSE * these.max_on_time[0], these.max_on_time[0], threads=1
        )
    ),
    "redistributed pseudo-inverse": Compiled(
        lambda these: RedistributedPseudoInverseMapper(*_model(these), threads=1)
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Called:
    """A mapper that is timed call by call.

    Attributes:
        make: Makes it from problems.
        commands: How many of each kind; None for all.
        misses: Whether its aim is the linear program's, so that the misses can be compared.
        everywhere: Whether it is timed on every vehicle, not on the first alone.
    """

    make: Callable[[Problems], BaseMapper]
    commands: int | None = None
    misses: bool = True
    everywhere: bool = True


CALLED: Mapping[str, Called] = {
    "minimum norm and shift": Called(lambda these: MinimumNormShiftMapper(*_model(these))),
    "null space": Called(lambda these: NullSpaceMapper(*_model(these))),
    "clipped pseudo-inverse": Called(lambda these: PseudoInverseMapper(*_model(these))),
    "redistributed pseudo-inverse": Called(lambda these: RedistributedPseudoInverseMapper(*_model(these))),
    "crude map": Called(lambda these: CrudeMapper(*_model(these))),
    "non-negative least squares": Called(lambda these: NonNegativeLeastSquaresMapper(*_model(these))),
    "bounded least squares": Called(
        lambda these: NonNegativeLeastSquaresMapper(*_model(these), bounded=True), commands=FEW
    ),
    "quadratic": Called(lambda these: QuadraticMapper(*_model(these))),
    "minimum pulse": Called(
        lambda these: MinimumPulseMapper(
            these.effectiveness, SHORTEST_PULSE * these.max_on_time[0], these.max_on_time[0]
        )
    ),
    "robust, thrusters in ellipsoids": Called(
        lambda these: ConicRobustMapper(*_model(these), spread=UNCERTAIN), commands=FEW, misses=False
    ),
    "chance-constrained": Called(
        lambda these: ChanceConstrainedMapper(*_model(these), standard_deviation=UNCERTAIN),
        commands=FEW, misses=False,
    ),
    "robust, thrusters in a box, dearest miss": Called(
        lambda these: RobustEffectivenessMapper(*_model(these), relative=UNCERTAIN, largest_miss=True),
        commands=FEW, misses=False,
    ),
    "integer program (MILP)": Called(
        lambda these: MILPMapper(*_model(these), coupling=_coupling()),
        commands=FEWER, misses=False, everywhere=False,
    ),
}  # fmt: skip

NOTES = {
    "robust, thrusters in ellipsoids": "by Clarabel",
    "chance-constrained": "by Clarabel",
    "robust, thrusters in a box, dearest miss": "by HiGHS, one after the other",
    "integer program (MILP)": "by HiGHS",
}


def rows(effort: Effort, count: int) -> tuple[list[Row], str]:
    """Rows of Orion, and tables of all vehicles and kinds of command, of so many commands each."""
    compiled = {
        (craft, kind): _race_compiled(effort, problems(count, craft, kind))
        for craft in VEHICLES
        for kind in KINDS
    }
    called = {
        (craft, kind): _race_called(effort, problems(count, craft, kind), first=craft == VEHICLES[0])
        for craft in VEHICLES
        for kind in KINDS
    }
    lines = [*_compiled_rows(compiled), *_called_rows(called, count)]
    return lines, f"{_compiled_table(compiled)}\n\n{_called_table(called)}"


# Compiled mappers -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Batch:
    """Compiled mappers on the same commands: times, and what there is to say of the answers."""

    times: dict[str, Timing]
    told: dict[str, str]

    def plain_solves(self, name: str) -> float:
        """How many plain solves a mapper takes."""
        return self.times["LP"].times_faster_than(self.times[name])


def _race_compiled(effort: Effort, these: Problems) -> _Batch:
    mappers = {name: one.make(these) for name, one in COMPILED.items()}
    plain = LPMapper(*_model(these), threads=1)
    works: dict[str, Callable[[], object]] = {"LP": lambda: plain(these.command)}
    for name, mapper in mappers.items():
        works[name] = lambda mapper=mapper: mapper(these.command)
    told = {
        name: _reached(these, mapper) if COMPILED[name].compensates else ""
        for name, mapper in mappers.items()
    }
    return _Batch(race(works, effort), told)


def _reached(these: Problems, mapper: BaseMapper) -> str:
    """How many linear programs a compensator takes, and how many commands it reaches."""
    answer = mapper(these.command)
    wanted = these.command - these.solve()[1]
    missing = these.slack_cost * (
        wanted - delivered_rate_change(these.effectiveness, answer.on_times, _coupling())
    )
    miss = np.abs(missing).max(axis=1) / np.abs(these.slack_cost * wanted).max(axis=1)
    programs = float(np.mean(getattr(answer, "iterations")))  # noqa: B009  # only compensators count them
    return (
        f"{number(programs)} LPs a command; reaches {np.mean(miss <= 1.001e-3):.1%} to 1e-3, "
        f"{np.mean(miss <= EXACT):.1%} to {number(EXACT)}; median miss {100.0 * np.median(miss):.2f} %"
    )


def _compiled_rows(found: dict[tuple[str, str], _Batch]) -> list[Row]:
    lines = []
    for name, one in COMPILED.items():
        for kind in ("interior", "saturated"):
            batch = found[VEHICLES[0], kind]
            lines.append(
                Row(
                    f"{name}, {kind}", batch.plain_solves(name), "plain solves",
                    AtMost(one.target) if one.target is not None else None,
                    note=batch.told[name], charted=True,
                )
            )  # fmt: skip
    return lines


def _compiled_table(found: dict[tuple[str, str], _Batch]) -> str:
    lines = [
        (craft, kind, *(number(batch.plain_solves(name)) for name in COMPILED))
        for (craft, kind), batch in found.items()
    ]
    return "### Compiled mappers, in plain solves\n\n" + markdown_table(
        ("vehicle", "commands", *COMPILED), lines
    )


# Mappers by their public call -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _One:
    """Mappers called with one command after the other: times, and the share of commands solved."""

    calls: dict[str, Calls]
    solved: dict[str, float]


def _race_called(effort: Effort, these: Problems, *, first: bool) -> _One:
    chosen = {name: one for name, one in CALLED.items() if first or one.everywhere}
    limits = {name: 2 if effort.quick and one.commands else one.commands for name, one in chosen.items()}
    commands = [(command,) for command in these.command]
    works: dict[str, tuple[BaseMapper, list[tuple[Array]]]] = {"LP": (LPMapper(*_model(these)), commands)}
    for name, one in chosen.items():
        works[name] = (one.make(these), commands[: limits[name]])
    misses = these.misses(these.solve()[0])
    sizes = np.abs(these.command) @ these.slack_cost
    solved = {}
    for name, one in chosen.items():
        if one.misses:
            some = slice(limits[name])
            on_times = np.array([works[name][0](command).on_times for (command,) in commands[some]])
            excess = _some(these, some).misses(on_times) - misses[some]
            solved[name] = float(np.mean(excess <= EXACT * sizes[some]))
    return _One(race_calls(works, effort, repetitions=2), solved)


def _called_rows(found: dict[tuple[str, str], _One], count: int) -> list[Row]:
    """Medians of Orion's three kinds of command, each kind counted alike."""
    kinds = [found[VEHICLES[0], kind] for kind in KINDS]
    lines = []
    for name, one in CALLED.items():
        notes = [NOTES[name]] if name in NOTES else []
        if one.misses:
            shares = ", ".join(f"{each.solved[name]:.1%}" for each in kinds)
            notes.append(f"solves {shares} of interior, saturated and degenerate commands")
        if one.commands is not None:
            notes.append(f"{min(one.commands, count)} commands of each kind")
        median = float(np.mean([each.calls[name].median for each in kinds]))
        plain = float(np.mean([each.calls["LP"].median for each in kinds]))
        lines.append(
            Row(
                f"{name}, public call", 1e6 * median, "µs",
                ratio=f"{number(median / plain)} times the LP's public call", note="; ".join(notes),
            )
        )  # fmt: skip
    return lines


def _called_table(found: dict[tuple[str, str], _One]) -> str:
    lines = [
        (
            craft,
            kind,
            number(1e6 * one.calls["LP"].median),
            *(_called_cell(one, name) for name in CALLED),
        )
        for (craft, kind), one in found.items()
    ]
    return "### Mappers by their public call: median µs for one command (share solved)\n\n" + markdown_table(
        ("vehicle", "commands", "LP", *CALLED), lines
    )


def _called_cell(one: _One, name: str) -> str:
    if name not in one.calls:
        return "–"
    return number(1e6 * one.calls[name].median) + (f" ({one.solved[name]:.1%})" if name in one.solved else "")


def _model(these: Problems) -> tuple[Array, Array]:
    """What a mapper is made of: the healthy effectiveness and the longest on-times."""
    return these.effectiveness, these.max_on_time[0]


def _some(these: Problems, which: slice) -> Problems:
    return Problems(
        these.command[which], these.effectiveness, these.max_on_time[which], these.fuel_cost, these.slack_cost
    )
