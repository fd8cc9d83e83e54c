"""What a task is: a frozen configuration, one structure of arrays, and a handful of functions over them.

A task says what an episode is about. It knows nothing of autoreset, time limits, dictionaries of agents,
wrappers or rendering, and nothing in it asks whether it serves one world or four thousand; it never mentions
faults, which act in the actuator model and nowhere else.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from thruster_envs.configuration import coerce_fields
from thruster_envs.faults import Fault, FaultDistribution, as_faults
from thruster_envs.observations import Field
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import columns_of
from thruster_envs.physics.body import MOST_SUBSTEPS
from thruster_envs.physics.fleet import Fleet, check_flyable
from thruster_envs.spacecraft import Spacecraft, load
from thruster_envs.spacecraft.description import LARGEST
from thruster_envs.tasks.pictures import Frame, Picture, distance, fuel_and_score

FloatArray = NDArray[np.float64]
Observations = NDArray[np.float32]
Statistics = TypeVar("Statistics")


#: Largest speed of a wheel that is observed, over that up to which its motor pushes.
_OVERSPEED = 2.0


class Outcome(NamedTuple):
    """What a step was worth, in every world for every agent; views of a state's arrays are fine.

    Attributes:
        reward_terms: (worlds, agents, terms), in the order of ``Task.reward_terms``; they sum to the reward.
        cost: (worlds, agents), constraint violation, at least 0, apart from the reward.
        terminated: (worlds,), whether the episode has come to its own end: booleans, or numbers that are not
            0 where it has.
    """

    reward_terms: FloatArray
    cost: FloatArray
    terminated: NDArray[Any]


class Truth(NamedTuple):
    """What ``info`` may show of a world beyond faults; views of a state's arrays are fine.

    Attributes:
        fuel: (worlds, agents), thruster-seconds of open valve since the reset.
        score: (worlds, agents), 0..1, how well the episode went so far; at its end, how well it went.
        success: (worlds, agents), whether it would count as a success if it ended now: booleans, or numbers
            that are not 0 where it would.
    """

    fuel: FloatArray
    score: FloatArray
    success: NDArray[Any]


def check_whole(name: str, value: Any, low: int, high: int) -> None:
    """Refuse a value that is no whole number from ``low`` to ``high``.

    Raises:
        ValueError: One line that names it.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise ValueError(f"{name} is {value!r}; a whole number from {low} to {high} would be right")


def check_positive(task: Any, *names: str) -> None:
    """Refuse a task of which one of these attributes is not a finite number above 0.

    Raises:
        ValueError: One line that names it.
    """
    for name in names:
        value = getattr(task, name)
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} is {value!r}; a finite number above 0 would be right")
        if not 1.0 / LARGEST <= value <= LARGEST:
            raise ValueError(f"{name} must be from {1.0 / LARGEST:g} to {LARGEST:g}, got {value!r}")


def check_not_negative(task: Any, *names: str) -> None:
    """Refuse a task of which one of these attributes is not a finite number of 0 or more.

    Raises:
        ValueError: One line that names it.
    """
    for name in names:
        value = getattr(task, name)
        if not 0.0 <= value < math.inf:
            raise ValueError(f"{name} is {value!r}; a finite number of 0 or more would be right")
        if not value <= LARGEST:
            raise ValueError(f"{name} must be at most {LARGEST:g}, got {value!r}")


def axis_scale(vehicle: Spacecraft) -> FloatArray:
    """(6,): what the rate change on each axis is divided by: the authority, infinite where there is none."""
    authority = vehicle.authority()
    return np.where(authority > 0.0, authority, np.inf)


def per_authority(vehicle: Spacecraft) -> dict[str, Any]:
    """Unit and scale of a rate change in shares of the authority per axis, for a field of six entries."""
    scale = tuple(vehicle.authority().tolist())
    return {"unit": "m/s, rad/s", "scale": scale, "reference": "authority per axis"}


def change_fields(vehicle: Spacecraft, bound: float) -> tuple[Field, Field]:
    """Rate changes of the last period, as measured and as expected of the nominal vehicle."""
    share = per_authority(vehicle)
    return (
        Field("measured_change", "last measured rate change", 6, bound=bound, **share),
        Field("expected_change", "last expected rate change", 6, bound=bound, **share),
    )


