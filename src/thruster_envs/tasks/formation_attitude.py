"""A formation on plasma thrusters as a task: followers turn to given attitudes from the leader and hold them.

Models two to sixteen like craft, a leader and its followers, in attitude alone (Valdes 2008, chapters 5 and
6): three pairs of pulsed plasma thrusters each, one decision in every control period, gravity gradient and a
small constant torque. Targets are drawn from angles that contain the manoeuvres of the source. Craft that are
not commanded fly by the law of :mod:`.attitude_pilot`. Leaves out translation, and any limit to what a
follower knows of the leader.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import pulsed_flight as pulse
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.pulsed_craft import BIAS_TORQUE, PulsedFlight, check_torques, discharge_of
from thruster_envs.physics.vehicle import open_vehicle
from thruster_envs.random import RESET, philox, uniform_pair
from thruster_envs.spacecraft.description import Vector
from thruster_envs.tasks.access import attitude_error, bounded, place
from thruster_envs.tasks.attitude_pilot import (
    AttitudePilot,
    Gains,
    command_pulses,
    error_quaternion,
    hold_attitudes,
    relative_motion,
    turned,
)
from thruster_envs.tasks.contract import (
    FloatArray,
    Observations,
    Outcome,
    Task,
    TaskState,
    Truth,
    check_not_negative,
    check_positive,
    check_whole,
)

#: Requirements of Valdes 2008, Table 5.VI: error of each component of the vector part of the quaternion, of
#: each rate in rad/s, and time before which the attitude must have settled, s.
ATTITUDE_TOLERANCE, RATE_TOLERANCE, SETTLING_LIMIT = 6e-3, 6e-5, 1000.0
_BOUND = 5.0
#: What observations are divided by: rad for the fine error, rad/s.
_FINE, _RATE = 0.05, 1e-3
#: Error at which the fine half of the pointing term is half its worst, rad, and least error that gains are
#: counted from, rad. The coarse half grows with the error, so that a turn pays from its first degree.
_HALF, _LEAST = 0.05, 0.1
#: Pulses that a thruster can be owed at most, and what counts as a whole one, rounding forgiven.
_MOST_OWED, _WHOLE = 2.0, 1.0 - 1e-9
# Columns of the account, per craft. First what the last step was worth.
_POINTING, _BALANCE, _PULSES, _COST = range(4)
# Error now and when the target was set, rad; how many of the six requirements are met; s since the target was
# set, and from when on, so counted, the attitude has been within its tolerance; s of discharges since the
# reset.
_ANGLE, _FIRST_ANGLE, _MET, _SINCE, _SETTLED, _OPEN_TIME = range(4, 10)
# Error when a target was set that the account does not count from yet, rad; 0 where there is none.
_NEW_ANGLE, _ACCOUNT = 10, 11
# Entries of the limits; lowest angle and width of the range of roll, pitch and yaw.
(
    _PERIOD, _FIRING_TIME, _INTERVAL, _RATE_SOFT_LIMIT, _RATE_LIMIT, _BALANCE_PRICE, _PULSE_PRICE, _ANGLES,
) = range(8)  # fmt: skip
_LIMITS = _ANGLES + 6


@dataclass(frozen=True)
class FormationAttitudeModel:
    """The configuration in numbers."""

    limits: FloatArray
    gains: Gains


@dataclass
class FormationAttitudeState(TaskState):
    """Arrays of a batch: targets, pulses owed and accounts."""

    fleet: Fleet
    model: FormationAttitudeModel
    targets: FloatArray  # (worlds, craft, 4), attitude from the leader's body; the leader's from the frame
    owed: FloatArray  # (worlds, craft, n), pulses commanded by duties and not fired yet
    account: FloatArray  # (worlds, craft, 11)
    over: FloatArray  # (worlds,), 1 where a craft is lost


@dataclass(frozen=True, kw_only=True)
class FormationAttitude(Task):
    """Configuration of ``formation_attitude_v0``.

    Attributes:
        craft: Number of craft, 2 to 16, the leader among them.
        command_leader: Whether the leader is commanded too, as the first agent.
        commanded: How many craft are commanded, counted from the first follower, or from the leader if it is;
            None for all. The others fly by the scripted law.
        action: ``"pulses"``, one option of three for each axis, or ``"duties"``, a share of the most pulses
            for each thruster.
        roll_degrees: Range from which the roll of a target is drawn, degrees.
        pitch_degrees: The same for pitch.
        yaw_degrees: The same for yaw.
        retarget_interval: Control periods after which every follower gets a new target; None for never.
        gravity_gradient: Whether the gravity gradient acts.
        bias_torque: A constant torque on every craft, N m, body axes.
        fault_bias: Torque that comes with a fault of a discharge, N m, for one that takes thrust and one that
            adds some; see :data:`thruster_envs.physics.pulsed_craft.REPORTED_FAULT_BIAS`.
        rate_soft_limit: Body rate above which ``cost`` counts, rad/s.
        rate_limit: Body rate at which a craft is lost, rad/s.
        balance_price: What it costs to have used twice the formation's mean or more, per step; an error of
            1 rad costs about 1.
        pulse_price: What a pulse on each axis costs, likewise.
    """

    spacecraft: Any = "ppt_cubesat"
    craft: int = 3
    command_leader: bool = False
    commanded: int | None = None
    action: str = "pulses"
    roll_degrees: tuple[float, float] = (20.0, 35.0)
    pitch_degrees: tuple[float, float] = (30.0, 50.0)
    yaw_degrees: tuple[float, float] = (40.0, 60.0)
    retarget_interval: int | None = None
    gravity_gradient: bool = True
    bias_torque: Vector = BIAS_TORQUE
    fault_bias: tuple[float, float] = (0.0, 0.0)
    rate_soft_limit: float = 0.01
    rate_limit: float = 0.05
    balance_price: float = 0.05
    pulse_price: float = 0.1

    reward_terms: ClassVar[tuple[str, ...]] = ("pointing", "balance", "pulses")
    max_episode_steps: ClassVar[int | None] = 3000

    def __post_init__(self) -> None:
        super().__post_init__()
        discharge_of(self.vehicle)
        check_whole("craft", self.craft, 2, 16)
        if self.commanded is not None:
            check_whole("commanded", self.commanded, 1, self.craft - self.first_commanded)
        if self.retarget_interval is not None:
            check_whole("retarget_interval", self.retarget_interval, 1, 2**31)
        if self.action not in ("pulses", "duties"):
            raise ValueError(f"action is {self.action!r}; 'pulses' or 'duties' would be right")
        for name in ("roll_degrees", "pitch_degrees", "yaw_degrees"):
            low, high = getattr(self, name)
            if not -180.0 <= low <= high <= 180.0:
                raise ValueError(f"{name} is {(low, high)}; two angles from -180 to 180 would be right")
        check_torques(self.bias_torque, self.fault_bias)
        check_positive(self, "rate_soft_limit", "rate_limit")
        if self.rate_limit < self.rate_soft_limit:
            raise ValueError(
                f"rate_limit is {self.rate_limit!r}; rate_soft_limit, {self.rate_soft_limit!r}, or more "
                "would be right"
            )
        check_not_negative(self, "balance_price", "pulse_price")
        AttitudePilot.of(self.vehicle)

    @property
    def number_of_craft(self) -> int:
        """Craft in a world."""
        return self.craft

    @property
    def first_commanded(self) -> int:
        """The leader, or the first follower."""
        return 0 if self.command_leader else 1

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Names of the commanded craft."""
        names = ("leader", *(f"follower_{k}" for k in range(1, self.craft)))
        return names[self.first_commanded :][: self.commanded]

    @cached_property
    def choices(self) -> tuple[int, ...] | None:
        """No pulse about an axis, one forwards, one backwards; None where duties are commanded."""
        return (3, 3, 3) if self.action == "pulses" else None

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        n = self.vehicle.number_of_thrusters
        owed = (
            Field(
                "owed",
                "share of a pulse that each thruster is owed",
                n,
                reference="pulse",
                bound=_MOST_OWED,
                lowest=0.0,
            ),
        )
        return (
            Field("attitude", "measured attitude from the target, as a quaternion", 4),
            Field("attitude_error", "measured attitude error", 3, "rad", _FINE),
            Field("rate", "measured rate relative to the leader", 3, "rad/s", _RATE, bound=_BOUND),
            Field("target", "target from the leader, as a quaternion", 4),
            Field("duties", "whether each thruster was asked to fire last", n, lowest=0.0),
            Field(
                "fuel_excess", "own fuel over the formation's mean, less one", 1, bound=_BOUND, lowest=-1.0
            ),
            *(owed if self.action == "duties" else ()),
            *self.oracle_fields(),
        )

    def oracle_fields(self) -> tuple[Field, ...]:
        """The oracle view, where it was asked for."""
        if not self.observe_fault:
            return ()
        n, firing_time = self.vehicle.number_of_thrusters, discharge_of(self.vehicle).firing_time
        impulse: dict[str, Any] = {
            "unit": "N s",
            "scale": tuple(thruster.thrust * firing_time for thruster in self.vehicle.thrusters),
            "reference": "nominal impulse",
        }
        return (
            Field(
                "true_impulse_asked", "true impulse that asking each thruster adds", n, bound=2.0, **impulse
            ),
            Field("true_impulse_unasked", "true impulse of each thruster unasked", n, bound=2.0, **impulse),
        )

    def create(self, worlds: int, threads: int | None) -> FormationAttitudeState:
        """Arrays for that many worlds."""
        vehicle, craft = self.vehicle, self.craft
        fleet = Fleet(
            vehicle, worlds, craft, slots=self.fault_slots, max_substep=self.max_substep, threads=threads,
            pulsed=PulsedFlight(
                gravity_gradient=self.gravity_gradient, bias_torque=self.bias_torque,
                fault_bias=self.fault_bias,
            ),
        )  # fmt: skip
        angles = np.radians([self.roll_degrees, self.pitch_degrees, self.yaw_degrees])
        limits = np.array(
            [vehicle.control_period, discharge_of(vehicle).firing_time, self.retarget_interval or 0.0,
             self.rate_soft_limit, self.rate_limit, self.balance_price, self.pulse_price,
             *angles[:, 0], *(angles[:, 1] - angles[:, 0])]
        )  # fmt: skip
        return FormationAttitudeState(
            fleet, FormationAttitudeModel(limits, AttitudePilot.of(vehicle).gains),
            np.zeros((worlds, craft, 4)), np.zeros((worlds, craft, vehicle.number_of_thrusters)),
            np.zeros((worlds, craft, _ACCOUNT)), np.zeros(worlds),
        )  # fmt: skip

    def reset(self, state: FormationAttitudeState, which: NDArray[np.int64]) -> None:
        """Start at rest, all craft aligned, with the first targets."""
        fleet = state.fleet
        _start(
            fleet.data, fleet.streams, which, state.model.limits, state.targets, state.owed, state.account,
            state.over,
        )  # fmt: skip
        fleet.look(which)

    def step(self, state: FormationAttitudeState, actions: NDArray[Any]) -> None:
        """Fly one period; the craft that nobody commands fly by the law."""
        fleet, model, choose = state.fleet, state.model, self.choices is not None
        first, last = self.first_commanded, self.first_commanded + len(self.agents)
        capacitors = fleet.capacitors

        def command(start: int, stop: int) -> None:
            if choose:
                _choose_pulses(fleet.data, actions, first, self.craft, model.gains, start, stop)
            else:
                _owe_pulses(fleet.data, actions, first, state.owed, capacitors, start, stop)
            hold_attitudes(fleet.data, state.targets, 0, first, start, stop, model.gains)
            hold_attitudes(fleet.data, state.targets, last, self.craft, start, stop, model.gains)

        fleet.by_worlds(command)
        fleet.fly()
        fleet.by_worlds(
            lambda start, stop: _judge(
                fleet.data, fleet.streams, model.limits, state.targets, state.account, state.over, start, stop
            )
        )

    def observe(self, state: FormationAttitudeState) -> Observations:
        """(worlds, agents, observation_size)."""
        fleet = state.fleet
        observations = np.empty((fleet.worlds, len(self.agents), self.observation_size), np.float32)
        fleet.by_worlds(
            lambda start, stop: _observe(
                fleet.data, fleet.faults, fleet.vehicle, state.model.limits, state.targets, state.owed,
                state.account, self.first_commanded, self.choices is None, self.observe_fault, observations,
                start, stop,
            )
        )  # fmt: skip
        return observations

    def outcome(self, state: FormationAttitudeState) -> Outcome:
        """Terminates for all when a craft is lost."""
        account = self._account(state)
        return Outcome(account[..., : _PULSES + 1], account[..., _COST], state.over)

    def truth(self, state: FormationAttitudeState) -> Truth:
        """Half of the score is the share of the turn that is done, half that of the requirements met."""
        fuel, score, success = np.empty((3, state.fleet.worlds, len(self.agents)))
        _rate(self._account(state), state.over, fuel, score, success)
        return Truth(fuel, score, success)

    def report(self, state: FormationAttitudeState) -> dict[str, dict[str, NDArray[Any]]]:
        """How far each craft is from its target, and how long it took to settle there."""
        account = self._account(state)
        inside = account[..., _SETTLED] <= account[..., _SINCE]
        return {
            "attitude": {
                "error": account[..., _ANGLE].copy(),
                "requirements_met": account[..., _MET].astype(np.int64),
                "settling_time": np.where(inside, account[..., _SETTLED], -1.0),
            }
        }

    def _account(self, state: FormationAttitudeState) -> FloatArray:
        """Those of the commanded craft, a view."""
        return state.account[:, self.first_commanded :][:, : len(self.agents)]


