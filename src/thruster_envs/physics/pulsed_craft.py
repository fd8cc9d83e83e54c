"""What turns a craft on pulsed plasma thrusters beside its pulses, and what the kernels take of it all.

What is modelled and what is left out stands in :mod:`thruster_envs.physics.pulsed_flight`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thruster_envs.physics.plasma_pulse import PulseMap
from thruster_envs.physics.vehicle import ORBIT_TURN, Constants, Pulses
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


@dataclass(frozen=True, kw_only=True)
class PulsedFlight:
    """That thrusters fire as pulsed plasma thrusters do, and what acts on the craft beside them.

    Attributes:
        gravity_gradient: Whether the gravity gradient acts.
        bias_torque: A constant torque on every craft, N m, body axes.
        fault_bias: Torque that comes with a propellant or conductivity loss, and torque that comes with
            sediment on the electrodes, N m along the torque of the thruster: (0, 0), or
            :data:`REPORTED_FAULT_BIAS`.

    Raises:
        ValueError: Torques that are not numbers.
    """

    gravity_gradient: bool = True
    bias_torque: Vector = BIAS_TORQUE
    fault_bias: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_torques(self.bias_torque, self.fault_bias)

    def pulses_of(self, spacecraft: Spacecraft, max_substep: float | None) -> Pulses:
        """What the kernels read of a spacecraft's thrusters.

        Raises:
            ValueError: A spacecraft without a discharge, or with wheels or gyros.
        """
        discharge = discharge_of(spacecraft)
        if spacecraft.stores_momentum:
            raise ValueError(
                f"{spacecraft.name!r} must have no reaction wheels and no control-moment gyros to fly on "
                f"pulsed plasma thrusters, got {len(spacecraft.reaction_wheels)} and "
                f"{len(spacecraft.control_moment_gyros)}"
            )
        table, orbit = PulseMap.of(discharge), spacecraft.reference_orbit
        scale = orbit.mean_motion**2 if orbit.is_steady else 1.0
        longest = max_substep or min(SUBSTEP, ORBIT_TURN / orbit.fastest_rate)
        return Pulses(
            capacitors=np.array([thruster.capacitor for thruster in spacecraft.thrusters]),
            logarithms=table.logarithms,
            resistance=table.resistance,
            firing_time=discharge.firing_time,
            gradient=3.0 * scale if self.gravity_gradient else 0.0,
            bias=self.bias_torque,
            substeps=math.ceil(spacecraft.control_period / longest),
            bias_of_loss=self.fault_bias[0],
            bias_of_gain=self.fault_bias[1],
        )

    def turning(self, constants: Constants, spacecraft: Spacecraft, slots: int) -> Constants:
        """The scalars of a vehicle with what these torques can turn it by."""
        torque = math.hypot(*self.bias_torque) + slots * max(map(abs, self.fault_bias))
        return constants._replace(spin_up=torque / np.linalg.eigvalsh(np.array(spacecraft.inertia)).min())


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
