"""Flights of the environments for the yardstick, and any detector as a player of the diagnosis tasks."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401 - registers the environments
from tests.tasks.diagnosing import LikelihoodPlayer
from thruster_baselines.detection import (
    CUSUMDetector,
    DetectorPlayer,
    EnvironmentFlights,
    GLRDetector,
    ModelComparison,
    PlayerDetector,
    by_model_comparison,
    evaluate,
    threshold_for_rate,
)
from thruster_baselines.detection.player import _THRESHOLD
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping import delivered_on_times
from thruster_envs.faults import KINDS, FaultDistribution
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import load

ORION = load("orion")
DIAGNOSIS, ACTIVE = "thruster_envs/FaultDiagnosis-v1", "thruster_envs/ActiveDiagnosis-v1"
EVERY_KIND = FaultDistribution(
    kinds=("stuck_off", "loss", "leak", "stuck_on", "misalignment"), onset=(0.0, 50.0)
)


def make(identifier, worlds, **arguments):
    return gym.make_vec(
        identifier, num_envs=worlds, vectorization_mode="vector_entry_point",
        autoreset_mode=gym.vector.AutoresetMode.DISABLED, **arguments,
    )  # fmt: skip


# ---- Flights -----------------------------------------------------------------------------------------------


def test_they_are_what_the_environment_flies_and_the_truth_is_that_of_info():
    flights = EnvironmentFlights(faults=EVERY_KIND, periods=30)(range(40, 60), faulty=True)
    env = make(DIAGNOSIS, 20, faults={"probability": 1.0, "kinds": EVERY_KIND.kinds, "onset": (0.0, 50.0)})
    _, info = env.reset(seed=40)
    np.testing.assert_array_equal(flights.thruster, info["fault"]["thruster"][:, 0])
    assert flights.kind == tuple(KINDS[kind - 1] for kind in info["fault"]["kind"][:, 0])
    np.testing.assert_allclose(flights.severity, info["fault"]["severity"][:, 0], rtol=1e-12)
    begins = np.full(20, np.inf)
    for period in range(30):
        begins[info["fault"]["active"][:, 0] & np.isinf(begins)] = 5.0 * period
        observations, *_, info = env.step(np.zeros((20, 2), np.int64))
        np.testing.assert_allclose(flights.on_times[:, period], 5.0 * observations[:, 13:25], rtol=1e-6)
        np.testing.assert_allclose(
            flights.rate_change[:, period], observations[:, 25:31] * ORION.authority(), rtol=1e-6
        )
    assert flights.duration == 5.0
    assert flights.valid.all()
    assert (begins == 5.0 * np.ceil(flights.onset / 5.0)).all()


def test_healthy_ones_give_what_their_thrusters_deliver_within_what_sensors_and_scatter_explain():
    """The normalised squared error has six degrees of freedom; the turning of the body adds a little."""
    flights = EnvironmentFlights(periods=60)(range(50), faulty=False)
    effective = delivered_on_times(flights.on_times, ORION.feed.coupling)
    error = flights.rate_change - effective @ ORION.effectiveness().T
    weighed = np.linalg.solve(PhysicalNoise(ORION)(effective), error[..., np.newaxis])[..., 0]
    assert 5.7 < (error * weighed).sum(axis=2).mean() < 7.5
    assert set(flights.kind) == {"none"}
    assert np.isinf(flights.onset).all()


def test_a_flight_is_a_function_of_its_seed_alone():
    source = EnvironmentFlights(faults=EVERY_KIND, periods=10, observed=True)
    together = source([3, 9, 4], faulty=True)
    one_by_one = EnvironmentFlights(faults=EVERY_KIND, periods=10, worlds=1, observed=True)(
        [3, 9, 4], faulty=True
    )
    for name in ("on_times", "rate_change", "valid", "thruster", "severity", "onset", "observations"):
        np.testing.assert_array_equal(getattr(together, name), getattr(one_by_one, name))
    assert (together.kind, together.duration) == (one_by_one.kind, one_by_one.duration)


def test_a_policy_may_fly_and_a_lost_flight_measures_nothing_any_more():
    spin = EnvironmentFlights(
        arguments={"pilot": lambda sight: np.where(np.arange(12) == 0, 1.0, 0.0) * np.ones((2, 1))},
        periods=40,
    )(range(2), faulty=False)
    assert (spin.on_times[:, :, 0] == 5.0).all()
    assert spin.valid[:, 0].all()
    assert not spin.valid[:, -1].any()
    assert (np.diff(spin.valid.astype(int), axis=1) <= 0).all()
    flown = EnvironmentFlights(
        environment="thruster_envs/OrionRendezvous-v1", periods=3,
        policy=lambda observations: np.full((len(observations), 12), -0.5),
    )(range(2), faulty=False)  # fmt: skip
    np.testing.assert_allclose(flown.on_times, 1.25, rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"periods": 0}, "periods is 0; one or more would be right"),
        ({"worlds": 0}, "worlds is 0"),
        ({"arguments": {"faults": []}}, "arguments has 'faults'; the field `faults`"),
        ({"environment": "thruster_envs/OrionRendezvous-v1"}, "periods is None"),
        ({"environment": "thruster_envs/OrionRendezvous-v1", "periods": 3}, "does not fly by itself"),
        ({"environment": "CartPole-v1"}, "environment is 'CartPole-v1', which takes no faults; one of this"),
        ({"environment": "thruster_envs/FormationKeeping-v1", "periods": 3}, "craft; an environment of one"),
    ],
)
def test_what_cannot_fly_is_refused_in_one_line(given, line):
    with pytest.raises(ValueError, match=line):
        EnvironmentFlights(**given)(range(2), faulty=False)


def test_the_yardstick_measures_detectors_in_flight():
    """A dead thruster under the scripted pilot, from the end of a period on."""
    found = evaluate(
        sums, EnvironmentFlights(), name="sums", false_alarms=1e-3, validation=VALIDATION[:200],
        test=TEST[:200], identify=by_model_comparison(ModelComparison(ORION)), rates=(),
    )  # fmt: skip
    assert found.false_alarms.low <= 1e-3
    assert found.missed.value <= 0.01
    assert found.median_delay <= 10.0
    assert found.isolated.value >= 0.85
    assert found.identified.value >= 0.9
    assert found.duration == 5.0


# ---- Players -----------------------------------------------------------------------------------------------


def sums(vehicles, threshold=_THRESHOLD):
    return CUSUMDetector(ORION, threshold, noise=PhysicalNoise(ORION), vehicles=vehicles)


def gated(vehicles):
    return GLRDetector(ORION, 20.0, noise=PhysicalNoise(ORION), sign_gate=True, vehicles=vehicles)


def play(player, env, seeds):
    """Mean score and share of successes of a player, made for an environment."""
    observations, _ = env.reset(seed=list(seeds))
    act = player(env)
    for _ in range(120):
        observations, _, _, _, info = env.step(act(observations))
    return info["score"].mean(), info["success"].mean()


def heuristic(env):
    """The environment's own: likelihood ratios by hand; with tests as `DetectorPlayer` fires them."""
    player, n, entries = LikelihoodPlayer(env.num_envs), 12, env.single_action_space.nvec.size
    number = iter(range(120))

    def act(observations):
        actions = np.zeros((env.num_envs, entries), np.int64)
        actions[:, :2] = player(observations)
        actions[:, 2:] = (np.arange(n) == next(number) % n)[: entries - 2]
        return actions

    return act


