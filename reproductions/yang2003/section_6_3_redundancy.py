"""Which motions Orion keeps when a thruster is lost.

A direction is one of the six axes with a sign; it is kept if thrusters can change that rate and no other. How
much of it is left in a period comes from one linear program for each direction, and whether there is any is
asked of the mapper besides. The source speaks of one loss; what two losses take away is ours.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from reproductions.figures import BLUE, INK, RED, Figure, panels
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from thruster_baselines.mapping import LPMapper
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import load

ORION = load("orion")
DIRECTIONS = np.vstack([np.eye(6), -np.eye(6)])
"""(12, 6): each axis upward, then each downward."""
NAMES = tuple(f"{sign}{axis}" for sign in "+-" for axis in ("x", "y", "z", "x-rot", "y-rot", "z-rot"))


@reproduces(
    "E22",
    lines="L1345",
    reported="full control in six degrees of freedom after the loss of any one thruster",
    criterion="some authority left in all 12 signed directions after each of the 12 losses",
)
def redundancy(effort: Effort) -> Finding:
    """Orion's redundancy: any one thruster lost."""
    count = len(ORION.thrusters)
    healthy = authority(())
    left = np.array([authority((i,)) for i in range(count)])
    kept = np.array([kept_by_mapper((i,)) for i in range(count)])
    pairs = list(itertools.combinations(range(count), 2))
    losing = [(i + 1, j + 1) for i, j in pairs if not kept_by_mapper((i, j)).all()]
    shares = left / healthy
    changed = shares < 1.0 - 1e-9
    table = Table.of(
        "Authority of one period of 5 s with the other axes held at zero, m/s and rad/s",
        [("none", healthy), *((f"{i + 1}", one) for i, one in enumerate(left))],
        {"lost": "{0}"} | {name: (lambda _, one, k=k: f"{one[k]:.3g}") for k, name in enumerate(NAMES)},
    )
    return Finding(
        ours=f"{kept.sum()} of {kept.size} directions are kept; a loss weakens {changed.sum(axis=1).max()} "
        f"of {len(DIRECTIONS)} at most, and leaves {100.0 * shares.min():.3g} % or more of each",
        checks={
            "after each single loss the mapper meets a command in each direction": kept.all(),
            "and HiGHS finds authority in each": (shares > 1e-6).all(),
        },
        note=f"Two losses are more than the source speaks of: {len(losing)} of {len(pairs)} pairs take a "
        f"direction away. They are {', '.join(f'{i} and {j}' for i, j in losing)}.",
        data={
            "directions": NAMES,
            "healthy": healthy,
            "left": left,
            "pairs": len(pairs),
            "pairs_that_lose_a_direction": losing,
        },
        tables=(table,),
        figure=lambda: _draw(shares),
    )


def authority(lost: tuple[int, ...]) -> FloatArray:
    """The largest rate change (12,) of one period in each direction, without any other, m/s then rad/s."""
    working = _without(lost)
    scale = np.abs(working).max(axis=1, initial=1e-9)
    rows = working / scale[:, np.newaxis]
    answers = [
        linprog(
            np.append(np.zeros(rows.shape[1]), -1.0),
            A_eq=np.column_stack([rows, -direction]),
            b_eq=np.zeros(len(rows)),
            bounds=[(0.0, ORION.control_period)] * rows.shape[1] + [(0.0, None)],
        ).x[-1]
        for direction in DIRECTIONS
    ]
    return np.array(answers) * np.tile(scale, 2)


def kept_by_mapper(lost: tuple[int, ...]) -> NDArray[np.bool_]:
    """(12,): whether the mapper meets a command in each direction, with no limit on the on-times."""
    mapper = LPMapper(_without(lost), max_on_time=np.inf, slack_cost=1e6)
    commands = DIRECTIONS * np.tile(ORION.authority(), 2)[:, np.newaxis]
    missed = np.abs(mapper(commands).slack) / ORION.authority()
    return np.asarray((missed < 1e-9).all(axis=-1))


def _without(lost: tuple[int, ...]) -> FloatArray:
    working = ORION.effectiveness().copy()
    working[:, list(lost)] = 0.0
    return working


def _draw(shares: FloatArray) -> Figure:
    """What is left of each direction after each loss, in %; shares (lost thruster, direction)."""
    figure, (axes,) = panels(height=4.4)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    for (row, column), share in np.ndenumerate(shares):
        look = {"color": RED if share < 1e-6 else BLUE, "weight": "bold"}
        if np.isclose(share, 1.0):
            look = {"color": INK, "alpha": 0.45}
        axes.text(column, row, f"{100.0 * share:.0f}", ha="center", va="center", **look)
    axes.set_xticks(range(len(NAMES)), NAMES)
    axes.set_yticks(range(len(shares)), [f"{i + 1}" for i in range(len(shares))])
    axes.set(xlim=(-0.6, len(NAMES) - 0.4), ylim=(len(shares) - 0.4, -0.6), ylabel="lost thruster")
    axes.set(xlabel="direction, other axes held at zero")
    axes.set(title="What Orion has left of each direction when one thruster is lost, % of healthy")
    axes.tick_params(length=0)
    return figure
