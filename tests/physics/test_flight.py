"""The compiled flight against the referee, an independent model that SciPy's DOP853 integrates to 1e-12.

Left to other files: impulses (`test_impulse`), motion without thrust (`test_free_motion`). Known differences
of the kernels from the referee are kept out of the flights here: a thruster has one misalignment at most (the
kernels add several, the referee turns one after the other), and a delay together with a late opening is
shorter than a period (the kernels lose a pulse that would open after its period, unless it is a run of whole
ones).
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.flying import (
    Array,
    Flown,
    fly,
    random_duties,
    random_faults,
    random_vehicle,
    scatter_of_flight,
)
from tests.physics.reference_flight import Flight, FlightState
from tests.physics.reference_flight import fly as fly_reference
from thruster_envs.faults import Fault
from thruster_envs.spacecraft import Feed, Spacecraft

SEED = 7
START = {"position": (100.0, -50.0, 20.0), "velocity": (0.1, 0.2, -0.1), "rate": (0.02, -0.015, 0.01)}
STATE = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 10), "rate": slice(10, 13)}


def judged(spacecraft: Spacecraft, duties: Array, faults: list[Fault], dynamics: str = "hcw") -> Flight:
    """The flight as the referee sees it, under the scatter that the kernels draw."""
    return fly_reference(
        spacecraft,
        duties,
        initial=FlightState(**START),
        faults=faults,
        scatter=scatter_of_flight(spacecraft, SEED, len(duties)),
        dynamics=dynamics,
    )


def flown(
    spacecraft: Spacecraft, duties: Array, faults: list[Fault], max_substep: float, dynamics: str = "hcw"
):
    """The same flight by the kernels."""
    return fly(
        spacecraft,
        duties,
        faults=faults,
        seed=SEED,
        nonlinear=dynamics == "nonlinear",
        max_substep=max_substep,
        **START,
    )


def errors(flight: Flown, reference: Flight) -> dict[str, float]:
    """Largest difference in the flight of each quantity, relative to its largest size."""
    found = {}
    for name, columns in STATE.items():
        exact = getattr(reference, name)[1:]
        own = flight.states[:, columns]
        if name == "attitude":
            own = own * np.sign(np.sum(own * exact, axis=1, keepdims=True))
        found[name] = float(np.abs(own - exact).max() / np.abs(exact).max())
    return found


@pytest.mark.parametrize("dynamics", ["hcw", "nonlinear"])
@pytest.mark.parametrize("valve_dynamics", [False, True], ids=["plain_valves", "slow_valves"])
@pytest.mark.parametrize("draw", range(6))
def test_random_craft_under_random_faults_fly_as_the_referee_says(draw, valve_dynamics, dynamics):
    """Any geometry, inertia, duties, kinds and profiles; the error shrinks with the sub-step, below 1e-9."""
    rng = np.random.default_rng([draw, valve_dynamics, dynamics == "hcw"])
    spacecraft = random_vehicle(rng, valve_dynamics=valve_dynamics, thrust=0.005)
    duties = random_duties(rng, 8, spacecraft.number_of_thrusters)
    faults = random_faults(rng, spacecraft)
    reference = judged(spacecraft, duties, faults, dynamics)
    coarse, fine = (
        errors(flown(spacecraft, duties, faults, substep, dynamics), reference) for substep in (0.5, 0.0625)
    )
    for name in STATE:
        assert coarse[name] < 1e-4
        assert fine[name] < max(1e-9, coarse[name] / 300)


@pytest.mark.parametrize("valve_dynamics", [False, True], ids=["plain_valves", "slow_valves"])
def test_ten_minutes_agree_to_nine_digits_with_a_small_substep(valve_dynamics):
    rng = np.random.default_rng(5)
    spacecraft = random_vehicle(rng, valve_dynamics=valve_dynamics, thrusters=8, period=5.0, thrust=1e-3)
    duties = random_duties(rng, 120, 8)
    faults = random_faults(rng, spacecraft, number=4)
    reference = judged(spacecraft, duties, faults, "nonlinear")
    flight = flown(spacecraft, duties, faults, 0.05, "nonlinear")
    assert max(errors(flight, reference).values()) < 1e-9
    assert flight.states[-1, 13] == pytest.approx(reference.mass[-1], rel=1e-12)


@pytest.mark.parametrize(
    "fault",
    [
        None,
        Fault(1, "stuck_off", severity=0.7, onset=5.0),
        Fault(1, "stuck_off", severity=0.7, onset=5.0, profile="ramp", profile_time=25.0),
        Fault(1, "stuck_on", severity=0.7, onset=5.0, profile="sine", profile_time=30.0),
        Fault(1, "loss", severity=0.7, onset=5.0, profile="sine", profile_time=30.0),
        Fault(1, "leak", severity=0.7, onset=5.0, profile="ramp", profile_time=25.0),
        Fault(1, "misalignment", severity=0.9, azimuth=1.0, onset=5.0, profile="ramp", profile_time=25.0),
        Fault(1, "misalignment", severity=0.9, azimuth=1.0, onset=5.0, profile="sine", profile_time=30.0),
        Fault(1, "intermittent", onset=5.0, profile_time=10.0),
    ],
    ids=lambda fault: "none" if fault is None else f"{fault.kind}-{fault.profile}",
)
def test_the_error_falls_with_the_fourth_power_of_the_substep(fault):
    """Whole periods only, so that no piece is shorter than the largest sub-step."""
    rng = np.random.default_rng(11)
    spacecraft = random_vehicle(rng, valve_dynamics=False, thrusters=6, period=5.0)
    duties = rng.integers(0, 2, (8, 6)).astype(float)
    duties[:, 0] = 1.0
    faults = [] if fault is None else [fault]
    reference = judged(spacecraft, duties, faults)
    coarse, fine = (errors(flown(spacecraft, duties, faults, substep), reference) for substep in (0.5, 0.125))
    for name in STATE:
        assert coarse[name] / fine[name] == pytest.approx(4**4, rel=0.4)


@pytest.mark.parametrize("valve_dynamics", [False, True], ids=["plain_valves", "slow_valves"])
def test_several_faults_of_one_thruster_act_in_their_order(valve_dynamics):
    """Stuck on before leak before stuck off, whatever the order of the slots."""
    rng = np.random.default_rng(3)
    spacecraft = random_vehicle(rng, valve_dynamics=valve_dynamics, thrusters=4, period=5.0)
    duties = random_duties(rng, 8, 4)
    faults = [
        Fault(2, "stuck_off", severity=0.5, onset=8.0),
        Fault(2, "leak", severity=0.3, onset=2.0, profile="ramp", profile_time=20.0),
        Fault(2, "stuck_on", severity=0.6, onset=12.0, duration=11.0),
        Fault(2, "misalignment", severity=0.5, azimuth=2.0),
    ]
    reference = judged(spacecraft, duties, faults)
    assert max(errors(flown(spacecraft, duties, faults, 0.0625), reference).values()) < 1e-8


def test_a_craft_without_propellant_drifts():
    """Its feed holds enough for some periods; after these nothing flows, leaks included."""
    rng = np.random.default_rng(2)
    spacecraft = random_vehicle(rng, valve_dynamics=False, thrusters=3, period=5.0)
    spacecraft = spacecraft.replace(feed=Feed(coupling=0.04, propellant_mass=4e-4))
    duties = np.full((8, 3), 0.9)
    faults = [Fault(1, "leak", severity=0.5)]
    reference = judged(spacecraft, duties, faults)
    flight = flown(spacecraft, duties, faults, 0.0625)
    spent = np.argmax(reference.mass <= spacecraft.mass - 4e-4)
    assert 1 < spent < 7
    assert np.all(flight.impulses[spent:] == 0.0)
    assert np.all(flight.impulses[:spent] != 0.0)
    assert max(errors(flight, reference).values()) < 1e-8


@pytest.mark.parametrize("draw", range(8))
def test_mass_agrees_to_twelve_digits(draw):
    rng = np.random.default_rng([draw, 99])
    spacecraft = random_vehicle(rng, valve_dynamics=bool(draw % 2))
    duties = random_duties(rng, 8, spacecraft.number_of_thrusters)
    faults = random_faults(rng, spacecraft, profiles=("step", "intermittent"))
    reference = judged(spacecraft, duties, faults)
    np.testing.assert_allclose(
        flown(spacecraft, duties, faults, 1.0).states[:, 13], reference.mass[1:], rtol=1e-12
    )