def error_fields(angle: float, rate: float, bound: float) -> tuple[Field, Field]:
    """Errors of attitude and body rate; an entry of 1 stands for ``angle`` rad and ``rate`` rad/s."""
    return (
        Field("attitude_error", "measured attitude error", 3, "rad", angle, bound=bound),
        Field("rate_error", "measured rate error", 3, "rad/s", rate, bound=bound),
    )


def clock_field(name: str, meaning: str, duration: float, reference: str = "length of the episode") -> Field:
    """A time of an episode; an entry of 1 stands for ``duration`` s."""
    return Field(name, meaning, 1, "s", duration, reference=reference, lowest=0.0)


def per_period(vehicle: Spacecraft) -> dict[str, Any]:
    """Unit and scale of an on-time in control periods, for a field."""
    return {"unit": "s", "scale": vehicle.control_period, "reference": "control period"}


@dataclass
class TaskState:
    """The arrays of a batch of worlds. Tasks add their own; every array has the world as its first axis."""

    fleet: Fleet

    def own(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """The task's own arrays by name."""
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, np.ndarray):
                yield one.name, value

    def __getstate__(self) -> dict[str, Any]:
        """What is copied or pickled: the fields, and no cached views, which would be views of nothing."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def save(self) -> dict[str, NDArray[Any]]:
        """Copies of everything that a later step depends on."""
        return self.fleet.state() | {f"task.{name}": array.copy() for name, array in self.own()}

    def restore(self, saved: dict[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save` gave."""
        self.fleet.restore({name: saved[name] for name in self.fleet.saved})
        for name, array in self.own():
            array[...] = saved[f"task.{name}"]


@dataclass
class EpisodeState(TaskState, Generic[Statistics]):
    """Arrays of a batch whose episode statistics have names."""

    statistics: FloatArray  # (worlds, ..., columns), as `names` has them

    #: The NamedTuple of the columns.
    names: ClassVar[type[Any]]

    @cached_property
    def episode(self) -> Statistics:
        """Views of the statistics by name, (worlds, ...) each."""
        views: Statistics = columns_of(self.names, self.statistics)
        return views


