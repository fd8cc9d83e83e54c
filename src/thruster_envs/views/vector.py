"""The batch as a native Gymnasium ``VectorEnv``, with all three kinds of autoreset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from thruster_envs.tasks import Task
from thruster_envs.tasks.contract import check_whole
from thruster_envs.views.inputs import checked_actions, checked_options, checked_seed
from thruster_envs.views.making import view_of_path
from thruster_envs.views.scenes import RENDER_MODES, Camera
from thruster_envs.views.single import (
    checked_flag,
    checked_render_mode,
    flattened,
    make_task,
    seed_in_use,
)
from thruster_envs.views.spaces import action_space, observation_space
from thruster_envs.views.specs import stated
from thruster_envs.views.states import MidEpisode
from thruster_envs.views.worlds import MOST_WORLDS, Step, Worlds

Observations = NDArray[np.float32]
_End = tuple[NDArray[np.bool_], dict[str, Any]]
"""Worlds whose episode ended, and what ``info`` was then."""
_ARGUMENTS = ("num_envs", "max_episode_steps", "render_mode", "autoreset_mode", "threads", "flat_info")


class TaskVectorEnv(MidEpisode, VectorEnv[Observations, Any, Any]):
    """Many worlds of a task, one commanded craft in each; subclasses name the task.

    World ``i`` of a batch reset with ``seed=s`` equals the single environment reset with ``seed=s + i`` bit
    for bit, later episodes included; a list of seeds is taken too. ``reset(options={"reset_mask": mask})``
    begins new episodes in the worlds of the mask and leaves the others alone. ``options={"faults": ...}``
    gives all of them the same faults for that episode; a list of lists, one for each world, each its own.

    At the end of an episode: with ``NEXT_STEP`` the next step ignores the action of that world, begins its
    next episode and gives that first observation, reward 0 and both flags False; with ``SAME_STEP`` the same
    step gives the first observation of the next episode, and what was last is in ``infos["final_obs"]`` and
    ``infos["final_info"]`` under the masks ``_final_obs`` and ``_final_info``; with ``DISABLED`` it is the
    caller's to reset, and the world goes on past its end until then.

    Args:
        num_envs: Number of worlds.
        max_episode_steps: Time limit; None takes the task's own.
        render_mode: None, ``"rgb_array"`` (one picture for each world) or ``"human"`` (the first world in a
            window).
        autoreset_mode: An ``AutoresetMode`` or its value.
        threads: Threads that share a step; None chooses. Results do not depend on it.
        flat_info: Whether ``infos`` have no dictionaries in them, but keys like ``reward_terms/fuel``
            (``final_info`` is one still, with such keys).
        **configuration: Fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]  # Gymnasium declares an instance attribute
        "render_modes": list(RENDER_MODES),
        "render_fps": 20,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    task_type: ClassVar[type[Task]]
    made_with: ClassVar[tuple[str, ...]] = ("autoreset_mode",)
    _spec: EnvSpec | None = None
    _cameras: Sequence[Camera] = ()  # where the constructor fails there are none to close

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        flat_info: bool = False,
        **configuration: Any,
    ) -> None:
        check_whole("num_envs", num_envs, 1, MOST_WORLDS)
        self.task = make_task(
            self.task_type, configuration, self.task_type.one_agent, _ARGUMENTS, type(self).__name__
        )
        self.num_envs, self.render_mode = num_envs, checked_render_mode(render_mode)
        self.flat_info = checked_flag("flat_info", flat_info)
        self._seeds: tuple[int, ...] | None = None
        self._set_mode(autoreset_mode)
        #: Whether the mode is another than what wrappers around this environment may have seen.
        self.mode_was_changed = False
        limit = max_episode_steps if max_episode_steps is not None else self.task.max_episode_steps
        self.worlds = Worlds(self.task, num_envs, max_episode_steps=limit, threads=threads)
        self.single_observation_space = observation_space(self.task)
        self.single_action_space = action_space(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        title = type(self).__name__.removesuffix("VectorEnv")
        watched = {None: 0, "human": 1, "rgb_array": num_envs}[self.render_mode]
        self._cameras = [Camera(self.worlds, world, f"{title} {world}") for world in range(watched)]
        self._over = np.zeros(num_envs, np.bool_)
        self._keys = 0  # of an info, those of the dictionaries in it among them; not counted yet

    @property
    def spec(self) -> EnvSpec | None:
        """How to make this environment again, as plain data."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = stated(spec, self.task, self.worlds.max_episode_steps)

    def set_autoreset_mode(self, mode: AutoresetMode | str) -> None:
        """Choose what happens at the end of an episode.

        Wrappers read the mode when they are made, so choose it before wrapping. Episodes that run are cut
        off: all worlds have to be reset before the next step.
        """
        before = self.autoreset_mode
        self._set_mode(mode)
        if self.autoreset_mode != before:
            self.mode_was_changed, self.worlds.begun = True, False

    def _set_mode(self, mode: AutoresetMode | str) -> None:
        try:
            self.autoreset_mode = AutoresetMode(mode)
        except ValueError:
            values = ", ".join(repr(one.value) for one in AutoresetMode)
            raise ValueError(
                f"autoreset_mode is {mode!r}; an AutoresetMode or one of {values} would be right"
            ) from None
        self.metadata = dict(type(self).metadata) | {"autoreset_mode": self.autoreset_mode}  # type: ignore[misc]  # per instance on purpose

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin episodes, in all worlds or in those of ``options["reset_mask"]``.

        ``options["faults"]`` gives them faults of their own for this episode: the same in all, or, as a list
        with an entry for each world of which one at least is itself a list (or None, or a distribution), each
        its own. ``seed`` is a number, to which that of the world is added, or a list with one for each world.
        After a reset ``np_random_seed`` repeats it.
        """
        mask = self._checked_mask(options)
        which = np.flatnonzero(mask)
        seeds = self._seeds_of(which, seed)
        self.worlds.seed(np.array(list(seeds), np.int64), list(seeds.values()))
        self.worlds.reset(which, options)
        if isinstance(seed, Sequence) or (isinstance(seed, np.ndarray) and seed.ndim):
            self._seeds = tuple(self.worlds.seed_of(world) for world in range(self.num_envs))
        elif seed is not None:
            super().reset(seed=checked_seed(seed))
            self._seeds = None
        self._over[which] = False
        for camera in self._cameras:
            if mask[camera.world]:
                camera.begin()
        now = self.worlds.now()
        return now.observations[:, 0], self._masked(self._infos(now), True)

    def _checked_mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        if options is None or "reset_mask" not in checked_options(options):
            return np.ones(self.num_envs, np.bool_)
        mask = options["reset_mask"]
        if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)):
            raise ValueError(
                f"reset_mask is {mask!r}; a bool array of shape ({self.num_envs},) would be right"
            )
        if not mask.any():
            raise ValueError("reset_mask is False everywhere; at least one True would be right")
        if not mask.all() and not self.worlds.begun:
            raise ValueError("reset_mask leaves worlds out that were never reset; reset all of them first")
        return mask

    def _seeds_of(self, which: NDArray[np.int64], seed: Any) -> dict[int, int]:
        """The seeds that a reset gives, by world: to those that begin, or to all where none has one yet."""
        if isinstance(seed, np.ndarray) and seed.ndim:
            seed = seed.tolist()
        if seed is not None and (not isinstance(seed, Sequence) or isinstance(seed, str | bytes)):
            first = checked_seed(seed)
            return {int(world): first + int(world) for world in which}
        seeds = [None] * self.num_envs if seed is None else seed
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must have {self.num_envs} entries, one for each world, got {len(seeds)}")
        given = {int(world): checked_seed(seeds[world]) for world in which if seeds[world] is not None}
        if self.worlds.seeded:
            return given
        first = seed_in_use(self)
        return {world: first + world for world in range(self.num_envs)} | given

    @property
    def np_random_seed(self) -> Any:
        """What ``reset(seed=...)`` takes to repeat the episodes since the last seeded, or the first, reset.

        A number, or where worlds were given seeds of their own, the seed of each.
        """
        return super().np_random_seed if self._seeds is None else self._seeds

    def step(
        self, actions: Any
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Let one control period pass in every world."""
        return self.step_held(actions, 1)

    def step_held(
        self, actions: Any, periods: int
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Let some control periods pass in every world under one action; an episode's end ends its own hold.

        Rewards, their terms and costs are summed; all else is what was last. In the mode ``DISABLED`` a world
        whose episode ends early goes on past its end for the rest of the hold, unseen.
        """
        self.worlds.require_reset("step")
        switches = self.task.choices is not None
        chosen = checked_actions(actions, self.action_space.shape or (), switches=switches)
        chosen = chosen.reshape((self.num_envs, 1, -1))
        step, ends = self._hold(chosen, periods) if periods > 1 else (self._one_period(chosen), [])
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            return self._reset_after(step, ends)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            self._over = step.done
        infos = self._masked(_at_ends(self._infos(step), ends), True)
        return step.observations[:, 0], step.numbers[-1, 0], step.ends[0], step.ends[1], infos

    def _one_period(self, chosen: NDArray[np.float64]) -> Step:
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            return self.worlds.step(chosen)
        begins = self._over
        step = self.worlds.step(chosen, begins=begins)
        if self._cameras:
            self._film(begins, np.ones_like(begins))
        return step

    def _hold(self, chosen: NDArray[np.float64], periods: int) -> tuple[Step, list[_End]]:
        """The sum of some periods, and what ``info`` was where an episode ended before the last of them.

        A world that is over flies on, and nobody looks; one that is to begin does so in the last period.
        """
        ends: list[_End] = []
        resets_itself = self.autoreset_mode == AutoresetMode.SAME_STEP
        begins = np.zeros(self.num_envs, np.bool_) if resets_itself else self._over
        running = ~begins
        total, seen = self.worlds.step(chosen), running
        for nothing_yet in (*total.numbers[:-3], total.numbers[-1]):
            nothing_yet[:, ~seen] = 0.0
        for left in reversed(range(periods)):
            if left < periods - 1:
                seen = running if left else running | begins
                total = _added(total, self.worlds.step(chosen, begins=None if left else begins), seen)
            if left or not resets_itself:
                self._film(begins, seen)
            over = running & total.done
            if left and over.any():
                ends.append((over, self._infos(total)))
            running = running & ~over
        return total, ends

    def _reset_after(
        self, step: Step, ends: list[_End]
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        last, rewards = {}, step.numbers[-1, 0]
        if step.ended:
            done, observations = step.done, step.observations[:, 0]
            last = {
                "final_obs": np.where(done[:, np.newaxis], observations, np.float32(0.0)),
                "_final_obs": done.copy(),
                "final_info": self._masked(_only(_at_ends(self._infos(step), ends), done), done),
                "_final_info": done.copy(),
            }
            self.worlds.reset(np.flatnonzero(done))
            now = self.worlds.now()
            step = Step(
                now.observations, np.where(done, now.numbers, step.numbers),
                np.where(done, now.flags, step.flags), step.ends, now.active, now.stale, step.ended,
            )  # fmt: skip
        if self._cameras:
            self._film(step.done, np.ones(self.num_envs, np.bool_))
        infos = self._masked(self._infos(step), True) | last
        return step.observations[:, 0], rewards, step.ends[0], step.ends[1], infos

    def _film(self, begins: NDArray[np.bool_], which: NDArray[np.bool_]) -> None:
        for camera in (one for one in self._cameras if which[one.world]):
            camera.watch(begins=bool(begins[camera.world]), mode=self.render_mode)

    def _infos(self, step: Step) -> dict[str, Any]:
        """Arrays whose first axis is the world."""
        return self.worlds.info_of(step, 0)

    def _masked(self, info: dict[str, Any], mask: NDArray[np.bool_] | bool) -> dict[str, Any]:
        """The same as users get it: flat if they asked for that, and beside every key its mask."""
        if self.flat_info:
            info = flattened(info)
        if self._keys == 0:
            self._keys = _number_of_keys(info)
        masks = np.empty((self._keys, self.num_envs), np.bool_)
        masks[...] = mask
        return _with_masks(info, iter(masks))

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Pictures of the worlds now, in the mode ``rgb_array``."""
        self.worlds.require_reset("render")
        if self.render_mode == "rgb_array":
            return tuple(camera.frame() for camera in self._cameras)
        for camera in self._cameras:
            camera.show()
        return None

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002  # Gymnasium's signature
        """Close the window, if there is one."""
        for camera in self._cameras:
            camera.close()

    @property
    def pending_resets(self) -> NDArray[np.bool_]:
        """Which worlds will begin a new episode at the next step, whatever the action (NEXT_STEP only)."""
        return self._over.copy()

    def _own_state(self) -> dict[str, NDArray[Any]]:
        return {"over": self._over.copy(), "own_seeds": np.array(self._seeds is not None)}

    def _set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        self._over = state["over"].copy()
        own = bool(state["own_seeds"])
        self._seeds = tuple(map(self.worlds.seed_of, range(self.num_envs))) if own else None
        for camera in self._cameras if self.worlds.begun else ():
            camera.begin()


def _added(total: Step, step: Step, seen: NDArray[np.bool_]) -> Step:
    """The sum of what steps gave, and what was last, with one more step of the worlds that are seen."""
    rows = seen[:, np.newaxis, np.newaxis]
    numbers = step.numbers.copy()
    for summed in (slice(None, -3), -1):  # all but fuel and score
        numbers[summed] += total.numbers[summed]
    ends = np.where(seen, step.ends, total.ends)
    return Step(
        np.where(rows, step.observations, total.observations),
        np.where(seen, numbers, total.numbers),
        np.where(seen, step.flags, total.flags),
        ends,
        np.where(rows, step.active, total.active),
        np.where(rows, step.stale, total.stale),
        int(np.count_nonzero(ends[0] | ends[1])),
    )


def _at_ends(info: dict[str, Any], ends: list[_End]) -> dict[str, Any]:
    """What ``info`` says now, and of each world whose episode has ended what it said then."""
    for over, then in ends:
        info = _merged(over, then, info)
    return info


def _merged(mask: NDArray[np.bool_], first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """The one where the mask is True, the other where it is False."""
    result: dict[str, Any] = {}
    for key, value in second.items():
        if isinstance(value, dict):
            result[key] = _merged(mask, first[key], value)
        else:
            result[key] = np.where(mask.reshape((-1,) + (1,) * (value.ndim - 1)), first[key], value)
    return result


def _only(info: dict[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Copies with zeros where the mask is False."""
    result: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, dict):
            result[key] = _only(value, mask)
        else:
            result[key] = np.where(
                mask.reshape((-1,) + (1,) * (value.ndim - 1)), value, np.zeros((), value.dtype)
            )
    return result


def _number_of_keys(info: dict[str, Any]) -> int:
    """How many keys an info has, those of the dictionaries in it among them."""
    return len(info) + sum(_number_of_keys(value) for value in info.values() if isinstance(value, dict))


def _with_masks(info: dict[str, Any], masks: Iterator[NDArray[np.bool_]]) -> dict[str, Any]:
    """Beside every key its mask, as Gymnasium's own vector environments have it."""
    result: dict[str, Any] = {}
    for key, value in info.items():
        result[key] = _with_masks(value, masks) if isinstance(value, dict) else value
        result[f"_{key}"] = next(masks)
    return result


def __getattr__(name: str) -> Any:
    """The vector environment of a task, by the path to its class with slashes."""
    if "/" in name:
        return view_of_path(TaskVectorEnv, name, "VectorEnv")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
