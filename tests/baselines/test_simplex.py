from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from thruster_baselines.mapping import LPMapper
from thruster_baselines.mapping.simplex import OPTIMAL, PARALLEL_FROM, ROUND_OFF, solve_batch
from thruster_envs.spacecraft import load

AXES, THRUSTERS = 6, 12


def random_problems(seed: int, count: int) -> tuple[np.ndarray, ...]:
    """Mapping problems that share their costs: regular, degenerate, saturated, tiny, partly dead."""
    rng = np.random.default_rng(seed)
    effectiveness = rng.normal(size=(count, AXES, THRUSTERS))
    kind = rng.integers(5, size=count)
    integer = kind == 0  # many exactly equal ratios and reduced costs
    effectiveness[integer] = rng.integers(-1, 2, (integer.sum(), AXES, THRUSTERS))
    mixed_units = kind == 1
    effectiveness[mixed_units] *= 10.0 ** rng.uniform(-3.0, 1.0, (mixed_units.sum(), AXES, 1))
    paired = kind == 2  # opposing thrusters, and with them a whole ray of equal solutions
    effectiveness[paired, :, 6:] = -effectiveness[paired, :, :6]
    twins = kind == 3
    effectiveness[twins, :, 6:] = effectiveness[twins, :, :6]
    dead = rng.random(count) < 0.3
    effectiveness[dead, :, rng.integers(THRUSTERS, size=dead.sum())] = 0.0

    max_on_time = np.where(rng.random((count, 1)) < 0.5, 5.0, rng.uniform(0.0, 5.0, (count, THRUSTERS)))
    max_on_time[rng.random((count, THRUSTERS)) < 0.05] = 0.0

    largest = np.maximum(np.abs(effectiveness).max(axis=2), 1e-3)
    reachable = np.einsum("bkj,bj->bk", effectiveness, max_on_time * rng.uniform(0.0, 0.2, max_on_time.shape))
    corner = np.einsum("bkj,bj->bk", effectiveness, max_on_time * (rng.random(max_on_time.shape) < 0.5))
    saturating = rng.normal(size=(count, AXES)) * largest * 10.0
    single_axis = np.where(rng.integers(AXES, size=(count, 1)) == np.arange(AXES), largest, 0.0)
    command = np.choose(rng.integers(4, size=(count, 1)), [reachable, corner, saturating, single_axis])
    command *= np.choose(rng.integers(6, size=(count, 1)), [1.0, 1.0, 1.0, 1.0, 1e-4, 1e-8])

    fuel_cost = rng.uniform(0.5, 3.0, THRUSTERS) if seed % 2 else np.ones(THRUSTERS)
    slack_cost = 10.0 ** rng.uniform(1.0, 4.0) * 10.0 ** rng.uniform(-1.0, 1.0, AXES)
    return command, effectiveness, max_on_time, fuel_cost[np.newaxis], slack_cost


@pytest.mark.parametrize("seed", range(20))
def test_objective_is_that_of_highs(highs_optimum, seed):
    """100,000 problems in all: no bound broken, no NaN, no hang, no objective worse than that of HiGHS.

    A command is met to within round-off of it, whose price as a miss comes on top where problems are such
    that a whole command costs a million times the optimum.
    """
    command, effectiveness, max_on_time, fuel_cost, slack_cost = random_problems(seed, 5000)
    on_times, slack, cost, report = solve_batch(command, effectiveness, max_on_time, fuel_cost, slack_cost)
    assert (report[:, 0] == OPTIMAL).all()
    assert report[:, 1:].sum(axis=1).max() < 5 * (AXES + THRUSTERS)  # of a cap of a hundred for each variable
    expected = [
        highs_optimum(*problem, fuel_cost[0], slack_cost)
        for problem in zip(command, effectiveness, max_on_time, strict=True)
    ]
    round_off = 10.0 * ROUND_OFF * np.max(np.abs(command) * slack_cost, axis=-1)
    assert (np.abs(cost - expected) <= 1e-9 * np.abs(expected) + 1e-14 + round_off).all()
    # and the cost is that of on-times that can be flown
    assert (on_times >= 0.0).all()
    assert (on_times <= max_on_time).all()
    achieved = np.einsum("bkj,bj->bk", effectiveness, on_times)
    size = np.abs(command) + np.einsum("bkj,bj->bk", np.abs(effectiveness), on_times)
    assert (np.abs(command - slack - achieved) <= 1e-14 * size).all()
    np.testing.assert_allclose(
        cost, on_times @ fuel_cost[0] + np.abs(slack) @ slack_cost, rtol=1e-13, atol=1e-300
    )


