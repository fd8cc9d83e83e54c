"""Faults as data: what fails, how, how badly, from when, until when, with what profile in time.

>>> from thruster_envs.faults import Fault, FaultDistribution
>>> Fault(thruster=1, kind="stuck_off", onset=25.0)  # doctest: +ELLIPSIS
Fault(thruster=1, kind='stuck_off', severity=1.0, onset=25.0, ...)
>>> Fault(sensor="rate", axis=2, kind="bias", severity=1e-3)  # doctest: +ELLIPSIS
Fault(thruster=0, kind='bias', severity=0.001, onset=0.0, ...)
"""

from thruster_envs.faults.distribution import FaultDistribution, as_faults
from thruster_envs.faults.encoding import FAULT_FIELDS, decode, encode
from thruster_envs.faults.kinds import (
    DISCHARGE_KINDS,
    FULL_SCALE,
    GENERAL_KINDS,
    KINDS,
    MODULATOR_KINDS,
    SENSOR_KINDS,
    SENSORS,
    THRUSTER_KINDS,
)
from thruster_envs.faults.modes import MODES, mode_of
from thruster_envs.faults.record import PROFILES, Fault

__all__ = [
    "DISCHARGE_KINDS",
    "FAULT_FIELDS",
    "FULL_SCALE",
    "GENERAL_KINDS",
    "KINDS",
    "MODES",
    "MODULATOR_KINDS",
    "PROFILES",
    "SENSORS",
    "SENSOR_KINDS",
    "THRUSTER_KINDS",
    "Fault",
    "FaultDistribution",
    "as_faults",
    "decode",
    "encode",
    "mode_of",
]
