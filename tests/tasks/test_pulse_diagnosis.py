"""Diagnosis of pulses: one sees a pulse with its noise; declarations are judged as the page says."""

import numpy as np
import pytest

from tests.tasks.flying import begin
from tests.tasks.pulse_players import ThrustPlayer, WaveformPlayer
from thruster_envs.faults import DISCHARGE_KINDS, Fault
from thruster_envs.physics.plasma_pulse import pulse_thrust, pulse_waveforms
from thruster_envs.spacecraft import load
from thruster_envs.tasks import PulseDiagnosis
from thruster_envs.tasks.pulse_diagnosis import CASES, PULSES, peak_current

CUBESAT = load("ppt_cubesat")
DISCHARGE = CUBESAT.discharge
QUIET = {"voltage_noise": 0.0, "current_noise": 0.0, "thrust_noise": 0.0}
SMALL = {"propellant_loss": 0.95, "electrode_sediment": 0.3, "conductivity_loss": 0.02}


def right_now(batch):
    """What would be right to declare, (worlds, 1, 1)."""
    return batch.info()["diagnosis"]["case"][..., np.newaxis]


def play(player, task=None, worlds=400, seed=1000):
    """Mean score, share of successes and mean return of a player, (worlds, size) to (worlds, 1)."""
    batch = begin(task or PulseDiagnosis(), worlds=worlds, seed=seed)
    observations, returned = batch.observe()[:, 0], 0.0
    for _ in range(PULSES):
        step = batch.step(player(observations)[:, np.newaxis])
        observations = step.observations[:, 0]
        returned += step.rewards.mean()
    truth = batch.task.truth(batch.state)
    return truth.score.mean(), truth.success.mean(), returned


# ---- Players -----------------------------------------------------------------------------------------------


def test_a_classical_player_finds_what_one_pulse_can_tell():
    score, success, returned = play(WaveformPlayer(PulseDiagnosis()))
    assert score >= 0.86
    assert success >= 0.75
    assert returned >= 0.7


def test_with_the_thrust_measured_hardly_a_pulse_is_ambiguous():
    task = PulseDiagnosis(observe_thrust=True)
    score, success, returned = play(ThrustPlayer(task), task)
    assert score >= 0.95
    assert success >= 0.85
    assert returned >= 0.95


@pytest.mark.parametrize(
    ("player", "best"),
    [
        (lambda observations: np.zeros((len(observations), 1)), 0.35),  # an episode in five is sound
        (lambda observations: np.full((len(observations), 1), 2), 0.15),
        (lambda observations: np.random.default_rng(int(observations[0, 128] * 1e6)).integers(
            0, 4, (len(observations), 1)), 0.2),
    ],
    ids=["never", "always the same", "random"],
)  # fmt: skip
def test_a_player_that_does_not_look_gets_little(player, best):
    score, success, _ = play(player)
    assert score <= best
    assert success <= best


def test_to_declare_what_info_says_is_worth_one():
    batch = begin(PulseDiagnosis(), worlds=200)
    returned, cases = np.zeros(200), []
    for _ in range(PULSES):
        cases.append(right_now(batch)[:, 0, 0])
        step = batch.step(right_now(batch))
        returned += step.rewards[:, 0]
        assert not step.terminated.any()
        assert not step.cost.any()
    np.testing.assert_allclose(returned, 1.0, rtol=1e-12)
    truth, told = batch.task.truth(batch.state), batch.info()["diagnosis"]
    assert (truth.score == 1.0).all()
    assert truth.success.all()
    faulty = (np.array(cases) > 0).any(axis=0)
    assert 0.5 < faulty.mean() < 0.9
    assert np.array_equal(told["detected"][:, 0], faulty)
    assert (told["delay"][faulty] == 0.0).all()
    assert not told["false_alarms"].any()
    assert set(np.unique(cases)) == {0, 1, 2, 3}
    np.testing.assert_allclose(truth.fuel, PULSES * 0.016 + 0.016, rtol=1e-12)  # and one still to be judged


# ---- How declarations are judged ---------------------------------------------------------------------------


