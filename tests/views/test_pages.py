"""The page of an environment says what the environment is."""

import dataclasses
import re

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import IDS
from thruster_envs.observations import page_rows
from thruster_envs.views import FormationAttitudeParallelEnv, FormationParallelEnv

ROW = re.compile(r"^\s*\| (\d+)(?:-(\d+))? \| (.+?) \| (-?[\d.]+) \| (-?[\d.]+) \| (.+?) \|$", re.MULTILINE)
SECTIONS = (
    "Description", "Action Space", "Observation Space", "Rewards", "Starting State", "Episode End",
    "Information", "Arguments", "Version History",
)  # fmt: skip


def sections(page):
    parts = re.split(r"^\s*## (.+)$", page, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def check_page(page, task, observation_space, action_space):
    parts = sections(page)
    assert tuple(parts) == SECTIONS
    rows = [
        (int(first), int(last or first), meaning, float(low), float(high), unit)
        for first, last, meaning, low, high, unit in ROW.findall(parts["Observation Space"])
    ]
    written = [line.strip() for line in parts["Observation Space"].splitlines()]
    assert [line for line in written if re.match(r"\| \d", line)] == page_rows(task.fields)
    start = sum(field.size for field in task.fields)
    for first, last, _, low, high, _ in rows:
        assert (observation_space.low[first : last + 1] == np.float32(low)).all()
        assert (observation_space.high[first : last + 1] == np.float32(high)).all()
    assert observation_space.shape == (start,)
    if isinstance(action_space, gym.spaces.Box):
        lows, highs = action_space.low, action_space.high
    else:
        options = np.atleast_1d(getattr(action_space, "nvec", getattr(action_space, "n", None)))
        lows, highs = 0.0 * options, options - 1
    start = 0
    for first, last, _, low, high, _ in ROW.findall(parts["Action Space"]):
        assert int(first) == start
        start = int(last or first) + 1
        assert (lows[int(first) : start] == float(low)).all()
        assert (highs[int(first) : start] == float(high)).all()
    assert lows.shape == (start,)
    for term in task.reward_terms:
        assert f"- `{term}`:" in parts["Rewards"]


@pytest.mark.parametrize("identifier", IDS)
def test_the_tables_of_a_page_are_those_of_the_spaces(identifier):
    env = gym.make(identifier, observe_fault=True).unwrapped
    check_page(type(env).__doc__, env.task, env.observation_space, env.action_space)
    without = gym.make(identifier).unwrapped
    assert f"`Box(..., {without.observation_space.shape}, float32)`" in type(env).__doc__


@pytest.mark.parametrize("identifier", IDS)
def test_a_page_names_every_entry_of_info_and_every_argument(identifier):
    env = gym.make(identifier).unwrapped
    parts = sections(type(env).__doc__)
    _, info = env.reset(seed=0)
    for key in info:
        assert f"- `{key}`:" in parts["Information"]
    for field in dataclasses.fields(env.task):
        if field.init and field.name not in env.task.one_agent:
            assert f"`{field.name}`" in parts["Arguments"]


@pytest.mark.parametrize("environment", [FormationParallelEnv, FormationAttitudeParallelEnv])
def test_the_page_of_a_parallel_environment_is_right_too(environment):
    env = environment(observe_fault=True)
    agent = env.possible_agents[0]
    check_page(type(env).__doc__, env.task, env.observation_space(agent), env.action_space(agent))
    parts = sections(type(env).__doc__)
    _, infos = env.reset(seed=0)
    for key in infos[agent]:
        assert f"- `{key}`:" in parts["Information"]
