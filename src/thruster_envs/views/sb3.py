"""Batches as Stable-Baselines3 ``VecEnv``: one agent per world, or every craft under one shared policy.

At the end of an episode ``infos[i]`` has ``terminal_observation`` and ``TimeLimit.truncated``, so that
on-policy algorithms bootstrap over a time limit and off-policy ones store the true last observation; it also
has all that the environment said last (``is_success``, from which SB3 logs a success rate, ``score``,
``reward_terms``, ``fault``, ``state``), and ``episode`` where Gymnasium's ``RecordEpisodeStatistics`` is
beneath. While an episode runs the
infos are empty dictionaries: thousands of them would cost more than the physics. :meth:`latest_info` has
everything, as arrays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv, VectorObservationWrapper, VectorWrapper
from gymnasium.wrappers import vector as gymnasium_wrappers
from numpy.typing import NDArray

from thruster_envs.configuration import shown
from thruster_envs.extras import extra
from thruster_envs.tasks import FormationKeeping, Task
from thruster_envs.views.inputs import NotReset, checked_actions, checked_seed
from thruster_envs.views.single import checked_flag, flattened, make_task
from thruster_envs.views.spaces import action_space, observation_space
from thruster_envs.views.states import MidEpisode
from thruster_envs.views.vector import TaskVectorEnv
from thruster_envs.views.worlds import Step, Worlds

with extra("sb3", __name__):
    from stable_baselines3.common.vec_env import VecEnv

#: Gymnasium's wrappers that never look at the autoreset mode, nor change observations.
_INDIFFERENT = (
    gymnasium_wrappers.ClipAction,
    gymnasium_wrappers.ClipReward,
    gymnasium_wrappers.RescaleAction,
    gymnasium_wrappers.TransformAction,
    gymnasium_wrappers.TransformReward,
    gymnasium_wrappers.VectorizeTransformAction,
    gymnasium_wrappers.VectorizeTransformReward,
)
#: Those that read the mode when they are made, and do not change observations.
_READERS = (gymnasium_wrappers.NormalizeReward, gymnasium_wrappers.RecordEpisodeStatistics)
#: Those that do neither, but show pictures.
_PICTURES = tuple(
    getattr(gymnasium_wrappers, name)
    for name in ("HumanRendering", "RecordVideo")
    if name in gymnasium_wrappers.__all__  # older versions have one of them only
)


class _BatchVecEnv(VecEnv):
    """What both adapters share: the calls of ``VecEnv`` that do not depend on what is stepped."""

    actions: NDArray[Any]
    _latest: dict[str, Any] | None = None

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """The seed of each row is this one plus its number; it counts from the next reset on."""
        return super().seed(seed if seed is None else checked_seed(seed))

    def set_options(self, options: Any = None) -> None:
        """Options of the next reset: a dict for all rows, or a list with one for each of them.

        Raises:
            ValueError: A list of another length, or one with something else in it.
        """
        if options is not None and not isinstance(options, Mapping):
            rows = list(options) if isinstance(options, Sequence) and not isinstance(options, str) else None
            if rows is None or not all(one is None or isinstance(one, Mapping) for one in rows):
                raise ValueError(
                    f"options must be a dict, or a list with one for each row, got {shown(options)}"
                )
            if len(rows) != self.num_envs:
                raise ValueError(
                    f"options must have {self.num_envs} entries, one for each row, got {len(rows)}"
                )
            options = [{} if one is None else dict(one) for one in rows]
        super().set_options(options)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Remember the actions."""
        self.actions = actions

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The batch's attribute, once for each index."""
        return [self._attribute(attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002  # SB3's signature
        """Not possible for single members of a batch; make the batch with another configuration."""
        raise AttributeError(
            f"{attr_name} cannot be set in members of a batch; make the batch with another configuration"
        )

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """The batch's method, called once; its result for each row.

        With ``indices``, ``reset`` resets these rows alone and gives the observation and info of each. No
        other method can be called for some of the rows.

        Raises:
            ValueError: Another method for some rows only.
        """
        rows = list(self._get_indices(indices))
        if method_name == "reset":
            return self._reset_rows(rows, *args, **kwargs)
        if sorted(set(rows)) != list(range(self.num_envs)):
            raise ValueError(
                f"{method_name} acts on all {self.num_envs} rows at once, and cannot for indices={indices!r} "
                "alone; leave indices out"
            )
        result = self._attribute(method_name)(*args, **kwargs)
        return [result for _ in rows]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:  # noqa: ARG002  # SB3's signature
        """Single-environment wrappers are never there."""
        return [False for _ in self._get_indices(indices)]

    def latest_info(self) -> dict[str, Any]:
        """The infos of the last step or reset as arrays, whose first axis is the world."""
        if self._latest is None:
            raise NotReset("latest_info")
        return self._latest

    def _get_indices(self, indices: Any) -> list[int]:
        rows = [int(row) for row in super()._get_indices(indices)]
        wrong = [row for row in rows if not -self.num_envs <= row < self.num_envs]
        if wrong:
            raise IndexError(f"indices must be from 0 to {self.num_envs - 1}, got {wrong[0]}")
        return [row % self.num_envs for row in rows]

    def _consumed(self) -> None:
        """Seeds and options have been used by a reset."""
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()

    def _attribute(self, name: str) -> Any:
        raise NotImplementedError

    def _reset_rows(
        self, rows: list[int], *, seed: Any = None, options: Mapping[str, Any] | None = None
    ) -> list[Any]:
        raise NotImplementedError


class SB3VecEnv(_BatchVecEnv):
    """A native vector environment as a Stable-Baselines3 ``VecEnv``.

    SB3 needs the autoreset mode SAME_STEP. An environment of this suite is switched to it, if nothing is
    wrapped around it but wrappers of this suite and Gymnasium's for actions and rewards, which take any mode
    as it comes. All others read the mode when they are made: make the environment with
    ``autoreset_mode="SameStep"`` before wrapping.

    ``set_options`` takes a list with the ``faults`` of each world, beside one dict for all.

    Args:
        env: From ``gym.make_vec``; one of this suite or anyone's, wrapped or not.

    Raises:
        ValueError: An environment that is not in the mode SAME_STEP and cannot be switched. From ``step``:
            a wrapper changes observations but not ``infos["final_obs"]``, so that the terminal observation
            would be a wrong one.

    Example:
        ``PPO("MlpPolicy", SB3VecEnv(gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=256)))``
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self.env = env
        _require_same_step(env)
        self._watched = _watched(env)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        """Begin an episode in every world, with what :meth:`seed` and :meth:`set_options` were given."""
        seed = None if all(one is None for one in self._seeds) else self._seeds
        env: Any = self.env  # Gymnasium types the seed of a vector environment as one number
        observations, self._latest = env.reset(seed=seed, options=self._common_options())
        self._consumed()
        if not isinstance(observations, (np.ndarray, dict)):
            raise TypeError(
                f"the observations are of the type {type(observations).__name__}; Stable-Baselines3 takes "
                "NumPy arrays, so leave out the wrapper that converts them"
            )
        for watched in self._watched:
            watched.saw_reset(observations)
        return observations

    def _common_options(self) -> dict[str, Any] | None:
        """The options of all rows as one dict, the faults of each world in a list."""
        rows, base = self._options, self.env.unwrapped
        if all(row == rows[0] for row in rows):
            return rows[0] or None
        first, *others = [{key: row[key] for key in row if key != "faults"} for row in rows]
        if not isinstance(base, TaskVectorEnv) or any(other != first for other in others):
            raise ValueError(
                "options differ from row to row; only the faults of an environment of thruster_envs can"
            )
        source, own = base.task.faults_from, base.task.faults
        return first | {"faults": [source(row.get("faults", own)) for row in rows]}

    def _reset_rows(
        self, rows: list[int], *, seed: Any = None, options: Mapping[str, Any] | None = None
    ) -> list[Any]:
        base = self.env.unwrapped
        if not isinstance(base, TaskVectorEnv):
            raise ValueError(f"{type(base).__name__} cannot reset some of its rows; call reset() of all")
        mask = np.isin(np.arange(self.num_envs), rows)
        seeds = None if seed is None else [checked_seed(seed)] * self.num_envs
        env: Any = self.env
        observations, infos = env.reset(seed=seeds, options=dict(options or {}) | {"reset_mask": mask})
        self._latest = infos
        return [(observations[row], _of_row(infos, row)) for row in rows]

    def step_wait(
        self,
    ) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One step of every world."""
        if self._latest is None:
            raise NotReset("step")
        observations, rewards, terminated, truncated, latest = self.env.step(self.actions)
        if not isinstance(latest, dict):
            raise TypeError("the infos are a list; leave out the wrapper that makes one of them")
        done = terminated | truncated
        for watched in self._watched:
            watched.check(observations, latest, done)
        self._latest = latest
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        final, statistics = latest.get("final_info", {}), latest.get("episode", {})
        for i in np.flatnonzero(done):
            infos[i] = _of_row(final, int(i))
            infos[i]["terminal_observation"] = _row(latest["final_obs"], int(i))
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            if statistics:
                infos[i]["episode"] = {key: statistics[key][i].item() for key in ("r", "l", "t")}
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Pictures of the worlds, if it was made with ``render_mode="rgb_array"``."""
        frames: Any = self.env.render() if self.env.render_mode == "rgb_array" else None
        return list(frames) if frames is not None else [None] * self.num_envs

    def own_state(self) -> dict[str, NDArray[Any]]:
        """Nothing: the environment beneath has it all."""
        return {}

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:  # noqa: ARG002  # there is none
        """The infos of the last step are those of another one now."""
        self._latest = {} if self._latest is None else self._latest

    def _attribute(self, name: str) -> Any:
        if name == "render_mode":
            return self.env.render_mode
        return getattr(self.env, name) if hasattr(self.env, name) else getattr(self.env.unwrapped, name)


def _layers(env: VectorEnv[Any, Any, Any]) -> Iterator[VectorWrapper[Any, Any, Any, Any, Any]]:
    """The wrappers around an environment, the outermost first."""
    while isinstance(env, VectorWrapper):
        yield env
        env = env.env


def _takes_any_mode(wrapper: VectorWrapper[Any, Any, Any, Any, Any]) -> bool:
    """Whether it is known to be right in whatever mode the environment is by now."""
    return type(wrapper) in _INDIFFERENT or bool(vars(type(wrapper)).get("any_autoreset_mode", False))


def _require_same_step(env: VectorEnv[Any, Any, Any]) -> None:
    """Bring the environment into the mode SAME_STEP, if it is not and nobody minds.

    Raises:
        ValueError: Somebody minds.
    """
    base, right = env.unwrapped, AutoresetMode.SAME_STEP
    minding = [layer for layer in _layers(env) if not _takes_any_mode(layer)]
    if isinstance(base, TaskVectorEnv) and not minding:
        base.set_autoreset_mode(right)
    for one in (*minding, base):
        changed = isinstance(base, TaskVectorEnv) and one is not base and base.mode_was_changed
        kept = [value for value in vars(one).values() if isinstance(value, AutoresetMode)]
        if type(one) in _READERS and not kept:
            raise ValueError(
                f"{type(one).__name__} does not know the mode SAME_STEP in this version of Gymnasium; "
                "install gymnasium>=1.4, or leave it out and use VecMonitor or VecNormalize"
            )
        if not changed and all(mode == right for mode in (one.metadata.get("autoreset_mode"), *kept)):
            continue
        if isinstance(one, VectorObservationWrapper):
            raise ValueError(
                f"{type(one).__name__} does not work in the autoreset mode SAME_STEP, which SB3 needs; leave "
                "it out, and change observations around SB3VecEnv (VecNormalize, VecEnvWrapper)"
            )
        raise ValueError(
            f"{type(one).__name__} was not made for the autoreset mode SAME_STEP, which SB3 needs; make the "
            'environment with autoreset_mode="SameStep" before wrapping it'
        )


def _row(observations: Any, row: int) -> Any:
    """One row of observations, in any form that Gymnasium batches them in."""
    if isinstance(observations, dict):
        return {key: _row(value, row) for key, value in observations.items()}
    return observations[row]


def _of_row(infos: dict[str, Any], row: int | tuple[int, int]) -> dict[str, Any]:
    """What infos say of one row, or of a craft of a world, without masks and endings, as Python's numbers."""
    return {
        key: _of_row(value, row) if isinstance(value, dict) else _own(value[row])
        for key, value in infos.items()
        if not key.startswith(("_", "final_")) and (f"_{key}" not in infos or infos[f"_{key}"][row])
    }


def _own(value: Any) -> Any:
    """A copy of an array, and of one entry the number itself; what is neither stays as it is."""
    if not isinstance(value, np.ndarray | np.generic):
        return value
    return value.item() if value.ndim == 0 else value.copy()


class _Recorder(VectorWrapper):
    """Hands everything through, and keeps copies of the observations that it handed through last."""

    remembers_nothing = True
    observations: Any = None
    final: Any = None
    copy_of_final: Any = None

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As below."""
        observations, infos = self.env.reset(seed=seed, options=options)
        self.observations = deepcopy(observations)
        return observations, infos

    def step(self, actions: Any) -> Any:
        """As below."""
        result = self.env.step(actions)
        self.observations, self.final = deepcopy(result[0]), result[4].get("final_obs")
        self.copy_of_final = deepcopy(self.final)
        return result

    def __getattr__(self, name: str) -> Any:
        if name == "env":
            raise AttributeError(name)
        return getattr(self.env, name)


class _Watched:
    """A wrapper that nobody here knows: if it changes observations, it has to change the last ones too.

    Args:
        wrapper: It.
        above: The recorder around it; None where it is the outermost.
    """

    def __init__(self, wrapper: VectorWrapper[Any, Any, Any, Any, Any], above: _Recorder | None) -> None:
        self._name, self._above = type(wrapper).__name__, above
        self._below = _recorder_beneath(wrapper)
        self._changes = False

    def saw_reset(self, observations: Any) -> None:
        """Compare what a reset gave."""
        handed = observations if self._above is None else self._above.observations
        self._changes |= not data_equivalence(handed, self._below.observations, exact=True)

    def check(self, observations: Any, infos: dict[str, Any], done: NDArray[np.bool_]) -> None:
        """Compare what a step gave.

        Raises:
            ValueError: Observations are changed, and those at the end of an episode are not.
        """
        below, above = self._below, self._above
        handed = observations if above is None else above.observations
        self._changes |= not data_equivalence(handed, below.observations, exact=True)
        if not (self._changes and done.any()):
            return
        final = infos["final_obs"] if above is None else above.final
        now = final if above is None else above.copy_of_final
        if not _same_rows(below.copy_of_final, now, np.flatnonzero(done)).all():
            return
        if final is below.final or not _same_rows(below.observations, handed, np.arange(done.size)).any():
            raise ValueError(
                f"{self._name} changes observations, but not those at the end of an episode, so that the "
                "terminal observation would be a wrong one; it has to put an array of its own into "
                'infos["final_obs"]'
            )


def _same_rows(first: Any, second: Any, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    return np.array([data_equivalence(_row(first, i), _row(second, i), exact=True) for i in rows])


def _recorder_beneath(wrapper: VectorWrapper[Any, Any, Any, Any, Any]) -> _Recorder:
    if not isinstance(wrapper.env, _Recorder):
        wrapper.env = _Recorder(wrapper.env)
    return wrapper.env


def _watched(env: VectorEnv[Any, Any, Any]) -> list[_Watched]:
    """The wrappers that have to be watched, each with a recorder beneath and one above."""
    watched, parent = [], None
    for layer in list(_layers(env)):
        if isinstance(layer, _Recorder):
            continue
        if not _takes_any_mode(layer) and type(layer) not in (*_READERS, *_PICTURES):
            watched.append(_Watched(layer, None if parent is None else _recorder_beneath(parent)))
        parent = layer
    return watched


class SharedPolicyVecEnv(MidEpisode, _BatchVecEnv):
    """Formations under one shared policy: every commanded craft of every world is one row.

    Rows are world-major. All craft of a world end together; each gets its own terminal observation, and a
    time limit is marked as such. The options of a world are those of the row of its first craft; its other
    rows have the same, or none.

    Args:
        num_worlds: Number of formations.
        max_episode_steps: Time limit; None takes the task's own.
        threads: Threads that share a step; None chooses.
        flat_info: Whether :meth:`latest_info` has no dictionaries in it, but keys like ``reward_terms/fuel``.
        task_type: Of which task, :class:`~thruster_envs.tasks.FormationKeeping` or
            :class:`~thruster_envs.tasks.FormationAttitude`.
        **configuration: Fields of the task's configuration.
    """

    def __init__(
        self,
        num_worlds: int,
        *,
        max_episode_steps: int | None = None,
        threads: int | None = None,
        flat_info: bool = False,
        task_type: type[Task] = FormationKeeping,
        **configuration: Any,
    ) -> None:
        others = ("num_worlds", "max_episode_steps", "threads", "flat_info", "task_type")
        self.task = make_task(task_type, configuration, {}, others, type(self).__name__)
        self.flat_info = checked_flag("flat_info", flat_info)
        limit = max_episode_steps if max_episode_steps is not None else self.task.max_episode_steps
        self.worlds = Worlds(self.task, num_worlds, max_episode_steps=limit, threads=threads)
        self.craft = len(self.task.agents)
        super().__init__(num_worlds * self.craft, observation_space(self.task), action_space(self.task))

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode in every world; the seed of a world is that of its first craft's row."""
        everyone = np.arange(self.worlds.number)
        seeds, options = self._seeds[:: self.craft], self._options_of_worlds()
        given = {world: checked_seed(seed) for world, seed in enumerate(seeds) if seed is not None}
        if not self.worlds.seeded:
            fresh = checked_seed(np.random.SeedSequence().entropy)
            given = {world: fresh + world for world in range(self.worlds.number)} | given
        self.worlds.seed(np.array(list(given), np.int64), list(given.values()))
        self.worlds.reset(everyone, options)
        self._latest = self._info(None)
        self._consumed()
        return self._rows(self.worlds.observe())

    def _options_of_worlds(self) -> dict[str, Any] | None:
        """The options of all worlds as one dict, the faults of each in a list."""
        firsts = self._options[:: self.craft]
        for row, options in enumerate(self._options):
            if options and options != firsts[row // self.craft]:
                raise ValueError(
                    f"the options of row {row} are not those of its world's first row, "
                    f"{row - row % self.craft}; rows of one world must have the same options, or none"
                )
        if all(options == firsts[0] for options in firsts):
            return firsts[0] or None
        source, own = self.task.faults_from, self.task.faults
        return {"faults": [source(options.get("faults", own)) for options in firsts]}

    def _reset_rows(
        self, rows: list[int], *, seed: Any = None, options: Mapping[str, Any] | None = None
    ) -> list[Any]:
        worlds = np.unique(np.array(rows) // self.craft)
        if len(set(rows)) < worlds.size * self.craft:
            raise ValueError(f"rows of one world are reset together, all {self.craft} of them; got {rows}")
        if worlds.size < self.worlds.number and not self.worlds.begun:
            raise ValueError("no world has been reset yet; call reset() before that of some rows")
        if seed is not None or not self.worlds.seeded:
            own = checked_seed(np.random.SeedSequence().entropy if seed is None else seed)
            self.worlds.seed(worlds, [own if seed is not None else own + int(world) for world in worlds])
        self.worlds.reset(worlds, options)
        self._latest = self._info(None)
        observations = self._rows(self.worlds.observe())
        return [(observations[row], _of_row(self._latest, divmod(row, self.craft))) for row in rows]

    def _info(self, step: Step | None) -> dict[str, Any]:
        info = self.worlds.info(step)
        return flattened(info) if self.flat_info else info

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One step of every world."""
        self.worlds.require_reset("step")
        shape = (self.num_envs, *(self.action_space.shape or ()))
        actions = checked_actions(self.actions, shape, switches=self.task.choices is not None)
        step = self.worlds.step(actions.reshape(self.worlds.number, self.craft, -1))
        observations = self._rows(step.observations)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._latest = self._info(step)
        over = np.flatnonzero(step.done)
        if over.size:
            for world in over:
                for c in range(self.craft):
                    info = infos[world * self.craft + c] = _of_row(self._latest, (int(world), c))
                    info["terminal_observation"] = step.observations[world, c]
                    info["TimeLimit.truncated"] = bool(step.truncated[world] and not step.terminated[world])
            self.worlds.reset(over)
            observations = self._rows(self.worlds.observe())
        rewards = step.rewards.reshape(-1).astype(np.float32)
        return observations, rewards, np.repeat(step.done, self.craft), infos

    def _set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:  # noqa: ARG002  # worlds have it all
        self._latest = self._info(None)

    def _rows(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return observations.reshape(self.num_envs, -1)

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """No pictures: the formations of this view are not drawn."""
        return [None] * self.num_envs

    def close(self) -> None:
        """Nothing to close."""

    def _attribute(self, name: str) -> Any:
        return None if name == "render_mode" else getattr(self, name)