@dataclass
class OneAgentState(EpisodeState[Statistics]):
    """Arrays of a batch of one agent, whose statistics hold what a step was worth and what ``info`` shows.

    The terms of the reward stand first; ``cost``, ``over``, ``open_time``, ``score`` and ``success`` are
    among the others.
    """

    model: Any  # with `terms`, their number

    @cached_property
    def _agents(self) -> Any:
        return columns_of(self.names, self.statistics[:, np.newaxis])

    @cached_property
    def outcome(self) -> Outcome:
        """Views of the statistics."""
        terms = self.statistics[:, np.newaxis, : self.model.terms]
        return Outcome(terms, self._agents.cost, self._agents.over[:, 0])

    @cached_property
    def truth(self) -> Truth:
        """Views of the statistics."""
        return Truth(self._agents.open_time, self._agents.score, self._agents.success)


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """Configuration of a task, and what it does to a batch of worlds.

    Attributes:
        spacecraft: Name in the catalogue, path of a TOML file, mapping, or a
            :class:`~thruster_envs.spacecraft.Spacecraft`.
        faults: None, a fault, a list of faults or a distribution, as :func:`thruster_envs.faults.as_faults`
            takes them.
        observe_fault: Add the oracle view to the observation: for each thruster what share of its on-time it
            delivers, and how far it is open when closed.
        fault_slots: Faults that one craft can have in an episode.
        nonlinear: Fly by the full two-body relative equations instead of Hill's.
        max_substep: Longest integration sub-step, s; None lets each craft take as many as its turning needs.

    Raises:
        ValueError: A value that a field cannot have, or a vehicle that cannot be flown within
            :data:`~thruster_envs.physics.fleet.ERROR`; one line says which and why.
    """

    spacecraft: Any = "orion"
    faults: Any = None
    observe_fault: bool = False
    fault_slots: int = 4
    nonlinear: bool = False
    max_substep: float | None = None
    vehicle: Spacecraft = field(init=False, repr=False, compare=False, default=None)  # type: ignore[assignment]

    #: Names of the parts of the reward.
    reward_terms: ClassVar[tuple[str, ...]]
    #: Steps after which the views cut an episode; None where the task itself ends it.
    max_episode_steps: ClassVar[int | None]
    #: Fields that the views of one agent fix, so that one craft is commanded.
    one_agent: ClassVar[dict[str, Any]] = {}
    #: Whether its craft move.
    flies: ClassVar[bool] = True
    #: Whether those that do change their place too, and not only turn.
    translates: ClassVar[bool] = True
    #: Whether it takes vehicles with reaction wheels or control-moment gyros.
    takes_storage: ClassVar[bool] = False

    def __post_init__(self) -> None:
        coerce_fields(self)
        object.__setattr__(self, "vehicle", load(self.spacecraft))
        check_whole("fault_slots", self.fault_slots, 1, 64)
        shortest = self.vehicle.control_period / MOST_SUBSTEPS
        if self.max_substep is not None and not shortest <= self.max_substep <= 60.0:
            raise ValueError(
                f"max_substep must be from {shortest:.3g} s ({MOST_SUBSTEPS} in a control period) to 60 s "
                f"(its error grows with the fourth power), got {self.max_substep!r}"
            )
        if self.vehicle.stores_momentum and not self.takes_storage:
            raise ValueError(
                f"spacecraft must have no reaction wheels and no control-moment gyros for "
                f"{type(self).__name__}, got {self.vehicle.name!r} with {len(self.vehicle.reaction_wheels)} "
                f"and {len(self.vehicle.control_moment_gyros)}"
            )
        if self.flies:
            check_flyable(self.vehicle, self.max_substep)
        self.fault_source()

    # What it looks like from outside --------------------------------------------------------------------

    @property
    def number_of_craft(self) -> int:
        """Craft in a world; ``len(agents)`` of them are commanded."""
        return 1

    @property
    def first_commanded(self) -> int:
        """Which craft, from 0, is the first that is commanded; the others that are come right after it."""
        return 0

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Names of the commanded craft."""
        return tuple(f"craft_{k + 1}" for k in range(self.number_of_craft))

    @cached_property
    def choices(self) -> tuple[int, ...] | None:
        """How many options each entry of an agent's action has; None where the action is duties."""
        return None

    @cached_property
    def action_size(self) -> int:
        """Numbers in one agent's action: one for each choice, or the duty of each thruster, 0..1."""
        return self.vehicle.number_of_thrusters if self.choices is None else len(self.choices)

    @cached_property
    def storage_size(self) -> int:
        """Numbers that follow the duties in an agent's action: one for each wheel, then one for each gyro.

        -1..1, shares of the largest torque of a wheel's motor and of the largest rate of a gimbal.
        """
        return len(self.vehicle.reaction_wheels) + len(self.vehicle.control_moment_gyros)

    @cached_property
    def storage_fields(self) -> tuple[Field, ...]:
        """What an agent observes of wheels and gyros, after all else; nothing of a vehicle without any."""
        wheels, gyros = self.vehicle.reaction_wheels, self.vehicle.control_moment_gyros
        speeds = tuple(wheel.max_speed for wheel in wheels)
        groups = (
            Field(
                "wheel_speeds", "measured speeds of the wheels", len(wheels), "rad/s", speeds,
                reference="largest speed of each", bound=_OVERSPEED,
            ),
            Field("gimbal_cosines", "cosines of the measured gimbal angles", len(gyros)),
            Field("gimbal_sines", "sines of the measured gimbal angles", len(gyros)),
        )  # fmt: skip
        return tuple(group for group in groups if group.size > 0)

    def make_fleet(self, worlds: int, threads: int | None) -> Fleet:
        """Its craft in that many worlds."""
        return Fleet(
            self.vehicle, worlds, self.number_of_craft, slots=self.fault_slots, nonlinear=self.nonlinear,
            max_substep=self.max_substep, threads=threads,
        )  # fmt: skip

    def numbers(self, names: type[Any], **derived: float) -> FloatArray:
        """The configuration as an array in the order of a NamedTuple.

        Args:
            names: The NamedTuple; ``period`` and ``mean_motion`` in it are those of the vehicle.
            **derived: What does not stand in the task's own field of the same name.
        """
        known = {"period": self.vehicle.control_period, "mean_motion": self.vehicle.mean_motion} | derived
        fields: tuple[str, ...] = names._fields
        return np.array(
            [known[name] if name in known else getattr(self, name) for name in fields], np.float64
        )

    @cached_property
    @abstractmethod
    def fields(self) -> tuple[Field, ...]:
        """What :meth:`observe` writes for one agent, in order."""

    @property
    def features(self) -> tuple[Field, ...]:
        """The former name of :attr:`fields`."""
        return self.fields

    @cached_property
    def observation_fields(self) -> tuple[Field, ...]:
        """All that one agent observes, in order: the task's own fields, then those of wheels and gyros."""
        return (*self.fields, *self.storage_fields)

    @cached_property
    def observation_size(self) -> int:
        """Numbers that :meth:`observe` writes for one agent."""
        return sum(field.size for field in self.fields)

    def oracle_fields(self) -> tuple[Field, ...]:
        """The oracle view, where it was asked for."""
        if not self.observe_fault:
            return ()
        n = self.vehicle.number_of_thrusters
        return (
            Field("true_share", "true delivered share of each thruster's on-time", n),
            Field("true_opening", "true opening of each thruster when closed", n),
        )

    @cached_property
    def steps(self) -> int | None:
        """Control periods after which the task itself ends an episode; None where it never does."""
        return None

    def default_faults(self) -> tuple[Fault, ...] | FaultDistribution:
        """What ``faults=None`` stands for: no faults, unless a task says otherwise."""
        return ()

    def faults_from(self, faults: Any) -> tuple[Fault, ...] | FaultDistribution:
        """Faults as records or as a distribution, from any form that ``faults`` may have in make or reset."""
        return self.default_faults() if faults is None else as_faults(faults)

    def fault_source(self) -> tuple[Fault, ...] | FaultDistribution:
        """The faults of the configuration as records or as a distribution."""
        return self.faults_from(self.faults)

    # What it does to a batch -----------------------------------------------------------------------------

    @abstractmethod
    def create(self, worlds: int, threads: int | None) -> TaskState:
        """Arrays for that many worlds, not yet begun."""

    @abstractmethod
    def reset(self, state: Any, which: NDArray[np.int64]) -> None:
        """Begin an episode in the worlds ``which``, whose craft the fleet has just put to the start."""

    @abstractmethod
    def step(self, state: Any, actions: NDArray[Any]) -> None:
        """Let one control period pass.

        Under the duties (worlds, agents, n), 0..1; where the task has ``choices``, under the options chosen,
        (worlds, agents, entries) int64 from 0.
        """

    @abstractmethod
    def observe(self, state: Any) -> Observations:
        """(worlds, agents, observation_size), a new array."""

    @abstractmethod
    def outcome(self, state: Any) -> Outcome:
        """What the last step was worth."""

    @abstractmethod
    def truth(self, state: Any) -> Truth:
        """What ``info`` may show."""

    def report(self, state: Any) -> dict[str, dict[str, NDArray[Any]]]:  # noqa: ARG002  # most tasks have nothing
        """What else ``info`` shows: group to name to (worlds, agents), new arrays."""
        return {}

    def picture(self, frame: Frame) -> Picture:
        """What is to be seen of a world beside its craft: by default how far it is from the origin."""
        place = frame.state.fleet.read(at.POSITION, 3)[frame.world, self.first_commanded]
        return Picture(readouts=(distance(place, np.zeros(3)), *fuel_and_score(frame)))

    def sample(self, state: Any, world: int, time: float) -> tuple[float, ...]:  # noqa: ARG002  # most tasks have nothing
        """Numbers that a picture of a world wants of every step of its episode, at ``time`` in s."""
        return ()
