"""What every view takes and refuses: seeds, actions, faults of a reset, calls before one; and flat infos."""

import gymnasium as gym
import numpy as np
import pytest

from tests.views.cases import FAULTS, IDS, constant, craft_of, entries, faults_of, kinds_of, world_of
from thruster_baselines.mapping import LPMapper
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.faults import Fault
from thruster_envs.tasks import FormationAttitude, FormationKeeping
from thruster_envs.views import (
    FormationAttitudeParallelEnv,
    FormationParallelEnv,
    HoldAction,
    MapperAction,
    SB3VecEnv,
    SharedPolicyVecEnv,
    VectorBeliefAction,
    VectorHoldAction,
    VectorMapperAction,
)

FORMATION, MAPPING = "thruster_envs/FormationKeeping-v1", "thruster_envs/ThrusterMapping-v0"
PARALLEL = {FormationKeeping: FormationParallelEnv, FormationAttitude: FormationAttitudeParallelEnv}


class Sb3:
    """An SB3 environment in the form of the others, as far as the tests here need it."""

    def __init__(self, env):
        self.env, self.num_envs = env, env.num_envs

    def reset(self, *, seed=None, options=None):
        if seed is not None:
            self.env.seed(seed)
        self.env.set_options(options)
        return self.env.reset(), self.env.latest_info()

    def step(self, action):
        return self.env.step(action)


VIEWS = {
    "single": lambda identifier, **k: gym.make(identifier, **k).unwrapped,
    "vector": lambda identifier, **k: gym.make_vec(identifier, num_envs=3, **k),
    "sb3": lambda identifier, **k: Sb3(SB3VecEnv(gym.make_vec(identifier, num_envs=3, **k))),
}


def faults_in(info):
    """Everything that an info says of the faults of an episode, whatever the view."""
    if "fault" not in info:
        return [faults_in(one) for one in info.values()]
    return [np.asarray(info["fault"][key]).tolist() for key in ("thruster", "kind", "severity", "onset")]


def fault_of(identifier, thruster=1):
    """A fault of the craft that the agent flies."""
    return Fault(thruster, kinds_of(identifier)[0], severity=0.1, craft=craft_of(identifier))


# ---- Faults of a reset -------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("identifier", IDS)
def test_no_faults_mean_the_same_to_make_and_to_reset(identifier, view):
    some = fault_of(identifier)
    made = VIEWS[view](identifier, faults=None)
    given = VIEWS[view](identifier, faults=[some])
    for seed in range(4):
        expected = faults_in(made.reset(seed=seed)[1])
        assert faults_in(given.reset(seed=seed, options={"faults": None})[1]) == expected
        assert faults_in(given.reset(seed=seed)[1]) != expected
    empty = given.reset(seed=0, options={"faults": []})[1]
    assert not np.any(empty["fault"]["thruster"])


@pytest.mark.parametrize("task", PARALLEL)
def test_no_faults_mean_the_same_to_the_views_of_formations(task):
    some = [Fault(1, "stuck_off") if task is FormationKeeping else Fault(1, "propellant_loss", severity=0.9)]
    for make in (
        lambda **k: PARALLEL[task](**k),
        lambda **k: Sb3(SharedPolicyVecEnv(2, task_type=task, **k)),
    ):
        made, given = make(faults=None), make(faults=some)
        expected = faults_in(made.reset(seed=0)[1])
        assert faults_in(given.reset(seed=0, options={"faults": None})[1]) == expected


@pytest.mark.parametrize("identifier", IDS)
def test_every_world_of_a_batch_can_have_faults_of_its_own(identifier):
    some, drawn = [fault_of(identifier)], faults_of(identifier)
    batch, alone = gym.make_vec(identifier, num_envs=4), gym.make(identifier)
    own = [some, [], drawn, None]
    _, infos = batch.reset(seed=5, options={"faults": own})
    for world, faults in enumerate(own):
        _, info = alone.reset(seed=5 + world, options={"faults": faults})
        assert world_of(infos, world)["fault.thruster"].tolist() == info["fault"]["thruster"].tolist()
        assert world_of(infos, world)["fault.severity"].tolist() == info["fault"]["severity"].tolist()
    mask = np.array([False, True, False, False])
    _, infos = batch.reset(options={"faults": [[], some, [], []], "reset_mask": mask})
    assert infos["fault"]["thruster"][:2, 0].tolist() == [1, 1]
    with pytest.raises(ValueError, match=r"faults has 2 entries, .* one for each of the 4 worlds"):
        batch.reset(options={"faults": [some, []]})
    with pytest.raises(ValueError, match=r"world 1: .*thruster"):
        batch.reset(options={"faults": [some, [fault_of(identifier, 99)], [], []]})


