"""Guidance: where to go, and what to fire for it over the periods to come."""

from thruster_baselines.guidance.hcw import force_response, transition_matrix
from thruster_baselines.guidance.rendezvous import RendezvousPlan, RendezvousPlanner

__all__ = ["RendezvousPlan", "RendezvousPlanner", "force_response", "transition_matrix"]
