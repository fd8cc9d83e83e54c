"""Any detector as a player of the diagnosis tasks, and any player as a detector.

`DetectorPlayer`: after the detector's first alarm the likeliest thruster and kind are declared, by sums over
all periods of the log-likelihood ratio of each model (Yang 2003, section 5.3.1) that restart at zero (Page
1954), until none is twenty times as likely as no fault. The prior of a kind is shared by its models. In
`ActiveDiagnosis-v1` it fires the shortest test pulse of one thruster after the other.

`PlayerDetector`: what a policy for `FaultDiagnosis-v1` declares in recorded flights is an alarm. There is no
threshold to sweep; one that alarms more often than stated gets a threshold that it never exceeds.

Left out: several faulty thrusters, faults that heal, that a wrong name costs more than a late one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.contract import Telemetry, Verdict, check_alone
from thruster_baselines.detection.cusum import CUSUMDetector
from thruster_baselines.detection.environment_flights import ObservedFiring, reader_with
from thruster_baselines.detection.identification import ModelComparison
from thruster_envs.faults import mode_of
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["DetectorPlayer", "PlayerDetector"]


class DetectorPlayer:
    """Plays `FaultDiagnosis-v1` or `ActiveDiagnosis-v1` with a detector and a model comparison.

    It sees observations only. A world whose observation says that an episode begins is begun anew.

    Args:
        environment: That is played, for what stands where in its observation.
        make: Builds a detector for so many vehicles, threshold included; by default cumulative sums
            (`CUSUMDetector`) that alarm in one of 10,000 healthy periods or fewer, where a body does not turn
            far in a period: at 30 s Orion turns too far for the model, and one in 30 is an alarm.
        comparison: Of the models of a fault; by default four sizes of a loss, five openings, two tilts to
            eight sides.
        worlds: How many are played; by default as many as the vector environment has, and one of a single
            environment, whose observation goes in as `observation[np.newaxis]`.

    Raises:
        ValueError: An environment that is no diagnosis task.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make_vec(
    ...     "thruster_envs/FaultDiagnosis-v1",
    ...     num_envs=3,
    ...     vectorization_mode="vector_entry_point",
    ...     faults=[{"thruster": 7, "kind": "stuck_off"}],
    ... )
    >>> player = DetectorPlayer(env)
    >>> observations, _ = env.reset(seed=0)
    >>> for _ in range(20):
    ...     observations, *_ = env.step(player(observations))
    >>> player(observations).tolist()  # thruster 7, mode 0: dead
    [[7, 0], [7, 0], [7, 0]]
    """

    def __init__(
        self,
        environment: Any,
        make: Callable[[int], BaseDetector] | None = None,
        comparison: ModelComparison | None = None,
        worlds: int | None = None,
    ) -> None:
        worlds = getattr(environment, "num_envs", 1) if worlds is None else worlds
        self._reader = reader_with(environment, "time", *_DECLARED)
        self._entries = len(environment.unwrapped.task.choices)
        self._read = ObservedFiring(environment)
        spacecraft = self._read.spacecraft
        n = spacecraft.number_of_thrusters
        self.detector = _sums(spacecraft, worlds) if make is None else make(worlds)
        self.comparison = _models(spacecraft) if comparison is None else comparison
        kinds = [kind for kind, _ in self.comparison.models]
        self._prior = -np.log([float(kinds.count(kind)) for kind in kinds])
        self._modes = np.array(
            [0 if kind == "none" else mode_of(kind, size) for kind, size in self.comparison.models]
        )
        self._sums: FloatArray = np.zeros((worlds, n, len(kinds)))
        self._alarmed = np.zeros(worlds, np.bool_)
        self._calls: IntArray = np.zeros(worlds, np.int64)
        self._before: NDArray[np.float32] | None = None

    def __call__(self, observations: NDArray[np.float32]) -> IntArray:
        """Actions (worlds, entries): thruster, mode, and where there are tests the pulse of each thruster.

        Args:
            observations: (worlds, size).

        Raises:
            ValueError: Observations of another shape.
        """
        on_times, rate_change = self._read(observations)
        begins = self._reader(observations).time[:, 0] == 0.0
        turning = self._read.turning(observations if self._before is None else self._before, observations)
        diagnosis = self.detector.update(
            on_times, rate_change, self._read.duration, valid=~begins, turning=turning
        )
        self._alarmed |= diagnosis.detected
        self._add_up()
        if begins.any():
            self.reset(begins)
        self._before = np.array(observations)
        return self._actions()

    def reset(self, worlds: NDArray[np.bool_] | None = None) -> None:
        """Begin anew, in the worlds of a mask (worlds,) or in all of them."""
        where = slice(None) if worlds is None else worlds
        self.detector.reset(worlds)
        self._sums[where], self._alarmed[where], self._calls[where] = 0.0, False, 0
        if worlds is None or worlds.all():
            self._before = None

    def _add_up(self) -> None:
        interval = self.detector.last
        assert interval is not None
        worlds, n, _ = self._sums.shape
        for i in range(n):
            statistic = self.comparison(interval, np.full(worlds, i + 1)).statistic
            gain = np.where(np.isfinite(statistic), 0.5 * (statistic[:, :1] - statistic), 0.0)
            self._sums[:, i] = np.maximum(self._sums[:, i] + gain, 0.0)

    def _actions(self) -> IntArray:
        worlds, n, models = self._sums.shape
        evidence = (self._sums + self._prior).reshape(worlds, -1)
        likeliest = evidence.argmax(axis=1)
        self._alarmed &= evidence.max(axis=1) >= _LEAST_EVIDENCE
        thruster, model = likeliest // models, likeliest % models
        actions = np.zeros((worlds, self._entries), np.int64)
        declares = self._alarmed & (model > 0)
        actions[declares, 0] = thruster[declares] + 1
        actions[declares, 1] = self._modes[model[declares]]
        if self._entries > 2:
            actions[:, 2:] = np.arange(n) == (self._calls % n)[:, np.newaxis]
        self._calls += 1
        return actions


class PlayerDetector:
    """A player of `FaultDiagnosis-v1` behind the `Detector` protocol.

    What it declared last stands in the observation that it is shown, as in the environment.

    Args:
        environment: For what stands where in its observation.
        player: Actions (vehicles, 2 or more) from observations (vehicles, size): thruster and mode first. If
            it remembers anything, it has to have a `reset` like that of `DetectorPlayer`.
        vehicles: How many it watches.

    Attributes:
        threshold: To be exceeded by 1 where a thruster is declared, and by 0 elsewhere.
        declared: (vehicles, 2), thruster, from 1, or 0 for none, and mode, of the last update.

    Raises:
        ValueError: An environment that is no diagnosis task.
    """

    def __init__(self, environment: Any, player: Callable[[NDArray[np.float32]], Any], vehicles: int) -> None:
        reader = reader_with(environment, *_DECLARED)
        self._thrusters, self._modes = (reader.columns(name) for name in _DECLARED)
        self._player = player
        self.threshold = 0.5
        self.declared: IntArray = np.zeros((vehicles, 2), np.int64)
        self.time: FloatArray = np.zeros(vehicles)

    def update(
        self,
        on_times: Telemetry | ArrayLike,
        rate_change: ArrayLike | None = None,
        duration: float = 0.0,
        *,
        valid: ArrayLike | None = None,
        age: ArrayLike | None = None,
        observation: NDArray[np.float32] | None = None,
    ) -> Verdict:
        """Take in one interval, as it was observed.

        Args:
            on_times: `Telemetry` with all of it, or (vehicles, n), s.
            rate_change: (vehicles, m); not looked at, it stands in the observation.
            duration: s.
            valid: (vehicles,), where the observation counts.
            age: (vehicles,); not looked at, an environment's measurements are never late.
            observation: (vehicles, size), of the environment at the end of the interval.

        Raises:
            ValueError: No observation.
            TypeError: Arguments beside telemetry.
        """
        if isinstance(on_times, Telemetry):
            told = on_times
            check_alone(
                rate_change=rate_change, duration=duration or None, valid=valid, age=age,
                observation=observation,
            )  # fmt: skip
            on_times, duration = told.need("on_times"), told.duration
            valid, observation = told.valid, told.observation
        if observation is None:
            raise ValueError(
                "observation is None; flights that hold them (EnvironmentFlights(observed=True)) would be "
                "right"
            )
        seen = np.array(observation, dtype=np.float32)
        for k, columns in enumerate((self._thrusters, self._modes)):
            numbers = self.declared[:, k] - (1 if k == 0 else 0)
            shown = np.arange(columns.stop - columns.start) == numbers[:, np.newaxis]
            seen[:, columns] = shown & (self.declared[:, :1] > 0)
        self.declared = np.array(self._player(seen), dtype=np.int64)[:, :2]
        self.time += duration
        there = np.ones(len(seen), np.bool_) if valid is None else np.asarray(valid, dtype=np.bool_)
        statistic = np.where(there & (self.declared[:, 0] > 0), 1.0, 0.0)
        detected = statistic > self.threshold
        nothing = np.zeros(np.shape(np.asarray(on_times)))
        return Verdict(
            detected, np.where(detected, self.declared[:, 0], 0), statistic, self.time.copy(), nothing,
            nothing.copy(),
        )  # fmt: skip

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin anew, in the vehicles of a mask (vehicles,) or in all of them."""
        mask = np.ones(self.time.size, np.bool_) if vehicles is None else np.asarray(vehicles)
        self.declared[mask], self.time[mask] = 0, 0.0
        if hasattr(self._player, "reset"):
            self._player.reset(mask)

    def believe(self, effectiveness: ArrayLike, vehicles: ArrayLike | None = None) -> None:
        """A player cannot be told.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("a player of a task expects sound thrusters and cannot be told otherwise")


_DECLARED = ("declared_thruster", "declared_mode")

_LEAST_EVIDENCE = math.log(20.0)

_THRESHOLD = 8.0
"""Of the cumulative sums of Orion: what 500 healthy validation flights of `FaultDiagnosis-v1` show to be
exceeded in fewer than one of 10,000 periods. For other vehicles the same rate has a bound in closed form."""


def _sums(spacecraft: Spacecraft, worlds: int) -> BaseDetector:
    detector = CUSUMDetector.for_vehicle(spacecraft, vehicles=worlds)
    if spacecraft == load("orion"):
        detector.threshold = _THRESHOLD
    return detector


def _models(spacecraft: Spacecraft) -> ModelComparison:
    return ModelComparison(
        spacecraft, losses=(0.3, 0.4, 0.6, 0.8), openings=(0.1, 0.2, 0.4, 0.6, 0.8), tilts=(0.25, 0.4)
    )
