"""What stands between policy and thrusters: a mapper, or a hand that holds each action for a while.

``MapperAction`` turns a commanded body rate change into duties by any
:class:`~thruster_envs.protocols.Mapper`. ``BeliefAction`` lets the policy say how healthy it believes each
thruster to be; the mapper then allocates the task's own command with that belief, so that the policy learns
to diagnose. Neither sees the truth. ``HoldAction`` lets several control periods pass under each action. Each
has a form for the single environment and one for the batch, which do the same arithmetic.

A mapper may remember what it still owes from earlier commands
(:class:`~thruster_envs.protocols.MapperWithMemory`). ``MapperAction`` shows that in ``info["remainder"]``,
and makes the mapper forget it where an episode begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from thruster_envs.construction import rebuilt, record_of
from thruster_envs.protocols import Mapper, MapperWithMemory
from thruster_envs.tasks.contract import check_whole
from thruster_envs.tasks.thruster_mapping import MappingState
from thruster_envs.views.inputs import checked_actions
from thruster_envs.views.single import TaskEnv
from thruster_envs.views.vector import TaskVectorEnv

Array = NDArray[np.float64]

_ROUND_OFF = 4.0 * np.finfo(np.float64).eps
"""More than what the way from an on-time to an action and back can take from a duty."""

_LONGEST_HOLD = 2**31
"""Control periods; only a slip of the pen reaches it."""

_MEMORY = "mapper/"
"""What the names of a mapper's memory begin with in a saved state."""


