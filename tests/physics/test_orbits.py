"""Motion about an orbit: Kepler's equation, transition matrices, and what craft do about each kind of orbit.

Judged by closed forms, by SciPy's integration of two independent orbits in inertial space, and by the
propagator of Yamanaka and Ankersen in `beyond`.
"""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.physics.closed_forms import rotation_matrix
from tests.physics.inertial import frame_turning, gravity, local_axes, on_orbit
from thruster_envs.physics import orbits
from thruster_envs.physics.orbits import transition_matrix
from thruster_envs.spacecraft import Orbit
from thruster_envs.spacecraft.orbit import EARTH_J2, EARTH_MU, EARTH_RADIUS

Array = NDArray[np.float64]

#: That of a published reconfiguration, which begins at apogee.
APOGEE = Orbit(semi_major_axis=29948.48e3, eccentricity=0.471, true_anomaly=math.pi)
LOW = Orbit(
    semi_major_axis=8000e3, eccentricity=0.15, inclination=1.1, raan=0.3, argument_of_perigee=0.7,
    true_anomaly=1.0, planet_radius=EARTH_RADIUS,
)  # fmt: skip
OBLATE = dataclasses.replace(LOW, j2=EARTH_J2)
START = np.array([300.0, -500.0, 200.0, 0.1, -0.5, 0.2])


# Kepler's equation -----------------------------------------------------------------------------------


@njit
def eccentric_anomalies(mean: Array, e: float) -> Array:
    found = np.empty_like(mean)
    for k in range(mean.shape[0]):
        found[k] = orbits.eccentric_anomaly(mean[k], e)
    return found


@pytest.mark.parametrize("eccentricity", [0.0, 1e-9, 0.1, 0.5, 0.9, 0.95, 0.99])
def test_keplers_equation_is_solved_to_rounding(eccentricity):
    small = np.concatenate([10.0 ** np.arange(-14.0, 0.0), -(10.0 ** np.arange(-14.0, 0.0))])
    exact = np.concatenate([np.linspace(-math.pi, math.pi, 20_001), np.linspace(-0.1, 0.1, 2001), small])
    mean = exact - eccentricity * np.sin(exact)
    found = eccentric_anomalies(mean, eccentricity)
    # Rounding of the mean anomaly is magnified by one over the slope.
    assert np.abs((found - exact) * (1.0 - eccentricity * np.cos(exact))).max() < 1e-15


@njit
def turned(angles: Array) -> Array:
    found = np.empty((2, angles.shape[0]))
    for k in range(angles.shape[0]):
        found[0, k], found[1, k] = orbits.cos_sin(angles[k])
    return found


def test_cosine_and_sine_are_right_to_rounding():
    angles = np.random.default_rng(0).uniform(-50.0, 50.0, 100_000)
    np.testing.assert_allclose(turned(angles), [np.cos(angles), np.sin(angles)], rtol=0.0, atol=2.3e-16)


def test_the_frame_moves_as_keplers_laws_say():
    """Equal areas in equal times, the conic, and the derivatives of both by finite differences."""
    kind, mu = orbits.kind_of(LOW, nonlinear=False), EARTH_MU
    p = LOW.semi_major_axis * (1.0 - LOW.eccentricity**2)
    for time in np.linspace(-2.0, 2.0, 41) * LOW.period:
        motion = orbits.frame_motion(kind, time)
        anomaly = 2.0 * math.atan2(motion.sine, motion.cosine)
        assert motion.rate * motion.radius**2 == pytest.approx(math.sqrt(mu * p), rel=1e-13)
        assert motion.radius == pytest.approx(p / (1.0 + LOW.eccentricity * math.cos(anomaly)), rel=1e-13)
        assert motion.gravity == pytest.approx(mu / motion.radius**3, rel=1e-12)
        before, after = (orbits.frame_motion(kind, time + h).rate for h in (-0.1, 0.1))
        assert motion.acceleration == pytest.approx((after - before) / 0.2, rel=1e-6, abs=1e-13)
        since = LOW.time_since_perigee(anomaly)
        assert math.remainder(since - time, LOW.period) == pytest.approx(0.0, abs=1e-9)


# Transition matrices ---------------------------------------------------------------------------------


