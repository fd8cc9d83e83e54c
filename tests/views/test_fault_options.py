"""Faults that are given to a reset: every kind by its name alone, and what is no fault, in every view."""

import dataclasses
import math
import random
from decimal import Decimal
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import IDS, actions_of, craft_of, kinds_of
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.faults import KINDS, Fault, FaultDistribution


@pytest.mark.parametrize("identifier", IDS)
def test_every_kind_that_a_task_knows_flies_by_its_name_alone(identifier):
    env, actions, craft = gym.make(identifier), actions_of(identifier, 0, 3), craft_of(identifier)
    for kind in kinds_of(identifier):
        fault = Fault(1, kind, craft=craft)
        named = {"thruster": 1, "kind": kind, "craft": craft}
        drawn = FaultDistribution(probability=1.0, kinds=(kind,))
        episodes = [
            episode(env, options, actions)
            for options in (fault, [fault], named, [named], dataclasses.asdict(fault), drawn)
        ]
        for other in episodes[1:-1]:
            np.testing.assert_array_equal(other, episodes[0])
        env.reset(seed=3, options={"faults": fault})
        assert Fault(1, kind).severity in env.reset(seed=3, options={"faults": fault})[1]["fault"]["severity"]


@pytest.mark.parametrize("identifier", IDS)
def test_kinds_that_a_task_does_not_know_are_refused_in_one_line(identifier):
    env, known = gym.make(identifier), kinds_of(identifier)
    for kind in set(KINDS) - set(known):
        for faults in (Fault(1, kind), [{"thruster": 1, "kind": kind}], FaultDistribution(kinds=(kind,))):
            with pytest.raises(ValueError, match=f"^kind '{kind}' .* would be right$"):
                env.reset(options={"faults": faults})


def episode(env, faults, actions):
    """The observations of an episode with these faults."""
    seen = [env.reset(seed=3, options={"faults": faults})[0]]
    seen += [env.step(action)[0] for action in actions]
    assert np.isfinite(seen).all()
    return np.array(seen)


CIRCLE: list[Any] = []
CIRCLE.append(CIRCLE)
LOSS = {"thruster": 1, "kind": "loss"}
NO_FAULTS = [
    "stuck_off", b"loss", 3, 10**5000, math.nan, True, object(), {1, 2}, np.zeros(3), np.array(None), {}, [3],
    [CIRCLE], CIRCLE, {"thruster": 1}, {"kind": "loss"}, {1: 2}, LOSS | {"kind": "los"}, LOSS | {"kind": []},
    LOSS | {"sevrity": 1}, LOSS | {"thruster": 0}, LOSS | {"thruster": 99}, LOSS | {"thruster": 10**400},
    LOSS | {"severity": "bad"}, LOSS | {"severity": 2}, LOSS | {"craft": 99}, LOSS | {"craft": 10**5000},
    LOSS | {"onset": math.inf}, LOSS | {"onset": Decimal(1)}, LOSS | {"kind": "loss\n"}, [LOSS] * 100,
    {"thruster": 1, "kind": "intermittent", "profile_time": 1e-5}, {"probability": 2}, {"count": (1, 100)},
    {"kinds": "loss"}, {"kinds": []}, {"kinds": {"loss": 10**400}}, {"thrusters": (99,)}, {"x" * 10**5: 1},
    {"severity": {"loss": (0, 2)}}, {"onset": (1, math.inf)}, {"profiles": ("sine",), "profile_time": (0, 1)},
    FaultDistribution, "two\nlines", ["two\nlines"],
]  # fmt: skip


def refused(reset, faults):
    """Try a reset with what is no fault: one line."""
    with pytest.raises(ValueError) as refusal:  # noqa: PT011  # what the lines say is tested with the records
        reset(options={"faults": faults})
    text = str(refusal.value)
    assert text.isprintable()
    assert 10 < len(text) < 600


@pytest.mark.parametrize("identifier", IDS)
def test_what_is_no_fault_is_refused_and_changes_nothing(identifier):
    env, twin, actions = gym.make(identifier), gym.make(identifier), actions_of(identifier, 0, 4)
    for one in (env, twin):
        one.reset(seed=5)
        one.step(actions[0])
    for faults in NO_FAULTS:
        refused(env.reset, faults)
        refused(lambda *, options: env.reset(seed=9, options=options), faults)
    assert env.unwrapped.np_random_seed == twin.unwrapped.np_random_seed == 5
    for action in actions[1:]:
        np.testing.assert_array_equal(env.step(action)[0], twin.step(action)[0])
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


