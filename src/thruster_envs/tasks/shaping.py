"""What is still to be paid: the delta-v of a rendezvous from any state with any time to go, in closed form.

The two-impulse solution of the Hill-Clohessy-Wiltshire equations (Clohessy and Wiltshire 1960) in the orbital
plane; across it the two-impulse solution in the last quarter of an orbit and, before that, the cheapest way,
which is to wait for the node. About an ellipse it is the same by the equations of Tschauner and Hempel. As
the potential of a reward it makes the reward dense and leaves the best policy as it was (Ng, Harada, Russell
1999).
"""

import math

from thruster_envs.kernels import kernel
from thruster_envs.physics.orbits import frame_motion, free_motion

#: Time to go is not taken to be shorter than this, s: the impulses of a two-impulse rendezvous grow without
#: bound as it goes to zero.
SHORTEST = 60.0


@kernel
def delta_v_to_go(r, v, time_to_go, n):
    """Sum of the absolute components (m/s) of both impulses that bring a craft to rest at the origin.

    ``r`` (m) and ``v`` (m/s) are its position and velocity in LVLH, ``time_to_go`` in s, ``n`` in rad/s.
    """
    t = max(time_to_go, SHORTEST)
    s, c = math.sin(n * t), math.cos(n * t)
    # In the plane: x_f = Prr x + Prv u = 0 for the velocity u after the first impulse.
    a, b, d = s / n, 2.0 * (1.0 - c) / n, 4.0 * s / n - 3.0 * t
    determinant = a * d + b * b
    x_free, y_free = (4.0 - 3.0 * c) * r[0], 6.0 * (s - n * t) * r[0] + r[1]
    ux, uy = (-d * x_free + b * y_free) / determinant, (-b * x_free - a * y_free) / determinant
    arrival_x = 3.0 * n * s * r[0] + c * ux + 2.0 * s * uy
    arrival_y = -6.0 * n * (1.0 - c) * r[0] - 2.0 * s * ux + (4.0 * c - 3.0) * uy
    in_plane = abs(ux - v[0]) + abs(uy - v[1]) + abs(arrival_x) + abs(arrival_y)
    if n * t >= 0.5 * math.pi:
        return in_plane + abs(v[2]) + n * abs(r[2])
    return in_plane + abs(-n * r[2] * c / s - v[2]) + n * abs(r[2]) / s


@kernel
def elliptic_delta_v_to_go(r, v, time_to_go, ellipse):
    """The same about an orbit of any eccentricity, an :class:`~thruster_envs.physics.orbits.Ellipse`.

    Across the plane it waits for the node while LVLH turns by a right angle or more until the end.
    """
    t, e = max(time_to_go, SHORTEST), ellipse.eccentricity
    before, after = frame_motion(ellipse, ellipse.time), frame_motion(ellipse, ellipse.time + t)
    zero = (0.0, 0.0, 0.0)
    drift, drift_rate = free_motion(e, before, after, t, (r[0], r[1], 0.0), zero)
    by_x, x_rate = free_motion(e, before, after, t, zero, (1.0, 0.0, 0.0))
    by_y, y_rate = free_motion(e, before, after, t, zero, (0.0, 1.0, 0.0))
    determinant = by_x[0] * by_y[1] - by_y[0] * by_x[1]
    ux = (-drift[0] * by_y[1] + drift[1] * by_y[0]) / determinant
    uy = (-drift[1] * by_x[0] + drift[0] * by_x[1]) / determinant
    in_plane = abs(ux - v[0]) + abs(uy - v[1])
    for k in range(2):
        in_plane += abs(drift_rate[k] + ux * x_rate[k] + uy * y_rate[k])
    c0, s0 = 1.0 - 2.0 * before.sine * before.sine, 2.0 * before.sine * before.cosine
    p0, k0 = 1.0 + e * c0, e * s0
    scale = before.rate / (p0 * p0)
    # Sine of half of what LVLH turns by, negative beyond half a turn.
    sine = after.sine * before.cosine - after.cosine * before.sine
    sine = sine if after.cosine * before.cosine + after.sine * before.sine >= 0.0 else -sine
    if ellipse.mean_motion * t >= 2.0 * math.pi or not 0.0 <= sine < math.sqrt(0.5):
        return in_plane + abs(scale * p0 * k0 * r[2] - v[2]) + scale * p0 * (1.0 - k0) * abs(r[2])
    one, one_rate = free_motion(e, before, after, t, (0.0, 0.0, r[2]), zero)
    two, two_rate = free_motion(e, before, after, t, zero, (0.0, 0.0, 1.0))
    uz = -one[2] / two[2]
    return in_plane + abs(uz - v[2]) + abs(one_rate[2] + uz * two_rate[2])
