"""What is expected of commands is what a healthy vehicle without scatter delivers, and sees no fault."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.physics.flying import begin, pulsed_fleet, random_duties, random_vehicle, with_valves
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.nominal_firing import Expectation
from thruster_envs.spacecraft import Feed, load

ROUNDING = {"rtol": 0.0, "atol": 1e-12}
ORION = load("orion")


class Flight(NamedTuple):
    """Of K periods: delivered on-times (K, n), impulses and expected changes (K, 6), and masses (K,)."""

    delivered: Any
    impulses: Any
    changes: Any
    masses: Any


def flown_and_expected(spacecraft, duties, faults=()):
    """A flight of duties (K, n), and what flight software expects of each period."""
    fleet, expectation, rows, firings = Fleet(spacecraft, 1), Expectation(spacecraft), [], []
    begin(fleet, faults)
    for told in duties:
        fleet.write(fleet.rows.duties, told)
        fleet.fly()
        firings.append(expectation.update(told))
        read = (
            (fleet.rows.delivered, fleet.rows.thrusters),
            (at.IMPULSE, 6),
            (at.EXPECTED_CHANGE, 6),
            (at.MASS, 1),
        )
        rows.append([fleet.read(*one)[0, 0] for one in read])
    return Flight(*(np.array(column) for column in zip(*rows, strict=True))), firings


@pytest.mark.parametrize("dynamics", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_it_is_what_a_vehicle_without_scatter_delivers(dynamics, seed):
    """Minimum pulse, delays, ramps, runs, carry-over, coupling, all at once and at random."""
    rng = np.random.default_rng(seed)
    vehicle = with_valves(random_vehicle(rng, valve_dynamics=dynamics), scatter=0.0)
    duties = random_duties(rng, 30, vehicle.number_of_thrusters)
    flight, firings = flown_and_expected(vehicle, duties)
    np.testing.assert_allclose([one.on_times[0] for one in firings], flight.delivered, **ROUNDING)
    np.testing.assert_allclose([one.rate_change[0] for one in firings], flight.changes, **ROUNDING)
    masses = flight.masses[:, 0]
    lighter = 0.5 * (np.concatenate([[vehicle.mass], masses[:-1]]) + masses) / vehicle.mass
    np.testing.assert_allclose([one.mass_ratio[0] for one in firings], lighter, **ROUNDING)
    forces = flight.impulses[:, :3] / (vehicle.mass * lighter[:, np.newaxis])
    np.testing.assert_allclose(flight.changes[:, :3], forces, **ROUNDING)


@pytest.mark.parametrize("kind", ["late_opening", "bias", "stuck_on", "stuck_off"])
def test_a_fault_does_not_change_what_is_expected(kind):
    """Not even one that changes what the valves carry over."""
    rng = np.random.default_rng(7)
    vehicle = random_vehicle(rng, valve_dynamics=True, thrusters=5)
    duties = random_duties(rng, 20, 5)
    fault = Fault(2, kind, severity=0.3, onset=0.0)
    healthy, faulty = (flown_and_expected(vehicle, duties, faults)[0].changes for faults in ((), (fault,)))
    assert np.array_equal(healthy, faulty)


def test_commands_that_valves_follow_are_expected_as_they_are():
    duties = random_duties(np.random.default_rng(1), 5, 12)
    sounds = Expectation(ORION.replace(feed=Feed(coupling=0.0)), 5).update(duties)
    assert np.array_equal(sounds.on_times, 5.0 * duties)
    assert np.array_equal(sounds.mass_ratio, np.ones(5))


def test_a_command_rounded_below_the_minimum_pulse_counts():
    """0.1 s of 5 s in single precision is a little less or more than 0.1 s."""
    vehicle = with_valves(ORION, minimum_pulse=0.1 + 1e-9)
    told = np.float32((0.1 + 1e-9) / 5.0) * np.ones(12)
    assert (Expectation(vehicle).update(np.nextafter(told, 0.0)).on_times > 0.0).all()
    assert not Expectation(vehicle).update(told * 0.999).on_times.any()


def test_vehicles_are_reset_one_by_one():
    """Alone: what it carried over is gone, and what its neighbour carried is not."""
    tank = ORION.replace(feed=Feed(propellant_mass=1.0))
    vehicle = with_valves(tank, closing_delay=2.0, specific_impulse=60.0)
    expectation = Expectation(vehicle, 2)
    expectation.update(np.full(12, 0.8))
    expectation.reset(np.array([True, False]))
    assert expectation.mass[0] == vehicle.mass > expectation.mass[1]
    idle = expectation.update(np.zeros(12))
    np.testing.assert_allclose(idle.open_times, [[0.0] * 12, [1.0] * 12])


def test_behind_a_modulator_it_is_the_environments():
    chaser = load("msr_chaser")
    duties = random_duties(np.random.default_rng(3), 12, chaser.number_of_thrusters)
    flight, firings = flown_and_expected(chaser, duties)
    np.testing.assert_allclose([one.rate_change[0] for one in firings], flight.changes, **ROUNDING)
    assert not firings[0].on_times.any()  # the delay is one period
    assert firings[1].deviation.any()


def test_of_plasma_thrusters_on_one_capacitor_the_larger_duty_fires():
    cubesat = load("ppt_cubesat")
    fleet = pulsed_fleet(cubesat, 1)
    begin(fleet)
    expectation = Expectation(cubesat, plasma=True)
    for duties in ([0.2, 0.5, 1.0, 0.0, 0.3, 0.3], [1.0, 0.0, 0.0, 0.1, 0.0, 0.0]):
        fleet.write(fleet.rows.duties, duties)
        fleet.fly()
        firing = expectation.update(duties)
        np.testing.assert_allclose(firing.on_times, fleet.read(fleet.rows.delivered, 6)[0], **ROUNDING)
        np.testing.assert_allclose(firing.rate_change[0, 3:], fleet.read(at.EXPECTED_CHANGE + 3, 3)[0, 0])


def test_empty_tanks_give_nothing():
    vehicle = with_valves(ORION.replace(feed=Feed(propellant_mass=0.02)), specific_impulse=1.0)
    expectation = Expectation(vehicle)
    assert expectation.update(np.ones(12)).on_times.any()
    assert not expectation.update(np.ones(12)).rate_change.any()


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match=r"duties must have the shape \(1, 12\), got \(11,\)"):
        Expectation(ORION).update(np.zeros(11))
    with pytest.raises(ValueError, match=r"coupling must be a share of the thrust from 0 to 1, got nan"):
        Expectation(ORION, coupling=math.nan)
    with pytest.raises(ValueError, match="plasma must be False for 'orion', without a discharge"):
        Expectation(ORION, plasma=True)
