"""Evidence that adds up in the observation, so that a policy without memory can diagnose.

Modelled: the residual of a period (measured less expected rate change) is compared, for each thruster, with
three ways of failing whose size is fitted: thrust that is missing or too much while it fires, thrust that
comes while it does not, thrust to the side. With the residual ``e``, its covariance ``S`` (`PhysicalNoise`)
and the effect ``a`` of a failure of size 1, the sums ``u = sum f a' S^-1 e`` and ``v = sum f a' S^-1 a``, in
which the factor ``f`` falls with age, give the fitted size ``s = u / v``, kept within bounds, and the
log-likelihood ratio ``s u - s^2 v / 2`` against no fault (Willsky and Jones 1976, with fading memory instead
of a window). Left out: onsets, several faults at a time, what the turning of the craft and the coupling of
the feed do to the residual, so that sizes are rough.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from thruster_baselines.detection.environment_flights import reader_with
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs.configuration import require
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["EvidenceObservation", "VectorEvidenceObservation"]

Floats = NDArray[np.float32]

#: Ways of failing that are told apart, and least and largest size of thrust that is missing while a thruster
#: fires, that comes while it does not, and to the side on two axes, as shares of its thrust.
_WAYS = 3
_LEAST, _MOST = (
    np.array([[one] for one in ends]) for ends in ((-1.2, 0.0, -0.8, -0.8), (0.5, 1.2, 0.8, 0.8))
)
#: Log-likelihood ratio at which a failure is as likely as none, and what is taken from that of a push to the
#: side, which has a number more to fit.
_NONE, _ONE_MORE = 8.0, 3.0
#: What adds nothing to a denominator that is not zero.
_TINY = 1e-12
_MEMORY = "evidence/"


class _Sums:
    """What both forms share."""

    def __init__(self, env: Any, worlds: int, memory: float) -> None:
        require(1.0 <= memory < math.inf, "memory", memory, "a number of control periods from 1 up")
        self.read = reader_with(env, "time", "duties", "measured_change", "expected_change")
        vehicle: Spacecraft = env.unwrapped.task.vehicle
        self.n, self.period = vehicle.number_of_thrusters, vehicle.control_period
        self.noise, self.kept = PhysicalNoise(vehicle), 1.0 - 1.0 / memory
        self.effects = np.stack([vehicle.effectiveness(), *_sideways(vehicle)])  # (3, 6, n), of a second
        self.size = (_WAYS + 2) * self.n
        self.sums: FloatArray = np.zeros((2, worlds, _WAYS + 1, self.n))

    def look(self, observations: Any) -> None:
        """Take in one more period of every world; one whose episode begins has nothing to show."""
        reading = self.read(observations)
        duties, begins = reading.duties[:, : self.n], reading.time[:, 0] == 0.0
        residual = reading.measured_change - reading.expected_change
        weights = np.linalg.inv(self.noise(duties * self.period))
        along = np.einsum("kan,wab->wknb", self.effects, weights)
        explained = np.einsum("wkna,wa->wkn", along, residual) * self.period
        power = np.einsum("wkna,kan->wkn", along, self.effects) * self.period**2
        open_, shut = duties, 1.0 - duties
        fired = np.stack([open_, shut, open_, open_], axis=1)
        ways = [0, 0, 1, 2]
        self.sums *= self.kept
        self.sums[0] += fired * explained[:, ways]
        self.sums[1] += fired**2 * power[:, ways]
        self.sums[:, begins] = 0.0

    def numbers(self) -> Floats:
        """(worlds, size): what is added to an observation."""
        along, power = self.sums[0], self.sums[1] + _TINY
        fitted = np.clip(along / power, _LEAST, _MOST)
        gained = fitted * along - 0.5 * fitted**2 * power
        ratios = np.stack([gained[:, 0], gained[:, 1], gained[:, 2] + gained[:, 3] - _ONE_MORE], axis=1)
        ratios = ratios.reshape(len(ratios), -1)
        highest = np.maximum(ratios.max(axis=1, keepdims=True), _NONE)
        likelihood = np.where(ratios > 0.0, np.exp(ratios - highest), 0.0)
        share = likelihood / (likelihood.sum(axis=1, keepdims=True) + np.exp(_NONE - highest))
        return np.concatenate([share, fitted[:, :2].reshape(len(ratios), -1)], axis=1).astype(np.float32)

    def space(self, space: Any) -> spaces.Box:
        """Observations with those numbers behind them."""
        counts = [_WAYS * self.n, self.n, self.n]
        low = np.repeat(np.array([0.0, *_LEAST[:2, 0]], np.float32), counts)
        high = np.repeat(np.array([1.0, *_MOST[:2, 0]], np.float32), counts)
        return spaces.Box(
            np.concatenate([space.low, low]), np.concatenate([space.high, high]), dtype=np.float32
        )

    def save(self) -> dict[str, NDArray[Any]]:
        """The sums, as copies by name."""
        return {f"{_MEMORY}sums": self.sums.copy()}

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `save` gave."""
        name = f"{_MEMORY}sums"
        given = np.shape(saved[name]) if name in saved else None
        if given != self.sums.shape:
            raise ValueError(f"the saved sums must have the shape {self.sums.shape}, got {given}")
        self.sums = saved[name].copy()


