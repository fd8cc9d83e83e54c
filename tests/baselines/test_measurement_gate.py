"""Of what navigation delivers, good and bad, the gate loses nothing; detectors bear what it gives them."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401 - registers the environments
from tests.baselines.test_rate_change import silent_orion
from thruster_baselines.detection import GLRDetector
from thruster_baselines.estimation import MeasurementGate, PhysicalNoise
from thruster_baselines.mapping import delivered_on_times
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.spacecraft import load

ORION = load("orion")
PERIOD = ORION.control_period
AT_REST = np.eye(13)[6]


def flight(seed: int, craft=ORION, faults=(), periods: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """On-times (periods, 12) of a scripted flight, and its measured states (periods + 1, 13)."""
    env = gym.make("thruster_envs/FaultDiagnosis-v1", spacecraft=craft, faults=list(faults))
    observation, _ = env.reset(seed=seed)
    data = env.unwrapped.worlds.state.fleet.data
    on_times, states = [], [data[0, at.MEASURED : at.MEASURED + 13, 0].copy()]
    for _ in range(periods):
        observation, *_ = env.step([0, 0])
        on_times.append(PERIOD * observation[13:25].astype(float))
        states.append(data[0, at.MEASURED : at.MEASURED + 13, 0].copy())
    return np.array(on_times), np.array(states)


def through(gate: MeasurementGate, on_times, states, seed: int, bad: float = 1.0 / 3.0):
    """The intervals that the gate gives when this share of the messages is bad, the four kinds in turn.

    A late message comes one period after it was due, before that period's own; or the last one comes again.
    """
    rng = np.random.default_rng(seed)
    found, held, last = [gate.measured(states[0], 0.0)], None, 0
    for k, fired in enumerate(on_times, start=1):
        gate.fired(fired, PERIOD)
        if held is not None:
            found.append(gate.measured(states[held], PERIOD * held))
            held, last = None, held
        kind = rng.integers(5) if rng.random() < bad else -1
        if kind == 0:
            found.append(gate.measured(None))
        elif kind == 1:
            held = k
        elif kind == 2:
            found.append(gate.measured(np.where(np.arange(13) == rng.integers(13), np.nan, states[k])))
        elif kind == 3:
            found.append(gate.measured(states[k] + 1e3 * (np.arange(13) == 3 + rng.integers(3)), k * PERIOD))
        elif kind == 4:
            found.append(gate.measured(states[last]))  # with no tag of its own
        else:
            found.append(gate.measured(states[k], PERIOD * k))
            last = k
    found.append(gate.measured(states[-1], PERIOD * len(on_times)))
    return [one for one in found if one is not None]


@pytest.mark.parametrize("bad", [0.0, 1.0 / 3.0, 0.6])
def test_nothing_that_was_fired_is_lost_and_it_gives_what_was_measured(bad):
    craft = silent_orion()
    for seed in range(3):
        on_times, states = flight(seed, craft)
        gate = MeasurementGate(craft, longest_gap=20)
        intervals = through(gate, on_times, states, seed, bad)
        effective = delivered_on_times(on_times, craft.feed.coupling)
        total = np.sum([one.on_times for one in intervals], axis=0)
        np.testing.assert_allclose(total, effective.sum(axis=0), rtol=1e-12)
        assert sum(one.duration for one in intervals) == pytest.approx(60 * PERIOD, rel=1e-12)
        assert len(intervals) == 60 if bad == 0.0 else 20 < len(intervals) < 55
        for one in intervals:
            expected = craft.effectiveness() @ one.on_times
            # While the body turns by some degrees, what it fires turns with it.
            np.testing.assert_allclose(one.rate_change, expected, atol=2e-3 * (1.0 + one.duration / PERIOD))


def test_each_reason_is_counted_and_told_in_one_line():
    gate = MeasurementGate(ORION)
    gate.measured(AT_REST, 0.0)
    for _ in range(3):
        gate.fired(np.zeros(12), 5.0)
    told = []
    for message, tag in (
        (None, None),
        (AT_REST + 0.1 * np.eye(13)[0], 7.0),
        (AT_REST + 0.1 * np.eye(13)[0], np.nan),
        (AT_REST, 0.0),
        (AT_REST, 15.0),
        (AT_REST + np.nan * np.eye(13)[11], 5.0),
        (2.0 * AT_REST, 5.0),
        (AT_REST + 5.0 * np.eye(13)[4], 10.0),
    ):
        assert gate.measured(message, tag) is None
        told.append(gate.last_refusal)
    assert gate.refused == {"missing": 1, "late": 4, "not a number": 1, "out of range": 2}
    assert told == [
        "the measurement at 15 s is missing",
        "the measurement is tagged 7 s; 5 or 10 or 15 s would be right",
        "the measurement is tagged nan s; 5 or 10 or 15 s would be right",
        "the measurement is tagged 0 s; 5 or 10 or 15 s would be right",
        "the measurement tagged 15 s is that of 0 s once more; a new one would be right",
        "position x at 5 s is nan; a finite number would be right",  # 0 times nan is nan, too
        "attitude at 5 s has the norm 2; 1 would be right",
        f"the rate change up to 10 s, velocity y, is 5; -{limit(1, 10.0):.4g} to {limit(1, 10.0):.4g} m/s "
        "would be right",
    ]
    assert gate.measured(AT_REST + 1e-3 * np.eye(13)[4], 10.0) is not None
    assert gate.last_refusal == ""


def limit(axis: int, duration: float) -> float:
    """All thrusters at the upper end of their scatter, and eight deviations of two velocities."""
    scatter = np.array([one.scatter for one in ORION.thrusters])
    largest = duration * np.abs(ORION.effectiveness()[axis]) @ (1.0 + scatter)
    return float(largest + 8.0 * np.sqrt(2.0) * ORION.sensors.velocity)


def test_a_late_message_is_used_for_the_intervals_up_to_its_time():
    on_times, states = flight(4, periods=3)
    gate, punctual = MeasurementGate(ORION), MeasurementGate(ORION)
    gate.measured(states[0], 0.0)
    punctual.measured(states[0], 0.0)
    expected = []
    for k in range(3):
        gate.fired(on_times[k], PERIOD)
        punctual.fired(on_times[k], PERIOD)
        expected.append(punctual.measured(states[k + 1]))
    for k in range(3):
        found = gate.measured(states[k + 1], PERIOD * (k + 1))
        np.testing.assert_array_equal(found.rate_change, expected[k].rate_change)
        np.testing.assert_array_equal(found.on_times, expected[k].on_times)
        assert found.duration == PERIOD
    assert gate.measured(states[2], 2 * PERIOD) is None  # an older one is of no use any more
    assert gate.refused["late"] == 1


def test_after_too_long_a_gap_the_next_measurement_begins_anew():
    gate = MeasurementGate(ORION, longest_gap=2)
    gate.measured(AT_REST + 9.0 * np.eye(13)[3], 0.0)  # wrong, but the first one
    for k in range(1, 5):
        gate.fired(np.zeros(12), 5.0)
        state = AT_REST + 1e-4 * k * np.eye(13)[3]
        interval = gate.measured(state, 5.0 * k)
        assert (interval is None) == (k < 4)
    assert gate.refused["out of range"] == 2
    assert interval.duration == 5.0


def test_thrusters_that_fire_one_after_the_other_cost_each_other_nothing():
    gate = MeasurementGate(ORION)
    gate.measured(AT_REST)
    for i in range(2):
        gate.fired(2.0 * np.eye(12)[i], 5.0)
    interval = gate.measured(AT_REST + 1e-3 * np.eye(13)[0])
    np.testing.assert_array_equal(interval.on_times, 2.0 * (np.arange(12) < 2))


def diagnosed(seed: int, bad: float, faults=()) -> list:
    """The diagnoses of a likelihood ratio behind a gate, all through a flight."""
    noise = PhysicalNoise(ORION)
    noise.sensors *= 9.0  # the body turns while it fires, which a larger error of the sensors stands for
    detector = GLRDetector(ORION, 25.0, noise=noise, coupling=0.0, sign_gate=True)
    on_times, states = flight(seed, faults=faults)
    intervals = through(MeasurementGate(ORION), on_times, states, seed, bad)
    found = [detector.update(one.on_times, one.rate_change, one.duration) for one in intervals]
    assert sum(count.sum() for count in detector.refused.values()) == 0
    return found


def test_a_detector_behind_the_gate_is_not_alarmed_by_bad_messages_and_finds_the_dead_thruster():
    named = 0
    for seed in range(12):
        assert not any(one.detected[0] for one in diagnosed(seed, 1.0 / 3.0))
        found = diagnosed(seed, 1.0 / 3.0, [Fault(seed + 1, "stuck_off")])
        first = next(one for one in found if one.detected[0])
        named += int(first.thruster[0] == seed + 1)
    assert named >= 10


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: MeasurementGate(ORION, longest_gap=0), "longest_gap is 0; one interval or more"),
        (lambda: MeasurementGate(ORION).fired(np.zeros(11), 1.0), r"on_times has the shape \(11,\)"),
        (lambda: MeasurementGate(ORION).fired(-np.ones(12), 1.0), "on_times has the entry -1.0"),
        (lambda: MeasurementGate(ORION).fired(np.zeros(12), 0.0), "duration is 0.0"),
        (
            lambda: MeasurementGate(ORION).measured(np.zeros(12)),
            r"measurement has the shape \(12,\); \(13,\)",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(call, line):
    with pytest.raises(ValueError, match=line):
        call()
