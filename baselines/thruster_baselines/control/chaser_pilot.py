"""Flies the approach about Mars to capture or to a safe retreat, whatever one of its thrusters does.

Acts on observations of `MarsRendezvous-v0` with `inhibit=True` alone, for a batch of chasers. The law is
`ApproachController`'s. A detector fed by navigation alarms and names the thruster; one that can identify says
what is wrong with it. Then:

- a loss that leaves `kept_share` of the thrust or more is made good: the others and the weak one are allotted
  with the corrected effectiveness, and the detector expects that from now on;
- for everything else the isolation valve of the named thruster is closed at once. Seven thrusters push in six
  directions of one sign only, so authority is lost with it, and one period later the chaser goes over to
  branch B with all valves open and the detector begins anew;
- an alarm that names nobody within `doubt_time`, or comes closer to the target than `near`, is reason enough
  to go over;
- the approach is given up, on branch B, when there is an alarm on that branch after `settling`, when the
  chaser is about to leave its corridor, or when it is not within the tolerances of capture just before the
  target. It then flies back along-track, away from the target, until it is out of reach.

The source (Fonod et al. 2013) names the thruster and says nothing of what comes after; rules and numbers
are ours. Left out: faults of branch B, a second approach after a retreat, two faults at once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.control.approach import ApproachController, ApproachSettings
from thruster_baselines.detection.residuals import BaseNavigationDetector, FusionDetector
from thruster_envs.configuration import require
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ChaserDecision", "ChaserPilot", "RecoverySettings"]

_ANGLE, _RATE, _VELOCITY, _BOUND = 0.1, 0.02, 0.1, 5.0  # what 1 of an observation stands for; where it ends
_FACING = np.array([0.5, 0.5, 0.5, -0.5])  # attitude of the approach, body from LVLH
_OPENED = "stuck_on"  # what a detector that cannot identify looks for


@dataclass(frozen=True, kw_only=True)
class RecoverySettings:
    """When and how the pilot recovers.

    Attributes:
        kept_share: Least thrust of a weak thruster that goes on being used, as a share.
        doubt_time: From an alarm without a name to branch B, s.
        near: Distance from the target below which an alarm alone is reason to go over, m.
        settling: How long alarms on branch B are taken for the swing of a filter that has begun anew, s.
        retreat_speed: Along-track, away from the target, m/s.
        retreat_acceleration: Until then, m/s^2.
        gate: Distance before the target where the tolerances of capture have to be met, m.
        offset: Across the approach, at the gate, m.
        lateral_speed: Across the approach, at the gate, m/s.
        angle: From the attitude of the approach, at the gate, rad.
        spin: Body rate against LVLH, at the gate, rad/s.
        mouth: Half-width of the corridor at the target, m.
        widening: Tangent of the angle by which it widens.
        corridor_share: Share of the half-width from which on the approach is given up.
    """

    kept_share: float = 0.5
    doubt_time: float = 10.0
    near: float = 0.5
    settling: float = 40.0
    retreat_speed: float = 0.4
    retreat_acceleration: float = 0.02
    gate: float = 0.15
    offset: float = 0.08
    lateral_speed: float = 0.015
    angle: float = 0.044
    spin: float = 0.0075
    mouth: float = 0.25
    widening: float = 0.176
    corridor_share: float = 0.8


@dataclass(frozen=True, slots=True)
class ChaserDecision:
    """One entry of the pilot's log.

    Attributes:
        vehicle: Its index in the batch.
        time: s since the start of the episode.
        what: `alarm`, `named`, `told`, `re-allocated`, `inhibited`, `branch B` or `retreat`.
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


