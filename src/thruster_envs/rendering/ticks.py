"""Round numbers for axes."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

ROUND_STEPS = (1.0, 2.0, 5.0, 10.0)


def round_step(span: float, intervals: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that cuts ``span`` into at most ``intervals`` pieces.

    >>> round_step(300.0, 4.0), round_step(0.7, 4.0)
    (100.0, 0.2)
    """
    least = span / intervals
    power = 10.0 ** math.floor(math.log10(least))
    step = next(factor for factor in ROUND_STEPS if factor * power >= least * (1.0 - 1e-9))
    return float(step * power)


def round_limits(low: float, high: float, intervals: float) -> tuple[float, float, float]:
    """Limits that hold ``low`` and ``high`` and are multiples of a round step, and the step.

    They change seldom while the data grow, so that a film does not tremble. At most ``intervals`` pieces are
    asked for; rounding outwards may add two.

    >>> round_limits(-12.0, 287.0, 4.0)
    (-100.0, 300.0, 100.0)
    """
    step = round_step(high - low, intervals)
    return math.floor(low / step + 1e-9) * step, math.ceil(high / step - 1e-9) * step, step


def tick_values(low: float, high: float, step: float) -> npt.NDArray[np.float64]:
    """Multiples of ``step`` from ``low`` to ``high``."""
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    values: npt.NDArray[np.float64] = np.arange(first, last + 1, dtype=np.float64) * step
    return values


def tick_label(value: float, step: float) -> str:
    """``value`` with as many decimals as ``step`` needs, with a true minus sign.

    >>> tick_label(-100.0, 50.0), tick_label(0.30000000000000004, 0.1), tick_label(-0.0, 1.0)
    ('−100', '0.3', '0')
    """
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    text = f"{value:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")
