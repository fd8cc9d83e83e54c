"""What the reproductions of the plasma thrusters' diagnosis fly and measure with."""

from __future__ import annotations

import math

import numpy as np
import pytest

from reproductions.valdes2008.confusion_tables import SCENARIOS
from reproductions.valdes2008.fair_comparison import whole_of
from reproductions.valdes2008.fair_comparison_study import (
    changed,
    faulty_with_motion,
    fit,
    severity_of,
)
from reproductions.valdes2008.fair_comparison_study import (
    test_missions as missions_of,
)
from reproductions.valdes2008.high_level_study import EXPERIMENTS, FOLLOWER, flown, incremental_resistance
from reproductions.valdes2008.integrated_study import firings
from reproductions.valdes2008.low_level_study import OTHER, RampResult
from reproductions.valdes2008.study import (
    CIRCUIT,
    FAULT_CASES,
    NOMINAL_THRUST,
    RAMPS,
    STEP_SEVERITY,
    measured,
    out_of_band,
    thrust_of,
)
from reproductions.valdes2008.tables_4_1_to_4_4_pulses import settling_time
from thruster_baselines.detection import Confusion


@pytest.mark.parametrize(
    ("kind", "last", "first_faulty", "thrusts"),
    [
        ("propellant_loss", 2.0e-10, 58, {46: 94.1, 47: 93.7, 55: 87.9, 57: 85.1, 58: 83.3, 64: 40.6}),
        ("electrode_sediment", 0.0090, 9, {7: 111.6, 8: 113.5, 9: 115.4, 12: 121.7, 41: 242.9}),
        ("conductivity_loss", 0.0096, 54, {46: 86.8, 47: 86.5, 53: 85.07, 54: 84.83, 64: 82.5}),
    ],
)
def test_ramps_end_and_cross_the_limit_where_the_reference_has_it(kind, last, first_faulty, thrusts):
    (values,) = RAMPS[kind].values()
    assert values[-1] == pytest.approx(last)
    thrust = thrust_of(**RAMPS[kind])
    assert np.argmax(out_of_band(thrust)) + 1 == first_faulty
    micronewton = 1e6 * NOMINAL_THRUST * thrust[np.array(list(thrusts)) - 1]
    np.testing.assert_allclose(micronewton, list(thrusts.values()), atol=0.06)


def test_faults_of_15_percent_lie_at_the_limit():
    found = [float(thrust_of(**changed(kind, severity))) for kind, severity in STEP_SEVERITY.items()]
    np.testing.assert_allclose(found, [0.851, 1.147, 0.850], atol=5e-4)


def test_measured_pulses_have_the_stated_errors_and_nothing_else():
    rng = np.random.default_rng(0)
    voltage, current = measured(rng, voltage=np.full(50, 910.0))
    clean = [wave - wave.mean(axis=0) for wave in (voltage, current)]
    np.testing.assert_allclose([one.std() for one in clean], [4.0, 60.0], rtol=0.02)
    assert np.abs(voltage.mean(axis=0)[0] - 910.0) < 4.0


def test_the_printed_scenarios_add_up_once_two_rows_are_swapped():
    assert [number for number, one in SCENARIOS.items() if not one.adds_up(one.cells)] == [3, 6]
    total = Confusion.total(one.corrected() for one in SCENARIOS.values())
    assert total == Confusion(7293, 7, 15, 3240)


def test_an_exponential_settles_after_the_logarithm_of_its_band():
    time = np.linspace(0.0, 20e-6, 20_001)
    assert settling_time(time, np.exp(-time / 1e-6), 0.01) == pytest.approx(math.log(100.0), abs=2e-3)


@pytest.mark.parametrize(("thrust", "resistance"), [(95.0, 0.00239), (85.0, 0.0081), (50.0, 0.0281)])
def test_the_growing_resistance_is_that_of_its_target_thrust(thrust, resistance):
    assert incremental_resistance((100.0 / thrust - 1.0) / 0.009) == pytest.approx(resistance, abs=5e-6)


