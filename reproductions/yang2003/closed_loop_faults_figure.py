"""The figure of `reproductions.yang2003.closed_loop_faults`: who arrives, and what it takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from reproductions.figures import BLUE, GREEN, INK, ORANGE, PURPLE, RED, Figure
from reproductions.yang2003.fault_flights import FAULT_KINDS, Flight
from reproductions.yang2003.rendezvous_flights import POSITION_TOLERANCE
from thruster_baselines.statistics import clopper_pearson

_COLORS = (GREEN, BLUE, RED, ORANGE, PURPLE)
_MARKERS = {"stuck_off": "o", "loss": "^", "stuck_on": "s"}
_NEAR = 1e-2  # m: nearer than this is drawn at this


def draw(*, by_pilot: Mapping[str, Sequence[Flight]], names: Mapping[str, str]) -> None:
    """Success by kind of fault, and final miss against firing time of every flight.

    Args:
        by_pilot: The flights of each pilot.
        names: What each kind of fault is called.
    """
    figure = Figure(figsize=(8.0, 8.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(1.0, 1.5))
    _draw_success(upper, by_pilot, names)
    _draw_flights(lower, by_pilot, names)
    return figure


def _draw_success(panel: Axes, by_pilot: Mapping[str, Sequence[Flight]], names: Mapping[str, str]) -> None:
    width = 0.8 / len(by_pilot)
    for place, ((pilot, flights), color) in enumerate(zip(by_pilot.items(), _COLORS, strict=True)):
        for group, kind in enumerate(FAULT_KINDS):
            those = [one.success for one in flights if one.kind == kind]
            if not those:
                continue
            low, high = clopper_pearson(sum(those), len(those))
            x, share = group + (place - 0.5 * (len(by_pilot) - 1)) * width, float(np.mean(those))
            panel.bar(x, 100.0 * share, 0.9 * width, color=color, label=pilot if group == 0 else None)
            panel.plot([x, x], [100.0 * low, 100.0 * high], color=INK, linewidth=1.2)
    counts = [sum(one.kind == kind for one in next(iter(by_pilot.values()))) for kind in FAULT_KINDS]
    panel.set_xticks(
        range(len(FAULT_KINDS)),
        [f"{names[kind]} ({count} flights)" for kind, count in zip(FAULT_KINDS, counts, strict=True)],
    )
    panel.set(ylim=(0.0, 105.0), ylabel="in the terminal box, %", title="Who arrives, with 95 % intervals")
    panel.grid(axis="x", visible=False)
    if counts[0]:
        panel.legend(loc="upper right", ncols=2)


def _draw_flights(panel: Axes, by_pilot: Mapping[str, Sequence[Flight]], names: Mapping[str, str]) -> None:
    for (pilot, flights), color in zip(by_pilot.items(), _COLORS, strict=True):
        for kind in FAULT_KINDS:
            those = [one for one in flights if one.kind == kind and one.firing_time > 0.0]
            panel.plot(
                [one.firing_time for one in those],
                [max(one.miss, _NEAR) for one in those],
                _MARKERS[kind],
                color=color,
                markersize=4.0,
                markerfacecolor="none" if pilot in ("oracle", "does nothing") else color,
                alpha=0.7,
            )
    for kind, marker in _MARKERS.items():
        panel.plot([], [], marker, color=INK, markersize=5.0, linestyle="none", label=names[kind])
    panel.axhline(POSITION_TOLERANCE, color=INK, linewidth=1.0, linestyle=":")
    panel.annotate(
        "terminal box",
        (0.01, POSITION_TOLERANCE),
        (0, 2),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        fontsize=8.5,
    )
    panel.set(
        xscale="log",
        yscale="log",
        xlabel="firing time, thruster-seconds (who fired nothing is left out)",
        ylabel="final miss, m",
        title="Every flight: where it ended, and what it fired",
    )
    panel.legend(loc="lower left")
