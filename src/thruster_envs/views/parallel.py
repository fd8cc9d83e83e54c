"""A world's craft as the agents of a PettingZoo ``ParallelEnv``, and the environments of that form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from thruster_envs.extras import extra
from thruster_envs.tasks import FormationAttitude, FormationKeeping, Task
from thruster_envs.views.inputs import checked_actions, checked_seed
from thruster_envs.views.making import view_of_path
from thruster_envs.views.scenes import RENDER_MODES, Camera
from thruster_envs.views.single import checked_flag, checked_render_mode, info_of_agent, make_task
from thruster_envs.views.spaces import action_space, observation_space
from thruster_envs.views.states import MidEpisode
from thruster_envs.views.worlds import Step, Worlds

with extra("multi-agent", __name__):
    import pettingzoo
    from pettingzoo import ParallelEnv

Observation = NDArray[np.float32]
_ONE = np.zeros(1, np.int64)


class TaskParallelEnv(MidEpisode, ParallelEnv[str, Observation, Observation]):  # type: ignore[misc]  # untyped
    """One world of a task whose craft are agents; subclasses name the task.

    Args:
        max_cycles: Time limit in periods; None takes the task's own.
        render_mode: None, ``"rgb_array"`` or ``"human"``.
        flat_info: Whether the infos have no dictionaries in them, but keys like ``reward_terms/fuel``, and
            NumPy scalars and arrays instead of Python's numbers.
        **configuration: Fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": list(RENDER_MODES),
        "is_parallelizable": True,
        "render_fps": 20,
    }
    task_type: ClassVar[type[Task]]

    def __init__(
        self,
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        flat_info: bool = False,
        **configuration: Any,
    ) -> None:
        others = ("max_cycles", "render_mode", "flat_info")
        self.task = make_task(self.task_type, configuration, {}, others, type(self).__name__)
        self.flat_info = checked_flag("flat_info", flat_info)
        self.max_cycles = max_cycles if max_cycles is not None else self.task.max_episode_steps
        self.render_mode = checked_render_mode(render_mode)
        self.worlds = Worlds(self.task, 1, max_episode_steps=self.max_cycles)
        self.possible_agents = list(self.task.agents)
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_space(self.task) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space(self.task) for agent in self.possible_agents}
        box = self.observation_spaces[self.possible_agents[0]]
        self.state_space = spaces.Box(
            np.tile(box.low, len(self.possible_agents)),
            np.tile(box.high, len(self.possible_agents)),
            dtype=np.float32,
        )
        self._camera = Camera(self.worlds, 0, self.task_type.__name__)

    def observation_space(self, agent: str) -> spaces.Box:
        """The same object at every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode with every agent; ``options={"faults": ...}`` gives it faults of its own."""
        if seed is not None or not self.worlds.seeded:
            fresh = np.random.SeedSequence().entropy if seed is None else seed
            self.worlds.seed(_ONE, [checked_seed(fresh)])
        self.worlds.reset(_ONE, options)
        self.agents = list(self.possible_agents)
        self._camera.watch(begins=True, mode=self.render_mode)
        now = self.worlds.now()
        return self._by_agent(now.observations[0]), self._infos(now)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Let one control period pass; all agents end together."""
        self.worlds.require_reset("step")
        if not self.agents:
            raise ValueError("the episode is over; call reset() before step()")
        if not isinstance(actions, Mapping):
            raise ValueError(f"actions must be a dict from agent to action, got {type(actions).__name__}")
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(
                f"no action for {', '.join(missing)}; one for each of {', '.join(self.agents)} would be right"
            )
        switches = self.task.choices is not None
        given = [
            checked_actions(
                actions[agent],
                self.action_spaces[agent].shape or (),
                name=f"the action of {agent}",
                switches=switches,
            )
            for agent in self.agents
        ]
        self.worlds.max_episode_steps = self.max_cycles
        step = self.worlds.step(np.stack(given).reshape((1, len(given), -1)))
        self._camera.watch(begins=False, mode=self.render_mode)
        agents = self.agents
        rewards = {agent: float(step.rewards[0, k]) for k, agent in enumerate(agents)}
        terminations = {agent: bool(step.terminated[0]) for agent in agents}
        truncations = {agent: bool(step.truncated[0]) for agent in agents}
        observations, infos = self._by_agent(step.observations[0]), self._infos(step)
        if step.done[0]:
            self.agents = []
        return observations, rewards, terminations, truncations, infos

    def _by_agent(self, rows: Observation) -> dict[str, Observation]:
        return {agent: rows[k].copy() for k, agent in enumerate(self.agents)}

    def _infos(self, step: Step) -> dict[str, dict[str, Any]]:
        return {
            agent: info_of_agent(self.worlds, step, k, flat=self.flat_info)
            for k, agent in enumerate(self.agents)
        }

    @property
    def np_random_seed(self) -> int | None:
        """The seed of the last reset that had one, or was the first; None before that."""
        return self.worlds.seed_of(0) if self.worlds.seeded else None

    def state(self) -> Observation:
        """The observations of all agents, one after another."""
        self.worlds.require_reset("state")
        return np.ravel(self.worlds.observe()[0])

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the formation now, in the mode ``rgb_array``."""
        self.worlds.require_reset("render")
        if self.render_mode == "rgb_array":
            return self._camera.frame()
        if self.render_mode == "human":
            self._camera.show()
        return None

    def _own_state(self) -> dict[str, NDArray[Any]]:
        return {"over": np.array(not self.agents)}

    def _set_own_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.agents = [] if bool(state["over"]) else list(self.possible_agents)
        if self.render_mode is not None and self.worlds.begun:
            self._camera.begin()

    def close(self) -> None:
        """Close the window, if there is one."""
        if hasattr(self, "_camera"):  # not where the constructor failed
            self._camera.close()


