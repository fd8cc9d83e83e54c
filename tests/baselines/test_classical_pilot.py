"""The classical pilot finds faults in flight, works around them, and is not fooled by bad measurements."""

from __future__ import annotations

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import norm

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.control import (
    ClassicalPilot,
    DiagnosisSettings,
    FaultAllocation,
    ObservationReader,
    RelativeNavigation,
    ThrusterBelief,
    settings_for,
)
from thruster_baselines.detection.calibration import chi_squared_threshold
from thruster_baselines.guidance import RendezvousPlanner
from thruster_baselines.mapping import AdditiveCompensationMapper, ExactCompensationMapper
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

ORION = load("orion")
STEPS = 571
ENVIRONMENT = "thruster_envs/OrionRendezvous-v1"
HEALTHY = ThrusterBelief.healthy(12)


def fly(pilot, seed, periods=STEPS, spoil=None, **options):
    """The last info of a flight; `spoil` may change what the pilot gets to see."""
    env = gym.make(ENVIRONMENT, **options)
    observation, info = env.reset(seed=seed)
    for period in range(periods):
        seen = observation if spoil is None else spoil(period, observation)
        action = pilot(seen)
        assert env.action_space.contains(action)
        observation, _, over, _, info = env.step(action)
        if over:
            break
    return info


def named(pilot):
    return [(one.thruster, one.kind) for one in pilot.log if one.what == "named"]


# Allocation with faults


@pytest.mark.parametrize("compensation", [ExactCompensationMapper, AdditiveCompensationMapper])
@pytest.mark.parametrize("thruster", range(1, 13))
def test_the_others_hold_against_any_one_that_is_stuck_on(thruster, compensation):
    allocation = FaultAllocation(ORION, compensation)
    belief = HEALTHY.changed(thruster, share=1.0, stuck_on=True)
    on_times = allocation(np.zeros(6), belief)
    assert on_times[thruster - 1] == 0.0
    assert on_times.max() <= ORION.control_period
    left = allocation.rate_change(on_times, belief)
    assert np.abs(left[:3]).max() < 2e-5  # of 0.012 m/s
    assert np.abs(left[3:]).max() < 2e-4  # of 0.18 rad/s


def test_with_one_stuck_on_commands_are_still_met():
    allocation = FaultAllocation(ORION)
    belief = HEALTHY.changed(5, share=1.0, stuck_on=True)
    rng = np.random.default_rng(1)
    for _ in range(20):
        command = rng.normal(size=6) * np.repeat([1e-3, 1e-2], 3)
        achieved = allocation.rate_change(allocation(command, belief), belief)
        np.testing.assert_allclose(achieved, command, atol=2e-4)


def test_without_faults_it_is_the_compensating_mapper():
    command = [-0.02, -0.02, 0.0, 0.0, 0.0, 0.0]
    own = FaultAllocation(ORION)(command, HEALTHY)
    np.testing.assert_allclose(own, ExactCompensationMapper(ORION)(command).on_times, atol=1e-12)


def test_a_dead_thruster_is_not_fired_and_a_weak_one_fires_longer():
    allocation = FaultAllocation(ORION)
    command = [-0.01, 0.0, 0.0, 0.0, 0.0, 0.0]
    healthy = allocation(command, HEALTHY)
    dead = allocation(command, HEALTHY.changed(1, share=0.0, stuck_on=False))
    belief = HEALTHY.changed(1, share=0.5, stuck_on=False)
    weak = allocation(command, belief)
    assert healthy[0] > 1.0
    assert dead[0] == 0.0
    assert weak[0] > 1.5 * healthy[0]
    np.testing.assert_allclose(allocation.rate_change(weak, belief), command, atol=1e-9)


