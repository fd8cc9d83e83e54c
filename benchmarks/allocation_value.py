"""What the linear program buys: propellant and wrench error beside the maps that flight software uses.

Requests can be met exactly: their direction is uniform in units of authority, and their size a uniform share
of the largest that the craft can give in that direction within a period. With a dead thruster the craft is
the one without it; directions that it cannot give at all are drawn anew. The thruster is another one from
request to request, each equally often.

The maps are the minimum-norm solution with just enough firing that cancels added to it (as Basilisk and
Astrobee do in one form or another) and with firing that cancels taken out of each group of thrusters (the
pair mixer of SPHERES). A dead thruster gives nothing and burns nothing, whatever it is told.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.problems import VEHICLES, Array, Vehicle, vehicle
from benchmarks.report import Row, markdown_table, number
from thruster_baselines.mapping import LPMapper, MinimumNormShiftMapper, NullSpaceMapper
from thruster_baselines.mapping.base import BaseMapper
from thruster_baselines.mapping.simplex import OPTIMAL, solve_batch

REQUESTS = 20_000

CASES = ("healthy", "one dead, known to the LP alone", "one dead, known to both")

MAPS: Mapping[str, Callable[[Vehicle], BaseMapper]] = {
    "minimum norm and shift": lambda craft: MinimumNormShiftMapper(craft.effectiveness, craft.period),
    "null space": lambda craft: NullSpaceMapper(craft.effectiveness, craft.period),
}

ABOUT = f"""\
*What the LP buys*, on {REQUESTS:,} requests that can be met exactly: directions uniform in units of
authority, sizes a uniform share of the largest that can be given. Thruster-seconds are the map's over the
LP's, also where the map gives less than was asked; the wrench error is what it misses, as a share of the
request, both in units of authority. A dead thruster gives and burns nothing."""

_UNREACHABLE = 1e-6
"""Directions of which less than this share of authority can be given are drawn anew."""


@dataclass(frozen=True)
class Value:
    """A map beside the linear program, request by request.

    Attributes:
        burnt: (requests,), thruster-seconds over those of the linear program.
        error: (requests,), what the map misses as a share of the request, in units of authority.
        linear_error: (requests,), the same of the linear program.
    """

    burnt: Array
    error: Array
    linear_error: Array


def rows(requests: int) -> tuple[list[Row], str]:
    """Rows of Orion's minimum-norm-and-shift map, and a table of all vehicles and maps.

    Args:
        requests: How many; `REQUESTS` for the report.
    """
    found = {
        (craft, name, case): compare(craft, name, case, requests)
        for craft in VEHICLES
        for name in MAPS
        for case in CASES
    }
    lines = []
    for case in CASES:
        value = found[VEHICLES[0], "minimum norm and shift", case]
        lines.append(
            Row(
                f"minimum norm and shift burns, {case}", float(np.median(value.burnt)),
                "times the LP's", note=f"thruster-seconds; quartiles {_quartiles(value.burnt)}", charted=True,
            )
        )  # fmt: skip
    value = found[VEHICLES[0], "minimum norm and shift", CASES[1]]
    lines.append(
        Row(
            f"minimum norm and shift misses, {CASES[1]}", 100.0 * float(np.median(value.error)), "%",
            note=f"wrench error; quartiles {_quartiles(100.0 * value.error)} %; the LP's is 0",
        )
    )  # fmt: skip
    return lines, _table(found)


def compare(craft: str, name: str, case: str, requests: int, seed: int = 0) -> Value:
    """One of `MAPS` beside the linear program, on one of `VEHICLES` in one of `CASES`."""
    known = vehicle(craft)
    rng = np.random.default_rng(seed)
    thrusters = known.effectiveness.shape[1]
    linear, other = LPMapper(known.effectiveness, known.period), MAPS[name](known)
    dead: list[int | None] = [None] if case == CASES[0] else list(range(thrusters))
    parts = []
    for thruster in dead:
        true = known.effectiveness.copy()
        if thruster is not None:
            true[:, thruster] = 0.0
        wanted = reachable(known, true, -(-requests // len(dead)), rng)
        best = linear(wanted, effectiveness=true).on_times
        mapped = other(wanted, effectiveness=true if case == CASES[2] else None).on_times
        mapped[:, ~true.any(axis=0)] = 0.0
        size = _length(wanted, known)
        parts.append(
            (
                mapped.sum(axis=1) / best.sum(axis=1),
                _length(wanted - mapped @ true.T, known) / size,
                _length(wanted - best @ true.T, known) / size,
            )
        )
    return Value(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def reachable(craft: Vehicle, effectiveness: Array, count: int, rng: np.random.Generator) -> Array:
    """(count, m): requests that this effectiveness can meet within the craft's period, m/s then rad/s."""
    found: list[Array] = []
    while sum(map(len, found)) < count:
        direction = rng.standard_normal((count, len(craft.authority)))
        direction *= craft.authority / np.linalg.norm(direction, axis=1, keepdims=True)
        most = farthest(craft, effectiveness, direction)
        request = (most * rng.random(count))[:, np.newaxis] * direction
        found.append(request[most > _UNREACHABLE])
    return np.concatenate(found)[:count]


