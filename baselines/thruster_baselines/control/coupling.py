"""Making up for what thrusters cost each other when they fire together.

A thruster on a shared feed loses the share `coupling` of its thrust for each further thruster open at that
moment. All on-times of a period start at its beginning, so thruster i, open for u_i, is together with
thruster j for min(u_i, u_j), and delivers what it would have delivered alone in

    e_i = u_i - coupling * sum_{j != i} min(u_i, u_j)                     (Yang 2003, section 2.3)

This module inverts that relation for wanted e. It keeps the choice of thrusters, which a mapper has made as
if they were independent; choosing them with the loss in mind (method II of the source, a mixed-integer
program) is left out, and so are valve delays and losses that do not add up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.protocols import FloatArray

__all__ = ["commanded_on_times", "delivered_on_times"]

_ROUNDS = 200
_TOLERANCE = 1e-12


def delivered_on_times(on_times: ArrayLike, coupling: float) -> FloatArray:
    """For how long each thruster would have to fire alone to give what it gives in company.

    Args:
        on_times: (..., n), s, all starting together.
        coupling: Share of thrust lost per further thruster open.

    >>> delivered_on_times([4.5, 4.5, 4.5, 4.5, 0.0], 0.06).round(6).tolist()
    [3.69, 3.69, 3.69, 3.69, 0.0]
    """
    times = np.asarray(on_times, dtype=np.float64)
    return times - coupling * _time_in_company(times)


def commanded_on_times(wanted: ArrayLike, coupling: float, max_on_time: float = np.inf) -> FloatArray:
    """On-times that deliver what `wanted` would deliver without coupling.

    The least solution is found by inflating on-times until nothing changes. Where it exceeds `max_on_time`
    it is cut, and the delivery falls short.

    Args:
        wanted: (..., n), s.
        coupling: Share of thrust lost per further thruster open; with k thrusters open, below 1 / (k - 1).
        max_on_time: s; has to be finite if coupling is as large as that.

    >>> commanded_on_times([3.69, 3.69, 3.69, 3.69, 0.0], 0.06).round(6).tolist()
    [4.5, 4.5, 4.5, 4.5, 0.0]
    """
    target = np.asarray(wanted, dtype=np.float64)
    times = target
    for _ in range(_ROUNDS):
        longer = np.minimum(target + coupling * _time_in_company(times), max_on_time)
        settled = float(np.abs(longer - times).max(initial=0.0)) <= _TOLERANCE
        times = longer
        if settled:
            break
    return np.where(target > 0.0, times, target)


def _time_in_company(on_times: FloatArray) -> FloatArray:
    """Sum over j != i of min(u_i, u_j), (..., n), s."""
    together = np.minimum(on_times[..., :, np.newaxis], on_times[..., np.newaxis, :])
    total: FloatArray = together.sum(axis=-1) - on_times
    return total
