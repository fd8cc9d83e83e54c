"""Detection by the length of the residual (Fonod et al. 2013, eq. 32): an alarm where it reaches a threshold.

The length says that something is wrong, not what; isolators build on it. A manoeuvre outside of the flights
on which the threshold was calibrated alarms: the observer with Pade's states answers an abrupt stop of the
approach as it does a fault.

Left out: any gathering of evidence, and thresholds that follow the command.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias, Unpack

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.detection.calibration import margin_threshold
from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.residuals.base import (
    BaseNavigationDetector,
    NavigationSettings,
    Sample,
    nominal_delay,
    take_attitude,
)
from thruster_baselines.detection.residuals.design import ResidualDesign, observer_design, pade_design
from thruster_baselines.detection.residuals.generator import Observers, observe, turned_thrust
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.configuration import require, suggestion
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["DesignName", "NormThreshold", "margin_threshold", "named_design"]

DesignName: TypeAlias = Literal["pade", "observer", "undelayed"]


class NormThreshold(BaseNavigationDetector):
    """Alarms where the residual is as long as the threshold, and names nobody.

    Args:
        spacecraft: Description, name or path.
        threshold: Of the length of the residual, m.
        design: Of the observer, or a name of one: `pade`, the source's with nine states, `observer`, six
            states and a delay of whole periods, `undelayed`, six states without. Those with a name take the
            spacecraft's mean motion, control period and nominal delay.
        common: See `NavigationSettings`.

    Attributes:
        residual: (vehicles, 3), m, of the last sample, in the axes of the design.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path,
        threshold: float,
        *,
        design: ResidualDesign | DesignName = "pade",
        **common: Unpack[NavigationSettings],
    ) -> None:
        super().__init__(spacecraft, threshold, **common)
        self.design = design if isinstance(design, ResidualDesign) else named_design(self.spacecraft, design)
        vehicles = self._vehicles
        self._observers = Observers(self.design, vehicles)
        kept = self._kept()
        self.residual: FloatArray = np.zeros((vehicles, 3))
        self._residuals: FloatArray = np.zeros((vehicles, kept, 3))  # rings, by the number of the sample
        self._rates: FloatArray = np.zeros((vehicles, kept, self._n))
        self._history = self._residuals, self._rates
        self.reset()

    def _kept(self) -> int:
        """How many samples an isolator looks back on."""
        return 1

    def _begin(self, mask: BoolArray) -> None:
        self._observers.begun[mask] = False
        self.residual[mask] = 0.0

    def _memory(self) -> dict[str, NDArray[Any]]:
        kept = self._observers
        return super()._memory() | {"states": kept.states, "held": kept.held, "begun": kept.begun}

    def _diagnose(self, sample: Sample) -> Verdict:
        statistic = np.zeros(self._vehicles)
        time = np.empty(self._vehicles)
        work = partial(
            _measure, tuple(sample), tuple(self._monitor), self._observers.arrays,
            (self._period, self.settle, self.threshold), self._history, (self.residual, statistic, time),
        )  # fmt: skip
        in_threads(work, self._vehicles)
        if np.count_nonzero(self.detected):
            return self._isolate(statistic, time)
        return self._answer(statistic, time)

    def _isolate(self, statistic: FloatArray, time: FloatArray) -> Verdict:
        """Name a thruster in the vehicles with an alarm, where one can be named."""
        return self._answer(statistic, time)


def named_design(spacecraft: Spacecraft, name: DesignName) -> ResidualDesign:
    """The design of this name for a spacecraft's mean motion, control period and nominal delay.

    Raises:
        ValueError: An unknown name, or Pade's states for thrust without delay.

    >>> from thruster_envs.spacecraft import load
    >>> named_design(load("msr_chaser"), "observer").late
    1
    """
    motion = spacecraft.circular_mean_motion("a residual design")
    period, delay = spacecraft.control_period, nominal_delay(spacecraft)
    if name == "pade":
        at_once = f"'undelayed', as the thrust of {spacecraft.name!r} comes at once,"
        require(delay > 0.0, "design", name, at_once)
        return pade_design(motion, period, delay)
    if name == "observer":
        return observer_design(motion, period, late=round(delay / period))
    if name == "undelayed":
        return observer_design(motion, period, late=0)
    raise ValueError(f"design {name!r} is unknown; {suggestion(name, ('pade', 'observer', 'undelayed'))}")


@kernel(nogil=True)
def _measure(  # type: ignore[no-untyped-def]
    sample, monitor, observers, limits, history, found, first, last
):
    """Residuals, their lengths and times (vehicles,); alarms at limits of period, settling and threshold.

    All are plain tuples: `Sample`, `Monitor`, `Observers.arrays`, the limits, rings of residuals
    (vehicles, kept, 3) and of duties (vehicles, kept, n), and what is written.
    """
    open_rates, position, attitude, _, valid = sample
    effectiveness, last_attitude, samples, refused, detected, _, detection_time, _ = monitor
    (period, settle, threshold), (residuals, rates), (residual, statistic, when) = limits, history, found
    kept, n = residuals.shape[1], open_rates.shape[1]
    for v in range(first, last):
        y = (position[v, 1], -position[v, 2], -position[v, 0])
        measured = valid[v]
        if measured:
            measured = np.isfinite(y[0] + y[1] + y[2]) and take_attitude(attitude, last_attitude, v)
            if not measured:
                refused[v] += 1
        q = (last_attitude[v, 0], last_attitude[v, 1], last_attitude[v, 2], last_attitude[v, 3])
        u = turned_thrust(effectiveness[v], open_rates[v], q)
        r = residual[v]
        observe(observers, u, y, measured, v, r)
        slot = samples[v] % kept
        for j in range(3):
            residuals[v, slot, j] = r[j]
        for i in range(n):
            rates[v, slot, i] = open_rates[v, i]
        time = samples[v] * period
        samples[v] += 1
        when[v] = time
        if time < settle:
            continue
        statistic[v] = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        if statistic[v] >= threshold and not detected[v]:
            detected[v] = True
            detection_time[v] = time
