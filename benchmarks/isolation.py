"""Which detector finds a fault and names what failed: every vehicle, every kind of fault, every detector.

``python -m benchmarks.isolation`` flies what is not yet on file, prints as it goes, and writes
``docs/results/isolation.md`` and ``isolation.png``; ``--quick`` flies few and writes nothing. A cell is one
vehicle, one kind of fault and one detector; each has a small file in the folder of results, so a run that is
interrupted goes on where it was.

All detectors of a vehicle are calibrated on the same healthy validation flights to the same rate of false
alarms, and judged on the same test flights. *Detected* is an alarm within `WITHIN` intervals of the onset;
*named* is the right thruster or sensor within two intervals of the alarm, of those detected. Faults whose
effect in one interval is five standard deviations or more stand apart from smaller ones.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thruster_agents.commands import run_command
from thruster_baselines.detection import (
    CUSUMDetector,
    EstimatorThreshold,
    FilterBank,
    GenericChiSquared,
    GLRDetector,
    HypothesisDetector,
    SetChiSquared,
    SingleChiSquared,
    Telemetry,
    Verdict,
    WindowedGLR,
    threshold_for_rate,
)
from thruster_baselines.detection.calibration import statistics_of
from thruster_baselines.detection.fault_flights import FaultFlights, SensedFlights
from thruster_baselines.detection.separability import Pair, inseparable_pairs
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.faults.kinds import SENSOR_KINDS, SENSORS, THRUSTER_KINDS
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import Spacecraft, load

PROGRAM = "python -m benchmarks.isolation"
ROOT = Path(__file__).resolve().parents[1]
RATE = 3e-4
"""False alarms per interval that every detector is calibrated to."""
WITHIN, NAMING = 10, 2
"""Intervals: from the onset to an alarm that counts, and from the alarm to a name that counts."""
LARGE = 5.0
"""Standard deviations in one interval from which on an effect is large."""
HYPOTHESES = "hypotheses"


@dataclass(frozen=True)
class Effort:
    """How much is flown: faulty flights per kind, healthy flights per vehicle."""

    flights: int = 60
    healthy: int = 200


QUICK = Effort(10, 170)


class Case(NamedTuple):
    """A kind of fault, of a thruster or of a sensor."""

    kind: str
    sensor: str = ""

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.sensor} sensor: {self.kind}" if self.sensor else f"thruster: {self.kind}"


CASES = (
    *(Case(kind) for kind in THRUSTER_KINDS),
    *(Case(kind, sensor) for sensor in SENSORS for kind in SENSOR_KINDS),
)


VEHICLES = ("orion", "spheres", "astrobee_like", "atmos_like")
SEEDS = TEST[5100:]
"""Of the faulty flights; no setting was chosen by any of them."""

Maker = Callable[[Spacecraft, int], Any]


def _with_noise(kind: Callable[..., Any], **settings: Any) -> Maker:
    return lambda craft, count: kind(craft, 1.0, noise=PhysicalNoise(craft), vehicles=count, **settings)


class Degenerate:
    """Alarms never, always, or whenever a likelihood ratio does, and names a thruster at random."""

    def __init__(self, craft: Spacecraft, count: int, how: str) -> None:
        self.how, self.threshold, self._n, self._count = how, 0.5, craft.number_of_thrusters, count
        self._alarm = GLRDetector(craft, 1.0, noise=PhysicalNoise(craft), vehicles=count)
        self._rng = np.random.default_rng(0)

    def update(self, telemetry: Telemetry) -> Verdict:
        """One interval."""
        self._alarm.threshold = self.threshold
        seen = self._alarm.update(telemetry)
        statistic = {"never": 0.0 * seen.statistic, "always": 0.0 * seen.statistic + 1.0}.get(
            self.how, seen.statistic
        )
        detected = statistic > (self.threshold if self.how == "random" else 0.5)
        names = self._rng.integers(1, self._n + 1, self._count)
        return dataclasses.replace(
            seen, detected=detected, statistic=statistic, thruster=np.where(detected, names, 0),
            candidates=None, sensor=(),
        )  # fmt: skip

    def reset(self, vehicles: Any = None) -> None:
        """Restart."""
        self._alarm.reset(vehicles)


DETECTORS: dict[str, Maker] = {
    "never alarms": lambda craft, count: Degenerate(craft, count, "never"),
    "always alarms": lambda craft, count: Degenerate(craft, count, "always"),
    "random name": lambda craft, count: Degenerate(craft, count, "random"),
    "estimate's threshold": lambda craft, count: EstimatorThreshold(craft, 0.4, vehicles=count),
    "generic chi-squared": _with_noise(GenericChiSquared),
    "single chi-squared": _with_noise(SingleChiSquared),
    "set chi-squared": _with_noise(SetChiSquared),
    "likelihood ratio": _with_noise(GLRDetector),
    "likelihood ratio, sign gate": _with_noise(GLRDetector, sign_gate=True),
    "likelihood ratio, window": _with_noise(WindowedGLR),
    "cumulative sums": _with_noise(CUSUMDetector),
    "bank of filters": _with_noise(FilterBank),
    HYPOTHESES: lambda craft, count: HypothesisDetector(craft, 1.0, vehicles=count),
}


class Outcome(NamedTuple):
    """What a detector made of flights, (flights,) each.

    Attributes:
        effect: Of the fault, standard deviations.
        delay: Intervals from the onset to the end of that of the alarm; -1 for none.
        right: Whether what failed was named within `NAMING` intervals of the alarm.
        candidate: Whether it was named, or among the candidates.
        early: Whether there was an alarm before the onset.
    """

    effect: np.ndarray
    delay: np.ndarray
    right: np.ndarray
    candidate: np.ndarray
    early: np.ndarray


def judge(detector: Any, flights: SensedFlights) -> Outcome:
    """Fly a detector, whose threshold is set; after an alarm before the onset it starts anew."""
    count, intervals = flights.on_times.shape[:2]
    alarm, named = np.full(count, -1), np.zeros(count, np.bool_)
    right, candidate, early = np.zeros((3, count), np.bool_)
    rows, sensors = np.arange(count), np.array(flights.sensor)
    for t in range(intervals):
        verdict = detector.update(flights.telemetry(slice(None), t))
        before = verdict.detected & ((t + 1) * flights.duration <= flights.onset)
        early |= before
        if before.any():
            detector.reset(before)
        alarm[verdict.detected & ~before & (alarm < 0)] = t
        blamed = np.array(verdict.sensor)
        open_now = (alarm >= 0) & ~named & (t - alarm <= NAMING)
        says = open_now & ((verdict.thruster > 0) | (blamed != ""))
        fits = (verdict.thruster == flights.thruster) & (blamed == sensors)
        right[says & fits] = True
        among = (flights.thruster > 0) & verdict.candidates[rows, flights.thruster - 1]
        candidate[says & (fits | among)] = True
        named |= says
    onset = np.floor(flights.onset / flights.duration)
    return Outcome(flights.effect, np.where(alarm >= 0, alarm + 1 - onset, -1), right, candidate, early)


# What is on file -----------------------------------------------------------------------------------------


@cache
def _vehicle(name: str) -> Spacecraft:
    return load(name)


@cache
def _healthy(vehicle: str, effort: Effort) -> SensedFlights:
    return FaultFlights(spacecraft=_vehicle(vehicle), kind="loss")(VALIDATION[: effort.healthy], False)


@cache
def _faulty(vehicle: str, case: Case, effort: Effort, tests: float) -> SensedFlights:
    source = FaultFlights(
        spacecraft=_vehicle(vehicle), kind=case.kind, sensor=case.sensor, test_threshold=tests
    )
    return source(SEEDS[: effort.flights], True)


def threshold(folder: Path, vehicle: str, detector: str, effort: Effort) -> float:
    """Calibrated on the healthy flights, or as it is on file."""
    path = folder / vehicle / "thresholds" / f"{detector}.json"
    if not path.exists():
        craft = _vehicle(vehicle)
        found = statistics_of(lambda count: DETECTORS[detector](craft, count), _healthy(vehicle, effort))
        _write(path, {"threshold": threshold_for_rate(found, RATE).threshold})
    return float(json.loads(path.read_text())["threshold"])


def cell(
    folder: Path, vehicle: str, case: Case, detector: str, effort: Effort, tests: bool
) -> dict[str, Any]:
    """One cell, flown now or as it is on file."""
    name = f"{detector}, tests" if tests else detector
    path = folder / vehicle / (f"{case.sensor}_{case.kind}" if case.sensor else case.kind) / f"{name}.json"
    if not path.exists():
        limit = threshold(folder, vehicle, detector, effort)
        flights = _faulty(vehicle, case, effort, limit if tests else 0.0)
        own = DETECTORS[detector](_vehicle(vehicle), effort.flights)
        own.threshold = limit
        outcome = judge(own, flights)
        _write(path, {name: np.asarray(values).tolist() for name, values in outcome._asdict().items()})
    return dict(json.loads(path.read_text()))


def _write(path: Path, values: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part")
    partial.write_text(json.dumps(values))
    partial.replace(path)


# Tables ----------------------------------------------------------------------------------------------------


class Counts(NamedTuple):
    """Of flights with effects of one class."""

    flights: int
    detected: int
    right: int
    candidate: int
    early: int
    delay: float


def counted(values: dict[str, Any], large: bool) -> Counts:
    """The flights whose effect is large, or those whose effect is not."""
    one = Outcome(**{name: np.array(values[name]) for name in Outcome._fields})
    own = (one.effect >= LARGE) == large
    found = own & (one.delay >= 0) & (one.delay <= WITHIN)
    delay = float(np.median(one.delay[found])) if found.any() else float("nan")
    return Counts(
        int(own.sum()), int(found.sum()), int((found & one.right).sum()), int((found & one.candidate).sum()),
        int((own & one.early).sum()), delay,
    )  # fmt: skip


def _share(part: int, whole: int) -> str:
    if whole == 0:
        return "-"
    low, high = clopper_pearson(part, whole)
    return f"{100 * part / whole:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def rows_of(name: str, counts: Counts) -> str:
    """A row of a table."""
    delay = "-" if np.isnan(counts.delay) else f"{counts.delay:.0f}"
    cells = (
        name, str(counts.flights), _share(counts.detected, counts.flights),
        _share(counts.right, counts.detected), _share(counts.candidate, counts.detected), delay,
        str(counts.early),
    )  # fmt: skip
    return "| " + " | ".join(cells) + " |"


HEAD = (
    f"| | flights | detected within {WITHIN}, % | named within {NAMING}, % | among the candidates, % | "
    "delay, intervals | false alarms before |\n|---|---:|---:|---:|---:|---:|---:|"
)


def columns() -> Iterator[tuple[str, bool]]:
    """Detectors, and whether test pulses are fired while it is not clear who failed."""
    yield from ((name, False) for name in DETECTORS)
    yield HYPOTHESES, True


_TITLES = {
    HYPOTHESES: "the flight as it is",
    f"{HYPOTHESES}, tests": "with test pulses after the alarm",
}


def page(found: dict[tuple[str, Case, str], dict[str, Any]], cases: Sequence[Case], effort: Effort) -> str:
    """The page, in Markdown."""
    sensors_too = any(case.sensor for case in cases)
    command = PROGRAM if sensors_too else f"{PROGRAM} --thrusters"
    lines = ["# Isolation: who names what failed", "", f"Written by `{command}`.", "", _about(effort), ""]
    if not sensors_too:
        lines += ["Faults of sensors were not flown for this page.", ""]
    for vehicle in VEHICLES:
        lines += [f"## {vehicle}", "", "### Kinds of fault, by comparing hypotheses", ""]
        names = {
            HYPOTHESES: "the flight as it is",
            f"{HYPOTHESES}, tests": "with test pulses after the alarm",
        }
        for name, title in names.items():
            lines += [f"{LARGE:g} standard deviations or more, {title}:", "", HEAD]
            lines += [rows_of(case.title, counted(found[vehicle, case, name], True)) for case in cases]
            lines.append("")
        lines += [f"Below {LARGE:g} standard deviations:", "", HEAD]
        lines += [rows_of(case.title, counted(found[vehicle, case, HYPOTHESES], False)) for case in cases]
        lines += ["", f"### Detectors, all kinds together, {LARGE:g} standard deviations or more", ""]
        for title, sensors in (("Thrusters", False), ("Sensors", True)):
            if all(bool(case.sensor) != sensors for case in cases):
                continue
            lines += [f"{title}:", "", HEAD]
            for name in _names():
                every = [
                    counted(found[vehicle, case, name], True)
                    for case in cases
                    if bool(case.sensor) == sensors
                ]
                sums = [sum(one[k] for one in every) for k in range(5)]
                delays = [one.delay for one in every if not np.isnan(one.delay)]
                lines.append(
                    rows_of(name, Counts(*sums, float(np.median(delays)) if delays else float("nan")))
                )
            lines.append("")
        lines += ["### What physics cannot tell apart", "", *_pairs(inseparable_pairs(_vehicle(vehicle))), ""]
    return "\n".join(lines)


def _summed(every: Sequence[Counts]) -> Counts:
    sums = [sum(one[k] for one in every) for k in range(5)]
    delays = [one.delay for one in every if not np.isnan(one.delay)]
    return Counts(*sums, float(np.median(delays)) if delays else float("nan"))  # type: ignore[arg-type]


def _names() -> list[str]:
    return [f"{name}, tests" if tests else name for name, tests in columns()]


def _pairs(pairs: Sequence[Pair]) -> list[str]:
    by_reason: dict[str, list[str]] = {}
    for one in pairs:
        by_reason.setdefault(one.reason, []).append(f"{one.first}-{one.second}")
    return [f"- {reason}: {', '.join(names)}." for reason, names in by_reason.items()] or ["- Nothing."]


def _about(effort: Effort) -> str:
    return (
        f"Every row has {effort.flights} test flights with one fault each under the scripted pilot of "
        f"`FaultDiagnosis-v1`; thresholds are calibrated on {effort.healthy} healthy validation flights to "
        f"{RATE:g} false alarms per interval. *Detected* is an alarm within {WITHIN} intervals of the onset. "
        f"*Named* is the right thruster or sensor within {NAMING} intervals of the alarm, of those detected; "
        "*among the candidates*: named, or one of those that the detector says it cannot tell apart. In "
        "brackets 95 % Clopper-Pearson intervals. The effect of a fault is the largest change that it makes "
        "in one interval, in standard deviations of a fault-free one; of sensors that of the first three "
        "intervals. Vehicles are those of the catalogue, with their minimum pulses, scatter and sensors. Not "
        "here: plasma thrusters and the chaser about Mars, whose detectors look at other signals (see the "
        "reproductions), wheels and gyros, and flights in closed loop. Test pulses make effects larger, so "
        "that more flights count there: those tables are not paired with the ones without. How many "
        "candidates there were is not counted: that column alone says little. No setting was chosen by a "
        "test seed that is flown here."
    )


def draw(found: dict[tuple[str, Case, str], dict[str, Any]], cases: Sequence[Case], path: Path) -> None:
    """Named within two intervals, of the detected, large effects: kinds by detectors."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # only here: slow to import
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15.0, 5.5 * len(VEHICLES)), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, vehicle in zip(np.atleast_1d(figure.subplots(len(VEHICLES), 1)), VEHICLES, strict=True):
        shares = np.full((len(_names()), len(cases)), np.nan)
        for row, name in enumerate(_names()):
            for column, case in enumerate(cases):
                one = counted(found[vehicle, case, name], True)
                shares[row, column] = 100.0 * one.right / one.detected if one.detected else np.nan
        axes.imshow(shares, cmap="RdYlGn", vmin=0.0, vmax=100.0, aspect="auto")
        for row, column in zip(*np.nonzero(~np.isnan(shares)), strict=True):
            axes.text(column, row, f"{shares[row, column]:.0f}", ha="center", va="center", fontsize=7)
        axes.set_xticks(
            range(len(cases)), [case.title for case in cases], rotation=40, ha="right", fontsize=8
        )
        axes.set_yticks(range(len(_names())), _names(), fontsize=8)
        axes.set_title(f"{vehicle}: right one named within {NAMING} intervals of the alarm, %")
    figure.savefig(path, dpi=80)


