"""A detector beside a policy: what it says is added to the observation of `MarsRendezvous-v1`.

The detector is fed from the observation alone: measurements as old as navigation is slow, and the commands
that the valves were given. So a policy can learn what to do about a fault while a classical method
(`thruster_envs.protocols.NavigationDetector`) says whether there is one, and neither sees the truth. Both
forms, for the single environment and for the batch, do the same arithmetic. Left out: other environments,
whose periods are long enough for a `Detector` of rate changes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from thruster_baselines.control.approach import ApproachController
from thruster_envs.construction import rebuilt, record_of
from thruster_envs.observations import Reader
from thruster_envs.protocols import BoolArray, FloatArray, NavigationDetector, ResidualDetector

__all__ = ["DiagnosisObservation", "VectorDiagnosisObservation"]

_BOUND = 5.0
_MEMORY = "detector/"
"""What the names of a detector's memory begin with in a saved state."""

Floats = NDArray[np.float32]


class _Watch:
    """What both forms share: feeds the detector, and puts what it says into numbers."""

    def __init__(self, env: Any, detector: NavigationDetector, count: int) -> None:
        task: Any = getattr(env.unwrapped, "task", None)
        if not hasattr(task, "navigation_delay"):
            raise TypeError(
                f"{type(env.unwrapped).__name__} shows no navigation to a detector; MarsRendezvous-v1 would "
                "be right"
            )
        if task.navigation_delay == 0:
            raise ValueError(
                "navigation_delay is 0, so that a sample is seen before the command that belongs to it; "
                "1 or more would be right"
            )
        if np.shape(detector.detected) != (count,):
            raise ValueError(
                f"the detector watches {np.size(detector.detected)} vehicles; {count} would be right"
            )
        vehicle = task.vehicle
        known = np.shape(detector.effectiveness)[-1]
        if known != vehicle.number_of_thrusters:
            raise ValueError(
                f"the detector is for {known} thrusters; {vehicle.number_of_thrusters} would be right"
            )
        self.n, self.delay, self.detector = vehicle.number_of_thrusters, task.navigation_delay, detector
        self.controller = ApproachController(vehicle, task.steps, distance=task.distance)
        self.reader = Reader.of(env)
        self.valves, self.spare = bool(task.inhibit), bool(task.inhibit and vehicle.spare_branch)
        self.minimum = np.array([one.minimum_pulse for one in vehicle.thrusters]) / vehicle.control_period
        self.residual = detector if isinstance(detector, ResidualDetector) else None
        self.size = 2 + self.n + (0 if self.residual is None else 3)
        self.commands: deque[FloatArray] = deque(
            (np.zeros((count, self.n)) for _ in range(self.delay)), maxlen=self.delay
        )
        self.statistic: FloatArray = np.zeros(count)
        self.elapsed: FloatArray = np.zeros(count)
        self.branch: BoolArray = np.zeros(count, np.bool_)

    def begin(self, mask: BoolArray) -> None:
        """Forget the worlds whose episode begins."""
        self.detector.reset(mask)
        self.statistic[mask], self.elapsed[mask], self.branch[mask] = 0.0, 0.0, False
        for command in self.commands:
            command[mask] = 0.0

    def look(self, observations: Floats) -> None:
        """Let the detector see one more sample of every world, but for those that begin."""
        rows = observations.astype(np.float64)
        reading = self.reader(rows)
        elapsed = self.controller.elapsed(rows)
        begins = elapsed == 0.0
        over = elapsed == self.controller.steps
        if ((elapsed != self.elapsed + 1.0) & ~begins & ~over).any():
            raise RuntimeError(
                "control periods went by unseen by the detector; HoldAction around the wrapper with the "
                "detector would be right"
            )
        rates = self.controller.open_rates_told(rows)
        shut = rates < self.minimum
        if self.valves:
            shut |= reading.closed > 0.0
        self.commands.append(np.where(shut, 0.0, rates))
        if self.spare:
            branch = reading.branch[:, 0] > 0.0
            if (branch != self.branch).any():
                self.detector.reset(branch != self.branch)
            self.branch = branch
        self.elapsed = elapsed
        attitude, rate = self.controller.attitude(rows)
        inside = reading.within("velocity", "attitude_error", "rate_error").all(axis=1)
        valid = (elapsed >= self.delay) & inside
        self.statistic = self.detector.update(
            self.commands[0], self.controller.position(rows), attitude, rate, valid=valid
        ).statistic
        self.begin(begins)

    def numbers(self) -> Floats:
        """(worlds, size): what is added to an observation."""
        threshold = max(self.detector.threshold, np.finfo(np.float64).tiny)
        parts = [
            np.minimum(self.statistic / threshold, _BOUND)[:, np.newaxis],
            self.detector.detected[:, np.newaxis],
            self.detector.thruster[:, np.newaxis] == 1 + np.arange(self.n),
        ]
        if self.residual is not None:
            parts.append(np.clip(self.residual.residual / threshold, -_BOUND, _BOUND))
        return np.concatenate(parts, axis=1).astype(np.float32)

    def space(self, space: Any) -> spaces.Box:
        """The observations with those numbers behind them."""
        low, high = np.zeros(self.size, np.float32), np.ones(self.size, np.float32)
        high[0] = _BOUND
        low[2 + self.n :], high[2 + self.n :] = -_BOUND, _BOUND
        return spaces.Box(
            np.concatenate([space.low, low]), np.concatenate([space.high, high]), dtype=np.float32
        )

    def save(self) -> dict[str, NDArray[Any]]:
        """What the detector and this remember, as copies by name."""
        own = {"statistic": self.statistic, "elapsed": self.elapsed, "branch": self.branch}
        kept = {f"commands_{age}": one for age, one in enumerate(self.commands)}
        memory = self.detector.save_state()
        return {f"{_MEMORY}{name}": array.copy() for name, array in (memory | own | kept).items()}

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `save` gave."""
        memory = {
            name.removeprefix(_MEMORY): array.copy()
            for name, array in saved.items()
            if name.startswith(_MEMORY)
        }
        for name in ("statistic", "elapsed", "branch"):
            given, right = np.shape(memory[name]) if name in memory else None, self.statistic.shape
            if given != right:
                raise ValueError(f"the saved {name} must have the shape {right}, got {given}")
        self.statistic, self.elapsed, self.branch = (
            memory.pop(k) for k in ("statistic", "elapsed", "branch")
        )
        self.commands.clear()
        while (age := f"commands_{len(self.commands)}") in memory:
            self.commands.append(memory.pop(age))
        self.detector.restore_state(memory)


class DiagnosisObservation(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """What a detector says is added to the observation of `MarsRendezvous-v1`.

    Behind the observation follow: the statistic in shares of its threshold (0..5), whether there has been an
    alarm (0 or 1), for each thruster whether it has been named (n, 0 or 1), and, of a detector that has one,
    the residual in shares of the threshold (3, -5..5). The detector begins anew with each episode, and when
    the chaser goes over to its spare branch.

    Args:
        env: A single `MarsRendezvous-v1`, or a mapper around it; `HoldAction` goes around this wrapper.
        detector: For the same spacecraft and one vehicle.

    Raises:
        TypeError: Another environment.
        ValueError: A detector of several vehicles, or navigation without delay.
    """

    def __init__(self, env: gym.Env[Any, Any], detector: NavigationDetector) -> None:
        detector = rebuilt(detector)
        RecordConstructorArgs.__init__(self, detector=record_of(detector))
        gym.Wrapper.__init__(self, env)
        self._watch = _Watch(env, detector, 1)
        self.observation_space = self._watch.space(env.observation_space)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, with a detector that has seen nothing."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._watch.begin(np.ones(1, np.bool_))
        return self._seen(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step, and one sample for the detector."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._watch.look(observation[np.newaxis])
        return self._seen(observation), reward, terminated, truncated, info

    def own_state(self) -> dict[str, NDArray[Any]]:
        """What the detector and this remember, as copies by name."""
        return self._watch.save()

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `own_state` gave."""
        self._watch.restore(state)

    def _seen(self, observation: Any) -> Any:
        return np.concatenate([observation, self._watch.numbers()[0]])


