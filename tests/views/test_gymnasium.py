"""The Gymnasium environments pass every checker there is, take faults in every form, and refuse nonsense."""

import json
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from tests.views.cases import (
    IDS,
    constant,
    craft_of,
    entries,
    faults_of,
    has_options,
    kinds_of,
    space_of,
    thrusters_of,
)
from thruster_envs.faults import KINDS, Fault, FaultDistribution
from thruster_envs.spacecraft import save
from thruster_envs.testing import check_vector_env


@pytest.fixture(params=IDS)
def identifier(request):
    return request.param


def takes_options(identifier):
    return has_options(space_of(identifier))


def test_gymnasium_finds_nothing_wrong(identifier):
    check_env(gym.make(identifier, faults=faults_of(identifier), render_mode="rgb_array").unwrapped)


def test_stable_baselines_finds_nothing_wrong(identifier):
    check_env_for_sb3(gym.make(identifier, faults=faults_of(identifier)))


def test_the_vector_form_passes_every_check_in_every_autoreset_mode(identifier):
    report = check_vector_env(identifier, faults=faults_of(identifier), max_episode_steps=25, steps=60)
    assert not report.failures
    assert all(result.outcome == "passed" for result in report.results)


def test_a_thousand_worlds_are_made_by_one_call(identifier):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make_vec(identifier, num_envs=1024, faults=faults_of(identifier))
    observations, _ = env.reset(seed=0)
    assert observations.shape == env.observation_space.shape
    assert observations in env.observation_space
    assert len(np.unique(observations, axis=0)) == 1024


# ---- Faults, in every form ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_is_given_to_make_or_to_reset_and_comes_back_as_truth(identifier, kind):
    period = gym.make(identifier).unwrapped.task.vehicle.control_period
    fault = Fault(
        5,
        kind,
        severity=0.25,
        onset=period,
        duration=2.0 * period,
        craft=craft_of(identifier),
        **({"profile_time": 20.0} if kind == "intermittent" else {}),
    )
    if kind not in kinds_of(identifier):
        with pytest.raises(ValueError, match=f"kind '{kind}'"):
            gym.make(identifier, faults=[fault])
        return
    made = gym.make(identifier, faults=[fault])
    told = gym.make(identifier, faults=[])
    _, info = made.reset(seed=3)
    _, same = told.reset(seed=3, options={"faults": fault})
    seen = []
    for _ in range(4):
        for one in (info, same):
            assert one["fault"]["thruster"].tolist() == [5, 0, 0, 0]
            assert one["fault"]["kind"].tolist() == [KINDS.index(kind) + 1, 0, 0, 0]
            assert one["fault"]["severity"].tolist() == [0.25, 0.0, 0.0, 0.0]
        seen.append(bool(info["fault"]["active"][0]))
        action = constant(identifier, -0.5)
        first, second = made.step(action), told.step(action)
        assert np.array_equal(first[0], second[0])
        assert first[1] == second[1]
        info, same = first[4], second[4]
    assert seen == [False, True, True, False]
    _, info = told.reset()
    assert not info["fault"]["kind"].any()


@pytest.mark.parametrize("slip", ["fault", "Faults", "falts"])
def test_a_misspelt_option_is_left_alone_with_a_line_that_says_so(slip):
    env = gym.make("thruster_envs/OrionRendezvous-v1", faults=[]).unwrapped
    with pytest.warns(UserWarning, match=f"key '{slip}', which nothing reads; did you mean 'faults'") as told:
        _, info = env.reset(seed=0, options={slip: Fault(1, "stuck_on")})
    assert len(told) == 1
    assert told[0].filename == __file__
    assert not info["fault"]["thruster"].any()
    batch = gym.make_vec("thruster_envs/OrionRendezvous-v1", num_envs=2).unwrapped
    with pytest.warns(UserWarning, match="key 'reset_maks', .* 'reset_mask'"):
        batch.reset(seed=0, options={"reset_maks": np.array([True, False])})


@pytest.mark.parametrize("options", [{"options": 1}, {"default": 1}, {"mask": 1}, {3: 1}, {}])
def test_other_peoples_options_pass_without_a_word(options):
    env = gym.make("thruster_envs/OrionRendezvous-v1", faults=[]).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.reset(seed=0, options=options | {"faults": []})


