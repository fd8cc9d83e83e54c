"""Run folders hold all that a run depends on, and no damage or foreign value in them does harm."""

import contextlib
import json
import os
import pickle
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest
import torch

import thruster_agents
import train
from tests.agents.runs import TASK, TINY
from thruster_agents.checkpoints import read_tree, write_tree
from thruster_agents.files import locked, write_whole
from thruster_agents.ppo import train as train_policy
from thruster_agents.run_folders import RunFolder
from thruster_envs.spacecraft import load, save


@pytest.fixture
def copy(run, tmp_path):
    """A copy of the finished run, to be spoilt."""
    folder = shutil.copytree(run, tmp_path / "copy")
    _changed(folder / "config.json", results=None)
    return folder


def _changed(path, **changes):
    content = json.loads(path.read_text())
    path.write_text(json.dumps({k: v for k, v in (content | changes).items() if v is not ...}))


def _refused(folder, capsys, *options):
    """The line with which a resumption is refused."""
    assert train.main(["--resume", str(folder), *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    """A run on a vehicle in a file, interrupted after two rollouts."""
    folder = tmp_path_factory.mktemp("mine")
    save(load("orion"), folder / "mine.toml")
    command = [*TINY, "--duty-steps", "0", "--spacecraft", str(folder / "mine.toml"), "--name", "broken"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "compare", lambda *_: _interrupt())
        assert train.main([*command, "--runs", str(folder / "runs")]) == 130
    (run,) = (folder / "runs").iterdir()
    return folder / "mine.toml", run


def _interrupt():
    raise KeyboardInterrupt


def test_a_vehicle_that_has_changed_is_not_flown_on(interrupted, capsys):
    """20 kg when the run began, 60 kg when it is resumed."""
    mine, run = interrupted
    before = mine.read_text()
    try:
        save(load("orion").replace(mass=60.0), mine)
        line = _refused(run, capsys)
    finally:
        mine.write_text(before)
    assert f"{mine}: mass is 60.0, and was 20.0 when the run began" in line


def test_a_policy_comes_back_with_its_vehicle_from_anywhere(interrupted, tmp_path, monkeypatch):
    mine, run = interrupted
    moved = shutil.copytree(run, tmp_path / "elsewhere")
    before = mine.read_text()
    mine.unlink()
    monkeypatch.chdir(tmp_path)
    try:
        policy = thruster_agents.load(TASK, run="elsewhere")
    finally:
        mine.write_text(before)
    assert policy.spacecraft == load("orion")
    assert moved.is_dir()


def test_the_vehicle_in_the_folder_is_that_of_the_weights(copy, capsys):
    save(load("orion").replace(mass=60.0), copy / "spacecraft.toml")
    with pytest.raises(ValueError, match=r"made with spacecraft\.mass = 20\.0, now it is 60\.0"):
        thruster_agents.load(TASK, run=copy)
    assert "orion: mass is 20.0, and was 60.0 when the run began" in _refused(copy, capsys)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"worlds": 0}, "worlds must be a whole number from 1 to 100000, got 0"),
        ({"discount": 5}, "discount must be a number from 0 to 1, got 5.0"),
        ({"epochs": 0}, "epochs must be a whole number from 1 to 1000, got 0"),
        ({"test_worlds": 1e9}, "test_worlds must be a whole number from 1 to 500000, got 1000000000"),
        ({"learning_rate": float("inf")}, "is not JSON (Infinity is not a number of JSON)"),
        ({"trace": float("nan")}, "is not JSON (NaN is not a number of JSON)"),
        ({"worlds": 10**50}, "worlds must be a whole number of 64 bits, got 1000000000000000000000"),
        ({"worlds": "8"}, "worlds is '8'; a whole number would be right"),
        ({"worlds": True}, "worlds is True; a whole number would be right"),
        ({"worlds": [8]}, "worlds is [8]; a whole number would be right"),
        ({"name": "../../x"}, "name must be letters, digits, - and _"),
        ({"wolds": 8}, "unknown key 'wolds'; did you mean 'worlds'?"),
        ({"worlds": ...}, "the key 'worlds' is missing"),
        ({"threads": 1000}, "threads must be at most"),
        ({"minibatch": 1}, "minibatch must be a whole number from 2"),
        ({"spacecraft": None}, "spacecraft is None"),
    ],
)
def test_a_configuration_is_checked_as_options_are(copy, changes, line, capsys):
    _changed(copy / "config.json", **changes)
    assert line in _refused(copy, capsys)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (b"", "is not JSON"),
        (b"[]", "must hold a JSON object, got list"),
        (b"\xff\xfe{\x00}\x00", "must be UTF-8 text, got UTF-16"),
        (b'{"worlds": 8, "worlds": 9}', "the key 'worlds' stands twice"),
        (b'{"worlds": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", "is nested more than 32 deep"),
        (b'{"worlds": ' + b"[" * 40 + b"]" * 40 + b"}", "is nested more than 32 deep"),
        (b'{"worlds": ' + b"9" * 5000 + b"}", "is not JSON (Exceeds the limit"),
    ],
)
def test_a_configuration_that_is_none_gets_one_line(copy, text, line, capsys):
    (copy / "config.json").write_bytes(text)
    assert line in _refused(copy, capsys)


