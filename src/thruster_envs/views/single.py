"""The batch of one as a Gymnasium ``Env``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from thruster_envs.configuration import from_mapping, suggestion
from thruster_envs.construction import Unrecorded
from thruster_envs.tasks import Task
from thruster_envs.views.inputs import checked_actions, checked_seed
from thruster_envs.views.making import view_of_path
from thruster_envs.views.scenes import RENDER_MODES, Camera
from thruster_envs.views.spaces import action_space, observation_space
from thruster_envs.views.specs import stated
from thruster_envs.views.states import MidEpisode
from thruster_envs.views.worlds import Step, Worlds

Observation = NDArray[np.float32]
_ONE = np.zeros(1, np.int64)


class TaskEnv(MidEpisode, gym.Env[Observation, Any]):
    """One world of a task, one commanded craft.

    Subclasses name the task; those that nobody has written are made (:mod:`thruster_envs.views.making`).

    Args:
        render_mode: None, ``"rgb_array"`` or ``"human"``.
        flat_info: Whether ``info`` has no dictionaries in it, but keys like ``reward_terms/fuel``, and NumPy
            scalars and arrays instead of Python's numbers.
        **configuration: Fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": 20}  # type: ignore[misc]  # Gymnasium declares an instance attribute
    task_type: ClassVar[type[Task]]
    _spec: EnvSpec | None = None

    def __init__(
        self, *, render_mode: str | None = None, flat_info: bool = False, **configuration: Any
    ) -> None:
        self.task = self.task_of(**configuration)
        self.flat_info = checked_flag("flat_info", flat_info)
        self.render_mode = checked_render_mode(render_mode)
        self.worlds = Worlds(self.task, 1)
        self.observation_space = observation_space(self.task)
        self.action_space = action_space(self.task)
        self._action_shape = self.action_space.shape or ()
        self._camera = Camera(self.worlds, 0, type(self).__name__.removesuffix("Env"))

    @classmethod
    def task_of(cls, **configuration: Any) -> Task:
        """The task that an environment of this configuration has.

        Raises:
            TypeError: An unknown field.
            ValueError: A field that is not for the user to choose, or a value that cannot be.
        """
        others = ("render_mode", "flat_info")
        return make_task(cls.task_type, configuration, cls.task_type.one_agent, others, cls.__name__)

    @property
    def spec(self) -> EnvSpec | None:
        """How to make this environment again, as plain data."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = stated(spec, self.task)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; ``options={"faults": ...}`` gives it faults of its own."""
        given = None if seed is None else checked_seed(seed)
        if given is not None or not self.worlds.seeded:
            self.worlds.seed(_ONE, [seed_in_use(self) if given is None else given])
        self.worlds.reset(_ONE, options)
        super().reset(seed=given)
        self._camera.watch(begins=True, mode=self.render_mode)
        now = self.worlds.now()
        return now.observations[0, 0], self._info(now)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let one control period pass under ``action``."""
        worlds = self.worlds
        worlds.require_reset("step")
        actions = checked_actions(action, self._action_shape, switches=self.task.choices is not None)
        step = worlds.step(actions.reshape((1, 1, -1)))
        if self.render_mode is not None:
            self._camera.watch(begins=False, mode=self.render_mode)
        terminated, truncated = step.ends[:, 0].tolist()
        return step.observations[0, 0], step.numbers.item(-1), terminated, truncated, self._info(step)

    def _info(self, step: Step) -> dict[str, Any]:
        return info_of_agent(self.worlds, step, 0, flat=self.flat_info)

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the world now, in the mode ``rgb_array``."""
        self.worlds.require_reset("render")
        if self.render_mode == "rgb_array":
            return self._camera.frame()
        if self.render_mode == "human":
            self._camera.show()
            return None
        raise gym.error.Error(
            "render_mode is None; make the environment with render_mode='rgb_array' or 'human'"
        )

    def _set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:  # noqa: ARG002  # the path begins anew
        if self.render_mode is not None and self.worlds.begun:
            self._camera.begin()

    def close(self) -> None:
        """Close the window, if there is one."""
        if hasattr(self, "_camera"):  # not where the constructor failed
            self._camera.close()


def seed_in_use(env: gym.Env[Any, Any] | VectorEnv[Any, Any, Any]) -> int:
    """The seed of an environment's generator, with which a reset repeats what it begins with now."""
    generator, seed = env.np_random, env.np_random_seed
    if not isinstance(seed, int) or seed < 0:  # somebody has set the generator
        return int(generator.integers(2**63))
    return checked_seed(seed)


def info_of_agent(worlds: Worlds, step: Step, agent: int, *, flat: bool) -> dict[str, Any]:
    """What the info of a batch of one says of an agent.

    Python's numbers, and arrays over the fault slots; where it is to be flat, NumPy's scalars instead.
    """
    if not flat:
        return worlds.info_of_one(step, agent)
    return {
        key: value[0].copy() if value.ndim > 1 else value[0]
        for key, value in flattened(worlds.info_of(step, agent)).items()
    }


def flattened(info: dict[str, Any], before: str = "") -> dict[str, Any]:
    """The entries of an info with the path to each as its key: ``reward_terms/fuel``."""
    result: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, dict):
            result |= flattened(value, f"{before}{key}/")
        else:
            result[f"{before}{key}"] = value
    return result


def checked_flag(name: str, value: Any) -> bool:
    """True or False, and nothing else.

    Raises:
        ValueError: Anything else.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def make_task(
    task_type: type[Task],
    configuration: dict[str, Any],
    fixed: dict[str, Any],
    others: tuple[str, ...],
    view: str,
) -> Task:
    """The task's configuration from keyword arguments.

    Args:
        task_type: Whose configuration.
        configuration: What the user gave.
        fixed: What is not for the user to choose.
        others: Names of the arguments that the view takes beside the configuration.
        view: Name of the view's class.

    Raises:
        TypeError: An unknown name, as Python words it, with the nearest known one. Clients that try which
            arguments an environment takes read these words.
        ValueError: A name that is fixed, or a value that is wrong.
    """
    names = [field.name for field in fields(task_type) if field.init]
    for key in configuration:
        if key in fixed:
            raise ValueError(f"{key} is always {fixed[key]!r} here; leaving it out would be right")
        if key not in names:
            known = [*others, *(name for name in names if name not in fixed)]
            raise TypeError(
                f"{view}.__init__() got an unexpected keyword argument {key!r}; {suggestion(key, known)}"
            )
    given = {
        name: value.thing if isinstance(value, Unrecorded) else value for name, value in configuration.items()
    }
    return from_mapping(task_type, given | fixed, task_type.__name__)


def checked_render_mode(mode: str | None) -> str | None:
    """The render mode, if it is one that every environment has."""
    if mode is not None and mode not in RENDER_MODES:
        raise ValueError(f"render_mode is {mode!r}; None, 'rgb_array' or 'human' would be right")
    return mode


def __getattr__(name: str) -> Any:
    """The single environment of a task, by the path to its class with slashes."""
    if "/" in name:
        return view_of_path(TaskEnv, name, "Env")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
