"""Control: closed loops from measurements to thruster duties, with or without a diagnosis of thrusters."""

from thruster_baselines.control.approach import ApproachController, ApproachSettings
from thruster_baselines.control.chaser_pilot import (
    ChaserDecision,
    ChaserPilot,
    RecoveryPhase,
    RecoverySettings,
)
from thruster_baselines.control.classical_pilot import (
    ClassicalPilot,
    Decision,
    DiagnosisSettings,
    settings_for,
)
from thruster_baselines.control.diagnosis_observation import (
    DiagnosisObservation,
    VectorDiagnosisObservation,
)
from thruster_baselines.control.fault_allocation import FaultAllocation, ThrusterBelief
from thruster_baselines.control.navigation import RelativeNavigation
from thruster_baselines.control.observed import Measured, ObservationReader
from thruster_baselines.control.quaternion_team import QuaternionTeam
from thruster_baselines.control.rendezvous import RendezvousController, RendezvousSettings
from thruster_baselines.control.rendezvous_policy import RendezvousCommandPolicy, RendezvousPolicy
from thruster_baselines.control.slot_controller import SlotController
from thruster_baselines.control.valve_allocation import ValveAllocation, ValveBelief, authority_left
from thruster_baselines.control.valve_probing import ProbeSettings, ValveProbing, balanced_groups

__all__ = [
    "ApproachController",
    "ApproachSettings",
    "ChaserDecision",
    "ChaserPilot",
    "ClassicalPilot",
    "Decision",
    "DiagnosisObservation",
    "DiagnosisSettings",
    "FaultAllocation",
    "Measured",
    "ObservationReader",
    "ProbeSettings",
    "QuaternionTeam",
    "RecoveryPhase",
    "RecoverySettings",
    "RelativeNavigation",
    "RendezvousCommandPolicy",
    "RendezvousController",
    "RendezvousPolicy",
    "RendezvousSettings",
    "SlotController",
    "ThrusterBelief",
    "ValveAllocation",
    "ValveBelief",
    "ValveProbing",
    "VectorDiagnosisObservation",
    "authority_left",
    "balanced_groups",
    "settings_for",
]
