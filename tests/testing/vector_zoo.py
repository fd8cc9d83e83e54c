"""Vector environments with one defect each, and the check that must catch it, with words of its message.

`also` names checks that cannot but fail as well, because the defect breaks what they demand too. `fixed`
makes the environment without the argument `num_envs`, where batches of another size would show it too.
"""

import random
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode

from tests.testing.drift import ACTIONS, OBSERVATIONS, Drift, DriftVector


@dataclass(frozen=True)
class Broken:
    name: str
    make_vector: object
    make_single: object
    check: str
    says: str
    also: frozenset[str]
    modes: tuple[str, ...]
    arguments: dict


BOTH_AUTORESETS = ("NextStep", "SameStep")
ZOO: list[Broken] = []


def caught_by(check, says, *, single=None, also=(), modes=("NextStep",), fixed=False, **arguments):
    def add(cls):
        def of_three(autoreset_mode):
            return cls(3, autoreset_mode)

        name = f"{check}: {cls.__name__}"
        make_vector = of_three if fixed else cls
        ZOO.append(Broken(name, make_vector, single, check, says, frozenset(also), tuple(modes), arguments))
        return cls

    return add


# ---- what it is made of ------------------------------------------------------------------------------------


@caught_by("can_be_made", "ValueError: no such mode; support this mode", modes=BOTH_AUTORESETS)
class RefusesSameStep(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        if autoreset_mode is AutoresetMode.SAME_STEP:
            raise ValueError("no such mode")
        super().__init__(num_envs, autoreset_mode)


@caught_by("can_be_made", "num_envs: is 4 after asking for 3 copies")
class MakesAnotherNumberOfCopies(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs + 1, autoreset_mode)


@caught_by("can_be_made", "second close(): raised RuntimeError")
class ClosesOnlyOnce(DriftVector):
    def close(self):
        if self.closed:
            raise RuntimeError("closed already")
        self.closed = True


@caught_by(
    "spaces", "observation_space: is Box(-8.0, 8.0, (2,), float32), not Box(-8.0, 8.0, (3, 2), float32)"
)
class SpaceIsNotBatched(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.observation_space = OBSERVATIONS


@caught_by("spaces", "single_action_space: is None, not a gymnasium Space; set self.single_action_space")
class SpaceIsMissing(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.single_action_space = None


class WiderDrift(Drift):
    observation_space = Box(-9.0, 9.0, (2,), np.float32)


@caught_by("spaces", "but the single environment has Box(-9.0, 9.0, (2,), float32)", single=WiderDrift)
class SpaceIsNotTheSingleOnes(DriftVector):
    pass


@caught_by("autoreset_mode_is_stated", 'metadata["autoreset_mode"]: is missing; set self.metadata')
class StatesNoMode(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.metadata = {}


@caught_by("autoreset_mode_is_stated", "is 'NextStep', not an AutoresetMode")
class StatesTheModeAsText(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode.value}


@caught_by("autoreset_mode_is_stated", "made with AutoresetMode.SAME_STEP", modes=["SameStep"])
class StatesAnotherMode(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}


@caught_by(
    "autoreset_mode_is_stated", "became AutoresetMode.SAME_STEP when another environment", modes=("NextStep",)
)
class StatesTheModeInTheClass(DriftVector):
    shared = {}  # noqa: RUF012 - the defect

    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.shared["autoreset_mode"] = self.autoreset_mode
        self.metadata = self.shared


@caught_by("reset_returns", "reset(seed): returned a ndarray; return the tuple (observations, infos)")
class ResetsInTheOldWay(DriftVector):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed, options=options)[0]


@caught_by("reset_returns", "reset(seed): observations has dtype float64, its space float32")
class ObservesInDoublePrecision(DriftVector):
    def observations(self):
        return super().observations().astype(np.float64)


@caught_by("reset_returns", "reset(seed): observations has shape (3, 2, 1), its space (3, 2)")
class ObservesInAnotherShape(DriftVector):
    def observations(self):
        return super().observations()[..., np.newaxis]


@caught_by("reset_returns", "infos is a list, not a dict with strings as keys")
class GivesAListOfInfos(DriftVector):
    def infos(self):
        return [{} for _ in range(self.num_envs)]


@caught_by("step_returns", "outside the bounds [-8.0, 8.0] of its space")
class LeavesItsSpace(DriftVector):
    def observations(self):
        return super().observations() + np.float32(20.0) * (self.clock > 2)[:, np.newaxis]


@caught_by("step_returns", "step 1: returned a tuple of 4; return (observations, rewards, terminations")
class StepsInTheOldWay(DriftVector):
    def step(self, actions):
        observations, rewards, terminations, truncations, infos = super().step(actions)
        return observations, rewards, terminations | truncations, infos


@caught_by("step_returns", "step 1: rewards has shape (3, 1); return an array of shape (3,)")
class RewardsInColumns(DriftVector):
    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards[:, np.newaxis], *rest


@caught_by("step_returns", "step 1: rewards has dtype int64; return an array of np.float64")
class RewardsInWholeNumbers(DriftVector):
    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards.astype(np.int64), *rest


@caught_by("step_returns", "step 1: truncations is a list, not an array")
class FlagsAsAList(DriftVector):
    def step(self, actions):
        observations, rewards, terminations, truncations, infos = super().step(actions)
        return observations, rewards, terminations, truncations.tolist(), infos


@caught_by("step_returns", "step 1: terminations has dtype int8; return an array of np.bool_")
class FlagsAsNumbers(DriftVector):
    def step(self, actions):
        observations, rewards, terminations, truncations, infos = super().step(actions)
        return observations, rewards, terminations.astype(np.int8), truncations, infos


@caught_by("infos_have_masks", "reset: infos['extra'] has no mask; add infos['_extra']")
class InfoWithoutMask(DriftVector):
    def infos(self):
        return {**super().infos(), "extra": self.position.copy()}


@caught_by("infos_have_masks", "reset: infos['terms']['extra'] has no mask")
class NestedInfoWithoutMask(DriftVector):
    def infos(self):
        infos = super().infos()
        infos["terms"]["extra"] = self.position.copy()
        return infos


@caught_by("infos_have_masks", "infos['extra'] is list; make it an array with 3 rows")
class InfoAsAList(DriftVector):
    def infos(self):
        every = np.ones(self.num_envs, dtype=np.bool_)
        return {**super().infos(), "extra": self.position.tolist(), "_extra": every}


@caught_by("infos_have_masks", "infos['extra'] is of shape (2, 3); make it an array with 3 rows")
class InfoInColumns(DriftVector):
    def infos(self):
        every = np.ones(self.num_envs, dtype=np.bool_)
        return {**super().infos(), "extra": np.stack([self.position, self.position]), "_extra": every}


@caught_by("infos_have_masks", "infos['_effort'] is [True, True, True]; make it a boolean array")
class MaskAsAList(DriftVector):
    def infos(self):
        infos = super().infos()
        return {**infos, "_effort": infos["_effort"].tolist()}


# ---- what is returned --------------------------------------------------------------------------------------


@caught_by("numbers_are_finite", "infos['ratio'][0] is nan; return a finite number")
class DividesByZero(DriftVector):
    def infos(self):
        every = np.ones(self.num_envs, dtype=np.bool_)
        with np.errstate(invalid="ignore"):
            return {**super().infos(), "ratio": self.effort / (self.clock * self.effort), "_ratio": every}


@caught_by("numbers_are_finite", "rewards[2] is -inf; return a finite number", fixed=True)
class PunishesWithoutBound(DriftVector):
    def rewards(self, actions):
        rewards = super().rewards(actions)
        rewards[2] = -np.inf
        return rewards


@caught_by("episodes_end", "40 steps: no episode ended", max_episode_steps=10_000)
class NeverEnds(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP, max_episode_steps=8):
        super().__init__(num_envs, autoreset_mode, max_episode_steps)

    def step(self, actions):
        self.position *= 0.2
        return super().step(actions)


@caught_by("returned_data_stays", "when it was returned and became 7.0 in a later call; return a copy")
class RevisesWhatItReturned(DriftVector):
    last = None

    def observations(self):
        if self.last is not None:
            self.last[...] = 7.0
        self.last = super().observations()
        return self.last


@caught_by("returned_data_stays", "infos['effort']", also=["returned_data_is_not_shared"])
class ReturnsItsBuffer(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.buffer = np.zeros(num_envs)

    def infos(self):
        self.buffer[...] = self.effort
        return {**super().infos(), "effort": self.buffer}


@caught_by(
    "returned_data_is_not_shared", "shares memory with infos['_effort'] of step 1; return a new object"
)
class ReturnsOneMaskForever(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.mask = np.ones(num_envs, dtype=np.bool_)

    def infos(self):
        self.mask[...] = True
        return {**super().infos(), "_effort": self.mask[:]}


@caught_by("returned_data_may_be_written", "after the arrays of earlier calls were written to; return copies")
class ReturnsItsState(DriftVector):
    def infos(self):
        return {**super().infos(), "effort": self.effort}

    def step(self, actions):
        returned = super().step(actions)
        self.effort = returned[-1]["effort"]
        return returned

    def begin(self, copy):
        self.effort = self.effort.copy()
        super().begin(copy)


@caught_by("actions_are_left_alone", "in the caller's array; work on a copy of the actions")
class ScalesActionsInPlace(DriftVector):
    def accept(self, actions):
        actions = super().accept(actions)
        actions *= np.float32(0.5)
        return actions


@caught_by(
    "actions_are_left_alone", "after the caller reused the action arrays of earlier steps; keep a copy"
)
class KeepsTheActionArray(DriftVector):
    before = None

    def reset(self, *, seed=None, options=None):
        if not (options and "reset_mask" in options):
            self.before = None
        return super().reset(seed=seed, options=options)

    def rewards(self, actions):
        earlier, self.before = self.before, actions
        return super().rewards(actions) - (0.0 if earlier is None else 0.01 * earlier[:, 0])


# ---- seeding -----------------------------------------------------------------------------------------------


@caught_by("seed_reproduces", "with the same seed and actions, and was")
class DrawsNoiseUnseeded(DriftVector):
    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        self.other = np.random.default_rng()

    def noise(self, moving):
        return np.where(moving, self.other.normal(size=self.num_envs), 0.0)


@caught_by("seed_reproduces", "again in the same instance")
class RemembersEarlierEpisodes(DriftVector):
    worn = 0.0

    def rewards(self, actions):
        self.worn += 1e-9
        return super().rewards(actions) - self.worn


@caught_by("seed_reproduces", "in a fresh instance")
class CountsInstances(DriftVector):
    instances = 0

    def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
        super().__init__(num_envs, autoreset_mode)
        CountsInstances.instances += 1
        self.number = CountsInstances.instances

    def rewards(self, actions):
        return super().rewards(actions) - 1e-9 * self.number


@caught_by(
    "seeds_differ",
    "the reset and 30 steps are identical; make reset(seed=...) seed the generator",
    fixed=True,
)
class IgnoresTheSeed(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(None if seed is None else int(seed) * 0, mask)


@caught_by("copies_differ", "copies 0 and 1, given the same actions, are identical for 30 steps", fixed=True)
class SeedsAllCopiesAlike(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(None if seed is None else [int(seed)] * self.num_envs, mask)


@caught_by("reset_goes_on", "three episodes in a row repeat the first one", modes=BOTH_AUTORESETS)
class ReseedsWithTheLastSeed(DriftVector):
    last = None

    def seed_copies(self, seed, mask):
        self.last = self.last if seed is None else seed
        super().seed_copies(self.last, mask)


@caught_by(
    "reset_goes_on", "when the same calls were made before; draw from the generators", modes=BOTH_AUTORESETS
)
class ReseedsByChance(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(np.random.SeedSequence().entropy % 2**31 if seed is None else seed, mask)


@caught_by(
    "autoreset_goes_on",
    "every new episode begins exactly as the first one did",
    modes=BOTH_AUTORESETS,
    fixed=True,
)
class AutoresetRepeats(DriftVector):
    seeds = None

    def seed_copies(self, seed, mask):
        super().seed_copies(seed, mask)
        if seed is not None:
            self.seeds = seed if isinstance(seed, list) else [seed + copy for copy in range(self.num_envs)]

    def begin_by_itself(self, copy):
        self.generators[copy] = np_random(self.seeds[copy])[0]
        self.begin(copy)


@caught_by("autoreset_goes_on", "begins exactly as the second one did", modes=BOTH_AUTORESETS)
class AutoresetSeedsWithZero(DriftVector):
    def begin_by_itself(self, copy):
        self.generators[copy] = np_random(0)[0]
        self.begin(copy)


@caught_by("seed_lists", "with seed=123; seed copy i with the i-th entry of the list")
class TakesListsBackwards(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(seed[::-1] if isinstance(seed, list) else seed, mask)


@caught_by("seed_lists", "where the list is reversed; seed copy i with the i-th entry")
class TakesTheFirstOfAList(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(seed[0] if isinstance(seed, list) else seed, mask)


@caught_by("seed_lists", "with 4 seeds for 3 copies: was accepted")
class TakesLongLists(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(seed[: self.num_envs] if isinstance(seed, list) else seed, mask)


@caught_by("global_random_state_is_untouched", "the global generator of numpy.random was used")
class DrawsFromTheGlobalNumPy(DriftVector):
    def begin(self, copy):
        np.random.random()  # noqa: NPY002 - the defect
        super().begin(copy)


@caught_by("global_random_state_is_untouched", "the global generator of random was used")
class SeedsTheGlobalPython(DriftVector):
    def seed_copies(self, seed, mask):
        random.seed(0 if seed is None else str(seed))
        super().seed_copies(seed, mask)


# ---- independence ------------------------------------------------------------------------------------------


@caught_by("copies_are_independent", "because the other copies were given other actions", fixed=True)
class RewardsTheTeam(DriftVector):
    def rewards(self, actions):
        return super().rewards(actions) + actions.mean()


@caught_by(
    "copies_are_independent",
    "because the other copies were given other actions; give each copy its own state",
    fixed=True,
    modes=BOTH_AUTORESETS,
)
class DrawsStartsFromOneGenerator(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(None if seed is None else int(seed), mask)

    def begin(self, copy):
        super().begin(copy)
        self.position[copy] = self.generators[0].uniform(-1.0, 1.0)

    def noise(self, moving):
        return np.zeros(self.num_envs)


@caught_by("batch_size_does_not_matter", "in a batch of one seeded with 123; seed copy i with seed + i")
class DividesByTheBatch(DriftVector):
    def rewards(self, actions):
        return super().rewards(actions) / self.num_envs


@caught_by("instances_are_independent", "when a second instance is stepped in between; keep state")
class KeepsItsWindInTheClass(DriftVector):
    wind = np.random.default_rng(0)

    def seed_copies(self, seed, mask):
        super().seed_copies(seed, mask)
        if seed is not None:
            KeepsItsWindInTheClass.wind = np.random.default_rng(seed)

    def rewards(self, actions):
        return super().rewards(actions) + self.wind.normal()


class DriftInSinglePrecision(Drift):
    def reward(self):
        return np.float32(super().reward())


@caught_by("equals_single_copies", "step 1, copy 0, episode 1: reward is", single=DriftInSinglePrecision)
class RewardsInDoublePrecision(DriftVector):
    pass


@caught_by(
    "equals_single_copies",
    "but present in the single environment seeded with 123",
    single=Drift,
)
class LeavesOutAnInfo(DriftVector):
    def infos(self):
        infos = super().infos()
        return {"terms": infos["terms"], "_terms": infos["_terms"]}


@caught_by(
    "equals_single_copies", "reset, copy 0, episode 1: observation[0] is", single=Drift, modes=("NextStep",)
)
class SeedsWithAnOffset(DriftVector):
    def seed_copies(self, seed, mask):
        if seed is not None:
            seed = [each + 100 for each in seed] if isinstance(seed, list) else seed + 100
        super().seed_copies(seed, mask)


@caught_by(
    "equals_single_copies",
    "episode 2: observation[0] is",
    single=Drift,
    modes=BOTH_AUTORESETS,
)
class AutoresetDrawsOnceMore(DriftVector):
    def begin_by_itself(self, copy):
        self.generators[copy].uniform()
        self.begin(copy)


# ---- ends of episodes --------------------------------------------------------------------------------------


@caught_by("next_step_autoreset", "rewards is -")
class RewardsTheReset(DriftVector):
    def step(self, actions):
        observations, _, *rest = super().step(actions)
        return observations, self.rewards(actions), *rest


@caught_by("next_step_autoreset", "truncations is True; set truncations to False")
class EndsTwice(DriftVector):
    late = np.zeros(3, dtype=np.bool_)

    def reset(self, *, seed=None, options=None):
        self.late = np.zeros(self.num_envs, dtype=np.bool_)
        return super().reset(seed=seed, options=options)

    def step(self, actions):
        observations, rewards, terminations, truncations, infos = super().step(actions)
        again = self.late & ~terminations
        self.late = truncations.copy()
        return observations, rewards, terminations, truncations | again, infos


@caught_by(
    "next_step_autoreset",
    "with another; ignore the action of a copy that is being reset",
    modes=("NextStep",),
)
class ActsOnTheReset(DriftVector):
    def accept(self, actions):
        self.actions = super().accept(actions).copy()
        return self.actions

    def begin_by_itself(self, copy):
        self.begin(copy)
        self.position[copy] += 0.1 * self.actions[copy, 0]


@caught_by("final_observations", "equals the observation returned with it at each of", modes=["SameStep"])
class FinalObservationIsTheNewOne(DriftVector):
    def step(self, actions):
        *rest, infos = super().step(actions)
        if "final_obs" in infos:
            infos["final_obs"] = self.observations()
        return *rest, infos


@caught_by("final_observations", "infos has no 'final_obs' although an episode ended", modes=["SameStep"])
class NoFinalObservation(DriftVector):
    def final(self, done):
        return {}


@caught_by("final_observations", "infos has no 'final_info'; put the last info", modes=["SameStep"])
class NoFinalInfo(DriftVector):
    def final(self, done):
        return {"final_obs": self.observations(), "_final_obs": done.copy()}


@caught_by(
    "final_observations", "infos['_final_obs'] is [True, True, True] where the ends are", modes=["SameStep"]
)
class FinalMaskIsAlwaysTrue(DriftVector):
    def final(self, done):
        return {**super().final(done), "_final_obs": np.ones(self.num_envs, dtype=np.bool_)}


@caught_by("final_observations", "has dtype float64, its space float32; put the last", modes=["SameStep"])
class FinalObservationInDoublePrecision(DriftVector):
    def final(self, done):
        return {**super().final(done), "final_obs": self.observations().astype(np.float64)}


@caught_by(
    "final_observations",
    "but the last observation of the single environment has",
    single=Drift,
    modes=["SameStep"],
)
class FinalObservationIsRounded(DriftVector):
    def final(self, done):
        return {**super().final(done), "final_obs": np.round(self.observations(), 1)}


@caught_by("final_observations", "final_info of copy", single=Drift, modes=["SameStep"])
class FinalInfoIsOfTheNewEpisode(DriftVector):
    def step(self, actions):
        *rest, infos = super().step(actions)
        if "final_info" in infos:
            infos["final_info"] = self.infos()
        return *rest, infos


# ---- masked resets -----------------------------------------------------------------------------------------


@caught_by(
    "masked_reset",
    "in a copy under the mask, and 0.0 after a reset of all copies",
    also=["masked_reset_with_seed"],
    modes=["Disabled"],
)
class MaskedResetForgetsTheEffort(DriftVector):
    def reset(self, *, seed=None, options=None):
        effort = self.effort.copy()
        observations, infos = super().reset(seed=seed, options=options)
        if options and "reset_mask" in options:
            self.effort = infos["effort"] = effort
            infos["effort"] = effort.copy()
        return observations, infos


@caught_by(
    "masked_reset_leaves_others",
    "without the masked reset; touch neither the state nor the generator",
    also=[
        "copies_are_independent",
        "masked_reset_with_seed",
    ],  # a masked reset is what ends of others bring about
    modes=["Disabled"],
    fixed=True,
)
class MaskedResetResetsAll(DriftVector):
    def accept_mask(self, mask):
        return np.ones_like(super().accept_mask(mask))


@caught_by(
    "masked_reset_leaves_others",
    "in a copy outside the mask",
    also=["masked_reset", "copies_are_independent", "masked_reset_with_seed"],
    modes=["Disabled"],
    fixed=True,
)
class MaskedResetDrawsForAll(DriftVector):
    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        if options and "reset_mask" in options:
            for copy in np.flatnonzero(~options["reset_mask"]):
                self.generators[copy].uniform()
        return returned


@caught_by("masked_reset_with_seed", "in a copy under the mask", modes=["Disabled"])
class MaskedResetIgnoresItsSeed(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(seed if mask.all() else None, mask)


@caught_by("masked_reset_with_seed", "copy 2: observation[0] is", modes=["Disabled"])
class MaskedResetSeedsByRank(DriftVector):
    def seed_copies(self, seed, mask):
        if seed is not None and not isinstance(seed, list):
            rank = np.cumsum(mask) - 1
            seed = [int(seed + each) for each in rank]
        super().seed_copies(seed, mask)


@caught_by("masked_reset_with_seed", "seed only the copies under the mask", modes=["Disabled"])
class MaskedResetSeedsAll(DriftVector):
    def seed_copies(self, seed, mask):
        super().seed_copies(seed, np.ones_like(mask))


@caught_by("bad_reset_masks_are_refused", "with a mask that is a list: was accepted", modes=["Disabled"])
class TakesAListAsMask(DriftVector):
    def accept_mask(self, mask):
        return super().accept_mask(np.array(mask) if isinstance(mask, list) else mask)


@caught_by("bad_reset_masks_are_refused", "with a mask without a True: was accepted", modes=["Disabled"])
class TakesAnEmptyMask(DriftVector):
    def accept_mask(self, mask):
        if isinstance(mask, np.ndarray) and not mask.any():
            return mask
        return super().accept_mask(mask)


@caught_by(
    "bad_reset_masks_are_refused",
    "with a mask of dtype int64: was accepted; raise unless",
    modes=["Disabled"],
)
class TakesNumbersAsMask(DriftVector):
    def accept_mask(self, mask):
        return super().accept_mask(mask.astype(np.bool_) if isinstance(mask, np.ndarray) else mask)


@caught_by("bad_reset_masks_are_refused", "with a mask of shape (4,): was accepted", modes=["Disabled"])
class TakesALongMask(DriftVector):
    def accept_mask(self, mask):
        return super().accept_mask(mask[: self.num_envs])


# ---- bad input ---------------------------------------------------------------------------------------------


@caught_by("bad_actions_are_refused", "step with actions for one copy, without a batch axis: was accepted")
class BroadcastsActions(DriftVector):
    def accept(self, actions):
        return np.broadcast_to(actions, self.action_space.shape)


@caught_by("bad_actions_are_refused", "for a batch of 4: was accepted by an environment of 3 copies")
class TakesTooManyActions(DriftVector):
    def accept(self, actions):
        return super().accept(actions[: self.num_envs])


@caught_by("bad_actions_are_refused", "of twice the length: was accepted")
class TakesLongActions(DriftVector):
    def accept(self, actions):
        return super().accept(actions[:, : ACTIONS.shape[0]])


@caught_by("step_returns", "the environment raised ZeroDivisionError: out of fuel; make it run through")
class Crashes(DriftVector):
    def rewards(self, actions):
        if self.clock.max() > 5:
            raise ZeroDivisionError("out of fuel")
        return super().rewards(actions)
