"""Diagnosis as a task: watch a flight under a fixed pilot, and say which thruster has failed and how.

Models a craft that flies from slot to slot under a pilot that knows of no fault, in six degrees of freedom,
with the coupling of the feed, scatter and sensor noise of its description. At the beginning of each control
period the agent declares what it believes: no fault, or one thruster and one mode
(:data:`thruster_envs.faults.MODES`). It is judged by what acts at that moment. Slots change so that every
thruster fires in every flight. Leaves out what a diagnosis is good for: the pilot does not hear of it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.faults import MODES, Fault, FaultDistribution
from thruster_envs.faults import encoding as code
from thruster_envs.faults.modes import mode_number
from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import errors_of, opener, place
from thruster_envs.pilots.slots import SlotPilot
from thruster_envs.protocols import Sight
from thruster_envs.random import COMMAND, philox, uniform_pair
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
    change_fields,
    check_not_negative,
    check_positive,
    check_whole,
    clock_field,
    error_fields,
    per_period,
)
from thruster_envs.tasks.pictures import Frame, Picture, distance, fuel_and_score
from thruster_envs.tasks.thruster_mapping import MappingModel

#: Control periods of a flight.
FLIGHT = 120
#: Natural frequencies of the scripted pilot in translation and rotation, rad per control period: on Orion
#: 0.02 rad/s, and 0.06 rad/s so that one failed thruster does not make the craft tumble.
TRANSLATION, ROTATION = 0.1, 0.3
_BOUND = 5.0
#: What observations are divided by: m, m/s, rad, rad/s.
_POSITION, _VELOCITY, _ANGLE, _RATE = 10.0, 0.2, 0.5, 0.2
#: Half-widths of the dispersion at the start: m, m/s, rad, rad/s.
_DISPERSION = (1.5, 0.005, math.radians(5.0), 1e-3)
#: Share of the credit for naming the thruster when the mode is wrong.
_HALF_RIGHT = 0.5


class Parameters(NamedTuple):
    """The configuration in numbers.

    Attributes:
        period: Control period, s.
        reach: Half-size of the cube in which slots are drawn, m.
        leg: Control periods from one slot change to the next.
        range_limit: Distance from the slot at which the flight is lost, m.
        rate_limit: Body rate at which it is lost, rad/s.
        rate_soft_limit: Body rate from which on there is a cost, rad/s.
        right_worth: Of a control period in which the faulty thruster is declared.
        delay_cost: Of one in which a fault is not noticed.
        false_alarm_cost: Of one in which a fault is declared that is not there.
        wrong_name_cost: Of one in which a healthy thruster is declared.
        wrong_mode_cost: Of one in which the thruster is right and the mode is not.
        loss: What a loss costs; 0 where the agent has no part in the flight.
        left_cost: Of a control period that is left at a loss.
    """

    period: float
    reach: float
    leg: float
    range_limit: float
    rate_limit: float
    rate_soft_limit: float
    right_worth: float
    delay_cost: float
    false_alarm_cost: float
    wrong_name_cost: float
    wrong_mode_cost: float
    loss: float
    left_cost: float


class Statistics(NamedTuple):
    """Episode statistics, (worlds,) each.

    Attributes:
        lost: Term of the reward of the last step, and the next five likewise.
        right: Likewise.
        delay: Likewise.
        false_alarm: Likewise.
        wrong_name: Likewise.
        fuel: Likewise, of test pulses.
        cost: Of the last step.
        healthy_steps: Steps without a fault.
        faulty_steps: Steps with one.
        false_steps: Steps with a false alarm.
        credit: Sum of the credit for declarations.
        alarms: Number of false alarms.
        onset: Of the first fault that was seen to act, s; -1 for not yet.
        noticed: Time from then until it was noticed, s; -1 for not yet.
        under_fault: Whether a fault acted at the last declaration.
        isolated: Whether its thruster was right.
        identified: Whether its thruster and mode were right.
        over: 1 where the flight is lost.
        tested: Thruster-seconds of test pulses since the reset.
    """

    lost: FloatArray
    right: FloatArray
    delay: FloatArray
    false_alarm: FloatArray
    wrong_name: FloatArray
    fuel: FloatArray
    cost: FloatArray
    healthy_steps: FloatArray
    faulty_steps: FloatArray
    false_steps: FloatArray
    credit: FloatArray
    alarms: FloatArray
    onset: FloatArray
    noticed: FloatArray
    under_fault: FloatArray
    isolated: FloatArray
    identified: FloatArray
    over: FloatArray
    tested: FloatArray


open_parameters, open_statistics = opener(Parameters), opener(Statistics, columns=True)


@dataclass(frozen=True)
class DiagnosisModel:
    """The configuration in arrays.

    Attributes:
        authority: (6,), m/s and rad/s per period, infinite where there is none.
        projection: (n, 6), turns a rate change into the on-time of one thruster that explains it best, in
            periods.
        parameters: As :class:`Parameters` names them.
        pilot: The scripted one.
    """

    authority: FloatArray
    projection: FloatArray
    parameters: FloatArray
    pilot: SlotPilot


@dataclass
class DiagnosisState(EpisodeState[Statistics]):
    """Arrays of a batch."""

    model: DiagnosisModel
    slots: FloatArray  # (worlds, 1, 6), m and m/s, LVLH, now
    declared: NDArray[np.int64]  # (worlds, 2), the last declaration: thruster from 1 (0: none), mode
    standing: NDArray[np.int64]  # (worlds,), the thruster in it when the first fault was seen to act
    names = Statistics


@dataclass(frozen=True, kw_only=True)
class FaultDiagnosis(Task):
    """Configuration of ``FaultDiagnosis-v1``.

    ``faults`` None means the default distribution, an empty list no faults.

    Attributes:
        pilot: None for the scripted pilot, or a :class:`~thruster_envs.protocols.Pilot`.
        reach: Half-size of the cube about the origin in which slots are drawn, m; None for that from which
            the scripted pilot goes back to the origin with a third of the vehicle's authority.
        leg: Control periods from one slot change to the next.
        right_worth: What it is worth to declare the faulty thruster in its mode during a whole flight.
        delay_cost: What it costs not to notice a fault, likewise.
        false_alarm_cost: What it costs to declare a fault that is not there, likewise.
        wrong_name_cost: What it costs to declare a sound thruster instead of the faulty one, likewise.
        wrong_mode_cost: What it costs to declare the faulty thruster in another mode, likewise.
        range_limit: Distance from the slot at which the flight is lost, m.
        rate_limit: Body rate at which it is lost, rad/s.
    """

    pilot: Any = None
    reach: float | None = None
    leg: int = 15
    right_worth: float = 5.0
    delay_cost: float = 2.5
    false_alarm_cost: float = 5.0
    wrong_name_cost: float = 4.0
    wrong_mode_cost: float = 2.5
    range_limit: float = 500.0
    rate_limit: float = 1.0

    reward_terms: ClassVar[tuple[str, ...]] = ("right", "delay", "false_alarm", "wrong_name")
    max_episode_steps: ClassVar[int | None] = FLIGHT

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pilot is not None and not callable(self.pilot):
            raise ValueError(f"pilot is {self.pilot!r}; None or a callable would be right")
        check_whole("leg", self.leg, 1, FLIGHT)
        check_positive(self, "range_limit", "rate_limit")
        reach = () if self.reach is None else ("reach",)
        check_not_negative(
            self,
            *reach,
            "right_worth",
            "delay_cost",
            "false_alarm_cost",
            "wrong_name_cost",
            "wrong_mode_cost",
        )

    @cached_property
    def choices(self) -> tuple[int, ...] | None:
        """Thruster, from 1, or 0 for no fault; mode."""
        return (self.vehicle.number_of_thrusters + 1, len(MODES))

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        n = self.vehicle.number_of_thrusters
        return (
            Field("position", "measured position relative to the slot", 3, "m", _POSITION, bound=_BOUND),
            Field("velocity", "measured velocity", 3, "m/s", _VELOCITY, bound=_BOUND),
            *error_fields(_ANGLE, _RATE, _BOUND),
            clock_field(
                "time", "time since the start", FLIGHT * self.vehicle.control_period, "length of the flight"
            ),
            Field("duties", "last duties", n, lowest=0.0),
            *change_fields(self.vehicle, _BOUND),
            Field(
                "unexpected_on_time",
                "measured less expected rate change, projected on each thruster",
                n,
                bound=_BOUND,
                **per_period(self.vehicle),
            ),
            Field("declared_thruster", "whether each thruster was declared last", n, lowest=0.0),
            Field("declared_mode", "whether each mode was declared last", len(MODES), lowest=0.0),
            *self.further_fields(),
            *self.oracle_fields(),
        )

    def further_fields(self) -> tuple[Field, ...]:
        """What a variant of the task observes beyond that."""
        return ()

    def default_faults(self) -> tuple[Fault, ...] | FaultDistribution:
        """In four flights of five, one thruster that fails in the first half, in any mode."""
        return FaultDistribution(
            probability=0.8,
            kinds={"stuck_off": 1.0, "loss": 2.0, "leak": 1.0, "stuck_on": 1.0, "misalignment": 1.0},
            severity={
                "loss": (0.3, 0.9),
                "leak": (0.1, 0.5),
                "stuck_on": (0.5, 1.0),
                "misalignment": (0.2, 0.5),
            },
            onset=(0.0, 0.5 * FLIGHT * self.vehicle.control_period),
        )

    def create(self, worlds: int, threads: int | None) -> DiagnosisState:
        """Arrays for that many worlds."""
        return DiagnosisState(
            self.make_fleet(worlds, threads), np.zeros((worlds, len(Statistics._fields))), self._model(),
            np.zeros((worlds, 1, 6)), np.zeros((worlds, 2), np.int64), np.zeros(worlds, np.int64),
        )  # fmt: skip

    def _model(self) -> DiagnosisModel:
        vehicle, period = self.vehicle, self.vehicle.control_period
        numbers = MappingModel.of(vehicle)
        frequencies = TRANSLATION / period, ROTATION / period
        pull = frequencies[0] ** 2 * period  # m/s that the pilot asks for in a period, for each m of distance
        reach = vehicle.authority()[:3].min() / (3.0 * pull) if self.reach is None else self.reach
        parameters = self.numbers(
            Parameters, reach=reach, rate_soft_limit=self.rate_soft_limit(),
            right_worth=self.right_worth / FLIGHT, delay_cost=self.delay_cost / FLIGHT,
            false_alarm_cost=self.false_alarm_cost / FLIGHT, wrong_name_cost=self.wrong_name_cost / FLIGHT,
            wrong_mode_cost=self.wrong_mode_cost / FLIGHT, loss=self.loss(),
            left_cost=self.worst_cost() / FLIGHT,
        )  # fmt: skip
        pilot = dataclasses.replace(SlotPilot.of(vehicle), frequencies=frequencies)
        return DiagnosisModel(numbers.authority, numbers.projection, parameters, pilot)

    def loss(self) -> float:
        """What a loss costs beside the periods that are left: the agent has no part in the flight."""
        return 0.0

    def worst_cost(self) -> float:
        """The most that declarations can cost in a whole flight."""
        return max(self.delay_cost, self.false_alarm_cost, self.wrong_name_cost, self.wrong_mode_cost)

    def rate_soft_limit(self) -> float:
        """Body rate from which on ``cost`` counts, rad/s: none, the agent has no part in the flight."""
        return math.inf

    def reset(self, state: DiagnosisState, which: NDArray[np.int64]) -> None:
        """Start near the origin, nearly at rest, with the first slot drawn."""
        fleet = state.fleet
        _start(
            fleet.data, fleet.streams, which, state.model.parameters, state.slots, state.declared,
            state.standing, state.statistics,
        )  # fmt: skip
        fleet.look(which)

    def step(self, state: DiagnosisState, actions: NDArray[np.int64]) -> None:
        """Hear the declarations, then fly one period."""
        fleet, parameters = state.fleet, state.model.parameters
        fleet.by_worlds(
            lambda first, last: _evaluate_declaration(
                fleet.data, fleet.faults, actions, parameters, state.declared, state.standing,
                state.statistics, first, last,
            )
        )  # fmt: skip
        self._steer(state)
        self.intervene(state, actions)
        fleet.fly()
        fleet.by_worlds(
            lambda first, last: _evaluate_flight(
                fleet.data, fleet.streams, parameters, state.slots, state.declared, state.statistics,
                first, last,
            )
        )  # fmt: skip

    def _steer(self, state: DiagnosisState) -> None:
        """Write the pilot's duties."""
        fleet = state.fleet
        if self.pilot is None:
            state.model.pilot.fly(fleet.data, state.slots, 0, 1, fleet.worlds)
            return
        duties = piloted(self.pilot, _sight(state, self.vehicle.control_period))
        command_duties(fleet.data, duties[:, np.newaxis], 1)

    def intervene(self, state: DiagnosisState, actions: NDArray[np.int64]) -> None:
        """What a variant of the task does to the duties before they are flown."""

    def observe(self, state: DiagnosisState) -> Observations:
        """(worlds, 1, observation_size)."""
        observations = np.empty((state.fleet.worlds, 1, self.observation_size), np.float32)
        rows, fleet, model = observations[:, 0], state.fleet, state.model
        fleet.by_worlds(
            lambda first, last: _observe(
                fleet.data, fleet.faults, model.parameters, (model.authority, model.projection), state.slots,
                state.declared, self.observe_fault, rows, first, last,
            )
        )  # fmt: skip
        return observations

    def outcome(self, state: DiagnosisState) -> Outcome:
        """Terminates when the flight is lost."""
        first = Statistics._fields.index(self.reward_terms[0])
        terms = state.statistics[:, np.newaxis, first : first + len(self.reward_terms)]
        return Outcome(terms, state.episode.cost[:, np.newaxis], state.episode.over)

    def truth(self, state: DiagnosisState) -> Truth:
        """The score is the mean credit under a fault times the share of other time without a false alarm."""
        fuel, score, success = np.empty((3, state.fleet.worlds, 1))
        _rate(state.fleet.data, state.statistics, state.declared, self.loss() > 0.0, fuel, score, success)
        return Truth(fuel, score, success)

    def report(self, state: DiagnosisState) -> dict[str, dict[str, NDArray[Any]]]:
        """How the diagnosis went, and what would be right to declare now."""
        episode = state.episode
        right = np.zeros((state.fleet.worlds, 2), np.int64)
        _right_now(state.fleet.data, state.fleet.faults, self.vehicle.control_period, right)
        return {
            "diagnosis": {
                "detected": episode.noticed[:, np.newaxis] >= 0.0,
                "delay": episode.noticed[:, np.newaxis].copy(),
                "false_alarms": episode.alarms[:, np.newaxis].astype(np.int64),
                "isolated": episode.isolated[:, np.newaxis] > 0.0,
                "identified": episode.identified[:, np.newaxis] > 0.0,
                "thruster": right[:, :1].copy(),
                "mode": right[:, 1:].copy(),
            }
        }

    def picture(self, frame: Frame) -> Picture:
        """The craft with its slot, and what was declared last."""
        state: DiagnosisState = frame.state
        world = frame.world
        slots, places = state.slots[world, :, :3], state.fleet.read(at.POSITION, 3)[world]
        thruster, mode = state.declared[world]
        declared = f"thruster {thruster} {MODES[mode]}" if thruster > 0 else "no fault"
        readouts = (distance(places[0], slots[0]), *fuel_and_score(frame), ("declared", declared))
        return Picture(readouts=readouts, targets=slots)


