"""One control period of a batch: commands, actuators, the motion of the bodies, measurements.

What fires the thrusters goes by what the vehicle has; each is one body of source, compiled for blocks of 32
craft and of one. A kernel is called as ``fly(arrays, parts, move, first, last)`` and advances the blocks
``first`` to ``last`` (exclusive) by one control period. ``arrays`` are those of a :class:`~.vehicle.Batch`,
``parts`` what :func:`~.vehicle.pack_vehicle` gives. The duties of the period stand in the rows
``Rows.duties`` of ``data``. ``move`` False fires the thrusters (impulse, delivered on-times) without moving
the craft or reading their sensors. Nothing outside the given blocks is read or written.
"""

from typing import Any

from thruster_envs.physics import flight, modulated_flight, pulsed_flight
from thruster_envs.physics import rows as at

fly_valves, fly_valves_singly = flight.compile_period(at.LANES), flight.compile_period(1)
fly_modulated, fly_modulated_singly = (
    modulated_flight.compile_period(at.LANES),
    modulated_flight.compile_period(1),
)
fly_pulses, fly_pulses_singly = pulsed_flight.compile_period(at.LANES), pulsed_flight.compile_period(1)


def choose_period(lanes: int, *, modulated: bool, pulsed: bool) -> Any:
    """The kernel for a vehicle behind a modulator, on pulsed plasma thrusters, or on neither."""
    if modulated:
        return fly_modulated_singly if lanes == 1 else fly_modulated
    if pulsed:
        return fly_pulses_singly if lanes == 1 else fly_pulses
    return fly_valves_singly if lanes == 1 else fly_valves
