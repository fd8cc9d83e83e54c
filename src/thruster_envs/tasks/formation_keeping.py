"""Formation keeping as a task: craft hold their slots on a natural relative orbit and share the fuel bill.

Models two to eight like craft around an empty reference point. The slots lie evenly on a circular relative
orbit (Alfriend et al. 2010, section 5.1), which free motion follows without fuel, so that what is to be flown
against is dispersion, sensor noise, thrust scatter, and faults. About an elliptic orbit they lie on the
closed relative orbit that becomes this circle as the eccentricity goes: with the true anomaly ``f``, ``p = 1
+ e cos f`` and the phase ``a`` of a slot, ``x = R/2 sin(f + a)``, ``y = R/2 (1 + 1/p) cos(f + a)``, ``z =
sqrt(3)/2 R/p sin(f + a)``, from the equations of Yamanaka and Ankersen 2002. J2, where the vehicle's orbit
has it, moves craft off their slots. Craft that are not commanded fly with the suite's scripted pilot. Leaves
out drag, and communication limits between the craft.
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
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import errors_of, opener, place
from thruster_envs.physics.orbits import frame_motion, open_ellipse
from thruster_envs.pilots.slots import SlotPilot
from thruster_envs.tasks.access import (
    bounded,
    command_duties,
    disperse,
    draw_start,
    write_oracle_view,
)
from thruster_envs.tasks.contract import (
    EpisodeState,
    FloatArray,
    Observations,
    Outcome,
    Task,
    Truth,
    axis_scale,
    change_fields,
    check_positive,
    check_whole,
    error_fields,
)
from thruster_envs.tasks.pictures import Frame, Picture, distance, fuel_and_score

_BOUND = 5.0
#: What observations are divided by: m, m/s, rad, rad/s; distances between craft, m.
_POSITION, _VELOCITY, _ANGLE, _RATE, _BETWEEN = 10.0, 0.05, 0.5, 0.05, 100.0
#: Half-widths of the dispersion at the start: m, m/s, rad, rad/s.
_DISPERSION = (1.5, 0.005, math.radians(5.0), 1e-3)
#: Control periods of an episode, and what one in the middle of the slot is worth.
_STEPS, _KEPT = 120, 5.0 / 120
#: Worth of being aligned with LVLH, in units of that of the slot, and the angle that halves it, rad.
_ALIGNED, _HALF_ANGLE = 0.5, 0.1


class Parameters(NamedTuple):
    """The configuration in numbers.

    Attributes:
        period: Control period, s.
        mean_motion: rad/s.
        radius: Of the relative orbit on which the slots lie, m.
        slot_tolerance: Distance from the slot within which it counts as kept, m.
        keep_out: Distance between two craft below which there is a cost, m.
        range_limit: Distance from the slot at which the episode ends as a failure, m.
        rate_limit: Body rate at which it does, rad/s.
        fuel_price: Of a thruster-second.
        economy: Worth of a period with all valves shut.
        loss: What a loss costs.
        former: 1 for the reward of v0.
    """

    period: float
    mean_motion: float
    radius: float
    slot_tolerance: float
    keep_out: float
    range_limit: float
    rate_limit: float
    fuel_price: float
    economy: float
    loss: float
    former: float


class Statistics(NamedTuple):
    """Episode statistics, (worlds, craft) each.

    Attributes:
        tracking: Term of the reward of the last step, and the next three likewise.
        attitude: Likewise.
        fuel: Likewise.
        lost: Likewise.
        cost: Of the last step.
        open_time: Thruster-seconds since the reset.
        kept: Steps after which the craft was in its slot.
        collisions: Sum of the cost.
    """

    tracking: FloatArray
    attitude: FloatArray
    fuel: FloatArray
    lost: FloatArray
    cost: FloatArray
    open_time: FloatArray
    kept: FloatArray
    collisions: FloatArray


_parameters, _statistics = opener(Parameters), opener(Statistics, columns=True)


@dataclass(frozen=True)
class FormationModel:
    """The configuration in arrays.

    Attributes:
        authority: (6,), m/s and rad/s per period, infinite where there is none.
        parameters: As :class:`Parameters` names them.
        pilot: Of the craft that nobody commands.
    """

    authority: FloatArray
    parameters: FloatArray
    pilot: SlotPilot


@dataclass
class FormationState(EpisodeState[Statistics]):
    """Arrays of a batch; statistics are (worlds, craft, 7)."""

    model: FormationModel
    phase: FloatArray  # (worlds,), rad, of the first slot at the start
    slots: FloatArray  # (worlds, craft, 6), m and m/s, LVLH, now
    over: FloatArray  # (worlds,), 1 where a craft is lost
    names = Statistics


@dataclass(frozen=True, kw_only=True)
class FormationKeeping(Task):
    """Configuration of ``formation_keeping_v1``.

    Attributes:
        craft: Number of craft, 2 to 8.
        commanded: How many of them are commanded, counted from the first; None for all. The others fly with
            the scripted pilot.
        radius: Of the relative orbit on which the slots lie, m.
        slot_tolerance: Distance from the slot within which it counts as kept, m.
        keep_out: Distance between two craft below which ``cost`` counts, m.
        range_limit: Distance from the slot at which the episode ends as a failure, m.
        rate_limit: Body rate at which it does, rad/s.
        fuel_price: Worth of all thrusters of one craft open for a whole period, in units of what keeping
            the slot is worth.
    """

    craft: int = 3
    commanded: int | None = None
    radius: float = 50.0
    slot_tolerance: float = 1.0
    keep_out: float = 10.0
    range_limit: float = 100.0
    rate_limit: float = 1.0
    fuel_price: float = 0.5

    reward_terms: ClassVar[tuple[str, ...]] = ("tracking", "attitude", "fuel", "lost")
    former_reward: ClassVar[bool] = False
    max_episode_steps: ClassVar[int | None] = _STEPS
    one_agent: ClassVar[dict[str, Any]] = {"commanded": 1}
    takes_storage: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_whole("craft", self.craft, 2, 8)
        if self.commanded is not None:
            check_whole("commanded", self.commanded, 1, self.craft)
        check_positive(
            self, "radius", "slot_tolerance", "keep_out", "range_limit", "rate_limit", "fuel_price"
        )

    @property
    def number_of_craft(self) -> int:
        """Craft in a world."""
        return self.craft

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Names of the commanded craft."""
        return super().agents[: self.commanded]

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        n = self.action_size
        return (
            Field("position", "measured position relative to the slot", 3, "m", _POSITION, bound=_BOUND),
            Field("velocity", "measured velocity relative to the slot", 3, "m/s", _VELOCITY, bound=_BOUND),
            *error_fields(_ANGLE, _RATE, _BOUND),
            Field("duties", "last duties", n, lowest=0.0),
            *change_fields(self.vehicle, _BOUND),
            Field(
                "fuel_excess", "own fuel over the formation's mean, less one", 1, bound=_BOUND, lowest=-1.0
            ),
            Field(
                "others",
                "measured positions of the other craft",
                3 * (self.craft - 1),
                "m",
                _BETWEEN,
                bound=_BOUND,
            ),
            *self.oracle_fields(),
        )

    @property
    def most_worth(self) -> float:
        """The most that an episode can be worth to an agent, which is what a loss costs."""
        return _STEPS * _KEPT * (1.0 + _ALIGNED + self.fuel_price)

    def create(self, worlds: int, threads: int | None) -> FormationState:
        """Arrays for that many worlds."""
        vehicle = self.vehicle
        price = self.fuel_price / (vehicle.number_of_thrusters * vehicle.control_period)
        parameters = self.numbers(
            Parameters,
            fuel_price=price,
            economy=self.fuel_price,
            loss=self.most_worth,
            former=self.former_reward,
        )
        return FormationState(
            self.make_fleet(worlds, threads),
            np.zeros((worlds, self.craft, len(Statistics._fields))),
            FormationModel(axis_scale(vehicle), parameters, SlotPilot.of(vehicle)),
            phase=np.zeros(worlds),
            slots=np.zeros((worlds, self.craft, 6)),
            over=np.zeros(worlds),
        )

    def reset(self, state: FormationState, which: NDArray[np.int64]) -> None:
        """Start near the slots, which begin at a random phase of the relative orbit."""
        fleet = state.fleet
        _start(
            fleet.data,
            fleet.streams,
            which,
            state.model.parameters,
            fleet.ellipses(),
            state.phase,
            state.slots,
            state.statistics,
            state.over,
        )
        fleet.look(which)

    def step(self, state: FormationState, duties: FloatArray) -> None:
        """Fly one period; the craft that nobody commands fly by the scripted pilot."""
        fleet, model, commanded = state.fleet, state.model, duties.shape[1]
        command_duties(fleet.data, duties, self.craft)
        if commanded < self.craft:
            model.pilot.fly(fleet.data, state.slots, commanded, self.craft, fleet.worlds)
        fleet.fly()
        _evaluate_step(
            fleet.data, model.parameters, fleet.ellipses(), state.phase, state.slots, state.statistics,
            state.over,
        )  # fmt: skip

    def observe(self, state: FormationState) -> Observations:
        """(worlds, agents, observation_size)."""
        observations = np.empty((state.fleet.worlds, len(self.agents), self.observation_size), np.float32)
        _observe(
            state.fleet.data, state.fleet.faults, state.model.parameters, state.model.authority, state.slots,
            state.statistics, self.observe_fault, self.action_size, observations,
        )  # fmt: skip
        return observations

    def outcome(self, state: FormationState) -> Outcome:
        """Terminates for all when a craft is lost."""
        agents = len(self.agents)
        terms = state.statistics[:, :agents, : len(self.reward_terms)]
        return Outcome(terms, state.episode.cost[:, :agents], state.over)

    def truth(self, state: FormationState) -> Truth:
        """The score is the share of steps in which the slot was kept; a collision cost rules success out."""
        fuel, score, success = np.empty((3, state.fleet.worlds, len(self.agents)))
        _rate(state.fleet.data, state.statistics, state.over, fuel, score, success)
        return Truth(fuel, score, success)

    def picture(self, frame: Frame) -> Picture:
        """The craft with their slots."""
        state: FormationState = frame.state
        world = frame.world
        slots, places = state.slots[world, :, :3], state.fleet.read(at.POSITION, 3)[world]
        readouts = (distance(places[0], slots[0]), *fuel_and_score(frame))
        return Picture(readouts=readouts, targets=slots)


