"""Faults as rows of numbers, which is what compiled kernels read.

A world has for each craft a fixed number of slots; a slot is one row of `FAULT_FIELDS`, all zeros when it
is empty. The codes and columns are plain integer constants so that a kernel can use them.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults.record import KINDS, PROFILES, Fault

EMPTY = 0
(
    STUCK_OFF, STUCK_ON, LOSS, LEAK, MISALIGNMENT, LATE_OPENING, INTERMITTENT,
    PROPELLANT_LOSS, ELECTRODE_SEDIMENT, CONDUCTIVITY_LOSS, SLOW_OPENING,
) = range(1, len(KINDS) + 1)  # fmt: skip
"""Codes of the kinds."""

STEP, RAMP, SINE, SQUARE = range(len(PROFILES))
"""Codes of the profiles; `SQUARE` is the profile named "intermittent"."""

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
)
"""The columns of an encoded fault: kind code, with a minus sign as long as the thruster is on a spare branch
that is not in use; thruster index from 0; severity; onset and end in s; profile code; profile_time in s;
dwell as a share; azimuth in rad; 1 where it strikes all thrusters on the same capacitor, else 0."""

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
) = range(len(FAULT_FIELDS))
"""Indices of the columns."""


def encode(
    faults: Iterable[Fault], number_of_craft: int, number_of_thrusters: int, slots: int, *, spare: int = 0
) -> NDArray[np.float64]:
    """Rows of one world.

    Args:
        faults: In the order in which they act when several strike one thruster.
        number_of_craft: Spacecraft in the world.
        number_of_thrusters: Of each craft.
        slots: Faults that a craft can have.
        spare: Thrusters of each craft's spare branch, whose numbers go on after the others.

    Returns:
        (craft, slots, 10), columns as in `FAULT_FIELDS`; unused slots are zero. Kinds are positive, and
        indices of thrusters on a spare branch go on after the others.

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
        if fault.thruster > number_of_thrusters + spare:
            raise ValueError(
                f"fault {number} is on thruster {fault.thruster}; "
                f"a number from 1 to {number_of_thrusters + spare} would be right"
            )
        craft = fault.craft - 1
        if used[craft] == slots:
            raise ValueError(
                f"fault {number} is one too many for craft {fault.craft}; at most {slots} would be right"
            )
        rows[craft, used[craft]] = (
            KINDS.index(fault.kind) + 1,
            fault.thruster - 1,
            fault.severity,
            fault.onset,
            fault.onset + fault.duration,
            PROFILES.index(fault.profile),
            fault.profile_time,
            fault.dwell,
            fault.azimuth,
            fault.shared,
        )
        used[craft] += 1
    return rows


def decode(rows: ArrayLike) -> list[Fault]:
    """The faults of one world, or of one craft.

    Args:
        rows: (craft, slots, 10) or (slots, 10), columns as in `FAULT_FIELDS`.

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
            kind, thruster, severity, onset, end, profile, profile_time, dwell, azimuth, shared = row
            if kind == EMPTY:
                continue
            if kind not in range(1, len(KINDS) + 1) or profile not in range(len(PROFILES)):
                raise ValueError(
                    f"craft {craft}, slot {slot}: kind {kind:g} and profile {profile:g} are codes; "
                    f"0 to {len(KINDS)} and 0 to {len(PROFILES) - 1} would be right"
                )
            faults.append(
                Fault(
                    int(thruster) + 1,
                    KINDS[int(kind) - 1],
                    severity=severity,
                    onset=onset,
                    duration=end - onset,
                    profile=PROFILES[int(profile)],
                    profile_time=profile_time,
                    dwell=dwell,
                    azimuth=azimuth,
                    craft=craft,
                    shared=shared != 0.0,
                )
            )
    return faults
