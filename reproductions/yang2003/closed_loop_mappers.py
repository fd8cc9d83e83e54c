"""Does the choice of the mapper matter where it is used? Orion's rendezvous with each of them.

`OrionRendezvous-v1` in six degrees of freedom, with coupling loss, scatter and sensor noise, flown by one
controller with each mapper in the place of the linear program, on the same validation seeds. The source flies
open loop (E31 and E32, rows of this table too); this controller plans anew from what it measures, and so
makes up for what a mapper fell short of. No faults here. The controller's filter knows the coupling whatever
the mapper knows, and takes the on-times from the observation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from reproductions.cells import proportion, quantiles
from reproductions.figures import BLUE, GREEN, INK, RED, Figure, annotate, band, grid, ranges, reference_line
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.rendezvous_flights import POSITION_TOLERANCE, Flights, Make, fly
from reproductions.yang2003.section_6_3_coupling_in_flight import (
    ROOM,
    SHARE,
    Followed,
    compensated,
    followed,
    plan_on_times,
)
from thruster_baselines import mapping
from thruster_baselines.control import RendezvousController, RendezvousSettings
from thruster_baselines.mapping.base import BaseMapper, ClosedFormMapper
from thruster_baselines.mapping.model import Model
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.protocols import Allocation, FloatArray
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import Spacecraft, load

ORION = load("orion")
SCATTER = ORION.thrusters[0].scatter
INTERVALS = (4, 30, 100, 200, 300)  # periods between plans, in the second table
PART = 0.2  # of the flights: as many for each cell of the second table
ALIKE = 0.05  # of the usual firing time: so near to it, mappers are drawn as one group
FEW = 10  # with fewer flights than this, they only show that all runs, and may be short


class ControllerAllocation(BaseMapper):
    """How the rendezvous controller allocates by itself: the linear program, inflated, rotation first."""

    def __init__(self, spacecraft: Spacecraft) -> None:
        super().__init__(spacecraft)
        self._controller = RendezvousController(spacecraft, steps=1)

    def _allocate(self, command: FloatArray, model: Model) -> Allocation:
        on_times = np.apply_along_axis(self._controller.allocate, -1, command)
        slack = command - on_times @ model.effectiveness.T
        return Allocation(on_times, slack, on_times.sum(axis=-1), np.zeros(command.shape[:-1], np.int64))


class NoFiring(ClosedFormMapper):
    """Fires nothing: what the orbit does by itself."""

    def _prepare(self, effectiveness: FloatArray) -> tuple[FloatArray, ...]:
        return (np.zeros(effectiveness.shape[-1]),)

    def _on_times(self, command: FloatArray, *prepared: FloatArray) -> FloatArray:
        return np.broadcast_to(prepared[0], (*command.shape[:-1], prepared[0].size))


@dataclass(frozen=True)
class Row:
    """A mapper of the table."""

    name: str  # as the table calls it
    make: Make  # makes it for a spacecraft
    knows: str = ""  # what it knows besides the command and the healthy effectiveness
    share: float = 1.0  # of the flights, if it takes too long to fly them all; rounded down


LINEAR_PROGRAM = Row("linear program", mapping.LPMapper)
METHOD_2 = Row("method II", mapping.AdditiveCompensationMapper, "coupling")
EXACT = Row("exact compensation", mapping.ExactCompensationMapper, "coupling")
INTEGER = Row("integer program", mapping.MILPMapper, "coupling", share=0.1)
SHIFT = Row("minimum norm and shift", mapping.MinimumNormShiftMapper)
CLIPPED = Row("pseudo-inverse, clipped", mapping.PseudoInverseMapper)
ROWS = (
    Row("the controller's own allocation", ControllerAllocation, "coupling"),
    LINEAR_PROGRAM,
    Row("method I", mapping.DifferentialCompensationMapper, "coupling"),
    METHOD_2,
    EXACT,
    INTEGER,
    Row(
        "robust LP, command",
        partial(
            mapping.RobustCommandMapper,
            attitude=mapping.AttitudeUncertainty(half_widths=ORION.sensors.attitude),
        ),
        "attitude noise",
    ),
    Row("robust LP, effectiveness", partial(mapping.RobustEffectivenessMapper, relative=SCATTER), "scatter"),
    Row("conic robust", partial(mapping.ConicRobustMapper, spread=SCATTER), "scatter"),
    Row(
        "chance-constrained",
        partial(mapping.ChanceConstrainedMapper, standard_deviation=SCATTER / math.sqrt(3.0)),
        "scatter",
    ),
    Row("quadratic program", mapping.QuadraticMapper),
    Row("non-negative least squares, bounded", partial(mapping.NonNegativeLeastSquaresMapper, bounded=True)),
    Row("null space", mapping.NullSpaceMapper),
    SHIFT,
    Row("pseudo-inverse, redistributed", mapping.RedistributedPseudoInverseMapper),
    CLIPPED,
    Row("crude", mapping.CrudeMapper),
    Row("no firing", NoFiring, share=0.25),
)


@reproduces(
    "closed-loop-mappers",
    lines="section 6.3 (E31, E32), ours in six degrees of freedom",
    reported="nothing: the source flies open loop",
    criterion="over 90 % arrive with the linear program, compensated or not; what separates mappers is "
    "firing time, and rare plans",
)
def study(effort: Effort) -> Finding:
    """Orion's rendezvous flown with each mapper in the loop."""
    orbits = 0.5 if effort.flights >= FEW else 0.02
    flown = fly_all(effort.flights, orbits)
    seldom = fly_seldom_planned(max(1, int(PART * effort.flights)), orbits)
    open_loop = {
        "E31, open loop, linear program": followed(plan_on_times(SHARE)),
        "E32, open loop, method II": compensated(ROOM, ORION.control_period),
    }
    plain, exact, shift, clipped = (flown[row.name] for row in (LINEAR_PROGRAM, EXACT, SHIFT, CLIPPED))
    late = {name: float(np.median(of_mapper[-1].miss)) for name, of_mapper in seldom.items()}
    compensating = (METHOD_2.name, EXACT.name)
    return Finding(
        ours="; ".join(
            f"{name}: {100.0 * one.success.mean():.0f} % in the box, {np.median(one.miss):.2f} m, "
            f"{np.median(one.firing_time):.0f} thruster-s"
            for name, one in (
                (LINEAR_PROGRAM.name, plain),
                (EXACT.name, exact),
                (SHIFT.name, shift),
                (CLIPPED.name, clipped),
            )
        ),
        checks={
            "with compensation or without, over 90 % arrive, at 95 % confidence": all(
                _interval(flown[name].success)[0] > 0.9 for name in (LINEAR_PROGRAM.name, *compensating)
            ),
            "compensation changes the firing time by less than 2 %": all(
                abs(_relative(flown[name], plain) - 1.0) < 0.02 for name in compensating
            ),
            "without a look back, the linear program ends a hundred times as far off": (
                next(iter(open_loop.values())).miss > 100.0 * float(np.median(plain.miss))
            ),
            f"planned anew every {INTERVALS[-1]} periods, it ends three times as far off as compensated": all(
                late[LINEAR_PROGRAM.name] > 3.0 * late[name] for name in compensating
            ),
            "minimum norm and shift fires three times as long": _relative(shift, plain) > 3.0,
            "the clipped pseudo-inverse brings none home": not clipped.success.any(),
        },
        beyond_source=True,
        note="The same controller and the same seeds for all. It plans anew every few periods while it "
        "burns, and what a mapper falls short of is in the next measurement, so that the next plan asks for "
        "it again: the loss hardly matters where plans are frequent, and does where they are rare. In the "
        "second table the plan burns with four thrusters at once, as the source's does; in the first it "
        "keeps to the firing time of two. Making up for the loss of four takes more firing than burning with "
        "fewer for longer, as plans made anew do without compensation; it pays if plans are rare. The "
        f"integer program, which takes long, flies {100.0 * INTEGER.share:.0f} % of the seeds.",
        data={
            "mappers": {name: _data(flights) for name, flights in flown.items()},
            "open loop": {name: asdict(end) for name, end in open_loop.items()},
            "planned less often": {
                name: {f"{interval}": _data(one) for interval, one in zip(INTERVALS, of_mapper, strict=True)}
                for name, of_mapper in seldom.items()
            },
        },
        tables=(_table_of_mappers(flown, open_loop), _table_of_intervals(seldom)),
        figure=lambda: _draw(flown, open_loop, seldom),
    )


