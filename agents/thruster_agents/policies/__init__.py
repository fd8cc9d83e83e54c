"""Policies: networks for the observations of this suite's tasks."""

from thruster_agents.policies.diagnosis import DiagnosisPolicy

__all__ = ["DiagnosisPolicy"]
