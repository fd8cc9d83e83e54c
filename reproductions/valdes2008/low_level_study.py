"""The low-level networks of the source, trained from ten seeds, and what they say of its ramps.

Each is a 2-10-1 network of dynamic neurons, trained to predict the current one sample ahead from the measured
voltage and current of twelve healthy pulses with charge voltages from 857 to 977 V (the source does not say
how many), and used on its own output. The source stops at a mean square error of 1e-4. That is four times the
variance of the errors of the samples, so that there is a second set that goes on to 3e-5. The threshold is
(4.2) with 1.15, of 120 healthy pulses that were not trained on. The source's go up to 980 V, where the thrust
is above the band; these go to 977 V.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch

from reproductions.record import Effort
from reproductions.valdes2008.study import CIRCUIT, RAMPS, SEEDS, measured, out_of_band, thrust_of
from thruster_agents.dynamic_neurons import TrainingRecord, TrainingSettings
from thruster_agents.dynamic_neurons.low_level import LowLevelClassifier, LowLevelSettings
from thruster_baselines.detection import Confusion
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.seeds import TEST, TRAIN, VALIDATION

STOP, CLOSE = 1e-4, 3e-5  # mean square errors at which training ends
VOLTAGES = (857.0, 977.0)  # V
HEALTHY_PULSES = 120
_TRAINING_PULSES = 12
_ITERATIONS = 400

OTHER = {"propellant_loss": 41, "electrode_sediment": 64, "conductivity_loss": 41}
"""Pulses of the other thruster of the pair, which is healthy."""


@dataclass(frozen=True)
class Trained:
    """A low-level network of one seed."""

    classifier: LowLevelClassifier  # with its threshold
    record: TrainingRecord  # of the training
    healthy: FloatArray  # (120,), residuals that the threshold is made from
    fresh: FloatArray  # (120,), residuals of other healthy pulses at the same voltages

    @property
    def threshold(self) -> float:
        """Of the residual."""
        assert self.classifier.threshold is not None
        return self.classifier.threshold


@dataclass(frozen=True)
class RampResult:
    """What one network says of one ramp."""

    residual: FloatArray  # (pulses,), of the thruster that degrades
    other: FloatArray  # Residuals of the healthy one
    faulty: BoolArray  # (pulses,), whether the thrust is out of the band
    declared: BoolArray  # (pulses,)
    false_alarms: int  # of the healthy one

    @property
    def confusion(self) -> Confusion:
        """Of both thrusters."""
        healthy = Confusion(0, 0, self.false_alarms, self.other.size - self.false_alarms)
        return Confusion.of(self.faulty, self.declared) + healthy

    @property
    def first_alarm(self) -> int | None:
        """Number, from 1, of the first pulse declared faulty."""
        return int(np.argmax(self.declared)) + 1 if self.declared.any() else None


def seeds_of(effort: Effort) -> int:
    """Training runs: ten at full effort."""
    return max(1, min(SEEDS, effort.flights // 10))


@cache
def trained(stop: float, seeds: int) -> tuple[Trained, ...]:
    """Networks that were trained to this mean square error."""
    validation = np.random.default_rng(VALIDATION.start + 46)
    voltages = np.linspace(*VOLTAGES, HEALTHY_PULSES)
    healthy = measured(validation, voltage=voltages)
    fresh = measured(np.random.default_rng(TEST.start + 46), voltage=voltages)
    found = []
    for seed in range(seeds):
        rng = np.random.default_rng(TRAIN.start + seed)
        pulses = measured(rng, voltage=rng.uniform(*VOLTAGES, _TRAINING_PULSES))
        classifier = LowLevelClassifier(LowLevelSettings(), generator=torch.Generator().manual_seed(seed))
        record = classifier.train(*pulses, training=TrainingSettings(stop=stop, iterations=_ITERATIONS))
        classifier.calibrate(*healthy)
        found.append(
            Trained(classifier, record, classifier.residuals(*healthy), classifier.residuals(*fresh))
        )
    return tuple(found)


@cache
def ramp_results(kind: str, stop: float, seeds: int) -> tuple[RampResult, ...]:
    """What each network says of the ramp of a fault kind, and of the healthy thruster beside it."""
    rng = np.random.default_rng(TEST.start + list(RAMPS).index(kind))
    pulses = measured(rng, **RAMPS[kind])
    others = measured(rng, voltage=np.full(OTHER[kind], CIRCUIT.voltage))
    faulty = out_of_band(thrust_of(**RAMPS[kind]))
    results = []
    for one in trained(stop, seeds):
        residual, other = one.classifier.residuals(*pulses), one.classifier.residuals(*others)
        results.append(
            RampResult(residual, other, faulty, residual > one.threshold, int((other > one.threshold).sum()))
        )
    return tuple(results)
