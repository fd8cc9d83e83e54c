"""Both levels together: the high level finds the pair, the low level the thruster, the pulses, the change.

After Valdes 2008, chapter 6. Of a pair that the high level flags, the thruster that fired more often is the
one that would have lost thrust, the other one the one that would have gained some. The pulses of the first
are judged with the upper threshold of the low level and those of the second with the lower one (logic
threshold selection), since a gain moves the current less. A faulty pulse of the first means a loss (fault
case 1 or 3), of the second a gain (fault case 2).

The source chose 0.037 and 0.030 by hand. Here the upper threshold is that of the low level, from healthy
pulses at all charge voltages, and the lower one is made by the same rule from healthy pulses as flights have
them, whose charge voltage is the nominal one; it is not above the upper one.

Healthy thrusters of a pair fire unequally often too, as disturbances have it. Given how often each fires in a
healthy mission of the kind, the thruster that fired more often than expected, against the other, is taken.

Left out: pulses of pairs that are not flagged, which all are declared healthy; faults of two craft at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from thruster_agents.dynamic_neurons.files import number_of, read_description, write_description
from thruster_agents.dynamic_neurons.high_level import AXES, HighLevelClassifier, MissionSignals
from thruster_agents.dynamic_neurons.low_level import LowLevelClassifier
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["IntegratedClassifier", "MissionReport", "ThrusterFinding", "Waveforms"]

#: Voltages and currents, both (pulses, samples), of the firings with these numbers.
Waveforms: TypeAlias = Callable[[IntArray], tuple[ArrayLike, ArrayLike]]

_KIND = "integrated"


@dataclass(frozen=True, kw_only=True)
class ThrusterFinding:
    """What the second stage found of one thruster of a flagged pair.

    Attributes:
        thruster: Its number, from 1.
        pulses: How often it fired.
        threshold: That its pulses were judged with.
        faulty_pulses: How many were declared faulty.
        first_faulty_pulse: Number of the first of them among the pulses of the thruster, from 1, or None.
        change: Of thrust, where there were faulty pulses: `loss` or `gain`.
    """

    thruster: int
    pulses: int
    threshold: float
    faulty_pulses: int
    first_faulty_pulse: int | None
    change: Literal["loss", "gain"] | None

    def __str__(self) -> str:
        judged = f"thruster {self.thruster}: {self.pulses} pulses, "
        if self.change is None:
            return judged + "none faulty"
        return (
            f"{judged}{self.faulty_pulses} faulty from pulse {self.first_faulty_pulse} on, "
            f"a {self.change} of thrust"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class MissionReport:
    """What became of one mission.

    Attributes:
        residuals: (3,), of roll, pitch and yaw, as the high level has them.
        flagged: (3,), whether the pair of that axis is declared faulty.
        findings: Of the thrusters of flagged pairs, in order.
        faulty: (firings,), whether each firing is declared faulty; firings of other pairs are not.
    """

    residuals: FloatArray
    flagged: BoolArray
    findings: tuple[ThrusterFinding, ...]
    faulty: BoolArray

    @property
    def faulty_thrusters(self) -> tuple[int, ...]:
        """Numbers, from 1, of those with a faulty pulse."""
        return tuple(finding.thruster for finding in self.findings if finding.faulty_pulses)

    def __str__(self) -> str:
        if not self.flagged.any():
            return "all healthy"
        pairs = (
            f"{name} (thrusters {2 * axis + 1} and {2 * axis + 2}, residual {self.residuals[axis]:.4g})"
            for axis, name in enumerate(AXES)
            if self.flagged[axis]
        )
        return "\n".join([f"faulty pair: {', '.join(pairs)}", *map(str, self.findings)])


class IntegratedClassifier:
    """Reports what failed in a mission, from the attitude control and the circuits of one craft.

    Args:
        high_level: With thresholds.
        low_level: With a threshold: the upper one.

    Attributes:
        high_level: As given.
        low_level: As given.
        lower: The lower threshold, or None before `calibrate`.

    Raises:
        ValueError: A level without thresholds.
    """

    def __init__(self, high_level: HighLevelClassifier, low_level: LowLevelClassifier) -> None:
        if high_level.thresholds is None or low_level.threshold is None:
            raise ValueError("a level has no threshold; calibrate both first")
        self.high_level, self.low_level = high_level, low_level
        self.lower: float | None = None

    @property
    def upper(self) -> float:
        """The upper threshold: that of the low level."""
        assert self.low_level.threshold is not None
        return self.low_level.threshold

    def calibrate(
        self,
        voltage: ArrayLike,
        current: ArrayLike,
        *,
        charge_voltage: ArrayLike | None = None,
        false_alarms: float | None = None,
    ) -> float:
        """Take the lower threshold of healthy pulses as flights have them; at most the upper one."""
        found = self.low_level.threshold_from(
            voltage, current, charge_voltage=charge_voltage, false_alarms=false_alarms
        )
        self.lower = min(found, self.upper)
        return self.lower

    def diagnose(
        self,
        mission: MissionSignals,
        thrusters: ArrayLike,
        waveforms: Waveforms,
        *,
        expected_pulses: ArrayLike | None = None,
    ) -> MissionReport:
        """Report on one mission.

        Args:
            mission: Signals of one mission, of one craft.
            thrusters: (firings,), which thruster fired, from 0, in the order of firings.
            waveforms: Gives voltages and currents of the firings asked for; only those of flagged pairs are.
            expected_pulses: (6,), how often each thruster fires in a healthy mission of the kind; None for
                as often as the other one of its pair.

        Raises:
            ValueError: No lower threshold yet, more missions than one, thrusters that there are not.
        """
        if self.lower is None:
            raise ValueError("lower is None; calibrate with healthy pulses of flights first")
        if len(mission) != 1:
            raise ValueError(f"mission has {len(mission)} missions; one would be right")
        fired = np.asarray(thrusters)
        if fired.ndim != 1 or (fired.size and not (0 <= fired.min() <= fired.max() < 6)):
            raise ValueError(
                f"thrusters is {fired.tolist()}; numbers from 0 to 5, (firings,), would be right"
            )
        expected = np.ones(6) if expected_pulses is None else np.asarray(expected_pulses, np.float64)
        if expected.shape != (6,) or not (expected > 0.0).all():
            raise ValueError(f"expected_pulses is {expected.tolist()}; six positive numbers would be right")
        residuals = self.high_level.residuals(mission)[0]
        flagged = np.asarray(residuals > self.high_level.thresholds)

        def residual_of(which: IntArray) -> FloatArray:
            return self.low_level.residuals(*waveforms(which))

        findings, faulty = self.findings(flagged, fired, residual_of, expected)
        return MissionReport(residuals=residuals, flagged=flagged, findings=findings, faulty=faulty)

    def findings(
        self,
        flagged: BoolArray,
        fired: IntArray,
        residual_of: Callable[[IntArray], FloatArray],
        expected: FloatArray,
    ) -> tuple[tuple[ThrusterFinding, ...], BoolArray]:
        """The second stage: what is found of the thrusters of flagged pairs.

        Args:
            flagged: (3,), pairs that the high level declares faulty.
            fired: (firings,), which thruster fired, from 0.
            residual_of: Residuals of the low level of the firings asked for.
            expected: (6,), how often each thruster fires in a healthy mission of the kind.

        Returns:
            Findings of thrusters, and (firings,) whether each firing is declared faulty.
        """
        assert self.lower is not None
        counts = np.bincount(fired.astype(np.int64), minlength=6)
        faulty = np.zeros(fired.shape, np.bool_)
        findings = []
        for axis in np.flatnonzero(flagged):
            pair = (2 * int(axis), 2 * int(axis) + 1)
            more = counts[pair[0]] * expected[pair[1]] - counts[pair[1]] * expected[pair[0]]
            for thruster, excess in zip(pair, (more, -more), strict=True):
                which = np.flatnonzero(fired == thruster)
                # A tie tells nothing; the lower threshold then serves for both, as that of a gain does.
                threshold = self.upper if excess > 0 else self.lower
                if which.size:
                    faulty[which] = residual_of(which) > threshold
                findings.append(_finding(thruster, faulty[which], threshold, excess > 0))
        return tuple(findings), faulty

    def save(self, folder: str | Path) -> None:
        """Write both levels and the lower threshold into a folder; see `files`."""
        self.high_level.save(Path(folder) / "high_level")
        self.low_level.save(Path(folder) / "low_level")
        write_description(Path(folder), _KIND, {"lower": self.lower})

    @classmethod
    def load(cls, folder: str | Path) -> IntegratedClassifier:
        """What `save` left.

        Raises:
            ValueError: A file that is missing or is not that of an integrated classifier.
        """
        content = read_description(Path(folder), _KIND, ("lower",))
        high_level = HighLevelClassifier.load(Path(folder) / "high_level")
        classifier = cls(high_level, LowLevelClassifier.load(Path(folder) / "low_level"))
        if content["lower"] is not None:
            classifier.lower = number_of(content["lower"], f"{folder}: lower")
        return classifier


def _finding(thruster: int, faulty: BoolArray, threshold: float, loses: bool) -> ThrusterFinding:
    """Of the pulses of one thruster, numbered from 0 here."""
    change: Literal["loss", "gain"] = "loss" if loses else "gain"
    return ThrusterFinding(
        thruster=thruster + 1,
        pulses=len(faulty),
        threshold=threshold,
        faulty_pulses=int(faulty.sum()),
        first_faulty_pulse=int(np.argmax(faulty)) + 1 if faulty.any() else None,
        change=change if faulty.any() else None,
    )
