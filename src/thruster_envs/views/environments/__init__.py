"""The environments, one module for each: its page is the docstring of its class."""

from __future__ import annotations

from thruster_envs.views.environments.active_diagnosis import ActiveDiagnosisEnv, ActiveDiagnosisVectorEnv
from thruster_envs.views.environments.fault_diagnosis import FaultDiagnosisEnv, FaultDiagnosisVectorEnv
from thruster_envs.views.environments.formation_attitude import (
    FormationAttitudeEnv,
    FormationAttitudeVectorEnv,
)
from thruster_envs.views.environments.formation_keeping import FormationKeepingEnv, FormationKeepingVectorEnv
from thruster_envs.views.environments.mars_rendezvous import MarsRendezvousEnv, MarsRendezvousVectorEnv
from thruster_envs.views.environments.orion_rendezvous import OrionRendezvousEnv, OrionRendezvousVectorEnv
from thruster_envs.views.environments.pulse_diagnosis import PulseDiagnosisEnv, PulseDiagnosisVectorEnv
from thruster_envs.views.environments.thruster_mapping import ThrusterMappingEnv, ThrusterMappingVectorEnv

__all__ = [
    "ActiveDiagnosisEnv",
    "ActiveDiagnosisVectorEnv",
    "FaultDiagnosisEnv",
    "FaultDiagnosisVectorEnv",
    "FormationAttitudeEnv",
    "FormationAttitudeVectorEnv",
    "FormationKeepingEnv",
    "FormationKeepingVectorEnv",
    "MarsRendezvousEnv",
    "MarsRendezvousVectorEnv",
    "OrionRendezvousEnv",
    "OrionRendezvousVectorEnv",
    "PulseDiagnosisEnv",
    "PulseDiagnosisVectorEnv",
    "ThrusterMappingEnv",
    "ThrusterMappingVectorEnv",
]