def piloted(pilot: Callable[[Sight], Any], sight: Sight) -> FloatArray:
    """The duties (worlds, n) of a user's pilot, 0..1.

    Raises:
        ValueError: Another shape, or a number that is not finite.
    """
    duties = np.asarray(pilot(sight), dtype=np.float64)
    if duties.shape != sight.duties.shape:
        raise ValueError(
            f"the pilot's duties have the shape {duties.shape}; {sight.duties.shape} would be right"
        )
    if not np.isfinite(duties).all():
        world, thruster = np.argwhere(~np.isfinite(duties))[0]
        raise ValueError(
            f"the pilot's duty of world {world}, thruster {thruster + 1} is {duties[world, thruster]}; "
            "a number from 0 to 1 would be right"
        )
    return np.clip(duties, 0.0, 1.0)


def _sight(state: DiagnosisState, period: float) -> Sight:
    fleet, n = state.fleet, state.fleet.rows.thrusters
    measured = fleet.read(at.MEASURED, 13)[:, 0]
    return Sight(
        time=fleet.read(at.STEP)[:, 0, 0] * period,
        target=state.slots[:, 0].copy(),
        position=measured[:, :3],
        velocity=measured[:, 3:6],
        attitude=measured[:, 6:10],
        rate=measured[:, 10:],
        duties=fleet.read(fleet.rows.duties, n)[:, 0],
        measured_change=fleet.read(at.MEASURED_CHANGE, 6)[:, 0],
        expected_change=fleet.read(at.EXPECTED_CHANGE, 6)[:, 0],
    )


