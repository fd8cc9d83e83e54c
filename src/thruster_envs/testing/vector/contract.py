"""What a vector environment is made of, and the types and shapes of what it takes and gives.

Most of these are foundations: where one fails, the other checks would only repeat it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import Space, spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from thruster_envs.testing.comparison import first_misfit, first_non_finite, is_mask, show
from thruster_envs.testing.report import fail
from thruster_envs.testing.vector.flights import VectorSubject, batch_of, one_flight, rows
from thruster_envs.testing.vector.makers import AnyVectorEnv


def check_can_be_made(subject: VectorSubject) -> None:
    """The environment is made in this autoreset mode, with as many copies as asked for, and closed twice."""
    mode = subject.autoreset_mode
    try:
        with subject.vector() as env:
            num_envs = env.num_envs
    except Exception as error:
        fail(
            f"making the environment with num_envs={subject.num_envs}, autoreset_mode={mode}",
            f"{type(error).__name__}: {error}",
            "support this mode, or pass autoreset_modes= with the modes that are supported",
        )
    if num_envs != subject.num_envs:
        fail(
            "num_envs",
            f"is {num_envs} after asking for {subject.num_envs} copies",
            "honour the argument num_envs",
        )
    try:
        env.close()
    except Exception as error:
        fail(
            "second close()",
            f"raised {type(error).__name__}: {error}",
            "let close() do nothing when closed already",
        )


def check_spaces(subject: VectorSubject) -> None:
    """The spaces are the single ones batched, and the single ones are those of the single environment."""
    with subject.vector() as env:
        for kind in ("observation", "action"):
            for name in (f"single_{kind}_space", f"{kind}_space"):
                space = getattr(env, name, None)
                if not isinstance(space, Space):
                    fail(name, f"is {show(space)}, not a gymnasium Space", f"set self.{name} in __init__")
            single, batched = getattr(env, f"single_{kind}_space"), getattr(env, f"{kind}_space")
            right = batch_space(single, env.num_envs)
            if batched != right:
                fail(
                    f"{kind}_space",
                    f"is {show(batched)}, not {show(right)}",
                    f"use gymnasium.vector.utils.batch_space(single_{kind}_space, num_envs)",
                )
            if subject.make_single is not None:
                with subject.singles() as copies:
                    own = getattr(copies[0].env, f"{kind}_space")
                if own != single:
                    fail(
                        f"single_{kind}_space",
                        f"is {show(single)}, but the single environment has {show(own)}",
                        "give both the same space",
                    )


def check_autoreset_mode_is_stated(subject: VectorSubject) -> None:
    """`metadata["autoreset_mode"]` is the AutoresetMode in use, and belongs to the instance."""
    remedy = (
        'set self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode(autoreset_mode)} in __init__'
    )
    with subject.vector() as env:
        where = 'metadata["autoreset_mode"]'
        if "autoreset_mode" not in env.metadata:
            fail(where, "is missing", remedy)
        stated = env.metadata["autoreset_mode"]
        if not isinstance(stated, AutoresetMode):
            fail(where, f"is {show(stated)}, not an AutoresetMode", remedy)
        if stated is not subject.autoreset_mode:
            fail(where, f"is {stated} in an environment made with {subject.autoreset_mode}", remedy)
        if not subject.factory.takes_autoreset_mode:
            return
        other = next(mode for mode in AutoresetMode if mode is not subject.autoreset_mode)
        try:
            with subject.vector(autoreset_mode=other):
                stated = env.metadata["autoreset_mode"]
        except Exception:  # the other mode is not supported, which is not this check's matter
            return
        if stated is not subject.autoreset_mode:
            fail(where, f"became {stated} when another environment was made with {other}", remedy)


def check_reset_returns(subject: VectorSubject) -> None:
    """`reset` returns a batch of observations, of the right type, shape, dtype and bounds, and a dict."""
    with subject.vector() as env:
        for where, arguments in (
            ("reset(seed)", {"seed": subject.seed}),
            ("reset()", {}),
            ("reset(options={})", {"options": {}}),
        ):
            returned: Any = env.reset(**arguments)
            if not isinstance(returned, tuple) or len(returned) != 2:
                fail(
                    where, f"returned {_shape_of_return(returned)}", "return the tuple (observations, infos)"
                )
            _require_observations_and_infos(env, where, *returned)


def check_step_returns(subject: VectorSubject) -> None:
    """`step` returns five things of the right type, shape and dtype, with observations inside their space."""
    with subject.vector() as env:
        env.reset(seed=subject.seed)
        for step, actions in enumerate(subject.actions(env), start=1):
            where = f"step {step}"
            returned: Any = env.step(actions)
            if not isinstance(returned, tuple) or len(returned) != 5:
                fail(
                    where,
                    f"returned {_shape_of_return(returned)}",
                    "return (observations, rewards, terminations, truncations, infos)",
                )
            observations, rewards, terminations, truncations, infos = returned
            _require_observations_and_infos(env, where, observations, infos)
            _require_vector(where, "rewards", rewards, subject.num_envs, "f", "np.float64 or np.float32")
            _require_vector(where, "terminations", terminations, subject.num_envs, "b", "np.bool_")
            _require_vector(where, "truncations", truncations, subject.num_envs, "b", "np.bool_")
            done = terminations | truncations
            if subject.autoreset_mode is AutoresetMode.DISABLED and done.any():
                env.reset(options={"reset_mask": done.copy()})


def check_infos_have_masks(subject: VectorSubject) -> None:
    """Every entry `k` of `infos` has one row for each copy, and a mask `_k` that says which rows count."""
    for moment in one_flight(subject):
        _require_masks(moment.where, "infos", moment.infos, subject.num_envs)


def check_numbers_are_finite(subject: VectorSubject) -> None:
    """No NaN and no infinity in observations, rewards and infos."""
    for moment in one_flight(subject):
        for name, part in moment.parts().items():
            bad = first_non_finite(part, name)
            if bad is not None:
                place, number = bad
                fail(
                    moment.where,
                    f"{place} is {number}",
                    "return a finite number (in infos, leave the entry out by its mask or use a finite "
                    "stand-in)",
                )


def check_bad_actions_are_refused(subject: VectorSubject) -> None:
    """A batch of actions for another number of copies, or of another shape for each copy, is refused."""
    n = subject.num_envs
    with subject.vector() as env:
        single, batched = env.single_action_space, env.action_space
        good = subject.actions(env, 1)[0]
    bad: dict[str, Any] = {"for one copy, without a batch axis": rows(batched, good)[0]}
    for count in sorted({1, n - 1, n + 1}):
        bad[f"for a batch of {count}"] = batch_of(
            single, [(rows(batched, good) * 2)[copy] for copy in range(count)]
        )
    if isinstance(single, spaces.Box) and single.shape:
        bad["of twice the length"] = np.concatenate([good, good], axis=-1)
    for kind, actions in bad.items():
        with subject.vector() as env:
            env.reset(seed=subject.seed)
            try:
                env.step(actions)
            except Exception:  # which exception is the environment's own choice
                continue
        fail(
            f"step with actions {kind}",
            f"was accepted by an environment of {n} copies",
            f"raise a ValueError unless the actions have the shape of {show(batched)}",
        )


def _shape_of_return(returned: Any) -> str:
    if isinstance(returned, tuple):
        return f"a tuple of {len(returned)}"
    return f"a {type(returned).__name__}"


def _require_observations_and_infos(env: AnyVectorEnv, where: str, observations: Any, infos: Any) -> None:
    misfit = first_misfit(env.observation_space, observations, "observations")
    if misfit is not None:
        fail(where, misfit, "return what observation_space states, or state what is returned")
    if not isinstance(infos, dict) or not all(isinstance(key, str) for key in infos):
        fail(
            where,
            f"infos is a {type(infos).__name__}, not a dict with strings as keys",
            "return one dict for all copies: key -> array with one row for each copy",
        )


def _require_vector(where: str, name: str, value: Any, num_envs: int, kind: str, dtype: str) -> None:
    if not isinstance(value, np.ndarray):
        fail(
            where,
            f"{name} is a {type(value).__name__}, not an array",
            f"return an array of shape ({num_envs},)",
        )
    if value.shape != (num_envs,):
        fail(where, f"{name} has shape {value.shape}", f"return an array of shape ({num_envs},)")
    if value.dtype.kind != kind:
        fail(where, f"{name} has dtype {value.dtype}", f"return an array of {dtype}")


def _require_masks(where: str, path: str, infos: Mapping[str, Any], num_envs: int) -> None:
    for key, value in infos.items():
        place = f"{path}[{key!r}]"
        if is_mask(key, infos):
            if not isinstance(value, np.ndarray) or value.dtype != np.bool_ or value.shape != (num_envs,):
                fail(where, f"{place} is {show(value)}", f"make it a boolean array of shape ({num_envs},)")
            continue
        if f"_{key}" not in infos:
            fail(
                where,
                f"{place} has no mask",
                f"add {path}['_{key}'], a boolean array of shape ({num_envs},), True for the copies that "
                "have the entry",
            )
        if isinstance(value, Mapping):
            if key != "final_obs":
                _require_masks(where, place, value, num_envs)
        elif isinstance(value, tuple) and key == "final_obs":
            continue
        elif not isinstance(value, np.ndarray) or value.shape[:1] != (num_envs,):
            shape = f"of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            fail(where, f"{place} is {shape}", f"make it an array with {num_envs} rows, one for each copy")
