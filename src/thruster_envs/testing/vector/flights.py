"""Flying the vector environment under check, and comparing what two flights returned.

A `VectorSubject` makes as many fresh copies of the environment as a check wants, in one autoreset mode. `fly`
steps one through and keeps copies of everything that it returned; with autoreset DISABLED it resets, by mask,
the copies whose episodes ended, as a user would. `SingleCopy` is the meaning of the three autoreset modes in
a few lines: what copy *i* of a vector environment must return, computed from a single environment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate

from thruster_envs.testing.comparison import Difference, first_difference, info_of_copy, snapshot
from thruster_envs.testing.report import NotApplicable
from thruster_envs.testing.vector.makers import AnyEnv, AnyVectorEnv, VectorFactory

FINAL_KEYS = ("final_obs", "_final_obs", "final_info", "_final_info")
FEW_STEPS = 30  # steps that are enough to tell two random streams apart


@dataclass(frozen=True, kw_only=True)
class VectorSubject:
    """A vector environment under check in one autoreset mode.

    Attributes:
        factory: Makes the vector environment.
        make_single: Makes the environment that every copy must equal, or None when there is none.
        autoreset_mode: The mode that the environment is made in (and must state).
        num_envs: Number of copies.
        steps: How many steps a check flies.
        seed: The seed of the first copy; copy i must behave as a single environment seeded with `seed + i`.
        tolerance: Relative and absolute tolerance on numbers where two flights are compared; 0 asks for equal
            bits.
        ignore_info: Names of entries of `info` that are left out when values are compared.
    """

    factory: VectorFactory
    make_single: Callable[[], AnyEnv] | None
    autoreset_mode: AutoresetMode
    num_envs: int
    steps: int
    seed: int
    tolerance: float = 0.0
    ignore_info: frozenset[str] = frozenset()

    @property
    def other_seed(self) -> int:
        """A seed whose copies share no seed with those of `seed`."""
        return self.seed + 1_000_003

    @contextmanager
    def vector(
        self, num_envs: int | None = None, autoreset_mode: AutoresetMode | None = None
    ) -> Iterator[AnyVectorEnv]:
        """Make a fresh vector environment and close it afterwards."""
        env = self.factory(num_envs or self.num_envs, autoreset_mode or self.autoreset_mode)
        try:
            yield env
        finally:
            env.close()

    @contextmanager
    def singles(self) -> Iterator[list[SingleCopy]]:
        """Make one single environment for each copy and close them afterwards."""
        if self.make_single is None:
            raise NotApplicable("no make_single was given")
        envs = [self.make_single() for _ in range(self.num_envs)]
        try:
            yield [SingleCopy(env, self.autoreset_mode) for env in envs]
        finally:
            for env in envs:
                env.close()

    def actions(self, env: AnyVectorEnv, count: int | None = None, seed: int | None = None) -> list[Any]:
        """Draw the actions of `count` steps (by default `steps`), the same for the same seed."""
        space = batch_space(env.single_action_space, self.num_envs)
        space.seed(self.seed if seed is None else seed)
        return [space.sample() for _ in range(self.steps if count is None else count)]


@dataclass(frozen=True)
class Moment:
    """What one call of `reset` or `step` returned, copied when it was returned.

    Attributes:
        where: The call, as messages name it.
        step: Number of the step, from 1; 0 for the first reset.
        done: (num_envs,) whether the episode of each copy ended in this call.
        starts: (num_envs,) whether the observation of each copy is the first one of an episode.
        rewards, terminations, truncations: None for a reset.
    """

    where: str
    step: int
    observations: Any
    infos: Any
    done: np.ndarray[Any, np.dtype[np.bool_]]
    starts: np.ndarray[Any, np.dtype[np.bool_]]
    rewards: Any = None
    terminations: Any = None
    truncations: Any = None

    def parts(self) -> dict[str, Any]:
        """Everything that was returned, by the name that it has in messages."""
        if self.rewards is None:
            return {"observations": self.observations, "infos": self.infos}
        return {
            "observations": self.observations,
            "rewards": self.rewards,
            "terminations": self.terminations,
            "truncations": self.truncations,
            "infos": self.infos,
        }


class Flight:
    """A vector environment being flown, one call after the other, every return value copied.

    With autoreset DISABLED, `step` is followed by a masked reset of the copies whose episodes ended.
    """

    def __init__(self, env: AnyVectorEnv, autoreset_mode: AutoresetMode) -> None:
        self.env = env
        self.autoreset_mode = autoreset_mode
        self.steps = 0
        self._over = np.zeros(env.num_envs, dtype=np.bool_)

    def reset(self, where: str = "", **arguments: Any) -> Moment:
        """Call `reset`; a mask may be among the options."""
        options = arguments.get("options") or {}
        starts = np.array(options.get("reset_mask", np.ones(self.env.num_envs, dtype=np.bool_)))
        observations, infos = self.env.reset(**arguments)
        self._over = self._over & ~starts
        where = where or ("reset" if self.steps == 0 else f"reset after step {self.steps}")
        none_done = np.zeros(self.env.num_envs, dtype=np.bool_)
        return Moment(where, self.steps, snapshot(observations), snapshot(infos), none_done, starts)

    def step(self, actions: Any, hand_over: bool = False) -> list[Moment]:
        """Call `step`, and reset what ended if that is left to the user: one or two moments.

        Args:
            actions: The batch of actions; the environment gets a copy of it.
            hand_over: Whether the environment gets the very object instead.
        """
        over = self._over
        given = actions if hand_over else snapshot(actions)
        observations, rewards, terminations, truncations, infos = self.env.step(given)
        self.steps += 1
        done = np.array(terminations, dtype=np.bool_) | np.array(truncations, dtype=np.bool_)
        starts = {
            AutoresetMode.NEXT_STEP: over,
            AutoresetMode.SAME_STEP: done,
            AutoresetMode.DISABLED: np.zeros_like(done),
        }[self.autoreset_mode]
        self._over = done
        moment = Moment(
            where=f"step {self.steps}",
            step=self.steps,
            observations=snapshot(observations),
            infos=snapshot(infos),
            done=done,
            starts=starts,
            rewards=snapshot(rewards),
            terminations=snapshot(terminations),
            truncations=snapshot(truncations),
        )
        if self.autoreset_mode is AutoresetMode.DISABLED and done.any():
            where = f"reset of the ended copies after step {self.steps}"
            return [moment, self.reset(where, options={"reset_mask": done.copy()})]
        return [moment]

    def fly(self, actions: Sequence[Any], seed: int) -> list[Moment]:
        """Reset with a seed and step through the actions."""
        self.steps = 0
        moments = [self.reset(seed=seed)]
        for batch in actions:
            moments.extend(self.step(batch))
        return moments


def fly(
    subject: VectorSubject, env: AnyVectorEnv, actions: Sequence[Any], seed: int | None = None
) -> list[Moment]:
    """Fly a vector environment from a seeded reset through a sequence of actions."""
    return Flight(env, subject.autoreset_mode).fly(actions, subject.seed if seed is None else seed)


def rows(space: gym.Space[Any], batch: Any) -> list[Any]:
    """Split a batch of a batched space into the values of its copies."""
    return list(iterate(space, batch))


def batch_of(single_space: gym.Space[Any], values: Sequence[Any]) -> Any:
    """Put values of a single space together to a batch."""
    empty: Any = create_empty_array(single_space, n=len(values))
    return concatenate(single_space, values, empty)


@dataclass(frozen=True)
class Expected:
    """What one copy must return from one call, by the single environment."""

    observation: Any
    info: dict[str, Any]
    reward: float | None = None
    terminated: bool = False
    truncated: bool = False
    final_observation: Any = None
    final_info: dict[str, Any] | None = None

    @property
    def done(self) -> bool:
        """Whether the episode ended in this call."""
        return self.terminated or self.truncated


class SingleCopy:
    """A single environment that behaves as one copy of a vector environment in a given autoreset mode."""

    def __init__(self, env: AnyEnv, autoreset_mode: AutoresetMode) -> None:
        self.env = env
        self.autoreset_mode = autoreset_mode
        self.episode = 1
        self._over = False

    def reset(self, seed: int | None = None) -> Expected:
        """Reset with a seed, or without one to begin the next episode of the same stream."""
        self.episode = 1 if seed is not None else self.episode + 1
        self._over = False
        observation, info = self.env.reset(seed=seed)
        return Expected(snapshot(observation), snapshot(info))

    def step(self, action: Any) -> Expected:
        """Step, with the resets that the autoreset mode puts in."""
        if self._over and self.autoreset_mode is AutoresetMode.NEXT_STEP:
            return replace(self.reset(), reward=0.0)
        observation, reward, terminated, truncated, info = self.env.step(action)
        last = Expected(
            snapshot(observation), snapshot(info), float(reward), bool(terminated), bool(truncated)
        )
        self._over = last.done
        if not last.done or self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return last
        return replace(
            self.reset(),
            reward=last.reward,
            terminated=last.terminated,
            truncated=last.truncated,
            final_observation=last.observation,
            final_info=last.info,
        )


class FlightDifference(NamedTuple):
    """The call in which two flights differ, where in what it returned, and what each of them holds there."""

    call: str
    where: str
    actual: str
    expected: str


def one_flight(subject: VectorSubject) -> list[Moment]:
    """Fly a fresh environment from the seeded reset through all the steps."""
    with subject.vector() as env:
        return fly(subject, env, subject.actions(env))


def without_ignored(subject: VectorSubject, infos: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out of infos, and of the final infos in them, what the user wants ignored."""
    ignored = subject.ignore_info | {f"_{key}" for key in subject.ignore_info}
    kept = {key: value for key, value in infos.items() if key not in ignored}
    if isinstance(kept.get("final_info"), Mapping):
        kept["final_info"] = without_ignored(subject, kept["final_info"])
    return kept


