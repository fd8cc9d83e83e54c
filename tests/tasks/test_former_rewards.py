"""Environments of v0 go on as they were, bit for bit, and say that they are out of date."""

import gymnasium as gym
import numpy as np
import pytest

from thruster_envs.faults import FaultDistribution
from thruster_envs.observations import Reader
from thruster_envs.registration import ENVIRONMENTS, FORMER, make_parallel

#: Id, settings, periods, and what came of eight worlds under random actions before there was a v1: the sum
#: of all rewards, and how many episodes came to their own end.
RECORDED = [
    ("OrionRendezvous", {}, 120, -75.08520823475627, 20),
    ("MarsRendezvous", {"distance": 2.5}, 300, -7.75185569846869, 8),
    ("FormationKeeping", {}, 120, -872.8626603780688, 13),
    ("FormationAttitude", {"rate_soft_limit": 0.0001, "rate_limit": 0.002}, 120, -1033.9966417729904, 24),
    ("FaultDiagnosis", {"rate_limit": 0.02}, 120, -65.90416666666664, 39),
    ("ActiveDiagnosis", {"rate_limit": 0.02}, 120, -887.9383333333334, 479),
]


def flown(name, settings, steps):
    faults = FaultDistribution(probability=0.7, onset=(0.0, 20.0))
    envs = gym.make_vec(f"thruster_envs/{name}-v0", num_envs=8, faults=faults, **settings)
    envs.reset(seed=5)
    rng, total, ends = np.random.default_rng(3), 0.0, 0
    for _ in range(steps):
        if isinstance(envs.single_action_space, gym.spaces.Box):
            actions = rng.uniform(-1.0, 0.2, envs.action_space.shape)
        else:
            actions = rng.integers(0, envs.single_action_space.nvec, envs.action_space.shape)
        _, rewards, terminated, _, _ = envs.step(actions)
        total, ends = total + rewards.sum(), ends + terminated.sum()
    return float(total), int(ends)


@pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")
@pytest.mark.parametrize(("name", "settings", "steps", "total", "ends"), RECORDED)
def test_the_former_reward_is_what_it_was(name, settings, steps, total, ends):
    assert flown(name, settings, steps) == (pytest.approx(total, rel=1e-12), ends)
    assert ends > 0


@pytest.mark.parametrize("identifier", FORMER)
def test_a_former_environment_names_its_successor(identifier):
    with pytest.warns(DeprecationWarning, match=f"{identifier} is out of date.*`v1`"):
        env = gym.make(identifier)
    successor = identifier.replace("-v0", "-v1")
    assert successor in ENVIRONMENTS
    assert env.observation_space == gym.make(successor).observation_space
    assert Reader.of(identifier).fields == Reader.of(successor).fields


@pytest.mark.parametrize("name", ["formation_keeping", "formation_attitude"])
def test_a_former_formation_names_its_successor_in_pettingzoo_too(name):
    module = pytest.importorskip(f"thruster_envs.{name}_v0")
    with pytest.warns(DeprecationWarning, match=f"thruster_envs/{name}-v0 is out of date; use {name}_v1"):
        env = module.parallel_env()
    identifier = f"thruster_envs/{name.title().replace('_', '')}-v0"
    assert type(make_parallel(identifier)) is type(env)
    assert env.metadata["name"] == f"{name}_v0"
    _, infos = env.reset(seed=1)
    assert all("lost" not in info["reward_terms"] for info in infos.values())
