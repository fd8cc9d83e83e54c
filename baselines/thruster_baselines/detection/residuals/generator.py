"""The running residual generator: one observer of `design` for each of many vehicles, compiled.

Each vehicle begins in the steady state of its first sample, as if command and position had always been what
they are then; its velocity is then wrong by the whole speed of the approach, so that residuals mean nothing
for the first half minute. A sample without a measurement is taken as one with no residual: the observer goes
on by its model. One of six states bears that well; with Pade's states the estimates swing so far with the
noise of single samples that one lost in ten trebles the residual.

Left out: the turn of the thrust into the axes of the design, which `turned_thrust` gives to kernels that are
fed with open rates and attitudes.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.detection.residuals.design import ResidualDesign
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.kernels import kernel
from thruster_envs.physics.attitude import rotate_back
from thruster_envs.protocols import BoolArray, FloatArray

__all__ = ["Observers", "ResidualGenerator", "observe", "turned_direction", "turned_thrust"]


class Observers:
    """The observers of a batch of vehicles as compiled functions take them.

    Attributes:
        matrices: Of the design: (s, s + 6) for the next state, (3, s + 6) for the residual, each for the
            state and then [u; y], (s, 6) for the first state, (3, 3) for the position without a residual.
        states: (vehicles, s).
        held: (vehicles, late, 3), commands that have not entered yet, m/s^2; the oldest first.
        begun: (vehicles,), whether there has been a first sample.
        arrays: All of them, in the order in which `observe` takes them.
    """

    def __init__(self, design: ResidualDesign, vehicles: int) -> None:
        self.matrices = (
            np.ascontiguousarray(np.hstack([design.transition, design.entry])),
            np.ascontiguousarray(np.hstack([design.output, design.feedthrough])),
            design.steady_state(),
            np.linalg.inv(design.feedthrough[:, 3:]),
        )
        self.states: FloatArray = np.zeros((vehicles, design.states))
        self.held: FloatArray = np.zeros((vehicles, design.late, 3))
        self.begun: BoolArray = np.zeros(vehicles, np.bool_)
        self.arrays: tuple[Any, ...] = (*self.matrices, self.states, self.held, self.begun)


class ResidualGenerator:
    """Residuals of many vehicles from the commanded thrust and the measured position.

    Args:
        design: Of the observer.
        vehicles: How many.

    >>> from thruster_baselines.detection.residuals import pade_design
    >>> generator = ResidualGenerator(pade_design(8.5e-4))
    >>> bool(np.abs(generator.step([[0.0, 0.0, 0.0]], [[0.0, 7.0, 0.0]])).max() < 1e-3)  # at rest there
    True
    """

    def __init__(self, design: ResidualDesign, vehicles: int = 1) -> None:
        self.design = design
        self._observers = Observers(design, vehicles)

    def step(self, command: ArrayLike, position: ArrayLike) -> FloatArray:
        """Take in one sample.

        Args:
            command: (vehicles, 3), force over mass commanded from this sample on, m/s^2, axes of the design.
            position: (vehicles, 3), measured at this sample, m.

        Returns:
            (vehicles, 3): the residual, m.

        Raises:
            ValueError: A wrong shape.
        """
        count = self._observers.begun.size
        given = [np.ascontiguousarray(one, dtype=np.float64) for one in (command, position)]
        for name, values in zip(("command", "position"), given, strict=True):
            if values.shape != (count, 3):
                raise ValueError(f"{name} has the shape {values.shape}; ({count}, 3) would be right")
        residual = np.empty((count, 3))
        in_threads(partial(_step, self._observers.arrays, given[0], given[1], residual), count)
        return residual

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin anew, in the vehicles of a mask (vehicles,) or in all of them."""
        self._observers.begun[... if vehicles is None else np.asarray(vehicles)] = False


