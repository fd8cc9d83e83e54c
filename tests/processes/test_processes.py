"""A process that is forked, or started anew, flies what its parent flies, to the last bit, and returns."""

import json
import os
import platform
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from thruster_envs import threads

ROOT = Path(__file__).parents[2]
PATIENCE = (
    900.0  # s, for what takes a tenth of that where everything is compiled anew: more means that it hangs
)


def run(*arguments, **environment):
    """The lines that a Python process prints; one that hangs is ended, with its children, and fails."""
    process = subprocess.Popen(
        [sys.executable, "-W", "error", *arguments],
        cwd=ROOT,
        env=os.environ | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        output, errors = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output, errors = process.communicate()
        pytest.fail(f"it hangs, after {output!r} and {errors[-2000:]!r}")
    assert process.returncode == 0, errors[-2000:]
    return output.splitlines()


needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork a process")


@needs_fork
def test_what_is_forked_after_threads_flies_on_like_its_parent():
    # Python 3.12 warns of every fork beside threads, which is the very thing that has to work.
    (line,) = run("-W", "ignore::DeprecationWarning", "-m", "tests.processes.elsewhere", "fork")
    assert line == "12 flown, differing: []"


@needs_fork
def test_what_is_started_anew_flies_the_same():
    lines = run("-m", "tests.processes.elsewhere", "forkserver", "spawn")
    assert lines == ["12 flown, differing: []"] * 2


FLOWN = """
import os, sys, threading, time
import gymnasium as gym
import numpy as np
import thruster_envs

def batch():
    env = gym.make_vec("thruster_envs/ThrusterMapping-v0", num_envs=64, threads=2)
    env.reset(seed=0)
    return env

env, actions = batch(), np.zeros((64, 12), np.float32)
right = env.step(actions)[0]
"""
WAIT = "print(os.WEXITSTATUS(os.waitpid(child, 0)[1]))\n"


@needs_fork
def test_a_child_forked_while_another_thread_steps_can_step():
    code = FLOWN + (
        "over = threading.Event()\n"
        "def step():\n"
        "    other = batch()\n"
        "    while not over.is_set():\n"
        "        other.step(actions)\n"
        "thread = threading.Thread(target=step)\n"
        "thread.start()\n"
        "for _ in range(20):\n"
        "    child = os.fork()\n"
        "    if child == 0:\n"
        "        os._exit(int((batch().step(actions)[0] != right).any()))\n"
        "    assert os.waitpid(child, 0)[1] == 0\n"
        "over.set()\n"
        "thread.join()\n"
    )
    assert run("-W", "ignore::DeprecationWarning", "-c", code) == []


@needs_fork
def test_a_child_that_has_stepped_ends_like_any_process():
    code = FLOWN + ("child = os.fork()\nif child == 0:\n    env.step(actions)\n    sys.exit(7)\n" + WAIT)
    assert run("-W", "ignore::DeprecationWarning", "-c", code) == ["7"]


def test_a_step_at_the_exit_of_the_interpreter_needs_no_new_thread():
    code = (
        "import atexit\n"
        "atexit.register(lambda: print((env.step(actions)[0] == other.step(actions)[0]).all()))\n"
        + FLOWN
        + "other = batch()\n"
        + "other.step(actions)\n"
    )
    assert run("-c", code) == ["True"]


@needs_fork
def test_a_child_forked_while_another_thread_compiles_can_compile():
    code = (
        "import os, threading, time\n"
        "import numba\n"
        "from numba.core.compiler_lock import global_compiler_lock\n"
        "import thruster_envs.threads\n"
        "def compile_():\n"
        "    with global_compiler_lock:\n"
        "        held.set()\n"
        "        time.sleep(0.5)\n"
        "held = threading.Event()\n"
        "thread = threading.Thread(target=compile_)\n"
        "thread.start()\n"
        "held.wait()\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    os._exit(numba.njit(lambda x: x + 1)(1))\n"
        "thread.join()\n" + WAIT
    )
    assert run("-W", "ignore::DeprecationWarning", "-c", code) == ["2"]


def test_where_no_thread_can_be_started_one_does_all_the_work_once(monkeypatch):
    def refuse(*arguments):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threads.ThreadPoolExecutor, "submit", refuse)
    done = []
    threads.run_shared(lambda first, last: done.append((first, last)), [(0, 2), (2, 4), (4, 5)])
    assert done == [(0, 2), (2, 4), (4, 5)]


def test_what_fails_in_a_share_is_raised_and_no_thread_works_on():
    def work(first, last):
        if first == 0:
            raise ValueError("share 0")

    with pytest.raises(ValueError, match="share 0"):
        threads.run_shared(work, [(0, 1), (1, 2), (2, 3)])


def digests(**environment):
    """Of everything that is flown, in a process with these environment variables."""
    code = "import json\nfrom tests.processes.flights import fly_all\nprint(json.dumps(fly_all()))\n"
    (line,) = run("-c", code, **environment)
    return json.loads(line)


@pytest.mark.nightly  # compiles everything once more
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="this is not an x86-64 processor")
def test_code_for_any_x86_64_processor_flies_what_code_for_this_one_flies():
    assert digests(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == digests()