def fly_all(flights: int, orbits: float) -> dict[str, Flights]:
    """Fly each mapper on the first validation seeds; a row that is left with none is left out."""
    counts = {row: int(row.share * flights) for row in ROWS}
    return {
        row.name: fly(ORION, row.make, VALIDATION[:count], orbits=orbits)
        for row, count in counts.items()
        if count
    }


def fly_seldom_planned(flights: int, orbits: float) -> dict[str, list[Flights]]:
    """Fly with four thrusters at once; for each mapper, the flights at each of `INTERVALS`.

    Planned on-times are at most 80 % of a period: with 18 % lost, that is what can be made up for within it.
    """
    settings = [
        RendezvousSettings(
            planned_share=0.8, planned_thrusters=4.0, replan_burning=interval,
            replan_coasting=max(interval, RendezvousSettings().replan_coasting),
        )
        for interval in INTERVALS
    ]  # fmt: skip
    return {
        row.name: [fly(ORION, row.make, VALIDATION[:flights], one, orbits) for one in settings]
        for row in (LINEAR_PROGRAM, METHOD_2, EXACT)
    }


def _table_of_mappers(flown: Mapping[str, Flights], open_loop: Mapping[str, Followed]) -> Table:
    knows = {row.name: row.knows or "-" for row in ROWS}
    usual = flown[LINEAR_PROGRAM.name]
    closed = Table.of(
        "OrionRendezvous-v1 flown with each mapper, healthy, with coupling, scatter and noise (medians over "
        "flights); the last rows are the source's own flights, by Hill's equations alone",
        flown,
        {
            "mapper": "{0}",
            "knows of": lambda name, _: knows[name],
            "flights": "{1.miss.size}",
            "in the box, % (95 % interval)": lambda _, one: _rate(one.success),
            "lost, %": lambda _, one: f"{100.0 * one.lost.mean():.0f}",
            "final miss, m": lambda _, one: f"{np.median(one.miss):.2f}",
            "its 90th percentile, m": lambda _, one: f"{np.quantile(one.miss, 0.9):.2f}",
            "final speed, m/s": lambda _, one: f"{np.median(one.speed):.4f}",
            "commanded delta-v, m/s": lambda _, one: f"{np.median(one.commanded):.2f}",
            "firing time, thruster-s": lambda _, one: f"{np.median(one.firing_time):.1f}",
            "of the linear program's, seed by seed": lambda _, one: f"{_relative(one, usual):.3f}",
        },
    )
    reference = float(np.median(usual.firing_time))
    rows = [
        (name, "-", "1", "-", "-", f"{end.miss:.2f}", "-", f"{end.speed:.4f}", "-", f"{end.firing_time:.1f}",
         f"{end.firing_time / reference:.3f}")
        for name, end in open_loop.items()
    ]  # fmt: skip
    return replace(closed, rows=(*closed.rows, *rows))


