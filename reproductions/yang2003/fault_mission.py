"""The source's rendezvous with thrusters that fail, in its own setting, by pilots that know more or less.

From 300 m above the target in half an orbit, by Hill's equations: no attitude, no scatter, no noise. A plan
is followed period by period, its rate changes mapped to on-times by the linear program. A pilot does nothing
about a failure; or plans anew, with thrusters as built, when the craft is too far from the plan; or knows
what failed as it fails; or diagnoses once a second by the likelihood ratio test and a comparison of models,
and plans anew with what it then believes. The firing of the period of the discovery goes on to its end. The
filter is not asked in seconds without firing: the source's process noise would grow all through the coast.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from reproductions.yang2003.section_6_3_coupling_in_flight import ORION, PERIOD, SHARE, START, STEPS
from thruster_baselines.detection import GLRDetector, ModelComparison
from thruster_baselines.detection.glr import SOURCE_THRESHOLD
from thruster_baselines.guidance import RendezvousPlan, RendezvousPlanner, force_response, transition_matrix
from thruster_baselines.mapping import LPMapper, delivered_on_times
from thruster_envs.protocols import FloatArray

SECOND = 1.0  # between two tests, s
LOSSES = (0.25, 0.5, 0.75)  # partial models: the levels at which the source studies detection (appendix D)
NOMINAL = ORION.effectiveness()
DELTA_V_COST = 5000.0
"""s per m/s. The source plans least delta-v. As built, that is least firing time; with a damaged thruster a
plan for firing time goes out of its way to spare what takes more thrusters, so delta-v has a price then."""


@dataclass(frozen=True)
class Failure:
    """A thruster that fails."""

    thruster: int  # from 1
    share: float  # of its thrust that is left
    period: int  # from 1: in which it fails, from the start of it


LOST = (Failure(1, share=0.0, period=5),)
"""Of section 6.4.3."""

DEGRADED = (Failure(1, share=0.5, period=1),)
"""Appendix E, case one."""

TWO_LOST = (Failure(1, share=0.0, period=1), Failure(2, share=0.0, period=1))
"""Appendix E, case two."""


@dataclass(frozen=True)
class Found:
    """What the pilot found out."""

    period: int  # from 1
    second: int  # of the period, from 1, after which
    thruster: int  # from 1
    kind: str  # as `thruster_envs.faults.KINDS`
    share: float  # believed from then on
    since: int  # seconds of firing since this thruster first failed to fire as commanded, this one included


@dataclass(frozen=True)
class Second:
    """A second of firing as the detector saw it."""

    time: float  # at its end, since the start, s
    expected: FloatArray  # (m,), m/s then rad/s
    measured: FloatArray  # (m,)
    ratio: FloatArray  # (n,), likelihood ratio of each thruster


@dataclass(frozen=True)
class Flight:
    """How it went."""

    states: FloatArray  # (periods + 1, 6), m and m/s, LVLH
    rate_changes: FloatArray  # (periods, 6), commanded, m/s and rad/s
    on_times: FloatArray  # (periods, n), commanded, s
    delivered: FloatArray  # (periods, n), full thrust for so long gives the same, s
    # each with the number of periods flown before it, the first at 0
    plans: tuple[tuple[int, RendezvousPlan], ...]
    found: tuple[Found, ...]  # in order, by a pilot that looks
    seconds: tuple[Second, ...]  # what the detector saw while it fired; none without diagnosis

    @property
    def miss(self) -> float:
        """Distance from the target at the end, m."""
        return float(np.linalg.norm(self.states[-1, :3]))

    @property
    def speed(self) -> float:
        """At the end, m/s."""
        return float(np.linalg.norm(self.states[-1, 3:]))

    @property
    def delta_v(self) -> float:
        """Commanded, summed over axes, m/s."""
        return float(np.abs(self.rate_changes[:, :3]).sum())

    @property
    def firing_time(self) -> float:
        """Commanded, thruster-seconds."""
        return float(self.on_times.sum())

    @property
    def burnt(self) -> float:
        """Thruster-seconds of full thrust that came out, which is what propellant pays for."""
        return float(self.delivered.sum())

    @property
    def replans(self) -> int:
        """Plans after the first."""
        return len(self.plans) - 1

    @property
    def rate(self) -> FloatArray:
        """(3,), rad/s: at which the body would turn at the end if nothing held it."""
        rate: FloatArray = NOMINAL[3:] @ self.delivered.sum(axis=0)
        return rate

    def spent(self) -> FloatArray:
        """(periods + 1,): commanded delta-v up to then, m/s."""
        by_period = np.abs(self.rate_changes[:, :3]).sum(axis=1)
        return np.concatenate([[0.0], np.cumsum(by_period)])


@cache
def fly(
    failures: tuple[Failure, ...] = (),
    *,
    deviation: float = np.inf,
    diagnosis: bool = False,
    known: bool = False,
    taken_back: float = 0.0,
    coupling: float = 0.0,
) -> Flight:
    """Fly the mission.

    Args:
        failures: What fails.
        deviation: From the plan, m, beyond which it is made anew.
        diagnosis: Whether the pilot looks for failures, and plans anew with what it finds.
        known: Whether the pilot knows each failure as it begins, and plans anew.
        taken_back: What share of the rotation at the start of a period its command takes back. The angle that
            builds up meanwhile is left out, as all of attitude is.
        coupling: Share of thrust lost per further thruster open; the mapper does not make up for it.
    """
    as_built = RendezvousPlanner(ORION, max_on_time=SHARE * PERIOD)
    damaged = RendezvousPlanner(ORION, max_on_time=SHARE * PERIOD, delta_v_cost=DELTA_V_COST)
    mapper = LPMapper(ORION)
    transition = transition_matrix(ORION.mean_motion, PERIOD)
    response = force_response(ORION.mean_motion, PERIOD) / PERIOD
    watch = _Watch(failures)
    states, rate_changes, on_times = [START], np.zeros((STEPS, 6)), np.zeros((STEPS, NOMINAL.shape[1]))
    delivered, rate = np.zeros_like(on_times), np.zeros(3)
    plans = [(0, as_built(START, STEPS))] if not known else []
    anew = known
    for k in range(STEPS):
        left = shares(failures, k + 1)
        if known and any(one.period == k + 1 for one in failures):
            watch.believed, anew = NOMINAL * left, True
        if anew:
            planner = as_built if np.array_equal(watch.believed, NOMINAL) else damaged
            plans.append((k, planner(states[-1], STEPS - k, effectiveness=watch.believed)))
        made, plan = plans[-1]
        if made == k:
            rate_changes[k:] = plan.rate_changes
            on_times[k:] = mapper(plan.rate_changes, effectiveness=watch.believed).on_times
        if taken_back:
            rate_changes[k, 3:] = -taken_back * rate
            on_times[k] = mapper(rate_changes[k], effectiveness=watch.believed).on_times
        delivered[k] = left * delivered_on_times(np.where(left > 0.0, on_times[k], 0.0), coupling)
        change = NOMINAL @ delivered[k]
        states.append(transition @ states[-1] + response @ change[:3])
        rate = rate + change[3:]
        anew = float(np.linalg.norm(states[-1][:3] - plan.states[k + 1 - made, :3])) > deviation
        if diagnosis and on_times[k].any():
            anew |= watch(k + 1, on_times[k], left)
    return Flight(
        np.array(states), rate_changes, on_times, delivered, tuple(plans), tuple(watch.found),
        tuple(watch.seconds),
    )  # fmt: skip


def shares(failures: tuple[Failure, ...], period: int) -> FloatArray:
    """(n,): what each thruster gives of its thrust in a period, counted from 1."""
    left = np.ones(NOMINAL.shape[1])
    for one in failures:
        if period >= one.period:
            left[one.thruster - 1] = one.share
    return left


class _Watch:
    """Detection, isolation and identification, once a second, with the source's noise and threshold."""

    def __init__(self, failures: tuple[Failure, ...]) -> None:
        self._detector = GLRDetector.yang2003(ORION, SOURCE_THRESHOLD, coupling=0.0)
        self._comparison = ModelComparison(ORION, losses=LOSSES, coupling=0.0)
        self._failing_for = {one.thruster: 0 for one in failures}  # seconds of firing that showed it
        self.believed = NOMINAL.copy()  # (m, n), m/s^2 then rad/s^2
        self.found: list[Found] = []
        self.seconds: list[Second] = []

    def __call__(self, period: int, on_times: FloatArray, left: FloatArray) -> bool:
        """Watch a period; whether anything was found in it."""
        before = len(self.found)
        for number in range(round(PERIOD / SECOND)):
            commanded = np.clip(on_times - number * SECOND, 0.0, SECOND)
            if commanded.any():
                self._test(period, number + 1, commanded, left)
        return len(self.found) > before

    def _test(self, period: int, number: int, commanded: FloatArray, left: FloatArray) -> None:
        for thruster in self._failing_for:
            self._failing_for[thruster] += int(commanded[thruster - 1] > 0.0 and left[thruster - 1] < 1.0)
        measured = NOMINAL @ (left * commanded)
        diagnosis = self._detector.update(commanded, measured, SECOND)
        interval = self._detector.last
        assert interval is not None
        time, expected = (period - 1) * PERIOD + number * SECOND, measured - interval.residual[0]
        self.seconds.append(Second(time, expected, measured, diagnosis.suspicion[0]))
        if not diagnosis.detected[0]:
            return
        thruster = int(diagnosis.thruster[0])
        models = self._comparison(interval, diagnosis.thruster)
        share = 1.0 - float(models.severity[0])
        self.believed = self.believed.copy()
        self.believed[:, thruster - 1] = NOMINAL[:, thruster - 1] * share
        self._detector.believe(self.believed)
        self.found.append(
            Found(period, number, thruster, models.kind[0], share, self._failing_for.get(thruster, 0))
        )
