"""Facts about the pictures: what changes them, what does not, and what they need from the machine."""

import builtins
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pygame
import pytest

from thruster_envs.rendering import CraftScene, Curve, Renderer, Scene
from thruster_envs.rendering.canvas import DELIVERED, FAILED
from thruster_envs.spacecraft import load

ORION = load("orion")
THRUSTERS = len(ORION.thrusters)


def duties(**shares):
    """Duties by thruster number: ``duties(t1=0.5)``."""
    values = np.zeros(THRUSTERS)
    for name, share in shares.items():
        values[int(name[1:]) - 1] = share
    return values


def craft(*, failed=(), **changes):
    faulty = np.zeros(THRUSTERS, dtype=bool)
    faulty[[number - 1 for number in failed]] = True
    path = np.stack([np.linspace(20, 60, 50), np.linspace(-300, -90, 50), np.linspace(5, 0, 50)], axis=1)
    values = {
        "attitude": np.array([0.97, 0.1, 0.2, 0.05]),
        "duties": duties(t1=0.9, t6=0.4),
        "thrust": duties(t1=0.8, t6=0.35),
        "faulty": faulty,
        "position": path[-1],
        "path": path,
        "target": np.zeros(3),
        "name": "chaser",
    }
    return CraftScene(**(values | changes))


def scene(*crafts, **changes):
    values = {
        "spacecraft": ORION,
        "craft": crafts or (craft(),),
        "time": 250.0,
        "title": "OrionRendezvous-v1",
        "readouts": (("range", "118.4 m"), ("delta-v used", "0.41 m/s")),
    }
    return Scene(**(values | changes))


BARS = (("x", -0.9, -0.4), ("y", 0.3, 0.25), ("z", 0.0, 0.02), ("rotation x", 1.0, 1.4))


@pytest.fixture(scope="module")
def renderer():
    return Renderer()


def pixels_near(frame, color, tolerance=12):
    """(h, w) where the picture shows ``color``."""
    return (np.abs(frame.astype(int) - np.array(color)) <= tolerance).all(axis=-1)


def number_of_colors(frame):
    return len(np.unique(frame.astype(int) @ [65536, 256, 1]))


def left_panel(frame):
    """The part that shows the craft, without its caption (at 960 x 540)."""
    return frame[92:398, 14:436]


def test_a_frame_is_rows_columns_and_three_bytes(renderer):
    frame = renderer.frame(scene())
    assert frame.shape == (540, 960, 3)
    assert frame.dtype == np.uint8
    assert frame.flags.c_contiguous
    assert frame.flags.writeable
    assert number_of_colors(frame) > 500


def test_a_frame_is_an_array_of_its_own(renderer):
    first = renderer.frame(scene())
    kept = first.copy()
    renderer.frame(scene(craft(failed=(1,)), time=300.0))
    np.testing.assert_array_equal(first, kept)


def test_the_same_scene_gives_the_same_bytes_whatever_was_drawn_before(renderer):
    first = renderer.frame(scene())
    renderer.frame(scene(bars=BARS))
    renderer.frame(scene(craft(failed=(2,)), craft(position=np.array([5.0, 6.0, 7.0])), time=1.0))
    np.testing.assert_array_equal(renderer.frame(scene()), first)
    np.testing.assert_array_equal(Renderer().frame(scene()), first)


def test_curves_stand_in_place_of_the_path_and_show_where_the_measured_leaves_the_expected(renderer):
    time = np.linspace(0.0, 10.0, 40)

    def curves(measured):
        return tuple(
            Curve(label=label, time_label="time, s", time=time, expected=np.sin(time), measured=measured)
            for label in ("voltage, V", "current, A")
        )

    still = {"curves_name": "last pulse"}
    path = renderer.frame(scene())
    healthy = renderer.frame(scene(curves=curves(np.sin(time)), **still))
    faulty = renderer.frame(scene(curves=curves(0.5 * np.sin(time)), **still))
    left, right = slice(14, 436), slice(450, 946)
    np.testing.assert_array_equal(healthy[60:400, left], path[60:400, left])
    assert not np.array_equal(healthy[60:400, right], path[60:400, right])
    upper, lower = (slice(92, 224), slice(236, 368))
    for rows in (upper, lower):
        assert pixels_near(healthy[rows, right], DELIVERED, 40).sum() > 40
        assert np.count_nonzero(healthy[rows, right] != faulty[rows, right]) > 200
    np.testing.assert_array_equal(renderer.frame(scene()), path)