def turn_of(state: FormationAttitudeState, world: int, craft: int) -> tuple[float, float, float]:
    """How far a craft (from 0) has turned from the leader, how far it should, in rad; its rate, rad/s."""
    q, rate = relative_motion(state.fleet.data, at.ATTITUDE, world, craft, state.targets.shape[1])
    target = float(state.targets[world, craft, 0])
    return 2.0 * math.acos(min(abs(q[0]), 1.0)), 2.0 * math.acos(min(target, 1.0)), math.hypot(*rate)


@njit
def _draw_target(streams, b, w, craft, number, limits, target):
    """Draw target ``number`` (from 0) of a follower: yaw about z, then pitch about y, then roll about x."""
    words = philox(
        np.uint64(2), np.uint64(number), streams[b, at.EPISODE, w], np.uint64(RESET << 32) | np.uint64(craft),
        streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
    )  # fmt: skip
    roll, pitch = uniform_pair(words[0])
    yaw, _ = uniform_pair(words[1])
    x = 0.5 * (limits[_ANGLES] + roll * limits[_ANGLES + 3])
    y = 0.5 * (limits[_ANGLES + 1] + pitch * limits[_ANGLES + 4])
    z = 0.5 * (limits[_ANGLES + 2] + yaw * limits[_ANGLES + 5])
    q = turned((math.cos(x), math.cos(y), math.cos(z)), (math.sin(x), math.sin(y), math.sin(z)))
    for k in range(4):
        target[k] = q[k] if q[0] >= 0.0 else -q[k]


