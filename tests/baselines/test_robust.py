from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from thruster_baselines.mapping import (
    AttitudeUncertainty,
    ChanceConstrainedMapper,
    ConicRobustMapper,
    LPMapper,
    RobustAllocation,
    RobustCommandMapper,
    RobustEffectivenessMapper,
)
from thruster_envs.spacecraft import load

# three axes for two thrusters, as in the source's example
pytestmark = pytest.mark.filterwarnings("ignore::thruster_baselines.mapping.model.LostDirectionsWarning")

ORION = load("orion")
ONE_DEGREE = math.radians(1.0)
DIAGONAL = np.array([-0.027, -0.027, 0.0, 0.0, 0.0, 0.0])  # the first command of Yang 2003's rendezvous
TOY = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, 1.0]])  # Yang 2003, section 3.3
TOY_COMMAND = np.array([3.0, 1.0, 3.0])

ROBUST_MAPPERS = [
    partial(RobustCommandMapper, below=1e-4, above=3e-4),
    partial(RobustEffectivenessMapper, relative=0.1),
    partial(RobustEffectivenessMapper, relative=0.1, largest_miss=True),
    partial(ConicRobustMapper, spread=0.1),
    partial(ChanceConstrainedMapper, standard_deviation=0.1),
]


def commands_of(count: int, seed: int, reach: float = 1.0) -> np.ndarray:
    """Commands to Orion, up to so many times what each axis alone can do; some hardly anything."""
    rng = np.random.default_rng(seed)
    sizes = reach * rng.choice([1e-4, 0.05, 0.3, 1.0], (count, 1))
    return rng.uniform(-1.0, 1.0, (count, 6)) * ORION.authority() * sizes


