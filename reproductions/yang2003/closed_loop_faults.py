"""A thruster fails in flight, and the classical pilot finds out by itself: Orion's rendezvous in closed loop.

The source flies single scenarios without attitude (section 6.4.3, appendix E). Here each of many flights of
`OrionRendezvous-v1` has one random fault, in six degrees of freedom with scatter, sensor noise and coupling
loss; the pilot that diagnoses stands between one that knows (`oracle`) and one that does not ask (`blind`).
Settings were chosen on validation seeds, the flights are of test seeds. The threshold follows from the stated
rate of false alarms; healthy flights show whether that holds, and what they would have set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from reproductions.cells import proportion, quantiles
from reproductions.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    RED,
    Figure,
    bars,
    grid,
    ranges,
    reference_line,
    ticks,
)
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.fault_flights import (
    FAULT_KINDS,
    PILOTS,
    Flight,
    HealthyFlight,
    fly_all,
    fly_healthy,
)
from reproductions.yang2003.rendezvous_flights import POSITION_TOLERANCE
from thruster_baselines.control.classical_pilot import DiagnosisSettings
from thruster_baselines.control.fault_allocation import FaultAllocation, ThrusterBelief
from thruster_baselines.detection.calibration import threshold_for_rate
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.protocols import FloatArray
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import load

FLIGHTS_PER_EFFORT = 2  # 200 flights with each pilot at full effort
HEALTHY_PER_EFFORT = 4  # 400 flights without fault, of validation seeds
FEW = 10  # with fewer flights than this, they only show that all runs, and may be short
OF_ORACLE, OF_FUEL = 0.9, 0.1  # targets: share of what the oracle can fly, firing time beyond the oracle's
PART, SHORT_PERIOD = 0.2, 1.0  # of the flights, flown again with control periods of so many s
HEALTHY_PART = 0.25  # the same of those without fault, which have five times as many intervals
ORACLE, DIAGNOSING, NOT_ASKING = "oracle", "classical", "blind"
_NAMES = {"stuck_off": "dead", "loss": "half thrust", "stuck_on": "stuck on"}


@reproduces(
    "closed-loop-faults",
    lines="section 6.4.3 and appendix E (E39 to E48), ours in six degrees of freedom",
    reported="nothing of this kind: single scenarios, without attitude",
    criterion="the classical pilot flies 90 % of what the oracle can fly, within 10 % of its firing time at "
    "the median, and more than the blind pilot, with alarms at the stated rate where nothing fails",
)
def study(effort: Effort) -> Finding:
    """Orion's rendezvous with a random fault, diagnosed in flight."""
    count = FLIGHTS_PER_EFFORT * effort.flights
    orbits = 0.5 if count >= FEW else 0.05
    by_pilot = _sorted(fly_all(TEST[:count], orbits))
    few = TEST[: max(1, int(PART * count))]
    quick = _sorted(fly_all(few, orbits, (ORACLE, DIAGNOSING, NOT_ASKING), period=SHORT_PERIOD))
    unaffected = HEALTHY_PER_EFFORT * effort.flights
    healthy = {
        period: fly_healthy(VALIDATION[: max(1, int(part * unaffected))], orbits, period)
        for period, part in ((load("orion").control_period, 1.0), (SHORT_PERIOD, HEALTHY_PART))
    }
    alarms = {period: _alarms(flights) for period, flights in healthy.items()}
    oracle, classical = by_pilot[ORACLE], by_pilot[DIAGNOSING]
    flyable = [mine for mine, reference in zip(classical, oracle, strict=True) if reference.success]
    arrived = sum(one.success for one in flyable)
    extra = _fuel_of_oracle(classical, oracle)
    ours = "; ".join(
        f"{pilot}: {100.0 * np.mean([one.success for one in flights]):.0f} %"
        for pilot, flights in by_pilot.items()
    )
    return Finding(
        ours=f"in the box: {ours}; of the {len(flyable)} flights that the oracle can fly, the classical "
        f"pilot flies {arrived}, with {extra:.3f} of the oracle's firing time at the median",
        checks={
            f"of the flights that the oracle can fly, it flies {100.0 * OF_ORACLE:.0f} % or more": (
                bool(flyable) and arrived >= OF_ORACLE * len(flyable)
            ),
            f"its firing time is within {100.0 * OF_FUEL:.0f} % of the oracle's at the median": (
                extra <= 1.0 + OF_FUEL
            ),
            "it arrives more often than the blind pilot, at 95 % confidence": (
                arrivals(classical)[0] > arrivals(by_pilot[NOT_ASKING])[1]
            ),
            **{
                f"in periods of {period:g} s, healthy flights alarm no more often than stated": (
                    seen["alarms"] <= seen["stated rate"] * seen["intervals"]
                )
                for period, seen in alarms.items()
            },
        },
        beyond_source=True,
        note=_note(by_pilot, quick),
        data={
            "pilots": {pilot: _data(flights) for pilot, flights in by_pilot.items()},
            "by kind": {
                kind: {pilot: _data(_of(flights, kind)) for pilot, flights in by_pilot.items()}
                for kind in FAULT_KINDS
            },
            "in periods of 1 s": {pilot: _data(flights) for pilot, flights in quick.items()},
            "oracle can fly": len(flyable),
            "of these the classical pilot flies": arrived,
            "firing time of the oracle's, median": extra,
            "diagnosis": _diagnosis_data(classical),
            "alarms of healthy flights": {f"periods of {one:g} s": seen for one, seen in alarms.items()},
            "holding against a stuck thruster": {f"periods of {one:g} s": _holding(one) for one in healthy},
        },
        tables=(
            _table_of_pilots(by_pilot),
            _table_of_kinds(by_pilot, "The same by kind of fault (medians over flights)"),
            _table_of_kinds(
                quick,
                f"The same in control periods of {SHORT_PERIOD:g} s, {len(quick[ORACLE])} of these seeds",
            ),
            _table_of_holding(healthy),
            _table_of_diagnosis(classical),
            _table_of_alarms(alarms),
        ),
        figure=partial(_draw, by_pilot),
    )


