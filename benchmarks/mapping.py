"""How fast the LP mapper is: one command, a batch, and other solvers on the same problems.

The problems are like those of a flight with faults: Orion's effectiveness, 30 % of them with one thruster
dead, a quarter with commands on few axes (exactly degenerate), a quarter beyond what a period can give.
Solvers that keep a model get only what changes (command and bounds; a dead thruster is one that may not
fire) and start from their last basis. Not measured: construction, and the first call of each.

``python -m benchmarks.mapping`` runs this section alone.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType

import highspy
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from benchmarks.report import AtLeast, AtMost, Row, Section, section_as_text
from benchmarks.timing import Effort, race
from thruster_baselines.mapping import CrudeMapper, LPMapper, MinimumNormShiftMapper, PseudoInverseMapper
from thruster_baselines.mapping.simplex import solve_batch, solve_range
from thruster_envs.spacecraft import load

Array = NDArray[np.float64]

ABOUT = """\
One command of six axes to twelve thrusters (6x12) unless it says otherwise. The problems are Orion's: 30 %
with one thruster dead, a quarter of the commands on few axes only (exactly degenerate), a quarter beyond
what a period can give. *Kernel*: the compiled solver called from Python with arrays that fit. *Public
call*: `LPMapper(...)(command)` with its checks. Batches have an effectiveness of their own for every
problem. Other solvers keep their model, get only the command and the bounds, and start from their last
basis (highspy, GLPK); scipy's `linprog` builds its model anew,
and DAQP, a solver of quadratic programs, takes the linear one by proximal steps."""

BATCH = 4096
PROBLEMS = 256
EXACT = 1e-8


@dataclass(frozen=True)
class Problems:
    """Mapping problems of one vehicle that share their costs.

    Attributes:
        command: (count, m), m/s then rad/s.
        effectiveness: (m, n), of the healthy vehicle, m/s^2 then rad/s^2.
        max_on_time: (count, n), s; zero for a dead thruster.
        fuel_cost: (n,), per s.
        slack_cost: (m,), per m/s then per rad/s.
    """

    command: Array
    effectiveness: Array
    max_on_time: Array
    fuel_cost: Array
    slack_cost: Array

    @property
    def faulted(self) -> Array:
        """(count, m, n): the effectiveness of each problem, its dead thruster's column zero."""
        return np.ascontiguousarray(self.effectiveness * (self.max_on_time > 0.0)[:, np.newaxis, :])

    def optima(self) -> Array:
        """(count,): the least objectives."""
        return solve_batch(
            self.command, self.effectiveness[np.newaxis], self.max_on_time, self.fuel_cost, self.slack_cost
        )[2]


def problems(count: int, *, twice: bool = False, seed: int = 0) -> Problems:
    """Problems of Orion, or (`twice`) of an Orion with two unlike thrusters wherever it has one."""
    rng = np.random.default_rng(seed)
    orion = load("orion")
    effectiveness = orion.effectiveness()
    if twice:
        effectiveness = np.hstack([effectiveness, effectiveness * rng.uniform(0.5, 1.5, 12)])
    mapper = LPMapper(effectiveness, max_on_time=orion.control_period)
    n = effectiveness.shape[1]
    authority = orion.control_period * np.maximum(effectiveness, 0.0).sum(axis=1)
    command = rng.uniform(-0.4, 0.4, (count, 6)) * authority
    kind = rng.random(count)
    command[kind < 0.25] *= rng.random((count, 6))[kind < 0.25] < 0.3
    command[kind > 0.75] *= 4.0
    max_on_time = np.full((count, n), orion.control_period)
    dead = rng.random(count) < 0.3
    max_on_time[dead, rng.integers(n, size=int(dead.sum()))] = 0.0
    return Problems(command, effectiveness, max_on_time, mapper.fuel_cost.copy(), mapper.slack_cost.copy())


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    count = 8 if effort.quick else PROBLEMS
    return Section("LP mapper", ABOUT, [*_one(effort, count), *_batches(effort), *_peers(effort, count)])


