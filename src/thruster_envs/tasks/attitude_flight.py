"""The compiled loop of a whole flight: the law commands, the formation flies, what happens is recorded."""

from thruster_envs.kernels import kernel
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import place
from thruster_envs.physics.health import pulse_shares
from thruster_envs.physics.period import fly_pulses, fly_pulses_singly
from thruster_envs.physics.sensing import apply_sensor_faults
from thruster_envs.physics.vehicle import open_vehicle
from thruster_envs.pilots.attitude import hold_attitudes, relative_motion


@kernel(nogil=True)
def fly_whole(arrays, sensor_faults, sensors_fail, parts, targets, gains, record):
    """Fly all worlds of a pulsed fleet from their start to their end under the law, and record them.

    ``record`` has the arrays to be filled, attitude, measured attitude, rate, measured rate, pulses and
    thrust, as in :class:`thruster_envs.missions.Missions`.
    """
    attitude, measured_attitude, rate, measured_rate, pulses, thrust = record
    worlds, steps, craft, n = thrust.shape
    data, vehicle = arrays[0], open_vehicle(parts)
    lanes, delivered, firing_time = data.shape[2], vehicle.rows.delivered, vehicle.pulses.firing_time
    for step in range(steps + 1):
        _record_motion(data, at.ATTITUDE, step, attitude, rate)
        _record_motion(data, at.MEASURED + 6, step, measured_attitude, measured_rate)
        if step == steps:
            break
        hold_attitudes(data, targets, 0, craft, 0, worlds, gains)
        before = data[:, at.MEASURED : at.MEASURED + 13 if sensors_fail else at.MEASURED].copy()
        if lanes == 1:
            fly_pulses_singly(arrays, parts, True, 0, data.shape[0])
        else:
            fly_pulses(arrays, parts, True, 0, data.shape[0])
        if sensors_fail:
            apply_sensor_faults(arrays, sensor_faults, parts, before, False, 0, data.shape[0])
        for world in range(worlds):
            for c in range(craft):
                b, w = place(world, c, craft, lanes)
                for axis in range(3):
                    forwards = data[b, at.DUTIES + gains.thrusters[axis, 0], w]
                    backwards = data[b, at.DUTIES + gains.thrusters[axis, 1], w]
                    pulses[world, step, c, axis] = int(forwards) - int(backwards)
                for i in range(n):
                    thrust[world, step, c, i] = data[b, delivered + i, w] / firing_time


@kernel(nogil=True)
def _record_motion(data, row, step, attitude, rate):
    for world in range(attitude.shape[0]):
        for c in range(attitude.shape[2]):
            q, w = relative_motion(data, row, world, c, attitude.shape[2])
            for k in range(4):
                attitude[world, step, c, k] = q[k]
            for k in range(3):
                rate[world, step, c, k] = w[k]


@kernel(nogil=True)
def shares_of_firings(faults, step, thruster, capacitors, period, shares):
    """What faults (slots, fields) made of the discharges at these steps, by these thrusters from 0.

    ``shares`` (firings, 3) is filled as :func:`~thruster_envs.physics.health.pulse_shares` returns it.
    """
    for k in range(step.shape[0]):
        shares[k, 0], shares[k, 1], shares[k, 2] = pulse_shares(
            faults, thruster[k], capacitors, step[k] * period
        )
