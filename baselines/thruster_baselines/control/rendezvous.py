"""A controller that flies a rendezvous in six degrees of freedom: plan, hold attitude, map.

Every period it takes in the noisy measurement (a Kalman filter), plans the remaining translation anew where
that is due (`RendezvousPlanner`, the linear program over all remaining periods), decides which rate change
would keep the body on LVLH, and maps both together to on-times with the LP mapper, inflated for the feed
coupling. What it decides (`command`) and how it maps (`allocate`) can be used apart: with another mapper in
the loop, it has to be told what that one commanded.

Attitude is kept within a dead band: the rate is corrected only where the angle, a little ahead in time,
would leave it. Inside, nothing fires, since measured angles are mostly noise. Burns disturb the attitude
through their scatter, so the plan ends a few periods early and leaves time to settle.

What it knows of faults is what it is told (`believe`). Told nothing, it still re-plans from where the craft
truly is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.control.navigation import RelativeNavigation
from thruster_baselines.control.quaternions import rotation_matrix
from thruster_baselines.guidance.rendezvous import RendezvousPlan, RendezvousPlanner
from thruster_baselines.mapping import LPMapper
from thruster_baselines.mapping.coupling import commanded_on_times
from thruster_envs.configuration import require
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["RendezvousController", "RendezvousSettings"]

_STILL = 1e-9  # m/s in a period: what a plan is off by when its thrusters hold against one that is stuck on


@dataclass(frozen=True, kw_only=True)
class RendezvousSettings:
    """How the rendezvous controller behaves; the defaults were tuned on Orion.

    Attributes:
        planned_share: Longest planned on-time, as a share of the period; the rest is for coupling and
            attitude.
        planned_thrusters: Sum of all planned on-times of a period, in units of the longest single one.
        position_tolerance: Half-width, per axis, of the box to end in, m.
        velocity_tolerance: The same for velocity, m/s.
        detailed_steps: Periods that are planned one by one; later ones in groups.
        group: Periods of such a group.
        replan_coasting: Periods between plans while nothing fires.
        replan_burning: Periods between plans while the translation is being changed.
        settling: Periods at the end in which the target should have been reached, for the attitude to settle.
        quiet: Periods at the very end in which the translation is left as it is.
        dead_band: Angle that is left alone, rad.
        final_dead_band: The same while settling, rad.
        look_ahead: The angle is judged where it will be after so many s.
        return_time: Time in which an angle outside the dead band is to be taken back, s.
        return_time_burning: The same while the translation is being changed, s.
        tilt: Angle up to which burns are along the body axes, not LVLH, rad. What goes astray is random and
            cheap to make up for; firing all thrusters to point every burn exactly is not.
        rotation_priority: How much dearer a missed rotation is to the mapper than in its own objective.
        delta_v_cost: What 1 m/s costs a plan, s, while a thruster is stuck on. By firing time alone it would
            be best to let it push, to be carried away by km, and to come back; holding against it all the
            time needs three more thrusters, which is 1200 s per m/s of Orion.
    """

    planned_share: float = 0.75
    planned_thrusters: float = 2.0
    position_tolerance: float = 0.3
    velocity_tolerance: float = 0.003
    detailed_steps: int = 40
    group: int = 5
    replan_coasting: int = 30
    replan_burning: int = 4
    settling: int = 8
    quiet: int = 2
    dead_band: float = 0.05
    final_dead_band: float = 0.02
    look_ahead: float = 10.0
    return_time: float = 100.0
    return_time_burning: float = 12.0
    tilt: float = 0.5
    rotation_priority: float = 4.0
    delta_v_cost: float = 5000.0


class RendezvousController:
    """Flies a spacecraft to the origin of LVLH, at rest and aligned, in a given number of control periods.

    Args:
        spacecraft: What is flown, as the flight software believes it to be.
        steps: Control periods until the rendezvous.
        effectiveness: (6, n), believed instead of the spacecraft's own, for a fault that is known from the
            start.
        settings: How it behaves.

    Attributes:
        spacecraft: As given.
        steps: As given.
        navigation: What the controller believes of the craft's motion.
        plan: The plan in force, None before the first period.
        plans: How many plans were made.
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        steps: int,
        *,
        effectiveness: ArrayLike | None = None,
        settings: RendezvousSettings | None = None,
    ) -> None:
        given: Any = steps
        whole = isinstance(given, (int, np.integer)) and not isinstance(given, bool)
        require(whole and steps >= 1, "steps", given, "a whole number from 1 up")
        self.settings = settings = RendezvousSettings() if settings is None else settings
        self._period = spacecraft.control_period
        self._coupling = spacecraft.feed.coupling
        self._planner, self._holding_planner = (
            RendezvousPlanner(
                spacecraft,
                max_on_time=settings.planned_share * spacecraft.control_period,
                max_total_on_time=settings.planned_thrusters
                * settings.planned_share
                * spacecraft.control_period,
                detailed_steps=settings.detailed_steps,
                group=settings.group,
                tolerance=np.repeat([settings.position_tolerance, settings.velocity_tolerance], 3),
                delta_v_cost=delta_v_cost,
            )
            for delta_v_cost in (0.0, settings.delta_v_cost)
        )
        plain = LPMapper(spacecraft)
        priority = np.repeat([1.0, settings.rotation_priority], 3)
        self._mapper = LPMapper(spacecraft, slack_cost=plain.slack_cost * priority)
        self.navigation = RelativeNavigation(spacecraft)
        self.spacecraft = spacecraft
        self.steps = steps
        self._nominal = self._mapper.effectiveness
        self._known_from_the_start = self._nominal if effectiveness is None else effectiveness
        self.reset()

    def reset(self) -> None:
        """Start anew, with the effectiveness that was given when this controller was made."""
        self.navigation.forget()
        self.believe(self._known_from_the_start)
        self.plans = 0
        self._planned_at = 0
        self._on_times = np.zeros(self._nominal.shape[1])

    def believe(self, effectiveness: ArrayLike, firing: ArrayLike | None = None) -> None:
        """From now on plan, map and predict with this effectiveness (6, n), m/s^2 then rad/s^2.

        Args:
            effectiveness: (6, n), m/s^2 then rad/s^2.
            firing: (n,), s: for how long, loss by the feed taken off, each thruster fires in every period
                whatever is commanded; by default none does. Only plans are made with that: the commands then
                are for all thrusters together, and whoever allocates them has to know.
        """
        matrix = np.array(effectiveness, dtype=np.float64)
        if matrix.shape != self._nominal.shape or not np.isfinite(matrix).all():
            raise ValueError(
                f"effectiveness has the shape {matrix.shape}; {self._nominal.shape}, finite, would be right"
            )
        self.navigation.effectiveness = matrix
        self._firing = None if firing is None or not np.any(firing) else np.array(firing, dtype=np.float64)
        self.plan: RendezvousPlan | None = None

    def __call__(
        self, time: float, position: ArrayLike, velocity: ArrayLike, attitude: ArrayLike, rate: ArrayLike
    ) -> FloatArray:
        """Duties (n,), 0 to 1, for the coming period.

        Args:
            time: Since the start, s.
            position: (3,), measured, m, LVLH.
            velocity: (3,), measured, m/s, LVLH.
            attitude: (4,), measured, body-from-LVLH, scalar first.
            rate: (3,), measured inertial rate, rad/s, body axes.
        """
        command = self.command(time, position, velocity, attitude, rate, on_times=self._on_times)
        self._on_times = self.allocate(command)
        return self._on_times / self._period

    def command(
        self,
        time: float,
        position: ArrayLike,
        velocity: ArrayLike,
        attitude: ArrayLike,
        rate: ArrayLike,
        *,
        on_times: ArrayLike,
    ) -> FloatArray:
        """The rate change (6,) to ask of the thrusters in the coming period, m/s then rad/s, body axes.

        Args:
            time: Since the start, s.
            position: (3,), measured, m, LVLH.
            velocity: (3,), measured, m/s, LVLH.
            attitude: (4,), measured, body-from-LVLH, scalar first.
            rate: (3,), measured inertial rate, rad/s, body axes.
            on_times: (n,), s, commanded in the period that has just ended, whoever allocated them. Ignored at
                the first measurement.
        """
        self.navigation.update(
            *(np.asarray(part, dtype=np.float64) for part in (on_times, position, velocity, attitude, rate))
        )
        return self.decide(time)

    def decide(self, time: float) -> FloatArray:
        """As `command`, from what navigation says by now, measured or not."""
        step = round(time / self._period)
        translation, burn = self._translation(step)
        return np.concatenate([translation, self._rotation(step, burn)])

    def allocate(self, command: ArrayLike) -> FloatArray:
        """On-times (n,), s, that deliver a rate change (6,) with the feed coupling made up for."""
        bound = self._period
        for _ in range(4):
            wanted = self._mapper(
                command,
                effectiveness=self.navigation.effectiveness,
                max_on_time=np.full(self._on_times.size, bound),
            ).on_times
            on_times = commanded_on_times(wanted, self._coupling, 4.0 * self._period)
            longest = float(on_times.max())
            if longest <= self._period * (1.0 + 1e-9):
                break
            bound *= self._period / longest
        return np.minimum(on_times, self._period)

    def _translation(self, step: int) -> tuple[FloatArray, float]:
        """The rate change of the plan for this period, m/s, body axes, and its longest on-time, s."""
        remaining = self.steps - step
        if self.plan is None or step - self._planned_at >= self._plan_lifetime(step):
            horizon = remaining - self.settings.settling
            if horizon <= 0:
                horizon = max(remaining - self.settings.quiet, 0)
            state = np.concatenate([self.navigation.position, self.navigation.velocity])
            self.plan = self._plan(state, horizon)
            self.plans += 1
            self._planned_at = step
        age = step - self._planned_at
        if age >= len(self.plan.on_times):
            return np.zeros(3), 0.0
        change = self.plan.rate_changes[age, :3]
        if float(np.linalg.norm(self.navigation.attitude_error)) > self.settings.tilt:
            change = rotation_matrix(self.navigation.attitude) @ change
        return change, float(self.plan.on_times[age].max())

    def _plan(self, state: FloatArray, horizon: int) -> RendezvousPlan:
        effectiveness = self.navigation.effectiveness
        if self._firing is None:
            return self._planner(state, horizon, effectiveness=effectiveness)
        # Who holds against a thruster that fires all the time has to be able to fire as long.
        longest = np.full(self._firing.size, self._firing.max())
        return self._holding_planner(
            state, horizon, effectiveness=effectiveness, max_on_time=longest, min_on_time=self._firing
        )

    def _plan_lifetime(self, step: int) -> int:
        """Periods after which the plan in force is made anew: few while it burns, many while it coasts."""
        assert self.plan is not None
        if self.steps - step <= self.settings.settling:
            return 1
        age = step - self._planned_at
        recent = self.plan.rate_changes[max(age - 1, 0) : age + 1, :3]
        burning = recent.size > 0 and float(np.abs(recent).max()) > _STILL
        return self.settings.replan_burning if burning else self.settings.replan_coasting

    def _rotation(self, step: int, burn: float) -> FloatArray:
        """The rate change that keeps the body on LVLH, rad/s, body axes.

        While all thrusters of a burn are open their torques cancel; they turn the body by how much longer
        some of them stay open, at the end of the burn. The angle to correct is the one that there will be
        then.
        """
        settings = self.settings
        rate = self.navigation.relative_rate
        angle = self.navigation.attitude_error + rate * burn
        settling = self.steps - step <= settings.settling
        band = settings.final_dead_band if settling else settings.dead_band
        back_in = settings.return_time_burning if burn > 0.0 or settling else settings.return_time
        ahead = angle + rate * settings.look_ahead
        return np.where(np.abs(ahead) > band, -rate - angle / back_in, 0.0)