def linear_flight(orbit: Orbit, start: Array, duration: float, time: float = 0.0) -> Array:
    """Free motion by the linear equations, integrated by SciPy with Kepler's equation solved by Newton."""
    n, e, a = orbit.mean_motion, orbit.eccentricity, orbit.semi_major_axis

    def slope(t: float, state: Array) -> Array:
        mean = n * (orbit.start + time + t)
        eccentric = mean
        for _ in range(50):
            eccentric -= (eccentric - e * math.sin(eccentric) - mean) / (1.0 - e * math.cos(eccentric))
        radius = a * (1.0 - e * math.cos(eccentric))
        momentum = math.sqrt(EARTH_MU * a * (1.0 - e * e))
        rate, climb = momentum / radius**2, n * a * a * e * math.sin(eccentric) / radius
        bend, k = -2.0 * momentum * climb / radius**3, EARTH_MU / radius**3
        x, y, z, vx, vy, vz = state
        ax = (rate**2 + 2.0 * k) * x + bend * y + 2.0 * rate * vy
        ay = -bend * x + (rate**2 - k) * y - 2.0 * rate * vx
        return np.array([vx, vy, vz, ax, ay, -k * z])

    scale = np.array([1e-9] * 3 + [1e-13] * 3)
    return solve_ivp(slope, (0.0, duration), start, method="DOP853", rtol=1e-13, atol=scale).y[:, -1]


def assert_close(found: Array, exact: Array, relative: float) -> None:
    for part in (slice(0, 3), slice(3, 6)):
        assert np.linalg.norm(found[part] - exact[part]) < relative * np.linalg.norm(exact[part])


@pytest.mark.parametrize("eccentricity", [0.02, 0.471, 0.8])
@pytest.mark.parametrize("duration", [60.0, 20_000.0, 70_000.0, -9_000.0])
def test_the_transition_matrix_of_an_ellipse_is_free_linear_motion(eccentricity, duration):
    orbit = dataclasses.replace(APOGEE, eccentricity=eccentricity, true_anomaly=2.0)
    start = START * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
    exact = linear_flight(orbit, start, duration, time=500.0)
    assert_close(transition_matrix(orbit, duration, 500.0) @ start, exact, 1e-9)


def test_transition_matrices_compose_and_invert():
    first, second = transition_matrix(APOGEE, 7000.0), transition_matrix(APOGEE, 30_000.0, 7000.0)
    scale = np.repeat([1.0, 1.0 / APOGEE.mean_motion], 3)
    units = scale[:, np.newaxis] / scale
    whole, back = transition_matrix(APOGEE, 37_000.0), transition_matrix(APOGEE, -7000.0, 7000.0)
    np.testing.assert_allclose(
        second @ first * units, whole * units, atol=1e-11 * np.abs(whole * units).max()
    )
    np.testing.assert_allclose(back @ first * units, np.eye(6), atol=1e-11)


@pytest.mark.parametrize("eccentricity", [1e-3, 1e-6, 1e-9])
def test_an_ellipse_becomes_a_circle_as_its_eccentricity_goes(eccentricity):
    n = 0.0011
    circle, units = transition_matrix(n, 4000.0), np.repeat([1.0, 1.0 / n], 3)
    ellipse = transition_matrix(Orbit(mean_motion=n, eccentricity=eccentricity, true_anomaly=0.4), 4000.0)
    difference = (ellipse - circle) * units[:, np.newaxis] / units
    assert np.abs(difference).max() < 80.0 * eccentricity  # the sensitivity of this one is 70
    np.testing.assert_array_equal(transition_matrix(Orbit(mean_motion=n), 4000.0), circle)


@pytest.mark.parametrize("offset", [(0.0, 100.0, 0.0), (0.0, -50.0, 25.0), (0.0, 50.0, -25.0)])
def test_a_line_or_a_box_at_rest_at_apogee_does_not_drift(offset):
    """A fleet at rest along-track or across it is there again after an orbit."""
    start = np.concatenate([offset, np.zeros(3)])
    assert np.abs(transition_matrix(APOGEE, APOGEE.period) @ start - start)[:3].max() < 1e-9


@pytest.mark.parametrize(("error", "drift"), [(2e-3, 32.4), (0.7e-3, 11.34), (5e-6, 0.081)])
def test_a_velocity_error_becomes_the_published_drift_in_an_orbit_of_ninety_minutes(error, drift):
    start = np.array([0.0, 0.0, 0.0, 0.0, error, 0.0])
    after = transition_matrix(2.0 * math.pi / 5400.0, 5400.0) @ start
    np.testing.assert_allclose(after[:3], [0.0, -drift, 0.0], atol=1e-9)


