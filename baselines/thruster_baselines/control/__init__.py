"""Control: closed loops from measurements to thruster duties."""

from thruster_baselines.control.navigation import RelativeNavigation
from thruster_baselines.control.rendezvous import RendezvousController, RendezvousSettings
from thruster_baselines.control.rendezvous_policy import RendezvousCommandPolicy, RendezvousPolicy

__all__ = [
    "RelativeNavigation",
    "RendezvousCommandPolicy",
    "RendezvousController",
    "RendezvousPolicy",
    "RendezvousSettings",
]
