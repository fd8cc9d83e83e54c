"""What thrusters on a shared feed cost each other when they fire together, and how to make up for it.

With N thrusters open at some moment, each gives the share g(N) of its thrust; on Orion 6 % less for each
further one (Yang 2003, section 2.4). All on-times of a period start at its beginning, so those still open at
time t are those with u_i >= t, and thruster i delivers what it would have delivered alone in

    e_i = integral over 0 <= t <= u_i of g(N(t)).

Sorted on-times cut the period into pieces of constant N, which makes the integral a sum over pieces (Yang
2003, appendix B). As g is positive, the order of the e_i is that of the u_i, so that the relation can be
turned round in the same way: between two consecutive e, with N thrusters to come, time passes 1 / g(N) times
as fast. No iteration is needed.

Left out: valve delays and ramps, and losses that depend on which thrusters are open and not only on how many.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.mapping.model import matrix_times_vector
from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray, IntArray

__all__ = [
    "Coupling",
    "commanded_on_times",
    "delivered_on_times",
    "delivered_rate_change",
    "thrust_shares",
]

Coupling: TypeAlias = float | Sequence[float] | NDArray[np.float64] | Callable[[int], float]
"""The loss of each open thruster, as a share of its thrust: one number for each *further* thruster open, or a
table for 1, 2, ... thrusters open, or a function of how many are open."""


def thrust_shares(coupling: Coupling, thrusters: int) -> FloatArray:
    """(n + 1,): what share of its thrust an open thruster gives with 0, 1, ... n of them open.

    Raises:
        ValueError: A loss that is not a number from 0 to 1, or a table of the wrong length.

    >>> thrust_shares(0.06, 4).round(2).tolist()
    [1.0, 1.0, 0.94, 0.88, 0.82]
    """
    if callable(coupling):
        losses = np.array([coupling(count) for count in range(1, thrusters + 1)], dtype=np.float64)
    else:
        losses = np.array(coupling, dtype=np.float64)
        if losses.ndim == 0:
            if not 0.0 <= losses <= 1.0:
                raise ValueError(f"coupling is {coupling}; a share of the thrust from 0 to 1 would be right")
            losses = np.minimum(losses * np.arange(thrusters), 1.0)
    if losses.shape != (thrusters,):
        raise ValueError(
            f"coupling has the shape {losses.shape}; ({thrusters},), a loss for 1 to {thrusters} thrusters "
            "open, would be right"
        )
    valid = (losses >= 0.0) & (losses <= 1.0)
    if not valid.all():
        count = int(np.argmin(valid))
        raise ValueError(
            f"coupling: the loss with {count + 1} thrusters open is {losses[count]}; a share of the thrust "
            "from 0 to 1 would be right"
        )
    return np.concatenate([[1.0], 1.0 - losses])


def delivered_on_times(on_times: ArrayLike, coupling: Coupling) -> FloatArray:
    """For how long each thruster would have to fire alone to give what it gives in company.

    Args:
        on_times: (..., n), s, all starting together.
        coupling: Share of thrust lost per further thruster open, or a loss curve; see `Coupling`.

    Raises:
        ValueError: On-times that are negative or not finite, a coupling that cannot be.

    >>> delivered_on_times([4.5, 4.5, 4.5, 4.5, 0.0], 0.06).round(6).tolist()
    [3.69, 3.69, 3.69, 3.69, 0.0]
    """
    times = _on_times(on_times, "on_times")
    answer = np.empty_like(times)
    _by_rows(times.reshape(-1, times.shape[-1]), thrust_shares(coupling, times.shape[-1]), True, answer)
    return answer


def commanded_on_times(wanted: ArrayLike, coupling: Coupling, max_on_time: float = np.inf) -> FloatArray:
    """On-times that deliver in company what `wanted` would deliver without coupling.

    Where they exceed `max_on_time` they are cut, and the delivery of those thrusters falls short.

    Args:
        wanted: (..., n), s.
        coupling: Share of thrust lost per further thruster open, or a loss curve; see `Coupling`.
        max_on_time: s; has to be finite if so many are wanted that nothing of their thrust is left.

    Raises:
        ValueError: On-times that are negative or not finite, a coupling that cannot be, on-times that no
            finite time delivers.

    >>> commanded_on_times([3.69, 3.69, 3.69, 3.69, 0.0], 0.06).round(6).tolist()
    [4.5, 4.5, 4.5, 4.5, 0.0]
    """
    times = _on_times(wanted, "wanted")
    answer = np.empty_like(times)
    _by_rows(times.reshape(-1, times.shape[-1]), thrust_shares(coupling, times.shape[-1]), False, answer)
    answer = np.minimum(answer, max_on_time)
    if not np.isfinite(answer).all():
        raise ValueError(
            "wanted cannot be delivered: with so many thrusters open nothing of their thrust is left; a "
            "finite max_on_time, or fewer thrusters, would be right"
        )
    return answer


def delivered_rate_change(effectiveness: ArrayLike, on_times: ArrayLike, coupling: Coupling) -> FloatArray:
    """Rate change (..., m), m/s then rad/s, that on-times give with the loss of the shared feed.

    Args:
        effectiveness: (..., m, n), m/s^2 then rad/s^2.
        on_times: (..., n), s, all starting together.
        coupling: Share of thrust lost per further thruster open, or a loss curve; see `Coupling`.

    >>> delivered_rate_change([[1.0, 1.0]], [1.0, 2.0], 0.06).round(6).tolist()
    [2.88]
    """
    matrix = np.asarray(effectiveness, dtype=np.float64)
    return matrix_times_vector(matrix, delivered_on_times(on_times, coupling))


def _on_times(given: ArrayLike, name: str) -> FloatArray:
    times = np.array(given, dtype=np.float64, order="C")
    if times.ndim == 0:
        raise ValueError(f"{name} is a single number; (..., n), one per thruster, would be right")
    valid = np.isfinite(times) & (times >= 0.0)
    if not valid.all():
        raise ValueError(
            f"{name} has the entry {times[~valid][0]}; a finite number of s, zero or more, would be right"
        )
    return times


@kernel(nogil=True)
def _by_rows(times: FloatArray, shares: FloatArray, forward: bool, answer: FloatArray) -> None:
    rows = answer.reshape(times.shape)
    order = np.empty(times.shape[1], np.int64)
    for i in range(times.shape[0]):
        convert(times[i], shares, order, forward, rows[i])


@njit(error_model="numpy")
def convert(
    times: FloatArray, shares: FloatArray, order: IntArray, forward: bool, answer: FloatArray
) -> None:
    """From on-times to what they deliver (`forward`), or from what is wanted to the on-times.

    Args:
        times: (n,), s, not negative.
        shares: (n + 1,), see `thrust_shares`.
        order: (n,), scratch.
        forward: Which way.
        answer: (n,), s, written.
    """
    n = times.size
    count = 0
    for i in range(n):  # the open ones in ascending order
        answer[i] = 0.0
        if times[i] > 0.0:
            place = count
            while place > 0 and times[order[place - 1]] > times[i]:
                order[place] = order[place - 1]
                place -= 1
            order[place] = i
            count += 1
    last, total = 0.0, 0.0
    for place in range(count):
        i = order[place]
        piece = times[i] - last
        if piece > 0.0:
            share = shares[count - place]
            total += piece * share if forward else piece / share
            last = times[i]
        answer[i] = total
