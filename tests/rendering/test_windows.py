"""Windows: several at once, closed by whoever may close them, and untouched by what others do with pygame."""

import hashlib
import os
import signal
import subprocess
import sys
import time

import gymnasium as gym
import numpy as np
import pygame
import pytest

import thruster_envs  # noqa: F401  # registers the environments
from thruster_envs.rendering import CraftScene, Renderer, Scene
from thruster_envs.rendering.window import _PROGRAM, Window
from thruster_envs.spacecraft import load

MAPPING = "thruster_envs/ThrusterMapping-v0"
IDLE = np.full(12, -1.0, np.float32)


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    """Windows that nobody sees."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def scene():
    half = np.full(12, 0.5)
    craft = CraftScene(attitude=[1, 0, 0, 0], duties=half, thrust=half, faulty=half > 1)
    return Scene(spacecraft=load("orion"), craft=(craft,), time=5.0, title="a title")


def processes():
    """Ids of the processes behind windows of this one."""
    listed = subprocess.run(
        ["ps", "-ww", "--ppid", str(os.getpid()), "-o", "pid=,args="],
        capture_output=True,
        text=True,
        check=True,
    )
    return {int(line.split()[0]) for line in listed.stdout.splitlines() if _PROGRAM.name in line}


def click_close(process):
    """What a window does when its user closes it, and wait until it has."""
    os.kill(process, signal.SIGTERM)  # SDL makes of it what a click on the cross becomes
    while process in processes():
        time.sleep(0.02)


def human():
    env = gym.make(MAPPING, render_mode="human")
    env.reset(seed=0)
    return env


def test_a_window_shows_the_picture_and_its_title():
    picture = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    code = (
        "import hashlib, os, sys\n"
        "sys.path.insert(0, sys.argv.pop(1))\n"
        "import pygame, window_process\n"
        "def flip():\n"
        "    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)\n"
        "    print(pygame.display.get_caption()[0], hashlib.sha256(shown.tobytes()).hexdigest())\n"
        "pygame.display.flip = flip\n"
        "window_process.main(320, 240, 'a title')\n"
        "sys.stdout.flush()\n"
        "os._exit(0)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, str(_PROGRAM.parent)],
        input=picture.tobytes() * 2, capture_output=True, timeout=120, check=True,
    )  # fmt: skip
    line = f"a title {hashlib.sha256(picture.tobytes()).hexdigest()}"
    assert result.stdout.decode().splitlines() == ["", line, line]


def test_a_window_opens_with_the_first_scene_and_closes_for_good_when_the_user_says_so():
    renderer = Renderer(frames_per_second=1000.0)
    before = processes()
    renderer.close()
    assert renderer.show(scene())
    (process,) = processes() - before
    renderer.close()
    assert processes() == before
    assert renderer.show(scene())
    (process,) = processes() - before
    click_close(process)
    assert not renderer.show(scene())
    assert not renderer.show(scene())
    assert processes() == before
    assert renderer.frame(scene()).shape == (540, 960, 3)


def test_of_two_windows_each_can_be_closed_and_the_other_stays():
    before = processes()
    first, second = human(), human()
    (one, other) = sorted(processes() - before)
    click_close(one)
    first.step(IDLE)
    second.step(IDLE)
    assert processes() - before == {other}
    third = human()
    second.close()
    assert other not in processes()
    third.step(IDLE)
    first.step(IDLE)
    for env in (first, third):
        env.close()
    assert processes() == before


def test_a_window_closes_with_its_environment_when_that_is_forgotten():
    before = processes()
    human()
    assert processes() == before


@pytest.mark.parametrize("end", ["pass", "os.kill(os.getpid(), signal.SIGKILL)"])
def test_a_window_closes_when_its_program_ends(end):
    code = (
        "import os, signal\n"
        "import gymnasium as gym, thruster_envs\n"
        f"env = gym.make({MAPPING!r}, render_mode='human')\n"
        "env.reset(seed=0)\n"
        "print(env.unwrapped._camera._renderer._window._process.pid, flush=True)\n" + end
    )
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, timeout=120, check=False
    )
    assert result.stderr == ""
    window = int(result.stdout)
    deadline = time.monotonic() + 60.0
    while os.path.exists(f"/proc/{window}/cmdline") and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not os.path.exists(f"/proc/{window}")


@pytest.mark.parametrize(
    "quit_", [pygame.quit, pygame.display.quit, pygame.font.quit], ids=["pygame", "display", "font"]
)
@pytest.mark.parametrize("init", [lambda: None, pygame.init], ids=["", "and inits"])
def test_nothing_changes_when_somebody_else_quits_pygame(quit_, init):
    pygame.init()
    pygame.display.set_mode((100, 100))
    shown, filmed = human(), gym.make(MAPPING, render_mode="rgb_array")
    filmed.reset(seed=0)
    right = filmed.render()
    before = processes()
    quit_()
    init()
    shown.step(IDLE)
    assert processes() == before
    np.testing.assert_array_equal(filmed.render(), right)
    fresh = gym.make(MAPPING, render_mode="rgb_array")
    fresh.reset(seed=0)
    np.testing.assert_array_equal(fresh.render(), right)
    shown.close()
    pygame.quit()


def test_windows_leave_the_display_of_others_alone():
    pygame.display.init()
    own = pygame.display.set_mode((100, 100))
    pygame.event.clear()
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    env = human()
    env.step(IDLE)
    env.close()
    assert pygame.display.get_surface() is own
    assert any(event.type == pygame.QUIT for event in pygame.event.get())
    pygame.quit()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork a process")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # beside threads of other tests
def test_a_fork_shows_its_own_window_and_leaves_that_of_its_parent_alone():
    env = human()
    before = processes()
    child = os.fork()
    if child == 0:
        env.step(IDLE)
        own = len(processes())
        env.close()
        os._exit(own)
    assert os.WEXITSTATUS(os.waitpid(child, 0)[1]) == 1
    assert processes() == before
    env.step(IDLE)
    env.close()


def test_without_a_display_one_line_says_so(monkeypatch):
    for variable in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    env = gym.make(MAPPING, render_mode="human")
    with pytest.raises(RuntimeError, match=r"^no window can be opened \(.*\); render_mode 'rgb_array' needs"):
        env.reset(seed=0)
    env.close()


def test_a_title_may_hold_any_character():
    window = Window(320, 240, "a\0b\nµ\udce9 -- 'c'")
    assert window.show(np.zeros((240, 320, 3), np.uint8))
    window.close()
