"""Section 3.3: the robust program for three axes and two thrusters that are 10 % uncertain.

The source writes down the matrix of the program and the worst cases that it stands for, and no solution. The
matrix is worked out here from its definition, the largest value of each entry over the thrusters' errors, and
the program is solved by HiGHS and by the mapper.
"""

from __future__ import annotations

import itertools
import warnings
from typing import cast

import numpy as np
from scipy.optimize import linprog

from reproductions.cells import named
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from thruster_baselines.mapping import LPMapper, RobustAllocation, RobustEffectivenessMapper
from thruster_baselines.mapping.model import LostDirectionsWarning
from thruster_envs.protocols import FloatArray

EFFECTIVENESS = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, 1.0]])
COMMAND = np.array([3.0, 1.0, 3.0])
LONGEST, ERROR = 5.0, 0.1
PRINTED_UPPER = np.array([[1.1, 1.1], [-0.9, 1.1], [1.1, 1.1]])
PRINTED_LOWER = np.array([[-0.9, -0.9], [1.1, -0.9], [-0.9, -0.9]])
PRINTED_WORST_LOWER = np.array([[-0.9, -0.9], [0.9, -0.9], [-0.9, -0.9]])
EXACT = 1e-9


@reproduces(
    "E18",
    lines="L782-804",
    reported="the matrix of the program for errors of 10 %, and its worst cases",
    criterion="the printed matrix from its definition; one solution by mapper and by HiGHS",
)
def worked_example(effort: Effort) -> Finding:
    """Robust program for uncertain thrusters, worked example."""
    corners = [
        EFFECTIVENESS * (1.0 + ERROR * np.array(signs)) for signs in itertools.product((-1.0, 1.0), repeat=2)
    ]
    upper, lower = np.max(corners, axis=0), np.max([-one for one in corners], axis=0)
    on_times, slack = by_highs(upper, lower)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LostDirectionsWarning)  # two thrusters, three axes
        mapper = RobustEffectivenessMapper(EFFECTIVENESS, max_on_time=LONGEST, relative=ERROR)
        with_one_slack = RobustEffectivenessMapper(
            EFFECTIVENESS, max_on_time=LONGEST, relative=ERROR, largest_miss=True
        )
        plain = LPMapper(EFFECTIVENESS, max_on_time=LONGEST)(COMMAND)
    robust = cast(RobustAllocation, mapper(COMMAND))
    miss = robust.worst_miss
    largest = with_one_slack(COMMAND)
    worst, worst_of_largest = (
        np.max([np.abs(one @ answer.on_times - COMMAND) for one in corners], axis=0)
        for answer in (robust, largest)
    )
    misprint = np.abs(PRINTED_WORST_LOWER - lower)
    table = Table(
        "Matrix of the program, without the columns of the slacks",
        ("row", "printed", "ours"),
        [
            (f"{sign}{axis}", named(printed), named(ours))
            for sign, blocks in (("+", (PRINTED_UPPER, upper)), ("-", (PRINTED_LOWER, lower)))
            for axis, printed, ours in zip("xyz", *blocks, strict=True)
        ],
    )
    return Finding(
        ours=f"the matrix printed; on-times {named(robust.on_times)} s, worst miss {named(miss)}",
        checks={
            "the upper block is the one printed": np.abs(upper - PRINTED_UPPER).max() < EXACT,
            "the lower block is the one printed": np.abs(lower - PRINTED_LOWER).max() < EXACT,
            "mapper and HiGHS agree on the on-times": np.abs(robust.on_times - on_times).max() < EXACT,
            "and on the slack": np.abs(miss - slack).max() < EXACT,
            "the slack is the worst of the thrusters' errors": np.abs(worst - slack).max() < EXACT,
            "the plain program fires alike": np.abs(plain.on_times - on_times).max() < EXACT,
        },
        correction=(
            f"the worst case of the lower block (L797) has {PRINTED_WORST_LOWER[1, 0]} in row 2, column 1; "
            f"it is {lower[1, 0]:.1f}, as in the matrix of the program"
            if misprint[1, 0] > EXACT and np.count_nonzero(misprint > EXACT) == 1
            else ""
        ),
        note=f"With one slack for all axes in place of three the on-times are {named(largest.on_times)} s, "
        f"and the largest miss is {worst_of_largest.max():.3g}. The source gives no solution to compare "
        "with. Two thrusters leave a direction of the three out of reach; the command does not need it.",
        data={
            "upper": upper,
            "lower": lower,
            "on_times": robust.on_times,
            "worst_miss": miss,
            "largest_miss_with_one_slack": float(worst_of_largest.max()),
        },
        tables=(table,),
    )


def by_highs(upper: FloatArray, lower: FloatArray) -> tuple[FloatArray, FloatArray]:
    """On-times (2,) and slack (3,) of the program of eqs. 34 and 35, with a slack for each axis."""
    answer = linprog(
        np.concatenate([np.ones(2), np.full(3, 1e3)]),
        A_ub=np.block([[upper, -np.eye(3)], [lower, -np.eye(3)]]),
        b_ub=np.concatenate([COMMAND, -COMMAND]),
        bounds=[(0.0, LONGEST)] * 2 + [(0.0, None)] * 3,
    )
    return answer.x[:2], answer.x[2:]
