"""The integrated scheme of the source, from ten seeds, on its eight scenarios.

High-level networks as in `high_level_study`, low-level ones as in `low_level_study`, trained on to 3e-5:
those that stop where the source stops are of no use here. The upper threshold is that of the low level, the
lower one that of 120 healthy pulses at 910 V. Which pulses are faulty follows the source: all of the failing
thruster after a fault of 15 % began, though its thrust is at the limit of the band (85.1 % and 114.7 %), and
those with a thrust out of the band where the fault grows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from reproductions.valdes2008.high_level_study import (
    EXPERIMENTS,
    FOLLOWER,
    Flown,
    experiment_signals,
    flown,
    high_level,
)
from reproductions.valdes2008.low_level_study import CLOSE, HEALTHY_PULSES, trained
from reproductions.valdes2008.study import CIRCUIT, measured, out_of_band, thrust_of
from thruster_agents.dynamic_neurons.integrated import IntegratedClassifier, MissionReport
from thruster_baselines.detection import Confusion
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.seeds import TEST, VALIDATION

SCENARIOS = tuple(name for name in EXPERIMENTS if name.startswith("I-"))


@dataclass(frozen=True)
class Firings:
    """Those of follower 1 in a mission."""

    thruster: IntArray  # (firings,), from 0
    faulty: BoolArray  # (firings,), whether each is


@dataclass(frozen=True)
class Judged:
    """What the scheme of one seed says of a mission."""

    report: MissionReport  # of the integrated scheme
    low: BoolArray  # (firings,), what the low level alone says of each, with its one threshold


@cache
def integrated(seeds: int) -> tuple[IntegratedClassifier, ...]:
    """The scheme of each seed, with its thresholds."""
    nominal = measured(
        np.random.default_rng(VALIDATION.start + 61), voltage=np.full(HEALTHY_PULSES, CIRCUIT.voltage)
    )
    found = []
    for high, low in zip(high_level(seeds), trained(CLOSE, seeds), strict=True):
        one = IntegratedClassifier(high.classifier, low.classifier)
        one.calibrate(*nominal)
        found.append(one)
    return tuple(found)


@cache
def firings(name: str, way: Flown) -> Firings:
    """Which thruster fired, and whether the pulse was faulty."""
    experiment = EXPERIMENTS[name]
    found = flown(name, way).discharges(0, FOLLOWER)
    own = (found.thruster == experiment.thruster) & (found.step >= experiment.onset)
    if way == "twin":
        faulty = np.zeros(own.shape, dtype=np.bool_)
    elif experiment.incremental:
        faulty = own & out_of_band(thrust_of(**found.parameters()))
    else:
        faulty = own
    return Firings(found.thruster - 1, faulty)


@cache
def judged(name: str, way: Flown, seeds: int) -> tuple[Judged, ...]:
    """What each seed's scheme says of a mission."""
    found, signals = flown(name, way).discharges(0, FOLLOWER), experiment_signals(name, way)
    rng = np.random.default_rng(TEST.start + 61 + list(EXPERIMENTS).index(name))
    voltage, current = measured(rng, **found.parameters())

    def waveforms(which: IntArray) -> tuple[FloatArray, FloatArray]:
        return voltage[which], current[which]

    results = []
    for one in integrated(seeds):
        report = one.diagnose(signals, firings(name, way).thruster, waveforms)
        results.append(Judged(report, one.low_level.declare(voltage, current)))
    return tuple(results)


def confusion(name: str, way: Flown, declared: BoolArray, pair_only: bool) -> Confusion:
    """Of all firings, or of those of the pair with the fault, as the source counts."""
    truth = firings(name, way)
    which = truth.thruster // 2 == EXPERIMENTS[name].axis if pair_only else np.ones(truth.faulty.shape, bool)
    return Confusion.of(truth.faulty[which], declared[which])