def test_rewards_delays_and_scores_are_those_of_the_page():
    worlds, generator = 80, np.random.default_rng(0)
    batch = begin(PulseDiagnosis(), worlds=worlds)
    said, true = [], []
    for _ in range(PULSES):
        case, anything = right_now(batch)[:, 0, 0], generator.integers(0, 4, worlds)
        declared = np.where(generator.random(worlds) < 0.7, case, anything)
        said.append(declared)
        true.append(case)
        step = batch.step(declared.reshape(-1, 1, 1))
        terms = batch.info(step)["reward_terms"]
        expected = {
            "right": 1.0 * (declared == case),
            "delay": -1.0 * ((declared == 0) & (case > 0)),
            "false_alarm": -2.0 * ((declared > 0) & (case == 0)),
            "wrong_name": -0.5 * ((declared > 0) & (case > 0) & (declared != case)),
        }
        for name, value in expected.items():
            np.testing.assert_allclose(PULSES * terms[name][:, 0], value, atol=1e-12)
    truth, told = batch.task.truth(batch.state), batch.info()["diagnosis"]
    for world, (mine, theirs) in enumerate(zip(np.array(said).T, np.array(true).T, strict=True)):
        faulty, alarm = theirs > 0, mine > 0
        credit = np.where(mine == theirs, 1.0, np.where(alarm, 0.5, 0.0))[faulty]
        score = (credit.mean() if faulty.any() else 1.0) * (
            1.0 - alarm[~faulty].mean() if (~faulty).any() else 1.0
        )
        assert truth.score[world, 0] == pytest.approx(score, abs=1e-12)
        assert truth.success[world, 0] == (truth.score[world, 0] >= 0.9)
        assert told["false_alarms"][world, 0] == (alarm & ~faulty).sum()
        noticed = np.flatnonzero(faulty & alarm)
        delay = noticed[0] - np.flatnonzero(faulty)[0] if noticed.size else -1.0
        assert told["delay"][world, 0] == delay
        assert told["detected"][world, 0] == (noticed.size > 0)


# ---- The pulses --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", DISCHARGE_KINDS)
def test_without_noise_one_sees_the_pulse_that_the_solver_gives(kind):
    batch = begin(PulseDiagnosis(faults=[Fault(1, kind, severity=SMALL[kind])], **QUIET), worlds=20)
    mass, width, added, charge, ratio = batch.state.truth
    given = {
        "slug_mass": DISCHARGE.slug_mass * mass,
        "electrode_width": DISCHARGE.electrode_width * width,
        "added_resistance": added,
        "voltage": DISCHARGE.voltage * charge,
    }
    pulse, seen = pulse_waveforms(DISCHARGE, **given), batch.observe()[:, 0]
    every = slice(0, 64 * 20, 20)
    np.testing.assert_allclose(910.0 * seen[:, :64], pulse.voltage[:, every], atol=0.02)
    peak = peak_current(DISCHARGE)
    np.testing.assert_allclose(peak * seen[:, 64:128], pulse.current[:, every], atol=0.3)
    np.testing.assert_allclose(ratio, pulse_thrust(DISCHARGE, **given) / pulse_thrust(DISCHARGE), rtol=1e-5)
    expected = {"propellant_loss": mass, "electrode_sediment": width, "conductivity_loss": 1.0 - added}
    np.testing.assert_allclose(expected[kind], 1.0 - SMALL[kind], rtol=1e-12)
    assert batch.info()["diagnosis"]["case"].tolist() == 20 * [[CASES.index(kind)]]


def test_noise_and_charge_have_their_stated_size():
    batch = begin(PulseDiagnosis(faults=[], observe_thrust=True), worlds=4000)
    quiet = begin(PulseDiagnosis(faults=[], observe_thrust=True, **QUIET), worlds=4000)
    charge = batch.state.truth.charge
    assert np.array_equal(charge, quiet.state.truth.charge)
    assert 0.98 <= charge.min() < 0.9801
    assert 1.0199 < charge.max() <= 1.02
    assert charge.std() == pytest.approx(0.02 / np.sqrt(3.0), rel=0.05)
    noise = batch.observe()[:, 0].astype(np.float64) - quiet.observe()[:, 0]
    many = 4.0 / np.sqrt(2.0 * 64 * 4000)  # four deviations of a standard deviation
    assert 910.0 * noise[:, :64].std() == pytest.approx(4.0, rel=many)
    assert peak_current(DISCHARGE) * noise[:, 64:128].std() == pytest.approx(60.0, rel=many)
    assert 1e-4 * noise[:, -1].std() == pytest.approx(8e-7, rel=4.0 / np.sqrt(2.0 * 4000))
    correlation = np.corrcoef(noise[:, :128].T) - np.eye(128)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(4000)


