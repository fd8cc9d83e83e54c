"""A formation that turns by pulses as a PettingZoo module: ``parallel_env``, ``env`` and ``raw_env``.

Importing it registers ``thruster_envs/formation_attitude_v1`` with PettingZoo, a form in each of its tables.

>>> from thruster_envs import formation_attitude_v1
>>> env = formation_attitude_v1.parallel_env(command_leader=True)
>>> observations, infos = env.reset(seed=0)
>>> list(observations)
['leader', 'follower_1', 'follower_2']
"""

from __future__ import annotations

from typing import Any

from thruster_envs.extras import extra
from thruster_envs.views.parallel import FormationAttitudeParallelEnv, register_parallel

with extra("multi-agent", __name__):
    import pettingzoo
    from pettingzoo.utils.conversions import parallel_to_aec
    from pettingzoo.utils.wrappers import OrderEnforcingWrapper

__all__ = ["env", "parallel_env", "raw_env"]

#: Under which PettingZoo finds the environment, as in ``pettingzoo.make("parallel", ID)``.
ID = "thruster_envs/formation_attitude-v1"


def parallel_env(**kwargs: Any) -> FormationAttitudeParallelEnv:
    """All agents act at once; arguments as of :class:`~thruster_envs.views.FormationAttitudeParallelEnv`."""
    return FormationAttitudeParallelEnv(**kwargs)


def raw_env(**kwargs: Any) -> pettingzoo.AECEnv[str, Any, Any]:
    """Agents act one after another, through PettingZoo's own conversion."""
    return parallel_to_aec(parallel_env(**kwargs))


def env(**kwargs: Any) -> pettingzoo.AECEnv[str, Any, Any]:
    """:func:`raw_env` with a clear error for calls in the wrong order."""
    return OrderEnforcingWrapper(raw_env(**kwargs))


register_parallel(ID, __name__)
