"""Parallel environments with one defect each, and the check that must catch it, with words of its message."""

import itertools
from dataclasses import dataclass, field

import numpy as np

from tests.testing.drift import DriftParallel


@dataclass(frozen=True)
class Broken:
    make_env: type
    check: str
    says: str
    arguments: dict = field(default_factory=dict)

    @property
    def name(self):
        return f"{self.check}: {self.make_env.__name__}"


ZOO: list[Broken] = []


def caught_by(check, says, **arguments):
    def add(cls):
        ZOO.append(Broken(cls, check, says, arguments))
        return cls

    return add


@caught_by("spaces_of_agents", "action_space('left'): is another object in every call")
class MakesSpacesAnew(DriftParallel):
    def action_space(self, agent):
        space = super().action_space(agent)
        return type(space)(space.low, space.high, dtype=space.dtype)


@caught_by("spaces_of_agents", "possible_agents: is ['left', 'left']; make it a list of different names")
class NamesAgentsAlike(DriftParallel):
    def __init__(self):
        super().__init__()
        self.possible_agents = ["left", "left"]


@caught_by("reset_returns", "reset(seed=...): returned a dict; return the tuple (observations, infos)")
class ResetsInTheOldWay(DriftParallel):
    def reset(self, seed=None, options=None):
        return super().reset(seed, options)[0]


@caught_by(
    "reset_returns", "agents is ['left'], possible_agents ['left', 'right']; begin every episode with all"
)
class BeginsWithOne(DriftParallel):
    def reset(self, seed=None, options=None):
        returned = super().reset(seed, options)
        self.agents = ["left"]
        return returned


@caught_by("reset_returns", "observations['left'] has dtype float64, its space float32")
class ObservesInDoublePrecision(DriftParallel):
    def observations(self):
        return {agent: seen.astype(np.float64) for agent, seen in super().observations().items()}


@caught_by("step_returns", "rewards['left'] is a float32; return a float")
class RewardsInSinglePrecision(DriftParallel):
    def rewards(self):
        return {agent: np.float32(reward) for agent, reward in super().rewards().items()}


@caught_by("step_returns", "terminations['left'] is a bool; return a bool")
class FlagsOfNumPy(DriftParallel):
    def ended(self):
        terminations, truncations = super().ended()
        return {agent: np.bool_(flag) for agent, flag in terminations.items()}, truncations


@caught_by("step_returns", "infos has the agents ['left'] instead of ['left', 'right']")
class ForgetsAnInfo(DriftParallel):
    clock = 0

    def infos(self):
        infos = super().infos()
        if self.clock == 5:
            del infos["right"]
        return infos


@caught_by(
    "agents_stay", "the episode ended for ['left'] only; end the episode of all agents in the same step"
)
class LosesOneAgent(DriftParallel):
    def step(self, actions):
        observations, rewards, terminations, truncations, infos = super().step(actions)
        if self.clock == 3 and len(self.agents) == 2:
            self.agents = ["right"]
            terminations["left"] = True
        return tuple(
            {agent: part[agent] for agent in actions}
            for part in (observations, rewards, terminations, truncations, infos)
        )


@caught_by("agents_stay", "agents lost ['right'] although their episode did not end")
class AnAgentVanishes(DriftParallel):
    def step(self, actions):
        returned = super().step(actions)
        if self.clock == 3 and len(self.agents) == 2:
            self.agents = ["left"]
        return tuple({agent: part[agent] for agent in actions} for part in returned)


@caught_by("agents_stay", "the episode ended but agents is still ['left', 'right']; set self.agents = []")
class AgentsNeverLeave(DriftParallel):
    def step(self, actions):
        returned = super().step(actions)
        self.agents = self.possible_agents[:] if self.clock < 12 else []
        return returned


@caught_by("episodes_end", "60 steps: no episode ended", max_cycles=10_000)
class NeverEnds(DriftParallel):
    def step(self, actions):
        self.positions = {agent: 0.2 * position for agent, position in self.positions.items()}
        return super().step(actions)


@caught_by("numbers_are_finite", "step 4: infos['right']['miss'] is nan")
class LosesAMeasurement(DriftParallel):
    def infos(self):
        infos = super().infos()
        if self.clock == 4:
            infos["right"]["miss"] = float("nan")
        return infos


@caught_by("returned_data_stays", "when it was returned and became 7.0 in a later call; return a copy")
class RevisesWhatItReturned(DriftParallel):
    last = None

    def observations(self):
        if self.last is not None:
            self.last["left"][...] = 7.0
        self.last = super().observations()
        return dict(self.last)


@caught_by("returned_data_is_not_shared", "shares memory with infos['left']['limits'] of step 1")
class ReturnsAConstantArray(DriftParallel):
    limits = np.array([-2.0, 2.0])

    def infos(self):
        return {agent: {**info, "limits": self.limits} for agent, info in super().infos().items()}


@caught_by("actions_are_left_alone", "in what the caller passed; work on a copy of the actions")
class ScalesActionsInPlace(DriftParallel):
    def step(self, actions):
        actions["left"] *= np.float32(0.5)
        return super().step(actions)


@caught_by("actions_are_left_alone", "after the caller reused the action arrays of earlier steps")
class KeepsTheActionArray(DriftParallel):
    before = None

    def reset(self, seed=None, options=None):
        self.before = None
        return super().reset(seed, options)

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        if self.before is not None:
            rewards["left"] -= 0.01 * float(self.before[0])
        self.before = actions["left"]
        return observations, rewards, *rest


@caught_by("seed_reproduces", "step 3: returned['infos']['left']['luck'] is")
class IsRandomFromTheThirdStepOn(DriftParallel):
    """What the seed test of PettingZoo 1.27 does not see: it compares one step, and no infos."""

    def infos(self):
        luck = np.random.default_rng().normal() if self.clock >= 3 else 0.0
        return {agent: {**info, "luck": luck} for agent, info in super().infos().items()}


@caught_by("seed_reproduces", "again in the same instance")
class RemembersEarlierEpisodes(DriftParallel):
    worn = 0.0

    def rewards(self):
        self.worn += 1e-9
        return {agent: reward - self.worn for agent, reward in super().rewards().items()}


@caught_by("seed_reproduces", "in a fresh instance")
class CountsInstances(DriftParallel):
    numbers = itertools.count()

    def __init__(self):
        super().__init__()
        self.number = next(self.numbers)

    def infos(self):
        return {agent: {**info, "number": self.number} for agent, info in super().infos().items()}


@caught_by("seeds_differ", "the reset and 30 steps are identical; make reset(seed=...) seed the generator")
class IgnoresTheSeed(DriftParallel):
    def seed(self, seed):
        super().seed(None if seed is None else 0)


@caught_by("reset_goes_on", "three times in a row the reset and 30 steps repeat the first ones")
class ReseedsWithTheLastSeed(DriftParallel):
    last = None

    def seed(self, seed):
        self.last = self.last if seed is None else seed
        super().seed(self.last)


@caught_by("global_random_state_is_untouched", "the global generator of numpy.random was used")
class DrawsFromTheGlobalNumPy(DriftParallel):
    def noise(self):
        np.random.random()  # noqa: NPY002 - the defect
        return super().noise()


@caught_by(
    "seed_reproduces_in_another_process", "in another process with the same seed", another_process=True
)
class DependsOnTheOrderOfASet(DriftParallel):
    def infos(self):
        first = hash("left") % 1000
        return {agent: {**info, "first": first} for agent, info in super().infos().items()}
