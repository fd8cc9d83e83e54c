"""Pictures of the source's rendezvous: paths in the orbital plane, what the detector saw, delta-v spent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from reproductions.figures import BLUE, GREEN, INK, ORANGE, RED, panels
from reproductions.yang2003.fault_mission import Flight
from reproductions.yang2003.section_6_3_coupling_in_flight import PERIOD, START
from thruster_envs.protocols import FloatArray

COLORS = (ORANGE, BLUE, GREEN, RED)
FLOOR = 1e-9  # of likelihood ratios that are shown


def draw_flights(flights: Mapping[str, Flight]) -> None:
    """Paths with their plans, and beside them the commanded delta-v over time.

    Args:
        flights: At most four, by name.
    """
    figure, (left, right) = panels(2, height=3.9)
    paths(left, flights)
    spent(right, flights)
    return figure


def paths(axes: Axes, flights: Mapping[str, Flight]) -> None:
    """Flown paths as lines, plans as dots."""
    for color, (name, flight) in zip(COLORS, flights.items(), strict=False):
        for _, plan in flight.plans:
            axes.plot(plan.states[:, 1], plan.states[:, 0], ":", color=color, linewidth=1.1)
        axes.plot(flight.states[:, 1], flight.states[:, 0], color=color, label=name)
        axes.plot(*flight.states[-1, [1, 0]], "o", color=color, markersize=5)
    axes.annotate("target", (0.0, 0.0), (5, 5), textcoords="offset points")
    axes.annotate("start", (START[1], START[0]), (5, 2), textcoords="offset points")
    axes.set(xlabel="along-track, m", ylabel="radial, m", title="Flown (lines) and planned (dots)")
    axes.legend(loc="best", fontsize=8.5)


def spent(axes: Axes, flights: Mapping[str, Flight]) -> None:
    """Commanded delta-v up to each time."""
    for color, (name, flight) in zip(COLORS, flights.items(), strict=False):
        total = flight.spent()
        axes.plot(PERIOD / 60.0 * np.arange(total.size), total, color=color, label=name)
    axes.set(
        xlabel="time, min", ylabel="commanded delta-v, m/s", title="Spent", ylim=(0.0, None), xlim=(0.0, None)
    )


def draw_second(
    flights: Mapping[str, Flight], ratios: FloatArray, times: Sequence[float], threshold: float
) -> None:
    """Paths with their plans, and beside them the likelihood ratios of all thrusters in seconds of firing.

    Args:
        flights: At most four, by name.
        ratios: (seconds, n).
        times: At the end of each, s.
        threshold: Of the test.
    """
    figure, (left, right) = panels(2, height=3.9)
    paths(left, flights)
    first, second = np.argsort(ratios.max(axis=0))[[-1, -2]]
    for i in range(ratios.shape[1]):
        style = {int(first): (RED, "o", 5.0), int(second): (BLUE, "s", 9.0)}.get(i, (INK, ".", 3.0))
        label = f"thruster {i + 1}" if i in (first, second) else None
        right.plot(
            times,
            ratios[:, i],
            style[1],
            color=style[0],
            markersize=style[2],
            label=label,
            fillstyle="none" if i == second else "full",
        )
    right.axhline(threshold, color=INK, linestyle="--", linewidth=1.0, label="threshold")
    right.set(xlabel="time, s", ylabel="likelihood ratio", title="Seen by the detector, second by second")
    right.set(yscale="log", ylim=(FLOOR, 1e-3), xlim=(0.0, None))
    right.legend(loc="upper left", fontsize=8.5)
    return figure
