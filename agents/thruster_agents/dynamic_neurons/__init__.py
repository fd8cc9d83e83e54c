"""Networks of neurons with internal filters that notice a failing plasma thruster (Valdes 2008)."""

from thruster_agents.dynamic_neurons.back_propagation import dynamic_back_propagation
from thruster_agents.dynamic_neurons.detectors import MissionDetector, low_level_detector
from thruster_agents.dynamic_neurons.filtering import recursive_filter
from thruster_agents.dynamic_neurons.high_level import (
    HighLevelClassifier,
    HighLevelSettings,
    MissionSignals,
)
from thruster_agents.dynamic_neurons.integrated import (
    IntegratedClassifier,
    MissionReport,
    ThrusterFinding,
)
from thruster_agents.dynamic_neurons.layers import DynamicLayer, DynamicNeuron
from thruster_agents.dynamic_neurons.low_level import LowLevelClassifier, LowLevelSettings
from thruster_agents.dynamic_neurons.networks import (
    Architecture,
    DynamicNetwork,
    GRUNetwork,
    SequenceNetwork,
    StaticNetwork,
    build_network,
)
from thruster_agents.dynamic_neurons.training import TrainingRecord, TrainingSettings, train

__all__ = [
    "Architecture",
    "DynamicLayer",
    "DynamicNetwork",
    "DynamicNeuron",
    "GRUNetwork",
    "HighLevelClassifier",
    "HighLevelSettings",
    "IntegratedClassifier",
    "LowLevelClassifier",
    "LowLevelSettings",
    "MissionDetector",
    "MissionReport",
    "MissionSignals",
    "SequenceNetwork",
    "StaticNetwork",
    "ThrusterFinding",
    "TrainingRecord",
    "TrainingSettings",
    "build_network",
    "dynamic_back_propagation",
    "low_level_detector",
    "recursive_filter",
    "train",
]
