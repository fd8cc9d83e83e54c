"""Capture as a task: the last twenty metres of a rendezvous about Mars, in six degrees of freedom.

Models the final translation of Fonod et al. 2013 along the V-bar: the chaser comes from behind at 0.1 m/s
inside a corridor, sees the target through a noisy LIDAR and its attitude through noisy estimates, all one
sample old, and has to cross the capture plane near its centre, slowly and well pointed. Its pulses come late
by an unknown time, a differential gravity, drag and sunlight push it, and its true mass, inertia, centre of
mass and thrusts are not quite those of the description. It may close isolation valves and, where it has one,
go over to a spare set of thrusters. Every number of the vehicle is MSR-A, ours: the source withholds them.

The spare branch is the same set of thrusters again. So to go over to it is to leave behind what is wrong with
the first: in the arrays every fault of the first ends, those of the spare one begin to strike, and the pulses
under way are lost, while the thrust of the branch left dies away by its lag. Leaves out a way back, contact,
plume impingement, the target's own motion, and any sight of the target outside of the corridor.
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
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import attitude_error, opener, place, rate_error
from thruster_envs.physics.attitude import (
    conjugate,
    exponential,
    quaternion_product,
    rotate,
    rotate_back,
)
from thruster_envs.physics.disturbances import Disturbances, disturb
from thruster_envs.physics.orbits import hill_acceleration
from thruster_envs.pilots.approach import FACING, ApproachPilot, open_law, steer_one
from thruster_envs.tasks.access import bounded, draw_start, write_oracle_view
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
    check_whole,
    clock_field,
    error_fields,
)
from thruster_envs.tasks.pictures import Frame, Picture, distance, fuel_and_score

_BOUND = 5.0
#: What observations are divided by: m, m/s, rad, rad/s.
_NEAR, _VELOCITY, _ANGLE, _RATE = 1.0, 0.1, 0.1, 0.02
#: Half-widths of the dispersion at the start: m, m/s, rad, rad/s.
_DISPERSION = (0.1, 0.002, math.radians(1.0), math.radians(0.02))
#: Gains of the filter of position and velocity.
_ALPHA, _BETA = 0.3, 0.05
#: What the worst an episode can do costs: off the V-bar, badly pointed, all valves open.
_CORRIDOR, _ATTITUDE, _FUEL = 2.0, 1.0, 0.2
#: Lateral offset, m, angle, rad, and rate, rad/s, at which the first two cost half of their worst.
_HALF_OFFSET, _HALF_ANGLE, _HALF_RATE = 0.25, math.radians(3.0), math.radians(0.5)
#: Worth of the way from the start to the target, of a capture, and of a loss.
_PROGRESS, _CAPTURE, _LOSS = 4.0, 4.0, 4.0
#: Multiple of its tolerance from which on a miss is as bad as a loss.
_WORST_MISS = 5.0
#: Of the reward of v0: prices, and lateral offset, m, and angle, rad, from which on they grow no more.
_CORRIDOR_PRICE, _ATTITUDE_PRICE, _FUEL_PRICE = 1.0, 0.5, 0.25
_OFFSET_SCALE, _ANGLE_SCALE = 1.0, math.radians(10.0)
#: How much farther off than its start is a retreat; how near to the target it is lost off the corridor; m.
_RETREAT, _KEEP_OUT = 10.0, 2.0
#: The corridor: half-width at the capture plane, m, and tangent of the angle by which it widens.
_MOUTH, _WIDENING = 0.25, math.tan(math.radians(10.0))
#: Nominal times that an episode may last.
_PATIENCE = 1.5

# Columns of a sight: measured position, velocity, attitude, rate, measured and expected rate change.
_SEEN, _EXPECTED, _SIGHT = 0, 19, 25
#: How an episode ended.
_RUNNING, _CAPTURED, _RETREATED, _TIMED_OUT, _MISSED, _LOST = range(6)


class Parameters(NamedTuple):
    """The configuration in numbers.

    Attributes:
        period: Control period, s.
        mean_motion: rad/s.
        steps: Control periods of an episode that runs to its end.
        distance: Behind the target at the start, m.
        offset_tolerance: What counts as captured: distance from the centre of the capture plane, m.
        closing_tolerance: Speed towards the target, m/s.
        lateral_tolerance: Speed across it, m/s.
        attitude_tolerance: rad.
        rate_tolerance: rad/s.
        rate_limit: Body rate at which the chaser is lost, rad/s.
        reference: Thruster-seconds of a nominal approach.
        nominal: Duration of a nominal approach, s.
        speed: At the start, m/s.
        delay: Age of what is observed, control periods.
        all_open: Thruster-seconds of a period in which all valves are open.
        former: 1 for the reward of v0.
    """

    period: float
    mean_motion: float
    steps: float
    distance: float
    offset_tolerance: float
    closing_tolerance: float
    lateral_tolerance: float
    attitude_tolerance: float
    rate_tolerance: float
    rate_limit: float
    reference: float
    nominal: float
    speed: float
    delay: float
    all_open: float
    former: float


class Dispersion(NamedTuple):
    """Half-widths of the truth about the description.

    Attributes:
        mass: As a share.
        inertia: As a share.
        thrust: As a share, of each thruster.
        centre_of_mass: On each axis, m.
    """

    mass: float
    inertia: float
    thrust: float
    centre_of_mass: float


class Statistics(NamedTuple):
    """Episode statistics, (worlds,) each.

    Attributes:
        corridor: Term of the reward of the last step, and the next five likewise.
        attitude: Likewise.
        fuel: Likewise.
        progress: Likewise.
        capture: Likewise.
        lost: Likewise.
        cost: Of the last step.
        potential: Of the reward's progress.
        open_time: Thruster-seconds since the reset.
        end: How the episode ended.
        score: 0..1.
        over: 1 where the episode has come to its end.
        success: 1 after a capture.
    """

    corridor: FloatArray
    attitude: FloatArray
    fuel: FloatArray
    progress: FloatArray
    capture: FloatArray
    lost: FloatArray
    cost: FloatArray
    potential: FloatArray
    open_time: FloatArray
    end: FloatArray
    score: FloatArray
    over: FloatArray
    success: FloatArray


_parameters, _dispersion = opener(Parameters), opener(Dispersion)
_statistics = opener(Statistics, columns=True)


@dataclass(frozen=True)
class ApproachModel:
    """The configuration in arrays.

    Attributes:
        authority: (6,), m/s and rad/s per period, infinite where there is none.
        parameters: As :class:`Parameters` names them.
        pilot: The scripted one.
        disturbances: (5,), as :class:`~thruster_envs.physics.disturbances.Disturbances` gives them.
        dispersion: As :class:`Dispersion` names them.
        arms: (n, 3), where each thruster stands, m.
        terms: Number of terms of the reward.
    """

    authority: FloatArray
    parameters: FloatArray
    pilot: ApproachPilot
    disturbances: FloatArray
    dispersion: FloatArray
    arms: FloatArray
    terms: int


@dataclass
class ApproachState(OneAgentState[Statistics]):
    """Arrays of a batch."""

    model: ApproachModel
    sights: FloatArray  # (worlds, navigation_delay + 1, 25), oldest first
    estimate: FloatArray  # (worlds, 6), m and m/s, LVLH, at the time of the oldest sight
    sky: FloatArray  # (worlds, 2), argument of latitude at the start, direction of sunlight, turns
    branch: NDArray[np.int64]  # (worlds,), 0 the first set of thrusters, 1 the spare one
    names = Statistics


@dataclass(frozen=True, kw_only=True)
class MarsRendezvous(Task):
    """Configuration of ``MarsRendezvous-v1``.

    Attributes:
        distance: Behind the target at the start, m.
        inhibit: Add isolation valves, and the spare branch where there is one, to the action.
        navigation_delay: Age of what is observed, in control periods.
        disturbances: Whether differential gravity, drag and sunlight act.
        mass_error: Half-width of the true mass about that of the description, as a share.
        inertia_error: Likewise of the moments of inertia, all by the same share.
        thrust_error: Likewise of the thrust of each thruster.
        centre_of_mass_error: Half-width of the true centre of mass on each axis, m.
        offset_tolerance: What counts as captured: distance from the centre of the capture plane, m.
        closing_tolerance: Speed towards the target, m/s.
        lateral_tolerance: Speed across it, m/s.
        attitude_tolerance: Angle from the attitude of the approach, rad.
        rate_tolerance: Body rate against LVLH, rad/s.
        rate_limit: Body rate at which the chaser is lost, rad/s.
    """

    spacecraft: Any = "msr_chaser"
    nonlinear: bool = True
    distance: float = 20.0
    inhibit: bool = False
    navigation_delay: int = 1
    disturbances: bool = True
    mass_error: float = 0.01
    inertia_error: float = 0.02
    thrust_error: float = 0.01
    centre_of_mass_error: float = 0.01
    offset_tolerance: float = 0.1
    closing_tolerance: float = 0.15
    lateral_tolerance: float = 0.02
    attitude_tolerance: float = math.radians(3.0)
    rate_tolerance: float = math.radians(0.5)
    rate_limit: float = 0.2

    reward_terms: ClassVar[tuple[str, ...]] = (
        "corridor", "attitude", "fuel", "progress", "capture", "lost",
    )  # fmt: skip
    former_reward: ClassVar[bool] = False
    max_episode_steps: ClassVar[int | None] = None
    takes_storage: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_whole("navigation_delay", self.navigation_delay, 0, 10)
        check_positive(
            self, "offset_tolerance", "closing_tolerance", "lateral_tolerance", "attitude_tolerance",
            "rate_tolerance", "rate_limit",
        )  # fmt: skip
        for name in ("mass_error", "inertia_error", "thrust_error"):
            if not 0.0 <= getattr(self, name) <= 0.5:
                raise ValueError(f"{name} is {getattr(self, name)!r}; a share from 0 to 0.5 would be right")
        if not 0.0 <= self.centre_of_mass_error < math.inf:
            raise ValueError(
                f"centre_of_mass_error is {self.centre_of_mass_error!r}; 0 m or more would be right"
            )
        if not 2.5 <= self.distance <= 1000.0:  # nearer, a retreat would end beyond what is observed
            raise ValueError(f"distance is {self.distance!r}; 2.5 to 1000 m would be right")
        orbit = self.vehicle.reference_orbit
        if not orbit.is_steady:
            raise ValueError(
                "MarsRendezvous needs a circular orbit without j2, by which its filter and its pilot predict "
                f"and to which its disturbances add J2: eccentricity and j2 of {self.vehicle.name!r} must be "
                f"0, got {orbit.eccentricity!r} and {orbit.j2!r}"
            )
        if self.vehicle.modulator is None:
            raise ValueError(
                f"{self.vehicle.name!r} has no modulator; a spacecraft with one, such as 'msr_chaser', "
                "would be right"
            )
        if self.inhibit and not self.vehicle.isolation_valves:
            raise ValueError(
                f"inhibit is True while {self.vehicle.name!r} has no isolation valves; inhibit=False would "
                "be right"
            )

    @cached_property
    def steps(self) -> int:
        """Control periods of an episode that runs to its end: one and a half times the nominal time."""
        return math.ceil(_PATIENCE * self.distance / self._speed / self.vehicle.control_period)

    @cached_property
    def _speed(self) -> float:
        return self._pilot.reference(0.0)[1]

    @cached_property
    def _pilot(self) -> ApproachPilot:
        return ApproachPilot.of(self.vehicle, self.distance)

    @cached_property
    def action_size(self) -> int:
        """Open rate of each thruster; with ``inhibit`` one more for each, and one for a spare branch."""
        n = self.vehicle.number_of_thrusters
        return 2 * n + int(self.vehicle.spare_branch) if self.inhibit else n

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        n = self.vehicle.number_of_thrusters
        valves: tuple[Field, ...] = (
            Field("closed", "whether each isolation valve is closed", n, lowest=0.0),
        )
        if self.vehicle.spare_branch:
            valves += (Field("branch", "whether the spare branch is in use", 1, lowest=0.0),)
        return (
            Field(
                "position",
                "measured relative position, whole approach",
                3,
                "m",
                self.distance,
                reference="distance at the start",
                bound=_BOUND,
            ),
            Field("near_position", "measured relative position, close by", 3, "m", _NEAR, bound=_BOUND),
            Field("velocity", "filtered relative velocity", 3, "m/s", _VELOCITY, bound=_BOUND),
            *error_fields(_ANGLE, _RATE, _BOUND),
            clock_field("time_to_go", "time to go", self.steps * self.vehicle.control_period),
            Field("duties", "last open rates", n, lowest=0.0),
            *change_fields(self.vehicle, _BOUND),
            *(valves if self.inhibit else ()),
            *self.oracle_fields(),
        )

    def create(self, worlds: int, threads: int | None) -> ApproachState:
        """Arrays for that many worlds."""
        return ApproachState(
            self.make_fleet(worlds, threads), np.zeros((worlds, len(Statistics._fields))), self._model(),
            np.zeros((worlds, self.navigation_delay + 1, _SIGHT)), np.zeros((worlds, 6)),
            np.zeros((worlds, 2)), np.zeros(worlds, np.int64),
        )  # fmt: skip

    def _model(self) -> ApproachModel:
        vehicle = self.vehicle
        nominal = self.distance / self._speed
        parameters = self.numbers(
            Parameters, reference=0.1 * vehicle.number_of_thrusters * nominal, nominal=nominal,
            speed=self._speed, delay=self.navigation_delay,
            all_open=vehicle.number_of_thrusters * vehicle.control_period, former=self.former_reward,
        )  # fmt: skip
        dispersion = Dispersion(
            self.mass_error, self.inertia_error, self.thrust_error, self.centre_of_mass_error
        )
        numbers = Disturbances().numbers(vehicle)
        return ApproachModel(
            axis_scale(vehicle), parameters, self._pilot,
            numbers if self.disturbances else np.zeros_like(numbers), np.array(dispersion),
            np.array([thruster.position for thruster in vehicle.thrusters]), len(self.reward_terms),
        )  # fmt: skip

    def reset(self, state: ApproachState, which: NDArray[np.int64]) -> None:
        """Start behind the target, closing at the speed of the approach, nearly aligned."""
        fleet, model = state.fleet, state.model
        _start(
            fleet.data, fleet.streams, fleet.rows.columns, which, model.parameters, model.dispersion,
            model.arms, state.sky, state.branch, state.statistics,
        )  # fmt: skip
        fleet.look(which)
        _first_sight(fleet.data, which, model.parameters, state.sights, state.estimate)

    def step(self, state: ApproachState, actions: FloatArray) -> None:
        """Hear the command, and fly one period."""
        fleet, model = state.fleet, state.model
        fleet.by_worlds(
            lambda first, last: _command(
                fleet.data, fleet.faults, actions,
                (fleet.rows.pending, fleet.rows.inhibited, fleet.rows.push), state.branch,
                model.parameters, model.disturbances, state.sky, first, last,
            )
        )  # fmt: skip
        fleet.fly()
        fleet.by_worlds(
            lambda first, last: _evaluate_step(
                fleet.data, model.parameters, state.sights, state.estimate, state.statistics, first, last
            )
        )

    def observe(self, state: ApproachState) -> Observations:
        """(worlds, 1, observation_size)."""
        observations = np.empty((state.fleet.worlds, 1, self.observation_size), np.float32)
        rows, fleet, model = observations[:, 0], state.fleet, state.model
        fleet.by_worlds(
            lambda first, last: _observe(
                fleet.data, fleet.faults, model.parameters, model.authority,
                (state.sights, state.estimate, state.branch), (fleet.rows.inhibited, fleet.rows.thrusters),
                (self.inhibit, self.vehicle.spare_branch, self.observe_fault), rows, first, last,
            )
        )  # fmt: skip
        return observations

    def outcome(self, state: ApproachState) -> Outcome:
        """Terminates at capture, when it is missed, on a retreat, when lost, and when the time is up."""
        return state.outcome

    def truth(self, state: ApproachState) -> Truth:
        """A capture is worth 0.5 and up to 0.5 for economy, a retreat 0.25."""
        return state.truth

    def report(self, state: ApproachState) -> dict[str, dict[str, NDArray[Any]]]:
        """How the approach ended, whether without danger to the target, its branch, what truly is."""
        end = state.episode.end[:, np.newaxis]
        return {
            "approach": {
                "retreated": end == _RETREATED,
                "safe": end < _MISSED,
                "branch": state.branch[:, np.newaxis].copy(),
                "delay": state.fleet.pulse_delays(),
                "state": state.fleet.read(at.POSITION, 13),
            }
        }

    def picture(self, frame: Frame) -> Picture:
        """The chaser in its corridor, closed valves, the branch where there are two, and how it ended."""
        state: ApproachState = frame.state
        world, info = frame.world, frame.info
        fleet, approach = state.fleet, info["approach"]
        place = fleet.read(at.POSITION, 3)[world, 0]
        branches = self.inhibit and self.vehicle.spare_branch
        branch = (("branch", "AB"[int(approach["branch"][world, 0])]),) if branches else ()
        ends = (
            ("captured", info["success"]),
            ("retreated", approach["retreated"]),
            ("missed or lost", ~approach["safe"]),
        )
        end = tuple(("end", name) for name, reached in ends if reached[world, 0])
        return Picture(
            readouts=(distance(place, np.zeros(3)), *branch, *end, *fuel_and_score(frame)),
            closed=fleet.read(fleet.rows.inhibited, self.vehicle.number_of_thrusters)[world] > 0.0,
            corridor=np.array([(along, corridor_half_width(along)) for along in (-2.0 * self.distance, 0.0)]),
        )

    def pilot_actions(self, state: ApproachState) -> FloatArray:
        """Actions (worlds, 1, action_size), -1..1, of the scripted pilot, which leaves all valves open."""
        fleet, model = state.fleet, state.model
        actions = np.full((fleet.worlds, 1, self.action_size), -1.0)
        fleet.by_worlds(
            lambda first, last: _pilot(
                fleet.data, model.parameters, state.sights, state.estimate, model.pilot.inverse,
                model.pilot.inertia, model.pilot.law, actions, first, last,
            )
        )  # fmt: skip
        return actions


@kernel
def corridor_half_width(along):
    """How far off the V-bar the corridor reaches, m, at an along-track position, m."""
    return _MOUTH + _WIDENING * max(0.0, -along)


@njit
def _length(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _start(data, streams, columns, which, numbers, half_widths, arms, sky, branch, statistics):
    """Disperse the chaser about its start and its truth about the description, and begin its statistics."""
    parameters, dispersion, episode = _parameters(numbers), _dispersion(half_widths), _statistics(statistics)
    lanes, n = data.shape[2], arms.shape[0]
    uniform = np.empty(8 * ((20 + n + 7) // 8))
    for world in which:
        b, w = place(world, 0, 1, lanes)
        draw_start(streams, b, w, 0, uniform)
        sky[world, 0], sky[world, 1] = uniform[0], uniform[1]
        for k in range(3):
            data[b, at.POSITION + k, w] = _DISPERSION[0] * (2.0 * uniform[2 + k] - 1.0)
            data[b, at.VELOCITY + k, w] = _DISPERSION[1] * (2.0 * uniform[5 + k] - 1.0)
        data[b, at.POSITION + 1, w] -= parameters.distance
        data[b, at.VELOCITY + 1, w] += parameters.speed
        half = 0.5 * _DISPERSION[2]
        tilt = exponential(
            half * (2.0 * uniform[8] - 1.0), half * (2.0 * uniform[9] - 1.0), half * (2.0 * uniform[10] - 1.0)
        )
        q = quaternion_product(tilt, FACING)
        frame = rotate(q, (0.0, 0.0, parameters.mean_motion))
        for k in range(4):
            data[b, at.ATTITUDE + k, w] = q[k]
        for k in range(3):
            data[b, at.RATE + k, w] = frame[k] + _DISPERSION[3] * (2.0 * uniform[11 + k] - 1.0)
        data[b, at.MASS, w] *= 1.0 + dispersion.mass * (2.0 * uniform[14] - 1.0)
        inertia = 1.0 + dispersion.inertia * (2.0 * uniform[15] - 1.0)
        for i in range(n):
            row = columns + 6 * i
            gain = 1.0 + dispersion.thrust * (2.0 * uniform[20 + i] - 1.0)
            f = np.empty(3)
            arm = np.empty(3)
            for k in range(3):
                f[k] = data[b, row + k, w]
                arm[k] = arms[i, k] - dispersion.centre_of_mass * (2.0 * uniform[16 + k] - 1.0)
            for k in range(3):
                j, m = (k + 1) % 3, (k + 2) % 3
                data[b, row + k, w] = gain * f[k]
                data[b, row + 3 + k, w] = gain / inertia * (arm[j] * f[m] - arm[m] * f[j])
        branch[world] = 0
        statistics[world] = 0.0
        episode.potential[world] = _potential(data, b, w, parameters)


@njit
def _potential(data, b, w, parameters):
    """Minus the distance to the target, in shares of that at the start.

    Who is ahead of the nominal approach gains nothing by it, but in v0.
    """
    r = (data[b, 0, w], data[b, 1, w], data[b, 2, w])
    share = _length(r) / parameters.distance
    if parameters.former > 0.0:
        return -share
    return -max(share, 1.0 - data[b, at.STEP, w] * parameters.period / parameters.nominal)


@kernel
def _first_sight(data, which, numbers, sights, estimate):
    """Fill the way of the sights with the first one, and begin the filter at the speed of the approach."""
    parameters = _parameters(numbers)
    lanes = data.shape[2]
    for world in which:
        b, w = place(world, 0, 1, lanes)
        for age in range(sights.shape[1]):
            for k in range(_SIGHT):
                sights[world, age, k] = data[b, at.MEASURED + k, w]
        for k in range(3):
            estimate[world, k] = data[b, at.MEASURED + k, w]
            estimate[world, 3 + k] = parameters.speed if k == 1 else 0.0


@kernel(nogil=True)
def _command(data, faults, actions, rows, branch, numbers, disturbances, sky, first, last):
    """Write open rates, isolation valves and disturbances, and go over to the spare branch where asked."""
    parameters, (pending, inhibited, push) = _parameters(numbers), rows
    lanes, n = data.shape[2], push - inhibited
    turns = parameters.mean_motion / (2.0 * math.pi)
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        action = actions[world, 0]
        for i in range(n):
            data[b, at.DUTIES + i, w] = action[i]
        time = data[b, at.STEP, w] * parameters.period
        if action.shape[0] > n:
            for i in range(n):
                data[b, inhibited + i, w] = 1.0 if action[n + i] > 0.5 else 0.0
            if action.shape[0] > 2 * n and action[2 * n] > 0.5 and branch[world] == 0:
                branch[world] = 1
                for row in range(pending, inhibited):
                    data[b, row, w] = 0.0
                health.switch_branch(faults[b, w], time)
        r = (data[b, 0, w], data[b, 1, w], data[b, 2, w])
        latitude = sky[world, 0] + turns * time
        pushed = disturb(r, latitude - math.floor(latitude), sky[world, 1], disturbances)
        for k in range(3):
            data[b, push + k, w] = pushed[k]


@kernel(nogil=True)
def _evaluate_step(data, numbers, sights, estimate, statistics, first, last):
    """Let the sights grow older, filter, and evaluate the period that has passed."""
    parameters, episode = _parameters(numbers), _statistics(statistics)
    lanes, n = data.shape[2], parameters.mean_motion
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        ages = sights.shape[1]
        for age in range(ages - 1):
            for k in range(_SIGHT):
                sights[world, age, k] = sights[world, age + 1, k]
        for k in range(_SIGHT):
            sights[world, ages - 1, k] = data[b, at.MEASURED + k, w]
        if data[b, at.STEP, w] > parameters.delay:
            _filter(sights[world, 0], parameters, estimate[world])
        r = (data[b, 0, w], data[b, 1, w], data[b, 2, w])
        v = (data[b, 3, w], data[b, 4, w], data[b, 5, w])
        q = (data[b, 6, w], data[b, 7, w], data[b, 8, w], data[b, 9, w])
        rate = (data[b, 10, w], data[b, 11, w], data[b, 12, w])
        angle = _length(attitude_error(quaternion_product(q, conjugate(FACING))))
        spin = _length(rate_error(q, rate, (0.0, 0.0, n)))
        offset = math.sqrt(r[0] * r[0] + r[2] * r[2])
        across = math.sqrt(v[0] * v[0] + v[2] * v[2])
        distance = _length(r)
        free = corridor_half_width(r[1])
        captured = (
            r[1] >= 0.0
            and offset <= parameters.offset_tolerance
            and 0.0 < v[1] <= parameters.closing_tolerance
            and across <= parameters.lateral_tolerance
            and angle <= parameters.attitude_tolerance
            and spin <= parameters.rate_tolerance
        )
        end = _RUNNING
        followed = data[b, at.LOST, w] == 0.0 and spin <= parameters.rate_limit
        if not followed or (distance < _KEEP_OUT and offset > free):
            end = _LOST
        elif r[1] >= 0.0:
            end = _CAPTURED if captured else _MISSED
        elif distance >= parameters.distance + _RETREAT:
            end = _RETREATED
        elif data[b, at.STEP, w] >= parameters.steps:
            end = _TIMED_OUT
        potential = _potential(data, b, w, parameters)
        fired = data[b, at.OPEN_TIME, w] - episode.open_time[world]
        economy = min(1.0, parameters.reference / max(data[b, at.OPEN_TIME, w], 1e-9))
        if parameters.former > 0.0:
            share = parameters.period / parameters.nominal
            episode.corridor[world] = -_CORRIDOR_PRICE * share * min(offset / _OFFSET_SCALE, 1.0)
            episode.attitude[world] = -_ATTITUDE_PRICE * share * min(angle / _ANGLE_SCALE, 1.0)
            episode.fuel[world] = -_FUEL_PRICE * fired / parameters.reference
            episode.progress[world] = potential - episode.potential[world]
            episode.capture[world] = 1.0 if end == _CAPTURED else (-1.0 if end >= _MISSED else 0.0)
        else:
            off, tilted = offset / (offset + _HALF_OFFSET), angle / (angle + _HALF_ANGLE)
            turning = spin / (spin + _HALF_RATE)
            if end >= _MISSED:
                potential, off, tilted, turning = -1.0 - _RETREAT / parameters.distance, 1.0, 1.0, 1.0
            badness = 1.0
            if end == _MISSED:
                badness = 0.2 * (
                    _excess(offset, parameters.offset_tolerance)
                    + _excess(abs(v[1]), parameters.closing_tolerance)
                    + _excess(across, parameters.lateral_tolerance)
                    + _excess(angle, parameters.attitude_tolerance)
                    + _excess(spin, parameters.rate_tolerance)
                )
            left = max(parameters.steps - data[b, at.STEP, w], 0.0) / parameters.steps
            cut_short = end != _RUNNING and end != _CAPTURED
            episode.corridor[world] = -_CORRIDOR * off / parameters.steps
            episode.attitude[world] = -0.5 * _ATTITUDE * (tilted + turning) / parameters.steps
            episode.fuel[world] = -_FUEL * min(fired / parameters.all_open, 1.0) / parameters.steps
            episode.progress[world] = _PROGRESS * (potential - episode.potential[world])
            episode.capture[world] = _CAPTURE * (0.5 + 0.5 * economy) if end == _CAPTURED else 0.0
            episode.lost[world] = -(_CORRIDOR + _ATTITUDE + _FUEL) * left if cut_short else 0.0
            if end >= _MISSED:
                episode.lost[world] -= _LOSS * (0.5 + 0.5 * badness)
        episode.cost[world] = max(0.0, offset / free - 1.0) if distance <= parameters.distance else 0.0
        episode.potential[world] = potential
        episode.open_time[world] = data[b, at.OPEN_TIME, w]
        episode.end[world] = end
        episode.over[world] = 1.0 if end > _RUNNING else 0.0
        episode.success[world] = 1.0 if end == _CAPTURED else 0.0
        score = 0.25 * max(0.0, 1.0 - distance / parameters.distance)
        if end == _CAPTURED:
            score = 0.5 + 0.5 * economy
        elif end == _RETREATED:
            score = 0.25
        elif end >= _MISSED:
            score = 0.0
        episode.score[world] = score


@njit(forceinline=True)
def _excess(value, tolerance):
    """How far beyond its tolerance a miss is: 0 within it, 1 at ``_WORST_MISS`` times of it and beyond."""
    return min(max(value / tolerance - 1.0, 0.0) / (_WORST_MISS - 1.0), 1.0)


@njit
def _filter(sight, parameters, estimate):
    """One step of the alpha-beta filter, driven by the rate change expected of the nominal vehicle."""
    period = parameters.period
    q = (sight[6], sight[7], sight[8], sight[9])
    given = rotate_back(q, (sight[_EXPECTED], sight[_EXPECTED + 1], sight[_EXPECTED + 2]))
    r = (estimate[0], estimate[1], estimate[2])
    free = hill_acceleration(r, (estimate[3], estimate[4], estimate[5]), parameters.mean_motion)
    for k in range(3):
        change = given[k] + period * free[k]
        ahead = estimate[k] + period * (estimate[3 + k] + 0.5 * change)
        missed = sight[_SEEN + k] - ahead
        estimate[k] = ahead + _ALPHA * missed
        estimate[3 + k] += change + _BETA / period * missed


@kernel(nogil=True)
def _pilot(data, numbers, sights, estimate, inverse, inertia, law_numbers, actions, first, last):
    """Open rates of the scripted pilot, as actions."""
    parameters, law = _parameters(numbers), open_law(law_numbers)
    lanes, n = data.shape[2], inverse.shape[0]
    sight, duties = np.empty(13), np.empty(n)
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        time = parameters.period * max(data[b, at.STEP, w] - parameters.delay, 0.0)
        for k in range(6):
            sight[k] = estimate[world, k]
        for k in range(6, 13):
            sight[k] = sights[world, 0, k]
        steer_one(time, sight, inverse, inertia, law, duties)
        for i in range(n):
            actions[world, 0, i] = 2.0 * duties[i] - 1.0


@kernel(nogil=True)
def _observe(data, faults, numbers, authority, navigation, valves, shown, observations, first, last):
    """Write observations of what navigation says, of the valves, and of faults where that is shown."""
    sights, estimate, branch = navigation
    inhibited, n = valves
    inhibit, spare, observe_fault = shown
    parameters = _parameters(numbers)
    lanes = data.shape[2]
    for world in range(first, last):
        b, w = place(world, 0, 1, lanes)
        row, sight = observations[world], sights[world, 0]
        q = (sight[6], sight[7], sight[8], sight[9])
        angle = attitude_error(quaternion_product(q, conjugate(FACING)))
        rate = rate_error(q, (sight[10], sight[11], sight[12]), (0.0, 0.0, parameters.mean_motion))
        for k in range(3):
            row[k] = bounded(sight[k] / parameters.distance, _BOUND)
            row[3 + k] = bounded(sight[k] / _NEAR, _BOUND)
            row[6 + k] = bounded(estimate[world, 3 + k] / _VELOCITY, _BOUND)
            row[9 + k] = bounded(angle[k] / _ANGLE, _BOUND)
            row[12 + k] = bounded(rate[k] / _RATE, _BOUND)
        row[15] = max(0.0, 1.0 - data[b, at.STEP, w] / parameters.steps)
        for i in range(n):
            row[16 + i] = data[b, at.DUTIES + i, w]
        for k in range(6):
            row[16 + n + k] = bounded(sight[_EXPECTED - 6 + k] / authority[k], _BOUND)
            row[22 + n + k] = bounded(sight[_EXPECTED + k] / authority[k], _BOUND)
        used = 28 + n
        if inhibit:
            for i in range(n):
                row[used + i] = data[b, inhibited + i, w]
            used += n
            if spare:
                row[used] = branch[world]
                used += 1
        if observe_fault:
            write_oracle_view(
                faults, b, w, data[b, at.STEP, w] * parameters.period, parameters.period, row, used
            )
