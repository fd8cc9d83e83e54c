"""Thrusters of which one delivers too much or too little: the wrenches that are left, and who gives them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from thruster_baselines.control import ValveAllocation, ValveBelief, authority_left
from thruster_envs.spacecraft import load

CHASER = load("msr_chaser")
WRENCHES, PERIOD = CHASER.wrenches(), CHASER.control_period
SIZE = 0.5 * np.abs(WRENCHES).sum(axis=1)
ALLOCATION = ValveAllocation(WRENCHES)
FAULTS = [
    ("stuck_on", 0.35), ("stuck_on", 0.85), ("stuck_off", 1.0), ("leak", 0.3), ("loss", 0.7),
    ("late_opening", 0.06),
]  # fmt: skip


def struck(kind, severity, thrusters=range(1, 9)):
    belief = ValveBelief.sound(len(thrusters), 8)
    for vehicle, thruster in enumerate(thrusters):
        belief.blame(vehicle, thruster, kind, severity, period=PERIOD)
    return belief


def least_miss(wrench, lower, upper):
    """The least that any of the axes, by its size, has to be missed by: a linear program."""
    rows = WRENCHES / SIZE[:, np.newaxis]
    answer = linprog(
        np.r_[np.zeros(8), 1.0],
        A_ub=np.r_[np.c_[rows, -np.ones(6)], np.c_[-rows, -np.ones(6)]],
        b_ub=np.r_[wrench / SIZE, -wrench / SIZE],
        bounds=[*zip(lower, upper, strict=True), (0.0, None)],
    )
    assert answer.status == 0
    return answer.fun


@pytest.mark.parametrize(("kind", "severity"), FAULTS)
def test_a_wrench_is_given_exactly_where_a_linear_program_says_it_can_be(kind, severity):
    random = np.random.default_rng(7)
    belief = struck(kind, severity)
    given = 0
    for scale in (0.03, 0.1, 0.3):
        wrench = scale * SIZE * random.normal(size=(8, 6))
        rates = ALLOCATION(wrench, belief.lower, belief.upper)
        assert (rates >= belief.lower).all()
        assert (rates <= belief.upper).all()
        missed = np.abs((rates @ WRENCHES.T - wrench) / SIZE).max(axis=1)
        for vehicle in range(8):
            possible = least_miss(wrench[vehicle], belief.lower[vehicle], belief.upper[vehicle]) < 1e-9
            assert (missed[vehicle] < 1e-9) == possible
            given += possible
    assert 0 < given < 24


@pytest.mark.parametrize(("kind", "severity"), FAULTS)
def test_beyond_authority_the_torque_comes_first_and_then_the_nearest_force(kind, severity):
    random = np.random.default_rng(11)
    belief = struck(kind, severity)
    wrench = 0.25 * SIZE * random.normal(size=(8, 6))
    rates = ALLOCATION(wrench, belief.lower, belief.upper)
    force, torque = WRENCHES[:3], WRENCHES[3:]
    solved = 0
    for vehicle in range(8):
        bounds = belief.lower[vehicle], belief.upper[vehicle]
        moving = bounds[1] > bounds[0]
        fixed = np.where(moving, 0.0, bounds[0])
        # A torque that weighs a thousand times as much is given before any force.
        weights = np.r_[np.full(3, 1.0 / SIZE[0]), 1e3 / SIZE[3:]]
        best = lsq_linear(
            weights[:, np.newaxis] * WRENCHES[:, moving],
            weights * (wrench[vehicle] - WRENCHES @ fixed),
            (bounds[0][moving], bounds[1][moving]),
            tol=1e-14,
        )
        reference = fixed.copy()
        reference[moving] = best.x
        turn_missed = np.abs((torque @ reference - wrench[vehicle, 3:]) / SIZE[3:]).max()
        if turn_missed > 1e-4:
            continue  # the torque alone is too much
        solved += 1
        np.testing.assert_allclose(torque @ rates[vehicle], wrench[vehicle, 3:], atol=1e-6)
        # 1e-3 of the largest force: what the weights leave of the order in which misses count.
        np.testing.assert_allclose(force @ rates[vehicle], force @ reference, atol=1e-3 * SIZE[2])
    assert solved >= 3


def test_a_torque_that_is_too_much_is_met_as_far_as_it_goes():
    belief = ValveBelief.sound(1, 8)
    wrench = np.array([[0.0, 0.0, 0.0, 3.0 * SIZE[3], 0.0, 0.0]])
    rates = ALLOCATION(wrench, belief.lower, belief.upper)
    np.testing.assert_allclose((WRENCHES @ rates[0])[3:], [SIZE[3], 0.0, 0.0], atol=1e-4)


def test_sound_thrusters_get_the_minimum_norm_answer_raised_to_the_idle_rate():
    wrench = np.array([[6.0, -2.0, 4.0, 1.0, -0.5, 0.4]])
    belief = ValveBelief.sound(1, 8)
    rates = ALLOCATION(wrench, belief.lower, belief.upper, idle=0.2)
    smallest = np.linalg.pinv(WRENCHES) @ wrench[0]
    np.testing.assert_allclose(rates[0], smallest - smallest.min() + 0.2, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "severity", "left"),
    [
        # Three of four must do without the fourth: none; a thruster stuck at c lets them fall or rise by c or
        # 1 - c; one that leaks, is weak or late moves over what is left. In half-authorities of one thruster.
        ("stuck_off", 1.0, 0.0),
        ("stuck_on", 1.0, 0.0),
        ("stuck_on", 0.3, 0.15),
        ("stuck_on", 0.8, 0.1),
        ("leak", 0.4, 0.3),
        ("loss", 0.4, 0.3),
        ("late_opening", 0.04, 0.3),
        ("late_opening", 0.1, 0.0),
        ("slow_opening", 0.4, 0.5),
    ],
)
def test_the_authority_that_a_fault_leaves(kind, severity, left):
    belief = struck(kind, severity)
    for vehicle in range(8):
        assert authority_left(WRENCHES, belief.lower[vehicle], belief.upper[vehicle]) == pytest.approx(
            left, abs=1e-9
        )


def test_authority_is_the_distance_of_the_nearest_wrench_that_cannot_be_given():
    random = np.random.default_rng(3)
    lower, upper = random.uniform(0.0, 0.2, 8), random.uniform(0.5, 1.0, 8)
    radius = authority_left(WRENCHES, lower, upper)
    assert radius > 0.0
    nearest = np.inf
    for _ in range(300):
        direction = random.normal(size=6)
        direction /= np.linalg.norm(direction)
        answer = linprog(
            np.r_[np.zeros(8), -1.0],
            A_eq=np.c_[WRENCHES / SIZE[:, np.newaxis], -direction],
            b_eq=np.zeros(6),
            bounds=[*zip(lower, upper, strict=True), (0.0, None)],
        )
        nearest = min(nearest, answer.x[-1])
    assert radius <= nearest + 1e-9
    assert nearest < 1.5 * radius  # random directions come as near as that


@pytest.mark.parametrize(("kind", "severity"), FAULTS)
def test_what_is_told_delivers_what_was_allotted(kind, severity):
    belief = struck(kind, severity)
    wrench = 0.01 * SIZE * np.random.default_rng(5).normal(size=(8, 6))
    rates = ALLOCATION(wrench, belief.lower, belief.upper)
    told = belief.commands(rates)
    assert ((told >= 0.0) & (told <= 1.0)).all()
    np.testing.assert_allclose(belief.delivered(told), rates, atol=1e-9)


def test_a_second_fault_found_on_top_of_a_belief_adds_up():
    belief = ValveBelief.sound(1, 8)
    belief.blame(0, 3, "stuck_on", 0.5, period=PERIOD)
    # Of a thruster that is told one and the same, everything that is found is another level.
    assert belief.together(0, 3, "loss", 0.2) == ("stuck_on", pytest.approx(0.4))
    assert belief.together(0, 3, "leak", 0.2) == ("stuck_on", pytest.approx(0.6))
    assert belief.together(0, 3, "stuck_off", 1.0) == ("stuck_on", 0.0)
    assert belief.together(0, 3, "slow_opening", 0.2) == ("stuck_on", 0.5)
    belief.blame(0, 3, "leak", 0.5, period=PERIOD)
    assert belief.together(0, 3, "leak", 0.5) == ("leak", 0.75)
    belief.close(0, 3)
    assert belief.commands(np.full((1, 8), 0.3))[0, 2] == 0.0


def test_six_thrusters_have_nothing_to_choose():
    allocation = ValveAllocation(np.eye(6))
    lower, upper = np.zeros((2, 6)), np.ones((2, 6))
    wanted = np.array([[0.5] * 6, [0.5, 0.5, 2.0, 0.5, 0.5, 0.5]])
    rates = allocation(wanted, lower, upper)
    np.testing.assert_allclose(rates, np.minimum(wanted, 1.0), atol=1e-6)
    assert authority_left(np.eye(6), lower[0], upper[0]) == 0.0


def test_bad_input_is_refused_in_one_line():
    sound = ValveBelief.sound(1, 8)
    with pytest.raises(ValueError, match=r"lower is 1.0 of vehicle 0, thruster 1; no more than upper, which"):
        ALLOCATION(np.zeros((1, 6)), np.ones((1, 8)), np.zeros((1, 8)))
    with pytest.raises(ValueError, match=r"lower: shape is \(2, 8\); \(1, 8\) would be right"):
        ALLOCATION(np.zeros((1, 6)), np.zeros((2, 8)), sound.upper)
    with pytest.raises(ValueError, match=r"wrench: shape is \(6,\); \(vehicles, 6\) would be right"):
        ALLOCATION(np.zeros(6), sound.lower, sound.upper)
    with pytest.raises(ValueError, match="nan"):
        ALLOCATION(np.full((1, 6), np.nan), sound.lower, sound.upper)
    with pytest.raises(ValueError, match="kind is 'misalignment'; stuck_on, stuck_off, leak, loss"):
        sound.blame(0, 1, "misalignment", 0.1, period=PERIOD)
    with pytest.raises(ValueError, match=r"wrenches: shape is \(3, 8\); \(6, n\) would be right"):
        ValveAllocation(WRENCHES[:3])
