"""Detectors fed by navigation, on flights of the chaser: whom they name, how soon, and when they cannot."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.baselines import chaser_flight
from tests.baselines.chaser_flight import MSR_A, PERIOD, Settings, ValveFault, fly
from tests.tasks.flying import begin
from thruster_baselines.detection import evaluate, threshold_for_rate
from thruster_baselines.detection.residuals import (
    CorrelationDetector,
    FusionDetector,
    NormThreshold,
    SignatureDetector,
    margin_threshold,
    named_design,
    watch,
)
from thruster_baselines.guidance.hcw import force_response, transition_matrix
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.tasks import MarsRendezvous

THRESHOLD = 0.0136
"""m, of the residual with Pade's states: the tabled one for a LIDAR of a millimetre."""

RATIO = 30.0
"""Of the likelihood ratio; healthy flights stay below 10, and an abrupt stop below it."""

ONSETS = (50.013, 50.047, 50.081)


def flights(
    kind: str, severity: float = 0.0, repeats: int = 1, settings: Settings | None = None, seed: int = 0
):
    """Each thruster with this fault from 50 s on, 62 s long."""
    faults = [ValveFault(i, kind, severity, ONSETS[k]) for k in range(repeats) for i in range(1, 9)]
    return fly(range(seed, seed + len(faults)), 62.0, faults, settings).seen()


@pytest.fixture(scope="module")
def opened():
    return flights("stuck_on", 1.0, repeats=3)


@pytest.fixture(scope="module")
def closed():
    return flights("stuck_off", repeats=2, seed=30)


@pytest.fixture(scope="module")
def weak():
    return flights("loss", 0.5, repeats=2, seed=60)


@pytest.fixture(scope="module")
def healthy():
    return fly(range(10), 140.0).seen()


def right(watched, seen) -> float:
    return float(np.mean(watched.thruster == seen.thruster))


def test_equal_open_rates_and_rates_of_alternating_corners_give_no_wrench():
    alternating = chaser_flight.CORNERS.prod(axis=1)
    for rates in (np.ones(8), alternating):
        np.testing.assert_allclose(chaser_flight.WRENCHES @ rates, 0.0, atol=1e-13)
    np.testing.assert_allclose(
        chaser_flight.WRENCHES[:, 0], [-13.2, -6.6, -16.3156, -9.7156, 6.3788, 5.28], atol=1e-4
    )


def test_chaser_without_commands_drifts_as_hills_equations_say():
    """Its gains are too small to fire, so that nothing but the orbit moves it."""
    still = Settings(
        idle=0.0, position_loop=1e-9, attitude_loop=1e-9, start=-20.0, disturbance=(0.0, 0.0, 0.0)
    )
    record = fly([3], 60.0, settings=still)
    np.testing.assert_array_equal(record.open_rates, 0.0)
    first = np.concatenate([record.true_position[0, 0], record.true_velocity[0, 0]])
    expected = transition_matrix(chaser_flight.MEAN_MOTION, 599 * PERIOD) @ first
    np.testing.assert_allclose(record.true_position[0, -1], expected[:3], atol=1e-4)
    np.testing.assert_allclose(record.true_velocity[0, -1], expected[3:], atol=2e-6)


def test_chaser_follows_its_approach_to_centimetres():
    record = fly([1], 100.0)
    along = record.true_position[0, :, 1] - (-20.0 + 0.1 * PERIOD * np.arange(1000))
    assert np.abs(along[300:]).max() < 0.01
    assert np.abs(record.true_position[0, 300:, [0, 2]]).max() < 0.01
    assert record.pointing[0, 300:].max() < np.radians(0.2)


def test_healthy_flights_stay_below_the_tabled_threshold(healthy):
    watched = watch(NormThreshold(MSR_A, THRESHOLD, vehicles=10), healthy)
    assert np.isinf(watched.detection).all()
    assert margin_threshold(watched.statistic) == pytest.approx(THRESHOLD, rel=0.15)


def test_open_faults_lie_in_the_acceptance_band(opened):
    watched = watch(CorrelationDetector(MSR_A, THRESHOLD, vehicles=24), opened)
    assert right(watched, opened) == 1.0
    assert watched.detection.min() >= 0.4
    assert watched.detection.max() <= 1.2
    assert watched.isolation.max() <= 4.0
    assert (watched.isolation - watched.detection).min() >= 0.9 - 1e-9


