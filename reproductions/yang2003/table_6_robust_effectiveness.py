"""Table 6: how often the plain and the robust linear program are "correct" when thrusters are uncertain.

Three axes and three thrusters; matrix, command and errors are random, and the nominal thrusters can meet the
command. Each column is multiplied by a factor within its limits, up to 10 % (row 3: 100 to 200 %). A solution
is correct if none of a number of candidates, exact solutions of `A_j x = b` for random A_j within the errors,
has a smaller largest error; a tie counts. The source gives neither their number nor the measure, and both
matter: so the worst error over the box of factors (at a corner of it) is measured as *largest* (the worst
axis), *sum* (of the worst of each axis, which the robust program minimises) and *joint* (the worst sum),
against 10 to 300 candidates and the best of all on-times, by a linear program of its own for each measure.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from reproductions.cells import interval
from reproductions.figures import BLUE, GREEN, INK, ORANGE, Figure, panels
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import Result
from thruster_baselines.mapping import LPMapper, RobustEffectivenessMapper
from thruster_envs.protocols import FloatArray

AXES = THRUSTERS = 3
SEED = 19
CANDIDATES = (10, 30, 100, 300)
MEASURES = ("largest", "sum", "joint")
PROGRAMS = ("plain", "robust", "robust, one slack")
TIE = 1e-6  # of the largest component of the command: HiGHS is exact to 1e-9
LONGEST = 1e3  # s: no bound
FUEL_COST = 1e-9  # per s, beside a slack cost of one: H much larger than c
CHUNK = 250  # problems at a time
AGREEMENT = 2.0
"""Points of per cent by which figures may differ: of 200 problems, one standard error near 90 %. Set after a
first run: to the whole per cent, row 5 has no match."""

_CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=THRUSTERS)))

Draw = Callable[[np.random.Generator, int], FloatArray]


def _alike(least: float, most: float) -> Draw:
    """The same size for all thrusters of a problem."""
    return lambda rng, count: np.repeat(rng.uniform(least, most, (count, 1)), THRUSTERS, axis=1)


def _apart(least: float, most: float) -> Draw:
    return lambda rng, count: rng.uniform(least, most, (count, THRUSTERS))


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    what: str  # the kind of errors
    least_entry: float  # of the matrix; entries are uniform from there to one
    size: Draw  # of the errors upward, as shares: (count, n)
    symmetric: bool  # whether they are as large downward; else that size is drawn too
    plain: int  # Reported for the plain program, in %
    robust: int  # Reported for the robust one, in %
    lines: str  # where


ROWS = {
    "E19a": Row("symmetric, below 10 %, alike, one sign", 0.0, _alike(0.0, 0.1), True, 100, 100, "L825"),
    "E19b": Row("not symmetric, below 10 %, alike, one sign", 0.0, _alike(0.0, 0.1), False, 0, 100, "L826"),
    "E19c": Row("symmetric, above 100 %, alike, one sign", 0.0, _alike(1.0, 2.0), True, 0, 100, "L827"),
    "E19d": Row("symmetric, below 10 %, different, one sign", 0.0, _apart(0.0, 0.1), True, 32, 100, "L828"),
    "E19e": Row("symmetric, below 10 %, alike, both signs", -1.0, _alike(0.0, 0.1), True, 90, 92, "L829"),
}


@dataclass(frozen=True)
class Correct:
    """How often each program was correct."""

    count: int  # problems
    of_candidates: FloatArray  # (programs, measures, numbers of candidates), shares
    of_all: FloatArray  # (programs, measures), compared with the best of all on-times

    def both(self, program: str, measure: str) -> FloatArray:
        """The shares of one program by one measure: for each number of candidates, then for all on-times."""
        where = PROGRAMS.index(program), MEASURES.index(measure)
        return np.append(self.of_candidates[where], self.of_all[where])

    def range(self, program: str) -> tuple[float, float]:
        """The least and the largest share of a program over measures and what it is compared with."""
        shares = np.array([self.both(program, measure) for measure in MEASURES])
        return float(shares.min()), float(shares.max())


def study(row: Row, count: int) -> Correct:
    """Draw problems and judge the three programs."""
    rng = np.random.default_rng([SEED, *map(ord, row.lines)])
    sizes = [min(CHUNK, count - first) for first in range(0, count, CHUNK)]
    parts = [_judge(row, rng, size) for size in sizes]
    return Correct(
        count,
        np.asarray(sum(part[0] for part in parts)) / count,
        np.asarray(sum(part[1] for part in parts)) / count,
    )


def _judge(row: Row, rng: np.random.Generator, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many of so many problems each program is correct on; see `Correct`."""
    matrices = rng.uniform(row.least_entry, 1.0, (count, AXES, THRUSTERS))
    on_times = rng.random((count, THRUSTERS))
    commands = np.einsum("pkj,pj->pk", matrices, on_times)
    above = row.size(rng, count)
    below = above if row.symmetric else row.size(rng, count)
    corners = 1.0 - below[:, np.newaxis] + _CORNERS * (above + below)[:, np.newaxis]

    drawn = rng.random((count, CANDIDATES[-1], THRUSTERS))
    factors = 1.0 - below[:, np.newaxis] + drawn * (above + below)[:, np.newaxis]
    candidates = on_times[:, np.newaxis] / factors  # the solution of A diag(f) x = A on_times
    by_candidates = errors(matrices, commands, corners, candidates)
    by_candidates[(candidates < 0.0).any(axis=-1)] = np.inf
    best_so_far = np.minimum.accumulate(by_candidates, axis=1)[:, np.array(CANDIDATES) - 1]

    fired = [_fire(*problem) for problem in zip(matrices, commands, above, below, strict=True)]
    by_programs = errors(matrices, commands, corners, np.array(fired))
    joint = [least_joint_error(*problem) for problem in zip(matrices, commands, corners, strict=True)]
    best = np.column_stack([by_programs[:, 2, 0], by_programs[:, 1, 1], joint])

    tie = TIE * np.abs(commands).max(axis=1)[:, np.newaxis, np.newaxis, np.newaxis]
    rivals = np.concatenate([best_so_far, best[:, np.newaxis]], axis=1)
    correct = by_programs[:, :, np.newaxis] <= rivals[:, np.newaxis] + tie  # problem, program, rival, measure
    counts = correct.sum(axis=0).transpose(0, 2, 1)
    return counts[..., :-1], counts[..., -1]


