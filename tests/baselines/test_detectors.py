"""Detectors name the thruster that failed, keep quiet where nothing is wrong, and bear bad input."""

from __future__ import annotations

import numpy as np
import pytest

from thruster_baselines.detection import (
    BaseDetector,
    CUSUMDetector,
    EstimatorThreshold,
    FilterBank,
    GenericChiSquared,
    GLRDetector,
    SetChiSquared,
    SingleChiSquared,
    Telemetry,
    WindowedGLR,
)
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping.coupling import delivered_on_times
from thruster_baselines.mapping.simplex import PARALLEL_FROM
from thruster_envs.spacecraft import load

ORION = load("orion")
NOMINAL = ORION.effectiveness()
TABLE_1 = np.array(
    [[5, -3, -2, 0], [0, 2, 4, -6], [1, 0.5, -2, 0], [3.5, 2, -5, 0], [0, 0, -3, 4], [0, 2, 0, -1]]
)
"""Yang 2003, Table 1: four actuators, each with its own set of axes."""

FIRED = np.isin(np.arange(12), [0, 5, 9, 11]).astype(float)
"""The firing of Yang 2003, section 6.4.3: thrusters 1, 6, 10 and 12, for a second."""

MAKERS = [
    lambda vehicles=1, **more: EstimatorThreshold(ORION, vehicles=vehicles, **more),
    lambda vehicles=1, **more: GenericChiSquared(ORION, 5.5e-5, vehicles=vehicles, **more),
    lambda vehicles=1, **more: SingleChiSquared(ORION, 5.5e-5, vehicles=vehicles, **more),
    lambda vehicles=1, **more: SetChiSquared(ORION, 5.5e-5, vehicles=vehicles, **more),
    lambda vehicles=1, **more: GLRDetector.yang2003(ORION, vehicles=vehicles, **more),
    lambda vehicles=1, **more: WindowedGLR(
        ORION, 30.0, 3, noise=PhysicalNoise(ORION), vehicles=vehicles, **more
    ),
    lambda vehicles=1, **more: CUSUMDetector(
        ORION, 10.0, noise=PhysicalNoise(ORION), vehicles=vehicles, **more
    ),
    lambda vehicles=1, **more: FilterBank(ORION, 8.0, noise=PhysicalNoise(ORION), vehicles=vehicles, **more),
    lambda vehicles=1, **more: FilterBank(
        ORION, 8.0, noise=1e-6, process_noise=1e-9, vehicles=vehicles, **more
    ),
]
every_detector = pytest.mark.parametrize("make", MAKERS)


def healthy(count: int, seed: int, duration: float = 1.0, normal: bool = False):
    """Random firings of thrusters that scatter, on the shared feed, seen by sensors with errors."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.0, duration, (count, 12)) * (rng.random((count, 12)) < 0.4)
    scatter = rng.normal(size=u.shape) / np.sqrt(3.0) if normal else rng.uniform(-1.0, 1.0, u.shape)
    delivered = delivered_on_times(u, ORION.feed.coupling) * (1.0 + 0.1 * scatter)
    errors = np.repeat([ORION.sensors.velocity, ORION.sensors.rate], 3) * np.sqrt(2.0)
    return u, delivered @ NOMINAL.T + errors * rng.normal(size=(count, 6))


def test_likelihood_ratios_of_the_source():
    """Thruster 1 dead for a second, Y = 10 I: reference 10.3, worked out from Yang 2003, eq. 69."""
    detector = GLRDetector.yang2003(ORION, coupling=0.0, process_noise=0.0)
    dead = FIRED * (np.arange(12) != 0)
    diagnosis = detector.update(FIRED, NOMINAL @ dead, 1.0)
    ratios = [
        3.7225e-4, 8.3629e-5, 1.0798e-4, 2.5745e-6, 8.3629e-5, 1.0798e-4,
        2.8826e-6, 8.3629e-5, 1.0798e-4, 3.6865e-4, 8.3629e-5, 1.0798e-4,
    ]  # fmt: skip
    seconds = [
        -1,
        0.4927,
        0.5356,
        -0.0832,
        -0.4927,
        0.5356,
        0.0880,
        0.4927,
        -0.5356,
        0.9952,
        -0.4927,
        -0.5356,
    ]
    np.testing.assert_allclose(diagnosis.suspicion[0], ratios, rtol=5e-5)
    np.testing.assert_allclose(-diagnosis.shortfall[0], seconds, rtol=0, atol=5.1e-5)
    assert diagnosis.thruster.tolist() == [1]
    assert diagnosis.statistic[0] == diagnosis.suspicion[0, 0]
    generic = GenericChiSquared(ORION, 5.5e-5, coupling=0.0, process_noise=0.0)
    statistic = generic.update(FIRED, NOMINAL @ dead, 1.0).statistic[0]
    assert statistic == pytest.approx(3.7225e-4, rel=1e-4)


@pytest.mark.parametrize("correlated", [False, True])
def test_likelihood_ratios_are_those_of_the_formula(correlated):
    """Against linear algebra, with a covariance of any form."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6)) if correlated else np.diag(rng.uniform(0.5, 2.0, 6))
    y = 1e-5 * (root @ root.T + np.eye(6))
    detector = GLRDetector(NOMINAL, 0.0, noise=y, process_noise=0.0, vehicles=50)
    u, z = healthy(50, 1)
    diagnosis = detector.update(u, z, 1.0)
    w = np.linalg.solve(y, NOMINAL)
    chi, size = (z - u @ NOMINAL.T) @ w, np.einsum("ki,ki->i", NOMINAL, w)
    np.testing.assert_allclose(diagnosis.suspicion, chi**2 / size, rtol=1e-9)
    np.testing.assert_allclose(diagnosis.shortfall, -chi / size, rtol=1e-9)
    assert (diagnosis.thruster == 1 + (chi**2 / size).argmax(axis=1)).all()