@njit
def _aim(data, streams, world, number, limits, targets, account):
    """Give every follower its target ``number``; the account counts from it from the next period on.

    So the outcome of a period is that of the target it was flown for, the last of an episode too.
    """
    craft = targets.shape[1]
    for c in range(1, craft):
        b, w = place(world, c, craft, data.shape[2])
        _draw_target(streams, b, w, c, number, limits, targets[world, c])
        account[world, c, _NEW_ANGLE] = _angle(_true_error(data, world, c, targets))


@njit(forceinline=True)
def _true_error(data, world, c, targets):
    q, _ = relative_motion(data, at.ATTITUDE, world, c, targets.shape[1])
    target = targets[world, c]
    return error_quaternion(q, (target[0], target[1], target[2], target[3]))


@njit(forceinline=True)
def _angle(e):
    """Angle of the rotation of a quaternion, rad."""
    return 2.0 * math.atan2(math.sqrt(e[1] * e[1] + e[2] * e[2] + e[3] * e[3]), e[0])


@njit(forceinline=True)
def _assess(data, world, c, targets, period, account):
    """How far a craft truly is from its target, and how many of the requirements it meets.

    That of a rate counts only where that of the same axis's attitude is met: standing still is no merit.
    """
    e = _true_error(data, world, c, targets)
    _, rate = relative_motion(data, at.ATTITUDE, world, c, targets.shape[1])
    account[_ANGLE] = _angle(e)
    met, inside = 0.0, True
    for k in range(3):
        close = abs(e[1 + k]) < ATTITUDE_TOLERANCE
        inside &= close
        if close:
            met += 2.0 if abs(rate[k]) < RATE_TOLERANCE else 1.0
    account[_MET] = met
    if not inside:
        account[_SETTLED] = account[_SINCE] + period