def test_a_plan_reckons_with_what_fires_anyway():
    least = np.zeros(12)
    least[0] = 4.1
    planner = RendezvousPlanner(ORION, detailed_steps=40, delta_v_cost=5000.0)
    plan = planner([100.0, 0.0, 0.0, 0.0, 0.0, 0.0], 300, max_on_time=np.full(12, 4.1), min_on_time=least)
    np.testing.assert_allclose(plan.on_times[:, 0], 4.1)
    np.testing.assert_allclose(plan.rate_changes[:, 3:], 0.0, atol=1e-9)
    np.testing.assert_allclose(plan.miss, 0.0, atol=1e-3)
    assert np.abs(plan.states[:, :3]).max() < 120.0  # it is not carried away
    with pytest.raises(ValueError, match="min_on_time is"):
        planner([100.0, 0.0, 0.0, 0.0, 0.0, 0.0], 300, max_on_time=np.full(12, 4.0), min_on_time=least)


# Diagnosis in flight


@pytest.mark.parametrize(
    ("thruster", "kind", "severity"), [(6, "stuck_off", 1.0), (6, "loss", 0.5), (12, "stuck_off", 1.0)]
)
def test_what_fails_in_a_burn_is_named_in_the_next_period(thruster, kind, severity):
    pilot = ClassicalPilot(ORION, STEPS)
    fault = {"thruster": thruster, "kind": kind, "severity": severity, "onset": 25.0}
    fly(pilot, VALIDATION[0], 12, faults=[fault])
    assert named(pilot) == [(thruster, kind)]
    first = next(one for one in pilot.log if one.what == "named")
    assert first.time == 30.0  # at the end of the period in which it began
    # thrust scatters by 10 %, and two more periods have told more
    assert pilot.belief.share[thruster - 1] == pytest.approx(1.0 - severity, abs=0.12)
    assert (np.delete(pilot.belief.share, thruster - 1) == 1.0).all()


@pytest.mark.parametrize("thruster", [2, 7])
def test_a_valve_stuck_open_while_coasting_is_named_and_held_against(thruster):
    pilot = ClassicalPilot(ORION, STEPS)
    fault = {"thruster": thruster, "kind": "stuck_on", "onset": 402.0}
    fly(pilot, VALIDATION[1], 110, faults=[fault])
    assert named(pilot) == [(thruster, "stuck_on")]
    assert next(one.time for one in pilot.log if one.what == "named") == 405.0
    assert np.linalg.norm(pilot.navigation.relative_rate) < 0.15  # unopposed: 0.3 rad/s more every period
    assert pilot.belief.stuck_on.nonzero()[0].tolist() == [thruster - 1]


def test_how_far_a_stuck_valve_is_open_is_learned_as_far_as_the_pilot_doubts_it():
    """It is named as open all the way; four fifths of that are too much to raise another alarm."""
    fault = {"thruster": 2, "kind": "stuck_on", "onset": 400.0, "severity": 0.8}

    def levels(deviation):
        pilot = ClassicalPilot(ORION, STEPS, diagnosis=DiagnosisSettings(open_deviation=deviation))
        fly(pilot, VALIDATION[1], 90, faults=[fault])
        assert named(pilot) == [(2, "stuck_on")]
        return [one.level for one in pilot.log if one.what in ("named", "refined")]

    assert levels(0.0) == [1.0]
    first, *later = levels(0.1)
    assert first == 1.0
    assert later == sorted(later, reverse=True)  # of a prior of 1, each measurement takes some more
    assert later[-1] == pytest.approx(0.8, abs=0.05)


def test_a_thruster_that_nobody_needs_is_found_dead_by_firing_it_for_a_moment():
    fault = {"thruster": 10, "kind": "stuck_off", "onset": 300.0}
    asking, waiting = (
        ClassicalPilot(ORION, STEPS, diagnosis=DiagnosisSettings(probe_pulse=pulse)) for pulse in (0.3, 0.0)
    )
    for pilot in (asking, waiting):
        fly(pilot, VALIDATION[4], 260, faults=[fault])
    assert named(asking) == [(10, "stuck_off")]
    assert named(waiting) == []


