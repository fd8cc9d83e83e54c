"""Every task about orbits that are elliptic or have J2: it flies, or is refused in one line."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest

from tests.tasks.test_every_vehicle import assert_finite
from thruster_envs import formation_attitude_v1, formation_keeping_v1
from thruster_envs.physics import rows as at
from thruster_envs.physics.orbits import Ellipse, transition_matrix
from thruster_envs.registration import ENVIRONMENTS
from thruster_envs.rollout import fly
from thruster_envs.spacecraft import Orbit, load
from thruster_envs.spacecraft.orbit import EARTH_J2, EARTH_RADIUS
from thruster_envs.tasks.shaping import delta_v_to_go, elliptic_delta_v_to_go
from thruster_envs.views import fork

ELLIPTIC = Orbit(
    semi_major_axis=7500e3, eccentricity=0.1, inclination=1.0, argument_of_perigee=0.5, true_anomaly=0.4,
    true_anomaly_dispersion=math.pi, planet_radius=EARTH_RADIUS,
)  # fmt: skip
OBLATE = Orbit(
    semi_major_axis=7000e3, inclination=1.2, raan=0.3, true_anomaly_dispersion=math.pi, j2=EARTH_J2,
    planet_radius=EARTH_RADIUS,
)  # fmt: skip
#: What each task flies with unless told otherwise.
ITS_OWN = {
    "MarsRendezvous-v1": "msr_chaser",
    "PulseDiagnosis-v0": "ppt_cubesat",
    "FormationAttitude-v1": "ppt_cubesat",
}
RENDEZVOUS = "thruster_envs/OrionRendezvous-v1"


def on(orbit: Orbit, name: str = "orion"):
    return load(name).replace(orbit=orbit)


@pytest.mark.parametrize("orbit", [ELLIPTIC, OBLATE], ids=["elliptic", "oblate"])
@pytest.mark.parametrize("identifier", ENVIRONMENTS)
def test_a_task_flies_twenty_finite_steps_or_is_refused_in_one_line(identifier, orbit):
    name = ITS_OWN.get(identifier.split("/")[1], "orion")
    if "Mars" in identifier:
        with pytest.raises(ValueError, match="MarsRendezvous needs a circular orbit without j2") as refusal:
            gym.make(identifier, spacecraft=on(orbit, name))
        assert "\n" not in str(refusal.value)
        return
    env = gym.make(identifier, spacecraft=on(orbit, name), disable_env_checker=True).unwrapped
    env.action_space.seed(1)
    observation, info = env.reset(seed=3)
    for _ in range(20):
        assert observation in env.observation_space
        assert_finite(info, "info")
        observation, reward, _, _, info = env.step(env.action_space.sample())
        assert math.isfinite(reward)
    assert ("orbit" in info) == env.task.flies


@pytest.mark.parametrize("module", [formation_keeping_v1, formation_attitude_v1])
def test_formations_of_many_agents_fly_too(module):
    vehicle = "orion" if module is formation_keeping_v1 else "ppt_cubesat"
    env = module.parallel_env(spacecraft=on(ELLIPTIC, vehicle))
    env.reset(seed=2)
    for step in range(20):
        if not env.agents:  # lost, by what random actions do to it
            assert step > 3
            break
        found = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
        assert_finite(found[0], "observations")
        assert_finite(found[4], "infos")


def anomalies(seed: int, worlds: int, episodes: int = 1) -> np.ndarray:
    """True anomalies at the start, (episodes, worlds)."""
    env = gym.make_vec(RENDEZVOUS, num_envs=worlds, spacecraft=on(ELLIPTIC))
    starts = [env.reset(seed=seed)[1]] + [env.reset()[1] for _ in range(episodes - 1)]
    return np.array([info["orbit"]["true_anomaly"] for info in starts])


def test_the_anomaly_at_the_start_is_drawn_from_each_world_s_own_stream():
    drawn = anomalies(5, 400, 2)
    assert np.unique(drawn).size == drawn.size
    np.testing.assert_array_equal(drawn, anomalies(5, 400, 2))
    np.testing.assert_array_equal(drawn[:, 7], anomalies(12, 1, 2)[:, 0])
    assert np.abs(drawn).max() <= math.pi
    # Uniform over the whole orbit: the mean direction is none.
    assert abs(np.exp(1j * drawn).mean()) < 3.0 / math.sqrt(drawn.size)


def test_without_dispersion_an_episode_begins_at_the_anomaly_of_the_vehicle():
    orbit = Orbit(semi_major_axis=7500e3, eccentricity=0.1, true_anomaly=-2.0)
    _, info = gym.make(RENDEZVOUS, spacecraft=on(orbit)).reset(seed=1)
    assert info["orbit"]["true_anomaly"] == pytest.approx(-2.0, abs=1e-12)


def test_a_draw_of_the_anomaly_moves_no_other_draw():
    """Noise and dispersion at the start are those about a circle, which has no anomaly to draw."""
    observations = []
    for orbit in (None, ELLIPTIC):
        env = gym.make_vec(RENDEZVOUS, num_envs=4, spacecraft="orion" if orbit is None else on(orbit))
        observations.append(env.reset(seed=9)[0])
    np.testing.assert_array_equal(observations[0][:, :9], observations[1][:, :9])


def test_a_fork_and_a_state_go_on_bit_for_bit_from_where_the_orbit_stands():
    env = gym.make(RENDEZVOUS, spacecraft=on(ELLIPTIC))
    env.reset(seed=4)
    for _ in range(5):
        env.step(env.action_space.sample())
    other, third = fork(env), gym.make(RENDEZVOUS, spacecraft=on(ELLIPTIC))
    third.reset(seed=77)
    third.unwrapped.set_state(env.unwrapped.get_state())
    for _ in range(5):
        action = env.action_space.sample()
        mine, *_, info = env.step(action)
        for its in (other, third):
            same, *_, its_info = its.step(action)
            np.testing.assert_array_equal(mine, same)
            assert its_info["orbit"] == info["orbit"]


def test_a_recording_has_the_anomaly_with_its_unit():
    recording = fly(RENDEZVOUS, "idle", [1, 2], steps=3, spacecraft=on(ELLIPTIC))
    assert recording.channels["orbit/true_anomaly"].unit == "rad"
    assert recording["orbit/true_anomaly"].shape == (8,)


@pytest.mark.parametrize("eccentricity", [0.1, 0.5])
def test_slots_lie_on_a_relative_orbit_that_free_motion_follows_and_closes(eccentricity):
    orbit = Orbit(semi_major_axis=15e6, eccentricity=eccentricity, true_anomaly=0.7)
    env = formation_keeping_v1.parallel_env(
        spacecraft=on(orbit).replace(control_period=60.0), range_limit=1e6
    )
    env.reset(seed=1)
    worlds = env.unwrapped.worlds
    first = worlds.state.slots[0].copy()
    idle = {agent: -np.ones(12, np.float32) for agent in env.agents}
    for _ in range(100):
        env.step(idle)
    moved = transition_matrix(orbit, 6000.0) @ first.T
    np.testing.assert_allclose(worlds.state.slots[0], moved.T, rtol=0.0, atol=1e-9 * 50.0)
    np.testing.assert_allclose(transition_matrix(orbit, orbit.period) @ first.T, first.T, atol=1e-7)


def ellipse_of(orbit: Orbit, time: float = 0.0) -> Ellipse:
    e = orbit.eccentricity
    return Ellipse(
        orbit.mean_motion, orbit.semi_major_axis, e, math.sqrt(1.0 - e * e), orbit.start + time, 0.0, 0.0
    )


def test_delta_v_to_go_becomes_that_of_a_circle():
    r, v = (300.0, -20.0, 40.0), (0.1, -0.2, 0.05)
    for time in (10.0, 300.0, 1200.0, 1500.0, 2800.0):
        ellipse = ellipse_of(Orbit(mean_motion=0.0011, eccentricity=1e-9, true_anomaly=0.3))
        circle = delta_v_to_go(r, v, time, 0.0011)
        assert elliptic_delta_v_to_go(r, v, time, ellipse) == pytest.approx(circle, rel=1e-6)


def test_delta_v_to_go_is_that_of_two_impulses_by_the_transition_matrix():
    orbit = Orbit(mean_motion=0.0011, eccentricity=0.3, true_anomaly=2.0)
    r, v, time = np.array([300.0, -20.0, 40.0]), np.array([0.1, -0.2, 0.05]), 900.0
    move = transition_matrix(orbit, time)
    first = np.linalg.solve(move[:3, 3:], -move[:3, :3] @ r)
    arrival = move[3:, :3] @ r + move[3:, 3:] @ first
    expected = np.abs(first - v).sum() + np.abs(arrival).sum()
    assert elliptic_delta_v_to_go(tuple(r), tuple(v), time, ellipse_of(orbit)) == pytest.approx(expected)


def test_along_free_motion_across_the_plane_the_delta_v_to_go_has_no_jump():
    """Where waiting for the node gives way to two impulses, they cost the same."""
    orbit = Orbit(mean_motion=0.0011, eccentricity=0.3, true_anomaly=0.5)
    costs = [
        elliptic_delta_v_to_go((0.0, 0.0, 40.0), (0.0, 0.0, 0.1), time, ellipse_of(orbit))
        for time in np.arange(600.0, 2400.0, 0.5)
    ]
    assert np.ptp(costs[:200]) > 0.02
    assert costs[-1] == costs[-2]
    assert np.abs(np.diff(costs)).max() < 1.3e-4  # m/s in half a second: its slope where it is steepest


def test_the_pilot_of_a_formation_holds_its_slots_about_an_ellipse():
    """Craft that nobody commands stay within the tolerance of their slots for most of two hundred periods."""
    env = formation_keeping_v1.parallel_env(craft=3, commanded=1, spacecraft=on(ELLIPTIC))
    env.reset(seed=6)
    worlds, kept = env.unwrapped.worlds, []
    for step in range(100):
        env.step({agent: -np.ones(12, np.float32) for agent in env.agents})
        if step >= 40:
            away = worlds.fleet.read(at.POSITION, 3)[0, 1:] - worlds.state.slots[0, 1:, :3]
            kept.append(np.linalg.norm(away, axis=-1).max() < 1.0)
    assert np.mean(kept) > 0.9


def test_with_j2_the_anomaly_counts_from_the_perigee_of_the_vehicle():
    orbit = Orbit(
        semi_major_axis=7500e3, inclination=1.0, argument_of_perigee=0.4, true_anomaly=1.0,
        true_anomaly_dispersion=0.5, j2=EARTH_J2, planet_radius=EARTH_RADIUS,
    )  # fmt: skip
    env = gym.make("thruster_envs/OrionRendezvous-v1", spacecraft=load("orion").replace(orbit=orbit))
    starts = [env.reset(seed=seed)[1]["orbit"]["true_anomaly"] for seed in range(8)]
    assert len(set(starts)) == 8
    assert all(0.5 <= start <= 1.5 for start in starts)
    after = env.step(-np.ones(12, np.float32))[4]["orbit"]["true_anomaly"]
    assert after - starts[-1] == pytest.approx(5.0 * orbit.mean_motion, rel=0.01)
