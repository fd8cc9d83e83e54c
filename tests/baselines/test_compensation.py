from __future__ import annotations

import numpy as np
import pytest

from thruster_baselines.mapping import (
    AdditiveCompensationMapper,
    DifferentialCompensationMapper,
    ExactCompensationMapper,
    LPMapper,
    MILPMapper,
    delivered_rate_change,
)
from thruster_baselines.mapping.compensation import CAPPED, CYCLED, SHORT
from thruster_envs.spacecraft import load

ORION = load("orion")
SIGNS = np.sign(ORION.effectiveness())  # the matrix behind Tables 4 and 5 of the source
EXAMPLE = np.array([5.0, 1.0, 1.0, 0.0, 0.0, 0.0])
COMPENSATORS = [DifferentialCompensationMapper, AdditiveCompensationMapper, ExactCompensationMapper]


def commands(count: int, share: float, axes: str = "all", seed: int = 0) -> np.ndarray:
    """Commands uniform in a box of so large a share of Orion's authority."""
    mask = {"all": np.ones(6), "translation": np.repeat([1, 0], 3), "rotation": np.repeat([0, 1], 3)}[axes]
    return np.random.default_rng(seed).uniform(-share, share, (count, 6)) * ORION.authority() * mask


def miss(mapper, asked: np.ndarray, on_times: np.ndarray) -> np.ndarray:
    """Weighed miss with the loss, as a share of the weighed command."""
    rest = asked - delivered_rate_change(ORION.effectiveness(), on_times, 0.06)
    return np.abs(rest) @ mapper.slack_cost / (np.abs(asked) @ mapper.slack_cost)


@pytest.mark.parametrize(
    ("iterations", "achieved", "within"),
    [  # Yang 2003, Table 5, and the exact values of the reference where the table is rounded
        (1, [4.52, 0.82, 0.82, 0.0, -0.18, 0.18], 1e-9),
        (2, [4.928, 0.9676, 0.9676, 0.0, -0.0324, 0.0324], 1e-9),
        (3, [4.9879, 0.9942, 0.9942, 0.0, -0.0058, 0.0058], 5e-5),
        (50, EXAMPLE, 1e-5),
    ],
)
def test_method_two_gives_the_worked_example_of_the_source(iterations, achieved, within):
    mapper = AdditiveCompensationMapper(SIGNS, 5.0, coupling=0.06, tolerance=1e-6, max_iterations=iterations)
    allocation = mapper(EXAMPLE)
    found = EXAMPLE - allocation.slack
    # of two equally cheap vertices one leaves the rotation with the other sign
    either = np.array(achieved) * [1, 1, 1, 1, np.sign(found[5]), np.sign(found[5])]
    np.testing.assert_allclose(found, either if iterations < 50 else achieved, atol=within)
    assert int(allocation.status) == (CAPPED if iterations < 50 else 0)
    if iterations == 50:
        assert int(allocation.iterations) < 10
        longest = np.sort(allocation.on_times)[-4:]
        np.testing.assert_allclose(longest, [1.21951, 1.21951, 2.28334, 3.28334], atol=1e-5)


@pytest.mark.parametrize(
    ("iterations", "achieved", "within"),
    [(1, [4.52, 0.82, 0.82, 0.0, -0.18, 0.18], 1e-9), (2, [4.969, 1.0, 1.0, 0.0, -0.0395, 0.0395], 5e-4)],
)
def test_method_one_gives_the_worked_example_of_the_source(iterations, achieved, within):
    mapper = DifferentialCompensationMapper(SIGNS, 5.0, coupling=0.06, max_iterations=iterations)
    found = EXAMPLE - mapper(EXAMPLE).slack
    either = np.array(achieved) * [1, 1, 1, 1, np.sign(found[5]), np.sign(found[5])]
    np.testing.assert_allclose(found, either, atol=within)


def test_method_two_stops_at_the_bound_and_says_so():
    # 4.5 s on four thrusters would have to become 5.49 s: what 5 s give is 0.0246 m/s (reference 2.9).
    allocation = AdditiveCompensationMapper(ORION)([-0.027, -0.027, 0, 0, 0, 0])
    np.testing.assert_allclose(allocation.on_times[[0, 5, 9, 11]], 5.0)
    np.testing.assert_allclose(allocation.slack[:2], -0.027 + 0.0246, rtol=1e-9)
    assert int(allocation.status) == SHORT


