"""What other people's programs do with environments: probe arguments, fail to make one, keep the spec."""

import gc
import pickle
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import thruster_envs
from tests.views.cases import IDS, faults_of
from thruster_baselines.control import DiagnosisObservation
from thruster_baselines.detection.residuals import CorrelationDetector
from thruster_baselines.mapping import CarryingMapper, LPMapper, TruncatingMapper
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.spacecraft import load, save
from thruster_envs.views import BeliefAction, HoldAction, MapperAction, SharedPolicyVecEnv

MAPPING = "thruster_envs/ThrusterMapping-v0"
ORION = "thruster_envs/OrionRendezvous-v1"
MARS = "thruster_envs/MarsRendezvous-v1"

MAKERS = {
    **{
        identifier: lambda identifier=identifier, **kwargs: gym.make(identifier, **kwargs)
        for identifier in IDS
    },
    **{
        f"{identifier}, batch": lambda identifier=identifier, **kwargs: gym.make_vec(identifier, **kwargs)
        for identifier in IDS
    },
    "keeping, parallel": formation_keeping_v1.parallel_env,
    "keeping, one by one": formation_keeping_v1.env,
    "attitude, parallel": formation_attitude_v1.parallel_env,
    "shared policy": lambda **kwargs: SharedPolicyVecEnv(2, **kwargs),
}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS.keys())
def test_an_argument_that_does_not_exist_is_a_type_error_as_python_words_it(make):
    for name in ("frameskip", "frame_skip", "continuous"):  # what clients try
        with pytest.raises(TypeError, match=rf"\.__init__\(\) got an unexpected keyword argument '{name}'; "):
            make(**{name: 4})
    with pytest.raises(
        TypeError, match="unexpected keyword argument 'spacecarft'; did you mean 'spacecraft'"
    ):
        make(spacecarft="orion")


#: Arguments that a constructor refuses, early and late.
REFUSED = [
    {"frameskip": 4},
    {"spacecraft": "orio"},
    {"faults": "all"},
    {"fault_slots": 0},
    {"render_mode": "ascii"},
    {"max_substep": -1.0},
]


@pytest.mark.parametrize("form", ["Env", "VectorEnv"])
@pytest.mark.parametrize("arguments", REFUSED, ids=lambda one: next(iter(one)))
@pytest.mark.parametrize("identifier", IDS)
def test_an_environment_whose_constructor_failed_can_be_closed(identifier, form, arguments, monkeypatch):
    path = gym.spec(identifier).entry_point.removesuffix("Env") + form
    module, name = path.split(":")
    cls = getattr(sys.modules[module], name)
    unraised = []
    monkeypatch.setattr(sys, "unraisablehook", unraised.append)
    env = cls.__new__(cls)
    with pytest.raises((TypeError, ValueError)):
        env.__init__(**arguments)
    env.close()
    env.close()
    del env
    gc.collect()
    assert unraised == []


def test_a_parallel_environment_whose_constructor_failed_can_be_closed():
    for cls in (
        type(formation_keeping_v1.parallel_env()),
        type(formation_attitude_v1.parallel_env()),
    ):
        for arguments in REFUSED:
            env = cls.__new__(cls)
            with pytest.raises((TypeError, ValueError)):
                env.__init__(**arguments)
            env.close()


# ---- The specification -------------------------------------------------------------------------------------


def assert_flies_the_same(env, steps=12):
    """From its specification, in memory, pickled and as JSON, an environment of the same flight is made."""
    text = env.spec.to_json()
    for spec in (env.spec, pickle.loads(pickle.dumps(env.spec)), EnvSpec.from_json(text)):
        again = gym.make(spec)
        assert again.spec.to_json() == text
        env.action_space.seed(0)
        np.testing.assert_array_equal(env.reset(seed=3)[0], again.reset(seed=3)[0])
        for _ in range(steps):
            action = env.action_space.sample()
            one, other = env.step(action), again.step(action)
            np.testing.assert_array_equal(one[0], other[0])
            assert one[1:4] == other[1:4]
            if one[2] or one[3]:
                break


@pytest.mark.parametrize("identifier", IDS)
def test_numpy_values_survive_json(identifier):
    faults = faults_of(identifier)
    kwargs = {
        "observe_fault": np.bool_(True),
        "fault_slots": np.int64(5),
        "max_substep": np.float32(0.7),
        "faults": {"probability": np.float64(1.0), "kinds": faults.kinds, "onset": np.array([0.0, 9.0])},
    }
    assert_flies_the_same(gym.make(identifier, **kwargs))
    spec = gym.make_vec(
        identifier, num_envs=np.int64(2), autoreset_mode=gym.vector.AutoresetMode.SAME_STEP, **kwargs
    ).spec
    again = gym.make_vec(EnvSpec.from_json(spec.to_json()))
    assert again.spec.to_json() == spec.to_json()
    assert again.num_envs == 2
    assert again.metadata["autoreset_mode"] == gym.vector.AutoresetMode.SAME_STEP


@pytest.mark.parametrize("form", [Path, str, load, lambda path: load(path).to_dict()])
def test_a_vehicle_survives_json_in_every_form_and_without_its_file(form, tmp_path):
    path = tmp_path / "mine.toml"
    save(load("spheres"), path)
    given = form(path)
    env = gym.make(
        ORION,
        spacecraft=given,
        start=np.array([10.0, 0.0, 0.0], np.float32),
        faults=(Fault(1, "loss", severity=0.5),),
    )
    path.unlink()
    assert_flies_the_same(env)
    assert gym.make_vec(ORION, spacecraft="spheres").spec.kwargs["spacecraft"] == "spheres"


