"""Single-gimbal control-moment gyros: a rotor of constant momentum that a gimbal turns across the body.

Models the momentum ``H (cos d s + sin d g x s)`` of a gyro with gimbal axis ``g``, spin axis ``s`` at the
gimbal angle zero and momentum ``H``, and a gimbal that turns at the rate that is commanded, of limited size.
The torque on the body is what the change of that momentum asks for; it follows from the body's equations.

Leaves out the gimbal's own inertia and motor (the gimbal has its rate at once), friction of the gimbal,
limits of its angle, and any change of the rotor's speed.

Source: Wie 2008, "Space Vehicle Dynamics and Control", section 7.4.
"""

import math

from thruster_envs.helpers import njit

# Columns of the constants of a gyro: gimbal axis, spin axis at the gimbal angle zero, the product of the two
# (all unit vectors in the body), momentum of the rotor in N m s, largest gimbal rate in rad/s.
GIMBAL, SPIN, ACROSS, MOMENTUM, MAX_RATE, GYRO_CONSTANTS = 0, 3, 6, 9, 10, 11

# Rows of the scratch of the gyros of one craft: gimbal angle at the start of a step, rad, and rate, rad/s.
ANGLE, RATE, GYRO_ROWS = range(3)


@njit
def stored(gyros, after, s):
    """Momentum of the rotors, N m s, and its rate in the body, N m, ``after`` seconds of a step."""
    x, y, z, u, v, w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(gyros.shape[0]):
        angle = s[ANGLE, j] + after * s[RATE, j]
        c, k = gyros[j, MOMENTUM] * math.cos(angle), gyros[j, MOMENTUM] * math.sin(angle)
        x += c * gyros[j, 3] + k * gyros[j, 6]
        y += c * gyros[j, 4] + k * gyros[j, 7]
        z += c * gyros[j, 5] + k * gyros[j, 8]
        u += s[RATE, j] * (c * gyros[j, 6] - k * gyros[j, 3])
        v += s[RATE, j] * (c * gyros[j, 7] - k * gyros[j, 4])
        w += s[RATE, j] * (c * gyros[j, 8] - k * gyros[j, 5])
    return (x, y, z), (u, v, w)