def test_a_foreign_configuration_names_no_place_to_write(copy, tmp_path, capsys):
    victim = tmp_path / "victim.txt"
    victim.write_text("mine")
    _changed(copy / "config.json", results=str(victim))
    table = tmp_path / "table.md"
    assert train.main(["--resume", str(copy), "--results", str(table)]) == 0
    assert victim.read_text() == "mine"
    assert table.read_text().startswith("# Thruster mapping")
    assert train.main(["--resume", str(copy), "--results", str(tmp_path)]) == 2


def test_settings_of_another_training_are_named(copy, capsys):
    _changed(copy / "config.json", discount=0.25)
    with pytest.raises(ValueError, match=r"made with discount = 0\.5, now it is 0\.25"):
        thruster_agents.load(TASK, run=copy)
    assert train.main(["--resume", str(copy)]) == 1
    assert "made with discount = 0.5, now it is 0.25" in capsys.readouterr().err


def test_another_task_than_the_run_began_with_is_named(copy, capsys):
    content = json.loads((copy / "task.json").read_text())
    content["faults"]["probability"] = 0.5
    (copy / "task.json").write_text(json.dumps(content))
    assert "faults.probability was 0.5 when the run began and is 0.8" in _refused(copy, capsys)
    with pytest.raises(ValueError, match=r"faults\.probability was 0\.5"):
        thruster_agents.load(TASK, run=copy)


@pytest.mark.parametrize("name", ["config.json", "spacecraft.toml", "task.json"])
def test_a_file_that_is_missing_is_named(copy, name, capsys):
    (copy / name).unlink()
    assert name in _refused(copy, capsys)
    with pytest.raises(ValueError, match=name):
        thruster_agents.load(TASK, run=copy)
    (copy / name).mkdir()
    assert name in _refused(copy, capsys)