@pytest.mark.parametrize("lost", [1.0, 0.75, 0.5, 0.25])
def test_the_shortest_firing_that_shows_a_loss_has_a_closed_form(lost):
    """sqrt(threshold R) / (q |a_i|): 0.38 s for a dead thruster, 0.77 s for half of one (reference 5.4)."""
    norm = np.linalg.norm(NOMINAL[:, 0])
    shortest = np.sqrt(5.5e-5 * 10.0) / (lost * norm)
    assert round(shortest * lost, 2) == 0.38
    for share, seen in ((0.999, False), (1.001, True)):
        detector = GLRDetector.yang2003(ORION, process_noise=0.0)
        u = np.eye(12)[0] * shortest * share
        assert detector.update(u, NOMINAL @ u * (1.0 - lost), 5.0).detected[0] == seen


def test_the_sign_gate_leaves_out_who_cannot_have_done_it():
    u = np.zeros(12)
    u[0] = 1.0
    noisy = NOMINAL[:, 0] * 0.0 + 0.02 * NOMINAL[:, 9]  # looks a little like thrust of 10, its near-twin
    open_door = GLRDetector.yang2003(ORION, 0.0, process_noise=0.0)
    gated = GLRDetector.yang2003(ORION, 0.0, process_noise=0.0, sign_gate=True)
    assert gated.update(u, noisy, 1.0).thruster[0] == 1
    suspicion = gated.update(np.zeros(12), -NOMINAL[:, 0], 1.0).suspicion[0]  # 1 was told nothing: not less
    assert suspicion[0] == 0.0
    assert open_door.update(np.zeros(12), -NOMINAL[:, 0], 1.0).suspicion[0, 0] > 0.0
    full = np.eye(12)[0]
    assert gated.update(full, 2.0 * NOMINAL[:, 0], 1.0).suspicion[0, 0] == 0.0  # cannot have fired longer
    assert gated.update(0.5 * full, NOMINAL[:, 0], 1.0).suspicion[0, 0] > 0.0


def test_the_gate_makes_isolation_of_a_dead_thruster_better():
    """Half a second, 0.7 mm/s and 0.7 mrad/s: 98.2 % without, near 100 % with it (reference 5.3)."""
    vehicles, rng = 4000, np.random.default_rng(3)
    u = np.zeros((vehicles, 12))
    u[:, [0, 5, 9, 11]] = 0.5
    dead = u * (np.arange(12) != 0) * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, u.shape))
    z = dead @ NOMINAL.T + 0.7e-3 * rng.normal(size=(vehicles, 6))
    right = [
        (
            GLRDetector.yang2003(ORION, coupling=0.0, process_noise=0.0, sign_gate=gate, vehicles=vehicles)
            .update(u, z, 0.5)
            .thruster
            == 1
        ).mean()
        for gate in (False, True)
    ]
    assert 0.95 < right[0] < right[1]
    assert right[1] > 0.99


@pytest.mark.parametrize("dead", range(12))
def test_a_thruster_believed_dead_is_not_suspected_and_not_expected(dead):
    detector = GLRDetector.yang2003(ORION, coupling=0.0)
    believed = NOMINAL.copy()
    believed[:, dead] = 0.0
    detector.believe(believed)
    diagnosis = detector.update(np.eye(12)[dead], np.zeros(6), 1.0)
    assert diagnosis.statistic[0] == 0.0
    assert diagnosis.suspicion[0, dead] == 0.0
    assert not diagnosis.detected[0]
    detector.reset()
    assert detector.update(np.eye(12)[dead], np.zeros(6), 1.0).thruster[0] == dead + 1