def _table_of_intervals(seldom: Mapping[str, list[Flights]]) -> Table:
    cells: dict[str, Callable[[Flights], str]] = {
        "in the box, % (95 % interval)": lambda one: _rate(one.success),
        "final miss, m": lambda one: f"{np.median(one.miss):.2f}",
        "firing time, thruster-s": lambda one: f"{np.median(one.firing_time):.1f}",
    }
    count = len(next(iter(seldom.values()))[0].miss)
    return Table(
        f"Four thrusters at once, planned anew every so many periods (medians over {count} flights)",
        ("periods", *(f"{name}: {head}" for name in seldom for head in cells)),
        [
            (f"{interval}", *(cell(one[i]) for one in seldom.values() for cell in cells.values()))
            for i, interval in enumerate(INTERVALS)
        ],
    )


def _relative(flights: Flights, usual: Flights) -> float:
    """Median over the seeds of firing time over firing time."""
    return float(np.median(flights.firing_time / usual.firing_time[: len(flights.firing_time)]))


def _rate(success: NDArray[np.bool_]) -> str:
    return proportion(success.sum(), success.size, ".0f", "")


def _interval(success: NDArray[np.bool_]) -> tuple[float, float]:
    return clopper_pearson(int(success.sum()), success.size)


def _data(flights: Flights) -> dict[str, object]:
    """What is kept: counts, and quantiles of the rest at 10, 50 and 90 %."""
    return {
        "flights": flights.success.size,
        "in_the_box": int(flights.success.sum()),
        "interval": _interval(flights.success),
        "lost": int(flights.lost.sum()),
        **{name: quantiles(getattr(flights, name)) for name in ("miss", "speed", "firing_time", "commanded")},
    }


