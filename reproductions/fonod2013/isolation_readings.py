"""Readings of the cross-correlation test, its guard against idle thrusters, and other allocations.

Eq. 33 prints the residual of the last sample where that of each sample is meant, and leaves open how the axes
are put together; Remark 3 leaves out thrusters that idle. Which reading is right for thrusters stuck open is
seen on the environment's own pilot. The test is one of commands, so that it depends on who allocates them:
the last rows are of pilots that allocate otherwise (`other_pilots`), each with a threshold of its own.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.isolation_study import (
    Isolation,
    by_threshold,
    calibrated,
    correlation,
    draw_isolations,
    faulty,
    percentages,
    watched,
)
from reproductions.fonod2013.other_pilots import fixed_bias, minimum_fuel
from reproductions.record import Effort, Finding, Table
from thruster_baselines.control import ApproachSettings
from thruster_baselines.detection.approach_flights import NO_ERRORS

LABELS: dict[str, dict[str, Any]] = {
    "r(l), majority": {},
    "r(l), global minimum": {"vote": "global"},
    "r(l), sum over axes": {"vote": "sum"},
    "r(k) as printed": {"residual": "last"},
    "r(l), the greatest": {"pick": "greatest"},
}
GUARDS: dict[str, dict[str, Any]] = {
    "guard of Remark 3 at 0.02": {"idle_guard": 0.02},
    "guard of Remark 3 at 0.05": {"idle_guard": 0.05},
    "the same over the window before the alarm": {"idle_guard": 0.05, "guard_window": "before"},
}
SLOW, FAST = fixed_bias(0.2), fixed_bias(0.2, ApproachSettings(translation=0.4))
PILOTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "minimum fuel": ({"pilot": minimum_fuel()}, {}),
    "bias 0.2, clipped": ({"pilot": SLOW}, {}),
    "the same, r(k) as printed": ({"pilot": SLOW}, {"residual": "last"}),
    "bias 0.2, clipped, no errors of mass and thrust": ({"pilot": SLOW} | NO_ERRORS, {}),
    "the same without errors, r(k) as printed": ({"pilot": SLOW} | NO_ERRORS, {"residual": "last"}),
    "bias 0.2, clipped, position loop 0.4 rad/s": ({"pilot": FAST}, {}),
}
"""Settings of the flights, and of the test."""
DRAFT = {
    "minimum fuel": 20 / 40,
    "bias 0.2, clipped, no errors of mass and thrust": 27 / 40,
    "the same without errors, r(k) as printed": 32 / 40,
    "bias 0.2, clipped, position loop 0.4 rad/s": 40 / 40,
}
"""Shares named right in our draft simulation, 5 flights for each thruster."""


@reproduces(
    "MSR-4.4",
    lines="beyond the source; L292-311",
    reported="nothing",
    criterion="as meant and as printed all open faults are named right, with the idle guard none, with "
    "minimum fuel half",
)
def readings(effort: Effort) -> Finding:
    """Readings of the cross-correlation test, its guard, and other allocations."""
    cases = {
        f"{label}, N = {window}": {**settings, "window": window}
        for label, settings in LABELS.items()
        for window in (10, 30)
    } | GUARDS
    limit, flights = calibrated(effort), faulty(effort)
    limits = dict.fromkeys(cases, limit)
    seen = {name: watched(flights, correlation(**settings), limit) for name, settings in cases.items()}
    for name, (flown, settings) in PILOTS.items():
        limits[name] = calibrated(effort, **flown)
        seen[name] = watched(faulty(effort, **flown), correlation(**settings), limits[name])
    share = {name: one.share for name, one in seen.items()}
    meant = [share[f"{label}, N = {n}"] for label in list(LABELS)[:4] for n in (10, 30)]
    thrifty, slow, fast = (seen[name] for name in ("minimum fuel", "bias 0.2, clipped", list(PILOTS)[-1]))
    by_reading = by_threshold(
        "Readings of eq. 33 on open faults, and pilots that allocate otherwise",
        "reading or pilot",
        seen,
        limits,
    )
    by_thruster = Table(
        "Named right by the thruster that failed",
        ("pilot", *(str(i) for i in range(1, 9))),
        [(name, *(f"{100.0 * one:.0f} %" for one in _by_thruster(seen[name]))) for name in PILOTS],
    )
    return Finding(
        ours=f"named right, the least of the readings as meant and as printed: {percentages([min(meant)])}; "
        f"the greatest {percentages([share['r(l), the greatest, N = 10']])}; guard at 0.02 and 0.05 "
        f"{percentages([share[name] for name in list(GUARDS)[:2]])}; "
        f"minimum fuel {percentages([thrifty.share])}; a clipped bias {percentages([slow.share])}, with "
        f"a fast position loop {percentages([fast.share])}",
        checks={
            "as meant, whatever the vote, and as printed all are named right": min(meant) == 1.0,
            "the greatest correlation names none right": share["r(l), the greatest, N = 10"] == 0.0,
            "the guard of Remark 3 names none right, at 0.02 or at 0.05": (
                max(share[name] for name in list(GUARDS)[:2]) == 0.0
            ),
            "judged before the alarm it does no harm": share[list(GUARDS)[2]] == 1.0,
            "with minimum fuel the lower number of the thruster and its opposite corner is named": (
                (thrifty.named == 1 + (thrifty.thruster - 1) % 4).all()
            ),
            "a clipped bias fails by a slow position loop and not by a fast one": (
                slow.share < 0.9 and fast.share == 1.0
            ),
        },
        beyond_source=True,
        note=(
            "Thruster i and the one at the opposite corner, i + 4 or i - 4, push in opposite directions and "
            "turn the same way. Minimum fuel leaves a thruster of either half (1, 4, 6, 7 and 2, 3, 5, 8) "
            "shut; where one is stuck open, that is the stuck one in its half and the opposite one in the "
            "other. Both are told nothing, their correlations of zero tie, and the lower number is named. A "
            "clipped bias pushes less than the position loop asks for, and both commands fall to zero alike; "
            "the earlier the alarm, the more of the window is from before that, and the higher the share "
            "(rows without errors, whose threshold is half as high). A fast loop pushes enough. In our draft "
            "simulation, in which there are no such errors, right were: "
            + "; ".join(f"{name} {percentages([one])}" for name, one in DRAFT.items())
            + ", of 40 flights each."
        ),
        data={
            "named_right": share,
            "thresholds": limits,
            "named_right_by_thruster": {name: _by_thruster(seen[name]) for name in PILOTS},
        },
        tables=(by_reading, by_thruster),
        figure=partial(draw_isolations, seen),
    )


def _by_thruster(one: Isolation) -> list[float]:
    return [float(share) for share in one.right.reshape(8, -1).mean(axis=1)]
