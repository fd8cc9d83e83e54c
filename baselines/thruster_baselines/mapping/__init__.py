"""Mappers: from a commanded body rate change to thruster on-times.

All stand behind `thruster_envs.protocols.Mapper`. `LPMapper` is the one to beat; the others are what flight
programs do without a linear program.
"""

from thruster_baselines.mapping.crude import CrudeMapper
from thruster_baselines.mapping.lp import LPMapper
from thruster_baselines.mapping.minimum_norm import MinimumNormShiftMapper
from thruster_baselines.mapping.pseudo_inverse import PseudoInverseMapper

__all__ = ["CrudeMapper", "LPMapper", "MinimumNormShiftMapper", "PseudoInverseMapper"]
