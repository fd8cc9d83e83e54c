"""The command `train.py`: what it leaves, what it refuses, and that it goes on after an interruption."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

import thruster_agents
import train
from tests.agents.runs import TASK, TINY
from thruster_agents.checkpoints import read_tree
from thruster_agents.evaluation import FAULTS, play
from thruster_agents.evaluation.methods import Learned
from thruster_agents.run_folders import RunFolder
from thruster_envs.seeds import TEST

ROWS = [
    *("oracle", "ppo_beliefs", "ppo_duties", "response_test", "blind", "minimum_norm", "crude", "nothing"),
    "random",
]


def test_a_run_leaves_everything_that_tells_what_it_was(run):
    assert run.name.endswith("-tiny")
    config, versions, metrics = (
        json.loads((run / f"{name}.json").read_text()) for name in ("config", "versions", "metrics")
    )
    assert config["belief_steps"] == 768
    assert {"python", "torch", "thruster-envs", "numpy"} <= versions.keys()
    assert [row["key"] for row in metrics["rows"]] == ROWS
    assert [point[0] for point in metrics["curves"]["beliefs"][0]] == [0, 256, 512, 768]
    for name in ("learning_curve.png", "comparison.png"):
        assert (run / name).read_bytes().startswith(b"\x89PNG")
    for form in ("beliefs-0", "duties-0"):
        assert (run / form / "policy.safetensors").exists()
        assert list((run / "tensorboard" / form).glob("events.*"))
    page = (run.parent / "results.md").read_text()
    assert page.count("\n| ") == len(ROWS) + 1
    assert "python train.py" in page


def test_a_trained_policy_is_loaded_and_scores_what_the_table_says(run, orion):
    metrics = json.loads((run / "metrics.json").read_text())
    for method in ("beliefs", "duties"):
        policy = thruster_agents.load(TASK, method, runs=run.parent)
        learned = Learned(policy.model, policy.form, "")
        score = play(learned, FAULTS, TEST[:20], orion).scores.mean()
        (row,) = (row for row in metrics["rows"] if row["key"] == f"ppo_{method}")
        assert score == row["cells"]["faults"]["score"]
        env = policy.make_vec(3)
        observations, _ = env.reset(seed=0)
        assert env.single_action_space.contains(policy.act(observations)[0].clip(-1.0, 1.0))


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("other-v0",), "task_id is 'other-v0'; 'thruster_envs/ThrusterMapping-v0' would be right"),
        ((TASK, "belief"), "method is 'belief'; 'beliefs' or 'duties' would be right"),
    ],
)
def test_what_was_never_trained_is_not_loaded(run, arguments, line):
    with pytest.raises(ValueError, match=line):
        thruster_agents.load(*arguments, runs=run.parent)
    with pytest.raises(ValueError, match="has no finished run"):
        thruster_agents.load(TASK, runs=run)
    with pytest.raises(ValueError, match="does not exist"):
        thruster_agents.load(TASK, run=run, seed=7)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--worlds", "0"], "worlds must be a whole number from 1 to 100000, got 0"),
        (["--spacecraft", "orin"], "orin"),
        (["--discount", "1.5"], "discount must be a number from 0 to 1, got 1.5"),
        (["--learning-rate", "nan"], "learning_rate must be a number from 1e-09 to 10, got nan"),
        (["--seed", "4000"], "seed is 4000; with 256 worlds, a whole number from 0 to 3905 would be right"),
        (["--belief-steps", "0", "--duty-steps", "0"], "belief_steps or duty_steps must be above 0, got 0"),
        (["--name", "a/b"], "name must be letters, digits, - and _, at most 100 bytes, got 'a/b'"),
        (["--resume", "nowhere"], "nowhere has no config.json; the folder of a run is needed"),
    ],
)
def test_a_bad_option_gets_one_clear_line(options, line, tmp_path, capsys):
    assert train.main([*options, "--runs", str(tmp_path / "runs")]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_another_option_does_not_go_with_resume(run, capsys):
    assert train.main(["--resume", str(run), "--worlds", "16"]) == 2
    assert "--worlds is 16 with --resume" in capsys.readouterr().err


def test_a_killed_run_goes_on_to_the_same_result(run, tmp_path):
    """kill -9 as soon as there is a checkpoint of the second policy; the same metrics, to the last digit."""
    command = [sys.executable, "train.py", *TINY, "--name", "killed", "--runs", str(tmp_path)]
    with subprocess.Popen(command, cwd=Path(train.__file__).parent, stdout=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 240.0
        while not list(tmp_path.glob("*/duties-0/checkpoint-*")) and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.005)
        os.kill(process.pid, signal.SIGKILL)
    (folder,) = tmp_path.iterdir()
    assert train.main(["--resume", str(folder)]) == 0
    _assert_same(folder, run)


@pytest.mark.nightly
def test_a_run_killed_ten_times_goes_on_to_the_same_result(run, tmp_path):
    """kill -9 at ten moments of a run that is resumed each time: while it loads, trains, writes, compares."""
    rng = np.random.default_rng(5)
    command = [sys.executable, "train.py", *TINY, "--name", "killed", "--runs", str(tmp_path)]
    folder, lines = None, []
    for _ in range(10):
        with subprocess.Popen(
            command,
            cwd=Path(train.__file__).parent,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            said = process.stdout.readline()
            assert said.startswith("run folder "), process.stderr.read()
            folder = Path(said.removeprefix("run folder ").rstrip())
            time.sleep(rng.uniform(0.0, 4.0))
            process.send_signal(signal.SIGKILL)
            lines += process.stderr.read().splitlines()
        command = [sys.executable, "train.py", "--resume", str(folder)]
    assert lines == []
    assert train.main(["--resume", str(folder)]) == 0
    assert not list(folder.rglob("*.unfinished"))
    _assert_same(folder, run)


def _assert_same(folder, run):
    """The same metrics, weights and table, to the last bit."""
    assert RunFolder(folder).read("metrics.json") == RunFolder(run).read("metrics.json")
    for form in ("beliefs-0", "duties-0"):
        first, second = (read_tree(one / form / "policy.safetensors")["policy"] for one in (run, folder))
        assert all(torch.equal(first[name], second[name]) for name in first)
