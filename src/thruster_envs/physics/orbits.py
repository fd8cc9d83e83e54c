"""Relative translation about an orbit: frame motion, free acceleration, and the transition matrix.

Frame: LVLH, x radial (outward), y along-track, z cross-track, origin at the point that moves on the orbit;
positions in m, accelerations in m/s^2. An orbit is one of five kinds, a NamedTuple each, and what is asked
of it is chosen by its kind when a kernel is compiled:

- :class:`Hill`: circular, linear (Clohessy and Wiltshire 1960);
- :class:`Circular`: circular, two bodies;
- :class:`LinearElliptic`: elliptic, linear and time-varying (Tschauner and Hempel 1965, over time);
- :class:`Elliptic`: elliptic, two bodies;
- :class:`Oblate`: origin and craft both under the planet's J2, without linearisation (Xu and Wang 2008).

The *reference* of a craft says where the origin stands: nothing on a circular orbit, the time since perigee
in s on an elliptic one, six numbers of its motion about an oblate planet (:class:`Oblate`).

Leaves out other harmonics, drag, solar pressure, third bodies, and hyperbolas.

Sources: Alfriend et al. 2010, "Spacecraft Formation Flying", eqs. 4.14-4.16; Yamanaka and Ankersen 2002, "New
state transition matrix for relative motion on an arbitrary elliptical orbit"; Xu and Wang 2008, "Nonlinear
dynamic equations of satellite relative motion around an oblate Earth"; Danby 1987, "The solution of Kepler's
equation III".
"""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.physics.attitude import conjugate, follow_orbit, quaternion_product
from thruster_envs.spacecraft.orbit import EARTH_MU, Orbit

# The kinds of orbit --------------------------------------------------------------------------------------


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
    return _ellipse(orbit) if nonlinear else LinearElliptic(*_ellipse(orbit))


def _ellipse(orbit: Orbit) -> Elliptic:
    e = orbit.eccentricity
    return Elliptic(orbit.mean_motion, orbit.semi_major_axis, e, math.sqrt(1.0 - e * e))


def orbit_radius(mean_motion: float, mu: float = EARTH_MU) -> float:
    """Radius in m of the circular orbit with that mean motion in rad/s."""
    return float((mu / mean_motion**2) ** (1.0 / 3.0))


# Kepler's equation ---------------------------------------------------------------------------------------


@njit(forceinline=True)
def cos_sin(angle):
    """Cosine and sine of an angle of a few turns (rad), to rounding and without branches."""
    quarter = np.floor(0.6366197723675814 * angle + 0.5)
    x = (angle - 1.5707963267341256 * quarter) - 6.077100506506192e-11 * quarter
    z = x * x
    sine = x * (1.0 - 1 / 6 * z * (1.0 - 1 / 20 * z * (1.0 - 1 / 42 * z * (1.0 - 1 / 72 * z * (
        1.0 - 1 / 110 * z * (1.0 - 1 / 156 * z * (1.0 - 1 / 210 * z * (1.0 - 1 / 272 * z))))))))  # fmt: skip
    cosine = 1.0 - 1 / 2 * z * (1.0 - 1 / 12 * z * (1.0 - 1 / 30 * z * (1.0 - 1 / 56 * z * (
        1.0 - 1 / 90 * z * (1.0 - 1 / 132 * z * (1.0 - 1 / 182 * z * (1.0 - 1 / 240 * z)))))))  # fmt: skip
    quarter = quarter - 4.0 * np.floor(0.25 * quarter)
    swap = (quarter == 1.0) | (quarter == 3.0)
    cosine, sine = (sine, cosine) if swap else (cosine, sine)
    cosine = -cosine if (quarter == 1.0) | (quarter == 2.0) else cosine
    sine = -sine if (quarter == 2.0) | (quarter == 3.0) else sine
    return cosine, sine


@njit(forceinline=True)
def eccentric_anomaly(mean_anomaly, eccentricity):
    """Solution ``E`` of Kepler's equation ``M = E - e sin E`` for ``M`` from -pi to pi, rad.

    Danby's start and four steps of his, of fourth order each: exact to rounding for any eccentricity up to
    0.99 (rounding itself is magnified by ``1 / (1 - e cos E)``).
    """
    e = eccentricity
    x = mean_anomaly + (0.85 * e if mean_anomaly >= 0.0 else -0.85 * e)
    for _ in range(4):
        c, s = cos_sin(x)
        f0, f1, f2, f3 = (x - e * s) - mean_anomaly, 1.0 - e * c, e * s, e * c
        d1 = -f0 / f1
        d2 = -f0 / (f1 + 0.5 * d1 * f2)
        x = x - f0 / (f1 + 0.5 * d2 * f2 + 1 / 6 * d2 * d2 * f3)
    return x


