"""The pulse of a plasma thruster: an independent solver, conservation, the source's figures, and the map."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from thruster_envs.faults import Fault, encode, modes
from thruster_envs.physics.health import pulse_shares
from thruster_envs.physics.plasma_pulse import (
    MU_0,
    PulseMap,
    pulse_thrust,
    pulse_waveforms,
)
from thruster_envs.spacecraft import load

CUBESAT = load("ppt_cubesat")
DISCHARGE = CUBESAT.discharge
MAP = PulseMap.of(DISCHARGE)
CAPACITORS = np.array([thruster.capacitor for thruster in CUBESAT.thrusters])
CASES = {
    "healthy": {},
    "light slug": {"slug_mass": 3e-9},
    "lightest slug of the ramps": {"slug_mass": 2e-10},
    "most sediment of the ramps": {"electrode_width": 0.009},
    "most resistance": {"added_resistance": 0.1},
    "all at once": {"slug_mass": 1e-9, "electrode_width": 0.015, "added_resistance": 0.02, "voltage": 1000.0},
}


def of_radau(slug_mass=2.58e-8, electrode_width=0.0254, added_resistance=0.0, voltage=910.0):
    """Position, charge, velocity and current at every sample, by SciPy's implicit solver, in SI units."""
    gradient, resistance = MU_0 * 0.0254 / electrode_width, 0.043 + added_resistance
    times = np.linspace(0.0, 30.0, 3001)  # us, mm, uC, mm/us and A keep the numbers near one

    def rates(_, state):
        x, q, u, i = state
        force = 0.5 * gradient / slug_mass * i * i
        along = (voltage - 1e-6 * q / 17e-6 - (gradient * 1e3 * u + resistance) * i) / (
            35e-9 + gradient * 1e-3 * x
        )
        return [u, i, 1e-9 * force, 1e-6 * along]

    path = solve_ivp(rates, (0.0, 30.0), np.zeros(4), "Radau", times, rtol=3e-12, atol=1e-12).y
    return path * np.array([[1e-3], [1e-6], [1e3], [1.0]])


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_a_pulse_is_that_of_an_independent_solver(case):
    pulse = pulse_waveforms(DISCHARGE, **case)
    x, q, u, i = of_radau(**case)
    for ours, theirs in (
        (pulse.position, x),
        (pulse.voltage, case.get("voltage", 910.0) - q / 17e-6),
        (pulse.velocity, u),
        (pulse.current, i),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-8 * np.abs(theirs).max())
    slug = case.get("slug_mass", DISCHARGE.slug_mass)
    assert pulse_thrust(DISCHARGE, **case) == pytest.approx(slug * u[-1], rel=1e-8)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_energy_goes_into_the_field_the_slug_and_heat(case):
    """Nothing else takes any: the capacitor's loss is field, kinetic energy and the integral of R i^2."""
    pulse = pulse_waveforms(DISCHARGE, **case)
    gradient = MU_0 * 0.0254 / case.get("electrode_width", 0.0254)
    heat = np.cumsum(0.5 * (pulse.current[1:] ** 2 + pulse.current[:-1] ** 2)) * DISCHARGE.sample_time
    heat = (0.043 + case.get("added_resistance", 0.0)) * np.concatenate(([0.0], heat))
    field = 0.5 * (35e-9 + gradient * pulse.position) * pulse.current**2
    motion = 0.5 * case.get("slug_mass", 2.58e-8) * pulse.velocity**2
    stored = 0.5 * 17e-6 * pulse.voltage**2
    np.testing.assert_allclose(stored + field + motion + heat, stored[0], rtol=2e-4)  # the trapezoids' error


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_the_current_is_what_the_capacitor_loses_whatever_the_fault(case):
    pulse = pulse_waveforms(DISCHARGE, **case)
    v, h = pulse.voltage, DISCHARGE.sample_time
    lost = -17e-6 * (8.0 * (v[3:-1] - v[1:-3]) - (v[4:] - v[:-4])) / (12.0 * h)  # of the fourth order
    assert np.abs(lost - pulse.current[2:-2]).max() < 1e-6 * pulse.current.max()


