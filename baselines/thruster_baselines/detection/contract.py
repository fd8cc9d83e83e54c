"""One contract for all detectors: what each is given (`Telemetry`) and what it answers (`Verdict`).

A detector of rate changes, one that is fed by navigation, one of the pulses of plasma thrusters and a network
look at different parts of the same telemetry of a control period. So one evaluation
(`thruster_baselines.detection.evaluate`) measures all of them, and one table holds them.

The forms of `thruster_envs.protocols`, whose `update` takes these parts as separate arrays, go on working:
detectors of this package take either, and `reader_of` feeds a detector that takes arrays only.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs import protocols
from thruster_envs.protocols import BoolArray, Diagnosis, FloatArray

__all__ = ["AnyDetector", "Detector", "Telemetry", "Verdict", "check_alone", "reader_of"]


class Telemetry(NamedTuple):
    """What flight software sees of a batch of vehicles in one control period; None for what they do not have.

    Attributes:
        duration: Of the period, s.
        on_times: (vehicles, n), s, commanded in the period; or give `duties`.
        duties: (vehicles, n), 0..1, the same as shares of the period.
        rate_change: (vehicles, m), m/s then rad/s, body axes: measured over the period, motion without thrust
            taken off.
        expected_change: (vehicles, m): the same, as the nominal vehicle would have given it.
        position: (vehicles, 3), m, LVLH, measured.
        attitude: (vehicles, 4), scalar first, measured: body from LVLH, or from the leader's axes in a
            formation.
        rate: (vehicles, 3), rad/s, body axes, measured.
        target: (vehicles, 4), attitude that is asked for.
        turning: (vehicles, 2, 3), rad/s, body axes: measured rate against LVLH at the start and at the end of
            the period; with it the turning of thrust is taken off the rate change.
        valid: (vehicles,), where there is a measurement; everywhere by default.
        age: (vehicles,), s: how much older than the end of the period the measurement is; 0 by default.
        pulses: (vehicles, pairs): 1 where the first of a pair of opposite thrusters gave a pulse, -1 where
            the second did, 0 for none.
        voltage: (vehicles, pairs, samples), V, of those pulses; anything where there is none.
        current: (vehicles, pairs, samples), A, likewise.
        observation: (vehicles, size), of the environment at the end of the period.
        velocity: (vehicles, 3), m/s, LVLH, measured.
    """

    duration: float
    on_times: ArrayLike | None = None
    duties: ArrayLike | None = None
    rate_change: ArrayLike | None = None
    expected_change: ArrayLike | None = None
    position: ArrayLike | None = None
    attitude: ArrayLike | None = None
    rate: ArrayLike | None = None
    target: ArrayLike | None = None
    turning: ArrayLike | None = None
    valid: ArrayLike | None = None
    age: ArrayLike | None = None
    pulses: ArrayLike | None = None
    voltage: ArrayLike | None = None
    current: ArrayLike | None = None
    observation: NDArray[np.float32] | None = None
    velocity: ArrayLike | None = None

    def need(self, name: str) -> Any:
        """A field that a detector cannot do without; `on_times` and `duties` follow from each other.

        Raises:
            ValueError: It is None.

        >>> Telemetry(5.0, duties=[[0.2]]).need("on_times")
        array([[1.]])
        """
        value = getattr(self, name)
        if value is None and name == "on_times" and self.duties is not None:
            value = np.asarray(self.duties, np.float64) * self.duration
        if value is None and name == "duties" and self.on_times is not None:
            value = np.asarray(self.on_times, np.float64) / self.duration
        if value is None:
            raise ValueError(f"telemetry must have {name}, got None")
        return value


def check_alone(**others: object) -> None:
    """Refuse arguments beside telemetry, which has all of them; None was not given.

    Raises:
        TypeError: One of them was given.
    """
    for name, value in others.items():
        if value is not None:
            raise TypeError(f"update must have telemetry alone, got {name} beside it")


@dataclass(frozen=True, slots=True)
class Verdict(Diagnosis):
    """What a detector says of each vehicle after one control period.

    Attributes:
        detected: (vehicles,), whether there is an alarm.
        thruster: (vehicles,), the isolated one, from 1; 0 without an alarm, or where it cannot be told.
        statistic: (vehicles,), test statistic that is compared with the threshold; 0 without a measurement.
        time: (vehicles,), s since the last reset, at the end of the period.
        suspicion: (vehicles, n), test statistic of each thruster; zeros where the method has none.
        shortfall: (vehicles, n), s, on-time deficit of each thruster if it is the faulty one; negative for
            thrust that was not commanded; zeros where the method has none.
        kind: (vehicles,), kind of fault as in `thruster_envs.faults`; empty where the method cannot tell.
        mismatch: (vehicles,), the parameter of the model that does not fit
            (`thruster_baselines.detection.mismatch`); empty for none, or where nobody looks.
        sensor: (vehicles,), the isolated sensor; empty where it is a thruster, or where it cannot be told.
        candidates: (vehicles, n), thrusters of which none can be told from the isolated one by what was
            seen so far; by default that one alone.
    """

    kind: tuple[str, ...] = ()
    mismatch: tuple[str, ...] = ()
    sensor: tuple[str, ...] = ()
    candidates: BoolArray | None = None

    def __post_init__(self) -> None:
        for name in ("kind", "mismatch", "sensor"):
            if not getattr(self, name):
                object.__setattr__(self, name, ("",) * self.detected.size)
        if self.candidates is None:
            alone = np.arange(1, self.suspicion.shape[1] + 1) == self.thruster[:, np.newaxis]
            object.__setattr__(self, "candidates", alone)

    @property
    def thruster_statistics(self) -> FloatArray:
        """(vehicles, n), test statistic of each thruster: `suspicion`."""
        return self.suspicion

    @property
    def on_time_deficit(self) -> FloatArray:
        """(vehicles, n), s: `shortfall`."""
        return self.shortfall


@runtime_checkable
class Detector(Protocol):
    """Monitors a batch of vehicles, control period by control period.

    Attributes:
        threshold: Alarm threshold on the test statistic; may be changed at any time.
    """

    threshold: float

    def update(self, telemetry: Telemetry, /) -> Diagnosis:
        """Take in one control period.

        Raises:
            ValueError: Telemetry without what this detector looks at.
        """
        ...

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Restart with nominal thrusters, in the vehicles of a mask (vehicles,) or in all of them."""
        ...


AnyDetector: TypeAlias = Detector | protocols.Detector | protocols.NavigationDetector
"""By the one contract, or one whose `update` takes arrays."""


def reader_of(detector: Any) -> Callable[[Telemetry], Diagnosis]:
    """How a detector takes in telemetry, also one whose `update` takes arrays by the names of its fields."""
    update = detector.update
    parameters = inspect.signature(update).parameters
    required = [one for one in parameters.values() if one.default is one.empty]
    if len(required) <= 1:
        return update  # type: ignore[no-any-return]
    fields = {name: "duties" if name == "open_rates" else name for name in parameters}
    fields = {name: field for name, field in fields.items() if field in Telemetry._fields}

    def update_by_name(telemetry: Telemetry) -> Diagnosis:
        needed = {one.name for one in required}
        answer: Diagnosis = update(
            **{
                name: telemetry.need(field) if name in needed else getattr(telemetry, field)
                for name, field in fields.items()
            }
        )
        return answer

    return update_by_name