@njit(error_model="numpy", inline="always")
def turned_thrust(effectiveness, open_rates, q):  # type: ignore[no-untyped-def]
    """Commanded force over mass in the axes of eq. 29, m/s^2.

    Args:
        effectiveness: (6, n), m/s^2 then rad/s^2, body axes.
        open_rates: (n,).
        q: Attitude, body from LVLH, as a tuple.
    """
    x, y, z = 0.0, 0.0, 0.0
    for i in range(open_rates.shape[0]):
        x += effectiveness[0, i] * open_rates[i]
        y += effectiveness[1, i] * open_rates[i]
        z += effectiveness[2, i] * open_rates[i]
    force = rotate_back(q, (x, y, z))
    return force[1], -force[2], -force[0]


@njit(error_model="numpy", inline="always")
def turned_direction(effectiveness, i, q):  # type: ignore[no-untyped-def]
    """Force over mass of thruster i, from 0, fully open, in the axes of eq. 29; see `turned_thrust`."""
    force = rotate_back(q, (effectiveness[0, i], effectiveness[1, i], effectiveness[2, i]))
    return force[1], -force[2], -force[0]


@njit(error_model="numpy")
def observe(observers, u, y, measured, v, r):  # type: ignore[no-untyped-def]
    """Residual of vehicle v into r (3,), and its next state.

    Args:
        observers: `Observers.arrays`.
        u: Command of this sample, m/s^2, a tuple.
        y: Position, m, a tuple; anything where it is not measured.
        measured: Whether there is a position.
        v: Which vehicle.
        r: (3,), written.
    """
    advance, output, rest, bridge, states, held, begun = observers
    size = states.shape[1]
    late = held.shape[1]
    x = states[v]
    if not begun[v]:
        if not measured:
            r[0] = r[1] = r[2] = 0.0
            return
        begun[v] = True
        for j in range(size):
            x[j] = (
                rest[j, 0] * u[0] + rest[j, 1] * u[1] + rest[j, 2] * u[2]
                + rest[j, 3] * y[0] + rest[j, 4] * y[1] + rest[j, 5] * y[2]
            )  # fmt: skip
        for k in range(late):
            held[v, k, 0], held[v, k, 1], held[v, k, 2] = u
    u0, u1, u2 = u
    if late > 0:
        u0, u1, u2 = held[v, 0, 0], held[v, 0, 1], held[v, 0, 2]
        for k in range(late - 1):
            for j in range(3):
                held[v, k, j] = held[v, k + 1, j]
        held[v, late - 1, 0], held[v, late - 1, 1], held[v, late - 1, 2] = u
    for j in range(3):
        total = output[j, size] * u0 + output[j, size + 1] * u1 + output[j, size + 2] * u2
        for k in range(size):
            total += output[j, k] * x[k]
        r[j] = total
    y0, y1, y2 = y
    if measured:
        for j in range(3):
            r[j] += output[j, size + 3] * y0 + output[j, size + 4] * y1 + output[j, size + 5] * y2
    else:
        y0 = -(bridge[0, 0] * r[0] + bridge[0, 1] * r[1] + bridge[0, 2] * r[2])
        y1 = -(bridge[1, 0] * r[0] + bridge[1, 1] * r[1] + bridge[1, 2] * r[2])
        y2 = -(bridge[2, 0] * r[0] + bridge[2, 1] * r[1] + bridge[2, 2] * r[2])
        r[0] = r[1] = r[2] = 0.0
    following = np.empty(size)
    for j in range(size):
        total = (
            advance[j, size] * u0 + advance[j, size + 1] * u1 + advance[j, size + 2] * u2
            + advance[j, size + 3] * y0 + advance[j, size + 4] * y1 + advance[j, size + 5] * y2
        )  # fmt: skip
        for k in range(size):
            total += advance[j, k] * x[k]
        following[j] = total
    for j in range(size):
        x[j] = following[j]


@kernel(nogil=True)
def _step(observers, command, position, residual, first, last):  # type: ignore[no-untyped-def]
    for v in range(first, last):
        u = (command[v, 0], command[v, 1], command[v, 2])
        y = (position[v, 0], position[v, 1], position[v, 2])
        observe(observers, u, y, True, v, residual[v])