@pytest.mark.parametrize(
    ("identifier", "detector", "score", "success"),
    [(DIAGNOSIS, sums, 0.92, 0.95), (DIAGNOSIS, gated, 0.87, 0.93), (ACTIVE, sums, 0.93, 0.95)],
)
def test_a_detector_plays_the_diagnosis_tasks_better_than_their_own_heuristic(
    identifier, detector, score, success
):
    """On Orion, 200 test flights with the default faults."""
    env = make(identifier, 200)
    own = play(lambda env: DetectorPlayer(env, detector), env, TEST[:200])
    assert own[0] >= score
    assert own[1] >= success
    assert own[0] >= play(heuristic, env, TEST[:200])[0] + 0.03


def test_its_threshold_is_what_healthy_validation_flights_show():
    flights, whole = EnvironmentFlights()(VALIDATION[:500], faulty=False), slice(None)
    detector = sums(500, np.inf)
    statistics = np.stack(
        [detector.update(**flights.step(whole, period)).statistic for period in range(120)], axis=1
    )
    assert 0.9 * _THRESHOLD < threshold_for_rate(statistics, 1e-4).threshold <= _THRESHOLD


def test_worlds_that_begin_again_are_begun_anew():
    env = make(DIAGNOSIS, 2, faults=[{"thruster": 3, "kind": "stuck_off"}])
    player = DetectorPlayer(env)
    observations, _ = env.reset(seed=[1, 2])
    for _ in range(30):
        observations, *_ = env.step(player(observations))
    assert player(observations)[:, 0].tolist() == [3, 3]
    observations, _ = env.reset(seed=[1, 2], options={"reset_mask": np.array([False, True]), "faults": []})
    for _ in range(30):
        actions = player(observations)
        assert actions[:, 0].tolist() == [3, 0]
        observations, *_ = env.step(actions)


