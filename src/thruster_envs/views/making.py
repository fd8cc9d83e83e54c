"""Views of a task that are made, not written: its class is all that they need.

A view of a task has a name that says where the task is found: ``thruster_envs.views.single:mine/Docking`` is
the single environment of the class ``Docking`` of the module ``mine``. Entry points of Gymnasium have that
form, and so do pickles: wherever the task can be imported, so can its views.
"""

from __future__ import annotations

import types
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from thruster_envs.tasks import Task

if TYPE_CHECKING:
    from thruster_envs.views.single import TaskEnv
    from thruster_envs.views.vector import TaskVectorEnv

View = TypeVar("View", bound=type[Any])


def view_of_path(base: View, name: str, ending: str) -> View:
    """The view of a task by the path to its class.

    Args:
        base: ``TaskEnv``, ``TaskVectorEnv`` or ``TaskParallelEnv``.
        name: Modules and class, separated by slashes.
        ending: Of the name of the view's class.

    Raises:
        AttributeError: There is no task there.
    """
    path, _, attribute = name.rpartition("/")
    module = path.replace("/", ".")
    try:
        task_type = getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        raise AttributeError(f"{name!r} names no task: {error}") from None
    if not (isinstance(task_type, type) and issubclass(task_type, Task)):
        raise AttributeError(f"{name!r} must be a subclass of Task, got {task_type!r}")
    view: Any = base
    made: View = _made(view, task_type, f"{attribute}{ending}", base.__module__, name, task_type.__doc__)
    return made


def vector_form(single: type[TaskEnv]) -> type[TaskVectorEnv]:
    """The vector form of a single environment, for the package of the latter's module."""
    from thruster_envs.views.vector import TaskVectorEnv

    name = f"{single.__name__.removesuffix('Env')}VectorEnv"
    page = f"Many worlds of :class:`{single.__name__}`, which describes one."
    package = single.__module__.rpartition(".")[0]
    made: type[TaskVectorEnv] = _made(TaskVectorEnv, single.task_type, name, package, name, page)
    return made


@cache
def _made(base: Any, task_type: type[Task], name: str, module: str, path: str, page: str | None) -> Any:
    entries = {"task_type": task_type, "__module__": module, "__qualname__": path, "__doc__": page}
    if "metadata" in vars(base):
        entries["metadata"] = base.metadata | {"name": name}
    return types.new_class(name, (base,), exec_body=lambda namespace: namespace.update(entries))
