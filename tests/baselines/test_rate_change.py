from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.estimation import thrust_rate_change
from thruster_baselines.mapping import delivered_rate_change
from thruster_envs.spacecraft import load

ORION = load("orion")
NAMES = [thruster.name for thruster in ORION.thrusters]


def silent_orion():
    """Orion with neither scatter nor sensor errors."""
    thrusters = [
        {"name": one.name, "position": one.position, "direction": one.direction, "thrust": one.thrust}
        for one in ORION.thrusters
    ]
    return ORION.replace(thrusters=thrusters, sensors={})


def state_of(env) -> np.ndarray:
    """(13,): as the environment's fleet has it: the true motion, which is the measured one without errors."""
    return env.unwrapped.worlds.state.fleet.data[0, :13, 0].copy()


def test_what_is_left_is_what_was_fired_far_from_the_target_too():
    craft = silent_orion()
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=craft)
    rng = np.random.default_rng(0)
    for seed in range(20):
        env.reset(seed=seed)  # nearly at rest: while it turns, what it fires turns with it
        before = state_of(env)
        duties = 0.01 * rng.random(12) * (rng.random(12) < 0.4)
        env.step((2.0 * duties - 1.0).astype(np.float32))
        found = thrust_rate_change(craft, before, state_of(env), craft.control_period)
        fired = delivered_rate_change(
            craft.effectiveness(), duties * craft.control_period, craft.feed.coupling
        )
        np.testing.assert_allclose(found, fired, atol=5e-6)
        plain = state_of(env)[3:6] - before[3:6]
        assert np.abs(plain - found[:3]).max() > 1e-3  # the drift of 5 s is two hundred times that


def test_free_motion_leaves_nothing_and_batches_are_single_calls():
    craft = silent_orion()
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=craft)
    states = []
    for seed in range(5):
        env.reset(seed=seed)
        before = state_of(env)
        env.step(-np.ones(12, np.float32))
        states.append((before, state_of(env)))
    before, after = (np.stack(part) for part in zip(*states, strict=True))
    found = thrust_rate_change(craft, before, after, craft.control_period)
    assert np.abs(found[:, :3]).max() < 1e-7
    assert np.abs(found[:, 3:]).max() < 1e-8
    for i in range(5):
        alone = thrust_rate_change(craft, before[i], after[i], craft.control_period)
        np.testing.assert_allclose(found[i], alone, atol=1e-15)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"both \(\.\.\., 13\) would be right"):
        thrust_rate_change(ORION, np.zeros(12), np.zeros(13), 5.0)
    with pytest.raises(ValueError, match="duration is 0"):
        thrust_rate_change(ORION, np.zeros(13), np.zeros(13), 0.0)
