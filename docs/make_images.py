"""Make the pictures of the README: ``python docs/make_images.py``.

A controller that knows of no fault flies Orion's rendezvous while thruster 1 is dead from the 25th second on;
the picture is taken after 70 seconds, while it still burns. The chaser about Mars is shown in the period in
which its pilot has closed the valve of thruster 3, stuck open since the 60th second.
"""

from __future__ import annotations

import os
import signal

PROGRAM = "docs/make_images.py"
if __name__ == "__main__" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # Until `run_command`, while the libraries load, Ctrl-C ends the program with one line and no exception.
    signal.signal(
        signal.SIGINT, lambda *_: (os.write(2, f"\n{PROGRAM}: interrupted\n".encode()), os._exit(130))
    )

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

import thruster_envs  # noqa: F401  # registers the environments
from thruster_agents.commands import check_file, complain, run_command
from thruster_baselines.control import ChaserPilot, RendezvousController, RendezvousPolicy
from thruster_baselines.detection.residuals import FusionDetector
from thruster_envs.faults import Fault
from thruster_envs.rollout import fly
from thruster_envs.spacecraft import load

STEPS, SHOWN = 571, 14


def main() -> int:
    """Fly, and write the pictures into docs/images; returns the exit status."""
    folder = Path(__file__).parent / "images"
    pictures = {folder / "rendezvous.png": rendezvous, folder / "approach.png": approach}
    try:
        for path in pictures:
            check_file(path.name, path)
    except ValueError as problem:
        complain(PROGRAM, str(problem))
        return 2
    for path, picture in pictures.items():
        imageio.imwrite(path, picture())
    return 0


def rendezvous() -> NDArray[np.uint8]:
    """Orion with a dead thruster."""
    faults = [Fault(1, "stuck_off", onset=25.0)]
    env = gym.make("thruster_envs/OrionRendezvous-v1", faults=faults, render_mode="rgb_array")
    policy = RendezvousPolicy(RendezvousController(load("orion"), STEPS))
    fly(env, policy, seeds=0, steps=SHOWN)
    return frame_of(env)


def approach() -> NDArray[np.uint8]:
    """The chaser about Mars with a valve that has been closed."""
    faults = [Fault(3, "stuck_on", onset=60.0)]
    env: Any = gym.make(
        "thruster_envs/MarsRendezvous-v1", inhibit=True, faults=faults, render_mode="rgb_array"
    )
    detector = FusionDetector("msr_chaser", threshold=16.0, margin=6.0, settle=20.0)
    pilot = ChaserPilot(load("msr_chaser"), env.unwrapped.task.steps, detector)
    fly(env, pilot, seeds=0, callback=lambda _: all(one.what != "inhibited" for one in pilot.log))
    return frame_of(env)


def frame_of(env: gym.Env[Any, Any]) -> NDArray[np.uint8]:
    """What it looks like now; the environment is closed."""
    frame: Any = env.render()
    env.close()
    return np.asarray(frame, np.uint8)


if __name__ == "__main__":
    sys.exit(run_command(PROGRAM, main))
