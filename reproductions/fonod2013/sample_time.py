"""How long one sample takes: residual, decision and isolation of one vehicle, through the public call.

The source says that the load is low. Timed from the first sample to the end of flights with an open valve, so
most samples are before the alarm; the most is given as well.
"""

from __future__ import annotations

import time

import numpy as np

from reproductions.fonod2013.approach_flights import fly
from reproductions.record import Effort, Finding, Reproduction
from reproductions.timing import processor
from thruster_baselines.detection.residuals import CorrelationDetector
from thruster_envs.seeds import VALIDATION

BUDGET = 20e-6  # s a sample
THRESHOLD = 0.02  # m, about that of healthy flights; the time does not depend on it until the alarm


def sample_time(effort: Effort) -> Finding:
    """`MSR-11`."""
    flight = fly(VALIDATION[:1], 1, "stuck_on", 1.0)
    samples = [flight.step(slice(0, 1), k) for k in range(flight.open_rates.shape[1])]
    detector = CorrelationDetector("msr_chaser", THRESHOLD)
    taken = []
    for _ in range(1 + max(effort.repetitions // 100, 1)):
        detector.reset()
        for sample in samples:
            begin = time.perf_counter()
            detector.update(**sample)
            taken.append(time.perf_counter() - begin)
    times = np.array(taken[len(samples) :])  # the first flight compiles
    median, slow = float(np.median(times)), float(np.quantile(times, 0.99))
    return Finding(
        ours=f"{1e6 * median:.1f} µs a sample, 99th percentile {1e6 * slow:.1f} µs",
        checks={
            "a sample takes less than 1 % of its 0.1 s": slow < 0.01 * flight.period,
            "and at most 20 µs in the median": median <= BUDGET,
        },
        note=f"{times.size} samples of one vehicle on {processor()}.",
        data={"median": median, "percentile_99": slow, "processor": processor()},
    )


REPRODUCTIONS = (
    Reproduction(
        id="MSR-11",
        title="Time of one sample of detection and isolation",
        source="Fonod 2013",
        lines="L303, L334",
        reported="low",
        criterion="99 % of samples take less than 1 ms, the median at most 20 µs",
        run=sample_time,
        alone=True,
    ),
)