@njit
def _slot(phase, radius, n):
    """Place (m) and velocity (m/s) of a slot on the circular relative orbit, a circle about the reference."""
    s, c = math.sin(phase), math.cos(phase)
    half, out = 0.5 * radius, 0.5 * math.sqrt(3.0) * radius
    return half * s, radius * c, out * s, half * n * c, -radius * n * s, out * n * c


@njit
def _elliptic_slot(phase, radius, ellipse):
    """The same about an elliptic orbit."""
    motion, e = frame_motion(ellipse, ellipse.time), ellipse.eccentricity
    rate, inverse = motion.rate, 1.0 / (1.0 + e * math.cos(ellipse.anomaly))
    bend = e * math.sin(ellipse.anomaly) * inverse * inverse  # rate of the inverse with the anomaly
    s, c = math.sin(phase), math.cos(phase)
    half, out = 0.5 * radius, 0.5 * math.sqrt(3.0) * radius
    turn, rise = rate * half, rate * out
    return (
        half * s, half * (1.0 + inverse) * c, out * inverse * s,
        turn * c, turn * (bend * c - (1.0 + inverse) * s), rise * (inverse * c + bend * s),
    )  # fmt: skip


@njit
def _place_slots(world, phase, step, parameters, ellipses, slots):
    craft, n = slots.shape[0], parameters.mean_motion
    for c in range(craft):
        behind = phase + 2.0 * math.pi * c / craft
        if ellipses is not None:
            ellipse = open_ellipse(ellipses[world])
            place_and_speed = _elliptic_slot(behind + ellipse.angle, parameters.radius, ellipse)
        else:
            place_and_speed = _slot(behind + n * step * parameters.period, parameters.radius, n)
        for k in range(6):
            slots[c, k] = place_and_speed[k]


