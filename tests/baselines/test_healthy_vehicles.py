"""Healthy vehicles are left alone: of the catalogue, with a minimum pulse, of a user's own, and at random.

All fly `FaultDiagnosis-v1`. Of flights of 119 periods no more may have a false alarm than a stated rate per
period allows (one-sided, 99 %). Nothing was tuned on the vehicles that are written here.
"""

from __future__ import annotations

import secrets
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import binom

import thruster_envs  # noqa: F401 - registers the environments
from thruster_baselines.detection import (
    CUSUMDetector,
    DetectorPlayer,
    EnvironmentFlights,
    EstimatorThreshold,
    FilterBank,
    GenericChiSquared,
    GLRDetector,
    SetChiSquared,
    SingleChiSquared,
    WindowedGLR,
)
from thruster_envs.faults import FaultDistribution
from thruster_envs.seeds import TEST
from thruster_envs.spacecraft import Feed, Sensors, Spacecraft, Thruster, catalogue, load

RATE, FLIGHTS, PERIODS = 1e-4, 60, 119
DETECTORS = (
    GLRDetector, CUSUMDetector, WindowedGLR, FilterBank, GenericChiSquared, SingleChiSquared, SetChiSquared,
    EstimatorThreshold,
)  # fmt: skip


def free_flyer(**valves) -> Spacecraft:
    """9 kg, twelve nozzles: two on each side, which push through it and turn it one way and the other."""
    thrusters = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            for side in (1.0, -1.0):
                direction, position = np.zeros(3), np.zeros(3)
                direction[axis], position[axis] = sign, -0.15 * sign
                position[(axis + 1) % 3] = 0.14 * side
                thrusters.append(
                    Thruster(
                        name=str(len(thrusters) + 1), position=tuple(position), direction=tuple(direction),
                        thrust=0.3, scatter=0.05, **valves,
                    )
                )  # fmt: skip
    return Spacecraft(
        name="free flyer", mass=9.0, inertia=((0.12, 0.0, 0.0), (0.0, 0.15, 0.0), (0.0, 0.0, 0.13)),
        thrusters=tuple(thrusters), feed=Feed(coupling=0.03, propellant_mass=3.0), control_period=1.0,
        sensors=Sensors(position=0.005, velocity=0.001, attitude=0.005, rate=0.001), mean_motion=0.0011,
    )  # fmt: skip


def with_minimum_pulse(name: str, seconds: float) -> Spacecraft:
    craft = load(name)
    return craft.replace(thrusters=tuple(replace(one, minimum_pulse=seconds) for one in craft.thrusters))


VEHICLES = {name: (lambda name=name: load(name)) for name in catalogue()} | {
    "orion, 0.1 s": lambda: with_minimum_pulse("orion", 0.1),
    "free flyer, 0.02 s": lambda: free_flyer(minimum_pulse=0.02),
    "free flyer, slow valves": lambda: free_flyer(
        opening_delay=0.03, closing_delay=0.05, rise_time=0.02, fall_time=0.04, specific_impulse=40.0
    ),
}


def healthy(vehicle, flights=FLIGHTS, first=0):
    source = EnvironmentFlights(arguments={"spacecraft": vehicle}, periods=PERIODS)
    return source(TEST[first : first + flights], False)


def check(alarmed, who):
    """No more flights with an alarm than the rate allows, one-sided at 99 %."""
    most = binom.ppf(0.99, len(alarmed), 1.0 - (1.0 - RATE) ** PERIODS)
    assert alarmed.sum() <= most, f"{who}: {alarmed.sum()} of {len(alarmed)} healthy flights have an alarm"


def alarms(detector, flights):
    """(flights,): whether there is an alarm in each."""
    alarmed = np.zeros(len(flights.on_times), np.bool_)
    for t in range(PERIODS):
        alarmed |= detector.update(flights.telemetry(slice(None), t)).detected
    return alarmed


