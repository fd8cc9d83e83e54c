"""The environments, one module for each: its page is the docstring of its class."""

from __future__ import annotations

from thruster_envs.views.environments.active_diagnosis import ActiveDiagnosisEnv
from thruster_envs.views.environments.fault_diagnosis import FaultDiagnosisEnv
from thruster_envs.views.environments.formation_attitude import FormationAttitudeEnv
from thruster_envs.views.environments.formation_keeping import FormationKeepingEnv
from thruster_envs.views.environments.mars_rendezvous import MarsRendezvousEnv
from thruster_envs.views.environments.orion_rendezvous import OrionRendezvousEnv
from thruster_envs.views.environments.pulse_diagnosis import PulseDiagnosisEnv
from thruster_envs.views.environments.thruster_mapping import ThrusterMappingEnv
from thruster_envs.views.making import vector_form

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

ActiveDiagnosisVectorEnv = vector_form(ActiveDiagnosisEnv)
FaultDiagnosisVectorEnv = vector_form(FaultDiagnosisEnv)
FormationAttitudeVectorEnv = vector_form(FormationAttitudeEnv)
FormationKeepingVectorEnv = vector_form(FormationKeepingEnv)
MarsRendezvousVectorEnv = vector_form(MarsRendezvousEnv)
OrionRendezvousVectorEnv = vector_form(OrionRendezvousEnv)
PulseDiagnosisVectorEnv = vector_form(PulseDiagnosisEnv)
ThrusterMappingVectorEnv = vector_form(ThrusterMappingEnv)
