"""Rigid-body attitude: Euler's equations for the rates, a fourth-order Magnus step for the quaternion.

Models a rigid body with a full inertia matrix under a body-fixed torque that is a quadratic in time over one
sub-step, and the gravity-gradient torque for who asks for it. Leaves out any other environmental torque,
flexible modes and slosh.

Conventions: quaternions are scalar-first and unit, *body-from-reference*, with the Hamilton product:
``v_body = q (x) v_reference (x) q*``, so ``q' = -1/2 (0, rate) (x) q`` for the angular rate of the body in
body axes. Everything here is scalar arithmetic on tuples of components, without branches: it compiles into
vectorised kernels, and the undecorated source (``function.py_func``) runs on arrays.

Sources: Hairer, Lubich, Wanner, "Geometric Numerical Integration", IV.7 (Magnus series); Iserles et al. 2000,
"Lie-group methods".
"""

from thruster_envs.helpers import njit


@njit(forceinline=True)
def quaternion_product(a, b):
    """Hamilton product ``a (x) b`` of two scalar-first quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(forceinline=True)
def conjugate(q):
    """Inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


@njit(forceinline=True)
def cross(a, b):
    """Vector product of two 3-vectors."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(forceinline=True)
def rotate(q, v):
    """Components in the body of a reference vector: ``q (x) v (x) q*``."""
    t = cross((q[1], q[2], q[3]), v)
    u = cross((q[1], q[2], q[3]), (t[0] + q[0] * v[0], t[1] + q[0] * v[1], t[2] + q[0] * v[2]))
    return (v[0] + 2.0 * u[0], v[1] + 2.0 * u[1], v[2] + 2.0 * u[2])


@njit(forceinline=True)
def rotate_back(q, v):
    """Components in the reference frame of a body vector: ``q* (x) v (x) q``."""
    return rotate(conjugate(q), v)


@njit(forceinline=True)
def exponential(x, y, z):
    """Exponential of the pure quaternion ``(0, x, y, z)``: a rotation by twice that vector's length.

    A quarter of the vector goes through the Taylor series and the result is squared twice: relative error
    below 1e-15 up to a length of 2 (four radians of rotation in one call), below 1e-9 up to 6.
    """
    x, y, z = 0.25 * x, 0.25 * y, 0.25 * z
    s = x * x + y * y + z * z
    c = 1.0 - 1 / 2 * s * (
        1.0
        - 1
        / 12
        * s
        * (
            1.0
            - 1 / 30 * s * (1.0 - 1 / 56 * s * (1.0 - 1 / 90 * s * (1.0 - 1 / 132 * s * (1.0 - 1 / 182 * s))))
        )
    )
    k = 1.0 - 1 / 6 * s * (
        1.0
        - 1
        / 20
        * s
        * (
            1.0
            - 1
            / 42
            * s
            * (1.0 - 1 / 72 * s * (1.0 - 1 / 110 * s * (1.0 - 1 / 156 * s * (1.0 - 1 / 210 * s))))
        )
    )
    for _ in range(2):
        c, k = 1.0 - 2.0 * s * k * k, 2.0 * c * k
    return (c, k * x, k * y, k * z)


@njit(forceinline=True)
def angular_acceleration(rate, torque, inertia, inverse):
    """Euler's equation ``J w' = torque - w x (J w)``, rad/s^2.

    Inertia and its inverse are given as (xx, yy, zz) or (xx, yy, zz, xy, xz, yz).
    """
    gyroscopic = cross(rate, symmetric_product(inertia, rate))
    return symmetric_product(
        inverse, (torque[0] - gyroscopic[0], torque[1] - gyroscopic[1], torque[2] - gyroscopic[2])
    )


@njit(forceinline=True)
def gravity_gradient(vertical, strength, inertia):
    """Torque ``strength v x (J v)`` of the gravity gradient, N m (Hughes 1986, section 8.2).

    ``vertical`` is the unit vector to or from the Earth's centre in body axes, ``strength`` three times the
    square of the mean motion. Inertia as in :func:`angular_acceleration`.
    """
    torque = cross(vertical, symmetric_product(inertia, vertical))
    return (strength * torque[0], strength * torque[1], strength * torque[2])


@njit(forceinline=True)
def symmetric_product(m, v):
    """Product of a diagonal (three numbers) or symmetric matrix (six) with a vector.

    Which of the two is decided when the kernel is compiled.
    """
    if len(m) == 3:
        return (m[0] * v[0], m[1] * v[1], m[2] * v[2])
    return (
        m[0] * v[0] + m[3] * v[1] + m[4] * v[2],
        m[3] * v[0] + m[1] * v[1] + m[5] * v[2],
        m[4] * v[0] + m[5] * v[1] + m[2] * v[2],
    )


@njit(forceinline=True)
def _along(a, s, b):
    """``a + s b`` for 3-vectors."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@njit(forceinline=True)
