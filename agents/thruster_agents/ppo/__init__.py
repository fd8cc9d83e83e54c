"""Proximal policy optimisation of the mapping task, which an interruption does not spoil."""

from thruster_agents.ppo.regret import RegretReward
from thruster_agents.ppo.training import Settings, Trained, load_policy, needed_bytes, train

__all__ = ["RegretReward", "Settings", "Trained", "load_policy", "needed_bytes", "train"]