@kernel
def _start(data, streams, which, limits, targets, owed, account, over):
    for world in which:
        over[world] = 0.0
        targets[world, 0, 0] = 1.0
        targets[world, 0, 1:] = 0.0
        owed[world] = 0.0
        account[world] = 0.0
        _aim(data, streams, world, 0, limits, targets, account)
        for c in range(targets.shape[1]):
            _count_anew(account[world, c])
            _assess(data, world, c, targets, limits[_PERIOD], account[world, c])


@njit(forceinline=True)
def _count_anew(account):
    account[_FIRST_ANGLE], account[_NEW_ANGLE] = account[_NEW_ANGLE], 0.0
    account[_SINCE], account[_SETTLED] = 0.0, 0.0


@kernel(nogil=True)
def _choose_pulses(data, options, first, craft, gains, start, stop):
    """Turn options (worlds, agents, 3) into commanded firings."""
    for world in range(start, stop):
        for agent in range(options.shape[1]):
            b, w = place(world, first + agent, craft, data.shape[2])
            pulses = (
                _pulse(options[world, agent, 0]),
                _pulse(options[world, agent, 1]),
                _pulse(options[world, agent, 2]),
            )
            command_pulses(data, b, w, pulses, gains.thrusters)


@njit(forceinline=True)
def _pulse(option):
    return -1 if option == 2 else option


