"""Run folders: what a training run leaves, and how it is found again."""

from thruster_agents.run_folders.folder import RunFolder, latest_run, new_run, versions
from thruster_agents.run_folders.loading import Policy, load

__all__ = ["Policy", "RunFolder", "latest_run", "load", "new_run", "versions"]
