"""Detection: which thruster fails to do what it was told, from what was measured."""

from thruster_baselines.detection.response import ResponseTest, threshold_for

__all__ = ["ResponseTest", "threshold_for"]
