"""Calls that check a PettingZoo parallel environment, anyone's.

They stand beside PettingZoo's own tests (`parallel_api_test` and the others) and do not repeat them. The seed
test of PettingZoo 1.27 compares one step; `check_parallel_env_seed` compares as many as it is told, infos
included, and also asks that different seeds differ.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from thruster_envs.testing.parallel.checks import PARALLEL_CHECKS
from thruster_envs.testing.parallel.flights import AnyParallelEnv, parallel_subject, task_for_another_process
from thruster_envs.testing.report import CheckResult, Report, run_checks, validate_names

#: Names of the checks, in the order in which they are run.
PARALLEL_CHECK_NAMES: tuple[str, ...] = tuple(check.name for check in PARALLEL_CHECKS)

_SEED_CHECKS = ("agents_stay", "seed_reproduces", "seeds_differ", "reset_goes_on")
_OTHER_PROCESS = "seed_reproduces_in_another_process"


def check_parallel_env(
    make_env: str | Callable[..., AnyParallelEnv],
    *,
    steps: int = 200,
    seed: int = 123,
    another_process: bool = False,
    skip: Mapping[str, str] | None = None,
    only: Collection[str] | None = None,
    raise_failures: bool = True,
    **kwargs: Any,
) -> Report:
    """Check a PettingZoo parallel environment; a failed check is one line: where, what is wrong, a remedy.

    Args:
        make_env: The id of a registered parallel environment, or a class or function that makes a fresh one.
        steps: Steps of a flight, at least 10; it goes on over the ends of episodes, and one must end.
        seed: Seed of the environment and of the actions.
        another_process: Whether to compare with a flight in a fresh Python process, where sets of strings
            have another order; `make_env` must then be an id or stand at the top of a module.
        skip: Names of checks that are left out, each with the reason.
        only: Names of the checks that are run; by default all of `PARALLEL_CHECK_NAMES`.
        raise_failures: Whether to raise at the end if a check failed; otherwise read it from the report.
        **kwargs: Passed to the maker.

    Returns:
        The report: what each check found.

    Raises:
        CheckFailed: An `AssertionError` with one line for each failure.
        ValueError: An argument is wrong.
    """
    if steps < 10:
        raise ValueError(f"steps is {steps}; checks need at least 10 to see anything")
    validate_names(PARALLEL_CHECKS, skip, only)
    subject = parallel_subject(make_env, steps, seed, kwargs)
    if another_process:
        task_for_another_process(subject)  # refuses at once what cannot be sent
    checks = [check for check in PARALLEL_CHECKS if another_process or check.name != _OTHER_PROCESS]
    results: tuple[CheckResult, ...] = run_checks(checks, subject, skip=skip, only=only)
    report = Report(subject.name, results)
    if raise_failures:
        report.raise_failures()
    return report


def check_parallel_env_seed(
    make_env: str | Callable[..., AnyParallelEnv],
    *,
    steps: int = 200,
    seed: int = 123,
    another_process: bool = False,
    **kwargs: Any,
) -> Report:
    """Check the seeding of a parallel environment over many steps and episodes, infos included.

    The same seed and actions must give the same flight, in the same instance, in a fresh one, and with
    `another_process` in another Python; different seeds must give different flights; `reset()` without a seed
    must go on; no agent may vanish before the episode ends.

    Args:
        make_env: The id of a registered parallel environment, or a class or function that makes a fresh one.
        steps: Steps of a flight, at least 10.
        seed: Seed of the environment and of the actions.
        another_process: Whether to compare with a flight in a fresh Python process as well.
        **kwargs: Passed to the maker.

    Returns:
        The report: what each check found.

    Raises:
        CheckFailed: An `AssertionError` with one line for each failure.
    """
    only = (*_SEED_CHECKS, _OTHER_PROCESS)
    return check_parallel_env(
        make_env, steps=steps, seed=seed, another_process=another_process, only=only, **kwargs
    )