@pytest.mark.parametrize(
    ("changes", "threshold", "detection", "isolation"),
    [
        ({"lidar": 0.5e-3}, 6.8e-3, (0.48, 0.69), (1.38, 1.86)),
        ({"lidar": 2e-3}, 27.3e-3, (0.78, 1.10), (1.68, 2.02)),
        ({"lidar": 5e-3}, 68.5e-3, (1.10, 1.54), (2.00, 2.44)),
        ({"delay_variation": 0.06}, 13.6e-3, (0.66, 0.86), (1.56, 1.90)),
        ({"navigation_delay": 3}, 13.6e-3, (0.66, 0.88), (1.56, 2.08)),
        ({"idle": 0.3}, 13.6e-3, (0.68, 0.90), (1.58, 1.92)),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_open_faults_are_found_in_the_tabled_time_whatever_the_flight(
    changes, threshold, detection, isolation
):
    """Ranges over 80 flights of another simulation at its own threshold; here of eight."""
    seen = flights("stuck_on", 1.0, repeats=1, settings=replace(Settings(), **changes), seed=400)
    watched = watch(CorrelationDetector(MSR_A, threshold, vehicles=8), seen)
    assert right(watched, seen) == 1.0
    for found, (least, greatest) in ((watched.detection, detection), (watched.isolation, isolation)):
        assert found.min() > least - 0.12
        assert found.max() < greatest + 0.12


@pytest.mark.parametrize(
    "reading",
    [
        {"residual": "last"},
        {"vote": "global"},
        {"vote": "sum"},
        {"vote": "x"},
        {"vote": "z"},
        {"window": 30},
    ],
    ids=lambda reading: "-".join(str(one) for one in next(iter(reading.items()))),
)
def test_every_reading_of_the_criterion_is_right_for_open_faults(opened, reading):
    assert right(watch(CorrelationDetector(MSR_A, THRESHOLD, vehicles=24, **reading), opened), opened) == 1.0


@pytest.mark.parametrize(
    ("vote", "wanted"),
    [
        ("sum", lambda c: c.sum(axis=0).argmin()),
        ("global", lambda c: c.argmin() % 8),
        ("y", lambda c: c[1].argmin()),
    ],
)
def test_choice_is_that_of_the_correlations_written_out(opened, vote, wanted):
    detector = CorrelationDetector(MSR_A, THRESHOLD, vote=vote, window=7, vehicles=24, confirmations=10**6)
    residuals = []
    for k in range(opened.open_rates.shape[1]):
        detector.update(**opened.step(slice(None), k))
        residuals.append(detector.residual.copy())
        if k > 520:
            window = np.array(residuals[-8:])
            c = np.abs(np.einsum("lvj,vli->vji", window, opened.open_rates[:, k - 7 : k + 1]))
            ours = [int(wanted(one)) + 1 for one in c]
            np.testing.assert_array_equal(detector.choice, ours)


def test_printed_residual_leaves_the_lowest_mean_command_to_decide(opened):
    """With r_j(k) every axis votes alike, so that the vote does not matter."""
    by_axis = [
        watch(CorrelationDetector(MSR_A, THRESHOLD, residual="last", vote=vote, vehicles=24), opened)
        for vote in ("x", "y", "majority")
    ]
    for other in by_axis[1:]:
        np.testing.assert_array_equal(other.isolation, by_axis[0].isolation)


def test_least_correlation_finds_no_closed_or_weak_thruster_and_the_greatest_does(opened, closed, weak):
    for seen in (closed, weak):
        least = watch(CorrelationDetector(MSR_A, THRESHOLD, vehicles=16), seen)
        assert np.isfinite(least.detection).all()
        assert right(least, seen) == 0.0
    closed_by_greatest = watch(CorrelationDetector(MSR_A, THRESHOLD, pick="greatest", vehicles=16), closed)
    assert right(closed_by_greatest, closed) == 1.0
    open_by_greatest = watch(CorrelationDetector(MSR_A, THRESHOLD, pick="greatest", vehicles=24), opened)
    assert right(open_by_greatest, opened) == 0.0


def test_guard_against_idle_thrusters_hides_the_open_one_unless_it_judges_earlier(opened):
    guarded = CorrelationDetector(MSR_A, THRESHOLD, idle_guard=0.05, vehicles=24)
    assert right(watch(guarded, opened), opened) == 0.0
    earlier = CorrelationDetector(MSR_A, THRESHOLD, idle_guard=0.05, guard_window="before", vehicles=24)
    assert right(watch(earlier, opened), opened) == 1.0


def test_isolation_waits_for_its_confirmations(opened):
    first, slow = (
        watch(CorrelationDetector(MSR_A, THRESHOLD, confirmations=count, vehicles=24), opened)
        for count in (1, 20)
    )
    np.testing.assert_array_equal(first.isolation, first.detection)
    assert (slow.isolation - slow.detection).min() >= 1.9 - 1e-9


def test_abrupt_stop_alarms_by_pades_states(healthy):
    stop = replace(Settings(), stop_at=60.0, braking=np.inf)
    seen = fly(range(4), 70.0, settings=stop).seen()
    assert np.isfinite(watch(NormThreshold(MSR_A, THRESHOLD, vehicles=4), seen).detection).all()
    assert np.isinf(watch(FusionDetector(MSR_A, RATIO, vehicles=4), seen).detection).all()


def test_signature_of_the_right_kind_names_the_right_thruster(opened, closed, weak):
    for seen, kind in ((opened, "stuck_on"), (closed, "loss"), (weak, "loss")):
        count = seen.thruster.size
        assert (
            right(watch(SignatureDetector(MSR_A, THRESHOLD, kinds=(kind,), vehicles=count), seen), seen)
            == 1.0
        )


def test_signatures_from_several_onsets_tell_the_kind_too(opened, closed, weak):
    for seen, kind in ((opened, 1), (closed, 2), (weak, 2)):
        count = seen.thruster.size
        detector = SignatureDetector(MSR_A, THRESHOLD, onsets=(4, 6, 9, 12, 16, 20), vehicles=count)
        assert right(watch(detector, seen), seen) == 1.0
        np.testing.assert_array_equal(detector.kind, kind)


FUSION_CASES = [
    ("stuck_on", 1.0, ("stuck_on",), 0.01),
    ("stuck_off", 0.0, ("stuck_off",), 0.0),
    ("stuck_on", 0.4, ("stuck_on", "leak"), 0.06),
    ("loss", 0.5, ("loss",), 0.1),
    ("leak", 0.3, ("leak", "stuck_on"), 0.06),
    ("late_opening", 0.005, ("late_opening", "loss"), None),
]


@pytest.mark.parametrize(("kind", "severity", "names", "error"), FUSION_CASES)
def test_fusion_names_thruster_and_kind_of_every_fault_that_shows(kind, severity, names, error):
    """Names that no flight could tell apart count alike: see the module."""
    seen = flights(kind, severity, repeats=2, settings=replace(Settings(), thrust_scatter=0.01), seed=100)
    detector = FusionDetector(MSR_A, RATIO, vehicles=16)
    watched = watch(detector, seen)
    assert right(watched, seen) == 1.0
    assert np.median(watched.detection) < 1.2
    assert watched.detection.min() > 0.0
    assert watched.isolation.max() < 3.5
    found = detector.identify()
    assert np.mean([one in names for one in found.kind]) >= 15 / 16
    if error is not None:
        assert np.median(np.abs(found.severity - (severity or 1.0))) <= error


@pytest.mark.parametrize(("kind", "severity"), [("late", 0.3), ("slow", 0.5)])
def test_fusion_never_names_a_wrong_thruster_for_shifted_thrust(kind, severity):
    """In an even approach these hardly show after they have begun; those that do are named and understood."""
    seen = flights(kind, severity, repeats=2, seed=200)
    detector = FusionDetector(MSR_A, 15.0, margin=6.0, vehicles=16)
    watched = watch(detector, seen)
    named = watched.thruster > 0
    assert named.mean() > 0.4
    np.testing.assert_array_equal(watched.thruster[named], seen.thruster[named])
    kinds = np.array(detector.identify().kind)[named]
    assert np.mean((kinds == "late_opening") | (kinds == "slow_opening")) > 0.8


def test_fusion_is_silent_on_healthy_flights_with_wrong_mass_properties():
    wrong = Settings(
        thrust_scatter=0.03, centre_of_mass=(0.01, -0.01, 0.01), delay_variation=0.06, stop_at=100.0
    )
    seen = fly(range(300, 310), 140.0, settings=wrong).seen()
    watched = watch(FusionDetector(MSR_A, RATIO, vehicles=10), seen)
    assert watched.statistic.max() < 0.6 * RATIO


def test_force_alone_is_slower_than_force_and_torque(closed):
    both = watch(FusionDetector(MSR_A, RATIO, vehicles=16), closed)
    force = watch(FusionDetector(MSR_A, RATIO, use_rate=False, vehicles=16), closed)
    assert np.isfinite(force.detection).all()
    assert np.median(force.detection) > 2.0 * np.median(both.detection)


def exact_flight(samples: int, thruster: int, deliver, first: int, seed: int = 0):
    """Without noise, by the fusion's model: what one thruster gives of all that it is told from a sample on.

    All sums of the fusion begin anew at each 36th sample.
    """
    rng = np.random.default_rng(seed)
    effectiveness = MSR_A.effectiveness()
    step, push = (rule(MSR_A.mean_motion, PERIOD) for rule in (transition_matrix, force_response))
    told = rng.uniform(0.2, 0.6, (samples, 8))
    told = told.mean(axis=1, keepdims=True) + 0.02 * (told - told.mean(axis=1, keepdims=True))
    delivered = told.copy()
    delivered[first - 1 :, thruster - 1] = deliver(told[first - 1 :, thruster - 1])
    state, rate = np.array([0.0, -20.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(3)
    position, rates = np.empty((samples, 3)), np.empty((samples, 3))
    inertia = np.diag(chaser_flight.INERTIA)
    for k in range(samples):
        position[k], rates[k] = state[:3], rate
        change = effectiveness @ delivered[max(k - 1, 0)]
        state = step @ state + push @ change[:3]
        free = np.linalg.solve(inertia, np.cross(rate, inertia @ rate))
        rate = rate + PERIOD * (change[3:] - free)
    return told, position, rates


def test_fusion_has_no_residual_of_its_own_model_and_finds_an_exact_share():
    told, position, rates = exact_flight(600, 6, lambda u: u + 0.2, first=468)
    detector = FusionDetector(MSR_A, RATIO, settle=30.0, bias_time=np.inf)
    attitude = [1.0, 0.0, 0.0, 0.0]
    for k in range(500):
        diagnosis = detector.update(told[k], position[k], attitude, rates[k])
        if 300 <= k <= 468:
            assert diagnosis.statistic[0] < 1e-3
    assert diagnosis.thruster[0] == 6
    assert detector.share[0, 5] == pytest.approx(0.2, rel=1e-3)
    np.testing.assert_allclose(diagnosis.shortfall[0, 5], -0.2 * PERIOD, rtol=1e-3)


def slow(told, constant):
    """Open rates that come of pulses at the beginnings of periods, behind a lag in periods."""
    level, delivered = 0.0, np.empty(told.size)
    for k, u in enumerate(told):
        after = level * np.exp(-1.0 / constant) + (1.0 - np.exp(-u / constant)) * np.exp((u - 1.0) / constant)
        delivered[k] = u - constant * (after - level)
        level = after
    return delivered


EXACT_KINDS = [
    ("stuck_off", 1.0, lambda u: 0.0 * u),
    ("stuck_on", 1.0, lambda u: 0.0 * u + 1.0),
    ("stuck_on", 0.5, lambda u: 0.0 * u + 0.5),
    ("loss", 0.6, lambda u: 0.4 * u),
    ("leak", 0.4, lambda u: u + 0.4 * (1.0 - u)),
    ("late_opening", 0.04, lambda u: np.maximum(u - 0.4, 0.0)),
    ("slow_opening", 0.4, lambda u: slow(u, 4.0)),
]


@pytest.mark.parametrize(("kind", "size", "deliver"), EXACT_KINDS)
def test_changing_commands_tell_every_kind_apart(kind, size, deliver):
    told, position, rates = exact_flight(520, 3, deliver, first=468)
    rng = np.random.default_rng(1)
    position += rng.normal(0.0, MSR_A.sensors.position, position.shape)
    rates += rng.normal(0.0, MSR_A.sensors.rate, rates.shape)
    detector = FusionDetector(MSR_A, 20.0, margin=6.0, timing=0.0, bias_time=np.inf)
    for k in range(520):
        detector.update(told[k], position[k], [1.0, 0.0, 0.0, 0.0], rates[k])
    assert detector.thruster[0] == 3
    assert detector.detection_time[0] >= 46.8
    found = detector.identify()
    assert found.kind == (kind,)
    assert found.severity[0] == pytest.approx(size, abs=0.05)


def test_gains_at_the_start_are_those_of_a_straight_line_through_all_samples():
    """The least squares of n positions: 2 (2 n - 1) / (n (n + 1)) and 6 / (n (n + 1)) over the period."""
    gains = FusionDetector(MSR_A, RATIO, disturbance=1e-9)._gains[:30]
    n = np.arange(2, 32)
    np.testing.assert_allclose(gains[:, 0], 2.0 * (2 * n - 1) / (n * (n + 1)), rtol=1e-3)
    np.testing.assert_allclose(PERIOD * gains[:, 1], 6.0 / (n * (n + 1)), rtol=1e-3)
    # and of the mean of all rates
    np.testing.assert_allclose(gains[:, 2], 1.0 / n, rtol=1e-3)


def test_fusion_need_not_settle(healthy):
    """Its filters begin at rest, the chasers at 0.1 m/s: two seconds later that is forgotten."""
    statistic = watch(FusionDetector(MSR_A, np.inf, vehicles=10), healthy).statistic
    assert statistic[:, :20].max() == 0.0
    assert statistic[:, 20:400].max() < 12.0


def make_detectors():
    return [
        (lambda count: NormThreshold(MSR_A, THRESHOLD, vehicles=count)),
        (lambda count: CorrelationDetector(MSR_A, THRESHOLD, design="observer", vehicles=count)),
        (lambda count: SignatureDetector(MSR_A, THRESHOLD, onsets=(6, 12), vehicles=count)),
        (lambda count: FusionDetector(MSR_A, RATIO, vehicles=count)),
    ]


@pytest.mark.parametrize("make", make_detectors(), ids=("norm", "correlation", "signature", "fusion"))
def test_batch_is_every_vehicle_alone_to_the_last_bit(opened, make):
    together = watch(make(24), opened)
    for flight in (0, 13):
        own = replace(
            opened,
            **{
                name: getattr(opened, name)[flight : flight + 1]
                for name in ("open_rates", "position", "attitude", "rate", "thruster", "severity", "onset")
            },
            kind=opened.kind[flight : flight + 1],
        )
        alone = watch(make(1), own)
        np.testing.assert_array_equal(alone.statistic[0], together.statistic[flight])
        assert alone.isolation[0] == together.isolation[flight]


@pytest.mark.parametrize("make", make_detectors(), ids=("norm", "correlation", "signature", "fusion"))
def test_large_batch_in_threads_gives_the_same(opened, make):
    count = 1200
    whole, few = make(count), make(24)
    which = np.arange(count) % 24
    for k in range(480, 530):
        sample = [one[:, k] for one in (opened.open_rates, opened.position, opened.attitude, opened.rate)]
        large = whole.update(*(one[which] for one in sample))
        small = few.update(*sample)
        np.testing.assert_array_equal(large.statistic, small.statistic[which])
        np.testing.assert_array_equal(large.thruster, small.thruster[which])


def spoil(healthy, seed: int, share: float = 0.1):
    """Samples of which a share is missing, no number, or has no attitude."""
    rng = np.random.default_rng(seed)
    for k in range(1000):
        position, attitude = healthy.position[:, k].copy(), healthy.attitude[:, k].copy()
        which = rng.random(10)
        position[which < share / 2] = 1e6
        position[(which >= share / 2) & (which < 0.75 * share)] = np.nan
        attitude[(which >= 0.75 * share) & (which < share)] = 0.0
        yield healthy.open_rates[:, k], position, attitude, healthy.rate[:, k], which >= share / 2


@pytest.mark.parametrize(
    "make",
    [
        lambda: NormThreshold(MSR_A, 2.6e-3, design="observer", vehicles=10),
        lambda: FusionDetector(MSR_A, RATIO, vehicles=10),
    ],
    ids=("observer", "fusion"),
)
def test_missing_and_spoilt_samples_are_bridged(healthy, make):
    detector = make()
    for *sample, valid in spoil(healthy, 1):
        diagnosis = detector.update(*sample, valid=valid)
        assert not diagnosis.detected.any()
    assert (detector.refused > 20).all()


def test_pades_states_do_not_bear_lost_samples(healthy):
    detector = NormThreshold(MSR_A, THRESHOLD, vehicles=10)
    for *sample, valid in spoil(healthy, 1):
        diagnosis = detector.update(*sample, valid=valid)
    assert diagnosis.detected.sum() > 3


@pytest.mark.parametrize("make", make_detectors(), ids=("norm", "correlation", "signature", "fusion"))
def test_reset_begins_anew_in_some_or_all(opened, make):
    detector = make(24)
    first = watch(detector, opened)
    again = watch(detector, opened)
    np.testing.assert_array_equal(first.statistic, again.statistic)
    np.testing.assert_array_equal(first.thruster, again.thruster)
    some = np.arange(24) < 5
    detector.reset(some)
    np.testing.assert_array_equal(detector.detected, ~some & np.isfinite(first.detection))
    np.testing.assert_array_equal(detector.samples, np.where(some, 0, opened.open_rates.shape[1]))


def test_a_thruster_believed_dead_is_not_suspected_and_its_absence_not_missed(closed):
    """Told of the closed valve, the detector expects what comes and stays calm."""
    for make in make_detectors():
        detector = make(16)
        effectiveness = np.repeat(MSR_A.effectiveness()[np.newaxis], 16, axis=0)
        for v, thruster in enumerate(closed.thruster):
            effectiveness[v, :, thruster - 1] = 0.0
        for k in range(closed.open_rates.shape[1]):
            if k == 501:
                detector.believe(effectiveness)
            sample = (one[:, k] for one in (closed.open_rates, closed.position, closed.attitude, closed.rate))
            diagnosis = detector.update(*sample)
        assert not diagnosis.detected.any()


def test_statistics_are_what_calibration_takes(healthy):
    statistic = watch(FusionDetector(MSR_A, np.inf, vehicles=10), healthy).statistic[:, 400:]
    found = threshold_for_rate(statistic.reshape(-1, 100).max(axis=1), 0.05)
    assert 3.0 < found.threshold < 15.0
    assert found.upper <= 0.05


@pytest.mark.parametrize(
    ("kind", "severity", "names"),
    [
        ("stuck_on", 1.0, ("stuck_on",)),
        ("stuck_off", 1.0, ("stuck_off",)),
        ("loss", 0.5, ("loss",)),
        ("leak", 0.2, ("leak", "stuck_on")),
        ("late_opening", 0.005, ("late_opening", "loss")),
        ("slow_opening", 0.5, ("slow_opening", "late_opening")),
    ],
)
def test_fusion_knows_the_faults_of_the_environment(kind, severity, names):
    """Its own plant and pilot, mass properties that are not those of the description, no tuning."""
    batch = begin(MarsRendezvous(faults=Fault(3, kind, severity=severity, onset=45.03)), worlds=8)
    detector = FusionDetector("msr_chaser", 20.0, margin=6.0, vehicles=8)
    for _ in range(560):
        told = batch.task.pilot_actions(batch.state)
        rates = 0.5 * (told[:, 0] + 1.0)
        seen = batch.fleet.read(at.MEASURED, 13)[:, 0]
        shut = rates < 0.05  # shorter than the minimum on-time
        detector.update(np.where(shut, 0.0, rates), seen[:, :3], seen[:, 6:10], seen[:, 10:])
        batch.step(told)
    np.testing.assert_array_equal(detector.thruster, 3)
    assert np.median(detector.detection_time) < 45.03 + 1.2
    assert detector.detection_time.min() > 45.03
    assert sum(one in names for one in detector.identify().kind) >= 7


def source(seeds, faulty):
    """Open and closed valves by turns."""
    kinds = (("stuck_on", 1.0), ("stuck_off", 1.0))
    faults = [ValveFault(seed % 8 + 1, *kinds[seed % 2], 45.0 + 0.037 * (seed % 100)) for seed in seeds]
    if not faulty:
        faults = [ValveFault() for _ in seeds]
    return fly(seeds, 55.0, faults).seen()


def test_the_yardstick_of_detectors_takes_those_fed_by_navigation():
    found = evaluate(
        lambda count: FusionDetector(MSR_A, RATIO, vehicles=count),
        source,
        name="fusion",
        false_alarms=1e-4,
        validation=range(1000, 1100),
        test=range(2000, 2016),
        identify=lambda detector, thruster: detector.identify(thruster),
        rates=(),
        patience=5.0,
    )
    assert found.isolated.successes == found.isolated.trials == 16
    assert found.identified.value >= 15 / 16
    assert 0.1 < found.median_delay < 0.6
    assert found.by_kind["stuck_on"][1] < found.by_kind["stuck_off"][1]
    hurried = evaluate(
        lambda count: FusionDetector(MSR_A, RATIO, vehicles=count),
        source,
        name="fusion",
        false_alarms=1e-4,
        validation=range(1000, 1100),
        test=range(2000, 2016),
        rates=(),
    )
    assert hurried.isolated.successes < 8  # an alarm comes before a name
    assert hurried.median_delay == found.median_delay


def test_designs_by_name_are_those_of_the_spacecraft():
    assert named_design(MSR_A, "pade").states == 9
    assert named_design(MSR_A, "observer").late == 1
    assert named_design(MSR_A, "undelayed").late == 0
    assert named_design(MSR_A, "pade").period == PERIOD


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match="design 'pad' is unknown; did you mean 'pade'"):
        NormThreshold(MSR_A, 1.0, design="pad")
    with pytest.raises(ValueError, match="vote 'most' is unknown"):
        CorrelationDetector(MSR_A, 1.0, vote="most")
    for window in (0, 1.5):
        with pytest.raises(ValueError, match=f"window is {window}; a whole number of samples from 1 would"):
            CorrelationDetector(MSR_A, 1.0, window=window)
    with pytest.raises(ValueError, match=r"vehicles is 1\.5; a whole number from 1 would be right"):
        NormThreshold(MSR_A, 1.0, vehicles=1.5)
    with pytest.raises(ValueError, match=r"design is 'pade'; 'undelayed', as the thrust of 'orion' comes"):
        NormThreshold("orion", 1.0)
    with pytest.raises(ValueError, match=r"kinds has 'lost'; did you mean 'loss'"):
        SignatureDetector(MSR_A, 1.0, kinds=("lost",))
    with pytest.raises(ValueError, match=r"threshold is nan; a number of 0 or more would be right"):
        FusionDetector(MSR_A, np.nan)
    detector = FusionDetector(MSR_A, RATIO)
    with pytest.raises(ValueError, match=r"open_rates of vehicle 0, thruster 3 is 1\.5; a number"):
        detector.update([0.1, 0.1, 1.5, 0.1, 0.1, 0.1, 0.1, 0.1], np.zeros(3), [1, 0, 0, 0])
    with pytest.raises(ValueError, match=r"position has the shape \(2,\); \(1, 3\) would be right"):
        detector.update(np.zeros(8), np.zeros(2), [1, 0, 0, 0])
    with pytest.raises(ValueError, match=r"thruster is \[9\]; 1 numbers from 0 to 8 would be right"):
        detector.identify([9])


@pytest.mark.parametrize("make_copy", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
@pytest.mark.parametrize("kind", [FusionDetector, SignatureDetector, CorrelationDetector])
def test_a_copy_goes_on_as_the_original_would_and_leaves_it_alone(kind, make_copy):
    rng = np.random.default_rng(0)
    duties = rng.uniform(0.0, 0.3, (60, MSR_A.number_of_thrusters))
    positions = 0.01 * np.arange(60)[:, np.newaxis] + 1e-3 * rng.standard_normal((60, 3))
    upright, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    original = kind(MSR_A, THRESHOLD, settle=0.0)
    for k in range(30):
        original.update(duties[k], positions[k], upright, still)
    copied = make_copy(original)
    after = [copied.update(duties[k], positions[k], upright, still) for k in range(30, 60)]
    assert original.samples[0] == 30
    for k, expected in zip(range(30, 60), after, strict=True):
        answer = original.update(duties[k], positions[k], upright, still)
        assert answer.detected == expected.detected
        assert answer.kind == expected.kind
        np.testing.assert_array_equal(answer.statistic, expected.statistic)
        np.testing.assert_array_equal(answer.suspicion, expected.suspicion)
