"""The linear-programming mapper: least fuel where a command can be tracked, least miss where it cannot.

It minimises `fuel_cost @ on_times + slack_cost @ abs(slack)` over 0 <= on_times <= max_on_time, where slack
is the commanded minus the achieved rate change (Yang 2003, eqs. 1-3). Simultaneous firings are taken as
independent: the thrust that they cost each other through a shared feed is not in the model
(`AdditiveCompensationMapper` and its relatives have it).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import CompiledMapper, raise_unless_optimal
from thruster_baselines.mapping.model import require_command_shape, require_finite_command
from thruster_baselines.mapping.sequence import LPSequence
from thruster_baselines.mapping.simplex import OPTIMAL, solve_one
from thruster_envs.protocols import Allocation, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["LPMapper"]


class LPMapper(CompiledMapper):
    """Maps commanded rate changes to thruster on-times by a linear program, solved exactly.

    The answer is a vertex of the feasible set: at most as many thrusters as axes are open for part of the
    period, the others not at all or for all of it. Among equally cheap vertices, neighbours with fewer open
    thrusters are preferred. One command or a batch of any shape; a batch gives, bit for bit, what its
    commands give one by one.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period. May be infinite.
        fuel_cost: (n,) or one number, per s of firing; raise an entry to spare that thruster.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss. The default is so large that
            tracking always comes before fuel; see `thruster_envs.spacecraft.objective_weights`.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Attributes:
        effectiveness: (m, n), m/s^2 then rad/s^2; read-only.
        max_on_time: (n,), s; read-only.
        fuel_cost: (n,), per s; read-only.
        slack_cost: (m,), per m/s then per rad/s; read-only.
        lost_directions: (k, m), rate changes that no firing gives; empty for a model of full rank.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.

    >>> from thruster_envs.spacecraft import load
    >>> allocation = LPMapper(load("orion"))([-0.027, -0.027, 0.0, 0.0, 0.0, 0.0])
    >>> allocation.on_times.round(9)
    array([4.5, 0. , 0. , 0. , 0. , 4.5, 0. , 0. , 0. , 4.5, 0. , 4.5])
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
        *,
        fuel_may_win: bool = False,
    ) -> None:
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, threads, fuel_may_win=fuel_may_win)
        self._single = (self._model.effectiveness.shape[0],)
        self._alone = self._model.effectiveness[np.newaxis], self._model.max_on_time[np.newaxis]

    def __call__(
        self,
        command: ArrayLike,
        *,
        effectiveness: ArrayLike | None = None,
        max_on_time: ArrayLike | None = None,
    ) -> Allocation:
        """Allocate a command (..., m), m/s then rad/s, body frame; see `thruster_envs.protocols.Mapper`.

        Raises:
            ValueError: A wrong shape, a command or effectiveness that is not finite, an on-time bound that
                is negative or NaN.
            RuntimeError: The solver did not reach the optimum; not known to happen.
        """
        if effectiveness is not None or max_on_time is not None:
            return super().__call__(command, effectiveness=effectiveness, max_on_time=max_on_time)
        commands = np.array(command, dtype=np.float64, order="C")
        if commands.shape == self._single:  # the short way, checked by the kernel itself
            return self._solve_one(commands)
        require_command_shape(commands, self._single[0])
        require_finite_command(commands)
        return self._allocate(commands, self._model)

    def sequence(self, worlds: int | None = None) -> LPSequence:
        """A mapper for commands that follow each other: each starts from the basis of the one before.

        Args:
            worlds: How many craft fly side by side, each with its own sequence; None for one.
        """
        return LPSequence(
            self.effectiveness, self.max_on_time, self.fuel_cost, self.slack_cost,
            worlds=worlds, threads=self._threads, fuel_may_win=True,
        )  # fmt: skip

    def pivots(self, command: ArrayLike) -> tuple[IntArray, IntArray]:
        """How many steps the simplex method takes for each command (..., m).

        Returns:
            Changes of basis, and moves of a thruster from one bound straight to the other; both (...,).
        """
        commands = np.array(command, dtype=np.float64, order="C")
        m = self._single[0]
        require_command_shape(commands, m)
        require_finite_command(commands)
        report = self._run(commands.reshape(-1, m), *self._alone)[3].reshape(*commands.shape[:-1], 3)
        return report[..., 1].copy(), report[..., 2].copy()

    def _solve_one(self, command: FloatArray) -> Allocation:
        """One command (m,) for the mapper's own model."""
        m, n = self._model.effectiveness.shape
        on_times, slack, cost, report = np.empty(n), np.empty(m), np.empty(1), np.empty(3, np.int64)
        solve_one(
            command, self._model.effectiveness, self._model.max_on_time, self._fuel_cost, self._slack_cost,
            on_times, slack, cost, report,
        )  # fmt: skip
        if report[0] != OPTIMAL:
            raise_unless_optimal(command, report)
        return Allocation(on_times, slack, cost.reshape(()), report[:1].reshape(()))
