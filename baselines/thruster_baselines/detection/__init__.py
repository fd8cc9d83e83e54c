"""Detection: which thruster fails to do what it was told, from what was measured."""

from thruster_baselines.detection.base import BaseDetector, Interval
from thruster_baselines.detection.calibration import (
    Calibration,
    Firings,
    calibrate,
    chi_squared_threshold,
    healthy_firings,
    largest_scaled_threshold,
    margin_threshold,
    rate_per_interval,
    residual_thresholds,
    threshold_for,
    threshold_for_rate,
)
from thruster_baselines.detection.chi_squared import GenericChiSquared, SetChiSquared, SingleChiSquared
from thruster_baselines.detection.confusion import MEASURES, Confusion
from thruster_baselines.detection.contract import Detector, Telemetry, Verdict
from thruster_baselines.detection.cusum import CUSUMDetector
from thruster_baselines.detection.environment_flights import EnvironmentFlights, ObservedFiring
from thruster_baselines.detection.estimator_threshold import EstimatorThreshold
from thruster_baselines.detection.evaluate import (
    CurvePoint,
    Evaluation,
    Identifier,
    Rate,
    by_model_comparison,
    evaluate,
    table,
)
from thruster_baselines.detection.evidence import EvidenceObservation, VectorEvidenceObservation
from thruster_baselines.detection.fault_flights import FaultFlights
from thruster_baselines.detection.filter_bank import FilterBank
from thruster_baselines.detection.flights import Flights, FlightSource, RandomFlights
from thruster_baselines.detection.glr import GLRDetector
from thruster_baselines.detection.hypotheses import HypothesisDetector
from thruster_baselines.detection.identification import (
    Identification,
    ModelComparison,
    Severity,
    least_squares_severity,
)
from thruster_baselines.detection.mismatch import MismatchMonitor, ModelMismatchWarning
from thruster_baselines.detection.player import DetectorPlayer, PlayerDetector
from thruster_baselines.detection.response import ResponseTest
from thruster_baselines.detection.separability import inseparable_pairs
from thruster_baselines.detection.settings import FilterSettings
from thruster_baselines.detection.windowed_glr import WindowedGLR

__all__ = [
    "MEASURES",
    "BaseDetector",
    "CUSUMDetector",
    "Calibration",
    "Confusion",
    "CurvePoint",
    "Detector",
    "DetectorPlayer",
    "EnvironmentFlights",
    "EstimatorThreshold",
    "Evaluation",
    "EvidenceObservation",
    "FaultFlights",
    "FilterBank",
    "FilterSettings",
    "Firings",
    "FlightSource",
    "Flights",
    "GLRDetector",
    "GenericChiSquared",
    "HypothesisDetector",
    "Identification",
    "Identifier",
    "Interval",
    "MismatchMonitor",
    "ModelComparison",
    "ModelMismatchWarning",
    "ObservedFiring",
    "PlayerDetector",
    "RandomFlights",
    "Rate",
    "ResponseTest",
    "SetChiSquared",
    "Severity",
    "SingleChiSquared",
    "Telemetry",
    "VectorEvidenceObservation",
    "Verdict",
    "WindowedGLR",
    "by_model_comparison",
    "calibrate",
    "chi_squared_threshold",
    "evaluate",
    "healthy_firings",
    "inseparable_pairs",
    "largest_scaled_threshold",
    "least_squares_severity",
    "margin_threshold",
    "rate_per_interval",
    "residual_thresholds",
    "table",
    "threshold_for",
    "threshold_for_rate",
]
