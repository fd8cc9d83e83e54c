"""The table of ids under which Gymnasium finds the environments, to which users add rows of their own.

A row names the views of a task as texts; nothing of them is loaded before it is made. For a task of one's own
there is nothing to write but the task:

>>> import gymnasium as gym
>>> from thruster_envs.tasks import OrionRendezvous
>>> register("mine/ShortRendezvous-v0", OrionRendezvous, orbits=0.25)
>>> env = gym.make("mine/ShortRendezvous-v0")
>>> env.unwrapped.task.orbits
0.25
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

import gymnasium as gym

__all__ = ["ENVIRONMENTS", "FORMER", "Row", "make_parallel", "register", "register_all"]

_VIEWS = "thruster_envs.views"


class Row(NamedTuple):
    """Where the views of a task are found, as ``module:attribute``.

    Attributes:
        single: Of one world, for ``gym.make``.
        vector: Of many worlds, for ``gym.make_vec``.
        max_episode_steps: Time limit; None where the task itself ends an episode.
        parallel: Of a PettingZoo environment, for tasks of several craft; None for the others.
    """

    single: str
    vector: str
    max_episode_steps: int | None
    parallel: str | None = None


def _row(name: str, max_episode_steps: int | None, parallel: str | None = None) -> Row:
    views = f"{_VIEWS}.environments:{name}"
    return Row(
        f"{views}Env",
        f"{views}VectorEnv",
        max_episode_steps,
        None if parallel is None else f"{_VIEWS}.parallel:{parallel}",
    )


def _former(name: str, max_episode_steps: int | None, parallel: str | None = None) -> Row:
    path = f"thruster_envs/tasks/former/Former{name}"
    team = None if parallel is None else f"thruster_envs.{parallel}"
    return Row(f"{_VIEWS}.single:{path}", f"{_VIEWS}.vector:{path}", max_episode_steps, team)


#: Those that go on for one version beside their successors, with the reward that they had.
FORMER: dict[str, Row] = {
    "thruster_envs/OrionRendezvous-v0": _former("OrionRendezvous", None),
    "thruster_envs/MarsRendezvous-v0": _former("MarsRendezvous", None),
    "thruster_envs/FormationKeeping-v0": _former(
        "FormationKeeping", 120, "formation_keeping_v0:FormerFormationParallelEnv"
    ),
    "thruster_envs/FormationAttitude-v0": _former(
        "FormationAttitude", 3000, "formation_attitude_v0:FormerFormationAttitudeParallelEnv"
    ),
    "thruster_envs/FaultDiagnosis-v0": _former("FaultDiagnosis", 120),
    "thruster_envs/ActiveDiagnosis-v0": _former("ActiveDiagnosis", 120),
}

#: The environments of this suite. :func:`register` adds no row to it.
ENVIRONMENTS: dict[str, Row] = {
    "thruster_envs/ThrusterMapping-v0": _row("ThrusterMapping", 32),
    "thruster_envs/OrionRendezvous-v1": _row("OrionRendezvous", None),
    "thruster_envs/MarsRendezvous-v1": _row("MarsRendezvous", None),
    "thruster_envs/FormationKeeping-v1": _row("FormationKeeping", 120, "FormationParallelEnv"),
    "thruster_envs/FormationAttitude-v1": _row("FormationAttitude", 3000, "FormationAttitudeParallelEnv"),
    "thruster_envs/FaultDiagnosis-v1": _row("FaultDiagnosis", 120),
    "thruster_envs/ActiveDiagnosis-v1": _row("ActiveDiagnosis", 120),
    "thruster_envs/PulseDiagnosis-v0": _row("PulseDiagnosis", 64),
}

#: Rows of users by id, and the settings that they were registered with.
_OWN: dict[str, tuple[Row, dict[str, Any]]] = {}


def register_all() -> None:
    """Register every id that is not registered yet."""
    for identifier, row in (FORMER | ENVIRONMENTS).items():
        if identifier not in gym.registry:
            _register(identifier, row, {})


def register(identifier: str, task: Any, *, max_episode_steps: int | None = None, **settings: Any) -> None:
    """Register a task of your own: its single, vector and parallel environments are made from its class.

    Afterwards ``gym.make`` and ``gym.make_vec`` know the id; :func:`make_parallel`, and ``pettingzoo.make``
    where PettingZoo has a table, know those of which several craft are commanded. An id that was registered
    here before is replaced.

    Args:
        identifier: ``namespace/Name-v0``.
        task: A subclass of :class:`~thruster_envs.tasks.Task`, at the top level of a module.
        max_episode_steps: Time limit; None takes the task's own.
        **settings: Fields of the task that differ from its defaults.

    Raises:
        TypeError: Something else than such a class; an unknown setting.
        ValueError: An id that is somebody else's; a setting that cannot be; a task of several agents that
            does not say how to leave one (``one_agent``).
    """
    from thruster_envs.tasks import Task
    from thruster_envs.views.single import make_task

    if not isinstance(identifier, str):
        raise TypeError(f"identifier must be a string, got {identifier!r}")
    try:
        gym.envs.registration.parse_env_id(identifier)
    except gym.error.Error as error:
        raise ValueError(f"identifier must be like namespace/Name-v0, got {identifier!r}") from error
    own = isinstance(task, type) and issubclass(task, Task) and task is not Task
    if not own or "." in task.__qualname__:
        raise TypeError(f"task must be a subclass of Task at the top level of a module, got {task!r}")
    if identifier in gym.registry and identifier not in _OWN:
        raise ValueError(f"identifier must be new, got {identifier!r}, which is registered elsewhere")
    limit = task.max_episode_steps if max_episode_steps is None else max_episode_steps
    if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int) or limit < 1):
        raise ValueError(f"max_episode_steps must be at least 1 and whole, got {limit!r}")
    alone = make_task(task, settings, task.one_agent, (), task.__name__)
    if len(alone.agents) != 1:
        raise ValueError(
            f"one_agent of {task.__name__} must leave one agent, got {task.one_agent!r}, which leaves "
            f"{', '.join(alone.agents)}"
        )
    several = len(make_task(task, settings, {}, (), task.__name__).agents) > 1
    path = f"{task.__module__}.{task.__name__}".replace(".", "/")
    single, vector, parallel = (f"{_VIEWS}.{form}:{path}" for form in ("single", "vector", "parallel"))
    row = Row(single, vector, limit, parallel if several else None)
    _OWN[identifier] = row, settings
    gym.registry.pop(identifier, None)
    _register(identifier, row, settings)
    if several and find_spec("pettingzoo") is not None:
        from thruster_envs.views.parallel import register_view

        register_view(identifier, parallel, _of_parallel(row, settings))


def make_parallel(identifier: str, **settings: Any) -> Any:
    """The PettingZoo environment of an id of which several craft are commanded.

    Args:
        identifier: As in ``gym.make``.
        **settings: Arguments of the environment.

    Raises:
        ValueError: An id without such an environment.

    >>> make_parallel("thruster_envs/FormationKeeping-v1", craft=2).possible_agents
    ['craft_1', 'craft_2']
    """
    row, own = _OWN.get(identifier, ((FORMER | ENVIRONMENTS).get(identifier), {}))
    if row is None or row.parallel is None:
        known = [one for one, (each, _) in _OWN.items() if each.parallel]
        known += [one for one, each in ENVIRONMENTS.items() if each.parallel]
        raise ValueError(f"identifier must be one of {', '.join(known)}, got {identifier!r}")
    module, _, name = row.parallel.partition(":")
    return getattr(import_module(module), name)(**_of_parallel(row, own) | settings)


def _of_parallel(row: Row, settings: dict[str, Any]) -> dict[str, Any]:
    return {"max_cycles": row.max_episode_steps} | settings


def _register(identifier: str, row: Row, settings: dict[str, Any]) -> None:
    gym.register(
        identifier,
        entry_point=row.single,
        vector_entry_point=row.vector,
        max_episode_steps=row.max_episode_steps,
        kwargs=settings,
    )
