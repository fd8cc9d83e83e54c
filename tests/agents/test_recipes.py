"""Variants are what they say, evidence names what fails, and recipes are learnt, kept, and gone on with."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from thruster_agents import learn
from thruster_agents.recipes import VARIANTS, make, make_vec, recipes, variant_of
from thruster_agents.recipes import learning as training
from thruster_agents.recipes.comparison import fly_policy, fly_yardsticks
from thruster_agents.recipes.recipes import RECIPES, PPOSettings, Recipe, recipe_of
from thruster_baselines.control import SlotController
from thruster_baselines.detection import EvidenceObservation, VectorEvidenceObservation
from thruster_envs.rollout import fly

README = Path(__file__).parents[2] / "README.md"
TINY = Recipe(
    variant=variant_of("PulseDiagnosis-v0", "plain"),
    steps=256,
    ppo=PPOSettings(worlds=8, rollout=16, minibatch=64, epochs=1),
)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda one: f"{one.task}-{one.name}")
def test_a_variant_steps_alone_as_it_does_in_a_batch(variant):
    alone, batch = variant.make(), variant.make_vec(3, threads=1)
    assert batch.single_action_space == alone.action_space
    assert batch.single_observation_space == alone.observation_space
    one, _ = alone.reset(seed=11)
    many, _ = batch.reset(seed=10)
    np.testing.assert_array_equal(one, many[1])
    batch.action_space.seed(0)
    for _ in range(3):
        actions = batch.action_space.sample()
        one, reward, *_ = alone.step(actions[1])
        many, rewards, *_ = batch.step(actions)
        np.testing.assert_array_equal(one, many[1])
        assert reward == pytest.approx(rewards[1], abs=1e-12)
        assert alone.observation_space.contains(one)
    alone.close()
    batch.close()


def test_every_variant_stands_in_the_readme_as_it_is():
    lines = README.read_text(encoding="utf-8").splitlines()
    for one in VARIANTS:
        row = f"| `{one.task}` | `{one.name}` | {one.changes} |"
        assert row in lines, row


def test_there_are_at_most_three_variants_of_a_task_and_a_recipe_for_each_task_but_one():
    tasks = [one.task for one in VARIANTS]
    assert all(tasks.count(one) <= 3 for one in tasks)
    suite = {one.removeprefix("thruster_envs/") for one in gym.registry if one.startswith("thruster_envs/")}
    newest = {one for one in suite if f"{one[:-1]}{int(one[-1]) + 1}" not in suite}
    assert newest - {one.variant.task for one in RECIPES} == {"ThrusterMapping-v0"}  # which has train.py


def test_what_there_is_not_is_one_line_with_what_there_is():
    with pytest.raises(ValueError, match="did you mean 'OrionRendezvous-v1 near'"):
        make("OrionRendezvous-v1", "neer")
    with pytest.raises(ValueError, match="did you mean 'OrionRendezvous-near'"):
        recipe_of("OrionRendezvous-neer")
    with pytest.raises(ValueError, match="a number of control periods from 1 up"):
        EvidenceObservation(gym.make("thruster_envs/FaultDiagnosis-v1"), memory=0.5)
    with pytest.raises(ValueError, match="the observation of PulseDiagnosis has no 'duties'"):
        EvidenceObservation(gym.make("thruster_envs/PulseDiagnosis-v0"))


def evidence(fault, periods=60):
    """How likely each thruster is weak, leaks or is tilted, (3, 12), and both fitted sizes, (2, 12)."""
    env = make_vec("FaultDiagnosis-v1", "evidence", 2, faults=[] if fault is None else [fault], threads=1)
    observations, _ = env.reset(seed=3)
    for _ in range(periods):
        observations, *_ = env.step(np.zeros((2, 2), np.int64))
    added = observations[0, -60:].astype(float)
    env.close()
    return added[:36].reshape(3, 12), added[36:].reshape(2, 12)


@pytest.mark.parametrize(
    ("fault", "way", "size"),
    [
        ({"thruster": 4, "kind": "stuck_off"}, 0, -1.0),
        ({"thruster": 7, "kind": "loss", "severity": 0.5}, 0, -0.5),
        ({"thruster": 2, "kind": "leak", "severity": 0.3}, 1, 0.3),
        ({"thruster": 9, "kind": "misalignment", "severity": 0.4}, None, None),
    ],
    ids=lambda one: one["kind"] if isinstance(one, dict) else "",
)
def test_evidence_names_the_thruster_and_fits_the_size_roughly(fault, way, size):
    """Roughly: what the feed's coupling and the turning of the craft add is taken for part of the size."""
    likely, sizes = evidence(fault)
    assert likely.max(axis=0).argmax() == fault["thruster"] - 1
    assert likely.max() > 0.9
    if way is not None:
        assert sizes[way, fault["thruster"] - 1] == pytest.approx(size, rel=0.5)


