"""Fault, diagnosis, recovery: 500 approaches of the Mars chaser with one fault each, and ten healthy hours.

The source closes no loop over its diagnosis and looks at open valves alone. Here any thruster fails in any
way at any time, and four pilots fly the same flights; see `recovery_flights`. Thresholds come from healthy
flights of validation seeds; the tables are of test seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from reproductions.cells import finite, percent, proportion, quantiles
from reproductions.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    RED,
    Figure,
    annotate,
    bars,
    dots,
    panels,
    ranges,
    shared_legend,
    ticks,
)
from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.recovery_flights import (
    AT_ONCE,
    ENDS,
    KINDS_OF_FAULT,
    PILOTS,
    SETTLE,
    UNPROBED,
    Flight,
    calibrate,
    endings,
    fly,
    fly_healthy,
    is_affected,
    is_saved,
    isolated,
    of_kind,
    saved,
)
from reproductions.record import Effort, Finding, Table
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import load

FLIGHTS_PER_EFFORT = 5  # 500 with a fault
CALIBRATION_PER_EFFORT = 4  # 400 healthy ones of validation seeds
HEALTHY_PER_EFFORT = 1.8  # 180 healthy ones of test seeds: a little more than ten hours
WATCHERS = ("best stack", "source's method")
PERIOD = load("msr_chaser").control_period
COLOURS = dict(zip(PILOTS, (GREEN, BLUE, ORANGE, RED), strict=True))


@reproduces(
    "mars-recovery",
    lines="beyond the source; L317-332, L334 for its method",
    reported="nothing: open faults only, and no flight goes on after the diagnosis",
    criterion="on 500 test seeds the best stack detects 99 %, isolates 98 %, median detection at most 1 s "
    "(open) and 2.5 s (others), no false alarm in ten healthy hours, it captures or retreats in "
    "95 % of the flights that the oracle saves, and says the right kind of 95 % of those it names",
)
def study(effort: Effort) -> Finding:
    """The Mars chaser's approach with any fault: diagnosed, recovered, captured or retreated."""
    thresholds = calibrate(VALIDATION[: CALIBRATION_PER_EFFORT * effort.flights])
    count = FLIGHTS_PER_EFFORT * effort.flights
    flights = {pilot: fly(pilot, TEST[:count], thresholds) for pilot in PILOTS}
    healthy_seeds = TEST[count : count + round(HEALTHY_PER_EFFORT * effort.flights)]
    healthy = {pilot: fly_healthy(pilot, healthy_seeds, thresholds) for pilot in WATCHERS}
    unprobed = [one for one in fly(UNPROBED, TEST[:count], thresholds) if is_affected(one)]
    healthy_unprobed = fly_healthy(UNPROBED, healthy_seeds, thresholds)
    either = {
        pilot: fly(pilot, TEST[:count], thresholds, either_branch=True)
        for pilot in ("best stack", AT_ONCE, "unprotected")
    }
    first = {pilot: flights.get(pilot) or fly(pilot, TEST[:count], thresholds) for pilot in either}
    hours = {pilot: sum(one.duration for one in healthy[pilot]) / 3600.0 for pilot in WATCHERS}
    false = {
        pilot: sum(np.isfinite(one.alarm) for one in healthy[pilot])
        + sum(one.alarm < one.onset for one in flights[pilot])
        for pilot in WATCHERS
    }
    affected = {pilot: [one for one in flights[pilot] if is_affected(one)] for pilot in PILOTS}
    savable = {one.seed for one in affected["oracle"] if is_saved(one)}
    best = affected["best stack"]
    detected = _detected(best)
    opened = [one.detection for one in best if one.kind == "open"]
    others = [one.detection for one in best if one.kind != "open"]
    rightly = isolated(best)
    among = [one for one in best if one.seed in savable]
    kept = sum(map(is_saved, among))
    unseen = [one for one in best if not _is_detected(one)]
    unprotected = {one.seed: one for one in flights["unprotected"]}
    harmless = sum(unprotected[one.seed].end == "captured" for one in unseen)
    not_slow = [one for one in best if one.kind != "slow"]
    said = [one for one in best if one.said]
    right = sum(map(_is_right, said))
    late = [one for one in said if one.kind == "late"]
    price = _mean_fuel(healthy["best stack"]) / _mean_fuel(healthy_unprobed) - 1.0
    checks = {
        "the best stack detects at least 99 %": detected >= 0.99 * len(best),
        "it names the right thruster in at least 98 %": rightly >= 0.98 * len(best),
        "its median detection of open faults takes at most 1 s": _median(opened) <= 1.0,
        "its median detection of the others takes at most 2.5 s": _median(others) <= 2.5,
        f"it raises no false alarm in {hours['best stack']:.1f} h of healthy flight": not any(
            np.isfinite(one.alarm) for one in healthy["best stack"]
        ),
        "it captures or retreats in at least 95 % of the flights that the oracle saves": kept
        >= 0.95 * len(among),
        "of those that it names it says the right kind in at least 95 %": right >= 0.95 * len(said),
    }
    note = (
        f"{len(best)} flights of test seeds with one fault each, as many of each kind, struck at any time of "
        "the first 190 s of some 206 s, by any thruster. A slow valve delivers later what it is told and in "
        "the mean as much: while commands are even it does not show in what is measured, and it does no "
        "harm. So the best stack probes: it opens four valves together that push and turn nowhere, the two "
        "groups of four in turn, for a period every few seconds, which costs "
        f"{100.0 * price:.1f} % more open time in a healthy flight, and more often after an alarm. The other "
        f"pilots do not. Faults that it does not notice: {len(unseen)}, of these slow valves: "
        f"{sum(one.kind == 'slow' for one in unseen)}, and captures of the unprotected pilot in these "
        f"flights: {harmless}. Of the six kinds beside slow valves it detects "
        f"{proportion(_detected(not_slow), len(not_slow))} and names the right thruster in "
        f"{proportion(isolated(not_slow), len(not_slow))}, the last of them "
        f"{_seconds(max(one.name - one.onset for one in not_slow))} after the onset. It alarms from "
        f"{SETTLE:g} s after the start on (the source's method: 40 s). No pilot that goes over to branch B "
        "has to know which thruster failed: that forgives the source's method its wrong names, since its "
        "test is right for valves that are too far open only; its alarm saves the flight. Where "
        "branch A alone can fail, nobody has to know anything: to fly on branch B from the start is as safe, "
        "and is lost where that branch fails as often (last table). What is wrong "
        "with the thruster is said when it is clear, or two seconds after the name, and at once near the "
        "target or off the path; only then the best stack acts. A pulse is no longer than the period of "
        f"{PERIOD:g} s, and an opening later than that loses every pulse whatever is commanded: it is a "
        f"closed valve to anybody, and counts as right if it is called one ({sum(map(_is_shut, late))} of "
        f"the {len(late)} late ones). One that is nearly as late hardly differs. A leak of c adds c (1 - u) "
        "to an open rate u: near to c = 1 that is a stuck valve, and in flights of validation seeds valves "
        "stuck above some 0.75 were now and then called leaks. Numbers are of MSR-A, ours."
    )
    return Finding(
        ours=f"best stack: {percent(detected, len(best))} detected, {percent(rightly, len(best))} isolated, "
        f"medians {_seconds(_median(opened))} (open) and {_seconds(_median(others))} (others), "
        f"{false['best stack']} false alarms, {percent(right, len(said))} of the named with the right "
        f"kind, {percent(kept, len(among))} of {len(among)} savable flights saved",
        checks={part: bool(holds) for part, holds in checks.items()},
        beyond_source=True,
        note=note,
        data={
            "thresholds": thresholds,
            "hours": hours,
            "false_alarms": false,
            "flights": len(best),
            "ends": {
                pilot: {end: sum(one.end == end for one in affected[pilot]) for end in ENDS}
                for pilot in PILOTS
            },
            "detected": {
                pilot: {kind: _detected(of_kind(affected[pilot], kind)) for kind in KINDS_OF_FAULT}
                for pilot in WATCHERS
            },
            "isolated": {
                pilot: {kind: isolated(of_kind(affected[pilot], kind)) for kind in KINDS_OF_FAULT}
                for pilot in WATCHERS
            },
            "unseen_and_harmless": harmless,
            "unseen": len(unseen),
            "right_kind": {kind: sum(map(_is_right, of_kind(said, kind))) for kind in KINDS_OF_FAULT},
            "price_of_probing": price,
            "saved_where_either_branch_fails": {
                pilot: sum(map(is_saved, those)) for pilot, those in either.items()
            },
        },
        tables=(
            _by_pilot(affected, savable, false, hours),
            _by_kind("best stack", affected, thresholds),
            _by_kind("source's method", affected, thresholds),
            _said(best),
            _worth_of_excitation(
                {"best stack": best, UNPROBED: unprobed},
                {"best stack": healthy["best stack"], UNPROBED: healthy_unprobed},
            ),
            Table.of(
                "Captured or retreated, whoever knows: a thruster of branch A fails, or one of either branch",
                either,
                {
                    "pilot": "{0}",
                    "branch A fails": lambda pilot, _: saved(first[pilot]),
                    "either branch fails": lambda _, those: saved(those),
                },
            ),
        ),
        figure=partial(_draw, affected),
    )