@njit
def _draw_slot(data, streams, b, w, reach, slot):
    """Draw where the craft should be from now on, at rest, from its seed, episode and step."""
    words = philox(
        np.uint64(0), np.uint64(np.int64(data[b, at.STEP, w])), streams[b, at.EPISODE, w],
        np.uint64(COMMAND << 32), streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
    )  # fmt: skip
    x, y = uniform_pair(words[0])
    z, _ = uniform_pair(words[1])
    slot[0], slot[1], slot[2] = reach * (2.0 * x - 1.0), reach * (2.0 * y - 1.0), reach * (2.0 * z - 1.0)


@kernel
def _start(data, streams, which, numbers, slots, declared, standing, statistics):
    parameters, episode = open_parameters(numbers), open_statistics(statistics)
    lanes = data.shape[2]
    uniform = np.empty(16)
    for world in which:
        b, w = place(world, 0, 1, lanes)
        draw_start(streams, b, w, 0, uniform)
        disperse(data, b, w, uniform, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), _DISPERSION)
        slots[world, 0, :] = 0.0
        _draw_slot(data, streams, b, w, parameters.reach, slots[world, 0])
        declared[world, :], standing[world] = 0, 0
        statistics[world] = 0.0
        episode.onset[world], episode.noticed[world] = -1.0, -1.0