@pytest.mark.parametrize("identifier", IDS)
def test_batch_refuses_what_is_no_fault_and_changes_nothing(identifier):
    env, twin = (gym.make_vec(identifier, num_envs=3) for _ in range(2))
    actions = np.stack([actions_of(identifier, world, 4) for world in range(3)], axis=1)
    for one in (env, twin):
        one.reset(seed=5)
        one.step(actions[0])
    some = np.array([False, True, False])
    for faults in NO_FAULTS:
        refused(env.reset, faults)
        refused(lambda *, options: env.reset(seed=9, options=options), faults)
        refused(lambda *, options: env.reset(seed=[1, 2, 3], options=options | {"reset_mask": some}), faults)
    assert env.unwrapped.np_random_seed == twin.unwrapped.np_random_seed == 5
    for action in actions[1:]:
        np.testing.assert_array_equal(env.step(action)[0], twin.step(action)[0])
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


def test_seeds_of_worlds_are_those_that_were_taken():
    env = gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=3)
    env.reset(seed=[7, 8, 9])
    refused(lambda *, options: env.reset(seed=[1, 2, 3], options=options), "nothing")
    assert env.unwrapped.np_random_seed == (7, 8, 9)
    env.reset(seed=[None, 2, None])
    assert env.unwrapped.np_random_seed == (7, 2, 9)


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_parallel_view_refuses_what_is_no_fault_and_changes_nothing(module):
    env, twin = module.parallel_env(), module.parallel_env()
    for one in (env, twin):
        one.reset(seed=5)
    for faults in NO_FAULTS:
        refused(env.reset, faults)
        refused(lambda *, options: env.reset(seed=9, options=options), faults)
    for _ in range(3):
        given = {agent: np.zeros(env.action_space(agent).shape, np.float32) for agent in env.agents}
        seen, right = env.step(given)[0], twin.step(given)[0]
        for agent in env.agents:
            np.testing.assert_array_equal(seen[agent], right[agent])
    seen, right = env.reset()[0], twin.reset()[0]
    for agent in env.agents:
        np.testing.assert_array_equal(seen[agent], right[agent])


@pytest.mark.parametrize("identifier", IDS)
def test_environment_whose_first_reset_is_refused_has_not_begun(identifier):
    env = gym.make(identifier).unwrapped
    refused(lambda *, options: env.reset(seed=9, options=options), "nothing")
    with pytest.raises(gym.error.ResetNeeded):
        env.step(env.action_space.sample())
    np.testing.assert_array_equal(env.reset(seed=9)[0], gym.make(identifier).reset(seed=9)[0])


PIECES = [
    None, True, 0, 1, -1, 2.5, math.nan, math.inf, -math.inf, 10**400, 1e-320, 1e308, "", "loss", "leak",
    "ramp", "stuck_off", "sine", "intermittent", (), [], {}, np.float32(0.5), np.zeros(2), np.int64(3), 1j,
]  # fmt: skip
KEYS = [one.name for one in (*dataclasses.fields(Fault), *dataclasses.fields(FaultDistribution))]


def junk(chance, depth=0):
    """Anything that looks a little like faults."""
    kind = chance.random()
    if depth > 3 or kind < 0.3:
        return chance.choice(PIECES)
    if kind < 0.45:
        return [junk(chance, depth + 1) for _ in range(chance.randrange(4))]
    if kind < 0.55:
        return tuple(junk(chance, depth + 1) for _ in range(2))
    described = {"thruster": chance.randint(1, 9), "kind": chance.choice(KINDS)} if kind < 0.85 else {}
    return described | {chance.choice(KEYS): junk(chance, depth + 1) for _ in range(chance.randrange(4))}


@pytest.mark.nightly
@pytest.mark.parametrize("identifier", IDS)
def test_anything_at_all_is_flown_finite_or_refused_in_one_line(identifier):
    env, chance, actions = gym.make(identifier), random.Random(identifier), actions_of(identifier, 0, 3)
    env.reset(seed=3)  # Gymnasium's checker does not get over a first reset that is refused
    env.step(actions[0])
    flown = 0
    for _ in range(10_000):
        faults = junk(chance)
        try:
            env.reset(seed=3, options={"faults": faults})
        except ValueError as refusal:
            assert str(refusal).isprintable()  # noqa: PT017  # most are refused, and some are not
            continue
        flown += 1
        for action in actions:
            observation, reward, *_ = env.step(action)
            assert np.isfinite(observation).all()
            assert math.isfinite(reward)
    assert flown > 100
