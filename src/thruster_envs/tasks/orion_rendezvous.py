"""Rendezvous as a task: from 300 m to the origin in half an orbit, in six degrees of freedom.

Models the mission of Yang 2003, chapter 6 with the attitude that the source leaves out: the craft starts
radially above the target nearly at rest and nearly aligned with LVLH, navigates by noisy relative
measurements, and has to be at the origin, at rest and aligned, when the time is up. Leaves out plume
impingement on the target, keep-out zones and eclipse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import errors_of, opener, place
from thruster_envs.physics.orbits import open_ellipse
from thruster_envs.tasks.access import (
    bounded,
    command_duties,
    disperse,
    draw_start,
    write_oracle_view,
)
from thruster_envs.tasks.contract import (
    FloatArray,
    Observations,
    OneAgentState,
    Outcome,
    Task,
    Truth,
    axis_scale,
    change_fields,
    check_positive,
    clock_field,
    error_fields,
)
from thruster_envs.tasks.shaping import delta_v_to_go, elliptic_delta_v_to_go

_BOUND = 5.0
#: What observations are divided by: m, m/s, rad, rad/s.
_POSITION, _VELOCITY, _ANGLE, _RATE = 300.0, 0.5, 0.5, 0.05
#: Half-widths of the dispersion at the start: m, m/s, rad, rad/s.
_DISPERSION = (5.0, 0.005, math.radians(5.0), 1e-3)
#: Worth of the whole way of the potential, of an arrival, of all valves open all the time, and of a loss.
_PROGRESS, _ARRIVAL, _FUEL, _LOSS = 5.0, 5.0, 2.0, 5.0


class Parameters(NamedTuple):
    """The configuration in numbers.

    Attributes:
        period: Control period, s.
        mean_motion: rad/s.
        steps: Control periods of an episode.
        acceleration: Of one thruster, the mean of all, m/s^2.
        lever: What a rad/s is worth in m/s.
        reference: What the mission costs, m/s.
        position_tolerance: Half-size of the terminal box: distance, m.
        velocity_tolerance: m/s.
        attitude_tolerance: rad.
        rate_tolerance: rad/s.
        range_limit: Distance at which the episode ends as a failure, m.
        rate_limit: Body rate at which it does, rad/s.
        rate_soft_limit: Body rate from which on there is a cost, rad/s.
        distance: To the target at the start, m.
        all_open: Thruster-seconds of a period in which all valves are open.
        former: 1 for the reward of v0.
    """

    period: float
    mean_motion: float
    steps: float
    acceleration: float
    lever: float
    reference: float
    position_tolerance: float
    velocity_tolerance: float
    attitude_tolerance: float
    rate_tolerance: float
    range_limit: float
    rate_limit: float
    rate_soft_limit: float
    distance: float
    all_open: float
    former: float


class Statistics(NamedTuple):
    """Episode statistics, (worlds,) each.

    Attributes:
        fuel: Term of the reward of the last step, and the next three likewise.
        progress: Likewise.
        arrival: Likewise.
        lost: Likewise.
        cost: Of the last step.
        over: 1 where the episode has come to its end.
        score: 0..1.
        success: 1 in the terminal box.
        open_time: Thruster-seconds since the reset.
        potential: Of the reward's progress.
    """

    fuel: FloatArray
    progress: FloatArray
    arrival: FloatArray
    lost: FloatArray
    cost: FloatArray
    over: FloatArray
    score: FloatArray
    success: FloatArray
    open_time: FloatArray
    potential: FloatArray


_parameters, _statistics = opener(Parameters), opener(Statistics, columns=True)


@dataclass(frozen=True)
class RendezvousModel:
    """The configuration in arrays.

    Attributes:
        authority: (6,), m/s and rad/s per period, infinite where there is none.
        parameters: As :class:`Parameters` names them.
        terms: Number of terms of the reward.
    """

    authority: FloatArray
    parameters: FloatArray
    terms: int


@dataclass
class RendezvousState(OneAgentState[Statistics]):
    """Arrays of a batch."""

    model: RendezvousModel
    names = Statistics


@dataclass(frozen=True, kw_only=True)
class OrionRendezvous(Task):
    """Configuration of ``OrionRendezvous-v1``.

    Attributes:
        start: Relative position at the start, m, LVLH.
        position_tolerance: Half-size of the terminal box: distance, m.
        velocity_tolerance: Speed, m/s.
        attitude_tolerance: Angle from LVLH, rad.
        rate_tolerance: Body rate against LVLH, rad/s.
        range_limit: Distance at which the episode ends as a failure, m.
        rate_limit: Body rate at which it does, rad/s.
        rate_soft_limit: Body rate from which on ``info["cost"]`` counts, rad/s.
        orbits: Time for the rendezvous, in orbits.
    """

    start: tuple[float, float, float] = (300.0, 0.0, 0.0)
    position_tolerance: float = 2.0
    velocity_tolerance: float = 0.02
    attitude_tolerance: float = math.radians(5.0)
    rate_tolerance: float = math.radians(0.5)
    range_limit: float = 2000.0
    rate_limit: float = 1.0
    rate_soft_limit: float = 0.1
    orbits: float = 0.5

    reward_terms: ClassVar[tuple[str, ...]] = ("fuel", "progress", "arrival", "lost")
    former_reward: ClassVar[bool] = False
    max_episode_steps: ClassVar[int | None] = None
    takes_storage: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        start = self.start
        check_positive(
            self, "position_tolerance", "velocity_tolerance", "attitude_tolerance", "rate_tolerance",
            "range_limit", "rate_limit", "rate_soft_limit", "orbits",
        )  # fmt: skip
        if not math.hypot(*start) < self.range_limit:
            raise ValueError(
                f"start is {start!r}; three numbers of m within {self.range_limit:g} m would be right"
            )

    @cached_property
    def steps(self) -> int:
        """Control periods of an episode that runs to its end."""
        duration = self.orbits * 2.0 * math.pi / self.vehicle.mean_motion
        return max(1, round(duration / self.vehicle.control_period))

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        n = self.action_size
        return (
            Field("position", "measured relative position", 3, "m", _POSITION, bound=_BOUND),
            Field("velocity", "measured relative velocity", 3, "m/s", _VELOCITY, bound=_BOUND),
            *error_fields(_ANGLE, _RATE, _BOUND),
            clock_field("time_to_go", "time to go", self.steps * self.vehicle.control_period),
            Field("duties", "last duties", n, lowest=0.0),
            *change_fields(self.vehicle, _BOUND),
            *self.oracle_fields(),
        )

    def create(self, worlds: int, threads: int | None) -> RendezvousState:
        """Arrays for that many worlds."""
        fleet, statistics = self.make_fleet(worlds, threads), np.zeros((worlds, len(Statistics._fields)))
        return RendezvousState(fleet, statistics, self._model(fleet.ellipses()))

    def _model(self, ellipses: FloatArray | None) -> RendezvousModel:
        vehicle = self.vehicle
        authority = vehicle.authority()
        # What a thruster-second and a rad/s are worth in m/s: the exchange rates between fuel and motion.
        thrust = float(np.mean([thruster.thrust for thruster in vehicle.thrusters]))
        lever = float(authority[:3].mean() / authority[3:].mean()) if authority[3:].any() else 0.0
        duration, at_rest = self.steps * vehicle.control_period, (0.0, 0.0, 0.0)
        starts = self.start, (_DISPERSION[0],) * 3  # one at the target has its dispersion to make good
        reference = max(
            _delta_v(start, at_rest, duration, vehicle.mean_motion, ellipses, 0) for start in starts
        )
        parameters = self.numbers(
            Parameters, acceleration=thrust / vehicle.mass, lever=lever, reference=reference,
            distance=math.hypot(*self.start),
            all_open=vehicle.number_of_thrusters * vehicle.control_period, former=self.former_reward,
        )  # fmt: skip
        return RendezvousModel(axis_scale(vehicle), parameters, len(self.reward_terms))

    def reset(self, state: RendezvousState, which: NDArray[np.int64]) -> None:
        """Start near ``start``, nearly at rest in LVLH and nearly aligned with it."""
        fleet = state.fleet
        _start(
            fleet.data, fleet.streams, which, np.array(self.start), state.model.parameters,
            fleet.ellipses(), state.statistics,
        )  # fmt: skip
        fleet.look(which)

    def step(self, state: RendezvousState, duties: FloatArray) -> None:
        """Fly one period."""
        command_duties(state.fleet.data, duties, 1)
        state.fleet.fly()
        ellipses = state.fleet.ellipses()
        state.fleet.by_worlds(
            lambda first, last: _evaluate_step(
                state.fleet.data, state.model.parameters, ellipses, state.statistics, first, last
            )
        )

    def observe(self, state: RendezvousState) -> Observations:
        """(worlds, 1, observation_size)."""
        observations = np.empty((state.fleet.worlds, 1, self.observation_size), np.float32)
        rows, fleet, model = observations[:, 0], state.fleet, state.model
        fleet.by_worlds(
            lambda first, last: _observe(
                fleet.data,
                fleet.faults,
                model.parameters,
                model.authority,
                self.observe_fault,
                rows,
                first,
                last,
            )
        )
        return observations

    def outcome(self, state: RendezvousState) -> Outcome:
        """Terminates when the time is up, or out of bounds."""
        return state.outcome

    def truth(self, state: RendezvousState) -> Truth:
        """In the box the score is 0.5 and up to 0.5 for economy; outside it up to 0.5 for distance gained."""
        return state.truth


@kernel
def _delta_v(r, v, time_to_go, n, ellipses, world):
    """Delta-v to go, m/s, about a circular orbit, or about the ellipse of a world where there are some."""
    if ellipses is None:
        return delta_v_to_go(r, v, time_to_go, n)
    return elliptic_delta_v_to_go(r, v, time_to_go, open_ellipse(ellipses[world]))


@njit
def _to_pay(r, v, angle, rate, time_to_go, parameters, ellipses, world):
    """What is still to be paid over what the mission costs; attitude errors at their worth in m/s."""
    translation = _delta_v(r, v, time_to_go, parameters.mean_motion, ellipses, world)
    attitude = 0.0
    for k in range(3):
        attitude += abs(rate[k]) + abs(angle[k]) / _SLEW_TIME
    return (translation + parameters.lever * attitude) / parameters.reference


@njit
def _potential(to_pay, former):
    """Of the progress: from 0, nothing to pay, down to -1; of v0, down without bound."""
    return -to_pay if former else -to_pay / (1.0 + to_pay)


#: Seconds in which an attitude error is taken to be turned away, in the potential.
_SLEW_TIME = 60.0


@njit
def _true_errors(data, b, w):
    """Position, velocity, attitude error and rate error of a craft, as they truly are."""
    r = (data[b, 0, w], data[b, 1, w], data[b, 2, w])
    v = (data[b, 3, w], data[b, 4, w], data[b, 5, w])
    angle, rate = errors_of(data, at.POSITION, b, w)
    return r, v, angle, rate


@njit
def _length(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _start(data, streams, which, start, numbers, ellipses, statistics):
    """Disperse the craft about the start, uniformly in a box, and begin its statistics."""
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes = data.shape[2]
    uniform = np.empty(16)
    for world in which:
        b, w = place(world, 0, 1, lanes)
        draw_start(streams, b, w, 0, uniform)
        disperse(data, b, w, uniform, start, (0.0, 0.0, 0.0), _DISPERSION)
        statistics[world] = 0.0
        r, v, angle, rate = _true_errors(data, b, w)
        duration = parameters.steps * parameters.period
        to_pay = _to_pay(r, v, angle, rate, duration, parameters, ellipses, world)
        episode.potential[world] = _potential(to_pay, parameters.former > 0.0)


@kernel(nogil=True)
def _evaluate_step(data, numbers, ellipses, statistics, first, last):
    """Evaluate the period that has passed, in the worlds from ``first`` to ``last`` (exclusive)."""
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes = data.shape[2]
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        r, v, angle, rate = _true_errors(data, b, w)
        to_go = parameters.steps - data[b, at.STEP, w]
        time_to_go = to_go * parameters.period
        to_pay = _to_pay(r, v, angle, rate, time_to_go, parameters, ellipses, world)
        potential = _potential(to_pay, parameters.former > 0.0)
        fired = data[b, at.OPEN_TIME, w] - episode.open_time[world]
        distance, spin = _length(r), _length(rate)
        followed = data[b, at.LOST, w] == 0.0
        lost = not (followed and distance <= parameters.range_limit and spin <= parameters.rate_limit)
        inside = (
            followed
            and distance <= parameters.position_tolerance
            and _length(v) <= parameters.velocity_tolerance
            and _length(angle) <= parameters.attitude_tolerance
            and spin <= parameters.rate_tolerance
        )
        spent = data[b, at.OPEN_TIME, w] * parameters.acceleration
        economy = min(1.0, parameters.reference / spent) if spent > 0.0 else 1.0
        arrived = inside and to_go <= 0.0
        if parameters.former > 0.0:
            episode.fuel[world] = -fired * parameters.acceleration / parameters.reference
            episode.progress[world] = potential - episode.potential[world]
            episode.arrival[world] = -1.0 if lost else (1.0 if arrived else 0.0)
        else:
            potential = -1.0 if lost else potential
            episode.fuel[world] = -_FUEL * min(fired / parameters.all_open, 1.0) / parameters.steps
            episode.progress[world] = _PROGRESS * (potential - episode.potential[world])
            episode.arrival[world] = _ARRIVAL * (0.5 + 0.5 * economy) if arrived and not lost else 0.0
            left = max(to_go, 0.0) / parameters.steps
            episode.lost[world] = -_LOSS - _FUEL * left if lost else 0.0
        episode.cost[world] = max(0.0, spin / parameters.rate_soft_limit - 1.0)
        episode.over[world] = 1.0 if lost or to_go <= 0.0 else 0.0
        episode.open_time[world] = data[b, at.OPEN_TIME, w]
        episode.potential[world] = potential
        gained = max(0.0, 1.0 - distance / parameters.distance) if parameters.distance > 0.0 else 0.0
        episode.score[world] = 0.5 + 0.5 * economy if inside else (0.0 if lost else 0.5 * gained)
        episode.success[world] = 1.0 if inside else 0.0


@kernel(nogil=True)
def _observe(data, faults, numbers, authority, observe_fault, observations, first, last):
    parameters = _parameters(numbers)
    n, lanes = observations.shape[1] - 25, data.shape[2]
    if observe_fault:
        n //= 3
    m = at.MEASURED
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        row = observations[world]
        angle, rate = errors_of(data, m, b, w)
        for k in range(3):
            row[k] = bounded(data[b, m + k, w] / _POSITION, _BOUND)
            row[3 + k] = bounded(data[b, m + 3 + k, w] / _VELOCITY, _BOUND)
            row[6 + k] = bounded(angle[k] / _ANGLE, _BOUND)
            row[9 + k] = bounded(rate[k] / _RATE, _BOUND)
        row[12] = max(0.0, 1.0 - data[b, at.STEP, w] / parameters.steps)
        for i in range(n):
            row[13 + i] = data[b, at.DUTIES + i, w]
        for k in range(6):
            row[13 + n + k] = bounded(data[b, at.MEASURED_CHANGE + k, w] / authority[k], _BOUND)
            row[19 + n + k] = bounded(data[b, at.EXPECTED_CHANGE + k, w] / authority[k], _BOUND)
        if observe_fault:
            write_oracle_view(
                faults, b, w, data[b, at.STEP, w] * parameters.period, parameters.period, row, 25 + n
            )
