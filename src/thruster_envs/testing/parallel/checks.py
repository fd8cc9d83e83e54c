"""The checks of a parallel environment, one function each: what they demand is what their first line says.

They stand beside PettingZoo's own `parallel_api_test`, and look at what it leaves out: many steps instead of
one (the seed test of PettingZoo 1.27 compares a single step), infos, different seeds, ownership of arrays,
numbers that are finite. One demand is stricter than PettingZoo's interface, because learning libraries
stumble there: agents stay until the episode ends for all of them.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from copy import deepcopy
from itertools import chain, combinations, pairwise
from typing import Any

import numpy as np
from gymnasium import Space

from thruster_envs.testing.comparison import (
    first_difference,
    first_misfit,
    first_non_finite,
    first_shared_part,
    overwrite_arrays,
    show,
    snapshot,
)
from thruster_envs.testing.parallel.flights import (
    PARTS,
    AnyParallelEnv,
    ParallelFlight,
    ParallelMoment,
    ParallelSubject,
    moment_difference,
    record,
    record_in_another_process,
)
from thruster_envs.testing.report import Check, fail

_FEW_STEPS = 30  # steps that are enough to tell two random streams apart


# ---- foundations -------------------------------------------------------------------------------------------


def check_spaces_of_agents(subject: ParallelSubject) -> None:
    """Every possible agent has its spaces, the same objects in every call."""
    with subject.env() as env:
        agents = getattr(env, "possible_agents", None)
        if not isinstance(agents, list) or not agents or len(set(agents)) != len(agents):
            fail("possible_agents", f"is {show(agents)}", "make it a list of different names")
        for agent in agents:
            for kind in ("observation_space", "action_space"):
                space = getattr(env, kind)(agent)
                if not isinstance(space, Space):
                    fail(f"{kind}({agent!r})", f"is {show(space)}", "return a gymnasium Space")
                if space is not getattr(env, kind)(agent):
                    fail(
                        f"{kind}({agent!r})",
                        "is another object in every call, so that seeding it has no effect",
                        "make the spaces in __init__ and return those",
                    )


def check_reset_returns(subject: ParallelSubject) -> None:
    """`reset` returns observations and infos of all possible agents, who are all there."""
    with subject.env() as env:
        for where, arguments in (
            ("reset(seed=...)", {"seed": subject.seed}),
            ("reset()", {}),
            ("reset(options={})", {"options": {}}),
        ):
            returned = env.reset(**arguments)
            if not isinstance(returned, tuple) or len(returned) != 2:
                fail(where, f"returned {_kind(returned)}", "return the tuple (observations, infos)")
            if set(env.agents) != set(env.possible_agents):
                fail(
                    where,
                    f"agents is {show(env.agents)}, possible_agents {show(env.possible_agents)}",
                    "begin every episode with all agents: self.agents = self.possible_agents[:]",
                )
            _require_parts(
                env, where, dict(zip(("observations", "infos"), returned, strict=True)), env.agents
            )


def check_step_returns(subject: ParallelSubject) -> None:
    """`step` returns five dicts, each with exactly the agents that acted, with the right types and spaces."""
    with subject.env() as env:
        flight = ParallelFlight(env, subject.seed)
        flight.reset(subject.seed)
        for step in range(1, subject.steps + 1):
            where, acting = f"step {step}", list(env.agents)
            returned: Any = env.step(flight.actions())
            if not isinstance(returned, tuple) or len(returned) != 5:
                fail(where, f"returned {_kind(returned)}", f"return the tuple ({', '.join(PARTS)})")
            _require_parts(env, where, dict(zip(PARTS, returned, strict=True)), acting)
            if not env.agents:
                flight.reset()


def check_agents_stay(subject: ParallelSubject) -> None:
    """No agent vanishes before the end: the episode ends for all agents at once, who then leave."""
    for moment in record(subject.make_env, subject.steps, subject.seed):
        if moment.is_reset:
            continue
        ended = {
            agent
            for agent in moment.agents_before
            if moment.parts["terminations"][agent] or moment.parts["truncations"][agent]
        }
        everybody, left = set(moment.agents_before), set(moment.agents)
        remedy = (
            "end the episode of all agents in the same step, and mark a lost one in observations and infos"
        )
        if ended and ended != everybody:
            fail(moment.where, f"the episode ended for {show(sorted(ended, key=str))} only", remedy)
        if not ended and left != everybody:
            gone = sorted(everybody - left, key=str)
            fail(moment.where, f"agents lost {show(gone)} although their episode did not end", remedy)
        if ended and left:
            fail(
                moment.where,
                f"the episode ended but agents is still {show(sorted(left, key=str))}",
                "set self.agents = [] when the episode ends",
            )


# ---- what is returned --------------------------------------------------------------------------------------


def check_episodes_end(subject: ParallelSubject) -> None:
    """At least one episode ends within the steps flown."""
    if all(moment.agents for moment in record(subject.make_env, subject.steps, subject.seed)):
        fail(
            f"{subject.steps} steps",
            "no episode ended, so that ends of episodes went unchecked",
            "pass a larger steps=, or arguments that make episodes short (such as max_cycles=20)",
        )


def check_numbers_are_finite(subject: ParallelSubject) -> None:
    """No NaN and no infinity in observations, rewards and infos."""
    for moment in record(subject.make_env, subject.steps, subject.seed):
        for name, part in moment.parts.items():
            bad = first_non_finite(part, name)
            if bad is not None:
                fail(moment.where, f"{bad[0]} is {bad[1]}", "return a finite number or leave the entry out")


def check_returned_data_stays(subject: ParallelSubject) -> None:
    """What a call returned does not change when the environment is used further."""
    kept = [(moment.where, moment.parts, snapshot(moment.parts)) for moment in _raw_flight(subject)]
    for where, parts, copies in kept:
        for name, part in parts.items():
            difference = first_difference(part, copies[name], name)
            if difference is not None:
                fail(
                    where,
                    f"{difference.where} was {difference.expected} when it was returned and became "
                    f"{difference.actual} in a later call",
                    "return a copy, not the buffer that the next step overwrites",
                )


def check_returned_data_is_not_shared(subject: ParallelSubject) -> None:
    """No two calls return the same array, dict or list, or views of the same memory."""
    moments = list(_raw_flight(subject))
    for moment, other in chain(combinations(moments[:6], 2), pairwise(moments[5:])):
        shared = first_shared_part(moment.parts, other.parts)
        if shared is not None:
            fail(
                moment.where,
                f"{shared[0]} shares memory with {shared[1]} of {other.where}",
                "return a new object from every call, also when its content is constant",
            )


def check_actions_are_left_alone(subject: ParallelSubject) -> None:
    """`step` neither changes the actions that it is given nor keeps hold of them."""
    with subject.env() as env:
        undisturbed = iter(record(subject.make_env, subject.steps, subject.seed))
        flight = ParallelFlight(env, subject.seed)
        moments = [flight.reset(subject.seed)]
        for _ in range(subject.steps):
            actions = flight.actions()
            given = snapshot(actions)
            moments.append(flight.step(given))
            difference = first_difference(given, actions, "actions")
            if difference is not None:
                fail(
                    moments[-1].where,
                    f"{difference.where} was {difference.expected} and became {difference.actual} in what "
                    "the caller passed",
                    "work on a copy of the actions",
                )
            overwrite_arrays(given)
            if not env.agents:
                moments.append(flight.reset())
        for moment, right in zip(moments, undisturbed, strict=False):
            difference = moment_difference(moment, right)
            if difference is not None:
                fail(
                    moment.where,
                    f"{difference.where} is {difference.actual} instead of {difference.expected} after the "
                    "caller reused the action arrays of earlier steps",
                    "keep a copy of the actions, not the caller's array",
                )


# ---- seeding -----------------------------------------------------------------------------------------------


def check_seed_reproduces(subject: ParallelSubject) -> None:
    """The same seed and actions give the same flight, again in the same instance and in a fresh one."""
    with subject.env() as env:
        flight = ParallelFlight(env, subject.seed)
        first = list(flight.fly(subject.steps, subject.seed))
        again = list(flight.fly(subject.steps, subject.seed))
    _require_same(again, first, "again in the same instance")
    _require_same(record(subject.make_env, subject.steps, subject.seed), first, "in a fresh instance")


def check_seed_reproduces_in_another_process(subject: ParallelSubject) -> None:
    """The same seed and actions give the same flight in another process, where sets have another order."""
    here = record(subject.make_env, subject.steps, subject.seed)
    _require_same(record_in_another_process(subject), here, "in another process")


def check_seeds_differ(subject: ParallelSubject) -> None:
    """Different seeds give different flights: a reset that ignores its seed reproduces perfectly."""
    steps = min(subject.steps, _FEW_STEPS)
    with subject.env() as env:
        flight = ParallelFlight(env, subject.seed)
        one = list(flight.fly(steps, subject.seed))
        other = list(flight.fly(steps, subject.other_seed))
    if _repeats(one, other):
        fail(
            f"reset(seed={subject.seed}) and reset(seed={subject.other_seed})",
            f"the reset and {steps} steps are identical",
            "make reset(seed=...) seed the generator that the environment draws from, or skip this check if "
            "nothing in the environment is random",
        )


def check_reset_goes_on(subject: ParallelSubject) -> None:
    """`reset()` without a seed begins a new episode of the same stream: it neither repeats nor surprises."""
    steps = min(subject.steps, _FEW_STEPS)
    with subject.env() as env:
        flight = ParallelFlight(env, subject.seed)

        def episodes() -> list[list[ParallelMoment]]:
            flown = [list(flight.fly(steps, subject.seed))]
            for _ in range(3):
                flight.begin_actions()
                start = flight.reset()
                flown.append([start, *(moment for _ in range(steps) for moment in flight.go_on())])
            return flown

        first, again = episodes(), episodes()
    for one, other in zip(again, first, strict=True):
        _require_same(one, other, "when the same calls were made again")
    if all(_repeats(first[0], later) for later in first[1:]):
        fail(
            f"reset() after reset(seed={subject.seed})",
            f"three times in a row the reset and {steps} steps repeat the first ones",
            "seed only when seed is not None and let the generator go on otherwise, or skip this check if "
            "nothing is random",
        )


def check_global_random_state_is_untouched(subject: ParallelSubject) -> None:
    """Neither `numpy.random`'s global generator nor that of `random` is drawn from or seeded."""
    before, before_python = deepcopy(np.random.get_state()), random.getstate()  # noqa: NPY002 - it is watched
    record(subject.make_env, min(subject.steps, _FEW_STEPS), subject.seed)
    after, after_python = np.random.get_state(), random.getstate()  # noqa: NPY002 - it is watched
    for name, touched in (
        ("numpy.random", first_difference(after, before) is not None),
        ("random", after_python != before_python),
    ):
        if touched:
            fail(
                "a seeded flight",
                f"the global generator of {name} was used",
                "draw from a numpy.random.Generator of the environment's own",
            )


