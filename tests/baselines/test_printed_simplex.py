"""Where the simplex program that the source prints goes wrong, and ours does not (Yang 2003, appendix A).

`as_printed` follows the printed steps, with its loop ends put where they have to be and sign(0) = 1 so that
it runs at all. Three of its steps are wrong: (a) a thruster that comes back into the basis from its bound
gets its true value, but its row stays that of the reflected variable; (b) a thruster that runs from bound to
bound is always put at the upper one; (c) a slack that has left the basis cannot come back.
"""

from __future__ import annotations

import numpy as np
import pytest

from thruster_baselines.mapping import LPMapper
from thruster_envs.spacecraft import load

ORION = load("orion")
PRICE = 1e4
UNBOUNDED = 1e6  # the printed bound of slacks


def as_printed(command: np.ndarray, effectiveness: np.ndarray, bound: float) -> tuple[np.ndarray, np.ndarray]:
    """On-times (n,) and slack (m,) by the printed program."""
    m, n = effectiveness.shape
    side = np.where(command >= 0.0, 1.0, -1.0)
    tableau = side[:, np.newaxis] * effectiveness
    gain = PRICE * tableau.sum(axis=0) - 1.0
    basis, ceilings, values = np.arange(n, n + m), np.full(m, UNBOUNDED), np.abs(command)
    bounds = np.concatenate([np.full(n, bound), np.full(m, UNBOUNDED)])
    parked = np.zeros(n + m)
    for _ in range(3 * m):
        entering = int(np.argmax(gain))
        if gain[entering] <= 0.0:
            break
        column, top = tableau[:, entering].copy(), gain[entering]
        down = np.array([abs(v) / c if c > 0.0 else np.inf for v, c in zip(values, column, strict=True)])
        up = np.array(
            [(v - u) / c if c < 0.0 else np.inf for v, u, c in zip(values, ceilings, column, strict=True)]
        )
        to_zero, to_bound, room = down.min(), up.min(), bounds[entering]
        if to_bound >= room and to_zero >= room:
            parked[entering] = room  # (b)
            values = values - room * column
            tableau[:, entering] *= -1.0
            gain[entering] *= -1.0
            continue
        over_the_top = to_zero > to_bound
        row = int(np.argmin(up if over_the_top else down))
        step = min(to_zero, to_bound)
        leaving = basis[row]
        parked[leaving] = bounds[leaving] if over_the_top else 0.0
        values = values - step * column
        basis[row], ceilings[row] = entering, room
        values[row] = (
            parked[entering] - step if parked[entering] != 0.0 else step
        )  # (a): the row is not mended
        parked[entering] = 0.0
        pivot = tableau[row] / column[row]
        gain = gain - top * pivot
        tableau = tableau - np.outer(column, pivot)
        tableau[row] = pivot
        if over_the_top and leaving < n:
            tableau[:, leaving] *= -1.0
            gain[leaving] *= -1.0
    whole = parked.copy()
    whole[basis] = values
    return whole[:n], side * whole[n:]  # (c): only thrusters have columns


def verdicts(commands: np.ndarray, bound: float) -> tuple[np.ndarray, np.ndarray]:
    """For each command: whether the printed answer is possible at all, and whether it is optimal too."""
    matrix = ORION.effectiveness()
    best = LPMapper(ORION, bound, slack_cost=PRICE)(commands)
    # ours is what it says, always
    np.testing.assert_allclose(best.on_times @ matrix.T + best.slack, commands, rtol=0, atol=1e-14)
    assert (best.on_times >= 0.0).all()
    assert (best.on_times <= bound).all()
    possible, optimal = [], []
    for command, cost in zip(commands, best.cost, strict=True):
        on_times, slack = as_printed(command, matrix, bound)
        possible.append(
            bool(
                np.abs(matrix @ on_times + slack - command).max() < 1e-9
                and on_times.min() > -1e-9
                and on_times.max() < bound + 1e-9
            )
        )
        own = on_times.sum() + PRICE * np.abs(slack).sum()
        optimal.append(bool(abs(own - cost) <= 1e-9 * cost))
        assert not possible[-1] or own >= cost * (1.0 - 1e-9)  # nobody is better than the optimum
    return np.array(possible), np.array(possible) & np.array(optimal)


def commands(share: float, axes: list[int], seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-share, share, (400, 6)) * ORION.authority() * axes


def test_with_bounds_out_of_reach_the_printed_program_is_right():
    possible, optimal = verdicts(commands(0.3, [1] * 6, 0), bound=1e3)
    assert possible.all()
    assert optimal.mean() > 0.99  # the cap of 18 pivots or the missing tolerance may stop it short


@pytest.mark.parametrize(
    ("share", "axes", "least"),
    [  # translation of up to 0.03 m/s a period; all six axes, partly beyond reach
        (1.0, [1, 1, 1, 0, 0, 0], 0.01),
        (0.4, [1] * 6, 0.01),
    ],
)
def test_where_bounds_are_met_some_printed_answers_break_them_or_the_equations(share, axes, least):
    possible, _ = verdicts(commands(share, axes, 1), bound=5.0)
    assert (~possible).mean() >= least


def test_where_the_command_is_beyond_reach_some_printed_answers_are_not_optimal():
    possible, optimal = verdicts(commands(1.5, [1] * 6, 2), bound=5.0)
    assert (possible & ~optimal).mean() >= 0.02


def test_a_command_of_zero_on_an_axis_does_not_annihilate_its_row():
    allocation = LPMapper(ORION)([0.0, 0.0, -0.01, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(allocation.slack, 0.0, atol=1e-15)
    assert allocation.on_times.sum() == pytest.approx(0.01 / 0.003)
