"""Estimation: what the thrusters truly do, from what was commanded and what was measured."""

from thruster_baselines.estimation.calibration_sweep import CalibrationSweep, SweepEstimate
from thruster_baselines.estimation.effectiveness import EffectivenessFilter, Innovation
from thruster_baselines.estimation.measurement_gate import MeasuredInterval, MeasurementGate
from thruster_baselines.estimation.noise import PhysicalNoise
from thruster_baselines.estimation.rate_change import thrust_rate_change
from thruster_baselines.estimation.refusals import REFUSALS
from thruster_baselines.estimation.turning import ThrustTurning

__all__ = [
    "REFUSALS",
    "CalibrationSweep",
    "EffectivenessFilter",
    "Innovation",
    "MeasuredInterval",
    "MeasurementGate",
    "PhysicalNoise",
    "SweepEstimate",
    "ThrustTurning",
    "thrust_rate_change",
]
