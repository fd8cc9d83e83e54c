"""One description of a spacecraft, and the catalogue: one data file per vehicle.

>>> from thruster_envs.spacecraft import load
>>> orion = load("orion")
>>> orion.number_of_thrusters
12
"""

from thruster_envs.spacecraft.actuators import (
    ControlMomentGyro,
    Discharge,
    Feed,
    Modulator,
    ReactionWheel,
    Thruster,
)
from thruster_envs.spacecraft.description import SLACK_FACTOR, Sensors, Spacecraft, objective_weights
from thruster_envs.spacecraft.files import catalogue, load, save
from thruster_envs.spacecraft.orbit import Orbit
from thruster_envs.spacecraft.summary import SpacecraftSummary, describe

__all__ = [
    "SLACK_FACTOR",
    "ControlMomentGyro",
    "Discharge",
    "Feed",
    "Modulator",
    "Orbit",
    "ReactionWheel",
    "Sensors",
    "Spacecraft",
    "SpacecraftSummary",
    "Thruster",
    "catalogue",
    "describe",
    "load",
    "objective_weights",
    "save",
]
