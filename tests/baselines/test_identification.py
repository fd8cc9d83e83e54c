"""Model comparison says how a thruster fails; least squares says how badly, and how well that is known."""

from __future__ import annotations

import numpy as np
import pytest

from thruster_baselines.detection import GLRDetector, ModelComparison, least_squares_severity
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping.coupling import delivered_on_times
from thruster_envs.faults import KINDS
from thruster_envs.spacecraft import load

ORION = load("orion")
NOMINAL = ORION.effectiveness()
FIRED = np.isin(np.arange(12), [0, 5, 9, 11]).astype(float)
"""The firing of Yang 2003, section 6.4.3: thrusters 1, 6, 10 and 12, for a second."""


@pytest.mark.parametrize("period", [1.0, 5.0])
def test_statistics_of_the_source(period):
    """Thruster 1 dead for a second, Y = 10 I: reference 10.4; in 5 s the source's stuck-on model."""
    detector = GLRDetector.yang2003(ORION, coupling=0.0, process_noise=0.0)
    diagnosis = detector.update(FIRED, NOMINAL @ (FIRED * (np.arange(12) != 0)), period)
    comparison = ModelComparison(ORION, coupling=0.0)
    answer = comparison(detector.last, diagnosis.thruster)
    found = dict(zip(comparison.models, answer.statistic[0], strict=True))
    assert found["none", 0.0] == pytest.approx(3.7225e-4, rel=5e-5)
    for lost, expected in ((0.2, 2.3824e-4), (0.4, 1.3401e-4), (0.6, 5.9559e-5), (0.8, 1.4890e-5)):
        assert found["loss", lost] == pytest.approx(expected, rel=1e-4)
    assert found["stuck_off", 1.0] == pytest.approx(0.0, abs=1e-18)
    # over the length of the interval, full on cannot be told from no fault, and is left out
    assert found["stuck_on", 1.0] == (np.inf if period == 1.0 else pytest.approx(9.3061e-3, rel=5e-5))
    assert answer.kind == ("stuck_off",)
    assert answer.severity.tolist() == [1.0]


def deliver(u: np.ndarray, thruster: int, kind: str, severity: float, period: float) -> np.ndarray:
    """Effective on-times of a faulty thruster, on Orion's feed."""
    told, shut, stuck = u.copy(), u.copy(), u.copy()
    shut[thruster], stuck[thruster] = 0.0, period
    as_told, without, always = (delivered_on_times(one, ORION.feed.coupling) for one in (told, shut, stuck))
    if kind == "loss":
        as_told[thruster] *= 1.0 - severity
    return {
        "none": as_told, "stuck_off": without, "stuck_on": always, "loss": as_told,
        "leak": as_told + severity * (always - as_told),
    }[kind]  # fmt: skip


@pytest.mark.parametrize("thruster", range(12))
def test_without_noise_every_model_finds_itself(thruster):
    comparison = ModelComparison(ORION)
    u = np.random.default_rng(thruster).uniform(0.5, 3.0, 12)
    count = len(comparison.models)
    measured = np.stack(
        [NOMINAL @ deliver(u, thruster, kind, severity, 5.0) for kind, severity in comparison.models]
    )
    detector = GLRDetector.yang2003(ORION, vehicles=count)
    detector.update(np.repeat(u[np.newaxis], count, axis=0), measured, 5.0)
    answer = comparison(detector.last, np.full(count, thruster + 1))
    assert list(zip(answer.kind, answer.severity, strict=True)) == list(comparison.models)
    assert {kind for kind, _ in comparison.models} - {"none"} <= set(KINDS)
    np.testing.assert_allclose(answer.statistic.diagonal(), 0.0, atol=1e-20)


def test_what_cannot_be_told_from_no_fault_is_left_out():
    comparison = ModelComparison(ORION)
    detector = GLRDetector.yang2003(ORION, vehicles=2)
    u = np.zeros((2, 12))
    u[1, 0] = 1.0  # vehicle 0 does not fire thruster 1, vehicle 1 fires it all the time
    detector.update(u, np.zeros((2, 6)), 1.0)
    statistic = comparison(detector.last, [1, 1]).statistic
    for (kind, _), (idle, busy) in zip(comparison.models, statistic.T, strict=True):
        assert np.isinf(idle) == (kind in ("stuck_off", "loss"))
        assert np.isinf(busy) == (kind in ("stuck_on", "leak"))


def test_nobody_named_and_nothing_measured_is_no_fault():
    detector = GLRDetector.yang2003(ORION, vehicles=2)
    detector.update(FIRED, np.zeros(6), 1.0, valid=[True, False])
    answer = ModelComparison(ORION)(detector.last, [0, 3])
    assert answer.kind == ("none", "none")
    assert (answer.statistic == 0.0).all()
    severity = least_squares_severity(detector.last, [0, 3])
    assert severity.loss.tolist() == severity.opening.tolist() == [0.0, 0.0]
    assert np.isinf(severity.loss_deviation).all()
    assert np.isinf(severity.opening_deviation).all()


