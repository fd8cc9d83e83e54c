"""The comparison: every method flies the same episodes; one table says how well."""

from thruster_agents.evaluation.methods import Method, classical_methods
from thruster_agents.evaluation.play import DEAD, FAULTS, HEALTHY, SCENARIOS, Play, Scenario, play
from thruster_agents.evaluation.table import Cell, Row, compare

__all__ = [
    "DEAD",
    "FAULTS",
    "HEALTHY",
    "SCENARIOS",
    "Cell",
    "Method",
    "Play",
    "Row",
    "Scenario",
    "classical_methods",
    "compare",
    "play",
]
