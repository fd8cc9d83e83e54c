"""What faulty sensors say, against a reference written from the kinds alone; what truly is stays as it is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.physics.closed_forms import rotation_matrix
from tests.physics.flying import Array, begin, pulsed_fleet
from tests.physics.reference_flight import ActiveFault, is_active
from thruster_envs.faults import PROFILES, SENSOR_KINDS, SENSORS, Fault, FaultDistribution
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.orbits import transition_matrix
from thruster_envs.spacecraft import load

VEHICLES = {"orion": Fleet, "msr_chaser": Fleet, "ppt_cubesat": pulsed_fleet}
PURPOSE = 6
PERIODS = 14
SIZE = {"bias": -0.4, "drift": 0.3, "scale": -0.25, "freeze": 1.0, "spike": 2.0, "drop_out": 0.5}
PLACE = {"position": 0, "velocity": 3, "rate": 10}


def chance(seed: int, step: int, slot: int) -> float:
    """The random number of a fault and a measurement, by NumPy's own Philox."""
    counter = [slot, step, 0, PURPOSE << 32]
    before = (sum(word << (64 * k) for k, word in enumerate(counter)) - 1) % 2**256
    word = int(np.random.Philox(counter=before, key=seed).random_raw(1)[0])
    return ((word >> 32) + 0.5) / 2.0**32


def attitude(measured: Array) -> Rotation:
    """How the body is turned from LVLH."""
    return Rotation.from_matrix(rotation_matrix(measured[6:10]).T)


def expected(clean: Array, faults: list[Fault], period: float, seed: int) -> tuple[Array, list[Rotation]]:
    """What is given (K, 13), attitude apart, from what is measured without faults (K, 13)."""
    given, turned = clean.copy(), []
    for k in range(len(clean)):
        turn = attitude(clean[k])
        error, held = {one: np.zeros(3) for one in SENSORS}, {one: np.zeros(3, bool) for one in SENSORS}
        for slot, fault in enumerate(faults):
            if fault.sensor is None or not is_active(fault, k * period):
                continue
            axes = range(3) if fault.axis == 0 else [fault.axis - 1]
            s, draw = ActiveFault(fault, 0.0, k * period).severity(k * period), chance(seed, k, slot)
            for axis in axes:
                own = turn.as_rotvec() if fault.sensor == "attitude" else clean[k, PLACE[fault.sensor] :]
                error[fault.sensor][axis] += {
                    "bias": s,
                    "drift": s * (k * period - fault.onset),
                    "scale": s * own[axis],
                    "spike": s if draw < 0.1 else 0.0,
                }.get(fault.kind, 0.0)
                missing = fault.kind == "freeze" or (fault.kind == "drop_out" and draw < s)
                held[fault.sensor][axis] |= missing and k > 0
        for sensor, place in PLACE.items():
            new = clean[k, place : place + 3] + error[sensor]
            given[k, place : place + 3] = np.where(held[sensor], given[k - 1, place : place + 3], new)
        # Turns about body axes come after those that brought the body there.
        turn = turn * Rotation.from_rotvec(error["attitude"])
        if held["attitude"].any():
            back = (turn.inv() * turned[-1]).as_rotvec()
            turn = turn * Rotation.from_rotvec(np.where(held["attitude"], back, 0.0))
        turned.append(turn)
    return given, turned


def flown(vehicle: str, faults: list[list[Fault]], *, threads: int = 1) -> tuple[Array, Array, Array]:
    """What is given (worlds, K, 13), what is true, and the measured rate change, one world for each list."""
    fleet = VEHICLES[vehicle](load(vehicle), len(faults), threads=threads)
    begin(fleet, seed=50)
    keys = np.zeros((len(faults), 2), np.uint64)
    keys[:, 0] = 50 + np.arange(len(faults))
    for world, one in enumerate(faults):
        fleet.begin(np.array([world]), keys, np.zeros(len(faults), np.uint64), fleet.plan(one))
    fleet.write(at.RATE, (0.01, -0.02, 0.015))
    if vehicle != "ppt_cubesat":
        fleet.write(at.POSITION, (12.0, -8.0, 3.0))
        fleet.write(at.VELOCITY, (0.05, -0.2, 0.03))
    fleet.look(fleet.everyone)
    rng = np.random.default_rng(0)
    measured, true, change = [fleet.read(at.MEASURED, 13)], [fleet.read(0, 14)], []
    for _ in range(PERIODS):
        fleet.write(fleet.rows.duties, 0.05 * rng.random(fleet.rows.thrusters))
        fleet.fly()
        measured.append(fleet.read(at.MEASURED, 13))
        true.append(fleet.read(0, 14))
        change.append(fleet.read(at.MEASURED_CHANGE, 6))
    return tuple(np.array(one)[:, :, 0].swapaxes(0, 1) for one in (measured, true, change))


