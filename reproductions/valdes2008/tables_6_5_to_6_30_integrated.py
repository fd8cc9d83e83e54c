"""Tables 6.V to 6.XXVIII and 6.XXX: the integrated scheme on eight scenarios (E6.1 to E6.8, E6.10).

Every scenario is flown three ways; see `high_level_study`. The source's results come about with a torque that
its pulse counts need and a fault has not; with the fault acting on the firings alone the first stage is
blind, and it flags fault-free runs as often.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from reproductions.cells import spread
from reproductions.figures import BLUE, INK, ORANGE, Figure, dots, panels
from reproductions.record import Effort, Finding, Table
from reproductions.valdes2008 import Result, reproduces
from reproductions.valdes2008.confusion_tables import (
    INTEGRATED_PRINTED,
    LOW_LEVEL_PRINTED,
    MEASURES,
    cells_of,
)
from reproductions.valdes2008.confusion_tables import SCENARIOS as PRINTED
from reproductions.valdes2008.figs_5_6_to_5_16_high_level import PRINTED_THRESHOLDS, WAYS
from reproductions.valdes2008.high_level_study import EXPERIMENTS, Flown
from reproductions.valdes2008.integrated_study import SCENARIOS, Judged, confusion, firings, judged
from reproductions.valdes2008.low_level_study import seeds_of
from thruster_agents.dynamic_neurons.high_level import AXES
from thruster_baselines.detection import Confusion

RESIDUALS = {
    "I-1": (356.87, 36.77, 59.54),
    "I-2": (133.14, 108.06, 64.52),
    "I-3": (92.65, 40.97, 100.91),
    "I-4": (152.35, 29.62, 51.67),
    "I-5": (85.05, 93.05, 47.89),
    "I-6": (127.19, 42.63, 160.73),
    "I-7": (123.31, 82.60, 45.60),
    "I-8": (117.37, 92.07, 53.84),
}
_WHAT = {1: "propellant loss", 2: "electrode sediment", 3: "conductivity loss"}


def scenario(name: str, effort: Effort) -> Finding:
    """E6.1 to E6.8."""
    count, one = seeds_of(effort), EXPERIMENTS[name]
    said = {way: judged(name, way, count) for way in WAYS}
    flagged = {way: sum(bool(j.report.flagged[one.axis]) for j in those) for way, those in said.items()}
    named = {way: sum(_named(name, j) for j in those) for way, those in said.items()}
    direction = {way: sum(_direction(name, j) for j in those) for way, those in said.items()}
    accuracy = {way: [100.0 * confusion(name, way, j.report.faulty, True).accuracy for j in those]
                for way, those in said.items()}  # fmt: skip
    alarms = sum(bool(j.report.faulty.any()) for j in said["twin"])
    table = Table.of(
        f"{count} networks",
        WAYS,
        {
            "mission": "{1}",
            "right pair flagged": lambda way, _: f"{flagged[way]} of {count}",
            "thruster rightly named": lambda way, _: f"{named[way]} of {count}",
            "right direction": lambda way, _: f"{direction[way]} of {count}",
            "accuracy, median and range": lambda way, _: f"{spread(accuracy[way], '.1f')} %",
            "pulses, faulty / healthy of the pair": lambda way, _: _pulses(name, way),
        },
    )
    printed = 100.0 * PRINTED[int(name[2:])].corrected().accuracy
    return Finding(
        ours=f"with the torque of the printed counts the right pair flagged by {flagged['torque']} of "
        f"{count} networks, accuracy {spread(accuracy['torque'], '.1f')} %; without it {flagged['fault']}, "
        f"{spread(accuracy['fault'], '.1f')} %; alarms on the healthy twin by {alarms}",
        checks={
            "with the torque that the printed counts need, most networks flag the right pair": (
                flagged["torque"] > count / 2
            ),
        },
        data={"flagged": flagged, "named": named, "direction": direction, "accuracy": accuracy,
              "alarms on the healthy twin": alarms},
        not_reproducible=f"an accuracy of {printed:.2f} % for the fault itself: its pair is flagged by "
        f"{flagged['fault']} of {count} networks, that of its healthy twin by {flagged['twin']}",
        note="Accuracy counts the pulses of the pair with the fault, as the source does. Rightly named: "
        "pulses of the failing thruster are declared faulty, and none of any other. Right direction: by the "
        "logic of counts, a loss or a gain.",
        tables=(table,),
    )  # fmt: skip


def _named(name: str, one: Judged) -> bool:
    return one.report.faulty_thrusters == (EXPERIMENTS[name].thruster,)


def _direction(name: str, one: Judged) -> bool:
    right = "gain" if EXPERIMENTS[name].case == 2 else "loss"
    return any(found.thruster == EXPERIMENTS[name].thruster and found.change == right
               for found in one.report.findings)  # fmt: skip


def _pulses(name: str, way: Flown) -> str:
    truth = firings(name, way)
    pair = truth.thruster // 2 == EXPERIMENTS[name].axis
    return f"{int(truth.faulty[pair].sum())} / {int((~truth.faulty[pair]).sum())}"


def totals(way: Flown, count: int, scheme: str, pair_only: bool) -> list[Confusion]:
    """Of each seed, over the eight scenarios."""
    by_scenario = [
        [confusion(name, way, _declared(one, scheme), pair_only) for one in judged(name, way, count)]
        for name in SCENARIOS
    ]
    return [Confusion.total(seed) for seed in zip(*by_scenario, strict=True)]


def _declared(one: Judged, scheme: str) -> np.ndarray:
    return one.report.faulty if scheme == "integrated" else one.low


@reproduces(
    "E6.10",
    lines="Table 6.XXX, L2187-2199",
    reported="accuracy 88.89 % and 99.79 %",
    criterion="the same order on common pulses",
)
def comparison(effort: Effort) -> Finding:
    """The low level and the integrated scheme compared."""
    count = seeds_of(effort)
    found = {
        (way, scheme): totals(way, count, scheme, way == "torque")
        for way in WAYS
        for scheme in ("low level", "integrated")
    }
    accuracy = {key: [100.0 * one.accuracy for one in those] for key, those in found.items()}
    median = {key: float(np.median(those)) for key, those in accuracy.items()}
    recall = [100.0 * one.recall for one in found["fault", "integrated"]]
    measures = Table(
        "Low level / integrated",
        ("measure", "source", *WAYS.values()),
        [
            (name, f"{LOW_LEVEL_PRINTED[name]:.2f} / {INTEGRATED_PRINTED[name]:.2f} %",
             *(f"{_median(found[way, 'low level'], standard)} / "
               f"{_median(found[way, 'integrated'], standard)} %" for way in WAYS))
            for name, standard in MEASURES.items()
        ],
    )  # fmt: skip
    residuals = Table(
        "Residuals of the source over its thresholds 135, 50 and 76",
        ("scenario", "fault", *AXES),
        [
            (name, f"thruster {EXPERIMENTS[name].thruster}, {_WHAT[EXPERIMENTS[name].case]}",
             *(f"{a / b:.2f}" for a, b in zip(those, PRINTED_THRESHOLDS, strict=True)))
            for name, those in RESIDUALS.items()
        ],
    )  # fmt: skip
    return Finding(
        ours="accuracy, low level and integrated: "
        + "; ".join(
            f"{label} {median[way, 'low level']:.1f} and {median[way, 'integrated']:.1f} %"
            for way, label in WAYS.items()
        ),
        checks={
            "the integrated scheme is the more accurate one, by the source's pulses": (
                median["torque", "integrated"] > median["torque", "low level"]
            ),
        },
        data={f"{way}, {scheme}": {"accuracy": those, "cells": list(map(cells_of, found[way, scheme]))}
              for (way, scheme), those in accuracy.items()},
        not_reproducible="99.79 % against 88.89 %: the two are of different pulses. On the same ones, with "
        "the fault acting on the firings, the integrated scheme finds "
        f"{spread(recall, '.0f')} % of faulty pulses",
        note="Flown with the torque: pulses of the pair with the fault, as in Table 6.XXX. Otherwise all "
        "pulses of all six thrusters. Medians of the networks.",
        tables=(measures, residuals),
        figure=partial(_draw, count),
    )  # fmt: skip


def _median(cells: list[Confusion], measure: str) -> str:
    values = [100.0 * getattr(one, measure) for one in cells]
    return "–" if np.isnan(values).any() else f"{np.median(values):.1f}"


def _draw(count: int) -> Figure:
    figure, axes = panels(3, height=3.8)
    for axis, (way, label) in zip(axes, WAYS.items(), strict=True):
        for place, scheme, colour in ((-0.15, "low level", ORANGE), (0.15, "integrated", BLUE)):
            for k, name in enumerate(SCENARIOS):
                those = judged(name, way, count)
                cells = [confusion(name, way, _declared(one, scheme), way == "torque") for one in those]
                values = [100.0 * one.accuracy for one in cells]
                name_once = None if k else scheme
                dots(axis, k + place, values, colour, markersize=2.5, alpha=0.6, label=name_once)
                axis.plot(k + place, np.median(values), "_", color=INK, markersize=9)
        axis.set_xticks(range(len(SCENARIOS)), [one[2:] for one in SCENARIOS])
        axis.set(ylim=(-3.0, 103.0), xlabel="scenario I-")
        axis.set_title(label, fontsize=8.5)
    axes[0].set_ylabel("accuracy (%)")
    axes[0].legend(loc="lower left")
    return figure


def _reported(name: str) -> str:
    cells = PRINTED[int(name[2:])].corrected()
    pair = AXES[EXPERIMENTS[name].axis]
    return f"{pair} flagged; accuracy {cells.accuracy:.2%} of {cells.judged} pulses"


REPRODUCTIONS = tuple(
    Result(
        id=f"E6.{name[2:]}",
        title=f"Scenario {name}: {'growing ' if EXPERIMENTS[name].incremental else ''}"
        f"{_WHAT[EXPERIMENTS[name].case]} of thruster {EXPERIMENTS[name].thruster}",
        lines=lines,
        reported=_reported(name),
        criterion="the right pair flagged by most networks with the torque that the printed counts need",
        run=partial(scenario, name),
    )
    for name, lines in zip(
        SCENARIOS,
        (
            "Tables 6.V to 6.VII, L1886-1931",
            "Tables 6.VIII to 6.X, L1935-1967",
            "Tables 6.XI to 6.XIII, L1969-2001",
            "Tables 6.XIV to 6.XVI, L2003-2032",
            "Tables 6.XVII to 6.XIX, L2034-2066",
            "Tables 6.XX to 6.XXII, L2068-2100",
            "Tables 6.XXIII to 6.XXV, L2102-2134",
            "Tables 6.XXVI to 6.XXVIII, L2136-2168",
        ),
        strict=True,
    )
)
