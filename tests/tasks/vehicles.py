"""Vehicles that are unlike the catalogue's: few thrusters or many, planar, without any noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from thruster_envs.spacecraft import Spacecraft, load
from thruster_envs.spacecraft import catalogue as names

QUIET = {"position": 0.0, "velocity": 0.0, "attitude": 0.0, "rate": 0.0}


def vehicles() -> dict[str, Spacecraft]:
    """Name to vehicle: those of the catalogue, and variants of each kind of thruster."""
    catalogue = {name: load(name) for name in names()}
    found = dict(catalogue)
    for base in ("orion", "msr_chaser", "ppt_cubesat"):
        plain = catalogue[base].to_dict()
        for name, changes in _changes(plain).items():
            found[f"{base} {name}"] = Spacecraft.from_dict(plain | {"name": f"{base} {name}"} | changes)
    return found


def _changes(plain: dict[str, Any]) -> dict[str, dict[str, Any]]:
    thrusters = plain["thrusters"]
    reach = max(math.dist(one["position"], (0.0, 0.0, 0.0)) for one in thrusters)
    first = thrusters[0]
    angles = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    return {
        "one thruster": {"thrusters": [first]},
        "one thruster, no noise": {"thrusters": [first], "sensors": QUIET},
        "through the centre, no noise": {
            "thrusters": [
                first | {"name": f"T{k}", "position": (0.0, 0.0, 0.0), "direction": direction}
                for k, direction in enumerate(((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))
            ],
            "sensors": QUIET,
        },
        "planar, no noise": {
            "thrusters": [
                first | {"name": f"T{k}", "position": (x, y, 0.0), "direction": (0.0, d, 0.0)}
                for k, (x, y, d) in enumerate(
                    ((reach, 0.0, 1.0), (reach, 0.0, -1.0), (-reach, 0.0, 1.0), (-reach, 0.0, -1.0))
                )
            ],
            "sensors": QUIET,
        },
        "40 thrusters": {
            "thrusters": [
                first
                | {
                    "name": f"T{k}",
                    "position": (reach * math.cos(a), reach * math.sin(a), 0.1 * reach * (k % 3 - 1)),
                    "direction": (math.cos(2.0 * a), math.sin(3.0 * a), math.cos(k)),
                }
                for k, a in enumerate(angles.tolist())
            ]
        },
        "no noise": {"sensors": QUIET},
        "noise of rates only": {"sensors": QUIET | {"rate": 1e-4}},
    }
