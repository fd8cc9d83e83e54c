"""The high level: three networks that know how a healthy craft turns when its thrusters fire.

After Valdes 2008, chapter 5. For roll, pitch and yaw, a network predicts the rate about that axis one second
ahead from the pulses about it and the attitude. The sum of absolute errors over the part of a mission when
the craft should have settled is the residual of the pair of thrusters that turns it about that axis; a pair
is declared faulty where it exceeds a threshold, which is made from healthy missions (eq. 5.3). This is known
after the mission, for the pair only.

Attitudes and their changes follow from rates, whatever the fault: a fault shows in what pulses do to rates,
and nowhere else. Attitudes that no mission of the training had are constants that the network never saw. So
besides the attitude itself (the source) the networks can see its error from the target, its change in the
last second, or nothing of it.

Left out: the thruster and the direction of a change (`integrated` has them), missions that are not over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch

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
from thruster_baselines.control.quaternions import product
from thruster_baselines.detection import residual_thresholds
from thruster_envs.configuration import coerce_fields, from_mapping, require, to_mapping
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from thruster_envs.missions import Missions

__all__ = ["AXES", "HighLevelClassifier", "HighLevelSettings", "MissionSignals"]

#: Axes of the three networks; thrusters 2 i + 1 and 2 i + 2 turn about axis i, one each way.
AXES = ("roll", "pitch", "yaw")
_KIND = "high level"
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class MissionSignals:
    """What the attitude control of one craft saw, in one mission or several of the same length.

    Attributes:
        pulses: (missions, steps, 3), 1 for a pulse about the axis in that period, -1 against it, 0 for none.
        attitude: (missions, steps + 1, 4), relative quaternion at the start of each period, and at the end.
        rate: (missions, steps + 1, 3), rad/s, relative rate.
        target: (missions, 4), attitude asked for; only the input `error` needs it.

    Raises:
        ValueError: Shapes that do not belong together, or numbers that are not finite.
    """

    pulses: FloatArray
    attitude: FloatArray
    rate: FloatArray
    target: FloatArray | None = None

    def __post_init__(self) -> None:
        pulses = np.asarray(self.pulses, np.float64)
        if pulses.ndim != 3 or pulses.shape[2] != 3:
            raise ValueError(f"pulses has the shape {pulses.shape}; (missions, steps, 3) would be right")
        missions, steps, _ = pulses.shape
        right = {
            "attitude": (missions, steps + 1, 4),
            "rate": (missions, steps + 1, 3),
            "target": (missions, 4),
        }
        object.__setattr__(self, "pulses", pulses)
        for name, shape in right.items():
            if getattr(self, name) is None and name == "target":
                continue
            value = np.asarray(getattr(self, name), np.float64)
            if value.shape != shape:
                raise ValueError(f"{name} has the shape {value.shape}; {shape} would be right")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} has an entry that is not finite")
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, missions: Missions, craft: int, *, measured: bool = True) -> MissionSignals:
        """Those of one craft, from 0 for the leader, as measured or as they truly were."""
        prefix = "measured_" if measured else ""
        return cls(
            pulses=np.asarray(missions.pulses[:, :, craft], np.float64),
            attitude=getattr(missions, f"{prefix}attitude")[:, :, craft],
            rate=getattr(missions, f"{prefix}rate")[:, :, craft],
            target=missions.targets[:, craft],
        )

    def firings(self, mission: int = 0) -> tuple[IntArray, IntArray]:
        """What fired in a mission: thrusters (firings,), from 0, and their periods (firings,), in order."""
        steps, axes = np.nonzero(self.pulses[mission])
        return 2 * axes + (self.pulses[mission, steps, axes] < 0.0), steps

    def __len__(self) -> int:
        return len(self.pulses)

    def __getitem__(self, which: slice | Sequence[int]) -> MissionSignals:
        """Some of the missions."""
        target = None if self.target is None else self.target[which]
        return MissionSignals(self.pulses[which], self.attitude[which], self.rate[which], target)

    def __add__(self, other: MissionSignals) -> MissionSignals:
        """The missions of both."""
        targets = [one.target for one in (self, other) if one.target is not None]
        return MissionSignals(
            np.concatenate([self.pulses, other.pulses]),
            np.concatenate([self.attitude, other.attitude]),
            np.concatenate([self.rate, other.rate]),
            np.concatenate(targets) if len(targets) == 2 else None,
        )


@dataclass(frozen=True, kw_only=True)
class HighLevelSettings:
    """What a high-level classifier is.

    Attributes:
        attitude: What the networks see of it beside the pulses about their axis: the vector part of the
            relative quaternion (`quaternion`, the source), of its error from the target (`error`), its change
            since the last second (`increment`), or nothing (`none`).
        architecture: Of the three networks; 10 dynamic neurons of order 2 by default.
        rate_scale: Rad/s, what is 1 inside of the networks; residuals are in units of it.
        window: First and last second that the residual counts.
        sensitivity: Of the thresholds of roll, pitch and yaw; see `residual_thresholds`.
    """

    attitude: Literal["quaternion", "error", "increment", "none"] = "quaternion"
    architecture: Architecture = field(default_factory=Architecture)
    rate_scale: float = 2.6e-3
    window: tuple[int, int] = (1000, 3000)
    sensitivity: tuple[float, float, float] = (1.208, 2.450, 1.032)

    def __post_init__(self) -> None:
        coerce_fields(self)
        require(0.0 < self.rate_scale < math.inf, "rate_scale", self.rate_scale, "a positive number of rad/s")
        require(1 <= self.window[0] <= self.window[1], "window", self.window, "two seconds, 1 or later")
        fine = all(0.0 <= one < math.inf for one in self.sensitivity)
        require(fine, "sensitivity", self.sensitivity, "three numbers, 0 or more")


class HighLevelClassifier:
    """Declares pairs of thrusters healthy or faulty, from pulses, attitudes and rates of a mission.

    Args:
        settings: The source's by default.
        generator: Draws the parameters of the networks.

    Attributes:
        settings: As given.
        networks: For roll, pitch and yaw.
        thresholds: (3,), of their residuals, or None before `calibrate`.
    """

    def __init__(
        self, settings: HighLevelSettings | None = None, *, generator: torch.Generator | None = None
    ) -> None:
        self.settings = HighLevelSettings() if settings is None else settings
        inputs = 1 if self.settings.attitude == "none" else 4
        self.networks: tuple[SequenceNetwork, ...] = tuple(
            build_network(self.settings.architecture, inputs, generator) for _ in AXES
        )
        self.thresholds: FloatArray | None = None

    def train(
        self,
        missions: MissionSignals,
        *,
        training: TrainingSettings | None = None,
        checkpoints: Path | None = None,
        progress: Callable[[str, int, float], None] | None = None,
    ) -> tuple[TrainingRecord, ...]:
        """Train the networks on healthy missions, one after the other; see `train`.

        The wider the targets of the missions are spread, the less is new to the networks later: the source
        has three, random ones serve as well. Thresholds that there were are forgotten.

        Args:
            missions: Healthy ones, whole.
            training: As for `train`.
            checkpoints: Folder for the checkpoints of the three trainings.
            progress: Called with axis, step and mean square error.
        """
        self.thresholds = None
        records = []
        for axis, name in enumerate(AXES):
            if checkpoints is not None:
                checkpoints.mkdir(parents=True, exist_ok=True)

            def tell(step: int, error: float, name: str = name) -> None:
                if progress is not None:
                    progress(name, step, error)

            records.append(
                train(
                    self.networks[axis],
                    self._inputs(missions, axis),
                    missions.rate[:, 1:, axis] / self.settings.rate_scale,
                    training,
                    checkpoint=None if checkpoints is None else checkpoints / f"{name}.pt",
                    progress=tell,
                )
            )
        return tuple(records)

    def predict(self, missions: MissionSignals) -> FloatArray:
        """(missions, steps, 3), rad/s: the rates expected after each period."""
        parts = [network.predict(self._inputs(missions, axis)) for axis, network in enumerate(self.networks)]
        return self.settings.rate_scale * np.stack(parts, axis=2)

    def residuals(self, missions: MissionSignals) -> FloatArray:
        """(missions, 3), sums of absolute errors over the window, in units of `rate_scale`.

        Raises:
            ValueError: Missions that end before the window does.
        """
        first, last = self.settings.window
        steps = missions.pulses.shape[1]
        if steps < last:
            raise ValueError(
                f"the missions have {steps} steps; {last} or more, as the window has, would be right"
            )
        errors = np.abs(missions.rate[:, 1:] - self.predict(missions)) / self.settings.rate_scale
        return np.asarray(errors[:, first - 1 : last].sum(axis=1))

    def calibrate(self, missions: MissionSignals, *, false_alarms: float | None = None) -> FloatArray:
        """Take the thresholds (3,) of these healthy missions, by eq. 5.3 or for a rate of false alarms.

        The source takes those of training and of validation together.
        """
        self.thresholds = residual_thresholds(
            self.residuals(missions), self.settings.sensitivity, false_alarms
        )
        return self.thresholds

    def declare(self, missions: MissionSignals) -> BoolArray:
        """(missions, 3), whether each pair is declared faulty.

        Raises:
            ValueError: There are no thresholds yet, or missions that are too short.
        """
        if self.thresholds is None:
            raise ValueError("thresholds is None; calibrate with healthy missions first")
        return np.asarray(self.residuals(missions) > self.thresholds)

    def save(self, folder: str | Path) -> None:
        """Write settings, thresholds and networks into a folder; see `files`."""
        write_weights(Path(folder), dict(zip(AXES, self.networks, strict=True)))
        thresholds = None if self.thresholds is None else self.thresholds.tolist()
        content = {"settings": to_mapping(self.settings), "thresholds": thresholds}
        write_description(Path(folder), _KIND, content)

    @classmethod
    def load(cls, folder: str | Path) -> HighLevelClassifier:
        """What `save` left.

        Raises:
            ValueError: A file that is missing or is not that of a high-level classifier.
        """
        content = read_description(Path(folder), _KIND, ("settings", "thresholds"))
        settings = from_mapping(HighLevelSettings, content["settings"], f"{folder}: settings")
        check_weights(Path(folder), settings.architecture, AXES, lambda: cls(settings).networks[0])
        classifier = cls(settings)
        read_weights(Path(folder), dict(zip(AXES, classifier.networks, strict=True)))
        if content["thresholds"] is not None:
            classifier.thresholds = _three(content["thresholds"], f"{folder}: thresholds")
        return classifier

    def _inputs(self, missions: MissionSignals, axis: int) -> FloatArray:
        """(missions, steps, inputs): pulses about the axis, then what is seen of the attitude."""
        seen = missions.pulses[..., axis : axis + 1]
        attitude = missions.attitude[:, :-1]
        if self.settings.attitude == "none":
            return seen
        if self.settings.attitude == "error":
            attitude = _errors(attitude, missions.target)
        if self.settings.attitude == "increment":
            change = np.diff(attitude, axis=1, prepend=attitude[:, :1])
            attitude = 2.0 * change / self.settings.rate_scale  # a rate, as what is to be predicted
        return np.concatenate([seen, attitude[..., 1:]], axis=2)


def _errors(attitude: FloatArray, target: FloatArray | None) -> FloatArray:
    """(missions, steps, 4): what turns the target into the attitude, scalar part not negative."""
    if target is None:
        raise ValueError("target is None; the attitude asked for in each mission would be right")
    errors = np.empty_like(attitude)
    for error, seen, wanted in zip(errors, attitude, target, strict=True):
        # seen * conj(wanted) is the conjugate of wanted * conj(seen), which is one matrix times all samples.
        error[:] = _CONJUGATE * product(wanted, (_CONJUGATE * seen).T).T
    return np.asarray(np.where(errors[..., :1] < 0.0, -errors, errors))


def _three(values: object, where: str) -> FloatArray:
    numbers = values if isinstance(values, list) else []
    if len(numbers) != 3 or not all(type(one) in (int, float) for one in numbers):
        raise ValueError(f"{where} is {values!r}; three numbers would be right")
    return np.array([number_of(one, where) for one in numbers])
