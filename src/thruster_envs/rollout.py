"""One loop that flies a policy through episodes, and records what became of it.

>>> recording = fly("thruster_envs/OrionRendezvous-v1", seeds=range(2), steps=3)
>>> recording.reward.shape, recording.final("time").tolist(), recording.metadata["policy"]
((6,), [15.0, 15.0], 'random')

The loop records the truth, of which the policy sees nothing: it is shown what the environment shows.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

import thruster_envs
from thruster_envs.configuration import as_plain, nearest, shown
from thruster_envs.extras import extra
from thruster_envs.faults import KINDS, SENSOR_KINDS, SENSORS
from thruster_envs.physics import rows as at
from thruster_envs.recordings import Channel, Recording, concatenate
from thruster_envs.tasks.contract import check_whole
from thruster_envs.views.inputs import checked_seed
from thruster_envs.views.single import flattened
from thruster_envs.views.states import MidEpisode, configuration_of
from thruster_envs.views.worlds import Worlds

__all__ = ["Interrupted", "Moment", "Recording", "concatenate", "fly"]

Array: TypeAlias = NDArray[Any]
_XYZ, _WXYZ = ("x", "y", "z"), ("w", "x", "y", "z")
_AXES = ("x", "y", "z", "about_x", "about_y", "about_z")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while flying.

    Attributes:
        recording: What had been flown until then; the last episodes are cut short.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__("interrupted; what was flown until then is in the attribute recording")
        self.recording = recording


class Moment(NamedTuple):
    """What a callback of :func:`fly` gets, before each decision and once at the end.

    Attributes:
        step: Steps since the reset.
        observations: As the policy gets them next.
        infos: As the environment gave them.
        running: (worlds,), which episodes go on.
        env: What flies.
    """

    step: int
    observations: Any
    infos: dict[str, Any]
    running: NDArray[np.bool_]
    env: Any


def fly(
    env: Any,
    policy: Any = None,
    seeds: int | Sequence[int] | None = None,
    *,
    steps: int | None = None,
    past_end: bool = False,
    options: Mapping[str, Any] | None = None,
    record: Sequence[str] | None = None,
    callback: Callable[[Moment], Any] | None = None,
    together: int | None = None,
    deterministic: bool = True,
    progress: bool = False,
    **arguments: Any,
) -> Recording:
    """Fly a policy through one episode for each seed, and record it. Each argument is a user's option.

    Args:
        env: An id, which is made; or an environment of this suite, wrapped or not: of Gymnasium, single or
            vector, or a ``ParallelEnv``. It is used as it is, and stays open.
        policy: Gives actions for observations. None or ``"random"`` draws them from the action space,
            ``"idle"`` fires nothing and declares nothing. Else an object with ``predict``, as those of
            Stable-Baselines3 have it; or a callable. It gets what the environment gives: an observation, a
            row for each world, or a dictionary by agent. A sequence has one policy for each seed, each of
            which sees one world alone; a dictionary one for each agent. A policy's ``reset()``, if there is
            one, is called before the episodes begin; its attribute ``belief`` (an array, or arrays by name,
            with a row for each world), if there is one, is recorded after each decision.
        seeds: A number flies one episode in a single environment; a sequence one for each seed, of an id side
            by side in one batch, of a single environment one after the other. A vector environment takes one
            for each world, or a number to which that of the world is added. None draws one.
        steps: After which an episode is cut here, if it has not ended before.
        past_end: Fly on to the last of the ``steps`` in every world, whatever ends on the way: of an id, or
            of a vector environment in the mode ``DISABLED``.
        options: Of every reset, ``{"faults": ...}`` for example.
        record: Channels to keep, or groups of them: ``("position", "reward_terms")``. All by default.
        callback: Called before each decision and once at the end; False from it ends the episodes there.
        together: Of an id, how many episodes fly side by side at most; all by default.
        deterministic: What ``predict`` is called with.
        progress: Show a bar on the terminal; needs the extra ``agents``.
        **arguments: Of the environment, where it is made from an id.

    Raises:
        ValueError: Another environment, seeds that do not fit, a belief of another shape, or a channel that
            there is not; one line.
        Interrupted: Ctrl-C; it has the recording of what was flown.
    """
    if steps is not None:
        check_whole("steps", steps, 1, 2**62)
    if together is not None:
        check_whole("together", together, 1, 2**31 - 1)
    if past_end and steps is None:
        raise ValueError("steps must be given to fly past the end of an episode, got None")
    rounds = list(_rounds(env, seeds, together, arguments))
    settings = _Settings(policy, steps, past_end, options, record, callback, deterministic)
    total = sum(len(one.seeds) for one in rounds)
    if _several(policy) and len(policy) != total:
        raise ValueError(f"policy must have one entry for each of {total} episodes, got {len(policy)}")
    flown: list[Recording] = []
    with _bar(progress, total) as tell:
        for number, one in enumerate(rounds):
            first = sum(len(other.seeds) for other in rounds[:number])
            try:
                flown.append(_fly_round(one, settings, first, tell))
            except Interrupted as stop:
                raise Interrupted(concatenate([*flown, stop.recording])) from None
    return concatenate(flown)


class _Settings(NamedTuple):
    policy: Any
    steps: int | None
    past_end: bool
    options: Mapping[str, Any] | None
    record: Sequence[str] | None
    callback: Callable[[Moment], Any] | None
    deterministic: bool


# What flies, in one form -----------------------------------------------------------------------------------


class _Round(NamedTuple):
    """Episodes that fly side by side."""

    make: Callable[[], Any]
    seeds: tuple[int, ...]
    closes: bool


def _rounds(
    env: Any, seeds: int | Sequence[int] | None, together: int | None, arguments: Mapping[str, Any]
) -> Iterator[_Round]:
    several = isinstance(seeds, (Sequence, np.ndarray))
    if isinstance(seeds, str):
        raise ValueError(f"seeds must be whole numbers, got {shown(seeds)}")
    given: Any = seeds if several else [np.random.SeedSequence().entropy if seeds is None else seeds]
    numbers = tuple(map(checked_seed, given))
    if not numbers:
        raise ValueError("seeds must have at least one, got none")
    if isinstance(env, str):
        if not several:
            yield _Round(partial(gym.make, env, disable_env_checker=True, **arguments), numbers, True)
            return
        most = together or len(numbers)
        for first in range(0, len(numbers), most):
            part = numbers[first : first + most]
            make = partial(
                gym.make_vec, env, num_envs=len(part), vectorization_mode="vector_entry_point",
                **{"autoreset_mode": AutoresetMode.DISABLED} | dict(arguments),
            )  # fmt: skip
            yield _Round(make, part, True)
        return
    if arguments:
        raise ValueError(f"{next(iter(arguments))} can only be given with an id, and env is {shown(env)}")
    if not isinstance(getattr(env, "unwrapped", None), MidEpisode):
        raise ValueError(f"env must be an id or an environment of thruster_envs, got {shown(env)}")
    if not isinstance(env, VectorEnv):
        for seed in numbers:
            yield _Round(lambda: env, (seed,), False)
        return
    if not several:
        numbers = tuple(numbers[0] + world for world in range(env.num_envs))
    if len(numbers) % env.num_envs:
        raise ValueError(
            f"seeds must be one for each of the {env.num_envs} worlds, or several times as many, "
            f"got {len(numbers)}"
        )
    for first in range(0, len(numbers), env.num_envs):
        yield _Round(lambda: env, numbers[first : first + env.num_envs], False)


class _Result(NamedTuple):
    """What a reset or step gave; the first axis of all arrays is the world."""

    observations: Any
    seen: Array
    rewards: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    infos: dict[str, Any]
    told: dict[str, Array]


class _Form(Protocol):
    """A view, with the world as the first axis of what it gives."""

    env: Any

    def reset(self, seeds: tuple[int, ...], options: Mapping[str, Any] | None) -> _Result: ...

    def step(self, actions: Any) -> _Result: ...

    def written(self, actions: Any) -> Array:
        """Actions as an array, (worlds, ...)."""
        ...


class _Single:
    """A single environment."""

    def __init__(self, env: Any) -> None:
        self.env = env

    def reset(self, seeds: tuple[int, ...], options: Mapping[str, Any] | None) -> _Result:
        observation, info = self.env.reset(seed=seeds[0], options=_own(options))
        return self._result(observation, 0.0, False, False, info)

    def step(self, actions: Any) -> _Result:
        return self._result(*self.env.step(actions))

    def written(self, actions: Any) -> Array:
        return np.asarray(actions)[np.newaxis]

    def _result(self, observation: Any, reward: Any, terminated: Any, truncated: Any, info: Any) -> _Result:
        told = {name: np.asarray(value)[np.newaxis] for name, value in _entries(info)}
        return _Result(
            observation, np.asarray(observation)[np.newaxis], np.array([float(reward)]),
            np.array([bool(terminated)]), np.array([bool(truncated)]), info, told,
        )  # fmt: skip


class _Vector:
    """A vector environment, in any autoreset mode."""

    def __init__(self, env: Any) -> None:
        self.env = env

    def reset(self, seeds: tuple[int, ...], options: Mapping[str, Any] | None) -> _Result:
        observations, infos = self.env.reset(seed=list(seeds), options=_own(options))
        nobody = np.zeros(self.env.num_envs, np.bool_)
        return _Result(
            observations, np.asarray(observations), np.zeros(nobody.size), nobody, nobody, infos,
            dict(_entries(infos)),
        )  # fmt: skip

    def step(self, actions: Any) -> _Result:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        seen, told = np.asarray(observations), dict(_entries(infos))
        ended = terminated | truncated
        if "final_info" in infos and ended.any():
            last = dict(_entries(infos["final_info"]))
            told = {name: _where(ended, last.get(name, now), now) for name, now in told.items()}
            seen = _where(ended, np.asarray(infos["final_obs"]), seen)
        return _Result(observations, seen, np.asarray(rewards), terminated, truncated, infos, told)

    def written(self, actions: Any) -> Array:
        return np.asarray(actions)


class _Parallel:
    """A PettingZoo ``ParallelEnv``, whose agents all stay until the end; they are the second axis."""

    def __init__(self, env: Any) -> None:
        self.env = env

    def reset(self, seeds: tuple[int, ...], options: Mapping[str, Any] | None) -> _Result:
        observations, infos = self.env.reset(seed=seeds[0], options=_own(options))
        nobody = dict.fromkeys(observations, False)
        return self._result(observations, dict.fromkeys(observations, 0.0), nobody, nobody, infos)

    def step(self, actions: Any) -> _Result:
        return self._result(*self.env.step(actions))

    def written(self, actions: Any) -> Array:
        return np.stack([np.asarray(actions[agent]) for agent in self.env.possible_agents])[np.newaxis]

    def _result(
        self, observations: Any, rewards: Any, terminated: Any, truncated: Any, infos: Any
    ) -> _Result:
        agents = self.env.possible_agents
        entries = [dict(_entries(infos[agent])) for agent in agents]
        told = {name: np.stack([one[name] for one in entries])[np.newaxis] for name in entries[0]}
        return _Result(
            observations, np.stack([observations[agent] for agent in agents])[np.newaxis],
            np.array([[float(rewards[agent]) for agent in agents]]),
            np.array([any(terminated.values())]), np.array([any(truncated.values())]), infos, told,
        )  # fmt: skip


def _form_of(env: Any) -> _Form:
    if isinstance(env, VectorEnv):
        return _Vector(env)
    return _Single(env) if isinstance(env, gym.Env) else _Parallel(env)


def _own(options: Mapping[str, Any] | None) -> dict[str, Any] | None:
    return None if options is None else dict(options)


def _entries(info: Mapping[str, Any]) -> Iterator[tuple[str, Array]]:
    """The numbers of an info by path, without masks and endings."""
    for name, value in flattened(dict(info)).items():
        parts = name.split("/")
        if any(part.startswith("_") for part in parts) or parts[0] in _NOT_RECORDED:
            continue
        array = np.asarray(value)
        if array.dtype.kind in "biuf":
            yield name, array


#: What Gymnasium and wrappers put into infos at the end of an episode, and what is recorded by another name.
_NOT_RECORDED = ("final_info", "final_obs", "episode", "is_success", "state")


def _where(mask: NDArray[np.bool_], first: Array, second: Array) -> Array:
    return np.where(mask.reshape(-1, *[1] * (second.ndim - 1)), first, second)


# Who acts --------------------------------------------------------------------------------------------------


def _several(policy: Any) -> bool:
    return isinstance(policy, Sequence) and not isinstance(policy, str)


class _Pilot:
    """A policy of any form, for the episodes of a round.

    Args:
        policy: As :func:`fly` has it.
        form: What it flies.
        seeds: Of the episodes.
        first: Number of the first of them among all.
        deterministic: For ``predict``.

    Raises:
        ValueError: No policy.
    """

    def __init__(
        self, policy: Any, form: _Form, seeds: tuple[int, ...], first: int, deterministic: bool
    ) -> None:
        self.form, self.worlds = form, len(seeds)
        self.alone = _several(policy) and isinstance(form, _Vector)
        if policy is None or (isinstance(policy, str) and policy in ("random", "idle")):
            self.policies: list[Any] = [_Drawn(form, seeds) if policy != "idle" else _Idle(form)]
        elif _several(policy):
            self.policies = list(policy[first : first + self.worlds])
        elif isinstance(policy, Mapping):
            self.policies = [_ByAgent(policy, form)]
        else:
            self.policies = [policy]
        for one in self.policies:
            if not callable(one) and not hasattr(one, "predict"):
                raise ValueError(
                    "policy must be None, 'random', 'idle', a callable or an object with predict, "
                    f"got {shown(one)}"
                )
        self.acts = [_acting(one, deterministic) for one in self.policies]
        for one in self.policies:
            reset = getattr(one, "reset", None)
            if callable(reset):
                reset()

    def __call__(self, observations: Any, running: NDArray[np.bool_]) -> Any:
        if not self.alone:
            return self.acts[0](observations)
        space = self.form.env.single_action_space
        actions = np.zeros((self.worlds, *space.shape), space.dtype)
        for world in np.flatnonzero(running):
            actions[world] = self.acts[world](observations[world])
        return actions

    def beliefs(self) -> dict[str, Array]:
        """What it believes, by channel, (worlds, ...)."""
        if not self.alone:
            return {name: self._rows(name, array) for name, array in _belief_of(self.policies[0])}
        each = [dict(_belief_of(one)) for one in self.policies]
        return {name: np.stack([one[name] for one in each]) for name in each[0]}

    def _rows(self, name: str, array: Array) -> Array:
        if not isinstance(self.form, _Vector):
            return array[np.newaxis].copy()
        if array.shape[:1] != (self.worlds,):
            raise ValueError(f"{name} must have a row for each of {self.worlds} worlds, got {array.shape}")
        return array.copy()


def _acting(policy: Any, deterministic: bool) -> Callable[[Any], Any]:
    """Actions from observations, by ``predict`` with its memory or by a call."""
    if not hasattr(policy, "predict"):
        act: Callable[[Any], Any] = policy
        return act
    memory: dict[str, Any] = {"state": None, "episode_start": None}

    def predicted(observations: Any) -> Any:
        if memory["state"] is None:
            actions, memory["state"] = policy.predict(observations, deterministic=deterministic)
        else:
            actions, memory["state"] = policy.predict(
                observations, state=memory["state"], episode_start=None, deterministic=deterministic
            )
        return actions

    return predicted


def _belief_of(policy: Any) -> Iterator[tuple[str, Array]]:
    belief = getattr(policy, "belief", None)
    if belief is None or callable(belief):
        return
    if isinstance(belief, Mapping):
        named: Mapping[str, Any] = belief
    elif hasattr(belief, "_asdict"):
        named = belief._asdict()
    elif is_dataclass(belief):
        named = {one.name: getattr(belief, one.name) for one in fields(belief)}
    else:
        named = {"": belief}
    for name, value in named.items():
        array = np.asarray(value)
        if array.dtype.kind in "biuf":
            yield f"belief/{name}" if name else "belief", array


class _Drawn:
    """Actions drawn from the space, in each world by its own seed: the same alone and in a batch."""

    def __init__(self, form: _Form, seeds: tuple[int, ...]) -> None:
        env, self.form = form.env, form
        if isinstance(form, _Parallel):
            self.spaces = {agent: deepcopy(env.action_space(agent)) for agent in env.possible_agents}
            for k, space in enumerate(self.spaces.values()):
                space.seed(seeds[0] + k)
        else:
            one = env.single_action_space if isinstance(form, _Vector) else env.action_space
            self.drawn = [deepcopy(one) for _ in seeds]
            for space, seed in zip(self.drawn, seeds, strict=True):
                space.seed(seed)

    def __call__(self, observations: Any) -> Any:  # noqa: ARG002  # a policy's form
        if isinstance(self.form, _Parallel):
            return {agent: space.sample() for agent, space in self.spaces.items()}
        drawn = [space.sample() for space in self.drawn]
        return np.stack(drawn) if isinstance(self.form, _Vector) else drawn[0]


class _Idle:
    """Valves shut, no pulses, nothing declared.

    Raises:
        ValueError: Actions that are neither duties nor options.
    """

    def __init__(self, form: _Form) -> None:
        env = form.env
        own, beneath = _spaces(env), _spaces(env.unwrapped)
        if own != beneath:
            raise ValueError(
                "policy 'idle' does not know what nothing means to the wrappers of env; give one"
            )
        task = env.unwrapped.task
        nothing = -1.0 if task.choices is None else 0
        self.actions: Any = {
            agent: np.full(space.shape or (), nothing, space.dtype) for agent, space in own.items()
        }
        for action in self.actions.values() if task.storage_size else ():
            action[..., -task.storage_size :] = 0.0  # of wheels and gimbals
        if not isinstance(form, _Parallel):
            self.actions = self.actions[""]

    def __call__(self, observations: Any) -> Any:  # noqa: ARG002  # a policy's form
        return deepcopy(self.actions)


def _spaces(env: Any) -> dict[str, Any]:
    if hasattr(env, "possible_agents"):
        return {agent: env.action_space(agent) for agent in env.possible_agents}
    return {"": env.action_space}


class _ByAgent:
    """A policy for each agent."""

    def __init__(self, policies: Mapping[str, Any], form: _Form) -> None:
        agents = form.env.possible_agents if isinstance(form, _Parallel) else []
        if set(agents) != set(policies):
            raise ValueError(
                f"policy by agent must have one for each of {', '.join(agents) or 'no agents'}, "
                f"got {', '.join(map(str, policies))}"
            )
        self.policies = dict(policies)
        self._acts = {agent: _acting(one, True) for agent, one in policies.items()}

    def __call__(self, observations: Mapping[str, Any]) -> dict[str, Any]:
        return {agent: self._acts[agent](seen) for agent, seen in observations.items()}

    def reset(self) -> None:
        for one in self.policies.values():
            if callable(getattr(one, "reset", None)):
                one.reset()


# The loop --------------------------------------------------------------------------------------------------


def _fly_round(one: _Round, settings: _Settings, first: int, tell: Callable[[int], None]) -> Recording:
    env = one.make()
    try:
        if not isinstance(env.unwrapped, MidEpisode):
            raise ValueError(f"env must be an environment of thruster_envs, got {shown(env)}")
        return _fly(env, one.seeds, settings, first, tell)
    finally:
        if one.closes:
            env.close()


def _fly(
    env: Any, seeds: tuple[int, ...], settings: _Settings, first: int, tell: Callable[[int], None]
) -> Recording:
    form, past_end = _form_of(env), settings.past_end
    if past_end and getattr(env.unwrapped, "autoreset_mode", None) != AutoresetMode.DISABLED:
        raise ValueError(f"past_end needs a vector environment in the mode DISABLED, got {shown(env)}")
    pilot = _Pilot(settings.policy, form, seeds, first, settings.deterministic)
    book = _Book(form, seeds, settings)
    result = form.reset(seeds, settings.options)
    running = np.ones(len(seeds), np.bool_)
    book.begin(result)
    step = 0
    try:
        while True:
            moment = Moment(step, result.observations, result.infos, running.copy(), env)
            goes_on = settings.callback is None or settings.callback(moment) is not False
            if not (goes_on and running.any() and (settings.steps is None or step < settings.steps)):
                break
            actions = pilot(result.observations, running)
            with _watched(book.worlds, book.truth) as watch:
                result = form.step(actions)
            step += 1
            book.add(actions, pilot.beliefs(), result, watch.seen, running)
            ended = running & (result.terminated | result.truncated) & (not past_end)
            tell(int(ended.sum()))
            running = running & ~ended
    except KeyboardInterrupt:
        raise Interrupted(book.recording(interrupted=True)) from None
    return book.recording()


class _Watch:
    """Reads the truth at the end of each period, before an episode that ended there gives way to the next.

    Where several periods make one step, a world whose episode ends on the way is left as it was then.
    """

    def __init__(self, worlds: Worlds, read: Callable[[], dict[str, Array]]) -> None:
        self._read, self.seen = read, dict[str, Array]()
        self._over = np.zeros(worlds.number, np.bool_)

    def __call__(self, done: NDArray[np.bool_]) -> None:
        now = self._read()
        if self._over.any():
            now = {name: _where(self._over, self.seen[name], array) for name, array in now.items()}
        self.seen = now
        self._over = self._over | done


@contextmanager
def _watched(worlds: Worlds, read: Callable[[], dict[str, Array]]) -> Iterator[_Watch]:
    watch = _Watch(worlds, read)
    worlds.watcher = watch
    try:
        yield watch
    finally:
        worlds.watcher = None


class _Book:
    """What is written down of a round, instant by instant."""

    def __init__(self, form: _Form, seeds: tuple[int, ...], settings: _Settings) -> None:
        self.form, self.seeds, self.settings = form, seeds, settings
        base = form.env.unwrapped
        self.worlds: Worlds = base.worlds
        self.entries: dict[str, list[Array]] = {}
        self.seen: dict[str, None] = {}
        self.per: dict[str, str] = {}
        self.lengths = np.zeros(len(seeds), np.int64)
        kept = settings.record
        self._keeps_truth = kept is None or not {"time", *_TRUE}.isdisjoint(kept)

    def truth(self) -> dict[str, Array]:
        """What is true now, if any of it is to be kept."""
        return _truth(self.worlds) if self._keeps_truth else {}

    def begin(self, result: _Result) -> None:
        for name, array in self.truth().items():
            if name not in _OF_STEPS:
                self._put("instant", name, array)
        self._put("instant", "observation", result.seen)
        for name, array in result.told.items():
            group = name.partition("/")[0]
            if group == "fault" and name != "fault/active":
                self._put("episode", name, array)
            elif group not in ("reward_terms", "cost"):
                self._put("instant", name, array)

    def add(
        self, actions: Any, beliefs: dict[str, Array], result: _Result, truth: dict[str, Array],
        running: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        for name, array in truth.items():
            self._put("step" if name in _OF_STEPS else "instant", name, array)
        self._put("instant", "observation", result.seen)
        self._put("step", "action", self.form.written(actions))
        for name, array in beliefs.items():
            self._put("step", name, array)
        self._put("step", "reward", result.rewards)
        self._put("step", "terminated", result.terminated)
        self._put("step", "truncated", result.truncated)
        for name, array in result.told.items():
            if self.per.get(name) != "episode" and not (name.startswith("fault/") and name != "fault/active"):
                of_steps = name.partition("/")[0] in ("reward_terms", "cost")
                self._put("step" if of_steps else "instant", name, array)
        if not self.lengths.any():
            self._check_record()
        self.lengths += running

    def _put(self, per: str, name: str, array: Array) -> None:
        self.seen[name] = None
        if self.settings.record is not None and not any(
            name == kept or name.startswith(f"{kept}/") for kept in self.settings.record
        ):
            return
        self.entries.setdefault(name, []).append(np.array(array))
        self.per.setdefault(name, per)

    def recording(self, *, interrupted: bool = False) -> Recording:
        """What was written down so far."""
        steps = int(self.lengths.max(initial=0))
        channels, arrays = {}, {}
        for name, entries in self.entries.items():
            per = self.per[name]
            right = {"episode": 1, "instant": steps + 1, "step": steps}[per]
            if len(entries) < right:
                raise ValueError(f"{name!r} must be there after every step, and was {len(entries)} times")
            stacked = np.stack(entries[:right], axis=1)
            entries_of_each = self.lengths + 1 if per == "instant" else self.lengths
            kept = np.arange(right) < entries_of_each[:, np.newaxis]
            arrays[name] = stacked[:, 0] if per == "episode" else stacked[kept]
            channels[name] = self._channel(name, per, arrays[name].shape[1:])
        made = self._made() | ({"interrupted": True} if interrupted else {})
        return Recording(channels, arrays, self.lengths, self.seeds, [made])

    def _check_record(self) -> None:
        known = [*self.seen, *dict.fromkeys(name.partition("/")[0] for name in self.seen)]
        for kept in self.settings.record or ():
            if kept not in known:
                near = nearest(kept, known)
                hint = "" if near is None else f"; did you mean {near!r}?"
                raise ValueError(f"record has {kept!r}, which is not recorded here{hint}")

    def _channel(self, name: str, per: Any, shape: tuple[int, ...]) -> Channel:
        unit, labels = _KNOWN.get(name, ("1", None))
        axes: list[tuple[str, ...]] = []
        rest = shape
        task = self.worlds.task
        if name in _TRUE and self.worlds.fleet.craft > 1:
            axes.append(tuple(str(k + 1) for k in range(self.worlds.fleet.craft)))
            rest = rest[1:]
        elif isinstance(self.form, _Parallel) and not (name in _ONCE or name.startswith("belief")):
            axes.append(tuple(task.agents))
            rest = rest[1:]
        if labels is not None:
            axes.append(labels)
        else:
            start = 0 if name in ("observation", "action") else 1
            axes += [tuple(str(start + k) for k in range(size)) for size in rest]
        return Channel(per, unit, tuple(axes))

    def _made(self) -> dict[str, Any]:
        base, env = self.form.env.unwrapped, self.form.env
        spec = getattr(env, "spec", None) or getattr(base, "spec", None)
        task = self.worlds.task
        return {
            "environment": spec.id if spec is not None else env.metadata.get("name", type(base).__name__),
            "spec": None if spec is None else _json_of(spec),
            "configuration": configuration_of(base),
            "faults": _plain(task.fault_source()),
            "options": _plain(self.settings.options),
            "policy": _name_of(self.settings.policy),
            "agents": list(task.agents),
            "period": task.vehicle.control_period,
            "fault_kinds": list(KINDS),
            "sensors": list(SENSORS),
            "sensor_kinds": list(SENSOR_KINDS),
            "versions": {
                "thruster_envs": thruster_envs.__version__,
                "gymnasium": gym.__version__,
                "numpy": np.__version__,
                "python": platform.python_version(),
            },
        }


#: What the agents of a world share.
_ONCE = ("time", "terminated", "truncated")
#: Of the truth, what belongs to a step: what was commanded for its period, and what came of it.
_OF_STEPS = (
    "duty", "delivered", "impulse", "measured_change", "expected_change", "wheel_torque", "gimbal_rate",
)  # fmt: skip
_TRUE = (
    "position", "velocity", "attitude", "rate", "mass", "measured_position", "measured_velocity",
    "measured_attitude", "measured_rate", "wheel_speed", "gimbal_angle", *_OF_STEPS,
)  # fmt: skip
#: Units, and labels of the last axis where they are not numbers.
_KNOWN: dict[str, tuple[str, tuple[str, ...] | None]] = {
    "time": ("s", None),
    "position": ("m", _XYZ),
    "velocity": ("m/s", _XYZ),
    "attitude": ("1", _WXYZ),
    "rate": ("rad/s", _XYZ),
    "mass": ("kg", None),
    "measured_position": ("m", _XYZ),
    "measured_velocity": ("m/s", _XYZ),
    "measured_attitude": ("1", _WXYZ),
    "measured_rate": ("rad/s", _XYZ),
    "measured_change": ("m/s, rad/s", _AXES),
    "expected_change": ("m/s, rad/s", _AXES),
    "impulse": ("N s, N m s", _AXES),
    "wheel_speed": ("rad/s", None),
    "gimbal_angle": ("rad", None),
    "storage/wheel_speed": ("rad/s", None),
    "storage/gimbal_angle": ("rad", None),
    "delivered": ("s", None),
    "fuel": ("s", None),
    "fault/onset": ("s", None),
    "approach/delay": ("s", None),
    "attitude/error": ("rad", None),
    "attitude/settling_time": ("s", None),
    "diagnosis/delay": ("s", None),
    "orbit/true_anomaly": ("rad", None),
    "remainder": ("m/s, rad/s", None),
}


def _truth(worlds: Worlds) -> dict[str, Array]:
    """What is true of every world now, and what was flown in the last period; (worlds, craft, ...).

    Without the axis of the craft where a world has only one; with no motion where nothing flies.
    """
    fleet, task = worlds.fleet, worlds.task
    rows = fleet.read(0, at.DUTIES)
    n = task.vehicle.number_of_thrusters
    found = {"time": worlds.steps * task.vehicle.control_period}
    its: dict[str, Array] = {}
    if task.flies:
        m = at.MEASURED
        its |= {
            "position": rows[..., 0:3], "velocity": rows[..., 3:6], "attitude": rows[..., 6:10],
            "rate": rows[..., 10:13],
            "measured_position": rows[..., m : m + 3], "measured_velocity": rows[..., m + 3 : m + 6],
            "measured_attitude": rows[..., m + 6 : m + 10], "measured_rate": rows[..., m + 10 : m + 13],
        }  # fmt: skip
    if task.flies or task.choices is None:
        changes = at.MEASURED_CHANGE, at.EXPECTED_CHANGE, at.IMPULSE
        measured, expected, impulse = (rows[..., k : k + 6] for k in changes)
        its |= {
            "mass": rows[..., at.MASS], "duty": fleet.read(fleet.rows.duties, n),
            "delivered": fleet.read(fleet.rows.delivered, n),
            "measured_change": measured, "expected_change": expected, "impulse": impulse,
        }  # fmt: skip
        for name, row, count in (
            ("wheel_torque", fleet.rows.wheel_torques, fleet.rows.number_of_wheels),
            ("wheel_speed", fleet.rows.wheel_speeds, fleet.rows.number_of_wheels),
            ("gimbal_rate", fleet.rows.gimbal_rates, fleet.rows.number_of_gyros),
            ("gimbal_angle", fleet.rows.gimbal_angles, fleet.rows.number_of_gyros),
        ):
            its |= {name: fleet.read(row, count)} if count else {}
    return found | {name: array if fleet.craft > 1 else array[:, 0] for name, array in its.items()}


# Metadata and progress -------------------------------------------------------------------------------------


def _plain(value: Any) -> Any:
    try:
        return as_plain(value)
    except TypeError:
        return shown(value)


def _json_of(spec: Any) -> str | None:
    try:
        text: str = spec.to_json()
        json.loads(text)
    except (TypeError, ValueError):  # wrappers or arguments that have no form in JSON
        return None
    return text


def _name_of(policy: Any) -> str:
    """Of a policy, for people."""
    if policy is None or isinstance(policy, str):
        return policy or "random"
    if isinstance(policy, Mapping):
        return ", ".join(f"{agent}: {_name_of(one)}" for agent, one in policy.items())
    if _several(policy):
        return ", ".join(dict.fromkeys(map(_name_of, policy)))
    thing = policy if hasattr(policy, "__qualname__") else type(policy)
    return f"{thing.__module__}:{thing.__qualname__}"


@contextmanager
def _bar(shows: bool, total: int) -> Iterator[Callable[[int], None]]:
    if not shows:
        yield lambda _: None
        return
    with extra("agents", "a bar of progress"):
        from tqdm import tqdm
    with tqdm(total=total, unit="episode") as bar:
        yield lambda ended: bar.update(ended) and None