@pytest.mark.parametrize("axes", ["translation", "rotation", "all"])
def test_within_authority_the_exact_compensator_meets_every_command_to_round_off_with_one_program(axes):
    asked = commands(2000, 0.15, axes)
    mapper = ExactCompensationMapper(ORION)
    allocation = mapper(asked)
    assert (allocation.status == 0).all()
    assert (allocation.iterations == 1).all()
    assert miss(mapper, asked, allocation.on_times).max() < 1e-14
    # the linear program's choice of thrusters is kept, and each fires longer by what the others take
    plain = LPMapper(ORION)(asked).on_times
    assert ((plain > 0.0) == (allocation.on_times > 0.0)).all()
    assert (allocation.on_times >= plain * (1.0 - 1e-14)).all()


@pytest.mark.parametrize("axes", ["translation", "rotation", "all"])
def test_method_two_converges_to_the_exact_on_times(axes):
    asked = commands(500, 0.15, axes)
    exact = ExactCompensationMapper(ORION)(asked)
    rule_off = AdditiveCompensationMapper(ORION, tolerance=1e-9, cost_rule="none", max_iterations=100)(asked)
    same = ((rule_off.on_times > 0.0) == (exact.on_times > 0.0)).all(axis=1)
    assert same.mean() > 0.9
    np.testing.assert_allclose(rule_off.on_times[same], exact.on_times[same], atol=1e-6)


@pytest.mark.parametrize("share", [0.15, 0.4, 1.0])
@pytest.mark.parametrize("axes", ["translation", "rotation", "all"])
def test_the_exact_compensator_is_nearer_than_method_two_on_average(axes, share):
    asked = commands(3000, share, axes)
    mapper = ExactCompensationMapper(ORION)
    exact, additive = mapper(asked), AdditiveCompensationMapper(ORION)(asked)
    misses = miss(mapper, asked, exact.on_times), miss(mapper, asked, additive.on_times)
    assert misses[0].mean() <= misses[1].mean()
    within = exact.status == 0
    assert (misses[0][within] <= misses[1][within] + 1e-12).all()


def test_method_two_always_converges_where_the_command_can_be_met():
    asked = commands(5000, 0.15)
    allocation = AdditiveCompensationMapper(ORION)(asked)
    assert (allocation.status == 0).all()
    assert allocation.iterations.max() < 7  # as the source says, for one percent; here for a tenth of that
    one_percent = AdditiveCompensationMapper(ORION, tolerance=0.01)(asked)
    assert one_percent.iterations.max() <= 4


def test_method_one_cycles_on_some_six_axis_commands_and_says_which():
    mapper = DifferentialCompensationMapper(ORION)
    assert (mapper(commands(2000, 0.15, "translation")).status == 0).all()
    assert (mapper(commands(2000, 0.15, "rotation")).status == 0).all()
    asked = commands(2000, 0.15)
    allocation = mapper(asked)
    cycled = allocation.status == CYCLED
    assert 0.05 < cycled.mean() < 0.25
    # the best round is the answer: never farther off than no compensation
    none = LPMapper(ORION)(asked).on_times
    assert (miss(mapper, asked, allocation.on_times) <= miss(mapper, asked, none) + 1e-12).all()


def test_a_cycle_of_method_one_is_a_cycle():
    """The iteration written out comes back to the same commands for ever, where the detector stopped it."""
    mapper, plain = DifferentialCompensationMapper(ORION), LPMapper(ORION)
    asked = commands(2000, 0.15)
    chosen = asked[mapper(asked).status == CYCLED][:20]
    returned = 0
    for command in chosen:
        sequence, now, seen = plain.sequence(), command.copy(), []
        for _ in range(300):
            achieved = delivered_rate_change(ORION.effectiveness(), sequence(now).on_times, 0.06)
            assert (
                np.abs((command - achieved) * plain.slack_cost).max()
                > 1e-3 * np.abs(command * plain.slack_cost).max()
            )
            seen.append(now)
            now = now + now / achieved * (command - achieved)
        sizes = np.abs(command * plain.slack_cost).max()
        distances = [np.abs((now - old) * plain.slack_cost).max() / sizes for old in seen[-12:]]
        returned += min(distances) < 1e-6
    assert returned >= 15