@njit(forceinline=True)
def mean_anomaly(mean_motion, time):
    """Mean anomaly from -pi to pi, rad, at a time since perigee, s."""
    turns = 0.15915494309189535 * mean_motion * time
    return 6.283185307179586 * (turns - np.floor(turns + 0.5))


@njit(forceinline=True)
def frame_motion(orbit, time):
    """The :class:`Motion` of LVLH on an elliptic orbit at a time since perigee, s."""
    e, b = orbit.eccentricity, orbit.breadth
    c, s = cos_sin(0.5 * eccentric_anomaly(mean_anomaly(orbit.mean_motion, time), e))
    cosine, sine = 1.0 - 2.0 * s * s, 2.0 * s * c  # of the eccentric anomaly
    share = 1.0 - e * cosine  # of the radius in the semi-major axis
    inverse = 1.0 / share
    n = orbit.mean_motion * inverse
    rate = n * b * inverse
    # r' = n a e sin(E) / share, and r theta'' = - 2 r' theta'
    acceleration = -2.0 * rate * (n * inverse * e * sine)
    root = (1.0 / share) ** 0.5
    return Motion(
        time,
        rate,
        acceleration,
        orbit.semi_major_axis * share,
        n * n * inverse,
        (1.0 - e) ** 0.5 * c * root,
        (1.0 + e) ** 0.5 * s * root,
    )


# About an oblate planet ----------------------------------------------------------------------------------


@njit
def oblate_rates(orbit, reference):
    """Rates of the reference of an :class:`Oblate` orbit (Xu and Wang 2008, eqs. 27-32), six numbers."""
    radius, climb, momentum, _, inclination, latitude = reference
    ci, si = cos_sin(inclination)
    cl, sl = cos_sin(latitude)
    k = orbit.strength
    r2 = radius * radius
    r3 = r2 * radius
    return (
        climb,
        (momentum * momentum / radius - orbit.mu) / r2 - k / (r2 * r2) * (1.0 - 3.0 * si * si * sl * sl),
        -k * si * si * 2.0 * sl * cl / r3,
        -2.0 * k * ci * sl * sl / (momentum * r3),
        -k * 2.0 * si * ci * sl * cl / (momentum * r3),
        momentum / r2 + 2.0 * k * ci * ci * sl * sl / (momentum * r3),
    )


@njit
def oblate_step(orbit, reference, h):
    """The reference of an :class:`Oblate` orbit ``h`` seconds later, by one RK4 step."""
    a = oblate_rates(orbit, reference)
    b = oblate_rates(orbit, _six_along(reference, 0.5 * h, a))
    c = oblate_rates(orbit, _six_along(reference, 0.5 * h, b))
    d = oblate_rates(orbit, _six_along(reference, h, c))
    total = (
        a[0] + 2.0 * (b[0] + c[0]) + d[0],
        a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2],
        a[3] + 2.0 * (b[3] + c[3]) + d[3],
        a[4] + 2.0 * (b[4] + c[4]) + d[4],
        a[5] + 2.0 * (b[5] + c[5]) + d[5],
    )
    return _six_along(reference, 1 / 6 * h, total)


@njit(forceinline=True)
def _six_along(a, s, b):
    return (
        a[0] + s * b[0],
        a[1] + s * b[1],
        a[2] + s * b[2],
        a[3] + s * b[3],
        a[4] + s * b[4],
        a[5] + s * b[5],
    )


@njit
def oblate_motion(orbit, reference):
    """The :class:`OblateMotion` of LVLH for a reference."""
    radius, climb, momentum, _, inclination, latitude = reference
    rates = oblate_rates(orbit, reference)
    ci, si = cos_sin(inclination)
    cl, sl = cos_sin(latitude)
    r2 = radius * radius
    # rate_x = - k sin(2 i) sin(l) / (h r^3)
    scale = -orbit.strength / (momentum * r2 * radius)
    rate_x = scale * 2.0 * si * ci * sl
    change = 2.0 * rates[4] * (ci * ci - si * si) * sl + 2.0 * si * ci * cl * rates[5]
    rate_z = momentum / r2
    return OblateMotion(
        reference,
        rate_x,
        rate_z,
        scale * change - rate_x * (rates[2] / momentum + 3.0 * climb / radius),
        rates[2] / r2 - 2.0 * rate_z * climb / radius,
        radius,
        (si * sl, si * cl, ci),
    )


