"""How a set of checks is run over an environment, and what comes back: one line for each that failed.

A check is a function of a *subject* that returns nothing when all is well, raises `CheckFailed` when
something is wrong and `NotApplicable` when there is nothing to look at. Any other exception that comes out of
a check is a failure
too: the environment crashed. When a *foundation* check fails, the checks that stand on it are not run,
    because their
failures would only repeat the first one.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NoReturn, TypeVar

Outcome = Literal["passed", "failed", "skipped", "not applicable", "not run"]
Subject = TypeVar("Subject")


class CheckFailed(AssertionError):
    """An environment failed a check; the message says what is wrong, where, and what to change.

    Attributes:
        report: The whole `Report`, when raised by `check_vector_env` or `check_parallel_env`.
    """

    report: Report | None = None


class NotApplicable(Exception):
    """A check found nothing to look at; the message says why."""


@dataclass(frozen=True)
class CheckResult:
    """What one check found, in one setting of the environment (an autoreset mode, or the empty string)."""

    check: str
    setting: str
    outcome: Outcome
    message: str = ""


@dataclass(frozen=True)
class Report:
    """What all checks found; printing it lists them."""

    environment: str
    results: tuple[CheckResult, ...]

    @property
    def passed(self) -> frozenset[str]:
        """Names of the checks that passed in at least one setting and failed in none."""
        return self._named("passed") - self.failed

    @property
    def failed(self) -> frozenset[str]:
        """Names of the checks that failed in at least one setting."""
        return self._named("failed")

    @property
    def failures(self) -> tuple[str, ...]:
        """One line for each failure; a failure that is the same in several settings is told once."""
        settings: dict[tuple[str, str], list[str]] = {}
        for result in self.results:
            if result.outcome == "failed":
                settings.setdefault((result.check, result.message), []).append(result.setting)
        return tuple(
            f"{check}{_in_brackets(where)}: {message}" for (check, message), where in settings.items()
        )

    def raise_failures(self) -> None:
        """Raise `CheckFailed` with one line for each failure, if there is any."""
        if self.failed:
            number = len({result.check for result in self.results})
            head = f"{self.environment} failed {len(self.failed)} of {number} checks"
            error = CheckFailed("\n".join([f"{head}:", *(f"  {line}" for line in self.failures)]))
            error.report = self
            raise error

    def __str__(self) -> str:
        lines = [self.environment]
        for result in self.results:
            setting = _in_brackets([result.setting])
            lines.append(f"  {result.outcome:<14} {result.check}{setting} {result.message}".rstrip())
        return "\n".join(lines)

    def _named(self, outcome: Outcome) -> frozenset[str]:
        return frozenset(result.check for result in self.results if result.outcome == outcome)


@dataclass(frozen=True)
class Check:
    """A check with its name, the settings in which it means something, and whether others stand on it."""

    function: Callable[[Any], None]
    settings: Collection[str] | None = None
    foundation: bool = False

    @property
    def name(self) -> str:
        """The name of the function without its `check_`."""
        return self.function.__name__.removeprefix("check_")


def fail(where: str, wrong: str, remedy: str) -> NoReturn:
    """Raise `CheckFailed` with one line: where, what is wrong, what to change."""
    raise CheckFailed(" ".join(f"{where}: {wrong}; {remedy}".split()))


def run_checks(
    checks: Sequence[Check],
    subject: Any,
    setting: str = "",
    skip: Mapping[str, str] | None = None,
    only: Collection[str] | None = None,
) -> tuple[CheckResult, ...]:
    """Run checks in order on one subject and collect what they found.

    Args:
        checks: The checks, foundations first.
        subject: What they are given.
        setting: The name of the setting that the subject stands in.
        skip: Name of a check that is left out, and the reason.
        only: Names of the checks that are run; by default all.
    """
    results: list[CheckResult] = []
    broken = ""
    for check in checks:
        if (only is not None and check.name not in only) or (
            check.settings is not None and setting not in check.settings
        ):
            continue
        outcome: Outcome = "passed"
        message = ""
        if skip and check.name in skip:
            outcome, message = "skipped", skip[check.name]
        elif broken:
            outcome, message = "not run", f"{broken} comes first"
        else:
            try:
                check.function(subject)
            except NotApplicable as reason:
                outcome, message = "not applicable", str(reason)
            except CheckFailed as failure:
                outcome, message = "failed", str(failure)
            except (
                Exception
            ) as error:  # whatever an environment raises is its failure, not the end of the report
                outcome, message = "failed", _crash(error)
            if outcome == "failed" and check.foundation:
                broken = check.name
        results.append(CheckResult(check.name, setting, outcome, message))
    return tuple(results)


def validate_names(
    checks: Sequence[Check], skip: Mapping[str, str] | None, only: Collection[str] | None
) -> None:
    """Refuse names of checks that do not exist, naming the nearest, and checks skipped without a reason."""
    known = [check.name for check in checks]
    for argument, names in (("skip", skip or {}), ("only", only or ())):
        for name in names:
            if name not in known:
                nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
                raise ValueError(
                    f"{argument} names the check {name!r}, which does not exist; the nearest is {nearest!r}"
                )
    for name, reason in (skip or {}).items():
        if not reason:
            raise ValueError(f"skip[{name!r}] is empty; say in a few words why this check is left out")


def _crash(error: Exception) -> str:
    return " ".join(
        f"the environment raised {type(error).__name__}: {error}; "
        "make it run through, or pass arguments with which it does".split()
    )


def _in_brackets(settings: Sequence[str]) -> str:
    named = ", ".join(filter(None, settings))
    return f" [{named}]" if named else ""