@njit
def _first_fault(faults, b, w, time):
    """Slot of the fault that acts at ``time`` and began first; -1 for none."""
    first = -1
    for slot in range(faults.shape[2]):
        fault = faults[b, w, slot]
        if health.is_between(fault, time) and (
            first < 0 or fault[code.FIELD_ONSET] < faults[b, w, first, code.FIELD_ONSET]
        ):
            first = slot
    return first


@kernel
def _right_now(data, faults, period, right):
    """Write what would be right to declare, (worlds, 2): thruster from 1 (0: none) and mode."""
    for world in range(right.shape[0]):
        b, w = place(world, 0, 1, data.shape[2])
        slot = _first_fault(faults, b, w, data[b, at.STEP, w] * period)
        if slot >= 0:
            fault = faults[b, w, slot]
            right[world, 0] = health.thruster_of(fault) + 1
            right[world, 1] = mode_number(int(fault[code.FIELD_KIND]), fault[code.FIELD_SEVERITY])


@njit
def _credit(episode, world):
    """What the last declaration is worth under a fault, 0..1."""
    return 1.0 if episode.identified[world] > 0.0 else (_HALF_RIGHT if episode.isolated[world] > 0.0 else 0.0)


@kernel(nogil=True)
def _evaluate_declaration(
    data, faults, actions, numbers, declared, standing, statistics, first, last
):  # fmt: skip
    """Compare what is declared with what acts now, in the worlds from ``first`` to ``last`` (exclusive)."""
    parameters, episode = open_parameters(numbers), open_statistics(statistics)
    for world in range(first, last):
        b, w = place(world, 0, 1, data.shape[2])
        time = data[b, at.STEP, w] * parameters.period
        thruster, mode = actions[world, 0, 0], actions[world, 0, 1]
        oldest = _first_fault(faults, b, w, time)
        isolated, identified = False, False
        for slot in range(faults.shape[2]):
            fault = faults[b, w, slot]
            if health.is_between(fault, time) and health.thruster_of(fault) + 1 == thruster:
                isolated = True
                identified |= mode == mode_number(int(fault[code.FIELD_KIND]), fault[code.FIELD_SEVERITY])
        episode.right[world], episode.lost[world] = 0.0, 0.0
        episode.delay[world], episode.false_alarm[world], episode.wrong_name[world] = 0.0, 0.0, 0.0
        episode.fuel[world], episode.cost[world] = 0.0, 0.0
        episode.under_fault[world] = 1.0 if oldest >= 0 else 0.0
        episode.isolated[world] = 1.0 if isolated else 0.0
        episode.identified[world] = 1.0 if identified else 0.0
        if oldest >= 0:
            episode.faulty_steps[world] += 1.0
            if episode.onset[world] < 0.0:
                episode.onset[world] = faults[b, w, oldest, code.FIELD_ONSET]
                standing[world] = declared[world, 0]
            new = thruster > 0 and (thruster != standing[world] or isolated)
            if episode.noticed[world] < 0.0 and new:
                episode.noticed[world] = time - episode.onset[world]
            if thruster == 0:
                episode.delay[world] = -parameters.delay_cost
            elif not isolated:
                episode.wrong_name[world] = -parameters.wrong_name_cost
            elif not identified:
                episode.wrong_name[world] = -parameters.wrong_mode_cost
            episode.right[world] = parameters.right_worth if isolated else 0.0
            episode.credit[world] += _credit(episode, world)
        else:
            episode.healthy_steps[world] += 1.0
            if thruster > 0:
                episode.false_alarm[world] = -parameters.false_alarm_cost
                episode.false_steps[world] += 1.0
                episode.alarms[world] += 1.0 if thruster != declared[world, 0] else 0.0
        declared[world, 0], declared[world, 1] = thruster, mode