@njit
def oblate_attitude(reference):
    """Attitude of LVLH from the planet's axes, as a quaternion, for a reference of an oblate planet."""
    cn, sn = cos_sin(0.5 * reference[3])
    ci, si = cos_sin(0.5 * reference[4])
    cl, sl = cos_sin(0.5 * reference[5])
    # a turn of an axis by an angle is (cos, - sin) of its half: about z by the latitude, x, z by the node
    tilted = (cl * ci, -cl * si, sl * si, -sl * ci)
    return quaternion_product(tilted, (cn, 0.0, 0.0, -sn))


@njit(forceinline=True)
def turn_frame(q, c, s):
    """Attitude against a frame that has turned about its own z by an angle; cosine and sine of half of it."""
    return (c * q[0] - s * q[3], c * q[1] + s * q[2], c * q[2] - s * q[1], c * q[3] + s * q[0])


# Free acceleration ---------------------------------------------------------------------------------------


@njit(forceinline=True)
def hill_acceleration(r, v, n):
    """Free relative acceleration (m/s^2) by the Hill-Clohessy-Wiltshire equations."""
    return (2.0 * n * v[1] + 3.0 * n * n * r[0], -2.0 * n * v[0], -n * n * r[2])


@njit(forceinline=True)
def nearness(r, radius):
    """``1 - (radius / distance)**3`` of a craft, without cancellation.

    With ``1 + e`` the squared distance to the planet over ``radius**2``, the factor ``1 - (1 + e)**(-3/2)``
    is formed from ``e`` itself.
    """
    e = (2.0 * r[0] + (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / radius) / radius
    s = (1.0 + e) ** 0.5
    cube = s * s * s
    return e / (1.0 + s) * (s * s + s + 1.0) / cube


@njit(forceinline=True)
def two_body_acceleration(r, v, n, radius):
    """Free relative acceleration (m/s^2) of two-body motion about a circular orbit of that radius (m)."""
    g = nearness(r, radius)
    nn = n * n
    return (
        2.0 * n * v[1] + nn * (radius + r[0]) * g,
        -2.0 * n * v[0] + nn * r[1] * g,
        nn * r[2] * (g - 1.0),
    )


@njit(forceinline=True)
def linear_acceleration(r, v, motion):
    """Free relative acceleration (m/s^2) by the linear equations about an elliptic orbit."""
    w, dw, k = motion.rate, motion.acceleration, motion.gravity
    return (
        (w * w + 2.0 * k) * r[0] + dw * r[1] + 2.0 * w * v[1],
        -dw * r[0] + (w * w - k) * r[1] - 2.0 * w * v[0],
        -k * r[2],
    )


@njit(forceinline=True)
def elliptic_acceleration(r, v, motion):
    """Free relative acceleration (m/s^2) of two-body motion about an elliptic orbit."""
    w, dw, k = motion.rate, motion.acceleration, motion.gravity
    g = nearness(r, motion.radius)
    return (
        (w * w - k) * r[0] + k * (motion.radius + r[0]) * g + dw * r[1] + 2.0 * w * v[1],
        -dw * r[0] + (w * w - k) * r[1] + k * r[1] * g - 2.0 * w * v[0],
        k * r[2] * (g - 1.0),
    )


@njit
def oblate_acceleration(r, v, motion, mu, strength):
    """Free relative acceleration (m/s^2) about an oblate planet."""
    wx, wz, ax, az = motion.rate_x, motion.rate_z, motion.acceleration_x, motion.acceleration_z
    radius, (px, py, pz) = motion.radius, motion.north
    g = nearness(r, radius)
    k = mu / (radius * radius * radius)
    # J2 pulls a place R by  - strength / R^5 ((1 - 5 u^2) R + 2 R u p),  u the sine of its latitude.
    inverse = 1.0 / radius
    i5 = inverse * inverse * inverse * inverse * inverse
    out = radius + r[0]
    d2 = out * out + r[1] * r[1] + r[2] * r[2]
    c5 = 1.0 / (d2 * d2 * d2**0.5)
    height = radius * px  # over the equator
    above = height + (px * r[0] + py * r[1] + pz * r[2])
    u2 = above * above / d2
    own, its = strength * c5 * (1.0 - 5.0 * u2), strength * i5 * (1.0 - 5.0 * px * px)
    up = 2.0 * strength * (c5 * above - i5 * height)
    return (
        2.0 * wz * v[1] + (wz * wz - k) * r[0] + az * r[1] - wx * wz * r[2]
        + k * out * g - ((own - its) * radius + own * r[0]) - up * px,
        -2.0 * wz * v[0] + 2.0 * wx * v[2] - az * r[0] + (wz * wz + wx * wx - k) * r[1] + ax * r[2]
        + k * r[1] * g - own * r[1] - up * py,
        -2.0 * wx * v[1] - wx * wz * r[0] - ax * r[1] + (wx * wx - k) * r[2]
        + k * r[2] * g - own * r[2] - up * pz,
    )  # fmt: skip


# Whatever the kind of orbit --------------------------------------------------------------------------------
# Each function here stands for one of each kind (`chosen_by_kind`, below).


def step_frames(orbit, reference, h):
    """Motion of LVLH at the start, middle and end of a sub-step of ``h`` seconds from a reference.

    Three times None on a circular orbit, else each has the reference that belongs to it.
    """
    return _STEP_FRAMES[type(orbit)](orbit, reference, h)


def follow_frame(orbit, before, after, h, q):
    """Attitude against LVLH after ``h`` seconds at rest in inertial space, between two motions of LVLH.

    Exactly the same attitude if there are none.
    """
    return _FOLLOW_FRAME[type(orbit)](orbit, before, after, h, q)


def free_acceleration(orbit, motion, r, v):
    """Free relative acceleration, m/s^2."""
    return _FREE_ACCELERATION[type(orbit)](orbit, motion, r, v)


def frame_rate(orbit, reference):
    """Rate at which LVLH turns, rad/s, in its own axes; it never turns about its y."""
    return _FRAME_RATE[type(orbit)](orbit, reference)


def read_reference(orbit, rows, first, w):
    """The reference of craft ``w`` out of an array (rows, craft), from row ``first`` on; None without one."""
    return _READ_REFERENCE[type(orbit)](orbit, rows, first, w)


def write_reference(orbit, rows, first, w, reference):
    """Write the reference of craft ``w`` there."""
    return _WRITE_REFERENCE[type(orbit)](orbit, rows, first, w, reference)


def reference_of(orbit, motion):
    """The reference that belongs to a motion of LVLH; None on a circular orbit."""
    return _REFERENCE_OF[type(orbit)](orbit, motion)


def reference_after(orbit, reference, duration, steps):
    """The reference ``duration`` seconds later, which may be negative, in so many integration steps."""
    return _REFERENCE_AFTER[type(orbit)](orbit, reference, duration, steps)


def free_velocity(orbit, reference, drift, duration, steps, r, v):
    """Velocity, m/s, after free motion for ``duration`` seconds until LVLH stands at a reference.

    Args:
        orbit: By the linear equations, with J2 without linearisation.
        reference: At the end.
        drift: Lower half of the transition matrix, row by row, for circular orbits.
        duration: s.
        steps: Integration steps, where there are some.
        r: Position at the start, m.
        v: Velocity then, m/s.
    """
    return _FREE_VELOCITY[type(orbit)](orbit, reference, drift, duration, steps, r, v)


def osculating(orbit, reference):
    """The :class:`Ellipse` on which LVLH moves; None for a circular orbit.

    Its angle is the true anomaly, but with J2 the argument of latitude.
    """
    return _OSCULATING[type(orbit)](orbit, reference)


@njit(forceinline=True)
def open_ellipse(numbers):
    """The :class:`Ellipse` of an array (7,)."""
    return Ellipse(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6])


