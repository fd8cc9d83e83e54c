"""Isolation by signature: whose fault, sent through the observer, looks most like the residual.

From an onset some samples before the alarm on, thruster i of direction d_i and duty u_i adds d_i (1 - u_i)
(`stuck_on`, of known size) or -q d_i u_i (`loss` of the share q). Through the observer that is f_i(l) per
unit of size; with c = sum of f_i . r and s = sum of f_i . f_i, a size q explains 2 q c - q^2 s of the energy
of the residual r. Whoever explains most in N_c samples in a row, in the same way, is isolated. Sizes are held
to what is possible: else a valve stuck open and the loss of the opposite corner are the same (Fonod et al.
2013, Remark 4).

Left out: torques (`FusionDetector`); leaks, valves stuck in between, slow and late ones; that the attitude
was another one some samples ago, for which it takes the present one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias, Unpack, get_args

import numpy as np

from thruster_baselines.detection.contract import Verdict
from thruster_baselines.detection.residuals.base import Monitor, NavigationSettings, nominal_delay
from thruster_baselines.detection.residuals.design import ResidualDesign
from thruster_baselines.detection.residuals.generator import turned_direction
from thruster_baselines.detection.residuals.norm_threshold import DesignName, NormThreshold
from thruster_baselines.mapping.simplex import in_threads
from thruster_envs.configuration import require, suggestion
from thruster_envs.kernels import kernel
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["SignatureDetector"]

SignatureKind: TypeAlias = Literal["stuck_on", "loss"]

_C1, _C2, _S11, _S12, _S22 = range(5)


class _Search(NamedTuple):
    """The channel of a force through the observer, onsets, lag, codes of kinds, N_c, and the period, s."""

    channel: FloatArray
    onsets: IntArray
    lag: int
    codes: IntArray
    confirmations: int
    period: float


class _Found(NamedTuple):
    """States and sums of signatures, and of each vehicle the choice, its kind and its size."""

    states: FloatArray
    sums: FloatArray
    choice: IntArray
    kind: IntArray
    share: FloatArray


class SignatureDetector(NormThreshold):
    """Alarms by the length of the residual and names the thruster whose fault explains it best.

    Args:
        spacecraft: Description, name or path.
        threshold: Of the length of the residual, m.
        design: Of the observer, or a name of one; see `NormThreshold`.
        kinds: What is looked for.
        onsets: How many samples before the alarm a fault may have begun.
        lag: How many periods the thrust comes after its command; by default the nominal delay.
        confirmations: N_c, samples in a row with the same thruster and kind.
        common: See `NavigationSettings`.

    Attributes:
        kind: (vehicles,), codes of `kinds` in their order from 1, of the best in the last sample; 0 as long
            as there is no alarm.
        share: (vehicles,), its size.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path,
        threshold: float,
        *,
        design: ResidualDesign | DesignName = "pade",
        kinds: Sequence[SignatureKind] = ("stuck_on", "loss"),
        onsets: Sequence[int] = (12,),
        lag: int | None = None,
        confirmations: int = 10,
        **common: Unpack[NavigationSettings],
    ) -> None:
        if isinstance(spacecraft, str | Path):
            spacecraft = load(spacecraft)
        if lag is None:
            lag = round(nominal_delay(spacecraft) / spacecraft.control_period)
        require(lag >= 0 and lag % 1 == 0, "lag", lag, "a whole number of periods, 0 or more,")
        known = get_args(SignatureKind)
        for kind in kinds:
            if kind not in known:
                raise ValueError(f"kinds has {kind!r}; {suggestion(kind, known)}")
        require(len(kinds) > 0, "kinds", tuple(kinds), "one or two of them")
        require(len(onsets) > 0 and min(onsets) >= 1, "onsets", tuple(onsets), "numbers of samples from 1")
        require(
            confirmations >= 1 and confirmations % 1 == 0, "confirmations", confirmations,
            "a whole number of samples from 1",
        )  # fmt: skip
        self.kinds = tuple(kinds)
        self.confirmations, self.lag = int(confirmations), int(lag)
        self._onsets: IntArray = np.array(onsets, np.int64)
        self._codes = np.array([kinds.index(one) + 1 if one in kinds else 0 for one in known])
        vehicles = common.get("vehicles", 1)
        self.kind: IntArray = np.zeros(vehicles, np.int64)
        self.share: FloatArray = np.zeros(vehicles)
        self._choice: IntArray = np.zeros((vehicles, 3), np.int64)  # thruster, kind, how often in a row
        super().__init__(spacecraft, threshold, design=design, **common)
        transition, entry = self.design.axis_channel()
        self._channel = np.hstack([transition, entry[:, np.newaxis]])
        ways, size = len(onsets), entry.size
        self._states: FloatArray = np.zeros((vehicles, ways, self._n + 1, size))
        self._sums: FloatArray = np.zeros((vehicles, ways, 5, self._n))
        self._search = _Search(
            self._channel, self._onsets, self.lag, self._codes, self.confirmations, self._period
        )
        self._found = _Found(self._states, self._sums, self._choice, self.kind, self.share)

    def _kept(self) -> int:
        return int(self._onsets.max()) + self.lag + 2

    def _clear(self, mask: BoolArray) -> None:
        super()._clear(mask)
        self.kind[mask] = self._choice[mask] = 0
        self.share[mask] = 0.0

    def _isolate(self, statistic: FloatArray, time: FloatArray) -> Verdict:
        suspicion = np.zeros((self._vehicles, self._n))
        shortfall = np.zeros((self._vehicles, self._n))
        work = partial(
            _match, self._history, tuple(self._monitor), tuple(self._search), tuple(self._found), suspicion,
            shortfall,
        )  # fmt: skip
        in_threads(work, self._vehicles)
        return self._answer(statistic, time, suspicion, shortfall)

    def _kinds(self) -> tuple[str, ...]:
        return tuple(("", *self.kinds)[one] for one in self.kind * (self.thruster > 0))


