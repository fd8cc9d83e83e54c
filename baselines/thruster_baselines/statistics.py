"""How well a rate is known from so many trials."""

from __future__ import annotations

import operator

from thruster_envs.extras import extra

__all__ = ["clopper_pearson"]


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """The exact interval of a rate: it holds the true one with this confidence at least.

    Its ends are the rates at which so few successes, or so many, would come with half of what is left of the
    confidence (Clopper and Pearson 1934).

    Args:
        successes: How often it happened.
        trials: Of how many times, independent of each other.
        confidence: Between 0 and 1.

    Raises:
        ValueError: No trials, successes that cannot be, a confidence that is not between 0 and 1.

    >>> low, high = clopper_pearson(0, 10)
    >>> low, round(high, 4)
    (0.0, 0.3085)
    """
    with extra("baselines", "clopper_pearson"):
        from scipy.special import betaincinv  # only here: SciPy is slow to import

    successes, trials = operator.index(successes), operator.index(trials)
    if trials < 1:
        raise ValueError(f"trials is {trials}; one or more would be right")
    if not 0 <= successes <= trials:
        raise ValueError(f"successes is {successes} of {trials} trials; 0 to {trials} would be right")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence}; between 0 and 1 would be right")
    tail = 0.5 * (1.0 - confidence)
    failures = trials - successes
    low = 0.0 if successes == 0 else float(betaincinv(successes, failures + 1, tail))
    high = 1.0 if failures == 0 else float(betaincinv(successes + 1, failures, 1.0 - tail))
    return low, high
