"""Excitation tests of valves: groups opened together for a moment, to see what each thruster does.

Some thrusters push and turn nowhere together (`balanced_groups`), so that a pulse of a group leaves a healthy
vehicle alone, and what it does to another is the fault's own. Groups take turns; routine pulses are rare,
dense after an alarm, and of the group of the isolated thruster alone until its fault is clear
(`ValveProbing`). A pulse only adds to duties, up to 1. What tells kinds of fault apart:
docs/derivations/excitation_test.md. Ours; the source (Fonod et al. 2013) has none.

Left out: thrusters that are known to be faulty; what the plumes of a pulse do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.configuration import require
from thruster_envs.extras import extra
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["ProbeSettings", "ValveProbing", "balanced_groups"]

_ALIKE = 1e-6  # open rates that differ by less are the same


@dataclass(frozen=True, kw_only=True)
class ProbeSettings:
    """When valves are probed, how hard, and how long a pilot waits for what that shows.

    Attributes:
        interval: From one routine pulse, of one period, to that of the next group, s.
        height: Least open rate in a group that is probed.
        search: Likewise in the periods after an alarm; over and over, by the groups in turn.
        question: Likewise in the periods after a name, of the group of that thruster; over and over.
        margin: Lead of the likeliest kind of fault, in twice the logarithm of its likelihood, with which it
            is said.
        least_wait: From the name to that, s.
        longest_wait: From the name to saying the likeliest whatever its lead, s.
        corridor_share: Share of the corridor's half-width off its axis from which on nothing is waited for.
        angle: Likewise from the attitude of the approach, rad.
        spin: Likewise of the body rate against LVLH, rad/s.
    """

    interval: float = 4.0
    height: float = 0.7
    search: tuple[float, ...] = (0.6, 0.6, 0.6)
    question: tuple[float, ...] = (*(4 * (0.6,)), *(4 * (0.0,)), *(4 * (1.0,)), *(4 * (0.0,)))
    margin: float = 8.0
    least_wait: float = 0.5
    longest_wait: float = 2.0
    corridor_share: float = 0.5
    angle: float = 0.15
    spin: float = 0.03

    def __post_init__(self) -> None:
        require(self.interval > 0.0, "interval", self.interval, "a positive number of s")
        for name in ("search", "question"):
            require(len(getattr(self, name)) > 0, name, getattr(self, name), "one open rate or more")
        for rate in (self.height, *self.search, *self.question):
            require(0.0 <= rate <= 1.0, "open rate of a probe", rate, "a number from 0 to 1")


def balanced_groups(wrenches: ArrayLike) -> FloatArray:
    """(groups, n) open rates with which thrusters of wrenches (6, n) push and turn nowhere.

    For each thruster the least that balances it when it is fully open, each group once; none for a thruster
    that cannot be balanced.

    >>> from thruster_envs.spacecraft import load
    >>> balanced_groups(load("msr_chaser").wrenches()).astype(int).tolist()
    [[1, 0, 0, 1, 0, 1, 1, 0], [0, 1, 1, 0, 1, 0, 0, 1]]
    """
    with extra("baselines", "balanced_groups"):
        from scipy.optimize import linprog

    columns = np.asarray(wrenches, np.float64)
    axes, n = columns.shape
    scaled = columns / np.maximum(np.abs(columns).max(axis=1, keepdims=True), np.finfo(np.float64).tiny)
    groups: list[FloatArray] = []
    for thruster in range(n):
        bounds = [(float(one == thruster), 1.0) for one in range(n)]
        found = linprog(np.ones(n), A_eq=scaled, b_eq=np.zeros(axes), bounds=bounds)
        if found.success and not any(np.abs(found.x - other).max() < _ALIKE for other in groups):
            groups.append(np.where(found.x < _ALIKE, 0.0, found.x))
    return np.array(groups).reshape(-1, n)


class ValveProbing:
    """Says when which group is to be opened how wide, and opens it.

    Args:
        wrenches: (6, n), N and N m, of sound thrusters.
        period: Control period, s.
        settings: When and how.

    Attributes:
        groups: (groups, n), see `balanced_groups`.

    Raises:
        ValueError: A thruster that is in no group.
    """

    def __init__(self, wrenches: ArrayLike, period: float, settings: ProbeSettings) -> None:
        self.settings = settings
        self.groups = balanced_groups(wrenches)
        for thruster in np.flatnonzero(~(self.groups > 0.0).any(axis=0)):
            raise ValueError(f"thruster {thruster + 1} is balanced by no others; no probe would be right")
        self._own: IntArray = (self.groups > 0.0).argmax(axis=0)  # a group of each thruster
        self._every = max(1, round(settings.interval / period))
        self._search, self._question = np.array(settings.search), np.array(settings.question)

    def heights(
        self, elapsed: IntArray, since_alarm: IntArray, since_name: IntArray, named: IntArray
    ) -> FloatArray:
        """(vehicles, groups) least open rate of each group in this period; 0 for no probe.

        Args:
            elapsed: (vehicles,), periods since the start.
            since_alarm: (vehicles,), periods since an alarm; below 0 without one.
            since_name: (vehicles,), periods since a thruster was named.
            named: (vehicles,), that thruster, from 1; 0 for none.
        """
        count, size = len(self.groups), self._search.size
        everyone = np.arange(len(elapsed))
        heights = np.zeros((len(elapsed), count))
        group = elapsed // self._every % count
        heights[everyone, group] = np.where(elapsed % self._every == 0, self.settings.height, 0.0)
        alarmed = since_alarm >= 0
        heights[alarmed] = 0.0
        group = np.where(named > 0, self._own[named - 1], since_alarm // size % count)
        height = np.where(
            named > 0, self._question[since_name % self._question.size], self._search[since_alarm % size]
        )
        heights[everyone[alarmed], group[alarmed]] = height[alarmed]
        return heights

    def open(self, rates: FloatArray, heights: FloatArray) -> FloatArray:
        """(vehicles, n) rates that give the same wrench as these, with groups at heights (vehicles, groups).

        No rate rises above 1, whatever the height.
        """
        opened = rates.copy()
        for group, height in zip(self.groups, heights.T, strict=True):
            inside: BoolArray = group > 0.0
            now, together = opened[:, inside], group[inside]
            lift = ((height[:, np.newaxis] - now) / together).max(axis=1)
            room = ((1.0 - now) / together).min(axis=1)
            lift = np.where(height > 0.0, np.clip(np.minimum(lift, room), 0.0, None), 0.0)
            opened[:, inside] = now + lift[:, np.newaxis] * together
        return opened