def farthest(craft: Vehicle, effectiveness: Array, direction: Array) -> Array:
    """(count,): the largest multiples, up to 2, of directions (count, m) that can be given within a period.

    By the linear program that starts at twice the direction and pays for what has to be taken back; a miss
    is so dear that there is none.
    """
    count, n = len(direction), effectiveness.shape[1]
    start = 2.0
    matrix = np.concatenate(
        [np.broadcast_to(effectiveness, (count, *effectiveness.shape)), direction[:, :, np.newaxis]], axis=2
    )
    bounds = np.full((1, n + 1), craft.period)
    bounds[0, n] = start
    cost = np.zeros((1, n + 1))
    cost[0, n] = 1.0
    on_times, slack, _, report = solve_batch(
        start * direction, np.ascontiguousarray(matrix), bounds, cost, 1e6 / craft.authority
    )
    if (report[:, 0] != OPTIMAL).any():
        raise RuntimeError(
            f"{np.count_nonzero(report[:, 0])} directions were not solved; none would be right"
        )
    missed = (np.abs(slack) / craft.authority).max(axis=1) > _UNREACHABLE
    most: Array = np.where(missed, 0.0, start - on_times[:, n])
    return most


def _length(rate_change: Array, craft: Vehicle) -> Array:
    """(...,): lengths of rate changes (..., m) in units of authority."""
    length: Array = np.linalg.norm(rate_change / craft.authority, axis=-1)
    return length


def _quartiles(values: Array) -> str:
    low, high = np.quantile(values, [0.25, 0.75])
    return f"{number(float(low))} to {number(float(high))}"


def _table(found: dict[tuple[str, str, str], Value]) -> str:
    lines = [
        (
            craft,
            name,
            case,
            f"{number(float(np.median(value.burnt)))} ({_quartiles(value.burnt)})",
            f"{_percent(np.median(value.error))} ({_percent(np.quantile(value.error, 0.25))} to "
            f"{_percent(np.quantile(value.error, 0.75))})",
            f"{np.mean(value.error > 1e-6):.1%}",
            f"{np.mean(value.linear_error > 1e-6):.1%}",
        )
        for (craft, name, case), value in found.items()
    ]
    headings = (
        "vehicle", "map", "case", "thruster-seconds over the LP's, median (quartiles)",
        "wrench error, median (quartiles)", "requests missed", "by the LP",
    )  # fmt: skip
    return "### What the LP buys\n\n" + markdown_table(headings, lines)


def _percent(share: float) -> str:
    """A share in per cent; round-off is zero."""
    return f"{100.0 * share:.1f} %"