class ChaserPilot:
    """Approaches, diagnoses and recovers, from observations of `MarsRendezvous-v0` with `inhibit=True`.

    Args:
        spacecraft: As the flight software believes it.
        steps: Control periods of an episode: `task.steps` of the unwrapped environment.
        detector: Made for as many vehicles as there are; None for a pilot that hears of faults by `tell`.
        vehicles: How many are flown.
        distance: At the start, m, as the environment has it.
        navigation_delay: Age of an observation, periods, as the environment has it.
        approach: How to fly.
        recovery: How to recover.

    Attributes:
        log: Every decision, in order.
        statistic: (vehicles,), the detector's in its last sample.
        alarm_time: (vehicles,), s, of the first alarm of the episode; infinite without.
        name_time: (vehicles,), s, of the first name; infinite without.
        named: (vehicles,), the first thruster that was named, from 1; 0 for none.
        kind: (vehicles,), what was said to be wrong with it; empty for nothing.
        branch: (vehicles,), whether branch B is in use.
        retreating: (vehicles,), whether the approach has been given up.

    Raises:
        ValueError: A value that cannot be; the message says which and what would be right.
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        steps: int,
        detector: BaseNavigationDetector | None = None,
        *,
        vehicles: int = 1,
        distance: float = 20.0,
        navigation_delay: int = 1,
        approach: ApproachSettings | None = None,
        recovery: RecoverySettings | None = None,
    ) -> None:
        require(navigation_delay >= 1, "navigation_delay", navigation_delay, "a whole number of 1 or more")
        require(vehicles >= 1, "vehicles", vehicles, "one or more")
        self.controller = ApproachController(
            spacecraft, steps, distance=distance, navigation_delay=navigation_delay, settings=approach
        )
        self.detector = detector
        self.recovery = RecoverySettings() if recovery is None else recovery
        self.log: list[ChaserDecision] = []
        self._n, self._period = spacecraft.number_of_thrusters, spacecraft.control_period
        self._motion, self._nominal = spacecraft.mean_motion, spacecraft.effectiveness()
        self._wrenches = spacecraft.wrenches()
        n, count = self._n, vehicles
        self._vehicles = count
        self.statistic: FloatArray = np.zeros(count)
        self.alarm_time: FloatArray = np.full(count, np.inf)
        self.name_time: FloatArray = np.full(count, np.inf)
        self.named: IntArray = np.zeros(count, np.int64)
        self.kind: NDArray[np.str_] = np.full(count, "", "U16")
        self.branch: BoolArray = np.zeros(count, np.bool_)
        self.retreating: BoolArray = np.zeros(count, np.bool_)
        self._closed: BoolArray = np.zeros((count, n), np.bool_)
        self._inverse: FloatArray = np.zeros((count, n, 6))
        self._together: FloatArray = np.ones((count, n))  # open rates that do nothing together
        self._alarm: FloatArray = np.full(count, np.inf)  # of the alarm that is being looked into
        self._begin: FloatArray = np.zeros((count, 3))  # of the retreat: time, position, velocity
        self._changed: FloatArray = np.full(count, np.inf)  # when the branch was
        self._fresh: BoolArray = np.ones(count, np.bool_)  # whether the detector has only just begun
        self._due: dict[int, str] = {}  # who goes over to branch B in the next period, and why
        self._elapsed: FloatArray = np.zeros(count)
        self._commands: deque[FloatArray] = deque(maxlen=navigation_delay)
        self.reset()

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin an episode in the vehicles of a mask (vehicles,), or in all of them; the log stays."""
        mask = np.ones(self._vehicles, np.bool_) if vehicles is None else np.asarray(vehicles, np.bool_)
        self.alarm_time[mask] = self.name_time[mask] = self._alarm[mask] = np.inf
        self.named[mask], self.kind[mask] = 0, ""
        self.branch[mask] = self.retreating[mask] = False
        self._elapsed[mask], self._changed[mask] = 0.0, np.inf
        self._due = {vehicle: why for vehicle, why in self._due.items() if not mask[vehicle]}
        self._trust(mask)

    def tell(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Hear the truth about a thruster, from 1, of somebody who knows it; recovery follows at once."""
        self._note(vehicle, "told", thruster, kind, severity)
        self._recover(vehicle, thruster, kind, severity)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Actions (..., 2 n + 1), -1 to 1, for observations (..., m) of all vehicles."""
        seen = np.asarray(observation, np.float64)
        rows = seen.reshape(-1, seen.shape[-1])
        if rows.shape[0] != self._vehicles:
            raise ValueError(f"observation has {rows.shape[0]} rows; {self._vehicles} would be right")
        elapsed = self.controller.elapsed(rows)
        again = elapsed < self._elapsed
        if again.any():
            self.reset(again)
        self._elapsed = elapsed
        for vehicle, reason in self._due.items():
            self._go_over(vehicle, reason)
        self._due.clear()
        position, velocity = self.controller.position(rows), _VELOCITY * rows[:, 6:9]
        self._diagnose(rows, position, velocity)
        self._guard(rows, position, velocity)
        along, speed, acceleration = self.controller.reference(
            self._period * np.maximum(elapsed - self.controller.navigation_delay, 0.0)
        )
        if self.retreating.any():
            back = self._retreat()
            along, speed, acceleration = (
                np.where(self.retreating, theirs, ours)
                for theirs, ours in zip(back, (along, speed, acceleration), strict=True)
            )
        rates = self._open_rates(self.controller.wrench(rows, (along, speed, acceleration)))
        n = self._n
        actions = np.full((rows.shape[0], 2 * n + 1), -1.0, np.float32)
        actions[:, :n] = 2.0 * np.where(self._closed, 0.0, rates) - 1.0
        actions[:, n : 2 * n][self._closed] = 1.0
        actions[self.branch, 2 * n] = 1.0
        return actions.reshape(*seen.shape[:-1], 2 * n + 1)

    def _open_rates(self, wrench: FloatArray) -> FloatArray:
        """(vehicles, n) open rates of thrusters as they are believed to be."""
        rates = np.einsum("vij,vj->vi", self._inverse, wrench)
        idle = self.controller.settings.idle
        shift = ((idle - rates) / self._together).max(axis=1, keepdims=True)
        return np.asarray(np.clip(rates + np.maximum(shift, 0.0) * self._together, 0.0, 1.0))

    def _diagnose(self, rows: FloatArray, position: FloatArray, velocity: FloatArray) -> None:
        """Let the detector see the sample that has come, and recover where it names a thruster."""
        n, detector = self._n, self.detector
        self._commands.append(np.clip(rows[:, 16 : 16 + n], 0.0, 1.0))
        if detector is None or len(self._commands) < self.controller.navigation_delay:
            return
        if isinstance(detector, FusionDetector):
            detector.first_velocity[:] = velocity
        attitude, rate = self._turned(rows)
        # Nothing is on its way to the valves at a start and after a change of branch.
        valid = (np.abs(rows[:, 6:15]) < _BOUND).all(axis=1) & ~self._fresh
        told = np.where(self._fresh[:, np.newaxis], 0.0, self._commands[0])
        self._fresh[:] = False
        diagnosis = detector.update(told, position, attitude, rate, valid=valid)
        self.statistic = diagnosis.statistic
        time = self._period * self._elapsed
        for vehicle in np.flatnonzero(diagnosis.detected & ~self.branch & np.isinf(self._alarm)):
            self._alarm[vehicle] = time[vehicle]
            self.alarm_time[vehicle] = min(self.alarm_time[vehicle], time[vehicle])
            self._note(int(vehicle), "alarm", 0, "the statistic is above the threshold")
        fresh = (diagnosis.thruster > 0) & ~self.branch
        if fresh.any():
            self._name(np.where(fresh, diagnosis.thruster, 0))
        doubtful = diagnosis.detected & ~self.branch & ~fresh
        late = time - self._alarm >= self.recovery.doubt_time
        close = position[:, 1] > -self.recovery.near
        for vehicle in np.flatnonzero(doubtful & (late | close)):
            self._due[int(vehicle)] = "an alarm that names nobody" if late[vehicle] else "an alarm close by"
        settling = time - self._changed < self.recovery.settling
        swinging = diagnosis.detected & self.branch & settling
        if swinging.any():
            detector.believe(self._nominal, swinging)
        for vehicle in np.flatnonzero(diagnosis.detected & self.branch & ~settling & ~self.retreating):
            self._give_up(int(vehicle), "an alarm on branch B", position[vehicle, 1], velocity[vehicle, 1])

    def _name(self, thruster: IntArray) -> None:
        """Say what is wrong with the named thrusters (vehicles,), from 1, and recover."""
        kinds, sizes = [_OPENED] * self._vehicles, np.ones(self._vehicles)
        if isinstance(self.detector, FusionDetector):
            identified = self.detector.identify(thruster)
            kinds, sizes = list(identified.kind), identified.severity
        for vehicle in np.flatnonzero(thruster):
            who, kind, size = int(thruster[vehicle]), kinds[vehicle], float(sizes[vehicle])
            if self.named[vehicle] == 0:
                self.named[vehicle], self.kind[vehicle] = who, kind
                self.name_time[vehicle] = self._period * self._elapsed[vehicle]
            self._note(int(vehicle), "named", who, kind, size)
            self._recover(int(vehicle), who, kind, size)

    def _recover(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        share = 1.0 - severity
        sound = bool((self._together[vehicle] == 1.0).all())
        if kind == "loss" and share >= self.recovery.kept_share and sound and not self.branch[vehicle]:
            shares = np.ones(self._n)
            shares[thruster - 1] = share
            self._inverse[vehicle] = np.linalg.pinv(self._wrenches * shares)
            self._together[vehicle] = 1.0 / shares
            self._alarm[vehicle] = np.inf
            if self.detector is not None:
                mask = np.arange(self._vehicles) == vehicle
                self.detector.believe(self._nominal * shares, mask)
            self._note(vehicle, "re-allocated", thruster, kind, severity)
        elif not self.branch[vehicle]:
            self._closed[vehicle, thruster - 1] = True
            self._due[vehicle] = "authority is lost"
            self._note(vehicle, "inhibited", thruster, kind, severity)

    def _go_over(self, vehicle: int, reason: str) -> None:
        """To branch B, whose thrusters are trusted again."""
        mask = np.arange(self._vehicles) == vehicle
        self.branch[vehicle] = True
        self._changed[vehicle] = self._period * self._elapsed[vehicle]
        self._alarm[vehicle] = np.inf
        self._trust(mask)
        self._note(vehicle, "branch B", 0, reason)

    def _trust(self, mask: BoolArray) -> None:
        self._closed[mask] = False
        self._fresh[mask] = True
        self._inverse[mask] = self.controller.inverse
        self._together[mask] = 1.0
        if self.detector is not None:
            self.detector.reset(mask)

    def _guard(self, rows: FloatArray, position: FloatArray, velocity: FloatArray) -> None:
        """Give the approach up where it cannot end well."""
        law, ahead = self.recovery, -position[:, 1]
        offset = np.hypot(position[:, 0], position[:, 2])
        corridor = offset > law.corridor_share * (law.mouth + law.widening * np.maximum(ahead, 0.0))
        missing = (
            (offset > law.offset)
            | (np.hypot(velocity[:, 0], velocity[:, 2]) > law.lateral_speed)
            | (_ANGLE * np.linalg.norm(rows[:, 9:12], axis=1) > law.angle)
            | (_RATE * np.linalg.norm(rows[:, 12:15], axis=1) > law.spin)
        )
        for vehicle in np.flatnonzero((corridor | (missing & (ahead < law.gate))) & ~self.retreating):
            why = "near the corridor's edge" if corridor[vehicle] else "outside of the tolerances of capture"
            if not self.branch[vehicle]:
                self._due.setdefault(int(vehicle), why)
            self._give_up(int(vehicle), why, position[vehicle, 1], velocity[vehicle, 1])

    def _give_up(self, vehicle: int, reason: str, along: float, speed: float) -> None:
        self.retreating[vehicle] = True
        self._begin[vehicle] = self._elapsed[vehicle] * self._period, along, speed
        self._note(vehicle, "retreat", 0, reason)

    def _retreat(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Along-track position, velocity and acceleration (vehicles,) of a retreat since its beginning."""
        law, (start, along, speed) = self.recovery, self._begin.T
        since = self._period * self._elapsed - start
        turning = np.maximum(speed + law.retreat_speed, 0.0) / law.retreat_acceleration
        braked = np.minimum(since, turning)
        now = speed - law.retreat_acceleration * braked
        place = along + speed * braked - 0.5 * law.retreat_acceleration * braked**2 + now * (since - braked)
        return place, now, np.where(since < turning, -law.retreat_acceleration, 0.0)

    def _turned(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(vehicles, 4) attitude, body from LVLH, and (vehicles, 3) inertial body rate, rad/s."""
        vector = -0.5 * _ANGLE * rows[:, 9:12]
        a = np.sqrt(np.maximum(0.0, 1.0 - (vector**2).sum(axis=1)))
        w, x, y, z = _FACING
        b, c, d = vector.T
        q = np.stack(
            [
                a * w - b * x - c * y - d * z,
                a * x + b * w + c * z - d * y,
                a * y - b * z + c * w + d * x,
                a * z + b * y - c * x + d * w,
            ],
            axis=1,
        )
        w, x, y, z = q.T
        normal = np.stack(
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1
        )  # of the orbit, body axes
        return q, _RATE * rows[:, 12:15] + self._motion * normal

    def _note(
        self, vehicle: int, what: str, thruster: int, reason: str, severity: float = float("nan")
    ) -> None:
        time = round(self._period * float(self._elapsed[vehicle]), 6)
        self.log.append(ChaserDecision(vehicle, time, what, thruster, reason, severity))