def _steady_frames(orbit, reference, h):
    return (None, None, None)


def _elliptic_frames(orbit, reference, h):
    return (
        frame_motion(orbit, reference),
        frame_motion(orbit, reference + 0.5 * h),
        frame_motion(orbit, reference + h),
    )


def _oblate_frames(orbit, reference, h):
    middle = oblate_step(orbit, reference, 0.5 * h)
    end = oblate_step(orbit, middle, 0.5 * h)
    return (oblate_motion(orbit, reference), oblate_motion(orbit, middle), oblate_motion(orbit, end))


def _follow_steady(orbit, before, after, h, q):
    return follow_orbit(q, orbit.mean_motion, h)


def _follow_elliptic(orbit, before, after, h, q):
    c = before.cosine * after.cosine + before.sine * after.sine
    s = before.cosine * after.sine - before.sine * after.cosine
    # past apogee the half of the anomaly has gone from pi / 2 to - pi / 2
    s = s if c >= 0.0 else -s
    c = abs(c) if h != 0.0 else 1.0
    return turn_frame(q, c, s)


def _follow_oblate(orbit, before, after, h, q):
    start, end = oblate_attitude(before.reference), oblate_attitude(after.reference)
    turned = quaternion_product(start, conjugate(end))
    return quaternion_product(q, turned if h != 0.0 else (1.0, 0.0, 0.0, 0.0))


