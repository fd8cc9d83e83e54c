"""Formation keeping as a task: craft hold their slots on a natural relative orbit and share the fuel bill.

Models two to eight like craft around an empty reference point on a circular orbit. The slots lie evenly on a
circular relative orbit (Alfriend et al. 2010, section 5.1), which free motion follows without fuel, so that
what is to be flown against is dispersion, sensor noise, thrust scatter, and faults. Craft that are not
commanded fly with the suite's scripted pilot. Leaves out J2, drag, and communication limits between the
craft.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.tasks.access import (
    attitude_error,
    bounded,
    command_duties,
    disperse_attitude,
    draw_start,
    place,
    rate_error,
    write_oracle_view,
)
from thruster_envs.tasks.contract import (
    FloatArray,
    Observations,
    Outcome,
    Task,
    TaskState,
    Truth,
    axis_scale,
    change_fields,
    check_positive,
    check_whole,
    error_fields,
)
from thruster_envs.tasks.pilot import Pilot

_BOUND = 5.0
#: What observations are divided by: m, m/s, rad, rad/s; distances between craft, m.
_POSITION, _VELOCITY, _ANGLE, _RATE, _BETWEEN = 10.0, 0.05, 0.5, 0.05, 100.0
#: Half-widths of the dispersion at the start: m, m/s, rad, rad/s.
_DISPERSION = (1.5, 0.005, math.radians(5.0), 1e-3)
# Columns of the account, per craft.
_TRACKING, _ATTITUDE, _FUEL, _COST, _OPEN_TIME, _KEPT, _COLLISIONS, _ACCOUNT = range(8)
# Entries of the limits.
(
    _PERIOD, _MEAN_MOTION, _RADIUS, _SLOT_BOX, _KEEP_OUT, _RANGE_LIMIT, _RATE_LIMIT, _FUEL_PRICE, _LIMITS,
) = range(9)  # fmt: skip


@dataclass(frozen=True)
class FormationModel:
    """The configuration in numbers: authority (6,) of a period, limits, and the pilot of the other craft."""

    authority: FloatArray
    limits: FloatArray
    pilot: Pilot


@dataclass
class FormationState(TaskState):
    """Arrays of a batch: slots and accounts."""

    model: FormationModel
    phase: FloatArray  # (worlds,), rad, of the first slot at the start
    slots: FloatArray  # (worlds, craft, 6), m and m/s, LVLH, now
    account: FloatArray  # (worlds, craft, 7)
    over: FloatArray  # (worlds,), 1 where a craft is lost


@dataclass(frozen=True, kw_only=True)
class FormationKeeping(Task):
    """Configuration of ``formation_keeping_v0``.

    Attributes:
        craft: Number of craft, 2 to 8.
        commanded: How many of them are commanded, counted from the first; None for all. The others fly with
            the scripted pilot.
        radius: Of the relative orbit on which the slots lie, m.
        slot_tolerance: Distance from the slot within which it counts as kept, m.
        keep_out: Distance between two craft below which ``cost`` counts, m.
        range_limit: Distance from the slot at which the episode ends as a failure, m.
        rate_limit: Body rate at which it does, rad/s.
        fuel_price: Worth of all thrusters of one craft open for a whole period, in units of the largest
            tracking penalty.
    """

    craft: int = 3
    commanded: int | None = None
    radius: float = 50.0
    slot_tolerance: float = 1.0
    keep_out: float = 10.0
    range_limit: float = 100.0
    rate_limit: float = 1.0
    fuel_price: float = 1.0

    reward_terms: ClassVar[tuple[str, ...]] = ("tracking", "attitude", "fuel")
    max_episode_steps: ClassVar[int | None] = 120
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

    def create(self, worlds: int, threads: int | None) -> FormationState:
        """Arrays for that many worlds."""
        vehicle = self.vehicle
        fleet = Fleet(
            vehicle, worlds, self.craft, slots=self.fault_slots, nonlinear=self.nonlinear,
            max_substep=self.max_substep, threads=threads,
        )  # fmt: skip
        price = self.fuel_price / (vehicle.number_of_thrusters * vehicle.control_period)
        limits = np.array(
            [vehicle.control_period, vehicle.mean_motion, self.radius, self.slot_tolerance, self.keep_out,
             self.range_limit, self.rate_limit, price]
        )  # fmt: skip
        return FormationState(
            fleet, FormationModel(axis_scale(vehicle), limits, Pilot.of(vehicle)), np.zeros(worlds),
            np.zeros((worlds, self.craft, 6)), np.zeros((worlds, self.craft, _ACCOUNT)), np.zeros(worlds),
        )  # fmt: skip

    def reset(self, state: FormationState, which: NDArray[np.int64]) -> None:
        """Start near the slots, which begin at a random phase of the relative orbit."""
        fleet = state.fleet
        _start(
            fleet.data,
            fleet.streams,
            which,
            state.model.limits,
            state.phase,
            state.slots,
            state.account,
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
        _judge(fleet.data, model.limits, state.phase, state.slots, state.account, state.over)

    def observe(self, state: FormationState) -> Observations:
        """(worlds, agents, observation_size)."""
        observations = np.empty((state.fleet.worlds, len(self.agents), self.observation_size), np.float32)
        _observe(
            state.fleet.data, state.fleet.faults, state.model.limits, state.model.authority, state.slots,
            state.account, self.observe_fault, self.action_size, observations,
        )  # fmt: skip
        return observations

    def outcome(self, state: FormationState) -> Outcome:
        """Terminates for all when a craft is lost."""
        account = state.account[:, : len(self.agents)]
        return Outcome(account[..., _TRACKING : _FUEL + 1], account[..., _COST], state.over)

    def truth(self, state: FormationState) -> Truth:
        """The score is the share of steps in which the slot was kept; a collision cost rules success out."""
        fuel, score, success = np.empty((3, state.fleet.worlds, len(self.agents)))
        _rate(state.fleet.data, state.account, state.over, fuel, score, success)
        return Truth(fuel, score, success)


@njit
def _slot(phase, radius, n):
    """Place (m) and velocity (m/s) of a slot on the circular relative orbit, a circle about the reference."""
    s, c = math.sin(phase), math.cos(phase)
    half, out = 0.5 * radius, 0.5 * math.sqrt(3.0) * radius
    return half * s, radius * c, out * s, half * n * c, -radius * n * s, out * n * c


@njit
def _place_slots(phase, step, limits, slots):
    craft, n = slots.shape[0], limits[_MEAN_MOTION]
    for c in range(craft):
        turn = phase + 2.0 * math.pi * c / craft + n * step * limits[_PERIOD]
        place_and_speed = _slot(turn, limits[_RADIUS], n)
        for k in range(6):
            slots[c, k] = place_and_speed[k]


@kernel
def _start(data, streams, which, limits, phase, slots, account, over):
    lanes, craft, n = data.shape[2], slots.shape[1], limits[_MEAN_MOTION]
    uniform = np.empty(16)
    for world in which:
        over[world] = 0.0
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            draw_start(streams, b, w, c, uniform)
            if c == 0:
                phase[world] = 2.0 * math.pi * uniform[15]
                _place_slots(phase[world], 0.0, limits, slots[world])
            for k in range(3):
                data[b, at.POSITION + k, w] = slots[world, c, k] + _DISPERSION[0] * (2.0 * uniform[k] - 1.0)
                data[b, at.VELOCITY + k, w] = slots[world, c, 3 + k] + _DISPERSION[1] * (
                    2.0 * uniform[3 + k] - 1.0
                )
            disperse_attitude(data, b, w, uniform[6:12], _DISPERSION[2], _DISPERSION[3], n)
            for k in range(_ACCOUNT):
                account[world, c, k] = 0.0


@kernel
def _judge(data, limits, phase, slots, account, over):
    lanes, craft, n = data.shape[2], slots.shape[1], limits[_MEAN_MOTION]
    for world in range(slots.shape[0]):
        b, w = place(world, 0, craft, lanes)
        _place_slots(phase[world], data[b, at.STEP, w], limits, slots[world])
        bill = 0.0
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            bill += (data[b, at.OPEN_TIME, w] - account[world, c, _OPEN_TIME]) / craft
        for c in range(craft):
            b, w = place(world, c, craft, lanes)
            away = 0.0
            for k in range(3):
                away += (data[b, at.POSITION + k, w] - slots[world, c, k]) ** 2
            away = math.sqrt(away)
            q = (data[b, 6, w], data[b, 7, w], data[b, 8, w], data[b, 9, w])
            angle = attitude_error(q)
            spin = rate_error(q, (data[b, 10, w], data[b, 11, w], data[b, 12, w]), n)
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
            account[world, c, _TRACKING] = -min(away / _POSITION, 1.0)
            account[world, c, _ATTITUDE] = -0.5 * min(tilt, 1.0)
            account[world, c, _FUEL] = -limits[_FUEL_PRICE] * bill
            account[world, c, _COST] = max(0.0, 1.0 - nearest / limits[_KEEP_OUT])
            account[world, c, _COLLISIONS] += account[world, c, _COST]
            account[world, c, _OPEN_TIME] = data[b, at.OPEN_TIME, w]
            account[world, c, _KEPT] += 1.0 if away <= limits[_SLOT_BOX] else 0.0
            followed = data[b, at.LOST, w] == 0.0
            if not (followed and away <= limits[_RANGE_LIMIT] and spinning <= limits[_RATE_LIMIT]):
                over[world] = 1.0


@kernel
def _rate(data, account, over, fuel, score, success):
    """Fuel, score and success of every agent, (worlds, agents) each."""
    lanes, craft = data.shape[2], account.shape[1]
    for world in range(score.shape[0]):
        for c in range(score.shape[1]):
            b, w = place(world, c, craft, lanes)
            row = account[world, c]
            kept = row[_KEPT] / max(data[b, at.STEP, w], 1.0)
            fuel[world, c], score[world, c] = row[_OPEN_TIME], kept
            success[world, c] = kept >= 0.8 and row[_COLLISIONS] == 0.0 and over[world] == 0.0


@kernel
def _observe(data, faults, limits, authority, slots, account, observe_fault, n, observations):
    lanes, craft, m = data.shape[2], slots.shape[1], at.MEASURED
    for world in range(observations.shape[0]):
        mean = 0.0
        for c in range(craft):
            mean += account[world, c, _OPEN_TIME] / craft
        for c in range(observations.shape[1]):
            b, w = place(world, c, craft, lanes)
            row = observations[world, c]
            q = (data[b, m + 6, w], data[b, m + 7, w], data[b, m + 8, w], data[b, m + 9, w])
            angle = attitude_error(q)
            spin = rate_error(
                q, (data[b, m + 10, w], data[b, m + 11, w], data[b, m + 12, w]), limits[_MEAN_MOTION]
            )
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
            row[24 + n] = bounded(account[world, c, _OPEN_TIME] / mean - 1.0, _BOUND) if mean > 0.0 else 0.0
            column = 25 + n
            for other in range(craft):
                if other != c:
                    b2, w2 = place(world, other, craft, lanes)
                    for k in range(3):
                        between = data[b2, m + k, w2] - data[b, m + k, w]
                        row[column + k] = bounded(between / _BETWEEN, _BOUND)
                    column += 3
            if observe_fault:
                start = data[b, at.STEP, w] * limits[_PERIOD]
                write_oracle_view(faults, b, w, start, limits[_PERIOD], row, column)
