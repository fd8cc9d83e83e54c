"""Reaction wheels and control-moment gyros: conservation laws, closed forms, an independent integration."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import ControlMomentGyro, ReactionWheel, load

#: Orion without scatter and measurement errors; a moment off the diagonal leaves x a principal axis.
QUIET = load("orion").replace(
    thrusters=[{**vars(one), "scatter": 0.0} for one in load("orion").thrusters],
    sensors={},
    inertia=((0.575, 0.0, 0.0), (0.0, 0.582, 0.01), (0.0, 0.01, 0.534)),
)
#: Next to nothing, so that one compiled kernel serves a body whose moments are all alike too.
NEARLY_NONE = 1e-30
X = ReactionWheel(name="x", axis=(1, 0, 0), inertia=2e-3, max_torque=5e-3, max_speed=500.0)
SKEW = ReactionWheel(
    name="skew", axis=(1, 1, 1), inertia=1e-3, max_torque=4e-3, max_speed=400.0, viscous_friction=2e-6,
    initial_speed=120.0,
)  # fmt: skip
GYRO = ControlMomentGyro(
    name="a", gimbal_axis=(0, 0, 1), spin_axis=(1, 0, 0), momentum=0.08, max_gimbal_rate=0.1,
    initial_angle=0.3,
)  # fmt: skip


def craft(*wheels, gyros=(), **changes):
    return QUIET.replace(reaction_wheels=wheels, control_moment_gyros=gyros, **changes)


def begun(vehicle, rate=(0.0, 0.0, 0.0), faults=(), worlds=1, **options):
    fleet = Fleet(vehicle, worlds, **options)
    keys = np.arange(2 * worlds, dtype=np.uint64).reshape(worlds, 2)
    fleet.begin(fleet.everyone, keys, np.zeros(worlds, np.uint64), fleet.plan(list(faults)))
    fleet.write(at.RATE, np.array([rate]))
    fleet.look(fleet.everyone)
    return fleet


def fly(fleet, torques=(), rates=(), duties=0.0, periods=1):
    rows = fleet.rows
    if len(torques):
        fleet.write(rows.wheel_torques, [[torques]])
    if len(rates):
        fleet.write(rows.gimbal_rates, [[rates]])
    for _ in range(periods):
        fleet.write(rows.duties, np.broadcast_to(duties, (fleet.worlds, 1, rows.thrusters)))
        fleet.fly()


def rotated(q, v):
    """Body components of a reference vector."""
    t = np.cross(q[1:], v)
    return v + 2.0 * np.cross(q[1:], t + q[0] * v)


def of(fleet, row, count, world=0):
    return fleet.read(row, count)[world, 0] if count else np.zeros(0)


def momentum(fleet, world=0):
    """Total angular momentum in inertial space, N m s: the LVLH frame has turned about its z axis."""
    vehicle, rows = fleet.spacecraft, fleet.rows
    q = fleet.read(at.ATTITUDE, 4)[world, 0]
    total = np.array(vehicle.inertia) @ fleet.read(at.RATE, 3)[world, 0]
    for wheel, speed in zip(
        vehicle.reaction_wheels, of(fleet, rows.wheel_speeds, rows.number_of_wheels), strict=True
    ):
        total += wheel.inertia * speed * np.array(wheel.axis)
    for gyro, angle in zip(
        vehicle.control_moment_gyros, of(fleet, rows.gimbal_angles, rows.number_of_gyros), strict=True
    ):
        total += gyro.momentum * spin(gyro, angle)
    lvlh = rotated(q * [1, -1, -1, -1], total)
    turned = vehicle.mean_motion * vehicle.control_period * fleet.read(at.STEP)[world, 0, 0]
    c, s = math.cos(turned), math.sin(turned)
    return np.array([c * lvlh[0] - s * lvlh[1], s * lvlh[0] + c * lvlh[1], lvlh[2]])


def spin(gyro, angle):
    across = np.cross(gyro.gimbal_axis, gyro.spin_axis)
    return math.cos(angle) * np.array(gyro.spin_axis) + math.sin(angle) * across


def test_momentum_is_conserved_where_a_wheel_accelerates_between_the_corners_of_valves():
    """The thrusters, which fire for other times, push on the centre of mass: they give no torque."""
    thrusters = [{**vars(one), "position": (0.0, 0.0, 0.0)} for one in QUIET.thrusters]
    vehicle = craft(X, SKEW, gyros=[GYRO], thrusters=thrusters)
    fleet = begun(vehicle, rate=(0.02, -0.03, 0.05))
    before = momentum(fleet)
    rng = np.random.default_rng(3)
    for _ in range(20):
        fly(fleet, rng.uniform(-1, 1, 2), rng.uniform(-1, 1, 1), duties=rng.uniform(0, 1, 12))
    after = momentum(fleet)
    assert np.linalg.norm(after - before) < 1e-10 * np.linalg.norm(before)
    assert abs(fleet.read(fleet.rows.wheel_speeds, 2)).min() > 1.0


def test_with_thrust_the_momentum_grows_by_the_impulse():
    """Without turning to speak of, the impulse in body axes is that in inertial space."""
    vehicle = craft(X, inertia=((6e4, 0.0, 0.0), (0.0, 5e4, 10.0), (0.0, 10.0, 4e4)))
    fleet = begun(vehicle)
    before = momentum(fleet)
    duties = np.linspace(0.05, 0.95, 12)
    fly(fleet, [0.7], duties=duties)
    gained = momentum(fleet) - before
    assert gained == pytest.approx(fleet.read(at.IMPULSE + 3, 3)[0, 0], rel=0, abs=1e-6)
    assert np.linalg.norm(gained) > 0.01


def test_a_wheel_spins_the_body_up_about_a_principal_axis():
    """``J w + I W`` stays, and ``I (W' + w') = u``: ``w' = -u / (J - I)``."""
    fleet = begun(craft(X))
    fly(fleet, [0.5], periods=2)
    u, own, j, t = 0.5 * 5e-3, 2e-3, QUIET.inertia[0][0], 10.0
    rate, speed = fleet.read(at.RATE, 3)[0, 0], fleet.read(fleet.rows.wheel_speeds)[0, 0, 0]
    assert rate == pytest.approx([-u * t / (j - own), 0.0, 0.0], rel=1e-12, abs=1e-15)
    assert speed == pytest.approx(u * t / own + u * t / (j - own), rel=1e-12)


