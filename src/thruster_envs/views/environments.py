"""The environments by name, each with the page that documents it."""

from __future__ import annotations

from typing import Any, ClassVar

from thruster_envs.tasks import FormationKeeping, OrionRendezvous, Task, ThrusterMapping
from thruster_envs.views.single import TaskEnv
from thruster_envs.views.vector import TaskVectorEnv


class ThrusterMappingEnv(TaskEnv):
    """PAGE"""

    task_type: ClassVar[type[Task]] = ThrusterMapping


class ThrusterMappingVectorEnv(TaskVectorEnv):
    __doc__ = ThrusterMappingEnv.__doc__
    task_type: ClassVar[type[Task]] = ThrusterMapping


class OrionRendezvousEnv(TaskEnv):
    """PAGE"""

    task_type: ClassVar[type[Task]] = OrionRendezvous


class OrionRendezvousVectorEnv(TaskVectorEnv):
    __doc__ = OrionRendezvousEnv.__doc__
    task_type: ClassVar[type[Task]] = OrionRendezvous


class FormationKeepingEnv(TaskEnv):
    """PAGE"""

    task_type: ClassVar[type[Task]] = FormationKeeping
    fixed: ClassVar[dict[str, Any]] = {"commanded": 1}


class FormationKeepingVectorEnv(TaskVectorEnv):
    __doc__ = FormationKeepingEnv.__doc__
    task_type: ClassVar[type[Task]] = FormationKeeping
    fixed: ClassVar[dict[str, Any]] = {"commanded": 1}
