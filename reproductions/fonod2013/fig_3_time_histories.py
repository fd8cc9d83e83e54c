"""Fig. 3: how the residual, the decision and the index go with time, for each thruster stuck open.

Only the caption of the figure is known to this project, so that what is compared is what the text says of it:
the norm crosses the threshold after the onset, the index settles, and is the same in the whole of the
confirmation window. The figure here is of the first test seed of each thruster, the checks are over a
hundred. Settings are those of Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from reproductions.figures import BLUE, GREEN, INK, ORANGE, RED, Figure, grid
from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.isolation_study import VEHICLE, calibrated, faulty
from reproductions.record import Effort, Finding, Table
from thruster_baselines.detection.residuals import CorrelationDetector, NavigationFlights
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

BEFORE, AFTER = 2.0, 4.0
"""What is shown, s before and after the onset."""


@dataclass(frozen=True)
class History:
    """What the source's method says of a batch of flights, sample by sample."""

    since: FloatArray  # (flights, samples), s, since the onset
    norm: FloatArray  # (flights, samples), m, length of the residual; 0 while it settles
    detected: BoolArray  # (flights, samples)
    index: IntArray  # (flights, samples), sigma, from 1; 0 before the alarm and after the name
    named: IntArray  # (flights, samples), from 1; 0 for none
    thruster: IntArray  # (flights,), the one that failed, from 1

    def window(self, flight: int, confirmations: int) -> slice:
        """The samples of the confirmation window of a flight; none without a name."""
        named = np.flatnonzero(self.named[flight])
        end = int(named[0]) + 1 if named.size else 0
        return slice(max(end - confirmations, 0), end)


@reproduces(
    "MSR-09",
    lines="L319-324",
    reported="curves, of which only the caption is known: the norm crosses J_T, the index settles",
    criterion="the norm crosses J_T after the onset; sigma is right in the whole confirmation window",
)
def time_histories(effort: Effort) -> Finding:
    """Fig. 3: norm, decision, confirmation window and index for each thruster stuck open."""
    threshold = calibrated(effort)
    detector = CorrelationDetector(VEHICLE, threshold, vehicles=effort.flights)
    histories = [history(detector, flights) for flights in faulty(effort)]
    confirmations = detector.confirmations
    crossed = [_crossed(one, threshold) for one in histories]
    settled = [_settled(one, confirmations) for one in histories]
    unsettled = [_changes(one) for one in histories]
    flights = 8 * effort.flights
    table = Table.of(
        "How the index settles",
        enumerate(unsettled, start=1),
        {
            "thruster": "{0}",
            "flights": "{1.size}",
            "right from the alarm on": lambda _, one: str((one == 0).sum()),
            "samples of another index: mean, most": lambda _, one: f"{one.mean():.2f}, {one.max()}",
        },
    )
    return Finding(
        ours=f"the norm crosses {1e3 * threshold:.1f} mm after the onset and not before in "
        f"{sum(int(one.sum()) for one in crossed)} of {flights} flights; the index is that of the open "
        f"thruster in all {confirmations} samples of the window in {sum(int(one.sum()) for one in settled)}",
        checks={
            "in every flight the norm crosses J_T after the onset and not before": all(
                one.all() for one in crossed
            ),
            f"sigma is constant over the {confirmations} samples of the confirmation window, and equals the "
            "thruster that is stuck open": all(one.all() for one in settled),
        },
        note="Of the first flight of each thruster: the residual's norm with the threshold (dashed), the "
        "decision, and the index sigma(k) with the thruster that is stuck open as a line; the green band "
        "is the confirmation window, after which the name stays. In some flights the index is another "
        "one for a few samples before it settles (table).",
        data={
            "threshold": threshold,
            "crossed": [int(one.sum()) for one in crossed],
            "settled": [int(one.sum()) for one in settled],
            "samples_before_it_settles": [one.mean() for one in unsettled],
        },
        tables=(table,),
        figure=partial(_draw, histories, threshold, confirmations),
    )


def history(detector: CorrelationDetector, flights: NavigationFlights) -> History:
    """Let a detector that is made for so many vehicles see all flights, and keep what it says."""
    count, samples = flights.open_rates.shape[:2]
    norm, detected = np.empty((count, samples)), np.empty((count, samples), np.bool_)
    index, named = np.empty((count, samples), np.int64), np.empty((count, samples), np.int64)
    detector.reset()
    last = np.zeros(count, np.int64)
    for k in range(samples):
        diagnosis = detector.update(**flights.step(slice(None), k))
        norm[:, k], detected[:, k] = diagnosis.statistic, diagnosis.detected
        named[:, k] = diagnosis.thruster
        index[:, k] = np.where(last > 0, 0, detector.choice)  # it is not judged any more after the name
        last = diagnosis.thruster
    since = flights.period * np.arange(samples) - flights.onset[:, np.newaxis]
    return History(since, norm, detected, index, named, flights.thruster)


def _crossed(one: History, threshold: float) -> BoolArray:
    """(flights,), whether the norm reaches the threshold after the onset, and did not before."""
    above = one.norm >= threshold
    before = (above & (one.since < 0.0)).any(axis=1)
    return np.asarray(above.any(axis=1) & ~before)


def _settled(one: History, confirmations: int) -> BoolArray:
    """(flights,), whether the window is so long and the index in it that of the failed thruster."""
    right = []
    for flight, thruster in enumerate(one.thruster):
        inside = one.index[flight, one.window(flight, confirmations)]
        right.append(inside.size == confirmations and bool((inside == thruster).all()))
    return np.array(right)


def _changes(one: History) -> IntArray:
    """(flights,), samples in which the index was another one than the failed thruster."""
    wrong = (one.index > 0) & (one.index != one.thruster[:, np.newaxis])
    return np.asarray(wrong.sum(axis=1))


def _draw(histories: list[History], threshold: float, confirmations: int) -> Figure:
    figure, axes = grid(8, 3, 12.0, sharex=True, sharey="col", width_ratios=(1.25, 0.8, 1.0))
    for row, one in zip(axes, histories, strict=True):
        thruster, time, window = int(one.thruster[0]), one.since[0], one.window(0, confirmations)
        shown = (time >= -BEFORE) & (time <= AFTER)
        row[0].plot(time[shown], 1e3 * one.norm[0, shown], color=BLUE)
        row[0].axhline(1e3 * threshold, color=INK, linestyle="--", linewidth=1.0)
        row[0].set(yscale="log", ylabel=f"thruster {thruster}")
        row[1].step(time[shown], one.detected[0, shown], where="post", color=RED)
        row[1].set_yticks([0, 1], ["no", "yes"])
        row[1].set_ylim(-0.15, 1.15)
        judged = shown & (one.index[0] > 0)
        row[2].axhline(thruster, color=INK, linewidth=1.0)
        row[2].plot(time[judged], one.index[0, judged], "o", color=ORANGE, markersize=3.5)
        row[2].set_ylim(0.3, 8.7)
        row[2].set_yticks(range(1, 9), [str(i) if i % 2 else "" for i in range(1, 9)], fontsize=8.0)
        for panel in row:
            if window.stop:
                ends = time[window.start], time[window.stop - 1]
                panel.axvspan(*ends, color=GREEN, alpha=0.18, linewidth=0.0)
            panel.axvline(0.0, color=INK, linestyle=":", linewidth=1.0)
    for panel, title in zip(axes[0], ("norm of the residual, mm", "detected", "index σ(k)"), strict=True):
        panel.set_title(title)
    for panel in axes[-1]:
        panel.set(xlim=(-BEFORE, AFTER), xlabel="since the onset, s")
    return figure
