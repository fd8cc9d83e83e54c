"""The yardstick measures what it says; flights to measure on deliver what a faulty vehicle delivers."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from tests.physics.flying import fly
from thruster_baselines.detection import (
    CUSUMDetector,
    EstimatorThreshold,
    FilterBank,
    Flights,
    GenericChiSquared,
    GLRDetector,
    Identification,
    ModelComparison,
    RandomFlights,
    SetChiSquared,
    SingleChiSquared,
    WindowedGLR,
    by_model_comparison,
    evaluate,
    table,
)
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.mapping.coupling import delivered_on_times
from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.protocols import Diagnosis
from thruster_envs.seeds import TEST, VALIDATION
from thruster_envs.spacecraft import Sensors, Spacecraft, load

ORION = load("orion")
NOMINAL = ORION.effectiveness()


def without_errors(spacecraft: Spacecraft) -> Spacecraft:
    """A vehicle that measures exactly and whose thrust does not scatter."""
    exact = [one.__class__(**(vars(one) | {"scatter": 0.0})) for one in spacecraft.thrusters]
    return spacecraft.replace(sensors=Sensors(), thrusters=exact)


EXACT = without_errors(ORION)


def fails(kind: str, severity: float | None = None, onset: float = 5.0, **more) -> FaultDistribution:
    ranges = {} if severity is None else {kind: (severity, severity)}
    return FaultDistribution(kinds=(kind,), severity=ranges, onset=(onset, onset), **more)


# Flights


def test_healthy_flights_give_what_the_shared_feed_delivers():
    flights = RandomFlights(spacecraft=EXACT, intervals=8, duration=2.0)(range(5), faulty=False)
    expected = delivered_on_times(flights.on_times, ORION.feed.coupling) @ NOMINAL.T
    np.testing.assert_allclose(flights.rate_change, expected, rtol=0, atol=1e-15)
    assert flights.kind == ("none",) * 5
    assert (flights.thruster == 0).all()
    assert np.isinf(flights.onset).all()


def shut(u, i, size):
    u[..., i] = 0.0
    return delivered_on_times(u, ORION.feed.coupling)


def open_all_the_time(u, i, size):
    u[..., i] = 2.0
    return delivered_on_times(u, ORION.feed.coupling)


def weaker(u, i, size):
    delivered = delivered_on_times(u, ORION.feed.coupling)
    delivered[..., i] *= 1.0 - size
    return delivered


@pytest.mark.parametrize(
    ("kind", "size", "delivered"),
    [
        ("stuck_off", 1.0, shut),
        ("stuck_on", 1.0, open_all_the_time),
        ("loss", 0.4, weaker),
        ("loss", 1.0, weaker),
        ("leak", 1.0, open_all_the_time),
    ],
)
def test_a_fault_changes_what_is_delivered_from_its_onset_on(kind, size, delivered):
    source = RandomFlights(spacecraft=EXACT, faults=fails(kind, size, onset=6.0), intervals=8, duration=2.0)
    flights = source(range(20), faulty=True)
    assert set(flights.kind) == {kind}
    assert (flights.severity == size).all()
    assert (flights.onset == 6.0).all()
    assert len(set(flights.thruster)) > 3
    for flight in range(20):
        u = flights.on_times[flight].copy()
        expected = delivered_on_times(u, ORION.feed.coupling)
        expected[3:] = delivered(u[3:], flights.thruster[flight] - 1, size)
        np.testing.assert_allclose(flights.rate_change[flight], expected @ NOMINAL.T, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    "kind", ["stuck_off", "stuck_on", "loss", "leak", "late_opening", "intermittent", "sign", "bias"]
)
def test_what_is_delivered_is_what_the_environments_deliver(kind):
    """The compiled flight of the environments, with the same commands and the same fault of any size."""
    faults = FaultDistribution(
        kinds=(kind,), severity={kind: (0.2, 1.0)}, onset=(5.0, 5.0), profile_time=(20.0, 20.0)
    )
    source = RandomFlights(spacecraft=EXACT, faults=faults, intervals=6, duration=5.0, open_share=0.5)
    flights = source(range(5), faulty=True)
    for flight in range(5):
        fault = Fault(
            int(flights.thruster[flight]), kind, severity=float(flights.severity[flight]), onset=5.0
        )
        flown = fly(EXACT, flights.on_times[flight] / 5.0, faults=[fault])
        expected = flown.delivered @ NOMINAL.T
        np.testing.assert_allclose(flights.rate_change[flight], expected, rtol=0, atol=1e-12)


def test_a_partly_open_valve_takes_its_share_of_the_feed():
    """One thruster leaks a quarter while another fires: each loses 6 % of what the other lets through."""
    source = RandomFlights(
        spacecraft=EXACT, faults=fails("leak", 0.25, onset=0.0, thrusters=(1,)), intervals=400, open_share=0.1
    )
    flights = source([3], faulty=True)
    u = flights.on_times[0]
    alone = (u[:, 3] > 0.0) & (np.delete(u, 3, axis=1) == 0.0).all(axis=1)
    assert alone.any()
    time = u[alone, 3]
    leaking = 0.25 * (time * (1.0 - 0.06) + 1.0 - time)
    firing = time * (1.0 - 0.25 * 0.06)
    expected = np.outer(leaking, NOMINAL[:, 0]) + np.outer(firing, NOMINAL[:, 3])
    np.testing.assert_allclose(flights.rate_change[0, alone], expected, rtol=0, atol=1e-15)


def test_errors_of_consecutive_rate_changes_share_a_velocity():
    flights = RandomFlights(spacecraft=ORION, intervals=400, open_share=0.0)(range(50), faulty=False)
    errors = flights.rate_change / 0.5e-3
    count = errors.size
    assert errors.var() == pytest.approx(2.0, rel=10.0 / np.sqrt(count))
    lag = (errors[:, 1:] * errors[:, :-1]).mean() / errors.var()
    assert lag == pytest.approx(-0.5, abs=10.0 / np.sqrt(count))


def test_a_flight_is_a_function_of_its_seed_alone():
    source = RandomFlights(spacecraft=ORION, intervals=5, bad_measurements=0.3)
    together, alone = source(range(7, 12), faulty=True), source([9], faulty=True)
    for name in ("on_times", "rate_change", "valid", "thruster", "severity", "onset"):
        np.testing.assert_array_equal(getattr(together, name)[2:3], getattr(alone, name))
    healthy = source([9], faulty=False)
    np.testing.assert_array_equal(healthy.on_times, alone.on_times)


def test_bad_measurements_are_of_four_kinds_and_as_many_as_stated():
    flights = RandomFlights(spacecraft=ORION, intervals=100, bad_measurements=0.4)(range(200), faulty=False)
    finite = np.isfinite(flights.rate_change).all(axis=2)
    far = finite & (np.abs(flights.rate_change) > 10.0 * ORION.authority(1.0)).any(axis=2)
    for bad in (~flights.valid, ~finite, far, flights.age > 0.0):
        assert bad.mean() == pytest.approx(0.1, abs=5.0 * math.sqrt(0.1 * 0.9 / 20_000))


def test_a_late_measurement_is_that_of_the_interval_before_and_says_so():
    good = RandomFlights(spacecraft=ORION, intervals=100)(range(20), faulty=False)
    flights = RandomFlights(spacecraft=ORION, intervals=100, bad_measurements=0.4)(range(20), faulty=False)
    late = flights.age > 0.0
    before = np.concatenate([np.zeros((20, 1, 6)), good.rate_change[:, :-1]], axis=1)
    np.testing.assert_array_equal(flights.rate_change[late], before[late])
    assert set(flights.age[late]) == {1.0}
    assert flights.valid[late].all()
    sound = flights.valid & ~late & (flights.rate_change == good.rate_change).all(axis=2)
    assert sound.mean() == pytest.approx(0.6, abs=5.0 * math.sqrt(0.6 * 0.4 / 2000))


# The yardstick


def glr(threshold: float = 0.0, spacecraft: Spacecraft = ORION):
    noise = PhysicalNoise(ORION)
    return lambda vehicles: GLRDetector(spacecraft, threshold, noise=noise, vehicles=vehicles)


class BlindToRoundOff(GLRDetector):
    """As the likelihood ratio, but what round-off leaves counts as nothing."""

    def _diagnose(self, interval):
        interval.residual[np.abs(interval.residual) < 1e-12] = 0.0
        return super()._diagnose(interval)


def test_without_errors_a_dead_thruster_is_found_when_it_is_first_fired():
    """Delays, misses and names, worked out from the commands of the flights."""
    source = RandomFlights(
        spacecraft=EXACT, faults=fails("stuck_off", onset=20.0), intervals=40, open_share=0.2
    )
    seeds = TEST[:300]
    found = evaluate(
        lambda vehicles: BlindToRoundOff(ORION, 0.0, noise=PhysicalNoise(ORION), vehicles=vehicles),
        source, name="exact", false_alarms=0.01, validation=VALIDATION[:300], test=seeds, rates=(0.01,),
    )  # fmt: skip
    flights = source(seeds, faulty=True)
    fired = flights.on_times[np.arange(300), :, flights.thruster - 1] > 0.0
    fired[:, :20] = False
    seen = fired.any(axis=1)
    delays = np.where(seen, fired.argmax(axis=1) + 1.0 - 20.0, np.inf)
    ordered = np.sort(delays)
    assert (found.median_delay, found.delay_90) == (ordered[149], ordered[269])
    assert 1.0 < found.median_delay < found.delay_90 < np.inf
    assert (found.missed.successes, found.missed.trials) == ((~seen).sum(), 300)
    assert found.missed.successes > 0
    assert (found.false_alarms.successes, found.false_alarms.trials) == (0, 300 * 40)
    assert found.hours_between_false_alarms[0] == math.inf
    assert found.isolated.value > 0.97  # the fired near-twin of a dead thruster takes the rest
    matrix = np.array(found.confusion)
    assert matrix[0, 0] == 300
    np.testing.assert_array_equal(matrix[1:].sum(axis=1), np.bincount(flights.thruster, minlength=13)[1:])
    assert matrix[1:, 0].sum() == found.missed.successes
    assert matrix[1:, 1:13].trace() == found.isolated.successes
    assert found.by_kind["stuck_off"] == (found.missed, found.median_delay)
    assert found.flights == 300
    assert found.curve[0].median_delay == found.median_delay
    assert found.curve[0].missed == pytest.approx(found.missed.value, abs=1e-12)


class Coin:
    """A detector that alarms at random with a known probability per interval, and names thruster 1."""

    def __init__(self, vehicles: int, seed: int) -> None:
        self.threshold, self.rng, self.vehicles = 0.0, np.random.default_rng(seed), vehicles
        self.resets = 0

    def update(self, on_times, rate_change, duration, *, valid=None, age=None):
        statistic = self.rng.random(self.vehicles)
        detected = statistic > self.threshold
        zeros = np.zeros((self.vehicles, 12))
        return Diagnosis(detected, detected.astype(np.int64), statistic, zeros[:, 0], zeros, zeros)

    def reset(self, vehicles=None):
        self.resets += vehicles is not None

    def believe(self, effectiveness, vehicles=None):
        raise NotImplementedError


def test_a_coin_is_measured_as_a_coin():
    """Alarms at p per interval: p / duration per s, geometric delays, one name in twelve right."""
    made = []

    def make(vehicles):
        made.append(Coin(vehicles, len(made)))
        return made[-1]

    source = RandomFlights(
        spacecraft=EXACT, faults=fails("stuck_off", onset=40.0), intervals=80, duration=2.0
    )
    found = evaluate(
        make, source, name="coin", false_alarms=0.05, validation=VALIDATION[:500], test=TEST[:500],
        rates=(0.05,),
    )  # fmt: skip
    rate = 1.0 - found.calibration.threshold  # of a uniform statistic
    assert 0.02 < rate < 0.05
    low, high = found.false_alarms.low, found.false_alarms.high
    assert low < rate < high
    assert found.false_alarms_per_hour[0] == pytest.approx(1800.0 * found.false_alarms.value, rel=1e-12)
    assert found.hours_between_false_alarms[1] == pytest.approx(1.0 / (1800.0 * high), rel=1e-12)
    geometric = 2.0 * math.ceil(math.log(0.5) / math.log1p(-rate))
    assert found.median_delay == pytest.approx(geometric, rel=0.35)
    assert 0.0 <= found.missed.value < 5.0 * (1.0 - rate) ** 60 + 0.02
    assert found.isolated.low < 1.0 / 12.0 < found.isolated.high
    matrix = np.array(found.confusion)
    assert (matrix[:, 2:] == 0).all()
    assert sum(one.resets for one in made) >= 90  # a false alarm is followed by a reset


def test_a_detector_that_sleeps_is_infinitely_late(tmp_path):
    class Asleep(Coin):
        def update(self, on_times, rate_change, duration, *, valid=None, age=None):
            zeros = np.zeros((self.vehicles, 12))
            nothing = zeros[:, 0]
            return Diagnosis(nothing > 0.0, nothing.astype(np.int64), nothing, nothing, zeros, zeros)

    source = RandomFlights(spacecraft=EXACT, intervals=20)
    found = evaluate(
        lambda vehicles: Asleep(vehicles, 0), source, name="asleep", false_alarms=0.05,
        validation=VALIDATION[:100], test=TEST[:100],
    )  # fmt: skip
    assert found.missed.value == 1.0
    assert found.median_delay == math.inf
    assert found.isolated.trials == 0
    plain = json.loads(found.to_json())
    assert plain["median_delay"] is None
    assert plain["isolated"]["value"] is None
    assert plain["missed"] == {
        "value": 1.0, "low": found.missed.low, "high": 1.0, "successes": 100, "trials": 100,
    }  # fmt: skip
    assert "| missed | missed | 100.0 %" in table([found])
    found.figure(tmp_path / "asleep.png")  # with nothing on its curve


@pytest.mark.parametrize(("alarm", "missed", "delay"), [(5, 1.0, math.inf), (6, 0.0, 1.0)])
def test_an_alarm_at_the_end_of_the_last_sound_interval_is_false(alarm, missed, delay):
    class Once(Coin):
        intervals = 0

        def update(self, on_times, rate_change, duration, *, valid=None, age=None):
            self.intervals += 1
            zeros = np.zeros((self.vehicles, 12))
            now = np.full(self.vehicles, self.intervals == alarm)
            return Diagnosis(now, now.astype(np.int64), now.astype(float), zeros[:, 0], zeros, zeros)

    source = RandomFlights(spacecraft=EXACT, faults=fails("stuck_off", onset=5.0), intervals=20)
    found = evaluate(
        lambda vehicles: Once(vehicles, 0), source, name="once", false_alarms=0.2,
        validation=VALIDATION[:50], test=TEST[:50],
    )  # fmt: skip
    assert (found.missed.value, found.median_delay) == (missed, delay)


def test_thresholds_are_set_on_validation_and_reported_on_test():
    asked = []

    def source(seeds, faulty) -> Flights:
        asked.append((seeds, faulty))
        return RandomFlights(spacecraft=ORION, intervals=20)(seeds, faulty)

    validation, test = VALIDATION[:200], TEST[:50]
    found = evaluate(glr(), source, name="glr", false_alarms=0.01, validation=validation, test=test)
    assert asked == [(validation, False), (test, False), (test, True)]
    assert found.calibration.samples == 200
    with pytest.raises(ValueError, match=f"seed {TEST[10]} is in validation and in test; disjoint sets"):
        evaluate(glr(), source, name="glr", false_alarms=0.01, validation=TEST[10:300], test=TEST[:50])
    with pytest.raises(ValueError, match="200 flights of 20 intervals cannot show a rate of 1e-06"):
        evaluate(glr(), source, name="glr", false_alarms=1e-6, validation=validation, test=test)


def with_sensors(kind, **settings):
    return lambda vehicles: kind(ORION, 1.0, noise=PhysicalNoise(ORION), vehicles=vehicles, **settings)


@pytest.mark.parametrize(
    ("make", "missed", "isolated"),
    [
        (lambda vehicles: EstimatorThreshold(ORION, 0.4, vehicles=vehicles), 0.2, 0.8),
        (with_sensors(GenericChiSquared), 0.02, None),
        (with_sensors(SingleChiSquared), 0.02, None),
        (with_sensors(SetChiSquared), 0.02, None),
        (glr(), 0.02, 0.8),
        (lambda vehicles: GLRDetector.yang2003(ORION, 0.0, vehicles=vehicles), 0.02, 0.8),
        (with_sensors(GLRDetector, sign_gate=True), 0.02, 0.8),
        (with_sensors(WindowedGLR), 0.02, 0.8),
        (with_sensors(CUSUMDetector), 0.02, 0.8),
        (with_sensors(FilterBank), 0.02, 0.8),
    ],
    ids=[
        "estimator", "generic", "single", "set", "glr", "glr of the source", "glr gated", "windowed", "cusum",
        "bank",
    ],
)  # fmt: skip
def test_a_third_of_bad_measurements_raises_no_more_false_alarms_than_calibrated(make, missed, isolated):
    """Calibrated on good measurements only, flown with bad ones of all four kinds; dead thrusters."""
    good = RandomFlights(spacecraft=ORION, intervals=40)
    bad = RandomFlights(spacecraft=ORION, intervals=40, bad_measurements=1.0 / 3.0)

    def source(seeds, faulty) -> Flights:
        return (good if seeds[0] in VALIDATION else bad)(seeds, faulty)

    found = evaluate(
        make, source, name="bad input", false_alarms=1e-3, validation=VALIDATION[:300], test=TEST[:300],
        rates=(),
    )  # fmt: skip
    assert found.false_alarms.low <= 1e-3
    assert found.missed.value <= missed
    if isolated is None:  # they name nobody, or as good as
        assert found.isolated.value < 0.5
    else:
        assert found.isolated.value >= isolated


def test_late_measurements_that_do_not_say_so_look_like_faults():
    """Why they have to have an age: the same flights without it."""
    late = RandomFlights(spacecraft=ORION, intervals=40, bad_measurements=0.1)

    def source(seeds, faulty) -> Flights:
        flights = late(seeds, faulty)
        return flights if seeds[0] in VALIDATION else dataclasses.replace(flights, age=None)

    found = evaluate(
        glr(), source, name="no age", false_alarms=1e-3, validation=VALIDATION[:300], test=TEST[:100],
        rates=(),
    )  # fmt: skip
    assert found.false_alarms.low > 10e-3


def test_what_is_identified_is_compared_with_the_truth():
    """A perfect identifier, one that always says off, and the model comparison in between."""
    faults = FaultDistribution(
        kinds=("stuck_off", "loss", "stuck_on"), severity={"loss": (0.5, 0.7)}, onset=(5.0, 5.0)
    )
    source = RandomFlights(spacecraft=ORION, faults=faults, intervals=25)
    flights = source(TEST[:200], faulty=True)

    def run(identify):
        return evaluate(
            glr(), source, name="glr", false_alarms=1e-3, validation=VALIDATION[:300], test=TEST[:200],
            identify=identify, rates=(),
        )  # fmt: skip

    def perfect(detector, thruster):
        return Identification(flights.kind, flights.severity.copy(), np.zeros((200, 1)))

    def always_off(detector, thruster):
        return Identification(("stuck_off",) * 200, np.ones(200), np.zeros((200, 1)))

    best, worst = run(perfect), run(always_off)
    assert (best.identified.value, best.severity_error) == (1.0, 0.0)
    off = sum(kind == "stuck_off" for kind in flights.kind) / 200
    assert abs(worst.identified.value - off) < 0.1
    assert worst.severity_error is None  # there is only one way of being off
    compared = run(by_model_comparison(ModelComparison(ORION)))
    assert worst.identified.value < compared.identified.value < 1.0
    assert compared.identified.value > 0.9
    # a loss of 0.5 to 0.7 found by the nearest of four levels is off by 0.05 on the average
    assert 0.0 < compared.severity_error < 0.05
    assert run(None).identified is None


def test_identification_needs_a_detector_that_keeps_its_interval():
    identify = by_model_comparison(ModelComparison(ORION))
    with pytest.raises(ValueError, match="Coin keeps no interval in `last`"):
        identify(Coin(1, 0), np.array([1]))


def test_results_travel_as_json_markdown_and_a_picture(tmp_path):
    source = RandomFlights(spacecraft=ORION, intervals=20)
    found = evaluate(
        lambda vehicles: GenericChiSquared(ORION, 0.0, noise=PhysicalNoise(ORION), vehicles=vehicles),
        source, name="generic", false_alarms=0.01, validation=VALIDATION[:300], test=TEST[:300],
    )  # fmt: skip
    plain = json.loads(found.to_json())
    assert plain["calibration"]["threshold"] == found.calibration.threshold
    assert plain["confusion"] == [list(row) for row in found.confusion]
    stated = [point["stated"] for point in plain["curve"]]
    assert stated == sorted(stated, reverse=True)
    assert [point.threshold for point in found.curve] == sorted(point.threshold for point in found.curve)
    delays = [point.median_delay for point in found.curve]
    assert delays == sorted(delays)  # rarer alarms come later
    assert all(point.median_delay <= point.delay_90 for point in found.curve)
    assert np.array(found.confusion)[1:, -1].sum() > 0  # it names nobody
    text = found.to_markdown()
    assert text.count("\n| generic |") == 1
    assert len([line for line in text.splitlines() if line.startswith("|")]) == 3 + 2 + 13
    found.figure(tmp_path / "generic.png")
    assert (tmp_path / "generic.png").read_bytes().startswith(b"\x89PNG")
    assert found.update_time > 0.0
    assert found.update_time_in_batch > 0.0


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"intervals": 0}, "intervals is 0; one or more would be right"),
        ({"spacecraft": "orion"}, "spacecraft is 'orion'; a description, as"),
        ({"duration": 0.0}, "duration is 0.0; a positive number of s"),
        ({"open_share": 1.5}, "open_share is 1.5; a share from 0 to 1"),
        ({"bad_measurements": -0.1}, "bad_measurements is -0.1"),
        ({"longest": 2.0}, "longest is 2.0; above 0 and up to the duration of 1.0 s"),
        ({"faults": fails("misalignment")}, "faults has misalignment, which these flights do not model"),
        (
            {"faults": FaultDistribution(sensor_probability=0.5)},
            "sensor_probability must be 0 in flights with one fault of a thruster each, got 0.5",
        ),
    ],
)
def test_what_cannot_fly_is_refused_in_one_line(given, line):
    with pytest.raises(ValueError, match=line):
        RandomFlights(**({"spacecraft": ORION} | given))