def _spoilt(whole, kind):
    rng = np.random.default_rng(0)
    if kind == "garbled":
        return bytes(byte ^ 1 if number == len(whole) // 2 else byte for number, byte in enumerate(whole))
    return {
        "empty": b"",
        "half": whole[: len(whole) // 2],
        "noise": rng.bytes(2000),
        "huge header": (2**62).to_bytes(8, "little") + b"{}",
        "pickle": pickle.dumps({"policy": 1}),
        "deep": (200_000).to_bytes(8, "little") + b'{"a":' * 40_000,
    }[kind]


@pytest.mark.parametrize("kind", ["empty", "half", "garbled"])
def test_the_last_whole_checkpoint_is_used(copy, run, kind, capsys):
    """One line says which is damaged, and the result is that of the whole run."""
    before, last = sorted((copy / "beliefs-0").glob("checkpoint-*"))
    last.write_bytes(_spoilt(last.read_bytes(), kind))
    (copy / "beliefs-0" / "policy.safetensors").unlink()
    (copy / "versions.json").write_text("[1, 2]")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "compare", lambda *_: _interrupt())
        assert train.main(["--resume", str(copy)]) == 130
    lines = capsys.readouterr().err.splitlines()
    assert "versions.json must hold a JSON object, got list; versions are not compared" in lines[0]
    assert f"{last} is damaged" in lines[1]
    assert lines[1].endswith(f"going on from {before.name}")
    assert len(lines) == 3  # the last one says how to go on
    weights = [read_tree(one / "beliefs-0" / "policy.safetensors")["policy"] for one in (run, copy)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


@pytest.mark.parametrize("kind", ["empty", "half", "garbled", "noise", "huge header", "pickle", "deep"])
def test_a_damaged_file_is_one_line(run, kind, tmp_path):
    path = tmp_path / "policy.safetensors"
    path.write_bytes(_spoilt((run / "duties-0" / path.name).read_bytes(), kind))
    with pytest.raises(ValueError, match="is damaged") as caught:
        read_tree(path)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def settings(orion):
    """Of the tiniest training: two rollouts of one world."""
    return train.Configuration(
        worlds=1, belief_steps=64, validation_worlds=1, checkpoint_every=1, minibatch=32, epochs=1
    ).settings("beliefs", 0, orion)


@pytest.fixture(scope="module")
def trained(settings, tmp_path_factory):
    """Its folder."""
    folder = tmp_path_factory.mktemp("trained")
    train_policy(settings, folder)
    return folder


def test_without_a_whole_checkpoint_training_begins_anew(settings, trained, tmp_path):
    folder = shutil.copytree(trained, tmp_path / "copy")
    for path in folder.glob("checkpoint-*"):
        path.write_bytes(b"")
    lines = []
    train_policy(settings, folder, tell=lines.append)
    assert len(lines) == 2
    assert lines[1].endswith("going on from the beginning")
    weights = [read_tree(one / "policy.safetensors")["policy"] for one in (trained, folder)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


def _set(tree, path, value):
    for name in path[:-1]:
        tree = tree[name]
    if value is ...:
        del tree[path[-1]]
    else:
        tree[path[-1]] = value


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["policy"], {}),
        (["policy", "log_std"], torch.full((12,), np.nan)),
        (["policy", "log_std"], torch.zeros(10**6)),
        (["worlds"], ...),
        (["worlds", "over"], np.zeros(3)),
        (["optimizer"], [1]),
        (["optimizer", 0, "exp_avg"], torch.zeros(1)),
        (["counters", "num_timesteps"], -5),
        (["counters", "num_timesteps"], "5"),
        (["last_observation"], np.zeros((1, 3), np.float32)),
        (["numpy"], ["MT19937", np.zeros(624, np.uint32), 10**9, 0, 0.0]),
        (["python"], (3, (2**40,) * 625, None)),
        (["python"], 5),
        (["torch"], torch.zeros(3, dtype=torch.uint8)),
        (["curve"], [(0, "x")]),
        (["seconds"], None),
    ],
)
def test_a_checkpoint_that_says_something_else_gets_one_line(settings, trained, tmp_path, path, value):
    """Its checksum is right: somebody made it so."""
    last = max(shutil.copytree(trained, tmp_path / "copy").glob("checkpoint-*"))
    tree = read_tree(last)
    _set(tree, path, value)
    write_tree(last, tree)
    with pytest.raises(ValueError, match=last.name) as caught:
        train_policy(settings, last.parent)
    assert "\n" not in str(caught.value)


class _Planted:
    def __reduce__(self):
        return os.mkdir, (os.environ["PLANTED"],)


