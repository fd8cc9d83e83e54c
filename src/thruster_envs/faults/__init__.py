"""Faults as data: what fails, how, how badly, from when, until when, with what profile in time.

>>> from thruster_envs.faults import Fault, FaultDistribution
>>> Fault(thruster=1, kind="stuck_off", onset=25.0)  # doctest: +ELLIPSIS
Fault(thruster=1, kind='stuck_off', severity=1.0, onset=25.0, ...)
"""

from thruster_envs.faults.distribution import FaultDistribution, as_faults
from thruster_envs.faults.encoding import FAULT_FIELDS, decode, encode
from thruster_envs.faults.modes import MODES, mode_of
from thruster_envs.faults.record import (
    DISCHARGE_KINDS,
    FULL_SCALE,
    GENERAL_KINDS,
    KINDS,
    MODULATOR_KINDS,
    PROFILES,
    Fault,
)

__all__ = [
    "DISCHARGE_KINDS",
    "FAULT_FIELDS",
    "FULL_SCALE",
    "GENERAL_KINDS",
    "KINDS",
    "MODES",
    "MODULATOR_KINDS",
    "PROFILES",
    "Fault",
    "FaultDistribution",
    "as_faults",
    "decode",
    "encode",
    "mode_of",
]
