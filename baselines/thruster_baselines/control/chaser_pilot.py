"""Flies the approach about Mars to capture or to a safe retreat, whatever one of its thrusters does.

Acts on observations of `MarsRendezvous-v1` with `inhibit=True` alone, for a batch of chasers, by the law of
`ApproachController`. Each period has the same phases, one method each: begin it, carry out what is due,
detect (and isolate, identify and recover), review, guard, steer, allocate and probe, act. What is known and
believed of a vehicle is its `ChaserState`; how far its recovery has come, its `RecoveryPhase`.

A loss that leaves enough thrust is made good by allocation; for all else the isolation valve is closed and
the redundant branch taken, or, where there is none, allocation goes on around the fault as long as authority
is left. The rules and the reasons for them: docs/derivations/chaser_recovery.md. The source (Fonod et al.
2013) isolates the thruster and says nothing of what comes after; rules and numbers are ours.

Left out: which thruster of the redundant branch has failed, a second approach after a retreat, two faults at
once.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.control.approach import AXES, ApproachController, ApproachSettings
from thruster_baselines.control.chaser_state import (
    ChaserDecision,
    ChaserState,
    RecoveryPhase,
    RecoverySettings,
)
from thruster_baselines.control.observed import task_of
from thruster_baselines.control.valve_allocation import ValveAllocation, authority_left
from thruster_baselines.control.valve_probing import ProbeSettings, ValveProbing
from thruster_baselines.detection import Telemetry, Verdict
from thruster_baselines.detection.residuals import FUSION_KINDS, BaseNavigationDetector, FusionDetector
from thruster_envs.configuration import require
from thruster_envs.observations import Reader
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["ChaserDecision", "ChaserPilot", "RecoveryPhase", "RecoverySettings"]

_ALPHA, _BETA = 0.3, 0.05  # of the filter of the observed velocity
_OPENED = "stuck_on"  # what a detector that cannot identify looks for


class _Period(NamedTuple):
    """What is seen in a period: observations (vehicles, m), position and velocity (vehicles, 3), m, m/s."""

    rows: FloatArray
    position: FloatArray
    velocity: FloatArray


class ChaserPilot:
    """Approaches, diagnoses and recovers, from observations of `MarsRendezvous-v1` with `inhibit=True`.

    Args:
        spacecraft: As the flight software believes it: with isolation valves, and with or without a spare
            branch; or the environment, from which vehicle, steps, distance and delay are read.
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
        spacecraft: Spacecraft | Any,
        steps: int | None = None,
        detector: BaseNavigationDetector | None = None,
        *,
        vehicles: int | None = None,
        distance: float | None = None,
        navigation_delay: int | None = None,
        approach: ApproachSettings | None = None,
        recovery: RecoverySettings | None = None,
        probe: ProbeSettings | None = None,
    ) -> None:
        if hasattr(spacecraft, "unwrapped"):
            spacecraft, steps, vehicles, distance, navigation_delay = _read_environment(
                spacecraft, steps, vehicles, distance, navigation_delay
            )
        vehicles = 1 if vehicles is None else vehicles
        distance = 20.0 if distance is None else distance
        navigation_delay = 1 if navigation_delay is None else navigation_delay
        if steps is None:
            raise ValueError(
                "steps must be given with a spacecraft, got None; ChaserPilot.of(environment) reads them"
            )
        require(navigation_delay >= 1, "navigation_delay", navigation_delay, "a whole number of 1 or more")
        require(
            spacecraft.isolation_valves, "spacecraft: isolation_valves", spacecraft.isolation_valves, "True"
        )
        require(vehicles >= 1, "vehicles", vehicles, "one or more")
        self.controller = ApproachController(
            spacecraft, steps, distance=distance, navigation_delay=navigation_delay, settings=approach
        )
        self._reader = self.controller.reader
        self.detector = detector
        self.recovery = RecoverySettings() if recovery is None else recovery
        self.log: list[ChaserDecision] = []
        self._n, self._period = spacecraft.number_of_thrusters, spacecraft.control_period
        self._nominal, self._wrenches = spacecraft.effectiveness(), spacecraft.wrenches()
        self._push = AXES.T @ self._wrenches[:3] / spacecraft.mass  # m/s^2, LVLH
        self._spare = spacecraft.spare_branch
        minimum = np.array([one.minimum_pulse for one in spacecraft.thrusters])
        self._least = (1.0 - 1.2e-7) * minimum / self._period  # in single precision
        self._allocation = ValveAllocation(self._wrenches)
        # Nearer than that nothing is waited for, m: without a branch to go over to, a retreat takes its time.
        self._hurry = self.recovery.near if self._spare else 2.0 * self.recovery.commitment
        self._probing = None if probe is None else ValveProbing(self._wrenches, self._period, probe)
        self._vehicles = vehicles
        self.state = state = ChaserState.of(vehicles, self._n)
        self.statistic: FloatArray = np.zeros(vehicles)
        self.alarm_time, self.name_time, self.named = state.alarm_time, state.name_time, state.named
        self.kind, self.kind_time = state.kind, state.kind_time
        self.branch, self.retreating = state.branch, state.retreating
        idle = [np.zeros((vehicles, self._n))] * navigation_delay
        self._commands: deque[FloatArray] = deque(idle, navigation_delay)
        self.reset()

    @classmethod
    def of(cls, environment: Any, detector: BaseNavigationDetector | None = None, **settings: Any) -> Self:
        """The pilot for an environment: its vehicle, steps, distance, delay and number of worlds.

        Args:
            environment: `MarsRendezvous-v1` with `inhibit=True`, single or vector, wrapped or not.
            detector: For as many vehicles as there are worlds.
            settings: Of the class.

        Raises:
            ValueError: Another environment, or one that this pilot cannot fly; the message says what to set.
        """
        return cls(environment, None, detector, **settings)

    @property
    def belief(self) -> ActuatorBelief:
        """What is believed of the thrusters, (vehicles, n)."""
        return self.state.belief

    @property
    def phase(self) -> IntArray:
        """(vehicles,), of `RecoveryPhase`: how far the recovery has come."""
        return self.state.phase

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """Begin an episode in the vehicles of a mask (vehicles,), or in all of them; the log stays."""
        mask = np.ones(self._vehicles, np.bool_) if vehicles is None else np.asarray(vehicles, np.bool_)
        for told in self._commands:
            told[mask] = 0.0
        self.state.restart(mask)
        if self.detector is not None:
            self.detector.reset(mask)

    def tell(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Hear the truth about a thruster, from 1, of somebody who knows it; recovery follows at once."""
        self._note(vehicle, "told", thruster, kind, severity)
        if self._spare:
            self._recover(vehicle, thruster, kind, severity)
        else:
            self._reallocate(vehicle, thruster, kind, severity)
            self._settle(vehicle)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Actions (..., 2 n + 1), -1 to 1, for observations (..., m) of all vehicles; 2 n with one branch."""
        seen = np.asarray(observation, np.float64)
        rows = seen.reshape(-1, seen.shape[-1]).copy()
        if rows.shape[0] != self._vehicles:
            raise ValueError(f"observation has {rows.shape[0]} rows; {self._vehicles} would be right")
        period = self._begin_period(rows)
        self._carry_out_due(period)
        self._detect(period)
        self._review()
        self._guard(period)
        rates = self._probe(self._allocate(self._steer(period)), period.position)
        return self._actions(rates).reshape(*seen.shape[:-1], -1)

    def _begin_period(self, rows: FloatArray) -> _Period:
        """Phase 1: restart episodes that begin, and put velocities right."""
        elapsed = self.controller.elapsed(rows)
        again = elapsed < self.state.elapsed
        if again.any():
            self.reset(again)
        self.state.elapsed[:] = elapsed
        self._correct_velocity(rows)
        return _Period(rows, self.controller.position(rows), self._reader(rows).velocity)

    def _carry_out_due(self, period: _Period) -> None:
        """Phase 2: do what the last period decided for this one."""
        for vehicle, reason in self.state.due.items():
            if self._spare:
                self._switch_branch(vehicle, reason)
            elif not self.retreating[vehicle]:
                self._start_retreat(vehicle, reason, period)
        self.state.due.clear()

    def _steer(self, period: _Period) -> FloatArray:
        """Phase 6: (vehicles, 6) wrenches, N and N m, of the approach or of the retreat."""
        reference = self.controller.reference(
            self._period * np.maximum(self.state.elapsed - self.controller.navigation_delay, 0.0)
        )
        if self.retreating.any():
            back = self._retreat_reference()
            along, speed, acceleration = (
                np.where(self.retreating, theirs, ours) for theirs, ours in zip(back, reference, strict=True)
            )
            reference = along, speed, acceleration
        wanted = self.controller.acceleration(period.rows, reference)
        if self.state.limited.any():
            wanted[self.state.limited] = self._limited_acceleration(wanted, period.velocity)[
                self.state.limited
            ]
        return self.controller.wrench_for(period.rows, wanted)

    def _actions(self, rates: FloatArray) -> NDArray[np.float32]:
        """Phase 8: duties, isolation valves and the branch as an action."""
        n, size = self._n, 2 * self._n + int(self._spare)
        actions = np.full((self._vehicles, size), -1.0, np.float32)
        actions[:, :n] = 2.0 * np.where(self.state.closed, 0.0, rates) - 1.0
        actions[:, n : 2 * n][self.state.closed] = 1.0
        if self._spare:
            actions[self.branch, 2 * n] = 1.0
        return actions

    def _allocate(self, wrench: FloatArray) -> FloatArray:
        """Phase 7: (vehicles, n) open rates of thrusters as they are believed to be."""
        belief, idle = self.state.belief, self.controller.settings.idle
        return belief.commands(self._allocation(wrench, belief.lower, belief.upper, idle=idle))

    def _probe(self, rates: FloatArray, position: FloatArray) -> FloatArray:
        """(vehicles, n) open rates for the same wrench, with a probe where all thrusters are trusted."""
        if self._probing is None:
            return rates
        elapsed: IntArray = self.state.elapsed.astype(np.int64)
        heights = self._probing.heights(
            elapsed,
            self._since(self.state.alarm),
            self._since(self.state.questioned_at),
            self.state.questioned,
        )
        sound = ~self.branch & ~self.retreating & (self.state.isolated == 0) & ~self.state.closed.any(axis=1)
        near = np.where(np.isfinite(self.state.alarm), self._hurry, self.recovery.near)
        heights[~sound | (position[:, 1] > -near)] = 0.0
        return self._probing.open(rates, heights)

    def _since(self, time: FloatArray) -> IntArray:
        """(vehicles,) periods since moments, s; below 0 for those that are infinite."""
        known = np.isfinite(time)
        return np.where(
            known, np.round(self.state.elapsed - np.where(known, time, 0.0) / self._period), -1
        ).astype(np.int64)

    def _correct_velocity(self, rows: FloatArray) -> None:
        """Put right the velocities of observations, whose filter expects what nominal thrusters give."""
        if not self.state.isolated.any():
            return
        told, period = self._commands[0], self._period
        change = period * (self.state.belief.delivered(told) - told) @ self._push.T
        change[self.state.isolated == 0] = 0.0
        place, speed = self.state.unseen[:, :3], self.state.unseen[:, 3:]
        ahead = place + period * (speed + 0.5 * change)
        self.state.unseen[:, :3] = (1.0 - _ALPHA) * ahead
        self.state.unseen[:, 3:] += change - _BETA / period * ahead
        seen = self.state.unseen[:, 3:] / self._reader.scale("velocity")
        rows[:, self._reader.columns("velocity")] += seen

    def _limited_acceleration(self, wanted: FloatArray, velocity: FloatArray) -> FloatArray:
        """(vehicles, 3) accelerations, m/s^2, LVLH, of who has lost authority; `wanted` for all others.

        A retreat asks for a velocity, wherever it leads. Who is too near for one asks for what the approach
        does across, and along-track for nothing as long as the speed will do.
        """
        law, gains = self.recovery, self.controller.settings
        rate = 2.0 * gains.damping * gains.translation
        back = rate * (law.retreat_speed * self.state.away - velocity)
        size = np.linalg.norm(back, axis=1, keepdims=True)
        back *= law.retreat_acceleration / np.maximum(size, law.retreat_acceleration)
        on = wanted.copy()
        speed = velocity[:, 1]
        on[:, 1] = rate * (np.clip(speed, 0.5 * gains.contact_speed, gains.speed) - speed)
        return np.where(self.retreating[:, np.newaxis], back, on)

    def _detect(self, period: _Period) -> None:
        """Phase 3: feed the detector, and recover where it isolates a thruster."""
        detector, state = self.detector, self.state
        self._commands.append(self.controller.open_rates_told(period.rows))
        if detector is None:
            return
        diagnosis = self._feed(detector, period.rows)
        self.statistic = diagnosis.statistic
        time = self._period * state.elapsed
        since = np.where(np.isfinite(state.changed), time - state.changed, np.inf)
        law = self.recovery
        transient = diagnosis.detected & (since < np.where(self.branch, law.settling, law.transient))
        if transient.any():
            detector.believe(self._believed(), transient)
        detected = diagnosis.detected & ~transient & (state.reviews < 0) & ~state.limited
        for vehicle in np.flatnonzero(detected & ~self.branch & np.isinf(state.alarm)):
            state.alarm[vehicle] = time[vehicle]
            self.alarm_time[vehicle] = min(self.alarm_time[vehicle], time[vehicle])
            self._note(int(vehicle), "alarm", 0, "the statistic is above the threshold")
        isolated = detected & (diagnosis.thruster > 0) & ~self.branch
        if isolated.any():
            self._identify(np.where(isolated, diagnosis.thruster, 0), period)
        self._doubt(detected & ~self.branch & ~isolated, time, period.position)
        for vehicle in np.flatnonzero(detected & self.branch & ~self.retreating):
            self._start_retreat(int(vehicle), "an alarm on branch B", period)

    def _feed(self, detector: BaseNavigationDetector, rows: FloatArray) -> Verdict:
        """The detector's verdict on one more sample; what is seen in the first ones is the start, again."""
        state = self.state
        early = state.elapsed < self.controller.navigation_delay - 1
        attitude, rate = self.controller.attitude(rows)
        # Nothing is on its way to the valves at a start and after a change of branch.
        inside = self._reader(rows).within("velocity", "attitude_error", "rate_error").all(axis=1)
        valid = inside & ~state.fresh
        commands = np.where(self._commands[0] >= self._least, self._commands[0], 0.0)
        told = np.where(state.fresh[:, np.newaxis], 0.0, state.expected.delivered(commands))
        state.fresh &= early
        seen = Telemetry(
            self._period, duties=told, position=self.controller.position(rows), attitude=attitude, rate=rate,
            valid=valid,
        )  # fmt: skip
        verdict = detector.update(seen)
        if early.any():
            detector.reset(early)
        return verdict

    def _doubt(self, doubtful: BoolArray, time: FloatArray, position: FloatArray) -> None:
        """Go over, or drop the alarm, in vehicles (vehicles,) with an alarm that isolates nobody in time."""
        law, state = self.recovery, self.state
        late = time - state.alarm >= law.doubt_time
        close = (position[:, 1] > -law.near) & self._spare
        nobody = late & (self._spare | (state.isolated == 0))
        for vehicle in np.flatnonzero(doubtful & late & ~nobody):
            state.alarm[vehicle] = np.inf
            self._expect(int(vehicle))
        for vehicle in np.flatnonzero(doubtful & (nobody | close)):
            state.due[int(vehicle)] = "an alarm that names nobody" if late[vehicle] else "an alarm close by"

    def _identify(self, thruster: IntArray, period: _Period) -> None:
        """Say what is wrong with the named thrusters (vehicles,), from 1, once it is clear, and recover."""
        kinds, sizes = [_OPENED] * self._vehicles, np.ones(self._vehicles)
        clear = np.ones(self._vehicles, np.bool_)
        now = self._period * self.state.elapsed
        if isinstance(self.detector, FusionDetector):
            identified = self.detector.identify(thruster)
            kinds, sizes = list(identified.kind), identified.severity
            if self._probing is not None:
                second, first = np.sort(identified.statistic, axis=1)[:, -2:].T
                clear = self._is_clear(first - second, thruster, period)
        for vehicle in np.flatnonzero(thruster):
            who, kind, size = int(thruster[vehicle]), kinds[vehicle], float(sizes[vehicle])
            if self.named[vehicle] == 0:
                self.named[vehicle], self.name_time[vehicle] = who, now[vehicle]
            if not clear[vehicle]:
                if self.state.questioned[vehicle] != who:
                    self.state.questioned[vehicle], self.state.questioned_at[vehicle] = who, now[vehicle]
                    self._note(int(vehicle), "named", who, "what is wrong with it is not yet clear")
                continue
            if self.kind[vehicle] == "":
                self.kind[vehicle], self.kind_time[vehicle] = kind, now[vehicle]
            self._note(
                int(vehicle),
                "identified" if self.state.questioned[vehicle] == who else "named",
                who,
                kind,
                size,
            )
            self.state.questioned[vehicle] = 0
            self._recover(int(vehicle), who, kind, size)

    def _is_clear(self, lead: FloatArray, thruster: IntArray, period: _Period) -> BoolArray:
        """(vehicles,) whether to say what is wrong with named thrusters: it shows, or time is up."""
        assert self._probing is not None
        law = self._probing.settings
        since = np.where(
            self.state.questioned == thruster,
            self._period * self.state.elapsed - self.state.questioned_at,
            0.0,
        )
        urgent = (-period.position[:, 1] < self._hurry) | self._is_off_axis(period.position, law)
        urgent |= _is_turned(self._reader, period.rows, law)
        shown = (lead >= law.margin) & (since >= law.least_wait - 1e-6)
        return np.asarray(shown | urgent | (since >= law.longest_wait - 1e-6))

    def _recover(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Go on with what the thruster still does, or without it."""
        if self.branch[vehicle]:
            return
        if not self._spare:
            self._go_on_without_branch(vehicle, thruster, kind, severity)
        elif (
            kind == "loss"
            and 1.0 - severity >= self.recovery.kept_share
            and self.state.isolated[vehicle] == 0
        ):
            self.state.belief.blame(vehicle, thruster, kind, severity, period=self._period)
            self.state.isolated[vehicle] = thruster
            self._settle(vehicle)
            self._note(vehicle, "re-allocated", thruster, kind, severity)
        else:
            self.state.closed[vehicle, thruster - 1] = True
            self.state.due[vehicle] = "authority is lost"
            self._note(vehicle, "inhibited", thruster, kind, severity)

    def _go_on_without_branch(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Allocate around the fault as it looks now; what is wrong is asked again when more has been seen.

        One fault at a time is believed in: a name that comes after another one takes its place. A thruster
        with which nothing is found wrong is left alone, and watched again.
        """
        if kind == FUSION_KINDS[0]:  # nothing is found wrong with it
            self.state.alarm[vehicle] = np.inf
            self._expect(vehicle)
            return
        second = self.state.isolated[vehicle] > 0
        if not second and not self._is_void(kind, severity):
            self._reallocate(vehicle, thruster, *self._interpret(vehicle, thruster, kind, severity))
        if isinstance(self.detector, FusionDetector) and not self.state.closed[vehicle].any():
            self.state.reviewed[vehicle], self.state.reviews[vehicle] = thruster, 0
            self.state.isolated_at[vehicle] = self._period * self.state.elapsed[vehicle]
        else:
            if second:
                self._reallocate(vehicle, thruster, *self._interpret(vehicle, thruster, kind, severity))
            self._settle(vehicle)

    def _reallocate(self, vehicle: int, thruster: int, kind: str, severity: float) -> None:
        """Believe in a fault; where too little authority is left, close a valve that will not close."""
        belief, idle = self.state.belief, self.controller.settings.idle
        self.state.closed[vehicle] = False  # of whoever was blamed before
        belief.blame(vehicle, thruster, kind, severity, period=self._period, idle=idle)
        self.state.isolated[vehicle] = thruster
        left = authority_left(self._wrenches, belief.lower[vehicle], belief.upper[vehicle])
        self.state.limited[vehicle] = left < self.recovery.least_authority
        self._note(vehicle, "re-allocated", thruster, kind, severity)
        if self.state.limited[vehicle]:
            if belief.floor[vehicle, thruster - 1] > 0.0:
                self._close(vehicle)
            self.state.away[vehicle] = self._retreat_direction(vehicle)

    def _interpret(self, vehicle: int, thruster: int, kind: str, severity: float) -> tuple[str, float]:
        """The fault that an answer of the detector, which was told of another belief, stands for."""
        idle = self.controller.settings.idle
        if self.state.settled[vehicle] == thruster:
            kind, severity = self.state.expected.together(vehicle, thruster, kind, severity)
        held = float(self.state.belief.hold[vehicle, thruster - 1])
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
        thruster = int(self.state.isolated[vehicle])
        if not self.state.closed[vehicle, thruster - 1]:
            self.state.closed[vehicle, thruster - 1] = True
            self.state.belief.close(vehicle, thruster)
            self._note(vehicle, "inhibited", thruster, "authority is lost")

    def _review(self) -> None:
        """Phase 4: ask again what is wrong with thrusters that were isolated a little while ago."""
        moments = self.recovery.reviews
        since = self._period * self.state.elapsed - self.state.isolated_at
        due = (self.state.reviews >= 0) & (since >= np.array(moments)[self.state.reviews] - 1e-6)
        if not due.any() or not isinstance(self.detector, FusionDetector):
            return
        identified = self.detector.identify(np.where(due, self.state.reviewed, 0))
        for vehicle in np.flatnonzero(due):
            thruster = int(self.state.reviewed[vehicle])
            kind, size = identified.kind[vehicle], float(identified.severity[vehicle])
            self.state.reviews[vehicle] += 1
            last = self.state.reviews[vehicle] == len(moments)
            answer = int(vehicle), thruster, kind, size
            if not self._is_void(kind, size) and (
                self.state.settled[vehicle] == 0 or (last and self._is_significant(*answer))
            ):
                self._reallocate(int(vehicle), thruster, *self._interpret(*answer))
            if last or self.state.closed[vehicle].any():
                self._settle(int(vehicle))

    def _is_void(self, kind: str, severity: float) -> bool:
        """Whether an answer is none, or a thruster so slow that it is more likely one that is stuck."""
        return kind == FUSION_KINDS[0] or (kind == "slow_opening" and severity > self.recovery.slowest)

    def _is_significant(self, vehicle: int, thruster: int, kind: str, severity: float) -> bool:
        """Whether a fault changes enough of what is expected of a thruster to be no false alarm."""
        now = float(self.state.expected.delivered(self._commands[0])[vehicle, thruster - 1])
        then = {
            "stuck_on": severity,
            "stuck_off": 0.0,
            "leak": max(now, severity),
            "loss": now * (1.0 - severity),
        }
        return abs(then.get(kind, now) - now) >= self.recovery.second_fault

    def _settle(self, vehicle: int) -> None:
        """Let the detector expect what is believed now; a thruster that is of no use any more is closed."""
        if self.state.limited[vehicle]:
            self._close(vehicle)
        self.state.reviews[vehicle] = -1
        self.state.expected.take(self.state.belief, vehicle)
        self.state.settled[vehicle] = self.state.isolated[vehicle]
        self.state.alarm[vehicle] = np.inf
        if not self._spare:
            self.state.changed[vehicle] = self._period * self.state.elapsed[vehicle]
            if self.detector is not None:
                self.detector.reset(np.arange(self._vehicles) == vehicle)
        self._expect(vehicle)

    def _expect(self, vehicle: int) -> None:
        if self.detector is not None:
            self.detector.believe(self._believed(), np.arange(self._vehicles) == vehicle)

    def _believed(self) -> FloatArray:
        """(vehicles, 6, n) effectiveness: nothing behind valves that are closed."""
        return self._nominal * ~self.state.closed[:, np.newaxis, :]

    def _retreat_direction(self, vehicle: int) -> FloatArray:
        """(3,) direction, LVLH, of the force that is nearest to one straight back, without torque."""
        one = slice(vehicle, vehicle + 1)
        wrench = np.zeros((1, 6))
        wrench[0, 0] = -0.05 * float(np.abs(self._wrenches[0]).sum())
        rates = self._allocation(wrench, self.state.belief.lower[one], self.state.belief.upper[one])[0]
        push = self._push @ rates
        return np.asarray(push / max(float(np.linalg.norm(push)), np.finfo(np.float64).tiny))

    def _switch_branch(self, vehicle: int, reason: str) -> None:
        """To branch B, whose thrusters are trusted again."""
        mask = np.arange(self._vehicles) == vehicle
        self.branch[vehicle] = True
        self.state.changed[vehicle] = self._period * self.state.elapsed[vehicle]
        self.state.alarm[vehicle] = np.inf
        self.state.questioned[vehicle] = 0
        self.state.trust(mask)
        if self.detector is not None:
            self.detector.reset(mask)
        self._note(vehicle, "branch B", 0, reason)

    def _is_off_axis(self, position: FloatArray, law: RecoverySettings | ProbeSettings) -> BoolArray:
        """(vehicles,) whether positions are beyond a share of the corridor's half-width."""
        corridor, ahead = self.recovery, np.maximum(-position[:, 1], 0.0)
        width = corridor.corridor_radius + corridor.corridor_slope * ahead
        return np.asarray(np.hypot(position[:, 0], position[:, 2]) > law.corridor_share * width)

    def _guard(self, period: _Period) -> None:
        """Phase 5: give the approach up where it cannot end well."""
        rows, position, velocity = period
        law, ahead = self.recovery, -position[:, 1]
        corridor = self._is_off_axis(position, law)
        missing = (
            (np.hypot(position[:, 0], position[:, 2]) > law.offset)
            | (np.hypot(velocity[:, 0], velocity[:, 2]) > law.lateral_speed)
            | _is_turned(self._reader, rows, law)
        )
        urgent = (self.state.reviews < 0) | (ahead < 2.0 * law.commitment)
        lost = self.state.limited & urgent & (ahead > law.commitment)
        for vehicle in np.flatnonzero(lost & ~self.retreating):
            if self.state.reviews[vehicle] >= 0:
                self._settle(int(vehicle))
            self._start_retreat(int(vehicle), "authority is lost", period)
        ends = (corridor | (missing & (ahead < law.gate))) & ~self.state.limited
        for vehicle in np.flatnonzero(ends & ~self.retreating):
            why = "near the corridor's edge" if corridor[vehicle] else "outside of the tolerances of capture"
            if self._spare and not self.branch[vehicle]:
                self.state.due.setdefault(int(vehicle), why)
            self._start_retreat(int(vehicle), why, period)

    def _start_retreat(self, vehicle: int, reason: str, period: _Period) -> None:
        self.retreating[vehicle] = True
        along, speed = period.position[vehicle, 1], period.velocity[vehicle, 1]
        self.state.retreat_start[vehicle] = self.state.elapsed[vehicle] * self._period, along, speed
        self._note(vehicle, "retreat", 0, reason)

    def _retreat_reference(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Along-track position, velocity and acceleration (vehicles,) of a retreat since its beginning."""
        law, (start, along, speed) = self.recovery, self.state.retreat_start.T
        since = self._period * self.state.elapsed - start
        turning = np.maximum(speed + law.retreat_speed, 0.0) / law.retreat_acceleration
        braked = np.minimum(since, turning)
        now = speed - law.retreat_acceleration * braked
        place = along + speed * braked - 0.5 * law.retreat_acceleration * braked**2 + now * (since - braked)
        return place, now, np.where(since < turning, -law.retreat_acceleration, 0.0)

    def _note(
        self, vehicle: int, what: str, thruster: int, reason: str, severity: float = float("nan")
    ) -> None:
        time = round(self._period * float(self.state.elapsed[vehicle]), 6)
        self.log.append(ChaserDecision(vehicle, time, what, thruster, reason, severity))


def _read_environment(environment: Any, *given: Any) -> tuple[Any, ...]:
    """Vehicle, steps, number of vehicles, distance and navigation delay; what was given has to agree."""
    task = task_of(environment, "MarsRendezvous")
    if not task.inhibit:
        raise ValueError(
            "environment must have inhibit=True, since the pilot closes isolation valves, got inhibit=False"
        )
    require(
        task.navigation_delay >= 1, "navigation_delay of the environment", task.navigation_delay, "1 or more"
    )
    worlds = getattr(environment.unwrapped, "num_envs", 1)
    own = task.steps, worlds, task.distance, task.navigation_delay
    for name, value, its in zip(
        ("steps", "vehicles", "distance", "navigation_delay"), given, own, strict=True
    ):
        if value is not None and value != its:
            raise ValueError(f"{name} must be that of the environment, {its}, or None, got {value}")
    return task.vehicle, *own


def _is_turned(reader: Reader, rows: FloatArray, law: RecoverySettings | ProbeSettings) -> BoolArray:
    """(vehicles,) whether observations show a larger angle or body rate than is allowed."""
    angle, spin = (
        reader.scale(name) * np.linalg.norm(reader(rows).entries(name), axis=1)
        for name in ("attitude_error", "rate_error")
    )
    return np.asarray((angle > law.angle) | (spin > law.spin))
