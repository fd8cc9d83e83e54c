"""A plain simulation of a chaser about Mars in its last twenty metres, to test fault diagnosis against.

Modelled, flight by flight and with true pulse timing: the nonlinear relative equations about a circular
orbit, rigid rotation, eight valves with one pulse per period, a delay of their own each time, first-order
rise and fall and a minimum on-time, noise of the LIDAR and of the attitude and rate estimates, a delay
between navigation and control, a constant disturbance; position and attitude loops and an allocation that
raises all valves together. Left out: the rate of the target's frame in the attitude, propellant, contact.

The vehicle is MSR-A, a parameter set of this project: the source (Fonod et al. 2013) withholds every number.
Inside, axes are those of its eq. 29 (x along-track, y against the orbit's normal, z to the planet) and the
attitude is body from them; what a flight records is in LVLH (x radial, y along-track, z cross-track).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.detection.residuals import NavigationFlights
from thruster_envs.kernels import kernel
from thruster_envs.spacecraft import Modulator, Sensors, Spacecraft, Thruster

Array = NDArray[np.float64]

MARS_MU = 4.282837e13
ORBIT_RADIUS = 3896.2e3
MEAN_MOTION = math.sqrt(MARS_MU / ORBIT_RADIUS**3)
MASS = 1500.0
INERTIA = np.array([1400.0, 1700.0, 1900.0])
PERIOD, SUBSTEPS = 0.1, 10
NOMINAL_DELAY = 0.1

CORNERS = np.array(
    [[1, 1, 1], [1, 1, -1], [-1, 1, 1], [-1, 1, -1], [-1, -1, -1], [-1, -1, 1], [1, -1, -1], [1, -1, 1]]
)
POSITIONS = CORNERS * np.array([1.2, 1.0, 1.0])
DIRECTIONS = -CORNERS * np.array([0.60, 0.30, math.sqrt(1.0 - 0.60**2 - 0.30**2)])
FORCES = 22.0 * DIRECTIONS.T
WRENCHES = np.vstack([FORCES, np.cross(POSITIONS, FORCES.T).T])

#: Turns LVLH components into those of eq. 29, and its quaternion.
AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
AXES_QUATERNION = np.array([0.5, 0.5, 0.5, -0.5])

MSR_A = Spacecraft(
    name="MSR-A",
    mass=MASS,
    inertia=tuple(tuple(row) for row in np.diag(INERTIA).tolist()),
    thrusters=tuple(
        Thruster(
            name=str(i + 1), position=tuple(POSITIONS[i]), direction=tuple(DIRECTIONS[i]), thrust=22.0,
            minimum_pulse=0.005, time_constant=0.02,
        )
        for i in range(8)
    ),
    sensors=Sensors(
        position=1e-3 / math.sqrt(3.0),
        attitude=math.radians(0.03) / math.sqrt(3.0),
        rate=math.radians(0.005) / math.sqrt(3.0),
    ),
    modulator=Modulator(delay=NOMINAL_DELAY, variation=0.015, variation_period=7.3, jitter=0.015),
    control_period=PERIOD,
    mean_motion=MEAN_MOTION,
)  # fmt: skip

HEALTHY, STUCK, LOSS, LEAK, LATE, SLOW, LATE_OPENING = range(7)
CODES = {
    "none": HEALTHY, "stuck_off": STUCK, "stuck_on": STUCK, "loss": LOSS, "leak": LEAK, "late": LATE,
    "slow": SLOW, "late_opening": LATE_OPENING,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the chaser is flown and what disturbs it.

    Attributes:
        start: Along-track position at time 0, m.
        speed: Of the approach, m/s.
        stop_at: When the reference begins to brake, s.
        braking: Deceleration of the reference, m/s^2; infinite stops at once.
        lidar: Half-width of the uniform error of each axis, m.
        attitude: The same of the attitude estimate, rad.
        rate: The same of the rate estimate, rad/s.
        delay_variation: Largest, s: half of it a sine common to all valves, half uniform and of each pulse.
        navigation_delay: Of the control behind the measurements, periods.
        idle: Open rate of a valve that is not needed.
        position_loop: Natural frequency, rad/s.
        attitude_loop: Natural frequency, rad/s.
        disturbance: Constant acceleration, m/s^2.
        centre_of_mass: By how far it is truly elsewhere, m, body axes.
        thrust_scatter: Half-width of the true thrust about the nominal, of each valve, as a share.
    """

    start: float = -20.0
    speed: float = 0.1
    stop_at: float = math.inf
    braking: float = 2e-3
    lidar: float = 1e-3
    attitude: float = math.radians(0.03)
    rate: float = math.radians(0.005)
    delay_variation: float = 0.03
    navigation_delay: int = 1
    idle: float = 0.1
    position_loop: float = 0.2
    attitude_loop: float = 0.5
    disturbance: tuple[float, float, float] = (2e-7, 1e-7, 3e-7)
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    thrust_scatter: float = 0.0