def _accelerate_by_hill(orbit, motion, r, v):
    return hill_acceleration(r, v, orbit.mean_motion)


def _accelerate_two_bodies(orbit, motion, r, v):
    return two_body_acceleration(r, v, orbit.mean_motion, orbit.radius)


def _accelerate_linearly(orbit, motion, r, v):
    return linear_acceleration(r, v, motion)


def _accelerate_elliptically(orbit, motion, r, v):
    return elliptic_acceleration(r, v, motion)


def _accelerate_oblately(orbit, motion, r, v):
    return oblate_acceleration(r, v, motion, orbit.mu, orbit.strength)


def _steady_rate(orbit, reference):
    return (0.0, 0.0, orbit.mean_motion)


def _elliptic_rate(orbit, reference):
    return (0.0, 0.0, frame_motion(orbit, reference).rate)


def _oblate_rate(orbit, reference):
    motion = oblate_motion(orbit, reference)
    return (motion.rate_x, 0.0, motion.rate_z)


def _read_nothing(orbit, rows, first, w):
    return None


def _read_time(orbit, rows, first, w):
    return rows[first, w]


def _read_six(orbit, rows, first, w):
    return (
        rows[first, w], rows[first + 1, w], rows[first + 2, w], rows[first + 3, w], rows[first + 4, w],
        rows[first + 5, w],
    )  # fmt: skip


def _write_nothing(orbit, rows, first, w, reference):
    return None


def _write_time(orbit, rows, first, w, reference):
    rows[first, w] = reference


def _write_six(orbit, rows, first, w, reference):
    rows[first, w], rows[first + 1, w], rows[first + 2, w] = reference[0], reference[1], reference[2]
    rows[first + 3, w], rows[first + 4, w], rows[first + 5, w] = reference[3], reference[4], reference[5]


def _no_reference_of(orbit, motion):
    return None


def _reference_of_motion(orbit, motion):
    return motion.reference


def _nothing_after(orbit, reference, duration, steps):
    return None


def _time_after(orbit, reference, duration, steps):
    return reference + duration


def _six_after(orbit, reference, duration, steps):
    h = 0.5 * duration / steps
    for _ in range(2 * steps):
        reference = oblate_step(orbit, reference, h)
    return reference


def _velocity_by_matrix(orbit, reference, drift, duration, steps, r, v):
    k, x, y, z, a, b, c = drift, r[0], r[1], r[2], v[0], v[1], v[2]
    return (
        k[0] * x + k[1] * y + k[2] * z
        + k[3] * a + k[4] * b + k[5] * c,
        k[6] * x + k[7] * y + k[8] * z
        + k[9] * a + k[10] * b + k[11] * c,
        k[12] * x + k[13] * y + k[14] * z
        + k[15] * a + k[16] * b + k[17] * c,
    )  # fmt: skip


def _velocity_about_ellipse(orbit, reference, drift, duration, steps, r, v):
    before, after = frame_motion(orbit, reference - duration), frame_motion(orbit, reference)
    _, moved = free_motion(orbit.eccentricity, before, after, duration, r, v)
    return moved


def _velocity_in_steps(orbit, reference, drift, duration, steps, r, v):
    h, nothing = duration / steps, (0.0, 0.0, 0.0)
    place = reference_after(orbit, reference, -duration, steps)
    for _ in range(steps):
        frames = step_frames(orbit, place, h)
        r, v = translation_step(r, v, nothing, nothing, nothing, orbit, frames, h)
        place = frames[2].reference
    return v


def _no_ellipse(orbit, reference):
    return None