def test_red_green_and_blue_stand_in_that_order(renderer):
    frame = renderer.frame(scene(craft(failed=(3,), thrust=duties(t1=1.0))))
    assert pixels_near(frame, FAILED).sum() > 100
    assert pixels_near(frame, DELIVERED).sum() > 100


@pytest.mark.parametrize("number", range(1, THRUSTERS + 1))
def test_a_failed_thruster_is_marked_in_the_view_and_under_its_bar(renderer, number):
    still = {"duties": duties(), "thrust": duties()}
    healthy = renderer.frame(scene(craft(**still)))
    failed = renderer.frame(scene(craft(failed=(number,), **still)))
    assert not pixels_near(left_panel(healthy), FAILED).any()
    assert pixels_near(left_panel(failed), FAILED).sum() > 100

    # Under the bars the mark stands at the thruster's share of the width, and nowhere else.
    columns = np.flatnonzero(pixels_near(failed, FAILED)[508:528].any(axis=0))
    assert not pixels_near(healthy, FAILED)[508:528].any()
    start, end = 55, 936
    assert columns.mean() == pytest.approx(start + (number - 0.5) * (end - start) / THRUSTERS, abs=8)
    assert np.ptp(columns) < 30


@pytest.mark.parametrize("number", [1, 12])
def test_a_closed_valve_is_crossed_out_on_its_bar_and_named_with_the_craft(renderer, number):
    valves = np.arange(THRUSTERS) == number - 1
    still = {"duties": duties(), "thrust": duties()}
    changed = (
        renderer.frame(scene(craft(**still))) != renderer.frame(scene(craft(shut=valves, **still)))
    ).any(-1)
    start, end = 55, 936
    columns = np.flatnonzero(changed[420:].any(axis=0))
    assert columns.mean() == pytest.approx(start + (number - 0.5) * (end - start) / THRUSTERS, abs=4)
    assert np.ptp(columns) <= 32
    assert changed[60:90, 300:437].any()
    changed[420:] = changed[60:90, :437] = False
    assert not changed.any()


def test_the_corridor_is_drawn_on_both_sides_of_the_way_and_inside_of_the_plots(renderer):
    path = np.stack([np.zeros(9), np.linspace(-4, -1, 9), np.zeros(9)], axis=1)
    still = craft(path=path, position=path[-1])
    plain = renderer.frame(scene(still))[92:368]
    drawn = renderer.frame(scene(still, corridor=[(-50.0, 9.0), (0.0, 0.2)]))[92:368]
    rows, columns = np.nonzero((plain != drawn).any(axis=-1))
    assert len(rows) > 200
    assert columns.min() > 480
    assert columns.max() < 940
    for plot in (rows[rows < 132], rows[rows > 144] - 144):
        assert (plot < 66).sum() == pytest.approx((plot > 66).sum(), rel=0.1)


def test_the_planet_below_is_blue_for_the_earth_and_red_for_mars_whatever_was_drawn_before(renderer):
    chaser = load("msr_chaser")
    over_mars = CraftScene(attitude=[1, 0, 0, 0], duties=np.zeros(8), thrust=np.zeros(8), faulty=np.zeros(8))
    for vehicle, one, more, less in (
        (ORION, craft(), 2, 0),
        (chaser, over_mars, 0, 2),
        (ORION, craft(), 2, 0),
    ):
        ground = renderer.frame(scene(one, spacecraft=vehicle))[380:398, 150:330].reshape(-1, 3).mean(axis=0)
        assert ground[more] > 1.5 * ground[less]