@dataclass(frozen=True)
class ValveFault:
    """What a valve does from `onset` on.

    `severity` is the opening of `stuck_on`, the share lost of `loss`, the opening of `leak`, the further
    delay of `late` (the whole pulse) and `late_opening` (its beginning alone) in s, and the time constant of
    `slow` in s; `stuck_off` is shut, whatever it says.
    """

    thruster: int = 0
    kind: str = "none"
    severity: float = 0.0
    onset: float = math.inf


@dataclass(frozen=True)
class Record:
    """What navigation and the modulator see of some flights, and the truth.

    Attributes:
        open_rates: (flights, samples, 8), told for the period that begins with the sample.
        position: (flights, samples, 3), m, measured, LVLH.
        attitude: (flights, samples, 4), measured, body from LVLH.
        rate: (flights, samples, 3), rad/s, measured, body axes.
        true_position: (flights, samples, 3), m, LVLH.
        true_velocity: (flights, samples, 3), m/s, LVLH.
        pointing: (flights, samples), rad, between the body and its attitude in the approach.
    """

    open_rates: Array
    position: Array
    attitude: Array
    rate: Array
    true_position: Array
    true_velocity: Array
    pointing: Array
    faults: list[ValveFault] = field(default_factory=list)

    def seen(self) -> NavigationFlights:
        """What detectors may see, and the faults to judge them by."""
        return NavigationFlights(
            self.open_rates, self.position, self.attitude, self.rate, PERIOD,
            np.array([one.thruster for one in self.faults]), tuple(one.kind for one in self.faults),
            np.array([one.severity for one in self.faults]), np.array([one.onset for one in self.faults]),
        )  # fmt: skip


def fly(seeds, duration: float, faults=None, settings: Settings | None = None) -> Record:
    """One flight for each seed, with a fault each or none."""
    settings = Settings() if settings is None else settings
    seeds = list(seeds)
    faults = [ValveFault()] * len(seeds) if faults is None else list(faults)
    samples = round(duration / PERIOD)
    shape = (len(seeds), samples)
    record = Record(
        np.empty((*shape, 8)), np.empty((*shape, 3)), np.empty((*shape, 4)), np.empty((*shape, 3)),
        np.empty((*shape, 3)), np.empty((*shape, 3)), np.empty(shape), faults,
    )  # fmt: skip
    time = PERIOD * np.arange(samples)
    reference = _reference(time, settings)
    allocation = np.linalg.pinv(WRENCHES)
    numbers = np.array(
        [
            settings.lidar, settings.attitude, settings.rate, settings.delay_variation,
            settings.navigation_delay, settings.idle, settings.position_loop, settings.attitude_loop,
            settings.thrust_scatter,
        ]
    )  # fmt: skip
    for k, (seed, fault) in enumerate(zip(seeds, faults, strict=True)):
        _fly_one(
            np.random.default_rng(int(seed)), reference, WRENCHES, allocation, np.array(settings.disturbance),
            np.array(settings.centre_of_mass), numbers,
            fault.thruster - 1, CODES[fault.kind],
            0.0 if fault.kind == "stuck_off" else fault.severity, fault.onset,
            record.open_rates[k], record.position[k], record.attitude[k], record.rate[k],
            record.true_position[k], record.true_velocity[k], record.pointing[k],
        )  # fmt: skip
    return record