def _own_ellipse(orbit, reference):
    motion = frame_motion(orbit, reference)
    anomaly = 2.0 * math.atan2(motion.sine, motion.cosine)
    n, a, e = orbit.mean_motion, orbit.semi_major_axis, orbit.eccentricity
    return Ellipse(n, a, e, orbit.breadth, reference, anomaly, anomaly)


def _osculating_ellipse(orbit, reference):
    radius, climb, momentum, _, _, latitude = reference
    p = momentum * momentum / orbit.mu
    ec, es = p / radius - 1.0, momentum * climb / orbit.mu
    e = math.hypot(ec, es)
    a = p / (1.0 - e * e)
    n, anomaly = math.sqrt(orbit.mu / a) / a, math.atan2(es, ec)
    breadth = math.sqrt(1.0 - e * e)
    return Ellipse(n, a, e, breadth, _since_perigee(n, e, anomaly), anomaly, latitude)


_STEP_FRAMES = {
    Hill: _steady_frames, Circular: _steady_frames, LinearElliptic: _elliptic_frames,
    Elliptic: _elliptic_frames, Oblate: _oblate_frames,
}  # fmt: skip
_FOLLOW_FRAME = {
    Hill: _follow_steady, Circular: _follow_steady, LinearElliptic: _follow_elliptic,
    Elliptic: _follow_elliptic, Oblate: _follow_oblate,
}  # fmt: skip
_FREE_ACCELERATION = {
    Hill: _accelerate_by_hill, Circular: _accelerate_two_bodies, LinearElliptic: _accelerate_linearly,
    Elliptic: _accelerate_elliptically, Oblate: _accelerate_oblately,
}  # fmt: skip
_FRAME_RATE = {
    Hill: _steady_rate, Circular: _steady_rate, LinearElliptic: _elliptic_rate, Elliptic: _elliptic_rate,
    Oblate: _oblate_rate,
}  # fmt: skip


_READ_REFERENCE = {
    Hill: _read_nothing, Circular: _read_nothing, LinearElliptic: _read_time, Elliptic: _read_time,
    Oblate: _read_six,
}  # fmt: skip
_WRITE_REFERENCE = {
    Hill: _write_nothing, Circular: _write_nothing, LinearElliptic: _write_time, Elliptic: _write_time,
    Oblate: _write_six,
}  # fmt: skip
_REFERENCE_OF = {
    Hill: _no_reference_of, Circular: _no_reference_of, LinearElliptic: _reference_of_motion,
    Elliptic: _reference_of_motion, Oblate: _reference_of_motion,
}  # fmt: skip
_REFERENCE_AFTER = {
    Hill: _nothing_after, Circular: _nothing_after, LinearElliptic: _time_after, Elliptic: _time_after,
    Oblate: _six_after,
}  # fmt: skip
_FREE_VELOCITY = {
    Hill: _velocity_by_matrix, Circular: _velocity_by_matrix, LinearElliptic: _velocity_about_ellipse,
    Elliptic: _velocity_about_ellipse, Oblate: _velocity_in_steps,
}  # fmt: skip
_OSCULATING = {
    Hill: _no_ellipse, Circular: _no_ellipse, LinearElliptic: _own_ellipse, Elliptic: _own_ellipse,
    Oblate: _osculating_ellipse,
}  # fmt: skip


def chosen_by_kind(function, kinds):
    """Let Numba compile, for a function of an orbit, the one that belongs to the type of the orbit."""

    def choose(orbit, *arguments):  # Numba calls it with the types of all
        return kinds[orbit.instance_class]

    overload(function, jit_options={"forceinline": True}, strict=False)(choose)


for _function, _by_kind in (
    (read_reference, _READ_REFERENCE), (write_reference, _WRITE_REFERENCE), (reference_of, _REFERENCE_OF),
    (reference_after, _REFERENCE_AFTER), (free_velocity, _FREE_VELOCITY), (osculating, _OSCULATING),
):  # fmt: skip
    chosen_by_kind(_function, _by_kind)
chosen_by_kind(step_frames, _STEP_FRAMES)
chosen_by_kind(follow_frame, _FOLLOW_FRAME)
chosen_by_kind(free_acceleration, _FREE_ACCELERATION)
chosen_by_kind(frame_rate, _FRAME_RATE)


