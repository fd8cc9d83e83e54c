"""The figure of `reproductions.yang2003.closed_loop_mappers`: what each mapper costs and where it ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from reproductions.figures import BLUE, GREEN, INK, RED, Figure
from reproductions.yang2003.rendezvous_flights import POSITION_TOLERANCE, Flights
from reproductions.yang2003.section_6_3_coupling_in_flight import Followed

_ALIKE = 0.05  # of the usual firing time: so near to it, mappers are one group
_SMALL = 8.5


def draw(
    *,
    flown: Mapping[str, Flights],
    usual: str,
    open_loop: Mapping[str, Followed],
    seldom: Mapping[str, Sequence[Flights]],
    minutes: Sequence[float],
) -> None:
    """Final miss against firing time of each mapper, and final miss against how often a plan is made.

    Args:
        flown: The flights of each mapper, by its name.
        usual: The name of the mapper that the others are compared with.
        open_loop: The source's own flights, by their label.
        seldom: For each mapper, the flights at each of the times between plans.
        minutes: These times.
    """
    figure = Figure(figsize=(8.0, 8.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(1.35, 1.0))
    _draw_mappers(upper, flown, flown[usual], open_loop)
    _draw_intervals(lower, seldom, minutes)
    return figure


def _draw_mappers(
    panel: Axes, flown: Mapping[str, Flights], usual: Flights, open_loop: Mapping[str, Followed]
) -> None:
    alike = []
    usual_time = float(np.median(usual.firing_time))
    longest = max(float(np.median(flights.firing_time)) for flights in flown.values())
    for name, flights in flown.items():
        time, miss = (np.quantile(one, [0.1, 0.5, 0.9]) for one in (flights.firing_time, flights.miss))
        rate = float(flights.success.mean())
        together = bool(abs(time[1] / usual_time - 1.0) < _ALIKE and rate > 0.9)
        color = BLUE if together else RED
        panel.plot([time[0], time[2]], [miss[1], miss[1]], color=color, linewidth=1.2, alpha=0.6)
        panel.plot([time[1], time[1]], [miss[0], miss[2]], color=color, linewidth=1.2, alpha=0.6)
        panel.plot(time[1], miss[1], "o", color=color, markersize=6)
        if together:
            alike.append(name)
        else:
            text = f"{name} ({100.0 * rate:.0f} % in the box)"
            _label(panel, text, (time[1], miss[1]), color, leftwards=time[1] > longest / 2.0)
    panel.annotate(
        "\n".join([f"in the box, firing time alike within {100.0 * _ALIKE:.0f} %:", *alike]),
        (0.64, 0.97),
        xycoords="axes fraction",
        va="top",
        color=BLUE,
        fontsize=_SMALL,
    )
    for name, end in open_loop.items():
        panel.plot(end.firing_time, end.miss, "s", color=INK, markerfacecolor="white", markersize=6)
        _label(panel, f"{name}: {end.miss:.3g} m", (end.firing_time, end.miss), INK)
    _draw_box(panel)
    panel.set(
        yscale="log",
        xlim=(-0.03 * longest, None),
        xlabel="firing time, thruster-seconds",
        ylabel="final miss, m",
        title="Each mapper in the same loop: median, and from the 10th to the 90th percentile",
    )


def _draw_intervals(panel: Axes, seldom: Mapping[str, Sequence[Flights]], minutes: Sequence[float]) -> None:
    for (name, of_mapper), color in zip(seldom.items(), (RED, GREEN, BLUE), strict=True):
        low, middle, high = np.array([np.quantile(one.miss, [0.1, 0.5, 0.9]) for one in of_mapper]).T
        panel.plot(minutes, middle, "o-", color=color, label=name)
        panel.fill_between(minutes, low, high, color=color, alpha=0.12, linewidth=0)
    _draw_box(panel)
    panel.set(
        yscale="log",
        xlabel="minutes between plans",
        ylabel="final miss, m",
        title="Four thrusters at once, planned anew less and less often",
    )
    panel.legend(loc="upper left")


def _draw_box(panel: Axes) -> None:
    panel.axhline(POSITION_TOLERANCE, color=INK, linewidth=1.0, linestyle=":")
    panel.annotate(
        "terminal box",
        (0.99, POSITION_TOLERANCE),
        (0, 2),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        ha="right",
        fontsize=_SMALL,
    )


def _label(panel: Axes, text: str, at: tuple[float, float], color: str, *, leftwards: bool = False) -> None:
    panel.annotate(
        text,
        at,
        (-9, 7) if leftwards else (9, -3),
        textcoords="offset points",
        ha="right" if leftwards else "left",
        color=color,
        fontsize=_SMALL,
    )
