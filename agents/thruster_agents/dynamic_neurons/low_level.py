"""The low level: a network that knows healthy discharges, and how far a pulse is from what it expects.

After Valdes 2008, chapter 4. One network predicts the discharge current one sample ahead, from the capacitor
voltage and the current; it is trained on measured currents of healthy pulses at several charge voltages, and
used on its own output instead (parallel mode). The mean absolute error over a pulse is the residual; a pulse
is declared faulty where it exceeds a threshold, which is made from healthy pulses (eq. 4.2).

In the circuit the current is minus the capacitance times the rate of the voltage, whatever the fault: a
network that learned this perfectly would see none. What the residual shows is where a small network is wrong
away from healthy pulses. So there is a second form, without the voltage as an input: from the voltage that
the capacitor was charged to, the network tells the current of the whole healthy pulse.

Left out: thrust, which nobody measures in flight; a choice between causes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike

from thruster_agents.dynamic_neurons.files import (
    check_weights,
    number_of,
    read_description,
    read_weights,
    write_description,
    write_weights,
)
from thruster_agents.dynamic_neurons.networks import Architecture, SequenceNetwork, build_network
from thruster_agents.dynamic_neurons.training import TrainingRecord, TrainingSettings, train
from thruster_baselines.detection import residual_thresholds
from thruster_envs.configuration import coerce_fields, from_mapping, require, to_mapping
from thruster_envs.protocols import BoolArray, FloatArray

__all__ = ["LowLevelClassifier", "LowLevelSettings"]

_KIND = "low level"
#: Pulses that are predicted together.
_TOGETHER = 512
#: First samples of the voltage whose mean stands for the charge voltage, where none is given.
_CHARGED = 3


@dataclass(frozen=True, kw_only=True)
class LowLevelSettings:
    """What a low-level classifier is.

    Attributes:
        inputs: `voltage`: the voltage and the current of each sample, as in the source. `charge_voltage`: the
            voltage at the start, all along, and nothing measured later.
        architecture: Of the network; 10 dynamic neurons of order 2 by default.
        voltage_scale: V, what is 1 inside of the network.
        current_scale: A, likewise; residuals are in units of it.
        sensitivity: Of the threshold (1.15 in the source); see `residual_thresholds`.
        stride: Every so many samples are used, 1 for all.
    """

    inputs: Literal["voltage", "charge_voltage"] = "voltage"
    architecture: Architecture = field(default_factory=Architecture)
    voltage_scale: float = 1000.0
    current_scale: float = 12_000.0
    sensitivity: float = 1.15
    stride: int = 1

    def __post_init__(self) -> None:
        coerce_fields(self)
        for name, unit in (("voltage_scale", "V"), ("current_scale", "A")):
            value = getattr(self, name)
            require(0.0 < value < math.inf, name, value, f"a positive number of {unit}")
        require(0.0 <= self.sensitivity < math.inf, "sensitivity", self.sensitivity, "0 or more")
        require(self.stride >= 1, "stride", self.stride, "1 or more")


class LowLevelClassifier:
    """Declares pulses healthy or faulty, from voltage and current.

    Pulses are arrays (pulses, samples): the capacitor voltage in V and the discharge current in A, evenly
    sampled from ignition on, before which there is no current. `charge_voltage` is (pulses,) in V; where it
    is not given, the mean of the first three samples of the voltage stands for it.

    Args:
        settings: The source's by default.
        generator: Draws the parameters of the network.

    Attributes:
        settings: As given.
        network: What predicts.
        threshold: Of the residual, or None before `calibrate`.
    """

    def __init__(
        self, settings: LowLevelSettings | None = None, *, generator: torch.Generator | None = None
    ) -> None:
        self.settings = LowLevelSettings() if settings is None else settings
        inputs = 2 if self.settings.inputs == "voltage" else 1
        self.network: SequenceNetwork = build_network(self.settings.architecture, inputs, generator)
        self.threshold: float | None = None

    def train(
        self,
        voltage: ArrayLike,
        current: ArrayLike,
        *,
        charge_voltage: ArrayLike | None = None,
        training: TrainingSettings | None = None,
        checkpoint: Path | None = None,
        progress: Callable[[int, float], None] | None = None,
    ) -> TrainingRecord:
        """Train the network on healthy pulses; see `thruster_agents.dynamic_neurons.train`.

        A threshold that there was is forgotten.
        """
        outside, measured = self._signals(voltage, current, charge_voltage)
        inputs = outside
        if self.settings.inputs == "voltage":
            inputs = np.concatenate([outside, measured[:, :-1, np.newaxis]], axis=2)
        self.threshold = None
        return train(
            self.network, inputs, measured[:, 1:], training, checkpoint=checkpoint, progress=progress
        )

    def predict(
        self, voltage: ArrayLike, current: ArrayLike, *, charge_voltage: ArrayLike | None = None
    ) -> FloatArray:
        """(pulses, samples - 1), A: the current expected at each sample used but the first one."""
        outside, _ = self._signals(voltage, current, charge_voltage)
        return self.settings.current_scale * self._predict(outside)

    def residuals(
        self, voltage: ArrayLike, current: ArrayLike, *, charge_voltage: ArrayLike | None = None
    ) -> FloatArray:
        """(pulses,), mean absolute error of the current in units of `current_scale`."""
        outside, measured = self._signals(voltage, current, charge_voltage)
        return np.asarray(np.abs(measured[:, 1:] - self._predict(outside)).mean(axis=1))

    def threshold_from(
        self,
        voltage: ArrayLike,
        current: ArrayLike,
        *,
        charge_voltage: ArrayLike | None = None,
        false_alarms: float | None = None,
    ) -> float:
        """The threshold that healthy pulses give, by eq. 4.2 or for a rate of false alarms."""
        found = self.residuals(voltage, current, charge_voltage=charge_voltage)
        return float(residual_thresholds(found, self.settings.sensitivity, false_alarms))

    def calibrate(
        self,
        voltage: ArrayLike,
        current: ArrayLike,
        *,
        charge_voltage: ArrayLike | None = None,
        false_alarms: float | None = None,
    ) -> float:
        """Take the threshold of these healthy pulses, 120 in the source, none of which was trained on."""
        self.threshold = self.threshold_from(
            voltage, current, charge_voltage=charge_voltage, false_alarms=false_alarms
        )
        return self.threshold

    def declare(
        self, voltage: ArrayLike, current: ArrayLike, *, charge_voltage: ArrayLike | None = None
    ) -> BoolArray:
        """(pulses,), whether each is declared faulty.

        Raises:
            ValueError: There is no threshold yet, or signals that are none.
        """
        if self.threshold is None:
            raise ValueError("threshold is None; calibrate with healthy pulses first")
        return self.residuals(voltage, current, charge_voltage=charge_voltage) > self.threshold

    def save(self, folder: str | Path) -> None:
        """Write settings, threshold and network into a folder; see `files`."""
        write_weights(Path(folder), {"network": self.network})
        content = {"settings": to_mapping(self.settings), "threshold": self.threshold}
        write_description(Path(folder), _KIND, content)

    @classmethod
    def load(cls, folder: str | Path) -> LowLevelClassifier:
        """What `save` left.

        Raises:
            ValueError: A file that is missing or is not that of a low-level classifier.
        """
        content = read_description(Path(folder), _KIND, ("settings", "threshold"))
        settings = from_mapping(LowLevelSettings, content["settings"], f"{folder}: settings")
        check_weights(Path(folder), settings.architecture, ("network",), lambda: cls(settings).network)
        classifier = cls(settings)
        read_weights(Path(folder), {"network": classifier.network})
        if content["threshold"] is not None:
            classifier.threshold = number_of(content["threshold"], f"{folder}: threshold")
        return classifier

    def _predict(self, outside: FloatArray) -> FloatArray:
        """(pulses, samples - 1), in units of `current_scale`, on its own output where it sees a current."""
        run = self.network.predict_in_parallel if self.settings.inputs == "voltage" else self.network.predict
        parts = [run(outside[i : i + _TOGETHER]) for i in range(0, len(outside), _TOGETHER)]
        return np.concatenate(parts) if parts else np.empty(outside.shape[:2])

    def _signals(
        self, voltage: ArrayLike, current: ArrayLike, charge_voltage: ArrayLike | None
    ) -> tuple[FloatArray, FloatArray]:
        """What the network sees but the current (pulses, samples - 1, 1), and the current, both scaled."""
        v, i = np.asarray(voltage, np.float64), np.asarray(current, np.float64)
        if v.ndim != 2 or v.shape != i.shape or v.shape[1] <= self.settings.stride:
            few = self.settings.stride
            raise ValueError(
                f"voltage has the shape {v.shape} and current {i.shape}; (pulses, samples) for both, more "
                f"than {few} samples, would be right"
            )
        for name, signal in (("voltage", v), ("current", i)):
            if not np.isfinite(signal).all():
                raise ValueError(f"{name} has an entry that is not finite")
        measured = i[:, :: self.settings.stride] / self.settings.current_scale
        if self.settings.inputs == "voltage":
            seen = v[:, :: self.settings.stride][:, :-1]
        else:
            charged = v[:, :_CHARGED].mean(axis=1) if charge_voltage is None else charge_voltage
            charged = np.asarray(charged, np.float64)
            if charged.shape != v.shape[:1]:
                raise ValueError(
                    f"charge_voltage has the shape {charged.shape}; {v.shape[:1]} would be right"
                )
            seen = np.repeat(charged[:, np.newaxis], measured.shape[1] - 1, axis=1)
        return (seen / self.settings.voltage_scale)[..., np.newaxis], measured