def test_the_pieces_of_a_growing_fault_follow_its_law():
    fired = flown("I-5", "fault").discharges(0, FOLLOWER)
    own = (fired.thruster == 3) & (fired.step >= 400)
    law = incremental_resistance(fired.step[own] - 400.0)
    assert own.sum() > 5
    assert np.abs(fired.added_resistance[own] / law - 1.0).max() < 0.15
    assert not fired.added_resistance[~own].any()


def test_growing_sediment_is_linear_from_a_jump_on():
    fired = flown("I-7", "fault").discharges(0, FOLLOWER)
    own = (fired.thruster == 3) & (fired.step >= 300)
    target = 100.0 * (1.0 + 1e-4 * (fired.step[own] - 300.0))
    np.testing.assert_allclose(fired.electrode_width[own], 0.0220 - (target - 115.0) / 6400.0, rtol=1e-9)


def test_pulses_of_a_step_are_faulty_from_its_onset_as_the_source_counts():
    truth = firings("I-2", "fault")
    assert truth.faulty.sum() == (truth.thruster == EXPERIMENTS["I-2"].thruster - 1).sum() > 0
    assert not firings("I-2", "twin").faulty.any()


@pytest.mark.parametrize("case", FAULT_CASES)
@pytest.mark.parametrize("change", [0.17, 0.3, 0.4])
def test_a_severity_gives_the_change_of_thrust_that_it_was_asked_for(case, change):
    thrust = thrust_of(**changed(FAULT_CASES[case], severity_of(case, change)))
    assert abs(float(thrust) - 1.0) == pytest.approx(change, abs=2e-3)
    assert (thrust > 1.0) == (case == 2)


def test_a_twin_flies_as_its_mission_until_the_fault_begins():
    faulty, healthy = missions_of(1)
    first = int(np.argmax(faulty.signals.pulses[0, :, 0] != healthy.signals.pulses[0, :, 0]))
    assert not healthy.faulty.any()
    assert healthy.failing == -1
    assert faulty.form is not None
    different = np.abs(faulty.rate - healthy.rate).max(axis=1) > 1e-9
    onset = int(np.argmax(different))
    np.testing.assert_array_equal(
        faulty.signals.pulses[0, : onset - 1], healthy.signals.pulses[0, : onset - 1]
    )
    assert first == 0 or first >= onset - 1
    assert set(faulty.thruster[faulty.faulty]) <= {faulty.failing}


def test_where_the_cause_does_not_matter_the_motion_is_not_asked():
    faulty, _ = missions_of(1)
    thrust = np.where(np.arange(faulty.thruster.size) % 7 == 0, 0.8, 1.0)
    declared = faulty_with_motion(faulty, thrust, 2.0 - thrust)
    np.testing.assert_array_equal(declared, thrust < 0.85)


def test_the_circuit_and_the_motion_find_every_faulty_pulse_of_a_mission():
    for mission in missions_of(1):
        estimate = fit()(*measured(np.random.default_rng(3), **mission.parameters))
        declared = faulty_with_motion(mission, estimate.thrust_if_mass, estimate.thrust_if_width)
        assert (declared != mission.faulty).sum() <= 1  # one at the very limit may go either way


def test_missions_are_counted_once_by_what_is_declared_in_them():
    faulty, healthy = missions_of(1)
    own = faulty.thruster == faulty.failing
    perfect = whole_of((faulty, healthy), [faulty.faulty, healthy.faulty])
    assert (perfect.found, perfect.named, perfect.early, perfect.alarms) == (1, 1, 0, 0)
    assert perfect.delays == (0.0,)
    nothing = whole_of((faulty, healthy), [np.zeros_like(own), np.ones_like(healthy.faulty)])
    assert (nothing.found, nothing.alarms, nothing.delays) == (0, 1, (math.inf,))
    everything = whole_of((faulty, healthy), [np.ones_like(own), healthy.faulty])
    assert (everything.found, everything.named) == (1, 0)


def test_a_ramp_is_scored_with_the_healthy_thruster_beside_it():
    faulty = np.array([False, False, True])
    result = RampResult(np.zeros(3), np.zeros(41), faulty, np.array([False, True, True]), false_alarms=2)
    assert result.confusion == Confusion(1, 0, 1 + 2, 1 + 39)
    assert result.first_alarm == 2
    assert OTHER["propellant_loss"] == result.other.size
    assert CIRCUIT.number_of_samples == 3001