def _fuel_of_oracle(flights: Sequence[Flight], oracle: Sequence[Flight]) -> float:
    """Median over the seeds that both fly of firing time over the oracle's; of all if there are none."""
    pairs = list(zip(flights, oracle, strict=True))
    both = [(mine, reference) for mine, reference in pairs if mine.success and reference.success] or pairs
    return float(np.median([mine.firing_time / reference.firing_time for mine, reference in both]))


def _sorted(flown: Sequence[Flight]) -> dict[str, list[Flight]]:
    """The flights of each pilot that flew, in the order of their seeds."""
    return {pilot: those for pilot in PILOTS if (those := [one for one in flown if one.pilot == pilot])}


def _note(by_pilot: Mapping[str, Sequence[Flight]], quick: Mapping[str, Sequence[Flight]]) -> str:
    stuck = [one for one in by_pilot[ORACLE] if one.kind == "stuck_on"]
    at_once = [one for one in quick[ORACLE] if one.kind == "stuck_on"]
    arrived = sum(one.success for one in stuck)
    text = (
        "Orion's feed has no isolation valves, so a valve that is stuck open fires to the end and three "
        "other thrusters or more have to hold against it, in every period, with the scatter of all of them "
        "(10 % from firing to firing). What that leaves of rate and angle in the last period is beyond the "
        f"terminal box of 0.5 degrees/s and 5 degrees nearly always: the oracle flies {arrived} of "
        f"{len(stuck)}."
    )
    if stuck:
        rate, angle, miss = (
            float(np.median([getattr(one, name) for one in stuck])) for name in ("rate", "angle", "miss")
        )
        text += (
            f" Its medians there are {np.degrees(rate):.1f} degrees/s, {np.degrees(angle):.0f} degrees and "
            f"{miss:.2f} m: it arrives, but not still."
        )
    if at_once:
        text += (
            f" In control periods of {SHORT_PERIOD:g} s, where less scatters before it is corrected, it "
            f"flies {sum(one.success for one in at_once)} of {len(at_once)}."
        )
    own, short = (_holding(period) for period in (load("orion").control_period, SHORT_PERIOD))
    spread = "rate after a period, root mean square, rad/s"
    text += (
        f" By computation, scatter of one period leaves {np.degrees(own[spread]):.1f} degrees/s (root mean "
        f"square over firings) in Orion's own periods and {np.degrees(short[spread]):.1f} in the short ones; "
        f"of those that hold, {own['firing of the others, periods']:.0f} thrusters' worth, one or more are "
        "open all the time, so that the authority suffices but leaves little for anything else."
    )
    return text + (
        " Where a fault shows only when its thruster is first used, the blind pilot may arrive without ever "
        "meeting it."
    )


