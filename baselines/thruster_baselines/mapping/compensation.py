"""What the mappers have in common that make up for the coupling loss of a shared feed.

Their slack is what was commanded minus what the on-times deliver with the loss, by overlap
(`thruster_baselines.mapping.coupling`). Where a command is beyond the authority, they aim at what the linear
program without loss would give (Yang 2003, appendix B), and take what the loss leaves of it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

from numba import njit
from numpy.typing import ArrayLike

from thruster_baselines.mapping.base import CompiledMapper, raise_unless_optimal
from thruster_baselines.mapping.coupling import Coupling, thrust_shares
from thruster_baselines.mapping.model import Model
from thruster_baselines.mapping.simplex import NOT_CONVERGED, OPTIMAL, Solutions, in_threads
from thruster_envs.protocols import Allocation, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["CAPPED", "CYCLED", "SHORT", "CompensatedAllocation", "CompensatingMapper"]

CYCLED = 3
"""Status: the iterations went on without coming nearer; the best of them is the answer."""

SHORT = 4
"""Status: the loss cannot be made up within the longest on-times."""

CAPPED = 5
"""Status: the largest number of iterations was reached on the way."""


@dataclass(frozen=True, slots=True)
class CompensatedAllocation(Allocation):
    """An allocation that knows of the coupling loss.

    Attributes:
        on_times: (..., n), s.
        slack: (..., m), command units, signed: what was commanded minus what is delivered, loss included.
        cost: (...,), fuel cost of the on-times plus slack cost of that slack.
        status: (...,). 0, or `CYCLED`, `SHORT` or `CAPPED`.
        iterations: (...,). How many linear programs were solved.
    """

    iterations: IntArray


class CompensationSettings(TypedDict, total=False):
    """What mappers that make up for the coupling loss take as keyword arguments; see `CompensatingMapper`."""

    coupling: Coupling | None
    tolerance: float
    max_iterations: int
    fuel_may_win: bool


class CompensatingMapper(CompiledMapper):
    """A mapper that makes up for what open thrusters cost each other.

    Args:
        spacecraft: Description, or effectiveness matrix (m, n) in m/s^2 then rad/s^2.
        max_on_time: (n,) or one number, s; a spacecraft's default is its control period.
        fuel_cost: (n,) or one number, per s of firing.
        slack_cost: (m,) or one number, per m/s then per rad/s of miss.
        threads: Threads that share a large batch; by default one per processor. Does not change the result.
        coupling: Share of thrust lost per further thruster open, or a loss curve (see
            `thruster_baselines.mapping.coupling.Coupling`); a spacecraft's default is that of its feed.
        tolerance: Largest miss that is good enough, as a share of the largest commanded rate change, both
            weighed by `slack_cost`.
        max_iterations: Linear programs at most.
        fuel_may_win: Accept costs at which leaving an axis alone is cheaper than serving it.

    Attributes:
        shares: (n + 1,), what share of its thrust an open thruster gives with 0 to n of them open; read-only.

    Raises:
        ValueError: A value that cannot be; with a bare matrix, a missing coupling.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | ArrayLike,
        max_on_time: ArrayLike | None = None,
        fuel_cost: ArrayLike | None = None,
        slack_cost: ArrayLike | None = None,
        threads: int | None = None,
        *,
        coupling: Coupling | None = None,
        tolerance: float = 1e-3,
        max_iterations: int = 50,
        fuel_may_win: bool = False,
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        super().__init__(spacecraft, max_on_time, fuel_cost, slack_cost, threads, fuel_may_win=fuel_may_win)
        self.shares = shares_of(spacecraft, coupling, self._model)
        if not 0.0 <= tolerance < 1.0:
            raise ValueError(f"tolerance is {tolerance}; a share of the command, 0 to 1, would be right")
        if max_iterations < 1:
            raise ValueError(f"max_iterations is {max_iterations}; one or more would be right")
        self.tolerance = tolerance
        self.max_iterations = max_iterations

    def constructor_arguments(self) -> dict[str, Any]:
        """The arguments by name with which to construct the like of it."""
        arguments = super().constructor_arguments()
        arguments.update(arguments.pop("settings", {}))
        return arguments

    def _run(
        self, command: FloatArray, effectiveness: FloatArray, max_on_time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        batch, m = command.shape
        answer = Solutions.empty(batch, m, effectiveness.shape[2], programs=True)
        problem = command, effectiveness, max_on_time, self._fuel_cost, self._slack_cost
        kernel, settings = self._kernel()
        in_threads(partial(kernel, problem, tuple(answer), self.shares, settings), batch, self._threads)
        status = answer.report[:, 0]
        if status.any():
            failed = (status > OPTIMAL) & (status <= NOT_CONVERGED)
            raise_unless_optimal(command[failed], answer.report[failed])
        return answer

    @abstractmethod
    def _kernel(self) -> tuple[Callable[..., None], tuple[Any, ...]]:
        """The kernel that answers commands, and its settings.

        It is called with the problems (fuel cost (n,)), the answers to be written, the shares (n + 1,), the
        settings, and with the first command to answer and the one behind the last.
        """

    def _answer(
        self, on_times: FloatArray, slack: FloatArray, cost: FloatArray, report: IntArray
    ) -> CompensatedAllocation:
        return CompensatedAllocation(
            on_times, slack, cost, report[..., 0].copy(), iterations=report[..., 3].copy()
        )


def shares_of(spacecraft: Spacecraft | ArrayLike, coupling: Coupling | None, model: Model) -> FloatArray:
    """Thrust shares (n + 1,), read-only, by a coupling or by that of a spacecraft's feed."""
    if coupling is None:
        if not isinstance(spacecraft, Spacecraft):
            raise ValueError("coupling is missing; with a bare matrix, the loss has to be given")
        coupling = spacecraft.feed.coupling
    shares = thrust_shares(coupling, model.max_on_time.size)
    shares.setflags(write=False)
    return shares


@njit(error_model="numpy")
def rate_change(effectiveness: FloatArray, on_times: FloatArray, answer: FloatArray) -> None:
    """Write A u (m,) of one effectiveness (m, n) and on-times (n,)."""
    for k in range(effectiveness.shape[0]):
        total = 0.0
        for j in range(effectiveness.shape[1]):
            total += effectiveness[k, j] * on_times[j]
        answer[k] = total


@njit(error_model="numpy")
def largest(weight: FloatArray, vector: FloatArray) -> float:
    """Largest weighed entry."""
    top = 0.0
    for k in range(vector.size):
        top = max(top, abs(weight[k] * vector[k]))
    return top


@njit(error_model="numpy")
def settle(
    command: FloatArray,
    achieved: FloatArray,
    on_times: FloatArray,
    fuel_cost: FloatArray,
    slack_cost: FloatArray,
    slack: FloatArray,
) -> float:
    """Write the slack (m,) and return the cost of on-times (n,) that achieve so much."""
    cost = 0.0
    for j in range(on_times.size):
        cost += fuel_cost[j] * on_times[j]
    for k in range(command.size):
        slack[k] = command[k] - achieved[k]
        cost += slack_cost[k] * abs(slack[k])
    return cost
