"""What a reader says of an observation is what navigation measured, in SI, in whatever view."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import IDS
from tests.views.test_storage import EQUIPPED
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.observations import Field, Reader, page_rows
from thruster_envs.physics import rows as at
from thruster_envs.spacecraft import load
from thruster_envs.views import HoldAction

ORION = "thruster_envs/OrionRendezvous-v1"
FLYING = "OrionRendezvous", "MarsRendezvous", "FaultDiagnosis", "ActiveDiagnosis", "FormationKeeping"


def batch(identifier, **settings):
    return gym.make_vec(identifier, num_envs=5, vectorization_mode="vector_entry_point", **settings)


@pytest.mark.parametrize("name", FLYING)
def test_a_reading_is_what_navigation_measured(name):
    """Float32 keeps seven digits; what is clipped is left out."""
    settings = {"navigation_delay": 0} if name == "MarsRendezvous" else {}
    envs = batch(f"thruster_envs/{name}-v1", **settings)
    observations, _ = envs.reset(seed=3)
    observations = envs.step(envs.action_space.sample())[0]
    reading = Reader.of(envs)(observations)
    worlds, task = envs.unwrapped.worlds, envs.unwrapped.task
    position, velocity = (worlds.fleet.read(at.MEASURED + k, 3)[:, 0] for k in (0, 3))
    slots = worlds.state.slots[:, 0] if hasattr(worlds.state, "slots") else np.zeros((5, 6))
    inside = reading.within("position")
    scale = 2e-7 * Reader.of(envs).scale("position") * 5.0
    assert inside.any()
    np.testing.assert_allclose(reading.position[inside], (position - slots[:, :3])[inside], atol=scale)
    if name != "MarsRendezvous":  # filters its velocity
        inside = reading.within("velocity")
        relative = velocity - (slots[:, 3:] if name == "FormationKeeping" else 0.0)
        assert inside.any()
        np.testing.assert_allclose(reading.velocity[inside], relative[inside], atol=1e-6)
    n = task.vehicle.number_of_thrusters
    np.testing.assert_allclose(reading.duties, worlds.fleet.read(at.DUTIES, n)[:, 0], atol=1e-7)
    change = worlds.fleet.read(at.MEASURED_CHANGE, 6)[:, 0]
    inside = reading.within("measured_change")
    np.testing.assert_allclose(reading.measured_change[inside], change[inside], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("identifier", IDS)
def test_fields_name_every_entry_once_and_make_the_space(identifier):
    env = gym.make(identifier, observe_fault=True)
    reader, space = Reader.of(env), env.observation_space
    assert len({field.name for field in reader.fields}) == len(reader.fields)
    assert all(field.name.isidentifier() for field in reader.fields)
    assert space.shape == (reader.size,)
    for field in reader.fields:
        columns = reader.columns(field.name)
        assert (space.low[columns] == np.float32(field.low)).all()
        assert (space.high[columns] == np.float32(field.bound)).all()
        assert np.isfinite(reader.scale(field.name)).all()


@pytest.mark.parametrize("identifier", IDS)
def test_without_an_environment_the_fields_are_the_same(identifier):
    settings = {"observe_fault": True, "fault_slots": 2}
    assert Reader.of(identifier, **settings) == Reader.of(gym.make(identifier, **settings))
    vehicle = load("ppt_cubesat" if "Attitude" in identifier or "Pulse" in identifier else "msr_chaser")
    env = batch(identifier, spacecraft=vehicle)
    assert Reader.of(identifier, spacecraft=vehicle) == Reader.of(env)


def test_a_reading_of_a_batch_is_that_of_its_rows():
    env = gym.make(ORION)
    read = Reader.of(HoldAction(env, 2))
    observations = np.stack([env.observation_space.sample() for _ in range(6)]).reshape(2, 3, -1)
    whole = read(observations)
    for field in read.fields:
        assert whole[field.name].shape == (2, 3, field.size)
        for k in range(2):
            for j in range(3):
                np.testing.assert_array_equal(whole[field.name][k, j], read(observations[k, j])[field.name])
    scales = [np.broadcast_to(read.scale(field.name), field.size) for field in read.fields]
    everything = np.concatenate([whole[field.name] for field in read.fields], axis=-1)
    np.testing.assert_array_equal(everything, observations.astype(np.float64) * np.concatenate(scales))


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_every_agent_has_a_reading_of_its_own(module):
    env = module.parallel_env()
    observations, _ = env.reset(seed=0)
    readings = Reader.of(env)(observations)
    assert list(readings) == env.agents
    for agent, observation in observations.items():
        np.testing.assert_array_equal(
            readings[agent].attitude_error, Reader.of(module.env())(observation).attitude_error
        )
    if module is formation_keeping_v1:
        first, second = (env.worlds.fleet.read(at.MEASURED, 3)[0, k] for k in (0, 1))
        seen = readings[env.agents[0]].others[:3]
        np.testing.assert_allclose(seen, second - first, rtol=1e-6)


def test_wheels_and_gyros_follow_all_else():
    env = gym.make(ORION, spacecraft=EQUIPPED)  # of a wheel and a gyro
    env.reset(seed=0)
    reader = Reader.of(env)
    assert reader.columns("wheel_speeds") == slice(reader.size - 3, reader.size - 2)
    observation, *_, info = env.step(np.r_[np.full(12, -1.0), 1.0, 0.5])
    reading = reader(observation)
    assert reading.wheel_speeds == pytest.approx(info["storage"]["wheel_speed"], rel=1e-6)
    angle = info["storage"]["gimbal_angle"]
    assert reading.gimbal_sines == pytest.approx(np.sin(angle), rel=1e-6)


def test_what_a_wrapper_adds_is_not_read():
    env = gym.make(ORION)
    observation, _ = env.reset(seed=0)
    read = Reader.of(env)
    longer = np.concatenate([observation, np.ones(5, np.float32)])
    assert (read(longer).measured_change == read(observation).measured_change).all()


def test_a_clipped_entry_is_not_within_its_bounds_and_neither_is_nan():
    read = Reader.of(ORION)
    observation = np.zeros(read.size, np.float32)
    observation[read.columns("velocity")] = 5.0, 4.99, np.nan
    reading = read(observation)
    assert reading.within("velocity").tolist() == [False, True, False]
    assert reading.within("velocity", "position").shape == (6,)
    assert reading.entries("velocity", "time_to_go").shape == (4,)


def test_an_unknown_name_is_answered_with_the_nearest():
    read = Reader.of(ORION)
    with pytest.raises(KeyError, match="no field 'velocty'; did you mean 'velocity'"):
        read.columns("velocty")
    reading = read(np.zeros(read.size))
    with pytest.raises(AttributeError, match="no field 'position_'"):
        _ = reading.position_
    assert "velocity" in read
    assert "velocity" in dir(reading)


def test_bad_input_is_one_clear_line():
    read = Reader.of(ORION)
    with pytest.raises(ValueError, match=r"shape \(\.\.\., 6\) or more for 'velocity', got \(4,\)"):
        _ = read(np.zeros(4)).velocity
    with pytest.raises(ValueError, match="environment must be one of thruster_envs"):
        Reader.of(gym.make("CartPole-v1"))
    with pytest.raises(ValueError, match="environment must be one of thruster_envs"):
        Reader.of("CartPole-v1")
    with pytest.raises(TypeError, match="settings must be empty beside an environment, got craft"):
        Reader.of(gym.make(ORION), craft=3)
    with pytest.raises(TypeError, match=r"unexpected keyword argument 'distanse'.*distance"):
        Reader.of("thruster_envs/MarsRendezvous-v1", distanse=3.0)
    with pytest.raises(ValueError, match="scale of 'x' must be one number or 3, got 2 of them"):
        Field("x", "place", 3, "m", (1.0, 2.0))


def test_readers_travel_with_the_pilots_that_have_one():
    read = Reader.of(ORION)
    observation = np.linspace(-1.0, 1.0, read.size)
    for other in (copy.deepcopy(read), pickle.loads(pickle.dumps(read))):
        assert other == read
        np.testing.assert_array_equal(other(observation).velocity, read(observation).velocity)
    reading = copy.copy(read(observation))
    np.testing.assert_array_equal(reading.velocity, read(observation).velocity)


def test_rows_of_a_page_count_on():
    fields = (Field("a", "first", 1), Field("b", "second", 2, "m", 0.5, bound=3.0, lowest=0.0))
    assert page_rows(fields) == ["| 0 | first | -1 | 1 | 1 |", "| 1-2 | second | 0 | 3 | 0.5 m |"]


def test_a_reader_takes_what_gym_make_takes_and_gymnasiums_own_batches():
    identifier = "thruster_envs/OrionRendezvous-v1"
    own = Reader.of(identifier, render_mode="rgb_array", flat_info=True, max_episode_steps=3)
    assert own.fields == Reader.of(identifier).fields
    batch = gym.make_vec(identifier, num_envs=2, vectorization_mode="sync", start=(100.0, 0.0, 0.0))
    observations, _ = batch.reset(seed=0)
    np.testing.assert_allclose(Reader.of(batch)(observations).position[:, 0], 100.0, atol=5.0)