def _table_of_pilots(by_pilot: Mapping[str, Sequence[Flight]]) -> Table:
    oracle = by_pilot[ORACLE]
    flyable = {one.seed for one in oracle if one.success}

    def relative(_: str, flights: Sequence[Flight]) -> str:
        both = any(mine.success & reference.success for mine, reference in zip(flights, oracle, strict=True))
        return f"{_fuel_of_oracle(flights, oracle):.3f}" if both else "-"

    return Table.of(
        "One random fault per flight (dead, half thrust or stuck on; any thruster; any time in the first "
        f"third), {len(oracle)} test seeds (medians over flights)",
        by_pilot,
        {
            "pilot": "{0}",
            "in the box, % (95 % interval)": lambda _, flights: _rate(flights),
            "of what the oracle can fly, % (95 % interval)": lambda _, flights: _rate(
                [one for one in flights if one.seed in flyable]
            ),
            "out of bounds, %": lambda _, flights: f"{100.0 * np.mean(_all(flights, 'lost')):.0f}",
            "firing time, thruster-s": lambda _, flights: _quantile(flights, "firing_time", ".1f"),
            "of the oracle's, where both arrive": relative,
            "final miss, m": lambda _, flights: _quantile(flights, "miss"),
            "its 90th percentile, m": lambda _, flights: _quantile(flights, "miss", share=0.9),
            "attitude error, degrees": lambda _, flights: _quantile(flights, "angle"),
            "its 90th percentile, degrees": lambda _, flights: _quantile(flights, "angle", share=0.9),
        },
    )


def _table_of_kinds(by_pilot: Mapping[str, Sequence[Flight]], title: str) -> Table:
    cells: dict[str, Callable[[Sequence[Flight]], str]] = {
        "in the box, % (95 % interval)": _rate,
        "firing time, thruster-s": lambda flights: _quantile(flights, "firing_time", ".0f"),
        "final miss, m": lambda flights: _quantile(flights, "miss"),
        "attitude error, degrees": lambda flights: _quantile(flights, "angle", ".1f"),
    }
    rows = []
    for pilot, flights in by_pilot.items():
        parts = [_of(flights, kind) for kind in FAULT_KINDS]
        rows.append((pilot, *(cell(part) if part else "-" for part in parts for cell in cells.values())))
    return Table(
        title, ("pilot", *(f"{_NAMES[kind]}: {head}" for kind in FAULT_KINDS for head in cells)), rows
    )


def _table_of_diagnosis(classical: Sequence[Flight]) -> Table:
    return Table.of(
        "What the classical pilot says of the faults; one that is never named belongs to a thruster that was "
        "not used any more, or hardly",
        [(_NAMES[kind], _diagnosis_data(_of(classical, kind))) for kind in FAULT_KINDS],
        {
            "fault": "{0}",
            "flights": "{1[flights]}",
            "named at some time": "{1[named]}",
            "named first": "{1[named first]}",
            "kind right in the end": "{1[kind right]}",
            "delay from onset, median, s": lambda _, said: (
                f"{said['delay, median, s']:.0f}" if said["named"] else "-"
            ),
            "flights in which another was named too": "{1[others named]}",
        },
    )


def _diagnosis_data(classical: Sequence[Flight]) -> dict[str, float]:
    """Counts over flights of what was said of the thruster that failed, and of others."""
    named, first, right, others, delays = 0, 0, 0, 0, []
    for flight in classical:
        names = [one for one in flight.decisions if one.what == "named"]
        mine = [one for one in flight.decisions if one.thruster == flight.thruster and one.kind]
        if any(one.thruster == flight.thruster for one in names):
            named += 1
            first += names[0].thruster == flight.thruster
            right += mine[-1].kind == flight.kind
            delays.append(next(one.time for one in names if one.thruster == flight.thruster) - flight.onset)
        others += any(one.thruster != flight.thruster for one in names)
    return {
        "flights": len(classical),
        "named": named,
        "named first": first,
        "kind right": right,
        "others named": others,
        "delay, median, s": float(np.median(delays)) if delays else 0.0,
    }


