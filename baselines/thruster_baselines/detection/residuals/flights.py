"""Flights on which detectors fed by navigation are watched, and what they say of each.

A flight is what `thruster_envs.protocols.NavigationDetector` is given, sample by sample, with the fault that
truly was. Whatever flies a vehicle may fill one. `watch` lets a detector see many side by side; the yardstick
of all detectors, `thruster_baselines.detection.evaluate`, takes them as well and adds the calibration of the
threshold, rates and their intervals.

Left out: any samples that are missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from thruster_baselines.detection.contract import Telemetry, reader_of
from thruster_envs.protocols import FloatArray, IntArray, NavigationDetector

__all__ = ["NavigationFlights", "Watched", "watch"]


@dataclass(frozen=True, slots=True)
class NavigationFlights:
    """Flights of equal length, and the fault of each.

    Attributes:
        open_rates: (flights, samples, n), commanded for the period that begins with the sample.
        position: (flights, samples, 3), m, LVLH, measured.
        attitude: (flights, samples, 4), body from LVLH, measured.
        rate: (flights, samples, 3), rad/s, body axes, measured.
        period: s.
        thruster: (flights,), the one that fails, from 1; 0 in a healthy flight.
        kind: (flights,), of the fault, or `none`.
        severity: (flights,); 0 in a healthy flight.
        onset: (flights,), s since the start; infinite in a healthy flight.
    """

    open_rates: FloatArray
    position: FloatArray
    attitude: FloatArray
    rate: FloatArray
    period: float
    thruster: IntArray
    kind: tuple[str, ...]
    severity: FloatArray
    onset: FloatArray

    @property
    def on_times(self) -> FloatArray:
        """(flights, samples, n), s, commanded for the period that begins with the sample."""
        return self.open_rates * self.period

    @property
    def duration(self) -> float:
        """Of a period, s."""
        return self.period

    @property
    def first_answer(self) -> float:
        """s; the first sample is answered when it is taken."""
        return 0.0

    def telemetry(self, flights: slice, interval: int) -> Telemetry:
        """What a detector is given of one sample of some of them."""
        at = (flights, interval)
        return Telemetry(
            self.period, duties=self.open_rates[at], position=self.position[at], attitude=self.attitude[at],
            rate=self.rate[at],
        )  # fmt: skip

    def step(self, flights: slice, interval: int) -> dict[str, Any]:
        """The arguments of `NavigationDetector.update` for one sample of some of them."""
        at = (flights, interval)
        return {
            "open_rates": self.open_rates[at],
            "position": self.position[at],
            "attitude": self.attitude[at],
            "rate": self.rate[at],
        }


@dataclass(frozen=True, slots=True)
class Watched:
    """What a detector said.

    Attributes:
        statistic: (flights, samples).
        detection: (flights,), s from the onset to the alarm, negative for an alarm before it; infinite
            without. Of a healthy flight it counts from the start.
        isolation: (flights,), s from the onset to the name; infinite without.
        thruster: (flights,), named, from 1; 0 for none.
    """

    statistic: FloatArray
    detection: FloatArray
    isolation: FloatArray
    thruster: IntArray


def watch(detector: NavigationDetector, flights: NavigationFlights) -> Watched:
    """Let a detector that is made for so many vehicles see all flights, from its reset on."""
    count, samples = flights.open_rates.shape[:2]
    statistic = np.empty((count, samples))
    detection, isolation = np.full(count, np.inf), np.full(count, np.inf)
    named = np.zeros(count, np.int64)
    begin = np.where(np.isfinite(flights.onset), flights.onset, 0.0)
    detector.reset()
    read = reader_of(detector)
    for k in range(samples):
        diagnosis = read(flights.telemetry(slice(None), k))
        since = k * flights.period - begin
        statistic[:, k] = diagnosis.statistic
        detection = np.where(diagnosis.detected & np.isinf(detection), since, detection)
        isolation = np.where((diagnosis.thruster > 0) & np.isinf(isolation), since, isolation)
        named = diagnosis.thruster
    return Watched(statistic, detection, isolation, named)
