"""Flies the approach about Mars to capture or to a safe retreat, whatever one of its thrusters does.

Acts on observations of `MarsRendezvous-v0` with `inhibit=True` alone, for a batch of chasers. The law is
`ApproachController`'s. A detector fed by navigation alarms and names the thruster; one that can identify says
what is wrong with it, at once or, with `probe`, when that is clear: valves are then opened for a moment now
and then, and more often after an alarm, in groups that push and turn nowhere together (`valve_probing`), but
not where the target is near, nor with a thruster that is known to be faulty. Then:

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

A vehicle without branch B has to do with what is left (`valve_allocation`):

- a thruster that is stuck, leaks, is weak or late goes on being used as it is, as long as wrenches of every
  direction can be given, `least_authority` of each axis at the least; a slow one does no harm;
- otherwise its isolation valve is closed. The attitude is still held in full, since four of the seven turn
  the chaser every way, and whatever force is left then lies in a cone of three directions. The approach is
  given up: it flies off in the direction that is nearest to straight back, diagonally if the thruster pushed
  back, and lets itself be carried across. Nearer than `commitment` that would lead out of the corridor before
  it leads away from the target; there it goes on, unbraked, and holds across what it can;
- what is wrong is asked again some seconds after a name, and then the detector begins anew with what is
  believed. A later name has to weigh something. Once authority is lost nothing is diagnosed any more: whoever
  closed the wrong valve has lost two thrusters.

An isolation valve is closed for good. Opened and closed in every period it would make of a thruster that is
stuck open one that is on or off for a tenth of a second, but a latch valve is not made for hundreds of
strokes nor for such haste, and nothing tells whether a stroke was carried out.

The source (Fonod et al. 2013) names the thruster and says nothing of what comes after; rules and numbers
are ours. Left out: which thruster of branch B has failed, a second approach after a retreat, two faults at
once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.control.approach import AXES, ApproachController, ApproachSettings
from thruster_baselines.control.valve_allocation import ValveAllocation, authority_left
from thruster_baselines.control.valve_probing import ProbeSettings, ValveProbing
from thruster_baselines.detection.residuals import FUSION_KINDS, BaseNavigationDetector, FusionDetector
from thruster_envs.configuration import require
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ChaserDecision", "ChaserPilot", "RecoverySettings"]

_ANGLE, _RATE, _VELOCITY, _BOUND = 0.1, 0.02, 0.1, 5.0  # what 1 of an observation stands for; where it ends
_ALPHA, _BETA = 0.3, 0.05  # of the filter of the observed velocity
_OPENED = "stuck_on"  # what a detector that cannot identify looks for


@dataclass(frozen=True, kw_only=True)
class RecoverySettings:
    """When and how the pilot recovers.

    Attributes:
        kept_share: Least thrust of a weak thruster that goes on being used, as a share.
        doubt_time: From an alarm without a name to branch B, or without one to a retreat, s.
        near: Distance from the target below which an alarm alone is reason to go over, m.
        settling: How long alarms on branch B are taken for the swing of a filter that has begun anew, s.
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
        swing: How long alarms after a re-allocation are taken for the swing of a filter that has begun anew
            and learns the errors of more thrust, s.
        commitment: Distance from the target below which an approach that has lost authority goes on, m.
        mouth: Half-width of the corridor at the target, m.
        widening: Tangent of the angle by which it widens.
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
    swing: float = 8.0
    commitment: float = 2.6
    mouth: float = 0.25
    widening: float = 0.176
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