def test_a_body_with_a_fast_wheel_precesses():
    """With moments all alike, ``J w' = -w x h``: the rate turns about the wheel's axis at ``h / J``."""
    j = 0.6
    wheel = ReactionWheel(
        name="z", axis=(0, 0, 1), inertia=1e-3, max_torque=1e-3, max_speed=1e3, initial_speed=300.0
    )
    alike = ((j, 0.0, 0.0), (0.0, j, NEARLY_NONE), (0.0, NEARLY_NONE, j))
    fleet = begun(craft(wheel, inertia=alike), rate=(0.01, 0.0, 0.0), max_substep=0.05)
    fly(fleet, [0.0], periods=4)
    angle = 300.0 * 1e-3 / j * 20.0
    expected = [0.01 * math.cos(angle), 0.01 * math.sin(angle), 0.0]
    assert fleet.read(at.RATE, 3)[0, 0] == pytest.approx(expected, rel=0, abs=1e-9)


def reference(vehicle, rate, torques, gimbals, t):
    """Rates, speeds and angles by SciPy, with the full matrices: no sub-steps, no closed forms."""
    wheels, gyros = vehicle.reaction_wheels, vehicle.control_moment_gyros
    m = len(wheels)
    j = np.array(vehicle.inertia)

    def slope(_, y):
        w, speed, angle = y[4:7], y[7 : 7 + m], y[7 + m :]
        matrix, right = np.zeros((3 + m, 3 + m)), np.zeros(3 + m)
        stored, change = np.zeros(3), np.zeros(3)
        for gyro, d, r in zip(gyros, angle, gimbals, strict=True):
            stored += gyro.momentum * spin(gyro, d)
            change += gyro.momentum * r * np.cross(gyro.gimbal_axis, spin(gyro, d))
        matrix[:3, :3] = j
        for i, wheel in enumerate(wheels):
            a, own = np.array(wheel.axis), wheel.inertia
            stored += own * speed[i] * a
            matrix[:3, 3 + i], matrix[3 + i, :3], matrix[3 + i, 3 + i] = own * a, own * a, own
            friction = wheel.viscous_friction * speed[i] + wheel.coulomb_friction * np.sign(speed[i])
            right[3 + i] = torques[i] * wheel.max_torque - friction
        right[:3] = -np.cross(w, j @ w + stored) - change
        rates = np.linalg.solve(matrix, right)
        q = y[:4]
        x = w - rotated(q, np.array([0.0, 0.0, vehicle.mean_motion]))
        dq = -0.5 * np.concatenate([[-x @ q[1:]], q[0] * x + np.cross(x, q[1:])])
        return np.concatenate([dq, rates, gimbals])

    y0 = np.concatenate(
        [[1.0, 0, 0, 0], rate, [one.initial_speed for one in wheels], [one.initial_angle for one in gyros]]
    )
    return solve_ivp(slope, (0.0, t), y0, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def state_of(fleet):
    rows = fleet.rows
    parts = [(at.ATTITUDE, 4), (at.RATE, 3), (rows.wheel_speeds, rows.number_of_wheels)]
    return np.concatenate([of(fleet, *part) for part in [*parts, (rows.gimbal_angles, rows.number_of_gyros)]])


def test_wheels_and_gyros_fly_as_an_independent_integration():
    rubbing = ReactionWheel(
        name="y", axis=(0.2, 1, 0.1), inertia=1.5e-3, max_torque=4e-3, max_speed=700.0, coulomb_friction=2e-4,
        viscous_friction=3e-6, initial_speed=-80.0,
    )  # fmt: skip
    inertia = ((0.6, 0.02, -0.01), (0.02, 0.5, 0.03), (-0.01, 0.03, 0.4))
    vehicle = craft(X, SKEW, rubbing, gyros=[GYRO], inertia=inertia)
    rate, torques, gimbals = (0.03, -0.02, 0.04), (0.6, -0.4, -0.3), (0.7,)
    fleet = begun(vehicle, rate=rate, max_substep=0.02)
    fly(fleet, torques, gimbals, periods=3)
    expected = reference(vehicle, np.array(rate), torques, np.array(gimbals) * 0.1, 15.0)
    error = np.abs(state_of(fleet) - expected)
    assert error[:7].max() < 1e-9
    assert (error[7:] / np.maximum(1.0, np.abs(expected[7:]))).max() < 1e-9


def test_a_wheel_stops_at_its_limit_and_the_body_keeps_its_rate():
    wheel = ReactionWheel(name="x", axis=(1, 0, 0), inertia=2e-3, max_torque=5e-3, max_speed=4.0)
    fleet = begun(craft(wheel))
    fly(fleet, [1.0], periods=3)
    assert fleet.read(fleet.rows.wheel_speeds)[0, 0, 0] == 4.0
    rate = fleet.read(at.RATE, 3)[0, 0]
    assert rate == pytest.approx([-2e-3 * 4.0 / QUIET.inertia[0][0], 0.0, 0.0], rel=1e-12, abs=1e-16)
    fly(fleet, [-1.0])
    assert fleet.read(fleet.rows.wheel_speeds)[0, 0, 0] < 4.0


def test_dry_friction_slows_a_wheel_until_it_stands_and_then_holds_it():
    """``I_eff W' = -c`` with the body free: it stands after ``W I (1 - I / J) / c``."""
    own, c, start = 2e-3, 1e-3, 10.0
    wheel = ReactionWheel(
        name="x", axis=(1, 0, 0), inertia=own, max_torque=5e-3, max_speed=500.0, coulomb_friction=c,
        initial_speed=start,
    )  # fmt: skip
    j = QUIET.inertia[0][0]
    stands = start * own * (1.0 - own / j) / c
    fleet = begun(craft(wheel, control_period=stands * 0.5))
    fly(fleet, [0.0])
    assert fleet.read(fleet.rows.wheel_speeds)[0, 0, 0] == pytest.approx(0.5 * start, rel=1e-12)
    fly(fleet, [0.0], periods=2)
    assert fleet.read(fleet.rows.wheel_speeds)[0, 0, 0] == 0.0
    assert fleet.read(at.RATE, 3)[0, 0] == pytest.approx([own * start / j, 0.0, 0.0], rel=1e-10, abs=1e-16)
    fly(fleet, [0.19])  # 0.95e-3 N m is less than the friction
    assert fleet.read(fleet.rows.wheel_speeds)[0, 0, 0] == 0.0
    fly(fleet, [0.21])
    assert fleet.read(fleet.rows.wheel_speeds)[0, 0, 0] > 0.0


def speed_after(fault, wheel=X, torque=0.5, periods=2, rate=(0.0, 0.0, 0.0)):
    fleet = begun(craft(wheel), rate=rate, faults=[fault] if fault else [])
    fly(fleet, [torque], periods=periods)
    return fleet.read(fleet.rows.wheel_speeds)[0, 0, 0]


def test_faults_of_wheels_do_what_the_table_says():
    healthy = speed_after(None)
    half = Fault(1, "wheel_torque_loss", severity=0.5, onset=5.0)
    assert speed_after(half) == pytest.approx(0.75 * healthy, rel=1e-12)
    assert speed_after(Fault(1, "wheel_stuck", onset=5.0)) == pytest.approx(0.5 * healthy, rel=1e-12)
    drag = Fault(1, "wheel_friction", severity=0.1)
    assert speed_after(drag) == pytest.approx(0.8 * healthy, rel=1e-12)
    limited = Fault(1, "wheel_speed_limit", severity=0.99)
    assert speed_after(limited) == pytest.approx(5.0, rel=1e-12)


def test_faults_of_gimbals_do_what_the_table_says():
    for fault, share in (
        (Fault(1, "gimbal_rate_loss", severity=0.25, onset=5.0), 0.875),
        (Fault(1, "gimbal_lock", onset=2.0), 0.2),
    ):
        fleet = begun(craft(gyros=[GYRO]), faults=[fault])
        fly(fleet, rates=[0.5], periods=2)
        assert fleet.read(fleet.rows.gimbal_angles)[0, 0, 0] == pytest.approx(0.3 + 0.5 * share, rel=1e-12)


def test_the_fault_of_a_wheel_leaves_the_thruster_of_that_number_alone():
    fleets = [begun(craft(X), faults=faults) for faults in ((), [Fault(1, "wheel_stuck")])]
    for fleet in fleets:
        fly(fleet, [0.0], duties=0.4)
    assert np.array_equal(*[fleet.read(fleet.rows.delivered, 12) for fleet in fleets])
    assert fleets[1].fault_rows()[0, 0, 0, 0] == 15.0


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (Fault(2, "wheel_stuck"), "fault 1 is on wheel 2; its number must be from 1 to 1"),
        (Fault(1, "gimbal_lock"), "has no meaning here"),
    ],
)
def test_a_fault_of_what_is_not_there_is_refused(fault, message):
    with pytest.raises(ValueError, match=message):
        Fleet(craft(X), 1).plan([fault])


