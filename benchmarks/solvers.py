"""Solvers that a user would reach for, on the problems of :mod:`benchmarks.problems`.

Each function here takes problems and gives a function from a problem's number to the objective found. Models
are built beforehand where a library can keep one; a call changes the command and the bounds (a dead thruster
is one that may not fire). Rows are in units of slack cost, so that no solver has to cope with the units.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import TypeAlias

import clarabel
import highspy
import numpy as np
from scipy import sparse
from scipy.optimize import linprog, nnls

from benchmarks.problems import KINDS, MIXTURE, VEHICLES, Array, Problems, problems
from benchmarks.report import Row, markdown_table, number
from benchmarks.timing import Calls, Effort, Work, race_calls

Solver: TypeAlias = Callable[[int], float]
"""Solves the problem of that number and gives its objective."""

EXACT = 1e-8
"""Relative difference of an objective from the least below which a problem counts as solved."""

ABOUT = f"""\
*Peers* get the same problems, and each call is timed once, by itself. What counts as solved is an objective
within {number(EXACT)} of the least. highspy (*warm*) and GLPK keep their model and start from their last
basis; highspy (*cold*) is passed the model anew; Clarabel, DAQP and the two least-squares maps keep their
model and have nothing to start from; scipy's `linprog` builds its model anew. DAQP, a solver of quadratic
programs, takes the linear one by proximal steps. Clarabel's tolerances are 1e-11, the others' as they come.
NNLS and the pseudo-inverse are no solvers of this problem: they heed no bound, which is then cut off, and no
fuel."""


@dataclass(frozen=True)
class Raced:
    """Solvers on the same problems.

    Attributes:
        calls: Name to times; "kernel" is ours.
        solved: Name to the share of problems solved.
    """

    calls: dict[str, Calls]
    solved: dict[str, float]


def rows(effort: Effort, count: int, kernel: Callable[[Problems], Work]) -> tuple[list[Row], str]:
    """Rows of the peers on Orion's mixture, and a table of all vehicles and kinds of command.

    Args:
        effort: Repetitions.
        count: Problems of each kind.
        kernel: Makes the calls of our own kernel, to compare with.
    """
    makers, missing = _available()
    found = {
        (craft, kind): race_solvers(effort, problems(count, craft, kind), makers, kernel)
        for craft in VEHICLES
        for kind in (MIXTURE, *KINDS)
    }
    first = found[VEHICLES[0], MIXTURE]
    own, calls = first.calls["kernel"], first.calls
    names = sorted(makers, key=lambda name: calls[name].median)
    lines = [
        Row(
            f"{name}, one command", 1e6 * calls[name].median, "µs",
            ratio=f"{own.times_faster_than(calls[name]):,.0f} times the kernel's time",
            note=f"solves {first.solved[name]:.1%}; 99th percentile "
            f"{number(1e6 * calls[name].percentile(99.0))} µs",
            charted=True, own=False,
        )
        for name in names
    ] + [
        Row(name, None, "µs", note=f"{module} is not installed (extra `bench`)", own=False)
        for name, module in missing.items()
    ]  # fmt: skip
    return lines, _table(found, names)


def race_solvers(
    effort: Effort,
    these: Problems,
    makers: dict[str, Callable[[Problems], Solver]],
    kernel: Callable[[Problems], Work],
) -> Raced:
    """Time our kernel and other solvers on some problems, and count what each solves."""
    count = len(these.command)
    least = these.solve()[2]
    numbers = [(i,) for i in range(count)]
    found = {name: np.full(count, np.nan) for name in makers}
    works: dict[str, Work] = {
        name: (_noting(make(these), found[name]), numbers) for name, make in makers.items()
    }
    calls = race_calls({"kernel": kernel(these), **works}, effort, repetitions=1)
    solved = {name: float(np.mean(np.abs(each - least) <= EXACT * least)) for name, each in found.items()}
    return Raced(calls, solved)


def _noting(solve: Solver, objectives: Array) -> Callable[[int], None]:
    """The solver, with each objective noted where it belongs."""

    def work(i: int) -> None:
        objectives[i] = solve(i)

    return work


def _available() -> tuple[dict[str, Callable[[Problems], Solver]], dict[str, str]]:
    """The solvers that are installed, and the names and modules of those that are not."""
    makers: dict[str, Callable[[Problems], Solver]] = {
        "scipy linprog": scipy_linprog,
        "highspy, cold": cold_highs,
        "highspy, warm": warm_highs,
        "Clarabel": interior_clarabel,
        "NNLS, clipped": clipped_nnls,
        "pseudo-inverse, clipped": clipped_pseudo_inverse,
    }
    missing = {}
    for name, module, make in (("GLPK, warm", "swiglpk", warm_glpk), ("DAQP", "daqp", proximal_daqp)):
        library = _optional(module)
        if library is None:
            missing[name] = module
        else:
            makers[name] = lambda problems, make=make, library=library: make(problems, library)
    return makers, missing


def _optional(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _table(found: dict[tuple[str, str], Raced], names: list[str]) -> str:
    """Medians and shares solved of every solver, vehicle and kind."""
    headings = ["vehicle", "commands", "kernel", *names]
    lines = [
        (
            craft,
            kind,
            number(1e6 * raced.calls["kernel"].median),
            *(f"{number(1e6 * raced.calls[name].median)} ({raced.solved[name]:.1%})" for name in names),
        )
        for (craft, kind), raced in found.items()
    ]
    return "### Peers: median µs for one command (share solved)\n\n" + markdown_table(headings, lines)


def equations(these: Problems) -> tuple[Array, Array, Array]:
    """(m, n + 2 m) rows in units of slack cost, their right-hand sides (count, m), and costs (n + 2 m,)."""
    m = these.slack_cost.size
    rows = np.hstack([these.slack_cost[:, np.newaxis] * these.effectiveness, np.eye(m), -np.eye(m)])
    return rows, these.slack_cost * these.command, np.concatenate([these.fuel_cost, np.ones(2 * m)])


def scipy_linprog(these: Problems) -> Solver:
    """`scipy.optimize.linprog` by HiGHS, a model for every call."""
    rows, right, cost = equations(these)
    m, n = these.effectiveness.shape
    bounds = np.zeros((len(right), n + 2 * m, 2))
    bounds[:, :n, 1] = these.max_on_time
    bounds[:, n:, 1] = np.inf

    def solve(i: int) -> float:
        return float(linprog(cost, A_eq=rows, b_eq=right[i], bounds=bounds[i], method="highs").fun)

    return solve


def _highs_model(these: Problems) -> tuple[highspy.Highs, highspy.HighsLp]:
    """A silent HiGHS on one thread, and the model of the first problem, not yet passed to it."""
    rows, right, cost = equations(these)
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
    return solver, model


def cold_highs(these: Problems) -> Solver:
    """HiGHS that is passed every problem anew, bounds and all."""
    solver, model = _highs_model(these)
    right, free = these.slack_cost * these.command, np.full(2 * these.slack_cost.size, np.inf)

    def solve(i: int) -> float:
        model.col_upper_ = np.concatenate([these.max_on_time[i], free])
        model.row_lower_ = model.row_upper_ = right[i]
        solver.passModel(model)
        solver.run()
        return float(solver.getInfo().objective_function_value)

    return solve


def warm_highs(these: Problems) -> Solver:
    """HiGHS with its model and last basis kept."""
    solver, model = _highs_model(these)
    solver.passModel(model)
    right = these.slack_cost * these.command
    m, n = these.effectiveness.shape
    numbers, zeros = np.arange(n, dtype=np.int32), np.zeros(n)

    def solve(i: int) -> float:
        solver.changeColsBounds(n, numbers, zeros, these.max_on_time[i])
        for k in range(m):
            solver.changeRowBounds(k, right[i, k], right[i, k])
        solver.run()
        return float(solver.getInfo().objective_function_value)

    return solve


def tight_highs(these: Problems) -> Solver:
    """HiGHS as a referee: tight tolerances, each problem scaled by its command, since they are absolute."""
    solver, model = _highs_model(these)
    for side in ("primal", "dual"):
        solver.setOptionValue(f"{side}_feasibility_tolerance", 1e-10)
    right, free = these.slack_cost * these.command, np.full(2 * these.slack_cost.size, np.inf)
    units = np.abs(right).max(axis=1)

    def solve(i: int) -> float:
        model.col_upper_ = np.concatenate([these.max_on_time[i] / units[i], free])
        model.row_lower_ = model.row_upper_ = right[i] / units[i]
        solver.passModel(model)
        solver.run()
        if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            raise RuntimeError(f"HiGHS stopped with {solver.getModelStatus()}; an optimum would be right")
        return float(solver.getInfo().objective_function_value * units[i])

    return solve


def warm_glpk(these: Problems, glpk: ModuleType) -> Solver:
    """GLPK's primal simplex with its model and last basis kept."""
    rows, right, cost = equations(these)
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
    rows, right, cost = equations(these)
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