@pytest.mark.parametrize("seed", range(4))
def test_answer_is_a_vertex(seed):
    command, effectiveness, max_on_time, fuel_cost, slack_cost = random_problems(seed, 2000)
    on_times, slack, _, _ = solve_batch(command, effectiveness, max_on_time, fuel_cost, slack_cost)
    partly_open = ((on_times > 0.0) & (on_times < max_on_time)).sum(axis=1)
    assert partly_open.max() <= AXES
    # a row that is missed keeps its slack in the basis, so that one thruster less can be partly open
    size = np.abs(command) + np.einsum("bkj,bj->bk", np.abs(effectiveness), on_times)
    round_off = 1e-13 * (size * slack_cost).max(axis=1, keepdims=True)
    missed = (np.abs(slack) * slack_cost > round_off).sum(axis=1)
    assert (partly_open + missed).max() <= AXES


def test_a_batch_gives_what_its_problems_give_alone_whatever_the_threads():
    command, effectiveness, max_on_time, fuel_cost, slack_cost = random_problems(3, PARALLEL_FROM + 13)
    answers = [
        solve_batch(command, effectiveness, max_on_time, fuel_cost, slack_cost, threads)
        for threads in (1, 2, 3, None)
    ]
    for answer in answers[1:]:
        for part, first in zip(answer, answers[0], strict=True):
            assert part.tobytes() == first.tobytes()
    for i in range(len(command)):
        alone = solve_batch(command[[i]], effectiveness[[i]], max_on_time[[i]], fuel_cost, slack_cost)
        for part, whole in zip(alone, answers[0], strict=True):
            assert part[0].tobytes() == whole[i].tobytes()


def test_one_effectiveness_can_serve_a_whole_batch():
    command, effectiveness, max_on_time, fuel_cost, slack_cost = random_problems(5, 64)
    shared = solve_batch(command, effectiveness[:1], max_on_time[:1], fuel_cost, slack_cost)
    repeated = solve_batch(
        command,
        np.repeat(effectiveness[:1], 64, axis=0),
        np.repeat(max_on_time[:1], 64, axis=0),
        fuel_cost,
        slack_cost,
    )
    for part, other in zip(shared, repeated, strict=True):
        assert part.tobytes() == other.tobytes()


@pytest.mark.parametrize(("axes", "thrusters"), [(1, 1), (1, 4), (2, 3), (3, 2), (3, 8), (6, 24), (8, 40)])
def test_other_sizes(highs_optimum, axes, thrusters):
    rng = np.random.default_rng(axes * 100 + thrusters)
    effectiveness = rng.normal(size=(1, axes, thrusters))
    command = rng.normal(size=(50, axes))
    max_on_time = np.full((1, thrusters), 1.0)
    fuel_cost, slack_cost = np.ones((1, thrusters)), np.full(axes, 100.0)
    _, _, cost, _ = solve_batch(command, effectiveness, max_on_time, fuel_cost, slack_cost)
    expected = [
        highs_optimum(one, effectiveness[0], max_on_time[0], fuel_cost[0], slack_cost) for one in command
    ]
    np.testing.assert_allclose(cost, expected, rtol=1e-9)