@pytest.mark.nightly
def test_a_body_without_products_of_inertia_is_one_with_hardly_any():
    """Kernels are compiled for either form of the inertia."""
    flown = []
    for off in (0.0, NEARLY_NONE):
        inertia = ((0.6, 0.0, 0.0), (0.0, 0.5, off), (0.0, off, 0.4))
        fleet = begun(craft(X, SKEW, gyros=[GYRO], inertia=inertia), rate=(0.01, 0.02, -0.03))
        fly(fleet, [0.4, -0.6], [0.2], duties=0.3, periods=3)
        flown.append(state_of(fleet))
    assert flown[0] == pytest.approx(flown[1], rel=1e-11, abs=1e-13)


@pytest.mark.nightly
def test_momentum_is_conserved_behind_a_modulator_too():
    chaser = load("msr_chaser")
    thrusters = [{**vars(one), "position": (0.0, 0.0, 0.0)} for one in chaser.thrusters]
    wheel = ReactionWheel(name="x", axis=(1, 0, 0), inertia=0.1, max_torque=0.2, max_speed=500.0)
    gyro = ControlMomentGyro(
        name="a", gimbal_axis=(0, 0, 1), spin_axis=(1, 0, 0), momentum=30.0, max_gimbal_rate=0.2
    )
    vehicle = chaser.replace(reaction_wheels=[wheel], control_moment_gyros=[gyro], thrusters=thrusters)
    fleet = begun(vehicle, rate=(0.01, -0.02, 0.015))
    before = momentum(fleet)
    for k in range(100):
        fly(fleet, [math.sin(k)], [math.cos(k)], duties=0.5)
    assert np.linalg.norm(momentum(fleet) - before) < 1e-10 * np.linalg.norm(before)


