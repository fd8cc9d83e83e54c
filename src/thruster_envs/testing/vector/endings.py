"""What happens where an episode ends, in the autoreset modes NEXT_STEP and SAME_STEP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from thruster_envs.testing.comparison import first_difference, first_misfit, info_of_copy, show
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
    one_flight,
    rows,
    without_ignored,
)
from thruster_envs.testing.vector.makers import AnyVectorEnv


def check_episodes_end(subject: VectorSubject) -> None:
    """At least one episode ends within the steps flown; without that, nothing is learned about autoreset."""
    if not any(moment.done.any() for moment in one_flight(subject)):
        fail(
            f"{subject.steps} steps",
            "no episode ended, so that ends of episodes, autoreset and final observations went unchecked",
            "pass a larger steps=, or arguments that make episodes short (such as max_episode_steps=20)",
        )


def check_next_step_autoreset(subject: VectorSubject) -> None:
    """NEXT_STEP: the step after an end ignores its action and gives reward 0 and no flags."""
    with subject.vector() as env, subject.vector() as twin:
        flight, other_flight = Flight(env, subject.autoreset_mode), Flight(twin, subject.autoreset_mode)
        over = flight.reset(seed=subject.seed).done
        other_flight.reset(seed=subject.seed)
        any_end = False
        others = subject.actions(env, seed=subject.other_seed)
        for batch, other_batch in zip(subject.actions(env), others, strict=True):
            mixed = [
                rows(env.action_space, other_batch if over[copy] else batch)[copy]
                for copy in range(subject.num_envs)
            ]
            (moment,) = flight.step(batch)
            (other,) = other_flight.step(batch_of(env.single_action_space, mixed))
            for copy in np.flatnonzero(over).tolist():
                any_end = True
                where = f"{moment.where}, copy {copy}, the step after its episode ended"
                for name in ("rewards", "terminations", "truncations"):
                    value = moment.parts()[name][copy]
                    if value:
                        fail(
                            where,
                            f"{name} is {show(value)}",
                            f"set {name} to {type(value.item())(0)} where a copy is reset",
                        )
                difference = copy_difference(subject, env, other, moment, copy, copy)
                if difference is not None:
                    fail(
                        where,
                        f"{difference.where} is {difference.actual} with one action and "
                        f"{difference.expected} with another",
                        "ignore the action of a copy that is being reset and return its first observation",
                    )
            over = moment.done
    if not any_end:
        raise NotApplicable(f"no episode ended within {subject.steps} steps")


def check_final_observations(subject: VectorSubject) -> None:
    """SAME_STEP: where an episode ended, `final_obs` and `final_info` are its last ones; nowhere else."""
    with subject.vector() as env:
        if subject.make_single is None:
            _require_final_observations(subject, env, [])
        else:
            with subject.singles() as copies:
                _require_final_observations(subject, env, copies)


def _require_final_observations(
    subject: VectorSubject, env: AnyVectorEnv, copies: Sequence[SingleCopy]
) -> None:
    """Look at `final_obs` and `final_info` in every step, beside single copies if there are."""
    flight = Flight(env, subject.autoreset_mode)
    flight.reset(seed=subject.seed)
    for number, copy in enumerate(copies):
        copy.reset(seed=subject.seed + number)
    agrees = [True for _ in copies]  # a copy that strayed from its single one is the matter of another check
    ends = repeats = 0
    for batch in subject.actions(env):
        (moment,) = flight.step(batch)
        _require_final_masks(moment, subject.num_envs)
        expected = [
            copy.step(action) for copy, action in zip(copies, rows(env.action_space, batch), strict=False)
        ]
        for number in np.flatnonzero(moment.done).tolist():
            where = f"{moment.where}, copy {number}, whose episode ended"
            final = _final_observation(env, moment.infos["final_obs"], number)
            misfit = first_misfit(env.single_observation_space, final, f"final_obs[{number}]")
            if misfit is not None:
                fail(
                    where,
                    misfit,
                    "put the last observation of the episode there, as the single space states it",
                )
            ends += 1
            first = rows(env.observation_space, moment.observations)[number]
            repeats += first_difference(final, first) is None
            if copies and agrees[number] and expected[number].done:
                _require_final_values(subject, where, moment, number, final, expected[number])
            elif not copies and "final_info" not in moment.infos and set(moment.infos) - set(FINAL_KEYS):
                fail(where, "infos has no 'final_info'", "put the last info of the ended episodes there")
        for number, right in enumerate(expected):
            parts = copy_parts(env, moment, number)
            rights = {
                "observation": right.observation,
                "reward": right.reward,
                "terminated": right.terminated,
                "truncated": right.truncated,
            }
            agrees[number] &= first_difference(parts, rights, tolerance=subject.tolerance) is None
    if not ends:
        raise NotApplicable(f"no episode ended within {subject.steps} steps")
    if repeats == ends:
        fail(
            "infos['final_obs']",
            f"equals the observation returned with it at each of {ends} ends",
            "put the last observation of the ended episode into final_obs, and the first of the new one into "
            "observations",
        )


def _require_final_masks(moment: Moment, num_envs: int) -> None:
    """`final_obs` and `final_info` are there exactly where an episode ended."""
    for key in ("final_obs", "final_info"):
        mask = moment.infos.get(f"_{key}", np.zeros(num_envs, dtype=np.bool_))
        if key == "final_info" and key not in moment.infos:
            continue  # right for environments without infos; whether it had to be there is seen elsewhere
        if moment.done.any() and key not in moment.infos:
            fail(
                moment.where,
                f"infos has no {key!r} although an episode ended",
                f"add infos[{key!r}] and its mask infos['_{key}']",
            )
        if not np.array_equal(mask, moment.done):
            fail(
                moment.where,
                f"infos['_{key}'] is {show(mask.tolist())} where the ends are {show(moment.done.tolist())}",
                "set the mask exactly where terminated or truncated is set",
            )


def _require_final_values(
    subject: VectorSubject, where: str, moment: Moment, number: int, final: Any, expected: Expected
) -> None:
    difference = first_difference(
        final, expected.final_observation, f"final_obs[{number}]", subject.tolerance
    )
    if difference is not None:
        fail(
            where,
            f"{difference.where} is {difference.actual}, but the last observation of the single environment "
            f"has {difference.expected}",
            "put the last observation of the ended episode into final_obs",
        )
    right = without_ignored(subject, expected.final_info or {})
    infos = moment.infos.get("final_info", {})
    info = info_of_copy(without_ignored(subject, infos), number)
    difference = first_difference(info, right, f"final_info of copy {number}", subject.tolerance)
    if difference is not None:
        fail(
            where,
            f"{difference.where} is {difference.actual}, and {difference.expected} in the single environment",
            "put the last info of the ended episode into final_info",
        )


def _final_observation(env: AnyVectorEnv, final_obs: Any, number: int) -> Any:
    """Take one copy's final observation from an array of objects or from a dense batch."""
    if isinstance(final_obs, np.ndarray) and final_obs.dtype == object:
        return final_obs[number]
    return rows(env.observation_space, final_obs)[number]