def _holding(period: float) -> dict[str, float]:
    """What is left while others hold against a thruster that is stuck on: medians over thrusters."""
    spacecraft = replace(load("orion"), control_period=period)
    allocation, noise = FaultAllocation(spacecraft), PhysicalNoise(spacecraft)
    spread, longest, several = [], [], []
    for thruster in range(1, spacecraft.number_of_thrusters + 1):
        belief = ThrusterBelief.healthy(spacecraft.number_of_thrusters)
        belief = belief.changed(thruster, share=1.0, stuck_on=True)
        on_times = allocation(np.zeros(6), belief)
        scattered = noise(allocation.delivered(on_times, belief)) - np.diag(noise.sensors)
        spread.append(np.sqrt(np.trace(scattered[3:, 3:])))
        longest.append(on_times.max() / period)
        several.append(on_times.sum() / period)
    return {
        "rate after a period, root mean square, rad/s": float(np.median(spread)),
        "longest on-time of the others, periods": float(np.median(longest)),
        "firing of the others, periods": float(np.median(several)),
    }


def _table_of_holding(periods: Iterable[float]) -> Table:
    return Table.of(
        "Holding against a thruster that is stuck on, computed (medians over thrusters): the authority is "
        "there, and scatter of one period decides",
        [(period, _holding(period)) for period in periods],
        {
            "control period, s": "{0:g}",
            "longest on-time of the others, % of the period": lambda _, left: (
                f"{100.0 * left['longest on-time of the others, periods']:.0f}"
            ),
            "their firing, thruster-periods": "{1[firing of the others, periods]:.2f}",
            "rate that scatter leaves after one period, root mean square, degrees/s": lambda _, left: (
                f"{np.degrees(left['rate after a period, root mean square, rad/s']):.2f}"
            ),
        },
    )


def _alarms(healthy: Sequence[HealthyFlight]) -> dict[str, Any]:
    """How often healthy flights exceed the threshold, and which one they would have set."""
    rate = DiagnosisSettings().false_alarm_rate
    most = max(one.statistics.size for one in healthy)
    statistics = np.array([np.pad(one.statistics, (0, most - one.statistics.size)) for one in healthy])
    threshold, intervals = healthy[0].threshold, sum(one.statistics.size for one in healthy)
    alarms = int((statistics > threshold).sum())
    seen = {
        "flights": len(healthy),
        "intervals": intervals,
        "stated rate": rate,
        "threshold": threshold,
        "alarms": alarms,
        "interval": clopper_pearson(alarms, intervals),
        "largest": float(statistics.max()),
        "flights in which one was named": sum(one.names > 0 for one in healthy),
        "in the box": sum(one.success for one in healthy),
    }
    if len(healthy) >= FEW:
        seen["threshold from these flights"] = threshold_for_rate(statistics, rate).threshold
    return seen


def _table_of_alarms(alarms: Mapping[float, Mapping[str, Any]]) -> Table:
    def by_flights(_: float, seen: Mapping[str, Any]) -> str:
        own = seen.get("threshold from these flights")
        return "-" if own is None else f"{own:.1f}"

    def rates(_: float, seen: Mapping[str, Any]) -> str:
        low, high = seen["interval"]
        return f"{1e4 * (seen['alarms'] / seen['intervals']):.2f} ({1e4 * low:.2f} to {1e4 * high:.2f})"

    return Table.of(
        "Alarms of the classical pilot in flights of validation seeds without a fault; at most one in "
        f"{1.0 / DiagnosisSettings().false_alarm_rate:.0f} intervals is stated",
        alarms,
        {
            "control period, s": "{0:g}",
            "flights": "{1[flights]}",
            "intervals": "{1[intervals]}",
            "threshold, closed form": "{1[threshold]:.1f}",
            "alarms": "{1[alarms]}",
            "per 10,000 intervals (95 % interval)": rates,
            "largest likelihood ratio": "{1[largest]:.1f}",
            "threshold that these flights alone would set": by_flights,
            "flights in which one was named": "{1[flights in which one was named]}",
            "in the box": "{1[in the box]}",
        },
    )


