"""Motion without thrust: what is conserved, and what has a closed form, over a whole orbit (5,712 s).

With sub-steps of a second unless a test has its own.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.closed_forms import (
    angular_momentum,
    hcw_transition,
    inertial_state,
    product,
    relative_energy,
    rotation_quaternion,
    rotational_energy,
    torque_free_axisymmetric,
)
from tests.physics.flying import Array, Flown, fly, random_vehicle
from thruster_envs.spacecraft import Spacecraft, load

MEAN_MOTION = 0.0011
ORBIT = 2.0 * np.pi / MEAN_MOTION
ATTITUDE = rotation_quaternion([0.4, -1.1, 0.7])
TOLERANCE = 1e-10


def coast(spacecraft: Spacecraft, time: float = ORBIT, **start: object) -> Flown:
    """Fly without a command for a time (s), rounded up to whole periods."""
    periods = int(np.ceil(time / spacecraft.control_period))
    return fly(spacecraft, np.zeros((periods, spacecraft.number_of_thrusters)), **start)


def times(spacecraft: Spacecraft, flight: Flown) -> Array:
    """(K,) s at which the states of a flight stand."""
    return spacecraft.control_period * np.arange(1, len(flight.states) + 1)


def tumbling_body() -> Spacecraft:
    """A craft with three different moments of inertia and products of inertia."""
    return random_vehicle(np.random.default_rng(4), valve_dynamics=False, thrusters=2, period=5.0)


@pytest.mark.parametrize(
    ("spacecraft", "rate", "max_substep"),
    [
        (load("orion"), (0.01, -0.015, 0.005), 1.0),
        (load("orion"), (0.02, 0.001, 0.0), 1.0),
        (load("orion"), (0.02, -0.03, 0.01), 0.5),
        (load("orion"), (0.1, 0.001, 0.0), 0.25),
        (load("orion"), (0.06, 0.05, -0.06), 0.25),
        (tumbling_body(), (0.01, -0.015, 0.005), 0.5),
        (tumbling_body(), (0.06, 0.05, -0.06), 0.1),
    ],
    ids=lambda value: value.name if isinstance(value, Spacecraft) else str(value),
)
def test_angular_momentum_and_energy_of_rotation_stay(spacecraft, rate, max_substep):
    """With a second up to 0.02 rad/s on Orion; fast tumbles and odd bodies take a smaller sub-step."""
    flight = coast(spacecraft, attitude=ATTITUDE, rate=rate, max_substep=max_substep)
    inertia = spacecraft.inertia
    momentum = angular_momentum(inertia, ATTITUDE, rate, 0.0, MEAN_MOTION)
    energy = rotational_energy(inertia, rate)
    for time, state in list(zip(times(spacecraft, flight), flight.states, strict=True))[::20]:
        now = angular_momentum(inertia, state[6:10], state[10:13], time, MEAN_MOTION)
        assert np.linalg.norm(now - momentum) < TOLERANCE * np.linalg.norm(momentum)
        assert rotational_energy(inertia, state[10:13]) == pytest.approx(energy, rel=TOLERANCE)


@pytest.mark.parametrize("rate", [0.001, 0.1, 0.5])
def test_a_quaternion_keeps_unit_length(rate):
    flight = coast(load("orion"), attitude=ATTITUDE, rate=(rate, -0.3 * rate, 0.2 * rate))
    assert np.abs(np.linalg.norm(flight.states[:, 6:10], axis=1) - 1.0).max() < 1e-15


def test_a_body_at_rest_in_inertial_space_turns_against_lvlh_once_an_orbit():
    flight = coast(load("orion"), 5712.0, attitude=ATTITUDE)
    turned = rotation_quaternion([0.0, 0.0, MEAN_MOTION * 5.0 * len(flight.states)])
    np.testing.assert_allclose(flight.states[-1, 6:10], product(ATTITUDE, turned), atol=1e-12)


def test_an_axisymmetric_body_precesses_as_euler_found():
    spacecraft = load("orion").replace(inertia=((0.6, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, 0.0, 0.45)))
    start = np.array([0.03, -0.02, 0.05])
    flight = coast(spacecraft, 600.0, attitude=ATTITUDE, rate=start)
    attitude, rate = torque_free_axisymmetric(0.6, 0.45, ATTITUDE, start, 600.0, MEAN_MOTION)
    np.testing.assert_allclose(flight.states[-1, 6:10], attitude, atol=1e-8)
    np.testing.assert_allclose(flight.states[-1, 10:13], rate, atol=1e-10)


@pytest.mark.parametrize(
    "start",
    [
        (100.0, -200.0, 50.0, 0.1, 0.2, -0.1),
        (100.0, 0.0, 0.0, 0.0, -0.22, 0.0),
        (0.0, 0.0, 30.0, 0.0, 0.0, 0.0),
    ],
    ids=["drifting", "ellipse", "cross_track"],
)
def test_free_motion_is_the_closed_form_of_hill_clohessy_and_wiltshire(start):
    spacecraft = load("orion")
    flight = coast(spacecraft, position=start[:3], velocity=start[3:])
    for time, state in zip(times(spacecraft, flight), flight.states, strict=True):
        exact = hcw_transition(MEAN_MOTION, time) @ start
        for part in (slice(0, 3), slice(3, 6)):
            assert np.linalg.norm(state[part] - exact[part]) < 1e-10 * np.linalg.norm(exact[part])


START = {"position": (3000.0, -5000.0, 2000.0), "velocity": (1.0, -5.0, 2.0)}


def test_two_body_motion_keeps_its_energy_and_its_plane():
    """Jacobi's constant of the relative motion, and the inertial angular momentum about the planet."""
    spacecraft = tumbling_body()
    flight = coast(spacecraft, nonlinear=True, **START)
    energy = relative_energy(*START.values(), MEAN_MOTION)
    plane = np.cross(*inertial_state(*START.values(), MEAN_MOTION, 0.0))
    for time, state in zip(times(spacecraft, flight), flight.states, strict=True):
        assert relative_energy(state[:3], state[3:6], MEAN_MOTION) == pytest.approx(energy, rel=1e-10)
        now = np.cross(*inertial_state(state[:3], state[3:6], MEAN_MOTION, time))
        assert np.linalg.norm(now - plane) < 1e-12 * np.linalg.norm(plane)


def test_two_body_motion_nears_hills_equations_with_the_square_of_the_distance():
    spacecraft = tumbling_body()
    differences = []
    for scale in (1.0, 0.1):
        start = {name: tuple(scale * x for x in values) for name, values in START.items()}
        hill, two_body = (
            coast(spacecraft, 1000.0, nonlinear=nonlinear, **start) for nonlinear in (False, True)
        )
        differences.append(np.linalg.norm(hill.states[-1, :3] - two_body.states[-1, :3]))
    assert differences[0] / differences[1] == pytest.approx(100.0, rel=0.05)


def test_a_craft_at_the_origin_of_lvlh_stays_there():
    for nonlinear in (False, True):
        assert np.all(coast(tumbling_body(), nonlinear=nonlinear).states[:, :6] == 0.0)