def check_without_storage(task: Any) -> None:
    """Refuse a task whose craft have actuators that no mapper knows.

    Raises:
        ValueError: One line says so.
    """
    if task.storage_size:
        raise ValueError(
            f"spacecraft must have no reaction wheels and no control-moment gyros for an action through a "
            f"mapper, got {task.vehicle.name!r} with {task.storage_size} of them"
        )


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
        if self.task.choices is not None:
            raise ValueError(
                f"the action of {type(base).__name__} is not the duty of each thruster, so there is nothing "
                "to map to; an environment whose action is a Box would be right"
            )
        self.thrusters = self.task.vehicle.number_of_thrusters
        #: Numbers of an action: a rate change, and what the environment takes beside duties, as it takes it.
        check_without_storage(self.task)
        self.size = 6 + self.task.action_size - self.thrusters
        self.authority = self.task.vehicle.authority()
        if np.shape(mapper.effectiveness) != (6, self.thrusters):
            raise ValueError(
                f"the mapper is for a vehicle of shape {np.shape(mapper.effectiveness)}; "
                f"{(6, self.thrusters)} would be right"
            )
        self.memory = mapper if isinstance(mapper, MapperWithMemory) else None
        thrusters = self.task.vehicle.thrusters
        self.minimum_pulse = np.array([thruster.minimum_pulse for thruster in thrusters])

    def duties(self, on_times: Array) -> Array:
        """Actions of the environment beneath, -1..1, from on-times.

        A pulse that is just long enough stays so: no valve stays shut for the round-off of the way there.
        """
        period = self.task.vehicle.control_period
        actions = 2.0 * np.clip(on_times / period, 0.0, 1.0) - 1.0
        lost = (on_times >= self.minimum_pulse) & ((0.5 * actions + 0.5) * period < self.minimum_pulse)
        return np.asarray(np.where(lost, actions + _ROUND_OFF, actions))

    def from_rate_change(self, actions: Array) -> Array:
        """(worlds, size), shares of the authority per axis and what stands behind, to actions beneath."""
        command = np.clip(actions[:, :6], -1.0, 1.0) * self.authority
        if self.memory is not None:
            command = command.reshape(self.memory.remainder.shape)
        on_times = np.asarray(self.mapper(command).on_times)
        return np.concatenate([self.duties(on_times.reshape(-1, self.thrusters)), actions[:, 6:]], axis=1)

    def remainder(self) -> Array:
        """(worlds, 6) what the mapper carries over, m/s then rad/s; a copy."""
        assert self.memory is not None  # whoever asks has looked
        return np.array(self.memory.remainder, dtype=np.float64).reshape(-1, 6)

    def save_memory(self) -> dict[str, NDArray[Any]]:
        """What the mapper owes, as copies by name; nothing of one without a memory."""
        remembered = {} if self.memory is None else self.memory.save_state()
        return {f"{_MEMORY}{name}": copy for name, copy in remembered.items()}

    def restore_memory(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save_memory` gave."""
        if self.memory is not None:
            self.memory.restore_state({name.removeprefix(_MEMORY): one for name, one in saved.items()})

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
    if allocation.memory is not None:
        raise ValueError(
            f"the mapper is a {type(allocation.mapper).__name__}, which carries over to the next command, "
            "while every command here stands for itself; a mapper without a memory would be right"
        )


def _serves(allocation: _Allocation, *shapes: tuple[int, ...]) -> None:
    """Raise ValueError if the mapper remembers other worlds than there are."""
    if allocation.memory is None:
        return
    shape = np.shape(allocation.memory.remainder)
    if shape not in shapes:
        raise ValueError(
            f"the mapper's remainder has the shape {shape}; {' or '.join(map(str, shapes))} would be right"
        )


class MapperAction(gym.ActionWrapper[Any, Any, Any], RecordConstructorArgs):
    """The action is a body rate change, of which the mapper makes duties.

    Box [-1, 1] (6,), in shares of the vehicle's authority per axis. Where the environment takes more than
    duties (valves of ``MarsRendezvous-v1``), that stands behind the six, unchanged.

    A mapper with a memory begins every episode without owing anything; ``info["remainder"]`` (6,), m/s then
    rad/s, is what it carries over to the next action.

    Args:
        env: Any single environment of this suite.
        mapper: For the same vehicle; one with a memory has to serve one craft. Or a record of it, as an
            ``EnvSpec`` has it.
    """

    def __init__(self, env: gym.Env[Any, Any], mapper: Mapper) -> None:
        mapper = rebuilt(mapper)
        RecordConstructorArgs.__init__(self, mapper=record_of(mapper))
        gym.ActionWrapper.__init__(self, env)
        self._allocation = _Allocation(env, mapper)
        _serves(self._allocation, (6,), (1, 6))
        self.action_space = spaces.Box(-1.0, 1.0, (self._allocation.size,), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, owing nothing."""
        observation, info = self.env.reset(seed=seed, options=options)
        if self._allocation.memory is not None:
            self._allocation.memory.forget()
        return observation, self._told(info)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Allocate the rate change, and fire."""
        observation, reward, terminated, truncated, info = self.env.step(self.action(action))
        return observation, reward, terminated, truncated, self._told(info)

    def action(self, action: Any) -> Array:
        """Duties in [-1, 1]."""
        duties: Array = self._allocation.from_rate_change(_finite(action, self._allocation.size)[np.newaxis])[
            0
        ]
        return duties

    def own_state(self) -> dict[str, NDArray[Any]]:
        """What the mapper owes, as copies by name."""
        return self._allocation.save_memory()

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`own_state` gave."""
        self._allocation.restore_memory(state)

    def _told(self, info: dict[str, Any]) -> dict[str, Any]:
        if self._allocation.memory is not None:
            info["remainder"] = self._allocation.remainder()[0]
        return info


class VectorMapperAction(VectorWrapper):
    """:class:`MapperAction` for a native vector environment, in any autoreset mode.

    Args:
        env: A vector environment of this suite.
        mapper: For the same vehicle; one with a memory has to serve as many worlds as there are.
    """

    any_autoreset_mode = True

    def __init__(self, env: VectorEnv[Any, Any, Any], mapper: Mapper) -> None:
        super().__init__(env)
        self._allocation = _Allocation(env, mapper)
        _serves(self._allocation, (env.num_envs, 6))
        self.single_action_space = spaces.Box(-1.0, 1.0, (self._allocation.size,), dtype=np.float32)
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes; the worlds that begin owe nothing."""
        observations, infos = self.env.reset(seed=seed, options=options)
        if self._allocation.memory is not None:
            self._allocation.memory.forget((options or {}).get("reset_mask"))
            self._tell(infos, np.ones(self.num_envs, np.bool_))
        return observations, infos

    def step(self, actions: Any) -> Any:
        """One step of all worlds."""
        base: Any = self.env.unwrapped
        begins = base.pending_resets
        duties = self._allocation.from_rate_change(_finite(actions, self.env.num_envs, self._allocation.size))
        observations, rewards, terminated, truncated, infos = self.env.step(duties)
        if self._allocation.memory is not None:
            if base.autoreset_mode == AutoresetMode.SAME_STEP:
                begins = terminated | truncated
            if "final_info" in infos:
                self._tell(infos["final_info"], begins)
            self._allocation.memory.forget(begins)
            self._tell(infos, np.ones(self.num_envs, np.bool_))
        return observations, rewards, terminated, truncated, infos

    def own_state(self) -> dict[str, NDArray[Any]]:
        """What the mapper owes, as copies by name."""
        return self._allocation.save_memory()

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`own_state` gave."""
        self._allocation.restore_memory(state)

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, the mapper's memory among it, as copies by name."""
        return _batch(self).save_state() | self.own_state()

    def restore_state(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save_state` gave, in an environment of the same configuration."""
        self.set_own_state({name: array for name, array in saved.items() if name.startswith(_MEMORY)})
        _batch(self).restore_state(saved)

    def _tell(self, infos: dict[str, Any], mask: NDArray[np.bool_]) -> None:
        """Put the remainder into infos, with its mask beside it."""
        infos["remainder"] = np.where(mask[:, np.newaxis], self._allocation.remainder(), 0.0)
        infos["_remainder"] = mask.copy()


class BeliefAction(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The action is the believed health of each thruster, with which the mapper allocates the command.

    Box [-1, 1] (n,), meaning 0..1.

    A belief of 1 for every thruster is the mapper that knows of no fault. The last belief is added to the
    observation (n numbers, 0..1; ones after a reset), so that a policy without memory can keep a diagnosis.

    Args:
        env: A single environment whose task commands a rate change: ``ThrusterMapping-v0``.
        mapper: For the same vehicle; without a memory, since every command stands for itself.
        observe_belief: Whether the last belief is added to the observation.
    """

    def __init__(self, env: gym.Env[Any, Any], mapper: Mapper, *, observe_belief: bool = True) -> None:
        mapper, observe_belief = rebuilt(mapper), bool(observe_belief)
        RecordConstructorArgs.__init__(self, mapper=record_of(mapper), observe_belief=observe_belief)
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

    def own_state(self) -> dict[str, NDArray[Any]]:
        """The last belief."""
        return {"belief": self._belief.copy()}

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`own_state` gave."""
        self._belief = _belief_in(state, self._belief)

    def _seen(self, observation: Any) -> Any:
        return (
            np.concatenate([observation, self._belief.astype(np.float32)]) if self._observe else observation
        )


class VectorBeliefAction(VectorWrapper):
    """:class:`BeliefAction` for a native vector environment, in any autoreset mode."""

    any_autoreset_mode = True

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

    def own_state(self) -> dict[str, NDArray[Any]]:
        """The last beliefs."""
        return {"belief": self._belief.copy()}

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`own_state` gave."""
        self._belief = _belief_in(state, self._belief)

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, the last beliefs among it, as copies by name."""
        return _batch(self).save_state() | self.own_state()

    def restore_state(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save_state` gave, in an environment of the same configuration."""
        _batch(self).restore_state(saved)
        self.set_own_state(saved)

    def _seen(self, observations: Any) -> Any:
        return (
            np.concatenate([observations, self._belief.astype(np.float32)], axis=1)
            if self._observe
            else observations
        )


class HoldAction(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Each action is held for some control periods, or until the episode ends.

    The reward is the sum over these periods, and so are ``info["reward_terms"]`` and ``info["cost"]``; the
    observation and all other information are those of the last one. Time limits still count control periods.
    Where one pulse does little and actions drawn anew cancel each other, as in ``FormationAttitude-v1``,
    exploring needs this.

    Args:
        env: Any single environment of this suite, or a mapper around it.
        periods: For how many control periods each action is held.
    """

    remembers_nothing = True

    def __init__(self, env: gym.Env[Any, Any], periods: int) -> None:
        check_whole("periods", periods, 1, _LONGEST_HOLD)
        RecordConstructorArgs.__init__(self, periods=int(periods))
        gym.Wrapper.__init__(self, env)
        if not isinstance(env.unwrapped, TaskEnv):
            raise TypeError(
                f"{type(env.unwrapped).__name__} has no control periods to hold an action for; "
                "an environment of thruster_envs would be right"
            )
        self.periods = int(periods)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Let so many control periods pass under ``action``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        for _ in range(self.periods - 1):
            if terminated or truncated:
                break
            so_far, before = reward, info
            observation, reward, terminated, truncated, info = self.env.step(action)
            reward = float(so_far) + float(reward)
            _add_summed(info, before)
        return observation, reward, terminated, truncated, info


class VectorHoldAction(VectorWrapper):
    """:class:`HoldAction` for a native vector environment, in any autoreset mode.

    A world whose episode ends within the hold waits for the others. In the mode ``DISABLED`` it goes on past
    its end meanwhile, unseen.

    Args:
        env: A vector environment of this suite, without other wrappers; a mapper goes around this one.
        periods: For how many control periods each action is held.
    """

    any_autoreset_mode = True
    remembers_nothing = True

    def __init__(self, env: VectorEnv[Any, Any, Any], periods: int) -> None:
        if not isinstance(env, TaskVectorEnv):
            raise TypeError(
                f"env is a {type(env).__name__}; a vector environment of thruster_envs, without a wrapper, "
                "would be right"
            )
        super().__init__(env)
        check_whole("periods", periods, 1, _LONGEST_HOLD)
        self.periods = periods

    def step(self, actions: Any) -> Any:
        """Let so many control periods pass in every world."""
        return _batch(self).step_held(actions, self.periods)

    def save_state(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, as copies by name."""
        return _batch(self).save_state()

    def restore_state(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save_state` gave, in an environment of the same configuration."""
        _batch(self).restore_state(saved)


def _add_summed(info: dict[str, Any], before: dict[str, Any]) -> None:
    """Add to the reward terms and the cost what they were before, in a nested info or a flat one."""
    for key, value in info.items():
        if key == "reward_terms":
            info[key] = {name: before[key][name] + term for name, term in value.items()}
        elif key == "cost" or key.startswith("reward_terms/"):
            info[key] = before[key] + value


def _batch(wrapper: VectorWrapper) -> TaskVectorEnv:
    base = wrapper.env.unwrapped
    assert isinstance(base, TaskVectorEnv)  # the constructor takes no other
    return base


def _belief_in(state: Mapping[str, NDArray[Any]], like: Array) -> Array:
    """A copy of the belief in a saved state."""
    shape = np.shape(state["belief"]) if "belief" in state else None
    if shape != like.shape:
        raise ValueError(f"the saved belief must have the shape {like.shape}, got {shape}")
    return np.array(state["belief"], np.float64)


def _health(actions: Array) -> Array:
    """Believed health 0..1 from actions in [-1, 1]."""
    return np.asarray(0.5 * np.clip(actions, -1.0, 1.0) + 0.5)


def _with_belief(space: Any, thrusters: int) -> spaces.Box:
    low = np.concatenate([space.low, np.zeros(thrusters, np.float32)])
    high = np.concatenate([space.high, np.ones(thrusters, np.float32)])
    return spaces.Box(low, high, dtype=np.float32)


def _finite(action: Any, *shape: int) -> Array:
    array = checked_actions(action, shape)
    if not np.isfinite(array).all():
        raise ValueError(
            f"the action has the entry {array[~np.isfinite(array)][0]}; numbers from -1 to 1 would be right"
        )
    return array
