"""Settings of the filter of a detector, which every detector takes as keyword arguments."""

from __future__ import annotations

from typing import TypedDict

from numpy.typing import ArrayLike

from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping.coupling import Coupling

__all__ = ["FALSE_ALARMS", "SOURCE_MEASUREMENT_NOISE", "SOURCE_PROCESS_NOISE", "FilterSettings"]

FALSE_ALARMS = 1e-4
"""False alarms per interval that a default threshold allows, unless another rate is stated."""

SOURCE_PROCESS_NOISE = 0.01
"""Variance that each entry of the effectiveness gains per update (Yang 2003, chapter 6)."""

SOURCE_MEASUREMENT_NOISE = 10.0
"""Variance of each axis of the rate change (Yang 2003, chapter 6)."""


class FilterSettings(TypedDict, total=False):
    """What a detector's filter takes the errors to be; each one may be left out.

    Attributes:
        noise: Of the measured rate change: a number, or one for each axis, by default the source's; or
            `PhysicalNoise`. See `thruster_baselines.detection.base`.
        process_noise: Variance that each entry of the effectiveness gains per update, one number or (m,): by
            default the source's with noise given as numbers, none with `PhysicalNoise`.
        initial_covariance: Variance of the entries at the start, one number or (m,); by default the process
            noise.
        coupling: Share of thrust lost per further thruster open, or a loss curve; by default the
            spacecraft's, and none with a matrix.
        effective: Whether on-times are given as effective ones, with all taken off that valves and feed take;
            by default they are those commanded.
        mismatch: Whether to follow how well the model fits, and to warn of a parameter that does not; no by
            default, yes in `for_vehicle`.
        vehicles: Number of vehicles monitored; 1 by default.
    """

    noise: PhysicalNoise | ArrayLike
    process_noise: ArrayLike | None
    initial_covariance: ArrayLike | None
    coupling: Coupling | None
    effective: bool
    mismatch: bool
    vehicles: int