@pytest.mark.parametrize("rule", ["raise_unused", "lower_used", "none"])
def test_the_cost_rule_keeps_new_thrusters_out(rule):
    asked = commands(2000, 0.15, "translation")
    mapper = AdditiveCompensationMapper(ORION, cost_rule=rule)
    opened_first = LPMapper(ORION)(asked).on_times > 0.0
    allocation = mapper(asked)
    joined = ((allocation.on_times > 0.0) & ~opened_first).any(axis=1).mean()
    assert joined == 0.0
    assert miss(mapper, asked, allocation.on_times).max() < 6e-3  # 1e-3 of the largest on each of six axes


def test_the_integer_program_is_exact_where_all_on_times_are_equal_and_fires_too_much_where_they_are_not():
    equal = MILPMapper(ORION)([-0.02, -0.02, 0, 0, 0, 0])
    np.testing.assert_allclose(equal.on_times[[0, 5, 9, 11]], 0.02 / 0.003 / 2.0 / 0.82, rtol=1e-6)
    np.testing.assert_allclose(equal.slack, 0.0, atol=1e-8)
    example = MILPMapper(SIGNS, 5.0, coupling=0.062)(EXAMPLE)
    np.testing.assert_allclose(np.sort(example.on_times)[-4:], [1.2285, 1.2285, 2.4570, 3.6855], atol=5e-5)
    delivered = EXAMPLE - example.slack
    assert delivered[0] == pytest.approx(5.533, abs=5e-4)  # 10.7 % too much, by the loss that there is


def test_the_integer_program_chooses_as_an_enumeration_of_counts_does():
    """For each count of thrusters a linear program; where it opens more, the count is not allowed."""
    mapper = MILPMapper(ORION)
    plain = LPMapper(ORION)
    for command in commands(6, 0.15, seed=3):
        objective = np.inf
        for count in range(1, 13):
            found = plain(command, effectiveness=ORION.effectiveness() * mapper.shares[count])
            if (found.on_times > 0.0).sum() <= count:
                objective = min(objective, float(found.cost))
        answer = mapper(command)
        assert int(answer.status) == 0
        assert float(answer.cost) <= objective * (1.0 + 1e-6)
        assert (answer.on_times > 1e-9).sum() <= 12


@pytest.mark.parametrize("mapper_class", COMPENSATORS)
def test_bounds_hold_and_no_answer_is_half_written(mapper_class):
    asked = np.concatenate([commands(1000, 2.0), commands(1000, 0.3), np.zeros((2, 6))])
    bounds = np.random.default_rng(1).uniform(0.0, 5.0, (len(asked), 12))
    bounds[:, 3] = 0.0
    allocation = mapper_class(ORION)(asked, max_on_time=bounds)
    assert (allocation.on_times >= 0.0).all()
    assert (allocation.on_times <= bounds).all()
    assert np.isfinite(allocation.slack).all()
    assert (allocation.on_times[-2:] == 0.0).all()
    assert set(np.unique(allocation.status)) <= {0, CYCLED, SHORT, CAPPED}


@pytest.mark.parametrize("mapper_class", [*COMPENSATORS, MILPMapper])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spacecraft": np.eye(6), "max_on_time": 5.0}, "coupling is missing"),
        ({"spacecraft": ORION, "coupling": -0.1}, "coupling is -0.1"),
        ({"spacecraft": ORION, "coupling": [0.1]}, r"coupling has the shape \(1,\); \(12,\)"),
    ],
)
def test_a_compensator_that_makes_no_sense_is_refused(mapper_class, arguments, message):
    with pytest.raises(ValueError, match=message):
        mapper_class(**arguments)


def test_settings_out_of_range_are_refused():
    with pytest.raises(ValueError, match=r"tolerance is 1\.0"):
        ExactCompensationMapper(ORION, tolerance=1.0)
    with pytest.raises(ValueError, match="max_iterations is 0"):
        DifferentialCompensationMapper(ORION, max_iterations=0)
    with pytest.raises(ValueError, match="cost_rule is 'cheap'; one of none, raise_unused, lower_used"):
        AdditiveCompensationMapper(ORION, cost_rule="cheap")
    with pytest.raises(ValueError, match="cost_factor is -1"):
        AdditiveCompensationMapper(ORION, cost_factor=-1.0)
    with pytest.raises(ValueError, match="max_on_time is infinite"):
        MILPMapper(ORION, max_on_time=np.inf)(np.zeros(6))
