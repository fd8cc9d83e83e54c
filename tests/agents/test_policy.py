"""Facts of the diagnosing policy and of the reward it is trained on."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from thruster_agents.environments import make_plain, on_form
from thruster_agents.policies import DiagnosisPolicy
from thruster_agents.ppo import RegretReward
from thruster_baselines.mapping import LPMapper
from thruster_envs.observations import Reader
from thruster_envs.spacecraft import load

WHOLE = np.full((6, 12), 1.0)


def _policy(observation_size=66):
    torch.manual_seed(0)
    observed = spaces.Box(-3.0, 3.0, (observation_size,))
    policy = DiagnosisPolicy(observed, spaces.Box(-1.0, 1.0, (12,)), lambda _: 1e-3, log_std_init=-1.0)
    with torch.no_grad():
        for weights in policy.mlp_extractor.actor.parameters():  # away from its calm beginning
            weights.normal_(0.0, 0.5)
    return policy


@pytest.mark.parametrize("spacecraft", ["orion", "spheres", "msr_chaser"])
def test_it_looks_where_the_fields_of_the_task_are(spacecraft):
    read = Reader.of("thruster_envs/ThrusterMapping-v0", spacecraft=spacecraft)
    n = load(spacecraft).number_of_thrusters
    policy = DiagnosisPolicy(
        spaces.Box(-3.0, 3.0, (18 + 4 * n,)), spaces.Box(-1.0, 1.0, (n,)), lambda _: 1e-3, log_std_init=-1.0
    )
    networks = policy.mlp_extractor
    assert networks.duties == read.columns("duties")
    assert networks.measured == read.columns("measured_on_time")
    assert networks.expected == read.columns("expected_on_time")
    assert networks.belief.start == read.size


def test_what_holds_for_one_thruster_holds_for_all():
    """Swapping what is seen of the thrusters swaps what is believed of them."""
    policy, generator = _policy(), np.random.default_rng(0)
    observations = generator.uniform(0.0, 1.0, (20, 66)).astype(np.float32)
    order = generator.permutation(12)
    swapped = observations.copy()
    for first in (6, 30, 42, 54):
        swapped[:, first : first + 12] = observations[:, first : first + 12][:, order]
    believed, _ = policy.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.predict(swapped, deterministic=True)[0], believed[:, order], atol=1e-6)


def test_the_command_does_not_change_a_diagnosis():
    policy, generator = _policy(), np.random.default_rng(0)
    observations = generator.uniform(0.0, 1.0, (20, 66)).astype(np.float32)
    believed, _ = policy.predict(observations, deterministic=True)
    observations[:, :6] = generator.uniform(-1.0, 1.0, (20, 6))
    np.testing.assert_array_equal(policy.predict(observations, deterministic=True)[0], believed)


def test_another_observation_is_refused():
    with pytest.raises(ValueError, match="has 54 numbers; 66, those of ThrusterMapping-v0 with 12 thrusters"):
        _policy(54)


def test_the_regret_of_a_healthy_vehicle_mapped_perfectly_is_zero(orion):
    mapper = LPMapper(orion)
    plain = make_plain(orion, 6, faults=[], autoreset_mode=AutoresetMode.SAME_STEP)
    env = RegretReward(on_form(plain, "beliefs", orion), mapper)
    env.reset(seed=0)
    for _ in range(40):
        _, regret, *_ = env.step(WHOLE)
        np.testing.assert_allclose(regret, 0.0, atol=1e-9)


def test_the_regret_is_the_reward_but_for_what_the_command_alone_decides(orion):
    """Two ways to answer the same command differ by the same amount in both, up to the scale."""
    rewards, regrets = [], []
    for belief in (WHOLE, -WHOLE):
        plain = make_plain(orion, 6, autoreset_mode=AutoresetMode.SAME_STEP)
        acting = on_form(plain, "beliefs", orion)
        acting.reset(seed=3)
        rewards.append(acting.step(belief)[1])
        env = RegretReward(acting, LPMapper(orion), scale=10.0)
        env.reset(seed=3)
        regrets.append(env.step(belief)[1])
    np.testing.assert_allclose(regrets[0] - regrets[1], 10.0 * (rewards[0] - rewards[1]), atol=1e-12)