def test_faults_survive_json_in_every_form():
    one = Fault(1, "stuck_on", severity=np.float32(0.3), onset=2.0, profile="ramp", profile_time=10.0)
    for faults in (
        one,
        [one, {"thruster": np.int64(2), "kind": "leak"}],
        FaultDistribution(probability=1.0),
        [],
    ):
        assert_flies_the_same(gym.make(ORION, faults=faults))


def wrapped():
    orion = load("orion")
    mappers = {
        "by name": lambda: LPMapper("orion"),
        "by description": lambda: LPMapper(orion, max_on_time=4.0, threads=1),
        "by matrix": lambda: LPMapper(
            orion.effectiveness(), np.full(12, 5.0), fuel_cost=np.arange(1.0, 13.0)
        ),
        "around another": lambda: TruncatingMapper(LPMapper(orion), 0.05),
    }
    for name, make in mappers.items():
        yield pytest.param(lambda make=make: MapperAction(gym.make(ORION), make()), id=f"mapper {name}")
        yield pytest.param(
            lambda make=make: BeliefAction(gym.make(MAPPING), make()), id=f"belief, mapper {name}"
        )
    yield pytest.param(
        lambda: BeliefAction(gym.make(MAPPING), LPMapper(orion), observe_belief=np.bool_(False)),
        id="unseen belief",
    )
    yield pytest.param(
        lambda: HoldAction(
            MapperAction(gym.make(ORION), CarryingMapper(LPMapper(orion), limit=0.1)), np.int64(2)
        ),
        id="held, with a memory",
    )
    yield pytest.param(
        lambda: DiagnosisObservation(gym.make(MARS), CorrelationDetector("msr_chaser", 0.02)), id="detector"
    )


@pytest.mark.parametrize("make", list(wrapped()))
def test_wrappers_survive_json(make):
    assert_flies_the_same(make(), steps=4)


def test_a_detector_is_recorded_with_the_threshold_that_it_has():
    detector = CorrelationDetector("msr_chaser", 0.02)
    detector.threshold = 0.5
    env = DiagnosisObservation(gym.make(MARS), detector)
    assert gym.make(EnvSpec.from_json(env.spec.to_json()))._watch.detector.threshold == 0.5


def test_somebody_elses_mapper_lives_in_the_spec_and_leaves_its_name_in_json():
    within = LPMapper("orion")

    class Mine:
        effectiveness, max_on_time = within.effectiveness, within.max_on_time
        __call__ = staticmethod(within)

    env = MapperAction(gym.make(ORION), Mine())
    assert gym.make(env.spec).spec == env.spec
    spec = EnvSpec.from_json(env.spec.to_json())
    with pytest.raises(
        ValueError, match=r"Mine cannot be rebuilt from its name: wrap the environment by hand"
    ):
        gym.make(spec)


# ---- How long an episode is at most ------------------------------------------------------------------------


@pytest.mark.parametrize("identifier", IDS)
def test_every_specification_bounds_the_episode(identifier):
    env, batch = gym.make(identifier, faults=[]), gym.make_vec(identifier, faults=[])
    bound = env.spec.max_episode_steps
    assert bound == batch.spec.max_episode_steps
    own = env.unwrapped.task.steps
    assert bound == (env.unwrapped.task.max_episode_steps if own is None else own + 1)
    short = gym.make_vec(identifier, max_episode_steps=7)
    assert (
        short.spec.max_episode_steps == gym.make(identifier, max_episode_steps=7).spec.max_episode_steps == 7
    )


@pytest.mark.parametrize(
    "kwargs", [{"orbits": 0.02}, {"orbits": 0.6}, {"spacecraft": "spheres", "orbits": 0.06}], ids=str
)
def test_the_bound_follows_the_configuration_and_never_cuts(kwargs):
    env = gym.make(ORION, start=(1.0, 0.0, 0.0), range_limit=1e6, rate_limit=1e3, **kwargs)
    for one in (env, gym.make(env.spec)):
        one.reset(seed=0)
        steps, over, cut = 0, False, False
        while not (over or cut):
            _, _, over, cut, _ = one.step(np.full(one.action_space.shape, -1.0, np.float32))
            steps += 1
        assert (over, cut) == (True, False)
        assert steps == env.unwrapped.task.steps == env.spec.max_episode_steps - 1


def test_one_choice_is_a_discrete_space():
    identifier = "thruster_envs/PulseDiagnosis-v0"
    env, batch = gym.make(identifier), gym.make_vec(identifier, num_envs=3)
    assert env.action_space == batch.single_action_space == gym.spaces.Discrete(4)
    assert batch.action_space == gym.spaces.MultiDiscrete([4, 4, 4])
    env.reset(seed=1)
    batch.reset(seed=1)
    for action in (3, np.int64(0), np.array(2)):
        one, many = env.step(action), batch.step(np.array([action, 1, 0]))
        np.testing.assert_array_equal(one[0], many[0][0])
        assert one[1] == many[1][0]
    for identifier in IDS:
        assert gym.make(identifier).action_space.shape != (1,)


def test_the_package_registers_nothing_that_cannot_be_printed(capsys):
    gym.pprint_registry()
    assert "OrionRendezvous-v1" in capsys.readouterr().out
    assert thruster_envs.__version__


def test_a_specification_with_a_users_pilot_holds_in_memory_and_names_it_in_json():
    def pilot(sight):
        return np.zeros((len(sight.position), 12))

    identifier = "thruster_envs/FaultDiagnosis-v1"
    env = gym.make(identifier, pilot=pilot)
    again = gym.make(env.spec)
    assert again.unwrapped.task.pilot is pilot
    np.testing.assert_array_equal(env.reset(seed=3)[0], again.reset(seed=3)[0])
    with pytest.raises(Exception, match="pilot is 'builtins:function'; None or a callable"):
        gym.make(EnvSpec.from_json(env.spec.to_json()))