# ---- Seeds -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("identifier", IDS)
def test_the_seed_of_the_generator_repeats_an_episode_that_began_without_one(identifier):
    single, batch = gym.make(identifier), gym.make_vec(identifier, num_envs=3)
    for env in (single, batch):
        first, other = env.reset()[0], env.reset()[0]
        seed = env.unwrapped.np_random_seed
        assert np.array_equal(env.reset(seed=seed)[0], first)
        assert np.array_equal(env.reset()[0], other)
        assert not np.array_equal(first, other)
    first = single.reset(seed=batch.unwrapped.np_random_seed)[0]
    assert np.array_equal(first, batch.reset(seed=batch.unwrapped.np_random_seed)[0][0])


def test_seeds_of_single_worlds_are_kept_too():
    env = gym.make_vec(FORMATION, num_envs=3)
    first = env.reset(seed=[7, None, 9])[0]
    assert env.np_random_seed[0::2] == (7, 9)
    assert np.array_equal(env.reset(seed=env.np_random_seed)[0], first)
    env.reset(seed=4)
    assert env.np_random_seed == 4


def test_a_generator_of_ones_own_is_drawn_from():
    first, second = gym.make(FORMATION).unwrapped, gym.make(FORMATION).unwrapped
    for env in (first, second):
        env.np_random = np.random.default_rng(3)
    assert np.array_equal(first.reset()[0], second.reset()[0])


@pytest.mark.parametrize("task", PARALLEL)
def test_agents_too_can_repeat_an_episode_that_began_without_a_seed(task):
    env = PARALLEL[task]()
    assert env.np_random_seed is None
    first, _ = env.reset()
    again, _ = env.reset(seed=env.np_random_seed)
    assert all(np.array_equal(first[agent], again[agent]) for agent in first)


BAD_SEEDS = [-1, 1.5, "7", 2**128, 10**400, 10**5000, np.float64(3.0), [1], (2,), {}, np.array([3]), 1j]


def refuses(call, match, *errors):
    with pytest.raises(errors or (ValueError,), match=match) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("seed", BAD_SEEDS, ids=lambda seed: str(type(seed)))
def test_a_bad_seed_is_refused_by_every_view_in_one_line(seed):
    env = gym.make_vec(FORMATION, num_envs=3)
    worlds = [
        lambda: gym.make(FORMATION).unwrapped.reset(seed=seed),
        lambda: FormationParallelEnv().reset(seed=seed),
        lambda: SB3VecEnv(env).seed(seed),
        lambda: SharedPolicyVecEnv(2).seed(seed),
        lambda: env.reset(seed=[1, seed, 3]),
    ]
    for call in worlds:
        refuses(call, "seed must be a whole number from 0")
    refuses(lambda: env.reset(seed=seed), "seed must (be a whole number|have 3 entries)")


def test_numpys_whole_numbers_are_seeds():
    first = gym.make(FORMATION).reset(seed=5)[0]
    for seed in (np.int64(5), np.uint8(5), np.array(5)):
        assert np.array_equal(gym.make(FORMATION).unwrapped.reset(seed=seed)[0], first)
        assert np.array_equal(gym.make_vec(FORMATION, num_envs=2).reset(seed=seed)[0][0], first)
    for seeds in (np.array([5, 6]), (np.int32(5), 6), range(5, 7)):
        assert np.array_equal(gym.make_vec(FORMATION, num_envs=2).reset(seed=seeds)[0][0], first)


# ---- Actions -----------------------------------------------------------------------------------------------


def bad_actions(action):
    """What is no action, by name, from one that is."""
    size = action.size
    wrong = {
        "text": action.astype(str),
        "complex": action.astype(complex),
        "objects": action.astype(object),
        "a column": action[..., np.newaxis],
        "flat or deeper": action.ravel() if action.ndim > 1 else action[np.newaxis],
        "one too many": np.zeros((size + 1, *action.shape[1:])),
        "a word": "full",
        "nothing": None,
        "too large": np.full(action.shape, 10**400).tolist(),
        "ragged": [[0.0], [0.0, 0.0]],
    }
    return wrong | ({"switches": action > 0.0} if action.dtype.kind == "f" else {})


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("identifier", IDS)
def test_what_is_no_action_is_refused_in_one_line(identifier, view):
    env, action = VIEWS[view](identifier), constant(identifier, -0.5)
    env.reset(seed=0)
    if view != "single":
        action = np.stack(3 * [action])
    for wrong in bad_actions(action).values():
        refuses(lambda wrong=wrong: env.step(wrong), "the action (has|must be real)")
    env.step(action)
    env.step(action.tolist())