@kernel
def _start(data, streams, which, numbers, ellipses, phase, slots, statistics, over):
    parameters = _parameters(numbers)
    lanes, craft = data.shape[2], slots.shape[1]
    uniform = np.empty(16)
    for world in which:
        over[world] = 0.0
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            draw_start(streams, b, w, c, uniform)
            if c == 0:
                phase[world] = 2.0 * math.pi * uniform[15]
                _place_slots(world, phase[world], 0.0, parameters, ellipses, slots[world])
            disperse(data, b, w, uniform, slots[world, c, :3], slots[world, c, 3:], _DISPERSION)
            statistics[world, c] = 0.0


@kernel
def _evaluate_step(data, numbers, ellipses, phase, slots, statistics, over):
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes, craft = data.shape[2], slots.shape[1]
    for world in range(slots.shape[0]):
        b, w = place(world, 0, craft, lanes)
        _place_slots(world, phase[world], data[b, at.STEP, w], parameters, ellipses, slots[world])
        bill = 0.0
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            bill += (data[b, at.OPEN_TIME, w] - episode.open_time[world, c]) / craft
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            away = 0.0
            for k in range(3):
                away += (data[b, at.POSITION + k, w] - slots[world, c, k]) ** 2
            away = math.sqrt(away)
            angle, spin = errors_of(data, at.POSITION, b, w)
            tilt = math.sqrt(angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2)
            spinning = math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
            nearest = math.inf
            for other in range(craft):
                if other != c:
                    b2, w2 = place(world, other, craft, lanes)
                    distance = 0.0
                    for k in range(3):
                        distance += (data[b, at.POSITION + k, w] - data[b2, at.POSITION + k, w2]) ** 2
                    nearest = min(nearest, math.sqrt(distance))
            if parameters.former > 0.0:
                episode.tracking[world, c] = -min(away / _POSITION, 1.0)
                episode.attitude[world, c] = -0.5 * min(tilt, 1.0)
                episode.fuel[world, c] = -parameters.fuel_price * bill
            else:
                kept = parameters.slot_tolerance / (parameters.slot_tolerance + away)
                saved = max(parameters.economy - parameters.fuel_price * bill, 0.0)
                episode.tracking[world, c] = _KEPT * kept
                episode.attitude[world, c] = _KEPT * _ALIGNED * _HALF_ANGLE / (_HALF_ANGLE + tilt)
                episode.fuel[world, c] = _KEPT * saved
            episode.cost[world, c] = max(0.0, 1.0 - nearest / parameters.keep_out)
            episode.collisions[world, c] += episode.cost[world, c]
            episode.open_time[world, c] = data[b, at.OPEN_TIME, w]
            episode.kept[world, c] += 1.0 if away <= parameters.slot_tolerance else 0.0
            followed = data[b, at.LOST, w] == 0.0
            if not (followed and away <= parameters.range_limit and spinning <= parameters.rate_limit):
                over[world] = 1.0
        for c in range(craft):
            episode.lost[world, c] = -parameters.loss if over[world] > 0.0 else 0.0