@njit(forceinline=True)
def translation_step(r, v, f0, fm, f1, orbit, frames, h):
    """Position and velocity after one RK4 step.

    The specific force of the thrust is given at the start, the middle and the end of the step, in LVLH;
    ``frames`` are those of :func:`step_frames`.
    """
    start, middle, end = frames
    a1 = _sum(free_acceleration(orbit, start, r, v), f0)
    v2 = _along(v, 0.5 * h, a1)
    a2 = _sum(free_acceleration(orbit, middle, _along(r, 0.5 * h, v), v2), fm)
    v3 = _along(v, 0.5 * h, a2)
    a3 = _sum(free_acceleration(orbit, middle, _along(r, 0.5 * h, v2), v3), fm)
    v4 = _along(v, h, a3)
    a4 = _sum(free_acceleration(orbit, end, _along(r, h, v3), v4), f1)
    return (
        _along(r, 1 / 6 * h, _weighted(v, v2, v3, v4)),
        _along(v, 1 / 6 * h, _weighted(a1, a2, a3, a4)),
    )


@njit(forceinline=True)
def _along(a, s, b):
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@njit(forceinline=True)
def _sum(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@njit(forceinline=True)
def _weighted(a, b, c, d):
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0],
        a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2],
    )


# The transition matrix -------------------------------------------------------------------------------------


def transition_matrix(orbit: Orbit | float, duration: float, time: float = 0.0) -> NDArray[np.float64]:
    """How a free state (position, velocity) moves on by the linear equations, (6, 6), m and m/s, LVLH.

    ``state(time + duration) = transition_matrix @ state(time)``. J2 is left out.

    Args:
        orbit: The orbit, or the mean motion of a circular one, rad/s.
        duration: s; may be negative.
        time: At which it begins, s of the episode's clock; it matters on an elliptic orbit.

    >>> transition_matrix(0.001, 0.0).tolist() == np.eye(6).tolist()
    True
    """
    if not isinstance(orbit, Orbit):
        return np.array(_hill_transition(orbit, duration))
    if orbit.is_circular:
        return np.array(_hill_transition(orbit.mean_motion, duration))
    kind, start = _ellipse(orbit), orbit.start + time
    before, after = (frame_motion.py_func(kind, one) for one in (start, start + duration))
    state = np.eye(6)
    r, v = free_motion.py_func(kind.eccentricity, before, after, duration, state[:3], state[3:])
    return np.array([*r, *v])


def _hill_transition(n, t):
    """State transition matrix of the Hill-Clohessy-Wiltshire equations over ``t`` seconds, six rows.

    Without cancellation, however short the time.
    """
    angle = n * t
    s, c, half = math.sin(angle), math.cos(angle), math.sin(0.5 * angle)
    v = 2.0 * half * half  # 1 - cos
    d = angle_minus_sine(angle)
    return (
        (1.0 + 3.0 * v, 0.0, 0.0, s / n, 2.0 * v / n, 0.0),
        (-6.0 * d, 1.0, 0.0, -2.0 * v / n, (s - 3.0 * d) / n, 0.0),
        (0.0, 0.0, c, 0.0, 0.0, s / n),
        (3.0 * n * s, 0.0, 0.0, c, 2.0 * s, 0.0),
        (-6.0 * n * v, 0.0, 0.0, -2.0 * s, 1.0 - 4.0 * v, 0.0),
        (0.0, 0.0, -n * s, 0.0, 0.0, c),
    )


def angle_minus_sine(angle: float) -> float:
    """``angle - sin(angle)`` without loss of digits at small angles, rad."""
    if abs(angle) > 0.5:
        return angle - math.sin(angle)
    square = angle * angle
    series = 1.0
    for k in (19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0):
        series = 1.0 - square / (k * (k - 1.0)) * series
    return angle * square / 6.0 * series


