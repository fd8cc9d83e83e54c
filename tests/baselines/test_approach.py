"""The approach law on NumPy: the scripted pilot's, from what the environment shows."""

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401  # registers the environments
from thruster_baselines.control import ApproachController
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

CHASER = load("msr_chaser")
MARS = "thruster_envs/MarsRendezvous-v1"


@pytest.mark.parametrize("arguments", [{}, {"distance": 3.0}, {"distance": 130.0, "navigation_delay": 2}])
def test_it_asks_for_what_the_law_of_the_scripted_pilot_asks_for(arguments):
    """On the same sights: measured position, attitude and rate, and the filtered velocity."""
    envs = gym.make_vec(MARS, num_envs=8, **arguments)
    observations, _ = envs.reset(seed=3)
    task, state = envs.unwrapped.worlds.task, envs.unwrapped.worlds.state
    controller = ApproachController(CHASER, task.steps, **arguments)
    for step in range(300):  # before the first capture
        actions = controller(observations)
        sights, age = state.sights[:, 0], arguments.get("navigation_delay", 1)
        time = 0.1 * max(step - age, 0)
        duties = state.model.pilot(
            time, sights[:, :3], state.estimate[:, 3:], sights[:, 6:10], sights[:, 10:13]
        )
        # An observation has 24 bits: of 130 m that is 8e-6 m, worth 1e-5 to 1e-4 of an open rate.
        np.testing.assert_allclose(actions, 2.0 * duties - 1.0, atol=2e-4)
        observations = envs.step(actions)[0]


def test_attitude_and_rate_are_those_that_navigation_measured():
    envs = gym.make_vec(MARS, num_envs=8)
    observations, _ = envs.reset(seed=3)
    controller = ApproachController(CHASER, envs.unwrapped.worlds.task.steps)
    for _ in range(50):
        observations = envs.step(np.full((8, 8), -0.8, np.float32))[0]
    sights = envs.unwrapped.worlds.state.sights[:, 0]
    attitude, rate = controller.attitude(observations.astype(np.float64))
    assert np.abs(sights[:, 7:10] - [0.5, 0.5, -0.5]).max() > 0.005  # half a degree or more
    np.testing.assert_allclose(attitude, sights[:, 6:10], atol=1e-7)
    np.testing.assert_allclose(rate, sights[:, 10:13], atol=1e-8)


def test_it_captures_in_every_one_of_twenty_healthy_flights():
    envs = gym.make_vec(MARS, num_envs=20, vectorization_mode="vector_entry_point")
    observations, _ = envs.reset(seed=VALIDATION.start)
    controller = ApproachController(CHASER, envs.unwrapped.worlds.task.steps)
    captured, over = np.zeros(20, np.bool_), np.zeros(20, np.bool_)
    while not over.all():
        observations, _, terminated, _, info = envs.step(controller(observations))
        captured |= info["success"] & terminated & ~over
        over |= terminated
    assert captured.all()


def test_one_observation_is_a_batch_of_one():
    env = gym.make(MARS)
    observation, _ = env.reset(seed=0)
    controller = ApproachController(CHASER, 3000)
    assert controller(observation).shape == (8,)
    assert controller.wrench(observation).shape == (6,)
    np.testing.assert_array_equal(controller(observation[np.newaxis])[0], controller(observation))


def test_open_rates_give_the_wrench_and_stay_open_by_the_idle_rate_on_average():
    controller = ApproachController(CHASER, 3000)
    wrench = np.array([[10.0, -3.0, 5.0, 1.0, -0.5, 0.4], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    rates = controller.open_rates(wrench)
    np.testing.assert_allclose(rates @ CHASER.wrenches().T, wrench, atol=1e-12)
    np.testing.assert_allclose(rates[1], 0.1, rtol=1e-12)


def test_the_reference_arrives_at_the_speed_of_contact():
    controller = ApproachController(CHASER, 3000)
    position, speed, _ = controller.reference([0.0, 100.0, 181.25, 206.25, 210.0])
    np.testing.assert_allclose(position, [-20.0, -10.0, -1.875, 0.0, 0.1875], atol=1e-12)
    np.testing.assert_allclose(speed, [0.1, 0.1, 0.1, 0.05, 0.05], atol=1e-12)