def test_it_arrives_with_a_dead_thruster_and_forgets_that_in_the_next_episode():
    pilot = ClassicalPilot(ORION, STEPS)
    info = fly(pilot, VALIDATION[2], faults=[{"thruster": 6, "kind": "stuck_off", "onset": 40.0}])
    assert info["success"]
    assert named(pilot) == [(6, "stuck_off")]
    fly(pilot, VALIDATION[2], 1)
    assert [(one.what, one.kind) for one in pilot.log] == [("planned", "at the start")]
    assert (pilot.belief.share == 1.0).all()


def test_healthy_it_names_nobody_and_arrives_with_method_2():
    pilot = ClassicalPilot(ORION, STEPS, compensation=AdditiveCompensationMapper)
    assert fly(pilot, VALIDATION[3])["success"]
    assert {one.what for one in pilot.log} <= {"planned", "tested", "suspected", "cleared"}
    assert len([one for one in pilot.log if one.what == "planned"]) == pilot.controller.plans


def test_told_it_believes_and_says_so():
    pilot = ClassicalPilot(ORION, STEPS, diagnosis=None)
    env = gym.make(ENVIRONMENT)
    pilot(env.reset(seed=0)[0])
    pilot.tell(HEALTHY.changed(3, share=0.0, stuck_on=False))
    assert [(one.what, one.thruster, one.kind) for one in pilot.log] == [
        ("planned", 0, "at the start"),
        ("told", 3, "stuck_off"),
    ]
    assert not pilot.controller.navigation.effectiveness[:, 2].any()
    assert not pilot.detector.filter.effectiveness[0, :, 2].any()
    with pytest.raises(dataclasses.FrozenInstanceError):
        pilot.log[0].time = 1.0


def test_the_log_has_every_decision_and_reads_as_lines():
    """A valve sticks open: it is named, held against, and planned for at once; so is what follows."""
    pilot = ClassicalPilot(ORION, STEPS)
    fly(pilot, VALIDATION[1], 110, faults=[{"thruster": 2, "kind": "stuck_on", "onset": 402.0}])
    at_once = [one for one in pilot.log if one.time == 405.0]
    assert [(one.what, one.thruster) for one in at_once] == [
        ("named", 2),
        ("held against", 2),
        ("started anew", 0),  # three seconds of thrust without command are beyond what navigation expects
        ("planned", 0),
    ]
    assert at_once[-1].kind == "with another belief"
    assert at_once[0].statistic > pilot.detector.threshold
    assert str(at_once[1]) == "   405.0 s  held against: thruster 2, stuck_on, 100 % of its thrust"
    assert all("nan" not in str(one) for one in pilot.log)
    assert [one.time for one in pilot.log] == sorted(one.time for one in pilot.log)


def test_the_threshold_follows_from_the_rate_of_false_alarms_unless_one_is_given():
    twelve = norm.isf(0.5 * 1e-3 / 12.0) ** 2  # chi-squared, one degree of freedom, one test per thruster
    stated = ClassicalPilot(ORION, STEPS, diagnosis=DiagnosisSettings(false_alarm_rate=1e-3))
    assert stated.detector.threshold == pytest.approx(twelve)
    given = ClassicalPilot(ORION, STEPS, diagnosis=DiagnosisSettings(threshold=25.0))
    assert given.detector.threshold == 25.0


def test_healthy_flights_exceed_a_stated_rate_no_more_often_than_stated():
    """At one in 200 intervals, so that four flights show it; half of that is seen while nothing fires."""
    rate, statistics = 0.005, []
    pilot = ClassicalPilot(ORION, STEPS, diagnosis=DiagnosisSettings(threshold=1e9))
    for seed in VALIDATION[:4]:
        fly(pilot, seed)
        statistics += pilot.statistics
    threshold = chi_squared_threshold(rate, tests=12)
    exceeded = sum(one > threshold for one in statistics)
    low, high = clopper_pearson(exceeded, len(statistics))
    assert len(statistics) == 4 * (STEPS - 1)
    assert low <= 0.5 * rate <= high < 2.0 * rate


