"""Small accelerations of a craft against a target on a circular orbit: oblateness, drag, solar pressure.

Models the differential acceleration by the planet's J2 as a linear gradient at the target (Schweighart and
Sedwick 2002, "High-fidelity linearized J2 model for satellite formation flight", eq. 9), drag against the
velocity of the orbit, and the pressure of a Sun that stands in the plane of the orbit. Drag and pressure are
those of the craft alone, as if the target felt none: a bound on the difference.

Leaves out eclipses, other harmonics, a change of density or area, and torques.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.physics.orbits import orbit_radius
from thruster_envs.random import cos_sin_turns
from thruster_envs.spacecraft import Spacecraft

#: N/m^2, solar pressure at the Earth's distance, and at that of Mars.
SOLAR_PRESSURE_EARTH, SOLAR_PRESSURE_MARS = 4.56e-6, 1.97e-6

# Entries of the numbers: 6 J2 (R / a)^2 n^2 in 1/s^2; sine and cosine of the inclination; drag and solar
# pressure, m/s^2.
_GRADIENT, _SINE, _COSINE, _DRAG, _PRESSURE, _NUMBERS = range(6)


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """What disturbs a craft; by default one of 20 m^2 in a low orbit of Mars (parameter set MSR-A, ours).

    Attributes:
        oblateness: J2 of the planet.
        equatorial_radius: Of the planet, m.
        inclination: Of the orbit, rad.
        area: Of the craft, m^2.
        density: Of the air at the orbit, kg/m^3.
        drag_coefficient: Dimensionless.
        reflection_coefficient: Dimensionless, 1 where all light is absorbed.
        solar_pressure: N/m^2.
    """

    oblateness: float = 1.9605e-3
    equatorial_radius: float = 3396.2e3
    inclination: float = math.radians(45.0)
    area: float = 20.0
    density: float = 1e-13
    drag_coefficient: float = 2.2
    reflection_coefficient: float = 1.3
    solar_pressure: float = SOLAR_PRESSURE_MARS

    def numbers(self, spacecraft: Spacecraft) -> NDArray[np.float64]:
        """(5,): what :func:`disturb` reads, for a spacecraft of its nominal mass on its orbit."""
        n = spacecraft.mean_motion
        radius = orbit_radius(n, spacecraft.gravitational_parameter)
        per_mass = self.area / spacecraft.mass
        values = np.zeros(_NUMBERS)
        values[_GRADIENT] = 6.0 * self.oblateness * (self.equatorial_radius / radius) ** 2 * n * n
        values[_SINE], values[_COSINE] = math.sin(self.inclination), math.cos(self.inclination)
        values[_DRAG] = 0.5 * self.density * (n * radius) ** 2 * self.drag_coefficient * per_mass
        values[_PRESSURE] = self.solar_pressure * self.reflection_coefficient * per_mass
        return values


@njit(forceinline=True)
def disturb(r, latitude, sun, numbers):
    """Acceleration of a craft at ``r`` (m, LVLH) against the target, m/s^2 in LVLH.

    ``latitude`` is the target's argument of latitude, ``sun`` the direction in which sunlight travels,
    counted likewise; turns from 0 to 1.
    """
    cosine, sine = cos_sin_turns(latitude)
    s, c, k = numbers[_SINE], numbers[_COSINE], numbers[_GRADIENT]
    double = 2.0 * sine * cosine
    xx, xy, xz = 1.0 - 3.0 * s * s * sine * sine, s * s * double, 2.0 * s * c * sine
    yy = -0.25 - s * s * (0.5 - 1.75 * sine * sine)
    yz = -0.5 * s * c * cosine
    zz = -0.75 + s * s * (0.5 + 1.25 * sine * sine)
    ahead = sun - latitude
    light_x, light_y = cos_sin_turns(ahead if ahead >= 0.0 else ahead + 1.0)
    return (
        k * (xx * r[0] + xy * r[1] + xz * r[2]) + numbers[_PRESSURE] * light_x,
        k * (xy * r[0] + yy * r[1] + yz * r[2]) + numbers[_PRESSURE] * light_y - numbers[_DRAG],
        k * (xz * r[0] + yz * r[1] + zz * r[2]),
    )