def part_difference(subject: VectorSubject, actual: Any, expected: Any, name: str) -> Difference | None:
    """Compare one returned part; of infos, leave out what the user wants ignored."""
    if name == "infos":
        actual, expected = without_ignored(subject, actual), without_ignored(subject, expected)
    return first_difference(actual, expected, name, subject.tolerance)


def moment_difference(subject: VectorSubject, moment: Moment, right: Moment) -> Difference | None:
    """Find the first difference in what two calls returned for all copies."""
    expected = right.parts()
    for name, part in moment.parts().items():
        difference = part_difference(subject, part, expected[name], name)
        if difference is not None:
            return difference
    return None


def flight_difference(
    subject: VectorSubject, moments: Sequence[Moment], right: Sequence[Moment]
) -> FlightDifference | None:
    """Find the first call whose return values differ between two flights that made the same calls."""
    for moment, expected in zip(moments, right, strict=False):
        difference = moment_difference(subject, moment, expected)
        if difference is not None:
            return FlightDifference(moment.where, *difference)
    return None


def side_by_side(
    moments: Sequence[Moment], others: Sequence[Moment], copy: int, other_copy: int
) -> Iterator[tuple[Moment, Moment]]:
    """Pair the calls of two flights that concern a copy: every step, and every reset that reset it."""
    return zip(
        (moment for moment in moments if moment.rewards is not None or moment.starts[copy]),
        (moment for moment in others if moment.rewards is not None or moment.starts[other_copy]),
        strict=False,  # where one flight resets and the other does not, their last step differed already
    )