def _one(effort: Effort, count: int) -> list[Row]:
    small, large = problems(count), problems(count, twice=True)
    mapper = LPMapper(load("orion"))
    commands = list(small.command)
    others = {
        "minimum-norm and shift": MinimumNormShiftMapper(load("orion")),
        "clipped pseudo-inverse": PseudoInverseMapper(load("orion")),
        "crude map": CrudeMapper(load("orion")),
    }

    def public() -> None:
        for command in commands:
            mapper(command)

    works: dict[str, Callable[[], object]] = {
        "kernel": kernel(small),
        "kernel 6x24": kernel(large),
        "in compiled code": lambda: solve_batch(
            small.command,
            small.effectiveness[np.newaxis],
            small.max_on_time,
            small.fuel_cost,
            small.slack_cost,
            1,
        ),
        "public": public,
    }
    for name, other in others.items():
        works[name] = lambda other=other: [other(command) for command in commands]
    times = race(works, effort)
    micro = {name: 1e6 * timing.seconds / count for name, timing in times.items()}
    return [
        Row("kernel, one command, from Python", micro["kernel"], "µs", AtMost(3.0), charted=True),
        Row("kernel, commands one by one in compiled code", micro["in compiled code"], "µs", AtMost(3.0)),
        Row("kernel, one command, 6x24, from Python", micro["kernel 6x24"], "µs"),
        Row(
            "public call, one command", micro["public"], "µs", AtMost(8.0),
            ratio=f"{times['kernel'].times_faster_than(times['public']):.2f} times the kernel's time",
        ),
        *(
            Row(
                f"{name}, one command", micro[name], "µs",
                ratio=f"{times['public'].times_faster_than(times[name]):.1f} times the LP's time",
                note="not optimal",
            )
            for name in others
        ),
    ]  # fmt: skip


def kernel(these: Problems) -> Callable[[], None]:
    """The compiled solver called from Python, once for each problem."""
    m, n = these.effectiveness.shape
    answer = np.empty((1, n)), np.empty((1, m)), np.empty(1), np.empty(1, np.int64)
    model, costs = these.effectiveness[np.newaxis], (these.fuel_cost, these.slack_cost)
    arguments = [
        (command[np.newaxis], model, max_on_time[np.newaxis], *costs, *answer, 0, 1)
        for command, max_on_time in zip(these.command, these.max_on_time, strict=True)
    ]

    def work() -> None:
        for one in arguments:
            solve_range(*one)

    return work


def _batches(effort: Effort) -> list[Row]:
    count = 64 if effort.quick else BATCH
    these = problems(count, seed=1)
    faulted, bound = these.faulted, these.max_on_time
    mapper = LPMapper(load("orion"))

    def with_threads(threads: int) -> Callable[[], object]:
        return lambda: solve_batch(these.command, faulted, bound, these.fuel_cost, these.slack_cost, threads)

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
    return [
        Row(f"batch of {count:,}, one thread", rate["one thread"], "LP/s"),
        Row(
            f"batch of {count:,}, two threads", rate["two threads"], "LP/s", AtLeast(1e6),
            ratio=f"{gain:.2f} times one thread", charted=True,
        ),
        Row(
            f"batch of {count:,}, public call", rate["public"], "LP/s",
            ratio=f"{times['public'].times_faster_than(times['two threads']):.2f} times two threads",
            note="as many threads as processors, arrays checked",
        ),
    ]  # fmt: skip


# Other solvers --------------------------------------------------------------------------------------------


def _peers(effort: Effort, count: int) -> list[Row]:
    these = problems(count)
    solvers: dict[str, Callable[[Problems], Solver]] = {
        "scipy linprog": scipy_linprog,
        "highspy, warm": warm_highs,
    }
    rows = []
    for name, module, make in (("GLPK, warm", "swiglpk", warm_glpk), ("DAQP", "daqp", proximal_daqp)):
        library = _optional(module)
        if library is None:
            rows.append(Row(name, None, "µs", note=f"{module} is not installed (extra `bench`)", own=False))
        else:
            solvers[name] = lambda problems, make=make, library=library: make(problems, library)
    optima = these.optima()
    made = {name: make(these) for name, make in solvers.items()}
    exact = {
        name: np.mean([abs(solve(i) - optima[i]) <= EXACT * abs(optima[i]) for i in range(count)])
        for name, solve in made.items()
    }
    own = kernel(these)
    works = {name: _all_of(solve, count) for name, solve in made.items()}
    times = race({"kernel": own, **works}, effort)
    return rows + [
        Row(
            f"{name}, one command", 1e6 * times[name].seconds / count, "µs",
            ratio=f"{times['kernel'].times_faster_than(times[name]):,.0f} times the kernel's time",
            note=f"objective right to 1e-8 in {exact[name]:.0%} of the problems", charted=True, own=False,
        )
        for name in works
    ]  # fmt: skip


Solver = Callable[[int], float]
"""Solves the problem of that number and gives its objective."""


def _all_of(solve: Solver, count: int) -> Callable[[], None]:
    def work() -> None:
        for i in range(count):
            solve(i)

    return work


