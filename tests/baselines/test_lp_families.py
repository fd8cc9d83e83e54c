"""The linear program against HiGHS, family by family: what vehicles, bounds, commands and scales do to it.

Random, degenerate and saturated mixtures of six axes and twelve thrusters are in `test_simplex.py`; here are
the families that those leave out, each by itself, so that none hides behind the others. A few hundred
problems in `make test`, and some thousands of each in `make nightly`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from thruster_baselines.mapping.sequence import LPSequence
from thruster_baselines.mapping.simplex import OPTIMAL, solve_batch

Problems = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Commands (b, m), effectiveness (b, m, n), longest on-times (b, n), fuel costs (n,), slack costs (m,)."""

FEW, MANY = 40, 3000


def plain(rng: np.random.Generator, count: int, axes: int = 6, thrusters: int = 12) -> Problems:
    """Random vehicles, and commands within reach of most of them."""
    effectiveness = rng.normal(size=(count, axes, thrusters))
    longest = rng.uniform(0.5, 5.0, (count, thrusters))
    command = commands_within(rng, effectiveness, longest)
    return command, effectiveness, longest, rng.uniform(0.5, 3.0, thrusters), rng.uniform(50.0, 500.0, axes)


def commands_within(rng, effectiveness, longest) -> np.ndarray:
    fired = longest * rng.random(longest.shape) * (rng.random(longest.shape) < 0.4)
    return np.einsum("bkj,bj->bk", effectiveness, fired)


def duplicate_columns(rng, count) -> Problems:
    """Each thruster has an exact twin, of the same or the opposite sign: optima are rays and faces."""
    _, effectiveness, longest, _, slack = plain(rng, count)
    effectiveness[:, :, 6:] = effectiveness[:, :, :6] * rng.choice([-1.0, 1.0], (count, 1, 6))
    return commands_within(rng, effectiveness, longest), effectiveness, longest, np.ones(12), slack


def near_ties(rng, count) -> Problems:
    """Twins that differ in the last digits, in thrust or in cost."""
    command, effectiveness, longest, _, slack = duplicate_columns(rng, count)
    effectiveness *= 1.0 + 10.0 ** rng.integers(-16, -8, (count, 1, 1)) * rng.normal(size=effectiveness.shape)
    return command, effectiveness, longest, 1.0 + 1e-12 * rng.normal(size=12), slack


def dead_thrusters(rng, count) -> Problems:
    command, effectiveness, longest, fuel, slack = plain(rng, count)
    dead = rng.random((count, 12)) < rng.uniform(0.1, 0.95, (count, 1))
    dead[0] = True
    return command, effectiveness * ~dead[:, np.newaxis], longest, fuel, slack


def beyond_authority(rng, count) -> Problems:
    command, effectiveness, longest, fuel, slack = plain(rng, count)
    return (
        rng.normal(size=command.shape) * 10.0 ** rng.uniform(1.0, 6.0, (count, 1)),
        effectiveness,
        longest,
        fuel,
        slack,
    )


def zero_commands(rng, count) -> Problems:
    """Nothing commanded at all, or on all axes but one; zeros of either sign."""
    command, *rest = plain(rng, count)
    kept = rng.integers(-1, 6, count)
    command = np.where(np.arange(6) == kept[:, np.newaxis], command, rng.choice([0.0, -0.0], command.shape))
    return command, *rest


def scales(rng, count) -> Problems:
    """A vehicle of 1e-9 to 1e9 times the usual rates, commanded and charged for misses in proportion."""
    command, effectiveness, longest, fuel, slack = plain(rng, count)
    scale = 10.0 ** rng.uniform(-9.0, 9.0)
    return command * scale, effectiveness * scale, longest, fuel, slack / scale


def mixed_scales(rng, count) -> Problems:
    """Axes in units of their own, a millionfold apart, and thrusters that are a thousandfold apart."""
    _, effectiveness, longest, fuel, slack = plain(rng, count)
    axes, thrusters = 10.0 ** rng.uniform(-3.0, 3.0, 6), 10.0 ** rng.uniform(-1.5, 1.5, (count, 1, 12))
    effectiveness = effectiveness * axes[:, np.newaxis] * thrusters
    return commands_within(rng, effectiveness, longest), effectiveness, longest, fuel, slack / axes


def tight_bounds(rng, count) -> Problems:
    """Thrusters that may not fire, or for next to no time, beside others that may fire for ever."""
    command, effectiveness, longest, fuel, slack = plain(rng, count)
    kind = rng.integers(4, size=longest.shape)
    return command, effectiveness, np.choose(kind, [0.0, 1e-9, longest, np.inf]), fuel, slack