def cases(vehicle: str) -> list[list[Fault]]:
    """One world for each kind, profile, sensor, and one or all of its axes; then several faults at once."""
    period = load(vehicle).control_period
    sensors = SENSORS if vehicle != "ppt_cubesat" else SENSORS[2:]
    worlds = []
    for kind, profile, sensor, axis in itertools.product(SENSOR_KINDS, PROFILES, sensors, (0, 2)):
        if kind == "freeze" and profile in ("ramp", "sine"):
            continue
        worlds.append([
            Fault(sensor=sensor, axis=axis, kind=kind, severity=SIZE[kind], onset=1.7 * period,
                  duration=9.5 * period, profile=profile, profile_time=4.0 * period, dwell=0.6)
        ])  # fmt: skip
    several = [
        Fault(1, "loss", severity=0.5),
        Fault(sensor="rate", axis=1, kind="bias", severity=0.01),
        Fault(sensor="rate", kind="scale", severity=0.5, onset=3.0 * period),
        Fault(sensor="attitude", axis=3, kind="freeze", onset=2.0 * period),
    ]
    at_once = [
        Fault(sensor="attitude", kind="bias", severity=0.2),
        Fault(sensor="attitude", axis=1, kind="freeze"),
        Fault(sensor="attitude", axis=2, kind="drop_out", severity=0.4),
        Fault(sensor="rate", axis=2, kind="drop_out", severity=0.6),
    ]
    return [*worlds, several, at_once]


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_each_kind_gives_the_measurement_of_the_reference(vehicle):
    faults, period = cases(vehicle), load(vehicle).control_period
    healthy = [[one for one in world if one.sensor is None] for world in faults]
    clean, truth, _ = flown(vehicle, healthy)
    given, same_truth, change = flown(vehicle, faults)
    assert np.array_equal(same_truth, truth)
    drift = transition_matrix(load(vehicle).mean_motion, period)[3:]
    inertia = np.array(load(vehicle).inertia)
    for world, some in enumerate(faults):
        numbers, turns = expected(clean[world], some, period, 50 + world)
        for columns in (slice(0, 6), slice(10, 13)):
            np.testing.assert_allclose(given[world][:, columns], numbers[:, columns], rtol=1e-12, atol=1e-13)
        for k, turn in enumerate(turns):
            assert (attitude(given[world, k]) * turn.inv()).magnitude() < 1e-12
            assert abs(np.linalg.norm(given[world, k, 6:10]) - 1.0) < 1e-14
        for k in range(PERIODS):  # what follows from the measurements that were given
            old, new = given[world, k], given[world, k + 1]
            moved = rotation_matrix(old[6:10]) @ (new[3:6] - drift @ old[:6])
            mean = 0.5 * (old[10:] + new[10:])
            turned = new[10:] - old[10:] + period * np.linalg.solve(inertia, np.cross(mean, inertia @ mean))
            wanted = np.concatenate([moved if vehicle != "ppt_cubesat" else np.zeros(3), turned])
            np.testing.assert_allclose(change[world, k], wanted, rtol=1e-9, atol=1e-12)


def test_a_sensor_is_held_exactly_and_a_drop_out_says_so():
    period = load("orion").control_period
    frozen = [Fault(sensor=one, kind="freeze", onset=2.0 * period, duration=5.0 * period) for one in SENSORS]
    given, _, _ = flown("orion", [frozen])
    assert np.array_equal(given[0, 2:7], np.broadcast_to(given[0, 1], (5, 13)))
    assert (given[0, 7] != given[0, 1]).all()
    fleet = Fleet(load("orion"), 3)
    begin(fleet, [Fault(sensor="attitude", kind="drop_out", onset=period, duration=2.0 * period)])
    fleet.look(fleet.everyone)
    stale = []
    for _ in range(4):
        stale.append(fleet.stale()[:, 0])
        fleet.fly()
    assert not np.array(stale)[:, :, [0, 1, 3]].any()
    assert np.array(stale)[:, :, 2].T.tolist() == [[False, True, True, False]] * 3


def test_spikes_and_drop_outs_come_as_often_as_they_should():
    faults = [
        Fault(sensor="position", axis=1, kind="spike", severity=1e6),
        Fault(sensor="velocity", kind="drop_out", severity=0.3),
    ]
    fleet = Fleet(load("orion"), 500)
    begin(fleet, faults)
    fleet.look(fleet.everyone)
    hits, missing, count = 0, 0, 500 * 20
    for _ in range(20):
        fleet.fly()
        hits += int((fleet.read(at.MEASURED)[:, 0, 0] > 5e5).sum())
        missing += int(fleet.stale()[:, 0, 1].sum())
    for seen, share in ((hits, 0.1), (missing, 0.3)):
        assert abs(seen - share * count) < 4.0 * np.sqrt(share * (1.0 - share) * count)


def test_single_craft_batches_and_threads_measure_the_same_bits():
    """Drawn faults of sensors and thrusters: a batch of 70 in two threads, and each craft by itself."""
    law = FaultDistribution(
        probability=0.7, onset=(0.0, 20.0), profiles=PROFILES, sensor_probability=1.0, sensor_count=(1, 3),
        sensor_axes=(0, 1, 2, 3),
    )  # fmt: skip
    craft = load("orion")
    measured = {}
    for name, seeds, threads in (("one", range(70), 1), ("two", range(70), 2), ("alone", (3, 41), 1)):
        for first in [0] if name != "alone" else seeds:
            fleet = Fleet(craft, 70 if name != "alone" else 1, threads=threads)
            begin(fleet, law, seed=first)
            fleet.look(fleet.everyone)
            for _ in range(8):
                fleet.fly()
            measured[name, first] = fleet.read(at.MEASURED, 19)
    assert np.array_equal(measured["one", 0], measured["two", 0])
    for first in (3, 41):
        assert np.array_equal(measured["alone", first][0], measured["one", 0][first])


@pytest.mark.parametrize(
    ("fleet", "sensor", "message"),
    [
        (
            pulsed_fleet(load("ppt_cubesat"), 1),
            "position",
            "must be one of attitude, rate here, got 'position'",
        ),
        (Fleet(load("orion"), 1, sensors=()), "rate", "sensor has no meaning here, got 'rate'"),
    ],
)
def test_a_sensor_that_does_not_measure_is_refused(fleet, sensor, message):
    with pytest.raises(ValueError, match=message):
        fleet.plan([Fault(sensor=sensor, kind="bias")])
    with pytest.raises(ValueError, match="sensor"):
        fleet.plan(FaultDistribution(sensor_probability=0.5, sensors=(sensor,)))
