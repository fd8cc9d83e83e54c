"""The rows of the table. Each method says what it sees.

- `fault`: the true vehicle. The ceiling.
- `response`: the observation of the task: the command, the last duties, and what rate change was measured
and expected.
- `command`: of the observation, the command alone.
- `nothing`.

Classical methods take the command from the batch in full precision, where the observation has it rounded to
single precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from typing_extensions import override

from thruster_agents.environments import Form, on_form
from thruster_agents.evaluation.play import HEALTHY, SCENARIOS, Method, play
from thruster_baselines.detection import ResponseTest, threshold_for
from thruster_baselines.mapping import CrudeMapper, LPMapper, MinimumNormShiftMapper
from thruster_envs.observations import Reader
from thruster_envs.protocols import Mapper
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import Spacecraft

__all__ = [
    "FALSE_ALARM_RATE",
    "Blind",
    "Constant",
    "Learned",
    "Oracle",
    "Random",
    "Tested",
    "classical_methods",
    "try_methods",
]

#: Share of healthy episodes in which the response test may blame somebody.
FALSE_ALARM_RATE = 0.01
#: Healthy validation episodes on which its threshold is calibrated.
CALIBRATION_EPISODES = 2000


class _OnDuties(Method):
    """What the methods share that command duties."""

    env: Any

    @override
    def begin(self, env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        self.env = env.unwrapped
        return env

    @property
    def command(self) -> NDArray[np.float64]:
        """(worlds, 6), the command to be answered now, m/s and rad/s."""
        return self.env.worlds.state.command

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.env.task.vehicle.control_period

    def actions(self, on_times: NDArray[np.float64]) -> NDArray[np.float64]:
        """(worlds, n), s, to actions."""
        return 2.0 * np.clip(on_times / self.period, 0.0, 1.0) - 1.0


class Blind(_OnDuties):
    """A mapper with the nominal model."""

    sees = "command"

    def __init__(self, key: str, title: str, mapper: Mapper) -> None:
        self.key, self.title, self.mapper = key, title, mapper

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        return self.actions(self.mapper(self.command).on_times)


class Oracle(_OnDuties):
    """The LP mapper with the true, faulty model: the best that anybody can do for each command."""

    key, title, sees = "oracle", "oracle LP: fault known", "fault"

    def __init__(self, mapper: LPMapper) -> None:
        self.mapper = mapper

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        effectiveness, offset = self.env.task.true_model(self.env.worlds.state)
        return self.actions(self.mapper(self.command - offset, effectiveness=effectiveness).on_times)


class Tested(_OnDuties):
    """The LP mapper with the health that a response test believes in."""

    key, title, sees = "response_test", "LP with response test", "response"

    def __init__(self, mapper: LPMapper, spacecraft: Spacecraft, threshold: float) -> None:
        self.mapper, self.spacecraft = mapper, spacecraft
        self.test = ResponseTest(spacecraft, threshold)
        self.read = Reader.of("thruster_envs/ThrusterMapping-v0", spacecraft=spacecraft)
        self.statistics: list[NDArray[np.float64]] = []

    @classmethod
    def calibrated(cls, mapper: LPMapper, spacecraft: Spacecraft, false_alarm_rate: float) -> Tested:
        """With the threshold that this share of healthy validation episodes exceeds."""
        silent = cls(mapper, spacecraft, np.inf)
        play(silent, HEALTHY, VALIDATION[-CALIBRATION_EPISODES:], spacecraft)
        statistics = np.stack(silent.statistics[1:], axis=1)
        return cls(mapper, spacecraft, threshold_for(false_alarm_rate, statistics))

    @override
    def begin(self, env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        self.test.reset(env.num_envs)
        self.statistics.clear()
        return super().begin(env)

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        reading, authority = self.read(observations), self.read.scale("measured_change")
        missed = reading.entries("measured_change") - reading.entries("expected_change")
        self.test.update(self.period * reading.duties, authority * missed)
        self.statistics.append(self.test.statistic)
        believed = self.test.belief.effectiveness(self.mapper.effectiveness)
        return self.actions(self.mapper(self.command, effectiveness=believed).on_times)


class Constant(_OnDuties):
    """The same duty for every thruster, whatever is commanded."""

    sees = "nothing"

    def __init__(self, key: str, title: str, duty: float) -> None:
        self.key, self.title, self.duty = key, title, duty

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.full((len(observations), self.env.task.action_size), 2.0 * self.duty - 1.0)


class Random(_OnDuties):
    """Uniform random duties."""

    key, title, sees = "random", "random duties", "nothing"

    @override
    def begin(self, env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        self.generator = np.random.default_rng(0)
        return super().begin(env)

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        return self.generator.uniform(-1.0, 1.0, (len(observations), self.env.task.action_size))


class Learned(Method):
    """A trained policy, acting without exploration.

    Args:
        model: What has SB3's `predict`.
        form: What its actions are.
        title: For people.
        spacecraft: What the LP mapper under the action form `beliefs` believes to fly; None for what truly
            flies, without its faults.
    """

    sees = "response"

    def __init__(self, model: Any, form: Form, title: str, spacecraft: Spacecraft | None = None) -> None:
        self.key, self.title = f"ppo_{form}", title
        self.model, self.form, self.spacecraft = model, form, spacecraft

    @override
    def begin(self, env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        return on_form(env, self.form, self.spacecraft or env.unwrapped.task.vehicle)

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        actions, _ = self.model.predict(observations, deterministic=True)
        return actions


def classical_methods(spacecraft: Spacecraft) -> Sequence[Method]:
    """The rows that nobody trains, best first, the degenerate ones last."""
    mapper = LPMapper(spacecraft, threads=1)
    return (
        Oracle(mapper),
        Tested.calibrated(mapper, spacecraft, FALSE_ALARM_RATE),
        Blind("blind", "blind LP: fault unknown", mapper),
        Blind("minimum_norm", "minimum norm and shift", MinimumNormShiftMapper(spacecraft)),
        Blind("crude", "fire what points there", CrudeMapper(spacecraft)),
        Constant("nothing", "do nothing", 0.0),
        Random(),
    )


def try_methods(spacecraft: Spacecraft, forms: Sequence[Form]) -> None:
    """Fly two episodes of each scenario with every mapper and every form of action.

    Raises:
        ValueError: The task or a mapper refuses the spacecraft, or numbers are not finite.
    """
    mapper = LPMapper(spacecraft, threads=1)
    tried: tuple[Method, ...] = (
        Oracle(mapper),
        Tested(mapper, spacecraft, np.inf),
        Blind("minimum_norm", "", MinimumNormShiftMapper(spacecraft)),
        Blind("crude", "", CrudeMapper(spacecraft)),
        *(_Tried(form) for form in forms),
    )
    for scenario in SCENARIOS:
        for method in tried:
            flown = play(method, scenario, VALIDATION[-2:], spacecraft)
            if not (np.isfinite(flown.rewards).all() and np.isfinite(flown.scores).all()):
                raise ValueError(f"its rewards are not finite with {method.key}")


class _Tried(Method):
    """Constant actions of a form."""

    sees = "nothing"

    def __init__(self, form: Form) -> None:
        self.key, self.form, self.title = form, form, form

    @override
    def begin(self, env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        self.actions = np.full(env.action_space.shape, 0.5, np.float32)
        return on_form(env, self.form, env.unwrapped.task.vehicle)

    @override
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        if not np.isfinite(observations).all():
            raise ValueError("an observation is not finite")
        return self.actions
