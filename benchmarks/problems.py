"""Mapping problems to time mappers with: three vehicles, commands of three kinds and a mixture, and flights.

*Interior* commands can be tracked within the period. *Saturated* ones ask for more of some axis than all
thrusters together can give. *Degenerate* ones are on one or two axes only, so that several vertices of the
feasible set coincide. The *mixture* is like a flight with faults: 30 % of the problems have one thruster
dead, a quarter of the commands is on one or two axes and a quarter four times as large as the rest.

A *flight* is a row of commands that follow each other smoothly: on each axis the sum of three sines with
periods of 40 to 400 commands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.mapping.simplex import solve_batch
from thruster_envs.spacecraft import load, objective_weights

Array = NDArray[np.float64]

VEHICLES = ("Orion 6x12", "SPHERES 6x12", "twofold Orion 6x24")
"""The last is an Orion with a second thruster of another strength beside each of its own."""

KINDS = ("interior", "saturated", "degenerate")
MIXTURE = "mixture"

SHARE_DEAD = 0.3
"""Of the mixture's problems: how many have a dead thruster."""


@dataclass(frozen=True)
class Vehicle:
    """What a mapper has to know of a craft.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2.
        period: Longest on-time of each thruster, s.
        fuel_cost: (n,), per s; the default of the mappers.
        slack_cost: (m,), per m/s then per rad/s; the default of the mappers.
    """

    effectiveness: Array
    period: float
    fuel_cost: Array
    slack_cost: Array

    @property
    def authority(self) -> Array:
        """(m,): the most that can be given on an axis in a period, of either sign; m/s then rad/s."""
        one_way = np.maximum(self.effectiveness, 0.0).sum(axis=1)
        other_way = np.maximum(-self.effectiveness, 0.0).sum(axis=1)
        reach: Array = self.period * np.maximum(one_way, other_way)
        return reach


@dataclass(frozen=True)
class Problems:
    """Mapping problems of one vehicle that share their costs.

    Attributes:
        command: (count, m), m/s then rad/s.
        effectiveness: (m, n), of the healthy vehicle, m/s^2 then rad/s^2.
        max_on_time: (count, n), s; zero for a dead thruster.
        fuel_cost: (n,), per s.
        slack_cost: (m,), per m/s then per rad/s.
    """

    command: Array
    effectiveness: Array
    max_on_time: Array
    fuel_cost: Array
    slack_cost: Array

    @property
    def faulted(self) -> Array:
        """(count, m, n): the effectiveness of each problem, its dead thruster's column zero."""
        return np.ascontiguousarray(self.effectiveness * (self.max_on_time > 0.0)[:, np.newaxis, :])

    def solve(self, threads: int | None = None) -> tuple[Array, Array, Array]:
        """On-times (count, n) in s, slack (count, m) and least objectives (count,), by our kernel."""
        on_times, slack, cost, _ = solve_batch(
            self.command, self.effectiveness[np.newaxis], self.max_on_time, self.fuel_cost[np.newaxis],
            self.slack_cost, threads,
        )  # fmt: skip
        return on_times, slack, cost

    def misses(self, on_times: Array) -> Array:
        """(count,): weighed misses of some on-times (count, n)."""
        slack = self.command - on_times @ self.effectiveness.T
        weighed: Array = np.abs(slack) @ self.slack_cost
        return weighed


def vehicle(name: str) -> Vehicle:
    """One of `VEHICLES`."""
    spacecraft = load("spheres" if name.startswith("SPHERES") else "orion")
    effectiveness = spacecraft.effectiveness()
    if name.startswith("twofold"):
        strengths = np.random.default_rng(0).uniform(0.5, 1.5, effectiveness.shape[1])
        effectiveness = np.hstack([effectiveness, effectiveness * strengths])
    period = float(spacecraft.control_period)
    return Vehicle(effectiveness, period, *objective_weights(effectiveness, 1.0))  # the period cancels


def problems(count: int, craft: str = VEHICLES[0], kind: str = MIXTURE, seed: int = 0) -> Problems:
    """So many problems of one of `VEHICLES` and of one of `KINDS`, or of the mixture."""
    rng = np.random.default_rng(seed)
    known = vehicle(craft)
    m, n = known.effectiveness.shape
    max_on_time = np.full((count, n), known.period)
    if kind == MIXTURE:
        command = rng.uniform(-0.4, 0.4, (count, m))
        place = rng.random(count)
        command[place < 0.25] *= _few_axes(rng, count, m)[place < 0.25]
        command[place > 0.75] *= 4.0
        dead = rng.random(count) < SHARE_DEAD
        max_on_time[dead, rng.integers(n, size=int(dead.sum()))] = 0.0
    else:
        command = rng.uniform(-1.0, 1.0, (count, m))
        if kind == "degenerate":
            command *= _few_axes(rng, count, m)
        command *= _size(kind, rng.random((count, 1))) / np.abs(command).max(axis=1, keepdims=True)
    return Problems(
        command * known.authority, known.effectiveness, max_on_time, known.fuel_cost, known.slack_cost
    )


def flight(steps: int, craft: str = VEHICLES[0], kind: str = KINDS[0], seed: int = 0) -> Problems:
    """So many commands of a kind that follow each other."""
    rng = np.random.default_rng(seed)
    known = vehicle(craft)
    m, n = known.effectiveness.shape
    angle = 2.0 * np.pi * (
        np.arange(steps)[:, np.newaxis, np.newaxis] / rng.uniform(40.0, 400.0, (m, 3)) + rng.random((m, 3))
    )  # fmt: skip
    command = np.sin(angle).sum(axis=2) / 3.0
    if kind == "degenerate":
        command[:, rng.permutation(m)[2:]] = 0.0
    if kind == "saturated":
        command /= np.abs(command).max(axis=1, keepdims=True)
    slow = 0.5 + 0.5 * np.sin(2.0 * np.pi * np.arange(steps)[:, np.newaxis] / 500.0)
    return Problems(
        _size(kind, slow) * command * known.authority, known.effectiveness, np.full((steps, n), known.period),
        known.fuel_cost, known.slack_cost,
    )  # fmt: skip


def _few_axes(rng: np.random.Generator, count: int, axes: int) -> NDArray[np.bool_]:
    """(count, axes): one or two axes each."""
    order = rng.permuted(np.tile(np.arange(axes), (count, 1)), axis=1)
    few: NDArray[np.bool_] = order < rng.integers(1, 3, (count, 1))
    return few


def _size(kind: str, share: Array) -> Array:
    """How large the largest entry of a command is, in shares of authority, for numbers 0 to 1."""
    least, most = _SIZES[kind]
    return least + (most - least) * share


_SIZES = {"interior": (0.02, 0.16), "saturated": (1.2, 4.0), "degenerate": (0.05, 0.4)}
