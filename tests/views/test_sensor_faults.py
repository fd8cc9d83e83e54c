"""Faults of sensors, in every form and every view: they reach the observation, info tells of them."""

import json

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import IDS, constant, craft_of
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.faults import SENSOR_KINDS, SENSORS, Fault, FaultDistribution
from thruster_envs.missions import fly_missions
from thruster_envs.views import SB3VecEnv

NOT_MEASURING = ("thruster_envs/ThrusterMapping-v0", "thruster_envs/PulseDiagnosis-v0")
FLYING = tuple(one for one in IDS if one not in NOT_MEASURING)
DRAWN = FaultDistribution(
    probability=0.5, onset=(0.0, 60.0), sensor_probability=1.0, sensor_count=(1, 2), sensor_axes=(0, 1, 2, 3),
    profiles=("step", "ramp", "sine", "intermittent"), profile_time=(20.0, 40.0),
)  # fmt: skip


@pytest.mark.parametrize("identifier", FLYING)
def test_a_fault_of_a_sensor_is_given_and_told_and_seen(identifier):
    """The craft flies as it would without it where nobody commands by what is measured."""
    period = gym.make(identifier).unwrapped.task.vehicle.control_period
    fault = {
        "sensor": "rate", "axis": 2, "kind": "bias", "severity": -0.02, "onset": 2.0 * period,
        "craft": craft_of(identifier),
    }  # fmt: skip
    env, same, healthy = (gym.make(identifier, faults=one) for one in ([fault], [], []))
    seen, info = env.reset(seed=3)
    told, _ = same.reset(seed=3, options={"faults": fault})
    clean, _ = healthy.reset(seed=3)
    differs, active = [], []
    for _ in range(4):
        assert info["fault"]["sensor"].tolist() == [SENSORS.index("rate") + 1, 0, 0, 0]
        assert info["fault"]["axis"].tolist() == [2, 0, 0, 0]
        assert info["fault"]["thruster"].tolist() == [0, 0, 0, 0]
        assert info["fault"]["kind"].tolist() == [SENSOR_KINDS.index("bias") + 1, 0, 0, 0]
        assert info["fault"]["severity"].tolist() == [-0.02, 0.0, 0.0, 0.0]
        assert not info["stale"].any()
        assert np.array_equal(seen, told)
        differs.append(not np.array_equal(seen, clean))
        active.append(bool(info["fault"]["active"][0]))
        action = constant(identifier, -1.0)
        seen, *_, info = env.step(action)
        told, clean = same.step(action)[0], healthy.step(action)[0]
    assert active == [False, False, True, True]
    assert differs == [False, False, True, True] or "Mars" in identifier  # whose navigation is late
    assert not env.reset(options={"faults": []})[1]["fault"]["sensor"].any()


@pytest.mark.parametrize("identifier", FLYING)
def test_drawn_faults_of_sensors_live_alike_in_a_batch_and_alone(identifier):
    law = json.loads(json.dumps(dataclass_of(DRAWN)))
    batch = gym.make_vec(identifier, num_envs=7, faults=law)
    alone = gym.make(identifier, faults=DRAWN)
    together, infos = batch.reset(seed=20)
    drawn = infos["fault"]["sensor"]
    assert drawn.max() <= len(SENSORS)
    if craft_of(identifier) == 1 and batch.unwrapped.task.number_of_craft == 1:
        assert (drawn > 0).any(axis=1).all()
    single, info = alone.reset(seed=25)
    for _ in range(8):
        assert np.array_equal(single, together[5])
        assert np.isfinite(single).all()
        assert np.array_equal(info["stale"], infos["stale"][5])
        for name, value in info["fault"].items():
            assert np.array_equal(value, infos["fault"][name][5])
        action = constant(identifier, -0.5)
        single, _, over, _, info = alone.step(action)
        together, *_, infos = batch.step(np.array([action] * 7))
        if over:
            break


def dataclass_of(law):
    """The plain mapping that a specification in JSON holds."""
    return {name: getattr(law, name) for name in vars(law)}