class ChaserPilot:
    """Approaches, diagnoses and recovers, from observations of `MarsRendezvous-v0` with `inhibit=True`.

    Args:
        spacecraft: As the flight software believes it: with isolation valves, and with or without a spare
            branch.
        steps: Control periods of an episode: `task.steps` of the unwrapped environment.
        detector: Made for as many vehicles as there are; None for a pilot that hears of faults by `tell`.
        vehicles: How many are flown.
        distance: At the start, m, as the environment has it.
        navigation_delay: Age of an observation, periods, as the environment has it.
        approach: How to fly.
        recovery: How to recover.
        probe: How to open valves for a moment to see what they do; None to leave that alone, and to say what
            is wrong with a thruster in the moment of its name.

    Attributes:
        log: Every decision, in order.
        statistic: (vehicles,), the detector's in its last sample.
        alarm_time: (vehicles,), s, of the first alarm of the episode; infinite without.
        name_time: (vehicles,), s, of the first name; infinite without.
        named: (vehicles,), the first thruster that was named, from 1; 0 for none.
        kind: (vehicles,), what was said to be wrong with it; empty for nothing.
        kind_time: (vehicles,), s, when that was said; infinite if it was not.
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
        probe: ProbeSettings | None = None,
    ) -> None:
        require(navigation_delay >= 1, "navigation_delay", navigation_delay, "a whole number of 1 or more")
        require(
            spacecraft.isolation_valves, "spacecraft: isolation_valves", spacecraft.isolation_valves, "True"
        )
        require(vehicles >= 1, "vehicles", vehicles, "one or more")
        self.controller = ApproachController(
            spacecraft, steps, distance=distance, navigation_delay=navigation_delay, settings=approach
        )
        self.detector = detector
        self.recovery = RecoverySettings() if recovery is None else recovery
        self.log: list[ChaserDecision] = []
        self._n, self._period = spacecraft.number_of_thrusters, spacecraft.control_period
        self._nominal, self._wrenches = spacecraft.effectiveness(), spacecraft.wrenches()
        self._push = AXES.T @ self._wrenches[:3] / spacecraft.mass  # m/s^2, LVLH
        self._spare = spacecraft.spare_branch
        self._allocation = ValveAllocation(self._wrenches)
        # Nearer than that nothing is waited for, m: without a branch to go over to, a retreat takes its time.
        self._hurry = self.recovery.near if self._spare else 2.0 * self.recovery.commitment
        self._probing = None if probe is None else ValveProbing(self._wrenches, self._period, probe)
        n, count = self._n, vehicles
        self._vehicles = count
        self.statistic: FloatArray = np.zeros(count)
        self.alarm_time: FloatArray = np.full(count, np.inf)
        self.name_time: FloatArray = np.full(count, np.inf)
        self.named: IntArray = np.zeros(count, np.int64)
        self.kind: NDArray[np.str_] = np.full(count, "", "U16")
        self.kind_time: FloatArray = np.full(count, np.inf)
        self.branch: BoolArray = np.zeros(count, np.bool_)
        self.retreating: BoolArray = np.zeros(count, np.bool_)
        self._closed: BoolArray = np.zeros((count, n), np.bool_)
        self._belief = ActuatorBelief.healthy(count, n)
        self._expected = ActuatorBelief.healthy(count, n)  # what the detector is told of
        self._blamed: IntArray = np.zeros(count, np.int64)  # the thruster that is taken for faulty, from 1
        self._settled: IntArray = np.zeros(count, np.int64)  # the same, as the detector is told
        self._reviewed: IntArray = np.zeros(count, np.int64)  # the thruster that is asked about again, from 1
        self._reviews: IntArray = np.full(count, -1)  # how often it was; -1 if it is not any more
        self._named_at: FloatArray = np.zeros(count)
        self._asked: IntArray = np.zeros(count, np.int64)  # the thruster of which it is not yet clear, from 1
        self._asked_at: FloatArray = np.full(count, np.inf)
        self._limited: BoolArray = np.zeros(count, np.bool_)  # whether authority is lost
        self._away: FloatArray = np.zeros((count, 3))  # where a retreat without authority goes, LVLH
        # What a filter that knows of the fault sees beyond the one of the observations: m, m/s, LVLH.
        self._unseen: FloatArray = np.zeros((count, 6))
        self._alarm: FloatArray = np.full(count, np.inf)  # of the alarm that is being looked into
        self._begin: FloatArray = np.zeros((count, 3))  # of the retreat: time, position, velocity
        self._changed: FloatArray = np.full(count, np.inf)  # when the branch was, or what is believed
        self._fresh: BoolArray = np.ones(count, np.bool_)  # whether the detector has only just begun
        self._due: dict[int, str] = {}  # who goes over to branch B in the next period, and why
        self._elapsed: FloatArray = np.zeros(count)
        self._commands: deque[FloatArray] = deque([np.zeros((count, n))] * navigation_delay, navigation_delay)
        self.reset()

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin an episode in the vehicles of a mask (vehicles,), or in all of them; the log stays."""
        mask = np.ones(self._vehicles, np.bool_) if vehicles is None else np.asarray(vehicles, np.bool_)
        self.alarm_time[mask] = self.name_time[mask] = self._alarm[mask] = np.inf
        self.named[mask], self.kind[mask], self.kind_time[mask] = 0, "", np.inf
        self._asked[mask] = 0
        self.branch[mask] = self.retreating[mask] = False
        self._elapsed[mask], self._changed[mask] = 0.0, np.inf
        self._due = {vehicle: why for vehicle, why in self._due.items() if not mask[vehicle]}
        for told in self._commands:
            told[mask] = 0.0
        self._trust(mask)

    def tell(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Hear the truth about a thruster, from 1, of somebody who knows it; recovery follows at once."""
        self._note(vehicle, "told", thruster, kind, severity)
        if self._spare:
            self._recover(vehicle, thruster, kind, severity)
        else:
            self._allot(vehicle, thruster, kind, severity)
            self._settle(vehicle)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Actions (..., 2 n + 1), -1 to 1, for observations (..., m) of all vehicles; 2 n with one branch."""
        seen = np.asarray(observation, np.float64)
        rows = seen.reshape(-1, seen.shape[-1]).copy()
        if rows.shape[0] != self._vehicles:
            raise ValueError(f"observation has {rows.shape[0]} rows; {self._vehicles} would be right")
        elapsed = self.controller.elapsed(rows)
        again = elapsed < self._elapsed
        if again.any():
            self.reset(again)
        self._elapsed = elapsed
        self._see_through(rows)
        position, velocity = self.controller.position(rows), _VELOCITY * rows[:, 6:9]
        for vehicle, reason in self._due.items():
            if self._spare:
                self._go_over(vehicle, reason)
            elif not self.retreating[vehicle]:
                self._give_up(vehicle, reason, position[vehicle, 1], velocity[vehicle, 1])
        self._due.clear()
        self._diagnose(rows, position, velocity)
        self._review()
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
        wanted = self.controller.acceleration(rows, (along, speed, acceleration))
        if self._limited.any():
            wanted[self._limited] = self._make_do(wanted, velocity)[self._limited]
        rates = self._probe(self._open_rates(self.controller.wrench_for(rows, wanted)), position)
        n, size = self._n, 2 * self._n + int(self._spare)
        actions = np.full((rows.shape[0], size), -1.0, np.float32)
        actions[:, :n] = 2.0 * np.where(self._closed, 0.0, rates) - 1.0
        actions[:, n : 2 * n][self._closed] = 1.0
        if self._spare:
            actions[self.branch, 2 * n] = 1.0
        return actions.reshape(*seen.shape[:-1], size)

    def _open_rates(self, wrench: FloatArray) -> FloatArray:
        """(vehicles, n) open rates of thrusters as they are believed to be."""
        belief, idle = self._belief, self.controller.settings.idle
        return belief.commands(self._allocation(wrench, belief.lower, belief.upper, idle=idle))

    def _probe(self, rates: FloatArray, position: FloatArray) -> FloatArray:
        """(vehicles, n) open rates for the same wrench, with a probe where all thrusters are trusted."""
        if self._probing is None:
            return rates
        elapsed: IntArray = self._elapsed.astype(np.int64)
        heights = self._probing.heights(
            elapsed, self._since(self._alarm), self._since(self._asked_at), self._asked
        )
        sound = ~self.branch & ~self.retreating & (self._blamed == 0) & ~self._closed.any(axis=1)
        near = np.where(np.isfinite(self._alarm), self._hurry, self.recovery.near)
        heights[~sound | (position[:, 1] > -near)] = 0.0
        return self._probing.open(rates, heights)

    def _since(self, time: FloatArray) -> IntArray:
        """(vehicles,) periods since moments, s; below 0 for those that are infinite."""
        known = np.isfinite(time)
        return np.where(
            known, np.round(self._elapsed - np.where(known, time, 0.0) / self._period), -1
        ).astype(np.int64)

    def _see_through(self, rows: FloatArray) -> None:
        """Put right the velocities of observations, whose filter expects what nominal thrusters give."""
        if not self._blamed.any():
            return
        told, period = self._commands[0], self._period
        change = period * (self._belief.delivered(told) - told) @ self._push.T
        change[self._blamed == 0] = 0.0
        place, speed = self._unseen[:, :3], self._unseen[:, 3:]
        ahead = place + period * (speed + 0.5 * change)
        self._unseen[:, :3] = (1.0 - _ALPHA) * ahead
        self._unseen[:, 3:] += change - _BETA / period * ahead
        rows[:, 6:9] += self._unseen[:, 3:] / _VELOCITY

    def _make_do(self, wanted: FloatArray, velocity: FloatArray) -> FloatArray:
        """(vehicles, 3) accelerations, m/s^2, LVLH, of who has lost authority; `wanted` for all others.

        A retreat asks for a velocity, wherever it leads. Who is too near for one asks for what the approach
        does across, and along-track for nothing as long as the speed will do.
        """
        law, gains = self.recovery, self.controller.settings
        rate = 2.0 * gains.damping * gains.translation
        back = rate * (law.retreat_speed * self._away - velocity)
        size = np.linalg.norm(back, axis=1, keepdims=True)
        back *= law.retreat_acceleration / np.maximum(size, law.retreat_acceleration)
        on = wanted.copy()
        speed = velocity[:, 1]
        on[:, 1] = rate * (np.clip(speed, 0.5 * gains.contact_speed, gains.speed) - speed)
        return np.where(self.retreating[:, np.newaxis], back, on)

    def _diagnose(self, rows: FloatArray, position: FloatArray, velocity: FloatArray) -> None:
        """Let the detector see the sample that has come, and recover where it names a thruster."""
        detector = self.detector
        self._commands.append(self.controller.open_rates_told(rows))
        if detector is None:
            return
        early = self._elapsed < self.controller.navigation_delay - 1  # what is seen is the start, again
        attitude, rate = self.controller.attitude(rows)
        # Nothing is on its way to the valves at a start and after a change of branch.
        valid = (np.abs(rows[:, 6:15]) < _BOUND).all(axis=1) & ~self._fresh
        told = np.where(self._fresh[:, np.newaxis], 0.0, self._expected.delivered(self._commands[0]))
        self._fresh &= early
        diagnosis = detector.update(told, position, attitude, rate, valid=valid)
        if early.any():
            detector.reset(early)
        self.statistic = diagnosis.statistic
        time = self._period * self._elapsed
        law = self.recovery
        since = np.where(np.isfinite(self._changed), time - self._changed, np.inf)
        swinging = diagnosis.detected & (since < np.where(self.branch, law.settling, law.swing))
        if swinging.any():
            detector.believe(self._believed(), swinging)
        detected = diagnosis.detected & ~swinging & (self._reviews < 0) & ~self._limited
        for vehicle in np.flatnonzero(detected & ~self.branch & np.isinf(self._alarm)):
            self._alarm[vehicle] = time[vehicle]
            self.alarm_time[vehicle] = min(self.alarm_time[vehicle], time[vehicle])
            self._note(int(vehicle), "alarm", 0, "the statistic is above the threshold")
        fresh = detected & (diagnosis.thruster > 0) & ~self.branch
        if fresh.any():
            self._name(np.where(fresh, diagnosis.thruster, 0), rows, position)
        doubtful = detected & ~self.branch & ~fresh
        late = time - self._alarm >= law.doubt_time
        close = (position[:, 1] > -law.near) & self._spare
        nobody = late & (self._spare | (self._blamed == 0))
        for vehicle in np.flatnonzero(doubtful & late & ~nobody):
            self._alarm[vehicle] = np.inf
            self._expect(int(vehicle))
        for vehicle in np.flatnonzero(doubtful & (nobody | close)):
            self._due[int(vehicle)] = "an alarm that names nobody" if late[vehicle] else "an alarm close by"
        for vehicle in np.flatnonzero(detected & self.branch & ~self.retreating):
            self._give_up(int(vehicle), "an alarm on branch B", position[vehicle, 1], velocity[vehicle, 1])

    def _name(self, thruster: IntArray, rows: FloatArray, position: FloatArray) -> None:
        """Say what is wrong with the named thrusters (vehicles,), from 1, once it is clear, and recover."""
        kinds, sizes = [_OPENED] * self._vehicles, np.ones(self._vehicles)
        clear = np.ones(self._vehicles, np.bool_)
        now = self._period * self._elapsed
        if isinstance(self.detector, FusionDetector):
            identified = self.detector.identify(thruster)
            kinds, sizes = list(identified.kind), identified.severity
            if self._probing is not None:
                second, first = np.sort(identified.statistic, axis=1)[:, -2:].T
                clear = self._is_clear(first - second, thruster, rows, position)
        for vehicle in np.flatnonzero(thruster):
            who, kind, size = int(thruster[vehicle]), kinds[vehicle], float(sizes[vehicle])
            if self.named[vehicle] == 0:
                self.named[vehicle], self.name_time[vehicle] = who, now[vehicle]
            if not clear[vehicle]:
                if self._asked[vehicle] != who:
                    self._asked[vehicle], self._asked_at[vehicle] = who, now[vehicle]
                    self._note(int(vehicle), "named", who, "what is wrong with it is not yet clear")
                continue
            if self.kind[vehicle] == "":
                self.kind[vehicle], self.kind_time[vehicle] = kind, now[vehicle]
            self._note(
                int(vehicle), "identified" if self._asked[vehicle] == who else "named", who, kind, size
            )
            self._asked[vehicle] = 0
            self._recover(int(vehicle), who, kind, size)

    def _is_clear(
        self, lead: FloatArray, thruster: IntArray, rows: FloatArray, position: FloatArray
    ) -> BoolArray:
        """(vehicles,) whether to say what is wrong with named thrusters: it shows, or time is up."""
        assert self._probing is not None
        law = self._probing.settings
        since = np.where(self._asked == thruster, self._period * self._elapsed - self._asked_at, 0.0)
        urgent = (-position[:, 1] < self._hurry) | self._is_aside(position, law) | _is_turned(rows, law)
        shown = (lead >= law.margin) & (since >= law.least_wait - 1e-6)
        return np.asarray(shown | urgent | (since >= law.longest_wait - 1e-6))

    def _recover(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Go on with what the thruster still does, or without it."""
        if self.branch[vehicle]:
            return
        if not self._spare:
            self._go_on_without_branch(vehicle, thruster, kind, severity)
        elif kind == "loss" and 1.0 - severity >= self.recovery.kept_share and self._blamed[vehicle] == 0:
            self._belief.blame(vehicle, thruster, kind, severity, period=self._period)
            self._blamed[vehicle] = thruster
            self._settle(vehicle)
            self._note(vehicle, "re-allocated", thruster, kind, severity)
        else:
            self._closed[vehicle, thruster - 1] = True
            self._due[vehicle] = "authority is lost"
            self._note(vehicle, "inhibited", thruster, kind, severity)

    def _go_on_without_branch(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Allocate around the fault as it looks now; what is wrong is asked again when more has been seen.

        One fault at a time is believed in: a name that comes after another one takes its place. A thruster
        with which nothing is found wrong is left alone, and watched again.
        """
        if kind == FUSION_KINDS[0]:  # nothing is found wrong with it
            self._alarm[vehicle] = np.inf
            self._expect(vehicle)
            return
        second = self._blamed[vehicle] > 0
        if not second and not self._says_nothing(kind, severity):
            self._allot(vehicle, thruster, *self._understood(vehicle, thruster, kind, severity))
        if isinstance(self.detector, FusionDetector) and not self._closed[vehicle].any():
            self._reviewed[vehicle], self._reviews[vehicle] = thruster, 0
            self._named_at[vehicle] = self._period * self._elapsed[vehicle]
        else:
            if second:
                self._allot(vehicle, thruster, *self._understood(vehicle, thruster, kind, severity))
            self._settle(vehicle)

    def _allot(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Believe in a fault; where too little authority is left, close a valve that will not close."""
        belief, idle = self._belief, self.controller.settings.idle
        self._closed[vehicle] = False  # of whoever was blamed before
        belief.blame(vehicle, thruster, kind, severity, period=self._period, idle=idle)
        self._blamed[vehicle] = thruster
        left = authority_left(self._wrenches, belief.lower[vehicle], belief.upper[vehicle])
        self._limited[vehicle] = left < self.recovery.least_authority
        self._note(vehicle, "re-allocated", thruster, kind, severity)
        if self._limited[vehicle]:
            if belief.floor[vehicle, thruster - 1] > 0.0:
                self._close(vehicle)
            self._away[vehicle] = self._way_back(vehicle)

    def _understood(self, vehicle: int, thruster: int, kind: str, severity: float) -> tuple[str, float]:
        """The fault that an answer of the detector, which was told of another belief, stands for."""
        idle = self.controller.settings.idle
        if self._settled[vehicle] == thruster:
            kind, severity = self._expected.together(vehicle, thruster, kind, severity)
        held = float(self._belief.hold[vehicle, thruster - 1])
        if kind == "leak" and held > 0.0:  # as long as it is told one and the same, a leak is a constant
            kind, severity = "stuck_on", severity + (1.0 - severity) * held
        if kind == "stuck_on" and severity < idle:
            # While commands hardly change, a constant is also a share of them, and that can be made good.
            kind, severity = "loss", 1.0 - severity / idle
        if kind == "late_opening" and severity >= self._period:
            kind = "slow_opening"  # the beginning of no pulse is as long, so that all of each comes later
        return kind, severity

    def _close(self, vehicle: int) -> None:
        """Close the valve of the thruster that is blamed, unless it is closed."""
        thruster = int(self._blamed[vehicle])
        if not self._closed[vehicle, thruster - 1]:
            self._closed[vehicle, thruster - 1] = True
            self._belief.close(vehicle, thruster)
            self._note(vehicle, "inhibited", thruster, "authority is lost")

    def _review(self) -> None:
        """Ask again what is wrong with thrusters that were named a little while ago."""
        moments = self.recovery.reviews
        since = self._period * self._elapsed - self._named_at
        due = (self._reviews >= 0) & (since >= np.array(moments)[self._reviews] - 1e-6)
        if not due.any() or not isinstance(self.detector, FusionDetector):
            return
        identified = self.detector.identify(np.where(due, self._reviewed, 0))
        for vehicle in np.flatnonzero(due):
            thruster = int(self._reviewed[vehicle])
            kind, size = identified.kind[vehicle], float(identified.severity[vehicle])
            self._reviews[vehicle] += 1
            last = self._reviews[vehicle] == len(moments)
            if self._says_nothing(kind, size):
                pass
            elif self._settled[vehicle] == 0 or (last and self._weighs(int(vehicle), thruster, kind, size)):
                self._allot(int(vehicle), thruster, *self._understood(int(vehicle), thruster, kind, size))
            if last or self._closed[vehicle].any():
                self._settle(int(vehicle))

    def _says_nothing(self, kind: str, severity: float) -> bool:
        """Whether an answer is none, or a thruster so slow that it is more likely one that is stuck."""
        return kind == FUSION_KINDS[0] or (kind == "slow_opening" and severity > self.recovery.slowest)

    def _weighs(self, vehicle: int, thruster: int, kind: str, severity: float) -> bool:
        """Whether a fault changes enough of what is expected of a thruster to be no false alarm."""
        now = float(self._expected.delivered(self._commands[0])[vehicle, thruster - 1])
        then = {
            "stuck_on": severity,
            "stuck_off": 0.0,
            "leak": max(now, severity),
            "loss": now * (1.0 - severity),
        }
        return abs(then.get(kind, now) - now) >= self.recovery.second_fault

    def _settle(self, vehicle: int) -> None:
        """Let the detector expect what is believed now; a thruster that is of no use any more is closed."""
        if self._limited[vehicle]:
            self._close(vehicle)
        self._reviews[vehicle] = -1
        self._expected.take(self._belief, vehicle)
        self._settled[vehicle] = self._blamed[vehicle]
        self._alarm[vehicle] = np.inf
        if not self._spare:
            self._changed[vehicle] = self._period * self._elapsed[vehicle]
            if self.detector is not None:
                self.detector.reset(np.arange(self._vehicles) == vehicle)
        self._expect(vehicle)

    def _expect(self, vehicle: int) -> None:
        if self.detector is not None:
            self.detector.believe(self._believed(), np.arange(self._vehicles) == vehicle)

    def _believed(self) -> FloatArray:
        """(vehicles, 6, n) effectiveness: nothing behind valves that are closed."""
        return self._nominal * ~self._closed[:, np.newaxis, :]

    def _way_back(self, vehicle: int) -> FloatArray:
        """(3,) direction, LVLH, of the force that is nearest to one straight back, without torque."""
        one = slice(vehicle, vehicle + 1)
        wrench = np.zeros((1, 6))
        wrench[0, 0] = -0.05 * float(np.abs(self._wrenches[0]).sum())
        rates = self._allocation(wrench, self._belief.lower[one], self._belief.upper[one])[0]
        push = self._push @ rates
        return np.asarray(push / max(float(np.linalg.norm(push)), np.finfo(np.float64).tiny))

    def _go_over(self, vehicle: int, reason: str) -> None:
        """To branch B, whose thrusters are trusted again."""
        mask = np.arange(self._vehicles) == vehicle
        self.branch[vehicle] = True
        self._changed[vehicle] = self._period * self._elapsed[vehicle]
        self._alarm[vehicle] = np.inf
        self._asked[vehicle] = 0
        self._trust(mask)
        self._note(vehicle, "branch B", 0, reason)

    def _trust(self, mask: BoolArray) -> None:
        self._closed[mask] = False
        self._fresh[mask] = True
        self._belief.trust(mask)
        self._expected.trust(mask)
        self._blamed[mask] = self._settled[mask] = 0
        self._reviews[mask], self._limited[mask] = -1, False
        self._unseen[mask] = 0.0
        if self.detector is not None:
            self.detector.reset(mask)

    def _is_aside(self, position: FloatArray, law: RecoverySettings | ProbeSettings) -> BoolArray:
        """(vehicles,) whether positions are beyond a share of the corridor's half-width."""
        corridor, ahead = self.recovery, np.maximum(-position[:, 1], 0.0)
        width = corridor.mouth + corridor.widening * ahead
        return np.asarray(np.hypot(position[:, 0], position[:, 2]) > law.corridor_share * width)

    def _guard(self, rows: FloatArray, position: FloatArray, velocity: FloatArray) -> None:
        """Give the approach up where it cannot end well."""
        law, ahead = self.recovery, -position[:, 1]
        corridor = self._is_aside(position, law)
        missing = (
            (np.hypot(position[:, 0], position[:, 2]) > law.offset)
            | (np.hypot(velocity[:, 0], velocity[:, 2]) > law.lateral_speed)
            | _is_turned(rows, law)
        )
        urgent = (self._reviews < 0) | (ahead < 2.0 * law.commitment)
        lost = self._limited & urgent & (ahead > law.commitment)
        for vehicle in np.flatnonzero(lost & ~self.retreating):
            if self._reviews[vehicle] >= 0:
                self._settle(int(vehicle))
            self._give_up(int(vehicle), "authority is lost", position[vehicle, 1], velocity[vehicle, 1])
        ends = (corridor | (missing & (ahead < law.gate))) & ~self._limited
        for vehicle in np.flatnonzero(ends & ~self.retreating):
            why = "near the corridor's edge" if corridor[vehicle] else "outside of the tolerances of capture"
            if self._spare and not self.branch[vehicle]:
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

    def _note(
        self, vehicle: int, what: str, thruster: int, reason: str, severity: float = float("nan")
    ) -> None:
        time = round(self._period * float(self._elapsed[vehicle]), 6)
        self.log.append(ChaserDecision(vehicle, time, what, thruster, reason, severity))


def _is_turned(rows: FloatArray, law: RecoverySettings | ProbeSettings) -> BoolArray:
    """(vehicles,) whether observations show a larger angle or body rate than is allowed."""
    angle, spin = np.linalg.norm(rows[:, 9:12], axis=1), np.linalg.norm(rows[:, 12:15], axis=1)
    return np.asarray((_ANGLE * angle > law.angle) | (_RATE * spin > law.spin))