def _by_pilot(
    affected: dict[str, list[Flight]], savable: set[int], false: dict[str, int], hours: dict[str, float]
) -> Table:
    def watching(cell: Callable[[str, list[Flight]], str]) -> Callable[[str, list[Flight]], str]:
        return lambda pilot, those: cell(pilot, those) if pilot in WATCHERS else "-"

    def delay(opened: bool) -> Callable[[str, list[Flight]], str]:
        return watching(
            lambda _, those: _seconds(
                _median([one.detection for one in those if (one.kind == "open") == opened])
            )
        )

    return Table.of(
        "All flights by pilot, with 95 % intervals. False alarms: in healthy flights of the stated length, "
        "and before the fault in the others",
        {pilot: affected[pilot] for pilot in PILOTS},
        {
            "pilot": "{0}",
            "detected": watching(lambda _, those: proportion(_detected(those), len(those))),
            "right thruster": watching(lambda _, those: proportion(isolated(those), len(those))),
            "median, open": delay(True),
            "median, others": delay(False),
            "false alarms": watching(lambda pilot, _: f"{false[pilot]} in {hours[pilot]:.1f} h"),
            **endings(affected),
            "captured or retreated, of those that the oracle saves": lambda _, those: saved(
                [one for one in those if one.seed in savable]
            ),
        },
    )


