"""The state of an environment in mid-episode: taken, set, and forked.

A state is a dictionary of plain arrays, which ``np.savez`` and ``np.load`` keep without pickle. An
environment of the same configuration that is set to it goes on, bit for bit, as the one it was taken from:
faults, noise, time limits, pending resets and later episodes included. ``env.unwrapped`` has the three as
methods (:class:`MidEpisode`); the functions here also take what wrappers remember.

>>> import gymnasium as gym
>>> import thruster_envs
>>> env = gym.make("thruster_envs/OrionRendezvous-v1")
>>> _ = env.reset(seed=0)
>>> state = get_state(env)
>>> first = env.step(env.action_space.sample() * 0.0)[0]
>>> set_state(env, state)
>>> again = env.step(env.action_space.sample() * 0.0)[0]
>>> bool((first == again).all())
True

Left out of a state: what a policy, a user's pilot or a detector outside of the environment remembers; the
generators of the spaces; pictures so far; the queues of past episodes of ``RecordEpisodeStatistics``. A fork
is a deep copy and has them all.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, ClassVar, Protocol, TypeAlias, TypeVar, runtime_checkable

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import vector as vector_wrappers
from numpy.typing import NDArray

from thruster_envs.configuration import as_plain, nearest, shown
from thruster_envs.construction import Unrecorded
from thruster_envs.tasks import Task
from thruster_envs.views.worlds import Worlds

State: TypeAlias = dict[str, NDArray[Any]]
_Environment = TypeVar("_Environment")

_MADE, _GENERATOR = "environment", "generator"
_GENERATORS = ("PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64")

#: Wrappers of Gymnasium that remember nothing which a later step depends on.
_FORGETFUL = tuple(
    getattr(module, name)
    for module in (gym.wrappers, vector_wrappers)
    for name in (
        "ClipAction", "ClipReward", "DtypeObservation", "FilterObservation", "FlattenObservation",
        "HumanRendering", "PassiveEnvChecker", "RecordVideo", "RescaleAction",
        "RescaleObservation", "ReshapeObservation", "TransformAction", "TransformObservation",
        "TransformReward",
    )
    if hasattr(module, name)
)  # fmt: skip

#: Wrappers of Gymnasium with numbers that later steps depend on, and the names of these.
_COUNTING: dict[type[Any], tuple[str, ...]] = {
    gym.wrappers.OrderEnforcing: ("_has_reset",),
    gym.wrappers.TimeLimit: ("_elapsed_steps",),
    gym.wrappers.RecordEpisodeStatistics: ("episode_count", "episode_returns", "episode_lengths"),
    vector_wrappers.RecordEpisodeStatistics: (
        "episode_count", "episode_returns", "episode_lengths", "prev_dones",
    ),
}  # fmt: skip


@runtime_checkable
class Remembering(Protocol):
    """A wrapper that remembers something and can say what. Users' own wrappers may have this form."""

    def own_state(self) -> State:
        """What the wrapper itself remembers, as copies by names that begin with one of its own and a /."""
        ...

    def set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`own_state` gave."""
        ...


class MidEpisode:
    """What every view has: its state can be taken and set between two calls, and it can be forked."""

    task: Task
    worlds: Worlds

    #: Attributes of a view, beside its worlds, that say how it was made.
    made_with: ClassVar[tuple[str, ...]] = ()

    def get_state(self) -> State:
        """Everything that later steps and resets depend on, as copies by name; no wrapper's memory.

        Before the first reset too: what is set to it then waits for its first reset as well.
        """
        return self.save_state() | {_MADE: _as_bytes(configuration_of(self))} | _generator(self)

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what :meth:`get_state` gave, here or in another environment made like this one.

        Raises:
            ValueError: The state of an environment that was made otherwise (another id, spacecraft, number
                of worlds or setting; other faults are taken), or a damaged one. Nothing has changed then.
        """
        self.check_state(state)
        self.restore_state(state)
        _restore_generator(self, state)

    def fork(self: _Environment) -> _Environment:
        """An independent environment in the same state, without the wrappers around this one."""
        return copy.deepcopy(self)

    def check_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Raise the ValueError that :meth:`set_state` would raise."""
        _check_form(state)
        difference = _difference(_from_bytes(state[_MADE]), configuration_of(self))
        if difference is not None:
            name, then, now = difference
            raise ValueError(
                f"state must be of an environment made like this one, with {name} = {shown(now)}, "
                f"got {name} = {shown(then)}"
            )
        _check_entries(state, self.save_state())
        _generator_of(state)

    def save_state(self) -> State:
        """The numbers of :meth:`get_state` alone, in arrays of fixed shapes: for checkpoints."""
        return self.worlds.save() | self._own_state()

    def restore_state(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go back to what :meth:`save_state` gave, in an environment of the same configuration."""
        self.worlds.restore(saved)
        self._set_own_state(saved)

    def _own_state(self) -> State:
        """What the view remembers beside its worlds and its generator."""
        return {}

    def _set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to that."""


def get_state(env: Any) -> State:
    """The state of an environment and of the wrappers around it, as copies by name.

    Args:
        env: Of this suite, in any view, wrapped or not.

    Raises:
        TypeError: Another environment, or a wrapper of which nobody knows what it remembers.
    """
    layers, base = _layers(env)
    state = base.get_state()
    for layer in layers:
        state |= _memory(layer)
    return state


def set_state(env: Any, state: Mapping[str, NDArray[Any]]) -> None:
    """Let an environment and the wrappers around it go on from what :func:`get_state` gave.

    Args:
        env: Made and wrapped like the one that the state was taken from.
        state: Taken there.

    Raises:
        TypeError: As of :func:`get_state`.
        ValueError: A state of another environment, or of other wrappers; one line says which.
    """
    layers, base = _layers(env)
    _check_form(state)
    names = {layer: [name for name in state if name.startswith(_prefix(layer))] for layer in layers}
    theirs = {name for its in names.values() for name in its}
    base.check_state({name: array for name, array in state.items() if name not in theirs})
    for layer, its in names.items():
        _remember(layer, {name: state[name] for name in its})
    for layer in _stack(env):
        if isinstance(layer, gym.wrappers.PassiveEnvChecker) and vars(layer).get("_previous_data", 0) is None:
            layer._previous_data = (np.zeros(0), {})  # it compares a step with what came before, here nothing
    base.set_state({name: array for name, array in state.items() if name not in theirs})


def fork(env: _Environment) -> _Environment:
    """An independent environment in the same state, wrappers and all: a deep copy.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/ThrusterMapping-v0")
    >>> _ = env.reset(seed=0)
    >>> other = fork(env)
    >>> _ = other.step(other.action_space.sample())
    >>> int(env.unwrapped.worlds.steps[0]), int(other.unwrapped.worlds.steps[0])
    (0, 1)
    """
    return copy.deepcopy(env)


# Layers of wrappers --------------------------------------------------------------------------------------


def _layers(env: Any) -> tuple[list[Any], MidEpisode]:
    """The wrappers that remember something, the outermost first, and what is beneath them."""
    layers = []
    *wrappers, base = _stack(env)
    if not isinstance(base, MidEpisode):
        raise TypeError(f"env must be an environment of thruster_envs, got {shown(base)}")
    for layer in wrappers:
        if issubclass(type(layer), Remembering) or type(layer) in _COUNTING:
            layers.append(layer)
        elif type(layer) not in _FORGETFUL and not getattr(type(layer), "remembers_nothing", False):
            raise TypeError(
                f"what {type(layer).__name__} remembers is not known here; take the state of env.unwrapped, "
                "or give the wrapper own_state and set_own_state"
            )
    return layers, base


def _stack(env: Any) -> Iterator[Any]:
    """The wrappers, the outermost first, and the environment beneath."""
    yield env
    while not isinstance(env, MidEpisode) and "env" in vars(env):
        env = env.env
        yield env


def _prefix(layer: Any) -> str:
    return f"{type(layer).__name__}/"


def _memory(layer: Any) -> State:
    if issubclass(type(layer), Remembering):
        return {f"{_prefix(layer)}{name}": array for name, array in layer.own_state().items()}
    return {
        f"{_prefix(layer)}{name}": np.array(-1 if getattr(layer, name) is None else getattr(layer, name))
        for name in _COUNTING[type(layer)]
    }


def _remember(layer: Any, given: State) -> None:
    state = {name.removeprefix(_prefix(layer)): array for name, array in given.items()}
    if issubclass(type(layer), Remembering):
        layer.set_own_state(state)
        return
    _check_entries(given, _memory(layer), exactly=False)
    for name, array in state.items():
        value = array.copy() if np.ndim(array) else array.item()
        setattr(layer, name, None if name == "_elapsed_steps" and value < 0 else value)


# How an environment was made -----------------------------------------------------------------------------


def configuration_of(view: MidEpisode) -> dict[str, Any]:
    """How an environment was made, as plain data: what a state has to agree with. Faults may differ."""
    task = view.task
    settings = {
        one.name: _plain(getattr(task, one.name))
        for one in fields(task)
        if one.init and one.name not in ("spacecraft", "faults")
    }
    return {
        "environment": type(view).__name__,
        "worlds": view.worlds.number,
        "max_episode_steps": view.worlds.max_episode_steps,
        **{name: _plain(getattr(view, name)) for name in view.made_with},
        **settings,
        "spacecraft": _plain(task.vehicle.to_dict()),
    }


def _plain(value: Any) -> Any:
    try:
        return as_plain(value)
    except TypeError:  # a user's pilot, say
        return str(Unrecorded.of(value))


def _difference(then: Any, now: Any, where: str = "") -> tuple[str, Any, Any] | None:
    """Where two plain values differ first: the name, and the value in either; None for nowhere."""
    if not (isinstance(then, Mapping) and isinstance(now, Mapping)):
        return None if then == now else (where, then, now)
    for name in [*now, *(name for name in then if name not in now)]:
        found = _difference(then.get(name), now.get(name), f"{where}.{name}" if where else name)
        if found is not None:
            return found
    return None


def _check_form(state: Any) -> None:
    if not isinstance(state, Mapping) or _MADE not in state:
        raise ValueError(f"state must be what get_state() gave, got {shown(state)}")


def _check_entries(state: Mapping[str, Any], like: State, *, exactly: bool = True) -> None:
    """Refuse a state whose entries are not like these in name, shape and type."""
    for name, own in like.items():
        if name not in state:
            raise ValueError(f"state must have the entry {name!r}, got none")
        array = np.asarray(state[name])
        if array.shape != own.shape or array.dtype.kind != own.dtype.kind:
            raise ValueError(
                f"state[{name!r}] must have the shape {own.shape} and the type {own.dtype}, "
                f"got {array.shape} and {array.dtype}"
            )
    if exactly:
        for name in state:
            if name not in like and name not in (_MADE, _GENERATOR):
                near = nearest(name, like)
                raise ValueError(
                    f"state has the entry {name!r}, which nothing here remembers"
                    + ("" if near is None else f"; did you mean {near!r}?")
                )


# The generator of a view ---------------------------------------------------------------------------------


def _generator(view: Any) -> State:
    """The generator of a Gymnasium view, from which unseeded resets draw; the others have none."""
    if not hasattr(view, "np_random"):
        return {}
    generator, seed = view.np_random, view._np_random_seed
    known = {"state": generator.bit_generator.state, "seed": seed}
    return {_GENERATOR: _as_bytes(known)}


def _generator_of(state: Mapping[str, NDArray[Any]]) -> tuple[np.random.Generator, int | None] | None:
    if _GENERATOR not in state:
        return None
    try:
        known = _from_bytes(state[_GENERATOR])
        name = known["state"]["bit_generator"]
        if name not in _GENERATORS:
            raise ValueError(name)
        bits = getattr(np.random, name)()
        bits.state = known["state"]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"state[{_GENERATOR!r}] is not that of a generator of NumPy ({error})") from None
    return np.random.Generator(bits), known["seed"]


def _restore_generator(view: Any, state: Mapping[str, NDArray[Any]]) -> None:
    found = _generator_of(state)
    if found is not None:
        view._np_random, view._np_random_seed = found


def _as_bytes(plain: Any) -> NDArray[np.uint8]:
    text = json.dumps(plain, default=lambda array: array.tolist())
    return np.frombuffer(text.encode(), np.uint8).copy()


def _from_bytes(array: Any) -> dict[str, Any]:
    try:
        found = json.loads(np.asarray(array, np.uint8).tobytes())
    except ValueError as error:
        raise ValueError(f"state must be what get_state() gave, got a damaged one ({error})") from None
    if not isinstance(found, dict):
        raise ValueError(f"state must be what get_state() gave, got {shown(found)} in it")
    return found