@kernel(nogil=True)
def _evaluate_flight(data, streams, numbers, slots, declared, statistics, first, last):
    """Look where the period has led; a lost flight is scored as if its last declaration stood to the end."""
    parameters, episode = open_parameters(numbers), open_statistics(statistics)
    for world in range(first, last):
        b, w = place(world, 0, 1, data.shape[2])
        slot, distance, turning = slots[world, 0], 0.0, 0.0
        _, spin = errors_of(data, at.POSITION, b, w)
        for k in range(3):
            distance += (data[b, at.POSITION + k, w] - slot[k]) ** 2
            turning += spin[k] * spin[k]
        turning = math.sqrt(turning)
        episode.cost[world] = max(0.0, turning / parameters.rate_soft_limit - 1.0)
        near = math.sqrt(distance) <= parameters.range_limit and turning <= parameters.rate_limit
        lost = not (near and data[b, at.LOST, w] == 0.0)
        if lost and episode.over[world] == 0.0:
            left = max(0.0, FLIGHT - data[b, at.STEP, w])
            if parameters.loss > 0.0:
                episode.lost[world] = -parameters.loss - parameters.left_cost * left
            else:
                for term in (episode.delay, episode.false_alarm, episode.wrong_name):
                    term[world] *= 1.0 + left
            if episode.under_fault[world] > 0.0:
                episode.faulty_steps[world] += left
                episode.credit[world] += left * _credit(episode, world)
            else:
                episode.healthy_steps[world] += left
                episode.false_steps[world] += left if declared[world, 0] > 0 else 0.0
        if lost:
            episode.over[world] = 1.0
        if data[b, at.STEP, w] % parameters.leg == 0.0:
            _draw_slot(data, streams, b, w, parameters.reach, slot)


