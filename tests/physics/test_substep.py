"""The error of the default sub-step, against the noise of the sensors, over a rendezvous of half an orbit."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.closed_forms import hcw_transition, rotation_angle, rotation_matrix
from tests.physics.flying import Array, begin
from thruster_envs.faults import Fault
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import load

PERIODS, WORLDS = 571, 4
SMALL_SUBSTEP = 0.05
START = np.array([300.0, 0.0, 0.0])


def transfer() -> Array:
    """(PERIODS, 6) where the free transfer from START to the origin stands at the end of each period."""
    spacecraft = load("orion")
    whole = hcw_transition(spacecraft.mean_motion, PERIODS * spacecraft.control_period)
    state = np.zeros(6)
    state[:3] = START
    state[3:5] = np.linalg.solve(whole[:2, 3:5], -whole[:2, :3] @ START)
    return np.array(
        [
            hcw_transition(spacecraft.mean_motion, k * spacecraft.control_period) @ state
            for k in range(1, PERIODS + 1)
        ]
    )


def rendezvous(
    max_substep: float | None, faults: list[Fault], duties: Array | None = None
) -> tuple[Array, Array]:
    """Orion follows the transfer, by feedback of noisy measurements or under given duties.

    Returns states (PERIODS, WORLDS, 14) and duties (PERIODS, WORLDS, 1, 12).
    """
    spacecraft = load("orion")
    fleet = Fleet(spacecraft, WORLDS, max_substep=max_substep)
    begin(fleet, faults, seed=5)
    rng = np.random.default_rng(0)
    attitude = np.concatenate([np.ones((WORLDS, 1, 1)), rng.uniform(-0.04, 0.04, (WORLDS, 1, 3))], axis=2)
    fleet.write(at.POSITION, START + rng.uniform(-5.0, 5.0, (WORLDS, 1, 3)))
    fleet.write(at.ATTITUDE, attitude / np.linalg.norm(attitude, axis=2, keepdims=True))
    fleet.write(at.RATE, rng.uniform(-1e-3, 1e-3, (WORLDS, 1, 3)))
    fleet.look(fleet.everyone)
    states, commanded = [], []
    for period, slot in enumerate(transfer()):
        if duties is None:
            measured = fleet.read(at.MEASURED, 13)[:, 0]
            fleet.write(fleet.rows.duties, np.array([[feedback(one, slot)] for one in measured]))
        else:
            fleet.write(fleet.rows.duties, duties[period])
        commanded.append(fleet.read(fleet.rows.duties, 12))
        fleet.fly()
        states.append(fleet.read(0, 14)[:, 0])
    return np.array(states), np.array(commanded)


def spring(error: Array, speed: Array, frequency: float) -> Array:
    """Acceleration that brings an error to zero with critical damping."""
    return -(frequency**2 * error + 2.0 * frequency * speed)


EFFECTIVENESS_INVERSE = np.linalg.pinv(load("orion").effectiveness())


def feedback(measured: Array, slot: Array) -> Array:
    """(12,) duties of a plain pilot: a damped spring on each axis, and on-times of least norm, none negative.

    Args:
        measured: (13,) what the sensors say.
        slot: (6,) where the craft should be.
    """
    attitude, rate = measured[6:10], measured[10:13]
    body_from_lvlh = rotation_matrix(attitude)
    force = body_from_lvlh @ spring(measured[:3] - slot[:3], measured[3:6] - slot[3:], 0.01)
    spin = rate - body_from_lvlh @ [0.0, 0.0, 0.0011]
    torque = spring(-2.0 * np.sign(attitude[0]) * attitude[1:], spin, 0.03)
    duties = EFFECTIVENESS_INVERSE @ np.concatenate([force, torque])
    return np.clip(duties - min(0.0, duties.min()), 0.0, 1.0)


def differences(first: Array, second: Array) -> Array:
    """(4,) the largest in the flight over the noise: position, velocity, attitude angle, rate."""
    sensors = load("orion").sensors
    angle = max(
        rotation_angle(one, other)
        for one, other in zip(first[..., 6:10].reshape(-1, 4), second[..., 6:10].reshape(-1, 4), strict=True)
    )
    return np.array(
        [
            np.abs(first - second)[..., 0:3].max() / sensors.position,
            np.abs(first - second)[..., 3:6].max() / sensors.velocity,
            angle / sensors.attitude,
            np.abs(first - second)[..., 10:13].max() / sensors.rate,
        ]
    )


@pytest.mark.parametrize("faults", [[], [Fault(3, "stuck_off", onset=300.0)]], ids=["healthy", "one_dead"])
def test_the_default_substep_errs_by_less_than_a_thousandth_of_the_sensor_noise(faults):
    """Over an episode flown on its measurements: an error is steered away as any other is."""
    exact, _ = rendezvous(SMALL_SUBSTEP, faults)
    default, _ = rendezvous(None, faults)
    assert np.linalg.norm(exact[-1, :, :3], axis=1).max() < 5.0
    assert differences(default, exact).max() < 1e-3


def test_replayed_without_feedback_it_errs_by_less_than_a_thousandth_too():
    """The same duties: the errors of half an orbit add up, in position above all."""
    exact, duties = rendezvous(SMALL_SUBSTEP, [])
    default, _ = rendezvous(None, [], duties)
    assert differences(default, exact).max() < 1e-3
