"""The orbit about which a spacecraft flies: classical elements at an epoch, and the planet below.

Models a Kepler orbit, circular where the eccentricity is 0; with `j2` the planet's oblateness acts on it and
on what flies about it. The reference frame of a flight, LVLH (x radial, y along-track, z cross-track), stands
at the point that moves on this orbit.

Left out: parabolas and hyperbolas, other harmonics, drag, third bodies. The epoch is a time of the episode's
clock and no date: nothing here depends on the date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from thruster_envs.configuration import coerce_fields

EARTH_MU = 3.986004418e14
"""Gravitational parameter of the Earth, m^3/s^2 (IERS 2010)."""

EARTH_RADIUS, EARTH_J2 = 6378136.6, 1.0826359e-3
"""Equatorial radius of the Earth, m, and its second zonal harmonic (IERS 2010)."""

MARS_MU, MARS_RADIUS, MARS_J2 = 4.282837e13, 3396.2e3, 1.9605e-3
"""The same of Mars."""

FASTEST_ORBIT, SLOWEST_ORBIT = 1.0, 1e-15
"""Largest mean motion, rad/s, a thousand times that of the lowest orbit about any planet; smallest one."""

MOST_ECCENTRIC = 0.99
"""Largest eccentricity."""

LARGEST_J2 = 0.1
"""Ten times that of Saturn, the most oblate planet there is."""


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """A Kepler orbit by its elements.

    Attributes:
        semi_major_axis: m; 0 where the mean motion is given instead, and then it follows from it.
        mean_motion: rad/s; 0 where the semi-major axis is given instead. If both are given they must agree.
        eccentricity: From 0, a circle, to 0.99.
        inclination: rad, 0 to pi. Like the next two it matters only to oblateness.
        raan: Right ascension of the ascending node, rad.
        argument_of_perigee: rad.
        true_anomaly: At the epoch, rad.
        true_anomaly_dispersion: Half-width about it within which the true anomaly of an episode is drawn,
            uniformly, rad: 0 draws nothing, pi draws from the whole orbit.
        epoch: When the craft stands at that true anomaly, s of the episode's clock.
        gravitational_parameter: Of the planet, m^3/s^2; the Earth's unless given.
        j2: Second zonal harmonic of the planet; 0 for a sphere. The Earth's is `EARTH_J2`.
        planet_radius: Equatorial radius that belongs to `j2`, m; 0 where it is not given.

    Raises:
        ValueError: A value that no such orbit has; one line says which and what is right.

    >>> molniya = Orbit(semi_major_axis=26600e3, eccentricity=0.74)
    >>> round(molniya.period / 3600.0, 2)
    11.99
    """

    semi_major_axis: float = 0.0
    mean_motion: float = 0.0
    eccentricity: float = 0.0
    inclination: float = 0.0
    raan: float = 0.0
    argument_of_perigee: float = 0.0
    true_anomaly: float = 0.0
    true_anomaly_dispersion: float = 0.0
    epoch: float = 0.0
    gravitational_parameter: float = EARTH_MU
    j2: float = 0.0
    planet_radius: float = 0.0

    def __post_init__(self) -> None:
        coerce_fields(self)
        _check("gravitational_parameter", self.gravitational_parameter, 1e-15, 1e25, "m^3/s^2")
        self._complete_size()
        _check("eccentricity", self.eccentricity, 0.0, MOST_ECCENTRIC)
        if not 0.0 <= self.inclination <= math.pi:
            raise ValueError(f"inclination must be from 0 to pi rad, got {self.inclination!r}")
        for name in ("raan", "argument_of_perigee", "true_anomaly"):
            if not abs(getattr(self, name)) <= 2.0 * math.pi:
                raise ValueError(f"{name} must be from -2 pi to 2 pi rad, got {getattr(self, name)!r}")
        _check("true_anomaly_dispersion", self.true_anomaly_dispersion, 0.0, math.pi, "rad")
        _check("epoch", self.epoch, -1e9, 1e9, "s")
        _check("j2", self.j2, 0.0, LARGEST_J2)
        _check("planet_radius", self.planet_radius, 0.0, 1e15, "m")
        if self.j2 > 0.0 and self.planet_radius == 0.0:
            raise ValueError(f"planet_radius must be given beside j2, got j2 = {self.j2!r} alone")
        if self.perigee_radius < self.planet_radius:
            raise ValueError(
                f"its perigee must be outside the planet, at {self.planet_radius:g} m or more from its "
                f"centre, got {self.perigee_radius:g} m"
            )

    def _complete_size(self) -> None:
        """Fill in whichever of semi-major axis and mean motion was not given."""
        a, n, mu = self.semi_major_axis, self.mean_motion, self.gravitational_parameter
        if a == 0.0 and n == 0.0:
            raise ValueError("semi_major_axis (m) or mean_motion (rad/s) must be given, got neither")
        if a != 0.0:
            if not 0.0 < a < 1e30:
                raise ValueError(f"semi_major_axis must be a positive number of m, got {a!r}")
            follows = math.sqrt(mu / a**3)
            n = follows if n == 0.0 else n
        _check("mean_motion", n, SLOWEST_ORBIT, FASTEST_ORBIT, "rad/s")
        if a == 0.0:
            a = (mu / n**2) ** (1.0 / 3.0)
        elif abs(n / follows - 1.0) > 1e-9:
            raise ValueError(
                f"mean_motion must be that of the semi_major_axis, {follows!r} rad/s, got {n!r}; "
                "one of the two is enough"
            )
        object.__setattr__(self, "semi_major_axis", a)
        object.__setattr__(self, "mean_motion", n)

    @property
    def is_circular(self) -> bool:
        """Whether its eccentricity is exactly 0."""
        return self.eccentricity == 0.0

    @property
    def is_steady(self) -> bool:
        """Whether LVLH turns at one rate all the time: on a circle about a sphere."""
        return self.is_circular and self.j2 == 0.0

    @property
    def period(self) -> float:
        """Time of one revolution, s."""
        return 2.0 * math.pi / self.mean_motion

    @property
    def perigee_radius(self) -> float:
        """Smallest distance from the centre of the planet, m."""
        return self.semi_major_axis * (1.0 - self.eccentricity)

    @property
    def fastest_rate(self) -> float:
        """Largest rate at which LVLH turns, at perigee, rad/s: the mean motion where it is circular."""
        e = self.eccentricity
        return self.mean_motion * (1.0 + e) ** 2 / (1.0 - e * e) ** 1.5 if e > 0.0 else self.mean_motion

    def time_since_perigee(self, true_anomaly: float) -> float:
        """How long after its last perigee, or before its next one, it stands at a true anomaly (rad), s.

        From minus half a period to half of one.

        >>> orbit = Orbit(mean_motion=1e-3, eccentricity=0.3)
        >>> orbit.time_since_perigee(math.pi) == 0.5 * orbit.period
        True
        """
        half = 0.5 * math.remainder(true_anomaly, 2.0 * math.pi)
        e = self.eccentricity
        eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
        return (eccentric - e * math.sin(eccentric)) / self.mean_motion

    @property
    def start(self) -> float:
        """Time since perigee at the start of an episode that begins at `true_anomaly`, s."""
        return self.time_since_perigee(self.true_anomaly) - self.epoch


def _check(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not low <= value <= high:
        raise ValueError(f"{name} must be from {low:g} to {high:g} {unit}".rstrip() + f", got {value!r}")