def test_a_distribution_draws_faults_anew_at_every_reset(identifier):
    first, *_, last = kinds_of(identifier)
    env = gym.make(
        identifier, faults={"probability": 0.5, "kinds": [first, last], "profile_time": [10.0, 20.0]}
    )
    drawn = []
    for seed in range(600):
        _, info = env.reset(seed=seed)
        drawn.append((int(info["fault"]["kind"][0]), int(info["fault"]["thruster"][0])))
    kinds = np.array([kind for kind, _ in drawn])
    assert set(kinds) == {0, KINDS.index(first) + 1, KINDS.index(last) + 1}
    share = (
        0.5 / env.unwrapped.task.number_of_craft
    )  # a fault strikes one craft, of which the agent flies one
    assert abs(np.count_nonzero(kinds) - 600 * share) < 4.0 * np.sqrt(600 * share * (1.0 - share))
    assert {thruster for _, thruster in drawn} == set(range(thrusters_of(identifier) + 1))


FORMS = {
    "one": lambda first, *_: Fault(2, first, severity=0.5),
    "several": lambda first, second, *_: [
        Fault(2, first, severity=0.5), Fault(3, second, severity=0.3, azimuth=1.0)
    ],
    "drawn": lambda *kinds: FaultDistribution(
        probability=1.0, kinds={kinds[0]: 2.0, kinds[-1]: 1.0}, onset=(10.0, 20.0)
    ),
    "none": lambda *_: None,
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
def test_a_spec_survives_json(identifier, form):
    faults = form(*kinds_of(identifier))
    spec = gym.make(identifier, faults=faults, max_episode_steps=9).spec
    again = gym.make(EnvSpec.from_json(json.loads(json.dumps(spec.to_json()))))
    env = gym.make(identifier, faults=faults, max_episode_steps=9)
    assert np.array_equal(env.reset(seed=4)[0], again.reset(seed=4)[0])
    for _ in range(9):
        action = constant(identifier, -0.6)
        first, second = env.step(action), again.step(action)
        assert np.array_equal(first[0], second[0])
        assert first[1:4] == second[1:4]
    assert first[3] or first[2]


# PulseDiagnosis-v0 has another oracle view, tested beside its task.
@pytest.mark.parametrize("identifier", [one for one in IDS if "PulseDiagnosis" not in one])
def test_the_oracle_view_shows_what_the_faults_do(identifier):
    craft = craft_of(identifier)
    faults = [
        Fault(1, "stuck_off", craft=craft),
        Fault(2, "loss", severity=0.25, craft=craft),
        Fault(3, "stuck_on", severity=0.75, craft=craft),
        Fault(4, "leak", severity=0.125, craft=craft),
    ]
    env = gym.make(identifier, faults=faults, observe_fault=True)
    plain = gym.make(identifier, faults=faults)
    observation, _ = env.reset(seed=0)
    without, _ = plain.reset(seed=0)
    n = thrusters_of(identifier)
    assert np.array_equal(observation[: -2 * n], without)
    delivered, closed = observation[-2 * n : -n], observation[-n:]
    assert delivered.tolist() == [0.0, 0.75, 0.0, 0.875] + (n - 4) * [1.0]
    assert closed.tolist() == [0.0, 0.0, 0.75, 0.125] + (n - 4) * [0.0]


# ---- Bad input ---------------------------------------------------------------------------------------------


def test_an_unknown_argument_is_refused_by_naming_the_nearest(identifier):
    with pytest.raises(TypeError, match=unexpected("observe_faults", "observe_fault")):
        gym.make(identifier, observe_faults=True)
    with pytest.raises(TypeError, match=unexpected("observe_faults", "observe_fault")):
        gym.make_vec(identifier, num_envs=2, observe_faults=True)
    with pytest.raises(TypeError, match=unexpected("autoreset", "autoreset_mode")):
        gym.make_vec(identifier, num_envs=2, autoreset="SameStep")


def unexpected(given, meant):
    """What a view says of an argument that it does not know: Python's words, then ours."""
    return rf"Env\.__init__\(\) got an unexpected keyword argument '{given}'; did you mean '{meant}'\?"


def test_how_many_craft_are_commanded_is_not_to_be_chosen_where_there_is_one_agent():
    with pytest.raises(ValueError, match="commanded is always 1"):
        gym.make("thruster_envs/FormationKeeping-v1", commanded=2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fault_slots": 0}, "fault_slots is 0; a whole number from 1 to 64"),
        ({"max_substep": 0.0}, "max_substep must be from"),
        ({"spacecraft": "orio"}, "orion"),
        ({"faults": [{"thruster": 17, "severity": 0.1}]}, "thruster 17; a number from 1 to "),
        ({"faults": [{"thruster": 1, "kind": "leek"}]}, "leak"),
        ({"faults": {"probability": 1.0, "count": (5, 5)}}, "at most 4 faults"),
        ({"render_mode": "ascii"}, "render_mode is 'ascii'"),
    ],
)
def test_a_bad_argument_is_named_in_one_line(identifier, arguments, message):
    faults, kind = arguments.get("faults"), kinds_of(identifier)[0]
    if isinstance(faults, list):
        arguments = {"faults": [{"kind": kind} | faults[0]]}
    elif faults is not None:
        arguments = {"faults": {"kinds": [kind]} | faults}
    environment = gym.spec(identifier).entry_point.split(":")[1]
    with pytest.raises(ValueError, match=message) as caught:
        getattr(__import__("thruster_envs.views.environments", fromlist=[environment]), environment)(
            **arguments
        )
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_no_number_is_refused_and_the_episode_is_unharmed(identifier, bad):
    env, twin = gym.make(identifier).unwrapped, gym.make(identifier).unwrapped
    vector = gym.make_vec(identifier, num_envs=3)
    action = constant(identifier, -0.5).astype(float)
    env.reset(seed=0)
    twin.reset(seed=0)
    vector.reset(seed=0)
    wrong, batch = action.copy(), np.stack([action] * 3)
    if action.ndim:
        k = min(1, action.size - 1)
        wrong[k] = batch[2, k] = bad
    else:
        k, wrong, batch[2] = 0, np.array(bad), bad
    entry = (
        f"entry {k} is {bad}; a whole number"
        if takes_options(identifier)
        else f"thruster 2 is {bad}; a number"
    )
    with pytest.raises(ValueError, match=f"{entry} from"):
        env.step(wrong)
    with pytest.raises(ValueError, match=f"world 2, {env.task.agents[0]}, {entry}"):
        vector.step(batch)
    assert np.array_equal(env.step(action)[0], twin.step(action)[0])