def _by_kind(pilot: str, affected: dict[str, list[Flight]], thresholds: dict[str, float]) -> Table:
    limit = f"{1e3 * thresholds[pilot]:.1f} mm" if pilot == "source's method" else f"{thresholds[pilot]:.1f}"
    kinds = {kind: those for kind in KINDS_OF_FAULT if (those := of_kind(affected[pilot], kind))}

    def nine_of_ten(_: str, those: list[Flight]) -> str:
        delays = sorted(one.detection for one in those)
        return _seconds(delays[int(np.ceil(0.9 * len(delays))) - 1])

    return Table.of(
        f"By kind of fault: {pilot} (threshold {limit})",
        kinds,
        {
            "fault": "{0}",
            "flights": lambda _, those: str(len(those)),
            "detected": lambda _, those: proportion(_detected(those), len(those)),
            "right thruster": lambda _, those: proportion(isolated(those), len(those)),
            "wrong thruster": lambda _, those: str(sum(one.named not in (0, one.thruster) for one in those)),
            "median detection": lambda _, those: _seconds(_median([one.detection for one in those])),
            "nine of ten within": nine_of_ten,
            "median isolation": lambda _, those: _seconds(_median([one.name - one.onset for one in those])),
            "captured or retreated": lambda _, those: saved(those),
            "the same, unprotected": lambda kind, _: saved(of_kind(affected["unprotected"], kind)),
        },
    )


def _said(best: Sequence[Flight]) -> Table:
    words = sorted({one.said for one in best if one.said})
    late = of_kind(best, "late")
    groups = {kind: of_kind(best, kind) for kind in KINDS_OF_FAULT if kind != "late"}
    groups[f"late, less than {PERIOD:g} s"] = [one for one in late if not _is_shut(one)]
    groups[f"late, {PERIOD:g} s or more"] = [one for one in late if _is_shut(one)]
    rows = []
    for name, those in groups.items():
        said = [one for one in those if one.said]
        delay = _seconds(_median([one.said_at - one.onset for one in said]))
        counts = (sum(one.said == word for one in those) for word in (*words, ""))
        rows.append((name, proportion(sum(map(_is_right, said)), len(said)), delay, *map(str, counts)))
    return Table(
        "What the best stack says of the fault when it acts: the share that is right, of those of which it "
        "says something; how long after the onset; and how often each",
        ("fault", "right", "median", *words, "nothing"),
        rows,
    )


