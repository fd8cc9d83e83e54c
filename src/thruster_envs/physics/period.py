"""One control period of a batch: commands, actuators, the motion of the bodies, measurements.

What fires the thrusters goes by what the vehicle has; each is one body of source, compiled at its first use
for blocks of 32 craft, of a few, or of one. A kernel is called as ``fly(arrays, parts, move, first, last)``
and advances the blocks ``first`` to ``last`` (exclusive) by one control period. ``arrays`` are those of a
:class:`~.vehicle.Batch`, ``parts`` what :func:`~.vehicle.pack_vehicle` gives. The duties of the period stand
in the rows ``Rows.duties`` of ``data``. ``move`` False fires the thrusters (impulse, delivered on-times)
without moving the craft or reading their sensors. Nothing outside the given blocks is read or written.
"""

from typing import Any

from thruster_envs.physics import flight, modulated_flight, pulsed_flight
from thruster_envs.physics import rows as at

_VALVES, _MODULATED = (
    {lanes: kind.compile_period(lanes) for lanes in (1, 8, at.LANES)} for kind in (flight, modulated_flight)
)
fly_pulses, fly_pulses_singly = pulsed_flight.compile_period(at.LANES), pulsed_flight.compile_period(1)


def choose_lanes(bodies: int, *, pulsed: bool) -> int:
    """How many craft make a block in a batch of ``bodies`` craft: what is quickest.

    A block of 8 takes about as long as six of one, and half as long as one of 32. There are none of 8 for
    vehicles on pulsed plasma thrusters.
    """
    return 1 if bodies < 6 else 8 if bodies <= 8 and not pulsed else at.LANES


def choose_period(lanes: int, parts: tuple[Any, ...]) -> Any:
    """The kernel for a vehicle, by what fires its thrusters."""
    _, _, _, _, _, modulator, pulses, _ = parts
    if pulses is not None:
        return fly_pulses_singly if lanes == 1 else fly_pulses
    return (_VALVES if modulator is None else _MODULATED)[lanes]