def test_a_batch_flies_what_single_worlds_fly_and_goes_on_where_it_was_saved():
    """To the last bit, in one thread and in two, with faults, gyros and wheels."""
    vehicle = craft(X, SKEW, gyros=[GYRO])
    faults = [Fault(1, "wheel_friction", severity=0.3, onset=7.0, profile="ramp", profile_time=9.0),
              Fault(3, "stuck_on", onset=3.0)]  # fmt: skip

    def flown(worlds, steps, threads=1):
        fleet = begun(vehicle, (0.01, 0.02, -0.03), faults, worlds, threads=threads)
        for k in range(steps):
            fly(fleet, [0.5 - 0.2 * k, 0.1 * k], [0.3 - 0.1 * k], duties=np.linspace(0.0, 0.9, 12))
        return fleet

    batch, single = flown(40, 4), flown(1, 4)
    rows = single.rows
    assert np.array_equal(batch.read(0, rows.fields)[0], single.read(0, rows.fields)[0])
    assert np.array_equal(batch.data, flown(40, 4, threads=2).data)
    half = flown(40, 2)
    kept = half.state()
    other = flown(40, 1)
    other.restore(kept)
    for fleet in (half, other):
        fly(fleet, [0.2, 0.3], [0.1], duties=0.2)
    assert np.array_equal(half.data, other.data)


def test_healthy_wheels_and_gyros_give_what_is_expected_and_a_fault_shows_in_the_difference():
    """The measured rate change is free of the turning by stored momentum."""
    vehicle = craft(X, SKEW, gyros=[GYRO], control_period=0.5)
    apart = []
    for faults in ((), [Fault(1, "wheel_torque_loss", severity=1.0)]):
        fleet = begun(vehicle, rate=(0.01, -0.02, 0.01), faults=faults)
        fly(fleet, [0.8, -0.5], [0.4], periods=3)
        measured, expected = (
            fleet.read(row + 3, 3)[0, 0] for row in (at.MEASURED_CHANGE, at.EXPECTED_CHANGE)
        )
        apart.append(np.linalg.norm(measured - expected))
        assert np.linalg.norm(expected) > 2e-3
    assert apart[0] < 2e-5 < 100.0 * apart[0] < apart[1]
