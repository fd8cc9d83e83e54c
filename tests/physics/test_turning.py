"""However fast a craft turns, a period errs by less than a bound; one that cannot be followed is lost."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from tests.physics import reference_flight as referee
from tests.physics.flying import Array, begin, with_valves
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet, check_flyable
from thruster_envs.physics.vehicle import ERROR
from thruster_envs.spacecraft import Feed, Spacecraft, Thruster, load

ORION = with_valves(load("orion"), scatter=0.0)  # which the referee would have to know
#: Moments of inertia, kg m^2, of a plank and a plate: the rates of such bodies turn each other the most.
PLANK, PLATE = (0.02, 0.085, 0.1), (0.05, 0.05, 0.0999)


def body(moments: tuple[float, float, float], **changes: Any) -> Spacecraft:
    """Orion with other principal moments of inertia."""
    return ORION.replace(inertia=np.diag(moments).tolist(), **changes)


def thirsty(thrust: float, specific_impulse: float, propellant_mass: float) -> Spacecraft:
    """Orion with thrusters that use much propellant."""
    fuelled = ORION.replace(feed=Feed(propellant_mass=propellant_mass))
    return with_valves(fuelled, thrust=thrust, specific_impulse=specific_impulse)


def random_body(rng: np.random.Generator) -> Spacecraft:
    """Any body: 1e-4 to 1e3 kg m^2, 1 to 1000 kg, 0.06 to 50 N, control periods of 0.05 to 60 s."""
    a = rng.uniform(0.05, 1.0, 3)
    moments = np.array([a[1] + a[2], a[0] + a[2], a[0] + a[1]])
    moments *= 10.0 ** rng.uniform(-4.0, 3.0) / moments.max()
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    inertia = axes @ np.diag(moments) @ axes.T
    thrust, arm = 10.0 ** rng.uniform(math.log10(0.06), math.log10(50.0)), 10.0 ** rng.uniform(-2.0, 0.0)
    return Spacecraft(
        name="random",
        mass=float(10.0 ** rng.uniform(0.0, 3.0)),
        inertia=(0.5 * (inertia + inertia.T)).tolist(),
        control_period=float(10.0 ** rng.uniform(math.log10(0.05), math.log10(60.0))),
        thrusters=tuple(
            Thruster(
                name=f"T{k}",
                position=tuple(rng.uniform(-arm, arm, 3).tolist()),
                direction=tuple(rng.normal(size=3).tolist()),
                thrust=float(thrust),
            )
            for k in range(int(rng.integers(1, 13)))
        ),
    )


def errors(vehicle: Spacecraft, duties: Array, rate: Array, *, nonlinear: bool = False) -> Array:
    """(4,) errors of one period in the units of the bound: position, velocity, attitude, rate."""
    fleet = Fleet(vehicle, 1, nonlinear=nonlinear)
    begin(fleet)
    fleet.write(at.RATE, rate)
    fleet.write(fleet.rows.duties, duties)
    fleet.fly()
    assert fleet.read(at.LOST)[0, 0, 0] == 0.0
    flown, impulse = fleet.read(0, 13)[0, 0], np.linalg.norm(fleet.read(at.IMPULSE, 3))
    exact = referee.fly(
        vehicle,
        duties[np.newaxis],
        initial=referee.FlightState(rate=rate),
        dynamics="nonlinear" if nonlinear else "hcw",
    )
    ends = [getattr(exact, name)[-1] for name in ("position", "velocity", "attitude", "rate")]
    ends[2] *= np.sign(ends[2] @ flown[6:10])
    speed = impulse / vehicle.mass
    scales = (speed * vehicle.control_period, speed, 0.5, np.linalg.norm(ends[3]))
    slices = (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13))
    return np.array(
        [
            np.linalg.norm(flown[part] - end) / scale
            for part, end, scale in zip(slices, ends, scales, strict=True)
        ]
    )


@pytest.mark.parametrize(
    ("vehicle", "duty", "rate"),
    [
        (with_valves(ORION, thrust=3.0), 0.05, (0.0, 0.0, 0.0)),
        (with_valves(ORION, thrust=3.0), 0.4, (1.0, -1.0, 1.0)),
        (ORION, 1.0, (0.2, 0.9, -0.3)),
        (body(PLANK), 0.2, (0.1, 3.0, 0.1)),
        (body(PLATE), 0.2, (2.0, 0.1, 2.0)),
        (body((6.0, 25.5, 30.0), control_period=60.0), 0.0, (0.05, 1.0, 0.0)),
        (body(PLATE, control_period=0.05), 0.5, (1.0, 1.0, 3.0)),
    ],
    ids=["3 N", "3 N tumbling", "tumbling", "plank", "plate", "60 s", "0.05 s"],
)
def test_a_period_of_a_craft_that_turns_fast_errs_by_less_than_the_bound(vehicle, duty, rate):
    check_flyable(vehicle)
    duties = duty * np.linspace(0.3, 1.0, 12) * (np.arange(12) % 3 > 0)
    duties[0] = duty or 1e-3  # for a scale of the errors
    assert errors(vehicle, duties, np.array(rate)).max() < ERROR


def test_a_craft_that_burns_a_third_of_its_mass_in_a_period_errs_by_less_than_the_bound():
    burning = thirsty(thrust=1.0, specific_impulse=0.4, propellant_mass=10.0)
    duties = np.where(np.arange(12) % 2 > 0, 0.9, 0.0)
    assert errors(burning, duties, np.array([0.1, 0.0, 0.3])).max() < ERROR


@pytest.mark.nightly
def test_a_period_of_any_craft_that_is_accepted_errs_by_less_than_the_bound():
    flown = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        vehicle = random_body(rng)
        rate = rng.normal(size=3)
        rate *= rng.uniform(0.0, 3.0) / np.linalg.norm(rate)
        duties = rng.random(vehicle.number_of_thrusters)
        spun = np.linalg.norm(vehicle.authority()[3:])
        if (spun + 3.0) * vehicle.control_period > 300.0:
            continue  # refused, or flown by the referee for minutes
        check_flyable(vehicle)
        assert errors(vehicle, duties, rate, nonlinear=bool(seed % 2)).max() < ERROR, seed
        flown += 1
    assert flown > 100


@pytest.mark.parametrize(
    ("vehicle", "reason"),
    [
        (body((1e-3, 1e-3, 1e-3)), "can turn it to .* rad/s in a control period of 5 s"),
        (with_valves(ORION, thrust=220.0), "can turn it to .* rad/s in a control period of 5 s"),
        (ORION.replace(control_period=1e5), "control_period of .* must be from"),
        (ORION.replace(control_period=1e-6), "control_period of .* must be from"),
        (ORION.replace(mean_motion=0.5), "mean_motion of .* must be at most 0.2 rad/s"),
        (
            thirsty(thrust=1.0, specific_impulse=0.1, propellant_mass=19.0),
            "use up to .* kg in a control period",
        ),
    ],
)
def test_a_vehicle_that_cannot_be_flown_is_refused_in_one_line_with_the_reason(vehicle, reason):
    with pytest.raises(ValueError, match=reason) as refusal:
        gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=vehicle)
    assert "\n" not in str(refusal.value)
    gym.make("thruster_envs/ThrusterMapping-v0", spacecraft=vehicle)  # where nothing moves


def test_craft_that_turn_at_different_rates_fly_in_a_batch_as_they_do_alone():
    """From none to 60 rad/s, more sub-steps than a schedule holds; a few are lost."""
    worlds = 33
    rates = np.zeros((worlds, 1, 3))
    rates[:, 0, 1] = np.linspace(0.0, 60.0, worlds)
    rates[:, 0, 2] = 0.1
    rates[7, 0, 0], rates[20, 0, 2] = 1e4, 1e308
    duties = np.random.default_rng(1).random((worlds, 1, 12))

    def flown(first: int, number: int) -> Array:
        fleet = Fleet(ORION, number)
        begin(fleet, seed=first)
        fleet.write(at.RATE, rates[first : first + number])
        for _ in range(3):
            fleet.write(fleet.rows.duties, duties[first : first + number])
            fleet.fly()
        return fleet.read(0, at.DUTIES)[:, 0]

    together = flown(0, worlds)
    for world in (0, 3, 7, 8, 20, 31, 32):
        np.testing.assert_array_equal(together[world], flown(world, 1)[0])
    np.testing.assert_array_equal(np.flatnonzero(together[:, at.LOST]), [7, 20])
    np.testing.assert_array_equal(together[7, at.RATE : at.RATE + 3], rates[7, 0])
    assert np.isfinite(together[np.arange(worlds) != 20]).all()


@pytest.mark.parametrize("max_substep", [None, 5.0])
def test_an_episode_of_a_craft_that_is_turned_too_fast_ends_as_lost_and_stays_finite(max_substep):
    """Orion with 22 N thrusters, of which one is stuck open: up to 60 rad/s more in every period."""
    strong = with_valves(load("orion"), thrust=22.0, specific_impulse=math.inf)
    one = strong.replace(thrusters=strong.thrusters[:1])
    env: Any = gym.make(
        "thruster_envs/OrionRendezvous-v1", spacecraft=one, max_substep=max_substep, rate_limit=1e9,
        range_limit=1e12,
    ).unwrapped  # fmt: skip
    env.reset(seed=1)
    for _ in range(100):
        observation, reward, terminated, _, info = env.step(np.ones(1))
        assert observation in env.observation_space
        assert math.isfinite(reward)
        if terminated:
            break
    assert terminated
    assert (info["success"], info["score"]) == (False, 0.0)
