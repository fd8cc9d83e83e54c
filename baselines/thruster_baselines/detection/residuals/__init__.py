"""Detection from navigation: residuals of an observer of position, fed with what valves were told."""

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
from thruster_baselines.detection.residuals.generator import ResidualGenerator

__all__ = [
    "Decoupling",
    "DelayModel",
    "ResidualDesign",
    "ResidualGenerator",
    "assigned_gain",
    "closed_form_gain",
    "decoupling",
    "delay_model",
    "observer_design",
    "pade_design",
    "relative_motion",
]
