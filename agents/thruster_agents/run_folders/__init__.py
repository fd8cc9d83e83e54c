"""Run folders: what a training run leaves, and how it is found again."""

from thruster_agents.run_folders.configuration import Configuration, read_configuration
from thruster_agents.run_folders.folder import RunFolder, latest_run, new_run, versions
from thruster_agents.run_folders.loading import Policy, load
from thruster_agents.run_folders.record import check_spacecraft, check_task, write_record

__all__ = [
    "Configuration",
    "Policy",
    "RunFolder",
    "check_spacecraft",
    "check_task",
    "latest_run",
    "load",
    "new_run",
    "read_configuration",
    "versions",
    "write_record",
]
