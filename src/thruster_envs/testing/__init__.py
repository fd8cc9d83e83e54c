"""Checkers for environments, yours as well as those of this package.

`check_vector_env` checks a native Gymnasium `VectorEnv`, `check_parallel_env` and `check_parallel_env_seed` a
PettingZoo `ParallelEnv`. They need NumPy and Gymnasium only (PettingZoo for an environment named by its id).

    check_vector_env("thruster_envs/OrionRendezvous-v1", max_episode_steps=20)  # make_vec beside make, by id
    check_vector_env(MyVectorEnv, MyEnv)                                        # classes or functions
    check_vector_env(MyVectorEnv, skip={"seed_lists": "seeds are numbers"})     # without a single environment
    print(check_vector_env(MyVectorEnv, raise_failures=False))                  # the whole report

"""

from thruster_envs.testing.parallel.checker import (
    PARALLEL_CHECK_NAMES,
    check_parallel_env,
    check_parallel_env_seed,
)
from thruster_envs.testing.report import CheckFailed, CheckResult, Report
from thruster_envs.testing.vector.checker import VECTOR_CHECK_NAMES, check_vector_env

__all__ = [
    "PARALLEL_CHECK_NAMES",
    "VECTOR_CHECK_NAMES",
    "CheckFailed",
    "CheckResult",
    "Report",
    "check_parallel_env",
    "check_parallel_env_seed",
    "check_vector_env",
]
