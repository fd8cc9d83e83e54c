"""Isolation by cross-correlation of residual and commands (Fonod et al. 2013, eqs. 33-34).

After an alarm, in every sample k and for each axis j of the residual r, a vote goes to the thruster i of duty
u_i with the least c_ji = | (1 / N) sum over l = k - N .. k of r_j(l) u_i(l) |. Whoever the combined votes
choose in N_c samples in a row is isolated. It rests on a controller that fights a thruster that is stuck open
and drives its command lowest: right for open faults only, an idle duty above zero, and a controller that
answers within the window; of a closed or weak thruster more is asked (`pick="greatest"`).

Eq. 33 prints r_j(k), which makes all axes vote for the least mean duty (`residual="last"`). The guard against
idle thrusters (Remark 3) leaves out the stuck one, whose command has just gone to zero; it is off by default.

Left out: kinds and sizes of faults.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias, Unpack, get_args

import numpy as np

from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.residuals.base import Monitor, NavigationSettings
from thruster_baselines.detection.residuals.design import ResidualDesign
from thruster_baselines.detection.residuals.norm_threshold import DesignName, NormThreshold
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.configuration import require, suggestion
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["CorrelationDetector"]

Vote: TypeAlias = Literal["majority", "global", "sum", "x", "y", "z"]
Pick: TypeAlias = Literal["least", "greatest"]
ResidualIndex: TypeAlias = Literal["window", "last"]
GuardWindow: TypeAlias = Literal["now", "before"]

_SUM, _MAJORITY, _GLOBAL = 3, 4, 5  # after the three axes


class _Voting(NamedTuple):
    """How thrusters are voted for, see `CorrelationDetector`, and the period, s."""

    window: int
    confirmations: int
    vote: int
    sign: float
    last_residual: bool
    idle_guard: float
    guard_before: bool
    period: float


class CorrelationDetector(NormThreshold):
    """Alarms by the length of the residual and names the thruster whose command goes least with it.

    Args:
        spacecraft: Description, name or path.
        threshold: Of the length of the residual, m.
        design: Of the observer, or a name of one; see `NormThreshold`.
        window: N, samples.
        confirmations: N_c, samples in a row with the same choice.
        vote: `majority` of the axes, the source's (three different votes fall back to the global choice);
            `global`, over axes and thrusters; `sum`, by the sum of c_ji over the axes; or one axis of the
            design.
        pick: `least`, the source's, or `greatest`.
        residual: `window` for r_j(l), or `last` for the printed r_j(k).
        idle_guard: Mean open rate below which a thruster is left out; 0 leaves none out.
        guard_window: Whether the guard's mean is over the window that ends `now`, as Remark 3 has it, or over
            the N samples that ended N samples `before` the alarm.
        common: See `NavigationSettings`.

    Attributes:
        choice: (vehicles,), chosen in the last sample, from 1; 0 as long as there is no alarm.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path,
        threshold: float,
        *,
        design: ResidualDesign | DesignName = "pade",
        window: int = 10,
        confirmations: int = 10,
        vote: Vote = "majority",
        pick: Pick = "least",
        residual: ResidualIndex = "window",
        idle_guard: float = 0.0,
        guard_window: GuardWindow = "now",
        **common: Unpack[NavigationSettings],
    ) -> None:
        for name, value, known in (
            ("vote", vote, get_args(Vote)),
            ("pick", pick, get_args(Pick)),
            ("residual", residual, get_args(ResidualIndex)),
            ("guard_window", guard_window, get_args(GuardWindow)),
        ):
            if value not in known:
                raise ValueError(f"{name} {value!r} is unknown; {suggestion(value, known)}")
        require(window >= 1 and window % 1 == 0, "window", window, "a whole number of samples from 1")
        require(
            confirmations >= 1 and confirmations % 1 == 0, "confirmations", confirmations,
            "a whole number of samples from 1",
        )  # fmt: skip
        require(0.0 <= idle_guard < 1.0, "idle_guard", idle_guard, "an open rate from 0, below 1,")
        self.window, self.confirmations = int(window), int(confirmations)
        self.idle_guard = float(idle_guard)
        codes = {"x": 0, "y": 1, "z": 2, "sum": _SUM, "majority": _MAJORITY, "global": _GLOBAL}
        vehicles = common.get("vehicles", 1)
        self.choice: IntArray = np.zeros(vehicles, np.int64)
        self._in_a_row: IntArray = np.zeros(vehicles, np.int64)
        self._idle: BoolArray = np.zeros((vehicles, 0), np.bool_)
        super().__init__(spacecraft, threshold, design=design, **common)
        self._how = _Voting(
            self.window, self.confirmations, codes[vote], 1.0 if pick == "least" else -1.0,
            residual == "last", self.idle_guard, guard_window == "before", self._period,
        )  # fmt: skip

    def _kept(self) -> int:
        return 2 * self.window + 1

    def _clear(self, mask: BoolArray) -> None:
        super()._clear(mask)
        if self._idle.shape[1] == 0:
            self._idle = np.zeros((self._vehicles, self._n), np.bool_)
        self.choice[mask] = self._in_a_row[mask] = 0

    def _isolate(self, statistic: FloatArray, time: FloatArray) -> Verdict:
        work = partial(
            _correlate, self._history, tuple(self._monitor), tuple(self._how), self._idle, self.choice,
            self._in_a_row,
        )  # fmt: skip
        in_threads(work, self._vehicles)
        return self._answer(statistic, time)


