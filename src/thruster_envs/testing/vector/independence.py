"""What a copy lives through depends on nothing around it, and equals what a single environment does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from thruster_envs.testing.comparison import first_difference, info_of_copy
from thruster_envs.testing.report import NotApplicable, fail
from thruster_envs.testing.vector.flights import (
    FINAL_KEYS,
    Expected,
    Flight,
    Moment,
    SingleCopy,
    VectorSubject,
    batch_of,
    copy_difference,
    copy_parts,
    flight_difference,
    fly,
    rows,
    side_by_side,
    without_ignored,
)
from thruster_envs.testing.vector.makers import AnyVectorEnv


def check_copies_are_independent(subject: VectorSubject) -> None:
    """What happens to a copy does not depend on the actions of the others."""
    with subject.vector() as env, subject.vector() as twin:
        actions = subject.actions(env)
        others = subject.actions(env, seed=subject.other_seed)
        flight, other_flight = Flight(env, subject.autoreset_mode), Flight(twin, subject.autoreset_mode)
        flight.reset(seed=subject.seed)
        other_flight.reset(seed=subject.seed)
        for batch, other_batch in zip(actions, others, strict=True):
            kept = rows(env.action_space, batch)[0]
            mixed = batch_of(env.single_action_space, [kept, *rows(env.action_space, other_batch)[1:]])
            for moment, right in side_by_side(other_flight.step(mixed), flight.step(batch), 0, 0):
                difference = copy_difference(subject, env, moment, right, 0, 0)
                if difference is not None:
                    fail(
                        f"{moment.where}, copy 0",
                        f"{difference.where} is {difference.actual} instead of {difference.expected} because "
                        "the other copies were given other actions",
                        "give each copy its own state and its own random generator",
                    )


def check_batch_size_does_not_matter(subject: VectorSubject) -> None:
    """Copy i of a batch seeded with s equals the only copy of a batch of one seeded with s + i."""
    if not subject.factory.takes_num_envs:
        raise NotApplicable("the environment is made without num_envs")
    with subject.vector() as env:
        actions = subject.actions(env)
        moments = fly(subject, env, actions)
        for copy in range(subject.num_envs):
            own = [
                batch_of(env.single_action_space, [rows(env.action_space, batch)[copy]]) for batch in actions
            ]
            with subject.vector(num_envs=1) as alone:
                alone_moments = fly(subject, alone, own, seed=subject.seed + copy)
            for moment, right in side_by_side(moments, alone_moments, copy, 0):
                difference = copy_difference(subject, env, moment, right, copy, 0)
                if difference is not None:
                    fail(
                        f"{moment.where}, copy {copy} of {subject.num_envs}",
                        f"{difference.where} is {difference.actual}, but {difference.expected} in a batch of "
                        f"one seeded with {subject.seed + copy}",
                        "seed copy i with seed + i and let nothing depend on the size of the batch",
                    )


def check_instances_are_independent(subject: VectorSubject) -> None:
    """A second instance, stepped in between, does not disturb the first."""
    with subject.vector() as env, subject.vector() as bystander:
        actions = subject.actions(env)
        alone = fly(subject, env, actions)
        flight, other = Flight(env, subject.autoreset_mode), Flight(bystander, subject.autoreset_mode)
        moments = [flight.reset(seed=subject.seed)]
        other.reset(seed=subject.other_seed)
        for batch in actions:
            moments.extend(flight.step(batch))
            other.step(batch)
    difference = flight_difference(subject, moments, alone)
    if difference:
        fail(
            difference.call,
            f"{difference.where} is {difference.actual} instead of {difference.expected} when a second "
            "instance is stepped in between",
            "keep state, buffers and generators in the instance, not in the class or the module",
        )


def check_equals_single_copies(subject: VectorSubject) -> None:
    """Copy i of reset(seed=s) equals a single environment seeded with s + i, in later episodes too."""
    with subject.vector() as env, subject.singles() as copies:
        flight = Flight(env, subject.autoreset_mode)
        expected = [copy.reset(seed=subject.seed + number) for number, copy in enumerate(copies)]
        _require_equal_to_singles(subject, env, flight.reset(seed=subject.seed), expected, copies)
        for batch in subject.actions(env):
            moment, *after = flight.step(batch)
            expected = [
                copy.step(action) for copy, action in zip(copies, rows(env.action_space, batch), strict=True)
            ]
            _require_equal_to_singles(subject, env, moment, expected, copies)
            for reset in after:
                expected = [
                    copies[number].reset() if reset.starts[number] else last
                    for number, last in enumerate(expected)
                ]
                _require_equal_to_singles(subject, env, reset, expected, copies)


def _require_equal_to_singles(
    subject: VectorSubject,
    env: AnyVectorEnv,
    moment: Moment,
    expected: Sequence[Expected],
    copies: Sequence[SingleCopy],
) -> None:
    for number, right in enumerate(expected):
        parts = copy_parts(env, moment, number)
        rights: dict[str, Any] = {"observation": right.observation}
        if moment.rewards is not None:
            rights |= {"reward": right.reward, "terminated": right.terminated, "truncated": right.truncated}
        if moment.rewards is not None or moment.starts[number]:
            infos = {key: value for key, value in moment.infos.items() if key not in FINAL_KEYS}
            parts["info"] = info_of_copy(without_ignored(subject, infos), number)
            rights["info"] = without_ignored(subject, right.info)
        for name, part in parts.items():
            difference = first_difference(part, rights[name], name, subject.tolerance)
            if difference is None:
                continue
            episode = copies[number].episode
            if not moment.starts[number]:
                remedy = "compute a step of the batch exactly as the single environment does"
            elif episode == 1:
                remedy = "seed copy i with seed + i, and let it draw as the single environment does"
            else:
                remedy = "let the next episode of a copy go on with the copy's own generator"
            fail(
                f"{moment.where}, copy {number}, episode {episode}",
                f"{difference.where} is {difference.actual}, but {difference.expected} in the single "
                f"environment seeded with {subject.seed + number}",
                remedy,
            )
