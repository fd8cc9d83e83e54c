"""The same craft flown by Basilisk and by the kernels: free motion, tumbling, twelve thrusters open-loop.

Basilisk (AVSLab) integrates the inertial motion of a rigid hub about a point mass by RK4 in equal steps; the
kernels integrate the motion relative to a circular orbit between valve events. They share nothing but the
description of the vehicle.

Basilisk opens a thruster at every moment up to the end of its pulse at which RK4 looks. With pulses of whole
steps, that is each of their steps and once more the start of the next one, which weighs a sixth: it fires for
a sixth of a step longer than commanded, and that is what the kernels are commanded here.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from thruster_envs.physics import rows as at
from thruster_envs.physics.attitude import rotate
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.orbits import orbit_radius
from thruster_envs.spacecraft import Feed, Sensors, load

STEP, PERIODS = 0.01, 24  # s, of Basilisk; of control, one second each


def vehicle():
    """Orion without what Basilisk does not have: a shared feed, scatter from pulse to pulse, noise."""
    orion = load("orion")
    thrusters = tuple(replace(thruster, scatter=0.0) for thruster in orion.thrusters)
    inertia = ((0.575, 0.02, -0.03), (0.02, 0.582, 0.01), (-0.03, 0.01, 0.534))
    return orion.replace(
        thrusters=thrusters, feed=Feed(), sensors=Sensors(), inertia=inertia, control_period=1.0
    )


class State(NamedTuple):
    """In LVLH axes of the circular orbit; the attitude as the matrix from LVLH to body axes.

    m, m/s, rad/s (inertial rate, body axes).
    """

    position: np.ndarray
    velocity: np.ndarray
    attitude: np.ndarray
    rate: np.ndarray


def matrix(quaternion):
    """(3, 3) from LVLH to body axes."""
    return np.stack([rotate.py_func(tuple(quaternion), tuple(axis)) for axis in np.eye(3)], axis=1)


def by_kernels(craft, position, velocity, quaternion, rate, duties):
    fleet = Fleet(craft, 1, nonlinear=True)
    everyone = np.zeros(1, np.int64)
    fleet.begin(everyone, np.zeros((1, 2), np.uint64), np.zeros(1, np.uint64), fleet.plan([]))
    rows = (at.POSITION, at.VELOCITY, at.ATTITUDE, at.RATE)
    for row, values in zip(rows, (position, velocity, quaternion, rate), strict=True):
        fleet.write(row, values[np.newaxis, np.newaxis])
    for row in duties:
        fleet.write(fleet.rows.duties, row[np.newaxis, np.newaxis])
        fleet.fly()
    position, velocity, quaternion, rate = (
        fleet.read(row, size)[0, 0] for row, size in zip(rows, (3, 3, 4, 3), strict=True)
    )
    return State(position, velocity, matrix(quaternion), rate)


def by_basilisk(craft, position, velocity, quaternion, rate, duties):
    pytest.importorskip("Basilisk", reason="needs the bench extra: make bench installs it")
    from Basilisk.architecture import messaging
    from Basilisk.simulation import spacecraft, thrusterDynamicEffector
    from Basilisk.utilities import (
        RigidBodyKinematics,
        SimulationBaseClass,
        macros,
        simIncludeGravBody,
        simIncludeThruster,
    )

    mean_motion = craft.mean_motion
    spin = np.array([0.0, 0.0, mean_motion])
    centre = np.array([orbit_radius(mean_motion, craft.gravitational_parameter), 0.0, 0.0])
    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", macros.sec2nano(STEP)))
    hub = spacecraft.Spacecraft()
    hub.hub.mHub, hub.hub.IHubPntBc_B = craft.mass, [list(row) for row in craft.inertia]
    bodies = simIncludeGravBody.gravBodyFactory()
    earth = bodies.createEarth()
    earth.isCentralBody, earth.mu = True, craft.gravitational_parameter
    bodies.addBodiesTo(hub)
    # At the start the LVLH axes are the inertial ones.
    hub.hub.r_CN_NInit = (centre + position).reshape(3, 1).tolist()
    hub.hub.v_CN_NInit = (velocity + np.cross(spin, centre + position)).reshape(3, 1).tolist()
    hub.hub.sigma_BNInit = RigidBodyKinematics.C2MRP(matrix(quaternion)).reshape(3, 1).tolist()
    hub.hub.omega_BN_BInit = np.reshape(rate, (3, 1)).tolist()
    thrusters, factory = (
        thrusterDynamicEffector.ThrusterDynamicEffector(),
        simIncludeThruster.thrusterFactory(),
    )
    for thruster in craft.thrusters:
        factory.create(
            "Blank_Thruster", list(thruster.position), list(thruster.direction), MaxThrust=thruster.thrust,
            steadyIsp=1e12, useMinPulseTime=False,
        )  # fmt: skip
    factory.addToSpacecraft("thrusters", thrusters, hub)
    simulation.AddModelToTask(
        "task", hub, 2
    )  # it moves to the present, then the thrusters read their command
    simulation.AddModelToTask("task", thrusters, 1)
    command = messaging.THRArrayOnTimeCmdMsg()
    thrusters.cmdsInMsg.subscribeTo(command)
    period = craft.control_period
    for k, row in enumerate(duties):
        payload = messaging.THRArrayOnTimeCmdMsgPayload()
        payload.OnTimeRequest = np.where(row > 0.0, period * row + 0.25 * STEP, 0.0).tolist()
        command.write(payload, macros.sec2nano(period * k))
        if k == 0:
            simulation.InitializeSimulation()
        simulation.ConfigureStopTime(macros.sec2nano(period * (k + 1) - STEP))
        simulation.ExecuteSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(period * len(duties)))
    simulation.ExecuteSimulation()
    end = hub.scStateOutMsg.read()
    angle = mean_motion * craft.control_period * len(duties)
    c, s = np.cos(angle), np.sin(angle)
    lvlh = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    place = lvlh @ np.array(end.r_CN_N) - centre
    return State(
        position=place,
        velocity=lvlh @ np.array(end.v_CN_N) - np.cross(spin, centre + place),
        attitude=RigidBodyKinematics.MRP2C(np.array(end.sigma_BN)) @ lvlh.T,
        rate=np.array(end.omega_BN_B),
    )


NONE = np.zeros((PERIODS, 12))
PULSES = np.random.default_rng(0).integers(10, 90, NONE.shape) * STEP
PULSES[np.random.default_rng(1).random(NONE.shape) < 0.3] = 0.0


@pytest.mark.nightly  # which installs the extra
@pytest.mark.filterwarnings("ignore:builtin type:DeprecationWarning")  # of Basilisk's wrappers, by SWIG
@pytest.mark.parametrize(
    ("rate", "duties"),
    [
        ((0.0, 0.0, 0.0), NONE),
        ((0.1, -0.2, 0.15), NONE),
        ((0.02, 0.01, -0.03), PULSES),
        ((0.0, 0.0, 0.0), NONE + 1.0),
    ],
    ids=["free", "tumbling", "pulses", "all open"],
)
def test_basilisk_and_the_kernels_fly_alike(rate, duties):
    craft, attitude = vehicle(), np.array([0.5, 0.5, -0.5, 0.5])
    begin = np.array([10.0, -20.0, 5.0]), np.array([0.01, 0.02, -0.01]), attitude, np.array(rate)
    theirs = by_basilisk(craft, *begin, duties)
    cut = (duties > 0.0) & (duties < 1.0)
    ours = by_kernels(craft, *begin, duties + np.where(cut, STEP / 6.0, 0.0))
    # Basilisk's 64-bit metres from the Earth's centre are good to 1e-9 each, over thousands of steps. Beyond
    # that, the kernels' sub-steps are as long as their error bound lets them be: 1e-7 rad here.
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0.0, atol=2e-7)
    np.testing.assert_allclose(ours.velocity, theirs.velocity, rtol=0.0, atol=2e-8)
    np.testing.assert_allclose(ours.attitude, theirs.attitude, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(ours.rate, theirs.rate, rtol=0.0, atol=1e-8)
