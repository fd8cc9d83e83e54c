"""Flights of an environment, for the yardstick of detectors: a craft under a pilot, in all six axes.

Where `RandomFlights` fires at random, here the commands are those of somebody who flies: of the scripted
pilot of `FaultDiagnosis-v1`, of a policy, of a user's pilot. So the craft turns, is pulled by the orbit's
tide, has valve delays and shortest pulses, and a fault changes what is commanded after it. What a detector
gets stands in the observation: the duties of the last period and the rate change that was measured in it.

Left out: environments in which several craft fail. What is measured after a flight is lost counts as missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from thruster_baselines.detection.flights import Flights, faults_of, joined, one_fault_each, truth_of
from thruster_envs.faults import FaultDistribution
from thruster_envs.observations import Reader
from thruster_envs.protocols import FloatArray
from thruster_envs.rollout import fly
from thruster_envs.spacecraft import Spacecraft

__all__ = ["EnvironmentFlights", "ObservedFiring", "Policy"]

Policy: TypeAlias = Callable[[NDArray[np.float32]], Any]
"""Actions (worlds, ...) from observations (worlds, size)."""


class ObservedFiring:
    """Reads what was fired, and what it gave, from the observations of an environment.

    Args:
        environment: A Gymnasium or vector environment of this suite.

    Attributes:
        spacecraft: That flies there.
        duration: Of a control period, s.

    Raises:
        ValueError: An environment that does not show them.
    """

    def __init__(self, environment: Any) -> None:
        self.spacecraft: Spacecraft = _task_of(environment).vehicle
        self.duration: float = self.spacecraft.control_period
        self._read = reader_with(environment, "duties", "measured_change")

    def __call__(self, observations: NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
        """On-times (worlds, n), s, and rate change (worlds, 6), m/s then rad/s, of the last period.

        Args:
            observations: (worlds, size).

        Raises:
            ValueError: Observations of another shape.
        """
        seen = np.asarray(observations, dtype=np.float64)
        if seen.ndim != 2 or seen.shape[1] < self._read.columns("measured_change").stop:
            raise ValueError(
                f"observations has the shape {seen.shape}; (worlds, size), a row for each world, would be "
                "right"
            )
        reading = self._read(seen)
        return reading.duties * self.duration, reading.measured_change

    def turning(self, before: NDArray[np.float32], after: NDArray[np.float32]) -> FloatArray | None:
        """(worlds, 2, 3), rad/s, body axes: rate against LVLH at the start and the end of a period.

        Args:
            before: (worlds, size), the observations at its start.
            after: (worlds, size), at its end.

        Returns:
            None where an observation has no rate.
        """
        if "rate_error" not in self._read:
            return None
        rates = [self._read(np.asarray(one, np.float64)).rate_error for one in (before, after)]
        return np.stack(rates, axis=1)


def reader_with(environment: Any, *names: str) -> Reader:
    """The reader of an environment of this suite, whose observation has fields of these names.

    Raises:
        ValueError: An environment of which the observation has no such field.
    """
    task, reader = _task_of(environment), Reader.of(environment)
    for name in names:
        if name not in reader:
            raise ValueError(
                f"the observation of {type(task).__name__} has no {name!r}; an environment with the fields "
                f"{', '.join(repr(one) for one in names)} would be right"
            )
    return reader


def _task_of(environment: Any) -> Any:
    """What is flown in an environment of this suite."""
    task = getattr(environment.unwrapped, "task", None)
    if task is None:
        raise ValueError(f"environment is {environment}; one of this suite would be right")
    return task


@dataclass(frozen=True, kw_only=True)
class EnvironmentFlights:
    """Flights of an environment of this suite.

    Attributes:
        environment: Its id.
        arguments: Of its constructor, but for the faults.
        faults: What fails in a faulty flight. Exactly one fault strikes, whatever its `probability` and
            `count`. By default a dead thruster, from the end of some period of the first half of a flight on.
        policy: Who acts. By default nobody does, which is for environments that fly by themselves: no fault
            is declared, and nothing tested.
        periods: In a flight; by default as many as the environment's time limit.
        worlds: How many fly side by side; results do not depend on it.
        observed: Whether the flights hold the observations, for players (`PlayerDetector`).

    Raises:
        ValueError: A value that cannot be.

    >>> flights = EnvironmentFlights(periods=20)(range(3), faulty=True)
    >>> flights.on_times.shape, flights.duration, flights.kind
    ((3, 20, 12), 5.0, ('stuck_off', 'stuck_off', 'stuck_off'))
    """

    environment: str = "thruster_envs/FaultDiagnosis-v1"
    arguments: Mapping[str, Any] = field(default_factory=dict)
    faults: FaultDistribution = field(
        default_factory=lambda: FaultDistribution(kinds=("stuck_off",), onset=(0.0, 300.0), onset_grid=5.0)
    )
    policy: Policy | None = None
    periods: int | None = None
    worlds: int = 500
    observed: bool = False

    def __post_init__(self) -> None:
        for name in ("periods", "worlds"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} is {value}; one or more would be right")
        one_fault_each(self.faults)
        if "faults" in self.arguments:
            raise ValueError("arguments has 'faults'; the field `faults` of these flights would be right")

    def __call__(self, seeds: Sequence[int], faulty: bool) -> Flights:
        """One flight for each seed.

        Raises:
            ValueError: An environment that takes no faults, that has several craft, that has no end where
                `periods` is not given, that does not fly by itself where there is no policy, or that does not
                show what was fired.
        """
        parts = [
            self._fly(seeds[first : first + self.worlds], faulty)
            for first in range(0, len(seeds), self.worlds)
        ]
        return joined(parts)

    def _fly(self, seeds: Sequence[int], faulty: bool) -> Flights:
        """One flight for each seed, side by side."""
        try:
            env = gym.make_vec(
                self.environment, num_envs=len(seeds), vectorization_mode="vector_entry_point",
                autoreset_mode=gym.vector.AutoresetMode.DISABLED,
                faults=one_fault_each(self.faults) if faulty else [], **self.arguments,
            )  # fmt: skip
        except TypeError as error:
            if not any(f"'{own}'" in str(error) for own in ("autoreset_mode", "faults")):
                raise
            raise ValueError(
                f"environment is {self.environment!r}, which takes no faults; one of this suite would be "
                "right"
            ) from None
        task: Any = env.unwrapped.task  # type: ignore[attr-defined]
        if task.number_of_craft > 1:
            raise ValueError(
                f"{self.environment} has {task.number_of_craft} craft; an environment of one would be right"
            )
        periods = self.periods or task.max_episode_steps
        if periods is None:
            raise ValueError(f"periods is None, and {self.environment} has no end; a number would be right")
        if self.policy is None and task.choices is None:
            raise ValueError(
                f"policy is None, and {self.environment} does not fly by itself; one would be right"
            )
        flown = fly(
            env, self.policy or "idle", seeds, steps=periods, past_end=True,
            record=("observation", "terminated"),
        )  # fmt: skip
        read, n = ObservedFiring(env), task.vehicle.number_of_thrusters
        env.close()
        observed = flown.padded("observation")
        seen = observed[:, 1:]
        on_times, rate_change = read(seen.reshape(-1, seen.shape[-1]))
        turning = read.turning(*(one.reshape(-1, seen.shape[-1]) for one in (observed[:, :-1], seen)))
        lost = np.logical_or.accumulate(flown.padded("terminated"), axis=1)
        return Flights(
            on_times=on_times.reshape(len(seeds), periods, n),
            rate_change=rate_change.reshape(len(seeds), periods, 6),
            valid=~np.pad(lost[:, :-1], ((0, 0), (1, 0))),
            duration=read.duration,
            **truth_of(faults_of(self.faults, n, seeds, faulty)),
            turning=None if turning is None else turning.reshape(len(seeds), periods, 2, 3),
            observations=seen if self.observed else None,
        )