@pytest.mark.parametrize("number", [1, 5, 8])
def test_a_plume_grows_with_the_thrust(renderer, number):
    areas = []
    dark = left_panel(renderer.frame(scene(craft(duties=duties(), thrust=duties()))))
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        thrust = duties(**{f"t{number}": share})
        lit = left_panel(renderer.frame(scene(craft(duties=duties(), thrust=thrust))))
        areas.append(int((lit.astype(int) - dark).clip(0).sum()))
    assert areas[0] == 0
    assert (np.diff(areas) > 0).all()


def test_a_plume_blows_against_the_force():
    # One thruster whose force is radial, upwards in the picture: its plume is below it.
    jet = replace(ORION.thrusters[0], name="jet", position=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0))
    vehicle = ORION.replace(thrusters=(jet,))
    attitude = np.array([1.0, 0.0, 0.0, 0.0])

    def frame(thrust):
        one = CraftScene(attitude=attitude, duties=[0.0], thrust=[thrust], faulty=[False])
        return Renderer().frame(scene(one, spacecraft=vehicle))

    change = np.abs(left_panel(frame(1.0)).astype(int) - left_panel(frame(0.0))).sum(axis=-1)
    rows = np.arange(len(change))
    assert (change.sum(axis=1) @ rows) / change.sum() > len(change) / 2


def test_a_thruster_stuck_on_behind_the_body_is_still_seen(renderer):
    # Thruster 8 is hidden by the body at this attitude: only a failed one shines through.
    hidden = {"attitude": np.array([0.5817, 0.0, 0.7790, 0.2337]), "duties": duties()}

    def change(failed):
        off = left_panel(renderer.frame(scene(craft(failed=failed, thrust=duties(), **hidden))))
        on = left_panel(renderer.frame(scene(craft(failed=failed, thrust=duties(t8=0.9), **hidden))))
        return int((on.astype(int) - off).clip(0).sum())

    assert change((8,)) > 3 * change(())


def test_a_turned_craft_looks_different_and_the_sign_of_a_quaternion_does_not_matter(renderer):
    attitude = np.array([0.97, 0.1, 0.2, 0.05])
    first = renderer.frame(scene(craft(attitude=attitude)))
    np.testing.assert_array_equal(renderer.frame(scene(craft(attitude=-attitude))), first)
    np.testing.assert_array_equal(renderer.frame(scene(craft(attitude=2.0 * attitude))), first)
    assert (renderer.frame(scene(craft(attitude=[0.9, 0.1, 0.2, 0.4]))) != first).any()


def test_every_craft_of_a_formation_is_in_the_path_in_its_own_colour(renderer):
    from thruster_envs.rendering.path_view import craft_color

    crafts = [
        craft(position=np.array([10.0 * k, 40.0 * k, -5.0 * k]), path=np.zeros((0, 3)), name=f"craft {k}")
        for k in range(8)
    ]
    plots = renderer.frame(scene(*crafts))[95:365, 500:940]
    for number in range(8):
        assert pixels_near(plots, craft_color(number), 4).sum() > 40


def test_bars_replace_the_path(renderer):
    path, bars = renderer.frame(scene()), renderer.frame(scene(bars=BARS))
    right = np.s_[62:398, 450:946]
    assert (path[right] != bars[right]).any()
    outside = path != bars
    outside[right] = False
    assert not outside.any()


@pytest.mark.parametrize("size", [(320, 240), (333, 777), (640, 360), (1280, 720), (2560, 1440), (700, 241)])
@pytest.mark.parametrize("bars", [(), BARS])
def test_any_size_can_be_drawn(size, bars):
    width, height = size
    several = [craft(failed=(1, 2, 12)) for _ in range(1 if bars else 3)]
    frame = Renderer(width, height).frame(scene(*several, bars=bars))
    assert frame.shape == (height, width, 3)
    assert number_of_colors(frame) > 100


