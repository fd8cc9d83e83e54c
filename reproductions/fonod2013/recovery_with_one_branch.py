"""Recovery without a redundant branch: the Mars chaser with the thrusters that are left, 500 flights.

The flights of `mars-recovery` again, with the same faults and pilots, on a vehicle that has isolation valves
and no branch to switch over to. Where a fault leaves authority in every direction it is allocated around, and
the approach goes on; where it does not, the valve is closed and the chaser retreats in the direction in which
the others push (`thruster_baselines.control.chaser_pilot`). There a wrong isolation is not forgiven.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from reproductions.cells import percent, proportion
from reproductions.figures import BLUE, INK, PURPLE, Figure, bars, panels, ticks
from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.recovery import CALIBRATION_PER_EFFORT, COLOURS, FLIGHTS_PER_EFFORT, WATCHERS
from reproductions.fonod2013.recovery_flights import (
    ENDS,
    KINDS_OF_FAULT,
    PILOTS,
    Flight,
    calibrate,
    endings,
    fly,
    is_affected,
    is_saved,
    of_kind,
)
from reproductions.record import Effort, Finding, Table
from thruster_baselines.control import RecoverySettings, ValveBelief, authority_left
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import load


@reproduces(
    "mars-recovery-one-branch",
    lines="beyond the source; L317-332, L334 for its method",
    reported="nothing: no flight goes on after the diagnosis",
    criterion="on 500 test seeds the oracle saves 99 %, the best stack 95 % of those, and captures in 80 % "
    "of the flights in which the oracle does; where the source's method names a wrong thruster it saves "
    "fewer flights than where it names the right one, and fewer than the best stack does of the same",
)
def study(effort: Effort) -> Finding:
    """The Mars chaser's approach with any fault and no spare branch: captured, or retreated."""
    thresholds = calibrate(VALIDATION[: CALIBRATION_PER_EFFORT * effort.flights])
    seeds = TEST[: FLIGHTS_PER_EFFORT * effort.flights]
    flown = {pilot: fly(pilot, seeds, thresholds, spare_branch=False) for pilot in PILOTS}
    affected = {pilot: [one for one in flown[pilot] if is_affected(one)] for pilot in PILOTS}
    savable = {one.seed for one in affected["oracle"] if is_saved(one)}
    capturable = {one.seed for one in affected["oracle"] if one.end == "captured"}
    best, source = affected["best stack"], affected["source's method"]
    saved = _among(best, savable, is_saved)
    caught = _among(best, capturable, _is_captured)
    wrong = {one.seed for one in source if _name(one) == "wrong"}
    right = {one.seed for one in source if _name(one) == "right"}
    theirs, ours = _among(source, wrong, is_saved), _among(best, wrong, is_saved)
    note = (
        f"{len(affected['oracle'])} flights of test seeds with one fault each, as many of each kind, by any "
        "thruster, at any time of the first 190 s of some 206 s, on a chaser without a spare branch. A "
        "thruster that is stuck, leaks, is weak or late by less than a pulse leaves some authority in every "
        "direction (figure, right), and with it the chaser captures. One that is closed, later than a pulse, "
        "or fully open with its valve closed leaves none: seven thrusters hold the attitude and push into a "
        "cone of three directions. The chaser then retreats, diagonally if the thruster pushed back; closer "
        "to the target than that allows it goes on. The oracle does so from the moment of the fault. The "
        "best stack has to alarm, to name, and to say what is wrong, which it asks again after the name. The "
        "source's method looks for valves that are too far open: it closes the valve of whichever thruster "
        f"it names and retreats, also from faults with which one captures. Its name is wrong in {len(wrong)} "
        f"flights, and two thrusters are lost then: it saves {proportion(*theirs)} of these, and the best "
        f"stack {proportion(*ours)} of the same flights. No pilot makes pulses with an isolation valve. "
        "Numbers are of MSR-A, ours."
    )
    by_kind = Table.of(
        "By kind of fault: captured, retreated, and neither",
        KINDS_OF_FAULT,
        {
            "fault": "{0}",
            "flights": lambda kind, _: str(len(of_kind(affected["oracle"], kind))),
            **{
                pilot: (lambda kind, _, those=those: _ends(of_kind(those, kind)))
                for pilot, those in affected.items()
            },
        },
    )
    return Finding(
        ours=f"the oracle saves {len(savable)} of {len(affected['oracle'])} and captures in "
        f"{len(capturable)}; of these the best stack saves {percent(*saved)} and captures in "
        f"{percent(*caught)}, the source's method {percent(*_among(source, savable, is_saved))} and "
        f"{percent(*_among(source, capturable, _is_captured))}, the unprotected pilot "
        f"{percent(*_among(affected['unprotected'], savable, is_saved))} and "
        f"{percent(*_among(affected['unprotected'], capturable, _is_captured))}",
        checks={
            "the oracle captures or retreats in at least 99 %": len(savable)
            >= 0.99 * len(affected["oracle"]),
            "the best stack does in at least 95 % of the flights that the oracle saves": saved[0]
            >= 0.95 * saved[1],
            "and captures in at least 80 % of those in which the oracle does": caught[0] >= 0.8 * caught[1],
            "of the flights in which the source's method names a wrong thruster it saves fewer than of those "
            "in which it names the right one": _rate(theirs) < _rate(_among(source, right, is_saved)),
            "and fewer than the best stack does of the same": _rate(theirs) < _rate(ours),
        },
        beyond_source=True,
        note=note,
        data={
            "thresholds": thresholds,
            "flights": len(affected["oracle"]),
            "savable": len(savable),
            "capturable": len(capturable),
            "ends": {
                pilot: {
                    kind: {end: sum(one.end == end for one in of_kind(affected[pilot], kind)) for end in ENDS}
                    for kind in KINDS_OF_FAULT
                }
                for pilot in PILOTS
            },
            "saved_of_savable": {pilot: _among(affected[pilot], savable, is_saved) for pilot in PILOTS},
            "wrong_names_of_source": len(wrong),
        },
        tables=(_by_pilot(affected, savable, capturable), by_kind, _by_name(affected)),
        figure=partial(_draw, affected),
    )


