"""A pilot that diagnoses its own thrusters: chapters 4 to 6 of Yang 2003 as one object that flies.

Each period has the same phases, one method each: observe, diagnose (test, isolate, identify, refine),
navigate, plan, command, excite. The test is `GLRDetector` with a sign gate and physically scaled noise, its
threshold that of chi-squared at a stated rate of false alarms; a thruster is isolated when it is ahead of all
others by `lead`, and identified by `ModelComparison`. The others hold against a valve that is stuck open
(`FaultAllocation`), and what is believed of a thruster is a share with a variance, which later firings
correct. Every decision is logged. Reasons: docs/derivations/classical_pilot.md.

Left out: faults that turn a thrust, faults of sensors that stay within their range, several faults that begin
in one interval.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.control.classical_state import (
    Decision,
    DiagnosisSettings,
    DiagnosisState,
    Event,
    OpenInterval,
    kind_of,
    settings_for,
)
from thruster_baselines.control.fault_allocation import FaultAllocation
from thruster_baselines.control.navigation import RelativeNavigation
from thruster_baselines.control.observed import Measured, ObservationReader, task_of
from thruster_baselines.control.quaternions import rotation_matrix, turned
from thruster_baselines.control.rendezvous import RendezvousController, RendezvousSettings
from thruster_baselines.detection.base import Interval
from thruster_baselines.detection.calibration import chi_squared_threshold
from thruster_baselines.detection.glr import GLRDetector
from thruster_baselines.detection.identification import ModelComparison
from thruster_baselines.estimation import PhysicalNoise
from thruster_baselines.guidance.hcw import transition_matrix
from thruster_baselines.mapping import AdditiveCompensationMapper, ExactCompensationMapper, LPMapper
from thruster_envs.physics.nominal_firing import Expectation
from thruster_envs.protocols import Diagnosis, FloatArray
from thruster_envs.spacecraft import Spacecraft, load

__all__ = ["ClassicalPilot", "Decision", "DiagnosisSettings", "settings_for"]


_USUAL = DiagnosisSettings()


class ClassicalPilot:
    """Acts on observations of `OrionRendezvous-v1`, one after the other, and diagnoses what it flies.

    The first observation of an episode (all of the time still to go) resets it.

    Args:
        spacecraft: What is flown, as the flight software believes it to be: description, name or path; or
            the environment, from which vehicle, steps and the box to arrive in are read.
        steps: Control periods of an episode: `task.steps` of the unwrapped environment.
        settings: Of the controller; by default for the spacecraft's period and the environment's box.
        diagnosis: How to diagnose; None for not at all (the blind pilot, which plans anew all the same).
        compensation: The mapper that makes up for the coupling loss: exactly, or by method II.

    Attributes:
        controller: Navigation, plans and commands.
        detector: The likelihood ratio test and its filter.
        belief: What is believed of the thrusters.
        log: Every decision of the episode.
        statistics: Of the likelihood ratio test, of each interval that it was asked about.
        refused: How many measurements could not be used.

    Raises:
        ValueError: Steps that cannot be, or that are not those of the episode that is flown; a compensation
            that is neither of the two classes.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> fault = {"thruster": 6, "kind": "stuck_off", "onset": 25.0}
    >>> env = gym.make("thruster_envs/OrionRendezvous-v1", faults=[fault])
    >>> pilot = ClassicalPilot("orion", env.unwrapped.task.steps)
    >>> observation, _ = env.reset(seed=0)
    >>> for _ in range(10):
    ...     observation, *_ = env.step(pilot(observation))
    >>> for decision in pilot.log:
    ...     if decision.what == "named":
    ...         print(decision)
        30.0 s  named: thruster 6, stuck_off, 0 % of its thrust, likelihood ratio 171.4
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str | Path | Any,
        steps: int | None = None,
        *,
        settings: RendezvousSettings | None = None,
        diagnosis: DiagnosisSettings | None = _USUAL,
        compensation: type[ExactCompensationMapper]
        | type[AdditiveCompensationMapper] = ExactCompensationMapper,
    ) -> None:
        if hasattr(spacecraft, "unwrapped"):
            task = task_of(spacecraft, "OrionRendezvous")
            if steps is not None and steps != task.steps:
                raise ValueError(
                    f"steps must be those of the environment, {task.steps}, or None, got {steps}"
                )
            spacecraft, steps = task.vehicle, task.steps
            usual = settings_for(
                task.vehicle, task.position_tolerance, task.velocity_tolerance, task.attitude_tolerance
            )
        else:
            spacecraft = load(spacecraft)
            usual = settings_for(spacecraft)
        if steps is None:
            raise ValueError(
                "steps must be given with a spacecraft, got None; ClassicalPilot.of(environment) reads them"
            )
        self.spacecraft, self.steps = spacecraft, steps
        settings = usual if settings is None else settings
        self.controller = RendezvousController(spacecraft, steps, settings=settings)
        self.allocation = FaultAllocation(spacecraft, compensation, settings.rotation_priority)
        self._diagnosis = diagnosis
        how = DiagnosisSettings() if diagnosis is None else diagnosis
        threshold = how.threshold
        if threshold is None:
            threshold = chi_squared_threshold(how.false_alarm_rate, tests=spacecraft.number_of_thrusters)
        strongest = np.abs(self.allocation.nominal).max(axis=1)
        self._noise = PhysicalNoise(spacecraft)
        self._sensor_noise = self._noise.sensors.copy()
        self.detector = GLRDetector(
            spacecraft,
            threshold,
            sign_gate=True,
            noise=self._noise,
            process_noise=np.square(how.drift * strongest),
            initial_covariance=np.square(how.initial_deviation * strongest),
            effective=True,
        )
        self._plain_mapper = LPMapper(spacecraft)
        self._comparison = ModelComparison(spacecraft, coupling=0.0)
        self._reader = ObservationReader(spacecraft, steps)
        self._expectation = Expectation(spacecraft)
        self.log: list[Decision] = []
        self.reset()

    @classmethod
    def of(cls, environment: Any, **settings: Any) -> Self:
        """The pilot for an environment: its vehicle, its steps, and the box to arrive in.

        Args:
            environment: `OrionRendezvous-v1`, wrapped or not.
            settings: Of the class.

        Raises:
            ValueError: Another environment.
        """
        return cls(environment, **settings)

    def reset(self) -> None:
        """Begin an episode: all thrusters are believed healthy, and the log is empty."""
        n = self.spacecraft.number_of_thrusters
        self.controller.reset()
        self.detector.reset()
        self._expectation.reset()
        self._mass_ratio = 1.0
        self.belief = ActuatorBelief.healthy(n)
        self.log = []
        self.statistics: list[float] = []
        self.refused = 0
        self._state = DiagnosisState.of(n)
        self._interval = OpenInterval.after(None, n)
        self._on_times = np.zeros(n)

    @property
    def navigation(self) -> RelativeNavigation:
        """What is believed of the motion."""
        return self.controller.navigation

    @property
    def time(self) -> float:
        """Since the start of the episode, s."""
        return self._reader.step * self.spacecraft.control_period

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Action (n,), -1 to 1, for an observation of one environment."""
        measured = self._observe(observation)
        acting = self._diagnose(measured)
        self._navigate(measured, acting)
        self._command(self._plan())
        if self._diagnosis is not None:
            self._excite(self._diagnosis)
        duties = self._on_times / self.spacecraft.control_period
        return (2.0 * duties - 1.0).astype(np.float32)

    def _observe(self, observation: ArrayLike) -> Measured | None:
        """Phase 1: the measurement, if it can be used; the first observation of an episode restarts."""
        if self._reader.begins(observation):
            self.reset()
        measured = self._reader.read(observation)
        if measured is None:
            self.refused += 1
            self._note("refused", kind=self._reader.fault)
        return measured

    def _diagnose(self, measured: Measured | None) -> FloatArray:
        """Phase 2: test the interval that has ended; on-times (n,) that are believed to have acted in it."""
        acting = self.allocation.acting(self._on_times, self.belief)
        if self._reader.step == 0:
            return acting
        firing = self._expectation.update(np.minimum(acting / self.spacecraft.control_period, 1.0))
        self._mass_ratio = float(firing.mass_ratio[0]) or 1.0
        delivered = self.allocation.delivered(self._on_times, self.belief)
        if self._expectation.carries:
            delivered, acting = firing.on_times[0], firing.open_times[0]
        self._interval.add(delivered, acting)
        if measured is None or self._diagnosis is None:
            return acting
        return self._test(measured, self._diagnosis, acting)

    def _navigate(self, measured: Measured | None, acting: FloatArray) -> None:
        """Phase 3: bring the believed motion up to date."""
        if measured is None:
            self.navigation.predict(acting)
            return
        surprises = self.navigation.surprises
        self.navigation.update(acting, measured.position, measured.velocity, measured.attitude, measured.rate)
        if self.navigation.surprises > surprises:
            self._note("started anew")
        self._interval = OpenInterval.after(measured, acting.size)

    def _command(self, command: FloatArray) -> None:
        """Phase 5: on-times for a rate change (6,), m/s then rad/s."""
        self._on_times = self.allocation(command, self.belief)
        uneven = bool((self.belief.share < 1.0).any()) and bool(command[:3].any())
        if uneven or self.belief.stuck_on.any():
            self._steady(command)

    def tell(self, belief: ActuatorBelief) -> None:
        """Take over what somebody else knows of the thrusters, from the next observation on."""
        before = self.belief
        for i in np.flatnonzero((belief.share != before.share) | (belief.stuck_on != before.stuck_on)):
            kind = kind_of(float(belief.share[i]), bool(belief.stuck_on[i]))
            self._note("told", int(i) + 1, kind, float(belief.share[i]))
        self._believe(belief)

    def _note(
        self,
        what: Event,
        thruster: int = 0,
        kind: str = "",
        level: float = math.nan,
        statistic: float = math.nan,
    ) -> None:
        """Write into the log."""
        self.log.append(Decision(self.time, what, thruster, kind, level, statistic))

    def _plan(self) -> FloatArray:
        """Phase 4: the rate change (6,) of the coming period, m/s then rad/s, after a new plan if due."""
        plans, known = self.controller.plans, self.controller.plan is not None
        command = self.controller.decide(self.time)
        if self.controller.plans > plans:
            self._note("planned", kind="due" if known else "with another belief" if plans else "at the start")
        return command

    def _steady(self, command: FloatArray) -> None:
        """Correct the on-times for how far they turn the body within the period.

        The controller takes rotation as changed at once. With thrusters of unlike strength, torques cancel
        over a period and not at each moment, and what they leave is an angle. Where that would leave the dead
        band, and always while others hold against a stuck thruster, the rate to end with is the one that
        takes the angle at the end of the period back; at the end of the flight it is none.
        """
        period, settings, stuck = (
            self.spacecraft.control_period,
            self.controller.settings,
            self.belief.stuck_on,
        )
        effect = self.allocation.effectiveness(self.belief)[3:]
        to_go, rate = self.steps - self._reader.step, self.navigation.relative_rate
        settling = to_go <= settings.settling
        band = settings.final_dead_band if settling else settings.dead_band
        back_in = _LAST_RETURN if settling else settings.return_time_burning
        wanted = command.copy()
        swing = self._swing() if stuck.any() else np.zeros(3)
        for _ in range(_STEADYING_PASSES):
            acting = self.allocation.acting(self._on_times, self.belief)
            delivered = self.allocation.delivered(self._on_times, self.belief)
            turned_by = effect @ (delivered * (period - 0.5 * acting))
            after = self.navigation.attitude_error + rate * period + turned_by
            back = np.zeros(3) if to_go <= 1 else -after / back_in - swing
            outside = np.abs(after + (rate + wanted[3:]) * settings.look_ahead) > band
            wanted[3:] = np.where(outside | stuck.any(), back - rate, command[3:])
            self._on_times = self.allocation(wanted, self.belief)

    def _swing(self) -> FloatArray:
        """(3,), rad/s: mean rate over a period in which the others only hold, begun at rest.

        A stuck valve pushes all the time and the others at the start, so that the body turns and turns back;
        a period has to begin with the opposite rate for the body to be where it was at its end.
        """
        period = self.spacecraft.control_period
        on_times = self.allocation(np.zeros(6), self.belief)
        held = self.allocation.delivered(on_times, self.belief)
        coasting = period - 0.5 * self.allocation.acting(on_times, self.belief)
        swing: FloatArray = self.allocation.effectiveness(self.belief)[3:] @ (held * coasting) / period
        return swing

    def _believe(self, belief: ActuatorBelief) -> None:
        """From now on plan, map, predict and expect with this."""
        for i in np.flatnonzero(belief.stuck_on & ~self.belief.stuck_on):
            self._note("held against", int(i) + 1, "stuck_on", float(belief.share[i]))
        self.belief = belief
        effectiveness = self.allocation.effectiveness(belief)
        n = belief.share.size
        # A stuck thruster's plan counts on three others to hold against it, as the nominal geometry needs.
        together = np.zeros(n)
        together[: min(n, _HOLDING)] = self.spacecraft.control_period
        lasting = float(self.allocation.delivered(together, ActuatorBelief.healthy(n)).max())
        self.controller.believe(effectiveness, np.where(belief.stuck_on, lasting, 0.0))
        self.detector.believe(effectiveness)

    def _test(self, measured: Measured, how: DiagnosisSettings, acting: FloatArray) -> FloatArray:
        """Test the interval; returns the on-times (n,) that are believed to have acted in its last period."""
        since = self._interval
        if since.before is None or since.periods > how.longest_gap:
            return acting
        duration = since.periods * self.spacecraft.control_period
        change, turn = self._rate_change(since.before, measured, duration)
        change[:3] *= self._mass_ratio
        push = float(
            np.linalg.norm(self.allocation.nominal[:3], axis=0) @ self._interval.fired
        )  # m/s, all directions
        self._noise.sensors = self._sensor_noise.copy()
        self._noise.sensors[:3] += np.square(push * (how.pointing[0] + how.pointing[1] * turn))
        diagnosis = self.detector.update(self._interval.fired, change, duration)
        self.statistics.append(float(diagnosis.statistic[0]))
        if diagnosis.detected[0] and self.detector.last is not None:
            # What a faulty thruster did must not teach the filter anything about those that fired with it.
            self.detector.filter.effectiveness[:] = self.detector.last.effectiveness
        self._state.heard[self._interval.fired >= _JUDGED * how.probe_pulse] = self._reader.step
        named = self._isolate(diagnosis, how)
        if named > 0:
            acting = acting.copy()
            acting[named - 1] = self._identify(named, how, acting[named - 1])
        self._refine(how, skip=named)
        return acting

    def _rate_change(self, before: Measured, now: Measured, duration: float) -> tuple[FloatArray, float]:
        """What the thrusters changed in an interval (6,), m/s then rad/s, body axes; and rad turned in it.

        Free motion is taken off. Thrust turns with the body: its mean attitude follows from the measured
        rates, those of a torque that is constant while something fires.
        """
        spacecraft = self.spacecraft
        inertia = np.array(spacecraft.inertia)
        mean_rate = 0.5 * (before.rate + now.rate)
        free = -np.linalg.solve(inertia, np.cross(mean_rate, inertia @ mean_rate))
        rotation = now.rate - before.rate - duration * free
        orbit_rate = rotation_matrix(before.attitude) @ [0.0, 0.0, spacecraft.mean_motion]
        longest = self._interval.longest if self._interval.periods == 1 else duration
        turn = (before.rate - orbit_rate) * (longest / 2.0) + rotation * (longest / 6.0)
        attitude = turned(self._attitude_before(before), turn)
        drift = transition_matrix(spacecraft.mean_motion, duration)
        expected = drift[3:] @ np.concatenate([before.position, before.velocity])
        translation = rotation_matrix(attitude) @ (now.velocity - expected)
        return np.concatenate([translation, rotation]), 2.0 * float(np.linalg.norm(turn))

    def _attitude_before(self, before: Measured) -> FloatArray:
        """At the start of the interval: the filtered one, or the measured one if navigation has moved on."""
        return self.navigation.attitude if self._interval.periods == 1 else before.attitude

    def _isolate(self, diagnosis: Diagnosis, how: DiagnosisSettings) -> int:
        """The thruster, from 1, that is ahead of all others if something is wrong; 0 otherwise.

        Evidence for thrust without command is void as soon as an interval passes without any: a valve that
        is stuck open would have shown again. Evidence for a loss stays for as long as that.
        """
        statistic, interval = float(diagnosis.statistic[0]), self.detector.last
        assert interval is not None
        if diagnosis.detected[0]:
            self._state.evidence = self._state.evidence + self._possible(diagnosis, interval)
            self._state.suspicious = (interval, diagnosis)
        elif self._state.suspicious is None or not interval.valid[0]:
            return 0
        else:
            self._state.evidence[1] = 0.0
        best = self._state.evidence.max(axis=0)
        first, second = np.argsort(best)[[-1, -2]]
        if best[first] > self.detector.threshold and best[first] - best[second] >= how.lead:
            return int(first) + 1
        if diagnosis.detected[0]:
            self._state.suspect = int(first) + 1
            self._note("suspected", self._state.suspect, statistic=statistic)
        else:
            self._state.clear()
            self._note("cleared", self._state.suspect, statistic=statistic)
        return 0

    def _possible(self, diagnosis: Diagnosis, interval: Interval) -> FloatArray:
        """(2, n): likelihood ratios that each thruster lost thrust, and that it fired without command.

        Its shortfall is kept within what it can have done: lost what it fired, or fired until the end of the
        interval.
        """
        shortfall, ratio, fired = diagnosis.shortfall[0], diagnosis.suspicion[0], interval.on_times[0]
        size = np.where(ratio > 0.0, ratio / np.where(shortfall == 0.0, 1.0, shortfall) ** 2, 0.0)
        can_be = np.clip(shortfall, fired - interval.duration, fired)
        possible = np.maximum(ratio - size * np.square(shortfall - can_be), 0.0)
        return np.stack([np.where(shortfall > 0.0, possible, 0.0), np.where(shortfall < 0.0, possible, 0.0)])

    def _identify(self, thruster: int, how: DiagnosisSettings, acted: float) -> float:
        """Correct the belief about a named thruster; returns for how long it acted in the last period, s."""
        assert self._state.suspicious is not None
        interval, diagnosis = self._state.suspicious
        self._state.clear()
        i = thruster - 1
        statistic, short = float(diagnosis.statistic[0]), float(diagnosis.shortfall[0, i])
        stuck = bool(self.belief.stuck_on[i])
        kind = self._comparison(interval, [thruster]).kind[0]
        if kind == "none":
            self._note("cleared", thruster, statistic=statistic)
            return acted
        self._state.isolated[i] = True
        if kind in ("stuck_on", "leak") and not stuck:  # how far open, later intervals will tell
            self._state.variance[i] = how.open_deviation**2
            self._change(thruster, "named", 1.0, True, statistic)
            return min(acted - short, self.spacecraft.control_period)
        share, variance = self._observed_share(i, interval)
        share = min(max(share, 0.0), 1.0)
        if stuck and share < how.dead_level:  # it was not
            self._state.isolated[i] = False
            self._change(thruster, "trusted again", 1.0, False, statistic)
            return max(acted - short, 0.0)
        sure = stuck or share < how.dead_level
        self._state.variance[i] = variance if sure else max(variance, how.first_deviation**2)
        if math.sqrt(self._state.variance[i]) > how.dead_deviation:
            share = max(share, 2.0 * how.dead_level)
        self._change(thruster, "named", self._rounded(share, how), stuck, statistic)
        return acted

    def _observed_share(self, i: int, interval: Interval) -> tuple[float, float]:
        """What thruster `i` (from 0) gave of its nominal thrust in an interval, and the variance."""
        believed = float(self.belief.share[i])
        column = interval.effectiveness[0, :, i]
        weighed = np.linalg.solve(interval.covariance[0], column)
        size = float(weighed @ column)
        more = float(weighed @ interval.residual[0]) / size  # s of firing
        fired = float(interval.on_times[0, i])
        return believed * (1.0 + more / fired), (believed / fired) ** 2 / size

    def _excite(self, how: DiagnosisSettings) -> None:
        """Phase 6: while nothing else fires, an excitation test of the thruster that was silent for longest.

        Others cancel it, so that nobody moves by that, and whoever fails to fire shows. Without it, a fault
        of a thruster that is needed for the last burn only is found when it is too late.
        """
        step, period = self._reader.step, self.spacecraft.control_period
        settling = self.steps - step <= self.controller.settings.settling
        if how.probe_pulse == 0.0 or settling or self._on_times.any() or self.belief.stuck_on.any():
            return
        if self._state.suspicious is not None:
            return
        silence = np.where(self.belief.share > 0.0, (step - self._state.heard) * period, 0.0)
        i = int(silence.argmax())
        if silence[i] < how.probe_interval:
            return
        self._state.heard[i] = step  # even if the others cannot cancel it
        others = self.allocation.effectiveness(self.belief)
        push = others[:, i] * how.probe_pulse
        others[:, i] = 0.0
        answer = self._plain_mapper(-push, effectiveness=others)
        if np.abs(answer.slack).max() <= _ROUND_OFF:
            self._on_times = answer.on_times.copy()
            self._on_times[i] = how.probe_pulse
            self._note("tested", i + 1)

    def _refine(self, how: DiagnosisSettings, skip: int) -> None:
        """Let what named thrusters gave in the last interval correct what is believed of them."""
        interval = self.detector.last
        assert interval is not None
        if not interval.valid[0]:
            return
        for i in np.flatnonzero(self._state.isolated):
            alive = self.belief.share[i] > 0.0
            if (
                i + 1 == skip
                or not alive
                or self._interval.fired[i] < _LEAST_FIRING * self.spacecraft.control_period
            ):
                continue
            seen, variance = self._observed_share(int(i), interval)
            known = self._state.variance[i] + how.drift**2
            gain = known / (known + variance)
            share = float(self.belief.share[i]) + gain * (seen - float(self.belief.share[i]))
            share = min(max(share, 0.0), 1.0)
            self._state.variance[i] = (1.0 - gain) * known
            sure = math.sqrt(self._state.variance[i]) <= how.dead_deviation
            share = self._rounded(share, how) if sure else max(share, 2.0 * how.dead_level)
            if abs(share - self.belief.share[i]) < how.refining:
                continue
            stuck = bool(self.belief.stuck_on[i])
            if (stuck and share == 0.0) or (not stuck and share == 1.0):
                self._state.isolated[i] = False
                self._change(int(i) + 1, "trusted again", 1.0, False, math.nan)
            else:
                self._change(int(i) + 1, "refined", share, stuck, math.nan)

    def _rounded(self, share: float, how: DiagnosisSettings) -> float:
        return 0.0 if share < how.dead_level else 1.0 if share > how.healthy_level else share

    def _change(self, thruster: int, what: Event, share: float, stuck_on: bool, statistic: float) -> None:
        self._note(what, thruster, kind_of(share, stuck_on), share, statistic)
        self._believe(self.belief.changed(thruster, share=share, stuck_on=stuck_on))


_HOLDING = 4  # thrusters open at once while others hold against one that is stuck on
_STEADYING_PASSES = 2
_LAST_RETURN = 8.0  # s: in which an angle is taken back while settling
_JUDGED = 0.5  # of a probe's length, loss taken off: a firing as long as that says as much
_ROUND_OFF = 1e-9  # m/s, rad/s
_LEAST_FIRING = 0.1  # of a period: shorter firings say too little of a share
