"""Formations as PettingZoo's parallel environments pass PettingZoo's own tests and ours."""

import warnings

import numpy as np
import pettingzoo
import pytest

from tests.views.cases import FAULTS, faults_of
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.faults import Fault
from thruster_envs.tasks import FormationAttitude
from thruster_envs.testing import check_parallel_env
from thruster_envs.views import FormationAttitudeParallelEnv, FormationParallelEnv, SharedPolicyVecEnv

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # PettingZoo's tests import their examples in a deprecated way
    from pettingzoo.test import api_test, max_cycles_test, parallel_api_test, render_test


#: Module and faults that its craft can have.
FORMATIONS = {
    "formation_keeping_v1": (formation_keeping_v1, FAULTS),
    "formation_attitude_v1": (formation_attitude_v1, faults_of("thruster_envs/FormationAttitude-v1")),
}
formations = pytest.mark.parametrize(("module", "faults"), FORMATIONS.values(), ids=FORMATIONS.keys())


def hold(env, duty=-0.98):
    return {agent: np.full(12, duty, np.float32) for agent in env.agents}


@formations
def test_pettingzoos_parallel_api_test_passes(module, faults):
    parallel_api_test(module.parallel_env(faults=faults), num_cycles=200)


@formations
@pytest.mark.filterwarnings("ignore:Action space for each agent probably")  # three choices are as good as one
def test_pettingzoos_api_test_passes_through_its_conversion(module, faults):
    api_test(module.env(faults=faults), num_cycles=200)


@formations
def test_pettingzoos_render_test_passes(module, faults):
    render_test(lambda **options: module.env(faults=faults, **options))


@formations
def test_pettingzoos_max_cycles_test_passes(module, faults):
    max_cycles_test(module)


@formations
def test_our_own_checks_pass_over_many_steps_and_in_another_process(module, faults):
    report = check_parallel_env(
        module.parallel_env,
        steps=120,
        another_process=True,
        craft=4,
        faults=faults,
        max_cycles=25,
    )
    assert not report.failures


@pytest.mark.parametrize("options", [{"action": "duties"}, {"command_leader": True}, {"commanded": 1}])
def test_every_form_of_the_turning_formation_passes_our_own_checks(options):
    faults = faults_of("thruster_envs/FormationAttitude-v1")
    report = check_parallel_env(
        formation_attitude_v1.parallel_env, steps=40, faults=faults, max_cycles=15, **options
    )
    assert not report.failures


@pytest.mark.skipif(not hasattr(pettingzoo, "make"), reason="PettingZoo has tables from 1.27 on")
def test_they_stand_in_both_tables_of_pettingzoo():
    env = pettingzoo.make("parallel", "thruster_envs/formation_keeping_v1", craft=2)
    assert isinstance(env.unwrapped, FormationParallelEnv)
    assert len(env.possible_agents) == 2
    turns = pettingzoo.make("aec", "thruster_envs/formation_keeping_v1", craft=5)
    turns.reset(seed=0)
    assert turns.agents == [f"craft_{k}" for k in range(1, 6)]
    env = pettingzoo.make("parallel", "thruster_envs/formation_attitude_v1", craft=2)
    assert isinstance(env.unwrapped, FormationAttitudeParallelEnv)
    assert env.possible_agents == ["follower_1"]
    turns = pettingzoo.make("aec", "thruster_envs/formation_attitude_v1", craft=3, command_leader=True)
    turns.reset(seed=0)
    assert turns.agents == ["leader", "follower_1", "follower_2"]


def test_all_agents_stay_until_the_end_and_end_together():
    env = formation_keeping_v1.parallel_env(max_cycles=10, craft=8)
    for seed in range(3):
        env.reset(seed=seed)
        for cycle in range(1, 11):
            assert env.agents == env.possible_agents
            observations, rewards, terminations, truncations, infos = env.step(hold(env))
            for returned in (observations, rewards, terminations, truncations, infos):
                assert list(returned) == env.possible_agents
            assert set(truncations.values()) == {cycle == 10}
            assert set(terminations.values()) == {False}
        assert env.agents == []
        with pytest.raises(ValueError, match="reset"):
            env.step({})


