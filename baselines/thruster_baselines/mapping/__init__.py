"""Mappers: from a commanded body rate change to thruster on-times.

All stand behind `thruster_envs.protocols.Mapper`. `LPMapper` is the one to beat; the others are what flight
programs do without a linear program.
"""

from thruster_baselines.mapping.additive import AdditiveCompensationMapper
from thruster_baselines.mapping.attitude_uncertainty import AttitudeUncertainty
from thruster_baselines.mapping.carrying import CarryingMapper
from thruster_baselines.mapping.chance_constrained import ChanceConstrainedMapper
from thruster_baselines.mapping.comparison import ComparedMapper, MapperComparison, compare_mappers
from thruster_baselines.mapping.compensation import CompensatedAllocation
from thruster_baselines.mapping.coupling import (
    commanded_on_times,
    delivered_on_times,
    delivered_rate_change,
)
from thruster_baselines.mapping.crude import CrudeMapper
from thruster_baselines.mapping.differential import DifferentialCompensationMapper
from thruster_baselines.mapping.exact import ExactCompensationMapper
from thruster_baselines.mapping.lp import LPMapper
from thruster_baselines.mapping.milp import MILPMapper
from thruster_baselines.mapping.minimum_norm import MinimumNormShiftMapper
from thruster_baselines.mapping.minimum_pulse import MinimumPulseMapper, PulsedAllocation, minimum_pulses
from thruster_baselines.mapping.non_negative import NonNegativeLeastSquaresMapper
from thruster_baselines.mapping.null_space import NullSpaceMapper
from thruster_baselines.mapping.pseudo_inverse import PseudoInverseMapper
from thruster_baselines.mapping.quadratic import QuadraticMapper
from thruster_baselines.mapping.redistributed import RedistributedPseudoInverseMapper
from thruster_baselines.mapping.robust_command import RobustCommandMapper
from thruster_baselines.mapping.robust_conic import ConicRobustMapper
from thruster_baselines.mapping.robust_effectiveness import RobustEffectivenessMapper
from thruster_baselines.mapping.schmitt import SchmittTriggerMapper
from thruster_baselines.mapping.sequence import LPSequence
from thruster_baselines.mapping.truncating import TruncatingMapper
from thruster_baselines.mapping.uncertainty import RobustAllocation

__all__ = [
    "AdditiveCompensationMapper",
    "AttitudeUncertainty",
    "CarryingMapper",
    "ChanceConstrainedMapper",
    "ComparedMapper",
    "CompensatedAllocation",
    "ConicRobustMapper",
    "CrudeMapper",
    "DifferentialCompensationMapper",
    "ExactCompensationMapper",
    "LPMapper",
    "LPSequence",
    "MILPMapper",
    "MapperComparison",
    "MinimumNormShiftMapper",
    "MinimumPulseMapper",
    "NonNegativeLeastSquaresMapper",
    "NullSpaceMapper",
    "PseudoInverseMapper",
    "PulsedAllocation",
    "QuadraticMapper",
    "RedistributedPseudoInverseMapper",
    "RobustAllocation",
    "RobustCommandMapper",
    "RobustEffectivenessMapper",
    "SchmittTriggerMapper",
    "TruncatingMapper",
    "commanded_on_times",
    "compare_mappers",
    "delivered_on_times",
    "delivered_rate_change",
    "minimum_pulses",
]