@pytest.mark.parametrize("shape", [(11,), (13,), (2, 12), (), (1,)])
def test_an_action_of_another_shape_is_refused(identifier, shape):
    if shape == space_of(identifier).shape:
        shape = (2,)
    env = gym.make(identifier).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match="shape"):
        env.step(np.zeros(shape))
    vector = gym.make_vec(identifier, num_envs=3)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match="shape"):
        vector.step(np.zeros((3, *shape)))


@pytest.mark.parametrize("seed", [-1, 1.5, "7", 2**128])
def test_a_bad_seed_is_refused(identifier, seed):
    with pytest.raises((ValueError, gym.error.Error), match=r"(?i)seed"):
        gym.make_vec(identifier, num_envs=2).reset(seed=seed)


def test_actions_outside_the_space_are_clipped_and_options_that_do_not_exist_refused(identifier):
    env, twin = gym.make(identifier).unwrapped, gym.make(identifier).unwrapped
    env.reset(seed=0)
    twin.reset(seed=0)
    if takes_options(identifier):
        action, space = constant(identifier, 0.0), env.action_space
        several = isinstance(space, gym.spaces.MultiDiscrete)
        k = min(1, space.nvec.size - 1) if several else 0
        options = space.nvec[k] if several else space.n
        for wrong in (-1, options, 0.5):
            with pytest.raises(
                ValueError,
                match=rf"entry {k} is {wrong}; a whole number from 0 to {options - 1} would be right",
            ):
                env.step([*action[:k], wrong, *action[k + 1 :]] if several else wrong)
        assert np.array_equal(env.step(action)[0], twin.step(action)[0])
        return
    action = np.linspace(-3.0, 3.0, space_of(identifier).shape[0])
    assert np.array_equal(env.step(action)[0], twin.step(np.clip(action, -1.0, 1.0))[0])


def test_stepping_before_a_reset_is_refused(identifier):
    action = constant(identifier, 0.0)
    with pytest.raises(gym.error.ResetNeeded):
        gym.make(identifier).unwrapped.step(action)
    with pytest.raises(ValueError, match="reset"):
        gym.make_vec(identifier, num_envs=2).step(np.stack(2 * [action]))


# ---- One's own spacecraft ----------------------------------------------------------------------------------


def test_a_spacecraft_of_ones_own_is_used_by_its_path(identifier, tmp_path):
    path = tmp_path / "mine.toml"
    theirs = gym.make(identifier).unwrapped.task.vehicle
    spare = replace(theirs.thrusters[-1], name="spare")
    save(theirs.replace(name="mine", mass=40.0, thrusters=(*theirs.thrusters, spare)), path)
    env = gym.make(identifier, spacecraft=str(path), observe_fault=True, faults=faults_of(identifier))
    n, choices = env.unwrapped.task.vehicle.number_of_thrusters, env.unwrapped.task.choices
    assert n == len(theirs.thrusters) + 1
    by_thruster = choices is None or n + 1 in choices  # pulses about axes are chosen whatever the thrusters
    assert (env.action_space != space_of(identifier)) == by_thruster
    assert env.unwrapped.task.vehicle.name == "mine"
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(30):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert np.isfinite(reward)
        if terminated or truncated:
            env.reset()


