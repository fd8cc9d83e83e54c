"""Reinforcement-learning environments for spacecraft that fly on thrusters which fail.

Importing the package registers its environments with Gymnasium; everything else is loaded when it is first
used.

>>> import gymnasium as gym
>>> import thruster_envs
>>> env = gym.make("thruster_envs/ThrusterMapping-v0", faults=[{"thruster": 1, "kind": "stuck_off"}])
>>> observation, info = env.reset(seed=0)
>>> int(info["fault"]["thruster"][0])
1
"""

from thruster_envs.registration import register_all

__version__ = "0.1.0"

register_all()