def test_the_reported_figures_come_back_within_one_percent():
    """Valdes 2008, Tables 4.I to 4.IV and chapter 4: thrusts in uN, peak currents in A."""
    faults = pulse_waveforms(
        DISCHARGE,
        slug_mass=[2.58e-8, 3e-9, 2.58e-8, 2.58e-8],
        electrode_width=[0.0254, 0.0254, 0.02195, 0.0254],
        added_resistance=[0.0, 0.0, 0.0, 0.008],
    )
    np.testing.assert_allclose(faults.current.max(axis=1), [11090.0, 10400.0, 11100.0, 10300.0], rtol=0.01)
    thrust = faults.velocity[:, -1] * [2.58e-8, 3e-9, 2.58e-8, 2.58e-8]
    np.testing.assert_allclose(thrust, [100e-6, 85e-6, 115e-6, 85e-6], rtol=0.01)
    np.testing.assert_allclose(pulse_thrust(DISCHARGE, voltage=[857, 980]), [89.1e-6, 114.9e-6], rtol=0.01)


def test_the_nominal_pulse_has_its_known_shape():
    pulse = pulse_waveforms(DISCHARGE)
    samples = [50, 100, 150, 200, 300, 400, 500, 1000, 3000]  # every 10 ns
    volts = [757.92, 448.18, 151.26, -50.84, -163.90, -81.01, 7.62, -11.49, -0.20]
    amperes = [9034.8, 11037.8, 8702.4, 5005.3, -451.0, -1807.4, -1048.3, -33.5, -2.1]
    speeds = [409.2, 1764.1, 3011.1, 3600.1, 3751.8, 3804.1, 3860.7, 3876.1, 3876.7]
    np.testing.assert_allclose(pulse.voltage[samples], volts, atol=0.0051)
    np.testing.assert_allclose(pulse.current[samples], amperes, atol=0.051)
    np.testing.assert_allclose(pulse.velocity[samples], speeds, atol=0.051)
    assert (pulse.current.max(), pulse.current.min()) == pytest.approx((11093.7, -1810.2), abs=0.06)
    assert (pulse.time[pulse.current.argmax()], pulse.time[pulse.current.argmin()]) == pytest.approx(
        (0.923e-6, 3.949e-6), abs=5e-9
    )
    assert pulse.voltage.min() == pytest.approx(-165.64, abs=0.006)
    assert pulse.time[pulse.voltage.argmin()] == pytest.approx(2.872e-6, abs=5e-9)
    assert pulse.position[-1] == pytest.approx(0.111701, abs=1e-6)


def test_the_known_thrusts_of_faulty_pulses():
    """uN: the three faults of 15 %, and the resistance that the source has in print."""
    thrust = 1e6 * pulse_thrust(
        DISCHARGE,
        slug_mass=[2.58e-8, 3e-9, 2.58e-8, 2.58e-8, 2.58e-8],
        electrode_width=[0.0254, 0.0254, 0.02195, 0.0254, 0.0254],
        added_resistance=[0.0, 0.0, 0.0, 0.008, 0.08],
    )
    np.testing.assert_allclose(thrust, [100.02, 85.13, 114.71, 84.99, 35.83], atol=0.0051)


def test_ramps_leave_the_healthy_band_at_the_known_pulses():
    """Valdes 2008, eqs. 4.4-4.6: the first pulse off 85 to 115 uN of a ramp in mass, width and resistance."""
    mass = pulse_thrust(DISCHARGE, slug_mass=2.58e-8 - 0.04e-8 * np.arange(1, 65))
    width = pulse_thrust(DISCHARGE, electrode_width=0.0254 - 0.0004 * np.arange(1, 42))
    resistance = pulse_thrust(DISCHARGE, added_resistance=0.00015 * np.arange(1, 65))
    first = [1 + int(np.argmax(abs(1e4 * thrust - 1.0) > 0.15)) for thrust in (mass, width, resistance)]
    assert first == [58, 9, 54]