def random_problem(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Effectiveness, command, fuel and slack costs, and longest on-times, all of order one."""
    m, n = int(rng.integers(2, 6)), int(rng.integers(2, 9))
    return (
        rng.normal(size=(m, n)) * (rng.random((m, n)) < 0.8),
        rng.normal(size=m) * 3.0,
        rng.uniform(0.0, 2.0, n),
        rng.uniform(0.0, 50.0, m),
        rng.uniform(0.5, 5.0, n),
    )


def linear_program(
    upper: np.ndarray,
    lower: np.ndarray,
    high: np.ndarray,
    low: np.ndarray,
    fuel_cost: np.ndarray,
    slack_cost: np.ndarray,
    max_on_time: np.ndarray,
    largest_miss: bool = False,
) -> float:
    """The least cost with `upper x - S <= low` and `high - S <= lower x` row by row, or one S for all."""
    price = slack_cost if largest_miss else np.ones_like(slack_cost)
    slack = -np.ones((len(low), 1)) if largest_miss else -np.eye(len(low))
    answer = linprog(
        np.concatenate([fuel_cost, np.ones(1) if largest_miss else slack_cost]),
        A_ub=np.block([[price[:, np.newaxis] * upper, slack], [price[:, np.newaxis] * -lower, slack]]),
        b_ub=np.concatenate([price * low, price * -high]),
        bounds=[(0.0, bound) for bound in max_on_time] + [(0.0, None)] * slack.shape[1],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert answer.status == 0
    return float(answer.fun)


# What is common to all


@pytest.mark.parametrize("build", ROBUST_MAPPERS)
def test_slack_is_nominal_and_the_cost_counts_the_worst_miss(build):
    mapper = build(ORION)
    effectiveness = ORION.effectiveness()
    effectiveness[:, 2] *= 0.4
    commands = commands_of(20, seed=0)
    answer = mapper(commands, effectiveness=effectiveness)
    assert isinstance(answer, RobustAllocation)
    assert answer.worst_miss.shape == commands.shape
    achieved = answer.on_times @ effectiveness.T
    np.testing.assert_allclose(answer.slack, commands - achieved, rtol=1e-9, atol=1e-15)
    assert (answer.worst_miss >= np.abs(answer.slack) * (1.0 - 1e-12)).all()
    priced = answer.worst_miss * mapper.slack_cost
    count = np.max if build.keywords.get("largest_miss") else np.sum
    fuel = answer.on_times @ mapper.fuel_cost
    np.testing.assert_allclose(answer.cost, fuel + count(priced, axis=1), rtol=1e-12)


# The command in a box


def test_robust_command_is_the_linear_program_of_the_source():
    rng = np.random.default_rng(1)
    for _ in range(60):
        effectiveness, command, fuel_cost, slack_cost, bounds = random_problem(rng)
        low = command - rng.uniform(0.0, 2.0, command.size)
        high = command + rng.uniform(0.0, 2.0, command.size)
        mapper = RobustCommandMapper(effectiveness, bounds, fuel_cost, slack_cost, fuel_may_win=True)
        answer = mapper.within(low, high)
        literal = linear_program(effectiveness, effectiveness, high, low, fuel_cost, slack_cost, bounds)
        assert answer.cost == pytest.approx(literal, rel=1e-8, abs=1e-9)
        achieved = effectiveness @ answer.on_times
        np.testing.assert_allclose(answer.worst_miss, np.maximum(achieved - low, high - achieved), atol=1e-12)
        np.testing.assert_allclose(answer.slack, (low + high) / 2.0 - achieved, atol=1e-12)


def test_robust_command_within_reach_is_the_middle_of_the_interval():
    low, high = 0.1 * DIAGONAL, DIAGONAL + 0.5 * np.abs(DIAGONAL)
    low, high = np.minimum(low, high), np.maximum(low, high)
    answer = RobustCommandMapper(ORION).within(low, high)
    np.testing.assert_allclose(ORION.effectiveness() @ answer.on_times, (low + high) / 2.0, atol=1e-15)
    np.testing.assert_allclose(answer.worst_miss, (high - low) / 2.0, atol=1e-15)


def test_symmetric_uncertainty_of_the_command_changes_nothing():
    commands = commands_of(200, seed=2)
    margin = 0.1 * ORION.authority()
    plain = LPMapper(ORION)(commands)
    robust = RobustCommandMapper(ORION, below=margin, above=margin)(commands)
    np.testing.assert_allclose(robust.on_times, plain.on_times, atol=1e-10)
    np.testing.assert_allclose(robust.worst_miss, np.abs(plain.slack) + margin, atol=1e-12)


def test_skewed_uncertainty_of_the_command_is_answered_nearer_to_the_truth():
    # the truth is even in its interval; misses are in shares of what an axis can do
    rng = np.random.default_rng(3)
    authority = ORION.authority()
    commands = rng.uniform(-0.3, 0.3, (2000, 6)) * authority
    below, above = 0.02 * authority, 0.1 * authority
    truth = commands + rng.uniform(-below, above, commands.shape)
    plain = LPMapper(ORION)(commands)
    robust = RobustCommandMapper(ORION, below=below, above=above)(commands)
    achieved = (mapper.on_times @ ORION.effectiveness().T for mapper in (plain, robust))
    of_plain, of_robust = (np.abs((truth - rates) / authority).mean() for rates in achieved)
    # Closed forms: a truth even in [-1, 5] is on average 13/6 from 0, and 3/2 from the middle.
    assert of_robust / of_plain == pytest.approx((3.0 / 2.0) / (13.0 / 6.0), rel=0.03)
    worst_of_plain = np.maximum(below - plain.slack, above + plain.slack)
    assert (robust.worst_miss <= worst_of_plain + 1e-12).all()
    np.testing.assert_allclose((robust.worst_miss / worst_of_plain).max(), 0.6, rtol=1e-9)  # 3 : 5


def test_candidates_stand_for_the_smallest_box_that_holds_them():
    candidates = commands_of(5, seed=4).reshape(5, 1, 6) + commands_of(3, seed=5)
    mapper = RobustCommandMapper(ORION)
    answer = mapper.among(candidates)
    assert answer.on_times.shape == (3, 12)
    boxed = mapper.within(candidates.min(axis=0), candidates.max(axis=0))
    assert (answer.on_times == boxed.on_times).all()
    achieved = answer.on_times @ ORION.effectiveness().T
    np.testing.assert_allclose(answer.worst_miss, np.abs(candidates - achieved).max(axis=0), atol=1e-12)
    # a call overrides the model here too
    dead = ORION.effectiveness()
    dead[:, 0] = 0.0
    assert (mapper.among(candidates, effectiveness=dead).on_times[:, 0] == 0.0).all()
    assert (mapper.within(-DIAGONAL, -DIAGONAL, max_on_time=np.ones(12)).on_times <= 1.0).all()


# Attitude uncertainty


def test_attitude_uncertainty_of_the_source():
    equal = AttitudeUncertainty(half_widths=ONE_DEGREE, equal_angles=True, small_angles=True)
    low, high = equal.interval(DIAGONAL)
    b = DIAGONAL[:3]
    deviation = ONE_DEGREE * np.abs([b[1] - b[2], b[2] - b[0], b[0] - b[1]])
    np.testing.assert_allclose(high - DIAGONAL, [*deviation, 0.0, 0.0, 0.0], atol=1e-16)
    np.testing.assert_allclose(DIAGONAL - low, [*deviation, 0.0, 0.0, 0.0], atol=1e-16)
    np.testing.assert_allclose(deviation, [4.71e-4, 4.71e-4, 0.0], atol=5e-7)
    # angles that are independent turn the command out of its plane too
    low, high = AttitudeUncertainty(half_widths=ONE_DEGREE, small_angles=True).interval(DIAGONAL)
    np.testing.assert_allclose(high - DIAGONAL, [*(ONE_DEGREE * np.array([0.027, 0.027, 0.054])), 0, 0, 0])


def test_a_rotation_command_is_turned_as_a_translation_is():
    for uncertainty in (
        AttitudeUncertainty(half_widths=(0.01, 0.02, 0.03), bias=(0.0, 0.05, 0.0)),
        AttitudeUncertainty(half_widths=0.02, equal_angles=True),
        AttitudeUncertainty(half_widths=(0.01, 0.02, 0.03), small_angles=True),
    ):
        v, w = np.random.default_rng(6).normal(size=(2, 4, 3))
        low, high = uncertainty.interval(np.concatenate([v, w], axis=1))
        for half, triplet in ((slice(0, 3), v), (slice(3, 6), w)):
            expected = uncertainty.interval(triplet)
            np.testing.assert_array_equal(low[:, half], expected[0])
            np.testing.assert_array_equal(high[:, half], expected[1])
        samples = uncertainty.samples(np.concatenate([v, v], axis=1), 20, seed=1)
        np.testing.assert_array_equal(samples[..., :3], samples[..., 3:])  # one error for both


@pytest.mark.parametrize(
    "uncertainty",
    [
        AttitudeUncertainty(half_widths=ONE_DEGREE, small_angles=True),
        AttitudeUncertainty(half_widths=(0.01, 0.0, 0.03), bias=(0.01, -0.02, 0.0), small_angles=True),
        AttitudeUncertainty(half_widths=0.1, equal_angles=True, small_angles=True),
        AttitudeUncertainty(half_widths=ONE_DEGREE),
        AttitudeUncertainty(half_widths=(0.3, 0.6, 0.9), bias=(0.2, 0.0, -0.3)),
        AttitudeUncertainty(half_widths=0.5, bias=0.1, equal_angles=True),
    ],
)
def test_sampled_attitudes_fill_the_closed_form_from_inside(uncertainty):
    commands = np.random.default_rng(7).normal(size=(4, 6))
    low, high = uncertainty.interval(commands)
    filled = []
    for count in (100, 1000, 30000):
        least, most = uncertainty.sampled_interval(commands, count, seed=3)
        assert (least >= low - 1e-12).all()
        assert (most <= high + 1e-12).all()
        filled.append((most - least) / (high - low))
    assert (filled[0] <= filled[1]).all()
    assert (filled[1] <= filled[2]).all()  # more draws begin with the same ones
    assert filled[2].min() > 0.93
    assert filled[2].mean() > filled[0].mean()


def test_exact_attitude_intervals_are_reached_and_not_exceeded():
    def rotation(angles: np.ndarray) -> np.ndarray:
        """Rx(phi) Ry(theta) Rz(psi), turning the frame, factor by factor as the source prints it."""
        (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
        about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
        about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        about_z = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
        return about_x @ about_y @ about_z

    rng = np.random.default_rng(8)
    for _ in range(6):
        half_widths, bias = rng.uniform(0.0, 1.0, 3), rng.uniform(-0.3, 0.3, 3)
        uncertainty = AttitudeUncertainty(half_widths=tuple(half_widths), bias=tuple(bias))
        ends = [(b - h, b + h) for b, h in zip(bias, half_widths, strict=True)]
        grid = np.array(list(itertools.product(*(np.linspace(*end, 7) for end in ends))))
        rotations = np.array([rotation(angles) for angles in grid])
        for command in (*rng.normal(size=(2, 3)), np.array([0.0, 1.0, 1e-3])):
            low, high = uncertainty.interval(command)
            for sign, extreme in ((1.0, high), (-1.0, -low)):
                values = sign * rotations @ command
                for k in range(3):
                    climbed = minimize(
                        lambda angles, k=k, sign=sign, b=command: -sign * (rotation(angles) @ b)[k],
                        grid[values[:, k].argmax()],
                        bounds=ends,
                        tol=1e-14,
                    )
                    best = max(-climbed.fun, values[:, k].max())
                    assert extreme[k] == pytest.approx(best, abs=1e-10)


@pytest.mark.parametrize("equal_angles", [False, True])
def test_attitude_that_is_known_leaves_a_command_as_it_is(equal_angles):
    commands = np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(22).normal(size=(5, 3))])
    low, high = AttitudeUncertainty(half_widths=0.0, equal_angles=equal_angles).interval(commands)
    np.testing.assert_allclose(low, commands, atol=1e-15)
    np.testing.assert_allclose(high, commands, atol=1e-15)
    # a quarter turn to either side about z alone lets each of two axes take all of the other
    half_turn = AttitudeUncertainty(half_widths=(0.0, 0.0, math.pi / 2.0))
    low, high = half_turn.interval([0.0, 1.0, 0.5])
    np.testing.assert_allclose(low, [-1.0, 0.0, 0.5], atol=1e-15)
    np.testing.assert_allclose(high, [1.0, 1.0, 0.5], atol=1e-15)


def test_plain_linear_program_is_the_robust_optimum_for_one_degree_of_attitude():
    # Yang 2003, section 6.3: +/- 1 degree in each angle without bias
    commands = commands_of(200, seed=9)
    plain = LPMapper(ORION)(commands)
    for equal in (True, False):
        attitude = AttitudeUncertainty(half_widths=ONE_DEGREE, equal_angles=equal, small_angles=True)
        robust = RobustCommandMapper(ORION, attitude=attitude)(commands)
        np.testing.assert_allclose(robust.on_times, plain.on_times, atol=1e-9)
        low, high = attitude.interval(commands)
        np.testing.assert_allclose(robust.worst_miss, np.abs(plain.slack) + (high - low) / 2.0, atol=1e-12)
    # Turns that are not taken as small move the middle, in the second order.
    low, high = AttitudeUncertainty(half_widths=ONE_DEGREE).interval(commands)
    size = np.linalg.norm(commands.reshape(-1, 2, 3), axis=2).repeat(3, axis=1)
    moved = np.abs((low + high) / 2.0 - commands) / size
    assert 0.1 * ONE_DEGREE**2 < moved.max() < 1.5 * ONE_DEGREE**2  # |(1, 1, 1)|^2 / 2 degrees squared


# The effectiveness, column by column


def test_toy_example_of_the_source():
    for largest_miss in (False, True):
        mapper = RobustEffectivenessMapper(
            TOY, max_on_time=5.0, slack_cost=1e3, relative=0.1, largest_miss=largest_miss
        )
        answer = mapper(TOY_COMMAND)
        np.testing.assert_allclose(answer.on_times, [1.0, 2.0], atol=1e-9)
        np.testing.assert_allclose(answer.worst_miss, [0.3, 0.3, 0.3], atol=1e-9)
    np.testing.assert_allclose(LPMapper(TOY, max_on_time=5.0)(TOY_COMMAND).on_times, [1.0, 2.0], atol=1e-12)


@pytest.mark.parametrize("largest_miss", [False, True])
def test_robust_effectiveness_is_the_linear_program_of_the_source(largest_miss):
    rng = np.random.default_rng(10)
    for _ in range(60):
        effectiveness, command, fuel_cost, slack_cost, bounds = random_problem(rng)
        below, above = rng.uniform(0.0, 0.5, (2, *effectiveness.shape))
        lower, upper = effectiveness - below, effectiveness + above
        mapper = RobustEffectivenessMapper(
            effectiveness, bounds, fuel_cost, slack_cost,
            lower=lower, upper=upper, largest_miss=largest_miss, fuel_may_win=True,
        )  # fmt: skip
        answer = mapper(command)
        literal = linear_program(
            upper, lower, command, command, fuel_cost, slack_cost, bounds, largest_miss=largest_miss
        )
        assert answer.cost == pytest.approx(literal, rel=1e-7, abs=1e-8)
        too_much, too_little = upper @ answer.on_times - command, command - lower @ answer.on_times
        np.testing.assert_allclose(answer.worst_miss, np.maximum(too_much, too_little), atol=1e-12)


def test_no_admissible_effectiveness_misses_by_more_than_stated_and_some_miss_by_as_much():
    rng = np.random.default_rng(11)
    nominal = ORION.effectiveness()
    answer = RobustEffectivenessMapper(ORION, relative=0.1)(commands_of(50, seed=11))
    commands = answer.slack + answer.on_times @ nominal.T
    drawn = nominal * (1.0 + rng.uniform(-0.1, 0.1, (300, 1, 12)))  # a column errs as a whole
    misses = np.abs(commands - np.einsum("smn,bn->sbm", drawn, answer.on_times))
    assert (misses <= answer.worst_miss + 1e-12).all()
    for axis in range(6):
        for sign in (1.0, -1.0):
            # the thrusters that push this axis one way too strong, the others too weak
            worst = nominal * (1.0 + 0.1 * sign * np.sign(nominal[axis]))
            misses = np.maximum(misses, np.abs(commands - answer.on_times @ worst.T))
    np.testing.assert_allclose(misses.max(axis=0), answer.worst_miss, atol=1e-12)


@pytest.mark.parametrize("share", [0.1, 0.99])
def test_equal_shares_below_one_on_one_sign_leave_the_plain_linear_program(share):
    # Row by row p y + |y - b| is least at y = b; slack so dear that this is worth its fuel.
    rng = np.random.default_rng(12)
    for sign in (1.0, -1.0):
        effectiveness = sign * rng.uniform(0.2, 1.0, (3, 8))
        costs = rng.uniform(1.0, 1.2, 8), 1e5
        commands = rng.uniform(0.0, 1.0, (100, 8)) @ effectiveness.T
        plain = LPMapper(effectiveness, 1.0, *costs)(commands)
        robust = RobustEffectivenessMapper(effectiveness, 1.0, *costs, relative=share)(commands)
        np.testing.assert_allclose(plain.slack, 0.0, atol=1e-12)
        np.testing.assert_allclose(robust.on_times, plain.on_times, atol=1e-8)
        np.testing.assert_allclose(robust.worst_miss, share * np.abs(commands), atol=1e-12)


def test_shares_above_one_fire_nothing():
    rng = np.random.default_rng(13)
    effectiveness = rng.uniform(0.2, 1.0, (3, 8))
    commands = rng.uniform(0.0, 1.0, (100, 8)) @ effectiveness.T
    answer = RobustEffectivenessMapper(effectiveness, 1.0, slack_cost=1e5, relative=1.2)(commands)
    assert (answer.on_times == 0.0).all()
    np.testing.assert_array_equal(answer.worst_miss, commands)


def test_plain_linear_program_is_the_robust_optimum_for_ten_percent_of_thrust():
    # Yang 2003, section 6.3: each firing of Orion's thrusters is within 10 %
    commands = commands_of(500, seed=14, reach=2.0)
    plain = LPMapper(ORION)(commands)
    robust = RobustEffectivenessMapper(ORION, relative=0.1)
    spread = 0.1 * np.abs(ORION.effectiveness())
    cost_of_plain = plain.cost + plain.on_times @ spread.T @ robust.slack_cost
    np.testing.assert_allclose(robust(commands).cost, cost_of_plain, rtol=1e-12)
    # Not so for any share: one that errs by half costs as much as it brings.
    dearer = RobustEffectivenessMapper(ORION, relative=0.5)(commands).cost
    assert (dearer < plain.cost + 5.0 * plain.on_times @ spread.T @ robust.slack_cost - 1e-6).any()


def test_an_inexact_thruster_is_spared():
    # -z by the pair 2 and 5, as long as both are exact
    command = [0.0, 0.0, -0.003, 0.0, 0.0, 0.0]
    shares = np.zeros(12)
    shares[1] = 0.5
    assert LPMapper(ORION)(command).on_times[1] == pytest.approx(0.5)
    robust = RobustEffectivenessMapper(ORION, relative=shares)(command)
    assert robust.on_times[1] == 0.0
    np.testing.assert_allclose(robust.slack, 0.0, atol=1e-12)
    np.testing.assert_allclose(robust.worst_miss, 0.0, atol=1e-12)


def test_shares_go_with_the_effectiveness_of_each_problem_and_distances_stay():
    rng = np.random.default_rng(15)
    nominal = ORION.effectiveness()
    gains = rng.uniform(0.0, 1.0, (4, 1, 12))
    shares = rng.uniform(0.0, 0.3, 12)
    commands = commands_of(4, seed=15)
    bounds = np.full(12, 5.0)
    for mapper, spread in (
        (RobustEffectivenessMapper(ORION, relative=shares), shares * np.abs(nominal) * gains),
        (
            RobustEffectivenessMapper(
                ORION, lower=nominal - np.abs(nominal) * shares, upper=nominal + np.abs(nominal) * shares
            ),
            np.broadcast_to(shares * np.abs(nominal), (4, 6, 12)),
        ),
    ):
        answer = mapper(commands, effectiveness=nominal * gains)
        for i in range(4):
            own = nominal * gains[i]
            alone = linear_program(
                own + spread[i], own - spread[i], commands[i], commands[i],
                mapper.fuel_cost, mapper.slack_cost, bounds,
            )  # fmt: skip
            assert answer.cost[i] == pytest.approx(alone, rel=1e-7)


# The effectiveness, row by row


def least_by_cutting_planes(mapper: ConicRobustMapper, command: np.ndarray, factors: np.ndarray) -> float:
    """A lower bound of the conic optimum: HiGHS with tangents to the cones, until they hold to 1e-9."""
    m, n = mapper.effectiveness.shape
    columns = n + 2 * m  # on-times, misses of the nominal effectiveness, lengths
    rows = [np.hstack([sign * mapper.effectiveness, -np.eye(m), np.zeros((m, m))]) for sign in (1.0, -1.0)]
    limits = [command, -command]
    cost = np.concatenate([mapper.fuel_cost, mapper.slack_cost, mapper.slack_cost])
    options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    for _ in range(60):
        answer = linprog(
            cost, A_ub=np.vstack(rows), b_ub=np.concatenate(limits), method="highs", options=options,
            bounds=[(0.0, bound) for bound in mapper.max_on_time] + [(0.0, None)] * (2 * m),
        )  # fmt: skip
        assert answer.status == 0
        parts = np.einsum("knr,n->kr", factors, answer.x[:n])
        lengths = np.linalg.norm(parts, axis=1)
        if (lengths <= answer.x[n + m :] + 1e-9).all():
            break
        cuts = np.zeros((m, columns))
        for k in np.flatnonzero(lengths > 0.0):
            cuts[k, :n] = factors[k] @ parts[k] / lengths[k]
        cuts[:, n + m :] = -np.eye(m)
        rows.append(cuts)
        limits.append(np.zeros(m))
    return float(answer.fun)


def test_conic_optimum_is_that_of_cutting_planes():
    rng = np.random.default_rng(16)
    for _ in range(8):
        effectiveness, command, fuel_cost, slack_cost, bounds = random_problem(rng)
        factors = rng.normal(size=(*effectiveness.shape, 3)) * 0.2
        mapper = ConicRobustMapper(
            effectiveness, bounds, fuel_cost, slack_cost, factors=factors, fuel_may_win=True
        )
        answer = mapper(command)
        least = least_by_cutting_planes(mapper, command, factors)
        assert answer.status == 0
        assert answer.cost == pytest.approx(least, rel=1e-6)
        lengths = np.linalg.norm(np.einsum("knr,n->kr", factors, answer.on_times), axis=1)
        np.testing.assert_allclose(answer.worst_miss, np.abs(answer.slack) + lengths, rtol=1e-12)


def test_no_row_within_its_ellipsoid_misses_by_more_and_one_misses_by_as_much():
    rng = np.random.default_rng(17)
    factors = rng.normal(size=(6, 12, 4)) * 0.1 * np.abs(ORION.effectiveness()).max(axis=1)[:, None, None]
    command = commands_of(1, seed=17)[0]
    answer = ConicRobustMapper(ORION, factors=factors)(command)
    directions = rng.normal(size=(500, 6, 4))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    along = np.einsum("knr,n->kr", factors, answer.on_times)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    rows = ORION.effectiveness() + np.einsum("knr,skr->skn", factors, directions)
    assert (np.abs(command - rows @ answer.on_times) <= answer.worst_miss * (1.0 + 1e-12)).all()
    worst = [
        np.abs(
            command
            - (ORION.effectiveness() + sign * np.einsum("knr,kr->kn", factors, along)) @ answer.on_times
        )
        for sign in (1.0, -1.0)
    ]
    np.testing.assert_allclose(np.maximum(*worst), answer.worst_miss, rtol=1e-12)


def test_conic_mapper_without_spread_is_the_plain_linear_program():
    commands = commands_of(30, seed=18)
    np.testing.assert_allclose(
        ConicRobustMapper(ORION, spread=0.0)(commands).cost, LPMapper(ORION)(commands).cost, rtol=1e-5
    )


def test_an_ellipsoid_along_one_thruster_is_an_interval():
    spread = np.zeros((6, 12))
    spread[np.arange(6), [0, 5, 1, 2, 4, 8]] = 0.3 * np.abs(ORION.effectiveness()).max(axis=1)
    commands = commands_of(30, seed=19)
    nominal = ORION.effectiveness()
    conic = ConicRobustMapper(ORION, spread=spread)(commands)
    box = RobustEffectivenessMapper(ORION, lower=nominal - spread, upper=nominal + spread)(commands)
    np.testing.assert_allclose(conic.cost, box.cost, rtol=1e-5)


def test_ellipsoids_ask_for_less_than_the_boxes_around_them():
    commands = commands_of(30, seed=20)
    conic = ConicRobustMapper(ORION, spread=0.1)(commands)
    box = RobustEffectivenessMapper(ORION, relative=0.1)(commands)
    assert (conic.cost <= box.cost * (1.0 + 1e-6)).all()
    assert (conic.cost < 0.95 * box.cost).mean() > 0.5
    # and stated in units of the effectiveness it is the same
    absolute = ConicRobustMapper(ORION, spread=0.1 * np.abs(ORION.effectiveness()))(commands)
    np.testing.assert_allclose(absolute.cost, conic.cost, rtol=1e-9)


def test_conic_shares_go_with_the_effectiveness_of_the_call():
    halved = 0.5 * ORION.effectiveness()
    command = 0.3 * DIAGONAL
    by_call = ConicRobustMapper(ORION, spread=0.1)(command, effectiveness=halved)
    own = ConicRobustMapper(
        halved, 5.0, slack_cost=ConicRobustMapper(ORION, spread=0.1).slack_cost, spread=0.1
    )
    np.testing.assert_allclose(by_call.cost, own(command).cost, rtol=1e-9)
    np.testing.assert_allclose(by_call.worst_miss, own(command).worst_miss, rtol=1e-6, atol=1e-9)


def test_what_need_not_fire_does_not_fire_at_all():
    answer = ConicRobustMapper(ORION, spread=0.1)(DIAGONAL)
    assert set(np.flatnonzero(answer.on_times) + 1) == {1, 6, 10, 12}
    saturated = ConicRobustMapper(ORION, spread=0.1)(3.0 * DIAGONAL)
    assert (saturated.on_times[[0, 9]] == 5.0).all()


# Gaussian columns


def exceeded(
    mapper: ChanceConstrainedMapper, command: np.ndarray, sigma: np.ndarray, draws: int
) -> np.ndarray:
    """Whether each axis missed by more than stated, (draws, m), for Gaussian thrusters."""
    answer = mapper(command)
    rng = np.random.default_rng(21)
    gains = 1.0 + sigma * rng.standard_normal((draws, mapper.effectiveness.shape[1]))
    achieved = (gains * answer.on_times) @ mapper.effectiveness.T
    return np.abs(command - achieved) > answer.worst_miss


def test_stated_probability_holds_and_is_not_vacuous():
    draws = 100_000
    sigma = np.linspace(0.02, 0.15, 12)
    for probability in (0.8, 0.95, 0.99):
        mapper = ChanceConstrainedMapper(ORION, standard_deviation=sigma, probability=probability)
        tolerance = 4.0 * math.sqrt(probability * (1.0 - probability) / draws)
        rates = exceeded(mapper, 0.5 * DIAGONAL + 0.1 * ORION.authority(), sigma, draws).mean(axis=0)
        # every axis is met on average: the probability is exact
        np.testing.assert_allclose(rates, 1.0 - probability, atol=tolerance)
        # axes x and y out of reach by far: half of what may exceed does
        rates = exceeded(mapper, 3.0 * DIAGONAL, sigma, draws).mean(axis=0)
        np.testing.assert_allclose(rates[:2], (1.0 - probability) / 2.0, atol=tolerance)


def test_joint_probability_holds_over_all_axes():
    draws = 100_000
    sigma = np.full(12, 0.1)
    command = 0.2 * ORION.authority()
    for joint, least, most in ((True, 0.95, 1.0), (False, 0.0, 0.95)):
        mapper = ChanceConstrainedMapper(ORION, standard_deviation=0.1, joint=joint)
        held = 1.0 - exceeded(mapper, command, sigma, draws).any(axis=1).mean()
        tolerance = 4.0 * math.sqrt(0.95 * 0.05 / draws)
        assert least - tolerance <= held < most - tolerance
    # an equal part of the failure to each axis
    joint = ChanceConstrainedMapper(ORION, standard_deviation=0.1, probability=0.95, joint=True)
    single = ChanceConstrainedMapper(ORION, standard_deviation=0.1, probability=1.0 - 0.05 / 6.0)
    assert joint.quantile == pytest.approx(single.quantile, rel=1e-12)


def test_more_certainty_costs_more():
    costs = [
        float(ChanceConstrainedMapper(ORION, standard_deviation=0.1, probability=p)(DIAGONAL).cost)
        for p in (0.5, 0.8, 0.95, 0.999)
    ]
    assert costs == sorted(costs)
    assert costs[0] < 0.5 * costs[-1]


# Bad input


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: RobustCommandMapper(ORION, below=-0.1), r"below on axis 0 is -0\.1; a finite number"),
        (
            lambda: RobustCommandMapper(ORION, above=[0.1] * 5),
            r"above has the shape \(5,\); one number or \(6,\)",
        ),
        (
            lambda: RobustCommandMapper(TOY[:2], 5.0, attitude=AttitudeUncertainty(half_widths=0.1)),
            "attitude is given for 2 axes; 3 or 6",
        ),
        (
            lambda: RobustCommandMapper(ORION).within(DIAGONAL, DIAGONAL - 1e-3),
            r"low on axis 0 is -0\.027; at most high, -0\.028, would be right",
        ),
        (
            lambda: RobustCommandMapper(ORION).within([0.0] * 5, DIAGONAL),
            r"low has the shape \(5,\); \(\.\.\., 6\)",
        ),
        (lambda: RobustCommandMapper(ORION).among(np.zeros((0, 6))), r"candidates has the shape \(0, 6\)"),
        (lambda: RobustCommandMapper(ORION).among([[np.nan] * 6]), "candidates on axis 0 is nan"),
        (lambda: RobustEffectivenessMapper(ORION), "relative is missing, and so are lower and upper"),
        (lambda: RobustEffectivenessMapper(TOY, 5.0, relative=0.1, lower=TOY), "are both given; one of them"),
        (
            lambda: RobustEffectivenessMapper(ORION, relative=[-0.1] + [0.1] * 11),
            r"relative of thruster 1 is -0\.1",
        ),
        (
            lambda: RobustEffectivenessMapper(ORION, relative=np.ones((6, 12))),
            r"relative has the shape \(6, 12\)",
        ),
        (
            lambda: RobustEffectivenessMapper(TOY, 5.0, lower=TOY + np.array([0.0, 0.1])),
            r"lower of thruster 2 on axis 0 is 1\.1; a finite number, at most the effectiveness 1, would be",
        ),
        (
            lambda: RobustEffectivenessMapper(TOY, 5.0, upper=TOY - 0.1),
            "at least the effectiveness 1, would be",
        ),
        (lambda: ConicRobustMapper(ORION), "spread and factors are both missing"),
        (lambda: ConicRobustMapper(ORION, spread=0.1, factors=np.ones((6, 12, 1))), "are both given"),
        (
            lambda: ConicRobustMapper(ORION, spread=[0.1, 0.2]),
            r"spread has the shape \(2,\); one number, \(12,\)",
        ),
        (lambda: ConicRobustMapper(ORION, factors=np.ones((6, 12))), r"factors has the shape \(6, 12\)"),
        (
            lambda: ConicRobustMapper(TOY, 5.0, factors=[[[0.1], [np.inf]]] * 3),
            "factors of thruster 2 on axis 0 is inf in column 0",
        ),
        (
            lambda: ChanceConstrainedMapper(ORION, standard_deviation=0.1, probability=1.0),
            r"probability is 1\.0; a number between 0 and 1",
        ),
        (
            lambda: ChanceConstrainedMapper(TOY, 5.0, standard_deviation=np.full((3, 2), np.nan)),
            "standard_deviation of thruster 1 on axis 0 is nan",
        ),
        (lambda: AttitudeUncertainty(half_widths=-0.1), r"half_widths on axis 0 is -0\.1 rad; zero or more"),
        (lambda: AttitudeUncertainty(half_widths=(0.1, np.nan, 0.1)), "half_widths on axis 1 is nan rad"),
        (
            lambda: AttitudeUncertainty(half_widths=1.0, bias=0.6),
            r"on axis 0 reach 1\.6 rad; at most a quarter",
        ),
        (lambda: AttitudeUncertainty(half_widths=(0.1, 0.2, 0.1), equal_angles=True), "one number each"),
        (lambda: AttitudeUncertainty(half_widths=(0.1, 0.2)), r"half_widths has the shape \(2,\)"),
        (lambda: AttitudeUncertainty(half_widths=0.1).interval(np.zeros(4)), r"command has the shape \(4,\)"),
        (
            lambda: AttitudeUncertainty(half_widths=0.1).samples(np.zeros(3), 0, seed=0),
            "count is 0; one or more",
        ),
    ],
)
def test_bad_input_gets_one_clear_line(build, message):
    with pytest.raises(ValueError, match=message):
        build()
