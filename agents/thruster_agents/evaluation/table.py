"""From episodes to a table: mean score, bootstrap interval, share of the way to the oracle.

Every method flies the same seeds. The interval is a percentile bootstrap over episodes; a method trained
with several seeds has its scores averaged over them first, and its interval is then over both.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_agents.evaluation.play import SCENARIOS, Method, Scenario, play
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Cell", "Row", "bootstrap_interval", "compare", "interquartile_mean"]

_RESAMPLES = 2000
_AT_ONCE = 2**24  # counts that are held at the same time: all those of 500,000 episodes take 8 GB


@dataclass(frozen=True)
class Cell:
    """How a method did in a scenario.

    Attributes:
        score: Mean over episodes (and over trained policies).
        low: Lower end of its 95 % bootstrap interval.
        high: Upper end.
        way: Share of the way from doing nothing (0) to the oracle (1); 0 where the oracle does no better.
        policies: Mean score of each trained policy; one number for a method that is not trained.
    """

    score: float
    low: float
    high: float
    way: float
    policies: tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """A method in every scenario.

    Attributes:
        key: In files.
        title: For people.
        sees: What it was allowed to see.
        cells: By the scenario's name.
    """

    key: str
    title: str
    sees: str
    cells: Mapping[str, Cell]

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return dataclasses.asdict(self)


def compare(
    methods: Sequence[Sequence[Method]],
    seeds: range,
    spacecraft: Spacecraft,
    scenarios: Sequence[Scenario] = SCENARIOS,
) -> list[Row]:
    """Fly them all and fill the table, in the order given.

    Args:
        methods: For each row, the method, or the policies that were trained with different seeds. Rows with
            the keys `oracle` and `nothing` must be among them.
        seeds: Of the worlds, consecutive.
        spacecraft: What flies.
        scenarios: Columns.
    """
    scores = {
        (row[0].key, scenario.name): np.stack([play(one, scenario, seeds, spacecraft).scores for one in row])
        for scenario in scenarios
        for row in methods
    }
    rows = []
    for row in methods:
        cells = {}
        for scenario in scenarios:
            own = scores[row[0].key, scenario.name]
            top, bottom = (scores[key, scenario.name].mean() for key in ("oracle", "nothing"))
            low, high = bootstrap_interval(own)
            mean = float(own.mean())
            way = float((mean - bottom) / (top - bottom)) if top > bottom else 0.0
            cells[scenario.name] = Cell(mean, low, high, way, tuple(own.mean(axis=1).tolist()))
        rows.append(Row(row[0].key, row[0].title, row[0].sees, cells))
    return rows


def bootstrap_interval(scores: NDArray[np.float64], level: float = 0.95) -> tuple[float, float]:
    """Percentile bootstrap interval of the mean of (policies, episodes) scores; both are resampled.

    The draw is the same at every call.

    >>> bootstrap_interval(np.full((1, 64), 0.5))
    (0.5, 0.5)
    """
    generator = np.random.default_rng(0)
    policies, episodes = scores.shape
    of_policies = generator.multinomial(policies, np.full(policies, 1.0 / policies), _RESAMPLES) / policies
    means = []
    together = max(1, _AT_ONCE // episodes)
    for drawn in (of_policies[k : k + together] for k in range(0, _RESAMPLES, together)):
        counts = generator.multinomial(episodes, np.full(episodes, 1.0 / episodes), len(drawn))
        means.append(((drawn @ scores) * (counts / episodes)).sum(axis=1))
    tail = 50.0 * (1.0 - level)
    low, high = np.percentile(np.concatenate(means), [tail, 100.0 - tail])
    return float(low), float(high)


def interquartile_mean(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean of the middle half of some numbers, and its 95 % percentile bootstrap interval.

    What lies across a quartile counts by the share of it that lies within.

    >>> interquartile_mean([0.0, 1.0, 1.0, 5.0])[0]
    1.0
    """
    numbers = np.asarray(values, dtype=np.float64)
    draws = np.random.default_rng(0).integers(numbers.size, size=(_RESAMPLES, numbers.size))
    middle = _middle_mean(np.concatenate([numbers[np.newaxis], numbers[draws]]))
    low, high = np.percentile(middle[1:], [2.5, 97.5])
    return float(middle[0]), float(low), float(high)


def _middle_mean(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k,) means of the middle halves of (k, n) numbers."""
    n = rows.shape[1]
    edges = np.arange(n + 1) / n
    weights = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0.0, None)
    middle: NDArray[np.float64] = np.sort(rows, axis=1) @ (weights / weights.sum())
    return middle
