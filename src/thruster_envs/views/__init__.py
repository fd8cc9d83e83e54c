"""One batch, four views: Gymnasium ``Env`` and ``VectorEnv``, PettingZoo ``ParallelEnv``, SB3 ``VecEnv``."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from thruster_envs.views.actions import (
    BeliefAction,
    HoldAction,
    MapperAction,
    VectorBeliefAction,
    VectorHoldAction,
    VectorMapperAction,
)
from thruster_envs.views.states import fork, get_state, set_state

if TYPE_CHECKING:
    from thruster_envs.views.parallel import FormationAttitudeParallelEnv, FormationParallelEnv
    from thruster_envs.views.sb3 import SB3VecEnv, SharedPolicyVecEnv

__all__ = [
    "BeliefAction",
    "FormationAttitudeParallelEnv",
    "FormationParallelEnv",
    "HoldAction",
    "MapperAction",
    "SB3VecEnv",
    "SharedPolicyVecEnv",
    "VectorBeliefAction",
    "VectorHoldAction",
    "VectorMapperAction",
    "fork",
    "get_state",
    "set_state",
]


#: Names that need an extra, and the module that has them; loaded on first use.
_LAZY = {
    "SB3VecEnv": "thruster_envs.views.sb3",
    "SharedPolicyVecEnv": "thruster_envs.views.sb3",
    "FormationAttitudeParallelEnv": "thruster_envs.views.parallel",
    "FormationParallelEnv": "thruster_envs.views.parallel",
}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
