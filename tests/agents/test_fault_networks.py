"""Facts of the three levels: what their residuals are, what their thresholds come from, what they report."""

import json

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from tests.agents.pulses import pulses
from thruster_agents.dynamic_neurons import (
    Architecture,
    HighLevelClassifier,
    HighLevelSettings,
    IntegratedClassifier,
    LowLevelClassifier,
    LowLevelSettings,
    MissionSignals,
    TrainingSettings,
)
from thruster_envs.missions import fly_missions

STRIDE, STEPS = 5, 300
WEAK = {"slug_mass": 3.0e-9}  # fault case 1: 15 % of the thrust lost


def _generator(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def healthy():
    """Sixty healthy pulses at random charge voltages."""
    generator = np.random.default_rng(1)
    return pulses(generator.uniform(857.0, 977.0, 60), generator)


@pytest.fixture(scope="module")
def low(healthy):
    """The low level, trained on eight pulses to near the noise of the sensors."""
    classifier = LowLevelClassifier(LowLevelSettings(stride=STRIDE), generator=_generator())
    generator = np.random.default_rng(0)
    record = classifier.train(
        *pulses(generator.uniform(857.0, 977.0, 8), generator),
        training=TrainingSettings(stop=4e-5, iterations=400),
    )
    assert record.reached
    classifier.calibrate(*healthy)
    return classifier


def _turns(missions, seed, strength=(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)):
    """Signals of a craft whose rate decays and comes from pulses of six thrusters, each so strong."""
    generator = np.random.default_rng(seed)
    pulses_about = generator.integers(-1, 2, (missions, STEPS, 3))
    change = np.where(pulses_about > 0, strength[0::2], np.where(pulses_about < 0, strength[1::2], 0.0))
    change = np.copysign(change, pulses_about) * 4.0e-4
    rate = np.zeros((missions, STEPS + 1, 3))
    for k in range(STEPS):
        rate[:, k + 1] = 0.9 * rate[:, k] + change[:, k]
    attitude = np.zeros((missions, STEPS + 1, 4))
    attitude[..., 0] = 1.0
    rate += generator.normal(0.0, 1.0e-5, rate.shape)
    return MissionSignals(pulses_about, attitude, rate, attitude[:, 0])


@pytest.fixture(scope="module")
def high():
    """The high level for these turns, its thresholds from eight healthy missions."""
    settings = HighLevelSettings(attitude="none", architecture=Architecture(hidden=(3,)), window=(100, STEPS))
    classifier = HighLevelClassifier(settings, generator=_generator())
    records = classifier.train(_turns(3, 0), training=TrainingSettings(iterations=200, stop=5e-5))
    assert all(record.reached for record in records)
    classifier.calibrate(_turns(8, 1))
    return classifier


class _Circuit:
    """Waveforms of firings, those of one thruster faulty from one pulse on; counts what it was asked for."""

    def __init__(self, thrusters, weak=None, onset=0):
        self.thrusters, self.weak, self.onset, self.asked = thrusters, weak, onset, 0

    def __call__(self, which):
        self.asked += len(which)
        generator = np.random.default_rng(5)
        voltage, current = pulses(np.full(len(which), 910.0), generator)
        if (self.thrusters[which] == self.weak).all():
            later = len(which) - self.onset
            voltage[self.onset :], current[self.onset :] = pulses(np.full(later, 910.0), generator, **WEAK)
        return voltage, current


@pytest.fixture(scope="module")
def integrated(high, low):
    classifier = IntegratedClassifier(high, low)
    classifier.calibrate(*pulses(np.full(120, 910.0), np.random.default_rng(2)))
    return classifier


def test_the_residual_of_a_pulse_is_its_mean_error_on_the_networks_own_output(low, healthy):
    voltage, current = (signal[:5] for signal in healthy)
    inputs = voltage[:, ::STRIDE][:, :-1, np.newaxis] / 1000.0
    expected = low.network.predict_in_parallel(inputs)
    errors = abs(current[:, ::STRIDE][:, 1:] / 12000.0 - expected)
    np.testing.assert_allclose(low.residuals(voltage, current), errors.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(low.predict(voltage, current), 12000.0 * expected, rtol=1e-12)


def test_the_threshold_of_pulses_is_that_of_the_source(low, healthy):
    residuals = low.residuals(*healthy)
    expected = residuals.mean() + 1.15 * (residuals.max() - residuals.mean())
    assert low.threshold == pytest.approx(expected, rel=1e-12)
    assert not low.declare(*healthy).any()
    assert low.threshold_from(*healthy, false_alarms=0.1) in residuals


def test_a_pulse_that_lost_a_sixth_of_its_thrust_is_declared_faulty(low):
    generator = np.random.default_rng(3)
    assert low.declare(*pulses(np.full(5, 910.0), generator, **WEAK)).all()


def test_without_the_voltage_nothing_but_the_charge_is_seen(healthy):
    settings = LowLevelSettings(
        inputs="charge_voltage", stride=STRIDE, architecture=Architecture(stable=True, memory=(5.0, 100.0))
    )
    classifier = LowLevelClassifier(settings, generator=_generator())
    record = classifier.train(
        *(signal[:4] for signal in healthy), training=TrainingSettings(iterations=30, stop=0.0)
    )
    assert record.error < 0.8 * record.errors[0]
    voltage, current = healthy
    after = classifier.residuals(*healthy)
    later = voltage.copy()
    later[:, 3:] = 0.0
    np.testing.assert_array_equal(classifier.residuals(later, current), after)
    charged = voltage[:, :3].mean(axis=1)
    np.testing.assert_array_equal(classifier.residuals(0.0 * voltage, current, charge_voltage=charged), after)
    assert (classifier.residuals(voltage + 50.0, current) != after).all()


@pytest.mark.parametrize("kind", ["static", "gru"])
def test_other_networks_stand_behind_the_same_interface(kind, healthy):
    architecture = Architecture(kind=kind, hidden=(4,))
    classifier = LowLevelClassifier(
        LowLevelSettings(architecture=architecture, stride=30), generator=_generator()
    )
    few = tuple(signal[:6] for signal in healthy)
    record = classifier.train(*few, training=TrainingSettings(iterations=10, stop=0.0))
    assert record.error < 0.2 * record.errors[0]
    classifier.calibrate(*few)
    assert not classifier.declare(*few).any()


def test_signals_that_are_none_are_refused(low):
    with pytest.raises(ValueError, match=r"current \(2, 9\); \(pulses, samples\) for both"):
        low.residuals(np.zeros((2, 10)), np.zeros((2, 9)))
    with pytest.raises(ValueError, match="current has an entry that is not finite"):
        low.residuals(np.zeros((2, 10)), np.full((2, 10), np.nan))
    with pytest.raises(ValueError, match="threshold is None; calibrate with healthy pulses first"):
        LowLevelClassifier(generator=_generator()).declare(np.zeros((2, 10)), np.zeros((2, 10)))


def test_the_residual_of_a_mission_is_the_sum_of_its_errors_in_the_window(high):
    missions = _turns(2, 7)
    errors = abs(missions.rate[:, 1:] - high.predict(missions)) / 2.6e-3
    expected = errors[:, 99:300].sum(axis=1)  # after periods 100 to 300: the rates at 100 s to 300 s
    np.testing.assert_allclose(high.residuals(missions), expected, rtol=1e-12)
    np.testing.assert_allclose(high.residuals(missions[1:]), expected[1:], rtol=1e-12)


def test_the_thresholds_of_missions_are_those_of_the_source(high):
    residuals = high.residuals(_turns(8, 1))
    mean, largest = residuals.mean(axis=0), residuals.max(axis=0)
    expected = mean + np.array([1.208, 2.450, 1.032]) * (largest - mean)
    np.testing.assert_allclose(high.thresholds, expected, rtol=1e-12)
    assert not high.declare(_turns(8, 1)).any()


@pytest.mark.parametrize("thruster", range(6))
def test_a_weak_thruster_flags_its_pair_alone(high, thruster):
    strength = np.ones(6)
    strength[thruster] = 0.85
    flagged = high.declare(_turns(3, 11, strength))
    assert (flagged == (np.arange(3) == thruster // 2)).all()
    assert not high.declare(_turns(3, 11)).any()  # the healthy twins


def test_missions_shorter_than_the_window_are_refused(high):
    whole = _turns(1, 0)
    short = MissionSignals(whole.pulses[:, :250], whole.attitude[:, :251], whole.rate[:, :251])
    with pytest.raises(ValueError, match="have 250 steps; 300 or more, as the window has, would be right"):
        high.residuals(short)
    with pytest.raises(ValueError, match=r"rate has the shape \(1, 250, 3\); \(1, 251, 3\) would be right"):
        MissionSignals(whole.pulses[:, :250], whole.attitude[:, :251], whole.rate[:, :250])


def test_what_networks_see_of_a_flown_mission():
    """Pulses about the axis; then the error as the mission has it, or the change as a rate."""
    missions = fly_missions([20.0, 30.0, 40.0], degrees=True, steps=60, noise=False)
    signals = MissionSignals.of(missions, craft=1)
    assert signals.pulses.shape == (1, 60, 3)

    def seen(attitude, axis=1):
        return HighLevelClassifier(HighLevelSettings(attitude=attitude))._inputs(signals, axis)

    thrusters, periods = signals.firings()
    assert (missions.thrust[0, periods, 1, thrusters] > 0.0).all()
    assert len(periods) == np.count_nonzero(missions.thrust[0, :, 1])
    assert (np.diff(periods) >= 0).all()
    np.testing.assert_array_equal(seen("none"), missions.pulses[:, :, 1, 1:2])
    np.testing.assert_array_equal(seen("quaternion")[..., 1:], missions.attitude[:, :-1, 1, 1:])
    np.testing.assert_allclose(seen("error")[..., 1:], missions.errors()[:, :-1, 1, :3], atol=1e-14)
    increments = 2.6e-3 * seen("increment")[0, 1:, 1:]
    first_rates = -missions.rate[
        0, :59, 1
    ]  # while the attitude is near that of the leader: q = (1, -angle / 2)
    np.testing.assert_allclose(increments[:20], first_rates[:20], atol=0.05 * abs(first_rates).max())


def test_an_error_needs_its_target():
    whole = _turns(1, 0)
    blind = MissionSignals(whole.pulses, whole.attitude, whole.rate)
    classifier = HighLevelClassifier(HighLevelSettings(attitude="error"))
    with pytest.raises(ValueError, match="target is None; the attitude asked for in each mission"):
        classifier.predict(blind)
    assert (whole + whole).target.shape == (2, 4)
    assert (whole + blind).target is None


def test_missions_are_resumed_from_the_checkpoints_of_their_axes(tmp_path):
    settings = HighLevelSettings(attitude="none", window=(1, 50))
    straight, broken = (HighLevelClassifier(settings, generator=_generator(4)) for _ in range(2))
    straight.train(_turns(2, 0), training=TrainingSettings(iterations=6, stop=0.0))
    broken.train(_turns(2, 0), training=TrainingSettings(iterations=3, stop=0.0), checkpoints=tmp_path)
    told = []
    broken.train(
        _turns(2, 0),
        training=TrainingSettings(iterations=6, stop=0.0),
        checkpoints=tmp_path,
        progress=lambda axis, step, error: told.append((axis, step)),
    )
    assert told == [(axis, step) for axis in ("roll", "pitch", "yaw") for step in (4, 5, 6)]
    np.testing.assert_array_equal(broken.predict(_turns(1, 3)), straight.predict(_turns(1, 3)))


def test_the_thruster_that_lost_thrust_is_reported_with_its_first_faulty_pulse(integrated):
    strength = np.ones(6)
    strength[3] = 0.85
    mission = _turns(1, 20, strength)
    thrusters = mission.firings()[0]
    counts = np.bincount(thrusters, minlength=6)
    expected = counts / np.array([1.0, 1.0, 1.0, 1.2, 1.0, 1.0])  # thruster 4 fired more than it should
    circuit = _Circuit(thrusters, weak=3, onset=12)
    report = integrated.diagnose(mission, thrusters, circuit, expected_pulses=expected)
    assert report.flagged.tolist() == [False, True, False]
    assert [finding.thruster for finding in report.findings] == [3, 4]
    assert report.faulty_thrusters == (4,)
    finding = report.findings[1]
    assert (finding.first_faulty_pulse, finding.change) == (13, "loss")
    assert finding.faulty_pulses == counts[3] - 12
    assert finding.threshold == integrated.upper
    assert report.findings[0].threshold == integrated.lower < integrated.upper
    of_four = report.faulty[thrusters == 3]
    np.testing.assert_array_equal(of_four, np.arange(counts[3]) >= 12)
    assert report.faulty.sum() == of_four.sum()
    assert circuit.asked == counts[2] + counts[3]  # waveforms of other pairs are not made
    assert f"thruster 4: {counts[3]} pulses, {counts[3] - 12} faulty from pulse 13 on, a loss" in str(report)


def test_the_thruster_that_fired_more_gets_the_upper_threshold_and_neither_does_in_a_tie(integrated):
    strength = np.ones(6)
    strength[0] = 0.85
    mission = _turns(1, 20, strength)
    for counts, upper in (((7, 5), [True, False]), ((5, 7), [False, True]), ((6, 6), [False, False])):
        thrusters = np.repeat([0, 1], counts)
        report = integrated.diagnose(mission, thrusters, _Circuit(thrusters))
        thresholds = [finding.threshold for finding in report.findings]
        assert thresholds == [integrated.upper if one else integrated.lower for one in upper]
        assert report.faulty_thrusters == ()


def test_faulty_pulses_of_the_thruster_that_fired_less_mean_a_gain(integrated):
    strength = np.ones(6)
    strength[0] = 1.15
    thrusters = np.repeat([0, 1], [5, 7])
    report = integrated.diagnose(_turns(1, 20, strength), thrusters, _Circuit(thrusters, weak=0))
    assert report.findings[0].change == "gain"


def test_a_healthy_mission_asks_for_no_waveforms(integrated):
    mission = _turns(1, 20)
    circuit = _Circuit(mission.firings()[0])
    report = integrated.diagnose(mission, mission.firings()[0], circuit)
    assert str(report) == "all healthy"
    assert circuit.asked == 0
    assert not report.faulty.any()


def test_a_report_takes_one_mission_and_six_thrusters(integrated, high):
    with pytest.raises(ValueError, match="mission has 2 missions; one would be right"):
        integrated.diagnose(_turns(2, 0), [0], _Circuit(np.array([0])))
    with pytest.raises(ValueError, match="numbers from 0 to 5"):
        integrated.diagnose(_turns(1, 0), [6], _Circuit(np.array([6])))
    with pytest.raises(ValueError, match="a level has no threshold; calibrate both first"):
        IntegratedClassifier(high, LowLevelClassifier())


def test_what_is_saved_comes_back(integrated, healthy, tmp_path):
    integrated.save(tmp_path)
    back = IntegratedClassifier.load(tmp_path)
    assert (back.lower, back.upper) == (integrated.lower, integrated.upper)
    assert back.low_level.settings == integrated.low_level.settings
    assert back.high_level.settings == integrated.high_level.settings
    np.testing.assert_array_equal(
        back.low_level.residuals(*healthy), integrated.low_level.residuals(*healthy)
    )
    np.testing.assert_array_equal(back.high_level.thresholds, integrated.high_level.thresholds)
    np.testing.assert_array_equal(
        back.high_level.residuals(_turns(2, 9)), integrated.high_level.residuals(_turns(2, 9))
    )
    files = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
    assert files == ["classifier.json"] * 3 + ["weights.safetensors"] * 2


def test_files_of_something_else_are_refused(low, high, tmp_path):
    low.save(tmp_path)
    description, weights = tmp_path / "classifier.json", tmp_path / "weights.safetensors"
    with pytest.raises(ValueError, match="kind is 'low level'; 'high level' would be right"):
        HighLevelClassifier.load(tmp_path)
    content = json.loads(description.read_text())

    def refused(message, **changes):
        description.write_text(json.dumps(content | changes))
        with pytest.raises(ValueError, match=message):
            LowLevelClassifier.load(tmp_path)

    refused("unknown key 'treshold'; did you mean 'threshold'", treshold=1.0)
    refused(
        "settings: unknown key 'strid'; did you mean 'stride'", settings=content["settings"] | {"strid": 1}
    )
    refused("threshold is '0.1'; a number would be right", threshold="0.1")
    refused("format is 'other'", format="other")
    other = content["settings"] | {"architecture": {"hidden": [9]}}
    refused(r"has the shape \(10,.*\); \(9,.* would be right|shape", settings=other)
    description.write_text("{")
    with pytest.raises(ValueError, match="is not JSON"):
        LowLevelClassifier.load(tmp_path)
    description.write_text(json.dumps(content))
    saved = load_file(weights)
    save_file(saved | {"network.layers.0.slope": torch.full((10,), torch.nan).double()}, weights)
    with pytest.raises(ValueError, match=r"network.layers.0.slope has a number that is not finite"):
        LowLevelClassifier.load(tmp_path)
    weights.write_bytes(b"nothing")
    with pytest.raises(ValueError, match="is not a safetensors file"):
        LowLevelClassifier.load(tmp_path)
    with pytest.raises(ValueError, match="does not exist; the folder of a saved classifier would be right"):
        LowLevelClassifier.load(tmp_path / "none")


def _with_architecture(content, **changes):
    architecture = content["settings"]["architecture"] | changes
    return json.dumps(content | {"settings": content["settings"] | {"architecture": architecture}})


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"hidden": [1e9]}, "too few for hidden layers of"),
        ({"hidden": [10**30]}, "must be a whole number of 64 bits"),
        ({"hidden": [1e9] * 3}, "too few for hidden layers of"),
        ({"hidden": [1] * 5000}, "too few for hidden layers of"),
        ({"order": 10**9}, "too few for hidden layers of"),
        ({"hidden": [10, 10]}, "has the shape"),
        ({"order": 3}, "has the shape"),
        ({"kind": "gru", "hidden": [11]}, "has the shape"),
        ({"hidden": 1e9}, "a list would be right"),
        ({"hidden": [[[10]]]}, "a whole number would be right"),
        ({"hidden": [float("nan")]}, "NaN is not a number of JSON"),
        ({"hidden": []}, "one size or more"),
        ({"memory": [1.0, 1e400]}, "is not JSON"),
    ],
)
def test_a_description_makes_no_network_that_its_weights_do_not_fill(low, tmp_path, changes, line):
    """One line, at once; and memory for what is in the file at the most."""
    low.save(tmp_path)
    description = tmp_path / "classifier.json"
    description.write_text(_with_architecture(json.loads(description.read_text()), **changes))
    with pytest.raises(ValueError, match=line) as caught:
        LowLevelClassifier.load(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        b"[" * 100_000,
        b'{"settings":' * 100_000,
        b'{"kind": "low level", "kind": "low level"}',
        b"\xff\xfe",
        b"",
        b"null",
        b'{"threshold": ' + b"9" * 10_000 + b"}",
        b" " * 20_000_000,
    ],
)
def test_a_description_that_is_no_json_is_one_line(low, tmp_path, text):
    low.save(tmp_path)
    (tmp_path / "classifier.json").write_bytes(text)
    with pytest.raises(ValueError, match=r"classifier\.json") as caught:
        LowLevelClassifier.load(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("threshold", 10**400),
        ("threshold", [1]),
        ("settings", 5),
        ("settings", None),
        ("settings", {"voltage_scale": 10**400}),
        ("settings", {"sensitivity": -1}),
        ("settings", {"stride": 0.5}),
    ],
)
def test_numbers_of_a_description_are_finite(low, tmp_path, key, value):
    low.save(tmp_path)
    description = tmp_path / "classifier.json"
    content = json.loads(description.read_text())
    merged = content[key] | value if isinstance(value, dict) else value
    description.write_text(json.dumps(content | {key: merged}))
    with pytest.raises(ValueError, match=r"classifier\.json|settings|threshold") as caught:
        LowLevelClassifier.load(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", (2**63).to_bytes(8, "little"), (8).to_bytes(8, "little") + b"[[[[[[[["]
)
def test_weights_that_are_none_are_one_line(low, tmp_path, content):
    low.save(tmp_path)
    whole = (tmp_path / "weights.safetensors").read_bytes()
    for spoilt in (content, whole[:-1], whole[: len(whole) // 2], whole + b"x"):
        (tmp_path / "weights.safetensors").write_bytes(spoilt)
        with pytest.raises(ValueError, match="is not a safetensors file") as caught:
            LowLevelClassifier.load(tmp_path)
        assert "\n" not in str(caught.value)
