"""One batch, four views: Gymnasium ``Env`` and ``VectorEnv``, PettingZoo ``ParallelEnv``, SB3 ``VecEnv``."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from thruster_envs.views.actions import (
    BeliefAction,
    HoldAction,
    MapperAction,
    VectorBeliefAction,
    VectorHoldAction,
    VectorMapperAction,
)

#: Names that need an extra, and the module that has them; loaded on first use.
_LAZY = {
    "SB3VecEnv": "thruster_envs.views.sb3",
    "SharedPolicyVecEnv": "thruster_envs.views.sb3",
    "FormationAttitudeParallelEnv": "thruster_envs.views.parallel",
    "FormationParallelEnv": "thruster_envs.views.parallel",
}

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
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
