"""A formation on plasma thrusters as a task: followers turn to given attitudes from the leader and hold them.

Models two to sixteen like craft, a leader and its followers, in attitude alone (Valdes 2008, chapters 5 and
6): three pairs of pulsed plasma thrusters each, one decision in every control period, gravity gradient and a
small constant torque. Targets are drawn from angles that contain the manoeuvres of the source. Craft that are
not commanded fly by the law of :mod:`thruster_envs.pilots.attitude`. Leaves out translation, and any limit to
what a follower knows of the leader.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import pulsed_flight as pulse
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import attitude_error, opener, place
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.pulsed_craft import BIAS_TORQUE, PulsedFlight, check_torques, discharge_of
from thruster_envs.physics.vehicle import open_vehicle
from thruster_envs.pilots.attitude import (
    AttitudePilot,
    Gains,
    command_pulses,
    error_quaternion,
    hold_attitudes,
    relative_motion,
    turned,
)
from thruster_envs.random import RESET, philox, uniform_pair
from thruster_envs.spacecraft.description import Vector
from thruster_envs.tasks.access import bounded
from thruster_envs.tasks.contract import (
    EpisodeState,
    FloatArray,
    Observations,
    Outcome,
    Task,
    Truth,
    check_not_negative,
    check_positive,
    check_whole,
)
from thruster_envs.tasks.pictures import Frame, Picture, Trace, fuel_and_score

#: Requirements of Valdes 2008, Table 5.VI: error of each component of the vector part of the quaternion, of
#: each rate in rad/s, and time before which the attitude must have settled, s.
ATTITUDE_TOLERANCE, RATE_TOLERANCE, SETTLING_LIMIT = 6e-3, 6e-5, 1000.0
_BOUND = 5.0
#: Dots of a curve at most.
_MOST_DOTS = 150
#: What observations are divided by: rad for the fine error, rad/s.
_FINE, _RATE = 0.05, 1e-3
#: Error at which the fine half of the pointing term is half its worst, rad, and least error that gains are
#: counted from, rad. The coarse half grows with the error, so that a turn pays from its first degree.
_HALF, _LEAST = 0.05, 0.1
#: Control periods of an episode, and what one at the target is worth.
_STEPS, _POINTED = 3000, 7.0 / 3000
#: Pulses that a thruster can be owed at most, and what counts as a whole one, rounding forgiven.
_MOST_OWED, _WHOLE = 2.0, 1.0 - 1e-9


class Parameters(NamedTuple):
    """The configuration in numbers; lowest angle of a target and width of its range, about each axis.

    Attributes:
        period: Control period, s.
        firing_time: Of a discharge, s.
        interval: Control periods after which followers get new targets; 0 for never.
        rate_soft_limit: Body rate above which there is a cost, rad/s.
        rate_limit: Body rate at which a craft is lost, rad/s.
        balance_price: Of having used twice the formation's mean or more.
        pulse_price: Of a pulse on each axis.
        loss: What a loss costs.
        former: 1 for the reward of v0.
        roll: rad.
        pitch: rad.
        yaw: rad.
        roll_range: rad.
        pitch_range: rad.
        yaw_range: rad.
    """

    period: float
    firing_time: float
    interval: float
    rate_soft_limit: float
    rate_limit: float
    balance_price: float
    pulse_price: float
    loss: float
    former: float
    roll: float
    pitch: float
    yaw: float
    roll_range: float
    pitch_range: float
    yaw_range: float


class Statistics(NamedTuple):
    """Episode statistics, (worlds, craft) each.

    Attributes:
        pointing: Term of the reward of the last step, and the next three likewise.
        balance: Likewise.
        pulses: Likewise.
        lost: Likewise.
        cost: Of the last step.
        angle: Error now, rad.
        first_angle: Error when the target was set, rad.
        met: How many of the six requirements are met.
        since: Since the target was set, s.
        settled: From when on, so counted, the attitude has been within its tolerance, s.
        open_time: Of discharges since the reset, s.
        new_angle: Error when a target was set that nothing counts from yet, rad; 0 where there is none.
    """

    pointing: FloatArray
    balance: FloatArray
    pulses: FloatArray
    lost: FloatArray
    cost: FloatArray
    angle: FloatArray
    first_angle: FloatArray
    met: FloatArray
    since: FloatArray
    settled: FloatArray
    open_time: FloatArray
    new_angle: FloatArray


_parameters, _statistics = opener(Parameters), opener(Statistics, columns=True)


@dataclass(frozen=True)
class FormationAttitudeModel:
    """The configuration in arrays.

    Attributes:
        parameters: As :class:`Parameters` names them.
        gains: Of the law that flies the other craft.
    """

    parameters: FloatArray
    gains: Gains


@dataclass
class FormationAttitudeState(EpisodeState[Statistics]):
    """Arrays of a batch; statistics are (worlds, craft, 11)."""

    model: FormationAttitudeModel
    targets: FloatArray  # (worlds, craft, 4), attitude from the leader's body; the leader's from the frame
    owed: FloatArray  # (worlds, craft, n), pulses commanded by duties and not fired yet
    over: FloatArray  # (worlds,), 1 where a craft is lost
    names = Statistics


@dataclass(frozen=True, kw_only=True)
class FormationAttitude(Task):
    """Configuration of ``formation_attitude_v1``.

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
        balance_price: What it costs to have used twice the formation's mean or more, in units of what a
            period at the target is worth.
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
    balance_price: float = 0.02
    pulse_price: float = 0.03

    reward_terms: ClassVar[tuple[str, ...]] = ("pointing", "balance", "pulses", "lost")
    former_reward: ClassVar[bool] = False
    translates: ClassVar[bool] = False
    max_episode_steps: ClassVar[int | None] = _STEPS
    one_agent: ClassVar[dict[str, Any]] = {"command_leader": False, "commanded": 1}

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

    @property
    def most_worth(self) -> float:
        """The most that an episode can be worth to an agent, which is what a loss costs."""
        return _STEPS * _POINTED * (1.0 + self.balance_price + self.pulse_price)

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
        (roll, pitch, yaw), (roll_range, pitch_range, yaw_range) = angles[:, 0], angles[:, 1] - angles[:, 0]
        parameters = Parameters(
            period=vehicle.control_period,
            firing_time=discharge_of(vehicle).firing_time,
            interval=float(self.retarget_interval or 0),
            rate_soft_limit=self.rate_soft_limit,
            rate_limit=self.rate_limit,
            balance_price=self.balance_price,
            pulse_price=self.pulse_price,
            loss=self.most_worth,
            former=float(self.former_reward),
            roll=roll,
            pitch=pitch,
            yaw=yaw,
            roll_range=roll_range,
            pitch_range=pitch_range,
            yaw_range=yaw_range,
        )
        return FormationAttitudeState(
            fleet,
            np.zeros((worlds, craft, len(Statistics._fields))),
            FormationAttitudeModel(np.array(parameters), AttitudePilot.of(vehicle).gains),
            targets=np.zeros((worlds, craft, 4)),
            owed=np.zeros((worlds, craft, vehicle.number_of_thrusters)),
            over=np.zeros(worlds),
        )

    def reset(self, state: FormationAttitudeState, which: NDArray[np.int64]) -> None:
        """Start at rest, all craft aligned, with the first targets."""
        fleet = state.fleet
        _start(
            fleet.data, fleet.streams, which, state.model.parameters, state.targets, state.owed,
            state.statistics, state.over,
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
            lambda start, stop: _evaluate_step(
                fleet.data, fleet.streams, model.parameters, state.targets, state.statistics, state.over,
                start, stop,
            )
        )  # fmt: skip

    def observe(self, state: FormationAttitudeState) -> Observations:
        """(worlds, agents, observation_size)."""
        fleet = state.fleet
        observations = np.empty((fleet.worlds, len(self.agents), self.observation_size), np.float32)
        fleet.by_worlds(
            lambda start, stop: _observe(
                fleet.data, fleet.faults, fleet.vehicle, state.model.parameters,
                (state.targets, state.owed, state.statistics), self.first_commanded,
                (self.choices is None, self.observe_fault), observations, start, stop,
            )
        )  # fmt: skip
        return observations

    def outcome(self, state: FormationAttitudeState) -> Outcome:
        """Terminates for all when a craft is lost."""
        terms = state.statistics[:, self._agents, : len(self.reward_terms)]
        return Outcome(terms, state.episode.cost[:, self._agents], state.over)

    def truth(self, state: FormationAttitudeState) -> Truth:
        """Half of the score is the share of the turn that is done, half that of the requirements met."""
        fuel, score, success = np.empty((3, state.fleet.worlds, len(self.agents)))
        _rate(state.statistics[:, self._agents], state.over, fuel, score, success)
        return Truth(fuel, score, success)

    def report(self, state: FormationAttitudeState) -> dict[str, dict[str, NDArray[Any]]]:
        """How far each craft is from its target, and how long it took to settle there."""
        episode, agents = state.episode, self._agents
        settled = episode.settled[:, agents]
        return {
            "attitude": {
                "error": episode.angle[:, agents].copy(),
                "requirements_met": episode.met[:, agents].astype(np.int64),
                "settling_time": np.where(settled <= episode.since[:, agents], settled, -1.0),
            }
        }

    def picture(self, frame: Frame) -> Picture:
        """Angle and rate of the first agent's craft from the leader since the start, and what is wanted."""
        samples, error = frame.samples, frame.info["attitude"]["error"][frame.world, 0]
        few = samples[:: -(-len(samples) // _MOST_DOTS)] if len(samples) > 1 else _two(samples)
        time, angle, target, rate = few.T
        return Picture(
            readouts=(
                ("error", f"{np.degrees(error):.2f}°"),
                *fuel_and_score(frame),
            ),
            traces=(
                Trace("turned, deg", "time, s", time, np.degrees(target), np.degrees(angle)),
                Trace("rate, mrad/s", "time, s", time, 0.0 * rate, 1e3 * rate),
            ),
            traces_name=f"craft {self.first_commanded + 1}, from the leader",
        )

    def sample(self, state: FormationAttitudeState, world: int, time: float) -> tuple[float, ...]:
        """Time, how far the first agent's craft has turned from the leader, how far it should; its rate."""
        craft = self.first_commanded
        q, rate = relative_motion(state.fleet.data, at.ATTITUDE, world, craft, self.craft)
        target = float(state.targets[world, craft, 0])
        turned, due = 2.0 * math.acos(min(abs(q[0]), 1.0)), 2.0 * math.acos(min(target, 1.0))
        return time, turned, due, math.hypot(*rate)

    @cached_property
    def _agents(self) -> slice:
        """Which craft are commanded."""
        return slice(self.first_commanded, self.first_commanded + len(self.agents))


def _two(samples: FloatArray) -> FloatArray:
    """A curve of one sample, drawn for a second."""
    second: FloatArray = np.array([[0.0] * 4, [1.0, 0.0, 0.0, 0.0]])
    return np.asarray(np.tile(samples, (2, 1)) + second)


@njit
def _draw_target(streams, b, w, craft, number, parameters, target):
    """Draw target ``number`` (from 0) of a follower: yaw about z, then pitch about y, then roll about x."""
    words = philox(
        np.uint64(2), np.uint64(number), streams[b, at.EPISODE, w], np.uint64(RESET << 32) | np.uint64(craft),
        streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
    )  # fmt: skip
    roll, pitch = uniform_pair(words[0])
    yaw, _ = uniform_pair(words[1])
    x = 0.5 * (parameters.roll + roll * parameters.roll_range)
    y = 0.5 * (parameters.pitch + pitch * parameters.pitch_range)
    z = 0.5 * (parameters.yaw + yaw * parameters.yaw_range)
    q = turned((math.cos(x), math.cos(y), math.cos(z)), (math.sin(x), math.sin(y), math.sin(z)))
    for k in range(4):
        target[k] = q[k] if q[0] >= 0.0 else -q[k]


@njit
def _aim(data, streams, world, number, parameters, targets, episode):
    """Give every follower its target ``number``; statistics count from it from the next period on.

    So the outcome of a period is that of the target it was flown for, the last of an episode too.
    """
    craft = targets.shape[1]
    for c in range(1, craft):
        b, w = place(world, c, craft, data.shape[2])
        _draw_target(streams, b, w, c, number, parameters, targets[world, c])
        episode.new_angle[world, c] = _angle(_true_error(data, world, c, targets))


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
def _assess(data, world, c, targets, period, episode):
    """How far a craft truly is from its target, and how many of the requirements it meets.

    That of a rate counts only where that of the same axis's attitude is met: standing still is no merit.
    """
    e = _true_error(data, world, c, targets)
    _, rate = relative_motion(data, at.ATTITUDE, world, c, targets.shape[1])
    episode.angle[world, c] = _angle(e)
    met, inside = 0.0, True
    for k in range(3):
        close = abs(e[1 + k]) < ATTITUDE_TOLERANCE
        inside &= close
        if close:
            met += 2.0 if abs(rate[k]) < RATE_TOLERANCE else 1.0
    episode.met[world, c] = met
    if not inside:
        episode.settled[world, c] = episode.since[world, c] + period


@kernel
def _start(data, streams, which, numbers, targets, owed, statistics, over):
    parameters, episode = _parameters(numbers), _statistics(statistics)
    for world in which:
        over[world] = 0.0
        targets[world, 0, 0] = 1.0
        targets[world, 0, 1:] = 0.0
        owed[world] = 0.0
        statistics[world] = 0.0
        _aim(data, streams, world, 0, parameters, targets, episode)
        for c in range(targets.shape[1]):
            _restart(episode, world, c)
            _assess(data, world, c, targets, parameters.period, episode)


@njit(forceinline=True)
def _restart(episode, world, c):
    """Count from the new target on."""
    episode.first_angle[world, c], episode.new_angle[world, c] = episode.new_angle[world, c], 0.0
    episode.since[world, c], episode.settled[world, c] = 0.0, 0.0


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
def _rate(statistics, over, fuel, score, success):
    """Fuel, score and success of every agent, (worlds, agents) each."""
    episode = _statistics(statistics)
    for world in range(score.shape[0]):
        for agent in range(score.shape[1]):
            met, goes_on = episode.met[world, agent], over[world] == 0.0
            done = 1.0 - episode.angle[world, agent] / max(episode.first_angle[world, agent], _LEAST)
            fuel[world, agent] = episode.open_time[world, agent]
            score[world, agent] = 0.5 * min(max(done, 0.0), 1.0) + met / 12.0 if goes_on else 0.0
            settled = episode.settled[world, agent] < SETTLING_LIMIT
            success[world, agent] = goes_on and met == 6.0 and settled


@kernel(nogil=True)
def _evaluate_step(data, streams, numbers, targets, statistics, over, start, stop):
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes, craft = data.shape[2], targets.shape[1]
    for world in range(start, stop):
        mean = 0.0
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            mean += data[b, at.OPEN_TIME, w] / craft
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            if episode.new_angle[world, c] > 0.0:
                _restart(episode, world, c)
            episode.since[world, c] += parameters.period
            _assess(data, world, c, targets, parameters.period, episode)
            used = data[b, at.OPEN_TIME, w]
            excess = min(max(used / mean - 1.0, 0.0), 1.0) if mean > 0.0 else 0.0
            angle, spent = episode.angle[world, c], used - episode.open_time[world, c]
            share = spent / (3.0 * parameters.firing_time)
            if parameters.former > 0.0:
                episode.pointing[world, c] = -0.5 * (angle + angle / (angle + _HALF))
                episode.balance[world, c] = -parameters.balance_price * excess
                episode.pulses[world, c] = -parameters.pulse_price * spent / (3.0 * parameters.firing_time)
            else:
                error = 0.5 * (angle / math.pi + angle / (angle + _HALF))
                episode.pointing[world, c] = _POINTED * (1.0 - error)
                episode.balance[world, c] = _POINTED * parameters.balance_price * (1.0 - excess)
                episode.pulses[world, c] = _POINTED * parameters.pulse_price * (1.0 - min(share, 1.0))
            episode.open_time[world, c] = used
            spin = math.sqrt(
                data[b, at.RATE, w] ** 2 + data[b, at.RATE + 1, w] ** 2 + data[b, at.RATE + 2, w] ** 2
            )
            episode.cost[world, c] = max(0.0, spin / parameters.rate_soft_limit - 1.0)
            if not (data[b, at.LOST, w] == 0.0 and spin <= parameters.rate_limit):
                over[world] = 1.0
        for c in range(craft):
            episode.lost[world, c] = -parameters.loss if over[world] > 0.0 else 0.0
        b, w = place(world, 0, craft, lanes)
        if parameters.interval > 0.0 and data[b, at.STEP, w] % parameters.interval == 0.0:
            number = int(data[b, at.STEP, w] / parameters.interval)
            _aim(data, streams, world, number, parameters, targets, episode)


@kernel(nogil=True)
def _observe(data, faults, parts, numbers, arrays, first, shown, observations, start, stop):
    """Write observations, of pulses owed and of faults where they are shown."""
    targets, owed, statistics = arrays
    by_duties, observe_fault = shown
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes, craft, n = data.shape[2], targets.shape[1], owed.shape[2]
    made, pulses = np.empty((pulse.HEALTH_GROUPS, n)), open_vehicle(parts).pulses
    for world in range(start, stop):
        mean = 0.0
        for c in range(craft):
            mean += episode.open_time[world, c] / craft
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
            used = episode.open_time[world, c]
            row[14 + n] = bounded(used / mean - 1.0, _BOUND) if mean > 0.0 else 0.0
            column = 15 + n
            if by_duties:
                for i in range(n):
                    row[column + i] = owed[world, c, i]
                column += n
            if observe_fault:
                time = data[b, at.STEP, w] * parameters.period
                pulse.pulse_health(faults[b, w], time, pulses, made)
                for i in range(n):
                    asked, unasked = pulse.impulses_of(made, i)
                    row[column + i], row[column + n + i] = bounded(asked, 2.0), bounded(unasked, 2.0)