@pytest.mark.parametrize("orientation", ["LVLH", "QSW"])
def test_the_propagator_of_beyond_says_the_same(orientation):
    """Its axes: along-track, minus cross-track, minus radial ("LVLH"), or ours ("QSW")."""
    from beyond.constants import Earth
    from beyond.dates import Date, timedelta
    from beyond.frames.frames import HillFrame
    from beyond.orbits import Orbit as Other
    from beyond.propagators.rpo import YamanakaAnkersen

    theirs = np.eye(6)
    if orientation == "LVLH":
        axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
        theirs = np.block([[axes, np.zeros((3, 3))], [np.zeros((3, 3)), axes]])
    date = Date(2026, 1, 1)
    for eccentricity, anomaly in ((0.01, 0.3), (0.471, math.pi), (0.8, -2.0)):
        elements = [29948.48e3, eccentricity, 1.10497, 4.24115, 3.7350, anomaly]
        orbit = Orbit(
            semi_major_axis=elements[0], eccentricity=eccentricity, true_anomaly=anomaly,
            gravitational_parameter=float(Earth.mu),
        )  # fmt: skip
        target = Other(elements, date, "keplerian", "EME2000", "Kepler")
        chaser = Other(
            theirs @ START, date, "cartesian", HillFrame(orientation), YamanakaAnkersen(target, orientation)
        )
        for duration in (100.0, 12_345.0, 51_579.0, 90_000.0):
            exact = theirs.T @ np.array(chaser.propagate(timedelta(seconds=duration)))
            assert_close(transition_matrix(orbit, duration) @ START, exact, 1e-8)


@pytest.mark.parametrize("duration", [1e-3, 1.0, 20.0, 600.0])
def test_the_matrix_of_a_circular_orbit_loses_no_digits_over_short_times(duration):
    n = 1.1e-3
    with mpmath.workdps(40):
        t, angle = mpmath.mpf(duration), mpmath.mpf(n) * duration
        s, c = mpmath.sin(angle), mpmath.cos(angle)
        exact = np.array(
            [
                [4 - 3 * c, 0, 0, s / n, 2 * (1 - c) / n, 0],
                [6 * (s - angle), 1, 0, -2 * (1 - c) / n, 4 * s / n - 3 * t, 0],
                [0, 0, c, 0, 0, s / n],
                [3 * n * s, 0, 0, c, 2 * s, 0],
                [-6 * n * (1 - c), 0, 0, -2 * s, 4 * c - 3, 0],
                [0, 0, -n * s, 0, 0, c],
            ],
            float,
        )
    np.testing.assert_allclose(transition_matrix(n, duration), exact, rtol=1e-15, atol=0.0)


# Motion, in sub-steps --------------------------------------------------------------------------------


@njit
def in_substeps(orbit, reference, r, v, q, h, number):  # type: ignore[no-untyped-def]  # Numba infers types
    """Position, velocity and attitude of a craft that feels nothing and does not turn, and the reference."""
    nothing = (0.0, 0.0, 0.0)
    for _ in range(number):
        frames = orbits.step_frames(orbit, reference, h)
        q = orbits.follow_frame(orbit, frames[0], frames[2], h, q)
        r, v = orbits.translation_step(r, v, nothing, nothing, nothing, orbit, frames, h)
        reference = frames[2].reference
    return r, v, q, reference


def coast(orbit: Orbit, nonlinear: bool, duration: float, number: int) -> tuple[Array, Array]:
    """State (6,) and attitude (4,) after a coast from START in so many sub-steps."""
    kind = orbits.kind_of(orbit, nonlinear=nonlinear)
    reference = orbits.reference_at(kind, orbits.Elements.of(orbit), orbits.true_anomaly_at(orbit, 0.0))
    r, v, q, _ = in_substeps(
        kind, reference, tuple(START[:3]), tuple(START[3:]), (1.0, 0.0, 0.0, 0.0), duration / number, number
    )
    return np.array([*r, *v]), np.array(q)


