"""Thrusters with a shortest pulse: the best pulses, and what is carried over from command to command."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from thruster_baselines.mapping import (
    CarryingMapper,
    LPMapper,
    MinimumPulseMapper,
    PulsedAllocation,
    SchmittTriggerMapper,
    TruncatingMapper,
    minimum_pulses,
)
from thruster_baselines.mapping.minimum_pulse import UNPROVEN
from thruster_baselines.mapping.model import LostDirectionsWarning
from thruster_envs.protocols import MapperWithMemory
from thruster_envs.spacecraft import load

ORION, SPHERES = load("orion"), load("spheres")
COUPLE = np.array([[1.0, -1.0]])  # two opposed thrusters on one axis


class Problem(NamedTuple):
    """One mapping problem with a shortest pulse for each thruster."""

    command: np.ndarray
    effectiveness: np.ndarray
    minimum_pulse: np.ndarray
    max_on_time: np.ndarray
    fuel_cost: np.ndarray
    slack_cost: np.ndarray

    def solve(self, **settings: float) -> PulsedAllocation:
        mapper = MinimumPulseMapper(
            self.effectiveness, self.minimum_pulse, self.max_on_time, self.fuel_cost, self.slack_cost,
            fuel_may_win=True, **settings,
        )  # fmt: skip
        answer = mapper(self.command)
        assert isinstance(answer, PulsedAllocation)
        return answer

    def objective(self, on_times: np.ndarray) -> float:
        slack = self.command - self.effectiveness @ on_times
        return float(self.fuel_cost @ on_times + self.slack_cost @ np.abs(slack))


def random_problem(rng: np.random.Generator, axes: int, thrusters: int) -> Problem:
    """A problem of numbers of order one, in which the shortest pulses matter."""
    effectiveness = rng.normal(size=(axes, thrusters))
    minimum_pulse = rng.uniform(0.0, 0.6, thrusters)
    wanted = rng.uniform(0.0, 1.2, thrusters) * (rng.random(thrusters) < 0.6)
    return Problem(
        effectiveness @ wanted + rng.normal(size=axes) * rng.choice([0.0, 0.3]),
        effectiveness,
        minimum_pulse,
        rng.uniform(0.3, 1.5, thrusters),
        rng.uniform(0.5, 2.0, thrusters),
        rng.uniform(0.3, 30.0, axes),
    )


def mixed_integer_optimum(problem: Problem, resolution: float | None = None) -> float:
    """The least cost by HiGHS: a switch for each thruster, and clock ticks if there is a resolution.

    Its own on-times are cleaned of the tolerances of its switches, so that no cost comes out too low.
    """
    m, n = problem.effectiveness.shape
    tick = 1.0 if resolution is None else resolution
    eye, none = np.eye(n), np.zeros((n, 2 * m))
    most = problem.max_on_time / tick
    if resolution is not None:
        most = np.floor(most)  # HiGHS calls worse answers optimal if an integer's bound is not whole
    rows = np.vstack(
        [
            np.hstack([tick * problem.effectiveness, np.zeros((m, n)), np.eye(m), -np.eye(m)]),
            np.hstack([tick * eye, -np.diag(problem.max_on_time), none]),
            np.hstack([tick * eye, -np.diag(problem.minimum_pulse), none]),
        ]
    )
    low = np.concatenate([problem.command, np.full(n, -np.inf), np.zeros(n)])
    high = np.concatenate([problem.command, np.zeros(n), np.full(n, np.inf)])
    answer = milp(
        np.concatenate([tick * problem.fuel_cost, np.zeros(n), problem.slack_cost, problem.slack_cost]),
        integrality=np.concatenate([np.full(n, resolution is not None), np.ones(n), np.zeros(2 * m)]),
        bounds=Bounds(0.0, np.concatenate([most, np.ones(n), np.full(2 * m, np.inf)])),
        constraints=LinearConstraint(rows, low, high),
        options={"mip_rel_gap": 0.0},
    )
    assert answer.status == 0
    use = np.round(answer.x[n : 2 * n])
    on_times = tick * (answer.x[:n] if resolution is None else np.round(answer.x[:n]))
    on_times = use * np.clip(
        on_times, np.minimum(problem.minimum_pulse, problem.max_on_time), problem.max_on_time
    )
    assert problem.objective(on_times) == pytest.approx(answer.fun, rel=1e-5)
    return problem.objective(on_times)


def require_possible(problem: Problem, on_times: np.ndarray) -> None:
    """Every on-time is one that the valve can give."""
    assert (on_times >= 0.0).all()
    assert (on_times <= problem.max_on_time).all()
    assert ((on_times == 0.0) | (on_times >= problem.minimum_pulse)).all()


# The best pulses for one command


def test_no_mixed_integer_solver_finds_better_pulses():
    rng = np.random.default_rng(0)
    searched = 0
    for _ in range(160):
        axes = int(rng.integers(1, 7))
        problem = random_problem(rng, axes, axes + int(rng.integers(0, 6)))
        answer = problem.solve()
        assert answer.status == 0
        require_possible(problem, answer.on_times)
        assert float(answer.cost) == pytest.approx(problem.objective(answer.on_times), rel=1e-12)
        referee = mixed_integer_optimum(problem)
        assert float(answer.cost) == pytest.approx(referee, rel=1e-8)
        searched += answer.nodes > 1
    assert searched > 80  # the linear program alone would not have done


def test_the_best_of_all_patterns_of_open_thrusters_is_found(highs_optimum):
    rng = np.random.default_rng(1)
    for _ in range(25):
        problem = random_problem(rng, 3, 5)
        best = np.inf
        for pattern in itertools.product([False, True], repeat=5):
            use = np.array(pattern) & (problem.minimum_pulse <= problem.max_on_time)
            least = np.where(use, problem.minimum_pulse, 0.0)
            room = np.where(use, problem.max_on_time - least, 0.0)
            rest = highs_optimum(
                problem.command - problem.effectiveness @ least,
                problem.effectiveness, room, problem.fuel_cost, problem.slack_cost,
            )  # fmt: skip
            best = min(best, rest + problem.fuel_cost @ least)
        assert float(problem.solve().cost) == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("resolution", [0.05, 0.11])
def test_clock_ticks_are_chosen_as_an_integer_program_would(resolution):
    rng = np.random.default_rng(2)
    for _ in range(25):
        problem = random_problem(rng, 2, 4)
        answer = problem.solve(resolution=resolution)
        ticks = answer.on_times / resolution
        np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-12)
        require_possible(problem, answer.on_times)
        assert answer.status == 0
        assert float(answer.cost) == pytest.approx(mixed_integer_optimum(problem, resolution), rel=1e-8)


def test_pulses_and_periods_that_are_whole_ticks_in_decimals_are_possible():
    # 0.3 / 0.1 is below 3 and 0.7 / 0.1 below 7 in binary
    mapper = MinimumPulseMapper([[1.0]], 0.3, max_on_time=0.7, resolution=0.1)
    assert mapper([0.3]).on_times.tolist() == pytest.approx([0.3], rel=1e-15)
    assert mapper([2.0]).on_times.tolist() == [0.7]
    narrow = MinimumPulseMapper([[1.0]], 0.3, max_on_time=0.3, resolution=0.1)
    assert narrow([2.0]).on_times.tolist() == [0.3]


@pytest.mark.parametrize("spacecraft", [ORION, SPHERES])
def test_without_a_minimum_pulse_it_is_the_linear_program_to_the_last_bit(spacecraft):
    commands = np.random.default_rng(3).normal(size=(300, 6)) * spacecraft.authority()
    answer, plain = MinimumPulseMapper(spacecraft, 0.0)(commands), LPMapper(spacecraft)(commands)
    assert (answer.on_times == plain.on_times).all()
    assert (answer.nodes == 1).all()


def test_a_command_below_the_shortest_pulse_is_given_by_opposed_thrusters_or_missed():
    # With price K of a miss and 1 of firing, the couple costs x + 2 * 0.01, a miss K x.
    for price, wanted in itertools.product((2.0, 5.0, 100.0), np.linspace(1e-4, 0.0099, 12)):
        mapper = MinimumPulseMapper(COUPLE, 0.01, max_on_time=1.0, slack_cost=price)
        alone = 0.01 + price * (0.01 - wanted)  # one pulse, which is too long
        least = min(wanted + 0.02, price * wanted, alone)
        assert float(mapper([wanted]).cost) == pytest.approx(least, rel=1e-12)


def test_a_thruster_that_may_not_fire_for_a_minimum_pulse_stays_shut():
    bounds = np.full(12, 5.0)
    bounds[[0, 9]] = 0.09
    commands = np.random.default_rng(4).normal(size=(200, 6)) * ORION.authority() * 0.2
    answer = MinimumPulseMapper(ORION, 0.1)(commands, max_on_time=bounds)
    assert (answer.on_times[:, [0, 9]] == 0.0).all()
    assert (answer.on_times[:, 1:9] > 0.0).any()


def test_a_batch_gives_the_bits_of_single_commands_in_any_number_of_threads():
    rng = np.random.default_rng(5)
    commands = rng.normal(size=(1500, 6)) * SPHERES.authority() * 0.02
    matrices = SPHERES.effectiveness() * rng.uniform(0.5, 1.0, (1500, 1, 12))
    mapper = MinimumPulseMapper(SPHERES, threads=1)
    together = mapper(commands, effectiveness=matrices)
    shared = MinimumPulseMapper(SPHERES, threads=3)(commands, effectiveness=matrices)
    assert (together.on_times == shared.on_times).all()
    assert together.nodes.max() > 50
    for i in range(0, 1500, 97):
        alone = mapper(commands[i], effectiveness=matrices[i])
        assert (alone.on_times == together.on_times[i]).all()
        assert alone.nodes == together.nodes[i]


def test_unbounded_on_times_are_searched_as_long_ones_are():
    commands = np.random.default_rng(6).normal(size=(100, 6)) * SPHERES.authority() * 0.05
    unbounded = MinimumPulseMapper(SPHERES, max_on_time=np.inf)(commands)
    long = MinimumPulseMapper(SPHERES, max_on_time=100.0)(commands)
    np.testing.assert_allclose(unbounded.cost, long.cost, rtol=1e-10)
    assert np.isfinite(unbounded.on_times).all()


def test_an_answer_whose_search_was_cut_off_says_so_and_can_still_be_flown():
    commands = np.random.default_rng(7).normal(size=(100, 6)) * SPHERES.authority() * 0.02
    best = MinimumPulseMapper(SPHERES)(commands)
    cut = MinimumPulseMapper(SPHERES, max_nodes=3)(commands)
    assert (best.status == 0).all()
    assert (cut.nodes <= 3).all()
    assert (cut.status == UNPROVEN).mean() > 0.5
    assert (cut.cost >= best.cost * (1.0 - 1e-9)).all()
    assert ((cut.on_times == 0.0) | (cut.on_times >= 0.01)).all()
    np.testing.assert_allclose(cut.slack, commands - cut.on_times @ SPHERES.effectiveness().T, atol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spacecraft": COUPLE, "max_on_time": 1.0}, "minimum_pulse is missing"),
        ({"spacecraft": ORION, "minimum_pulse": [0.1] * 11}, r"minimum_pulse has the shape \(11,\); \(12,\)"),
        (
            {"spacecraft": ORION, "minimum_pulse": [0.1] * 11 + [np.nan]},
            "minimum_pulse of thruster 12 is nan s",
        ),
        ({"spacecraft": ORION, "minimum_pulse": -0.1}, r"minimum_pulse of thruster 1 is -0\.1 s"),
        ({"spacecraft": ORION, "resolution": 0.0}, r"resolution is 0\.0 s; a positive number"),
        ({"spacecraft": ORION, "max_nodes": 0}, "max_nodes is 0; one or more"),
    ],
)
def test_a_pulse_mapper_that_makes_no_sense_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        MinimumPulseMapper(**arguments)


# What is carried over


def carrying(worlds: int | None = None, limit: float | None = None) -> CarryingMapper:
    return CarryingMapper(TruncatingMapper(LPMapper(SPHERES), minimum_pulses(SPHERES)), worlds, limit=limit)


def pulsing(worlds: int | None = None) -> CarryingMapper:
    return CarryingMapper(MinimumPulseMapper(SPHERES, slack_cost=60.0), worlds)


def triggered(worlds: int | None = None) -> SchmittTriggerMapper:
    return SchmittTriggerMapper(LPMapper(SPHERES), minimum_pulses(SPHERES), open_at=0.02, worlds=worlds)


REMEMBERING = [carrying, pulsing, triggered]


def small_commands(steps: int, *worlds: int, seed: int = 0) -> np.ndarray:
    """Rate changes that ask most thrusters of SPHERES for less than a pulse, more often of one sign."""
    rng = np.random.default_rng(seed)
    on_times = rng.uniform(0.0, 0.008, (steps, *worlds, 12)) * (rng.random((steps, *worlds, 12)) < 0.4)
    on_times[..., 6:] *= 0.2
    return on_times @ SPHERES.effectiveness().T


def as_thruster_time(rate_change: np.ndarray) -> np.ndarray:
    """The longest single firing, s, that a rate change of SPHERES takes; its jets leave no choice."""
    return LPMapper(SPHERES, max_on_time=np.inf)(rate_change).on_times.max(axis=-1)


def test_carrying_keeps_the_error_of_500_small_commands_within_one_pulse_of_each_thruster():
    commands, effectiveness = small_commands(500), SPHERES.effectiveness()
    minimum = minimum_pulses(SPHERES)

    def flown(on_times):
        """Longest firing that would mend what went wrong so far; too short a pulse opens no valve."""
        opened = np.where(on_times >= minimum, on_times, 0.0)
        return as_thruster_time(np.cumsum(commands - opened @ effectiveness.T, axis=0)), opened.sum()

    asked = LPMapper(SPHERES)(commands).on_times
    lost, _ = flown(asked)
    assert lost[499] > 1.9 * lost[249] > 3.6 * lost[124]  # it grows with the number of commands
    assert lost[499] > 50 * minimum.max()
    carried, fuel = flown(carrying()(commands).on_times)
    assert carried.max() < minimum.max()
    assert fuel < asked.sum()  # and what is set off against each other is never fired
    assert flown(pulsing()(commands).on_times)[0].max() < minimum.max()
    # Thruster by thruster the error stays bounded too, at what is collected before a valve opens.
    assert flown(triggered()(commands).on_times)[0].max() < 0.02


def test_giving_each_small_command_at_once_takes_far_more_fuel_than_carrying_it():
    commands = small_commands(500)
    at_once = MinimumPulseMapper(SPHERES)(commands)
    later = carrying()
    fuel = later(commands).on_times.sum()
    assert at_once.on_times.sum() > 3.0 * fuel
    assert as_thruster_time(later.remainder) < 0.01


@pytest.mark.parametrize("build", REMEMBERING)
def test_the_remainder_is_what_was_commanded_minus_what_the_pulses_give(build):
    mapper, commands = build(), small_commands(200, seed=1)
    delivered = np.zeros(6)
    for step, command in enumerate(commands):
        answer = mapper(command)
        gives = SPHERES.effectiveness() @ answer.on_times
        np.testing.assert_allclose(answer.slack, command - gives, atol=1e-15)
        assert ((answer.on_times == 0.0) | (answer.on_times >= 0.01)).all()
        delivered += gives
        owed = commands[: step + 1].sum(axis=0) - delivered
        np.testing.assert_allclose(mapper.remainder, owed, atol=1e-13)


@pytest.mark.parametrize("build", REMEMBERING)
def test_craft_side_by_side_are_each_a_craft_of_its_own_to_the_last_bit(build):
    commands = small_commands(40, 5, seed=2)
    weak = SPHERES.effectiveness() * np.linspace(0.5, 1.0, 5)[:, np.newaxis, np.newaxis]
    together = build(worlds=5)
    answer = together(commands, effectiveness=weak)
    assert answer.on_times.shape == (40, 5, 12)
    for world in range(5):
        alone = build()
        for step in range(40):
            one = alone(commands[step, world], effectiveness=weak[world])
            assert (one.on_times == answer.on_times[step, world]).all()
            assert (one.slack == answer.slack[step, world]).all()
        assert (alone.remainder == together.remainder[world]).all()


@pytest.mark.parametrize("build", REMEMBERING)
def test_what_is_forgotten_is_owed_no_more_and_what_is_kept_is(build):
    mapper, commands = build(worlds=3), small_commands(10, 3, seed=3)
    assert isinstance(mapper, MapperWithMemory)
    mapper(commands)
    before = mapper.remainder
    assert (before != 0.0).any(axis=1).all()
    mapper.forget(np.array([False, True, False]))
    assert (mapper.remainder[1] == 0.0).all()
    assert (mapper.remainder[[0, 2]] == before[[0, 2]]).all()
    fresh = build(worlds=3)
    first, second = mapper(commands[0]), fresh(commands[0])
    assert (first.on_times[1] == second.on_times[1]).all()
    mapper.forget()
    assert (mapper(commands).on_times == build(worlds=3)(commands).on_times).all()


@pytest.mark.parametrize("build", REMEMBERING)
def test_a_saved_memory_is_gone_back_to(build):
    mapper, commands = build(worlds=2), small_commands(30, 2, seed=4)
    mapper(commands[:10])
    saved = mapper.save_state()
    kept = {name: array.copy() for name, array in saved.items()}
    first = mapper(commands[10:])
    assert all((saved[name] == kept[name]).all() for name in kept)
    mapper.restore_state(saved)
    assert (mapper(commands[10:]).on_times == first.on_times).all()
    other = build(worlds=2)
    other.restore_state(saved)
    assert (other(commands[10:]).on_times == first.on_times).all()
    with pytest.raises(ValueError, match=r"what was saved has the shapes .*\(2, .*would be right"):
        build(worlds=3).restore_state(saved)


@pytest.mark.parametrize("build", REMEMBERING)
def test_a_call_that_is_refused_changes_no_memory(build):
    mapper = build()
    mapper(small_commands(5))
    before = mapper.remainder
    for bad in (np.full(6, np.nan), np.zeros((2, 3, 6)), np.zeros(5)):
        with pytest.raises(ValueError, match="would be right"):
            mapper(bad)
    with pytest.raises(ValueError, match=r"a belief has the leading axes \(2,\); none would be right"):
        mapper(np.zeros((2, 6)), effectiveness=np.stack([SPHERES.effectiveness()] * 2))
    assert (mapper.remainder == before).all()
    mapper.remainder[:] = 7.0  # a copy
    assert (mapper.remainder == before).all()


def test_a_bounded_remainder_does_not_wind_up_on_an_axis_that_is_lost():
    dead = SPHERES.effectiveness()
    dead[:, [0, 1]] = 0.0  # nothing pushes along +x any more
    command = np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0])
    bounded, free = carrying(limit=0.5), carrying()
    for mapper in (bounded, free):
        mapper(np.tile(command, (200, 1)), effectiveness=dead)
    assert free.remainder[0] == pytest.approx(2.0, rel=1e-9)
    half = 0.5 * SPHERES.authority()[0]
    assert bounded.largest_remainder[0] == pytest.approx(half, rel=1e-12)
    assert bounded.remainder[0] == pytest.approx(half, rel=1e-12)
    bounded(-command, effectiveness=dead)  # it leaves the bound at once
    assert bounded.remainder[0] == pytest.approx(half - 0.01, rel=1e-9)


def test_a_bound_in_shares_of_authority_is_none_where_on_times_have_none_and_zero_where_nothing_acts():
    with pytest.warns(LostDirectionsWarning):
        inner = LPMapper([[1.0, -2.0], [0.0, 0.0]], max_on_time=np.inf)
    assert CarryingMapper(inner, limit=0.5).largest_remainder.tolist() == [np.inf, 0.0]
    assert CarryingMapper(inner, limit=0.0).largest_remainder.tolist() == [0.0, 0.0]
    bounded = CarryingMapper(LPMapper([[1.0, -2.0]], max_on_time=0.3), limit=0.5)
    assert bounded.largest_remainder.tolist() == pytest.approx([0.3])  # 2.0 for 0.3 s, half of it


def test_a_schmitt_trigger_opens_at_one_threshold_and_closes_at_another():
    asked = np.array([8.0, 8.0, 8.0, 8.0, 6.0, 4.0, 8.0, 8.0]) * 1e-3
    trigger = SchmittTriggerMapper(LPMapper(COUPLE, max_on_time=1.0), 0.005, open_at=0.02, close_at=0.006)
    # 8, 16, 24: opens; 8 and 6: stays open; 4: closes; 12: not yet; 20: opens again
    fired = [0.0, 0.0, 24e-3, 8e-3, 6e-3, 0.0, 0.0, 20e-3]
    np.testing.assert_allclose(trigger(asked[:, np.newaxis]).on_times[:, 0], fired, atol=1e-15)
    assert trigger.collected.tolist() == pytest.approx([0.0, 0.0], abs=1e-15)
    assert trigger.firing.tolist() == [True, False]


def test_a_schmitt_trigger_collects_no_more_than_its_threshold():
    rng = np.random.default_rng(8)
    trigger = SchmittTriggerMapper(LPMapper(SPHERES, max_on_time=0.2), 0.01, open_at=0.3, close_at=0.05)
    total_asked = np.zeros(12)
    total_fired = np.zeros(12)
    inner = LPMapper(SPHERES, max_on_time=0.2)
    for command in rng.normal(size=(300, 6)) * SPHERES.authority() * 0.2:
        bounds = rng.choice([0.0, 0.005, 0.1, 0.2], 12)
        able = bounds >= 0.01
        total_asked += inner(command, max_on_time=bounds).on_times * able
        on_times = trigger(command, max_on_time=bounds).on_times
        total_fired += on_times
        assert ((on_times == 0.0) | ((on_times >= 0.01) & (on_times <= bounds))).all()
        assert trigger.collected.max() < 0.3
    np.testing.assert_allclose(total_asked - total_fired, trigger.collected, atol=1e-12)
    assert (total_fired > 0.0).all()


def test_truncating_leaves_out_short_pulses_and_says_what_is_missing():
    commands = small_commands(100, seed=5) * 5.0
    asked, answer = LPMapper(SPHERES)(commands), TruncatingMapper(LPMapper(SPHERES), 0.01)(commands)
    long = asked.on_times >= 0.01
    assert 0.1 < long.mean() < 0.9
    assert (answer.on_times == np.where(long, asked.on_times, 0.0)).all()
    np.testing.assert_allclose(
        answer.slack, commands - answer.on_times @ SPHERES.effectiveness().T, atol=1e-15
    )
    np.testing.assert_allclose(answer.cost, answer.on_times.sum(axis=1), rtol=1e-15)
    beliefs = np.stack([SPHERES.effectiveness() * share for share in (1.0, 0.5)])
    for_each = TruncatingMapper(LPMapper(SPHERES), 0.01)(commands[0], effectiveness=beliefs)
    achieved = np.einsum("wmn,wn->wm", beliefs, for_each.on_times)
    np.testing.assert_allclose(for_each.slack, commands[0] - achieved, atol=1e-15)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: CarryingMapper(carrying()), "a CarryingMapper, which carries over by itself"),
        (lambda: TruncatingMapper(triggered(), 0.01), "a SchmittTriggerMapper, which carries over by itself"),
        (lambda: carrying(worlds=0), "worlds is 0; one or more"),
        (lambda: carrying(limit=-1.0), r"limit of axis 0 is -1\.0; a finite share of authority"),
        (lambda: CarryingMapper(LPMapper(ORION), limit=[1.0]), r"limit has the shape \(1,\); \(6,\)"),
        (lambda: TruncatingMapper(LPMapper(ORION), [0.1]), r"minimum_pulse has the shape \(1,\); \(12,\)"),
        (
            lambda: SchmittTriggerMapper(LPMapper(ORION), 0.1, close_at=0.05),
            r"close_at of thruster 1 is 0\.05 s; no less than its minimum_pulse, 0\.1 s",
        ),
        (
            lambda: SchmittTriggerMapper(LPMapper(ORION), 0.1, open_at=[0.2] * 11 + [0.05]),
            r"open_at of thruster 12 is 0\.05 s; no less than its close_at, 0\.1 s",
        ),
        (lambda: carrying().forget([True]), "None, for one craft, would be right"),
        (lambda: carrying(worlds=3).forget([True]), r"a bool array of shape \(3,\) would be right"),
        (
            lambda: carrying(worlds=3)(np.zeros(6)),
            r"command has the shape \(6,\); \(worlds, m\) or .* worlds = 3 would be right",
        ),
    ],
)
def test_a_wrapper_that_makes_no_sense_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()
