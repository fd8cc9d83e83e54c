"""Formation keeping with the reward of v0 as a PettingZoo module, for one version more.

>>> import warnings
>>> from thruster_envs import formation_keeping_v0
>>> with warnings.catch_warnings(action="ignore"):
...     env = formation_keeping_v0.parallel_env(craft=2)
>>> observations, infos = env.reset(seed=0)
>>> sorted(observations)
['craft_1', 'craft_2']
"""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

from thruster_envs.extras import extra
from thruster_envs.tasks import Task
from thruster_envs.tasks.former import FormerFormationKeeping
from thruster_envs.views.parallel import TaskParallelEnv, register_parallel

with extra("multi-agent", __name__):
    import pettingzoo
    from pettingzoo.utils.conversions import parallel_to_aec
    from pettingzoo.utils.wrappers import OrderEnforcingWrapper

__all__ = ["FormerFormationParallelEnv", "env", "parallel_env", "raw_env"]

#: Under which PettingZoo finds the environment, as in ``pettingzoo.make("parallel", ID)``.
ID = "thruster_envs/formation_keeping-v0"


class FormerFormationParallelEnv(TaskParallelEnv):
    """The environment of :mod:`thruster_envs.formation_keeping_v1` with its former reward."""

    metadata: ClassVar[dict[str, Any]] = TaskParallelEnv.metadata | {"name": "formation_keeping_v0"}
    task_type: ClassVar[type[Task]] = FormerFormationKeeping


def parallel_env(**kwargs: Any) -> FormerFormationParallelEnv:
    """All agents act at once; arguments as in :mod:`thruster_envs.formation_keeping_v1`."""
    warnings.warn(
        f"{ID} is out of date; use formation_keeping_v1, whose reward no loss can raise",
        DeprecationWarning,
        stacklevel=2,
    )
    return FormerFormationParallelEnv(**kwargs)


def raw_env(**kwargs: Any) -> pettingzoo.AECEnv[str, Any, Any]:
    """Agents act one after another, through PettingZoo's own conversion."""
    return parallel_to_aec(parallel_env(**kwargs))


def env(**kwargs: Any) -> pettingzoo.AECEnv[str, Any, Any]:
    """:func:`raw_env` with a clear error for calls in the wrong order."""
    return OrderEnforcingWrapper(raw_env(**kwargs))


register_parallel(ID, __name__)
