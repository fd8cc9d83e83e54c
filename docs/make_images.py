"""Make the pictures of the README: ``python docs/make_images.py``.

A controller that knows of no fault flies the rendezvous while thruster 1 is dead from the 25th second on;
the picture is taken after 70 seconds, while it still burns.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import imageio.v3 as imageio

import thruster_envs  # noqa: F401  # registers the environments
from thruster_baselines.control import RendezvousController, RendezvousPolicy
from thruster_envs.faults import Fault
from thruster_envs.spacecraft import load

STEPS, SHOWN = 571, 14


def main() -> None:
    """Fly, and write docs/images/rendezvous.png."""
    faults = [Fault(1, "stuck_off", onset=25.0)]
    env = gym.make("thruster_envs/OrionRendezvous-v0", faults=faults, render_mode="rgb_array")
    policy = RendezvousPolicy(RendezvousController(load("orion"), STEPS))
    observation, _ = env.reset(seed=0)
    for _ in range(SHOWN):
        observation, *_ = env.step(policy(observation))
    folder = Path(__file__).parent / "images"
    folder.mkdir(exist_ok=True)
    imageio.imwrite(folder / "rendezvous.png", env.render())
    env.close()


if __name__ == "__main__":
    main()
