"""Plasma thrusters that fail, found by the waveforms of pulses, by how many there are, and by the motion."""

from thruster_baselines.detection.pulses.counts import CountDiagnosis, PulseCountCUSUM
from thruster_baselines.detection.pulses.detector import PulseCountDetector, WaveformDetector
from thruster_baselines.detection.pulses.fit import BAND, PulseEstimate, PulseFit
from thruster_baselines.detection.pulses.flights import PulseFlights
from thruster_baselines.detection.pulses.library import PulseLibrary
from thruster_baselines.detection.pulses.motion import MotionFit, ThrustShares, absolute_motion
from thruster_baselines.detection.pulses.residual import PulseResidual

__all__ = [
    "BAND",
    "CountDiagnosis",
    "MotionFit",
    "PulseCountCUSUM",
    "PulseCountDetector",
    "PulseEstimate",
    "PulseFit",
    "PulseFlights",
    "PulseLibrary",
    "PulseResidual",
    "ThrustShares",
    "WaveformDetector",
    "absolute_motion",
]
