"""What there is to do: one module per task, a configuration and a handful of functions over a batch."""

from thruster_envs.observations import Field
from thruster_envs.tasks.active_diagnosis import ActiveDiagnosis
from thruster_envs.tasks.contract import Outcome, Task, TaskState, Truth
from thruster_envs.tasks.fault_diagnosis import FaultDiagnosis
from thruster_envs.tasks.formation_attitude import FormationAttitude
from thruster_envs.tasks.formation_keeping import FormationKeeping
from thruster_envs.tasks.mars_rendezvous import MarsRendezvous
from thruster_envs.tasks.orion_rendezvous import OrionRendezvous
from thruster_envs.tasks.pulse_diagnosis import PulseDiagnosis
from thruster_envs.tasks.thruster_mapping import ThrusterMapping

Feature = Field  #: The former name of :class:`~thruster_envs.observations.Field`.

__all__ = [
    "ActiveDiagnosis",
    "FaultDiagnosis",
    "Feature",
    "Field",
    "FormationAttitude",
    "FormationKeeping",
    "MarsRendezvous",
    "OrionRendezvous",
    "Outcome",
    "PulseDiagnosis",
    "Task",
    "TaskState",
    "ThrusterMapping",
    "Truth",
]
