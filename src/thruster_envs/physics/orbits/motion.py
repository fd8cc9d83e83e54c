"""Kepler's equation, how LVLH moves, and free relative acceleration, for each kind of orbit."""

import numpy as np

from thruster_envs.helpers import njit
from thruster_envs.physics.attitude import quaternion_product
from thruster_envs.physics.orbits.kinds import Motion, OblateMotion

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
