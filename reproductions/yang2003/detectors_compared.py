"""Every detector by one evaluation protocol: Orion firing at random, one fault in each flight.

The source compares its tests one condition at a time (chapter 5). Here all of them, and those beyond the
source, are calibrated to the same rate of false alarms on validation seeds and measured on the same test
flights: dead, weak, stuck on or leaking thrusters, with coupling loss, scatter and sensor noise, in intervals
of 1 s. A second table has flights in which a third of the measurements are missing, late, NaN or out of any
range; a third one flights of `FaultDiagnosis-v1` under its scripted pilot, where a player of that environment
is measured beside the detectors. Besides, dead thrusters that were commanded to fire for 1.5 s or more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np

from reproductions.cells import finite
from reproductions.figures import BLUE, GREEN, INK, ORANGE, PURPLE, RED, Figure, annotate, ticks
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from thruster_baselines import detection
from thruster_baselines.detection.evaluate import Evaluation
from thruster_baselines.detection.flights import FlightSource
from thruster_baselines.detection.glr import SOURCE_THRESHOLD
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping import delivered_on_times
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.faults import FaultDistribution
from thruster_envs.protocols import Detector, FloatArray
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import load

ORION = load("orion")
RATE = 1e-4  # false alarms per interval
FAULTS = FaultDistribution(
    kinds=("stuck_off", "loss", "stuck_on", "leak"),
    severity={"loss": (0.3, 0.9), "leak": (0.1, 0.5)},
    onset=(5.0, 15.0),
    onset_grid=1.0,
)
FLIGHTS_PER_SAMPLE = 0.2  # 2,000 flights of validation and as many of the test, at full effort
COMMANDED = 1.5  # s of firing that a dead thruster was commanded


def _with_sensors(kind: Callable[..., Any], **settings: Any) -> Callable[[int], Detector]:
    return lambda vehicles: kind(ORION, 1.0, noise=PhysicalNoise(ORION), vehicles=vehicles, **settings)


DETECTORS: dict[str, Callable[[int], Detector]] = {
    "estimate's threshold": lambda vehicles: detection.EstimatorThreshold(ORION, 0.4, vehicles=vehicles),
    "generic chi-squared": _with_sensors(detection.GenericChiSquared),
    "single chi-squared": _with_sensors(detection.SingleChiSquared),
    "set chi-squared": _with_sensors(detection.SetChiSquared),
    "likelihood ratio, source's noise": lambda vehicles: detection.GLRDetector.yang2003(
        ORION, SOURCE_THRESHOLD, vehicles=vehicles
    ),
    "likelihood ratio": _with_sensors(detection.GLRDetector),
    "likelihood ratio, sign gate": _with_sensors(detection.GLRDetector, sign_gate=True),
    "likelihood ratio, window": _with_sensors(detection.WindowedGLR),
    "cumulative sums": _with_sensors(detection.CUSUMDetector),
    "bank of filters": _with_sensors(detection.FilterBank),
}
BEST = "likelihood ratio, sign gate"
PLAYER = "player: cumulative sums, then models"
ENVIRONMENT = "thruster_envs/FaultDiagnosis-v1"
CURVES = {
    "estimate's threshold": ORANGE, "generic chi-squared": PURPLE, "likelihood ratio, source's noise": RED,
    BEST: BLUE, "likelihood ratio, window": GREEN,
}  # fmt: skip


@reproduces(
    "detectors",
    lines="chapter 5 (E23 to E28), ours in one comparison",
    reported="nothing of this kind: one condition at a time, without rates of names",
    criterion="calibrated alarms stay so on test flights, with bad measurements too; 99 % of dead thrusters "
    "found and named within two intervals",
    alone=True,
)
def compared(effort: Effort) -> Finding:
    """Every detector by one yardstick."""
    count = max(40, int(FLIGHTS_PER_SAMPLE * effort.samples))
    rate = RATE if count >= 1000 else 0.01  # few flights cannot show a rare alarm
    seeds: dict[str, Sequence[int]] = {"validation": VALIDATION[:count], "test": TEST[:count]}
    source = detection.RandomFlights(spacecraft=ORION, faults=FAULTS)
    identify = detection.by_model_comparison(detection.ModelComparison(ORION))

    def measure(flights: FlightSource, **more: Any) -> dict[str, Evaluation]:
        settings = {"false_alarms": rate, "identify": identify, **seeds, **more}
        return {
            name: detection.evaluate(make, flights, name=name, **settings) for name, make in DETECTORS.items()
        }

    found = measure(source)
    best = found[BEST]
    spoilt = detection.RandomFlights(spacecraft=ORION, faults=FAULTS, bad_measurements=1.0 / 3.0)
    bad = measure(spoilt, rates=())
    flown = in_flight(seeds, rate)
    dead, named = dead_thrusters(count, rate)
    low, high = clopper_pearson(named, dead)

    def as_stated(those: dict[str, Evaluation]) -> bool:
        return all(one.false_alarms.low <= rate for one in those.values())

    return Finding(
        ours=f"likelihood ratio with sensors' noise and sign gate: {_delay(best)}, {best.missed.value:.1%} "
        f"missed, {best.isolated.value:.1%} named rightly; dead thrusters told {COMMANDED:g} s or more: "
        f"{named / dead:.2%} found and named within two intervals",
        checks={
            "no detector alarms more often than it was calibrated to, at 95 % confidence": as_stated(found),
            "nor with a third of the measurements bad": as_stated(bad),
            "nor in flights of the environment": as_stated(flown),
            "dead thrusters told 1.5 s: 99 % are found and named within two intervals": named >= 0.99 * dead,
        },
        beyond_source=True,
        data={
            **{
                what: {name: one.to_dict() for name, one in those.items()}
                for what, those in (("detectors", found), ("bad measurements", bad), ("in flight", flown))
            },
            "dead thrusters": {"flights": dead, "named": named},
        },
        note=f"{count:,} flights of {best.intervals} intervals on validation seeds for the thresholds, as "
        f"many on test seeds for the rest, healthy and faulty each. Thresholds are calibrated to {rate:g} "
        "false alarms per interval. A missed fault counts as infinitely late. Most wrong names are those of "
        f"a thruster with the same force and opposite torque. Dead thrusters: {dead:,} flights, {named:,} "
        f"named ({low:.2%} to {high:.2%}).",
        tables=(
            _table("Every detector", found),
            _table("A third of the measurements missing, late, no numbers, or out of range", bad),
            _table("In flights of FaultDiagnosis-v1 under its scripted pilot", flown),
        ),
        figure=lambda: _draw(found),
    )


def in_flight(seeds: dict[str, Sequence[int]], rate: float) -> dict[str, Evaluation]:
    """Every detector, and a player, in flights of `FaultDiagnosis-v1`; all of them in the same."""
    faults = dataclasses.replace(FAULTS, onset=(0.0, 300.0), onset_grid=ORION.control_period)
    flights, observed = (
        cache(detection.EnvironmentFlights(faults=faults, observed=one)) for one in (False, True)
    )
    layout = gym.make_vec(ENVIRONMENT, num_envs=1, vectorization_mode="vector_entry_point")

    def player(vehicles: int) -> Detector:
        return detection.PlayerDetector(layout, detection.DetectorPlayer(layout, worlds=vehicles), vehicles)

    identify = detection.by_model_comparison(detection.ModelComparison(ORION))
    found = {
        name: detection.evaluate(
            make, flights, name=name, false_alarms=rate, identify=identify, rates=(), **seeds
        )
        for name, make in DETECTORS.items()
    }
    return found | {
        PLAYER: detection.evaluate(player, observed, name=PLAYER, false_alarms=rate, rates=(), **seeds)
    }


def dead_thrusters(flights: int, rate: float) -> tuple[int, int]:
    """Two intervals with a dead thruster that is commanded to fire 1.5 s or more in them.

    Returns:
        How many flights there were, and in how many it was found and rightly named by their end.
    """
    make, fault_free = DETECTORS[BEST], detection.RandomFlights(spacecraft=ORION)
    healthy = fault_free(VALIDATION[:flights], False)
    detector = make(flights)
    statistics = np.stack(
        [
            detector.update(healthy.on_times[:, k], healthy.rate_change[:, k], healthy.duration).statistic
            for k in range(healthy.on_times.shape[1])
        ]
    )
    detector = make(flights)
    detector.threshold = detection.threshold_for_rate(statistics.ravel(), rate).threshold
    rng = np.random.default_rng(TEST[0])
    dead = rng.integers(12, size=flights)
    everyone = np.arange(flights)
    found = np.zeros(flights, np.bool_)
    for commanded in (np.ones(flights), rng.uniform(COMMANDED - 1.0, 1.0, flights)):
        on_times = rng.uniform(0.0, 1.0, (flights, 12)) * (rng.random((flights, 12)) < 1.0 / 3.0)
        on_times[everyone, dead] = commanded
        diagnosis = detector.update(on_times, measured(rng, on_times, dead), 1.0)
        found |= diagnosis.detected & (diagnosis.thruster == dead + 1)
    return flights, int(found.sum())


def measured(rng: np.random.Generator, on_times: FloatArray, dead: np.ndarray) -> FloatArray:
    """Rate change (flights, 6) that Orion's sensors say of on-times with one thruster dead in each flight."""
    fired = on_times.copy()
    fired[np.arange(len(fired)), dead] = 0.0
    scatter = np.array([one.scatter for one in ORION.thrusters])
    given = delivered_on_times(fired, ORION.feed.coupling) * (1.0 + scatter * rng.uniform(-1, 1, fired.shape))
    sigmas = np.sqrt(2.0) * np.repeat([ORION.sensors.velocity, ORION.sensors.rate], 3)
    return np.asarray(given @ ORION.effectiveness().T + sigmas * rng.normal(size=(len(fired), 6)))