def test_what_was_learned_of_other_thrusters_survives_a_new_belief():
    detector = EstimatorThreshold(ORION, coupling=0.0, vehicles=2)
    for _ in range(30):
        detector.update(np.eye(12)[0], np.zeros(6), 1.0)
    learned = detector.filter.effectiveness.copy()
    believed = NOMINAL.copy()
    believed[:, 4] *= 0.5
    detector.believe(believed, [True, False])
    np.testing.assert_array_equal(detector.filter.effectiveness[0, :, 4], believed[:, 4])
    np.testing.assert_array_equal(detector.filter.effectiveness[0, :, 0], learned[0, :, 0])
    np.testing.assert_array_equal(detector.filter.effectiveness[1], learned[1])


@pytest.mark.parametrize(("share", "firings"), [(0.8, 21), (0.6, 34), (0.2, 72)])
def test_the_estimate_of_a_dead_thruster_falls_as_slowly_as_the_reference_computes(share, firings):
    detector = EstimatorThreshold(ORION, 1.0 - share, coupling=0.0)
    for firing in range(1, firings + 1):
        diagnosis = detector.update(np.eye(12)[6], np.zeros(6), 1.0)
        assert diagnosis.detected[0] == (firing == firings)
    assert diagnosis.thruster.tolist() == [7]
    assert diagnosis.statistic[0] > 1.0 - share


def test_an_estimate_that_cannot_move_is_no_detector():
    with pytest.raises(ValueError, match="process_noise and initial_covariance are 0"):
        EstimatorThreshold(ORION, process_noise=0.0)


@pytest.mark.parametrize("kind", [GenericChiSquared, SingleChiSquared])
def test_with_physical_noise_the_statistics_are_chi_squared(kind):
    """40,000 healthy firings; the share above a quantile of chi-squared, to five standard deviations."""
    from scipy.stats import chi2

    count = 40_000
    u, z = healthy(count, 4, normal=True)
    detector = kind(ORION, np.inf, noise=PhysicalNoise(ORION), vehicles=count)
    diagnosis = detector.update(u, z, 1.0)
    for tail in (0.5, 0.05):
        if kind is GenericChiSquared:
            above = diagnosis.statistic > chi2.ppf(1.0 - tail, 6)
        else:
            above = detector.axes[:, 1] > chi2.ppf(1.0 - tail, 1)
        assert abs(above.mean() - tail) < 5.0 * np.sqrt(tail * (1.0 - tail) / count)


@pytest.mark.parametrize("thruster", range(4))
def test_sets_of_axes_of_their_own_tell_who_it_is(thruster):
    """Yang 2003, Table 1: no two actuators share their axes."""
    detector = SetChiSquared(TABLE_1, 12.0, noise=1.0, process_noise=0.0)
    u = np.full(4, 4.0)
    rng = np.random.default_rng(thruster)
    z = TABLE_1 @ (u * (np.arange(4) != thruster)) + 0.5 * rng.normal(size=6)
    assert detector.update(u, z, 5.0).thruster.tolist() == [thruster + 1]


def test_on_orion_sets_of_axes_never_tell_who_it_is():
    """Four thrusters each share their three axes, so that the set is found and the thruster is not."""
    for thruster in range(12):
        detector = SetChiSquared(ORION, 5.5e-5, coupling=0.0)
        diagnosis = detector.update(np.ones(12), -NOMINAL[:, thruster], 1.0)
        assert diagnosis.detected[0]
        assert diagnosis.thruster[0] == 0
        same_axes = ((NOMINAL != 0.0) == (NOMINAL[:, [thruster]] != 0.0)).all(axis=0)
        assert same_axes.sum() == 4
        assert (
            np.flatnonzero(diagnosis.suspicion[0] == diagnosis.statistic[0]).tolist()
            == np.flatnonzero(same_axes).tolist()
        )


@every_detector
def test_a_vehicle_lives_through_the_same_alone_and_in_a_batch(make):
    steps = [healthy(5, seed) for seed in range(4)]
    together = make(5)
    alone = [make(1) for _ in range(5)]
    for u, z in steps:
        z = z.copy()
        z[2] = 0.0  # so that something happens
        diagnosis = together.update(u, z, 1.0, valid=[True, True, True, False, True])
        for v in range(5):
            own = alone[v].update(u[v], z[v], 1.0, valid=[v != 3])
            for name in ("detected", "thruster", "statistic", "time", "suspicion", "shortfall"):
                np.testing.assert_array_equal(getattr(diagnosis, name)[v], getattr(own, name)[0])