def test_a_lost_craft_ends_the_episode_for_all():
    env = formation_keeping_v1.parallel_env()
    env.reset(seed=0)
    actions = hold(env)
    spin = np.full(12, -1.0, np.float32)
    torque = env.task.vehicle.effectiveness()[3]
    spin[torque > 0.0] = 1.0
    actions["craft_2"] = spin
    for _ in range(120):
        _, _, terminations, _, infos = env.step(actions)
        if terminations["craft_1"]:
            break
    assert set(terminations.values()) == {True}
    assert not any(info["success"] for info in infos.values())


def test_each_agent_is_told_of_its_own_faults():
    env = formation_keeping_v1.parallel_env(
        faults=[Fault(4, "leak", severity=0.5, craft=2), Fault(9, "loss", craft=3)]
    )
    _, infos = env.reset(seed=0)
    assert [int(infos[agent]["fault"]["thruster"][0]) for agent in env.agents] == [0, 4, 9]
    _, infos = env.reset(seed=0, options={"faults": [Fault(1, "stuck_on")], "unknown": "left alone"})
    assert [int(infos[agent]["fault"]["thruster"][0]) for agent in env.agents] == [1, 0, 0]


def test_the_rows_of_the_shared_policy_are_the_agents():
    env = formation_keeping_v1.parallel_env(faults=FAULTS)
    rows = SharedPolicyVecEnv(2, faults=FAULTS)
    rows.seed(30)  # SB3 gives row k the seed 30 + k, and a world that of its first row
    batch = rows.reset()
    observations, _ = env.reset(seed=33)
    generator = np.random.default_rng(0)
    for _ in range(10):
        assert np.array_equal(np.stack(list(observations.values())), batch[3:])
        action = generator.uniform(-1.0, -0.5, (6, 12)).astype(np.float32)
        batch, rewards, _, _ = rows.step(action)
        observations, each, _, _, _ = env.step(dict(zip(env.agents, action[3:], strict=True)))
        assert np.array_equal(np.array(list(each.values()), np.float32), rewards[3:])


def test_the_rows_of_the_shared_policy_are_the_agents_of_the_turning_formation():
    faults = faults_of("thruster_envs/FormationAttitude-v1")
    env = formation_attitude_v1.parallel_env(faults=faults, command_leader=True)
    rows = SharedPolicyVecEnv(2, task_type=FormationAttitude, faults=faults, command_leader=True)
    rows.seed(30)
    batch = rows.reset()
    observations, _ = env.reset(seed=33)
    generator = np.random.default_rng(0)
    for _ in range(10):
        assert np.array_equal(np.stack(list(observations.values())), batch[3:])
        action = generator.integers(0, 3, (6, 3))
        batch, rewards, _, _ = rows.step(action)
        observations, each, _, _, _ = env.step(dict(zip(env.agents, action[3:], strict=True)))
        assert np.array_equal(np.array(list(each.values()), np.float32), rewards[3:])


def test_the_state_is_all_observations_and_lies_in_its_space():
    env = formation_keeping_v1.parallel_env()
    observations, _ = env.reset(seed=0)
    assert env.state() in env.state_space
    assert np.array_equal(env.state(), np.concatenate([observations[agent] for agent in env.agents]))


def test_a_missing_or_misshapen_action_is_named():
    env = formation_keeping_v1.parallel_env()
    env.reset(seed=0)
    actions = hold(env)
    del actions["craft_3"]
    with pytest.raises(ValueError, match="no action for craft_3"):
        env.step(actions)
    actions["craft_3"] = np.zeros(11)
    with pytest.raises(ValueError, match=r"the action of craft_3 has the shape \(11,\); \(12,\) would be"):
        env.step(actions)
    with pytest.raises(ValueError, match="craft is 9; a whole number from 2 to 8"):
        formation_keeping_v1.parallel_env(craft=9)
    with pytest.raises(TypeError, match="max_cycles"):
        formation_keeping_v1.parallel_env(max_cycle=3)
