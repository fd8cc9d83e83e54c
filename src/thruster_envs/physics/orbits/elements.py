"""Where on its orbit an episode begins: elements, and true anomalies."""

import math
from typing import NamedTuple

from thruster_envs.helpers import njit
from thruster_envs.physics.orbits.kinds import ellipse_of
from thruster_envs.physics.orbits.motion import eccentric_anomaly, frame_motion
from thruster_envs.spacecraft.orbit import Orbit


class Elements(NamedTuple):
    """What the reference at the start of an episode follows from: m, 1, m^3/s^2, s, and angles in rad."""

    semi_major_axis: float
    eccentricity: float
    gravitational_parameter: float
    inclination: float
    raan: float
    argument_of_perigee: float
    true_anomaly: float
    true_anomaly_dispersion: float
    epoch: float

    @classmethod
    def of(cls, orbit: Orbit) -> "Elements":
        """Those of an orbit."""
        return cls(*(getattr(orbit, name) for name in cls._fields))


def true_anomaly_at(orbit: Orbit, time: float) -> float:
    """True anomaly at a time of the episode's clock (s), from -pi to pi, J2 left out.

    >>> orbit = Orbit(mean_motion=1e-3, eccentricity=0.3, true_anomaly=2.0)
    >>> round(true_anomaly_at(orbit, 0.0), 12)
    2.0
    """
    motion = frame_motion.py_func(ellipse_of(orbit), orbit.start + time)
    return 2.0 * math.atan2(motion.sine, motion.cosine)


@njit(forceinline=True)
def open_elements(numbers):
    """The :class:`Elements` of a plain tuple of them."""
    return Elements(
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], numbers[7],
        numbers[8],
    )  # fmt: skip


@njit
def anomaly_at_start(elements, chance):
    """True anomaly at the start of an episode, rad, by a number from 0 to 1; J2 is left out."""
    e = elements.eccentricity
    anomaly = elements.true_anomaly + elements.true_anomaly_dispersion * (2.0 * chance - 1.0)
    if elements.epoch == 0.0:
        return anomaly
    n = math.sqrt(elements.gravitational_parameter / elements.semi_major_axis) / elements.semi_major_axis
    mean = n * since_perigee(n, e, anomaly) - n * elements.epoch
    mean -= 2.0 * math.pi * math.floor(mean / (2.0 * math.pi) + 0.5)
    half = 0.5 * eccentric_anomaly(mean, e)
    return 2.0 * math.atan2(math.sqrt(1.0 + e) * math.sin(half), math.sqrt(1.0 - e) * math.cos(half))


@njit(forceinline=True)
def since_perigee(n, e, anomaly):
    """Time since perigee, s, at a true anomaly, rad."""
    half = 0.5 * anomaly
    eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
    return (eccentric - e * math.sin(eccentric)) / n
