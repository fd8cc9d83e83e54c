"""A copy, by ``copy`` or ``pickle``, lives on as the original does, bit for bit: state, seeds and pictures.

Before the first reset, in the middle of an episode, after a picture and after ``close``.
"""

import copy
import pickle
from functools import partial

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest

from tests.processes.flights import digest
from tests.views.cases import FAULTS, IDS, actions_of, faults_of
from thruster_baselines.mapping import CarryingMapper, LPMapper, MinimumPulseMapper
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.tasks import FormationAttitude
from thruster_envs.views import (
    BeliefAction,
    HoldAction,
    MapperAction,
    SB3VecEnv,
    SharedPolicyVecEnv,
    VectorBeliefAction,
    VectorHoldAction,
    VectorMapperAction,
)

STEPS = 2
MAPPING, ORION = "thruster_envs/ThrusterMapping-v0", "thruster_envs/OrionRendezvous-v1"
FILM = {"render_mode": "rgb_array"}

COPIES = (
    copy.deepcopy,
    lambda env: pickle.loads(pickle.dumps(env)),
    lambda env: cloudpickle.loads(cloudpickle.dumps(env)),
)


class Gymnasium:
    """How an environment of Gymnasium, single or a batch, is flown."""

    def __init__(self, identifier, *, worlds=None, wrap=lambda env: env):
        self.worlds = worlds
        if worlds is None:
            self.env = wrap(gym.make(identifier, faults=faults_of(identifier), **FILM))
        else:
            self.env = wrap(gym.make_vec(identifier, num_envs=worlds, faults=faults_of(identifier), **FILM))
        wrapped = self.env.action_space != self.env.unwrapped.action_space
        self.actions = None if wrapped else actions_of(identifier, 0, STEPS)

    def begin(self, env, seed):
        return env.reset(seed=seed)

    def go_on(self, env):
        for step in range(STEPS):
            if self.actions is None:
                action = np.full(env.action_space.shape, 0.1, np.float32)
            else:
                action = (
                    self.actions[step]
                    if self.worlds is None
                    else np.stack([self.actions[step]] * self.worlds)
                )
            yield from env.step(action)
        yield np.asarray(env.render())
        env.action_space.seed(1)
        yield env.action_space.sample()
        yield from env.reset()  # the next episode of the same seed
        yield env.unwrapped.np_random.integers(2**62, size=2)

    def picture(self, env):
        return env.render()


class PettingZoo:
    """How a formation is flown, all agents at once or one after another."""

    def __init__(self, make):
        self.env = make(**FILM)

    def begin(self, env, seed):
        env.reset(seed=seed)
        return (env.state(),)

    def go_on(self, env):
        if hasattr(env, "agent_selection"):
            for _ in range(STEPS * len(env.possible_agents)):
                agent = env.agent_selection
                env.step(np.zeros_like(env.action_space(agent).sample()))
                yield from env.last()
        else:
            for _ in range(STEPS):
                actions = {a: np.zeros_like(env.action_space(a).sample()) for a in env.agents}
                yield from env.step(actions)
        yield env.render()
        env.reset()
        yield env.state()

    def picture(self, env):
        return env.render()


class StableBaselines:
    """How a ``VecEnv`` is flown."""

    def __init__(self, env):
        self.env = env

    def begin(self, env, seed):
        env.seed(seed)
        return (env.reset(),)

    def go_on(self, env):
        for _ in range(STEPS):
            action = np.zeros_like(env.action_space.sample())
            yield from env.step(np.stack([action] * env.num_envs))[:3]
            yield env.latest_info()
        yield env.reset()

    def picture(self, env):
        return env.get_images()


def carrying():
    return CarryingMapper(MinimumPulseMapper("spheres"))


CASES = {
    **{identifier: partial(Gymnasium, identifier) for identifier in IDS},
    **{f"{identifier} batch": partial(Gymnasium, identifier, worlds=2) for identifier in IDS},
    "mapper": lambda: Gymnasium(ORION, wrap=lambda env: MapperAction(env, LPMapper("orion"))),
    "mapper, batch": lambda: Gymnasium(
        ORION, worlds=2, wrap=lambda env: VectorMapperAction(env, LPMapper("orion"))
    ),
    "belief": lambda: Gymnasium(MAPPING, wrap=lambda env: BeliefAction(env, LPMapper("orion"))),
    "belief, batch": lambda: Gymnasium(
        MAPPING, worlds=2, wrap=lambda env: VectorBeliefAction(env, LPMapper("orion"))
    ),
    "hold": lambda: Gymnasium(ORION, wrap=lambda env: HoldAction(env, 2)),
    "hold, batch": lambda: Gymnasium(ORION, worlds=2, wrap=lambda env: VectorHoldAction(env, 2)),
    "formation": lambda: PettingZoo(partial(formation_keeping_v1.parallel_env, faults=FAULTS)),
    "formation, one by one": lambda: PettingZoo(partial(formation_keeping_v1.env, faults=FAULTS)),
    "attitudes": lambda: PettingZoo(formation_attitude_v1.parallel_env),
    "attitudes, one by one": lambda: PettingZoo(formation_attitude_v1.env),
    "VecEnv": lambda: StableBaselines(SB3VecEnv(gym.make_vec(ORION, num_envs=2, faults=FAULTS, **FILM))),
    "shared policy": lambda: StableBaselines(SharedPolicyVecEnv(2, faults=FAULTS)),
    "shared policy, attitudes": lambda: StableBaselines(SharedPolicyVecEnv(2, task_type=FormationAttitude)),
}


def digests(parts):
    return [digest(part) for part in parts]


@pytest.mark.parametrize("case", CASES)
def test_a_copy_lives_on_as_the_original_does(case):
    flight = CASES[case]()
    env = flight.env
    early = [make(env) for make in COPIES]
    right = digests(flight.begin(env, 3))
    for one in early:
        assert digests(flight.begin(one, 3)) == right
    for _ in range(2):  # in the first episode, then in one that was begun without a seed and filmed
        copies = [make(env) for make in COPIES]
        right = digests(flight.go_on(env))
        for one in copies:
            assert digests(flight.go_on(one)) == right
            one.close()
        flight.picture(env)
    env.close()
    late = copy.deepcopy(env)
    right = digests(flight.begin(env, 4))
    assert digests(flight.begin(late, 4)) == right


def test_a_mapper_takes_its_memory_along():
    env = MapperAction(gym.make(MAPPING, spacecraft="spheres"), carrying())
    env.reset(seed=0)
    env.step(np.full(6, 0.01, np.float32))
    copies = [make(env) for make in COPIES]
    right = env.step(np.full(6, 0.01, np.float32))
    assert np.abs(right[-1]["remainder"]).max() > 0.0
    for one in copies:
        assert digests(one.step(np.full(6, 0.01, np.float32))) == digests(right)


def test_a_copy_of_what_has_a_window_has_its_own(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make(MAPPING, render_mode="human")
    env.reset(seed=0)
    other = pickle.loads(pickle.dumps(env))
    env.close()
    action = np.full(12, -1.0, np.float32)
    assert digests(other.step(action)) == digests(env.step(action))
    other.close()
    env.close()