@pytest.mark.parametrize("identifier", FLYING)
def test_a_drop_out_holds_the_last_measurement_and_info_says_so(identifier):
    period = gym.make(identifier).unwrapped.task.vehicle.control_period
    out = Fault(
        sensor="attitude", kind="drop_out", onset=period, duration=1.5 * period, craft=craft_of(identifier)
    )
    env = gym.make(identifier, faults=[out])
    _, info = env.reset(seed=1)
    stale = [info["stale"].tolist()]
    for _ in range(4):
        seen, *_, info = env.step(constant(identifier, -1.0))
        assert np.isfinite(seen).all()
        stale.append(info["stale"].tolist())
    missing = [False, False, True, False]
    assert stale == [[False] * 4, missing, missing, [False] * 4, [False] * 4]


@pytest.mark.parametrize("identifier", NOT_MEASURING)
def test_what_has_no_sensors_refuses_their_faults_in_one_line(identifier):
    for faults in (Fault(sensor="rate", kind="bias"), [{"sensor": "rate", "kind": "bias"}]):
        with pytest.raises(ValueError, match=r"^sensor has no meaning here, got 'rate'$"):
            gym.make(identifier, faults=faults)
    with pytest.raises(
        ValueError, match=r"^sensor_probability must be 0 where no sensor is modelled, got 0.5"
    ):
        gym.make(identifier, faults={"sensor_probability": 0.5})
    _, info = gym.make(identifier).reset(seed=0)
    assert not info["fault"]["sensor"].any()
    assert not info["stale"].any()


def test_a_craft_on_plasma_thrusters_measures_no_position():
    with pytest.raises(ValueError, match=r"^sensor must be one of attitude, rate here, got 'position'$"):
        gym.make("thruster_envs/FormationAttitude-v1", faults=[Fault(sensor="position", kind="bias")])


def test_more_faults_than_slots_are_refused_together():
    with pytest.raises(ValueError, match="count and sensor_count must together be at most 4 "):
        gym.make(
            "thruster_envs/OrionRendezvous-v1",
            faults={"count": [1, 3], "sensor_probability": 1.0, "sensor_count": [1, 2]},
        )


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_a_parallel_environment_tells_each_craft_of_its_own_sensors(module):
    env = module.parallel_env(faults=[Fault(sensor="rate", axis=1, kind="drop_out", craft=3)])
    _, infos = env.reset(seed=0)
    for _ in range(2):
        sensors = [int(infos[agent]["fault"]["sensor"][0]) for agent in env.agents]
        assert sum(sensors) == SENSORS.index("rate") + 1
        observations, *_, infos = env.step(
            {agent: 0 * env.action_space(agent).sample() for agent in env.agents}
        )
        stale = [infos[agent]["stale"].tolist() for agent in env.agents]
        assert stale.count([False, False, False, True]) == 1
        assert all(np.isfinite(one).all() for one in observations.values())


def test_stable_baselines_sees_them():
    vectors = SB3VecEnv(gym.make_vec("thruster_envs/OrionRendezvous-v1", num_envs=3, faults=DRAWN))
    vectors.seed(0)
    assert np.isfinite(vectors.reset()).all()
    observations, *_ = vectors.step(np.full((3, 12), -1.0, np.float32))
    assert np.isfinite(observations).all()
    info = vectors.latest_info()
    assert (info["fault"]["sensor"] > 0).any(axis=1).all()
    assert info["stale"].shape == (3, len(SENSORS))


def test_missions_fly_by_what_faulty_sensors_say():
    """The follower holds the attitude that it measures: it truly ends as far off as its sensor is."""
    bias = Fault(sensor="attitude", axis=3, kind="bias", severity=0.1, craft=2)
    flown = fly_missions([0.0, 0.0, 0.0], faults=[bias], steps=1500, noise=False)
    measured, true = flown.measured_attitude[0, -1, 1], flown.attitude[0, -1, 1]
    assert 2.0 * np.arccos(min(abs(measured[0]), 1.0)) < 0.02
    assert 2.0 * np.arccos(min(abs(true[0]), 1.0)) == pytest.approx(0.1, abs=0.02)


def test_a_state_that_is_saved_goes_on_with_its_faulty_sensors():
    env = gym.make("thruster_envs/OrionRendezvous-v1", faults=DRAWN).unwrapped
    other = gym.make("thruster_envs/OrionRendezvous-v1").unwrapped
    env.reset(seed=4)
    other.reset(seed=9)
    action = np.full(12, -1.0, np.float32)
    env.step(action)
    other.worlds.restore(env.worlds.save())
    for _ in range(4):
        first, second = env.step(action), other.step(action)
        assert np.array_equal(first[0], second[0])
        assert np.array_equal(first[4]["fault"]["sensor"], second[4]["fault"]["sensor"])
