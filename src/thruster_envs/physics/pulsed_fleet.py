"""A batch of worlds whose craft turn by pulsed plasma thrusters: the fleet, with another flight.

Arrays, faults, streams, threads and calls are those of :class:`~thruster_envs.physics.fleet.Fleet`; what is
modelled and what is left out stands in :mod:`thruster_envs.physics.pulsed_flight`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from thruster_envs.faults import DISCHARGE_KINDS, THRUSTER_KINDS
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.period import choose_period
from thruster_envs.physics.plasma_pulse import PulseMap
from thruster_envs.physics.vehicle import Pulses, pack_pulses, pack_vehicle, scalar_constants
from thruster_envs.spacecraft import Discharge, Spacecraft
from thruster_envs.spacecraft.description import LARGEST, Vector

#: N m, body axes: what the imbalance of the pulses of a healthy craft in Valdes 2008, Table 5.VII, asks for.
BIAS_TORQUE = (1.3e-10, -2.7e-10, 5.1e-10)

#: N m along the torque of a thruster that has lost thrust, and of one that has gained some. The pulse counts
#: of Valdes 2008, Tables 5.VIII to 5.X, only add up with such torques beside the faults themselves.
REPORTED_FAULT_BIAS = (-6e-8, 1e-8)

#: The sensors: there is no translation to be measured.
MEASURED = ("attitude", "rate")

#: Longest integration sub-step unless another is asked for, s.
SUBSTEP = 1.0


class PulsedFleet(Fleet):
    """Craft of one kind, on pulsed plasma thrusters, in many worlds.

    Args:
        spacecraft: What every craft is, nominally; it must have a discharge.
        worlds: Number of worlds.
        craft: Number of craft in each world.
        slots: Faults that one craft can have at once.
        gravity_gradient: Whether the gravity gradient acts.
        bias_torque: A constant torque on every craft, N m, body axes.
        fault_bias: Torque that comes with a propellant or conductivity loss, and torque that comes with
            sediment on the electrodes, N m along the torque of the thruster: (0, 0), or
            :data:`REPORTED_FAULT_BIAS`.
        max_substep: Longest integration sub-step, s; None for 1 s.
        threads: Threads that share a period's work; None takes one below 1,024 craft and one per core above.
            Results do not depend on it.

    Raises:
        ValueError: A spacecraft without a discharge, or torques that are not numbers.
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        worlds: int,
        craft: int = 1,
        *,
        slots: int = 4,
        gravity_gradient: bool = True,
        bias_torque: Vector = BIAS_TORQUE,
        fault_bias: tuple[float, float] = (0.0, 0.0),
        max_substep: float | None = None,
        threads: int | None = None,
    ) -> None:
        discharge = discharge_of(spacecraft)
        check_torques(bias_torque, fault_bias)
        super().__init__(
            spacecraft, worlds, craft, slots=slots, max_substep=max_substep, threads=threads,
            kinds=THRUSTER_KINDS + DISCHARGE_KINDS, sensors=MEASURED,
        )  # fmt: skip
        torque = math.hypot(*bias_torque) + slots * max(map(abs, fault_bias))
        constants = scalar_constants(spacecraft, max_substep)._replace(
            spin_up=torque / np.linalg.eigvalsh(np.array(spacecraft.inertia)).min()
        )
        table = PulseMap.of(discharge)
        #: (n,), number of the capacitor of each thruster.
        self.capacitors = np.array([thruster.capacitor for thruster in spacecraft.thrusters])
        pulses = Pulses(
            capacitors=self.capacitors,
            logarithms=table.logarithms,
            resistance=table.resistance,
            firing_time=discharge.firing_time,
            gradient=3.0 * spacecraft.mean_motion**2 if gravity_gradient else 0.0,
            bias=bias_torque,
            substeps=math.ceil(spacecraft.control_period / (max_substep or SUBSTEP)),
            bias_of_loss=fault_bias[0],
            bias_of_gain=fault_bias[1],
        )
        self.vehicle = pack_vehicle(
            spacecraft, constants, slots=slots, nonlinear=False, max_substep=max_substep,
            pulses=pack_pulses(pulses),
        )  # fmt: skip
        self._kernel = choose_period(self.lanes, modulated=False, pulsed=True)


def check_torques(bias_torque: Sequence[float], fault_bias: Sequence[float]) -> None:
    """Refuse torques beside the pulses that are not numbers, or not as many as they should be.

    Raises:
        ValueError: One line names them.
    """
    for name, values, count in (("bias_torque", bias_torque, 3), ("fault_bias", fault_bias, 2)):
        if len(values) != count or not all(map(math.isfinite, values)):
            raise ValueError(f"{name} is {values}; {count} finite numbers of N m would be right")
        if any(abs(value) > LARGEST for value in values):
            raise ValueError(f"{name} must be at most {LARGEST:g} N m, got {values}")


def discharge_of(spacecraft: Spacecraft) -> Discharge:
    """The discharge of a spacecraft on pulsed plasma thrusters.

    Raises:
        ValueError: It has none.
    """
    if spacecraft.discharge is None:
        raise ValueError(
            f"{spacecraft.name!r} has no discharge; a spacecraft on pulsed plasma thrusters, such as "
            "'ppt_cubesat', would be right"
        )
    return spacecraft.discharge