def test_a_lighter_slug_and_narrower_electrodes_of_one_kick_give_the_same_pulse():
    """One is healthy, the other is not: what no single pulse can tell."""
    light = begin(PulseDiagnosis(faults=[Fault(1, "propellant_loss", severity=0.5)]), worlds=5)
    narrow = begin(
        PulseDiagnosis(faults=[Fault(1, "electrode_sediment", severity=1.0 - np.sqrt(0.5))]), worlds=5
    )
    np.testing.assert_allclose(light.observe()[..., :128], narrow.observe()[..., :128], atol=1e-6)
    np.testing.assert_allclose(narrow.state.truth.ratio, np.sqrt(2.0) * light.state.truth.ratio, rtol=1e-12)
    assert not right_now(light).any()
    assert (right_now(narrow) == 2).all()


def test_a_ramp_crosses_the_band_at_the_pulse_where_the_source_has_it():
    """Valdes 2008, eq. 4.5: the width shrinks by 0.4 mm a pulse; the ninth is the first faulty one."""
    ramp = Fault(1, "electrode_sediment", severity=0.63, profile="ramp", profile_time=0.63 * 0.0254 / 0.0004)
    batch = begin(PulseDiagnosis(faults=[ramp], voltage_jitter=0.0))
    cases = [right_now(batch).item()]
    for _ in range(40):
        batch.step(np.zeros((1, 1, 1)))
        cases.append(right_now(batch).item())
    assert cases == 9 * [0] + 32 * [2]


def test_only_faults_that_strike_the_firing_thruster_act():
    loss = {"kind": "conductivity_loss", "severity": 0.02}
    for faults, case in (
        ([{"thruster": 2, **loss}], 0),
        ([{"thruster": 2, "shared": True, **loss}], 3),
        ([{"thruster": 3, "shared": True, **loss}], 0),
        ([{"thruster": 1, **loss}], 3),
    ):
        assert right_now(begin(PulseDiagnosis(faults=faults))).item() == case
    assert right_now(begin(PulseDiagnosis(thruster=2, faults=[{"thruster": 2, **loss}]))).item() == 3


def test_a_pulse_has_the_fault_that_takes_its_thrust_furthest_off():
    faults = [Fault(1, "propellant_loss", severity=0.5), Fault(1, "conductivity_loss", severity=0.01)]
    assert right_now(begin(PulseDiagnosis(faults=faults))).item() == 3
    opposite = [Fault(1, "electrode_sediment", severity=0.15), Fault(1, "conductivity_loss", severity=0.009)]
    assert right_now(begin(PulseDiagnosis(faults=opposite))).item() == 0  # they make up for each other


def test_the_oracle_view_is_the_truth_about_the_pulse():
    batch = begin(PulseDiagnosis(observe_fault=True, faults=[Fault(1, "propellant_loss", severity=0.95)]))
    thrust, mass, width, added = batch.observe()[0, 0, -4:].tolist()
    assert thrust == pytest.approx(batch.info()["diagnosis"]["thrust"].item(), rel=1e-6)
    assert (mass, width, added) == pytest.approx((0.05, 1.0, 0.0), abs=1e-6)


def test_the_declaration_is_in_the_next_observation():
    batch = begin(PulseDiagnosis(), worlds=4)
    columns = batch.step(np.arange(4).reshape(4, 1, 1)).observations[:, 0, -3:]
    assert np.array_equal(columns, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"spacecraft": "orion"},
            "the spacecraft 'orion' has no discharge; one that has, like 'ppt_cubesat'",
        ),
        ({"thruster": 7}, "thruster is 7; a whole number from 1 to 6"),
        ({"samples": 1}, "samples is 1; a whole number from 2 to 3001"),
        ({"sample_spacing": 1.5e-8}, "sample_spacing is 1.5e-08 s; a multiple of 1e-08 s up to 4.7e-07 s"),
        ({"sample_spacing": 1e-6}, "the end of the pulse, would be right"),
        ({"voltage_noise": -1.0}, "voltage_noise is -1.0; a finite number of 0 or more"),
        ({"band": 0.0}, "band is 0.0; a share above 0 and below 1"),
        ({"voltage_jitter": 0.08}, "voltage_jitter is 0.08; a share from 0 to below 0.0724"),
        ({"false_alarm_cost": np.inf}, "false_alarm_cost is inf"),
    ],
)
def test_a_bad_argument_is_named(arguments, message):
    with pytest.raises(ValueError, match=message) as refusal:
        PulseDiagnosis(**arguments)
    assert "\n" not in str(refusal.value)