@kernel
def _rate(data, statistics, over, fuel, score, success):
    """Fuel, score and success of every agent, (worlds, agents) each."""
    episode = _statistics(statistics)
    lanes, craft = data.shape[2], statistics.shape[1]
    for world in range(score.shape[0]):
        for c in range(score.shape[1]):
            b, w = place(world, c, craft, lanes)
            kept = episode.kept[world, c] / max(data[b, at.STEP, w], 1.0)
            fuel[world, c], score[world, c] = episode.open_time[world, c], kept
            success[world, c] = kept >= 0.8 and episode.collisions[world, c] == 0.0 and over[world] == 0.0


@kernel
def _observe(data, faults, numbers, authority, slots, statistics, observe_fault, n, observations):
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes, craft, m = data.shape[2], slots.shape[1], at.MEASURED
    for world in range(observations.shape[0]):
        mean = 0.0
        for c in range(craft):
            mean += episode.open_time[world, c] / craft
        for c in range(observations.shape[1]):
            b, w = place(world, c, craft, lanes)
            row = observations[world, c]
            angle, spin = errors_of(data, m, b, w)
            for k in range(3):
                row[k] = bounded((data[b, m + k, w] - slots[world, c, k]) / _POSITION, _BOUND)
                row[3 + k] = bounded((data[b, m + 3 + k, w] - slots[world, c, 3 + k]) / _VELOCITY, _BOUND)
                row[6 + k] = bounded(angle[k] / _ANGLE, _BOUND)
                row[9 + k] = bounded(spin[k] / _RATE, _BOUND)
            for i in range(n):
                row[12 + i] = data[b, at.DUTIES + i, w]
            for k in range(6):
                row[12 + n + k] = bounded(data[b, at.MEASURED_CHANGE + k, w] / authority[k], _BOUND)
                row[18 + n + k] = bounded(data[b, at.EXPECTED_CHANGE + k, w] / authority[k], _BOUND)
            row[24 + n] = bounded(episode.open_time[world, c] / mean - 1.0, _BOUND) if mean > 0.0 else 0.0
            column = 25 + n
            for other in range(craft):
                if other != c:
                    b2, w2 = place(world, other, craft, lanes)
                    for k in range(3):
                        between = data[b2, m + k, w2] - data[b, m + k, w]
                        row[column + k] = bounded(between / _BETWEEN, _BOUND)
                    column += 3
            if observe_fault:
                start = data[b, at.STEP, w] * parameters.period
                write_oracle_view(faults, b, w, start, parameters.period, row, column)
