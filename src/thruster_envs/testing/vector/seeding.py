"""Seeds: equal ones reproduce, different ones differ, and no seed means going on.

A reset that ignores its seed passes every test that only asks for equality, so differences are asked for as
well.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from copy import deepcopy
from itertools import combinations
from typing import Any

import numpy as np

from thruster_envs.testing.comparison import first_difference
from thruster_envs.testing.report import NotApplicable, fail
from thruster_envs.testing.vector.flights import (
    FEW_STEPS,
    Flight,
    Moment,
    VectorSubject,
    batch_of,
    copy_parts,
    flight_difference,
    fly,
    moment_difference,
    part_difference,
    rows,
    side_by_side,
)
from thruster_envs.testing.vector.makers import AnyVectorEnv


def check_seed_reproduces(subject: VectorSubject) -> None:
    """The same seed and actions give the same flight, again in the same instance and in a fresh one."""
    with subject.vector() as env, subject.vector() as fresh:
        actions = subject.actions(env)
        first = fly(subject, env, actions)
        for whose, other in (("again in the same instance", env), ("in a fresh instance", fresh)):
            for moment, right in zip(fly(subject, other, actions), first, strict=False):
                difference = moment_difference(subject, moment, right)
                if difference is not None:
                    fail(
                        moment.where,
                        f"{difference.where} is {difference.actual} {whose} with the same seed and actions, "
                        f"and was {difference.expected} the first time",
                        "draw every random number from generators that reset(seed=...) seeds, and reset all "
                        "state",
                    )


def check_seeds_differ(subject: VectorSubject) -> None:
    """Different seeds give different flights: a reset that ignores its seed reproduces perfectly."""
    with subject.vector() as env:
        actions = subject.actions(env, min(subject.steps, FEW_STEPS))
        one = fly(subject, env, actions)
        other = fly(subject, env, actions, seed=subject.other_seed)
        same = all(_copy_repeats(env, one, other, copy, copy) for copy in range(subject.num_envs))
    if same:
        fail(
            f"reset(seed={subject.seed}) and reset(seed={subject.other_seed})",
            f"the reset and {len(actions)} steps are identical",
            "make reset(seed=...) seed the generator that the environment draws from, or skip this check if "
            "nothing in the environment is random",
        )


def check_copies_differ(subject: VectorSubject) -> None:
    """Copies of one batch, given the same actions, live through different episodes."""
    with subject.vector() as env:
        same = [
            batch_of(env.single_action_space, [rows(env.action_space, batch)[0]] * subject.num_envs)
            for batch in subject.actions(env, min(subject.steps, FEW_STEPS))
        ]
        moments = fly(subject, env, same)
        for one, other in combinations(range(subject.num_envs), 2):
            if _copy_repeats(env, moments, moments, one, other):
                fail(
                    f"reset(seed={subject.seed})",
                    f"copies {one} and {other}, given the same actions, are identical for {len(same)} steps",
                    "seed copy i with seed + i, not all alike, or skip this check if nothing is random",
                )


def check_reset_goes_on(subject: VectorSubject) -> None:
    """`reset()` without a seed begins new episodes of the same streams: they neither repeat nor surprise."""
    count = min(subject.steps, FEW_STEPS)
    with subject.vector() as env:
        flight = Flight(env, subject.autoreset_mode)
        actions = subject.actions(env, count)

        def episodes() -> list[list[Moment]]:
            flown = [flight.fly(actions, subject.seed)]
            for _ in range(3):
                start = flight.reset()
                flown.append([start, *(moment for batch in actions for moment in flight.step(batch))])
            return flown

        first, again = episodes(), episodes()
        for number, (one, other) in enumerate(zip(first, again, strict=True)):
            difference = flight_difference(subject, other, one)
            if difference:
                fail(
                    f"reset() number {number} after reset(seed={subject.seed})",
                    f"{difference.where} is {difference.actual} and was {difference.expected} when the same "
                    "calls were made before",
                    "draw from the generators that reset(seed=...) left behind, and from nothing else",
                )
        for copy in range(subject.num_envs):
            if all(_copy_repeats(env, first[0], later, copy, copy) for later in first[1:]):
                fail(
                    f"reset() after reset(seed={subject.seed}), copy {copy}",
                    f"three episodes in a row repeat the first one for {count} steps",
                    "seed only when seed is not None and let the generator go on otherwise, or skip this "
                    "check if nothing is random",
                )


def check_autoreset_goes_on(subject: VectorSubject) -> None:
    """Episodes that begin by themselves are new ones: an autoreset does not reseed."""
    with subject.vector() as env:
        moments = fly(subject, env, subject.actions(env))
        elsewhere, _ = env.reset(seed=subject.other_seed)
        starts: list[list[Any]] = [[] for _ in range(subject.num_envs)]
        for moment in moments:
            for copy, observation in enumerate(rows(env.observation_space, moment.observations)):
                if moment.starts[copy]:
                    starts[copy].append(observation)
        if first_difference(elsewhere, moments[0].observations) is None:
            raise NotApplicable("episodes always begin with the same observation")
    if max(map(len, starts)) < 2:
        raise NotApplicable(f"no episode ended and began again within {subject.steps} steps")
    remedy = "let an autoreset draw from the copy's own generator as it stands, without seeding it"
    if all(_all_equal(of_copy) for of_copy in starts):
        fail("autoreset", "every new episode begins exactly as the first one did", remedy)
    later = [of_copy[1:] for of_copy in starts if len(of_copy) > 2]
    if later and all(_all_equal(of_copy) for of_copy in later):
        fail("autoreset", "every episode after the first begins exactly as the second one did", remedy)


def check_seed_lists(subject: VectorSubject) -> None:
    """Where `reset` takes a list of seeds, copy i gets entry i, and a wrong length is refused."""
    seeds = [subject.other_seed + 7 * copy for copy in reversed(range(subject.num_envs))]
    in_a_row = [subject.seed + copy for copy in range(subject.num_envs)]
    with subject.vector() as env:
        reset = Flight(env, subject.autoreset_mode).reset
        try:
            reset(seed=seeds)
        except Exception as error:
            raise NotApplicable(f"reset(seed=[...]) raises {type(error).__name__}") from error
        by_list = reset(seed=in_a_row)
        by_number = reset(seed=subject.seed)
        difference = moment_difference(subject, by_list, by_number)
        if difference is not None:
            fail(
                f"reset(seed={in_a_row})",
                f"{difference.where} is {difference.actual}, and {difference.expected} with "
                f"seed={subject.seed}",
                "seed copy i with the i-th entry of the list, and with seed + i if seed is a number",
            )
        in_order = reset(seed=seeds)
        reverse = reset(seed=seeds[::-1])
        forth, back = (rows(env.observation_space, each.observations) for each in (in_order, reverse))
        for copy in range(subject.num_envs):
            difference = part_difference(subject, forth[copy], back[-1 - copy], f"observation of copy {copy}")
            if difference is not None:
                fail(
                    f"reset(seed={seeds})",
                    f"{difference.where} is {difference.actual}, but {difference.expected} where the list is "
                    "reversed",
                    "seed copy i with the i-th entry of the list",
                )
        try:
            reset(seed=[*seeds, 1])
        except Exception:
            return
        fail(
            f"reset(seed=[...]) with {len(seeds) + 1} seeds for {subject.num_envs} copies",
            "was accepted",
            "raise a ValueError unless there is one seed for each copy",
        )


def check_global_random_state_is_untouched(subject: VectorSubject) -> None:
    """Neither `numpy.random`'s global generator nor that of `random` is drawn from or seeded."""
    with subject.vector() as env:
        before, before_python = deepcopy(np.random.get_state()), random.getstate()  # noqa: NPY002 - it is what is watched
        moments = fly(subject, env, subject.actions(env, min(subject.steps, FEW_STEPS)))
        after, after_python = np.random.get_state(), random.getstate()  # noqa: NPY002 - it is what is watched
    for name, touched in (
        ("numpy.random", first_difference(after, before) is not None),
        ("random", after_python != before_python),
    ):
        if touched:
            fail(
                f"reset and {len(moments) - 1} steps",
                f"the global generator of {name} was used",
                "draw from a numpy.random.Generator of the environment's own",
            )


def _copy_repeats(
    env: AnyVectorEnv, moments: Sequence[Moment], others: Sequence[Moment], copy: int, other_copy: int
) -> bool:
    """Whether two copies saw the same observations, rewards and ends; infos do not count (counters)."""
    return all(
        first_difference(copy_parts(env, moment, copy), copy_parts(env, other, other_copy)) is None
        for moment, other in side_by_side(moments, others, copy, other_copy)
    )


def _all_equal(values: Sequence[Any]) -> bool:
    return all(first_difference(value, values[0]) is None for value in values)