def rate_step(rate, torque_0, torque_m, torque_1, inertia, inverse, h):
    """One RK4 step of Euler's equations; torque at the start, middle and end of the step in N m.

    Returns the rates at a quarter, the middle and the end of the step (the inner two by cubic Hermite
    interpolation, fourth order).
    """
    k1 = angular_acceleration(rate, torque_0, inertia, inverse)
    k2 = angular_acceleration(_along(rate, 0.5 * h, k1), torque_m, inertia, inverse)
    k3 = angular_acceleration(_along(rate, 0.5 * h, k2), torque_m, inertia, inverse)
    k4 = angular_acceleration(_along(rate, h, k3), torque_1, inertia, inverse)
    total = (
        k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0],
        k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1],
        k1[2] + 2.0 * (k2[2] + k3[2]) + k4[2],
    )
    end = _along(rate, 1 / 6 * h, total)
    slope = angular_acceleration(end, torque_1, inertia, inverse)
    quarter = hermite(rate, k1, end, slope, h, 0.84375, 0.140625, 0.15625, -0.046875)
    middle = hermite(rate, k1, end, slope, h, 0.5, 0.125, 0.5, -0.125)
    return quarter, middle, end


@njit(forceinline=True)
def hermite(a, da, b, db, h, wa, wda, wb, wdb):
    """Weighted sum of two end values and two end slopes of a 3-vector."""
    return (
        wa * a[0] + wb * b[0] + h * (wda * da[0] + wdb * db[0]),
        wa * a[1] + wb * b[1] + h * (wda * da[1] + wdb * db[1]),
        wa * a[2] + wb * b[2] + h * (wda * da[2] + wdb * db[2]),
    )


@njit(forceinline=True)
def turn(q, rate_0, rate_m, rate_1, h):
    """Attitude after ``h`` seconds of the given body rates, by the fourth-order Magnus series.

    The rates are those at the start, the middle and the end of the step, rad/s.
    """
    twist = cross(rate_0, rate_1)
    a, b = -1 / 12 * h, -1 / 24 * h * h
    step = exponential(
        a * (rate_0[0] + 4.0 * rate_m[0] + rate_1[0]) + b * twist[0],
        a * (rate_0[1] + 4.0 * rate_m[1] + rate_1[1]) + b * twist[1],
        a * (rate_0[2] + 4.0 * rate_m[2] + rate_1[2]) + b * twist[2],
    )
    return quaternion_product(step, q)


@njit(forceinline=True)
def follow_orbit(q, mean_motion, h):
    """Attitude against the turning LVLH frame after ``h`` seconds at rest in inertial space.

    The frame turns about its own z. Series in half the angle: exact to rounding up to 0.02 rad, which is 36 s
    in a low orbit.
    """
    a = 0.5 * mean_motion * h
    z = a * a
    c, s = 1.0 - 0.5 * z * (1.0 - 1 / 12 * z), a * (1.0 - 1 / 6 * z * (1.0 - 1 / 20 * z))
    return (c * q[0] - s * q[3], c * q[1] + s * q[2], c * q[2] - s * q[1], c * q[3] + s * q[0])


@njit(forceinline=True)
def normalised(q):
    """The quaternion scaled to unit length (exactly to rounding; it must not be zero)."""
    s = 1.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) ** 0.5
    return (s * q[0], s * q[1], s * q[2], s * q[3])