@pytest.mark.parametrize("name", ["spheres", "astrobee_like", "atmos_like"])
def test_free_flyers_fly_in_every_task_that_needs_neither_discharge_nor_modulator(identifier, name):
    own = gym.make(identifier).unwrapped.task.vehicle
    for device in ("discharge", "modulator"):
        if getattr(own, device) is not None:
            with pytest.raises(ValueError, match=f"'{name}' has no {device}"):
                gym.make(identifier, spacecraft=name)
            return
    check_env(
        gym.make(identifier, spacecraft=name, faults=faults_of(identifier)).unwrapped,
        skip_render_check=True,
    )


# ---- What is returned --------------------------------------------------------------------------------------


def shares(first, second):
    return (
        isinstance(first, np.ndarray) and isinstance(second, np.ndarray) and np.shares_memory(first, second)
    )


def buffers(worlds):
    state, model = worlds.state, getattr(worlds.state, "model", None)
    own = [array for _, array in state.own()]
    own += [value for value in vars(model).values() if isinstance(value, np.ndarray)]
    own += [
        worlds.fleet.data,
        worlds.fleet.faults,
        worlds.keys,
        worlds.steps,
        worlds.episodes,
        worlds._whole,
        worlds._real,
    ]
    return own


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_nothing_returned_is_a_view_of_what_the_next_step_writes(identifier, mode):
    single = gym.make(identifier, faults=faults_of(identifier)).unwrapped
    vector = gym.make_vec(
        identifier, num_envs=9, faults=faults_of(identifier), max_episode_steps=3, autoreset_mode=mode
    )
    single.reset(seed=0)
    vector.reset(seed=0)
    for _ in range(4):
        action = constant(identifier, 0.0)
        for env, returned in (
            (single, single.step(action)),
            (vector, vector.step(np.stack(9 * [action]))),
        ):
            arrays = [*returned[:4], *(value for _, value in entries(returned[4]))]
            for array in arrays:
                assert not any(shares(array, buffer) for buffer in buffers(env.unwrapped.worlds))


def test_infos_have_the_same_keys_always_and_only_finite_numbers(identifier):
    env = gym.make(identifier, faults=faults_of(identifier), max_episode_steps=30).unwrapped
    env.action_space.seed(0)
    _, info = env.reset(seed=0)
    keys = {path for path, _ in entries(info)}
    assert {"cost", "fuel", "score", "success", "fault.active", "fault.kind"} <= keys
    for step in range(300):
        observation, reward, terminated, _, info = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert {path for path, _ in entries(info)} == keys
        assert all(np.isfinite(value).all() for _, value in entries(info))
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, rel=0.0, abs=1e-12)
        assert info["cost"] >= 0.0
        assert 0.0 <= info["score"] <= 1.0
        if terminated or step % 30 == 29:
            _, info = env.reset()
            assert {path for path, _ in entries(info)} == keys


# ---- Pictures ----------------------------------------------------------------------------------------------


def test_frames_show_something_that_moves(identifier):
    fault = Fault(3, kinds_of(identifier)[0], severity=0.5)
    env = gym.make(identifier, faults=[fault], render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(3):
        env.step(constant(identifier, -0.6))
    last = env.render()
    env.close()
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 20
    assert np.count_nonzero(first != last) > 500


def test_a_vector_environment_draws_every_world(identifier):
    env = gym.make_vec(identifier, num_envs=2, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.stack(2 * [constant(identifier, -0.6)]))
    frames = env.render()
    env.close()
    assert len(frames) == 2
    assert not np.array_equal(frames[0], frames[1])


def test_an_episode_is_recorded_as_a_video(identifier, tmp_path):
    env = RecordVideo(
        gym.make(identifier, render_mode="rgb_array", max_episode_steps=4),
        str(tmp_path / "videos"),
        episode_trigger=lambda _: True,
        disable_logger=True,
    )
    env.reset(seed=0)
    for _ in range(4):
        env.step(constant(identifier, -0.8))
    env.close()
    (video,) = tmp_path.glob("videos/*.mp4")
    assert video.stat().st_size > 1000
