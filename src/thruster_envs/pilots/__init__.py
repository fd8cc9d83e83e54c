"""Scripted laws, once: tasks fly the craft that nobody commands by them, baselines what an observation says.

They act on SI values, know nothing of faults, and need no solver.
"""

from thruster_envs.pilots.approach import FACING, ApproachPilot, ApproachSettings
from thruster_envs.pilots.attitude import AttitudePilot, Gains
from thruster_envs.pilots.slots import SlotPilot

__all__ = ["FACING", "ApproachPilot", "ApproachSettings", "AttitudePilot", "Gains", "SlotPilot"]
