"""The NumPy formation that the compiled task's speed is compared with does the same work."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.numpy_formation import NumpyFormation
from tests.tasks.flying import begin
from thruster_envs.physics import rows as at
from thruster_envs.spacecraft import Sensors, load
from thruster_envs.tasks import FormationAttitude

PPT = load("ppt_cubesat")
PERIODS, WORLDS = 60, 7


@pytest.mark.parametrize("commanded", [1, 2])
def test_a_formation_without_sensor_noise_agrees_with_the_compiled_one_to_rounding(commanded):
    """Sixty periods of random pulses; the leader, and the follower that is not commanded, fly by the law."""
    task = FormationAttitude(spacecraft=PPT.replace(sensors=Sensors()), commanded=commanded)
    batch = begin(task, worlds=WORLDS, seed=5)
    plain = NumpyFormation(task, batch.state.targets.copy())
    rng = np.random.default_rng(0)
    for _ in range(PERIODS):
        options = rng.integers(0, 3, (WORLDS, commanded, 3))
        step = batch.step(options)
        observations = plain.fly(options, np.zeros((WORLDS, 3, 6)))
        fleet = batch.fleet
        for row, count, own in (
            (at.ATTITUDE, 4, plain.attitude),
            (at.RATE, 3, plain.rate),
            (at.MEASURED + 6, 4, plain.measured_attitude),
            (at.DUTIES, 6, plain.asked),
        ):
            np.testing.assert_allclose(own, fleet.read(row, count), rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(plain.terms.sum(axis=-1), step.rewards, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(observations, step.observations, rtol=0.0, atol=1e-6)  # single precision
    assert np.abs(plain.rate).max() > 1e-4  # the pulses turned it


def test_the_noise_has_the_size_that_the_craft_names():
    worlds = 5000
    targets = np.tile([1.0, 0.0, 0.0, 0.0], (worlds, 3, 1))
    plain = NumpyFormation(FormationAttitude(), targets)
    plain.step(np.zeros((worlds, 2, 3), np.int64), np.random.default_rng(1))
    error = (plain.measured_rate - plain.rate).std(axis=(0, 1))
    np.testing.assert_allclose(error, PPT.sensors.rate, rtol=0.03)
    tilt = (plain.measured_attitude - plain.attitude)[..., 1:].std(axis=(0, 1))
    np.testing.assert_allclose(tilt, 0.5 * PPT.sensors.attitude, rtol=0.03)