@pytest.mark.parametrize("name", ["model.zip", "policy.safetensors", "checkpoint.pt"])
def test_no_planted_code_is_run(copy, name, tmp_path, monkeypatch):
    monkeypatch.setenv("PLANTED", str(tmp_path / "planted"))
    with zipfile.ZipFile(tmp_path / "evil", "w") as file:
        for inside in ("data.pkl", "policy.pth", "archive/data.pkl"):
            file.writestr(inside, pickle.dumps(_Planted()))
    for form in ("beliefs-0", "duties-0"):
        (copy / form / "policy.safetensors").unlink()
        for path in (copy / form).glob("checkpoint-*"):
            path.write_bytes(pickle.dumps(_Planted()))
        (copy / form / name).write_bytes((tmp_path / "evil").read_bytes())
    right = (
        "model.zip is of an earlier version and is not opened"
        if name == "model.zip"
        else "policy.safetensors"
    )
    with pytest.raises(ValueError, match=right):
        thruster_agents.load(TASK, run=copy)
    if name == "checkpoint.pt":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(train, "compare", lambda *_: _interrupt())
            assert train.main(["--resume", str(copy)]) == 130
    assert not (tmp_path / "planted").exists()


def test_the_newest_run_is_the_one_that_was_finished_last(run, tmp_path):
    """Whatever the folders are called."""
    for name, age in (("z", 100), ("a", 0), ("m", 50)):
        folder = shutil.copytree(run, tmp_path / name)
        _changed(folder / "metrics.json", of=name)
        os.utime(folder / "metrics.json", (10**9 - age, 10**9 - age))
    (tmp_path / "a" / "spacecraft.toml").unlink()
    with pytest.raises(ValueError, match=r"a/spacecraft\.toml does not exist"):
        thruster_agents.load(TASK, runs=tmp_path)


def test_one_process_at_a_time_uses_a_run(copy, capsys):
    """A process that is killed leaves no lock behind."""
    program = (
        "import sys, time; from pathlib import Path; from thruster_agents.files import locked\n"
        "with locked(Path(sys.argv[1])): print('held', flush=True); time.sleep(600)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(copy)], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "held\n"
        line = _refused(copy, capsys)
        assert f"{copy} is in use by process {other.pid} on " in line
        other.kill()
    with locked(copy):
        pass


def test_a_lock_is_no_way_to_another_file(tmp_path):
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "lock").symlink_to(tmp_path / "victim")
    with pytest.raises(ValueError, match="cannot be written to"), locked(tmp_path):
        pass
    assert (tmp_path / "victim").read_text() == "mine"


def test_a_full_disk_leaves_what_there_was(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_whole(path, b"before")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, b"after")
    assert [one.name for one in tmp_path.iterdir()] == ["file"]
    assert path.read_bytes() == b"before"


def test_a_disk_that_fills_up_ends_a_run_with_one_line(copy, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, "No space left on device", str(copy))

    monkeypatch.setattr("thruster_agents.ppo.checkpoint.write_tree", full)
    assert train.main(["--resume", str(copy)]) == 1
    error = capsys.readouterr().err
    assert f"No space left on device ({copy}); to go on: python train.py --resume {copy}" in error
    assert error.count("\n") == 1


def test_what_killed_processes_left_is_removed(copy):
    for folder in (copy, copy / "beliefs-0"):
        (folder / ".123-abc.unfinished").write_bytes(b"half")
    RunFolder(copy).clean()
    assert not list(copy.rglob("*.unfinished"))


def test_any_byte_of_a_policy_may_be_another(run, tmp_path):
    """Never anything but one line; and never weights that are not those that were saved."""
    path = tmp_path / "policy.safetensors"
    whole = (run / "duties-0" / "policy.safetensors").read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(300):
        spoilt = bytearray(whole[: rng.integers(len(whole)) if rng.random() < 0.2 else None])
        for place in rng.integers(0, min(len(spoilt), 6000) or 1, 2):
            if len(spoilt):
                spoilt[place] ^= int(rng.integers(1, 256))
        path.write_bytes(spoilt)
        with contextlib.suppress(ValueError):
            read_tree(path)
            raise AssertionError("damage was not seen")