def test_pulses_with_one_kick_and_damping_are_one_pulse_in_other_units():
    """A circuit of twice the size in every unit that leaves both numbers as they are."""
    other = replace(
        DISCHARGE,
        capacitance=2.0 * DISCHARGE.capacitance,
        inductance=2.0 * DISCHARGE.inductance,
        slug_mass=2.0 * DISCHARGE.slug_mass,
        duration=2.0 * DISCHARGE.duration,
        sample_time=2.0 * DISCHARGE.sample_time,
    )
    ours, theirs = pulse_waveforms(DISCHARGE), pulse_waveforms(other)
    np.testing.assert_allclose(theirs.voltage, ours.voltage, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(theirs.position, 2.0 * ours.position, rtol=1e-11)
    assert pulse_thrust(other) == pytest.approx(2.0 * pulse_thrust(DISCHARGE), rel=1e-11)


def test_a_pulse_does_not_depend_on_those_beside_it():
    mass = np.geomspace(2e-10, 2.58e-8, 37)
    together = pulse_waveforms(DISCHARGE, slug_mass=mass)
    for k in (0, 15, 16, 36):
        alone = pulse_waveforms(DISCHARGE, slug_mass=mass[k])
        assert np.array_equal(alone.current, together.current[k])
        assert np.array_equal(alone.velocity, together.velocity[k])


def test_pulses_have_the_broadcast_shape_of_their_values():
    thrust = pulse_thrust(DISCHARGE, slug_mass=[[2e-8], [1e-8]], voltage=[900.0, 910.0, 920.0])
    assert thrust.shape == (2, 3)
    assert thrust[1, 2] == pulse_thrust(DISCHARGE, slug_mass=1e-8, voltage=920.0)
    assert pulse_waveforms(DISCHARGE).voltage.shape == (3001,)
    assert pulse_thrust(DISCHARGE, voltage=np.empty(0)).shape == (0,)


BAD = {
    "no slug": ({"slug_mass": [1e-8, 0.0]}, "slug_mass is 0.0; a positive number of kg would be right"),
    "NaN": ({"voltage": np.nan}, "voltage is nan; a positive number of V would be right"),
    "gain": (
        {"added_resistance": -1.0},
        "added_resistance is -1.0; a number of ohm from 0 up would be right",
    ),
    "shapes": (
        {"voltage": [1, 2], "slug_mass": [1, 2, 3]},
        "have the shapes (3,), (), (), (2,); shapes that",
    ),
    "wild": ({"slug_mass": 1e-13}, "kick of a pulse is"),
    "stiff": ({"added_resistance": 10.0}, "damping of a pulse is"),
}


@pytest.mark.parametrize(("values", "message"), BAD.values(), ids=BAD.keys())
def test_impossible_pulses_are_refused_in_one_clear_line(values, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        pulse_thrust(DISCHARGE, **values)
    assert "\n" not in str(refusal.value)


def random_pulses(count, wildest):
    """Shares of mass, width and voltage, and ohm: down to those of the ramps, or of the worst faults."""
    rng = np.random.default_rng(count)
    lightest, narrowest, most = (0.005, 0.25, 1.0) if wildest else (2e-10 / 2.58e-8, 0.009 / 0.0254, 0.1)
    return (
        np.exp(rng.uniform(np.log(lightest), 0.0, count)),
        rng.uniform(narrowest, 1.0, count),
        most * rng.uniform(0.0, 1.0, count) ** 2,
        rng.uniform(800.0, 1000.0, count) / 910.0,
    )


@pytest.mark.parametrize("wildest", [False, True])
def test_the_map_gives_the_thrust_of_any_pulse_to_a_hundred_thousandth(wildest):
    mass, width, added, voltage = random_pulses(2000, wildest)
    thrust = pulse_thrust(
        DISCHARGE,
        slug_mass=2.58e-8 * mass,
        electrode_width=0.0254 * width,
        added_resistance=added,
        voltage=910.0 * voltage,
    )
    ratio = MAP.ratio(mass_share=mass, width_share=width, added_resistance=added, voltage_share=voltage)
    np.testing.assert_allclose(ratio, thrust / pulse_thrust(DISCHARGE), rtol=1e-5)


def test_the_map_is_one_for_the_nominal_pulse_and_built_once():
    assert MAP.ratio() == 1.0
    assert PulseMap.of(load("ppt_cubesat").discharge) is MAP
    assert PulseMap.of(replace(DISCHARGE, voltage=1000.0)) is not MAP


@pytest.mark.parametrize("circuit", [{"resistance": 0.5}, {"slug_mass": 1e-9}, {"inductance": 2e-7}])
def test_the_map_of_another_discharge_is_as_good(circuit):
    """A stiff circuit, a light slug, a slow circuit: half the mass and width, twice the resistance."""
    other = replace(DISCHARGE, **circuit)
    ratios = PulseMap.of(other).ratio(
        mass_share=[0.5, 1.0, 1.0], width_share=[1.0, 0.5, 1.0], added_resistance=[0, 0, other.resistance]
    )
    thrusts = pulse_thrust(
        other,
        slug_mass=other.slug_mass * np.array([0.5, 1.0, 1.0]),
        electrode_width=other.electrode_width * np.array([1.0, 0.5, 1.0]),
        added_resistance=[0.0, 0.0, other.resistance],
    )
    np.testing.assert_allclose(ratios, thrusts / pulse_thrust(other), rtol=1e-4)


def test_faults_change_the_pulse_of_their_thruster_by_their_kind():
    faults = [
        Fault(1, "propellant_loss", severity=0.5),
        Fault(1, "propellant_loss", severity=0.2),
        Fault(1, "electrode_sediment", severity=0.1, profile="ramp", profile_time=100.0),
        Fault(1, "conductivity_loss", severity=0.004),
        Fault(1, "conductivity_loss", severity=0.002, onset=60.0),
        Fault(1, "loss", severity=0.9),
    ]
    rows = encode(faults, 1, 6, 8)[0]
    assert pulse_shares(rows, 0, CAPACITORS, 50.0) == pytest.approx((0.4, 0.95, 0.004))
    assert pulse_shares(rows, 0, CAPACITORS, 200.0) == pytest.approx((0.4, 0.9, 0.006))
    assert pulse_shares(rows, 1, CAPACITORS, 50.0) == (1.0, 1.0, 0.0)


def test_a_shared_fault_strikes_the_pair_and_no_other():
    rows = encode([Fault(4, "conductivity_loss", severity=0.01, shared=True)], 1, 6, 4)[0]
    added = [pulse_shares(rows, thruster, CAPACITORS, 0.0)[2] for thruster in range(6)]
    assert added == [0.0, 0.0, 0.01, 0.01, 0.0, 0.0]


def test_the_modes_begin_where_half_and_nine_tenths_of_the_thrust_are_lost():
    def lost(**values):
        return 1.0 - float(MAP.ratio(**values))

    half = brentq(lambda share: lost(mass_share=1.0 - share) - modes.WEAK_FROM, 0.9, 0.995)
    assert half == pytest.approx(modes.PROPELLANT_WEAK_FROM, abs=5e-5)
    half = brentq(lambda ohm: lost(added_resistance=ohm) - modes.WEAK_FROM, 0.0, 1.0)
    dead = brentq(lambda ohm: lost(added_resistance=ohm) - modes.DEAD_FROM, 0.0, 1.0)
    assert half == pytest.approx(modes.RESISTANCE_WEAK_FROM, abs=5e-5)
    assert dead == pytest.approx(modes.RESISTANCE_DEAD_FROM, abs=5e-4)