class VectorDiagnosisObservation(VectorWrapper):
    """`DiagnosisObservation` for a native vector environment, in any autoreset mode.

    To save a state, this has to be the outermost wrapper.

    Args:
        env: A vector `MarsRendezvous-v1`, or a mapper around it.
        detector: For the same spacecraft, and as many vehicles as there are worlds.

    Raises:
        TypeError: Another environment.
        ValueError: A detector of another number of vehicles, or navigation without delay.
    """

    any_autoreset_mode = True

    def __init__(self, env: VectorEnv[Any, Any, Any], detector: NavigationDetector) -> None:
        super().__init__(env)
        self._watch = _Watch(env, detector, env.num_envs)
        self.single_observation_space = self._watch.space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes; the detector has seen nothing of the worlds that begin."""
        observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        self._watch.begin(np.ones(self.num_envs, np.bool_) if mask is None else mask)
        return self._seen(observations), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of all worlds, and one sample of each for the detector."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if "final_obs" not in infos:
            self._watch.look(observations)
        else:
            ended = infos["_final_obs"]
            self._watch.look(np.where(ended[:, np.newaxis], infos["final_obs"], observations))
            infos["final_obs"] = np.where(ended[:, np.newaxis], self._seen(infos["final_obs"]), np.float32(0))
            self._watch.begin(ended)
        return self._seen(observations), rewards, terminated, truncated, infos

    def own_state(self) -> dict[str, NDArray[Any]]:
        """What the detector and this remember, as copies by name."""
        return self._watch.save()

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `own_state` gave."""
        self._watch.restore(state)

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, the detector's memory among it, as copies by name."""
        beneath: Any = self.env
        return dict(beneath.save_state()) | self._watch.save()

    def restore_state(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what `save_state` gave, in an environment of the same configuration."""
        beneath: Any = self.env
        beneath.restore_state({name: array for name, array in saved.items() if not name.startswith(_MEMORY)})
        self._watch.restore(saved)

    def _seen(self, observations: Any) -> Any:
        return np.concatenate([observations, self._watch.numbers()], axis=1)
