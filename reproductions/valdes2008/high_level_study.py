"""The high-level networks of the source, trained from ten seeds, and the missions that they and others judge.

Three 4-10-1 networks of dynamic neurons predict the rates of follower 1 from its pulses and its relative
quaternion; trained on missions 1 to 3, thresholds by eq. 5.3 from missions 1 to 6, all healthy. The source
does not say when its training stops; here it is at a mean square error of 1e-4, or after 150 iterations of
L-BFGS. Each faulty mission is flown three ways, with the same sensor errors: with the fault acting on the
firings of its thruster, as a fault does; without it (the paired fault-free run, which the source does not
fly); and with the torque besides that the source's pulse counts would need (`REPORTED_FAULT_BIAS`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import torch

from reproductions.valdes2008.study import CIRCUIT, step_fault
from thruster_agents.dynamic_neurons import TrainingRecord, TrainingSettings
from thruster_agents.dynamic_neurons.high_level import HighLevelClassifier, HighLevelSettings, MissionSignals
from thruster_envs.faults import Fault
from thruster_envs.missions import Missions, fly_missions
from thruster_envs.physics.pulsed_craft import REPORTED_FAULT_BIAS
from thruster_envs.protocols import FloatArray
from thruster_envs.seeds import TEST, TRAIN, VALIDATION

FOLLOWER = 1  # follower 1, from 0: the leader is 0
Flown = Literal["fault", "twin", "torque"]
HEALTHY_MISSIONS = ((25, 40, 55), (20, 45, 60), (35, 45, 55), (30, 40, 50), (30, 45, 55), (35, 50, 60))
"""Roll, pitch and yaw in degrees: three of training, three of validation."""

_TRAINING = 3
_ITERATIONS = 150
_STOP = 1e-4
_PIECES = (20.0, 100.0, 400.0, 2600.0)  # s after the onset, where the straight pieces of eq. 6.3 end


@dataclass(frozen=True)
class Experiment:
    """A faulty mission of the source."""

    target: tuple[int, int, int]  # Roll, pitch and yaw, degrees
    thruster: int  # that fails, from 1
    case: int  # fault case 1, 2 or 3
    onset: float = 0.0  # s
    incremental: bool = False  # whether it grows (eq. 6.3, 6.4) or comes at 15 %

    @property
    def axis(self) -> int:
        """Of its pair, from 0."""
        return (self.thruster - 1) // 2

    def faults(self) -> list[Fault]:
        """What is flown."""
        if not self.incremental:
            return [step_fault(self.thruster, self.case, onset=self.onset)]
        return _incremental(self)


EXPERIMENTS = {
    "H-FS1": Experiment((25, 30, 40), 2, 1),
    "H-FS2": Experiment((20, 35, 45), 3, 2),
    "H-FS3": Experiment((25, 35, 45), 5, 3),
    "I-1": Experiment((20, 30, 40), 1, 1),
    "I-2": Experiment((25, 30, 40), 4, 1),
    "I-3": Experiment((20, 35, 45), 5, 2),
    "I-4": Experiment((25, 35, 45), 2, 2),
    "I-5": Experiment((25, 40, 55), 3, 3, 400.0, incremental=True),
    "I-6": Experiment((30, 40, 50), 6, 3, 400.0, incremental=True),
    "I-7": Experiment((20, 45, 60), 3, 2, 300.0, incremental=True),
    "I-8": Experiment((30, 45, 55), 4, 2, 300.0, incremental=True),
}


def incremental_resistance(seconds: FloatArray) -> FloatArray:
    """Added resistance of eq. 6.3, ohm, so many seconds after the onset; not below zero."""
    thrust = 100.0 / (1.0 + 0.009 * np.asarray(seconds))
    return np.maximum(0.0081 - (thrust - 85.0) / 1750.0, 0.0)


def _incremental(experiment: Experiment) -> list[Fault]:
    """Eq. 6.3 in straight pieces, each the sum of what ramps that begin together still add; eq. 6.4."""
    common = {"craft": FOLLOWER + 1, "onset": experiment.onset}
    if experiment.case == 3:
        ends = np.array(_PIECES)
        values = incremental_resistance(ends)
        slopes = np.diff(values, prepend=0.0) / np.diff(ends, prepend=0.0)
        parts = (slopes - np.append(slopes[1:], 0.0)) * ends
        return [
            Fault(experiment.thruster, "conductivity_loss", severity=float(part), profile="ramp",
                  profile_time=float(end), **common)
            for part, end in zip(parts, ends, strict=True)
        ]  # fmt: skip
    # Eq. 6.4 with a plus in the target thrust, which has to rise: 100 (1 + 0.0001 l), l in seconds.
    first, last = (0.0220 - (100.0 * (1.0 + 1e-4 * one) - 115.0) / 6400.0 for one in (0.0, 2700.0))
    sediment = 1.0 - first / CIRCUIT.electrode_width
    return [
        Fault(experiment.thruster, "electrode_sediment", severity=sediment, **common),
        Fault(experiment.thruster, "electrode_sediment", severity=1.0 - last / first, profile="ramp",
              profile_time=2700.0, **common),
    ]  # fmt: skip


@dataclass(frozen=True)
class TrainedHigh:
    """High-level networks of one seed."""

    classifier: HighLevelClassifier  # with its thresholds
    records: tuple[TrainingRecord, ...]  # of the three trainings
    healthy: FloatArray  # (6, 3), residuals of the six healthy missions

    @property
    def thresholds(self) -> FloatArray:
        """(3,), of roll, pitch and yaw."""
        assert self.classifier.thresholds is not None
        return self.classifier.thresholds


@cache
def healthy_signals() -> MissionSignals:
    """Of the six healthy missions."""
    targets = np.array(HEALTHY_MISSIONS, dtype=np.float64)[:, np.newaxis]
    seeds = [*range(TRAIN.start, TRAIN.start + _TRAINING), *range(VALIDATION.start, VALIDATION.start + 3)]
    return MissionSignals.of(fly_missions(targets, degrees=True, craft=2, seeds=seeds), FOLLOWER)


@cache
def high_level(seeds: int) -> tuple[TrainedHigh, ...]:
    """The networks of so many seeds."""
    signals, found = healthy_signals(), []
    for seed in range(seeds):
        classifier = HighLevelClassifier(HighLevelSettings(), generator=torch.Generator().manual_seed(seed))
        records = classifier.train(
            signals[:_TRAINING], training=TrainingSettings(stop=_STOP, iterations=_ITERATIONS)
        )
        classifier.calibrate(signals)
        found.append(TrainedHigh(classifier, records, classifier.residuals(signals)))
    return tuple(found)


@cache
def flown(name: str, how: Flown) -> Missions:
    """One mission of an experiment."""
    experiment = EXPERIMENTS[name]
    return fly_missions(
        np.array(experiment.target, dtype=np.float64),
        degrees=True,
        craft=2,
        faults=None if how == "twin" else experiment.faults(),
        seeds=[TEST.start + list(EXPERIMENTS).index(name)],
        fault_bias=REPORTED_FAULT_BIAS if how == "torque" else (0.0, 0.0),
    )


def experiment_signals(name: str, how: Flown) -> MissionSignals:
    """What the networks see of it."""
    return MissionSignals.of(flown(name, how), FOLLOWER)
