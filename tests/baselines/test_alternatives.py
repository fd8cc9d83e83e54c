from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import nnls

from thruster_baselines.mapping import (
    LPMapper,
    MinimumNormShiftMapper,
    NonNegativeLeastSquaresMapper,
    NullSpaceMapper,
    PseudoInverseMapper,
    QuadraticMapper,
    RedistributedPseudoInverseMapper,
    non_negative,
)
from thruster_baselines.mapping.null_space import disjoint_null_vectors
from thruster_envs.spacecraft import load

ORION, SPHERES = load("orion"), load("spheres")
# Valdes 2008, eq. 3.36
PPT = 5e-6 * np.array([[1.0, -1, 0, 0, 0, 0], [0, 0, 1, -1, 0, 0], [0, 0, 0, 0, 1, -1]])
BOUNDED = partial(NonNegativeLeastSquaresMapper, bounded=True)
ALTERNATIVES = [
    RedistributedPseudoInverseMapper,
    NonNegativeLeastSquaresMapper,
    BOUNDED,
    QuadraticMapper,
    NullSpaceMapper,
]


def commands_of(spacecraft, count: int, seed: int) -> np.ndarray:
    """Commands from hardly anything to far beyond the authority, half of them on some axes only."""
    rng = np.random.default_rng(seed)
    sizes = rng.choice([1e-4, 0.1, 0.5, 2.0], (count, 1))
    axes = rng.random((count, 6)) < rng.choice([0.4, 1.0], (count, 1))
    return rng.normal(size=(count, 6)) * axes * sizes * spacecraft.authority()


