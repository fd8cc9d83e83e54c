"""The tasks with the rewards of v0, under which their environments go on for one version.

Everything else about them is as in the present version. To end v0, delete this module, the rows of it in
:mod:`thruster_envs.registration`, ``former_reward`` in the tasks and what it selects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from thruster_envs.tasks.active_diagnosis import ActiveDiagnosis
from thruster_envs.tasks.fault_diagnosis import FaultDiagnosis
from thruster_envs.tasks.formation_attitude import FormationAttitude
from thruster_envs.tasks.formation_keeping import FormationKeeping
from thruster_envs.tasks.mars_rendezvous import MarsRendezvous
from thruster_envs.tasks.orion_rendezvous import OrionRendezvous

__all__ = [
    "FormerActiveDiagnosis",
    "FormerFaultDiagnosis",
    "FormerFormationAttitude",
    "FormerFormationKeeping",
    "FormerMarsRendezvous",
    "FormerOrionRendezvous",
]


@dataclass(frozen=True, kw_only=True)
class FormerOrionRendezvous(OrionRendezvous):
    """`OrionRendezvous-v0`: fuel, a potential without bound, and 1 for an arrival, -1 for a loss."""

    reward_terms: ClassVar[tuple[str, ...]] = ("fuel", "progress", "arrival")
    former_reward: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class FormerMarsRendezvous(MarsRendezvous):
    """`MarsRendezvous-v0`: costs, the distance gained, and 1 for a capture, -1 for a miss or a loss."""

    reward_terms: ClassVar[tuple[str, ...]] = ("corridor", "attitude", "fuel", "progress", "capture")
    former_reward: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class FormerFormationKeeping(FormationKeeping):
    """`FormationKeeping-v0` and `formation_keeping_v0`: costs that end with a loss."""

    fuel_price: float = 1.0

    reward_terms: ClassVar[tuple[str, ...]] = ("tracking", "attitude", "fuel")
    former_reward: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class FormerFormationAttitude(FormationAttitude):
    """`FormationAttitude-v0` and `formation_attitude_v0`: costs that end with a loss."""

    balance_price: float = 0.05
    pulse_price: float = 0.1

    reward_terms: ClassVar[tuple[str, ...]] = ("pointing", "balance", "pulses")
    former_reward: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class FormerFaultDiagnosis(FaultDiagnosis):
    """`FaultDiagnosis-v0`: costs alone, and a lost flight charged as if its last declaration stood."""

    right_worth: float = 0.0
    delay_cost: float = 1.0
    false_alarm_cost: float = 2.0
    wrong_name_cost: float = 1.5
    wrong_mode_cost: float = 0.5

    reward_terms: ClassVar[tuple[str, ...]] = ("delay", "false_alarm", "wrong_name")


@dataclass(frozen=True, kw_only=True)
class FormerActiveDiagnosis(ActiveDiagnosis):
    """`ActiveDiagnosis-v0`: the same, and the price of test pulses."""

    right_worth: float = 0.0
    delay_cost: float = 1.0
    false_alarm_cost: float = 2.0
    wrong_name_cost: float = 1.5
    wrong_mode_cost: float = 0.5
    fuel_cost: float = 0.1

    reward_terms: ClassVar[tuple[str, ...]] = ("delay", "false_alarm", "wrong_name", "fuel")

    def loss(self) -> float:
        """Nothing: a lost flight is charged as if its last declaration stood."""
        return 0.0