def many_thrusters(rng, count) -> Problems:
    return plain(rng, count, 6, 36)


def rank_deficient(rng, count) -> Problems:
    """Axes that nothing serves, and axes that only move together."""
    command, effectiveness, longest, fuel, slack = plain(rng, count)
    rank = rng.integers(1, 6)
    effectiveness = rng.integers(-2, 3, (count, 6, rank)) @ effectiveness[:, :rank]
    return (
        rng.choice([command, commands_within(rng, effectiveness, longest)]),
        effectiveness,
        longest,
        fuel,
        slack,
    )


def badly_conditioned(rng, count) -> Problems:
    """Singular values from 1 down to 1e-6: some directions are next to out of reach."""
    _, effectiveness, longest, fuel, slack = plain(rng, count)
    u, _, v = np.linalg.svd(effectiveness, full_matrices=False)
    effectiveness = (u * np.logspace(0.0, -6.0, 6)) @ v
    return commands_within(rng, effectiveness, longest), effectiveness, longest, fuel, slack * 1e3


FAMILIES: dict[str, Callable[[np.random.Generator, int], Problems]] = {
    one.__name__: one
    for one in (
        duplicate_columns, near_ties, dead_thrusters, beyond_authority, zero_commands, scales, mixed_scales,
        tight_bounds, many_thrusters, rank_deficient, badly_conditioned,
    )
}  # fmt: skip

SHARE = {"near_ties": 1e-8}
"""What is reached only by the difference of near-twins may be missed: no pivot is smaller than that."""

every_family = pytest.mark.parametrize("family", FAMILIES)
sizes = pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.nightly)])


def problems(family: str, count: int) -> list[Problems]:
    """Batches of up to ten problems with costs of their own."""
    rng = np.random.default_rng(sorted(FAMILIES).index(family))
    return [FAMILIES[family](rng, 10) for _ in range(count // 10)]


def check(answer, problem: Problems, highs_optimum, share: float = 1e-10) -> None:
    """Whole numbers, within the bounds, what is said to be missed is missed, and no cheaper answer exists.

    `share` of the largest entry of the command may be missed where it could be reached.
    """
    on_times, slack, cost, *_ = answer
    command, effectiveness, longest, fuel, slack_cost = problem
    assert np.isfinite(on_times).all()
    assert ((on_times >= 0.0) & (on_times <= longest)).all()
    achieved = np.einsum("bkj,bj->bk", effectiveness, on_times)
    size = np.abs(command) + np.einsum("bkj,bj->bk", np.abs(effectiveness), on_times)
    assert (np.abs(command - slack - achieved) <= 1e-13 * size).all()
    own = on_times @ fuel + np.abs(slack) @ slack_cost
    np.testing.assert_allclose(cost, own, rtol=1e-12, atol=1e-300)
    best = [
        highs_optimum(*one, fuel, slack_cost) for one in zip(command, effectiveness, longest, strict=True)
    ]
    # HiGHS may miss the largest entry of the command by its tolerance, and pays nothing for that
    tolerance = share * np.abs(slack_cost * command).max(axis=1)
    assert (np.abs(cost - best) <= 1e-9 * np.abs(best) + tolerance).all()


@every_family
@sizes
def test_the_optimum_is_that_of_highs(highs_optimum, family, count):
    for problem in problems(family, count):
        command, effectiveness, longest, fuel, slack_cost = problem
        answer = solve_batch(command, effectiveness, longest, fuel[np.newaxis], slack_cost)
        assert (answer[3][:, 0] == OPTIMAL).all()
        check(answer, problem, highs_optimum, SHARE.get(family, 1e-10))


@pytest.mark.filterwarnings("ignore::thruster_baselines.mapping.model.LostDirectionsWarning")  # they are lost
@every_family
@sizes
def test_a_sequence_that_starts_from_the_last_basis_finds_it_too(highs_optimum, family, count):
    """Ten commands of one vehicle, jumping: those of the family, and back to the first."""
    for problem in problems(family, count):
        command, effectiveness, longest, fuel, slack_cost = problem
        sequence = LPSequence(effectiveness[1], longest[1], fuel, slack_cost, fuel_may_win=True)
        followed = [sequence(one) for one in [*command, command[0]]]
        answer = [
            np.stack([getattr(one, name) for one in followed]) for name in ("on_times", "slack", "cost")
        ]
        commands, vehicle = np.concatenate([command, command[:1]]), [1] * len(followed)
        case = commands, effectiveness[vehicle], longest[vehicle], fuel, slack_cost
        check(answer, case, highs_optimum, SHARE.get(family, 1e-10))