def random_problem(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Effectiveness (m, n), command (m,), longest on-times (n,), of order one; thrusters may be lost."""
    m, n = int(rng.integers(2, 7)), int(rng.integers(1, 13))
    effectiveness = rng.normal(size=(m, n)) * (rng.random((m, n)) < rng.choice([0.3, 1.0]))
    effectiveness[:, 0] = rng.normal(size=m)
    bounds = rng.uniform(0.2, 3.0, n) * (rng.random(n) < 0.9)
    return effectiveness, rng.normal(size=m) * rng.choice([0.1, 3.0]), bounds


def weighed(effectiveness: np.ndarray) -> np.ndarray:
    """The weight of each axis, one over its largest effectiveness."""
    return 1.0 / np.abs(effectiveness).max(axis=1)


def projected_gradient(
    gradient: np.ndarray, on_times: np.ndarray, max_on_time: np.ndarray | float
) -> np.ndarray:
    """What of the gradient a step within the bounds could still descend along; zero at the optimum."""
    at_zero, at_bound = on_times <= 0.0, on_times >= max_on_time
    pushing = np.where(at_zero, np.minimum(gradient, 0.0), gradient)
    return np.where(at_bound & ~at_zero, np.maximum(pushing, 0.0), np.where(at_bound, 0.0, pushing))


@pytest.mark.parametrize("mapper_class", ALTERNATIVES)
def test_nothing_commanded_fires_nothing(mapper_class):
    for spacecraft in (ORION, SPHERES):
        allocation = mapper_class(spacecraft)(np.zeros(6))
        assert (allocation.on_times == 0.0).all()
        assert allocation.cost == 0.0
        assert allocation.status == 0


@pytest.mark.parametrize("mapper_class", ALTERNATIVES)
def test_a_dead_thruster_never_fires(mapper_class):
    effectiveness = ORION.effectiveness()
    effectiveness[:, 4] = 0.0
    on_times = mapper_class(ORION)(commands_of(ORION, 200, seed=0), effectiveness=effectiveness).on_times
    assert (on_times[:, 4] == 0.0).all()
    assert on_times.any(axis=0).sum() == 11


@pytest.mark.parametrize("mapper_class", [RedistributedPseudoInverseMapper, BOUNDED, QuadraticMapper])
def test_a_thruster_that_may_not_fire_is_a_dead_thruster(mapper_class):
    mapper, commands = mapper_class(ORION), commands_of(ORION, 100, seed=1)
    effectiveness, bounds = ORION.effectiveness(), mapper.max_on_time.copy()
    effectiveness[:, 3] = 0.0
    bounds[3] = 0.0
    dead, barred = mapper(commands, effectiveness=effectiveness), mapper(commands, max_on_time=bounds)
    np.testing.assert_allclose(dead.on_times, barred.on_times, atol=1e-9)


@pytest.mark.parametrize("mapper_class", ALTERNATIVES)
def test_commands_at_an_axis_that_nothing_serves_leave_the_others_alone(mapper_class):
    effectiveness = ORION.effectiveness()
    effectiveness[2] = 0.0
    command = np.array([0.003, 0.0, 0.0, 0.01, 0.0, 0.0])
    mapper = mapper_class(ORION)
    plain = mapper(command, effectiveness=effectiveness)
    beside = mapper(command + 0.001 * np.eye(6)[2], effectiveness=effectiveness)
    np.testing.assert_allclose(beside.on_times, plain.on_times, atol=1e-9)
    assert plain.on_times.any()
    assert beside.slack[2] == 0.001


@pytest.mark.filterwarnings("ignore:effectiveness has rank")
@pytest.mark.parametrize("mapper_class", ALTERNATIVES)
def test_on_times_are_numbers_within_their_bounds_whatever_the_scales(mapper_class):
    rng = np.random.default_rng(25)
    for _ in range(200):
        effectiveness, command, bounds = random_problem(rng)
        effectiveness *= 10.0 ** rng.uniform(-6.0, 0.0, (len(command), 1))
        effectiveness *= 10.0 ** rng.uniform(-6.0, 0.0, len(bounds))
        command *= 10.0 ** rng.choice([-308.0, -9.0, 0.0, 3.0])
        bounds[rng.random(len(bounds)) < 0.2] = np.inf
        allocation = mapper_class(effectiveness, bounds)(command)
        assert np.isfinite(allocation.on_times).all()
        assert (allocation.on_times >= 0.0).all()
        assert (allocation.on_times <= bounds).all()
        assert np.isfinite(allocation.cost)
        assert allocation.status == 0


class TestRedistributedPseudoInverse:
    @pytest.mark.filterwarnings("ignore:effectiveness has rank")
    def test_each_round_is_the_pseudo_inverse_of_the_thrusters_that_are_free(self):
        rng = np.random.default_rng(2)
        rounds_taken = set()
        for _ in range(1000):
            effectiveness, command, bounds = random_problem(rng)
            n = bounds.size
            if not effectiveness.any(axis=1).all():
                continue
            weights = weighed(effectiveness)
            matrix, wanted = weights[:, np.newaxis] * effectiveness, weights * command
            free, expected = bounds > 0.0, np.zeros(n)
            rounds = 0
            while True:
                rest = wanted - matrix @ np.where(free, 0.0, expected)
                expected[free] = np.linalg.pinv(matrix[:, free], rcond=1e-10) @ rest
                saturated = free & ((expected < -1e-12) | (expected > bounds + 1e-12))
                expected = np.clip(expected, 0.0, bounds)
                if not saturated.any():
                    break
                free &= ~saturated
                rounds += 1
            rounds_taken.add(rounds)
            mapper = RedistributedPseudoInverseMapper(effectiveness, bounds)
            np.testing.assert_allclose(mapper(command).on_times, expected, atol=1e-8)
        assert rounds_taken >= {0, 1, 2, 3}

    def test_open_thrusters_are_the_least_squares_solution_of_what_the_others_leave(self):
        commands = commands_of(ORION, 300, seed=3)
        allocation = RedistributedPseudoInverseMapper(ORION)(commands)
        weights = weighed(ORION.effectiveness())
        matrix = weights[:, np.newaxis] * ORION.effectiveness()
        for command, on_times in zip(commands, allocation.on_times, strict=True):
            part = (on_times > 0.0) & (on_times < 5.0)
            rest = weights * command - matrix @ np.where(part, 0.0, on_times)
            expected = np.linalg.lstsq(matrix[:, part], rest)[0]
            np.testing.assert_allclose(on_times[part], expected, rtol=1e-9, atol=1e-9)
        assert (allocation.on_times == 5.0).any()

    def test_orion_is_tracked_for_a_third_of_small_commands_and_spheres_for_all(self):
        def share_tracked(spacecraft) -> float:
            commands = np.random.default_rng(4).normal(size=(2000, 6)) * spacecraft.authority() * 0.05
            missed = RedistributedPseudoInverseMapper(spacecraft)(commands).slack / spacecraft.authority()
            return float((np.abs(missed).max(axis=1) < 1e-12).mean())

        # On SPHERES the thrusters fixed in the first round are those that the command has no use for.
        assert share_tracked(SPHERES) == 1.0
        assert 0.25 < share_tracked(ORION) < 0.45

    def test_fixed_thrusters_stay_fixed_although_they_could_help(self):
        # Least squares wants the first thruster negative and too much of the second. Once the second stands
        # at its bound, the first would have to help, but is not asked again.
        effectiveness, command, bounds = [[1.0, 2.0], [2.0, 1.0]], [3.0, 0.0], [5.0, 0.5]
        redistributed = RedistributedPseudoInverseMapper(effectiveness, bounds)(command)
        closest = BOUNDED(effectiveness, bounds)(command)
        np.testing.assert_array_equal(redistributed.on_times, [0.0, 0.5])
        np.testing.assert_allclose(closest.on_times, [0.2, 0.5], atol=1e-12)  # 5 u = (1, 2) . (2, -0.5)

    def test_round_off_opens_and_fixes_no_thruster(self):
        # Each axis of Orion asks for eight thrusters at most; the other four stand at zero but for round-off.
        mapper = RedistributedPseudoInverseMapper(ORION)
        for axis in range(6):
            for sign in (-1.0, 1.0):
                allocation = mapper(sign * 0.3 * np.eye(6)[axis] * ORION.authority())
                assert (allocation.on_times > 0.0).sum() == (2 if axis < 3 else 4)
                np.testing.assert_allclose(allocation.slack, 0.0, atol=1e-15)

    def test_threads_do_not_change_the_answer(self):
        commands = commands_of(ORION, 1000, seed=5)
        one = RedistributedPseudoInverseMapper(ORION, threads=1)(commands)
        three = RedistributedPseudoInverseMapper(ORION, threads=3)(commands)
        alone = [RedistributedPseudoInverseMapper(ORION)(command).on_times for command in commands[:50]]
        assert (one.on_times == three.on_times).all()
        assert (one.on_times[:50] == alone).all()
        with pytest.raises(ValueError, match="threads is 0; one or more"):
            RedistributedPseudoInverseMapper(ORION, threads=0)


class TestNonNegativeLeastSquares:
    def test_without_bounds_no_thruster_wants_to_change(self):
        commands = commands_of(ORION, 200, seed=6)
        allocation = NonNegativeLeastSquaresMapper(ORION, max_on_time=np.inf)(commands)
        weights = weighed(ORION.effectiveness())
        gradient = -np.square(weights) * allocation.slack @ ORION.effectiveness()
        left = projected_gradient(gradient, allocation.on_times, np.inf)
        np.testing.assert_allclose(left / np.linalg.norm(weights * commands, axis=1).max(), 0.0, atol=1e-12)
        assert ((allocation.on_times > 0.0).sum(axis=1) <= 6).all()  # a vertex

    def test_what_is_too_long_is_cut_off(self):
        commands = commands_of(ORION, 100, seed=7)
        unlimited = NonNegativeLeastSquaresMapper(ORION, max_on_time=np.inf)(commands)
        limited = NonNegativeLeastSquaresMapper(ORION)(commands)
        np.testing.assert_array_equal(limited.on_times, np.minimum(unlimited.on_times, 5.0))
        assert (unlimited.on_times > 5.0).any()

    @pytest.mark.parametrize("dead", [None, 1, 8])
    def test_bounded_is_the_closest_that_thrusters_can_come(self, dead):
        effectiveness = ORION.effectiveness()
        if dead is not None:
            effectiveness[:, dead - 1] = 0.0
        commands = commands_of(ORION, 200, seed=8)
        bounds = np.random.default_rng(9).uniform(1.0, 5.0, 12)
        allocation = BOUNDED(ORION)(commands, effectiveness=effectiveness, max_on_time=bounds)
        weights = weighed(effectiveness)
        gradient = -np.square(weights) * allocation.slack @ effectiveness
        left = projected_gradient(gradient, allocation.on_times, bounds)
        size = np.linalg.norm(weights * commands, axis=1, keepdims=True)
        assert (np.abs(left) <= 1e-10 * size).all()
        assert (allocation.on_times == bounds).any()
        assert (allocation.status == 0).all()
        np.testing.assert_allclose(
            allocation.cost, np.linalg.norm(weights * allocation.slack, axis=1), rtol=1e-9, atol=1e-13
        )

    def test_none_of_the_others_comes_closer_than_bounded(self):
        commands, weights = commands_of(ORION, 200, seed=10), weighed(ORION.effectiveness())
        least = BOUNDED(ORION)(commands).cost
        clearly = 0
        for other in (*ALTERNATIVES, LPMapper, PseudoInverseMapper, MinimumNormShiftMapper):
            miss = np.linalg.norm(weights * other(ORION)(commands).slack, axis=1)
            assert (miss >= least - 1e-12).all()
            clearly += int((miss > least + 1e-3).any())
        assert clearly >= 7  # all but itself

    @pytest.mark.filterwarnings("ignore:effectiveness has rank")
    def test_bounded_agrees_with_the_unbounded_method_in_a_larger_space(self):
        # u <= U is u + v = U with v >= 0, an equation that a large enough weight enforces.
        rng = np.random.default_rng(11)
        for _ in range(100):
            effectiveness, command, bounds = random_problem(rng)
            if not effectiveness.any(axis=1).all():
                continue
            n, weights = bounds.size, weighed(effectiveness)
            heavy = 1e5 * np.eye(n)
            matrix = np.block(
                [[weights[:, np.newaxis] * effectiveness, np.zeros_like(effectiveness)], [heavy, heavy]]
            )
            least = nnls(matrix, np.concatenate([weights * command, 1e5 * bounds]), maxiter=1000)[1]
            assert BOUNDED(effectiveness, bounds)(command).cost == pytest.approx(least, rel=1e-5, abs=1e-5)

    def test_a_method_that_runs_out_of_iterations_says_so(self, monkeypatch):
        commands = commands_of(ORION, 200, seed=24)
        solved = BOUNDED(ORION)(commands)
        assert (solved.status == 0).all()
        monkeypatch.setattr(non_negative, "_ITERATIONS", 1)
        stopped = BOUNDED(ORION)(commands)
        worse = stopped.cost > solved.cost * (1.0 + 1e-9) + 1e-9
        assert worse.any()
        assert (stopped.status[worse] == 1).all()
        with pytest.raises(
            RuntimeError, match="did not end within 1 iterations; columns of the effectiveness"
        ):
            NonNegativeLeastSquaresMapper(ORION)(commands)


class TestQuadratic:
    @pytest.mark.parametrize("fuel_cost", [1.0, np.linspace(0.5, 30.0, 12), 0.0])
    def test_no_thruster_wants_to_change(self, fuel_cost):
        # Karush, Kuhn and Tucker: the gradient is zero for a free thruster, or pushes it on to its bound.
        commands = commands_of(ORION, 200, seed=12)
        effectiveness = ORION.effectiveness() * np.random.default_rng(13).uniform(0.0, 1.0, (200, 1, 12))
        bounds = np.random.default_rng(14).uniform(0.0, 5.0, (200, 12))
        mapper = QuadraticMapper(ORION, fuel_cost=fuel_cost, fuel_may_win=True)
        allocation = mapper(commands, effectiveness=effectiveness, max_on_time=bounds)
        assert (allocation.status == 0).all()
        miss = mapper.slack_cost * allocation.slack
        gradient = np.square(mapper.fuel_cost) * allocation.on_times - np.einsum(
            "bk,bkj->bj", mapper.slack_cost * miss, effectiveness
        )
        at_rest = np.abs(np.einsum("bk,bkj->bj", np.square(mapper.slack_cost) * commands, effectiveness))
        left = projected_gradient(gradient, allocation.on_times, bounds)
        size = np.maximum(at_rest.max(axis=1, keepdims=True), np.finfo(float).tiny)
        assert (np.abs(left) <= 1e-9 * size).all()
        assert (allocation.on_times == bounds).any()
        expected = np.square(miss).sum(axis=1) + np.square(mapper.fuel_cost * allocation.on_times).sum(axis=1)
        np.testing.assert_allclose(allocation.cost, expected, rtol=1e-12, atol=1e-15)

    def test_one_thruster_in_closed_form(self):
        mapper = QuadraticMapper([[0.5]], max_on_time=4.0, fuel_cost=0.25, slack_cost=2.0)
        # d/du of (2 (T - u / 2))^2 + (u / 4)^2 is zero at u = 2 T / (1 + 1 / 16)
        np.testing.assert_allclose(mapper([1.0]).on_times, [32.0 / 17.0], rtol=1e-12)
        assert mapper([-1.0]).on_times == 0.0
        assert mapper([9.0]).on_times == 4.0

    def test_what_is_left_of_a_command_falls_with_the_square_of_the_price_of_a_miss(self):
        command = [0.01, -0.005, 0.0, 0.05, 0.0, -0.1]
        slack = [
            np.abs(QuadraticMapper(ORION, slack_cost=factor * LPMapper(ORION).slack_cost)(command).slack)
            for factor in (1.0, 10.0)
        ]
        np.testing.assert_allclose(slack[1] * 100.0, slack[0], rtol=1e-2)
        assert (slack[0] > 0.0).all()
        assert (slack[0] / ORION.authority() < 1e-3).all()

    def test_twins_share_where_the_linear_program_takes_one(self):
        twins = [[1.0, 1.0, -1.0]]
        assert sorted(LPMapper(twins, 5.0)([4.0]).on_times) == [0.0, 0.0, 4.0]
        on_times = QuadraticMapper(twins, 5.0)([4.0]).on_times
        assert on_times[0] == pytest.approx(on_times[1], rel=1e-9)
        assert on_times[2] == 0.0

    def test_the_answer_follows_the_command_without_jumps_where_vertices_change_by_jumps(self):
        rng = np.random.default_rng(15)
        start, end = rng.normal(size=(2, 6)) * ORION.authority() * 0.2

        def largest_step(mapper_class, steps: int) -> float:
            way = np.linspace(0.0, 1.0, steps + 1)[:, np.newaxis]
            on_times = mapper_class(ORION)((1.0 - way) * start + way * end).on_times
            return float(np.abs(np.diff(on_times, axis=0)).max())

        for smooth in (QuadraticMapper, NullSpaceMapper):
            assert largest_step(smooth, 3000) == pytest.approx(largest_step(smooth, 300) / 10.0, rel=0.2)
        # Orion's equal thrusters make vertices that are equally cheap; rounds fix a thruster or do not.
        for jumping in (LPMapper, RedistributedPseudoInverseMapper):
            assert largest_step(jumping, 3000) > 0.5

    def test_costs_at_which_fuel_would_win_are_refused(self):
        with pytest.raises(
            ValueError, match="slack_cost of axis 0 is 100 while serving that axis costs up to"
        ):
            QuadraticMapper(ORION, slack_cost=[100.0, 1e4, 1e4, 1e4, 1e4, 1e4])


class TestNullSpace:
    def test_plasma_thrusters_fire_the_one_of_each_pair_that_points_that_way(self):
        torques = 2e-5 * np.random.default_rng(17).normal(size=(500, 3))
        mapper = NullSpaceMapper(PPT, max_on_time=np.inf)
        on_times = mapper(torques).on_times
        np.testing.assert_allclose(on_times[:, 0::2], np.maximum(torques, 0.0) / 5e-6, rtol=1e-12)
        np.testing.assert_allclose(on_times[:, 1::2], np.maximum(-torques, 0.0) / 5e-6, rtol=1e-12)
        np.testing.assert_array_equal(
            mapper.null_vectors, [[1, 1, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0], [0, 0, 0, 0, 1, 1]]
        )

    def test_on_spheres_it_is_the_pair_mixer_of_the_flight_code(self):
        mapper = NullSpaceMapper(SPHERES, max_on_time=np.inf)
        commands = commands_of(SPHERES, 300, seed=18)
        force = SPHERES.mass * commands[:, :3]
        torque = np.diag(SPHERES.inertia) * commands[:, 3:]
        arm, thrust = 0.0965, 0.112
        mixed = np.empty((len(commands), 6))
        for axis, about in ((0, 1), (1, 2), (2, 0)):
            mixed[:, 2 * axis] = force[:, axis] / 2.0 + torque[:, about] / (2.0 * arm)
            mixed[:, 2 * axis + 1] = force[:, axis] / 2.0 - torque[:, about] / (2.0 * arm)
        on_times = mapper(commands).on_times
        np.testing.assert_allclose(on_times[:, :6], np.maximum(mixed, 0.0) / thrust, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(on_times[:, 6:], np.maximum(-mixed, 0.0) / thrust, rtol=1e-9, atol=1e-12)
        # two thrusters to a pair and six pairs for six axes leave one way to do it
        np.testing.assert_allclose(
            on_times, LPMapper(SPHERES, max_on_time=np.inf)(commands).on_times, rtol=1e-9, atol=1e-11
        )

    def test_groups_of_orion_are_those_along_each_axis(self):
        groups = [(np.flatnonzero(vector) + 1).tolist() for vector in NullSpaceMapper(ORION).null_vectors]
        assert groups == [[1, 4, 7, 10], [2, 5, 8, 11], [3, 6, 9, 12]]
        np.testing.assert_allclose(NullSpaceMapper(ORION).null_vectors.sum(axis=0), 1.0, rtol=1e-9)

    def test_orion_is_tracked_for_fuel_between_the_linear_program_and_the_single_shift(self):
        commands = np.random.default_rng(19).normal(size=(500, 6)) * ORION.authority() * 0.05
        allocation = NullSpaceMapper(ORION)(commands)
        np.testing.assert_allclose(allocation.slack / ORION.authority(), 0.0, atol=1e-12)
        assert (allocation.cost >= LPMapper(ORION)(commands).cost * (1.0 - 1e-12)).all()
        assert (allocation.cost <= MinimumNormShiftMapper(ORION)(commands).cost * (1.0 + 1e-12)).all()
        for group in NullSpaceMapper(ORION).null_vectors > 0.0:
            assert (allocation.on_times[:, group].min(axis=1) == 0.0).all()

    def test_partners_of_a_dead_thruster_are_left_with_what_minimum_norm_gives_them(self):
        effectiveness = ORION.effectiveness()
        effectiveness[:, 0] = 0.0
        commands = np.random.default_rng(20).normal(size=(500, 6)) * ORION.authority() * 0.05
        mapper = NullSpaceMapper(ORION)
        allocation = mapper(commands, effectiveness=effectiveness)
        clipped = PseudoInverseMapper(ORION)(commands, effectiveness=effectiveness)
        partners = [3, 6, 9]  # 4, 7, 10
        np.testing.assert_allclose(
            allocation.on_times[:, partners], clipped.on_times[:, partners], atol=1e-11
        )
        # so it tracks where that happens to be positive, and hardly ever else
        balanced = commands @ np.linalg.pinv(effectiveness).T
        lucky = (balanced[:, partners] >= 0.0).all(axis=1)
        tracked = np.abs(allocation.slack / ORION.authority()).max(axis=1) < 1e-12
        assert (tracked == lucky).all()
        assert 0.05 < tracked.mean() < 0.2

    def test_null_vectors_found_cancel_share_no_thruster_and_have_no_smaller_ones_inside(self):
        rng = np.random.default_rng(21)
        found = 0
        for _ in range(200):
            m, n = int(rng.integers(1, 5)), int(rng.integers(1, 12))
            effectiveness = (
                rng.normal(size=(m, n)) * rng.choice([1.0, 1e-3], (m, 1)) * rng.uniform(0.1, 2.0, n)
            )
            vectors = disjoint_null_vectors(effectiveness)
            assert vectors.shape == (n // 2, n)
            vectors = vectors[vectors.any(axis=1)]
            left = np.abs(effectiveness @ vectors.T) / (np.abs(effectiveness) @ vectors.T)
            assert (left < 1e-9).all()
            assert ((vectors > 0.0).sum(axis=0) <= 1).all()
            for vector in vectors:
                columns = effectiveness[:, vector > 0.0] * weighed(effectiveness)[:, np.newaxis]
                assert np.linalg.matrix_rank(columns) == columns.shape[1] - 1
                assert vector[vector > 0.0].min() == 1.0
            found += len(vectors)
        assert found > 200

    def test_a_group_is_found_whatever_the_thrust_of_its_members(self):
        gains = np.random.default_rng(22).uniform(0.01, 1.0, (50, 1, 12))
        together = disjoint_null_vectors(ORION.effectiveness() * gains)
        for vectors, gain in zip(together, gains[:, 0], strict=True):
            shares = vectors[:3] * gain  # of what each thruster gives
            for axis, group in enumerate(([0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 11])):
                np.testing.assert_allclose(shares[axis, group], shares[axis, group[0]], rtol=1e-9)
                assert (vectors[axis, group] > 0.0).all()
            assert (vectors[3:] == 0.0).all()

    def test_null_vectors_that_are_given_are_used_as_far_as_they_cancel(self):
        # Thrusters 1, 4 and 3, 6 of Orion push against each other and turn it opposite ways about z.
        crosswise = np.zeros((1, 12))
        crosswise[0, [0, 3, 2, 5]] = 2.0
        mapper = NullSpaceMapper(ORION, null_vectors=crosswise)
        np.testing.assert_array_equal(mapper.null_vectors, crosswise)
        command = 0.05 * np.random.default_rng(23).normal(size=6) * ORION.authority()
        balanced = np.linalg.pinv(ORION.effectiveness()) @ command
        expected = balanced.copy()
        expected[[0, 3, 2, 5]] -= balanced[[0, 3, 2, 5]].min()
        np.testing.assert_allclose(mapper(command).on_times, np.maximum(expected, 0.0), atol=1e-12)
        weakened = ORION.effectiveness()
        weakened[:, 3] *= 0.5
        np.testing.assert_allclose(
            mapper(command, effectiveness=weakened).on_times,
            PseudoInverseMapper(ORION)(command, effectiveness=weakened).on_times,
            atol=1e-12,
        )

    @pytest.mark.parametrize(
        ("null_vectors", "message"),
        [
            ([1.0, 1.0], r"null_vectors has the shape \(2,\); \(groups, 6\) would be right"),
            ([[1.0, 1.0, 0, 0, 0]], r"null_vectors has the shape \(1, 5\)"),
            ([[1, 1, 0, 0, 0, 0], [0, 0, -1.0, 1, 0, 0]], r"null_vectors of group 1 is -1\.0 for thruster 3"),
            ([[1, np.nan, 0, 0, 0, 0]], r"null_vectors of group 0 is nan for thruster 2"),
            (
                [[1, 1, 0, 0, 0, 0], [1, 1, 1, 1, 0, 0]],
                "null_vectors of groups 0 and 1 share thruster 1; each thruster in one group",
            ),
            (
                [[1, 2, 0, 0, 0, 0]],
                r"null_vectors of group 0 gives the rate change \[-5e-06, 0\.0, 0\.0\]; a proportion",
            ),
        ],
    )
    def test_null_vectors_that_are_none_are_refused(self, null_vectors, message):
        with pytest.raises(ValueError, match=message):
            NullSpaceMapper(PPT, 1.0, null_vectors=null_vectors)