@kernel(nogil=True)
def _owe_pulses(data, duties, first, owed, capacitors, start, stop):
    """Add duties (worlds, agents, n) to what thrusters are owed; whole pulses are fired.

    Of several that are due on one capacitor the one that is owed most fires, the first of them at a tie.
    """
    n, craft = duties.shape[2], owed.shape[1]
    for world in range(start, stop):
        for agent in range(duties.shape[1]):
            c = first + agent
            b, w = place(world, c, craft, data.shape[2])
            debt = owed[world, c]
            for i in range(n):
                debt[i] = min(debt[i] + duties[world, agent, i], _MOST_OWED)
            for i in range(n):
                fires = debt[i] >= _WHOLE
                for j in range(n):
                    if j != i and capacitors[j] == capacitors[i]:
                        fires &= debt[i] > debt[j] or (debt[i] == debt[j] and i < j)
                data[b, at.DUTIES + i, w] = 1.0 if fires else 0.0
            for i in range(n):
                debt[i] = max(debt[i] - data[b, at.DUTIES + i, w], 0.0)


@kernel
def _rate(account, over, fuel, score, success):
    """Fuel, score and success of every agent, (worlds, agents) each."""
    for world in range(score.shape[0]):
        for agent in range(score.shape[1]):
            mine, sound = account[world, agent], over[world] == 0.0
            done = 1.0 - mine[_ANGLE] / max(mine[_FIRST_ANGLE], _LEAST)
            fuel[world, agent] = mine[_OPEN_TIME]
            score[world, agent] = 0.5 * min(max(done, 0.0), 1.0) + mine[_MET] / 12.0 if sound else 0.0
            success[world, agent] = sound and mine[_MET] == 6.0 and mine[_SETTLED] < SETTLING_LIMIT