def copy_parts(env: AnyVectorEnv, moment: Moment, copy: int) -> dict[str, Any]:
    """What one copy got from a call: everything but its info."""
    parts = {"observation": rows(env.observation_space, moment.observations)[copy]}
    if moment.rewards is not None:
        parts["reward"] = moment.rewards[copy]
        parts["terminated"] = moment.terminations[copy]
        parts["truncated"] = moment.truncations[copy]
    return parts


def copy_difference(
    subject: VectorSubject, env: AnyVectorEnv, moment: Moment, right: Moment, copy: int, right_copy: int
) -> Difference | None:
    """Compare what a copy got from a call with what a copy of another flight got from it, info included."""
    parts, expected = copy_parts(env, moment, copy), copy_parts(env, right, right_copy)
    for name, part in parts.items():
        difference = first_difference(part, expected[name], name, subject.tolerance)
        if difference is not None:
            return difference
    return first_difference(
        _info_of_copy(subject, moment, copy),
        _info_of_copy(subject, right, right_copy),
        "info",
        subject.tolerance,
    )


def _info_of_copy(subject: VectorSubject, moment: Moment, copy: int) -> dict[str, Any]:
    """Take out the info of a copy, with the final ones where its episode ended and only there."""
    infos = without_ignored(subject, moment.infos)
    if not moment.done[copy]:
        infos = {key: value for key, value in infos.items() if key not in FINAL_KEYS}
    return info_of_copy(infos, copy)