def main(arguments: list[str]) -> int:
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description=__doc__)
    parser.add_argument("--thrusters", action="store_true", help="faults of thrusters only")
    parser.add_argument("--quick", action="store_true", help="few flights, and no page")
    parser.add_argument(
        "--results", type=Path, default=ROOT / "runs" / "isolation", help="folder of what was flown already"
    )
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "results", help="folder of the page")
    options = parser.parse_args(arguments)
    effort = QUICK if options.quick else Effort()
    folder = options.results / f"{effort.flights}-{effort.healthy}"
    found = {}
    cases = [case for case in CASES if not (options.thrusters and case.sensor)]
    total, begin = len(VEHICLES) * len(cases), time.perf_counter()
    for number, (vehicle, case) in enumerate([(one, case) for case in cases for one in VEHICLES], start=1):
        for detector, tests in columns():
            name = f"{detector}, tests" if tests else detector
            found[vehicle, case, name] = cell(folder, vehicle, case, detector, effort, tests)
        _faulty.cache_clear()
        best = counted(found[vehicle, case, HYPOTHESES], True)
        print(
            f"[{number}/{total}, {time.perf_counter() - begin:.0f} s] {vehicle}, {case.title}: of "
            f"{best.flights} detected {best.detected}, named {best.right}",
            flush=True,
        )
    if not options.quick:
        options.output.mkdir(parents=True, exist_ok=True)
        (options.output / "isolation.md").write_text(page(found, cases, effort) + "\n", encoding="utf-8")
        draw(found, cases, options.output / "isolation.png")
        print(f"Written: {options.output / 'isolation.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(run_command(PROGRAM, lambda: main(sys.argv[1:])))