def errors(
    matrices: FloatArray, commands: FloatArray, corners: FloatArray, on_times: FloatArray
) -> FloatArray:
    """The three measures of on-times (problems, tries, n): (problems, tries, 3).

    Of matrices (problems, axes, n), commands (problems, axes) and factors of columns (problems, corners, n).
    """
    scaled = corners[:, np.newaxis] * on_times[:, :, np.newaxis]
    missed = np.abs(scaled @ matrices.transpose(0, 2, 1)[:, np.newaxis] - commands[:, np.newaxis, np.newaxis])
    of_axis = missed.max(axis=2)
    return np.stack([of_axis.max(axis=2), of_axis.sum(axis=2), missed.sum(axis=3).max(axis=2)], axis=-1)


def _fire(matrix: FloatArray, command: FloatArray, above: FloatArray, below: FloatArray) -> FloatArray:
    """On-times (programs, n) of the three programs."""
    ends = matrix * (1.0 - below), matrix * (1.0 + above)
    limits = {"lower": np.minimum(*ends), "upper": np.maximum(*ends)}
    mappers = [LPMapper(matrix, LONGEST, FUEL_COST, 1.0)] + [
        # beyond 100 % it is better to fire nothing
        RobustEffectivenessMapper(
            matrix, LONGEST, FUEL_COST, 1.0, **limits, largest_miss=largest_miss, fuel_may_win=True
        )
        for largest_miss in (False, True)
    ]
    return np.array([mapper(command).on_times for mapper in mappers])