def test_it_flies_in_periods_of_one_second():
    spacecraft = dataclasses.replace(ORION, control_period=1.0)
    steps = 2856
    settings = settings_for(spacecraft)
    assert (settings.replan_burning, settings.settling) == (20, 40)
    pilot = ClassicalPilot(spacecraft, steps)
    fault = {"thruster": 6, "kind": "stuck_off", "onset": 20.0}
    fly(pilot, VALIDATION[5], 60, spacecraft=spacecraft, faults=[fault])
    assert named(pilot)[-1] == (6, "stuck_off")
    assert next(one.time for one in pilot.log if one.what == "named") <= 23.0


# Bad input


def test_a_third_of_all_measurements_bad_names_nobody_and_still_arrives():
    rng, old = np.random.default_rng(6), {}

    def spoil(period, observation):
        seen = observation.copy()
        kind = rng.integers(9) if period > 0 else 9
        if kind == 0:
            seen[rng.integers(13)] = np.nan
        elif kind == 1:
            seen = old["last"]  # late: that of the period before
        elif kind == 2:
            seen[rng.integers(12)] = rng.choice([-1.0, 1.0]) * 1e3
        old["last"] = observation.copy()
        return seen

    pilot = ClassicalPilot(ORION, STEPS)
    info = fly(pilot, VALIDATION[6], spoil=spoil)
    assert named(pilot) == []
    assert 130 < pilot.refused < 250
    assert {one.kind for one in pilot.log if one.what == "refused"} == {"missing", "late", "out of range"}
    assert info["success"]


def test_a_fault_is_found_across_a_gap_in_the_measurements():
    def spoil(period, observation):
        return np.full_like(observation, np.nan) if period == 7 else observation

    pilot = ClassicalPilot(ORION, STEPS)
    fault = {"thruster": 12, "kind": "loss", "severity": 0.5, "onset": 30.0}
    fly(pilot, VALIDATION[0], 12, spoil, faults=[fault])
    assert named(pilot)[0] == (12, "loss")
    assert pilot.refused == 1


def test_the_reader_says_what_is_wrong_and_recovers_a_rate_beyond_its_range():
    env = gym.make(ENVIRONMENT)
    first, _ = env.reset(seed=3)
    second = env.step(env.action_space.low)[0]
    reader = ObservationReader(ORION, STEPS)
    start = reader.read(first)
    np.testing.assert_allclose(start.position, 300.0 * first[:3])
    assert reader.read(first) is None
    assert (reader.step, reader.fault) == (1, "late")
    reader.read(first * np.float32(1.0))  # the same again
    assert (reader.step, reader.fault) == (2, "late")
    reader = ObservationReader(ORION, STEPS)
    before = reader.read(first).rate
    clipped = second.copy()
    clipped[9] = 5.0
    clipped[28] = (5.6 * 0.05 - before[0]) / ORION.authority()[3]  # measured change of rate
    np.testing.assert_allclose(reader.read(clipped).rate[0], 5.6 * 0.05, rtol=1e-3)
    with pytest.raises(ValueError, match=r"observation has the shape \(3,\)"):
        reader.read(first[:3])


