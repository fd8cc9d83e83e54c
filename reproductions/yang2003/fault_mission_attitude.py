"""The source's failure of thruster 1, flown in six degrees of freedom, which the source left out.

`OrionRendezvous-v0` with scatter, sensor noise and coupling loss; thruster 1 is dead from the fifth period
on. The pilots are those of `reproductions.yang2003.fault_flights`: all plan and allocate alike, the oracle is
told of the failure, the classical one diagnoses it, the blind one only plans anew from where it is and holds
its attitude, the open-loop one does neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from reproductions.yang2003.fault_flights import PILOTS, told
from reproductions.yang2003.rendezvous_flights import ENVIRONMENT
from thruster_envs import rollout
from thruster_envs.faults import Fault
from thruster_envs.protocols import FloatArray

FLOWN_BY = ("oracle", "classical", "blind", "open loop")


@dataclass(frozen=True)
class AttitudeFlights:
    """How flights of one pilot ended."""

    success: FloatArray  # (flights,), whether the craft was in the terminal box when the time was up
    lost: FloatArray  # (flights,), whether it went out of bounds before
    miss: FloatArray  # (flights,), distance from the target at the end, or where it was lost, m
    firing_time: FloatArray  # (flights,), thruster-seconds of open valve; a dead one does not open
    spent: FloatArray  # (flights, steps + 1), firing time up to each step; constant after a loss


def fly_with_attitude(
    pilot: str, seeds: Sequence[int], thruster: int, onset: float, orbits: float = 0.5
) -> AttitudeFlights:
    """Fly an episode for each seed in which a thruster is dead from some time on.

    Args:
        pilot: One of `FLOWN_BY`.
        seeds: Of the episodes.
        thruster: From 1.
        onset: s.
        orbits: Time for the rendezvous.
    """
    env: Any = gym.make(ENVIRONMENT, orbits=orbits, disable_env_checker=True)
    task = env.unwrapped.task
    success, lost, miss = np.zeros((3, len(seeds)))
    spent = np.zeros((len(seeds), task.steps + 1))
    dead = Fault(thruster, "stuck_off", onset=onset)
    for flight, seed in enumerate(seeds):
        flown_by = PILOTS[pilot](task.vehicle, task.steps)
        flown = rollout.fly(env, flown_by, seed, options={"faults": (dead,)}, callback=told(flown_by))
        steps = int(flown.lengths[0])
        spent[flight, 1 : steps + 1], spent[flight, steps:] = flown.fuel[1:], flown.fuel[-1]
        success[flight], lost[flight] = flown.success[-1], steps < task.steps
        miss[flight] = float(np.linalg.norm(flown.position[-1]))
    env.close()
    return AttitudeFlights(success, lost, miss, spent[:, -1], spent)
