"""Any detector as a player of the diagnosis tasks: observation in, hypothesis out.

The detector says when something is wrong. Who it is and how it fails is asked of the model comparison
(Yang 2003, section 5.3.1), over all periods and not over one: for each thruster and each model the
log-likelihood ratio against no fault is added up from period to period, and begins anew where it falls below
zero, since nobody knows the onset (Page 1954). From the first alarm on, the hypothesis with the largest sum
is declared. Where a kind has several models, for losses of several sizes or tilts to several sides, each of
them has its share of the kind's prior probability.

In `ActiveDiagnosis-v0` it fires the shortest test pulse of one thruster after the other, as long as the
budget lasts.

Left out: several faulty thrusters, faults that heal, that a wrong name costs more than a late one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.detection.base import BaseDetector
from thruster_baselines.detection.cusum import CUSUMDetector
from thruster_baselines.detection.environment_flights import ObservedFiring
from thruster_baselines.detection.identification import ModelComparison
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs.faults import mode_of
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["DetectorPlayer"]


class DetectorPlayer:
    """Plays `FaultDiagnosis-v0` or `ActiveDiagnosis-v0` with a detector and a model comparison.

    It sees observations only. A world whose observation says that an episode begins is begun anew.

    Args:
        environment: The vector environment that is played, for what stands where in its observation.
        make: Builds a detector for so many vehicles, threshold included; by default cumulative sums
            (`CUSUMDetector`).
        comparison: Of the models of a fault; by default four sizes of a loss, five openings, two tilts to
            eight sides.

    Raises:
        ValueError: An environment that is no diagnosis task.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make_vec(
    ...     "thruster_envs/FaultDiagnosis-v0",
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
    ) -> None:
        task = environment.unwrapped.task
        self._read = ObservedFiring(environment)
        spacecraft, worlds = self._read.spacecraft, environment.num_envs
        n = spacecraft.number_of_thrusters
        names = [feature.name for feature in task.features]
        if task.choices is None or task.choices[0] != n + 1 or _TIME not in names:
            raise ValueError(
                f"environment is {type(task).__name__}; FaultDiagnosis or ActiveDiagnosis would be right"
            )
        self._time = sum(feature.size for feature in task.features[: names.index(_TIME)])
        self._entries = len(task.choices)
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

    def __call__(self, observations: NDArray[np.float32]) -> IntArray:
        """Actions (worlds, entries): thruster, mode, and where there are tests the pulse of each thruster.

        Args:
            observations: (worlds, size).
        """
        on_times, rate_change = self._read(observations)
        begins = observations[:, self._time] == 0.0
        diagnosis = self.detector.update(on_times, rate_change, self._read.duration, valid=~begins)
        self._alarmed |= diagnosis.detected
        self._add_up()
        if begins.any():
            self.reset(begins)
        return self._actions()

    def reset(self, worlds: NDArray[np.bool_] | None = None) -> None:
        """Begin anew, in the worlds of a mask (worlds,) or in all of them."""
        where = slice(None) if worlds is None else worlds
        self.detector.reset(worlds)
        self._sums[where], self._alarmed[where], self._calls[where] = 0.0, False, 0

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
        likeliest = (self._sums + self._prior).reshape(worlds, -1).argmax(axis=1)
        thruster, model = likeliest // models, likeliest % models
        actions = np.zeros((worlds, self._entries), np.int64)
        declares = self._alarmed & (model > 0)
        actions[declares, 0] = thruster[declares] + 1
        actions[declares, 1] = self._modes[model[declares]]
        if self._entries > 2:
            actions[:, 2:] = np.arange(n) == (self._calls % n)[:, np.newaxis]
        self._calls += 1
        return actions


_TIME = "time since the start"

_THRESHOLD = 8.0
"""Of the cumulative sums: what 500 healthy validation flights of `FaultDiagnosis-v0` show to be exceeded in
fewer than one of 10,000 periods of Orion."""


def _sums(spacecraft: Spacecraft, worlds: int) -> BaseDetector:
    return CUSUMDetector(spacecraft, _THRESHOLD, noise=PhysicalNoise(spacecraft), vehicles=worlds)


def _models(spacecraft: Spacecraft) -> ModelComparison:
    return ModelComparison(
        spacecraft, losses=(0.3, 0.4, 0.6, 0.8), openings=(0.1, 0.2, 0.4, 0.6, 0.8), tilts=(0.25, 0.4)
    )
