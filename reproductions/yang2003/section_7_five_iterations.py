"""Unexpected faults found and corrected within five iterations (E49).

The conclusions of the source name the number without a count. Here the whole chain flies: likelihood ratio
test, model comparison in the interval of the alarm, and the believed effectiveness overwritten with what was
found. An iteration is an interval of 1 s in which the thruster that fails is commanded to fire for as long as
its loss takes to reach the threshold without noise, or more; three others, any, fire for up to 1 s. A fault
is corrected once its thruster is believed to be within one level of the models of what it is, and stays so; a
thruster that sticks on is not commanded, and counts once its kind is identified.
"""

from __future__ import annotations

import numpy as np

from reproductions.cells import with_interval
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.detection_study import (
    CONFIDENCE,
    EFFECTIVENESS,
    OPEN,
    THRUSTERS,
    flights_of,
    measure,
    random_on_times,
)
from thruster_baselines.detection import GLRDetector, ModelComparison
from thruster_baselines.detection.evaluate import Rate
from thruster_baselines.detection.glr import SOURCE_THRESHOLD
from thruster_baselines.detection.settings import SOURCE_MEASUREMENT_NOISE
from thruster_envs.protocols import FloatArray, IntArray

FAULTS = {"off": 0.0, "25 % left": 0.25, "50 % left": 0.5, "stuck on": 1.0}
LEVEL = 0.2  # between models of a loss
WITHIN, WATCHED = 5, 10  # iterations


@reproduces(
    "E49",
    lines="chapter 7, L1578",
    reported="unexpected faults routinely identified and corrected within five iterations",
    criterion="nearly all named and corrected within five firings that are long enough",
)
def five_iterations(effort: Effort) -> Finding:
    """Faults found and corrected within five iterations."""
    flights = flights_of(effort)
    found = {name: _chain(name, flights, seed) for seed, name in enumerate(FAULTS, start=49)}
    detected = {name: _within(one[0]) for name, one in found.items()}
    corrected = {name: _within(one[1]) for name, one in found.items()}
    worst = min(corrected, key=lambda name: corrected[name].value)
    table = Table.of(
        "Flights, by iteration",
        [(name, *those) for name, those in found.items()],
        {
            "fault": "{0}",
            "named at the first": lambda _, named, __: f"{np.mean(named <= 1):.1%}",
            "named within five (95 %)": lambda name, *_: with_interval(detected[name]),
            "corrected at the first": lambda _, __, done: f"{np.mean(done <= 1):.1%}",
            "corrected within five (95 %)": lambda name, *_: with_interval(corrected[name]),
        },
    )
    return Finding(
        ours=f"named within five: {min(one.value for one in detected.values()):.2%} at least; corrected "
        f"within five: {corrected['off'].value:.2%} (off), {corrected['stuck on'].value:.2%} (stuck on), "
        f"{corrected[worst].value:.2%} at the worst ({worst})",
        checks={
            "99 % are named within five iterations": all(one.value >= 0.99 for one in detected.values()),
            "95 % are corrected within five iterations": all(one.value >= 0.95 for one in corrected.values()),
            "half of them at the first": all(
                float(np.mean(one[1] <= 1)) >= 0.5 for one in found.values()
            ),
        },
        data={
            name: {"named at iteration": _counts(named), "corrected at iteration": _counts(done)}
            for name, (named, done) in found.items()
        },
        note=f"{flights:,} flights of each fault. A loss to a half takes on-times of more than 0.77 s; from "
        "shorter ones it is not seen at all (E36).",
        tables=(table,),
    )  # fmt: skip


def _chain(name: str, flights: int, seed: int) -> tuple[IntArray, IntArray]:
    """(flights,) each: the iteration in which the thruster is named first, and from which it is corrected.

    One more than is watched where it does not happen.
    """
    rng = np.random.default_rng(seed)
    rows, kept, sticks = np.arange(flights), FAULTS[name], name == "stuck on"
    thruster = rng.integers(1, THRUSTERS + 1, flights)
    detector = GLRDetector.yang2003(EFFECTIVENESS, SOURCE_THRESHOLD, vehicles=flights)
    compare = ModelComparison(THRUSTERS, losses=(0.2, 0.4, 0.6, 0.8), openings=())
    believed = np.tile(EFFECTIVENESS, (flights, 1, 1))
    share = np.ones((flights, THRUSTERS))  # of its thrust, as believed
    named = np.full(flights, WATCHED + 1)
    done = np.full(flights, WATCHED + 1)
    open_valve = np.zeros(flights, np.bool_)  # believed stuck on
    for iteration in range(1, WATCHED + 1):
        commanded, delivered = _firing(rng, thruster, kept, sticks)
        said = detector.update(commanded, measure(rng, delivered), 1.0)
        assert detector.last is not None
        answer = compare(detector.last, said.thruster)
        right = said.thruster == thruster
        named = np.where(right & (named > WATCHED), iteration, named)
        kinds = np.array(answer.kind)
        open_valve |= right & (kinds == "stuck_on")
        for v in np.flatnonzero(np.isin(kinds, ("loss", "stuck_off"))):
            i = said.thruster[v] - 1
            share[v, i] *= 1.0 - answer.severity[v]
            believed[v, :, i] = share[v, i] * EFFECTIVENESS[:, i]
        detector.believe(believed)
        good = open_valve if sticks else np.abs(share[rows, thruster - 1] - kept) <= LEVEL + 1e-9
        done = np.where(good, np.minimum(done, iteration), WATCHED + 1)
    return named, done


def _firing(
    rng: np.random.Generator, thruster: IntArray, kept: float, sticks: bool
) -> tuple[FloatArray, FloatArray]:
    """On-times commanded and delivered, (flights, n), s."""
    flights = len(thruster)
    rows = np.arange(flights)
    commanded = random_on_times(rng, (flights,), OPEN - 1)
    size = np.linalg.norm(EFFECTIVENESS, axis=0)[thruster - 1]
    if sticks:
        commanded[rows, thruster - 1] = 0.0
    else:
        shortest = np.sqrt(SOURCE_THRESHOLD * SOURCE_MEASUREMENT_NOISE) / ((1.0 - kept) * size)
        commanded[rows, thruster - 1] = rng.uniform(np.minimum(shortest, 1.0), 1.0)
    delivered = commanded.copy()
    delivered[rows, thruster - 1] = 1.0 if sticks else kept * commanded[rows, thruster - 1]
    return commanded, delivered


def _within(iterations: IntArray) -> Rate:
    return Rate.of(int((iterations <= WITHIN).sum()), len(iterations), CONFIDENCE)


def _counts(iterations: IntArray) -> IntArray:
    return np.bincount(np.minimum(iterations, WATCHED + 1), minlength=WATCHED + 2)[1:]