def __getattr__(name: str) -> Any:
    """The parallel environment of a task, by the path to its class with slashes."""
    if "/" in name:
        return view_of_path(TaskParallelEnv, name, "ParallelEnv")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def register_parallel(identifier: str, module: str) -> None:
    """Register the two makers of a module with PettingZoo, unless its tables have that id already.

    PettingZoo has tables from 1.27 on; before, its environments are found by their modules alone.
    """
    if not hasattr(pettingzoo, "register"):
        return
    from pettingzoo.env_registry.registration import aec_registry, parallel_registry

    for form, registry, maker in (
        ("parallel", parallel_registry, "parallel_env"),
        ("aec", aec_registry, "env"),
    ):
        if identifier not in registry:
            pettingzoo.register(form, identifier, entry_point=f"{module}:{maker}")


def register_view(identifier: str, view: str, settings: dict[str, Any]) -> None:
    """Register a parallel environment, ``module:attribute``, with PettingZoo, in place of an earlier one.

    PettingZoo has a table from 1.27 on.
    """
    if not hasattr(pettingzoo, "register"):
        return
    from pettingzoo.env_registry.registration import parallel_registry

    parallel_registry.pop(identifier, None)
    pettingzoo.register("parallel", identifier, entry_point=view, kwargs=settings)


