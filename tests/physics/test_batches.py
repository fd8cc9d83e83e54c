"""A world flies the same, to the last bit, alone and in any batch, whatever the number of threads."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.flying import Array, begin, random_duties, random_vehicle
from thruster_envs.faults import FaultDistribution
from thruster_envs.faults.record import GENERAL_KINDS, PROFILES
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import Spacecraft, load

SEED = 40
FAULTS = FaultDistribution(
    probability=0.8,
    kinds=GENERAL_KINDS,
    count=(1, 3),
    onset=(0.0, 200.0),
    duration=(20.0, 300.0),
    profiles=PROFILES,
    dwell=(0.2, 0.8),
)
"""Every kind and profile, beginning and ending in the flight."""


def vehicle(name: str) -> Spacecraft:
    """Orion, or a craft of random geometry whose valves have delays and ramps."""
    if name == "orion":
        return load("orion")
    craft = random_vehicle(
        np.random.default_rng(8), valve_dynamics=True, thrusters=9, period=5.0, thrust=1e-3
    )
    return craft.replace(inertia=load("orion").inertia)  # the same kernel, compiled for a diagonal inertia


def duties_of(world: int, periods: int, thrusters: int) -> Array:
    """(periods, n) what a world is commanded, whatever batch it is in."""
    return random_duties(np.random.default_rng([world, 1]), periods, thrusters)


def flown(
    spacecraft: Spacecraft,
    worlds: int,
    *,
    first: int = 0,
    craft: int = 1,
    periods: int = 100,
    threads: int | None = None,
) -> Array:
    """Rows (worlds, craft, fields) after the flight of the worlds from number ``first`` on."""
    fleet = Fleet(spacecraft, worlds, craft, threads=threads)
    begin(fleet, FAULTS, seed=SEED + first)
    start = np.array(
        [
            np.random.default_rng([first + world, 2]).uniform(-0.02, 0.02, (craft, 3))
            for world in range(worlds)
        ]
    )
    fleet.write(at.RATE, start)
    fleet.write(at.POSITION, 1e4 * start)
    fleet.look(fleet.everyone)
    n = spacecraft.number_of_thrusters
    duties = np.array([duties_of(first + world, periods, n) for world in range(worlds)])
    for period in range(periods):
        fleet.write(fleet.rows.duties, np.broadcast_to(duties[:, period, None], (worlds, craft, n)))
        fleet.fly()
    return fleet.read(0, fleet.rows.fields)


@pytest.mark.parametrize("name", ["orion", "slow_valves"])
def test_a_world_in_a_batch_is_the_world_alone(name):
    """Fleets of 1, 7 (one padded block of lanes) and 330 (eleven blocks)."""
    spacecraft = vehicle(name)
    many = flown(spacecraft, 330)
    assert np.array_equal(flown(spacecraft, 7), many[:7])
    for world in range(330):
        assert np.array_equal(flown(spacecraft, 1, first=world)[0], many[world])
    assert np.all(np.isfinite(many))


@pytest.mark.parametrize("name", ["orion", "slow_valves"])
def test_a_thousand_worlds_fly_as_each_alone_on_any_number_of_threads(name):
    spacecraft = vehicle(name)
    many = flown(spacecraft, 1024, periods=20, threads=1)
    for threads in (2, 3):
        assert np.array_equal(flown(spacecraft, 1024, periods=20, threads=threads), many)
    for world in range(0, 1024, 93):
        assert np.array_equal(flown(spacecraft, 1, first=world, periods=20)[0], many[world])


def test_worlds_of_several_craft_are_the_same_in_any_batch():
    spacecraft = load("orion")
    many = flown(spacecraft, 30, craft=3, periods=30)
    assert np.array_equal(flown(spacecraft, 3, first=4, craft=3, periods=30), many[4:7])
    assert np.array_equal(flown(spacecraft, 1, first=11, craft=3, periods=30)[0], many[11])
    assert not np.array_equal(many[0, 0, : at.MASS], many[0, 1, : at.MASS])


def test_a_fleet_put_back_to_an_earlier_state_flies_the_same_again():
    spacecraft = vehicle("slow_valves")
    fleet = Fleet(spacecraft, 7)
    begin(fleet, FAULTS, seed=SEED)
    duties = duties_of(0, 40, 9)
    for row in duties[:20]:
        fleet.write(fleet.rows.duties, row)
        fleet.fly()
    halfway = fleet.state()
    ends = []
    for _ in range(2):
        fleet.restore(halfway)
        for row in duties[20:]:
            fleet.write(fleet.rows.duties, row)
            fleet.fly()
        ends.append(fleet.state()["data"])
    assert np.array_equal(ends[0], ends[1])


def test_worlds_and_episodes_with_other_numbers_differ():
    spacecraft = load("orion")
    ends = []
    for seed, episode in ((1, 0), (2, 0), (1, 1)):
        fleet = Fleet(spacecraft, 1)
        begin(fleet, seed=seed, episode=episode)
        fleet.write(fleet.rows.duties, np.full(12, 0.3))
        fleet.fly()
        ends.append(fleet.read(0, at.DUTIES)[0, 0])
    for other in ends[1:]:
        assert not np.any(np.isclose(ends[0][at.IMPULSE : at.LOST], other[at.IMPULSE : at.LOST], rtol=1e-12))
        assert not np.any(ends[0][at.MEASURED : at.MEASURED + 3] == other[at.MEASURED : at.MEASURED + 3])
