"""Warm starts: along a sequence of commands the optimum is found from the basis of the one before."""

from __future__ import annotations

import numpy as np
import pytest

from thruster_baselines.mapping import LPMapper, LPSequence
from thruster_baselines.mapping.sequence import REFRESH
from thruster_envs.spacecraft import load


def trajectory(vehicle: str, share: float, steps: int, seed: int = 0) -> np.ndarray:
    """Six sines of unlike periods, of so large a share of the authority."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, steps / 100.0, steps)[:, np.newaxis]
    waves = np.sin(rng.uniform(0.5, 2.0, 6) * time + rng.uniform(0.0, 2.0 * np.pi, 6))
    return share * load(vehicle).authority() * waves


@pytest.mark.parametrize("vehicle", ["orion", "spheres"])
@pytest.mark.parametrize("share", [0.2, 0.8, 3.0])
@pytest.mark.parametrize("shuffled", [False, True])
def test_every_answer_costs_what_it_costs_from_a_cold_start(vehicle, share, shuffled):
    commands = trajectory(vehicle, share, 3 * REFRESH)
    if shuffled:
        commands = np.random.default_rng(1).permutation(commands)
    mapper = LPMapper(load(vehicle))
    warm, cold = mapper.sequence()(commands), mapper(commands)
    np.testing.assert_allclose(warm.cost, cold.cost, rtol=1e-11)
    assert (warm.on_times >= 0.0).all()
    assert (warm.on_times <= mapper.max_on_time).all()
    np.testing.assert_allclose(
        warm.slack, commands - warm.on_times @ mapper.effectiveness.T, rtol=1e-12, atol=1e-14
    )
    np.testing.assert_allclose(
        warm.cost, warm.on_times @ mapper.fuel_cost + np.abs(warm.slack) @ mapper.slack_cost, rtol=1e-12
    )


def test_degenerate_and_jumping_commands_are_followed_too():
    rng = np.random.default_rng(2)
    commands = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], (4000, 6)) * load("orion").authority()
    mapper = LPMapper("orion")
    np.testing.assert_allclose(
        mapper.sequence()(commands).cost, mapper(commands).cost, rtol=1e-11, atol=1e-12
    )


def test_random_vehicles_are_followed_with_any_bounds_and_costs():
    for seed in range(60):
        rng = np.random.default_rng(seed)
        axes = int(rng.integers(1, 8))
        thrusters = axes + int(rng.integers(17))
        matrix = rng.normal(size=(axes, thrusters))
        if seed % 3 == 0:  # many exactly equal ratios
            matrix = rng.integers(-1, 2, (axes, thrusters)).astype(float)
            matrix[:, :axes] = np.eye(axes)
        bounds = rng.uniform(0.0, 3.0, thrusters) * (rng.random(thrusters) < 0.9)
        if seed % 5 == 0:
            bounds[:] = np.inf
        weights = rng.uniform(0.5, 2.0, thrusters), 10.0 ** rng.uniform(0.5, 3.0, axes)
        mapper = LPMapper(matrix, bounds, *weights, fuel_may_win=True)
        commands = np.cumsum(rng.normal(size=(200, axes)), axis=0) * 0.3
        warm, cold = mapper.sequence()(commands), mapper(commands)
        np.testing.assert_allclose(warm.cost, cold.cost, rtol=1e-10, atol=1e-12)


def test_most_commands_of_a_trajectory_need_no_change_of_basis():
    mapper = LPMapper("orion")
    commands = trajectory("orion", 0.2, 2000)
    sequence = mapper.sequence()
    # the same thrusters stay open from one command to the next
    open_ones = sequence(commands).on_times > 0.0
    assert (open_ones[1:] != open_ones[:-1]).any(axis=1).mean() < 0.1


def test_steps_one_by_one_and_all_at_once_are_the_same_to_the_last_bit():
    mapper = LPMapper("orion")
    commands = trajectory("orion", 0.8, REFRESH + 50)
    together = mapper.sequence()(commands)
    stepwise = mapper.sequence()
    for command, on_times in zip(commands, together.on_times, strict=True):
        assert (stepwise(command).on_times == on_times).all()


@pytest.mark.parametrize("threads", [1, 2, None])
def test_worlds_have_each_their_own_memory(threads):
    worlds, steps = 600, 20
    commands = np.stack([trajectory("orion", 0.5, steps, seed) for seed in range(worlds)], axis=1)
    together = LPSequence("orion", worlds=worlds, threads=threads)(commands)
    assert together.on_times.shape == (steps, worlds, 12)
    for world in (0, 1, 299, 300, 599):
        alone = LPSequence("orion")(commands[:, world])
        assert (alone.on_times == together.on_times[:, world]).all()


def test_forgetting_starts_anew_in_the_worlds_that_are_named():
    commands = np.stack([trajectory("orion", 0.5, 40, seed) for seed in range(3)], axis=1)
    sequence = LPSequence("orion", worlds=3)
    sequence(commands)
    sequence.forget([False, True, False])
    fresh = LPSequence("orion")(commands[-1, 1])
    assert (sequence(commands[-1]).on_times[1] == fresh.on_times).all()


def test_a_new_belief_starts_anew_and_the_same_belief_does_not_matter_how_it_is_given():
    mapper = LPMapper("orion")
    commands = trajectory("orion", 0.3, 60)
    faulty = mapper.effectiveness.copy()
    faulty[:, 0] = 0.0
    sequence = mapper.sequence()
    for i, command in enumerate(commands):
        belief = None if i < 20 else faulty
        found = sequence(command, effectiveness=belief)
        expected = mapper(command, effectiveness=belief)
        assert float(found.cost) == pytest.approx(float(expected.cost), rel=1e-11)
        if i >= 20:
            assert found.on_times[0] == 0.0
    faulty[:, 1] = 0.0  # the caller's array changes under the same name
    found = sequence(commands[-1], effectiveness=faulty)
    assert found.on_times[1] == 0.0
    assert sequence(commands[-1]).on_times[[0, 1]].max() > 0.0  # and back to the mapper's own model


def test_each_world_can_have_a_belief_of_its_own():
    mapper = LPMapper("orion")
    commands = np.stack([trajectory("orion", 0.3, 30, seed) for seed in range(4)], axis=1)
    beliefs = np.repeat(mapper.effectiveness[np.newaxis], 4, axis=0)
    beliefs[np.arange(4), :, np.arange(4)] = 0.0
    found = LPSequence("orion", worlds=4)(commands, effectiveness=beliefs)
    np.testing.assert_allclose(found.cost, mapper(commands, effectiveness=beliefs).cost, rtol=1e-11)


@pytest.mark.parametrize(
    ("arguments", "command", "message"),
    [
        ({}, np.zeros((2, 3, 6)), r"\(2, 3, 6\); \(m,\) or \(steps, m\) with m = 6 would be right"),
        ({"worlds": 4}, np.zeros((3, 6)), r"\(3, 6\); \(worlds, m\) or \(steps, worlds, m\)"),
        ({"worlds": 4}, np.zeros(6), r"with m = 6 and worlds = 4"),
        ({}, np.full(6, np.nan), "command on axis 0 is nan"),
    ],
)
def test_commands_that_do_not_fit_are_refused(arguments, command, message):
    with pytest.raises(ValueError, match=message):
        LPSequence("orion", **arguments)(command)


def test_sequences_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="worlds is 0"):
        LPSequence("orion", worlds=0)
    with pytest.raises(ValueError, match="threads is 0"):
        LPSequence("orion", threads=0)
    with pytest.raises(ValueError, match="a belief has the leading axes"):
        LPSequence("orion", worlds=2)(np.zeros((2, 6)), effectiveness=np.ones((3, 6, 12)))
