"""What a user may do to a command: Ctrl-C at any moment, odd places and terminals, readers that go away."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

import train
from tests.agents.runs import TINY
from thruster_agents.commands import check_file, check_folder, check_memory, check_space, run_command

ROOT = Path(train.__file__).parent
COMMANDS = {
    "train.py": ["train.py"],
    "python -m reproductions": ["-m", "reproductions", "list"],
    "python -m benchmarks": ["-m", "benchmarks", "--quick"],
    "docs/make_images.py": ["docs/make_images.py"],
}


def _interrupted(folder, arguments, moment):
    """Standard error and status of a command that gets Ctrl-C when it imports `moment`."""
    (folder / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path, target=None):\n"
        f"        if name == {moment!r}: os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.mark.parametrize("program", COMMANDS)
def test_ctrl_c_while_libraries_load_is_one_line(program, tmp_path):
    ended = _interrupted(tmp_path, COMMANDS[program], "numpy")
    assert (ended.returncode, ended.stdout) == (130, "")
    assert ended.stderr == f"\n{program}: interrupted\n"


@pytest.mark.parametrize("moment", ["torch", "thruster_agents.run_folders"])
def test_ctrl_c_late_in_the_loading_is_one_line(moment, tmp_path):
    ended = _interrupted(tmp_path, COMMANDS["train.py"], moment)
    assert (ended.returncode, ended.stderr) == (130, "\ntrain.py: interrupted\n")


def test_ctrl_c_in_a_run_says_how_to_go_on(tmp_path):
    command = [sys.executable, "train.py", "--runs", str(tmp_path), "--results", str(tmp_path / "a b.md")]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        folder = process.stdout.readline().removeprefix("run folder ").rstrip()
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        error = process.communicate(timeout=300)[1]
    assert process.returncode == 130
    assert error.splitlines()[-1] == (
        f"train.py: interrupted; to go on: python train.py --resume {folder} --results '{tmp_path}/a b.md'"
    )
    assert "Traceback" not in error


def test_a_terminal_without_characters_and_a_reader_that_goes_lose_nothing(tmp_path):
    """The files are there before the table is printed."""
    command = [sys.executable, "train.py", *TINY, "--belief-steps", "0", "--duty-steps", "256"]
    results = tmp_path / "results.md"
    ended = subprocess.run(
        [*command, "--runs", str(tmp_path / "é"), "--results", str(results)],
        cwd=ROOT,
        env=os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"},
        capture_output=True,
        timeout=300,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.isascii()
    assert results.read_text().startswith("# Thruster mapping")
    (folder,) = (tmp_path / "é").iterdir()
    results.unlink()
    with subprocess.Popen(
        [sys.executable, "train.py", "--resume", str(folder), "--results", str(results)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        error = process.stderr.read()
        process.wait(timeout=300)
    assert error == ""
    assert process.returncode == 1
    assert results.read_text().startswith("# Thruster mapping")
    assert json.loads((folder / "metrics.json").read_text())["rows"]


def test_a_folder_or_file_that_cannot_be_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for path in ("file", "file/below", "loop", "loop/below", "x" * 256, f"new/{'x' * 256}"):
        with pytest.raises(ValueError, match="runs") as caught:
            check_folder("runs", tmp_path / path)
        assert "\n" not in str(caught.value)
    for path in (".", "file/below", "loop", "x" * 256, "/dev/null", "/proc/results.md"):
        with pytest.raises(ValueError, match="results"):
            check_file("results", tmp_path / path)
    check_folder("runs", tmp_path / "new" / "below")
    check_file("results", tmp_path / "new.md")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "loop"]


def test_what_this_machine_has_not_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"worlds is 7, which needs 1000000000\.0 GB of memory"):
        check_memory("worlds", 7, 10**18)
    with pytest.raises(ValueError, match="runs needs about 1000000000000 MB of space"):
        check_space("runs", tmp_path / "new", 10**18)


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt(), 130, "program: interrupted\n"),
        (OSError(28, "No space left on device", "a/b"), 1, "program: No space left on device (a/b)\n"),
    ],
)
def test_what_is_expected_to_go_wrong_is_one_line(error, status, line, capsys):
    def body():
        raise error

    assert run_command("program", body) == status
    assert capsys.readouterr().err == line


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line_and_said_once(capsys):
    def body():
        for line in ("an axis\nis lost", "an axis\nis lost", "another"):
            warnings.warn(line, UserWarning, stacklevel=1)
        warnings.warn("an axis\nis lost", UserWarning, stacklevel=1)
        return 0

    before = warnings.showwarning
    assert run_command("train.py", body) == 0
    lines = ["train.py: warning: an axis is lost", "train.py: warning: another"]
    assert capsys.readouterr().err.splitlines() == lines
    assert warnings.showwarning is before