@pytest.mark.parametrize("name", VEHICLES)
def test_detectors_leave_healthy_vehicles_alone(name):
    vehicle = VEHICLES[name]()
    flights = healthy(vehicle)
    for kind in DETECTORS:
        check(alarms(kind.for_vehicle(vehicle, RATE, vehicles=FLIGHTS), flights), f"{kind.__name__}, {name}")


@pytest.mark.parametrize("name", VEHICLES)
def test_the_player_declares_nothing_on_healthy_vehicles(name):
    env = gym.make_vec(
        "thruster_envs/FaultDiagnosis-v1", num_envs=FLIGHTS, vectorization_mode="vector_entry_point",
        spacecraft=VEHICLES[name](), faults=[],
    )  # fmt: skip
    player, declared = DetectorPlayer(env), np.zeros(FLIGHTS, np.bool_)
    observations, _ = env.reset(seed=TEST[0])
    for _ in range(PERIODS):
        actions = player(observations)
        declared |= actions[:, 0] > 0
        observations, *_ = env.step(actions)
    check(declared, f"DetectorPlayer, {name}")


@pytest.mark.parametrize("name", ["free flyer, 0.02 s", "orion, 0.1 s", "spheres"])
def test_a_dead_thruster_is_found_all_the_same(name):
    """In nine flights of ten: a floor is not so high that nothing is ever found."""
    vehicle = VEHICLES[name]()
    onset = (0.0, 60.0 * vehicle.control_period)
    faults = FaultDistribution(kinds=("stuck_off",), onset=onset, onset_grid=vehicle.control_period)
    source = EnvironmentFlights(arguments={"spacecraft": vehicle}, faults=faults, periods=PERIODS)
    flights = source(TEST[:40], True)
    detector = CUSUMDetector.for_vehicle(vehicle, RATE, vehicles=40)
    assert alarms(detector, flights).mean() >= 0.9


def random_vehicle(rng) -> Spacecraft:
    """A free-flyer of any size, with valves, feed and sensors of any kind."""
    size, mass = float(rng.uniform(0.5, 3.0)), float(10.0 ** rng.uniform(0.5, 3.0))
    period = float(rng.choice([0.5, 1.0, 2.0, 5.0]))
    craft = free_flyer()
    weaker = float(10.0 ** rng.uniform(-3.0, -1.5)) * mass / period
    slow = bool(rng.random() < 0.5)
    noise = float(rng.choice([0.0, 1.0])) * weaker * period / mass
    valves = {
        "thrust": weaker,
        "minimum_pulse": float(rng.choice([0.0, 0.02, 0.1])) * period,
        "scatter": float(rng.choice([0.0, 0.05, 0.1])),
        "opening_delay": 0.05 * period * slow * rng.random(),
        "closing_delay": 0.05 * period * slow * rng.random(),
        "rise_time": 0.05 * period * slow * rng.random(),
        "fall_time": 0.05 * period * slow * rng.random(),
    }
    inertia = mass * (0.15 * size) ** 2 * np.diag(rng.uniform(0.4, 0.6, 3))
    return craft.replace(
        mass=mass,
        inertia=tuple(map(tuple, inertia.tolist())),
        control_period=period,
        feed=Feed(coupling=float(rng.choice([0.0, 0.03, 0.06]))),
        sensors=Sensors(
            position=0.01, velocity=0.05 * noise, attitude=0.01 * (noise > 0.0), rate=0.02 * noise
        ),
        thrusters=tuple(
            replace(one, position=tuple(size * x for x in one.position), **valves) for one in craft.thrusters
        ),
    )


@pytest.mark.nightly
def test_random_vehicles_are_left_alone():
    """30 of them, other ones each time; the seed is in the message."""
    seed = secrets.randbits(32)
    rng = np.random.default_rng(seed)
    for number in range(30):
        vehicle = random_vehicle(rng)
        flights = healthy(vehicle, 40, 100 * number)
        for kind in DETECTORS:
            detector = kind.for_vehicle(vehicle, RATE, vehicles=40)
            check(alarms(detector, flights), f"{kind.__name__}, seed {seed}, vehicle {number}: {vehicle!r}")
