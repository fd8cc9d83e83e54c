"""How the source's rendezvous are shown: paths in the orbital plane, delta-v spent, a table, what is kept."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from reproductions.figures import BLUE, GREEN, ORANGE, RED, Figure, panels
from reproductions.record import Table
from reproductions.yang2003.fault_mission import Flight
from reproductions.yang2003.section_6_3_coupling_in_flight import PERIOD, path

COLOURS = (ORANGE, BLUE, GREEN, RED)
COLUMNS = {
    "pilot": "{0}",
    "final miss, m": "{1.miss:.1f}",
    "final speed, m/s": "{1.speed:.3f}",
    "plans anew": "{1.replans}",
    "commanded delta-v, m/s": "{1.delta_v:.3f}",
    "commanded firing, thruster-s": "{1.firing_time:.1f}",
    "propellant, thruster-s": "{1.burnt:.1f}",
}


def table(flights: Mapping[str, Flight], columns: Mapping[str, object] = COLUMNS) -> Table:
    """How flights ended, by pilot."""
    return Table.of("By Hill's equations, without attitude", flights, columns)


def kept(flight: Flight) -> dict[str, object]:
    """What is kept of a flight."""
    return {
        "miss": flight.miss,
        "speed": flight.speed,
        "plans_anew": flight.replans,
        "commanded_delta_v": flight.delta_v,
        "commanded_firing_time": flight.firing_time,
        "propellant": flight.burnt,
        "found": [vars(one) for one in flight.found],
    }


def draw_flights(flights: Mapping[str, Flight]) -> Figure:
    """Paths with their plans, and beside them the commanded delta-v over time; at most four, by name."""
    figure, (left, right) = panels(2, height=3.9)
    paths(left, flights)
    spent(right, flights)
    return figure


def paths(axes: Axes, flights: Mapping[str, Flight]) -> None:
    """Flown paths as lines, plans as dots."""
    for colour, (name, flight) in zip(COLOURS, flights.items(), strict=False):
        for _, plan in flight.plans:
            path(axes, plan.states, ":", color=colour, linewidth=1.1)
        path(axes, flight.states, color=colour, label=name)
        axes.plot(*flight.states[-1, [1, 0]], "o", color=colour, markersize=5)
    axes.set(title="Flown (lines) and planned (dots)")
    axes.legend(loc="best", fontsize=8.5)


def spent(axes: Axes, flights: Mapping[str, Flight]) -> None:
    """Commanded delta-v up to each time."""
    for colour, (name, flight) in zip(COLOURS, flights.items(), strict=False):
        total = flight.spent()
        axes.plot(PERIOD / 60.0 * np.arange(total.size), total, color=colour, label=name)
    axes.set(xlabel="time, min", ylabel="commanded delta-v, m/s", title="Spent")
    axes.set(ylim=(0.0, None), xlim=(0.0, None))


def beside_earlier(figures: Mapping[str, tuple[float, float]]) -> Table:
    """Figures, ours and those of an earlier computation, by name.

    It was made before the library, with SciPy's HiGHS: the same equations and periods, rate changes planned
    and mapped by other code. Where it agrees, two programs do. With damaged thrusters it fires up to 3 % less
    and takes a little more delta-v, which has a high price in the plans here.
    """
    return Table.of(
        "Beside an earlier computation of this project by other code",
        figures,
        {
            "": "{0}",
            "ours": "{1[0]:.5g}",
            "earlier": "{1[1]:.5g}",
            "difference, %": lambda _, both: f"{100.0 * (both[0] / both[1] - 1.0):.1f}",
        },
    )