def test_what_is_no_action_is_refused_by_formations_and_wrappers_too():
    parallel, shared = FormationParallelEnv(), SharedPolicyVecEnv(2, craft=2)
    parallel.reset(seed=0)
    shared.reset()
    action = np.full(12, -0.5, np.float32)
    for wrong in bad_actions(action).values():
        actions = {"craft_1": action, "craft_2": wrong, "craft_3": action}
        refuses(lambda actions=actions: parallel.step(actions), "the action of craft_2 (has|must be real)")
    refuses(lambda: parallel.step([action] * 3), "actions must be a dict from agent to action, got list")
    for wrong in bad_actions(np.stack(4 * [action])).values():
        refuses(lambda wrong=wrong: shared.step(wrong), "the action (has|must be real)")
    mapper = LPMapper("orion", threads=1)
    wrapped = MapperAction(gym.make(FORMATION), mapper)
    batch = VectorMapperAction(gym.make_vec(FORMATION, num_envs=2), mapper)
    wrapped.reset(seed=0)
    batch.reset(seed=0)
    for wrong in bad_actions(action[:6]).values():
        refuses(lambda wrong=wrong: wrapped.step(wrong), "the action (has|must be real)")
    for wrong in bad_actions(np.stack(2 * [action[:6]])).values():
        refuses(lambda wrong=wrong: batch.step(wrong), "the action (has|must be real)")


@pytest.mark.parametrize("threads", [0, -1, "2", 1.5, True, 2**40])
def test_a_number_of_threads_that_cannot_be_is_refused(threads):
    refuses(
        lambda: gym.make_vec(FORMATION, num_envs=2, threads=threads), "threads is .*; a whole number from 1"
    )
    refuses(lambda: SharedPolicyVecEnv(2, threads=threads), "threads is .*; a whole number from 1")


@pytest.mark.parametrize("options", [5, "faults", [{}], True])
def test_options_that_are_no_dictionary_are_refused(options):
    for env in (gym.make(FORMATION).unwrapped, gym.make_vec(FORMATION, num_envs=1), FormationParallelEnv()):
        refuses(lambda env=env: env.reset(options=options), "options must be a dict or None, got")


# ---- Before the first reset --------------------------------------------------------------------------------


def before_reset():
    """Name to a call that needs an episode, in every view."""
    twelve, mapper = np.zeros(12), LPMapper("orion", threads=1)
    make = lambda **k: gym.make(FORMATION, **k).unwrapped  # noqa: E731
    batch = lambda **k: gym.make_vec(FORMATION, num_envs=2, **k)  # noqa: E731
    calls = {
        "single step": lambda: make().step(twelve),
        "single render": lambda: make(render_mode="rgb_array").render(),
        "vector step": lambda: batch().step([twelve] * 2),
        "vector step_held": lambda: batch().step_held([twelve] * 2, 3),
        "vector render": lambda: batch(render_mode="rgb_array").render(),
        "parallel step": lambda: FormationParallelEnv().step(dict.fromkeys(["craft_1"], twelve)),
        "parallel state": lambda: FormationParallelEnv().state(),
        "parallel render": lambda: FormationParallelEnv(render_mode="rgb_array").render(),
        "sb3 step": lambda: SB3VecEnv(batch()).step(np.zeros((2, 12))),
        "sb3 latest_info": lambda: SB3VecEnv(batch()).latest_info(),
        "sb3 images": lambda: SB3VecEnv(batch(render_mode="rgb_array")).get_images(),
        "shared step": lambda: SharedPolicyVecEnv(2).step(np.zeros((6, 12))),
        "shared latest_info": lambda: SharedPolicyVecEnv(2).latest_info(),
        "mapper": lambda: VectorMapperAction(batch(), mapper).step(np.zeros((2, 6))),
        "hold": lambda: VectorHoldAction(batch(), 3).step(np.zeros((2, 12))),
        "single hold": lambda: HoldAction(make(), 3).step(twelve),
        "single mapper": lambda: MapperAction(make(), mapper).step(np.zeros(6)),
        "belief": lambda: VectorBeliefAction(gym.make_vec(MAPPING, num_envs=2), mapper).step(
            np.zeros((2, 12))
        ),
    }
    for module in (formation_keeping_v1, formation_attitude_v1):
        for name in ("raw_env", "env"):
            calls[f"{module.__name__} {name} state"] = lambda m=module, n=name: getattr(m, n)().state()
    return calls


@pytest.mark.parametrize("name", before_reset())
def test_a_call_before_the_first_reset_says_so(name):
    refuses(before_reset()[name], r"call reset\(\) before|reset\(\) needs to be called before", Exception)


def test_what_needs_no_episode_works_before_the_first_reset():
    batch = gym.make_vec(FORMATION, num_envs=2)
    assert not batch.pending_resets.any()
    other = gym.make_vec(FORMATION, num_envs=2)
    other.reset(seed=0)
    other.restore_state(batch.save_state())
    with pytest.raises(gym.error.ResetNeeded):
        other.step(np.zeros((2, 12)))
    for env in (gym.make(FORMATION), batch, FormationParallelEnv(), SB3VecEnv(batch), SharedPolicyVecEnv(2)):
        env.close()


