"""What a recipe has to beat, on the same episodes: nothing, random actions, a classical method, an oracle.

All fly the variant's settings. Random actions are drawn as the learner's are, held and mapped; the others act
in every control period on the environment's own actions. Classical methods see the observation, the oracle
the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from thruster_agents.evaluation.play import HEALTHY, Scenario
from thruster_agents.evaluation.table import bootstrap_interval
from thruster_agents.recipes.recipes import Recipe
from thruster_baselines.control import ApproachController, QuaternionTeam, SlotController
from thruster_baselines.detection import DetectorPlayer
from thruster_envs.rollout import fly
from thruster_envs.seeds import TEST

__all__ = ["MEASURES", "SCENARIOS", "Flown", "Row", "fly_policy", "fly_yardsticks", "rows_of"]

Policy = Callable[[NDArray[np.float32]], Any]
#: Without faults, and with those of the task: its own distribution where it has one, or else one fault from
#: the beginning in every second episode.
SCENARIOS: tuple[Scenario, ...] = (HEALTHY, Scenario("faults", "with faults", None))
_FAULTS = {"probability": 0.5}
MEASURES = ("score", "success", "return")

#: For one scenario's name, each measure over episodes.
Flown = Mapping[str, Mapping[str, Sequence[float]]]


class Row(NamedTuple):
    """A method of a recipe's table.

    Attributes:
        key: `nothing`, `random`, `classical`, `oracle` or `ppo`.
        title: For people.
        cells: Scenario to measure to mean and both ends of its 95 % bootstrap interval.
    """

    key: str
    title: str
    cells: Mapping[str, Mapping[str, tuple[float, float, float]]]


def _slots(env: Any) -> Policy:
    return SlotController(env)


def _approach(env: Any) -> Policy:
    task = env.unwrapped.task
    return ApproachController(
        task.vehicle, task.steps, distance=task.distance, navigation_delay=task.navigation_delay
    )


def _team(env: Any) -> Policy:
    return QuaternionTeam(env.unwrapped.task.vehicle, action=env.unwrapped.task.action)


def _told(env: Any) -> Policy:
    """Declares what is so at every moment, and fires no test pulse."""
    space, base = env.single_action_space, env.unwrapped

    def declare(observations: NDArray[np.float32]) -> NDArray[np.int64]:
        truth = base.task.report(base.worlds.state)["diagnosis"]
        actions = np.zeros((len(observations), *space.shape), np.int64)
        if "case" in truth:
            return actions + truth["case"].reshape(len(actions), *[1] * len(space.shape))
        actions[:, 0], actions[:, 1] = truth["thruster"][:, 0], truth["mode"][:, 0]
        return actions

    return declare


#: By task, without its version: title and maker of the classical method, and whether there is an oracle.
_KNOWN: dict[str, tuple[tuple[str, Callable[[Any], Policy]] | None, bool]] = {
    "OrionRendezvous": (("PD law, linear program", _slots), False),
    "MarsRendezvous": (("law of the approach", _approach), False),
    "FormationKeeping": (("PD law, linear program", _slots), False),
    "FormationAttitude": (("quaternion law", _team), False),
    "FaultDiagnosis": (("cumulative sums, model comparison", DetectorPlayer), True),
    "ActiveDiagnosis": (("cumulative sums, model comparison", DetectorPlayer), True),
    "PulseDiagnosis": (None, True),
}


def fly_policy(recipe: Recipe, policy: Policy | str, episodes: int, *, plain: bool = False) -> Flown:
    """Fly test episodes in every scenario.

    Args:
        recipe: Whose variant is flown.
        policy: Acts on observations (worlds, size); or `random`, `idle`.
        episodes: Of the test seeds, the first so many.
        plain: Whether to fly without what the variant puts between policy and environment.
    """
    return _fly(recipe, lambda _: policy, episodes, plain)


def _fly(recipe: Recipe, policy_of: Callable[[Any], Any], episodes: int, plain: bool) -> Flown:
    flown = {}
    for scenario in SCENARIOS:
        faults = scenario.faults
        if faults is None and not _has_faults(recipe):
            faults = _FAULTS
        variant = recipe.variant.plain() if plain else recipe.variant
        env = variant.make_vec(episodes, autoreset_mode=AutoresetMode.DISABLED, threads=1, faults=faults)
        recording = fly(env, policy_of(env), TEST[:episodes], record=("reward", "score", "success"))
        env.close()
        flown[scenario.name] = {
            "score": recording.final("score").tolist(),
            "success": recording.final("success").astype(float).tolist(),
            "return": np.nansum(recording.padded("reward"), axis=1).tolist(),
        }
    return flown


def _has_faults(recipe: Recipe) -> bool:
    """Whether the task has faults of its own, where none are given."""
    env = recipe.variant.plain().make_vec(1)
    default = env.unwrapped.task.default_faults()
    env.close()
    return not isinstance(default, tuple) or bool(default)


def fly_yardsticks(recipe: Recipe, episodes: int) -> dict[str, Flown]:
    """Every other method of the table, by key."""
    classical, oracle = _KNOWN[recipe.variant.task.rpartition("-")[0]]
    flown = {
        "nothing": fly_policy(recipe, "idle", episodes, plain=True),
        "random": fly_policy(recipe, "random", episodes),
    }
    if classical is not None:
        flown["classical"] = _fly(recipe, classical[1], episodes, plain=True)
    if oracle:
        flown["oracle"] = _fly(recipe, _told, episodes, plain=True)
    return flown


def rows_of(recipe: Recipe, yardsticks: Mapping[str, Flown], learnt: Sequence[Flown]) -> list[Row]:
    """The table of a recipe; the learnt row is over all its policies."""
    classical, _ = _KNOWN[recipe.variant.task.rpartition("-")[0]]
    diagnoses = recipe.variant.task.partition("-")[0].endswith("Diagnosis")
    titles = {
        "nothing": 'nothing: always "healthy"' if diagnoses else "nothing",
        "random": "random",
        "classical": "" if classical is None else classical[0],
        "oracle": "oracle: fault known",
        "ppo": "PPO" if len(learnt) == 1 else f"PPO, {len(learnt)} seeds",
    }
    flown: dict[str, list[Flown]] = {key: [one] for key, one in yardsticks.items()}
    flown["ppo"] = list(learnt)
    return [
        Row(key, titles[key], {one.name: _cells(flown[key], one.name) for one in SCENARIOS})
        for key in titles
        if key in flown
    ]


def _cells(policies: Sequence[Flown], scenario: str) -> dict[str, tuple[float, float, float]]:
    cells = {}
    for measure in MEASURES:
        values = np.array([one[scenario][measure] for one in policies])
        cells[measure] = float(values.mean()), *bootstrap_interval(values)
    return cells