def _worth_of_excitation(affected: dict[str, list[Flight]], healthy: dict[str, list[Flight]]) -> Table:
    def right_kind(_: str, those: list[Flight]) -> str:
        said = [one for one in those if one.said]
        return proportion(sum(map(_is_right, said)), len(said))

    return Table.of(
        "What probing is worth, and what it costs",
        affected,
        {
            "pilot": "{0}",
            "detected": lambda _, those: proportion(_detected(those), len(those)),
            "slow valves detected": lambda _, those: proportion(
                _detected(of_kind(those, "slow")), len(of_kind(those, "slow"))
            ),
            "right thruster": lambda _, those: proportion(isolated(those), len(those)),
            "right kind, of those named": right_kind,
            "false alarms in healthy flights": lambda pilot, _: str(
                sum(np.isfinite(one.alarm) for one in healthy[pilot])
            ),
            "captured or retreated": lambda _, those: saved(those),
            "open time of a healthy flight, all thrusters": lambda pilot, _: (
                f"{_mean_fuel(healthy[pilot]):.1f} s"
            ),
        },
    )


def _draw(affected: dict[str, list[Flight]]) -> Figure:
    figure, (left, right) = panels(2, height=4.6)
    kinds = [kind for kind in KINDS_OF_FAULT if of_kind(affected["oracle"], kind)]
    shares = {
        pilot: [100.0 * np.mean([*map(is_saved, of_kind(affected[pilot], kind))]) for kind in kinds]
        for pilot in PILOTS
    }
    bars(left, shares, [COLOURS[pilot] for pilot in PILOTS], flat=True)
    left.set(xlabel="captured or retreated, % of flights", title="How flights end")
    for pilot, shift in zip(WATCHERS, (-0.15, 0.15), strict=True):
        for place, kind in enumerate(kinds):
            those = of_kind(affected[pilot], kind)
            delays = [max(one.detection, 0.1) for one in those if _is_detected(one)]
            if delays:
                (low, middle, high), row = quantiles(delays), place + shift
                ranges(right, row, low, high, COLOURS[pilot], flat=True)
                dots(right, row, middle, COLOURS[pilot], flat=True, markersize=6.0)
                text = f"{100.0 * len(delays) / len(those):.0f} %"
                annotate(right, text, (high, row), (5, 0), va="center", fontsize=8.5, color=INK)
    right.set_xscale("log")
    right.xaxis.set_major_formatter("{x:g}")
    right.set_xlim(right=right.get_xlim()[1] * 2.0)
    right.set(
        xlabel="from onset to alarm, s: median, 10 to 90 %", title="Detection, and the share that is detected"
    )
    for panel in (left, right):
        ticks(panel, kinds, of_y=True)
    shared_legend(figure, left, ncols=len(PILOTS), fontsize=10.0)
    return figure


def _is_detected(flight: Flight) -> bool:
    return bool(np.isfinite(flight.alarm) and flight.alarm >= flight.onset)


def _detected(flights: Iterable[Flight]) -> int:
    return sum(map(_is_detected, flights))


def _is_shut(flight: Flight) -> bool:
    """Whether the fault is an opening so late that no pulse is long enough for it."""
    return flight.kind == "late" and flight.severity >= PERIOD


def _is_right(flight: Flight) -> bool:
    """Whether the kind that was said is the true one, or delivers the same whatever is commanded."""
    name, _ = KINDS_OF_FAULT[flight.kind]
    return flight.said == name or (_is_shut(flight) and flight.said == KINDS_OF_FAULT["closed"][0])


def _mean_fuel(flights: Sequence[Flight]) -> float:
    """Thruster-seconds."""
    return float(np.mean([one.fuel for one in flights]))


def _median(values: Sequence[float]) -> float:
    """The middle one, with flights without an alarm at the end; no number of none."""
    return sorted(values)[len(values) // 2] if values else float("nan")


def _seconds(value: float) -> str:
    return finite(value, ".1f", "never") + (" s" if np.isfinite(value) else "")
