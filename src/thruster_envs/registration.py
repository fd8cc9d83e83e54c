"""The table of ids under which Gymnasium finds the environments."""

from __future__ import annotations

import gymnasium as gym

_MODULE = "thruster_envs.views.environments"

#: Id to class and time limit; the vector form is the class of that name with ``Vector`` before ``Env``.
ENVIRONMENTS: dict[str, tuple[str, int | None]] = {
    "thruster_envs/ThrusterMapping-v0": ("ThrusterMapping", 32),
    "thruster_envs/OrionRendezvous-v0": ("OrionRendezvous", None),
    "thruster_envs/MarsRendezvous-v0": ("MarsRendezvous", None),
    "thruster_envs/FormationKeeping-v0": ("FormationKeeping", 120),
    "thruster_envs/FormationAttitude-v0": ("FormationAttitude", 3000),
    "thruster_envs/FaultDiagnosis-v0": ("FaultDiagnosis", 120),
    "thruster_envs/ActiveDiagnosis-v0": ("ActiveDiagnosis", 120),
    "thruster_envs/PulseDiagnosis-v0": ("PulseDiagnosis", 64),
}


def register_all() -> None:
    """Register every id that is not registered yet."""
    for identifier, (name, limit) in ENVIRONMENTS.items():
        if identifier not in gym.registry:
            gym.register(
                identifier,
                entry_point=f"{_MODULE}:{name}Env",
                vector_entry_point=f"{_MODULE}:{name}VectorEnv",
                max_episode_steps=limit,
            )
