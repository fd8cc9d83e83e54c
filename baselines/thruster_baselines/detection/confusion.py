"""What was declared against what was true, faulty or healthy: four counts and the measures that follow.

Faulty is the positive class. Of the six measures of Valdes 2008, eq. 4.8, five go by their standard names
here: accuracy, specificity ("true healthy"), miss rate ("false healthy"), recall ("true faulty") and
false-alarm rate ("false faulty"). What the source calls precision, the share of those declared healthy that
are, is the negative predictive value; precision here is the share of those declared faulty that are. Balanced
accuracy, the mean of recall and specificity, does not depend on how many of the judged are faulty.

Left out: which thruster was blamed, and when. `thruster_baselines.detection.evaluate` measures both.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.evaluate import Rate

__all__ = ["MEASURES", "Confusion"]

MEASURES = (
    "accuracy",
    "specificity",
    "miss_rate",
    "recall",
    "false_alarm_rate",
    "negative_predictive_value",
    "precision",
)
"""Shares of counts: the six of the source, in its order, and precision."""


@dataclass(frozen=True, slots=True)
class Confusion:
    """How many were declared what they are, and how many were not.

    A measure is NaN where there is nothing to measure: recall with nothing faulty, precision without alarms.

    Attributes:
        detected: Faulty and declared so (A of the source).
        missed: Faulty and declared healthy (B).
        false_alarms: Healthy and declared faulty (C).
        cleared: Healthy and declared so (D).

    Raises:
        ValueError: A count below zero.

    The low-level scheme of the source (Table 4.XI), whose precision of 66.67 % its formula does not give:

    >>> low_level = Confusion(detected=34, missed=25, false_alarms=10, cleared=246)
    >>> round(100 * low_level.accuracy, 2), round(100 * low_level.negative_predictive_value, 2)
    (88.89, 90.77)

    The integrated scheme (Table 6.XXX), its scenarios added up:

    >>> integrated = Confusion(detected=7293, missed=2, false_alarms=20, cleared=3240)
    >>> round(100 * integrated.accuracy, 2), round(100 * integrated.negative_predictive_value, 2)
    (99.79, 99.94)
    """

    detected: int
    missed: int
    false_alarms: int
    cleared: int

    def __post_init__(self) -> None:
        for name in self.__slots__:
            count = operator.index(getattr(self, name))
            if count < 0:
                raise ValueError(f"{name} is {count}; zero or more would be right")

    @classmethod
    def of(cls, faulty: ArrayLike, declared: ArrayLike) -> Confusion:
        """Count.

        Args:
            faulty: Whether each is, any shape.
            declared: Whether each is declared faulty, the same shape.

        Raises:
            ValueError: Shapes that differ.

        >>> Confusion.of([True, True, False, False], [True, False, False, False])
        Confusion(detected=1, missed=1, false_alarms=0, cleared=2)
        """
        truth, said = np.asarray(faulty, dtype=np.bool_), np.asarray(declared, dtype=np.bool_)
        if truth.shape != said.shape:
            raise ValueError(
                f"declared has the shape {said.shape}; that of faulty, {truth.shape}, would be right"
            )
        both = (truth & said, truth & ~said, ~truth & said, ~truth & ~said)
        return cls(*(int(np.count_nonzero(one)) for one in both))

    @classmethod
    def total(cls, parts: Iterable[Confusion]) -> Confusion:
        """Those of several scenarios added up.

        >>> Confusion.total([Confusion(108, 7, 0, 541), Confusion(433, 0, 6, 259)])
        Confusion(detected=541, missed=7, false_alarms=6, cleared=800)
        """
        return sum(parts, start=cls(0, 0, 0, 0))

    def __add__(self, other: Confusion) -> Confusion:
        return Confusion(
            self.detected + other.detected,
            self.missed + other.missed,
            self.false_alarms + other.false_alarms,
            self.cleared + other.cleared,
        )

    @property
    def judged(self) -> int:
        """All of them."""
        return self.detected + self.missed + self.false_alarms + self.cleared

    @property
    def faulty(self) -> int:
        """Those that are."""
        return self.detected + self.missed

    @property
    def healthy(self) -> int:
        """Those that are."""
        return self.false_alarms + self.cleared

    @property
    def accuracy(self) -> float:
        """Share that is declared what it is."""
        return self._share("accuracy")

    @property
    def specificity(self) -> float:
        """Share of the healthy that is declared so."""
        return self._share("specificity")

    @property
    def miss_rate(self) -> float:
        """Share of the faulty that is declared healthy."""
        return self._share("miss_rate")

    @property
    def recall(self) -> float:
        """Share of the faulty that is declared so."""
        return self._share("recall")

    @property
    def false_alarm_rate(self) -> float:
        """Share of the healthy that is declared faulty."""
        return self._share("false_alarm_rate")

    @property
    def negative_predictive_value(self) -> float:
        """Share of those declared healthy that are: the precision of the source."""
        return self._share("negative_predictive_value")

    @property
    def precision(self) -> float:
        """Share of those declared faulty that are."""
        return self._share("precision")

    @property
    def balanced_accuracy(self) -> float:
        """Mean of recall and specificity."""
        return 0.5 * (self.recall + self.specificity)

    def rate(self, measure: str, confidence: float = 0.95) -> Rate:
        """A measure with its Clopper-Pearson interval, as if the judged were independent of each other.

        Args:
            measure: One of `MEASURES`.
            confidence: Between 0 and 1.

        Raises:
            ValueError: Another measure.

        >>> recall = Confusion(34, 25, 10, 246).rate("recall")
        >>> f"{recall.value:.3f} ({recall.low:.3f} to {recall.high:.3f})"
        '0.576 (0.441 to 0.704)'
        """
        return Rate.of(*self._counts(measure), confidence)

    def _share(self, measure: str) -> float:
        part, whole = self._counts(measure)
        return part / whole if whole else math.nan

    def _counts(self, measure: str) -> tuple[int, int]:
        match measure:
            case "accuracy":
                return self.detected + self.cleared, self.judged
            case "specificity":
                return self.cleared, self.healthy
            case "miss_rate":
                return self.missed, self.faulty
            case "recall":
                return self.detected, self.faulty
            case "false_alarm_rate":
                return self.false_alarms, self.healthy
            case "negative_predictive_value":
                return self.cleared, self.missed + self.cleared
            case "precision":
                return self.detected, self.detected + self.false_alarms
        raise ValueError(f"measure is {measure!r}; one of {', '.join(MEASURES)} would be right")
