"""An independent referee for the mapping problem: HiGHS, at tolerances tighter than its defaults."""

from __future__ import annotations

from collections.abc import Callable

import highspy
import numpy as np
import pytest

Optimum = Callable[..., float]


_DUAL, _PRIMAL = 1, 4  # HiGHS's option simplex_strategy


@pytest.fixture(scope="session")
def highs_optimum() -> Optimum:
    """Least objective of (command, effectiveness, max_on_time, fuel_cost, slack_cost), by HiGHS."""
    solver = highspy.Highs()
    solver.silent()
    for option, value in (
        ("presolve", "off"),
        ("threads", 1),
        ("primal_feasibility_tolerance", 1e-10),
        ("dual_feasibility_tolerance", 1e-10),
    ):
        solver.setOptionValue(option, value)

    def optimum(command, effectiveness, max_on_time, fuel_cost, slack_cost):
        m, n = effectiveness.shape
        columns = n + 2 * m
        weighted = slack_cost * command
        unit = np.abs(weighted).max() or 1.0  # the problem is homogeneous; HiGHS's tolerances are absolute
        weighted = weighted / unit
        problem = highspy.HighsLp()
        problem.num_col_ = columns
        problem.num_row_ = m
        problem.col_cost_ = np.concatenate([fuel_cost, np.ones(2 * m)])
        problem.col_lower_ = np.zeros(columns)
        problem.col_upper_ = np.concatenate([max_on_time / unit, np.full(2 * m, np.inf)])
        problem.row_lower_ = weighted
        problem.row_upper_ = weighted
        rows = np.hstack([slack_cost[:, np.newaxis] * effectiveness, np.eye(m), -np.eye(m)])
        problem.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        problem.a_matrix_.start_ = np.arange(m + 1) * columns
        problem.a_matrix_.index_ = np.tile(np.arange(columns), m)
        problem.a_matrix_.value_ = rows.ravel()
        solver.passModel(problem)
        solver.run()
        if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            # Among near-twins its dual simplex may lose its way at such tolerances: then by its primal
            solver.clearSolver()
            solver.setOptionValue("simplex_strategy", _PRIMAL)
            solver.run()
            solver.setOptionValue("simplex_strategy", _DUAL)
        assert solver.getModelStatus() == highspy.HighsModelStatus.kOptimal
        return solver.getInfo().objective_function_value * unit

    return optimum
