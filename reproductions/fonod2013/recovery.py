"""Fault, diagnosis, recovery: 500 approaches of the Mars chaser with one fault each, and ten healthy hours.

The source closes no loop over its diagnosis and looks at open valves alone. Here any kind of fault strikes
any thruster at any time, and four pilots fly the same flights; see
`reproductions.fonod2013.recovery_flights`. Thresholds come from healthy flights of validation seeds; the
tables are of test seeds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from reproductions.figures import BLUE, GREEN, INK, ORANGE, RED, Figure, panels
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
    fly,
    fly_healthy,
    is_saved,
    is_struck,
    of_kind,
    share,
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
    criterion=(
        "on 500 test seeds the best stack detects 99 %, isolates 98 %, median detection at most 1 s "
        "(open) and 2.5 s (others), no false alarm in ten healthy hours, it captures or retreats in "
        "95 % of the flights that the oracle saves, and says the right kind of 95 % of those it names"
    ),
)
def study(effort: Effort) -> Finding:
    """The Mars chaser's approach with any fault: diagnosed, recovered, captured or retreated."""
    thresholds = calibrate(VALIDATION[: CALIBRATION_PER_EFFORT * effort.flights])
    count = FLIGHTS_PER_EFFORT * effort.flights
    flights = {pilot: fly(pilot, TEST[:count], thresholds) for pilot in PILOTS}
    quiet = TEST[count : count + round(HEALTHY_PER_EFFORT * effort.flights)]
    healthy = {pilot: fly_healthy(pilot, quiet, thresholds) for pilot in WATCHERS}
    unprobed = [one for one in fly(UNPROBED, TEST[:count], thresholds) if is_struck(one)]
    quiet_unprobed = fly_healthy(UNPROBED, quiet, thresholds)
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
    struck = {pilot: [one for one in flights[pilot] if is_struck(one)] for pilot in PILOTS}
    savable = {one.seed for one in struck["oracle"] if is_saved(one)}
    best = struck["best stack"]
    detected = [one for one in best if _detected(one)]
    opened = [one.detection for one in best if one.kind == "open"]
    others = [one.detection for one in best if one.kind != "open"]
    isolated = [one for one in best if one.named == one.thruster]
    saved = [one for one in best if one.seed in savable and is_saved(one)]
    among = [one for one in best if one.seed in savable]
    unseen = [one for one in best if not _detected(one)]
    unprotected = {one.seed: one for one in flights["unprotected"]}
    harmless = sum(unprotected[one.seed].end == "captured" for one in unseen)
    not_slow = [one for one in best if one.kind != "slow"]
    said = [one for one in best if one.said]
    right = sum(map(_is_right, said))
    late = [one for one in said if one.kind == "late"]
    price = _mean_fuel(healthy["best stack"]) / _mean_fuel(quiet_unprobed) - 1.0
    checks = {
        "the best stack detects at least 99 %": len(detected) >= 0.99 * len(best),
        "it names the right thruster in at least 98 %": len(isolated) >= 0.98 * len(best),
        "its median detection of open faults takes at most 1 s": _median(opened) <= 1.0,
        "its median detection of the others takes at most 2.5 s": _median(others) <= 2.5,
        f"it raises no false alarm in {hours['best stack']:.1f} h of healthy flight": not any(
            np.isfinite(one.alarm) for one in healthy["best stack"]
        ),
        "it captures or retreats in at least 95 % of the flights that the oracle saves": len(saved)
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
        f"{share(sum(map(_detected, not_slow)), len(not_slow))} and names the right thruster in "
        f"{share(sum(one.named == one.thruster for one in not_slow), len(not_slow))}, the last of them "
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
        ours=(
            f"best stack: {_percent(len(detected), len(best))} detected, "
            f"{_percent(len(isolated), len(best))} isolated, medians {_seconds(_median(opened))} (open) and "
            f"{_seconds(_median(others))} (others), {false['best stack']} false alarms, "
            f"{_percent(right, len(said))} of the named with the right kind, "
            f"{_percent(len(saved), len(among))} of {len(among)} savable flights saved"
        ),
        checks={part: bool(holds) for part, holds in checks.items()},
        beyond_source=True,
        note=note,
        data={
            "thresholds": thresholds,
            "hours": hours,
            "false_alarms": false,
            "flights": len(best),
            "ends": {
                pilot: {end: sum(one.end == end for one in struck[pilot]) for end in ENDS} for pilot in PILOTS
            },
            "detected": {
                pilot: {kind: sum(map(_detected, of_kind(struck[pilot], kind))) for kind in KINDS_OF_FAULT}
                for pilot in WATCHERS
            },
            "isolated": {
                pilot: {
                    kind: sum(one.named == one.thruster for one in of_kind(struck[pilot], kind))
                    for kind in KINDS_OF_FAULT
                }
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
            _by_pilot(struck, savable, false, hours),
            _by_kind("best stack", struck, thresholds),
            _by_kind("source's method", struck, thresholds),
            _said(best),
            _worth_of_probing(
                {"best stack": best, UNPROBED: unprobed},
                {"best stack": healthy["best stack"], UNPROBED: quiet_unprobed},
            ),
            _without_knowing(first, either),
        ),
        figure=partial(_draw, struck),
    )


def _by_pilot(
    struck: dict[str, list[Flight]], savable: set[int], false: dict[str, int], hours: dict[str, float]
) -> Table:
    rows = []
    for pilot in PILOTS:
        those = struck[pilot]
        watches = pilot in WATCHERS
        seen, named = sum(map(_detected, those)), sum(one.named == one.thruster for one in those)
        among = [one for one in those if one.seed in savable]
        rows.append(
            (
                pilot,
                share(seen, len(those)) if watches else "-",
                share(named, len(those)) if watches else "-",
                _seconds(_median([one.detection for one in those if one.kind == "open"])) if watches else "-",
                _seconds(_median([one.detection for one in those if one.kind != "open"])) if watches else "-",
                f"{false[pilot]} in {hours[pilot]:.1f} h" if watches else "-",
                *(str(sum(one.end == end for one in those)) for end in ENDS),
                share(sum(map(is_saved, among)), len(among)),
            )
        )
    head = (
        "pilot", "detected", "right thruster", "median, open", "median, others", "false alarms", *ENDS,
        "captured or retreated, of those that the oracle saves",
    )  # fmt: skip
    return Table(
        "All flights by pilot, with 95 % intervals. False alarms: in healthy flights of the stated length, "
        "and before the fault in the others",
        head,
        tuple(rows),
    )


def _by_kind(pilot: str, struck: dict[str, list[Flight]], thresholds: dict[str, float]) -> Table:
    rows = []
    for kind in KINDS_OF_FAULT:
        those, bare = of_kind(struck[pilot], kind), of_kind(struck["unprotected"], kind)
        if not those:
            continue
        delays = [one.detection for one in those]
        names = [one.name - one.onset for one in those]
        rows.append(
            (
                kind,
                str(len(those)),
                share(sum(map(_detected, those)), len(those)),
                share(sum(one.named == one.thruster for one in those), len(those)),
                str(sum(one.named not in (0, one.thruster) for one in those)),
                _seconds(_median(delays)),
                _seconds(sorted(delays)[int(np.ceil(0.9 * len(delays))) - 1]),
                _seconds(_median(names)),
                share(sum(map(is_saved, those)), len(those)),
                share(sum(map(is_saved, bare)), len(bare)),
            )
        )
    head = (
        "fault", "flights", "detected", "right thruster", "wrong thruster", "median detection",
        "nine of ten within", "median isolation", "captured or retreated", "the same, unprotected",
    )  # fmt: skip
    limit = f"{1e3 * thresholds[pilot]:.1f} mm" if pilot == "source's method" else f"{thresholds[pilot]:.1f}"
    return Table(f"By kind of fault: {pilot} (threshold {limit})", head, tuple(rows))


def _said(best: Sequence[Flight]) -> Table:
    words = sorted({one.said for one in best if one.said})
    groups = {kind: of_kind(best, kind) for kind in KINDS_OF_FAULT if kind != "late"}
    late = of_kind(best, "late")
    groups[f"late, less than {PERIOD:g} s"] = [one for one in late if not _is_shut(one)]
    groups[f"late, {PERIOD:g} s or more"] = [one for one in late if _is_shut(one)]
    rows = []
    for name, those in groups.items():
        said = [one for one in those if one.said]
        rows.append(
            (
                name,
                share(sum(map(_is_right, said)), len(said)),
                _seconds(_median([one.said_at - one.onset for one in said])),
                *(str(sum(one.said == word for one in those)) for word in words),
                str(len(those) - len(said)),
            )
        )
    return Table(
        "What the best stack says of the fault when it acts: the share that is right, of those of which it "
        "says something; how long after the onset; and how often each",
        ("fault", "right", "median", *words, "nothing"),
        tuple(rows),
    )


def _worth_of_probing(struck: dict[str, list[Flight]], healthy: dict[str, list[Flight]]) -> Table:
    rows = []
    for pilot, those in struck.items():
        slow, said = of_kind(those, "slow"), [one for one in those if one.said]
        rows.append(
            (
                pilot,
                share(sum(map(_detected, those)), len(those)),
                share(sum(map(_detected, slow)), len(slow)),
                share(sum(one.named == one.thruster for one in those), len(those)),
                share(sum(map(_is_right, said)), len(said)),
                str(sum(np.isfinite(one.alarm) for one in healthy[pilot])),
                share(sum(map(is_saved, those)), len(those)),
                f"{_mean_fuel(healthy[pilot]):.1f} s",
            )
        )
    head = (
        "pilot", "detected", "slow valves detected", "right thruster", "right kind, of those named",
        "false alarms in healthy flights", "captured or retreated",
        "open time of a healthy flight, all thrusters",
    )  # fmt: skip
    return Table("What probing is worth, and what it costs", head, tuple(rows))


def _without_knowing(first: dict[str, list[Flight]], either: dict[str, list[Flight]]) -> Table:
    rows = tuple(
        (pilot, *(share(sum(map(is_saved, those[pilot])), len(those[pilot])) for those in (first, either)))
        for pilot in either
    )
    return Table(
        "Captured or retreated, whoever knows: a thruster of branch A fails, or one of either branch",
        ("pilot", "branch A fails", "either branch fails"),
        rows,
    )


def _draw(struck: dict[str, list[Flight]]) -> Figure:
    figure, (left, right) = panels(2, height=4.6)
    kinds = [kind for kind in KINDS_OF_FAULT if of_kind(struck["oracle"], kind)]
    places = np.arange(len(kinds), dtype=np.float64)
    for number, pilot in enumerate(PILOTS):
        shares = [_rate(map(is_saved, of_kind(struck[pilot], kind))) for kind in kinds]
        left.barh(
            places + 0.2 * (number - 1.5), [100.0 * one for one in shares], 0.18, color=COLOURS[pilot],
            label=pilot,
        )  # fmt: skip
    left.set_yticks(places, kinds)
    left.invert_yaxis()
    left.grid(axis="y", visible=False)
    left.set_xlabel("captured or retreated, % of flights")
    left.set_title("How flights end")
    for number, pilot in enumerate(WATCHERS):
        for place, kind in zip(places, kinds, strict=True):
            those = of_kind(struck[pilot], kind)
            delays = sorted(max(one.detection, 0.1) for one in those if _detected(one))
            if not delays:
                continue
            low, middle, high = np.quantile(delays, [0.1, 0.5, 0.9])
            row = place + 0.3 * (number - 0.5)
            right.plot([low, high], [row, row], color=COLOURS[pilot], linewidth=2.0)
            right.plot([middle], [row], "o", color=COLOURS[pilot], label=pilot if place == 0.0 else None)
            right.annotate(
                f"{100.0 * len(delays) / len(those):.0f} %", (high, row), (5, 0),
                textcoords="offset points", va="center", fontsize=8.5, color=INK,
            )  # fmt: skip
    right.set_xscale("log")
    right.xaxis.set_major_formatter("{x:g}")
    right.set_xlim(right=right.get_xlim()[1] * 2.0)
    right.set_yticks(places, kinds)
    right.invert_yaxis()
    right.grid(axis="y", visible=False)
    right.set_xlabel("from onset to alarm, s: median, 10 to 90 %")
    right.set_title("Detection, and the share that is detected")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(PILOTS))
    return figure


def _detected(flight: Flight) -> bool:
    return bool(np.isfinite(flight.alarm) and flight.alarm >= flight.onset)


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


def _rate(flags: Iterable[bool]) -> float:
    return float(np.mean(list(flags)))


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if np.isfinite(value) else "never"


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "none"