class FormationParallelEnv(TaskParallelEnv):
    """Keep a formation of craft in its slots, every craft an agent of its own.

    ## Description

    Three Orion craft (two to eight) keep slots that lie evenly on a circular relative orbit of 50 m about an
    empty reference point. Free motion follows that orbit without fuel, so what is to be flown against is
    dispersion, sensor noise, firing scatter, and faults. The fuel bill is shared: whoever fires, all pay. The
    agents are called `craft_1`, `craft_2`, ...; all of them stay until the episode ends, for all at once.
    Single-agent form: `thruster_envs/FormationKeeping-v1` in Gymnasium.

    ## Action Space

    `Box(-1, 1, (12,), float32)` for each agent, the duty of each thruster in the coming period of 5 s.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-11 | duty of each thruster: -1 stays shut, 0 opens for half the period, 1 for all of it | -1 | 1 | 1 |

    ## Observation Space

    `Box(..., (43,), float32)` for each agent, for three craft. Positions and velocities in LVLH axes x, y, z;
    attitude error, rate error and rate changes in body axes. *Authority* is the largest rate change that the
    healthy vehicle reaches on an axis in one period. Values beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | measured position relative to the slot | -5 | 5 | 10 m |
    | 3-5 | measured velocity relative to the slot | -5 | 5 | 0.05 m/s |
    | 6-8 | measured attitude error | -5 | 5 | 0.5 rad |
    | 9-11 | measured rate error | -5 | 5 | 0.05 rad/s |
    | 12-23 | last duties | 0 | 1 | 1 |
    | 24-29 | last measured rate change | -5 | 5 | authority per axis |
    | 30-35 | last expected rate change | -5 | 5 | authority per axis |
    | 36 | own fuel over the formation's mean, less one | -1 | 5 | 1 |
    | 37-42 | measured positions of the other craft | -5 | 5 | 100 m |

    The positions of the other craft are relative to the own one, in the order of the craft. With
    `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 43-54 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 55-66 | true opening of each thruster when closed | -1 | 1 | 1 |

    `state()` is the observations of all agents, one after another.

    ## Rewards

    For each agent. With *d* the distance from the slot, *a* the angle from LVLH and *u* the mean over all
    craft of the share of thruster time in which valves were open:

    reward = 5 / 120 (1 / (1 + d / `slot_tolerance`) + 0.5 / (1 + a / (0.1 rad)) + `fuel_price` (1 - u)) -
    5 (1.5 + `fuel_price`) [lost]

    | Term | What | In a period | In an episode of 120 |
    |---|---|---|---|
    | `tracking` | 5 / 120 / (1 + d / `slot_tolerance`) | 0 to 0.042 | 0 to 5 |
    | `attitude` | 2.5 / 120 / (1 + a / (0.1 rad)) | 0 to 0.021 | 0 to 2.5 |
    | `fuel` | 5 / 120 `fuel_price` (1 - u) | 0 to 0.021 | 0 to 2.5 |
    | `lost` | - 5 (1.5 + `fuel_price`) | -10 or 0 | -10 or 0 |

    - `tracking`: of being in the slot
    - `attitude`: of being aligned with LVLH
    - `fuel`: of valves that stay shut; whoever fires, all pay
    - `lost`: for every agent, where any craft is lost, as much as a whole episode can be worth

    No period without a loss returns less than 0: at whatever time, under whatever discount and whatever the
    time limit, a loss returns less than any way to go on without one. Doing nothing drifts some metres off
    the slot and is not lost.

    ## Starting State

    The first slot is at a random phase of the relative orbit. Each craft starts at its slot, dispersed
    uniformly by 1.5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis. No faults unless `faults` says so.

    ## Episode End

    Terminates for all when any craft is further than 100 m from its slot or turns faster than 1 rad/s.
    Truncated for all after `max_cycles` periods.

    ## Information

    For each agent, the same keys as in the Gymnasium environments:

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: 1 - distance / 10 m to the nearest other craft, where that is above 0: the danger of a
      collision.
    - `fault`: arrays over the fault slots of the craft: `thruster` (from 1; 0 where none fails), `kind`
      (position in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an
      empty slot), `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`,
      from 1; 0 where none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of open valve of the craft since the reset.
    - `score`: share of the steps so far after which the craft was within 1 m of its slot.
    - `success`: whether the score is at least 0.8, without any cost on the way and without a craft lost.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.

    ## Arguments

    - `max_cycles`: time limit in periods, 120 by default.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.
    - `craft`: number of craft, 2 to 8. `commanded`: how many of them are agents, counted from the first; the
      others fly with the suite's scripted pilot, which knows of no fault.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `spacecraft`, `observe_fault`, `fault_slots`, `nonlinear`, `max_substep`, `radius`, `slot_tolerance`,
      `keep_out`, `range_limit`, `rate_limit`, `fuel_price`: as in
      :class:`~thruster_envs.tasks.FormationKeeping`.

    >>> env = FormationParallelEnv(craft=2, faults=[{"craft": 2, "thruster": 5, "kind": "leak"}])
    >>> observations, infos = env.reset(seed=0)
    >>> [int(infos[agent]["fault"]["thruster"][0]) for agent in env.agents]
    [0, 5]

    ## Version History

    - v1: a reward that no loss can raise: periods are worth something, and a loss costs a whole episode
    - v0: initial version
    """

    metadata: ClassVar[dict[str, Any]] = TaskParallelEnv.metadata | {"name": "formation_keeping_v1"}
    task_type: ClassVar[type[Task]] = FormationKeeping


