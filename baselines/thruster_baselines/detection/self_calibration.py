"""Thresholds that a vehicle's own healthy flights give, kept beside the vehicle's hash.

For a test of which no closed form is known, `calibrate` flies healthy flights of the vehicle and finds the
threshold of a stated rate. What it found is kept in the user's folder for caches, under a hash of the
description, the settings and the test, so that it is done once.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from thruster_baselines.detection.calibration import calibrate
from thruster_baselines.detection.contract import AnyDetector
from thruster_baselines.detection.flights import FlightSource
from thruster_envs import __version__
from thruster_envs.kernels import kernel_folder
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import Spacecraft
from thruster_envs.whole_files import write_whole

__all__ = ["calibrated_threshold"]

_CONFIDENCE = 0.95


def calibrated_threshold(
    make: Callable[[int], AnyDetector],
    source: FlightSource,
    spacecraft: Spacecraft,
    false_alarms: float,
    intervals: int,
    key: Mapping[str, Any],
) -> float:
    """The threshold that healthy flights exceed at most at a rate, flown once and then kept.

    Args:
        make: Builds a detector for so many vehicles.
        source: Of the flights.
        spacecraft: That flies.
        false_alarms: Rate per interval, above 0 and below 1.
        intervals: In a flight.
        key: What else the answer depends on: the test and its settings.
    """
    rate = -math.expm1(intervals * math.log1p(-false_alarms))
    flights = math.ceil(2.0 * math.log1p(-_CONFIDENCE) / math.log1p(-rate))
    path = _path(spacecraft, {"false_alarms": false_alarms, "flights": flights} | dict(key))
    kept = _kept(path)
    if kept is not None:
        return kept
    seeds = VALIDATION[:flights]
    duration = source(seeds[:1], False).duration
    found = calibrate(make, source, seeds, false_alarms=false_alarms, per=duration, confidence=_CONFIDENCE)
    if path is not None:
        _keep(path, {"threshold": found.threshold, "upper": found.upper, "samples": found.samples})
    return found.threshold


def _kept(path: Path | None) -> float | None:
    """The threshold that was found before; None where there is none that can be read."""
    try:
        return None if path is None else float(json.loads(path.read_text())["threshold"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _path(spacecraft: Spacecraft, key: Mapping[str, Any]) -> Path | None:
    folder = kernel_folder()
    if folder is None:
        return None
    content = json.dumps([__version__, spacecraft.to_dict(), dict(key)], sort_keys=True, default=repr)
    return folder / "thresholds" / f"{hashlib.sha256(content.encode()).hexdigest()[:32]}.json"


def _keep(path: Path, found: Mapping[str, Any]) -> None:
    """Where nothing can be written it is found anew next time."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(dict(found)).encode())
    except OSError:
        return
