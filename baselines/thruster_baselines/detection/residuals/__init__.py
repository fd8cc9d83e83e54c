"""Detection from navigation: residuals of an observer of position, fed with what valves were told."""

from thruster_baselines.detection.residuals.base import BaseNavigationDetector
from thruster_baselines.detection.residuals.correlation import CorrelationDetector
from thruster_baselines.detection.residuals.design import (
    Decoupling,
    DelayModel,
    ResidualDesign,
    assigned_gain,
    closed_form_gain,
    decoupling,
    delay_model,
    observer_design,
    pade_design,
    relative_motion,
)
from thruster_baselines.detection.residuals.flights import NavigationFlights, Watched, watch
from thruster_baselines.detection.residuals.fusion import FusionDetector
from thruster_baselines.detection.residuals.generator import ResidualGenerator
from thruster_baselines.detection.residuals.kinds import FUSION_KINDS
from thruster_baselines.detection.residuals.norm_threshold import (
    NormThreshold,
    margin_threshold,
    named_design,
)
from thruster_baselines.detection.residuals.signature import SignatureDetector

__all__ = [
    "FUSION_KINDS",
    "BaseNavigationDetector",
    "CorrelationDetector",
    "Decoupling",
    "DelayModel",
    "FusionDetector",
    "NavigationFlights",
    "NormThreshold",
    "ResidualDesign",
    "ResidualGenerator",
    "SignatureDetector",
    "Watched",
    "assigned_gain",
    "closed_form_gain",
    "decoupling",
    "delay_model",
    "margin_threshold",
    "named_design",
    "observer_design",
    "pade_design",
    "relative_motion",
    "watch",
]