def test_likelihood_ratios_of_vehicles_shared_among_threads_are_those_of_small_batches():
    count, some = PARALLEL_FROM + 88, 100
    u, z = healthy(count, 3)
    whole = GLRDetector.yang2003(ORION, vehicles=count).update(u, z, 1.0)
    for first in range(0, count, some):
        here = slice(first, first + some)
        part = GLRDetector.yang2003(ORION, vehicles=some).update(u[here], z[here], 1.0)
        np.testing.assert_array_equal(part.suspicion, whole.suspicion[here])
        np.testing.assert_array_equal(part.shortfall, whole.shortfall[here])
    assert whole.statistic.min() > 0.0


@every_detector
def test_bad_measurements_are_refused_counted_by_name_and_teach_nothing(make):
    detector: BaseDetector = make(7)
    u, z = healthy(7, 7)
    z[0, 2] = np.nan
    z[1, 4] = np.inf
    z[2, 0] = 1.0  # m/s within a second: twelve thrusters together do not give that
    valid = [True, True, True, False, True, True, True]
    age = [0.0, 0.0, 0.0, 0.0, 1.0, -1.0, np.nan]
    diagnosis = detector.update(u, z, 1.0, valid=valid, age=age)
    assert {reason: count.tolist() for reason, count in detector.refused.items()} == {
        "missing": [0, 0, 0, 1, 0, 0, 0],
        "late": [0, 0, 0, 0, 1, 1, 1],
        "not a number": [1, 1, 0, 0, 0, 0, 0],
        "out of range": [0, 0, 1, 0, 0, 0, 0],
    }
    assert not diagnosis.detected.any()
    assert (diagnosis.statistic == 0.0).all()
    assert (diagnosis.thruster == 0).all()
    assert diagnosis.time.tolist() == [1.0] * 7
    assert (detector.filter.effectiveness == NOMINAL).all()


def test_the_last_refusal_is_told_in_one_line():
    detector = GLRDetector.yang2003(ORION, vehicles=5)
    assert detector.last_refusal() == ""
    u, z = healthy(5, 7)
    z[0, 4], z[1, 0] = np.nan, 1.0
    detector.update(u, z, 1.0, valid=[True, True, False, True, True], age=[0.0, 0.0, 0.0, 1.0, 1e-9])
    scatter = np.array([one.scatter for one in ORION.thrusters])
    largest = np.abs(NOMINAL[0]) @ (1.0 + scatter) + 8.0 * np.sqrt(2.0) * ORION.sensors.velocity
    assert [detector.last_refusal(vehicle) for vehicle in range(5)] == [
        "the rate change of vehicle 0, rate y, is nan; a finite number of rad/s would be right",
        f"the rate change of vehicle 1, velocity x, is 1; -{largest:.4g} to {largest:.4g} m/s would be right",
        "the rate change of vehicle 2 is missing",
        "the rate change of vehicle 3 is 1 s old; that of the interval that has just ended would be right",
        "",
    ]
    detector.reset([True, False, False, False, False])
    assert detector.last_refusal(0) == ""
    assert detector.refused["not a number"].tolist() == [0] * 5
    assert detector.refused["late"].tolist() == [0, 0, 0, 1, 0]
    detector.update(u, 0.0 * z[2], 1.0)
    assert detector.last_refusal(3) == ""
    planar = GLRDetector.yang2003(np.ones((2, 4)))
    planar.update(np.zeros(4), [0.0, np.nan], 1.0)
    assert planar.last_refusal() == (
        "the rate change of vehicle 0, axis 2, is nan; a finite number of its unit would be right"
    )


@every_detector
def test_whatever_thrusters_can_do_is_not_refused(make):
    """All of the same sign stuck open for the whole interval, at the upper end of their scatter."""
    for axis in range(6):
        for sign in (1.0, -1.0):
            detector = make(1)
            open_ones = (sign * NOMINAL[axis] > 0.0).astype(float)
            detector.update(np.zeros(12), 1.1 * NOMINAL @ open_ones, 1.0)
            assert sum(detector.refused.values()).tolist() == [0]


