"""One call that checks a native Gymnasium vector environment, anyone's, in every autoreset mode that it has.

Gymnasium's `check_env` and Stable-Baselines3's look at single environments only. What is demanded of a vector
environment here is Gymnasium's own contract (Gymnasium 1.4, `gymnasium.vector`), as `SyncVectorEnv` fulfils
it: copy *i* of a batch seeded with `s` is the single environment seeded with `s + i`.

Left out: rendering, wrappers and speed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from gymnasium.vector import AutoresetMode

from thruster_envs.testing.report import Check, CheckResult, Report, run_checks, validate_names
from thruster_envs.testing.vector.contract import (
    check_autoreset_mode_is_stated,
    check_bad_actions_are_refused,
    check_can_be_made,
    check_infos_have_masks,
    check_numbers_are_finite,
    check_reset_returns,
    check_spaces,
    check_step_returns,
)
from thruster_envs.testing.vector.endings import (
    check_episodes_end,
    check_final_observations,
    check_next_step_autoreset,
)
from thruster_envs.testing.vector.flights import VectorSubject
from thruster_envs.testing.vector.independence import (
    check_batch_size_does_not_matter,
    check_copies_are_independent,
    check_equals_single_copies,
    check_instances_are_independent,
)
from thruster_envs.testing.vector.makers import (
    AnyEnv,
    AnyVectorEnv,
    VectorFactory,
    single_factory,
    vector_factory,
)
from thruster_envs.testing.vector.masked_resets import (
    check_bad_reset_masks_are_refused,
    check_masked_reset,
    check_masked_reset_leaves_others,
    check_masked_reset_with_seed,
)
from thruster_envs.testing.vector.ownership import (
    check_actions_are_left_alone,
    check_returned_data_is_not_shared,
    check_returned_data_may_be_written,
    check_returned_data_stays,
)
from thruster_envs.testing.vector.seeding import (
    check_autoreset_goes_on,
    check_copies_differ,
    check_global_random_state_is_untouched,
    check_reset_goes_on,
    check_seed_lists,
    check_seed_reproduces,
    check_seeds_differ,
)

#: The checks, foundations first.
VECTOR_CHECKS: tuple[Check, ...] = (
    Check(check_can_be_made, foundation=True),
    Check(check_spaces, foundation=True),
    Check(check_autoreset_mode_is_stated, foundation=True),
    Check(check_reset_returns, foundation=True),
    Check(check_step_returns, foundation=True),
    Check(check_infos_have_masks, foundation=True),
    Check(check_seed_reproduces, foundation=True),
    Check(check_instances_are_independent, foundation=True),
    Check(check_numbers_are_finite),
    Check(check_episodes_end),
    Check(check_returned_data_stays),
    Check(check_returned_data_is_not_shared),
    Check(check_returned_data_may_be_written),
    Check(check_actions_are_left_alone),
    Check(check_seeds_differ),
    Check(check_copies_differ),
    Check(check_reset_goes_on),
    Check(check_autoreset_goes_on),
    Check(check_seed_lists),
    Check(check_global_random_state_is_untouched),
    Check(check_copies_are_independent),
    Check(check_batch_size_does_not_matter),
    Check(check_equals_single_copies),
    Check(check_next_step_autoreset, settings=("NEXT_STEP",)),
    Check(check_final_observations, settings=("SAME_STEP",)),
    Check(check_masked_reset, settings=("DISABLED",)),
    Check(check_masked_reset_leaves_others, settings=("DISABLED",)),
    Check(check_masked_reset_with_seed, settings=("DISABLED",)),
    Check(check_bad_reset_masks_are_refused, settings=("DISABLED",)),
    Check(check_bad_actions_are_refused),
)

#: Names of the checks, in the order in which they are run.
VECTOR_CHECK_NAMES: tuple[str, ...] = tuple(check.name for check in VECTOR_CHECKS)


def check_vector_env(
    make_vector: str | Callable[..., AnyVectorEnv],
    make_single: str | Callable[..., AnyEnv] | None = None,
    *,
    num_envs: int = 3,
    steps: int = 100,
    seed: int = 123,
    autoreset_modes: Collection[AutoresetMode | str] | None = None,
    tolerance: float = 0.0,
    ignore_info: Collection[str] = (),
    skip: Mapping[str, str] | None = None,
    only: Collection[str] | None = None,
    raise_failures: bool = True,
    **kwargs: Any,
) -> Report:
    """Check a vector environment; a failed check is one line: where, what is wrong, what to change.

    Each argument is a user's option of its own.

    Args:
        make_vector: The id of an environment, made with `gymnasium.make_vec`; or a class or function that
            makes a fresh vector environment. It is given `num_envs=` and `autoreset_mode=` if it takes them.
        make_single: The id of the single environment, or a class or function that makes it. With an id as
            `make_vector` this is by default `gymnasium.make` of the same id. Without it the copies are
            compared among themselves and with batches of one, and `equals_single_copies` is not applicable.
        num_envs: Number of copies, at least 2; a maker that does not take `num_envs` decides by itself.
        steps: Steps of a flight, at least 10; episodes must end within it.
        seed: Seed of the first copy.
        autoreset_modes: The modes to check, as `AutoresetMode` or its value. By default all three if
            `make_vector` takes `autoreset_mode`, else the one in the environment's metadata.
        tolerance: Relative and absolute tolerance where numbers are compared; 0 asks for equal bits.
        ignore_info: Names of entries of `info` left out where values are compared (a wall clock, say).
        skip: Names of checks that are left out, each with the reason.
        only: Names of the checks that are run; by default all of `VECTOR_CHECK_NAMES`.
        raise_failures: Whether to raise at the end if a check failed; otherwise read it from the report.
        **kwargs: Passed to both makers.

    Returns:
        The report: what each check found in each mode.

    Raises:
        CheckFailed: An `AssertionError` with one line for each failure.
        ValueError: An argument is wrong.

    >>> print(check_vector_env("CartPole-v1", only=["spaces"], autoreset_modes=["NextStep"]))
    CartPole-v1
      passed         spaces [NEXT_STEP]
    """
    if steps < 10:
        raise ValueError(f"steps is {steps}; checks need at least 10 to see anything")
    validate_names(VECTOR_CHECKS, skip, only)
    factory = vector_factory(make_vector, kwargs)
    single = single_factory(make_single, make_vector, kwargs)
    made_num_envs, made_mode = _as_made(factory, num_envs)
    if made_num_envs < 2:
        raise ValueError(
            f"num_envs is {made_num_envs}; pass at least 2, because with one copy nothing shows whether "
            "copies are apart"
        )
    results: list[CheckResult] = []
    for mode in _modes(factory, autoreset_modes, made_mode):
        subject = VectorSubject(
            factory=factory,
            make_single=single,
            autoreset_mode=mode,
            num_envs=num_envs if factory.takes_num_envs else made_num_envs,
            steps=steps,
            seed=seed,
            tolerance=tolerance,
            ignore_info=frozenset(ignore_info),
        )
        results.extend(run_checks(VECTOR_CHECKS, subject, mode.name, skip, only))
    report = Report(factory.name, tuple(results))
    if raise_failures:
        report.raise_failures()
    return report


def _as_made(factory: VectorFactory, num_envs: int) -> tuple[int, AutoresetMode]:
    """Number of copies and autoreset mode of an environment whose maker decides on them."""
    if factory.takes_num_envs and factory.takes_autoreset_mode:
        return num_envs, AutoresetMode.NEXT_STEP
    env = factory(num_envs, AutoresetMode.NEXT_STEP)
    stated = env.metadata.get("autoreset_mode")
    made_num_envs = num_envs if factory.takes_num_envs else env.num_envs
    env.close()
    return made_num_envs, stated if isinstance(stated, AutoresetMode) else AutoresetMode.NEXT_STEP


def _modes(
    factory: VectorFactory, wanted: Collection[AutoresetMode | str] | None, made_mode: AutoresetMode
) -> tuple[AutoresetMode, ...]:
    if wanted is None:
        return tuple(AutoresetMode) if factory.takes_autoreset_mode else (made_mode,)
    modes = []
    for mode in wanted:
        known = [*AutoresetMode, *(known.value for known in AutoresetMode)]
        if mode not in known:
            raise ValueError(
                f"autoreset_modes has {mode!r}; it takes {', '.join(str(name) for name in known[3:])}"
            )
        modes.append(AutoresetMode(mode))
    if not factory.takes_autoreset_mode and modes != [made_mode]:
        raise ValueError(
            f"autoreset_modes asks for {[mode.name for mode in modes]}, but make_vector takes no "
            f"autoreset_mode and makes environments in {made_mode.name}"
        )
    return tuple(modes)
