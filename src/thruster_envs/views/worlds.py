"""Worlds living through episodes of one task: seeds, faults, time limits. What every view is a view of."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.configuration import nearest
from thruster_envs.faults import FaultDistribution
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import FaultPlan
from thruster_envs.physics.orbits import Ellipse
from thruster_envs.tasks import Task
from thruster_envs.tasks.access import duties_of, options_of
from thruster_envs.tasks.contract import FloatArray, Observations, check_whole
from thruster_envs.tasks.results import write_results
from thruster_envs.views.inputs import NotReset, checked_options
from thruster_envs.views.storage import Storage

_LOW = 2**64 - 1
_ANOMALY, _ANGLE = Ellipse._fields.index("anomaly"), Ellipse._fields.index("angle")
_NO_LIMIT = 2**62
#: What ``info`` says of how a craft moves, and where it stands in the rows from the position on.
_TURNING = {"attitude": slice(6, 10), "rate": slice(10, 13)}
_MOTION = {"position": slice(0, 3), "velocity": slice(3, 6)} | _TURNING
#: A bound on the worlds of one batch that only a slip of the pen reaches.
MOST_WORLDS = 2**31 - 1
#: The same of threads: there are no more of them than blocks of worlds, whatever is asked for.
MOST_THREADS = 2**15
#: Keys of a reset's options that mean something in some view, and how much like one of them a slip of the
#: pen is; other keys are those of wrappers and checkers, and nobody's business here.
_OPTIONS, _SLIP = ("faults", "reset_mask"), 0.8


class Step(NamedTuple):
    """What one step of all worlds gave, in arrays that nothing else holds.

    Attributes:
        observations: (worlds, agents, observation_size).
        numbers: (terms + 4, agents, worlds): the reward terms, then cost, fuel, score and the reward.
        flags: (2, agents, worlds): success, twice.
        ends: (2, worlds): whether the episode came to its own end, and whether the time limit cut it.
        active: (worlds, agents, slots), whether each fault acts now.
        stale: (worlds, agents, sensors), of which sensor the last measurement dropped out.
        ended: In how many worlds the episode is over.
    """

    observations: Observations
    numbers: FloatArray
    flags: NDArray[np.bool_]
    ends: NDArray[np.bool_]
    active: NDArray[np.bool_]
    stale: NDArray[np.bool_]
    ended: int

    @property
    def rewards(self) -> FloatArray:
        """(worlds, agents), the sum of the reward terms."""
        result: FloatArray = self.numbers[-1].T
        return result

    @property
    def reward_terms(self) -> FloatArray:
        """(worlds, agents, terms)."""
        result: FloatArray = self.numbers[:-4].transpose(2, 1, 0)
        return result

    @property
    def cost(self) -> FloatArray:
        """(worlds, agents)."""
        result: FloatArray = self.numbers[-4].T
        return result

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """(worlds,), the episode came to its own end."""
        result: NDArray[np.bool_] = self.ends[0]
        return result

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """(worlds,), the time limit cut it."""
        result: NDArray[np.bool_] = self.ends[1]
        return result

    @property
    def done(self) -> NDArray[np.bool_]:
        """(worlds,), whether the episode is over for either reason."""
        result: NDArray[np.bool_] = self.ends[0] | self.ends[1]
        return result


class Worlds:
    """Worlds of one task, each with a stream of its own.

    World ``i`` reset with seed ``s + i`` lives through what a single world reset with that seed lives
    through, to the last bit: every draw is a function of the world's seed, of the number of its episode since
    that reset, and of its own time.

    Args:
        task: The task's configuration.
        number: How many worlds.
        max_episode_steps: Steps after which an episode is cut; None for no limit.
        threads: Threads that share a step; None chooses. Results do not depend on it.
    """

    def __init__(
        self, task: Task, number: int, *, max_episode_steps: int | None = None, threads: int | None = None
    ) -> None:
        check_whole("number", number, 1, MOST_WORLDS)
        if threads is not None:
            check_whole("threads", threads, 1, MOST_THREADS)
        if max_episode_steps is not None:
            check_whole("max_episode_steps", max_episode_steps, 1, 2**62)
        self.task, self.number, self.max_episode_steps = task, number, max_episode_steps
        self.state = task.create(number, threads)
        self.fleet = self.state.fleet
        self.faults = self.fleet.plan(task.fault_source())
        self._commanded = slice(task.first_commanded, task.first_commanded + len(task.agents))
        shape = (number, len(task.agents), task.fault_slots)
        self._whole, self._real = np.zeros((4, *shape), np.int64), np.zeros((2, *shape))
        self.keys = np.zeros((number, 2), np.uint64)
        self.episodes = np.zeros(number, np.uint64)
        self.steps = np.zeros(number, np.int64)
        #: Whether seeds have been given, and whether episodes run that a step can go on with.
        self.seeded, self.begun = False, False
        self._seeds: list[tuple[np.int64, int]] = []
        self._shape = (number, len(task.agents), task.action_size)
        #: Called in each step with what is over, before any world begins anew; set while a step is recorded.
        self.watcher: Callable[[NDArray[np.bool_]], None] | None = None
        self._storage = Storage(self.fleet, task) if task.storage_size else None
        self._choices = None if task.choices is None else np.array(task.choices, np.int64)
        self._state_names = tuple((_MOTION if task.translates else _TURNING).items())
        self._nobody, self._everybody = np.zeros(number, np.bool_), np.ones(number, np.bool_)

    def seed(self, which: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """Give some worlds new seeds; the reset that has to follow begins episode 0 of them."""
        self._seeds = list(zip(which, seeds, strict=True))

    def reset(self, which: NDArray[np.int64], options: Mapping[str, Any] | None = None) -> None:
        """Begin the next episode of some worlds.

        Args:
            which: (k,), their numbers.
            options: ``{"faults": ...}`` gives these worlds other faults for this episode only, in any form
                that the task's configuration takes; or a list of such forms, one for each world of the batch,
                where at least one of them is a list itself, None or a distribution. Other keys are left
                alone, with a warning where one looks like a slip of the pen.

        Raises:
            ValueError: Faults that cannot be, or for another number of worlds.
        """
        seeds, self._seeds = self._seeds, []
        options = checked_options(options)
        _warn_of_slips(options)
        plans = self._plans(which, options)
        for world, seed in seeds:  # only now, so that options that are refused change nothing
            self.keys[world] = (seed & _LOW, (seed >> 64) & _LOW)
            self.episodes[world] = _LOW
        self.episodes[which] += np.uint64(1)
        self.steps[which] = 0
        for worlds, plan in plans:
            self.fleet.begin(worlds, self.keys, self.episodes, plan)
        self.task.reset(self.state, which)
        self._tell(which)
        self.seeded = self.begun = True

    def _plans(
        self, which: NDArray[np.int64], options: Mapping[str, Any]
    ) -> list[tuple[NDArray[np.int64], FaultPlan]]:
        """What faults which worlds begin with."""
        if "faults" not in options:
            return [(which, self.faults)]
        faults = options["faults"]
        if not _one_for_each_world(faults):
            return [(which, self.fleet.plan(self.task.faults_from(faults)))]
        if len(faults) != self.number:
            raise ValueError(
                f"faults has {len(faults)} entries, of which at least one is the faults of a whole world; "
                f"must have one for each of the {self.number} worlds"
            )
        plans = []
        for world in which:
            try:
                plan = self.fleet.plan(self.task.faults_from(faults[world]))
            except ValueError as error:
                raise ValueError(f"world {world}: {error}") from None
            plans.append((np.array([world], np.int64), plan))
        return plans

    def require_reset(self, call: str) -> None:
        """Refuse a call that needs an episode.

        Raises:
            NotReset: None has begun.
        """
        if not self.begun:
            raise NotReset(call)

    def seed_of(self, world: int) -> int:
        """The seed that a world was last given."""
        low, high = self.keys[world].tolist()
        return int(low | high << 64)

    def observe(self) -> Observations:
        """(worlds, agents, observation_size), a new array."""
        observations = self.task.observe(self.state)
        return observations if self._storage is None else self._storage.observed(observations)

    def step(self, actions: ArrayLike, *, begins: NDArray[np.bool_] | None = None) -> Step:
        """Let one control period pass in every world.

        Args:
            actions: (worlds, agents, n) in [-1, 1]; -1 keeps a thruster shut, 1 opens it for the whole
                period. What lies outside is clipped. Where the task has ``choices``, (worlds, agents,
                entries) whole numbers from 0, one option for each of them.
            begins: (worlds,), worlds whose action does not count because they begin their next episode with
                this step: its first observation, reward 0, not over.

        Raises:
            NotReset: No episode has begun.
            ValueError: Another shape, a number that is not finite, or an option that does not exist.
        """
        self.require_reset("step")
        array = np.asarray(actions, dtype=np.float64)
        if self._storage is not None:
            array = self._storage.commanded(array, self._shape)
        if array.shape != self._shape:
            raise ValueError(f"the action has the shape {array.shape}; {self._shape} would be right")
        self.task.step(self.state, self._duties(array) if self._choices is None else self._options(array))
        self.steps += 1
        if self.watcher is not None:
            over = self.task.outcome(self.state).terminated.astype(np.bool_)
            if self.max_episode_steps is not None:
                over |= self.steps >= self.max_episode_steps
            self.watcher(over)
        if begins is None:
            return self._results(self._nobody)
        which = begins.nonzero()[0]
        if which.size:
            self.reset(which)
        return self._results(begins)

    def now(self) -> Step:
        """What a reset gives: what can be seen, and reward terms and costs of 0."""
        return self._results(self._everybody)

    def _results(self, begins: NDArray[np.bool_]) -> Step:
        """What there is to say after a step, or without one; of worlds that begin an episode its start."""
        outcome, truth = self.task.outcome(self.state), self.task.truth(self.state)
        worlds, agents, _ = self._shape
        numbers = np.empty((len(self.task.reward_terms) + 4, agents, worlds))
        flags, ends = np.empty((2, agents, worlds), np.bool_), np.empty((2, worlds), np.bool_)
        limit = _NO_LIMIT if self.max_episode_steps is None else self.max_episode_steps
        ended = write_results(tuple(outcome), tuple(truth), begins, self.steps, limit, (numbers, flags, ends))
        active = self.fleet.active(self.steps, self.task.first_commanded, agents)
        stale = self.fleet.stale()[:, self._commanded]
        return Step(self.observe(), numbers, flags, ends, active, stale, ended)

    def _duties(self, actions: FloatArray) -> FloatArray:
        duties = np.empty(self._shape)
        if not duties_of(actions, duties):
            world, agent, thruster = np.argwhere(~np.isfinite(actions))[0]
            raise ValueError(
                f"the action of world {world}, {self.task.agents[agent]}, thruster {thruster + 1} is "
                f"{actions[world, agent, thruster]}; a number from -1 to 1 would be right"
            )
        return duties

    def _options(self, actions: FloatArray) -> NDArray[np.int64]:
        assert self._choices is not None  # whoever asks has looked
        options = np.empty(self._shape, np.int64)
        if not options_of(actions, self._choices, options):
            world, agent, entry = np.argwhere(options != actions)[0]
            raise ValueError(
                f"the action of world {world}, {self.task.agents[agent]}, entry {entry} is "
                f"{actions[world, agent, entry]:g}; a whole number from 0 to {self._choices[entry] - 1} "
                "would be right"
            )
        return options

    def info(self, step: Step | None = None) -> dict[str, Any]:
        """What ``info`` carries, always the same keys: new arrays whose first axes are (worlds, agents).

        ``fault`` has (worlds, agents, slots) arrays: ``thruster`` (from 1, those of a redundant branch after
        the others; 0 in an empty slot and where a sensor fails), ``kind`` (code, in the order of
        ``thruster_envs.faults.KINDS`` from 1, or of ``SENSOR_KINDS`` where a sensor fails; 0 is an empty
        slot), ``severity``, ``onset`` (s), ``active``, ``sensor`` (code, in the order of
        ``thruster_envs.faults.SENSORS`` from 1; 0 for a thruster) and ``axis`` (from 1; 0 for all three).
        ``stale`` (worlds, agents, sensors) says of which sensor the last measurement dropped out. Then comes
        what a task has to report beyond that. ``state``, where craft fly, is how they truly move, (worlds,
        agents, 3 or 4) each: ``position`` (m) and ``velocity`` (m/s) in LVLH axes, but of craft that only
        turn, ``attitude`` from LVLH to the body (scalar first) and inertial ``rate`` in body axes (rad/s).
        About an orbit that is elliptic or has J2 there is ``orbit``, with the ``true_anomaly`` (worlds,
        agents), rad; with J2 it counts from the vehicle's argument of perigee.

        Args:
            step: What the last step gave, whose arrays become those of the info; None takes :meth:`now`.
        """
        step = self.now() if step is None else step
        return self._info(
            [row.T for row in step.numbers],
            [row.T for row in step.flags],
            _Described.of(self._whole.copy(), self._real.copy()),
            step.active,
            step.stale,
            self._report() | self._true_state(self._commanded),
        )

    def info_of(self, step: Step, agent: int) -> dict[str, Any]:
        """The same for one agent: arrays whose first axis is the world."""
        return self._info(
            list(step.numbers[:, agent]),
            list(step.flags[:, agent]),
            _Described.of(self._whole[:, :, agent].copy(), self._real[:, :, agent].copy()),
            step.active[:, agent],
            step.stale[:, agent],
            {
                group: {name: array[:, agent] for name, array in entries.items()}
                for group, entries in self._report().items()
            }
            | self._true_state(self.task.first_commanded + agent),
        )

    def info_of_one(self, step: Step, agent: int) -> dict[str, Any]:
        """The same for one agent of the first world: Python's numbers, and arrays over the fault slots."""
        return self._info(
            step.numbers[:, agent, 0].tolist(),
            step.flags[:, agent, 0].tolist(),
            _Described.of(self._whole[:, 0, agent].copy(), self._real[:, 0, agent].copy()),
            step.active[0, agent],
            step.stale[0, agent],
            {
                group: {
                    name: array.item(agent) if array.ndim == 2 else array[0, agent].copy()
                    for name, array in entries.items()
                }
                for group, entries in self._report().items()
            }
            | self._true_state_of_one(self.task.first_commanded + agent),
        )

    def _report(self) -> dict[str, dict[str, NDArray[Any]]]:
        """What else there is to report: group to name to (worlds, agents, ...), new arrays."""
        stored = {} if self._storage is None else self._storage.report()
        return self.task.report(self.state) | stored | self._orbit()

    def _true_state(self, craft: int | slice) -> dict[str, dict[str, NDArray[Any]]]:
        """How craft truly move, (worlds, ...); nothing where nothing flies, no place where they only turn."""
        if not self.task.flies:
            return {}
        rows, names = self.fleet.read(at.POSITION, 13)[:, craft], self._state_names
        return {"state": {name: rows[..., part] for name, part in names}}

    def _true_state_of_one(self, craft: int) -> dict[str, dict[str, NDArray[Any]]]:
        """The same of one craft of the first world, without the axis of the worlds."""
        if not self.task.flies:
            return {}
        block, lane = divmod(craft, self.fleet.lanes)
        row = self.fleet.data[block, at.POSITION : at.POSITION + 13, lane].copy()
        return {"state": {name: row[part] for name, part in self._state_names}}

    def _orbit(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Where a fleet stands on its orbit; nothing where it turns steadily, or nothing flies."""
        ellipses = self.fleet.ellipses() if self.task.flies else None
        if ellipses is None:
            return {}
        orbit = self.task.vehicle.reference_orbit
        anomaly = ellipses[:, _ANOMALY, np.newaxis]
        if orbit.j2 > 0.0:  # the osculating perigee wanders, and a circle has none
            turned = ellipses[:, _ANGLE, np.newaxis] - orbit.argument_of_perigee
            anomaly = turned - 2.0 * math.pi * np.round(turned / (2.0 * math.pi))
        return {"orbit": {"true_anomaly": np.repeat(anomaly, len(self.task.agents), axis=1)}}

    def _info(
        self,
        numbers: list[Any],
        flags: list[Any],
        described: _Described,
        active: NDArray[np.bool_],
        stale: NDArray[np.bool_],
        report: dict[str, Any],
    ) -> dict[str, Any]:
        """Numbers, flags and faults under their names."""
        *terms, cost, fuel, score, _ = numbers
        thruster, kind, severity, onset, sensor, axis = described
        return {
            "reward_terms": dict(zip(self.task.reward_terms, terms, strict=True)),
            "cost": cost,
            "fault": {
                "thruster": thruster,
                "kind": kind,
                "severity": severity,
                "onset": onset,
                "active": active,
                "sensor": sensor,
                "axis": axis,
            },
            "stale": stale,
            "fuel": fuel,
            "score": score,
            "success": flags[0],
            "is_success": flags[1],
            **report,
        }

    def save(self) -> dict[str, NDArray[Any]]:
        """Everything that later steps depend on, as copies by name."""
        own = {name: getattr(self, name).copy() for name in ("keys", "episodes", "steps")}
        told = {f"told.{name}": array.copy() for name, array in self._describe()._asdict().items()}
        flags = {"seeded": np.array(self.seeded), "begun": np.array(self.begun)}
        return self.state.save() | own | told | flags

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save` gave.

        Raises:
            ValueError: What was saved is of other worlds: something is missing, or has another shape.
        """
        for name, own in self.save().items():
            given = np.shape(saved[name]) if name in saved else None
            if given != own.shape:
                raise ValueError(f"the saved {name} has the shape {given}; {own.shape} would be right")
        self.state.restore(dict(saved))
        for name in ("keys", "episodes", "steps"):
            getattr(self, name)[...] = saved[name]
        self.seeded, self.begun = bool(saved["seeded"]), bool(saved["begun"])
        for name, array in self._describe()._asdict().items():
            array[...] = saved[f"told.{name}"]

    def _describe(self) -> _Described:
        return _Described.of(self._whole, self._real)

    def _tell(self, which: NDArray[np.int64]) -> None:
        """Note the faults with which the episodes of some worlds begin."""
        self.fleet.describe_faults(which, self.task.first_commanded, tuple(self._describe()))


class _Described(NamedTuple):
    """What ``info`` says of the faults of an episode: arrays whose last axis is the slot."""

    thruster: NDArray[np.int64]
    kind: NDArray[np.int64]
    severity: FloatArray
    onset: FloatArray
    sensor: NDArray[np.int64]
    axis: NDArray[np.int64]

    @classmethod
    def of(cls, whole: NDArray[np.int64], real: FloatArray) -> _Described:
        """Views of two arrays, (4, ...) and (2, ...), which are copied faster than six."""
        return cls(whole[0], whole[1], real[0], real[1], whole[2], whole[3])


def _warn_of_slips(options: Mapping[str, Any]) -> None:
    """Say so where an option that is left alone is nearly one that is not."""
    for key in options:
        near = None if key in _OPTIONS else nearest(str(key), _OPTIONS, likeness=_SLIP)
        if near is not None:
            warnings.warn(
                f"reset(options=...) has the key {key!r}, which nothing reads; did you mean {near!r}?",
                UserWarning,
                stacklevel=4,
            )


def _one_for_each_world(faults: Any) -> bool:
    """Whether faults are a list with those of each world, instead of the faults of every world."""
    whole = (list, tuple, FaultDistribution, type(None))
    return isinstance(faults, (list, tuple)) and any(isinstance(one, whole) for one in faults)