class FormationAttitudeParallelEnv(TaskParallelEnv):
    """Turn a formation of craft to their attitudes by pulses, every follower an agent of its own.

    ## Description

    Cubesats with three pairs of pulsed plasma thrusters, a leader and its followers (Valdes 2008, chapters 5
    and 6; attitude alone). The leader holds its attitude; each follower turns from it by some 55 to 80
    degrees and holds that. A thruster fires at most once in a period of 1 s, with 0.1 mN for 16 ms; the two
    of a pair share a capacitor and never fire together. The requirements are those of the source: each
    component of the quaternion's error below 0.006 before 1000 s have passed and at the end, each relative
    rate below 6e-5 rad/s at the end. The gravity gradient and a small constant torque disturb. Discharges can
    fail in ways of their own, beside those of every thruster.

    The agents are called `follower_1`, `follower_2`, ...; with `command_leader=True` the first is `leader`.
    All of them stay until the episode ends, for all at once. Single-agent form:
    `thruster_envs/FormationAttitude-v1` in Gymnasium. Importing :mod:`thruster_envs.formation_attitude_v1`
    registers it with PettingZoo.

    ## Action Space

    `MultiDiscrete([3, 3, 3])` for each agent, a pulse about each axis in the coming period.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | about x, y and z: 0 no pulse, 1 a pulse forwards, 2 a pulse backwards | 0 | 2 | 1 |

    With `action="duties"` it is `Box(-1, 1, (6,), float32)`: for each thruster a share, from -1 for none to 1
    for all, of the one pulse that there can be in a period. Shares are added up; a thruster fires when it is
    owed a whole pulse, and of two on one capacitor the one that is owed more. The observation then also has,
    before what a fault does, the share of a pulse that each thruster is owed (0 to 2).

    ## Observation Space

    `Box(..., (21,), float32)` for each agent. Quaternions are scalar first and not negative, of the
    body *from* what it is compared with. The leader, where it is an agent, takes the frame it started in for
    the leader. Values beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-3 | measured attitude from the target, as a quaternion | -1 | 1 | 1 |
    | 4-6 | measured attitude error | -1 | 1 | 0.05 rad |
    | 7-9 | measured rate relative to the leader | -5 | 5 | 0.001 rad/s |
    | 10-13 | target from the leader, as a quaternion | -1 | 1 | 1 |
    | 14-19 | whether each thruster was asked to fire last | 0 | 1 | 1 |
    | 20 | own fuel over the formation's mean, less one | -1 | 5 | 1 |

    With `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 21-26 | true impulse that asking each thruster adds | -2 | 2 | nominal impulse |
    | 27-32 | true impulse of each thruster unasked | -2 | 2 | nominal impulse |

    `state()` is the observations of all agents, one after another.

    ## Rewards

    For each agent. With *a* the angle from the target, *e* the share by which the own fuel is above the
    formation's mean, at most 1, and *p* the pulses of the period:

    reward = 7 / 3000 (1 - (a / pi + a / (a + 0.05 rad)) / 2 + `balance_price` (1 - e) +
    `pulse_price` (1 - p / 3)) - 7 (1 + `balance_price` + `pulse_price`) [lost]

    | Term | What | In a period | In an episode of 3000 |
    |---|---|---|---|
    | `pointing` | 7 / 3000 (1 - (a / pi + a / (a + 0.05 rad)) / 2) | 0 to 0.00233 | 0 to 7 |
    | `balance` | 7 / 3000 `balance_price` (1 - e) | 0 to 0.00005 | 0 to 0.14 |
    | `pulses` | 7 / 3000 `pulse_price` (1 - p / 3) | 0 to 0.00007 | 0 to 0.21 |
    | `lost` | - 7 (1 + `balance_price` + `pulse_price`) | -7.35 or 0 | -7.35 or 0 |

    - `pointing`: of being at the target
    - `balance`: of using no more fuel than the others
    - `pulses`: of pulses that are not fired
    - `lost`: for every agent, where any craft is lost, as much as a whole episode can be worth

    No period without a loss returns less than 0: at whatever time, under whatever discount and whatever the
    time limit, a loss returns less than any way to go on without one. Doing nothing stays at the start and is
    not lost. To be lost takes some 1000 periods of pulses, a turn 700: a discount of 0.99 per period hardly
    sees either.

    ## Starting State

    All craft at rest and aligned with each other. The target of each follower is drawn: roll from 20 to 35
    degrees, pitch from 30 to 50, yaw from 40 to 60. The leader's is to stay. No faults unless `faults` says
    so.

    ## Episode End

    Terminates for all when any craft turns faster than 0.05 rad/s. Truncated for all after `max_cycles`
    periods.

    ## Information

    For each agent, the same keys as in the Gymnasium environments:

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.01 rad/s; 0 below.
    - `fault`: arrays over the fault slots of the own craft: `thruster` (from 1; 0 where none fails), `kind`
      (position in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an
      empty slot), `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`,
      from 1; 0 where none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of discharge of the own craft since the reset; a pulse is 0.016.
    - `score`: half for the share of the turn that is done, half for the share of the six requirements met
      now, that of a rate counted only where the attitude about the same axis is right; 0 where a craft is
      lost.
    - `success`: whether all six are met and the attitude settled within 1000 s of its target being set.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `attitude`: `error`, the angle from the target in rad; `requirements_met`, how many of the six;
      `settling_time`, s from the target being set until the attitude was within its tolerance for good, -1
      where it is not.

    ## Arguments

    - `max_cycles`: time limit in periods, 3000 by default, as long as the missions of the source. For
      learning, 1200 keep what matters, the turn and its settling; to explore, hold each action for some ten
      periods, since pulses drawn anew in every one cancel.
    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`, with a
      discharge and a thruster for each way about each axis.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own. Craft 1 is the leader, craft 2
      follower 1.
    - `observe_fault`: whether the truth about the own faults is added to the observation.
    - `fault_slots`: faults that each craft can have in an episode, 4 by default.
    - `craft`: number of craft, 2 to 16, the leader among them.
    - `command_leader`: whether the leader is an agent too. `commanded`: how many craft are agents, counted
      from the first follower, or from the leader if it is one; the others fly by the law.
    - `action`: `"pulses"` or `"duties"`, as above.
    - `roll_degrees`, `pitch_degrees`, `yaw_degrees`: ranges of the angles of targets.
    - `retarget_interval`: control periods after which all followers get new targets; None for never. In the
      period in which a target is set, all information is still about the one before.
    - `gravity_gradient`: whether it acts. `bias_torque`: a constant torque on every craft, N m, body axes.
      `fault_bias`: torque that comes with a fault of a discharge, N m: for one that takes thrust, and for one
      that adds some.
    - `rate_soft_limit`: body rate from which on `cost` counts; `rate_limit`: at which a craft is lost, rad/s.
    - `balance_price`, `pulse_price`: see Rewards.
    - `max_substep`: longest integration sub-step, s; None for 1 s. `nonlinear`: without effect, nothing
      moves.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> env = FormationAttitudeParallelEnv(faults=[{"craft": 3, "thruster": 5, "kind": "propellant_loss",
    ...                                             "severity": 0.9}])
    >>> observations, infos = env.reset(seed=0)
    >>> {agent: int(infos[agent]["fault"]["thruster"][0]) for agent in env.agents}
    {'follower_1': 0, 'follower_2': 5}

    ## Version History

    - v1: a reward that no loss can raise: periods are worth something, and a loss costs a whole episode
    - v0: initial version
    """

    metadata: ClassVar[dict[str, Any]] = TaskParallelEnv.metadata | {"name": "formation_attitude_v1"}
    task_type: ClassVar[type[Task]] = FormationAttitude