PARALLEL_CHECKS: tuple[Check, ...] = (
    Check(check_spaces_of_agents, foundation=True),
    Check(check_reset_returns, foundation=True),
    Check(check_step_returns, foundation=True),
    Check(check_seed_reproduces, foundation=True),
    Check(check_agents_stay),
    Check(check_episodes_end),
    Check(check_numbers_are_finite),
    Check(check_returned_data_stays),
    Check(check_returned_data_is_not_shared),
    Check(check_actions_are_left_alone),
    Check(check_seeds_differ),
    Check(check_reset_goes_on),
    Check(check_global_random_state_is_untouched),
    Check(check_seed_reproduces_in_another_process),
)


def _raw_flight(subject: ParallelSubject) -> Iterator[ParallelMoment]:
    """Fly, call by call, and hand on the very objects that are returned."""
    with subject.env() as env:
        yield from ParallelFlight(env, subject.seed, keep=lambda part: part).fly(subject.steps, subject.seed)


def _kind(returned: Any) -> str:
    return f"a tuple of {len(returned)}" if isinstance(returned, tuple) else f"a {type(returned).__name__}"


def _require_parts(env: AnyParallelEnv, where: str, parts: dict[str, Any], agents: list[Any]) -> None:
    """Every part has exactly these agents, each with a value of the right type and inside its space."""
    for name, part in parts.items():
        if not isinstance(part, dict):
            fail(where, f"{name} is a {type(part).__name__}", "return a dict by agent")
        if set(part) != set(agents):
            fail(
                where,
                f"{name} has the agents {show(sorted(part, key=str))} instead of "
                f"{show(sorted(agents, key=str))}",
                "return an entry for every agent that acted, and for no other",
            )
        for agent, value in part.items():
            place = f"{name}[{agent!r}]"
            if name == "observations":
                misfit = first_misfit(env.observation_space(agent), value, place)
                if misfit is not None:
                    fail(
                        where,
                        misfit,
                        "return what observation_space(agent) states, or state what is returned",
                    )
            elif name == "infos" and not isinstance(value, dict):
                fail(where, f"{place} is a {type(value).__name__}", "return a dict for every agent")
            elif name == "rewards" and (isinstance(value, bool) or not isinstance(value, (int, float))):
                fail(where, f"{place} is a {type(value).__name__}", "return a float")
            elif name in ("terminations", "truncations") and not isinstance(value, bool):
                fail(where, f"{place} is a {type(value).__name__}", "return a bool")


def _require_same(moments: list[ParallelMoment], right: list[ParallelMoment], whose: str) -> None:
    for moment, expected in zip(moments, right, strict=False):
        difference = moment_difference(moment, expected)
        if difference is not None:
            fail(
                moment.where,
                f"{difference.where} is {difference.actual} {whose} with the same seed and actions, and was "
                f"{difference.expected} the first time",
                "draw every random number from generators that reset(seed=...) seeds, and reset all state",
            )


def _repeats(moments: list[ParallelMoment], others: list[ParallelMoment]) -> bool:
    """Whether observations, rewards and ends are the same; infos may hold counters, and do not count."""

    def seen(moment: ParallelMoment) -> dict[str, Any]:
        return {name: part for name, part in moment.parts.items() if name != "infos"}

    return all(
        first_difference(seen(moment), seen(other)) is None
        for moment, other in zip(moments, others, strict=False)
    )
