"""How a vector environment and its single twin are made: from an id, a class or a function.

A maker is given `num_envs` and `autoreset_mode` if it takes them; whether it does is read from its signature,
or tried out where the signature takes anything.
"""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec, load_env_creator
from gymnasium.vector import AutoresetMode

AnyVectorEnv = gym.vector.VectorEnv[Any, Any, Any]
AnyEnv = gym.Env[Any, Any]


@dataclass(frozen=True, kw_only=True)
class VectorFactory:
    """How to make the vector environment, and which of `num_envs` and `autoreset_mode` its maker takes."""

    name: str
    function: Callable[..., AnyVectorEnv]
    takes_num_envs: bool
    takes_autoreset_mode: bool

    def __call__(self, num_envs: int, autoreset_mode: AutoresetMode) -> AnyVectorEnv:
        """Make one, telling the maker as much as it takes."""
        arguments: dict[str, Any] = {}
        if self.takes_num_envs:
            arguments["num_envs"] = num_envs
        if self.takes_autoreset_mode:
            arguments["autoreset_mode"] = autoreset_mode
        return self.function(**arguments)


def vector_factory(
    make_vector: str | Callable[..., AnyVectorEnv], kwargs: Mapping[str, Any]
) -> VectorFactory:
    """Find out how a vector environment is made, from an id or from a class or function that returns one."""
    if isinstance(make_vector, str):
        return _factory_from_id(make_vector, kwargs)
    if not callable(make_vector):
        raise TypeError(
            f"make_vector is {make_vector!r}; pass an id, a class or a function that makes a fresh vector "
            "environment, not an environment that was already made"
        )
    function = partial(make_vector, **kwargs)
    name = getattr(make_vector, "__name__", type(make_vector).__name__)
    fixed = set(kwargs) | set(getattr(make_vector, "keywords", ()))
    taken = _arguments_taken(make_vector, function, fixed)
    return VectorFactory(name=name, function=function, **taken)


def single_factory(
    make_single: str | Callable[[], AnyEnv] | None,
    make_vector: str | Callable[..., AnyVectorEnv],
    kwargs: Mapping[str, Any],
) -> Callable[[], AnyEnv] | None:
    """Find out how the single environment is made; an id names the vector and the single one."""
    if make_single is None and isinstance(make_vector, str) and _spec(make_vector).entry_point is not None:
        make_single = make_vector
    if make_single is None:
        return None
    if isinstance(make_single, str):
        own = {key: value for key, value in kwargs.items() if key not in _VECTOR_ONLY}
        wrappers = kwargs.get("wrappers") or ()
        return partial(_make_single, make_single, wrappers, own)
    if not callable(make_single):
        raise TypeError(
            f"make_single is {make_single!r}; pass an id or a class or function that makes the environment"
        )
    return partial(make_single, **{key: value for key, value in kwargs.items() if key not in _VECTOR_ONLY})


_VECTOR_ONLY = frozenset({"vectorization_mode", "vector_kwargs", "wrappers", "autoreset_mode", "num_envs"})


def _spec(env_id: str) -> EnvSpec:
    """Look an id up as `gymnasium.make` does: `module:id` imports the module first."""
    module, _, name = env_id.rpartition(":")
    if module:
        importlib.import_module(module)
    return gym.spec(name)


def _make_single(env_id: str, wrappers: Sequence[Any], kwargs: Mapping[str, Any]) -> AnyEnv:
    env: AnyEnv = gym.make(env_id, **{"disable_env_checker": True, **kwargs})
    for wrapper in wrappers:
        env = wrapper(env)
    return env


def _factory_from_id(env_id: str, kwargs: Mapping[str, Any]) -> VectorFactory:
    spec = _spec(env_id)
    mode = kwargs.get("vectorization_mode")
    entry_point = spec.vector_entry_point
    if entry_point is not None and mode in (None, "vector_entry_point"):
        creator = load_env_creator(entry_point) if isinstance(entry_point, str) else entry_point
        function: Callable[..., AnyVectorEnv] = partial(_make_native, env_id, dict(kwargs))
        taken = _arguments_taken(creator, function, set(kwargs) | set(spec.kwargs))
        return VectorFactory(
            name=env_id,
            function=function,
            takes_num_envs=True,
            takes_autoreset_mode=taken["takes_autoreset_mode"],
        )
    fixed = "autoreset_mode" in (kwargs.get("vector_kwargs") or {})
    function = partial(_make_vectorized, env_id, dict(kwargs))
    return VectorFactory(name=env_id, function=function, takes_num_envs=True, takes_autoreset_mode=not fixed)


def _make_native(env_id: str, kwargs: Mapping[str, Any], **arguments: Any) -> AnyVectorEnv:
    with warnings.catch_warnings():  # Gymnasium only warns of the modes that a check reports as a failure
        warnings.filterwarnings("ignore", message=".*(autoreset_mode|AutoresetMode).*")
        env: AnyVectorEnv = gym.make_vec(env_id, **{**kwargs, **arguments})
    return env


def _make_vectorized(
    env_id: str,
    kwargs: Mapping[str, Any],
    num_envs: int,
    autoreset_mode: AutoresetMode | None = None,
) -> AnyVectorEnv:
    arguments = {"disable_env_checker": True, **kwargs}
    if autoreset_mode is not None:
        arguments["vector_kwargs"] = {**(kwargs.get("vector_kwargs") or {}), "autoreset_mode": autoreset_mode}
    env: AnyVectorEnv = gym.make_vec(env_id, num_envs=num_envs, **arguments)
    return env


def _arguments_taken(
    creator: Callable[..., Any], function: Callable[..., AnyVectorEnv], fixed: Collection[str]
) -> dict[str, bool]:
    """Find out which of `num_envs` and `autoreset_mode` a maker takes, by its signature or by trying."""
    values: dict[str, Any] = {"num_envs": 2, "autoreset_mode": AutoresetMode.NEXT_STEP}
    parameters = inspect.signature(creator).parameters.values()
    named = {parameter.name for parameter in parameters if parameter.kind is not parameter.POSITIONAL_ONLY}
    anything = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
    taken = {name: name in named and name not in fixed for name in values}
    unclear = [name for name in values if anything and not taken[name] and name not in fixed]
    for name in unclear:
        trial = {name: True for name in values if taken[name]} | {name: True}
        try:
            function(**{key: values[key] for key in trial}).close()
        except TypeError as error:
            if name not in str(error):
                raise
        else:
            taken[name] = True
    return {f"takes_{name}": value for name, value in taken.items()}
