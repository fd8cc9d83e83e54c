"""What an environment's ``EnvSpec`` says: its arguments as plain data, and a bound on an episode's length."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gymnasium.envs.registration import EnvSpec

from thruster_envs.configuration import as_plain
from thruster_envs.construction import Unrecorded
from thruster_envs.spacecraft import catalogue
from thruster_envs.tasks import Task


def stated(spec: EnvSpec | None, task: Task, limit: int | None = None) -> EnvSpec | None:
    """The specification that Gymnasium gave an environment, so that it survives JSON.

    A spacecraft that is not of the catalogue is described in full: the specification holds wherever and
    whenever it is read, whatever became of the file.

    Args:
        spec: From ``gym.make`` or ``gym.make_vec``.
        task: The configuration of the environment.
        limit: Time limit of the environment itself; None for none.
    """
    if spec is None:
        return None
    kwargs, bound = dict(spec.kwargs), _bound(spec, task, limit)
    if task.steps is not None and bound == task.steps + 1 and kwargs.get("max_episode_steps") == bound:
        del kwargs["max_episode_steps"]  # made from such a specification: a bound there, and no argument
    source = kwargs.get("spacecraft", "")
    if not (isinstance(source, str) and (not source or source in catalogue())):
        kwargs["spacecraft"] = task.vehicle
    plain = {name: _plain(value) for name, value in kwargs.items()}
    return replace(spec, kwargs=plain, max_episode_steps=bound)


def _plain(value: Any) -> Any:
    try:
        return as_plain(value)
    except TypeError:  # a user's pilot, say: JSON has its name only
        return Unrecorded.of(value)


def _bound(spec: EnvSpec, task: Task, limit: int | None) -> int | None:
    """Steps that no episode exceeds.

    Where the task itself ends the episode it is one more than that takes: a ``TimeLimit`` made from the
    specification never cuts what the task ends.
    """
    own = None if task.steps is None else task.steps + 1
    bounds = [bound for bound in (limit, own) if bound is not None]
    return min(bounds) if bounds else spec.max_episode_steps
