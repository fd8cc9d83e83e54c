"""What a picture of the chaser about Mars says is what the world is; whatever becomes of a world is drawn."""

import gymnasium as gym
import numpy as np
import pytest

import thruster_envs  # noqa: F401 - registers the environments
from tests.views.cases import IDS
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.views.scenes import Camera


def approach(**settings):
    """An environment after its reset, and a camera on it."""
    env = gym.make("thruster_envs/MarsRendezvous-v1", **settings).unwrapped
    env.reset(seed=0)
    return env, Camera(env.worlds, 0, "approach")


def command(*, shut=(), branch=False):
    """Every thruster open for a fifth of the period."""
    action = np.full(17, -0.6, np.float32)
    action[8:] = -1.0
    action[[7 + number for number in shut]] = 1.0
    action[16] = 1.0 if branch else -1.0
    return action


def test_a_closed_isolation_valve_is_marked_and_so_is_the_branch_in_use():
    env, camera = approach(inhibit=True, faults=[Fault(3, "stuck_on")])
    env.step(command(shut=(3, 5)))
    before = camera.scene()
    env.step(command(branch=True))
    after = camera.scene()
    assert np.flatnonzero(before.craft[0].shut).tolist() == [2, 4]
    assert np.flatnonzero(before.craft[0].faulty).tolist() == [2]
    assert dict(before.readouts)["branch"] == "A"
    assert not after.craft[0].shut.any()
    assert not after.craft[0].faulty.any()
    assert dict(after.readouts)["branch"] == "B"


def test_without_valves_in_the_action_there_is_no_branch_to_name():
    _, camera = approach()
    assert "branch" not in dict(camera.scene().readouts)


def test_the_corridor_is_that_of_the_cost():
    env, camera = approach(distance=3.0)
    scene = camera.scene()
    (near,) = (half for along, half in scene.corridor if along == 0.0)
    assert near == 0.25
    env.worlds.fleet.data[0, :2, 0] = 1.2, -2.0  # m, radial and along-track
    info = env.step(np.full(8, -1.0, np.float32))[-1]
    x, y, z = camera.scene().craft[0].position
    half = np.interp(y, *scene.corridor.T)
    assert info["cost"] == pytest.approx(np.hypot(x, z) / half - 1.0, rel=1e-9)


def test_an_approach_that_has_ended_says_how():
    env, camera = approach(distance=2.5)
    assert "end" not in dict(camera.scene().readouts)
    terminated = False
    while not terminated:
        action = env.worlds.task.pilot_actions(env.worlds.state)[0, 0]
        terminated = env.step(action)[2]
    assert dict(camera.scene().readouts)["end"] == "captured"


#: What a number of a world may have become.
LOST = (np.nan, np.inf, -1e300, 0.0)


def lose(env, value):
    """Give the craft a state that is no state: where they are, how they turn, what was commanded and done."""
    fleet = env.worlds.fleet
    first, thrusters = fleet.rows.duties, env.task.vehicle.number_of_thrusters
    fleet.data[:, : at.STEP] = fleet.data[:, first : first + 2 * thrusters] = value


@pytest.mark.parametrize("identifier", IDS)
def test_a_world_whose_state_is_lost_is_drawn_where_it_was_last(identifier):
    env = gym.make(identifier, render_mode="rgb_array").unwrapped
    for value in LOST:
        env.reset(seed=0)
        env.step(env.action_space.sample())
        before = env._camera.scene()
        lose(env, value)
        env._camera.follow()
        scene = env._camera.scene()
        for craft, was in zip(scene.craft, before.craft, strict=True):
            assert len(craft.path) == len(was.path) + 1
            if not np.isfinite(value):
                np.testing.assert_array_equal(craft.position, was.position)
                np.testing.assert_array_equal(craft.path[-1], was.position)
        assert scene.time == before.time
        assert env.render().std() > 5.0
        env.step(env.action_space.sample())
        assert env.render().std() > 5.0


def test_a_window_stays_open_over_a_world_that_is_lost(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make("thruster_envs/OrionRendezvous-v1", render_mode="human").unwrapped
    env.reset(seed=0)
    for value in LOST:
        lose(env, value)
        env.step(env.action_space.sample())
        assert env._camera._renderer._window is not None
    env.close()
