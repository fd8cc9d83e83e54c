"""The checks of a PettingZoo parallel environment."""
