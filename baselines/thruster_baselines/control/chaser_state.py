"""What the pilot of the Mars chaser keeps of each vehicle: settings, phase, state and log of a recovery.

Left out: what is decided (`thruster_baselines.control.chaser_pilot`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.naming import with_old_names
from thruster_envs.protocols import BoolArray, FloatArray, IntArray

__all__ = ["ChaserDecision", "ChaserState", "RecoveryPhase", "RecoverySettings"]


@with_old_names(swing="transient", mouth="corridor_radius", widening="corridor_slope")
@dataclass(frozen=True, kw_only=True)
class RecoverySettings:
    """When and how the pilot recovers.

    Attributes:
        kept_share: Least thrust of a weak thruster that goes on being used, as a share.
        doubt_time: From an alarm without a name to branch B, or without one to a retreat, s.
        near: Distance from the target below which an alarm alone is reason to go over, m.
        settling: How long alarms on branch B are taken for the transient of a filter that has restarted, s.
        retreat_speed: Away from the target, m/s.
        retreat_acceleration: Until then, m/s^2.
        gate: Distance before the target where the tolerances of capture have to be met, m.
        offset: Across the approach, at the gate, m.
        lateral_speed: Across the approach, at the gate, m/s.
        angle: From the attitude of the approach, at the gate, rad.
        spin: Body rate against LVLH, at the gate, rad/s.
        least_authority: Share of that of each axis below which a thruster's valve is rather closed, where
            there is no branch B.
        reviews: When after a name it is asked again what is wrong with the thruster, s; the last answer is
            what the detector expects from then on.
        slowest: Time constant from which on an answer that the valve is slow is taken for none, s.
        second_fault: By how much a thruster that is named after a re-allocation has to be off what is
            expected of it, as an open rate, for the belief to change.
        transient: How long alarms after a re-allocation are taken for the transient of a filter that has
            restarted and learns the errors of more thrust, s.
        commitment: Distance from the target below which an approach that has lost authority goes on, m.
        corridor_radius: Half-width of the corridor at the target, m.
        corridor_slope: Tangent of its half-angle.
        corridor_share: Share of the half-width from which on the approach is given up.
    """

    kept_share: float = 0.5
    doubt_time: float = 10.0
    near: float = 0.5
    settling: float = 5.0
    retreat_speed: float = 0.4
    retreat_acceleration: float = 0.02
    gate: float = 0.15
    offset: float = 0.08
    lateral_speed: float = 0.015
    angle: float = 0.044
    spin: float = 0.0075
    least_authority: float = 0.045
    reviews: tuple[float, ...] = (2.0, 5.0)
    slowest: float = 1.0
    second_fault: float = 0.1
    transient: float = 8.0
    commitment: float = 2.6
    corridor_radius: float = 0.25
    corridor_slope: float = 0.176
    corridor_share: float = 0.8


@dataclass(frozen=True, slots=True)
class ChaserDecision:
    """One entry of the pilot's log.

    Attributes:
        vehicle: Its index in the batch.
        time: s since the start of the episode.
        what: `alarm`, `named`, `identified`, `told`, `re-allocated`, `inhibited`, `branch B` or `retreat`.
        thruster: Its number, from 1; 0 where none is meant.
        reason: The kind of fault, or why.
        severity: Of that kind; no number where none is believed.

    >>> print(ChaserDecision(0, 61.3, "inhibited", 4, "stuck_on"))
    61.3 s  inhibited: thruster 4, stuck_on
    """

    vehicle: int
    time: float
    what: str
    thruster: int
    reason: str
    severity: float = float("nan")

    def __str__(self) -> str:
        who = f"thruster {self.thruster}, " if self.thruster else ""
        return f"{self.time:.1f} s  {self.what}: {who}{self.reason}"


class RecoveryPhase(IntEnum):
    """How far the recovery of a vehicle has come; the latest of those that hold.

    Attributes:
        NOMINAL: All thrusters are trusted.
        ALARMED: There is an alarm, and nobody is isolated.
        QUESTIONED: A thruster is isolated, and it is not yet clear what is wrong with it.
        REVIEWED: The fault is accommodated, and what is wrong is asked again.
        ACCOMMODATED: The fault is accommodated.
        LIMITED: Authority is lost.
        REDUNDANT: The redundant branch is in use.
        RETREAT: The approach has been given up.
    """

    NOMINAL = 0
    ALARMED = 1
    QUESTIONED = 2
    REVIEWED = 3
    ACCOMMODATED = 4
    LIMITED = 5
    REDUNDANT = 6
    RETREAT = 7


@dataclass(slots=True)
class ChaserState:
    """Of each vehicle (vehicles,) unless stated; thrusters from 1, 0 for none; times, s, infinite for none.

    Attributes:
        belief: (vehicles, n), about the thrusters.
        expected: (vehicles, n), what the detector takes them to do.
        closed: (vehicles, n), whether the isolation valve is closed.
        retreat_start: (vehicles, 3), time, along-track position and velocity at the start of a retreat.
        away: (vehicles, 3), direction of a retreat without authority, LVLH.
        unseen: (vehicles, 6), m and m/s, LVLH: what a filter that knows of the fault sees beyond the one of
            the observations.
        elapsed: Periods since the start.
        alarm_time: Of the first alarm of the episode.
        name_time: Of the first isolation.
        named: The first thruster that was isolated.
        kind: What was said to be wrong with it.
        kind_time: When that was said.
        branch: Whether the redundant branch is in use.
        retreating: Whether the approach has been given up.
        limited: Whether authority is lost.
        fresh: Whether the detector has only just begun.
        alarm: Of the alarm that is being looked into.
        isolated: The thruster that is taken for faulty.
        settled: The same, as the detector is told.
        questioned: The thruster of which it is not yet clear what is wrong.
        questioned_at: Since when.
        reviewed: The thruster that is asked about again.
        reviews: How often it was; -1 if it is not any more.
        isolated_at: When it was isolated.
        changed: When the branch was, or what is believed.
        due: Who switches over to the redundant branch in the next period, and why.
    """

    belief: ActuatorBelief
    expected: ActuatorBelief
    closed: BoolArray
    retreat_start: FloatArray
    away: FloatArray
    unseen: FloatArray
    elapsed: FloatArray
    alarm_time: FloatArray
    name_time: FloatArray
    named: IntArray
    kind: NDArray[np.str_]
    kind_time: FloatArray
    branch: BoolArray
    retreating: BoolArray
    limited: BoolArray
    fresh: BoolArray
    alarm: FloatArray
    isolated: IntArray
    settled: IntArray
    questioned: IntArray
    questioned_at: FloatArray
    reviewed: IntArray
    reviews: IntArray
    isolated_at: FloatArray
    changed: FloatArray
    due: dict[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, vehicles: int, thrusters: int) -> ChaserState:
        """Before an episode, with all thrusters trusted."""

        def never() -> FloatArray:
            return np.full(vehicles, np.inf)

        def nobody() -> IntArray:
            return np.zeros(vehicles, np.int64)

        def no() -> BoolArray:
            return np.zeros(vehicles, np.bool_)

        return cls(
            ActuatorBelief.healthy(vehicles, thrusters), ActuatorBelief.healthy(vehicles, thrusters),
            np.zeros((vehicles, thrusters), np.bool_), np.zeros((vehicles, 3)), np.zeros((vehicles, 3)),
            np.zeros((vehicles, 6)), np.zeros(vehicles), never(), never(), nobody(),
            np.full(vehicles, "", "U16"), never(), no(), no(), no(), np.ones(vehicles, np.bool_), never(),
            nobody(), nobody(), nobody(), never(), nobody(), np.full(vehicles, -1), np.zeros(vehicles),
            never(),
        )  # fmt: skip

    def restart(self, mask: BoolArray) -> None:
        """To the start of an episode, in the vehicles of a mask (vehicles,)."""
        for times in (self.alarm_time, self.name_time, self.kind_time, self.alarm, self.changed):
            times[mask] = np.inf
        self.named[mask], self.kind[mask], self.questioned[mask], self.elapsed[mask] = 0, "", 0, 0.0
        self.branch[mask] = self.retreating[mask] = False
        self.due = {vehicle: why for vehicle, why in self.due.items() if not mask[vehicle]}
        self.trust(mask)

    def trust(self, mask: BoolArray) -> None:
        """All thrusters again, in the vehicles of a mask (vehicles,)."""
        self.closed[mask], self.fresh[mask] = False, True
        self.belief.trust(mask)
        self.expected.trust(mask)
        self.isolated[mask] = self.settled[mask] = 0
        self.reviews[mask], self.limited[mask], self.unseen[mask] = -1, False, 0.0

    @property
    def phase(self) -> IntArray:
        """(vehicles,), of `RecoveryPhase`."""
        phase = np.where(np.isfinite(self.alarm), RecoveryPhase.ALARMED, RecoveryPhase.NOMINAL)
        for holds, later in (
            (self.questioned > 0, RecoveryPhase.QUESTIONED),
            ((self.isolated > 0) & (self.reviews < 0), RecoveryPhase.ACCOMMODATED),
            (self.reviews >= 0, RecoveryPhase.REVIEWED),
            (self.limited, RecoveryPhase.LIMITED),
            (self.branch, RecoveryPhase.REDUNDANT),
            (self.retreating, RecoveryPhase.RETREAT),
        ):
            phase = np.where(holds, later, phase)
        return np.asarray(phase, np.int64)