@pytest.mark.parametrize("steps", [STEPS - 1, STEPS + 1, STEPS // 2, 2 * STEPS])
def test_a_pilot_made_for_episodes_of_other_length_says_so_at_once(steps):
    with pytest.raises(ValueError, match=f"steps is {steps}; {STEPS}, as the time to go"):
        fly(ClassicalPilot("orion", steps), VALIDATION[0], 2)


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: DiagnosisSettings(false_alarm_rate=2.0), "false_alarm_rate is 2.0; a rate above 0"),
        (lambda: DiagnosisSettings(drift=float("nan")), "drift is nan; a finite number of 0 or more"),
        (lambda: DiagnosisSettings(dead_level=0.95), "dead_level is 0.95 and healthy_level 0.93; shares"),
        (lambda: DiagnosisSettings(pointing=(0.02, -0.2)), r"pointing is \(0.02, -0.2\); two finite numbers"),
        (lambda: DiagnosisSettings(longest_gap=0), "longest_gap is 0; one or more would be right"),
        (lambda: ClassicalPilot(ORION, 0), "steps is 0; a whole number from 1 up would be right"),
        (lambda: ClassicalPilot(ORION, 2.5), "steps is 2.5; a whole number from 1 up would be right"),
        (lambda: ClassicalPilot(ORION, True), "steps is True; a whole number"),
        (lambda: ClassicalPilot(ORION, 9, compensation="II"), "compensation is 'II'; the class ExactComp"),
        (lambda: ClassicalPilot(ORION, 9, compensation=object), "compensation is <class 'object'>; the"),
        (lambda: ClassicalPilot(ORION, STEPS)(np.zeros(3)), r"observation has the shape \(3,\); \(37,\)"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()


def test_without_a_measurement_navigation_predicts_and_knows_less():
    navigation = RelativeNavigation(ORION)
    attitude = np.array([1.0, 0.0, 0.0, 0.0])
    at_rest = np.array([0.0, 0.0, ORION.mean_motion])
    navigation.predict(np.zeros(12))  # knows nothing yet, and goes on knowing nothing
    assert not navigation.covariance.any()
    navigation.update(np.zeros(12), np.array([10.0, 0, 0]), np.array([0.1, 0, 0]), attitude, at_rest)
    known = np.trace(navigation.covariance)
    navigation.predict(np.zeros(12))
    assert navigation.position[0] == pytest.approx(10.5, abs=0.01)
    assert np.trace(navigation.covariance) > known


# Read from the environment


def test_the_pilot_reads_its_environment():
    env = gym.make(ENVIRONMENT, start=(4.0, 0.0, 0.0), position_tolerance=0.1)
    pilot, usual = ClassicalPilot.of(env), ClassicalPilot(ORION, STEPS)
    assert pilot.steps == env.unwrapped.task.steps
    assert pilot.spacecraft == env.unwrapped.task.vehicle
    box = pilot.controller.settings, usual.controller.settings
    assert box[0].position_tolerance == pytest.approx(box[1].position_tolerance * 0.1 / 2.0)
    assert box[0].velocity_tolerance == box[1].velocity_tolerance
    assert ClassicalPilot(gym.make(ENVIRONMENT)).controller.settings == usual.controller.settings


def test_from_near_it_arrives_in_a_small_box():
    """From 4 m, in a box of 0.1 m."""
    start = {"start": (4.0, 0.0, 0.0), "position_tolerance": 0.1}
    assert fly(ClassicalPilot.of(gym.make(ENVIRONMENT, **start)), VALIDATION[0], **start)["success"]


def test_a_minimum_pulse_gives_no_false_suspicion():
    """Commands below it open no valve, and the pilot neither gives nor expects them."""
    craft = ORION.replace(
        thrusters=tuple(dataclasses.replace(one, minimum_pulse=0.1) for one in ORION.thrusters)
    )
    env = gym.make(ENVIRONMENT, spacecraft=craft)
    pilot = ClassicalPilot.of(env)
    assert fly(pilot, VALIDATION[0], spacecraft=craft)["success"]
    assert not [one for one in pilot.log if one.what in ("suspected", "named")]


def test_wrong_combinations_say_what_to_set():
    with pytest.raises(
        ValueError, match=r"steps must be given with a spacecraft, got None; ClassicalPilot\.of"
    ):
        ClassicalPilot(ORION)
    with pytest.raises(ValueError, match="environment must be one of OrionRendezvous, got FaultDiagnosis"):
        ClassicalPilot.of(gym.make("thruster_envs/FaultDiagnosis-v1"))
    with pytest.raises(ValueError, match="steps must be those of the environment, 571, or None, got 9"):
        ClassicalPilot(gym.make(ENVIRONMENT), 9)