def test_degenerate_corner_does_not_cycle():
    # A cube of equal thrusters under commands in its corners: almost every ratio is a tie.
    corners = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1)
    effectiveness = np.hstack([corners, corners, -corners])[np.newaxis]
    command = np.ascontiguousarray(corners.T) * 3.0
    answer = solve_batch(
        command, effectiveness, np.ones((1, effectiveness.shape[2])), np.ones((1, 81)), np.full(3, 50.0)
    )
    assert (answer[3][:, 0] == OPTIMAL).all()
    # a thruster along each corner exists, and three of them have the whole bound each
    np.testing.assert_allclose(
        answer[2], np.where(np.abs(command).any(axis=1), 3.0, 0.0), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("vehicle", ["orion", "spheres"])
@pytest.mark.parametrize("fault", ["healthy", "dead", "half"])
def test_tracking_comes_before_fuel(highs_optimum, vehicle, fault):
    """The weighted miss of the optimum is the least that any on-times have, whatever the fuel."""
    spacecraft = load(vehicle)
    mapper = LPMapper(spacecraft)
    rng = np.random.default_rng(7)
    authority = spacecraft.authority()
    count = 24 if fault == "healthy" else 6
    commands = np.concatenate(
        [
            np.eye(6)[rng.integers(6, size=count)] * rng.uniform(-1.5, 1.5, (count, 1)),
            rng.uniform(-0.3, 0.3, (count, 6)),
            rng.uniform(-1.0, 1.0, (count, 6)),
            rng.normal(size=(count, 6)) * 4.0,
            rng.uniform(-1e-4, 1e-4, (count, 6)),
        ]
    )
    commands *= authority
    for thruster in range(1 if fault == "healthy" else spacecraft.number_of_thrusters):
        effectiveness = spacecraft.effectiveness()
        effectiveness[:, thruster] *= {"healthy": 1.0, "dead": 0.0, "half": 0.5}[fault]
        allocation = mapper(commands, effectiveness=effectiveness)
        miss = np.abs(allocation.slack) @ mapper.slack_cost
        least = [
            highs_optimum(command, effectiveness, mapper.max_on_time, np.zeros(12), mapper.slack_cost)
            for command in commands
        ]
        np.testing.assert_allclose(
            miss, least, rtol=1e-9, atol=1e-9 * (np.abs(commands) @ mapper.slack_cost).min()
        )


# Among equal optima


def open_thrusters(on_times: np.ndarray) -> int:
    return int((on_times > 0.0).sum())


def fewest_open(command, mapper) -> int:
    """The fewest open thrusters of all optima, by an integer program (HiGHS)."""
    m, n = mapper.effectiveness.shape
    unit = 1.0 / np.abs(mapper.effectiveness).max(axis=1)
    bounds, none = mapper.max_on_time, np.zeros((m, n))
    price = np.concatenate([mapper.fuel_cost, np.tile(mapper.slack_cost / unit, 2), np.zeros(n)])
    equations = np.hstack([mapper.effectiveness * unit[:, np.newaxis], np.eye(m), -np.eye(m), none])
    opened = np.hstack([np.eye(n), np.zeros((n, 2 * m)), -np.diag(bounds)])
    answer = milp(
        np.concatenate([np.zeros(n + 2 * m), np.ones(n)]),
        integrality=np.concatenate([np.zeros(n + 2 * m), np.ones(n)]),
        bounds=Bounds(0.0, np.concatenate([bounds, np.full(2 * m, np.inf), np.ones(n)])),
        constraints=[
            LinearConstraint(equations, unit * command, unit * command),
            LinearConstraint(price[np.newaxis], -np.inf, float(mapper(command).cost) * (1.0 + 1e-7)),
            LinearConstraint(opened, -np.inf, 0.0),
        ],
    )
    return round(answer.fun)


@pytest.mark.parametrize(("vehicle", "share"), [("orion", 0.85), ("spheres", 1.0)])
def test_among_equal_optima_few_thrusters_are_open(vehicle, share):
    """The rule looks at neighbours only; for so large a share of degenerate commands that is enough."""
    mapper = LPMapper(load(vehicle))
    rng = np.random.default_rng(0)
    commands = rng.choice([-1.0, -0.5, 0.0, 0.0, 0.5, 1.0], (150, 6)) * load(vehicle).authority() * 0.15
    commands = commands[np.abs(commands).max(axis=1) > 0.0]
    excess = np.array(
        [open_thrusters(mapper(command).on_times) - fewest_open(command, mapper) for command in commands]
    )
    assert (excess >= 0).all()
    assert (excess == 0).mean() >= share
    assert excess.max() <= 2


def test_of_two_equal_optima_the_one_with_fewer_open_thrusters_is_taken():
    # Thruster 5 does at once what 1 to 4 do together, at the price of the four.
    effectiveness = np.hstack([np.eye(4), np.ones((4, 1))])
    for order in (np.arange(5), np.array([4, 0, 1, 2, 3])):
        mapper = LPMapper(effectiveness[:, order], 5.0, fuel_cost=np.array([1.0, 1, 1, 1, 4])[order])
        allocation = mapper(np.ones(4))
        assert allocation.cost == pytest.approx(4.0)
        assert open_thrusters(allocation.on_times) == 1


# Pivots


def test_pivots_are_counted_for_each_command():
    mapper = LPMapper(load("orion"))
    assert [int(one) for one in mapper.pivots(np.zeros(6))] == [0, 0]
    commands = np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 6)) * load("orion").authority()
    changes, flips = mapper.pivots(commands)
    assert (changes + flips >= 3).all()
    assert mapper.pivots(commands.reshape(20, 100, 6))[0].tolist() == changes.reshape(20, 100).tolist()