def in_inertial_space(orbit: Orbit, duration: float) -> tuple[Array, Array]:
    """Relative state (6,) and axes of LVLH at its end in those at its start, by two orbits, from START."""
    place, velocity = on_orbit(orbit, orbit.true_anomaly)
    axes = local_axes(place, velocity)
    turning = frame_turning(place, velocity, orbit)
    other = place + axes.T @ START[:3]
    other_velocity = velocity + axes.T @ (START[3:] + np.cross(turning, START[:3]))

    def slope(_: float, state: Array) -> Array:
        return np.concatenate([state[3:6], gravity(state[:3], orbit), state[9:], gravity(state[6:9], orbit)])

    begin = np.concatenate([place, velocity, other, other_velocity])
    end = solve_ivp(slope, (0.0, duration), begin, method="DOP853", rtol=1e-13, atol=1e-8).y[:, -1]
    last = local_axes(end[:3], end[3:6])
    position = last @ (end[6:9] - end[:3])
    turning = frame_turning(end[:3], end[3:6], orbit)
    velocity = last @ (end[9:] - end[3:6]) - np.cross(turning, position)
    return np.concatenate([position, velocity]), axes @ last.T


def test_the_linear_motion_in_substeps_is_the_transition_matrix():
    duration = 1.3 * APOGEE.period
    state, _ = coast(APOGEE, False, duration, 4000)
    assert_close(state, transition_matrix(APOGEE, duration) @ START, 1e-9)


@pytest.mark.parametrize(
    ("orbit", "tolerance"),
    [(APOGEE, 1e-8), (dataclasses.replace(APOGEE, eccentricity=0.05), 1e-8), (OBLATE, 1e-8)],
    ids=["elliptic", "nearly circular", "oblate"],
)
def test_craft_move_as_two_orbits_in_inertial_space_do(orbit, tolerance):
    """The relative state in LVLH, and how LVLH itself has turned under a body that does not."""
    duration = 1.3 * orbit.period
    exact, axes = in_inertial_space(orbit, duration)
    state, attitude = coast(orbit, True, duration, 4000)
    assert_close(state, exact, tolerance)
    np.testing.assert_allclose(rotation_matrix(attitude), axes, atol=1e-10)


def test_j2_moves_the_frame_and_the_craft_by_what_it_should():
    """The node regresses at the well-known rate, 3/2 J2 n (R / p)^2 cos i, up to terms of second order."""
    circle = Orbit(
        semi_major_axis=7000e3, inclination=0.9, j2=EARTH_J2, planet_radius=EARTH_RADIUS, true_anomaly=0.0
    )
    kind, orbits_flown = orbits.kind_of(circle, nonlinear=True), 10
    reference = orbits.reference_at(kind, orbits.Elements.of(circle), 0.0)
    duration = orbits_flown * circle.period
    _, _, _, end = in_substeps(
        kind, reference, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), duration / 4000, 4000
    )
    expected = -1.5 * EARTH_J2 * circle.mean_motion * (EARTH_RADIUS / 7000e3) ** 2 * math.cos(0.9) * duration
    assert end[3] - reference[3] == pytest.approx(expected, rel=5e-3)


def test_each_craft_keeps_its_own_energy_and_momentum_about_the_planet():
    """On an ellipse, by two bodies: those of an orbit of its own, which START puts it on."""
    axes_and_turning = in_inertial_space(APOGEE, 1e-9)[0]
    np.testing.assert_allclose(axes_and_turning, START, atol=1e-6)
    kind = orbits.kind_of(APOGEE, nonlinear=True)
    energies = []
    for share in (0.0, 0.4, 1.0):
        duration = share * APOGEE.period
        state, _ = coast(APOGEE, True, duration, 3000) if share else (START, None)
        motion = orbits.frame_motion(kind, APOGEE.start + duration)
        climb = -0.5 * motion.acceleration * motion.radius / motion.rate
        place = state[:3] + np.array([motion.radius, 0.0, 0.0])
        velocity = state[3:] + np.array([climb, 0.0, 0.0]) + np.cross([0.0, 0.0, motion.rate], place)
        momentum = np.cross(place, velocity)
        energies.append(
            [0.5 * velocity @ velocity - EARTH_MU / np.linalg.norm(place), np.linalg.norm(momentum)]
        )
    np.testing.assert_allclose(energies, np.broadcast_to(energies[0], (3, 2)), rtol=1e-12)