@kernel(nogil=True)
def _correlate(
    history: tuple[FloatArray, FloatArray],
    monitor: Monitor,
    how: _Voting,
    idle: BoolArray,
    choice: IntArray,
    in_a_row: IntArray,
    first: int,
    last: int,
) -> None:
    residuals, rates = history
    effectiveness, _, samples, _, detected, thruster, detection_time, isolation_time = monitor
    window, confirmations, vote, sign, last_residual, idle_guard, guard_before, period = how
    kept, n = rates.shape[1:]  # kept is 2 N + 1
    score, mean = np.empty((_SUM + 1, n)), np.empty(n)
    votes = np.empty(_SUM + 1, np.int64)
    for v in range(first, last):
        if not detected[v] or thruster[v] > 0:
            continue
        newest = samples[v] - 1
        count = min(samples[v], window + 1)
        for i in range(n):
            mean[i] = 0.0
            for j in range(3):
                score[j, i] = 0.0
        for back in range(count):
            slot = (newest - back) % kept
            at = newest % kept if last_residual else slot
            for i in range(n):
                mean[i] += rates[v, slot, i]
            for j in range(3):
                r = residuals[v, at, j]
                for i in range(n):
                    score[j, i] += r * rates[v, slot, i]
        time = newest * period
        if not guard_before:
            for i in range(n):
                idle[v, i] = mean[i] < idle_guard * count
        elif time == detection_time[v]:
            for i in range(n):
                total, taken = 0.0, min(samples[v], kept) - window
                for back in range(window, window + taken):
                    total += rates[v, (newest - back) % kept, i]
                idle[v, i] = total < idle_guard * taken
        for i in range(n):
            score[_SUM, i] = abs(score[0, i]) + abs(score[1, i]) + abs(score[2, i])
        found_best, overall = np.inf, -1
        for j in range(_SUM + 1):
            best, votes[j] = np.inf, -1
            for i in range(n):
                weak = True
                for k in range(3):
                    weak = weak and effectiveness[v, k, i] == 0.0
                if weak or idle[v, i]:
                    continue
                value = sign * abs(score[j, i]) / window
                if value < best:
                    best, votes[j] = value, i
                if value < found_best and j < _SUM:
                    found_best, overall = value, i
        chosen = overall
        if vote <= _SUM:
            chosen = votes[vote]
        elif vote == _MAJORITY and (votes[0] == votes[1] or votes[0] == votes[2]):
            chosen = votes[0]
        elif vote == _MAJORITY and votes[1] == votes[2]:
            chosen = votes[1]
        if chosen + 1 == choice[v] and chosen >= 0:
            in_a_row[v] += 1
        else:
            choice[v] = chosen + 1
            in_a_row[v] = 1
        if choice[v] > 0 and in_a_row[v] >= confirmations:
            thruster[v] = choice[v]
            isolation_time[v] = time