@njit
def free_motion(e, before, after, duration, r, v):
    """Position (m) and velocity (m/s) after free motion by the linear equations about an elliptic orbit.

    The transition matrix of Yamanaka and Ankersen 2002, eqs. 82-86, applied to a state, between two motions
    of LVLH on an orbit of eccentricity ``e``, ``duration`` seconds apart. Their axes are ours in another
    order: along-track, minus cross-track, minus radial.
    """
    c0, s0, p0, k = _anomaly(e, before)
    c1, s1, p1, _ = _anomaly(e, after)
    # Scaled positions, and their rates of change with the true anomaly.
    x, y, z = p0 * r[1], p0 * r[2], -p0 * r[0]
    scale, bend = 1.0 / (k * p0), e * s0
    dx, dy, dz = scale * v[1] - bend * r[1], scale * v[2] - bend * r[2], bend * r[0] - scale * v[0]
    # In the plane: the pseudo-initial values, with s = p0 s0 and c = p0 c0 written out.
    q0 = 1.0 + p0
    a = x + (3.0 * e * s0 * (1.0 + 1.0 / p0) * z - e * s0 * q0 * dx + (2.0 - e * p0 * c0) * dz) / (
        1.0 - e * e
    )
    b = (-3.0 * s0 * (1.0 + e * e / p0) * z + s0 * q0 * dx + (p0 * c0 - 2.0 * e) * dz) / (1.0 - e * e)
    d = (-3.0 * (c0 + e) * z + (c0 * q0 + e) * dx - p0 * s0 * dz) / (1.0 - e * e)
    f = ((3.0 * p0 + e * e - 1.0) * z - p0 * p0 * dx + e * p0 * s0 * dz) / (1.0 - e * e)
    s, c, j, q1 = p1 * s1, p1 * c1, k * duration, 1.0 + p1
    along, down = (
        a - c1 * q1 * b + s1 * q1 * d + 3.0 * p1 * p1 * j * f,
        s * b + c * d + (2.0 - 3.0 * e * s * j) * f,
    )
    along_rate = 2.0 * s * b + (2.0 * c - e) * d + 3.0 * (1.0 - 2.0 * e * s * j) * f
    ds, dc = c1 + e * (c1 * c1 - s1 * s1), -(s1 + 2.0 * e * s1 * c1)
    down_rate = ds * b + dc * d - 3.0 * e * (ds * j + s1 / p1) * f
    # Across it: a turn by the difference of the anomalies.
    cosine, sine = c1 * c0 + s1 * s0, s1 * c0 - c1 * s0
    across, across_rate = cosine * y + sine * dy, cosine * dy - sine * y
    inverse, back, bend = 1.0 / p1, k * p1, k * e * s1
    return (
        (-inverse * down, inverse * along, inverse * across),
        (
            -bend * down - back * down_rate,
            bend * along + back * along_rate,
            bend * across + back * across_rate,
        ),
    )


@njit(forceinline=True)
def _anomaly(e, motion):
    """Cosine and sine of the true anomaly, ``1 + e cos``, and ``h / p**2``, 1/s."""
    c = 1.0 - 2.0 * motion.sine * motion.sine
    p = 1.0 + e * c
    return c, 2.0 * motion.sine * motion.cosine, p, motion.rate / (p * p)


# Where an orbit begins -------------------------------------------------------------------------------------


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
    motion = frame_motion.py_func(_ellipse(orbit), orbit.start + time)
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
    mean = n * _since_perigee(n, e, anomaly) - n * elements.epoch
    mean -= 2.0 * math.pi * math.floor(mean / (2.0 * math.pi) + 0.5)
    half = 0.5 * eccentric_anomaly(mean, e)
    return 2.0 * math.atan2(math.sqrt(1.0 + e) * math.sin(half), math.sqrt(1.0 - e) * math.cos(half))


@njit(forceinline=True)
def _since_perigee(n, e, anomaly):
    """Time since perigee, s, at a true anomaly, rad."""
    half = 0.5 * anomaly
    eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
    return (eccentric - e * math.sin(eccentric)) / n


def reference_at(orbit, elements, anomaly):
    """The reference of a craft when LVLH stands at a true anomaly, rad."""
    return _REFERENCE_AT[type(orbit)](orbit, elements, anomaly)


def _no_reference(orbit, elements, anomaly):
    return None


def _elliptic_reference(orbit, elements, anomaly):
    return _since_perigee(orbit.mean_motion, elements.eccentricity, anomaly)


def _oblate_reference(orbit, elements, anomaly):
    e = elements.eccentricity
    p = elements.semi_major_axis * (1.0 - e * e)
    momentum = (elements.gravitational_parameter * p) ** 0.5
    return (
        p / (1.0 + e * math.cos(anomaly)),
        elements.gravitational_parameter / momentum * e * math.sin(anomaly),
        momentum,
        elements.raan,
        elements.inclination,
        elements.argument_of_perigee + anomaly,
    )


_REFERENCE_AT = {
    Hill: _no_reference, Circular: _no_reference,
    LinearElliptic: _elliptic_reference, Elliptic: _elliptic_reference, Oblate: _oblate_reference,
}  # fmt: skip
chosen_by_kind(reference_at, _REFERENCE_AT)
