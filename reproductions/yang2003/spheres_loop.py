"""A control loop of SPHERES at 20 Hz, into which any mapper can be put.

The source says that its mapper took the place of the crude one on SPHERES without a change to either side,
and gives neither vehicle nor controller. Both are external here: the vehicle is that of the catalogue, the
gains are those of publicly posted flight code. A craft is six double integrators: attitude errors are small,
and rates are those of the angles. No noise, no minimum pulse, no coupling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thruster_envs.protocols import FloatArray, Mapper
from thruster_envs.spacecraft import load

SPHERES = load("spheres")
LOOP_PERIOD = 0.05
"""s; 20 Hz (L445)."""

_MASS, _INERTIA = SPHERES.mass, SPHERES.inertia[0][0]
_STIFFNESS = np.repeat([0.172 / _MASS, 0.0036 / _INERTIA], 3)  # N/m and N m/rad, per mass and inertia
_DAMPING = np.repeat([1.72 / _MASS, 0.0135 / _INERTIA], 3)  # N s/m and N m s/rad, likewise
_FARTHEST = 0.5  # m, and rad, at the start


@dataclass(frozen=True)
class Regulated:
    """What came of craft that were brought to rest at the origin."""

    commands: FloatArray  # (steps, craft, 6), rate changes that the controller asked for, m/s then rad/s
    # (steps, craft), what was missed of them over what was asked for, in shares of authority
    deviation: FloatArray
    final: FloatArray  # (craft, 6), distance on each axis at the end, m then rad
    firing_time: FloatArray  # (craft,), thruster-seconds


def regulate(mapper: Mapper, craft: int, seconds: float = 60.0, seed: int = 4) -> Regulated:
    """Let craft return from up to 0.5 m and 0.5 rad on each axis, at rest, in shares of one batch."""
    effectiveness, authority = SPHERES.effectiveness(), SPHERES.authority(LOOP_PERIOD)
    position = np.random.default_rng(seed).uniform(-_FARTHEST, _FARTHEST, (craft, 6))
    velocity, firing_time = np.zeros_like(position), np.zeros(craft)
    commands, deviation = [], []
    for _ in range(round(seconds / LOOP_PERIOD)):
        command = -LOOP_PERIOD * (_STIFFNESS * position + _DAMPING * velocity)
        on_times = mapper(command).on_times
        change = on_times @ effectiveness.T
        position = position + LOOP_PERIOD * (velocity + 0.5 * change)
        velocity = velocity + change
        firing_time += on_times.sum(axis=-1)
        commands.append(command)
        deviation.append(relative_deviation(change, command, authority))
    return Regulated(np.array(commands), np.array(deviation), position, firing_time)


def relative_deviation(change: FloatArray, command: FloatArray, authority: FloatArray) -> FloatArray:
    """Size of what was missed over the size of the command (...,), both in shares of authority."""
    missed: FloatArray = np.linalg.norm((change - command) / authority, axis=-1)
    asked: FloatArray = np.linalg.norm(command / authority, axis=-1)
    return missed / asked