def _of(flights: Sequence[Flight], kind: str) -> list[Flight]:
    return [one for one in flights if one.kind == kind]


def _all(flights: Sequence[Flight], name: str) -> FloatArray:
    return np.array([getattr(one, name) for one in flights], dtype=np.float64)


def _quantile(flights: Sequence[Flight], name: str, form: str = ".2f", share: float = 0.5) -> str:
    """Of a figure of the flights; angles in degrees."""
    value = np.quantile(_all(flights, name), share)
    return f"{np.degrees(value) if name == 'angle' else value:{form}}"


def arrivals(flights: Sequence[Flight]) -> tuple[float, float]:
    """The interval of the share that ends in the terminal box."""
    return clopper_pearson(sum(one.success for one in flights), len(flights))


def _rate(flights: Sequence[Flight]) -> str:
    return proportion(sum(one.success for one in flights), len(flights), ".0f", "")


def _data(flights: Sequence[Flight]) -> dict[str, object]:
    """What is kept: counts, and quantiles of the rest at 10, 50 and 90 %."""
    if not flights:
        return {"flights": 0}
    return {
        "flights": len(flights),
        "in_the_box": sum(one.success for one in flights),
        "interval": arrivals(flights),
        "lost": sum(one.lost for one in flights),
        **{
            name: quantiles(_all(flights, name)) for name in ("miss", "speed", "angle", "rate", "firing_time")
        },
    }


def _draw(by_pilot: Mapping[str, Sequence[Flight]]) -> Figure:
    """Success by kind of fault, and final miss against firing time of every flight."""
    figure, axes = grid(2, 1, 8.2, height_ratios=(1.0, 1.5))
    (upper,), (lower,) = axes
    colours = (GREEN, BLUE, RED, ORANGE, PURPLE)
    counts = [len(_of(by_pilot[ORACLE], kind)) for kind in FAULT_KINDS]
    groups = {pilot: [_of(flights, kind) for kind in FAULT_KINDS] for pilot, flights in by_pilot.items()}
    shares = {
        pilot: [100.0 * np.mean(_all(one, "success")) if one else np.nan for one in those]
        for pilot, those in groups.items()
    }
    for places, those in zip(bars(upper, shares, colours), groups.values(), strict=True):
        for place, one in zip(places, those, strict=True):
            if one:
                ranges(upper, place, *(100.0 * end for end in arrivals(one)), INK, linewidth=1.2)
    ticks(
        upper, [f"{_NAMES[kind]} ({count} flights)" for kind, count in zip(FAULT_KINDS, counts, strict=True)]
    )
    upper.set(ylim=(0.0, 105.0), ylabel="in the terminal box, %", title="Who arrives, with 95 % intervals")
    upper.legend(loc="upper right", ncols=2)
    markers = dict(zip(FAULT_KINDS, "o^s", strict=True))
    for (pilot, flights), colour in zip(by_pilot.items(), colours, strict=True):
        for kind, marker in markers.items():
            those = [one for one in _of(flights, kind) if one.firing_time > 0.0]
            miss = np.maximum(_all(those, "miss"), 1e-2)
            face = "none" if pilot in ("oracle", "does nothing") else colour
            lower.plot(
                _all(those, "firing_time"), miss, marker, color=colour, markersize=4.0, markerfacecolor=face,
                alpha=0.7,
            )  # fmt: skip
    for kind, marker in markers.items():
        lower.plot([], [], marker, color=INK, markersize=5.0, linestyle="none", label=_NAMES[kind])
    reference_line(lower, POSITION_TOLERANCE, "terminal box", at=0.01, linestyle=":")
    lower.set(
        xscale="log", yscale="log", xlabel="firing time, thruster-seconds (who fired nothing is left out)"
    )
    lower.set(ylabel="final miss, m", title="Every flight: where it ended, and what it fired")
    lower.legend(loc="lower left")
    return figure
