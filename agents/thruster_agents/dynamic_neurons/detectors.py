"""The classifiers of dynamic neurons behind the one contract of detectors.

The low level judges each pulse by its residual (`low_level_detector`). The high level and both together
(`MissionDetector`) know only after the mission: telemetry is gathered until the window of the high level
ends, and the alarm comes then. The high level alone cannot tell which thruster of a pair it is.

Left out: the change of thrust of several thrusters at once; `IntegratedClassifier.diagnose` reports on all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_agents.dynamic_neurons.high_level import AXES, HighLevelClassifier, MissionSignals
from thruster_agents.dynamic_neurons.integrated import IntegratedClassifier
from thruster_agents.dynamic_neurons.low_level import LowLevelClassifier
from thruster_baselines.detection import Telemetry, Verdict
from thruster_baselines.detection.checks import mask_of
from thruster_baselines.detection.pulses import WaveformDetector
from thruster_baselines.detection.pulses.detector import firings_of
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["MissionDetector", "low_level_detector"]

_KINDS = {"loss": "loss", "gain": "electrode_sediment"}
"""The kind of fault that takes, and the one that adds thrust."""


def low_level_detector(classifier: LowLevelClassifier, vehicles: int = 1) -> WaveformDetector:
    """Judges each pulse by the residual of the network.

    Raises:
        ValueError: A classifier without a threshold.
    """
    if classifier.threshold is None:
        raise ValueError("threshold is None; calibrate with healthy pulses first")
    return WaveformDetector(classifier.residuals, classifier.threshold, vehicles=vehicles)


class MissionDetector:
    """Alarms when the window of the high level ends, in units of its thresholds.

    Args:
        classifier: With thresholds: the high level, or both levels, which need waveforms and isolate the
            thruster.
        vehicles: Number of vehicles monitored.
        expected_pulses: (6,), how often each thruster fires in a healthy mission of the kind; equally often
            by default.

    Attributes:
        threshold: Of the largest residual of a pair, in units of the threshold of that pair.
        time: (vehicles,), s since the last reset.

    Raises:
        ValueError: A classifier that is not calibrated.
    """

    def __init__(
        self,
        classifier: HighLevelClassifier | IntegratedClassifier,
        vehicles: int = 1,
        expected_pulses: ArrayLike | None = None,
    ) -> None:
        self._both = classifier if isinstance(classifier, IntegratedClassifier) else None
        self._high = classifier.high_level if isinstance(classifier, IntegratedClassifier) else classifier
        if self._high.thresholds is None:
            raise ValueError("thresholds is None; calibrate with healthy missions first")
        if self._both is not None and self._both.lower is None:
            raise ValueError("lower is None; calibrate with healthy pulses of flights first")
        self._expected = np.ones(6) if expected_pulses is None else np.asarray(expected_pulses, np.float64)
        self.threshold = 1.0
        self.time: FloatArray = np.zeros(vehicles)
        last = self._high.settings.window[1]
        pairs = len(AXES)
        self._pulses: FloatArray = np.zeros((vehicles, last + 1, pairs))
        self._attitude: FloatArray = np.zeros((vehicles, last + 1, 4))
        self._rate: FloatArray = np.zeros((vehicles, last + 1, 3))
        self._pulse_residuals: FloatArray = np.zeros((vehicles, last + 1, pairs))
        self._periods: IntArray = np.zeros(vehicles, np.int64)

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Restart, in the vehicles of a mask (vehicles,) or in all of them."""
        mask = mask_of(vehicles, self.time.size)
        self.time[mask], self._periods[mask] = 0.0, 0

    def update(self, telemetry: Telemetry, /) -> Verdict:
        """Take in one control period; attitude and rate are those at its beginning.

        Raises:
            ValueError: Telemetry without pulses, attitude or rate; with both levels, without waveforms.
        """
        last = self._high.settings.window[1]
        fired, _ = firings_of(telemetry.need("pulses"))
        there = self._periods <= last
        rows, at = np.flatnonzero(there), self._periods[there]
        for kept, name in ((self._pulses, "pulses"), (self._attitude, "attitude"), (self._rate, "rate")):
            kept[rows, at] = np.asarray(telemetry.need(name), np.float64)[rows]
        if self._both is not None and (fired & there[:, np.newaxis]).any():
            voltage, current = (np.asarray(telemetry.need(name)) for name in ("voltage", "current"))
            which, axes = np.nonzero(fired & there[:, np.newaxis])
            found = self._both.low_level.residuals(voltage[which, axes], current[which, axes])
            self._pulse_residuals[which, self._periods[which], axes] = found
        self._periods += 1
        self.time += telemetry.duration
        shares = np.zeros((len(fired), len(AXES)))
        ended = np.flatnonzero(self._periods == last + 1)
        if ended.size:
            shares[ended] = self._shares(ended, telemetry.target)
        statistic = shares.max(axis=1)
        detected = statistic > self.threshold
        scores = np.repeat(shares, 2, axis=1)
        thruster, kind = np.zeros(len(fired), np.int64), [""] * len(fired)
        for vehicle in np.flatnonzero(detected) if self._both is not None else ():
            thruster[vehicle], kind[vehicle] = self._isolate(int(vehicle), shares[vehicle] > self.threshold)
        return Verdict(
            detected, thruster, statistic, self.time.copy(), scores, np.zeros_like(scores), tuple(kind)
        )

    def _shares(self, vehicles: IntArray, target: ArrayLike | None) -> FloatArray:
        """(vehicles, 3): residuals in units of the thresholds, of missions whose window has ended."""
        signals = MissionSignals(
            self._pulses[vehicles, :-1], self._attitude[vehicles], self._rate[vehicles],
            None if target is None else np.asarray(target, np.float64)[vehicles],
        )  # fmt: skip
        return np.asarray(self._high.residuals(signals) / self._high.thresholds)

    def _isolate(self, vehicle: int, flagged: BoolArray) -> tuple[int, str]:
        """The thruster with the most faulty pulses, from 1, or 0, and what that means."""
        assert self._both is not None
        record = self._pulses[vehicle]
        periods, axes = np.nonzero(record)
        fired = firings_of(record)[1][periods, axes]
        residuals = self._pulse_residuals[vehicle, periods, axes]
        findings, _ = self._both.findings(flagged, fired, lambda which: residuals[which], self._expected)
        worst = max(findings, key=lambda one: one.faulty_pulses, default=None)
        if worst is None or worst.change is None:
            return 0, ""
        return worst.thruster, _KINDS[worst.change]