def _draw(
    flown: Mapping[str, Flights], open_loop: Mapping[str, Followed], seldom: Mapping[str, Sequence[Flights]]
) -> Figure:
    """Final miss against firing time of each mapper, and final miss against how often a plan is made."""
    figure, axes = grid(2, 1, 8.6, height_ratios=(1.35, 1.0))
    (upper,), (lower,) = axes
    usual = float(np.median(flown[LINEAR_PROGRAM.name].firing_time))
    longest = max(float(np.median(flights.firing_time)) for flights in flown.values())
    alike = [f"in the box, firing time alike within {100.0 * ALIKE:.0f} %:"]
    for name, flights in flown.items():
        (early, time, late), (near, miss, far) = quantiles(flights.firing_time), quantiles(flights.miss)
        arrived = float(flights.success.mean())
        together = abs(time / usual - 1.0) < ALIKE and arrived > 0.9
        colour = BLUE if together else RED
        ranges(upper, miss, early, late, colour, flat=True, linewidth=1.2, alpha=0.6)
        ranges(upper, time, near, far, colour, linewidth=1.2, alpha=0.6)
        upper.plot(time, miss, "o", color=colour, markersize=6)
        if together:
            alike.append(name)
        else:
            text = f"{name} ({100.0 * arrived:.0f} % in the box)"
            leftwards = {"offset": (-9, 7), "ha": "right"} if time > longest / 2.0 else {"offset": (9, -3)}
            annotate(upper, text, (time, miss), color=colour, fontsize=8.5, **leftwards)
    corner = {"xycoords": "axes fraction", "va": "top", "color": BLUE, "fontsize": 8.5}
    annotate(upper, "\n".join(alike), (0.64, 0.97), **corner)
    for name, end in open_loop.items():
        upper.plot(end.firing_time, end.miss, "s", color=INK, markerfacecolor="white", markersize=6)
        annotate(
            upper, f"{name}: {end.miss:.3g} m", (end.firing_time, end.miss), (9, -3), color=INK, fontsize=8.5
        )
    upper.set(yscale="log", xlim=(-0.03 * longest, None), xlabel="firing time, thruster-seconds")
    upper.set(title="Each mapper in the same loop: median, and from the 10th to the 90th percentile")
    minutes = np.array(INTERVALS) * ORION.control_period / 60.0
    for (name, of_mapper), colour in zip(seldom.items(), (RED, GREEN, BLUE), strict=True):
        low, middle, high = np.array([quantiles(one.miss) for one in of_mapper]).T
        lower.plot(minutes, middle, "o-", color=colour, label=name)
        band(lower, minutes, low, high, colour, 0.12)
    lower.set(yscale="log", xlabel="minutes between plans")
    lower.set(title="Four thrusters at once, planned anew less and less often")
    lower.legend(loc="upper left")
    for panel in (upper, lower):
        reference_line(panel, POSITION_TOLERANCE, "terminal box", linestyle=":")
        panel.set(ylabel="final miss, m")
    return figure
