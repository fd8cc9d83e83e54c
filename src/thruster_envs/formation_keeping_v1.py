"""Formation keeping as a PettingZoo module: ``parallel_env``, ``env`` (one agent at a time) and ``raw_env``.

Importing it registers ``thruster_envs/formation_keeping_v1`` with PettingZoo, one form in each of its tables.

>>> from thruster_envs import formation_keeping_v1
>>> env = formation_keeping_v1.parallel_env(craft=2)
>>> observations, infos = env.reset(seed=0)
>>> sorted(observations)
['craft_1', 'craft_2']
"""

from __future__ import annotations

from typing import Any

from thruster_envs.extras import extra
from thruster_envs.views.parallel import FormationParallelEnv, register_parallel

with extra("multi-agent", __name__):
    import pettingzoo
    from pettingzoo.utils.conversions import parallel_to_aec
    from pettingzoo.utils.wrappers import OrderEnforcingWrapper

__all__ = ["env", "parallel_env", "raw_env"]

#: Under which PettingZoo finds the environment, as in ``pettingzoo.make("parallel", ID)``.
ID = "thruster_envs/formation_keeping-v1"


def parallel_env(**kwargs: Any) -> FormationParallelEnv:
    """All agents act at once. Arguments as of :class:`~thruster_envs.views.FormationParallelEnv`."""
    return FormationParallelEnv(**kwargs)


def raw_env(**kwargs: Any) -> pettingzoo.AECEnv[str, Any, Any]:
    """Agents act one after another, through PettingZoo's own conversion."""
    return parallel_to_aec(parallel_env(**kwargs))


def env(**kwargs: Any) -> pettingzoo.AECEnv[str, Any, Any]:
    """:func:`raw_env` with a clear error for calls in the wrong order."""
    return OrderEnforcingWrapper(raw_env(**kwargs))


register_parallel(ID, __name__)
