"""Faults as rows of numbers, which is what compiled kernels read.

A world has for each craft a fixed number of slots; a slot is one row of `FAULT_FIELDS`, all zeros when it
is empty. The codes and columns are plain integer constants so that a kernel can use them.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults.kinds import (
    CODES,
    GYRO_KINDS,
    KINDS,
    SENSOR_CODES,
    SENSOR_KINDS,
    SENSORS,
    WHEEL_KINDS,
)
from thruster_envs.faults.record import PROFILES, Fault

EMPTY = 0
(
    STUCK_OFF, STUCK_ON, LOSS, LEAK, MISALIGNMENT, LATE_OPENING, INTERMITTENT,
    PROPELLANT_LOSS, ELECTRODE_SEDIMENT, CONDUCTIVITY_LOSS, SLOW_OPENING, SIGN, BIAS,
    WHEEL_TORQUE_LOSS, WHEEL_STUCK, WHEEL_FRICTION, WHEEL_SPEED_LIMIT, GIMBAL_RATE_LOSS, GIMBAL_LOCK,
) = (
    CODES[name] for name in (
        "stuck_off", "stuck_on", "loss", "leak", "misalignment", "late_opening", "intermittent",
        "propellant_loss", "electrode_sediment", "conductivity_loss", "slow_opening", "sign", "bias",
        "wheel_torque_loss", "wheel_stuck", "wheel_friction", "wheel_speed_limit", "gimbal_rate_loss",
        "gimbal_lock",
    )
)  # fmt: skip
"""Codes of the kinds of actuators; those from `WHEEL_TORQUE_LOSS` on are of wheels and gyros."""

SENSOR_BIAS, SENSOR_DRIFT, SENSOR_SCALE, SENSOR_FREEZE, SENSOR_SPIKE, SENSOR_DROP_OUT = (
    SENSOR_CODES[name] for name in ("bias", "drift", "scale", "freeze", "spike", "drop_out")
)
"""Codes of the kinds of sensors."""

POSITION, VELOCITY, ATTITUDE, RATE = (
    SENSORS.index(name) + 1 for name in ("position", "velocity", "attitude", "rate")
)
"""Codes of the sensors."""

STEP, RAMP, SINE, SQUARE = range(len(PROFILES))
"""Codes of the profiles; `SQUARE` is the profile named "intermittent"."""

IN_USE, REDUNDANT = 0, 1
"""Codes of the branches: that in use, and one that is not."""

FAULT_FIELDS = (
    "kind",
    "thruster",
    "severity",
    "onset",
    "end",
    "profile",
    "profile_time",
    "dwell",
    "azimuth",
    "shared",
    "branch",
    "sensor",
    "axis",
)
"""The columns of an encoded fault: kind code, of an actuator or, where the sensor is not 0, of a sensor;
thruster index from 0 within its branch, or that of a wheel or gyro, -1 where a sensor fails; severity;
onset and end in s; profile code;
profile_time in s; dwell as a share; azimuth in rad; 1 where it strikes all thrusters on the same capacitor,
else 0; 0 on the branch in use, 1 on the redundant one, where it does not act; code of the sensor from 1, 0
for a fault of a thruster; axis from 1, 0 for all three."""

(
    FIELD_KIND,
    FIELD_THRUSTER,
    FIELD_SEVERITY,
    FIELD_ONSET,
    FIELD_END,
    FIELD_PROFILE,
    FIELD_PROFILE_TIME,
    FIELD_DWELL,
    FIELD_AZIMUTH,
    FIELD_SHARED,
    FIELD_BRANCH,
    FIELD_SENSOR,
    FIELD_AXIS,
) = range(len(FAULT_FIELDS))
"""Indices of the columns."""


def encode(
    faults: Iterable[Fault],
    number_of_craft: int,
    number_of_thrusters: int,
    slots: int,
    *,
    spare: int = 0,
    wheels: int = 0,
    gyros: int = 0,
) -> NDArray[np.float64]:
    """Rows of one world.

    Args:
        faults: In the order in which they act when several strike one thruster.
        number_of_craft: Spacecraft in the world.
        number_of_thrusters: Of each craft.
        slots: Faults that a craft can have.
        spare: Thrusters of each craft's redundant branch, whose numbers go on after the others.
        wheels: Reaction wheels of each craft.
        gyros: Control-moment gyros of each craft.

    Returns:
        (craft, slots, 13), columns as in `FAULT_FIELDS`; unused slots are zero.

    Raises:
        ValueError: A craft or thruster that does not exist, or more faults on a craft than it has slots.

    >>> encode([Fault(3, "loss", severity=0.5, onset=10.0)], 1, 12, slots=1)[0, 0, :4]
    array([ 3. ,  2. ,  0.5, 10. ])
    """
    rows = np.zeros((number_of_craft, slots, len(FAULT_FIELDS)))
    used = [0] * number_of_craft
    for number, fault in enumerate(faults, start=1):
        if fault.craft > number_of_craft:
            raise ValueError(
                f"fault {number} is on craft {fault.craft}; "
                f"a number from 1 to {number_of_craft} would be right"
            )
        storing = fault.sensor is None and fault.kind in WHEEL_KINDS + GYRO_KINDS
        if storing:
            what, most = ("wheel", wheels) if fault.kind in WHEEL_KINDS else ("gyro", gyros)
            if fault.thruster > most:
                right = f"its number must be from 1 to {most}" if most else f"the spacecraft has no {what}"
                raise ValueError(f"fault {number} is on {what} {fault.thruster}; {right}")
        elif fault.thruster > number_of_thrusters + spare:
            raise ValueError(
                f"fault {number} is on thruster {fault.thruster}; "
                f"a number from 1 to {number_of_thrusters + spare} would be right"
            )
        craft = fault.craft - 1
        if used[craft] == slots:
            raise ValueError(
                f"fault {number} is one too many for craft {fault.craft}; at most {slots} would be right"
            )
        redundant = not storing and fault.thruster > number_of_thrusters
        kinds = KINDS if fault.sensor is None else SENSOR_KINDS
        rows[craft, used[craft]] = (
            kinds.index(fault.kind) + 1,
            fault.thruster - 1 - (number_of_thrusters if redundant else 0),
            fault.severity,
            fault.onset,
            fault.onset + fault.duration,
            PROFILES.index(fault.profile),
            fault.profile_time,
            fault.dwell,
            fault.azimuth,
            fault.shared,
            REDUNDANT if redundant else IN_USE,
            0 if fault.sensor is None else SENSORS.index(fault.sensor) + 1,
            fault.axis,
        )
        used[craft] += 1
    return rows


def decode(rows: ArrayLike, number_of_thrusters: int | None = None) -> list[Fault]:
    """The faults of one world, or of one craft.

    Args:
        rows: (craft, slots, 13) or (slots, 13), columns as in `FAULT_FIELDS`.
        number_of_thrusters: Of each craft; needed where one is on a redundant branch.

    Returns:
        The faults in the order craft, slot. A finite duration is `end - onset`, which may differ from the
        one that was encoded by rounding.

    Raises:
        ValueError: Rows of another shape, or that hold no fault that there can be.
    """
    table = np.asarray(rows, dtype=np.float64)
    if table.ndim not in (2, 3) or table.shape[-1] != len(FAULT_FIELDS):
        raise ValueError(
            f"rows have the shape {table.shape}; (craft, slots, {len(FAULT_FIELDS)}) "
            f"or (slots, {len(FAULT_FIELDS)}) would be right"
        )
    craft_rows = table if table.ndim == 3 else table[np.newaxis]
    faults = []
    for craft, slots in enumerate(craft_rows, start=1):
        for slot, row in enumerate(slots.tolist(), start=1):
            fault = dict(zip(FAULT_FIELDS, row, strict=True))
            kind, profile, sensor, branch = (fault[one] for one in ("kind", "profile", "sensor", "branch"))
            if kind == EMPTY:
                continue
            kinds = KINDS if sensor == 0 else SENSOR_KINDS
            for name, value, lowest, most in (
                ("sensor", sensor, 0, len(SENSORS)), ("kind", kind, 1, len(kinds)),
                ("profile", profile, 0, len(PROFILES) - 1), ("branch", branch, IN_USE, REDUNDANT),
            ):  # fmt: skip
                if value not in range(lowest, most + 1):
                    raise ValueError(
                        f"craft {craft}, slot {slot}: {name} {value:g} is no code; it must be from {lowest} "
                        f"to {most}"
                    )
            if branch == REDUNDANT and number_of_thrusters is None:
                raise ValueError(
                    f"craft {craft}, slot {slot} is on the redundant branch; "
                    "number_of_thrusters must be given"
                )
            beyond = number_of_thrusters or 0 if branch == REDUNDANT else 0
            faults.append(
                Fault(
                    int(fault["thruster"]) + 1 + beyond,
                    kinds[int(kind) - 1],
                    severity=fault["severity"],
                    onset=fault["onset"],
                    duration=fault["end"] - fault["onset"],
                    profile=PROFILES[int(profile)],
                    profile_time=fault["profile_time"],
                    dwell=fault["dwell"],
                    azimuth=fault["azimuth"],
                    craft=craft,
                    shared=fault["shared"] != 0.0,
                    sensor=None if sensor == 0 else SENSORS[int(sensor) - 1],
                    axis=int(fault["axis"]),
                )
            )
    return faults
