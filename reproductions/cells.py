"""What figures look like in a line or in a cell of a table: rates with intervals, spreads, times."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.evaluate import Rate
from thruster_baselines.statistics import clopper_pearson

__all__ = [
    "finite",
    "interval",
    "median",
    "named",
    "percent",
    "proportion",
    "quantiles",
    "spread",
    "with_interval",
]


def interval(part: int, whole: int, form: str = ".1f") -> str:
    """The 95 % Clopper-Pearson interval of a share, in %."""
    low, high = clopper_pearson(int(part), int(whole))
    return f"{100.0 * low:{form}} to {100.0 * high:{form}}"


def proportion(part: int, whole: int, form: str = ".1f", unit: str = " %") -> str:
    """A share in % with its 95 % Clopper-Pearson interval; - of none.

    >>> proportion(9, 10)
    '90.0 % (55.5 to 99.7)'
    """
    return f"{100.0 * part / whole:{form}}{unit} ({interval(part, whole, form)})" if whole else "-"


def with_interval(one: Rate, form: str = ".2%") -> str:
    """A rate with its interval.

    >>> with_interval(Rate(0.5, 0.25, 0.75, 2, 4))
    '50.00% (25.00% to 75.00%)'
    """
    return f"{one.value:{form}} ({one.low:{form}} to {one.high:{form}})"


def percent(part: int, whole: int) -> str:
    """A share in %; none of none."""
    return f"{100.0 * part / whole:.1f} %" if whole else "none"


def spread(values: ArrayLike, form: str = ".4f") -> str:
    """Median and range.

    >>> spread([1.0, 2.0, 4.0], ".1f")
    '2.0 (1.0 to 4.0)'
    """
    numbers = np.asarray(values, dtype=np.float64)
    return f"{np.median(numbers):{form}} ({numbers.min():{form}} to {numbers.max():{form}})"


def finite(value: float, form: str, otherwise: str = "never") -> str:
    """A number, or what it means that it is not finite."""
    return f"{value:{form}}" if np.isfinite(value) else otherwise


def median(times: ArrayLike) -> float:
    """The smallest time within which half of all have come; infinite for never, and of none."""
    ordered = np.sort(np.asarray(times, dtype=np.float64))
    return float(ordered[(ordered.size - 1) // 2]) if ordered.size else float("inf")


def quantiles(values: ArrayLike) -> tuple[float, float, float]:
    """Those of 10, 50 and 90 %."""
    low, middle, high = np.quantile(np.asarray(values, dtype=np.float64), [0.1, 0.5, 0.9])
    return float(low), float(middle), float(high)


def named(values: ArrayLike, form: str = ".4g", scale: float = 1.0) -> str:
    """A vector in brackets."""
    return f"[{', '.join(f'{scale * one + 0.0:{form}}' for one in np.asarray(values))}]"
