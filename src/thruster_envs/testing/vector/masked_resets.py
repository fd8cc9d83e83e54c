"""Resets of some copies, `reset(options={"reset_mask": mask})`, with autoreset DISABLED."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from thruster_envs.testing.comparison import Difference, first_difference
from thruster_envs.testing.report import fail
from thruster_envs.testing.vector.flights import Flight, VectorSubject, copy_difference, rows, side_by_side

MASK_AFTER = 7  # steps flown before a masked reset


def check_masked_reset(subject: VectorSubject) -> None:
    """DISABLED: copies under `options["reset_mask"]` begin a new episode, as in a reset of all copies."""
    for where, masked, difference in _masked_reset_differences(subject, seed=None):
        if masked:
            fail(
                where,
                f"{difference.where} is {difference.actual} in a copy under the mask, and "
                f"{difference.expected} after a reset of all copies",
                "reset all that belongs to the copies under the mask",
            )


def check_masked_reset_leaves_others(subject: VectorSubject) -> None:
    """DISABLED: copies outside the mask go on as if nothing had happened, random streams included."""
    for where, masked, difference in _masked_reset_differences(subject, seed=None):
        if not masked:
            fail(
                where,
                f"{difference.where} is {difference.actual} in a copy outside the mask, and "
                f"{difference.expected} without the masked reset",
                "touch neither the state nor the generator of copies outside the mask",
            )


def check_masked_reset_with_seed(subject: VectorSubject) -> None:
    """DISABLED: a masked reset with a seed seeds the masked copies (copy i with seed + i) and no others."""
    for where, masked, difference in _masked_reset_differences(subject, seed=subject.other_seed):
        if masked:
            fail(
                where,
                f"{difference.where} is {difference.actual} in a copy under the mask, and "
                f"{difference.expected} after a reset of all copies with the same seed",
                "seed copy i with seed + i, whatever the mask",
            )
        fail(
            where,
            f"{difference.where} is {difference.actual} in a copy outside the mask, and "
            f"{difference.expected} without the masked reset",
            "seed only the copies under the mask",
        )


def check_bad_reset_masks_are_refused(subject: VectorSubject) -> None:
    """DISABLED: a reset mask of the wrong shape, dtype or type, or without a True, is refused."""
    n = subject.num_envs
    bad_masks: dict[str, Any] = {
        f"of shape ({n + 1},)": np.ones(n + 1, dtype=np.bool_),
        f"of shape ({n}, 1)": np.ones((n, 1), dtype=np.bool_),
        "of dtype int64": np.ones(n, dtype=np.int64),
        "without a True": np.zeros(n, dtype=np.bool_),
        "that is a list": [True] * n,
    }
    for kind, mask in bad_masks.items():
        with subject.vector() as env:
            env.reset(seed=subject.seed)
            try:
                env.reset(options={"reset_mask": mask})
            except Exception:  # which exception is the environment's own choice
                continue
        fail(
            f'reset(options={{"reset_mask": ...}}) with a mask {kind}',
            "was accepted",
            f"raise unless it is a boolean array of shape ({n},) with at least one True",
        )


def _masked_reset_differences(
    subject: VectorSubject, seed: int | None
) -> Iterator[tuple[str, bool, Difference]]:
    """Reset every second copy in mid-flight and fly on, beside a flight with a full reset and one with none.

    Yields:
        Where a copy differs from the flight that it should follow, whether it was under the mask, and how it
        differs.
    """
    mask = np.arange(subject.num_envs) % 2 == 0
    with subject.vector() as env, subject.vector() as reset_env, subject.vector() as undisturbed_env:
        flights = [Flight(each, subject.autoreset_mode) for each in (env, reset_env, undisturbed_env)]
        actions = subject.actions(env)
        moments, reset_moments, undisturbed = (
            flight.fly(actions[:MASK_AFTER], subject.seed) for flight in flights
        )
        where = f"reset with a mask{'' if seed is None else ' and a seed'} after step {MASK_AFTER}"
        moments = [flights[0].reset(where, seed=seed, options={"reset_mask": mask.copy()})]
        reset_moments = [flights[1].reset(where, seed=seed)]
        before = rows(env.observation_space, undisturbed[-1].observations)
        after = rows(env.observation_space, moments[0].observations)
        for copy in np.flatnonzero(~mask).tolist():
            difference = first_difference(after[copy], before[copy], "observation", subject.tolerance)
            if difference is not None:
                yield f"{where}, copy {copy}", False, difference
        undisturbed = []
        for batch in [None, *actions[MASK_AFTER:]]:
            if batch is not None:
                moments, reset_moments, undisturbed = (flight.step(batch) for flight in flights)
            for copy in range(subject.num_envs):
                right_moments = reset_moments if mask[copy] else undisturbed
                for moment, right in side_by_side(moments, right_moments, copy, copy):
                    difference = copy_difference(subject, env, moment, right, copy, copy)
                    if difference is not None:
                        yield f"{moment.where}, copy {copy}", bool(mask[copy]), difference