def _optional(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _equations(these: Problems) -> tuple[Array, Array, Array]:
    """(m, n + 2 m) rows in units of slack cost, their right-hand sides (count, m), and costs (n + 2 m,)."""
    m = these.slack_cost.size
    rows = np.hstack([these.slack_cost[:, np.newaxis] * these.effectiveness, np.eye(m), -np.eye(m)])
    return rows, these.slack_cost * these.command, np.concatenate([these.fuel_cost, np.ones(2 * m)])


def scipy_linprog(these: Problems) -> Solver:
    """`scipy.optimize.linprog` by HiGHS, a model for every call."""
    rows, right, cost = _equations(these)
    m, n = these.effectiveness.shape
    bounds = np.zeros((len(right), n + 2 * m, 2))
    bounds[:, :n, 1] = these.max_on_time
    bounds[:, n:, 1] = np.inf

    def solve(i: int) -> float:
        return float(linprog(cost, A_eq=rows, b_eq=right[i], bounds=bounds[i], method="highs").fun)

    return solve


def warm_highs(these: Problems) -> Solver:
    """HiGHS with its model and last basis kept."""
    rows, right, cost = _equations(these)
    m, n = these.effectiveness.shape
    columns = n + 2 * m
    solver = highspy.Highs()
    solver.silent()
    solver.setOptionValue("presolve", "off")
    solver.setOptionValue("threads", 1)
    model = highspy.HighsLp()
    model.num_col_, model.num_row_ = columns, m
    model.col_cost_, model.col_lower_ = cost, np.zeros(columns)
    model.col_upper_ = np.concatenate([these.max_on_time[0], np.full(2 * m, np.inf)])
    model.row_lower_ = model.row_upper_ = right[0]
    model.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    model.a_matrix_.start_ = np.arange(m + 1) * columns
    model.a_matrix_.index_ = np.tile(np.arange(columns), m)
    model.a_matrix_.value_ = rows.ravel()
    solver.passModel(model)
    numbers, zeros = np.arange(n, dtype=np.int32), np.zeros(n)

    def solve(i: int) -> float:
        solver.changeColsBounds(n, numbers, zeros, these.max_on_time[i])
        for k in range(m):
            solver.changeRowBounds(k, right[i, k], right[i, k])
        solver.run()
        return float(solver.getInfo().objective_function_value)

    return solve


def warm_glpk(these: Problems, glpk: ModuleType) -> Solver:
    """GLPK's primal simplex with its model and last basis kept."""
    rows, right, cost = _equations(these)
    m, n = these.effectiveness.shape
    columns = n + 2 * m
    model = glpk.glp_create_prob()
    glpk.glp_add_rows(model, m)
    glpk.glp_add_cols(model, columns)
    for j in range(columns):
        glpk.glp_set_obj_coef(model, j + 1, float(cost[j]))
        glpk.glp_set_col_bnds(model, j + 1, glpk.GLP_LO, 0.0, 0.0)
    size = m * columns
    row, column, value = glpk.intArray(size + 1), glpk.intArray(size + 1), glpk.doubleArray(size + 1)
    for k, entry in enumerate(rows.ravel(), start=1):
        row[k], column[k], value[k] = (k - 1) // columns + 1, (k - 1) % columns + 1, float(entry)
    glpk.glp_load_matrix(model, size, row, column, value)
    options = glpk.glp_smcp()
    glpk.glp_init_smcp(options)
    options.msg_lev = glpk.GLP_MSG_OFF
    commands, limits = right.tolist(), these.max_on_time.tolist()

    def solve(i: int) -> float:
        for j, limit in enumerate(limits[i], start=1):
            glpk.glp_set_col_bnds(model, j, glpk.GLP_DB if limit > 0.0 else glpk.GLP_FX, 0.0, limit)
        for k, command in enumerate(commands[i], start=1):
            glpk.glp_set_row_bnds(model, k, glpk.GLP_FX, command, command)
        glpk.glp_simplex(model, options)
        return float(glpk.glp_get_obj_val(model))

    return solve


def proximal_daqp(these: Problems, daqp: ModuleType) -> Solver:
    """DAQP with its model kept, the linear program by proximal steps."""
    rows, right, cost = _equations(these)
    m, n = these.effectiveness.shape
    columns = n + 2 * m
    lower = np.concatenate([np.zeros((len(right), columns)), right], axis=1)
    upper = np.concatenate([these.max_on_time, np.full((len(right), 2 * m), 1e9), right], axis=1)
    sense = np.concatenate([np.zeros(columns), np.full(m, 5)]).astype(np.int32)
    model = daqp.Model()
    model.setup(np.zeros((columns, columns)), cost, rows, upper[0].copy(), lower[0].copy(), sense)

    def solve(i: int) -> float:
        model.update(bupper=upper[i], blower=lower[i])
        return float(model.solve()[1])

    return solve


def main(arguments: Sequence[str] = ()) -> None:
    """Measure and print this section."""
    from benchmarks.timing import QUICK

    print(section_as_text(measure(QUICK if "--quick" in arguments else Effort())))


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