def _reference(time: Array, settings: Settings) -> Array:
    """(samples, 3): along-track position, velocity, acceleration that the chaser is to have."""
    braked = np.maximum(time - settings.stop_at, 0.0)
    rows = np.empty((time.size, 3))
    if math.isinf(settings.braking):
        gone = np.minimum(time, settings.stop_at)
        rows[:, 0] = settings.start + settings.speed * gone
        rows[:, 1] = np.where(time < settings.stop_at, settings.speed, 0.0)
        rows[:, 2] = 0.0
        return rows
    braked = np.minimum(braked, settings.speed / settings.braking)
    moving = np.minimum(time, settings.stop_at + settings.speed / settings.braking)
    rows[:, 0] = settings.start + settings.speed * moving - 0.5 * settings.braking * braked**2
    rows[:, 1] = settings.speed - settings.braking * braked
    rows[:, 2] = np.where((braked > 0.0) & (rows[:, 1] > 1e-12), -settings.braking, 0.0)
    return rows


@kernel
def _turn_matrix(q):
    """(3, 3): components in the reference frame into the body's."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@kernel
def _product(a, b):
    return np.array(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


@kernel
def _turned(q, angle):
    """The attitude (body from reference) after the body turns further by a rotation vector, body axes."""
    size = math.sqrt(angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2)
    shape = 0.5 if size < 1e-9 else math.sin(0.5 * size) / size
    step = np.array([math.cos(0.5 * size), -shape * angle[0], -shape * angle[1], -shape * angle[2]])
    q = _product(step, q)
    return q / math.sqrt((q * q).sum())


@kernel
def _gravity(p, v):
    """Acceleration without thrust, axes of eq. 29, by the nonlinear eq. 27."""
    n, a = MEAN_MOTION, ORBIT_RADIUS
    x, y, z = -p[2], p[0], -p[1]
    vx, vy = -v[2], v[0]
    pull = MARS_MU / ((a + x) ** 2 + y * y + z * z) ** 1.5
    ax = n * n * x + 2.0 * n * vy + n * n * a - pull * (a + x)
    ay = n * n * y - 2.0 * n * vx - pull * y
    return np.array([ay, pull * z, -ax])


@kernel
def _hill(p, v):
    n = MEAN_MOTION
    return np.array([2.0 * n * v[2], -n * n * p[1], 3.0 * n * n * p[2] - 2.0 * n * v[0]])


@kernel
def _fly_one(
    rng, reference, wrenches, allocation, disturbance, centre_of_mass, numbers, thruster, kind, severity,
    onset, open_rates, position, attitude, rate, true_position, true_velocity, pointing,
):  # fmt: skip
    lidar, tilt, gyro, variation = numbers[0], numbers[1], numbers[2], numbers[3]
    late, idle, fast, quick, scatter = int(numbers[4]), numbers[5], numbers[6], numbers[7], numbers[8]
    samples, n = open_rates.shape
    h, kept = PERIOD / SUBSTEPS, 12
    p, v = np.array([reference[0, 0], 0.0, 0.0]), np.array([reference[0, 1], 0.0, 0.0])
    q, w = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    level = np.zeros(n)
    begins, ends = np.full((kept, n), -1.0), np.full((kept, n), -1.0)
    gain = 1.0 + scatter * rng.uniform(-1.0, 1.0, n)
    phase = rng.uniform(0.0, 2.0 * math.pi)
    seen_p, seen_q, seen_w = np.zeros((samples, 3)), np.zeros((samples, 4)), np.zeros((samples, 3))
    estimate, speed, pushed = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(samples):
        t = k * PERIOD
        # measure
        seen_p[k] = p + lidar * rng.uniform(-1.0, 1.0, 3)
        seen_q[k] = _turned(q, tilt * rng.uniform(-1.0, 1.0, 3))
        seen_w[k] = w + gyro * rng.uniform(-1.0, 1.0, 3)
        for j in range(3):
            rate[k, j] = seen_w[k, j]
        position[k, 0], position[k, 1], position[k, 2] = -seen_p[k, 2], seen_p[k, 0], -seen_p[k, 1]
        true_position[k, 0], true_position[k, 1], true_position[k, 2] = -p[2], p[0], -p[1]
        true_velocity[k, 0], true_velocity[k, 1], true_velocity[k, 2] = -v[2], v[0], -v[1]
        attitude[k] = _product(seen_q[k], np.array([0.5, 0.5, 0.5, -0.5]))
        pointing[k] = 2.0 * math.acos(min(1.0, abs(q[0])))
        # decide, on what navigation gave some periods ago
        old = max(k - late, 0)
        if k == 0:
            estimate[:] = seen_p[0]
            speed[0] = reference[0, 1]
        elif k > late:
            ahead = estimate + PERIOD * speed + 0.5 * PERIOD**2 * pushed
            missed = seen_p[old] - ahead
            estimate = ahead + 0.3 * missed
            speed = speed + PERIOD * pushed + 0.05 / PERIOD * missed
        wanted = -(fast**2) * estimate - 2.0 * 0.9 * fast * speed
        wanted[0] += fast**2 * reference[old, 0] + 1.8 * fast * reference[old, 1] + reference[old, 2]
        pushed = wanted
        demand = np.zeros(6)
        demand[:3] = _turn_matrix(seen_q[old]) @ (MASS * (wanted - _hill(estimate, speed)))
        sign = 1.0 if seen_q[old, 0] >= 0.0 else -1.0
        for j in range(3):
            off = -2.0 * sign * seen_q[old, 1 + j]
            demand[3 + j] = -INERTIA[j] * (quick**2 * off + 1.8 * quick * seen_w[old, j])
        told = allocation @ demand
        told += max(idle, -told.min())
        for i in range(n):
            told[i] = min(told[i], 1.0)
            if told[i] < 0.05:  # the minimum on-time
                told[i] = 0.0
            open_rates[k, i] = told[i]
            delay = NOMINAL_DELAY + 0.5 * variation * (
                math.sin(2.0 * math.pi * t / 7.3 + phase) + rng.uniform(-1.0, 1.0)
            )
            begin = t + delay
            end = begin + told[i] * PERIOD
            if i == thruster and t >= onset:
                if kind == LATE:
                    begin, end = begin + severity, end + severity
                elif kind == LATE_OPENING:
                    begin = min(begin + severity, end)
            begins[k % kept, i], ends[k % kept, i] = begin, end
        # fly
        for s in range(SUBSTEPS):
            start = t + s * h
            wrench = np.zeros(6)
            for i in range(n):
                share = 0.0
                for old in range(kept):
                    share += max(0.0, min(ends[old, i], start + h) - max(begins[old, i], start))
                share = min(share / h, 1.0)
                constant, strength = 0.02, gain[i]
                if i == thruster and start + h > onset:
                    active = min(1.0, (start + h - onset) / h)
                    if kind == STUCK or (kind == LEAK and told[i] < severity):
                        share = (1.0 - active) * share + active * severity
                    elif kind == LOSS:
                        strength *= 1.0 - active * severity
                    elif kind == SLOW:
                        constant = severity
                after = share + (level[i] - share) * math.exp(-h / constant)
                mean = share + (level[i] - after) * constant / h
                level[i] = after
                for j in range(6):
                    wrench[j] += strength * mean * wrenches[j, i]
            lever = np.zeros(3)
            lever[0] = centre_of_mass[1] * wrench[2] - centre_of_mass[2] * wrench[1]
            lever[1] = centre_of_mass[2] * wrench[0] - centre_of_mass[0] * wrench[2]
            lever[2] = centre_of_mass[0] * wrench[1] - centre_of_mass[1] * wrench[0]
            middle = _turned(q, 0.5 * h * w)
            force = _turn_matrix(middle).T @ wrench[:3] / MASS + disturbance
            half = v + 0.5 * h * (_gravity(p, v) + force)
            p_half = p + 0.5 * h * v
            p = p + h * half
            v = v + h * (_gravity(p_half, half) + force)
            w_half = w + 0.5 * h * _spin(w, wrench[3:] - lever)
            q = _turned(q, h * w_half)
            w = w + h * _spin(w_half, wrench[3:] - lever)


@kernel
def _spin(w, torque):
    """Euler's equation with principal axes, rad/s^2."""
    a, b, c = INERTIA
    return np.array(
        [
            (torque[0] - (c - b) * w[1] * w[2]) / a,
            (torque[1] - (a - c) * w[2] * w[0]) / b,
            (torque[2] - (b - a) * w[0] * w[1]) / c,
        ]
    )
