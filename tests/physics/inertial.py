"""Craft and LVLH in the axes of the planet, by SciPy: what flights about orbits of any kind are judged by.

Shares nothing with the package but the elements of an orbit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from tests.physics.closed_forms import rotation_matrix
from thruster_envs.spacecraft import Orbit, Spacecraft

Array = NDArray[np.float64]
Loads = Callable[[float], tuple[Array, Array, float]]
"""Force (N) and torque (N m) in body axes, and mass flow (kg/s), by time (s)."""
Gradients = Callable[[Array, Array], Array]
"""Torque (N m) in body axes, by place (m) and attitude in the planet's axes."""


def on_orbit(orbit: Orbit, anomaly: float) -> tuple[Array, Array]:
    """Place (m) and velocity (m/s) of LVLH in the planet's axes at a true anomaly (rad)."""
    e = orbit.eccentricity
    p = orbit.semi_major_axis * (1.0 - e * e)
    in_plane = np.array([math.cos(anomaly), math.sin(anomaly), 0.0]) * p / (1.0 + e * math.cos(anomaly))
    speed = math.sqrt(orbit.gravitational_parameter / p)
    to_planet = np.eye(3)
    for angle, axis in ((orbit.raan, 2), (orbit.inclination, 0), (orbit.argument_of_perigee, 2)):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        to_planet = to_planet @ np.roll(turn, axis + 1, axis=(0, 1))
    velocity = speed * np.array([-math.sin(anomaly), e + math.cos(anomaly), 0.0])
    return to_planet @ in_plane, to_planet @ velocity


def gravity(place: Array, orbit: Orbit) -> Array:
    """Acceleration (m/s^2) in the planet's axes, of a sphere and of J2."""
    distance = np.linalg.norm(place)
    sphere = -orbit.gravitational_parameter * place / distance**3
    height = (place[2] / distance) ** 2
    bulge = 1.5 * orbit.j2 * orbit.gravitational_parameter * orbit.planet_radius**2 / distance**5
    return np.asarray(sphere - bulge * place * (np.array([1.0, 1.0, 3.0]) - 5.0 * height))


def local_axes(place: Array, velocity: Array) -> Array:
    """(3, 3), rows: the axes of LVLH."""
    normal = np.cross(place, velocity)
    x, z = place / np.linalg.norm(place), normal / np.linalg.norm(normal)
    return np.array([x, np.cross(z, x), z])


def frame_turning(place: Array, velocity: Array, orbit: Orbit) -> Array:
    """Rate (3,) of LVLH in its own axes: by its momentum, and by what pushes out of its plane."""
    momentum = np.cross(place, velocity)
    size, distance = np.linalg.norm(momentum), np.linalg.norm(place)
    across = gravity(place, orbit) @ momentum / size
    return np.array([distance * across / size, 0.0, size / distance**2])


@dataclass
class InertialFlight:
    """One craft beside LVLH, both in the planet's axes.

    Attributes:
        spacecraft: What flies.
        state: (26,), place and velocity of LVLH; then of the craft, m and m/s; attitude as the matrix that
            takes the planet's axes into those of the body, 9; rate, rad/s, body axes; mass, kg; time, s.
    """

    spacecraft: Spacecraft
    state: Array

    @classmethod
    def begin(cls, spacecraft: Spacecraft, relative: ArrayLike, anomaly: float) -> InertialFlight:
        """From position, velocity, attitude, rate and mass (14,) against LVLH, and a true anomaly (rad)."""
        orbit, numbers = spacecraft.reference_orbit, np.array(relative)
        place, velocity = on_orbit(orbit, anomaly)
        axes, turning = local_axes(place, velocity), frame_turning(place, velocity, orbit)
        other = place + axes.T @ numbers[:3]
        other_velocity = velocity + axes.T @ (numbers[3:6] + np.cross(turning, numbers[:3]))
        attitude = rotation_matrix(numbers[6:10]) @ axes
        return cls(
            spacecraft,
            np.concatenate([place, velocity, other, other_velocity, attitude.ravel(), numbers[10:14], [0.0]]),
        )

    def fly(self, duration: float, loads: Loads | None = None, gradients: Gradients | None = None) -> None:
        """Let time pass, under smooth loads and torques by the place where it is."""
        orbit, inertia = self.spacecraft.reference_orbit, np.array(self.spacecraft.inertia)
        start = self.state[-1]

        def slope(time: float, y: Array) -> Array:
            attitude, rate, mass = y[12:21].reshape(3, 3), y[21:24], y[24]
            force, torque, flow = np.zeros(3), np.zeros(3), 0.0
            if loads is not None:
                force, torque, flow = loads(start + time)
            if gradients is not None:
                torque = torque + gradients(y[:3], attitude)
            x, y_, z = rate
            spin = np.array([[0.0, z, -y_], [-z, 0.0, x], [y_, -x, 0.0]])
            change = np.linalg.solve(inertia, torque - np.cross(rate, inertia @ rate))
            pulled = gravity(y[6:9], orbit) + attitude.T @ force / mass
            return np.concatenate(
                [
                    y[3:6], gravity(y[:3], orbit), y[9:12], pulled,
                    (spin @ attitude).ravel(), change, [-flow, 1.0],
                ]
            )  # fmt: skip

        scale = np.array(2 * ([1e-7] * 3 + [1e-10] * 3) + [1e-13] * 14)
        found = solve_ivp(slope, (0.0, duration), self.state, method="DOP853", rtol=1e-13, atol=scale)
        assert found.success
        self.state = found.y[:, -1]

    def turn(self, change: Array) -> None:
        """Change the rate of the body at once, rad/s."""
        self.state[21:24] += change

    @property
    def axes(self) -> Array:
        """(3, 3), rows: the axes of LVLH now."""
        return local_axes(self.state[:3], self.state[3:6])

    @property
    def relative(self) -> Array:
        """Position and velocity (6,) against LVLH."""
        place, velocity = self.state[:3], self.state[3:6]
        position = self.axes @ (self.state[6:9] - place)
        turning = frame_turning(place, velocity, self.spacecraft.reference_orbit)
        speed = self.axes @ (self.state[9:12] - velocity) - np.cross(turning, position)
        return np.concatenate([position, speed])

    @property
    def body_from_lvlh(self) -> Array:
        """(3, 3), attitude against LVLH."""
        return self.state[12:21].reshape(3, 3) @ self.axes.T
