"""A mapper between policy and thrusters: the action is a rate change, or a belief of thruster health.

``MapperAction`` turns a commanded body rate change into duties by any
:class:`~thruster_envs.protocols.Mapper`. ``BeliefAction`` lets the policy say how healthy it believes each
thruster to be; the mapper then allocates the task's own command with that belief, so that the policy learns
to diagnose. Neither sees the truth. Each has a form for the single environment and one for the batch, which
do the same arithmetic.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from thruster_envs.protocols import Mapper
from thruster_envs.tasks.thruster_mapping import MappingState
from thruster_envs.views.single import TaskEnv
from thruster_envs.views.vector import TaskVectorEnv

Array = NDArray[np.float64]


class _Allocation:
    """What both forms of both wrappers share: from policy actions to duties."""

    def __init__(self, env: Any, mapper: Mapper) -> None:
        base = env.unwrapped
        if not isinstance(base, (TaskEnv, TaskVectorEnv)):
            raise TypeError(
                f"{type(base).__name__} has no thrusters to map to; "
                "an environment of thruster_envs would be right"
            )
        self.worlds, self.task, self.mapper = base.worlds, base.task, mapper
        self.thrusters = self.task.action_size
        self.authority = self.task.vehicle.authority()
        if np.shape(mapper.effectiveness) != (6, self.thrusters):
            raise ValueError(
                f"the mapper is for a vehicle of shape {np.shape(mapper.effectiveness)}; "
                f"{(6, self.thrusters)} would be right"
            )

    def duties(self, on_times: Array) -> Array:
        """Actions of the environment beneath, -1..1, from on-times."""
        duties = np.clip(on_times / self.task.vehicle.control_period, 0.0, 1.0)
        return np.asarray(2.0 * duties - 1.0)

    def from_rate_change(self, actions: Array) -> Array:
        """(worlds, 6) shares of the authority per axis to actions beneath."""
        command = np.clip(actions, -1.0, 1.0) * self.authority
        return self.duties(np.asarray(self.mapper(command).on_times))

    def from_health(self, health: Array) -> Array:
        """(worlds, n) believed health 0..1 to actions beneath."""
        state = self.worlds.state
        assert isinstance(state, MappingState)  # as _has_command made sure
        effectiveness = self.mapper.effectiveness * health[:, np.newaxis, :]
        return self.duties(np.asarray(self.mapper(state.command, effectiveness=effectiveness).on_times))


def _has_command(allocation: _Allocation) -> None:
    if not isinstance(allocation.worlds.state, MappingState):
        raise ValueError(
            f"{type(allocation.task).__name__} commands no rate change, so a belief alone says nothing; "
            "MapperAction, or ThrusterMapping-v0, would be right"
        )


class MapperAction(gym.ActionWrapper[Any, Any, Any], RecordConstructorArgs):
    """The action is a body rate change, of which the mapper makes duties.

    Box [-1, 1] (6,), in shares of the vehicle's authority per axis.

    Args:
        env: Any single environment of this suite.
        mapper: For the same vehicle.
    """

    def __init__(self, env: gym.Env[Any, Any], mapper: Mapper) -> None:
        RecordConstructorArgs.__init__(self, mapper=mapper)
        gym.ActionWrapper.__init__(self, env)
        self._allocation = _Allocation(env, mapper)
        self.action_space = spaces.Box(-1.0, 1.0, (6,), dtype=np.float32)

    def action(self, action: Any) -> Array:
        """Duties in [-1, 1]."""
        duties: Array = self._allocation.from_rate_change(_finite(action, 6)[np.newaxis])[0]
        return duties


class VectorMapperAction(VectorWrapper):
    """:class:`MapperAction` for a native vector environment."""

    def __init__(self, env: VectorEnv[Any, Any, Any], mapper: Mapper) -> None:
        super().__init__(env)
        self._allocation = _Allocation(env, mapper)
        self.single_action_space = spaces.Box(-1.0, 1.0, (6,), dtype=np.float32)
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def step(self, actions: Any) -> Any:
        """One step of all worlds."""
        return self.env.step(self._allocation.from_rate_change(_finite(actions, self.env.num_envs, 6)))


class BeliefAction(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The action is the believed health of each thruster, with which the mapper allocates the command.

    Box [-1, 1] (n,), meaning 0..1.

    A belief of 1 for every thruster is the mapper that knows of no fault. The last belief is added to the
    observation (n numbers, 0..1; ones after a reset), so that a policy without memory can keep a diagnosis.

    Args:
        env: A single environment whose task commands a rate change: ``ThrusterMapping-v0``.
        mapper: For the same vehicle.
        observe_belief: Whether the last belief is added to the observation.
    """

    def __init__(self, env: gym.Env[Any, Any], mapper: Mapper, *, observe_belief: bool = True) -> None:
        RecordConstructorArgs.__init__(self, mapper=mapper, observe_belief=observe_belief)
        gym.Wrapper.__init__(self, env)
        self._allocation, self._observe = _Allocation(env, mapper), observe_belief
        _has_command(self._allocation)
        n = self._allocation.thrusters
        self.action_space = spaces.Box(-1.0, 1.0, (n,), dtype=np.float32)
        self.observation_space = (
            _with_belief(env.observation_space, n) if observe_belief else env.observation_space
        )
        self._belief = np.ones(n)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, believing every thruster healthy."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._belief = np.ones(self._allocation.thrusters)
        return self._seen(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Allocate the command with this belief, and fire."""
        self._belief = _health(_finite(action, self._allocation.thrusters))
        duties = self._allocation.from_health(self._belief[np.newaxis])[0]
        observation, reward, terminated, truncated, info = self.env.step(duties)
        return self._seen(observation), reward, terminated, truncated, info

    def _seen(self, observation: Any) -> Any:
        return (
            np.concatenate([observation, self._belief.astype(np.float32)]) if self._observe else observation
        )


class VectorBeliefAction(VectorWrapper):
    """:class:`BeliefAction` for a native vector environment, in any autoreset mode."""

    def __init__(self, env: VectorEnv[Any, Any, Any], mapper: Mapper, *, observe_belief: bool = True) -> None:
        super().__init__(env)
        self._allocation, self._observe = _Allocation(env, mapper), observe_belief
        _has_command(self._allocation)
        n = self._allocation.thrusters
        self.single_action_space = spaces.Box(-1.0, 1.0, (n,), dtype=np.float32)
        self.action_space = batch_space(self.single_action_space, env.num_envs)
        if observe_belief:
            self.single_observation_space = _with_belief(env.single_observation_space, n)
            self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._belief = np.ones((env.num_envs, n))

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes; the worlds that begin believe every thruster healthy."""
        observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        self._belief[slice(None) if mask is None else mask] = 1.0
        return self._seen(observations), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Allocate the commands with these beliefs, and fire."""
        self._belief = _health(_finite(actions, *self._belief.shape))
        base: Any = self.env.unwrapped
        begins = base.pending_resets
        observations, rewards, terminated, truncated, infos = self.env.step(
            self._allocation.from_health(self._belief)
        )
        if "final_obs" in infos:
            infos["final_obs"] = self._seen(infos["final_obs"])
        if base.autoreset_mode == AutoresetMode.SAME_STEP:
            begins = terminated | truncated
        self._belief[begins] = 1.0
        return self._seen(observations), rewards, terminated, truncated, infos

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, the last beliefs among it, as copies by name."""
        return self._batch().save_state() | {"belief": self._belief.copy()}

    def restore_state(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save_state` gave, in an environment of the same configuration."""
        self._batch().restore_state(saved)
        self._belief = saved["belief"].copy()

    def _batch(self) -> TaskVectorEnv:
        base = self.env.unwrapped
        assert isinstance(base, TaskVectorEnv)  # the constructor takes no other
        return base

    def _seen(self, observations: Any) -> Any:
        return (
            np.concatenate([observations, self._belief.astype(np.float32)], axis=1)
            if self._observe
            else observations
        )


def _health(actions: Array) -> Array:
    """Believed health 0..1 from actions in [-1, 1]."""
    return np.asarray(0.5 * np.clip(actions, -1.0, 1.0) + 0.5)


def _with_belief(space: Any, thrusters: int) -> spaces.Box:
    low = np.concatenate([space.low, np.zeros(thrusters, np.float32)])
    high = np.concatenate([space.high, np.ones(thrusters, np.float32)])
    return spaces.Box(low, high, dtype=np.float32)


def _finite(action: Any, *shape: int) -> Array:
    array = np.asarray(action, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"the action has the shape {array.shape}; {shape} would be right")
    if not np.isfinite(array).all():
        raise ValueError(
            f"the action has the entry {array[~np.isfinite(array)][0]}; numbers from -1 to 1 would be right"
        )
    return array