def _by_pilot(affected: dict[str, list[Flight]], savable: set[int], capturable: set[int]) -> Table:
    def names(pilot: str, those: list[Flight]) -> list[str] | None:
        return [_name(one) for one in those] if pilot in WATCHERS else None

    return Table.of(
        "All flights by pilot, with 95 % intervals",
        [(pilot, those, names(pilot, those)) for pilot, those in affected.items()],
        {
            "pilot": "{0}",
            "right thruster": lambda _, those, named: (
                proportion(named.count("right"), len(those)) if named else "-"
            ),
            "wrong thruster": lambda _, __, named: str(named.count("wrong")) if named else "-",
            **endings(affected),
            "captured or retreated, of those that the oracle saves": lambda _, those, __: proportion(
                *_among(those, savable, is_saved)
            ),
            "captured, of those that the oracle captures": lambda _, those, __: proportion(
                *_among(those, capturable, _is_captured)
            ),
        },
    )


def _by_name(affected: dict[str, list[Flight]]) -> Table:
    rows = []
    for name in ("right", "wrong", "none"):
        seeds = {one.seed for one in affected["source's method"] if _name(one) == name}
        shares = (proportion(*_among(affected[pilot], seeds, is_saved)) for pilot in PILOTS)
        rows.append((name, str(len(seeds)), *shares))
    return Table(
        "Captured or retreated, by the name that the source's method gives; the same flights by all",
        ("name", "flights", *PILOTS),
        rows,
    )


def _draw(affected: dict[str, list[Flight]]) -> Figure:
    figure, (left, right) = panels(2, height=5.0)
    captured, retreated = (
        {
            pilot: np.array([100.0 * _part(of_kind(those, kind), end) for kind in KINDS_OF_FAULT])
            for pilot, those in affected.items()
        }
        for end in ("captured", "retreated")
    )
    colours = [COLOURS[pilot] for pilot in PILOTS]
    bars(left, captured, colours, flat=True)
    left.legend(loc="upper center", bbox_to_anchor=(0.4, -0.14), ncols=2)
    bars(left, retreated, colours, flat=True, base=captured, alpha=0.4)
    ticks(left, list(KINDS_OF_FAULT), of_y=True)
    left.set(xlabel="captured, and pale: retreated, % of flights", title="How flights end")
    sizes = np.linspace(0.0, 1.0, 101)
    for kind, label, colour, style in (
        ("loss", "loss: share; leak: opening;\nlate: in periods", BLUE, "-"),
        ("stuck_on", "stuck at: opening", PURPLE, (0, (4, 2))),
    ):
        shares = [100.0 * _left(kind, float(size)) for size in sizes]
        right.plot(sizes, shares, color=colour, linestyle=style, label=label)
    least = 100.0 * RecoverySettings().least_authority
    right.axhline(least, color=INK, linewidth=1.0, linestyle=":", label="below it the valve is closed")
    right.set(
        ylim=(0.0, 55.0), xlabel="size of the fault", ylabel="wrench in every direction, % of the axis alone"
    )
    right.set(title="What one faulty thruster leaves")
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14))
    return figure


def _left(kind: str, size: float) -> float:
    """Authority that a fault of the first thruster leaves."""
    chaser = load("msr_chaser")
    belief = ValveBelief.sound(1, chaser.number_of_thrusters)
    belief.blame(0, 1, kind, size, period=chaser.control_period)
    return authority_left(chaser.wrenches(), belief.lower[0], belief.upper[0])


def _name(flight: Flight) -> str:
    """Whether the first name was right, wrong, or never came."""
    if flight.named == 0:
        return "none"
    return "right" if flight.named == flight.thruster else "wrong"


def _is_captured(flight: Flight) -> bool:
    return flight.end == "captured"


def _among(flights: Iterable[Flight], seeds: set[int], holds: Callable[[Flight], bool]) -> tuple[int, int]:
    """For how many of the flights of these seeds something holds, and how many they are."""
    those = [one for one in flights if one.seed in seeds]
    return sum(map(holds, those)), len(those)


def _rate(of: tuple[int, int]) -> float:
    """No number of none."""
    return of[0] / of[1] if of[1] else float("nan")


def _part(flights: Sequence[Flight], end: str) -> float:
    return sum(one.end == end for one in flights) / max(len(flights), 1)


def _ends(flights: Sequence[Flight]) -> str:
    captured, saved = sum(map(_is_captured, flights)), sum(map(is_saved, flights))
    return f"{captured}, {saved - captured}, {len(flights) - saved}"
