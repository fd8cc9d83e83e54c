"""Which faults of which thrusters no detector can tell apart from one interval, by the effectiveness alone.

The change that a fault makes is a column times the seconds of firing that are lost or added, or, of a
misalignment, one of the columns of the same thruster turned. Where two such changes are parallel, only their
course in time differs: a loss follows what its thruster was commanded, thrust without command does not. So
two thrusters with such faults cannot be told apart as long as what they are commanded does not change.

Left out: what several intervals show; scatter and noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from thruster_baselines.detection.fault_flights import tilted_columns
from thruster_baselines.estimation import PhysicalNoise
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Pair", "inseparable_pairs"]

PARALLEL = "losses alike, thrust without command alike: the columns are parallel"
OPPOSITE = "a loss of one is thrust without command of the other: the columns are opposite"
TILTS = "any misalignment of one is one of the other: their thrusts act at the same point"
_TILTED_INTO = "a misalignment of one is a loss or thrust without command of the other"


class Pair(NamedTuple):
    """Two thrusters, from 1, with faults that look alike for as long as the commands do not change."""

    first: int
    second: int
    reason: str


def inseparable_pairs(spacecraft: Spacecraft, angle: float = 0.05) -> list[Pair]:
    """Pairs of thrusters with faults whose changes are parallel, in standard deviations of the sensors.

    Args:
        spacecraft: Nominal.
        angle: Up to which two changes count as parallel, rad.

    >>> from thruster_envs.spacecraft import load
    >>> [one[:2] for one in inseparable_pairs(load("spheres")) if one.reason == OPPOSITE][:3]
    [(1, 7), (2, 8), (3, 9)]
    """
    weights = 1.0 / np.sqrt(PhysicalNoise(spacecraft).sensors)
    columns = weights[:, np.newaxis] * spacecraft.effectiveness()
    across = weights[:, np.newaxis] * tilted_columns(spacecraft)
    units = columns / np.linalg.norm(columns, axis=0)
    spaces = [
        np.linalg.qr(np.stack([columns[:, i], *across[:, :, i]], axis=1))[0] for i in range(columns.shape[1])
    ]
    pairs = []
    for i in range(columns.shape[1]):
        for j in range(i + 1, columns.shape[1]):
            along = float(units[:, i] @ units[:, j])
            if abs(along) >= np.cos(angle):
                pairs.append(Pair(i + 1, j + 1, PARALLEL if along > 0.0 else OPPOSITE))
            if np.linalg.svd(spaces[i].T @ spaces[j], compute_uv=False)[-1] >= np.cos(angle):
                pairs.append(Pair(i + 1, j + 1, TILTS))
            ways = (np.linalg.norm(spaces[i].T @ units[:, j]), np.linalg.norm(spaces[j].T @ units[:, i]))
            if max(ways) >= np.cos(angle) and abs(along) < np.cos(angle):
                pairs.append(Pair(i + 1, j + 1, _TILTED_INTO))
    return pairs