def test_without_a_fault_there_is_no_evidence():
    assert evidence(None)[0].max() < 0.2


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda one: one.name)
def test_evidence_begins_anew_with_each_episode_in_any_autoreset_mode(mode):
    """The last observation of an episode has that of its whole flight, the first of the next has none."""
    beneath = gym.make_vec(
        "thruster_envs/FaultDiagnosis-v1", num_envs=2, faults=[{"thruster": 4, "kind": "stuck_off"}],
        autoreset_mode=mode, max_episode_steps=20, threads=1,
    )  # fmt: skip
    env, idle = VectorEvidenceObservation(beneath), np.zeros((2, 2), np.int64)
    first, _ = env.reset(seed=0)
    assert not first[:, -60:].any()
    for _ in range(20):
        last, _, _, truncated, infos = env.step(idle)
    assert truncated.all()
    if mode == AutoresetMode.SAME_STEP:
        assert infos["final_obs"][:, -60:].any(axis=1).all()
    elif mode == AutoresetMode.NEXT_STEP:
        assert last[:, -60:].any(axis=1).all()
        last, *_ = env.step(idle)
    else:
        last, _ = env.reset(options={"reset_mask": np.array([True, False])})
        assert last[1, -60:].any()
        last = last[:1]
    assert not last[:, -60:].any()


def test_a_state_that_was_saved_brings_the_evidence_back():
    env = make_vec("FaultDiagnosis-v1", "evidence", 2, threads=1)
    env.reset(seed=0)
    idle = np.zeros((2, 2), np.int64)
    for _ in range(5):
        env.step(idle)
    saved = env.save_state()
    wanted = env.step(idle)[0]
    env.step(idle)
    env.restore_state(saved)
    np.testing.assert_array_equal(env.step(idle)[0], wanted)


def test_the_law_without_memory_keeps_the_slot_and_goes_to_a_target_that_is_near():
    keeping = gym.make_vec(
        "thruster_envs/FormationKeeping-v1", num_envs=8, autoreset_mode="Disabled", threads=1
    )
    flown = fly(keeping, SlotController(keeping), range(8), record=("score", "success"))
    assert flown.final("score").mean() > 0.8
    near = variant_of("OrionRendezvous-v1", "near").plain().make_vec(
        8, autoreset_mode=AutoresetMode.DISABLED, threads=1
    )  # fmt: skip
    flown = fly(near, SlotController(near), range(8), record=("score", "success"))
    assert flown.final("score").mean() > 0.5


@pytest.fixture
def tiny(monkeypatch):
    """There is only one recipe, which takes a moment."""
    monkeypatch.setattr(recipes, "RECIPES", (TINY,))
    monkeypatch.setattr(learn, "RECIPES", (TINY,))


def test_the_command_learns_goes_on_and_writes_the_page(tiny, tmp_path, monkeypatch, capsys):
    page, folder = tmp_path / "page.md", tmp_path / "runs"
    arguments = ["--folder", str(folder), "--episodes", "4", "--results", str(page)]
    assert learn.main(["--seeds", "1", *arguments]) == 0
    done = folder / "PulseDiagnosis-plain" / "seed-0" / "result.json"
    before, learnt = done.read_bytes(), []
    real = learn.learn
    monkeypatch.setattr(learn, "learn", lambda one, seed, tell: learnt.append(seed) or real(one, seed, tell))
    assert learn.main(["PulseDiagnosis-plain", "--seeds", "2", *arguments]) == 0
    assert learnt == [1]
    assert done.read_bytes() == before
    text = page.read_text(encoding="utf-8")
    assert "| PulseDiagnosis-plain | Nothing: the task as it is. | 256 |" in text
    assert "| 2 |" in text
    assert (tmp_path / "page.png").read_bytes().startswith(b"\x89PNG")
    assert "PPO, 2 seeds" in capsys.readouterr().out
    scores = json.loads(before)["flown"]["healthy"]["score"]
    model = training.load(done.parent, TINY)
    again = fly_policy(TINY, lambda seen: model.predict(seen, deterministic=True)[0], 4)
    assert again["healthy"]["score"] == scores


def test_a_result_of_another_recipe_is_refused(tiny, tmp_path, monkeypatch, capsys):
    arguments = ["--folder", str(tmp_path), "--episodes", "4", "--seeds", "1"]
    assert learn.main(arguments) == 0
    other = replace(TINY, ppo=replace(TINY.ppo, epochs=2))
    monkeypatch.setattr(learn, "RECIPES", (other,))
    assert learn.main(arguments) == 2
    assert "made with recipe.ppo.epochs 1, got 2" in capsys.readouterr().err


@pytest.mark.nightly
def test_the_quickest_recipe_beats_nothing_and_random_actions():
    """With faults: where nothing ever fails, to call every pulse healthy is all that is right."""
    recipe = recipe_of("PulseDiagnosis-v0")
    learnt = training.learn(recipe, 0)
    flown = fly_policy(recipe, lambda seen: learnt.model.predict(seen, deterministic=True)[0], 64)
    others = fly_yardsticks(recipe, 64)
    least = max(np.mean(others[key]["faults"]["score"]) for key in ("nothing", "random"))
    assert np.mean(flown["faults"]["score"]) > least + 0.2
    assert learnt.minutes < 30.0
