"""How long one sample takes: residual, decision and isolation of one vehicle, through the public call.

The source says that the load is low. Timed over flights with an open valve, at the calibrated threshold: most
samples are before the alarm, some between the alarm and the name, in which the correlations are formed as
well, and the rest after it. The load of the machine stands beside the result.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from reproductions.figures import BLUE, INK, ORANGE, Figure, panels
from reproductions.fonod2013 import reproduces
from reproductions.fonod2013.isolation_study import OPEN, VEHICLE, calibrated
from reproductions.record import Effort, Finding, Table
from reproductions.timing import processor
from thruster_baselines.detection.approach_flights import fly
from thruster_baselines.detection.residuals import CorrelationDetector
from thruster_envs.protocols import FloatArray
from thruster_envs.seeds import VALIDATION

BUDGET = 20e-6  # s a sample
PARTS = ("before the alarm", "from the alarm to the name", "after the name")


@reproduces(
    "MSR-11",
    lines="L303, L334",
    reported="low",
    criterion="99 % of samples take less than 1 ms, the median at most 20 µs",
    alone=True,
)
def sample_time(effort: Effort) -> Finding:
    """Time of one sample of detection and isolation."""
    threshold = calibrated(effort)
    flight = fly(VALIDATION[:1], 1, *OPEN)
    samples = [flight.step(slice(0, 1), k) for k in range(flight.open_rates.shape[1])]
    detector = CorrelationDetector(VEHICLE, threshold)
    taken: list[float] = []
    part: list[int] = []
    before = os.getloadavg()[0]
    for _ in range(1 + max(effort.repetitions // 100, 1)):
        detector.reset()
        for sample in samples:
            begin = time.perf_counter()
            diagnosis = detector.update(**sample)
            taken.append(time.perf_counter() - begin)
            part.append(int(diagnosis.detected[0]) + int(diagnosis.thruster[0] > 0))
    times, where = np.array(taken[len(samples) :]), np.array(part[len(samples) :])  # the first compiles
    by_part = {name: times[where == k] for k, name in enumerate(PARTS) if (where == k).any()}
    median, slow = float(np.median(times)), float(np.quantile(times, 0.99))

    def micros(of: Callable[[FloatArray], float]) -> Callable[[str, FloatArray], str]:
        return lambda _, one: f"{1e6 * of(one):.1f}"

    table = Table.of(
        "Time of a sample, µs",
        by_part,
        {
            "samples": "{0}",
            "number": "{1.size}",
            "median": micros(np.median),
            "99th percentile": micros(lambda one: np.quantile(one, 0.99)),
            "most": micros(np.max),
        },
    )
    return Finding(
        ours=f"{1e6 * median:.1f} µs a sample, 99th percentile {1e6 * slow:.1f} µs",
        checks={
            "a sample takes less than 1 % of its 0.1 s": slow < 0.01 * flight.period,
            "and at most 20 µs in the median": median <= BUDGET,
            "between alarm and name too": float(np.median(by_part.get(PARTS[1], times))) <= BUDGET,
        },
        note=f"{times.size} samples of one vehicle on {processor()}, {os.cpu_count()} processors, whose "
        f"average load over the minute before was {before:.1f}; the longest times are those in which the "
        f"processor did something else. The threshold is {1e3 * threshold:.1f} mm, 1.3 times the largest "
        "norm of healthy flights of validation seeds.",
        data={
            "median": median,
            "percentile_99": slow,
            "threshold": threshold,
            "load": before,
            "processor": processor(),
        },
        tables=(table,),
        figure=partial(_draw, by_part),
    )


def _draw(by_part: dict[str, FloatArray]) -> Figure:
    figure, (panel,) = panels(height=3.4)
    for (name, times), colour in zip(by_part.items(), (BLUE, ORANGE, INK), strict=False):
        panel.plot(np.sort(1e6 * times), np.arange(1, times.size + 1) / times.size, color=colour, label=name)
    panel.axvline(1e6 * BUDGET, color=INK, linestyle="--", linewidth=1.0, label="20 µs")
    panel.set(xlim=(0.0, 60.0), xlabel="time of a sample, µs (longer ones in the table)")
    panel.set(ylabel="share of samples within it")
    panel.legend(loc="lower right", fontsize=8.5)
    return figure
