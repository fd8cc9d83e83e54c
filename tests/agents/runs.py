"""A run of the command that is small enough to be made by tests."""

TASK = "thruster_envs/ThrusterMapping-v0"
TINY = [
    *("--worlds", "8", "--belief-steps", "768", "--duty-steps", "512", "--test-worlds", "20"),
    *("--validation-worlds", "4", "--checkpoint-every", "1", "--validate-every", "1"),
]
