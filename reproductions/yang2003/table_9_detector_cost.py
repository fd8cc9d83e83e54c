"""Table 9: operations and time of the detectors (E27), and what the reduced filter saves (E29).

Operations are counted as they are done: textbook dense arithmetic with matrices, one for each addition,
subtraction, multiplication or division, as in the source; a product with zero counts. What the source counted
besides the tests it does not say.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from reproductions.record import Effort, Finding, Table
from reproductions.timing import processor
from reproductions.yang2003 import reproduces
from reproductions.yang2003.detection_study import (
    AXES,
    DETECTORS,
    EFFECTIVENESS,
    THRUSTERS,
    Conditions,
    flights_of,
    measure,
    random_on_times,
)
from thruster_baselines.estimation import EffectivenessFilter
from thruster_envs.protocols import FloatArray

REPORTED = {
    "generic chi-squared": (1800.5, 9.0025),
    "single chi-squared": (1794.5, 8.9725),
    "set chi-squared": (1803.5, 9.0175),
    "likelihood ratio": (8202.0, 41.01),
}
"""Operations, and milliseconds on a Pentium."""


class Counter:
    """Dense arithmetic that counts its operations."""

    def __init__(self) -> None:
        self.operations = 0

    def multiply(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """A product of matrices, row by column."""
        product = left @ right
        self.operations += product.size * (2 * left.shape[-1] - 1)
        return np.asarray(product)

    def add(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """A sum, entry by entry."""
        self.operations += left.size
        return np.asarray(left + right)

    def divide(self, left: float, right: float) -> float:
        """One quotient."""
        self.operations += 1
        return left / right

    def invert(self, matrix: FloatArray) -> FloatArray:
        """An inverse by Gauss and Jordan, in place, without a choice of pivots."""
        a = np.array(matrix)
        size = len(a)
        for p in range(size):
            pivot = 1.0 / a[p, p]
            a[p, p] = 1.0
            a[p] *= pivot
            self.operations += 1 + size
            for row in range(size):
                if row != p:
                    factor = a[row, p]
                    a[row, p] = 0.0
                    a[row] -= factor * a[p]
                    self.operations += 2 * size
        return a


def _generic(counter: Counter, e: FloatArray, y: FloatArray) -> float:
    return float(counter.multiply(e, counter.multiply(counter.invert(y), e[:, np.newaxis]))[0])


def _single(counter: Counter, e: FloatArray, y: FloatArray) -> FloatArray:
    inverse = counter.invert(y)
    counter.operations += 2 * AXES
    return np.asarray(e * inverse.diagonal() * e)


def _set(counter: Counter, e: FloatArray, y: FloatArray) -> FloatArray:
    squares = _single(counter, e, y)
    sets = np.unique(EFFECTIVENESS != 0.0, axis=1).T
    counter.operations += sum(int(one.sum()) - 1 for one in sets)
    return np.array([squares[one].sum() for one in sets])


def _ratio(counter: Counter, e: FloatArray, y: FloatArray) -> FloatArray:
    """Eqs. 68 to 71 for each thruster, with the inverse at hand once."""
    inverse = counter.invert(y)
    statistics = []
    for i in range(THRUSTERS):
        weighed = counter.multiply(EFFECTIVENESS[np.newaxis, :, i], inverse)
        size = float(counter.multiply(weighed, EFFECTIVENESS[:, i, np.newaxis])[0, 0])
        chi = float(counter.multiply(weighed, e[:, np.newaxis])[0, 0])
        counter.operations += 1  # the square of chi
        statistics.append(counter.divide(chi * chi, size))
    return np.array(statistics)


def _ratio_afresh(counter: Counter, e: FloatArray, y: FloatArray) -> FloatArray:
    """The same with the inverse made anew for each thruster, and for S and chi, as the equations stand."""
    statistics = []
    for i in range(THRUSTERS):
        column = EFFECTIVENESS[:, i, np.newaxis]
        size = float(counter.multiply(counter.multiply(column.T, counter.invert(y)), column)[0, 0])
        chi = float(counter.multiply(counter.multiply(column.T, counter.invert(y)), e[:, np.newaxis])[0, 0])
        counter.operations += 1
        statistics.append(counter.divide(chi * chi, size))
    return np.array(statistics)


_TESTS: dict[str, Callable[[Counter, FloatArray, FloatArray], object]] = {
    "generic chi-squared": _generic,
    "single chi-squared": _single,
    "set chi-squared": _set,
    "likelihood ratio": _ratio,
}


@reproduces(
    "E27",
    lines="Table 9, L1208-1222",
    reported="1800.5 / 1794.5 / 1803.5 / 8202 operations; 9.0 / 9.0 / 9.0 / 41 ms on a Pentium",
    criterion="a factor of about 4.6 from what the equations need; the times follow from the operations",
    alone=True,
)
def detector_cost(effort: Effort) -> Finding:
    """Operations and time of the detectors."""
    rng = np.random.default_rng(27)
    e, y = np.array(rng.normal(size=AXES)), np.diag(rng.uniform(1.0, 2.0, AXES))
    counts = {name: _count(test, e, y) for name, test in _TESTS.items()}
    afresh = _count(_ratio_afresh, e, y)
    alike = bool(np.allclose(_ratio(Counter(), e, y), _ratio_afresh(Counter(), e, y)))
    repetitions = max(3, effort.repetitions // 20)
    seconds = {name: _seconds(name, flights_of(effort), repetitions) for name in _TESTS}
    speeds = [operations / milliseconds for operations, milliseconds in REPORTED.values()]
    generic, own = "generic chi-squared", "likelihood ratio"
    reported = REPORTED[own][0] / REPORTED[generic][0]
    once, anew = counts[own] / counts[generic], afresh / counts[generic]
    tests = [counts[name] for name in _TESTS if name != own]
    table = Table.of(
        "Cost of a test",
        [(name, *REPORTED[name]) for name in _TESTS],
        {
            "detector": "{0}",
            "reported operations": "{1:,}",
            "ours": lambda name, *_: f"{counts[name]:,}",
            "reported ms": "{2:g}",
            "our update, µs": lambda name, *_: f"{1e6 * seconds[name]:.2f}",
        },
    )
    return Finding(
        ours=f"{counts[generic]} / {counts['single chi-squared']} / {counts['set chi-squared']} / "
        f"{counts[own]} operations; the likelihood ratio {once:.1f} times the generic test, {anew:.1f} times "
        f"with an inverse for each product; in time, filter included, "
        f"{seconds[own] / seconds[generic]:.1f} times",
        checks={
            "all reported times are operations at 200,000 a second": np.allclose(speeds, 200.0),
            "the chi-squared tests cost the same within a fifth": max(tests) < 1.2 * min(tests),
            "the reported factor of 4.6 lies between one inverse for all and one for each product": (
                once < reported < anew
            ),
            "an update takes less than 9 ms": (
                max(seconds.values()) < min(1e-3 * milliseconds for _, milliseconds in REPORTED.values())
            ),
            "one inverse or many, the statistics are the same": alike,
        },
        data={"operations": counts, "operations with an inverse for each product": afresh,
              "seconds of an update in a batch": seconds, "processor": processor()},
        not_reproducible=f"the numbers of operations: as its equation stands, the generic test takes "
        f"{counts[generic]}, and what was counted besides is not said; the times were not measured, they are "
        f"the operations at {np.mean(speeds):.0f} a millisecond in every row",
        note=f"Times are the shortest of {repetitions} updates, per vehicle in a batch of "
        f"{flights_of(effort):,}, with the filter that all need, on {processor()}.",
        tables=(table,),
    )  # fmt: skip


def _count(test: Callable[[Counter, FloatArray, FloatArray], object], e: FloatArray, y: FloatArray) -> int:
    counter = Counter()
    test(counter, e, y)
    return counter.operations


def _seconds(name: str, vehicles: int, repetitions: int) -> float:
    """The shortest update, by vehicle, s."""
    rng = np.random.default_rng(9)
    commanded = random_on_times(rng, (vehicles,))
    change = measure(rng, commanded)
    detector = DETECTORS[name](EFFECTIVENESS, 1.0, vehicles=vehicles, **Conditions().filter_settings())
    detector.update(commanded, change, 1.0)
    taken = []
    for _ in range(repetitions):
        start = time.perf_counter()
        detector.update(commanded, change, 1.0)
        taken.append(time.perf_counter() - start)
    return min(taken) / vehicles


def filter_operations(fired: int) -> int:
    """Operations of an update (eqs. 51 to 57) with the states of so many thrusters, dense."""
    size = AXES * fired
    counter = Counter()
    p, h, r = np.eye(size), np.ones((AXES, size)), 10.0 * np.eye(AXES)
    x, z = np.ones((size, 1)), np.ones((AXES, 1))
    p = counter.add(p, 0.01 * np.eye(size))
    residual = counter.add(z, -counter.multiply(h, x))
    hp = counter.multiply(h, p)
    y = counter.add(counter.multiply(hp, h.T), r)
    gain = counter.multiply(counter.multiply(p, h.T), counter.invert(y))
    counter.add(x, counter.multiply(gain, residual))
    kh = counter.multiply(gain, h)
    counter.multiply(counter.add(np.eye(size), -kh), p)
    return counter.operations


@reproduces(
    "E29",
    lines="section 4.2.4, L1004",
    reported="over (6 n)^3 operations a step, with n idle thrusters",
    criterion="more than that, for any number of idle thrusters",
)
def reduced_filter(effort: Effort) -> Finding:
    """What a filter of the fired thrusters saves."""
    whole = filter_operations(THRUSTERS)
    saved = {idle: whole - filter_operations(THRUSTERS - idle) for idle in range(1, THRUSTERS)}
    bound = {idle: (AXES * idle) ** 3 for idle in saved}
    off, scale = _approximation(max(20, effort.flights))
    idle = THRUSTERS - 4
    table = Table.of(
        "Operations of an update",
        saved,
        {
            "fired": lambda one, _: str(THRUSTERS - one),
            "idle": "{0}",
            "operations": lambda _, less: f"{whole - less:,}",
            "saved": "{1:,}",
            "(6 idle)^3": lambda one, _: f"{bound[one]:,}",
        },
    )
    return Finding(
        ours=f"with four of twelve thrusters fired {saved[idle]:,} of {whole:,} operations saved, "
        f"{saved[idle] / bound[idle]:.1f} times the bound; its estimates differ from the exact ones by "
        f"{off / scale:.1%} of what those have moved",
        checks={
            "more than (6 idle)^3 are saved, however many are idle": all(
                saved[one] > bound[one] for one in saved
            ),
            "its estimates are not the exact ones, but differ by less than what those have moved": (
                0.0 < off < scale
            ),
        },
        data={"operations": whole, "saved": saved, "bound": bound, "difference": off, "moved": scale},
        note="Counted with dense matrices, as the equations stand. It is an approximation: after a joint "
        "firing the errors of thrusters hang together, and an idle one could learn from another's firing. "
        "Where R, Q and the first covariance are multiples of the identity the exact filter needs one matrix "
        f"of {THRUSTERS} by {THRUSTERS} and no approximation.",
        tables=(table,),
    )  # fmt: skip


def _approximation(updates: int) -> tuple[float, float]:
    """Root mean squares: estimates of the reduced filter off the exact ones, and those off the first."""
    rng = np.random.default_rng(29)
    filters = [EffectivenessFilter(EFFECTIVENESS, 0.01, 10.0, form=form) for form in ("full", "fired_only")]
    truth = EFFECTIVENESS * rng.uniform(0.8, 1.2, THRUSTERS)
    for _ in range(updates):
        commanded = random_on_times(rng, (1,))
        change = measure(rng, commanded, effectiveness=truth)
        for one in filters:
            one.update(commanded, change)
    exact, reduced = (one.effectiveness[0] for one in filters)
    off, moved = (float(np.sqrt(np.mean((exact - other) ** 2))) for other in (reduced, EFFECTIVENESS))
    return off, moved