@pytest.mark.parametrize(("kind", "true"), [("loss", 0.45), ("leak", 0.3)])
def test_the_severity_is_unbiased_and_as_uncertain_as_it_says(kind, true):
    """5,000 intervals with errors of the physical size; bias and spread to five standard deviations."""
    count, rng = 5000, np.random.default_rng(0)
    noise = PhysicalNoise(ORION)
    u = np.full((count, 12), 0.05)
    u[:, 3] = 0.5
    delivered = u.copy()
    if kind == "loss":
        delivered[:, 3] *= 1.0 - true
    else:
        delivered[:, 3] += true * (1.0 - u[:, 3])
    errors = rng.normal(size=(count, 6)) @ np.linalg.cholesky(noise(u[0])).T
    detector = GLRDetector(NOMINAL, 0.0, noise=noise, vehicles=count)
    detector.update(u, delivered @ NOMINAL.T + errors, 1.0)
    severity = least_squares_severity(detector.last, np.full(count, 4))
    size, deviation = (
        (severity.loss, severity.loss_deviation)
        if kind == "loss"
        else (severity.opening, severity.opening_deviation)
    )
    assert 0.0 < size.min() < size.max() < 1.0  # nothing was cut
    assert abs(size.mean() - true) < 5.0 * deviation[0] / np.sqrt(count)
    assert size.std() == pytest.approx(deviation[0], rel=5.0 / np.sqrt(2.0 * count))


def test_the_severity_is_cut_to_what_is_possible():
    detector = GLRDetector.yang2003(ORION, coupling=0.0)
    detector.update(FIRED, NOMINAL @ FIRED - 2.0 * NOMINAL[:, 0], 2.0)
    severity = least_squares_severity(detector.last, [1])
    assert severity.loss.tolist() == [1.0]
    assert severity.opening.tolist() == [0.0]


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: ModelComparison(ORION, losses=(0.5, 1.0)), "losses has the level 1.0; a share between"),
        (lambda: ModelComparison(ORION, openings=(0.0,)), "openings has the level 0.0"),
    ],
)
def test_a_level_that_cannot_be_is_refused(call, line):
    with pytest.raises(ValueError, match=line):
        call()


def test_a_thruster_that_does_not_exist_is_refused():
    detector = GLRDetector.yang2003(ORION)
    detector.update(FIRED, np.zeros(6), 1.0)
    for wrong in ([13], [-1], [1, 2]):
        with pytest.raises(ValueError, match=r"thruster is .*; 1 numbers from 0 to 12 would be right"):
            ModelComparison(ORION)(detector.last, wrong)
        with pytest.raises(ValueError, match="1 numbers from 0 to 12"):
            least_squares_severity(detector.last, wrong)
    with pytest.raises(ValueError, match=r"interval is None; `BaseDetector\.last` after an update"):
        ModelComparison(ORION)(GLRDetector.yang2003(ORION).last, [1])


@pytest.mark.parametrize("side", range(8))
@pytest.mark.parametrize("angle", [0.2, 0.5])
def test_without_noise_a_tilted_thrust_is_told_by_its_angle(angle, side):
    """Thrust of the same size in another direction: less along, the rest across, with its torque."""
    comparison = ModelComparison(ORION, tilts=(0.2, 0.5))
    kinds = [model for model in comparison.models if model[0] == "misalignment"]
    assert kinds == [("misalignment", 0.2)] * 8 + [("misalignment", 0.5)] * 8
    for thruster in range(12):
        one = ORION.thrusters[thruster]
        along, turn = np.array(one.direction), 2.0 * np.pi * side / 8.0
        across = np.cross(along, np.roll(along, 1))  # Orion's thrusters point along axes
        direction = np.cos(angle) * along + np.sin(angle) * (
            np.cos(turn) * across + np.sin(turn) * np.cross(along, across)
        )
        force = one.thrust * direction
        torque = np.linalg.solve(np.array(ORION.inertia), np.cross(one.position, force))
        u = np.random.default_rng(thruster).uniform(0.5, 3.0, 12)
        delivered = delivered_on_times(u, ORION.feed.coupling)
        tilted = NOMINAL.copy()
        tilted[:, thruster] = np.concatenate([force / ORION.mass, torque])
        detector = GLRDetector.yang2003(ORION)
        detector.update(u, tilted @ delivered, 5.0)
        answer = comparison(detector.last, [thruster + 1])
        assert answer.kind == ("misalignment",)
        assert answer.severity.tolist() == [angle]
        assert answer.statistic.min() == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"tilts": (0.0,)}, "tilts has 0.0; an angle above 0 and at most pi/2 rad would be right"),
        ({"tilts": (2.0,)}, "tilts has 2.0"),
        ({"tilts": (0.2,), "sides": 0}, "sides is 0; one or more would be right"),
        ({"spacecraft": 12, "tilts": (0.2,)}, "spacecraft is 12; with tilts a spacecraft would be right"),
    ],
)
def test_tilts_that_cannot_be_are_refused_in_one_line(given, line):
    with pytest.raises(ValueError, match=line):
        ModelComparison(**({"spacecraft": ORION} | given))