@kernel(nogil=True)
def _match(
    history: tuple[FloatArray, FloatArray],
    monitor: Monitor,
    search: _Search,
    found: _Found,
    suspicion: FloatArray,
    shortfall: FloatArray,
    first: int,
    last: int,
) -> None:
    residuals, rates = history
    effectiveness, attitude, samples, _, detected, thruster, detection_time, isolation_time = monitor
    channel, onsets, lag, codes, confirmations, period = search
    states, sums, choice, kind, share = found
    kept, n = rates.shape[1:]
    size = channel.shape[0]
    direction, square = np.empty((3, n)), np.empty(n)
    held = np.empty(size)
    for v in range(first, last):
        if not detected[v] or thruster[v] > 0:
            continue
        newest = samples[v] - 1
        q = (attitude[v, 0], attitude[v, 1], attitude[v, 2], attitude[v, 3])
        for i in range(n):
            d = turned_direction(effectiveness[v], i, q)
            square[i] = 0.0
            for j in range(3):
                direction[j, i] = d[j]
                square[i] += d[j] * d[j]
        began = newest * period == detection_time[v]
        best, who, how, size_of = 0.0, -1, 0, 0.0
        for w in range(onsets.size):
            back = 0
            if began:
                states[v, w] = 0.0
                sums[v, w] = 0.0
                back = min(onsets[w] - 1, newest - lag - 1)
            for at in range(newest - back, newest + 1):
                told = (at - 1 - lag) % kept
                for i in range(n + 1):
                    given = 1.0 if i == n else rates[v, told, i]
                    for j in range(size):
                        held[j] = channel[j, size] * given
                        for k in range(size):
                            held[j] += channel[j, k] * states[v, w, i, k]
                    for j in range(size):
                        states[v, w, i, j] = held[j]
                unit = states[v, w, n, 0]
                r = residuals[v, at % kept]
                for i in range(n):
                    own = states[v, w, i, 0]
                    along = direction[0, i] * r[0] + direction[1, i] * r[1] + direction[2, i] * r[2]
                    sums[v, w, _C1, i] += unit * along
                    sums[v, w, _C2, i] += own * along
                    sums[v, w, _S11, i] += unit * unit * square[i]
                    sums[v, w, _S12, i] += unit * own * square[i]
                    sums[v, w, _S22, i] += own * own * square[i]
            for i in range(n):
                if square[i] == 0.0:
                    continue
                total = sums[v, w, :, i]
                told_now = rates[v, newest % kept, i]
                if codes[0] > 0:
                    energy = 2.0 * (total[_C1] - total[_C2]) - (total[_S11] - 2.0 * total[_S12] + total[_S22])
                    if energy > suspicion[v, i]:
                        suspicion[v, i] = energy
                        shortfall[v, i] = (told_now - 1.0) * period
                    if energy > best:
                        best, who, how, size_of = energy, i, codes[0], 1.0
                if codes[1] > 0 and total[_C2] < 0.0:
                    part = min(-total[_C2] / total[_S22], 1.0)
                    energy = -part * (2.0 * total[_C2] + part * total[_S22])
                    if energy > suspicion[v, i]:
                        suspicion[v, i] = energy
                        shortfall[v, i] = part * told_now * period
                    if energy > best:
                        best, who, how, size_of = energy, i, codes[1], part
        kind[v], share[v] = how, size_of
        if who + 1 == choice[v, 0] and how == choice[v, 1]:
            choice[v, 2] += 1
        else:
            choice[v, 0], choice[v, 1], choice[v, 2] = who + 1, how, 1
        if who >= 0 and choice[v, 2] >= confirmations:
            thruster[v] = who + 1
            isolation_time[v] = newest * period
