"""The kinds of orbit, as kernels take them, and how LVLH moves on them at a moment."""

import math
from typing import NamedTuple

from thruster_envs.helpers import njit
from thruster_envs.spacecraft.orbit import EARTH_MU, Orbit


class Hill(NamedTuple):
    """A circular orbit, about which craft move by Hill's equations: mean motion, rad/s."""

    mean_motion: float


class Circular(NamedTuple):
    """A circular orbit, about which craft move as two bodies do: mean motion, rad/s, and radius, m."""

    mean_motion: float
    radius: float


class LinearElliptic(NamedTuple):
    """An elliptic orbit, about which craft move by the linear equations.

    Attributes:
        mean_motion: rad/s.
        semi_major_axis: m.
        eccentricity: 1.
        breadth: Square root of one less the square of the eccentricity, 1.
    """

    mean_motion: float
    semi_major_axis: float
    eccentricity: float
    breadth: float


class Elliptic(NamedTuple):
    """An elliptic orbit, about which craft move as two bodies do; as :class:`LinearElliptic`."""

    mean_motion: float
    semi_major_axis: float
    eccentricity: float
    breadth: float


class Ellipse(NamedTuple):
    """Where LVLH stands on its ellipse, for who flies about orbits of any kind.

    Attributes:
        mean_motion: As the next three it is one of :class:`LinearElliptic`.
        semi_major_axis: m.
        eccentricity: 1.
        breadth: 1.
        time: Since perigee, s.
        anomaly: True anomaly, rad, from -pi to pi.
        angle: From a direction at rest in the plane of the orbit, rad.
    """

    mean_motion: float
    semi_major_axis: float
    eccentricity: float
    breadth: float
    time: float
    anomaly: float
    angle: float


class Oblate(NamedTuple):
    """An orbit about an oblate planet.

    Its reference: radius, m; its rate, m/s; angular momentum, m^2/s; right ascension of the node, inclination
    and argument of latitude, rad, osculating.

    Attributes:
        mu: Gravitational parameter, m^3/s^2.
        strength: ``3/2 J2 mu R^2``, m^5/s^2.
    """

    mu: float
    strength: float


class Motion(NamedTuple):
    """How LVLH moves on an elliptic orbit at a moment.

    Attributes:
        reference: Time since perigee, s.
        rate: At which it turns about its z, rad/s.
        acceleration: Of that, rad/s^2.
        radius: Distance from the centre of the planet, m.
        gravity: ``mu / radius**3``, 1/s^2.
        cosine: Of half of the true anomaly, not negative.
        sine: Of the same.
    """

    reference: float
    rate: float
    acceleration: float
    radius: float
    gravity: float
    cosine: float
    sine: float


class OblateMotion(NamedTuple):
    """How LVLH moves about an oblate planet at a moment.

    Attributes:
        reference: As in :class:`Oblate`.
        rate_x: About its x, rad/s; the one about y is 0.
        rate_z: About its z, rad/s.
        acceleration_x: rad/s^2.
        acceleration_z: rad/s^2.
        radius: Distance from the centre of the planet, m.
        north: Components of the direction of the planet's axis in LVLH, 3.
    """

    reference: tuple[float, float, float, float, float, float]
    rate_x: float
    rate_z: float
    acceleration_x: float
    acceleration_z: float
    radius: float
    north: tuple[float, float, float]


_KINDS = (Hill, Circular, LinearElliptic, Elliptic, Oblate)

#: Numbers of the reference of each kind.
REFERENCE_SIZES = {Hill: 0, Circular: 0, LinearElliptic: 1, Elliptic: 1, Oblate: 6}


def pack_orbit(
    orbit: Hill | Circular | LinearElliptic | Elliptic | Oblate,
) -> tuple[tuple[float, ...], tuple[None, ...]]:
    """An orbit as plain tuples: its numbers, and as many None as its kind stands behind the first."""
    return tuple(orbit), (None,) * _KINDS.index(type(orbit))


@njit(forceinline=True)
def open_orbit(numbers, kind):
    """The orbit that :func:`pack_orbit` made plain; which kind it is, is decided when compiled."""
    if len(kind) == 0:
        return Hill(numbers[0])
    if len(kind) == 1:
        return Circular(numbers[0], numbers[1])
    if len(kind) == 2:
        return LinearElliptic(numbers[0], numbers[1], numbers[2], numbers[3])
    if len(kind) == 3:
        return Elliptic(numbers[0], numbers[1], numbers[2], numbers[3])
    return Oblate(numbers[0], numbers[1])


def kind_of(orbit: Orbit, *, nonlinear: bool) -> Hill | Circular | LinearElliptic | Elliptic | Oblate:
    """What kernels take for an orbit. With J2 craft always move without linearisation."""
    if orbit.j2 > 0.0:
        return Oblate(
            orbit.gravitational_parameter,
            1.5 * orbit.j2 * orbit.gravitational_parameter * orbit.planet_radius**2,
        )
    n = orbit.mean_motion
    if orbit.is_circular:
        return Circular(n, orbit_radius(n, orbit.gravitational_parameter)) if nonlinear else Hill(n)
    return ellipse_of(orbit) if nonlinear else LinearElliptic(*ellipse_of(orbit))


def ellipse_of(orbit: Orbit) -> Elliptic:
    """An orbit without its J2, as kernels take it."""
    e = orbit.eccentricity
    return Elliptic(orbit.mean_motion, orbit.semi_major_axis, e, math.sqrt(1.0 - e * e))


def orbit_radius(mean_motion: float, mu: float = EARTH_MU) -> float:
    """Radius in m of the circular orbit with that mean motion in rad/s."""
    return float((mu / mean_motion**2) ** (1.0 / 3.0))
