"""Valves stuck closed and thrusters at half thrust, beside those stuck open.

By the printed test, by its opposite, by signatures, and by the likelihood ratio of the force alone and of
force and torque. That of the force alone sees a thruster and the loss of its opposite corner as one (Remark 4
of the source), and isolates neither. Each threshold is a margin over healthy flights of validation seeds. The
source detects "any kind" of fault and isolates open ones only; nothing of this table is in it.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.isolation_study import (
    HEAD,
    OPEN,
    VEHICLE,
    Make,
    calibrated,
    correlation,
    draw_isolations,
    faulty,
    norm,
    percentages,
    watched,
)
from reproductions.record import Effort, Finding, Table
from thruster_baselines.detection.residuals import BaseNavigationDetector, FusionDetector, SignatureDetector

FORCE = "likelihood ratio, force alone"
FAULTS = {"open": OPEN, "closed": ("stuck_off", 1.0), "loss of 50 %": ("loss", 0.5)}


@reproduces(
    "MSR-4.5",
    lines="beyond the source; L30, L317",
    reported="nothing",
    criterion="the source's test names all open valves right and no other fault",
)
def other_faults(effort: Effort) -> Finding:
    """The test on faults that it was not made for."""
    makers: dict[str, tuple[Make, Make, float]] = {
        "eq. 33, the source's": (correlation(), norm, 1.3),
        "its opposite": (correlation(pick="greatest"), norm, 1.3),
        "signature": (lambda limit, count: SignatureDetector(VEHICLE, limit, vehicles=count), norm, 1.3),
        FORCE: (_force_ratio, _force_ratio, 1.5),
        "fusion": (_fusion, _fusion, 1.5),
    }
    limits = {name: calibrated(effort, alarm, margin) for name, (_, alarm, margin) in makers.items()}
    seen = {}
    for fault, how in FAULTS.items():
        flights = faulty(effort, *how)
        for name, (make, _, _) in makers.items():
            seen[fault, name] = watched(flights, make, limits[name])
    printed = [seen[fault, "eq. 33, the source's"].share for fault in FAULTS]
    opposite = [seen[fault, "its opposite"].share for fault in FAULTS]
    fused = [seen[fault, "fusion"].share for fault in FAULTS]
    table = Table(
        "Detectors by fault",
        ("fault", "detector", *HEAD),
        [(fault, name, *one.cells) for (fault, name), one in seen.items()],
    )
    return Finding(
        ours=f"named right of {', '.join(FAULTS)}: the source's test {percentages(printed)}; its opposite "
        f"{percentages(opposite)}; the fusion {percentages(fused)}",
        checks={
            "the source's test names all open valves right": printed[0] == 1.0,
            "and nothing else": max(printed[1:]) == 0.0,
            "the likelihood ratio of the force alone is sooner than the norm, on every fault": all(
                np.median(seen[fault, FORCE].detection)
                < np.median(seen[fault, "eq. 33, the source's"].detection)
                for fault in FAULTS
            ),
            "and names nobody": all(np.isinf(seen[fault, FORCE].isolation).all() for fault in FAULTS),
            "its opposite names all others right and no open valve": (
                opposite[0] == 0.0 and min(opposite[1:]) == 1.0
            ),
        },
        beyond_source=True,
        data={
            "named_right": {f"{fault}, {name}": one.share for (fault, name), one in seen.items()},
            "thresholds": limits,
        },
        tables=(table,),
        figure=partial(draw_isolations, {f"{fault}: {name}": one for (fault, name), one in seen.items()}),
    )


def _force_ratio(limit: float, count: int) -> BaseNavigationDetector:
    return FusionDetector(VEHICLE, limit, use_rate=False, vehicles=count)


def _fusion(limit: float, count: int) -> BaseNavigationDetector:
    return FusionDetector(VEHICLE, limit, vehicles=count)