@pytest.mark.parametrize("size", [(319, 240), (320, 239), (0, 0)])
def test_a_picture_that_is_too_small_is_refused(size):
    with pytest.raises(ValueError, match="320 x 240"):
        Renderer(*size)


@pytest.mark.parametrize("number_of_thrusters", [1, 2, 40])
def test_any_number_of_thrusters_anywhere_can_be_drawn(renderer, number_of_thrusters):
    random = np.random.default_rng(1)
    jets = tuple(
        replace(
            ORION.thrusters[0],
            name=f"jet {number}",
            position=tuple(random.normal(size=3) * (number > 0)),
            direction=tuple(random.normal(size=3)),
        )
        for number in range(number_of_thrusters)
    )
    vehicle = ORION.replace(thrusters=jets)
    full = np.ones(number_of_thrusters)
    one = CraftScene(attitude=[1, 0, 0, 0], duties=full, thrust=full, faulty=full > 0)
    assert renderer.frame(scene(one, spacecraft=vehicle)).shape == (540, 960, 3)


def test_strange_text_is_drawn_and_not_refused(renderer):
    readouts = tuple((f"label {number}", "9" * 12) for number in range(30))
    renderer.frame(scene(title="x\x00y\n" * 60, readouts=readouts))
    renderer.frame(scene(title="", readouts=(("", ""),), bars=(("", 0.0, 0.0),)))


@pytest.mark.parametrize("reach", [0.0, 1e-9, 1e-3, 1e7])
def test_paths_of_any_length_can_be_drawn(renderer, reach):
    path = reach * np.random.default_rng(2).normal(size=(30, 3))
    renderer.frame(scene(craft(path=path, position=path[-1])))


def test_nothing_is_lost_beside_a_long_path_that_stands_still(renderer):
    path = np.tile([1.0, 2.0, 3.0], (1000, 1))
    renderer.frame(scene(craft(path=path, position=path[-1])))
    renderer.frame(scene(craft(path=path[:1], position=path[-1])))


def run(code, **environment):
    clean = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    clean.pop("SDL_VIDEODRIVER", None)
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=clean | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


SMALL_SCENE = """
import numpy as np
from thruster_envs.rendering import CraftScene, Renderer, Scene
from thruster_envs.spacecraft import load
ones = np.full(12, 0.5)
craft = CraftScene(attitude=[1, 0, 0, 0], duties=ones, thrust=ones, faulty=ones > 1)
scene = Scene(spacecraft=load("orion"), craft=(craft,), time=5.0, title="a title")
"""


def test_frames_need_no_display_and_open_none():
    code = SMALL_SCENE + (
        "frame = Renderer().frame(scene)\n"
        "import pygame\n"
        "assert not pygame.display.get_init()\n"
        "assert pygame.display.get_surface() is None\n"
        "print(frame.shape, frame.std() > 1)\n"
    )
    result = run(code)
    assert (result.stdout, result.stderr) == ("(540, 960, 3) True\n", "")


def test_importing_the_package_does_not_import_pygame():
    result = run("import sys, thruster_envs.rendering; print('pygame' in sys.modules)")
    assert (result.stdout, result.stderr) == ("False\n", "")


def test_without_pygame_one_line_says_what_to_install(monkeypatch):
    real_import = builtins.__import__

    def without_pygame(name, *arguments, **options):
        if name == "pygame" or name.startswith("pygame."):
            raise ModuleNotFoundError("No module named 'pygame'", name="pygame")
        return real_import(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without_pygame)
    with pytest.raises(
        ImportError, match=r'^rendering needs pygame-ce: pip install "thruster-envs\[render\]"$'
    ):
        Renderer()


def test_the_other_pygame_is_refused(monkeypatch):
    monkeypatch.delattr(pygame, "IS_CE")
    with pytest.raises(ImportError, match=r"needs pygame-ce, but pygame \S+ is installed: "):
        Renderer()
