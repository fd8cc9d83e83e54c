"""The isolation test under other noise, in its other readings, and on faults that it was not made for.

Three tables that the source does not have. Open valves under four levels of LIDAR noise and a navigation
that is three samples late; the readings of eq. 33 and the guard of Remark 3; and valves stuck closed or at
half thrust, by the printed test, by its opposite, by signatures and by the likelihood ratio of force and
torque. Each threshold is a margin over healthy flights of validation seeds at the same settings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from reproductions.fonod2013.approach_flights import fly
from reproductions.record import Effort, Finding, Reproduction, Table
from thruster_baselines.detection.residuals import (
    BaseNavigationDetector,
    CorrelationDetector,
    FusionDetector,
    NavigationFlights,
    NormThreshold,
    SignatureDetector,
    margin_threshold,
    watch,
)
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import load

VEHICLE = "msr_chaser"
Make = Callable[[float, int], BaseNavigationDetector]
FAULTS = {"open": ("stuck_on", 1.0), "closed": ("stuck_off", 1.0), "loss of 50 %": ("loss", 0.5)}
HALF_WIDTHS = (0.5, 1.0, 2.0, 5.0)  # mm
HEAD = ("flights", "false alarms", "detection, s: median, most", "isolation, s: median, most", "named right")


def noise(effort: Effort) -> Finding:
    """`MSR-4.3`: LIDAR noise and late navigation."""
    rows, shares = [], []
    cases: list[tuple[str, dict[str, Any]]] = []
    vehicle = load(VEHICLE)
    for width in HALF_WIDTHS:
        sensors = replace(vehicle.sensors, position=1e-3 * width / math.sqrt(3.0))
        cases.append((f"± {width} mm", {"spacecraft": replace(vehicle, sensors=sensors)}))
    cases.append(("± 1 mm, navigation 3 samples late", {"navigation_delay": 3}))
    for name, settings in cases:
        limit = _threshold(effort, _norm, 1.3, **settings)
        row, right = _row(_struck(effort, "open", **settings), _correlation(), limit)
        rows.append((name, f"{1e3 * limit:.1f} mm", *row))
        shares.append(right)
    return Finding(
        ours=f"named right: {_shares(shares)}",
        checks={"all open faults are named right in every row": min(shares) == 1.0},
        beyond_source=True,
        data={"named_right": dict(zip([name for name, _ in cases], shares, strict=True))},
        tables=(Table("Open faults, by the source's test", ("LIDAR", "threshold", *HEAD), tuple(rows)),),
    )


def readings(effort: Effort) -> Finding:
    """`MSR-4.4`: eq. 33 as printed and as meant."""
    limit = _threshold(effort, _norm, 1.3)
    seen = _struck(effort, "open")
    cases: dict[str, dict[str, Any]] = {
        f"{label}, N = {window}": {**settings, "window": window}
        for label, settings in {
            "r(l), majority": {},
            "r(l), global minimum": {"vote": "global"},
            "r(k) as printed": {"residual": "last"},
            "r(l), the greatest": {"pick": "greatest"},
        }.items()
        for window in (10, 30)
    }
    cases["guard of Remark 3 at 0.05"] = {"idle_guard": 0.05}
    cases["the same over the window before the alarm"] = {"idle_guard": 0.05, "guard_window": "before"}
    table = {name: _row(seen, _correlation(**settings), limit) for name, settings in cases.items()}
    share = {name: right for name, (_, right) in table.items()}
    return Finding(
        ours="; ".join(f"{name}: {100.0 * right:.1f} %" for name, right in share.items()),
        checks={
            "as meant and as printed all are named right": all(
                right == 1.0
                for name, right in share.items()
                if not any(word in name for word in ("guard", "greatest", "the same"))
            ),
            "the greatest correlation names none right": share["r(l), the greatest, N = 10"] == 0.0,
            "the guard of Remark 3 names none right": share["guard of Remark 3 at 0.05"] == 0.0,
        },
        beyond_source=True,
        data={"named_right": share, "threshold": limit},
        tables=(
            Table("Readings of eq. 33 on open faults", ("reading", *HEAD),
                  tuple((name, *row) for name, (row, _) in table.items())),
        ),
    )  # fmt: skip


def other_faults(effort: Effort) -> Finding:
    """`MSR-4.5`: valves stuck closed and at half thrust as well."""
    makers: dict[str, tuple[Make, Make, float]] = {
        "eq. 33, the source's": (_correlation(), _norm, 1.3),
        "its opposite": (_correlation(pick="greatest"), _norm, 1.3),
        "signature": (lambda limit, count: SignatureDetector(VEHICLE, limit, vehicles=count), _norm, 1.3),
        "fusion": (_fusion, _fusion, 1.5),
    }
    limits = {name: _threshold(effort, quiet, margin) for name, (_, quiet, margin) in makers.items()}
    rows, share = [], {}
    for fault in FAULTS:
        seen = _struck(effort, fault)
        for name, (make, _, _) in makers.items():
            row, right = _row(seen, make, limits[name])
            rows.append((fault, name, *row))
            share[f"{fault}, {name}"] = right
    printed = [share[f"{fault}, eq. 33, the source's"] for fault in FAULTS]
    fused = [share[f"{fault}, fusion"] for fault in FAULTS]
    return Finding(
        ours=(
            f"named right of {', '.join(FAULTS)}: the source's test {_shares(printed)}; the fusion "
            f"{_shares(fused)}"
        ),
        checks={
            "the source's test names all open valves right": printed[0] == 1.0,
            "and nothing else": max(printed[1:]) == 0.0,
        },
        beyond_source=True,
        data={"named_right": share, "thresholds": limits},
        tables=(Table("Detectors by fault", ("fault", "detector", *HEAD), tuple(rows)),),
    )


def _norm(limit: float, count: int) -> BaseNavigationDetector:
    return NormThreshold(VEHICLE, limit, vehicles=count)


def _fusion(limit: float, count: int) -> BaseNavigationDetector:
    return FusionDetector(VEHICLE, limit, vehicles=count)


def _correlation(**settings: Any) -> Make:
    return lambda limit, count: CorrelationDetector(VEHICLE, limit, vehicles=count, **settings)


def _threshold(effort: Effort, make: Make, margin: float, **settings: Any) -> float:
    count = effort.flights
    return margin_threshold(
        watch(make(np.inf, count), fly(VALIDATION[:count], **settings)).statistic, margin
    )  # fmt: skip


def _struck(effort: Effort, fault: str, **settings: Any) -> list[NavigationFlights]:
    """One batch for each thruster."""
    count, (kind, severity) = effort.flights, FAULTS[fault]
    return [fly(TEST[count * i : count * (i + 1)], i + 1, kind, severity, **settings) for i in range(8)]


def _row(batches: list[NavigationFlights], make: Make, limit: float) -> tuple[tuple[str, ...], float]:
    """Cells for `HEAD`, and the share that is named right."""
    seen = [watch(make(limit, one.onset.size), one) for one in batches]
    detection = np.concatenate([one.detection for one in seen])
    isolation = np.concatenate([one.isolation for one in seen])
    named = np.concatenate([one.thruster for one in seen])
    right = int((named == np.concatenate([one.thruster for one in batches])).sum())
    low, high = clopper_pearson(right, named.size)
    cells = (
        str(named.size),
        str(int((detection < 0.0).sum())),
        _times(detection),
        _times(isolation),
        f"{100.0 * right / named.size:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})",
    )
    return cells, right / named.size


def _shares(values: list[float]) -> str:
    return ", ".join(f"{100.0 * one:.1f} %" for one in values)


def _times(values: np.ndarray) -> str:
    ordered = np.sort(values)
    return ", ".join(
        f"{one:.2f}" if np.isfinite(one) else "never" for one in (ordered[ordered.size // 2], ordered[-1])
    )


REPRODUCTIONS = tuple(
    Reproduction(
        id=name,
        title=title,
        source="Fonod 2013",
        lines=lines,
        reported="nothing",
        criterion=criterion,
        run=run,
    )
    for name, title, lines, criterion, run in (
        (
            "MSR-4.3", "Open faults under more noise and with late navigation", "beyond the source; L317",
            "all named right in every row", noise,
        ),
        (
            "MSR-4.4", "Readings of the cross-correlation test", "beyond the source; L292-311",
            "as meant and as printed all open faults are named right, with the idle guard none", readings,
        ),
        (
            "MSR-4.5", "The test on faults that it was not made for", "beyond the source; L30, L317",
            "the source's test names all open valves right and no other fault", other_faults,
        ),
    )
)  # fmt: skip