@kernel
def _rate(data, statistics, declared, flown, fuel, score, success):
    """Fuel, score and success of every world, (worlds, 1) each; none for a loss where the agent has flown."""
    episode = open_statistics(statistics)
    for world in range(statistics.shape[0]):
        b, w = place(world, 0, 1, data.shape[2])
        fuel[world, 0] = data[b, at.OPEN_TIME, w]
        faulty, healthy = episode.faulty_steps[world], episode.healthy_steps[world]
        credit = episode.credit[world] / faulty if faulty > 0.0 else 1.0
        no_alarm = 1.0 - episode.false_steps[world] / healthy if healthy > 0.0 else 1.0
        begun = faulty + healthy > 0.0 and not (flown and episode.over[world] > 0.0)
        right = declared[world, 0] == 0
        if episode.under_fault[world] > 0.0:
            right = episode.identified[world] > 0.0
        score[world, 0] = credit * no_alarm if begun else 0.0
        success[world, 0] = begun and right and episode.alarms[world] == 0.0


@kernel(nogil=True)
def _observe(data, faults, numbers, model, slots, declared, observe_fault, observations, first, last):
    parameters, (authority, projection) = open_parameters(numbers), model
    n, lanes, m = projection.shape[0], data.shape[2], at.MEASURED
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        row = observations[world]
        angle, spin = errors_of(data, m, b, w)
        for k in range(3):
            row[k] = bounded((data[b, m + k, w] - slots[world, 0, k]) / _POSITION, _BOUND)
            row[3 + k] = bounded(data[b, m + 3 + k, w] / _VELOCITY, _BOUND)
            row[6 + k] = bounded(angle[k] / _ANGLE, _BOUND)
            row[9 + k] = bounded(spin[k] / _RATE, _BOUND)
        row[12] = min(data[b, at.STEP, w] / FLIGHT, 1.0)
        for k in range(6):
            row[13 + n + k] = bounded(data[b, at.MEASURED_CHANGE + k, w] / authority[k], _BOUND)
            row[19 + n + k] = bounded(data[b, at.EXPECTED_CHANGE + k, w] / authority[k], _BOUND)
        for i in range(n):
            row[13 + i] = data[b, at.DUTIES + i, w]
            along = 0.0
            for k in range(6):
                along += projection[i, k] * (
                    data[b, at.MEASURED_CHANGE + k, w] - data[b, at.EXPECTED_CHANGE + k, w]
                )
            row[25 + n + i] = bounded(along, _BOUND)
            row[25 + 2 * n + i] = 1.0 if declared[world, 0] == i + 1 else 0.0
        for k in range(_MODES):
            row[25 + 3 * n + k] = 1.0 if declared[world, 0] > 0 and declared[world, 1] == k else 0.0
        if observe_fault:
            start, period = data[b, at.STEP, w] * parameters.period, parameters.period
            write_oracle_view(faults, b, w, start, period, row, row.shape[0] - 2 * n)


_MODES = len(MODES)
