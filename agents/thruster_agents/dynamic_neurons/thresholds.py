"""Thresholds of residuals, from the residuals of healthy pulses or missions: nobody types one in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection import largest_scaled_threshold, threshold_for_rate
from thruster_envs.protocols import FloatArray

__all__ = ["threshold_of"]


def threshold_of(
    residuals: ArrayLike, sensitivity: ArrayLike, false_alarms: float | None = None
) -> FloatArray:
    """The threshold of each column of healthy residuals.

    Args:
        residuals: (samples,) or (samples, columns).
        sensitivity: How far beyond the mean, in units of the distance of the largest from it: the rule of
            Valdes 2008, eq. 4.2 and 5.3.
        false_alarms: Where given, the threshold instead is the lowest for which so large a rate of false
            alarms is shown with a confidence of 95 %.

    Returns:
        (), or (columns,).

    Raises:
        ValueError: No residuals, some that are not finite, or too few for that rate.
    """
    if false_alarms is None:
        return largest_scaled_threshold(residuals, sensitivity)
    values = np.asarray(residuals, np.float64)
    columns = values.reshape(len(values), -1)
    limits = [threshold_for_rate(column, false_alarms).threshold for column in columns.T]
    return np.array(limits).reshape(values.shape[1:])