@kernel(nogil=True)
def _judge(data, streams, limits, targets, account, over, start, stop):
    lanes, craft = data.shape[2], targets.shape[1]
    for world in range(start, stop):
        mean = 0.0
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            mean += data[b, at.OPEN_TIME, w] / craft
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            mine = account[world, c]
            if mine[_NEW_ANGLE] > 0.0:
                _count_anew(mine)
            mine[_SINCE] += limits[_PERIOD]
            _assess(data, world, c, targets, limits[_PERIOD], mine)
            used = data[b, at.OPEN_TIME, w]
            excess = min(max(used / mean - 1.0, 0.0), 1.0) if mean > 0.0 else 0.0
            mine[_POINTING] = -0.5 * (mine[_ANGLE] + mine[_ANGLE] / (mine[_ANGLE] + _HALF))
            mine[_BALANCE] = -limits[_BALANCE_PRICE] * excess
            mine[_PULSES] = -limits[_PULSE_PRICE] * (used - mine[_OPEN_TIME]) / (3.0 * limits[_FIRING_TIME])
            mine[_OPEN_TIME] = used
            spin = math.sqrt(
                data[b, at.RATE, w] ** 2 + data[b, at.RATE + 1, w] ** 2 + data[b, at.RATE + 2, w] ** 2
            )
            mine[_COST] = max(0.0, spin / limits[_RATE_SOFT_LIMIT] - 1.0)
            if not (data[b, at.LOST, w] == 0.0 and spin <= limits[_RATE_LIMIT]):
                over[world] = 1.0
        b, w = place(world, 0, craft, lanes)
        if limits[_INTERVAL] > 0.0 and data[b, at.STEP, w] % limits[_INTERVAL] == 0.0:
            _aim(data, streams, world, int(data[b, at.STEP, w] / limits[_INTERVAL]), limits, targets, account)


@kernel(nogil=True)
def _observe(
    data, faults, parts, limits, targets, owed, account, first, by_duties, observe_fault, observations,
    start, stop,
):  # fmt: skip
    lanes, craft, n = data.shape[2], targets.shape[1], owed.shape[2]
    made, pulses = np.empty((pulse.HEALTH_GROUPS, n)), open_vehicle(parts).pulses
    for world in range(start, stop):
        mean = 0.0
        for c in range(craft):
            mean += account[world, c, _OPEN_TIME] / craft
        for agent in range(observations.shape[1]):
            c, row = first + agent, observations[world, agent]
            b, w = place(world, c, craft, lanes)
            q, rate = relative_motion(data, at.MEASURED + 6, world, c, craft)
            target = targets[world, c]
            e = error_quaternion(q, (target[0], target[1], target[2], target[3]))
            angle = attitude_error(e)
            for k in range(4):
                row[k] = bounded(e[k], 1.0)
                row[10 + k] = bounded(target[k], 1.0)
            for k in range(3):
                row[4 + k] = bounded(angle[k] / _FINE, 1.0)
                row[7 + k] = bounded(rate[k] / _RATE, _BOUND)
            for i in range(n):
                row[14 + i] = data[b, at.DUTIES + i, w]
            used = account[world, c, _OPEN_TIME]
            row[14 + n] = bounded(used / mean - 1.0, _BOUND) if mean > 0.0 else 0.0
            column = 15 + n
            if by_duties:
                for i in range(n):
                    row[column + i] = owed[world, c, i]
                column += n
            if observe_fault:
                time = data[b, at.STEP, w] * limits[_PERIOD]
                pulse.pulse_health(faults[b, w], time, pulses, made)
                for i in range(n):
                    asked, unasked = pulse.impulses_of(made, i)
                    row[column + i], row[column + n + i] = bounded(asked, 2.0), bounded(unasked, 2.0)