def _delay(one: Evaluation) -> str:
    return f"found after {one.median_delay:.0f} s in the median, {one.delay_90:.0f} s for nine in ten"


def _table(title: str, found: dict[str, Evaluation]) -> Table:
    return Table.of(
        title,
        found,
        {
            "detector": "{0}",
            "delay, s: median": lambda _, one: finite(one.median_delay, ".0f", "missed"),
            "90 %": lambda _, one: finite(one.delay_90, ".0f", "missed"),
            "missed": "{1.missed.value:.1%}",
            "false alarms per hour (95 %)": lambda _, one: "{:.2f} ({:.2f} to {:.2f})".format(
                *one.false_alarms_per_hour
            ),
            "named rightly": "{1.isolated.value:.1%}",
            "kind right": lambda _, one: (
                f"{one.identified.value:.1%}" if one.identified is not None and one.identified.trials else ""
            ),
            "severity error": lambda _, one: (
                "" if one.severity_error is None else f"{one.severity_error:.3f}"
            ),
            "update, µs: alone": lambda _, one: f"{1e6 * one.update_time:.1f}",
            "in a batch": lambda _, one: f"{1e6 * one.update_time_in_batch:.2f}",
        },
    )


def _draw(found: dict[str, Evaluation]) -> Figure:
    figure = Figure(figsize=(8.0, 8.6), layout="constrained")
    axes = figure.subplot_mosaic([["curve", "bars"], ["matrix", "matrix"]], height_ratios=[1.0, 1.15])
    curve = axes["curve"]
    for name, colour in CURVES.items():
        points = [one for one in found[name].curve if np.isfinite(one.delay_90)]
        hourly = [max(one.false_alarms_per_hour, 0.1) for one in points]
        curve.plot(hourly, [one.delay_90 for one in points], "o-", color=colour, label=name, markersize=4)
    curve.set_xscale("log")
    curve.set_yscale("log", base=2)
    curve.yaxis.set_major_formatter("{x:g}")
    # the curves end at 60 s; the names stand above them
    curve.set(ylim=(2.0, 400.0), xlabel="false alarms per hour (0.1: none seen)")
    curve.set(ylabel="delay that nine in ten keep below, s", title="Fewer false alarms, later alarms")
    curve.legend(fontsize=8.5, loc="upper right")
    for place, (name, one) in enumerate(found.items()):
        share = 100.0 * one.isolated.value
        axes["bars"].barh(place, share, color=CURVES.get(name, INK), height=0.7)
        annotate(axes["bars"], f"{share:.0f}", (share, place), (3, 0), va="center")
    ticks(axes["bars"], list(found), of_y=True, fontsize=8.5)
    axes["bars"].set(
        xlim=(0.0, 112.0), xlabel="of the detected, named rightly, %", title="Who names the thruster"
    )
    found[BEST].draw_confusion(axes["matrix"])
    axes["matrix"].set(title=f"Who is taken for whom, % of flights ({BEST})")
    return figure
