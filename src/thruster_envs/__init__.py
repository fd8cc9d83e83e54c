"""Reinforcement-learning environments for fault-tolerant thruster control of spacecraft."""
