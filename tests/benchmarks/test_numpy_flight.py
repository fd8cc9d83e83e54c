"""The NumPy flight that the kernels' speed is compared with does the same work: it gives the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.numpy_flight import NumpyFlight
from tests.physics.flying import begin, scatter_draws
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import Sensors, load

SEED, PERIODS, WORLDS = 3, 12, 9


@pytest.fixture
def orion():
    return load("orion").replace(sensors=Sensors())


def test_a_healthy_flight_agrees_with_the_kernels_to_rounding(orion):
    """Twelve periods of random duties, with the kernels' own scatter and without sensor noise."""
    rng = np.random.default_rng(0)
    duties = rng.random((PERIODS, WORLDS, 12))
    duties[2], duties[3] = 0.0, rng.integers(0, 2, (WORLDS, 12))
    fleet = Fleet(orion, WORLDS, max_substep=1.0)
    begin(fleet, seed=SEED)
    fleet.write(at.POSITION, [300.0, -20.0, 5.0])
    fleet.write(at.RATE, [0.02, -0.01, 0.015])
    fleet.look(fleet.everyone)
    plain = NumpyFlight(orion, WORLDS)
    for motion in (plain.motion, plain.measured):
        motion.position += np.array([300.0, -20.0, 5.0])
        motion.rate += np.array([0.02, -0.01, 0.015])
    for step in range(PERIODS):
        fleet.write(fleet.rows.duties, duties[step][:, np.newaxis])
        fleet.fly()
        scatter = np.array([scatter_draws(SEED + world, step, 12) for world in range(WORLDS)])
        plain.fly(duties[step], scatter, np.zeros((WORLDS, 12)))
        for row, count, own in (
            (at.POSITION, 3, plain.motion.position),
            (at.VELOCITY, 3, plain.motion.velocity),
            (at.ATTITUDE, 4, plain.motion.attitude),
            (at.RATE, 3, plain.motion.rate),
            (at.IMPULSE, 6, plain.impulse),
            (fleet.rows.delivered, 12, plain.delivered),
            (at.MEASURED + 6, 4, plain.measured.attitude),
            (at.MEASURED_CHANGE, 6, plain.measured_change),
            (at.EXPECTED_CHANGE, 6, plain.expected_change),
        ):
            kernel = fleet.read(row, count)[:, 0]
            np.testing.assert_allclose(own, kernel, rtol=0.0, atol=1e-12 * max(1.0, np.abs(kernel).max()))


def test_the_noise_has_the_size_that_the_craft_names():
    orion = load("orion")
    plain = NumpyFlight(orion, 20_000)
    plain.step(np.zeros((20_000, 12)), np.random.default_rng(1))
    error = plain.measured.position - plain.motion.position
    np.testing.assert_allclose(error.std(axis=0), orion.sensors.position, rtol=0.03)
    np.testing.assert_allclose(
        (plain.measured.rate - plain.motion.rate).std(axis=0), orion.sensors.rate, rtol=0.03
    )
