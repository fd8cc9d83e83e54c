"""Whose arrays are whose: what was returned belongs to the caller, and so do the actions.

Gymnasium 1.4 demands of single environments that observations and infos are fresh objects in every call
(`check_returned_data_not_reused`); here the same is asked of vector environments, over whole episodes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations, pairwise
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from thruster_envs.testing.comparison import first_difference, first_shared_part, overwrite_arrays, snapshot
from thruster_envs.testing.report import fail
from thruster_envs.testing.vector.flights import (
    Flight,
    VectorSubject,
    fly,
    moment_difference,
    part_difference,
)
from thruster_envs.testing.vector.makers import AnyVectorEnv


def check_returned_data_stays(subject: VectorSubject) -> None:
    """What a call returned does not change when the environment is used further."""
    with subject.vector() as env:
        kept = [(where, parts, snapshot(parts)) for where, parts in _raw_calls(subject, env, subject.steps)]
    for where, parts, copies in kept:
        for name, part in parts.items():
            difference = first_difference(part, copies[name], name)
            if difference is not None:
                fail(
                    where,
                    f"{difference.where} was {difference.expected} when it was returned and became "
                    f"{difference.actual} in a later call",
                    "return a copy, not the buffer that the next step overwrites",
                )


def check_returned_data_is_not_shared(subject: VectorSubject) -> None:
    """No two calls return the same array, dict or list, or views of the same memory."""
    with subject.vector() as env:
        calls = list(_raw_calls(subject, env, subject.steps))
    for (where, parts), (other_where, other_parts) in chain(combinations(calls[:6], 2), pairwise(calls[5:])):
        shared = first_shared_part(parts, other_parts)
        if shared is not None:
            fail(
                where,
                f"{shared[0]} shares memory with {shared[1]} of {other_where}",
                "return a new object from every call, also when its content is constant",
            )


def check_returned_data_may_be_written(subject: VectorSubject) -> None:
    """Writing into the returned arrays does not disturb the environment."""
    with subject.vector() as env, subject.vector() as twin:
        actions = subject.actions(env)
        undisturbed = fly(subject, twin, actions)
        moments = iter(undisturbed)
        for where, parts in _raw_calls(subject, env, subject.steps):
            moment = next(moments)
            for name, part in parts.items():
                difference = part_difference(subject, part, moment.parts()[name], name)
                if difference is not None:
                    fail(
                        where,
                        f"{difference.where} is {difference.actual} instead of {difference.expected} after "
                        "the arrays of earlier calls were written to",
                        "return copies of the state, not the state",
                    )
            for part in parts.values():
                overwrite_arrays(part)


def check_actions_are_left_alone(subject: VectorSubject) -> None:
    """`step` neither changes the actions that it is given nor keeps hold of the array."""
    with subject.vector() as env, subject.vector() as twin:
        flight, undisturbed = Flight(env, subject.autoreset_mode), Flight(twin, subject.autoreset_mode)
        flight.reset(seed=subject.seed)
        undisturbed.reset(seed=subject.seed)
        for batch in subject.actions(env):
            given = snapshot(batch)
            moments = flight.step(given, hand_over=True)
            difference = first_difference(given, batch, "actions")
            if difference is not None:
                fail(
                    moments[0].where,
                    f"{difference.where} was {difference.expected} and became {difference.actual} in the "
                    "caller's array",
                    "work on a copy of the actions",
                )
            overwrite_arrays(given)
            for moment, right in zip(moments, undisturbed.step(batch), strict=True):
                difference = moment_difference(subject, moment, right)
                if difference is not None:
                    fail(
                        moment.where,
                        f"{difference.where} is {difference.actual} instead of {difference.expected} after "
                        "the caller reused the action arrays of earlier steps",
                        "keep a copy of the actions, not the caller's array",
                    )


def _raw_calls(subject: VectorSubject, env: AnyVectorEnv, steps: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Make the calls of `fly` one by one and hand on the very objects that they return."""
    observations, infos = env.reset(seed=subject.seed)
    yield "reset", {"observations": observations, "infos": infos}
    for step, batch in enumerate(subject.actions(env, steps), start=1):
        observations, rewards, terminations, truncations, infos = env.step(batch)
        done = np.array(terminations) | np.array(truncations)
        yield (
            f"step {step}",
            {
                "observations": observations,
                "rewards": rewards,
                "terminations": terminations,
                "truncations": truncations,
                "infos": infos,
            },
        )
        if subject.autoreset_mode is AutoresetMode.DISABLED and done.any():
            observations, infos = env.reset(options={"reset_mask": done})
            yield (
                f"reset of the ended copies after step {step}",
                {"observations": observations, "infos": infos},
            )