def interior_clarabel(these: Problems) -> Solver:
    """Clarabel's interior points with their model kept: rows, then what is not negative, then bounds."""
    rows, right, cost = equations(these)
    m, n = these.effectiveness.shape
    columns = n + 2 * m
    constraints = np.vstack([rows, -np.eye(columns), np.eye(n, columns)])
    limits = np.concatenate([right, np.zeros((len(right), columns)), these.max_on_time], axis=1)
    settings = clarabel.DefaultSettings()
    settings.verbose = settings.presolve_enable = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    cones = [clarabel.ZeroConeT(m), clarabel.NonnegativeConeT(columns + n)]
    no_squares = sparse.csc_matrix((columns, columns))
    model = clarabel.DefaultSolver(
        no_squares, cost, sparse.csc_matrix(constraints), limits[0], cones, settings
    )

    def solve(i: int) -> float:
        model.update(b=limits[i])
        return float(model.solve().obj_val)

    return solve


def clipped_nnls(these: Problems) -> Solver:
    """Non-negative least squares of the weighed miss, cut off at the bounds; no heed of fuel."""
    matrix, right = these.slack_cost[:, np.newaxis] * these.effectiveness, these.slack_cost * these.command
    alive = these.max_on_time > 0.0
    matrices = [np.ascontiguousarray(matrix[:, one]) for one in alive]
    bounds = [bound[one] for bound, one in zip(these.max_on_time, alive, strict=True)]
    costs = [these.fuel_cost[one] for one in alive]

    def solve(i: int) -> float:
        on_times = np.minimum(nnls(matrices[i], right[i])[0], bounds[i])
        return float(costs[i] @ on_times + np.abs(right[i] - matrices[i] @ on_times).sum())

    return solve


def clipped_pseudo_inverse(these: Problems) -> Solver:
    """The healthy craft's pseudo-inverse, cut off below zero and at the bounds."""
    matrix, right = these.slack_cost[:, np.newaxis] * these.effectiveness, these.slack_cost * these.command
    inverse = np.linalg.pinv(matrix)

    def solve(i: int) -> float:
        on_times = np.minimum(np.maximum(inverse @ right[i], 0.0), these.max_on_time[i])
        return float(these.fuel_cost @ on_times + np.abs(right[i] - matrix @ on_times).sum())

    return solve