def test_a_first_reset_that_fails_begins_nothing():
    env = gym.make(FORMATION).unwrapped
    with pytest.raises(ValueError, match="thruster"):
        env.reset(seed=0, options={"faults": [Fault(99, "stuck_off")]})
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(12))
    assert np.array_equal(env.reset(seed=0)[0], gym.make(FORMATION).reset(seed=0)[0])


# ---- Flat infos --------------------------------------------------------------------------------------------


def paths(info):
    """An info with dictionaries in it as one without, keys joined by a slash."""
    return {path.replace(".", "/"): value for path, value in entries(info)}


def unmasked(info):
    return {key: value for key, value in info.items() if not key.startswith("_")}


@pytest.mark.parametrize("identifier", IDS)
def test_flat_infos_say_the_same_in_numpys_types(identifier):
    options = {"faults": faults_of(identifier)}
    nested, flat = gym.make(identifier, **options), gym.make(identifier, flat_info=True, **options)
    pairs = [(nested.reset(seed=1)[1], flat.reset(seed=1)[1])]
    pairs += [(nested.step(action)[4], flat.step(action)[4]) for action in 3 * [constant(identifier, -0.9)]]
    for first, second in pairs:
        first = paths(first)
        assert first.keys() == second.keys()
        assert all(isinstance(value, (np.generic, np.ndarray)) for value in second.values())
        assert all(np.array_equal(first[key], second[key]) for key in first)
        assert {key: value.dtype for key, value in second.items()} == {
            key: value.dtype for key, value in pairs[0][1].items()
        }


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("identifier", IDS)
def test_flat_infos_of_a_batch_have_a_mask_for_every_key(identifier, mode):
    arguments = {
        "num_envs": 2,
        "faults": faults_of(identifier),
        "max_episode_steps": 2,
        "autoreset_mode": mode,
    }
    nested = gym.make_vec(identifier, **arguments)
    flat = gym.make_vec(identifier, flat_info=True, **arguments)
    pairs = [(nested.reset(seed=1)[1], flat.reset(seed=1)[1])]
    action = np.stack(2 * [constant(identifier, -0.9)])
    pairs += [(nested.step(action)[4], flat.step(action)[4]) for _ in range(3)]
    assert any("final_info" in flat for _, flat in pairs) == (mode == "SameStep")
    for first, second in pairs:
        endings = [
            (infos.pop("final_info"), infos.pop("_final_info"))
            for infos in (first, second)
            if "final_info" in infos
        ]
        assert len(endings) in (0, 2)
        for one, two in [(first, second), *([(endings[0][0], endings[1][0])] if endings else [])]:
            assert all(isinstance(value, np.ndarray) for value in two.values())
            assert unmasked(two).keys() | {f"_{key}" for key in unmasked(two)} == two.keys()
            expected = {
                key: value
                for key, value in paths(one).items()
                if "_" not in {part[0] for part in key.split("/")}
            }
            assert expected.keys() == unmasked(two).keys()
            assert all(np.array_equal(expected[key], two[key]) for key in expected)


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_flat_infos_of_agents(module):
    nested, flat = module.parallel_env(), module.parallel_env(flat_info=True)
    first, second = nested.reset(seed=1)[1], flat.reset(seed=1)[1]
    for agent in flat.agents:
        assert paths(first[agent]).keys() == second[agent].keys()
        assert all(isinstance(value, (np.generic, np.ndarray)) for value in second[agent].values())
    turns = module.env(flat_info=True)
    turns.reset(seed=1)
    assert not any(isinstance(value, dict) for value in turns.infos[turns.agents[0]].values())


def test_flat_infos_go_through_the_wrappers():
    nested, flat = (HoldAction(gym.make(FORMATION, faults=FAULTS, flat_info=f), 3) for f in (False, True))
    nested.reset(seed=2)
    flat.reset(seed=2)
    for _ in range(3):
        first, second = nested.step(np.full(12, -0.8))[4], flat.step(np.full(12, -0.8))[4]
        assert paths(first).keys() == second.keys()
        assert all(np.array_equal(paths(first)[key], second[key]) for key in second)
    env = SB3VecEnv(gym.make_vec(FORMATION, num_envs=2, flat_info=True, max_episode_steps=2))
    env.reset()
    for _ in range(2):
        *_, infos = env.step(np.full((2, 12), -0.8, np.float32))
    assert {"score", "success", "is_success", "cost", "fuel"} <= infos[0].keys()
    shared = SharedPolicyVecEnv(2, flat_info=True)
    shared.reset()
    assert "fault/thruster" in shared.latest_info()


def test_an_argument_that_is_no_truth_value_is_refused():
    for make in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match="flat_info must be True or False, got 1"):
            make(FORMATION, flat_info=1)