def _sideways(vehicle: Spacecraft) -> FloatArray:
    """(2, 6, n): effectiveness of each thruster if it pushed square to its direction, on two axes."""
    columns = np.zeros((2, 6, vehicle.number_of_thrusters))
    inverse = np.linalg.inv(np.array(vehicle.inertia))
    for i, thruster in enumerate(vehicle.thrusters):
        direction = np.array(thruster.direction)
        first = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
        first /= np.linalg.norm(first)
        for k, across in enumerate((first, np.cross(direction, first))):
            force = thruster.thrust * across
            columns[k, :3, i] = force / vehicle.mass
            columns[k, 3:, i] = inverse @ np.cross(np.array(thruster.position), force)
    return columns


class EvidenceObservation(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Evidence for a fault of each thruster is added to the observation.

    Behind the observation follow, with the n thrusters in order: how likely it is that the thruster has the
    wrong thrust while it fires (n, 0 to 1), that it thrusts while it does not (n, 0 to 1), that it pushes to
    the side (n, 0 to 1), all against each other and against no fault; then the fitted size of the first two,
    as a share of its thrust (n, -1.2 to 0.5, and n, 0 to 1.2). All are 0 where an episode begins.

    Args:
        env: A single `FaultDiagnosis-v1` or `ActiveDiagnosis-v1`, or another environment of this suite that
            shows time, duties, and measured and expected rate change.
        memory: Control periods after which evidence counts e times less.

    Raises:
        ValueError: Another environment, or a memory below 1.
    """

    def __init__(self, env: gym.Env[Any, Any], memory: float = 20.0) -> None:
        RecordConstructorArgs.__init__(self, memory=float(memory))
        gym.Wrapper.__init__(self, env)
        self._sums = _Sums(env, 1, memory)
        self.observation_space = self._sums.space(env.observation_space)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, with no evidence."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self._seen(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step, whose residual is added."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._seen(observation), reward, terminated, truncated, info

    def own_state(self) -> dict[str, NDArray[Any]]:
        """The sums, as copies by name."""
        return self._sums.save()

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `own_state` gave."""
        self._sums.restore(state)

    def _seen(self, observation: Any) -> Any:
        self._sums.look(observation[np.newaxis])
        return np.concatenate([observation, self._sums.numbers()[0]])


class VectorEvidenceObservation(VectorWrapper):
    """`EvidenceObservation` for a native vector environment, in any autoreset mode.

    Args:
        env: A vector environment as there, without other wrappers.
        memory: Control periods after which evidence counts e times less.

    Raises:
        ValueError: Another environment, or a memory below 1.
    """

    any_autoreset_mode = True

    def __init__(self, env: VectorEnv[Any, Any, Any], memory: float = 20.0) -> None:
        super().__init__(env)
        self._sums = _Sums(env, env.num_envs, memory)
        self.single_observation_space = self._sums.space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes, with no evidence where one begins."""
        before = self._sums.sums.copy()
        observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        self._sums.look(observations)
        if mask is not None:
            self._sums.sums[:, ~mask] = before[:, ~mask]
        return self._seen(observations), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of all worlds, whose residuals are added."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if "final_obs" not in infos:
            self._sums.look(observations)
        else:
            ended = infos["_final_obs"]
            self._sums.look(np.where(ended[:, np.newaxis], infos["final_obs"], observations))
            infos["final_obs"] = np.where(ended[:, np.newaxis], self._seen(infos["final_obs"]), np.float32(0))
            self._sums.sums[:, ended] = 0.0
        return self._seen(observations), rewards, terminated, truncated, infos

    def own_state(self) -> dict[str, NDArray[Any]]:
        """The sums, as copies by name."""
        return self._sums.save()

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what `own_state` gave."""
        self._sums.restore(state)

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, the sums among it, as copies by name."""
        beneath: Any = self.env
        return dict(beneath.save_state()) | self._sums.save()

    def restore_state(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what `save_state` gave, in an environment of the same configuration."""
        beneath: Any = self.env
        beneath.restore_state({name: array for name, array in saved.items() if not name.startswith(_MEMORY)})
        self._sums.restore(saved)

    def _seen(self, observations: Any) -> Any:
        return np.concatenate([observations, self._sums.numbers()], axis=1)
