"""Batches as Stable-Baselines3 ``VecEnv``: one agent per world, or every craft under one shared policy.

At the end of an episode ``infos[i]`` has ``terminal_observation`` and ``TimeLimit.truncated``, so that
on-policy algorithms bootstrap over a time limit and off-policy ones store the true last observation; it also
has the last ``score``, ``success``, ``cost`` and ``fuel``. While an episode runs the infos are empty
dictionaries: thousands of them would cost more than the physics. :meth:`latest_info` has everything, as
arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from thruster_envs.extras import extra
from thruster_envs.tasks import FormationKeeping, Task
from thruster_envs.views.single import make_task
from thruster_envs.views.spaces import action_space, observation_space
from thruster_envs.views.vector import TaskVectorEnv
from thruster_envs.views.worlds import Worlds, checked_seed

with extra("sb3", __name__):
    from stable_baselines3.common.vec_env import VecEnv

#: Keys of the last info of an episode that are handed on, beside the two that SB3 knows.
FINAL_KEYS = ("score", "success", "cost", "fuel")


class _BatchVecEnv(VecEnv):
    """What both adapters share: the calls of ``VecEnv`` that do not depend on what is stepped."""

    actions: NDArray[np.float64]

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
        """The batch's method, called once; its result for each index."""
        result = self._attribute(method_name)(*args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:  # noqa: ARG002  # SB3's signature
        """Single-environment wrappers are never there."""
        return [False for _ in self._get_indices(indices)]

    def _attribute(self, name: str) -> Any:
        raise NotImplementedError


class SB3VecEnv(_BatchVecEnv):
    """A native vector environment as a Stable-Baselines3 ``VecEnv``.

    Args:
        env: From ``gym.make_vec``; one of this suite (wrapped or not) in any autoreset mode, or anyone's in
            the mode SAME_STEP.

    Raises:
        ValueError: Someone else's environment in another autoreset mode.

    Example:
        ``PPO("MlpPolicy", SB3VecEnv(gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=256)))``
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self.env = env
        if isinstance(env.unwrapped, TaskVectorEnv):
            env.unwrapped.set_autoreset_mode(AutoresetMode.SAME_STEP)
        elif env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"the autoreset mode is {env.metadata.get('autoreset_mode')}; "
                "AutoresetMode.SAME_STEP would be right"
            )
        self._latest: dict[str, Any] = {}
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode in every world, with what :meth:`seed` and :meth:`set_options` were given."""
        seed = None if all(one is None for one in self._seeds) else self._seeds
        options = next((one for one in self._options if one), None)
        env: Any = self.env  # Gymnasium types the seed of a vector environment as one number
        observations, self._latest = env.reset(seed=seed, options=options)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return np.asarray(observations)

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One step of every world."""
        observations, rewards, terminated, truncated, latest = self.env.step(self.actions)
        self._latest = latest
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        final = latest.get("final_info", {})
        for i in np.flatnonzero(done):
            infos[i]["terminal_observation"] = latest["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            infos[i].update({key: final[key][i].item() for key in FINAL_KEYS if key in final})
        return observations, rewards.astype(np.float32), done, infos

    def latest_info(self) -> dict[str, Any]:
        """The infos of the last step or reset as the vector environment gave them: arrays over the worlds."""
        return self._latest

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Pictures of the worlds, if it was made with ``render_mode="rgb_array"``."""
        frames: Any = self.env.render() if self.env.render_mode == "rgb_array" else None
        return list(frames) if frames is not None else [None] * self.num_envs

    def _attribute(self, name: str) -> Any:
        if name == "render_mode":
            return self.env.render_mode
        return getattr(self.env, name) if hasattr(self.env, name) else getattr(self.env.unwrapped, name)


class SharedPolicyVecEnv(_BatchVecEnv):
    """Formations under one shared policy: every commanded craft of every world is one row.

    Rows are world-major. All craft of a world end together; each gets its own terminal observation, and a
    time limit is marked as such.

    Args:
        num_worlds: Number of formations.
        max_episode_steps: Time limit; None takes the task's own.
        threads: Threads that share a step; None chooses.
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
        task_type: type[Task] = FormationKeeping,
        **configuration: Any,
    ) -> None:
        others = ("num_worlds", "max_episode_steps", "threads", "task_type")
        self.task = make_task(task_type, configuration, {}, others, type(self).__name__)
        limit = max_episode_steps if max_episode_steps is not None else self.task.max_episode_steps
        self.worlds = Worlds(self.task, num_worlds, max_episode_steps=limit, threads=threads)
        self.craft = len(self.task.agents)
        self._latest: dict[str, Any] = {}
        super().__init__(num_worlds * self.craft, observation_space(self.task), action_space(self.task))

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode in every world; the seed of a world is that of its first craft's row."""
        seeds = self._seeds[:: self.craft]
        if not self.worlds.seeded or all(seed is not None for seed in seeds):
            fresh = int(np.random.SeedSequence().entropy) >> 66 if any(seed is None for seed in seeds) else 0  # type: ignore[arg-type]  # an int
            given = [
                fresh + world if seed is None else checked_seed(seed) for world, seed in enumerate(seeds)
            ]
            self.worlds.seed(np.arange(self.worlds.number), given)
        self.worlds.reset(np.arange(self.worlds.number), next((one for one in self._options if one), None))
        self._latest = self.worlds.info()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return self._rows(self.worlds.observe())

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One step of every world."""
        actions = np.asarray(self.actions).reshape(self.worlds.number, self.craft, -1)
        step = self.worlds.step(actions)
        observations = self._rows(step.observations)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._latest = self.worlds.info(step)
        over = np.flatnonzero(step.done)
        if over.size:
            for world in over:
                for c in range(self.craft):
                    info = infos[world * self.craft + c]
                    info["terminal_observation"] = step.observations[world, c]
                    info["TimeLimit.truncated"] = bool(step.truncated[world] and not step.terminated[world])
                    info.update({key: self._latest[key][world, c].item() for key in FINAL_KEYS})
            self.worlds.reset(over)
            observations = self._rows(self.worlds.observe())
        rewards = step.rewards.reshape(-1).astype(np.float32)
        return observations, rewards, np.repeat(step.done, self.craft), infos

    def _rows(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return observations.reshape(self.num_envs, -1)

    def latest_info(self) -> dict[str, Any]:
        """What ``info`` carries, (worlds, craft) arrays; at an ending those of the episode's last step."""
        return self._latest

    def close(self) -> None:
        """Nothing to close."""

    def _attribute(self, name: str) -> Any:
        return None if name == "render_mode" else getattr(self, name)
