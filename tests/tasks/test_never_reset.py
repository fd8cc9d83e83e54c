"""A world that is never reset, two thousand steps past the end of its episode: every number stays finite."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.tasks.test_every_vehicle import assert_finite
from thruster_envs.registration import ENVIRONMENTS

STEPS = 2000


def actions(space: Any, kind: str) -> Any:
    """Random ones; all thrusters open, or the last option of each choice; one thruster open, or the first."""
    if kind == "random":
        return space.sample()
    if isinstance(space, gym.spaces.Box):
        full = space.high.copy()
        if kind == "one":
            full[:, 1:] = space.low[:, 1:]
        return full
    last = np.ones(space.shape, np.int64)
    return last if kind == "one" else space.nvec - 1


@pytest.mark.parametrize("kind", ["random", "one", pytest.param("all", marks=pytest.mark.nightly)])
@pytest.mark.parametrize("identifier", ENVIRONMENTS)
def test_a_world_that_is_never_reset_stays_finite(identifier, kind):
    env: Any = gym.make_vec(
        identifier,
        num_envs=1,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.DISABLED,
    )
    env.action_space.seed(3)
    env.reset(seed=2)
    for step in range(STEPS):
        observations, rewards, _, _, infos = env.step(actions(env.action_space, kind))
        assert np.isfinite(rewards).all()
        assert np.isfinite(observations).all()
        if step % 200 == 199:
            assert observations in env.observation_space
            assert_finite(infos, f"info of step {step}")
    assert np.isfinite(env.worlds.fleet.data).all()
