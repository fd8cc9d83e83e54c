"""Estimation: what the thrusters truly do, from what was commanded and what was measured."""

from thruster_baselines.estimation.calibration_sweep import Calibration, CalibrationSweep
from thruster_baselines.estimation.effectiveness import EffectivenessFilter, Innovation
from thruster_baselines.estimation.noise import PhysicalNoise
from thruster_baselines.estimation.rate_change import thrust_rate_change

__all__ = [
    "Calibration",
    "CalibrationSweep",
    "EffectivenessFilter",
    "Innovation",
    "PhysicalNoise",
    "thrust_rate_change",
]
