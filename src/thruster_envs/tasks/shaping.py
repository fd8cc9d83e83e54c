"""What is still to be paid: the delta-v of a rendezvous from any state with any time to go, in closed form.

The two-impulse solution of the Hill-Clohessy-Wiltshire equations (Clohessy and Wiltshire 1960) in the orbital
plane; across it the two-impulse solution in the last quarter of an orbit and, before that, the cheapest way,
which is to wait for the node. As the potential of a reward it makes the reward dense and leaves the best
policy as it was (Ng, Harada, Russell 1999).
"""

import math

from thruster_envs.kernels import kernel

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
