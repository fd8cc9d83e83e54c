"""Tables 4.XI, 6.XXIX and 6.XXX from their own cells (E4.XI, E6.9): the six measures, and what does not fit.

The six measures follow from four counts (eq. 4.7, 4.8). Computed from the printed counts they are set beside
the printed percentages. The counts themselves are checked as well: those of a scenario must add up to the
faulty and healthy pulses that the scenario's own table lists.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import compress, product

from reproductions.record import Effort, Finding, Table
from reproductions.valdes2008 import reproduces
from thruster_baselines.detection import Confusion

MEASURES = {
    "Accuracy": "accuracy",
    "True Healthy": "specificity",
    "False Healthy": "miss_rate",
    "True Faulty": "recall",
    "False Faulty": "false_alarm_rate",
    "Precision": "negative_predictive_value",
}
"""What the source calls a measure, and its standard name."""

LOW_LEVEL = Confusion(34, 25, 10, 246)
"""Table 4.XI."""

LOW_LEVEL_PRINTED = dict(zip(MEASURES, (88.89, 96.09, 42.37, 57.63, 3.90, 66.67), strict=True))
INTEGRATED_PRINTED = dict(zip(MEASURES, (99.79, 99.39, 0.03, 99.97, 0.61, 99.94), strict=True))


@dataclass(frozen=True)
class Scenario:
    """A row of Table 6.XXIX, and the pulses of the flagged pair that the table of the scenario lists."""

    cells: Confusion  # as printed
    faulty: int  # pulses that are
    healthy: int  # pulses that are

    def adds_up(self, cells: Confusion) -> bool:
        """Whether cells count every pulse of the scenario once."""
        return (cells.faulty, cells.healthy) == (self.faulty, self.healthy)

    def corrected(self) -> Confusion:
        """The printed cells, or those with False Healthy and False Faulty swapped if only so they add up."""
        swapped = Confusion(
            self.cells.detected, self.cells.false_alarms, self.cells.missed, self.cells.cleared
        )
        return swapped if self.adds_up(swapped) and not self.adds_up(self.cells) else self.cells


SCENARIOS = {
    1: Scenario(Confusion(2770, 0, 0, 0), 2770, 0),
    2: Scenario(Confusion(2883, 0, 0, 5), 2883, 5),
    3: Scenario(Confusion(108, 0, 7, 541), 115, 541),
    4: Scenario(Confusion(44, 0, 0, 338), 44, 338),
    5: Scenario(Confusion(433, 0, 6, 259), 433, 112 + 153),
    6: Scenario(Confusion(819, 2, 0, 296), 819, 256 + 42),
    7: Scenario(Confusion(121, 0, 2, 961), 121, 114 + 849),
    8: Scenario(Confusion(115, 0, 5, 840), 115, 769 + 76),
}
"""Table 6.XXIX, and Tables 6.V to 6.XXVIII."""


def cells_of(cells: Confusion) -> tuple[int, int, int, int]:
    """The four counts."""
    return cells.detected, cells.missed, cells.false_alarms, cells.cleared


def computed(cells: Confusion) -> dict[str, float]:
    """The six measures in percent, by the name that the source gives them."""
    return {name: 100.0 * getattr(cells, standard) for name, standard in MEASURES.items()}


def differing(cells: Confusion, printed: Mapping[str, float]) -> list[str]:
    """The measures whose printed percentage is neither the rounded nor the truncated one."""
    return [name for name, value in computed(cells).items() if abs(value - printed[name]) >= 0.01]


@reproduces(
    "E4.XI",
    lines="Table 4.XI, L1313-1324",
    reported=", ".join(f"{name} {value:.2f} %" for name, value in LOW_LEVEL_PRINTED.items()),
    criterion="the printed measures from the printed cells, or which of them do not follow",
)
def low_level(effort: Effort) -> Finding:
    """Low-level confusion matrix from its printed cells."""
    ours, wrong = computed(LOW_LEVEL), differing(LOW_LEVEL, LOW_LEVEL_PRINTED)
    printed = LOW_LEVEL_PRINTED["Precision"]
    nearest = min(shares(LOW_LEVEL), key=lambda share: abs(100.0 * share - printed))
    usual = 100.0 * LOW_LEVEL.precision
    return Finding(
        ours=", ".join(f"{name} {value:.2f} %" for name, value in ours.items()),
        checks={
            "the printed cells are those of 315 pulses": LOW_LEVEL.judged == 315,
            "all measures but Precision are the printed ones": wrong == ["Precision"],
            "no ratio of sums of the cells is the printed Precision": abs(100.0 * nearest - printed) >= 0.01,
        },
        data={"computed": ours, "printed": LOW_LEVEL_PRINTED, "precision": usual, "nearest": nearest},
        correction=f"Precision is {ours['Precision']:.2f} % by the source's own formula ({LOW_LEVEL.cleared} "
        f"of {LOW_LEVEL.cleared + LOW_LEVEL.missed}), not {printed} %, which no ratio of sums of the four "
        "cells gives",
        note="False Faulty is printed truncated. Precision in the usual sense, the share of alarms that are "
        f"right, is {usual:.2f} %.",
        tables=(comparison(LOW_LEVEL, LOW_LEVEL_PRINTED),),
    )


def shares(cells: Confusion) -> list[float]:
    """Every ratio of two sums of different cells."""
    sums = [sum(compress(cells_of(cells), which)) for which in product((False, True), repeat=4)]
    return [part / whole for part in sums for whole in sums if whole]


@reproduces(
    "E6.9",
    lines="Tables 6.XXIX and 6.XXX, L2172-2199",
    reported=", ".join(f"{name} {value:.2f} %" for name, value in INTEGRATED_PRINTED.items()),
    criterion="the printed measures from the printed cells; rows that do not add up are named",
)
def integrated(effort: Effort) -> Finding:
    """Integrated confusion matrix from its printed cells."""
    printed = Confusion.total(one.cells for one in SCENARIOS.values())
    corrected = Confusion.total(one.corrected() for one in SCENARIOS.values())
    swapped = [number for number, one in SCENARIOS.items() if one.corrected() != one.cells]
    large = Confusion.total(one.corrected() for number, one in SCENARIOS.items() if number > 2)
    table = Table.of(
        "Cells of Table 6.XXIX, corrected where they do not add up to the pulses of the scenario",
        SCENARIOS,
        {
            "scenario": "I-{0}",
            "pulses, faulty / healthy": "{1.faulty} / {1.healthy}",
            "True Faulty": "{1.cells.detected}",
            "False Healthy": lambda _, one: _pair(one.cells.missed, one.corrected().missed),
            "False Faulty": lambda _, one: _pair(one.cells.false_alarms, one.corrected().false_alarms),
            "True Healthy": "{1.cells.cleared}",
        },
    )
    return Finding(
        ours=", ".join(f"{name} {value:.2f} %" for name, value in computed(corrected).items()),
        checks={
            "the printed cells give the six printed measures": not differing(printed, INTEGRATED_PRINTED),
            "rows 3 and 6 do not add up, and do with False Healthy and False Faulty swapped": swapped
            == [3, 6],
            "every corrected row adds up": all(one.adds_up(one.corrected()) for one in SCENARIOS.values()),
            "the accuracy does not change": printed.accuracy == corrected.accuracy,
        },
        data={"printed": computed(printed), "corrected": computed(corrected), "swapped": swapped,
              "accuracy without I-1 and I-2": large.accuracy},
        correction="False Healthy and False Faulty are swapped in rows 3 and 6 of Table 6.XXIX; as they "
        f"should be, {corrected.missed} faulty pulses are missed and {corrected.false_alarms} healthy ones "
        "called faulty",
        note="I-1 and I-2, whose printed counts contradict the balance of angular momentum, hold "
        f"{(SCENARIOS[1].faulty + SCENARIOS[2].faulty) / printed.faulty:.0%} of the faulty pulses; without "
        f"them the accuracy is {large.accuracy:.2%}. Only pulses of the flagged pair are counted, and no "
        "mission without a fault.",
        tables=(comparison(corrected, INTEGRATED_PRINTED), table),
    )  # fmt: skip


def _pair(printed: int, corrected: int) -> str:
    return str(printed) if printed == corrected else f"{printed} → {corrected}"


def comparison(cells: Confusion, printed: Mapping[str, float]) -> Table:
    """The six measures beside the printed ones."""
    return Table.of(
        "The measures of the source",
        computed(cells),
        {
            "measure": "{0}",
            "standard name": lambda name, _: MEASURES[name].replace("_", " "),
            "printed": lambda name, _: f"{printed[name]:.2f} %",
            "computed": "{1:.2f} %",
        },
    )
