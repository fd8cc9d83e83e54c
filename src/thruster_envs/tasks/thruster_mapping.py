"""Thrust mapping as a task: commanded rate changes to a vehicle that may carry a hidden fault.

Models the vehicle as thruster allocation sees it (Yang 2003, chapter 2): the rate change of a period is
linear in the on-times, as the true, faulty vehicle delivers them. Feed coupling, scatter, minimum pulses and
valve delays are switched off, and the craft does not move between commands, so that the best that anybody can
do for a command is the linear program that knows the fault. Leaves out dynamics: each command stands for
itself.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import opener, place
from thruster_envs.physics.fleet import Fleet
from thruster_envs.random import COMMAND, STEP, normal_pair, philox, uniform_pair
from thruster_envs.spacecraft import Feed, Spacecraft, objective_weights
from thruster_envs.tasks.access import bounded, command_duties, true_model, write_oracle_view
from thruster_envs.tasks.contract import (
    FloatArray,
    Observations,
    Outcome,
    Task,
    TaskState,
    Truth,
    axis_scale,
    change_fields,
    per_authority,
    per_period,
)
from thruster_envs.tasks.pictures import Frame, Picture, drawable, fuel_and_score

#: Kinds of command, equally likely: one axis; all axes within reach; all axes beyond reach; all axes, tiny.
SINGLE_AXIS, COUPLED, SATURATING, TINY = 0, 1, 2, 3
COMMANDS = 32
_BOUND = 3.0


@dataclass(frozen=True)
class MappingModel:
    """The nominal vehicle in numbers.

    Attributes:
        effectiveness: (6, n), m/s^2 and rad/s^2.
        projection: (n, 6), turns a rate change into the on-time of one thruster that explains it best, in
            periods, axes weighted by the noise; one with neither authority nor noise does not count.
        authority: (6,), m/s and rad/s per period, infinite where there is none.
        fuel_cost: (n,), per s.
        slack_cost: (6,), per m/s and rad/s.
        noise: (6,), standard deviation of a measured rate change (two measurements), m/s and rad/s.
        inverse_inertia: (3, 3), 1/(kg m^2).
        scale: The objective of missing the whole authority on every axis; rewards are in this unit.
    """

    effectiveness: FloatArray
    projection: FloatArray
    authority: FloatArray
    fuel_cost: FloatArray
    slack_cost: FloatArray
    noise: FloatArray
    inverse_inertia: FloatArray
    scale: float

    @classmethod
    def of(cls, vehicle: Spacecraft) -> MappingModel:
        """Numbers of a vehicle.

        Raises:
            ValueError: Thrusters of which the effect is too small or too large for numbers of 64 bits.
        """
        effectiveness, period = vehicle.effectiveness(), vehicle.control_period
        fuel_cost, slack_cost = objective_weights(effectiveness, period)
        authority = vehicle.authority()
        sensors = vehicle.sensors
        noise = np.sqrt(2.0) * np.repeat([sensors.velocity, sensors.rate], 3)
        spread = np.maximum(noise, 1e-3 * authority)
        with np.errstate(all="ignore"):
            weights = np.where(spread > 0.0, 1.0 / spread**2, 0.0)
            whitened = effectiveness.T * weights
            projection = whitened / (whitened @ effectiveness).diagonal()[:, np.newaxis] / period
        if not np.isfinite(projection).all():
            raise ValueError(
                f"the thrusters of {vehicle.name!r} cannot be weighed by its authority, too small or "
                f"too large on an axis: {authority.tolist()} m/s and rad/s in a control period"
            )
        inverse = np.linalg.inv(np.array(vehicle.inertia))
        scale = float(slack_cost @ vehicle.authority())
        return cls(
            effectiveness, projection, axis_scale(vehicle), fuel_cost, slack_cost, noise, inverse, scale
        )


class Statistics(NamedTuple):
    """Episode statistics, (worlds,) each.

    Attributes:
        miss: Term of the reward of the last step, and the next one likewise.
        fuel: Likewise.
        objective: Sum of fuel and miss so far, in the linear program's units.
        idle: The same of doing nothing.
    """

    miss: FloatArray
    fuel: FloatArray
    objective: FloatArray
    idle: FloatArray


_statistics = opener(Statistics, columns=True)


@dataclass
class MappingState(TaskState):
    """Arrays of a batch: the command now, what was delivered for the last one, and statistics."""

    model: MappingModel
    command: FloatArray  # (worlds, 6), m/s and rad/s, body axes
    answered: FloatArray  # (worlds, 6), the command before, to which ``delivered`` was the answer
    delivered: FloatArray  # (worlds, 6), true
    measured: FloatArray  # (worlds, 6), with sensor noise
    expected: FloatArray  # (worlds, 6), what the nominal vehicle would have given
    statistics: FloatArray  # (worlds, 4), as Statistics names its columns
    none: FloatArray  # (worlds,), zeros: there is no cost, and no end but the time limit


@dataclass(frozen=True, kw_only=True)
class ThrusterMapping(Task):
    """Configuration of ``ThrusterMapping-v0``; fields beyond those of every task: none.

    ``faults`` None means the default distribution, an empty list no faults.
    """

    reward_terms: ClassVar[tuple[str, ...]] = ("miss", "fuel")
    max_episode_steps: ClassVar[int | None] = COMMANDS
    flies: ClassVar[bool] = False

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        n = self.action_size
        return (
            Field("command", "commanded rate change", 6, bound=_BOUND, **per_authority(self.vehicle)),
            Field("duties", "last duties", n, lowest=0.0),
            *change_fields(self.vehicle, _BOUND),
            Field(
                "measured_on_time",
                "last measured rate change, projected on each thruster",
                n,
                bound=_BOUND,
                **per_period(self.vehicle),
            ),
            Field(
                "expected_on_time",
                "last expected rate change, projected on each thruster",
                n,
                bound=_BOUND,
                **per_period(self.vehicle),
            ),
            *self.oracle_fields(),
        )

    def default_faults(self) -> tuple[Fault, ...] | FaultDistribution:
        """In four worlds of five, a thruster that is dead or weak from some command of the first half on."""
        period = self.vehicle.control_period
        return FaultDistribution(
            probability=0.8,
            kinds=("stuck_off", "loss"),
            onset=(0.0, 0.5 * COMMANDS * period),
            onset_grid=period,
        )

    def linear_vehicle(self) -> Spacecraft:
        """The vehicle without feed coupling, scatter, minimum pulses, valve delays and depletion."""
        imperfections = (
            "minimum_pulse", "opening_delay", "closing_delay", "rise_time", "fall_time", "scatter",
            "time_constant",
        )  # fmt: skip
        plain: dict[str, Any] = dict.fromkeys(imperfections, 0.0)
        thrusters = tuple(
            dataclasses.replace(thruster, **plain, specific_impulse=np.inf)
            for thruster in self.vehicle.thrusters
        )
        return self.vehicle.replace(thrusters=thrusters, feed=Feed(), modulator=None, isolation_valves=False)

    def create(self, worlds: int, threads: int | None) -> MappingState:
        """Arrays for that many worlds."""
        fleet = Fleet(self.linear_vehicle(), worlds, slots=self.fault_slots, threads=threads, sensors=())
        changes = ("command", "answered", "delivered", "measured", "expected")
        return MappingState(
            fleet,
            MappingModel.of(self.vehicle),
            statistics=np.zeros((worlds, len(Statistics._fields))),
            none=np.zeros(worlds),
            **{name: np.zeros((worlds, 6)) for name in changes},
        )

    def reset(self, state: MappingState, which: NDArray[np.int64]) -> None:
        """First command of an episode."""
        for array in (
            state.answered,
            state.delivered,
            state.measured,
            state.expected,
            state.statistics,
        ):
            array[which] = 0.0
        _draw_commands(state.fleet.data, state.fleet.streams, which, state.model.authority, state.command)

    def step(self, state: MappingState, duties: FloatArray) -> None:
        """Fire for the command, then draw the next one."""
        fleet, model = state.fleet, state.model
        state.answered[:] = state.command
        command_duties(fleet.data, duties, 1)
        fleet.fly(move=False)
        _evaluate_step(
            fleet.data, fleet.streams, self.vehicle.control_period,
            (self.vehicle.mass, model.inverse_inertia),
            (model.effectiveness, model.fuel_cost, model.slack_cost, model.noise, model.scale),
            (state.command, state.delivered, state.measured, state.expected), state.statistics,
        )  # fmt: skip
        _draw_commands(fleet.data, fleet.streams, state.fleet.everyone, model.authority, state.command)

    def observe(self, state: MappingState) -> Observations:
        """(worlds, 1, observation_size)."""
        worlds = state.command.shape[0]
        observations = np.empty((worlds, 1, self.observation_size), np.float32)
        _observe(
            state.fleet.data, state.fleet.faults, state.model.projection, state.model.authority,
            state.command, state.measured, state.expected, self.vehicle.control_period, self.observe_fault,
            observations[:, 0],
        )  # fmt: skip
        return observations

    def outcome(self, state: MappingState) -> Outcome:
        """Never terminates: an episode is as long as the time limit says."""
        terms = state.statistics[:, np.newaxis, : len(self.reward_terms)]
        return Outcome(terms, state.none[:, np.newaxis], state.none)

    def truth(self, state: MappingState) -> Truth:
        """The score is one minus the objective over that of doing nothing, over the episode, not below 0."""
        fuel, score, success = np.empty((3, state.fleet.worlds, 1))
        _rate(state.fleet.data, state.statistics, fuel, score, success)
        return Truth(fuel, score, success)

    def picture(self, frame: Frame) -> Picture:
        """Commanded and delivered rate change of the last command, in shares of the authority per axis."""
        state: MappingState = frame.state
        world = frame.world
        commanded, delivered = (
            drawable(change[world] / state.model.authority) for change in (state.answered, state.delivered)
        )
        names = ("x", "y", "z", "rot x", "rot y", "rot z")
        bars = tuple(
            (name, float(c), float(d)) for name, c, d in zip(names, commanded, delivered, strict=True)
        )
        return Picture(readouts=fuel_and_score(frame), bars=bars)

    def true_model(self, state: MappingState) -> tuple[FloatArray, FloatArray]:
        """Effectiveness (worlds, 6, n) and offset (worlds, 6) of the true vehicles in the coming period."""
        fleet, inverse = state.fleet, state.model.inverse_inertia
        effectiveness, offset = true_model(
            fleet.data, fleet.faults, fleet.rows.columns, fleet.wrenches, inverse,
            self.vehicle.control_period, 1, fleet.worlds,
        )  # fmt: skip
        return effectiveness[:, 0], offset[:, 0]


@kernel
def _draw_commands(data, streams, which, authority, commands):
    """Draw the command of the coming period in some worlds, from their seeds, episodes and steps."""
    lanes = data.shape[2]
    for world in which:
        b, w = place(world, 0, 1, lanes)
        uniform = np.empty(8)
        words = philox(
            np.uint64(0),
            np.uint64(np.int64(data[b, at.STEP, w])),
            streams[b, at.EPISODE, w],
            np.uint64(COMMAND << 32),
            streams[b, at.KEY_LOW, w],
            streams[b, at.KEY_HIGH, w],
        )
        for k in range(4):
            uniform[2 * k], uniform[2 * k + 1] = uniform_pair(words[k])
        kind = int(4.0 * uniform[0])
        axis = int(6.0 * uniform[1])
        reach = (
            1.0 if kind == SINGLE_AXIS else 0.3 if kind == COUPLED else 1.5 if kind == SATURATING else 0.02
        )
        for k in range(6):
            taken = (kind != SINGLE_AXIS or k == axis) and authority[k] < np.inf
            commands[world, k] = reach * (2.0 * uniform[2 + k] - 1.0) * authority[k] if taken else 0.0


@kernel
def _evaluate_step(data, streams, period, inertia, model, changes, statistics):
    """Compare what came with what was commanded, and measure it."""
    mass, inverse_inertia = inertia
    effectiveness, fuel_cost, slack_cost, noise, scale = model
    command, delivered, measured, expected = changes
    episode = _statistics(statistics)
    n, lanes = effectiveness.shape[1], data.shape[2]
    normal = np.empty(6)
    for world in range(command.shape[0]):
        b, w = place(world, 0, 1, lanes)
        words = philox(
            np.uint64(0),
            np.uint64(np.int64(data[b, at.STEP, w] - 1.0)),
            streams[b, at.EPISODE, w],
            np.uint64(STEP << 32),
            streams[b, at.KEY_LOW, w],
            streams[b, at.KEY_HIGH, w],
        )
        for k in range(3):
            normal[2 * k], normal[2 * k + 1] = normal_pair(words[k])
        fuel, miss, idle = 0.0, 0.0, 0.0
        for i in range(n):
            fuel += fuel_cost[i] * period * data[b, at.DUTIES + i, w]
        for k in range(6):
            if k < 3:
                change = data[b, at.IMPULSE + k, w] / mass
            else:
                change = 0.0
                for j in range(3):
                    change += inverse_inertia[k - 3, j] * data[b, at.IMPULSE + 3 + j, w]
            nominal = 0.0
            for i in range(n):
                nominal += effectiveness[k, i] * period * data[b, at.DUTIES + i, w]
            delivered[world, k], expected[world, k] = change, nominal
            measured[world, k] = change + noise[k] * normal[k]
            miss += slack_cost[k] * abs(command[world, k] - change)
            idle += slack_cost[k] * abs(command[world, k])
        episode.miss[world], episode.fuel[world] = -miss / scale, -fuel / scale
        episode.objective[world] += fuel + miss
        episode.idle[world] += idle


@kernel
def _rate(data, statistics, fuel, score, success):
    """Fuel, score and success of every world, (worlds, 1) each."""
    episode = _statistics(statistics)
    for world in range(statistics.shape[0]):
        b, w = place(world, 0, 1, data.shape[2])
        paid, idle = episode.objective[world], episode.idle[world]
        fuel[world, 0] = data[b, at.OPEN_TIME, w]
        score[world, 0] = min(max(1.0 - paid / idle, 0.0), 1.0) if idle > 0.0 else 0.0
        success[world, 0] = score[world, 0] >= 0.9


@kernel
def _observe(
    data, faults, projection, authority, command, measured, expected, period, observe_fault, observations
):  # fmt: skip
    n, lanes = projection.shape[0], data.shape[2]
    for world in range(command.shape[0]):
        b, w = place(world, 0, 1, lanes)
        row = observations[world]
        for k in range(6):
            row[k] = bounded(command[world, k] / authority[k], _BOUND)
            row[6 + n + k] = bounded(measured[world, k] / authority[k], _BOUND)
            row[12 + n + k] = bounded(expected[world, k] / authority[k], _BOUND)
        for i in range(n):
            row[6 + i] = data[b, at.DUTIES + i, w]
            along_measured, along_expected = 0.0, 0.0
            for k in range(6):
                along_measured += projection[i, k] * measured[world, k]
                along_expected += projection[i, k] * expected[world, k]
            row[18 + n + i] = bounded(along_measured, _BOUND)
            row[18 + 2 * n + i] = bounded(along_expected, _BOUND)
        if observe_fault:
            write_oracle_view(faults, b, w, data[b, at.STEP, w] * period, period, row, 18 + 3 * n)