def least_joint_error(matrix: FloatArray, command: FloatArray, corners: FloatArray) -> float:
    """The least worst sum of errors over axes that any on-times have.

    A linear program in on-times, the errors (axes,) at each corner, and their largest sum.
    """
    count = len(corners)
    rows = (corners[:, np.newaxis] * matrix).reshape(-1, THRUSTERS)
    one = np.eye(len(rows))
    sums = np.kron(np.eye(count), np.ones(AXES))
    none = np.zeros((len(rows), 1))
    target = np.tile(command, count)
    answer = linprog(
        np.append(np.zeros(THRUSTERS + len(rows)), 1.0),
        A_ub=np.block([
            [rows, -one, none], [-rows, -one, none],
            [np.zeros((count, THRUSTERS)), sums, -np.ones((count, 1))],
        ]),
        b_ub=np.concatenate([target, -target, np.zeros(count)]),
        options={"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9},
    )  # fmt: skip
    return float(answer.fun)


def run(name: str, effort: Effort) -> Finding:
    """A row of the table."""
    row = ROWS[name]
    found = study(row, effort.samples)
    plain, robust = (
        (found.both(program, "sum")[-1], found.both(program, "joint")[-1]) for program in PROGRAMS[:2]
    )
    return Finding(
        ours=f"by the sum of worst errors, against all on-times: plain {percent(plain[0])} %, robust "
        f"{percent(robust[0])} %; by the joint worst error {percent(plain[1])} and {percent(robust[1])} %",
        checks=CHECKS[name](found, row),
        not_reproducible=(
            ""
            if matches(found, row)
            else f"the {row.plain} % of the plain program; neither the measure nor the number of candidates "
            f"is given, and its figure goes from {percent(found.range('plain')[0])} to "
            f"{percent(found.range('plain')[1])} % with them"
        ),
        note=_note(found, row),
        data={
            "programs": PROGRAMS,
            "measures": MEASURES,
            "candidates": CANDIDATES,
            "correct_of_candidates": found.of_candidates,
            "correct_of_all_on_times": found.of_all,
            "problems": found.count,
        },
        tables=(_table(found, row),),
        figure=partial(_draw, found, row),
    )


def _exact(found: Correct, row: Row) -> dict[str, bool]:
    """Rows whose figures are 0 or 100: against all on-times, by axis, to the whole per cent of the source."""
    pairs = (("plain", "sum"), ("plain", "largest"), ("robust", "sum"), ("robust, one slack", "largest"))
    figures = [round(100.0 * found.both(*pair)[-1]) for pair in pairs]
    return {
        f"plain: {row.plain} % by the sum and by the largest": figures[:2] == [row.plain] * 2,
        f"robust: {row.robust} % by the measure of its slacks": figures[2:] == [row.robust] * 2,
    }


def _different(found: Correct, row: Row) -> dict[str, bool]:
    low, high = found.range("plain")
    return {
        "robust: 100 % by the sum, against candidates and against all on-times": (
            found.both("robust", "sum") == 1.0
        ).all(),
        "robust with one slack: 100 % by the largest": (
            found.both("robust, one slack", "largest") == 1.0
        ).all(),
        f"plain: the {row.plain} % are between the figures of the measures": low <= row.plain / 100 <= high,
    }


def _both_signs(found: Correct, row: Row) -> dict[str, bool]:
    plain, robust = found.both("plain", "joint"), found.both("robust", "joint")
    noise = 2.0 * np.sqrt(0.25 / found.count)
    return {
        "robust: no worse than plain by the sum": (
            found.both("robust", "sum") >= found.both("plain", "sum")
        ).all(),
        "robust: below 100 % by the joint worst error": (robust < 1.0).all(),
        f"{row.plain} and {row.robust} % are between the figures for 10 and for 300 candidates": (
            plain[-2] <= row.plain / 100 <= plain[0] and robust[-2] <= row.robust / 100 <= robust[0]
        ),
        "robust and plain are within 5 % of each other there, as reported": (
            np.abs(robust - plain)[:-1].max() <= 0.05 + noise
        ),
    }


CHECKS = {"E19a": _exact, "E19b": _exact, "E19c": _exact, "E19d": _different, "E19e": _both_signs}


def matches(found: Correct, row: Row) -> list[str]:
    """By which measure and against whom both figures come out as reported, to `AGREEMENT`.

    Either of the two robust programs counts.
    """
    against = (*(f"{number} candidates" for number in CANDIDATES), "all on-times")
    return [
        f'"{measure}" against {whom}' + ("" if robust == "robust" else " (one slack)")
        for measure in MEASURES
        for robust in PROGRAMS[1:]
        for i, whom in enumerate(against)
        if abs(100.0 * found.both("plain", measure)[i] - row.plain) <= AGREEMENT
        and abs(100.0 * found.both(robust, measure)[i] - row.robust) <= AGREEMENT
    ]


def _note(found: Correct, row: Row) -> str:
    alike = matches(found, row)
    nearest = min(
        (share for measure in MEASURES for share in found.both("plain", measure)),
        key=lambda share: abs(share - row.plain / 100),
    )
    return (
        f"{found.count} random problems of three axes and three thrusters. "
        + (
            f"Both figures come out as reported, to {AGREEMENT:.0f} points, by {'; '.join(alike)}. Measure "
            "and number of candidates were searched for, as the source gives neither: weak evidence where it "
            f"is one of {2 * len(MEASURES) * (len(CANDIDATES) + 1)} comparisons that agrees. "
            if alike
            else f"Together they come out by no measure; nearest to {row.plain} % is {percent(nearest)} %. "
        )
        + "What the measures are and what counts as correct stands at the head of the module "
        "`table_6_robust_effectiveness`."
    )


def _table(found: Correct, row: Row) -> Table:
    head = (*(f"{number} candidates" for number in CANDIDATES), "all on-times, 95 % interval")
    return Table(
        f"Correct, %; reported: {row.plain} plain, {row.robust} robust",
        ("error", "program", *head),
        tuple(
            (measure, program, *map(percent, shares[:-1]), _with_interval(shares[-1], found.count))
            for measure in MEASURES
            for program in PROGRAMS
            for shares in [found.both(program, measure)]
        ),
    )


def percent(share: float) -> str:
    """In %, with a digit more where it is not whole."""
    return f"{100.0 * share:.1f}".removesuffix(".0")


def _with_interval(share: float, count: int) -> str:
    return f"{percent(share)} ({interval(round(share * count), count)})"


def _draw(found: Correct, row: Row) -> Figure:
    """How often both programs are correct, by measure and by what they are compared with."""
    figure, both = panels(2, height=3.9)
    names = [*map(str, CANDIDATES), "all"]
    for axes, program, reported in zip(both, PROGRAMS[:2], (row.plain, row.robust), strict=True):
        for measure, colour, marker in zip(MEASURES, (BLUE, ORANGE, GREEN), "os^", strict=True):
            shares = 100.0 * found.both(program, measure)
            axes.plot(names[:-1], shares[:-1], f"{marker}-", color=colour, label=measure)
            axes.plot(names[-1:], shares[-1:], marker, color=colour)
        axes.axhline(reported, color=INK, linestyle="--", linewidth=1.0)
        axes.set(ylim=(-5.0, 105.0), xlabel="compared with so many candidates, or all")
        axes.set(title=f"{program} program (dashed: reported, {reported} %)")
    both[0].set_ylabel("correct, %")
    both[1].legend(title="worst error", loc="lower left")
    figure.suptitle(f"Errors {row.what}", color=INK, fontsize=10.5)
    return figure


REPRODUCTIONS = tuple(
    Result(
        id=name,
        title=f"Plain and robust program with uncertain thrusters: {row.what}",
        lines=f"{row.lines}, Table 6",
        reported=f"correct: plain {row.plain} %, robust {row.robust} %",
        criterion=criterion,
        run=partial(run, name),
    )
    for (name, row), criterion in zip(
        ROWS.items(),
        (
            *["the same figures against all on-times, by the measures that go axis by axis"] * 3,
            "robust 100 % by those measures; the figure for the plain program within the range of measures",
            "robust no worse than plain by its own measure, and below 100 % by the joint one; both figures "
            "within the range of candidates",
        ),
        strict=True,
    )
)