@every_detector
def test_time_and_evidence_begin_anew_where_they_are_told_to(make):
    detector = make(2)
    for _ in range(3):
        detector.update(np.ones(12), 0.3 * NOMINAL[:, 0], 2.0)
    detector.reset([False, True])
    assert detector.time.tolist() == [6.0, 0.0]
    fresh = make(2)
    u, z = healthy(2, 8)
    after, first = detector.update(u, z, 1.0), fresh.update(u, z, 1.0)
    assert after.time.tolist() == [7.0, 1.0]
    np.testing.assert_array_equal(after.suspicion[1], first.suspicion[1])
    assert after.statistic[1] == first.statistic[1]


@every_detector
def test_the_loss_of_the_shared_feed_is_no_fault(make):
    """All twelve open for five seconds lose two thirds of their thrust, which nobody is to blame for."""
    detector = make(1)
    u = np.array([5.0, 4.0, 3.0, 5.0, 2.0, 1.0, 0.0, 4.5, 5.0, 0.0, 3.0, 2.5])
    diagnosis = detector.update(u, NOMINAL @ delivered_on_times(u, 0.06), 5.0)
    assert diagnosis.statistic[0] < 1e-12
    if not isinstance(detector, EstimatorThreshold):
        without = make(1, coupling=0.0)
        diagnoses = [without.update(u, NOMINAL @ delivered_on_times(u, 0.06), 5.0) for _ in range(5)]
        assert diagnoses[0].detected[0]
        # one that has learned it since then, and knows how far thrusters scatter, does not see it any more
        assert diagnoses[-1].detected[0] or isinstance(without, GLRDetector)


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: GLRDetector(ORION, -1.0), "threshold is -1.0; a number of 0 or more would be right"),
        (lambda: GLRDetector.yang2003(ORION, np.nan), "threshold is nan"),
        (lambda: GLRDetector.yang2003(ORION, vehicles=0), "vehicles is 0"),
        (lambda: GLRDetector.yang2003(ORION, coupling=-0.1), "coupling is -0.1"),
        (
            lambda: GLRDetector.yang2003(ORION).update(np.zeros(11), np.zeros(6), 1.0),
            r"on_times has the shape \(11,\)",
        ),
        (lambda: GLRDetector(ORION).update(np.zeros(12), np.zeros(5), 1.0), r"rate_change has the shape"),
        (lambda: GLRDetector.yang2003(ORION).update(np.zeros(12), np.zeros(6), 0.0), "duration is 0.0"),
        (
            lambda: GLRDetector.yang2003(ORION).update(-np.eye(12)[1], np.zeros(6), 1.0),
            "on_times of vehicle 0, thruster 2 is -1.0; a number of s from 0 to the duration of 1 s would be",
        ),
        (
            lambda: GLRDetector(ORION).update(20.0 * np.eye(12)[4], np.zeros(6), 5.0),  # ms given for s, say
            "on_times of vehicle 0, thruster 5 is 20.0; a number of s from 0 to the duration of 5 s",
        ),
        (
            lambda: GLRDetector.yang2003(ORION).update(np.full(12, np.nan), np.zeros(6), 1.0),
            "on_times of vehicle 0, thruster 1 is nan",
        ),
        (lambda: GLRDetector.yang2003(ORION).reset([0]), r"vehicles is an array of int64 .* a mask \(1,\)"),
        (lambda: GLRDetector(ORION).believe(np.zeros((6, 11))), r"effectiveness has the shape \(6, 11\)"),
        (lambda: GLRDetector.yang2003(ORION).believe(np.full((6, 12), np.inf)), "effectiveness has an entry"),
        (
            lambda: GLRDetector.yang2003(ORION).update(np.zeros(12), np.zeros(6), 1.0, age=0.0),
            r"age has the shape \(\); \(1,\) would be right",
        ),
        (
            lambda: GLRDetector.yang2003(ORION).update(np.zeros(12), np.zeros(6), 1.0, valid=[True, True]),
            r"valid has the shape \(2,\); \(1,\) would be right",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()


@pytest.mark.parametrize("detector", [CUSUMDetector, GLRDetector, GenericChiSquared, WindowedGLR])
def test_a_setting_that_no_filter_has_is_refused_with_the_nearest(detector):
    with pytest.raises(TypeError, match="unexpected keyword argument 'nois'; did you mean 'noise'"):
        detector("orion", 1.0, nois=10.0)


@every_detector
@pytest.mark.parametrize("beside", ["rate_change", "duration", "valid", "age"])
def test_telemetry_stands_alone(make, beside):
    values = {"rate_change": np.zeros(6), "duration": 1.0, "valid": [True], "age": [0.0]}
    telemetry = Telemetry(1.0, on_times=np.zeros((1, 12)), rate_change=np.zeros((1, 6)))
    with pytest.raises(TypeError, match=f"must have telemetry alone, got {beside} beside it"):
        make().update(telemetry, **{beside: values[beside]})