def test_only_diagnosis_tasks_can_be_played():
    with pytest.raises(ValueError, match="the observation of OrionRendezvous has no 'time'"):
        DetectorPlayer(make("thruster_envs/OrionRendezvous-v1", 1))
    with pytest.raises(ValueError, match=r"environment is .*CartPole.*; one of this suite would be right"):
        DetectorPlayer(gym.make("CartPole-v1"))


def test_a_single_environment_is_played_like_a_batch_of_one():
    fault = {"thruster": 7, "kind": "stuck_off"}
    alone, batch = gym.make(DIAGNOSIS, faults=[fault]), make(DIAGNOSIS, 1, faults=[fault])
    player, other = DetectorPlayer(alone), DetectorPlayer(batch)
    observation, observations = alone.reset(seed=0)[0], batch.reset(seed=0)[0]
    for _ in range(20):
        action = player(observation[np.newaxis])[0]
        actions = other(observations)
        assert action.tolist() == actions[0].tolist()
        observation, observations = alone.step(action)[0], batch.step(actions)[0]
    assert action.tolist() == [7, 0]
    with pytest.raises(ValueError, match=r"observations has the shape .*; \(worlds, size\)"):
        player(observation)


# ---- Players by the yardstick ------------------------------------------------------------------------------

ENVIRONMENT = make(DIAGNOSIS, 1)


def as_detector(player):
    return lambda vehicles: PlayerDetector(ENVIRONMENT, player(vehicles), vehicles)


def test_a_player_by_the_yardstick_is_as_good_as_what_it_plays_with():
    """Its alarms are those of the detector, and the models name the thruster at least as well."""
    source = EnvironmentFlights(observed=True)
    found = evaluate(
        as_detector(lambda vehicles: DetectorPlayer(ENVIRONMENT, worlds=vehicles)), source, name="player",
        false_alarms=1e-3, validation=VALIDATION[:50], test=TEST[:100], rates=(),
    )  # fmt: skip
    plain = evaluate(
        sums, EnvironmentFlights(), name="sums", false_alarms=1e-3, validation=VALIDATION[:50],
        test=TEST[:100], rates=(),
    )  # fmt: skip
    assert found.calibration.threshold == 0.0
    assert found.false_alarms.low <= 1e-3
    assert found.missed.value == 0.0
    assert found.median_delay <= plain.median_delay + 5.0
    assert found.isolated.value >= plain.isolated.value


def test_a_player_sees_what_it_declared_as_in_the_environment():
    """Recorded without declarations, shown with them: bit for bit what it saw when it played."""
    env = make(DIAGNOSIS, 3, faults={"probability": 1.0, "kinds": ["loss"]})
    flights = EnvironmentFlights(
        faults=FaultDistribution(kinds=("loss",)), periods=20, observed=True
    )([7, 8, 9], faulty=True)  # fmt: skip
    shown = []

    def erratic(observations):
        shown.append(observations.copy())
        number = np.abs(1e4 * observations[:, 26:28]).astype(int)
        return np.stack([number[:, 0] % 13, number[:, 1] % 6], axis=1)

    observations, _ = env.reset(seed=[7, 8, 9])
    observations, *_ = env.step(np.zeros((3, 2), np.int64))
    seen = []
    for _ in range(19):
        seen.append(observations)
        observations, *_ = env.step(erratic(observations))
    shown.clear()
    detector = PlayerDetector(env, erratic, 3)
    for period in range(19):
        diagnosis = detector.update(**flights.step(slice(None), period))
        np.testing.assert_array_equal(diagnosis.thruster, detector.declared[:, 0])
        np.testing.assert_array_equal(shown[-1], seen[period])
    assert len(np.unique(np.concatenate(seen)[:, 49:61].sum(axis=1))) == 2


def test_a_player_that_alarms_too_often_is_calibrated_to_silence():
    found = evaluate(
        as_detector(lambda _: lambda observations: np.ones((len(observations), 2))),
        EnvironmentFlights(observed=True, periods=30), name="always", false_alarms=0.01,
        validation=VALIDATION[:50], test=TEST[:50], rates=(),
    )  # fmt: skip
    assert found.calibration.threshold == 1.0
    assert found.missed.value == 1.0
    with pytest.raises(ValueError, match=r"observation is None; flights that hold them"):
        as_detector(lambda _: np.zeros)(1).update(np.zeros((1, 12)), np.zeros((1, 6)), 5.0)
    with pytest.raises(NotImplementedError, match="cannot be told"):
        as_detector(lambda _: np.zeros)(1).believe(np.zeros((6, 12)))
